"""Losses of sets: scipy's matching, and what is not known or lies beyond a set's rows is free."""

import jax
import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from uniart_jax.training.set_loss import SetWeights, match_rows, set_loss

S, K, Q, R = 3, 4, 6, 5
COUNTS = np.int32([4, 2, 0])
WEIGHTS = SetWeights(match=3.0, sure=0.5, row=2.0, exists=0.7)
RNG = np.random.default_rng(0)
ROWS = [RNG.normal(size=(S, Q, R)).astype(np.float32) for _ in range(2)]
EXISTS = [RNG.normal(size=(S, Q)).astype(np.float32) for _ in range(2)]
TRUE = RNG.normal(size=(S, K, R)).astype(np.float32)
SCALE = RNG.random((S, K, R)).astype(np.float32)
matching = jax.jit(match_rows)
loss_of = jax.jit(lambda *args: set_loss(ROWS, EXISTS, *args)[:2], static_argnums=2)


def values(true=TRUE, counts=COUNTS, scale=SCALE):
    return [float(value) for value in loss_of(true, counts, WEIGHTS, scale)]


def by_hand(true, counts, scale, w):
    """The docstring's formula in NumPy, with scipy's matching."""
    far = [(np.abs(r[:, :, None] - true[:, None]) * scale[:, None]).mean(-1) for r in ROWS]
    sure = [1 / (1 + np.exp(-e)) for e in EXISTS]
    cost = sum(w.match * f - w.sure * p[..., None] for f, p in zip(far, sure, strict=True))
    total = last = 0.0
    for s, n in enumerate(counts):
        query, column = linear_sum_assignment(cost[s, :, :n])
        there = np.isin(np.arange(Q), query)
        for f, p in zip(far, sure, strict=True):
            entropy = -np.log(np.where(there, p[s], 1 - p[s])).mean()
            total += w.row * f[s, query, column].sum() / max(n, 1) + w.exists * entropy
        off = np.abs(ROWS[-1][s, query] - true[s, column]).mean(-1)
        last += off.sum() / max(n, 1)
    return [total / len(ROWS) / S, last / S]


def test_the_loss_is_that_of_scipys_matching():
    assert values() == pytest.approx(by_hand(TRUE, COUNTS, SCALE, WEIGHTS), rel=1e-5)
    unscaled = by_hand(TRUE, COUNTS, np.ones_like(TRUE), WEIGHTS)
    assert values(scale=1.0) == pytest.approx(unscaled, rel=1e-5)


def test_each_true_row_has_scipys_query():
    cost = RNG.normal(size=(S, Q, K)).astype(np.float32)
    found = matching(cost, COUNTS)
    for s, n in enumerate(COUNTS):
        query, column = linear_sum_assignment(cost[s, :, :n])
        assert np.asarray(found.query)[s, column].tolist() == query.tolist()
        chosen = np.zeros((K, Q))
        chosen[column, query] = 1
        np.testing.assert_array_equal(found.chosen[s], chosen)
        np.testing.assert_array_equal(found.present[s], chosen.sum(0))
    taken = np.asarray(found.take(ROWS[0]))
    np.testing.assert_array_equal(taken[0], ROWS[0][0, np.asarray(found.query)[0]])
    assert not taken[1, 2:].any()  # of padding


def test_the_order_of_the_true_rows_does_not_matter():
    turned, scale = TRUE.copy(), SCALE.copy()
    for array in (turned, scale):
        array[0], array[1, :2] = array[0, [2, 0, 3, 1]], array[1, [1, 0]]
    assert values(turned, scale=scale) == pytest.approx(values(), rel=1e-5)


def test_padding_does_not_matter():
    garbage = TRUE.copy()
    garbage[1, 2:], garbage[2] = 1e4, -1e4
    assert values(garbage) == pytest.approx(values(), rel=1e-5)
    pad = np.ones((S, 2, R), np.float32)
    wider = [np.concatenate([array, pad], 1) for array in (TRUE, SCALE)]
    assert values(wider[0], scale=wider[1]) == pytest.approx(values(), rel=1e-5)


def test_a_set_that_is_not_known_pays_nothing_an_empty_one_that_rows_exist():
    def gradients(counts):
        value = lambda rows, exists: set_loss(rows, exists, TRUE, counts, WEIGHTS)[0]  # noqa: E731
        return jax.jit(jax.grad(value, (0, 1)))(ROWS, EXISTS)

    for count, pays in ((-1, False), (0, True)):
        rows, exists = gradients(np.int32([4, 2, count]))
        assert not np.asarray(rows[0])[2].any() and np.asarray(rows[0])[1].any()
        assert np.asarray(exists[0])[2].all() == np.asarray(exists[0])[2].any() == pays


def test_means_are_over_as_many_sets_as_are_asked_for():
    @jax.jit
    def half(sets):
        return set_loss(ROWS, EXISTS, TRUE, COUNTS, WEIGHTS, SCALE, sets)[0]

    assert float(half(2 * S)) == pytest.approx(values()[0] / 2, rel=1e-5)

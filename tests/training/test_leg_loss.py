"""The loss of legs: of a set, of those that are known alone."""

import jax
import numpy as np
import pytest

from uniart_jax.training.leg_loss import leg_losses
from uniart_jax.voxels.typed_batches import LayoutBatch

N, Q = 4, 6
RNG = np.random.default_rng(0)
OUT = {
    "rows": [RNG.normal(size=(2, Q, 10)).astype(np.float32) for _ in range(2)],
    "exists": [RNG.normal(size=(2, Q)).astype(np.float32) for _ in range(2)],
    "plinth": [RNG.normal(size=(2, Q)).astype(np.float32) for _ in range(2)],
    "fill": [RNG.random((2, Q)).astype(np.float32) for _ in range(2)],
    "alone": RNG.normal(size=2).astype(np.float32),
}
losses = jax.jit(leg_losses)


def batch(legs, counts, alone=(True, False)):
    parts = {name: np.zeros(0) for name in LayoutBatch._fields[:7]}
    return LayoutBatch(
        **parts, legs=legs, leg_counts=np.array(counts, np.int32), legs_alone=np.array(alone)
    )


def legs():
    table = RNG.random((2, N, 12)).astype(np.float32)
    table[..., 11] = table[..., 11] > 0.5
    return table


def values(*args):
    return {name: float(value) for name, value in losses(OUT, batch(*args)).items()}


def test_the_order_of_legs_and_what_lies_beyond_them_do_not_matter():
    table = legs()
    first = values(table, [4, 2])
    turned = table.copy()
    turned[0], turned[1, :2] = table[0, [2, 0, 3, 1]], table[1, [1, 0]]
    turned[1, 2:] = 99
    assert values(turned, [4, 2]) == pytest.approx(first, rel=1e-5)
    more = np.concatenate([table, np.full((2, 2, 12), 7, np.float32)], 1)
    assert values(more, [4, 2]) == pytest.approx(first, rel=1e-5)


def test_objects_whose_legs_are_not_known_pay_nothing():
    table = legs()
    gradient_of = jax.jit(jax.grad(lambda out, batch: leg_losses(out, batch)["legs"]))
    gradient = gradient_of(OUT, batch(table, [-1, 3]))
    for leaf in jax.tree.leaves(gradient):
        assert not np.asarray(leaf)[0].any()
    none = gradient_of(OUT, batch(table, [0, 3]))
    assert np.asarray(none["exists"][1])[0].all()  # that there are none is known


def test_a_perfect_answer_costs_next_to_nothing():
    table = legs()
    sure = np.full((2, Q), -20.0, np.float32)
    sure[0, :4] = sure[1, 2:4] = 20
    rows, plinth, fill = np.zeros((2, Q, 10)), np.zeros((2, Q)), np.zeros((2, Q))
    for item, here in ((0, slice(0, 4)), (1, slice(2, 4))):
        count = here.stop - here.start
        rows[item, here] = table[item, :count, :10]
        fill[item, here] = table[item, :count, 10]
        plinth[item, here] = 40 * table[item, :count, 11] - 20
    out = {name: [np.float32(value)] * 2 for name, value in
           (("rows", rows), ("exists", sure), ("plinth", plinth), ("fill", fill))}  # fmt: skip
    out["alone"] = np.float32([20, -20])
    found = losses(out, batch(table, [4, 2]))
    assert float(found["legs"]) < 1e-5 and float(found["legs_row"]) < 1e-6


def test_a_batch_without_legs_is_refused():
    with pytest.raises(ValueError, match="the batch has no legs"):
        leg_losses(OUT, batch(legs(), [1, 1])._replace(legs=None))

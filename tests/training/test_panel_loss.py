"""The loss of panels and boards: of a set, of those that are known alone, strictest about faces."""

import jax
import numpy as np
import pytest

from uniart_jax.training.panel_loss import board_losses, panel_losses
from uniart_jax.voxels.typed_batches import LayoutBatch

N, Q = 4, 6
RNG = np.random.default_rng(0)
OUT = {
    "rows": [RNG.normal(size=(2, Q, 6)).astype(np.float32) for _ in range(2)],
    "exists": [RNG.normal(size=(2, Q)).astype(np.float32) for _ in range(2)],
    "share": RNG.random(2).astype(np.float32),
}
losses, of_boards = jax.jit(panel_losses), jax.jit(board_losses)


def batch(panels, counts, share=(0.9, 0.2)):
    parts = {name: np.zeros(0) for name in LayoutBatch._fields[:7]}
    return LayoutBatch(
        **parts,
        panels=panels,
        panel_counts=np.array(counts, np.int32),
        panel_share=np.array(share, np.float32),
    )


def panels():
    lower = RNG.random((2, N, 3)) - 0.5
    return np.concatenate([lower, lower + 0.02 + RNG.random((2, N, 3))], -1).astype(np.float32)


def values(*args):
    return {name: float(value) for name, value in losses(OUT, batch(*args)).items()}


def test_the_order_of_panels_and_what_lies_beyond_them_do_not_matter():
    table = panels()
    first = values(table, [4, 2])
    turned = table.copy()
    turned[0], turned[1, :2] = table[0, [2, 0, 3, 1]], table[1, [1, 0]]
    turned[1, 2:] = 99
    assert values(turned, [4, 2]) == pytest.approx(first, rel=1e-5)
    more = np.concatenate([table, np.full((2, 2, 6), 7, np.float32)], 1)
    assert values(more, [4, 2]) == pytest.approx(first, rel=1e-5)


def test_objects_whose_panels_are_not_known_pay_nothing():
    table = panels()
    gradient_of = jax.jit(jax.grad(lambda out, batch: panel_losses(out, batch)["panels"]))
    gradient = gradient_of(OUT, batch(table, [-1, 3]))
    for leaf in jax.tree.leaves(gradient):
        assert not np.asarray(leaf)[0].any()
    none = gradient_of(OUT, batch(table, [0, 3]))
    assert np.asarray(none["exists"][1])[0].all()  # that there are none is known


def perfect(table):
    rows, sure = np.zeros((2, Q, 6), np.float32), np.full((2, Q), -20, np.float32)
    rows[0, :4], sure[0, :4] = table[0], 20
    rows[1, 2:4], sure[1, 2:4] = table[1, :2], 20
    return rows, sure


def test_a_perfect_answer_costs_next_to_nothing():
    table = panels()
    rows, sure = perfect(table)
    out = {"rows": [rows] * 2, "exists": [sure] * 2, "share": np.float32([0.9, 0.2])}
    found = losses(out, batch(table, [4, 2]))
    assert float(found["panels"]) < 1e-5 and float(found["panels_row"]) < 1e-6


def test_where_a_board_lies_costs_more_than_where_it_ends():
    table = panels()
    table[0, 0] = [-0.4, -0.4, 0.1, 0.4, 0.4, 0.12]
    rows, sure = perfect(table)

    def cost(column):
        moved = rows.copy()
        moved[0, 0, column] += 0.02
        out = {"rows": [moved], "exists": [sure], "share": np.float32([0.9, 0.2])}
        return float(losses(out, batch(table, [4, 2]))["panels"])

    assert cost(2) == pytest.approx(cost(5), rel=1e-3) and cost(2) > 5 * cost(0) > 0


def test_a_batch_without_panels_is_refused():
    with pytest.raises(ValueError, match="the batch has no panels"):
        panel_losses(OUT, batch(panels(), [1, 1])._replace(panels=None))


def test_boards_are_those_of_the_query_that_a_part_was_matched_to():
    """Parts 0 and 1 of both objects, by queries 2 and 0 of three; what other queries say, and
    parts whose boards are not known, cost nothing."""
    table = np.stack([panels()[:, :3], panels()[:, :3]], 1)  # [2, parts, 3, 6]
    counts, share = np.int32([[3, 2], [1, -1]]), np.float32([[0.9, 0.85], [1.0, 0.0]])
    query = np.int32([[2, 0], [2, 0]])
    true = batch(panels(), [0, 0])._replace(boards=table, board_counts=counts, board_share=share)
    rows, sure = np.zeros((2, 3, 4, 6), np.float32), np.full((2, 3, 4), -20, np.float32)
    said = np.zeros((2, 3), np.float32)
    for part, q in enumerate((2, 0)):
        for item in range(2):
            here = max(counts[item, part], 0)
            rows[item, q, :here], sure[item, q, :here] = table[item, part, :here], 20
            said[item, q] = share[item, part]

    def cost(rows, sure, said):
        out = {"rows": [rows] * 2, "exists": [sure] * 2, "share": said}
        return float(of_boards(out, true, query)["boards"])

    assert cost(rows, sure, said) < 1e-5
    other = [x.copy() for x in (rows, sure, said)]
    for x in other:
        x[:, 1], x[1, 0] = 0.4, 0.4  # a query of no part, and the part that is not known
    assert cost(*other) < 1e-5
    for item, q in ((0, 0), (0, 2), (1, 2)):
        for k in range(3):
            wrong = [x.copy() for x in (rows, sure, said)]
            wrong[k][item, q] = wrong[k][item, q] * -0.5 + 0.1
            assert cost(*wrong) > 1e-3
    with pytest.raises(ValueError, match="the batch has no boards"):
        board_losses({}, true._replace(boards=None), query)


def test_boards_that_are_little_of_a_part_pay_for_the_share():
    table = panels()[:, None]
    true = batch(panels(), [0, 0])._replace(
        boards=table,
        board_counts=np.int32([[4], [4]]),
        board_share=np.float32([[0.3], [0.9]]),
    )
    out = jax.tree.map(lambda x: x[:, None], OUT)
    query = np.zeros((2, 1), np.int32)
    gradient = jax.jit(jax.grad(lambda out: board_losses(out, true, query)["boards"]))(out)
    assert not np.asarray(gradient["rows"][1])[0].any()
    assert not np.asarray(gradient["exists"][1])[0].any()
    assert np.asarray(gradient["rows"][1])[1].any() and np.asarray(gradient["share"]).all()


def test_terms_of_boards_are_means_over_those_that_count():
    """Of three parts one is no set of boards and one is not known; without any all is 0."""
    table = np.stack([panels()[0]] * 3)[None]
    counts, share = np.int32([[4, 4, -1]]), np.float32([[0.9, 0.2, 0.0]])
    true = batch(panels(), [0, 0])._replace(boards=table, board_counts=counts, board_share=share)
    out = {
        "rows": [table + np.float32(0.1)],
        "exists": [np.full((1, 3, 4), 20, np.float32)],
        "share": np.float32([[0.9, 0.6, 0.5]]),
    }
    query = np.arange(3, dtype=np.int32)[None]
    found = of_boards(out, true, query)
    size = table[0, 0, :, 3:] - table[0, 0, :, :3]
    weight = 0.15 / (size + 0.05) + 0.5
    assert float(found["boards_row"]) == pytest.approx(0.1, rel=1e-4)
    assert float(found["boards"]) == pytest.approx(5 * 0.1 * weight.mean() + 0.3 * 0.2, rel=1e-3)
    none = of_boards(out, true._replace(board_counts=np.full_like(counts, -1)), query)
    assert {name: float(value) for name, value in none.items()} == {"boards": 0, "boards_row": 0}

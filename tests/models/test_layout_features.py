"""What cells see of a layout: order and padding of its table do not matter, depths are those of the
boxes."""

import itertools

import jax
import numpy as np
from drawn import parameters
from toy import flow_table

from uniart_jax.models.layout_features import LayoutFeatures, candidates, child_depth
from uniart_jax.models.network import Network
from uniart_jax.voxels.part_table import PartTable

R = 8
COORDS = np.random.default_rng(1).integers(0, R, (2, 30, 3)).astype(np.int32)
NETWORK = Network("features", None, lambda rngs: LayoutFeatures(4, rngs))
PARAMS = parameters(NETWORK)
run = jax.jit(lambda table, coords: NETWORK.apply(PARAMS, table, coords, R))


def test_order_and_padding_of_the_table_do_not_matter():
    table = flow_table()
    whole = run(table, COORDS)
    assert whole.shape == (2, 30, 64 + 14 + 64 + 2 * 64) and np.isfinite(whole).all()
    order = np.array([[3, 1, 0, 2, 4], [2, 0, 1, 3, 4]])
    place = np.argsort(order, 1)
    rows = [
        np.take_along_axis(np.asarray(a), order[..., None], 1)
        for a in (table.boxes, table.codes, table.colors)
    ]
    parents = np.take_along_axis(place, np.take_along_axis(np.asarray(table.parents), order, 1), 1)
    mixed = PartTable(rows[0], rows[1], parents, rows[2], table.counts)
    np.testing.assert_allclose(run(mixed, COORDS), whole, atol=1e-5)
    beyond = np.arange(5) >= np.asarray(table.counts)[:, None]
    other = [np.where(beyond[..., None], 7.0, a) for a in (table.boxes, table.codes, table.colors)]
    parents = np.where(beyond, 2, table.parents)
    filled = PartTable(other[0], other[1], parents, other[2], table.counts)
    np.testing.assert_allclose(run(filled, COORDS), whole, atol=1e-5)


def test_without_a_layout_every_cell_sees_the_same():
    empty = run(flow_table()._replace(counts=np.zeros(2, np.int32)), COORDS)
    empty = np.asarray(empty)
    assert np.isfinite(empty).all() and np.ptp(empty, axis=(0, 1)).max() < 1e-6


def test_candidates_are_the_smallest_box_that_holds_a_place_then_the_nearest():
    boxes = np.zeros((1, 5, 6), np.float32)
    boxes[0, 0] = [0, 0, 0, 0.8, 0.8, 0.8]
    boxes[0, 1] = [0, 0, 0, 0.2, 0.2, 0.2]
    boxes[0, 2] = [0.45, 0, 0, 0.06, 0.1, 0.1]
    table = PartTable(
        boxes, np.zeros((1, 5, 9)), np.zeros((1, 5), int), np.zeros((1, 5, 3)), np.array([3])
    )
    lower, upper = boxes[..., :3] - boxes[..., 3:] / 2, boxes[..., :3] + boxes[..., 3:] / 2
    at = np.array([[[0.01, 0.0, 0.0], [0.3, 0.0, 0.0], [0.45, 0.0, 0.01], [0.41, 0.3, 0.0]]])
    picks = np.asarray(jax.jit(candidates, static_argnums=4)(table, lower, upper, at, R))
    order = np.where(picks.sum(-1) > 0, picks.argmax(-1), -1)[0]
    assert order.tolist() == [[1, 0, 2, -1], [0, 2, 1, -1], [2, 0, 1, -1], [0, 2, 1, -1]]


def test_depth_of_children_is_that_of_the_box():
    rng = np.random.default_rng(0)
    centre, size = rng.uniform(-0.3, 0.3, 3), rng.uniform(0.2, 0.6, 3)
    coords = rng.integers(0, R, (12, 3))
    at = (coords + 0.5) / R - 0.5
    low, high = (at - (centre - size / 2)) * R, ((centre + size / 2) - at) * R
    found = np.asarray(jax.jit(child_depth, static_argnums=2)(low, high, 4))
    for row, cell in zip(found, coords, strict=True):
        for value, child in zip(row, itertools.product(range(4), repeat=3), strict=True):
            place = (cell * 4 + np.array(child) + 0.5) / (4 * R) - 0.5
            depth = (size / 2 - np.abs(place - centre)).min() * 4 * R
            np.testing.assert_allclose(value, np.clip(depth / 3, -1, 1), atol=1e-4)

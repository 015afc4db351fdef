"""Clustering of boxes into parts: exact on true codes, steady on noisy ones."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from solids import box_of, box_sdf, grid_of

from uniart_jax.voxels.grid import PartGrid, connected, subcell_indices
from uniart_jax.voxels.joint_code import box_corners
from uniart_jax.voxels.segment import CRUMB, _absorb_crumbs, nearest, segment


def make_cabinet(resolution=16) -> PartGrid:
    """A body, two doors and a small knob."""
    solids = [
        ((-0.3, -0.5, -0.5), (0.4, 0.5, 0.5)),
        ((-0.4, -0.5, -0.5), (-0.3, 0.0, 0.5)),
        ((-0.4, 0.0, -0.5), (-0.3, 0.5, 0.5)),
        ((-0.5, 0.1, -0.05), (-0.4, 0.2, 0.05)),
    ]
    distances = [lambda p, s=s: box_sdf(p, *s) for s in solids]
    return grid_of(
        distances, [box_of(*s) for s in solids], parents=[0, 0, 0, 2], resolution=resolution
    )


def matched(grid: PartGrid, found) -> np.ndarray:
    """[K] the true part of each part found."""
    distance = np.abs(box_corners(found.boxes)[:, None] - box_corners(grid.boxes)[None]).max(-1)
    return distance.argmin(1)


def test_true_codes_are_segmented_exactly():
    grid = make_cabinet()
    found = segment(grid.gather())
    assert len(found.boxes) == 4
    match = matched(grid, found)
    assert sorted(match) == [0, 1, 2, 3] and match[0] == 0  # largest first
    assert np.array_equal(match[found.owner], grid.owner)
    assert np.allclose(found.boxes, grid.boxes[match], atol=1e-6)
    assert np.array_equal(found.pure, (grid.owner == grid.owner[:, :1]).all(1))


@settings(max_examples=15)
@given(st.integers(2, 64), st.integers(0, 10**6))
def test_one_sub_cell_is_enough_on_true_codes(count, seed):
    rng = np.random.default_rng(seed)
    boxes = np.concatenate(
        [rng.uniform(-0.4, 0.4, (count, 3)), rng.uniform(0.02, 0.2, (count, 3))], 1
    )
    corners = box_corners(boxes)
    distance = np.abs(corners[:, None] - corners[None]).max(-1) + np.eye(count)
    if distance.min() < 0.011:
        return
    grid = make_cabinet(8)
    owner = np.zeros(grid.owner.shape, int)
    owner.flat[rng.choice(owner.size, count, replace=False)] = np.arange(count)
    votes = dataclasses.replace(grid.gather(), own_box=boxes[owner].astype(np.float32))
    found = segment(votes)
    assert len(found.boxes) == count


@pytest.mark.parametrize("seed", range(4))
def test_network_like_votes_give_the_same_parts(seed):
    """Bias per part, noise per voxel and sub-cell, and border voxels whose boxes lie between their
    parts'."""
    rng = np.random.default_rng(seed)
    grid = make_cabinet()
    true = grid.boxes[grid.owner].astype(float)
    mixed = (grid.owner != grid.owner[:, :1]).any(1)
    blend = np.where(mixed, rng.uniform(0.2, 0.8, len(true)), 0)[:, None, None]
    votes = true + blend * (true.mean(1, keepdims=True) - true)
    votes += rng.normal(0, 0.01, grid.boxes.shape)[grid.owner]
    votes += rng.normal(0, 0.01, (len(true), 1, 6)) + rng.normal(0, 0.003, true.shape)
    found = segment(dataclasses.replace(grid.gather(), own_box=votes.astype(np.float32)))
    match = matched(grid, found)
    assert sorted(match) == [0, 1, 2, 3]
    assert np.abs(found.boxes - grid.boxes[match]).max() < 0.04
    assert (match[found.owner] == grid.owner).mean() > 0.97


def test_voxels_on_a_border_do_not_vote():
    """All border voxels say the same wrong thing, half way between their parts: many, dense, and no
    part."""
    rng = np.random.default_rng(0)
    grid = make_cabinet()
    true = grid.boxes[grid.owner].astype(float)
    votes = true + 0.5 * (true.mean(1, keepdims=True) - true)
    votes += rng.normal(0, 0.003, (len(true), 1, 6)) + rng.normal(0, 0.001, true.shape)
    found = segment(dataclasses.replace(grid.gather(), own_box=votes.astype(np.float32)))
    assert sorted(matched(grid, found)) == [0, 1, 2, 3]


@pytest.mark.parametrize("noise", [0.001, 0.01, 0.03])
def test_one_noisy_part_stays_one(noise):
    rng = np.random.default_rng(0)
    low, high = (-0.5, -0.3, -0.3), (0.5, 0.3, 0.3)
    grid = grid_of([lambda p: box_sdf(p, low, high)], [box_of(low, high)], resolution=16).gather()
    votes = grid.own_box + rng.normal(0, noise, (len(grid.coords), 1, 6)).astype(np.float32)
    votes = votes + rng.normal(0, 1e-3, grid.own_box.shape).astype(np.float32)
    found = segment(dataclasses.replace(grid, own_box=votes))
    assert len(found.boxes) == 1 and not found.owner.any() and found.pure.all()


def make_drawers(number: int = 3) -> PartGrid:
    """A body with drawers in front, one above the other."""
    high = 1 / number
    solids = [((-0.3, -0.4, -0.5), (0.4, 0.4, 0.5))]
    solids += [
        ((-0.4, -0.4, k * high - 0.49), (-0.3, 0.4, (k + 1) * high - 0.51)) for k in range(number)
    ]
    distances = [lambda p, s=s: box_sdf(p, *s) for s in solids]
    boxes = [box_of(*s) for s in solids]
    return grid_of(distances, boxes, parents=[0] * (number + 1), resolution=32)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.003, 0.02])
def test_low_drawers_stay_apart_where_votes_are_good(noise):
    """Neighbours' boxes differ by little in two of six corners; under votes as wrong as a flow's
    they would be one."""
    rng = np.random.default_rng(0)
    grid = make_drawers(7)
    votes = grid.boxes[grid.owner] + rng.normal(0, noise, (len(grid.coords), 1, 6))
    votes += rng.normal(0, 0.001, votes.shape)
    found = segment(dataclasses.replace(grid.gather(), own_box=votes.astype(np.float32)))
    match = matched(grid, found)
    assert sorted(match) == list(range(8))
    assert (match[found.owner] == grid.owner).mean() > 0.95


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_votes_that_are_wrong_together_give_the_same_parts(seed):
    """As out of a flow: each cube of 4^3 voxels is off by its own error, and drifts towards what
    its neighbours say."""
    rng = np.random.default_rng(seed)
    grid = make_drawers()
    true = box_corners(grid.boxes[grid.owner].astype(float))
    cube = np.ravel_multi_index(tuple((grid.coords // 4).T), (8, 8, 8))
    member = cube[:, None] == np.arange(512)
    mean = (member.T @ true.mean(1)) / np.maximum(member.sum(0), 1)[:, None]
    votes = true + 0.2 * (mean[cube][:, None] - true)
    votes += rng.normal(0, 0.04, (512, len(grid.boxes), 6))[cube[:, None], grid.owner]
    votes += rng.normal(0, 0.01, (len(true), 1, 6))
    low, high = votes[..., :3], votes[..., 3:]
    boxes = np.concatenate([(low + high) / 2, high - low], -1).astype(np.float32)
    found = segment(dataclasses.replace(grid.gather(), own_box=boxes))
    match = matched(grid, found)
    assert sorted(match) == [0, 1, 2, 3]
    assert (match[found.owner] == grid.owner).mean() > 0.9


def test_crumbs_join_what_is_around_them():
    """Some voxels of the body vote for the door before them and lie within its box: no piece of the
    door flies about, and a large one stays."""
    grid = make_cabinet()
    owner = grid.owner.astype(int).reshape(-1).copy()
    before = owner.copy()
    r3 = grid.subdivisions**3
    inner = np.nonzero((grid.owner == 0).all(1) & (grid.coords[:, 0] > 10))[0]
    (crumb,) = inner[:1]
    owner[crumb * r3 : crumb * r3 + CRUMB // 2] = 1
    column = np.nonzero((grid.coords[:, 0] > 12) & (grid.coords[:, 1] < 4))[0]
    owner.reshape(-1, r3)[column] = 1  # large and apart from the door
    found = _absorb_crumbs(grid.gather(), owner)
    assert (found[crumb * r3 : (crumb + 1) * r3] == before[crumb * r3 : (crumb + 1) * r3]).all()
    assert (found.reshape(-1, r3)[column] == 1).all()


def test_crumbs_are_absorbed_when_a_grid_is_segmented():
    rng = np.random.default_rng(0)
    grid = make_cabinet()
    votes = grid.boxes[grid.owner] + rng.normal(0, 2e-3, (*grid.owner.shape, 6))
    (edge,) = np.nonzero((grid.owner == 1).all(1) & (grid.coords == [1, 7, 8]).all(1))[0]
    away = subcell_indices(np.zeros((1, 3), int), grid.subdivisions)[0, :, 1] == 0
    votes[edge, away] = grid.boxes[2]  # of the left door, these say that they are of the right one
    found = segment(dataclasses.replace(grid.gather(), own_box=votes.astype(np.float32)))
    match = matched(grid, found)
    for k in range(len(found.boxes)):
        pieces = connected(dense_owner(grid, found.owner) == k)
        assert np.bincount(pieces.ravel())[1:].min() > CRUMB // 2, (k, match[k])


def dense_owner(grid: PartGrid, owner: np.ndarray) -> np.ndarray:
    """[n, n, n] owner of every sub-cell, -1 where no voxel is active."""
    side = grid.resolution * grid.subdivisions
    dense = np.full((side,) * 3, -1)
    dense[tuple(subcell_indices(grid.coords, grid.subdivisions).reshape(-1, 3).T)] = owner.ravel()
    return dense


def test_nearest_prefers_the_first_of_equals():
    centers = np.array([[0.0] * 6, [1.0] * 6])
    assert nearest(np.array([[0.5] * 6, [0.6] * 6], np.float32), centers).tolist() == [0, 1]


def test_nearest_minds_the_place():
    """Between two drawers' boxes, the one that the place lies in."""
    boxes = np.array([[0, 0, 0, 1, 1, 0.5], [0, 0, 0.5, 1, 1, 1]])
    votes = np.repeat(boxes.mean(0, keepdims=True), 2, axis=0).astype(np.float32)
    places = np.array([[0.5, 0.5, 0.2], [0.5, 0.5, 0.8]], np.float32)
    assert nearest(votes, boxes, places).tolist() == [0, 1]


def test_knobs_beside_each_other_stay_two():
    """Knobs smaller than a voxel, in border voxels only, whose votes are further off than the knobs
    are apart."""
    rng = np.random.default_rng(0)
    solids = [
        ((-0.4, -0.5, -0.5), (0.4, 0.5, 0.5)),
        ((-0.46, -0.10, -0.03), (-0.4, -0.04, 0.03)),
        ((-0.46, -0.01, -0.03), (-0.4, 0.05, 0.03)),
    ]
    distances = [lambda p, s=s: box_sdf(p, *s) for s in solids]
    grid = grid_of(distances, [box_of(*s) for s in solids], parents=[0, 0, 0], resolution=32)
    true = grid.boxes[grid.owner].astype(float)
    knob = grid.owner > 0
    true[knob] += 0.12 * (grid.boxes[0] - true[knob])  # bent towards the body
    votes = true + rng.normal(0, 0.02, true.shape)
    found = segment(dataclasses.replace(grid.gather(), own_box=votes.astype(np.float32)))
    match = matched(grid, found)
    assert sorted(match) == [0, 1, 2]
    solid_knobs = knob & (grid.sdf < 0)
    assert (match[found.owner] == grid.owner)[solid_knobs].mean() > 0.95
    assert np.abs(found.boxes - grid.boxes[match]).max() < 0.06


def test_a_knob_within_a_ring_handle_keeps_its_cells():
    """Both small, one inside the other's box: place alone cannot tell them apart, votes can."""
    rng = np.random.default_rng(0)
    body, knob = (
        ((-0.3, -0.5, -0.5), (0.5, 0.5, 0.5)),
        ((-0.33, -0.012, -0.012), (-0.3, 0.012, 0.012)),
    )
    out, wide = 0.064, 0.012
    ring = [
        ((-0.33, -out, s * out - wide / 2), (-0.3, out, s * out + wide / 2)) for s in (-1, 1)
    ] + [((-0.33, s * out - wide / 2, -out), (-0.3, s * out + wide / 2, out)) for s in (-1, 1)]
    distances = [
        lambda p: box_sdf(p, *body),
        lambda p: np.min([box_sdf(p, *bar) for bar in ring], axis=0),
        lambda p: box_sdf(p, *knob),
    ]
    span = out + wide / 2
    boxes = [box_of(*body), box_of((-0.33, -span, -span), (-0.3, span, span)), box_of(*knob)]
    grid = grid_of(distances, boxes, parents=[0, 0, 0], resolution=32)
    votes = grid.boxes[grid.owner] + rng.normal(0, 0.01, (*grid.owner.shape, 6))
    found = segment(dataclasses.replace(grid.gather(), own_box=votes.astype(np.float32)))
    match = matched(grid, found)
    assert sorted(match) == [0, 1, 2]
    for k in (1, 2):
        solid = (grid.owner == k) & (grid.sdf < 0)
        assert (match[found.owner] == k)[solid].mean() > 0.95

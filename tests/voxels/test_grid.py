import dataclasses

import numpy as np

from uniart_jax.voxels.grid import (
    SDF_CLIP,
    PartGrid,
    VoxelGrid,
    connected,
    occupancy,
    smoothed,
    subcell_centers,
    subcell_indices,
    subcell_offsets,
)


def test_subcells_are_x_major_with_z_fastest():
    offsets = subcell_offsets(2)
    np.testing.assert_allclose(offsets[1] - offsets[0], [0, 0, 0.5])
    np.testing.assert_allclose(offsets[4] - offsets[0], [0.5, 0, 0])
    np.testing.assert_allclose(offsets.mean(0), 0.5)


def test_subcell_centers_fill_their_voxel():
    centers = subcell_centers(np.array([[0, 3, 1]]), resolution=4, subdivisions=3)[0]
    low = np.array([0, 3, 1]) / 4 - 0.5
    np.testing.assert_allclose(centers.min(0), low + 1 / 24)
    np.testing.assert_allclose(centers.max(0), low + 1 / 4 - 1 / 24)


def test_occupancy_is_true_at_the_voxels_only():
    coords = np.array([[0, 1, 2], [3, 3, 3]])
    dense = occupancy(coords, 4)
    np.testing.assert_array_equal(np.argwhere(dense), coords)


def test_gather_turns_ids_into_attributes():
    boxes = np.arange(12, dtype=np.float32).reshape(2, 6)
    codes = np.arange(18, dtype=np.float32).reshape(2, 9)
    grid = PartGrid(
        resolution=4,
        subdivisions=1,
        coords=np.array([[0, 0, 0], [1, 0, 0]], np.int32),
        sdf=np.zeros((2, 1), np.float32),
        color=np.zeros((2, 1, 3), np.float32),
        owner=np.array([[1], [0]], np.uint8),
        voxel_part=np.array([1, 0], np.uint8),
        boxes=boxes,
        codes=codes,
        parents=np.array([0, 0], np.int32),
    ).gather()
    np.testing.assert_array_equal(grid.own_box[:, 0], boxes[[1, 0]])
    np.testing.assert_array_equal(grid.joint_code, codes[[1, 0]])
    np.testing.assert_array_equal(grid.parent_box, boxes[[0, 0]])


def test_fairing_averages_active_sub_cells_only_and_thickens():
    rng = np.random.default_rng(0)
    coords = np.argwhere(rng.random((4, 4, 4)) < 0.5).astype(np.int32)
    number = len(coords)
    rest = (np.zeros((number, 8, 3)), np.zeros((number, 8, 6)), np.zeros((number, 9)))
    flat = VoxelGrid(
        4, 2, coords, np.full((number, 8), 0.7, np.float32), *rest, np.zeros((number, 6))
    )
    assert smoothed(flat, 0.0, 0.0) is flat
    empty = dataclasses.replace(flat, coords=flat.coords[:0], sdf=flat.sdf[:0])
    assert not len(smoothed(empty, 0.3, 0.5, 2.0).coords)
    # holes beside active voxels weigh nothing: a constant stays one
    np.testing.assert_allclose(smoothed(flat, 0.2, 1.0).sdf, 0.5, atol=1e-5)
    unknown = flat.sdf.copy()
    unknown[1, 3] = np.nan  # stays the only one, and weighs nothing
    found = smoothed(VoxelGrid(4, 2, coords, unknown, *rest, np.zeros((number, 6))), 0.2, 1.0).sdf
    assert np.isnan(found[1, 3]) and np.isnan(found).sum() == 1
    np.testing.assert_allclose(found[np.isfinite(found)], 0.5, atol=1e-5)
    noise = rng.normal(0, 0.5, flat.sdf.shape).astype(np.float32)
    rough = VoxelGrid(4, 2, coords, flat.sdf + noise, *rest, np.zeros((number, 6)))
    assert smoothed(rough, 0.0, 1.0).sdf.std() < 0.5 * rough.sdf.std()
    assert np.abs(smoothed(rough, 9.0, 0.0).sdf).max() <= SDF_CLIP


def test_smoothing_along_a_panel_makes_it_flat_and_leaves_it_thin():
    """A panel of four sub-cells with ridges, in a net of voxels with a gap."""
    coords = np.array(
        [(x, y, z) for x in (1, 2) for y in range(6) for z in range(6) if (y, z) != (3, 3)]
    )
    centres = subcell_centers(coords, 6, 4)
    ridges = 0.9 * np.sign(np.sin(centres[..., 1] * 70))
    panel = np.clip(np.abs(centres[..., 0] * 24 + 4) - 1.8, -SDF_CLIP, SDF_CLIP)
    cells = panel.shape
    rest = (np.zeros((*cells, 3)), np.zeros((*cells, 6)), np.zeros((len(coords), 9)))
    grid = VoxelGrid(6, 4, coords, panel + ridges, *rest, np.zeros((len(coords), 6)))
    wrong = lambda found: ((found.sdf < 0) != (panel < 0)).mean()  # noqa: E731
    assert wrong(grid) > 0.05
    along = smoothed(grid, 0.0, 0.0, 2.0)
    assert wrong(along) < 0.2 * wrong(grid)
    assert wrong(along) < 0.5 * wrong(smoothed(grid, 0.0, 2.0))
    near = np.abs(panel) < 1.4
    assert np.abs(along.sdf - panel)[near].mean() < 0.35
    np.testing.assert_allclose(
        smoothed(grid, 0.2, 1.0, 1.0).sdf, smoothed(grid, 0.2, 1.0).sdf, atol=1e-5
    )


def test_smoothing_along_surfaces_leaves_a_knob():
    coords = np.array(list(np.ndindex(6, 6, 6)))
    centres = subcell_centers(coords, 6, 4)
    knob = np.clip(np.linalg.norm(centres, axis=-1) * 24 - 2, -SDF_CLIP, SDF_CLIP)
    cells = knob.shape
    rest = (np.zeros((*cells, 3)), np.zeros((*cells, 6)), np.zeros((len(coords), 9)))
    grid = VoxelGrid(6, 4, coords, knob, *rest, np.zeros((len(coords), 6)))
    found = smoothed(grid, 0.0, 0.0, 3.0)
    assert np.abs(found.sdf - knob).max() < 0.76
    assert (found.sdf < 0).any()


def test_smoothing_leaves_a_thin_leg_in_one_piece():
    """A leg two to three sub-cells thick, torn by noise."""
    coords = np.array(list(np.ndindex(3, 3, 6)))
    centres = subcell_centers(coords, 6, 4)
    across = np.abs(centres[..., :2] * 24 + 6).max(-1)
    leg = np.clip(across - 1.2, -SDF_CLIP, SDF_CLIP)
    rough = leg + np.random.default_rng(0).normal(0, 1.2, leg.shape)
    cells = leg.shape
    rest = (np.zeros((*cells, 3)), np.zeros((*cells, 6)), np.zeros((len(coords), 9)))
    grid = VoxelGrid(6, 4, coords, rough, *rest, np.zeros((len(coords), 6)))
    wrong = lambda found: ((found.sdf < 0) != (leg < 0)).mean()  # noqa: E731
    along = smoothed(grid, 0.0, 0.5, 2.0)
    assert wrong(along) < 0.5 * wrong(smoothed(grid, 0.0, 0.5))
    inside = np.zeros((24,) * 3, bool)
    at = tuple(subcell_indices(coords, 4).reshape(-1, 3).T)
    inside[at] = along.sdf.ravel() < 0
    sizes = np.bincount(connected(inside).ravel())[1:]
    assert sizes.max() > 0.95 * sizes.sum()

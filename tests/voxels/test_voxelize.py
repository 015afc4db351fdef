import numpy as np
import pytest
import trimesh
from PIL import Image

from uniart_jax.objects.appearance import srgb_to_linear
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.voxels.grid import SDF_CLIP, subcell_centers
from uniart_jax.voxels.voxelize import voxelize

HALF_DIAGONAL = 3**0.5 / 2


def box(low, high, color=(128, 128, 128)):
    mesh = trimesh.creation.box(bounds=[low, high])
    mesh.visual = trimesh.visual.ColorVisuals(mesh, face_colors=np.tile([*color, 255], (12, 1)))
    return mesh


def one(mesh):
    return ArticulatedObject((Part("it", mesh),))


def centers(grid):
    return subcell_centers(grid.coords, grid.resolution, grid.subdivisions)


def box_sdf(points, low, high):
    middle, half = (np.array(low) + high) / 2, (np.array(high) - low) / 2
    away = np.abs(points - middle) - half
    return np.linalg.norm(np.maximum(away, 0), axis=-1) + np.minimum(away.max(-1), 0)


def clipped(distance, grid):
    return np.clip(distance * grid.resolution * grid.subdivisions, -SDF_CLIP, SDF_CLIP)


@pytest.mark.parametrize(("resolution", "subdivisions"), [(16, 4), (12, 3), (8, 2), (16, 1)])
def test_box_has_the_distance_of_a_box(resolution, subdivisions):
    low, high = [-0.5, -0.31, -0.22], [0.5, 0.31, 0.22]
    grid = voxelize(one(box(low, high)), resolution, subdivisions)
    np.testing.assert_allclose(
        grid.sdf, clipped(box_sdf(centers(grid), low, high), grid), atol=1e-4
    )
    assert (grid.owner == 0).all() and (grid.voxel_part == 0).all()


def test_sphere_has_the_distance_of_a_sphere():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.5)
    grid = voxelize(one(ball).normalized(), 16, 4)
    distance = clipped(np.linalg.norm(centers(grid), axis=-1) - 0.5, grid)
    # a chord of an icosphere of 5120 faces stays within .0006 of the sphere
    assert np.abs(grid.sdf - distance).max() < 0.0015 * 64


def test_active_voxels_are_those_the_surface_touches():
    grid = voxelize(one(box([-0.5, -0.3, -0.3], [0.5, 0.3, 0.3])), 10, 2)
    index = np.indices((10, 10, 10)).reshape(3, -1).T
    low, high = index / 10 - 0.5, (index + 1) / 10 - 0.5
    eps = 1e-7
    box_low, box_high = np.array([-0.5, -0.3, -0.3]), np.array([0.5, 0.3, 0.3])
    touches = ((low <= box_high + eps) & (high >= box_low - eps)).all(1)
    buried = ((low > box_low + eps) & (high < box_high - eps)).all(1)
    np.testing.assert_array_equal(grid.coords, index[touches & ~buried])


def test_coords_are_sorted_unique_and_typed():
    grid = voxelize(one(trimesh.creation.torus(0.35, 0.1, 16, 8)).normalized(), 16, 4)
    np.testing.assert_array_equal(grid.coords, np.unique(grid.coords, axis=0))
    assert grid.coords.dtype == np.int32 and grid.sdf.dtype == grid.color.dtype == np.float32
    assert grid.owner.dtype == grid.voxel_part.dtype == np.uint8
    assert grid.boxes.dtype == grid.codes.dtype == np.float32 and grid.parents.dtype == np.int32
    assert np.abs(grid.sdf).max() <= SDF_CLIP


def test_hollow_box_is_hollow():
    outer, inner = box([-0.5] * 3, [0.5] * 3), box([-0.25] * 3, [0.25] * 3)
    inner.invert()
    grid = voxelize(one(trimesh.util.concatenate([outer, inner])), 16, 4)
    p = centers(grid)
    distance = np.maximum(box_sdf(p, [-0.5] * 3, [0.5] * 3), -box_sdf(p, [-0.25] * 3, [0.25] * 3))
    np.testing.assert_allclose(grid.sdf, clipped(distance, grid), atol=1e-4)
    assert (grid.sdf[(np.abs(p) < 0.25).all(-1)] > 0).all()


@pytest.mark.parametrize("tilt", [0.0, 0.35])
def test_open_sheet_is_a_thin_solid(tilt):
    corners = np.array([[-0.4, -0.4, 0], [0.4, -0.4, 0], [0.4, 0.4, 0], [-0.4, 0.4, 0]])
    turn = trimesh.transformations.rotation_matrix(tilt, [0.3, 1, 0])[:3, :3]
    sheet = trimesh.Trimesh(corners @ turn.T, [[0, 1, 2], [0, 2, 3]])
    grid = voxelize(one(sheet), 16, 4)
    p = centers(grid) @ turn
    away = np.concatenate([np.maximum(np.abs(p[..., :2]) - 0.4, 0), np.abs(p[..., 2:])], -1)
    distance = np.linalg.norm(away, axis=-1) * 64 - HALF_DIAGONAL
    np.testing.assert_allclose(grid.sdf, np.minimum(distance, SDF_CLIP), atol=1e-3)
    # it does not leak: no two neighbouring outside samples on opposite sides of the sheet
    dense = np.full((64,) * 3, np.nan)
    cells = np.round((centers(grid) + 0.5) * 64 - 0.5).astype(int).reshape(-1, 3)
    dense[tuple(cells.T)] = np.where(grid.sdf < 0, np.nan, np.sign(p[..., 2])).ravel()
    within = np.zeros((64,) * 3, bool)
    within[tuple(cells.T)] = (np.abs(p[..., :2]) < 0.38).all(-1).ravel()
    for axis in range(3):
        a, b = np.moveaxis(dense, axis, 0)[:-1], np.moveaxis(dense, axis, 0)[1:]
        inner = np.moveaxis(within, axis, 0)
        assert not ((a * b < 0) & inner[:-1] & inner[1:]).any()


@pytest.mark.parametrize(("cells", "thin"), [(0.8, True), (1.6, True), (1.9, False), (4.0, False)])
def test_plates_thinner_than_the_diagonal_are_thickened(cells, thin):
    half = cells / 2 / 64
    low, high = [-0.5, -0.4, 0.003 - half], [0.5, 0.4, 0.003 + half]
    grid = voxelize(one(box(low, high)), 16, 4)
    distance = box_sdf(centers(grid), low, high) * 64
    expected = np.minimum(distance, np.abs(distance) - HALF_DIAGONAL) if thin else distance
    np.testing.assert_allclose(grid.sdf, np.clip(expected, -SDF_CLIP, SDF_CLIP), atol=1e-3)


def pair(joint=None):
    left = box([-0.5, -0.4, -0.4], [0.0, 0.4, 0.4], (255, 0, 0))
    right = box([0.0, -0.4, -0.4], [0.5, 0.4, 0.4], (0, 0, 255))
    joint = joint or Joint([0, 0, 0], [0, 0, 1], angle=(0, 1))
    return ArticulatedObject((Part("left", left), Part("right", right, 0, joint)))


def test_touching_boxes_share_the_space_between_them():
    grid = voxelize(pair(), 16, 4)
    x = centers(grid)[..., 0]
    np.testing.assert_array_equal(grid.owner, (x > 0).astype(int))
    voxel_x = (grid.coords[:, 0] + 0.5) / 16 - 0.5
    np.testing.assert_array_equal(
        grid.voxel_part[np.abs(voxel_x) > 1 / 16], (voxel_x > 0)[np.abs(voxel_x) > 1 / 16]
    )
    np.testing.assert_allclose(
        grid.color[grid.owner == 1], np.broadcast_to([0, 0, 1], (np.sum(grid.owner == 1), 3))
    )
    np.testing.assert_array_equal(grid.parents, [0, 0])
    np.testing.assert_allclose(grid.boxes[1], [0.25, 0, 0, 0.5, 0.8, 0.8])
    assert (grid.codes[0] == 0).all() and (grid.codes[1] != 0).any()


def test_sdf_of_overlapping_parts_is_the_smallest():
    parts = (([-0.5, -0.4, -0.4], [0.2, 0.4, 0.4]), ([-0.1, -0.3, -0.5], [0.5, 0.3, 0.1]))
    obj = ArticulatedObject(tuple(Part(str(k), box(*b), k - 1) for k, b in enumerate(parts)))
    grid = voxelize(obj, 16, 4)
    each = np.stack([box_sdf(centers(grid), *b) for b in parts]) * 64
    np.testing.assert_allclose(grid.sdf, np.clip(each.min(0), -3, 3), atol=1e-4)
    clear = np.abs(each[0] - each[1]) > 1e-3
    np.testing.assert_array_equal(grid.owner[clear], each.argmin(0)[clear])


def test_a_thin_part_before_a_thick_one_wins_where_its_shell_reaches():
    block = ([-0.5, -0.4, -0.4], [0.3, 0.4, 0.4])
    gap = 2.2 / 64
    corners = np.array([[0, -0.4, -0.4], [0, 0.4, -0.4], [0, 0.4, 0.4], [0, -0.4, 0.4]]) + np.eye(
        3
    )[0] * (0.3 + gap)
    sheet = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]])
    grid = voxelize(ArticulatedObject((Part("a", box(*block)), Part("b", sheet, 0))), 16, 4)
    p = centers(grid)
    solid = box_sdf(p, *block) * 64
    away = np.concatenate(
        [np.abs(p[..., :1] - 0.3 - gap), np.maximum(np.abs(p[..., 1:]) - 0.4, 0)], -1
    )
    shell = np.linalg.norm(away, axis=-1) * 64 - HALF_DIAGONAL
    np.testing.assert_allclose(grid.sdf, np.clip(np.minimum(solid, shell), -3, 3), atol=1e-3)
    clear = np.abs(solid - shell) > 1e-3
    np.testing.assert_array_equal(grid.owner[clear], (shell < solid)[clear])


def test_color_is_linear_and_follows_the_texture():
    corners = [[0, 0.5, -0.5], [0, -0.5, -0.5], [0, -0.5, 0.5], [0, 0.5, 0.5]]
    image = np.zeros((64, 64, 3), np.uint8)
    image[:, 32:] = (200, 100, 50)
    visual = trimesh.visual.TextureVisuals(
        uv=[[0, 0], [1, 0], [1, 1], [0, 1]],
        material=trimesh.visual.material.SimpleMaterial(image=Image.fromarray(image)),
    )
    sheet = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], visual=visual, process=False)
    grid = voxelize(one(sheet), 8, 4)
    y = centers(grid)[..., 1]
    np.testing.assert_allclose(grid.color[y > 1 / 60], 0, atol=1e-6)
    expected = srgb_to_linear(np.array([200, 100, 50]) / 255)
    painted = grid.color[(y < -1 / 60) & (y > -0.48)]
    np.testing.assert_allclose(painted, np.broadcast_to(expected, painted.shape), atol=1e-4)


def test_a_small_part_gets_the_voxel_where_its_share_is_largest():
    block = box([-0.5, -0.5, -0.5], [0.5, 0.5, 0.0])
    knob = box([-0.02, -0.02, -0.01], [0.01, 0.01, 0.02])
    grid = voxelize(ArticulatedObject((Part("block", block), Part("knob", knob, 0))), 8, 4)
    # most of the knob stands above the block, on the side of smaller x and y
    np.testing.assert_array_equal(grid.coords[grid.voxel_part == 1], [[3, 3, 4]])


def test_two_parts_too_small_for_one_voxel_are_an_error_with_a_name():
    # a fine grid of faces in one voxel outweighs both knobs
    middle = 1 / 16
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.05)
    ball.apply_translation([middle] * 3)
    frame = box([-0.5] * 3, [0.5] * 3)
    knobs = [
        box([middle - 0.01 + s] * 3, [middle - 0.01 + s + 0.002 + s] * 3) for s in (0.0, 0.012)
    ]
    obj = ArticulatedObject(
        (
            Part("body", trimesh.util.concatenate([frame, ball])),
            Part("first", knobs[0], 0),
            Part("second", knobs[1], 0),
        )
    )
    with pytest.raises(ValueError, match="'second' is too small to own a voxel at resolution 8"):
        voxelize(obj, 8, 4)


def test_mirrored_object_is_the_mirrored_grid():
    obj = (
        pair().transformed(trimesh.transformations.rotation_matrix(0.3, [0.2, 1, 0.4])).normalized()
    )
    mirror = np.diag([1.0, -1, 1, 1])
    grid, other = voxelize(obj, 16, 4), voxelize(obj.transformed(mirror), 16, 4)
    flipped = other.coords * [1, -1, 1] + [0, 15, 0]
    order = np.lexsort(flipped.T[::-1])
    np.testing.assert_array_equal(flipped[order], grid.coords)
    sdf = other.sdf[order].reshape(-1, 4, 4, 4)[:, :, ::-1].reshape(-1, 64)
    np.testing.assert_allclose(sdf, grid.sdf, atol=1e-4)


def test_same_input_same_grid():
    first, second = voxelize(pair(), 16, 4), voxelize(pair(), 16, 4)
    for name in ("coords", "sdf", "color", "owner", "voxel_part"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


def test_objects_outside_the_grid_are_refused():
    with pytest.raises(ValueError, match=r"call \.normalized\(\)"):
        voxelize(one(box([0, 0, 0], [1, 1, 1])), 8, 4)

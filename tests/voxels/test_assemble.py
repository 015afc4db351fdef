"""Voxels back to objects: solid is solid, hollow is hollow, contact leaves no gap, and every mesh
is closed whatever comes in."""

import dataclasses

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from solids import box_of, box_sdf, grid_of

from uniart_jax.objects.appearance import linear_to_srgb
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.procedural import generate
from uniart_jax.voxels.assemble import _within_boxes, assemble
from uniart_jax.voxels.grid import VoxelGrid
from uniart_jax.voxels.isosurface import FACE_BUDGET, DenseField, dense_field, part_mesh
from uniart_jax.voxels.joint_code import encode_joint
from uniart_jax.voxels.segment import segment
from uniart_jax.voxels.voxelize import voxelize

CELL = 1 / 32  # of the small grids here


def assert_closed(mesh: trimesh.Trimesh):
    """Every edge has exactly two triangles of opposite sense, also once a reader has merged corners
    that coincide."""
    assert mesh.is_watertight and mesh.is_winding_consistent
    assert trimesh.Trimesh(mesh.vertices, mesh.faces, process=True).is_watertight
    assert mesh.volume > 0


def test_a_solid_block_is_solid():
    low, high = (-0.5, -0.4, -0.37), (0.5, 0.4, 0.37)
    grid = grid_of([lambda p: box_sdf(p, low, high)], [box_of(low, high)]).gather()
    obj = assemble(grid, scale=2.0, name="block")
    assert (len(obj.parts), obj.scale, obj.name, obj.parts[0].name) == (1, 2.0, "block", "base")
    mesh = obj.parts[0].mesh
    assert_closed(mesh)
    assert mesh.body_count == 1  # no inner shell
    assert mesh.volume == pytest.approx(1 * 0.8 * 0.74, rel=0.02)
    assert np.abs(mesh.bounds - [low, high]).max() < CELL / 4


def test_a_sealed_hollow_box_is_hollow():
    low, high = np.array([-0.5, -0.4, -0.4]), np.array([0.5, 0.4, 0.4])
    wall = 0.07

    def hollow(points):
        return np.maximum(box_sdf(points, low, high), -box_sdf(points, low + wall, high - wall))

    mesh = assemble(grid_of([hollow], [box_of(low, high)]).gather()).parts[0].mesh
    assert_closed(mesh)
    assert mesh.body_count == 2  # outer and inner shell
    expected = np.prod(high - low) - np.prod(high - low - 2 * wall)
    assert mesh.volume == pytest.approx(expected, rel=0.06)


@pytest.mark.parametrize("short", [0.001, 0.01, 0.02])
def test_what_no_voxel_shows_is_room_behind_flush_walls_and_solid_below_a_skin(short):
    """Walls end, and a block begins, just short of the next voxels (``short`` of a sub-cell's
    .031): the sub-cells beside those all lie in the wall, or all outside of the block."""
    room = trimesh.creation.box(bounds=np.array([[-1], [1]]) * np.full(3, 3 / 8 + short))
    outer = trimesh.creation.box(bounds=[[-0.5] * 3, [0.5] * 3])
    walls = outer.copy() + trimesh.Trimesh(room.vertices, room.faces[:, ::-1])
    for mesh, voxels, volume in (
        (walls, 8**3 - 6**3, 1 - room.volume),
        (room, 8**3 - 6**3, room.volume),
    ):
        grid = voxelize(ArticulatedObject((Part("it", mesh),)), 8, 4)
        assert len(grid.coords) == voxels  # none beyond the walls, or below the skin
        made = assemble(grid.gather()).parts[0].mesh
        assert_closed(made)
        assert made.volume == pytest.approx(volume, rel=0.06)


@pytest.mark.parametrize("plane", [0.0, 0.01, -0.013, CELL / 2])
def test_parts_in_contact_share_their_face(plane):
    halves = [((-0.5, -0.3, -0.3), (plane, 0.3, 0.3)), ((plane, -0.3, -0.3), (0.5, 0.3, 0.3))]
    boxes = [box_of(*h) for h in halves]
    distances = [lambda p, h=h: box_sdf(p, *h) for h in halves]
    obj = assemble(grid_of(distances, boxes).gather())
    assert len(obj.parts) == 2
    left, right = sorted((p.mesh for p in obj.parts), key=lambda m: m.centroid[0])
    for mesh in (left, right):
        assert_closed(mesh)
        assert mesh.body_count == 1
    assert abs(left.bounds[1, 0] - plane) < CELL and abs(right.bounds[0, 0] - plane) < CELL
    assert (
        -1e-6 <= right.bounds[0, 0] - left.bounds[1, 0] < CELL
    )  # no overlap, no gap wider than a sub-cell


def test_an_inside_that_no_voxel_shows_stays_with_its_owner():
    """Two solid blocks side by side: each fills its own unknown inside."""
    halves = [((-0.5, -0.5, -0.5), (0.0, 0.5, 0.5)), ((0.0, -0.5, -0.5), (0.5, 0.5, 0.5))]
    grid = grid_of(
        [lambda p, h=h: box_sdf(p, *h) for h in halves], [box_of(*h) for h in halves], resolution=16
    )
    field = dense_field(grid.gather(), grid.owner)
    inner = field.source[1:-1, 1:-1, 1:-1] < 0
    assert inner.any()
    assert (field.sdf[1:-1, 1:-1, 1:-1][inner] < 0).all()
    x = np.broadcast_to(np.arange(64)[:, None, None], inner.shape)
    assert np.array_equal(field.owner[1:-1, 1:-1, 1:-1][inner], (x >= 32)[inner].astype(int))
    assert (field.sdf[[0, -1]] > 0).all()  # the layer around


def make_door() -> tuple[VoxelGrid, Joint, np.ndarray]:
    """A body, a red door on it, and a knob that no voxel holds alone."""
    solids = [
        ((-0.3, -0.4, -0.5), (0.4, 0.4, 0.5)),
        ((-0.4, -0.4, -0.5), (-0.3, 0.4, 0.5)),
        ((-0.45, 0.3, 0.0), (-0.4, 0.33, 0.03)),
    ]
    hinge = Joint((-0.35, -0.4, 0), (0, 0, -1), (-1.5, 0))
    turn = Joint((0, 0.315, 0.015), (1, 0, 0), (-np.pi, np.pi))
    boxes = np.array([box_of(*s) for s in solids])
    codes = [np.zeros(9), encode_joint(hinge, boxes[1, :3]), encode_joint(turn, boxes[2, :3])]
    colors = [(0.2, 0.2, 0.2), (0.8, 0.1, 0.1), (0.0, 0.0, 1.0)]
    distances = [lambda p, s=s: box_sdf(p, *s) for s in solids]
    grid = grid_of(distances, boxes, codes=codes, parents=[0, 0, 1], colors=colors)
    return grid, hinge, np.asarray(colors)


def test_tree_joints_names_and_colours_come_back():
    grid, hinge, colors = make_door()
    assert not ((grid.owner == 2).all(1)).any()  # the knob has border voxels only
    obj = assemble(grid.gather())
    assert [p.name for p in obj.parts] == ["base", "link_1", "link_2"]
    assert obj.parents == [-1, 0, 1]
    assert [p.joint.type for p in obj.parts] == ["fixed", "revolute", "continuous"]
    door = obj.parts[1].joint
    assert np.allclose(door.direction, -hinge.direction) and np.allclose(
        door.angle, (0, 1.5), atol=1e-6
    )
    for part, color in zip(obj.parts, colors, strict=True):
        assert_closed(part.mesh)
        seen = np.median(np.asarray(part.mesh.visual.vertex_colors), axis=0)
        assert np.abs(seen[:3] - 255 * linear_to_srgb(color)).max() <= 1


def test_assembling_is_deterministic():
    grid = make_door()[0].gather()
    first, second = assemble(grid), assemble(grid)
    for a, b in zip(first.parts, second.parts, strict=True):
        assert np.array_equal(a.mesh.vertices, b.mesh.vertices) and np.array_equal(
            a.mesh.faces, b.mesh.faces
        )


def test_specks_go_and_pieces_stay():
    mesh = assemble(with_loose_pieces(box_of((-0.5, -0.4, -0.4), (0.5, 0.4, 0.5)))).parts[0].mesh
    assert_closed(mesh)
    assert mesh.body_count == 2


def test_what_lies_beyond_its_parts_box_is_cut_off():
    mesh = assemble(with_loose_pieces(box_of((-0.5, -0.4, -0.4), (0.5, 0.4, 0.1)))).parts[0].mesh
    assert_closed(mesh)
    assert mesh.body_count == 1 and mesh.bounds[1, 2] < 0.1 + 2 * CELL


@pytest.mark.parametrize(("resolution", "subdivisions"), [(8, 4), (16, 2), (32, 1), (16, 4)])
def test_true_distances_are_not_cut(resolution, subdivisions):
    for family in ("oven", "table", "faucet"):  # thin parts among them
        grid = voxelize(generate(family, 5), resolution, subdivisions).gather()
        assert np.array_equal(_within_boxes(grid, segment(grid)), grid.sdf)


def test_a_thin_end_that_few_voxels_show_stays():
    low, high, pole = (-0.3, -0.3, -0.5), (0.3, 0.3, 0.2), ((-0.03, -0.03, 0.2), (0.03, 0.03, 0.5))
    shape = lambda p: np.minimum(box_sdf(p, low, high), box_sdf(p, *pole))  # noqa: E731
    grid = grid_of([shape], [box_of(low, (0.3, 0.3, 0.5))], resolution=32).gather()
    noise = np.random.default_rng(0).normal(0, 0.005, grid.own_box.shape).astype(np.float32)
    obj = assemble(dataclasses.replace(grid, own_box=grid.own_box + noise))
    assert len(obj.parts) == 1 and obj.parts[0].mesh.bounds[1, 2] > 0.48


def test_boxes_that_are_not_finite_cut_nothing():
    low, high = (-0.4, -0.4, -0.4), (0.4, 0.4, 0.4)
    grid = grid_of([lambda p: box_sdf(p, low, high)], [box_of(low, high)]).gather()
    obj = assemble(dataclasses.replace(grid, own_box=np.full_like(grid.own_box, np.nan)))
    assert np.abs(obj.parts[0].mesh.bounds - [low, high]).max() < CELL


def with_loose_pieces(box: list[float]) -> VoxelGrid:
    """A block that ends at z = .1, a stray cell and a solid voxel far above it; all of them say
    they belong to ``box``."""
    low, high = (-0.5, -0.4, -0.4), (0.5, 0.4, 0.1)
    grid = grid_of([lambda p: box_sdf(p, low, high)], [box]).gather()
    coords = np.concatenate([grid.coords, [[1, 1, 7], [6, 6, 7]]]).astype(np.int32)
    order = np.lexsort(coords.T[::-1])

    def grow(values, extra):
        return np.concatenate([values, np.broadcast_to(extra, (2, *values.shape[1:]))])[
            order
        ].astype(np.float32)

    loose = np.full((2, 64), 3.0)
    loose[0, 21] = -0.5  # one stray cell
    loose[1, :] = -0.5  # a whole voxel: a knob, perhaps
    sdf = np.concatenate([grid.sdf, loose])[order].astype(np.float32)
    return dataclasses.replace(
        grid,
        coords=coords[order],
        sdf=sdf,
        color=grow(grid.color, 0.5),
        own_box=grow(grid.own_box, grid.own_box[0, 0]),
        joint_code=grow(grid.joint_code, 0),
        parent_box=grow(grid.parent_box, grid.parent_box[0]),
    )


def test_a_part_without_inside_still_has_a_mesh():
    grid = make_door()[0]
    sdf = np.where(grid.owner == 2, 2.0, grid.sdf).astype(np.float32)
    obj = assemble(dataclasses.replace(grid, sdf=sdf).gather())
    assert len(obj.parts) == 3
    for part in obj.parts:
        assert_closed(part.mesh)


def test_an_empty_grid_is_refused_in_one_line():
    empty = [np.zeros((0, *shape), np.float32) for shape in ((64,), (64, 3), (64, 6), (9,), (6,))]
    with pytest.raises(ValueError, match="grid is empty") as error:
        assemble(VoxelGrid(8, 4, np.zeros((0, 3), np.int32), *empty))
    assert "\n" not in str(error.value)


@settings(max_examples=25)
@given(
    st.integers(1, 5),
    st.integers(1, 4),
    st.floats(0, 1),
    st.integers(0, 6),
    st.sampled_from([0.0, 0.02, 0.5]),
    st.sampled_from(["noise", "half", "inside", "outside", "nan"]),
    st.integers(0, 10**6),
)
def test_garbage_gives_closed_parts(resolution, r, share, parts, noise, kind, seed):
    rng = np.random.default_rng(seed)
    occupied = rng.random((resolution,) * 3) < share
    occupied.flat[rng.integers(occupied.size)] = True
    coords = np.argwhere(occupied).astype(np.int32)
    count, cells = len(coords), r**3
    sdf = rng.normal(0, 2, (count, cells))
    if kind == "half":
        sdf = np.where(sdf < 0, -0.5, 0.5)
    elif kind in ("inside", "outside"):
        sdf = np.full_like(sdf, -3.0 if kind == "inside" else 3.0)
    boxes = rng.uniform(-0.5, 0.5, (parts + 1, 6))[rng.integers(parts + 1, size=(count, cells))]
    fields = [sdf, rng.random((count, cells, 3)), boxes + rng.normal(0, noise, boxes.shape)]
    fields += [rng.normal(size=(count, 9)), rng.normal(size=(count, 6))]
    if kind == "nan":
        for values in fields:
            values.flat[rng.integers(values.size, size=3)] = rng.choice(
                [np.nan, np.inf, -np.inf], 3
            )
    obj = assemble(VoxelGrid(resolution, r, coords, *[f.astype(np.float32) for f in fields]))
    for part in obj.parts:
        assert_closed(part.mesh)
        assert np.abs(part.mesh.bounds).max() <= 0.5 + 1 / (resolution * r)


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5, 0.7])
def test_every_ambiguous_cube_is_closed(share):
    """Random signs hold every way in which a cube's corners can lie; before anything is
    simplified."""
    rng = np.random.default_rng(0)
    for trial in range(8):
        size = (
            rng.uniform(1e-4, 3, (12, 12, 12)) if trial % 2 else 0.5
        )  # unknown cells often tie at 1/2
        sdf = np.where(rng.random((12, 12, 12)) < share, -1, 1) * size
        field = np.pad(sdf.astype(np.float32), 1, constant_values=1)
        dense = DenseField(field, np.zeros(field.shape, np.int16), np.zeros(field.shape, np.int32))
        window = (slice(1, 13),) * 3
        assert_closed(part_mesh(dense, 0, window, np.zeros((1, 3), np.uint8)))


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.2, 1.0])
def test_fine_noise_keeps_the_face_budget(noise):
    rng = np.random.default_rng(0)
    low, high = (-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)
    grid = grid_of([lambda p: box_sdf(p, low, high)], [box_of(low, high)], resolution=32).gather()
    sdf = grid.sdf + rng.normal(0, noise, grid.sdf.shape).astype(np.float32)
    color = np.clip(grid.color + rng.normal(0, 0.1, grid.color.shape), 0, 1).astype(np.float32)
    mesh = assemble(dataclasses.replace(grid, sdf=sdf, color=color)).parts[0].mesh
    assert_closed(mesh)
    assert len(mesh.faces) <= FACE_BUDGET


def families() -> list:
    from uniart_jax.procedural import FAMILIES as names

    return [pytest.param(n, marks=pytest.mark.slow if i else ()) for i, n in enumerate(names)]


@pytest.mark.parametrize("family", families())
def test_procedural_objects_come_back_whole(family):
    obj = generate(family, 3)
    grid = voxelize(obj)
    back = assemble(grid.gather())
    assert len(back.parts) == len(obj.parts)
    match = np.abs(grid.boxes[:, None] - back.boxes[None]).max(-1).argmin(1)
    assert sorted(match) == list(range(len(obj.parts)))
    for k, part in enumerate(obj.parts):
        other = back.parts[match[k]]
        assert_closed(other.mesh)
        assert other.joint.type == part.joint.type
        assert other.parent == (match[part.parent] if part.parent >= 0 else -1)
        if part.joint.type != "fixed":
            assert abs(other.joint.direction @ part.joint.direction) > 1 - 1e-6

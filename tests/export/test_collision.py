"""Convex pieces that keep cavities and stand for the part, whatever its mesh."""

from __future__ import annotations

import subprocess
import sys

import igl
import numpy as np
import pytest
import trimesh
from asset_objects import hollow_box, painted_box
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from manifold3d import Manifold

from uniart_jax.export.collision import collision_shapes
from uniart_jax.export.physics import Box, Hull
from uniart_jax.procedural import HELD_OUT_SEED, generate

DEPTH = 0.0075  # of the size: DEPTH and half of it again for boxes, as documented


def solid(shape) -> Manifold:
    if isinstance(shape, Hull):
        return Manifold.hull_points(np.asarray(shape.mesh.vertices, np.float64))
    matrix = np.column_stack([shape.rotation, shape.center])
    return Manifold.cube(tuple(shape.size), True).transform(matrix)


def vertices(shape) -> np.ndarray:
    return np.asarray(solid(shape).to_mesh64().vert_properties)[:, :3]


def distance(points: np.ndarray, mesh: trimesh.Trimesh) -> np.ndarray:
    """Signed: negative inside a closed mesh."""
    vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)
    points = np.ascontiguousarray(points, float)
    away = np.sqrt(np.asarray(igl.point_mesh_squared_distance(points, vertices, faces)[0]))
    inside = np.abs(np.asarray(igl.winding_number(vertices, faces, points)).ravel()) > 0.5
    return np.where(inside, -away.ravel(), away.ravel())


def depth_in(points: np.ndarray, shapes) -> np.ndarray:
    """[n] how far the points lie outside all of the shapes; negative inside one."""
    found = []
    for shape in shapes:
        mesh = solid(shape).to_mesh64()
        corners = np.asarray(mesh.vert_properties)[:, :3][np.asarray(mesh.tri_verts, int)]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(normals, axis=1)
        normals, corners = normals[length > 0] / length[length > 0, None], corners[length > 0]
        found.append((points @ normals.T - (normals * corners[:, 0]).sum(1)).max(1))
    return np.min(found, axis=0)


def check(mesh: trimesh.Trimesh, shapes, size: float) -> None:
    """The shapes are convex, cover the surface and stand out of it by no more than they may."""
    for shape in shapes:
        if isinstance(shape, Hull):
            assert shape.mesh.is_watertight and shape.mesh.is_volume and shape.mesh.volume > 0
            assert len(shape.mesh.vertices) <= 64
            hull = trimesh.convex.convex_hull(shape.mesh.vertices)
            assert shape.mesh.volume == pytest.approx(hull.volume, rel=1e-6)
        else:
            np.testing.assert_allclose(shape.rotation.T @ shape.rotation, np.eye(3), atol=1e-9)
            assert np.linalg.det(shape.rotation) > 0 and shape.size.min() > 0
    on_mesh, _ = trimesh.sample.sample_surface(mesh, 2000, seed=0)
    assert depth_in(on_mesh, shapes).max() <= DEPTH * size
    drawn = np.random.default_rng(0).uniform(*mesh.bounds, (4000, 3))
    filled = drawn[depth_in(drawn, shapes) < 0]
    assert distance(filled, mesh).max() <= DEPTH * size * 1.01


def kinds(shapes) -> list[int]:
    return [sum(isinstance(s, kind) for s in shapes) for kind in (Box, Hull)]


def test_a_block_is_a_box_however_it_is_turned():
    block = painted_box([0, 0, 0], [1, 2, 3])
    for angle in (0.0, 0.01, 0.4, 2.0):
        turn = trimesh.transformations.rotation_matrix(angle, [1, 2, -1], [3, 0, 0])
        moved = block.copy().apply_transform(turn)
        ((shape,),) = collision_shapes([moved])
        assert isinstance(shape, Box)
        np.testing.assert_allclose(sorted(shape.size), [1, 2, 3], rtol=1e-6)
        check(moved, [shape], 3)


@pytest.mark.parametrize("angle", [0.0, 0.5])
def test_walls_are_boxes_in_their_own_frame(angle):
    mesh = hollow_box([-0.3, -0.4, -0.5], [0.3, 0.4, 0.5], 0.04)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(angle, [1, 1, 1]))
    (shapes,) = collision_shapes([mesh])
    assert kinds(shapes) == [5, 0]
    check(mesh, shapes, 1)
    cavity = np.random.default_rng(0).uniform([-0.25, -0.35, -0.45], [0.25, 0.35, 0.45], (500, 3))
    turn = trimesh.transformations.rotation_matrix(angle, [1, 1, 1])[:3, :3]
    assert (depth_in(cavity @ turn.T, shapes) > 0).all()


@pytest.mark.slow
@settings(max_examples=5, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_what_is_cut_out_of_a_turned_block_stays_free(seed):
    """Boxes, balls and cylinders out of a block: a contract for every closed solid."""
    rng = np.random.default_rng(seed)
    body = trimesh.creation.box([1, 0.8, 0.6])
    for _ in range(rng.integers(1, 4)):
        kind, at = rng.integers(3), rng.uniform(-0.4, 0.4, 3)
        size = rng.uniform(0.1, 0.5)
        if kind == 0:
            tool = trimesh.creation.box([size, 0.6 * size, 1.2 * size])
        elif kind == 1:
            tool = trimesh.creation.icosphere(2, size / 2)
        else:
            tool = trimesh.creation.cylinder(size / 2, 1.5, sections=20)
        turn = trimesh.transformations.random_rotation_matrix(rng.random(3))
        tool.apply_transform(turn).apply_translation(at)
        left = trimesh.boolean.difference([body, tool], engine="manifold")
        if left.volume > 0.05:
            body = left
    body.apply_transform(trimesh.transformations.random_rotation_matrix(rng.random(3)))
    (shapes,) = collision_shapes([body])
    size = float(body.extents.max())
    check(body, shapes, size)


@pytest.mark.parametrize(
    ("family", "part"),
    [("washer", "drum"), ("toilet", "body"), ("bottle", "cap"), ("storage_furniture", "drawer")],
)
def test_bowls_drums_and_drawers_stay_hollow(family, part):
    obj = generate(family, HELD_OUT_SEED)
    mesh = obj.parts[obj.index(part)].mesh
    (shapes,) = collision_shapes([mesh], 1.0)
    check(mesh, shapes, 1.0)
    parts = sum(solid(s).volume() for s in shapes)
    assert parts < 1.35 * mesh.volume  # its hull has from two to five times its volume
    assert len(shapes) <= 80


def test_what_nearly_fills_its_hull_is_its_hull():
    ball = trimesh.creation.icosphere(3)
    ((shape,),) = collision_shapes([ball])
    assert isinstance(shape, Hull)
    assert len(shape.mesh.vertices) <= 64
    assert 0.85 * ball.volume < shape.mesh.volume <= ball.volume * (1 + 1e-9)


@pytest.mark.slow
@settings(max_examples=25, deadline=None, phases=[Phase.explicit, Phase.generate])
@given(
    st.sampled_from(["cylinder", "lens", "sphere"]),
    st.integers(3, 256),
    st.floats(-3, 0),
    st.floats(-3, 0),
    st.integers(0, 5),
    st.booleans(),
)
def test_round_solids_of_any_flatness_keep_their_shape(kind, sections, radius, flat, turn, beside):
    """Few corners of many: 1 % of the extents and 15 % of the volume at the most, and no error."""
    r = 0.5 * 10**radius
    turns = np.linspace(0, 2 * np.pi, sections, endpoint=False)
    rim = np.stack([np.cos(turns), np.sin(turns)], 1)
    if kind == "cylinder":
        heights, widths = [-0.5, 0.5], [1, 1]
    elif kind == "lens":
        heights, widths = [-0.5, -0.3, 0, 0.3, 0.5], [0.01, 0.7, 1, 0.7, 0.01]
    else:
        rings = np.linspace(0.02, np.pi - 0.02, max(3, min(sections // 2, 24)))
        heights, widths = -np.cos(rings) / 2, np.sin(rings)
    points = [
        np.column_stack([w * rim, np.full(sections, h)])
        for h, w in zip(heights, widths, strict=True)
    ]
    points = np.concatenate(points) * [r, r, r * 10**flat]
    mesh = trimesh.convex.convex_hull(points)
    whole = Manifold.hull_points(points)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(turn * 0.3, [1, 2, 3]))
    block = trimesh.creation.box([0.5, 0.5, 0.7]).apply_translation([3, 0, 0])
    shapes = collision_shapes([block, mesh] if beside else [mesh])[-1]
    back = trimesh.transformations.rotation_matrix(-turn * 0.3, [1, 2, 3])[:3, :3]
    corners = np.concatenate([vertices(s) for s in shapes])
    thin = 2e-3 * r  # what is thinner is made as thick
    assert np.ptp(corners, axis=0) == pytest.approx(mesh.extents, rel=0.01, abs=1.1 * thin)
    ratio = np.ptp(corners @ back.T, axis=0) / np.ptp(points, axis=0)
    assert ratio.min() >= 0.95  # along others than the mesh's axes: 64 points of a ball lose 3 %
    assert sum(solid(s).volume() for s in shapes) >= 0.85 * whole.volume()
    assert all(len(vertices(s)) <= 64 for s in shapes)


@pytest.mark.parametrize(
    ("sections", "radius", "height"), [(48, 0.5, 0.01), (48, 0.15, 0.003), (40, 0.3, 0.005)]
)
def test_a_disc_beside_a_block_is_a_disc(sections, radius, height):
    disc = trimesh.creation.cylinder(radius, height, sections=sections)
    block = trimesh.creation.box([0.5, 0.5, 0.7]).apply_translation([3, 0, 0])
    _, (shape,) = collision_shapes([block, disc])
    np.testing.assert_allclose(np.ptp(vertices(shape), axis=0), disc.extents, rtol=0.01)
    assert shape.mesh.volume > 0.95 * disc.volume


SPECKS = [9e-6, 1e-6, 1e-8, 1e-9, 1e-12]


@pytest.fixture(scope="module")
def specks():
    """What becomes of specks and needles, by extent, in a process of its own: manifold3d would end
    it."""
    script = (
        "import trimesh\n"
        "from uniart_jax.export.collision import collision_shapes\n"
        f"for extent in {SPECKS}:\n"
        "    speck = trimesh.creation.icosphere(2, extent / 2)\n"
        "    needle = trimesh.creation.box([1, extent, extent])\n"
        "    found = collision_shapes([trimesh.creation.box([1, 1, 1]), speck, needle])\n"
        "    large = lambda s: bool(s.size.min() >= .99e-5)\n"
        "    boxes = [(type(s).__name__, large(s)) for own in found for s in own]\n"
        "    print(boxes, flush=True)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    return dict(zip(SPECKS, done.stdout.splitlines(), strict=False)), done.stderr


@pytest.mark.parametrize("extent", SPECKS)
def test_a_speck_is_a_small_box(specks, extent):
    found, error = specks
    assert extent in found, error
    assert found[extent] == str([("Box", True)] * 3)


def test_a_sealed_box_is_hollow_and_an_inverted_one_is_solid():
    outer, inner = trimesh.creation.box([1, 1, 1]), trimesh.creation.box([0.8, 0.8, 0.8])
    inner.invert()
    (shapes,) = collision_shapes([trimesh.util.concatenate([outer, inner])])
    assert len(shapes) == 6
    assert (depth_in(np.random.default_rng(0).uniform(-0.39, 0.39, (200, 3)), shapes) > 0).all()
    outer.invert()
    ((shape,),) = collision_shapes([outer])
    np.testing.assert_allclose(shape.size, [1, 1, 1])


def test_a_bolt_in_a_narrow_hole_makes_both_finer():
    """Alone, the hole is within the tolerance of a large plate and is filled; with the bolt in it,
    it is not."""
    plate = trimesh.creation.box([1, 1, 0.05])
    hole = trimesh.creation.cylinder(0.0045, 1, sections=16)
    plate = trimesh.boolean.difference([plate, hole], engine="manifold")
    bolt = trimesh.creation.cylinder(0.0035, 0.3, sections=16)
    (alone,) = collision_shapes([plate])
    assert len(alone) == 1
    found, pin = collision_shapes([plate, bolt], 1.0)
    assert len(found) > 1
    common = max((solid(a) ^ solid(b)).volume() for a in found for b in pin)
    assert common < 0.2 * bolt.volume * 0.05 / 0.3


@pytest.mark.parametrize(
    "vertices",
    [[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]]],
    ids=["sheet", "line"],
)
def test_flat_part_is_a_thin_box(vertices):
    mesh = trimesh.Trimesh(vertices, [[0, 1, 2], [0, 2, 3]], process=False)
    turn = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3])
    mesh.apply_transform(turn)
    ((shape,),) = collision_shapes([mesh])
    assert isinstance(shape, Box)
    assert shape.size.min() == pytest.approx(1e-3 * mesh.extents.max(), rel=0.2)
    assert depth_in(np.asarray(mesh.vertices), [shape]).max() < 1e-6


def test_open_shells_are_covered_and_stay_open():
    """A box without lid and without thickness: its sheets, not its hull."""
    box = trimesh.creation.box([1, 1, 1]).subdivide().subdivide()
    tray = box.submesh([np.flatnonzero(box.triangles_center[:, 2] < 0.499)], append=True)
    assert not tray.is_watertight
    (shapes,) = collision_shapes([tray])
    on_mesh, _ = trimesh.sample.sample_surface(tray, 500, seed=0)
    assert depth_in(on_mesh, shapes).max() < 0.02
    assert (
        depth_in(np.random.default_rng(0).uniform(-0.35, 0.35, (200, 3)), shapes) > 0
    ).mean() > 0.9
    again = collision_shapes([tray])[0]
    assert all(
        np.array_equal(a.mesh.vertices, b.mesh.vertices)
        for a, b in zip(shapes, again, strict=True)
        if isinstance(a, Hull)
    )


@pytest.mark.parametrize(("sides", "kind"), [(4, Box), (64, Hull)])
def test_what_is_thinner_than_collision_keeps_its_outline(sides, kind):
    """A sheet stays a box; a disc of less than a five-hundredth of its size stays round."""
    disc = trimesh.creation.cylinder(0.5, 1e-4, sections=sides)
    (shape,) = collision_shapes([disc])[0]
    assert isinstance(shape, kind)
    area = solid(shape).volume() / np.ptp(vertices(shape)[:, 2])
    assert area == pytest.approx(disc.volume / 1e-4, rel=0.05)

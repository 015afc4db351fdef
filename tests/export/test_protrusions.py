"""Legs and handles of rough parts have collision shapes of their own; no budget takes them away."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import trimesh
from skimage import measure

from uniart_jax.export.bodies import make_bodies
from uniart_jax.export.budget import PART_MOST, within_budget
from uniart_jax.export.physics import Body, Box, Hull
from uniart_jax.export.protrusions import as_shapes, fine_cells, protrusions
from uniart_jax.export.separation import as_solid
from uniart_jax.export.volume_error import half_spaces
from uniart_jax.export.voxel_boxes import as_cells, cover
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part

LATTICE = 128
FRONT = ((0, -1),)


def solid(*blocks) -> np.ndarray:
    """Cells of blocks ((x0, x1), (y0, y1), (z0, z1)) in the cube [-1/2, 1/2]^3."""
    centers = (np.indices((LATTICE,) * 3) + 0.5) / LATTICE - 0.5
    full = np.zeros((LATTICE,) * 3, bool)
    for block in blocks:
        sides = zip(centers, block, strict=True)
        full |= np.logical_and.reduce([(c > lo) & (c < hi) for c, (lo, hi) in sides])
    return full


def rough(full: np.ndarray, seed: int = 0) -> trimesh.Trimesh:
    """Marching cubes of a solid, bumpy as a network's."""
    field = np.where(full, -1.0, 1.0) * np.random.default_rng(seed).uniform(0.2, 1, full.shape)
    vertices, faces, _, _ = measure.marching_cubes(np.pad(field, 1, constant_values=1.0), 0.0)
    return trimesh.Trimesh((vertices - 0.5) / len(full) - 0.5, faces, process=False)


def cabinet() -> ArticulatedObject:
    """A case on four legs two cells thick, with a door that has a bow handle three cells out."""
    leg = [
        ((x, x + 0.016), (y, y + 0.016), (-0.45, -0.2))
        for x in (-0.15, 0.15)
        for y in (-0.28, 0.28)
    ]
    case = ((-0.18, 0.2), (-0.3, 0.3), (-0.22, 0.4))
    door = ((-0.23, -0.19), (-0.3, 0.3), (-0.2, 0.4))
    posts = [((-0.26, -0.23), (-0.25, -0.234), (z, z + 0.016)) for z in (0.0, 0.15)]
    bar = ((-0.27, -0.254), (-0.25, -0.234), (0.0, 0.166))
    hinge = Joint([-0.2, 0.3, 0.1], [0, 0, 1], (-1.5, 0))
    return ArticulatedObject(
        (
            Part("base", rough(solid(case, *leg))),
            Part("door", rough(solid(door, *posts, bar), 1), 0, hinge),
        ),
        scale=2.0,
        from_voxels=True,
    )


def lowest(shapes) -> np.ndarray:
    """[4] lowest z of shapes in each quarter, seen from above."""
    points = [np.asarray(as_solid(s).to_mesh().vert_properties)[:, :3] for s in shapes]
    points = np.concatenate(points)
    quarters = (points[:, 0] > 0) + 2 * (points[:, 1] > 0)
    return np.array([points[quarters == q, 2].min() for q in range(4)])


@pytest.fixture(scope="module")
def made():
    obj = cabinet()
    meshes = [part.mesh for part in obj.parts]
    bodies = make_bodies(obj, meshes)
    return obj, bodies, within_budget(obj, bodies, meshes)


@pytest.mark.parametrize("budget", [None, 12, 8])
def test_an_object_stands_on_all_of_its_legs(made, budget):
    obj, bodies, light = made
    if budget is not None:
        light = within_budget(obj, bodies, [p.mesh for p in obj.parts], budget)
        assert sum(len(body.shapes) for body in light) <= budget
    assert len(light[0].shapes) <= PART_MOST
    bottom = 2 * obj.parts[0].mesh.bounds[0, 2]
    np.testing.assert_allclose(lowest(light[0].shapes), bottom, atol=0.01)


@pytest.mark.parametrize("budget", [1, 2, 3, 5])
def test_small_budgets_are_kept(made, budget):
    obj, bodies, _ = made
    light = within_budget(obj, bodies, [p.mesh for p in obj.parts], budget)
    assert sum(len(body.shapes) for body in light) <= max(budget, len(obj.parts))


def test_a_handle_can_be_held(made):
    obj, _, light = made
    points = [np.asarray(as_solid(s).to_mesh().vert_properties)[:, :3] for s in light[1].shapes]
    front = min(own[:, 0].min() for own in points)
    assert front == pytest.approx(2 * obj.parts[1].mesh.bounds[0, 0], abs=0.02)
    held = [s for s in light[1].shapes if s.stands_out]
    assert held and all(isinstance(s, Box | Hull) for s in held)
    between = 2 * np.array([-0.245, -0.242, 0.08])  # a finger goes behind the bow
    assert not holds(light[1].shapes, between)


def holds(shapes, point) -> bool:
    """Whether a shape holds a point, metres."""
    spaces = [half_spaces(as_solid(shape)) for shape in shapes]
    return any((normals @ point < offsets).all() for normals, offsets in spaces)


def slab(lo, hi, stands_out: bool = False) -> Box:
    lo, hi = np.asarray(lo, float), np.asarray(hi, float)
    return Box((lo + hi) / 2, hi - lo, np.eye(3), stands_out)


@pytest.mark.parametrize(("budget", "apart"), [(5, 0), (8, 3), (10, 5), (40, 8)])
def test_handles_leave_a_shape_for_every_part(budget, apart):
    slide = Joint([0, 0, 0], [-1, 0, 0], (0, 0), (0, 0.1))
    parts = [Part("base", trimesh.creation.box(bounds=[[0, 0, 0], [0.5, 1, 1.2]]))]
    shapes = [(slab([0, 0, 0], [0.5, 1, 1.2]),)]
    for k in range(4):  # drawers with two pins each
        low, high = 0.3 * k + 0.02, 0.3 * k + 0.28
        front = [-0.1, 0, low], [-0.02, 1, high]
        pins = [([-0.2, y, low + 0.1], [-0.1, y + 0.02, low + 0.12]) for y in (0.3, 0.7)]
        parts.append(Part(f"d{k}", trimesh.creation.box(bounds=front), 0, slide))
        shapes.append((slab(*front), *(slab(*pin, stands_out=True) for pin in pins)))
    obj = ArticulatedObject(tuple(parts))
    bodies = [Body(1.0, np.zeros(3), np.eye(3), own, None) for own in shapes]
    light = within_budget(obj, bodies, [part.mesh for part in parts], budget)
    assert sum(len(body.shapes) for body in light) <= budget and all(body.shapes for body in light)
    assert sum(s.stands_out for body in light for s in body.shapes) == apart


def slanted() -> ArticulatedObject:
    """A board on four legs that slant outwards."""
    centers = (np.indices((LATTICE,) * 3) + 0.5) / LATTICE - 0.5
    x, y, z = centers
    full = (abs(x) < 0.4) & (abs(y) < 0.4) & (z > 0.0) & (z < 0.06)
    out = 0.28 + 0.3 * -z
    for a in (-1, 1):
        for b in (-1, 1):
            near = (abs(x - a * out) < 0.02) & (abs(y - b * out) < 0.02)
            full |= near & (z <= 0.01) & (z > -0.4)
    return ArticulatedObject((Part("base", rough(full)),), from_voxels=True)


@pytest.mark.parametrize("collision", ["merged", "boxes"])
def test_slanted_legs_reach_the_ground(collision):
    obj = slanted()
    mesh = obj.parts[0].mesh
    bodies = make_bodies(obj, [mesh], collision=collision)
    assert all(isinstance(s, Box) for s in bodies[0].shapes) == (collision == "boxes")
    np.testing.assert_allclose(lowest(bodies[0].shapes), mesh.bounds[0, 2], atol=1e-3)
    light = within_budget(obj, bodies, [mesh], boxes=collision == "boxes")
    np.testing.assert_allclose(lowest(light[0].shapes), mesh.bounds[0, 2], atol=0.01)


def test_walls_on_the_ground_are_no_feet():
    walls = [((-0.2, 0.2), (y, y + 0.03), (-0.45, 0.4)) for y in (-0.3, 0.27)]
    top = ((-0.2, 0.2), (-0.3, 0.3), (0.38, 0.42))
    base = rough(solid(*walls, top))
    (body,) = make_bodies(ArticulatedObject((Part("base", base),), from_voxels=True), [base])
    assert len(body.shapes) >= 3 and not any(shape.stands_out for shape in body.shapes)


def test_what_is_in_the_way_of_another_part_goes():
    obj = cabinet()
    flap = Part("flap", rough(solid(((-0.28, -0.24), (-0.5, -0.4), (0.0, 0.16))), 2), 0)
    flap = dataclasses.replace(flap, joint=Joint([0, 0, 0], [0, 1, 0], (0, 0), (0, 0.3)))
    obj = dataclasses.replace(obj, parts=(*obj.parts, flap))  # it slides over the handle
    meshes = [part.mesh for part in obj.parts]
    bodies = make_bodies(obj, meshes)
    inside = 2 * np.array([-0.262, -0.242, 0.08])  # the bar
    assert holds(bodies[1].shapes, inside)
    assert not holds(within_budget(obj, bodies, meshes)[1].shapes, inside)


def test_what_was_carved_away_does_not_come_back():
    obj = cabinet()
    cells = as_cells(obj, [part.mesh for part in obj.parts])
    low = np.zeros_like(cells.full[0])
    low[:, :, : cells.holding(np.array([0, 0, -0.35]))[2]] = True  # the ends of the legs
    carved = dataclasses.replace(cells, full=cells.full & ~low[None])
    back = dataclasses.replace(carved, fine={0: cells.fine[0].without(low)})
    assert lowest(carved.shapes(1.0)[0]).max() < -0.4  # as if nothing was carved
    assert lowest(back.shapes(1.0)[0]).min() > -0.4


def cube_with(pin: bool, other: bool) -> tuple:
    """The fine cells of a cube of 16 coarse ones with a pin at its front; ``other``: a part before
    it."""
    mesh = trimesh.creation.box(bounds=[[8, 8, 8], [24, 24, 24]])
    if pin:
        rod = trimesh.creation.box(bounds=[[3, 15, 15], [9, 17, 17]])
        mesh = trimesh.boolean.union([mesh, rod], engine="manifold")
    others = np.zeros((32, 32, 32), bool)
    others[0, 10:22, 10:22] = other
    fine = fine_cells(np.asarray(mesh.vertices), np.asarray(mesh.faces), 32, others, FRONT, False)
    return fine, [(np.array([8, 8, 8]), np.array([24, 24, 24]))]


def test_what_stands_out_is_found_with_its_root():
    (cells,) = protrusions(*cube_with(True, False))
    assert cells.min(0).tolist() == [6, 30, 30] and cells.max(0)[0] >= 16
    assert cells.max(0)[1:].tolist() == [33, 33]
    assert not protrusions(*cube_with(False, False))


def test_what_another_part_hides_is_no_handle():
    assert not protrusions(*cube_with(True, True))


def test_cells_of_other_parts_are_not_its_own():
    fine, boxes = cube_with(True, False)
    taken = np.zeros((32, 32, 32), bool)
    taken[2:8] = True
    mesh = trimesh.creation.box(bounds=[[3, 8, 8], [24, 24, 24]])
    fine = fine_cells(np.asarray(mesh.vertices), np.asarray(mesh.faces), 32, taken, FRONT, False)
    assert not fine.inside[:9].any() and fine.inside[10:].any() and not protrusions(fine, boxes)


def test_near_a_hinge_there_is_no_handle():
    fine, boxes = cube_with(True, False)
    assert protrusions(fine.away_from(np.array([8.0, 24, 16]), np.array([0, 0, 1.0])), boxes)
    assert not protrusions(fine.away_from(np.array([8.0, 15, 16]), np.array([0, 0, 1.0])), boxes)


def test_a_slanted_leg_is_a_hull_and_a_straight_one_a_box():
    straight = np.argwhere(np.ones((4, 4, 30), bool))
    ((low, high),) = as_shapes(straight, cover)
    assert low.tolist() == [0, 0, 0] and high.tolist() == [4, 4, 30]
    slanted = np.concatenate([straight[straight[:, 2] == z] + [z, 0, 0] for z in range(30)])
    found = as_shapes(slanted, cover)
    assert isinstance(found, trimesh.Trimesh) and found.is_convex
    assert isinstance(as_shapes(slanted, cover, hulls=False), list)


def test_boxes_of_a_foot_reach_its_end():
    cells = np.argwhere(np.ones((4, 4, 30), bool))
    upper = lambda *_: [(np.array([1, 1, 11]), np.array([5, 5, 31]))]  # noqa: E731
    for foot, low in ((False, 10), (True, 0)):
        found = as_shapes(cells, upper, hulls=False, foot=foot)
        assert min(box[0][2] for box in found) == low

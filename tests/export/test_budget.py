"""Few convex shapes: budgets are kept, walls stay walls, other parts' room stays free."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from asset_objects import hollow_box

from uniart_jax import procedural
from uniart_jax.export.bodies import make_bodies
from uniart_jax.export.budget import PART_MOST, within_budget
from uniart_jax.export.collision import OVERLAP
from uniart_jax.export.physics import Body, Box
from uniart_jax.export.separation import overlaps
from uniart_jax.export.volume_error import volume_error
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part


def slab(lo, hi) -> Box:
    lo, hi = np.asarray(lo, float), np.asarray(hi, float)
    return Box((lo + hi) / 2, hi - lo, np.eye(3))


def body(*shapes: Box) -> Body:
    return Body(1.0, np.zeros(3), np.eye(3), shapes, None)


def boxed(shapes) -> trimesh.Trimesh:
    """The surface of boxes."""
    solids = [
        trimesh.creation.box(bounds=[s.center - s.size / 2, s.center + s.size / 2]) for s in shapes
    ]
    return trimesh.boolean.union(solids, engine="manifold")


@pytest.fixture(scope="module")
def washer():
    obj = procedural.generate("washer", 900_001)
    meshes = [part.mesh for part in obj.parts]
    return obj, make_bodies(obj, meshes), meshes


@pytest.mark.slow
@pytest.mark.parametrize("budget", [1, 12, 64])
def test_an_object_keeps_within_its_budget(washer, budget):
    obj, bodies, meshes = washer
    light = within_budget(obj, bodies, meshes, budget)
    assert sum(len(body.shapes) for body in bodies) > 100
    assert sum(len(body.shapes) for body in light) <= max(budget, len(obj.parts))
    assert all(1 <= len(b.shapes) <= PART_MOST for b in light)
    again = within_budget(obj, bodies, meshes, budget)
    assert [b.volume_error for b in again] == [b.volume_error for b in light]


@pytest.mark.slow
def test_more_shapes_err_less(washer):
    obj, bodies, meshes = washer
    few, many = (within_budget(obj, bodies, meshes, n) for n in (3, 64))
    drum = obj.index("drum")
    assert many[drum].volume_error < 0.1 < 0.4 < few[drum].volume_error  # hollow, and filled


def test_shapes_that_make_a_wall_become_one_and_the_cavity_stays():
    tray = hollow_box([-0.5, -0.5, -0.2], [0.5, 0.5, 0.2], 0.05)
    floor = [slab([-0.5, y, -0.2], [0.45, y + 0.1, -0.15]) for y in np.arange(-0.5, 0.5, 0.1)]
    walls = [
        slab([-0.5, -0.5, 0.15], [0.5, 0.5, 0.2]),
        slab([0.45, -0.5, -0.2], [0.5, 0.5, 0.2]),
        slab([-0.5, -0.5, -0.2], [0.5, -0.45, 0.2]),
        slab([-0.5, 0.45, -0.2], [0.5, 0.5, 0.2]),
    ]
    obj = ArticulatedObject((Part("tray", tray),))
    (light,) = within_budget(obj, [body(*floor, *walls)], [tray], 64)
    assert len(light.shapes) == 5
    assert light.volume_error < 0.01


def test_nothing_is_joined_over_the_way_of_another_part():
    cheeks = [slab([0, 0, 0], [1, 0.3, 0.1]), slab([0, 0.4, 0], [1, 0.7, 0.1])]
    lid = [slab([0, 0, 0.3], [1, 0.7, 0.4])]
    key = [slab([0.4, 0.31, -0.5], [0.6, 0.39, -0.2])]
    frame_mesh, key_mesh = boxed(cheeks + lid), boxed(key)
    slide = Joint(np.zeros(3), np.array([0, 0, 1.0]), travel=(0, 0.5))
    parts = [Part("frame", frame_mesh), Part("key", key_mesh, 0, slide)]
    meshes = [frame_mesh, key_mesh]

    def left(joint: Joint) -> set[tuple]:
        obj = ArticulatedObject((parts[0], Part("key", key_mesh, 0, joint)))
        light = within_budget(obj, [body(*cheeks, *lid), body(*key)], meshes, 3)
        return {tuple(np.round(s.size, 6)) for s in light[0].shapes}

    assert (1.0, 0.7, 0.1) in left(Joint.fixed())  # the cheeks, over the slot
    assert (1.0, 0.3, 0.1) in left(slide)  # the key passes there


def test_a_budget_is_a_number_of_shapes(washer):
    obj, bodies, meshes = washer
    with pytest.raises(ValueError, match="--collision-budget 0"):
        within_budget(obj, bodies, meshes, 0)


def test_a_cupboard_that_lacks_its_front_is_not_filled():
    """Winding numbers take an open surface for a full solid, and one block for its best shape."""
    box = trimesh.creation.box(bounds=[[-0.2, -0.3, 0], [0.2, 0.3, 1]])
    front = box.face_normals[:, 0] < -0.5
    surface = trimesh.Trimesh(box.vertices, box.faces[~front], process=False)
    walls = (
        slab([0.19, -0.3, 0], [0.2, 0.3, 1]),
        slab([-0.2, -0.3, 0], [0.2, 0.3, 0.01]),
        slab([-0.2, -0.3, 0.99], [0.2, 0.3, 1]),
        slab([-0.2, -0.3, 0], [0.2, -0.29, 1]),
        slab([-0.2, 0.29, 0], [0.2, 0.3, 1]),
    )
    obj = ArticulatedObject((Part("body", surface),))
    (found,) = within_budget(obj, [body(*walls)], [surface])
    assert len(found.shapes) == 5 and found.volume_error is not None
    assert found.volume_error < 0.02


def test_thin_walls_are_not_left_out():
    """By its volume a sheet is worth nothing; what leans on it would fall through."""
    walls = [slab([x, 0, 0], [x + 0.002, 1, 1]) for x in (0.0, 0.998)]
    walls += [slab([0, y, 0], [1, y + 0.002, 1]) for y in (0.0, 0.998)]
    walls += [slab([0, 0, 0], [1, 1, 0.002])]
    block = [slab([0.3 + 0.1 * k, 0.4, 0.4], [0.35 + 0.1 * k, 0.6, 0.6]) for k in range(4)]
    mesh = boxed([*walls, *block])
    obj = ArticulatedObject((Part("base", mesh, -1, Joint.fixed()),))
    (light,) = within_budget(obj, [body(*walls, *block)], [mesh], 6)
    sides = [(0.001, 0.5, 0.9), (0.999, 0.5, 0.9), (0.5, 0.001, 0.9), (0.5, 0.999, 0.9)]
    for place in np.array([*sides, (0.9, 0.1, 0.001)]):
        away = [np.abs(place - s.center) - s.size / 2 for s in light.shapes]
        assert min(a.max() for a in away) < 1e-6


def test_what_is_joined_does_not_stand_in_a_neighbour():
    """The hull of a corner of two boards reaches a little into the block that stands in it."""
    corner = [slab([0, 0, 0], [1, 1, 0.1]), slab([0, 0, 0.1], [0.1, 1, 0.5])]
    block = slab([0.45, 0, 0.3], [0.9, 1, 0.9])
    meshes = [boxed(corner), boxed([block])]
    slide = Joint((0.5, 0.5, 0.5), (0, 0, 1), travel=(0.0, 0.1))
    obj = ArticulatedObject((Part("base", meshes[0]), Part("block", meshes[1], 0, slide)))
    light = within_budget(obj, [body(*corner), body(block)], meshes, 2)
    assert [len(b.shapes) for b in light] == [1, 1]
    assert not overlaps([b.shapes for b in light], OVERLAP)
    for mesh, own in zip(meshes, light, strict=True):  # of the shapes as they are cut
        assert own.volume_error == pytest.approx(volume_error(mesh, own.shapes))

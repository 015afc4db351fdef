"""Which joint states make parts run into one another, and that no shown state is one of them."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from uniart_jax.objects.clearance import Clearance
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.objects.states import sample_state
from uniart_jax.procedural import generate


def box(size, center):
    return trimesh.creation.box(size, trimesh.transformations.translation_matrix(center))


def rack_behind_a_door(door=None) -> ArticulatedObject:
    """An open shell, a rack that slides out to -x, and a door in front of it hinged on the left."""
    shell = trimesh.util.concatenate(
        [box((1, 0.02, 1), (0, y, 0)) for y in (-0.5, 0.5)] + [box((0.02, 1, 1), (0.5, 0, 0))]
    )
    rack = box((0.8, 0.8, 0.1), (0, 0, 0))
    door = box((0.02, 1, 1), (-0.52, 0, 0)) if door is None else door
    slide = Joint(np.zeros(3), np.array([-1.0, 0, 0]), travel=(0.0, 0.6))
    hinge = Joint(np.array([-0.52, 0.5, 0]), np.array([0, 0, -1.0]), angle=(0.0, np.pi / 2))
    return ArticulatedObject(
        (Part("shell", shell), Part("rack", rack, 0, slide), Part("door", door, 0, hinge))
    )


def test_a_rack_comes_out_only_where_the_door_is_open():
    clearance = Clearance(rack_behind_a_door())
    assert clearance.collision(np.zeros(3)) is None
    assert clearance.collision(np.array([0, 0, np.pi / 2])) is None  # nothing but the door
    assert set(clearance.collision(np.array([0, 0.5, 0]))) == {"rack", "door"}
    assert clearance.collision(np.array([0, 0.5, np.pi / 2])) is None


def test_a_sheet_of_no_thickness_is_in_the_way_too():
    corners = np.array([[-0.52, y, z] for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    sheet = trimesh.Trimesh(corners, [[0, 1, 2], [1, 3, 2]], process=False)
    clearance = Clearance(rack_behind_a_door(sheet))
    assert set(clearance.collision(np.array([0, 0.5, 0]))) == {"rack", "door"}
    assert clearance.collision(np.array([0, 0.5, np.pi / 2])) is None


def test_shown_states_are_clear():
    obj = rack_behind_a_door()
    clearance = Clearance(obj)
    rng = np.random.default_rng(0)
    moved = 0
    for _ in range(60):
        shown = sample_state(obj, rng, clearance)
        # what it takes to close again is where it stands: q = rest - shown
        q = np.array([-joint.limits[0] for joint in shown.joints]) * [0, shown.scale, 1]
        assert clearance.collision(q) is None
        moved += q[1] > 0.15
    assert moved > 3  # the rack does come out


@pytest.mark.parametrize("family", ["storage_furniture", "washer", "laptop", "sliding_window"])
def test_what_moves_freely_is_left_alone(family):
    """Parts that touch, or stand in one another, where they are at rest: hinges, drums, panes on
    tracks of their own."""
    rng = np.random.default_rng(1)
    for seed in range(3):
        obj = generate(family, seed)
        clearance = Clearance(obj)
        for k, joint in enumerate(obj.joints):
            behind_a_door = obj.parts[k].name.startswith("tray")
            if k == 0 or joint.type == "fixed" or behind_a_door:
                continue
            q = obj.rest()
            q[k] = rng.uniform(*joint.limits)
            assert clearance.collision(q) is None, (family, seed, obj.parts[k].name, q[k])


@pytest.mark.parametrize("points", [1, 2, 3])
def test_parts_without_extent_and_stray_vertices(points):
    """A point, a line and a sliver are as thick as a sheet; a vertex that no face touches is
    nowhere."""
    corners = np.array([[-0.52, 0, 0], [-0.52, 0.5, 0], [-0.52, -0.5, 0]])[:points]
    stray = np.concatenate([np.resize(corners, (3, 3)), [[50.0, 50, 50]]])
    speck = trimesh.Trimesh(stray, [[0, 1, 2]], process=False)
    clearance = Clearance(rack_behind_a_door(speck))
    assert clearance.collision(np.zeros(3)) is None
    assert np.isfinite(clearance.volumes).all() and clearance.volumes[2] < 1e-3

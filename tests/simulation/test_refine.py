"""Joints that run into the object are drawn in or shifted, within bounds, and others are left
alone."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

pytest.importorskip("mujoco")

from uniart_jax.export.physics import Body, Box
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.simulation.collider import Collider
from uniart_jax.simulation.refine import DEPTH_LIMIT, refine


def box(lo, hi):
    return np.asarray(lo, float), np.asarray(hi, float)


def make(boxes: dict, joints: dict, parents: dict, scale: float = 1.0):
    """An object whose parts are boxes, and its bodies."""
    names = list(boxes)
    parts = []
    for name in names:
        meshes = [trimesh.creation.box(bounds=b) for b in boxes[name]]
        parent = names.index(parents[name]) if name in parents else -1
        joint = joints.get(name, Joint.fixed())
        parts.append(Part(name, trimesh.util.concatenate(meshes), parent, joint))
    bodies = [
        Body(
            1.0,
            np.zeros(3),
            np.eye(3),
            tuple(Box((lo + hi) / 2 * scale, (hi - lo) * scale, np.eye(3)) for lo, hi in boxes[n]),
            None,
        )
        for n in names
    ]
    return ArticulatedObject(tuple(parts), scale=scale), bodies


def cabinet(door: Joint, drawer: Joint | None = None, scale: float = 1.0):
    """A box open to the front (-x) with a door before it and a drawer inside; the left wall stands
    out by .3 as a screen."""
    walls = [
        box([-0.3, -0.42, -0.4], [0.3, -0.38, 0.4]),
        box([-0.3, 0.38, -0.4], [0.3, 0.42, 0.4]),
        box([-0.3, -0.38, -0.4], [0.3, 0.38, -0.36]),
        box([-0.3, -0.38, 0.36], [0.3, 0.38, 0.4]),
        box([0.26, -0.38, -0.36], [0.3, 0.38, 0.36]),
        box([-0.8, -0.5, -0.4], [-0.3, -0.46, 0.4]),  # the screen, to the door's left
        box([-0.34, -0.5, -0.4], [-0.3, -0.38, -0.36]),
    ]
    boxes = {"body": walls, "door": [box([-0.34, -0.36, 0.0], [-0.302, 0.4, 0.4])]}
    joints = {"door": door}
    parents = {"door": "body"}
    if drawer is not None:
        boxes["drawer"] = [box([-0.34, -0.36, -0.34], [0.2, 0.36, -0.04])]
        joints["drawer"], parents["drawer"] = drawer, "body"
    return make(boxes, joints, parents, scale)


DOOR_AXIS = [-0.34, -0.38, 0.2]
DRAWER = Joint([0, 0, -0.2], [-1, 0, 0], (0, 0), (0.0, 0.4))


def test_free_joints_are_left_alone_bit_for_bit():
    obj, bodies = cabinet(Joint(DOOR_AXIS, [0, 0, 1], (0, 1.4)), DRAWER)
    same, done = refine(obj, bodies)
    assert done == () and same.provenance == ()
    for a, b in zip(obj.joints, same.joints, strict=True):
        assert a.limits == b.limits and (a.origin == b.origin).all()


@pytest.mark.parametrize("scale", [1.0, 0.02, 30.0])
def test_a_range_that_ends_in_a_wall_is_drawn_in(scale):
    # the screen stands .08 to .12 beside the hinge: a door of .76 that turns by 160 degrees meets
    # it a little after 90
    obj, bodies = cabinet(Joint(DOOR_AXIS, [0, 0, 1], (0, np.deg2rad(160))), DRAWER, scale)
    better, (done,) = refine(obj, bodies)
    door = better.parts[1].joint
    assert done.part == "door" and "door" in better.provenance[-1]
    assert np.deg2rad(85) < door.limits[1] < np.deg2rad(120) and door.limits[0] == 0
    assert 0.5 < done.free_before < 0.8 and done.free_after >= done.free_before
    collider, rest = Collider(better, bodies), better.rest()
    base = collider.depths(better.forward_kinematics(rest)).get((0, 1), 0.0)
    for q in np.linspace(*door.limits, 50):
        state = rest.copy()
        state[1] = q
        depth = collider.depths(better.forward_kinematics(state)).get((0, 1), 0.0)
        assert depth - base <= 2 * DEPTH_LIMIT * scale  # between the states that refine tried


def test_a_drawer_that_goes_through_the_back_keeps_what_is_free():
    obj, bodies = cabinet(
        Joint(DOOR_AXIS, [0, 0, 1], (0, 1.4)),
        Joint([0, 0, -0.2], [-1, 0, 0], (0, 0), (-0.2, 0.4)),
    )
    better, (done,) = refine(obj, bodies)
    lo, hi = better.parts[2].joint.limits
    assert done.part == "drawer" and hi == pytest.approx(0.4)
    assert -0.075 < lo <= -0.03  # the gap to the back is .06
    assert better.parts[2].joint.type == "prismatic"


def test_a_hinge_inside_the_frame_is_moved():
    # the axis lies at the back of a thick door, whose edge then digs into the wall beside it
    walls = [box([-0.3, -0.5, -0.4], [0.3, -0.402, 0.4]), box([0.2, -0.402, -0.4], [0.3, 0.4, 0.4])]
    door = [box([-0.3, -0.4, -0.4], [-0.2, 0.4, 0.4])]
    joint = Joint([-0.275, -0.385, 0.0], [0, 0, 1], (0, 1.5))
    obj, bodies = make({"body": walls, "door": door}, {"door": joint}, {"door": "body"})
    better, (done,) = refine(obj, bodies)
    moved = np.linalg.norm(better.parts[1].joint.origin - joint.origin)
    assert done.free_before < 0.9 and done.free_after > done.free_before
    assert 0 < moved <= 0.03 + 1e-9 and done.shift == pytest.approx(moved)
    assert "axis moved" in done.line


def test_a_joint_that_is_free_nowhere_is_left_and_said():
    obj, bodies = cabinet(
        Joint(DOOR_AXIS, [0, 0, 1], (0, 1.4)),
        Joint([0, 0, -0.2], [1, 0, 0], (0, 0), (0.0, 0.4)),
    )
    same, (done,) = refine(obj, bodies)
    assert same.parts[2].joint.limits == obj.parts[2].joint.limits
    assert done.free_after < 0.2 and "left as it is" in same.provenance[-1]


def test_a_continuous_joint_that_hits_becomes_revolute_and_a_screw_keeps_its_pitch():
    walls = [
        box([-0.5, -0.5, -0.5], [0.5, 0.5, -0.4]),
        box([0.34, -0.26, -0.4], [0.42, -0.18, 0.2]),
    ]
    arm = [box([-0.05, -0.05, -0.39], [0.05, 0.45, 0.1])]
    turn = Joint([0, 0, 0], [0, 0, 1], (-np.pi, np.pi))
    obj, bodies = make({"base": walls, "arm": arm}, {"arm": turn}, {"arm": "base"})
    better, (done,) = refine(obj, bodies)
    assert better.parts[1].joint.type == "revolute" and done.free_after > 0.7
    screw = Joint([0, 0, 0], [0, 0, 1], (0, 6.0), (0, 0.06))
    obj, bodies = make({"base": walls, "arm": arm}, {"arm": screw}, {"arm": "base"})
    better, (done,) = refine(obj, bodies)
    assert better.parts[1].joint.pitch == pytest.approx(0.01)
    assert better.parts[1].joint.limits[1] < 6.0


def test_a_rack_behind_a_door_is_judged_with_the_door_open():
    boxes = {
        "body": [
            box([-0.3, -0.42, -0.4], [0.3, -0.38, 0.4]),
            box([0.26, -0.38, -0.4], [0.3, 0.4, 0.4]),
        ],
        "door": [box([-0.34, -0.36, -0.4], [-0.302, 0.4, 0.4])],
        "rack": [box([-0.28, -0.3, -0.2], [0.2, 0.3, -0.1])],
    }
    joints = {"door": Joint([-0.34, -0.38, 0], [0, 0, 1], (0, 1.5)), "rack": DRAWER}
    obj, bodies = make(boxes, joints, {"door": "body", "rack": "body"})
    same, done = refine(obj, bodies)
    assert done == () and same.parts[2].joint.limits == (0.0, 0.4)
    # a door that cannot open is in the way for good
    joints["door"] = Joint.fixed()
    obj, bodies = make(boxes, joints, {"door": "body", "rack": "body"})
    _, (one,) = refine(obj, bodies)
    assert one.part == "rack" and one.free_before < 0.2

"""What is cut so that something else can move: enough at every state, nothing where it is free."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import trimesh
from print_objects import box, drawer_box, printed

from uniart_jax.export.printing.solids import (
    block,
    grown,
    solid_of,
    turned,
    union,
    without_path,
)
from uniart_jax.objects.kinematics import Joint

TURN = Joint([0, 0, 0], [0, 0, 1], (0.0, 1.5))
ROUND = Joint([0, 0, 0], [0, 0, 1], (-np.pi, np.pi))
SLIDE = Joint([0, 0, 0], [0.6, 0.8, 0], (0.0, 0.0), (0.0, 12.0))


@pytest.mark.parametrize("joint", [TURN, ROUND, SLIDE], ids=["turn", "round", "slide"])
def test_a_mover_keeps_clear_of_what_is_left_at_every_state(joint):
    solid = block([-30, -30, 0], [30, 30, 8])
    mover = block([2, -1.5, 2], [25, 1.5, 20]) + block([20, -3, 4], [24, 3, 20])
    left = without_path(solid, mover, joint, 0.3)
    assert 0 < left.volume() < solid.volume()
    for q in np.linspace(*joint.limits, 41):
        assert turned(mover, joint.motion(q)).min_gap(left, 1.0) >= 0.29, q


def test_a_mover_of_many_triangles_cuts_its_way_all_along_a_slide():
    ribs = [block([x, -10, z], [x + 0.5, -9, z + 1]) for x in range(20) for z in range(0, 40, 8)]
    mover = union([block([0, -9, 0], [20, 9, 40]), *ribs])
    assert mover.num_tri() > 1200
    slide = Joint([0, 0, 0], [1, 0, 0], (0.0, 0.0), (0.0, 60.0))
    wall, far = block([45, -20, -10], [48, 20, 50]), block([81, -20, -10], [84, 20, 50])
    left = without_path(wall + far, mover, slide, 0.3)
    near = block([-0.2, -9.2, -0.2], [80.2, 9.2, 40.2])  # the way without the ribs
    assert (left ^ near).volume() < 1e-3
    for q in (30.3, 41.7):
        assert (turned(mover, slide.motion(q)) ^ left).volume() < 1e-6, q
    assert (left ^ far).volume() == pytest.approx(far.volume())


def test_the_tip_of_a_long_arm_is_not_missed():
    angle = np.deg2rad(5.0)
    arm = block([0, -1, 0], [255.9, 1, 4]).rotate((0, 0, 5.0))
    turn = Joint([0, 0, 0], [0, 0, 1], (0.0, 0.5))
    end = angle + 0.25
    post = block([255.7, -3, 0], [262, 3, 4]).rotate((0, 0, float(np.rad2deg(end))))
    left = without_path(post, arm, turn, 0.3)
    for q in np.linspace(0, 0.5, 51):
        assert turned(arm, turn.motion(q)).min_gap(left, 1.0) >= 0.29, q


def test_a_turn_cuts_what_is_too_near_along_its_axis():
    mover = block([2, -1.5, 2], [25, 1.5, 6])
    plates = block([-30, -30, 0], [30, 30, 1.8]) + block([-30, -30, 6.2], [30, 30, 8])
    left = without_path(plates, mover, TURN, 0.3)
    assert 0 < left.volume() < plates.volume()
    for q in np.linspace(0, 1.5, 11):
        assert turned(mover, TURN.motion(q)).min_gap(left, 1.0) >= 0.29, q


def test_nothing_is_cut_where_a_turn_does_not_come_near():
    solid = block([-30, -30, 0], [30, -1, 8])
    mover = block([2, 0, 2], [25, 1.5, 20])
    assert without_path(solid, mover, TURN, 0.3).volume() == solid.volume()


def test_growing_reaches_as_far_as_is_asked():
    ball = block([-5, -5, -5], [5, 5, 5]).refine(40)  # too many triangles for an exact sum
    assert grown(ball, 0.3).volume() == pytest.approx(10.6**3, rel=0.03)
    assert (grown(ball, 0.3) ^ ball).volume() == pytest.approx(1000)


def test_shells_that_nearly_touch_are_one_solid():
    two = trimesh.util.concatenate([box([0, 0, 0], [5, 5, 5]), box([5.03, 0, 0], [9, 5, 5])])
    solid, hulls = solid_of(np.array(two.vertices), np.array(two.faces))
    assert len(solid.decompose()) == 1 and hulls == 0


def test_an_open_shell_is_closed_or_replaced_by_its_hull_and_counted():
    mesh = box([0, 0, 0], [5, 5, 5])
    solid, hulls = solid_of(np.array(mesh.vertices), np.array(mesh.faces[:10]))
    assert hulls == 0 and solid.volume() == pytest.approx(125)  # the hole was filled
    solid, hulls = solid_of(np.array(mesh.vertices), np.array(mesh.faces[[0, 1, 4, 5]]))
    assert hulls > 0 and 0 < solid.volume() <= 130


def test_a_drawer_within_a_solid_gets_room_and_it_is_told():
    drawers = drawer_box()
    full = dataclasses.replace(drawers.parts[0], mesh=box([-0.4, -0.3, 0.0], [0.4, 0.3, 0.5]))
    made = printed(dataclasses.replace(drawers, parts=(full, drawers.parts[1])))
    assert any("of 'case' were cut away so that 'drawer' can move" in n for n in made.notes)
    (joint,) = made.joints
    case, drawer = (p.solid for p in made.pieces)
    for q in np.linspace(*joint.joint.limits, 7):
        assert (turned(drawer, joint.joint.motion(q)) ^ case).volume() < 1e-3

"""Parts told at rest, put where a picture shows them."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.shown_state import at_shown, moved_revolution

BODY = {"name": "body", "parent": None, "box": {"center": [0, 0, 0.2], "size": [0.4, 0.6, 0.4]}}
DRAWER = {
    "name": "drawer",
    "parent": "body",
    "box": {"center": [-0.05, 0, 0.2], "size": [0.3, 0.5, 0.2]},
    "joint": {"direction": [-1, 0, 0], "travel": [0, 0.25]},
}
KNOB = {
    "name": "knob",
    "parent": "drawer",
    "box": {"center": [-0.22, 0.1, 0.2], "size": [0.04, 0.04, 0.04]},
    "joint": {"direction": [-1, 0, 0], "angle": [0, 6.28]},
    "revolution": {"axis": "x"},
}
LID = {
    "name": "lid",
    "parent": "body",
    "box": {"center": [0, 0, 0.42], "size": [0.4, 0.6, 0.04]},
    "joint": {"origin": [0.2, 0, 0.4], "direction": [0, 1, 0], "angle": [0, 1.5]},
    "shape": "box",
}


def read(*parts, **more):
    return Layout.from_json(json.dumps({"schema": 1, "units": "m", "parts": list(parts), **more}))


def told(part, **changes):
    return part | {"joint": part["joint"] | changes}


def test_a_drawer_that_is_told_closed_and_shown_open_takes_its_knob_along():
    closed, shown = read(BODY, DRAWER, KNOB), read(BODY, told(DRAWER, shown=0.1), KNOB)
    moved = shown.boxes - closed.boxes
    np.testing.assert_allclose(moved[:, 0], [0, -0.1, -0.1], atol=1e-12)
    np.testing.assert_allclose(np.delete(moved, 0, 1), 0, atol=1e-12)
    np.testing.assert_allclose(shown.joints[1].travel, (-0.1, 0.15))
    np.testing.assert_allclose(shown.joints[2].origin[0], closed.joints[2].origin[0] - 0.1)
    assert shown.joints[2].type == "continuous"
    np.testing.assert_allclose(shown.revolutions[2].center, closed.revolutions[2].center)


def test_a_lid_that_is_shown_open_has_the_box_around_it_and_counts_its_angle_from_there():
    lid = read(BODY, told(LID, shown=0.5)).boxes[1]
    turn = 0.5
    corners = np.array([[x, z] for x in (-0.4, 0) for z in (0, 0.04)])
    cos, sin = np.cos(turn), np.sin(turn)
    there = corners @ np.array([[cos, -sin], [sin, cos]]) + [0.2, 0.4]
    np.testing.assert_allclose(lid[[3, 5]], np.ptp(there, axis=0), atol=1e-9)
    np.testing.assert_allclose(lid[[0, 2]], (there.min(0) + there.max(0)) / 2, atol=1e-9)
    joint = read(BODY, told(LID, shown=0.5)).joints[1]
    np.testing.assert_allclose(joint.angle, (-0.5, 1.0))
    own = read(BODY, told(LID, shown=0.5)).boards[1]
    np.testing.assert_allclose(own.boxes, [[-0.2, -0.3, 0.4, 0.2, 0.3, 0.44]], atol=1e-9)


def test_boards_of_an_open_drawer_come_along():
    own = read(BODY, told(DRAWER, shown=0.1) | {"shape": "box"}).boards[1]
    np.testing.assert_allclose(own.boxes, [[-0.3, -0.25, 0.1, 0.0, 0.25, 0.3]], atol=1e-9)


def test_a_tilted_part_has_no_outline_and_one_that_turns_about_it_keeps_it():
    pot = LID | {"revolution": {"axis": "z"}}
    del pot["shape"]
    assert not read(BODY, told(pot, shown=0.5)).revolutions
    outline = read(BODY, pot).revolutions[1]
    spin = Joint(np.array([0.1, 0.2, 0]), np.array([0, 0, 1.0]), angle=(0, 2.0)).motion(0.7)
    moved = moved_revolution(outline, spin)
    expected = spin[:2, :2] @ outline.center + spin[:2, 3]
    np.testing.assert_allclose(moved.center, expected, atol=1e-12)


@settings(max_examples=30, deadline=None)
@given(st.floats(-1, 1), st.floats(-1, 1), st.integers(0, 2))
def test_points_of_a_part_are_where_its_motion_and_its_parents_take_them(first, second, axis):
    joints = [
        Joint.fixed(),
        Joint(np.array([0.1, 0, 0.2]), np.eye(3)[axis], angle=(-1.0, 1.0)),
        Joint(np.zeros(3), np.eye(3)[(axis + 1) % 3], travel=(-1.0, 1.0)),
    ]
    boxes = np.array([[0, 0, 0, 1, 1, 1], [0.2, 0, 0, 0.2, 0.1, 0.1], [0.3, 0.1, 0, 0.1, 0.1, 0.2]])
    found, moved, moves = at_shown(boxes, joints, [-1, 0, 1], [0, first, second])
    whole = joints[1].motion(first) @ joints[2].motion(second)
    np.testing.assert_allclose(moves[2], whole, atol=1e-12)
    middle = whole[:3, :3] @ boxes[2, :3] + whole[:3, 3]
    np.testing.assert_allclose(found[2, :3], middle, atol=1e-9)
    # the joint that is counted from what is shown brings the part back to rest
    back = moved[2].motion(-second)
    rest = joints[1].motion(first)
    np.testing.assert_allclose(back @ whole, rest, atol=1e-9)


@pytest.mark.parametrize(
    ("shown", "problem"),
    [
        (2.0, "part 1: joint: shown 2 is not within angle"),
        ("wide", "part 1: joint: shown must be 1 finite numbers"),
    ],
)
def test_what_cannot_be_shown_is_named(shown, problem):
    with pytest.raises(ValueError, match=problem):
        read(BODY, told(LID, shown=shown))


def test_a_whole_turn_that_was_rounded_is_one():
    for turn in ([0, 6.28], [-3.14, 3.14], [0, 6.283]):
        assert read(BODY, told(KNOB, angle=turn) | {"parent": 0}).joints[1].type == "continuous"
    assert read(BODY, told(KNOB, angle=[0, 6.2]) | {"parent": 0}).joints[1].type == "revolute"


def test_what_turns_without_end_may_be_shown_at_any_angle():
    joint = read(BODY, told(KNOB, shown=4.1) | {"parent": 0}).joints[1]
    assert joint.type == "continuous"


def test_a_size_goes_with_object_units():
    parts = [BODY, LID]
    text = json.dumps({"schema": 1, "units": "object", "size": 0.8, "parts": parts})
    layout = Layout.from_json(text)
    assert layout.size == 0.8 and Layout.from_json(layout.to_json()).size == 0.8
    for units, size in (("m", 0.8), ("object", 500)):
        with pytest.raises(ValueError, match='give metres, with units "object" alone'):
            Layout.from_json(
                json.dumps({"schema": 1, "units": units, "size": size, "parts": parts})
            )


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"shape": "ball"}, "part 1: shape 'ball'; give \"box\""),
        ({"shape": "box", "revolution": {"axis": "z"}}, "goes without boards, revolution, tube"),
    ],
)
def test_shapes_are_checked(changes, problem):
    with pytest.raises(ValueError, match=problem):
        read(BODY, LID | changes)


def test_an_outline_without_numbers_is_a_cylinder_that_fills_the_box():
    own = read(BODY, KNOB | {"parent": 0}).revolutions[1]
    np.testing.assert_allclose(own.center, [0.1, 0.2])
    np.testing.assert_allclose(own.radii, [0.02])
    with pytest.raises(ValueError, match="no entry 'radius'"):
        read(BODY, KNOB | {"parent": 0, "revolution": {"axis": "x", "radius": 0.1}})


def test_a_flat_part_that_is_shown_turned_is_a_plate():
    lid = {name: value for name, value in LID.items() if name != "shape"}
    assert not read(BODY, lid).boards
    own = read(BODY, told(lid, shown=0.5)).boards[1]
    np.testing.assert_allclose(own.boxes, [[-0.2, -0.3, 0.4, 0.2, 0.3, 0.44]], atol=1e-9)
    joint = Joint(np.array([0.2, 0, 0.4]), (0, 1.0, 0), angle=(0.0, 1.5))
    np.testing.assert_allclose(own.motion, joint.motion(0.5), atol=1e-9)
    thick = lid | {"box": {"center": [0, 0, 0.5], "size": [0.4, 0.6, 0.2]}}
    assert not read(BODY, told(thick, shown=0.5)).boards
    again = Layout.from_json(read(BODY, told(lid, shown=0.5)).normalized()[0].to_json())
    scaled = read(BODY, told(lid, shown=0.5)).normalized()[0].boards[1]
    np.testing.assert_allclose(again.boards[1].motion, scaled.motion, atol=1e-6)
    assert not read(BODY, told(lid | {"revolution": {"axis": "z"}}, shown=0.5)).boards


@pytest.mark.parametrize("outline", [None, {"axis": "z"}])
def test_what_is_round_about_the_axis_that_it_turns_about_keeps_its_box(outline):
    spin = {"direction": [0, 0, 1], "angle": [0, 6.28], "shown": 0.785}
    box = {"center": [0, 0, 0.45], "size": [0.6, 0.6, 0.1]}
    disc = {"name": "disc", "parent": "body", "box": box, "joint": spin, "revolution": outline}
    np.testing.assert_allclose(read(BODY, disc).boxes[1], [0, 0, 0.45, 0.6, 0.6, 0.1], atol=1e-9)
    lid = told(LID, shown=0.5)  # on a lid that stands open its box is the one around it
    knob = disc | {"parent": "lid", "box": box | {"size": [0.1, 0.1, 0.1]}}
    assert read(BODY, lid, knob).boxes[2, 5] == pytest.approx(0.1 * (np.cos(0.5) + np.sin(0.5)))


def test_radii_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match=r"a radius of 5 does not fit into its box; 0\.02 is half"):
        read(BODY, KNOB | {"parent": 0, "revolution": {"axis": "x", "radii": [5]}})


def test_a_lever_that_is_shown_turned_is_drawn_where_it_is():
    lever = told(LID, angle=[-0.5, 0.5], shown=0.3)
    own = read(BODY, lever).boards[1]
    joint = Joint(np.array([0.2, 0, 0.4]), (0, 1.0, 0), angle=(-0.5, 0.5))
    np.testing.assert_allclose(own.motion, joint.motion(0.3), atol=1e-9)
    handle = {"name": "handle", "parent": "lid", "shape": "box",
              "box": {"center": [-0.1, 0, 0.46], "size": [0.05, 0.2, 0.04]}}  # fmt: skip
    own = read(BODY, lever, handle).boards[2]
    np.testing.assert_allclose(own.motion, joint.motion(0.3), atol=1e-9)

"""Layouts as tables and as JSON, and the tree that is read off a network's pointer."""

import dataclasses
import json

import numpy as np
import pytest
import trimesh

from uniart_jax import procedural
from uniart_jax.data.legs import legs_of
from uniart_jax.data.panels import boards_of, panels_of
from uniart_jax.evaluation.parts import compare_parts
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.voxels.joint_code import box_corners, encode_joint, encode_object
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.read_layout import read_layout


def outputs_of(obj, queries=16, order=None):
    """What a network without error would say of an object: its parts on rows ``order`` of
    ``queries``."""
    boxes, codes, parents = encode_object(obj)
    rows = np.arange(len(boxes)) if order is None else np.asarray(order)
    out = {
        "corners": np.zeros((queries, 6)),
        "codes": np.zeros((queries, 9)),
        "exists": np.full(queries, -9.0),
        "colors": np.full((queries, 3), 0.5),
        "parents": np.zeros((queries, queries)),
        "camera": np.array([0, 1, 0.4, 1.6, 0.3, 0, 0]),
    }
    out["corners"][rows, :3] = boxes[:, :3] - boxes[:, 3:] / 2
    out["corners"][rows, 3:] = boxes[:, :3] + boxes[:, 3:] / 2
    out["codes"][rows], out["exists"][rows] = codes, 9.0
    out["parents"][rows, rows[parents]] = 9.0
    return out


@pytest.mark.parametrize("family", ["oven", "storage_furniture"])
def test_reads_the_truth_whatever_rows_hold_it(family):
    obj = procedural.generate(family, 3)
    order = np.random.default_rng(0).permutation(16)[: len(obj.parts)]
    layout = read_layout(outputs_of(obj, order=order))
    scores = compare_parts(layout.to_object(), obj)
    assert len(layout) == len(obj.parts)
    assert scores.right.all() and scores.tree_right


BODY, KNOB = (0, 0, 0, 0.8, 0.8, 0.8), (-0.42, 0.2, 0.3, 0.05, 0.06, 0.06)
FRONT = np.array([0, 1, 0.3, 1.5, 0.4, 0, 0])  # the code of a camera in front, a little above


def knob_read(angle=(0, 0), box=KNOB, direction=(1, 0, 0), travel=(0, 0), eye=FRONT):
    """The joint that is read of a part on a body, whose limits a network says (radians, units)."""
    parts = [Part("body", trimesh.creation.box(BODY[3:]))]
    mesh = trimesh.creation.box(box[3:]).apply_translation(box[:3])
    joint = Joint(box[:3], direction, angle=angle, travel=travel)
    parts.append(Part("part", mesh, 0, joint))
    out = outputs_of(ArticulatedObject(tuple(parts)))
    return read_layout(out | {"camera": eye}).joints[1]


@pytest.mark.parametrize("direction", [(1, 0, 0), (-1, 0, 0)])
@pytest.mark.parametrize("angle", [(-2.2, 1.9), (-4.1, 0), (0, 4.1)])
def test_a_knob_turns_clockwise(direction, angle):
    """For who looks at it: about the direction that leads away from the camera."""
    joint = knob_read(angle, direction=direction)
    low, high = sorted(np.array(joint.angle) * joint.direction[0])
    assert (low, high) == pytest.approx((0, 4.1), abs=1e-3)


@pytest.mark.parametrize("direction", [(1, 0, 0), (-1, 0, 0)])
@pytest.mark.parametrize("angle", [(-1.0, 3.1), (-3.1, 1.0)])
def test_a_knob_that_is_partly_on_keeps_its_state_or_is_mirrored(angle, direction):
    """To the clockwise side; a knob that is more than half way on is not told from its mirror.

    Its stop is the lower end."""
    joint = knob_read(angle, direction=direction)
    assert joint.angle == pytest.approx((-1.0, 3.1), abs=1e-3)
    assert joint.direction[0] > 0.999


@pytest.mark.parametrize("eye", [np.zeros(7), np.full(7, np.nan)])
def test_without_a_camera_the_outside_is_away_from_the_parent(eye):
    joint = knob_read((-4.1, 0), eye=eye)
    assert joint.angle == pytest.approx((0, 4.1), abs=1e-3) and joint.direction[0] > 0.999


def test_a_small_lid_opens_as_it_is_read():
    """Its hinge is at its edge, so it is no knob."""
    parts = [Part("body", trimesh.creation.box(BODY[3:]))]
    box = (-0.42, 0.2, 0.3, 0.02, 0.12, 0.12)
    mesh = trimesh.creation.box(box[3:]).apply_translation(box[:3])
    parts.append(Part("lid", mesh, 0, Joint((-0.42, 0.2, 0.24), (0, 1, 0), angle=(-2.6, 0.0))))
    joint = read_layout(outputs_of(ArticulatedObject(tuple(parts)))).joints[1]
    assert sorted(np.array(joint.angle) * joint.direction[1]) == pytest.approx([-2.6, 0], abs=1e-3)


DOOR = (-0.42, 0.1, 0.0, 0.04, 0.4, 0.6)


@pytest.mark.parametrize(("y", "found"), [(0.32, 0.3), (0.28, 0.3), (-0.115, -0.1), (0.2, 0.2)])
def test_the_hinge_of_a_plate_is_at_its_edge_if_it_is_near_it(y, found):
    parts = [Part("body", trimesh.creation.box(BODY[3:]))]
    mesh = trimesh.creation.box(DOOR[3:]).apply_translation(DOOR[:3])
    hinge = Joint((-0.43, y, 0.1), (0, 0, 1), angle=(0.0, 1.5))
    obj = ArticulatedObject((*parts, Part("door", mesh, 0, hinge)))
    joint = read_layout(outputs_of(obj)).joints[1]
    off = joint.origin - (-0.43, found, joint.origin[2])
    np.testing.assert_allclose(off, 0, atol=2e-3)
    assert joint.type == "revolute" and joint.direction @ (0, 0, 1) > 0.999


@pytest.mark.parametrize(
    ("length", "found"), [(0.04, "fixed"), (0.12, "revolute"), (0.45, "revolute")]
)
def test_a_short_axis_is_one_and_passes_its_part(length, found):
    """As of a door of which a network cannot tell on which side its hinge is."""
    parts = [Part("body", trimesh.creation.box(BODY[3:]))]
    mesh = trimesh.creation.box((0.03, 0.5, 0.6)).apply_translation((-0.4, 0, 0))
    hinge = Joint((-0.4, 0.25, 0.1), (0.02, 0.05, 1), angle=(0, 1.5))
    parts.append(Part("door", mesh, 0, hinge))
    out = outputs_of(ArticulatedObject(tuple(parts)))
    code = out["codes"][1]
    out["codes"][1] = np.concatenate([code[:1], length * code[1:4], 0.6 * code[4:7], code[7:]])
    joint = read_layout(out).joints[1]
    assert joint.type == found
    if found == "revolute":
        assert (np.abs(joint.direction) == [0, 0, 1]).all()
        np.testing.assert_allclose(joint.origin[:2], [-0.4, 0.25], atol=0.03)


def test_a_lever_that_turns_about_its_thickness_and_a_slanted_door_stay():
    lever = knob_read((-0.5, 0.5), (-0.42, 0.1, 0.2, 0.02, 0.3, 0.03), (1, 0, 0))
    np.testing.assert_allclose(lever.origin[1:], (0.1, 0.2), atol=2e-3)
    parts = [Part("body", trimesh.creation.box(BODY[3:]))]
    mesh = trimesh.creation.box((0.02, 0.3, 0.03)).apply_translation((-0.42, 0.1, 0.2))
    for axis, at in (((1, 0, 0), (-0.42, 0.231, 0.2)), ((0, 0.4, 0.9165), (-0.42, 0.231, 0.2))):
        joint = Joint(at, axis, angle=(0.0, 1.0))
        found = read_layout(outputs_of(ArticulatedObject((*parts, Part("p", mesh, 0, joint)))))
        off = np.cross(found.joints[1].origin - at, np.array(axis, float))
        np.testing.assert_allclose(off, 0, atol=3e-3)


def test_the_hinge_of_a_block_stays():
    joint = knob_read((0, 1.0), (-0.4, 0.1, 0.2, 0.3, 0.4, 0.3), (0, 0, 1))
    np.testing.assert_allclose(joint.origin[:2], (-0.4, 0.1), atol=2e-3)


def test_a_knob_on_the_top_turns_clockwise_too():
    joint = knob_read((-2.2, 2.3), (0.1, 0.1, 0.42, 0.06, 0.06, 0.05), (0, 0, 1))
    low, high = sorted(np.array(joint.angle) * joint.direction[2])
    assert (low, high) == pytest.approx((-4.5, 0), abs=1e-3)


def test_a_knob_at_the_back_is_seen_from_the_front():
    """On a panel that stands up behind a cooktop, farther back than the body's centre."""
    joint = knob_read((-2.2, 1.9), (0.38, 0.2, 0.42, 0.02, 0.06, 0.06))
    low, high = sorted(np.array(joint.angle) * joint.direction[0])
    assert (low, high) == pytest.approx((0, 4.1), abs=1e-3)


def test_a_slide_half_way_between_two_turns_is_a_turn():
    """tau = 1 lies between the turn to one side (tau = 0) and to the other (tau = 2)."""
    joint = knob_read(travel=(0.0, 4.1 / np.pi / 4))
    low, high = sorted(np.array(joint.angle) * joint.direction[0])
    assert joint.type == "revolute" and (low, high) == pytest.approx((0, 4.1), abs=1e-3)
    assert joint.origin == pytest.approx(KNOB[:3], abs=1e-3)


@pytest.mark.parametrize(
    ("box", "direction", "travel"),
    [
        (KNOB, (0, 0, 1), (0, 0.3)),  # a lever that slides along the body's front
        (KNOB, (1, 0, 0), (0, 0.05)),  # a button
        (KNOB, (1, 0, 0), (0, 0.19)),  # as far as a turn that no knob has
        ((-0.42, 0, 0.2, 0.05, 0.6, 0.2), (1, 0, 0), (-0.3, 0)),  # a drawer
    ],
)
def test_other_slides_stay(box, direction, travel):
    joint = knob_read(box=box, direction=direction, travel=travel)
    assert joint.type == "prismatic"
    slide = sorted(np.array(joint.travel) * (joint.direction @ direction))
    np.testing.assert_allclose(slide, travel, atol=1e-3)


@pytest.mark.parametrize(
    ("angle", "box"),
    [
        ((-1.0, 3.0), KNOB),  # the picture shows where it points
        ((0.0, 4.0), KNOB),
        ((-1.0, 1.0), KNOB),  # a lever
        ((-1.6, 1.6), (-0.42, 0, 0, 0.05, 0.6, 0.6)),  # a door
    ],
)
def test_other_turns_are_as_they_are_read(angle, box):
    joint = knob_read(angle, box)
    turn = sorted(np.array(joint.angle) * joint.direction[0])
    np.testing.assert_allclose(turn, angle, atol=1e-3)


def test_a_doubtful_pointer_still_gives_a_tree_with_one_root():
    obj = procedural.generate("oven", 3)
    out = outputs_of(obj)
    rng = np.random.default_rng(1)
    for _ in range(20):
        out["parents"] = rng.normal(size=(16, 16))
        out["exists"] = rng.normal(size=16)
        layout = read_layout(out)
        assert sum(parent < 0 for parent in layout.parents) == 1
        layout.to_object()  # refuses circles and second roots


def test_revolutions_are_those_of_the_rows_of_their_parts():
    """The last two parts', on rows that others who do not exist lie between."""
    obj = procedural.generate("oven", 3)
    order = np.arange(len(obj.parts)) * 2 + 1
    out = outputs_of(obj, queries=2 * len(order) + 1, order=order)
    count = len(out["exists"])
    out["round_axis"] = np.tile([5.0, 0, 0, 0], (count, 1))
    out["round_axis"][order[-2:], [1, 3]] = 9.0
    out["round_centers"] = np.zeros((count, 3, 2))
    out["round_radii"] = np.tile(np.arange(1.0, count + 1)[:, None, None] / 100, (1, 3, 8))
    found = read_layout(out).revolutions
    assert [None if one is None else one.axis for one in found[-2:]] == [0, 2]
    assert not any(found[:-2])
    assert [one.radii[0] for one in found[-2:]] == pytest.approx((order[-2:] + 1) / 100)
    assert read_layout(outputs_of(obj)).revolutions == ()


def test_nothing_above_the_threshold_leaves_the_surest_row():
    out = outputs_of(procedural.generate("oven", 3))
    out["exists"] -= 100.0
    out["exists"][5] = -3.0
    layout = read_layout(out)
    assert len(layout) == 1 and layout.parents == (-1,) and layout.joints[0].type == "fixed"


def test_json_round_trip():
    obj = procedural.generate("washer", 5)
    layout = Layout.of_object(obj)
    again = Layout.from_json(layout.to_json())
    assert np.allclose(again.boxes, layout.boxes, atol=1e-5)
    assert again.parents == layout.parents
    assert [j.type for j in again.joints] == [j.type for j in layout.joints]
    assert np.allclose(again.colors, layout.colors, atol=1e-4)
    assert again.legs is None and again.certainty is None
    sure = Layout.from_json(dataclasses.replace(layout, certainty=0.625).to_json())
    assert sure.certainty == 0.625 and "certainty 0.62" in repr(sure)
    legs = legs_of(procedural.generate("table", 5))
    with_legs = Layout.from_json(dataclasses.replace(layout, legs=legs).to_json())
    assert len(legs) and np.allclose(with_legs.legs.lower, legs.lower, atol=1e-5)
    assert with_legs.legs.alone == legs.alone
    panels = panels_of(obj)
    with_panels = Layout.from_json(dataclasses.replace(layout, panels=panels).to_json())
    assert len(panels) and np.allclose(with_panels.panels.boxes, panels.boxes, atol=1e-5)
    assert with_panels.panels.share == pytest.approx(panels.share, abs=1e-4)
    assert again.panels is None and with_panels.legs is None
    assert again.boards == () == with_panels.boards


def test_boards_go_through_json_with_their_parts():
    obj = procedural.generate("storage_furniture", 3)
    boards = tuple(boards_of(obj))
    assert boards[0] is None and max(len(own) for own in boards if own) > 1
    layout = dataclasses.replace(Layout.of_object(obj), boards=boards)
    again = Layout.from_json(layout.to_json()).boards
    for one, other in zip(boards, again, strict=True):
        if one is None or not len(one):
            assert other is None
            continue
        np.testing.assert_allclose(other.boxes, one.boxes, atol=1e-5)
        assert other.share == pytest.approx(one.share, abs=1e-4)


def test_boards_of_a_network_are_those_of_parts_that_move_and_are_not_narrow():
    """Rows: body, thin door, what is not there, a narrow bar that moves, a drawer that is no set
    of boards, a board that does not move, a knob."""
    boxes = np.array(
        [
            [0, 0, 0, 0.9, 0.9, 0.9],
            [-0.3, 0, 0.2, 0.02, 0.6, 0.2],
            [0, 0, 0, 0.3, 0.3, 0.3],
            [-0.5, 0, 0.2, 0.04, 0.6, 0.04],
            [-0.3, 0, -0.2, 0.4, 0.6, 0.2],
            [0.3, 0, -0.2, 0.4, 0.6, 0.2],
            [-0.5, 0.3, 0.3, 0.1, 0.2, 0.2],
        ]
    )
    knob = Joint(boxes[6, :3], np.array([1.0, 0, 0]), angle=(-np.pi, np.pi))
    slide = encode_joint(Joint(np.zeros(3), np.array([-1.0, 0, 0]), travel=(0, 0.3)), boxes[1, :3])
    fixed = [encode_joint(Joint.fixed(), box[:3]) for box in boxes[[0, 5]]]
    turn = encode_joint(knob, boxes[6, :3])
    codes = np.stack([fixed[0], *[slide] * 4, fixed[1], turn])
    parents = np.full((7, 7), -9.0)
    parents[:, 0] = 9
    exists = np.full((7, 3), 5.0)
    exists[1, 2] = -5
    rows = np.random.default_rng(0).uniform(-0.4, 0.4, (7, 3, 6))
    outputs = {
        "corners": box_corners(boxes), "codes": codes, "exists": np.array([9.0, 9, -9, 9, 9, 9, 9]),
        "colors": np.full((7, 3), 0.5), "parents": parents, "camera": np.zeros(7),
        "board_rows": rows, "board_exists": exists,
        "board_share": np.array([1, 0.9, 1, 1, 0.3, 1, 1]),
    }  # fmt: skip
    layout = read_layout(outputs)
    assert len(layout) == 6 and layout.certainty is None
    assert read_layout(outputs | {"certainty": np.float64(0.7)}).certainty == 0.7
    assert [own is None for own in layout.boards] == [True, False, True, True, True, True]
    own = layout.boards[1]
    assert len(own) == 2 and own.share == pytest.approx(0.9)
    np.testing.assert_allclose(
        (own.boxes[:, :3] + own.boxes[:, 3:]) / 2, (rows[1, :2, :3] + rows[1, :2, 3:]) / 2
    )
    assert read_layout({k: v for k, v in outputs.items() if "board" not in k}).boards == ()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d.update(schema=2), "schema"),
        (lambda d: d["parts"][1].update(parent=99), "part 1: parent 99"),
        (lambda d: d["parts"][1].update(parent=None), "2 parts without a parent"),
        (lambda d: d["parts"][0].update(parent=1), "0 parts without a parent"),
        (lambda d: d["parts"][1].update(parent=1), "part 1: its parents go in a circle"),
        (lambda d: d["parts"][1]["box"].update(size=[0.1, 0, 0.1]), "part 1: size"),
        (lambda d: d["parts"][1]["box"].update(center=[0.1, float("nan"), 0]), "part 1: center"),
        (lambda d: d["parts"][1]["joint"].update(angle=[0.5, 1.0]), "part 1: joint"),
        (lambda d: d["parts"][1].update(confidence=2), "part 1: confidence"),
        (lambda d: d["parts"].clear(), "parts"),
        (lambda d: d.update(camera=[0] * 7), "camera's first two numbers"),
        (lambda d: d.update(certainty=1.5), "layout: certainty 1.5 is not in 0..1"),
        (lambda d: d.update(certainty="much"), "layout: certainty 'much' is not in 0..1"),
        (lambda d: d.update(legs={"rows": [{}]}), "leg 0: lower must be 4 numbers"),
        (lambda d: d.update(panels={"rows": [{}]}), "panel 0: lower must be 3 numbers"),
        (
            lambda d: d["parts"][1].update(boards={"rows": [{}]}),
            "layout: part 1: board 0: lower must be 3 numbers",
        ),
        (lambda d: d["parts"][1].update(boards=[]), "part 1: boards must be null or have a list"),
    ],
)
def test_bad_tables_are_refused_in_one_line(change, words):
    data = json.loads(Layout.of_object(procedural.generate("oven", 3)).to_json())
    change(data)
    with pytest.raises(ValueError, match=words) as caught:
        Layout.from_json(json.dumps(data))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["{", "[" * 200_000])
def test_what_is_no_json_is_one_line(text):
    with pytest.raises(ValueError, match=r"^layout: not valid JSON") as caught:
        Layout.from_json(text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("direction", [(1, 0, 0), (-1, 0, 0), (0, 0, 1), (0, -1, 0)])
@pytest.mark.parametrize("share", [0.3, 0.7])
def test_a_rack_behind_an_open_door_is_closed_in_its_body(direction, share):
    """The door reaches as far as the rack, so the object is as large at both ends."""
    way = np.array(direction, float)
    side = np.abs(way)
    shapes = [
        (0 * way, (0.6, 0.6, 0.6)),
        (0.6 * way, 0.5 + 0.1 * side),  # an open door, in front of its body
        ((0.35 * share) * way, 0.4 - 0.05 * side),
    ]
    joints = [
        Joint.fixed(),
        Joint(0.3 * way, np.roll(side, 1), angle=(-1.5, 0)),
        Joint(np.zeros(3), way, travel=(-0.35 * share, 0.35 * (1 - share))),
    ]
    parts = [
        Part(name, trimesh.creation.box(size).apply_translation(at), up, joint)
        for name, (at, size), up, joint in zip(
            ("body", "door", "rack"), shapes, (-1, 0, 0), joints, strict=True
        )
    ]
    obj = read_layout(outputs_of(ArticulatedObject(tuple(parts)).normalized())).to_object()
    rack = next(k for k, joint in enumerate(obj.joints) if joint.type == "prismatic")
    closed = obj.shown_at(obj.rest())
    inside = closed.boxes[rack, :3] - closed.boxes[0, :3]
    assert np.abs(inside).max() < 0.02
    assert obj.joints[rack].direction @ way > 0.99

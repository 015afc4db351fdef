"""Golden cases, invariances and monotone figures for parts, joints and trees."""

import dataclasses
import itertools
import math
from collections import Counter

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from uniart_jax import procedural
from uniart_jax.evaluation.articulation import METRICS, confusion, measure
from uniart_jax.evaluation.metric import at_rest
from uniart_jax.objects.kinematics import Joint, rotation
from uniart_jax.objects.object import ArticulatedObject, Part

PERFECT = {name: float(metric.better == "higher") for name, metric in METRICS.items()}
DOOR = Joint([-0.25, 0.5, 0], [0, 0, 1], angle=(0, 1.5))
DRAWER = Joint([0, 0, 0], [-1, 0, 0], travel=(0, 0.3))


def box(size, center):
    return trimesh.creation.box(size, trimesh.transformations.translation_matrix(center))


def cabinet(door: Joint = DOOR, drawer: Joint = DRAWER) -> ArticulatedObject:
    """A body, a door with a fixed handle on it, a drawer; longest side 1."""
    return ArticulatedObject(
        (
            Part("body", box((0.5, 1, 1), (0.05, 0, 0))),
            Part("door", box((0.04, 1, 0.5), (-0.25, 0, 0.25)), 0, door),
            Part("handle", box((0.04, 0.04, 0.2), (-0.29, -0.4, 0.25)), 1, Joint.fixed()),
            Part("drawer", box((0.04, 1, 0.4), (-0.25, 0, -0.25)), 0, drawer),
        )
    )


def bottle(turn: float, travel: float) -> ArticulatedObject:
    cap = Joint(
        [0, 0, 0],
        [0, 0, 1],
        (min(turn, 0), max(turn, 0)),
        (min(turn, 0) / turn * travel, max(turn, 0) / turn * travel),
    )
    parts = (
        Part("body", box((0.4, 0.4, 0.8), (0, 0, -0.1))),
        Part("cap", box((0.2, 0.2, 0.2), (0, 0, 0.4)), 0, cap),
    )
    return ArticulatedObject(parts)


def without(obj: ArticulatedObject, name: str) -> ArticulatedObject:
    """A leaf less."""
    gone = obj.index(name)
    kept = [p for p in obj.parts if p.name != name]
    return dataclasses.replace(
        obj,
        parts=tuple(dataclasses.replace(p, parent=p.parent - (p.parent > gone)) for p in kept),
    )


def replaced(obj: ArticulatedObject, name: str, **changes) -> ArticulatedObject:
    return dataclasses.replace(
        obj,
        parts=tuple(
            dataclasses.replace(p, **changes) if p.name == name else p for p in obj.parts
        ),
    )  # fmt: skip


def check(pred: ArticulatedObject, ref: ArticulatedObject, **expected) -> None:
    """The figures named have these values, every other one is perfect."""
    figures = measure(pred, ref)
    assert set(figures) == set(METRICS)
    for name, value in {**PERFECT, **expected}.items():
        if value is not ...:
            assert figures[name] == pytest.approx(value, abs=1e-9, nan_ok=True), name


@pytest.mark.parametrize(
    "family",
    [
        *procedural.SEEN_FAMILIES,
        *(pytest.param(f, marks=pytest.mark.slow) for f in procedural.FAMILIES[7:]),
    ],
)
def test_every_family_against_itself_is_perfect(family):
    obj = at_rest(procedural.generate(family, 1))
    moving = [p.joint for p in obj.parts if p.joint.type != "fixed"]
    nothing = (
        {} if any(j.rotates for j in moving) else {"pivot": math.nan, "pivot_at_part": math.nan}
    )
    assert moving
    check(obj, obj, **nothing)
    table = confusion(obj, obj)
    assert table == {(t, t): n for t, n in Counter(j.type for j in obj.joints).items()}


def test_a_door_that_opens_inwards():
    """One of two joints is 180 degrees off: mean and median 90."""
    inwards = Joint(DOOR.origin, DOOR.direction, angle=(-1.5, 0))
    check(
        cabinet(inwards), cabinet(),
        axis_mean=90, axis_median=90, wrong_way=0.5, range_iou=0.5, parts_right=0.5, all_right=0,
    )  # fmt: skip
    same = Joint([-0.25, 0.5, 0.7], -DOOR.direction, angle=(-1.5, 0))  # another way to write DOOR
    check(cabinet(same), cabinet())


def test_a_drawer_that_goes_into_the_wall():
    backwards = Joint([0, 0, 0], [1, 0, 0], travel=(0, 0.3))
    check(
        cabinet(drawer=backwards), cabinet(),
        axis_mean=90, axis_median=90, wrong_way=0.5, range_iou=0.5, parts_right=0.5, all_right=0,
    )  # fmt: skip


@pytest.mark.parametrize("degrees", [5, 12, 80, 100, 170])
def test_tilted_axes(degrees):
    """In the door's plane, about the hinge's middle: the lines cross there, .25 below the middle of
    the door."""
    a = np.radians(degrees)
    tilted = Joint(DOOR.origin, [0, np.sin(a), np.cos(a)], angle=(0, 1.5))
    wrong = degrees > 90
    check(
        cabinet(tilted), cabinet(),
        axis_mean=degrees / 2, axis_median=degrees / 2, wrong_way=wrong / 2, range_iou=1 - wrong / 2,  # noqa: E501
        pivot=0, pivot_at_part=0.25 * np.sin(a),
        parts_right=0.5 + (degrees < 10) / 2, all_right=float(degrees < 10),
    )  # fmt: skip


def test_a_hinge_beside_its_place():
    shifted = Joint(DOOR.origin - [0, 0.08, 0], DOOR.direction, angle=(0, 1.5))
    check(cabinet(shifted), cabinet(), pivot=0.08, pivot_at_part=0.08, parts_right=0.5, all_right=0)
    # the least tilt makes the lines cross somewhere: what the field measures is blind, at the part
    # it is not
    tilted = Joint(shifted.origin, [0, 1e-4, 1], angle=(0, 1.5))
    figures = measure(cabinet(tilted), cabinet())
    assert figures["pivot"] < 1e-9
    assert figures["pivot_at_part"] == pytest.approx(0.08, abs=1e-3)
    far = Joint([5, 0, 0], DOOR.direction, angle=(0, 1.5))
    assert measure(cabinet(far), cabinet())["pivot"] == 1


def test_other_ranges():
    half = cabinet(Joint(DOOR.origin, DOOR.direction, angle=(0, 0.75)))
    check(half, cabinet(), range_iou=0.75)
    check(cabinet(), half, range_iou=0.75)


def test_a_door_that_never_moves():
    still = cabinet(Joint.fixed())
    check(
        still, cabinet(),
        type_accuracy=0.5, pivot=1, pivot_at_part=1, tree_edges=2 / 3, tree_exact=0, parts_right=0.5, all_right=0,  # noqa: E501
    )  # fmt: skip
    assert confusion(still, cabinet())["revolute", "fixed"] == 1
    # motion that is made up
    check(
        cabinet(),
        still,
        type_accuracy=0.5,
        tree_edges=2 / 3,
        tree_exact=0,
        all_right=0,
        pivot=math.nan,
        pivot_at_part=math.nan,
    )


def test_nothing_right_is_worst_and_nothing_to_compare_is_nan():
    frozen = cabinet(Joint.fixed(), Joint.fixed())
    joints = (
        "type_accuracy",
        "axis_median",
        "axis_mean",
        "wrong_way",
        "pivot",
        "pivot_at_part",
        "range_iou",
        "parts_right",
    )
    check(
        frozen, cabinet(),
        **{name: METRICS[name].worst for name in joints}, tree_edges=1 / 3, tree_exact=0, all_right=0,  # noqa: E501
    )  # fmt: skip
    check(frozen, frozen, **dict.fromkeys(joints, math.nan))
    one = dataclasses.replace(frozen, parts=frozen.parts[:1])
    check(one, one, **dict.fromkeys(joints, math.nan), tree_edges=math.nan)
    # made-up motion where the reference has none is wrong, not nothing
    assert measure(cabinet(), frozen)["type_accuracy"] == 0


def test_a_missing_and_a_surplus_part():
    less = without(cabinet(), "drawer")
    check(
        less, cabinet(),
        part_count=0, part_recall=0.75, tree_edges=2 / 3, tree_exact=0, parts_right=0.5, all_right=0, part_iou=0.75,  # noqa: E501
    )  # fmt: skip
    assert confusion(less, cabinet())["prismatic", "missing"] == 1
    check(cabinet(), less, part_count=0, part_precision=0.75, tree_exact=0, all_right=0)
    assert confusion(cabinet(), less)["surplus", "prismatic"] == 1


def test_a_part_in_another_place_is_both_missing_and_surplus():
    moved = cabinet().parts[2].mesh.copy()
    moved.apply_translation((0, 0.3, 0))
    pred = replaced(cabinet(), "handle", mesh=moved)
    check(
        pred, cabinet(),
        part_recall=0.75, part_precision=0.75, tree_edges=2 / 3, tree_exact=0, all_right=0, part_iou=0.75,  # noqa: E501
    )  # fmt: skip
    table = confusion(pred, cabinet())
    assert table["fixed", "missing"] == table["surplus", "fixed"] == 1


def test_another_parent():
    """The handle on the body: it has its place and type, its edge is wrong."""
    pred = replaced(cabinet(), "handle", parent=0)
    check(pred, cabinet(), tree_edges=2 / 3, tree_exact=0)
    # a body of another size is no match, and an edge needs both its ends
    small = replaced(cabinet(), "body", mesh=box((0.5, 0.5, 0.5), (0.05, 0, 0)))
    check(
        small, cabinet(),
        part_recall=0.75, part_precision=0.75, tree_edges=1 / 3, tree_exact=0, all_right=0, part_iou=...,  # noqa: E501
    )  # fmt: skip
    # turned round: the door is the root and carries the body
    door, body = cabinet().parts[1], cabinet().parts[0]
    ref = ArticulatedObject((body, door))
    turned = ArticulatedObject(
        (
            dataclasses.replace(body, parent=1, joint=DOOR),
            dataclasses.replace(door, parent=-1, joint=Joint.fixed()),
        )
    )
    figures = measure(turned, ref)
    assert figures["tree_edges"] == figures["tree_exact"] == figures["type_accuracy"] == 0


def test_screws():
    """Turn and travel both count, and so does the hand: it goes the wrong way with the one or the
    other."""
    right = bottle(4 * np.pi, 0.1)
    check(right, right)
    check(bottle(4 * np.pi, 0.2), right, range_iou=0.5)
    check(bottle(3 * np.pi, 0.075), right, range_iou=0.75)
    check(bottle(-4 * np.pi, 0.1), bottle(-4 * np.pi, 0.1))  # left-handed
    check(bottle(-4 * np.pi, 0.05), bottle(-4 * np.pi, 0.1), range_iou=0.5)
    wrong = {
        "axis_median": 180,
        "axis_mean": 180,
        "wrong_way": 1,
        "range_iou": 0,
        "parts_right": 0,
        "all_right": 0,
    }
    check(bottle(4 * np.pi, -0.1), right, **wrong)  # turns right, goes into the bottle
    check(bottle(-4 * np.pi, 0.1), right, **wrong)  # comes out, turning the other way
    check(bottle(-4 * np.pi, -0.1), right, **wrong)  # right-handed, but screws itself in
    revolute = replaced(right, "cap", joint=Joint([0, 0, 0], [0, 0, 1], (0, 4.0)))
    assert confusion(revolute, right)["screw", "revolute"] == 1


def test_joints_that_turn_for_ever_have_no_wrong_way():
    spin, back = (Joint(DOOR.origin, [0, 0, d], (-np.pi, np.pi)) for d in (1, -1))
    check(cabinet(back), cabinet(spin))
    figures = measure(cabinet(DOOR), cabinet(spin))
    assert figures["type_accuracy"] == 0.5  # a hinge with ends is another type
    leaning = Joint(DOOR.origin, [0, np.sin(2.8), np.cos(2.8)], (-np.pi, np.pi))
    assert measure(cabinet(leaning), cabinet(spin))["axis_mean"] == pytest.approx(
        np.degrees(np.pi - 2.8) / 2
    )


def test_part_overlap():
    """A drawer's front half as high within the reference's box: IoU 1/2, up to the sampling of the
    box's 3,000 points."""
    low = box((0.04, 1, 0.2), (-0.25, 0, -0.25))
    figures = measure(replaced(cabinet(), "drawer", mesh=low), cabinet())
    assert figures["part_iou"] == pytest.approx((3 + 0.5) / 4, abs=0.03 / 4)
    sheet = trimesh.Trimesh([[0, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2]], process=False)
    ref = replaced(cabinet(), "drawer", mesh=sheet)
    assert measure(ref, ref)["part_iou"] == 1  # a sheet has no inside: left out


@settings(max_examples=5)
@given(a=st.floats(0.02, 0.7), b=st.floats(0.02, 0.7))
def test_monotone(a, b):
    """The larger of two planted errors never scores better."""
    small, large = sorted((a, b))
    for name, joint in (
        ("axis_mean", lambda s: Joint(DOOR.origin, [0, np.sin(4 * s), np.cos(4 * s)], (0, 1.5))),
        ("pivot", lambda s: Joint(DOOR.origin + [0, s, 0], DOOR.direction, (0, 1.5))),
        ("pivot_at_part", lambda s: Joint(DOOR.origin + [s, 0, 0], DOOR.direction, (0, 1.5))),
        ("range_iou", lambda s: Joint(DOOR.origin, DOOR.direction, (0, 1.5 * (1 - s)))),
        ("range_iou", lambda s: Joint(DOOR.origin, DOOR.direction, (0, 1.5 * (1 + s)))),
    ):
        planted = [measure(cabinet(joint(s)), cabinet())[name] for s in (small, large)]
        figures = [PERFECT[name], *planted]
        signed = figures if METRICS[name].better == "lower" else [-f for f in figures]
        assert all(x <= y + 1e-9 for x, y in itertools.pairwise(signed))
        assert signed[0] < signed[1] - 1e-3


def test_invariances():
    """Moved, turned by quarters, mirrored and shuffled together, the figures stay; so do the
    joints' under any rotation of both."""
    ref = cabinet()
    tilted = Joint([-0.27, 0.46, 0], [0.1, 0.05, 1], angle=(0, 1.1))
    pred = replaced(cabinet(tilted), "handle", parent=0)
    expected = measure(pred, ref)
    matrix = np.eye(4)
    matrix[:3, :3] = rotation(np.array([0, 0, 1.0]), np.pi / 2)
    matrix[:3, 3] = [2, 0.5, -1]
    for m in (matrix, matrix @ matrix, np.diag([1.0, -1, 1, 1])):
        moved = measure(pred.transformed(m), ref.transformed(m))
        assert moved == pytest.approx(expected, abs=0.02)  # part IoU is sampled
        assert {**moved, "part_iou": 0} == pytest.approx({**expected, "part_iou": 0}, abs=1e-9)
    for order in itertools.permutations((1, 2, 3)):
        position = {old: new for new, old in enumerate((0, *order))}
        shuffled = [
            dataclasses.replace(pred.parts[k], parent=position.get(pred.parts[k].parent, -1))
            for k in (0, *order)
        ]
        found = measure(dataclasses.replace(pred, parts=tuple(shuffled)), ref)
        assert found == pytest.approx(expected, abs=1e-9)
    free = np.eye(4)
    free[:3, :3] = rotation(np.array([1, 2, 3]) / 14**0.5, 0.7)
    turned = measure(pred.transformed(free), ref.transformed(free))
    for name in ("axis_mean", "axis_median", "pivot", "range_iou", "wrong_way"):
        assert turned[name] == pytest.approx(expected[name], abs=1e-9)

"""Golden cases for part matching and signed joint errors."""

import dataclasses

import numpy as np
import pytest
import trimesh

from uniart_jax.evaluation.parts import compare_parts, match_parts, summarize
from uniart_jax.objects.joint_errors import pivot_at_part, range_iou, signed_axis_error
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part


def box(size, center):
    return trimesh.creation.box(size, trimesh.transformations.translation_matrix(center))


def cabinet(door: Joint, shift=(0.0, 0.0, 0.0)) -> ArticulatedObject:
    return ArticulatedObject(
        (
            Part("body", box((0.5, 1, 1), (0.05, 0, 0))),
            Part("door", box((0.04, 1, 0.5), np.add((-0.25, 0, 0.25), shift)), 0, door),
            Part(
                "drawer",
                box((0.04, 1, 0.4), (-0.25, 0, -0.25)),
                0,
                Joint([0, 0, 0], [-1, 0, 0], travel=(0, 0.3)),
            ),
        )
    )


DOOR = Joint([-0.25, 0.5, 0], [0, 0, 1], angle=(0, 1.5))


def test_the_truth_scores_full():
    scores = compare_parts(cabinet(DOOR), cabinet(DOOR))
    assert scores.right.all() and scores.found.all() and scores.tree_right
    result = summarize([scores])
    assert result["parts_right"] == result["recall"] == result["count"] == 1
    assert result["axis_median"] == 0 and result["range_iou"] == 1


def test_a_flipped_axis_with_flipped_limits_is_the_same_joint():
    same = Joint([-0.25, 0.5, 0.3], [0, 0, -1], angle=(-1.5, 0))
    assert signed_axis_error(same, DOOR) == pytest.approx(0)
    assert range_iou(same, DOOR) == pytest.approx(1)


def test_a_door_that_opens_inwards_is_wrong():
    inwards = Joint([-0.25, 0.5, 0], [0, 0, 1], angle=(-1.5, 0))
    assert signed_axis_error(inwards, DOOR) == pytest.approx(180)
    scores = compare_parts(cabinet(inwards), cabinet(DOOR))
    assert scores.found[1] and not scores.right[1]
    assert summarize([scores])["opens_wrong_way"] == 0.5


def test_continuous_joints_have_no_wrong_way():
    spin = Joint([0, 0, 0], [0, 0, 1], angle=(-np.pi, np.pi))
    back = Joint([0, 0, 0], [0, 0, -1], angle=(-np.pi, np.pi))
    assert signed_axis_error(back, spin) == pytest.approx(0)


def test_screws_count_turn_travel_and_hand():
    right = Joint([0, 0, 0], [0, 0, 1], angle=(0, 6.0), travel=(0, 0.3))
    left = Joint([0, 0, 0], [0, 0, 1], angle=(0, 6.0), travel=(0, -0.3))
    steep = Joint([0, 0, 0], [0, 0, -1], angle=(-6.0, 0), travel=(-0.4, 0))  # the same hand
    assert signed_axis_error(left, right) == pytest.approx(180)
    assert range_iou(left, right) == 0
    assert signed_axis_error(steep, right) == 0
    assert range_iou(steep, right) == pytest.approx(0.75)
    mirrored = right.transformed(np.diag([1.0, 1, -1, 1]))
    assert signed_axis_error(mirrored, left.transformed(np.diag([1.0, 1, -1, 1]))) == pytest.approx(
        180
    )
    half = right.shown_at(3.0)
    assert range_iou(half, left.shown_at(3.0)) == pytest.approx(
        1
    )  # from half way: both ways are open
    assert signed_axis_error(half, left.shown_at(3.0)) == pytest.approx(180)
    assert range_iou(DOOR, Joint([0, 0, 0], [0, 0, 1], travel=(0, 1.5))) == 0  # a turn is no travel


def test_pivot_at_the_part():
    """Two axes that cross at z = 1, 45 degrees apart: at z = 0.2 the nearest point of the tilted
    one is 0.8 / sqrt 2 away."""
    upright, tilted = (Joint([0, 0, 1], d, angle=(0, 1)) for d in ([0, 0, 1], [0, 1, 1]))
    assert pivot_at_part(tilted, upright, np.array([0.3, 0.4, 0.2])) == pytest.approx(0.8 / 2**0.5)
    assert pivot_at_part(upright, upright, np.array([0.3, 0.4, 0.2])) == 0
    again = compare_parts(cabinet(DOOR), cabinet(DOOR))
    np.testing.assert_array_equal(again.match, [0, 1, 2])
    np.testing.assert_array_equal(again.pivot_at_part, [np.nan, 0, np.nan])


@pytest.mark.parametrize(
    ("door", "shift", "found", "right"),
    [
        (
            Joint([-0.25, 0.5, 0], [0, np.sin(0.1), np.cos(0.1)], angle=(0, 1.5)),
            (0, 0, 0),
            True,
            True,
        ),
        (
            Joint([-0.25, 0.5, 0], [0, np.sin(0.3), np.cos(0.3)], angle=(0, 1.5)),
            (0, 0, 0),
            True,
            False,
        ),
        (Joint([-0.25, 0.44, 0], [0, 0, 1], angle=(0, 1.5)), (0, 0, 0), True, False),
        (DOOR, (0, 0, 0.15), True, False),
        (DOOR, (0, 0, 0.25), False, False),
        (Joint([0, 0, 0], [0, 0, 1], travel=(0, 0.3)), (0, 0, 0), False, False),
        (Joint.fixed(), (0, 0, 0), False, False),
    ],
)
def test_planted_errors(door, shift, found, right):
    scores = compare_parts(cabinet(door, shift), cabinet(DOOR))
    assert (bool(scores.found[1]), bool(scores.right[1])) == (found, right)
    assert scores.right[2]


def test_a_missing_and_a_surplus_part():
    whole = cabinet(DOOR)
    without = dataclasses.replace(whole, parts=whole.parts[:2])
    scores = compare_parts(without, whole)
    assert not scores.count_right and not scores.found[2] and scores.right[1]
    assert np.isinf(scores.box_error[2])
    assert not compare_parts(whole, without).count_right


def test_matching_ignores_order():
    rng = np.random.default_rng(0)
    boxes = rng.uniform(-1, 1, (7, 6))
    order = rng.permutation(7)
    match, distance = match_parts(boxes[order], boxes)
    np.testing.assert_array_equal(order[match], np.arange(7))
    assert distance.max() == 0

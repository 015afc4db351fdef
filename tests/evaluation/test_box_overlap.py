"""Overlap of boxes: gIoU by hand, solids that have a formula, and the sampled estimate against the
exact one."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uniart_jax.evaluation.box_overlap import (
    aligned_enclosure,
    aligned_intersection,
    exact_intersection,
    generalized_iou,
    iou,
    moving_enclosure,
    sampled_intersection,
)
from uniart_jax.objects.kinematics import rotation

UNIT = np.array([0, 0, 0, 1, 1, 1.0])


@pytest.mark.parametrize(
    ("offset", "expected"),
    [
        ((0, 0, 0), 1.0),
        ((0.5, 0, 0), 1 / 3),  # shares .5 of 1.5, nothing else in C
        ((1, 0, 0), 0.0),  # they touch
        ((2, 0, 0), -1 / 3),  # a third of C is empty
        ((1, 1, 0), -0.5),  # half of C is empty
    ],
)
def test_generalized_iou_of_unit_boxes(offset, expected):
    other = UNIT + np.array([*offset, 0, 0, 0])
    a, b = UNIT[None], other[None]
    assert generalized_iou(
        aligned_intersection(a, b), a, b, aligned_enclosure(a, b)
    ) == pytest.approx(expected)
    # The same pair with the place in the matrix, and turned by so little that only the exact
    # overlap of solids can tell.
    place = np.eye(4)
    place[:3, :3] = rotation(np.array([2, 3, 6]) / 7, 1e-7)
    place[:3, 3] = np.negative(offset)
    shared, around = exact_intersection(a, a, place[None]), moving_enclosure(a, a, place[None])
    assert generalized_iou(shared, a, a, around) == pytest.approx(expected, abs=1e-5)


def test_a_cube_and_the_same_turned_by_45_degrees_share_an_octagon():
    turn = np.eye(4)
    turn[:3, :3] = rotation(np.array([0, 0, 1.0]), math.pi / 4)
    octagon = 2 * (math.sqrt(2) - 1)
    a = UNIT[None]
    shared = exact_intersection(a, a, turn[None])
    assert shared == pytest.approx(octagon, abs=1e-6)
    assert iou(shared, a, a) == pytest.approx(octagon / (2 - octagon), abs=1e-6)
    assert moving_enclosure(a, a, turn[None]) == pytest.approx(2.0)
    sampled = sampled_intersection(a, a, turn[None], 10_000, np.random.default_rng(0))
    assert sampled == pytest.approx(octagon, abs=0.015)  # 5 standard deviations


@settings(max_examples=25)
@given(st.integers(0, 2**31))
def test_exact_and_sampled_overlaps_agree_from_either_side(seed):
    rng = np.random.default_rng(seed)
    a, b = (np.concatenate([rng.uniform(-0.3, 0.3, 3), rng.uniform(0.1, 1, 3)]) for _ in range(2))
    axis = rng.normal(size=3)
    matrix = np.eye(4)
    matrix[:3, :3] = rotation(axis / np.linalg.norm(axis), rng.uniform(0, 3))
    matrix[:3, 3] = rng.uniform(-0.3, 0.3, 3)
    exact = exact_intersection(a[None], b[None], matrix[None])
    back = exact_intersection(b[None], a[None], np.linalg.inv(matrix)[None])
    assert exact == pytest.approx(back, abs=1e-6)
    assert exact[0] <= min(np.prod(a[3:]), np.prod(b[3:])) + 1e-9
    sampled = sampled_intersection(a[None], b[None], matrix[None], 10_000, rng)
    assert sampled == pytest.approx(exact, abs=0.02 * max(np.prod(a[3:]), np.prod(b[3:])))
    union = np.prod(a[3:]) + np.prod(b[3:]) - exact[0]
    around = moving_enclosure(a[None], b[None], matrix[None])
    assert around[0] >= union - 1e-9
    other = moving_enclosure(b[None], a[None], np.linalg.inv(matrix)[None])
    assert around == pytest.approx(other)

"""Small holes in outer walls are closed; openings that parts pass through, and large ones, stay."""

import numpy as np
import pytest
from fields import AT, assert_same, block, box_of, copy_of, field_of, solid_of

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.cleanup.walls import with_whole_walls

BODY = (10.3, 8.3, 4.3), (54.3, 56.3, 60.3)
HOLE = (20, 20), (30, 32)  # of a wall, y and z, or x and y


def hollow(axis, side, low=HOLE[0], high=HOLE[1]):
    """A hollow block with a hole in one of its walls, and the wall's outermost layer."""
    inner = [(a + 4, b - 4) for a, b in zip(*BODY, strict=True)]
    shell = np.maximum(block(*BODY), -block(*zip(*inner, strict=True)))
    first, last = np.array(BODY[0]), np.array(BODY[1])
    middle = (first[axis] + last[axis]) / 2
    first, last = first - 2, last + 2
    first[np.arange(3) != axis], last[np.arange(3) != axis] = low, high
    first[axis], last[axis] = (first[axis], middle) if side < 0 else (middle, last[axis])
    return np.maximum(shell, -block(first, last)), (first, last)


def closed(field, others=(), joints=()):
    boxes = np.stack([box_of(*BODY), *others])
    return with_whole_walls(field, boxes, (Joint.fixed(), *joints), [0])


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("side", [-1, 1])
def test_a_small_hole_is_closed_flat(axis, side):
    broken, _ = hollow(axis, side)
    field = field_of(broken)
    before = copy_of(field)
    found = closed(field)
    assert_same(field, before)
    silhouette = solid_of(field_of(block(*BODY)), 0)
    seen = np.moveaxis(solid_of(found, 0), axis, 0)[::-side]
    whole = np.moveaxis(silhouette, axis, 0)[::-side]
    np.testing.assert_array_equal(seen.argmax(0), whole.argmax(0))
    assert (solid_of(found, 0) >= solid_of(before, 0)).all()
    assert (solid_of(found, 0) & ~silhouette).sum() == 0


def test_a_large_hole_and_a_gap_at_the_edge_stay():
    for low, high in (((14, 14), (44, 50)), ((6, 20), (20, 30))):
        field = field_of(hollow(0, -1, low, high)[0])
        assert_same(closed(field), field)


@pytest.mark.parametrize(
    ("joint", "stays"),
    [
        (Joint((0, 0, 0), (1, 0, 0), travel=(-0.3, 0)), True),  # a drawer comes through it
        (Joint((0, 0, 0), (0, 0, 1), travel=(0, 0.1)), False),  # within
        (Joint((0, 0, 0), (1, 0, 0), angle=(-np.pi, np.pi)), False),  # a drum turns behind it
        (Joint.fixed(), False),
    ],
)
def test_what_a_part_passes_through_stays_open(joint, stays):
    broken, (first, last) = hollow(0, -1)
    low = np.array([20.0, *(first[1:] + 1)])
    high = np.array([40.0, *(last[1:] - 1)])
    field = field_of(broken, block(low, high))
    found = closed(field, [box_of(low, high)], [joint])
    hole = np.zeros(AT[0][0].shape, bool)
    hole[HOLE[0][0] + 1 : HOLE[1][0], HOLE[0][1] + 1 : HOLE[1][1]] = True
    shown = solid_of(found, 0)[:16].any(0)
    assert shown[hole].mean() == (0 if stays else 1)
    np.testing.assert_array_equal(solid_of(found, 1), solid_of(field, 1))


def test_a_knob_does_not_keep_a_hole_open():
    broken, (first, last) = hollow(0, -1)
    middle = (first + last)[1:] / 2
    low, high = np.array([7.0, *(middle - 2)]), np.array([12.0, *(middle + 2)])
    field = field_of(broken, block(low, high))
    knob = Joint((0, 0, 0), (1, 0, 0), angle=(0, 4))
    found = closed(field, [box_of(low, high)], [knob])
    shown = (found.sdf < 0)[:16].any(0)
    assert shown[21:30, 21:32].all()

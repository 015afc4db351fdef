"""Doors that are drawn round are cut round, whatever way they stand, and square ones are left."""

import numpy as np
import pytest
from fields import AT, assert_same, block, box_of, copy_of, field_of, moved, place_of, solid_of

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.cleanup import round_doors as round_doors_module
from uniart_jax.voxels.cleanup.round_doors import round_doors, with_round_doors

BODY = (34.3, 4.3, 4.3), (60.3, 60.3, 60.3)
LOWER, UPPER = (28.3, 9.3, 11.3), (36.3, 53.3, 55.3)  # of the door, closed in front of the body
MIDDLE, HALF = np.array([31.3, 33.3]), 22.0  # of its face, y and z
HINGE = (29.0, 9.3, 33.3)


def washer(corners, degrees=0, side=-1):
    """A box with a room behind a door whose corners lie ``corners`` cells behind its front.

    The door is open by an angle. ``side`` 1: all is mirrored, the front is at the upper end of x.
    """
    mirror = (lambda d: d[::-1]) if side > 0 else (lambda d: d)
    place = place_of(HINGE)
    angle = (0, np.pi / 2 - np.deg2rad(degrees))
    angle = (-np.deg2rad(degrees), angle[1])
    joint = Joint(place, (0, 0, 1), angle=angle)
    at = moved(np.linalg.inv(joint.motion(np.deg2rad(degrees))))
    front = np.where(np.hypot(at[1] - MIDDLE[0], at[2] - MIDDLE[1]) > 1.05 * HALF, corners, 0)
    door = block((LOWER[0] + front, *LOWER[1:]), UPPER, at)
    shell = np.maximum(block(*BODY), -block((33, 14, 16), (56, 49, 51)))
    body = np.maximum(shell, 1.5 - block(LOWER, UPPER))
    solid = np.argwhere(mirror(door) < 0)
    box = box_of(solid.min(0) - 0.5, solid.max(0) + 0.5)
    if side > 0:
        joint = Joint(place * (-1, 1, 1), (0, 0, 1), angle=(-angle[1], -angle[0]))
    field = field_of(mirror(body), mirror(door))
    whole = box_of(np.array([34, 4, 4]), np.array([60, 60, 60]))
    return field, np.stack([whole, box]), (Joint.fixed(), joint)


@pytest.mark.parametrize(("corners", "count"), [(0, 0), (1, 0), (3, 1), (6, 1)])
@pytest.mark.parametrize("side", [-1, 1])
def test_a_door_is_round_where_its_corners_are_drawn_back(corners, count, side):
    field, boxes, joints = washer(corners, side=side)
    assert len(round_doors(field, boxes, joints, [0])) == count


@pytest.mark.parametrize("half", [10, 13, 16, 19, 22])
@pytest.mark.parametrize("loose", [0.0, 0.5, 1.0])
def test_a_square_door_is_none_whatever_its_size_and_however_its_box_fits(half, loose):
    middle = np.array([33.3, 33.3])
    low, high = (28.3, *(middle - half)), (36.3, *(middle + half))
    body = np.maximum(block(*BODY), 1.5 - block(low, high))
    field = field_of(body, block(low, high))
    hinge = Joint(place_of((29.0, middle[0] - half, 33.3)), (0, 0, 1), angle=(0, np.pi / 2))
    box = box_of(np.array(low) - loose, np.array(high) + loose)
    boxes = np.stack([box_of(*BODY), box])
    assert round_doors(field, boxes, (Joint.fixed(), hinge), [0]) == []


def test_an_upright_door_that_falls_open_is_none():
    field, boxes, (fixed, _) = washer(6)
    falls = Joint(place_of((29.0, 33.3, LOWER[2])), (0, -1, 0), angle=(0, np.pi / 2))
    assert round_doors(field, boxes, (fixed, falls), [0]) == []


@pytest.mark.parametrize(("share", "count"), [(0.6, 1), (0.7, 0)])
def test_a_round_door_takes_much_of_the_width(monkeypatch, share, count):
    """In a wide desk a small door whose corners are drawn badly is a square one."""
    monkeypatch.setattr(round_doors_module, "SHARE", share)  # the toy grid has no room for a desk
    half, middle = 18, np.array([33.3, 33.3])
    low, high = (28.3, *(middle - half)), (33.3, *(middle + half))
    corners = np.where(np.hypot(AT[1] - middle[0], AT[2] - middle[1]) > 1.05 * half, 4, 0)
    body = np.maximum(block(*BODY), 1.5 - block(low, high))
    field = field_of(body, block((low[0] + corners, *low[1:]), high))
    hinge = Joint(place_of((29.0, middle[0] - half, 33.3)), (0, 0, 1), angle=(0, np.pi / 2))
    boxes = np.stack([box_of(*BODY), box_of(np.array(low), np.array(high))])
    assert len(round_doors(field, boxes, (Joint.fixed(), hinge), [0])) == count


def test_what_is_no_square_plate_is_no_round_door():
    field, boxes, joints = washer(4)
    long = field_of(*(np.where(field.owner == k, field.sdf, 3.0) for k in (0, 1)))
    long.sdf[:, 36:, :] = np.where(long.owner[:, 36:, :] == 1, 3.0, long.sdf[:, 36:, :])
    boxes[1] = box_of(LOWER, (UPPER[0], 36.0, UPPER[2]))
    assert round_doors(long, boxes, joints, [0]) == []
    slider = Joint((0, 0, 0), (1, 0, 0), travel=(-0.3, 0))
    assert round_doors(field, boxes, (Joint.fixed(), slider), [0]) == []


@pytest.mark.parametrize("side", [-1, 1])
def test_a_closed_door_becomes_a_disc_and_its_body_closes_around_it(side):
    drawn, boxes, joints = washer(4, side=side)
    discs = round_doors(drawn, boxes, joints, [0])
    square, _, _ = washer(0, side=side)  # as flat faces make it
    before = copy_of(square)
    field = with_round_doors(square, [0], discs)
    assert_same(square, before)
    door = solid_of(field, 1)
    face = door.any(0)
    assert face.sum() == pytest.approx(np.pi * HALF**2, rel=0.05)
    radius = np.hypot(AT[1][0] - MIDDLE[0], AT[2][0] - MIDDLE[1])
    assert radius[face].max() < HALF + 1
    # no column in the corners of the door's box leads into the room
    corner = (radius > HALF + 3) & (np.abs(AT[1][0] - MIDDLE[0]) < HALF)
    corner &= np.abs(AT[2][0] - MIDDLE[1]) < HALF
    wall = solid_of(field, 0)[:: side * -1][30:50]
    assert wall.any(0)[corner].all()
    assert not solid_of(before, 0)[:: side * -1][30:37].any(0)[corner].any()


@pytest.mark.parametrize("degrees", [20, 40])
def test_an_open_door_is_cut_in_its_own_plane(degrees):
    drawn, boxes, joints = washer(4, degrees)
    discs = round_doors(drawn, boxes, joints, [0])
    assert len(discs) == 1 and not discs[0].turn.still
    square, _, _ = washer(0, degrees)
    field = with_round_doors(square, [0], discs)
    share = solid_of(field, 1).sum() / solid_of(square, 1).sum()
    assert share == pytest.approx(np.pi / 4, abs=0.05)
    np.testing.assert_array_equal(solid_of(field, 0), solid_of(square, 0))

"""Racks behind a door become trays that fill their boxes; drawers and what no door covers do
not."""

import numpy as np
import pytest
from fields import AT, N, assert_same, block, box_of, copy_of, field_of, place_of, solid_of
from scipy import ndimage

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.cleanup.layout_boards import with_boards
from uniart_jax.voxels.cleanup.trays import THICK, trays
from uniart_jax.voxels.closed_pose import closing_of

CASE, ROOM = ((14.3, 8.3, 8.3), (56.3, 56.3, 56.3)), ((13.0, 11.3, 11.3), (53.3, 53.3, 53.3))
DOOR = ((10.3, 8.3, 8.3), (14.1, 56.3, 56.3))
RACK = ((20.3, 14.3, 14.3), (48.3, 50.3, 30.3))
FALLS = Joint(place_of((12.3, 30, 8.3)), (0.0, -1, 0), angle=(0.0, 1.5))
OUT = 16.0  # cells that the rack may be pulled


def machine(rack=RACK, door=DOOR, pulled=0.0, side=-1):
    """A case, its door and a rack of which fragments are drawn, as they are shown; their boxes,
    joints and the motions that close doors. ``side`` 1: mirrored, the front at the upper end."""
    mirror = (lambda d: d[::-1]) if side > 0 else (lambda d: d)
    shift = np.array([pulled, 0, 0])
    rack = tuple(np.array(corner) - shift for corner in rack)
    torn = ndimage.binary_dilation(np.random.default_rng(0).random(AT.shape[1:]) < 0.01, None, 2)
    wires = np.where(torn, block(*rack), 2.0)
    case = np.maximum(block(*CASE), -block(*ROOM))
    slide = Joint(np.zeros(3), (-1.0, 0, 0), travel=((-pulled) / N, (OUT - pulled) / N))
    corners = [CASE, door or DOOR, rack]
    hinge = FALLS if door else Joint.fixed()
    if side > 0:
        corners = [
            tuple(np.array(c) * (-1, 1, 1) + (N + 1, 0, 0) for c in pair) for pair in corners
        ]
        corners = [((b[0], *a[1:]), (a[0], *b[1:])) for a, b in corners]
        slide = Joint(np.zeros(3), (1.0, 0, 0), travel=slide.travel)
        hinge = Joint(hinge.origin * (-1, 1, 1), -hinge.direction, angle=hinge.angle)
    boxes = np.stack([box_of(*pair) for pair in corners])
    joints = [Joint.fixed(), hinge, slide]
    field = field_of(mirror(case), mirror(block(*(door or DOOR))), mirror(wires))
    return field, boxes, joints, closing_of(joints, boxes, [-1, 0, 0])


def of(field, boxes, joints, closed, rows=(1, 2), parents=(-1, 0, 0)):
    return trays(field, boxes, joints, parents, [0], closed, rows)


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("pulled", [0.0, 10.0])
def test_a_rack_becomes_a_tray_that_fills_its_box(side, pulled):
    field, boxes, joints, closed = machine(pulled=pulled, side=side)
    before = copy_of(field)
    found = of(field, boxes, joints, closed)
    assert list(found) == [2] and found[2].shape == (5, 6)
    after, built = with_boards(field, joints, [0], found, exact=True)
    assert built == {2}
    assert_same(field, before)
    tray = solid_of(after, 2)
    box = boxes[2]
    low, high = ((box[:3] + s * box[3:] / 2 + 0.5) * N + 0.5 for s in (-1, 1))
    inner = block(low + THICK, (*(high - THICK)[:2], 99)) < -1
    shell = (block(low, high) < -0.5) & (block(low + THICK, (*(high - THICK)[:2], 99)) > 0.5)
    free = ~np.asarray(ndimage.binary_dilation((field.sdf < 0) & (field.owner != 2)), bool)
    assert tray[shell & free].all() and not tray[inner].any()
    assert not tray[block(low - 1, high + 1) > 0].any()


@pytest.mark.parametrize("height, count", [(3, 1), (4, 1), (5, 5), (8, 5)])
def test_a_low_rack_is_a_floor(height, count):
    low = (RACK[0], (*RACK[1][:2], RACK[0][2] + height))
    found = of(*machine(rack=low))[2]
    assert len(found) == count
    assert found[:, 5].max() - found[:, 2].min() == pytest.approx(height / N, abs=1e-6)


def test_two_doors_cover_it_together():
    field, boxes, joints, _ = machine()
    boxes, half = np.insert(boxes, 2, boxes[1], 0), boxes[1][4] / 2
    field.owner[field.owner == 2] = 3
    right = (field.owner == 1) & (AT[1] > 32.5)
    field.owner[right] = 2
    boxes[1:3, 4] = half
    boxes[1, 1] -= half / 2
    boxes[2, 1] += half / 2
    swings = [Joint(place_of((12.3, y, 30)), (0.0, 0, 1), angle=(0.0, 1.5)) for y in (8.3, 56.3)]
    joints = [joints[0], *swings, joints[2]]
    closed = np.tile(np.eye(3, 4), (4, 1, 1))
    assert list(of(field, boxes, joints, closed, [1, 2, 3], (-1, 0, 0, 0))) == [3]


def test_what_is_solid_or_has_a_front_is_no_rack():
    field, boxes, joints, closed = machine()
    whole = block(*RACK) < 0
    solid = copy_of(field)
    solid.owner[whole], solid.sdf[whole] = 2, -1
    assert of(solid, boxes, joints, closed) == {}
    front = whole & (AT[0] < RACK[0][0] + 3)
    field.owner[front], field.sdf[front] = 2, -1
    assert of(field, boxes, joints, closed) == {}


def test_what_slides_in_a_moving_part_is_no_rack():
    assert of(*machine(), parents=(-1, 0, 1)) == {}


@pytest.mark.parametrize(
    "changed",
    [
        {"rack": ((10.3, *RACK[0][1:]), RACK[1])},  # a drawer's front lies beside the door's
        {"door": ((10.3, 8.3, 40.3), (14.1, 56.3, 56.3))},  # a door above it
        {"door": None},  # a plate that does not move
        {"door": ((54.3, 8.3, 8.3), (57.3, 56.3, 56.3))},  # a door behind it
    ],
)
def test_what_no_door_covers_is_no_rack(changed):
    assert of(*machine(**changed)) == {}


def test_only_what_slides_level_and_is_asked_for_is_a_rack():
    field, boxes, joints, closed = machine()
    assert of(field, boxes, joints, closed, rows=[1]) == {}
    up = Joint(np.zeros(3), (0.0, 0, 1), travel=(0.0, 0.3))
    assert of(field, boxes, [*joints[:2], up], closed) == {}
    aslant = Joint(np.zeros(3), (-0.8, 0, -0.6), travel=joints[2].travel)
    assert of(field, boxes, [*joints[:2], aslant], closed) == {}
    turns = Joint(place_of((30, 14.3, 20)), (0.0, 0, 1), angle=(0.0, 1.0))
    assert of(field, boxes, [*joints[:2], turns], closed) == {}


def test_exact_boards_are_built_whatever_is_drawn():
    field, boxes, joints, closed = machine()
    found = of(field, boxes, joints, closed)
    field.sdf[:, 24:][solid_of(field, 2)[:, 24:]] = 2  # but for a strip at one side
    assert with_boards(field, joints, [0], found)[1] == frozenset()
    assert with_boards(field, joints, [0], found, exact=True)[1] == {2}

"""Drums become shells of their radius, and what is before them a plate with a round hole."""

import numpy as np
import pytest
from fields import AT, block, box_of, field_of, place_of, solid_of

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.cleanup.drums import PLATE, SHELL, drums, with_drums

MIDDLE, RADIUS, HOLE = np.array([33.3, 33.3]), 18.0, 13.0  # of the drum's axis, y and z
FRONT, BACK = 40.3, 58.3  # the drum's ends; it is open to lower x
BODY = (30.3, 6.3, 6.3), (62.3, 60.3, 60.3)
FREE = Joint(place_of((49.0, *MIDDLE)), (1, 0, 0), angle=(-np.pi, np.pi))


def machine(torn=0.0, side=-1, seed=0, shell=SHELL, case=BODY):
    """A case with a front of 3 cells, a round hole in it and a drum behind; ``torn``: share of the
    cells of drum and front near the hole that are missing, and of the hole's that are there."""
    flip = (lambda d: d[::-1]) if side > 0 else (lambda d: d)
    r = np.hypot(AT[1] - MIDDLE[0], AT[2] - MIDDLE[1])
    x = AT[0]
    drum = np.maximum(r - RADIUS, np.maximum(FRONT - x, x - BACK))
    drum = np.maximum(drum, -np.maximum(r - (RADIUS - shell), x - (BACK - shell)))
    room = np.maximum(r - RADIUS - 3, np.maximum(33.3 - x, x - 60.3))
    body = np.maximum(np.maximum(block(*case), -room), -np.maximum(r - HOLE, x - 34))
    if torn:
        rng = np.random.default_rng(seed)
        spots = rng.random(tuple(n // 3 + 1 for n in body.shape)) < torn
        spots = np.kron(spots, np.ones((3, 3, 3)))[tuple(slice(n) for n in body.shape)] > 0
        near = np.abs(r - HOLE) < 5
        front = (x > 30.3) & (x < 33.3)
        body = np.where(spots & near & front, -np.sign(body) * 0.5, body)
        drum = np.where(spots & (drum < 0), 0.5, drum)
    joint, box = FREE, box_of((FRONT, *(MIDDLE - RADIUS)), (BACK, *(MIDDLE + RADIUS)))
    if side > 0:
        box = box * np.array([-1, 1, 1, 1, 1, 1])
        joint = Joint(np.array(FREE.origin) * (-1, 1, 1), (1, 0, 0), angle=(-np.pi, np.pi))
    return field_of(flip(body), flip(drum)), np.stack([box_of(*BODY), box]), (Joint.fixed(), joint)


def seen(field, part, side):
    solid = solid_of(field, part)
    return solid[::-1] if side > 0 else solid


def round_at(cells, radius):
    """Largest deviation of the edge of a layer's hole from a circle about the axis."""
    y, z = np.mgrid[: cells.shape[0], : cells.shape[1]]
    r = np.hypot(y - MIDDLE[0], z - MIDDLE[1])
    return max(radius - r[cells].min(), r[~cells & (r < radius + 6)].max() - radius)


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("torn", [0.0, 0.3])
def test_a_torn_drum_and_its_hole_are_round(torn, side):
    field, boxes, joints = machine(torn, side)
    found = drums(field, boxes, joints, [0])
    assert [(d.part, d.axis, d.side, d.door) for d in found] == [(1, 0, side, None)]
    made = with_drums(field, [0], found)
    front = seen(made, 0, side)[30:34]
    plate = front[1]  # of the front's layers
    assert round_at(plate, HOLE) <= (1.5 if not torn else 3.5)
    drum = seen(made, 1, side)
    layers = np.flatnonzero(drum.any((1, 2)))
    assert abs(layers[0] - FRONT) <= 2 and abs(layers[-1] - BACK) <= 2
    y, z = np.mgrid[: drum.shape[1], : drum.shape[2]]
    r = np.hypot(y - MIDDLE[0], z - MIDDLE[1])
    for layer in drum[layers[0] + 1 : layers[-1] - SHELL - 1]:
        assert layer[(r > RADIUS - SHELL + 1) & (r < RADIUS - 1)].all()
        assert not layer[(r < RADIUS - SHELL - 1) | (r > RADIUS + 1)].any()
    assert drum[layers[-1] - 1][r < RADIUS - 1].all()  # its back
    both = seen(made, 0, side) & drum
    assert not both.any()


def test_what_is_whole_hardly_changes_and_nothing_is_written_to():
    field, boxes, joints = machine()
    before = field.sdf.copy(), field.owner.copy()
    made = with_drums(field, [0], drums(field, boxes, joints, [0]))
    np.testing.assert_array_equal(field.sdf, before[0])
    np.testing.assert_array_equal(field.owner, before[1])
    for part in (0, 1):
        old, new = solid_of(field, part), solid_of(made, part)
        assert (old & new).sum() / (old | new).sum() > 0.9


@pytest.mark.parametrize("shell", [3, 4, 6])
def test_a_drum_keeps_its_thickness(shell):
    field, boxes, joints = machine(shell=shell)
    found = drums(field, boxes, joints, [0])
    assert abs(found[0].shell - shell) < 0.8 and abs(found[0].bottom - shell) < 1.5
    old, new = solid_of(field, 1), solid_of(with_drums(field, [0], found), 1)
    assert (old & new).sum() / (old | new).sum() > 0.85


@pytest.mark.parametrize("left", [13.3, 11.3])
def test_the_plate_ends_where_the_case_does(left):
    """A case hardly wider than its drum, which ends at one side of the grid."""
    case = (30.3, left, 6.3), (62.3, 65 - left, 60.3)
    field, boxes, joints = machine(0.2, case=case)
    made = with_drums(field, [0], drums(field, boxes, joints, [0]))
    before, after = (np.flatnonzero(solid_of(f, 0).any((0, 2))) for f in (field, made))
    assert after[0] >= before[0] and after[-1] <= before[-1]
    for f in (made, with_drums(made, [0], drums(made, boxes, joints, [0]))):
        outside = np.ones(f.sdf.shape, bool)
        outside[1:-1, 1:-1, 1:-1] = False
        assert (f.sdf[outside] > 0).all()


def test_a_door_without_cells_is_passed_over():
    field, boxes, joints = machine()
    hinge = Joint(place_of((29.5, 12.3, 33.3)), (0, 0, 1), angle=(0, np.pi / 2))
    boxes = np.stack([*boxes, box_of((29.3, 12.3, 12.3), (36.3, 54.3, 54.3))])
    assert [d.door for d in drums(field, boxes, (*joints, hinge), [0])] == [None]


def test_the_plate_lies_behind_the_closed_door():
    """A door in the front's layers takes their place; the drum begins behind the plate."""
    field, boxes, joints = machine(0.2)
    low, high = (29.3, *(MIDDLE - 16)), (36.3, *(MIDDLE + 16))
    door = block(low, high)
    body, drum = (np.where(solid_of(field, k), -1.0, 1.0) for k in (0, 1))
    body = np.maximum(body, 1.5 - door)
    hinge = Joint(place_of((29.5, low[1], 33.3)), (0, 0, 1), angle=(0, np.pi / 2))
    boxes = np.stack([*boxes, box_of(low, high)])
    joints = (*joints, hinge)
    field = field_of(body, drum, door)
    found = drums(field, boxes, joints, [0])
    assert len(found) == 1 and found[0].door is not None and abs(found[0].door - 36) <= 1
    made = with_drums(field, [0], found)
    np.testing.assert_array_equal(solid_of(field, 2), solid_of(made, 2))
    end = found[0].door + 1 + PLATE
    plate = solid_of(made, 0)[found[0].door + 2]
    y, z = np.mgrid[: plate.shape[0], : plate.shape[1]]
    r = np.hypot(y - MIDDLE[0], z - MIDDLE[1])  # nothing is left that would tell of the hole
    assert plate[(r > RADIUS) & (r < RADIUS + 4)].all() and not plate[r < 0.9 * RADIUS].any()
    assert not solid_of(made, 1)[: end + 1].any() and solid_of(made, 1)[end + 4].any()


CHANGES = ["hinged", "aslant", "flat", "narrow", "beside", "solid", "shut", "chair", "arms"]


@pytest.mark.parametrize("change", CHANGES)
def test_what_is_no_drum_is_left(change):
    field, boxes, joints = machine()
    joint, box = joints[1], boxes[1].copy()
    if change == "hinged":
        joint = Joint(joint.origin, joint.direction, angle=(0, 1.0))
    elif change == "aslant":
        joint = Joint(joint.origin, (0.94, 0.34, 0), angle=(-np.pi, np.pi))
    elif change == "flat":
        box[3] = 0.05
    elif change == "narrow":
        box[4] *= 0.6
    elif change == "beside":
        joint = Joint(joint.origin + np.array([0, 0.15, 0]), (1, 0, 0), angle=(-np.pi, np.pi))
    else:
        body, drum = (np.where(solid_of(field, k), -1.0, 1.0) for k in (0, 1))
        if change == "chair":  # what does not move is a foot below
            body = block((56.3, 26.3, 26.3), (62.3, 40.3, 40.3))
        elif change == "arms":  # two of them turn
            drum = np.maximum(drum, np.abs(AT[2] - MIDDLE[1]) - 5)
        elif change == "solid":
            drum = block((FRONT, *(MIDDLE - 15)), (BACK, *(MIDDLE + 15)))
        else:  # closed at both ends
            body = np.minimum(body, block((30.3, 10.3, 10.3), (34.3, 56.3, 56.3)))
            body = np.minimum(body, block((59.3, 10.3, 10.3), (62.3, 56.3, 56.3)))
        field = field_of(body, drum)
    assert drums(field, np.stack([boxes[0], box]), (joints[0], joint), [0]) == []

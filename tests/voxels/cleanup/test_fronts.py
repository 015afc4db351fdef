"""Doors close side by side, gaps around them are straight, fronts of drawers are whole."""

import numpy as np
import pytest
from fields import AT, N, block, box_of, field_of, place_of, solid_of

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.cleanup.fronts import closed_door, door_of, straighten_rim, without_overlap

CENTER = place_of((36, 32, 32))
LEFT = ((10.3, 8.3, 12.3), (14.3, 34.3, 52.3))
RIGHT = ((10.3, 30.3, 12.3), (14.3, 56.3, 52.3))  # they share four cells
BODY = np.maximum(block((14.3, 8.3, 8.3), (56.3, 56.3, 56.3)), -block((13, 12, 12), (50, 52, 52)))


def hinge(y, opened=0.0, x=10.3):
    """A door that opens by a right angle; it is shown open by some radians."""
    sign = 1 if y < 32 else -1
    ends = sorted((-sign * opened, sign * (np.pi / 2 - opened)))
    return Joint(place_of((x, y, 30)), (0.0, 0, 1), angle=tuple(ends))


def shown(corners, joint, opened):
    """Cells of a closed block after it is opened by some radians, and the box of its row."""
    cells = np.argwhere(block(*corners) < 0)
    there = joint.motion(opened)
    at = ((place_of(cells) @ there[:3, :3].T + there[:3, 3]) + 0.5) * N + 0.5
    return at, box_of(at.min(0) - 0.5, at.max(0) + 0.5)


def door(corners, y, opened=0.0):
    joint = hinge(y, opened)
    cells, box = shown(corners, joint, opened if y < 32 else -opened)
    return door_of(cells, box, joint, N, CENTER)


@pytest.mark.parametrize("opened", [0.0, 0.5, 1.2])
def test_a_door_is_known_where_it_is_closed_however_it_is_shown(opened):
    found = door(LEFT, 8.3, opened)
    np.testing.assert_allclose(found.low, LEFT[0], atol=1.5)
    np.testing.assert_allclose(found.high, LEFT[1], atol=2.1)
    assert found.turn.outside in (1, -1)
    # the way that it opens, turned to where it lies straight
    out = np.linalg.inv(found.quarter)[:3, :3] @ [-1, 0, 0]
    across = 3 - found.turn.axis - found.turn.along
    assert found.turn.outside == round(out[across])


def test_a_handle_is_not_counted_to_the_plate():
    handle = ((2.3, 28.3, 26.3), (10.5, 31.3, 38.3))
    cells = np.argwhere(np.minimum(block(*LEFT), block(*handle)) < 0)
    found = door_of(cells, box_of((2.3, *LEFT[0][1:]), LEFT[1]), hinge(8.3), N, CENTER)
    assert found.low[0] == pytest.approx(LEFT[0][0], abs=1.5)


def test_bins_on_the_inside_of_a_door_are_not_counted_to_the_plate():
    bins = ((14.0, 14.3, 14.3), (22.3, 28.3, 20.3))
    cells = np.argwhere(np.minimum(block(*LEFT), block(*bins)) < 0)
    found = door_of(cells, box_of(*LEFT), hinge(8.3), N, CENTER)
    assert found.low[0] == pytest.approx(LEFT[0][0], abs=1.5)
    assert found.high[0] == pytest.approx(LEFT[1][0], abs=1.5)


@pytest.mark.parametrize("opened", [(0, 0), (0.5, 0), (1.2, 0.5), (0, 1.57)])
def test_doors_that_share_a_strip_are_narrower_by_it(opened):
    doors = {3: door(LEFT, 8.3, opened[0]), 7: door(RIGHT, 56.3, opened[1])}
    turns = without_overlap(doors)
    widths = [turn.ends[1] - turn.ends[0] for turn in turns.values()]
    before = [d.turn.ends[1] - d.turn.ends[0] for d in doors.values()]
    assert sum(before) - sum(widths) == pytest.approx(6, abs=1.5)  # the strip, and two between
    for turn, d in zip(turns.values(), doors.values(), strict=True):
        assert turn.span == pytest.approx(d.turn.span)
        # the hinge's end stays
        assert min(abs(np.subtract(turn.ends, d.turn.ends))) < 1e-6


def test_doors_apart_or_one_upon_the_other_stay():
    far = ((10.3, 40.3, 12.3), (14.3, 56.3, 52.3))
    doors = {0: door(LEFT, 8.3), 1: door(far, 56.3)}
    assert [t.ends for t in without_overlap(doors).values()] == [
        pytest.approx(d.turn.ends) for d in doors.values()
    ]
    doors = {0: door(LEFT, 8.3), 1: door(LEFT, 8.3)}
    assert [t.ends for t in without_overlap(doors).values()] == [
        pytest.approx(d.turn.ends) for d in doors.values()
    ]


def test_upper_and_lower_doors_are_shorter():
    upper = ((10.3, 8.3, 30.3), (14.3, 56.3, 54.3))
    lower = ((10.3, 8.3, 10.3), (14.3, 56.3, 34.3))
    doors = {0: door(upper, 8.3, 0.4), 1: door(lower, 8.3, 0.0)}
    a, b = without_overlap(doors).values()
    assert a.span[0] - b.span[1] == pytest.approx(2, abs=0.1)
    assert a.span[1] == pytest.approx(54.3, abs=0.6) and b.span[0] == pytest.approx(10.3, abs=0.6)


def test_layers_around_a_door_are_all_frame_or_all_free():
    corners = ((10.3, 12.3, 12.3), (14.3, 52.3, 52.3))
    frame = np.maximum(
        block((10.3, 6.3, 6.3), (14.3, 58.3, 58.3)), -block((0, 12, 12), (66, 53, 53))
    )
    holes = (AT[2] % 10 < 3) & (AT[1] < 12)  # of the side at low y
    teeth = (AT[1] % 8 < 3) & (AT[2] > 52)  # of the one at high z, else free
    frame = np.where(holes, 1.0, frame)
    frame = np.where((AT[2] > 52) & (frame < 0) & ~teeth, 1.0, frame)
    body = np.minimum(BODY, frame)
    field = field_of(body, block(*corners))
    joint = hinge(12.3)
    cells = np.argwhere(solid_of(field, 1))
    plate = closed_door(cells, box_of(*corners), joint, solid_of(field, 0))
    assert (plate.axis, plate.side) == (0, -1)
    before = field.sdf.copy()
    straighten_rim(field, [0], plate)
    depth = (AT[0] > 11) & (AT[0] < 14)
    near = depth & (AT[1] > 9.5) & (AT[1] < 11.5) & (AT[2] > 13) & (AT[2] < 51)
    assert solid_of(field, 0)[near].all() and (before[near] > 0).any()
    above = depth & (AT[2] > 53) & (AT[2] < 54.5) & (AT[1] > 13) & (AT[1] < 51)
    assert not solid_of(field, 0)[above].any() and (before[above] < 0).any()
    far = block(*corners) > 5
    np.testing.assert_array_equal(field.sdf[far], before[far])


def test_what_only_slides_or_has_no_hinge_on_the_lattice_is_no_door():
    cells = np.argwhere(block(*LEFT) < 0)
    body = BODY < 0
    slides = Joint(np.zeros(3), (-1.0, 0, 0), travel=(0.0, 0.3))
    aslant = Joint(place_of((10.3, 8.3, 30)), np.array([0.0, 0.6, 0.8]), angle=(0.0, 1.5))
    for joint in (slides, aslant, Joint.fixed()):
        assert closed_door(cells, box_of(*LEFT), joint, body) is None
    assert closed_door(cells, box_of(*LEFT), hinge(8.3), body) is not None

"""Rooms behind doors and in drawers become boxes with flat walls; what is no room stays."""

import numpy as np
import pytest
from fields import AT, N, assert_same, block, box_of, copy_of, field_of, noise, place_of, solid_of
from scipy import ndimage

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.cleanup.rooms import with_clean_rooms
from uniart_jax.voxels.isosurface import ZERO

FIXED = Joint.fixed()
CASE = ((14.3, 8.3, 8.3), (56.3, 56.3, 56.3))
ROOM = ((13.0, 12.3, 12.3), (50.3, 52.3, 52.3))  # open in front, at low x
DOOR = ((10.3, 8.3, 8.3), (13.3, 56.3, 56.3))
SWINGS = Joint(place_of((10.3, 8.3, 30)), (0.0, 0, 1), angle=(0.0, 1.5))


def cabinet(more=None, less=None, room=ROOM):
    body = np.maximum(block(*CASE), -block(*room))
    if more is not None:
        body = np.where(more & (block(*CASE) < -1), -1.0, body)
    if less is not None:
        body = np.where(less & (block(*CASE) < -1), 1.0, body)
    return field_of(body, block(*DOOR))


def cleaned(field, door=SWINGS, box=DOOR):
    boxes = np.stack([box_of(*CASE), box_of(*box)])
    return with_clean_rooms(field, boxes, [FIXED, door], [-1, 0], [0])


def wrong(field, ideal, within=ROOM, margin=3.0):
    """Cells of the body that are not as the ideal, in and around a room."""
    near = block(*within) < margin
    return int(((solid_of(field, 0) != solid_of(ideal, 0)) & near).sum())


def test_lumps_crumbs_and_holes_in_walls_go():
    ideal = cabinet()
    inside = block(*ROOM) < 0
    lumps = noise(0, 0.002) & inside & (block(*ROOM) > -6)
    crumbs = noise(1, 0.0005) & inside
    holes = noise(2, 0.003) & (block(*ROOM) < 1.8) & ~inside & (AT[0] < 52.5)
    rough = cabinet(lumps | crumbs, holes)
    before = copy_of(rough)
    after = cleaned(rough)
    assert_same(rough, before)
    assert wrong(rough, ideal) > 3000
    assert wrong(after, ideal) < 0.02 * wrong(rough, ideal)
    assert (np.abs(after.sdf) >= ZERO).all()
    np.testing.assert_array_equal(solid_of(after, 1), solid_of(rough, 1))
    assert_same(cleaned(rough), after)


def test_a_shelf_that_is_mostly_there_becomes_whole_and_less_of_one_goes():
    shelf = (np.abs(AT[2] - 32) < 1.5) & (block(*ROOM) < 0)
    most, some = shelf & (noise(3, 0.05) | (AT[1] < 36)), shelf & (AT[1] < 24)
    after = cleaned(cabinet(most))
    assert solid_of(after, 0)[shelf & (AT[0] > 15)].all()
    assert wrong(cleaned(cabinet(some)), cabinet()) == 0


def test_a_divider_stays_too():
    wall = (np.abs(AT[1] - 32) < 1.5) & (block(*ROOM) < 0)
    after = cleaned(cabinet(wall & ~noise(4, 0.01)))
    assert solid_of(after, 0)[wall & (AT[0] > 15)].all()


def test_a_round_room_stays():
    radius = np.hypot(AT[1] - 32.3, AT[2] - 32.3)
    body = np.maximum(block(*CASE), -np.maximum(radius - 20, AT[0] - 50.3))
    field = field_of(body, block(*DOOR))
    assert wrong(cleaned(field), field) == 0


LID = ((8.3, 8.3, 53.3), (56.3, 56.3, 56.3))  # on top
LIFTS = Joint(place_of((8.3, 30, 56.3)), (0.0, 1, 0), angle=(-1.5, 0.0))


@pytest.mark.parametrize("widens", [0.0, 0.25])
def test_a_round_vessel_under_a_lid_stays_round(widens):
    """Also one that is wider above, and of which a square lid covers a part alone."""
    radius = np.hypot(AT[0] - 32.3, AT[1] - 32.3) - 23 + widens * (53.3 - AT[2])
    wall = np.maximum(radius, block((0, 0, 8.3), (64, 64, 52.3)))
    vessel = np.maximum(wall, -np.maximum(radius + 3, 12.3 - AT[2]))
    for low in (8.3, 32.3):
        lid = ((low, *LID[0][1:]), LID[1])
        field = field_of(vessel, block(*lid))
        boxes = np.stack([box_of((9.3, 9.3, 8.3), (55.3, 55.3, 52.3)), box_of(*lid)])
        after = with_clean_rooms(field, boxes, [FIXED, LIFTS], [-1, 0], [0])
        assert wrong(after, field, ((8, 8, 8), (57, 57, 57))) < 0.02 * solid_of(field, 0).sum()


@pytest.mark.parametrize(("first", "shuts"), [(12.3, True), (0, False)])
def test_a_frame_around_a_pane_shuts_a_room_and_a_bail_does_not(first, shuts):
    """A bail has three bars and is open where it hangs."""
    bars = np.maximum(block(*DOOR), -block((0, first, 12.3), (64, 52.3, 52.3)))
    crumbs = noise(1, 0.0005) & (block(*ROOM) < 0)
    body = np.where(crumbs, -1.0, np.maximum(block(*CASE), -block(*ROOM)))
    field = field_of(body, bars)
    assert wrong(field, cabinet()) > 300
    assert wrong(cleaned(field), cabinet() if shuts else field) == 0


def test_a_lump_on_one_wall_goes_and_a_room_without_a_back_is_cleaned():
    lump = block((16, 12, 20), (48, 16.5, 36)) < 0
    crumbs = noise(1, 0.0005) & (block(*ROOM) < 0)
    assert wrong(cleaned(cabinet(lump | crumbs)), cabinet()) < 0.15 * wrong(
        cabinet(lump | crumbs), cabinet()
    )
    open_back = ROOM[0], (64.0, *ROOM[1][1:])
    hole = block((30, 4, 28), (38, 13, 36)) < 0
    ideal, rough = cabinet(room=open_back), cabinet(crumbs, hole, room=open_back)
    assert wrong(cleaned(rough), ideal) < 0.3 * wrong(rough, ideal)


def test_between_two_bars_is_no_room():
    bars = np.minimum(
        block((14.3, 4.3, 8.3), (56.3, 7.3, 56.3)), block((14.3, 57.3, 8.3), (56.3, 60.3, 56.3))
    )
    crumbs = block((30.3, 28.3, 28.3), (36.3, 34.3, 34.3))
    field = field_of(np.minimum(bars, crumbs), block(*DOOR))
    assert wrong(cleaned(field), field) == 0


def test_what_is_full_stays_full():
    field = field_of(block(*CASE), block(*DOOR))
    assert wrong(cleaned(field), field) == 0
    sparse = cabinet(noise(5, 0.03) & (block(*ROOM) < 0))
    assert wrong(cleaned(sparse), sparse) == 0  # more solid than free


def test_a_room_of_two_doors_has_no_wall_between_them():
    halves = [((10.3, 8.3, 8.3), (13.3, 32.0, 56.3)), ((10.3, 32.6, 8.3), (13.3, 56.3, 56.3))]
    right = Joint(place_of((10.3, 56.3, 30)), (0.0, 0, 1), angle=(-1.5, 0.0))
    crumbs = noise(6, 0.0008) & (block(*ROOM) < 0)
    body = np.where(crumbs, -1.0, np.maximum(block(*CASE), -block(*ROOM)))
    field = field_of(body, *(block(*half) for half in halves))
    boxes = np.stack([box_of(*CASE), *(box_of(*half) for half in halves)])
    after = with_clean_rooms(field, boxes, [FIXED, SWINGS, right], [-1, 0, 0], [0])
    assert crumbs.sum() > 1000
    assert wrong(after, cabinet()) == 0


@pytest.mark.parametrize("quarter", [1, 2, 3])
def test_a_room_may_open_to_any_side(quarter):
    turn = lambda values: np.rot90(values, quarter, (0, 1))  # noqa: E731
    rough = cabinet(noise(7, 0.001) & (block(*ROOM) < 0))
    angle = -quarter * np.pi / 2
    matrix = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    point = np.array([10.3, 8.3]) - (N + 1) / 2
    hinge = np.append(matrix @ point + (N + 1) / 2, 30)
    joint = Joint(place_of(hinge), (0.0, 0, 1), angle=(0.0, 1.5))
    ends = np.array([DOOR[0][:2], DOOR[1][:2]]) - (N + 1) / 2
    ends = np.sort(ends @ matrix.T + (N + 1) / 2, axis=0)
    box = np.c_[ends, [8.3, 56.3]]
    turned = type(rough)(*(turn(v).copy() for v in (rough.sdf, rough.owner, rough.source)))
    after = cleaned(turned, joint, tuple(box))
    np.testing.assert_array_equal(after.sdf < 0, turn(cleaned(rough).sdf < 0))
    assert (after.sdf < 0).sum() < (turned.sdf < 0).sum()


def test_what_moves_in_a_room_stays():
    rack = ((20.3, 13.3, 30.3), (45.3, 51.3, 33.3))
    slides = Joint(np.zeros(3), (-1.0, 0, 0), travel=(0.0, 0.3))
    body = np.maximum(block(*CASE), -block(*ROOM))
    field = field_of(body, block(*DOOR), block(*rack))
    boxes = np.stack([box_of(*CASE), box_of(*DOOR), box_of(*rack)])
    after = with_clean_rooms(field, boxes, [FIXED, SWINGS, slides], [-1, 0, 0], [0])
    lost = solid_of(field, 2) & ~solid_of(after, 2)
    assert lost.sum() < 0.02 * solid_of(field, 2).sum()


# a drawer that is closed: front, floor and walls
def test_doors_of_parts_that_move_are_left():
    rough = cabinet(noise(9, 0.001) & (block(*ROOM) < 0))
    lifts = Joint(np.zeros(3), (0.0, 0, 1), travel=(0.0, 0.3))
    top = block((14.3, 8.3, 58), (56.3, 56.3, 62.3))
    field = field_of(np.where(solid_of(rough, 0), -1.0, 3.0), block(*DOOR), top)
    boxes = np.stack([box_of(*CASE), box_of(*DOOR), box_of((14.3, 8.3, 58), (56.3, 56.3, 62.3))])
    after = with_clean_rooms(field, boxes, [FIXED, SWINGS, lifts], [-1, 2, 0], [0])
    assert wrong(after, field) == 0
    after = with_clean_rooms(field, boxes, [FIXED, SWINGS, lifts], [-1, 0, 0], [0])
    assert wrong(after, field) > 0


def test_the_gap_around_a_door_is_straight_too():
    door = ((14.3, 12.3, 12.3), (17.3, 52.3, 52.3))
    frame = np.maximum(block((14.3, 6.3, 6.3), (56.3, 58.3, 58.3)), -block(*ROOM))
    teeth = (block(*door) < 1.6) & (AT[1] % 8 < 3) & (AT[2] > 52.5) & (AT[0] > 14.5) & (AT[0] < 17)
    free = (block(*door) < 1.6) & (AT[2] > 52.5) & ~teeth
    body = np.where(free, 1.0, np.maximum(frame, 0.6 - block(*door)))
    field = field_of(np.where(teeth, -1.0, body), block(*door))
    joint = Joint(place_of((14.3, 12.3, 30)), (0.0, 0, 1), angle=(0.0, 1.5))
    inner = teeth & (AT[1] > 14) & (AT[1] < 51) & (AT[2] < 53.5)
    assert solid_of(field, 0)[inner].any()
    assert not solid_of(cleaned(field, joint, door), 0)[inner].any()


def test_what_is_filled_keeps_a_cell_from_what_moves():
    shelf = (np.abs(AT[2] - 32) < 1.5) & (block(*ROOM) < 0)
    rack = ((26.3, 26.3, 25.3), (38.3, 38.3, 38.3))
    body = np.where(shelf, -1.0, np.maximum(block(*CASE), -block(*ROOM)))
    field = field_of(np.maximum(body, 3 - block(*rack)), block(*DOOR), block(*rack))
    slides = Joint(np.zeros(3), (0.0, 0, 1), travel=(0.0, 0.1))
    boxes = np.stack([box_of(*CASE), box_of(*DOOR), box_of(*rack)])
    after = with_clean_rooms(field, boxes, [FIXED, SWINGS, slides], [-1, 0, 0], [0])
    new = solid_of(after, 0) & ~solid_of(field, 0)
    assert new.any() and not (new & ndimage.binary_dilation(solid_of(field, 2))).any()


def test_an_inset_door_in_a_frame_without_a_back_is_borne():
    frame = np.maximum(
        block((10.3, 8.3, 8.3), (56.3, 56.3, 56.3)), -block((0, 12.3, 12.3), (66, 52.3, 52.3))
    )
    inset = ((10.3, 15.3, 15.3), (13.3, 49.3, 49.3))
    field = field_of(frame, block(*inset))
    joint = Joint(place_of((10.3, 15.3, 30)), (0.0, 0, 1), angle=(0.0, 1.5))
    after = cleaned(field, joint, inset)
    np.testing.assert_array_equal(after.sdf < 0, field.sdf < 0)


@pytest.mark.parametrize("reach", [10.3, 8.3, 5.3, 2.3])
def test_a_doors_handle_changes_nothing_around_it(reach):
    frame = np.maximum(block((14.3, 6.3, 6.3), (56.3, 58.3, 58.3)), -block(*ROOM))
    door = ((12.3, 9.3, 9.3), (16.3, 55.3, 55.3))
    handle = block((reach, 45.3, 26.3), (13.0, 48.3, 38.3))
    body = np.maximum(frame, 0.6 - block(*door))
    field = field_of(body, np.minimum(block(*door), handle))
    joint = Joint(place_of((12.3, 9.3, 30)), (0.0, 0, 1), angle=(0.0, 1.5))
    box = ((min(reach, 12.3), *door[0][1:]), door[1])
    after = cleaned(field, joint, box)
    changed = (after.sdf < 0) != (field.sdf < 0)
    assert not changed[(AT[0] < 14) | (block(*door) > 4.5)].any()
    lost = solid_of(field, 0) & ~solid_of(after, 0) & (AT[0] < 18) & (AT[1] < 8)
    assert not lost.any()


def test_a_closed_doors_edges_are_straight_and_ridges_behind_it_go():
    teeth = (AT[2] % 8 < 3) & (AT[1] < 10.5) & (AT[0] > 12)  # missing at the hinge
    beyond = (AT[2] % 8 < 2) & (np.abs(AT[1] - 57.5) < 1) & (AT[0] > 10.3) & (AT[0] < 13.3)
    ridge = (np.abs(AT[1] - 30) < 1.5) & (AT[2] > 20) & (AT[2] < 44) & (AT[0] > 13) & (AT[0] < 14.5)
    shelf = (np.abs(AT[2] - 14) < 1.5) & (AT[1] > 20) & (AT[1] < 44) & (AT[0] > 13) & (AT[0] < 20)
    ideal = block(*DOOR)
    rough = np.where(beyond & (AT[2] > 9) & (AT[2] < 56), -1.0, np.where(teeth, 1.0, ideal))
    rough = np.where(ridge | shelf, -1.0, rough)
    body = np.maximum(block(*CASE), -block(*ROOM))
    before = field_of(np.maximum(body, 0.6 - rough), rough)
    after = solid_of(cleaned(before), 1)
    assert (solid_of(before, 1) != (ideal < 0)).sum() > 200
    np.testing.assert_array_equal(after & ~shelf, (ideal < 0) & ~shelf)
    assert after[shelf & (AT[0] > 15) & (AT[0] < 19)].all()


def test_a_small_doors_edges_are_straight_too():
    small = ((10.3, 24.3, 24.3), (13.3, 36.3, 36.3))
    teeth = (AT[2] % 6 < 3) & (AT[1] < 27) & (AT[0] > 11)
    body = np.maximum(block(*CASE), -block((13.0, 27.3, 27.3), (50.3, 33.3, 33.3)))
    joint = Joint(place_of((10.3, 24.3, 30)), (0.0, 0, 1), angle=(0.0, 1.5))
    field = field_of(body, np.where(teeth, 1.0, block(*small)))
    assert (solid_of(field, 1) != (block(*small) < 0)).sum() > 10
    np.testing.assert_array_equal(solid_of(cleaned(field, joint, small), 1), block(*small) < 0)


def test_a_door_that_is_shown_ajar_keeps_its_cells():
    angle, at = 0.1, AT[:2] - np.array([10.3, 8.3])[:, None, None, None]
    along = at[1] * np.cos(angle) - at[0] * np.sin(angle)
    across = at[0] * np.cos(angle) + at[1] * np.sin(angle)
    sides = np.maximum(np.abs(along - 24) - 24, np.abs(AT[2] - 32.3) - 24)
    plate = np.maximum(np.abs(across - 1.5) - 1.5, sides)
    body = np.maximum(block(*CASE), -block(*ROOM))
    field = field_of(np.maximum(body, 0.6 - plate), plate)
    cells = np.argwhere(solid_of(field, 1))
    ajar = Joint(SWINGS.origin, SWINGS.direction, angle=(-angle, 1.3))
    for joint in (ajar, Joint(ajar.origin, -ajar.direction, angle=(-1.3, angle))):
        after = cleaned(field, joint, (cells.min(0) - 0.5, cells.max(0) + 0.5))
        np.testing.assert_array_equal(solid_of(after, 1), solid_of(field, 1))


def test_a_round_doors_edge_stays():
    plate = np.maximum(np.hypot(AT[1] - 32.3, AT[2] - 32.3) - 23.7, np.abs(AT[0] - 11.8) - 1.5)
    body = np.maximum(block(*CASE), -block(*ROOM))
    field = field_of(body, plate)
    np.testing.assert_array_equal(solid_of(cleaned(field), 1), solid_of(field, 1))


def test_what_a_door_closes_against_begins_in_one_layer_and_has_no_gaps():
    ideal = cabinet()
    walls = (block(*CASE) < 0) & (block(*ROOM) > 0) & (AT[0] < 50)
    torn = walls & ((AT[1] + AT[2]) % 9 < 3) & (AT[0] < 15.5)
    slot = walls & (np.abs(AT[2] - 10.5) < 0.8) & (AT[1] > 26) & (AT[1] < 38)
    body = np.where(torn | slot, 1.0, np.maximum(block(*CASE), -block(*ROOM)))
    bits = (
        ((AT[1] + AT[2]) % 9 > 6) & (AT[0] > 13.5) & (AT[0] < 14.5) & (block(*ROOM)[20] > 0)[None]
    )
    bits &= (AT[1] > 9) & (AT[1] < 56) & (AT[2] > 9) & (AT[2] < 56)  # before the walls
    rough = field_of(np.where(bits, -1.0, body), block(*DOOR))
    assert solid_of(rough, 0)[bits].all() and bits.any()
    rim = (AT[0] > 13.5) & (AT[0] < 17) & (block(*DOOR)[14] < 3)[None]
    rim &= (AT[1] > 9) & (AT[1] < 56) & (AT[2] > 9) & (AT[2] < 56)
    wrong_before = (solid_of(rough, 0) != solid_of(ideal, 0)) & rim
    wrong_after = (solid_of(cleaned(rough), 0) != solid_of(ideal, 0)) & rim
    assert wrong_before.sum() > 100 and not wrong_after.any()

"""Drawers, as ``rooms`` cleans them: boxes open at the top behind fronts with straight edges."""

import numpy as np
from fields import AT, block, box_of, field_of, noise, solid_of
from scipy import ndimage

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.cleanup.rooms import with_clean_rooms

FIXED = Joint.fixed()
BOX = ((10.3, 14.3, 24.3), (44.3, 50.3, 40.3))
TRAY = ((14.3, 18.3, 28.3), (40.3, 46.3, 41))
PULLS = Joint(np.zeros(3), (-1.0, 0, 0), travel=(0.0, 0.4))


def drawer(torn=None, body=None):
    case = np.maximum(
        block((14.3, 8.3, 18.3), (52.3, 56.3, 46.3)), -block((13, 14, 24), (46, 51, 41))
    )
    tray = np.maximum(block(*BOX), -block(*TRAY))
    if torn is not None:
        tray = np.where(torn, 2.0, tray)
    if body is not None:
        case = np.where(body, -1.0, case)
    return field_of(case, tray)


def pulled(field):
    boxes = np.stack([box_of((14.3, 8.3, 18.3), (52.3, 56.3, 46.3)), box_of(*BOX)])
    return with_clean_rooms(field, boxes, [FIXED, PULLS], [-1, 0], [0])


def differs(field, ideal):
    return int((solid_of(field, 1) != solid_of(ideal, 1)).sum())


def test_a_torn_drawer_becomes_whole():
    torn = noise(8, 0.01) & (block(*TRAY) > 0)
    rough, ideal = drawer(torn), drawer()
    assert differs(rough, ideal) > 1500
    after = pulled(rough)
    assert differs(after, ideal) < 0.55 * differs(rough, ideal)  # walls, from within
    lining = (block(*TRAY) > 0) & (block(*TRAY) < 1.9) & (block(*BOX) < 0) & (AT[2] < 40)
    assert solid_of(after, 1)[lining].all() and not solid_of(rough, 1)[lining].all()
    front = (block(*BOX) < -1) & (AT[0] < 14)
    assert solid_of(after, 1)[front].all()


def test_a_drawer_without_a_floor_has_one():
    hole = (
        (AT[2] < 28.5)
        & (block(*TRAY) < 4)
        & (AT[0] < 40)
        & (AT[0] > 15)
        & (AT[1] > 19)
        & (AT[1] < 46)
    )
    field = drawer(hole)
    floor = (AT[2] > 25) & (AT[2] < 27) & (AT[0] > 20) & (AT[0] < 38) & (AT[1] > 20) & (AT[1] < 44)
    assert not solid_of(field, 1)[floor].any()
    assert solid_of(pulled(field), 1)[floor].all()


def test_what_of_the_body_is_in_a_drawers_front_is_the_drawers():
    teeth = (block(*BOX) < -1) & (AT[0] < 14) & (AT[2] % 8 < 3) & (AT[1] < 30)
    field = drawer(teeth, teeth)
    assert (solid_of(field, 0) & teeth).sum() > 50
    after = pulled(field)
    assert solid_of(after, 1)[teeth].all() and not solid_of(after, 0)[teeth].any()


def test_a_rack_of_rods_stays_as_it_is():
    """Between rods no line meets a wall: all of them would go."""
    rods = (AT[1] % 8 < 2) & (AT[0] % 8 < 2) & (block(*TRAY) > 0)
    field = drawer(~rods & (block(*BOX) < 1) & (AT[2] > 28))
    assert solid_of(field, 1).sum() > 1000
    sparse = drawer(~rods & (block(*BOX) < 1))
    assert solid_of(sparse, 1).sum() > 100
    after = pulled(sparse)
    np.testing.assert_array_equal(solid_of(after, 1), solid_of(sparse, 1))


def test_a_drawers_room_begins_behind_its_front_whatever_handle_it_has():
    rooms = []
    for reach in (10.3, 7.3, 4.3):
        handle = block((reach, 30.3, 31.3), (11.0, 34.3, 33.3))
        field = drawer()
        tray = np.minimum(np.maximum(block(*BOX), -block(*TRAY)), handle)
        case = np.where(solid_of(field, 0), -1.0, 3.0)
        crumbs = (block(*TRAY) < -1) & (AT[0] < 18) & (AT[2] < 31)  # behind the front
        made = field_of(case, np.where(crumbs, -1.0, tray))
        box = box_of((reach, *BOX[0][1:]), BOX[1])
        boxes = np.stack([box_of((14.3, 8.3, 18.3), (52.3, 56.3, 46.3)), box])
        after = with_clean_rooms(made, boxes, [FIXED, PULLS], [-1, 0], [0])
        rooms.append(solid_of(after, 1) & (AT[0] > 12))
        assert not (solid_of(after, 1) & crumbs).any()
    assert (rooms[0] == rooms[1]).all() and (rooms[0] == rooms[2]).all()


def rough_drawer(*lumps, away=None):
    """A drawer with more cells, or without some, its box as before."""
    field, tray = drawer(), np.maximum(block(*BOX), -block(*TRAY))
    for lump in lumps:
        tray = np.where(lump, -1.0, tray)
    if away is not None:
        tray = np.where(away, 2.0, tray)
    return field_of(np.where(solid_of(field, 0), -1.0, 3.0), tray)


def test_nothing_stands_out_from_the_edges_of_a_drawers_front():
    beside = (AT[0] > 10.3) & (AT[0] < 13) & (AT[2] > 40) & (AT[2] < 43) & (AT[1] % 9 < 4)
    beside &= (AT[1] > 15) & (AT[1] < 50)
    ahead = (AT[0] > 8.5) & (AT[0] < 10.3) & (AT[2] > 38.5) & (AT[2] < 40) & (AT[1] % 7 < 3)
    ahead &= (AT[1] > 15) & (AT[1] < 50)
    handle = block((5.3, 30.3, 31.3), (10.5, 34.3, 33.3)) < 0
    field = rough_drawer(beside, ahead, handle)
    after = pulled(field)
    for lump in (beside, ahead):
        assert lump.sum() > 20 and solid_of(field, 1)[lump].all()
        assert not solid_of(after, 1)[lump].any()
    assert solid_of(after, 1)[handle].all()
    assert solid_of(after, 1)[(block(*BOX) < -1) & (AT[0] < 14)].all()


def test_a_drawer_that_opens_to_the_other_side_is_its_mirror_image():
    lumps = noise(3, 0.03) & (block(*BOX) < 3) & (block(*BOX) > -4)
    field = rough_drawer(lumps)
    boxes = np.stack([box_of((14.3, 8.3, 18.3), (52.3, 56.3, 46.3)), box_of(*BOX)])
    mirrored = field_of(
        *(np.where(solid_of(field, k)[::-1], -1.0, 3.0) for k in (0, 1)),
    )
    plain = field_of(*(np.where(solid_of(field, k), -1.0, 3.0) for k in (0, 1)))
    flip = np.array([-1, 1, 1, 1, 1, 1])
    pushes = Joint(np.zeros(3), (1.0, 0, 0), travel=(0.0, 0.4))
    there = with_clean_rooms(mirrored, boxes * flip, [FIXED, pushes], [-1, 0], [0])
    here = with_clean_rooms(plain, boxes, [FIXED, PULLS], [-1, 0], [0])
    for part in (0, 1):
        np.testing.assert_array_equal(solid_of(there, part)[::-1], solid_of(here, part))
    assert (solid_of(here, 1) != solid_of(plain, 1)).sum() > 500


def test_a_pull_along_the_upper_edge_of_a_front_stays():
    pull = block((5.3, 20.3, 37.3), (10.5, 44.3, 40.3)) < 0
    after = pulled(rough_drawer(pull))
    assert solid_of(after, 1)[pull].all()


def test_the_walls_of_a_drawer_end_at_one_height():
    """Above it there are teeth, and below it gaps."""
    behind = (AT[0] > 14.3) & (block(*TRAY) > 0) & (AT[2] > 28)
    teeth = AT[0] % 6 < 2
    away = behind & (((AT[2] > 36) & ~(teeth & (AT[1] < 30))) | ((AT[2] > 34) & teeth))
    after = solid_of(pulled(rough_drawer(away=away)), 1)
    walls = ((AT[1] > 14.3) & (AT[1] < 18.3)) | ((AT[1] > 46.3) & (AT[1] < 50.3))
    walls &= (AT[0] > 18) & (AT[0] < 37)
    columns = (after & walls)[walls.any(2)]
    tops = np.where(columns.any(1), columns.shape[1] - 1 - columns[:, ::-1].argmax(1), 0)
    assert set(tops.tolist()) <= {35, 36, 37} and len(set(tops.tolist())) == 1


def test_the_frame_around_a_closed_drawers_front_is_straight_and_that_of_an_open_one_stays():
    """An inset front; teeth of its frame reach into the gap around it."""
    frame = np.maximum(block((10.3, 8.3, 18.3), (52.3, 56.3, 46.3)), 1.4 - block(*BOX))
    near = (block(*BOX) < 1.6) & (block(*BOX) > 0) & (AT[0] > 11)
    teeth = near & (AT[0] < 14) & (AT[2] > 40.5) & (AT[1] % 9 < 3) & (AT[1] > 16) & (AT[1] < 48)
    assert teeth.sum() > 20
    tray = np.maximum(block(*BOX), -block(*TRAY))
    boxes = np.stack([box_of((10.3, 8.3, 18.3), (52.3, 56.3, 46.3)), box_of(*BOX)])
    field = field_of(np.where(teeth, -1.0, frame), tray)
    for low, goes in ((0.0, True), (-0.04, False), (-0.2, False)):
        slide = Joint(np.zeros(3), (-1.0, 0, 0), travel=(low, 0.4 + low))
        after = with_clean_rooms(field, boxes, [FIXED, slide], [-1, 0], [0])
        left = solid_of(after, 0)[teeth]
        assert not left.any() if goes else left.all()


def test_the_frame_of_a_drawer_with_a_handle_stays_under_a_top_that_overhangs():
    frame = np.maximum(block((10.3, 8.3, 18.3), (52.3, 56.3, 46.3)), 1.4 - block(*BOX))
    top = block((1.3, 8.3, 46.3), (52.3, 56.3, 50.3))
    handle = block((3.3, 28.3, 31.3), (10.5, 36.3, 33.3))
    tray = np.minimum(np.maximum(block(*BOX), -block(*TRAY)), handle)
    box = box_of((3.3, *BOX[0][1:]), BOX[1])
    boxes = np.stack([box_of((1.3, 8.3, 18.3), (52.3, 56.3, 50.3)), box])
    field = field_of(np.minimum(frame, top), tray)
    after = with_clean_rooms(field, boxes, [FIXED, PULLS], [-1, 0], [0])
    ring = solid_of(field, 0) & (AT[0] < 15) & (AT[2] < 46)
    assert ring.sum() > 500 and solid_of(after, 0)[ring].mean() > 0.97


def test_a_front_keeps_a_cell_from_what_moves():
    torn = (block(*BOX) < 1) & (AT[0] < 14) & (AT[1] > 38) & (AT[2] > 34)
    other = block((9.3, 44.3, 36.3), (13.3, 48.3, 39.3))
    base = drawer(torn)
    tray = np.where(torn | ~solid_of(base, 1), 2.0, -1.0)
    field = field_of(np.where(solid_of(base, 0), -1.0, 2.0), tray, other)
    boxes = np.stack([box_of((14.3, 8.3, 18.3), (52.3, 56.3, 46.3)), box_of(*BOX)])
    boxes = np.concatenate([boxes, box_of((9.3, 44.3, 36.3), (13.3, 48.3, 39.3))[None]])
    lifts = Joint(np.zeros(3), (0.0, 0, 1), travel=(0.0, 0.1))
    after = with_clean_rooms(field, boxes, [FIXED, PULLS, lifts], [-1, 0, 0], [0])
    new = solid_of(after, 1) & ~solid_of(field, 1) & (AT[0] < 14)
    assert new.any() and not (new & ndimage.binary_dilation(solid_of(field, 2))).any()


def test_a_block_that_slides_is_no_drawer():
    field = field_of(block((14.3, 8.3, 42), (52.3, 56.3, 46.3)), block(*BOX))
    assert differs(pulled(field), field) == 0

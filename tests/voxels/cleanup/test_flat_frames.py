"""Frames around doors become flat; their steps and niches, doors and what is open stay."""

import numpy as np
from fields import AT, assert_same, block, copy_of, field_of, noise, solid_of

from uniart_jax.voxels.cleanup.frames import with_flat_frames
from uniart_jax.voxels.cleanup.fronts import Front

CASE = ((10.3, 8.3, 8.3), (56.3, 56.3, 56.3))
ROOM = ((9.0, 14.3, 14.3), (50.3, 50.3, 50.3))
DOOR = ((10.3, 16.3, 16.3), (13.3, 48.3, 48.3))  # inset: the stiles beside it are six wide
FRONT = Front(0, -1, np.array([11, 17, 17]), np.array([14, 49, 49]))
BEFORE = AT[0] < 18  # the cells at the frame


def cabinet(body=None):
    hollow = np.maximum(block(*CASE), -block(*ROOM))
    return field_of(hollow if body is None else body, block(*DOOR))


def flattened(field, fronts=(FRONT,)):
    after = copy_of(field)
    with_flat_frames(after, [0], list(fronts))
    return after


def wrong(field, ideal):
    return int(((solid_of(field, 0) != solid_of(ideal, 0)) & BEFORE).sum())


def rough(seed=0):
    """Teeth on the frame, up to two cells out and three in."""
    hollow = np.maximum(block(*CASE), -block(*ROOM))
    taller = np.maximum(block((8.3, *CASE[0][1:]), CASE[1]), -block((7.0, *ROOM[0][1:]), ROOM[1]))
    lower = np.maximum(block((13.3, *CASE[0][1:]), CASE[1]), -block(*ROOM))
    columns = [np.broadcast_to(noise(seed + k, 0.02)[20:21], hollow.shape) for k in range(2)]
    return cabinet(np.where(columns[0], taller, np.where(columns[1], lower, hollow)))


def test_teeth_go_and_the_door_stays():
    field, ideal = rough(), cabinet()
    before = copy_of(field)
    after = flattened(field)
    assert wrong(field, ideal) > 1000
    assert wrong(after, ideal) < 0.15 * wrong(field, ideal)
    np.testing.assert_array_equal(solid_of(after, 1), solid_of(before, 1))
    np.testing.assert_array_equal(after.sdf[20:], field.sdf[20:])
    assert_same(flattened(field), after)


def test_a_flat_frame_and_a_body_without_fronts_stay():
    field = cabinet()
    assert wrong(flattened(field), field) == 0
    assert_same(flattened(rough(), ()), rough())


def test_a_step_of_the_frame_stays():
    top = block((6.3, 8.3, 52.3), (14.3, 56.3, 56.3))  # a cornice, four cells before the rest
    field = cabinet(np.minimum(np.maximum(block(*CASE), -block(*ROOM)), top))
    after = flattened(field)
    assert wrong(after, field) == 0


def test_rubble_is_brought_forward_and_a_niche_with_a_ground_is_not():
    hollow = np.maximum(block(*CASE), -block(*ROOM))
    stile = (AT[1] > 9) & (AT[1] < 14) & (AT[2] > 20) & (AT[2] < 34)
    deep = 12 + (3 * AT[1] + 5 * AT[2]) % 7
    rubble = cabinet(np.where(stile & (AT[0] < deep), 1.0, hollow))
    assert wrong(flattened(rubble), cabinet()) < 0.15 * wrong(rubble, cabinet())
    niche = cabinet(np.where(stile & (AT[0] < 17), 1.0, hollow))
    assert wrong(flattened(niche), niche) == 0


def test_what_is_open_below_stays_open():
    body = np.maximum(block(*CASE), -block(*ROOM))
    body = np.maximum(body, -block((9, 18.3, 5), (60, 46.3, 13.3)))  # between two feet
    field = cabinet(body)
    after = flattened(field)
    opening = (block((9, 18.3, 5), (60, 46.3, 13.3)) < 0) & BEFORE
    assert not solid_of(after, 0)[opening].any()


def test_a_front_seen_from_another_side_and_outside_the_grid():
    turned = [np.moveaxis(v, 0, 1)[:, ::-1] for v in (rough().sdf, rough().owner, rough().source)]
    field = type(rough())(*(np.ascontiguousarray(v) for v in turned))
    front = Front(1, 1, np.array([17, 52, 17]), np.array([49, 55, 49]))
    after = flattened(field, [front])
    back = np.moveaxis(after.sdf[:, ::-1], 1, 0)
    assert ((back < 0) != (flattened(rough()).sdf < 0)).sum() == 0
    beyond = Front(0, -1, np.array([64, 17, 17]), np.array([65, 49, 49]))
    assert wrong(flattened(cabinet(), [beyond]), cabinet()) == 0


def test_a_slot_stays_open():
    slot = block((9, 28.3, 50.6), (60, 36.3, 54.3))  # eight wide, four high, above the door
    field = cabinet(np.maximum(np.maximum(block(*CASE), -block(*ROOM)), -slot))
    after = flattened(field)
    assert not solid_of(after, 0)[(slot < 0) & BEFORE].any()


def test_nothing_is_filled_around_and_before_thin_fronts():
    """A wide drawer three high between two narrower doors; gaps of the frame are closed up to
    ten."""
    hollow = np.maximum(block(*CASE), -block((9.0, 20.3, 12.3), (50.3, 44.3, 52.3)))
    hollow = np.maximum(hollow, -block((9.0, 11.3, 30.3), (50.3, 53.3, 35.3)))
    doors = [((10.3, 22.3, z), (13.3, 42.3, z + 15)) for z in (13.3, 36.8)]
    drawer = ((14.3, 12.3, 31.3), (17.3, 52.3, 34.3))  # set back
    field = field_of(hollow, *(block(*box) for box in (*doors, drawer)))
    fronts = [
        Front(0, -1, np.array([11, 23, 14]), np.array([14, 43, 29])),
        Front(0, -1, np.array([11, 23, 37]), np.array([14, 43, 52])),
        Front(0, -1, np.array([15, 13, 32]), np.array([18, 53, 35])),
    ]
    after = flattened(field, fronts)
    assert (solid_of(after, 0) & ~solid_of(field, 0)).sum() == 0
    for part in (1, 2, 3):
        np.testing.assert_array_equal(solid_of(after, part), solid_of(field, part))


def test_a_lid_has_a_frame_too():
    field, ideal = (
        type(f)(*(np.moveaxis(v, 0, 2)[:, :, ::-1].copy() for v in (f.sdf, f.owner, f.source)))
        for f in (rough(), cabinet())
    )
    lid = Front(2, 1, np.array([17, 17, 52]), np.array([49, 49, 55]))
    after = flattened(field, [lid])
    off = [(solid_of(f, 0) != solid_of(ideal, 0)).sum() for f in (field, after)]
    assert off[1] < 0.3 * off[0]

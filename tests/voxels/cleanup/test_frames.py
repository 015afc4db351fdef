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
    with_flat_frames(after, list(fronts), [0])
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
    outside = Front(0, -1, np.array([64, 17, 17]), np.array([65, 49, 49]))
    flattened(field, [outside])

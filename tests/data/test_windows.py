"""Training on some windows of an object."""

import numpy as np
from hand_records import make_record

from uniart_jax.data.windows import choose_windows
from uniart_jax.nn.voxel_plans import serial_ids

WINDOW = 8


def chosen(record, seed, voxels=32):
    return choose_windows(record, voxels, WINDOW, np.random.default_rng(seed))


def test_whole_windows_of_the_whole_object_in_order():
    record = make_record(voxels=150, parts=3)
    runs = serial_ids(record.coords[None].astype(np.int32), np.array([len(record.coords)]), WINDOW)[
        0
    ]
    place = {tuple(c): i for i, c in enumerate(record.coords.tolist())}
    for seed in range(10):
        part = chosen(record, seed)
        index = np.array([place[tuple(c)] for c in part.coords.tolist()])
        assert (np.diff(index) > 0).all() and len(index) <= 32
        for run in np.unique(runs[index]):
            assert (runs[index] == run).sum() == (runs == run).sum()
        for name in ("sdf", "color", "owner", "voxel_part"):
            np.testing.assert_array_equal(getattr(part, name), getattr(record, name)[index])
        np.testing.assert_array_equal(part.boxes, record.boxes)


def test_small_objects_are_kept_whole_and_draws_differ_by_seed():
    record = make_record(voxels=150, parts=3)
    assert choose_windows(record, 1000, WINDOW, np.random.default_rng(0)) is record
    draws = {chosen(record, seed).coords.tobytes() for seed in range(8)}
    assert len(draws) > 4
    assert chosen(record, 3).coords.tobytes() == chosen(record, 3).coords.tobytes()


def test_small_parts_are_seen_more_often_than_their_share():
    import dataclasses

    record = make_record(voxels=160, parts=2)
    count = len(record.coords)
    part = np.zeros(count, np.uint8)
    part[:4] = 1  # the first voxels lie together in the Morton order's beginning
    record = dataclasses.replace(record, voxel_part=part)
    share = np.mean([(chosen(record, seed).voxel_part == 1).sum() / 4 for seed in range(200)])
    assert share > 1.5 * 32 / count

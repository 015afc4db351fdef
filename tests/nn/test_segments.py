import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_voxels import members

from uniart_jax.nn.segments import (
    fitted_sizes,
    pack_segments,
    plan_segments,
    round_rows,
    row_choices,
)
from uniart_jax.nn.voxel_plans import window_ids


@given(st.integers(0, 10_000), st.integers(1, 3), st.integers(1, 40), st.integers(1, 6))
def test_every_valid_token_is_in_one_segment_of_equal_ids(seed, items, width, kinds):
    rng = np.random.default_rng(seed)
    ids = rng.integers(0, kinds, (items, width))
    counts = rng.integers(0, width + 1, items)
    plan = plan_segments(ids, counts, ((items * kinds, 5), (items * (width // 5 + kinds), 10)))
    segments = members(plan, items * width)
    tokens = np.sort(np.concatenate([*segments, np.zeros(0, int)]))
    valid = np.arange(width) < counts[:, None]
    np.testing.assert_array_equal(tokens, np.flatnonzero(valid))
    pieces = {}
    for segment in segments:
        labels = {(t // width, ids[t // width, t % width]) for t in segment}
        assert len(labels) == 1
        pieces.setdefault(labels.pop(), []).append(len(segment))
    for lengths in pieces.values():  # cut only where longer than the largest bucket
        assert len(lengths) == -(-sum(lengths) // 10)


def test_too_many_segments_is_an_error():
    with pytest.raises(ValueError, match="capacities"):
        plan_segments(np.arange(6)[None], np.array([6]), ((5, 4),))


@given(st.integers(0, 10_000), st.integers(1, 3), st.integers(1, 60), st.integers(1, 9))
def test_packed_rows_hold_every_segment_whole(seed, items, width, kinds):
    rng = np.random.default_rng(seed)
    ids = rng.integers(0, kinds, (items, width))
    counts = rng.integers(0, width + 1, items)
    plan = pack_segments(ids, counts, (4, 8, 16))
    segments = members(plan, items * width)
    tokens = np.sort(np.concatenate([*segments, np.zeros(0, int)]))
    np.testing.assert_array_equal(tokens, np.flatnonzero(np.arange(width) < counts[:, None]))
    wholes = [n for own, c in zip(ids, counts, strict=True) for n in np.bincount(own[:c]) if n]
    pieces = [min(16, n - start) for n in wholes for start in range(0, n, 16)]
    assert sorted(map(len, segments)) == sorted(pieces)  # only what is longer than a row is cut


def test_packing_leaves_little_padding():
    """Windows of a curved surface at 64^3: under 15 % of the tokens, with rows rounded up."""
    grid = np.stack(np.meshgrid(*[np.arange(64)] * 3, indexing="ij"), -1).reshape(-1, 3)
    radius = np.linalg.norm((grid - 31.5) / (29, 24, 20), axis=1)
    coords = grid[np.abs(radius - 1) < 0.035][None]
    counts = np.array([coords.shape[1]])
    assert 8_000 < counts[0] < 20_000
    for shift in (0, 4):
        ids = window_ids(coords, 8, shift)
        plan = pack_segments(ids, counts, fitted_sizes(ids, counts, 512))
        assert sum(bucket.index.size for bucket in plan.buckets) <= 1.15 * counts[0]


def test_rows_are_rounded_by_at_most_an_eighth():
    rounded = [round_rows(n) for n in range(1, 500)]
    assert all(n <= r <= n * 9 / 8 for n, r in enumerate(rounded, 1))
    assert len(set(rounded)) < 60


@given(st.lists(st.integers(1, 16), min_size=1, max_size=40))
def test_the_largest_choice_of_rows_is_always_enough(lengths):
    """Also for windows that hardly fit together: two of nine tokens never share a row of
    sixteen."""
    ids = np.repeat(np.arange(len(lengths)), lengths)[None]
    rows = row_choices(1, ids.shape[1], 16)
    assert list(rows) == sorted(rows)
    plan = pack_segments(ids, np.array([ids.shape[1]]), (16,), rows=rows)
    assert plan.buckets[0].index.shape[1] in rows
    assert sorted(plan.buckets[0].index[plan.buckets[0].index < ids.size]) == list(range(ids.size))

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uniart_jax.config import GridConfig, UniArtVAEConfig
from uniart_jax.nn.grids import flow_plan, plan_neighbors, plan_pool
from uniart_jax.nn.segments import (
    capacities_for,
    fitted_sizes,
    morton,
    pack_segments,
    plan_segments,
    round_rows,
    row_choices,
    segment_lengths,
    serial_ids,
    voxel_plans,
    window_ids,
)


def voxels(seed, items, width, side):
    """Random sorted unique coords, padded."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, min(width, side**3) + 1, items).astype(np.int32)
    coords = np.zeros((items, width, 3), np.int32)
    for b, n in enumerate(counts):
        chosen = np.sort(rng.choice(side**3, n, replace=False))
        coords[b, :n] = np.stack(np.unravel_index(chosen, (side,) * 3), -1)
    return coords, counts


def members(plan, total):
    """Every segment of a plan of one share as a list of flat tokens; checks the plan's own consistency on the way."""
    plan = jax.tree.map(lambda a: a[0], plan)
    flat = np.concatenate([bucket.index.reshape(-1) for bucket in plan.buckets])
    tokens = np.flatnonzero(plan.inverse < len(flat))
    np.testing.assert_array_equal(flat[plan.inverse[tokens]], tokens)
    assert (flat < total).sum() == len(tokens)
    out = []
    for bucket in plan.buckets:
        for row, length in zip(bucket.index, bucket.length, strict=True):
            assert (row[:length] < total).all() and (row[length:] == total).all()
        for row, length, ids in zip(bucket.index, bucket.length, row_ids(bucket), strict=True):
            assert (ids[length:] == -1).all() and (ids[:length] >= 0).all()
            out += [row[:length][ids[:length] == i] for i in np.unique(ids[:length])]
    return out


def row_ids(bucket):
    if bucket.segment is not None:
        return bucket.segment
    valid = np.arange(bucket.index.shape[1]) < bucket.length[:, None]
    return np.where(valid, 0, -1)


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


@given(
    st.integers(0, 10_000),
    st.sampled_from(["serial", "swin"]),
    st.sampled_from([4, 6]),
    st.sampled_from([0, 3, 16]),
)
def test_voxel_plans_always_fit(seed, attention, window, part_segment):
    config = UniArtVAEConfig(attention=attention, window=window, part_segment=part_segment)
    grid = GridConfig(resolution=8, max_parts=7)
    coords, counts = voxels(seed, 3, 60, 8)
    rng = np.random.default_rng(seed)
    part = rng.choice(7, (3, 60), p=rng.dirichlet(np.ones(7) * 0.3))
    batch = dict(coords=coords, counts=counts, voxel_part=part)
    plans = voxel_plans(batch, config, grid)
    fitted = voxel_plans(batch, config, grid, fitted=True)
    fixed = capacities_for(config, grid, 3, 60)
    for name, plan in plans.items():
        same = [sorted(map(tuple, members(p, 180))) for p in (plan, fitted[name])]
        assert same[0] == same[1] and sum(map(len, same[0])) == counts.sum()
        if fixed[name] is not None:  # shapes do not depend on the content
            assert tuple(b.index.shape[1:] for b in plan.buckets) == fixed[name]
    assert set(voxel_plans(batch, config, grid, parts=False)) == {"window_0", "window_1"}


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
    lengths = segment_lengths(ids, counts, 16)  # only what is longer than a row is cut
    assert sorted(map(len, segments)) == sorted(lengths.tolist())


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


def test_training_plans_have_one_shape():
    """Whatever the parts and the windows of a batch are, one program serves it."""
    config, grid = UniArtVAEConfig(window=4), GridConfig(resolution=16, max_parts=7)
    shapes = set()
    for seed in range(5):
        coords, counts = voxels(seed, 2, 600, 16)
        part = np.random.default_rng(seed).integers(0, 7, (2, 600))
        plans = voxel_plans(dict(coords=coords, counts=counts, voxel_part=part), config, grid)
        shapes.add(str({k: [b.index.shape for b in p.buckets] for k, p in plans.items()}))
    assert len(shapes) == 1


def test_serial_runs_are_exact_and_shifted_by_half():
    coords, counts = voxels(3, 2, 200, 6)
    for shift in (0, 4):
        ids = serial_ids(coords, counts, 8, shift)
        for b, n in enumerate(counts):
            lengths = np.bincount(ids[b, :n])
            assert (lengths[1:-1] == 8).all() and lengths[0] == min(8 - shift, n)
            order = np.argsort(morton(coords[b, :n]))
            assert (np.diff(ids[b, order]) >= 0).all()


def test_morton_interleaves_bits():
    assert morton(np.array([1, 0, 0])) == 4 and morton(np.array([0, 1, 0])) == 2
    assert morton(np.array([31, 31, 31])) == 32**3 - 1
    grid = np.stack(np.meshgrid(*[np.arange(8)] * 3, indexing="ij"), -1).reshape(-1, 3)
    assert sorted(morton(grid)) == list(range(512))


def test_windows_are_trelliss():
    coords = np.array([[[0, 0, 0], [3, 3, 3], [4, 0, 0], [7, 7, 7], [8, 0, 0]]])
    same = window_ids(coords, 8)[0]
    assert same[0] == same[3] != same[4]
    shifted = window_ids(coords, 8, 4)[0]
    assert shifted[0] == shifted[1] != shifted[2] and shifted[2] == shifted[4] != shifted[3]


@given(st.integers(0, 10_000), st.sampled_from([2, 4]))
def test_pool_groups_each_voxel_once(seed, factor):
    coords, counts = voxels(seed, 2, 50, 8)
    pool = plan_pool(coords, counts, factor, 50)
    slots = factor**3
    for b, n in enumerate(counts):
        cell, slot = np.divmod(pool.parent[b, :n], slots)
        np.testing.assert_array_equal(pool.coords[b][cell], coords[b, :n] // factor)
        local = np.stack(np.unravel_index(slot, (factor,) * 3), -1)
        np.testing.assert_array_equal(local, coords[b, :n] % factor)
        np.testing.assert_array_equal(pool.children[b, cell, slot], np.arange(n))
        assert pool.counts[b] == len(np.unique(coords[b, :n] // factor, axis=0))
        assert (pool.parent[b, n:] == 50 * slots).all()
        assert ((pool.children[b] < 50).any(-1) == (np.arange(50) < pool.counts[b])).all()
    assert (pool.children < 50).sum() == counts.sum()


def test_pool_beyond_capacity_names_the_item():
    coords, _ = voxels(0, 2, 50, 8)
    with pytest.raises(ValueError, match="item"):
        plan_pool(coords, np.array([50, 50]), 2, 3)


@given(st.integers(0, 10_000))
def test_neighbors_are_mutual(seed):
    coords, counts = voxels(seed, 2, 40, 4)
    near = plan_neighbors(coords, counts)
    for b, n in enumerate(counts):
        assert (near[b, :n, 13] == np.arange(n)).all()
        for i in range(n):
            for tap in np.flatnonzero(near[b, i] < 40):
                j = near[b, i, tap]
                step = np.array(np.unravel_index(tap, (3, 3, 3))) - 1
                np.testing.assert_array_equal(coords[b, j], coords[b, i] + step)
                assert near[b, j, 26 - tap] == i
    assert (near[np.arange(40) >= counts[:, None]] == 40).all()


@pytest.mark.parametrize("block, cells", [(4, 16), (8, 16), (12, 32), (16, 64)])
def test_flow_plan_is_fitted_to_the_batch_by_few_sizes(block, cells):
    """All voxels of a block of a grid with 64 cells: the smallest share of them that suffices."""
    from uniart_jax.config import FlowConfig

    coords = np.argwhere(np.ones((block,) * 3, bool)).astype(np.int32)
    width = 16**3
    padded = np.zeros((1, width, 3), np.int32)
    padded[0, : len(coords)] = coords
    counts, config = np.array([len(coords)]), FlowConfig(stem="patch", patch_size=4)
    plan = flow_plan(padded, counts, config, GridConfig(resolution=16)).pools[0]
    exact = flow_plan(padded, counts, config, GridConfig(resolution=16), round_to=3).pools[0]
    active = (block // 4) ** 3
    assert plan.coords.shape[1] == cells and plan.counts.tolist() == [active]
    assert exact.coords.shape[1] == min(-(-active // 3) * 3, 64)
    np.testing.assert_array_equal(plan.coords[0, :active], exact.coords[0, :active])


@given(st.lists(st.integers(1, 16), min_size=1, max_size=40))
def test_the_largest_choice_of_rows_is_always_enough(lengths):
    """Also for windows that hardly fit together: two of nine tokens never share a row of sixteen."""
    ids = np.repeat(np.arange(len(lengths)), lengths)[None]
    rows = row_choices(1, ids.shape[1], 16)
    assert list(rows) == sorted(rows)
    plan = pack_segments(ids, np.array([ids.shape[1]]), (16,), rows=rows)
    assert plan.buckets[0].index.shape[1] in rows
    assert sorted(plan.buckets[0].index[plan.buckets[0].index < ids.size]) == list(range(ids.size))

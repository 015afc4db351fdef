import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_voxels import voxels

from uniart_jax.config import GridConfig
from uniart_jax.nn.grids import flow_plan, plan_neighbors, plan_pool


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

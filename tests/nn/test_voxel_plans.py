import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from random_voxels import members, voxels

from uniart_jax.config import GridConfig, UniArtVAEConfig
from uniart_jax.nn.voxel_plans import capacities_for, morton, serial_ids, voxel_plans, window_ids


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
    plans = voxel_plans(**batch, config=config, grid=grid)
    fitted = voxel_plans(**batch, config=config, grid=grid, fitted=True)
    fixed = capacities_for(config, grid, 3, 60)
    for name, plan in plans.items():
        same = [sorted(map(tuple, members(p, 180))) for p in (plan, fitted[name])]
        assert same[0] == same[1] and sum(map(len, same[0])) == counts.sum()
        if fixed[name] is not None:  # shapes do not depend on the content
            assert tuple(b.index.shape[1:] for b in plan.buckets) == fixed[name]
    assert set(voxel_plans(coords, counts, config, grid)) == {"window_0", "window_1"}


def test_training_plans_have_one_shape():
    """Whatever the parts and the windows of a batch are, one program serves it."""
    config, grid = UniArtVAEConfig(window=4), GridConfig(resolution=16, max_parts=7)
    shapes = set()
    for seed in range(5):
        coords, counts = voxels(seed, 2, 600, 16)
        part = np.random.default_rng(seed).integers(0, 7, (2, 600))
        plans = voxel_plans(coords, counts, config, grid, voxel_part=part)
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

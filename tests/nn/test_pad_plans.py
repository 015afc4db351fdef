"""Plans of several shares, by one process or by many: what the shares say, whatever they are padded
to."""

import jax
import numpy as np
import pytest

from uniart_jax.config import FlowConfig, GridConfig, UniArtVAEConfig
from uniart_jax.nn.grids import flow_plan
from uniart_jax.nn.pad_plans import padded_plans, plan_sizes
from uniart_jax.nn.segments import join_shares, pack_segments, plan_segments
from uniart_jax.nn.voxel_plans import serial_ids, voxel_plans, window_ids

GRID = GridConfig(8, 2, 8)
ITEMS, WIDTH = 6, 48


def make_batch(seed: int = 0) -> dict[str, np.ndarray]:
    """Items of very different sizes, the large ones last, so that the shares need different
    shapes."""
    rng = np.random.default_rng(seed)
    counts = np.array([1, 5, 9, 20, 44, 48], np.int32)
    coords = np.zeros((ITEMS, WIDTH, 3), np.int32)
    for row, count in zip(coords, counts, strict=True):
        flat = np.sort(rng.choice(8**3, count, replace=False))
        row[:count] = np.stack(np.unravel_index(flat, (8,) * 3), 1)
    return {
        "coords": coords,
        "counts": counts,
        "voxel_part": rng.integers(0, 5, (ITEMS, WIDTH)).astype(np.int32),
    }


def shares_of(batch, make, processes: int):
    """Every process's plans, and all rows together as ``jax.make_array_from_process_local_data``
    puts them."""
    size = ITEMS // processes
    plans = [make({k: v[i : i + size] for k, v in batch.items()}) for i in range(0, ITEMS, size)]
    sizes = np.max([plan_sizes(plan) for plan in plans], 0).tolist()
    shared = [padded_plans(p, sizes) for p in plans]
    assert len({str(jax.tree.map(np.shape, s)) for s in shared}) == 1  # of one shape, all of them
    return plans, jax.tree.map(lambda *rows: np.concatenate(rows), *shared)


def together(plan) -> dict[int, frozenset[int]]:
    """With whom each token of the whole batch shares a segment; checks on the way that every
    share's inverse finds its tokens."""
    found = {}
    shares, tokens = plan.inverse.shape
    for share in range(shares):
        rows = np.concatenate([b.index[share].reshape(-1) for b in plan.buckets])
        valid = np.flatnonzero(plan.inverse[share] < len(rows))
        assert (rows[plan.inverse[share][valid]] == valid).all()
        assert (rows < tokens).sum() == len(valid)
        for bucket in plan.buckets:
            length = bucket.length[share]
            ids = np.where(np.arange(bucket.index.shape[2]) < length[:, None], 0, -1)
            ids = ids if bucket.segment is None else bucket.segment[share]
            for index, row in zip(bucket.index[share], ids, strict=True):
                assert (index[row < 0] == tokens).all()
                for i in np.unique(row[row >= 0]):
                    members = frozenset((share * tokens + index[row == i]).tolist())
                    found |= dict.fromkeys(members, members)
    return found


def windows(batch):
    config = UniArtVAEConfig(attention="swin", window=2)
    return voxel_plans(**batch, config=config, grid=GRID)


def packed(batch):
    """As many rows as these items need."""
    return {"window_0": pack_segments(window_ids(batch["coords"], 4), batch["counts"], (16,))}


def cut(batch):
    """Two buckets a plan, as part_segment and serial attention make them."""
    serial = serial_ids(batch["coords"], batch["counts"], 16)
    some = len(batch["counts"])
    return {
        "parts": plan_segments(batch["voxel_part"], batch["counts"], ((some * 8, 4), (some * 20, 8))),  # noqa: E501
        "window_0": plan_segments(serial, batch["counts"], ((some * 3, 16),)),
    }  # fmt: skip


@pytest.mark.parametrize("make", [windows, packed, cut])
@pytest.mark.parametrize("processes", [2, 3, 6])
def test_segments_of_shares_are_those_of_the_batch(make, processes):
    batch = make_batch()
    _, joined = shares_of(batch, make, processes)
    for name, expected in make(batch).items():
        plan = joined[name]
        assert len(plan.inverse) == processes
        assert together(plan) == together(expected), name
        assert len(together(plan)) == batch["counts"].sum()


@pytest.mark.parametrize("attention", ["swin", "serial"])
@pytest.mark.parametrize("shares", [1, 2, 6])
def test_one_process_plans_its_devices_shares(attention, shares):
    batch = make_batch()
    config = UniArtVAEConfig(attention=attention, window=4)
    plans = voxel_plans(**batch, config=config, grid=GRID, shares=shares)
    whole = voxel_plans(**batch, config=config, grid=GRID)
    # serial runs are cut item by item; whatever shares are planned apart, the segments are the same
    for name, plan in plans.items():
        assert plan.inverse.shape == (shares, ITEMS * WIDTH // shares)
        assert together(plan) == together(whole[name]), name


def test_items_that_do_not_divide_into_the_shares():
    with pytest.raises(ValueError, match="6 items in 4 shares"):
        voxel_plans(**make_batch(), config=UniArtVAEConfig(window=4), grid=GRID, shares=4)


def test_joined_shares_have_the_rows_of_the_largest():
    plans = [packed({k: v[i : i + 3] for k, v in make_batch().items()}) for i in (0, 3)]
    few, many = (p["window_0"].buckets[0].index.shape[1] for p in plans)
    joined = join_shares([p["window_0"] for p in plans])
    assert few < many and joined.buckets[0].index.shape == (2, many, 16)
    assert together(joined) == together(packed(make_batch())["window_0"])


def test_the_shares_do_need_different_shapes():
    plans, _ = shares_of(make_batch(), packed, 2)
    assert plan_sizes(plans[0]) != plan_sizes(plans[1])


@pytest.mark.parametrize("processes", [1, 2, 3])
@pytest.mark.parametrize(
    "config",
    [
        FlowConfig(stem="patch", patch_size=4),
        FlowConfig(stem="conv", patch_size=2, io_channels=(8,)),
        FlowConfig(stem="conv", patch_size=4, io_channels=(8, 8)),
    ],
)
def test_flow_plans_of_shares_are_the_plan_of_the_batch(config, processes):
    batch = make_batch()

    def make(part):
        plan = flow_plan(part["coords"], part["counts"], config, GRID, round_to=4)
        return {"flow": plan}

    _, joined = shares_of(batch, make, processes)
    jax.tree.map(np.testing.assert_array_equal, joined, make(batch))

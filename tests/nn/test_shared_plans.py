"""Plans of shares joined: what the shares say, in the positions of the whole batch."""

import jax
import numpy as np
import pytest

from uniart_jax.config import FlowConfig, GridConfig, UniArtVAEConfig
from uniart_jax.nn.grids import flow_plan
from uniart_jax.nn.segments import (
    pack_segments,
    plan_segments,
    serial_ids,
    voxel_plans,
    window_ids,
)
from uniart_jax.nn.shared_plans import plan_sizes, shared_plans

GRID = GridConfig(8, 2, 8)
ITEMS, WIDTH = 6, 48


def make_batch(seed: int = 0) -> dict[str, np.ndarray]:
    """Items of very different sizes, the large ones last, so that the shares need different shapes."""
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


def shares_of(batch, make, processes: int, multiple: int = 1):
    """Every process's plans, and all rows together as ``jax.make_array_from_process_local_data`` puts them."""
    size = ITEMS // processes
    plans = [make({k: v[i : i + size] for k, v in batch.items()}) for i in range(0, ITEMS, size)]
    sizes = np.max([plan_sizes(plan) for plan in plans], 0).tolist()
    shared = [shared_plans(p, sizes, i, processes, multiple) for i, p in enumerate(plans)]
    assert len({str(jax.tree.map(np.shape, s)) for s in shared}) == 1  # of one shape, all of them
    return plans, jax.tree.map(lambda *rows: np.concatenate(rows), *shared)


def together(plan, tokens: int) -> dict[int, frozenset[int]]:
    """With whom each token shares a segment."""
    found = {}
    for bucket in plan.buckets:
        ids = bucket.segment
        if ids is None:
            ids = np.where(np.arange(bucket.index.shape[1]) < bucket.length[:, None], 0, -1)
        for index, row in zip(bucket.index, ids, strict=True):
            assert (index[row < 0] == tokens).all()
            for i in np.unique(row[row >= 0]):
                members = frozenset(index[row == i].tolist())
                found |= dict.fromkeys(members, members)
    return found


def windows(batch):
    return voxel_plans(batch, UniArtVAEConfig(attention="swin", window=2), GRID)


def packed(batch):
    """As many rows as these items need."""
    return {"window_0": pack_segments(window_ids(batch["coords"], 4), batch["counts"], (16,))}


def cut(batch):
    """Two buckets a plan, as part_segment and serial attention make them."""
    serial = serial_ids(batch["coords"], batch["counts"], 16)
    some = len(batch["counts"])
    return {
        "parts": plan_segments(batch["voxel_part"], batch["counts"], ((some * 8, 4), (some * 20, 8))),
        "window_0": plan_segments(serial, batch["counts"], ((some * 3, 16),)),
    }  # fmt: skip


@pytest.mark.parametrize("make", [windows, packed, cut])
@pytest.mark.parametrize(("processes", "multiple"), [(2, 4), (3, 1), (6, 2)])
def test_segments_of_shares_are_those_of_the_batch(make, processes, multiple):
    batch, tokens = make_batch(), ITEMS * WIDTH
    _, joined = shares_of(batch, make, processes, multiple)
    for name, expected in make(batch).items():
        plan = joined[name]
        assert together(plan, tokens) == together(expected, tokens), name
        # the whole array's rows are bucket after bucket, each with all processes' rows
        rows = np.concatenate([b.index.reshape(-1) for b in plan.buckets])
        valid = (np.arange(WIDTH) < batch["counts"][:, None]).reshape(-1)
        assert (rows[plan.inverse[valid]] == np.flatnonzero(valid)).all(), name
        assert (plan.inverse[~valid] == len(rows)).all(), name
        assert all(len(b.index) % (processes * multiple) == 0 for b in plan.buckets)


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

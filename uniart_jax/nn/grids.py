"""Host-side plans between levels of a sparse voxel grid: pooling into larger cells, and neighbours
for convolution. numpy only.

All positions are within an item, so that a plan can be cut, joined and repeated as any array [B,
...], and a device needs no other's items.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from uniart_jax.config import FlowConfig, GridConfig

# Cells of a batch are padded to one of these shares of what its voxels could fill: few shapes to
# compile, most of a surface's in two or three.
CELL_SHARES = (0.25, 0.375, 0.5, 0.75, 1.0)
CELL_STEP = 64  # where a single object is sampled: to a multiple of this, less waste


class Pool(NamedTuple):
    """Active voxels grouped into cells of f^3 voxels; cells in lexicographic order, as TRELLIS's
    SparseDownsample.

    Attributes:
      coords: [B, L, 3] int32 cell indices (voxel index // f); padding 0.
      counts: [B] int32 active cells.
      children: [B, L, f^3] int32 voxel of the item in each slot of each cell; empty slots and
        padding: V. Slots are x-major, z fastest.
      parent: [B, V] int32 slot of each voxel, flat in the item's L * f^3; padding: L * f^3.
        ``children`` inverted.
    """

    coords: np.ndarray
    counts: np.ndarray
    children: np.ndarray
    parent: np.ndarray


class FlowPlan(NamedTuple):
    """Levels of a latent flow's stem, finest first.

    Attributes:
      pools: one a level change; a single one of ``patch_size`` for the 'patch' stem.
      neighbors: [B, V_i, 27] of every level ('conv' stem; else empty).
    """

    pools: tuple[Pool, ...]
    neighbors: tuple[np.ndarray, ...]


def plan_pool(coords: np.ndarray, counts: np.ndarray, factor: int, capacity: int) -> Pool:
    """Group voxels [B, V, 3] into cells of ``factor``^3.

    Raises:
      ValueError: an item has more than ``capacity`` active cells.
    """
    items, width = coords.shape[:2]
    slots = factor**3
    cells = np.zeros((items, capacity, 3), np.int32)
    cell_counts = np.zeros(items, np.int32)
    children = np.full((items, capacity * slots), width, np.int32)
    parent = np.full((items, width), capacity * slots, np.int32)
    for b, count in enumerate(counts):
        voxel = np.asarray(coords[b, :count], np.int64)
        local = voxel % factor
        codes, span = _cell_codes(voxel, factor)
        code, index = np.unique(codes, return_inverse=True)
        if len(code) > capacity:
            raise ValueError(
                f"pooling: item {b} has {len(code)} active cells of {factor}^3 voxels, more than "
                f"the capacity {capacity}"
            )
        cells[b, : len(code)] = np.stack(np.unravel_index(code, (span,) * 3), -1) if count else 0
        cell_counts[b] = len(code)
        slot = index * slots + (local[:, 0] * factor + local[:, 1]) * factor + local[:, 2]
        children[b, slot] = np.arange(count)
        parent[b, :count] = slot
    return Pool(cells, cell_counts, children.reshape(items, capacity, slots), parent)


def _cell_codes(voxel: np.ndarray, factor: int) -> tuple[np.ndarray, int]:
    """[N] one number for each cell of ``factor``^3 that voxels [N, 3] are in, and the span of its
    digits."""
    cell = voxel // factor
    span = int(cell.max(initial=0)) + 1
    return (cell[:, 0] * span + cell[:, 1]) * span + cell[:, 2], span


def plan_neighbors(coords: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """[B, V, 27] int32 voxel of the item at each offset (a-1, b-1, c-1), tap = (a * 3 + b) * 3 + c;
    none: V.

    The offsets and their order are those of a submanifold 3^3 cross-correlation.
    """
    items, width = coords.shape[:2]
    span = int(np.asarray(coords).max(initial=0)) + 3
    offsets = np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), -1).reshape(27, 3)
    neighbors = np.full((items, width, 27), width, np.int32)
    for b, count in enumerate(counts):
        voxel = np.asarray(coords[b, :count], np.int64) + 1
        lookup = np.full(span**3, width, np.int32)
        lookup[(voxel[:, 0] * span + voxel[:, 1]) * span + voxel[:, 2]] = np.arange(count)
        near = voxel[:, None] + offsets - 1
        neighbors[b, :count] = lookup[(near[..., 0] * span + near[..., 1]) * span + near[..., 2]]
    return neighbors


def flow_plan(
    coords: np.ndarray,
    counts: np.ndarray,
    config: FlowConfig,
    grid: GridConfig,
    *,
    round_to: int = 0,
) -> FlowPlan:
    """The plan of the latent flow's stem for voxels [B, V, 3].

    Capacity of a level: all cells of its grid or all voxels, whichever is less, of that the
    smallest of ``CELL_SHARES`` which suffices for this batch. With ``round_to`` it is the most
    cells of an item of this batch, rounded up to a multiple: less padding, more shapes to compile.
    """
    side = grid.resolution

    def pool(coords: np.ndarray, counts: np.ndarray, factor: int) -> Pool:
        most = min(coords.shape[1], (-(-side // factor)) ** 3)
        codes = [_cell_codes(c[:n], factor)[0] for c, n in zip(coords, counts, strict=True)]
        active = max(1, *(len(np.unique(code)) for code in codes))
        if round_to:
            sizes = [-(-active // round_to) * round_to]
        else:
            sizes = [n for share in CELL_SHARES if (n := math.ceil(share * most)) >= active]
        most = min(most, sizes[0])
        return plan_pool(coords, counts, factor, most)

    if config.stem == "patch":
        return FlowPlan((pool(coords, counts, config.patch_size),), ())
    pools, neighbors = [], [plan_neighbors(coords, counts)]
    for _ in config.io_channels:
        pools.append(pool(coords, counts, 2))
        coords, counts, side = pools[-1].coords, pools[-1].counts, -(-side // 2)
        neighbors.append(plan_neighbors(coords, counts))
    return FlowPlan(tuple(pools), tuple(neighbors))


def pad_cells(plan: FlowPlan, cells: Sequence[int]) -> FlowPlan:
    """The plan with so many cells an item in each pool, at least as many as it has; what is added
    is empty."""
    pools, neighbors, width = [], [], 0
    for pool, number in zip(plan.pools, cells, strict=True):
        (capacity, slots), fine = pool.children.shape[1:], pool.parent.shape[1]
        width = width or fine  # of the finer level, with what was added to it
        more = ((0, 0), (0, number - capacity), (0, 0))
        children = np.where(pool.children < fine, pool.children, width)
        parent = np.where(pool.parent < capacity * slots, pool.parent, number * slots)
        added = ((0, 0), (0, width - fine))
        pools.append(
            Pool(
                np.pad(pool.coords, more),
                pool.counts,
                np.pad(children, more, constant_values=width).astype(np.int32),
                np.pad(parent, added, constant_values=number * slots).astype(np.int32),
            )
        )
        width = number
    for level, near in enumerate(plan.neighbors):  # the 'patch' stem has none
        old, new = near.shape[1], cells[level - 1] if level else near.shape[1]
        near = np.where(near < old, near, new).astype(np.int32)
        neighbors.append(np.pad(near, ((0, 0), (0, new - old), (0, 0)), constant_values=new))
    return FlowPlan(tuple(pools), tuple(neighbors))

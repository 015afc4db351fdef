"""Plans of several processes' shares of a batch as plans of the whole batch: positions moved, rows and cells padded to what the largest share needs. numpy only.

Each process plans the items that it has read (``segments``, ``grids``). On the devices the batch is one array, the shares one after the other, and every position
counts in it. Processes have to agree on the sizes that depend on the data: ``plan_sizes`` gives this share's, ``shared_plans`` takes the largest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from uniart_jax.nn.grids import FlowPlan, Pool
from uniart_jax.nn.segments import Bucket, Segments

Plan = Segments | FlowPlan


def plan_sizes(plans: Mapping[str, Plan]) -> list[int]:
    """Rows of every bucket and cells of every pool, by the plans' names."""
    sizes = []
    for name in sorted(plans):
        plan = plans[name]
        if isinstance(plan, Segments):
            sizes += [len(bucket.index) for bucket in plan.buckets]
        else:
            sizes += [pool.coords.shape[1] for pool in plan.pools]
    return sizes


def shared_plans(
    plans: Mapping[str, Plan], sizes: Sequence[int], process: int, processes: int, multiple: int = 1
) -> dict[str, Plan]:
    """This process's rows of the whole batch's plans.

    Args:
      plans: of its share, which is as large as every other's.
      sizes: as ``plan_sizes``, the largest of all processes.
      process, processes: which share it is, of how many.
      multiple: rows of a bucket are padded to a multiple of it, the devices of a process.
    """
    left = list(sizes)
    shared: dict[str, Plan] = {}
    for name in sorted(plans):
        plan = plans[name]
        if isinstance(plan, Segments):
            own, left = left[: len(plan.buckets)], left[len(plan.buckets) :]
            own = [-(-size // multiple) * multiple for size in own]
            shared[name] = _segments(plan, own, process, processes)
        else:
            own, left = left[: len(plan.pools)], left[len(plan.pools) :]
            shared[name] = _flow(plan, own, process, processes)
    return shared


def _segments(plan: Segments, rows: Sequence[int], process: int, processes: int) -> Segments:
    tokens = len(plan.inverse)
    inverse = np.full(tokens, -1, np.int64)
    buckets = []
    here = there = 0  # where the bucket begins, in this share's rows and in all
    for bucket, number in zip(plan.buckets, rows, strict=True):
        size, length = bucket.index.shape
        more = ((0, number - size), (0, 0))
        index = np.where(
            bucket.index < tokens, bucket.index + process * tokens, processes * tokens
        ).astype(np.int32)
        segment = bucket.segment
        buckets.append(
            Bucket(
                np.pad(index, more, constant_values=processes * tokens),
                np.pad(bucket.length, (0, number - size)),
                None if segment is None else np.pad(segment, more, constant_values=-1),
            )
        )
        mine = (plan.inverse >= here) & (plan.inverse < here + size * length)
        inverse[mine] = plan.inverse[mine] - here + there + process * number * length
        here, there = here + size * length, there + processes * number * length
    return Segments(tuple(buckets), np.where(inverse < 0, there, inverse).astype(np.int32))


def _flow(plan: FlowPlan, cells: Sequence[int], process: int, processes: int) -> FlowPlan:
    items = len(plan.pools[0].counts) if plan.pools else len(plan.neighbors[0])
    width = plan.pools[0].parent.shape[1] if plan.pools else plan.neighbors[0].shape[1]
    widths = [(width, width)]  # of every level, in this share and in all
    widths += [(p.coords.shape[1], n) for p, n in zip(plan.pools, cells, strict=True)]

    def move(position: np.ndarray, old: int, new: int) -> np.ndarray:
        """Flat positions in [items, old] as those in [all items, new]; what is missing stays so."""
        item, place = np.divmod(np.asarray(position, np.int64), old)
        moved = (process * items + item) * new + place
        return np.where(item < items, moved, processes * items * new).astype(np.int32)

    pools = []
    for pool, fine, coarse in zip(plan.pools, widths[:-1], widths[1:], strict=True):
        slots = pool.children.shape[2]
        more = ((0, 0), (0, coarse[1] - coarse[0]), (0, 0))
        missing = processes * items * fine[1]
        parent = move(pool.parent, coarse[0] * slots, coarse[1] * slots)
        nowhere = processes * items * coarse[1] * slots
        pools.append(
            Pool(
                np.pad(pool.coords, more),
                pool.counts,
                np.pad(move(pool.children, *fine), more, constant_values=missing),
                np.pad(parent, ((0, 0), (0, fine[1] - fine[0])), constant_values=nowhere),
            )
        )
    neighbors = []
    for near, (old, new) in zip(plan.neighbors, widths, strict=False):  # 'patch' has none
        more = ((0, 0), (0, new - old), (0, 0))
        missing = processes * items * new
        neighbors.append(np.pad(move(near, old, new), more, constant_values=missing))
    return FlowPlan(tuple(pools), tuple(neighbors))

"""Plans of a batch that several processes share: each process plans its own items, and all pad
theirs to the same shapes.

Positions in plans are within an item or a share, so that the processes' rows one after the other
are a plan of the whole batch. Only the numbers of rows and cells depend on the items:
``plan_sizes`` gives them, the processes agree on the largest, ``padded_plans`` takes these.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from uniart_jax.nn.grids import FlowPlan, pad_cells
from uniart_jax.nn.segments import Segments, pad_rows

Plan = Segments | FlowPlan


def plan_sizes(plans: Mapping[str, Plan]) -> list[int]:
    """Rows of every bucket and cells of every pool, by the plans' names."""
    sizes = []
    for name in sorted(plans):
        plan = plans[name]
        if isinstance(plan, Segments):
            sizes += [bucket.index.shape[1] for bucket in plan.buckets]
        else:
            sizes += [pool.coords.shape[1] for pool in plan.pools]
    return sizes


def padded_plans(plans: Mapping[str, Plan], sizes: Sequence[int]) -> dict[str, Plan]:
    """The plans with ``sizes`` (as ``plan_sizes``, none smaller than theirs) rows and cells."""
    left = list(sizes)
    padded: dict[str, Plan] = {}
    for name in sorted(plans):
        plan = plans[name]
        if isinstance(plan, Segments):
            own, left = left[: len(plan.buckets)], left[len(plan.buckets) :]
            padded[name] = pad_rows(plan, own)
        else:
            own, left = left[: len(plan.pools)], left[len(plan.pools) :]
            padded[name] = pad_cells(plan, own)
    return padded

"""A batch cut into micro-batches for gradient accumulation: on the host, because segments are
planned anew for each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import jax

from uniart_jax.config import ModelConfig
from uniart_jax.nn.grids import FlowPlan
from uniart_jax.nn.segments import Segments
from uniart_jax.nn.voxel_plans import voxel_plans
from uniart_jax.voxels.typed_batches import VoxelBatch

Batch = TypeVar("Batch")


def in_parts(put: Callable[[Any], Any], count: int, model: ModelConfig) -> Callable[[Any], Any]:
    """``put`` for a step that accumulates: host batch -> ``count`` micro-batches, each put by
    itself; with 1, ``put`` as it is."""
    if count == 1:
        return put
    return lambda batch: tuple(put(part) for part in split_batch(batch, count, model))


def split_batch(batch: Batch, count: int, model: ModelConfig) -> tuple[Batch, ...]:
    """Micro-batches of B / ``count`` items each, in order, with plans of their own.

    Args:
      batch: arrays [B, ...] and tables of them, a ``VoxelBatch`` with its plans.
      count: how many.

    Raises:
      ValueError: the items do not divide.
    """
    plans = batch.plans if isinstance(batch, VoxelBatch) else None
    arrays: Any = batch._replace(plans=None) if isinstance(batch, VoxelBatch) else batch
    items = len(jax.tree.leaves(arrays)[0])
    if count < 1 or items % count:
        raise ValueError(
            f"accumulate: {items} items of a process's batch do not divide into {count} "
            "micro-batches; choose a divisor of the batch size"
        )
    size = items // count
    parts = [jax.tree.map(lambda a, i=i: a[i : i + size], arrays) for i in range(0, items, size)]
    if plans is None:
        return tuple(parts)
    segments = [plan for plan in plans.values() if isinstance(plan, Segments)]
    shares = max((len(plan.inverse) for plan in segments), default=1)
    made = []
    for i, part in enumerate(parts):
        own: dict[str, Any] = {}
        if segments:
            ids = part.voxel_part if "parts" in plans else None
            voxels, vae = (part.coords, part.counts), model.uniart_vae
            own |= voxel_plans(*voxels, vae, model.grid, voxel_part=ids, shares=shares)
        for name, plan in plans.items():
            if isinstance(plan, FlowPlan):  # of items, as the arrays are
                own[name] = jax.tree.map(lambda a, i=i: a[i * size : (i + 1) * size], plan)
        made.append(part._replace(plans=own))
    return tuple(made)

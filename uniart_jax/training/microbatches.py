"""A batch cut into micro-batches for gradient accumulation: on the host, because segments are
planned anew for each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax

from uniart_jax.config import ModelConfig
from uniart_jax.nn.grids import FlowPlan
from uniart_jax.nn.segments import Segments
from uniart_jax.nn.voxel_plans import voxel_plans


def in_parts(put: Callable[[Any], Any], count: int, model: ModelConfig) -> Callable[[Any], Any]:
    """``put`` for a step that accumulates: host batch -> ``count`` micro-batches, each put by
    itself; with 1, ``put`` as it is."""
    if count == 1:
        return put
    return lambda batch: tuple(put(part) for part in split_batch(batch, count, model))


def split_batch(
    batch: dict[str, Any], count: int, model: ModelConfig
) -> tuple[dict[str, Any], ...]:
    """Micro-batches of B / ``count`` items each, in order, with plans of their own.

    Args:
      batch: of ``data.batches`` or ``data.latents``: arrays [B, ...], tables of them, and perhaps
        ``plans``.
      count: how many.

    Raises:
      ValueError: the items do not divide.
    """
    arrays = batch
    if isinstance(batch, dict):
        arrays = {name: value for name, value in batch.items() if name != "plans"}
    items = len(jax.tree.leaves(arrays)[0])
    if count < 1 or items % count:
        raise ValueError(
            f"accumulate: {items} items of a process's batch do not divide into {count} "
            "micro-batches; choose a divisor of the batch size"
        )
    size = items // count
    parts = [jax.tree.map(lambda a, i=i: a[i : i + size], arrays) for i in range(0, items, size)]
    if not isinstance(batch, dict) or "plans" not in batch:
        return tuple(parts)
    plans = batch["plans"]
    segments = [plan for plan in plans.values() if isinstance(plan, Segments)]
    options: dict[str, Any] = {"parts": "parts" in plans}
    options["shares"] = max((len(plan.inverse) for plan in segments), default=1)
    made = []
    for i, part in enumerate(parts):
        own: dict[str, Any] = {}
        if segments:
            own |= voxel_plans(part, model.uniart_vae, model.grid, **options)
        for name, plan in plans.items():
            if isinstance(plan, FlowPlan):  # of items, as the arrays are
                own[name] = jax.tree.map(lambda a, i=i: a[i * size : (i + 1) * size], plan)
        made.append({**part, "plans": own})
    return tuple(made)

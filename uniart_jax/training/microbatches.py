"""A batch cut into micro-batches for gradient accumulation: on the host, because attention and pooling plans hold positions in the whole batch."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from uniart_jax.config import ModelConfig
from uniart_jax.nn.grids import FlowPlan, flow_plan
from uniart_jax.nn.segments import voxel_plans


def in_parts(put: Callable[[Any], Any], count: int, model: ModelConfig) -> Callable[[Any], Any]:
    """``put`` for a step that accumulates: host batch -> ``count`` micro-batches, each put by itself; with 1, ``put`` as it is."""
    if count == 1:
        return put
    return lambda batch: tuple(put(part) for part in split_batch(batch, count, model))


def split_batch(
    batch: dict[str, Any], count: int, model: ModelConfig
) -> tuple[dict[str, Any], ...]:
    """Micro-batches of B / ``count`` items each, in order, with plans of their own.

    Args:
      batch: of ``data.batches`` or ``data.latents``: arrays [B, ...] and perhaps ``plans``.
      count: how many.

    Raises:
      ValueError: the items do not divide.
    """
    arrays = {name: value for name, value in batch.items() if name != "plans"}
    items = len(next(iter(arrays.values())))
    if count < 1 or items % count:
        raise ValueError(
            f"accumulate: {items} items of a process's batch do not divide into {count} micro-batches; "
            "choose a divisor of the batch size"
        )
    size = items // count
    parts = [{n: v[i : i + size] for n, v in arrays.items()} for i in range(0, items, size)]
    if "plans" not in batch:
        return tuple(parts)
    if "flow" in batch["plans"]:
        return tuple(_with_flow_plans(parts, batch["plans"]["flow"], model))
    parted = "parts" in batch["plans"]
    return tuple(
        {**p, "plans": voxel_plans(p, model.uniart_vae, model.grid, parts=parted)} for p in parts
    )


def _with_flow_plans(
    parts: list[dict[str, Any]], whole: FlowPlan, model: ModelConfig
) -> list[dict[str, Any]]:
    """Micro-batches with as many cells as the whole batch's plan has, so that their shapes are equal (stems of one level)."""
    cells = int(whole.pools[0].coords.shape[1])
    made = []
    for part in parts:
        coords, counts = np.asarray(part["coords"]), np.asarray(part["counts"])
        plan = flow_plan(coords, counts, model.latent_flow, model.grid, round_to=cells)
        made.append({**part, "plans": {"flow": plan}})
    return made

"""Loss of the layout network's legs: predicted ones are matched to true ones, as parts are
(``training.layout_loss``).

    cost[q, k] = sum over runs of  5 L1(row) - p / 2
    loss       = mean over runs (10 L1(row) + BCE(exists) + .3 BCE(plinth) + .3 L1(fill))
                 + .3 BCE(alone)

Row terms are means per object, then over objects. Objects whose legs are not known pay nothing.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from uniart_jax.models.box_sets import LEG_ROW
from uniart_jax.training.losses import binary_cross_entropy
from uniart_jax.training.matching import match
from uniart_jax.voxels.typed_batches import LayoutBatch

COST, SURE = 5.0, 0.5
PLACE, TOLD = 10.0, 0.3


def leg_losses(out: dict[str, Any], batch: LayoutBatch) -> dict[str, jax.Array]:
    """Terms "legs" (all of the loss) and "legs_row" (L1 of the last run's rows, object units) of
    ``models.box_sets.LegDecoder``'s output.

    Raises:
      ValueError: the batch has no legs.
    """
    if batch.legs is None:
        raise ValueError("layout: layout.legs is above 0, but the batch has no legs")
    rows = batch.legs[..., :LEG_ROW]
    fill, plinth = batch.legs[..., LEG_ROW], batch.legs[..., LEG_ROW + 1]
    items, most = rows.shape[:2]
    known = (batch.leg_counts >= 0).astype(jnp.float32)
    counts = jnp.maximum(batch.leg_counts, 0)
    valid = (jnp.arange(most) < counts[:, None]).astype(jnp.float32)
    weights = valid / jnp.maximum(counts, 1)[:, None] / items
    runs = list(zip(*(out[name] for name in ("rows", "exists", "plinth", "fill")), strict=True))
    cost = jnp.zeros(())
    for row, exists, _, _ in runs:
        far = jnp.abs(row[:, :, None] - rows[:, None]).mean(-1)
        cost = cost + COST * far - SURE * jax.nn.sigmoid(exists)[..., None]
    query = match(cost, counts)
    chosen = jax.nn.one_hot(query, runs[0][1].shape[1]) * valid[..., None]  # [B, N, Q]
    present = chosen.sum(1)
    take = lambda values: jnp.einsum("bnq,bq...->bn...", chosen, values)  # noqa: E731
    total = last = jnp.zeros(())
    for row, exists, is_plinth, filled in runs:
        last = (jnp.abs(take(row) - rows).mean(-1) * weights).sum()
        told = binary_cross_entropy(take(is_plinth), plinth) + jnp.abs(take(filled) - fill)
        there = (binary_cross_entropy(exists, present).mean(-1) * known).mean()
        total = total + PLACE * last + there + TOLD * (told * weights).sum()
    alone = binary_cross_entropy(out["alone"], batch.legs_alone.astype(jnp.float32))
    loss = total / len(runs) + TOLD * (alone * (counts > 0)).mean()
    return {"legs": loss, "legs_row": last}

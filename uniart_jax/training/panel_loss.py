"""Loss of the layout network's panels: predicted ones are matched to true ones, as parts are
(``training.layout_loss``).

    far(a, b)  = mean over corners' coordinates of  |a - b| w,   w = .3 / (size of b + .1)
    cost[q, k] = sum over runs of  2 far - p / 2
    loss       = mean over runs (5 far + 2 BCE(exists)) + .3 L1(share)

``w`` asks more of where a board's faces are than of its edges. Row terms are means per object, then
over objects. Objects whose panels are not known pay nothing.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from uniart_jax.training.losses import binary_cross_entropy
from uniart_jax.training.matching import match
from uniart_jax.voxels.typed_batches import LayoutBatch

COST, SURE = 2.0, 0.5
PLACE, THERE, SHARE = 5.0, 2.0, 0.3
FACES, ROOM = 0.3, 0.1  # of w


def panel_losses(out: dict[str, Any], batch: LayoutBatch) -> dict[str, jax.Array]:
    """Terms "panels" (all of the loss) and "panels_row" (L1 of the last run's rows, object units)
    of ``models.box_sets.PanelDecoder``'s output.

    Raises:
      ValueError: the batch has no panels.
    """
    if batch.panels is None:
        raise ValueError("layout: layout.panels is above 0, but the batch has no panels")
    rows = batch.panels
    items, most = rows.shape[:2]
    known = (batch.panel_counts >= 0).astype(jnp.float32)
    counts = jnp.maximum(batch.panel_counts, 0)
    valid = (jnp.arange(most) < counts[:, None]).astype(jnp.float32)
    weights = valid / jnp.maximum(counts, 1)[:, None] / items
    size = rows[..., 3:] - rows[..., :3]
    faces = jnp.concatenate([FACES / (size + ROOM)] * 2, -1)  # [B, N, 6]
    runs = list(zip(out["rows"], out["exists"], strict=True))
    cost = jnp.zeros(())
    for row, exists in runs:
        far = (jnp.abs(row[:, :, None] - rows[:, None]) * faces[:, None]).mean(-1)
        cost = cost + COST * far - SURE * jax.nn.sigmoid(exists)[..., None]
    query = match(cost, counts)
    chosen = jax.nn.one_hot(query, runs[0][1].shape[1]) * valid[..., None]  # [B, N, Q]
    present = chosen.sum(1)
    total = last = jnp.zeros(())
    for row, exists in runs:
        off = jnp.abs(jnp.einsum("bnq,bqr->bnr", chosen, row) - rows)
        last = (off.mean(-1) * weights).sum()
        there = (binary_cross_entropy(exists, present).mean(-1) * known).mean()
        total = total + PLACE * ((off * faces).mean(-1) * weights).sum() + THERE * there
    share = (jnp.abs(out["share"] - batch.panel_share) * known).mean()
    return {"panels": total / len(runs) + SHARE * share, "panels_row": last}

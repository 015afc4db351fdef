"""Loss of the layout network's legs: predicted ones are matched to true ones
(``training.set_loss``).

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
from uniart_jax.training.set_loss import SetWeights, set_loss
from uniart_jax.voxels.typed_batches import LayoutBatch

WEIGHTS = SetWeights(match=5.0, sure=0.5, row=10.0, exists=1.0)
TOLD = 0.3


def leg_losses(out: dict[str, Any], batch: LayoutBatch) -> dict[str, jax.Array]:
    """Terms "legs" (all of the loss) and "legs_row" (L1 of the last run's rows, object units) of
    ``models.box_sets.LegDecoder``'s output.

    Raises:
      ValueError: the batch has no legs.
    """
    if batch.legs is None:
        raise ValueError("layout: layout.legs is above 0, but the batch has no legs")
    rows, fill, plinth = jnp.split(batch.legs, [LEG_ROW, LEG_ROW + 1], axis=-1)
    fill, plinth = fill[..., 0], plinth[..., 0]
    loss, last, matched = set_loss(out["rows"], out["exists"], rows, batch.leg_counts, WEIGHTS)
    told = jnp.zeros(())
    for is_plinth, filled in zip(out["plinth"], out["fill"], strict=True):
        wrong = binary_cross_entropy(matched.take(is_plinth), plinth)
        told = told + matched.mean(wrong + jnp.abs(matched.take(filled) - fill))
    alone = binary_cross_entropy(out["alone"], batch.legs_alone.astype(jnp.float32))
    alone = (alone * (batch.leg_counts > 0)).mean()
    loss = loss + TOLD * told / len(out["plinth"]) + TOLD * alone
    return {"legs": loss, "legs_row": last}

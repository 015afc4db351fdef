"""Loss of the mask network: cross-entropy of every pixel, and Dice of every picture, so that a
small object counts as much as a large one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from uniart_jax.models.network import Network
from uniart_jax.training.losses import binary_cross_entropy
from uniart_jax.voxels.typed_batches import MaskBatch

DICE = 0.5  # weight of the Dice loss


def make_mask_loss(
    network: Network,
) -> Callable[[Any, MaskBatch, jax.Array], tuple[jax.Array, dict[str, jax.Array]]]:
    """``loss(params, batch, key)``; nothing is drawn."""

    def loss(params: Any, batch: MaskBatch, key: jax.Array):
        logits = network.apply(params, batch.image)
        entropy = binary_cross_entropy(logits, batch.mask).mean()
        dice = (1 - dice_of(jax.nn.sigmoid(logits), batch.mask)).mean()
        total = entropy + DICE * dice
        return total, {"entropy": entropy, "dice": dice, "iou": overlap(logits, batch.mask).mean()}

    return loss


def dice_of(probability: jax.Array, mask: jax.Array) -> jax.Array:
    """[B] 2 |p m| / (|p| + |m|) of soft masks [B, S, S]."""
    both = (probability * mask).sum((1, 2))
    return (2 * both + 1) / (probability.sum((1, 2)) + mask.sum((1, 2)) + 1)


def overlap(logits: jax.Array, mask: jax.Array) -> jax.Array:
    """[B] intersection over union of what is likelier object than not; 1 where both are empty."""
    found, true = logits > 0, mask > 0.5
    union = (found | true).sum((1, 2))
    return jnp.where(union > 0, (found & true).sum((1, 2)) / jnp.maximum(union, 1), 1.0)

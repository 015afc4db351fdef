"""Layouts that the layout network finds, in place of a batch's own: flows and decoders learn from
its mistakes (``loss.found``)."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from uniart_jax.training.matching import match
from uniart_jax.voxels.joint_code import box_corners
from uniart_jax.voxels.part_table import PartTable
from uniart_jax.voxels.typed_batches import VoxelBatch

SAME_PART = 0.25  # object units between the corners of a true part and the row that was found of it
NOBODYS_ROW = 10.0  # cost of a row that does not exist


def show_found(batch: VoxelBatch, found: PartTable, share: float, key: jax.Array) -> VoxelBatch:
    """A batch of voxels whose ``layout``, and ``layout_rows`` with it, is the one found in a
    ``share`` of the items."""
    chosen = jax.random.bernoulli(key, share, found.counts.shape)
    rows = jnp.where(
        chosen[:, None], matching_rows(found, batch.boxes, batch.part_counts), batch.layout_rows
    )
    return batch._replace(layout=choose(chosen, found, batch.layout), layout_rows=rows)


def choose(chosen: jax.Array, one: PartTable, other: PartTable) -> PartTable:
    """Part tables [B, ...] of ``one`` where ``chosen`` [B], else of ``other``."""

    def of_field(a, b):
        return jnp.where(chosen.reshape(-1, *[1] * (a.ndim - 1)), a, b)

    return PartTable(*(of_field(a, b) for a, b in zip(one, other, strict=True)))


def matching_rows(found: PartTable, boxes: jax.Array, part_counts: jax.Array) -> jax.Array:
    """[B, K] the row of a found layout that each true part is, -1 where none is: one to one by
    their corners (``matching.match``), at most ``SAME_PART`` apart.

    Args:
      boxes: [B, K, 6] of the true parts. part_counts: [B].
    """
    corners, true = box_corners(found.boxes, jnp), box_corners(boxes, jnp)
    apart = jnp.abs(corners[:, :, None] - true[:, None])  # [B, row, part, 6]
    there = jnp.arange(corners.shape[1]) < found.counts[:, None]
    cost = jnp.where(there[..., None], apart.mean(-1), NOBODYS_ROW)
    row = match(cost, part_counts)
    far = jnp.where(there[..., None], apart.max(-1), NOBODYS_ROW)
    far = jnp.take_along_axis(far, row[:, None], 1)[:, 0]
    known = jnp.arange(true.shape[1]) < part_counts[:, None]
    return jnp.where(known & (far < SAME_PART), row, -1)

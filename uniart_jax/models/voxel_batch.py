"""What networks read of a batch of voxels: codes, distances, colours, boxes."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from uniart_jax.voxels.grid import SDF_CLIP
from uniart_jax.voxels.typed_batches import VoxelBatch


def voxel_codes(batch: VoxelBatch) -> jax.Array:
    """[B, V, 21] full code of each voxel's part (``voxels.joint_code.CODE_CHANNELS``), from ids and
    tables of the batch."""
    part = batch.voxel_part.astype(jnp.int32)
    parent = jnp.take_along_axis(batch.parents, part, axis=1, mode="clip")

    def of(table: jax.Array, index: jax.Array) -> jax.Array:
        return jnp.take_along_axis(table, index[..., None], axis=1, mode="clip")

    boxes = batch.boxes
    return jnp.concatenate([of(batch.codes, part), of(boxes, part), of(boxes, parent)], -1)


def cell_sdf(sdf: jax.Array) -> jax.Array:
    """Distances in sub-cells [...] from what a batch holds: int8 as records store it
    (``data.records``), or float as it is."""
    return sdf.astype(jnp.float32) * (SDF_CLIP / 127) if sdf.dtype == jnp.int8 else sdf


def cell_color(color: jax.Array) -> jax.Array:
    """Linear RGB [...] from what a batch holds: sRGB-encoded uint8 as records store it, or linear
    float as it is."""
    if color.dtype != jnp.uint8:
        return color
    srgb = color.astype(jnp.float32) / 255
    return jnp.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def voxel_boxes(batch: VoxelBatch, voxels: jax.Array | None = None) -> dict[str, jax.Array]:
    """What a voxel, on one part or shared by several, must say of its sub-cells; at ``voxels`` [B,
    Q] or at all.

    Returns:
      own, other [B, Q, 6]: boxes of the voxel's part and of another one in it (its own where there
        is none); shared [B, Q] bool: there is one;
      other_part [B, Q, r^3] bool: the sub-cell is not the voxel's part's.
    """
    part, owner = (ids.astype(jnp.int32) for ids in (batch.voxel_part, batch.owner))
    if voxels is not None:
        part = jnp.take_along_axis(part, voxels, axis=1, mode="clip")
        owner = jnp.take_along_axis(owner, voxels[..., None], axis=1, mode="clip")
    other_part = owner != part[..., None]
    first = other_part.argmax(-1)
    other = jnp.take_along_axis(owner, first[..., None], axis=-1)[..., 0]

    def box(index: jax.Array) -> jax.Array:
        return jnp.take_along_axis(batch.boxes, index[..., None], axis=1, mode="clip")

    shared = other_part.any(-1)
    return {"own": box(part), "other": box(other), "shared": shared, "other_part": other_part}


def valid_tokens(counts: jax.Array, width: int) -> jax.Array:
    """[B, V, 1] bool."""
    return (jnp.arange(width) < counts[:, None])[..., None]

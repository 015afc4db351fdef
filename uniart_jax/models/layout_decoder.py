"""The part of the UniArt VAE's decoder that sees a layout.

    before   what voxels see of the layout (``models.layout_features``) is added to the trunk's
             input
    after    an MLP of the trunk's output and the same features adds to the output, and directly
             to distances and colours, which are more numbers than the trunk is wide
    pointer  each sub-cell chooses one of its voxel's nearest rows of the layout, or none; own box,
             joint code and parent are copied from the chosen row, so that they are exact

All layers that add begin at zero: a decoder that had no layout keeps its function at first.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from flax import nnx

from uniart_jax.config import ModelConfig
from uniart_jax.models.layout_features import NEAREST, NOT, LayoutFeatures
from uniart_jax.nn.blocks import linear, zeros
from uniart_jax.nn.precision import compute_dtype
from uniart_jax.voxels.part_table import PartTable


class Refinement(NamedTuple):
    """What the layout adds at voxels [B, Q].

    Attributes:
      hidden: [B, Q, width]. geometry: [B, Q, 4 r^3]. pointer: [B, Q, r^3, N + 1] logits, the last
        for none.
      picks: [B, Q, N, K] one-hot rows of the candidates, zero where there are fewer.
    """

    hidden: jax.Array
    geometry: jax.Array
    pointer: jax.Array
    picks: jax.Array


class LayoutDecoder(nnx.Module):
    """Layers of the decoder for a layout; ``UniArtVAEConfig.layout_channels`` wide."""

    def __init__(self, config: ModelConfig, rngs: nnx.Rngs):
        c, dtype = config.uniart_vae, compute_dtype(config)
        p, cells = c.layout_channels, config.grid.subdivisions**3
        self.resolution, self.cells = config.grid.resolution, cells
        self.features = LayoutFeatures(config.grid.subdivisions, rngs, dtype)
        seen = self.features.width
        self.before_in = linear(seen, p, rngs, dtype=dtype)
        self.before_out = linear(p, c.width, rngs, init=zeros, dtype=dtype)
        self.after_in = linear(seen + c.width, 2 * p, rngs, dtype=dtype)
        self.after_hidden = linear(2 * p, 2 * p, rngs, dtype=dtype)
        self.after_out = linear(2 * p, c.width, rngs, init=zeros, dtype=dtype)
        self.geometry_out = linear(2 * p, 4 * cells, rngs, init=zeros, dtype=dtype)
        self.pointer_out = linear(2 * p, cells * (NEAREST + 1), rngs, init=zeros, dtype=dtype)
        self.depth_weight = nnx.Param(jnp.full(1, 3.0))
        self.none = nnx.Param(jnp.full(1, -3.0))

    def before(self, table: PartTable, coords: jax.Array) -> jax.Array:
        """[B, V, width] to add to the input of the decoder's trunk."""
        seen = self.features(table, coords, self.resolution)
        return self.before_out(jax.nn.gelu(self.before_in(seen)))

    def after(self, table: PartTable, coords: jax.Array, h: jax.Array) -> Refinement:
        """What is added to the trunk's output h [B, Q, width] at voxels [B, Q, 3]."""
        seen, picks, depth = self.features.read_features(table, coords, self.resolution)
        u = jax.nn.gelu(self.after_in(jnp.concatenate([h.astype(seen.dtype), seen], -1)))
        u = jax.nn.gelu(self.after_hidden(u))
        logits = self.pointer_out(u).astype(jnp.float32)
        logits = logits.reshape(*u.shape[:2], self.cells, NEAREST + 1)
        rows = self.depth_weight[...] * jnp.minimum(jnp.swapaxes(depth, -1, -2), 0)
        there = (picks.sum(-1) > 0)[:, :, None]
        rows = jnp.where(there, logits[..., :-1] + rows, NOT)
        none = logits[..., -1:] + self.none[...]
        pointer = jnp.concatenate([rows, none], -1)
        geometry = self.geometry_out(u).astype(jnp.float32)
        return Refinement(self.after_out(u), geometry, pointer, picks)


def pointed(table: PartTable, more: Refinement, out: dict[str, jax.Array]) -> dict[str, jax.Array]:
    """The pointer's entries of what the decoder returns, and boxes, joint and parent copied from
    the rows that win.

    A voxel's joint and parent are those of the row to which most of its sub-cells point.
    """
    chosen = jax.nn.one_hot(more.pointer.argmax(-1), more.pointer.shape[-1])  # [B, Q, r^3, N + 1]
    own = copied(table.boxes, more.picks, chosen, out["own_box"])
    most = jax.nn.one_hot(chosen.sum(2).argmax(-1), chosen.shape[-1])[:, :, None]
    parent = jnp.take_along_axis(table.boxes, table.parents[..., None], 1, mode="clip")

    def one(rows, other):
        return copied(rows, more.picks, most, other[:, :, None])[:, :, 0]

    return {
        "pointer": more.pointer,
        "rows": jnp.where(more.picks.sum(-1) > 0, more.picks.argmax(-1), -1),
        "own_box": own,
        "joint_code": one(table.codes, out["joint_code"]),
        "parent_box": one(parent, out["parent_box"]),
    }


def copied(rows: jax.Array, picks: jax.Array, chosen: jax.Array, other: jax.Array) -> jax.Array:
    """[B, Q, C, D] of ``rows`` [B, K, D] what ``chosen`` [B, Q, C, N + 1] (one-hot) points at;
    ``other`` where it is none."""
    found = jnp.einsum("bqcn,bqnk,bkd->bqcd", chosen[..., :-1], picks, rows)
    return found + chosen[..., -1:] * other


def required(layout: Any) -> PartTable:
    """``layout``, or ValueError that says how to give one."""
    if layout is None:
        raise ValueError(
            "uniart_vae: this decoder sees a layout (layout_channels > 0); "
            "give batch.layout, a voxels.part_table.PartTable (count 0: none is known)"
        )
    return layout

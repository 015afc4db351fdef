"""How geometry and articulation meet at the front of the UniArt VAE: the part-wise UniArt attention
(paper section 4.1) and the paper's alternatives, one class each.

    V_geo = [visual || Linear(sdf, colour, owner mask)]
    V_art = Linear(part_feature) + Embed(voxel code)
    uniart: F_art = Attention(Q = V_art, K = V = V_geo) + V_art, each voxel within its own part
            V     = Concat(V_geo, F_art)

The owner mask (which sub-cells belong to the voxel's own part) is ours: without it the latent could
not hold the segmentation below a voxel.

A new aggregation is a subclass of ``Front`` and its line in ``AGGREGATIONS``; its name is then
``UniArtVAEConfig.aggregation`` (docs/tutorial.md has one).
"""

from __future__ import annotations

import abc

import jax
import jax.numpy as jnp
from flax import nnx

from uniart_jax.config import Kernel, ModelConfig
from uniart_jax.models.voxel_batch import (
    cell_color,
    cell_sdf,
    valid_tokens,
    voxel_codes,
)
from uniart_jax.nn.attention import attend_segments
from uniart_jax.nn.blocks import SelfAttention, layer_norm, linear, zeros
from uniart_jax.nn.precision import compute_dtype
from uniart_jax.nn.segments import Segments
from uniart_jax.voxels.joint_code import CODE_CHANNELS
from uniart_jax.voxels.typed_batches import VoxelBatch


class Front(nnx.Module):
    """Voxel attributes -> V_geo [B, V, geo] and V_art [B, V, art], and what an aggregation makes of
    them.

    Attributes:
      geo, art: channels of V_geo and V_art. channels: of V. config: the UniArt VAE's.
    """

    def __init__(self, config: ModelConfig, rngs: nnx.Rngs):
        c, dtype = config.uniart_vae, compute_dtype(config)
        cells = config.grid.subdivisions**3
        self.config, self.dtype = c, dtype
        self.kernel: Kernel = config.kernel
        self.art, self.geo = c.articulation_channels, c.visual_channels + c.geometry_channels
        self.channels = self.geo + self.art
        self.geometry = linear(cells * 5, c.geometry_channels, rngs, dtype=dtype)
        self.code_in = linear(CODE_CHANNELS, self.art, rngs, dtype=dtype)
        self.code_out = linear(self.art, self.art, rngs, dtype=dtype)
        self.part_feature = (
            # zero, so that a network that read none begins with the function that it was
            linear(c.part_feature_channels, self.art, rngs, init=zeros, dtype=dtype)
            if c.part_feature_channels
            else None
        )
        self.make(rngs)

    @abc.abstractmethod
    def make(self, rngs: nnx.Rngs) -> None:
        """Make the aggregation's own layers; set ``channels`` where V is not as wide as both."""

    @abc.abstractmethod
    def aggregate(
        self, geometry: jax.Array, articulation: jax.Array, batch: VoxelBatch
    ) -> jax.Array:
        """V [B, V, channels]; padding may hold anything. ``batch.plans["parts"]`` are the
        segments of the parts."""

    def __call__(self, batch: VoxelBatch) -> tuple[jax.Array, jax.Array, jax.Array]:
        """V [B, V, channels], V_geo and V_art."""
        valid = valid_tokens(batch.counts, batch.coords.shape[1])
        own = (batch.owner == batch.voxel_part[..., None]).astype(jnp.float32)
        color = cell_color(batch.color.reshape(*batch.color.shape[:2], -1))
        cells = jnp.concatenate([cell_sdf(batch.sdf), color * 2 - 1, own], -1)
        geometry = self.geometry(jnp.where(valid, cells, 0))
        if self.config.visual_channels:
            visual = jnp.where(valid, batch.visual, 0).astype(geometry.dtype)
            geometry = jnp.concatenate([visual, geometry], -1)
        code = jnp.where(valid, voxel_codes(batch), 0)
        articulation = self.code_out(jax.nn.silu(self.code_in(code)))
        if self.part_feature is not None:
            articulation = articulation + self.part_feature(jnp.where(valid, batch.part_feature, 0))
        return self.aggregate(geometry, articulation, batch), geometry, articulation


class UniArtFront(Front):
    """Attention of articulation to geometry, within each part."""

    def make(self, rngs: nnx.Rngs) -> None:
        c, art = self.config, self.art
        # TRELLIS has heads of 64; ours keep the trunk's head width where it divides
        self.heads = max(1, art * c.num_heads // c.width)
        self.to_q = linear(art, art, rngs, dtype=self.dtype)
        self.to_kv = linear(self.geo, 2 * art, rngs, dtype=self.dtype)
        self.to_out = linear(art, art, rngs, dtype=self.dtype)

    def aggregate(
        self, geometry: jax.Array, articulation: jax.Array, batch: VoxelBatch
    ) -> jax.Array:
        fused = self._attend(geometry, articulation, batch.plans["parts"])
        return jnp.concatenate([geometry, fused + articulation], -1)

    def _attend(self, geometry: jax.Array, articulation: jax.Array, parts: Segments) -> jax.Array:
        shape = (-1, self.heads, articulation.shape[-1] // self.heads)
        k, v = jnp.split(self.to_kv(geometry), 2, -1)
        qkv = jnp.stack([x.reshape(shape) for x in (self.to_q(articulation), k, v)], 1)
        out = attend_segments(qkv, parts, kernel=self.kernel)
        return self.to_out(out.reshape(articulation.shape))


class SelfAttentionFront(Front):
    """Self-attention of both, within windows."""

    def make(self, rngs: nnx.Rngs) -> None:
        heads = next(h for h in range(self.config.num_heads, 0, -1) if self.channels % h == 0)
        self.self_attn = SelfAttention(
            self.channels, heads, rngs, kernel=self.kernel, dtype=self.dtype
        )

    def aggregate(
        self, geometry: jax.Array, articulation: jax.Array, batch: VoxelBatch
    ) -> jax.Array:
        both = jnp.concatenate([geometry, articulation], -1)
        full = self.config.attention == "full"
        segments = batch.counts if full else batch.plans["window_0"]
        return both + self.self_attn(layer_norm(both, 1e-6), segments)


class ResidualFront(Front):
    """Articulation is added to geometry."""

    def make(self, rngs: nnx.Rngs) -> None:
        self.to_geometry = linear(self.art, self.geo, rngs, dtype=self.dtype)
        self.channels = self.geo

    def aggregate(
        self, geometry: jax.Array, articulation: jax.Array, batch: VoxelBatch
    ) -> jax.Array:
        return geometry + self.to_geometry(articulation)


class PoolingFront(Front):
    """The mean of geometry over the part: attention that looks everywhere alike."""

    def make(self, rngs: nnx.Rngs) -> None:
        self.to_out = linear(self.geo, self.art, rngs, dtype=self.dtype)

    def aggregate(
        self, geometry: jax.Array, articulation: jax.Array, batch: VoxelBatch
    ) -> jax.Array:
        value = self.to_out(geometry).reshape(-1, 1, self.art)
        alike = jnp.zeros_like(value)
        qkv = jnp.stack([alike, alike, value], 1)
        mean = attend_segments(qkv, batch.plans["parts"], kernel=self.kernel)
        return jnp.concatenate([geometry, mean.reshape(articulation.shape) + articulation], -1)


class ConcatFront(Front):
    """Concatenation and a linear layer (the "vanilla convolution" of the paper's uni-encoding)."""

    def make(self, rngs: nnx.Rngs) -> None:
        self.fuse = linear(self.channels, self.channels, rngs, dtype=self.dtype)

    def aggregate(
        self, geometry: jax.Array, articulation: jax.Array, batch: VoxelBatch
    ) -> jax.Array:
        return jax.nn.silu(self.fuse(jnp.concatenate([geometry, articulation], -1)))


AGGREGATIONS: dict[str, type[Front]] = {
    "uniart": UniArtFront,
    "self_attention": SelfAttentionFront,
    "residual": ResidualFront,
    "pooling": PoolingFront,
    "concat": ConcatFront,
}


def make_front(config: ModelConfig, rngs: nnx.Rngs) -> Front:
    """The front that a config names.

    Raises:
      ValueError: no such aggregation.
    """
    kind = config.uniart_vae.aggregation
    if kind not in AGGREGATIONS:
        raise ValueError(
            f"config: model.uniart_vae.aggregation {kind!r} is none of {', '.join(AGGREGATIONS)}"
        )
    return AGGREGATIONS[kind](config, rngs)

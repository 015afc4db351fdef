"""What both flows share: time embedding, blocks, volume and layout, and what a network that
predicts the clean sample is shown."""

from __future__ import annotations

from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from flax import nnx

from uniart_jax.config import FlowConfig, ModelConfig
from uniart_jax.models.layout_features import LayoutFeatures
from uniart_jax.nn.blocks import (
    ModulatedBlock,
    TimestepEmbedder,
    layer_norm,
    linear,
    modulation,
    zeros,
)
from uniart_jax.nn.embeddings import timestep_embedding
from uniart_jax.nn.pooling import align_volume
from uniart_jax.nn.precision import compute_dtype
from uniart_jax.nn.stack import run_stack
from uniart_jax.voxels.part_table import PartTable

Given = TypeVar("Given")

T_MIN = 0.05  # below this time a predicted sample is turned into a velocity as if at this time


class FlowTrunk(nnx.Module):
    """What both flows share: time embedding, blocks, aligned volume. A base class, so that
    parameter names stay TRELLIS's."""

    def make_trunk(
        self, c: FlowConfig, config: ModelConfig, grid_side: int, rngs: nnx.Rngs
    ) -> None:
        dtype, d = compute_dtype(config), c.model_channels
        self.config, self.side = c, grid_side
        self.scan_blocks, self.remat = config.scan_blocks, config.remat
        self.t_embedder = TimestepEmbedder(d, rngs)
        self.share_mod = c.share_mod
        if c.share_mod:
            self.adaLN_modulation = modulation(d, 6 * d, rngs, init=zeros, dtype=dtype)
        if c.volume_channels:
            joined = max(1, c.volume_resolution // grid_side) ** 3
            self.volume_layer = linear(c.volume_channels * joined, d, rngs, dtype=dtype)
        self.blocks = nnx.List(
            [
                ModulatedBlock(
                    d,
                    c.cond_channels,
                    c.num_heads,
                    c.mlp_ratio,
                    rngs,
                    qk_rms_norm=c.qk_rms_norm,
                    qk_rms_norm_cross=c.qk_rms_norm_cross,
                    share_mod=c.share_mod,
                    kernel=config.kernel,
                    dtype=dtype,
                )
                for _ in range(c.num_blocks)
            ]
        )

    def embed_time(self, t: jax.Array) -> jax.Array:
        """[B, D] of times [B], 1 at noise; the network's own time runs as ``direction`` says."""
        t = t if self.config.direction == "data_to_noise" else 1 - t
        return self.t_embedder(timestep_embedding(1000.0 * t))

    def embed_volume(self, volume: jax.Array, draws: int) -> jax.Array:
        """[B, Rv, Rv, Rv, C] -> [B draws, G, G, G, D], of the first ``volume_channels`` channels;
        zeros (no condition) give the layer's bias."""
        volume = volume[..., : self.config.volume_channels]
        aligned = align_volume(layer_norm(volume, 1e-5), self.side)
        return jnp.repeat(self.volume_layer(aligned), draws, axis=0)

    def make_layout(self, children: int, cells: int, rngs: nnx.Rngs, dtype) -> None:
        """Layers for a layout: features of ``cells`` a token, each of ``children`` a side; what
        they add begins at nothing."""
        p = self.config.layout_channels
        self.layout = LayoutFeatures(children, rngs, dtype)
        self.layout_in = linear(self.layout.width, 2 * p, rngs, dtype=dtype)
        self.layout_hidden = linear(2 * p, p, rngs, dtype=dtype)
        self.layout_cube = linear(
            cells * p, self.config.model_channels, rngs, init=zeros, dtype=dtype
        )

    def see_layout(self, table: PartTable | None, coords: jax.Array, resolution: int) -> Any:
        """[B, S, layout_channels] what cells [B, S, 3] see of the layout; None without
        ``layout_channels``."""
        if not self.config.layout_channels:
            return None
        table = required(table, "layout_channels", "layout", "the part table of a")
        h = self.layout_in(self.layout(table, coords, resolution))
        return jax.nn.gelu(self.layout_hidden(jax.nn.gelu(h)))

    def run_blocks(
        self, h: jax.Array, time: jax.Array, context: jax.Array, lengths: jax.Array | None = None
    ) -> jax.Array:
        if self.share_mod:
            time = self.adaLN_modulation["1"](jax.nn.silu(time))
        return run_stack(
            self.blocks,
            lambda block, _, h: block(h, time, context, lengths),
            h,
            scan=self.scan_blocks,
            remat=self.remat,
        )

    def see(self, x: jax.Array, t: jax.Array) -> jax.Array:
        """What the network is shown of x_t. Where it predicts x_0: the best linear guess of x_0, so
        that near t = 1 it is shown nothing instead of noise (the c_skip of Karras et al. 2022, for
        straight paths and data of deviation 1, on the way in)."""
        if self.config.prediction == "velocity":
            return x
        scale = (1 - t) / ((1 - t) ** 2 + t**2)
        return x * scale.reshape(-1, *[1] * (x.ndim - 1))

    def to_velocity(self, out: jax.Array, x: jax.Array, t: jax.Array) -> jax.Array:
        """The network's output as dx/dt: v = (x_t - x_0) / t where it predicts x_0, -v where its
        own time runs to data (``direction``)."""
        out = out.astype(jnp.float32)
        if self.config.prediction == "velocity":
            return out if self.config.direction == "data_to_noise" else -out
        return (x - out) / jnp.maximum(t, T_MIN).reshape(-1, *[1] * (x.ndim - 1))


def check_camera(config: ModelConfig, option: str) -> None:
    """ValueError if the image encoder is not ``spatial`` (``config.ImageEncoderKind``): it gives no
    camera and maps, which a flow's ``option`` needs."""
    if not config.image_encoder.kind.spatial:
        raise ValueError(f"{option} needs an image encoder that estimates the camera; set it to 0")


def required(
    given: Given | None, option: str, name: str, whose: str = "the image encoder's"
) -> Given:
    if given is None:
        more = (
            ", as pipeline.following(condition, [layout or None]) does" if name == "layout" else ""
        )
        raise ValueError(
            f"flow: this model reads {whose} {name} ({option} > 0); pass {name}={more}"
        )
    return given

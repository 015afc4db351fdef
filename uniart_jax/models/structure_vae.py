"""Structure VAE: occupancy [R^3] <-> dense latent, by 3D convolutions. Upstream: TRELLIS
``models/sparse_structure_vae.py``.

``patch_size`` above 1 (not in TRELLIS) folds cubes of voxels into channels first, so that a CPU
never convolves at full resolution.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from flax import nnx

from uniart_jax.config import ModelConfig, StructureVAEConfig
from uniart_jax.nn.blocks import GroupNorm, LayerNorm
from uniart_jax.nn.convolution import Conv3d, Halve, depth_to_space, space_to_depth
from uniart_jax.nn.precision import compute_dtype


class ResBlock(nnx.Module):
    """LN, SiLU, conv, LN, SiLU, conv (zero-initialised), added to the input. LN over channels with
    eps 1e-5."""

    def __init__(self, channels: int, rngs: nnx.Rngs, dtype):
        self.norm1, self.norm2 = (
            LayerNorm(channels, epsilon=1e-5),
            LayerNorm(channels, epsilon=1e-5),
        )
        self.conv1 = Conv3d(channels, channels, rngs, dtype=dtype)
        self.conv2 = Conv3d(channels, channels, rngs, zero=True, dtype=dtype)

    def __call__(self, x: jax.Array) -> jax.Array:
        h = self.conv1(jax.nn.silu(self.norm1(x)))
        return x + self.conv2(jax.nn.silu(self.norm2(h)))


class Downsample(nnx.Module):
    def __init__(self, inputs: int, outputs: int, rngs: nnx.Rngs, dtype):
        self.conv = Halve(inputs, outputs, rngs, dtype=dtype)

    def __call__(self, x: jax.Array) -> jax.Array:
        return self.conv(x)


class Upsample(nnx.Module):
    def __init__(self, inputs: int, outputs: int, rngs: nnx.Rngs, dtype):
        self.conv = Conv3d(inputs, outputs * 8, rngs, dtype=dtype)

    def __call__(self, x: jax.Array) -> jax.Array:
        return depth_to_space(self.conv(x), 2)


def last_norm(channels: int, c: StructureVAEConfig) -> LayerNorm | GroupNorm:
    """Before the last convolution; the only norm that TRELLIS's option changes."""
    return GroupNorm(channels) if c.norm == "group" else LayerNorm(channels, epsilon=1e-5)


class Encoder(nnx.Module):
    """Occupancy [B, R, R, R] -> mean and log-variance of the latent."""

    def __init__(self, config: ModelConfig, rngs: nnx.Rngs):
        c, dtype = config.structure_vae, compute_dtype(config)
        self.patch = c.patch_size
        self.input_layer = Conv3d(c.patch_size**3, c.channels[0], rngs, dtype=dtype)
        blocks: list[nnx.Module] = []
        for i, channels in enumerate(c.channels):
            blocks += [ResBlock(channels, rngs, dtype) for _ in range(c.num_res_blocks)]
            if i + 1 < len(c.channels):
                blocks.append(Downsample(channels, c.channels[i + 1], rngs, dtype))
        self.blocks = nnx.List(blocks)
        self.middle_block = nnx.List(
            [ResBlock(c.channels[-1], rngs, dtype) for _ in range(c.num_res_blocks_middle)]
        )
        self.out_layer = nnx.Dict(
            {
                "0": last_norm(c.channels[-1], c),
                "2": Conv3d(c.channels[-1], 2 * c.latent_channels, rngs, dtype=dtype),
            }
        )

    def __call__(self, occupancy: jax.Array) -> tuple[jax.Array, jax.Array]:
        h = occupancy[..., None].astype(jnp.float32)
        h = self.input_layer(space_to_depth(h, self.patch) if self.patch > 1 else h)
        for block in (*self.blocks, *self.middle_block):
            h = block(h)
        h = jax.nn.silu(self.out_layer["0"](h.astype(jnp.float32)))
        mean, logvar = jnp.split(self.out_layer["2"](h).astype(jnp.float32), 2, -1)
        return mean, logvar


class Decoder(nnx.Module):
    """Latent [B, r, r, r, C] -> occupancy logits [B, R, R, R]."""

    def __init__(self, config: ModelConfig, rngs: nnx.Rngs):
        c, dtype = config.structure_vae, compute_dtype(config)
        self.patch = c.patch_size
        widths = c.channels[::-1]
        self.input_layer = Conv3d(c.latent_channels, widths[0], rngs, dtype=dtype)
        self.middle_block = nnx.List(
            [ResBlock(widths[0], rngs, dtype) for _ in range(c.num_res_blocks_middle)]
        )
        blocks: list[nnx.Module] = []
        for i, channels in enumerate(widths):
            blocks += [ResBlock(channels, rngs, dtype) for _ in range(c.num_res_blocks)]
            if i + 1 < len(widths):
                blocks.append(Upsample(channels, widths[i + 1], rngs, dtype))
        self.blocks = nnx.List(blocks)
        self.out_layer = nnx.Dict(
            {
                "0": last_norm(widths[-1], c),
                "2": Conv3d(widths[-1], c.patch_size**3, rngs, dtype=dtype),
            }
        )

    def __call__(self, latent: jax.Array) -> jax.Array:
        h = self.input_layer(latent)
        for block in (*self.middle_block, *self.blocks):
            h = block(h)
        h = self.out_layer["2"](jax.nn.silu(self.out_layer["0"](h.astype(jnp.float32)))).astype(
            jnp.float32
        )
        return (depth_to_space(h, self.patch) if self.patch > 1 else h)[..., 0]


class StructureVAE(nnx.Module):
    """Methods: ``encode``, ``decode``; calling runs both."""

    def __init__(self, config: ModelConfig, rngs: nnx.Rngs):
        self.encoder = Encoder(config, rngs)
        self.decoder = Decoder(config, rngs)

    def encode(self, occupancy: jax.Array) -> tuple[jax.Array, jax.Array]:
        """[B, R, R, R] bool or 0..1 -> (mean, logvar), each [B, r, r, r, C]."""
        return self.encoder(occupancy)

    def decode(self, latent: jax.Array) -> jax.Array:
        """[B, r, r, r, C] -> occupancy logits [B, R, R, R]."""
        return self.decoder(latent)

    def __call__(self, occupancy: jax.Array, key: jax.Array | None = None) -> dict[str, jax.Array]:
        """Encode, sample the posterior if a key is given, decode: {"mean", "logvar", "latent",
        "logits"}."""
        mean, logvar = self.encode(occupancy)
        latent = sample_posterior(mean, logvar, key)
        return {"mean": mean, "logvar": logvar, "latent": latent, "logits": self.decode(latent)}


def sample_posterior(mean: jax.Array, logvar: jax.Array, key: jax.Array | None) -> jax.Array:
    """mean + exp(logvar / 2) eps, or the mean without a key."""
    if key is None:
        return mean
    return mean + jnp.exp(0.5 * logvar) * jax.random.normal(key, mean.shape, mean.dtype)

"""Nano image encoder: a small convolutional network, image tokens from it, and a volume aligned with the object's grid.

    image -> residual convolutions -> feature map -> tokens (a few transformer blocks), for cross-attention
                                          |
                                     MLP on all of it -> coarse volume -> blocks that look at the tokens -> volume -> occupancy, codes

Pre-trained by regressing coarse occupancy, boxes and joints from the image (docs/architecture.md), then frozen: trained jointly with a flow from
scratch, an image encoder of this size is ignored while the loss falls. Convolutions, because a transformer on patches of
this size took twice as long an image and had learnt less after as many (configs/nano.py).
"""

from __future__ import annotations

import itertools
from typing import Any

import jax
import jax.numpy as jnp
from flax import nnx

from uniart_jax.config import ModelConfig
from uniart_jax.nn.blocks import CrossBlock, LayerNorm, TransformerBlock, layer_norm, linear
from uniart_jax.nn.embeddings import grid_coords, plane_embedding, position_embedding
from uniart_jax.nn.precision import compute_dtype

CODE_CHANNELS = 21  # joint code 9, own box 6, parent box 6
_HEAD_WIDTH = 64
_SKETCH_CHANNELS = 64


class StemStage(nnx.Module):
    """Halves the picture: a strided convolution, then a residual pair."""

    def __init__(self, inputs: int, outputs: int, rngs: nnx.Rngs, dtype):
        def convolution(channels: int, strides: int) -> nnx.Conv:
            padding = ((1, 1), (1, 1))
            return nnx.Conv(
                channels, outputs, (3, 3), strides=strides, padding=padding, dtype=dtype, rngs=rngs
            )

        self.down, self.conv1 = convolution(inputs, 2), convolution(outputs, 1)
        self.conv2 = convolution(outputs, 1)

    def __call__(self, x: jax.Array) -> jax.Array:
        """[B, H, W, C] -> [B, H / 2, W / 2, C']."""
        x = jax.nn.gelu(self.down(x))
        return x + self.conv2(jax.nn.gelu(self.conv1(x)))


class ImageEncoder(nnx.Module):
    """image [B, H, W, 3] -> tokens, volume, occupancy, codes."""

    def __init__(self, config: ModelConfig, rngs: nnx.Rngs):
        c, dtype = config.image_encoder, compute_dtype(config)
        side = c.stem_size >> len(c.stem_channels)
        if side << len(c.stem_channels) != c.stem_size or c.image_size % c.stem_size:
            raise ValueError(
                f"image_encoder: stem_size {c.stem_size} must divide image_size {c.image_size} and halve once per stem_channels {c.stem_channels}"
            )
        self.config, self.resolution = c, config.grid.resolution
        channels = (3, *c.stem_channels)
        self.stem = nnx.List(
            [StemStage(a, b, rngs, dtype) for a, b in itertools.pairwise(channels)]
        )
        self.to_tokens = linear(channels[-1], c.width, rngs, dtype=dtype)
        self.pos_embed = nnx.Param(jnp.asarray(plane_embedding(side, c.width)))
        block: dict[str, Any] = {"kernel": config.kernel, "dtype": dtype}
        self.blocks = nnx.List(
            [
                TransformerBlock(c.width, c.num_heads, c.mlp_ratio, rngs, **block)
                for _ in range(c.num_blocks)
            ]
        )
        self.norm = LayerNorm(c.width)
        self.queries = nnx.Param(position_embedding(grid_coords(c.volume_tokens), c.width))
        wide = c.sketch_width
        widths = (side**2 * channels[-1], wide, wide, c.volume_tokens**3 * _SKETCH_CHANNELS)
        pairs = [*itertools.pairwise(widths), (_SKETCH_CHANNELS, c.width)]
        self.sketch = nnx.List([linear(a, b, rngs, dtype=dtype) for a, b in pairs] if wide else [])
        self.volume_blocks = nnx.List(
            [
                CrossBlock(c.width, c.num_heads, c.mlp_ratio, rngs, **block)
                for _ in range(c.volume_blocks)
            ]
        )
        self.cells = c.volume_resolution // c.volume_tokens
        self.to_volume = linear(c.width, self.cells**3 * c.volume_channels, rngs, dtype=dtype)
        self.head_in = linear(c.volume_channels, _HEAD_WIDTH, rngs, dtype=dtype)
        self.head_token = linear(c.width, _HEAD_WIDTH, rngs, dtype=dtype)
        self.fine = self.resolution // c.volume_resolution
        self.coarse = c.target_resolution // c.volume_resolution
        outputs = self.fine**3 + self.coarse**3 * CODE_CHANNELS
        self.head_out = linear(_HEAD_WIDTH, outputs, rngs, dtype=dtype)

    def __call__(self, image: jax.Array) -> dict[str, jax.Array]:
        """Encode images.

        Args:
          image: [B, H, W, 3] sRGB in [0, 1], the background black.

        Returns:
          tokens [B, L, D]; volume [B, Rv, Rv, Rv, C]; occupancy [B, R, R, R] logits; codes [B, Rt, Rt, Rt, 21] = joint code 9,
          own box 6, parent box 6. Occupancy and codes are read off the volume, so the volume holds what they need.
        """
        features = self.features(image)
        tokens = self.tokens(features)
        h = jnp.broadcast_to(self.queries[...], (image.shape[0], *self.queries.shape)).astype(
            tokens.dtype
        )
        if self.sketch:
            h = h + self.draw_sketch(features)
        for block in self.volume_blocks:
            h = block(h, tokens)
        h = layer_norm(h, 1e-6)
        items, c = image.shape[0], self.config
        cells = self.to_volume(h).reshape(items, -1, self.cells**3, c.volume_channels)
        hidden = jax.nn.gelu(self.head_in(cells) + self.head_token(h)[:, :, None, :])
        out = self.head_out(hidden).astype(jnp.float32)
        split = self.fine**3
        side = c.volume_tokens
        volume = _unfold(cells.astype(jnp.float32), side, self.cells)
        side = c.volume_resolution
        out = _unfold(out, c.volume_tokens, self.cells).reshape(items, side**3, -1)
        occupancy = _unfold(out[..., :split, None], side, self.fine)
        codes = _unfold(
            out[..., split:].reshape(items, side**3, self.coarse**3, CODE_CHANNELS),
            side,
            self.coarse,
        )
        return {"tokens": tokens, "volume": volume, "occupancy": occupancy[..., 0], "codes": codes}

    def features(self, image: jax.Array) -> jax.Array:
        """[B, H, W, 3] -> [B, side, side, C]."""
        c = self.config
        times = c.image_size // c.stem_size
        if times > 1:
            image = image.reshape(-1, c.stem_size, times, c.stem_size, times, 3).mean((2, 4))
        h = image * 2 - 1
        for stage in self.stem:
            h = stage(h)
        return h

    def draw_sketch(self, features: jax.Array) -> jax.Array:
        """[B, side, side, C] -> [B, volume tokens, D] by an MLP on the whole feature map: where the object is, from any view."""
        first, second, out, lift = self.sketch
        h = jax.nn.gelu(first(features.reshape(features.shape[0], -1)))
        h = h + jax.nn.gelu(second(h))
        return lift(out(h).reshape(h.shape[0], -1, _SKETCH_CHANNELS))

    def tokens(self, features: jax.Array) -> jax.Array:
        """[B, side, side, C] -> [B, side^2, D] normalised tokens, for cross-attention."""
        h = self.to_tokens(features).reshape(features.shape[0], -1, self.config.width)
        h = h + self.pos_embed[...].astype(h.dtype)
        for block in self.blocks:
            h = block(h)
        return self.norm(h)


def _unfold(cells: jax.Array, side: int, inner: int) -> jax.Array:
    """[B, side^3, inner^3, C] -> [B, (side inner), (side inner), (side inner), C]."""
    items, channels = cells.shape[0], cells.shape[-1]
    grid = cells.reshape(items, side, side, side, inner, inner, inner, channels)
    full = side * inner
    return grid.transpose(0, 1, 4, 2, 5, 3, 6, 7).reshape(items, full, full, full, channels)

"""Nano image encoder: convolutional stem, ViT, and a decoder from image tokens to a volume aligned with the object's grid.

Pre-trained by regressing coarse occupancy, boxes and joints from the image (docs/architecture.md), then frozen: trained jointly with a flow from
scratch, an image encoder of this size is ignored while the loss falls.
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
_HEAD_WIDTH = 128
_SKETCH_CHANNELS = 64


class ImageEncoder(nnx.Module):
    """image [B, H, W, 3] -> tokens, volume, occupancy, codes."""

    def __init__(self, config: ModelConfig, rngs: nnx.Rngs):
        c, dtype = config.image_encoder, compute_dtype(config)
        strides = c.patch_size.bit_length() - 1
        if 1 << strides != c.patch_size or len(c.stem_channels) >= strides + 1:
            raise ValueError(
                f"image_encoder: patch_size {c.patch_size} must be a power of two with more halvings than stem_channels {c.stem_channels}"
            )
        self.config, self.resolution = c, config.grid.resolution
        channels = (3, *c.stem_channels)
        channels += (c.width,) * (strides + 1 - len(channels))
        self.stem = nnx.List(
            [
                nnx.Conv(a, b, (3, 3), strides=2, padding=((1, 1), (1, 1)), dtype=dtype, rngs=rngs)
                for a, b in itertools.pairwise(channels)
            ]
        )
        self.stem_norm = nnx.List([LayerNorm(b) for b in channels[1:]])
        side = c.image_size // c.patch_size
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
        widths = (c.thumbnail**2 * 3, c.thumbnail_width, c.thumbnail_width)
        widths += (c.volume_tokens**3 * _SKETCH_CHANNELS,)
        pairs = list(itertools.pairwise(widths)) + [(_SKETCH_CHANNELS, c.width)]
        self.sketch = nnx.List(
            [linear(a, b, rngs, dtype=dtype) for a, b in pairs] if c.thumbnail else []
        )
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
        tokens = self.tokens(image)
        h = jnp.broadcast_to(self.queries[...], (image.shape[0], *self.queries.shape)).astype(
            tokens.dtype
        )
        if self.sketch:
            h = h + self.draw_sketch(image)
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

    def draw_sketch(self, image: jax.Array) -> jax.Array:
        """[B, H, W, 3] -> [B, volume tokens, D] by an MLP on the whole thumbnail: a coarse volume that learns in minutes."""
        c = self.config
        first, second, out, lift = self.sketch
        small = jax.image.resize(image, (image.shape[0], c.thumbnail, c.thumbnail, 3), "linear")
        h = jax.nn.gelu(first(small.reshape(image.shape[0], -1) * 2 - 1))
        h = h + jax.nn.gelu(second(h))
        return lift(out(h).reshape(image.shape[0], -1, _SKETCH_CHANNELS))

    def tokens(self, image: jax.Array) -> jax.Array:
        """[B, H, W, 3] -> [B, (H / patch)^2, D] normalised tokens, for cross-attention."""
        h = image * 2 - 1
        for i, (convolution, norm) in enumerate(zip(self.stem, self.stem_norm, strict=True)):
            h = norm(convolution(h))
            if i + 1 < len(self.stem):
                h = jax.nn.gelu(h)
        h = h.reshape(h.shape[0], -1, h.shape[-1]) + self.pos_embed[...].astype(h.dtype)
        for block in self.blocks:
            h = block(h)
        return self.norm(h)


def _unfold(cells: jax.Array, side: int, inner: int) -> jax.Array:
    """[B, side^3, inner^3, C] -> [B, (side inner), (side inner), (side inner), C]."""
    items, channels = cells.shape[0], cells.shape[-1]
    grid = cells.reshape(items, side, side, side, inner, inner, inner, channels)
    full = side * inner
    return grid.transpose(0, 1, 4, 2, 5, 3, 6, 7).reshape(items, full, full, full, channels)

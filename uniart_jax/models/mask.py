"""What of a picture is its object: a mask from a photograph, so that it can be cut out.

    image -> EfficientNet-Lite0 -> maps at strides 4, 8, 16
    coarsest map -> transformer over all of its cells -> top down, a residual layer a stride
                 -> 4 x 4 logits a cell of the finest map, which also sees that cell's 4 x 4 pixels

A feature pyramid (Lin et al. 2017) with attention at its top: which of several things is the object
takes a look at the whole picture, where its edge runs takes the pixels.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from flax import nnx

from uniart_jax.config import ModelConfig
from uniart_jax.models.efficientnet_lite import Depthwise, EfficientNetLite0
from uniart_jax.models.layout import TOKENS_SIDE, resize, twice
from uniart_jax.nn.blocks import GroupNorm, LayerNorm, TransformerBlock, linear, zeros
from uniart_jax.nn.precision import compute_dtype

CELL = 4  # pixels a side of a cell of the finest map
BLOCKS, HEADS, RATIO = 2, 4, 1.0  # of the transformer
KERNEL = 5  # of the residual layers


class Residual(nnx.Module):
    """x += a depthwise convolution between two dense layers: what is near is compared."""

    def __init__(self, channels: int, rngs: nnx.Rngs, dtype, plain: bool):
        self.norm = GroupNorm(channels, groups=8)
        self.wide = linear(channels, 2 * channels, rngs, dtype=dtype)
        self.near = Depthwise(2 * channels, KERNEL, 1, rngs, plain)
        self.back = linear(2 * channels, channels, rngs, init=zeros, dtype=dtype)

    def __call__(self, x: jax.Array) -> jax.Array:
        """[B, H, W, C] -> [B, H, W, C]."""
        return x + self.back(jax.nn.gelu(self.near(self.wide(self.norm(x)))))


class MaskNetwork(nnx.Module):
    """image [B, S, S, 3] -> logits [B, S, S] that a pixel is the object's."""

    def __init__(self, config: ModelConfig, rngs: nnx.Rngs):
        c, dtype = config.mask, compute_dtype(config)
        if c.channels < 8 or c.channels % 8 or c.image_size < 32 or c.image_size % 32:
            raise ValueError(
                "mask: needs channels that 8 divides and an image_size that 32 divides, got "
                f"{c.channels}, {c.image_size}"
            )
        plain = config.kernel == "plain"
        self.backbone = EfficientNetLite0(rngs, dtype, plain)
        widths = self.backbone.CHANNELS
        self.to_tokens = linear(widths[-1], c.width, rngs, dtype=dtype)
        self.tokens_place = nnx.Param(
            0.02 * jax.random.normal(rngs.params(), (TOKENS_SIDE**2, c.width))
        )
        self.blocks = nnx.List(
            [
                TransformerBlock(c.width, HEADS, RATIO, rngs, kernel=config.kernel, dtype=dtype)
                for _ in range(BLOCKS)
            ]
        )
        self.tokens_norm = LayerNorm(c.width)
        self.from_tokens = linear(c.width, c.channels, rngs, dtype=dtype)
        self.map_norms = nnx.List([GroupNorm(n, groups=8) for n in widths])
        self.to_map = nnx.List([linear(n, c.channels, rngs, dtype=dtype) for n in widths])
        self.residuals = nnx.List([Residual(c.channels, rngs, dtype, plain) for _ in widths])
        self.read = linear(c.channels + 3 * CELL**2, c.channels, rngs, dtype=dtype)
        self.out = linear(c.channels, CELL**2, rngs, init=zeros, dtype=dtype)

    def __call__(self, image: jax.Array) -> jax.Array:
        """Find the object.

        Args:
          image: [B, S, S, 3] sRGB in [0, 1], with its background; S is a multiple of 32.

        Returns:
          [B, S, S] float32 logits.
        """
        image = image * 2 - 1
        maps = self.backbone(image)
        items, side = maps[-1].shape[:2]
        place = resize(self.tokens_place[...].reshape(1, TOKENS_SIDE, TOKENS_SIDE, -1), side)
        tokens = self.to_tokens(maps[-1]) + place.astype(maps[-1].dtype)
        tokens = tokens.reshape(items, side**2, -1)
        for block in self.blocks:
            tokens = block(tokens)
        x = self.from_tokens(self.tokens_norm(tokens)).reshape(items, side, side, -1)
        for stride in (2, 1, 0):
            x = x if stride == 2 else twice(x)
            x = x + self.to_map[stride](jax.nn.gelu(self.map_norms[stride](maps[stride])))
            x = self.residuals[stride](x)
        pixels = cells_of(image.astype(x.dtype), CELL)
        h = jax.nn.gelu(self.read(jnp.concatenate([x, pixels], -1)))
        return pixels_of(self.out(h), CELL)[..., 0].astype(jnp.float32)


def cells_of(image: jax.Array, side: int) -> jax.Array:
    """[B, S, S, C] -> [B, S / n, S / n, n n C]: the pixels of each cell of n x n."""
    items, size, _, channels = image.shape
    x = image.reshape(items, size // side, side, size // side, side, channels)
    return x.transpose(0, 1, 3, 2, 4, 5).reshape(items, size // side, size // side, -1)


def pixels_of(cells: jax.Array, side: int) -> jax.Array:
    """The inverse of ``cells_of``."""
    items, count, _, values = cells.shape
    x = cells.reshape(items, count, count, side, side, values // side**2)
    return x.transpose(0, 1, 3, 2, 4, 5).reshape(items, count * side, count * side, -1)

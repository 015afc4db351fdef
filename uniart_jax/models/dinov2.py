"""DINOv2's vision transformer with registers: TRELLIS's image condition, and the features that it
averages over views on the voxels.

Upstream: facebookresearch/dinov2 ``models/vision_transformer.py`` (ViT-L/14 with 4 registers at
full size), and TRELLIS ``pipelines/trellis_image_to_3d.py`` for the condition. LayerNorm eps 1e-6,
exact GELU, a learned scale on every branch.

    tokens    = [cls, patches] + position table      registers stand after cls and have no position
    x         = blocks(tokens)                       "x_prenorm"
    condition = LN(x; no parameters, eps 1e-5)       the final norm of DINOv2 is not used by TRELLIS
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from flax import nnx

from uniart_jax.config import ImageEncoderConfig, Kernel, ModelConfig
from uniart_jax.nn.attention import attend
from uniart_jax.nn.blocks import LayerNorm, layer_norm, linear
from uniart_jax.nn.precision import compute_dtype
from uniart_jax.nn.stack import run_stack

# of ImageNet's sRGB values in [0, 1]
IMAGE_MEAN = (0.485, 0.456, 0.406)
IMAGE_STD = (0.229, 0.224, 0.225)
_normal = nnx.initializers.truncated_normal(0.02)


class PatchProjection(nnx.Module):
    """A convolution of stride = size, as one matrix product (XLA's strided convolution is slow on
    CPU)."""

    def __init__(self, size: int, width: int, rngs: nnx.Rngs, dtype):
        self.kernel = nnx.Param(_normal(rngs.params(), (size, size, 3, width)))
        self.bias = nnx.Param(jnp.zeros(width))
        self.size, self.dtype = size, dtype

    def __call__(self, image: jax.Array) -> jax.Array:
        """[B, H, W, 3] -> [B, H W / size^2, D], row-major."""
        items, height, width, channels = image.shape
        p = self.size
        patches = image.reshape(items, height // p, p, width // p, p, channels)
        patches = patches.transpose(0, 1, 3, 2, 4, 5).reshape(items, -1, p * p * channels)
        kernel = self.kernel[...].astype(self.dtype).reshape(p * p * channels, -1)
        return patches.astype(self.dtype) @ kernel + self.bias[...].astype(self.dtype)


class Attention(nnx.Module):
    """Self-attention under DINOv2's names."""

    def __init__(self, width: int, heads: int, rngs: nnx.Rngs, kernel: Kernel, dtype):
        self.heads = heads
        self.kernel: Kernel = kernel
        self.qkv = linear(width, 3 * width, rngs, init=_normal, dtype=dtype)
        self.proj = linear(width, width, rngs, init=_normal, dtype=dtype)

    def __call__(self, x: jax.Array) -> jax.Array:
        """x [B, L, D]."""
        q, k, v = jnp.split(self.qkv(x).reshape(*x.shape[:2], 3 * self.heads, -1), 3, axis=2)
        return self.proj(attend(q, k, v, kernel=self.kernel).reshape(x.shape))


class Perceptron(nnx.Module):
    """Linear, exact GELU, Linear."""

    def __init__(self, width: int, ratio: float, rngs: nnx.Rngs, dtype):
        self.fc1 = linear(width, round(width * ratio), rngs, init=_normal, dtype=dtype)
        self.fc2 = linear(round(width * ratio), width, rngs, init=_normal, dtype=dtype)

    def __call__(self, x: jax.Array) -> jax.Array:
        return self.fc2(jax.nn.gelu(self.fc1(x), approximate=False))


class LayerScale(nnx.Module):
    def __init__(self, width: int):
        self.gamma = nnx.Param(jnp.ones(width))

    def __call__(self, x: jax.Array) -> jax.Array:
        return x * self.gamma[...].astype(x.dtype)


class Block(nnx.Module):
    """x += ls1 * attn(LN(x)); x += ls2 * mlp(LN(x))."""

    def __init__(self, c: ImageEncoderConfig, rngs: nnx.Rngs, kernel: Kernel, dtype):
        self.norm1, self.norm2 = LayerNorm(c.width), LayerNorm(c.width)
        self.attn = Attention(c.width, c.num_heads, rngs, kernel, dtype)
        self.ls1, self.ls2 = LayerScale(c.width), LayerScale(c.width)
        self.mlp = Perceptron(c.width, c.mlp_ratio, rngs, dtype)

    def __call__(self, x: jax.Array) -> jax.Array:
        x = x + self.ls1(self.attn(self.norm1(x)))
        return x + self.ls2(self.mlp(self.norm2(x)))


class DINOv2(nnx.Module):
    """image -> tokens (TRELLIS's condition) and patches. Methods: ``features``, ``final_norm``."""

    def __init__(self, config: ModelConfig, rngs: nnx.Rngs):
        self.scan_blocks, self.remat = config.scan_blocks, config.remat
        c, dtype = config.image_encoder, compute_dtype(config)
        self.patch, self.side, self.registers = (
            c.patch_size,
            c.image_size // c.patch_size,
            c.registers,
        )
        self.cls_token = nnx.Param(_normal(rngs.params(), (1, 1, c.width)))
        self.pos_embed = nnx.Param(_normal(rngs.params(), (1, 1 + self.side**2, c.width)))
        self.register_tokens = nnx.Param(_normal(rngs.params(), (1, c.registers, c.width)))
        self.mask_token = nnx.Param(jnp.zeros((1, c.width)))
        self.patch_embed = nnx.Dict(proj=PatchProjection(c.patch_size, c.width, rngs, dtype))
        self.blocks = nnx.List([Block(c, rngs, config.kernel, dtype) for _ in range(c.num_blocks)])
        self.norm = LayerNorm(c.width)

    def __call__(self, image: jax.Array) -> dict[str, jax.Array]:
        """Encode images.

        Args:
          image: [B, H, W, 3] sRGB in [0, 1], the background black; sides are multiples of the patch
            size.

        Returns:
          tokens [B, 1 + registers + h w, D], TRELLIS's condition; patches [B, h, w, D], before any
          norm.
        """
        items, height, width = image.shape[:3]
        x = self.features((image - jnp.array(IMAGE_MEAN)) / jnp.array(IMAGE_STD))
        patches = x[:, 1 + self.registers :]
        shape = (items, height // self.patch, width // self.patch, -1)
        return {"tokens": layer_norm(x, 1e-5), "patches": patches.reshape(shape)}

    def features(self, image: jax.Array, masks: jax.Array | None = None) -> jax.Array:
        """What DINOv2 calls x_prenorm.

        Args:
          image: [B, H, W, 3], of ImageNet's mean and deviation.
          masks: [B, h w] bool, patches to be replaced by the mask token.

        Returns:
          [B, 1 + registers + h w, D] float32: cls, registers, patches (row-major).

        Raises:
          ValueError: a side is not a multiple of the patch size.
        """
        items, height, width = image.shape[:3]
        if height % self.patch or width % self.patch:
            raise ValueError(
                f"DINOv2: image sides must be multiples of {self.patch}, not {height} x {width}"
            )
        x = self.patch_embed["proj"](image)
        if masks is not None:
            x = jnp.where(masks[..., None], self.mask_token[...].astype(x.dtype), x)
        first, places = self.position_table(height // self.patch, width // self.patch)
        x = x + places.astype(x.dtype)
        front = jnp.concatenate([self.cls_token[...] + first, self.register_tokens[...]], 1)
        front = jnp.broadcast_to(front, (items, *front.shape[1:])).astype(x.dtype)
        x = jnp.concatenate([front, x], 1)
        x = run_stack(
            self.blocks, lambda block, _, x: block(x), x, scan=self.scan_blocks, remat=self.remat
        )
        return x.astype(jnp.float32)

    def final_norm(self, x: jax.Array) -> jax.Array:
        """DINOv2's own normalised tokens ("x_norm") of what ``features`` gave; same shape."""
        return self.norm(x)

    def position_table(self, rows: int, columns: int) -> tuple[jax.Array, jax.Array]:
        """Positions of the cls token [1, 1, D] and of h x w patches [1, h w, D]: bicubic,
        antialiased, as PyTorch's."""
        table = self.pos_embed[...]
        first, places = table[:, :1], table[:, 1:]
        if (rows, columns) != (self.side, self.side):
            grid = places.reshape(1, self.side, self.side, -1)
            shape = (1, rows, columns, grid.shape[-1])
            places = jax.image.resize(grid, shape, "cubic", antialias=True)
        return first, places.reshape(1, rows * columns, -1)

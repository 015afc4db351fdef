"""Stages of a small convolutional image backbone that is trained from scratch."""

from __future__ import annotations

from typing import Any

import jax
from flax import nnx


class StemStage(nnx.Module):
    """Makes the picture ``stride`` times smaller: a strided convolution that overlaps, then a
    residual pair."""

    def __init__(self, inputs: int, outputs: int, stride: int, rngs: nnx.Rngs, dtype):
        options: dict[str, Any] = {"dtype": dtype, "rngs": rngs}
        kernel, pad = (2 * stride, stride // 2) if stride > 2 else (3, 1)
        around = ((pad, pad), (pad, pad))
        self.down = nnx.Conv(
            inputs, outputs, (kernel, kernel), strides=stride, padding=around, **options
        )
        self.conv1 = nnx.Conv(outputs, outputs, (3, 3), padding=1, **options)
        self.conv2 = nnx.Conv(outputs, outputs, (3, 3), padding=1, **options)

    def __call__(self, x: jax.Array) -> jax.Array:
        """[B, H, W, C] -> [B, H / stride, W / stride, C']."""
        x = jax.nn.gelu(self.down(x))
        return x + self.conv2(jax.nn.gelu(self.conv1(x)))

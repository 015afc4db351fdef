"""Convolutions over dense and sparse voxels, channels last, as gathers and matrix products (XLA's own 3D convolution is slow on CPU).

All are cross-correlations, as PyTorch's and spconv's. Dense kernels are [kx, ky, kz, Cin, Cout]; submanifold kernels [27, Cin, Cout].
"""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx

from uniart_jax.nn.gathers import take_rows


def conv3(x: jax.Array, kernel: jax.Array) -> jax.Array:
    """3^3 convolution with zero padding 1. x [B, X, Y, Z, C], kernel [3, 3, 3, C, C'] -> [B, X, Y, Z, C']."""
    items, a, b, c, channels = x.shape
    padded = jnp.pad(x, ((0, 0), (1, 1), (1, 1), (1, 1), (0, 0)))
    # nine shifts side by side and three products: a third of im2col's memory
    columns = jnp.concatenate(
        [padded[:, :, j : j + b, k : k + c] for j in range(3) for k in range(3)], -1
    )
    flat = kernel.reshape(3, 9 * channels, -1)
    out = sum(columns[:, i : i + a].reshape(-1, 9 * channels) @ flat[i] for i in range(3))
    return out.reshape(items, a, b, c, -1)


class Conv3d(nnx.Module):
    """3^3 convolution, padding 1. Initialised as PyTorch's, or zero."""

    def __init__(
        self, inputs: int, outputs: int, rngs: nnx.Rngs, *, zero: bool = False, dtype=jnp.float32
    ):
        shape = (3, 3, 3, inputs, outputs)
        self.kernel = nnx.Param(_torch_uniform(rngs, shape, inputs * 27, zero))
        self.bias = nnx.Param(_torch_uniform(rngs, (outputs,), inputs * 27, zero))
        self.dtype = dtype

    def __call__(self, x: jax.Array) -> jax.Array:
        return conv3(x.astype(self.dtype), self.kernel[...].astype(self.dtype)) + self.bias[
            ...
        ].astype(self.dtype)


class Halve(nnx.Module):
    """2^3 convolution of stride 2: TRELLIS's DownsampleBlock3d."""

    def __init__(self, inputs: int, outputs: int, rngs: nnx.Rngs, *, dtype=jnp.float32):
        self.kernel = nnx.Param(_torch_uniform(rngs, (2, 2, 2, inputs, outputs), inputs * 8, False))
        self.bias = nnx.Param(_torch_uniform(rngs, (outputs,), inputs * 8, False))
        self.dtype = dtype

    def __call__(self, x: jax.Array) -> jax.Array:
        kernel = self.kernel[...].astype(self.dtype)
        out = space_to_depth(x.astype(self.dtype), 2) @ kernel.reshape(-1, kernel.shape[-1])
        return out + self.bias[...].astype(self.dtype)


def space_to_depth(x: jax.Array, factor: int) -> jax.Array:
    """[B, f X, f Y, f Z, C] -> [B, X, Y, Z, f^3 C], positions before channels."""
    items, a, b, c, channels = x.shape
    f = factor
    x = x.reshape(items, a // f, f, b // f, f, c // f, f, channels).transpose(
        0, 1, 3, 5, 2, 4, 6, 7
    )
    return x.reshape(items, a // f, b // f, c // f, f**3 * channels)


def depth_to_space(x: jax.Array, factor: int) -> jax.Array:
    """[B, X, Y, Z, C f^3] -> [B, f X, f Y, f Z, C], channels before positions: TRELLIS's pixel_shuffle_3d."""
    items, a, b, c, channels = x.shape
    f = factor
    x = x.reshape(items, a, b, c, channels // f**3, f, f, f).transpose(0, 1, 5, 2, 6, 3, 7, 4)
    return x.reshape(items, a * f, b * f, c * f, channels // f**3)


@jax.custom_vjp
def gather_neighbors(rows: jax.Array, neighbors: jax.Array) -> jax.Array:
    """rows [T, C] at neighbors [T, 27] -> [T, 27, C]; zero where there is none.

    ``neighbors`` must be symmetric, as ``plan_neighbors`` makes it: if q is p's neighbour at tap k, p is q's at 26 - k. So the
    gradient is a gather as well.
    """
    return take_rows(rows, neighbors)


def _gather_forward(rows, neighbors):
    return take_rows(rows, neighbors), neighbors


def _gather_backward(neighbors, gradient):
    return sum_taps(gradient, neighbors[:, ::-1]), None


gather_neighbors.defvjp(_gather_forward, _gather_backward)


@jax.custom_vjp
def sum_taps(products: jax.Array, neighbors: jax.Array) -> jax.Array:
    """sum over k of products[neighbors[p, k], k]: [T, 27, C] at [T, 27] -> [T, C]. ``gather_neighbors`` transposed; same symmetry."""
    tokens, taps, channels = products.shape
    flat = products.reshape(tokens * taps, channels)
    index = neighbors * taps + np.arange(taps, dtype=np.int32)
    return take_rows(flat, jnp.where(neighbors < tokens, index, tokens * taps)).sum(1)


def _sum_taps_forward(products, neighbors):
    return sum_taps(products, neighbors), neighbors


def _sum_taps_backward(neighbors, gradient):
    return take_rows(gradient, neighbors[:, ::-1]), None


sum_taps.defvjp(_sum_taps_forward, _sum_taps_backward)


class SubmanifoldConv(nnx.Module):
    """3^3 convolution at the active voxels only. Initialised as spconv's (Kaiming uniform, a = sqrt 5), or zero."""

    def __init__(
        self, inputs: int, outputs: int, rngs: nnx.Rngs, *, zero: bool = False, dtype=jnp.float32
    ):
        self.kernel = nnx.Param(_torch_uniform(rngs, (27, inputs, outputs), inputs * 27, zero))
        self.bias = nnx.Param(_torch_uniform(rngs, (outputs,), inputs * 27, zero))
        self.dtype = dtype

    def __call__(self, x: jax.Array, neighbors: jax.Array) -> jax.Array:
        """x [B, V, C], neighbors [B, V, 27] -> [B, V, C']."""
        items, width, channels = x.shape
        kernel = self.kernel[...].astype(self.dtype)
        outputs = kernel.shape[-1]
        rows, taps = x.astype(self.dtype).reshape(-1, channels), neighbors.reshape(-1, 27)
        if outputs < channels:  # multiply first: what is gathered is the narrower of the two
            products = rows @ kernel.swapaxes(0, 1).reshape(channels, 27 * outputs)
            out = sum_taps(products.reshape(-1, 27, outputs), taps)
        else:
            columns = gather_neighbors(rows, taps)
            out = columns.reshape(-1, 27 * channels) @ kernel.reshape(27 * channels, outputs)
        return out.reshape(items, width, outputs) + self.bias[...].astype(self.dtype)


def _torch_uniform(rngs: nnx.Rngs, shape: tuple[int, ...], fan_in: int, zero: bool) -> jax.Array:
    if zero:
        return jnp.zeros(shape)
    bound = 1 / math.sqrt(fan_in)
    return jax.random.uniform(rngs.params(), shape, minval=-bound, maxval=bound)

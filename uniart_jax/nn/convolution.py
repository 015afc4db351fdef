"""Convolutions over dense and sparse voxels, channels last, as gathers and matrix products (XLA's
own 3D convolution is slow on CPU).

All are cross-correlations, as PyTorch's and spconv's. Dense kernels are [kx, ky, kz, Cin, Cout];
submanifold kernels [27, Cin, Cout].
"""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
from flax import nnx

from uniart_jax.nn.gathers import flat_positions, take_rows
from uniart_jax.nn.shard_map import shard_map_items

TAPS = 9  # of 27, worked on at a time


def conv3(x: jax.Array, kernel: jax.Array) -> jax.Array:
    """3^3 convolution with zero padding 1. x [B, X, Y, Z, C], kernel [3, 3, 3, C, C'] -> [B, X, Y,
    Z, C']."""
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
    """[B, X, Y, Z, C f^3] -> [B, f X, f Y, f Z, C], channels before positions: TRELLIS's
    pixel_shuffle_3d."""
    items, a, b, c, channels = x.shape
    f = factor
    x = x.reshape(items, a, b, c, channels // f**3, f, f, f).transpose(0, 1, 5, 2, 6, 3, 7, 4)
    return x.reshape(items, a * f, b * f, c * f, channels // f**3)


def sum_of_taps(rows: jax.Array, kernel: jax.Array, neighbors: jax.Array) -> jax.Array:
    """out[p] = sum over taps k of rows[neighbors[p, k]] kernel[k]: [T, C], [27, C, C'], [T, 27] ->
    [T, C'].

    Nine taps at a time, and the narrower side of the product is what is gathered: no [T, 27, C]
    array exists.
    """
    _, inputs, outputs = kernel.shape

    def taps(total, part):
        weight, near = part
        if outputs < inputs:
            products = rows @ weight.swapaxes(0, 1).reshape(inputs, -1)
            return total + _sum_of(products, near), None
        return total + _side_by_side(rows, near) @ weight.reshape(-1, outputs), None

    start = jnp.zeros((len(rows), outputs), rows.dtype)
    return jax.lax.scan(taps, start, (_grouped(kernel), _grouped(neighbors.T)))[0]


@jax.custom_vjp
def submanifold(rows: jax.Array, kernel: jax.Array, neighbors: jax.Array) -> jax.Array:
    """``sum_of_taps``, with a gradient of its own.

    ``neighbors`` must be symmetric, as ``plan_neighbors`` makes it: if q is p's neighbour at tap k,
    p is q's at 26 - k. So the gradient is gathers as well, and needs no [T, 27, C] array either.
    """
    return sum_of_taps(rows, kernel, neighbors)


def _submanifold_forward(rows, kernel, neighbors):
    return submanifold(rows, kernel, neighbors), (rows, kernel, neighbors)


def _submanifold_backward(saved, gradient):
    rows, kernel, neighbors = saved
    _, inputs, outputs = kernel.shape

    def taps(total, part):
        weight, near, mirrored = part
        if outputs < inputs:
            seen = _side_by_side(gradient, mirrored)
            d_weight = (rows.T @ seen).reshape(inputs, TAPS, outputs).swapaxes(0, 1)
            return total + seen @ weight.swapaxes(1, 2).reshape(-1, inputs), d_weight
        products = gradient @ weight.reshape(-1, outputs).T
        d_weight = _side_by_side(rows, near).T @ gradient
        return total + _sum_of(products, mirrored), d_weight.reshape(TAPS, inputs, outputs)

    parts = [_grouped(x) for x in (kernel, neighbors.T, neighbors.T[::-1])]
    d_rows, d_kernel = jax.lax.scan(taps, jnp.zeros_like(rows), parts)
    return d_rows, d_kernel.reshape(kernel.shape), None


def _grouped(of_taps: jax.Array) -> jax.Array:
    return of_taps.reshape(-1, TAPS, *of_taps.shape[1:])


def _side_by_side(rows: jax.Array, near: jax.Array) -> jax.Array:
    """rows [T, C] at near [taps, T] -> [T, taps C]."""
    return take_rows(rows, near.T).reshape(near.shape[1], -1)


def _sum_of(products: jax.Array, near: jax.Array) -> jax.Array:
    """products [T, taps C], the j-th part of them at near[j] -> [T, C], summed."""
    taps, tokens = near.shape
    flat = products.reshape(len(products) * taps, -1)
    index = near.T * taps + jnp.arange(taps, dtype=near.dtype)
    return take_rows(flat, jnp.where(tokens > near.T, index, len(flat))).sum(1)


submanifold.defvjp(_submanifold_forward, _submanifold_backward)


class SubmanifoldConv(nnx.Module):
    """3^3 convolution at the active voxels only. Initialised as spconv's (Kaiming uniform, a = sqrt
    5), or zero.

    ``plain``: JAX's own derivatives, of every mode (``model.kernel`` 'plain').
    """

    def __init__(
        self,
        inputs: int,
        outputs: int,
        rngs: nnx.Rngs,
        *,
        zero: bool = False,
        plain: bool = False,
        dtype=jnp.float32,
    ):
        self.kernel = nnx.Param(_torch_uniform(rngs, (27, inputs, outputs), inputs * 27, zero))
        self.bias = nnx.Param(_torch_uniform(rngs, (outputs,), inputs * 27, zero))
        self.dtype, self.plain = dtype, plain

    def __call__(self, x: jax.Array, neighbors: jax.Array) -> jax.Array:
        """x [B, V, C], neighbors [B, V, 27] -> [B, V, C']."""

        def convolve(x, neighbors, kernel):
            items, width, channels = x.shape
            near = flat_positions(neighbors, width).reshape(-1, 27)
            taps = sum_of_taps if self.plain else submanifold
            return taps(x.reshape(-1, channels), kernel, near).reshape(items, width, -1)

        kernel = self.kernel[...].astype(self.dtype)
        out = shard_map_items(convolve, (x.astype(self.dtype), neighbors), (kernel,))
        return out + self.bias[...].astype(self.dtype)


def _torch_uniform(rngs: nnx.Rngs, shape: tuple[int, ...], fan_in: int, zero: bool) -> jax.Array:
    if zero:
        return jnp.zeros(shape)
    bound = 1 / math.sqrt(fan_in)
    return jax.random.uniform(rngs.params(), shape, minval=-bound, maxval=bound)

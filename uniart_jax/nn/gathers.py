"""Gathers whose gradients are gathers too (XLA's scatter is slow on CPU), by positions within an
item or a share of a batch."""

from __future__ import annotations

import jax
import jax.numpy as jnp


@jax.custom_vjp
def permute_rows(rows: jax.Array, index: jax.Array, inverse: jax.Array) -> jax.Array:
    """rows[index], zero where the index is out of range, for an index that takes no row twice.

    ``inverse`` undoes it (inverse[index[i]] = i), so that the gradient is a gather by it.
    """
    return take_rows(rows, index)


def take_rows(rows: jax.Array, index: jax.Array) -> jax.Array:
    """rows [T, C] at index [...] -> [..., C]; zero where the index is out of range."""
    return jnp.take(rows, index, axis=0, mode="fill", fill_value=0)


def _permute_forward(rows, index, inverse):
    return take_rows(rows, index), inverse


def _permute_backward(inverse, gradient):
    return take_rows(gradient, inverse), None, None


permute_rows.defvjp(_permute_forward, _permute_backward)


def flat_positions(index: jax.Array, size: int) -> jax.Array:
    """Positions [E, ...] within each of E groups of ``size`` rows -> positions in the E * size rows
    of all; from ``size`` on (none): E * size."""
    groups = index.shape[0]
    if groups == 1:
        return index
    start = jnp.arange(groups, dtype=index.dtype).reshape(-1, *[1] * (index.ndim - 1)) * size
    return jnp.where(index < size, index + start, groups * size)

"""Between levels of a sparse voxel grid by a host plan (``nn.grids.Pool``); all gathers, so gradients need no scatter."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from uniart_jax.nn.convolution import space_to_depth
from uniart_jax.nn.gathers import permute_rows, take_rows
from uniart_jax.nn.grids import FlowPlan, Pool


def to_cells(x: jax.Array, pool: Pool) -> jax.Array:
    """Voxels [B, V, C] -> cells [B, L, f^3, C]; empty slots zero."""
    rows = x.reshape(-1, x.shape[-1])
    return permute_rows(rows, pool.children.reshape(-1), pool.parent.reshape(-1)).reshape(
        *pool.children.shape, -1
    )


def from_cells(cells: jax.Array, pool: Pool) -> jax.Array:
    """Cells [B, L, f^3, C] -> voxels [B, V, C]; padding zero."""
    rows = cells.reshape(-1, cells.shape[-1])
    return permute_rows(rows, pool.parent.reshape(-1), pool.children.reshape(-1)).reshape(
        *pool.parent.shape, -1
    )


def occupied(pool: Pool) -> jax.Array:
    """[B, L, f^3] bool: slots that hold a voxel."""
    return pool.children < pool.parent.size


def downsample(x: jax.Array, pool: Pool) -> jax.Array:
    """Voxels [B, V, C] -> cells [B, L, C]: sum / (n + 1), not the mean. TRELLIS's weights are trained with it (TRELLIS#250)."""
    number = occupied(pool).sum(-1, keepdims=True)
    return to_cells(x, pool).sum(2) / (number + 1).astype(x.dtype)


def upsample(cells: jax.Array, pool: Pool) -> jax.Array:
    """Cells [B, L, C] -> voxels [B, V, C], each a copy of its cell; padding zero."""
    spread = jnp.broadcast_to(cells[:, :, None, :], (*pool.children.shape, cells.shape[-1]))
    return from_cells(spread, pool)


def at_cells(dense: jax.Array, coords: jax.Array) -> jax.Array:
    """Dense features [B, G, G, G, C] at cells [B, L, 3] -> [B, L, C]."""
    items, side, channels = dense.shape[0], dense.shape[1], dense.shape[-1]
    flat = (coords[..., 0] * side + coords[..., 1]) * side + coords[..., 2]
    flat = flat + jnp.arange(items, dtype=flat.dtype)[:, None] * side**3
    return take_rows(dense.reshape(-1, channels), flat)


def align_volume(volume: jax.Array, side: int) -> jax.Array:
    """A volume [B, Rv, Rv, Rv, C] on a grid of ``side``: finer cells are concatenated, coarser ones repeated."""
    if volume.shape[1] >= side:
        return space_to_depth(volume, volume.shape[1] // side)
    for axis in (1, 2, 3):
        volume = jnp.repeat(volume, side // volume.shape[axis], axis)
    return volume


def repeat_plan(plan: FlowPlan, times: int) -> FlowPlan:
    """The plan of a batch in which every item stands ``times`` times in a row (several noise draws, guidance)."""

    def index(values: jax.Array, rows: int) -> jax.Array:
        items = values.shape[0]
        lead = (-1, *[1] * (values.ndim - 1))
        local = values - jnp.arange(items, dtype=values.dtype).reshape(lead) * rows
        start = jnp.arange(items * times, dtype=values.dtype).reshape(lead) * rows
        repeated = jnp.repeat(local, times, axis=0) + start
        missing = jnp.repeat(values >= items * rows, times, axis=0)
        return jnp.where(missing, items * times * rows, repeated)

    pools = tuple(
        Pool(
            jnp.repeat(pool.coords, times, axis=0),
            jnp.repeat(pool.counts, times, axis=0),
            index(pool.children, pool.parent.shape[1]),
            index(pool.parent, pool.children.shape[1] * pool.children.shape[2]),
        )
        for pool in plan.pools
    )
    return FlowPlan(pools, tuple(index(n, n.shape[1]) for n in plan.neighbors))

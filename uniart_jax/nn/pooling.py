"""Between levels of a sparse voxel grid by a host plan (``nn.grids.Pool``); all gathers, so
gradients need no scatter.

``plain``: JAX's own derivatives of the gathers, of every mode (``model.kernel`` 'plain').
"""

from __future__ import annotations

import jax
import jax.numpy as jnp

from uniart_jax.nn.convolution import space_to_depth
from uniart_jax.nn.gathers import flat_positions, permute_rows, take_rows
from uniart_jax.nn.grids import FlowPlan, Pool
from uniart_jax.nn.shard_map import shard_map_items


def to_cells(x: jax.Array, pool: Pool, *, plain: bool = False) -> jax.Array:
    """Voxels [B, V, C] -> cells [B, L, f^3, C]; empty slots zero."""
    permute = _take if plain else _permute
    out = shard_map_items(permute, (x, pool.children.reshape(len(x), -1), pool.parent))
    return out.reshape(*pool.children.shape, -1)


def from_cells(cells: jax.Array, pool: Pool, *, plain: bool = False) -> jax.Array:
    """Cells [B, L, f^3, C] -> voxels [B, V, C]; padding zero."""
    rows, permute = cells.reshape(len(cells), -1, cells.shape[-1]), _take if plain else _permute
    return shard_map_items(permute, (rows, pool.parent, pool.children.reshape(len(cells), -1)))


def _permute(x: jax.Array, index: jax.Array, inverse: jax.Array) -> jax.Array:
    """x [B, V, C] at index [B, W] -> [B, W, C]; ``inverse`` [B, V] undoes it."""
    (items, width, channels), taken = x.shape, index.shape[1]
    index, inverse = flat_positions(index, width), flat_positions(inverse, taken)
    rows = permute_rows(x.reshape(-1, channels), index.reshape(-1), inverse.reshape(-1))
    return rows.reshape(items, taken, channels)


def _take(x: jax.Array, index: jax.Array, inverse: jax.Array) -> jax.Array:
    """As ``_permute``, without a gradient of its own."""
    del inverse
    (items, width, channels), taken = x.shape, index.shape[1]
    rows = take_rows(x.reshape(-1, channels), flat_positions(index, width))
    return rows.reshape(items, taken, channels)


def occupied(pool: Pool) -> jax.Array:
    """[B, L, f^3] bool: slots that hold a voxel."""
    return pool.children < pool.parent.shape[1]


def downsample(x: jax.Array, pool: Pool, *, plain: bool = False) -> jax.Array:
    """Voxels [B, V, C] -> cells [B, L, C]: sum / (n + 1), not the mean. TRELLIS's weights are
    trained with it (TRELLIS#250)."""
    number = occupied(pool).sum(-1, keepdims=True)
    return to_cells(x, pool, plain=plain).sum(2) / (number + 1).astype(x.dtype)


def upsample(cells: jax.Array, pool: Pool, *, plain: bool = False) -> jax.Array:
    """Cells [B, L, C] -> voxels [B, V, C], each a copy of its cell; padding zero."""
    spread = jnp.broadcast_to(cells[:, :, None, :], (*pool.children.shape, cells.shape[-1]))
    return from_cells(spread, pool, plain=plain)


def at_cells(dense: jax.Array, coords: jax.Array) -> jax.Array:
    """Dense features [B, G, G, G, C] at cells [B, L, 3] -> [B, L, C]."""
    items, side, channels = dense.shape[0], dense.shape[1], dense.shape[-1]
    index = (coords[..., 0] * side + coords[..., 1]) * side + coords[..., 2]

    def take(rows, index):
        return take_rows(rows.reshape(-1, channels), flat_positions(index, side**3))

    return shard_map_items(take, (dense.reshape(items, -1, channels), index))


def align_volume(volume: jax.Array, side: int) -> jax.Array:
    """A volume [B, Rv, Rv, Rv, C] on a grid of ``side``: finer cells are concatenated, coarser ones
    repeated."""
    if volume.shape[1] >= side:
        return space_to_depth(volume, volume.shape[1] // side)
    for axis in (1, 2, 3):
        volume = jnp.repeat(volume, side // volume.shape[axis], axis)
    return volume


def repeat_plan(plan: FlowPlan, times: int) -> FlowPlan:
    """The plan of a batch in which every item stands ``times`` times in a row (several noise draws,
    guidance)."""
    return jax.tree.map(lambda a: jnp.repeat(a, times, axis=0), plan)

"""What voxels, or cells of voxels, see of a layout: how far inside each part they lie, whose they
may be, what those parts are.

    candidates          the ``NEAREST`` parts of a cell: those whose box holds it, the smallest first, then the nearest
    of a candidate k    distances to the six faces of its box, and to the nearest of them       14 numbers
                        hidden_k = relu(Linear(distances) + Linear(token of part k))
    whose is the cell?  weights = softmax over candidates (and none) of a learned score
    features            weighted means of hidden, distances and the parts' tokens; maximum of hidden;
                        for the first ``DEEP`` candidates, how far each of the cell's children lies
                        inside the box

A box's face within a cell so is known to a fraction of a child, which is what a closed, flat
surface needs. With no part at all (``counts`` 0) only the learned "none" is left, the same
everywhere.
"""  # noqa: E501

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
from flax import nnx

from uniart_jax.nn.blocks import linear
from uniart_jax.voxels.joint_code import CODE_CHANNELS
from uniart_jax.voxels.part_table import PartTable

HIDDEN, TOKEN = 32, 64
GEOMETRY = 14
NEAREST, DEEP = 4, 2
MARGIN = 0.25  # cells by which a box may miss what it holds
AWAY = 100.0  # how much 1 of distance counts against 1 of volume, object units
REACH = 3.0  # children beyond which a depth says no more
ENTRIES = CODE_CHANNELS + 3  # of a row: its code and boxes, and its colour
NOT = -1e4


class LayoutFeatures(nnx.Module):
    """PartTable, cells -> features [B, S, ``width``].

    ``children``: a side of a cell (sub-cells of a voxel, voxels of a cell).
    """

    def __init__(self, children: int, rngs: nnx.Rngs, dtype=jnp.float32):
        self.children, self.dtype = children, dtype
        self.token1 = linear(ENTRIES, TOKEN, rngs, dtype=dtype)
        self.token2 = linear(TOKEN, TOKEN, rngs, dtype=dtype)
        self.geometry = linear(GEOMETRY, HIDDEN, rngs, dtype=dtype)
        self.of_part = linear(TOKEN, HIDDEN, rngs, dtype=dtype)
        self.score = linear(HIDDEN, 1, rngs, dtype=dtype)
        self.none = nnx.Param(jnp.full(1, -3.0))

    @property
    def width(self) -> int:
        return 2 * HIDDEN + GEOMETRY + TOKEN + DEEP * self.children**3

    def __call__(self, table: PartTable, coords: jax.Array, resolution: int) -> jax.Array:
        """Features of cells ``coords`` [B, S, 3] of a grid of ``resolution`` cells a side."""
        return self.read_features(table, coords, resolution)[0]

    def read_features(
        self, table: PartTable, coords: jax.Array, resolution: int
    ) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Features, and of the candidates: their rows [B, S, N, K] one-hot (zero where there are
        fewer), and how deep each child lies in each [B, S, N, children^3] (``child_depth``)."""
        lower = table.boxes[..., :3] - table.boxes[..., 3:] / 2
        upper = table.boxes[..., :3] + table.boxes[..., 3:] / 2
        at = (coords + 0.5) / resolution - 0.5
        picks = candidates(table, lower, upper, at, resolution)  # [B, S, N, K]
        there = picks.sum(-1) > 0
        take = lambda rows: jnp.einsum("bsnk,bkd->bsnd", picks, rows)  # noqa: E731
        low = (at[..., None, :] - take(lower)) * resolution
        high = (take(upper) - at[..., None, :]) * resolution
        inside = jnp.minimum(low, high).min(-1, keepdims=True)  # [B, S, N, 1]
        distances = jnp.concatenate(
            [
                jnp.clip(low, -2, 2),
                jnp.clip(high, -2, 2),
                jnp.tanh(low / 8),
                jnp.tanh(high / 8),
                jnp.tanh(inside / 3),
                jnp.tanh(inside / 12),
            ],
            -1,
        )
        tokens = self.tokens(table)
        hidden = jax.nn.relu(self.geometry(distances) + take(self.of_part(tokens)))
        score = self.score(hidden)[..., 0].astype(jnp.float32) + jnp.minimum(inside[..., 0], 0) / 2
        none = jnp.broadcast_to(self.none[...], (*score.shape[:2], 1))
        scores = jnp.concatenate([jnp.where(there, score, NOT), none], -1)
        weights = jax.nn.softmax(scores, -1)[..., :-1]
        mean = jnp.einsum("bsn,bsnc->bsc", weights, jnp.concatenate([hidden, distances], -1))
        most = jnp.where(there[..., None], hidden, 0).max(2)
        token = jnp.einsum("bsn,bsnk,bkc->bsc", weights, picks, tokens)
        depth = child_depth(low, high, self.children)
        depth = jnp.where(there[..., None], depth, -1.0)
        deep = depth[:, :, :DEEP].reshape(*depth.shape[:2], -1)
        features = jnp.concatenate([mean, token, most, deep], -1).astype(self.dtype)
        return features, picks, depth

    def tokens(self, table: PartTable) -> jax.Array:
        """[B, K, TOKEN] one of each row: its box, joint, parent's box and colour."""
        parent = jnp.take_along_axis(table.boxes, table.parents[..., None], 1, mode="clip")
        rows = [table.boxes * 2, table.codes, parent * 2, table.colors]
        return self.token2(jax.nn.gelu(self.token1(jnp.concatenate(rows, -1))))


def candidates(
    table: PartTable, lower: jax.Array, upper: jax.Array, at: jax.Array, resolution: int
) -> jax.Array:
    """[B, S, NEAREST, K] one-hot rows of the table for places ``at`` [B, S, 3], best first; all
    zero where there are no more."""
    valid = jnp.arange(lower.shape[1]) < table.counts[:, None]

    def within(axis: int) -> jax.Array:
        x = at[..., axis, None]
        return jnp.minimum(x - lower[:, None, :, axis], upper[:, None, :, axis] - x)

    inside = functools.reduce(jnp.minimum, map(within, range(3)))  # one at a time: small arrays
    key = jnp.minimum(inside + MARGIN / resolution, 0) * AWAY
    key = key - jnp.prod(upper - lower, -1)[:, None]
    left = jnp.where(valid[:, None], key, -jnp.inf)
    picks = []
    for _ in range(NEAREST):
        best = jax.nn.one_hot(left.argmax(-1), left.shape[-1]) * jnp.isfinite(left)
        picks.append(best)
        left = jnp.where(best > 0, -jnp.inf, left)
    return jnp.stack(picks, 2)


def child_depth(low: jax.Array, high: jax.Array, children: int) -> jax.Array:
    """[..., r^3] how far a cell's children lie inside a box, in children over ``REACH``, within
    +-1; x-major.

    Args:
      low, high: [..., 3] the cell's centre from the box's lower and to its upper faces, in cells.
    """
    centre = (jnp.arange(children) + 0.5) / children - 0.5
    axis = jnp.minimum(low[..., None] + centre, high[..., None] - centre) * children
    x, y, z = (axis[..., i, :] for i in range(3))
    depth = jnp.minimum(x[..., :, None, None], y[..., None, :, None])
    depth = jnp.minimum(depth, z[..., None, None, :])
    return jnp.clip(depth.reshape(*low.shape[:-1], -1), -REACH, REACH) / REACH

"""Exact nearest-neighbour distances between point sets, jitted, on any backend: what Chamfer
distance and F-score are made of.

Points are sorted along a Hilbert curve and cut into blocks of ``BLOCK``. A block of queries q
visits blocks of targets t in the order of (1) and stops at the first that cannot hold anything
nearer than (2): branch and bound, float32, no n x m matrix.

    bound(q, t) = squared distance between the two blocks' boxes                                                                 (1)
    worst(q)    = largest squared distance that a query of q has so far                                                          (2)

The Hilbert curve has no jumps, so its blocks are compact: half as many visits as along a Morton
curve (measured on surfaces). Sets are padded to powers of two, so few programs are compiled; what
stands in the padding is never read.

A CPU takes the blocks one after another, an accelerator ``TOGETHER`` at once, until the slowest of
them is done. There is one road for all platforms: beside ``scipy.spatial.cKDTree`` on a CPU it is
of the same order, quicker for sets that are far apart (docs/benchmarks.md).

Curve: J. Skilling, Programming the Hilbert curve (2004).
"""  # noqa: E501

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

BLOCK = 64
TOGETHER = 512
SMALLEST = 4096  # points; all smaller sets share one program
_VISITS = 16  # target blocks sorted at a time
# of the curve's grid, an axis: a part that flew off a thousand lengths leaves 64 cells for the rest
_BITS = 16


def nearest_distances(a: ArrayLike, b: ArrayLike) -> np.ndarray:
    """Distance of every point of ``a`` from the nearest point of ``b``.

    Args:
      a: [..., n, 3], b: [..., m, 3] points; leading axes are pairs of sets and equal.

    Returns:
      [..., n] float32.

    Raises:
      ValueError: an empty set, other shapes, or a coordinate that is not finite.
    """
    return mutual_distances(a, b)[0]


def mutual_distances(a: ArrayLike, b: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Nearest distances both ways, side by side: ([..., n] of ``a`` from ``b``, [..., m] of ``b``
    from ``a``); see ``nearest_distances``."""
    a, b = _points(a), _points(b)
    if a.shape[:-2] != b.shape[:-2]:
        raise ValueError(f"nearest: sets come in pairs, got shapes {a.shape} and {b.shape}")
    together = 1 if jax.default_backend() == "cpu" else TOGETHER
    n, m = a.shape[-2], b.shape[-2]
    flat = [_padded(p.reshape(-1, *p.shape[-2:])) for p in (a, b)]
    there, back = _mutual(flat[0], n, flat[1], m, together=together)
    return (
        np.asarray(there)[:, :n].reshape(a.shape[:-1]),
        np.asarray(back)[:, :m].reshape(b.shape[:-1]),
    )


def chamfer(a: ArrayLike, b: ArrayLike) -> np.ndarray:
    """[...] mean of the two directions' mean nearest distances (not squared) between [..., n, 3]
    and [..., m, 3]."""
    return chamfer_of(*mutual_distances(a, b))


def f_score(a: ArrayLike, b: ArrayLike, threshold: float) -> np.ndarray:
    """[...] harmonic mean of the two shares of points with a neighbour within ``threshold``; 0
    where there is none."""
    return f_score_of(*mutual_distances(a, b), threshold)


def chamfer_of(there: np.ndarray, back: np.ndarray) -> np.ndarray:
    """``chamfer`` of what ``mutual_distances`` returns."""
    return (there.mean(-1, dtype=np.float64) + back.mean(-1, dtype=np.float64)) / 2


def f_score_of(there: np.ndarray, back: np.ndarray, threshold: float) -> np.ndarray:
    """``f_score`` of what ``mutual_distances`` returns."""
    precision, recall = (there <= threshold).mean(-1), (back <= threshold).mean(-1)
    return 2 * precision * recall / np.maximum(precision + recall, 1e-12)


def posed_points(points: ArrayLike, part: ArrayLike, motions: ArrayLike) -> np.ndarray:
    """Points of an object at several states.

    Args:
      points: [n, 3] at the shown state. part: [n] the part that carries each. motions: [S, K, 4, 4]
        from the shown state to each state.

    Returns:
      [S, n, 3] float32.
    """
    motions = np.asarray(motions, np.float32)
    parts = 1 << max(3, (motions.shape[1] - 1).bit_length())  # few programs are compiled
    motions = np.pad(motions, ((0, 0), (0, parts - motions.shape[1]), (0, 0), (0, 0)))
    return np.asarray(_posed(np.asarray(points, np.float32), np.asarray(part, np.int32), motions))


@jax.jit
def _posed(points: jax.Array, part: jax.Array, motions: jax.Array) -> jax.Array:
    def at_state(motion):
        turn, shift = motion[part, :3, :3], motion[part, :3, 3]
        return (turn * points[:, None, :]).sum(-1) + shift

    return jax.vmap(at_state)(motions)


def _points(points: ArrayLike) -> np.ndarray:
    points = np.asarray(points, np.float32)
    if points.ndim < 2 or points.shape[-1] != 3 or points.shape[-2] == 0:
        raise ValueError(f"nearest: expected points [..., n, 3] with n > 0, got {points.shape}")
    if not np.isfinite(points).all():
        raise ValueError("nearest: a coordinate is not finite; repair the mesh or its joints first")
    return points


def _padded(points: np.ndarray) -> np.ndarray:
    size = max(SMALLEST, 1 << (points.shape[1] - 1).bit_length())
    return np.pad(points, ((0, 0), (0, size - points.shape[1]), (0, 0)))


@functools.partial(jax.jit, static_argnames="together")
def _mutual(a: jax.Array, n: ArrayLike, b: jax.Array, m: ArrayLike, *, together: int):
    """Both directions for pairs a [S, N, 3], b [S, M, 3], of which the first n and m points count.

    Pairs come one after another: each keeps a device busy, and side by side all would wait for the
    slowest block.
    """

    def pair(sets):
        first, second = _blocks(sets[0], n), _blocks(sets[1], m)
        return _search(first, second, together), _search(second, first, together)

    return jax.lax.map(pair, (a, b))


def _blocks(points: jax.Array, count: ArrayLike):
    """Points [N, 3] along the curve, the first ``count`` of them, the rest copies of the last.

    Returns:
      (order [N], blocks [N / BLOCK, 3, BLOCK], lower and upper corners [N / BLOCK, 3]).
    """
    place = jnp.arange(len(points))
    points = jnp.where((place < count)[:, None], points, points[0])
    low = points.min(0)
    side = jnp.maximum((points.max(0) - low).max(), jnp.finfo(points.dtype).tiny)
    cell = jnp.clip((points - low) / side * 2**_BITS, 0, 2**_BITS - 1).astype(jnp.uint32)
    coarse, fine = _hilbert(cell)
    coarse = jnp.where(place < count, coarse, jnp.uint32(0xFFFFFFFF))
    order = jax.lax.sort((coarse, fine, place), num_keys=2)[2]
    blocks = points[order][jnp.minimum(place, count - 1)]
    blocks = blocks.reshape(-1, BLOCK, 3).transpose(0, 2, 1)
    counts = (place[::BLOCK] < count)[:, None]  # blocks of padding alone are nowhere
    low = jnp.where(counts, blocks.min(2), jnp.inf)
    high = jnp.where(counts, blocks.max(2), -jnp.inf)
    return order, blocks, low, high


def _hilbert(cell: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Place of cells [N, 3] on the Hilbert curve: ([N], [N]) uint32, the coarse and the fine half
    of its bits (Skilling, section 4)."""

    def below(k):  # all bits below the one of step k
        return (jnp.uint32(1) << (_BITS - 1 - k).astype(jnp.uint32)) - 1

    def turn(k, x):
        """A set bit turns the octants below it over, a clear one swaps two axes."""
        mask = below(k)
        for i in range(3):
            on = (x[i] & (mask + 1)) != 0
            swap = jnp.where(on, 0, (x[0] ^ x[i]) & mask)
            x[0] = x[0] ^ jnp.where(on, mask, swap)
            x[i] = x[i] ^ swap if i else x[i]
        return x

    x = jax.lax.fori_loop(0, _BITS - 1, turn, [cell[:, i] for i in range(3)])
    x[1] = x[1] ^ x[0]
    x[2] = x[2] ^ x[1]

    def flip_below(k, flip):
        return flip ^ jnp.where((x[2] & (below(k) + 1)) != 0, below(k), 0)

    flip = jax.lax.fori_loop(0, _BITS - 1, flip_below, jnp.zeros_like(x[0]))
    x = [axis ^ flip for axis in x]
    half = _BITS // 2
    return _interleaved([a >> half for a in x]), _interleaved([a & ((1 << half) - 1) for a in x])


def _interleaved(x: list[jax.Array]) -> jax.Array:
    """Bits of three numbers below 2^10 in turn, the first number's highest."""
    code = jnp.zeros_like(x[0])
    for axis, bits in enumerate(x):
        for shift, mask in ((16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249)):
            bits = (bits | (bits << shift)) & mask
        code = code | (bits << (2 - axis))
    return code


def _search(queries, targets, together: int) -> jax.Array:
    """[N] distance of each query from the nearest target, in the queries' first order; rubbish for
    padding."""
    order, blocks, low, high = queries
    _, others, other_low, other_high = targets
    visits = min(_VISITS, len(others))

    def search(query):
        block, low, high = query

        def worth(state):
            best, bounds = state
            return bounds.min() < best.max()

        def visit_nearest(state):
            best, bounds = state
            near, index = jax.lax.top_k(-bounds, visits)

            def worth_one(state):
                best, k = state
                return (k < visits) & (-near[jnp.minimum(k, visits - 1)] < best.max())

            def visit(state):
                best, k = state
                return jnp.minimum(best, _squared(block, others[index[k]])), k + 1

            best, _ = jax.lax.while_loop(worth_one, visit, (best, 0))
            return best, bounds.at[index].set(jnp.inf)

        gap = jnp.maximum(jnp.maximum(other_low - high, low - other_high), 0)
        bounds = (gap * gap).sum(1)
        start = jnp.full(BLOCK, jnp.inf, block.dtype)
        return jax.lax.while_loop(worth, visit_nearest, (start, bounds))[0]

    group = together if together > 1 else None
    best = jax.lax.map(search, (blocks, low, high), batch_size=group)
    return jnp.zeros(order.shape, blocks.dtype).at[order].set(jnp.sqrt(best.reshape(-1)))


def _squared(queries: jax.Array, targets: jax.Array) -> jax.Array:
    """[BLOCK] squared distance of each query from the nearest target; coordinates [3, BLOCK].

    Differences, not the expanded square: points that coincide are at 0.
    """
    gap = queries[:, :, None] - targets[:, None, :]
    return (gap * gap).sum(0).min(1)

"""Nearest-neighbour distances between point sets, by a KD tree (``scipy.spatial.cKDTree``): what
Chamfer distance and F-score are made of. Points count in float32."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree


def mutual_distances(a: ArrayLike, b: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Distance of every point of ``a`` from the nearest one of ``b``, and of ``b`` from ``a``.

    Args:
      a: [..., n, 3], b: [..., m, 3] points; leading axes are pairs of sets and equal.

    Returns:
      [..., n] and [..., m] float32.

    Raises:
      ValueError: an empty set, other shapes, or a coordinate that is not finite.
    """
    a, b = _points(a), _points(b)
    if a.shape[:-2] != b.shape[:-2]:
        raise ValueError(f"nearest: sets come in pairs, got shapes {a.shape} and {b.shape}")
    there, back = np.zeros(a.shape[:-1], np.float32), np.zeros(b.shape[:-1], np.float32)
    for i in np.ndindex(a.shape[:-2]):
        there[i] = cKDTree(b[i]).query(a[i])[0]
        back[i] = cKDTree(a[i]).query(b[i])[0]
    return there, back


def chamfer(a: ArrayLike, b: ArrayLike) -> np.ndarray:
    """[...] mean of the two directions' mean nearest distances (not squared) between [..., n, 3]
    and [..., m, 3]."""
    return chamfer_of(*mutual_distances(a, b))


def chamfer_of(there: np.ndarray, back: np.ndarray) -> np.ndarray:
    """``chamfer`` of what ``mutual_distances`` returns."""
    return (there.mean(-1, dtype=np.float64) + back.mean(-1, dtype=np.float64)) / 2


def f_score_of(there: np.ndarray, back: np.ndarray, threshold: float) -> np.ndarray:
    """[...] harmonic mean of the two shares of points with a neighbour within ``threshold``, of
    what ``mutual_distances`` returns; 0 where there is none."""
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
    motions = np.asarray(motions, np.float32)[:, np.asarray(part)]  # [S, n, 4, 4]
    turned = np.einsum("snij,nj->sni", motions[..., :3, :3], np.asarray(points, np.float32))
    return turned + motions[..., :3, 3]


def _points(points: ArrayLike) -> np.ndarray:
    points = np.asarray(points, np.float32)
    if points.ndim < 2 or points.shape[-1] != 3 or points.shape[-2] == 0:
        raise ValueError(f"nearest: expected points [..., n, 3] with n > 0, got {points.shape}")
    if not np.isfinite(points).all():
        raise ValueError("nearest: a coordinate is not finite; repair the mesh or its joints first")
    return points

"""Which part does every sub-cell belong to? Clustering of the per-sub-cell ``own_box``; the number of parts is not given."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.spatial import cKDTree

from uniart_jax.voxels.grid import VoxelGrid, subcell_centers
from uniart_jax.voxels.joint_code import SAME_BOX, box_corners

RADIUS = 0.06  # L-infinity on box corners
MOST = 64  # parts; more distinct boxes than this are noise
MANY = 4 * MOST
MIXED = 0.03  # a voxel whose sub-cell votes differ by more than this lies on a border between parts and does not vote


@dataclasses.dataclass(frozen=True)
class Segmentation:
    """Parts of a grid, largest first.

    Attributes:
      boxes: [K, 6] centre and size voted for by each part's sub-cells.
      owner: [V, r^3] int16 part of every sub-cell.
      pure: [V] bool, all sub-cells of the voxel belong to one part.
    """

    boxes: np.ndarray
    owner: np.ndarray
    pure: np.ndarray


def segment(grid: VoxelGrid) -> Segmentation:
    """Cluster sub-cells into parts by the box each says it belongs to. Deterministic.

    Raises:
      ValueError: the grid is empty.
    """
    if len(grid.coords) == 0:
        raise ValueError("assemble: the voxel grid is empty; nothing was generated")
    votes = np.nan_to_num(box_corners(grid.own_box)).astype(np.float32)
    flat = votes.reshape(-1, 6)
    centers = _exact_centers(flat)
    if centers is None:
        centers = _density_peaks(grid, votes)
    owner = nearest(flat, centers)
    order = np.argsort(-np.bincount(owner, minlength=len(centers)), kind="stable")
    rank = np.argsort(order)
    centers, owner = centers[order], rank[owner].reshape(votes.shape[:2]).astype(np.int16)
    low, high = centers[:, :3], centers[:, 3:]
    boxes = np.concatenate([(low + high) / 2, high - low], -1)
    return Segmentation(boxes, owner, (owner == owner[:, :1]).all(1))


def nearest(votes: np.ndarray, centers: np.ndarray) -> np.ndarray:
    """[n] index of the nearest center (L-infinity on box corners) for votes [n, 6]."""
    best = np.zeros(len(votes), np.int64)
    smallest = np.full(len(votes), np.inf, np.float32)
    for k, center in enumerate(centers.astype(np.float32)):
        distance = np.abs(votes - center).max(1)
        closer = distance < smallest
        best[closer] = k
        smallest[closer] = distance[closer]
    return best


def _exact_centers(flat: np.ndarray) -> np.ndarray | None:
    """Distinct boxes if there are few, as on true codes; None on votes with noise."""
    keys = np.round(flat / 1e-4).astype(np.int64)
    _, first = np.unique(keys, axis=0, return_index=True)
    if len(first) > MANY:
        return None
    distinct = flat[np.sort(first)]
    kept: list[np.ndarray] = []
    for box in distinct:
        if all(np.abs(box - other).max() >= SAME_BOX / 2 for other in kept):
            kept.append(box)
    return np.stack(kept).astype(np.float64) if len(kept) <= MOST else None


def _density_peaks(grid: VoxelGrid, votes: np.ndarray) -> np.ndarray:
    voxel_votes = np.median(votes, axis=1)
    spread = np.abs(votes - voxel_votes[:, None]).max((1, 2))
    voting = spread <= MIXED
    if not voting.any():
        voting[:] = True
    points = voxel_votes[voting]
    positions = subcell_centers(grid.coords, grid.resolution, 1)[voting, 0]
    return points[:1] if len(points) < 2 else _greedy(points, positions, 1 / grid.resolution)


def _greedy(points: np.ndarray, positions: np.ndarray, voxel: float) -> np.ndarray:
    tree = cKDTree(points)
    density = tree.query_ball_point(points, RADIUS, p=np.inf, return_length=True)
    alive = np.ones(len(points), bool)
    centers = []
    for index in np.argsort(-density, kind="stable"):
        if not alive[index]:
            continue
        close = np.abs(points - points[index]).max(1) < RADIUS
        members = close & alive
        center = np.median(points[members], axis=0)
        support = positions[members]
        bounds = np.concatenate([support.min(0) - voxel / 2, support.max(0) + voxel / 2])
        agreement = np.abs(center - bounds).max()
        alive &= ~close
        if not centers or (members.sum() >= 8 and agreement < 0.1):
            centers.append(center)
    return np.stack(centers)

"""The unified voxel representation: active voxels with geometry, appearance, parts and joints on
each.

Grid of R^3 voxels over [-1/2, 1/2]^3; voxel (i, j, k) spans [i, i+1]/R - 1/2 along x, and so on.
Each active voxel is cut into r^3 sub-cells sampled at their centres; sub-cells are ordered x-major,
z fastest: index = (a * r + b) * r + c.

Two forms of the same thing:

* ``PartGrid``: part-valued attributes are ids into a table of parts. What voxelisation makes and
  records hold.
* ``VoxelGrid``: every attribute lies on the voxel itself, no ids. What networks see and predict,
  and what ``assemble`` reads.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy import ndimage

SDF_CLIP = 3.0  # sub-cells
FLATTENED = 0.75  # sub-cells by which smoothing along a surface moves it at most: knobs stay
FACING = 2.0  # sub-cells, deviation of the Gaussian before it is asked which way a surface faces


@dataclasses.dataclass(frozen=True)
class VoxelGrid:
    """Active voxels with attributes; the paper's unified representation.

    Attributes:
      resolution: R.
      subdivisions: r.
      coords: [V, 3] int32 voxel indices, lexicographic order, unique.
      sdf: [V, r^3] float32 truncated signed distance in units of one sub-cell, within +-SDF_CLIP,
        negative inside.
      color: [V, r^3, 3] float32 linear RGB in [0, 1] of the nearest surface point.
      own_box: [V, r^3, 6] float32 centre and size of the part whose surface is nearest to the
        sub-cell.
      joint_code: [V, 9] float32 code of the part that owns most of the voxel's surface.
      parent_box: [V, 6] float32 own box of that part's parent (the root repeats its own).
    """

    resolution: int
    subdivisions: int
    coords: np.ndarray
    sdf: np.ndarray
    color: np.ndarray
    own_box: np.ndarray
    joint_code: np.ndarray
    parent_box: np.ndarray


@dataclasses.dataclass(frozen=True)
class PartGrid:
    """A voxelised object whose part-valued attributes are ids into tables.

    Attributes:
      resolution, subdivisions, coords, sdf, color: as in ``VoxelGrid``.
      owner: [V, r^3] uint8 part id of each sub-cell.
      voxel_part: [V] uint8 part that owns most of the voxel's surface.
      boxes: [K, 6] float32 own box of every part.
      codes: [K, 9] float32 joint code of every part (root: 0).
      parents: [K] int32 parent of every part; the root is its own parent here.
    """

    resolution: int
    subdivisions: int
    coords: np.ndarray
    sdf: np.ndarray
    color: np.ndarray
    owner: np.ndarray
    voxel_part: np.ndarray
    boxes: np.ndarray
    codes: np.ndarray
    parents: np.ndarray

    def gather(self) -> VoxelGrid:
        """The id-free form."""
        return VoxelGrid(
            self.resolution,
            self.subdivisions,
            self.coords,
            self.sdf,
            self.color,
            self.boxes[self.owner].astype(np.float32),
            self.codes[self.voxel_part].astype(np.float32),
            self.boxes[self.parents[self.voxel_part]].astype(np.float32),
        )


def subcell_offsets(subdivisions: int) -> np.ndarray:
    """[r^3, 3] centres of a voxel's sub-cells in units of one voxel, in [0, 1]."""
    return (subcell_indices(np.zeros((1, 3), int), subdivisions)[0] + 0.5) / subdivisions


def subcell_centers(coords: np.ndarray, resolution: int, subdivisions: int) -> np.ndarray:
    """[V, r^3, 3] centres of all sub-cells in object units."""
    return (coords[:, None, :] + subcell_offsets(subdivisions)) / resolution - 0.5


def subcell_indices(coords: np.ndarray, subdivisions: int) -> np.ndarray:
    """[V, r^3, 3] int indices of all sub-cells in the grid of (R r)^3 sub-cells."""
    axis = np.arange(subdivisions)
    offsets = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    return np.asarray(coords)[:, None] * subdivisions + offsets


def occupancy(coords: np.ndarray, resolution: int) -> np.ndarray:
    """[R, R, R] bool, true at the active voxels."""
    dense = np.zeros((resolution,) * 3, bool)
    dense[tuple(np.asarray(coords).T)] = True
    return dense


def connected(dense: np.ndarray) -> np.ndarray:
    """int32 label of every true cell's face-connected piece, from 1 on; 0 elsewhere."""
    labels = np.zeros(dense.shape, np.int32)
    ndimage.label(dense, output=labels)
    return labels


def smoothed(grid: VoxelGrid, offset: float, blur: float, along: float = 0.0) -> VoxelGrid:
    """The grid with distances averaged over active sub-cells by a Gaussian and lowered by
    ``offset``.

    Distances that are not finite stay so, and do not count.

    Args:
      blur: deviation of the Gaussian in sub-cells, in every direction; with ``along``, in that of
        the axis which the surface faces.
      along: deviation in the other two directions, so that flat panels become flat and stay as
        thick as they are; it moves no distance by more than ``FLATTENED``. 0: as ``blur``.
    """
    if not (offset or blur or along):
        return grid
    sdf = np.asarray(grid.sdf, np.float32)
    if blur or along:
        at = tuple(subcell_indices(grid.coords, grid.subdivisions).reshape(-1, 3).T)
        dense = np.zeros((2, *(grid.resolution * grid.subdivisions,) * 3), np.float32)
        known = np.isfinite(sdf).ravel()
        dense[0][at], dense[1][at] = np.where(known, sdf.ravel(), 0), known
        mean = _average(dense, at, blur)
        if along:
            axis = _facing(*dense)[at]
            for facing in range(3):
                flat = _average(dense, at, [blur if k == facing else along for k in range(3)])
                moved = np.clip(flat - mean, -FLATTENED, FLATTENED)
                mean = np.where(axis == facing, mean + moved, mean)
        sdf = np.where(known, mean, np.nan).reshape(sdf.shape).astype(np.float32)
    return dataclasses.replace(grid, sdf=np.clip(sdf - offset, -SDF_CLIP, SDF_CLIP))


def _average(
    dense: np.ndarray, at: tuple[np.ndarray, ...], deviation: float | list[float]
) -> np.ndarray:
    """Weighted means of values and weights [2, n, n, n] at cells, 0 where nothing has weight."""
    total, weight = (_gaussian(values, deviation)[at] for values in dense)
    return total / np.where(weight > 0, weight, 1)


def _gaussian(values: np.ndarray, deviation: float | list[float]) -> np.ndarray:
    return ndimage.gaussian_filter(values, deviation, mode="constant")


def _facing(sdf: np.ndarray, known: np.ndarray) -> np.ndarray:
    """[n, n, n] the axis along which known distances change most, seen from ``FACING``
    sub-cells."""
    coarse = _gaussian(sdf, FACING) / np.maximum(_gaussian(known, FACING), 1e-3)
    return np.stack([np.abs(ndimage.sobel(coarse, axis)) for axis in range(3)]).argmax(0)

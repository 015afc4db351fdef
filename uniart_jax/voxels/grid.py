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
NEAR = 3.0  # sub-cells, deviation of the Gaussian over which that is asked
ROD = 3.0  # sub-cells, deviation of the Gaussian along a rod
# along a rod's surface distances change in two directions: in the second more than so much of the
# change in the first, as mean squares
ROD_CHANGE = 0.2


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


def dilated(cells: np.ndarray) -> np.ndarray:
    """True cells and all around them, diagonally too: ``ndimage.binary_dilation`` by a cube, by a
    pass an axis."""
    wide = np.array(cells, bool)
    for axis in range(wide.ndim):
        ahead, near = np.moveaxis(wide.copy(), axis, 0), np.moveaxis(wide, axis, 0)
        near[1:] |= ahead[:-1]
        near[:-1] |= ahead[1:]
    return wide


def smoothed(grid: VoxelGrid, offset: float, blur: float, along: float = 0.0) -> VoxelGrid:
    """The grid with distances averaged over active sub-cells by a Gaussian and lowered by
    ``offset``.

    Distances that are not finite stay so, and do not count.

    Args:
      blur: deviation of the Gaussian in sub-cells, in every direction; with ``along``, across the
        surface.
      along: deviation in the directions along which the surface does not change, so that what is
        flat becomes flat, and what is long and thin is in one piece: the two along a panel, the one
        along a leg (there ``ROD``). It moves no distance by more than ``FLATTENED``. 0: as
        ``blur``.
    """
    if not (offset or blur or along) or not len(grid.coords):
        return grid
    sdf = np.asarray(grid.sdf, np.float32)
    if blur or along:
        cells = subcell_indices(grid.coords, grid.subdivisions).reshape(-1, 3)
        cells = cells - cells.min(0) + 1  # room around them: beyond, nothing changes either
        at = tuple(cells.T)
        dense = np.zeros((2, *(cells.max(0) + 2)), np.float32)
        known = np.isfinite(sdf).ravel()
        dense[0][at], dense[1][at] = np.where(known, sdf.ravel(), 0), known
        mean = _average(dense, at, blur)
        if along:
            mean = mean + _along(dense, at, mean, blur, along)
        sdf = np.where(known, mean, np.nan).reshape(sdf.shape).astype(np.float32)
    return dataclasses.replace(grid, sdf=np.clip(sdf - offset, -SDF_CLIP, SDF_CLIP))


def _along(
    dense: np.ndarray, at: tuple[np.ndarray, ...], mean: np.ndarray, blur: float, along: float
) -> np.ndarray:
    """How far smoothing along panels and rods moves the ``mean`` of cells."""
    change = _change(*dense)[(slice(None), *at)]
    least, middle, most = np.argsort(change, 0)
    at_axis = lambda axis: np.take_along_axis(change, axis[None], 0)[0]  # noqa: E731
    rod = at_axis(middle) > ROD_CHANGE * at_axis(most)
    moved = np.zeros_like(mean)
    for axis in range(3):
        panel = [blur if k == axis else along for k in range(3)]
        length = [ROD if k == axis else blur for k in range(3)]
        for deviation, chosen in (
            (panel, (most == axis) & ~rod),
            (length, (least == axis) & rod),
        ):
            if chosen.any():
                moved[chosen] = (_average(dense, at, deviation) - mean)[chosen]
    return np.clip(moved, -FLATTENED, FLATTENED)


def _average(
    dense: np.ndarray, at: tuple[np.ndarray, ...], deviation: float | list[float]
) -> np.ndarray:
    """Weighted means of values and weights [2, n, m, l] at cells, 0 where nothing has weight."""
    total, weight = (_gaussian(values, deviation)[at] for values in dense)
    return total / np.where(weight > 0, weight, 1)


def _gaussian(values: np.ndarray, deviation: float | list[float]) -> np.ndarray:
    return ndimage.gaussian_filter(values, deviation, mode="constant")


def _change(sdf: np.ndarray, known: np.ndarray) -> np.ndarray:
    """[3, n, m, l] how much known distances change along each axis, seen from ``FACING`` sub-cells:
    mean squares over ``NEAR`` of them (the diagonal of the structure tensor)."""
    coarse = _gaussian(sdf, FACING) / np.maximum(_gaussian(known, FACING), 1e-3)
    return np.stack([_gaussian(ndimage.sobel(coarse, k) ** 2 * known, NEAR) for k in range(3)])

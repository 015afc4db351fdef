"""Faces that a network draws nearly flat are made flat: of furniture nearly all are, and ripples of a voxel's period are noise.

Each part is looked at along every axis, from both sides, as a height map over the columns of sub-cells. Two kinds of planes:

* near a face of the part's box, where the part comes near it along most of the face: its columns
  there end at one depth, so that edges become straight;
* depths at which many columns end: these columns end there exactly, and small gaps are closed.

Round things keep their shape: their columns end at many depths, and few reach a face of the box.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy import ndimage

from uniart_jax.voxels.isosurface import ZERO, DenseField

REACH = 5.0  # sub-cells from a box's face within which columns end at one depth ...
REACH_SHARE = 0.1  # ... and of the part's size along that axis
COVERED = 0.75  # share of the face's longer side along which the part has to come near it
FLAT = 1.5  # sub-cells from a plane within which columns are of it
SHARP = 0.6  # share of these within a third of ``FLAT``; of round and tilted faces at most a half
PLANE_SHARE = 0.08  # of a part's columns, and
PLANE_COLUMNS = 48  # so many, that make a plane
RIPPLE = 13  # sub-cells a side, of the neighbourhood whose median says what plane a column is of
PLANES = 4  # at most, of each side
GAP = 2  # sub-cells: gaps in a plane of twice so many are closed
KEPT = 0.5  # share of a part's cells below which it is left as it was
HOLE = 100  # columns; an enclosed hole in a plane of no more is closed
DENT = 10  # sub-cells; a gap that is no deeper is filled to its ground
THICKNESS = 2  # sub-cells of what closes deeper ones


def with_flat_faces(field: DenseField, boxes: np.ndarray) -> DenseField:
    """A field whose parts' nearly flat faces are flat.

    Args:
      boxes: [K, 6] centre and size of each part, object units.

    Returns:
      A new field. No cell that is solid in another part is taken from it.
    """
    sdf, owner, source = field.sdf.copy(), field.owner.copy(), field.source.copy()
    cells = sdf.shape[0] - 2
    for part, (centre, size) in enumerate(zip(boxes[:, :3], boxes[:, 3:], strict=True)):
        lower, upper = ((c + 0.5) * cells + 0.5 for c in (centre - size / 2, centre + size / 2))
        low = np.clip(np.floor(lower - 1).astype(int), 0, cells)
        high = np.clip(np.ceil(upper + 1).astype(int), 1, cells + 1)
        window = tuple(slice(a, b + 1) for a, b in zip(low, high, strict=True))
        views = (sdf[window], owner[window], source[window])
        before = tuple(view.copy() for view in views)
        for axis in np.argsort(-size):
            for side in (1, -1):
                face = lower[axis] - low[axis] if side > 0 else high[axis] - upper[axis]
                turned = tuple(np.moveaxis(v, axis, 0)[::side] for v in views)
                _reach_face(turned, part, float(face), np.delete(size, axis) * cells)
        for axis in range(3):
            for side in (1, -1):
                turned = tuple(np.moveaxis(v, axis, 0)[::side] for v in views)
                _flatten(turned, part)
                _flatten(tuple(v[len(v) // 2 :] for v in turned), part)  # seen from within
        solid = ((views[0] < 0) & (views[1] == part)).sum()
        if solid < KEPT * ((before[0] < 0) & (before[1] == part)).sum():
            for view, old in zip(views, before, strict=True):
                view[...] = old
    sdf[np.abs(sdf) < ZERO] = -ZERO
    return dataclasses.replace(field, sdf=sdf, owner=owner, source=source)


def heights(sdf: np.ndarray, solid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where columns along the first axis of ``sdf`` [D, U, V] enter ``solid``: first cell [U, V], D
    where there is none, and the place between cells where the distance is zero [U, V]."""
    first = np.where(solid.any(0), solid.argmax(0), len(solid))
    inside = np.take_along_axis(sdf, np.minimum(first, len(sdf) - 1)[None], 0)[0]
    outside = np.take_along_axis(sdf, np.clip(first - 1, 0, None)[None], 0)[0]
    step = np.where((outside > 0) & (inside < 0), inside / np.minimum(inside - outside, -1e-6), 0.5)
    return first, first - np.clip(step, 0, 1)


def _reach_face(views, part: int, face: float, sides: np.ndarray) -> None:
    """In place: where the part comes near the box's face along most of it, its columns end at one depth, the median's."""
    sdf, owner, _ = views
    mine = (sdf < 0) & (owner == part)
    first, height = heights(sdf, mine)
    depth = len(sdf) - 2 * face  # about the part's size along this axis, sub-cells
    reach = min(REACH, REACH_SHARE * depth)
    near = (first < len(sdf)) & (height <= face + reach)
    if not near.any():
        return
    rows, columns = (np.flatnonzero(near.any(k)) for k in (1, 0))
    along = rows if sides[0] >= sides[1] else columns
    if along[-1] - along[0] + 1 < COVERED * max(sides):
        return
    plane = float(np.median(height[near]))
    near = (first < len(sdf)) & (height <= plane + reach)
    # teeth between columns that come near enough are no detail
    near |= _closed(near) & (first < len(sdf)) & (height <= plane + 2 * reach)
    _end_at(views, part, near, plane)


def _flatten(views, part: int) -> None:
    """In place: columns that end at nearly the same depth as many others end there exactly."""
    sdf, owner, _ = views
    mine = (sdf < 0) & (owner == part)
    first, height = heights(sdf, mine)
    there = (first > 0) & (first < len(sdf))
    sides = [min(RIPPLE, side // 4 | 1) for side in height.shape]  # less of what is small
    around = ndimage.median_filter(height, sides, mode="nearest")
    least = max(PLANE_COLUMNS, PLANE_SHARE * there.sum())
    left = there.copy()
    for _ in range(PLANES):
        if left.sum() < least:
            return
        depths = np.sort(around[left])
        # the depth with most columns around it
        many = np.searchsorted(depths, depths + 0.5) - np.searchsorted(depths, depths - 0.5)
        middle = depths[many.argmax()]
        near = left & (np.abs(around - middle) <= FLAT)
        on = near & (np.abs(height - middle) <= 2 * FLAT)
        if on.sum() < least or many.max() < SHARP * near.sum():
            return
        plane = float(np.median(height[on]))
        gaps = (_closed(on) | _without_small_holes(on)) & ~on & (first > plane)
        dents = gaps & (first < np.minimum(plane + DENT, len(sdf)))
        _end_at(views, part, on | dents, plane)
        _fill(views, part, gaps & ~dents, plane)
        left &= ~on


def _closed(columns: np.ndarray) -> np.ndarray:
    """[U, V] with gaps of twice ``GAP`` closed."""
    wide = np.ones((2 * GAP + 1,) * 2)
    return ndimage.binary_closing(np.pad(columns, GAP), wide)[GAP:-GAP, GAP:-GAP]


def _without_small_holes(columns: np.ndarray) -> np.ndarray:
    """[U, V] with what is enclosed by them filled, up to ``HOLE`` columns."""
    holes, _ = ndimage.label(ndimage.binary_fill_holes(columns) & ~columns)
    small = np.bincount(holes.ravel()) <= HOLE
    small[0] = False
    return columns | small[holes]


def _end_at(views, part: int, columns: np.ndarray, plane: float) -> None:
    """In place: the part's columns [U, V] end at ``plane``, cells along the first axis."""
    sdf, owner, source = views
    u, v = np.nonzero(columns)
    column = sdf[:, u, v], owner[:, u, v], source[:, u, v]
    mine = (column[0] < 0) & (column[1] == part)
    first = mine.argmax(0)
    index = np.arange(len(sdf))[:, None]
    free = (column[0] > 0) | (column[1] == part)
    # only what is free all the way from the plane to the part
    blocked = (~free & (index >= plane) & (index < first)).any(0)
    inside = (index >= plane) & (index < np.maximum(first, np.ceil(plane) + 1)) & ~blocked
    inside &= free & (mine | (index < first))
    before = (index < plane) & (index >= np.minimum(first, np.floor(plane))) & free & ~blocked
    own = np.take_along_axis(column[2], first[None], 0)
    filled = inside & ~mine
    new = np.where(inside | before, plane - index, column[0])
    sdf[:, u, v] = new
    owner[:, u, v] = np.where(filled, part, column[1])
    source[:, u, v] = np.where(filled & (column[2] < 0), own, column[2])


def _fill(views, part: int, columns: np.ndarray, plane: float) -> None:
    """In place: free cells of columns [U, V] from ``plane`` to ``THICKNESS`` behind it are the part's, coloured as what is nearest."""
    sdf, owner, source = views
    if not columns.any():
        return
    start = int(np.ceil(plane))
    for depth in range(start, min(start + THICKNESS, len(sdf))):
        cells = columns & (sdf[depth] > 0)
        if not cells.any():
            continue
        mine = (sdf[depth] < 0) & (owner[depth] == part)
        if not mine.any():
            continue
        nearest = ndimage.distance_transform_edt(~mine, return_distances=False, return_indices=True)
        source[depth][cells] = source[depth][tuple(nearest)][cells]
        sdf[depth][cells] = plane - depth - 0.5 if depth > start else plane - depth
        owner[depth][cells] = part
    ahead = int(np.ceil(plane)) - 1
    if ahead >= 0:
        cells = columns & (sdf[ahead] > 0)
        sdf[ahead][cells] = np.minimum(sdf[ahead][cells], max(plane - ahead, ZERO))

"""Outer walls made whole: holes that a network leaves where it was not sure of a wall.

Whole voxels are missing then, so that one looks through a hole of straight edges into the object.
A hole in a flat outer face of what does not move is closed where the face is all around it, where
it is small, and where no part moves through it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import trimesh
from scipy import ndimage

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.isosurface import HALF_CELL, DenseField, to_cells
from uniart_jax.voxels.joint_code import box_corners

# lengths in sub-cells, areas in columns of them, of a grid with 128 along its side
OUTER = 8  # from the outermost layer of the body, within which a wall ends
FLAT = 2  # from the wall's plane, within which its columns end
COVERED = 0.4  # share of the body's rectangle that the wall takes at least
DEEP = 4  # behind the wall's plane, from which on a column is a hole's
HOLE = 500  # columns of a hole at most
LEFT = 0.5  # share of them that no part passes through, at least
THROUGH = 0.15  # object units: a smaller part, as a knob, stands before a wall
BESIDE = 2  # around a part's way
THICKNESS = 3  # of what closes a hole


def with_whole_walls(
    field: DenseField, boxes: np.ndarray, joints: Sequence[Joint], body: Sequence[int]
) -> DenseField:
    """A field whose body has no small holes in its outer walls.

    Args:
      boxes: [K, 6] centre and size of the first K parts, object units. joints: theirs, of the shown
        state. body: owners that do not move.

    Returns:
      A new field. Cells of other parts stay as they are.
    """
    solid = (field.sdf < 0) & np.isin(field.owner, body)
    if not solid.any():
        return field
    field = dataclasses.replace(field, sdf=field.sdf.copy(), owner=field.owner.copy())
    mine = int(np.bincount(field.owner[solid]).argmax())
    size = field.sdf.shape[0] - 2
    ways = [
        _way(box, joint, size)
        for part, (box, joint) in enumerate(zip(boxes, joints, strict=True))
        if part not in body
        and joint.type not in ("fixed", "continuous")
        and box[3:].max() > THROUGH
    ]
    window = ndimage.find_objects(solid.astype(np.int8))[0]
    first = np.array([s.start for s in window])
    for axis in range(3):
        for side in (1, -1):
            sdf, owner = (
                np.moveaxis(values[window], axis, 0)[::side] for values in (field.sdf, field.owner)
            )
            moving = [_seen(way, first, sdf.shape, axis, side) for way in ways]
            _close_holes(sdf, owner, body, mine, moving)
    return field


def _way(box: np.ndarray, joint: Joint, size: int) -> np.ndarray:
    """[2, 3] corners, in cells, of what a part's box takes, as shown and on its way."""
    corners = trimesh.bounds.corners(box_corners(box).reshape(2, 3))
    states = (0.0, *joint.limits, *np.linspace(*joint.limits, 5)[1:-1])
    places = np.concatenate([trimesh.transform_points(corners, joint.motion(q)) for q in states])
    cells = to_cells(places, size)
    return np.stack([cells.min(0) - BESIDE, cells.max(0) + BESIDE])


def _seen(
    way: np.ndarray, first: np.ndarray, shape: tuple[int, ...], axis: int, side: int
) -> np.ndarray:
    """[2, 3] a way's corners in the cells of a window that begins at ``first`` and is looked at
    along an axis; the depth first."""
    low, high = way - first
    low, high = (np.concatenate([[end[axis]], np.delete(end, axis)]) for end in (low, high))
    if side < 0:
        low[0], high[0] = shape[0] - 1 - high[0], shape[0] - 1 - low[0]
    return np.stack([low, high])


def _close_holes(
    sdf: np.ndarray,
    owner: np.ndarray,
    body: Sequence[int],
    mine: int,
    ways: Sequence[np.ndarray],
) -> None:
    """In place: the holes of one wall of [D, U, V] cells, seen from outside; ``ways``: [2, 3]
    corners of what parts move through."""
    solid = (sdf < 0) & np.isin(owner, body)
    depth = np.where(solid.any(0), solid.argmax(0), len(solid))
    outer = depth[depth < min(OUTER, len(solid))]
    if not len(outer):
        return
    plane = int(np.median(outer))
    wall = np.abs(depth - plane) <= FLAT
    if wall.mean() < COVERED:
        return
    taken = (sdf[: plane + DEEP] < 0).any(0)  # by the body, or what stands before it
    enclosed = np.asarray(ndimage.binary_fill_holes(wall | taken), bool)
    labels: Any = ndimage.label(enclosed & (depth > plane + DEEP))
    holes, count = labels
    for hole in range(1, count + 1):
        columns = holes == hole
        left = columns & ~np.any([_passes(way, plane, columns.shape) for way in ways], axis=0)
        if columns.sum() > HOLE or left.sum() < LEFT * columns.sum():
            continue
        here = slice(plane, plane + THICKNESS)
        free = left & (sdf[here] > 0)
        sdf[here][free], owner[here][free] = -HALF_CELL, mine


def _passes(way: np.ndarray, plane: int, shape: tuple[int, int]) -> np.ndarray:
    """[U, V] bool: columns of a plane that a part passes through; none where it stays on one side
    of it."""
    (near, *low), (far, *high) = way
    u, v = (
        (np.arange(n) >= a) & (np.arange(n) <= b) & (near <= plane <= far)
        for n, a, b in zip(shape, low, high, strict=True)
    )
    return u[:, None] & v

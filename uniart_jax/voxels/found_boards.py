"""A field whose moving parts are built of the boards that a layout has: doors are plates with a
handle, drawers have a front, sides, a floor and a back.

At the resolution of the voxels they are one to three cells thick, and a structure network draws
them ragged, most of all what a closed front hides.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from scipy import ndimage

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.found_panels import BESIDE, FARTHEST, aligned, distance_to, fitted
from uniart_jax.voxels.isosurface import ZERO, DenseField
from uniart_jax.voxels.ways import opens_to

# lengths in sub-cells, of a grid with 128 along its side
NEAR = 3  # around boards within which a part's drawn cells are explained
EDGE = 3  # from the ends of the body, within which it stays
LEAST = 6  # deep what is looked at of a slider, at least
GAP = 3  # that a board ends before one that it meets, at most
# shares
WITHIN = 0.8  # of the drawn part that is in the box around its boards, at least
COVERED, SHOWN = 0.9, 0.8  # of the outlines of the drawn part and of its boards, near the other
DEEP = 0.3  # of a slider, from its front on, in which its outline is looked at
CRUMBS = 0.3  # of what a drawer encloses that the body has there, at most, if that is to go
FRONT = 0.5  # of a drawer's cross-section that its front takes at least


def with_boards(
    field: DenseField,
    boards: Mapping[int, np.ndarray],
    joints: Sequence[Joint],
    body: Sequence[int],
) -> tuple[DenseField, frozenset[int]]:
    """A field in which parts are their boards, and which parts are.

    Boards are moved to faces that are drawn nearby, and made to meet. They take the place of
    what is drawn of their part and of what the body has there, but for its outer walls; the body
    has nothing within a drawer.

    Args:
      boards: [N, 6] lower and upper corners, object units, of some owners. joints: of all owners.
      body: owners that do not move.

    Returns:
      A new field, and the owners that are built of boards in it. A part stays as it is where less
      than ``WITHIN`` of it lies in the box around its boards, or where their outlines differ, seen
      along the way of a slider, of which the first ``DEEP`` count, or through the plate of another:
      less than ``COVERED`` of what is drawn, or less than ``SHOWN`` of the boards, is near the
      other.
    """
    still = np.isin(field.owner, body)
    cells, size = np.argwhere((field.sdf < 0) & still), field.sdf.shape[0] - 2
    placed, ways = {}, {}
    for k, rows in boards.items():
        solid = (field.sdf < 0) & (field.owner == k)
        if not len(rows) or not solid.any() or not len(cells):
            continue
        slides = joints[k].type == "prismatic"
        ways[k] = opens_to(joints[k], np.argwhere(solid), cells, size) if slides else None
        found = _placed(field, k, solid, rows, ways[k])
        if found is not None:
            placed[k] = found
    if not placed:
        return field, frozenset()
    sdf, owner = field.sdf.copy(), field.owner.copy()
    mine = np.isin(owner, list(placed))
    sdf[mine & (sdf < 0)] = FARTHEST  # what they were drawn as
    solid = sdf < 0
    stays = solid & (~still | _outer(solid & still))
    stays = np.asarray(ndimage.binary_dilation(stays), bool)
    for axis in range(3):  # the layer around the grid stays outside
        np.moveaxis(stays, axis, 0)[[0, -1]] = True
    nearest = np.full(sdf.shape, float(BESIDE), np.float32)
    whose = np.full(sdf.shape, -1, np.int16)
    for k, rows in placed.items():
        distance = distance_to(rows, sdf.shape)
        nearer = distance < nearest
        nearest[nearer], whose[nearer] = distance[nearer], k
        way = ways[k]
        window = None if way is None else _inside(rows, *way)
        if window is not None:
            free = solid[window] & still[window] & ~stays[window]
            if free.mean() < CRUMBS:
                sdf[window] = np.where(free, FARTHEST, sdf[window])
    value = np.clip(nearest, -FARTHEST, FARTHEST)
    value = np.where(np.abs(value) < ZERO, -ZERO, value)
    where = ~stays & (whose >= 0) & ((value < 0) | (sdf > 0))
    sdf[where] = np.where(value < 0, value, np.minimum(value, sdf))[where]
    taken = where & ((value < 0) | (owner < 0) | mine)
    owner[taken] = whose[taken]
    return dataclasses.replace(field, sdf=sdf, owner=owner), frozenset(placed)


def _placed(
    field: DenseField, part: int, solid: np.ndarray, rows: np.ndarray, way: tuple[int, int] | None
) -> np.ndarray | None:
    """[N, 6] a part's boards in cells, where they are drawn; None where it is drawn otherwise.

    solid: [X, Y, Z] what is drawn of it. way: axis and side to which it slides.
    """
    size = len(solid) - 2
    own = np.where(field.owner == part, field.sdf, np.abs(field.sdf))
    placed = fitted(aligned((rows + 0.5) * size + 0.5, solid, own), GAP)
    cells = np.argwhere(solid)
    low, high = placed[:, :3].min(0) - NEAR, placed[:, 3:].max(0) + NEAR
    if ((cells >= low) & (cells <= high)).all(1).mean() < WITHIN:
        return None
    built = distance_to(placed, solid.shape) < 0
    if way is None:
        axis = int(np.ptp(cells, 0).argmin())
    else:
        axis, side = way
        first, last = cells[:, axis].min(), cells[:, axis].max()
        deep = max(round(DEEP * (last + 1 - first)), LEAST)
        layers = slice(max(first - NEAR, 0), first + deep)
        if side > 0:
            layers = slice(max(last + 1 - deep, 0), last + 1 + NEAR)
        solid, built = (np.moveaxis(x, axis, 0)[layers] for x in (solid, built))
        axis = 0
    drawn, built = solid.any(axis), built.any(axis)
    near_drawn, near_built = (
        np.asarray(ndimage.binary_dilation(x, iterations=NEAR), bool) for x in (drawn, built)
    )
    if not built.any() or near_drawn[built].mean() < SHOWN:
        return None
    return placed if near_built[drawn].mean() >= COVERED else None


def _outer(body: np.ndarray) -> np.ndarray:
    """[X, Y, Z] cells of a body within ``EDGE`` of the ends of its box."""
    stays = np.ones_like(body)
    cells = np.argwhere(body)
    if len(cells):
        window = tuple(
            slice(a + EDGE, max(b + 1 - EDGE, a + EDGE))
            for a, b in zip(cells.min(0), cells.max(0), strict=True)
        )
        stays[window] = False
    return stays & body


def _inside(boards: np.ndarray, axis: int, side: int) -> tuple[slice, ...] | None:
    """What boards [N, 6] in cells of a drawer that opens to a side of an axis enclose behind its
    front; None for what has no front, and for what opens upwards."""
    if axis == 2:
        return None
    low, high = boards[:, :3].min(0), boards[:, 3:].max(0)
    sizes = boards[:, 3:] - boards[:, :3]
    across = [a for a in range(3) if a != axis]
    wide = sizes[:, across].prod(1) >= FRONT * (high - low)[across].prod()
    fronts = np.flatnonzero(wide & (sizes.argmin(1) == axis))
    if not len(fronts):
        return None
    front = max(fronts, key=lambda k: side * boards[k, axis])
    if side > 0:
        high[axis] = boards[front, axis]
        tray = boards[boards[:, axis] < high[axis] - 1]
    else:
        low[axis] = boards[front, axis + 3]
        tray = boards[boards[:, axis + 3] > low[axis] + 1]
    if not len(tray):
        return None
    for a in across:
        low[a], high[a] = tray[:, a].min(), tray[:, a + 3].max()
    return tuple(
        slice(int(np.ceil(a)), int(np.floor(b)) + 1) for a, b in zip(low, high, strict=True)
    )

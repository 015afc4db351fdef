"""Round doors, as those of washing machines.

A row of a layout says a door's box, not its shape, and a network that is not sure of the shape
draws a plate whose corners lie a little back. Faces that are made flat would make all of it a
square (``flat_faces``). So a plate whose corners were drawn back is cut to the ellipse in its box,
and what does not move closes around it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.cleanup.align_open_parts import Turn, turn_of
from uniart_jax.voxels.isosurface import HALF_CELL, ZERO, DenseField
from uniart_jax.voxels.opening_direction import center_of

SQUARE = 1.2  # ratio of a round door's sides at most
THIN = 0.35  # of its width, that a door's box is thick at most
WIDE = 0.15  # object units, that a door is wide at least
SHARE = 0.4  # of the width of what does not move, that a door is wide at least
RAGGED = 2  # sub-cells along a face's edges that are not looked at in its corners
CORNER = 1.2  # radius, in half sides, from which on a column is a corner's
RIM = (0.75, 1.0)  # farther from the middle than this along a side, and within this radius
BACK = 2  # sub-cells behind the front, within which a column reaches it
WHOLE = 0.7  # share of the rim's columns that reach it, of round doors at least
DRAWN = 0.8  # of that, the share of the corners' columns that reach it at most
AROUND = 6  # sub-cells around a closed door, where the front of what closes around it is looked for
LIP = 0.88  # radius of its opening
GAP = 4  # sub-cells around a door's box that may be free
WALL = 3  # sub-cells, thickness of what closes around a door
APART = 3  # sub-cells between both: a door turns about a hinge within its thickness


class Disc(NamedTuple):
    """A round door: ``part``, how it is turned, and the place of its ``back`` along the third axis,
    in cells, where it lies straight."""

    part: int
    turn: Turn
    back: float

    @property
    def across(self) -> int:
        """The axis that the plate is thin along, where it lies straight."""
        return 3 - self.turn.axis - self.turn.along

    def radius(self, cells: np.ndarray) -> np.ndarray:
        """[n] distance of cells [n, 3] from the middle, 1 on the ellipse."""
        return np.hypot(*_on_face(cells, self.turn))


def round_doors(
    field: DenseField, boxes: np.ndarray, joints: Sequence[Joint], body: Sequence[int]
) -> list[Disc]:
    """Doors that a network draws round. Upright ones turn about an upright hinge.

    Args:
      field: as the network draws it, before any face is made flat. boxes: [K, 6] centre and size of
        the first K parts, object units. joints: theirs. body: owners that do not move.
    """
    solid = field.sdf < 0
    still = np.argwhere(solid & np.isin(field.owner, body))
    size = field.sdf.shape[0] - 2
    found = []
    for part, (box, joint) in enumerate(zip(boxes, joints, strict=True)):
        cells = np.argwhere(solid & (field.owner == part))
        if joint.type != "revolute" or part in body or not len(cells) or not len(still):
            continue
        turn = turn_of(cells, box, joint, size, True, center_of(still, size))
        if turn is None or not turn.outside:
            continue
        if 2 not in (turn.axis, 3 - turn.axis - turn.along):  # an upright one that falls open
            continue
        beside = np.ptp(still[:, turn.along]) + 1
        wide = turn.ends[1] - turn.ends[0] >= SHARE * beside
        disc = _disc(part, cells, turn, size) if wide else None
        if disc is not None:
            found.append(disc)
    return found


def _disc(part: int, cells: np.ndarray, turn: Turn, size: int) -> Disc | None:
    """A part with ``cells`` [n, 3] as a disc; None where it is none."""
    across = 3 - turn.axis - turn.along
    sides = turn.ends[1] - turn.ends[0], turn.span[1] - turn.span[0]
    if min(sides) < WIDE * size or max(sides) > SQUARE * min(sides):
        return None
    straight = cells @ turn.straight[:3, :3].T + turn.straight[:3, 3]
    # columns of a cell each where it lies straight as shown, of two cells where it is turned
    step = 1 if turn.still else 2
    count = tuple(int(np.ceil(side / step)) for side in sides)
    u, v = (
        np.floor((straight[:, axis] - first) / step).astype(int)
        for axis, first in ((turn.along, turn.ends[0]), (turn.axis, turn.span[0]))
    )
    inside = (u >= 0) & (u < count[0]) & (v >= 0) & (v < count[1])
    height = np.full(count, -np.inf)
    ahead = turn.outside * straight[:, across]
    np.maximum.at(height, (u[inside], v[inside]), ahead[inside])
    x, y = np.meshgrid(*((np.arange(n) + 0.5) / n * 2 - 1 for n in count), indexing="ij")
    farthest, radius = np.maximum(np.abs(x), np.abs(y)), np.hypot(x, y)
    inner = (np.abs(x) < 1 - 2 * RAGGED / sides[0]) & (np.abs(y) < 1 - 2 * RAGGED / sides[1])
    plate = height[(radius < RIM[0]) & np.isfinite(height)]
    corners = (radius > CORNER) & inner
    rim = (farthest > RIM[0]) & (radius < RIM[1])
    if not len(plate) or not corners.any() or not rim.any():
        return None
    front = float(np.median(plate))
    reaches = height >= front - BACK
    whole, back = reaches[rim].mean(), float(np.percentile(ahead, 5))
    flat = front - back <= THIN * min(sides)
    if not flat or whole < WHOLE or reaches[corners].mean() > DRAWN * whole:
        return None
    return Disc(part, turn, turn.outside * back)


def _on_face(cells: np.ndarray, turn: Turn) -> tuple[np.ndarray, np.ndarray]:
    """[n], [n]: places of cells [n, 3] on a door's face, -1 to 1 within its box."""
    straight = cells @ turn.straight[:3, :3].T + turn.straight[:3, 3]
    places = []
    for axis, (low, high) in ((turn.along, turn.ends), (turn.axis, turn.span)):
        places.append((straight[:, axis] - (low + high) / 2) / ((high - low) / 2))
    return places[0], places[1]


def with_round_doors(field: DenseField, body: Sequence[int], discs: Sequence[Disc]) -> DenseField:
    """A field whose round doors are round, closed around by what does not move where they are shown
    closed.

    Args:
      body: owners that do not move. discs: of the same shown state (``round_doors``).

    Returns:
      A new field.
    """
    field = dataclasses.replace(field, sdf=field.sdf.copy(), owner=field.owner.copy())
    for disc in discs:
        cells = np.argwhere(field.owner == disc.part)
        if not len(cells):
            continue
        half = (disc.turn.ends[1] - disc.turn.ends[0]) / 2
        beyond = (disc.radius(cells) - 1) * half
        at = tuple(cells.T)
        cut = np.maximum(field.sdf[at], np.clip(beyond, -3, 3).astype(np.float32))
        field.sdf[at] = np.where(np.abs(cut) < ZERO, -ZERO, cut)
        if disc.turn.still:
            _close_around(field, disc, body)
    return field


def _close_around(field: DenseField, disc: Disc, body: Sequence[int]) -> None:
    """In place: what does not move reaches from its front around a closed door to the door's
    opening."""
    turn, across, side = disc.turn, disc.across, disc.turn.outside
    size = field.sdf.shape[0] - 2
    spans = {turn.along: turn.ends, turn.axis: turn.span}
    window = [slice(1, size + 1)] * 3
    for axis, (low, high) in spans.items():
        first, last = int(np.floor(low)) - AROUND, int(np.ceil(high)) + AROUND + 1
        window[axis] = slice(max(first, 1), max(min(last, size + 1), 1))
    near = tuple(window)
    solid = (field.sdf[near] < 0) & np.isin(field.owner[near], body)
    shape = solid.shape
    places = np.indices(shape).reshape(3, -1).T + [s.start for s in window]
    x, y = (p.reshape(shape) for p in _on_face(places, turn))
    outside = np.maximum(np.abs(x), np.abs(y)).max(across) > 1
    columns = np.moveaxis(solid, across, 0)[::-side]
    met = columns.any(0) & outside
    if not met.any() or not solid.any():
        return
    first = int(np.median(columns.argmax(0)[met]))
    depth = np.arange(shape[across])[::-side]  # from outside inwards
    depth = depth.argsort().reshape([-1 if k == across else 1 for k in range(3)])
    back = side * (window[across].stop - 1 if side > 0 else window[across].start)
    back = round(back - side * disc.back)  # of the door, as deep
    door = (field.sdf[near] < 0) & (field.owner[near] == disc.part)
    apart = ~np.asarray(ndimage.binary_dilation(door, iterations=APART), bool)
    last = max(back + 1, first) + WALL
    wall = (depth >= first) & (depth < last) & (np.hypot(x, y) > LIP)
    for place, (low, high) in zip((x, y), (turn.ends, turn.span), strict=True):
        wall &= np.abs(place) <= 1 + 2 * GAP / (high - low)
    free = (field.sdf[near] > 0) & np.isin(field.owner[near], (-1, disc.part, *body))
    new = wall & free & apart
    mine = np.bincount(field.owner[near][solid]).argmax()
    field.sdf[near][new] = -HALF_CELL
    field.owner[near][new] = mine

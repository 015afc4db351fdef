"""Where doors and drawers close: fronts of drawers are whole, and gaps around doors straight."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import ndimage
from scipy.spatial.transform import Rotation

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.cleanup.align_open_parts import Turn, turn_of
from uniart_jax.voxels.isosurface import HALF_CELL, DenseField, to_cells
from uniart_jax.voxels.opening_direction import ALONG_LATTICE, center_of, closed_end, opens_to

# lengths in sub-cells
STRIP = 0.4  # share of a door's width: doors that overlap by no more are made narrower
APART = 2.0  # between two doors that are closed
RIM = 3  # layers around a closed door that are looked at
MOST = 0.5  # share of a layer's cells that are the body's, where it is all frame
COVERED = 0.5  # share of a drawer's front in which it is drawn at least
SHUT = 0.4  # share of a door's rectangle that it covers or encloses at least, unlike a bail
FRONT = 0.4  # share of it that lies in one plane at least ...
NEAR = 2  # ... within so much ...
AHEAD = 0.4  # ... and no farther in than this share of its depth: a handle may be before it
PLATE = (2, 5)  # thickness of a drawer's front, least and most
THINNEST = 3  # box of a drawer
BEYOND = 4  # around its box, within which what stands out from its edges is cut off
BEHIND = 3  # behind a door, within which ridges of its back end
DRAWN = 0.33  # share of a row of it from which the row belongs to it
WHOLE = 0.9  # share of a door's rectangle in which it is drawn, if it is no round one
LEDGE = 2  # wide and high along its edges, what is no handle
FULL = 0.3  # of the fullest layer of a door's cells, that another of its plate has at least


@dataclasses.dataclass(frozen=True)
class Front:
    """A box of cells that is seen, or left, from one side.

    Attributes:
      axis, side: of the lattice: 1 from larger indices, -1 from smaller ones.
      low, high: [3] first cell, and the one after the last.
    """

    axis: int
    side: int
    low: np.ndarray
    high: np.ndarray

    def seen(self, values: np.ndarray) -> np.ndarray:
        """[D, U, V] view of the box's cells, from that side inwards."""
        window = tuple(slice(a, b) for a, b in zip(self.low, self.high, strict=True))
        return np.moveaxis(values[window], self.axis, 0)[:: -self.side]


class Door(NamedTuple):
    """A part that turns on a hinge along the lattice, and where it lies when it is closed.

    Attributes:
      turn: to where it lies straight. quarter: [4, 4] from there to where it is closed, in cells.
      low, high: [3] of its box when closed, in cells.
    """

    turn: Turn
    quarter: np.ndarray
    low: np.ndarray
    high: np.ndarray


def door_of(
    cells: np.ndarray,
    box: np.ndarray,
    joint: Joint,
    size: int,
    center: np.ndarray,
    corrected: bool = True,
) -> Door | None:
    """A part as a door; None for what is none, or of which voxels and joint do not agree.

    Args:
      cells: [n, 3] of its solid. box: [6] of its row. size: of the grid, cells.
      center: [3] of what it is closed against, object units. corrected: as ``turn_of`` has it.
    """
    turn = turn_of(cells, box, joint, size, corrected, center)
    if turn is None:
        return None
    straight = cells @ turn.straight[:3, :3].T + turn.straight[:3, 3]
    low, high = straight.min(0), straight.max(0)
    across = 3 - turn.axis - turn.along
    low[across], high[across] = _plate(straight[:, across])
    low, high = turn.box(low, high)
    closed = closed_end(joint, cells, center, size) * np.sign(joint.direction[turn.axis])
    angle = closed - Rotation.from_matrix(turn.straight[:3, :3]).as_rotvec()[turn.axis]
    rotation = Rotation.from_rotvec(np.round(2 * angle / np.pi) * np.pi / 2 * np.eye(3)[turn.axis])
    hinge, quarter = to_cells(joint.origin, size), np.eye(4)
    quarter[:3, :3] = np.rint(rotation.as_matrix())
    quarter[:3, 3] = hinge - quarter[:3, :3] @ hinge
    return Door(turn, quarter, *_after(quarter, low, high))


def _plate(places: np.ndarray) -> tuple[int, int]:
    """The first layer of a plate, and the one after its last, of cells at ``places`` [n] through
    it: those around the fullest that are ``FULL`` of it; not a handle, or bins on a door."""
    layers = np.rint(places).astype(int)
    count = np.bincount(layers - layers.min())
    full, most = count >= FULL * count.max(), int(count.argmax())
    first = most - int(np.append(~full[: most + 1][::-1], True).argmax()) + 1
    last = most + int(np.append(~full[most:], True).argmax())
    return first + layers.min(), last + layers.min()


def _after(motion: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A box after a motion by quarter turns."""
    ends = np.stack([low, high]) @ motion[:3, :3].T + motion[:3, 3]
    return ends.min(0), ends.max(0)


def without_overlap(doors: Mapping[int, Door]) -> dict[int, Turn]:
    """Turns of doors, of which those that would touch, or share a strip, when closed are
    narrower."""
    low = {k: door.low.copy() for k, door in doors.items()}
    high = {k: door.high.copy() for k, door in doors.items()}
    for a, b in itertools.combinations(doors, 2):
        shared = np.minimum(high[a], high[b]) - np.maximum(low[a], low[b])
        least = np.maximum(np.minimum(high[a] - low[a], high[b] - low[b]), 1e-6)
        axis = int((shared / least).argmin())
        if np.delete(shared, axis).min() <= 0 or not -APART < shared[axis] <= STRIP * least[axis]:
            continue
        if low[a][axis] + high[a][axis] > low[b][axis] + high[b][axis]:
            a, b = b, a
        middle = (high[a][axis] + low[b][axis]) / 2
        high[a][axis], low[b][axis] = middle - APART / 2, middle + APART / 2
    found = {}
    for k, door in doors.items():
        turn = door.turn
        ends = np.stack(_after(np.linalg.inv(door.quarter), low[k], high[k]), 1)
        span, along = tuple(ends[turn.axis]), tuple(ends[turn.along])
        found[k] = dataclasses.replace(turn, span=span, ends=along)
    return found


def closed_door(cells: np.ndarray, box: np.ndarray, joint: Joint, body: np.ndarray) -> Front | None:
    """Where a door lies when it is closed; None for what is no door, lies aslant, or covers little
    of its rectangle.

    Args:
      cells: [n, 3] of its solid. box: [6] of its row. body: [N, N, N] bool, what does not move.
    """
    size, inside = body.shape[0] - 2, np.argwhere(body)
    if joint.type != "revolute":
        return None
    door = door_of(cells, box, joint, size, center_of(inside, size))
    opening = opens_to(joint, cells, inside, size)
    if door is None or opening is None or opening[0] == door.turn.axis:
        return None
    low, high = (np.clip(np.rint(end).astype(int), 1, size + 1) for end in (door.low, door.high))
    if not (high > low).all():
        return None
    motion = door.quarter @ door.turn.straight
    places = np.rint(cells @ motion[:3, :3].T + motion[:3, 3]).astype(int)
    across = np.delete(np.arange(3), opening[0])
    places = places[((places >= low) & (places <= high))[:, across].all(1)][:, across]
    columns = np.zeros((high - low)[across] + 1, bool)
    columns[tuple((places - low[across]).T)] = True
    covered: Any = ndimage.binary_fill_holes(columns)  # a pane may not be drawn
    return Front(*opening, low, high) if covered.mean() >= SHUT else None


def straighten_rim(field: DenseField, body: Sequence[int], door: Front) -> None:
    """In place: each layer of ``body``'s parts around a closed door is all frame, or all free."""
    there = np.flatnonzero(
        ((field.sdf < 0) & np.isin(field.owner, body)).any(tuple({0, 1, 2} - {door.axis}))
    )
    if not len(there):
        return
    low, high = door.low.copy(), door.high.copy()
    low[door.axis] = max(low[door.axis], there[0])  # not in front of the body
    high[door.axis] = min(high[door.axis], there[-1] + 1)
    for axis in set(range(3)) - {door.axis}:
        first, last = door.low[axis], door.high[axis]
        for at in (*range(first - RIM, first), *range(last, last + RIM)):
            if not 1 <= at < field.sdf.shape[axis] - 1:
                continue
            window = [slice(a, b) for a, b in zip(low, high, strict=True)]
            window[axis] = slice(at, at + 1)
            sdf, owner = field.sdf[tuple(window)], field.owner[tuple(window)]
            solid, mine = sdf < 0, np.isin(owner, body)
            ours = solid & mine
            if ours.sum() > MOST * (~solid | mine).sum():
                owner[~solid] = np.bincount(owner[ours]).argmax()
                sdf[~solid] = -HALF_CELL
            else:
                sdf[ours] = HALF_CELL


def whole_door(field: DenseField, body: Sequence[int], part: int, door: Front) -> None:
    """In place: a door that is shown closed, and is a plate, as a whole one: each of its layers is
    all door where most of it is, and teeth beside these and little ridges behind them go."""
    margin = np.full(3, RIM)
    margin[door.axis] = 0
    low, high = door.low - margin, door.high + margin
    if door.side > 0:
        low[door.axis] -= BEHIND
    else:
        high[door.axis] += BEHIND
    low, high = np.maximum(low, 1), np.minimum(high, field.sdf.shape[0] - 1)
    around = dataclasses.replace(door, low=low, high=high)
    shown, whose = around.seen(field.sdf), around.seen(field.owner)
    solid = (shown < 0) & (whose == part)
    drawn = solid.any(0)
    inner = np.delete(door.high - door.low, door.axis).prod()  # cells of a layer, no margin
    spans = [np.flatnonzero(solid.sum((1, 2)) > MOST * inner)]
    spans += [np.flatnonzero(drawn.mean(across) > DRAWN) for across in (1, 0)]
    if not all(len(span) for span in spans):
        return
    rectangle = tuple(slice(span[0], span[-1] + 1) for span in spans)
    if drawn[rectangle[1:]].mean() < WHOLE:
        return
    last = rectangle[0].stop
    plate = np.zeros_like(solid)
    plate[rectangle] = True
    moving = (shown < 0) & (whose != part) & ~np.isin(whose, body)
    new = plate & ~solid & ~np.asarray(ndimage.binary_dilation(moving), bool)
    shown[new], whose[new] = -HALF_CELL, part
    shown[plate & solid] = np.minimum(shown[plate & solid], -HALF_CELL)
    out = solid & ~plate
    out[: rectangle[0].start] = False  # handles
    out[last:, solid[-1]] = False  # what reaches farther, as shelves on a door do
    shown[out] = HALF_CELL


def drawer_front(
    cells: np.ndarray, box: np.ndarray, joint: Joint, body: np.ndarray
) -> Front | None:
    """The box of a drawer as it is shown, seen from where it opens to; None for what is none.

    Args: as ``closed_door``.
    """
    if joint.type != "prismatic" or np.abs(joint.direction[:2]).max() < ALONG_LATTICE:
        return None
    size = body.shape[0] - 2
    opening = opens_to(joint, cells, np.argwhere(body), size)
    if opening is None:
        return None
    low, high = (to_cells(box[:3] + sign * box[3:] / 2, size) for sign in (-1, 1))
    low, high = np.ceil(low).astype(int), np.floor(high).astype(int) + 1
    low, high = np.clip(low, 1, size + 1), np.clip(high, 1, size + 1)
    return Front(*opening, low, high) if (high - low >= THINNEST).all() else None


def whole_front(
    field: DenseField, body: Sequence[int], part: int, drawer: Front
) -> tuple[int, int]:
    """In place: the front of a drawer as a whole plate where most of it is drawn; what of the body
    lies in it is the drawer's.

    Returns:
      The layers of the box, from its first on, at which the plate begins and ends; 0, 0 where there
      is none.
    """
    shown, whose = drawer.seen(field.sdf), drawer.seen(field.owner)
    solid = (shown < 0) & (whose == part)
    there, first = solid.any(0), solid.argmax(0)
    if there.mean() < COVERED:
        return 0, 0
    plane = int(np.median(first[there]))
    near = there & (np.abs(first - plane) <= NEAR)
    if near.mean() < FRONT or plane > AHEAD * len(solid):
        return 0, 0
    gap = (np.arange(len(solid))[:, None, None] >= first) & ~solid
    back = np.where(gap.any(0), gap.argmax(0), len(solid))
    depth = int(np.clip(np.median((back - first)[near]), *PLATE))
    plate = np.zeros_like(solid)
    plate[plane : plane + depth] = True
    moving = (shown < 0) & (whose != part) & ~np.isin(whose, body)
    new = plate & ~solid & ~np.asarray(ndimage.binary_dilation(moving), bool)
    shown[new], whose[new] = -HALF_CELL, part
    mine = whose == part
    shown[plate & mine] = np.minimum(shown[plate & mine], -HALF_CELL)
    edge = np.asarray(ndimage.binary_dilation(plate), bool) & ~plate & mine & (shown > 0)
    shown[edge] = np.maximum(shown[edge], HALF_CELL)
    _trim(field, part, drawer, plane, depth)
    return plane, plane + depth


def _trim(field: DenseField, part: int, drawer: Front, plane: int, depth: int) -> None:
    """In place: nothing of a drawer stands out from the edges of its plate, which begins at layer
    ``plane`` of its box."""
    limit = np.array(field.sdf.shape) - 1
    low, high = np.maximum(drawer.low - BEYOND, 1), np.minimum(drawer.high + BEYOND, limit)
    around = Front(drawer.axis, drawer.side, low, high)
    shown, whose = around.seen(field.sdf), around.seen(field.owner)
    ahead = drawer.low - low if drawer.side < 0 else high - drawer.high
    first = int(ahead[drawer.axis]) + plane
    plate = np.ones(shown.shape[1:], bool)
    across = np.delete(np.arange(3), drawer.axis)
    plate[tuple(slice(a, b) for a, b in zip(*_within(drawer, low, across), strict=True))] = False
    inner = np.asarray(ndimage.binary_erosion(~plate, iterations=LEDGE), bool)
    mine = (whose == part) & (shown < 0)
    out = mine & plate
    out[first + depth :] = False
    ledge = mine & ~inner & ~plate
    ledge[first:] = False
    high_ones = ledge[: max(first - LEDGE, 0)].any(0)  # of a handle
    shown[out | (ledge & ~high_ones)] = HALF_CELL


def _within(front: Front, first: np.ndarray, across: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[2], [2]: a front's first cells across, and those after its last, in a window that begins at
    ``first``."""
    return (front.low - first)[across], (front.high - first)[across]

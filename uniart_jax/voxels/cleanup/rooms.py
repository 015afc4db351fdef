"""Rooms behind doors and in drawers, made of flat walls.

A network draws what a closed door hides as the mean of all that could be there: walls with lumps,
crumbs in the middle, ragged rims. What can be told of it is how wide, high and deep the room is,
and whether a shelf goes through it. So each room becomes a box: its walls lie where most lines
meet them, a layer across it that is mostly solid becomes a whole shelf, and all else in it goes.
Round rooms, and what hardly is a room, stay as they are.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.cleanup.column_maps import corners
from uniart_jax.voxels.cleanup.frames import with_flat_frames
from uniart_jax.voxels.cleanup.fronts import (
    Front,
    closed_door,
    drawer_front,
    straighten_rim,
    whole_door,
    whole_front,
)
from uniart_jax.voxels.isosurface import HALF_CELL, DenseField
from uniart_jax.voxels.opening_direction import center_of, closed_end

# lengths in sub-cells
LIP = 6  # behind its door, within which a room has to begin
BESIDE = 2  # around a door: between two there is a gap
LEAST = 6  # deep, wide and high
FREE = 0.6  # share of a room's cells that are free at least
OPEN = 0.5  # share of a layer across it that is free at least, as deep as it goes
INNER = 0.15  # of the opening's sides, that its depth is not looked for at
WALL = 0.35  # of the opening, that a wall at its side takes at most
MOST = 0.5  # share of a side's lines that meet a wall, where there is one; of a shelf's cells
SHELF = 0.35  # share of a layer that is solid, where there is a shelf, and of its lines
THICKNESS = 2  # of walls where they have gaps
BENT = 3.0  # that a straight wall's ends reach in farther than its middle at most
ENCLOSED = 3  # walls, from which on what they enclose is a room
KEPT = 0.5  # share of a part's cells below which all is left as it was: racks are all gaps
CORNER = 0.12  # of the sides: a round room does not reach so far into its corners
# from its closed end, from which on a door (radians) or a drawer (object units) is not shown closed
AJAR, PULLED = 0.05, 0.01
RIM = 3  # layers of what a door closes against
TRIM = 1.0  # percent of a drawer's cells that are not looked at, at either end


def with_clean_rooms(
    field: DenseField,
    boxes: np.ndarray,
    joints: Sequence[Joint],
    parents: Sequence[int],
    body: Sequence[int],
) -> DenseField:
    """A field in which doors and drawers close straight, what they close are rooms with flat walls,
    and the frames around them are flat (``frames``).

    Args:
      field: of the shown state, owners are parts; flat outside (``flat_faces``).
      boxes: [K, 6] centre and size of the first K parts, object units. joints: theirs. parents: of
        all. body: parts that do not move, of all: what hangs on one that voxels do not show may
        close a room too.

    Returns:
      A new field.
    """
    field = dataclasses.replace(field, sdf=field.sdf.copy(), owner=field.owner.copy())
    fronts: list[Front] = []
    for k in range(len(boxes)):
        held = (field.sdf < 0) & np.isin(field.owner, body)
        cells = np.argwhere((field.sdf < 0) & (field.owner == k))
        if k in body or parents[k] not in body or not len(cells) or not held.any():
            continue
        before = field.sdf.copy(), field.owner.copy()
        drawer = drawer_front(cells, boxes[k], joints[k], held)
        if drawer is not None:
            plate = whole_front(field, body, k, drawer)
            _clean(field, [k], _from_above(cells, drawer, plate[1]), ends=True)
            if plate[1] and _is_closed(joints[k], cells, held):
                fronts.append(_layers(drawer, *plate))
                straighten_rim(field, body, fronts[-1])
                _clean(field, body, _behind(fronts[-1], held))
        door = closed_door(cells, boxes[k], joints[k], held)
        if door is not None:
            if _is_closed(joints[k], cells, held):
                whole_door(field, body, k, door)
            fronts.append(door)
            straighten_rim(field, body, door)
            _clean(field, body, _behind(door, held))
        after = field.sdf < 0
        own = after[tuple(cells.T)] & (field.owner[tuple(cells.T)] == k)
        rest = after & held & np.isin(field.owner, body)
        if own.sum() < KEPT * len(cells) or rest.sum() < KEPT * held.sum():
            field.sdf[:], field.owner[:] = before
    with_flat_frames(field, body, fronts)
    return field


def _is_closed(joint: Joint, cells: np.ndarray, body: np.ndarray) -> bool:
    """Whether a part of ``cells`` [n, 3] is shown closed against ``body`` [X, Y, Z]."""
    size = body.shape[0] - 2
    away = abs(closed_end(joint, cells, center_of(np.argwhere(body), size), size))
    return away < (PULLED if joint.type == "prismatic" else AJAR)


def _layers(box: Front, first: int, last: int) -> Front:
    """Some layers of a box, counted from where it is seen."""
    low, high = box.low.copy(), box.high.copy()
    if box.side > 0:
        low[box.axis], high[box.axis] = high[box.axis] - last, high[box.axis] - first
    else:
        low[box.axis], high[box.axis] = low[box.axis] + first, low[box.axis] + last
    return Front(box.axis, box.side, low, high)


def _from_above(cells: np.ndarray, front: Front, depth: int) -> Front:
    """What of a drawer is open to above: all behind its front, which is ``depth`` thick."""
    low, high = np.percentile(cells, [TRIM, 100 - TRIM], axis=0)
    low, high = np.floor(low).astype(int), np.ceil(high).astype(int) + 1
    if depth and front.side > 0:
        high[front.axis] = front.high[front.axis] - depth
    elif depth:
        low[front.axis] = front.low[front.axis] + depth
    return Front(2, 1, low, high)


def _behind(door: Front, body: np.ndarray) -> Front:
    """What a closed door covers of the body behind it."""
    axis, inside = door.axis, np.argwhere(body)
    first, last = inside.min(0), inside.max(0) + 1
    low, high = np.maximum(door.low - BESIDE, first), np.minimum(door.high + BESIDE, last)
    if door.side > 0:
        low[axis], high[axis] = first[axis], min(door.low[axis], last[axis])
    else:
        low[axis], high[axis] = max(door.high[axis], first[axis]), last[axis]
    return Front(axis, door.side, low, high)


class _Room(NamedTuple):
    """A room in cells [D, U, V] that are seen from its opening.

    Attributes:
      depth: of it. ends: ((u0, u1), (v0, v1)): first cell, and the one after the last.
      walls: whether there is one at either end of both.
    """

    depth: int
    ends: tuple[tuple[int, int], tuple[int, int]]
    walls: tuple[tuple[bool, bool], tuple[bool, bool]]


def _clean(field: DenseField, parts: Sequence[int], opening: Front, ends: bool = False) -> None:
    """In place: the room of ``parts`` behind an opening as a box with flat walls; ``ends``: it has
    one opposite to its opening, as a drawer has a floor."""
    if (opening.high - opening.low < LEAST).any():
        return
    shown, whose = opening.seen(field.sdf), opening.seen(field.owner)
    mine = np.isin(whose, parts)
    solid, others = (shown < 0) & mine, (shown < 0) & ~mine
    room = _room(solid)
    if room is None or not solid.any():
        return
    walls = sum(there for pair in room.walls for there in pair)
    if walls < ENCLOSED and not _encloses(_outline(field, parts, opening), room):
        return
    if ends:
        room = room._replace(depth=min(room.depth, len(solid) - THICKNESS))
    fill, clear = _walls(solid, room)
    if ends:
        _straight_tops(solid, room, fill, clear)
    else:
        _flat_rim(solid, room, fill, clear)
    fill &= (shown > 0) & ~np.asarray(ndimage.binary_dilation(others), bool)
    # so that the walls lie between the cells
    edge = np.asarray(ndimage.binary_dilation(clear | fill), bool) & solid & ~clear
    shown[edge] = np.minimum(shown[edge], -HALF_CELL)
    shown[clear] = HALF_CELL
    whose[fill] = np.bincount(whose[solid]).argmax()
    shown[fill] = -HALF_CELL


def _walls(solid: np.ndarray, room: _Room) -> tuple[np.ndarray, np.ndarray]:
    """Cells [D, U, V] that walls and shelves of a room have, and those that are to be free."""
    depth, (u, v), _ = room
    inside = (slice(0, depth), slice(*u), slice(*v))
    inner = solid[inside]
    shelves = _shelves(inner)
    outer = [slice(0, depth + THICKNESS)]
    for (first, last), (wall, other) in zip((u, v), room.walls, strict=True):
        outer.append(slice(max(first - THICKNESS * wall, 0), last + THICKNESS * other))
    fill, clear = np.zeros_like(solid), np.zeros_like(solid)
    fill[tuple(outer)] = True
    fill[inside] = False
    ring = fill[:depth].sum((1, 2))
    begun = (fill & solid)[:depth].sum((1, 2)) > MOST * np.maximum(ring, 1)
    fill[: int(begun.argmax())] = False  # not in front of the walls
    fill[inside] = shelves
    clear[inside] = ~shelves
    return fill, clear & solid


def _straight_tops(solid: np.ndarray, room: _Room, fill: np.ndarray, clear: np.ndarray) -> None:
    """In place: walls of a drawer [D, U, V] are whole from the first layer on of which most is
    drawn, and nothing is above it."""
    for axis, (ends, walls) in enumerate(zip(room.ends, room.walls, strict=True)):
        across = 2 - axis
        span = room.ends[1 - axis]
        for far, there in enumerate(walls):
            # [D, outwards, along] views from the room's end on
            views = [np.moveaxis(v, across, 2) for v in (solid, fill, clear)]
            views = [v[:, ends[1] :] if far else v[:, : ends[0]][:, ::-1] for v in views]
            shown, filled, free = (v[: room.depth, :, slice(*span)] for v in views)
            drawn = shown.mean((0, 2)) > MOST
            thick = int(np.append(~drawn, True).argmax())
            if not there or not thick:
                continue
            whole = shown[:, :thick].mean((1, 2)) > MOST
            top = int(whole.argmax()) if whole.any() else room.depth
            filled[top:, :thick] = True
            free[:top] |= shown[:top]
            filled[:top] = False


def _flat_rim(solid: np.ndarray, room: _Room, fill: np.ndarray, clear: np.ndarray) -> None:
    """In place: what a door closes against begins in one layer of [D, U, V] cells, has the outline
    that it has ``RIM`` layers farther in, and no gaps."""
    first = int(fill.any((1, 2)).argmax())
    if first >= LIP or first + 2 * RIM > room.depth:
        return
    inside = np.zeros(solid.shape[1:], bool)
    inside[tuple(slice(*ends) for ends in room.ends)] = True
    outline = ((solid | fill) & ~clear)[first + RIM] & ~inside
    outline = np.asarray(ndimage.binary_fill_holes(outline | inside), bool) & ~inside
    drawn = (solid[:first] & outline).sum((1, 2)) > MOST * outline.sum()
    start = int(np.append(drawn, True).argmax())
    rim = slice(start, first + RIM)
    fill[rim] = (fill[rim] & inside) | outline
    clear[rim] = (clear[rim] & inside) | (solid[rim] & ~outline & ~inside)
    clear[:start] |= solid[:start]


def _shelves(inner: np.ndarray) -> np.ndarray:
    """Cells [D, U, V] of a room that whole shelves and dividers hold: layers across it of which
    enough is solid, within the rectangle that it is solid in."""
    shelves = np.zeros_like(inner)
    for axis in (1, 2):
        layers, whole = np.moveaxis(inner, axis, 0), np.moveaxis(shelves, axis, 0)
        for k in np.flatnonzero(layers.mean((1, 2)) > SHELF):
            rows, columns = (np.flatnonzero(layers[k].mean(a) > SHELF) for a in (1, 0))
            if not len(rows) or not len(columns):
                continue
            place = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
            if layers[k][place].mean() > MOST:
                whole[k][place] = True
    return shelves


def _room(solid: np.ndarray) -> _Room | None:
    """The room in cells [D, U, V], seen from its opening; None where there is none."""
    _, wide, high = solid.shape
    a, b = round(INNER * wide), round(INNER * high)
    free = 1 - solid[:, a : wide - a, b : high - b].mean((1, 2)) >= OPEN
    if not free[:LIP].any():
        return None
    start = int(free.argmax())
    depth = start + int(np.append(free[start:], False).argmin())
    if depth - start < LEAST:
        return None
    shown = solid[start:depth]
    ends, walls = [], []
    for axis in (1, 2):
        lines = np.moveaxis(shown, axis, 0)
        near, far = _wall(lines), _wall(lines[::-1])
        if near is None or far is None:
            return None
        ends.append((near[0], len(lines) - far[0]))
        walls.append((near[1], far[1]))
    inner = shown[:, slice(*ends[0]), slice(*ends[1])]
    if min(inner.shape) < LEAST or 1 - inner.mean() < FREE or _is_round(inner):
        return None
    return _Room(depth, (ends[0], ends[1]), (walls[0], walls[1]))


def _is_round(inner: np.ndarray) -> bool:
    """Whether cells [D, U, V] of a room leave less than two of its corners free."""
    return (corners(inner.mean(0), CORNER) < 0.5).sum() < 2


def _outline(field: DenseField, parts: Sequence[int], opening: Front) -> np.ndarray:
    """[U, V] bool: which lines inwards from an opening's cells run within the outline of
    ``parts``."""
    low, high = np.zeros(3, int), np.array(field.sdf.shape)
    low[opening.axis], high[opening.axis] = opening.low[opening.axis], opening.high[opening.axis]
    whole = Front(opening.axis, opening.side, low, high)
    solid = (whole.seen(field.sdf) < 0) & np.isin(whole.seen(field.owner), parts)
    outline = np.asarray(ndimage.binary_fill_holes(solid.any(0)), bool)
    ends = zip(
        np.delete(opening.low, opening.axis), np.delete(opening.high, opening.axis), strict=True
    )
    return outline[tuple(slice(*end) for end in ends)]


def _encloses(outline: np.ndarray, room: _Room) -> bool:
    """Whether most of a room's corners lie within an outline [U, V]: what lies beside a bar is no
    room."""
    inner = outline[tuple(slice(*ends) for ends in room.ends)]
    return (corners(inner, CORNER) > 0.5).sum() >= 3


def _wall(lines: np.ndarray) -> tuple[int, bool] | None:
    """How far a wall reaches in that is met along the first axis of cells [N, D, M], and whether
    most lines meet one; None where it is bent, so that both ends of M reach in farther than the
    middle, as in a round vessel."""
    count = len(lines)
    first = np.where(lines.any(0), lines.argmax(0), count)
    free = (np.arange(count).reshape(-1, *[1] * (lines.ndim - 1)) >= first) & ~lines
    last = np.where(free.any(0), free.argmax(0), count)
    met = (first <= WALL * count / 2) & (last <= WALL * count)
    if met.mean() < MOST:
        return 0, False
    side = max(1, met.shape[1] // 4)
    parts = [
        last[:, part][met[:, part]]
        for part in (slice(None, side), slice(side, -side), slice(-side, None))
    ]
    if all(map(len, parts)):
        near, middle, far = map(np.median, parts)
        if min(near, far) - middle > BENT:
            return None
    return int(np.median(last[met])), True

"""What surrounds doors and drawers, the frame that they close flush with, made flat.

A stile beside a door is a few sub-cells wide: too narrow for ``flat_faces``, which asks a column's
neighbourhood what plane it belongs to. Here lines along the frame are asked: those that lie at one
depth along most of their length are brought to it, so that stiles and rails have straight edges.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import ndimage

from uniart_jax.voxels.cleanup.fronts import Front
from uniart_jax.voxels.isosurface import HALF_CELL, DenseField

# lengths in sub-cells
AHEAD, BEHIND = 6, 10  # a frame begins so far before the outermost front, or behind it, at most
GAP = 2  # free cells around doors and drawers, which are not filled
FREE = 0.8  # least share of a frame's line that no door or drawer covers
DRAWN = 0.6  # least share of a frame's line that is drawn
PART = 0.25  # least share that is drawn of a line between a frame and the door that it surrounds
STEP = 1.5  # difference in depth of two neighbouring lines at which the frame has an edge
NEAR = 2  # columns no farther from a frame's plane are near it
MOST = 0.6  # least share of a frame's columns that are near its plane
REACH = 4  # columns no farther from the plane are brought to it
FAR = 9  # so are columns up to here behind it that have no common depth
GAP_ALONG = 5  # half the width of gaps along a line that are closed
RECTANGLE, SLOT = 0.9, 3  # gaps that fill so much of a rectangle, and are so wide, are openings
THICKNESS = 2  # cells that close gaps


def with_flat_frames(field: DenseField, body: Sequence[int], fronts: Sequence[Front]) -> None:
    """In place: the frames around closed doors and drawers.

    Args:
      body: owners that do not move. fronts: boxes of the plates, where they lie when they are
        closed.
    """
    inside = np.argwhere((field.sdf < 0) & np.isin(field.owner, body))
    if not len(inside):
        return
    ends = inside.min(0), inside.max(0) + 1
    for axis, side in sorted({(front.axis, front.side) for front in fronts}):
        some = [front for front in fronts if (front.axis, front.side) == (axis, side)]
        _flat_frame(field, some, body, *ends)


def _flat_frame(
    field: DenseField,
    fronts: Sequence[Front],
    body: Sequence[int],
    first: np.ndarray,
    last: np.ndarray,
) -> None:
    """In place: the frame around fronts that are seen from one side; ``first``, ``last`` [3]: the
    box of the body's cells."""
    axis, side = fronts[0].axis, fronts[0].side
    low, high = first.copy(), last.copy()
    if side > 0:
        face = max(int(front.high[axis]) for front in fronts)
        low[axis], high[axis] = face - BEHIND, face + AHEAD
    else:
        face = min(int(front.low[axis]) for front in fronts)
        low[axis], high[axis] = face - AHEAD, face + BEHIND
    low, high = np.maximum(low, 1), np.minimum(high, field.sdf.shape[0] - 1)
    if (high - low < 1).any():
        return
    window = Front(axis, side, low, high)
    shown, whose = window.seen(field.sdf), window.seen(field.owner)
    covered = np.zeros(shown.shape[1:], bool)
    across = [k for k in range(3) if k != axis]
    spans = []
    for front in fronts:
        box = [(int(front.low[k] - low[k]), int(front.high[k] - low[k])) for k in across]
        covered[tuple(slice(max(a - GAP, 0), max(b + GAP, 0)) for a, b in box)] = True
        spans.append(box)
    begin, end = min(box[1][0] for box in spans), max(box[1][1] for box in spans)
    stiles = (slice(None), slice(max(begin, 0), max(end, 0)))
    _flat_lines(shown[:, *stiles], whose[:, *stiles], covered[stiles], body)
    rails = [np.swapaxes(cells, 1, 2) for cells in (shown, whose)]  # over the whole width
    _flat_lines(rails[0], rails[1], covered.T, body)


def _flat_lines(
    shown: np.ndarray, whose: np.ndarray, covered: np.ndarray, body: Sequence[int]
) -> None:
    """In place: lines [L] of cells [D, L, A], each of which may be covered [L, A]."""
    mine = (shown < 0) & np.isin(whose, body)
    depth, count = len(shown), len(covered)
    first = np.where(mine.any(0), mine.argmax(0), depth)
    frame = ~covered & (first < depth)
    if not frame.size:
        return
    free = (~covered).mean(1) > FREE
    drawn = frame.sum(1) > DRAWN * np.maximum((~covered).sum(1), 1)
    heights = np.array(
        [np.median(row[there]) if there.any() else depth
         for row, there in zip(first, frame, strict=True)]
    )  # fmt: skip
    group = np.cumsum(np.abs(np.diff(heights, prepend=heights[:1])) > STEP)
    group = np.where(free & drawn, group, -1)
    # the columns that end at a plane, and that plane
    ends, planes = np.zeros(covered.shape, bool), np.full(count, -1)
    for number in np.unique(group[group >= 0]):
        rows = np.flatnonzero(group == number)
        for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
            lines = slice(int(run[0]), int(run[-1]) + 1)
            plane, columns = _plane(first[lines], frame[lines], covered[lines])
            ends[lines], planes[lines] = columns, plane
    for step in (1, -1):  # what is drawn in part between a frame and what it surrounds
        for row in range(count)[::step]:
            beside = row - step
            if not 0 <= beside < count or planes[beside] < 0 or planes[row] >= 0 or not free[row]:
                continue
            if free[row:].all() if step > 0 else free[:row].all():  # outwards, as between feet
                continue
            asked = ends[beside] & ~covered[row]
            near = frame[row] & (np.abs(first[row] - planes[beside]) <= REACH)
            near |= _rubble(first[row : row + 1], frame[row : row + 1] & ~near, planes[beside])[0]
            if asked.any() and near[asked].mean() > PART:
                ends[row], planes[row] = asked | near, planes[beside]
    _end(shown, whose, mine, first, ends, planes[:, None])


def _plane(first: np.ndarray, frame: np.ndarray, covered: np.ndarray) -> tuple[int, np.ndarray]:
    """The depth at which most columns [L, A] of a frame begin, -1 where most begin elsewhere, and
    the columns that are to begin there. Small gaps belong to them, but not slots."""
    depths = first[frame]
    plane = int(np.bincount(depths).argmax())
    if (np.abs(depths - plane) <= NEAR).mean() < MOST:
        return -1, np.zeros(frame.shape, bool)
    on = frame & (np.abs(first - plane) <= REACH)
    on |= _rubble(first, frame & ~on, plane)
    wide = np.pad(on, ((0, 0), (GAP_ALONG, GAP_ALONG)))
    closed: Any = ndimage.binary_closing(wide, np.ones((1, 2 * GAP_ALONG + 1)))
    gaps = closed[:, GAP_ALONG:-GAP_ALONG] & ~on & (first > plane) & ~covered
    return plane, on | (gaps & ~_slots(gaps))


def _slots(gaps: np.ndarray) -> np.ndarray:
    """Columns [L, A] of those gaps of a frame that are rectangles: openings, not teeth."""
    found: Any = ndimage.label(gaps)
    slots = np.zeros_like(gaps)
    for number, place in enumerate(ndimage.find_objects(found[0]), 1):
        piece = found[0][place] == number
        if piece.mean() > RECTANGLE and min(piece.shape) >= SLOT:
            slots[place] |= piece
    return slots


def _rubble(first: np.ndarray, frame: np.ndarray, plane: int) -> np.ndarray:
    """Columns [L, A] that begin farther back than a frame's plane, and at no depth of their own."""
    behind = frame & (first > plane) & (first <= plane + FAR)
    found: Any = ndimage.label(behind)
    rubble = np.zeros_like(behind)
    for number in range(1, found[1] + 1):
        piece = found[0] == number
        depths = first[piece]
        usual = int(np.bincount(depths).argmax())
        rubble |= piece & ((np.abs(depths - usual) < NEAR).mean() < MOST)
    return rubble


def _end(
    shown: np.ndarray,
    whose: np.ndarray,
    mine: np.ndarray,
    first: np.ndarray,
    columns: np.ndarray,
    plane: np.ndarray,
) -> None:
    """In place: columns [L, A] of cells [D, L, A] begin at ``plane`` [L, 1]."""
    if not columns.any():
        return
    index = np.arange(len(shown))[:, None, None]
    end = np.where(first <= plane + FAR, np.maximum(first, plane), plane + THICKNESS)
    fill = columns & (index >= plane) & (index < end) & (shown > 0)
    clear = columns & (index < plane) & mine
    surface = mine & columns & (index == plane)
    whose[fill] = np.bincount(whose[mine]).argmax()
    shown[fill] = -HALF_CELL
    shown[surface] = np.minimum(shown[surface], -HALF_CELL)
    shown[clear] = HALF_CELL
    before = columns & (index == plane - 1) & (shown > 0)  # so that it lies between the cells
    shown[before] = HALF_CELL

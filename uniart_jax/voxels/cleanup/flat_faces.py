"""Faces that a network draws nearly flat are made flat: nearly all faces of furniture are flat, and
ripples of a voxel's period are noise.

Each part is looked at along every axis, from both sides, as a height map over the columns of
sub-cells. Two kinds of planes:

* near a face of the part's box, where the part comes near it along most of the face: its columns
  there end at one depth, so that edges become straight;
* depths at which many columns end: these columns end there exactly, and small gaps are closed.

What turns about a hinge and is most of a plate becomes all of it (``align_open_parts.panel``),
open or closed. Of a moving part's other faces, those that are most of a rectangle become all of it.

What stands out from a plane by more than ``STANDS`` is a handle or a knob and stays. Round things
keep their shape: their columns end at many depths, few reach a face of the box, and pieces that
bulge are left out (``column_maps``). Slots and slats narrower than ``2 GAP`` sub-cells are closed,
gaps at a face of the box up to ``2 TOOTH``: what networks draw has holes of that size.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import ndimage

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.cleanup import column_maps as maps
from uniart_jax.voxels.cleanup.align_open_parts import Turn, panel, resampled, turn_of
from uniart_jax.voxels.cleanup.fronts import door_of, without_overlap
from uniart_jax.voxels.isosurface import ZERO, DenseField, to_cells
from uniart_jax.voxels.opening_direction import center_of

# lengths in sub-cells
AROUND = 4  # a part's box, that is looked at
REACH = 5.0  # from a box's face, within which columns end at one depth ...
REACH_SHARE = 0.1  # ... and of the part's size along that axis
COVERED = 0.75  # share of the face's longer side along which the part has to come near it
EDGE = 5  # a face no wider is a panel's edge: what stands out from it is no handle
FLAT = 1.5  # from a plane, within which columns belong to it
STANDS = 2.0  # ahead of a plane, from which on it is no ripple
# share of these within half a cell of one depth (of many round faces a half); the second is enough
SHARP, BARELY = 0.6, 0.55  # where these are no tilted plane
PLANE_SHARE = 0.08  # of a part's columns, and
PLANE_COLUMNS = 48  # so many, that make a plane
RIPPLE = 13  # side of the neighbourhood whose median says what plane a column belongs to
PLANES = 4  # at most, of each side
TOOTH = 5  # gaps between teeth of twice this width are closed
DENT = 10  # a gap that is no deeper is filled to its ground
THICKNESS = 2  # of what closes deeper ones
NOBODYS = -2  # cells that no part may take
MOST = 0.6  # share of a moving part's face that a plane covers, where it is to cover it all
NARROW = 10  # a narrower face is an edge, as wide as its ripples say
CORNER = 0.1  # of a face's sides: round faces do not reach so far into its corners
CORNERS, REACHED = 3, 0.3  # so many of a plate's corners are covered so far at least
DRAWN = 0.4  # share of an opened plate that is drawn at least, with one corner
EVEN, MOSTLY_EVEN = 3, 0.75  # from the plane of its front or its back, within which so much lies
APART = 1  # cells that stay between what is completed and other parts
PANEL = 40  # cells around what is drawn of a panel, in which it is completed
LENT = 0.4  # share of a plate that is drawn as the body's at most
KEPT = 0.5  # share of a part's cells below which it is left as it was

Views = tuple[np.ndarray, ...]  # distance, owner, source, and whose a cell was at first


def with_flat_faces(
    field: DenseField,
    boxes: np.ndarray,
    joints: Sequence[Joint] = (),
    parents: Sequence[int] = (),
    body: Sequence[int] = (),
) -> DenseField:
    """A field whose parts' nearly flat faces are flat.

    Args:
      boxes: [K, 6] centre and size of each part, object units. joints: [K]; what turns on one and
        is shown turned is made flat as it lies straight (``align_open_parts``); what is drawn as a
        plate, open or closed, is completed. parents: of all parts. body: parts that do not move;
        what of them lies within a closed door's plate is the door's.

    Returns:
      A new field. No other cell that is solid in another part of ``field`` becomes a part's, but
      for what a turned one gave up.
    """
    sdf, owner, source = field.sdf.copy(), field.owner.copy(), field.source.copy()
    taken = np.full(sdf.shape, NOBODYS, owner.dtype)  # the layer around stays outside
    inner = (slice(1, -1),) * 3
    taken[inner] = np.where(field.sdf < 0, field.owner, -1)[inner]
    cells = sdf.shape[0] - 2
    turns = _turns(field, boxes, joints, parents, body)
    for part, (centre, size) in enumerate(zip(boxes[:, :3], boxes[:, 3:], strict=True)):
        if part in turns and _turned((sdf, owner, source, taken), part, turns[part], body):
            continue
        lower, upper = (to_cells(c, cells) for c in (centre - size / 2, centre + size / 2))
        low = np.clip(np.floor(lower - AROUND).astype(int), 0, cells)
        high = np.clip(np.ceil(upper + AROUND).astype(int), 1, cells + 1)
        window = tuple(slice(a, b + 1) for a, b in zip(low, high, strict=True))
        views = (sdf[window], owner[window], source[window], taken[window])
        moves = len(joints) > 0 and joints[part].type != "fixed"
        box = lower - low, upper - low
        _flat_part(views, part, *box, box if moves else None)
    sdf[np.abs(sdf) < ZERO] = -ZERO
    return dataclasses.replace(field, sdf=sdf, owner=owner, source=source)


def _turns(
    field: DenseField,
    boxes: np.ndarray,
    joints: Sequence[Joint],
    parents: Sequence[int],
    body: Sequence[int],
) -> dict[int, Turn]:
    """Of the parts that turn on a hinge along the lattice; what carries others as it is drawn."""
    size = field.sdf.shape[0] - 2
    inside = np.argwhere((field.sdf < 0) & np.isin(field.owner, body))
    turns, doors = {}, {}
    for part, joint in enumerate(joints):
        cells = np.argwhere((field.sdf < 0) & (field.owner == part))
        if not len(inside):
            turns[part] = turn_of(cells, boxes[part], joint, size, part not in parents)
        else:
            center = center_of(inside, size)
            doors[part] = door_of(cells, boxes[part], joint, size, center, part not in parents)
    turns |= without_overlap({k: door for k, door in doors.items() if door is not None})
    return {k: turn for k, turn in turns.items() if turn is not None}


def _flat_part(
    views: Views,
    part: int,
    lower: np.ndarray,
    upper: np.ndarray,
    moving: tuple[np.ndarray, np.ndarray] | None,
) -> None:
    """In place: one part's faces; ``lower``, ``upper`` [3]: its box in the views' cells;
    ``moving``: the same of a moving part, whose faces are completed within it."""
    before = tuple(view.copy() for view in views)
    sides = upper - lower
    for axis in np.argsort(-sides):
        for side in (1, -1):
            face = lower[axis] if side > 0 else views[0].shape[axis] - 1 - upper[axis]
            _straighten(_seen(views, axis, side), part, float(face), np.delete(sides, axis))
    for axis in range(3):
        for side in (1, -1):
            seen = _seen(views, axis, side)
            face = _face(axis, side, *moving, seen[0].shape) if moving else None
            _flatten(seen, part, face)
            _flatten(tuple(v[len(v) // 2 :] for v in seen), part)  # from within
    if _solid(views, part).sum() < KEPT * _solid(before, part).sum():
        for view, old in zip(views, before, strict=True):
            view[...] = old


def _turned(views: Views, part: int, turn: Turn, body: Sequence[int]) -> bool:
    """In place: a part that is shown turned, or is most of a plate, is made flat as it lies
    straight. False, and left as it was, where it is neither, or would lose too much."""
    sdf, owner, source, taken = views
    mine = owner == part
    window = ndimage.find_objects((mine & (sdf < 0)).astype(np.int8))[0]
    window = tuple(slice(s.start - 1, s.stop + 1) for s in window)  # the layer around is free
    phi = np.where(mine, sdf, np.maximum(np.abs(sdf), 0.5))[window]
    colored = np.where(mine, source, -1)[window]
    low = np.array([s.start for s in window])
    phi, colored, low = resampled(phi, colored, low, turn.straight, PANEL)
    plate = _is_most_of_a_plate(phi < 0, low, turn)
    if not plate and turn.still:
        return False
    drawn = phi
    if plate and (phi < 0).any():
        phi = panel(phi, low, turn, sdf.shape[0] - 2)
    own = np.zeros(phi.shape, owner.dtype)
    solid = np.argwhere(phi < 0)
    if not len(solid):
        return False
    free = np.full(phi.shape, -1, owner.dtype)
    lower, upper = solid.min(0) - 0.5, solid.max(0) + 0.5
    ends = lower.copy(), upper.copy()
    if phi is not drawn:  # a panel: its edges are as thick as it is, without its handle
        across = 3 - turn.axis - turn.along
        ends[0][across], ends[1][across] = _usual(phi < 0, across)
    first, last = turn.box(ends[0] + low, ends[1] + low)
    _flat_part((phi, own, colored, free), 0, lower, upper, (first - low, last - low))
    phi, colored, low = resampled(phi, colored, low, turn.back)
    first = np.clip(low, 1, None)  # what lies beyond the grid is left out
    last = np.minimum(low + phi.shape, np.array(sdf.shape) - 1)
    if (last <= first).any():
        return False
    into = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
    from_ = tuple(slice(a, b) for a, b in zip(first - low, last - low, strict=True))
    phi, colored = phi[from_], colored[from_]
    was = mine & (sdf < 0)
    lent = np.zeros_like(was)
    if plate and turn.still:
        lent[into] = (phi < 0) & (sdf[into] < 0) & np.isin(owner[into], body)
        lent &= lent.sum() <= LENT * (phi < 0).sum()
    near: Any = ndimage.binary_dilation((sdf < 0) & ~was & ~lent, iterations=APART)
    free = (~near & ((sdf > 0) | lent) | was)[into]
    free &= (taken[into] == -1) | (taken[into] == part) | lent[into]
    if (free & (phi < 0)).sum() < KEPT * was.sum():
        return False
    gone = was | lent
    sdf[gone] = np.maximum(-sdf[gone], 0.5)
    owner[lent] = part
    here, whose = sdf[into], owner[into]
    new = free & ((phi < 0) | (((whose == -1) | (whose == part)) & (phi < 1)))
    here[new], whose[new] = phi[new], part
    source[into][new & (phi < 0)] = colored[new & (phi < 0)]
    taken[was & (sdf > 0)] = -1  # a door beside it may have them
    return True


def _usual(solid: np.ndarray, axis: int) -> tuple[float, float]:
    """Where columns along an axis begin and end, their medians; some cell is solid."""
    columns = np.moveaxis(solid, axis, 0)
    columns = columns[:, columns.any(0)]
    first, last = columns.argmax(0), len(columns) - 1 - columns[::-1].argmax(0)
    return float(np.median(first)) - 0.5, float(np.median(last)) + 0.5


def _is_most_of_a_plate(solid: np.ndarray, low: np.ndarray, turn: Turn) -> bool:
    """Whether cells [A, B, C], from place ``low`` on, are most of what box and hinge say, have
    corners and lie in one plane, which a bail, a frame of bars or a round lid do not. Of a
    plate that is shown opened less is drawn, and the corners are its own."""
    first, last = turn.box(np.zeros(3), np.array(solid.shape, np.float64))
    across = 3 - turn.axis - turn.along
    shown = np.moveaxis(solid, across, 0)
    _, face = _face(across, 1, first - low, last - low, shown.shape)
    if not face.any():
        return False
    columns = shown.any(0) & face
    most, corners = (DRAWN, 1) if turn.opened else (MOST, CORNERS)
    if columns.sum() < most * face.sum():
        return False
    inner = _cut(columns, columns if turn.opened else face)
    if not turn.opened and min(inner.shape) < NARROW:
        return False
    if (maps.corners(inner, CORNER) > REACHED).sum() < corners:
        return False
    faces = shown.argmax(0)[columns], shown[::-1].argmax(0)[columns]  # on one there may be bins
    return max((np.abs(at - np.median(at)) <= EVEN).mean() for at in faces) >= MOSTLY_EVEN


def _seen(views: Views, axis: int, side: int) -> Views:
    """The same cells with ``axis`` first, from its lower end (``side`` 1) or its upper one (-1)."""
    return tuple(np.moveaxis(view, axis, 0)[::side] for view in views)


def _solid(views: Views, part: int) -> np.ndarray:
    return (views[0] < 0) & (views[1] == part)


def _straighten(views: Views, part: int, face: float, sides: np.ndarray) -> None:
    """In place: where the part comes near the box's face along most of it, its columns end at one
    depth, the median's.

    Args:
      face: of the box, along the first axis. sides: [2] of the face, sub-cells.
    """
    sdf = views[0]
    first, height = maps.heights(sdf, _solid(views, part))
    there = (first > 0) & (first < len(sdf))
    depth = len(sdf) - 2 * face  # about the part's size along this axis
    reach = min(REACH, REACH_SHARE * depth)
    near = there & (height <= face + reach)
    there &= ~maps.with_what_goes_on(maps.round_pieces(near, height, EDGE), there, height, FLAT)
    near &= there
    if not near.any():
        return
    spans = [int(np.ptp(np.flatnonzero(near.any(k)))) + 1 for k in (1, 0)]
    if spans[int(sides.argmax())] < COVERED * sides.max():
        return
    plane = float(np.median(height[near]))
    near = there & (height <= plane + reach)
    # teeth between columns that come near enough are no detail
    near |= maps.closed(near, TOOTH) & there & (height <= plane + 3 * reach)
    if min(spans) > EDGE:
        near &= height >= plane - STANDS
    _end_at(views, part, near, plane)


def _face(
    axis: int, side: int, lower: np.ndarray, upper: np.ndarray, shape: tuple[int, ...]
) -> tuple[float, np.ndarray]:
    """The face of a box that is seen along an axis from a side: its depth, and [U, V] bool."""
    depth = lower[axis] if side > 0 else shape[0] - 1 - upper[axis]
    ranges = zip(np.delete(lower, axis), np.delete(upper, axis), shape[1:], strict=True)
    u, v = ((np.arange(n) > a + APART) & (np.arange(n) < b - APART) for a, b, n in ranges)
    return float(depth), u[:, None] & v


def _flatten(views: Views, part: int, face: tuple[float, np.ndarray] | None = None) -> None:
    """In place: columns that end at nearly the same depth as many others end there exactly.

    ``face`` (``_face``): where a plane at it covers most of it, and is not round, it covers all.
    """
    first, height = maps.heights(views[0], _solid(views, part))
    left = (first > 0) & (first < len(views[0]))
    least = max(PLANE_COLUMNS, PLANE_SHARE * left.sum())
    if left.sum() < least:
        return
    sides = [min(RIPPLE, side // 4 | 1) for side in height.shape]  # less of what is small
    around = ndimage.median_filter(height, sides, mode="nearest")
    for _ in range(PLANES):
        if left.sum() < least:
            return
        depths = np.sort(around[left])
        many = np.searchsorted(depths, depths + 0.5) - np.searchsorted(depths, depths - 0.5)
        middle = depths[many.argmax()]  # the depth with most columns around it
        near = left & (np.abs(around - middle) <= FLAT)
        sharp = many.max() / max(near.sum(), 1)
        if near.sum() < least or sharp < BARELY or (sharp < SHARP and maps.tilted(near, around)):
            return
        curved = maps.with_what_goes_on(maps.round_pieces(near, around, EDGE), left, around, FLAT)
        left &= ~curved
        near &= ~curved
        if near.sum() < least:
            left &= ~near
            continue
        plane = float(np.median(height[near]))
        on = near & (height >= plane - STANDS) & (height <= plane + 2 * FLAT)
        whole = maps.closed(on) | maps.without_small_holes(on)
        if face is not None and abs(plane - face[0]) <= REACH:
            close = np.abs(height - plane) <= FLAT  # not their medians, which trim corners
            if _is_most(close & face[1], face[1]):
                whole |= face[1]
        gaps = whole & ~on & (first > plane)
        dents = gaps & (first < np.minimum(plane + DENT, len(views[0])))
        _end_at(views, part, on | dents, plane)
        _fill(views, part, gaps & ~dents, plane)
        left &= ~near


def _is_most(columns: np.ndarray, face: np.ndarray) -> bool:
    """Whether columns [U, V] are most of a rectangle ``face`` [U, V], and reach into a corner."""
    inner = _cut(columns, face)
    if min(inner.shape) < NARROW or columns.sum() < MOST * face.sum():
        return False
    return bool((maps.corners(inner, CORNER) > 0.5).any())


def _cut(columns: np.ndarray, face: np.ndarray) -> np.ndarray:
    """Columns [U, V] within the rows and lines in which ``face`` [U, V] has any."""
    return columns[np.ix_(*(np.flatnonzero(face.any(k)) for k in (1, 0)))]


def _end_at(views: Views, part: int, columns: np.ndarray, plane: float) -> None:
    """In place: the part's columns [U, V] end at ``plane``, cells along the first axis."""
    u, v = np.nonzero(columns)
    if not len(u):
        return
    mine = _solid(views, part)[:, u, v]
    first = mine.argmax(0)
    # what is thinner than it is cut by is moved, not lost
    start = int(np.ceil(plane))
    lost = (first < plane) & ~mine[start : start + THICKNESS].any(0)
    end = np.where(lost, start + THICKNESS, np.maximum(first, start + 1))
    # all that changes lies in these layers
    low = max(min(int(first.min()), int(np.floor(plane))), 0)
    layers = slice(low, max(int(end.max()), low + 1))
    sdf, owner, source, taken = (view[layers] for view in views)
    column = sdf[:, u, v], owner[:, u, v], source[:, u, v]
    color = views[2][first, u, v]
    mine, whose = mine[layers], taken[:, u, v]
    index = np.arange(low, low + len(sdf))[:, None]
    free = ((column[0] > 0) | mine) & ((whose == -1) | (whose == part))
    # only what is free all the way from the plane to the part
    blocked = (~free & (index >= plane) & (index < first)).any(0)
    inside = (index >= plane) & (index < end) & free & (mine | (index < first) | lost) & ~blocked
    cut = (index < plane) & (index >= np.minimum(first, np.floor(plane))) & free & ~blocked
    cut &= mine | (column[1] == -1) | (column[1] == part)
    filled = inside & ~mine
    outside = np.maximum(plane - index, 2 * ZERO)
    sdf[:, u, v] = np.where(inside, plane - index, np.where(cut, outside, column[0]))
    owner[:, u, v] = np.where(filled | cut, part, column[1])
    source[:, u, v] = np.where(filled & (column[2] < 0), color, column[2])


def _fill(views: Views, part: int, columns: np.ndarray, plane: float) -> None:
    """In place: free cells of columns [U, V] from ``plane`` to ``THICKNESS`` behind it are the
    part's, coloured as what is nearest."""
    sdf, owner, source, taken = views
    start = int(np.ceil(plane))
    for depth in range(start, min(start + THICKNESS, len(sdf))):
        mine = (sdf[depth] < 0) & (owner[depth] == part) & (source[depth] >= 0)
        cells = columns & (sdf[depth] > 0) & ((taken[depth] == -1) | (taken[depth] == part))
        if not (mine.any() and cells.any()):
            continue
        nearest: Any = ndimage.distance_transform_edt(
            ~mine, return_distances=False, return_indices=True
        )
        source[depth][cells] = source[depth][tuple(nearest)][cells]
        sdf[depth][cells] = plane - depth - 0.5 * (depth > start)
        owner[depth][cells] = part
    if start > 0:
        cells = columns & (sdf[start - 1] > 0) & np.isin(owner[start - 1], (-1, part))
        nearer = max(plane - start + 1, 2 * ZERO)
        sdf[start - 1][cells] = np.minimum(sdf[start - 1][cells], nearer)
        owner[start - 1][cells] = part

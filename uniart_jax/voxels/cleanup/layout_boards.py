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
from uniart_jax.voxels.cleanup.align_open_parts import resampled
from uniart_jax.voxels.cleanup.layout_panels import BESIDE, FARTHEST, aligned, distance_to, fitted
from uniart_jax.voxels.isosurface import ZERO, DenseField, to_cells
from uniart_jax.voxels.opening_direction import opens_to

# lengths in sub-cells, of a grid with 128 along its side
NEAR = 3  # around boards within which a part's drawn cells are explained
EDGE = 3  # from the ends of the body, within which it stays
AHEAD = 3  # that a handle stands out from the boards at least
HANDLE = 12  # cells of one at least
LEAST = 6  # deep what is looked at of a slider, at least
GAP = 3  # that a board ends before one that it meets, at most
WIDER, LEVEL = 8, 2  # that outer edges move to where they are drawn, and are apart, at most
TOUCH, APART = 0.5, 6  # between boards that touch, and that are made to, at most
ROOM = 12  # around a part that is shown turned
# shares
MOST = 0.5  # of its usual width that a part has where it is said to end
WITHIN = 0.8  # of the drawn part that is in the box around its boards, at least
EXPLAINED = 0.7  # of the drawn part that is near a board, at least
COVERED, SHOWN = 0.9, 0.8  # of the outlines of the drawn part and of its boards, near the other
DEEP = 0.3  # of a slider, from its front on, in which it is looked at
CRUMBS = 0.3  # of what a drawer encloses that the body has there, at most, if that is to go
FRONT = 0.5  # of a drawer's cross-section that its front takes at least
WALL, REACH = 0.4, 0.25  # of a layer that is a wall's; of what a drawer encloses, where one may be


def with_boards(
    field: DenseField,
    joints: Sequence[Joint],
    body: Sequence[int],
    boards: Mapping[int, np.ndarray],
    motions: Mapping[int, np.ndarray] | None = None,
    exact: bool = False,
) -> tuple[DenseField, frozenset[int]]:
    """A field in which parts are their boards, and which parts are.

    Boards are moved to faces that are drawn nearby, and made to meet; one that hangs in the air, as
    a handle without its feet, reaches the board behind it. They take the place of
    what is drawn of their part, but for what stands out from their front, as a handle of which
    there is no board, and of what the body has there, but for what is within ``EDGE`` of the ends
    of all that does not move. A drawer lies between the walls that the body has beside it; crumbs
    of the body within it go.

    Args:
      joints: of all owners. body: owners that do not move. boards: [N, 6] lower and upper corners,
        object units, of some owners. motions: [3, 4] of those whose boards are told elsewhere than
        they are shown, to there: doors that stand ajar (``voxels.closed_pose``), object units.
      exact: parts are their boards as they are told, whatever is drawn of them, and nothing else
        of them stays.

    Returns:
      A new field, and the owners that are built of boards in it. A part stays as it is where less
      than ``WITHIN`` of it lies in the box around its boards, where less than ``EXPLAINED`` of it
      is near one, or where their outlines differ, seen along the way of a slider or through the
      plate of another: less than ``COVERED`` of what is drawn, or less than ``SHOWN`` of the
      boards, is near the other. Of a slider the first ``DEEP`` counts.
    """
    still = np.isin(field.owner, body)
    held, size = (field.sdf < 0) & still, field.sdf.shape[0] - 2
    placed, rooms, turned, kept = {}, {}, {}, np.zeros_like(held)
    for k, rows in boards.items():
        solid = (field.sdf < 0) & (field.owner == k)
        if not len(rows) or not solid.any() or not held.any():
            continue
        rows = to_cells(rows, size)
        way = opens_to(joints[k], np.argwhere(solid), np.argwhere(held), size)
        own = np.where(field.owner == k, field.sdf, np.abs(field.sdf))
        if motions is not None and k in motions:
            found = _turned(own, solid, rows, motions[k], way)
            if found is not None:
                turned[k] = found
            continue
        slides = joints[k].type == "prismatic"
        found = rows if exact else _placed(own, solid, rows, way if slides else None)
        if found is None:
            continue
        if slides and way is not None:
            found, rooms[k] = _between_walls(found, held, *way)
        placed[k] = found
        if way is not None and not exact:
            kept |= _standing_out(found, solid, *way)
    built = frozenset([*placed, *turned])
    if not built:
        return field, built
    sdf, owner = field.sdf.copy(), field.owner.copy()
    mine = np.isin(owner, list(built)) & (sdf < 0)
    sdf[mine & ~kept] = FARTHEST  # what they were drawn as
    solid = sdf < 0
    stays = solid & (~still | _outer(held))
    stays = np.asarray(ndimage.binary_dilation(stays), bool) & ~(mine & ~kept)
    for axis in range(3):  # the layer around the grid stays outside
        np.moveaxis(stays, axis, 0)[[0, -1]] = True
    for window in rooms.values():
        if window is not None:
            free = (held & ~stays)[window]
            if free.mean() < CRUMBS:
                sdf[window] = np.where(free, FARTHEST, sdf[window])
    nearest = np.full(sdf.shape, float(BESIDE), np.float32)
    whose = np.full(sdf.shape, -1, np.int16)
    for k in built:
        distance = turned[k] if k in turned else distance_to(placed[k], sdf.shape)
        nearer = distance < nearest
        nearest[nearer], whose[nearer] = distance[nearer], k
    value = np.clip(nearest, -FARTHEST, FARTHEST)
    value = np.where(np.abs(value) < ZERO, -ZERO, value)
    where = ~stays & (whose >= 0) & ((value < 0) | (sdf > 0))
    sdf[where] = np.where(value < 0, value, np.minimum(value, sdf))[where]
    taken = where & ((value < 0) | (owner < 0) | mine)
    owner[taken] = whose[taken]
    return dataclasses.replace(field, sdf=sdf, owner=owner), built


def _turned(
    own: np.ndarray,
    solid: np.ndarray,
    rows: np.ndarray,
    motion: np.ndarray,
    way: tuple[int, int] | None,
) -> np.ndarray | None:
    """[X, Y, Z] distances to the boards of a part, and to what stands out from them, that is shown
    turned; None where it is drawn otherwise.

    own: [X, Y, Z] distances of the part. solid: what is drawn of it. rows: [N, 6] boards in cells,
    after the motion [3, 4], object units. way: axis and side to which it opens there.
    """
    size = len(solid) - 2
    there = np.vstack([motion, [0, 0, 0, 1]])
    middle = to_cells(np.zeros(3), size)
    there[:3, 3] = motion[:, 3] * size + middle - motion[:, :3] @ middle
    window = ndimage.find_objects(solid.astype(np.int8))[0]
    window = tuple(slice(max(s.start - 1, 0), s.stop + 1) for s in window)
    low = np.array([s.start for s in window])
    phi, _, low = resampled(own[window], np.zeros(own[window].shape, int), low, there, ROOM)
    straight = phi < 0
    if not straight.any():
        return None
    placed = _placed(phi, straight, rows - np.tile(low, 2), None)
    if placed is None:
        return None
    shape = np.clip(distance_to(placed, phi.shape), -FARTHEST, 1.0)
    if way is not None:
        shape = np.where(_standing_out(placed, straight, *way), np.minimum(shape, phi), shape)
    shape, _, low = resampled(shape, np.zeros(shape.shape, int), low, np.linalg.inv(there))
    distance = np.full(own.shape, float(BESIDE), np.float32)
    first, last = np.clip(low, 0, None), np.minimum(low + shape.shape, own.shape)
    if (last <= first).any():
        return None
    into = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
    from_ = tuple(slice(a, b) for a, b in zip(first - low, last - low, strict=True))
    distance[into] = np.where(shape[from_] < 1, shape[from_], BESIDE)
    return distance


def _placed(
    own: np.ndarray, solid: np.ndarray, rows: np.ndarray, way: tuple[int, int] | None
) -> np.ndarray | None:
    """[N, 6] a part's boards in cells, where they are drawn; None where it is drawn otherwise.

    own: [X, Y, Z] distances of the part. solid: what is drawn of it. rows: [N, 6] its boards. way:
    axis and side to which it slides.
    """
    placed = fitted(aligned(rows, solid, own), GAP)
    cells = np.argwhere(solid)
    if way is None:
        axis, layers = int(np.ptp(cells, 0).argmin()), slice(None)
    else:
        axis, side = way
        first, last = cells[:, axis].min(), cells[:, axis].max()
        deep = max(round(DEEP * (last + 1 - first)), LEAST)
        layers = slice(max(first - NEAR, 0), first + deep)
        if side > 0:
            layers = slice(max(last + 1 - deep, 0), last + 1 + NEAR)
    shown = np.moveaxis(solid, axis, 0)[layers]
    drawn = np.asarray(shown.any(0))
    _as_wide(placed, drawn, [a for a in range(3) if a != axis])
    _joined(placed)
    low, high = placed[:, :3].min(0) - NEAR, placed[:, 3:].max(0) + NEAR
    if ((cells >= low) & (cells <= high)).all(1).mean() < WITHIN:
        return None
    distance = np.moveaxis(distance_to(placed, solid.shape), axis, 0)[layers]
    built = (distance < 0).any(0)
    near_drawn, near_built = (
        np.asarray(ndimage.binary_dilation(x, iterations=NEAR), bool) for x in (drawn, built)
    )
    if not built.any() or near_drawn[built].mean() < SHOWN:
        return None
    alike = near_built[drawn].mean() >= COVERED and (distance[shown] < NEAR).mean() >= EXPLAINED
    return placed if alike else None


def _as_wide(boards: np.ndarray, drawn: np.ndarray, axes: list[int]) -> None:
    """In place: boards [N, 6] end where most of their part's outline [U, V] along two axes does,
    if that is near where the last of those that span the outline end: these, and those that end
    within ``LEVEL`` of there. A board that is thin along the axis moves as it is."""
    thin = (boards[:, 3:] - boards[:, :3]).argmin(1)
    for axis, across, lines in zip(axes, axes[::-1], (drawn, drawn.T), strict=True):
        filled = lines.sum(1)
        most = np.flatnonzero(filled >= MOST * np.median(filled[filled > 0]))
        span = MOST * float(lines.any(0).sum())
        wide = boards[:, across + 3] - boards[:, across] >= span
        for end, place in ((axis, most[0] - 0.5), (axis + 3, most[-1] + 0.5)):
            faces = boards[:, end]
            if not wide.any():
                continue
            last = faces[wide].max() if end > 2 else faces[wide].min()
            if abs(place - last) > WIDER:
                continue
            near = np.abs(faces - last) <= LEVEL
            whole = near & (thin == axis)
            boards[near & ~whole, end] = place
            shift = place - boards[whole, end]
            boards[whole, axis] += shift
            boards[whole, axis + 3] += shift


def _joined(boards: np.ndarray) -> None:
    """In place: boards [N, 6] that touch no other are made to reach the nearest that they face, up
    to ``APART`` away, from the largest board on."""
    low, high = boards[:, :3], boards[:, 3:]
    joined = [int((high - low).prod(1).argmax())]
    loose = [k for k in range(len(boards)) if k not in joined]
    while loose:
        gaps = np.maximum(low[loose][:, None] - high[joined], low[joined] - high[loose][:, None])
        apart = np.where((gaps > TOUCH).sum(2) <= 1, gaps.max(2), np.inf)
        row, other = np.unravel_index(apart.argmin(), apart.shape)
        if apart[row, other] > APART:
            return
        k, near = loose.pop(int(row)), joined[int(other)]
        axis = int(gaps[row, other].argmax())
        if apart[row, other] > TOUCH:
            if low[k, axis] > high[near, axis]:
                boards[k, axis] = high[near, axis]
            else:
                boards[k, axis + 3] = low[near, axis]
        joined.append(k)


def _standing_out(boards: np.ndarray, solid: np.ndarray, axis: int, side: int) -> np.ndarray:
    """[X, Y, Z] cells of a part before all of its boards [N, 6], to the side to which it opens:
    pieces that stand out by ``AHEAD`` and more."""
    low, high = boards[:, :3].min(0), boards[:, 3:].max(0)
    window = [_cells(a, b, n) for a, b, n in zip(low, high, solid.shape, strict=True)]
    front = high[axis] if side > 0 else low[axis]
    window[axis] = slice(0, max(int(np.ceil(front)), 0))
    if side > 0:
        window[axis] = slice(max(int(np.floor(front)) + 1, 0), solid.shape[axis])
    kept = np.zeros_like(solid)
    labels = np.zeros(solid[tuple(window)].shape, np.int32)
    if not labels.size:
        return kept
    ndimage.label(solid[tuple(window)], output=labels)
    for k, place in enumerate(ndimage.find_objects(labels), start=1):
        own = labels[place] == k
        if own.shape[axis] >= AHEAD and own.sum() >= HANDLE:
            kept[tuple(window)][place] |= own
    return kept


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


def _between_walls(
    boards: np.ndarray, body: np.ndarray, axis: int, side: int
) -> tuple[np.ndarray, tuple[slice, ...] | None]:
    """A drawer's boards [N, 6] in cells, those behind its front between the walls of the body
    [X, Y, Z], and what they enclose there; the boards as they are, and None, for what has no front,
    and for what opens upwards.

    axis, side: to which it opens.
    """
    low, high = boards[:, :3].min(0), boards[:, 3:].max(0)
    sizes = boards[:, 3:] - boards[:, :3]
    thin = sizes.argmin(1)
    across = [a for a in range(3) if a != axis]
    wide = sizes[:, across].prod(1) >= FRONT * (high - low)[across].prod()
    fronts = np.flatnonzero(wide & (thin == axis))
    if axis == 2 or not len(fronts):
        return boards, None
    front = max(fronts, key=lambda k: side * boards[k, axis])
    if side > 0:
        high[axis] = boards[front, axis]
        behind = boards[:, axis] < high[axis] - 1
    else:
        low[axis] = boards[front, axis + 3]
        behind = boards[:, axis + 3] > low[axis] + 1
    behind[front] = False
    if not behind.any():
        return boards, None
    boards, place = boards.copy(), np.flatnonzero(behind)
    for a in across:
        low[a], high[a] = boards[behind, a].min(), boards[behind, a + 3].max()
    window = tuple(_cells(a, b, len(body)) for a, b in zip(low, high, strict=True))
    for a in across:
        if not body[window].size:
            return boards, None
        full = body[window].mean(tuple(b for b in range(3) if b != a)) > WALL
        reach = max(int(REACH * len(full)), 1)
        ends = [window[a].start, window[a].stop]
        if full[:reach].any():
            ends[0] += int(np.flatnonzero(full[:reach])[-1]) + 1
            _push(boards, place, thin, a, ends[0] - 0.5)
        if full[-reach:].any():
            ends[1] -= int(np.flatnonzero(full[-reach:][::-1])[-1]) + 1
            _push(boards, place, thin, a, ends[1] - 0.5, upper=True)
        window = (*window[:a], slice(ends[0], max(ends)), *window[a + 1 :])
    return boards, window


def _push(
    boards: np.ndarray,
    rows: np.ndarray,
    thin: np.ndarray,
    axis: int,
    limit: float,
    upper: bool = False,
) -> None:
    """In place: some boards end at a limit along an axis; those that it is thin along move."""
    for k in rows:
        over = boards[k, axis + 3] - limit if upper else limit - boards[k, axis]
        if over <= 0:
            continue
        shift = -over if upper else over
        if thin[k] == axis:
            boards[k, [axis, axis + 3]] += shift
        else:
            boards[k, axis + 3 * upper] += shift


def _cells(low: float, high: float, count: int) -> slice:
    """Cells of ``count`` between two places, none of the layer around the grid."""
    first = int(np.clip(np.ceil(low), 1, count - 1))
    return slice(first, max(int(np.clip(np.floor(high) + 1, 1, count - 1)), first))

"""A field whose body has the shelves, dividers and other boards within that a layout has.

At the resolution of the voxels they are one or two cells thick, and a structure network draws them
as crumbs; a set of boxes (``panel_table``) is not.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from uniart_jax.voxels.isosurface import ZERO, DenseField, to_cells
from uniart_jax.voxels.leg_table import Legs
from uniart_jax.voxels.panel_table import Panels

# lengths in sub-cells, of a grid with 128 along its side
THINNEST = 2.2  # that a panel is made at least
LEVEL = 1.2  # between faces, one after the other, that are made one plane
SPREAD = 2.0  # between the first and the last of them, at most
GAP, OVER = 12.0, 3.0  # that a panel ends before, and beyond, one that it meets, at most
REACH = 5.0  # from a face to a drawn one that it is moved to, at most
SHIFT = 6  # that a panel is moved to where it is drawn, at most
FARTHEST = 3.0  # to which distances are cut off
BESIDE = 5  # to a panel, within which what is drawn is the panel's
WIDE, THICK = 8, 8  # sides of another board at least, and its thickness at most
OUTER = 8  # from an end of the body, within which a panel is an outer wall
SOLID = 6  # what is as thick along all three axes stays; even
NEAR = 4  # outside the box around all panels, to which what is drawn of the body has to reach
# shares
DRAWN, CLEARER = 0.35, 0.1  # of a panel's layers that is drawn where it is moved to, and the gain
AMONG = 0.25  # of what is drawn in two layers on each side that is subtracted
FAR_AWAY = 0.01  # subtracted for each cell of a move
WHOLE = 0.6  # of its box that another board fills at least
EXPLAINED, SHOWN = 0.85, 0.8  # of the drawn body and of the panels that agree, at least
PIECE = 0.02  # of the body, from which on a loose piece of it counts


def with_panels(
    field: DenseField, body: Sequence[int], panels: Panels, legs: Legs | None = None
) -> DenseField | None:
    """A field whose body has these panels within, and nothing ragged beside them.

    Outer walls that have a panel stay as they are drawn, also where they go on beyond it, as an
    oven's back above its hob: a network is sure of them. Panels within the body are drawn anew, and
    what else is drawn there is taken away, but for boards that are whole and what is thick. Faces
    of nearly one plane are made one; panels are made to meet (``fitted``).

    Args:
      body: owners that do not move. legs: what it stands on, if that is known.

    Returns:
      A new field; solid cells of other parts, and those next to them, stay as they are. The field
      as it is where no panel is within the body, or where the body would fall into pieces. None
      where there is no body or no panel, or where the field shows another body: less than
      ``EXPLAINED`` of it is near panels or legs, or less than ``SHOWN`` of the panels is near
      something that is drawn.
    """
    mine = np.isin(field.owner, body)
    solid = (field.sdf < 0) & mine
    if not solid.any() or not len(panels):
        return None
    size = field.sdf.shape[0] - 2
    own = np.where(mine, field.sdf, np.abs(field.sdf))
    boxes = fitted(aligned(to_cells(panels.boxes, size), solid, own))
    distance = distance_to(boxes, field.sdf.shape)
    if not _agree(field.sdf < 0, solid, distance, legs):
        return None
    free = ~np.asarray(ndimage.binary_dilation((field.sdf < 0) & ~mine), bool)
    for axis in range(3):  # the layer around the grid stays outside
        np.moveaxis(free, axis, 0)[[0, -1]] = False
    inner = _inner(boxes, solid)
    if not inner.any():
        return field
    stays = _outside(boxes[:, :3].min(0), boxes[:, 3:].max(0), solid)
    stays |= distance_to(boxes[~inner], field.sdf.shape) < NEAR
    kept = _other_boards(solid, distance) | _thick(solid) | _walls(boxes[~inner], solid)
    around = np.asarray(ndimage.binary_dilation(kept, np.ones((3, 3, 3))), bool)
    stays |= around & (kept | ~solid)  # and its surface
    cells = np.argwhere(solid)
    within = boxes[inner]  # no board stands out of the walls
    within[:, :3] = np.maximum(within[:, :3], cells.min(0) - 0.5)
    within[:, 3:] = np.minimum(within[:, 3:], cells.max(0) + 0.5)
    value = np.clip(distance_to(within, field.sdf.shape), -FARTHEST, FARTHEST)
    value = np.where(stays, np.minimum(value, field.sdf), value)
    value = np.where(np.abs(value) < ZERO, -ZERO, value)
    where = free & (mine | (field.sdf > 0))
    part = int(np.bincount(field.owner[solid]).argmax())
    gained = where & (field.sdf > 0) & ((value < 0) | (field.owner < 0))
    if _pieces(np.where(where, value < 0, solid)) > _pieces(solid):
        return field
    return dataclasses.replace(
        field,
        sdf=np.where(where, value, field.sdf).astype(field.sdf.dtype),
        owner=np.where(gained, np.int16(part), field.owner),
    )


def _inner(boxes: np.ndarray, solid: np.ndarray) -> np.ndarray:
    """[N] panels that are no outer walls: more than ``OUTER`` from both ends of the body."""
    cells = np.argwhere(solid)
    thin = (boxes[:, 3:] - boxes[:, :3]).argmin(1)
    rows = np.arange(len(boxes))
    first, last = cells.min(0)[thin], cells.max(0)[thin]
    return (boxes[rows, thin] > first + OUTER) & (boxes[rows, thin + 3] < last - OUTER)


def _walls(boxes: np.ndarray, solid: np.ndarray) -> np.ndarray:
    """[X, Y, Z] cells that are drawn in one piece with outer panels [N, 6], in their planes."""
    thin = (boxes[:, 3:] - boxes[:, :3]).argmin(1)
    across = np.arange(3) == thin[:, None]
    low, high = np.where(across, boxes[:, :3], 0), np.where(across, boxes[:, 3:], max(solid.shape))
    layers = distance_to(np.concatenate([low, high], 1), solid.shape) < NEAR
    labels = np.zeros(solid.shape, np.int32)
    ndimage.label(solid & layers, output=labels)
    own = labels[solid & (distance_to(boxes, solid.shape) < NEAR)]
    return np.isin(labels, own[own > 0])


def _thick(solid: np.ndarray) -> np.ndarray:
    """[X, Y, Z] cells of what is ``SOLID`` thick along every axis."""
    cells = solid.astype(np.uint8)  # faster than ndimage.binary_opening
    cells = ndimage.minimum_filter(cells, SOLID, mode="constant")
    return ndimage.maximum_filter(cells, SOLID, mode="constant", origin=-1) > 0


def _pieces(solid: np.ndarray) -> int:
    """Connected pieces of a body that are ``PIECE`` of it at least."""
    labels = np.zeros(solid.shape, np.int32)
    ndimage.label(solid, output=labels)
    return int((np.bincount(labels[solid]) >= PIECE * solid.sum()).sum())


def aligned(boxes: np.ndarray, solid: np.ndarray, sdf: np.ndarray) -> np.ndarray:
    """Boxes [N, 6] in cells, moved along their thinnest sides to where they are drawn.

    A board is moved to where the most of it is drawn, where that is clearly more than where it is.
    Then each of its faces is moved to a drawn one nearby.

    Args:
      solid: [X, Y, Z] what is drawn of the body. sdf: its signed distances, positive in others.
    """
    boxes = boxes.copy()
    for box in boxes:
        axis = int((box[3:] - box[:3]).argmin())
        window = [
            slice(max(int(np.ceil(box[a] + 2)), 0), max(int(np.floor(box[a + 3] - 2)) + 1, 0))
            for a in range(3)
        ]
        window[axis] = slice(None)
        layers = np.moveaxis(solid[tuple(window)], axis, 0)
        if min(layers.shape) < 3:
            continue
        ends = box[[axis, axis + 3]] + _move(layers.mean((1, 2)), *box[[axis, axis + 3]])
        middle = np.median(np.moveaxis(sdf[tuple(window)], axis, 0), (1, 2))
        low, high = _face(middle, ends[0], 1), _face(middle, ends[1], -1)
        box[[axis, axis + 3]] = (low, high) if high - low >= 1 else ends
    return boxes


def _move(drawn: np.ndarray, low: float, high: float) -> int:
    """Layers by which a board between two places is moved; ``drawn`` [Z]: share of each layer that
    is drawn."""
    thick, first = max(round(high - low), 2), round(low + 0.5)
    moves = [m for m in range(-SHIFT, SHIFT + 1) if 2 <= first + m <= len(drawn) - thick - 2]
    if 0 not in moves:
        return 0
    own = {m: drawn[first + m : first + m + thick].mean() for m in moves}
    worth = {
        m: own[m]
        - AMONG * drawn[first + m - 2 : first + m].mean()
        - AMONG * drawn[first + m + thick : first + m + thick + 2].mean()
        - FAR_AWAY * abs(m)
        for m in moves
    }
    best = max(moves, key=lambda m: worth[m])
    return best if worth[best] > worth[0] + CLEARER and own[best] >= DRAWN else 0


def _face(middle: np.ndarray, place: float, inwards: int) -> float:
    """The place nearest to ``place``, within ``REACH``, where the median distance [Z] of
    layers becomes negative in direction ``inwards``; without one ``place``."""
    positive = middle > 0
    ends = positive[:-1] & ~positive[1:] if inwards > 0 else ~positive[:-1] & positive[1:]
    at = np.flatnonzero(ends)
    if not len(at):
        return place
    places = at + middle[at] / (middle[at] - middle[at + 1])
    nearest = places[np.abs(places - place).argmin()]
    return float(nearest) if abs(nearest - place) <= REACH else place


def _agree(drawn: np.ndarray, solid: np.ndarray, distance: np.ndarray, legs: Legs | None) -> bool:
    """Whether panels at a ``distance`` [X, Y, Z] and legs are what is drawn of the body."""
    near = distance
    if legs is not None:
        near = np.minimum(near, distance_to(to_cells(legs.boxes, len(near) - 2), near.shape))
    around = ndimage.binary_dilation(drawn, iterations=NEAR)
    inside = around[distance < 0]
    shown = inside.mean() if len(inside) else 0.0
    return bool((near[solid] < NEAR).mean() >= EXPLAINED and shown >= SHOWN)


def _outside(lower: np.ndarray, upper: np.ndarray, solid: np.ndarray) -> np.ndarray:
    """[X, Y, Z] cells outside a box where what is drawn stays: those farther than ``NEAR``, and
    those between the box and something solid there."""
    stays = np.zeros_like(solid)
    for axis in range(3):
        for place, outwards in ((lower[axis], -1), (upper[axis], 1)):
            if outwards > 0:
                layers, drawn = np.moveaxis(stays, axis, 0), np.moveaxis(solid, axis, 0)
                at = int(np.ceil(place))
            else:
                layers, drawn = np.moveaxis(stays, axis, 0)[::-1], np.moveaxis(solid, axis, 0)[::-1]
                at = len(solid) - 1 - int(np.floor(place))
            at = max(at, 0)
            if at + NEAR >= len(solid):
                continue
            layers[at + NEAR :] = True
            layers[at : at + NEAR] |= ndimage.binary_dilation(drawn[at + NEAR])
    return stays


def _other_boards(solid: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """[X, Y, Z] cells of boards that are drawn where there is no panel."""
    labels = np.zeros(solid.shape, np.int32)
    ndimage.label(solid & (distance >= BESIDE), output=labels)
    stays = np.zeros_like(solid)
    for k, window in enumerate(ndimage.find_objects(labels), start=1):
        own = labels[window] == k
        sides = sorted(own.shape)
        if sides[0] <= THICK and sides[1] >= WIDE and own.mean() >= WHOLE:
            stays[window] |= own
    if stays.any():  # up to the panels that they meet
        block = np.ones((3, 3, 3), bool)
        stays = ndimage.binary_dilation(stays, block, 2 * BESIDE + 2, mask=solid | stays)
    return stays


def fitted(boxes: np.ndarray, gap: float = GAP) -> np.ndarray:
    """Boxes [N, 6] in cells, made to meet.

    Faces that follow one another within ``LEVEL`` are moved to their mean, weighted by their areas,
    unless the first and the last of them are more than ``SPREAD`` apart.
    An edge that ends up to ``gap`` before a panel that lies across it, or up to ``OVER`` beyond,
    ends at that panel's far face. A panel lies across an edge where its own thinnest side is along
    the edge's axis and the two overlap in both others, by nearly half of the one that ends.
    """
    sides = boxes[:, 3:] - boxes[:, :3]
    boxes = boxes.copy()
    for face in range(6):
        areas = np.delete(sides, face % 3, 1).prod(1)
        boxes[:, face] = _levelled(boxes[:, face], areas)
    thin = (boxes[:, 3:] - boxes[:, :3]).argmin(1)
    _thicken(boxes)
    met = boxes.copy()
    for k in range(len(boxes)):
        for axis in range(3):
            if axis == thin[k]:
                continue
            (first, low), (last, high) = (
                _meeting(boxes, thin, k, axis, end, gap) for end in (axis, axis + 3)
            )
            if first != last:
                met[k, [axis, axis + 3]] = low, high
    sound = met[:, 3:] - met[:, :3] > 1
    return np.where(np.tile(sound, 2), met, boxes)


def _levelled(places: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Places [N] of faces; those that follow one another within ``LEVEL`` become their mean,
    unless they spread over more than ``SPREAD``."""
    places = places.copy()
    order = np.argsort(places, kind="stable")
    for group in np.split(order, np.flatnonzero(np.diff(places[order]) > LEVEL) + 1):
        if np.ptp(places[group]) > SPREAD:  # one after the other, none at its neighbour's place
            continue
        places[group] = np.average(places[group], weights=weights[group] + 1e-6)
    return places


def _thicken(boxes: np.ndarray) -> None:
    """Make panels ``THINNEST`` thick at least, in place."""
    middle = (boxes[:, :3] + boxes[:, 3:]) / 2
    half = np.maximum(boxes[:, 3:] - boxes[:, :3], THINNEST) / 2
    boxes[:, :3], boxes[:, 3:] = middle - half, middle + half


def _meeting(
    boxes: np.ndarray, thin: np.ndarray, k: int, axis: int, end: int, gap: float
) -> tuple[int, float]:
    """The panel that a panel's edge ends at, the nearest that lies across it, of several the
    outermost, and its far face; without one -1 - ``end`` and where it ends now."""
    place, outwards = boxes[k, end], 1 if end > 2 else -1
    found = []
    others = np.array([a for a in range(3) if a != axis])
    own = boxes[k, others + 3] - boxes[k, others]
    for j in np.flatnonzero(thin == axis):
        low = np.maximum(boxes[k, others], boxes[j, others])
        high = np.minimum(boxes[k, others + 3], boxes[j, others + 3])
        if j == k or (high - low < 0.5 * own - OVER).any() or (high <= low - LEVEL).any():
            continue
        near, far = (boxes[j, axis], boxes[j, axis + 3])[::outwards]
        before, beyond = (near - place) * outwards, (place - far) * outwards
        if before < gap and beyond < OVER:
            found.append((max(before, beyond, 0.0), -far * outwards, int(j), far))
    return min(found)[2:] if found else (-1 - end, place)


def distance_to(boxes: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """[X, Y, Z] cells to the nearest of boxes, below 0 inside, ``BESIDE`` at most."""
    distance = np.full(shape, BESIDE, np.float32)
    for box in boxes:
        first = np.maximum(np.floor(box[:3] - BESIDE), 0).astype(int)
        last = np.clip(np.ceil(box[3:] + BESIDE) + 1, 0, shape).astype(int)
        middle, half = (box[:3] + box[3:]) / 2, (box[3:] - box[:3]) / 2
        apart = [
            np.abs(np.arange(a, b) - m) - h
            for a, b, m, h in zip(first, last, middle, half, strict=True)
        ]
        own = np.maximum(np.maximum(apart[0][:, None, None], apart[1][:, None]), apart[2])
        window = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
        distance[window] = np.minimum(distance[window], own)
    return distance

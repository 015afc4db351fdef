"""A field whose body is built of the panels that a layout has.

At the resolution of the voxels boards are one or two cells thick: a structure network draws shelves
and dividers as crumbs, and outer walls with ragged edges. A set of boxes (``panel_table``) is not.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from uniart_jax.voxels.isosurface import ZERO, DenseField
from uniart_jax.voxels.leg_table import Legs
from uniart_jax.voxels.panel_table import Panels

# lengths in sub-cells, of a grid with 128 along its side
THINNEST = 2.2  # that a panel is made at least
LEVEL = 1.2  # by which faces of one plane differ
SPREAD = 2.0  # and all of them together, at most
GAP, OVER = 12.0, 3.0  # that a panel ends before, and beyond, one that it meets, at most
SHIFT = 6  # that a panel is moved to where it is drawn, at most
DRAWN, CLEARER = 0.35, 0.1  # share of its layers that is drawn there, and its gain, at least
AMONG, FAR_AWAY = 0.25, 0.01  # what drawn layers beside it, and each cell of a move, count
FARTHEST = 3.0  # to which distances are cut off
BESIDE = 6  # to a panel, within which what is drawn is the panel's
WIDE, THICK = 10, 8  # sides of another board at least, and its thickness at most
WHOLE = 0.6  # share of its box that it fills at least
NEAR = 4  # outside the box around all panels, to which what is drawn of the body has to reach
EXPLAINED, SHOWN = 0.85, 0.8  # shares of the drawn body and of the panels that agree, at least


def with_panels(
    field: DenseField, body: Sequence[int], panels: Panels, legs: Legs | None = None
) -> DenseField | None:
    """A field whose body is these panels, other boards that are drawn whole, and what of it stands
    out of the box around them.

    Faces of nearly one plane are made one; panels are made to meet (``fitted``).

    Args:
      body: owners that do not move. legs: what it stands on, if that is known.

    Returns:
      A new field; cells of other parts stay as they are. None where the field shows another body:
      less than ``EXPLAINED`` of it is near panels or legs, or less than ``SHOWN`` of the panels is
      near something that is drawn.
    """
    mine = np.isin(field.owner, body)
    solid = (field.sdf < 0) & mine
    if not solid.any() or not len(panels):
        return None
    size = field.sdf.shape[0] - 2
    boxes = fitted(_aligned((panels.boxes + 0.5) * size + 0.5, solid))
    distance = _distance(boxes, field.sdf.shape)
    if not _agree(field.sdf < 0, solid, distance, legs):
        return None
    free = ~np.asarray(ndimage.binary_dilation((field.sdf < 0) & ~mine), bool)
    for axis in range(3):  # the layer around the grid stays outside
        np.moveaxis(free, axis, 0)[[0, -1]] = False
    stays = _outside(boxes[:, :3].min(0), boxes[:, 3:].max(0), solid)
    stays |= _other_boards(solid, distance)
    distance = np.clip(distance, -FARTHEST, FARTHEST)
    where = free & (mine | (field.sdf > 0))
    value = np.where(stays, np.minimum(distance, field.sdf), distance)
    value = np.where(np.abs(value) < ZERO, -ZERO, value)
    part = int(np.bincount(field.owner[solid]).argmax())
    gained = where & (field.sdf > 0) & ((value < 0) | (field.owner < 0))
    return dataclasses.replace(
        field,
        sdf=np.where(where, value, field.sdf).astype(field.sdf.dtype),
        owner=np.where(gained, np.int16(part), field.owner),
    )


def _aligned(boxes: np.ndarray, solid: np.ndarray) -> np.ndarray:
    """Boxes [N, 6] in cells, each moved along its thinnest side to where the most of it is drawn,
    where that is clearly more than where it is."""
    boxes = boxes.copy()
    for box in boxes:
        sides = box[3:] - box[:3]
        axis = int(sides.argmin())
        window = tuple(
            slice(max(int(np.ceil(box[a] + 2)), 0), max(int(np.floor(box[a + 3] - 2)) + 1, 0))
            for a in range(3)
            if a != axis
        )
        layers = np.moveaxis(solid, axis, 0)[(slice(None), *window)]
        if min(layers.shape) < 3:
            continue
        drawn = layers.mean((1, 2))
        thick, first = max(round(float(sides[axis])), 2), round(float(box[axis]) + 0.5)
        moves = [m for m in range(-SHIFT, SHIFT + 1) if 2 <= first + m <= len(drawn) - thick - 2]
        if 0 not in moves:
            continue
        own = {m: drawn[first + m : first + m + thick].mean() for m in moves}
        worth = {
            m: own[m]
            - AMONG * drawn[first + m - 2 : first + m].mean()
            - AMONG * drawn[first + m + thick : first + m + thick + 2].mean()
            - FAR_AWAY * abs(m)
            for m in moves
        }
        best = max(moves, key=lambda m: worth[m])
        if worth[best] > worth[0] + CLEARER and own[best] >= DRAWN:
            box[[axis, axis + 3]] += best
    return boxes


def _agree(drawn: np.ndarray, solid: np.ndarray, distance: np.ndarray, legs: Legs | None) -> bool:
    """Whether panels at a ``distance`` [X, Y, Z] and legs are what is drawn of the body."""
    near = distance
    if legs is not None:
        near = np.minimum(near, _distance((legs.boxes + 0.5) * (len(near) - 2) + 0.5, near.shape))
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
    labels, count = ndimage.label(solid & (distance >= BESIDE))
    stays = np.zeros_like(solid)
    for k, window in enumerate(ndimage.find_objects(labels, count), start=1):
        own = labels[window] == k
        sides = sorted(own.shape)
        if sides[0] <= THICK and sides[1] >= WIDE and own.mean() >= WHOLE:
            stays[window] |= own
    if stays.any():  # up to the panels that they meet
        block = np.ones((3, 3, 3), bool)
        stays = ndimage.binary_dilation(stays, block, BESIDE, mask=solid | stays)
    return stays


def fitted(boxes: np.ndarray) -> np.ndarray:
    """Boxes [N, 6] in cells, made to meet.

    Faces that lie within ``LEVEL`` of one another are moved to their mean, weighted by their areas.
    An edge that ends up to ``GAP`` before a panel that lies across it, or up to ``OVER`` beyond,
    ends at that panel's far face. A panel lies across an edge where its own thinnest side is along
    the edge's axis and the two overlap in both others, by half of the one that ends.
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
                _meeting(boxes, thin, k, axis, end) for end in (axis, axis + 3)
            )
            if first != last:
                met[k, [axis, axis + 3]] = low, high
    sound = met[:, 3:] - met[:, :3] > 1
    return np.where(np.tile(sound, 2), met, boxes)


def _levelled(places: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Places [N] of faces; those that follow one another within ``LEVEL`` become their mean."""
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


def _meeting(boxes: np.ndarray, thin: np.ndarray, k: int, axis: int, end: int) -> tuple[int, float]:
    """The panel that a panel's edge ends at, the nearest that lies across it, of several the
    outermost, and its far face; without one -1 - ``end`` and where it ends now."""
    place, outwards = boxes[k, end], 1 if end > 2 else -1
    found = []
    others = np.array([a for a in range(3) if a != axis])
    own = boxes[k, others + 3] - boxes[k, others]
    for j in np.flatnonzero(thin == axis):
        low = np.maximum(boxes[k, others], boxes[j, others])
        high = np.minimum(boxes[k, others + 3], boxes[j, others + 3])
        if j == k or (high - low < 0.5 * own - GAP).any() or (high <= low - LEVEL).any():
            continue
        near, far = (boxes[j, axis], boxes[j, axis + 3])[::outwards]
        before, beyond = (near - place) * outwards, (place - far) * outwards
        if before < GAP and beyond < OVER:
            found.append((max(before, beyond, 0.0), -far * outwards, int(j), far))
    return min(found)[2:] if found else (-1 - end, place)


def _distance(boxes: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
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

"""What an object stands on, read off its meshes: what the layout network's legs train on. No jax.

Horizontal slices of what does not move, from the floor up to the lowest moving part. Where they are
sparse, the outlines that follow one another are legs if they reach from the floor to what they
carry and their edges lie on lines. Where the slices are one outline that grows at once, it is a
plinth.
"""

from __future__ import annotations

from typing import NamedTuple

import manifold3d
import numpy as np

from uniart_jax.data.bodies import body_bounds, body_rows, body_solids, frame_change
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.voxels.leg_table import Legs
from uniart_jax.voxels.part_table import MOST_LEGS

STEP = 0.01  # object units between slices
SPARSE = 0.4  # share of the object's rectangle that a slice of legs fills at most
REACHES = 0.8  # share of the slices that a leg is in at least
LATE = 0.15  # share of the slices below its lowest at most
GAP = 12  # slices in which a leg may be part of something else
ON_LINE, STRAIGHT = 0.015, 0.6  # object units off the lines at most, in this share of the slices
ALONE = 0.95  # share of what is there that legs are, where nothing else is
PLINTH = 0.28  # object units; the height of a plinth at most
WHOLE = 0.7  # share of its rectangle that a plinth's outline, holes filled, takes at least
SAME, GROWN = 0.006, 0.012  # object units by which a plinth's edges, and what is on it, differ
SPECK = 1e-5  # area of an outline that is none


class Outline(NamedTuple):
    """A closed curve of a slice.

    Attributes:
      rectangle: [4] x0, y0, x1, y1. area: with, outer: without its holes cut out.
    """

    rectangle: np.ndarray
    area: float
    outer: float


def legs_of(closed: ArticulatedObject, shown: ArticulatedObject | None = None) -> Legs | None:
    """The legs of an object, in the frame of a shown state of it.

    Args:
      closed: normalised, at rest. shown: the same object at another state; None: as it is.

    Returns:
      Legs, perhaps none at all. None where they cannot be told: a mesh is not closed, or there are
      more than ``MOST_LEGS``.
    """
    solids = body_solids(closed)
    if solids is None:
        return None
    still = body_rows(closed)
    lower, upper = body_bounds(closed)
    moving = [p.mesh.bounds[0, 2] for k, p in enumerate(closed.parts) if k not in still]
    ceiling = min([upper[2], *moving])
    legs = _sparse_legs(solids, lower, upper, ceiling)
    if not len(legs):
        legs = _plinth(solids, lower) or legs
    if len(legs) > MOST_LEGS:
        return None
    return legs if shown is None else _moved(legs, *frame_change(closed, shown))


def _moved(legs: Legs, scale: np.ndarray, by: np.ndarray) -> Legs:
    """Legs of an object whose body is scaled and moved by these."""
    flat = lambda rows: rows * np.tile(scale[:2], 2) + np.tile(by[:2], 2)  # noqa: E731
    heights = legs.heights * scale[2] + by[2]
    return Legs(flat(legs.lower), flat(legs.upper), heights, legs.fill, legs.plinth, legs.alone)


def _slice(solids: list[manifold3d.Manifold], height: float) -> list[Outline]:
    found = []
    for solid in solids:
        for piece in solid.slice(float(height)).decompose():
            if piece.area() <= SPECK:
                continue
            curves = piece.to_polygons()
            points = np.concatenate(curves)
            rectangle = np.concatenate([points.min(0), points.max(0)])
            outer = max(abs(_signed_area(curve)) for curve in curves)
            found.append(Outline(rectangle, piece.area(), outer))
    return found


def _signed_area(curve: np.ndarray) -> float:
    x, y = np.asarray(curve).T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def _around(outlines: list[Outline]) -> np.ndarray:
    """[4] the rectangle around outlines."""
    rectangles = np.stack([o.rectangle for o in outlines])
    return np.concatenate([rectangles[:, :2].min(0), rectangles[:, 2:].max(0)])


def _sparse_legs(
    solids: list[manifold3d.Manifold], lower: np.ndarray, upper: np.ndarray, ceiling: float
) -> Legs:
    """Legs below the first slice that is not sparse."""
    area = float((upper - lower)[:2].prod())
    layers: list[list[Outline]] = []
    for height in np.arange(lower[2] + STEP / 2, ceiling, STEP):
        outlines = _slice(solids, height)
        if sum(o.area for o in outlines) >= SPARSE * area:
            break
        layers.append(outlines)
    count = len(layers)
    total = sum(o.area for layer in layers for o in layer)
    if count < 2 or not total:
        return _none()
    legs = [leg for chain in _chains(layers) if (leg := _leg(chain, count)) is not None]
    if not legs:
        return _none()
    ends = np.stack([leg.ends for leg in legs])
    heights = lower[2] + np.array([[0, STEP * leg.layers] for leg in legs])
    fill = np.array([leg.fill for leg in legs])
    alone = sum(leg.area for leg in legs) > ALONE * total
    return Legs(ends[:, :4], ends[:, 4:], heights, fill, np.zeros(len(legs), bool), bool(alone))


class Leg(NamedTuple):
    """A leg of a stack of slices.

    Attributes:
      ends: [8] rectangles at the floor and at the upper end. layers: that it is high.
      fill: share of the rectangles that its slices fill. area: sum of its slices.
    """

    ends: np.ndarray
    layers: int
    fill: float
    area: float


def _none() -> Legs:
    none = np.zeros((0, 4))
    return Legs(none, none, np.zeros((0, 2)), np.zeros(0), np.zeros(0, bool), False)


def _chains(layers: list[list[Outline]]) -> list[dict[int, Outline]]:
    """Outlines of successive layers that lie over one another: {layer: outline} each. A layer in
    which several are one outline, as where a rail joins legs, is none of theirs."""
    chains: list[dict[int, Outline]] = []
    for k, layer in enumerate(layers):
        live = [chain for chain in chains if k - max(chain) <= GAP]
        for outline in layer:
            shared = [_shared(chain, outline) for chain in live]
            below = [chain for chain, area in zip(live, shared, strict=True) if area > 0]
            if not below:
                chains.append({k: outline})
            elif len(below) == 1:
                other = below[0].get(k)
                before = {at: o for at, o in below[0].items() if at < k}
                if other is None or _shared(before, other) < max(shared):
                    below[0][k] = outline
    return chains


def _shared(chain: dict[int, Outline], outline: Outline) -> float:
    """The area that an outline's rectangle shares with that of a chain's last layer."""
    last, now = chain[max(chain)].rectangle, outline.rectangle
    sides = np.minimum(last[2:], now[2:]) - np.maximum(last[:2], now[:2])
    return float(np.maximum(sides, 0).prod())


def _leg(chain: dict[int, Outline], count: int) -> Leg | None:
    """A chain of outlines in ``count`` layers as a leg; None where it is none."""
    at = np.array(sorted(chain))
    if len(at) < REACHES * count - 1 or at[0] > LATE * count + 1:
        return None
    edges = np.stack([chain[k].rectangle for k in at])
    areas = np.array([chain[k].area for k in at])
    layers = int(at[-1]) + 1
    share = (at + 0.5) / layers
    lower, upper = _lines(share, edges)
    fitted = lower + share[:, None] * (upper - lower)
    on = np.abs(fitted - edges).max(1) < ON_LINE
    if on.mean() < STRAIGHT:
        return None
    sides = np.maximum((fitted[on, 2:] - fitted[on, :2]).prod(1), 1e-6)
    fill = float(np.median(areas[on] / sides))
    return Leg(np.concatenate([lower, upper]), layers, fill, float(areas[on].sum()))


def _lines(share: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[4] edges at both ends, 0 and 1, of lines that few outliers do not move."""
    import scipy.stats  # takes as long as all of SciPy's others

    if len(share) <= 2:
        return edges.mean(0), edges.mean(0)
    lines = [scipy.stats.theilslopes(edge, share) for edge in edges.T]
    first = np.array([line.intercept for line in lines])
    return first, first + np.array([line.slope for line in lines])


def _plinth(solids: list[manifold3d.Manifold], lower: np.ndarray) -> Legs | None:
    """The plinth of an object without legs; None where there is none."""
    first = None
    for k in range(int(PLINTH / STEP)):
        outlines = _slice(solids, lower[2] + (k + 0.5) * STEP)
        if not outlines:
            return None
        around = _around(outlines)
        if first is None:
            first = around
            if sum(o.outer for o in outlines) < WHOLE * float((first[2:] - first[:2]).prod()):
                return None
        elif np.abs(around - first).max() >= SAME:
            grown = np.concatenate([first[:2] - around[:2], around[2:] - first[2:]]).max()
            if grown < GROWN or k < 2:
                return None
            heights = np.array([[lower[2], lower[2] + k * STEP]])
            return Legs(first[None], first[None], heights, np.ones(1), np.ones(1, bool), True)
    return None

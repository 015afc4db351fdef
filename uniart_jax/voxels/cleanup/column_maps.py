"""Maps [U, V] of columns of cells as they are seen from one side: how deep each begins, gaps among
them that are closed, and what is round or tilted, told from what is flat with ripples."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import ndimage

GAP = 2  # gaps of twice this width are closed
HOLE = 100  # columns; an enclosed hole of no more is closed
ROUND = 14  # sub-cells, that a round face is wide at least, so that its edges do not count
# the ends of a round face are so much deeper than its middle, of all its depths, and in sub-cells
BULGE, LEAST_BULGE = 0.25, 0.4
PARTLY = (0.2, 0.8)  # of that much, that it is deeper between middle and ends
# sub-cells that a tilted face rises by at least, and share of the depths' variance that is its rise
RISE, STRAIGHT = 1.5, 0.8


def heights(sdf: np.ndarray, solid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where columns along the first axis of ``sdf`` [D, U, V] enter ``solid``: first cell [U, V], D
    where there is none, and the place between cells where the distance is zero [U, V]."""
    first = np.where(solid.any(0), solid.argmax(0), len(solid))
    inside = np.take_along_axis(sdf, np.minimum(first, len(sdf) - 1)[None], 0)[0]
    outside = np.take_along_axis(sdf, np.clip(first - 1, 0, None)[None], 0)[0]
    step = np.where((outside > 0) & (inside < 0), inside / np.minimum(inside - outside, -1e-6), 0.5)
    return first, first - np.clip(step, 0, 1)


def closed(columns: np.ndarray, gap: int = GAP) -> np.ndarray:
    """[U, V] with gaps of twice ``gap`` closed."""
    padded: Any = np.pad(columns, gap)
    for turn in (ndimage.binary_dilation, ndimage.binary_erosion):  # by a square: an axis a time
        padded = turn(turn(padded, np.ones((2 * gap + 1, 1))), np.ones((1, 2 * gap + 1)))
    return padded[gap:-gap, gap:-gap]


def without_small_holes(columns: np.ndarray) -> np.ndarray:
    """[U, V] with what is enclosed by them filled, up to ``HOLE`` columns."""
    found: Any = ndimage.label(ndimage.binary_fill_holes(columns) & ~columns)
    holes = found[0]
    small = np.bincount(holes.ravel()) <= HOLE
    small[0] = False
    return columns | small[holes]


def corners(columns: np.ndarray, share: float) -> np.ndarray:
    """[4] means of the corners of a map [U, V], each ``share`` of it wide and high."""
    a, b = (max(1, round(share * n)) for n in columns.shape)
    ends = ((slice(None, a), slice(-a, None)), (slice(None, b), slice(-b, None)))
    return np.array([columns[u, v].mean() for u in ends[0] for v in ends[1]])


def round_pieces(columns: np.ndarray, height: np.ndarray, edge: int) -> np.ndarray:
    """[U, V] bool: the connected pieces of columns that are deeper at both ends of a direction than
    in its middle, as those of a cylinder are; those of a flat face with ripples, or of a tilted
    one, are not.

    Args:
      columns: [U, V] bool. height: [U, V] where they begin, sub-cells. edge: pieces that are no
        wider are edges of panels, and not round.
    """
    labelled: Any = ndimage.label(columns)
    pieces, found = labelled[0], np.zeros_like(columns)
    for piece, place in enumerate(ndimage.find_objects(pieces), 1):
        mine = pieces[place] == piece
        if min(mine.shape) <= edge:
            continue
        depth = height[place][mine]
        spread = float(np.ptp(np.percentile(depth, [5, 95])))
        for side, along in zip(mine.shape, np.nonzero(mine), strict=True):
            if side < ROUND:
                continue
            at = along / (side - 1)
            off = np.abs(at - 0.5)
            between, middle = depth[(off > 0.25) & (off < 0.375)], depth[off <= 0.25]
            if not (len(between) and len(middle)):
                continue
            ends = depth[at <= 0.25], depth[at >= 0.75]
            bulge = min(map(np.median, ends)) - np.median(middle)
            if bulge <= max(BULGE * spread, LEAST_BULGE):
                continue
            # what is round is deeper step by step; ripples and raised panels are not
            if PARTLY[0] < (np.median(between) - np.median(middle)) / bulge < PARTLY[1]:
                found[place] |= mine
    return found


def with_what_goes_on(
    found: np.ndarray, columns: np.ndarray, height: np.ndarray, step: float
) -> np.ndarray:
    """[U, V] bool: columns that were ``found``, and all of ``columns`` that join them where no
    neighbours differ in height [U, V] by more than ``step``."""
    if not found.any():
        return found
    smooth = np.ones(height.shape, bool)
    for axis in (0, 1):
        even = np.moveaxis(smooth, axis, 0)
        steps = np.moveaxis(np.abs(np.diff(height, axis=axis)) > step, axis, 0)
        even[:-1] &= ~steps
        even[1:] &= ~steps
    labelled: Any = ndimage.label(columns & smooth)
    pieces = labelled[0]
    joined = np.unique(pieces[found])
    return found | np.isin(pieces, joined[joined > 0])


def tilted(columns: np.ndarray, height: np.ndarray) -> bool:
    """Whether heights [U, V] of columns [U, V], some of them, are those of a plane that rises by
    more than ``RISE`` over them, and that is ``STRAIGHT`` of their variance."""
    places = np.argwhere(columns).astype(np.float64)
    places -= places.mean(0)
    off = height[columns] - height[columns].mean()
    plane = places @ np.linalg.lstsq(places, off, rcond=None)[0]
    return bool(np.ptp(plane) > RISE and plane.var() > STRAIGHT * off.var())

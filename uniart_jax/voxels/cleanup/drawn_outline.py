"""The outline of a part that is round about an axis, as its voxels show it."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import median_filter

SECTORS = 32  # about the axis
WHOLE = 0.5  # least share of the sectors of a layer in which the part is
CORNERLESS = 0.35  # quantile over the sectors: a square's is its half side, spouts do not count
ALONG = 5  # layers, of the median along the axis
ROUNDS = 4  # of moving the axis to the middle
EDGE = 0.3  # cells, from the middle of the outermost cell of a sector to where the part ends
ASIDE = 0.25  # of the radius, beyond which a sector says nothing about where the middle is


def drawn_outline(mine: np.ndarray, middle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where a part's axis is, and how far the part reaches from it layer by layer.

    Args:
      mine: [D, U, V] bool, the part's cells, D along its axis. middle: [2] about where the axis
        is, cells.

    Returns:
      The middle [2] and radii [D], cells; NaN for layers that have too little of the part to tell.
    """
    layer, *places = np.nonzero(mine)
    angles = (np.arange(SECTORS) + 0.5) * 2 * np.pi / SECTORS - np.pi
    rays = np.stack([np.cos(angles), np.sin(angles)])

    def reaches(middle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        u, v = (place - m for place, m in zip(places, middle, strict=True))
        sector = ((np.arctan2(v, u) / np.pi + 1) / 2 * SECTORS).astype(int) % SECTORS
        far = np.full((len(mine), SECTORS), -np.inf)
        np.maximum.at(far, (layer, sector), np.hypot(u, v) + EDGE)
        far[np.isinf(far)] = np.nan
        whole = np.isfinite(far).mean(1) > WHOLE
        return np.flatnonzero(whole), far[whole]

    middle = np.asarray(middle, np.float64)
    for turn in range(ROUNDS):
        _, far = reaches(middle)
        if not len(far):
            break
        radius = np.nanquantile(far, CORNERLESS, axis=1, keepdims=True)
        beyond = np.nan_to_num(np.clip(far - radius, -ASIDE * radius, ASIDE * radius))
        beyond = np.median(beyond, axis=0)
        if turn:  # spouts and handles
            beyond[np.abs(beyond) > 0.8 * ASIDE * np.median(radius)] = 0
        middle = middle + 2 * (rays * beyond).mean(1)
    whole, far = reaches(middle)
    radii = np.full(len(mine), np.nan)
    if len(whole):
        radii[whole] = np.nanquantile(far, CORNERLESS, axis=1)
        radii[whole] = median_filter(radii[whole], ALONG, mode="nearest")
    return middle, radii

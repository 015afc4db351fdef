"""The outline of a part that is round about an axis, as its voxels show it."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_erosion, median_filter

SECTORS = 32  # about the axis
WHOLE = 0.5  # least share of the sectors of a layer in which the part is
QUANTILE = 0.35  # over the sectors: of a square about half its side; spouts do not count
TORN = 0.4  # of how far a layer reaches in its farther sectors: those that reach less are torn
ALONG = 5  # layers, of the median along the axis
ROUNDS = 12  # of moving the axis to the middle ...
ROBUST = 4  # ... in the last of which outlying sectors (spouts, handles) do not count
FARTHEST = 0.5  # of the radius, that the middle is moved at most; else it stays as given
BESIDE = np.array([[[0, 1, 0], [1, 1, 1], [0, 1, 0]]], bool)  # cells of a layer next to one
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
    border = mine > np.asarray(binary_erosion(mine, BESIDE))  # of each layer
    layer, *places = np.nonzero(border)
    angles = (np.arange(SECTORS) + 0.5) * 2 * np.pi / SECTORS - np.pi
    rays = np.stack([np.cos(angles), np.sin(angles)])

    def reaches(middle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        u, v = (place - m for place, m in zip(places, middle, strict=True))
        sector = ((np.arctan2(v, u) / np.pi + 1) / 2 * SECTORS).astype(int) % SECTORS
        far = np.zeros((len(mine), SECTORS))
        np.maximum.at(far, (layer, sector), np.hypot(u, v) + EDGE)
        far[far < TORN * np.quantile(far, 0.8, axis=1, keepdims=True)] = np.nan
        far[far == 0] = np.nan
        whole = np.isfinite(far).mean(1) > WHOLE
        return np.flatnonzero(whole), far[whole]

    given = middle = np.asarray(middle, np.float64)
    for turn in range(ROUNDS):
        _, far = reaches(middle)
        if not len(far):
            return given, np.full(len(mine), np.nan)
        radius = np.nanquantile(far, QUANTILE, axis=1, keepdims=True)
        beyond = np.nan_to_num(np.clip(far - radius, -ASIDE * radius, ASIDE * radius))
        beyond = np.median(beyond, axis=0)
        if turn >= ROUNDS - ROBUST:
            beyond[np.abs(beyond) > 0.8 * ASIDE * np.median(radius)] = 0
        middle = middle + 2 * (rays * beyond).mean(1)
        if np.hypot(*(middle - given)) > FARTHEST * np.median(radius):
            middle = given
            break
    whole, far = reaches(middle)
    radii = np.full(len(mine), np.nan)
    if len(whole):
        radii[whole] = np.nanquantile(far, QUANTILE, axis=1)
        radii[whole] = median_filter(radii[whole], ALONG, mode="nearest")
    return middle, radii

"""What training of a flow that follows a layout does to layouts and pictures, so that it leans on
neither too much. numpy only.

A layout that a network finds lacks parts, and boxes are a little off: ``with_errors``. It also
disagrees with the picture about where things are. In training the picture is bent (``bend``) while
layout and voxels agree, so that the flow goes by the layout; a structure flow that reads pixels is
shown it as it is.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from uniart_jax.voxels.joint_code import box_corners

NO_LAYOUT = 0.1  # share of objects that are shown without a layout
EXACT = 0.4  # of the others, those whose layout is exact
LOST, MISTAKEN = 0.12, 0.1  # of parts, at strength 1
MOVED = 0.012  # deviation of a corner, object units
THINNEST = 0.004
TINTED = 0.03  # deviation of a colour, linear RGB
COARSE = 5  # a side, of the displacements that pictures are bent by


def with_errors(
    table: dict[str, np.ndarray], strength: float, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """A layout as a network might find it, its parts in random order. A tenth of the draws, but
    none at strength 0, are empty: no layout is known.

    Args:
      table: boxes [K, 6], codes [K, 9], parents [K] (root: its own), colors [K, 3]. strength: 0 =
        the truth, in random order.

    Returns:
      The same fields, and part [n]: which row of ``table`` each row was.
    """
    count = len(table["boxes"])
    absent = strength > 0 and rng.random() < NO_LAYOUT
    strength = 0.0 if rng.random() < EXACT else strength * rng.uniform(0.3, 1.0)
    roots = table["parents"] == np.arange(count)
    kept = np.flatnonzero(roots | (rng.random(count) >= LOST * strength))
    order = rng.permutation(kept)
    if absent:
        order = order[:0]
    place = np.full(count, -1)
    place[order] = np.arange(len(order))
    parents = table["parents"][order]
    while (hidden := place[parents] < 0).any():  # a lost parent's children hang on its parent
        parents = np.where(hidden, table["parents"][parents], parents)
    corners = box_corners(table["boxes"][order])
    corners = corners + rng.normal(0, MOVED * strength, corners.shape)
    size = np.maximum(corners[:, 3:] - corners[:, :3], THINNEST)
    boxes = np.concatenate([(corners[:, :3] + corners[:, 3:]) / 2, size], -1)
    codes = table["codes"][order].copy()
    wrong = (rng.random(len(order)) < MISTAKEN * strength) & ~roots[order]
    codes[wrong, 7:] = -codes[wrong][:, [8, 7]]  # opens the other way
    colors = table["colors"][order] + rng.normal(0, TINTED * strength, (len(order), 3))
    return {
        "boxes": boxes.astype(np.float32),
        "codes": codes.astype(np.float32),
        "parents": place[parents].astype(np.int32),
        "colors": np.clip(colors, 0, 1).astype(np.float32),
        "part": order.astype(np.int32),
    }


def bend(image: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    """An image [S, S, 3] displaced smoothly by up to about ``share`` of its side, by a strength
    drawn from 0 to that."""
    side = image.shape[0]
    shift = rng.normal(0, 0.5 * share * rng.random() * side, (2, COARSE, COARSE))
    at = np.linspace(0, COARSE - 1, side)
    where = np.stack(np.meshgrid(at, at, indexing="ij"))
    places = np.stack(np.meshgrid(np.arange(side), np.arange(side), indexing="ij")).astype(float)
    places += np.stack([ndimage.map_coordinates(s, where, order=1) for s in shift])
    channels = [ndimage.map_coordinates(image[..., c], places, order=1) for c in range(3)]
    return np.stack(channels, -1).astype(np.float32)

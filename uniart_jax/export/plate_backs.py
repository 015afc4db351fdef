"""Colours of the backs of doors, flaps and lids, which a picture rarely shows.

Guesses of a hidden back (``hidden_colors``) are few and blotchy, but where the front changes its
colour is known well: at the edge of a window, a panel or a frame. So a back is painted in areas, as
its front is: a place takes the median of what is guessed around it in the same area. A window that
is guessed to be dark from behind has the same outline on both sides.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial import cKDTree

from uniart_jax.objects.appearance import linear_to_srgb, srgb_to_linear

AGREE = 0.94  # cosine between a plate's normal, that of most places that are seen, and a place's
FEWEST = 100  # seen places of a plate's front, and hidden ones of its back
SAMPLES = 12_000  # seen places that areas are made of
GUESSES = 1_000  # hidden places of an area that guesses are taken from
VOTES = 15  # nearest of them that say which area one is in
APART = 0.2  # sRGB, between two colours of a front
LINKED = 600  # colours that are clustered
THROUGH = 0.03  # object units in the plate's plane, from a place of the back to the front's
SURE = 0.012  # object units from another area, from which on guesses count
AROUND = 200  # of them, of which a colour is the median
BETWEEN = 4  # nearest of them, of whose medians a colour is the mean
THICK = 0.1  # object units, that the back is behind the front at most


def even_backs(
    points: np.ndarray,
    normals: np.ndarray,
    parts: np.ndarray,
    shown: np.ndarray,
    seen: np.ndarray,
    filled: np.ndarray,
    moving: Sequence[int],
) -> np.ndarray:
    """``filled`` with the backs of plates in the areas of their fronts.

    Args:
      points, normals: [n, 3] places, object units, and unit normals. parts: [n] whose they are.
      shown: [n, 3] linear RGB by the picture. seen: [n] bool, whether that is to be believed.
      filled: [n, 3] linear RGB that are guessed of the places that are not seen.
      moving: parts that may be plates.

    Returns:
      [n, 3] linear RGB; as they were for places that are seen, or on no plate's back.
    """
    filled = filled.copy()
    for part in moving:
        mine = np.flatnonzero(parts == part)
        if not seen[mine].any():
            continue
        out = np.median(normals[mine[seen[mine]]], axis=0)
        out /= max(float(np.linalg.norm(out)), 1e-9)
        front = mine[seen[mine] & (normals[mine] @ out > AGREE)]
        back = mine[~seen[mine] & (normals[mine] @ out < -AGREE)]
        if min(len(front), len(back)) < FEWEST:
            continue
        front = front[:: -(-len(front) // SAMPLES)]
        plane = np.linalg.svd(out[None])[2][1:].T  # [3, 2]
        at, behind = points[front] @ plane, points[back] @ plane
        tree = cKDTree(at)
        areas = _areas(linear_to_srgb(shown[front]), tree)
        if (areas == areas[0]).all():
            continue
        distance, near = tree.query(behind, workers=-1)
        deep = (points[front[near]] - points[back]) @ out
        here = (distance < THROUGH) & (deep > 0) & (deep < THICK)
        area = np.where(here, areas[near], -1)
        guess = linear_to_srgb(filled[back])
        for one in np.unique(area[here]):
            edge = cKDTree(at[areas != one]).query(behind)[0]
            sure = np.flatnonzero((area == one) & (edge > SURE))
            if len(sure):
                sure = sure[:: -(-len(sure) // GUESSES)]
                color = _even(behind[sure], guess[sure], behind[area == one])
                filled[back[area == one]] = srgb_to_linear(color)
    return filled


def _even(at: np.ndarray, guess: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """[m, 3] colours of places ``wanted`` [m, 2]: means, by nearness, of medians of the colours
    ``guess`` [n, 3] around places ``at`` [n, 2]."""
    tree = cKDTree(at)
    _, around = tree.query(at, k=np.arange(1, min(AROUND, len(at)) + 1))
    even = np.median(guess[around], axis=1)
    distance, near = tree.query(wanted, k=np.arange(1, min(BETWEEN, len(at)) + 1), workers=-1)
    weight = 1 / (distance + 1e-3)
    return (even[near] * weight[..., None]).sum(1) / weight.sum(1)[:, None]


def _areas(colors: np.ndarray, tree: cKDTree) -> np.ndarray:
    """[n] which area places of a front are in, whose colours are [n, 3] sRGB and whose places in
    its plane ``tree`` holds: that of most of the places around it.

    An area has one colour: clusters of colours by average linkage, ``APART`` from one another.
    """
    some = colors[:: -(-len(colors) // LINKED)]
    label = fcluster(linkage(some, "average"), APART, "distance") - 1
    medians = np.stack([np.median(some[label == k], axis=0) for k in range(label.max() + 1)])
    alike = cKDTree(medians).query(colors)[1]
    around = tree.query(tree.data, k=np.arange(1, VOTES + 1), workers=-1)[1]
    return (alike[around][..., None] == np.arange(len(medians))).sum(1).argmax(1)

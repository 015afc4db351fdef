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

AGREE = 0.94  # cosine between a plate's normal and those of its places
MOST_AGREE = 0.5  # share of a part's seen places that look the same way, of a plate
FEWEST = 100  # seen places of a plate's front, and hidden ones of its back
SAMPLES = 12_000  # seen places that areas are made of
GUESSES = 1_000  # hidden places of an area that guesses are taken from
VOTES = 15  # nearest of them that say whose area a place is in
APART = 0.2  # sRGB, between two colours of a front
LINKED, RARE = 600, 0.04  # colours that are clustered, and share of them that make an area
THROUGH = 0.03  # object units in the plate's plane, from a place of the back to the front's
SURE = 0.012  # object units from another area, from which on guesses count
AROUND = 200  # of them, of which a colour is the median


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
        front, out = _front(normals[mine], seen[mine])
        back = mine[~seen[mine] & (normals[mine] @ out < -AGREE)]
        front = mine[front]
        if min(len(front), len(back)) < FEWEST:
            continue
        front = front[:: -(-len(front) // SAMPLES)]
        plane = np.linalg.svd(out[None])[2][1:].T  # [3, 2]
        areas = _areas(linear_to_srgb(shown[front]))
        if (areas == areas[0]).all():
            continue
        at, behind = points[front] @ plane, points[back] @ plane
        distance, near = cKDTree(at).query(behind, k=np.arange(1, VOTES + 1), workers=-1)
        votes = (areas[near][..., None] == np.arange(areas.max() + 1)).sum(1)
        through, area = distance[:, 0] < THROUGH, votes.argmax(1)
        guess = linear_to_srgb(filled[back])
        for one in np.unique(areas):
            here = through & (area == one)
            edge = cKDTree(at[areas != one]).query(behind)[0]
            sure = np.flatnonzero(here & (edge > SURE))
            if not len(sure):
                continue
            sure = sure[:: -(-len(sure) // GUESSES)]
            count = np.arange(1, min(AROUND, len(sure)) + 1)
            _, beside = cKDTree(behind[sure]).query(behind[here], k=count, eps=0.5, workers=-1)
            even = np.median(guess[sure[beside]], axis=1)
            filled[back[here]] = srgb_to_linear(even)
    return filled


def _front(normals: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which places [n] are seen and look the way that most of the seen ones look, [m], and that
    way, [3]; none if they look all ways."""
    none = np.zeros(0, int), np.zeros(3)
    if not seen.any():
        return none
    out = np.median(normals[seen], axis=0)
    length = np.linalg.norm(out)
    if length < AGREE:
        return none
    out /= length
    agree = seen & (normals @ out > AGREE)
    return (np.flatnonzero(agree), out) if agree.sum() > MOST_AGREE * seen.sum() else none


def _areas(colors: np.ndarray) -> np.ndarray:
    """[n] which area those of a front [n, 3] sRGB are in: clusters of colours by average linkage,
    ``APART`` from one another; colours that are rare are in the nearest area."""
    some = colors[:: -(-len(colors) // LINKED)]
    _, label, count = np.unique(
        fcluster(linkage(some, "average"), APART, "distance"),
        return_inverse=True,
        return_counts=True,
    )
    kept = np.flatnonzero(count >= RARE * len(some))
    if len(kept) < 2:
        return np.zeros(len(colors), int)
    medians = np.stack([np.median(some[label == k], axis=0) for k in kept])
    return cKDTree(medians).query(colors)[1]

"""Legs made whole and straight: what carries an object is about the same at every height.

At the resolution of the voxels legs are a few cells thick, and a network draws them torn. Where few
of the body's cells are, from its lowest layer on, each layer is filled where the median of those
above and below it is solid; so legs that lean and boards between them stay. Then each leg whose
rectangles in the layers lie about on lines is cut to these lines: a prism that may lean and taper,
with sides as the lines have them, or an ellipse in them where the corners are empty.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import ndimage

from uniart_jax.voxels.isosurface import ZERO, DenseField

COVERED = 0.6  # share of the layers in which a leg is seen apart, at least
FEW = 6  # cells of a leg in a layer, at least
STRAY = 1.5  # sub-cells, median distance of a rectangle's edges from their lines at most
OFF = 3.9  # sub-cells; a layer whose rectangle is farther off is left: feet, brackets, rails
FILLED = 0.6  # share of its rectangles, or ellipses, that a leg fills at least
CORNERS = 0.5  # share of what lies outside the ellipses that a round leg fills at most
SIDE = 0.3  # share of what it carries that a leg is wide at most, along both sides
NEAR = 5  # sub-cells from a prism within which cells are the leg's
REACH = 8  # layers that a leg's ends reach on to the floor, and to what it carries
SPARSE = 0.4  # share of its bounding rectangle that a layer of legs fills at most
ELLIPSE = np.pi / 4  # share of its rectangle that an ellipse fills
FARTHEST = 3.0  # sub-cells, to which distances are cut off
BLEND = 3  # layers below its upper end, where what it carries is near
LEAST = 8  # layers of legs
WINDOW = 21  # layers whose median is taken


def with_whole_legs(field: DenseField, body: Sequence[int]) -> DenseField:
    """A field whose body's legs have no gaps and are straight.

    Args:
      body: owners that do not move.
    """
    mine = np.isin(field.owner, body)
    solid = (field.sdf < 0) & mine
    if not solid.any():
        return field
    window = ndimage.find_objects(solid.astype(np.int8))[0]
    count = solid[window].sum((0, 1))
    area = solid[window].shape[0] * solid[window].shape[1]
    sparse = count <= SPARSE * area
    height = len(sparse) if sparse.all() else int((~sparse).argmax())
    if height < LEAST or height == len(sparse):
        return field
    legs = (window[0], window[1], slice(window[2].start, window[2].start + height))
    sdf, owner = field.sdf.copy(), field.owner.copy()
    drawn = np.where(mine[legs], sdf[legs], np.maximum(np.abs(sdf[legs]), 0.5))
    straight = ndimage.median_filter(drawn, (1, 1, min(WINDOW, height)), mode="reflect")
    others = np.asarray(ndimage.binary_dilation((sdf < 0) & ~mine), bool)[legs]
    part = np.bincount(owner[legs][solid[legs]]).argmax()
    fill = ~others & (straight < 0) & (sdf[legs] > 0)
    sdf[legs] = np.where(fill, np.minimum(straight, -ZERO), sdf[legs])
    owner[legs] = np.where(fill & ~mine[legs], part, owner[legs])
    mine = np.isin(owner, body)
    for leg in _legs((sdf[legs] < 0) & mine[legs]):
        _cut(leg, sdf[legs], owner[legs], mine[legs], others, int(part))
    return dataclasses.replace(field, sdf=sdf, owner=owner)


class Leg(NamedTuple):
    """A leg in a window of ``n`` layers.

    Attributes:
      cells: {layer: [m, 2] its cells there}, of the layers in which it is apart and lies on its
        lines. first, last: layers between which it stands. low, high: [n, 2] the edges of its
        prism, cells. round: it is an ellipse in them.
    """

    cells: dict[int, np.ndarray]
    first: int
    last: int
    low: np.ndarray
    high: np.ndarray
    round: bool


def _legs(solid: np.ndarray) -> list[Leg]:
    """The legs of a window [X, Y, n] of layers, from the floor up, that are about prisms."""
    layers = solid.shape[2]
    chains: list[dict[int, np.ndarray]] = []
    for z in range(layers):
        labels = np.zeros(solid.shape[:2], np.int32)
        ndimage.label(solid[:, :, z], np.ones((3, 3)), output=labels)
        pieces = [np.argwhere(labels == k) for k in range(1, labels.max() + 1)]
        for cells in (piece for piece in pieces if len(piece) >= FEW):
            if (np.ptp(cells, 0) + 1 > SIDE * np.array(solid.shape[:2])).any():
                continue
            ahead = [c for c in chains if _beneath(c, cells, z)]
            if ahead:
                ahead[0][z] = cells
            else:
                chains.append({z: cells})
    found = [_prism(chain, layers) for chain in chains if len(chain) >= COVERED * layers]
    return [leg for leg in found if leg is not None]


def _beneath(chain: dict[int, np.ndarray], cells: np.ndarray, z: int) -> bool:
    """Whether a chain's last layer, a few below z, lies beneath the cells."""
    last = max(chain)
    if not 0 < z - last <= WINDOW // 2:
        return False
    below = chain[last]
    return bool(
        ((below.min(0) <= cells.max(0)) & (cells.min(0) <= below.max(0))).all()
        and (np.abs(below.mean(0) - cells.mean(0)) < np.ptp(below, 0) + 1).all()
    )


def _prism(chain: dict[int, np.ndarray], layers: int) -> Leg | None:
    """A chain of layers as a leg; None where its edges do not lie on lines."""
    import scipy.stats  # takes as long as all of SciPy's others

    z = np.array(sorted(chain))
    edges = np.array([[*chain[k].min(0), *(chain[k].max(0) + 1)] for k in z], float)
    lines: list[Any] = [scipy.stats.theilslopes(edge, z) for edge in edges.T]
    at = np.arange(layers)
    fitted = np.stack([line[0] * at + line[1] for line in lines], -1)
    if (np.median(np.abs(edges - fitted[z]), 0) > STRAY).any():
        return None
    low, high = fitted[:, :2], fitted[:, 2:]
    if (high - low < 1).any():
        return None
    on_lines = np.abs(edges - fitted[z]).max(1) <= OFF
    cells = {int(k): chain[k] for k in z[on_lines]}
    if len(cells) < COVERED * len(z):
        return None
    within = corners = whole = 0.0
    for k, places in cells.items():
        middle, half = (low[k] + high[k]) / 2, (high[k] - low[k]) / 2
        apart = np.abs(places + 0.5 - middle) / half
        inner = np.linalg.norm(apart, axis=1) <= 1
        within += inner.sum()
        corners += ((apart <= 1).all(1) & ~inner).sum()
        whole += 4 * half.prod()
    first = 0 if z[0] <= REACH else int(z[0])
    last = layers - 1 if z[-1] >= layers - 1 - REACH else int(z[-1])
    if corners <= CORNERS * (1 - ELLIPSE) * whole and within >= FILLED * ELLIPSE * whole:
        return Leg(cells, first, last, low, high, True)
    filled = (within + corners) / whole
    return Leg(cells, first, last, low, high, False) if filled >= FILLED else None


def _cut(
    leg: Leg, sdf: np.ndarray, owner: np.ndarray, mine: np.ndarray, others: np.ndarray, part: int
) -> None:
    """Make a window's cells the leg's prism, in place; cells of ``others`` stay as they are."""
    x, y = np.meshgrid(*(np.arange(n) + 0.5 for n in sdf.shape[:2]), indexing="ij")
    foot = leg.first + 0.5  # height of its lower end, of which the lowest layer tells
    if leg.first in leg.cells:
        foot += float(np.clip(np.median(sdf[(*leg.cells[leg.first].T, leg.first)]), -0.5, 0))
    for z in range(leg.first, leg.last + 1):
        middle, half = (leg.low[z] + leg.high[z]) / 2, (leg.high[z] - leg.low[z]) / 2
        apart = np.stack([np.abs(x - middle[0]), np.abs(y - middle[1])], -1)
        if leg.round:
            distance = (np.linalg.norm(apart / half, axis=-1) - 1) * half.min()
        else:
            distance = (apart - half).max(-1)
        free, old = ~others[:, :, z], sdf[:, :, z]
        fill = free & (distance < 0)
        own = np.zeros_like(free)
        if z in leg.cells:
            own[tuple(leg.cells[z].T)] = True
        near = (distance >= 0) & (distance < NEAR)
        change = fill | (free & near & (own | (mine[:, :, z] & (old > 0))))
        value = np.where(fill, np.maximum(distance, foot - (z + 0.5)), distance)
        if leg.last - z < BLEND:  # what it carries, or stands on, is near
            value = np.minimum(value, np.where(own & (distance >= 0), value, old))
        value = np.where(np.abs(value) < ZERO, -ZERO, np.clip(value, -FARTHEST, FARTHEST))
        sdf[:, :, z] = np.where(change, value, old)
        owner[:, :, z] = np.where(fill & ~mine[:, :, z], part, owner[:, :, z])

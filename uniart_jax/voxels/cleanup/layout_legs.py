"""A field whose body stands on the legs that a layout has.

At the resolution of the voxels legs are a few cells thick, and a structure network draws them torn;
a set of boxes (``leg_table``) is not.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from uniart_jax.voxels.isosurface import ZERO, DenseField, to_cells
from uniart_jax.voxels.leg_table import Legs

LEVEL = 0.03  # object units; ends that differ by less from the median are at one height
NEAR = 5  # sub-cells from a prism within which what else is drawn of the body is the leg's
FARTHEST = 3.0  # sub-cells, to which distances are cut off
SEARCH = 0.1  # object units beyond the legs' upper ends, within which these are sought
LOWEST = 3  # layers above the floor, from which on it is
JUMP = 0.15  # share of the body's rectangle by which its cells grow there
FIRST = 0.8  # share of the largest growth that the first is at least
CLOSE = 0.07  # object units from the median upper end, farther from which the next is asked
FEW = 0.25  # cells below the body's begin, as a share of those above, at most; else it is a board
REACH = 0.3  # object units above, within which the body covers a leg that goes on
CARRIED = 0.2  # share of the body above legs at least, for the rest below to be taken away
COVERED = 0.6  # share of a leg that is the body's there
UPRIGHT = 0.8  # share of the legs' layers in which what stands beside them is drawn
PLATES = 2.0  # of its cells in a layer, as a multiple of the legs'
LONG = 4.0  # widths of a leg that the longest piece of it is long at least
BLEND = 2  # layers below a leg's upper end, where what it carries is near


def with_legs(field: DenseField, body: Sequence[int], legs: Legs) -> DenseField:
    """A field whose body stands on these legs, and on nothing else where they stand ``alone`` and
    no plates are drawn in their stead.

    Their upper ends are moved to where the body begins. Legs stand below it; one that it does not
    cover there goes on up to where it does. Without ``alone`` what reaches farther than ``NEAR``
    from the legs, as a rail between them, stays.

    Args:
      body: owners that do not move.

    Returns:
      A new field. Cells of other parts stay as they are.
    """
    mine = np.isin(field.owner, body)
    solid = (field.sdf < 0) & mine
    if not solid.any() or not len(legs):
        return field
    prisms = Prisms(legs, solid)
    first, last = prisms.layers()
    alone = legs.alone and solid[:, :, last:].sum() >= CARRIED * solid.sum()
    alone = alone and not _on_others(solid[:, :, first:last], prisms, first)
    free = ~np.asarray(ndimage.binary_dilation((field.sdf < 0) & ~mine), bool)
    for axis in range(3):  # the layer around the grid stays outside
        np.moveaxis(free, axis, 0)[[0, -1]] = False
    part = int(np.bincount(field.owner[solid]).argmax())
    field = dataclasses.replace(field, sdf=field.sdf.copy(), owner=field.owner.copy())
    for z in range(first, last):
        distance = prisms.at(z).min(0)
        old, ours = field.sdf[:, :, z], mine[:, :, z] | (field.sdf[:, :, z] > 0)
        where = free[:, :, z] & ours
        if not alone:
            where &= (distance < NEAR) & ~_beyond(solid[:, :, z], distance)
        if last - z <= BLEND:  # what they carry is near
            distance = np.minimum(distance, np.where(where & (old < 0), distance, old))
        _draw(field, z, distance, where | (free[:, :, z] & (distance < 0)), part)
    if alone:  # nothing of the body is below the floor
        below = field.sdf[:, :, :first]
        below[mine[:, :, :first] & (below < 0)] = 0.5
    for k in range(len(legs)):
        _go_on(field, k, prisms, free, body, part)
    return field


class Prisms:
    """Legs in a field, moved to what they carry.

    Attributes:
      size: cells of the grid along its side. feet, tops: [N] layers of their ends, with fractions.
    """

    def __init__(self, legs: Legs, solid: np.ndarray):
        self.size = solid.shape[0] - 2
        self._legs = legs
        self._xy = np.stack(np.meshgrid(*[np.arange(self.size + 2.0)] * 2, indexing="ij"), -1)
        feet, tops = (to_cells(_levelled(ends), self.size) for ends in legs.heights.T)
        told, foot = float(np.median(tops)), float(np.median(feet))
        self.feet = np.clip(feet, 1, self.size)
        end = _upper_end(solid, foot, tops, self.size)
        moved = tops if end is None else np.minimum(tops + max(end - told, 0), end)
        self.tops = np.clip(moved, 1, self.size)
        self._shift = np.zeros((len(legs), 2))
        self._shift = self._under(solid)

    def layers(self) -> tuple[int, int]:
        """The first layer that they are in, and the one after their last."""
        return int(np.floor(self.feet.min())), int(np.floor(self.tops.max())) + 1

    def at(self, z: float, beyond: bool = False) -> np.ndarray:
        """[N, X, Y] sub-cells to each leg in a layer, below 0 inside; infinite above its upper
        end, unless its lines are to go on ``beyond``."""
        legs, distances = self._legs, []
        for k in range(len(legs)):
            if z > self.tops[k] and not beyond:
                distances.append(np.full(self._xy.shape[:2], np.inf))
                continue
            lower, upper = self._edges(k, z)
            middle, half = (lower + upper) / 2, np.maximum(upper - lower, 1) / 2
            apart = np.abs(self._xy - middle)
            if legs.round[k]:
                distance = (np.linalg.norm(apart / half, axis=-1) - 1) * half.min()
            else:
                distance = (apart - half).max(-1)
            distances.append(np.maximum(distance, self.feet[k] - z))
        return np.stack(distances)

    def _edges(self, k: int, z: float) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corner [2] of a leg's rectangle in a layer, cells."""
        share = (z - self.feet[k]) / max(self.tops[k] - self.feet[k], 1.0)
        edges = (1 - share) * self._legs.lower[k] + share * self._legs.upper[k]
        edges = to_cells(edges, self.size)
        return edges[:2] + self._shift[k], edges[2:] + self._shift[k]

    def _under(self, solid: np.ndarray) -> np.ndarray:
        """[N, 2] cells by which legs are moved, so that their upper ends lie below the body."""
        shift = np.zeros((len(self._legs), 2))
        for k, top in enumerate(self.tops):
            z = int(np.ceil(top))
            carried = np.argwhere(solid[:, :, z : z + max(int(REACH * self.size), 1)].any(2))
            if not len(carried):
                continue
            lower, upper = self._edges(k, top)
            short = np.maximum(carried.min(0) - 0.5 - lower, 0)
            over = np.maximum(upper - carried.max(0) - 0.5, 0)
            shift[k] = np.where(short * over > 0, 0, short - over)
        return shift


def _levelled(heights: np.ndarray) -> np.ndarray:
    """Heights [N] of ends; those near the median are the median."""
    middle = np.median(heights)
    return np.where(np.abs(heights - middle) < LEVEL, middle, heights)


def _beyond(solid: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """[X, Y] connected pieces of a layer that reach farther than ``NEAR`` from the legs."""
    labels = np.zeros(solid.shape, np.int32)
    ndimage.label(solid, output=labels)
    far = np.unique(labels[solid & (distance >= NEAR)])
    return np.isin(labels, far[far > 0])


def _on_others(below: np.ndarray, prisms: Prisms, first: int) -> bool:
    """Whether what is drawn in the legs' layers [X, Y, L], from ``first`` on, stands on plates, as
    at its ends: upright all the way, ``PLATES`` times as large as legs, and long."""
    distance = np.stack([prisms.at(first + z) for z in range(below.shape[2])], -1)
    others = (below & (distance.min(0) >= NEAR)).mean(2) >= UPRIGHT
    legs = (distance < 0).sum((1, 2)).mean(-1)  # cells of each in a layer
    if others.sum() <= PLATES * legs.sum():
        return False
    labels = np.zeros(others.shape, np.int32)
    ndimage.label(others, output=labels)
    long = max(max(s.stop - s.start for s in piece) for piece in ndimage.find_objects(labels))
    return bool(long >= LONG * np.sqrt(np.median(legs)))


def _draw(field: DenseField, z: int, distance: np.ndarray, where: np.ndarray, part: int) -> None:
    """Make cells of a layer lie at a distance from the legs' surface, in place."""
    value = np.clip(distance, -FARTHEST, FARTHEST)
    value = np.where(np.abs(value) < ZERO, -ZERO, value)
    old, owner = field.sdf[:, :, z], field.owner[:, :, z]
    gained = where & (old > 0) & ((value < 0) | (owner < 0))
    field.owner[:, :, z] = np.where(gained, part, owner)
    field.sdf[:, :, z] = np.where(where, value, old)


def _go_on(
    field: DenseField, leg: int, prisms: Prisms, free: np.ndarray, body: Sequence[int], part: int
) -> None:
    """Fill a leg from its upper end up to where the body covers it, in place; not at all where it
    does not within ``REACH``."""
    last = int(np.floor(prisms.tops[leg])) + 1
    layers = []
    for z in range(last, min(last + int(REACH * prisms.size), prisms.size + 1)):
        distance = prisms.at(z, beyond=True)[leg]
        inside = distance < 0
        if not inside.any():
            return
        solid = (field.sdf[:, :, z] < 0) & np.isin(field.owner[:, :, z], body)
        if solid[inside].mean() >= COVERED:
            break
        layers.append((z, distance))
    else:
        return
    for z, distance in layers:
        distance = np.minimum(distance, field.sdf[:, :, z])
        _draw(field, z, distance, free[:, :, z] & (distance < 0), part)


def _upper_end(solid: np.ndarray, foot: float, tops: np.ndarray, size: int) -> float | None:
    """Where, about the layers ``tops`` [N], the body begins: where its cells first grow much, above
    its lowest layers, in which a network may draw it although it stands on legs. None where that
    cannot be told."""
    count = solid.sum((0, 1)).astype(float)
    window = ndimage.find_objects(solid.astype(np.int8))[0]
    area = solid[window].shape[0] * solid[window].shape[1]
    first = max(int(tops.min() - SEARCH * size), int(np.ceil(foot)) + LOWEST, 2)
    at = np.arange(first, min(int(tops.max() + SEARCH * size), size - 2))
    if not len(at):
        return None
    before, after = (np.array([count[z + d : z + d + 2].mean() for z in at]) for d in (-2, 0))
    far = np.abs(at - np.median(tops)) > CLOSE * size
    grown = np.where(far & (before > FEW * after), 0, after - before)
    clear = grown > max(JUMP * area, FIRST * float(grown.max()))
    if not clear.any():
        return None
    begin = int(clear.argmax())
    stop = begin + int(np.append(~clear[begin:], True).argmax())
    return at[begin + int(grown[begin:stop].argmax())] - 0.5

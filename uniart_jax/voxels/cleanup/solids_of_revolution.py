"""Parts that are round about an axis, as pots, jars and lids, get the outlines that the layout has.

Of round things that are not doors or drums a network draws a box with round edges, torn where the
picture shows little. Its layout network tells that a part is round, about which axis and how far it
reaches from it, layer by layer (``voxels.revolution_table``). So the part's outside becomes that
solid of revolution, with a whole wall of ``WALL`` sub-cells: openings in its side are closed. What
is within that wall stays as it is drawn, and so do layers that are nothing like the solid, as those
of feet, and a spout or a handle where the part's box reaches well beyond the outline, along an axis
of the frame; what else stands out of it is taken away. Where the layout's outline is an estimate,
large radii and the middle of large parts are those of the voxels (``cleanup.drawn_outline``), which
show them better. Two such parts about one axis whose boxes overlap along it, as a jar and its lid,
are both drawn there, in pieces: up to a layer the outer wall is the lower one's, from it on the
upper one's.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping

import numpy as np

from uniart_jax.voxels.cleanup.drawn_outline import drawn_outline
from uniart_jax.voxels.isosurface import ZERO, DenseField, to_cells
from uniart_jax.voxels.revolution_table import Revolution

AGREE = 0.6  # least share of a part that lies within its solid of revolution ...
LIKE = 0.4  # ... and of a layer ...
SLACK = 0.15  # ... or no farther from it than this share of its largest radius
NARROW = 4.0  # sub-cells, least radius of such a solid
WALL = 3.0  # sub-cells, that its wall is thick at least
FULL = 0.5  # least share of the middle of an end that is solid where a part is closed there
OUT = 1.15  # a box that reaches so many radii from the axis has something that stands out there
ASIDE = 0.35  # half the width of the strip in which it may stand, over the largest radius
NEAR = 2.0  # sub-cells from a surface within which its distance is written
STEEPEST = 3.0  # radius over height, slope of an outline that distances allow for
DRAWN = (6.0, 14.0)  # sub-cells, radii from which on voxels count, and alone count
COAXIAL = 0.25  # of the smaller radius, that axes of parts that share layers are apart at most
TOUCH = 6.0  # sub-cells, that radii of such parts differ there at most
NESTED = 0.9  # share of the shorter one's height that they overlap from which on one is inside


@dataclasses.dataclass
class _Outline:
    """Where a part is to end, cells; the first of three axes is its own.

    Attributes:
      part: its row.
      low, high: its ends along the axis.
      middle: [2] where the axis is.
      radius: [D].
      mine: [D, U, V] bool, the part as it is drawn.
      strips: [U, V] bool, where something may stand out of it.
      like_it: [D] bool, layers that are drawn somewhat like the outline.
      layers: [D] bool, layers in which its wall is made; ``_share_layers`` takes some away.
    """

    part: int
    low: float
    high: float
    middle: np.ndarray
    radius: np.ndarray
    mine: np.ndarray
    strips: np.ndarray
    like_it: np.ndarray
    layers: np.ndarray

    def away(self) -> np.ndarray:
        """[U, V] distances from the axis."""
        u, v = (np.arange(n) - m for n, m in zip(self.mine.shape[1:], self.middle, strict=True))
        return np.hypot(u[:, None], v[None]).astype(np.float32)

    def outside(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Distances from the solid, negative inside, [D, U, V]; those from its side [D, U, V] and
        from its ends [D, 1, 1]."""
        depth = np.arange(len(self.mine), dtype=np.float32)
        slope = np.clip(np.gradient(self.radius), -STEEPEST, STEEPEST)
        side = (self.away() - self.radius[:, None, None]) / np.hypot(1, slope)[:, None, None]
        end = np.maximum(self.low - depth, depth - self.high)[:, None, None]
        return np.maximum(side, end).astype(np.float32), side, end


def with_revolutions(
    field: DenseField,
    boxes: np.ndarray,
    drawn: DenseField,
    revolutions: Mapping[int, Revolution],
) -> tuple[DenseField, list[int]]:
    """A field whose parts ``revolutions`` are solids of revolution.

    Args:
      field: of the shown state. boxes: [K, 6] centre and size of the first K parts, object units.
      drawn: the field before other passes. revolutions: outlines of some of the parts.

    Returns:
      A new field, in which solid cells of other parts are as they were, but for outer walls of
      layers that two round parts share; and the parts that it was done for, not those of which
      voxels show another shape.
    """
    field = dataclasses.replace(field, sdf=field.sdf.copy(), owner=field.owner.copy())
    turned = [  # views: what is written into them is written into the field
        [np.moveaxis(values, axis, 0) for values in (field.sdf, field.owner, drawn.sdf)]
        for axis in range(3)
    ]
    outlines = {}
    for part, revolution in revolutions.items():
        mine = (drawn.sdf < 0) & (drawn.owner == part)
        outline = _outline(np.moveaxis(mine, revolution.axis, 0), part, boxes[part], revolution)
        if outline is not None:
            outlines[part] = outline
    upwards = sorted(outlines.values(), key=lambda outline: outline.low + outline.high)
    for lower, upper in itertools.combinations(upwards, 2):
        axis = revolutions[lower.part].axis
        if axis == revolutions[upper.part].axis:
            _share_layers(turned[axis][1], lower, upper)
    for part, outline in outlines.items():
        sdf, owner, drawn_sdf = turned[revolutions[part].axis]
        _make_round(sdf, owner, drawn_sdf, outline)
    return field, list(outlines)


def _outline(
    mine: np.ndarray, part: int, box: np.ndarray, revolution: Revolution
) -> _Outline | None:
    """That of a part with cells [D, U, V], D along its axis; None where they show another shape
    than a network's estimate."""
    size, axis = len(mine) - 2, revolution.axis
    low, high = (to_cells(box[axis] + s * box[3 + axis] / 2, size) for s in (-1, 1))
    middle = to_cells(revolution.center, size)
    depth = np.arange(len(mine), dtype=np.float32)
    radius = revolution.radius((depth - low) / max(high - low, 1e-6)) * size
    if revolution.estimate:
        layers = (depth > low - 0.5) & (depth < high + 0.5)
        middle, radius = _corrected(mine & layers[:, None, None], middle, radius)
    across = np.delete(np.arange(3), axis)
    reach = box[3 + across] / 2 * size
    offset = to_cells(box[across], size) - middle
    radius = np.minimum(radius, (np.abs(offset) + reach).max() + 1)
    if radius.max() < NARROW or high - low < 1:
        return None
    u, v = (np.arange(n) - m for n, m in zip(mine.shape[1:], middle, strict=True))
    strips = _standing(u, v, offset, reach, radius)
    every = np.ones(len(mine), bool)
    outline = _Outline(part, low, high, middle, radius, mine, strips, every, every.copy())
    if not revolution.estimate:
        return outline
    outside, side, _ = outline.outside()
    slack = SLACK * radius.max()
    if not mine.any() or (outside[mine] < slack).mean() < AGREE:
        return None
    outline.like_it = (mine & (side < slack)).sum((1, 2)) >= LIKE * mine.sum((1, 2))
    return outline


def _share_layers(owner: np.ndarray, lower: _Outline, upper: _Outline) -> None:
    """In place: the owners of cells [D, U, V] in the walls of two parts about one axis, D along it.

    Of the layers in which both are, the lower part has the outer wall up to a split, the upper one
    from it on: there the fewest cells of the wall are drawn on the wrong side. What is within the
    wall stays. Nothing is shared where axes are apart, radii differ, or one is inside the other.
    """
    parts = (lower, upper)
    depth = np.arange(len(owner))
    first, last = max(o.low for o in parts), min(o.high for o in parts)
    shared = np.flatnonzero((depth > first) & (depth < last))
    apart = np.hypot(*(lower.middle - upper.middle))
    radii = np.stack([o.radius[shared] for o in parts])
    if (
        not len(shared)
        or last - first > NESTED * min(o.high - o.low for o in parts)
        or apart > COAXIAL * min(o.radius.max() for o in parts)
        or np.median(np.ptp(radii, axis=0)) > TOUCH
    ):
        return
    larger = radii.max(0)[:, None, None]
    below, above = ((o.mine[shared] & (o.away() > larger - TOUCH)).sum((1, 2)) for o in parts)
    wrong = np.concatenate([[0], np.cumsum(above - below)])
    split = int(wrong.argmin())
    lower.layers[shared[split:]] = upper.layers[shared[:split]] = False
    for keeps, gives, layers in ((lower, upper, shared[:split]), (upper, lower, shared[split:])):
        layers = layers[keeps.like_it[layers]]
        away, end = keeps.away(), keeps.radius[layers, None, None]
        reach = np.maximum(end, gives.radius[layers, None, None]) + NEAR
        wall = (away > end - WALL) & (away < reach) & ~(gives.strips & (away > end))
        layer, *places = np.nonzero((owner[layers] == gives.part) & wall)
        owner[layers[layer], *places] = keeps.part


def _make_round(
    sdf: np.ndarray, owner: np.ndarray, drawn_sdf: np.ndarray, outline: _Outline
) -> None:
    """In place: one part, in cells [D, U, V], D along its axis."""
    part, radius, mine, away = outline.part, outline.radius, outline.mine, outline.away()
    outside, radial, end = outline.outside()
    depth = np.arange(len(sdf), dtype=np.float32)
    ours = ((owner == part) | (sdf > 0)) & outline.like_it[:, None, None]
    ours[[0, -1]] = ours[:, [0, -1]] = ours[:, :, [0, -1]] = False  # the layer of outside
    stands = ours & mine & (radial > 0) & (end < 0) & outline.strips
    near_it = (outside < 0) | (owner == part) | (owner < 0)  # distances of others stay
    within = (radial < -WALL) & (end < -WALL)
    made = ours & outline.layers[:, None, None]
    written = made & near_it & (outside < NEAR) & ~within
    for closing in (depth < outline.low + WALL, depth > outline.high - WALL):
        cap = closing[:, None, None] & (radial < -WALL) & (end < 0)
        middle_of_it = cap & (away < radius[:, None, None] / 2)
        if middle_of_it.any() and mine[middle_of_it].mean() < FULL:  # it is open there
            written &= ~cap
    loose = ours & (owner == part) & (outside >= 0) & (sdf < 0)
    sdf[loose] = np.maximum(outside[loose], 0.5)
    sdf[written] = np.clip(outside[written], -NEAR, NEAR)
    sdf[stands] = np.minimum(drawn_sdf[stands], sdf[stands])
    sdf[written & (np.abs(sdf) < ZERO)] = -ZERO
    owner[(written | stands) & (sdf < 0)] = part


def _corrected(
    mine: np.ndarray, middle: np.ndarray, radius: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """An estimated middle [2] and radii [D], cells, where the part's cells [D, U, V] show more
    than ``DRAWN`` of them; torn layers are as far off the estimate as those beside them."""
    found, drawn = drawn_outline(mine, middle)
    known = np.flatnonzero(np.isfinite(drawn))
    if not len(known):
        return middle, radius
    drawn = radius * np.interp(np.arange(len(radius)), known, (drawn / radius)[known])
    share = np.clip((drawn - DRAWN[0]) / (DRAWN[1] - DRAWN[0]), 0, 1)
    middle = middle + np.median(share[known]) * (found - middle)
    return middle, share * drawn + (1 - share) * radius


def _standing(
    u: np.ndarray, v: np.ndarray, offset: np.ndarray, reach: np.ndarray, radius: np.ndarray
) -> np.ndarray:
    """[U, V] bool, narrow strips from the axis to the sides to which a box goes well beyond the
    outline: there something may stand out of it. ``offset``, ``reach``: [2] of the box's middle
    from the axis, and half of its sides, cells."""
    strips = np.zeros((len(u), len(v)), bool)
    thin = ASIDE * radius.max()
    along = ((u[:, None], np.abs(v)[None] < thin), (v[None], np.abs(u)[:, None] < thin))
    for which, (places, near) in enumerate(along):
        for sign in (-1, 1):
            if sign * offset[which] + reach[which] > OUT * radius.max() + 1:
                strips |= near & (sign * places > 0)
    return strips

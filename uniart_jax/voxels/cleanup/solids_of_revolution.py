"""Parts that are round about an axis, as pots, jars and lids, get the outlines that the layout has.

Of round things that are not doors or drums a network draws a box with round edges, torn where the
picture shows little. Its layout network tells that a part is round, about which axis and how far it
reaches from it, layer by layer (``voxels.revolution_table``). So the part's outside becomes that
solid of revolution, with a whole wall of ``WALL`` sub-cells: openings in its side are closed. What
is within that wall stays as it is drawn, and so do layers that are nothing like the solid, as those
of feet, and a spout or a handle where the part's box reaches well beyond the outline, along an axis
of the frame; what else stands out of it is taken away. Where the layout's outline is an estimate,
large radii and the middle of large parts are those of the voxels (``cleanup.drawn_outline``), which
show them better.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from uniart_jax.voxels.cleanup.drawn_outline import drawn_outline
from uniart_jax.voxels.isosurface import ZERO, DenseField
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


def with_revolutions(
    field: DenseField,
    drawn: DenseField,
    boxes: np.ndarray,
    revolutions: Mapping[int, Revolution],
) -> tuple[DenseField, list[int]]:
    """A field whose parts ``revolutions`` are solids of revolution.

    Args:
      field: of the shown state. drawn: the same before other passes. boxes: [K, 6] centre and size
        of the first K parts, object units. revolutions: outlines of some of them.

    Returns:
      A new field, in which solid cells of other parts are as they were, and the parts that it was
      done for; not those of which voxels show another shape.
    """
    field = dataclasses.replace(field, sdf=field.sdf.copy(), owner=field.owner.copy())
    built = []
    for part, revolution in revolutions.items():
        every = (field.sdf, field.owner, drawn.sdf, drawn.owner)
        sdf, owner, *before = (np.moveaxis(values, revolution.axis, 0) for values in every)
        if _make_round(sdf, owner, before[0], before[1], part, boxes[part], revolution):
            built.append(part)
    return field, built


def _make_round(
    sdf: np.ndarray,
    owner: np.ndarray,
    drawn_sdf: np.ndarray,
    drawn_owner: np.ndarray,
    part: int,
    box: np.ndarray,
    revolution: Revolution,
) -> bool:
    """In place: one part, in cells [D, U, V], D along its axis; False where voxels show another
    shape."""
    size = len(sdf) - 2
    across = np.delete(np.arange(3), revolution.axis)
    low, high = (
        (box[revolution.axis] + s * box[3 + revolution.axis] / 2 + 0.5) * size + 0.5
        for s in (-1, 1)
    )
    middle = (revolution.center + 0.5) * size + 0.5
    depth = np.arange(len(sdf), dtype=np.float32)
    mine = (drawn_sdf < 0) & (drawn_owner == part)
    radius = revolution.radius((depth - low) / max(high - low, 1e-6)) * size
    if revolution.estimate:
        layers = (depth > low - 0.5) & (depth < high + 0.5)
        middle, radius = _corrected(mine & layers[:, None, None], middle, radius)
    reach = box[3 + across] / 2 * size
    offset = (box[across] + 0.5) * size + 0.5 - middle
    radius = np.minimum(radius, (np.abs(offset) + reach).max() + 1)
    if radius.max() < NARROW or high - low < 1:
        return False
    slope = np.clip(np.gradient(radius), -STEEPEST, STEEPEST)
    u, v = (np.arange(n) - m for n, m in zip(sdf.shape[1:], middle, strict=True))
    away = np.hypot(u[:, None], v[None]).astype(np.float32)
    radial = (away[None] - radius[:, None, None]) / np.hypot(1, slope)[:, None, None]
    end = np.maximum(low - depth, depth - high)[:, None, None]
    outside = np.maximum(radial, end).astype(np.float32)

    slack = SLACK * radius.max()
    if not mine.any() or (outside[mine] < slack).mean() < AGREE:
        return False
    like_it = (mine & (radial < slack)).sum((1, 2)) >= LIKE * mine.sum((1, 2))
    ours = ((owner == part) | (sdf > 0)) & like_it[:, None, None]
    ours[[0, -1]] = ours[:, [0, -1]] = ours[:, :, [0, -1]] = False  # the layer of outside
    stands = ours & mine & (radial > 0) & (end < 0) & _standing(u, v, offset, reach, radius)
    near_it = (outside < 0) | (owner == part) | (owner < 0)  # distances of others stay
    within = (radial < -WALL) & (end < -WALL)
    written = ours & near_it & (outside < NEAR) & ~within
    for closing in (depth < low + WALL, depth > high - WALL):
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
    return True


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

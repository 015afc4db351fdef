"""Which parts of an object are solids of revolution, read off meshes: what the layout network's
revolutions train on. No jax.

A part is round about an axis if, of ``RADII`` slices across it, most end at the same distance from
one common axis in most directions. A spout or a handle may stand out of it; what is inside does not
count.
"""

from __future__ import annotations

import manifold3d
import numpy as np

from uniart_jax.data.bodies import as_manifold
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.voxels.revolution_table import RADII, Revolution

STEP = 0.05  # of half the larger side across the axis, between points of an outline
SECTORS, AROUND = 24, 0.7  # of directions from the axis, and share of them that a round slice has
OFF = 0.06  # of its radius, that a slice's end is off a circle at most
LAYERS = 0.75  # least share of slices that are round
SQUARE = 0.3  # least ratio of the sides across the axis
SMALL = 0.03  # object units, least side across it
ROUNDS = 20  # of the fit
SPREAD = 0.03  # of half the larger side, distance from which on directions count less
_ANGLES = ((np.arange(SECTORS) + 0.5) / SECTORS * 2 - 1) * np.pi
_WAYS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], 1)


def revolutions_of(obj: ArticulatedObject) -> list[Revolution | None]:
    """Each part at the shown state as a solid of revolution; None where it is none, and where its
    mesh is not closed."""
    return [_revolution(as_manifold(part.mesh)) for part in obj.parts]


def _revolution(solid: manifold3d.Manifold) -> Revolution | None:
    if solid.status() != manifold3d.Error.NoError or solid.is_empty():
        return None
    lower, upper = np.array(solid.bounding_box()).reshape(2, 3)
    found = [_about(solid, axis, lower, upper - lower) for axis in range(3)]
    best = max((one for one in found if one is not None), key=lambda one: one[0], default=None)
    return best[1] if best is not None and best[0] >= LAYERS else None


def _about(
    solid: manifold3d.Manifold, axis: int, lower: np.ndarray, size: np.ndarray
) -> tuple[float, Revolution] | None:
    """The share of slices across an axis that are round, and what they say."""
    across = np.delete(np.arange(3), axis)
    small, large = np.sort(size[across])
    if small < max(SMALL, SQUARE * large):
        return None
    # a cyclic order is no mirror image; the slice's two axes are swapped back where need be
    order = [(axis + 1) % 3, (axis + 2) % 3, axis]
    turned = solid.transform(np.eye(4)[order, :])
    heights = lower[axis] + (np.arange(RADII) + 0.5) / RADII * size[axis]
    outlines = [_outline(turned.slice(float(height)), STEP * large / 2) for height in heights]
    if not all(map(len, outlines)):
        return None
    layer = np.repeat(np.arange(RADII), [len(outline) for outline in outlines])
    points = np.concatenate(outlines)[:, np.argsort(order[:2])]
    center, ends, radii = _fitted(points, layer, large / 2)
    if radii.min() <= 0:  # a slice that is missing in most directions
        return None
    near = np.abs(ends - radii[:, None]) < OFF * np.maximum(radii, radii.max() / 4)[:, None]
    near &= ends > 0
    return float((near.mean(1) > AROUND).mean()), Revolution(axis, center, radii)


def _outline(section: manifold3d.CrossSection, step: float) -> np.ndarray:
    """[n, 2] points along the outer outlines of a slice, ``step`` apart or less."""
    found = [np.zeros((0, 2))]
    for polygon in section.to_polygons():
        start = np.asarray(polygon, np.float64)
        end = np.roll(start, -1, 0)
        if (start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0]).sum() <= 0:  # a hole
            continue
        counts = np.ceil(np.maximum(np.linalg.norm(end - start, axis=1) / step, 1)).astype(int)
        edge = np.repeat(np.arange(len(start)), counts)
        first = np.repeat(np.cumsum(counts) - counts, counts)
        share = (np.arange(len(edge)) - first) / counts[edge]
        found.append(start[edge] + (end - start)[edge] * share[:, None])
    return np.concatenate(found)


def _fitted(
    points: np.ndarray, layer: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The common centre [2] of circles at which layers of points [n, 2] end, by least squares of
    Cauchy's loss; where they end in each direction from it [L, S], and the median of that [L]."""
    center = (points.min(0) + points.max(0)) / 2
    for _ in range(ROUNDS):
        ends = _ends(points, layer, center)
        off = ends - np.median(ends, 1, keepdims=True)
        weight = 1 / (1 + (off / (SPREAD * reach)) ** 2)
        normal = np.einsum("ls,su,sv->uv", weight, _WAYS, _WAYS)
        step = np.linalg.solve(normal, np.einsum("ls,su->u", weight * off, _WAYS))
        center = center + step
        if np.abs(step).max() < 1e-4:
            break
    ends = _ends(points, layer, center)
    return center, ends, np.median(ends, 1)


def _ends(points: np.ndarray, layer: np.ndarray, center: np.ndarray) -> np.ndarray:
    """[L, S] the farthest of each layer's points in each direction; 0 where none is."""
    away = points - center
    sector = np.floor((np.arctan2(away[:, 1], away[:, 0]) / np.pi + 1) / 2 * SECTORS).astype(int)
    ends = np.zeros((RADII, SECTORS))
    np.maximum.at(ends, (layer, sector % SECTORS), np.hypot(*away.T))
    return ends

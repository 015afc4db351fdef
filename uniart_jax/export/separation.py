"""Convex shapes of two parts that have room in common: how much, and cut apart.

Surfaces that touch or cross, as generated ones do along every seam, would push each other for ever
in a simulator.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from manifold3d import Manifold

from uniart_jax.export.box_cover import box_solid
from uniart_jax.export.convex_split import triangles
from uniart_jax.export.physics import Box, Shape

PLANES = 8  # directions that are tried for a cut, the thinnest first
# of a shape's first volume, by all its cuts; and of two shapes', summed, by one cut: more is not
# cut away
MOST_LOST = 0.5


def overlaps(shapes: Sequence[tuple[Shape, ...]], least: float) -> dict[tuple[int, int], float]:
    """{(a, b): how thick} of the pairs of parts that have shapes in common by more than
    ``least``."""
    solids, owner = _solids(shapes)
    found: dict[tuple[int, int], float] = {}
    for i, j in _near(solids, owner, least):
        deep = _common_width(solids[i], solids[j], least)
        if deep > least:
            pair = int(owner[j]), int(owner[i])
            found[pair] = max(found.get(pair, 0.0), deep)
    return found


def separated(
    shapes: Sequence[tuple[Shape, ...]],
    least: float,
    rebuild: Callable[[Manifold], Shape | None],
) -> list[tuple[Shape, ...]]:
    """The shapes with those of two parts cut apart by planes where they overlap by more than
    ``least``.

    A convex shape cut by a plane stays convex. Of a pair the plane is taken that costs the least,
    as shares of what the shapes were at first, summed; where any would cost half or more (an axle
    through a block), or would leave less than half of what one was before all its cuts, the pair
    stays as it is. ``rebuild`` makes a shape of what is left, None of a sliver, which is dropped; a
    part that had nothing but slivers keeps its largest shape, uncut.
    """
    solids, owner = _solids(shapes)
    first = [solid.volume() for solid in solids]
    cut: set[int] = set()
    for i, j in _near(solids, owner, least):
        halves = apart(solids[i], solids[j], least, (first[i], first[j]))
        if halves is not None:
            solids[i], solids[j] = halves
            cut |= {i, j}
    flat = [shape for own in shapes for shape in own]
    kept = [rebuild(solids[i]) if i in cut else flat[i] for i in range(len(flat))]
    out = []
    for k, own in enumerate(shapes):
        its = np.flatnonzero(owner == k)
        left = tuple(s for i in its if (s := kept[i]) is not None)
        out.append(left or (own and (flat[max(its, key=lambda i: first[i])],)))
    return out


def width(hull: Manifold) -> float:
    """The least distance between two parallel planes that hold a convex solid, one of them along a
    face."""
    vertices, _ = triangles(hull)
    return float(np.ptp(_normals(hull) @ vertices.T, axis=1).min())


def _normals(hull: Manifold) -> np.ndarray:
    """[n, 3] unit normals of the faces that have an area."""
    vertices, faces = triangles(hull)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    kept = areas > 1e-9 * areas.max()
    return normals[kept] / areas[kept, None]


def _solids(shapes: Sequence[tuple[Shape, ...]]) -> tuple[list[Manifold], np.ndarray]:
    """Every shape as a solid, and the part that each is of."""
    solids = [as_solid(shape) for own in shapes for shape in own]
    return solids, np.repeat(np.arange(len(shapes)), [len(own) for own in shapes])


def as_solid(shape: Shape) -> Manifold:
    """A shape as a solid."""
    if isinstance(shape, Box):
        return box_solid(shape.center, shape.size, shape.rotation)
    return Manifold.hull_points(np.asarray(shape.mesh.vertices, np.float64))


def _near(solids: Sequence[Manifold], owner: np.ndarray, least: float) -> list[tuple[int, int]]:
    """Pairs of shapes of different parts whose boxes overlap by more than ``least``."""
    bounds = np.array([s.bounding_box() for s in solids]).reshape(-1, 2, 3)
    pairs = []
    for i, (lo, hi) in enumerate(bounds):
        deep = np.minimum(bounds[:i, 1], hi) - np.maximum(bounds[:i, 0], lo)
        pairs += [
            (i, int(j)) for j in np.flatnonzero((deep.min(1) > least) & (owner[:i] != owner[i]))
        ]
    return pairs


def _common(one: Manifold, two: Manifold, least: float) -> Manifold | None:
    """What two shapes share, if it is thicker than ``least``."""
    common = one ^ two
    if common.is_empty() or common.volume() < least**3:
        return None
    hull = common.hull()
    return hull if width(hull) > least else None


def _common_width(one: Manifold, two: Manifold, least: float) -> float:
    """How thick what two convex shapes share is; 0 if that is not more than ``least``."""
    common = _common(one, two, least)
    return 0.0 if common is None else width(common)


def apart(
    one: Manifold, two: Manifold, least: float, first: tuple[float, float] | None = None
) -> tuple[Manifold, Manifold] | None:
    """Both on their own side of the plane that takes the least of them; None if that is too much,
    or they share no more than ``least``.

    Args:
      one, two: convex.
      least: how thick what they share must be.
      first: volumes before earlier cuts, that the losses are shares of; default the present ones.
    """
    of = first or (one.volume(), two.volume())
    common = _common(one, two, least)
    if common is None:
        return None
    vertices, _ = triangles(common)
    normals = _normals(common)
    thin = np.argsort(np.ptp(normals @ vertices.T, axis=1), kind="stable")
    tried: list[np.ndarray] = []
    for normal in normals[thin]:
        if all(abs(normal @ other) < 0.99 for other in tried):
            tried.append(normal)
        if len(tried) == PLANES:
            break
    best, least = None, MOST_LOST
    had = one.volume() / of[0] + two.volume() / of[1]
    for normal in tried:
        heights = vertices @ normal
        for offset in (heights.min(), (heights.min() + heights.max()) / 2, heights.max()):
            halves = one.split_by_plane(tuple(normal), float(offset))
            others = two.split_by_plane(tuple(normal), float(offset))
            for side in (0, 1):  # ``one`` above the plane, or below
                kept, other = halves[side], others[1 - side]
                shares = kept.volume() / of[0], other.volume() / of[1]
                lost = had - sum(shares)
                if lost < least and min(shares) >= 1 - MOST_LOST:
                    best, least = (kept, other), lost
    return best

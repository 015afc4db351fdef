"""Convex shapes of two parts that have room in common: how much, and cut apart.

Surfaces that touch or cross, as generated ones do along every seam, would push each other for ever
in a simulator.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from manifold3d import Manifold

from uniart_jax.export.box_cover import box_solid
from uniart_jax.export.convex_split import faces_of, triangles
from uniart_jax.export.physics import Box, Shape

PLANES = 8  # directions that are tried for a cut, the thinnest first
# of a shape's first volume, by all its cuts; and of two shapes', summed, by one cut: more is not
# cut away
MOST_LOST = 0.5


def overlaps(shapes: Sequence[tuple[Shape, ...]], least: float) -> dict[tuple[int, int], float]:
    """{(a, b): how deep} of the pairs of parts whose shapes stand in one another by more than
    ``least``."""
    solids, owner = _solids(shapes)
    found: dict[tuple[int, int], float] = {}
    for i, j in _near(solids, owner, least):
        deep = 0.0 if (solids[i] ^ solids[j]).is_empty() else _depth(solids[i], solids[j])
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
    _, normals = faces_of(*triangles(hull))
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
    """Pairs of shapes of different parts whose boxes stand in one another by more than
    ``least``."""
    bounds = np.array([s.bounding_box() for s in solids]).reshape(-1, 2, 3)
    pairs = []
    for i, (lo, hi) in enumerate(bounds):
        deep = np.minimum(bounds[:i, 1] - lo, hi - bounds[:i, 0]).min(1)
        pairs += [(i, int(j)) for j in np.flatnonzero((deep > least) & (owner[:i] != owner[i]))]
    return pairs


def _depth(one: Manifold, two: Manifold) -> float:
    """How far two convex shapes stand in one another: the least way, along a face's normal of
    either, that takes them apart. Of two crossing plates it is what stands out behind, however
    thin both are, as engines see it."""
    places = [triangles(solid)[0] for solid in (one, two)]
    ways = []
    for own, other, solid in ((*places, one), (*places[::-1], two)):
        normals = _normals(solid)
        ways.append(((normals @ own.T).max(1) - (normals @ other.T).min(1)).min())
    return float(max(min(ways), 0.0))


def apart(
    one: Manifold, two: Manifold, least: float, first: tuple[float, float] | None = None
) -> tuple[Manifold, Manifold] | None:
    """Both on their own side of the plane that takes the least of them; None if that is too much,
    or they stand in one another by no more than ``least``.

    Args:
      one, two: convex.
      least: how far they must stand in one another.
      first: volumes before earlier cuts, that the losses are shares of; default the present ones.
    """
    of = first or (one.volume(), two.volume())
    both = one ^ two
    if both.is_empty() or _depth(one, two) <= least:
        return None
    common = both.hull()
    if common.is_empty():
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

"""The convex shapes of one part, joined pair by pair: first those whose union changes least.

A pair becomes a box or a hull. A shape that others nearly cover is left out. What would stand where
another part is on its way costs more (``export.budget`` finds these places).
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Sequence

import numpy as np
from manifold3d import Manifold

from uniart_jax.export.box_cover import box_solid, fitted_box, own_frame
from uniart_jax.export.collision import rebuilt
from uniart_jax.export.convex_split import triangles
from uniart_jax.export.physics import Box, Shape
from uniart_jax.export.separation import as_solid, width
from uniart_jax.export.volume_error import corners_of, half_spaces

MANY = 24  # pieces: of more, only those that nearly touch are tried with one another
NEAR = 0.02  # of the part
BOX_LIKE = 0.01  # of the hull of all: how much worse than a hull a box, the quicker shape, may be
OWN = 6  # places along each side of a shape that stand for its matter
SPAN = 0.03  # of the part: how much shorter it may become by what is left out
MISSING = 1.5  # how much worse matter that is left out is than matter that is added
SHEET = 0.03  # of the part: what is thinner counts as if it were so thick where it is left out


class Merger:
    """The shapes of one part, joined pair by pair.

    Args:
      shapes: metres.
      barred: [n, 3] places of other parts.
      toll: what each of them costs, m^3.
      boxes: pairs become boxes, never hulls.

    ``extent``: volume of the hull of all.
    """

    def __init__(self, shapes: Sequence[Shape], barred: np.ndarray, toll: float, boxes: bool):
        self.barred = np.ascontiguousarray(barred.T)  # [3, n], quick to compare
        self.toll, self.boxes = toll, boxes
        self.given = list(shapes)
        self.pieces: list[Manifold | None] = []
        self.kept: dict[int, Shape] = {}  # pieces that are as they were given
        self.heap: list[tuple[float, int, int, Manifold]] = []
        self.matter: list[
            tuple[np.ndarray, np.ndarray]
        ] = []  # of each piece: points, m^3 that each is for
        self.unique: list[float] = []  # m^3 that no other piece holds
        whole = Manifold.batch_hull([as_solid(s) for s in shapes])
        self.extent = max(whole.volume(), 1e-12)
        self.frame = _common_frame(shapes)

    def coarsen(self, most: int) -> None:
        """Join pieces until there are ``most``."""
        self.pieces = [as_solid(shape) for shape in self.given]
        self.bounds = np.array([corners_of(s) for s in self.pieces])
        self.spaces = [half_spaces(s) for s in self.pieces]
        self.reach = float(np.ptp(self.bounds.reshape(-1, 3), axis=0).max())
        self.matter = [_matter(shape, SHEET * self.reach) for shape in self.given]
        self.unique = [self._unique(i) for i in range(len(self.pieces))]
        self.kept = dict(enumerate(self.given))
        self.apart = len(self.pieces) <= MANY  # whether pieces that lie apart are paired too
        for new in range(len(self.pieces)):
            self._offer(new)
        while self.count > most and np.isfinite(self.next_cost()):
            self.step()

    @property
    def count(self) -> int:
        return sum(piece is not None for piece in self.pieces)

    def next_cost(self) -> float:
        """Cubic metres that the next step adds or loses, and the toll; infinite if there is
        none."""
        return min(self._next_join(), MISSING * self._least_unique()[0])

    def step(self) -> None:
        """The cheapest pair becomes one, or the piece that is missed the least is left out, if the
        part stays as long."""
        lost, least = self._least_unique()
        if MISSING * lost < self._next_join():
            self._remove(least)
            return
        _, a, b, joined = heapq.heappop(self.heap)
        points = np.concatenate([self.matter[a][0], self.matter[b][0]])
        shares = np.concatenate([self.matter[a][1], self.matter[b][1]])
        self.pieces.append(joined)
        self.bounds = np.concatenate([self.bounds, corners_of(joined)[None]])
        self.spaces.append(half_spaces(joined))
        self.matter.append((points, shares))
        self.unique.append(0.0)
        self.pieces[a] = self.pieces[b] = None
        self.kept.pop(a, None)
        self.kept.pop(b, None)
        self._counted(_common_bounds(self.bounds[[a, b, -1]]))
        if self.count <= MANY and not self.apart:
            self._offer_apart()
        else:
            self._offer(len(self.pieces) - 1)

    def _remove(self, i: int) -> None:
        self.pieces[i] = None
        self.kept.pop(i, None)
        self._counted(self.bounds[i])

    def _counted(self, changed: np.ndarray) -> None:
        """Measure anew what pieces hold alone that lie where something changed [2, 3]."""
        for i, piece in enumerate(self.pieces):
            lo, hi = self.bounds[i]
            if piece is not None and (lo < changed[1]).all() and (hi > changed[0]).all():
                self.unique[i] = self._unique(i)

    def _unique(self, i: int) -> float:
        points, shares = self.matter[i]
        alone = np.ones(len(points), bool)
        lo, hi = self.bounds[i]
        near = (self.bounds[:, 0] < hi).all(1) & (self.bounds[:, 1] > lo).all(1)
        for j in np.flatnonzero(near):
            if j != i and self.pieces[j] is not None:
                normals, offsets = self.spaces[j]
                alone[alone] = (points[alone] @ normals.T > offsets).any(1)
        return float(shares[alone].sum())

    def _least_unique(self) -> tuple[float, int]:
        standing = [i for i, piece in enumerate(self.pieces) if piece is not None]
        for i in sorted(standing, key=lambda i: self.unique[i]):
            others = self.bounds[[j for j in standing if j != i]]
            if not len(others):
                break
            shrunk = np.abs(_common_bounds(others) - _common_bounds(self.bounds[standing]))
            if shrunk.max() <= SPAN * self.reach:
                return self.unique[i], i
        return np.inf, -1

    def _next_join(self) -> float:
        while self.heap and any(self.pieces[i] is None for i in self.heap[0][1:3]):
            heapq.heappop(self.heap)
        if not self.heap and not self.apart and self.count > 1:
            self._offer_apart()
        return self.heap[0][0] if self.heap else np.inf

    def _offer_apart(self) -> None:
        self.apart, self.heap = True, []
        for new in range(len(self.pieces)):
            self._offer(new)

    def solids(self) -> list[Manifold]:
        return [piece for piece in self.pieces if piece is not None]

    def shapes(self, size: float) -> tuple[Shape, ...]:
        """What is left as shapes; slivers are dropped unless nothing else is left. ``size``:
        longest side of the object."""
        found = []
        for i, piece in enumerate(self.pieces):
            if piece is not None:
                shape = self.kept.get(i) or rebuilt(piece, size)
                found += [] if shape is None else [shape]
        return tuple(found) or (self.given[0],)

    def inside(self, solid: Manifold) -> int:
        """How many places of other parts a convex solid holds."""
        lo, hi = corners_of(solid)[..., None]
        near = self.barred[:, ((self.barred > lo) & (self.barred < hi)).all(0)]
        if not near.size:
            return 0
        normals, offsets = half_spaces(solid)
        return int((normals @ near < offsets[:, None]).all(0).sum())

    def box(self, hull: Manifold) -> Manifold:
        """The box of a convex solid along the part's own axes, or the solid's."""
        vertices, faces = triangles(hull)
        frame = self.frame if self.frame is not None else own_frame(vertices, faces)
        return box_solid(*fitted_box(vertices, frame), frame)

    def _offer(self, new: int) -> None:
        """Pair a piece with those before it: of many, with those that it nearly touches."""
        own = self.pieces[new]
        if own is None:
            return
        low, high = self.bounds[new]
        away = np.maximum(self.bounds[:new, 0] - high, low - self.bounds[:new, 1]).max(1)
        near = away <= (np.inf if self.apart else NEAR * self.reach)
        for old in np.flatnonzero(near):
            other = self.pieces[old]
            if other is None:
                continue
            hull = Manifold.batch_hull([other, own])
            both = other.volume() + own.volume()
            if away[old] < 0:
                both -= (other ^ own).volume()
            if hull.is_empty() or hull.volume() < max(own.volume(), other.volume()) * (1 - 1e-6):
                continue  # manifold3d's hulls of points that are nearly coplanar
            best: tuple[float, Manifold] | None = None
            kinds = ((hull, 0.0), (self.box(hull), BOX_LIKE * self.extent))
            for joined, worth in kinds[self.boxes :]:
                cost = joined.volume() - both + self.toll * self.inside(joined)
                if best is None or cost <= best[0] + min(worth, 0.25 * abs(best[0]) + 1e-15):
                    best = cost, joined
            assert best is not None
            heapq.heappush(self.heap, (best[0], int(old), new, best[1]))


def _matter(shape: Shape, thick: float) -> tuple[np.ndarray, np.ndarray]:
    """Points [n, 3] spread in a shape, and the cubic metres [n] that each stands for: of a sheet
    thinner than ``thick`` as many as if it were so thick."""
    solid = as_solid(shape)
    frame = shape.rotation if isinstance(shape, Box) else np.eye(3)
    center, extent = fitted_box(triangles(solid)[0], frame)
    steps = (np.arange(OWN) + 0.5) / OWN - 0.5
    points = np.array(list(itertools.product(steps, repeat=3))) * extent @ frame.T + center
    if not isinstance(shape, Box):
        normals, offsets = half_spaces(solid)
        inside = (points @ normals.T <= offsets).all(1)
        points = points[inside] if inside.any() else triangles(solid)[0].mean(0)[None]
    matter = solid.volume() * max(1.0, thick / max(width(solid), 1e-3 * thick))
    return points, np.full(len(points), matter / len(points))


def _common_bounds(bounds: np.ndarray) -> np.ndarray:
    """[2, 3] of boxes [n, 2, 3]."""
    return np.stack([bounds[:, 0].min(0), bounds[:, 1].max(0)])


def _common_frame(shapes: Sequence[Shape]) -> np.ndarray | None:
    """[3, 3] of boxes that all lie along the same axes; None if they do not, or are not all
    boxes."""
    if not all(isinstance(s, Box) for s in shapes):
        return None
    frames = [np.asarray(s.rotation) for s in shapes if isinstance(s, Box)]
    along = frames[0]
    turned = [np.abs(along.T @ f).max(1).min() for f in frames]
    if min(turned) < 1 - 1e-9:
        return None
    return along if all(np.allclose(f, along, atol=1e-9) for f in frames) else None

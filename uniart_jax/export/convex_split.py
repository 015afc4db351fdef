"""Convex decomposition of a closed solid by cutting planes, within a distance.

coacd's cuts are axis-aligned and scored by samples: a washer's round drum takes it 14 to 60 s and
still stands .009 out of its surface. Here every cut is exact (manifold3d) and is looked for where
it can help: along the planes of the faces at reflex edges (what makes walls and steps convex in one
cut), along the planes that halve reflex edges (round walls, into wedges) and across the middle. The
cut that leaves the smallest hulls is taken, deepest piece first, until every hull keeps within the
tolerance of its piece.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Sequence

import igl
import numpy as np
from manifold3d import Error, Manifold, Mesh64

REFLEX = 0.05  # radians; duller edges are as good as flat
EDGE_PLANES = 10  # candidates of either kind
SAMPLES = 7  # steps along a hull's longest side when it is compared with a surface
CRUMB = 1e-7  # of a solid's volume
# of the excess: the first cut of a ring gains nothing; it shall go through the middle, and across
TIES = 0.03


def split_convex(solid: Manifold, surface: Surface, most: int) -> list[Manifold]:
    """Convex solids that cover ``solid`` and stand out of it by no more than the tolerance of its
    ``surface``.

    Args:
      solid: closed; one connected body or several.
      surface: its own.
      most: pieces at the most. If they do not suffice the deepest hollows are met and the others
        are filled.
    """
    heap: list[tuple[float, int, Manifold]] = []
    count = itertools.count()
    done: list[Manifold] = []
    for piece in bodies(solid):
        heapq.heappush(heap, (-_depth(piece, surface), next(count), piece))
    while heap and len(heap) + len(done) < most:
        depth, _, piece = heapq.heappop(heap)
        if -depth <= surface.tolerance:
            done.append(piece)
            break
        halves = _best_cut(piece, surface.tolerance)
        if not halves:
            done.append(piece)
        for half in halves:
            heapq.heappush(heap, (-_depth(half, surface), next(count), half))
    hulls = [piece.hull() for piece in [*done, *(entry[2] for entry in heap)]]
    return [h for h in hulls if h.volume() > 0]


def merge_convex(pieces: list[Manifold], surface: Surface) -> list[Manifold]:
    """Neighbours joined, while their common hull stands out of ``surface`` by no more than its
    tolerance; least excess first."""
    tolerance = surface.tolerance
    solids: list[Manifold | None] = list(pieces)
    bounds = np.array([p.bounding_box() for p in pieces]).reshape(-1, 2, 3)
    heap: list[tuple[float, int, int, Manifold]] = []

    def offer(new: int) -> None:
        """Pair a piece with those before it that are near."""
        low, high = bounds[new]
        near = (bounds[:new, 0] <= high + tolerance / 2) & (bounds[:new, 1] >= low - tolerance / 2)
        for old in np.flatnonzero(near.all(1)):
            other, own = solids[old], solids[new]
            if other is None or own is None:
                continue
            joined = Manifold.batch_hull([other, own])
            if not _covers(joined, other) or not _covers(joined, own):
                continue
            excess = joined.volume() - other.volume() - own.volume()
            if excess <= tolerance * joined.surface_area() / 4:
                heapq.heappush(heap, (excess, int(old), new, joined))

    for k in range(len(pieces)):
        offer(k)
    while heap:
        _, a, b, joined = heapq.heappop(heap)
        one, two = solids[a], solids[b]
        if one is None or two is None or surface.exceeded(joined, (one, two)):
            continue
        solids[a] = solids[b] = None
        solids.append(joined)
        bounds = np.concatenate([bounds, np.reshape(joined.bounding_box(), (1, 2, 3))])
        offer(len(solids) - 1)
    return [s for s in solids if s is not None]


class Surface:
    """The surface of a solid, that many hulls are compared with.

    Args:
      vertices, faces: [v, 3] float64, [f, 3] int64; closed, as far as inside and outside shall be
        told apart.
      tolerance: how far a hull may stand out of the solid.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, tolerance: float):
        self.vertices, self.faces, self.tolerance = vertices, faces, tolerance
        self.tree = igl.AABB()
        self.tree.init(vertices, faces)
        # Points of the free space just farther than the tolerance from the surface: a hull that
        # holds one fills a hollow, however narrow.
        corners, normals = faces_of(vertices, faces)
        normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
        middle = corners.mean(1)
        at = [middle] + [0.7 * corners[:, i] + 0.3 * middle for i in range(3)]
        probes = np.concatenate([a + 1.1 * tolerance * normals for a in at])
        probes = np.ascontiguousarray(probes[self.distance(probes) > tolerance])
        winding = np.asarray(igl.fast_winding_number(vertices, faces, probes)).ravel()
        self.free = probes[np.abs(winding) < 0.5]

    def distance(self, points: np.ndarray) -> np.ndarray:
        """[n] unsigned distances."""
        squared = self.tree.squared_distance(self.vertices, self.faces, points)[0]
        return np.sqrt(np.asarray(squared).ravel())

    def filled(self, hull: Manifold) -> bool:
        """Whether a hull holds a point that is known to be free."""
        lo, hi = np.reshape(hull.bounding_box(), (2, 3))
        near = self.free[((self.free > lo) & (self.free < hi)).all(1)]
        return bool(len(near)) and not bool(_outside(near, hull).all())

    def exceeded(self, hull: Manifold, within: Sequence[Manifold] = ()) -> bool:
        """Whether a hull stands out of the solid by more than the tolerance; what lies in the
        convex ``within`` is not asked about."""
        if self.filled(hull):
            return True
        points = spread(hull)
        distance = self.distance(points)
        far = points[np.argsort(-distance, kind="stable")][: int((distance > self.tolerance).sum())]
        for known in within:
            far = far[_outside(far, known)]
        for some in (far[:4], far[4:]):  # most that are refused are so by their farthest points
            if len(some):
                winding = igl.winding_number(self.vertices, self.faces, np.ascontiguousarray(some))
                if (np.abs(np.asarray(winding)) < 0.5).any():
                    return True
        return False


def _outside(points: np.ndarray, hull: Manifold) -> np.ndarray:
    """[n] whether points lie outside a convex solid."""
    above, areas = _above(points, hull)
    return np.asarray((above > 1e-9 * areas).any(1))


def _covers(hull: Manifold, piece: Manifold) -> bool:
    """Whether a hull holds a convex piece. manifold3d's sometimes do not, where points are nearly
    coplanar."""
    points = np.asarray(piece.to_mesh64().vert_properties, np.float64)[:, :3]
    above, areas = _above(points, hull)
    slack = 1e-4 * np.ptp(points, axis=0).max()
    return bool(len(areas)) and bool((above <= slack * areas).all())


def _above(points: np.ndarray, hull: Manifold) -> tuple[np.ndarray, np.ndarray]:
    """How far points [n, 3] lie above each face of a convex solid, [n, f], in units of twice the
    face's area, and these, [f]."""
    corners, normals = faces_of(*triangles(hull))
    above = points @ normals.T - (normals * corners[:, 0]).sum(1)
    return above, np.linalg.norm(normals, axis=1)


def bodies(solid: Manifold) -> list[Manifold]:
    """The connected bodies of a solid, every cavity with the body that it lies in."""
    crumb = CRUMB * abs(
        solid.volume()
    )  # what a cut through flat faces leaves behind, of either sign
    shells = [s for s in solid.decompose() if abs(s.volume()) > crumb]
    full = [s for s in shells if s.volume() > 0]
    hollow = [s for s in shells if s.volume() < 0]
    if hollow and len(full) > 1:
        return [solid]  # which cavity is whose does not matter enough to be asked
    return [solid] if hollow else full


def as_manifold(vertices: np.ndarray, faces: np.ndarray) -> Manifold | None:
    """A closed, oriented surface as a solid; None if it is not one."""
    # manifold3d crashes on an odd number, which no closed surface has.
    if len(faces) < 4 or len(faces) % 2:
        return None
    # Copies: the bindings refuse arrays that are read-only, as what they return is.
    mesh = Mesh64(np.array(vertices, np.float64, order="C"), np.array(faces, np.uint64, order="C"))
    solid = Manifold(mesh)
    if solid.status() != Error.NoError or solid.is_empty():
        return None
    return solid


def triangles(solid: Manifold) -> tuple[np.ndarray, np.ndarray]:
    """(vertices [v, 3], faces [f, 3]) with shared vertices."""
    mesh = solid.to_mesh64()
    vertices = np.asarray(mesh.vert_properties, np.float64)[:, :3]
    same = np.arange(len(vertices))
    same[np.asarray(mesh.merge_from_vert, np.int64)] = np.asarray(mesh.merge_to_vert, np.int64)
    return vertices, same[np.asarray(mesh.tri_verts, np.int64)]


def faces_of(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(corners [f, 3, 3], normals [f, 3] as long as twice the faces' areas)."""
    corners = vertices[faces]
    return corners, np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def _depth(piece: Manifold, surface: Surface) -> float:
    """How far the hull of a piece stands out of the piece."""
    hull = piece.hull()
    if hull.volume() - piece.volume() <= 1e-7 * hull.volume():
        return 0.0
    squared = igl.point_mesh_squared_distance(spread(hull), *triangles(piece))[0]
    depth = float(np.sqrt(np.max(squared)))
    return max(depth, 1.1 * surface.tolerance) if surface.filled(hull) else depth


def spread(hull: Manifold) -> np.ndarray:
    """[n, 3] points spread over the surface of a solid."""
    lo, hi = np.reshape(hull.bounding_box(), (2, 3))
    fine = hull.refine_to_length(float((hi - lo).max()) / SAMPLES)
    return np.ascontiguousarray(fine.to_mesh64().vert_properties[:, :3], np.float64)


def _best_cut(piece: Manifold, tolerance: float) -> list[Manifold]:
    """The pieces left by the best cut; [] if none divides."""
    volume, hull = piece.volume(), piece.hull()
    excess, area = hull.volume() - volume, hull.surface_area()
    best, least = [], np.inf
    for normal, offset in _planes(piece, tolerance):
        above, below = piece.split_by_plane(tuple(normal), float(offset))
        if above.is_empty() or below.is_empty():
            continue
        parts = [*bodies(above), *bodies(below)]
        if len(parts) < 2:
            continue
        hulls = [part.hull() for part in parts]
        left = sum(h.volume() for h in hulls) - volume
        uneven = abs(above.volume() - below.volume()) / volume
        left += TIES * excess * (uneven + sum(h.surface_area() for h in hulls) / area)
        if left < least - 1e-9 * excess:
            best, least = parts, left
    return best


def _planes(piece: Manifold, tolerance: float) -> list[tuple[np.ndarray, float]]:
    """(normal [3], offset) of the planes worth trying."""
    vertices, faces = triangles(piece)
    lo, hi = vertices.min(0), vertices.max(0)
    planes = [
        (np.eye(3)[axis], lo[axis] + share * (hi[axis] - lo[axis]))
        for axis in range(3)
        for share in (0.3, 0.5, 0.7)
    ]
    a, b, first, second, across = _reflex_edges(vertices, faces)
    if not len(a):
        return planes
    along = vertices[b] - vertices[a]
    length = np.linalg.norm(along, axis=1)
    weight = length * across
    middle = (vertices[a] + vertices[b]) / 2
    faced = np.concatenate([first, second])
    planes += _strongest(faced, np.tile(middle, (2, 1)), np.tile(weight, 2), tolerance)
    halving = np.cross(along, first + second)
    norm = np.linalg.norm(halving, axis=1)
    kept = norm > 1e-12
    planes += _strongest(halving[kept] / norm[kept, None], middle[kept], weight[kept], tolerance)
    return planes


def _reflex_edges(
    vertices: np.ndarray, faces: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Ends a, b [e], the normals [e, 3] of both faces and the angle [e] between them, of the edges
    that bend inwards."""
    _, normals = faces_of(vertices, faces)
    area = np.linalg.norm(normals, axis=1)
    normals = normals / np.maximum(area, 1e-300)[:, None]
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    owner = np.repeat(np.arange(len(faces)), 3)
    apex = faces[:, [2, 0, 1]].ravel()
    key = np.sort(edges, axis=1)
    order = np.lexsort((key[:, 1], key[:, 0]))
    here, there = order[:-1], order[1:]
    same = (key[here] == key[there]).all(1)
    here, there = here[same], there[same]
    a, b = edges[here].T
    first, second = normals[owner[here]], normals[owner[there]]
    rise = ((vertices[apex[there]] - vertices[a]) * first).sum(1)
    angle = np.arccos(np.clip((first * second).sum(1), -1, 1))
    sound = (area[owner[here]] > 0) & (area[owner[there]] > 0)
    reflex = (rise > 0) & (angle > REFLEX) & sound
    return a[reflex], b[reflex], first[reflex], second[reflex], angle[reflex]


def _strongest(
    normals: np.ndarray, points: np.ndarray, weights: np.ndarray, tolerance: float
) -> list[tuple[np.ndarray, float]]:
    """The planes through ``points`` that most weight agrees on."""
    largest = np.abs(normals).argmax(1)
    normals = normals * np.sign(normals[np.arange(len(normals)), largest])[:, None]
    offsets = (normals * points).sum(1)
    key = np.column_stack([np.round(normals * 25), np.round(offsets / tolerance)])
    _, first, group = np.unique(key, axis=0, return_index=True, return_inverse=True)
    total = np.bincount(group.ravel(), weights)
    chosen = first[np.argsort(-total, kind="stable")[:EDGE_PLANES]]
    return [(normals[i], float(offsets[i])) for i in chosen]

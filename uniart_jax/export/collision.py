"""Convex collision shapes that keep cavities: a drawer holds a ball, a cabinet stays open for its
drawers.

Every closed shell of a part becomes one box, the boxes of its walls, or hulls (``convex_split``);
then neighbours are joined while the surface allows it. No shape stands out of the part by more than
a small share of the object, so that the shapes of two parts meet only where the parts do. Shells
that are not closed are hulls or thin boxes if they are as good as convex or flat, else plates along
their walls (``sheets``).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import igl
import numpy as np
import trimesh
from manifold3d import Manifold
from scipy.spatial import ConvexHull, QhullError

from uniart_jax.export.box_cover import as_box, box_cover, flat_box, flat_plate, own_frame
from uniart_jax.export.convex_split import (
    Surface,
    as_manifold,
    merge_convex,
    split_convex,
    spread,
    triangles,
)
from uniart_jax.export.physics import Box, Hull, Shape
from uniart_jax.export.separation import overlaps, separated, width
from uniart_jax.export.sheets import plates


@dataclasses.dataclass(frozen=True)
class Detail:
    """How closely shapes follow the surface.

    Attributes:
      depth: of the object's longest side: how far a shape may stand out of its part.
      budget: convex pieces an object before neighbours are joined, shared by the parts' faces (600
        at most) times their longest sides; what bounds the time.
      part: least and most of those a part may have.
      finer: factors of ``depth`` that are tried in turn for parts whose shapes overlap.
    """

    depth: float
    budget: int
    part: tuple[int, int]
    finer: tuple[float, ...]


MADE = Detail(0.005, 384, (32, 256), (1 / 3, 1 / 9))
ROUGH = Detail(0.015, 64, (8, 48), ())  # finer takes twice as long and passes no more checks
ROUGH_FACES = 2500  # an object of more has rough shapes
# of the part's longest side: how far a shape may stand out of it, for small parts
PART_DEPTH = 0.06
OVERLAP = 0.004  # of the object's longest side, that shapes of two parts may stand in one another
SHELL_LEAST = 8  # pieces a hollow shell of the budget, where there are not too many shells
SHELL_BUDGET = 256  # shells a part; the smallest are left out
FACE_BUDGET = (
    200,
    600,
)  # a shell with more faces is simplified by a small share of the depth; with more still by up to .8 of it  # noqa: E501
CONVEX = 1e-3  # of its hull's volume that a convex solid may lack
HULL_VERTICES = 64
DIRECTIONS = 26  # with twelve extremes and what lies farthest out, at most 64 points
THIN = 1e-3  # of the part's longest side: a thinner shell is thickened
SLIVER = 0.2  # of that: what a cut leaves thinner is dropped; MuJoCo refuses flat hulls
# metres: a smaller part is a box of at least this; its corners would be welded to nothing, and
# manifold3d crashes on that
TINY = 1e-5


def collision_shapes(
    meshes: Sequence[trimesh.Trimesh], size: float | None = None
) -> list[tuple[Shape, ...]]:
    """Convex shapes, in the meshes' frame, that together stand for each part; at least one a part.

    Args:
      meshes: [K] parts of one object, metres; closed where they can be. A part below a hundredth of
        a millimetre is a box of that size.
      size: longest side of the object, default of all meshes together. Shapes stand out of a closed
        mesh by at most .75 % of it (objects of many faces: 2.3 %; or 9 % of the part's own longest
        side, if that is less), unless it needs more convex pieces than its share. Where shapes of
        two parts stand in one another by more than .4 %, both parts are made again, finer, as far
        as that helps, and what still does is cut apart (``separation``).
    """
    bounds = np.array([m.bounds for m in meshes])
    size = size or float((bounds[:, 1].max(0) - bounds[:, 0].min(0)).max())
    counts = np.array([len(m.faces) for m in meshes])
    detail = MADE if counts.sum() <= ROUGH_FACES else ROUGH
    # a lamp of thousands of faces must not leave the table that it stands on with eight pieces
    shares = np.minimum(counts, FACE_BUDGET[1]) * (bounds[:, 1] - bounds[:, 0]).max(1)
    budgets = np.clip(detail.budget * shares / max(shares.sum(), 1e-300), *detail.part).astype(int)

    def make(k: int, fineness: float) -> tuple[Shape, ...]:
        return _part_shapes(meshes[k], size, detail.depth * fineness, fineness, int(budgets[k]))

    shapes = [make(k, 1.0) for k in range(len(meshes))]
    for fineness in detail.finer:
        found = overlaps(shapes, OVERLAP * size)
        again = {k for pair in found for k in pair}
        tried = [make(k, fineness) if k in again else own for k, own in enumerate(shapes)]
        left = overlaps(tried, OVERLAP * size)
        better = {k for pair, deep in found.items() if left.get(pair, 0.0) < deep / 2 for k in pair}
        shapes = [tried[k] if k in better else own for k, own in enumerate(shapes)]

    return separated(shapes, OVERLAP * size, lambda piece: rebuilt(piece, size))


def rebuilt(piece: Manifold, size: float) -> Shape | None:
    """What is left of a shape that was cut, as a shape again; None if it is a sliver. ``size``:
    longest side of the object."""
    lo, hi = np.reshape(piece.bounding_box(), (2, 3))
    thin = THIN * float((hi - lo).max())
    return None if width(piece) <= SLIVER * thin else _shape(piece, OVERLAP * size / 4, thin)


def _part_shapes(
    mesh: trimesh.Trimesh, size: float, depth: float, fineness: float, budget: int
) -> tuple[Shape, ...]:
    vertices, faces = _welded(mesh)
    lo, hi = vertices.min(0), vertices.max(0)
    longest = float((hi - lo).max())
    if longest < TINY:
        return (Box((lo + hi) / 2, np.maximum(hi - lo, TINY), np.eye(3)),)
    tolerance = min(depth * size, PART_DEPTH * fineness * longest)
    thin = max(THIN * longest, 1e-9)
    solids, open_shells = _shells(vertices, faces)
    solids += _open_solids(vertices, open_shells, tolerance, thin)
    solids = [_simple(solid, tolerance) for solid in solids]
    pieces: list[Manifold] = []
    hollow: list[tuple[Manifold, Surface]] = []
    for solid in solids:
        surface = Surface(*triangles(solid), tolerance)
        if easy := _few_pieces(solid, surface, thin):
            pieces += easy
        else:
            hollow.append((solid, surface))
    total = sum(solid.num_tri() for solid, _ in hollow)  # a convex button needs no share
    least = max(1, min(SHELL_LEAST, budget // max(len(hollow), 1)))
    for solid, surface in hollow:
        cut = split_convex(solid, surface, max(least, budget * solid.num_tri() // total))
        pieces += [piece for piece in cut if width(piece) > SLIVER * thin]
    if len(pieces) > 1:
        pieces = merge_convex(pieces, _surface(solids, tolerance))
    shapes = [_shape(piece, tolerance / 2, thin) for piece in pieces]
    if not shapes:
        shapes = [_shape(flat_box(vertices, faces, thin), tolerance / 2, thin)]
    return tuple(shapes)


def _welded(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    """(vertices, faces): places made one, each face once, faces without area dropped while any is
    left."""
    welded = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    welded.merge_vertices(merge_tex=True, merge_norm=True)
    _, first = np.unique(np.sort(welded.faces, axis=1), axis=0, return_index=True)
    welded.update_faces(np.sort(first))  # twice, a face would be a shell of its own
    a, b, c = welded.faces.T
    proper = (a != b) & (b != c) & (a != c)
    if proper.any():
        welded.update_faces(proper)
    welded.remove_unreferenced_vertices()
    vertices, faces = np.asarray(welded.vertices, np.float64), np.asarray(welded.faces, np.int64)
    return np.ascontiguousarray(vertices), np.ascontiguousarray(faces)


def _shells(vertices: np.ndarray, faces: np.ndarray) -> tuple[list[Manifold], list[np.ndarray]]:
    """Closed shells as solids, cavities with what they are in; and the faces [f, 3] of every other
    shell."""
    pairs = trimesh.graph.face_adjacency(faces)  # edges of two faces only: solids may touch
    groups = trimesh.graph.connected_components(pairs, nodes=np.arange(len(faces)), min_len=1)
    extent = [
        float(np.prod(np.sort(np.ptp(vertices[faces[g]].reshape(-1, 3), axis=0))[1:]))
        for g in groups
    ]
    largest = np.argsort(-np.array(extent), kind="stable")[:SHELL_BUDGET]
    solids: list[Manifold] = []
    cavities: list[Manifold] = []
    open_shells = []
    for i in largest:
        own = faces[groups[i]]
        used, local = np.unique(own, return_inverse=True)
        solid = as_manifold(vertices[used], local.reshape(-1, 3))
        if solid is None or solid.volume() == 0:
            open_shells.append(own)
        elif solid.volume() > 0:
            solids.append(solid)
        else:
            cavities.append(solid)
    for cavity in cavities:
        box = np.array(cavity.bounding_box())
        around = [k for k, s in enumerate(solids) if _holds(np.array(s.bounding_box()), box)]
        if around:
            k = min(around, key=lambda k: solids[k].volume())
            points, corners = triangles(solids[k])
            inner, holes = triangles(cavity)
            # Manifold.compose would unite them.
            joined = as_manifold(
                np.concatenate([points, inner]), np.concatenate([corners, holes + len(points)])
            )
            solids[k] = solids[k] if joined is None else joined
        else:  # a shell that is inside out
            turned = as_manifold(*_turned(cavity))
            solids += [turned] if turned is not None else []
    return solids, open_shells


def _holds(outer: np.ndarray, inner: np.ndarray) -> bool:
    return bool((outer[:3] <= inner[:3]).all() and (outer[3:] >= inner[3:]).all())


def _simple(solid: Manifold, tolerance: float) -> Manifold:
    if solid.volume() >= (1 - CONVEX) * solid.hull().volume():
        return solid  # its hull is all that is asked for, and flat ones would lose their thickness
    simple, step = solid, tolerance / 5
    while simple.num_tri() > FACE_BUDGET[step > tolerance / 5] and step < tolerance:
        coarser = solid.simplify(step)
        if coarser.is_empty() or coarser.volume() <= 0:
            break
        simple, step = coarser, 2 * step
    return simple


def _surface(solids: list[Manifold], tolerance: float) -> Surface:
    """All shells of a part."""
    points, corners, count = [], [], 0
    for solid in solids:
        own, faces = triangles(solid)
        points.append(own)
        corners.append(faces + count)
        count += len(own)
    return Surface(np.concatenate(points), np.concatenate(corners), tolerance)


def _few_pieces(solid: Manifold, surface: Surface, thin: float) -> list[Manifold]:
    """The hull of what is as good as convex, the walls of what is built of walls; [] for all
    else."""
    hull = solid.hull()
    if not surface.exceeded(hull):
        return [hull] if width(hull) > thin else [flat_plate(hull, thin)]
    return [piece for piece in box_cover(surface) if width(piece) > SLIVER * thin]


def _open_solids(
    vertices: np.ndarray, shells: list[np.ndarray], tolerance: float, thin: float
) -> list[Manifold]:
    """Open shells as closed ones: thin boxes where they are flat, hulls where they are as good as
    convex, else plates along their walls."""
    solids, hollow = [], []
    for faces in shells:
        points = vertices[np.unique(faces)]
        hull = Manifold.hull_points(points)
        lo, hi = points.min(0), points.max(0)
        if hull.is_empty() or hull.volume() <= thin * np.prod(np.sort(hi - lo)[1:]):
            corners = np.arange(faces.size).reshape(-1, 3)
            solids.append(flat_box(vertices[faces].reshape(-1, 3), corners, thin))
        elif (
            np.max(igl.point_mesh_squared_distance(spread(hull), vertices, faces)[0])
            <= tolerance**2
        ):
            solids.append(hull)
        else:
            hollow.append(faces)
    if hollow:
        solids += plates(vertices, np.concatenate(hollow), tolerance / 2, max(thin, tolerance / 2))
    return solids


def _turned(solid: Manifold) -> tuple[np.ndarray, np.ndarray]:
    points, corners = triangles(solid)
    return points, np.ascontiguousarray(corners[:, ::-1])


def _shape(piece: Manifold, slack: float, thin: float) -> Shape:
    box = as_box(piece, slack)
    if box is not None:
        center, size, frame = box
        return Box(center, np.maximum(size, thin), frame)
    vertices, faces = triangles(piece)
    if len(vertices) > HULL_VERTICES:
        vertices = vertices[_outermost(vertices, own_frame(vertices, faces))]
        vertices, faces = triangles(Manifold.hull_points(vertices))
    try:  # manifold3d's hulls can miss a point by a little
        return Hull(trimesh.convex.convex_hull(vertices))
    except QhullError:
        return Hull(trimesh.Trimesh(vertices, faces, process=False))


def _outermost(points: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """[n <= HULL_VERTICES] which of a solid's points [v, 3] have nearly its hull, however flat it
    is.

    The extremes along its own axes and the object's keep its extents; then the farthest in
    directions spread over a sphere, then those that lie farthest out of the hull so far, both in
    coordinates in which the points spread alike along all axes.
    """
    offset = points - points.mean(0)
    axes = np.concatenate([np.eye(3), frame.T])
    _, spans, main = np.linalg.svd(offset, full_matrices=False)
    even = offset @ main.T / np.maximum(spans, 1e-12 * spans[0])
    height = 1 - (2 * np.arange(DIRECTIONS) + 1) / DIRECTIONS
    turn = np.pi * (3 - 5**0.5) * np.arange(DIRECTIONS)
    ring = np.sqrt(1 - height**2)
    directions = np.stack([ring * np.cos(turn), ring * np.sin(turn), height])
    along = np.column_stack([offset @ axes.T, -offset @ axes.T, even @ directions])
    chosen = np.unique(along.argmax(0))
    try:
        hull = ConvexHull(even[chosen], incremental=True)
        while len(chosen) < HULL_VERTICES:
            out = (even @ hull.equations[:, :3].T + hull.equations[:, 3]).max(1)
            out[chosen] = 0
            farthest = int(out.argmax())
            if out[farthest] <= 0:
                break
            chosen = np.append(chosen, farthest)
            hull.add_points(even[[farthest]])
    except QhullError:  # nearly flat; the extremes are chosen
        pass
    return chosen

"""Solids for printing: made of meshes, joined, grown, swept along a joint. Millimetres."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence

import igl
import numpy as np
import trimesh
from manifold3d import CrossSection, Error, JoinType, Manifold, Mesh64, OpType

from uniart_jax.export.convex_split import triangles
from uniart_jax.objects.kinematics import Joint

WELD = 0.05  # shells of one part that are nearer than this become one
CRUMB = 2.0  # mm^3: less is no piece
STRUT = 1.2  # radius of what joins pieces that do not touch
COARSE = float(np.deg2rad(40.0))  # what a sweep begins with
MOST_SLICES = 48  # across a slide
LAYER, MOST_LAYERS = 0.05, 12  # thinnest, and most, that a sweep is made of
TRIFLE = 0.01  # detail below is left out of what was cut
SEGMENTS = 36
ROUND = 1 / np.cos(np.pi / SEGMENTS)  # of a polygon's corners to its sides
FINE = 1200  # triangles: solids of more are made coarser before they grow


def solid_of(vertices: np.ndarray, faces: np.ndarray) -> tuple[Manifold, int]:
    """The solid that a closed surface [v, 3], [f, 3] bounds, shells that touch made one.

    Returns:
      The solid, and how many shells were no solids by themselves: their hulls stand for them.
    """
    whole = _manifold(vertices, faces)
    if whole is not None:
        return welded(whole.decompose()), 0
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    shells, hulls = [], 0
    for shell in mesh.split(only_watertight=False):
        found = _manifold(np.asarray(shell.vertices), np.asarray(shell.faces))
        if found is None:
            hulls += 1
            found = Manifold.hull_points(np.ascontiguousarray(shell.vertices, np.float64))
        shells.append(found)
    return welded(shells), hulls


def _manifold(vertices: np.ndarray, faces: np.ndarray) -> Manifold | None:
    points = np.ascontiguousarray(vertices, np.float64)
    made = Manifold(Mesh64(points, np.ascontiguousarray(faces, np.uint64)))
    if made.status() != Error.NoError or made.is_empty():
        return None
    if made.volume() < 0:
        made = Manifold(Mesh64(points, np.ascontiguousarray(faces[:, ::-1], np.uint64)))
    # Shells in one another's way add up here; cavities, whose volume is negative, do not.
    return made if made.volume() > 0 else None


def welded(shells: Sequence[Manifold]) -> Manifold:
    """Solids as one; all but the largest grow by a hair, so that what nearly touches does."""
    kept = sorted((s for s in shells if not s.is_empty()), key=lambda s: -s.volume())
    return union([*kept[:1], *(grown(s, WELD) for s in kept[1:])])


def union(solids: Iterable[Manifold]) -> Manifold:
    """All of them as one; nothing of none."""
    some = [s for s in solids if not s.is_empty()]
    if not some:
        return Manifold()
    return some[0] if len(some) == 1 else Manifold.batch_boolean(some, OpType.Add)


def grown(solid: Manifold, by: float) -> Manifold:
    """The solid and all that is nearer to it than ``by`` (the sum with a cube: at slanted faces up
    to 1.7 times as far)."""
    if solid.is_empty():
        return solid
    tool = Manifold.cube((2 * by,) * 3, True)
    made = _sum(solid, tool, by)
    if made is not None:
        return made
    solid = solid.simplify(by / 2)
    corners = np.unique(triangles(tool)[0], axis=0) * 1.2 * 1.5
    return union([solid, *(solid.translate(tuple(corner)) for corner in corners)])


def _sum(solid: Manifold, tool: Manifold, by: float) -> Manifold | None:
    """The Minkowski sum; None if the solid has too many triangles for it."""
    hull = solid.hull()
    if hull.volume() - solid.volume() <= 1e-6 * hull.volume():
        return hull.minkowski_sum(tool)
    if solid.num_tri() > FINE:  # what is taken off is made good for
        solid = solid.simplify(by / 2)
        tool = tool.minkowski_sum(Manifold.cube((by,) * 3, True))
    return solid.minkowski_sum(tool) if solid.num_tri() <= FINE else None


def _slid(mover: Manifold, joint: Joint, by: float) -> Manifold:
    """A mover's whole way along a slide, grown by ``by``."""
    cube = Manifold.cube((2 * by,) * 3, True)
    ends = [cube.translate(tuple(joint.direction * t)) for t in joint.travel]
    made = _sum(mover, Manifold.batch_hull(ends), by)
    if made is not None:
        return made
    frame, cuts = axis_frame(joint), []
    moving = turned(mover, np.linalg.inv(frame))
    (*_, lo), (*_, hi) = box_of(moving)
    count = int(np.clip(np.ceil((hi - lo) / by), 1, MOST_SLICES))
    for low, high in itertools.pairwise(np.linspace(lo, hi, count + 1)):
        slab = moving.trim_by_plane((0, 0, 1), low).trim_by_plane((0, 0, -1), -high)
        if slab.is_empty():
            continue
        outline = slab.project().offset(1.15 * by, JoinType.Square).simplify(TRIFLE)
        start, end = low + joint.travel[0] - by, high + joint.travel[1] + by
        cuts.append(outline.extrude(end - start).translate((0, 0, start)))
    return turned(union(cuts), frame)


def turned(solid: Manifold, matrix: np.ndarray) -> Manifold:
    """The solid moved by [4, 4]."""
    return solid.transform(np.ascontiguousarray(matrix[:3], np.float64))


def rod(radius: float, low: float, high: float, top: float | None = None) -> Manifold:
    """A cylinder about z between two heights; with ``top``, a cone of that radius above."""
    upper = radius if top is None else top
    return Manifold.cylinder(high - low, radius, upper, SEGMENTS).translate((0, 0, low))


def block(lo: Sequence[float], hi: Sequence[float]) -> Manifold:
    """The axis-aligned box between two corners."""
    return Manifold.cube(tuple(np.subtract(hi, lo))).translate(tuple(lo))


def box_of(solid: Manifold) -> np.ndarray:
    """[2, 3] corners of the solid's box."""
    return np.array(solid.bounding_box()).reshape(2, 3)


def axis_frame(joint: Joint) -> np.ndarray:
    """[4, 4] from a frame whose z axis is the joint's axis to the frame that the joint is in."""
    z = joint.direction
    x = np.cross(z, np.eye(3)[np.abs(z).argmin()])
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3] = np.column_stack([x, np.cross(z, x), z, joint.origin])
    return matrix


def without_path(solid: Manifold, mover: Manifold, joint: Joint, by: float) -> Manifold:
    """``solid`` without what ``mover`` (at coordinate 0) comes nearer to than ``by`` on its way.

    Along a slide the path is the exact sum with a cube; a mover of many triangles is taken apart
    into slices across the slide, and gets up to a slice more room at both ends. About a hinge the
    mover is taken apart into layers along the axis and rings about it, each as what it looks like
    from along the axis: what is cut away is at least as much as is needed, and nothing where the
    two stay apart.
    """
    if solid.is_empty() or mover.is_empty():
        return solid
    if not joint.rotates:
        return (solid - _slid(mover, joint, by)).simplify(TRIFLE)
    frame = axis_frame(joint)
    here = np.linalg.inv(frame)
    block_, moving = turned(solid, here), turned(mover, here)
    points = triangles(moving)[0]
    out = float(np.linalg.norm(points[:, :2], axis=1).max()) + 1e-6
    lo, hi = box_of(block_)
    near = float(np.linalg.norm(np.clip(0, lo[:2], hi[:2]))) - by
    cuts = []
    for low, high in _layers(points[:, 2]):
        if low > hi[2] + by or high < lo[2] - by:
            continue
        reach = 1.51 * by  # of ``_meetings``' last look; what is farther along the axis is not met
        band = block_.trim_by_plane((0, 0, 1), low - reach)
        band = band.trim_by_plane((0, 0, -1), -high - reach)
        inner, outer = 0.0, 8.0
        while inner < out:
            if outer < near:
                inner, outer = outer, outer * 2
                continue
            shell = rod(outer * ROUND, low, high)
            if inner > 0:
                shell -= rod(0.95 * inner, low - 1, high + 1)
            ring = moving ^ shell
            all_round = joint.type == "continuous"
            states = _meetings(band, ring, joint.limits, by, min(outer, out), all_round)
            if len(states):
                path = _path(ring, states, all_round)
                path = path.offset(1.15 * by, JoinType.Square).simplify(TRIFLE)
                cuts.append(path.extrude(high - low + 2 * by).translate((0, 0, low - by)))
            inner, outer = outer, outer * 2
    return turned((block_ - union(cuts)).simplify(TRIFLE), frame) if cuts else solid


def _layers(heights: np.ndarray) -> list[tuple[float, float]]:
    """Spans between the heights at which the outline changes; even ones if these are many."""
    levels = np.unique(np.round(heights, 2))
    levels = levels[np.concatenate([[True], np.diff(levels) > LAYER])]
    lo, hi = float(heights.min()), float(heights.max())
    if len(levels) > MOST_LAYERS:
        levels = np.linspace(lo, hi, MOST_LAYERS + 1)
    inside = [float(z) for z in levels if lo + LAYER < z < hi - LAYER]
    return list(zip([lo, *inside], [*inside, hi], strict=True))


def _meetings(
    solid: Manifold,
    ring: Manifold,
    limits: tuple[float, float],
    by: float,
    lever: float,
    one: bool,
) -> list[float]:
    """Coordinates, as dense as ``by`` asks for, at which ``ring`` comes near to the solid; with
    ``one`` the first that is found."""
    if ring.is_empty():
        return []
    count = max(1, int(np.ceil((limits[1] - limits[0]) / COARSE)))
    ends = np.linspace(*limits, count + 1)
    spans, found = list(itertools.pairwise(ends)), set()
    while spans:
        lo, hi = spans.pop()
        middle, way = (lo + hi) / 2, lever * (hi - lo) / 2
        near = ring.rotate((0, 0, float(np.rad2deg(middle)))).min_gap(solid, by + way)
        if near >= by + way:
            continue
        if way > by / 2:
            spans += [(lo, middle), (middle, hi)]
        else:
            found |= {lo, middle, hi}
            if one:
                break
    return sorted(found)


def _path(ring: Manifold, states: Sequence[float], all_round: bool) -> CrossSection:
    """What a ring passes over, seen from along the axis."""
    outline = ring.project()
    if all_round:
        points = triangles(ring)[0][:, :2]
        radii = np.linalg.norm(points, axis=1)
        around = CrossSection.circle(float(radii.max()) * ROUND, SEGMENTS)
        hole = outline.offset(-1e-3, JoinType.Square) ^ CrossSection.circle(0.1, 8)
        return (
            around
            if not hole.is_empty()
            else around - CrossSection.circle(_least_radius(outline), SEGMENTS)
        )
    passed = [outline.rotate(float(np.rad2deg(q))) for q in states]
    while len(passed) > 1:  # a few at a time: of many at once Clipper finds every crossing
        passed = [
            CrossSection.batch_boolean(passed[i : i + 8], OpType.Add)
            for i in range(0, len(passed), 8)
        ]
    return passed[0]


def _least_radius(outline: CrossSection) -> float:
    """How near to 0 an outline comes."""
    best = np.inf
    for ring in outline.to_polygons():
        a, b = np.asarray(ring), np.roll(np.asarray(ring), -1, axis=0)
        way = b - a
        t = np.clip(-(a * way).sum(1) / np.maximum((way**2).sum(1), 1e-12), 0, 1)
        best = min(best, float(np.linalg.norm(a + t[:, None] * way, axis=1).min()))
    return best


def one_piece(solid: Manifold) -> Manifold | None:
    """The solid without crumbs; None if it falls into several pieces."""
    pieces = [p for p in solid.decompose() if p.volume() > CRUMB]
    return pieces[0] if len(pieces) == 1 else None


def strutted(solid: Manifold) -> tuple[Manifold, list[float], int]:
    """Pieces that do not touch, joined to the largest by struts where they are nearest.

    Returns:
      The solid in one piece, the length of every strut, and how many crumbs were left out.
    """
    pieces = sorted(solid.decompose(), key=lambda p: -p.volume())
    crumbs = [p for p in pieces[1:] if p.volume() <= CRUMB]
    left, whole, lengths = [p for p in pieces[1:] if p.volume() > CRUMB], pieces[0], []
    while left:
        near = [_nearest(whole, piece) for piece in left]
        k = int(np.argmin([np.linalg.norm(a - b) for a, b in near]))
        a, b = near[k]
        lengths.append(float(np.linalg.norm(a - b)))
        ball = Manifold.sphere(STRUT, 16)
        strut = Manifold.batch_hull([ball.translate(tuple(a)), ball.translate(tuple(b))])
        whole = union([whole, strut, left.pop(k)])
    return whole, lengths, len(crumbs)


def _nearest(one: Manifold, two: Manifold) -> tuple[np.ndarray, np.ndarray]:
    """A point of each, as near to each other as a vertex of one comes to the other's surface."""
    best = None
    for a, b, swapped in ((one, two, False), (two, one, True)):
        points, (vertices, faces) = triangles(a)[0], triangles(b)
        squared, _, there = igl.point_mesh_squared_distance(points, vertices, faces)
        k = int(np.argmin(squared))
        pair = (there[k], points[k]) if swapped else (points[k], there[k])
        if best is None or squared[k] < best[0]:
            best = (squared[k], pair)
    assert best is not None
    return best[1]

"""Closed solids for parametric objects, and the assembly of parts.

Every primitive is a ``manifold3d.Manifold`` in metres (z up, front at -x). A ``Shape`` groups
solids by material: solids of one material are united exactly, materials stand side by side as
separate closed shells that touch. So each part's mesh is closed, edge-manifold and
outward-oriented, and every face knows its colour.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterable, Iterator

import numpy as np
import trimesh
from manifold3d import CrossSection, Manifold, Mesh64, OpType
from numpy.typing import ArrayLike

from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.procedural.materials import Material, atlas

HAIR = 3e-5  # metres between the shells of two materials

_AXIS_FRAMES = {  # columns: where local x, y, z of a body of revolution or an extrusion along z go
    "x": np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]),
    "y": np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]),
    "z": np.eye(3),
}


class NoRoomError(ValueError):
    """Measures that leave no room for a box."""


def exact(values: ArrayLike) -> np.ndarray:
    """Coordinates on a binary grid of about a micrometre: sums and differences are then exact, and
    faces that should be flush are."""
    return np.round(np.asarray(values, dtype=np.float64) * 2.0**20) / 2.0**20


def box(lo: ArrayLike, hi: ArrayLike) -> Manifold:
    """The axis-aligned box between two corners.

    Raises:
      NoRoomError: ``hi`` is not above ``lo`` in every axis.
    """
    lo, hi = exact(lo), exact(hi)
    if not np.all(hi - lo > 1e-9):
        raise NoRoomError(
            f"box: expected lo < hi in every axis, got {lo.tolist()} and {hi.tolist()}"
        )
    return Manifold.cube(tuple(hi - lo)).translate(tuple(lo))


def along(solid: Manifold, axis: str, at: ArrayLike) -> Manifold:
    """A solid made along z, turned so that z becomes ``axis``, and moved to ``at``."""
    return solid.transform(np.column_stack([_AXIS_FRAMES[axis], exact(at)]))


def cylinder(
    axis: str,
    at: ArrayLike,
    length: float,
    radius: float,
    top: float | None = None,
    segments: int = 20,
) -> Manifold:
    """A cylinder (or cone: other radius ``top`` at the far end) from ``at`` along +``axis``."""
    return along(
        Manifold.cylinder(length, radius, radius if top is None else top, segments), axis, at
    )


def tube(
    axis: str, at: ArrayLike, length: float, radius: float, inner: float, segments: int = 24
) -> Manifold:
    """A hollow cylinder from ``at`` along +``axis``, open at both ends."""
    outside = Manifold.cylinder(length, radius, radius, segments)
    inside = Manifold.cylinder(length * 1.2, inner, inner, segments).translate(
        (0, 0, -length * 0.1)
    )
    return along(outside - inside, axis, at)


def ball(at: ArrayLike, radius: float, segments: int = 12) -> Manifold:
    """A sphere."""
    return Manifold.sphere(radius, segments).translate(tuple(np.asarray(at, dtype=np.float64)))


def extrusion(polygon: np.ndarray, axis: str, at: ArrayLike, length: float) -> Manifold:
    """A polygon [n, 2] pushed along +``axis``. Its plane is (y, z) for 'x', (z, x) for 'y', (x, y)
    for 'z'."""
    section = CrossSection([np.asarray(polygon, dtype=np.float64)])
    if section.area() <= 0:
        section = CrossSection([np.asarray(polygon, dtype=np.float64)[::-1]])
    return along(Manifold.extrude(section, length), axis, at)


def revolution(profile: np.ndarray, axis: str, at: ArrayLike, segments: int = 24) -> Manifold:
    """A profile [n, 2] of (radius, height along ``axis``), closed, turned about ``axis`` through
    ``at``."""
    section = CrossSection([np.asarray(profile, dtype=np.float64)])
    if section.area() <= 0:
        section = CrossSection([np.asarray(profile, dtype=np.float64)[::-1]])
    return along(Manifold.revolve(section, segments), axis, at)


def hull(points: np.ndarray) -> Manifold:
    """The convex hull of points [n, 3]."""
    return Manifold.hull_points(np.asarray(points, dtype=np.float64))


def union(solids: Iterable[Manifold]) -> Manifold:
    """The exact union of solids."""
    solids = list(solids)
    return solids[0] if len(solids) == 1 else Manifold.batch_boolean(solids, OpType.Add)


def cut(solid: Manifold, holes: Iterable[Manifold]) -> Manifold:
    """``solid`` without ``holes``."""
    holes = list(holes)
    return Manifold.batch_boolean([solid, *holes], OpType.Subtract) if holes else solid


def tray(lo: ArrayLike, hi: ArrayLike, wall: float, *, open_front: bool = False) -> Manifold:
    """A box of walls ``wall`` thick, open at the top (and towards -x with ``open_front``): drawer
    boxes, racks, bins."""
    lo, hi = np.asarray(lo, dtype=np.float64), np.asarray(hi, dtype=np.float64)
    inner_lo = lo + wall
    if open_front:
        inner_lo[0] = lo[0] - wall
    return box(lo, hi) - box(inner_lo, [hi[0] - wall, hi[1] - wall, hi[2] + wall])


class Shape:
    """Closed solids of several materials: one part's geometry while it is being built."""

    def __init__(self) -> None:
        self._solids: dict[Material, list[Manifold]] = {}

    def add(self, solid: Manifold, material: Material) -> Shape:
        """Add a solid. Solids of other materials may touch it but should not overlap it by more
        than a hair."""
        self._solids.setdefault(material, []).append(solid)
        return self

    def join(self, other: Shape) -> Shape:
        """Add all solids of another shape."""
        for material, solids in other._solids.items():
            self._solids.setdefault(material, []).extend(solids)
        return self

    def moved(self, matrix: np.ndarray) -> Shape:
        """All solids moved by a rigid motion [4, 4]."""
        out = Shape()
        for material, solids in self._solids.items():
            out._solids[material] = [solid.transform(matrix[:3]) for solid in solids]
        return out

    def cut(self, hole: Manifold, material: Material) -> None:
        """Cut a hole out of the solids of one material."""
        self._solids[material] = [union(self._solids[material]) - hole]

    def pieces(self) -> Iterator[tuple[Manifold, Material]]:
        """One solid a material, each the union of what was added in it."""
        return ((union(solids), material) for material, solids in self._solids.items())

    def solid(self) -> Manifold:
        """What all solids fill together."""
        return union(itertools.chain(*self._solids.values()))

    def mesh(self) -> trimesh.Trimesh:
        """One closed mesh with face colours, or with one atlas image and UVs if any material has an
        image."""
        materials, vertices, faces = [], [], []
        for material, solids in self._solids.items():
            mesh = union(solids).to_mesh64()
            if len(mesh.tri_verts) == 0:
                continue
            points = np.asarray(mesh.vert_properties)[:, :3]
            vertices.append(_shrunk(points, len(materials) * HAIR))
            materials.append(material)
            faces.append(np.asarray(mesh.tri_verts).astype(np.int64))
        starts = np.cumsum([0] + [len(v) for v in vertices[:-1]])
        out = trimesh.Trimesh(
            np.concatenate(vertices),
            np.concatenate([f + s for f, s in zip(faces, starts, strict=True)]),
            process=False,
        )
        if any(m.image is not None for m in materials):
            out.visual = atlas(materials, vertices)
        else:
            colors = np.array([[*m.color, 1.0] for m in materials])
            counts = [len(f) for f in faces]
            colors = np.repeat((colors * 255 + 0.5).astype(np.uint8), counts, axis=0)
            out.visual = trimesh.visual.ColorVisuals(mesh=out, face_colors=colors)
        return out


def _shrunk(points: np.ndarray, hair: float) -> np.ndarray:
    """Points with each side of their box drawn in by ``hair``: readers that merge equal vertices
    must not weld shells that touch."""
    lo, hi = points.min(0), points.max(0)
    center = (lo + hi) / 2
    return center + (points - center) * (1 - 2 * hair / np.maximum(hi - lo, 1e-3))


class Assembly:
    """Parts of one object while it is being built (metres, all joints at 0 in the closed state)."""

    def __init__(self) -> None:
        self.parts: list[Part] = []

    def add(
        self, name: str, shape: Shape, parent: int = -1, joint: Joint | None = None, label: str = ""
    ) -> int:
        """Add a part and return its index; a name already taken gets a number."""
        taken = {p.name for p in self.parts}
        count, unique = 1, name
        while unique in taken:
            count += 1
            unique = f"{name}_{count}"
        joint = Joint.fixed() if joint is None else joint
        self.parts.append(Part(unique, shape.mesh(), parent, joint, label or name))
        return len(self.parts) - 1

    def object(self) -> ArticulatedObject:
        """The finished object."""
        return ArticulatedObject(tuple(self.parts))


def about_z(angle: float) -> np.ndarray:
    """The rotation [4, 4] about z by ``angle`` radians."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])


PartSpec = tuple[str, Shape, int, Joint | None]  # name, shape, index of the parent, joint


def assembled(parts: Iterable[PartSpec], turned: np.ndarray | None = None) -> ArticulatedObject:
    """The object made of ``parts``, all moved by a rotation [4, 4]."""
    asm = Assembly()
    for name, shape, parent, joint in parts:
        if turned is not None:
            shape = shape.moved(turned)
        if turned is not None and joint is not None:
            at, axis = turned[:3, :3] @ joint.origin, turned[:3, :3] @ joint.direction
            joint = dataclasses.replace(joint, origin=at, direction=axis)
        asm.add(name, shape, parent, joint)
    return asm.object()


def hinge(at: ArrayLike, axis: ArrayLike, angle: float) -> Joint:
    """A revolute joint through ``at`` about ``axis``, from closed (0) to ``angle`` radians
    (negative: the other way)."""
    limits = (0.0, float(angle)) if angle >= 0 else (float(angle), 0.0)
    return Joint(np.asarray(at, dtype=np.float64), np.asarray(axis, dtype=np.float64), angle=limits)


def slide(axis: ArrayLike, length: float) -> Joint:
    """A prismatic joint along ``axis``, from 0 to ``length`` metres."""
    return Joint(np.zeros(3), np.asarray(axis, dtype=np.float64), travel=(0.0, float(length)))


def turn(at: ArrayLike, axis: ArrayLike) -> Joint:
    """A continuous joint through ``at`` about ``axis``."""
    return Joint(
        np.asarray(at, dtype=np.float64), np.asarray(axis, dtype=np.float64), angle=(-np.pi, np.pi)
    )


def screw(
    at: ArrayLike, axis: ArrayLike, turns: float, travel: float, *, left_handed: bool = False
) -> Joint:
    """A screw joint: ``turns`` about ``axis`` through ``at`` carry the part by ``travel`` metres
    along +``axis``.

    Right-handed: counter-clockwise, seen against the axis. Left-handed: the other way round, the
    coordinate from ``-2 pi turns`` to 0.
    """
    angle = 2 * np.pi * float(turns)
    at, axis = np.asarray(at, dtype=np.float64), np.asarray(axis, dtype=np.float64)
    if left_handed:
        return Joint(at, axis, angle=(-angle, 0.0), travel=(float(travel), 0.0))
    return Joint(at, axis, angle=(0.0, angle), travel=(0.0, float(travel)))


def rounded(width: float, height: float, radius: float, corner: int = 5) -> np.ndarray:
    """A rectangle [n, 2] about 0 with its corners rounded by ``radius``; ``corner`` points each."""
    radius = min(radius, 0.499 * width, 0.499 * height)
    turns = np.linspace(0, np.pi / 2, corner)
    points = []
    for k, (sx, sy) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        center = np.array([sx * (width / 2 - radius), sy * (height / 2 - radius)])
        angle = turns + k * np.pi / 2
        points.append(center + radius * np.column_stack([np.cos(angle), np.sin(angle)]))
    return np.vstack(points)


def inset(outline: np.ndarray, by: float) -> np.ndarray:
    """An outline [n, 2] about 0 drawn in by about ``by`` on all sides."""
    return outline * (1 - by / np.abs(outline).max(0))


def egg(front: float, rear: float, half: float, power: float = 2.0, points: int = 32) -> np.ndarray:
    """An outline [points, 2]: ``front`` towards -x and ``rear`` towards +x of 0, ``half`` wide;
    above 2, ``power`` squares its rear."""
    angle = np.linspace(0, 2 * np.pi, points, endpoint=False)
    c, s = np.cos(angle), np.sin(angle)
    p = np.where(c > 0, power, 2.0)
    x = np.where(c > 0, rear, front) * np.sign(c) * np.abs(c) ** (2 / p)
    return np.column_stack([x, half * np.sign(s) * np.abs(s) ** (2 / p)])


def loft(below: np.ndarray, above: np.ndarray, z0: float, z1: float) -> Manifold:
    """The body between two convex outlines [n, 2] of (x, y), counter-clockwise, at heights ``z0``
    and ``z1``.

    Outlines of one length are joined point by point; hulls of many coplanar points may come out
    with folds.
    """
    low = np.column_stack([below, np.full(len(below), z0)])
    high = np.column_stack([above, np.full(len(above), z1)])
    if len(low) != len(high):
        return hull(np.vstack([low, high]))
    n = len(low)
    i, j = np.arange(n), np.roll(np.arange(n), -1)
    bottom, top = np.full(n, 2 * n), np.full(n, 2 * n + 1)
    faces = [[i, j, n + j], [i, n + j, n + i], [bottom, j, i], [top, n + i, n + j]]
    return Manifold(
        Mesh64(
            vert_properties=np.vstack([low, high, low.mean(0), high.mean(0)]),
            tri_verts=np.concatenate([np.column_stack(f) for f in faces]).astype(np.uint64),
        )
    )


def pipe(points: ArrayLike, radius: float, segments: int = 12) -> Manifold:
    """A round bar of ``radius`` along a polyline [n, 3], rounded at its bends and ends."""
    balls = [ball(p, radius, segments) for p in np.asarray(points, dtype=np.float64)]
    return union([Manifold.batch_hull([a, b]) for a, b in itertools.pairwise(balls)])


def tidy(solid: Manifold, tolerance: float = 1e-5) -> Manifold:
    """``solid`` without slivers: edges below ``tolerance`` metres closed up, crumbs of no volume
    dropped."""
    pieces = [p for p in solid.simplify(tolerance).decompose() if p.volume() > tolerance**2]
    return Manifold.compose(pieces)


def rooted(grip: Manifold, face: float, deep: float, ground: Manifold) -> Manifold:
    """A pull that stands on the plane x = ``face``, its feet drawn up to ``deep`` further to the
    rear, to where they meet ``ground``."""
    lying = grip.transform(np.column_stack([_AXIS_FRAMES["x"].T, np.zeros(3)]))
    feet = along(Manifold.extrude(lying.slice(face - 1e-4), deep), "x", [face, 0, 0]) - ground
    return grip if feet.volume() < 1e-9 else tidy(union([grip, feet]))


def rotated(solid: Manifold, degrees: Iterable[float], at: ArrayLike) -> Manifold:
    """``solid`` rotated about x, y and z by ``degrees`` [3], through the point ``at``."""
    at = np.asarray(at, dtype=np.float64)
    return solid.translate(tuple(-at)).rotate(tuple(degrees)).translate(tuple(at))

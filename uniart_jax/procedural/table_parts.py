"""What tables are built of: legs, tops, shaped aprons, stretchers and shelves, casters, and the
piece that collects them."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable

import numpy as np
from manifold3d import Manifold, Mesh64

from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import finishes, shapes
from uniart_jax.procedural.casters import Caster
from uniart_jax.procedural.fronts import FrontStyle
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    exact,
    hull,
    union,
)

LEGS = (
    "square",
    "tapered",
    "round",
    "turned",
    "spool",
    "cabriole",
    "saber",
    "splayed",
    "post",
    "hairpin",
)


class Turned(Assembly):
    """An assembly whose parts are moved by a rigid motion [4, 4] before they join another one."""

    def __init__(self, onto: Assembly, matrix: np.ndarray) -> None:
        self._onto, self._matrix = onto, matrix

    def add(
        self, name: str, shape: Shape, parent: int = -1, joint: Joint | None = None, label: str = ""
    ) -> int:
        if joint is not None:
            origin = self._matrix[:3, :3] @ joint.origin + self._matrix[:3, 3]
            direction = self._matrix[:3, :3] @ joint.direction
            joint = dataclasses.replace(joint, origin=origin, direction=direction)
        return self._onto.add(name, shape.moved(self._matrix), parent, joint, label)


def about(center: tuple[float, float], degrees: float) -> np.ndarray:
    """The rotation [4, 4] about the vertical through ``center`` (x, y)."""
    c, s = np.round((np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))), 12)
    out, (x, y) = np.eye(4), center
    out[:2, :2] = [[c, -s], [s, c]]
    out[:2, 3] = [x - c * x + s * y, y - s * x - c * y]
    return out


@dataclasses.dataclass
class Piece:
    """A table while it is being built, metres: its front at x = 0, its middle at y = 0.

    Attributes:
      unit: one percent of its longest side. wall: thickness of its boards.
      frame, board, leg: materials of its apron and cases, of its top, of its legs.
      look: of its doors, and of whatever drawers have in common with them.
      solids: what does not move; the first of two that overlap keeps the room.
      moving: adds the moving parts, once the body is part ``root`` of the assembly.
    """

    rng: np.random.Generator
    width: float
    height: float
    depth: float
    unit: float
    wall: float
    frame: Material
    board: Material
    leg: Material
    look: FrontStyle
    solids: list[tuple[Manifold, Material]] = dataclasses.field(default_factory=list)
    moving: list[Callable[[Assembly, int], object]] = dataclasses.field(default_factory=list)

    def add(self, solid: Manifold, material: Material) -> None:
        """Add a solid of the body, its corners on a grid: faces that should be flush are."""
        mesh = solid.to_mesh64()
        corners = np.array(mesh.vert_properties)[:, :3]
        corners = np.ascontiguousarray(exact(corners))
        snapped = Manifold(
            Mesh64(vert_properties=corners, tri_verts=np.array(mesh.tri_verts, np.uint64))
        )
        self.solids.append((snapped, material))

    def share(self, probability: float) -> bool:
        """True with a probability."""
        return bool(self.rng.random() < probability)

    def between(self, low: float, high: float) -> float:
        """A uniform number."""
        return float(self.rng.uniform(low, high))

    def object(self) -> ArticulatedObject:
        """The finished object."""
        groups: dict[Material, list[Manifold]] = {}
        for solid, material in self.solids:
            groups.setdefault(material, []).append(solid)
        body, taken = Shape(), []
        for material, solids in groups.items():
            solid = shapes.tidy(cut(union(solids), taken))
            taken.append(solid)
            if solid.volume() > 1e-9:
                body.add(solid, material)
        asm = Assembly()
        root = asm.add("body", body)
        for add in self.moving:
            add(asm, root)
        return asm.object()


def _chain(rings: list[np.ndarray]) -> Manifold:
    """The body through convex rings [n, 3], one hull from each to the next."""
    return union([hull(np.vstack(pair)) for pair in itertools.pairwise(rings)])


def _ring(center, radius: float, z: float, sides: int) -> np.ndarray:
    """A regular polygon [sides, 3]; with four sides ``radius`` is half a side."""
    start, stretch = (np.pi / 4, np.sqrt(2)) if sides == 4 else (0.0, 1.0)
    angle = start + 2 * np.pi * np.arange(sides) / sides
    flat = np.asarray(center) + radius * stretch * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.column_stack([flat, np.full(sides, z)])


def leg_profile(rng: np.random.Generator, kind: str) -> np.ndarray:
    """[n, 2] of (height, radius) of a turned leg, as shares, from the floor up."""
    if kind == "spool":
        count = int(rng.integers(4, 12))
        t = np.linspace(0, 1, 4 * count + 1)
        return np.column_stack([t, 0.74 + 0.24 * np.cos(2 * np.pi * count * t)])
    nodes = int(rng.integers(4, 9))
    heights = np.sort(rng.uniform(0.05, 0.95, nodes))
    sizes = np.where(np.arange(nodes) % 2 == 0, rng.uniform(0.4, 0.7), rng.uniform(0.75, 1.0))
    sizes = sizes * rng.uniform(0.85, 1.0, nodes)
    knots = np.concatenate([[0.0], heights, [1.0]])
    values = np.concatenate([[rng.uniform(0.4, 0.8)], sizes, [0.95]])
    t = np.sort(np.concatenate([np.linspace(0, 1, 15), heights]))
    return np.column_stack([t, np.interp(t, knots, values)])


def leg(
    kind: str, at, r: float, high: float, block: float, out, amount: float, profile: np.ndarray
) -> Manifold:
    """One leg from the floor to z = ``high``.

    Args:
      at: (x, y) of its upper end. r: half its width there. block: height of its square upper end.
      out: signs of the directions away from the table's middle. amount: in [0, 1], how strongly it
        is tapered, splayed or bent.
    """
    x, y = at
    high, block = float(exact(high)), float(exact(block))
    at, out = np.asarray(at, dtype=np.float64), np.asarray(out, dtype=np.float64)
    knee = max(high - block, 0.3 * high)
    if kind in ("square", "post"):
        return box([x - r, y - r, 0], [x + r, y + r, high])
    if kind == "tapered":
        low = r * (0.75 - 0.35 * amount)
        foot = _ring(at + out * (r - low) * (amount > 0.5), low, 0, 4)
        return _chain([foot, _ring(at, r, knee, 4), _ring(at, r, high, 4)])
    if kind == "round":
        return cylinder("z", [x, y, 0], high, r * (1 - 0.5 * amount), r, segments=14)
    if kind == "splayed":
        foot = at + out * amount * min(0.2 * high, 2.5 * r)
        return _chain([_ring(foot, 0.7 * r, 0, 4), _ring(at, r, high, 4)])
    if kind == "hairpin":
        rod = 0.3 * r
        spots = [at + out * 0.5 * r, at - out * [0.65 * r, 0], at - out * [0, 0.65 * r]]
        foot, first, last = (np.array([*s, z]) for s, z in zip(spots, (0, high, high), strict=True))
        foot[2] = rod
        first[2] = last[2] = high - rod
        return shapes.pipe([first, foot, last], rod, 8)
    t = np.linspace(0, 1, 9)
    if kind == "saber":
        bend = (1 - t) ** 2 * amount * min(0.16 * high, 3.0 * r)
        size = r * (0.6 + 0.4 * t)
        spots = [at + out * b for b in bend]
        rings = [_ring(s, q, z, 4) for s, q, z in zip(spots, size, t * knee, strict=True)]
        return _chain([*rings, _ring(at, r, high, 4)])
    if kind == "cabriole":
        bend = np.interp(t, [0, 0.1, 0.3, 0.75, 1], [0.5, 0.2, -0.25, 0.55, 0.0]) * r * 1.2
        size = np.interp(t, [0, 0.06, 0.2, 0.75, 1], [0.85, 0.75, 0.45, 1.05, 0.95]) * r
        spots = [at + out * b * (0.4 + 0.6 * amount) for b in bend]
        rings = [_ring(s, q, z, 8) for s, q, z in zip(spots, size, t * knee, strict=True)]
        return union([_chain(rings), box([x - r, y - r, knee - 0.2 * r], [x + r, y + r, high])])
    heights, sizes = profile[:, 0] * knee, profile[:, 1] * r
    outline = np.vstack([[0, 0], np.column_stack([sizes, heights]), [0, knee]])
    solid = shapes.revolution(outline, "z", [x, y, 0], 14)
    return union([solid, box([x - r, y - r, knee - 0.001], [x + r, y + r, high])])


def shaped(
    y: tuple[float, float], z: tuple[float, float], x: tuple[float, float], drop: float, manner: str
) -> Manifold:
    """A board across the table (of thickness along x) that hangs ``drop`` below ``z[0]`` at its
    ends, its lower edge 'straight', an 'arch', 'scallops' or 'brackets'."""
    solid = box([x[0], y[0], z[0] - drop], [x[1], y[1], z[1]])
    if drop < 0.004 or manner == "straight":
        return solid
    wide, deep = y[1] - y[0], 0.92 * drop
    thick = x[1] - x[0] + 0.02
    if manner == "brackets":
        reach = min(2.5 * drop, 0.3 * wide)
        ring = np.array(
            [
                [y[0] + 0.3 * reach, -deep],
                [y[0] + reach, 0],
                [y[1] - reach, 0],
                [y[1] - 0.3 * reach, -deep],
            ]
        )
        ring = np.vstack([ring, [[y[1] - 0.3 * reach, -2 * drop], [y[0] + 0.3 * reach, -2 * drop]]])
        hole = shapes.extrusion(ring + [0, z[0] - 0.08 * drop], "x", [x[0] - 0.01, 0, 0], thick)
        return cut(solid, (hole,))
    count = 1 if manner == "arch" else int(np.clip(wide / max(0.12, 2 * drop), 2, 7))
    edges = np.linspace(y[0] + 0.03 * wide, y[1] - 0.03 * wide, count + 1)
    holes = []
    for a, b in itertools.pairwise(edges):
        angle = np.linspace(0, np.pi, 13)
        ring = np.column_stack(
            [(a + b) / 2 + (b - a) / 2 * 0.98 * np.cos(angle), deep * np.sin(angle)]
        )
        ring = np.vstack([ring, [[a + 0.01 * (b - a), -0.02], [b - 0.01 * (b - a), -0.02]]])
        holes.append(shapes.extrusion(ring + [0, z[0] - drop], "x", [x[0] - 0.01, 0, 0], thick))
    return cut(solid, holes)


def lower(
    p: Piece, x: tuple[float, float], y: tuple[float, float], z: float, kind: str, r: float
) -> None:
    """What joins legs near the floor, between the legs' middles: 'shelf', 'slats', 'box', 'h' or
    'sides'."""
    material = p.frame if p.share(0.7) else p.leg
    thick, w = max(p.between(0.014, 0.03), 1.2 * p.unit), max(0.4 * r, 0.5 * p.unit)
    if kind == "shelf":
        over = p.between(-0.5, 1.6) * r if p.share(0.5) else 0.0
        lo, hi = [x[0] - over, y[0] - over, z], [x[1] + over, y[1] + over, z + thick]
        p.add(box(lo, hi), (p.board if p.share(0.5) else material).along("y"))
        return
    bar = 2.2 * w
    if kind in ("box", "slats"):
        for end in x:
            p.add(box([end - w, y[0], z], [end + w, y[1], z + bar]), material)
    for end in y:
        p.add(box([x[0], end - w, z], [x[1], end + w, z + bar]), material)
    if kind == "h":
        middle = (x[0] + x[1]) / 2
        p.add(box([middle - w, y[0], z], [middle + w, y[1], z + bar]), material)
    if kind == "slats":
        count = int(p.rng.integers(3, 9))
        pitch = (x[1] - x[0]) / count
        for k in range(count):
            a = x[0] + (k + 0.5) * pitch - 0.36 * pitch
            lo, hi = [a, y[0], z + bar], [a + 0.72 * pitch, y[1], z + bar + 0.6 * thick]
            p.add(box(lo, hi), material.along("y"))


def column(p: Piece, high: float, thick: float) -> None:
    """A column amid the table on feet or a plate, and a board on it at z = ``high``."""
    x, half, depth = p.depth / 2, p.width / 2, p.depth
    r = p.between(0.05, 0.11) * min(p.width, depth) + p.unit
    outline = leg_profile(p.rng, "turned") if p.share(0.6) else np.array([[0.0, 1.0], [1.0, 1.0]])
    heights, sizes = outline[:, 0] * float(exact(high)), outline[:, 1] * r
    ring = np.vstack([[0, 0], np.column_stack([sizes, heights]), [0, float(exact(high))]])
    p.add(shapes.revolution(ring, "z", [x, 0, 0], 16), p.leg)
    p.add(
        box([0.004, 0.004 - half, high - 0.6 * thick], [depth - 0.004, half - 0.004, high]), p.frame
    )
    spread = p.between(0.32, 0.48) * min(p.width, depth)
    if p.share(0.4):
        p.add(cylinder("z", [x, 0, 0], max(0.015, 1.5 * p.unit), spread, segments=28), p.leg)
        return
    count, w, low = int(p.rng.choice([3, 4])), 0.45 * r, p.between(0.05, 0.25) * high
    for k in range(count):
        turned = about((0.0, 0.0), 360.0 * k / count + (45.0 if count == 4 else 0.0))
        shin = np.array([[0, 0, low], [0, 0, low + 2 * w], [spread, 0, 0], [spread, 0, 1.2 * w]])
        arm = hull(np.vstack([shin + [0, -w, 0], shin + [0, w, 0]]))
        p.add(arm.transform(turned[:3]).translate((x, 0, 0)), p.leg)


def casters(p: Piece, feet: list[tuple[float, float]], height: float) -> None:
    """A wheel under each foot (x, y) from the floor to ``height``."""
    rng = p.rng
    forks, rubber = p.share(0.45), finishes.dark(rng) if p.share(0.6) else finishes.metal(rng)
    metal = finishes.metal(rng) if p.share(0.6) else finishes.dark(rng)
    radius = (0.42 if forks else 0.5) * height
    wide, along = radius * p.between(0.4, 0.9), "y" if p.share(0.6) else "x"
    caster = Caster(height, radius, wide, along, forks, metal, rubber)
    p.moving.append(lambda asm, root: caster.add(asm, root, feet))

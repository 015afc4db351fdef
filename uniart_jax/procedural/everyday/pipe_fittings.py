"""Pipes and what joins them: finishes, couplings, ends, elbows and pressure gauges. Lengths are in
metres."""

from __future__ import annotations

import dataclasses

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.kinematics import Joint
from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.shapes import (
    ball,
    cut,
    cylinder,
    hinge,
    hull,
    pipe,
    union,
)

Pieces = list[tuple[Manifold, Material]]
X, Y, Z = np.eye(3)
WHEELS = ("flat", "dished", "disc", "star", "tee")


@dataclasses.dataclass
class Works:
    """The fixed pieces, and the moving parts: (name, pieces, joint)."""

    body: Pieces = dataclasses.field(default_factory=list)
    moving: list[tuple[str, Pieces, Joint]] = dataclasses.field(default_factory=list)

    def take(self, other: Works, matrix: np.ndarray) -> None:
        """Add all of ``other``, moved by a rigid motion [4, 4]."""
        self.body += [(s.transform(matrix[:3]), m) for s, m in other.body]
        for name, pieces, joint in other.moving:
            placed = [(s.transform(matrix[:3]), m) for s, m in pieces]
            self.moving.append((name, placed, joint.transformed(matrix)))


@dataclasses.dataclass(frozen=True)
class Look:
    """Finishes of a pipe and its valves, how pipes are joined ('flange', 'nut' or 'plain'), and the
    kinds of wheels and levers."""

    pipe: Material
    body: Material
    metal: Material
    grips: tuple[Material, ...]
    joint: str
    wheel: str
    lever: str


def draw_look(rng: np.random.Generator) -> Look:
    """Draw finishes: brass, steel, copper, paint or plastic; wheels and levers often red, blue,
    yellow or green."""
    strong = [(0.75, 0.1, 0.08), (0.1, 0.25, 0.65), (0.9, 0.72, 0.1), (0.1, 0.45, 0.2)]
    tone = plain(np.array(strong[rng.integers(4)]) * rng.uniform(0.75, 1.15))
    other = plain(np.array(strong[rng.integers(4)]) * rng.uniform(0.75, 1.15))
    brass = plain(np.array([0.76, 0.62, 0.32]) * rng.uniform(0.75, 1.15))
    copper = plain(np.array([0.72, 0.43, 0.28]) * rng.uniform(0.8, 1.15))
    steel, paint = materials.metal(rng, brushed=False), materials.paint(rng)
    dark, white = materials.dark(rng), materials.white_plastic(rng)
    pipes = [steel, copper, brass, paint, dark, white, tone]
    bodies = [brass, steel, paint, dark, tone, other, white]
    pipe_finish = pipes[rng.choice(7, p=[0.27, 0.15, 0.1, 0.2, 0.1, 0.1, 0.08])]
    body = bodies[rng.choice(7, p=[0.26, 0.2, 0.16, 0.12, 0.14, 0.06, 0.06])]
    grips = [tone, other, dark, paint, steel, body]
    first = grips[rng.choice(6, p=[0.42, 0.1, 0.16, 0.14, 0.08, 0.1])]
    return Look(
        pipe_finish,
        body,
        materials.hardware(rng),
        (first, other if rng.random() < 0.5 else first),
        str(rng.choice(["flange", "nut", "plain"], p=[0.45, 0.33, 0.22])),
        str(rng.choice(WHEELS, p=[0.38, 0.26, 0.16, 0.12, 0.08])),
        str(rng.choice(["bar", "rod", "wings"], p=[0.6, 0.2, 0.2])),
    )


def placement(x, z, at=(0.0, 0.0, 0.0)) -> np.ndarray:
    """The rigid motion [4, 4] that carries the axes x and z to the two given ones and 0 to ``at``
    (metres)."""
    out = np.eye(4)
    out[:3] = np.column_stack([x, np.cross(z, x), z, at])
    return out


def coupling(look: Look, r: float, y: float, way: int) -> Pieces:
    """What joins two pipes of radius ``r`` (metres) about the plane y: a pair of bolted discs, or a
    nut."""
    if look.joint == "flange":
        wide, thick = 1.8 * r, 0.28 * r
        discs = [cylinder("y", [0, y - thick, 0], 0.96 * thick, wide, segments=22)]
        discs.append(discs[0].translate((0, 1.04 * thick, 0)))
        discs.append(cylinder("y", [0, y - 0.5 * thick, 0], thick, 0.9 * wide, segments=16))
        start = y + thick if way > 0 else y - 1.7 * thick
        bolts = [
            cylinder("y", [0, start, 0], 0.7 * thick, 0.2 * r, segments=6)
            .translate((1.42 * r, 0, 0))
            .rotate((0, 45 + 90 * k, 0))
            for k in range(4)
        ]
        return [(union(discs), look.body), (union(bolts), look.metal)]
    if look.joint == "nut":
        nut = cylinder("y", [0, y - 0.5 * r, 0], r, 1.45 * r, segments=6)
        return [(nut, look.body)]
    return [(cylinder("y", [0, y - 0.3 * r, 0], 0.6 * r, 1.15 * r), look.body)]


def pipe_end(look: Look, r: float, bend: np.ndarray | None, kind: str, long: float) -> Pieces:
    """The rest of a pipe from 0 towards +y: ``long`` metres, or around an elbow towards
    ``bend``."""
    place, pieces = np.eye(4), []
    if bend is not None:
        turns = np.linspace(0, np.pi / 2, 4)
        arc = [1.7 * r * (np.sin(a) * Y + (1 - np.cos(a)) * bend) for a in turns]
        pieces.append((pipe(arc, 1.05 * r, 12), look.body))
        place = np.eye(4)
        side = Z if abs(bend[2]) < 0.5 else X
        place[:3] = np.column_stack([np.cross(bend, side), bend, side, arc[-1]])
    run = cylinder("y", [0, -0.4 * r, 0], long + 0.4 * r, r)
    if kind == "cap":
        rest = [(union([run, ball([0, long, 0], 1.1 * r, 18)]), look.pipe)]
    else:
        bore = cylinder("y", [0, long - 1.2 * r, 0], 3 * r, 0.82 * r)
        rest = [(run - bore, look.pipe)]
        if kind == "flange":
            wider = cylinder("y", [0, long - 2 * r, 0], 4 * r, 0.9 * r)
            rest += [(s - wider, m) for s, m in coupling(look, r, long - 0.35 * r, -1)]
    return pieces + [(s.transform(place[:3]), m) for s, m in rest]


def gauge(rng, look: Look, r: float, size: float) -> Works:
    """A pressure gauge (metres) on a stem along +z that faces -x, its needle at the lower left."""
    stem, deep = r + 0.6 * size, 0.5 * size
    z = stem + size
    case = cylinder("x", [-deep / 2, 0, z], deep, size, segments=28)
    well = cylinder("x", [-deep, 0, z], 0.75 * deep, 0.86 * size, segments=28)
    face = cylinder("x", [-0.29 * deep, 0, z], 0.04 * deep, 0.85 * size, segments=28)
    foot = cylinder("z", [0, 0, 0], z, 0.22 * size)
    rim = look.metal if rng.random() < 0.7 else look.body
    dark = rng.random() < 0.2
    light = plain((0.93, 0.93, 0.9))
    hand = look.grips[0] if rng.random() < 0.5 else plain((0.08, 0.08, 0.08))
    if dark:
        light, hand = plain((0.1, 0.1, 0.1)), plain((0.95, 0.9, 0.85))
    nut = cylinder("z", [0, 0, r], 0.35 * size, 0.38 * size, segments=6)
    solid = cut(union([case, nut, foot]), [well])
    front = -0.29 * deep
    w, long = 0.13 * size, 0.78 * size
    outline = [[-0.25 * size, w], [-0.25 * size, -w], [long, -0.5 * w], [long, 0.5 * w]]
    points = [[front - h, y, b] for h in (0, 0.12 * deep) for b, y in outline]
    pin = cylinder("x", [front - 0.16 * deep, 0, 0], 0.16 * deep, 0.2 * size, segments=14)
    sweep = float(np.deg2rad(rng.uniform(200, 270)))
    needle = union([hull(np.array(points)), pin]).rotate((np.rad2deg(-sweep / 2), 0, 0))
    needle = needle.translate((-0.02 * deep, 0, z))
    joint = hinge((0, 0, z), X, sweep)
    return Works([(solid, rim), (face, light)], [("needle", [(needle, hand)], joint)])

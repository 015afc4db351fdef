"""Valves on pipes: hand wheels that turn or screw, levers with a quarter turn, pressure gauges with
a needle; on straight pipes, elbows, tees and manifolds, and hydrants with screwed caps."""

from __future__ import annotations

import dataclasses

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    ball,
    box,
    cut,
    cylinder,
    extrusion,
    hinge,
    hull,
    pipe,
    revolution,
    rounded,
    screw,
    slide,
    tidy,
    tube,
    turn,
    union,
)

Pieces = list[tuple[Manifold, Material]]
X, Y, Z = np.eye(3)
WHEELS = ("flat", "dished", "disc", "star", "tee")


@dataclasses.dataclass
class Works:
    """What stands still, and the moving parts: name, pieces, joint."""

    body: Pieces = dataclasses.field(default_factory=list)
    moving: list[tuple[str, Pieces, Joint]] = dataclasses.field(default_factory=list)

    def take(self, other: Works, matrix: np.ndarray) -> None:
        """Add another's, moved by a rigid motion [4, 4]."""
        self.body += [(s.transform(matrix[:3]), m) for s, m in other.body]
        for name, pieces, joint in other.moving:
            placed = [(s.transform(matrix[:3]), m) for s, m in pieces]
            self.moving.append((name, placed, joint.transformed(matrix)))


@dataclasses.dataclass(frozen=True)
class Look:
    """Finishes and how pipes are joined: 'flange', 'nut' or 'plain'."""

    pipe: Material
    body: Material
    metal: Material
    grips: tuple[Material, ...]
    joint: str
    wheel: str
    lever: str


def build(rng: np.random.Generator) -> ArticulatedObject:
    """Pipes with valves, metres, shut or open as the lever stands."""
    radius = float(rng.uniform(0.012, 0.07))
    look = _look(rng)
    kind = str(rng.choice(["run", "manifold", "hydrant"], p=[0.73, 0.17, 0.1]))
    make = {"run": _run, "manifold": _manifold, "hydrant": _hydrant}[kind]
    works = make(rng, look, radius)
    works.body.sort(key=lambda piece: piece[1] is look.pipe)  # pipes give way to fittings
    asm = Assembly()
    root = asm.add("pipe", _shape(works.body))
    for name, pieces, joint in works.moving:
        asm.add(name, _shape(pieces), root, joint)
    yaw = np.deg2rad(rng.choice([0.0, rng.uniform(-50, 50)]))
    return asm.object().transformed(_frame(np.cos(yaw) * X + np.sin(yaw) * Y, Z))


def _shape(pieces: Pieces) -> Shape:
    """Pieces by material; what comes later gives way."""
    groups: dict[Material, list[Manifold]] = {}
    for solid, material in pieces:
        groups.setdefault(material, []).append(solid)
    shape, before = Shape(), []
    for material, solids in groups.items():
        solid = cut(union(solids), before)
        if solid.volume() > 1e-10:
            shape.add(tidy(solid), material)
            before.append(solid)
    return shape


def _look(rng: np.random.Generator) -> Look:
    """Brass, steel, cast iron in enamel, or plastic; wheels and levers often red, blue, yellow."""
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


def _frame(x, z, at=(0.0, 0.0, 0.0)) -> np.ndarray:
    """[4, 4] that carries the axes x and z to the two given ones and 0 to ``at``."""
    out = np.eye(4)
    out[:3] = np.column_stack([x, np.cross(z, x), z, at])
    return out


def _flange(rng, look: Look, r: float, y: float, way: int) -> Pieces:
    """What joins two pipes about the plane y: a pair of bolted discs, or a nut."""
    if look.joint == "flange":
        wide, thick = 1.8 * r, 0.28 * r
        discs = [cylinder("y", [0, y - thick, 0], 0.96 * thick, wide, segments=22)]
        discs.append(discs[0].translate((0, 1.04 * thick, 0)))
        discs.append(cylinder("y", [0, y - 0.5 * thick, 0], thick, 0.9 * wide, segments=16))
        bolts = [
            cylinder("y", [0, y + thick if way > 0 else y - 1.7 * thick, 0], 0.7 * thick, 0.2 * r, segments=6)  # noqa: E501
            .translate((1.42 * r, 0, 0))
            .rotate((0, 45 + 90 * k, 0))
            for k in range(4)
        ]  # fmt: skip
        return [(union(discs), look.body), (union(bolts), look.metal)]
    if look.joint == "nut":
        nut = cylinder("y", [0, y - 0.5 * r, 0], r, 1.45 * r, segments=6)
        return [(nut, look.body)]
    return [(cylinder("y", [0, y - 0.3 * r, 0], 0.6 * r, 1.15 * r), look.body)]


def _wheel(rng, look: Look, grip: Material, radius: float, z: float) -> Pieces:
    """A hand wheel about the z axis, its hub's foot at ``z``."""
    wire, hub = radius * float(rng.uniform(0.09, 0.14)), 0.24 * radius
    high = z + wire + (0.28 * radius if look.wheel == "dished" else 0.05 * radius)
    boss = cylinder("z", [0, 0, z], 0.3 * radius, hub, 0.85 * hub)
    nut = cylinder("z", [0, 0, z + 0.3 * radius], 0.1 * radius, 0.45 * hub, segments=6)
    pieces = [boss]
    if look.wheel in ("flat", "dished"):
        angle = np.linspace(0, 2 * np.pi, 6, endpoint=False)
        ring = np.column_stack([radius - wire + wire * np.cos(angle), high + wire * np.sin(angle)])
        pieces.append(revolution(ring, "z", [0, 0, 0], 22))
        count = int(rng.integers(3, 7))
        rod = pipe([[0, 0, z + 0.14 * radius], [radius - wire, 0, high]], 0.75 * wire, 6)
        pieces += [rod.rotate((0, 0, 360 * k / count)) for k in range(count)]
        if rng.random() < 0.2:  # a crank's knob on the rim
            pieces.append(cylinder("z", [radius - wire, 0, high], 0.35 * radius, 1.1 * wire))
    elif look.wheel == "disc":
        plate = cylinder("z", [0, 0, z + 0.06 * radius], 0.16 * radius, radius, segments=32)
        count = int(rng.integers(3, 6))
        hole = cylinder("z", [0.62 * radius, 0, z - radius], 3 * radius, 0.2 * radius, segments=14)
        pieces.append(cut(plate, [hole.rotate((0, 0, 360 * k / count)) for k in range(count)]))
    elif look.wheel == "star":
        count = int(rng.integers(4, 9))
        lump = cylinder("z", [0, 0, z + 0.05 * radius], 0.5 * radius, radius, 0.94 * radius, 32)
        gap = 1.3 * radius / count
        bite = cylinder("z", [radius + 0.3 * gap, 0, z - radius], 3 * radius, gap, segments=14)
        pieces.append(cut(lump, [bite.rotate((0, 0, 360 * k / count)) for k in range(count)]))
        return [(union(pieces), grip)]
    else:
        ends = [[-radius, 0, z + 0.2 * radius], [radius, 0, z + 0.2 * radius]]
        pieces += [pipe(ends, 0.11 * radius), *(ball(p, 0.17 * radius) for p in ends)]
    return [(union(pieces), grip), (nut, look.metal)]


def _lever(rng, look: Look, grip: Material, r: float, long: float, z: float) -> Pieces:
    """A lever from the z axis towards +y, its hub's foot at ``z``."""
    thick, half = 0.2 * r, 0.38 * r
    hub = cylinder("z", [0, 0, z], 0.5 * r, 0.6 * r)
    nut = cylinder("z", [0, 0, z + 0.5 * r], 0.25 * r, 0.36 * r, segments=6)
    if look.lever == "rod":
        end = [0, long, z + 0.25 * r + long * float(rng.uniform(0.0, 0.35))]
        rod = pipe([[0, 0, z + 0.25 * r], end], 0.2 * r, 10)
        return [(ball(end, 0.42 * r, 14), grip), (union([hub, rod]), look.metal)]
    if look.lever == "wings":
        high = float(rng.uniform(0.5, 0.9)) * r
        points = [[x, s * y, z + a] for s in (-1, 1) for y, x, a in (
            (0.3 * r, 0.3 * r, 0.05 * r), (0.3 * r, -0.3 * r, 0.05 * r),
            (1.5 * r, 0.25 * r, high), (1.5 * r, -0.25 * r, high))]  # fmt: skip
        lift = [[0.25 * r * s, 1.5 * r * t, z + high + 0.5 * r] for s in (-1, 1) for t in (-1, 1)]
        low = [[0.3 * r * s, 0.3 * r * t, z + 0.5 * r] for s in (-1, 1) for t in (-1, 1)]
        corners = np.array([*points, *lift, *low])
        wings = [hull(corners[s * corners[:, 1] > 0]) for s in (-1, 1)]
        return [(union([hub, *wings]), grip), (nut, look.metal)]
    rise = float(rng.uniform(0, 0.9)) * r
    line = np.array([[-0.5 * r, z], [0.8 * r, z], [0.8 * r + rise, z + rise], [long, z + rise]])
    bar = extrusion(np.vstack([line, line[::-1] + [0, thick]]), "x", [-half, 0, 0], 2 * half)
    bar = union([bar, cylinder("z", [0, 0, z + 0.01 * r], 1.1 * thick, 0.75 * r)])
    nut = nut.translate((0, 0, 1.08 * thick - 0.5 * r))
    start = 0.8 * r + rise + float(rng.uniform(0.1, 0.3)) * (long - r)
    sleeve = extrusion(
        rounded(2.6 * thick, 2.7 * half, thick),
        "y",
        [0, start, z + rise + thick / 2],
        long * 1.02 - start,
    )
    pieces = [(sleeve, grip), (bar, look.metal), (nut, look.metal)]
    return pieces if rng.random() < 0.7 else [(union([bar, sleeve]), grip), (nut, look.metal)]


def _station(rng, look: Look, r: float, grip: Material, kind: str, room: float):
    """A valve on a pipe along y, its stem along +z: works, half its length, reach along +y and -y.

    ``kind``: 'gate', 'globe' or 'needle' with a wheel, 'ball' or 'wafer' with a lever, 'gear' with
    a wheel beside it; ``room``: the most that wheels and levers may reach.
    """
    works, half = Works(), r * float(rng.uniform(2.0, 3.0))
    clear = 2.0 * r if look.joint == "flange" else 1.6 * r
    if kind in ("gate", "globe", "needle"):
        neck = r * float(rng.uniform(2.2, 3.2))
        if kind == "gate":
            lump = cylinder("z", [0, 0, -1.25 * r], 1.25 * r + 0.8 * neck, 1.15 * r, 0.95 * r)
            lump += hull_of([("y", -half, 1.1 * r), ("y", half, 1.1 * r)])
        elif kind == "globe":
            lump = ball([0, 0, 0], 1.6 * r, 20) + cylinder("z", [0, 0, 0], 0.8 * neck, 0.9 * r)
        else:
            half = 1.5 * r
            lump = box([-1.3 * r, -half, -1.3 * r], [1.3 * r, half, 1.3 * r])
        plate = cylinder(
            "z", [0, 0, 0.75 * neck], 0.4 * r, 1.4 * r, segments=6 if look.joint == "nut" else 24
        )
        bonnet = cylinder("z", [0, 0, 0], neck + 0.5 * r, 0.8 * r, 0.6 * r)
        top = max(neck + 0.5 * r, clear)
        bonnet += cylinder("z", [0, 0, neck], top - neck + 0.3 * r, 0.57 * r)
        top += 0.3 * r
        size = min(r * float(rng.uniform(1.6, 3.4)), room)
        stem, rise = 0.28 * r, r * float(rng.uniform(0.9, 1.7))
        gap = r * float(rng.uniform(0.15, 0.9))
        solid = union([lump, bonnet, plate])
        manner = str(rng.choice(["turn", "screw", "yoke"], p=[0.4, 0.4, 0.2]))
        wheel = _wheel(rng, look, grip, size, top + gap)
        if manner == "yoke" and look.wheel in ("flat", "dished", "disc"):
            solid -= _yoke(rng, works, look, r, top, size, wheel, gap)
        elif manner == "turn":
            post = cylinder("z", [0, 0, top - 0.1 * r], gap + 0.06 * r, stem)
            works.body.append((post, look.metal))
            works.moving.append(("wheel", wheel, turn((0, 0, 0), Z)))
        else:  # the stem winds out of the bonnet
            bore = cylinder("z", [0, 0, top - rise - 0.4 * r], 9 * r, stem + 0.06 * r)
            rod = cylinder("z", [0, 0, top - rise - 0.3 * r], rise + 0.4 * r + gap, stem)
            rings = [
                cylinder("z", [0, 0, top + gap * k / 4], gap / 8, stem + 0.05 * r)
                for k in range(1, 4)
            ]
            solid -= bore
            works.moving.append(
                ("wheel", [*wheel, (union([rod, *rings]), look.metal)],
                 screw((0, 0, 0), Z, float(rng.choice([2, 3, 4, 6])), rise,
                       left_handed=rng.random() < 0.1))
            )  # fmt: skip
        works.body.insert(0, (tidy(solid), look.body))
        return works, half, 1.18 * size, 1.18 * size
    if kind == "ball":
        half = r * float(rng.uniform(1.4, 2.0))
        sides = int(rng.choice([6, 8, 24]))
        lump = cylinder("y", [0, -half, 0], 2 * half, 1.35 * r, segments=sides)
        if rng.random() < 0.5:
            lump += ball([0, 0, 0], 1.53 * r, 18)
        top = max(1.9 * r, clear)
    else:
        half = r * float(rng.uniform(0.5, 0.7))
        lump = cylinder("y", [0, -half, 0], 2 * half, 1.85 * r, segments=28)
        top = r * float(rng.uniform(2.6, 3.3))
    neck = cylinder("z", [0, 0, 0], top, 0.5 * r)
    if kind == "gear":
        case = box([-0.9 * r, -1.1 * r, top - 0.2 * r], [0.9 * r, 1.1 * r, top + 1.4 * r])
        works.body.append((tidy(union([lump, neck, case])), look.body))
        size = min(r * float(rng.uniform(1.3, 2.2)), room)
        wheel = _wheel(rng, look, grip, size, 0.7 * r)
        shaft = cylinder("z", [0, 0, -0.1 * r], 0.76 * r, 0.28 * r)
        place = _frame(Z, -X, [-0.9 * r, 0, top + 0.6 * r])
        works.take(Works([(shaft, look.metal)], [("wheel", wheel, turn((0, 0, 0), Z))]), place)
        return works, half, 1.18 * size, 1.18 * size
    if kind == "wafer":  # a plate under the lever
        plate = cylinder("z", [0, 0, top - 0.2 * r], 0.2 * r, 1.1 * r, segments=20)
        neck += plate
    works.body.append((tidy(union([lump, neck])), look.body))
    long = min(r * float(rng.uniform(3.2, 6.0)), room)
    pieces = _lever(rng, look, grip, r, long, top + 0.04 * r)
    sign = int(rng.choice([-1, 1]))
    joint = hinge((0, 0, 0), Z, sign * np.pi / 2)
    if rng.random() < 0.35:  # shut: across the pipe
        pieces = [(s.rotate((0, 0, 90 * sign)), m) for s, m in pieces]
        joint = hinge((0, 0, 0), Z, -sign * np.pi / 2)
    works.moving.append(("lever", pieces, joint))
    return works, half, (1.8 * r if look.lever == "wings" else long), 1.8 * r


def hull_of(discs) -> Manifold:
    """The convex hull of thin discs: axis, place on it, radius."""
    return union([cylinder(a, at * Y, 1e-3, r) for a, at, r in discs]).hull()


def _yoke(rng, works: Works, look: Look, r: float, top: float, size: float, wheel, gap) -> Manifold:
    """Two columns and a bridge, a wheel on it, and a stem through the wheel that rises; returns
    the stem's bore."""
    high, stem = 1.3 * r + gap, 0.3 * min(r, 0.5 * size)
    for s in (-0.75, 0.75):
        column = box([s * r - 0.2 * r, -0.3 * r, top - r], [s * r + 0.2 * r, 0.3 * r, top + high])
        works.body.append((column, look.body))
    bridge = box([-r, -0.35 * r, top + high - 0.3 * r], [r, 0.35 * r, top + 1.01 * high])
    base = cylinder("z", [0, 0, top - 0.5 * r], 0.3 * r, 1.1 * r)
    bore = cylinder("z", [0, 0, top - 0.1 * r], 9 * size, stem + 0.04 * r)
    works.body += [(bridge - bore, look.body), (base, look.body)]
    lift = 1.01 * high + 0.03 * r - gap
    turned = [(s.translate((0, 0, lift)) - bore, m) for s, m in wheel]
    works.moving.append(("wheel", turned, turn((0, 0, 0), Z)))
    tip = top + high + 0.45 * size + r * float(rng.uniform(0.1, 0.8))
    rod = cylinder("z", [0, 0, top - 0.05 * r], tip - top + 0.05 * r, stem)
    rise = high * float(rng.uniform(0.5, 0.9))
    works.moving.append(("stem", [(rod, look.metal)], slide(Z, rise)))
    return bore


def _gauge(rng, look: Look, r: float, size: float) -> Works:
    """A dial on a stem along +z that faces -x, its needle low on the left."""
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


def _end(rng, look: Look, r: float, bend: np.ndarray | None, kind: str, long: float) -> Pieces:
    """The rest of a pipe towards +y from 0, ``long`` or round an elbow towards ``bend``."""
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
            rest += [(s - wider, m) for s, m in _flange(rng, look, r, long - 0.35 * r, -1)]
    return pieces + [(s.transform(place[:3]), m) for s, m in rest]


def _run(rng, look: Look, r: float) -> Works:
    """One or two valves on a pipe along y, a gauge, a tee; then laid level, or stood up."""
    works, y, behind, start = Works(), 0.0, 0.0, 0.0
    stood = str(rng.choice(["up", "front", "tilted", "upright"], p=[0.45, 0.15, 0.15, 0.25]))
    items = ["valve"] * int(rng.choice([1, 2], p=[0.75, 0.25]))
    items += ["gauge"] * int(rng.random() < 0.33) + ["tee"] * int(rng.random() < 0.3)
    rng.shuffle(items)
    valves = ["gate", "globe", "needle", "ball", "wafer", "gear"]
    for n, item in enumerate(items):
        if item == "valve":
            kind = valves[rng.choice(6, p=[0.27, 0.2, 0.08, 0.27, 0.1, 0.08])]
            grip = look.grips[n % 2]
            part, half, ahead, back = _station(rng, look, r, grip, kind, 6 * r)
            for way in (-1, 1):
                part.body += [
                    (s.translate((0, way * (half + 0.1 * r), 0)), m)
                    for s, m in _flange(rng, look, r, 0.0, way)
                ]
            place = np.eye(4)
        elif item == "gauge":
            size = r * float(rng.uniform(1.5, 2.4))
            part, half, ahead, back = _gauge(rng, look, r, size), size, size, size
            place = np.eye(4)
            if stood in ("front", "upright"):
                place = _frame(-Z, X if stood == "front" or rng.random() < 0.5 else -X)
        else:
            way = [X, -Z][rng.integers(2)] if stood != "upright" else [X, -X][rng.integers(2)]
            end, long = str(rng.choice(["open", "flange"])), r * float(rng.uniform(2.2, 4))
            pieces = _end(rng, look, r, None, end, long)
            level = abs(way[2]) < 0.5
            place = _frame(np.cross(way, Z) if level else X, Z if level else np.cross(X, way))
            part, half, ahead, back = Works(pieces), 1.3 * r, 1.3 * r, 1.3 * r
            part.body.append((cylinder("y", [0, -0.2 * r, 0], 1.8 * r, 1.2 * r), look.body))
        y = y + behind + max(back, half + 0.5 * r) + 0.3 * r if n else 0.0
        behind = max(ahead, half + 0.5 * r)
        start = half if n == 0 else start
        place[1, 3] = y
        works.take(part, place)
    low = start + r * float(rng.uniform(0.8, 3.0))
    high = half + r * float(rng.uniform(0.8, 3.0))
    works.body.append((cylinder("y", [0, -low, 0], y + high + low, r), look.pipe))
    for at, way in ((-low, -1), (y + high, 1)):
        bend = [X, -X, -Z][rng.integers(3)] if rng.random() < 0.3 else None
        long = r * float(rng.uniform(0.8, 2.5))
        kind = str(rng.choice(["open", "flange", "cap"], p=[0.4, 0.5, 0.1]))
        if bend is not None and way < 0:
            bend = bend * ([-1, 1, 1] if abs(bend[2]) < 0.5 else 1)
        place = np.eye(4) if way > 0 else _frame(-X, Z)
        place[1, 3] = at
        works.take(Works(_end(rng, look, r, bend, kind, long)), place)
    tilt = {"up": 0.0, "front": -np.pi / 2, "tilted": -float(rng.uniform(0.4, 1.1))}.get(stood, 0.0)
    frame = _frame(np.cos(tilt) * X - np.sin(tilt) * Z, np.cos(tilt) * Z + np.sin(tilt) * X)
    if stood == "upright":
        frame = _frame(-Y, -X) if rng.random() < 0.65 else _frame(X, Y * rng.choice([-1, 1]))
    out = Works()
    out.take(works, frame)
    return out


def _manifold(rng, look: Look, r: float) -> Works:
    """A pipe along y with two to five branches up or down, each with a valve that faces front."""
    works, count = Works(), int(rng.integers(2, 6))
    b = r * float(rng.uniform(0.6, 0.85))
    kind = str(rng.choice(["ball", "needle", "globe"], p=[0.5, 0.3, 0.2]))
    pitch = b * float(rng.uniform(5.0, 6.5))
    room = 0.41 * pitch if kind != "ball" else 0.72 * pitch
    up = int(rng.choice([-1, 1]))
    seeds = int(rng.integers(2**31))
    for k in range(count):
        part, half, _, _ = _station(
            np.random.default_rng(seeds), look, b, look.grips[k % 2], kind, room
        )
        at = 1.1 * r + half + 0.6 * b
        for way in (-1, 1):
            part.body += [
                (s.translate((0, way * (half + 0.1 * b), 0)), m)
                for s, m in _flange(rng, look, b, 0.0, way)
            ]
        part.body += [
            (s.translate((0, 0.2 * half, 0)), m)
            for s, m in _end(rng, look, b, None, "open", 0.8 * half + 2.5 * b)
        ]
        part.body.append((cylinder("y", [0, -at, 0], at, b), look.pipe))
        works.take(part, _frame(-Y if up > 0 else Y, -X, [0, k * pitch, up * at]))
    ends = [r * float(rng.uniform(2.0, 4.5)) for _ in range(2)]
    run = cylinder("y", [0, 0, 0], (count - 1) * pitch, r)
    works.body.append((run, look.pipe))
    for at, way, long in ((0.0, -1, ends[0]), ((count - 1) * pitch, 1, ends[1])):
        end = str(rng.choice(["open", "flange", "cap"], p=[0.3, 0.4, 0.3]))
        place = np.eye(4) if way > 0 else _frame(-X, Z)
        place[1, 3] = at
        works.take(Works(_end(rng, look, r, None, end, long)), place)
    return works


def _hydrant(rng, look: Look, r: float) -> Works:
    """A column with one to three outlets under caps that screw off, a wheel or a nut on top."""
    works, r = Works(), 1.6 * r
    tall = r * float(rng.uniform(4.5, 8))
    rings = [cylinder("z", [0, 0, z], 0.3 * r, 1.35 * r, segments=28)
             for z in (0.0, 0.12 * tall, 0.92 * tall)]  # fmt: skip
    dome = ball([0, 0, 0.92 * tall + 0.2 * r], 1.05 * r, 24)
    column = cylinder("z", [0, 0, 0], 0.95 * tall, r, 0.92 * r, segments=28)
    foot = cylinder("z", [0, 0, 0], 0.25 * r, 1.7 * r, segments=28)
    top = 0.92 * tall + 1.35 * r
    neck = cylinder("z", [0, 0, 0.92 * tall], top - 0.92 * tall, 0.45 * r)
    solids = [*rings, dome, column, foot, neck]
    if rng.random() < 0.5:
        wheel = _wheel(rng, look, look.grips[0], r * float(rng.uniform(1.1, 2.0)), top + 0.03 * r)
        works.moving.append(("wheel", wheel, turn((0, 0, 0), Z)))
    else:
        sides = int(rng.choice([4, 5, 6]))
        nut = cylinder("z", [0, 0, top + 0.03 * r], 0.6 * r, 0.5 * r, 0.42 * r, sides)
        nut += cylinder("z", [0, 0, top + 0.03 * r], 0.15 * r, 0.65 * r, segments=18)
        works.moving.append(("nut", [(nut, look.grips[0])], turn((0, 0, 0), Z)))
    count = int(rng.integers(1, 4))
    ways = [-X, Y, -Y][:count] if count != 2 else [Y, -Y]
    for n, way in enumerate(ways):
        b = r * float(rng.uniform(0.5, 0.75)) * (1.0 if n else 1.15)
        high = tall * float(rng.uniform(0.5, 0.62))
        reach = r * float(rng.uniform(1.5, 1.9))
        deep = min(b * float(rng.uniform(0.5, 0.9)), reach - 1.1 * r)  # clear of the column
        outlet = tube("z", [0, 0, 0], reach, 0.9 * b, 0.7 * b)
        outlet += cylinder("z", [0, 0, 0], reach - deep - 0.1 * b, 1.15 * b)
        sides = int(rng.choice([6, 8, 24]))
        cap = cylinder("z", [0, 0, reach - deep], deep + 0.25 * b, 1.2 * b, segments=sides)
        cap -= cylinder("z", [0, 0, reach - deep - b], deep + 1.04 * b, 0.94 * b)
        lug = box([-0.3 * b, -0.3 * b, reach + 0.2 * b], [0.3 * b, 0.3 * b, reach + 0.75 * b])
        rise = deep * float(rng.uniform(0.9, 1.6))
        joint = screw((0, 0, 0), Z, float(rng.choice([2, 3, 4])), rise)
        part = Works([(outlet, look.body)], [("cap", [(cap + lug, look.grips[1])], joint)])
        works.take(part, _frame(Z, way, [0, 0, high]))
    works.body.insert(0, (tidy(union(solids)), look.body))
    return works

"""Valves on pipes: hand wheels that turn or screw, levers with a quarter turn, pressure gauges with
a needle; on straight pipes, elbows, tees and manifolds. Hydrants with screwed caps."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural.everyday.pipe_fittings import (
    Look,
    Pieces,
    Works,
    coupling,
    draw_look,
    gauge,
    pipe_end,
    placement,
)
from uniart_jax.procedural.everyday.valve_bodies import hand_wheel, valve_on_pipe
from uniart_jax.procedural.pieces import disjoint, shape_of
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    ball,
    box,
    cylinder,
    screw,
    tidy,
    tube,
    turn,
    union,
)

X, Y, Z = np.eye(3)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """Pipes with valves in metres; each valve is open or closed as its lever shows."""
    radius = float(rng.uniform(0.012, 0.07))
    look = draw_look(rng)
    kind = str(rng.choice(["run", "manifold", "hydrant"], p=[0.73, 0.17, 0.1]))
    make = {"run": _pipe_run, "manifold": _manifold, "hydrant": _hydrant}[kind]
    works = make(rng, look, radius)
    works.body.sort(key=lambda piece: piece[1] is look.pipe)  # pipes give way to fittings
    asm = Assembly()
    root = asm.add("pipe", _shape(works.body))
    for name, pieces, joint in works.moving:
        asm.add(name, _shape(pieces), root, joint)
    yaw = np.deg2rad(rng.choice([0.0, rng.uniform(-50, 50)]))
    return asm.object().transformed(placement(np.cos(yaw) * X + np.sin(yaw) * Y, Z))


def _shape(pieces: Pieces) -> Shape:
    """A shape of pieces that may overlap; the later ones are cut."""
    return shape_of((tidy(solid), material) for solid, material in disjoint(pieces))


def _couplings(look: Look, r: float, half: float) -> Pieces:
    """What joins a valve, which reaches ``half`` to each side, to its pipe."""
    return [
        (solid.translate((0, way * (half + 0.1 * r), 0)), material)
        for way in (-1, 1)
        for solid, material in coupling(look, r, 0.0, way)
    ]


def _pipe_run(rng, look: Look, r: float) -> Works:
    """One or two valves on a pipe along y, a gauge, a tee; then laid level or stood up."""
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
            part, half, ahead, back = valve_on_pipe(rng, look, r, grip, kind, 6 * r)
            part.body += _couplings(look, r, half)
            place = np.eye(4)
        elif item == "gauge":
            size = r * float(rng.uniform(1.5, 2.4))
            part, half, ahead, back = gauge(rng, look, r, size), size, size, size
            place = np.eye(4)
            if stood in ("front", "upright"):
                place = placement(-Z, X if stood == "front" or rng.random() < 0.5 else -X)
        else:
            way = [X, -Z][rng.integers(2)] if stood != "upright" else [X, -X][rng.integers(2)]
            end, long = str(rng.choice(["open", "flange"])), r * float(rng.uniform(2.2, 4))
            pieces = pipe_end(look, r, None, end, long)
            level = abs(way[2]) < 0.5
            place = placement(np.cross(way, Z) if level else X, Z if level else np.cross(X, way))
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
        place = placement(way * X, Z, [0, at, 0])
        works.take(Works(pipe_end(look, r, bend, kind, long)), place)
    tilt = {"up": 0.0, "front": -np.pi / 2, "tilted": -float(rng.uniform(0.4, 1.1))}.get(stood, 0.0)
    frame = placement(np.cos(tilt) * X - np.sin(tilt) * Z, np.cos(tilt) * Z + np.sin(tilt) * X)
    if stood == "upright":
        frame = placement(-Y, -X) if rng.random() < 0.65 else placement(X, Y * rng.choice([-1, 1]))
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
        part, half, _, _ = valve_on_pipe(
            np.random.default_rng(seeds), look, b, look.grips[k % 2], kind, room
        )
        at = 1.1 * r + half + 0.6 * b
        part.body += _couplings(look, b, half)
        part.body += [
            (s.translate((0, 0.2 * half, 0)), m)
            for s, m in pipe_end(look, b, None, "open", 0.8 * half + 2.5 * b)
        ]
        part.body.append((cylinder("y", [0, -at, 0], at, b), look.pipe))
        works.take(part, placement(-Y if up > 0 else Y, -X, [0, k * pitch, up * at]))
    ends = [r * float(rng.uniform(2.0, 4.5)) for _ in range(2)]
    run = cylinder("y", [0, 0, 0], (count - 1) * pitch, r)
    works.body.append((run, look.pipe))
    for at, way, long in ((0.0, -1, ends[0]), ((count - 1) * pitch, 1, ends[1])):
        end = str(rng.choice(["open", "flange", "cap"], p=[0.3, 0.4, 0.3]))
        place = placement(way * X, Z, [0, at, 0])
        works.take(Works(pipe_end(look, r, None, end, long)), place)
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
        wheel = hand_wheel(
            rng, look, look.grips[0], r * float(rng.uniform(1.1, 2.0)), top + 0.03 * r
        )
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
        works.take(part, placement(Z, way, [0, 0, high]))
    works.body.insert(0, (tidy(union(solids)), look.body))
    return works

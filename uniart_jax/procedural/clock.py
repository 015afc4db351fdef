"""Things with a dial: wall, mantel, alarm, pendulum and tower clocks, kitchen scales, gauges,
timers; metronomes and weather houses."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

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
    slide,
    tidy,
    tube,
    turn,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A thing with a dial, metres, at rest."""
    kinds = (_wall, _pendulum, _alarm, _scale, _gauge, _metronome, _timer, _weather_house, _tower)
    make = kinds[rng.choice(9, p=[0.24, 0.2, 0.12, 0.12, 0.07, 0.07, 0.07, 0.05, 0.06])]
    asm = Assembly()
    for name, shape, parent, joint in make(rng):
        asm.add(name, shape, parent, joint)
    return asm.object()


def _tone(rng: np.random.Generator) -> Material:
    """Wood, bright plastic or enamel, metal, dark or white."""
    kind = rng.choice(5, p=[0.3, 0.34, 0.12, 0.12, 0.12])
    if kind == 0:
        return materials.wood(rng)
    if kind == 1:
        return plain(materials.hsv(rng, (0, 1), (0.35, 0.95), (0.35, 0.95)))
    if kind == 2:
        return materials.hardware(rng)
    return materials.dark(rng) if kind == 3 else materials.white_plastic(rng)


def _shape(*pieces: tuple[Manifold, Material]) -> Shape:
    """Solids, one a material, each without those of the materials before it."""
    groups: dict[Material, list[Manifold]] = {}
    for solid, material in pieces:
        groups.setdefault(material, []).append(solid)
    shape, done = Shape(), []
    for material, solids in groups.items():
        solid = tidy(cut(union(solids), done))
        shape.add(solid, material)
        done.append(solid)
    return shape


def _dial(rng, x: float, y: float, z: float, radius: float):
    """A face that stands on the plane x towards -x with its marks: pieces, the plane before them,
    and a tone for hands."""
    light = rng.random() < 0.7
    face = plain(
        materials.hsv(rng, (0, 1), (0, 0.25 if light else 0.7), (0.85, 1) if light else (0.06, 0.4))
    )
    ink = materials.dark(rng) if light else plain(rng.uniform(0.75, 1, 3))
    thick, count = 0.03 * radius, int(rng.choice([0, 4, 12], p=[0.15, 0.25, 0.6]))
    pieces = [(cylinder("x", [x - thick, y, z], thick, radius, segments=32), face)]
    front = x - thick
    long, wide = float(rng.uniform(0.08, 0.2)) * radius, float(rng.uniform(0.03, 0.06)) * radius
    marks = [
        box([-thick / 2, -wide, 0.92 * radius - long], [0, wide, 0.92 * radius])
        .rotate((360 * k / count, 0, 0))
        .translate((front, y, z))
        for k in range(count)
    ]
    if count:
        pieces.append((union(marks), ink))
    tone = ink if rng.random() < 0.7 else plain(materials.hsv(rng, (0, 1), (0.6, 1), (0.3, 0.9)))
    return pieces, front - thick / 2, tone


def _hand(rng, front, y, z, long, wide, thick, degrees, sharp: bool) -> Manifold:
    """One hand about x whose rear lies in the plane ``front``, turned clockwise from noon."""
    tail = float(rng.uniform(0.1, 0.28)) * long
    tip = 0.25 * wide if sharp else wide
    plan = np.array(
        [
            [-wide, 0],
            [-0.7 * wide, -tail],
            [0.7 * wide, -tail],
            [wide, 0],
            [tip, long],
            [-tip, long],
        ]
    )
    solid = extrusion(plan, "x", [-thick, 0, 0], thick)
    solid += cylinder("x", [-thick, 0, 0], thick, 1.5 * wide, segments=16)
    return solid.rotate((degrees, 0, 0)).translate((front, y, z))


def _hands(rng, front, y, z, radius, tone, bold: float = 1.0) -> list[tuple]:
    """Hours, minutes and perhaps seconds, in layers, that turn without end; ``bold``: how
    stout."""
    thick, air = 0.035 * bold * radius, 0.012 * radius
    sharp, parts = bool(rng.random() < 0.5), []
    lengths = [float(rng.uniform(0.5, 0.62)), float(rng.uniform(0.78, 0.92))]
    widths = [bold * float(rng.uniform(0.07, 0.11)), bold * float(rng.uniform(0.055, 0.08))]
    names = ["hour_hand", "minute_hand"]
    if rng.random() < 0.3:
        names, lengths, widths = [*names, "second_hand"], [*lengths, 0.88], [*widths, 0.045 * bold]
    angles = rng.uniform(0, 360) + np.array([0.0, rng.uniform(50, 310), rng.uniform(20, 340)])
    for k, name in enumerate(names):
        low = front - air - k * (thick + air)
        hand = _hand(
            rng, low, y, z, lengths[k] * radius, widths[k] * radius, thick, angles[k], sharp
        )
        finish = tone if k < 2 else plain((0.8, 0.1, 0.1))
        parts.append((name, _shape((hand, finish)), 0, turn((low, y, z), (1, 0, 0))))
    return parts


def _needle(rng, front, y, z, radius, tone, sweep: float) -> tuple:
    """A pointer that turns clockwise from the lower end of its scale."""
    thick, start = 0.05 * radius, -np.rad2deg(sweep) / 2
    hand = _hand(
        rng,
        front - 0.015 * radius,
        y,
        z,
        float(rng.uniform(0.7, 0.9)) * radius,
        float(rng.uniform(0.05, 0.09)) * radius,
        thick,
        start,
        True,
    )
    return "needle", _shape((hand, tone)), 0, hinge((front, y, z), (1, 0, 0), sweep)


def _plate(rng, kind: str, wide: float, tall: float) -> np.ndarray:
    """An outline (y, z) about 0 that holds a dial: round, square, many-cornered, arched, a
    house."""
    if kind == "round":
        count = int(rng.choice([6, 8, 12, 40], p=[0.1, 0.2, 0.1, 0.6]))
        angle = (np.arange(count) + 0.5) * 2 * np.pi / count
        reach = 1 / np.cos(np.pi / count)
        return np.column_stack([wide / 2 * np.cos(angle), tall / 2 * np.sin(angle)]) * reach
    if kind == "arch":
        angle = np.linspace(0, np.pi, 17)
        arc = np.column_stack([np.cos(angle), np.sin(angle)]) * wide / 2
        return np.vstack(
            [arc + [0, tall / 2 - wide / 2], [[-wide / 2, -tall / 2], [wide / 2, -tall / 2]]]
        )
    if kind == "gable":
        peak = tall / 2 + float(rng.uniform(0.15, 0.4)) * wide
        return np.array(
            [
                [wide / 2, -tall / 2],
                [wide / 2, tall / 2],
                [0, peak],
                [-wide / 2, tall / 2],
                [-wide / 2, -tall / 2],
            ]
        )
    return rounded(wide, tall, float(rng.uniform(0.01, 0.25)) * wide)


def _wall(rng: np.random.Generator) -> list[tuple]:
    """A clock to hang or stand: a case, a rim or a hinged ring about the dial, knobs below it."""
    radius = float(rng.uniform(0.07, 0.2))
    kind = str(rng.choice(["round", "square", "arch", "gable"], p=[0.45, 0.25, 0.2, 0.1]))
    rim, depth = float(rng.uniform(0.1, 0.35)) * radius, float(rng.uniform(0.25, 0.8)) * radius
    wide = 2 * (radius + rim)
    tall = wide if kind == "round" else wide * float(rng.uniform(1.0, 1.5))
    rise = 0.0 if kind == "round" else (tall - wide) / 2  # of the dial above the middle
    tone, metal = _tone(rng), materials.hardware(rng)
    case = extrusion(_plate(rng, kind, wide, tall), "x", [0, 0, 0], depth)
    pieces, front, ink = _dial(rng, 0, 0, rise, radius)
    pieces.append((case, tone))
    if kind != "round" and rng.random() < 0.6:  # a foot
        out, thick = float(rng.uniform(0.02, 0.15)) * wide, float(rng.uniform(0.04, 0.1)) * wide
        pieces.append(
            (
                box(
                    [-out, -wide / 2 - out, -tall / 2 - thick],
                    [depth + out / 2, wide / 2 + out, -tall / 2],
                ),
                _tone(rng),
            )
        )
    if kind == "round" and rng.random() < 0.25:  # rays about it
        count = int(rng.choice([8, 12, 16]))
        ray = box(
            [0.3 * depth, -0.06 * radius, radius],
            [0.5 * depth, 0.06 * radius, radius * float(rng.uniform(1.5, 1.9))],
        )
        pieces.append(
            (union([ray.rotate((360 * k / count, 0, 0)) for k in range(count)]), _tone(rng))
        )
    parts = [("case", Shape(), -1, None), *_hands(rng, front, 0, rise, radius, ink)]
    reach = front - 0.17 * radius
    outer, ring = radius + 0.8 * rim, rng.choice(["door", "rim", "none"], p=[0.5, 0.3, 0.2])
    if ring == "rim":
        pieces.append((tube("x", [reach, 0, rise], -reach, outer, radius, 32), metal))
    if ring == "door":
        air, way = 0.02 * radius, int(rng.choice([-1, 1]))
        band = tube("x", [reach, 0, rise], -reach - air, outer, 1.01 * radius, 32)
        if kind == "square" and rng.random() < 0.6:
            band = box([reach, -outer, rise - outer], [-air, outer, rise + outer])
            band -= cylinder("x", [-1, 0, rise], 2, 1.01 * radius, segments=32)
        tab = box(
            [reach, -way * outer - 0.04 * radius, rise - 0.12 * radius],
            [-air, -way * outer + 0.04 * radius, rise + 0.12 * radius],
        )
        swing = float(np.deg2rad(rng.uniform(90, 160)))
        joint = hinge((reach, way * outer, rise), (0, 0, -way), swing)
        parts.append(("door", _shape((band + tab, metal)), 0, joint))
    below = tall / 2 + rise - radius - rim
    if below > 0.16 * radius and kind != "round":  # winding knobs
        size = min(0.45 * below, 0.16 * radius)
        for y in (-0.5 * radius, 0.5 * radius) if rng.random() < 0.5 else (0.0,):
            z = rise - outer - 0.06 * radius - size
            knob = cylinder(
                "x", [-1.2 * size, y, z], 1.2 * size - 0.002 * radius, 0.85 * size, size, 9
            )
            knob += box(
                [-1.7 * size, y - 0.2 * size, z - 0.8 * size],
                [-size, y + 0.2 * size, z + 0.8 * size],
            )
            parts.append(("knob", _shape((knob, metal)), 0, turn((0, y, z), (1, 0, 0))))
    parts[0] = ("case", _shape(*pieces), -1, None)
    return parts


def _bob(rng, x, z, long, size, thick, tone, rod, most=0.3) -> tuple[Shape, float]:
    """A pendulum that hangs from (x, 0, z), drawn aside by the angle returned."""
    out = min(float(np.deg2rad(rng.uniform(7, 12))), float(most))
    bar = box(
        [x - 0.2 * thick, -0.12 * size, z - long], [x + 0.2 * thick, 0.12 * size, z + 0.2 * size]
    )
    disc = cylinder("x", [x - thick / 2, 0, z - long], thick, size, segments=24)
    if rng.random() < 0.3:
        disc = disc.translate((0, 0, long - z)).scale((1, 0.75, 1.3)).translate((0, 0, z - long))
    turned = [
        (s.translate((0, 0, -z)).rotate((np.rad2deg(-out), 0, 0)).translate((0, 0, z)), m)
        for s, m in ((disc, tone), (bar, rod))
    ]
    return _shape(*turned), out


def _pendulum(rng: np.random.Generator) -> list[tuple]:
    """A case with a window below the dial, a pendulum and weights in it, a door before them;
    or a cuckoo's house with the pendulum below it."""
    house, tall = rng.random() < 0.3, rng.random() < 0.5
    wide = float(rng.uniform(0.16, 0.4))
    radius = wide * float(rng.uniform(0.3, 0.4) if not house else rng.uniform(0.24, 0.3))
    depth, wall = wide * float(rng.uniform(0.4, 0.6)), 0.06 * wide
    head = wide * float(rng.uniform(1.0, 1.2))
    trunk = 0.0 if house else wide * float(rng.uniform(1.9, 3.2) if tall else rng.uniform(0.7, 1.4))
    foot = wide * float(rng.uniform(0.4, 0.8)) if tall and not house else 0.0
    tone, gold, metal = (
        _tone(rng),
        plain(materials.hsv(rng, (0.1, 0.14), (0.4, 0.7), (0.6, 0.9))),
        materials.hardware(rng),
    )
    low, high = foot + trunk, foot + trunk + head
    kind = "gable" if house else str(rng.choice(["gable", "square", "arch"]))
    body = extrusion(_plate(rng, kind, wide, head), "x", [0, 0, low + head / 2], depth)
    dial_z = low + head * 0.5
    pieces, front, ink = _dial(rng, 0, 0, dial_z, radius)
    parts = [
        ("case", Shape(), -1, None),
        *_hands(rng, front, 0, dial_z, radius, ink, 1.8 if trunk else 1.3),
    ]
    x = depth / 2
    slim = 1.0
    if trunk:
        slim = float(rng.uniform(0.72, 1.0))
        half = slim * wide / 2
        body += box([0, -half, foot], [depth, half, low + 0.01])
        room = box([-1, -half + wall, foot + wall], [depth - wall, half - wall, low - wall])
        body -= room
        if foot:
            body += box([0, -0.55 * wide, 0], [depth * 1.05, 0.55 * wide, foot])
        long, size = trunk * float(rng.uniform(0.55, 0.75)), half * float(rng.uniform(0.26, 0.36))
        long = min(long, trunk - 2 * wall - 1.9 * size)
        top = low - wall - 0.3 * size
        rod = cylinder("x", [x, 0, top], depth - wall / 2 - x, 0.12 * size, segments=10)
        reach = np.arcsin(min(0.9, (half - wall - size * 1.3) / long))
        shape, out = _bob(
            rng, x - 0.12 * depth, top, long, size, 0.1 * depth, gold, metal, 0.85 * reach
        )
    else:
        half = wide / 2
        long, size = wide * float(rng.uniform(0.8, 1.3)), wide * float(rng.uniform(0.1, 0.15))
        top = low - 0.02 * wide
        rod = box(
            [x - 0.1 * wide, -0.03 * wide, low - 0.06 * wide], [x + 0.1 * wide, 0.03 * wide, low]
        )
        rod = rod ^ box([x - 0.02 * wide, -1, 0], [x + 0.1 * wide, 1, 9])
        shape, out = _bob(
            rng, x - 0.08 * wide, low - 0.06 * wide, long, size, 0.08 * wide, _tone(rng), metal
        )
        top = low - 0.06 * wide
        eave = extrusion(
            np.array(
                [
                    [-0.62 * wide, high - 0.12 * wide],
                    [0, high + 0.42 * wide],
                    [0.62 * wide, high - 0.12 * wide],
                    [0.62 * wide, high - 0.02 * wide],
                    [0, high + 0.52 * wide],
                    [-0.62 * wide, high - 0.02 * wide],
                ]
            ),
            "x",
            [-0.1 * wide, 0, 0],
            depth + 0.1 * wide,
        )
        pieces.append((eave, _tone(rng)))
    pieces.append((body, tone))
    pieces.append((rod, metal))
    parts.append(("pendulum", shape, 0, hinge((x, 0, top), (1, 0, 0), 2 * out)))
    if trunk and rng.random() < 0.75:
        way, air, thick = int(rng.choice([-1, 1])), 0.004 * wide, 0.05 * wide
        a, b, edge = foot + 0.02 * wide, low - 0.02 * wide, half - 0.01 * wide
        b = min(b, dial_z - radius - 0.05 * wide)
        door = box([-thick, -edge, a], [-air, edge, b])
        door -= box(
            [-1, -edge + 1.3 * wall, a + 1.3 * wall], [1, edge - 1.3 * wall, b - 1.3 * wall]
        )
        knob = ball([-thick, -way * (edge - 0.65 * wall), (a + b) / 2], 0.03 * wide, 10)
        joint = hinge(
            (-thick, way * edge, 0), (0, 0, -way), float(np.deg2rad(rng.uniform(85, 140)))
        )
        parts.append(("door", _shape((door, tone), (knob, gold)), 0, joint))
    if house and rng.random() < 0.7:  # weights on chains, that sink
        r, chain = 0.07 * wide, wide * float(rng.uniform(0.3, 0.8))
        travel = wide * float(rng.uniform(0.4, 0.9))
        for y in (-0.33 * wide, 0.33 * wide):
            z = low - chain * float(rng.uniform(0.5, 1))
            weight = cylinder("z", [x, y, z - 4 * r], 4 * r, 0.6 * r, r, 12)
            line = cylinder("z", [x, y, z - r], low - z + r - 0.004 * wide, 0.2 * r, segments=8)
            joint = slide((0, 0, -1), travel)
            parts.append(("weight", _shape((weight, gold), (line, metal)), 0, joint))
    parts[0] = ("case", _shape(*pieces), -1, None)
    return parts


def _alarm(rng: np.random.Generator) -> list[tuple]:
    """An alarm clock: a drum on feet with bells and a hammer, or a block with a button on top."""
    radius, tone, metal = float(rng.uniform(0.035, 0.07)), _tone(rng), materials.hardware(rng)
    depth, legs = radius * float(rng.uniform(0.7, 1.2)), radius * float(rng.uniform(0.2, 0.4))
    outer, bells = radius * float(rng.uniform(1.08, 1.3)), rng.random() < 0.6
    z = legs + outer
    pieces, front, ink = _dial(rng, 0, 0, z, radius)
    parts = [("case", Shape(), -1, None), *_hands(rng, front, 0, z, radius, ink)]
    if bells:
        case = cylinder("x", [0, 0, z], depth, outer, segments=36)
        spread = 0.62 * outer
        for y in (-spread, spread):
            pieces.append(
                (
                    pipe(
                        [[depth / 2, y, legs + 0.5 * outer], [depth / 2, 1.25 * y, 0.09 * outer]],
                        0.09 * outer,
                        8,
                    ),
                    metal,
                )
            )
        size = 0.42 * outer
        for s in (-1, 1):
            angle = np.linspace(0, np.pi / 2, 6)
            dome = np.column_stack([size * np.cos(angle), 0.8 * size * np.sin(angle)])
            bell = revolution(np.vstack([[[0, 0]], dome]), "z", [0, 0, 0], 20)
            stem = cylinder("z", [0, 0, -0.5 * size], 0.6 * size, 0.14 * size, segments=10)
            for solid in (bell, stem):
                pieces.append(
                    (
                        solid.translate((0, 0, 1.08 * outer))
                        .rotate((-35 * s, 0, 0))
                        .translate((depth / 2, 0, z)),
                        metal,
                    )
                )
        t = 0.07 * outer
        x, base, top = depth / 2, z + outer, z + outer * float(rng.uniform(1.5, 1.7))
        hammer = box([x - t, -t, base + 0.01 * outer], [x + t, t, top])
        hammer += cylinder("y", [x, -2.2 * t, top], 4.4 * t, 1.7 * t, segments=14)
        tilt = 8.0
        hammer = (
            hammer.translate((0, 0, -base))
            .rotate((tilt, 0, 0))
            .translate((0, 0, base + 0.01 * outer))
        )
        joint = hinge((x, 0, base), (-1, 0, 0), np.deg2rad(2 * tilt))
        parts.append(("hammer", _shape((hammer, ink)), 0, joint))
    else:
        wide, top = 2 * outer * float(rng.uniform(1, 1.5)), z + outer
        case = extrusion(
            rounded(wide, 2 * outer, float(rng.uniform(0.05, 0.5)) * outer), "x", [0, 0, z], depth
        )
        for y in (-0.3 * wide, 0.3 * wide):
            pieces.append(
                (
                    box(
                        [0.1 * depth, y - 0.1 * outer, 0],
                        [0.9 * depth, y + 0.1 * outer, legs + 0.05 * outer],
                    ),
                    metal,
                )
            )
        half, high = wide * float(rng.uniform(0.12, 0.28)), outer * float(rng.uniform(0.12, 0.22))
        button = box([0.25 * depth, -half, top + 0.01 * outer], [0.75 * depth, half, top + high])
        stem = box(
            [0.35 * depth, -0.7 * half, top - high], [0.65 * depth, 0.7 * half, top + 0.02 * outer]
        )
        case -= box(
            [0.33 * depth, -0.74 * half, top - 2.2 * high], [0.67 * depth, 0.74 * half, top + 1]
        )
        joint = slide((0, 0, -1), 0.8 * high)
        button = (button + stem).translate((0, 0, 0.85 * high))
        parts.append(("button", _shape((button, _tone(rng))), 0, joint))
    if rng.random() < 0.6:  # a winding knob at the side
        r, y = 0.2 * outer, outer if bells else wide / 2
        s = float(rng.choice([-1, 1]))
        start = y + 0.01 * outer if s > 0 else -y - 0.31 * outer
        knob = cylinder("y", [depth / 2, start, z], 0.3 * outer, r, segments=10)
        parts.append(("knob", _shape((knob, metal)), 0, turn((depth / 2, 0, z), (0, 1, 0))))
    parts[0] = ("case", _shape(*pieces, (case, tone)), -1, None)
    return parts


def _scale(rng: np.random.Generator) -> list[tuple]:
    """Kitchen and shop scales: a needle on a dial, a plate or bowl that sinks, a knob."""
    radius = float(rng.uniform(0.06, 0.12))
    wide, depth = 2.6 * radius * float(rng.uniform(1, 1.3)), radius * float(rng.uniform(1.1, 2))
    high, tone, metal = 2.7 * radius, _tone(rng), materials.metal(rng, brushed=False)
    narrow = float(rng.uniform(0.6, 1.0))
    ends = [[-wide / 2, 0], [wide / 2, 0], [narrow * wide / 2, high], [-narrow * wide / 2, high]]
    if narrow * wide < 2.3 * radius:
        ends[2][0], ends[3][0] = 1.15 * radius, -1.15 * radius
    body = extrusion(np.array(ends), "x", [0, 0, 0], depth)
    z = 1.3 * radius
    pieces, front, ink = _dial(rng, 0, 0, z, radius)
    if rng.random() < 0.6:
        pieces.append(
            (
                tube(
                    "x",
                    [front - 0.1 * radius, 0, z],
                    0.1 * radius - front,
                    1.1 * radius,
                    1.005 * radius,
                    32,
                ),
                metal,
            )
        )
    sweep = float(rng.uniform(4.2, 5.6))
    parts = [("body", Shape(), -1, None), _needle(rng, front, 0, z, radius, ink, sweep)]
    lift, r = radius * float(rng.uniform(0.25, 0.45)), radius * float(rng.uniform(0.2, 0.4))
    body -= cylinder("z", [depth / 2, 0, high - 1.6 * lift], 1, r + 0.02 * radius, segments=20)
    stem = cylinder("z", [depth / 2, 0, high - 0.5 * lift], 1.55 * lift, r, segments=18)
    low, t, size = high + lift, 0.09 * radius, radius * float(rng.uniform(1.1, 1.7))
    if rng.random() < 0.5:
        tall = size * float(rng.uniform(0.25, 0.6))
        profile = np.array(
            [[0, 0], [0.6 * size, 0], [size, tall], [size - t, tall], [0.6 * size - t, t], [0, t]]
        )
        pan = revolution(profile, "z", [depth / 2, 0, low], 30)
    else:
        plan = rounded(1.5 * size, 2 * size, float(rng.uniform(0.02, 0.6)) * size)
        pan = extrusion(plan, "z", [depth / 2, 0, low], 1.5 * t)
    finish = metal if rng.random() < 0.5 else _tone(rng)
    joint = slide((0, 0, -1), 0.8 * lift)
    parts.append(("pan", _shape((pan, finish), (stem, metal)), 0, joint))
    parts[0] = ("body", _shape(*pieces, (body, tone)), -1, None)
    return parts


def _gauge(rng: np.random.Generator) -> list[tuple]:
    """A pressure gauge or thermometer: a round box on a stem, a needle over its scale."""
    radius, metal = float(rng.uniform(0.03, 0.08)), materials.hardware(rng)
    depth, outer = radius * float(rng.uniform(0.4, 0.9)), 1.12 * radius
    pieces, front, ink = _dial(rng, 0, 0, 0, radius)
    edge = -front + 0.1 * radius
    rim = tube("x", [-edge, 0, 0], edge, outer, 1.005 * radius, 36)
    case = cylinder("x", [0, 0, 0], depth, outer, segments=36)
    way = str(rng.choice(["z", "x", "stand"]))
    if way == "z":
        low = -outer - radius * float(rng.uniform(0.4, 1.2))
        stem = cylinder(
            "z", [depth / 2, 0, low], -low - 0.5 * outer, 0.24 * min(depth, radius), segments=14
        )
        nut = cylinder(
            "z",
            [depth / 2, 0, -outer - 0.35 * radius],
            0.3 * radius,
            0.42 * min(depth, radius),
            segments=6,
        )
        base = stem + nut
    elif way == "x":
        base = cylinder("x", [0.9 * depth, 0, 0], radius, 0.25 * radius, segments=16)
        base += cylinder("x", [depth, 0, 0], 0.4 * radius, 0.45 * radius, segments=6)
    else:
        base = box([-0.2 * depth, -radius, -1.4 * outer], [1.2 * depth, radius, -1.2 * outer])
        base += box(
            [0.2 * depth, -0.3 * radius, -1.3 * outer], [0.8 * depth, 0.3 * radius, -0.8 * outer]
        )
    tone = _tone(rng)
    needle = _needle(rng, front, 0, 0, radius, ink, float(rng.uniform(3.8, 5.2)))
    body = _shape(
        *pieces, (rim, metal if rng.random() < 0.5 else tone), (case, tone), (base, metal)
    )
    return [("case", body, -1, None), needle]


def _metronome(rng: np.random.Generator) -> list[tuple]:
    """A metronome: a rod that swings before a tapered case, a weight that slides on it, a key."""
    high = float(rng.uniform(0.14, 0.25))
    wide, tone, metal = high * float(rng.uniform(0.5, 0.65)), _tone(rng), materials.metal(rng)
    top, depth = wide * float(rng.uniform(0.25, 0.5)), wide * float(rng.uniform(0.6, 0.9))
    low = hull(
        np.array(
            [
                [x, y, z]
                for z, w, d in ((0, wide, 0.0), (high, top, 0.3 * depth))
                for x in (d, depth - 0.5 * d)
                for y in (-w / 2, w / 2)
            ]
        )
    )
    step = 0.16 * high
    base = box([-0.12 * wide, -0.54 * wide, 0], [1.05 * depth, 0.54 * wide, step])
    x, z = -0.045 * wide, step + 0.09 * high
    board = cylinder("x", [x + 0.02 * wide, 0, z], 0.1 * wide, 0.04 * wide, segments=12)
    out = float(rng.uniform(14, 28))
    long = 0.78 * high
    rod = box(
        [x - 0.02 * wide, -0.025 * wide, z - 0.03 * high],
        [x + 0.015 * wide, 0.025 * wide, z + long],
    )
    at, size = z + long * float(rng.uniform(0.62, 0.85)), 0.1 * wide
    plan = np.array(
        [[-0.8 * size, -size], [0.8 * size, -size], [1.3 * size, size], [-1.3 * size, size]]
    )
    weight = extrusion(plan, "x", [x - 0.1 * wide, 0, at], 0.078 * wide)

    def swung(solid: Manifold) -> Manifold:
        return solid.translate((0, 0, -z)).rotate((-out, 0, 0)).translate((0, 0, z))

    way = np.array([0, -np.sin(np.deg2rad(-out)), np.cos(np.deg2rad(-out))])
    parts = [
        (
            "case",
            _shape((base, tone), (low, _tone(rng) if rng.random() < 0.4 else tone), (board, metal)),
            -1,
            None,
        )
    ]
    parts.append(
        ("rod", _shape((swung(rod), metal)), 0, hinge((x, 0, z), (1, 0, 0), np.deg2rad(2 * out)))
    )
    travel = (at - z - 1.5 * size) * float(rng.uniform(0.6, 0.9))
    parts.append(
        ("weight", _shape((swung(weight), materials.hardware(rng))), 1, slide(-way, travel))
    )
    s = float(rng.choice([-1, 1]))
    q, r = 0.5 * step, 0.09 * high
    start = 0.55 * wide if s > 0 else -0.55 * wide - 0.16 * wide
    key = cylinder("y", [depth / 2, start, q], 0.16 * wide, 0.3 * r, segments=10)
    wing = 0.64 * wide if s > 0 else -0.71 * wide - 0.09 * wide
    key += box(
        [depth / 2 - r, wing, q - 0.45 * r], [depth / 2 + r, wing + 0.16 * wide, q + 0.45 * r]
    )
    parts.append(("key", _shape((key, metal)), 0, turn((depth / 2, 0, q), (0, 1, 0))))
    return parts


def _timer(rng: np.random.Generator) -> list[tuple]:
    """Kitchen timers: an egg, tomato or drum whose upper half turns, or a box with a large dial."""
    size, tone, mark = float(rng.uniform(0.025, 0.05)), _tone(rng), materials.dark(rng)
    other = tone if rng.random() < 0.5 else _tone(rng)
    sweep = float(rng.uniform(4.6, 6.0))
    if rng.random() < 0.55:
        angle = np.linspace(-np.pi / 2, np.pi / 2, 17)
        power, tall = float(rng.uniform(0.4, 1.0)), size * float(rng.uniform(0.75, 1.4))
        z = tall * np.sin(angle)
        r = (
            size
            * np.cos(angle).clip(0, 1) ** power
            * (1 - float(rng.uniform(-0.05, 0.2)) * z / tall)
        )
        body = revolution(np.column_stack([r, z]), "z", [0, 0, 0], 28)
        foot, seam = -0.8 * tall, float(rng.uniform(-0.15, 0.3)) * tall
        low = body ^ box([-1, -1, foot], [1, 1, seam])
        high = body ^ box([-1, -1, seam + 0.02 * size], [1, 1, 1])
        high += cylinder(
            "z", [0, 0, 0.9 * tall], 0.35 * size, float(rng.uniform(0.08, 0.2)) * size, segments=12
        )
        dot = cylinder("x", [-2 * size, 0, seam + 0.2 * tall], 1.6 * size, 0.12 * size, segments=10)
        dot = dot ^ (body.scale((1.02, 1.02, 1)) - body)
        lower = box([-2 * size, -0.06 * size, seam - 0.3 * tall], [0, 0.06 * size, seam])
        lower = lower ^ (body.scale((1.02, 1.02, 1)) - body)
        parts = [("body", _shape((low, tone), (lower, mark)), -1, None)]
        joint = hinge((0, 0, seam), (0, 0, 1), sweep)
        parts.append(("dial", _shape((high, other), (dot, mark)), 0, joint))
        return parts
    wide, high, depth = (
        2.6 * size,
        2.6 * size * float(rng.uniform(1, 1.4)),
        size * float(rng.uniform(0.6, 1.4)),
    )
    z, reach = high - 1.3 * size, size * float(rng.uniform(0.25, 0.5))
    case = extrusion(
        rounded(wide, high, float(rng.uniform(0.05, 0.6)) * size), "x", [0, 0, high / 2], depth
    )
    pieces, front, _ = _dial(rng, 0, 0, z, 1.2 * size)
    knob = cylinder("x", [front - reach, 0, z], reach - 0.01 * size, 0.7 * size, 0.8 * size, 28)
    grip = box(
        [front - 2 * reach, -0.14 * size, z - 0.68 * size],
        [front - reach, 0.14 * size, z + 0.68 * size],
    )
    point = box(
        [front - 2 * reach - 0.05 * size, -0.06 * size, z + 0.3 * size],
        [front - 2 * reach, 0.06 * size, z + 0.66 * size],
    )
    dial = _shape((knob + grip, other), (point, plain((0.9, 0.2, 0.15))))
    parts = [("case", _shape(*pieces, (case, tone)), -1, None)]
    parts.append(("dial", dial, 0, hinge((0, 0, z), (1, 0, 0), sweep)))
    return parts


def _weather_house(rng: np.random.Generator) -> list[tuple]:
    """A little house with two doorways and two figures on a board that turns between them."""
    wide = float(rng.uniform(0.12, 0.25))
    high, depth, wall = 0.8 * wide, wide * float(rng.uniform(0.5, 0.7)), 0.05 * wide
    tone, roof, board = _tone(rng), _tone(rng), 0.06 * wide
    shape = np.array(
        [[-wide / 2, 0], [wide / 2, 0], [wide / 2, high], [0, 1.45 * high], [-wide / 2, high]]
    )
    body = extrusion(shape, "x", [0, 0, board], depth)
    ways = []
    for y in (-0.24 * wide, 0.24 * wide):
        ways.append(
            box([-1, y - 0.18 * wide, board], [depth - wall, y + 0.18 * wide, board + 0.72 * high])
        )
    ways.append(
        box([wall * 2, -0.3 * wide, board], [depth - wall, 0.3 * wide, board + 0.72 * high])
    )
    middle = box([-1, -0.07 * wide, board], [2 * wall, 0.07 * wide, 1])
    body = cut(body, [w - middle for w in ways])
    floor = box([-0.45 * wide, -0.6 * wide, 0], [depth + 0.05 * wide, 0.6 * wide, board])
    slope = np.array(
        [
            [-0.66 * wide, 0.86 * high],
            [0, 1.5 * high],
            [0.66 * wide, 0.86 * high],
            [0.66 * wide, 0.98 * high],
            [0, 1.64 * high],
            [-0.66 * wide, 0.98 * high],
        ]
    )
    eave = extrusion(slope, "x", [-0.15 * wide, 0, board], depth + 0.2 * wide)
    pieces = [(floor, _tone(rng)), (eave, roof), (body, tone)]
    x, out = 0.18 * wide, 25.0
    low = board + 0.02 * wide
    arm = box(
        [x - 0.04 * wide, -0.24 * wide, low], [x + 0.04 * wide, 0.24 * wide, low + 0.03 * wide]
    )
    turned = [(arm, materials.wood(rng, textured=False))]
    for y in (-0.24 * wide, 0.24 * wide):
        size = 0.1 * wide
        figure = cylinder("z", [x, y, low + 0.02 * wide], 3.2 * size, size, 0.5 * size, 14)
        head = ball([x, y, low + 0.02 * wide + 3.5 * size], 0.6 * size, 12)
        turned += [(figure, _tone(rng)), (head, plain((0.9, 0.72, 0.58)))]
    placed = [
        (s.translate((-x, 0, 0)).rotate((0, 0, -out)).translate((x, 0, 0)), m) for s, m in turned
    ]
    joint = hinge((x, 0, low), (0, 0, 1), np.deg2rad(2 * out))
    return [("house", _shape(*pieces), -1, None), ("figures", _shape(*placed), 0, joint)]


def _tower(rng: np.random.Generator) -> list[tuple]:
    """A clock tower: a shaft under a roof, a dial with hands, a door at its foot."""
    wide = float(rng.uniform(0.2, 0.5))
    high, tone = (
        wide * float(rng.uniform(1.8, 3)),
        _tone(rng) if rng.random() < 0.5 else materials.stone(rng),
    )
    head, half = 1.15 * wide, wide / 2
    grow = wide * float(rng.uniform(0, 0.08))
    shaft = box([0, -half, 0], [wide, half, high])
    top = box([-grow, -half - grow, high - 0.001], [wide + grow, half + grow, high + head])
    eave, peak = wide * float(rng.uniform(0.02, 0.12)) + grow, wide * float(rng.uniform(0.4, 1.2))
    corners = [
        [x, y, high + head] for x in (-eave, wide + eave) for y in (-half - eave, half + eave)
    ]
    roof = hull(np.array([*corners, [half, 0, high + head + peak]]))
    radius, z = 0.44 * wide, high + head / 2
    pieces, front, ink = _dial(rng, -grow, 0, z, radius)
    parts = [("tower", Shape(), -1, None), *_hands(rng, front, 0, z, radius, ink, 1.5)]
    if rng.random() < 0.75:
        w, h, t = 0.22 * wide, wide * float(rng.uniform(0.6, 0.9)), 0.06 * wide
        shaft -= box([-1, -w, 0.03 * wide], [0.4 * wide, w, h])
        way, air = int(rng.choice([-1, 1])), 0.01 * wide
        door = box([-t, -w - 0.04 * wide, 0.02 * wide], [-air, w + 0.04 * wide, h + 0.03 * wide])
        joint = hinge(
            (-t, way * (w + 0.04 * wide), 0),
            (0, 0, -way),
            float(np.deg2rad(rng.uniform(80, 120))),
        )
        parts.append(("door", _shape((door, _tone(rng))), 0, joint))
    parts[0] = ("tower", _shape(*pieces, (shaft + top, tone), (roof, _tone(rng))), -1, None)
    return parts

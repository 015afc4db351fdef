"""Wall, mantel, alarm, pendulum and tower clocks. Scales, gauges and other instruments of the
family are in ``household_instruments``."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday import clock_dials, household_instruments
from uniart_jax.procedural.materials import plain
from uniart_jax.procedural.pieces import trimmed
from uniart_jax.procedural.shapes import (
    PartSpec,
    Shape,
    assembled,
    ball,
    box,
    cylinder,
    extrusion,
    hinge,
    hull,
    pipe,
    revolution,
    rotated,
    rounded,
    slide,
    tube,
    turn,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A clock or another instrument with a dial or pendulum, in metres, at rest."""
    kinds = (
        _wall,
        _pendulum,
        _alarm,
        household_instruments.scale,
        household_instruments.gauge,
        household_instruments.metronome,
        household_instruments.timer,
        household_instruments.weather_house,
        _tower,
    )
    make = kinds[rng.choice(9, p=[0.24, 0.2, 0.12, 0.12, 0.07, 0.07, 0.07, 0.05, 0.06])]
    return assembled(make(rng))


def _wall(rng: np.random.Generator) -> list[PartSpec]:
    """A clock that hangs or stands: a case, a rim or a hinged ring around the dial, knobs below
    it."""
    radius = float(rng.uniform(0.07, 0.2))
    kind = str(rng.choice(["round", "square", "arch", "gable"], p=[0.45, 0.25, 0.2, 0.1]))
    rim, depth = float(rng.uniform(0.1, 0.35)) * radius, float(rng.uniform(0.25, 0.8)) * radius
    wide = 2 * (radius + rim)
    tall = wide if kind == "round" else wide * float(rng.uniform(1.0, 1.5))
    rise = 0.0 if kind == "round" else (tall - wide) / 2  # of the dial above the middle
    tone, metal = clock_dials.draw_finish(rng), materials.hardware(rng)
    case = extrusion(clock_dials.case_outline(rng, kind, wide, tall), "x", [0, 0, 0], depth)
    pieces, front, ink = clock_dials.dial(rng, 0, 0, rise, radius)
    pieces.append((case, tone))
    if kind != "round" and rng.random() < 0.6:  # a foot
        out, thick = float(rng.uniform(0.02, 0.15)) * wide, float(rng.uniform(0.04, 0.1)) * wide
        pieces.append(
            (
                box(
                    [-out, -wide / 2 - out, -tall / 2 - thick],
                    [depth + out / 2, wide / 2 + out, -tall / 2],
                ),
                clock_dials.draw_finish(rng),
            )
        )
    if kind == "round" and rng.random() < 0.25:  # rays about it
        count = int(rng.choice([8, 12, 16]))
        ray = box(
            [0.3 * depth, -0.06 * radius, radius],
            [0.5 * depth, 0.06 * radius, radius * float(rng.uniform(1.5, 1.9))],
        )
        pieces.append(
            (
                union([ray.rotate((360 * k / count, 0, 0)) for k in range(count)]),
                clock_dials.draw_finish(rng),
            )
        )
    parts: list[PartSpec] = [
        ("case", Shape(), -1, None),
        *clock_dials.hands(rng, front, 0, rise, radius, ink),
    ]
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
        parts.append(("door", trimmed((band + tab, metal)), 0, joint))
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
            parts.append(("knob", trimmed((knob, metal)), 0, turn((0, y, z), (1, 0, 0))))
    parts[0] = ("case", trimmed(*pieces), -1, None)
    return parts


def _bob(rng, x, z, long, size, thick, tone, rod, most=0.3) -> tuple[Shape, float]:
    """A pendulum that hangs from (x, 0, z), and the angle in radians by which it is drawn aside."""
    out = min(float(np.deg2rad(rng.uniform(7, 12))), float(most))
    bar = box(
        [x - 0.2 * thick, -0.12 * size, z - long], [x + 0.2 * thick, 0.12 * size, z + 0.2 * size]
    )
    disc = cylinder("x", [x - thick / 2, 0, z - long], thick, size, segments=24)
    if rng.random() < 0.3:
        disc = disc.translate((0, 0, long - z)).scale((1, 0.75, 1.3)).translate((0, 0, z - long))
    turned = [
        (rotated(s, (np.rad2deg(-out), 0, 0), (0, 0, z)), m) for s, m in ((disc, tone), (bar, rod))
    ]
    return trimmed(*turned), out


def _trunk_door(rng, wide: float, edge: float, span, wall: float, tone, gold) -> PartSpec:
    """A glazed door in front of a pendulum. It reaches ``edge`` to each side and over the heights
    ``span``."""
    way, air, thick = int(rng.choice([-1, 1])), 0.004 * wide, 0.05 * wide
    a, b = span
    door = box([-thick, -edge, a], [-air, edge, b])
    door -= box([-1, -edge + 1.3 * wall, a + 1.3 * wall], [1, edge - 1.3 * wall, b - 1.3 * wall])
    knob = ball([-thick, -way * (edge - 0.65 * wall), (a + b) / 2], 0.03 * wide, 10)
    joint = hinge((-thick, way * edge, 0), (0, 0, -way), float(np.deg2rad(rng.uniform(85, 140))))
    return "door", trimmed((door, tone), (knob, gold)), 0, joint


def _weights(rng, wide: float, x: float, low: float, gold, metal) -> list[PartSpec]:
    """Two weights that hang on chains from a case's floor at ``low`` and sink."""
    r, chain = 0.07 * wide, wide * float(rng.uniform(0.3, 0.8))
    travel = wide * float(rng.uniform(0.4, 0.9))
    parts: list[PartSpec] = []
    for y in (-0.33 * wide, 0.33 * wide):
        z = low - chain * float(rng.uniform(0.5, 1))
        weight = cylinder("z", [x, y, z - 4 * r], 4 * r, 0.6 * r, r, 12)
        line = cylinder("z", [x, y, z - r], low - z + r - 0.004 * wide, 0.2 * r, segments=8)
        joint = slide((0, 0, -1), travel)
        parts.append(("weight", trimmed((weight, gold), (line, metal)), 0, joint))
    return parts


def _pendulum(rng: np.random.Generator) -> list[PartSpec]:
    """A pendulum clock: a case with a window, a pendulum, weights and a door; or a cuckoo clock."""
    house, tall = rng.random() < 0.3, rng.random() < 0.5
    wide = float(rng.uniform(0.16, 0.4))
    radius = wide * float(rng.uniform(0.3, 0.4) if not house else rng.uniform(0.24, 0.3))
    depth, wall = wide * float(rng.uniform(0.4, 0.6)), 0.06 * wide
    head = wide * float(rng.uniform(1.0, 1.2))
    trunk = 0.0 if house else wide * float(rng.uniform(1.9, 3.2) if tall else rng.uniform(0.7, 1.4))
    foot = wide * float(rng.uniform(0.4, 0.8)) if tall and not house else 0.0
    tone, gold, metal = (
        clock_dials.draw_finish(rng),
        plain(materials.hsv(rng, (0.1, 0.14), (0.4, 0.7), (0.6, 0.9))),
        materials.hardware(rng),
    )
    low, high = foot + trunk, foot + trunk + head
    kind = "gable" if house else str(rng.choice(["gable", "square", "arch"]))
    body = extrusion(
        clock_dials.case_outline(rng, kind, wide, head), "x", [0, 0, low + head / 2], depth
    )
    dial_z = low + head * 0.5
    pieces, front, ink = clock_dials.dial(rng, 0, 0, dial_z, radius)
    parts: list[PartSpec] = [
        ("case", Shape(), -1, None),
        *clock_dials.hands(rng, front, 0, dial_z, radius, ink, 1.8 if trunk else 1.3),
    ]
    x = depth / 2
    if trunk:
        half = float(rng.uniform(0.72, 1.0)) * wide / 2
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
        rod = box(
            [x - 0.1 * wide, -0.03 * wide, low - 0.06 * wide], [x + 0.1 * wide, 0.03 * wide, low]
        )
        rod = rod ^ box([x - 0.02 * wide, -1, 0], [x + 0.1 * wide, 1, 9])
        shape, out = _bob(
            rng,
            x - 0.08 * wide,
            low - 0.06 * wide,
            long,
            size,
            0.08 * wide,
            clock_dials.draw_finish(rng),
            metal,
        )
        top = low - 0.06 * wide
        eave = clock_dials.roof(
            0.62 * wide,
            (high - 0.12 * wide, high - 0.02 * wide),
            (high + 0.42 * wide, high + 0.52 * wide),
            [-0.1 * wide, 0, 0],
            depth + 0.1 * wide,
        )
        pieces.append((eave, clock_dials.draw_finish(rng)))
    pieces.append((body, tone))
    pieces.append((rod, metal))
    parts.append(("pendulum", shape, 0, hinge((x, 0, top), (1, 0, 0), 2 * out)))
    if trunk and rng.random() < 0.75:
        below = dial_z - radius - 0.05 * wide
        span = (foot + 0.02 * wide, min(low - 0.02 * wide, below))
        parts.append(_trunk_door(rng, wide, half - 0.01 * wide, span, wall, tone, gold))
    if house and rng.random() < 0.7:
        parts += _weights(rng, wide, x, low, gold, metal)
    parts[0] = ("case", trimmed(*pieces), -1, None)
    return parts


def _alarm(rng: np.random.Generator) -> list[PartSpec]:
    """An alarm clock: a drum on feet with bells and a hammer, or a block with a button on top."""
    radius, tone, metal = (
        float(rng.uniform(0.035, 0.07)),
        clock_dials.draw_finish(rng),
        materials.hardware(rng),
    )
    depth, legs = radius * float(rng.uniform(0.7, 1.2)), radius * float(rng.uniform(0.2, 0.4))
    outer, bells = radius * float(rng.uniform(1.08, 1.3)), rng.random() < 0.6
    z = legs + outer
    pieces, front, ink = clock_dials.dial(rng, 0, 0, z, radius)
    parts: list[PartSpec] = [
        ("case", Shape(), -1, None),
        *clock_dials.hands(rng, front, 0, z, radius, ink),
    ]
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
        parts.append(("hammer", trimmed((hammer, ink)), 0, joint))
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
        parts.append(("button", trimmed((button, clock_dials.draw_finish(rng))), 0, joint))
    if rng.random() < 0.6:  # a winding knob at the side
        r, y = 0.2 * outer, outer if bells else wide / 2
        s = float(rng.choice([-1, 1]))
        start = y + 0.01 * outer if s > 0 else -y - 0.31 * outer
        knob = cylinder("y", [depth / 2, start, z], 0.3 * outer, r, segments=10)
        parts.append(("knob", trimmed((knob, metal)), 0, turn((depth / 2, 0, z), (0, 1, 0))))
    parts[0] = ("case", trimmed(*pieces, (case, tone)), -1, None)
    return parts


def _tower(rng: np.random.Generator) -> list[PartSpec]:
    """A clock tower: a shaft under a roof, a dial with hands, a door at its foot."""
    wide = float(rng.uniform(0.2, 0.5))
    high, tone = (
        wide * float(rng.uniform(1.8, 3)),
        clock_dials.draw_finish(rng) if rng.random() < 0.5 else materials.stone(rng),
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
    pieces, front, ink = clock_dials.dial(rng, -grow, 0, z, radius)
    parts: list[PartSpec] = [
        ("tower", Shape(), -1, None),
        *clock_dials.hands(rng, front, 0, z, radius, ink, 1.5),
    ]
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
        parts.append(("door", trimmed((door, clock_dials.draw_finish(rng))), 0, joint))
    parts[0] = (
        "tower",
        trimmed(*pieces, (shaft + top, tone), (roof, clock_dials.draw_finish(rng))),
        -1,
        None,
    )
    return parts

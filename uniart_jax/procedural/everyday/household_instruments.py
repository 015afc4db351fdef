"""Kitchen scales, gauges, metronomes, timers and weather houses, as parts in metres at rest."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday import clock_dials
from uniart_jax.procedural.materials import plain
from uniart_jax.procedural.pieces import trimmed
from uniart_jax.procedural.shapes import (
    PartSpec,
    Shape,
    ball,
    box,
    cut,
    cylinder,
    extrusion,
    hinge,
    hull,
    revolution,
    rotated,
    rounded,
    slide,
    tube,
    turn,
)


def scale(rng: np.random.Generator) -> list[PartSpec]:
    """The parts of kitchen or shop scales (metres): a needle on a dial, a plate or bowl that sinks,
    a knob."""
    radius = float(rng.uniform(0.06, 0.12))
    wide, depth = 2.6 * radius * float(rng.uniform(1, 1.3)), radius * float(rng.uniform(1.1, 2))
    high, tone, metal = (
        2.7 * radius,
        clock_dials.draw_finish(rng),
        materials.metal(rng, brushed=False),
    )
    narrow = float(rng.uniform(0.6, 1.0))
    ends = [[-wide / 2, 0], [wide / 2, 0], [narrow * wide / 2, high], [-narrow * wide / 2, high]]
    if narrow * wide < 2.3 * radius:
        ends[2][0], ends[3][0] = 1.15 * radius, -1.15 * radius
    body = extrusion(np.array(ends), "x", [0, 0, 0], depth)
    z = 1.3 * radius
    pieces, front, ink = clock_dials.dial(rng, 0, 0, z, radius)
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
    parts: list[PartSpec] = [
        ("body", Shape(), -1, None),
        clock_dials.needle(rng, front, 0, z, radius, ink, sweep),
    ]
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
    finish = metal if rng.random() < 0.5 else clock_dials.draw_finish(rng)
    joint = slide((0, 0, -1), 0.8 * lift)
    parts.append(("pan", trimmed((pan, finish), (stem, metal)), 0, joint))
    parts[0] = ("body", trimmed(*pieces, (body, tone)), -1, None)
    return parts


def gauge(rng: np.random.Generator) -> list[PartSpec]:
    """The parts of a pressure gauge or thermometer (metres): a round box on a stem, a needle over
    its scale."""
    radius, metal = float(rng.uniform(0.03, 0.08)), materials.hardware(rng)
    depth, outer = radius * float(rng.uniform(0.4, 0.9)), 1.12 * radius
    pieces, front, ink = clock_dials.dial(rng, 0, 0, 0, radius)
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
    tone = clock_dials.draw_finish(rng)
    needle = clock_dials.needle(rng, front, 0, 0, radius, ink, float(rng.uniform(3.8, 5.2)))
    body = trimmed(
        *pieces, (rim, metal if rng.random() < 0.5 else tone), (case, tone), (base, metal)
    )
    return [("case", body, -1, None), needle]


def metronome(rng: np.random.Generator) -> list[PartSpec]:
    """The parts of a metronome (metres): a rod that swings in front of a tapered case, a weight
    that slides on it, a key."""
    high = float(rng.uniform(0.14, 0.25))
    wide, tone, metal = (
        high * float(rng.uniform(0.5, 0.65)),
        clock_dials.draw_finish(rng),
        materials.metal(rng),
    )
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
        """``solid`` swung out to one side."""
        return rotated(solid, (-out, 0, 0), (0, 0, z))

    way = np.array([0, -np.sin(np.deg2rad(-out)), np.cos(np.deg2rad(-out))])
    parts: list[PartSpec] = [
        (
            "case",
            trimmed(
                (base, tone),
                (low, clock_dials.draw_finish(rng) if rng.random() < 0.4 else tone),
                (board, metal),
            ),
            -1,
            None,
        )
    ]
    parts.append(
        (
            "rod",
            trimmed((swung(rod), metal)),
            0,
            hinge((x, 0, z), (1, 0, 0), np.deg2rad(2 * out)),
        )
    )
    travel = (at - z - 1.5 * size) * float(rng.uniform(0.6, 0.9))
    parts.append(
        (
            "weight",
            trimmed((swung(weight), materials.hardware(rng))),
            1,
            slide(-way, travel),
        )
    )
    s = float(rng.choice([-1, 1]))
    q, r = 0.5 * step, 0.09 * high
    start = 0.55 * wide if s > 0 else -0.55 * wide - 0.16 * wide
    key = cylinder("y", [depth / 2, start, q], 0.16 * wide, 0.3 * r, segments=10)
    wing = 0.64 * wide if s > 0 else -0.71 * wide - 0.09 * wide
    key += box(
        [depth / 2 - r, wing, q - 0.45 * r], [depth / 2 + r, wing + 0.16 * wide, q + 0.45 * r]
    )
    parts.append(("key", trimmed((key, metal)), 0, turn((depth / 2, 0, q), (0, 1, 0))))
    return parts


def timer(rng: np.random.Generator) -> list[PartSpec]:
    """The parts of a kitchen timer (metres): an egg, tomato or drum whose upper half turns, or a
    box with a large dial."""
    size, tone, mark = (
        float(rng.uniform(0.025, 0.05)),
        clock_dials.draw_finish(rng),
        materials.dark(rng),
    )
    other = tone if rng.random() < 0.5 else clock_dials.draw_finish(rng)
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
        parts: list[PartSpec] = [("body", trimmed((low, tone), (lower, mark)), -1, None)]
        joint = hinge((0, 0, seam), (0, 0, 1), sweep)
        parts.append(("dial", trimmed((high, other), (dot, mark)), 0, joint))
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
    pieces, front, _ = clock_dials.dial(rng, 0, 0, z, 1.2 * size)
    knob = cylinder("x", [front - reach, 0, z], reach - 0.01 * size, 0.7 * size, 0.8 * size, 28)
    grip = box(
        [front - 2 * reach, -0.14 * size, z - 0.68 * size],
        [front - reach, 0.14 * size, z + 0.68 * size],
    )
    point = box(
        [front - 2 * reach - 0.05 * size, -0.06 * size, z + 0.3 * size],
        [front - 2 * reach, 0.06 * size, z + 0.66 * size],
    )
    dial = trimmed((knob + grip, other), (point, plain((0.9, 0.2, 0.15))))
    parts: list[PartSpec] = [("case", trimmed(*pieces, (case, tone)), -1, None)]
    parts.append(("dial", dial, 0, hinge((0, 0, z), (1, 0, 0), sweep)))
    return parts


def weather_house(rng: np.random.Generator) -> list[PartSpec]:
    """The parts of a weather house (metres): a house with two doorways and two figures on a board
    that turns."""
    wide = float(rng.uniform(0.12, 0.25))
    high, depth, wall = 0.8 * wide, wide * float(rng.uniform(0.5, 0.7)), 0.05 * wide
    tone, roof, board = clock_dials.draw_finish(rng), clock_dials.draw_finish(rng), 0.06 * wide
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
    eave = clock_dials.roof(
        0.66 * wide,
        (0.86 * high, 0.98 * high),
        (1.5 * high, 1.64 * high),
        [-0.15 * wide, 0, board],
        depth + 0.2 * wide,
    )
    pieces = [(floor, clock_dials.draw_finish(rng)), (eave, roof), (body, tone)]
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
        turned += [(figure, clock_dials.draw_finish(rng)), (head, plain((0.9, 0.72, 0.58)))]
    placed = [(rotated(s, (0, 0, -out), (x, 0, 0)), m) for s, m in turned]
    joint = hinge((x, 0, low), (0, 0, 1), np.deg2rad(2 * out))
    return [
        ("house", trimmed(*pieces), -1, None),
        ("figures", trimmed(*placed), 0, joint),
    ]

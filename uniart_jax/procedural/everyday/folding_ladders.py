"""Step ladders and drying racks, in metres."""

from __future__ import annotations

import numpy as np

from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.folding_frames import (
    AIR,
    angle_between,
    bar_frame,
    draw_cover_finish,
    draw_frame_finish,
    frame_shape,
    panel,
)
from uniart_jax.procedural.shapes import (
    PartSpec,
    box,
    cylinder,
    hinge,
    union,
)


def ladder(rng: np.random.Generator) -> list[PartSpec]:
    """The parts of a step ladder (metres): treads in a frame, a rear frame hinged at the top, a
    platform that tips up."""
    tone, square = draw_frame_finish(rng)
    high = float(rng.uniform(0.45, 1.7))
    r, half = float(rng.uniform(0.013, 0.024)), float(rng.uniform(0.17, 0.27))
    count = max(2, round(high / float(rng.uniform(0.22, 0.3))))
    lean = np.tan(np.deg2rad(rng.uniform(12, 22)))
    rise = high + float(rng.choice([0.0, rng.uniform(0.25, 0.55)], p=[0.5, 0.5]))
    foot, top = np.array([0.0, r]), np.array([rise * lean, rise])
    rails = bar_frame([foot, top], half, r, square, [top] if rise > high else [])
    tread, thick = float(rng.uniform(0.07, 0.14)), float(rng.uniform(0.018, 0.035))
    steps = []
    for k in range(1, count):
        z = high * k / count
        x = z * lean
        steps.append(box([x - 0.65 * tread, -half, z], [x + 0.35 * tread, half, z + thick]))
    cover = draw_cover_finish(rng, tone)
    parts: list[PartSpec] = [("frame", frame_shape((rails, tone), (union(steps), cover)), -1, None)]
    side = np.array([np.cos(np.arctan(lean)), -np.sin(np.arctan(lean))])
    bolt = np.array([high * lean, high - 2.5 * r]) + side * (2.1 * r + AIR)
    heel = np.array([bolt[0] + bolt[1] * float(rng.uniform(0.25, 0.5)), r])
    rungs = [
        bolt + q * (heel - bolt)
        for q in (np.array([0.35, 0.85]) if high < 0.9 else np.array([0.25, 0.55, 0.9]))
    ]
    rear = bar_frame([bolt, heel], half, r, square, rungs)
    rear_tone = tone if rng.random() < 0.7 else materials.paint(rng)
    most = 0.72 * (angle_between(heel - bolt, foot - top))
    joint = hinge((bolt[0], 0, bolt[1]), (0, 1, 0), most)
    parts.append(("legs", frame_shape((rear, rear_tone)), 0, joint))
    inner = half - r - AIR if rise > high else half + r
    deep = float(rng.uniform(0.2, 0.32))
    x = high * lean + (0 if rise > high else -0.03)
    z = high + (1.5 * r + AIR if rise <= high else AIR)
    plate = panel(rng, x - 0.25 * deep, x + 0.75 * deep, inner, z, thick, False)
    at = x if rise > high else x - 0.25 * deep
    up = float(np.deg2rad(rng.uniform(60, 88)))
    if rise > high:  # it turns in the rails, its rear up
        plate = panel(rng, x - 0.05, x + 0.75 * deep, inner, z, thick, False)
        up = float(np.deg2rad(rng.uniform(55, 68)))
    parts.append(("platform", frame_shape((plate, cover)), 0, hinge((at, 0, z), (0, -1, 0), up)))
    return parts


def rack(rng: np.random.Generator) -> list[PartSpec]:
    """The parts of a drying rack (metres): rods in a frame on crossed legs, and two wings that
    swing up."""
    tone, _ = draw_frame_finish(rng)
    rods = tone if rng.random() < 0.5 else materials.white_plastic(rng)
    high, deep = float(rng.uniform(0.75, 1.05)), float(rng.uniform(0.45, 0.7))
    half, r = float(rng.uniform(0.24, 0.36)), float(rng.uniform(0.009, 0.015))
    x = deep / 2
    top = bar_frame([[-x, high], [x, high]], half, r, False, [[-x, high], [x, high]])
    legs = [
        bar_frame(
            [[s * 0.8 * x, r], [-s * 0.8 * x, high]],
            half - (2 * r if s > 0 else 0),
            r,
            False,
            [[s * 0.7 * x, 0.1]],
        )
        for s in (-1, 1)
    ]
    body = union([top, *legs])
    lines = [
        cylinder("y", [q, -half, high], 2 * half, 0.55 * r, segments=9)
        for q in np.linspace(-x, x, int(rng.integers(5, 9)))[1:-1]
    ]
    parts: list[PartSpec] = [("stand", frame_shape((body, tone), (union(lines), rods)), -1, None)]
    long, count = float(rng.uniform(0.4, 0.7)) * high, int(rng.integers(3, 6))
    wide = half * float(rng.uniform(0.7, 1.0))
    swing = float(np.deg2rad(rng.uniform(85, 125)))
    for s in (-1, 1):
        at = s * (x + 2 * r + AIR)
        levels = high - long * np.linspace(0, 1, count + 1)
        wing = bar_frame(
            [[at, high], [at, high - long]], wide, r, False, [[at, high], [at, levels[-1]]]
        )
        lines = [
            cylinder("y", [at, -wide, z], 2 * wide, 0.55 * r, segments=9) for z in levels[1:-1]
        ]
        joint = hinge((at, 0, high), (0, -s, 0), swing)
        parts.append(("wing", frame_shape((wing, tone), (union(lines), rods)), 0, joint))
    return parts

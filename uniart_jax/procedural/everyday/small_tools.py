"""Nail clippers, folding rulers and hole punches, as parts in metres; finishes of small tools."""

from __future__ import annotations

import numpy as np

from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.shapes import (
    PartSpec,
    Shape,
    box,
    cylinder,
    extrusion,
    hinge,
    hull,
    rotated,
    rounded,
    slide,
    tidy,
    union,
)


def draw_grip_finish(rng: np.random.Generator) -> Material:
    """Draw the finish of a grip: bright plastic, wood, dark plastic, horn or metal."""
    kind = rng.choice(5, p=[0.42, 0.16, 0.18, 0.1, 0.14])
    if kind == 0:
        return plain(materials.hsv(rng, (0, 1), (0.45, 0.95), (0.4, 0.95)))
    if kind == 1:
        return materials.wood(rng, grain="x")
    if kind == 2:
        return materials.dark(rng)
    return plain(rng.uniform(0.7, 0.95, 3)) if kind == 3 else materials.metal(rng, brushed=False)


def clippers(rng: np.random.Generator) -> list[PartSpec]:
    """The parts of nail clippers (metres): two sprung arms, a lever that turns about a pin, a file
    between the arms."""
    length = float(rng.uniform(0.055, 0.09))
    unit = length / 100
    wide, spread = float(rng.uniform(17, 27)) * unit, float(rng.uniform(6, 10))
    low = np.array(
        [
            [0.0, -50],
            [3, -50],
            [3, -38],
            [3 - spread, 22],
            [3 - spread, 34],
            [2.2, 47],
            [2.2, 50],
            [-1, 50],
            [-spread - 1, 36],
            [-spread - 1, 22],
            [-1, -38],
        ]
    )
    high = (low * [-1, 1] + [6, 0])[::-1]
    arms = [extrusion(p * unit, "y", [0, -wide / 2, 0], wide) for p in (low, high)]
    plan = rounded(length, wide, float(rng.uniform(0.1, 0.5)) * wide)
    plan = plan * np.column_stack([np.ones(len(plan)), 0.86 + 0.28 * plan[:, 0] / length])
    file = rng.random() < 0.65
    slot = box([-0.6 * length, -1, 1.2 * unit], [0.2 * length, 1, 4.8 * unit])
    rivet = cylinder("z", [-44 * unit, 0, 0.5 * unit], 5 * unit, 2.2 * unit, segments=12)
    body = union(arms) ^ extrusion(plan, "z", [0, 0, -1], 2)
    body = (body - slot if file else body) + rivet
    top = (7 + spread) * unit
    body += cylinder(
        "z", [29 * unit, 0, -spread * unit], top + spread * unit, 3 * unit, segments=14
    )
    steel = materials.metal(rng, brushed=False)
    parts: list[PartSpec] = [("arms", Shape().add(tidy(body), steel), -1, None)]
    rise, start = float(rng.uniform(2, 12)), float(rng.uniform(-48, -34))
    side = np.array([[0, 36], [0, 20], [rise, start], [rise + 3.5, start], [4, 20], [5, 36]]) * unit
    lever = extrusion(side, "y", [0, -wide / 2, 0], wide).translate((0, 0, top + 0.4 * unit))
    slim = float(rng.uniform(0.65, 0.95))
    lever ^= extrusion(plan * [1.1, slim], "z", [0, 0, 0], 1)
    knob = cylinder("z", [29 * unit, 0, top + 2 * unit], 5 * unit, 4 * unit, segments=14)
    finish = steel if rng.random() < 0.5 else draw_grip_finish(rng)
    joint = hinge((29 * unit, 0, 0), (0, 0, float(rng.choice([-1, 1]))), np.pi)
    parts.append(("lever", Shape().add(tidy(lever + knob), finish), 0, joint))
    if file:
        long = float(rng.uniform(52, 66)) * unit
        flat = rounded(long, 0.4 * wide, 0.15 * wide) + [long / 2 - 48 * unit, 0]
        plate = extrusion(flat, "z", [0, 0, 1.7 * unit], 2.6 * unit)
        plate -= cylinder("z", [-44 * unit, 0, -1], 2, 2.6 * unit, segments=12)
        way = (0, 0, float(rng.choice([-1, 1])))
        tone = steel.darker(0.7)
        parts.append(("file", Shape().add(plate, tone), 0, hinge((-44 * unit, 0, 0), way, 3.0)))
    return parts


def ruler(rng: np.random.Generator) -> list[PartSpec]:
    """The parts of a folding ruler (metres): three to seven limbs, stacked in a zigzag."""
    length, count = float(rng.uniform(0.12, 0.26)), int(rng.integers(3, 8))
    unit = length / 100
    wide, thick, air = float(rng.uniform(8, 15)) * unit, float(rng.uniform(3, 5)) * unit, 0.4 * unit
    tones = (
        [draw_grip_finish(rng)] * 2
        if rng.random() < 0.6
        else [draw_grip_finish(rng), draw_grip_finish(rng)]
    )
    metal, ink = materials.hardware(rng), materials.dark(rng)
    outline = rounded(length, wide, float(rng.uniform(0.1, 0.5)) * wide)
    pivot, parts = length / 2 - 0.55 * wide, []
    way = int(rng.choice([-1, 1]))
    for k in range(count):
        low, end = k * (thick + air), way * (1 if k % 2 else -1)
        shape = Shape().add(extrusion(outline, "z", [0, 0, low], thick), tones[k % 2])
        if k == count - 1:  # marks and the last rivet are seen on the uppermost
            steps = np.linspace(-0.32, 0.32, 17) * length
            marks = [
                box(
                    [x, -0.45 * wide, low + thick],
                    [x + unit, -(0.05 + 0.2 * (i % 2)) * wide, low + thick + 0.3 * unit],
                )
                for i, x in enumerate(steps)
            ]
            shape.add(union(marks), ink)
            spot = [end * pivot, 0, low + thick]
            shape.add(cylinder("z", spot, 0.7 * unit, 0.3 * wide, segments=16), metal)
        joint = hinge((end * pivot, 0, 0), (0, 0, end), np.pi) if k else None
        parts.append(("limb", shape, k - 1, joint))
    return parts


def punch(rng: np.random.Generator) -> list[PartSpec]:
    """The parts of a hole punch (metres): a lever about a pin at the rear over two punches, and a
    guide that slides out."""
    depth = float(rng.uniform(0.08, 0.13))
    unit, wide = depth / 100, depth * float(rng.uniform(0.5, 1.25))
    base, air, wall = float(rng.uniform(5, 12)) * unit, 0.5 * unit, float(rng.uniform(3, 5)) * unit
    angle, half = np.deg2rad(float(rng.uniform(16, 32))), wide / 2
    z, x = base + float(rng.uniform(24, 36)) * unit, 0.3 * depth
    tone, steel, other = (
        draw_grip_finish(rng),
        materials.metal(rng, brushed=False),
        draw_grip_finish(rng),
    )
    foot = extrusion(rounded(depth, wide, float(rng.uniform(1, 9)) * unit), "z", [0, 0, 0], base)
    cheeks, arm = [], half - wall - air
    for y in (-half, half - wall):
        ends = [
            [-0.05 * depth, base],
            [0.47 * depth, base],
            [x + 6 * unit, z + 5 * unit],
            [x - 6 * unit, z + 5 * unit],
        ]
        cheeks.append(hull(np.array([[a, q, b - 1e-4] for a, b in ends for q in (y, y + wall)])))
    body = union([foot, *cheeks])
    guide = rng.random() < 0.6
    r = float(rng.uniform(4, 6)) * unit
    posts = [
        cylinder("z", [-0.12 * depth, s * 0.6 * arm, base], z - base - 8 * unit, r, segments=14)
        for s in (-1, 1)
    ]
    shape = Shape()
    u, low = -0.32 * depth, base - 3.2 * unit
    g = float(rng.uniform(6, 9)) * unit if guide else 0.0  # the width of the guide's bar
    if guide:
        body -= box([u - air, -1, low - air], [u + g + air, 1, 1])
    shape.add(tidy(body), tone).add(union(posts), steel)
    parts: list[PartSpec] = [("base", shape, -1, None)]
    near, t = float(rng.uniform(0.42, 0.62)) * depth, float(rng.uniform(3, 6)) * unit
    knuckle = cylinder("y", [x, -arm, z], 2 * arm, 4.5 * unit, segments=18)
    slab = box([-near, -arm, z - 0.3 * unit], [x, arm, z + t])
    if rng.random() < 0.5:  # a round end
        plan = rounded(2 * (near + x), 2 * arm, float(rng.uniform(0.3, 1)) * arm)
        slab ^= extrusion(plan + [x, 0], "z", [0, 0, 0], 1)
    lever = rotated(slab + knuckle, (0, np.rad2deg(angle), 0), (x, 0, z))
    swing = hinge((x, 0, z), (0, -1, 0), angle * 0.95)
    parts.append(("lever", Shape().add(tidy(lever), other), 0, swing))
    if guide:
        proud = float(rng.uniform(3, 10)) * unit
        bar = box([u, -half + unit, low], [u + g, half + proud, low + 4 * unit])
        bar += box([u, half + proud - 3 * unit, low], [u + g, half + proud, low + 9 * unit])
        joint = slide((0, 1, 0), wide * float(rng.uniform(0.4, 0.7)))
        parts.append(("guide", Shape().add(bar, materials.dark(rng)), 0, joint))
    return parts

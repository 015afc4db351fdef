"""Coffee grinders: hand mills with a crank and electric ones with a hopper."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.coffee_fittings import add_knobs, column, draw_finish, draw_trim
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    ball,
    box,
    cylinder,
    extrusion,
    hinge,
    pipe,
    revolution,
    rounded,
    slide,
    tidy,
    tube,
    turn,
    union,
)


def hand_mill(rng: np.random.Generator) -> ArticulatedObject:
    """A hand mill in metres: a box with a drawer, or a tube; a bowl; a crank that turns on top."""
    half = float(rng.uniform(0.05, 0.08))
    high = half * float(rng.uniform(1.6, 3.0))
    unit = 2 * half / 60
    wood, steel = materials.wood(rng), materials.hardware(rng)
    wood = wood if rng.random() < 0.7 else draw_finish(rng)
    boxy = rng.random() < 0.65
    asm, body = Assembly(), Shape()
    if boxy:
        solid = box([0, -half, 3 * unit], [2 * half, half, high])
        lo, hi = (
            [0, -0.7 * half, 0.15 * high],
            [1.7 * half, 0.7 * half, float(rng.uniform(0.45, 0.7)) * high],
        )
        solid -= box(np.add(lo, [-1, -0.4 * unit, -0.4 * unit]), np.add(hi, 0.4 * unit))
        over = float(rng.uniform(0, 5)) * unit
        outline = rounded(2 * (half + over), 2 * (half + over), 2 * unit)
        for z in (0.0, high):
            solid += extrusion(outline, "z", [half, 0, z], 3.2 * unit)
        high += 3.2 * unit
    else:
        waist = float(rng.uniform(0.7, 1.0)) * half
        high *= 1.5
        r = np.array([0, half, half, waist, 0.9 * half, 0])
        z = np.array([0, 0, 0.12, 0.5, 1, 1]) * high
        solid = revolution(np.column_stack([r, z]), "z", [half, 0, 0], 28)
    body.add(tidy(solid), wood)
    dome = float(rng.uniform(0.5, 0.85)) * half
    rise = dome * float(rng.uniform(0.4, 0.9))
    a = np.linspace(0, np.pi / 2, 7)
    shape = np.column_stack([dome * np.cos(a), rise * np.sin(a)])
    if rng.random() < 0.4:  # an open bowl
        r = np.array([0.5, 1, 0.85, 0.4, 0.15, 0.15])
        shape = np.column_stack([r * dome, np.array([0, 1, 1, 0.3, 0.3, 1]) * rise])
    profile = np.vstack([[[0, 0]], shape, [[0, rise]]])
    body.add(revolution(profile, "z", [half, 0, high], 28), steel)
    root = asm.add("body", body)
    z = high + rise + 0.4 * unit
    yaw = float(rng.uniform(-np.pi, np.pi))
    way = np.array([np.cos(yaw), np.sin(yaw), 0])
    long = half * float(rng.uniform(1.1, 1.8))
    r = 1.9 * unit
    a, b = np.array([half, 0, z + 5 * unit]), np.array([half, 0, z + 5 * unit]) + way * long
    b[2] += float(rng.uniform(0, 6)) * unit
    rod = union([pipe([a, b], r, 10), cylinder("z", [half, 0, z], 7 * unit, 1.6 * r, segments=14)])
    grip = cylinder(
        "z", b + [0, 0, 0.3 * r], float(rng.uniform(9, 14)) * unit, 2.2 * r, 2.8 * r, 16
    )
    knob = union([grip, ball(b + [0, 0, 11 * unit], 3 * r, 16)]) if rng.random() < 0.5 else grip
    crank = Shape().add(tidy(rod - knob), steel).add(knob, wood.darker(0.7))
    asm.add("crank", crank, root, turn((half, 0, z), (0, 0, 1)))
    if boxy:
        front = box(np.add(lo, [0, 0.1 * unit, 0.1 * unit]), hi) - box(
            np.add(lo, [3 * unit, 2 * unit, 2 * unit]), np.add(hi, [-2 * unit, -2 * unit, 1])
        )
        pull = ball([-3 * unit, 0, (lo[2] + hi[2]) / 2], 3 * unit, 14)
        shape = Shape().add(front, wood.darker(0.85)).add(tidy(pull - front), steel)
        asm.add("drawer", shape, root, slide((-1, 0, 0), float(rng.uniform(0.6, 1.0)) * half))
    return asm.object()


def electric_grinder(rng: np.random.Generator) -> ArticulatedObject:
    """An electric grinder in metres: a hopper that turns, its lid, dials and a bin below."""
    half, depth = float(rng.uniform(0.06, 0.09)), float(rng.uniform(0.14, 0.22))
    high = float(rng.uniform(0.22, 0.34))
    unit = high / 80
    air = 0.35 * unit
    face = draw_finish(rng)
    trim = draw_trim(rng, face)
    base, head = float(rng.uniform(0.06, 0.12)) * high, float(rng.uniform(0.5, 0.62)) * high
    back = float(rng.uniform(0.4, 0.5)) * depth
    asm, body = Assembly(), Shape()
    corner = float(rng.uniform(0.02, 0.35)) * half
    solid = column(depth, half, 0, high, corner) - box([-1, -1, base], [back, 1, head])
    spout = cylinder("z", [0.5 * back, 0, head - 6 * unit], 6 * unit, 3 * unit, 5 * unit, 16)
    body.add(tidy(solid), face).add(spout, trim)
    root = asm.add("body", body)
    top, wide = high, min(0.85 * half, 0.42 * depth)
    x, tall = 0.5 * depth, float(rng.uniform(0.25, 0.5)) * high
    flare = wide * float(rng.uniform(1.0, 1.35))
    glass = materials.glass(rng)
    hopper = cylinder("z", [x, 0, top + air], tall, 0.75 * wide, flare, 28)
    collar = tube("z", [x, 0, top + air], 3.5 * unit, 0.95 * wide, 0.7 * wide)
    tab = box([x - 1.3 * wide, -2 * unit, top + air], [x - 0.9 * wide, 2 * unit, top + 3 * unit])
    ring = collar + tab
    shape = Shape().add(tidy(hopper - ring), glass).add(tidy(ring), trim)
    bin_ = asm.add(
        "hopper", shape, root, hinge((x, 0, 0), (0, 0, 1), float(np.deg2rad(rng.uniform(60, 180))))
    )
    lid = cylinder("z", [x, 0, top + tall + 2 * air], 3 * unit, 1.02 * flare, 0.95 * flare, 28)
    knob = cylinder("z", [x, 0, top + tall + 2 * unit], 5 * unit, 0.25 * flare, 0.3 * flare, 16)
    joint = slide((0, 0, 1), float(rng.uniform(0.15, 0.35)) * high)
    if rng.random() < 0.5:
        joint = hinge((x + flare, 0, top + tall + 2 * air), (0, 1, 0), float(rng.uniform(1.2, 1.9)))
    asm.add("lid", Shape().add(union([lid, knob]), trim), bin_, joint)
    if rng.random() < 0.7 and corner < 0.2 * half:
        middle = (head + high) / 2
        add_knobs(rng, asm, root, -5e-4, 0.8 * half, middle, (high - head) / 2, unit, trim)
    if rng.random() < 0.7:  # a bin under the spout
        r = min(0.45 * back, 0.7 * half)
        pot = cylinder("z", [0.5 * back, 0, base + air], head - 7 * unit - base, r, 0.95 * r, 24)
        asm.add(
            "bin",
            Shape().add(pot, glass if rng.random() < 0.6 else trim),
            root,
            slide((-1, 0, 0), float(rng.uniform(0.6, 1.0)) * back),
        )
    return asm.object()

"""Pepper and coffee mills: a head or a crank that turns, a drawer, or a jar that screws off.
Lengths are in metres."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.turned import (
    ROUND,
    draw_finish,
    stack,
)
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    ball,
    box,
    cylinder,
    extrusion,
    pipe,
    rounded,
    screw,
    slide,
    tidy,
    tube,
    turn,
    union,
)


def _crank(
    rng, z: float, reach: float, unit: float, face, metal, cap: Manifold | None = None
) -> Shape:
    """An arm from the z axis to a sleeve that stands on its end."""
    angle = float(rng.uniform(-np.pi, np.pi))
    rise = float(rng.uniform(0, 6)) * unit
    tip = np.array([reach * np.cos(angle), reach * np.sin(angle), z + 5 * unit + rise])
    axle = cylinder("z", [0, 0, z], 6.5 * unit, 2.6 * unit, segments=16)
    pin = cylinder("z", tip, 2.5 * unit, unit, segments=12)
    bar = pipe([[0, 0, z + 5 * unit], tip], 1.5 * unit, 10)
    arm = union([axle, bar, pin, *([cap] if cap else [])])
    r = float(rng.uniform(3, 5.5)) * unit
    rows = [(0.6, 0), (0.8, 1), (1, 2), (0.85, 2.8), (0.45, 3.2)]
    knob = stack([(ROUND * s * r, k * r) for s, k in rows]).translate(
        tuple(tip + [0, 0, 2.5 * unit])
    )
    return Shape().add(tidy(arm), metal).add(knob, face)


def pepper_mill(rng: np.random.Generator) -> ArticulatedObject:
    """A pepper mill in metres: a turned body, and a head or crank that turns on it."""
    high, slim = float(rng.uniform(0.1, 0.35)), float(rng.uniform(0.13, 0.28))
    r, unit = high * slim, high / 100
    face, metal = draw_finish(rng), materials.hardware(rng)
    face = materials.wood(rng) if rng.random() < 0.5 else face
    split = high * float(rng.uniform(0.55, 0.85))
    t = np.linspace(0, 1, 17)
    waist = float(rng.uniform(0.0, 0.45))
    at, wide = float(rng.uniform(0.35, 0.75)), float(rng.uniform(0.15, 0.35))
    shape = 1 - waist * np.exp(-(((t - at) / wide) ** 2)) - float(rng.uniform(0, 0.2)) * t
    for _ in range(int(rng.integers(0, 4))):  # beads turned in
        shape = shape - 0.1 * np.exp(-(((t - rng.uniform(0.1, 0.9)) / 0.05) ** 2))
    rows = [(ROUND * r * s, split * u) for s, u in zip(shape, t, strict=True)]
    body, head = Shape().add(stack(rows), face), Shape()
    neck = rows[-1][0][0]
    if rng.random() < 0.5:
        body.add(cylinder("z", [0, 0, split], 1.2 * unit, 0.9 * neck, segments=32), metal)
        split += 1.2 * unit
    z, left = split + 0.4 * unit, high - split
    big = float(rng.uniform(0.9, 1.25)) * max(neck, 0.75 * r)
    kind = str(rng.choice(["dome", "ball", "drum", "crank"], p=[0.3, 0.25, 0.2, 0.25]))
    wave = 1 - 0.05 * (np.arange(48) // 2 % 2) if rng.random() < 0.35 else ROUND
    tone = face if rng.random() < 0.55 else draw_finish(rng)
    asm = Assembly()
    root = asm.add("body", body)
    if kind == "crank":
        cap = stack([(ROUND * neck, z), (ROUND * 0.8 * neck, z + 4 * unit)])
        head = _crank(rng, z, float(rng.uniform(1.0, 1.8)) * r, unit, tone, metal, cap)
        asm.add("crank", head, root, turn((0, 0, 0), (0, 0, 1)))
        return asm.object()
    curves = {
        "dome": [(0.95, 0), (1, 0.2), (1, 0.5), (0.85, 0.75), (0.5, 0.95), (0.2, 1)],
        "ball": [(0.6, 0), (0.62, 0.12), (0.9, 0.3), (1, 0.55), (0.85, 0.8), (0.45, 0.97)],
        "drum": [(1, 0), (1, 0.3), (0.94, 0.35), (1, 0.4), (1, 0.9), (0.9, 1)],
    }
    solid = stack([(wave * big * s, z + left * u) for s, u in curves[kind]])
    head.add(solid, tone)
    if rng.random() < 0.6:  # the nut on top
        head.add(tidy(ball([0, 0, z + left], 0.24 * big, 14) - solid), metal)
    asm.add("head", head, root, turn((0, 0, 0), (0, 0, 1)))
    return asm.object()


def coffee_mill(rng: np.random.Generator) -> ArticulatedObject:
    """A coffee mill in metres: a box with a drawer under a hopper and a crank, or a tube over a
    jar."""
    face, metal = materials.wood(rng) if rng.random() < 0.6 else draw_finish(rng), draw_finish(rng)
    s = float(rng.uniform(0.09, 0.16))
    unit, air, asm, body = s / 80, s / 200, Assembly(), Shape()
    if rng.random() < 0.4:  # a tube: the lower part screws off
        r, low = 0.28 * s * float(rng.uniform(0.8, 1.3)), s * float(rng.uniform(0.3, 0.7))
        top = low + s * float(rng.uniform(0.6, 1.2))
        body.add(stack([(ROUND * r, low), (ROUND * r, top), (ROUND * 0.9 * r, top + unit)]), face)
        if rng.random() < 0.5:
            sleeve = tube("z", [0, 0, low + 0.3 * s], 0.3 * s, 1.06 * r, r, 40)
            body.add(sleeve, materials.dark(rng) if rng.random() < 0.6 else draw_finish(rng))
        root = asm.add("body", body)
        deep = low - air
        jar = stack([(ROUND * 0.9 * r, 0), (ROUND * r, 0.1 * deep), (ROUND * r, deep)])
        joint = screw((0, 0, 0), (0, 0, -1), float(rng.choice([0.5, 1.0, 2.0])), 0.15 * s)
        asm.add("jar", Shape().add(jar, draw_finish(rng)), root, joint)
        crank = _crank(rng, top + unit + air, s * float(rng.uniform(0.4, 0.8)), unit, face, metal)
        asm.add("crank", crank, root, turn((0, 0, 0), (0, 0, 1)))
        return asm.object()
    half, high = 0.5 * s, s * float(rng.uniform(0.6, 1.1))
    legs, wall = float(rng.choice([0, rng.uniform(2, 5)])) * unit, 5 * unit
    w, z0, z1 = half - wall - air, legs + wall, legs + high * float(rng.uniform(0.35, 0.6))
    case = extrusion(rounded(s, s, float(rng.uniform(1, 8)) * unit), "z", [0, 0, legs], high)
    case -= box([-s, -w - air, z0 - air], [half - wall, w + air, z1 + air])
    body.add(case, face)
    base = 0.6 * s if rng.random() < 0.5 else 0.53 * s
    for a, b in ((0.0, legs), (legs + high, legs + high + 3 * unit)):
        if b > a:
            body.add(box([-base, -base, a], [base, base, b]), face.darker(0.75))
    top, r = legs + high + 3 * unit, float(rng.uniform(0.25, 0.5)) * s
    curve = [(0.5, 0), (0.75, 0.2), (1, 0.5), (0.9, 0.75), (0.5, 0.97)]
    if rng.random() < 0.4:
        curve = [(0.45, 0), (0.6, 0.4), (1, 0.9), (1.02, 1.0)]
    tall = float(rng.uniform(0.25, 0.6)) * s
    body.add(stack([(ROUND * r * k, top + tall * u) for k, u in curve]), metal)
    root = asm.add("body", body)
    top += curve[-1][1] * tall + air
    crank = _crank(rng, top, s * float(rng.uniform(0.45, 0.9)), unit, face, metal)
    asm.add("crank", crank, root, turn((0, 0, 0), (0, 0, 1)))
    lo, hi = [-half, -w, z0], [half - wall - air, w, z1]
    drawer = box(lo, hi) - box([-half + wall, -w + wall, z0 + wall], [0.25 * s, w - wall, z1 + 1])
    pull = ball([-half - 3 * unit, 0, (z0 + z1) / 2], 4.5 * unit, 14)
    shape = Shape().add(drawer, face if rng.random() < 0.6 else draw_finish(rng))
    asm.add(
        "drawer",
        shape.add(pull - box(lo, hi), metal),
        root,
        slide((-1, 0, 0), float(rng.uniform(0.4, 0.75)) * s),
    )
    return asm.object()

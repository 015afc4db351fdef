"""Staplers: a base, a magazine and a cap about one pin at the rear, a pusher that slides in the
magazine."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.pieces import merged
from uniart_jax.procedural.shapes import (
    Assembly,
    box,
    cylinder,
    extrusion,
    hinge,
    hull,
    slide,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A stapler, metres, closed as it lies on a desk; its mouth at -x, or turned about z."""
    length = (
        float(rng.uniform(0.08, 0.2)) if rng.random() < 0.85 else float(rng.uniform(0.25, 0.35))
    )
    unit = length / 100
    half = float(rng.uniform(6, 13)) * unit  # of the base's width
    yaw = float(rng.choice([0, 90, -90, rng.uniform(-180, 180)], p=[0.35, 0.15, 0.1, 0.4]))
    spread = np.deg2rad(yaw)
    matrix = np.array(
        [[np.cos(spread), -np.sin(spread), 0], [np.sin(spread), np.cos(spread), 0], [0, 0, 1]]
    )
    body = materials.dark(rng) if rng.random() < 0.35 else materials.paint(rng)
    cap_face = body if rng.random() < 0.65 else materials.paint(rng)
    steel = materials.metal(rng, brushed=False)
    gap = float(rng.uniform(3, 9)) * unit  # between base and magazine
    base_high = float(rng.uniform(3, 6)) * unit
    rail = float(rng.uniform(5.5, 9)) * unit  # height of the magazine
    arm = half * float(rng.uniform(0.6, 0.95))  # half the cap's width
    inner = arm * float(rng.uniform(0.6, 0.8))  # and the magazine's
    air, wall = 0.45 * unit, 1.1 * unit
    pin_x = length - float(rng.uniform(7, 13)) * unit
    low = base_high + gap  # underside of the magazine
    pin = np.array([pin_x, 0, low + 0.55 * rail])
    boss = 0.5 * rail + 1.2 * unit

    asm = Assembly()

    def add(name: str, pieces, parent: int = -1, joint=None) -> int:
        return asm.add(name, merged(pieces, yaw), parent, joint)

    # base: a long foot with ears outside everything that turns, and the anvil
    ear = arm + air
    thick = float(rng.uniform(1.6, 2.6)) * unit
    wide = max(half, ear + thick)
    tip = float(rng.uniform(0.0, 6)) * unit  # how far the base goes beyond the mouth
    outline = _foot(rng, -tip, length, wide, unit)
    foot = extrusion(outline, "z", [0, 0, 0], base_high)
    ears = []
    for y in (-ear - thick, ear):
        corners = [
            [x, yy, z]
            for x, z in (
                (pin_x - 1.6 * boss, base_high - unit),
                (length - 1.5 * unit, base_high - unit),
            )
            for yy in (y, y + thick)
        ]
        ears.append(
            hull(
                np.array(
                    corners
                    + [
                        [pin_x + s * 0.7 * boss, yy, pin[2] + 0.6 * boss]
                        for s in (-1, 1)
                        for yy in (y, y + thick)
                    ]
                )
            )
        )
        ears.append(cylinder("y", [pin_x, y, pin[2]], thick, boss, segments=20))
    root_solid = union([foot, *ears])
    pieces = [(root_solid, body)]
    plate = float(rng.uniform(0.5, 0.9)) * inner
    anvil = box([2 * unit, -plate, base_high], [11 * unit, plate, base_high + 0.5 * unit])
    pieces.append((anvil, steel))
    head = [
        cylinder(
            "y",
            [pin_x, s * (ear + thick) - (0 if s > 0 else 0.6 * unit), pin[2]],
            0.6 * unit,
            0.45 * boss,
            segments=14,
        )
        for s in (-1, 1)
    ]
    rod = cylinder("y", [pin_x, -ear - thick, pin[2]], 2 * (ear + thick), 0.2 * boss, segments=12)
    pieces.append((union([*head, rod]) - root_solid, steel))
    bore = cylinder("y", [pin_x, -1, pin[2]], 2, 0.2 * boss + 0.5 * air, segments=12)
    if rng.random() < 0.5:
        sole = extrusion(outline * 0.96 + [0.02 * length, 0], "z", [0, 0, -1.2 * unit], 1.2 * unit)
        pieces.append((sole, materials.dark(rng)))
    root = add("base", pieces)

    axis = matrix @ np.array([0.0, 1, 0])
    at = matrix @ pin
    # magazine: a channel open above, its lugs between the cap's
    top = low + rail
    front = float(rng.uniform(0.0, 1.5)) * unit
    back = pin_x + 0.2 * boss
    channel = box([front, -inner, low], [back, inner, top])
    channel -= box([front + wall, -inner + wall, low + wall], [back + 1, inner - wall, top + 1])
    knuckle = cylinder("y", [pin_x, -inner, pin[2]], 2 * inner, 0.45 * rail, segments=18)
    lift = float(rng.uniform(20, 60)) if rng.random() < 0.7 else float(rng.uniform(60, 88))
    joint = hinge(at, axis, float(np.deg2rad(lift)))
    magazine = add(
        "magazine",
        [(union([channel, knuckle]) - bore, steel if rng.random() < 0.7 else body)],
        root,
        joint,
    )

    # pusher: a block on the floor of the channel, drawn back from the mouth
    if rng.random() < 0.75:
        at_x = front + wall + float(rng.uniform(0.1, 0.55)) * (back - front)
        long = float(rng.uniform(8, 14)) * unit
        stop = pin_x - 0.5 * rail - long - unit
        if stop - at_x > max(8 * unit, 0.006):
            block = box(
                [at_x, -inner + wall + air, low + wall + 0.3 * unit],
                [at_x + long, inner - wall - air, top - 0.6 * unit],
            )
            way = matrix @ np.array([1.0, 0, 0])
            tone = materials.dark(rng) if rng.random() < 0.5 else materials.paint(rng)
            add("pusher", [(block, tone)], magazine, slide(way, stop - at_x))

    # cap: a hood over the magazine, its cheeks outside the channel
    drop = float(rng.uniform(0.35, 0.8)) * rail  # how far its cheeks reach down
    profile = _hood(
        rng, front - float(rng.uniform(0.5, 3)) * unit, top + air, boss, pin, unit
    )  # (z, x)
    hood = extrusion(profile, "y", [0, -arm, 0], 2 * arm)
    cheek_low = top - drop
    skirt = hull(
        np.array(
            [
                [x, y, z]
                for y in (-arm, arm)
                for x, z in (
                    (profile[:, 1].min() + 2 * unit, cheek_low),
                    (pin_x, cheek_low),
                    (profile[:, 1].min() + unit, top + 2 * air),
                    (pin_x, top + 2 * air),
                )
            ]
        )
    )
    rear = cylinder("y", [pin_x, -arm, pin[2]], 2 * arm, 0.75 * boss, segments=20)
    slot = box([-1, -inner - air, -1], [length + 1, inner + air, top + air])
    inside = cylinder(
        "y", [pin_x, -inner - air, pin[2]], 2 * (inner + air), 0.45 * rail + air, segments=20
    )
    swept = box(
        [pin_x - 0.2 * boss, -inner - air, pin[2] - boss - 1],
        [pin_x + boss, inner + air, pin[2] + 0.55 * rail + air],
    )
    cap = union([hood, skirt, rear]) - slot - inside - swept - bore
    pieces = [(cap, cap_face)]
    if rng.random() < 0.35:  # a soft pad where one presses
        x0 = profile[:, 1].min()
        pad = box([x0 + 4 * unit, -0.7 * arm, 0], [x0 + 26 * unit, 0.7 * arm, 1])
        layer = (hood.translate((0, 0, 0.7 * unit)) ^ pad) - hood
        pieces.append((layer, materials.dark(rng)))
    joint = hinge(at, axis, float(np.deg2rad(rng.uniform(45, 88))))
    add("cap", pieces, magazine, joint)
    return asm.object()


def _foot(rng, start: float, end: float, half: float, unit: float) -> np.ndarray:
    """The base's outline (x, y): round or square before, with a waist on some."""
    nose = half * float(rng.uniform(0.55, 1.0))
    angle = np.linspace(np.pi / 2, 3 * np.pi / 2, 9)
    bulge = float(rng.uniform(0.1, 0.9)) * nose
    front = np.column_stack([start + bulge + bulge * np.cos(angle), nose * np.sin(angle)])
    waist = half * float(rng.choice([1.0, rng.uniform(0.65, 0.9)]))
    middle = start + 0.5 * (end - start)
    lower = [[middle, -waist], [end - 30 * unit, -half], [end, -half]]
    upper = [[end, half], [end - 30 * unit, half], [middle, waist]]
    return np.vstack([front, lower, upper])


def _hood(rng, start, low, boss, pin, unit) -> np.ndarray:
    """The cap's side view (z, x): low at the mouth, higher behind, or a straight bar."""
    nose = float(rng.uniform(2.5, 6)) * unit
    crest = float(rng.uniform(4, 12)) * unit
    rear = pin[0] + 0.75 * boss
    x = np.linspace(start, rear, 9)
    u = (x - start) / (rear - start)
    kind = rng.integers(3)
    if kind == 0:
        rise = nose + (crest - nose) * np.sin(0.5 * np.pi * u)
    elif kind == 1:
        rise = nose + (crest - nose) * np.sin(np.pi * np.clip(u, 0, 1))
    else:
        rise = np.full(9, nose)
        rise[0] *= 0.5
    top = np.column_stack([low + rise, x])
    return np.vstack([top, [[low, rear], [low, start]]])

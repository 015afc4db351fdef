"""Mirrors, boards, hourglasses and drums that turn between two posts."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold
from trimesh.transformations import rotation_matrix, translation_matrix

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.globe_stands import draw_finish, draw_foot, flat_ring
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.pieces import merged
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    ball,
    box,
    cylinder,
    extrusion,
    hinge,
    revolution,
    rounded,
    slide,
    tidy,
    tube,
    turn,
    union,
)


def framed(rng: np.random.Generator) -> ArticulatedObject:
    """A mirror, a board, an hourglass or a drum with a crank, in metres, that turns about y between
    two posts."""
    kind = str(rng.choice(["mirror", "board", "glass", "drum"], p=[0.42, 0.24, 0.17, 0.17]))
    half, tall = float(rng.uniform(0.1, 0.18)), float(rng.uniform(0.1, 0.2))
    if kind == "mirror" and rng.random() < 0.4:
        half, tall = float(rng.uniform(0.2, 0.32)), float(rng.uniform(0.5, 0.75))
    elif kind == "board":
        half, tall = float(rng.uniform(0.4, 0.8)), float(rng.uniform(0.3, 0.5))
    elif kind == "glass":
        half = tall * float(rng.uniform(0.4, 0.6))
    round_one = kind == "mirror" and tall < 0.4 and rng.random() < 0.6
    tall = half if round_one else tall
    unit = max(half, tall) / 45
    finish, metal = draw_finish(rng), materials.hardware(rng)
    content, reach, deep = _draw_content(rng, kind, half, tall, round_one, unit, finish, metal)
    foot = float(rng.uniform(2, 5)) * unit
    rise = float(rng.uniform(0.02, 0.6)) * tall
    if kind == "board" or tall > 0.4:
        rise = float(rng.uniform(0.1, 0.4)) * tall
    center = np.array([0, 0, foot + reach + 2 * unit + rise])
    air, wall = 0.7 * unit, float(rng.uniform(2, 4)) * unit
    w = float(rng.uniform(0.8, 1.6)) * 2 * unit
    y = half + air
    asm, stand = Assembly(), Shape()
    spread = max(0.45 * reach, 1.2 * deep) * float(rng.uniform(0.9, 1.4))
    hooped = round_one and rng.random() < 0.65
    if hooped:
        arc = flat_ring(y + wall, y, 2 * w, np.pi / 2 - 0.1, 1.5 * np.pi + 0.1)
        arc = arc.translate(tuple(center))
        base = draw_foot(rng, 0.7 * half, foot, center[2] - y - 0.5 * wall, 2 * unit)
        stand.add(tidy(base + arc), finish)
    else:
        solids = []
        for s in (-1, 1):
            lo, hi = sorted((s * y, s * (y + wall)))
            solids.append(box([-w, lo, 0.5 * foot], [w, hi, center[2] + 2 * w]))
            solids.append(box([-spread, lo, 0], [spread, hi, foot]))
        low = float(rng.choice([0.0, 0.3])) * (center[2] - reach) if kind != "glass" else 0.0
        bar = box([-w, -y, low], [w, y, low + foot])
        if kind in ("glass", "drum") or (tall < 0.4 and kind == "mirror" and rng.random() < 0.6):
            bar = box([-spread, -y, 0], [spread, y, foot])
        shaft = cylinder("y", [0, 0, center[2]], 1, 0.6 * w, segments=14)  # bored for a crank
        frame = tidy(union([*solids, bar]) - (shaft if kind == "drum" else Manifold()))
        stand.add(frame, finish)
    drawer = not hooped and kind == "mirror" and tall < 0.4 and rng.random() < 0.5
    d, h = 0.0, 0.0  # half the depth and the height of a chest below the mirror
    if drawer:
        d = float(rng.uniform(0.4, 0.6)) * half + spread
        h = float(rng.uniform(0.25, 0.4)) * tall + 6 * unit
    near = np.array([-d, -0.9 * y, -0.85 * h])  # two corners of the chest's drawer
    far = np.array([0.8 * d, 0.9 * y, -0.15 * h])
    if drawer:
        chest = box([-d, -y - wall, -h], [d, y + wall, 0])
        stand.add(chest - box(near - [1, air, air], far + air), finish)
    for s in (-1, 1):
        lo = s * (y + wall) if s > 0 else -y - wall - 1.5 * unit
        if kind != "drum" and not hooped:
            stand.add(cylinder("y", [0, lo, center[2]], 1.5 * unit, 0.8 * w, segments=16), metal)
    root = asm.add("stand", stand)
    gap = [
        cylinder("y", [0, a, 0], 0.4 * unit + air, 0.6 * w, segments=14)
        for a in (-half - 0.8 * air, half - 0.4 * unit)
    ]
    if kind == "drum":
        arm = max(float(rng.uniform(0.3, 0.6)) * reach, 7 * unit)
        end = half + air + wall
        lever = box([-1.3 * unit, end + air, -arm], [1.3 * unit, end + air + 2.4 * unit, 2 * unit])
        grip = cylinder("y", [0, end + air, -arm], 12 * unit, 2 * unit, segments=14)
        gap[1] = cylinder("y", [0, half - unit, 0], wall + 2 * air + 2 * unit, 0.45 * w)
        gap += [lever, grip]
    inside = union([solid for solid, _ in content])
    turned = merged([*content, (union(gap) - inside, metal)])
    move, joint = translation_matrix(center), turn(center, (0, 1, 0))
    if kind == "mirror":
        move = move @ rotation_matrix(rng.uniform(-0.25, 0.25), (0, 1, 0))
        if rng.random() >= 0.35:
            joint = hinge(center, (0, 1, 0), rng.choice([-1, 1]) * rng.uniform(0.4, 0.9))
    asm.add(kind, turned.moved(move), root, joint)
    if drawer:
        front = box(near, far) - box(near + 2 * unit, far + [-2 * unit, -2 * unit, 1])
        pull = ball([-d - 1.5 * unit, 0, -0.5 * h], 2.2 * unit, 14)
        shape = Shape().add(front, finish.darker(0.85)).add(tidy(pull - front), metal)
        asm.add("drawer", shape, root, slide((-1, 0, 0), float(rng.uniform(0.8, 1.5)) * d))
    return asm.object()


def _draw_content(
    rng, kind, half, tall, round_one, unit, finish, metal
) -> tuple[list, float, float]:
    """What turns about y through 0, ``half`` to each side. Returns its solids with their materials,
    how far it reaches from the axis, and half its depth."""
    pieces: list[tuple[Manifold, Material]] = []
    if kind in ("mirror", "board"):
        deep, rim = float(rng.uniform(1, 2)) * unit, float(rng.uniform(2, 6)) * unit
        if round_one:
            frame = tube("x", [-deep, 0, 0], 2 * deep, half, half - rim, 40)
            pane = cylinder("x", [-0.5 * deep, 0, 0], deep, half - rim, segments=40)
        else:
            corner = (
                float(rng.choice([0.02, 0.3, 0.98])) * half if kind == "mirror" else 0.02 * half
            )
            outline = rounded(2 * half, 2 * tall, corner, 8)
            inner = outline * (1 - rim / np.array([half, tall]))
            pane = extrusion(inner, "x", [-0.5 * deep, 0, 0], deep)
            frame = extrusion(outline, "x", [-deep, 0, 0], 2 * deep) - extrusion(
                inner, "x", [-1, 0, 0], 2
            )
        face = plain(materials.hsv(rng, (0.5, 0.6), (0.03, 0.2), (0.7, 0.95)))
        if kind == "board":
            boards = ([0.1, 0.25, 0.18], [0.12, 0.12, 0.13], [0.93, 0.93, 0.93], [0.7, 0.52, 0.35])
            face = plain(np.array(boards[rng.integers(4)]) * rng.uniform(0.85, 1.05))
        rim_face = finish if rng.random() < 0.5 else metal
        return [(frame, rim_face), (pane, face)], float(np.hypot(tall, deep)), deep
    if kind == "glass":
        t = np.linspace(-1, 1, 21)
        z, waist = 0.86 * tall * t, 0.12
        bulb = np.sin(np.pi / 2 * np.abs(t) ** 0.7) * (1 - 0.3 * t**6)
        r = 0.72 * half * (waist + (1 - waist) * bulb)
        profile = np.vstack([[[0, z[0]]], np.column_stack([r, z]), [[0, z[-1]]]])
        glass = revolution(profile, "z", [0, 0, 0], 24)
        low, top = (-1, -0.5 * tall) if rng.random() < 0.5 else (0.2 * tall, 0.7 * tall)
        sand = glass ^ box([-1, -1, low], [1, 1, top])
        corner = 0.1 * half if rng.random() < 0.3 else half
        outline = rounded(2 * half, 2 * half, corner, 8)
        plate = [extrusion(outline, "z", [0, 0, a], 0.14 * tall) for a in (-tall, 0.86 * tall)]
        count = int(rng.integers(3, 5))
        a = np.pi / 4 + 2 * np.pi * np.arange(count) / count
        rods = [
            cylinder(
                "z",
                [0.84 * half * np.cos(b), 0.84 * half * np.sin(b), -0.9 * tall],
                1.8 * tall,
                1.6 * unit,
                segments=12,
            )
            for b in a
        ]
        boss = [
            box([-1.5 * unit, lo * half, -1.5 * unit], [1.5 * unit, hi * half, 1.5 * unit])
            for lo, hi in ((-1, -0.6), (0.6, 1))
        ]
        band = tube("z", [0, 0, -1.5 * unit], 3 * unit, 0.9 * half, 0.78 * half, 28)
        hoop = tidy(union([*plate, *rods, *boss, band]))
        pale = plain(materials.hsv(rng, (0.4, 0.6), (0.03, 0.15), (0.8, 0.95)))
        pieces += [(hoop, finish), (glass - sand - hoop, pale)]
        pieces.append((sand - hoop, plain(rng.uniform([0.4, 0.3, 0.2], [0.95, 0.8, 0.7]))))
        return pieces, float(np.hypot(tall, half)), half
    reach = float(rng.uniform(0.8, 1.3)) * half
    ends = [
        cylinder("y", [0, a, 0], 2 * unit, reach, segments=30) for a in (-half, half - 2 * unit)
    ]
    if rng.random() < 0.5:  # bars
        count = int(rng.integers(10, 18))
        bars = [
            cylinder(
                "y",
                [0.93 * reach * np.cos(a), -half + unit, 0.93 * reach * np.sin(a)],
                2 * half - 2 * unit,
                1.1 * unit,
                segments=8,
            )
            for a in 2 * np.pi * np.arange(count) / count
        ]
        return [(union([*ends, *bars]), metal)], reach, reach
    sides = int(rng.choice([6, 8, 30]))
    drum = cylinder("y", [0, -half + unit, 0], 2 * (half - unit), 0.92 * reach, segments=sides)
    hatch = box([-0.4 * reach, -0.5 * half, 0], [0.4 * reach, 0.5 * half, 0.97 * reach])
    tone = plain(rng.uniform(0.1, 0.9, 3))
    return [(union([*ends, drum, hatch]), tone)], reach, reach

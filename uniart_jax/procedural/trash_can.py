"""Waste bins: a pedal bin with its bucket, a swing-top bin, and a wheeled bin with a lid."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    extrusion,
    hinge,
    loft,
    rounded,
    turn,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A waste bin, metres, closed."""
    kind = rng.choice(3, p=[0.42, 0.28, 0.3])
    return (_pedal, _swing, _wheeled)[int(kind)](rng)


def _finish(rng: np.random.Generator) -> Material:
    return materials.metal(rng) if rng.random() < 0.45 else materials.paint(rng)


def _pedal(rng: np.random.Generator) -> ArticulatedObject:
    height = float(rng.uniform(0.25, 0.68))
    deep, wide = float(rng.uniform(0.2, 0.3)), float(rng.uniform(0.2, 0.32))
    if height > 0.45:
        deep, wide = deep + 0.06, wide + 0.08
    unit = max(height, wide, deep) / 100
    round_one = rng.random() < 0.5
    if round_one:
        deep = wide = (deep + wide) / 2
    corner = 0.499 * wide if round_one else float(rng.uniform(0.02, 0.08))
    taper = float(rng.uniform(0.8, 1.0)) if rng.random() < 0.4 else 1.0
    points = 9 if round_one else 5
    top = rounded(deep, wide, corner, points)
    shell, dark = _finish(rng), materials.dark(rng)
    wall = max(0.006, 1.8 * unit)
    base = max(0.06, 0.13 * height)

    def ring(z: float, inset: float = 0.0) -> np.ndarray:
        share = taper + (1 - taper) * z / height
        return rounded(
            deep * share - 2 * inset, wide * share - 2 * inset, corner * share - inset, points
        )

    asm, body = Assembly(), Shape()
    reach = float(rng.uniform(0.035, 0.06))  # of the pedal in front of the body
    front = -deep * (taper + (1 - taper) * 0.02 / height) / 2
    half, thick = float(rng.uniform(0.1, 0.2)) * wide, max(0.011, 1.9 * unit)
    pivot, low = front + 0.045, max(0.03, 3.5 * unit)
    angle = min(float(np.deg2rad(rng.uniform(9, 15))), np.arcsin(0.7 * low / (reach + 0.045)))
    slot = box(
        [front - 1, -half - 0.003, low - 0.024], [pivot + 0.006, half + 0.003, low + thick + 0.004]
    )
    solid = loft(ring(0), ring(height), 0, height)
    hollow = loft(ring(base, wall), ring(height, wall), base, height + 0.001)
    cuff = box([-2, -2, -1], [2, 2, 0.75 * base])
    solid = cut(solid, (hollow, slot))
    axis_x, axis_z = deep / 2 + 0.012, height + 0.002
    rear = [
        cylinder("y", [axis_x, -0.14 * wide, axis_z], 0.28 * wide, 0.011, segments=16)
        - box([-1, -1, axis_z - 0.001], [axis_x - 0.007, 1, 1]),
        box([deep / 2 - wall, -0.14 * wide, height - 0.07], [axis_x + 0.01, 0.14 * wide, axis_z - 0.004]),  # noqa: E501
    ]  # fmt: skip
    body.add(union([solid - cuff, *[r - hollow for r in rear]]), shell)
    body.add(solid ^ cuff, dark)
    root = asm.add("body", body)

    pedal = extrusion(
        rounded(reach + 0.045, 2 * half, 0.01), "z", [pivot - (reach + 0.045) / 2, 0, low], thick
    )
    joint = hinge((pivot, 0, low + thick / 2), (0, 1, 0), -angle)
    finish = materials.hardware(rng) if rng.random() < 0.7 else dark
    asm.add("pedal", Shape().add(pedal, finish), root, joint)

    rise = float(rng.uniform(0.02, 0.06)) * (1.5 if height > 0.4 else 1.0)
    z = height + 0.003
    notch = cylinder("y", [axis_x, -0.15 * wide, axis_z], 0.3 * wide, 0.014, segments=16)
    cover = loft(top, top, z, z + 0.4 * rise + 0.004)
    cover += loft(top, top * float(rng.uniform(0.45, 0.92)), z + 0.4 * rise, z + rise)
    tongue = box(
        [deep / 2 - 0.03, -0.12 * wide, z], [axis_x + 0.004, 0.12 * wide, z + 0.4 * rise + 0.004]
    )
    cover = union([cover, tongue]) - notch
    lid = Shape().add(cover, shell if rng.random() < 0.55 else dark)
    swing = float(np.deg2rad(rng.uniform(70, 92)))
    asm.add("lid", lid, root, hinge((axis_x, 0, axis_z), (0, 1, 0), swing))

    if rng.random() < 0.6:
        air, skin = 0.006, max(0.004, 1.5 * unit)
        gap, floor = wall + air, base + 0.004
        tall = height - float(rng.uniform(0.015, 0.04)) * height * 2
        bucket = loft(ring(floor, gap), ring(tall, gap), floor, tall)
        room = loft(ring(floor, gap + skin), ring(tall, gap + skin), floor + skin, tall + 0.001)
        bucket = Shape().add(bucket - room, materials.paint(rng) if rng.random() < 0.5 else dark)
        asm.add("bucket", bucket, root)
    return asm.object()


def _swing(rng: np.random.Generator) -> ArticulatedObject:
    height, wide = float(rng.uniform(0.3, 0.62)), float(rng.uniform(0.24, 0.42))
    deep = wide * float(rng.uniform(0.7, 1.0))
    hood = float(rng.uniform(0.45, 0.7)) * deep
    unit = max(height + hood, wide) / 100
    shell = _finish(rng)
    cap = shell if rng.random() < 0.3 else materials.paint(rng)
    taper, corner = float(rng.uniform(0.74, 0.95)), float(rng.uniform(0.01, 0.05))
    wall = max(0.006, 1.8 * unit)
    outline = rounded(deep, wide, corner)

    asm = Assembly()
    body = loft(outline * taper, outline, 0, height)
    inner = outline * (1 - 2 * wall / np.ptp(outline, 0))
    body -= loft(inner * taper, inner, wall, height + 0.001)
    root = asm.add("body", Shape().add(body, shell))

    # the hood: a profile in (z, x) pushed along y; its front stands upright and holds the flap
    z0, half, over = height + 0.002, wide / 2 + 0.6 * wall, deep / 2 + 0.6 * wall
    upright = float(rng.uniform(0.72, 0.85)) * hood
    bow = np.linspace(0, np.pi / 2, 5) if rng.random() < 0.5 else np.array([0.0, np.pi / 2])
    front_cut = 0.3 * deep
    profile = [[0.0, over], [0.0, -over], [upright, -over]]
    profile += [
        [upright + (hood - upright) * np.sin(t), -over + front_cut * (1 - np.cos(t))]
        for t in bow[1:]
    ]
    profile += [[hood, over - front_cut], [upright * 0.9, over]]
    profile = np.array(profile)
    center = profile.mean(0)
    shrunk = center + (profile - center) * (1 - 2 * wall / np.ptp(profile, 0))
    solid = extrusion(profile, "y", [0, -half, z0], 2 * half)
    room = extrusion(shrunk, "y", [0, -half + wall, z0], 2 * half - 2 * wall)
    below = box(
        [-over + wall, -half + wall, z0 - 1], [over - wall, half - wall, z0 + 0.3 * upright]
    )
    flap_z = (z0 + 0.14 * upright, z0 + 0.9 * upright)
    flap_y = 0.84 * half
    window = box([-over - 1, -flap_y, flap_z[0]], [-over + 3 * wall, flap_y, flap_z[1]])
    shade = Shape().add(cut(solid, (room, below, window)), cap)
    top = asm.add("hood", shade, root)

    air = max(0.003, 0.5 * unit)
    thick = max(0.007, 1.8 * unit)
    lo = np.array([-over + 0.1 * wall, -flap_y + air, flap_z[0] + air])
    hi = np.array([-over + 0.1 * wall + thick, flap_y - air, flap_z[1] - air])
    flap = Shape().add(box(lo, hi), cap.darker(0.8) if rng.random() < 0.5 else materials.dark(rng))
    if rng.random() < 0.6:
        y, z = 0.35 * flap_y, lo[2] + 0.25 * (hi[2] - lo[2])
        sign = box([lo[0] - 0.9 * unit, -y, z - 0.06 * hood], [lo[0], y, z + 0.06 * hood])
        flap.add(sign, materials.white_plastic(rng))
    joint = hinge((hi[0], 0, hi[2]), (0, 1, 0), -float(np.deg2rad(rng.uniform(50, 80))))
    asm.add("flap", flap, top, joint)
    return asm.object()


def _wheeled(rng: np.random.Generator) -> ArticulatedObject:
    height, wide = float(rng.uniform(0.85, 1.1)), float(rng.uniform(0.45, 0.6))
    deep = float(rng.uniform(0.5, 0.7))
    unit = height / 100
    shell, dark = materials.paint(rng), materials.dark(rng)
    wall, taper = 2.0 * unit, float(rng.uniform(0.74, 0.86))
    outline = rounded(deep, wide, float(rng.uniform(0.02, 0.06)))
    foot = outline * taper + [0.5 * (1 - taper) * deep * 0.6, 0]

    asm, body = Assembly(), Shape()
    radius, tread = float(rng.uniform(0.09, 0.13)), float(rng.uniform(0.045, 0.065))
    floor = 0.35 * radius
    rim = rounded(deep + 0.04, wide + 0.04, 0.05)
    inner = outline * (1 - 2 * wall / np.ptp(outline, 0))
    inner_foot = foot.mean(0) + (foot - foot.mean(0)) * (1 - 2 * wall / np.ptp(foot, 0))
    solid = loft(foot, outline, floor, height) + extrusion(rim, "z", [0, 0, height - 0.05], 0.05)
    hollow = loft(inner_foot, inner, floor + wall, height + 0.001)
    axle_x = float(foot[:, 0].max()) - 0.45 * radius
    side = np.ptp(foot[:, 1]) / 2
    wells = [
        cylinder("y", [axle_x, s * side - 1.2 * tread, radius], 2.4 * tread, radius + 0.02, segments=24)  # noqa: E501
        for s in (-1, 1)
    ]  # fmt: skip
    skirts = [
        cylinder("y", [axle_x, s * side - 1.2 * tread - wall, radius], 2.4 * tread + 2 * wall, radius + 0.02 + wall)  # noqa: E501
        for s in (-1, 1)
    ]  # fmt: skip
    inside = loft(foot, outline, floor, height)
    solid = union([solid - hollow, *[s ^ inside for s in skirts]])
    solid = cut(solid, wells)
    axle = cylinder(
        "y", [axle_x, -side + 0.3 * tread, radius], 2 * side - 0.6 * tread, 0.016, segments=12
    )
    grip_x, grip_z = deep / 2 + 0.02 + 0.06, height - 0.06
    grip = [
        cylinder("y", [grip_x, -0.42 * wide, grip_z], 0.84 * wide, 0.014, segments=12),
        *[box([deep / 2, y - 0.018, grip_z - 0.02], [grip_x + 0.005, y + 0.018, grip_z + 0.012]) for y in (-0.36 * wide, 0.36 * wide)],  # noqa: E501
    ]  # fmt: skip
    body.add(union([solid, axle, *[g - hollow for g in grip]]), shell)
    root = asm.add("body", body)

    hub = materials.paint(rng) if rng.random() < 0.4 else shell.darker(0.6)
    for s in (-1, 1):
        y0 = side - 0.55 * tread if s > 0 else -side - 0.45 * tread
        disc = cylinder("y", [axle_x, y0, radius], tread, radius, segments=28)
        bore = cylinder("y", [axle_x, y0 - 1, radius], 2, 0.021, segments=12)
        core = cylinder("y", [axle_x, y0 - 1, radius], 2, 0.62 * radius, segments=24)
        holes = []
        for k in range(5):
            a = 2 * np.pi * k / 5
            at = [axle_x + 0.4 * radius * np.cos(a), y0 - 1, radius + 0.4 * radius * np.sin(a)]
            holes.append(cylinder("y", at, 2, 0.13 * radius, segments=10))
        wheel = Shape().add(disc - core, dark)
        wheel.add(cut(disc ^ core, (bore, *holes)), hub)
        asm.add("wheel", wheel, root, turn((axle_x, 0, radius), (0, 1, 0)))

    axis_x, z = deep / 2 + 0.02, height + 0.004
    rise = float(rng.uniform(0.03, 0.08))
    edge = rounded(deep + 0.05, wide + 0.05, 0.05) - [0.004, 0]
    edge[:, 0] = np.minimum(edge[:, 0], axis_x - 0.004)
    cover = loft(edge, edge, z, z + 0.022)
    cover += loft(edge * 0.93, edge * float(rng.uniform(0.55, 0.85)), z + 0.02, z + rise)
    lip = box(
        [edge[:, 0].min() - 0.03, -0.25 * wide, z], [edge[:, 0].min() + 0.02, 0.25 * wide, z + 0.02]
    )
    lid = Shape().add(union([cover, lip]), shell if rng.random() < 0.5 else materials.paint(rng))
    swing = float(np.deg2rad(rng.uniform(95, 180)))
    asm.add("lid", lid, root, hinge((axis_x, 0, z), (0, 1, 0), swing))
    return asm.object()

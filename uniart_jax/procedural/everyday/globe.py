"""Globes, globe bars and gimbals. The family's mirrors, tripods and display racks are in
``turning_frames``, ``tripod_devices`` and ``spinning_racks``."""

from __future__ import annotations

import numpy as np
from trimesh.transformations import rotation_matrix, translation_matrix

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.globe_stands import (
    add_horizon,
    draw_finish,
    draw_foot,
    flat_ring,
    legs_around,
)
from uniart_jax.procedural.everyday.spinning_racks import spinning_rack
from uniart_jax.procedural.everyday.tripod_devices import tripod
from uniart_jax.procedural.everyday.turning_frames import framed
from uniart_jax.procedural.materials import TEXTURE_SIZE, Material, plain
from uniart_jax.procedural.pieces import merged
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    ball,
    box,
    cylinder,
    hinge,
    tidy,
    tube,
    turn,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """Something that turns in a stand, in metres, at rest."""
    kinds = (_globe, _globe_bar, framed, _gimbal, tripod, spinning_rack)
    return kinds[rng.choice(6, p=[0.3, 0.06, 0.22, 0.08, 0.18, 0.16])](rng)


def _draw_map(rng: np.random.Generator, radius: float) -> Material:
    """Draw the finish of a ball: land and sea, a moon, or plain."""
    if rng.random() < 0.12:
        return plain(rng.uniform(0.2, 0.9, 3))
    field = materials.noise(rng, 6, 6) + 0.4 * materials.noise(rng, 14, 14)
    seas = (
        [0.25, 0.5, 0.8],
        [0.1, 0.2, 0.45],
        [0.75, 0.65, 0.45],
        [0.1, 0.1, 0.12],
        [0.6, 0.8, 0.9],
    )
    sea = np.array(seas[rng.integers(5)]) * rng.uniform(0.8, 1.15)
    land = np.stack([rng.uniform(0.2, 0.95, 3), rng.uniform(0.2, 0.95, 3)])
    pick = (materials.noise(rng, 7, 7) > 0)[..., None]
    colors = np.where(field[..., None] > 0.1, np.where(pick, land[0], land[1]), sea)
    image = (np.clip(colors, 0, 1) * 255).astype(np.uint8).reshape(TEXTURE_SIZE, TEXTURE_SIZE, 3)
    return Material(tuple(np.clip(sea, 0, 1).tolist()), image, "z", 2.5 * radius)


def _globe(rng: np.random.Generator) -> ArticulatedObject:
    """A globe in an arc on a foot, or in rings on legs. The arc itself turns at times."""
    radius = float(rng.uniform(0.08, 0.2))
    unit = radius / 30
    tilt = float(rng.uniform(0.25, 0.6)) if rng.random() < 0.8 else 0.0
    gap, wide = float(rng.uniform(2, 5)) * unit, float(rng.uniform(2, 6)) * unit
    band = float(rng.uniform(1.5, 3)) * unit
    inner = radius + gap
    outer = inner + band
    kind = str(rng.choice(["arc", "moving", "horizon"], p=[0.6, 0.15, 0.25]))
    finish, metal = draw_finish(rng), materials.hardware(rng)
    yaw = float(rng.choice([0.0, np.pi, rng.uniform(-np.pi, np.pi)], p=[0.3, 0.3, 0.4]))
    spin = rotation_matrix(yaw, (0, 0, 1))
    foot = float(rng.uniform(2.5, 6)) * unit
    stem = float(rng.uniform(1.5, 30)) * unit
    low = foot + stem + 3 * unit + (3 * unit if kind == "moving" else 0)
    if kind == "horizon":
        low = radius * (
            float(rng.uniform(0.2, 0.6)) if rng.random() < 0.6 else float(rng.uniform(0.8, 2))
        )
    center = np.array([0, 0, low + outer])
    axis = np.array([0, np.sin(tilt), np.cos(tilt)])
    lean = rotation_matrix(-tilt, (1, 0, 0))
    pins = [
        cylinder("z", [0, 0, z], gap + 0.5 * band, 1.5 * unit, segments=12)
        for z in (radius + 0.5 * unit, -radius - 0.5 * unit - gap - 0.5 * band)
    ]
    pins = [p.transform(lean[:3]) for p in pins]
    around = kind != "arc" or rng.random() < 0.2
    span = () if around else (tilt - 0.12, tilt + np.pi + 0.12)
    arc = flat_ring(outer, inner, wide, *span)
    arc = tidy(union([arc, *pins])).translate(tuple(center))
    asm, stand = Assembly(), Shape()
    size = radius * float(rng.uniform(0.55, 0.95))
    top = center[2] - outer + 0.3 * band
    if kind == "horizon":
        add_horizon(rng, stand, center, outer, unit, finish)
        stand.add(tidy(arc - stand.solid()), metal)
    elif kind == "arc":
        base = draw_foot(rng, size, foot, top, float(rng.uniform(1.5, 3.5)) * unit)
        if rng.random() < 0.4:
            stand.add(tidy(base + arc), finish)
        else:
            stand.add(tidy(base - arc), finish).add(arc, metal)
    else:  # a saddle in which the ring turns
        air = 0.5 * unit
        saddle = box(
            [-wide / 2 - 2 * unit, -5 * unit, center[2] - outer - 3.5 * unit],
            [wide / 2 + 2 * unit, 5 * unit, center[2] - inner - 0.5 * gap],
        )
        slot = flat_ring(outer + air, inner - gap, wide + 2 * air).translate(tuple(center))
        base = draw_foot(
            rng, size, foot, center[2] - outer - 2 * unit, float(rng.uniform(1.5, 3.5)) * unit
        )
        stand.add(tidy(base + (saddle - slot)), finish)
    root = asm.add("stand", stand.moved(spin))
    if kind == "moving":
        way = spin[:3, :3] @ np.array([1.0, 0, 0])
        root = asm.add(
            "meridian",
            Shape().add(arc, metal).moved(spin),
            root,
            hinge(center, way, rng.uniform(0.6, 1.5) * rng.choice([-1, 1])),
        )
    whole = ball([0, 0, 0], radius, 40)
    sphere = Shape().add(whole, _draw_map(rng, radius))
    if rng.random() < 0.25:  # a band round the equator
        belt = tube("z", [0, 0, -unit], 2 * unit, radius + 0.6 * unit, 0.97 * radius, 40)
        sphere = Shape().add(tidy(whole - belt), _draw_map(rng, radius)).add(belt, metal)
    move = translation_matrix(center)
    asm.add("ball", sphere.moved(spin @ move @ lean), root, turn(center, spin[:3, :3] @ axis))
    return asm.object()


def _globe_bar(rng: np.random.Generator) -> ArticulatedObject:
    """A globe on legs whose upper half opens about a hinge at the rear."""
    radius = float(rng.uniform(0.2, 0.3))
    unit = radius / 40
    rim = radius * float(rng.uniform(1.6, 2.6))
    finish, skin = draw_finish(rng), _draw_map(rng, radius)
    air, wall = 0.4 * unit, 1.6 * unit
    shell = ball([0, 0, rim], radius, 40) - ball([0, 0, rim], radius - wall, 32)
    asm, body = Assembly(), Shape()
    body.add(tidy(shell ^ box([-1, -1, 0], [1, 1, rim])), skin)
    tray = cylinder("z", [0, 0, rim - 0.35 * radius], 1.5 * unit, 0.93 * radius - wall, segments=30)
    tray = tray - cylinder("z", [0.3 * radius, 0, 0], 9, 0.25 * radius) - shell
    body.add(tidy(tray), finish)
    back = radius + 3 * unit
    ring = tube("z", [0, 0, rim - 4 * unit], 4 * unit, back, 0.9 * radius, 40)
    r = float(rng.uniform(1.5, 2.6)) * unit
    low = 4 * unit + r  # of the stretcher
    legs = legs_around(int(rng.integers(3, 5)), 0.4, back - r, 1.0, rim - 2 * unit, r, low)
    whole = ball([0, 0, rim], radius, 40)
    board = cylinder("z", [0, 0, low + r], 2 * unit, 0.7 * radius, segments=30)
    body.add(tidy(union([ring, *legs, board]) - whole), finish)
    root = asm.add("stand", body)
    cap = ball([0, 0, rim], radius, 40) ^ box([-1, -1, rim + air], [1, 1, 9])
    ring = tube("z", [0, 0, rim + air], 2.5 * unit, radius + 2 * unit, 0.9 * radius, 40) - cap
    hollow = ball([0, 0, rim], radius - wall, 32)
    tab = box([0.9 * radius, -5 * unit, rim + air], [back, 5 * unit, rim + air + 2.5 * unit]) - cap
    lid = Shape().add(tidy(cap - hollow), skin).add(tidy(union([ring - hollow, tab])), finish)
    joint = hinge((back, 0, rim + air), (0, 1, 0), float(np.deg2rad(rng.uniform(60, 90))))
    asm.add("lid", lid, root, joint)
    return asm.object()


def _gimbal(rng: np.random.Generator) -> ArticulatedObject:
    """Rings on a foot that turn within one another, with a ball, a disc or a compass inside."""
    radius = float(rng.uniform(0.08, 0.22))
    unit = radius / 45
    band, wide = float(rng.uniform(2.5, 4.5)) * unit, float(rng.uniform(3, 8)) * unit
    gap = 1.0 * unit + wide**2 / (3 * radius)
    finish, metal = draw_finish(rng), materials.hardware(rng)
    foot, rise = float(rng.uniform(2.5, 6)) * unit, float(rng.uniform(3, 50)) * unit
    center = np.array([0, 0, foot + rise + radius])
    yaw = float(rng.uniform(-0.8, 0.8))
    asm, frame = Assembly(), rotation_matrix(yaw, (0, 0, 1))
    frame[:3, 3] = center
    full = rng.random() < 0.4
    span = () if full else (np.pi / 2 - 0.15, 1.5 * np.pi + 0.15)
    arc = flat_ring(radius, radius - band, wide, *span)
    base = draw_foot(rng, 0.55 * radius, foot, foot + rise + 0.4 * band, 2.5 * unit)
    spun = arc.transform(frame[:3])
    tone = metal if rng.random() < 0.5 else finish
    root = asm.add("stand", merged([(base - spun, finish), (spun, tone)]))
    inner, parent, axis = radius - band, root, np.array([0.0, 1, 0])
    rings = int(rng.integers(1, 3))
    local = frame @ rotation_matrix(float(rng.uniform(0.4, 1.4)), axis)
    for k in range(rings):
        outer = inner - gap
        inner = outer - band
        ring = flat_ring(outer, inner, wide)
        pins = [
            cylinder(
                "y",
                [0, s * (outer - 0.4 * band) if s > 0 else -outer - 0.7 * gap, 0],
                0.4 * band + 0.7 * gap,
                1.2 * unit,
                segments=12,
            )
            for s in (-1, 1)
        ]
        pins = pins if k % 2 == 0 else [p.rotate((90, 0, 0)) for p in pins]
        tone = metal if k == 0 else materials.hardware(rng)
        way = local[:3, :3] @ (np.array([0.0, 1, 0]) if k % 2 == 0 else np.array([0.0, 0, 1]))
        shape = Shape().add(tidy(union([ring, *pins])), tone).moved(local)
        parent = asm.add("ring", shape, parent, turn(center, way))
        local = local @ rotation_matrix(
            float(rng.uniform(0.4, 1.4)), (0, 0, 1) if k % 2 == 0 else (0, 1, 0)
        )
    size = inner - gap
    upright = rings % 2 == 1  # its axle is square to the last ring's
    kind = str(rng.choice(["ball", "disc"]))
    if kind == "ball":
        size *= float(rng.uniform(0.6, 0.95))
        core = Shape().add(ball([0, 0, 0], size, 32), _draw_map(rng, size))
    else:
        thick = float(rng.uniform(0.15, 0.4)) * size
        size = np.sqrt(size**2 - (thick / 2) ** 2) if size > thick else 0.7 * size
        disc = cylinder("z", [0, 0, -thick / 2], thick, size, segments=32)
        cap = tube("z", [0, 0, -0.6 * thick], 1.2 * thick, 0.75 * size, 0.6 * size, 28)
        core = Shape().add(tidy(disc - cap), finish).add(tidy(cap), metal)
    axle = cylinder("z", [0, 0, -inner + 0.3 * gap], 2 * inner - 0.6 * gap, 1.2 * unit, segments=12)
    core.add(tidy(axle - core.solid()), metal)
    lean = np.eye(4) if upright else rotation_matrix(np.pi / 2, (1, 0, 0))
    way = (local @ lean)[:3, 2]
    asm.add("core", core.moved(local @ lean), parent, turn(center, way))
    return asm.object()

"""Barrel grills: a horizontal drum with a chimney, a fire box or shelves."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.barbecue_fittings import (
    add_side_shelf,
    add_wheel,
    draw_board,
    draw_finish,
    grate_slots,
    handle_across,
)
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    hinge,
    pipe,
    tidy,
    union,
)


def barrel_grill(rng: np.random.Generator) -> ArticulatedObject:
    """A barrel grill in metres: a horizontal drum whose upper half opens, on legs with wheels, with
    a chimney, a fire box or shelves."""
    radius, half = float(rng.uniform(0.18, 0.26)), float(rng.uniform(0.26, 0.5))
    center = float(rng.uniform(0.6, 0.85))
    unit = max(center + radius, 2 * half) / 100
    air, wall = 0.4 * unit, 1.6 * unit
    face, steel, dark = draw_finish(rng), materials.metal(rng, brushed=False), materials.dark(rng)
    board = draw_board(rng)
    asm, body = Assembly(), Shape()
    full = cylinder("y", [0, -half, center], 2 * half, radius, segments=36)
    shell = full - cylinder(
        "y", [0, -half + wall, center], 2 * half - 2 * wall, radius - wall, segments=36
    )
    lower = box([-1, -2, 0], [1, 2, center])
    body.add(shell ^ lower, face)
    grate = box(
        [-0.97 * radius, -half + wall, center - 3 * unit],
        [0.97 * radius, half - wall, center - 2 * unit],
    )
    holes = grate_slots(-0.85 * radius, 0.85 * radius, half, 14, 1)
    body.add(tidy(cut(grate, holes) - shell), steel)
    leg, w, foot = 1.5 * unit, 0.75 * half, float(rng.uniform(0.8, 1.2)) * radius
    wheel = float(rng.uniform(5, 10)) * unit
    side = float(rng.choice([-1, 1]))
    rolling = rng.random() < 0.75
    bars = []
    for s in (-1, 1):
        end = wheel if rolling and s == side else leg
        for x in (-1, 1):
            hip = [0.5 * x * radius, s * w, center - 0.5 * radius]
            bars.append(pipe([hip, [x * foot, s * w, end]], leg, 10))
    bars.append(box([-0.9 * foot, -w, 0.3 * center], [0.9 * foot, w, 0.3 * center + 1.5 * unit]))
    body.add(tidy(union(bars) - full), dark)
    chimney = rng.random() < 0.6
    if chimney:
        s, r = -side, float(rng.uniform(3, 5)) * unit
        y = chimney_y = s * (half + r + 1.5 * unit)
        top = center + radius * float(rng.uniform(1.1, 1.8))
        z = center - 0.3 * radius
        lo, hi = sorted((s * (half - 0.5 * wall), y))
        pipes = [
            cylinder("z", [0, y, z - r], top - z + r, r, segments=20),
            cylinder("y", [0, lo, z], hi - lo, 0.9 * r, segments=18),
        ]
        body.add(tidy(union(pipes) - full), face)
    fire = rng.random() < 0.4
    room = float(rng.uniform(0.8, 1.1)) * radius
    low_z = center - 0.85 * radius
    y = sorted((side * half, side * (half + 2 * room)))
    if fire:
        lo, hi = [-room, y[0], low_z - room * 0.4], [room, y[1], center - 0.1 * radius]
        crate = box(lo, hi) - box(np.add(lo, wall), [room - wall, y[1] - wall, 9])
        body.add(tidy(crate - full), face)
    root = asm.add("barrel", body)
    lid = Shape().add(shell - box([-1, -2, 0], [1, 2, center + air]), face)
    phi = float(rng.uniform(0.2, 0.6))
    x, z = -0.93 * radius * np.cos(phi), center + 0.93 * radius * np.sin(phi)
    out = (-0.07 * radius - 5 * unit * np.cos(phi), 5 * unit * np.sin(phi))
    grip = handle_across(float(rng.uniform(0.2, 0.6)) * half, x, z, out, 1.4 * unit)
    lid.add(tidy(grip - full), board if rng.random() < 0.4 else steel)
    swing = float(np.deg2rad(rng.uniform(55, 90)))
    asm.add("lid", lid, root, hinge((radius, 0, center + air), (0, 1, 0), swing))
    if chimney:
        disc = cylinder("z", [0, chimney_y, top + air], 1.8 * unit, 1.25 * r, segments=20)
        joint = hinge((1.25 * r, chimney_y, top + air), (0, 1, 0), 1.3)
        asm.add("cap", Shape().add(disc, dark), root, joint)
    if fire:
        z = center - 0.1 * radius + air
        plate = box(
            [-room, y[0] + (side > 0) * air, z], [room, y[1] - (side < 0) * air, z + 2 * unit]
        )
        x, middle, thin = -0.8 * room, (y[0] + y[1]) / 2, 0.8 * unit
        ends = [[x, middle + k, z + 5 * unit] for k in (-4 * unit, 4 * unit)]
        knob = pipe(ends, 1.2 * unit, 10)
        feet = [
            box([x - thin, at - thin, z + unit], [x + thin, at + thin, z + 5 * unit])
            for at in (middle - 3 * unit, middle + 3 * unit)
        ]
        shape = Shape().add(plate, face).add(tidy(union([knob, *feet]) - plate), steel)
        joint = hinge((room, 0, z), (0, 1, 0), float(rng.uniform(1.0, 1.5)))
        asm.add("fire_lid", shape, root, joint)
    elif rng.random() < 0.4:
        z, deep = center - 2 * unit, 1.5 * radius
        add_side_shelf(rng, asm, root, side * half, side, 0, z, 0.3, deep, unit, board)
    if rng.random() < 0.6:  # a shelf in front
        long, thick = float(rng.uniform(0.6, 1.1)) * radius, 2 * unit
        z = center - 2 * unit
        edge = -radius - air
        plate = box([edge - long, -0.9 * half, z - thick], [edge, 0.9 * half, z])
        down = -float(rng.uniform(1.2, 1.5))
        joint = hinge((edge, 0, z - thick), (0, 1, 0), down)
        asm.add("shelf", Shape().add(plate, board), root, joint)
    if rolling:
        for x in (-foot, foot):
            add_wheel(asm, root, (x, side * (w + leg), wheel), wheel, 3 * unit, side, steel)
    return asm.object()

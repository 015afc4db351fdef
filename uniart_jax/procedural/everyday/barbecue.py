"""Grills: kettle grills and ceramic eggs here, the other kinds in the ``barbecue_*`` modules."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.barbecue_barrel import barrel_grill
from uniart_jax.procedural.everyday.barbecue_brazier import brazier
from uniart_jax.procedural.everyday.barbecue_fittings import (
    add_side_shelf,
    add_wheel,
    draw_board,
    draw_finish,
    handle_across,
)
from uniart_jax.procedural.everyday.barbecue_gas import gas_grill
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    hinge,
    pipe,
    revolution,
    slide,
    tidy,
    tube,
    turn,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A grill in metres, closed, its controls at -x."""
    kinds = (_kettle_grill, gas_grill, barrel_grill, brazier)
    return kinds[rng.choice(4, p=[0.34, 0.34, 0.17, 0.15])](rng)


def _kettle_grill(rng: np.random.Generator) -> ArticulatedObject:
    """A round or egg-shaped grill on legs, wheels or the ground, with a lid, a vent, an ash pot and
    side shelves."""
    radius = float(rng.uniform(0.2, 0.3))
    egg = rng.random() < 0.3
    low_one = rng.random() < 0.2  # on a table or the ground
    bowl_high = radius * (float(rng.uniform(1.0, 1.5)) if egg else float(rng.uniform(0.6, 0.9)))
    lid_high = radius * (float(rng.uniform(0.9, 1.2)) if egg else float(rng.uniform(0.5, 0.85)))
    rim = bowl_high + radius * (
        float(rng.uniform(0.15, 0.4)) if low_one else float(rng.uniform(0.9, 1.7))
    )
    if egg and not low_one:
        rim = bowl_high + radius * float(rng.uniform(0.4, 0.8))
    unit = max(rim + lid_high, 2 * radius) / 100
    air, wall = 0.4 * unit, 1.6 * unit
    face, steel = draw_finish(rng), materials.metal(rng, brushed=False)
    lid_face = face if rng.random() < 0.75 else draw_finish(rng)
    dark, board = materials.dark(rng), draw_board(rng)
    asm, body = Assembly(), Shape()
    floor = 0.45 * radius if egg else 0.15 * radius
    shell, full = (
        m.mirror((0, 0, 1)) for m in _dome(radius, bowl_high, 0.0, wall, 0.7 if egg else 1.0, floor)
    )
    shell, full = shell.translate((0, 0, rim)), full.translate((0, 0, rim))
    grate = cylinder(
        "z", [0, 0, rim - 0.12 * bowl_high], 0.9 * unit, radius - 0.7 * wall, segments=28
    )
    bars = [
        box([-1, k * 0.16 * radius, -1], [1, k * 0.16 * radius + 0.08 * radius, 3])
        for k in range(-6, 6)
    ]
    inside = cylinder("z", [0, 0, 0], 3, 0.85 * radius, segments=24)
    bands = []
    lid_bands = []
    if egg or rng.random() < 0.4:  # a band round the rim
        t = 0.9 * unit
        bands.append(tube("z", [0, 0, rim - 4 * unit], 4 * unit, radius + t, 0.985 * radius))
        lid_bands.append(tube("z", [0, 0, rim + air], 3 * unit, radius + t, 0.97 * radius))
    lift = rng.random() < 0.35 and not egg
    back = radius + 2.5 * unit
    if not lift:
        w = 6 * unit
        bands.append(box([0.8 * radius, -w, rim - 4 * unit], [back, w, rim]))
        lid_bands.append(box([0.8 * radius, -w, rim + air], [back, w, rim + air + 3 * unit]))
    body.add(tidy(shell), face)
    body.add(tidy(cut(grate, [b ^ inside for b in bars]) - shell), steel)
    if bands:
        body.add(tidy(union(bands) - full), steel)
    wheels = _add_legs(rng, body, radius, rim, bowl_high, full, unit, low_one, steel, dark, egg)
    side = float(rng.choice([-1, 1]))
    shelves = [] if low_one or rng.random() < 0.4 else [side]
    shelves = [-1.0, 1.0] if egg and shelves else shelves
    y, z = radius + 3 * unit, rim - 3 * unit
    for s in shelves:
        lo, hi = sorted((s * 0.5 * radius, s * y))
        for x in (-0.3 * radius, 0.3 * radius):
            arm = box([x - 1.2 * unit, lo, z - 2.4 * unit], [x + 1.2 * unit, hi, z])
            body.add(tidy(arm - full - union(bands) if bands else arm - full), dark)
    root = asm.add("bowl", body)
    cap, solid = _dome(radius, lid_high, rim + air, wall, 0.85 if egg else 1.0, 0.2 * radius)
    lid = Shape().add(tidy(cap), lid_face)
    if lid_bands:
        lid.add(tidy(union(lid_bands) - solid), steel)
    top = rim + air + lid_high
    grip = board if rng.random() < 0.6 else dark
    in_front = not lift and rng.random() < 0.75
    if in_front:
        phi = float(rng.uniform(0.25, 0.7))
        x, z0 = -0.95 * radius * np.cos(phi), rim + air + 0.95 * lid_high * np.sin(phi)
        out = (-0.05 * radius - 6 * unit * np.cos(phi), 6 * unit * np.sin(phi))
        bow = handle_across(float(rng.uniform(0.2, 0.4)) * radius, x, z0, out, 1.5 * unit)
        lid.add(tidy(bow - solid), grip)
    else:
        bow = handle_across(
            float(rng.uniform(0.15, 0.3)) * radius, 0, top - 2 * unit, (0, 8 * unit), 1.5 * unit
        )
        lid.add(tidy(bow - solid), grip)
    joint = slide((0, 0, 1), float(rng.uniform(0.5, 1.2)) * radius)
    if not lift:
        joint = hinge((back, 0, rim + air), (0, 1, 0), float(np.deg2rad(rng.uniform(55, 90))))
    vent = None
    if in_front:  # a vent or a chimney's cap on the top
        r, tall = (0.3 * radius, 6 * unit) if egg else (0.22 * radius, 1.5 * unit)
        lid.add(cylinder("z", [0, 0, top], tall, 0.85 * r, segments=20), steel if egg else lid_face)
        disc = cylinder("z", [0, 0, top + tall + air], 2 * unit, r, segments=22)
        tab = box(
            [-1.5 * r, -1.3 * unit, top + tall + air],
            [-0.7 * r, 1.3 * unit, top + tall + air + 3 * unit],
        )
        vent = Shape().add(tidy(disc + tab), dark if rng.random() < 0.5 else steel)
    cover = asm.add("lid", lid, root, joint)
    if vent is not None:
        ends = turn((0, 0, top), (0, 0, 1))
        if egg and rng.random() < 0.5:
            ends = hinge((0.3 * radius, 0, top + 6 * unit + air), (0, 1, 0), 1.4)
        asm.add("vent", vent, cover, ends)
    for at, r, wide, s in wheels:
        add_wheel(asm, root, at, r, wide, s, steel if rng.random() < 0.5 else face)
    for s in shelves:
        long = min(float(rng.uniform(0.7, 1.2)) * radius, 0.7 * rim)
        deep = float(rng.uniform(0.8, 1.4)) * radius
        add_side_shelf(rng, asm, root, s * y, s, 0.0, z, long, deep, unit, board)
    return asm.object()


def _add_legs(
    rng, body, radius, rim, bowl_high, full, unit, low_one, steel, dark, egg
) -> list[tuple]:
    """Add three or four legs under a bowl; returns the wheels to add: (at, radius, width, side)."""
    r = float(rng.uniform(1.2, 1.9)) * unit
    finish = steel if rng.random() < 0.6 else dark
    foot = float(rng.uniform(0.75, 1.05)) * radius
    wheel = min(float(rng.uniform(0.2, 0.34)) * radius, 0.2 * rim)
    wheels, legs = [], []
    angles = [np.pi, np.pi / 3, -np.pi / 3]
    if egg or rng.random() < 0.3:
        angles = [0.75 * np.pi, -0.75 * np.pi, np.pi / 4, -np.pi / 4]
    rolling = not low_one and rng.random() < 0.75
    top = rim - 0.7 * bowl_high
    for a in angles:
        c, s = np.cos(a), np.sin(a)
        end = wheel if rolling and c > 0 else r
        legs.append(
            pipe([[0.5 * radius * c, 0.5 * radius * s, top], [foot * c, foot * s, end]], r, 10)
        )
    if rolling:
        x, y = foot * np.cos(angles[-1]), abs(foot * np.sin(angles[-1])) + r
        legs.append(cylinder("y", [x, -y, wheel], 2 * y, 0.8 * r, segments=12))
        wheels = [((x, s * y, wheel), wheel, 0.35 * wheel + unit, s) for s in (-1, 1)]
    if not low_one and rng.random() < 0.6:  # a rack or ring between the legs
        z = 0.35 * top
        share = 1 - z / top
        points = [
            [
                (0.5 * radius * (1 - share) + foot * share) * np.cos(a),
                (0.5 * radius * (1 - share) + foot * share) * np.sin(a),
                z,
            ]
            for a in sorted(angles)
        ]
        legs.append(pipe([*points, points[0]], 0.7 * r, 8))
    body.add(tidy(union(legs) - full), finish)
    if not low_one and not egg and rng.random() < 0.5:  # a pot for the ashes
        z = rim - bowl_high
        pot = cylinder("z", [0, 0, z - 7 * unit], 8 * unit, 0.3 * radius, 0.36 * radius, 24)
        body.add(tidy(cut(pot, [full, *legs])), steel)
    return wheels


def _dome(radius, high, low, wall, power, floor=0.0) -> tuple[Manifold, Manifold]:
    """A hollow dome about the z axis that rises from z = ``low``, and the same dome filled.
    ``floor`` is the radius of its flat top."""
    t = np.linspace(0, np.pi / 2, 11)
    r = np.maximum(radius * np.cos(t) ** power, floor)
    outer = np.column_stack([r, high * np.sin(t)])
    inner = outer * [1 - wall / radius, 1 - wall / high]
    full = revolution(np.vstack([outer, [[0, high], [0, 0]]]), "z", [0, 0, low], 32)
    hollow = revolution(
        np.vstack([inner, [[0, high - wall], [0, -0.01], [inner[0, 0], -0.01]]]),
        "z",
        [0, 0, low],
        32,
    )
    return full - hollow, full

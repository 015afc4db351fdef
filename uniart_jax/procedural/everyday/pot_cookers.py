"""Pressure cookers and slow cookers, in metres."""

from __future__ import annotations

import dataclasses

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday import vessel_fittings, vessels
from uniart_jax.procedural.everyday.pot_fittings import add_electric_lid, add_pair
from uniart_jax.procedural.everyday.vessel_finishes import contrast, draw_pot_finish, draw_pot_trim
from uniart_jax.procedural.everyday.vessel_fittings import dome
from uniart_jax.procedural.everyday.vessels import (
    frustum,
    half_width,
    radius_at,
    silhouette,
    stack,
    widest,
)
from uniart_jax.procedural.fronts import add_knob
from uniart_jax.procedural.materials import plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    ball,
    box,
    cylinder,
    extrusion,
    hinge,
    rounded,
    slide,
    tidy,
    turn,
    union,
)


def pressure_cooker(rng: np.random.Generator) -> ArticulatedObject:
    """A pressure cooker in metres: a deep pot whose lid turns to lock, handles one above the other,
    a valve."""
    radius = float(rng.uniform(0.1, 0.14))
    height = radius * float(rng.uniform(0.8, 1.9))
    unit = max(2.6 * radius, height) / 100
    air, wall = 0.5 * unit, 2.0 * unit
    outline = vessels.ring(36)
    face = materials.metal(rng, brushed=False) if rng.random() < 0.7 else draw_pot_finish(rng)
    trim = materials.dark(rng) if rng.random() < 0.7 else draw_pot_trim(rng, face)
    belly = radius * float(rng.choice([1.0, 1.08]))
    profile = silhouette(radius, belly, radius, 0.4, 0.0, height, 0.1 * radius)
    solid = stack(profile, outline)
    hollow = vessels.room(profile, outline, wall)

    asm, body, lid = Assembly(), Shape(), Shape()
    body.add(tidy(solid - hollow), face)
    low = height + air
    skirt, rise = float(rng.uniform(3, 7)) * unit, radius * float(rng.uniform(0.12, 0.3))
    wide = radius + 2.2 * unit
    cover = dome(outline, wide, low - skirt, rise + skirt, skirt + unit)
    room = widest(profile, np.linspace(low - skirt, height, 5)) + air
    cover = tidy(cover - frustum(outline, room, room, low - skirt - 1, low))
    lid.add(cover, face if rng.random() < 0.75 else draw_pot_finish(rng))
    long, half = float(rng.uniform(0.9, 1.5)) * radius, float(rng.uniform(4, 6)) * unit
    thick = float(rng.uniform(4, 6)) * unit
    ends = (0.0, np.pi) if rng.random() < 0.35 else (0.0,)
    if len(ends) == 2:
        long = 0.4 * radius
    z = low - skirt - 1.2 * unit
    lower = rounded(2 * long, 2 * half, 0.8 * half)
    flat = float(rng.uniform(0.9, 1.1)) * half
    for angle in ends:
        turned = (0, 0, np.rad2deg(angle))
        at = [wide + 0.2 * unit, 0, z - 1.3 * thick]
        bar = extrusion(lower, "z", at, 1.3 * thick).rotate(turned)
        body.add(tidy(bar - solid), trim)
        upper = rounded(2 * long, 2 * flat, 0.8 * flat)
        bar = extrusion(upper, "z", [wide, 0, z + 0.6 * unit], skirt + thick).rotate(turned)
        core = frustum(outline, room, room, z - 1, low)
        lid.add(tidy(bar - cover - core), trim)
    if len(ends) == 1 and rng.random() < 0.7:
        loop = rounded(0.7 * radius, 2 * half, half)
        ear = extrusion(loop, "z", [-radius, 0, z - 1.5 * thick], thick)
        body.add(tidy(ear - solid), dataclasses.replace(trim))
    root = asm.add("body", body)
    way = float(rng.choice([-1, 1])) * float(np.deg2rad(rng.uniform(25, 60)))
    top = low + rise
    post = float(rng.choice([0.0, rng.uniform(0.1, 0.4)])) * radius
    stem = cylinder("z", [0, 0, top - 0.6 * unit], 3 * unit, 3.5 * unit, segments=18)
    lid.add(tidy(stem - cover), dataclasses.replace(trim))
    cap = asm.add("lid", lid, root, hinge((0, 0, low), (0, 0, 1), way))
    seat = top + 2.4 * unit
    kind = str(rng.choice(["weight", "lever", "dial"], p=[0.35, 0.4, 0.25]))
    tone = materials.hardware(rng) if rng.random() < 0.5 else plain(
        materials.hsv(rng, (0, 1), (0.6, 1), (0.4, 0.9)))  # fmt: skip
    if kind == "lever":  # it lies across the valve and tips up
        x, r = 3.8 * unit, 1.5 * unit
        bar = box([-12 * unit - post, -2 * unit, seat + unit], [x, 2 * unit, seat + 3 * unit])
        bar += cylinder("y", [x, -2.5 * unit, seat + 2 * unit], 5 * unit, r, segments=14)
        bar += ball([-11 * unit - post, 0, seat + 2 * unit], 2.6 * unit, 14)
        joint = hinge((x, 0, seat + 2 * unit), (0, 1, 0), float(rng.uniform(0.5, 1.5)))
        asm.add("valve_lever", Shape().add(tidy(bar), tone), cap, joint)
    elif kind == "weight":
        size = float(rng.uniform(3, 5)) * unit
        drum = cylinder("z", [0, 0, seat + 0.5 * unit], 1.8 * size, size, 0.85 * size, 20)
        drum += cylinder("z", [0, 0, seat + 1.7 * size], 0.8 * size, 0.6 * size, segments=14)
        asm.add("weight", Shape().add(tidy(drum), tone), cap, slide((0, 0, 1), 2 * size))
    else:
        at = [0, 0, seat + 0.5 * unit]
        dial = vessel_fittings.knob(rng, at, float(rng.uniform(3.5, 5.5)) * unit, turning=True)
        joint = turn(at, (0, 0, 1)) if rng.random() < 0.4 else hinge(at, (0, 0, 1), 2.2)
        asm.add("valve", Shape().add(dial, tone), cap, joint)
    return asm.object()


def slow_cooker(rng: np.random.Generator) -> ArticulatedObject:
    """A slow cooker in metres: a round, oval or squared case, a lid that is hinged or lifts off, a
    dial or buttons in front."""
    radius = float(rng.uniform(0.1, 0.15))
    power = float(rng.choice([2.0, rng.uniform(2.5, 5)]))
    outline = vessels.ring(36, float(rng.uniform(1.0, 1.45)), power)
    across = half_width(outline) * radius
    height = radius * float(rng.uniform(0.9, 1.7))
    unit = max(2 * across, height) / 100
    air, wall, legs = 0.5 * unit, 3.0 * unit, float(rng.uniform(1.5, 4)) * unit
    face, trim = draw_pot_finish(rng), materials.dark(rng)
    if rng.random() < 0.3:
        trim = materials.white_plastic(rng)
    top, high = radius * float(rng.uniform(0.9, 1.05)), legs + height
    profile = silhouette(0.93 * radius, max(radius, top), top, 0.6, legs, high, 0.1 * radius)
    solid = stack(profile, outline)

    asm, body = Assembly(), Shape()
    body.add(solid - vessels.room(profile, outline, wall), face)
    pot = frustum(outline, 0.55 * radius, 0.6 * radius, legs + wall + unit, legs + 2.5 * wall)
    body.add(pot, materials.dark(rng))
    feet = [frustum(outline, 0.7 * radius, 0.75 * radius, 0, legs)]
    body.add(union(feet), trim)
    panel_x = -max(radius, top) - 1.5 * unit
    half, z0 = 0.55 * across, legs + float(rng.uniform(0.12, 0.2)) * height
    z1 = z0 + float(rng.uniform(0.32, 0.45)) * height
    plate = box([panel_x, -half, z0], [-0.5 * radius, half, z1])
    body.add(tidy(plate - solid), trim)
    hinged = rng.random() < 0.6
    if rng.random() < 0.6 or not hinged:
        reach = across * radius_at(profile, z1) / radius
        add_pair(rng, body, solid, reach, legs + 0.75 * height, unit, dataclasses.replace(trim))
    root = asm.add("body", body)
    low = high + air
    add_electric_lid(rng, asm, root, outline, top, wall, low, unit, hinged, face, trim)
    middle = (z0 + z1) / 2
    tone = materials.hardware(rng) if rng.random() < 0.6 else face
    mark = contrast(tone)
    kind = str(rng.choice(["dial", "two", "lever"], p=[0.5, 0.2, 0.3]))
    if kind == "lever":
        r, y = 1.6 * unit, 0.0
        at = [panel_x - r - 0.5 * unit, y, middle + 2 * unit]
        key = cylinder("y", [at[0], y - 5 * unit, at[2]], 10 * unit, r, segments=14)
        key += box([at[0] - 9 * unit, -5 * unit, at[2] - r], [at[0], 5 * unit, at[2] + 0.3 * unit])
        joint = hinge(at, (0, -1, 0), float(rng.uniform(0.3, 0.6)))
        asm.add("switch", Shape().add(tidy(key), tone), root, joint)
    else:
        size = min(0.4 * (z1 - z0), 0.35 * half)
        sweep = None if rng.random() < 0.4 else float(np.deg2rad(rng.choice([120, 180, 270])))
        for y in (0.0,) if kind == "dial" else (-0.5 * half, 0.5 * half):
            at = (panel_x, y, middle)
            add_knob(asm, root, at, size, size, tone, mark, sweep, skirt=rng.random() < 0.4)
    return asm.object()

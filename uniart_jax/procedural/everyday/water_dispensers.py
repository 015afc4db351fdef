"""Water dispensers: barrels and boxes with taps, and coolers that stand on the floor."""

from __future__ import annotations

import dataclasses

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday import vessel_fittings, vessels
from uniart_jax.procedural.everyday.vessel_finishes import (
    clear,
    draw_dispenser_accent,
    draw_dispenser_plastic,
)
from uniart_jax.procedural.everyday.vessel_fittings import dome
from uniart_jax.procedural.everyday.vessels import frustum, half_width, stack
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cylinder,
    extrusion,
    hinge,
    revolution,
    rounded,
    slide,
    tidy,
    union,
)


def _tap(
    rng, asm: Assembly, body: Shape, ground: Manifold, at, unit: float, tone, metal, one: bool
):
    """Add a tap's spigot on the plane x = ``at[0]`` to ``body``; returns a function that adds its
    lever to a parent part."""
    x, y, z = at
    r, reach = 2.4 * unit, float(rng.uniform(7, 10)) * unit
    spigot = cylinder("x", [x - reach, y, z], reach + 3 * unit, r, segments=16)
    spigot += cylinder("z", [x - reach, y, z - 6 * unit], 6 * unit + r, 1.2 * r, segments=16)
    body.add(tidy(spigot - ground), metal)
    top = z + r + 0.4 * unit
    if not one or rng.random() < 0.6:  # pressed down or pulled
        long, wide = float(rng.uniform(8, 12)) * unit, float(rng.uniform(2.3, 3.2)) * unit
        pivot = [x - reach + r, y, top + 1.6 * unit]
        key = box([pivot[0] - long, y - wide, top + 0.9 * unit],
                  [pivot[0], y + wide, top + 2.6 * unit])  # fmt: skip
        key += cylinder("y", [pivot[0], y - wide, pivot[2]], 2 * wide, 1.5 * unit, segments=12)
        up = float(rng.uniform(0.35, 0.75))
        joint = hinge(pivot, (0, 1, 0), up)
    else:  # turned by a quarter about its stem
        key = cylinder("z", [x - reach, y, top], 4 * unit, 0.9 * r, segments=14)
        key += box([x - reach - 8 * unit, y - 1.2 * unit, top + 2 * unit],
                   [x - reach + 4 * unit, y + 1.2 * unit, top + 5 * unit])  # fmt: skip
        joint = hinge((x - reach, y, 0), (0, 0, 1), float(rng.choice([-1.5, 1.5])))
    shape = Shape().add(tidy(key), tone)
    return lambda root: asm.add("tap_lever", shape, root, joint)


def water(rng: np.random.Generator) -> ArticulatedObject:
    """A water dispenser in metres: a barrel or box with taps on a table, or a cooler on the
    floor."""
    if rng.random() < 0.45:
        return _cooler(rng)
    height = float(rng.uniform(0.25, 0.45))
    unit = height / 100
    radius = height * float(rng.uniform(0.28, 0.45))
    round_ = rng.random() < 0.6
    power = 2.0 if round_ else float(rng.uniform(4, 8))
    outline = vessels.ring(36, 1.0 if round_ else float(rng.uniform(0.8, 1.4)), power)
    face, metal, tone = (
        draw_dispenser_plastic(rng),
        materials.hardware(rng),
        draw_dispenser_accent(rng),
    )
    face = clear(rng) if rng.random() < 0.4 else face
    legs = float(rng.uniform(12, 45)) * unit
    belly = radius * float(rng.choice([1.0, rng.uniform(1.0, 1.2)]))
    profile = vessels.silhouette(radius, belly, radius * float(rng.uniform(0.8, 1.0)), 0.45,
                                 legs, legs + height)  # fmt: skip
    solid = stack(profile, outline)
    asm, body = Assembly(), Shape()
    body.add(tidy(solid - vessels.room(profile, outline, 2.5 * unit)), face)
    if rng.random() < 0.5:  # on legs or a plinth
        r = 2.4 * unit
        across = 0.7 * radius * half_width(outline)
        posts = [cylinder("z", [x, y, 0], legs, r, segments=12)
                 for x in (-0.65 * radius, 0.65 * radius) for y in (-across, across)]  # fmt: skip
    else:
        posts = [frustum(outline, 0.95 * radius, 0.8 * radius, 0, legs)]
    body.add(union(posts), metal if rng.random() < 0.5 else materials.wood(rng, textured=False))
    z = legs + float(rng.uniform(0.1, 0.2)) * height
    x = -vessels.radius_at(profile, z)
    ys = [0.0] if round_ or rng.random() < 0.5 else [-0.4 * radius, 0.4 * radius]
    taps = [_tap(rng, asm, body, solid, (x, y, z), 1.25 * unit, tone, metal, round_) for y in ys]
    root = asm.add("body", body)
    for tap in taps:
        tap(root)
    top, low = profile[-1, 0], legs + height + 0.5 * unit
    rise = float(rng.uniform(0.06, 0.25)) * radius
    lid = dome(outline, 1.02 * top, low, rise, 0.5 * rise)
    plug = 0.92 * (top - 2.5 * unit)
    lid += frustum(outline, 0.97 * plug, plug, low - 3 * unit, low + 0.5 * unit)
    bud = vessel_fittings.knob(
        rng, [0, 0, low + 0.95 * rise], float(rng.uniform(0.1, 0.16)) * radius
    )
    shape = Shape().add(tidy(lid), tone if rng.random() < 0.4 else dataclasses.replace(metal))
    shape.add(tidy(bud - lid), materials.dark(rng))
    joint = slide((0, 0, 1), float(rng.uniform(0.2, 0.6)) * height)
    if rng.random() < 0.3:
        joint = hinge((1.02 * top, 0, low), (0, 1, 0), float(rng.uniform(0.8, 1.5)))
    asm.add("lid", shape, root, joint)
    return asm.object()


def _cooler(rng: np.random.Generator) -> ArticulatedObject:
    """A cooler on the floor: taps in a niche, a door below, a drip tray, a tank that lifts off."""
    height = float(rng.uniform(0.8, 1.1))
    half, depth = float(rng.uniform(0.13, 0.18)), float(rng.uniform(0.28, 0.36))
    unit = height / 100
    face, tone, metal = (
        draw_dispenser_plastic(rng),
        draw_dispenser_accent(rng),
        materials.hardware(rng),
    )
    low, high = height * float(rng.uniform(0.5, 0.6)), height * float(rng.uniform(0.84, 0.92))
    niche = depth * float(rng.uniform(0.3, 0.45))
    wall = 2 * unit
    case = extrusion(rounded(2 * half, height, float(rng.uniform(0.2, 4)) * unit), "x",
                     [0, 0, height / 2], depth)  # fmt: skip
    case -= box([-1, -half + wall, low], [niche, half - wall, high])
    door_lo = np.array([0, -half + wall, 4 * unit])
    door_hi = np.array([2 * unit, half - wall, low - 4 * unit])
    case -= box(
        door_lo - [1, 0.4 * unit, 0.4 * unit], door_hi + [depth * 0.6, 0.4 * unit, 0.4 * unit]
    )
    asm, body = Assembly(), Shape()
    body.add(tidy(case), face)
    count = int(rng.choice([1, 2, 3], p=[0.2, 0.5, 0.3]))
    ys = (np.arange(count) - (count - 1) / 2) * 0.5 * half
    taps = [_tap(rng, asm, body, case, (niche, y, high - 15 * unit), 1.0 * unit,
                 draw_dispenser_accent(rng), metal, count == 1) for y in ys]  # fmt: skip
    root = asm.add("body", body)
    for tap in taps:
        tap(root)
    door = box(door_lo, door_hi) + box([-1.2 * unit, 0.5 * half, door_hi[2] - 12 * unit],
                                       [0.001, 0.6 * half, door_hi[2] - 3 * unit])  # fmt: skip
    joint = hinge((0, door_lo[1], 0), (0, 0, 1), float(rng.uniform(1.0, 1.8)))
    finish = dataclasses.replace(face) if rng.random() < 0.6 else tone
    asm.add("door", Shape().add(tidy(door), finish), root, joint)
    if rng.random() < 0.7:
        lo = [-2 * unit, -0.75 * half, low + 0.3 * unit]
        hi = [niche - unit, 0.75 * half, low + 3 * unit]
        tray = box(lo, hi) - box(np.array(lo) + 0.8 * unit, np.array(hi) + [-unit, -unit, 1])
        shape = Shape().add(tidy(tray), materials.dark(rng))
        asm.add("drip_tray", shape, root, slide((-1, 0, 0), 0.8 * niche))
    if rng.random() < 0.65:
        r, tall = 0.85 * half, float(rng.uniform(0.25, 0.4))
        z = height + 0.4 * unit
        rim = [[0, z], [0.45 * r, z], [0.5 * r, z + 0.1 * tall], [r, z + 0.28 * tall],
               [r, z + 0.6 * tall], [0.94 * r, z + 0.64 * tall], [r, z + 0.68 * tall],
               [r, z + 0.97 * tall], [0.9 * r, z + tall], [0, z + tall]]  # fmt: skip
        tank = revolution(np.array(rim), "z", [depth / 2, 0, 0], 28)
        asm.add("tank", Shape().add(tank, clear(rng)), root, slide((0, 0, 1), 0.6 * tall))
    return asm.object()

"""Braziers: an open pan on legs under a grate that swings or slides."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.barbecue_fittings import draw_finish, grate_slots, handle_across
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    hinge,
    pipe,
    slide,
    tidy,
    tube,
    union,
)


def brazier(rng: np.random.Generator) -> ArticulatedObject:
    """A brazier in metres: an open pan on legs. Its grate swings out on a post or slides up and
    down; some have an ash drawer."""
    half = float(rng.uniform(0.16, 0.34))
    deep = half * float(rng.uniform(0.6, 1.0))
    tall = float(rng.uniform(0.12, 0.25)) if rng.random() < 0.4 else float(rng.uniform(0.45, 0.75))
    pan = float(rng.uniform(0.1, 0.18))
    top = tall + pan
    unit = max(2 * half, top + 0.25) / 100
    air, wall = 0.4 * unit, 1.5 * unit
    face, dark = draw_finish(rng), materials.dark(rng)
    steel = materials.metal(rng, brushed=False)
    grip = materials.wood(rng, textured=False) if rng.random() < 0.5 else dark
    round_one = rng.random() < 0.45
    asm, body = Assembly(), Shape()
    drawer = not round_one and rng.random() < 0.6
    if round_one:
        deep = half
        solid = cylinder("z", [0, 0, tall], pan, 0.75 * half, half, 32)
        solid -= cylinder("z", [0, 0, tall + wall], pan, 0.75 * half - wall, half - wall, 32)
    else:
        solid = box([-deep, -half, tall], [deep, half, top]) - box(
            [-deep + wall, -half + wall, tall + 0.5 * pan], [deep - wall, half - wall, 9]
        )
    lo, hi = [-deep, -0.8 * half, tall + 0.08 * pan], [0.7 * deep, 0.8 * half, tall + 0.42 * pan]
    if drawer:
        solid -= box(np.subtract(lo, [1, air, air]), np.add(hi, air))
    body.add(tidy(solid), face)
    r = 1.5 * unit
    spots = [
        (0.7 * half * np.cos(a), 0.7 * half * np.sin(a)) for a in (np.pi, np.pi / 3, -np.pi / 3)
    ]
    if not round_one:
        spots = [(x * (deep - r), y * (half - r)) for x in (-1, 1) for y in (-1, 1)]
    spread = float(rng.uniform(1.0, 1.25))
    legs = [pipe([[x, y, tall + r], [spread * x, spread * y, r]], r, 10) for x, y in spots]
    whole = (
        cylinder("z", [0, 0, tall], pan, 0.75 * half, half, 32)
        if round_one
        else box([-deep, -half, tall], [deep, half, top])
    )
    if rng.random() < 0.5:
        legs.append(
            pipe([*([a, b, 0.4 * tall] for a, b in spots), [*spots[0], 0.4 * tall]], 0.7 * r, 8)
            if round_one
            else box([-deep, -half, 0.3 * tall], [deep, half, 0.3 * tall + unit])
        )
    swings = rng.random() < 0.6
    side = float(rng.choice([-1, 1]))
    post_at = [deep + 2.2 * unit, side * 0.6 * half] if not round_one else [half + 2.2 * unit, 0.0]
    high = top + float(rng.uniform(0.12, 0.3))
    post = cylinder(
        "z", [*post_at, tall + 0.5 * pan], high - tall - 0.5 * pan, 1.3 * unit, segments=14
    )
    foot = box(
        [0.5 * deep, post_at[1] - 1.6 * unit, tall + 0.5 * pan],
        [post_at[0] + 1.6 * unit, post_at[1] + 1.6 * unit, tall + 0.5 * pan + 3 * unit],
    )
    body.add(tidy(union([*legs, post, foot]) - whole), dark if rng.random() < 0.6 else steel)
    root = asm.add("pan", body)
    z = top + float(rng.uniform(1, 6)) * unit
    sleeve = tube("z", [*post_at, z], 5 * unit, 2.6 * unit, 1.3 * unit + air)
    size = 0.95 * deep if not round_one else 0.9 * half
    if round_one:
        plate = cylinder("z", [0, 0, z], 1.6 * unit, size, segments=30)
        inside = cylinder("z", [0, 0, 0], 9, 0.88 * size, segments=26)
    else:
        plate = box([-size, -0.92 * half, z], [size, 0.92 * half, z + 1.6 * unit])
        inside = box([-0.9 * size, -0.85 * half, 0], [0.9 * size, 0.85 * half, 9])
    holes = [slot ^ inside for slot in grate_slots(-1, 1, half, 9, share=0.75, top=9)]
    arm = box(
        [0.8 * size, post_at[1] - 1.3 * unit, z],
        [post_at[0] - 1.8 * unit, post_at[1] + 1.3 * unit, z + 2.4 * unit],
    )
    hook = pipe(
        [[-0.97 * size, 0, z + 0.8 * unit], [-1.35 * size, 0, z + 3 * unit]], 1.2 * unit, 10
    )
    whole_plate = union([cut(plate, holes), sleeve, arm])
    shape = Shape().add(tidy(whole_plate), steel).add(tidy(hook - whole_plate), grip)
    if swings:
        joint = hinge((*post_at, 0), (0, 0, -side), float(np.deg2rad(rng.uniform(70, 140))))
    else:
        joint = slide((0, 0, 1), 0.85 * (high - z - 5 * unit))
    asm.add("grate", shape, root, joint)
    if drawer:
        shell = box(lo, hi) - box(np.add(lo, wall), np.add(hi, [-wall, -wall, 1]))
        bow = handle_across(
            0.3 * half, lo[0] + 0.5 * wall, (lo[2] + hi[2]) / 2, (-4 * unit, 0), 1.1 * unit
        )
        joint = slide((-1, 0, 0), float(rng.uniform(0.5, 0.9)) * (hi[0] - lo[0]))
        shape = Shape().add(shell, face.darker(0.8)).add(tidy(bow - box(lo, hi)), grip)
        asm.add("ash_drawer", shape, root, joint)
    return asm.object()

"""Letter boxes of one household: on a wall or a post, with a flag, or with a lid. The family's
other kinds are in ``large_letter_boxes`` and ``small_cases``."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.case_fronts import (
    add_panel,
    add_posts,
    add_pull,
    arch,
    doorway,
    draw_finish,
    inner_outline,
    roofed_case,
)
from uniart_jax.procedural.everyday.large_letter_boxes import bank_of_boxes, parcel_box, pillar_box
from uniart_jax.procedural.everyday.small_cases import bird_house, bread_box, key_cabinet
from uniart_jax.procedural.materials import hsv, plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    extrusion,
    hinge,
    rotated,
    tidy,
    tube,
    union,
)

KINDS = ("wall", "flagged", "lidded", "pillar", "parcel", "bird", "bread", "keys", "bank")


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A letter box, bird house, bread box or key cabinet in metres, closed."""
    kind = rng.choice(len(KINDS), p=[0.2, 0.12, 0.1, 0.08, 0.12, 0.12, 0.1, 0.08, 0.08])
    makers = (
        _wall,
        _flagged,
        _lidded,
        pillar_box,
        parcel_box,
        bird_house,
        bread_box,
        key_cabinet,
        bank_of_boxes,
    )
    return makers[kind](rng).object()


def _wall(rng) -> Assembly:
    """A case with a flap over its slot and a door below, or a flap in the door."""
    wide = float(rng.uniform(0.22, 0.44))
    high, deep = wide * float(rng.uniform(0.7, 1.6)), wide * float(rng.uniform(0.3, 0.7))
    on_post = rng.random() < 0.35
    base = float(rng.uniform(0.6, 1.5)) * high if on_post else 0.0
    unit, wall = max(high + base, wide) / 100, max(0.02 * high, 0.006)
    face, metal = draw_finish(rng), materials.hardware(rng)
    second = face if rng.random() < 0.5 else draw_finish(rng)
    solid, low, _ = roofed_case(rng, wide, deep, high, wall, base)
    half = 0.5 * wide * float(rng.uniform(0.78, 0.96))
    asm, body = Assembly(), Shape()
    tall = max(low * float(rng.uniform(0.12, 0.2)), 3.5 * unit)
    flap = (-half, half, base + 0.95 * low - tall, base + 0.95 * low)
    door = (-half, half, base + 0.06 * low, flap[2] - 1.2 * unit)
    nested = rng.random() < 0.3
    if nested:
        door = (-half, half, base + 0.06 * low, base + 0.95 * low)
        flap = (-0.8 * half, 0.8 * half, base + 0.88 * low - tall, base + 0.88 * low)
    inset = max(1.2 * unit, 0.004)
    holes = [doorway(s, inset, wall + 0.01) for s in ((door,) if nested else (flap, door))]
    body.add(tidy(cut(solid, holes)), face)
    if on_post:
        add_posts(rng, body, wide, deep, base, unit)
    elif rng.random() < 0.35:  # a holder for newspapers below
        r = float(rng.uniform(0.16, 0.26)) * wide
        paper = tube("x", [0, 0, -r + 0.1 * wall], deep, r, r - wall) - box([-1, -1, 0], [2, 1, 1])
        body.add(paper, second)
    root = asm.add("body", body)
    side = str(rng.choice(["left", "right", "bottom"], p=[0.4, 0.4, 0.2]))
    thick = float(rng.uniform(1.0, 2.2)) * unit
    held = add_panel(
        rng,
        asm,
        root,
        "door",
        side,
        door,
        unit,
        second,
        metal,
        pull=not nested or side != "bottom",
        swing=(70, 100) if side == "bottom" else (80, 150),
        thick=thick,
        marked=not nested,
    )
    over = face if rng.random() < 0.4 else (metal if rng.random() < 0.5 else draw_finish(rng))
    x = -0.3 * unit - thick if nested else 0.0
    add_panel(
        rng,
        asm,
        held if nested else root,
        "flap",
        "top",
        flap,
        unit,
        over,
        metal,
        x=x,
        swing=(50, 100),
        pull=rng.random() < 0.3,
    )
    return asm


def _flagged(rng) -> Assembly:
    """A vaulted case along x on a post, its front door hinged below, a flag at its side."""
    deep = float(rng.uniform(0.38, 0.56))
    wide, high = deep * float(rng.uniform(0.35, 0.5)), deep * float(rng.uniform(0.42, 0.6))
    base = deep * float(rng.choice([0.0, rng.uniform(0.8, 1.8)], p=[0.4, 0.6]))
    unit, half = max(deep, high + base) / 100, wide / 2
    wall = max(1.2 * unit, 0.005)
    face, metal = draw_finish(rng), materials.hardware(rng)
    rise = half if rng.random() < 0.75 else 0.5 * half
    outline = arch(half, high - rise, rise, 15)
    inner = inner_outline(outline, wide, high, wall)
    asm, body = Assembly(), Shape()
    body.add(
        extrusion(outline, "x", [0, 0, base], deep)
        - extrusion(inner, "x", [-1, 0, base], 1 + deep - wall),
        face,
    )
    if base:
        add_posts(rng, body, wide, deep, base, unit)
    sense = int(rng.choice([-1, 1]))
    x, z = deep * float(rng.uniform(0.15, 0.5)), base + high * float(rng.uniform(0.4, 0.6))
    y = sense * half
    lo, hi = sorted((y, y + sense * 1.0 * unit))
    body.add(cylinder("y", [x, lo, z], hi - lo, 1.6 * unit, segments=14), metal)
    root = asm.add("body", body)
    shape = Shape()
    plate = extrusion(outline, "x", [-0.3 * unit - 1.4 * unit, 0, base], 1.4 * unit)
    shape.add(plate, face if rng.random() < 0.6 else draw_finish(rng))
    add_pull(rng, shape, "bottom", -1.7 * unit, (-half, half, base, base + high), unit, metal)
    joint = hinge((-1.7 * unit, 0, base), (0, -1, 0), float(np.deg2rad(rng.uniform(80, 110))))
    asm.add("door", shape, root, joint)
    long, w = high * float(rng.uniform(0.6, 0.95)), float(rng.uniform(0.9, 1.5)) * unit
    out = sorted((y + sense * 1.3 * unit, y + sense * 2.7 * unit))
    pad = float(rng.uniform(2.4, 4)) * unit
    up = rng.random() < 0.35
    arm = union(
        [
            box([x - 1.8 * unit, out[0], z - w], [x + long, out[1], z + w]),
            box([x + 0.62 * long, out[0], z - w], [x + long, out[1], z + w + pad]),
        ]
    )
    at = np.array([x, 0, z])
    if up:  # it stands and is laid down towards the rear
        arm = rotated(arm, (0, -90, 0), at)
    red = (
        plain(hsv(rng, (0.97, 1.06), (0.75, 0.95), (0.6, 0.9)))
        if rng.random() < 0.75
        else draw_finish(rng)
    )
    joint = hinge(at, (0, 1 if up else -1, 0), np.pi / 2)
    asm.add("flag", Shape().add(arm, red), root, joint)
    return asm


def _lidded(rng) -> Assembly:
    """A case that is open at the top, under a slanting or level lid hinged at the rear; a door
    below."""
    wide = float(rng.uniform(0.22, 0.42))
    high, deep = wide * float(rng.uniform(0.6, 1.4)), wide * float(rng.uniform(0.28, 0.6))
    unit, wall, half = max(wide, high) / 100, max(0.012 * wide, 0.005), wide / 2
    face, metal = draw_finish(rng), materials.hardware(rng)
    drop = deep * float(rng.choice([0.0, 0.3, 0.6]))
    poly = np.array([[0, 0], [high - drop, 0], [high, deep], [0, deep]])
    inner = np.array([[wall, wall], [2 * high, wall], [2 * high, deep - wall], [wall, deep - wall]])
    solid = extrusion(poly, "y", [0, -half, 0], wide)
    solid -= extrusion(inner, "y", [0, wall - half, 0], wide - 2 * wall)
    asm, body = Assembly(), Shape()
    door = None
    if rng.random() < 0.5:
        top = float(rng.uniform(0.45, 0.62)) * (high - drop)
        door = (-0.8 * half, 0.8 * half, 0.08 * high, top)
        solid -= doorway(door, unit, 2 * wall)
    else:  # peepholes
        count, r = int(rng.integers(1, 5)), float(rng.uniform(1.3, 2.2)) * unit
        for k in range(count):
            y = (k - (count - 1) / 2) * 7 * unit
            solid -= cylinder("x", [-1, y, 0.3 * high], 1.02, r, segments=12)
    body.add(tidy(solid), face)
    root = asm.add("body", body)
    over, thick = float(rng.uniform(1, 4)) * unit, float(rng.uniform(1.2, 3)) * unit
    slope = np.array([-drop, -deep]) / np.hypot(drop, deep)  # (z, x), towards the front
    up = np.array([-slope[1], slope[0]])
    back = np.array([high, deep]) + 0.3 * unit * up
    front = back + slope * (np.hypot(drop, deep) + over)
    lid = np.array([back, front, front + thick * up, back + thick * up])
    shape = Shape().add(
        extrusion(lid, "y", [0, -half - 0.5 * over, 0], wide + over),
        face if rng.random() < 0.5 else draw_finish(rng),
    )
    joint = hinge((back[1], 0, back[0]), (0, 1, 0), float(np.deg2rad(rng.uniform(55, 105))))
    asm.add("lid", shape, root, joint)
    if door is not None:
        side = str(rng.choice(["left", "right", "bottom"]))
        add_panel(rng, asm, root, "door", side, door, unit, face, metal, marked=True)
    return asm

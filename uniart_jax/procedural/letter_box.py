"""Letter boxes, parcel boxes, bird houses, bread boxes and key cabinets: flaps over slots, doors,
lids, a roll top, a flag that is turned up."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.case_fronts import (
    add_panel,
    add_posts,
    add_pull,
    draw_paint,
    open_at,
    roofed_case,
)
from uniart_jax.procedural.materials import hsv, plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    extrusion,
    hinge,
    tidy,
    tube,
    union,
)
from uniart_jax.procedural.small_cases import bird_house, bread_box, key_cabinet

KINDS = ("wall", "flagged", "lidded", "pillar", "parcel", "bird", "bread", "keys", "bank")


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A letter box or its like, metres, closed."""
    kind = rng.choice(len(KINDS), p=[0.2, 0.12, 0.1, 0.08, 0.12, 0.12, 0.1, 0.08, 0.08])
    makers = (_wall, _flagged, _lidded, _pillar, _parcel, bird_house, bread_box, key_cabinet, _bank)
    return makers[kind](rng).object()


def _wall(rng) -> Assembly:
    """A case with a flap over its slot and a door below, or a flap in the door."""
    wide = float(rng.uniform(0.22, 0.44))
    high, deep = wide * float(rng.uniform(0.7, 1.6)), wide * float(rng.uniform(0.3, 0.7))
    on_post = rng.random() < 0.35
    base = float(rng.uniform(0.6, 1.5)) * high if on_post else 0.0
    unit, wall = max(high + base, wide) / 100, max(0.02 * high, 0.006)
    face, metal = draw_paint(rng), materials.hardware(rng)
    second = face if rng.random() < 0.5 else draw_paint(rng)
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
    holes = [
        box([-1, s[0] + inset, s[2] + inset], [wall + 0.01, s[1] - inset, s[3] - inset])
        for s in ((door,) if nested else (flap, door))
    ]
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
    marked = {"marked": True, "thick": thick}
    way = (70, 100) if side == "bottom" else (80, 150)
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
        swing=way,
        **(marked if not nested else {"thick": thick}),
    )
    over = face if rng.random() < 0.4 else (metal if rng.random() < 0.5 else draw_paint(rng))
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
    """A vaulted case along x, its door in front hinged below, a flag at its side, on a post."""
    deep = float(rng.uniform(0.38, 0.56))
    wide, high = deep * float(rng.uniform(0.35, 0.5)), deep * float(rng.uniform(0.42, 0.6))
    base = deep * float(rng.choice([0.0, rng.uniform(0.8, 1.8)], p=[0.4, 0.6]))
    unit, half = max(deep, high + base) / 100, wide / 2
    wall = max(1.2 * unit, 0.005)
    face, metal = draw_paint(rng), materials.hardware(rng)
    t = np.linspace(0, np.pi, 15)
    rise = half if rng.random() < 0.75 else 0.5 * half
    top = np.column_stack([half * np.cos(t), high - rise + rise * np.sin(t)])
    outline = np.vstack([[[-half, 0], [half, 0]], top])
    middle = np.array([0, high / 2])
    inner = middle + (outline - middle) * [1 - 2 * wall / wide, 1 - 2 * wall / high]
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
    shape.add(plate, face if rng.random() < 0.6 else draw_paint(rng))
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
        arm = arm.translate(tuple(-at)).rotate((0, -90, 0)).translate(tuple(at))
    red = (
        plain(hsv(rng, (0.97, 1.06), (0.75, 0.95), (0.6, 0.9)))
        if rng.random() < 0.75
        else draw_paint(rng)
    )
    joint = hinge(at, (0, 1 if up else -1, 0), np.pi / 2)
    asm.add("flag", Shape().add(arm, red), root, joint)
    return asm


def _lidded(rng) -> Assembly:
    """A case that is open above, under a slanting or level lid hinged behind; a door below."""
    wide = float(rng.uniform(0.22, 0.42))
    high, deep = wide * float(rng.uniform(0.6, 1.4)), wide * float(rng.uniform(0.28, 0.6))
    unit, wall, half = max(wide, high) / 100, max(0.012 * wide, 0.005), wide / 2
    face, metal = draw_paint(rng), materials.hardware(rng)
    drop = deep * float(rng.choice([0.0, 0.3, 0.6]))
    poly = np.array([[0, 0], [high - drop, 0], [high, deep], [0, deep]])
    inner = np.array([[wall, wall], [2 * high, wall], [2 * high, deep - wall], [wall, deep - wall]])
    solid = extrusion(poly, "y", [0, -half, 0], wide)
    solid -= extrusion(inner, "y", [0, wall - half, 0], wide - 2 * wall)
    asm, body = Assembly(), Shape()
    door = None
    if rng.random() < 0.5:
        door = (
            -0.8 * half,
            0.8 * half,
            0.08 * high,
            float(rng.uniform(0.45, 0.62)) * (high - drop),
        )
        solid -= box(
            [-1, door[0] + unit, door[2] + unit], [2 * wall, door[1] - unit, door[3] - unit]
        )
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
        face if rng.random() < 0.5 else draw_paint(rng),
    )
    joint = hinge((back[1], 0, back[0]), (0, 1, 0), float(np.deg2rad(rng.uniform(55, 105))))
    asm.add("lid", shape, root, joint)
    if door is not None:
        add_panel(
            rng,
            asm,
            root,
            "door",
            str(rng.choice(["left", "right", "bottom"])),
            door,
            unit,
            face,
            metal,
            marked=True,
        )
    return asm


def _pillar(rng) -> Assembly:
    """A round pillar box with a cap, a hooded slot and a curved door."""
    high = float(rng.uniform(1.0, 1.6))
    r = high * float(rng.uniform(0.14, 0.2))
    unit, face = high / 100, draw_paint(rng)
    dark = materials.dark(rng)
    asm, body = Assembly(), Shape()
    foot, top = float(rng.uniform(0.04, 0.12)) * high, float(rng.uniform(0.84, 0.92)) * high
    wall = 2 * unit
    shell = tube("z", [0, 0, foot - 0.001], top - foot + 0.002, r, r - wall, 32)
    shell += cylinder("z", [0, 0, foot - 0.001], wall, r, segments=32)
    half = float(rng.uniform(0.5, 0.85)) * r
    door = (-half, half, foot + 0.06 * high, foot + float(rng.uniform(0.36, 0.56)) * high)
    slot = door[3] + 0.1 * high
    front = box([-1, door[0] + unit, door[2] + unit], [0, door[1] - unit, door[3] - unit])
    flap = rng.random() < 0.6
    mouth = box([-1, -0.5 * r, slot], [0, 0.5 * r, slot + 3.5 * unit])
    body.add(shell - front - mouth, face)
    if flap:
        frame = box([-r - 1.2 * unit, -0.6 * r, slot - 1.5 * unit], [0, 0.6 * r, slot + 4.5 * unit])
        body.add(frame - cylinder("z", [0, 0, 0], 2, r + 3e-4, segments=32) - mouth, face)
    hood = extrusion(
        np.array(
            [
                [slot + 4.7 * unit, -r - 4 * unit],
                [slot + 7 * unit, -0.8 * r],
                [slot + 4.7 * unit, -0.8 * r],
            ]
        ),
        "y",
        [0, -0.56 * r, 0],
        1.12 * r,
    )
    body.add(hood - cylinder("z", [0, 0, 0], 2, r + 3e-4, segments=32), face)
    body.add(cylinder("z", [0, 0, 0], foot, 1.12 * r, segments=32), dark)
    cap = [cylinder("z", [0, 0, top], 0.35 * (high - top), 1.15 * r, segments=32)]
    cap.append(
        cylinder(
            "z",
            [0, 0, top + 0.35 * (high - top) - 1e-4],
            0.65 * (high - top),
            1.1 * r,
            float(rng.uniform(0.3, 0.9)) * r,
            32,
        )
    )
    body.add(union(cap), face if rng.random() < 0.7 else draw_paint(rng))
    root = asm.add("body", body)
    t = 1.6 * unit
    ring = tube("z", [0, 0, door[2]], door[3] - door[2], r + 0.3 * unit + t, r + 0.3 * unit, 32)
    leaf = ring ^ box([-2, door[0], 0], [0, door[1], 3])
    x = -float(np.sqrt((r + 0.3 * unit + t) ** 2 - half**2))
    side = str(rng.choice(["left", "right"]))
    shape = Shape().add(leaf, face if rng.random() < 0.6 else draw_paint(rng))
    y = (0.6 if side == "left" else -0.6) * half
    at = -float(np.sqrt((r + 0.3 * unit + t) ** 2 - y**2))
    shape.add(
        cylinder("x", [at - 1.5 * unit, y, (door[2] + door[3]) / 2], 2 * unit, 1.8 * unit) - ring,
        materials.hardware(rng),
    )
    asm.add("door", shape, root, open_at(rng, side, x, door, 80, 140))
    if flap:
        span = (-0.54 * r, 0.54 * r, slot - unit, slot + 4.2 * unit)
        add_panel(
            rng,
            asm,
            root,
            "flap",
            "top",
            span,
            unit,
            materials.hardware(rng),
            dark,
            x=-r - 1.2 * unit,
            pull=False,
            swing=(50, 90),
            thick=1.2 * unit,
        )
    return asm


def _parcel(rng) -> Assembly:
    """A standing box for parcels: a hopper or a lid above, a large door below, on legs."""
    wide = float(rng.uniform(0.36, 0.6))
    high, deep = wide * float(rng.uniform(1.3, 2.4)), wide * float(rng.uniform(0.6, 0.95))
    base = float(rng.uniform(0, 0.25)) * high
    unit, half = (high + base) / 100, wide / 2
    wall = 1.6 * unit
    face, metal = draw_paint(rng), materials.hardware(rng)
    second = face if rng.random() < 0.45 else draw_paint(rng)
    asm, body = Assembly(), Shape()
    z1 = base + high
    share = float(rng.uniform(0.2, 0.36))
    edge = float(rng.uniform(1.0, 4)) * unit
    hopper = (-half + edge, half - edge, z1 - share * high, z1 - edge)
    door = (-half + edge, half - edge, base + edge, z1 - share * high - 1.5 * unit)
    letters = rng.random() < 0.4
    spans = [hopper, door]
    if letters:  # a slot for letters between hopper and door
        flap = (-0.7 * half, 0.7 * half, door[3] - 6 * unit, door[3])
        door = (*door[:3], flap[2] - 1.5 * unit)
        spans = [hopper, door, flap]
    solid = box([0, -half, base], [deep, half, z1])
    solid -= box([wall, wall - half, base + wall], [deep - wall, half - wall, z1 - wall])
    inset = 1.5 * unit
    solid = cut(
        solid,
        [
            box([-1, s[0] + inset, s[2] + inset], [2 * wall, s[1] - inset, s[3] - inset])
            for s in spans
        ],
    )
    body.add(solid, face)
    if base > 6 * unit:
        r = 2.2 * unit
        dark = materials.dark(rng)
        for x in (2 * r, deep - 2 * r):
            for y in (2 * r - half, half - 2 * r):
                body.add(box([x - r, y - r, 0], [x + r, y + r, base]), dark)
    elif base:
        body.add(
            box([3 * unit, 3 * unit - half, 0], [deep, half - 3 * unit, base]), materials.dark(rng)
        )
    root = asm.add("body", body)
    top = "bottom" if rng.random() < 0.6 else "top"
    add_panel(rng, asm, root, "hopper", top, hopper, unit, second, metal, swing=(40, 80))
    if letters:
        add_panel(
            rng, asm, root, "flap", "top", flap, unit, metal, metal, pull=False, swing=(50, 90)
        )
    side = str(rng.choice(["left", "right"]))
    add_panel(rng, asm, root, "door", side, door, unit, second, metal, marked=True)
    return asm


def _bank(rng) -> Assembly:
    """Letter boxes of a house: rows of doors, with or without slots."""
    columns, rows = int(rng.integers(1, 4)), int(rng.integers(1, 5))
    if columns * rows < 2:
        rows = 2
    w, h = float(rng.uniform(0.2, 0.36)), float(rng.uniform(0.12, 0.3))
    if rows == 1:
        h = float(rng.uniform(0.25, 0.45))
    wide, high, deep = columns * w, rows * h, float(rng.uniform(0.12, 0.32))
    unit, half = max(wide, high) / 100, wide / 2
    face, metal = draw_paint(rng), materials.hardware(rng)
    second = face if rng.random() < 0.4 else draw_paint(rng)
    base = float(rng.choice([0.0, rng.uniform(0.4, 0.8)])) if high < 0.7 else 0.0
    asm, body = Assembly(), Shape()
    edge, side = (
        1.3 * unit,
        str(rng.choice(["left", "right", "bottom", "top"], p=[0.4, 0.3, 0.15, 0.15])),
    )
    cells, spans = [], []
    for k in range(rows):
        for n in range(columns):
            y, z = n * w - half, base + k * h
            spans.append((y + edge, y + w - edge, z + edge, z + h - edge))
            cells.append(
                box(
                    [-1, y + 2 * edge, z + 2 * edge],
                    [deep - edge, y + w - 2 * edge, z + h - 2 * edge],
                )
            )
    body.add(cut(box([0, -half, base], [deep, half, base + high]), cells), face)
    if base:
        add_posts(rng, body, wide, deep, base, unit)
    root = asm.add("body", body)
    slot, marked = rng.random() < 0.5, rng.random() < 0.5
    for span in spans:
        y0, y1, z0, z1 = span
        x, t = -0.3 * unit, 1.2 * unit
        leaf = box([x - t, y0, z0], [x, y1, z1])
        if slot:
            z = z0 + 0.8 * (z1 - z0)
            leaf -= box([-1, y0 + 0.15 * w, z - 0.05 * h], [1, y1 - 0.15 * w, z + 0.05 * h])
        shape = Shape().add(leaf, second)
        if marked:
            tag = box(
                [x - t - 0.4 * unit, y0 + 0.3 * w, z0 + 0.5 * h],
                [x - t, y0 + 0.6 * w, z0 + 0.6 * h],
            )
            shape.add(tag, plain((0.92, 0.92, 0.88)))
        add_pull(np.random.default_rng(0), shape, side, x - t, span, unit, metal)
        asm.add("door", shape, root, open_at(rng, side, x - t, span, 75, 120))
    return asm

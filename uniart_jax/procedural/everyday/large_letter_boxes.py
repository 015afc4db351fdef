"""Large letter boxes: pillar boxes, parcel boxes, and the letter boxes of a block of flats, in
metres."""

from __future__ import annotations

import numpy as np

from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.case_fronts import (
    add_panel,
    add_posts,
    add_pull,
    doorway,
    draw_finish,
    open_at,
)
from uniart_jax.procedural.materials import plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    extrusion,
    tube,
    union,
)


def pillar_box(rng) -> Assembly:
    """A round pillar box in metres with a cap, a hooded slot and a curved door."""
    high = float(rng.uniform(1.0, 1.6))
    r = high * float(rng.uniform(0.14, 0.2))
    unit, face = high / 100, draw_finish(rng)
    dark = materials.dark(rng)
    asm, body = Assembly(), Shape()
    foot, top = float(rng.uniform(0.04, 0.12)) * high, float(rng.uniform(0.84, 0.92)) * high
    wall = 2 * unit
    shell = tube("z", [0, 0, foot - 0.001], top - foot + 0.002, r, r - wall, 32)
    shell += cylinder("z", [0, 0, foot - 0.001], wall, r, segments=32)
    half = float(rng.uniform(0.5, 0.85)) * r
    door = (-half, half, foot + 0.06 * high, foot + float(rng.uniform(0.36, 0.56)) * high)
    slot = door[3] + 0.1 * high
    front = doorway(door, unit, 0)
    flap = rng.random() < 0.6
    mouth = box([-1, -0.5 * r, slot], [0, 0.5 * r, slot + 3.5 * unit])
    body.add(shell - front - mouth, face)
    if flap:
        frame = box([-r - 1.2 * unit, -0.6 * r, slot - 1.5 * unit], [0, 0.6 * r, slot + 4.5 * unit])
        body.add(frame - cylinder("z", [0, 0, 0], 2, r + 3e-4, segments=32) - mouth, face)
    low, peak = slot + 4.7 * unit, slot + 7 * unit
    roof = np.array([[low, -r - 4 * unit], [peak, -0.8 * r], [low, -0.8 * r]])
    hood = extrusion(roof, "y", [0, -0.56 * r, 0], 1.12 * r)
    body.add(hood - cylinder("z", [0, 0, 0], 2, r + 3e-4, segments=32), face)
    body.add(cylinder("z", [0, 0, 0], foot, 1.12 * r, segments=32), dark)
    rest, tip = high - top, float(rng.uniform(0.3, 0.9)) * r
    cap = cylinder("z", [0, 0, top], 0.35 * rest, 1.15 * r, segments=32)
    dome = cylinder("z", [0, 0, top + 0.35 * rest - 1e-4], 0.65 * rest, 1.1 * r, tip, 32)
    body.add(union([cap, dome]), face if rng.random() < 0.7 else draw_finish(rng))
    root = asm.add("body", body)
    out = r + 0.3 * unit + 1.6 * unit  # of the door's outer face
    ring = tube("z", [0, 0, door[2]], door[3] - door[2], out, r + 0.3 * unit, 32)
    leaf = ring ^ box([-2, door[0], 0], [0, door[1], 3])
    x = -float(np.sqrt(out**2 - half**2))
    side = str(rng.choice(["left", "right"]))
    shape = Shape().add(leaf, face if rng.random() < 0.6 else draw_finish(rng))
    y = (0.6 if side == "left" else -0.6) * half
    at = -float(np.sqrt(out**2 - y**2))
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


def parcel_box(rng) -> Assembly:
    """A standing parcel box in metres: a hopper or a lid above, a large door below, on legs."""
    wide = float(rng.uniform(0.36, 0.6))
    high, deep = wide * float(rng.uniform(1.3, 2.4)), wide * float(rng.uniform(0.6, 0.95))
    base = float(rng.uniform(0, 0.25)) * high
    unit, half = (high + base) / 100, wide / 2
    wall = 1.6 * unit
    face, metal = draw_finish(rng), materials.hardware(rng)
    second = face if rng.random() < 0.45 else draw_finish(rng)
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
    solid = cut(solid, [doorway(s, inset, 2 * wall) for s in spans])
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


def bank_of_boxes(rng) -> Assembly:
    """The letter boxes of a block of flats, in metres: rows of doors, with or without slots."""
    columns, rows = int(rng.integers(1, 4)), int(rng.integers(1, 5))
    if columns * rows < 2:
        rows = 2
    w, h = float(rng.uniform(0.2, 0.36)), float(rng.uniform(0.12, 0.3))
    if rows == 1:
        h = float(rng.uniform(0.25, 0.45))
    wide, high, deep = columns * w, rows * h, float(rng.uniform(0.12, 0.32))
    unit, half = max(wide, high) / 100, wide / 2
    face, metal = draw_finish(rng), materials.hardware(rng)
    second = face if rng.random() < 0.4 else draw_finish(rng)
    base = float(rng.choice([0.0, rng.uniform(0.4, 0.8)])) if high < 0.7 else 0.0
    asm, body = Assembly(), Shape()
    edge = 1.3 * unit
    side = str(rng.choice(["left", "right", "bottom", "top"], p=[0.4, 0.3, 0.15, 0.15]))
    cells, spans = [], []
    for k in range(rows):
        for n in range(columns):
            y, z = n * w - half, base + k * h
            spans.append((y + edge, y + w - edge, z + edge, z + h - edge))
            cells.append(doorway((y, y + w, z, z + h), 2 * edge, deep - edge))
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

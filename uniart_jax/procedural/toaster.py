"""Toasters: slots on top, a lever that slides down with the bread, browning knobs, a crumb tray."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.fronts import add_knob
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    extrusion,
    rounded,
    slide,
    tidy,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A toaster, metres, bread up; its levers on the face at -x."""
    wide = rng.random() < 0.5  # slots along the front, or away from it
    pairs = 2 if rng.random() < 0.35 else 1
    slot_long, slot = float(rng.uniform(0.13, 0.16)), float(rng.uniform(0.026, 0.038))
    rows = int(rng.choice([1, 2], p=[0.2, 0.8])) if pairs == 1 else 2
    across = rows * slot + (rows + 1) * float(rng.uniform(0.016, 0.03)) + 0.03
    end = float(rng.uniform(0.02, 0.045))
    if wide:  # the lever is on the long side
        depth, width = across + 0.02, pairs * slot_long + (pairs + 1) * end
    else:  # on the short side; two pairs stand side by side
        depth, width = slot_long + 2 * end + 0.02, pairs * across
    if not wide and pairs == 1 and rng.random() < 0.25:
        depth += slot_long * float(rng.uniform(0.5, 0.9))  # a long one for baguettes
    height = float(rng.uniform(0.16, 0.22))
    unit = max(width, depth, height) / 100
    half, legs = width / 2, float(rng.uniform(0.006, 0.014))
    top = legs + height
    face = _finish(rng)
    trim = materials.dark(rng) if rng.random() < 0.5 else materials.metal(rng, brushed=False)

    asm, body = Assembly(), Shape()
    solid, corner = _shell(rng, depth, half, legs, height)
    wall = max(0.006, 2.6 * unit)
    # slots: lo and hi (x, y)
    slots = []
    for p in range(pairs):
        for k in range(rows):
            off = ((k + 0.5) / rows - 0.5) * (across - 0.03)
            if wide:
                y = -half + end + (slot_long + end) * p + slot_long / 2
                x = depth / 2 + off + 0.005
                slots.append(
                    (p, [x - slot / 2, y - slot_long / 2], [x + slot / 2, y + slot_long / 2])
                )
            else:
                y = -half + across * (p + 0.5) + off
                long = depth - 2 * end - 0.02
                x = depth / 2 + 0.008
                slots.append((p, [x - long / 2, y - slot / 2], [x + long / 2, y + slot / 2]))
    floor = legs + 0.3 * height
    wells = [box([*lo, floor], [*hi, top + 1]) for _, lo, hi in slots]
    controls = _panel(rng, pairs, half, legs, height, unit)
    # the lever's cleft, through the front wall into a room behind it
    clefts = []
    w = max(0.0035, 1.1 * unit)
    for y, low, high in controls["levers"]:
        clefts.append(box([-1, y - w, low - 2 * w], [wall, y + w, high + 2 * w]))
    tray_box = None
    lowest = min([z - 1.2 * r for _, z, r in controls["knobs"]], default=top)
    if rng.random() < 0.45 and lowest > legs + 0.12 * height:  # a crumb tray, drawn out in front
        tray_box = [
            [0.0, -0.6 * half, legs + 0.03 * height],
            [0.75 * depth, 0.6 * half, legs + 0.1 * height],
        ]
        lo, hi = np.array(tray_box[0]), np.array(tray_box[1])
        wells.append(box(lo - [1, 0.3 * unit, 0.3 * unit], hi + [unit, 0.3 * unit, 0.3 * unit]))
    solid = tidy(cut(solid, [*wells, *clefts]))
    body.add(solid, face)
    for y, z, r in controls["buttons"]:
        stud = cylinder("x", [-1.2 * unit, y, z], 1.2 * unit, r, segments=14)
        if controls["square"]:
            stud = box([-1.2 * unit, y - r, z - 0.7 * r], [0, y + r, z + 0.7 * r])
        body.add(stud, trim)
    _trim(rng, body, slots, depth, half, top, legs, corner, unit, trim)
    root = asm.add("body", body)

    bread = rng.random() < 0.45
    loaf = plain(np.array([0.8, 0.58, 0.32]) * rng.uniform(0.7, 1.15))
    grip = trim if rng.random() < 0.6 else materials.hardware(rng)
    for p, (y, low, high) in enumerate(controls["levers"]):
        travel = high - low
        shape = Shape()
        wide_grip, tall = float(rng.uniform(4, 8)) * unit, float(rng.uniform(1.6, 3)) * unit
        reach = float(rng.uniform(3, 6)) * unit
        pad = box(
            [-reach, y - wide_grip / 2, high - tall / 2],
            [-0.5 * unit, y + wide_grip / 2, high + tall / 2],
        )
        stem = box([-0.6 * unit, y - 0.75 * w, high - w], [0.9 * wall, y + 0.75 * w, high + w])
        shape.add(union([pad, stem]), grip)
        mine = [s for s in slots if s[0] == p] if len(controls["levers"]) > 1 else slots
        if bread:
            up = float(rng.uniform(0.02, 0.045))
            tall_slice = min(float(rng.uniform(0.09, 0.12)), top + up - floor - travel - 0.004)
            for _, lo, hi in mine:
                if rng.random() < 0.85:
                    _slice(shape, lo, hi, top + up - tall_slice, top + up, loaf)
        asm.add("lever", shape, root, slide((0, 0, -1), travel))
    for y, z, r in controls["knobs"]:
        sweep = None if rng.random() < 0.35 else float(np.deg2rad(rng.choice([180, 240, 300])))
        mark = plain((0.1, 0.1, 0.1) if grip.color[1] > 0.5 else (0.95, 0.95, 0.95))
        limited = sweep is not None
        add_knob(
            asm,
            root,
            (-0.0005, y, z),
            r,
            1.1 * r,
            grip,
            mark,
            sweep,
            pointer=limited,
            skirt=limited,
        )
    if tray_box is not None:
        lo, hi = tray_box
        plate = box(lo, hi) - box(
            [lo[0] + 2 * unit, lo[1] + unit, lo[2] + 0.8 * unit], [hi[0] - unit, hi[1] - unit, 1]
        )
        lip = box([-1.5 * unit, lo[1], lo[2]], [0.001, hi[1], hi[2]])
        pull = float(rng.uniform(0.4, 0.85)) * (hi[0] - lo[0])
        asm.add("crumb_tray", Shape().add(union([plate, lip]), trim), root, slide((-1, 0, 0), pull))
    return asm.object()


def _finish(rng: np.random.Generator) -> Material:
    kind = rng.choice(5, p=[0.36, 0.16, 0.16, 0.16, 0.16])
    if kind == 0:
        return materials.metal(rng)
    if kind == 1:
        return materials.white_plastic(rng)
    if kind == 2:
        return materials.dark(rng)
    return materials.paint(rng) if kind == 3 else plain(rng.uniform([0.1] * 3, [0.95, 0.8, 0.8]))


def _shell(rng, depth, half, legs, height):
    """The body, flat in front: its edges rounded about y, x or z; and how much."""
    manner = str(rng.choice(["x", "z", "box", "y"], p=[0.45, 0.2, 0.15, 0.2]))
    corner = float(rng.uniform(0.05, 0.35)) * min(height, 2 * half, depth)
    middle = legs + height / 2
    if manner == "x":  # as seen from the front
        outline = rounded(2 * half, height, corner, 6)
        return extrusion(outline, "x", [0, 0, middle], depth), corner
    if manner == "z":
        outline = rounded(depth, 2 * half, min(corner, 0.2 * half), 6)
        return extrusion(outline, "z", [depth / 2, 0, legs], height), 0.0
    if manner == "y":  # only its upper rear edge, so that the front stays flat
        arc = np.linspace(0, np.pi / 2, 6)
        rear = np.column_stack(
            [
                legs
                + height
                - corner
                + corner * np.cos(arc[::-1]) * 0
                + corner * np.sin(arc[::-1]),
                depth - corner + corner * np.cos(arc[::-1]),
            ]
        )
        profile = np.vstack([[[legs, 0], [legs + height, 0]], rear, [[legs, depth]]])
        return extrusion(profile, "y", [0, -half, 0], 2 * half), 0.0
    return box([0, -half, legs], [depth, half, legs + height]), 0.0


def _panel(rng, pairs: int, half: float, legs: float, height: float, unit: float) -> dict:
    """Where levers (y, low, high), knobs and buttons (y, z, radius) sit on the front."""
    levers, knobs, buttons = [], [], []
    count = pairs if pairs == 1 or rng.random() < 0.8 else 1
    low = legs + height * float(rng.uniform(0.3, 0.45))
    high = legs + height * float(rng.uniform(0.7, 0.85))
    square = bool(rng.random() < 0.5)
    room = 2 * half / count
    beside = room > 0.14 and rng.random() < 0.6  # controls beside the lever, else below it
    side = float(rng.choice([-1, 1]))
    lots = rng.random() < 0.5
    for p in range(count):
        middle = -half + room * (p + 0.5)
        lever = middle + (side * 0.22 * room if beside else 0)
        levers.append((lever, low, high))
        r = float(np.clip(0.09 * height, 2.4 * unit, 0.02))
        if beside:
            y = middle - side * 0.2 * room
            knobs.append((y, legs + 0.62 * height, 1.15 * r))
            n = int(rng.integers(1, 4)) if lots else 0
            pitch = 4.6 * unit
            for k in range(n):
                buttons.append((y + (k - (n - 1) / 2) * pitch, legs + 0.32 * height, 1.5 * unit))
        else:
            y = middle
            z = legs + 0.17 * height
            if lots and room > 10 * unit + 2 * r:
                knobs.append((y, z, r))
                buttons += [(y + s * (r + 3.2 * unit), z, 1.4 * unit) for s in (-1, 1)]
            else:
                knobs.append((y, z, r))
    return {"levers": levers, "knobs": knobs, "buttons": buttons, "square": square}


def _trim(rng, body: Shape, slots, depth, half, top, legs, corner, unit, trim: Material) -> None:
    """Rims round the slots, feet, a plinth."""
    if rng.random() < 0.7:
        r = 1.0 * unit
        for _, lo, hi in slots:
            ring = box([lo[0] - r, lo[1] - r, top], [hi[0] + r, hi[1] + r, top + 0.7 * unit])
            body.add(ring - box([*lo, top - 1], [*hi, top + 1]), trim)
    if rng.random() < 0.5:
        feet = [
            cylinder("z", [x, y, 0], legs, 2.2 * unit, segments=12)
            for x in (0.15 * depth, 0.85 * depth)
            for y in (-0.7 * half, 0.7 * half)
        ]
        body.add(union(feet), materials.dark(rng))
    else:
        inset = corner * 0.6 + unit
        body.add(
            box([unit, -half + inset, 0], [depth - unit, half - inset, legs]), materials.dark(rng)
        )


def _slice(shape: Shape, lo, hi, low: float, high: float, loaf: Material) -> None:
    """A slice of bread in a slot, its upper corners rounded."""
    lo, hi = np.array(lo), np.array(hi)
    size = hi - lo
    thin = int(np.argmin(size))
    long = 1 - thin
    span, thick = min(0.88 * size[long], 0.13), 0.62 * size[thin]
    outline = rounded(span, high - low, 0.16 * span)
    middle = np.array([*((lo + hi) / 2), (low + high) / 2])
    middle[thin] -= thick / 2
    if thin == 0:
        shape.add(extrusion(outline, "x", middle, thick), loaf)  # (y, z)
    else:
        shape.add(extrusion(outline[:, ::-1], "y", middle, thick), loaf)  # (z, x)

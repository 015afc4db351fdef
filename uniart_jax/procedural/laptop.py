"""Laptops: a base with keyboard and touchpad, a screen about its rear edge, now and then a disc
drive."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    extrusion,
    hinge,
    rounded,
    slide,
    union,
)

_GAP = 0.0015  # metres between base and screen


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A laptop, metres, closed."""
    width = float(rng.uniform(0.27, 0.4))
    depth = width * float(rng.uniform(0.62, 0.75))
    thick = float(rng.uniform(0.035, 0.075)) * width
    lid = float(rng.uniform(0.02, 0.035)) * width
    unit = width / 100
    case = _case(rng)
    deck = case if rng.random() < 0.5 else materials.dark(rng)
    keys = materials.dark(rng) if rng.random() < 0.75 else materials.white_plastic(rng)
    radius = float(rng.uniform(0.5, 4.5)) * unit
    half = width / 2
    top = thick

    asm, body = Assembly(), Shape()
    drive = thick > 0.05 * width and rng.random() < 0.4
    barrel = min(1.1 * unit, 0.45 * lid)
    pads = [
        cylinder("z", [x, y, -0.8 * unit], 0.85 * unit, 1.6 * unit, segments=12)
        for x in (4 * unit, depth - 4 * unit)
        for y in (-half + 5 * unit, half - 5 * unit)
    ]
    body.add(union(pads), materials.dark(rng))
    outline = rounded(depth, width, radius)
    slab = extrusion(outline, "z", [depth / 2, 0, 0], thick)
    knuckles, notches = _hinge_spans(rng, half, unit)
    axis = (depth, top + _GAP / 2)
    rods = [
        cylinder("y", [axis[0], a, axis[1]], b - a, barrel, segments=16)
        - box([0, -1, 0], [depth, 1, top + _GAP / 2])
        for a, b in knuckles
    ]
    plate_lo, plate_hi = [0.42 * depth, -half + 3.5 * unit], [0.9 * depth, half - 3.5 * unit]
    pad = rng.uniform(0.14, 0.22) * width
    touch_lo = [0.07 * depth, -pad + float(rng.uniform(-2, 5)) * unit]
    touch_hi = [0.36 * depth, touch_lo[1] + 2 * pad]
    sunk = max(0.0015, 0.8 * unit)
    wells = [
        box([*plate_lo, top - 2 * sunk], [*plate_hi, 1]),
        box([*touch_lo, top - sunk], [*touch_hi, 1]),
    ]
    tray_lo = np.array([0.25 * depth, -half - 1e-6, 0.22 * thick])
    tray_hi = np.array([0.25 * depth + 0.135, -half + 0.13, 0.55 * thick])
    if drive:
        wells.append(
            box(
                tray_lo - np.array([0.0015, 0.02, 0.0012]),
                tray_hi + np.array([0.0015, 0.002, 0.0012]),
            )
        )
    for k in range(int(rng.integers(1, 4))):  # ports
        x = (0.55 + 0.12 * k) * depth
        wells.append(box([x, half - 0.8 * unit, 0.3 * thick], [x + 3.5 * unit, 1, 0.6 * thick]))
    rest = cut(slab, wells)
    if deck is case:
        body.add(union([rest, *rods]), case)
    else:  # the deck's top sheet has a colour of its own
        sheet = box([-1, -1, top - 0.25 * thick], [2, 1, 2])
        body.add(rest ^ sheet, deck)
        body.add(union([rest - sheet, *rods]), case)
    body.add(box([*touch_lo, top - 1.6 * sunk], [*touch_hi, top - 0.6 * sunk]), deck.darker(0.8))
    _keyboard(rng, body, plate_lo, plate_hi, top - 2 * sunk, 1.7 * sunk, keys)
    root = asm.add("base", body)

    back = materials.plain(case.color) if case.image is None else case
    if rng.random() < 0.25:
        back = _case(rng)
    bezel = materials.dark(rng) if rng.random() < 0.7 else case
    low = top + _GAP
    shell = extrusion(rounded(depth, width, radius), "z", [depth / 2, 0, low], lid)
    slots = [
        cylinder("y", [axis[0], a, axis[1]], b - a, barrel + 0.0012, segments=16)
        for a, b in notches
    ]
    frame = float(rng.uniform(1.8, 5)) * unit
    view_lo = [frame * float(rng.uniform(1, 1.6)), -half + frame]
    view_hi = [depth - max(2.5 * frame, 5 * unit), half - frame]
    view = box([*view_lo, low - 1], [*view_hi, low + 0.4 * lid])
    border = box(
        [0.8 * unit, -half + 0.8 * unit, low - 1],
        [depth - 2.5 * unit, half - 0.8 * unit, low + 0.3 * lid],
    )
    screen = Shape()
    screen.add(cut(shell, (view, border, *slots)), back)
    inlay = box(
        [0.8 * unit, -half + 0.8 * unit, low],
        [depth - 2.5 * unit, half - 0.8 * unit, low + 0.3 * lid],
    )
    screen.add(cut(inlay, (view, *slots)), bezel)
    screen.add(box([*view_lo, low + 0.1 * lid], [*view_hi, low + 0.4 * lid]), _picture(rng))
    if rng.random() < 0.6:  # a badge on the back
        r = float(rng.uniform(2, 4.5)) * unit
        badge = cylinder("z", [depth / 2, 0, low + lid], 0.5 * unit, r, segments=18)
        if rng.random() < 0.5:
            badge = box(
                [depth / 2 - 0.4 * r, -1.6 * r, low + lid],
                [depth / 2 + 0.4 * r, 1.6 * r, low + lid + 0.5 * unit],
            )
        screen.add(badge, materials.hardware(rng))
    swing = float(np.deg2rad(rng.choice([rng.uniform(105, 140), 180], p=[0.8, 0.2])))
    joint = hinge([axis[0], 0, axis[1]], (0, 1, 0), swing)
    asm.add("screen", screen, root, joint)

    if drive:
        wall = max(0.0022, 0.8 * unit)
        front = 1.2 * wall
        disc = cylinder(
            "z", [*(tray_lo + tray_hi)[:2] / 2, tray_hi[2] - 0.5 * wall], 1.0, 0.062, segments=28
        )
        tray = Shape().add(cut(box(tray_lo, tray_hi), (disc,)), materials.dark(rng))
        tray.add(
            box(
                [tray_lo[0] - 0.001, tray_lo[1] - front, tray_lo[2] - 0.001],
                [tray_hi[0] + 0.001, tray_lo[1], tray_hi[2] + 0.001],
            ),
            case,
        )
        asm.add("disc_tray", tray, root, slide((0, -1, 0), 0.11))
    return asm.object()


def _case(rng: np.random.Generator) -> Material:
    """Aluminium, black, white, or a strong colour."""
    kind = rng.choice(4, p=[0.45, 0.27, 0.12, 0.16])
    if kind == 0:
        return materials.metal(rng, brushed=False)
    if kind == 1:
        return materials.dark(rng)
    return materials.white_plastic(rng) if kind == 2 else materials.paint(rng)


def _picture(rng: np.random.Generator) -> Material:
    """The screen: dark glass, or a desktop of sky above hills."""
    if rng.random() < 0.5:
        return materials.dark_glass(rng)
    return plain(rng.uniform(0.1, 0.9, 3) * [0.6, 0.8, 1.0])


def _hinge_spans(rng, half: float, unit: float):
    """Spans (y0, y1) of the hinge's knuckles, and of the notches in the screen around them."""
    if rng.random() < 0.5:
        spans = [(-0.62 * half, 0.62 * half)]
    else:
        length = float(rng.uniform(6, 12)) * unit
        spans = [(-0.8 * half, -0.8 * half + length), (0.8 * half - length, 0.8 * half)]
    return spans, [(a - 0.3 * unit, b + 0.3 * unit) for a, b in spans]


def _keyboard(rng, body: Shape, lo, hi, z: float, tall: float, material: Material) -> None:
    """Keys in rows on a plate; every key stands for itself only where it is large enough to be
    seen."""
    rows, columns = 4, int(rng.integers(9, 13))
    lo, hi = np.asarray(lo), np.asarray(hi)
    body.add(box([*lo, z], [*hi, z + 0.45 * tall]), material.darker(0.6))
    pitch = (hi - lo) / (rows, columns)
    keys = []
    for i in range(rows):
        for j in range(columns):
            if i == 0 and 3 <= j < columns - 3:
                continue
            a = lo + pitch * (i, j) + 0.1 * pitch
            keys.append(box([*a, z + 0.45 * tall], [*(a + 0.8 * pitch), z + tall]))
    a, b = lo + pitch * (0.1, 3.1), lo + pitch * (0.9, columns - 3.1)
    keys.append(box([*a, z + 0.45 * tall], [*b, z + tall]))
    body.add(union(keys), material)

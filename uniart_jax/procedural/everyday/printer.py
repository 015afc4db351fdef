"""Inkjet, laser and label printers. The family's copiers, scanners and shredders are in
``office_machines``."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.controls import Button, add_buttons
from uniart_jax.procedural.everyday.case_fronts import doorway
from uniart_jax.procedural.everyday.office_machines import copier, scanner, shredder
from uniart_jax.procedural.everyday.printer_parts import (
    add_drawers,
    add_flap,
    add_lid,
    add_screen,
    add_tilting_panel,
    block,
    draw_finish,
    draw_second,
    drawer_rooms,
    scanner_glass,
)
from uniart_jax.procedural.materials import plain
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
    turn,
    union,
)

KINDS = ("inkjet", "laser", "copier", "scanner", "shredder", "label")


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A printer, copier, scanner or shredder in metres, closed."""
    kind = rng.choice(len(KINDS), p=[0.28, 0.24, 0.16, 0.09, 0.12, 0.11])
    return (_inkjet, _laser, copier, scanner, shredder, _label)[kind](rng).object()


def _inkjet(rng) -> Assembly:
    """A low printer: a scanner lid or a cover, a panel, a paper flap, at times a cassette."""
    wide = float(rng.uniform(0.38, 0.5))
    deep, high = wide * float(rng.uniform(0.68, 0.9)), wide * float(rng.uniform(0.3, 0.48))
    unit, half = wide / 100, wide / 2
    corner = float(rng.choice([0.0, rng.uniform(1, 7)])) * unit
    face = draw_finish(rng)
    second = draw_second(rng, face)
    asm, body, holes = Assembly(), Shape(), []
    edge = corner + unit
    strip = high * float(rng.uniform(0.24, 0.34))  # of the panel
    cassette = rng.random() < 0.5
    tray = (2 * unit, 2 * unit + 0.24 * high) if cassette else (0.0, unit)
    flap = (-0.72 * half, 0.72 * half, tray[1] + unit, high - strip - 1.4 * unit)
    panel = (edge - half, half - edge, high - strip, high - 0.8 * unit)
    style = rng.choice(["tilts", "fixed", "buttons"], p=[0.45, 0.3, 0.25])
    holes.append(doorway(flap, unit, 0.7 * deep))
    if cassette:
        holes += drawer_rooms([tray], 0.76 * half, deep, unit)
    z, buttons = (panel[2] + panel[3]) / 2, []
    if style == "buttons":
        size = 0.36 * strip
        ys = np.linspace(0.25, 0.75, int(rng.integers(1, 4))) * half
        round_ones = bool(rng.random(len(ys))[0] < 0.5)  # all are as the first is
        buttons = [Button(y, z, 1.5 * size, 1.5 * size, round_ones) for y in ys]
        g = 0.75 * size + 0.4 * unit
        holes += [box([-1, b.y - g, z - g], [3 * unit, b.y + g, z + g]) for b in buttons]
    glass = box([0.12 * deep, -0.4 * wide, high - 0.3 * unit], [0.88 * deep, 0.4 * wide, high + 1])
    body.add(tidy(cut(block(deep, wide, 0, high, corner), [*holes, glass])), face)
    pane = scanner_glass((0.12 * deep, 0.88 * deep), 0.4 * wide, high, unit)
    body.add(pane, materials.dark_glass(rng))
    if style != "tilts":
        add_screen(body, rng, 0.0, (edge - half, 0.1 * half, *panel[2:]), unit, rng.random() < 0.6)
    root = asm.add("body", body)
    add_lid(rng, asm, root, (deep, wide), corner, high, unit, second, rng.random() < 0.3)
    if style == "tilts":
        y = panel[:2] if rng.random() < 0.5 else (-0.4 * half, 0.4 * half)
        add_tilting_panel(rng, asm, root, (*y, *panel[2:]), unit, draw_second(rng, face))
    add_buttons(asm, root, 0.0, buttons, 1.2 * unit, 1.6 * unit, draw_second(rng, face))
    add_flap(rng, asm, root, "output_flap", flap, unit, second)
    if cassette:
        add_drawers(rng, asm, root, [tray], 0.76 * half, deep, unit, second, face.darker(0.6))
    return asm


def _laser(rng) -> Assembly:
    """A tall printer: sheets come out on top; a front door or flap, drawers, a side door."""
    wide = float(rng.uniform(0.34, 0.46))
    deep, high = wide * float(rng.uniform(0.85, 1.1)), wide * float(rng.uniform(0.55, 1.15))
    unit, half = max(wide, high) / 100, wide / 2
    corner = float(rng.choice([0.0, rng.uniform(1, 4)])) * unit
    face, edge = draw_finish(rng), corner + unit
    second = draw_second(rng, face)
    asm, body = Assembly(), Shape()
    count = int(rng.choice([0, 1, 2], p=[0.2, 0.5, 0.3]))
    rows = [(2 * unit + k * 13 * unit, 14.4 * unit + k * 13 * unit) for k in range(count)]
    rows = [r for r in rows if r[1] < 0.55 * high]
    low = rows[-1][1] + unit if rows else 2.5 * unit
    strip = 0.16 * high
    door = (edge - half, half - edge, low, high - strip - unit)
    holes = drawer_rooms(rows, half - edge, deep, unit)
    holes.append(doorway(door, 2 * unit, 0.6 * deep))
    near, far, above = 0.2 * deep, 0.85 * deep, high + 0.01
    ramp = np.array(
        [[high - 0.12 * high, near], [above, near], [above, far], [high - 0.03 * high, far]]
    )
    exit_half = half - max(edge, 0.14 * wide)
    cover = rng.random() < 0.4
    if not cover:
        holes.append(extrusion(ramp, "y", [0, -exit_half, 0], 2 * exit_half))
    body.add(tidy(cut(block(deep, wide, 0, high, corner), holes)), face)
    panel = (edge - half, half - edge, high - strip, high - unit)
    tilts = rng.random() < 0.35
    if not tilts:
        add_screen(body, rng, 0.0, (0.1 * half, half - edge, *panel[2:]), unit, rng.random() < 0.6)
    root = asm.add("body", body)
    if tilts:
        add_tilting_panel(rng, asm, root, (0.0, *panel[1:]), unit, draw_second(rng, face))
    if cover:
        add_lid(rng, asm, root, (deep, wide), corner, high, unit, second, rng.random() < 0.4)
    elif rng.random() < 0.5:  # a stop for the sheets, folded down into the slope
        x, w = 0.84 * deep, 0.5 * exit_half
        stop = box([0.5 * deep, -w, high + 0.2 * unit], [x, w, high + 1.4 * unit])
        stop += box([0.82 * deep, -w, high + 0.2 * unit], [0.95 * deep, w, high + 1.4 * unit])
        joint = hinge((0.95 * deep, 0, high + 0.2 * unit), (0, 1, 0), float(rng.uniform(0.8, 1.55)))
        asm.add("paper_stop", Shape().add(stop, draw_second(rng, face)), root, joint)
    side = "bottom" if rng.random() < 0.7 else str(rng.choice(["left", "right"]))
    add_flap(rng, asm, root, "front_door", door, unit, second, thick=2 * unit, side=side)
    add_drawers(rng, asm, root, rows, half - edge, deep, unit, second, face.darker(0.6))
    return asm


def _label(rng) -> Assembly:
    """A label or receipt printer: a lid hinged at the rear over a roll that turns; a knob."""
    wide = float(rng.uniform(0.12, 0.22))
    deep, high = wide * float(rng.uniform(0.9, 1.6)), wide * float(rng.uniform(0.7, 1.15))
    unit, half = max(wide, deep) / 100, wide / 2
    corner, wall = float(rng.choice([0.0, rng.uniform(2, 8)])) * unit, 4 * unit
    face = draw_finish(rng)
    second = draw_second(rng, face)
    asm, body = Assembly(), Shape()
    seam = high * float(rng.uniform(0.45, 0.75))
    start = deep * float(rng.uniform(0.1, 0.35))  # of the lid
    rise = high - seam
    solid = block(deep, wide, 0, seam, corner)
    room = box([start + 3 * unit, wall - half, wall], [deep - wall, half - wall, 2])
    front = block(deep, wide, seam - 1e-4, high, corner) ^ box([-1, -1, 0], [start, 1, 2])
    z, y, g = 0.5 * seam, 0.55 * half, 3.9 * unit
    pocket = box([-1, y - g, z - g], [2.5 * unit, y + g, z + g])
    body.add(tidy(cut(union([solid, front]), [room, pocket])), face)
    add_screen(body, rng, 0.0, (-0.7 * half, 0.2 * half, seam, high - 0.15 * rise), unit, False)
    button = Button(y, z, 7 * unit, 7 * unit, bool(rng.random() < 0.5))
    cutter = box([-unit, -0.6 * half, 0.22 * seam], [0, 0.1 * half, 0.22 * seam + 2 * unit])
    body.add(cutter, materials.metal(rng, brushed=False))
    root = asm.add("body", body)
    gap = 0.4 * unit
    lid = block(deep, wide, seam + gap, high, corner) ^ box([start + gap, -1, 0], [3, 1, 2])
    hollow = box([start + 3 * unit, wall - half, 0], [deep - wall, half - wall, high - wall])
    shape = Shape().add(tidy(lid - hollow), second)
    if rng.random() < 0.5:
        x0, x1, w = start + 8 * unit, deep - 14 * unit, 0.5 * half
        window = box([x0, -w, high], [x1, w, high + 0.6 * unit])
        shape.add(window, materials.dark_glass(rng))
    joint = hinge((deep, 0, seam + gap), (0, 1, 0), float(np.deg2rad(rng.uniform(55, 100))))
    asm.add("lid", shape, root, joint)
    r = min(0.5 * (deep - start - wall - 3 * unit), 0.5 * (high - 2 * wall)) - 1.5 * unit
    if r > 8 * unit:
        x, zr = (start + 3 * unit + deep - wall) / 2, wall + 1.0 * unit + r
        roll = tube("y", [x, wall + unit - half, zr], 2 * (half - wall - unit), r, 0.35 * r)
        paper = Shape().add(roll, plain((0.95, 0.95, 0.93)))
        asm.add("roll", paper, root, turn((x, 0, zr), (0, 1, 0)))
    add_buttons(asm, root, 0.0, [button], 2 * unit, 1.5 * unit, draw_second(rng, face))
    if rng.random() < 0.4:
        knob = cylinder("y", [0.4 * deep, half + 0.3 * unit, z], 4 * unit, 6 * unit, 5 * unit, 16)
        shape = Shape().add(knob, materials.dark(rng))
        asm.add("knob", shape, root, turn((0.4 * deep, 0, z), (0, 1, 0)))
    return asm

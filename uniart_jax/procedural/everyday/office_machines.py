"""Copiers, scanners and shredders, which have drawers, lids and panels as printers do. Lengths are
in metres."""

from __future__ import annotations

import numpy as np

from uniart_jax.procedural import materials
from uniart_jax.procedural.controls import Button, add_buttons
from uniart_jax.procedural.everyday.case_fronts import doorway
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
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    hinge,
    slide,
    tidy,
    union,
)


def copier(rng) -> Assembly:
    """A copier in metres that stands on the floor: a stack of drawers, a gap for the sheets, a
    scanner."""
    wide = float(rng.uniform(0.5, 0.68))
    deep, high = wide * float(rng.uniform(0.85, 1.05)), wide * float(rng.uniform(1.35, 1.8))
    unit, half = high / 100, wide / 2
    face, edge = draw_finish(rng), 1.5 * unit
    second = draw_second(rng, face)
    asm, body = Assembly(), Shape()
    base, count = float(rng.uniform(3, 7)) * unit, int(rng.integers(2, 5))
    top = high * float(rng.uniform(0.42, 0.55))
    pitch = (top - base) / count
    rows = [
        (base + k * pitch + 0.4 * unit, base + (k + 1) * pitch - 0.4 * unit) for k in range(count)
    ]
    door = (edge - half, half - edge, top + 0.5 * unit, 0.68 * high)
    gap = (0.72 * high, 0.86 * high)
    right = 2 if rng.random() < 0.5 else 0.42 * wide
    through = box([-1, -half + 0.1 * wide, gap[0]], [0.8 * deep, right, gap[1]])
    rooms = drawer_rooms(rows, half - edge, deep, unit)
    holes = [*rooms, through, doorway(door, 2 * unit, 0.5 * deep)]
    body.add(tidy(cut(box([0, -half, base], [deep, half, high]), holes)), face)
    dark = materials.dark(rng)
    for x in (0.12 * deep, 0.88 * deep):
        for y in (-0.85 * half, 0.85 * half):
            body.add(cylinder("z", [x, y, 0], base, 2 * unit, segments=12), dark)
    table = rng.random() < 0.5
    if table:  # a tray that folds out at the left
        z = (top + high * 0.68) / 2
        lo = [0.2 * deep, -half - 0.4 * unit, z - 8 * unit]
        body.add(box(lo, [0.8 * deep, -half - 1e-4, z - 5 * unit]), dark)
    root = asm.add("body", body)
    add_drawers(rng, asm, root, rows, half - edge, deep, unit, second, face.darker(0.6))
    side = str(rng.choice(["bottom", "left", "right"]))
    add_flap(rng, asm, root, "front_door", door, unit, second, side=side)
    add_lid(rng, asm, root, (deep, wide), 0, high, unit, second, rng.random() < 0.65)
    if table:
        out, low = -half - 2 * unit, z - 4.5 * unit
        leaf = box([0.15 * deep, out, low], [0.85 * deep, -half - 0.4 * unit, z + 14 * unit])
        joint = hinge((0, out, low), (1, 0, 0), float(np.deg2rad(rng.uniform(60, 85))))
        asm.add("side_tray", Shape().add(leaf, second), root, joint)
    w = float(rng.uniform(0.2, 0.42)) * wide
    y = float(rng.uniform(-0.5, 0.5)) * (wide - 2 * w)
    span = (y - w / 2 - 0.1 * w, y + w / 2, 0.885 * high, 0.985 * high)
    add_tilting_panel(rng, asm, root, span, unit, draw_second(rng, face))
    return asm


def scanner(rng) -> Assembly:
    """A flatbed scanner in metres, or one that feeds sheets through a chute with a folding stop."""
    wide = float(rng.uniform(0.25, 0.42))
    deep = wide * float(rng.uniform(0.7, 1.5))
    unit, half = max(wide, deep) / 100, wide / 2
    high = float(rng.uniform(9, 16)) * unit
    corner = float(rng.choice([0.0, rng.uniform(2, 7)])) * unit
    face = draw_finish(rng)
    second = draw_second(rng, face)
    asm, body = Assembly(), Shape()
    count = int(rng.integers(1, 5))
    size, z = 3.4 * unit, 0.5 * high
    ys = np.linspace(-0.5, 0.5, count) * half if count > 1 else [0.0]
    if count > 1 and ys[1] - ys[0] < 6 * unit:
        ys = ys[::2]
    buttons = [Button(float(y), z, size, size, True) for y in ys]
    holes = [cylinder("x", [-1, b.y, z], 1 + 3 * unit, size / 2 + 0.4 * unit) for b in buttons]
    holes.append(box([0.1 * deep, -0.38 * wide, high - 0.3 * unit], [0.86 * deep, 0.38 * wide, 1]))
    body.add(tidy(cut(block(deep, wide, 0, high, corner), holes)), face)
    pane = scanner_glass((0.1 * deep, 0.86 * deep), 0.38 * wide, high, unit)
    body.add(pane, materials.dark_glass(rng))
    root = asm.add("body", body)
    add_lid(rng, asm, root, (deep, wide), corner, high, unit, second, rng.random() < 0.2)
    add_buttons(asm, root, 0.0, buttons, 1.4 * unit, 1.4 * unit, draw_second(rng, face))
    return asm


def shredder(rng) -> Assembly:
    """A shredder in metres: a head with a slot over a bin that slides out, or is behind a door."""
    wide = float(rng.uniform(0.3, 0.44))
    deep, high = wide * float(rng.uniform(0.6, 0.85)), wide * float(rng.uniform(1.2, 1.9))
    unit, half = high / 100, wide / 2
    corner = float(rng.choice([0.0, rng.uniform(2, 6)])) * unit
    head = high * float(rng.uniform(0.2, 0.34))
    face, base = draw_finish(rng), float(rng.choice([0.0, rng.uniform(4, 7)])) * unit
    second = draw_second(rng, face)
    asm, body = Assembly(), Shape()
    seam, edge = high - head, corner + 2 * unit
    z, x = seam + 0.55 * head, 0.42 * deep
    slot = box([x, -0.8 * half, seam + 0.4 * head], [x + 2.4 * unit, 0.8 * half, 2])
    span = (edge - half, half - edge, base + 3 * unit, seam - 2 * unit)
    room = box([-1, span[0] + unit, span[2]], [deep - 3 * unit, span[1] - unit, span[3]])
    body.add(tidy(cut(block(deep, wide, base, high, corner), [slot, room])), face)
    if base:
        for x in (0.18 * deep, 0.82 * deep):
            for y in (-0.8 * half, 0.8 * half):
                wheel = cylinder("y", [x, y - unit, base / 2], 2 * unit, base / 2 - 1e-4)
                body.add(wheel, materials.dark(rng))
    screen = (0.3 * half, 0.85 * half, z - 0.15 * head, z + 0.2 * head)
    add_screen(body, rng, 0.0, screen, unit, False)
    root = asm.add("body", body)
    if rng.random() < 0.65:
        x = -0.3 * unit
        tub = box(
            [x, span[0] + 1.5 * unit, span[2] + 0.5 * unit],
            [deep - 4 * unit, span[1] - 1.5 * unit, span[3] - 2 * unit],
        )
        front = box([x - 2 * unit, *span[::2]], [x, *span[1::2]])
        front -= box(
            [-1, -0.4 * half, span[3] - 9 * unit], [x - unit, 0.4 * half, span[3] - 4 * unit]
        )
        tub -= box(
            [2 * unit, span[0] + 2.7 * unit, span[2] + 2 * unit],
            [deep - 5.5 * unit, span[1] - 2.7 * unit, 2],
        )
        shape = Shape()
        if rng.random() < 0.5:  # a window
            w, h = 0.5 * half, 0.25 * (span[3] - span[2])
            middle = span[2] + 0.45 * (span[3] - span[2])
            pane = box([x - 2.4 * unit, -w, middle - h], [x - 2 * unit, w, middle + h])
            shape.add(pane, materials.glass(rng))
        shape.add(union([front, tub.translate((-1e-4, 0, 0))]), second)
        asm.add("bin", shape, root, slide((-1, 0, 0), float(rng.uniform(0.5, 0.85)) * deep))
    else:
        side, thick = str(rng.choice(["left", "right", "bottom"], p=[0.4, 0.4, 0.2])), 2 * unit
        add_flap(
            rng, asm, root, "door", span, unit, second, side=side, thick=thick, swing=(80, 120)
        )
    if rng.random() < 0.6:  # a cover over the slot
        low = high + 0.3 * unit
        leaf = box([0.3 * deep, -0.86 * half, low], [0.62 * deep, 0.86 * half, low + 1.6 * unit])
        angle = float(np.deg2rad(rng.uniform(80, 150)))
        joint = hinge((0.62 * deep, 0, low + 1.6 * unit), (0, 1, 0), angle)
        asm.add("cover", Shape().add(leaf, second), root, joint)
    return asm

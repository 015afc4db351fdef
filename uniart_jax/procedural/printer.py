"""Printers, copiers, scanners, shredders and label printers: lids, drawers, flaps, doors, a panel
that tilts, buttons."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.controls import Button, add_buttons
from uniart_jax.procedural.materials import Material, hsv, plain
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
    tidy,
    tube,
    turn,
    union,
)

KINDS = ("inkjet", "laser", "copier", "scanner", "shredder", "label")


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A printer or its like, metres, closed."""
    kind = rng.choice(len(KINDS), p=[0.28, 0.24, 0.16, 0.09, 0.12, 0.11])
    return (_inkjet, _laser, _copier, _scanner, _shredder, _label)[kind](rng).object()


def _case(rng: np.random.Generator) -> Material:
    """White, grey or black plastic, now and then a colour."""
    kind = rng.choice(4, p=[0.36, 0.22, 0.2, 0.22])
    if kind == 0:
        return materials.white_plastic(rng)
    if kind == 1:
        return plain(hsv(rng, (0.05, 0.65), (0.0, 0.08), (0.35, 0.8)))
    if kind == 2:
        return materials.dark(rng)
    return plain(hsv(rng, (0, 1), (0.2, 0.85), (0.35, 0.9)))


def _second(rng, face: Material) -> Material:
    """A finish for moving parts: that of the case, darker, or another."""
    kind = rng.random()
    if kind < 0.35:
        return face
    return face.darker(float(rng.uniform(0.5, 0.85))) if kind < 0.6 else _case(rng)


def _slab(rng, depth: float, width: float, z0: float, z1: float, corner: float) -> Manifold:
    """A block from x = 0 to ``depth``, its upright edges rounded."""
    outline = rounded(depth, width, corner, 5) if corner > 0 else rounded(depth, width, 1e-4, 2)
    return extrusion(outline, "z", [depth / 2, 0, z0], z1 - z0)


def _drawers(rng, asm, root, rows, half, deep, unit, face, metal) -> None:
    """Paper drawers whose fronts stand before x = 0; ``rows``: (z0, z1) of each."""
    grip, pull = rng.integers(3), float(rng.uniform(0.4, 0.75)) * deep
    for z0, z1 in rows:
        x, gap = -0.3 * unit, 0.4 * unit
        front = box([x - 1.8 * unit, -half, z0], [x, half, z1])
        inner = half - 2.2 * unit
        tub = box([x - 1e-3, -inner, z0 + gap], [0.86 * deep, inner, z1 - gap])
        tub -= box(
            [0.6 * unit, unit - inner, z0 + gap + unit], [0.86 * deep - unit, inner - unit, 2]
        )
        if grip == 0:  # a recess below its upper edge
            front -= box(
                [-1, -0.3 * half, z1 - 0.4 * (z1 - z0)], [x - 0.8 * unit, 0.3 * half, z1 - unit]
            )
        shape = Shape().add(union([front, tub]), face)
        z = (z0 + z1) / 2
        if grip == 1:
            shape.add(
                box(
                    [x - 3 * unit, -0.25 * half, z - unit], [x - 1.8 * unit, 0.25 * half, z + unit]
                ),
                metal,
            )
        elif grip == 2:
            mark = box(
                [x - 2 * unit, 0.6 * half, z - unit], [x - 1.8 * unit, 0.75 * half, z + unit]
            )
            shape.add(mark, metal)
        asm.add("drawer", shape, root, slide((-1, 0, 0), pull))


def _wells(rows, half, deep, unit) -> list[Manifold]:
    """The rooms of the drawers of ``_drawers``."""
    inner = half - 1.8 * unit
    return [box([-1, -inner, z0], [0.86 * deep + 0.5 * unit, inner, z1]) for z0, z1 in rows]


def _lid(rng, asm, root, size, corner, z, unit, face, feeder: bool, swing=(60, 95)) -> None:
    """A cover over the scanner's glass hinged behind; with a sheet feeder on it, if wanted."""
    depth, width = size
    thick = float(rng.uniform(2, 5)) * unit
    low = z + 0.3 * unit
    solid = _slab(rng, depth, width, low, low + thick, corner)
    shape, top = Shape(), low + thick
    if feeder:
        high, half = float(rng.uniform(5, 10)) * unit, 0.42 * width
        y0 = -half if rng.random() < 0.5 else -0.1 * width
        hump = box([0.12 * depth, y0, top - 1e-4], [0.85 * depth, y0 + 0.5 * width, top + high])
        ramp = np.array(
            [
                [top, 0.2 * depth],
                [top + 0.6 * high, 0.2 * depth],
                [top + 0.9 * high, 0.8 * depth],
                [top, 0.8 * depth],
            ]
        )
        other = y0 + 0.5 * width + 0.2 * unit
        room = max(0.5 * width - 3 * unit - other, 4 * unit)
        ledge = extrusion(ramp - [1e-4, 0], "y", [0, other, 0], min(room, 0.35 * width))
        solid += hump
        shape.add(ledge - solid, face.darker(0.7))
    elif rng.random() < 0.3:  # a raised field
        solid += _slab(rng, 0.8 * depth, 0.8 * width, top - 1e-4, top + unit, 0).translate(
            (0.1 * depth, 0, 0)
        )
    shape.add(solid, face)
    pad = box([0.12 * depth, -0.4 * width, z + 0.05 * unit], [0.88 * depth, 0.4 * width, low])
    shape.add(pad, plain((0.95, 0.95, 0.95)))
    if rng.random() < 0.5:  # a lip to lift it by
        tab = box([-1.2 * unit, -0.18 * width, low], [0.2 * depth, 0.18 * width, low + 0.5 * thick])
        shape.add(tab - solid, face.darker(0.8))
    joint = hinge((depth, 0, low), (0, 1, 0), float(np.deg2rad(rng.uniform(*swing))))
    asm.add("lid", shape, root, joint)


def _flap(rng, asm, root, name, span, unit, face, **options) -> None:
    """A flap or door before the plane x = options['x'], hinged at one side: bottom, top, left,
    right."""
    y0, y1, z0, z1 = span
    x, side = options.get("x", 0.0) - 0.3 * unit, options.get("side", "bottom")
    thick = options.get("thick", 1.6 * unit)
    front, y, z = x - thick, (y0 + y1) / 2, (z0 + z1) / 2
    leaf = box([front, y0, z0], [x, y1, z1])
    w, h = 0.16 * (y1 - y0), min(0.14 * (z1 - z0), 1.4 * unit)
    dz = {"bottom": z1 - 2 * h, "top": z0 + 2 * h}.get(side, z)
    dy = {"left": y1 - 2.4 * h, "right": y0 + 2.4 * h}.get(side, y)
    if side in ("left", "right"):
        w, h = h, 0.14 * (z1 - z0)
    shape = Shape()
    if rng.random() < 0.6:
        leaf -= box([front - 1, dy - w, dz - h], [front + 0.5 * thick, dy + w, dz + h])
    else:
        shape.add(box([front - unit, dy - w, dz - h], [front, dy + w, dz + h]), face.darker(0.6))
    shape.add(leaf, face)
    at, axis = {
        "left": ((front, y0, 0), (0, 0, 1)),
        "right": ((front, y1, 0), (0, 0, -1)),
        "bottom": ((front, 0, z0), (0, -1, 0)),
        "top": ((front, 0, z1), (0, 1, 0)),
    }[side]
    angle = float(np.deg2rad(rng.uniform(*options.get("swing", (70, 100)))))
    asm.add(name, shape, root, hinge(at, axis, angle))


def _screen(shape: Shape, rng, x, span, unit, keys: bool) -> None:
    """A dark screen and keys that do not move, on the plane ``x``."""
    y0, y1, z0, z1 = span
    w, h = y1 - y0, z1 - z0
    a = y0 + 0.3 * w if keys else y0 + 0.12 * w
    glow = (
        plain(hsv(rng, (0.5, 0.7), (0.2, 0.7), (0.2, 0.8)))
        if rng.random() < 0.5
        else materials.dark_glass(rng)
    )
    shape.add(
        box(
            [x - 0.4 * unit, a, z0 + 0.14 * h], [x, a + (0.4 if keys else 0.76) * w, z1 - 0.14 * h]
        ),
        glow,
    )
    if keys:
        tone = plain(rng.uniform(0.3, 0.9, 3))
        for c in (y0 + 0.08 * w, y0 + 0.18 * w, y0 + 0.78 * w, y0 + 0.9 * w):
            for z in (z0 + 0.3 * h, z0 + 0.7 * h):
                r = min(0.025 * w, 0.16 * h)
                shape.add(box([x - 0.5 * unit, c - r, z - r], [x, c + r, z + r]), tone)


def _tilting(rng, asm, root, span, unit, face, x=0.0) -> None:
    """A control panel before x, hinged at its upper edge, that swings up to face the user."""
    y0, y1, z0, z1 = span
    shape, back = Shape(), x - 0.3 * unit
    thick = float(rng.uniform(1.5, 2.6)) * unit
    shape.add(box([back - thick, y0, z0], [back, y1, z1]), face)
    _screen(shape, rng, back - thick, span, unit, (y1 - y0) > 2.5 * (z1 - z0))
    most = float(np.deg2rad(rng.uniform(35, 80)))
    asm.add("panel", shape, root, hinge((back - thick, 0, z1), (0, 1, 0), most))


def _inkjet(rng) -> Assembly:
    """A low printer: a scanner's lid or a cover, a panel, a flap for paper, perhaps a cassette."""
    wide = float(rng.uniform(0.38, 0.5))
    deep, high = wide * float(rng.uniform(0.68, 0.9)), wide * float(rng.uniform(0.3, 0.48))
    unit, half = wide / 100, wide / 2
    corner = float(rng.choice([0.0, rng.uniform(1, 7)])) * unit
    face = _case(rng)
    second = _second(rng, face)
    asm, body, holes = Assembly(), Shape(), []
    edge = corner + unit
    strip = high * float(rng.uniform(0.24, 0.34))  # of the panel
    cassette = rng.random() < 0.5
    tray = (2 * unit, 2 * unit + 0.24 * high) if cassette else (0.0, unit)
    flap = (-0.72 * half, 0.72 * half, tray[1] + unit, high - strip - 1.4 * unit)
    panel = (edge - half, half - edge, high - strip, high - 0.8 * unit)
    style = rng.choice(["tilts", "fixed", "buttons"], p=[0.45, 0.3, 0.25])
    holes.append(
        box([-1, flap[0] + unit, flap[2] + unit], [0.7 * deep, flap[1] - unit, flap[3] - unit])
    )
    if cassette:
        holes += _wells([tray], 0.76 * half, deep, unit)
    z, buttons = (panel[2] + panel[3]) / 2, []
    if style == "buttons":
        size = 0.36 * strip
        ys = np.linspace(0.25, 0.75, int(rng.integers(1, 4))) * half
        buttons = [Button(y, z, 2 * size, 1.5 * size, bool(rng.random() < 0.5)) for y in ys]
        buttons = [Button(b.y, z, 1.5 * size, 1.5 * size, buttons[0].round) for b in buttons][:3]
        g = 0.75 * size + 0.4 * unit
        holes += [box([-1, b.y - g, z - g], [3 * unit, b.y + g, z + g]) for b in buttons]
    glass = box([0.12 * deep, -0.4 * wide, high - 0.3 * unit], [0.88 * deep, 0.4 * wide, high + 1])
    body.add(tidy(cut(_slab(rng, deep, wide, 0, high, corner), [*holes, glass])), face)
    pane = box(
        [0.12 * deep + 2e-4, 2e-4 - 0.4 * wide, high - 0.3 * unit],
        [0.88 * deep - 2e-4, 0.4 * wide - 2e-4, high - 0.05 * unit],
    )
    body.add(pane, materials.dark_glass(rng))
    if style != "tilts":
        _screen(body, rng, 0.0, (edge - half, 0.1 * half, *panel[2:]), unit, rng.random() < 0.6)
    root = asm.add("body", body)
    _lid(rng, asm, root, (deep, wide), corner, high, unit, second, rng.random() < 0.3)
    if style == "tilts":
        y = panel[:2] if rng.random() < 0.5 else (-0.4 * half, 0.4 * half)
        _tilting(rng, asm, root, (*y, *panel[2:]), unit, _second(rng, face))
    add_buttons(asm, root, 0.0, buttons, 1.2 * unit, 1.6 * unit, _second(rng, face))
    _flap(rng, asm, root, "output_flap", flap, unit, second)
    if cassette:
        _drawers(rng, asm, root, [tray], 0.76 * half, deep, unit, second, face.darker(0.6))
    return asm


def _laser(rng) -> Assembly:
    """A printer of a block: sheets come out on top; a front door or flap, drawers, a side door."""
    wide = float(rng.uniform(0.34, 0.46))
    deep, high = wide * float(rng.uniform(0.85, 1.1)), wide * float(rng.uniform(0.55, 1.15))
    unit, half = max(wide, high) / 100, wide / 2
    corner = float(rng.choice([0.0, rng.uniform(1, 4)])) * unit
    face, edge = _case(rng), corner + unit
    second = _second(rng, face)
    asm, body = Assembly(), Shape()
    count = int(rng.choice([0, 1, 2], p=[0.2, 0.5, 0.3]))
    rows = [(2 * unit + k * 13 * unit, 14.4 * unit + k * 13 * unit) for k in range(count)]
    rows = [r for r in rows if r[1] < 0.55 * high]
    low = rows[-1][1] + unit if rows else 2.5 * unit
    strip = 0.16 * high
    door = (edge - half, half - edge, low, high - strip - unit)
    holes = _wells(rows, half - edge, deep, unit)
    inside = [0.6 * deep, door[1] - 2 * unit, door[3] - 2 * unit]
    holes.append(box([-1, door[0] + 2 * unit, low + 2 * unit], inside))
    ramp = np.array(
        [
            [high - 0.12 * high, 0.2 * deep],
            [high + 0.01, 0.2 * deep],
            [high + 0.01, 0.85 * deep],
            [high - 0.03 * high, 0.85 * deep],
        ]
    )
    exit_half = half - max(edge, 0.14 * wide)
    cover = rng.random() < 0.4
    if not cover:
        holes.append(extrusion(ramp, "y", [0, -exit_half, 0], 2 * exit_half))
    body.add(tidy(cut(_slab(rng, deep, wide, 0, high, corner), holes)), face)
    panel = (edge - half, half - edge, high - strip, high - unit)
    tilts = rng.random() < 0.35
    if not tilts:
        _screen(body, rng, 0.0, (0.1 * half, half - edge, *panel[2:]), unit, rng.random() < 0.6)
    root = asm.add("body", body)
    if tilts:
        _tilting(rng, asm, root, (0.0, *panel[1:]), unit, _second(rng, face))
    if cover:
        _lid(rng, asm, root, (deep, wide), corner, high, unit, second, rng.random() < 0.4)
    elif rng.random() < 0.5:  # a stop for the sheets, folded down into the slope
        x, w = 0.84 * deep, 0.5 * exit_half
        stop = box([0.5 * deep, -w, high + 0.2 * unit], [x, w, high + 1.4 * unit])
        stop += box([0.82 * deep, -w, high + 0.2 * unit], [0.95 * deep, w, high + 1.4 * unit])
        joint = hinge((0.95 * deep, 0, high + 0.2 * unit), (0, 1, 0), float(rng.uniform(0.8, 1.55)))
        asm.add("paper_stop", Shape().add(stop, _second(rng, face)), root, joint)
    _flap(
        rng,
        asm,
        root,
        "front_door",
        door,
        unit,
        second,
        thick=2 * unit,
        side="bottom" if rng.random() < 0.7 else str(rng.choice(["left", "right"])),
    )
    _drawers(rng, asm, root, rows, half - edge, deep, unit, second, face.darker(0.6))
    return asm


def _copier(rng) -> Assembly:
    """A copier that stands on the floor: a stack of drawers, a gap for the sheets, a scanner."""
    wide = float(rng.uniform(0.5, 0.68))
    deep, high = wide * float(rng.uniform(0.85, 1.05)), wide * float(rng.uniform(1.35, 1.8))
    unit, half = high / 100, wide / 2
    face, edge = _case(rng), 1.5 * unit
    second = _second(rng, face)
    asm, body = Assembly(), Shape()
    base, count = float(rng.uniform(3, 7)) * unit, int(rng.integers(2, 5))
    top = high * float(rng.uniform(0.42, 0.55))
    pitch = (top - base) / count
    rows = [
        (base + k * pitch + 0.4 * unit, base + (k + 1) * pitch - 0.4 * unit) for k in range(count)
    ]
    door = (edge - half, half - edge, top + 0.5 * unit, 0.68 * high)
    gap = (0.72 * high, 0.86 * high)
    through = box(
        [-1, -half + 0.1 * wide, gap[0]],
        [0.8 * deep, 2 if rng.random() < 0.5 else 0.42 * wide, gap[1]],
    )
    holes = [*_wells(rows, half - edge, deep, unit), through]
    holes.append(
        box(
            [-1, door[0] + 2 * unit, door[2] + 2 * unit],
            [0.5 * deep, door[1] - 2 * unit, door[3] - 2 * unit],
        )
    )
    body.add(tidy(cut(box([0, -half, base], [deep, half, high]), holes)), face)
    dark = materials.dark(rng)
    for x in (0.12 * deep, 0.88 * deep):
        for y in (-0.85 * half, 0.85 * half):
            body.add(cylinder("z", [x, y, 0], base, 2 * unit, segments=12), dark)
    table = rng.random() < 0.5
    if table:  # a tray that folds out at the left
        z = (top + high * 0.68) / 2
        body.add(
            box(
                [0.2 * deep, -half - 0.4 * unit, z - 8 * unit],
                [0.8 * deep, -half - 1e-4, z - 5 * unit],
            ),
            dark,
        )
    root = asm.add("body", body)
    _drawers(rng, asm, root, rows, half - edge, deep, unit, second, face.darker(0.6))
    _flap(
        rng,
        asm,
        root,
        "front_door",
        door,
        unit,
        second,
        side=str(rng.choice(["bottom", "left", "right"])),
    )
    _lid(rng, asm, root, (deep, wide), 0, high, unit, second, rng.random() < 0.65)
    if table:
        leaf = box(
            [0.15 * deep, -half - 2 * unit, z - 4.5 * unit],
            [0.85 * deep, -half - 0.4 * unit, z + 14 * unit],
        )
        joint = hinge(
            (0, -half - 2 * unit, z - 4.5 * unit), (1, 0, 0), float(np.deg2rad(rng.uniform(60, 85)))
        )
        asm.add("side_tray", Shape().add(leaf, second), root, joint)
    w = float(rng.uniform(0.2, 0.42)) * wide
    y = float(rng.uniform(-0.5, 0.5)) * (wide - 2 * w)
    span = (y - w / 2 - 0.1 * w, y + w / 2, 0.885 * high, 0.985 * high)
    _tilting(rng, asm, root, span, unit, _second(rng, face))
    return asm


def _scanner(rng) -> Assembly:
    """A flat scanner, or one that takes sheets through a chute with a folding stop."""
    wide = float(rng.uniform(0.25, 0.42))
    deep = wide * float(rng.uniform(0.7, 1.5))
    unit, half = max(wide, deep) / 100, wide / 2
    high = float(rng.uniform(9, 16)) * unit
    corner = float(rng.choice([0.0, rng.uniform(2, 7)])) * unit
    face = _case(rng)
    second = _second(rng, face)
    asm, body = Assembly(), Shape()
    count = int(rng.integers(1, 5))
    size, z = 3.4 * unit, 0.5 * high
    ys = np.linspace(-0.5, 0.5, count) * half if count > 1 else [0.0]
    if count > 1 and ys[1] - ys[0] < 6 * unit:
        ys = ys[::2]
    buttons = [Button(float(y), z, size, size, True) for y in ys]
    holes = [cylinder("x", [-1, b.y, z], 1 + 3 * unit, size / 2 + 0.4 * unit) for b in buttons]
    holes.append(box([0.1 * deep, -0.38 * wide, high - 0.3 * unit], [0.86 * deep, 0.38 * wide, 1]))
    body.add(tidy(cut(_slab(rng, deep, wide, 0, high, corner), holes)), face)
    body.add(
        box(
            [0.1 * deep + 2e-4, 2e-4 - 0.38 * wide, high - 0.3 * unit],
            [0.86 * deep - 2e-4, 0.38 * wide - 2e-4, high - 0.05 * unit],
        ),
        materials.dark_glass(rng),
    )
    root = asm.add("body", body)
    _lid(rng, asm, root, (deep, wide), corner, high, unit, second, rng.random() < 0.2)
    add_buttons(asm, root, 0.0, buttons, 1.4 * unit, 1.4 * unit, _second(rng, face))
    return asm


def _shredder(rng) -> Assembly:
    """A shredder: a head with a slot over a bin that is drawn out, or behind a door."""
    wide = float(rng.uniform(0.3, 0.44))
    deep, high = wide * float(rng.uniform(0.6, 0.85)), wide * float(rng.uniform(1.2, 1.9))
    unit, half = high / 100, wide / 2
    corner, head = (
        float(rng.choice([0.0, rng.uniform(2, 6)])) * unit,
        high * float(rng.uniform(0.2, 0.34)),
    )
    face, base = _case(rng), float(rng.choice([0.0, rng.uniform(4, 7)])) * unit
    second = _second(rng, face)
    asm, body = Assembly(), Shape()
    seam, edge = high - head, corner + 2 * unit
    slot = box(
        [0.42 * deep, -0.8 * half, seam + 0.4 * head], [0.42 * deep + 2.4 * unit, 0.8 * half, 2]
    )
    span = (edge - half, half - edge, base + 3 * unit, seam - 2 * unit)
    room = box([-1, span[0] + unit, span[2]], [deep - 3 * unit, span[1] - unit, span[3]])
    body.add(tidy(cut(_slab(rng, deep, wide, base, high, corner), [slot, room])), face)
    if base:
        for x in (0.18 * deep, 0.82 * deep):
            for y in (-0.8 * half, 0.8 * half):
                body.add(
                    cylinder("y", [x, y - unit, base / 2], 2 * unit, base / 2 - 1e-4),
                    materials.dark(rng),
                )
    z = seam + 0.55 * head
    _screen(body, rng, 0.0, (0.3 * half, 0.85 * half, z - 0.15 * head, z + 0.2 * head), unit, False)
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
        if rng.random() < 0.5:  # a window
            w, h = 0.5 * half, 0.25 * (span[3] - span[2])
            middle = span[2] + 0.45 * (span[3] - span[2])
            pane = box([x - 2.4 * unit, -w, middle - h], [x - 2 * unit, w, middle + h])
            shape = Shape().add(pane, materials.glass(rng))
        else:
            shape = Shape()
        shape.add(union([front, tub.translate((-1e-4, 0, 0))]), second)
        asm.add("bin", shape, root, slide((-1, 0, 0), float(rng.uniform(0.5, 0.85)) * deep))
    else:
        _flap(
            rng,
            asm,
            root,
            "door",
            span,
            unit,
            second,
            thick=2 * unit,
            swing=(80, 120),
            side=str(rng.choice(["left", "right", "bottom"], p=[0.4, 0.4, 0.2])),
        )
    if rng.random() < 0.6:  # a cover over the slot
        low = high + 0.3 * unit
        leaf = box([0.3 * deep, -0.86 * half, low], [0.62 * deep, 0.86 * half, low + 1.6 * unit])
        joint = hinge(
            (0.62 * deep, 0, low + 1.6 * unit), (0, 1, 0), float(np.deg2rad(rng.uniform(80, 150)))
        )
        asm.add("cover", Shape().add(leaf, second), root, joint)
    return asm


def _label(rng) -> Assembly:
    """A printer of labels or receipts: a lid hinged behind over a roll that turns; a knob."""
    wide = float(rng.uniform(0.12, 0.22))
    deep, high = wide * float(rng.uniform(0.9, 1.6)), wide * float(rng.uniform(0.7, 1.15))
    unit, half = max(wide, deep) / 100, wide / 2
    corner, wall = float(rng.choice([0.0, rng.uniform(2, 8)])) * unit, 4 * unit
    face = _case(rng)
    second = _second(rng, face)
    asm, body = Assembly(), Shape()
    seam = high * float(rng.uniform(0.45, 0.75))
    start = deep * float(rng.uniform(0.1, 0.35))  # of the lid
    rise = high - seam
    solid = _slab(rng, deep, wide, 0, seam, corner)
    room = box([start + 3 * unit, wall - half, wall], [deep - wall, half - wall, 2])
    front = _slab(rng, deep, wide, seam - 1e-4, high, corner) ^ box([-1, -1, 0], [start, 1, 2])
    z, y, g = 0.5 * seam, 0.55 * half, 3.9 * unit
    pocket = box([-1, y - g, z - g], [2.5 * unit, y + g, z + g])
    body.add(tidy(cut(union([solid, front]), [room, pocket])), face)
    _screen(body, rng, 0.0, (-0.7 * half, 0.2 * half, seam, high - 0.15 * rise), unit, False)
    button = Button(y, z, 7 * unit, 7 * unit, bool(rng.random() < 0.5))
    cutter = box([-unit, -0.6 * half, 0.22 * seam], [0, 0.1 * half, 0.22 * seam + 2 * unit])
    body.add(cutter, materials.metal(rng, brushed=False))
    root = asm.add("body", body)
    gap = 0.4 * unit
    lid = _slab(rng, deep, wide, seam + gap, high, corner) ^ box([start + gap, -1, 0], [3, 1, 2])
    hollow = box([start + 3 * unit, wall - half, 0], [deep - wall, half - wall, high - wall])
    shape = Shape().add(tidy(lid - hollow), second)
    if rng.random() < 0.5:
        window = box(
            [start + 8 * unit, -0.5 * half, high], [deep - 14 * unit, 0.5 * half, high + 0.6 * unit]
        )
        shape.add(window, materials.dark_glass(rng))
    joint = hinge((deep, 0, seam + gap), (0, 1, 0), float(np.deg2rad(rng.uniform(55, 100))))
    asm.add("lid", shape, root, joint)
    r = min(0.5 * (deep - start - wall - 3 * unit), 0.5 * (high - 2 * wall)) - 1.5 * unit
    if r > 8 * unit:
        x, zr = (start + 3 * unit + deep - wall) / 2, wall + 1.0 * unit + r
        roll = tube("y", [x, wall + unit - half, zr], 2 * (half - wall - unit), r, 0.35 * r)
        asm.add(
            "roll", Shape().add(roll, plain((0.95, 0.95, 0.93))), root, turn((x, 0, zr), (0, 1, 0))
        )
    add_buttons(asm, root, 0.0, [button], 2 * unit, 1.5 * unit, _second(rng, face))
    if rng.random() < 0.4:
        knob = cylinder("y", [0.4 * deep, half + 0.3 * unit, z], 4 * unit, 6 * unit, 5 * unit, 16)
        asm.add(
            "knob",
            Shape().add(knob, materials.dark(rng)),
            root,
            turn((0.4 * deep, 0, z), (0, 1, 0)),
        )
    return asm

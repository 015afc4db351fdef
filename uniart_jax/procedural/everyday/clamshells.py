"""Caskets, flat cases, scanners with a lid, and books: things that open at one edge, in metres."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.kinematics import Joint
from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.pieces import layered, merged
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cylinder,
    extrusion,
    hinge,
    inset,
    loft,
    rounded,
    slide,
    tidy,
    union,
)

ACROSS = (0, 1, 0)
Link = tuple[str, Shape, Joint]


def draw_finish(rng: np.random.Generator) -> Material:
    """Draw a finish: plastic of any colour, steel, white or black."""
    return materials.casing(rng, (0.25, 0.2, 0.25, 0.3))


def outline_of(rng, depth: float, wide: float, round_share: float) -> np.ndarray:
    """A plan [n, 2] in metres about 0: a rectangle with rounded corners, or an ellipse."""
    if rng.random() < round_share:
        angle = np.linspace(0, 2 * np.pi, 36, endpoint=False)
        return np.column_stack([depth / 2 * np.cos(angle), wide / 2 * np.sin(angle)])
    return rounded(depth, wide, float(rng.uniform(0.01, 0.3)) * min(depth, wide), 6)


def casket(rng: np.random.Generator) -> Assembly:
    """A jewellery box or chest in metres: a hollow lid, drawers below, a clasp and a lining."""
    wide = float(rng.uniform(0.14, 0.4))
    depth = wide * float(rng.uniform(0.5, 1.0))
    high = wide * float(rng.uniform(0.25, 0.85))
    unit, half = wide / 100, wide / 2
    count = int(np.clip(high / unit // 16 - 1, 0, 3)) if rng.random() < 0.65 else 0
    tone = materials.wood(rng) if rng.random() < 0.55 else draw_finish(rng)
    trim, wall, air = materials.hardware(rng), 2.4 * unit, 0.5 * unit
    legs = float(rng.choice([0.0, 2.0, 4.0])) * unit
    rows = count * 13 * unit + (2 * unit if count else 0)
    floor = legs + rows
    seam = floor + (high - rows) * float(rng.uniform(0.4, 0.7))
    top = floor + high - rows
    plan = rounded(depth, wide, float(rng.uniform(0.2, 12 if not count else 3)) * unit, 5)
    crown = float(rng.choice([1.0, 1.0, 0.85, 0.7]))
    lower, upper = _shell(plan, depth, floor, seam, top, wall, air, crown)
    body, lining = [], plain(materials.hsv(rng, (0, 1), (0.3, 0.9), (0.2, 0.7)))
    if count:
        body.append(extrusion(plan, "z", [depth / 2, 0, legs], rows + wall))
    drawers = []
    for k in range(count):
        lo = np.array([0.0, -half + wall + air, legs + (2 + 13 * k) * unit])
        hi = np.array([depth - 2 * wall, half - wall - air, lo[2] + 11.4 * unit])
        body[0] -= box([-1, *(lo[1:] - air)], hi + air)
        solid = box(lo, hi) - box([wall, lo[1] + wall, lo[2] + wall], [*(hi[:2] - wall), 9])
        pull = cylinder("x", [-2.4 * unit, 0, lo[2] + 5.7 * unit], 2.4 * unit + 1e-4, 2.2 * unit)
        shape = layered([(solid, tone), (pull, trim)])
        drawers.append(("drawer", shape, slide((-1, 0, 0), float(rng.uniform(0.4, 0.75)) * depth)))
    pad = extrusion(inset(plan, 1.4 * wall), "z", [depth / 2, 0, floor + wall], 2 * unit)
    pieces = [(union([lower, *body]), tone), (pad, lining)]
    if legs:
        feet = [
            box([x, s * 0.8 * half - 4 * unit, 0], [x + 8 * unit, s * 0.8 * half + 4 * unit, legs])
            for x in (0.06 * depth, 0.94 * depth - 8 * unit)
            for s in (-1, 1)
        ]
        pieces.append((union(feet), trim))
    asm = Assembly()
    root = asm.add("body", layered(pieces))
    lid = [(upper, tone)]
    if top - seam > 3 * wall and rng.random() < 0.4:
        glass = crown * inset(plan, 2.5 * wall)
        lid.append((extrusion(glass, "z", [depth / 2, 0, top - 1e-4], 0.8 * unit), trim))
    swing = np.deg2rad(float(rng.uniform(75, 125)))
    cover = asm.add("lid", layered(lid), root, hinge([depth, 0, seam + air], ACROSS, swing))
    for name, shape, joint in drawers:
        asm.add(name, shape, root, joint)
    if rng.random() < 0.5 and top - seam > 5 * unit and crown > 0.8:
        w, z = float(rng.uniform(3, 6)) * unit, seam + air + 2.6 * unit
        hasp = box([-2 * unit, -w, z - 7 * unit], [-0.5 * unit, w, z])
        hasp += cylinder("y", [-1.25 * unit, -w, z], 2 * w, 0.75 * unit, segments=10)
        joint = hinge([-1.25 * unit, 0, z], ACROSS, np.deg2rad(float(rng.uniform(70, 120))))
        asm.add("clasp", Shape().add(tidy(hasp), trim), cover, joint)
    return asm


def _shell(plan, depth, z0, seam, top, wall, air, crown) -> tuple[Manifold, Manifold]:
    """A tray and a hollow lid over it. The lid's top is ``crown`` times the plan."""
    mid, low = depth / 2, seam + air
    inner = inset(plan, wall)
    body = extrusion(plan, "z", [mid, 0, z0], seam - z0)
    body -= extrusion(inner, "z", [mid, 0, z0 + wall], 9)
    lid = loft(plan, plan * crown, low, top).translate((mid, 0, 0))
    if top - low > 2.2 * wall:
        lid -= loft(inner, inner * crown, low - 1e-3, top - wall).translate((mid, 0, 0))
    return body, lid


def compact(rng: np.random.Generator) -> Assembly:
    """A flat case in metres: a mirror, a palette, a tin or a pizza box. Its lid is hinged, or
    swings on a pin."""
    wide = float(rng.uniform(0.06, 0.3))
    depth = wide * float(rng.uniform(0.55, 1.05))
    unit = wide / 100
    plan = outline_of(rng, depth, wide, 0.45)
    thick, air, wall = float(rng.uniform(5, 14)) * unit, 0.5 * unit, 2.4 * unit
    seam = thick * float(rng.uniform(0.4, 0.65))
    if seam - wall < 1.5 * unit:
        seam = wall + 1.5 * unit
    top = max(thick, seam + air + 3 * unit)
    mid = depth / 2
    body = extrusion(plan, "z", [mid, 0, 0], seam)
    well = extrusion(inset(plan, 2 * wall), "z", [mid, 0, wall], 9)
    tone, trim = draw_finish(rng), materials.hardware(rng)
    pieces, slots = [(body - well, tone)], int(rng.choice([1, 2, 3, 4]))
    room = extrusion(inset(plan, 2.6 * wall), "z", [mid, 0, wall], max(seam - 1.4 * wall, unit))
    for k in range(slots):
        y = [(-1 + 2 * (k + s) / slots) * 0.92 * wide / 2 for s in (0.06, 0.94)]
        part = room ^ box([-1, y[0], 0], [2, y[1], 1])
        pieces.append((part, plain(materials.hsv(rng, (0, 1), (0.1, 0.8), (0.4, 0.95)))))
    lid = loft(plan, plan * float(rng.uniform(0.86, 1)), seam + air, top).translate((mid, 0, 0))
    pinned = rng.random() < 0.25
    glass = extrusion(inset(plan, 2 * wall), "z", [mid, 0, seam + air - 1], 1 + unit)
    mirror = extrusion(inset(plan, 2.2 * wall), "z", [mid, 0, seam + air + 0.3 * unit], 0.7 * unit)
    cover = [(lid - glass, tone if rng.random() < 0.7 else draw_finish(rng))]
    cover.append((mirror, materials.glass(rng)))
    if rng.random() < 0.6:
        emblem = plan * float(rng.uniform(0.25, 0.75))
        cover.append((extrusion(emblem, "z", [mid, 0, top - 1e-4], 0.6 * unit), draw_finish(rng)))
    asm = Assembly()
    asm.add("body", layered(pieces))
    if pinned:
        side = float(rng.choice([-1, 1]))
        axis = hinge([mid, side * 0.44 * wide, 0], (0, 0, -side), np.deg2rad(rng.uniform(90, 175)))
    else:
        r, w = 1.4 * unit, 0.2 * wide
        tab = cylinder("y", [depth + 0.4 * unit, -w, seam + air + r], 2 * w, r, segments=12)
        cover.append((tab - lid, trim))
        axis = hinge([depth + 0.4 * unit, 0, seam + air], ACROSS, np.deg2rad(rng.uniform(90, 175)))
        tongue = box([-2 * unit, -0.1 * wide, seam + air], [mid, 0.1 * wide, seam + air + 2 * unit])
        cover.append((tongue - lid - glass, trim))
    asm.add("lid", layered(cover), 0, axis)
    return asm


def scanner(rng: np.random.Generator) -> Assembly:
    """A scanner or copier in metres: a lid over glass, a panel with keys in front or beside,
    drawers."""
    wide = float(rng.uniform(0.35, 0.6))
    depth = wide * float(rng.uniform(0.65, 1.2))
    unit, half, air = max(wide, depth) / 100, wide / 2, 0.4 * max(wide, depth) / 100
    copier = rng.random() < 0.5
    high = float(rng.uniform(25, 80) if copier else rng.uniform(7, 16)) * unit
    tone = materials.white_plastic(rng) if rng.random() < 0.5 else draw_finish(rng)
    dark = materials.dark(rng)
    rim = float(rng.uniform(12, 22)) * unit  # of the panel
    beside = not copier and rng.random() < 0.4
    plan = rounded(depth, wide, float(rng.uniform(0.5, 5)) * unit, 5)
    body = extrusion(plan, "z", [depth / 2, 0, 0], high)
    lo, hi = np.array([rim, -half]), np.array([depth - 0.5 * unit, half])
    if beside:
        lo = np.array([0.0, -half + rim])
    pane = box([*(lo + 4 * unit), high - 1e-4], [*(hi - 4 * unit), high + 0.3 * unit])
    links, drop = [], 0.0
    if not beside:
        drop = float(rng.uniform(0, 0.35)) * rim
        body -= extrusion(
            np.array(
                [
                    [high - drop, -0.01],
                    [high - drop, 0],
                    [high, rim - unit],
                    [high + 1, rim - unit],
                    [high + 1, -0.01],
                ]
            ),
            "y",
            [0, -half - 1, 0],
            wide + 2,
        )
    trays = int(rng.integers(1, 4)) if copier and high > 30 * unit else 0
    step = (high - drop - 8 * unit) / max(trays, 3)
    for k in range(trays):
        z, w = 2 * unit + k * step, 0.86 * half
        body -= box([-1, -w - air, z - air], [0.8 * depth + air, w + air, z + step - unit])
        tray = box([0, -w, z], [0.8 * depth, w, z + step - 2 * unit])
        tray -= box([2 * unit, 2 * unit - w, z + 2 * unit], [0.78 * depth, w - 2 * unit, 9])
        grip = box([-1.5 * unit, -0.3 * w, z + 0.55 * step], [1e-4, 0.3 * w, z + 0.75 * step])
        shape = layered([(tray, tone), (grip, dark)])
        links.append(("drawer", shape, slide((-1, 0, 0), float(rng.uniform(0.35, 0.65)) * depth)))
    if trays and rng.random() < 0.5:
        z = 2 * unit + trays * step
        body -= box(
            [-1, -0.6 * half, z],
            [0.3 * depth, 0.6 * half, min(z + 5 * unit, high - drop - 3 * unit)],
        )
    pieces = [(tidy(body), tone), (pane, materials.glass(rng))]
    size = float(rng.uniform(2.2, 3.2)) * unit
    count = int(rng.choice([1, 2, 3]))
    lean = float(np.arctan2(drop, rim - unit))
    for k in range(count):  # keys on the panel, pressed down
        at = np.array([0.5 * rim, (-0.8 + 0.2 * k) * half, high - 0.5 * drop])
        if beside:
            at = np.array([(0.2 + 0.2 * k) * depth, -half + 0.5 * rim, high])
        key = box([-size, -size, -0.3 * unit], [size, size, 1.4 * unit])
        hole = box([-size - air, -size - air, -2 * unit], [size + air, size + air, 1]).rotate(
            (0, -np.rad2deg(lean), 0)
        )
        pieces[0] = (pieces[0][0] - hole.translate(at), tone)
        key = key.rotate((0, -np.rad2deg(lean), 0)).translate(at)
        down = (np.sin(lean), 0, -np.cos(lean))
        links.append(("button", merged([(key, draw_finish(rng))]), slide(down, 1.1 * unit)))
    asm = Assembly()
    root = asm.add("body", layered(pieces))
    low, thick = high + 0.8 * unit, float(rng.uniform(3, 6)) * unit
    outline = rounded(hi[0] - lo[0], hi[1] - lo[1], float(rng.uniform(0.3, 4)) * unit)
    mid = (lo + hi) / 2
    cover = [(extrusion(outline, "z", [*mid, low], thick), tone if rng.random() < 0.6 else dark)]
    feeder = rng.random() < 0.35
    if feeder:
        a, b = lo + [3 * unit, 4 * unit], hi - [6 * unit, 0.45 * wide]
        hump = rounded(b[0] - a[0], b[1] - a[1], 4 * unit)
        tall = float(rng.uniform(6, 12)) * unit
        hump = loft(hump, 0.85 * hump, 0, tall).translate((*((a + b) / 2), low + thick - 1e-4))
        cover.append((hump, tone))
    grip = box([lo[0] - 1.5 * unit, -8 * unit, low], [mid[0], 8 * unit, low + 2 * unit])
    cover.append((grip, dark))
    most = np.deg2rad(float(rng.uniform(60, 95)))
    asm.add("lid", layered(cover), root, hinge([hi[0], 0, low], ACROSS, most))
    for name, shape, joint in links:
        asm.add(name, shape, root, joint)
    return asm


def book(rng: np.random.Generator) -> Assembly:
    """A book, album or binder in metres, lying or upright: a cover that opens about the spine, a
    strap at times."""
    wide = float(rng.uniform(0.14, 0.32))
    depth = wide * float(rng.uniform(0.75, 1.5))
    unit = max(wide, depth) / 100
    thick = float(rng.uniform(7, 26)) * unit
    board, air = float(rng.uniform(1.6, 2.4)) * unit, 0.4 * unit
    tone = plain(materials.hsv(rng, (0, 1), (0.2, 0.9), (0.15, 0.8)))
    paper = plain(materials.hsv(rng, (0.08, 0.16), (0.0, 0.25), (0.8, 0.98)))
    side = float(rng.choice([-1, 1]))  # of the spine
    half, over = wide / 2, float(rng.uniform(0.3, 2.5)) * unit
    binder = thick > 12 * unit and rng.random() < 0.5
    base = box([0, -half, 0], [depth, half, board])
    edge = half - board
    lo, hi = sorted((side * edge, side * half))
    spine = box([0, lo, 0], [depth, hi, thick - board - air])
    a, b = sorted((side * (edge - (6 * unit if binder else 0)), -side * (half - over)))
    block = box([over, a, board], [depth - over, b, thick - board - 2 * air])
    if binder:
        block = block.scale((1, 1, 0.6)).translate((0, 0, 0.4 * board))
        at = [0.3 * depth, side * (edge - 3.5 * unit), 0.4 * thick]
        ring = cylinder("x", at, 0.4 * depth, 3.6 * unit)
        block += ring ^ box([0, -half, board], [depth, half, 9])
    pieces = [(base + spine, tone), (block, paper)]
    cover = [(box([0, -half, thick - board], [depth, half, thick]), tone)]
    for _ in range(int(rng.integers(0, 3))):  # a title, a picture
        p, q = rng.uniform(0.08, 0.5, 2), rng.uniform(0.55, 0.92, 2)
        z = thick + float(rng.uniform(0.3, 0.5)) * unit
        label = box(
            [p[0] * depth, (p[1] - 0.5) * wide, thick - 1e-4],
            [q[0] * depth, (q[1] - 0.5) * wide, z],
        )
        cover.append((label, plain(rng.uniform(0.1, 0.95, 3))))
    asm = Assembly()
    root = asm.add("body", layered(pieces))
    axis = hinge([0, side * half, thick - board], (side, 0, 0), -np.deg2rad(rng.uniform(95, 178)))
    asm.add("cover", layered(cover), root, axis)
    if rng.random() < 0.35:  # a strap over the free edge, held by the lower cover
        w, y = float(rng.uniform(4, 9)) * unit, -side * (half + 0.5 * unit)
        c, d = sorted((y, y - side * 1.6 * unit))
        strap = box([depth / 2 - w, c, 0], [depth / 2 + w, d, thick + 2.2 * unit])
        c, d = sorted((y, -side * (half - 9 * unit)))
        strap += box([depth / 2 - w, c, thick + 0.7 * unit], [depth / 2 + w, d, thick + 2.2 * unit])
        joint = hinge([0, -side * half, 0], (side, 0, 0), np.deg2rad(rng.uniform(70, 120)))
        asm.add("strap", Shape().add(tidy(strap), materials.dark(rng)), root, joint)
    if rng.random() < 0.3:  # upright, its spine in front, behind or at a side
        yaw = np.deg2rad(float(rng.choice([0, 90, 180, 270])))
        c, s = np.cos(yaw), np.sin(yaw)
        lift = np.array([[0.0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]])
        turned = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]) @ lift
        asm.parts = list(asm.object().transformed(turned).parts)
    return asm

"""Parts of printers and copiers: finishes, paper drawers, lids over a scanner's glass, flaps,
screens and panels that tilt. Lengths are in metres; ``unit`` is a hundredth of the object's
size."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.case_fronts import Span, open_at
from uniart_jax.procedural.materials import Material, hsv, plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    extrusion,
    hinge,
    rounded,
    slide,
    union,
)

Rows = list[tuple[float, float]]  # of drawers: z0, z1 of each


def draw_finish(rng: np.random.Generator) -> Material:
    """Draw the finish of a case: white, grey or black plastic, at times a colour."""
    kind = rng.choice(4, p=[0.36, 0.22, 0.2, 0.22])
    if kind == 0:
        return materials.white_plastic(rng)
    if kind == 1:
        return plain(hsv(rng, (0.05, 0.65), (0.0, 0.08), (0.35, 0.8)))
    if kind == 2:
        return materials.dark(rng)
    return plain(hsv(rng, (0, 1), (0.2, 0.85), (0.35, 0.9)))


def draw_second(rng, face: Material) -> Material:
    """Draw the finish of moving parts: that of the case, darker, or another."""
    kind = rng.random()
    if kind < 0.35:
        return face
    return face.darker(float(rng.uniform(0.5, 0.85))) if kind < 0.6 else draw_finish(rng)


def block(depth: float, width: float, z0: float, z1: float, corner: float) -> Manifold:
    """A block in metres from x = 0 to ``depth``, its upright edges rounded by ``corner``."""
    outline = rounded(depth, width, corner, 5) if corner > 0 else rounded(depth, width, 1e-4, 2)
    return extrusion(outline, "z", [depth / 2, 0, z0], z1 - z0)


def add_drawers(
    rng, asm: Assembly, root: int, rows: Rows, half, deep, unit, face: Material, metal: Material
) -> None:
    """Add paper drawers whose fronts stand in front of x = 0; ``rows`` holds the (z0, z1) of each,
    metres."""
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
            at, w = x - 1.8 * unit, 0.25 * half
            shape.add(box([x - 3 * unit, -w, z - unit], [at, w, z + unit]), metal)
        elif grip == 2:
            mark = box(
                [x - 2 * unit, 0.6 * half, z - unit], [x - 1.8 * unit, 0.75 * half, z + unit]
            )
            shape.add(mark, metal)
        asm.add("drawer", shape, root, slide((-1, 0, 0), pull))


def drawer_rooms(rows: Rows, half: float, deep: float, unit: float) -> list[Manifold]:
    """The holes (metres) to cut into the body for ``add_drawers``."""
    inner = half - 1.8 * unit
    return [box([-1, -inner, z0], [0.86 * deep + 0.5 * unit, inner, z1]) for z0, z1 in rows]


def scanner_glass(x: tuple[float, float], half: float, high: float, unit: float) -> Manifold:
    """The glass of a scanner (metres) in a recess that is 0.3 ``unit`` deep below z = ``high``."""
    lo = [x[0] + 2e-4, 2e-4 - half, high - 0.3 * unit]
    return box(lo, [x[1] - 2e-4, half - 2e-4, high - 0.05 * unit])


def add_lid(
    rng, asm: Assembly, root: int, size, corner, z, unit, face: Material, feeder: bool
) -> None:
    """Add a lid (metres) over the scanner's glass, hinged at the rear, with a sheet feeder on it if
    ``feeder``."""
    depth, width = size
    thick = float(rng.uniform(2, 5)) * unit
    low = z + 0.3 * unit
    solid = block(depth, width, low, low + thick, corner)
    shape, top = Shape(), low + thick
    if feeder:
        high, half = float(rng.uniform(5, 10)) * unit, 0.42 * width
        y0 = -half if rng.random() < 0.5 else -0.1 * width
        hump = box([0.12 * depth, y0, top - 1e-4], [0.85 * depth, y0 + 0.5 * width, top + high])
        near, far = 0.2 * depth, 0.8 * depth
        ramp = np.array(
            [[top, near], [top + 0.6 * high, near], [top + 0.9 * high, far], [top, far]]
        )
        other = y0 + 0.5 * width + 0.2 * unit
        room = max(0.5 * width - 3 * unit - other, 4 * unit)
        ledge = extrusion(ramp - [1e-4, 0], "y", [0, other, 0], min(room, 0.35 * width))
        solid += hump
        shape.add(ledge - solid, face.darker(0.7))
    elif rng.random() < 0.3:  # a raised field
        field = block(0.8 * depth, 0.8 * width, top - 1e-4, top + unit, 0)
        solid += field.translate((0.1 * depth, 0, 0))
    shape.add(solid, face)
    pad = box([0.12 * depth, -0.4 * width, z + 0.05 * unit], [0.88 * depth, 0.4 * width, low])
    shape.add(pad, plain((0.95, 0.95, 0.95)))
    if rng.random() < 0.5:  # a lip to lift it by
        tab = box([-1.2 * unit, -0.18 * width, low], [0.2 * depth, 0.18 * width, low + 0.5 * thick])
        shape.add(tab - solid, face.darker(0.8))
    joint = hinge((depth, 0, low), (0, 1, 0), float(np.deg2rad(rng.uniform(60, 95))))
    asm.add("lid", shape, root, joint)


def add_flap(
    rng,
    asm: Assembly,
    root: int,
    name: str,
    span: Span,
    unit: float,
    face: Material,
    *,
    side: str = "bottom",
    thick: float | None = None,
    swing: tuple[float, float] = (70, 100),
) -> None:
    """Add a flap or door in front of x = 0, ``thick`` metres thick, hinged at ``side``: bottom,
    left or right. It opens by an angle within ``swing``, degrees."""
    y0, y1, z0, z1 = span
    x, thick = -0.3 * unit, 1.6 * unit if thick is None else thick
    front, y, z = x - thick, (y0 + y1) / 2, (z0 + z1) / 2
    leaf = box([front, y0, z0], [x, y1, z1])
    w, h = 0.16 * (y1 - y0), min(0.14 * (z1 - z0), 1.4 * unit)
    dz = z1 - 2 * h if side == "bottom" else z
    dy = {"left": y1 - 2.4 * h, "right": y0 + 2.4 * h}.get(side, y)
    if side in ("left", "right"):
        w, h = h, 0.14 * (z1 - z0)
    shape = Shape()
    if rng.random() < 0.6:
        leaf -= box([front - 1, dy - w, dz - h], [front + 0.5 * thick, dy + w, dz + h])
    else:
        shape.add(box([front - unit, dy - w, dz - h], [front, dy + w, dz + h]), face.darker(0.6))
    shape.add(leaf, face)
    asm.add(name, shape, root, open_at(rng, side, front, span, *swing))


def add_screen(shape: Shape, rng, x: float, span: Span, unit: float, keys: bool) -> None:
    """Add a screen (metres), dark or lit, on the plane ``x``, with fixed ``keys`` beside it."""
    y0, y1, z0, z1 = span
    w, h = y1 - y0, z1 - z0
    a = y0 + 0.3 * w if keys else y0 + 0.12 * w
    glow = (
        plain(hsv(rng, (0.5, 0.7), (0.2, 0.7), (0.2, 0.8)))
        if rng.random() < 0.5
        else materials.dark_glass(rng)
    )
    b = a + (0.4 if keys else 0.76) * w
    shape.add(box([x - 0.4 * unit, a, z0 + 0.14 * h], [x, b, z1 - 0.14 * h]), glow)
    if keys:
        tone = plain(rng.uniform(0.3, 0.9, 3))
        for c in (y0 + 0.08 * w, y0 + 0.18 * w, y0 + 0.78 * w, y0 + 0.9 * w):
            for z in (z0 + 0.3 * h, z0 + 0.7 * h):
                r = min(0.025 * w, 0.16 * h)
                shape.add(box([x - 0.5 * unit, c - r, z - r], [x, c + r, z + r]), tone)


def add_tilting_panel(
    rng, asm: Assembly, root: int, span: Span, unit: float, face: Material
) -> None:
    """Add a control panel (metres) in front of x = 0, hinged at its upper edge, that tilts up to
    face the user."""
    y0, y1, z0, z1 = span
    shape, back = Shape(), -0.3 * unit
    thick = float(rng.uniform(1.5, 2.6)) * unit
    shape.add(box([back - thick, y0, z0], [back, y1, z1]), face)
    add_screen(shape, rng, back - thick, span, unit, (y1 - y0) > 2.5 * (z1 - z0))
    most = float(np.deg2rad(rng.uniform(35, 80)))
    asm.add("panel", shape, root, hinge((back - thick, 0, z1), (0, 1, 0), most))

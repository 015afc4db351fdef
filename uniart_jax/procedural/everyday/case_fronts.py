"""Cases of sheet metal or wood with their doors and flaps: finishes, hinges, pulls, roofs and
posts. Lengths are in metres; ``unit`` is a hundredth of the object's size."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.kinematics import Joint
from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material, hsv, plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cylinder,
    extrusion,
    hinge,
    rounded,
)

Span = tuple[float, float, float, float]  # y0, y1, z0, z1


def draw_finish(rng: np.random.Generator) -> Material:
    """Draw the finish of a case: a signal colour, paint, steel, wood or black."""
    kind = rng.choice(5, p=[0.35, 0.25, 0.17, 0.13, 0.1])
    if kind == 0:
        hue = float(rng.choice([0.0, 0.14, 0.33, 0.6, rng.random()]))
        return plain(hsv(rng, (hue - 0.03, hue + 0.03), (0.5, 0.95), (0.3, 0.9)))
    if kind == 1:
        return materials.paint(rng)
    if kind == 2:
        return materials.metal(rng)
    return materials.wood(rng) if kind == 3 else materials.dark(rng)


def open_at(rng, side: str, x: float, span: Span, low: float, high: float) -> Joint:
    """The joint of a panel on the plane ``x`` (metres), hinged at ``side``: left, right, top or
    bottom. It opens by ``low`` to ``high`` degrees."""
    y0, y1, z0, z1 = span
    angle = float(np.deg2rad(rng.uniform(low, high)))
    at, axis = {
        "left": ((x, y0, 0), (0, 0, 1)),
        "right": ((x, y1, 0), (0, 0, -1)),
        "bottom": ((x, 0, z0), (0, -1, 0)),
        "top": ((x, 0, z1), (0, 1, 0)),
    }[side]
    return hinge(at, axis, angle)


def doorway(span: Span, inset: float, x: float) -> Manifold:
    """The solid to cut out of a front behind a panel at ``span`` (metres): smaller than it by
    ``inset`` all around, and as deep as ``x``."""
    y0, y1, z0, z1 = span
    return box([-1, y0 + inset, z0 + inset], [x, y1 - inset, z1 - inset])


def add_pull(
    rng, shape: Shape, side: str, x: float, span: Span, unit: float, metal: Material
) -> None:
    """Add a knob, a bar or a lock to a panel, near the side opposite to its hinge (metres)."""
    y0, y1, z0, z1 = span
    wide, tall = y1 - y0, z1 - z0
    edge = 0.13 * min(wide, tall) + unit
    y, z = (y0 + y1) / 2, (z0 + z1) / 2
    y = {"left": y1 - edge, "right": y0 + edge}.get(side, y)
    z = {"bottom": z1 - edge, "top": z0 + edge}.get(side, z)
    r = min(float(rng.uniform(1.3, 2.4)) * unit, 0.13 * min(wide, tall))
    kind = rng.integers(3)
    if kind == 0:
        shape.add(cylinder("x", [x - 2.2 * r, y, z], 2.2 * r, r, 0.6 * r, 16), metal)
    elif kind == 1:
        shape.add(cylinder("x", [x - 0.7 * unit, y, z], 0.7 * unit, r, segments=16), metal)
        slit = box(
            [x - 1.2 * unit, y - 0.2 * r, z - 0.6 * r], [x - 0.7 * unit, y + 0.2 * r, z + 0.6 * r]
        )
        shape.add(slit, materials.dark(rng))
    else:
        long = 0.16 * (tall if side in ("left", "right") else wide)
        dy, dz = (0.6 * r, long) if side in ("left", "right") else (long, 0.6 * r)
        shape.add(box([x - 1.6 * unit, y - dy, z - dz], [x, y + dy, z + dz]), metal)


def draw_plate(rng, x: float, span: Span, thick: float) -> Manifold:
    """A panel ``thick`` metres thick in front of the plane ``x``, its corners square or rounded."""
    y0, y1, z0, z1 = span
    corner = float(rng.choice([0.0, 0.08])) * min(y1 - y0, z1 - z0)
    if corner == 0:
        return box([x - thick, y0, z0], [x, y1, z1])
    outline = rounded(y1 - y0, z1 - z0, corner, 4)
    return extrusion(outline, "x", [x - thick, (y0 + y1) / 2, (z0 + z1) / 2], thick)


def add_panel(
    rng,
    asm: Assembly,
    parent: int,
    name: str,
    side: str,
    span: Span,
    unit: float,
    face: Material,
    metal: Material,
    *,
    x: float = 0.0,
    thick: float | None = None,
    pull: bool = True,
    marked: bool = False,
    swing: tuple[float, float] = (80, 130),
) -> int:
    """Add a door or flap in front of the plane ``x``, hinged at ``side`` and ``thick`` metres
    thick; returns its index. It opens by an angle within ``swing``, degrees. A ``marked`` panel may
    carry a label or a window."""
    x, thick = x - 0.3 * unit, 1.6 * unit if thick is None else thick
    shape = Shape().add(draw_plate(rng, x, span, thick), face)
    if pull:
        add_pull(rng, shape, side, x - thick, span, unit, metal)
    y0, y1, z0, z1 = span
    extra, front = rng.random(), x - thick
    if marked and extra < 0.5 and z1 - z0 > 14 * unit:
        w, h = 0.26 * (y1 - y0), min(0.1 * (z1 - z0), 5 * unit)
        y, z = (y0 + y1) / 2, z0 + 0.68 * (z1 - z0)
        tone = plain((0.9, 0.88, 0.8)) if extra < 0.3 else materials.dark_glass(rng)
        shape.add(box([front - 0.4 * unit, y - w, z - h], [front, y + w, z + h]), tone)
    return asm.add(name, shape, parent, open_at(rng, side, front, span, *swing))


def arch(half: float, low: float, rise: float, points: int) -> np.ndarray:
    """An outline [n, 2] in metres that stands on z = 0 and reaches ``half`` to each side: upright
    up to ``low``, then an arch of ``points`` points that is ``rise`` high."""
    t = np.linspace(0, np.pi, points)
    top = np.column_stack([half * np.cos(t), low + rise * np.sin(t)])
    return np.vstack([[[-half, 0], [half, 0]], top])


def inner_outline(outline: np.ndarray, wide: float, high: float, wall: float) -> np.ndarray:
    """An outline [n, 2] that is ``wide`` and ``high`` (metres), drawn in by ``wall`` at each
    side."""
    middle = np.array([0, high / 2])
    return middle + (outline - middle) * [1 - 2 * wall / wide, 1 - 2 * wall / high]


def roofed_case(rng, wide: float, deep: float, high: float, wall: float, base: float):
    """A hollow case in metres on z = ``base`` whose roof is flat, slanted, a gable or an arch.
    Returns its solid, the height of the front's flat part and the whole height."""
    half, kind = wide / 2, str(rng.choice(["flat", "slant", "gable", "arch"]))
    if kind == "slant":
        drop = min(0.25 * high, 0.7 * deep)
        poly = np.array([[0, 0], [high - drop, 0], [high, deep], [0, deep]])
        inner = poly + [[wall, wall], [-wall, wall], [-wall, -wall], [wall, -wall]]
        solid = extrusion(poly, "y", [0, -half, base], wide)
        return (
            solid - extrusion(inner, "y", [0, wall - half, base], wide - 2 * wall),
            high - drop,
            high,
        )
    rise = 0.0 if kind == "flat" else min(float(rng.uniform(0.15, 0.3)) * high, 0.45 * wide)
    low = high - rise
    if kind == "arch":
        poly = arch(half, low, rise, 13)
    else:
        peak = [[0.0, high]] if kind == "gable" else []
        poly = np.array([[-half, 0], [half, 0], [half, low], *peak, [-half, low]])
    inner = inner_outline(poly, wide, high, wall)
    solid = extrusion(poly, "x", [0, 0, base], deep)
    return solid - extrusion(inner, "x", [wall, 0, base], deep - 2 * wall), low, high


def add_posts(rng, body: Shape, wide, deep, base, unit) -> None:
    """Add what carries a case whose floor is at z = ``base`` (metres): a post, two posts or a foot
    plate."""
    material = materials.wood(rng) if rng.random() < 0.5 else materials.dark(rng)
    r = float(rng.uniform(1.6, 3.2)) * unit
    ys = [0.0] if rng.random() < 0.6 else [-0.36 * wide, 0.36 * wide]
    for y in ys:
        if rng.random() < 0.5:
            body.add(cylinder("z", [deep / 2, y, 0], base, r, segments=16), material)
        else:
            body.add(box([deep / 2 - r, y - r, 0], [deep / 2 + r, y + r, base]), material)
    if rng.random() < 0.5:
        size = max(3 * r, 0.4 * deep)
        w = max(abs(ys[0]) + 2 * r, size)
        body.add(box([deep / 2 - size, -w, -1.5 * unit], [deep / 2 + size, w, 0]), material)

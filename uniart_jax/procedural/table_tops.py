"""Tops of tables: boards of many outlines, glass, slats; leaves that fold, lids that open."""

from __future__ import annotations

import itertools

import numpy as np

from uniart_jax.procedural import shapes
from uniart_jax.procedural.shapes import Shape, box, cut, exact, hinge, hull, rounded
from uniart_jax.procedural.table_parts import Piece


def top(
    p: Piece,
    x: tuple[float, float],
    y: tuple[float, float],
    z: tuple[float, float],
    kind: str,
    round_by: float,
) -> None:
    """The table top: 'square', 'rounded' or 'cut' corners, 'oval', 'beveled' edge, 'framed' (a
    field of another finish in a border), 'glass' let into a frame, or 'slats'."""
    z = float(exact(z[0])), float(exact(z[1]))
    lo, hi = np.array([x[0], y[0], z[0]]), np.array([x[1], y[1], z[1]])
    board, size = p.board.along("y"), hi - lo
    if kind in ("rounded", "cut"):
        ring = shapes.rounded(size[0], size[1], round_by, 2 if kind == "cut" else 6)
        p.add(shapes.extrusion(ring + (lo + hi)[:2] / 2, "z", [0, 0, z[0]], size[2]), board)
    elif kind == "oval":
        power = p.between(2.0, 5.0)
        angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
        c, s = np.cos(angle), np.sin(angle)
        wave = np.column_stack([np.sign(v) * np.abs(v) ** (2 / power) for v in (c, s)])
        ring = wave * size[:2] * 2 ** (1 / power) / 2 + (lo + hi)[:2] / 2
        p.add(shapes.extrusion(ring, "z", [0, 0, z[0]], size[2]), board)
    elif kind == "slats":
        count = int(p.rng.integers(3, 11))
        edges, air = np.linspace(x[0], x[1], count + 1), min(0.004, 0.1 * size[0] / count)
        for a, b in itertools.pairwise(edges):
            p.add(box([a + air, y[0], z[0]], [b - air, y[1], z[1]]), board)
        for a in (y[0] + 0.12 * size[1], y[1] - 0.17 * size[1]):
            p.add(
                box([x[0] + air, a, z[0] - 0.004], [x[1] - air, a + 0.05 * size[1], z[0] + 0.002]),
                p.frame,
            )
    elif kind == "beveled":
        inset = 0.9 * size[2] * (1 if p.share(0.5) else 2)
        ring = shapes.rounded(size[0], size[1], 0.002, 2) + (lo + hi)[:2] / 2
        small = shapes.rounded(size[0] - inset, size[1] - inset, 0.002, 2) + (lo + hi)[:2] / 2
        rings = [(ring, z[1]), (ring, z[1] - 0.4 * size[2]), (small, z[0])]
        p.add(hull(np.vstack([np.column_stack([r, np.full(len(r), h)]) for r, h in rings])), board)
    elif kind in ("framed", "glass"):
        border = p.between(0.05, 0.16) * min(size[0], size[1])
        through = 0.02 if kind == "glass" else -0.5 * size[2]
        step = p.between(0.0, 0.2) * size[2]
        field = np.array([[*(lo + border)[:2], z[0] - through], [*(hi - border)[:2], z[1] + 0.02]])
        p.add(cut(box(lo, hi), (box(*field),)), p.frame.along("y"))
        low = z[0] if kind == "glass" else z[0] + 0.5 * size[2]
        p.add(box([*field[0][:2], low], [*field[1][:2], z[1] - step]), board)
    else:
        p.add(box(lo, hi), board)


def lid(
    p: Piece, x: tuple[float, float], half: float, z: tuple[float, float], thick: float
) -> None:  # fmt: skip
    """A box under a top that is a lid, hinged at the rear or, as drawing tables have it, in front;
    or two lids side by side."""
    t, base = p.wall, z[0]
    solid = box([x[0], -half, base], [x[1], half, z[1]])
    p.add(
        solid - box([x[0] + t, t - half, base + 0.6 * t], [x[1] - t, half - t, 1.0 + z[1]]), p.frame
    )
    over = p.between(0.0, 0.05)
    rail = p.between(0.03, 0.3) * (x[1] - x[0]) if p.share(0.5) else 0.0
    back, low = x[1] - rail, z[1] + 0.0015
    if rail > 0.02:
        lo = [back, -half - over, z[1]]
        p.add(box(lo, [x[1] + over, half + over, z[1] + thick]), p.board)
    edges = [-half - over, half + over]
    if p.width > 0.8 and p.share(0.4):
        edges = [edges[0], 0.0, edges[1]]
    angle, drawing = float(np.deg2rad(p.between(50, 100))), rail <= 0.02 and p.share(0.5)
    if drawing:
        angle *= 0.7

    def add(asm, root: int) -> None:
        for a, b in itertools.pairwise(edges):
            lo = [x[0] - over - 0.02, a + 0.001, low]
            shape = Shape().add(box(lo, [back - 0.002, b - 0.001, z[1] + thick]), p.board)
            at = (back - 0.002, 0, z[1] + thick)
            axis = (0, 1, 0)
            if drawing:
                at, axis = (lo[0], 0, low), (0, -1, 0)
            asm.add("lid", shape, root, hinge(at, axis, angle))

    p.moving.append(add)


def leaves(
    p: Piece, x: tuple[float, float], half: float, under: float, thick: float
) -> None:  # fmt: skip
    """Leaves at both ends, or one, hinged to the top: hanging at rest, or raised."""
    length = min(p.between(0.15, 0.5) * p.width, 0.8 * under)
    hanging, round_by = p.share(0.6), p.between(0.0, 0.45) if p.share(0.5) else 0.0
    sides = (1, -1) if p.share(0.8) else (1,)
    angle = float(np.deg2rad(90 if p.share(0.6) else p.between(60, 90)))
    deep, gap = x[1] - x[0], 0.002

    def add(asm, root: int) -> None:
        for side in sides:
            ring = rounded(deep, 2 * length, max(0.004, round_by * min(deep, length)), 6)
            ring = ring + [(x[0] + x[1]) / 2, 0]
            solid = shapes.extrusion(ring, "z", [0, 0, 0], thick)
            solid = solid ^ box([x[0] - 1, 0, -1], [x[1] + 1, 3, 1])
            at = np.array([0.0, side * (half + gap), under])
            if hanging:
                solid = solid.rotate((-90, 0, 0))
            if side < 0:
                solid = solid.mirror((0, 1, 0))
            shape = Shape().add(solid.translate(tuple(at)), p.board)
            axis = np.array([side if hanging else -side, 0, 0])
            asm.add("leaf", shape, root, hinge(at, axis, angle))

    p.moving.append(add)

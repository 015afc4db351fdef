"""Frames of round or square bars, slabs and finishes of folding furniture. Lengths are in
metres."""

from __future__ import annotations

import itertools

import numpy as np
from manifold3d import Manifold

from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.pieces import trimmed
from uniart_jax.procedural.shapes import Shape, box, cylinder, extrusion, hull, pipe, rounded, union

AIR = 0.004  # metres between parts that move


def draw_frame_finish(rng: np.random.Generator) -> tuple[Material, bool]:
    """Draw the finish of a frame and whether its bars are square: wood, bare or painted metal,
    plastic."""
    if rng.random() < 0.4:
        return materials.wood(rng), True
    kind = rng.integers(4)
    bright = plain(materials.hsv(rng, (0, 1), (0.4, 0.95), (0.35, 0.95)))
    tones = (materials.metal(rng, brushed=False), materials.dark(rng), materials.paint(rng), bright)
    return tones[kind], bool(rng.random() < 0.3)


def draw_cover_finish(rng: np.random.Generator, frame: Material) -> Material:
    """Draw the finish of a seat or a top: that of the frame, wood, cloth or plastic."""
    kind = rng.choice(4, p=[0.2, 0.25, 0.4, 0.15])
    if kind == 2:
        return plain(materials.hsv(rng, (0, 1), (0.2, 0.9), (0.25, 0.95)))
    board, plastic = materials.wood(rng, grain="y"), materials.white_plastic(rng)
    return {0: frame, 1: board, 3: plastic}[int(kind)]


def bar(points, y: float, r: float, square: bool) -> Manifold:
    """A bar of radius ``r`` (metres) along points (x, z) in the plane y, round or square."""
    points = np.asarray(points, dtype=np.float64)
    if not square:
        return pipe(np.column_stack([points[:, 0], np.full(len(points), y), points[:, 1]]), r, 10)
    solids = []
    for a, b in itertools.pairwise(points):
        way = (b - a) / np.linalg.norm(b - a)
        side = np.array([-way[1], way[0]]) * r
        ends = [p + q for p in (a - 0.5 * r * way, b + 0.5 * r * way) for q in (side, -side)]
        solids.append(hull(np.array([[x, y + d, z] for x, z in ends for d in (-r, r)])))
    return union(solids)


def _rung(at, half: float, r: float, square: bool) -> Manifold:
    """A bar along y through (x, z). It is a little off that point, so that no two vertices of a
    joint meet."""
    x, z = np.asarray(at) + [0.017 * r, 0.031 * r]
    half -= 0.4 * r
    if square:
        return box([x - r, -half, z - r], [x + r, half, z + r])
    return cylinder("y", [x, -half, z], 2 * half, r, segments=11)


def bar_frame(points, half: float, r: float, square: bool, rungs=()) -> Manifold:
    """Two bars at y = +-``half`` (metres) and rungs between them through points (x, z)."""
    bars = [bar(points, s * half, r, square) for s in (-1, 1)]
    return union(bars + [_rung(p, half, 0.75 * r, square) for p in rungs])


def panel(rng, x0, x1, half, low, thick, across: bool | None = None) -> Manifold:
    """A flat slab in metres between ``x0`` and ``x1``: plain, rounded, or of slats along y if
    ``across``."""
    deep = x1 - x0
    slats = rng.random() < 0.35 if across is None else across
    if slats:
        count = max(3, int(deep / float(rng.uniform(0.055, 0.1))))
        step = deep / count
        wide = step * float(rng.uniform(0.6, 0.85))
        solids = [
            box([x0 + k * step, -half, low], [x0 + k * step + wide, half, low + thick])
            for k in range(count)
        ]
        for y in (-0.75 * half, 0.75 * half - 0.03):
            solids.append(box([x0, y, low], [x1 - step + wide, y + 0.03, low + 0.6 * thick]))
        return union(solids)
    corner = float(rng.choice([0.004, rng.uniform(0.02, 0.3) * min(deep, 2 * half)]))
    return extrusion(rounded(deep, 2 * half, corner), "z", [(x0 + x1) / 2, 0, low], thick)


def angle_between(a, b) -> float:
    """The angle in radians between two directions (x, z)."""
    a, b = np.asarray(a), np.asarray(b)
    return float(np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1, 1)))


def frame_shape(*pieces: tuple[Manifold, Material]) -> Shape:
    """A shape of solids, one per material, tidied to 0.1 mm. Where they overlap, the later one is
    cut."""
    return trimmed(*pieces, tidied=1e-4)

"""Vessels as outlines at rising heights: bodies, hollows and grips of jars, mills and lids. Lengths
are in metres."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.vessels import through
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.shapes import (
    ball,
    cylinder,
    extrusion,
    rounded,
    tube,
    union,
)

ANGLES = np.linspace(0, 2 * np.pi, 48, endpoint=False)
ROUND = np.ones(len(ANGLES))
Rows = list[tuple[np.ndarray, float]]  # radii at ANGLES and a height


def stack(rows: Rows) -> Manifold:
    """The solid through the outlines of ``rows`` (metres), at rising heights."""
    circle = np.column_stack([np.cos(ANGLES), np.sin(ANGLES)])
    return through([radii[:, None] * circle for radii, _ in rows], [z for _, z in rows])


def plan_of(rng: np.random.Generator, circle: float) -> np.ndarray:
    """Radii at ``ANGLES`` of a plan about 1 in radius, without units: a circle with the probability
    ``circle``, else a polygon, a rounded square or oblong, or an oval."""
    kind = rng.choice(4, p=[circle, *(1 - circle) * np.array([0.35, 0.45, 0.2])])
    if kind == 0:
        return ROUND
    if kind == 1:
        half = np.pi / int(rng.choice([4, 6, 8, 12]))
        return np.cos(half) / np.cos((ANGLES + (half if half < 0.3 else 0)) % (2 * half) - half)
    wide = float(rng.uniform(0.6, 1.0)) if rng.random() < 0.6 else 1.0
    power = 2.0 if kind == 3 else float(rng.uniform(4, 9))
    c, s = np.abs(np.cos(ANGLES)) / (wide if kind == 2 else 0.75 * wide), np.abs(np.sin(ANGLES))
    return (c**power + s**power) ** (-1 / power)


def profile(rng: np.random.Generator, plan: np.ndarray, low: float, high: float) -> Rows:
    """Outlines of a body between two heights (metres): straight, bellied, tapered or waisted."""
    t = np.linspace(0, 1, 9)
    s = float(rng.uniform(0.08, 0.3))
    shapes = [
        np.ones(9),
        1 - s + s * np.sin(np.pi * (0.1 + 0.8 * t)),
        1 - s * t,
        1 - s * (1 - t),
        1 - 0.6 * s * np.sin(np.pi * t),
        1 - s + s * np.sin(np.pi * t**1.6),
    ]
    scale = shapes[rng.choice(6, p=[0.36, 0.2, 0.1, 0.12, 0.07, 0.15])].copy()
    foot = float(rng.uniform(0.02, 0.07)) * (rng.random() < 0.7)
    rows = [(plan * (scale[0] - foot), low)]
    rows += [
        (plan * k, low + (0.03 + 0.97 * u) * (high - low)) for k, u in zip(scale, t, strict=True)
    ]
    return rows


def radii_at(rows: Rows, z: float) -> np.ndarray:
    """The radii at the height ``z``, metres."""
    heights = [h for _, h in rows]
    k = int(np.clip(np.searchsorted(heights, z), 1, len(rows) - 1))
    share = (z - heights[k - 1]) / (heights[k] - heights[k - 1])
    return rows[k - 1][0] + np.clip(share, 0, 1) * (rows[k][0] - rows[k - 1][0])


def hollow(rows: Rows, wall: float, floor: float) -> Manifold:
    """The inside of a body above z = ``floor`` (metres), open at its top."""
    inside = [(radii_at(rows, floor) - wall, floor)]
    inside += [(r - wall, z) for r, z in rows if z > floor + 1e-4]
    return stack([*inside, (inside[-1][0], rows[-1][1] + wall)])


def draw_finish(rng: np.random.Generator) -> Material:
    """Draw a finish: glazed clay, enamel, bright plastic, metal or wood."""
    kind = rng.choice(5, p=[0.3, 0.15, 0.25, 0.2, 0.1])
    if kind == 0:
        return plain(materials.hsv(rng, (0, 1), (0.05, 0.6), (0.3, 0.95)))
    if kind == 1:
        return materials.paint(rng)
    if kind == 2:
        return plain(rng.uniform([0.05] * 3, [0.95] * 3))
    return materials.hardware(rng) if kind == 3 else materials.wood(rng)


def grip(rng, z: float, room: float) -> tuple[Manifold, float]:
    """A grip on the middle of a lid at height ``z``, and the grip's height (metres)."""
    r = float(rng.uniform(0.16, 0.32)) * room
    kind = str(rng.choice(["ball", "button", "bar", "ring"]))
    if kind == "ball":
        stem = cylinder("z", [0, 0, z - 0.3 * r], 0.9 * r, 0.5 * r)
        return union([stem, ball([0, 0, z + 1.2 * r], r, 18)]), 2.2 * r
    if kind == "button":
        rows = [(0.6, -0.3), (0.45, 0.4), (1, 0.7), (1, 1.0), (0.7, 1.15)]
        return stack([(ROUND * s * r, z + k * r) for s, k in rows]), 1.15 * r
    if kind == "bar":
        return extrusion(rounded(3.6 * r, 0.8 * r, 0.3 * r), "z", [0, 0, z - 0.2 * r], r), 0.8 * r
    ring = tube("x", [-0.2 * r, 0, z + 0.9 * r], 0.4 * r, 1.2 * r, 0.75 * r)
    return ring, 2.1 * r

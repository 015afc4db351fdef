"""Stands of globes, mirrors and racks: finishes, feet, rings and legs. Lengths are in metres;
``unit`` is a hundredth of the object's size."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.shapes import (
    Shape,
    cylinder,
    extrusion,
    pipe,
    revolution,
    rounded,
    tidy,
    tube,
    union,
)


def draw_finish(rng: np.random.Generator) -> Material:
    """Draw the finish of a stand: wood, metal, brass or plastic."""
    kind = rng.choice(3, p=[0.35, 0.4, 0.25])
    if kind == 0:
        return materials.wood(rng)
    return materials.hardware(rng) if kind == 1 else plain(rng.uniform(0.08, 0.92, 3))


def flat_ring(outer: float, inner: float, wide: float, start=0.0, end=2 * np.pi) -> Manifold:
    """A flat ring or arc about 0 in the plane (y, z), ``wide`` metres along x. The angles ``start``
    and ``end`` are in radians from +z towards +y."""
    if end - start > 6.28:
        return tube("x", [-wide / 2, 0, 0], wide, outer, inner, 48)
    t = np.linspace(start, end, 30)
    way = np.column_stack([np.sin(t), np.cos(t)])
    return extrusion(np.vstack([outer * way, inner * way[::-1]]), "x", [-wide / 2, 0, 0], wide)


def draw_foot(rng, size: float, high: float, top: float, thick: float) -> Manifold:
    """A foot about the z axis and its post, which ends at z = ``top``.

    ``size``: the foot's radius. ``high``: its height. ``thick``: the post's radius. All are in
    metres.
    """
    kind = str(
        rng.choice(
            ["disc", "dome", "turned", "slab", "cross", "legs"], p=[0.25, 0.2, 0.2, 0.1, 0.12, 0.13]
        )
    )
    post = [cylinder("z", [0, 0, 0.3 * high], top - 0.3 * high, thick, segments=18)]
    if kind == "disc":
        post.append(cylinder("z", [0, 0, 0], high, size, float(rng.uniform(0.85, 1)) * size, 32))
    elif kind == "dome":
        t = np.linspace(0, np.pi / 2, 7)
        rim = np.column_stack([size * np.cos(t), 0.3 * high + 1.1 * high * np.sin(t)])
        post.append(revolution(np.vstack([[[0, 0], [size, 0]], rim]), "z", [0, 0, 0], 32))
    elif kind == "turned":
        z = np.linspace(0, 1, 14)
        r = thick * (1.1 + 0.9 * np.abs(np.sin(float(rng.uniform(3, 8)) * z)))
        r = np.where(z < 0.22, size * (1 - 0.8 * (z / 0.22) ** 1.5), np.minimum(r, 0.5 * size))
        profile = np.vstack([[[0, 0]], np.column_stack([r, z * top]), [[0, top]]])
        post = [revolution(profile, "z", [0, 0, 0], 26)]
    elif kind == "slab":
        outline = rounded(1.7 * size, 1.7 * size, float(rng.uniform(0.05, 0.6)) * size)
        post.append(extrusion(outline, "z", [0, 0, 0], high))
    else:
        count = 4 if kind == "cross" else int(rng.integers(3, 6))
        rise = high if kind == "cross" else min(float(rng.uniform(1.5, 4)) * high, 0.7 * top)
        r = 0.5 * high
        post = [cylinder("z", [0, 0, rise - r], top - rise + r, thick, segments=18)]
        turned = float(rng.uniform(0, np.pi))
        for k in range(count):
            a = turned + 2 * np.pi * k / count
            tip = [1.1 * size * np.cos(a), 1.1 * size * np.sin(a), r]
            post.append(pipe([[0, 0, max(rise - r, r)], tip], r, 10))
    return union(post)


def add_horizon(rng, stand: Shape, center, outer, unit, finish: Material) -> None:
    """Add a horizontal ring around a globe (metres), on legs whose bars carry a post under the
    meridian ring."""
    wall = float(rng.uniform(5, 10)) * unit
    r = float(rng.uniform(1.3, 2.4)) * unit
    z = center[2]
    ring = tube("z", [0, 0, z - unit], 2 * unit, outer + wall, outer - 0.4 * unit, 40)
    count, turned = int(rng.integers(3, 5)), float(rng.uniform(0, 2))
    far, spread = outer + 0.6 * wall, float(rng.uniform(0.9, 1.15))
    low = 0.35 * max(z - outer, 4 * unit)
    legs = legs_around(count, turned, far, spread, z, r, low)
    post = cylinder("z", [0, 0, low - 0.8 * r], z - outer - low + r, 1.2 * r, segments=16)
    stand.add(tidy(union([ring, *legs, post])), finish)


def legs_around(count, turned, far, spread, high, r, low) -> list[Manifold]:
    """Legs of radius ``r`` (metres) that begin at the height ``high``, ``far`` from the z axis, and
    meet the ground ``spread`` times as far out. Each has a bar to the axis at the height
    ``low``."""
    bars = []
    for k in range(count):
        a = turned + 2 * np.pi * k / count
        c, s = np.cos(a) * far, np.sin(a) * far
        bars.append(pipe([[c, s, high], [spread * c, spread * s, r]], r, 12))
        bars.append(pipe([[0, 0, low], [spread * c, spread * s, low]], 0.8 * r, 10))
    return bars

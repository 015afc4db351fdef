"""Fittings of kettles, pots and dispensers: spouts, curved handles, lids, hinges and knobs. Lengths
are in metres."""

from __future__ import annotations

import itertools

import numpy as np
from manifold3d import Manifold

from uniart_jax.procedural.everyday.vessels import stack
from uniart_jax.procedural.shapes import ball, box, cylinder, tidy, union


def bezier(points, count: int = 9) -> np.ndarray:
    """Points [count, 3] along the Bezier curve of some control points, in their units."""
    points = np.asarray(points, dtype=np.float64)
    t = np.linspace(0, 1, count)[:, None, None]
    rows = np.broadcast_to(points, (count, *points.shape))
    while rows.shape[1] > 1:
        rows = rows[:, :-1] * (1 - t) + rows[:, 1:] * t
    return rows[:, 0]


def bow(half: float, rise: float, square: float) -> np.ndarray:
    """Points [15, 3] of an arch in the plane y = 0 (metres), from x = ``half`` over z = ``rise`` to
    -``half``. A ``square`` below 1 widens its shoulders."""
    angle = np.linspace(0, np.pi, 15)
    c, s = np.cos(angle), np.round(np.sin(angle), 9)
    return np.column_stack([half * np.sign(c) * np.abs(c) ** square, 0 * c, rise * s**square])


def taper(points: np.ndarray, first: float, last: float, flat: float = 1.0) -> Manifold:
    """A round bar along a polyline (metres), its radius going from ``first`` to ``last``. ``flat``
    scales its width in y."""
    radii = np.linspace(first, last, len(points))
    scaled = np.asarray(points) / [1, flat, 1]
    balls = [ball(p, r, 12) for p, r in zip(scaled, radii, strict=True)]
    bar = union([Manifold.batch_hull([a, b]) for a, b in itertools.pairwise(balls)])
    return bar.scale((1, flat, 1))


def spout(points: np.ndarray, first: float, last: float) -> tuple[Manifold, np.ndarray]:
    """A tapering spout (metres) with an open mouth, cut at right angles to its end; and its
    direction there."""
    way = points[-1] - points[-2]
    way = way / np.linalg.norm(way)
    mouth = np.vstack([points[-2:], points[-1:] + way * 3 * last])
    solid = taper(points, first, last) - taper(mouth, 0.62 * last, 0.62 * last)
    return solid.trim_by_plane(tuple(-way), float(-way @ points[-1])), way


def dome(outline: np.ndarray, radius: float, low: float, rise: float, rim: float) -> Manifold:
    """A lid (metres): a rim of height ``rim`` and a vault above it, ``rise`` high in all."""
    turns = np.linspace(0, np.pi / 2, 7)
    arch = np.column_stack(
        [radius * (0.06 + 0.94 * np.cos(turns)), low + rim + (rise - rim) * np.sin(turns)]
    )
    return stack(np.vstack([[radius, low], arch]), outline)


def bar_hinge(pivot, near: float, half: float, unit: float) -> Manifold:
    """The barrel of a lid's hinge along y through ``pivot`` (metres), ``half`` to each side, and
    the strap from it to x = ``near``."""
    x, y, z = pivot
    barrel = cylinder("y", [x, y - half, z], 2 * half, 1.7 * unit, segments=12)
    return barrel + box([near, y - half, z], [x, y + half, z + 1.2 * unit])


def knob(rng: np.random.Generator, at, size: float, *, turning: bool = False) -> Manifold:
    """A knob on a lid, ``size`` metres in radius: a ball, a mushroom, a disc, a bow, a bar or a
    star. A ``turning`` one is never round, so that its turning can be seen."""
    kind = rng.choice(["ball", "mushroom", "disc", "bow", "bar", "star"])
    if turning and kind in ("ball", "mushroom", "disc"):
        kind = ("bar", "star")[int(rng.integers(2))]
    x, y, z = at
    neck = cylinder("z", at, 1.1 * size, 0.45 * size, segments=14)
    if kind == "ball":
        return tidy(neck + ball([x, y, z + 1.3 * size], size, 18))
    if kind == "mushroom":
        top = cylinder("z", [x, y, z + 0.7 * size], 0.7 * size, 0.8 * size, 1.15 * size, 18)
        return tidy(neck + top)
    if kind == "disc":
        return tidy(
            neck + cylinder("z", [x, y, z + 0.8 * size], 0.5 * size, 1.5 * size, segments=22)
        )
    if kind == "bow":
        line = bezier([[-1.8, 0, 0], [-1.8, 0, 2.2], [1.8, 0, 2.2], [1.8, 0, 0]], 7) * size
        bent = taper(line + [x, y, z + 0.2 * size], 0.4 * size, 0.4 * size)
        foot = cylinder("z", at, 0.3 * size, 2.2 * size, segments=18)
        return tidy(foot + bent.trim_by_plane((0, 0, 1), z + 0.1 * size))
    if kind == "bar":
        bar = taper(np.array([[-1.5, 0, 0], [1.5, 0, 0]]) * size + [x, y, z + 1.4 * size],
                    0.55 * size, 0.55 * size)  # fmt: skip
        return tidy(neck + bar)
    arms = [cylinder("z", at, 1.6 * size, 0.8 * size, segments=14)]
    count = int(rng.integers(3, 6))
    for k in range(count):
        a = k * 2 * np.pi / count + 0.1
        arms.append(
            cylinder("z", [x + 0.9 * size * np.cos(a), y + 0.9 * size * np.sin(a), z + 0.6 * size],
                     size, 0.5 * size, segments=10)
        )  # fmt: skip
    return tidy(union(arms))

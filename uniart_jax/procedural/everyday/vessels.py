"""Vessels as an outline and a profile: bodies of kettles, pots and dispensers, their insides and
their widths. Lengths are in metres."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from manifold3d import Manifold, Mesh64

from uniart_jax.objects.object import ArticulatedObject


def turned(obj: ArticulatedObject, yaw: float) -> ArticulatedObject:
    """The object turned about z by ``yaw`` degrees."""
    angle = np.deg2rad(yaw)
    c, s = np.cos(angle), np.sin(angle)
    matrix = np.eye(4)
    matrix[:2, :2] = [[c, -s], [s, c]]
    return obj.transformed(matrix)


def ring(count: int, across: float = 1.0, power: float = 2.0) -> np.ndarray:
    """An outline [count, 2] without units that reaches x = -1 and 1 and is ``across`` times as wide
    in y: round, a polygon of few points, or squared by a ``power`` above 2."""
    angle = (np.arange(count) + 0.5) * 2 * np.pi / count
    c, s = np.cos(angle), np.sin(angle)
    points = (
        np.column_stack([c, s])
        / ((np.abs(c) ** power + np.abs(s) ** power) ** (1 / power))[:, None]
    )
    return points / np.abs(points[:, 0]).max() * [1, across]


def half_width(outline: np.ndarray) -> float:
    """How far an outline of radius 1 reaches in y."""
    return float(np.abs(outline[:, 1]).max())


def through(outlines: list[np.ndarray], heights: Iterable[float]) -> Manifold:
    """The solid through outlines, each [n, 2] about 0 (metres), at rising heights."""
    heights = list(heights)
    n, levels = len(outlines[0]), len(outlines)
    rings = [np.column_stack([o, np.full(n, z)]) for o, z in zip(outlines, heights, strict=True)]
    i = np.arange(n)
    j = np.roll(i, -1)
    faces = []
    for k in range(levels - 1):
        a, b = k * n, (k + 1) * n
        faces += [np.column_stack([a + i, a + j, b + j]), np.column_stack([a + i, b + j, b + i])]
    low, high = np.full(n, levels * n), np.full(n, levels * n + 1)
    top = (levels - 1) * n
    faces += [np.column_stack([low, j, i]), np.column_stack([high, top + i, top + j])]
    ends = [[0, 0, heights[0]], [0, 0, heights[-1]]]
    return Manifold(
        Mesh64(
            vert_properties=np.vstack([*rings, ends]),
            tri_verts=np.concatenate(faces).astype(np.uint64),
        )
    )


def stack(profile: np.ndarray, outline: np.ndarray) -> Manifold:
    """The solid whose outline at each height z is ``outline`` times r; ``profile`` [n, 2] holds (r,
    z) in metres, z growing."""
    return through([outline * r for r in profile[:, 0]], profile[:, 1])


def frustum(outline: np.ndarray, below: float, above: float, low: float, high: float) -> Manifold:
    """The solid over ``outline`` from z = ``low`` to ``high`` (metres), its radius going from
    ``below`` to ``above``."""
    return stack(np.array([[below, low], [above, high]]), outline)


def silhouette(
    bottom: float,
    belly: float,
    top: float,
    at: float,
    low: float,
    high: float,
    fillet: float = 0.0,
    curved: bool = True,
) -> np.ndarray:
    """A profile [n, 2] of (r, z) in metres from ``bottom`` over ``belly``, at the share ``at`` of
    the height, to ``top``. ``fillet`` is the radius that rounds its lower edge."""
    t = np.linspace(0, 1, 13 if curved else 3)
    if not curved:
        t[1] = np.clip(at, 0.05, 0.95)
    up = t / max(at, 1e-6)
    down = (t - at) / max(1 - at, 1e-6)
    if curved:
        up, down = (
            np.sin(np.pi / 2 * np.clip(up, 0, 1)),
            1 - np.cos(np.pi / 2 * np.clip(down, 0, 1)),
        )
    r = np.where(t < at, bottom + (belly - bottom) * up, belly + (top - belly) * down)
    profile = np.column_stack([r, low + (high - low) * t])
    if fillet > 0:
        turns = np.linspace(0, np.pi / 2, 5)
        edge = np.interp(low + fillet, profile[:, 1], profile[:, 0])
        corner = np.column_stack(
            [edge - fillet * (1 - np.sin(turns)), low + fillet * (1 - np.cos(turns))]
        )
        profile = np.vstack([corner, profile[profile[:, 1] > low + fillet * 1.02]])
    return profile


def radius_at(profile: np.ndarray, z: float) -> float:
    """The radius r (metres) of a profile at the height ``z``."""
    return float(np.interp(z, profile[:, 1], profile[:, 0]))


def widest(profile: np.ndarray, heights: Iterable[float]) -> float:
    """The largest radius r (metres) of a profile at some heights."""
    return max(radius_at(profile, z) for z in heights)


def room(profile: np.ndarray, outline: np.ndarray, wall: float) -> Manifold:
    """The inside of a vessel (metres): its profile drawn in by ``wall``, open at the top."""
    low, high = profile[0, 1] + wall, profile[-1, 1]
    z = np.concatenate([np.linspace(low, high, 12), [high + 4 * wall]])
    r = np.interp(z, profile[:, 1], profile[:, 0]) - wall
    return stack(np.column_stack([r, z]), outline)

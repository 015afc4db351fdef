"""What kettles and pots are made of: walls over an outline, spouts, curved grips, lids, knobs; and
objects that are turned about z when they are done."""

from __future__ import annotations

import itertools

import numpy as np
from manifold3d import Manifold, Mesh64

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural.shapes import ball, cylinder, tidy, union


def turned(obj: ArticulatedObject, yaw: float) -> ArticulatedObject:
    """The object turned about z by ``yaw`` degrees."""
    angle = np.deg2rad(yaw)
    c, s = np.cos(angle), np.sin(angle)
    matrix = np.eye(4)
    matrix[:2, :2] = [[c, -s], [s, c]]
    return obj.transformed(matrix)


def ring(count: int, across: float = 1.0, power: float = 2.0) -> np.ndarray:
    """An outline [n, 2] that reaches x = -1 and 1 and is ``across`` times as wide: round, with
    ``count`` < 20 flats, or squared by a ``power`` above 2."""
    angle = (np.arange(count) + 0.5) * 2 * np.pi / count
    c, s = np.cos(angle), np.sin(angle)
    points = (
        np.column_stack([c, s])
        / ((np.abs(c) ** power + np.abs(s) ** power) ** (1 / power))[:, None]
    )
    return points / np.abs(points[:, 0]).max() * [1, across]


def stack(profile: np.ndarray, outline: np.ndarray) -> Manifold:
    """The body whose outline at each height z is ``outline`` times r; ``profile`` [n, 2] holds
    (r, z), z growing."""
    n, levels = len(outline), len(profile)
    rings = [np.column_stack([outline * r, np.full(n, z)]) for r, z in profile]
    i = np.arange(n)
    j = np.roll(i, -1)
    faces = []
    for k in range(levels - 1):
        a, b = k * n, (k + 1) * n
        faces += [np.column_stack([a + i, a + j, b + j]), np.column_stack([a + i, b + j, b + i])]
    low, high = np.full(n, levels * n), np.full(n, levels * n + 1)
    top = (levels - 1) * n
    faces += [np.column_stack([low, j, i]), np.column_stack([high, top + i, top + j])]
    ends = [[0, 0, profile[0][1]], [0, 0, profile[-1][1]]]
    return Manifold(
        Mesh64(
            vert_properties=np.vstack([*rings, ends]),
            tri_verts=np.concatenate(faces).astype(np.uint64),
        )
    )


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
    """A profile (r, z) from ``bottom`` over ``belly``, at a share ``at`` of the height, to ``top``;
    ``fillet``: how much its lower edge is rounded."""
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
    """r of a profile at a height."""
    return float(np.interp(z, profile[:, 1], profile[:, 0]))


def room(profile: np.ndarray, outline: np.ndarray, wall: float) -> Manifold:
    """What is hollow in a vessel: its profile drawn in by ``wall``, open at the top."""
    low, high = profile[0, 1] + wall, profile[-1, 1]
    z = np.concatenate([np.linspace(low, high, 12), [high + 4 * wall]])
    r = np.interp(z, profile[:, 1], profile[:, 0]) - wall
    return stack(np.column_stack([r, z]), outline)


def bezier(points, count: int = 9) -> np.ndarray:
    """[count, 3] along a Bezier curve of control points."""
    points = np.asarray(points, dtype=np.float64)
    t = np.linspace(0, 1, count)[:, None, None]
    rows = np.broadcast_to(points, (count, *points.shape))
    while rows.shape[1] > 1:
        rows = rows[:, :-1] * (1 - t) + rows[:, 1:] * t
    return rows[:, 0]


def bow(half: float, rise: float, square: float) -> np.ndarray:
    """[15, 3] in the plane y = 0 from x = ``half`` over ``rise`` to -``half``; ``square`` below 1
    widens its shoulders."""
    angle = np.linspace(0, np.pi, 15)
    c, s = np.cos(angle), np.round(np.sin(angle), 9)
    return np.column_stack([half * np.sign(c) * np.abs(c) ** square, 0 * c, rise * s**square])


def taper(points: np.ndarray, first: float, last: float, flat: float = 1.0) -> Manifold:
    """A round bar along a polyline, its radius going from ``first`` to ``last``; ``flat``: width in
    y of its height."""
    radii = np.linspace(first, last, len(points))
    scaled = np.asarray(points) / [1, flat, 1]
    balls = [ball(p, r, 12) for p, r in zip(scaled, radii, strict=True)]
    bar = union([Manifold.batch_hull([a, b]) for a, b in itertools.pairwise(balls)])
    return bar.scale((1, flat, 1))


def spout(points: np.ndarray, first: float, last: float) -> tuple[Manifold, np.ndarray]:
    """A tapering spout with an open mouth, cut at right angles to its end; and its direction."""
    way = points[-1] - points[-2]
    way = way / np.linalg.norm(way)
    mouth = np.vstack([points[-2:], points[-1:] + way * 3 * last])
    solid = taper(points, first, last) - taper(mouth, 0.62 * last, 0.62 * last)
    return solid.trim_by_plane(tuple(-way), float(-way @ points[-1])), way


def dome(outline: np.ndarray, radius: float, low: float, rise: float, rim: float) -> Manifold:
    """A lid: a rim of height ``rim`` and a vault above it, ``rise`` high in all."""
    turns = np.linspace(0, np.pi / 2, 7)
    arch = np.column_stack(
        [radius * (0.06 + 0.94 * np.cos(turns)), low + rim + (rise - rim) * np.sin(turns)]
    )
    return stack(np.vstack([[radius, low], arch]), outline)


def knob(rng: np.random.Generator, at, size: float, *, turning: bool = False) -> Manifold:
    """A knob on a lid, ``size`` in radius: a ball, a mushroom, a disc, a bow; a ``turning`` one is
    never round."""
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

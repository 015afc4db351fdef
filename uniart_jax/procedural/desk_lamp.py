"""Desk lamps: a foot, two to four hinged arms, a head that tilts; arms side by side, in forks, or
as a bar of light."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.pieces import merged
from uniart_jax.procedural.shapes import (
    Assembly,
    ball,
    box,
    cylinder,
    extrusion,
    hinge,
    hull,
    revolution,
    rounded,
    turn,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A desk lamp, metres, folded as it stands on a desk.

    Made in the plane of its arms (x, z), in which it bends towards -x, and turned about z at the
    end.
    """
    count = int(rng.choice([1, 2, 3, 4], p=[0.15, 0.5, 0.25, 0.1]))
    total = float(rng.uniform(0.45, 0.95))
    shares = rng.uniform(0.8, 1.25, count)
    lengths = total * shares / shares.sum()
    unit = 0.6 * total / 100
    radius = float(rng.uniform(1.0, 2.0)) * unit + 0.0015  # half the width of an arm
    elevations = _pose(rng, count)
    paint = materials.paint(rng) if rng.random() < 0.6 else materials.metal(rng, brushed=False)
    accent = materials.hardware(rng) if rng.random() < 0.6 else paint
    yaw = float(rng.choice([0.0, 90.0, -90.0, rng.uniform(-180, 180)], p=[0.3, 0.1, 0.1, 0.5]))
    air = 0.35 * unit
    layer = 1.5 * radius  # thickness of an arm across the plane
    spread = np.deg2rad(yaw)
    turned = np.array(
        [[np.cos(spread), -np.sin(spread), 0], [np.sin(spread), np.cos(spread), 0], [0, 0, 1]]
    )

    points = [np.array([0.0, 0.0, 0.0])]
    foot_high, post = float(rng.uniform(0.015, 0.03)), float(rng.uniform(0.02, 0.12)) * total
    points[0][2] = foot_high + post + 2 * radius
    for length, angle in zip(lengths, elevations[:-1], strict=True):
        points.append(points[-1] + length * np.array([-np.cos(angle), 0, np.sin(angle)]))
    balance = points[-1][0] * float(
        rng.uniform(0.05, 0.25)
    )  # the foot lies under the head a little

    asm = Assembly()

    def add(name: str, pieces: list[tuple[Manifold, Material]], parent: int, joint=None) -> int:
        return asm.add(name, merged(pieces, yaw), parent, joint)

    fork = rng.random() < 0.45
    sides = _layers(count, layer, air, fork)  # y spans of the post, each arm and the head
    foot, stand = _foot(rng, unit, foot_high, total, balance, paint, accent)
    swivel = rng.random() < 0.3
    stem = _stem(points[0], foot_high + (0.001 if swivel else -0.0002), radius, sides[0])
    if swivel:  # the post turns on the foot
        root = add("foot", foot, -1)
        collar = cylinder("z", [0, 0, foot_high + 0.001], 1.2 * unit, 3.2 * unit, 2.4 * unit, 20)
        base = add("post", [(collar + stem, accent)], root, turn((0, 0, 0), (0, 0, 1)))
    else:
        root = base = add("foot", [*foot, (stem - stand, accent)], -1)

    previous, parent = np.pi / 2, base
    axis = turned @ np.array([0.0, 1, 0])
    for k in range(count):
        angle = elevations[k]
        pieces = _arm(points[k], points[k + 1], radius, sides[k + 1], layer, paint, accent)
        if k == 0:  # leans forward from where it leans back
            way, most = -1, float(np.clip(angle - np.deg2rad(35), 0.4, 1.4))
        else:  # unfolds until it lies along the arm before it
            way = 1 if previous > angle else -1
            most = float(np.clip(abs(previous - angle) - np.deg2rad(8), 0.35, 2.4))
        joint = hinge(turned @ points[k], axis, way * most)
        parent = add("arm", pieces, parent, joint)
        previous = angle
    tilt = elevations[-1]
    head = _head(rng, points[-1], tilt, radius, sides[-1], unit, total, paint, accent)
    up = float(np.deg2rad(rng.uniform(35, 110)))
    add("head", head, parent, hinge(turned @ points[-1], axis, up))
    return asm.object()


def _pose(rng: np.random.Generator, count: int) -> list[float]:
    """Elevations above the direction -x, radians: of each arm and of the light's own direction."""
    first = rng.uniform(85, 125)
    if count == 1:
        arms = [rng.uniform(55, 100)]
    elif count == 2:
        arms = [first, rng.uniform(-5, 55)]
    elif count == 3:
        arms = [first, rng.uniform(35, 75), rng.uniform(-25, 20)]
    else:
        arms = [first, rng.uniform(60, 80), rng.uniform(15, 40), rng.uniform(-30, 0)]
    light = max(rng.uniform(-110, -60), arms[-1] - rng.uniform(80, 105))  # clear of the last arm
    return [float(np.deg2rad(a)) for a in [*arms, light]]


def _layers(count: int, layer: float, air: float, fork: bool) -> list[list[tuple[float, float]]]:
    """Spans in y of the post, the arms and the head: neighbours lie side by side, or every second
    one is a fork."""
    middle = (-layer / 2, layer / 2)
    if fork:
        outer = [(layer / 2 + air, 1.2 * layer + air), (-1.2 * layer - air, -layer / 2 - air)]
        return [[middle] if k % 2 else outer for k in range(count + 2)]
    step = layer + air
    beside = (middle[0] + step, middle[1] + step)
    return [[middle] if k % 2 == 0 else [beside] for k in range(count + 2)]


def _bar(a, b, radius: float, span: tuple[float, float], thin: float = 1.0) -> Manifold:
    """A flat bar with round ends from a to b, between two y; ``thin``: its width amid, of the
    ends'."""
    ends = [
        cylinder("y", [p[0], span[0], p[2]], span[1] - span[0], radius, segments=18) for p in (a, b)
    ]
    way = (b - a) / np.linalg.norm(b - a)
    side = np.array([-way[2], 0, way[0]]) * radius * thin
    corners = [p + s * side + [0, y, 0] for p in (a, b) for s in (-1, 1) for y in span]
    return union([*ends, hull(np.array(corners))])


def _foot(rng, unit, high, total, balance, paint, accent):
    """The foot's solids with their materials, and their union: a disc, a slab, a clamp under a
    board."""
    size = float(rng.uniform(0.13, 0.22)) * total + 0.02
    kind = str(rng.choice(["disc", "slab", "dome", "square"], p=[0.45, 0.2, 0.2, 0.15]))
    finish = paint if rng.random() < 0.6 else accent
    if rng.random() < 0.25:
        finish = materials.dark(rng) if rng.random() < 0.5 else materials.wood(rng)
    at = [balance, 0, 0]
    if kind == "disc":
        solid = cylinder("z", at, high, size, 0.96 * size, segments=28)
    elif kind == "dome":
        angle = np.linspace(0, np.pi / 2, 6)
        rim = np.column_stack([size * np.cos(angle), 0.35 * high + 0.65 * high * np.sin(angle)])
        solid = revolution(np.vstack([[[0, 0], [size, 0]], rim]), "z", at, 28)
    else:
        deep, wide = (
            2 * size,
            2 * size * (1.0 if kind == "square" else float(rng.uniform(0.5, 0.8))),
        )
        outline = rounded(deep, wide, float(rng.uniform(0.05, 0.4)) * wide)
        solid = extrusion(outline, "z", at, high)
    pieces = [(solid, finish)]
    if rng.random() < 0.5 and abs(balance - 0.6 * size) > 6 * unit:  # a switch
        r = 1.2 * unit
        pieces.append(
            (
                cylinder("z", [balance - 0.6 * size, 0, high], 1.0 * unit, r, segments=12),
                materials.dark(rng),
            )
        )
    return pieces, solid


def _stem(top: np.ndarray, low: float, radius: float, spans) -> Manifold:
    """A round post to the first hinge, ending in its lugs."""
    neck = top[2] - 1.6 * radius
    wide = max(max(abs(a), abs(b)) for a, b in spans)
    solids = [cylinder("z", [0, 0, low], neck - low, max(radius, wide), segments=18)]
    for span in spans:
        below = np.array([top[0], 0, neck - 0.2 * radius])
        solids.append(_bar(below, top, radius, span))
    return union(solids)


def _arm(a, b, radius, spans, layer, paint, accent):
    """An arm between two hinges, with the hinges' caps."""
    thin = 0.75
    bars = [_bar(a, b, radius, span, thin) for span in spans]
    if len(spans) == 2:  # a fork, held together amid
        m, way = (a + b) / 2, (b - a) * 0.08
        bars.append(
            _bar(m - way, m + way, 0.6 * radius, (spans[1][1] - 0.001, spans[0][0] + 0.001))
        )
    pieces = [(union(bars), paint)]
    outside = max(span[1] for span in spans)
    caps = [
        cylinder("y", [p[0], outside, p[2]], 0.35 * layer, 0.65 * radius, segments=14)
        for p in (a, b)
    ]
    if len(spans) == 2 or spans[0][0] > 0:
        pieces.append((union(caps), accent))
    return pieces


def _head(rng, at, tilt: float, radius, spans, unit, total, paint, accent):
    """A shade, a bell, a ball or a bar of light that shines along ``tilt``, hung on the last
    hinge."""
    kind = str(rng.choice(["cone", "bell", "drum", "bar", "ball"], p=[0.34, 0.2, 0.14, 0.2, 0.12]))
    size = float(rng.uniform(0.09, 0.17)) * total
    glow = plain((1.0, 0.96, 0.8)) if rng.random() < 0.7 else plain((0.93, 0.93, 0.9))
    finish = paint if rng.random() < 0.75 else materials.paint(rng)
    neck = 2.4 * radius
    way = np.array([-np.cos(tilt), 0, np.sin(tilt)])
    lugs = [_bar(at, at + (neck + 0.3 * size) * way, radius, span) for span in spans]
    start = neck + radius
    if kind == "bar":  # long, at right angles to its light
        long, thick = size * float(rng.uniform(2.0, 3.6)), 2.2 * radius
        width = 0.5 * size
        low = -start - thick  # along -z of its own frame
        slab = box([-long, -width, low], [0.25 * long, width, -start])
        lamp = box([-0.94 * long, -0.8 * width, low - 0.5 * unit], [0.1 * long, 0.8 * width, low])
        pieces = [(slab, finish), (lamp, glow)]
    elif kind == "ball":
        pieces = [(ball([0, 0, -start - 0.9 * size], size, 24), glow)]
    else:
        tall = size * float(rng.uniform(1.0, 1.7))
        top, wall = size * float(rng.uniform(0.32, 0.55)), 0.04 * size + 0.6 * unit
        if kind == "drum":
            top = size * float(rng.uniform(0.8, 1.0))
        z0, z1 = -start, -start - tall
        outer = [[top, z0], [size, z1]]
        if kind == "bell":
            angle = np.linspace(0, np.pi / 2, 6)
            outer = np.column_stack(
                [top + (size - top) * np.sin(angle), z0 - tall + tall * np.cos(angle)]
            )
        outer = np.array(outer)
        inner = np.maximum(outer - [wall, 0], [0.12 * size, -9])[::-1]
        inner[-1, 1] -= wall
        profile = np.vstack([[[0, z0]], outer, inner, [[0, inner[-1, 1]]]])
        shade = revolution(profile, "z", [0, 0, 0], 28)
        bulb = ball([0, 0, z0 - wall - 0.45 * tall], 0.3 * min(size, tall), 14)
        socket = cylinder(
            "z", [0, 0, z0 - wall - 0.45 * tall], 0.4 * tall, 0.12 * size, segments=12
        )
        pieces = [(shade, finish), (bulb + socket - shade, glow)]
    degrees = float(np.rad2deg(np.arctan2(way[0], way[2]))) - 180  # about y: carries -z to the way
    placed = [(s.rotate((0, degrees, 0)).translate(tuple(at)), m) for s, m in pieces]
    blockers = union([s for s, _ in placed])
    placed.append((union(lugs) - blockers, accent))
    return placed

"""Stands of displays: feet, trolleys, clamps, arms, and heads that tilt and pivot. Lengths are in
metres; ``unit`` is a hundredth of the object's size."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.kinematics import Joint
from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import (
    Shape,
    box,
    cylinder,
    extrusion,
    hinge,
    pipe,
    rounded,
    screw,
    tidy,
    turn,
    union,
)

UP = (0, 0, 1)
ACROSS = (0, 1, 0)
Link = tuple[str, Shape, Joint | None]


def both_ways(rng, at, axis, back: float, ahead: float) -> Joint:
    """A revolute joint through ``at`` (metres) that turns from ``-back``, or from 0, to ``ahead``
    degrees."""
    low = -back if rng.random() < 0.6 else 0.0
    return Joint(np.asarray(at, float), np.asarray(axis, float), tuple(np.deg2rad([low, ahead])))


def swivel(rng, at) -> Joint:
    """A joint about the vertical through ``at`` (metres): continuous, or limited to both sides."""
    side = float(rng.uniform(20, 70))
    return turn(at, UP) if rng.random() < 0.25 else both_ways(rng, at, UP, side, side)


def _fork(at, r: float, half: float, wall: float, low: float, air: float) -> Manifold:
    """Two cheeks about a hinge along y, and the bridge between their feet, down to ``low``."""
    x, y, z = at
    bridge = z - 1.3 * r - air
    solids = [box([x - r, y - half - air - wall, low], [x + r, y + half + air + wall, bridge])]
    for s in (y - half - air - wall, y + half + air):
        solids.append(cylinder("y", [x, s, z], wall, r, segments=18))
        solids.append(box([x - r, s, bridge - 1e-4], [x + r, s + wall, z]))
    return union(solids)


def add_head(rng, links, hinge_at, screen: Shape, unit, sizes, moves, metal: Material) -> None:
    """Mount a screen in front of a fork (metres): appends to ``links`` what tilts and what pivots
    on it."""
    (r, half, wall, low), x = sizes, hinge_at[0]
    air, plate = 0.3 * unit, 1.2 * unit
    q = float(rng.uniform(3.5, 6)) * unit
    if moves["tilt"]:
        fork = _fork(hinge_at, r, half, wall, low, air)
        links[-1][1].add(fork, metal)
        lug = cylinder("y", [x, hinge_at[1] - half, hinge_at[2]], 2 * half, r, segments=18)
    else:
        lug = box([x - r, -half, low], [x + r, half, hinge_at[2] + r])
        lug = lug.translate((0, hinge_at[1], 0))
    y, z = hinge_at[1:]
    gap = air if moves["pivot"] else 0.0
    lug += box([plate, y - half, z - 0.8 * r], [x, y + half, z + 0.8 * r])
    lug += cylinder("x", [gap, y, z], plate - gap + 1e-4, q, segments=24)
    if moves["tilt"]:
        ahead = float(rng.uniform(15, 40))
        links.append(("head", Shape(), both_ways(rng, hinge_at, ACROSS, 5, ahead)))
    links[-1][1].add(tidy(lug), metal)
    if moves["pivot"]:
        way = float(rng.choice([-1, 1]))
        links.append(("screen", Shape(), hinge([0, y, z], (way, 0, 0), np.pi / 2)))
    links[-1][1].join(screen)


def add_foot(rng, base: Shape, x: float, wide: float, high: float, unit: float, metal) -> None:
    """Add a disc, a plate, a frame, splayed legs or a wooden board under the column (metres)."""
    long, deep = wide * float(rng.uniform(0.14, 0.3)), wide * float(rng.uniform(0.12, 0.2))
    finish = metal if rng.random() < 0.75 else materials.wood(rng)
    kind = rng.choice(4, p=[0.3, 0.35, 0.15, 0.2])
    shift = x - float(rng.uniform(0, 0.5)) * deep
    if kind == 0:
        solid = cylinder("z", [shift, 0, 0], high, max(long, 9 * unit), 0.95 * long, segments=30)
    elif kind in (1, 2):
        outline = rounded(2 * deep, 2 * long, float(rng.uniform(0.02, 0.9)) * deep, 6)
        solid = extrusion(outline, "z", [shift, 0, 0], high)
        if kind == 2:
            inner = outline * (1 - 5 * unit / np.array([2 * deep, 2 * long]))
            solid -= extrusion(inner, "z", [shift, 0, -1], 2)
            solid += box([shift - deep, -3 * unit, 0], [shift + deep, 3 * unit, high])
    else:
        ends = [[x - 1.6 * deep, s * 1.2 * long] for s in (-1, 1)] + [[x + deep, 0]]
        legs = [[[x, 0, high / 2], [a, b, high / 2]] for a, b in ends]
        slab = [pipe(leg, 0.9 * high, 8) for leg in legs]
        solid = union(slab) ^ box([-2, -2, 0], [2, 2, high])
    if kind in (2, 3):
        solid += cylinder("z", [x, 0, 0], high, 7 * unit, segments=24)
    base.add(solid, finish)


def add_trolley(rng, base: Shape, x: float, wide: float, high: float, unit: float, metal) -> list:
    """Add a trolley's rails (metres) to ``base``; returns its four wheels: (shape, joint)."""
    long, deep = wide * float(rng.uniform(0.28, 0.42)), wide * float(rng.uniform(0.22, 0.34))
    r, w = 2.6 * unit, 1.5 * unit
    solids, wheels = [box([x - 3 * unit, -long, high - 3 * unit], [x + 3 * unit, long, high])], []
    rubber = materials.dark(rng)
    for y in (-long, long):
        solids.append(box([x - deep, y - 2 * w, high - 3 * unit], [x + deep, y + 2 * w, high]))
        for a in (x - deep + r, x + deep - r):
            for s in (y - 2 * w, y + 1.2 * w):  # forks
                solids.append(box([a - 0.5 * r, s, 0.6 * r], [a + 0.5 * r, s + 0.8 * w, high]))
            disc = cylinder("y", [a, y - w, r], 2 * w, r, segments=18)
            wheels.append((Shape().add(disc, rubber), turn([a, y, r], ACROSS)))
    base.add(union(solids), metal)
    return wheels


def flat_bar(a, b, r: float, z: float, thick: float) -> Manifold:
    """A flat bar ``2 r`` wide from a to b (x, y), ``thick`` metres thick."""
    way = (b - a) / np.linalg.norm(b - a)
    side = r * np.array([-way[1], way[0]])
    return extrusion(np.array([a - side, b - side, b + side, a + side]), "z", [0, 0, z], thick)


def add_clamp(rng, root: Shape, post, unit: float, metal: Material) -> list[Link]:
    """Add a foot plate under the post (metres); or a clamp for a table's edge, whose screw is
    returned."""
    x, y = post
    size = float(rng.uniform(6, 9)) * unit
    if rng.random() < 0.4:
        root.add(cylinder("z", [x, y, -2 * unit], 2 * unit, 2 * size, segments=28), metal)
        return []
    gap, thick = float(rng.uniform(10, 16)) * unit, 2 * unit
    reach = 1.3 * size
    for z in (-thick, -2 * thick - gap):
        root.add(box([x - reach, y - size, z], [x + 4 * unit, y + size, z + thick]), metal)
    root.add(box([x + 2 * unit, y - size, -thick - gap], [x + 4 * unit, y + size, -thick]), metal)
    at, low, r = [x - 0.5 * reach, y], -2 * thick - gap, 1.6 * unit
    hole = cylinder("z", [*at, low - 1], 2, r + 0.3 * unit, segments=16) ^ box(
        [-9, -9, low - 1], [9, 9, low + 2 * thick]
    )
    root.cut(hole, metal)
    rod = cylinder("z", [*at, low - 5 * unit], thick + 7.5 * unit, r, segments=16)
    pad = cylinder("z", [*at, low + thick + 0.5 * unit], 2 * unit, 3 * unit, segments=18)
    grip = cylinder("z", [*at, low - 7 * unit], 3 * unit, 3.4 * unit, segments=6)
    travel = min(3.5 * unit, 0.8 * (gap - 3 * unit))
    shape = Shape().add(tidy(union([rod, pad, grip])), materials.dark(rng))
    return [("screw", shape, screw([*at, 0], UP, float(rng.integers(2, 5)), travel))]

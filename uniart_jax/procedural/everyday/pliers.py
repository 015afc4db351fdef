"""Pliers, tongs, nutcrackers and clothes pegs: two halves about a pivot. Lengths are in metres."""

from __future__ import annotations

import itertools

import numpy as np
from manifold3d import CrossSection, Manifold, OpType

from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.small_tools import draw_grip_finish
from uniart_jax.procedural.scissors import strip
from uniart_jax.procedural.shapes import (
    PartSpec,
    Shape,
    box,
    cut,
    cylinder,
    hinge,
    tidy,
    union,
)


def _bar(points: np.ndarray, radii) -> CrossSection:
    """A bar along points [n, 2] with half widths ``radii`` and round ends."""
    ends = itertools.pairwise(zip(points, radii, strict=True))
    return CrossSection.batch_boolean([strip(a, b, r, q) for (a, r), (b, q) in ends], OpType.Add)


def _side(sign: int, gap: float) -> CrossSection:
    """The half plane v > ``gap`` for a positive ``sign``, else v < -``gap``."""
    return CrossSection.square((4, 2)).translate((-2, gap if sign > 0 else -2 - gap))


def _halves(
    flat: CrossSection, radius, grip: CrossSection | None, layer, angle, tones
) -> list[PartSpec]:
    """A half and its mirror image. Both have full thickness except at the pivot, where their discs
    lie one on the other."""
    gap, full = 0.12 * layer, 2.12 * layer
    parts, pin = [], 0.45 * radius
    for k in (0, 1):
        if k:
            flat = flat.mirror((0, 1))
            grip = None if grip is None else grip.mirror((0, 1))
        low = k * (layer + gap)
        start = layer if k == 0 else -1.0
        room = cylinder("z", [0, 0, start], 1 + layer + gap, radius + gap, segments=24)
        solid = Manifold.extrude(flat, full) - room
        disc = cylinder("z", [0, 0, low], layer, radius, segments=24)
        axle = cylinder("z", [0, 0, 0], full + 0.25 * layer, pin, segments=14)
        bore = cylinder("z", [0, 0, -1], 2, pin + gap, segments=14)
        solid = union([solid, disc, axle]) if k == 0 else union([solid, disc]) - bore
        shape, tone = Shape(), tones[1]
        if grip is not None:
            sleeve = Manifold.extrude(grip, 1.24 * full).translate((0, 0, -0.12 * full)) - room
            solid -= sleeve
            shape.add(tidy(sleeve), tone)
        shape.add(tidy(solid), tones[0])
        joint = hinge((0, 0, 0), (0, 0, 1), angle) if k else None
        parts.append(("half", shape, k - 1, joint))
    return parts


def pliers(rng: np.random.Generator) -> list[PartSpec]:
    """The parts of pliers (metres): crossed halves, with jaws in front of the pivot and handles
    behind it."""
    length = float(rng.uniform(0.12, 0.26))
    unit = length / 100
    radius, gap = float(rng.uniform(6, 10)) * unit, 0.5 * unit
    jaw, tip = float(rng.uniform(16, 42)) * unit, float(rng.uniform(0.25, 0.9)) * radius
    hand, bow = length - jaw, float(rng.uniform(0.08, 0.17)) * length
    wide = float(rng.uniform(2.8, 4.8)) * unit
    belly = float(rng.uniform(0.8, 1.1)) * radius
    points = np.array(
        [
            [0, 0.3 * radius],
            [-0.35 * hand, bow],
            [-0.95 * hand, bow * float(rng.uniform(0.75, 1.3))],
        ]
    )
    head = np.array(
        [[0, -gap], [0.5 * radius, -0.8 * radius], [0.45 * jaw, -belly], [jaw, -tip], [jaw, -gap]]
    )
    jaws = CrossSection([head]) ^ _side(-1, gap / 2)
    if rng.random() < 0.5:  # a hollow for pipes or nuts
        size = min(0.5 * belly, 0.2 * jaw)
        jaws -= CrossSection.circle(size, 16).translate((radius + size, -gap))
    bar = _bar(points, [0.5 * radius, wide, 0.9 * wide]) ^ _side(1, gap / 2)
    start = points[0] + 0.75 * (points[1] - points[0])
    sleeve = _bar(np.array([start, points[1], points[2]]), [1.25 * wide] * 3) ^ _side(1, gap)
    sleeve = sleeve if rng.random() < 0.8 else None
    tones = (materials.metal(rng, brushed=False), draw_grip_finish(rng))
    slope = np.arctan2(bow - 0.3 * radius, 0.35 * hand)
    angle = min(float(np.deg2rad(rng.uniform(25, 55))), float(np.deg2rad(68) - slope))
    return _halves(jaws + bar, radius, sleeve, float(rng.uniform(3, 5)) * unit, angle, tones)


def tongs(rng: np.random.Generator) -> list[PartSpec]:
    """The parts of tongs or a nutcracker (metres): two arms about a pivot at one end."""
    nuts = rng.random() < 0.45
    length = float(rng.uniform(0.13, 0.2) if nuts else rng.uniform(0.18, 0.4))
    unit, gap = length / 100, 0.4 * length / 100
    radius, wide = float(rng.uniform(4.5, 7.5)) * unit, float(rng.uniform(2.6, 4.5)) * unit
    bow = float(rng.uniform(7, 13)) * unit
    if nuts:
        at = float(rng.uniform(0.18, 0.32)) * length
        points = [
            [0, -0.4 * radius],
            [at, -bow],
            [at + 0.25 * length, -0.55 * bow],
            [0.95 * length, -bow],
        ]
        widths = [0.5 * radius, 1.3 * wide, wide, 0.9 * wide]
    else:
        points = [
            [0, -0.4 * radius],
            [0.35 * length, -bow],
            [0.86 * length, -wide],
            [0.95 * length, -1.1 * wide],
        ]
        widths = [0.5 * radius, wide, wide, float(rng.uniform(1, 2.4)) * wide]
    points = np.array(points)
    flat = _bar(points, widths) ^ _side(-1, gap)
    part = points[2:] if rng.random() < 0.6 else points[1:3]
    sleeve = _bar(part, [1.25 * wide] * 2) ^ _side(-1, gap)
    sleeve = sleeve if rng.random() < 0.6 else None
    steel = materials.metal(rng, brushed=False) if rng.random() < 0.6 else draw_grip_finish(rng)
    angle = float(np.deg2rad(rng.uniform(25, 70)))
    layer = float(rng.uniform(2.6, 6)) * unit
    return _halves(flat, radius, sleeve, layer, angle, (steel, draw_grip_finish(rng)))


def peg(rng: np.random.Generator) -> list[PartSpec]:
    """The parts of a clothes peg (metres): two wedges about a spring, closed at the front."""
    length = float(rng.uniform(0.06, 0.1))
    unit, lean = length / 100, float(rng.uniform(0.1, 0.24))
    front, gap, thick = (
        float(rng.uniform(35, 55)) * unit,
        0.5 * unit,
        float(rng.uniform(12, 20)) * unit,
    )
    rear, deep, r = (
        length - front,
        float(rng.uniform(9, 14)) * unit,
        float(rng.uniform(4, 6)) * unit,
    )
    slim = float(rng.uniform(0.3, 0.7)) * deep
    points = np.array(
        [
            [front, gap],
            [front, slim],
            [0.5 * front, deep],
            [-0.2 * rear, deep + 0.2 * rear * lean],
            [-rear, rear * lean + slim + gap],
            [-rear, gap + rear * lean],
            [0, gap],
        ]
    )
    flat = CrossSection([points]) - CrossSection.circle(r + 0.6 * unit, 20)
    if rng.random() < 0.7:  # a hollow for the line
        flat -= CrossSection.circle(0.4 * deep, 14).translate((0.5 * front, 0))
    coil = cylinder("z", [0, 0, -0.12 * thick], 1.24 * thick, r, segments=18)
    loops = [box([-r, 0, w], [r, deep + unit, w + 0.12 * thick]) for w in (-0.12 * thick, thick)]
    spring = union([coil, *loops])
    tone = draw_grip_finish(rng)
    other = tone if rng.random() < 0.8 else draw_grip_finish(rng)
    upper = cut(Manifold.extrude(flat, thick), [spring])
    lower = Manifold.extrude(flat.mirror((0, 1)), thick)
    metal = materials.metal(rng, brushed=False)
    first = Shape().add(tidy(upper), tone).add(spring, metal)
    joint = hinge((0, 0, 0), (0, 0, -1), 2 * float(np.arctan(lean)) * 0.85)
    return [("half", first, -1, None), ("half", Shape().add(tidy(lower), other), 0, joint)]

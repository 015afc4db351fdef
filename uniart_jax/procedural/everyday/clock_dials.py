"""Dials with their marks, hands and needles; finishes, outlines and roofs of clock cases. Lengths
are in metres."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.pieces import trimmed
from uniart_jax.procedural.shapes import (
    PartSpec,
    box,
    cylinder,
    extrusion,
    hinge,
    rounded,
    turn,
    union,
)


def draw_finish(rng: np.random.Generator) -> Material:
    """Draw the finish of a case: wood, bright plastic or enamel, metal, dark or white."""
    kind = rng.choice(5, p=[0.3, 0.34, 0.12, 0.12, 0.12])
    if kind == 0:
        return materials.wood(rng)
    if kind == 1:
        return plain(materials.hsv(rng, (0, 1), (0.35, 0.95), (0.35, 0.95)))
    if kind == 2:
        return materials.hardware(rng)
    return materials.dark(rng) if kind == 3 else materials.white_plastic(rng)


def dial(rng, x: float, y: float, z: float, radius: float):
    """A dial of ``radius`` metres on the plane x, facing -x, with its marks. Returns its pieces,
    the plane in front of them and a finish for hands."""
    light = rng.random() < 0.7
    face = plain(
        materials.hsv(rng, (0, 1), (0, 0.25 if light else 0.7), (0.85, 1) if light else (0.06, 0.4))
    )
    ink = materials.dark(rng) if light else plain(rng.uniform(0.75, 1, 3))
    thick, count = 0.03 * radius, int(rng.choice([0, 4, 12], p=[0.15, 0.25, 0.6]))
    pieces = [(cylinder("x", [x - thick, y, z], thick, radius, segments=32), face)]
    front = x - thick
    long, wide = float(rng.uniform(0.08, 0.2)) * radius, float(rng.uniform(0.03, 0.06)) * radius
    marks = [
        box([-thick / 2, -wide, 0.92 * radius - long], [0, wide, 0.92 * radius])
        .rotate((360 * k / count, 0, 0))
        .translate((front, y, z))
        for k in range(count)
    ]
    if count:
        pieces.append((union(marks), ink))
    tone = ink if rng.random() < 0.7 else plain(materials.hsv(rng, (0, 1), (0.6, 1), (0.3, 0.9)))
    return pieces, front - thick / 2, tone


def _hand(rng, front, y, z, long, wide, thick, degrees, sharp: bool) -> Manifold:
    """One hand that turns about x, its rear in the plane ``front``, turned clockwise from noon by
    ``degrees``."""
    tail = float(rng.uniform(0.1, 0.28)) * long
    tip = 0.25 * wide if sharp else wide
    plan = np.array(
        [
            [-wide, 0],
            [-0.7 * wide, -tail],
            [0.7 * wide, -tail],
            [wide, 0],
            [tip, long],
            [-tip, long],
        ]
    )
    solid = extrusion(plan, "x", [-thick, 0, 0], thick)
    solid += cylinder("x", [-thick, 0, 0], thick, 1.5 * wide, segments=16)
    return solid.rotate((degrees, 0, 0)).translate((front, y, z))


def hands(rng, front, y, z, radius, tone, bold: float = 1.0) -> list[PartSpec]:
    """The parts of an hour hand, a minute hand and at times a second hand (metres), one in front of
    the other. They turn without limit; ``bold`` scales their widths."""
    thick, air = 0.035 * bold * radius, 0.012 * radius
    sharp, parts = bool(rng.random() < 0.5), []
    lengths = [float(rng.uniform(0.5, 0.62)), float(rng.uniform(0.78, 0.92))]
    widths = [bold * float(rng.uniform(0.07, 0.11)), bold * float(rng.uniform(0.055, 0.08))]
    names = ["hour_hand", "minute_hand"]
    if rng.random() < 0.3:
        names, lengths, widths = [*names, "second_hand"], [*lengths, 0.88], [*widths, 0.045 * bold]
    angles = rng.uniform(0, 360) + np.array([0.0, rng.uniform(50, 310), rng.uniform(20, 340)])
    for k, name in enumerate(names):
        low = front - air - k * (thick + air)
        hand = _hand(
            rng, low, y, z, lengths[k] * radius, widths[k] * radius, thick, angles[k], sharp
        )
        finish = tone if k < 2 else plain((0.8, 0.1, 0.1))
        parts.append((name, trimmed((hand, finish)), 0, turn((low, y, z), (1, 0, 0))))
    return parts


def needle(rng, front, y, z, radius, tone, sweep: float) -> PartSpec:
    """The part of a needle (metres) that turns clockwise by ``sweep`` radians from the lower end of
    its scale."""
    thick, start = 0.05 * radius, -np.rad2deg(sweep) / 2
    hand = _hand(
        rng,
        front - 0.015 * radius,
        y,
        z,
        float(rng.uniform(0.7, 0.9)) * radius,
        float(rng.uniform(0.05, 0.09)) * radius,
        thick,
        start,
        True,
    )
    return "needle", trimmed((hand, tone)), 0, hinge((front, y, z), (1, 0, 0), sweep)


def case_outline(rng, kind: str, wide: float, tall: float) -> np.ndarray:
    """An outline [n, 2] of (y, z) in metres about 0 that holds a dial: round, square, polygonal,
    arched or a house."""
    if kind == "round":
        count = int(rng.choice([6, 8, 12, 40], p=[0.1, 0.2, 0.1, 0.6]))
        angle = (np.arange(count) + 0.5) * 2 * np.pi / count
        reach = 1 / np.cos(np.pi / count)
        return np.column_stack([wide / 2 * np.cos(angle), tall / 2 * np.sin(angle)]) * reach
    if kind == "arch":
        angle = np.linspace(0, np.pi, 17)
        arc = np.column_stack([np.cos(angle), np.sin(angle)]) * wide / 2
        return np.vstack(
            [arc + [0, tall / 2 - wide / 2], [[-wide / 2, -tall / 2], [wide / 2, -tall / 2]]]
        )
    if kind == "gable":
        peak = tall / 2 + float(rng.uniform(0.15, 0.4)) * wide
        return np.array(
            [
                [wide / 2, -tall / 2],
                [wide / 2, tall / 2],
                [0, peak],
                [-wide / 2, tall / 2],
                [-wide / 2, -tall / 2],
            ]
        )
    return rounded(wide, tall, float(rng.uniform(0.01, 0.25)) * wide)


def roof(half: float, eaves, ridge, at, depth: float) -> Manifold:
    """A gable roof, ``depth`` metres deep from ``at`` on. ``half`` is half its width; ``eaves`` and
    ``ridge`` are the (lower, upper) heights of its slab there."""
    (low, high), (under, top) = eaves, ridge
    outline = [[-half, low], [0, under], [half, low], [half, high], [0, top], [-half, high]]
    return extrusion(np.array(outline), "x", at, depth)

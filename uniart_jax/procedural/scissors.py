"""Scissors and shears: two halves about a pivot, its rivet a part of its own; lying flat or
standing."""

from __future__ import annotations

import numpy as np
from manifold3d import CrossSection, Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.poses import pose
from uniart_jax.procedural.shapes import Assembly, Shape, cylinder, extrusion, hinge, tidy, union


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A pair of scissors, metres, closed.

    Made in a frame (u towards the tips, v across, w through the layers) about the pivot, then
    turned into the room.
    """
    length = float(rng.uniform(0.12, 0.26))
    shears = rng.random() < 0.22  # long straight grips instead of rings
    if shears:
        length = float(rng.uniform(0.2, 0.6))
    unit = length / 100
    blade = float(rng.uniform(0.4, 0.6)) * length
    handle = length - blade
    thick, gap = float(rng.uniform(2.1, 2.8)) * unit, 0.45 * unit
    width = float(rng.uniform(4.5, 7.5)) * unit  # of a blade at the pivot
    steel = materials.metal(rng, brushed=False)
    grip = _grip(rng)
    boss, pin = 0.62 * width + 0.8 * unit, max(1.5 * unit, 0.25 * width)
    blunt = float(rng.uniform(0.05, 0.5))
    large = float(rng.uniform(1.0, 1.35)) if rng.random() < 0.5 else 1.0

    halves = [
        _half(blade, handle, width, boss, 1.0, blunt, shears, unit),
        _half(blade, handle, width, boss, large, blunt, shears, unit),
    ]
    placed = _frame(rng)
    asm, lower = Assembly(), Shape()
    flat, ring = halves[0]
    body = _extruded(flat, 0.0, thick)
    spindle = cylinder("z", [0, 0, 0], 2 * thick + 2 * gap, pin, segments=16)
    loop = _extruded(ring, 0.0, 2 * thick + gap)
    lower.add(tidy(placed(union([body - loop, spindle]))), steel).add(tidy(placed(loop)), grip)
    root = asm.add("half", lower)

    upper = Shape()
    flat, ring = (s.mirror((0, 1)) for s in halves[1])
    body = _extruded(flat, thick + gap, thick)
    loop = _extruded(ring, 0.0, 2 * thick + gap)
    bore = cylinder("z", [0, 0, -1], 3, pin + 0.35 * unit, segments=16)
    upper.add(tidy(placed((body - loop) - bore)), steel).add(tidy(placed(loop)), grip)
    axis = placed.turn @ np.array([0.0, 0, 1])
    swing = float(np.deg2rad(rng.uniform(45, 85)))
    asm.add("half", upper, root, hinge((0, 0, 0), axis, swing))

    top = 2 * thick + 2 * gap
    head = cylinder("z", [0, 0, top], 1.6 * unit, 0.72 * boss, 0.6 * boss, segments=18)
    if rng.random() < 0.5:  # a slot for the driver
        head -= extrusion(
            np.array([[-1, -0.35 * unit], [1, -0.35 * unit], [1, 0.35 * unit], [-1, 0.35 * unit]]),
            "z", [0, 0, top + 0.9 * unit], 1,
        )  # fmt: skip
    finish = materials.hardware(rng)
    asm.add("rivet", Shape().add(placed(head), finish), root)
    return asm.object()


def _extruded(section: CrossSection, low: float, height: float) -> Manifold:
    """A plane figure pushed along w from ``low``."""
    return Manifold.extrude(section, height).translate((0, 0, low))


def _grip(rng: np.random.Generator) -> Material:
    if rng.random() < 0.25:
        return materials.dark(rng)
    hue = rng.uniform(0, 1, 3)
    return materials.plain(0.15 + 0.75 * (hue - hue.min()) / max(np.ptp(hue), 1e-6))


def _half(
    blade, handle, width, boss, large, blunt, shears, unit
) -> tuple[CrossSection, CrossSection]:
    """The flat steel of one half and the figure of its grip: blade towards +u on -v, grip towards
    -u on +v."""
    edge = 0.22 * width
    tip = blunt * width
    outline = np.array(
        [
            [-0.3 * boss, edge],
            [-0.3 * boss, -0.5 * width],
            [0.3 * blade, -width],
            [0.75 * blade, -0.75 * width],
            [blade, -0.3 * tip],
            [blade - 0.4 * tip, min(edge, 0.4 * tip + 0.05 * width)],
            [0.6 * blade, edge],
        ]
    )
    disc = CrossSection.circle(boss, 24)
    radius = 0.21 * handle  # of the finger ring, its tube's centre line
    bar = max(2.2 * unit, 0.26 * radius)
    if shears:
        center = np.array([-handle, 0.16 * handle + 1.2 * bar])
        knee = np.array([-0.3 * handle, 0.07 * handle + boss * 0.5])
        flat = [np.array([0.0, 0.0]), knee, knee + 0.35 * (center - knee)]
        grip = strip(knee + 0.2 * (center - knee), center, 1.5 * bar, 1.25 * bar)
        steel = strip(flat[0], flat[1], 0.75 * boss, 0.9 * bar) + strip(
            flat[1], flat[2], 0.9 * bar, 0.8 * bar
        )
        return CrossSection([_ccw(outline)]) + disc + steel, grip
    tall = large * radius  # half length of the ring along u
    center = np.array([-handle + tall + bar, radius + bar + 0.8 * unit])
    ring = _oval(center, tall + bar, radius + bar) - _oval(
        center, tall - 0.2 * bar, radius - 0.2 * bar
    )
    entry = center + np.array(
        [(tall + 0.3 * bar) * np.cos(0.5), -(radius + 0.3 * bar) * np.sin(0.5)]
    )
    neck = entry + np.array([min(0.4 * handle, -boss - entry[0]) * 0.55, -0.15 * radius])
    steel = strip(np.zeros(2), entry, 0.75 * boss, 0.8 * bar)
    collar = strip(entry, neck * [1, 1], 1.1 * bar, 0.8 * bar) ^ CrossSection(
        [_ccw(np.array([[-9, 0.8 * unit], [0, 0.8 * unit], [0, 9], [-9, 9]]))]
    )
    steel = steel - _oval(center, tall - 0.2 * bar, radius - 0.2 * bar)
    return CrossSection([_ccw(outline)]) + disc + steel, ring + collar


def _ccw(points: np.ndarray) -> np.ndarray:
    x, y = points.T
    area = np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    return points if area > 0 else points[::-1]


def strip(a: np.ndarray, b: np.ndarray, wide_a: float, wide_b: float) -> CrossSection:
    """A bar between two points with rounded ends, ``wide`` its half widths there."""
    ends = [CrossSection.circle(w, 16).translate(tuple(p)) for p, w in ((a, wide_a), (b, wide_b))]
    return CrossSection.batch_hull(ends)


def _oval(center: np.ndarray, along: float, across: float) -> CrossSection:
    return CrossSection.circle(1.0, 28).scale((along, across)).translate(tuple(center))


class _frame:
    """How the scissors lie in the room: flat on a table, or standing with their flat side to the
    front."""

    def __init__(self, rng: np.random.Generator):
        self.turn = pose(rng, tilt=0.5)[:3, :3]

    def __call__(self, solid: Manifold) -> Manifold:
        return solid.transform(np.column_stack([self.turn, np.zeros(3)]))

"""Dispensers of paper and tape on rolls that turn, in metres."""

from __future__ import annotations

import dataclasses

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday import vessels
from uniart_jax.procedural.everyday.vessel_finishes import (
    clear,
    draw_dispenser_accent,
    draw_dispenser_plastic,
)
from uniart_jax.procedural.materials import plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cylinder,
    extrusion,
    hinge,
    tidy,
    tube,
    turn,
    union,
)


def roll(rng: np.random.Generator) -> ArticulatedObject:
    """A roll of paper that turns, on a wall or a stand (metres), under a hinged cover or in the
    open."""
    radius, wide = float(rng.uniform(0.05, 0.11)), float(rng.uniform(0.1, 0.26))
    unit = max(2.4 * radius, wide) / 100
    half, air = wide / 2, 0.8 * unit
    face, paper = draw_dispenser_plastic(rng), materials.white_plastic(rng)
    cheek, core = 2.5 * unit, 0.3 * radius
    plate = 3 * unit
    x, z = -radius - 2.5 * unit - plate, 1.25 * radius
    asm, body = Assembly(), Shape()
    wall = box([-plate, -half - cheek - air, 0], [0, half + cheek + air, 2.4 * radius])
    solids = [wall]
    for y in (-half - cheek - air, half + air):
        disc = cylinder("y", [x, y, z], cheek, 0.5 * radius, segments=20)
        arm = box([x, y, z - 0.3 * radius], [-0.5 * plate, y + cheek, z + 0.3 * radius])
        solids += [disc, arm]
    rod = cylinder("y", [x, -half - air - 0.5 * cheek, z], 2 * half + 2 * air + cheek, 0.6 * core)
    body.add(tidy(union([*solids, rod])), face)
    root = asm.add("body", body)
    shape = Shape().add(tube("y", [x, -half, z], wide, radius, core + 2 * unit, 32), paper)
    card = plain(materials.hsv(rng, (0.06, 0.1), (0.3, 0.6), (0.4, 0.7)))
    inner = tube("y", [x, -half - 0.4 * air, z], wide + 0.8 * air, core + 2 * unit, core, 32)
    shape.add(inner, card)
    asm.add("roll", shape, root, turn((x, 0, z), (0, 1, 0)))
    if rng.random() < 0.75:  # a cover: an arched or angular hood
        r0, t = radius + 1.8 * unit, 2 * unit
        angle = np.linspace(np.pi / 2, np.pi + float(rng.uniform(0.1, 0.6)), 9)
        outer = np.column_stack([z + (r0 + t) * np.sin(angle), x + (r0 + t) * np.cos(angle)])
        inner = np.column_stack([z + r0 * np.sin(angle), x + r0 * np.cos(angle)])
        back = -plate - air
        profile = np.vstack([[[z + r0 + t, back]], outer, inner[::-1], [[z + r0, back]]])
        hood = extrusion(profile, "y", [0, -half - cheek, 0], wide + 2 * cheek)
        angle = float(rng.uniform(0.7, 1.5))
        finish = dataclasses.replace(face) if rng.random() < 0.5 else clear(rng)
        joint = hinge((back, 0, z + r0 + t), (0, 1, 0), angle)
        asm.add("cover", Shape().add(tidy(hood), finish), root, joint)
    return asm.object()


def tape(rng: np.random.Generator) -> ArticulatedObject:
    """A tape dispenser in metres: a heavy foot with two cheeks, a reel between them, a blade in
    front."""
    radius = float(rng.uniform(0.03, 0.055))
    wide = radius * float(rng.uniform(0.45, 1.0))
    unit = radius / 30
    half, air, cheek = wide / 2, 0.6 * unit, 4 * unit
    face, tone = draw_dispenser_plastic(rng), draw_dispenser_accent(rng)
    long = radius * float(rng.uniform(3.2, 4.2))
    x, z = long - 1.3 * radius, radius * float(rng.uniform(1.15, 1.5))
    tip = radius * float(rng.uniform(0.7, 1.2))
    outside = half + cheek + air
    side = [[0, 0], [0, long], [0.8 * z, long], [z + 0.4 * radius, x + 0.4 * radius],
            [z + 0.4 * radius, x - 0.4 * radius], [0.5 * tip, 0.35 * long], [tip, 0.1 * long],
            [tip, 0]]  # fmt: skip
    solid = extrusion(np.array(side), "y", [0, -outside, 0], 2 * outside)
    well = cylinder("y", [x, -half - air, z], wide + 2 * air, radius + 2 * unit, segments=32)
    solid -= well
    core = float(rng.uniform(0.4, 0.62)) * radius
    axle = cylinder("y", [x, -half - 2 * air, z], wide + 4 * air, 0.3 * core, segments=16)
    asm, body = Assembly(), Shape()
    body.add(tidy(solid + axle), face)
    blade = box([-2 * unit, -half, tip - 3 * unit], [0, half, tip + 2 * unit])
    body.add(blade, materials.metal(rng, brushed=False))
    root = asm.add("body", body)
    ring_ = tube("y", [x, -half, z], wide, radius, core, 32)
    hub = tube("y", [x, -half, z], wide, core, 0.3 * core + air, 24)
    bars = [box([x - 0.2 * core, -half - 0.5 * air, z + 0.5 * core],
                [x + 0.2 * core, half + 0.5 * air, z + 0.9 * core])]  # fmt: skip
    tape = plain(materials.hsv(rng, (0.05, 0.2), (0.2, 0.6), (0.6, 0.95)))
    shape = Shape().add(ring_, tape if rng.random() < 0.6 else clear(rng))
    shape.add(tidy(hub + bars[0] - ring_), tone)
    asm.add("reel", shape, root, turn((x, 0, z), (0, 1, 0)))
    return vessels.turned(asm.object(), float(rng.choice([0.0, 90.0, -90.0, 45.0, -45.0])))

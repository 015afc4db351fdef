"""Cereal and napkin dispensers. The family's dispensers of soap, water, paper and tape are in
``soap_dispensers``, ``water_dispensers`` and ``roll_dispensers``."""

from __future__ import annotations

import dataclasses

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday import vessels
from uniart_jax.procedural.everyday.roll_dispensers import roll, tape
from uniart_jax.procedural.everyday.soap_dispensers import pump, spray, wall_soap
from uniart_jax.procedural.everyday.vessel_finishes import (
    clear,
    contrast,
    draw_dispenser_accent,
    draw_dispenser_plastic,
)
from uniart_jax.procedural.everyday.vessel_fittings import dome
from uniart_jax.procedural.everyday.vessels import frustum, stack
from uniart_jax.procedural.everyday.water_dispensers import water
from uniart_jax.procedural.fronts import add_knob
from uniart_jax.procedural.materials import plain
from uniart_jax.procedural.shapes import Assembly, Shape, box, hinge, slide, tidy, union


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A dispenser in metres, closed."""
    kinds = (wall_soap, pump, spray, water, _cereal, roll, _napkins, tape)
    chosen = int(rng.choice(8, p=[0.16, 0.14, 0.11, 0.19, 0.13, 0.1, 0.07, 0.1]))
    return kinds[chosen](rng)


def _cereal(rng: np.random.Generator) -> ArticulatedObject:
    """Clear hoppers on a stand, each with a knob that turns its wheel, a lid and at times a flap;
    or a round sweet dispenser."""
    count = int(rng.choice([1, 2, 3], p=[0.5, 0.35, 0.15]))
    sweets = count == 1 and rng.random() < 0.4
    height = float(rng.uniform(0.18, 0.3))
    unit = height / 60
    half = height * float(rng.uniform(0.24, 0.34))
    face, tone = draw_dispenser_plastic(rng), draw_dispenser_accent(rng)
    legs = float(rng.uniform(10, 22)) * unit
    neck, block = half * 0.75, float(rng.uniform(15, 20)) * unit
    power = 2.0 if sweets or rng.random() < 0.5 else 6.0
    outline = vessels.ring(32, 1.0, power)
    pitch = 2 * half + 2 * unit
    ys = (np.arange(count) - (count - 1) / 2) * pitch
    asm, body = Assembly(), Shape()
    foot = [box([-1.1 * half, ys[0] - half, 0], [1.2 * half, ys[-1] + half, 3 * unit])]
    foot.append(box([0.55 * half, ys[0] - 0.5 * half, 0],
                    [half, ys[-1] + 0.5 * half, legs + block]))  # fmt: skip
    boxes = [box([-0.9 * half, y - neck, legs], [0.9 * half, y + neck, legs + block]) for y in ys]
    chute = [box([-0.5 * half, y - 0.5 * neck, legs - 4 * unit], [0.3 * half, y + 0.5 * neck, legs])
             for y in ys]  # fmt: skip
    body.add(tidy(union([*foot, *boxes, *chute])), face)
    base = legs + block
    full = half * 0.96
    t = np.linspace(-0.85, 0.9, 9)
    if sweets:
        profile = np.column_stack([full * np.sqrt(1 - t**2), base + full * (t + 0.85)])
    else:
        profile = np.array([[neck, base], [full, base + 8 * unit], [full, base + height]])
    top, wall = profile[-1, 0], 1.6 * unit
    glass = clear(rng)
    for y in ys:
        jar = stack(profile, outline) - vessels.room(profile, outline, wall)
        body.add(tidy(jar).translate((0, y, 0)), glass)
        if rng.random() < 0.7:
            fill = profile[-1, 1] - base
            heap = vessels.room(profile, outline, 1.1 * wall)
            heap = heap ^ box([-1, -1, 0], [1, 1, base + fill * float(rng.uniform(0.3, 0.8))])
            food = plain(materials.hsv(rng, (0, 1), (0.4, 0.9), (0.5, 0.9)))
            body.add(heap.translate((0, y, 0)), food)
    root = asm.add("body", body)
    z, r = legs + 0.5 * block, float(rng.uniform(0.3, 0.42)) * block
    low = profile[-1, 1] + 0.4 * unit
    hinged = rng.random() < 0.4
    flap = count < 3 and rng.random() < 0.4
    for y in ys:
        mark = contrast(tone)
        add_knob(asm, root, (-0.9 * half, y, z), r, 0.8 * r, tone, mark, None)
        rise = float(rng.uniform(3, 7)) * unit
        lid = dome(outline, top, low, rise, 0.6 * rise)
        plug = 0.93 * (top - wall)
        lid += frustum(outline, 0.97 * plug, plug, low - 2 * unit, low + unit)
        shape = Shape().add(tidy(lid.translate((0, y, 0))), dataclasses.replace(face))
        joint = slide((0, 0, 1), 0.4 * height)
        if hinged:
            joint = hinge((top, 0, low), (0, 1, 0), float(rng.uniform(0.8, 1.5)))
        asm.add("lid", shape, root, joint)
        if flap:
            x = -0.5 * half - 1.2 * unit
            leaf = box([x - unit, y - 0.5 * neck, legs - 7 * unit],
                       [x, y + 0.5 * neck, legs - 0.6 * unit])  # fmt: skip
            joint = hinge((x - unit, y, legs - 0.6 * unit), (0, 1, 0), float(rng.uniform(0.5, 1.2)))
            asm.add("flap", Shape().add(leaf, tone), root, joint)
    return asm.object()


def _napkins(rng: np.random.Generator) -> ArticulatedObject:
    """A box of napkins or gloves with a flap in front and a lid on top."""
    half, depth = float(rng.uniform(0.05, 0.12)), float(rng.uniform(0.08, 0.2))
    height = float(rng.uniform(0.08, 0.24))
    unit = max(2 * half, depth, height) / 100
    wall, air = 2.2 * unit, 0.5 * unit
    face, tone = draw_dispenser_plastic(rng), draw_dispenser_accent(rng)
    face = materials.wood(rng, textured=False) if rng.random() < 0.2 else face
    case = box([0, -half, 0], [depth, half, height])
    case -= box([wall, -half + wall, wall], [depth - wall, half - wall, 1])
    z0, z1 = float(rng.uniform(0.1, 0.2)) * height, float(rng.uniform(0.55, 0.8)) * height
    w = float(rng.uniform(0.6, 0.8)) * half
    case -= box([-1, -w, z0], [2 * wall, w, z1])
    asm, body = Assembly(), Shape()
    body.add(tidy(case), face)
    pile = box([2 * wall, -half + 1.5 * wall, wall], [depth - 1.5 * wall, half - 1.5 * wall, z1])
    body.add(pile, materials.white_plastic(rng))
    root = asm.add("body", body)
    flap = box([0, -w + air, z0 + air], [wall, w - air, z1 - air])
    flap += box([-2 * unit, -0.4 * w, z1 - 6 * unit], [0.001, 0.4 * w, z1 - 3 * unit])
    joint = hinge((0, 0, z0 + air), (0, -1, 0), float(rng.uniform(0.7, 1.6)))
    shape = Shape().add(tidy(flap), tone if rng.random() < 0.6 else dataclasses.replace(face))
    asm.add("flap", shape, root, joint)
    lid = box([-unit, -half - unit, height + air], [depth + unit, half + unit, height + 3 * unit])
    joint = slide((0, 0, 1), float(rng.uniform(0.3, 0.7)) * height)
    if rng.random() < 0.7:
        joint = hinge((depth + unit, 0, height + air), (0, 1, 0), float(rng.uniform(0.9, 1.7)))
    asm.add("lid", Shape().add(lid, dataclasses.replace(face)), root, joint)
    return asm.object()

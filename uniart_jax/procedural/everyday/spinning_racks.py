"""Display racks whose tiers spin around a post."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.globe_stands import draw_finish, draw_foot
from uniart_jax.procedural.materials import plain
from uniart_jax.procedural.pieces import merged
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    ball,
    box,
    cylinder,
    pipe,
    tidy,
    tube,
    turn,
    union,
)


def spinning_rack(rng: np.random.Generator) -> ArticulatedObject:
    """A display rack in metres whose tiers spin around a post: shelves with jars, pockets with
    cards, hooks, or a case for books."""
    tall = rng.random() < 0.5
    high = float(rng.uniform(1.0, 1.7)) if tall else float(rng.uniform(0.15, 0.5))
    radius = high * (float(rng.uniform(0.13, 0.25)) if tall else float(rng.uniform(0.25, 0.7)))
    unit = max(high, 2 * radius) / 100
    finish, metal = draw_finish(rng), materials.hardware(rng)
    air, post, foot = (
        0.4 * unit,
        float(rng.uniform(1.2, 2.2)) * unit,
        float(rng.uniform(2, 4)) * unit,
    )
    count = int(rng.integers(1, 5)) if tall else int(rng.integers(1, 4))
    kind = str(rng.choice(["shelves", "pockets", "hooks", "case"], p=[0.4, 0.25, 0.15, 0.2]))
    if tall and kind != "shelves":
        count = int(rng.integers(2, 5)) + (kind == "pockets")
    whole = count > 1 and rng.random() < 0.35  # all tiers turn as one
    asm, stand = Assembly(), Shape()
    base = draw_foot(rng, radius * float(rng.uniform(0.6, 0.9)), foot, high, post)
    low = max(4.2 * foot, 0.12 * high)
    base -= tube("z", [0, 0, low - air], 9, 9, post)  # nothing wider than the post in the tiers
    knob = ball([0, 0, high + unit], 2.5 * unit, 16)
    stand.add(tidy(base - knob), finish).add(knob, metal)
    root = asm.add("stand", stand)
    pitch = (high - low - unit) / count
    sides, turned = int(rng.integers(3, 7)), float(rng.uniform(0, 90))
    tone = finish if rng.random() < 0.6 else metal
    tiers = []
    for k in range(count):
        wide = radius * (1 - 0.12 * k * float(rng.random() < 0.5))
        free = (1.2 if not whole or k == count - 1 else -0.4) * unit  # below the next tier
        start = low + k * pitch
        tiers.append(
            _draw_tier(rng, kind, wide, start, pitch - free, post + air, sides, unit, tone)
        )
    if whole:
        tiers = [[piece for tier in tiers for piece in tier]]
    for tier in tiers:
        asm.add("tier", merged(tier, turned), root, turn((0, 0, 0), (0, 0, 1)))
    return asm.object()


def _draw_tier(rng, kind, radius, low, high, hole, sides, unit, tone) -> list:
    """The solids and materials of one tier around a post of radius ``hole``: it begins at z =
    ``low`` and is ``high`` tall."""
    sleeve = tube("z", [0, 0, low], high, hole + 1.5 * unit, hole, 20)
    thick = 1.5 * unit
    if kind == "hooks":
        bars = [sleeve]
        for k in range(2 * sides):
            a = np.pi * k / sides
            c, s = np.cos(a), np.sin(a)
            z = low + high * (0.85 if k % 2 else 0.4)
            bars.append(
                pipe(
                    [
                        [(hole + unit) * c, (hole + unit) * s, z],
                        [radius * c, radius * s, z],
                        [1.02 * radius * c, 1.02 * radius * s, z + 4 * unit],
                    ],
                    0.8 * unit,
                    8,
                )
            )
        solid = union(bars) - cylinder("z", [0, 0, 0], 9, hole, segments=20)
        return [(solid, tone)]
    plate = tube("z", [0, 0, low], thick, radius, hole, 36)
    if kind == "case" or (kind == "pockets" and rng.random() < 0.5):
        plate = tube("z", [0, 0, low], thick, radius, hole, 4).rotate((0, 0, 45))
        sides = 4
    solids = [sleeve, plate]
    goods = []
    inside = radius * (0.72 if sides == 4 else 0.8)
    for k in range(sides):
        turned = 360.0 * k / sides
        color = plain(rng.uniform(0.1, 0.95, 3))
        if kind == "case":  # walls that make room for books
            w = 0.68 * radius
            wall = box([hole, -thick / 2, low], [w, thick / 2, low + high])
            solids.append(wall.rotate((0, 0, turned)))
            long, at = 0.8 * (w - hole - 2 * unit), hole + 3 * unit
            for _ in range(3):
                wide = float(rng.uniform(2, 5)) * unit
                if at + wide > w or long < 3 * unit:
                    break
                book = box(
                    [at, thick / 2 + 0.2 * unit, low + thick],
                    [at + wide, long, low + high * rng.uniform(0.6, 0.9)],
                )
                goods.append((book.rotate((0, 0, turned)), plain(rng.uniform(0.1, 0.9, 3))))
                at += wide + 0.3 * unit
        elif kind == "pockets":  # cards that lean outwards
            w = 0.85 * inside * np.tan(np.pi / max(sides, 4))
            card = box(
                [inside - 1.5 * thick, -w, low + thick],
                [inside - 0.5 * thick, w, low + 0.95 * high],
            )
            lip = box(
                [inside - 0.3 * thick, -1.05 * w, low],
                [inside + 0.7 * thick, 1.05 * w, low + 0.3 * high],
            )
            solids.append(lip.rotate((0, 0, turned)))
            goods.append((card.rotate((0, 0, turned)), color))
        elif rng.random() < 0.8:  # jars
            r = min(0.3 * radius, 0.75 * 0.65 * radius * np.sin(np.pi / sides))
            tall = high * float(rng.uniform(0.4, 0.85)) - thick
            jar = cylinder("z", [0.66 * radius, 0, low + thick], tall, r, segments=16)
            goods.append((jar.rotate((0, 0, turned)), color))
    if kind == "shelves" and rng.random() < 0.7:
        solids.append(tube("z", [0, 0, low], 5 * unit, radius, radius - unit, 36))
    solid = union(solids) - cylinder("z", [0, 0, 0], 9, hole, segments=20)
    kept = [(good - solid, color, good.volume()) for good, color in goods]
    return [(solid, tone), *((left, color) for left, color, v in kept if left.volume() > 0.3 * v)]

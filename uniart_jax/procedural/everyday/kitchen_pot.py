"""Saucepans, casseroles, roasters, steamers and camp pots with lids that lift, turn or are hinged,
and handles that fold. Pressure cookers and slow cookers are in ``pot_cookers``."""

from __future__ import annotations

import dataclasses

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday import vessels
from uniart_jax.procedural.everyday.pot_cookers import pressure_cooker, slow_cooker
from uniart_jax.procedural.everyday.pot_fittings import (
    add_bail,
    add_folding_long,
    add_folding_pair,
    add_lid,
    add_long_handle,
    add_pair,
    add_pins,
)
from uniart_jax.procedural.everyday.vessel_finishes import draw_pot_finish, draw_pot_trim
from uniart_jax.procedural.everyday.vessels import frustum, half_width, radius_at, silhouette, stack
from uniart_jax.procedural.shapes import Assembly, Shape, box, slide, tidy


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A pot in metres, its lid on; a long handle may point in any direction."""
    kind = rng.choice(3, p=[0.66, 0.18, 0.16])
    if kind == 2:
        return slow_cooker(rng)
    obj = _pot(rng) if kind == 0 else pressure_cooker(rng)
    yaw = float(rng.choice([0.0, 90.0, -90.0, 180.0, rng.uniform(-180, 180)]))
    return vessels.turned(obj, yaw)


def _pot(rng: np.random.Generator) -> ArticulatedObject:
    """A stovetop pot, from a flat pan to a tall pot, with one long handle, two short ones or a
    bail."""
    radius = float(rng.uniform(0.08, 0.17))
    plan = str(rng.choice(["round", "oval", "oblong", "flats"], p=[0.7, 0.13, 0.12, 0.05]))
    outline = vessels.ring(36)
    if plan == "oval":
        outline = vessels.ring(36, float(rng.uniform(1.2, 1.6)))
    elif plan == "oblong":
        outline = vessels.ring(36, float(rng.uniform(1.0, 1.6)), float(rng.uniform(4, 7)))
    elif plan == "flats":
        outline = vessels.ring(int(rng.choice([8, 10, 12])))
    across = half_width(outline) * radius
    height = radius * float(rng.choice([rng.uniform(0.3, 0.6), rng.uniform(0.6, 1.2),
                                        rng.uniform(1.2, 2.2)], p=[0.25, 0.5, 0.25]))  # fmt: skip
    unit = max(2 * across, 2 * radius, height) / 100
    air, wall = 0.5 * unit, 2.0 * unit
    face = draw_pot_finish(rng)
    trim = draw_pot_trim(rng, face)
    bottom = radius * float(rng.choice([1.0, rng.uniform(0.65, 1.0)]))
    belly = max(radius, bottom) * float(rng.choice([1.0, rng.uniform(1.0, 1.15)], p=[0.7, 0.3]))
    at = float(rng.uniform(0.2, 0.6)) if belly > radius else 0.95
    fillet = min(0.4 * height, float(rng.choice([0.02, rng.uniform(0.05, 0.3)])) * radius)
    profile = silhouette(bottom, belly, radius, at, 0.0, height, fillet)
    solid = stack(profile, outline)

    asm, body = Assembly(), Shape()
    shell = solid - vessels.room(profile, outline, wall)
    if rng.random() < 0.5:  # a rolled rim
        lip = np.array([[radius + 0.2 * unit, height - 2 * unit], [radius + 1.3 * unit, height]])
        shell += stack(lip, outline) - stack(lip * [0, 2] + [radius - wall, -height], outline)
    body.add(tidy(shell), face)
    if rng.random() < 0.25:  # a base of another metal or a band of colour
        z = float(rng.uniform(0, 0.55)) * height
        band = box([-1, -1, z], [1, 1, z + float(rng.uniform(0.06, 0.2)) * height])
        skin = stack(profile * [1 + 0.7 * unit / radius, 1], outline) ^ band
        body.add(tidy(skin - solid), trim if rng.random() < 0.5 else materials.hardware(rng))
    manner = str(rng.choice(["long", "pair", "folding pair", "bail", "folding long"],
                            p=[0.26, 0.34, 0.16, 0.12, 0.12]))  # fmt: skip
    z = height * float(rng.uniform(0.62, 0.85))
    if height < 0.5 * radius:
        z = 0.7 * height
    reach = radius_at(profile, z)
    moving: list[tuple] = []
    if manner == "long":
        add_long_handle(rng, body, solid, reach, z, radius, unit, trim)
    elif manner == "folding long":
        moving.append(add_folding_long(rng, body, solid, profile, z, radius, unit, trim))
    elif manner == "pair":
        add_pair(rng, body, solid, across * reach / radius, z, unit, trim)
    elif manner == "folding pair":
        moving += add_folding_pair(rng, body, solid, profile, across / radius, z, unit, trim)
    pivot = add_pins(body, solid, across, profile, unit, trim) if manner == "bail" else None
    root = asm.add("body", body)
    low, parent = height + air, root
    if plan != "flats" and rng.random() < 0.16 and height > 0.5 * radius:  # a steamer's basket
        parent, low = _basket(rng, asm, root, profile, outline, unit, wall, air, face, trim)
    lidded = rng.random() < 0.92 or not moving
    crown = low
    if lidded:
        way = "lift"
        if manner in ("pair", "folding pair", "long") and parent == root and rng.random() < 0.22:
            way = "hinge"
        elif plan == "round" and rng.random() < 0.1:
            way = "turn"
        steep = way == "hinge" and manner == "long"
        crown = add_lid(rng, asm, parent, outline, radius, wall, low, unit, way, steep, face, trim)
    if pivot is not None:
        add_bail(rng, asm, root, pivot, radius, crown, unit, trim)
    for name, shape, joint in moving:
        asm.add(name, shape, root, joint)
    return asm.object()


def _basket(rng, asm, root, profile, outline, unit, wall, air, face, trim) -> tuple[int, float]:
    """Add a steamer basket that stands in the pot's rim and lifts out; returns its index and the
    height of the lid's rest."""
    high, radius = profile[-1, 1], profile[-1, 0]
    tall = radius * float(rng.uniform(0.35, 0.8))
    low = high + air
    wider = silhouette(0.97 * radius, radius, radius, 0.3, low, low + tall)
    solid = stack(wider, outline)
    inner = 0.94 * (radius - wall)
    plug = frustum(outline, 0.97 * inner, inner, low - 4 * unit, low + unit)
    shape = Shape()
    shape.add(tidy((solid + plug) - vessels.room(wider, outline, wall)), face)
    if rng.random() < 0.7:
        reach = radius * half_width(outline)
        add_pair(rng, shape, solid, reach, low + 0.6 * tall, unit, dataclasses.replace(trim))
    way = slide((0, 0, 1), float(rng.uniform(0.5, 1.0)) * tall + 4 * unit)
    return asm.add("basket", shape, root, way), low + tall + air

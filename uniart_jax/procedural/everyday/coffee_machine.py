"""Drip and capsule coffee machines. The family's espresso machines and grinders are in
``coffee_espresso`` and ``coffee_grinders``."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.coffee_espresso import bean_to_cup_machine, espresso_machine
from uniart_jax.procedural.everyday.coffee_fittings import (
    add_buttons,
    add_drip_tray,
    add_lid,
    button_wells,
    column,
    draw_finish,
    draw_jug,
    draw_trim,
)
from uniart_jax.procedural.everyday.coffee_grinders import electric_grinder, hand_mill
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    extrusion,
    hinge,
    rounded,
    slide,
    tidy,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A coffee machine or grinder in metres, closed, its controls at -x."""
    kinds = (
        _filter_machine,
        espresso_machine,
        bean_to_cup_machine,
        _capsule_machine,
        hand_mill,
        electric_grinder,
    )
    return kinds[rng.choice(6, p=[0.24, 0.29, 0.15, 0.14, 0.09, 0.09])](rng)


def _filter_machine(rng: np.random.Generator) -> ArticulatedObject:
    """A drip machine: a column with a tank and a head over a hot plate, a jug, a lid, and a filter
    that swings or slides out."""
    high, half = float(rng.uniform(0.28, 0.4)), float(rng.uniform(0.08, 0.12))
    depth = float(rng.uniform(0.2, 0.28))
    unit = high / 100
    air = 0.35 * unit
    face = draw_finish(rng)
    trim = draw_trim(rng, face)
    base, head = float(rng.uniform(0.08, 0.14)) * high, float(rng.uniform(0.58, 0.7)) * high
    back = float(rng.uniform(0.56, 0.66)) * depth
    corner = float(rng.uniform(0.05, 0.6)) * half
    roof = head + float(rng.uniform(0.5, 0.75)) * (high - head)
    asm, body = Assembly(), Shape()
    whole = column(depth, half, 0, high, corner)
    room = box([-1, -1, base], [back, 1, head])
    radius = min(0.44 * back, 0.8 * half)
    x = 0.5 * back + 0.02 * depth
    filter_kind = str(rng.choice(["swing", "slide", "none"], p=[0.5, 0.2, 0.3]))
    holder = column(depth, half, head, roof, corner) ^ box([-1, -1, 0], [back - air, 1, 1])
    solid = whole - room
    if filter_kind != "none":
        solid -= box([-1, -1, head - 1e-3], [back, 1, roof + air])
        holder += _outlet(x, head, radius, unit)
        grip = box(
            [-3 * unit, -5 * unit, (head + roof) / 2 - 1.5 * unit],
            [1.5 * unit + 0.3 * corner, 5 * unit, (head + roof) / 2 + 1.5 * unit],
        )
    else:
        solid += _outlet(x, head, radius, unit)
    r = 2.2 * unit
    ys = [-0.5 * half, -0.5 * half + 3.4 * r][: int(rng.integers(0, 3))]
    ys = ys if base > 2.8 * r and corner < 0.3 * half else []
    body.add(tidy(cut(solid, button_wells(0, ys, base / 2, r))), face)
    plate = cylinder("z", [x, 0, base], 0.8 * unit, 1.02 * radius, segments=28)
    body.add(plate, materials.dark(rng))
    if rng.random() < 0.4:  # a gauge of the water's height
        y = half
        gauge = box(
            [back + 0.3 * (depth - back), y, 0.2 * high],
            [back + 0.6 * (depth - back), y + 0.8 * unit, 0.6 * high],
        )
        body.add(gauge, materials.glass(rng))
    root = asm.add("body", body)
    if filter_kind == "swing":
        side = float(rng.choice([-1, 1]))
        joint = hinge(
            (back - air, side * half, 0), (0, 0, -side), float(np.deg2rad(rng.uniform(60, 95)))
        )
        holder += _outlet(x, head, radius, unit)
    if filter_kind != "none":
        part = Shape().add(tidy(holder), face if rng.random() < 0.5 else trim)
        part.add(tidy(grip - holder), trim)
        if filter_kind == "slide":
            joint = slide((-1, 0, 0), float(rng.uniform(0.4, 0.8)) * back)
        asm.add("filter", part, root, joint)
    lid_from = 0.06 * depth if rng.random() < 0.5 else back
    inset = 0.3 * corner + unit
    lo, hi = [lid_from + inset, -half + inset], [depth - inset, half - inset]
    add_lid(rng, asm, root, lo, hi, high, unit, face if rng.random() < 0.4 else trim)
    if rng.random() < 0.85:
        jug = draw_jug(rng, x, base + 1.1 * unit, head - 3.6 * unit, radius, unit, trim)
        asm.add("jug", jug, root, slide((-1, 0, 0), float(rng.uniform(0.5, 0.9)) * depth))
    add_buttons(rng, asm, root, 0, ys, base / 2, r, trim)
    return asm.object()


def _outlet(x, head, radius, unit) -> Manifold:
    """The cone under a filter through which the coffee runs out."""
    return cylinder("z", [x, 0, head - 3 * unit], 3.5 * unit, 0.45 * radius, 0.8 * radius)


def _capsule_machine(rng: np.random.Generator) -> ArticulatedObject:
    """A narrow capsule machine: a head on a column, a lever on top, a drip tray below, a tank
    behind."""
    high, half = float(rng.uniform(0.23, 0.33)), float(rng.uniform(0.05, 0.085))
    depth, unit = float(rng.uniform(0.24, 0.34)), high / 100
    air = 0.4 * unit
    face = draw_finish(rng)
    trim = draw_trim(rng, face)
    base, head = float(rng.uniform(0.1, 0.16)) * high, float(rng.uniform(0.62, 0.72)) * high
    back = float(rng.uniform(0.4, 0.5)) * depth
    nose = float(rng.uniform(0.1, 0.35)) * back
    asm, body = Assembly(), Shape()
    end = 0.72 * depth
    profile = rounded(high - head, end - nose, float(rng.uniform(0.1, 0.5)) * (high - head), 6)
    top = extrusion(profile, "y", [(nose + end) / 2, -half, (head + high) / 2], 2 * half)
    stem = box([back, -0.85 * half, 0.5 * base], [end, 0.85 * half, (head + high) / 2])
    tray_lo, tray_hi = (
        np.array([0.0, -0.8 * half, 0.2 * base]),
        np.array([back - air, 0.8 * half, base]),
    )
    foot = column(end, half, 0, base, 0.2 * half) - box(
        tray_lo - [1, air, air], [back, tray_hi[1] + air, 1]
    )
    if rng.random() < 0.4:  # the base only behind, the tray stands in front
        foot = column(end, half, 0, base, 0.1 * half, back)
        tray_lo = np.array([0.0, -0.95 * half, 0.0])
        tray_hi[1] = 0.95 * half
    spout_x = (nose + back) / 2
    spout = cylinder("z", [spout_x, 0, head - 5 * unit], 5.5 * unit, 2.2 * unit, 4 * unit, 18)
    body.add(tidy(union([foot, stem, top])), face)
    body.add(tidy(spout - top), trim)
    root = asm.add("body", body)
    add_drip_tray(rng, asm, root, tray_lo, tray_hi, unit, trim)
    pivot = np.array([end - (high - head) * 0.4 - 0.05 * depth, 0, (head + high) / 2])
    corner = [nose, (head + high) / 2 + 0.5 * (high - head)]
    reach = np.hypot(pivot[0] - corner[0], pivot[2] - corner[1]) + 4 * unit
    steel = trim if rng.random() < 0.5 else materials.metal(rng, brushed=False)
    thick, tall = 2.4 * unit, float(rng.uniform(2, 3.5)) * unit
    rise = float(np.deg2rad(rng.uniform(0, 30)))
    arms = []
    for y in (-half - air - thick, half + air):
        arms += [
            box([-reach, y, -tall], [0, y + thick, tall]),
            cylinder("y", [0, y, 0], thick, 1.7 * tall, segments=18),
        ]
    grip = box(
        [-reach, -half - air - thick, -tall], [-reach + 2.6 * unit, half + air + thick, tall]
    )
    bow = union([*arms, grip]).rotate((0, np.rad2deg(rise), 0)).translate(tuple(pivot))
    up = float(np.deg2rad(rng.uniform(60, 95))) - 0.5 * rise
    asm.add("lever", Shape().add(tidy(bow), steel), root, hinge(pivot, (0, 1, 0), up))
    t, top = depth - end - air, 0.96 * high
    water, outline = materials.glass(rng), rounded(t, 1.9 * half, 0.45 * t)
    tank = extrusion(outline, "z", [end + air + t / 2, 0, 0], top)
    lifted = rng.random() < 0.5
    travel = slide((0, 0, 1), float(rng.uniform(0.3, 0.7)) * high)
    owner = asm.add("tank", Shape().add(tank, water), root, travel if lifted else None)
    if rng.random() < 0.6:
        lid = extrusion(outline, "z", [end + air + t / 2, 0, top + air], 3 * unit)
        joint = hinge((depth, 0, top + air), (0, 1, 0), np.deg2rad(rng.uniform(60, 100)))
        asm.add("lid", Shape().add(lid, face), owner, joint)
    return asm.object()

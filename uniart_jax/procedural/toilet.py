"""Toilets: seat and lid about one rear axis, a flush lever or buttons on a cistern or a wall
panel."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    egg,
    extrusion,
    hinge,
    hull,
    loft,
    pipe,
    rounded,
    slide,
    tidy,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A toilet, metres, closed."""
    length, half = float(rng.uniform(0.40, 0.50)), float(rng.uniform(0.165, 0.195))
    rim = float(rng.uniform(0.36, 0.44))
    power = float(rng.uniform(2.3, 4.5))
    front, rear = 0.62 * length, 0.38 * length
    ceramic = materials.white_plastic(rng)
    if rng.random() < 0.25:
        ceramic = materials.paint(rng)
    plastic = ceramic if rng.random() < 0.55 else materials.white_plastic(rng)
    if rng.random() < 0.25:
        plastic = materials.wood(rng, grain="x") if rng.random() < 0.6 else materials.dark(rng)
    chrome = materials.hardware(rng) if rng.random() < 0.7 else ceramic.darker(0.8)
    seat_thick, lid_thick = float(rng.uniform(0.017, 0.024)), float(rng.uniform(0.016, 0.026))
    flush = str(rng.choice(["lever", "button", "dual"], p=[0.4, 0.3, 0.3]))
    wall_hung = rng.random() < 0.18  # a panel in the wall instead of a cistern
    if wall_hung and flush == "lever":
        flush = "dual"

    axis_x, axis_z = rear + 0.016, rim + 0.004
    lid_top = 0.004 + seat_thick + 0.003 + lid_thick  # above the axis
    lever_reach = 0.03 if flush == "lever" else 0.0
    gap = lid_top + lever_reach + float(rng.uniform(0.012, 0.05))  # from the axis to the cistern
    tank_x = axis_x + gap

    asm, body = Assembly(), Shape()
    body.add(_bowl(rng, front, rear, half, power, rim, tank_x, wall_hung), ceramic)
    posts = [
        cylinder("y", [axis_x, y - 0.02, axis_z + 0.004], 0.04, 0.011, segments=14)
        for y in (-0.45 * half, 0.45 * half)
    ]
    feet = [
        box([axis_x - 0.009, y - 0.016, rim - 0.002], [axis_x + 0.009, y + 0.016, axis_z])
        for y in (-0.45 * half, 0.45 * half)
    ]
    body.add(cut(union([*posts, *feet]), (box([-1, -1, -1], [1, 1, rim]),)), chrome)
    press, lever_at = _cistern(rng, body, ceramic, tank_x, rim, wall_hung, flush)
    root = asm.add("body", body)

    room = gap - lever_reach - 0.005
    outer = egg(front - 0.002, rear - 0.001, half - 0.002, power)
    inner = egg(0.66 * front, 0.52 * rear, 0.58 * half, 2.2)
    z = rim + 0.004
    ring = extrusion(outer, "z", [0, 0, z], seat_thick) - extrusion(inner, "z", [0, 0, z - 1], 2)
    if rng.random() < 0.2:  # public toilets: the ring is open in front
        ring = ring - box([-1, -0.05, 0], [-0.5 * front, 0.05, 2])
    at = (axis_x, 0.0, axis_z + 0.004)
    swing = _widest(length + 0.02, lid_top, room)
    swing = min(swing, float(np.deg2rad(rng.uniform(92, 108))))
    asm.add("seat", Shape().add(ring, plastic), root, hinge(at, (0, 1, 0), swing - 0.02))

    z += seat_thick + 0.003
    if rng.random() < 0.5:
        plate = extrusion(outer, "z", [0, 0, z], lid_thick)
    else:  # domed
        small = egg(0.9 * front, 0.9 * rear, 0.88 * half, power)
        plate = loft(outer, outer, z, z + 0.55 * lid_thick) + loft(
            outer, small, z + 0.5 * lid_thick, z + lid_thick
        )
    asm.add("lid", Shape().add(plate, plastic), root, hinge(at, (0, 1, 0), swing))

    if flush == "lever":
        x, y, height = lever_at
        reach, arm = 0.026, float(rng.uniform(0.07, 0.1))
        boss = cylinder("x", [x - reach, y, height], reach - 0.001, 0.017, segments=16)
        bar = pipe([[x - 0.018, y, height], [x - 0.018, y - arm, height - 0.004]], 0.0085)
        joint = hinge((x, y, height), (1, 0, 0), float(np.deg2rad(rng.uniform(25, 45))))
        asm.add("flush_lever", Shape().add(union([boss, bar]), chrome), root, joint)
    for solid, direction in press:
        joint = slide(direction, 0.012)
        asm.add("flush_button", Shape().add(solid, chrome), root, joint)
    return asm.object()


def _widest(length: float, top: float, room: float) -> float:
    """Largest angle at which a slab ``length`` long, its top ``top`` above the axis, stays ``room``
    in front of the cistern."""
    angles = np.linspace(np.pi / 2, np.deg2rad(110), 200)
    fits = -length * np.cos(angles) + top * np.sin(angles) <= room
    return float(angles[fits][-1]) if fits.any() else float(np.deg2rad(85))


def _bowl(rng, front, rear, half, power, rim, tank_x, wall_hung):
    """The bowl with its hollow, its foot and the deck towards the cistern."""
    outline = egg(front, rear, half, power)
    neck = float(rng.uniform(0.55, 0.75))
    waist = rim * float(rng.uniform(0.3, 0.5))
    deck_y = float(rng.uniform(0.55, 0.9)) * half
    back = tank_x + 0.14
    deck = hull(
        np.array(
            [
                [x, y, z]
                for x, y, z in (
                    (0.2 * rear, deck_y, rim),
                    (back, deck_y, rim),
                    (back, deck_y * 0.85, rim - 0.12),
                    (0.2 * rear, deck_y * 0.85, rim - 0.12),
                )
                for y in (-y, y)
            ]
        )
    )
    cup = loft(outline * neck, outline, waist, rim - 0.045)
    edge = loft(outline, outline, rim - 0.046, rim)
    solids = [cup, edge, deck]
    if wall_hung:
        solids = [loft(outline * 0.6, outline, rim - 0.26, rim - 0.045), edge, deck]
        solids.append(box([0.1 * rear, -0.7 * deck_y, rim - 0.25], [back, 0.7 * deck_y, rim - 0.1]))
    elif rng.random() < 0.35:  # skirted: straight down to the floor
        solids.append(loft(outline * 0.8 + [0.03, 0], outline, 0, rim - 0.04))
        solids.append(box([0, -0.75 * half, 0], [back, 0.75 * half, rim - 0.05]))
    else:
        foot = np.add(egg(0.5 * front, 1.1 * rear, 0.62 * half, 3.0), [0.05, 0])
        solids.append(loft(foot, outline * neck, 0, waist + 0.01))
        solids.append(loft(foot * 1.08, foot, 0, 0.05))
        solids.append(box([0.3 * rear, -0.42 * half, 0.03], [back - 0.03, 0.42 * half, rim - 0.08]))
    water = egg(0.3 * front, 0.35 * rear, 0.35 * half)
    hollow = loft(water, egg(0.76 * front, 0.7 * rear, 0.72 * half, 2.2), rim - 0.19, rim + 0.001)
    return tidy(cut(union(solids), (hollow,)))


def _cistern(rng, body: Shape, ceramic: Material, x: float, rim, wall_hung, flush):
    """Cistern (or wall panel) and its buttons; returns ([(button, direction)], lever place)."""
    count = {"lever": 0, "button": 1, "dual": 2}[flush]
    if wall_hung:
        wide, low, high = (
            float(rng.uniform(0.22, 0.3)),
            rim - 0.30,
            rim + float(rng.uniform(0.48, 0.6)),
        )
        slab = box([x, -wide, low], [x + 0.14, wide, high])
        size = (0.055, 0.05)
        z = high - 0.14
        spots = [(0.0, z)] if count == 1 else [(0.062, z), (-0.062, z)]
        holes = [
            box([x - 1, y - size[0] - 0.003, h - size[1] - 0.003], [x + 0.03, y + size[0] + 0.003, h + size[1] + 0.003])  # noqa: E501
            for y, h in spots
        ]  # fmt: skip
        body.add(cut(slab, holes), ceramic)
        press = [
            (box([x - 0.012, y - size[0], h - size[1]], [x + 0.013, y + size[0], h + size[1]]), (1, 0, 0))  # noqa: E501
            for y, h in spots
        ]  # fmt: skip
        return press, (x, 0.0, high)
    wide, deep = float(rng.uniform(0.17, 0.235)), float(rng.uniform(0.15, 0.2))
    high = rim + float(rng.uniform(0.3, 0.4))
    cover = float(rng.uniform(0.025, 0.045))
    radius = float(rng.uniform(0.01, 0.05))
    center = [x + deep / 2, 0, 0]
    top = rounded(deep, 2 * wide, radius)
    bottom = top * [1.0, float(rng.uniform(0.82, 1.0))]
    bottom[:, 0] += 0.5 * (1 - np.ptp(bottom[:, 0]) / deep) * deep
    tank = loft(bottom, top, rim - 0.002, high - cover).translate(tuple(center))
    lid = rounded(deep + 0.012, 2 * wide + 0.016, radius)
    lid = extrusion(lid, "z", [x + deep / 2 + 0.003, 0, high - cover], cover)
    place = (x, wide - 0.05, high - cover - 0.05)
    if not count:
        body.add(tidy(union([tank, lid])), ceramic)
        return [], place
    r = float(rng.uniform(0.024, 0.032))
    at = [x + deep / 2, 0.0, high - 0.017]
    disc = cylinder("z", at, 0.029, r, segments=20)
    well = cylinder("z", [at[0], 0, high - 0.032], 1.0, r + 0.003, segments=20)
    body.add(tidy(cut(union([tank, lid]), (well,))), ceramic)
    if count == 1:
        return [(disc, (0, 0, -1))], place
    parts = [
        disc - box([-1, -1, 0], [2, 0.0025, 2]),
        disc - box([-1, -0.0025, 0], [2, 1, 2]),
    ]
    return [(p, (0, 0, -1)) for p in parts], place

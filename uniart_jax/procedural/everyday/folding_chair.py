"""Folding chairs, loungers and theatre seats. The family's tables and ladders are in
``folding_tables`` and ``folding_ladders``."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday import folding_ladders, folding_tables
from uniart_jax.procedural.everyday.folding_frames import (
    AIR,
    angle_between,
    bar,
    bar_frame,
    draw_cover_finish,
    draw_frame_finish,
    frame_shape,
    panel,
)
from uniart_jax.procedural.shapes import (
    PartSpec,
    about_z,
    assembled,
    box,
    cut,
    cylinder,
    extrusion,
    hinge,
    hull,
    rounded,
    turn,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A piece of folding furniture in metres, as it stands in use; at times turned about z."""
    kinds = (
        _chair,
        folding_tables.crossed,
        folding_tables.table,
        folding_ladders.ladder,
        folding_ladders.rack,
        _lounger,
        _theatre,
    )
    make = kinds[rng.choice(len(kinds), p=[0.27, 0.2, 0.16, 0.12, 0.08, 0.08, 0.09])]
    free = 0.2 if make in (_chair, _theatre) else 0.6
    yaw = float(rng.choice([0, 90, 180, rng.uniform(-180, 180)])) if rng.random() < free else 0.0
    return assembled(make(rng), about_z(np.deg2rad(yaw)))


def _chair(rng: np.random.Generator) -> list[PartSpec]:
    """A chair: front legs and back in one frame, rear legs about a bolt, a seat that tips up."""
    tone, square = draw_frame_finish(rng)
    cover = draw_cover_finish(rng, tone)
    tall = float(rng.choice([1.0, rng.uniform(1.3, 1.6)], p=[0.85, 0.15]))  # bar chairs
    seat, r = float(rng.uniform(0.4, 0.48)) * tall, float(rng.uniform(0.012, 0.021))
    half, back = float(rng.uniform(0.18, 0.26)), float(rng.uniform(0.32, 0.5))
    lean, slope = (
        np.tan(np.deg2rad(rng.uniform(17, 28) / tall)),
        np.tan(np.deg2rad(rng.uniform(5, 20))),
    )
    knee = np.array([seat * lean, seat + 0.03])
    top = knee + [back * slope, back]
    foot = np.array([0.0, r])
    rung = foot + float(rng.uniform(0.25, 0.5)) * (knee - foot)
    frame = bar_frame([foot, knee, top], half, r, square, [rung])
    low = float(rng.uniform(0.3, 0.7)) * back
    pad = float(rng.uniform(0.012, 0.04))
    kind = rng.choice(["panel", "slats", "sticks"], p=[0.55, 0.25, 0.2])
    spans = (
        [(low, back)] if kind == "panel" else [(b, b + 0.05) for b in np.arange(low, back, 0.09)]
    )
    if kind == "sticks":
        spans = [(low, low + 0.05), (back - 0.05, back)]
    rests = []
    for a, b in spans:
        ends = [knee + [slope * z, z] for z in (a, min(b, back))]
        corners = [
            [p[0] + d, y, p[1]] for p in ends for d in (-pad / 2, pad / 2) for y in (-half, half)
        ]
        rests.append(hull(np.array(corners)))
    if kind == "sticks":
        for y in np.linspace(-0.7, 0.7, int(rng.integers(3, 7))) * half:
            ends = [knee + [slope * z, z] for z in (low + 0.02, back - 0.02)]
            rests.append(bar(ends, y, 0.4 * r, True))
    main = frame_shape((frame, tone), (union(rests), cover if kind == "panel" else tone))
    parts: list[PartSpec] = [("frame", main, -1, None)]
    share = float(rng.uniform(0.75, 0.93))
    bolt = foot + share * (knee - foot)
    heel = np.array([bolt[0] + bolt[1] * float(rng.uniform(0.35, 0.6)), r])
    outer = half + 2 * r + AIR
    reach = float(rng.uniform(0.5, 0.85))
    legs = bar_frame([bolt, heel], outer, r, square, [bolt + reach * (heel - bolt)])
    caps = [
        cylinder("y", [bolt[0], s * outer - 1.5 * r, bolt[1]], 3 * r, 0.8 * r, segments=12)
        for s in (-1, 1)
    ]
    legs_tone = tone if rng.random() < 0.8 else materials.paint(rng)
    most = angle_between(heel - bolt, foot - bolt)
    most -= np.arcsin(min(0.9, 3 * r / (reach * np.linalg.norm(heel - bolt)))) + 0.03
    joint = hinge((bolt[0], 0, bolt[1]), (0, 1, 0), max(most, 0.3))
    inside = [box([-9, -half - r - AIR / 2, -9], [9, half + r + AIR / 2, bolt[1] + 2 * r])]
    caps = [cut(c, inside) for c in caps]
    parts.append(
        ("legs", frame_shape((legs, legs_tone), (union(caps), materials.hardware(rng))), 0, joint)
    )
    thick, deep = float(rng.uniform(0.018, 0.05)), float(rng.uniform(0.34, 0.44))
    behind = float(rng.uniform(0.1, 0.28)) * deep
    axis = np.array([seat * lean, seat])
    inner = half - r - AIR
    slab = panel(rng, axis[0] + behind - deep, axis[0] + behind, inner, seat - thick / 2, thick)
    pin = cylinder("y", [axis[0], -inner, axis[1]], 2 * inner, 0.4 * thick, segments=10)
    up = float(np.deg2rad(rng.uniform(60, 80)))
    shape = frame_shape((slab + pin, cover))
    parts.append(("seat", shape, 0, hinge((axis[0], 0, axis[1]), (0, 1, 0), up)))
    return parts


def _lounger(rng: np.random.Generator) -> list[PartSpec]:
    """A lounger: a back that rises from flat, a knee rest, and wheels under the head."""
    tone, square = draw_frame_finish(rng)
    cover = draw_cover_finish(rng, tone)
    long, half = float(rng.uniform(1.6, 2.0)), float(rng.uniform(0.27, 0.36))
    high, r = float(rng.uniform(0.26, 0.42)), float(rng.uniform(0.014, 0.026))
    rails = bar_frame(
        [[0, high], [long, high]], half, r, square, [[0.02, high], [long - 0.02, high]]
    )
    wheels = rng.random() < 0.4
    feet = [0.12 * long] if wheels else [0.12 * long, 0.88 * long]
    legs = [bar_frame([[x, r], [x, high]], half, r, square, [[x, 0.4 * high]]) for x in feet]
    radius = 0.5 * high if wheels else 0.0
    hub = np.array([0.86 * long, radius])
    if wheels:
        legs.append(bar_frame([[hub[0], radius], [hub[0], high]], half, r, square, [hub]))
    low, thick = high + r + AIR, float(rng.uniform(0.025, 0.07))
    a, b = float(rng.uniform(0.25, 0.35)) * long, float(rng.uniform(0.52, 0.62)) * long
    slats, inner = bool(rng.random() < 0.4), half + r
    knees = rng.random() < 0.6
    seat = panel(rng, (a if knees else 0.0) + AIR, b - AIR, inner, low - AIR, thick, slats)
    frame = union([rails, *legs])
    parts: list[PartSpec] = [("base", frame_shape((frame, tone), (seat, cover)), -1, None)]
    back = panel(rng, b + thick, long, inner, low, thick, slats)
    up = float(np.deg2rad(rng.uniform(50, 80)))
    parts.append(
        ("back", frame_shape((back, cover)), 0, hinge((b + thick, 0, low), (0, -1, 0), up))
    )
    if knees:
        rest = panel(rng, 0.0, a - AIR - thick, inner, low, thick, slats)
        joint = hinge((a - AIR - thick, 0, low), (0, 1, 0), float(np.deg2rad(rng.uniform(25, 60))))
        parts.append(("rest", frame_shape((rest, cover)), 0, joint))
    for s in (-1, 1) if wheels else ():
        y = s * (half + r + AIR) - (0.05 if s < 0 else 0.0)
        wheel = cylinder("y", [hub[0], y, radius], 0.05, radius, segments=22)
        joint = turn((hub[0], 0, radius), (0, 1, 0))
        parts.append(("wheel", frame_shape((wheel, materials.dark(rng))), 0, joint))
    return parts


def _theatre(rng: np.random.Generator) -> list[PartSpec]:
    """Seats in a row between arms, or one on a wall plate. Each is tipped up at rest."""
    wall = rng.random() < 0.3
    count = 1 if wall else int(rng.choice([1, 2, 3, 4], p=[0.3, 0.35, 0.2, 0.15]))
    tone, _ = draw_frame_finish(rng)
    cover = draw_cover_finish(rng, tone)
    wide, side = float(rng.uniform(0.36, 0.5)), float(rng.uniform(0.04, 0.08))
    high, deep, thick = (
        float(rng.uniform(0.38, 0.46)),
        float(rng.uniform(0.34, 0.44)),
        float(rng.uniform(0.04, 0.11)),
    )
    tall, lean = float(rng.uniform(0.8, 1.05)), float(rng.uniform(0.02, 0.12))
    total = count * wide + (count + 1) * side
    solids, backs, seats = [], [], []
    if wall:
        tall = high + float(rng.uniform(0.3, 0.6))
        low = high - 0.12
        solids.append(
            box(
                [0, -total / 2, low],
                [0.03, total / 2, high + (tall - high) * float(rng.uniform(0.2, 1))],
            )
        )
        for y in (-total / 2, total / 2 - side):
            solids.append(box([-0.06, y, low], [0, y + side, high + 0.06]))
    for k in range(count + 1 if not wall else 0):
        y = -total / 2 + k * (wide + side)
        arm = float(rng.uniform(0.16, 0.24)) + high
        solids.append(box([-0.6 * deep, y, 0], [0.12, y + side, 0.03]))
        solids.append(box([-0.12, y, 0], [0.1, y + side, arm - 0.03]))
        solids.append(box([-0.8 * deep, y, arm - 0.05], [0.12, y + side, arm]))
    seat_round = float(rng.choice([0.01, rng.uniform(0.03, 0.12)]))
    pad = thick * float(rng.uniform(0.6, 1.1))
    for k in range(count):
        y = -total / 2 + side + k * (wide + side)
        if not wall:
            corners = [
                [x + d, q, z]
                for x, z in ((0.01, high - 0.1), (0.01 + lean, tall))
                for d in (0, pad)
                for q in (y, y + wide)
            ]
            backs.append(hull(np.array(corners)))
        plan = rounded(wide - 2 * AIR, deep, seat_round)
        at = [-thick, y + wide / 2, high + deep / 2]
        solid = extrusion(plan, "x", at, thick - 0.5 * AIR)
        seats.append(
            (solid, hinge((-thick / 2, 0, high), (0, -1, 0), np.deg2rad(rng.uniform(78, 90))))
        )
    pieces = [(union(solids), tone)] + ([(union(backs), cover)] if backs else [])
    parts: list[PartSpec] = [("stand", frame_shape(*pieces), -1, None)]
    return parts + [("seat", frame_shape((solid, cover)), 0, joint) for solid, joint in seats]

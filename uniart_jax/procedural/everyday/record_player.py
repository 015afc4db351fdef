"""Turntables with a platter, a tone arm and a dust cover; gramophones with a horn. The family's
music boxes and radios are in ``music_players``."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.music_players import (
    ACROSS,
    UP,
    add_crank,
    draw_finish,
    musical_box,
    radio,
)
from uniart_jax.procedural.fronts import add_knob
from uniart_jax.procedural.materials import plain
from uniart_jax.procedural.pieces import layered, merged
from uniart_jax.procedural.shapes import (
    Assembly,
    box,
    cut,
    cylinder,
    extrusion,
    hinge,
    inset,
    pipe,
    revolution,
    rounded,
    slide,
    turn,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A music player in metres, its arm parked; a dust cover or lid may be open at rest."""
    kind = rng.choice(4, p=[0.46, 0.12, 0.14, 0.28])
    obj = (_turntable, _gramophone, musical_box, radio)[kind](rng).object()
    opened = np.zeros(len(obj.parts))
    for k, part in enumerate(obj.parts):
        if part.name in ("dust_cover", "lid") and rng.random() < 0.55:
            opened[k] = part.joint.limits[1]
    return obj.shown_at(opened) if opened.any() else obj


def _turntable(rng: np.random.Generator) -> Assembly:
    """A plinth with a platter, an arm, keys, a pitch slider; a dust cover, or a case's lid."""
    wide = float(rng.uniform(0.3, 0.5))
    depth = wide * float(rng.uniform(0.72, 0.92))
    unit, half = wide / 100, wide / 2
    legs, high = float(rng.uniform(1, 5)) * unit, float(rng.uniform(7, 20)) * unit
    z, tone, trim = legs + high, draw_finish(rng, 0.5), materials.hardware(rng)
    cased = rng.random() < 0.25
    plan = rounded(depth, wide, float(rng.uniform(0.3, 8)) * unit, 5)
    body = extrusion(plan, "z", [depth / 2, 0, legs], high)
    radius = min(0.46 * (depth - 6 * unit), float(rng.uniform(0.31, 0.36)) * wide)
    centre = np.array([depth / 2 - float(rng.uniform(-1, 2)) * unit, half - radius - 5 * unit])
    right = centre[1] - radius  # what is left of the plinth's top on that side
    px, py = depth - 13 * unit, max(-half + 9 * unit, right - 13 * unit)
    reach = min(px - 0.14 * depth, 1.02 * float(np.linalg.norm(centre - [px, py])))
    keys, holes, y = [], [], -half + 5.5 * unit
    press, air = 1.2 * unit, 0.3 * unit
    spots = [0.1 * depth, 0.1 * depth + 9 * unit]
    controls = str(rng.choice(["keys", "knobs", "mixed", "none"], p=[0.3, 0.3, 0.25, 0.15]))
    corner = half - 5 * unit
    if controls in ("keys", "mixed"):
        w = float(rng.uniform(2, 3.2)) * unit
        at = (0.09 * depth, corner - unit)
        key = extrusion(
            rounded(2 * w, 2 * w, float(rng.uniform(0.1, 1)) * w), "z", [*at, 0], 3 * unit
        )
        keys.append(("button", key.translate((0, 0, z - 1.5 * unit)), slide((0, 0, -1), press)))
        holes.append(
            box(
                [at[0] - w - air, at[1] - w - air, z - 4 * unit],
                [at[0] + w + air, at[1] + w + air, z + 1],
            )
        )
    pitch = rng.random() < 0.4 and py - y > 8 * unit
    if pitch:
        long = float(rng.uniform(0.25, 0.4)) * depth
        lo = 0.1 * depth
        slot = box(
            [lo - 0.3 * unit, y - air - unit, z - 3 * unit], [lo + long, y + unit + air, z + 1]
        )
        holes.append(slot)
        grip = box(
            [lo, y - 2.6 * unit, z + 0.8 * unit], [lo + 4 * unit, y + 2.6 * unit, z + 2.4 * unit]
        )
        grip += box([lo, y - unit, z - 2 * unit], [lo + 4 * unit, y + unit, z + unit])
        keys.append(("pitch_slider", grip, slide((1, 0, 0), long - 4.6 * unit)))
    pieces = [(cut(body, holes), tone), (_feet(depth, half, legs, unit), materials.dark(rng))]
    if rng.random() < 0.4:  # a plate on the top
        plate = extrusion(plan * 0.95, "z", [depth / 2, 0, z - 1e-4], 0.4 * unit)
        plate = cut(plate, holes) - cylinder("z", [*centre, 0], 9, radius + 1.5 * unit)
        plate -= cylinder("z", [px, py, 0], 9, 5.5 * unit)
        pieces.append((plate, draw_finish(rng, 0.1)))
    rest = box(
        [px - 0.6 * reach, py - 1.5 * unit, z - 1e-4],
        [px - 0.54 * reach, py + 1.5 * unit, z + 2 * unit],
    )
    pieces.append((rest, trim))
    asm = Assembly()
    root = asm.add("body", layered(pieces))
    over = _platter(rng, asm, root, [*centre, z], radius, unit)
    top = _arm(rng, asm, root, ((px, py), centre, radius, reach), z, over, unit)
    if controls in ("knobs", "mixed"):
        r = float(rng.uniform(2.4, 3.4)) * unit
        count = int(rng.choice([1, 2]))
        front = high > 10 * unit and rng.random() < 0.6
        for k in range(count):
            at = (-0.3 * unit, (-0.8 + 0.24 * k) * half, legs + 0.5 * high)
            if not front:
                if pitch or right < y + r + 2 * unit or py - y < 7 * unit:
                    break
                at = (spots[k], y, z + 0.4 * unit)
            sweep = None if rng.random() < 0.4 else float(np.deg2rad(rng.choice([90, 270])))
            lean = 0.0 if front else np.pi / 2
            add_knob(asm, root, at, r, 1.1 * r, trim, materials.dark(rng), sweep, tilt=lean)
    for name, solid, joint in keys:
        asm.add(name, merged([(solid, trim)]), root, joint)
    if cased or rng.random() < 0.45:
        _cover(rng, asm, root, plan, depth, z, top + unit, tone if cased else None, unit)
    return asm


def _feet(depth: float, half: float, legs: float, unit: float) -> Manifold:
    """Four round feet under a case."""
    spots = [(x, s * 0.82 * half) for x in (0.12 * depth, 0.88 * depth) for s in (-1, 1)]
    return union([cylinder("z", [x, y, 0], legs + unit, 4 * unit, segments=14) for x, y in spots])


def _platter(rng, asm: Assembly, parent: int, at, radius: float, unit: float) -> float:
    """Add a turning disc, mostly with a record on it; returns the height of its top."""
    x, y, z = at
    thick = float(rng.uniform(1.4, 4)) * unit
    low = z + 0.3 * unit
    metal = materials.metal(rng, brushed=False) if rng.random() < 0.6 else materials.dark(rng)
    disc = cylinder("z", [x, y, low], thick, radius, segments=36)
    spindle = cylinder("z", [x, y, low + thick], 2.4 * unit, 0.8 * unit, segments=10)
    pieces = [(disc, metal), (spindle, metal)]
    if rng.random() < 0.75:
        size, hub = radius * float(rng.choice([0.55, 0.94, 1.04])), 0.34 * radius
        tone = materials.dark(rng) if rng.random() < 0.8 else plain(rng.uniform(0.1, 0.95, 3))
        paper = plain(materials.hsv(rng, (0, 1), (0.3, 0.9), (0.5, 0.95)))
        record = cylinder("z", [x, y, low + thick], 0.6 * unit, size, segments=36)
        pieces.append((record, tone))
        mark = np.array([[-0.3, 0.25], [0.5, 0.25], [0.5, 0.45], [-0.3, 0.45]]) * hub * 1.6
        top = low + thick + 0.6 * unit
        pieces.append((extrusion(mark, "z", [x, y, top], 0.35 * unit), tone))
        pieces.append((cylinder("z", [x, y, top], 0.3 * unit, hub, segments=24), paper))
    asm.add("platter", layered(pieces), parent, turn([x, y, 0], UP))
    return low + thick + 0.7 * unit


def _arm(rng, asm: Assembly, parent: int, spots, z: float, over: float, unit: float) -> float:
    """Add a tone arm, parked along the right edge, that turns over the record; returns its highest
    point."""
    (px, py), centre, radius, reach = spots
    tone = materials.metal(rng, brushed=False) if rng.random() < 0.6 else materials.dark(rng)
    high, r = over + float(rng.uniform(2.5, 5)) * unit, 1.2 * unit
    base = float(rng.uniform(3, 4.5)) * unit
    bend = float(rng.choice([0.0, 0.0, 2.5])) * unit
    tip = np.array([px - reach, py])
    line = [[px + 7 * unit, py, high], [px - 0.35 * reach, py, high]]
    line += [[px - 0.7 * reach, py - bend, high], [*tip, high]]
    shell = box([-4.5 * unit, -2 * unit, -1.8 * unit], [2.5 * unit, 2 * unit, 1.2 * unit])
    shell = shell.rotate((0, 0, -float(rng.uniform(0, 22)))).translate((*tip, high))
    weight = cylinder("x", [px + 4.5 * unit, py, high], 5 * unit, 2.6 * unit, segments=18)
    post = cylinder("z", [px, py, z + 0.3 * unit], high - z, base, 0.8 * base, segments=20)
    rod = union([pipe(line, r, 8), shell, post])
    pieces = [(rod, tone), (weight, materials.dark(rng))]
    turns = np.deg2rad(np.arange(5, 70))
    ends = np.column_stack([px - reach * np.cos(turns), py + reach * np.sin(turns)])
    far = np.linalg.norm(ends - centre, axis=1)
    good = turns[far > 0.36 * radius]
    most = (
        turns[int(far.argmin())]
        if far.min() > 0.36 * radius
        else good[good < turns[far.argmin()]].max()
    )
    asm.add("tone_arm", layered(pieces), parent, hinge([px, py, 0], (0, 0, -1), most))
    return high + 2.7 * unit


def _cover(rng, asm: Assembly, root: int, plan, depth: float, z, top, tone, unit: float) -> None:
    """Add a hollow cover hinged at the rear, of clear or smoky plastic or of the case's finish."""
    wall, low = 1.6 * unit, z + 0.6 * unit
    inner = inset(plan, wall)
    shell = extrusion(plan, "z", [depth / 2, 0, low], top + wall - low)
    shell -= extrusion(inner, "z", [depth / 2, 0, low - 1], 1 + top - low)
    pieces = [(shell, materials.glass(rng) if tone is None else tone)]
    if tone is not None or rng.random() < 0.4:
        tab = box([-1.6 * unit, -8 * unit, low], [0.02 * unit, 8 * unit, low + 3 * unit])
        pieces.append((tab - shell, materials.hardware(rng)))
    swing = np.deg2rad(float(rng.uniform(50, 95)))
    asm.add("dust_cover", layered(pieces), root, hinge([depth, 0, low], ACROSS, swing))


def _gramophone(rng: np.random.Generator) -> Assembly:
    """A box with a platter, a crank, and a horn that turns on its bracket."""
    wide = float(rng.uniform(0.3, 0.42))
    depth, high = wide * float(rng.uniform(0.85, 1.1)), wide * float(rng.uniform(0.3, 0.6))
    unit, half = wide / 100, wide / 2
    tone, brass = materials.wood(rng), materials.hardware(rng)
    pieces = [(box([0, -half, 3 * unit], [depth, half, high]), tone)]
    rim = float(rng.uniform(2, 5)) * unit
    for z, h in ((0, 4 * unit), (high - 4 * unit, 4 * unit)):
        pieces.append((box([-rim, -half - rim, z], [depth + rim, half + rim, z + h]), tone))
    pieces = [(union([s for s, _ in pieces]), tone)]
    x = depth + rim + 4 * unit
    bracket = box([depth, -4 * unit, 0.4 * high], [x + 4 * unit, 4 * unit, 0.4 * high + 4 * unit])
    tall = high + 12 * unit
    bracket += cylinder("z", [x, 0, 0.4 * high], tall - 0.4 * high, 4 * unit)
    boss = cylinder("y", [0.5 * depth, -half - rim, 0.6 * high], rim + unit, 3 * unit)
    pieces.append((union([bracket, boss]), brass))
    asm = Assembly()
    root = asm.add("body", layered(pieces))
    radius = 0.36 * min(wide, depth)
    _platter(rng, asm, root, [0.45 * depth, 0, high], radius, unit)
    add_crank(rng, asm, root, [0.5 * depth, -half - rim, 0.6 * high], -1, 9 * unit, brass)
    mouth, long = float(rng.uniform(22, 45)) * unit, float(rng.uniform(55, 95)) * unit
    s = np.linspace(0, 1, 9)
    flare = 3.2 * unit + (mouth - 3.2 * unit) * s ** float(rng.uniform(1.6, 3.5))
    wall = 1.5 * unit
    outer = np.column_stack([flare, long * s])
    inner = np.column_stack([np.maximum(flare - wall, 1.2 * unit), long * s + 0.3 * wall * (s < 1)])
    profile = np.vstack([[[0, 0]], outer, inner[1:][::-1], [[0, long * s[1]]]])
    sides = int(rng.choice([8, 12, 30]))
    lean = float(rng.uniform(25, 55))
    horn = revolution(profile, "z", [0, 0, 0], sides).rotate((0, -lean, 0))
    neck = [x, 0, tall + 14 * unit]
    stem = cylinder("z", [x, 0, tall + 0.3 * unit], 4 * unit, 4.4 * unit)
    stem += pipe([[x, 0, tall + 3 * unit], neck], 2.6 * unit, 12)
    cover = draw_finish(rng, 0.1) if rng.random() < 0.5 else brass
    shape = layered([(horn.translate(neck), cover), (stem, brass)])
    way = float(rng.choice([-1, 1]))
    joint = turn([x, 0, 0], UP) if rng.random() < 0.5 else hinge([x, 0, 0], (0, 0, way), np.pi / 2)
    asm.add("horn", shape, root, joint)
    return asm

"""Players of sound: turntables with a platter, a tone arm and a dust cover; gramophones and musical
boxes with a crank; cassette radios with flaps, keys, knobs and a handle; tape reels."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.fronts import add_knob
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    ball,
    box,
    cut,
    cylinder,
    extrusion,
    hinge,
    merged,
    pipe,
    revolution,
    rounded,
    slide,
    tidy,
    turn,
    union,
)

UP, ACROSS = (0, 0, 1), (0, 1, 0)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A player, metres; its arm parked; a dust cover closed, or open as its owner left it."""
    kind = rng.choice(4, p=[0.46, 0.12, 0.14, 0.28])
    obj = (_turntable, _gramophone, _musical_box, _radio)[kind](rng).object()
    opened = np.zeros(len(obj.parts))
    for k, part in enumerate(obj.parts):
        if part.name in ("dust_cover", "lid") and rng.random() < 0.55:
            opened[k] = part.joint.limits[1]
    return obj.shown_at(opened) if opened.any() else obj


def _finish(rng: np.random.Generator, wooden: float) -> Material:
    """Wood, or plastic of any colour, steel, black, white."""
    if rng.random() < wooden:
        return materials.wood(rng)
    kind = rng.choice(4, p=[0.2, 0.2, 0.25, 0.35])
    if kind == 3:
        return plain(materials.hsv(rng, (0, 1), (0.3, 0.9), (0.3, 0.95)))
    return (materials.metal, materials.white_plastic, materials.dark)[kind](rng)


def _layered(pieces: list[tuple[Manifold, Material]]) -> Shape:
    """Solids of which a later one gives way to the earlier ones."""
    out, before = [], None
    for solid, material in pieces:
        out.append((solid if before is None else solid - before, material))
        before = solid if before is None else before + solid
    return merged(out)


def _feet(depth: float, half: float, legs: float, unit: float) -> Manifold:
    spots = [(x, s * 0.82 * half) for x in (0.12 * depth, 0.88 * depth) for s in (-1, 1)]
    return union([cylinder("z", [x, y, 0], legs + unit, 4 * unit, segments=14) for x, y in spots])


def _platter(rng, asm: Assembly, parent: int, at, radius: float, unit: float) -> float:
    """A turning disc, mostly with a record on it; returns how high it reaches."""
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
    asm.add("platter", _layered(pieces), parent, turn([x, y, 0], UP))
    return low + thick + 0.7 * unit


def _arm(rng, asm: Assembly, parent: int, spots, z: float, over: float, unit: float) -> float:
    """A tone arm parked along the right edge, that turns over the record; its highest point."""
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
    asm.add("tone_arm", _layered(pieces), parent, hinge([px, py, 0], (0, 0, -1), most))
    return high + 2.7 * unit


def _turntable(rng: np.random.Generator) -> Assembly:
    """A plinth with a platter, an arm, keys, a pitch slider; a dust cover, or a case's lid."""
    wide = float(rng.uniform(0.3, 0.5))
    depth = wide * float(rng.uniform(0.72, 0.92))
    unit, half = wide / 100, wide / 2
    legs, high = float(rng.uniform(1, 5)) * unit, float(rng.uniform(7, 20)) * unit
    z, tone, trim = legs + high, _finish(rng, 0.5), materials.hardware(rng)
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
        pieces.append((plate, _finish(rng, 0.1)))
    rest = box(
        [px - 0.6 * reach, py - 1.5 * unit, z - 1e-4],
        [px - 0.54 * reach, py + 1.5 * unit, z + 2 * unit],
    )
    pieces.append((rest, trim))
    asm = Assembly()
    root = asm.add("body", _layered(pieces))
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


def _cover(rng, asm: Assembly, root: int, plan, depth: float, z, top, tone, unit: float) -> None:
    """A hollow cover hinged behind: of clear or smoky plastic, or as the case."""
    wall, low = 1.6 * unit, z + 0.6 * unit
    size = np.abs(plan).max(0)
    inner = plan * (1 - wall / size)
    shell = extrusion(plan, "z", [depth / 2, 0, low], top + wall - low)
    shell -= extrusion(inner, "z", [depth / 2, 0, low - 1], 1 + top - low)
    pieces = [(shell, materials.glass(rng) if tone is None else tone)]
    if tone is not None or rng.random() < 0.4:
        tab = box([-1.6 * unit, -8 * unit, low], [0.02 * unit, 8 * unit, low + 3 * unit])
        pieces.append((tab - shell, materials.hardware(rng)))
    swing = np.deg2rad(float(rng.uniform(50, 95)))
    asm.add("dust_cover", _layered(pieces), root, hinge([depth, 0, low], ACROSS, swing))


def _crank(rng, asm: Assembly, parent: int, at, side: float, size: float, trim: Material) -> None:
    """A crank in a side wall (y = ``at[1]``): a shaft, an arm, a grip that points outwards."""
    x, y, z = at
    r, out = 0.17 * size, 0.65 * size
    angle = float(rng.uniform(0, 2 * np.pi))
    tip = [x + size * np.cos(angle), y + side * out, z + size * np.sin(angle)]
    line = [[x, y + side * (r + 0.05 * size), z], [x, y + side * out, z], tip]
    grip = [tip, [tip[0], tip[1] + side * 0.6 * size, tip[2]]]
    arm = pipe(line, r, 8)
    knob = pipe(grip, 1.6 * r, 8) if rng.random() < 0.6 else ball(grip[1], 2.2 * r)
    rod = union([arm, pipe(grip, r, 8)])
    tone = materials.wood(rng, textured=False) if rng.random() < 0.5 else materials.dark(rng)
    pieces = _layered([(knob, tone), (rod, trim)])
    asm.add("crank", pieces, parent, turn([x, 0, z], ACROSS))


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
    root = asm.add("body", _layered(pieces))
    radius = 0.36 * min(wide, depth)
    _platter(rng, asm, root, [0.45 * depth, 0, high], radius, unit)
    _crank(rng, asm, root, [0.5 * depth, -half - rim, 0.6 * high], -1, 9 * unit, brass)
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
    cover = _finish(rng, 0.1) if rng.random() < 0.5 else brass
    shape = _layered([(horn.translate(neck), cover), (stem, brass)])
    way = float(rng.choice([-1, 1]))
    joint = turn([x, 0, 0], UP) if rng.random() < 0.5 else hinge([x, 0, 0], (0, 0, way), np.pi / 2)
    asm.add("horn", shape, root, joint)
    return asm


def _musical_box(rng: np.random.Generator) -> Assembly:
    """A box with a crank: a drum or a dancer turns under its lid, or on its open top."""
    wide = float(rng.uniform(0.08, 0.24))
    depth = wide * float(rng.uniform(0.6, 1.05))
    unit, half = wide / 100, wide / 2
    high, wall = float(rng.uniform(28, 60)) * unit, 4 * unit
    tone, trim = _finish(rng, 0.65), materials.hardware(rng)
    plan = rounded(depth, wide, float(rng.uniform(0.3, 14)) * unit, 5)
    inner = plan * (1 - wall / np.abs(plan).max(0))
    deep = float(rng.uniform(12, 20)) * unit
    body = extrusion(plan, "z", [depth / 2, 0, 0], high)
    body -= extrusion(inner, "z", [depth / 2, 0, high - deep], 9)
    drum = rng.random() < 0.5
    floor, mid = high - deep, depth / 2
    r = 0.42 * deep
    pieces = [(body, tone)]
    if drum:
        for s in (-1, 1):
            y = s * 0.62 * half
            cheek = box(
                [mid - r, y - 1.5 * unit, floor - 1e-4], [mid + r, y + 1.5 * unit, floor + 1.7 * r]
            )
            pieces.append((cheek - cylinder("y", [mid, -1, floor + 1.2 * r], 2, 0.4 * r), trim))
    else:
        pieces[0] = (body + extrusion(inner, "z", [mid, 0, floor - unit], deep - unit), tone)
    asm = Assembly()
    root = asm.add("body", _layered(pieces))
    if drum:
        z, w = floor + 1.2 * r, 0.62 * half - 2.2 * unit
        barrel = cylinder("y", [mid, -w, z], 2 * w, r - 0.5 * unit, segments=22)
        pins = [
            ball([mid, y, z + r - 0.5 * unit], 0.9 * unit, 6)
            .translate((-mid, 0, -z))
            .rotate((0, a, 0))
            .translate((mid, 0, z))
            for y in np.linspace(-0.85, 0.85, 5) * w
            for a in rng.uniform(0, 360, 2)
        ]
        axle = cylinder("y", [mid, -0.62 * half - unit, z], 1.24 * half + 2 * unit, 0.33 * r)
        shape = Shape().add(tidy(union([barrel, axle, *pins])), materials.hardware(rng))
        asm.add("drum", shape, root, turn([mid, 0, z], ACROSS))
        top = floor + 2.3 * r
    else:
        top = high + float(rng.uniform(18, 40)) * unit
        _dancer(rng, asm, root, mid, high - 2 * unit, top, min(0.36 * depth, 0.36 * wide), unit)
    side = float(rng.choice([-1, 1]))
    size = float(rng.uniform(10, 16)) * unit
    if not drum or rng.random() < 0.7:
        _crank(rng, asm, root, [mid, side * half, 0.45 * high], side, size, trim)
    if drum or rng.random() < 0.5:
        low = high + 0.8 * unit
        tall = max(float(rng.uniform(5, 12)) * unit, top + 2 * unit - low + wall)
        lid = extrusion(plan, "z", [mid, 0, low], tall)
        lid -= extrusion(inner, "z", [mid, 0, low - 1], 1 + tall - wall)
        emblem = extrusion(0.6 * plan, "z", [mid, 0, low + tall - 1e-4], 0.8 * unit)
        shape = _layered([(lid, tone), (emblem, _finish(rng, 0.2))])
        swing = np.deg2rad(float(rng.uniform(70, 110)))
        asm.add("lid", shape, root, hinge([depth, 0, low], ACROSS, swing))
    return asm


def _dancer(rng, asm: Assembly, root: int, mid, low, top, radius: float, unit: float) -> None:
    """A figure off the middle of a disc that turns."""
    disc = cylinder("z", [mid, 0, low + 0.3 * unit], 1.6 * unit, radius, segments=28)
    tall, off = top - low - 1.9 * unit, 0.3 * radius
    z = low + 1.8 * unit
    kind = rng.choice(3)
    if kind == 0:  # a skirt, a body, a head
        figure = cylinder("z", [mid, off, z], 0.5 * tall, 0.45 * radius, 0.15 * radius)
        figure += cylinder(
            "z", [mid, off, z + 0.5 * tall - 1e-4], 0.3 * tall, 0.14 * radius, segments=12
        )
        figure += ball([mid, off, z + 0.87 * tall], 0.13 * tall)
        arms = [[mid, off - 0.6 * radius, z + 0.85 * tall], [mid, off, z + 0.7 * tall]]
        figure += pipe([*arms, [mid, off + 0.6 * radius, z + 0.85 * tall]], 0.06 * tall, 8)
    elif kind == 1:  # trees and houses
        figure = cylinder("z", [mid, off, z], tall, 0.4 * radius, 0.02 * radius, 12)
        figure += cylinder("z", [mid, -1.6 * off, z], 0.6 * tall, 0.3 * radius, 0.02 * radius, 8)
    else:  # a horse on a pole, much simplified
        figure = cylinder("z", [mid, off, z], 0.95 * tall, 0.08 * radius, segments=10)
        figure += box(
            [mid - 0.5 * radius, off - 0.15 * radius, z + 0.3 * tall],
            [mid + 0.5 * radius, off + 0.15 * radius, z + 0.6 * tall],
        )
    pieces = [(disc, _finish(rng, 0.2)), (figure, _finish(rng, 0.2))]
    asm.add("dancer", _layered(pieces), root, turn([mid, 0, 0], UP))


def _radio(rng: np.random.Generator) -> Assembly:
    """A cassette radio or tape machine: speakers, a flap or reels in front, keys on top, knobs, a
    handle, an aerial."""
    wide = float(rng.uniform(0.2, 0.6))
    high = wide * float(rng.uniform(0.42, 0.75))
    depth = wide * float(rng.uniform(0.16, 0.36))
    unit, half, air = wide / 100, wide / 2, 0.35 * wide / 100
    tone, dark, trim = _finish(rng, 0.15), materials.dark(rng), materials.hardware(rng)
    legs = 1.5 * unit
    outline = rounded(wide, high, float(rng.uniform(0.3, 8)) * unit, 5)
    body = extrusion(outline, "x", [0, 0, legs + high / 2], depth)
    feet = box([0.15 * depth, -0.8 * half, 0], [0.85 * depth, 0.8 * half, legs + unit]) - body
    asm, parts, extra = Assembly(), [], []
    low, top = legs + 3 * unit, legs + high
    band = top - float(rng.uniform(0.24, 0.34)) * high  # above it: the scale and knobs
    single = rng.random() < 0.35
    r = min(0.4 * (band - low), 17 * unit)
    speakers = [-half + r + 4 * unit] if single else [-half + r + 4 * unit, half - r - 4 * unit]
    for y in speakers:
        spot = [-0.8 * unit, y, (low + band) / 2]
        ring = cylinder("x", spot, 0.8 * unit, r, segments=28)
        cone = cylinder("x", [spot[0] - 0.4 * unit, *spot[1:]], 0.4 * unit, 0.8 * r, segments=24)
        extra += [(ring, trim if rng.random() < 0.5 else dark), (cone, dark)]
    a = speakers[0] + r + 3 * unit
    b = half - 4 * unit if single else speakers[1] - r - 3 * unit
    reels = rng.random() < 0.2 and b - a > 30 * unit
    count = 2 if b - a > 46 * unit and rng.random() < 0.5 else 1
    room = (b - a) / count
    for k in range(count if not reels else 0):
        lo = np.array([0.0, a + k * room + unit, low])
        hi = np.array([3.2 * unit, a + (k + 1) * room - unit, band - 2 * unit])
        hi[1] = min(hi[1], lo[1] + 40 * unit)
        thick = hi[0]
        body -= box([-1, *(lo[1:] - air)], [thick + 3 * unit, *(hi[1:] + air)])
        flap = box(lo + [-0.3 * unit, 0, 0], hi)
        p, q = lo[1:] + 0.18 * (hi - lo)[1:], hi[1:] - 0.25 * (hi - lo)[1:]
        pane = box([-0.8 * unit, *p], [-0.3 * unit, *q])
        shape = _layered(
            [(flap, tone if rng.random() < 0.4 else dark), (pane, materials.glass(rng))]
        )
        joint = hinge([0, 0, lo[2]], (0, -1, 0), np.deg2rad(float(rng.uniform(25, 60))))
        parts.append(("flap", shape, joint))
    for y in (0.5 * (a + b) - 0.24 * (b - a), 0.5 * (a + b) + 0.24 * (b - a)) if reels else ():
        size = min(0.22 * (b - a), 0.46 * (band - low))
        z = (low + band) / 2
        disc = cylinder("x", [-2.4 * unit, y, z], 2.1 * unit, size, segments=28)
        cuts = [
            cylinder("x", [-1, 0, 0.6 * size], 2, 0.24 * size, segments=14).rotate((120 * k, 0, 0))
            for k in range(3)
        ]
        disc -= union(cuts).translate((0, y, z))
        parts.append(("reel", Shape().add(disc, trim), turn([0, y, z], (1, 0, 0))))
    keys = int(rng.choice([0, 3, 4, 5], p=[0.35, 0.25, 0.2, 0.2]))
    first, pitch = float(rng.uniform(-0.55, 0.05)) * half, 7 * unit
    for k in range(keys):
        y, w, x = first + k * pitch, 2.7 * unit, 0.3 * depth
        d = 0.2 * depth + unit
        if y + w > half - 9 * unit:
            break
        body -= box([x - d - air, y - w - air, top - 3.4 * unit], [x + d + air, y + w + air, 9])
        key = box([x - d, y - w, top - 1.2 * unit], [x + d, y + w, top + 1.6 * unit])
        press = slide((0, 0, -1), 1.5 * unit)
        parts.append(("button", merged([(key, trim if k else _finish(rng, 0))]), press))
    scale = box([-0.5 * unit, -0.3 * half, band + 3 * unit], [0, 0.9 * half, top - 3 * unit])
    handle = rng.random() < 0.55
    aerial = not handle and rng.random() < 0.7
    if aerial:  # a block behind on the top, to which the rod is hinged
        y = -half + 12 * unit
        block = box(
            [0.8 * depth - 2 * unit, y - 3 * unit, top - unit],
            [0.8 * depth + 2 * unit, y, top + 4 * unit],
        )
        extra.append((block, trim))
    root_pieces = [(tidy(body), tone), (feet, dark), *extra, (scale, _finish(rng, 0))]
    root = asm.add("body", _layered(root_pieces))
    for name, shape, joint in parts:
        asm.add(name, shape, root, joint)
    size = min(0.36 * (top - band), 5 * unit)
    for k in range(int(rng.integers(1, 4))):
        y = -0.36 * half - (1.2 + 2.5 * k) * size
        if y - size < -half + unit:
            break
        sweep = None if rng.random() < 0.5 else float(np.deg2rad(270))
        at = (-0.3 * unit, y, (top + band) / 2)
        add_knob(asm, root, at, size, size, trim, materials.dark(rng), sweep)
    if handle:  # beside the case, folded back or upright
        y, thick, z = half + 1.8 * unit, 1.5 * unit, top - 0.28 * high
        rise = top + float(rng.uniform(7, 13)) * unit
        x = 0.62 * depth
        bar = pipe([[x, -y, z], [x, -y, rise], [x, y, rise], [x, y, z]], thick, 8)
        joint = hinge([x, 0, z], ACROSS, np.deg2rad(float(rng.uniform(60, 100))))
        asm.add("handle", Shape().add(tidy(bar), dark if rng.random() < 0.5 else trim), root, joint)
    if aerial:
        start = np.array([0.8 * depth, -half + 12 * unit + 1.7 * unit, top + 2.4 * unit])
        end = start + [0, 0, float(rng.uniform(0.15, 0.6)) * wide]
        rod = pipe([start, end], 1.5 * unit, 8)
        joint = hinge(start, (-1, 0, 0), np.pi / 2)
        asm.add("aerial", Shape().add(rod, trim), root, joint)
    return asm

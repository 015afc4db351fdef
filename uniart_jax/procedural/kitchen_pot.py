"""Pots and pans: saucepans, casseroles, roasters, steamers, camp pots, pressure cookers and slow
cookers, with lids that lift, turn or are hinged, and handles that fold."""

from __future__ import annotations

import dataclasses

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials, vessels
from uniart_jax.procedural.fronts import add_knob
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    ball,
    box,
    cylinder,
    extrusion,
    hinge,
    rounded,
    slide,
    tidy,
    turn,
    union,
)
from uniart_jax.procedural.vessels import bezier, radius_at, silhouette, stack, taper


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A pot, metres, its lid on; its long handle, where it has one, towards any side."""
    kind = rng.choice(3, p=[0.66, 0.18, 0.16])
    if kind == 2:
        return _slow_cooker(rng)
    obj = _pot(rng) if kind == 0 else _pressure_cooker(rng)
    yaw = float(rng.choice([0.0, 90.0, -90.0, 180.0, rng.uniform(-180, 180)]))
    return vessels.turned(obj, yaw)


def _finish(rng: np.random.Generator) -> Material:
    """Steel, enamel, cast iron, copper, aluminium, earthenware."""
    kind = rng.choice(5, p=[0.36, 0.3, 0.18, 0.09, 0.07])
    if kind == 1:
        return plain(materials.hsv(rng, (0, 1), (0.3, 0.95), (0.35, 0.95)))
    if kind == 3:
        return plain(materials.hsv(rng, (0.02, 0.12), (0.45, 0.7), (0.5, 0.8)))
    if kind == 4:
        return materials.white_plastic(rng)
    return materials.metal(rng) if kind == 0 else materials.dark(rng)


def _trim(rng: np.random.Generator, face: Material) -> Material:
    """Of handles and knobs: dark, steel, wood, the pot's own or any colour."""
    kind = rng.choice(5, p=[0.34, 0.24, 0.14, 0.18, 0.1])
    if kind == 2:
        return materials.wood(rng, textured=False)
    if kind == 3:
        return dataclasses.replace(face)
    if kind == 4:
        return plain(materials.hsv(rng, (0, 1), (0.4, 0.9), (0.4, 0.9)))
    return materials.dark(rng) if kind == 0 else materials.hardware(rng)


def _pot(rng: np.random.Generator) -> ArticulatedObject:
    """A pot of the stove: from a flat pan to a tall one, one long handle, two short or a bail."""
    radius = float(rng.uniform(0.08, 0.17))
    plan = str(rng.choice(["round", "oval", "oblong", "flats"], p=[0.7, 0.13, 0.12, 0.05]))
    outline = vessels.ring(36)
    if plan == "oval":
        outline = vessels.ring(36, float(rng.uniform(1.2, 1.6)))
    elif plan == "oblong":
        outline = vessels.ring(36, float(rng.uniform(1.0, 1.6)), float(rng.uniform(4, 7)))
    elif plan == "flats":
        outline = vessels.ring(int(rng.choice([8, 10, 12])))
    across = float(np.abs(outline[:, 1]).max()) * radius
    height = radius * float(rng.choice([rng.uniform(0.3, 0.6), rng.uniform(0.6, 1.2),
                                        rng.uniform(1.2, 2.2)], p=[0.25, 0.5, 0.25]))  # fmt: skip
    unit = max(2 * across, 2 * radius, height) / 100
    air, wall = 0.5 * unit, 2.0 * unit
    face = _finish(rng)
    trim = _trim(rng, face)
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
        _long_handle(rng, body, solid, reach, z, radius, unit, trim)
    elif manner == "folding long":
        moving.append(_folding_long(rng, body, solid, profile, z, radius, unit, trim))
    elif manner == "pair":
        _pair(rng, body, solid, across * reach / radius, z, unit, trim)
    elif manner == "folding pair":
        moving += _folding_pair(rng, body, solid, profile, across / radius, z, unit, trim)
    pivot = _pins(body, solid, across, profile, unit, trim) if manner == "bail" else None
    root = asm.add("body", body)
    low, below, parent = height + air, None, root
    if plan != "flats" and rng.random() < 0.16 and height > 0.5 * radius:  # a steamer's basket
        parent, low = _basket(rng, asm, root, profile, outline, unit, wall, air, face, trim)
        below = parent
    lidded = rng.random() < 0.92 or not moving
    crown = low
    if lidded:
        way = "lift"
        if manner in ("pair", "folding pair", "long") and below is None and rng.random() < 0.22:
            way = "hinge"
        elif plan == "round" and rng.random() < 0.1:
            way = "turn"
        steep = way == "hinge" and manner == "long"
        crown = _lid(rng, asm, parent, outline, radius, wall, low, unit, way, steep, face, trim)
    if pivot is not None:
        _bail(rng, asm, root, pivot, radius, crown, unit, trim)
    for name, shape, joint in moving:
        asm.add(name, shape, root, joint)
    return asm.object()


def _lid(rng, asm, parent, outline, radius, wall, low, unit, way, steep, face, trim) -> float:
    """A lid, flat, vaulted, of steel, enamel or glass, its knob fixed or turning; its top."""
    glass = rng.random() < 0.25
    tone = materials.glass(rng) if glass else face
    if not glass and rng.random() < 0.2:
        tone = _finish(rng)
    rise = radius * float(rng.uniform(0.06, 0.35))
    wide = radius * float(rng.uniform(0.97, 1.05))
    rim = min(float(rng.uniform(1.5, 4)) * unit, 0.5 * rise)
    cover = vessels.dome(outline, wide, low, rise, rim)
    inner = 0.95 * (radius - wall)
    cover += stack(np.array([[0.97 * inner, low - 2 * unit], [inner, low + 0.5 * rim]]), outline)
    shape = Shape()
    if glass:  # a ring of steel round it
        hoop = stack(np.array([[wide + 1e-3, low], [wide + 1e-3, low + rim]]), outline)
        shape.add(hoop - stack(np.array([[0.93 * wide, low - 1], [0.93 * wide, 1]]), outline),
                  materials.metal(rng, brushed=False))  # fmt: skip
        cover -= hoop - stack(np.array([[0.93 * wide, low - 1], [0.93 * wide, 1]]), outline)
    cover = tidy(cover)
    shape.add(cover, tone)
    at = [0, 0, low + 0.97 * rise]
    size = radius * float(rng.uniform(0.09, 0.16))
    grip = dataclasses.replace(trim)
    kind = str(rng.choice(["knob", "turning knob", "loop"], p=[0.4, 0.3, 0.3]))
    if kind == "turning knob":
        at[2] = low + rise + 0.3 * unit
        knob = vessels.knob(rng, at, size, turning=True)
    elif kind == "knob":
        knob = vessels.knob(rng, at, size) - cover
    else:
        long, tall = float(rng.uniform(0.2, 0.42)) * radius, float(rng.uniform(0.2, 0.3)) * radius
        foot = low + 0.6 * rise
        line = vessels.bow(long, low + rise + tall - foot, float(rng.uniform(0.35, 0.8)))
        across = line[:, [1, 0, 2]] if rng.random() < 0.6 else line
        knob = taper(across + [0, 0, foot], 0.4 * size, 0.4 * size) - cover
    crown = float(knob.bounding_box()[5])
    if kind != "turning knob":
        shape.add(tidy(knob), grip)
    if way == "hinge":
        x = radius + 2.4 * unit
        barrel = cylinder("y", [x, -8 * unit, low], 16 * unit, 1.7 * unit, segments=12)
        strap = box([0.9 * radius, -8 * unit, low], [x, 8 * unit, low + 1.2 * unit])
        shape.add(tidy((barrel + strap) - shape.solid()), dataclasses.replace(trim))
        swing = float(rng.uniform(0.8, 1.2) if steep else rng.uniform(1.0, 1.75))
        lid = asm.add("lid", shape, parent, hinge((x, 0, low), (0, 1, 0), swing))
    elif way == "turn":
        lid = asm.add("lid", shape, parent, turn((0, 0, low), (0, 0, 1)))
    else:
        travel = float(rng.uniform(0.35, 1.0)) * radius
        lid = asm.add("lid", shape, parent, slide((0, 0, 1), travel))
    if kind == "turning knob":
        asm.add("knob", Shape().add(knob, grip), lid, turn(at, (0, 0, 1)))
    return crown


def _long_handle(rng, body, solid, reach, z, radius, unit, trim) -> None:
    """One long handle behind, round or flat, that rises a little; some with a helper in front."""
    long, up = float(rng.uniform(0.9, 1.9)) * radius, float(rng.uniform(-0.05, 0.25)) * radius
    thick = float(rng.uniform(0.07, 0.12)) * radius + 0.5 * unit
    start = reach - 3 * unit
    line = bezier([[start, 0, z], [start + 0.3 * long, 0, z + 0.2 * up], [start + long, 0, z + up]])
    first = thick * float(rng.uniform(0.5, 1.0))
    bar = taper(line[::2], first, thick, float(rng.uniform(0.9, 2.0)))
    bar -= cylinder("z", [line[-1][0] - 0.5 * thick, 0, z - radius], 3 * radius, 0.5 * thick)
    body.add(tidy(bar - solid), trim)
    if rng.random() < 0.3:
        loop = vessels.bow(0.35 * radius, 0.3 * radius, 0.6)[::2]
        line = np.column_stack([-start - loop[:, 2], loop[:, 0], 0 * loop[:, 0] + z])
        body.add(tidy(taper(line, 0.6 * thick, 0.6 * thick) - solid), trim)


def _pair(rng, body, solid, reach, z, unit, trim) -> None:
    """Two short handles at the sides: loops or solid ears."""
    wide, long = float(rng.uniform(0.25, 0.45)) * reach, float(rng.uniform(0.2, 0.4)) * reach
    r = float(rng.uniform(1.5, 3)) * unit
    if rng.random() < 0.7:
        loop = vessels.bow(wide, long, float(rng.uniform(0.4, 1.0)))[::2]
        up = float(rng.uniform(-0.2, 0.4))
        start = 0.94 * reach - 2 * unit
        line = np.column_stack([loop[:, 0], start + loop[:, 2], z + up * loop[:, 2]])
        ear = taper(line, r, r)
    else:
        slab = rounded(2 * wide, 2.4 * long, 0.7 * long)
        ear = extrusion(slab, "z", [0, 0.9 * reach, z - 0.7 * r], 1.6 * r)
    for piece in (ear, ear.mirror((0, 1, 0))):
        body.add(tidy(piece - solid), trim)


def _folding_pair(rng, body, solid, profile, widen, z, unit, trim) -> list[tuple]:
    """Two loops of wire at the sides that hang down and are raised outwards."""
    r = float(rng.uniform(1.4, 2.2)) * unit
    wide = float(rng.uniform(0.3, 0.5)) * radius_at(profile, z)
    drop = min(0.75 * z, float(rng.uniform(0.35, 0.6)) * wide * 2)
    widest = max(radius_at(profile, h) for h in np.linspace(z - drop, z + r, 9)) * widen
    y = widest + r + 0.8 * unit
    loop = vessels.bow(wide, -drop, 0.5)[::2]
    line = np.column_stack([loop[:, 0], 0 * loop[:, 0] + y, z + loop[:, 2]])
    line = np.vstack([line, line[:1]])
    found = []
    angle = float(rng.uniform(1.2, 1.9))
    for side in (1, -1):
        wire = Shape().add(tidy(taper(line * [1, side, 1], r, r)), dataclasses.replace(trim))
        lugs = []
        for x in (-wide - 1.4 * r - 1.5 * unit, wide + 1.4 * r):
            lo, hi = sorted((side * 0.3 * y, side * (y + r)))
            lugs.append(box([x, lo, z - 1.3 * r], [x + 1.5 * unit, hi, z + 1.3 * r]))
        body.add(tidy(union(lugs) - solid), trim)
        found.append(("handle", wire, hinge((0, side * y, z), (side, 0, 0), angle)))
    return found


def _folding_long(rng, body, solid, profile, z, radius, unit, trim) -> tuple:
    """A long handle behind that folds up on its hinge."""
    r = float(rng.uniform(1.8, 2.6)) * unit
    x = max(radius_at(profile, h) for h in (z - 1.6 * r, z, z + 1.6 * r)) + 1.7 * r + unit
    half, air = 1.5 * r, 0.6 * unit
    long = float(rng.uniform(1.0, 1.7)) * radius
    bar = box([x, -half, z - 0.6 * r], [x + long, half, z + 0.6 * r])
    if rng.random() < 0.5:
        bar -= box([x + 0.35 * long, -0.5 * half, z - r], [x + 0.9 * long, 0.5 * half, z + r])
    else:
        bar += taper(np.array([[x + 0.4 * long, 0, z], [x + long, 0, z]]), r, 1.2 * r, 1.6)
    bar += cylinder("y", [x, -half, z], 2 * half, r, segments=16)
    lugs = [box([0.3 * x, y, z - 1.4 * r], [x + r, y + 1.4 * unit, z + 1.4 * r])
            for y in (half + air, -half - air - 1.4 * unit)]  # fmt: skip
    body.add(tidy(union(lugs) - solid), trim)
    shape = Shape().add(tidy(bar), dataclasses.replace(trim))
    return "handle", shape, hinge((x, 0, z), (0, -1, 0), float(rng.uniform(1.0, 1.5)))


def _pins(body: Shape, solid, across, profile, unit, trim) -> np.ndarray:
    """Pins at both sides for a bail; where its right end turns."""
    r = 1.6 * unit
    z = 0.84 * profile[-1, 1]
    widen = across / profile[-1, 0]
    y = max(radius_at(profile, h) for h in np.linspace(z - r, profile[-1, 1], 7)) * widen + 2 * unit
    for side in (-1, 1):
        pin = cylinder("y", [0, min(side * y, 0), z], y, 1.3 * r, segments=14)
        body.add(tidy(pin - solid), trim)
    return np.array([0, y + 0.5 * unit + r, z])


def _bail(rng, asm, root, pivot, radius, crown, unit, trim) -> None:
    """A bow from side to side that lies behind and is raised over the lid."""
    _, y, z = pivot
    r = 1.6 * unit
    peak = max(crown - z + 5 * unit + r, 1.3 * max(radius, y))
    line = vessels.bow(y, peak, float(rng.uniform(0.5, 0.8)))[:, [1, 0, 2]]
    bar = taper(line, r, r) + taper(line[5:10], 1.7 * r, 1.7 * r)
    fold = float(rng.uniform(0.8, 1.35))
    bar = tidy(bar).rotate((0, np.rad2deg(fold), 0)).translate((0, 0, z))
    shape = Shape().add(bar, dataclasses.replace(trim))
    asm.add("handle", shape, root, hinge((0, 0, z), (0, 1, 0), -fold))


def _basket(rng, asm, root, profile, outline, unit, wall, air, face, trim) -> tuple[int, float]:
    """A second pot that stands in the first one's rim and lifts out; its index and what its lid
    lies on."""
    high, radius = profile[-1, 1], profile[-1, 0]
    tall = radius * float(rng.uniform(0.35, 0.8))
    low = high + air
    wider = silhouette(0.97 * radius, radius, radius, 0.3, low, low + tall)
    solid = stack(wider, outline)
    inner = 0.94 * (radius - wall)
    plug = stack(np.array([[0.97 * inner, low - 4 * unit], [inner, low + unit]]), outline)
    shape = Shape()
    shape.add(tidy((solid + plug) - vessels.room(wider, outline, wall)), face)
    if rng.random() < 0.7:
        reach = radius * float(np.abs(outline[:, 1]).max())
        _pair(rng, shape, solid, reach, low + 0.6 * tall, unit, dataclasses.replace(trim))
    way = slide((0, 0, 1), float(rng.uniform(0.5, 1.0)) * tall + 4 * unit)
    return asm.add("basket", shape, root, way), low + tall + air


def _pressure_cooker(rng: np.random.Generator) -> ArticulatedObject:
    """A deep pot whose lid turns to lock; handles one above the other, a valve."""
    radius = float(rng.uniform(0.1, 0.14))
    height = radius * float(rng.uniform(0.8, 1.9))
    unit = max(2.6 * radius, height) / 100
    air, wall = 0.5 * unit, 2.0 * unit
    outline = vessels.ring(36)
    face = materials.metal(rng, brushed=False) if rng.random() < 0.7 else _finish(rng)
    trim = materials.dark(rng) if rng.random() < 0.7 else _trim(rng, face)
    belly = radius * float(rng.choice([1.0, 1.08]))
    profile = silhouette(radius, belly, radius, 0.4, 0.0, height, 0.1 * radius)
    solid = stack(profile, outline)
    hollow = vessels.room(profile, outline, wall)

    asm, body, lid = Assembly(), Shape(), Shape()
    body.add(tidy(solid - hollow), face)
    low = height + air
    skirt, rise = float(rng.uniform(3, 7)) * unit, radius * float(rng.uniform(0.12, 0.3))
    wide = radius + 2.2 * unit
    cover = vessels.dome(outline, wide, low - skirt, rise + skirt, skirt + unit)
    room = max(radius_at(profile, h) for h in np.linspace(low - skirt, height, 5)) + air
    wide_room = np.array([[room, low - skirt - 1], [room, low]])
    cover = tidy(cover - stack(wide_room, outline))
    lid.add(cover, face if rng.random() < 0.75 else _finish(rng))
    long, half = float(rng.uniform(0.9, 1.5)) * radius, float(rng.uniform(4, 6)) * unit
    thick = float(rng.uniform(4, 6)) * unit
    ends = (0.0, np.pi) if rng.random() < 0.35 else (0.0,)
    if len(ends) == 2:
        long = 0.4 * radius
    z = low - skirt - 1.2 * unit
    lower = rounded(2 * long, 2 * half, 0.8 * half)
    flat = float(rng.uniform(0.9, 1.1)) * half
    for angle in ends:
        turned = (0, 0, np.rad2deg(angle))
        at = [wide + 0.2 * unit, 0, z - 1.3 * thick]
        bar = extrusion(lower, "z", at, 1.3 * thick).rotate(turned)
        body.add(tidy(bar - solid), trim)
        upper = rounded(2 * long, 2 * flat, 0.8 * flat)
        bar = extrusion(upper, "z", [wide, 0, z + 0.6 * unit], skirt + thick).rotate(turned)
        core = stack(np.array([[room, z - 1], [room, low]]), outline)
        lid.add(tidy(bar - cover - core), trim)
    if len(ends) == 1 and rng.random() < 0.7:
        loop = rounded(0.7 * radius, 2 * half, half)
        ear = extrusion(loop, "z", [-radius, 0, z - 1.5 * thick], thick)
        body.add(tidy(ear - solid), dataclasses.replace(trim))
    root = asm.add("body", body)
    way = float(rng.choice([-1, 1])) * float(np.deg2rad(rng.uniform(25, 60)))
    top = low + rise
    post = float(rng.choice([0.0, rng.uniform(0.1, 0.4)])) * radius
    stem = cylinder("z", [0, 0, top - 0.6 * unit], 3 * unit, 3.5 * unit, segments=18)
    lid.add(tidy(stem - cover), dataclasses.replace(trim))
    cap = asm.add("lid", lid, root, hinge((0, 0, low), (0, 0, 1), way))
    seat = top + 2.4 * unit
    kind = str(rng.choice(["weight", "lever", "dial"], p=[0.35, 0.4, 0.25]))
    tone = materials.hardware(rng) if rng.random() < 0.5 else plain(
        materials.hsv(rng, (0, 1), (0.6, 1), (0.4, 0.9)))  # fmt: skip
    if kind == "lever":  # it lies across the valve and tips up
        x, r = 3.8 * unit, 1.5 * unit
        bar = box([-12 * unit - post, -2 * unit, seat + unit], [x, 2 * unit, seat + 3 * unit])
        bar += cylinder("y", [x, -2.5 * unit, seat + 2 * unit], 5 * unit, r, segments=14)
        bar += ball([-11 * unit - post, 0, seat + 2 * unit], 2.6 * unit, 14)
        joint = hinge((x, 0, seat + 2 * unit), (0, 1, 0), float(rng.uniform(0.5, 1.5)))
        asm.add("valve_lever", Shape().add(tidy(bar), tone), cap, joint)
    elif kind == "weight":
        size = float(rng.uniform(3, 5)) * unit
        drum = cylinder("z", [0, 0, seat + 0.5 * unit], 1.8 * size, size, 0.85 * size, 20)
        drum += cylinder("z", [0, 0, seat + 1.7 * size], 0.8 * size, 0.6 * size, segments=14)
        asm.add("weight", Shape().add(tidy(drum), tone), cap, slide((0, 0, 1), 2 * size))
    else:
        at = [0, 0, seat + 0.5 * unit]
        dial = vessels.knob(rng, at, float(rng.uniform(3.5, 5.5)) * unit, turning=True)
        joint = turn(at, (0, 0, 1)) if rng.random() < 0.4 else hinge(at, (0, 0, 1), 2.2)
        asm.add("valve", Shape().add(dial, tone), cap, joint)
    return asm.object()


def _slow_cooker(rng: np.random.Generator) -> ArticulatedObject:
    """An electric cooker: a round, oval or squared case, a lid hinged behind or lifted, a dial or
    buttons in front."""
    radius = float(rng.uniform(0.1, 0.15))
    power = float(rng.choice([2.0, rng.uniform(2.5, 5)]))
    outline = vessels.ring(36, float(rng.uniform(1.0, 1.45)), power)
    across = float(np.abs(outline[:, 1]).max()) * radius
    height = radius * float(rng.uniform(0.9, 1.7))
    unit = max(2 * across, height) / 100
    air, wall, legs = 0.5 * unit, 3.0 * unit, float(rng.uniform(1.5, 4)) * unit
    face, trim = _finish(rng), materials.dark(rng)
    if rng.random() < 0.3:
        trim = materials.white_plastic(rng)
    top, high = radius * float(rng.uniform(0.9, 1.05)), legs + height
    profile = silhouette(0.93 * radius, max(radius, top), top, 0.6, legs, high, 0.1 * radius)
    solid = stack(profile, outline)

    asm, body = Assembly(), Shape()
    body.add(solid - vessels.room(profile, outline, wall), face)
    pot = stack(
        np.array([[0.55 * radius, legs + wall + unit], [0.6 * radius, legs + 2.5 * wall]]), outline
    )
    body.add(pot, materials.dark(rng))
    feet = [stack(np.array([[0.7 * radius, 0], [0.75 * radius, legs]]), outline)]
    body.add(union(feet), trim)
    panel_x = -max(radius, top) - 1.5 * unit
    half, z0 = 0.55 * across, legs + float(rng.uniform(0.12, 0.2)) * height
    z1 = z0 + float(rng.uniform(0.32, 0.45)) * height
    plate = box([panel_x, -half, z0], [-0.5 * radius, half, z1])
    body.add(tidy(plate - solid), trim)
    hinged = rng.random() < 0.6
    if rng.random() < 0.6 or not hinged:
        reach = across * radius_at(profile, z1) / radius
        _pair(rng, body, solid, reach, legs + 0.75 * height, unit, dataclasses.replace(trim))
    root = asm.add("body", body)
    low = high + air
    _electric_lid(rng, asm, root, outline, top, wall, low, unit, hinged, face, trim)
    middle = (z0 + z1) / 2
    tone = materials.hardware(rng) if rng.random() < 0.6 else face
    mark = plain((0.95, 0.95, 0.95) if tone.color[1] < 0.5 else (0.1, 0.1, 0.1))
    kind = str(rng.choice(["dial", "two", "lever"], p=[0.5, 0.2, 0.3]))
    if kind == "lever":
        r, y = 1.6 * unit, 0.0
        at = [panel_x - r - 0.5 * unit, y, middle + 2 * unit]
        key = cylinder("y", [at[0], y - 5 * unit, at[2]], 10 * unit, r, segments=14)
        key += box([at[0] - 9 * unit, -5 * unit, at[2] - r], [at[0], 5 * unit, at[2] + 0.3 * unit])
        joint = hinge(at, (0, -1, 0), float(rng.uniform(0.3, 0.6)))
        asm.add("switch", Shape().add(tidy(key), tone), root, joint)
    else:
        size = min(0.4 * (z1 - z0), 0.35 * half)
        sweep = None if rng.random() < 0.4 else float(np.deg2rad(rng.choice([120, 180, 270])))
        for y in (0.0,) if kind == "dial" else (-0.5 * half, 0.5 * half):
            at = (panel_x, y, middle)
            add_knob(asm, root, at, size, size, tone, mark, sweep, skirt=rng.random() < 0.4)
    return asm.object()


def _electric_lid(rng, asm, root, outline, top, wall, low, unit, hinged, face, trim) -> None:
    """A lid with a button or a bow; hinged behind, or lifted off."""
    if not hinged:
        _lid(rng, asm, root, outline, top, wall, low, unit, "lift", False, face, trim)
        return
    rise = top * float(rng.uniform(0.12, 0.4))
    cover = vessels.dome(outline, top, low, rise, 0.4 * rise)
    inner = 0.93 * (top - wall)
    cover += stack(np.array([[0.96 * inner, low - 2 * unit], [inner, low + unit]]), outline)
    shape = Shape().add(tidy(cover), face if rng.random() < 0.6 else trim)
    x = top + 2.4 * unit
    barrel = cylinder("y", [x, -12 * unit, low], 24 * unit, 1.7 * unit, segments=12)
    strap = box([0.9 * top, -12 * unit, low], [x, 12 * unit, low + 1.2 * unit])
    shape.add(tidy((barrel + strap) - cover), dataclasses.replace(trim))
    latch = box([-top - 2.5 * unit, -6 * unit, low + 0.3 * unit], [0, 6 * unit, low + 0.35 * rise])
    shape.add(tidy(latch - cover), dataclasses.replace(trim))
    asm.add("lid", shape, root, hinge((x, 0, low), (0, 1, 0), float(rng.uniform(1.0, 1.7))))

"""Suitcases, briefcases and trunks: a shell with a lid, clasps, a carrying handle; or upright on
wheels with a pull-out handle."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cylinder,
    extrusion,
    hinge,
    pipe,
    rounded,
    slide,
    tidy,
    turn,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A suitcase, metres, closed."""
    return _upright(rng) if rng.random() < 0.35 else _lying(rng)


def _shell(rng: np.random.Generator) -> Material:
    """Leather, bright plastic, aluminium, wood or canvas."""
    kind = rng.choice(5, p=[0.25, 0.3, 0.13, 0.12, 0.2])
    if kind == 0:
        return plain(np.array([0.42, 0.25, 0.13]) * rng.uniform(0.5, 1.5))
    if kind == 1:
        return plain(rng.uniform([0.05] * 3, [0.9, 0.75, 0.8]))
    if kind == 2:
        return materials.metal(rng)
    return materials.wood(rng) if kind == 3 else materials.dark(rng)


def _rim(outline: np.ndarray, grow: float) -> np.ndarray:
    """An outline grown on all sides by about ``grow``."""
    half = np.abs(outline).max(0)
    return outline * (1 + grow / half)


def _lying(rng: np.random.Generator) -> ArticulatedObject:
    """On its back, front with clasps and handle at -x, lid hinged behind."""
    trunk = rng.random() < 0.35
    width = float(rng.uniform(0.5, 1.0) if trunk else rng.uniform(0.35, 0.8))
    depth = width * float(rng.uniform(0.45, 0.7) if trunk else rng.uniform(0.55, 0.8))
    height = width * float(rng.uniform(0.35, 0.65) if trunk else rng.uniform(0.18, 0.4))
    unit = width / 100
    seam = height * float(rng.uniform(0.55, 0.85) if trunk else rng.uniform(0.42, 0.75))
    wall, air = max(0.008, float(rng.uniform(1.2, 2.4)) * unit), 0.4 * unit
    corner = float(rng.uniform(0.3, 2) if trunk else rng.uniform(1, 12)) * unit
    face, metal = _shell(rng), materials.hardware(rng)
    lining = materials.paint(rng) if rng.random() < 0.5 else face.darker(0.7)
    half, low = width / 2, seam + air
    outline = rounded(depth, width, corner, 6)
    middle = depth / 2
    proud = float(rng.uniform(0.4, 0.9)) * unit
    rims = rng.random() < 0.6
    band = float(rng.uniform(1.5, 4)) * unit

    asm, body, lid = Assembly(), Shape(), Shape()
    inner = outline * (1 - 2 * wall / np.array([depth, width]))
    solid = extrusion(outline, "z", [middle, 0, 0], seam)
    well = extrusion(inner, "z", [middle, 0, wall], seam)
    if rims:
        ring = extrusion(_rim(outline, proud), "z", [middle, 0, seam - band], band)
        body.add(ring - extrusion(outline, "z", [middle, 0, 0], 2 * height), metal)
    body.add(solid - well, face)
    floor = extrusion(inner * 0.985, "z", [middle, 0, wall], 0.6 * unit)
    body.add(floor, lining)
    tall = height - low
    cover = extrusion(outline, "z", [middle, 0, low], tall)
    vaulted = trunk and rng.random() < 0.4
    if vaulted:
        angle = np.linspace(0, np.pi, 13)
        rise = tall * float(rng.uniform(0.4, 0.9))
        arch = np.column_stack(
            [low + tall - rise + rise * np.sin(angle), middle - middle * np.cos(angle)]
        )
        profile = np.vstack([[[low - 0.01, 0]], arch, [[low - 0.01, depth]]])
        cover = cover ^ extrusion(profile, "y", [0, -half, 0], width)
        room = (profile - [low, middle]) * [1 - wall / tall, 1 - 2 * wall / depth] + [low, middle]
        cover -= extrusion(room, "y", [0, -half + wall, 0], width - 2 * wall)
    else:
        cover -= extrusion(inner, "z", [middle, 0, low - 1], 1 + tall - wall)
    if rims:
        ring = extrusion(_rim(outline, proud), "z", [middle, 0, low], min(band, 0.6 * tall))
        lid.add(ring - extrusion(outline, "z", [middle, 0, low - 1], 3), metal)
    lid.add(tidy(cover), face)
    front = -proud if rims else 0.0
    if not vaulted and not rims and rng.random() < 0.35:
        front = _straps(rng, body, lid, depth, half, seam, low, height, unit)
    elif not vaulted and corner < 3 * unit and rng.random() < 0.6:
        _corners(rng, body, lid, depth, half, seam, low, height, proud, unit, metal)
        front = -proud
    fittings = _fittings(rng, body, front, half, seam, low, height, unit, metal)
    root = asm.add("body", body)
    swing = float(np.deg2rad(rng.uniform(75, 115) if trunk or rng.random() < 0.5 else 175))
    back = depth + (proud if rims else 0.0)
    top = asm.add("lid", lid, root, hinge((back, 0, low), (0, 1, 0), swing))
    for name, shape, joint, on_lid in fittings:
        asm.add(name, shape, top if on_lid else root, joint)
    return asm.object()


def _straps(rng, body, lid, depth, half, seam, low, height, unit) -> float:
    """Belts round the case; returns the plane of their front."""
    belt = materials.plain(np.array([0.35, 0.2, 0.1]) * rng.uniform(0.4, 1.6))
    y, w, t = half * float(rng.uniform(0.45, 0.75)), 1.6 * unit, 0.8 * unit
    for side in (-y, y):
        body.add(box([-t, side - w, 0], [0, side + w, seam]), belt)
        lid.add(box([-t, side - w, low], [0, side + w, height + t]), belt)
        lid.add(box([0, side - w, height], [0.9 * depth, side + w, height + t]), belt)
    return -t


def _corners(rng, body, lid, depth, half, seam, low, height, proud, unit, metal) -> None:
    """Caps on the corners at the front, as trunks have."""
    size = float(rng.uniform(4, 8)) * unit
    for y in (-1, 1):
        for shape, a, b in (
            (body, 0.0, min(size, 0.4 * seam)),
            (lid, height - min(size, 0.4 * (height - low)), height),
        ):
            lo, hi = sorted((y * (half + proud), y * (half - size)))
            block = box([-proud, lo, a], [size, hi, b])
            inside = box([0, -half, -1], [depth, half, 2 * height])
            shape.add(block - inside, metal)


def _fittings(rng, body, front, half, seam, low, height, unit, metal) -> list[tuple]:
    """Clasps over the seam that fold down or up, and a handle that folds up: (name, shape, joint,
    whether on the lid).

    What carries the handle is added to ``body``.
    """
    found: list[tuple] = []
    count = int(rng.choice([0, 1, 2, 3], p=[0.07, 0.2, 0.63, 0.1]))
    handle = rng.random() < 0.8
    if count in (1, 3) and handle:
        count = 2
    spread = half * float(rng.uniform(0.5, 0.78))
    ys = {0: [], 1: [0.0], 2: [-spread, spread], 3: [-spread, 0.0, spread]}[count]
    w, thick = float(rng.uniform(2.4, 4.5)) * unit, 1.5 * unit
    below = min(float(rng.uniform(3.5, 8)) * unit, 0.7 * seam)
    above = min(float(rng.uniform(2.5, 5)) * unit, 0.7 * (height - low))
    down = rng.random() < 0.6  # hinged at the body, folds down; else at the lid, folds up
    x = front - 0.3 * unit
    swing = float(np.deg2rad(rng.uniform(90, 165)))
    for y in ys:
        plate = box([x - thick, y - w, seam - below], [x, y + w, low + above])
        rib = box(
            [x - 1.7 * thick, y - 0.5 * w, low - 0.5 * unit],
            [x - thick, y + 0.5 * w, low + 0.7 * above],
        )
        shape = Shape().add(union([plate, rib]) if rng.random() < 0.6 else plate, metal)
        if down:
            joint = hinge((x - thick, y, seam - below), (0, -1, 0), swing)
            found.append(("clasp", shape, joint, False))
        else:
            joint = hinge((x - thick, y, low + above), (0, 1, 0), swing)
            found.append(("clasp", shape, joint, True))
    if not handle or seam < 5 * unit:
        return found
    reach = min(float(rng.uniform(5, 8)) * unit, 0.75 * seam)
    z = seam - float(rng.uniform(0.1, 0.25)) * seam
    reach = min(reach, 0.85 * z)
    span = float(rng.uniform(0.16, 0.3)) * half * 2
    span = min(span, spread - w - 2 * unit) if count == 2 else span
    r, way = float(rng.uniform(0.8, 1.4)) * unit, span / 2
    x = front - r - 0.6 * unit
    line = [[x, -way, z], [x, -way, z - reach], [x, way, z - reach], [x, way, z]]
    grip = Shape().add(pipe(line, r, 10), metal if rng.random() < 0.4 else materials.dark(rng))
    lug, gap = 1.3 * unit, 0.3 * unit
    for a in (way + r + gap, -way - r - gap - lug):
        body.add(box([x - r, a, z - r], [0, a + lug, z + r]), metal)
    joint = hinge((x, 0, z), (0, 1, 0), float(np.deg2rad(rng.uniform(85, 120))))
    found.append(("handle", grip, joint, False))
    return found


def _upright(rng: np.random.Generator) -> ArticulatedObject:
    """A cabin or large case: the front half opens at the side; wheels; a handle that pulls out of
    the top."""
    height = float(rng.uniform(0.45, 0.78))
    width, depth = height * float(rng.uniform(0.6, 0.75)), height * float(rng.uniform(0.32, 0.48))
    unit = height / 100
    wall, air = float(rng.uniform(1.3, 2.0)) * unit, 0.35 * unit
    corner = float(rng.uniform(2, 11)) * unit
    face, metal = _shell(rng), materials.hardware(rng)
    half, legs = width / 2, float(rng.uniform(6, 10)) * unit
    split = depth * float(rng.uniform(0.3, 0.6))
    outline = rounded(width, height, corner, 6)  # (y, z)
    middle = legs + height / 2
    inner = outline * (1 - 2 * wall / np.array([width, height]))

    asm, body, lid = Assembly(), Shape(), Shape()
    solid = extrusion(outline, "x", [split + air, 0, middle], depth - split - air)
    solid -= extrusion(inner, "x", [split - 1, 0, middle], 1 + depth - split - wall)
    cover = extrusion(outline, "x", [0, 0, middle], split)
    cover -= extrusion(inner, "x", [wall, 0, middle], 2)
    grooves = int(rng.choice([0, 3, 5, 7], p=[0.4, 0.2, 0.2, 0.2]))
    if grooves:
        across = rng.random() < 0.3
        for k in range(grooves):
            share = (k + 0.5) / grooves * 2 - 1
            if across:
                z, w = middle + 0.42 * height * share, 0.4 * height / grooves * 0.45
                cover -= box([-1, -0.4 * width, z - w], [0.4 * wall, 0.4 * width, z + w])
            else:
                y, w = 0.42 * width * share, 0.4 * width / grooves * 0.45
                cover -= box(
                    [-1, y - w, middle - 0.4 * height], [0.4 * wall, y + w, middle + 0.4 * height]
                )
    lid.add(cover, face)
    rim = 0.7 * unit if rng.random() < 0.5 else 0.0
    if rim:
        ring = extrusion(_rim(outline, rim), "x", [split + air, 0, middle], 1.6 * unit)
        body.add(ring - extrusion(outline, "x", [0, 0, middle], 1), metal)
    # channels for the rods, through the top wall
    pull = rng.random() < 0.8
    rod, gauge = 0.9 * unit, half * float(rng.uniform(0.3, 0.5))
    x = depth - wall - 3.0 * unit
    rise = legs + height
    if pull:
        for y in (-gauge, gauge):
            solid -= box(
                [x - rod - air, y - rod - air, rise - 3 * wall],
                [x + rod + air, y + rod + air, rise + 1],
            )
    body.add(solid, face)
    way = 1 if rng.random() < 0.5 else -1  # of the hinges
    if rng.random() < 0.7:  # a grip at the other side
        z, r, out = middle, 1.0 * unit, 3.2 * unit
        y, s = -way * half, -way
        line = [
            [depth * 0.75, y, z - 8 * unit],
            [depth * 0.75, y + s * out, z - 7 * unit],
            [depth * 0.75, y + s * out, z + 7 * unit],
            [depth * 0.75, y, z + 8 * unit],
        ]
        lo, hi = ([-1, half, -1], [2, 2, 3]) if s > 0 else ([-1, -2, -1], [2, -half, 3])
        body.add(pipe(line, r, 8) ^ box(lo, hi), materials.dark(rng))
    four = rng.random() < 0.5
    radius = 0.5 * legs
    xs = [0.18 * depth, depth - 1.2 * radius] if four else [depth - 1.2 * radius]
    xs = [max(q, split + 1.1 * radius + air) if k == 0 and four else q for k, q in enumerate(xs)]
    if four and xs[1] - xs[0] < 3 * radius:
        xs = xs[1:]
    spots = [(q, y) for q in xs for y in (-half + 0.18 * width, half - 0.18 * width)]
    if len(xs) == 1:  # it stands on feet in front
        for y in (-half + 0.18 * width, half - 0.18 * width):
            at = [split + 2.2 * unit, y, 0]
            body.add(
                cylinder("z", at, legs + 0.02 * height, 1.6 * unit, segments=12) - solid,
                materials.dark(rng),
            )
    rubber = materials.dark(rng)
    wide = 0.5 * radius
    gap = 0.35 * unit
    for q, y in spots:  # forks
        cheeks = []
        for side in (y - wide - gap - 0.8 * unit, y + wide + gap):
            cheeks.append(
                box(
                    [q - 0.6 * radius, side, 0.6 * radius],
                    [q + 0.6 * radius, side + 0.8 * unit, legs + 0.01 * height],
                )
            )
        body.add(union(cheeks) - solid, rubber)
    root = asm.add("body", body)
    swing = float(np.deg2rad(rng.uniform(80, 175)))
    joint = hinge((split, way * (half + rim), 0), (0, 0, -way), swing)
    asm.add("lid", lid, root, joint)
    if pull:
        deep = 0.8 * (height - 4 * wall)
        low, lift = rise - deep, float(rng.uniform(0.4, 0.85)) * deep
        bar = [
            box([x - rod, y - rod, low], [x + rod, y + rod, rise + 1.2 * unit])
            for y in (-gauge, gauge)
        ]
        top = box(
            [x - 1.6 * unit, -gauge - 1.6 * unit, rise + 0.6 * unit],
            [x + 1.6 * unit, gauge + 1.6 * unit, rise + 3.4 * unit],
        )
        steel = materials.metal(rng, brushed=False) if rng.random() < 0.6 else materials.dark(rng)
        shape = Shape().add(union(bar) - top, steel).add(top, materials.dark(rng))
        asm.add("pull_handle", shape, root, slide((0, 0, 1), lift))
    for q, y in spots:
        wheel = cylinder("y", [q, y - wide, radius], 2 * wide, radius, segments=20)
        asm.add("wheel", Shape().add(wheel, rubber), root, turn((q, y, radius), (0, 1, 0)))
    return asm.object()

"""Grills: kettles and ceramic eggs with a lid, gas grills on carts, barrels with a chimney, and
braziers whose grate moves."""

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
    box,
    cut,
    cylinder,
    extrusion,
    hinge,
    pipe,
    revolution,
    rounded,
    slide,
    tidy,
    tube,
    turn,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A grill, metres, closed."""
    kinds = (_kettle, _gas, _barrel, _brazier)
    return kinds[rng.choice(4, p=[0.34, 0.34, 0.17, 0.15])](rng)


def _enamel(rng: np.random.Generator) -> Material:
    """Black, a strong colour, or steel."""
    kind = rng.choice(4, p=[0.4, 0.3, 0.2, 0.1])
    if kind == 0:
        return materials.dark(rng)
    if kind == 1:
        return plain(rng.uniform([0.05] * 3, [0.85, 0.65, 0.7]))
    return materials.metal(rng) if kind == 2 else materials.paint(rng)


def _board(rng: np.random.Generator) -> Material:
    """Of side shelves: wood, plastic, steel."""
    if rng.random() < 0.5:
        return materials.wood(rng, grain="y")
    return materials.dark(rng) if rng.random() < 0.5 else materials.metal(rng)


def _wheel(asm, root, at, r, wide, side, steel: Material) -> None:
    """A wheel about y beside the plane y = ``at[1]``, its hub of another colour."""
    x, y, z = at
    y += side * 0.003
    start = y if side > 0 else y - wide
    tyre = cylinder("y", [x, start, z], wide, r, segments=24)
    hub = cylinder("y", [x, start - 0.1 * wide * (side < 0), z], 1.1 * wide, 0.55 * r, segments=18)
    holes = [
        cylinder("y", [x + 0.36 * r * c, start - 1, z + 0.36 * r * s], 2, 0.11 * r, segments=8)
        for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1))
    ]
    hub, tyre = cut(hub, holes), tyre - cylinder("y", [x, start - 1, z], 2, 0.55 * r, segments=18)
    shape = Shape().add(tyre, plain((0.1, 0.1, 0.1))).add(hub, steel)
    asm.add("wheel", shape, root, turn(at, (0, 1, 0)))


def _shelf(rng, asm, root, y, side, x, z, long, deep, unit, board: Material) -> None:
    """A side shelf that folds about x at the plane ``y``; up or hanging down."""
    thick, air = 2.2 * unit, 0.4 * unit
    a, b = y + side * air, y + side * (air + long)
    lo, hi = sorted((a, b))
    if rng.random() < 0.65:
        outline = rounded(deep, long, float(rng.uniform(0.02, 0.3)) * min(deep, long))
        plate = extrusion(outline, "z", [x, (lo + hi) / 2, z - thick], thick)
        joint = hinge((x, a, z - thick), (-side, 0, 0), float(rng.uniform(1.3, 1.57)))
        slots = []
        if rng.random() < 0.4:
            slots = [
                box(
                    [x + k * deep - 0.06 * deep, lo + 0.15 * long, -1],
                    [x + k * deep + 0.06 * deep, hi - 0.15 * long, 9],
                )
                for k in (-0.3, -0.1, 0.1, 0.3)
            ]
        plate = cut(plate, slots)
    else:  # hangs down
        t = sorted((a, a + side * thick))
        plate = box([x - deep / 2, t[0], z - long], [x + deep / 2, t[1], z])
        joint = hinge((x, a + side * thick, z), (side, 0, 0), float(np.pi / 2))
    asm.add("side_shelf", Shape().add(plate, board), root, joint)


def _bow(half, x, z, out, r) -> Manifold:
    """A handle along y: two feet from the point (x, z), ``out`` (x, z) long, and a bar."""
    dx, dz = out
    line = [[x, -half, z], [x + dx, -half, z + dz], [x + dx, half, z + dz], [x, half, z]]
    return pipe(line, r, 10)


def _dome(radius, high, low, wall, power, floor=0.0) -> tuple[Manifold, Manifold]:
    """A bowl upside down about the z axis from ``low`` up, ``floor``: radius of its flat top; and
    the same, solid."""
    t = np.linspace(0, np.pi / 2, 11)
    r = np.maximum(radius * np.cos(t) ** power, floor)
    outer = np.column_stack([r, high * np.sin(t)])
    inner = outer * [1 - wall / radius, 1 - wall / high]
    full = revolution(np.vstack([outer, [[0, high], [0, 0]]]), "z", [0, 0, low], 32)
    hollow = revolution(
        np.vstack([inner, [[0, high - wall], [0, -0.01], [inner[0, 0], -0.01]]]),
        "z",
        [0, 0, low],
        32,
    )
    return full - hollow, full


def _kettle(rng: np.random.Generator) -> ArticulatedObject:
    """A round or egg-shaped grill on legs with wheels, or on a stand: lid, vent, ash drawer,
    shelf."""
    radius = float(rng.uniform(0.2, 0.3))
    egg = rng.random() < 0.3
    low_one = rng.random() < 0.2  # on a table or the ground
    bowl_high = radius * (float(rng.uniform(1.0, 1.5)) if egg else float(rng.uniform(0.6, 0.9)))
    lid_high = radius * (float(rng.uniform(0.9, 1.2)) if egg else float(rng.uniform(0.5, 0.85)))
    rim = bowl_high + radius * (
        float(rng.uniform(0.15, 0.4)) if low_one else float(rng.uniform(0.9, 1.7))
    )
    if egg and not low_one:
        rim = bowl_high + radius * float(rng.uniform(0.4, 0.8))
    unit = max(rim + lid_high, 2 * radius) / 100
    air, wall = 0.4 * unit, 1.6 * unit
    face, steel = _enamel(rng), materials.metal(rng, brushed=False)
    lid_face = face if rng.random() < 0.75 else _enamel(rng)
    dark, board = materials.dark(rng), _board(rng)
    asm, body = Assembly(), Shape()
    floor = 0.45 * radius if egg else 0.15 * radius
    shell, full = (
        m.mirror((0, 0, 1)) for m in _dome(radius, bowl_high, 0.0, wall, 0.7 if egg else 1.0, floor)
    )
    shell, full = shell.translate((0, 0, rim)), full.translate((0, 0, rim))
    grate = cylinder(
        "z", [0, 0, rim - 0.12 * bowl_high], 0.9 * unit, radius - 0.7 * wall, segments=28
    )
    bars = [
        box([-1, k * 0.16 * radius, -1], [1, k * 0.16 * radius + 0.08 * radius, 3])
        for k in range(-6, 6)
    ]
    inside = cylinder("z", [0, 0, 0], 3, 0.85 * radius, segments=24)
    bands = []
    for_lid = []
    if egg or rng.random() < 0.4:  # a band round the rim
        t = 0.9 * unit
        bands.append(tube("z", [0, 0, rim - 4 * unit], 4 * unit, radius + t, 0.985 * radius))
        for_lid.append(tube("z", [0, 0, rim + air], 3 * unit, radius + t, 0.97 * radius))
    lift = rng.random() < 0.35 and not egg
    back = radius + 2.5 * unit
    if not lift:
        w = 6 * unit
        bands.append(box([0.8 * radius, -w, rim - 4 * unit], [back, w, rim]))
        for_lid.append(box([0.8 * radius, -w, rim + air], [back, w, rim + air + 3 * unit]))
    body.add(tidy(shell), face)
    body.add(tidy(cut(grate, [b ^ inside for b in bars]) - shell), steel)
    if bands:
        body.add(tidy(union(bands) - full), steel)
    wheels = _stand(rng, body, radius, rim, bowl_high, full, unit, low_one, steel, dark, egg)
    side = float(rng.choice([-1, 1]))
    shelves = [] if low_one or rng.random() < 0.4 else [side]
    shelves = [-1.0, 1.0] if egg and shelves else shelves
    y, z = radius + 3 * unit, rim - 3 * unit
    for s in shelves:
        lo, hi = sorted((s * 0.5 * radius, s * y))
        for x in (-0.3 * radius, 0.3 * radius):
            arm = box([x - 1.2 * unit, lo, z - 2.4 * unit], [x + 1.2 * unit, hi, z])
            body.add(tidy(arm - full - union(bands) if bands else arm - full), dark)
    root = asm.add("bowl", body)
    cap, solid = _dome(radius, lid_high, rim + air, wall, 0.85 if egg else 1.0, 0.2 * radius)
    lid = Shape().add(tidy(cap), lid_face)
    if for_lid:
        lid.add(tidy(union(for_lid) - solid), steel)
    top = rim + air + lid_high
    grip = board if rng.random() < 0.6 else dark
    in_front = not lift and rng.random() < 0.75
    if in_front:
        phi = float(rng.uniform(0.25, 0.7))
        x, z0 = -0.95 * radius * np.cos(phi), rim + air + 0.95 * lid_high * np.sin(phi)
        out = (-0.05 * radius - 6 * unit * np.cos(phi), 6 * unit * np.sin(phi))
        bow = _bow(float(rng.uniform(0.2, 0.4)) * radius, x, z0, out, 1.5 * unit)
        lid.add(tidy(bow - solid), grip)
    else:
        bow = _bow(
            float(rng.uniform(0.15, 0.3)) * radius, 0, top - 2 * unit, (0, 8 * unit), 1.5 * unit
        )
        lid.add(tidy(bow - solid), grip)
    joint = slide((0, 0, 1), float(rng.uniform(0.5, 1.2)) * radius)
    if not lift:
        joint = hinge((back, 0, rim + air), (0, 1, 0), float(np.deg2rad(rng.uniform(55, 90))))
    vent = None
    if in_front:  # a vent or a chimney's cap on the top
        r, tall = (0.3 * radius, 6 * unit) if egg else (0.22 * radius, 1.5 * unit)
        lid.add(cylinder("z", [0, 0, top], tall, 0.85 * r, segments=20), steel if egg else lid_face)
        disc = cylinder("z", [0, 0, top + tall + air], 2 * unit, r, segments=22)
        tab = box(
            [-1.5 * r, -1.3 * unit, top + tall + air],
            [-0.7 * r, 1.3 * unit, top + tall + air + 3 * unit],
        )
        vent = Shape().add(tidy(disc + tab), dark if rng.random() < 0.5 else steel)
    cover = asm.add("lid", lid, root, joint)
    if vent is not None:
        ends = turn((0, 0, top), (0, 0, 1))
        if egg and rng.random() < 0.5:
            ends = hinge((0.3 * radius, 0, top + 6 * unit + air), (0, 1, 0), 1.4)
        asm.add("vent", vent, cover, ends)
    for at, r, wide, s in wheels:
        _wheel(asm, root, at, r, wide, s, steel if rng.random() < 0.5 else face)
    for s in shelves:
        long = min(float(rng.uniform(0.7, 1.2)) * radius, 0.7 * rim)
        deep = float(rng.uniform(0.8, 1.4)) * radius
        _shelf(rng, asm, root, s * y, s, 0.0, z, long, deep, unit, board)
    return asm.object()


def _stand(rng, body, radius, rim, bowl_high, full, unit, low_one, steel, dark, egg) -> list[tuple]:
    """Three or four legs under a bowl; returns the wheels: (at, radius, width, side)."""
    r = float(rng.uniform(1.2, 1.9)) * unit
    finish = steel if rng.random() < 0.6 else dark
    foot = float(rng.uniform(0.75, 1.05)) * radius
    wheel = min(float(rng.uniform(0.2, 0.34)) * radius, 0.2 * rim)
    wheels, legs = [], []
    angles = [np.pi, np.pi / 3, -np.pi / 3]
    if egg or rng.random() < 0.3:
        angles = [0.75 * np.pi, -0.75 * np.pi, np.pi / 4, -np.pi / 4]
    rolling = not low_one and rng.random() < 0.75
    top = rim - 0.7 * bowl_high
    for a in angles:
        c, s = np.cos(a), np.sin(a)
        end = wheel if rolling and c > 0 else r
        legs.append(
            pipe([[0.5 * radius * c, 0.5 * radius * s, top], [foot * c, foot * s, end]], r, 10)
        )
    if rolling:
        x, y = foot * np.cos(angles[-1]), abs(foot * np.sin(angles[-1])) + r
        legs.append(cylinder("y", [x, -y, wheel], 2 * y, 0.8 * r, segments=12))
        wheels = [((x, s * y, wheel), wheel, 0.35 * wheel + unit, s) for s in (-1, 1)]
    if not low_one and rng.random() < 0.6:  # a rack or ring between the legs
        z = 0.35 * top
        share = 1 - z / top
        points = [
            [
                (0.5 * radius * (1 - share) + foot * share) * np.cos(a),
                (0.5 * radius * (1 - share) + foot * share) * np.sin(a),
                z,
            ]
            for a in sorted(angles)
        ]
        legs.append(pipe([*points, points[0]], 0.7 * r, 8))
    body.add(tidy(union(legs) - full), finish)
    if not low_one and not egg and rng.random() < 0.5:  # a pot for the ashes
        z = rim - bowl_high
        pot = cylinder("z", [0, 0, z - 7 * unit], 8 * unit, 0.3 * radius, 0.36 * radius, 24)
        body.add(tidy(cut(pot, [full, *legs])), steel)
    return wheels


def _gas(rng: np.random.Generator) -> ArticulatedObject:
    """A box with burners under a hinged hood, knobs in front, on a cart with doors, shelves and
    wheels."""
    half, depth = float(rng.uniform(0.26, 0.45)), float(rng.uniform(0.42, 0.58))
    seam = float(rng.uniform(0.8, 0.95))
    table = rng.random() < 0.18
    if table:
        half, depth, seam = 0.8 * half, 0.75 * depth, float(rng.uniform(0.16, 0.24))
    fire = float(rng.uniform(0.16, 0.24)) if not table else seam - 0.03
    hood_high = depth * float(rng.uniform(0.35, 0.65))
    unit = (seam + hood_high) / 100
    air, wall = 0.4 * unit, 1.6 * unit
    face, steel = _enamel(rng), materials.metal(rng)
    hood_face = face if rng.random() < 0.5 else _enamel(rng)
    dark, board = materials.dark(rng), _board(rng)
    asm, body = Assembly(), Shape()
    floor = seam - fire
    solid = box([0, -half, floor], [depth, half, seam])
    solid -= box([wall, -half + wall, floor + 0.3 * fire], [depth - wall, half - wall, seam + 1])
    panel_deep = float(rng.uniform(4, 8)) * unit
    panel_low = seam - fire * float(rng.uniform(0.55, 0.95))
    lean = float(rng.choice([0.0, rng.uniform(0.0, 0.4)])) * panel_deep
    outline = np.array(
        [
            [panel_low, 0],
            [panel_low, -panel_deep],
            [seam - 0.02, -panel_deep + lean],
            [seam - 0.02, 0],
        ]
    )
    lean = 0.0 if lean == 0 else float(np.arctan2(lean, seam - 0.02 - panel_low))
    body.add(solid, face)
    body.add(
        extrusion(outline, "y", [0, -half, 0], 2 * half), steel if rng.random() < 0.5 else face
    )
    grate = box(
        [wall, -half + wall, seam - 0.2 * fire],
        [depth - wall, half - wall, seam - 0.2 * fire + unit],
    )
    pitch = 2 * half / 12
    holes = [
        box(
            [2 * wall, -half + (k + 0.2) * pitch, 0],
            [depth - 2 * wall, -half + (k + 0.7) * pitch, 3],
        )
        for k in range(1, 11)
    ]
    body.add(cut(grate, holes), dark)
    kind = "feet" if table else str(rng.choice(["doors", "open"], p=[0.55, 0.45]))
    wheel = float(rng.uniform(5, 9)) * unit
    rolling = not table and rng.random() < 0.7
    doors = _cart(rng, body, kind, half, depth, floor, wheel, unit, face, dark)
    side_kind = (
        str(rng.choice(["fold", "fixed", "none"], p=[0.5, 0.3, 0.2])) if not table else "none"
    )
    long = float(rng.uniform(0.22, 0.36))
    deep, z = depth * float(rng.uniform(0.7, 0.95)), seam - 2 * unit
    burner = None
    if side_kind == "fixed":
        for s in (-1, 1):
            lo, hi = sorted((s * half, s * (half + long)))
            body.add(
                box([0.5 * (depth - deep), lo, z - 3 * unit], [0.5 * (depth + deep), hi, z]), board
            )
        burner = float(rng.choice([-1, 1])) if rng.random() < 0.6 else None
    root = asm.add("cart", body)
    hood = _hood(rng, half, depth, seam + air, hood_high, wall, unit, hood_face, steel)
    swing = float(np.deg2rad(rng.uniform(60, 90)))
    asm.add("hood", hood, root, hinge((depth, 0, seam + air), (0, 1, 0), swing))
    count = int(rng.integers(1, 6))
    r = min(0.26 * (seam - panel_low), 4 * unit, 0.7 * half / count)
    middle = (panel_low + seam - 0.02) / 2
    x = -panel_deep + np.tan(lean) * (middle - panel_low) - 5e-4
    knob = dark if rng.random() < 0.5 else materials.hardware(rng)
    mark = plain(np.ones(3) * (0.95 if sum(knob.color) < 1.5 else 0.1))
    for k in range(count):
        y = ((k + 0.5) / count * 2 - 1) * 0.85 * half
        add_knob(
            asm,
            root,
            (x, y, middle),
            max(r, 2 * unit),
            1.1 * r,
            knob,
            mark,
            float(np.deg2rad(rng.choice([90, 135, 270]))),
            skirt=rng.random() < 0.5,
            tilt=lean,
        )
    door_face, level = (hood_face if rng.random() < 0.5 else face), bool(rng.random() < 0.4)
    for lo, hi, side in doors:
        _door(rng, asm, root, lo, hi, side, unit, door_face, steel, level)
    if side_kind == "fold":
        for s in (-1, 1) if rng.random() < 0.7 else (float(rng.choice([-1, 1])),):
            _shelf(
                rng,
                asm,
                root,
                s * half,
                s,
                depth / 2,
                z,
                min(long, 0.8 * (z - 2 * wheel)),
                deep,
                unit,
                board,
            )
    if burner is not None:
        y = burner * (half + long / 2)
        w = 0.4 * long
        plate = box([0.5 * depth - w, y - w, z + air], [0.5 * depth + w, y + w, z + 3 * unit])
        joint = hinge((0.5 * depth + w, y, z + air), (0, 1, 0), float(rng.uniform(1.2, 1.57)))
        asm.add("burner_lid", Shape().add(plate, hood_face), root, joint)
    if rolling:
        spots = [(0.85 * depth, s) for s in (-1, 1)]
        for x, s in spots:
            _wheel(asm, root, (x, s * half, wheel), wheel, 3.5 * unit, s, steel)
    return asm.object()


def _cart(rng, body, kind, half, depth, floor, wheel, unit, face, dark) -> list[tuple]:
    """What carries the box: feet, four legs with a shelf, or a cabinet; returns its doors: (lo, hi,
    hinge's side)."""
    w = float(rng.uniform(2, 3.5)) * unit
    xs, ys = (0.0, depth - w), (-half, half - w)
    low = wheel * 1.4
    if kind != "doors":
        legs = [box([x, y, 0], [x + w, y + w, floor]) for x in xs for y in ys]
        if kind == "open":
            legs.append(box([0, -half, low], [depth, half, low + 2 * unit]))
            if rng.random() < 0.4:
                legs.append(box([depth - w, -half, low], [depth, half, floor]))
        body.add(tidy(union(legs)), face if rng.random() < 0.5 else dark)
        return []
    wall = 1.6 * unit
    bottom = low if rng.random() < 0.7 else 0.4 * wheel
    solid = box([0, -half, bottom], [depth, half, floor]) - box(
        [-1, -half + wall, bottom + wall], [depth - wall, half - wall, floor - wall]
    )
    legs = [
        box([x, y, 0], [x + w, y + w, bottom + 0.5 * wall])
        for x in (0.1 * depth, depth - w)
        for y in ys
    ]
    body.add(tidy(union([solid, *legs])), face)
    air, thick = 0.35 * unit, 2.2 * unit
    count = int(rng.choice([1, 2], p=[0.25, 0.75]))
    a = np.array([-thick - air, -half + air, bottom + air])
    b = np.array([-air, half - air, floor - 4 * unit])
    if count == 1:
        return [(a, b, float(rng.choice([-1, 1])))]
    left, right = b.copy(), a.copy()
    left[1], right[1] = -air, air
    return [(a, left, -1.0), (right, b, 1.0)]


def _door(rng, asm, root, lo, hi, side, unit, face, steel, level: bool) -> None:
    """A flat door in front, hinged at the ``side`` of y, with a bar to pull, upright or
    ``level``."""
    plate = box(lo, hi)
    y = lo[1] + 6 * unit if side > 0 else hi[1] - 6 * unit
    z = hi[2] - 0.3 * (hi[2] - lo[2])
    x, r = lo[0] + 0.5 * unit, 1.3 * unit
    long = float(rng.uniform(0.12, 0.3)) * (hi[2] - lo[2])
    line = [
        [x, y, z + long],
        [x - 4 * unit, y, z + long],
        [x - 4 * unit, y, z - long],
        [x, y, z - long],
    ]
    if level:
        z = hi[2] - 6 * unit
        lo_y, hi_y = lo[1] + 0.25 * (hi[1] - lo[1]), hi[1] - 0.25 * (hi[1] - lo[1])
        line = [[x, lo_y, z], [x - 4 * unit, lo_y, z], [x - 4 * unit, hi_y, z], [x, hi_y, z]]
    shape = Shape().add(plate, face).add(tidy(pipe(line, r, 10) - plate), steel)
    at = (lo[0], hi[1] if side > 0 else lo[1], 0)
    asm.add("door", shape, root, hinge(at, (0, 0, -side), float(np.deg2rad(rng.uniform(80, 130)))))


def _hood(rng, half, depth, low, high, wall, unit, face, steel) -> Shape:
    """A hollow hood with a handle: an arch, a slope, or a box with a rounded edge; cheeks of
    another colour at times."""
    kind = str(rng.choice(["arch", "slope", "edge"], p=[0.35, 0.4, 0.25]))
    if kind == "arch":
        t = np.linspace(0, np.pi, 15)
        p = float(rng.uniform(0.5, 1.0))
        outline = np.column_stack([high * np.sin(t) ** p, depth / 2 * (1 - np.cos(t))])
    elif kind == "slope":
        a, b = float(rng.uniform(0.1, 0.5)), float(rng.uniform(0.0, 0.25))
        knee = float(rng.uniform(0.2, 0.6))
        outline = np.array(
            [
                [0, 0],
                [knee * high, 0.3 * a * depth],
                [high, a * depth],
                [high, (1 - b) * depth],
                [0, depth],
            ]
        )
    else:
        t = np.linspace(0, np.pi / 2, 8)
        r = float(rng.uniform(0.5, 0.98)) * min(high, 0.9 * depth)
        edge = np.column_stack([high - r + r * np.sin(t), r - r * np.cos(t)])
        outline = np.vstack([[[0, 0]], edge, [[high, depth], [0, depth]]])
    solid = extrusion(outline + [low, 0], "y", [0, -half, 0], 2 * half)
    middle = depth / 2
    inner = (outline - [0, middle]) * [1 - wall / high, 1 - 2 * wall / depth] + [
        low - 0.001,
        middle,
    ]
    cheek = float(rng.uniform(2, 6)) * unit
    hollow = solid - extrusion(inner, "y", [0, -half + wall, 0], 2 * half - 2 * wall)
    hood = Shape()
    if rng.random() < 0.35:  # its ends of another colour
        core = box([-1, -half + cheek, 0], [3, half - cheek, 9])
        hood.add(hollow ^ core, face).add(hollow - core, materials.dark(rng))
    else:
        hood.add(hollow, face)
    z = low + float(rng.uniform(0.12, 0.35)) * high
    reach = float(rng.uniform(4, 7)) * unit
    bow = _bow(
        float(rng.uniform(0.45, 0.85)) * half, 0.3 * depth, z, (-0.3 * depth - reach, 0), 1.4 * unit
    )
    hood.add(tidy(bow - solid), steel)
    return hood


def _barrel(rng: np.random.Generator) -> ArticulatedObject:
    """A lying barrel whose upper half opens, with a chimney, a fire box or shelves, on legs with
    wheels."""
    radius, half = float(rng.uniform(0.18, 0.26)), float(rng.uniform(0.26, 0.5))
    center = float(rng.uniform(0.6, 0.85))
    unit = max(center + radius, 2 * half) / 100
    air, wall = 0.4 * unit, 1.6 * unit
    face, steel, dark = _enamel(rng), materials.metal(rng, brushed=False), materials.dark(rng)
    board = _board(rng)
    asm, body = Assembly(), Shape()
    full = cylinder("y", [0, -half, center], 2 * half, radius, segments=36)
    shell = full - cylinder(
        "y", [0, -half + wall, center], 2 * half - 2 * wall, radius - wall, segments=36
    )
    lower = box([-1, -2, 0], [1, 2, center])
    body.add(shell ^ lower, face)
    grate = box(
        [-0.97 * radius, -half + wall, center - 3 * unit],
        [0.97 * radius, half - wall, center - 2 * unit],
    )
    pitch = 2 * half / 14
    holes = [
        box(
            [-0.85 * radius, -half + (k + 0.2) * pitch, 0],
            [0.85 * radius, -half + (k + 0.7) * pitch, 3],
        )
        for k in range(1, 13)
    ]
    body.add(tidy(cut(grate, holes) - shell), steel)
    leg, w, foot = 1.5 * unit, 0.75 * half, float(rng.uniform(0.8, 1.2)) * radius
    wheel = float(rng.uniform(5, 10)) * unit
    side = float(rng.choice([-1, 1]))
    rolling = rng.random() < 0.75
    bars = []
    for s in (-1, 1):
        end = wheel if rolling and s == side else leg
        for x in (-1, 1):
            bars.append(
                pipe(
                    [[0.5 * x * radius, s * w, center - 0.5 * radius], [x * foot, s * w, end]],
                    leg,
                    10,
                )
            )
    bars.append(box([-0.9 * foot, -w, 0.3 * center], [0.9 * foot, w, 0.3 * center + 1.5 * unit]))
    body.add(tidy(union(bars) - full), dark)
    chimney = rng.random() < 0.6
    if chimney:
        s, r = -side, float(rng.uniform(3, 5)) * unit
        y = chimney_y = s * (half + r + 1.5 * unit)
        top = center + radius * float(rng.uniform(1.1, 1.8))
        z = center - 0.3 * radius
        lo, hi = sorted((s * (half - 0.5 * wall), y))
        body.add(
            tidy(
                union(
                    [
                        cylinder("z", [0, y, z - r], top - z + r, r, segments=20),
                        cylinder("y", [0, lo, z], hi - lo, 0.9 * r, segments=18),
                    ]
                )
                - full
            ),
            face,
        )
    fire = rng.random() < 0.4
    room = float(rng.uniform(0.8, 1.1)) * radius
    low_z = center - 0.85 * radius
    y = sorted((side * half, side * (half + 2 * room)))
    if fire:
        crate = box([-room, y[0], low_z - room * 0.4], [room, y[1], center - 0.1 * radius])
        crate -= box(
            [-room + wall, y[0] + wall, low_z - room * 0.4 + wall], [room - wall, y[1] - wall, 9]
        )
        body.add(tidy(crate - full), face)
    root = asm.add("barrel", body)
    lid = Shape().add((shell - box([-1, -2, 0], [1, 2, center + air])), face)
    phi = float(rng.uniform(0.2, 0.6))
    x, z = -0.93 * radius * np.cos(phi), center + 0.93 * radius * np.sin(phi)
    out = (-0.07 * radius - 5 * unit * np.cos(phi), 5 * unit * np.sin(phi))
    grip = _bow(float(rng.uniform(0.2, 0.6)) * half, x, z, out, 1.4 * unit)
    lid.add(tidy(grip - full), board if rng.random() < 0.4 else steel)
    swing = float(np.deg2rad(rng.uniform(55, 90)))
    asm.add("lid", lid, root, hinge((radius, 0, center + air), (0, 1, 0), swing))
    if chimney:
        disc = cylinder(
            "z",
            [0, chimney_y, top + air],
            1.8 * unit,
            1.25 * r,
            segments=20,
        )
        asm.add(
            "cap",
            Shape().add(disc, dark),
            root,
            hinge((1.25 * r, chimney_y, top + air), (0, 1, 0), 1.3),
        )
    if fire:
        z = center - 0.1 * radius + air
        plate = box(
            [-room, y[0] + (side > 0) * air, z], [room, y[1] - (side < 0) * air, z + 2 * unit]
        )
        knob = pipe(
            [
                [-0.8 * room, (y[0] + y[1]) / 2 - 4 * unit, z + 5 * unit],
                [-0.8 * room, (y[0] + y[1]) / 2 + 4 * unit, z + 5 * unit],
            ],
            1.2 * unit,
            10,
        )
        feet = [
            box(
                [-0.8 * room - 0.8 * unit, (y[0] + y[1]) / 2 + k - 0.8 * unit, z + unit],
                [-0.8 * room + 0.8 * unit, (y[0] + y[1]) / 2 + k + 0.8 * unit, z + 5 * unit],
            )
            for k in (-3 * unit, 3 * unit)
        ]
        shape = Shape().add(plate, face).add(tidy(union([knob, *feet]) - plate), steel)
        asm.add(
            "fire_lid", shape, root, hinge((room, 0, z), (0, 1, 0), float(rng.uniform(1.0, 1.5)))
        )
    elif rng.random() < 0.4:
        _shelf(
            rng, asm, root, side * half, side, 0, center - 2 * unit, 0.3, 1.5 * radius, unit, board
        )
    if rng.random() < 0.6:  # a shelf in front
        long, thick = float(rng.uniform(0.6, 1.1)) * radius, 2 * unit
        z = center - 2 * unit
        edge = -radius - air
        plate = box([edge - long, -0.9 * half, z - thick], [edge, 0.9 * half, z])
        down = -float(rng.uniform(1.2, 1.5))
        asm.add(
            "shelf", Shape().add(plate, board), root, hinge((edge, 0, z - thick), (0, 1, 0), down)
        )
    if rolling:
        for x in (-foot, foot):
            _wheel(asm, root, (x, side * (w + leg), wheel), wheel, 3 * unit, side, steel)
    return asm.object()


def _brazier(rng: np.random.Generator) -> ArticulatedObject:
    """An open pan on legs; its grate swings out on a post or slides up and down; a drawer for the
    ashes."""
    half = float(rng.uniform(0.16, 0.34))
    deep = half * float(rng.uniform(0.6, 1.0))
    tall = float(rng.uniform(0.12, 0.25)) if rng.random() < 0.4 else float(rng.uniform(0.45, 0.75))
    pan = float(rng.uniform(0.1, 0.18))
    top = tall + pan
    unit = max(2 * half, top + 0.25) / 100
    air, wall = 0.4 * unit, 1.5 * unit
    face, dark = _enamel(rng), materials.dark(rng)
    steel = materials.metal(rng, brushed=False)
    grip = materials.wood(rng, textured=False) if rng.random() < 0.5 else dark
    round_one = rng.random() < 0.45
    asm, body = Assembly(), Shape()
    drawer = not round_one and rng.random() < 0.6
    if round_one:
        deep = half
        solid = cylinder("z", [0, 0, tall], pan, 0.75 * half, half, 32)
        solid -= cylinder("z", [0, 0, tall + wall], pan, 0.75 * half - wall, half - wall, 32)
    else:
        solid = box([-deep, -half, tall], [deep, half, top]) - box(
            [-deep + wall, -half + wall, tall + 0.5 * pan], [deep - wall, half - wall, 9]
        )
    lo, hi = [-deep, -0.8 * half, tall + 0.08 * pan], [0.7 * deep, 0.8 * half, tall + 0.42 * pan]
    if drawer:
        solid -= box(np.subtract(lo, [1, air, air]), np.add(hi, air))
    body.add(tidy(solid), face)
    r = 1.5 * unit
    spots = [
        (0.7 * half * np.cos(a), 0.7 * half * np.sin(a)) for a in (np.pi, np.pi / 3, -np.pi / 3)
    ]
    if not round_one:
        spots = [(x * (deep - r), y * (half - r)) for x in (-1, 1) for y in (-1, 1)]
    spread = float(rng.uniform(1.0, 1.25))
    legs = [pipe([[x, y, tall + r], [spread * x, spread * y, r]], r, 10) for x, y in spots]
    whole = (
        cylinder("z", [0, 0, tall], pan, 0.75 * half, half, 32)
        if round_one
        else box([-deep, -half, tall], [deep, half, top])
    )
    if rng.random() < 0.5:
        legs.append(
            pipe([*([a, b, 0.4 * tall] for a, b in spots), [*spots[0], 0.4 * tall]], 0.7 * r, 8)
            if round_one
            else box([-deep, -half, 0.3 * tall], [deep, half, 0.3 * tall + unit])
        )
    swings = rng.random() < 0.6
    side = float(rng.choice([-1, 1]))
    post_at = [deep + 2.2 * unit, side * 0.6 * half] if not round_one else [half + 2.2 * unit, 0.0]
    high = top + float(rng.uniform(0.12, 0.3))
    post = cylinder(
        "z", [*post_at, tall + 0.5 * pan], high - tall - 0.5 * pan, 1.3 * unit, segments=14
    )
    foot = box(
        [0.5 * deep, post_at[1] - 1.6 * unit, tall + 0.5 * pan],
        [post_at[0] + 1.6 * unit, post_at[1] + 1.6 * unit, tall + 0.5 * pan + 3 * unit],
    )
    body.add(tidy(union([*legs, post, foot]) - whole), dark if rng.random() < 0.6 else steel)
    root = asm.add("pan", body)
    z = top + float(rng.uniform(1, 6)) * unit
    sleeve = tube("z", [*post_at, z], 5 * unit, 2.6 * unit, 1.3 * unit + air)
    size = 0.95 * deep if not round_one else 0.9 * half
    if round_one:
        plate = cylinder("z", [0, 0, z], 1.6 * unit, size, segments=30)
        inside = cylinder("z", [0, 0, 0], 9, 0.88 * size, segments=26)
    else:
        plate = box([-size, -0.92 * half, z], [size, 0.92 * half, z + 1.6 * unit])
        inside = box([-0.9 * size, -0.85 * half, 0], [0.9 * size, 0.85 * half, 9])
    pitch = 2 * half / 9
    bars = [
        box([-1, -half + (k + 0.2) * pitch, 0], [1, -half + (k + 0.75) * pitch, 9]) ^ inside
        for k in range(9)
    ]
    arm = box(
        [0.8 * size, post_at[1] - 1.3 * unit, z],
        [post_at[0] - 1.8 * unit, post_at[1] + 1.3 * unit, z + 2.4 * unit],
    )
    hook = pipe(
        [[-0.97 * size, 0, z + 0.8 * unit], [-1.35 * size, 0, z + 3 * unit]], 1.2 * unit, 10
    )
    whole_plate = union([cut(plate, bars), sleeve, arm])
    shape = Shape().add(tidy(whole_plate), steel).add(tidy(hook - whole_plate), grip)
    if swings:
        joint = hinge((*post_at, 0), (0, 0, -side), float(np.deg2rad(rng.uniform(70, 140))))
    else:
        joint = slide((0, 0, 1), 0.85 * (high - z - 5 * unit))
    asm.add("grate", shape, root, joint)
    if drawer:
        shell = box(lo, hi) - box(np.add(lo, [wall, wall, wall]), np.add(hi, [-wall, -wall, 1]))
        bow = _bow(0.3 * half, lo[0] + 0.5 * wall, (lo[2] + hi[2]) / 2, (-4 * unit, 0), 1.1 * unit)
        joint = slide((-1, 0, 0), float(rng.uniform(0.5, 0.9)) * (hi[0] - lo[0]))
        shape = Shape().add(shell, face.darker(0.8)).add(tidy(bow - box(lo, hi)), grip)
        asm.add("ash_drawer", shape, root, joint)
    return asm.object()

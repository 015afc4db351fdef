"""Espresso machines with portafilters, steam wands and levers; bean-to-cup machines."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.coffee_fittings import (
    add_buttons,
    add_drip_tray,
    add_knobs,
    add_lid,
    button_wells,
    draw_finish,
    draw_trim,
)
from uniart_jax.procedural.fronts import add_knob
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    ball,
    box,
    cut,
    cylinder,
    extrusion,
    hinge,
    pipe,
    rotated,
    rounded,
    slide,
    tidy,
    union,
)


def espresso_machine(rng: np.random.Generator) -> ArticulatedObject:
    """An espresso machine in metres: one or two groups under a head, portafilters that turn, a drip
    tray, steam wands, knobs and at times levers."""
    groups = int(rng.choice([1, 2], p=[0.75, 0.25]))
    high = float(rng.uniform(0.3, 0.42))
    half = float(rng.uniform(0.1, 0.16)) + (groups - 1) * float(rng.uniform(0.08, 0.14))
    depth = float(rng.uniform(0.24, 0.4))
    unit = max(high, 2 * half, depth) / 100
    air = 0.35 * unit
    face = draw_finish(rng)
    trim, steel = draw_trim(rng, face), materials.metal(rng, brushed=False)
    base, head = float(rng.uniform(0.1, 0.18)) * high, float(rng.uniform(0.6, 0.72)) * high
    back = float(rng.uniform(0.42, 0.55)) * depth
    brow = float(rng.uniform(0.02, 0.3)) * back  # where the head's front is
    if rng.random() < 0.6:
        brow = 0.02 * back
    asm, body = Assembly(), Shape()
    corner = float(rng.uniform(0, 0.12)) * depth
    solid = box([0, -half, 0], [depth, half, high])
    if rng.random() < 0.4:
        outline = rounded(high, depth, corner)
        solid = extrusion(outline, "y", [depth / 2, -half, high / 2], 2 * half)
    if rng.random() < 0.6:
        solid -= box([-1, -1, -1], [brow, 1, 2]) ^ box([-1, -1, base], [1, 1, 2])
    else:
        brow = 0.0
    solid -= box([-1, -1, base], [back, 1, head])
    face_x = brow
    tray_lo = np.array([0.0, -0.88 * half, 0.25 * base])
    tray_hi = np.array([0.92 * back, 0.88 * half, base - 0.5 * unit])
    solid -= box(tray_lo - [1, air, air], [tray_hi[0] + air, tray_hi[1] + air, 1]) ^ box(
        [-1, -1, 0], [1, 1, base + 1e-3]
    )
    middle = (head + high) / 2 + 0.5 * unit
    panel_room = (high - head) / 2 - max(corner, 0) * 0.5
    gx = face_x + (back - face_x) * float(rng.uniform(0.4, 0.55))
    r = min(float(rng.uniform(0.026, 0.034)), 0.8 * (back - gx))
    drop = float(rng.uniform(2.5, 6)) * unit
    gys = [0.0] if groups == 1 else [-0.45 * half, 0.45 * half]
    if groups == 1 and rng.random() < 0.4:
        gys = [float(rng.uniform(-0.3, 0.3)) * half]
    lever = rng.random() < 0.3
    body.add(tidy(solid), face)
    rings = [cylinder("z", [gx, y, head - drop], drop, r, segments=24) for y in gys]
    pivots = []
    if lever:  # a cylinder with two cheeks, in front of the head
        for y in gys:
            top = high + float(rng.uniform(0, 8)) * unit if groups == 1 else high + 3 * unit
            front = min(face_x, 0) - 0.9 * r
            tower = cylinder(
                "z", [front, y, middle - 1.0 * r], top - middle + r, 0.8 * r, segments=20
            )
            arm = box(
                [front, y - 0.4 * r, middle - 0.9 * r], [face_x, y + 0.4 * r, middle + 0.4 * r]
            )
            rings.append(cut(tower + arm, [solid]))
            pivots.append((front, y, top))
    body.add(tidy(union(rings)), steel)
    if corner < 2 * unit:
        _add_cheeks_and_rail(rng, body, depth, half, high, back, unit, steel, trim)
    root = asm.add("body", body)
    if rng.random() < 0.85:
        add_drip_tray(rng, asm, root, tray_lo, tray_hi, unit, steel if rng.random() < 0.5 else trim)
    handles: list[tuple[int, Manifold]] = []
    for y in gys:
        cup = cylinder("z", [gx, y, head - drop - air - 5 * unit], 5 * unit, 0.85 * r, 1.06 * r, 24)
        spout = cylinder(
            "z", [gx, y, head - drop - air - 8.5 * unit], 4 * unit, 0.35 * r, 0.5 * r, 14
        )
        long = gx + float(rng.uniform(0.06, 0.12))
        z = head - drop - air - 2.5 * unit
        grip = cylinder("x", [gx - 0.9 * r - long, y, z], long, 2.3 * unit, 1.5 * unit, 14)
        bowl = union([cup, spout])
        shape = Shape().add(bowl, steel).add(tidy(grip - bowl), trim)
        swing = -float(np.deg2rad(rng.uniform(35, 75)))
        index = asm.add("filter_handle", shape, root, hinge((gx, y, 0), (0, 0, 1), swing))
        handles.append((index, grip))
    if len(handles) == 2:
        _limit_turn(asm, *handles[0], handles[1][1])
    for x, y, z in pivots:
        tip = [x - 3 * unit, y, z + float(rng.uniform(20, 38)) * unit]
        bar = pipe([[x, y, z + 1.6 * unit + air], [x, y, z + 6 * unit], tip], 1.4 * unit, 10)
        knob = pipe([tip, np.add(tip, [-0.6 * unit, 0, 7 * unit])], 2.2 * unit, 12)
        shape = Shape().add(tidy(bar - knob), steel).add(knob, trim)
        down = -float(np.deg2rad(rng.uniform(60, 85)))
        asm.add("lever", shape, root, hinge((x, y, z + 1.6 * unit + air), (0, 1, 0), down))
    sides = [-1.0, 1.0] if groups == 2 or rng.random() < 0.15 else [float(rng.choice([-1, 1]))]
    for side in sides if rng.random() < 0.75 else []:
        x = 0.5 * gx + 0.5 * face_x
        wand = _add_steam_wand(rng, asm, root, side, half, x, head, base, unit, steel)
        for index, grip in handles:
            _limit_turn(asm, index, grip, wand)
    if not lever and rng.random() < 0.85:
        add_knobs(rng, asm, root, face_x - 5e-4, half, middle, panel_room, unit, trim)
    if rng.random() < 0.45:
        inset = 0.06 * depth + corner
        lo, hi = [0.55 * depth, -0.85 * half], [depth - inset, 0.85 * half]
        add_lid(rng, asm, root, lo, hi, high, unit, trim)
    elif rng.random() < 0.5 and corner < 3 * unit:  # a tank behind, lifted out
        water = materials.glass(rng)
        t = float(rng.uniform(0.06, 0.1))
        tank = extrusion(
            rounded(t, 1.5 * half, 0.3 * t), "z", [depth + t / 2 + air, 0, 0], 0.97 * high
        )
        bar = box(
            [depth + 0.3 * t, -0.3 * half, 0.97 * high],
            [depth + 0.7 * t, 0.3 * half, high + 4 * unit],
        )
        shape = Shape().add(tank, water).add(bar, trim)
        asm.add("tank", shape, root, slide((0, 0, 1), float(rng.uniform(0.3, 0.8)) * high))
    return asm.object()


def _add_cheeks_and_rail(rng, body: Shape, depth, half, high, back, unit, steel, trim) -> None:
    """Add cheeks at the sides and a cup rail on some."""
    if rng.random() < 0.5:
        t = float(rng.uniform(1, 3)) * unit
        cheek = trim if rng.random() < 0.5 else draw_finish(rng)
        for y in (-half - t, half):
            low, top = (back, back) if rng.random() < 0.5 else (1.05 * back, 1.4 * back)
            outline = np.array([[0, low], [0, depth], [high, depth], [high, top]])
            body.add(extrusion(outline, "y", [0, y, 0], t), cheek)
    if rng.random() < 0.4:
        x, y, z, r = 0.2 * depth, 0.9 * half, high + 4 * unit, 0.8 * unit
        ring = [[0.95 * depth, y, z], [x, y, z], [x, -y, z], [0.95 * depth, -y, z]]
        posts = [pipe([p, [*p[:2], high]], r, 8) for p in ring]
        body.add(tidy(union([pipe(ring, r, 8), *posts]) - box([-1, -1, 0], [1, 1, high])), steel)


def _add_steam_wand(rng, asm, root, side, half, x, head, base, unit, steel: Material):
    """Add a steam wand that hangs from a ball under the head and swings out to its side; returns
    its solid."""
    y, r = side * 0.86 * half, 1.5 * unit
    top = [x, y, head - 2.6 * unit]
    low = base + (head - base) * float(rng.uniform(0.1, 0.35))
    line = [
        top,
        [x - 3 * unit, y + side * 2 * unit, top[2] - 5 * unit],
        [x - 6 * unit, y + side * 3 * unit, low],
    ]
    solid = union([pipe(line, r, 10), ball(top, 2.4 * unit, 14)])
    swing = side * float(np.deg2rad(rng.uniform(50, 100)))
    asm.add("steam_wand", Shape().add(solid, steel), root, hinge(top, (0, 0, -1), -swing))
    return solid


def _limit_turn(asm: Assembly, index: int, grip: Manifold, other: Manifold) -> None:
    """Let the part ``index``, whose ``grip`` turns clockwise about z, stop short of ``other``."""
    part = asm.parts[index]
    angles = np.linspace(0, part.joint.limits[0], 13)
    for before, angle in itertools.pairwise(angles):
        turned = rotated(grip, (0, 0, np.rad2deg(angle)), part.joint.origin)
        if (turned ^ other).volume() > 0:
            joint = dataclasses.replace(part.joint, angle=(float(before), 0.0))
            asm.parts[index] = dataclasses.replace(part, joint=joint)
            return


def bean_to_cup_machine(rng: np.random.Generator) -> ArticulatedObject:
    """A bean-to-cup machine in metres: a spout that slides up and down, a drip tray, a tank that is
    drawn out, a lid over the beans, and buttons."""
    high, half = float(rng.uniform(0.3, 0.4)), float(rng.uniform(0.11, 0.15))
    depth = float(rng.uniform(0.3, 0.44))
    unit = max(high, depth) / 100
    air = 0.35 * unit
    face = draw_finish(rng)
    trim = draw_trim(rng, face)
    base, head = float(rng.uniform(0.1, 0.16)) * high, float(rng.uniform(0.6, 0.72)) * high
    back = float(rng.uniform(0.3, 0.42)) * depth
    side = float(rng.choice([-1, 1]))
    tank = rng.random() < 0.6
    inner = half - (float(rng.uniform(0.3, 0.5)) * half if tank else 0.12 * half)
    span = sorted((side * inner, -side * 0.88 * half))  # of the recess
    asm, body = Assembly(), Shape()
    solid = box([0, -half, 0], [depth, half, high])
    if rng.random() < 0.5:
        outline = rounded(2 * half, high, float(rng.uniform(0.02, 0.25)) * half, 6)
        solid = extrusion(outline, "x", [0, 0, high / 2], depth)
    solid -= box([-1, span[0], base], [back, span[1], head])
    tray_lo = np.array([0, span[0] + air, 0.25 * base])
    tray_hi = np.array([back - air, span[1] - air, base - air])
    solid -= box(tray_lo - [1, air, air], [back, span[1], base + 1e-3])
    lo, hi = (
        [0, side * (inner + 2 * unit), 0.12 * high],
        [0.7 * depth, side * half * 0.94, 0.9 * high],
    )
    lo[1], hi[1] = sorted((lo[1], hi[1]))
    if tank:
        solid -= box(np.subtract(lo, [1, air, air]), np.add(hi, air))
    r, count = 2.2 * unit, int(rng.integers(0, 4))
    middle, center = (head + high) / 2, (span[0] + span[1]) / 2
    dial = rng.random() < 0.5
    far = span[1] - span[0]
    ys = [center + (k / max(count, 1) - 0.42) * far * 0.95 for k in range(count)]
    ys = ys if high - head > 8 * unit and not dial else []
    body.add(tidy(cut(solid, button_wells(0, ys, middle, r))), face)
    root = asm.add("body", body)
    add_drip_tray(rng, asm, root, tray_lo, tray_hi, unit, trim)
    add_buttons(rng, asm, root, 0, ys, middle, r, trim)
    if dial:
        r = min(0.36 * (high - head), 7 * unit)
        add_knob(
            asm, root, (-5e-4, center, middle), r, 0.7 * r, trim, face.darker(0.6), pointer=True
        )
    low = head - float(rng.uniform(0.25, 0.45)) * (head - base)
    w = float(rng.uniform(0.18, 0.3)) * far
    spout = box([0.1 * back, center - w, low], [back - air, center + w, head - air])
    nozzles = [
        cylinder("z", [0.4 * back, center + s * 0.5 * w, low - 3 * unit], 3.2 * unit, 1.6 * unit)
        for s in (-1, 1)
    ]
    drop = float(rng.uniform(0.4, 0.8)) * (low - 3 * unit - base)
    asm.add(
        "spout", Shape().add(tidy(union([spout, *nozzles])), trim), root, slide((0, 0, -1), drop)
    )
    if tank:
        water = materials.glass(rng) if rng.random() < 0.7 else trim
        grip = box(
            [-2.5 * unit, lo[1] + 1.5 * unit, hi[2] - 8 * unit],
            [0, hi[1] - 1.5 * unit, hi[2] - 4 * unit],
        )
        shape = Shape().add(box(lo, hi), water).add(grip, trim)
        asm.add("tank", shape, root, slide((-1, 0, 0), float(rng.uniform(0.4, 0.9)) * hi[0]))
    if rng.random() < 0.8:
        start = float(rng.uniform(0.3, 0.6)) * depth
        y = 0.8 * half
        add_lid(rng, asm, root, [start, -y], [0.96 * depth, y], high, unit, trim)
    return asm.object()

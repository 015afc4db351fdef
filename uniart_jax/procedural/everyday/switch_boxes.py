"""Electric boxes on a wall, in metres: breaker boxes with a door and levers, isolators with a big
handle."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.switch_controls import draw_finish, push_button, rounded_block
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.pieces import shape_of
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    hinge,
    hull,
    pipe,
    tidy,
    union,
)

Y_AXIS, Z_AXIS = (0, 1, 0), (0, 0, 1)


def breaker_box(rng: np.random.Generator) -> ArticulatedObject:
    """A breaker box in metres: one or two rows of levers that flick up, behind a door or open."""
    rows = int(rng.choice([1, 2], p=[0.7, 0.3]))
    width = float(rng.uniform(0.16, 0.4))
    row_h = float(rng.uniform(0.11, 0.17))
    height, deep = rows * row_h + 0.05, float(rng.uniform(0.06, 0.1))
    unit = max(width, height) / 100
    wall = 1.6 * unit + 0.002
    face = draw_finish(rng) if rng.random() < 0.5 else materials.white_plastic(rng)
    inner = materials.white_plastic(rng) if rng.random() < 0.6 else face.darker(0.8)
    door = rng.random() < 0.75
    case = rounded_block(width, height, float(rng.uniform(0.5, 4)) * unit, -deep, 0, 0, 0)
    plane = -0.45 * deep  # of the breakers' fronts
    well = box(
        [-1, wall - width / 2, wall - height / 2], [plane, width / 2 - wall, height / 2 - wall]
    )
    asm, body = Assembly(), Shape()
    body.add(tidy(case - well), face)
    count = int(rng.integers(2, 6)) if rows == 1 else int(rng.integers(1, 4))
    room = width - 2 * wall - 2 * unit
    pitch = min(room / count, 12 * unit if rng.random() < 0.5 else 18 * unit)
    tone = materials.dark(rng) if rng.random() < 0.6 else plain(rng.uniform(0.1, 0.8, 3))
    block = float(rng.uniform(0.1, 0.2)) * deep
    levers = []
    for row in range(rows):
        z = (row - (rows - 1) / 2) * row_h
        half = 0.4 * row_h
        shift = float(rng.uniform(-0.5, 0.5)) * (room - count * pitch)
        for k in range(count):
            y = shift + (k - (count - 1) / 2) * pitch
            w = 0.47 * pitch
            back = plane - block
            solid = box([back, y - w, z - half], [plane + 1e-4, y + w, z + half])
            lw, lh = min(0.6 * w, 2.6 * unit), max(0.1 * half, 1.3 * unit)
            pivot = np.array([back + 0.2 * block, y, z])
            reach = 0.28 * deep
            tilt = float(np.deg2rad(rng.uniform(22, 35)))
            bar = box([-reach, -lw, -lh / 2], [0, lw, lh / 2])
            bar = bar.rotate((0, -float(np.rad2deg(tilt)), 0)).translate(tuple(pivot))
            swept = lh / 2 + 0.3 * unit + 0.3 * block * np.tan(tilt) + 0.6 * lh
            slot = box(
                [-1, y - lw - 0.3 * unit, z - swept],
                [back + 0.9 * block, y + lw + 0.3 * unit, z + swept],
            )
            body.add(solid - slot, inner)
            levers.append((bar, hinge(pivot, Y_AXIS, 2 * tilt)))
    root = asm.add("case", body)
    for bar, joint in levers:
        asm.add("lever", Shape().add(bar, tone), root, joint)
    if door:
        _door(rng, asm, root, width, height, deep, unit, face)
    return asm.object()


def _door(rng, asm: Assembly, root: int, width, height, deep, unit, face: Material) -> None:
    """Add a flap or a side door over a case's front, clear or opaque."""
    air, thick = 0.4 * unit, float(rng.uniform(1.5, 3.0)) * unit
    edge = str(rng.choice(["left", "right", "top"], p=[0.4, 0.3, 0.3]))
    less = 0.0 if rng.random() < 0.6 else 1.2 * unit  # a frame about it
    w, h = width - less, height - less
    look = materials.glass(rng) if rng.random() < 0.35 else face
    look = draw_finish(rng) if rng.random() < 0.2 else look
    x1 = -deep - air
    leaf = rounded_block(w, h, 2 * unit, x1 - thick, x1, 0, 0)
    shape = Shape().add(leaf, look)
    x = x1 - thick
    free = {"left": (0.42 * w, 0), "right": (-0.42 * w, 0), "top": (0, -0.42 * h)}[edge]
    pull = (1.2 * unit, 5 * unit) if edge != "top" else (5 * unit, 1.2 * unit)
    grip = box(
        [x - 2 * unit, free[0] - pull[0], free[1] - pull[1]],
        [x, free[0] + pull[0], free[1] + pull[1]],
    )
    shape.add(grip, materials.hardware(rng))
    swing = float(np.deg2rad(rng.uniform(85, 150)))
    at = {"left": (x, -w / 2, 0), "right": (x, w / 2, 0), "top": (x, 0, h / 2)}[edge]
    axis = {"left": Z_AXIS, "right": (0, 0, -1), "top": Y_AXIS}[edge]
    asm.add("door", shape, root, hinge(at, axis, swing))


def isolator(rng: np.random.Generator) -> ArticulatedObject:
    """An isolator in metres: a box with a handle on its side, a turning handle in front, or push
    buttons."""
    width, height = float(rng.uniform(0.08, 0.22)), float(rng.uniform(0.1, 0.32))
    deep = float(rng.uniform(0.4, 0.8)) * min(width, height)
    unit = max(width, height, deep) / 100
    face = draw_finish(rng)
    strong = [(0.8, 0.08, 0.06), (0.9, 0.75, 0.1), (0.1, 0.5, 0.2), (0.1, 0.1, 0.1)]
    tone = plain(strong[rng.integers(4)])
    yellow = (
        plain((0.92, 0.76, 0.12)) if rng.random() < 0.5 else materials.metal(rng, brushed=False)
    )
    case = rounded_block(width, height, float(rng.uniform(0.5, 6)) * unit, -deep, 0, 0, 0)
    asm, body, parts = Assembly(), Shape(), []
    kind = str(rng.choice(["side", "front", "buttons"], p=[0.4, 0.35, 0.25]))
    if kind == "buttons":
        count = int(rng.choice([1, 2, 3], p=[0.25, 0.5, 0.25]))
        pitch = height / count
        size = min(width, pitch) * 0.9
        tones = [plain((0.1, 0.5, 0.2)), plain((0.8, 0.08, 0.06)), materials.dark(rng)]
        holes, fixed = [], []
        for k in range(count):
            at = np.array([-deep, 0, ((count - 1) / 2 - k) * pitch])
            cuts, rings, made = push_button(rng, at, size, size, 0.8 * deep, tones[k], yellow)
            holes, fixed, parts = holes + cuts, fixed + rings, parts + made
        case = tidy(cut(case, holes))
        body.add(union([one for one, _ in fixed]), yellow)
    elif kind == "front":
        r = min(width, height) * float(rng.uniform(0.22, 0.4))
        z = float(rng.uniform(-0.1, 0.15)) * height
        disc = cylinder("x", [-deep - unit, 0, z], unit, 1.2 * r, segments=28)
        body.add(disc, yellow)
        x, long = -deep - 1.4 * unit, r * float(rng.uniform(0.9, 1.3))
        hub = cylinder("x", [x - 0.4 * r, 0, z], 0.4 * r, 0.75 * r, segments=22)
        w = 0.22 * r
        bar = hull(np.array([[x - a, y, z + b] for a, s in ((0.3 * r, 1.0), (0.9 * r, 0.7))
                             for y in (-w * s, w * s) for b in (-0.5 * r, long)]))  # fmt: skip
        sweep = float(np.deg2rad(rng.choice([90, 90, 60, 180])))
        parts.append(
            (
                "handle",
                [(tidy(hub + bar), tone)],
                hinge((x, 0, z), (rng.choice([-1, 1]), 0, 0), sweep),
            )
        )
    else:
        side = int(rng.choice([-1, 1]))
        z, r = float(rng.uniform(-0.15, 0.15)) * height, 0.24 * min(deep, height)
        y = side * (width / 2 + 0.4 * unit)
        long = height * float(rng.uniform(0.35, 0.6))
        t = max(2.2 * unit, 0.25 * r)
        x = -deep * float(rng.uniform(0.4, 0.6))
        lean = float(np.deg2rad(rng.uniform(15, 35)))
        lo, hi = sorted((y, y + side * 2 * t))
        tip = np.array([x - long * np.cos(lean), 0, z - long * np.sin(lean)])
        hub = cylinder("y", [x, lo, z], hi - lo, r, segments=20)
        end = cylinder("y", [tip[0], lo, tip[2]], hi - lo, 0.4 * r, segments=14)
        root_end = cylinder("y", [x, lo, z], hi - lo, 0.55 * r, segments=14)
        arm = Manifold.batch_hull([root_end, end])
        reach = y + side * float(rng.uniform(2.5, 5)) * t
        knob = pipe([[tip[0], y + side * t, tip[2]], [tip[0], reach, tip[2]]], 0.42 * r, 12)
        knob = cut(
            knob,
            [box([-2, min(-9.0, 0), -2], [2, lo, 2]) if side > 0 else box([-2, hi, -2], [2, 9, 2])],
        )
        handle = [(tidy(union([hub, arm])), materials.hardware(rng)), (tidy(knob - arm), tone)]
        parts.append(("handle", handle, hinge((x, 0, z), Y_AXIS, 2 * lean)))
    body.add(case, face)
    if kind == "side":  # a lid's frame and a sign
        w, h = 0.9 * width, 0.9 * height
        lid = rounded_block(w, h, 2 * unit, -deep - 0.8 * unit, -deep, 0, 0)
        sign = rounded_block(
            0.5 * w, 0.25 * h, unit, -deep - 1.2 * unit, -deep - 0.8 * unit, 0, 0.2 * h
        )
        body.add(lid, draw_finish(rng) if rng.random() < 0.4 else face.darker(0.93))
        body.add(sign, yellow)
    if rng.random() < 0.6:  # cable glands
        for y in (-0.25 * width, 0.25 * width) if rng.random() < 0.5 else (0.0,):
            gland = cylinder(
                "z",
                [-0.5 * deep, y, -height / 2 - 0.12 * width],
                0.12 * width,
                0.12 * width,
                segments=6,
            )
            body.add(gland, materials.dark(rng))
    root = asm.add("case", body)
    for name, pieces, joint in parts:
        asm.add(name, shape_of(pieces), root, joint)
    return asm.object()

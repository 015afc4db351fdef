"""Washing machines and dryers with consoles: loaded from the front through a round door, or from
above under a lid whose axis is at the rear or at a side."""

from __future__ import annotations

import dataclasses

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import appliance_fronts, appliances, controls, finishes, materials
from uniart_jax.procedural import real_finishes as finish
from uniart_jax.procedural.fronts import FrontStyle, add_drawer
from uniart_jax.procedural.hinges import opening
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    hinge,
    revolution,
    union,
)


def build_washer(rng: np.random.Generator) -> ArticulatedObject:
    """A washing machine, metres, closed."""
    return _front_loader(rng) if rng.random() < 0.58 else _top_loader(rng)


def _front_loader(rng: np.random.Generator) -> ArticulatedObject:
    width, height = float(rng.uniform(0.5, 0.75)), float(rng.uniform(0.68, 1.02))
    depth = float(rng.uniform(0.4, 0.85 if rng.random() < 0.8 else 1.05))
    unit = max(width, height, depth) / 100
    face = appliance_fronts.outside(rng)
    look = appliance_fronts.appliance_style(rng, unit, face, max(0.015, 1.6 * unit))
    half, legs = width / 2, float(rng.choice([0.0, rng.uniform(0.01, 0.09)]))
    band = height * float(rng.uniform(0.1, 0.2))
    foot = height - band
    radius = min(float(rng.uniform(0.28, 0.43)) * width, 0.47 * (foot - legs) - 0.02)
    rest = foot - legs - 2 * radius
    at = np.array([0.0, 0.0, legs + radius + rest * float(rng.uniform(0.35, 0.85))])
    mouth = radius * float(rng.uniform(0.6, 0.8))
    proud = max(0.006, float(rng.uniform(0.9, 2.4)) * unit)
    drawer = bool(rng.random() < 0.5)
    asm, body = Assembly(), Shape()
    if legs:
        appliances.feet(body, rng, width, depth, legs, unit)
    drum = min(1.15 * mouth, radius)
    tub = cylinder("x", [0.02, *at[1:]], 0.7 * depth, drum, segments=28)
    holes = [cylinder("x", [-1, *at[1:]], 1.03, mouth, segments=28), tub]
    side = float(rng.choice([-1, 1], p=[0.3, 0.7]))
    wide = width * float(rng.uniform(0.2, 0.36))
    span = [-half, half]
    bay, y = None, (0.0, 0.0)
    if drawer:
        y = (half - 0.01 - wide, half - 0.01) if side > 0 else (0.01 - half, 0.01 + wide - half)
        low, high = foot + 0.012, height - 0.02
        bay = (
            np.array([0.0, y[0] + 0.01, low + 0.008]),
            np.array([0.55 * depth, y[1] - 0.01, high]),
        )
        holes.append(box([-1, *bay[0][1:]], bay[1]))
        span = [-half, y[0] - 0.003] if side > 0 else [y[1] + 0.003, half]
    body.add(cut(box([0, -half, legs], [depth, half, height]), holes), face)
    if rng.random() < 0.5:
        glow = finishes.metal(rng, brushed=False)
        rear = [0.7 * depth, *at[1:]]  # the last two centimetres of the tub
        body.add(cylinder("x", rear, 0.02, drum, segments=28), glow)
    panel = face if rng.random() < 0.55 else appliance_fronts.case_of(rng, face)
    board_z = (foot + 0.004, height - 0.002)
    board = box([-proud, span[0], board_z[0]], [0, span[1], board_z[1]])
    middle, z = (span[0] + span[1]) / 2, (board_z[0] + board_z[1]) / 2
    reach = (span[1] - span[0]) / 2
    radius_dial = min(float(rng.uniform(1.5, 5.0)) * unit, 0.38 * band)
    count = int(rng.choice([0, 1, 2], p=[0.12, 0.78, 0.1]))
    dial = controls.dial_style(
        rng, radius_dial, max(0.008, float(rng.uniform(1.0, 4.0)) * unit), face, endless=0.8
    )
    ys, screen = controls.uneven_row(rng, count, reach - 1.3 * radius_dial, 3 * radius_dial)
    buttons, stand = [], max(0.003, float(rng.uniform(0.4, 1.4)) * unit)
    ink = finishes.white_plastic(rng) if panel.color[1] < 0.45 else finishes.dark(rng)
    if screen is not None:
        a, b = middle + screen[0], middle + screen[1]
        kind = str(rng.choice(["push", "keys", "screen", "bare"], p=[0.18, 0.36, 0.28, 0.18]))
        room = (a, b), (z - 0.22 * band, z + 0.22 * band)
        columns = int(np.clip(rng.integers(2, 7), 1, max(1, (b - a) / (2.4 * unit))))
        if kind in ("push", "keys"):
            grid = controls.button_grid(*room, columns, int(rng.integers(1, 3)), rng)
            if kind == "push":
                buttons = [k for k in grid if max(k.width, k.height) > 1.7 * unit][:9]
            else:
                controls.print_buttons(body, -proud, grid, 0.001, ink)
        elif kind == "screen":
            glass = materials.dark_glass(rng) if rng.random() < 0.6 else finish.tinted_glass(rng)
            appliances.display(body, -proud, *room, 0.001, glass)
    travel = controls.push_depth(rng, unit, proud)
    body.add(cut(board, controls.pockets(-proud, buttons, travel)), panel)
    if rng.random() < 0.4 and at[2] - radius - legs > 0.09:  # a filter's cover that stays shut
        a = -side * 0.85 * half
        ys2 = sorted((a, a + side * 0.3 * half))
        cover = [-0.004, ys2[0], legs + 0.02], [0, ys2[1], legs + 0.075]
        body.add(box(*cover), face.darker(0.9))
    root = asm.add("body", body)
    _porthole(rng, asm, root, at, radius, unit, look)
    if bay is not None:
        lo = np.array([-max(0.012, proud), y[0], foot + 0.006])
        hi = np.array([-0.002, y[1], height - 0.012])
        style = str(rng.choice(["recess", "lip", "none"]))
        plain = dataclasses.replace(look, handle=style, panel="slab")
        add_drawer(
            asm, root, lo, hi, *bay, float(rng.uniform(0.55, 0.9)), plain, name="detergent_drawer"
        )
    controls.add_dials(asm, root, [(-proud, middle + v, z, 1.0) for v in ys], dial)
    controls.add_buttons(asm, root, -proud, buttons, stand, travel, ink)
    return asm.object()


def _porthole(
    rng, asm: Assembly, root: int, at, radius: float, unit: float, look: FrontStyle
) -> None:
    """A round or square door with a bulging glass, hinged at a side."""
    y, z = float(at[1]), float(at[2])
    thick = max(0.02, float(rng.uniform(2.0, 6.0)) * unit)
    left = bool(rng.random() < 0.6)
    sign = 1.0 if left else -1.0
    pick = rng.choice(4, p=[0.35, 0.25, 0.2, 0.2])
    ring = (
        finishes.metal(rng, brushed=False), finishes.dark(rng),
        look.face.darker(0.95), finishes.white_plastic(rng),
    )[pick]  # fmt: skip
    glass = finish.tinted_glass(rng) if rng.random() < 0.5 else materials.dark_glass(rng)
    inner = radius * float(rng.uniform(0.5, 0.85))
    shape = Shape()
    if rng.random() < 0.2:
        plate = box([-0.002 - thick, y - radius, z - radius], [-0.002, y + radius, z + radius])
    else:
        taper = float(rng.uniform(0.85, 1.0))
        plate = cylinder("x", [-0.002 - thick, y, z], thick, taper * radius, radius, segments=32)
        h = 0.2 * radius
        ys = sorted((y + sign * 0.85 * radius, y + sign * 1.01 * radius))
        block = [-0.002 - 0.9 * thick, ys[0], z - h], [-0.003, ys[1], z + h]
        plate = union([plate, box(*block)])
    shape.add(cut(plate, (cylinder("x", [-1, y, z], 2, inner, segments=28),)), ring)
    bulge = thick * float(rng.uniform(0.0, 0.6))
    dome = np.array(
        [[0, -0.1 * thick], [inner, -0.1 * thick], [inner, -0.8 * thick],
         [0.7 * inner, -0.85 * thick - 0.7 * bulge], [0, -0.85 * thick - bulge]]
    )  # fmt: skip
    shape.add(revolution(dome, "x", [-0.002, y, z], 28), glass)
    if rng.random() < 0.6:
        grip = radius * float(rng.uniform(0.12, 0.35))
        far = y - sign * 0.5 * (inner + radius)
        w = min(0.3 * (radius - inner), max(0.008, 1.2 * unit))
        bar = box(
            [-0.002 - thick - 1.6 * unit, far - w, z - grip], [-0.002 - thick, far + w, z + grip]
        )
        shape.add(bar, look.hardware)
    origin = [-0.002 - float(rng.choice([0.0, 0.5, 1.0])) * thick, y + sign * 1.01 * radius, z]
    angle = (
        opening(rng, 0.3) if origin[0] < -0.002 - 0.9 * thick else min(opening(rng, 0.0), np.pi / 2)
    )
    asm.add("door", shape, root, hinge(origin, (0, 0, -sign), angle))


def _top_loader(rng: np.random.Generator) -> ArticulatedObject:
    width, depth = float(rng.uniform(0.42, 0.75)), float(rng.uniform(0.48, 0.75))
    height = float(rng.uniform(0.78, 1.05))
    unit = max(width, height, depth) / 100
    face = appliance_fronts.outside(rng)
    look = appliance_fronts.appliance_style(rng, unit, face, 0.02)
    half, legs = width / 2, float(rng.choice([0.0, rng.uniform(0.01, 0.05)]))
    console = depth * float(rng.uniform(0.12, 0.26))
    rise = height * float(rng.uniform(0.05, 0.2))
    lean = float(rng.uniform(0.0, 0.7))
    lean = min(lean, float(np.arctan(0.75 * console / rise)))
    start = depth - console
    asm, body = Assembly(), Shape()
    if legs:
        appliances.feet(body, rng, width, depth, legs, unit)
    near = float(rng.uniform(0.0, 0.1)) * depth
    at_side = bool(rng.random() < 0.15)  # the lid turns about a side
    lid_half = half - float(rng.uniform(0.0, 0.12)) * width
    thick = max(0.012, float(rng.uniform(1.2, 3.0)) * unit)
    reach = max(0.007, float(rng.uniform(0.8, 3.0)) * unit)
    far = start - float(rng.uniform(0.004, 0.02)) - 1.2 * reach
    middle = (near + far) / 2
    radius = min(0.42 * (far - near), lid_half - 0.03)
    hole = cylinder("z", [middle, 0, 0.3 * height], height, radius, segments=28)
    body.add(cut(box([0, -half, legs], [depth, half, height]), (hole,)), face)
    if rng.random() < 0.5:  # a floor of steel
        tub = finishes.metal(rng, brushed=False)
        floor = cylinder("z", [middle, 0, 0.3 * height], 0.01, 0.99 * radius, segments=24)
        body.add(floor, tub)
    tone = finishes.dark(rng) if rng.random() < 0.4 else appliance_fronts.case_of(rng, face)
    top = height + rise
    back = start + rise * np.tan(lean)
    ends = np.array([[height, start], [top, back], [top, depth], [height, depth]])
    body.add(appliance_fronts.across(ends, -half, half), tone)
    dial_radius = min(float(rng.uniform(1.1, 4.0)) * unit, 0.42 * rise / np.cos(lean))
    dial = controls.dial_style(rng, dial_radius, reach, face, endless=0.85)
    count = int(rng.choice([0, 1, 2, 3, 4], p=[0.12, 0.3, 0.25, 0.23, 0.1]))
    ys, screen = controls.uneven_row(rng, count, 0.95 * half - dial_radius, 2.6 * dial_radius)
    at = (start + rise / 2 * np.tan(lean), height + rise / 2)
    shares = rng.choice([1.0, 0.65], len(ys)) if rng.random() < 0.4 else np.ones(len(ys))
    if screen is not None and lean < 0.02:
        glass = materials.dark_glass(rng) if rng.random() < 0.6 else finish.tinted_glass(rng)
        span = at[1] - 0.25 * rise, at[1] + 0.25 * rise
        appliances.display(body, start, screen, span, 0.001, glass)
    root = asm.add("body", body)
    lid, low = Shape(), height + 0.002
    lo, hi = np.array([near, -lid_half, low]), np.array([far, lid_half, low + thick])
    if rng.random() < 0.3:  # a window
        edge = 0.16 * (far - near)
        gap = box([lo[0] + edge, lo[1] + edge, low - 1], [hi[0] - edge, hi[1] - edge, low + 1])
        lid.add(cut(box(lo, hi), (gap,)), look.face)
        pane = [lo[0] + edge, lo[1] + edge, low], [hi[0] - edge, hi[1] - edge, hi[2] - 0.002]
        lid.add(box(*pane), appliance_fronts.pane(rng))
    else:
        lid.add(box(lo, hi), look.face.darker(float(rng.uniform(0.9, 1.0))))
    if rng.random() < 0.5:
        grip = lid_half * float(rng.uniform(0.15, 0.5))
        bar = box([near - 1.5 * unit, -grip, low], [near, grip, low + 0.7 * thick])
        lid.add(bar, look.hardware if rng.random() < 0.5 else look.face)
    angle = np.pi / 2 if rng.random() < 0.5 else float(np.deg2rad(rng.uniform(65, 100)))
    if at_side:
        sign = float(rng.choice([-1, 1]))
        asm.add("lid", lid, root, hinge([middle, sign * lid_half, hi[2]], (-sign, 0, 0), angle))
    else:
        angle = min(angle, np.pi / 2)
        asm.add("lid", lid, root, hinge([far, 0, hi[2]], (0, 1, 0), angle))
    places = [(at[0], v, at[1], float(s)) for v, s in zip(ys, shares, strict=True)]
    controls.add_dials(asm, root, places, dial, tilt=lean)
    return asm.object()

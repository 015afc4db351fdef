"""Safes: a thick door with a dial, a wheel or lever and a key pad, a drawer or shelf within; wall,
floor and gun safes."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable

import numpy as np

from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import appliances, materials
from uniart_jax.procedural.fronts import FrontStyle, add_door, add_drawer, add_knob
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    ball,
    box,
    cut,
    cylinder,
    hinge,
    pipe,
    tidy,
    tube,
    turn,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A safe, metres, closed."""
    tall = rng.random() < 0.25
    width = float(rng.uniform(0.3, 0.65))
    height = float(rng.uniform(0.9, 1.6) if tall else rng.uniform(0.55, 1.25) * width)
    depth = float(rng.uniform(0.25, 0.5) if tall else rng.uniform(0.6, 1.1) * width)
    unit = max(width, height, depth) / 100
    wall = float(rng.uniform(0.05, 0.12)) * width
    thick = max(float(rng.uniform(0.05, 0.12)) * width, 2.2 * unit)
    face = _paint(rng)
    door_face = face if rng.random() < 0.6 else _paint(rng)
    metal = materials.hardware(rng)
    legs = float(rng.uniform(1.5, 7)) * unit if rng.random() < 0.45 else 0.0
    half, top = width / 2, legs + height
    inset = rng.random() < 0.55
    thick = min(thick, 0.08 * width) if inset else thick
    double = width > 0.5 and rng.random() < 0.15

    asm, body = Assembly(), Shape()
    if legs:
        _feet(rng, body, width, depth, legs, unit, metal)
    room_lo = np.array([0.0, -half + wall, legs + wall])
    room_hi = np.array([depth - wall, half - wall, top - wall])
    if inset:  # the door closes flush, within the walls
        gap = 0.5 * unit + thick**2 / (room_hi - room_lo)[1:].min()
        lo = np.array([0.0, room_lo[1] + gap, room_lo[2] + gap])
        hi = np.array([thick, room_hi[1] - gap, room_hi[2] - gap])
    else:
        rim = float(rng.choice([0.0, rng.uniform(0.2, 0.6)])) * wall
        lo = np.array([-thick - 0.002, -half + rim, legs + rim])
        hi = np.array([-0.002, half - rim, top - rim])
    shelf = float(rng.uniform(0.35, 0.7)) * (room_hi[2] - room_lo[2]) + room_lo[2]
    plan = str(rng.choice(["empty", "shelf", "drawer"], p=[0.4, 0.4, 0.2]))
    back = max(hi[0], 0.0) + 0.12 * depth
    board = max(0.006, 1.2 * unit)
    rooms = [box([-1, *room_lo[1:]], room_hi)]
    solid = cut(box([0, -half, legs], [depth, half, top]), rooms)
    if plan != "empty":
        solid += box(
            [back, room_lo[1] - 0.001, shelf], [depth - wall / 2, room_hi[1] + 0.001, shelf + board]
        )
    body.add(solid, face)
    if rng.random() < 0.35:  # a plate with the maker's name
        y, z = float(rng.uniform(0.1, 0.25)) * width, float(rng.uniform(0.02, 0.04)) * height
        if not inset:
            body.add(
                box(
                    [depth, -y, top - 0.3 * height], [depth + 0.4 * unit, y, top - 0.3 * height + z]
                ),
                metal,
            )
    root = asm.add("body", body)

    look = FrontStyle(
        panel=str(rng.choice(["slab", "raised", "border"], p=[0.65, 0.25, 0.1])),
        handle="none",
        face=door_face,
        accent=door_face.darker(0.8),
        glass=materials.dark_glass(rng),
        hardware=metal,
        inside=face.darker(0.8),
        thickness=thick,
        unit=unit,
    )
    if plan == "drawer":
        low = max(room_lo[2], shelf - float(rng.uniform(0.3, 0.6)) * (shelf - room_lo[2]))
        _drawer(rng, asm, root, look, room_lo, room_hi, low, shelf, back, unit)
    swing = float(np.deg2rad(rng.uniform(85, 120) if inset else rng.uniform(90, 170)))
    if inset:
        swing = min(swing, float(np.deg2rad(105)))
    way = str(rng.choice(["+y", "-y"]))
    leaves = [(lo, hi, way)]
    if double:
        middle, seam = (lo[1] + hi[1]) / 2, 0.3 * unit
        leaves = [
            (np.array([lo[0], middle + seam, lo[2]]), hi, "+y"),
            (lo, np.array([hi[0], middle - seam, hi[2]]), "-y"),
        ]
    knuckles = rng.random() < 0.7
    for k, (a, b, edge) in enumerate(leaves):
        extra = Shape()
        if knuckles and not inset:
            _knuckles(rng, extra, a, b, edge, thick, unit, metal)
        _rear(rng, extra, a, b, edge, room_lo, room_hi, unit, metal, back)
        moving = _controls(rng, extra, a, b, edge, unit, door_face, metal) if k == 0 else []
        door = add_door(asm, root, a, b, edge, swing, look, extra=extra)
        for add in moving:
            add(asm, door)
    return asm.object()


def _paint(rng: np.random.Generator) -> Material:
    """Grey, black, green or bright enamel, or bare steel."""
    kind = rng.choice(4, p=[0.35, 0.25, 0.28, 0.12])
    if kind == 0:
        return materials.plain(np.ones(3) * rng.uniform(0.25, 0.8) * rng.uniform(0.95, 1.05, 3))
    if kind == 1:
        return materials.dark(rng)
    return materials.paint(rng) if kind == 2 else materials.metal(rng)


def _feet(rng, body: Shape, width, depth, legs, unit, metal) -> None:
    r = float(rng.uniform(1.8, 3.2)) * unit
    rubber = materials.dark(rng) if rng.random() < 0.6 else metal
    for x in (1.5 * r, depth - 1.5 * r):
        for y in (-width / 2 + 1.5 * r, width / 2 - 1.5 * r):
            body.add(cylinder("z", [x, y, 0], legs, r, 0.8 * r, segments=14), rubber)


def _drawer(rng, asm, root, look, room_lo, room_hi, low, shelf, back, unit) -> None:
    """A drawer that hangs below the shelf."""
    air = 0.4 * unit
    front = max(0.004, 1.1 * unit)
    lo = np.array([back, room_lo[1] + air, low + air])
    hi = np.array([back + front, room_hi[1] - air, shelf - air])
    if hi[2] - lo[2] < 5 * unit:
        lo[2] = max(room_lo[2] + air, hi[2] - 5 * unit)
    inner = dataclasses.replace(
        look, panel="slab", handle=str(rng.choice(["recess", "none"])), unit=0.7 * unit, handle_length=0.3  # noqa: E501
    )  # fmt: skip
    bay_lo, bay_hi = [back, *(lo[1:] - 0.2 * air)], [room_hi[0], *(hi[1:] + 0.2 * air)]
    add_drawer(
        asm, root, lo, hi, bay_lo, bay_hi, float(rng.uniform(0.4, 0.7)), inner, clearance=air
    )


def _knuckles(rng, extra: Shape, lo, hi, edge, thick, unit, metal) -> None:
    """Barrels about the hinge line at the door's outer edge."""
    way = 1 if edge == "+y" else -1
    y = hi[1] if way > 0 else lo[1]
    r, tall = min(0.9 * unit, 0.4 * thick), float(rng.uniform(0.06, 0.14)) * (hi[2] - lo[2])
    slab = box(lo, hi)
    for share in (0.12, 0.88) if rng.random() < 0.6 else (0.1, 0.5, 0.9):
        z = lo[2] + share * (hi[2] - lo[2])
        barrel = cylinder("z", [lo[0], y, z - tall / 2], tall, r, segments=14)
        extra.add(barrel - slab, metal)


def _rear(rng, extra, lo, hi, edge, room_lo, room_hi, unit, metal, back) -> None:
    """A plate with bolts on the door's inside, clear of the walls as the door turns."""
    deep = float(rng.uniform(1.0, 2.2)) * unit
    if rng.random() < 0.3 or hi[0] + deep > back - unit:
        return
    reach = hi[0] + deep - lo[0]
    wide = hi[1] - lo[1]
    near = reach + 0.8 * unit  # from the hinge side: what swings inwards there
    far = reach**2 / wide + 1.2 * unit
    a, b = np.array([hi[0], lo[1], lo[2]]), np.array([hi[0] + deep, hi[1], hi[2]])
    a[2] = max(lo[2], room_lo[2]) + 1.5 * unit
    b[2] = min(hi[2], room_hi[2]) - 1.5 * unit
    left, right = (far, near) if edge == "+y" else (near, far)
    a[1] = max(lo[1], room_lo[1]) + left
    b[1] = min(hi[1], room_hi[1]) - right
    if b[1] - a[1] < 6 * unit or b[2] - a[2] < 6 * unit:
        return
    extra.add(box(a, b), metal.darker(0.85) if rng.random() < 0.5 else metal)


def _controls(rng, extra: Shape, lo, hi, edge, unit, face: Material, metal) -> list[Callable]:
    """A dial or a key pad, and what draws the bolts: a lever, a wheel of spokes, a knob; or one of
    these alone.

    Adds what does not move to ``extra`` and returns what adds the moving parts, given the assembly
    and the door's index.
    """
    way = 1 if edge == "+y" else -1  # towards the hinge
    width, height = hi[1] - lo[1], hi[2] - lo[2]
    middle_y, x = (lo[1] + hi[1]) / 2, lo[0]
    small = min(width, height)
    stacked = rng.random() < 0.5 or width < 0.6 * height
    offset = float(rng.uniform(0.14, 0.2)) * (height if stacked else width)
    shift = -way * float(rng.uniform(0.0, 0.18)) * width
    middle_z = lo[2] + height * float(rng.uniform(0.42, 0.62))
    spots = [(middle_y + shift, middle_z + offset), (middle_y + shift, middle_z - offset)]
    if not stacked:
        spots = [(middle_y + offset, middle_z), (middle_y - offset, middle_z)]
        if rng.random() < 0.5:
            spots.reverse()
    code = str(rng.choice(["dial", "pad", "none"], p=[0.5, 0.38, 0.12]))
    bolt = str(rng.choice(["lever", "wheel", "knob", "none"], p=[0.42, 0.3, 0.16, 0.12]))
    if code == "none" or bolt == "none":
        spots = [(middle_y + shift, middle_z)] * 2
        if code == bolt:
            bolt = "lever"
    room = 0.8 * offset if code != "none" and bolt != "none" else 0.3 * small
    moving: list[Callable] = []
    y, z = spots[0]
    if code == "dial":
        radius = min(max(float(rng.uniform(0.08, 0.14)) * small, 2.6 * unit), room)
        reach = float(rng.uniform(0.35, 0.8)) * radius + 0.8 * unit
        plate = 0.6 * unit
        ring = cylinder("x", [x - plate, y, z], plate, 1.3 * radius, segments=22)
        extra.add(ring, metal if rng.random() < 0.5 else face.darker(0.7))
        light = rng.random() < 0.4
        finish = metal if light else materials.dark(rng)
        mark = materials.plain((0.92, 0.92, 0.9))
        knob = ((x - plate, y, z), radius, reach, finish, mark)
        moving.append(functools.partial(_knob, knob, name="dial", pointer=False))
    elif code == "pad":
        w, h = float(rng.uniform(0.09, 0.15)) * small, float(rng.uniform(0.1, 0.18)) * small
        w, h, proud = min(w, 0.8 * room), min(h, 0.9 * room), 0.7 * unit
        extra.add(box([x - proud, y - w, z - h], [x, y + w, z + h]), materials.dark(rng))
        tone = materials.plain(rng.uniform(0.5, 0.95, 3))
        appliances.display(
            extra,
            x - proud,
            (y - 0.7 * w, y + 0.7 * w),
            (z + 0.55 * h, z + 0.85 * h),
            0.25 * unit,
            tone,
        )
        appliances.buttons(
            extra,
            rng,
            x - proud,
            (y - 0.8 * w, y + 0.8 * w),
            (z - 0.85 * h, z + 0.4 * h),
            0.6 * unit,
            materials.white_plastic(rng),
        )
    y, z = spots[1]
    if bolt == "lever":
        moving.append(_lever(rng, (x, y, z), way, 0.75 * room, unit, metal))
    elif bolt == "wheel":
        moving.append(_wheel(rng, (x, y, z), min(room, 0.26 * small), unit, metal))
    elif bolt == "knob":
        radius = min(max(0.07 * small, 2.4 * unit), room)
        knob = ((x, y, z), radius, 1.1 * radius, metal, metal.darker(0.5), float(np.pi / 2))
        moving.append(functools.partial(_knob, knob, skirt=True))
    return moving


def _knob(knob: tuple, asm: Assembly, door: int, **options) -> None:
    """``add_knob`` once the door is known."""
    add_knob(asm, door, *knob, **options)


def _part(name: str, shape: Shape, joint: Joint, asm: Assembly, door: int) -> None:
    """A turning part once the door is known."""
    asm.add(name, shape, door, joint)


def _lever(rng, at, way: int, length, unit, metal) -> Callable:
    """A handle that turns down by a quarter: a level bar away from the hinge, or one that hangs."""
    x, y, z = at
    length = max(length, 6 * unit)
    r = max(0.7 * unit, 0.09 * length)
    reach = 1.6 * unit + 1.6 * r
    boss = cylinder("x", [x - reach, y, z], reach - 0.0008, 2 * r, segments=16)
    level = rng.random() < 0.65
    if level:
        tip = [x - reach, y - way * length, z]
        joint = hinge(at, (way, 0, 0), float(np.deg2rad(rng.choice([60, 90]))))
    else:
        tip = [x - reach, y, z - length]
        joint = hinge(at, (-way, 0, 0), float(np.deg2rad(90)))
    bar = pipe([[x - reach, y, z], tip], r, 10)
    if rng.random() < 0.4:
        bar += ball(tip, 1.5 * r)
    return functools.partial(_part, "lever", Shape().add(union([boss, bar]), metal), joint)


def _wheel(rng, at, radius, unit, metal) -> Callable:
    """Spokes with or without a rim, that turn without end."""
    x, y, z = at
    radius = max(radius, 5 * unit)
    count, r = int(rng.integers(3, 6)), max(0.55 * unit, 0.06 * radius)
    reach = 1.8 * unit + 1.8 * r
    solids = [cylinder("x", [x - reach - r, y, z], reach + r - 0.0008, 0.2 * radius, segments=16)]
    start = float(rng.uniform(0, 2 * np.pi))
    rim = rng.random() < 0.5
    for k in range(count):
        angle = start + 2 * np.pi * k / count
        tip = [x - reach, y + radius * np.cos(angle), z + radius * np.sin(angle)]
        solids.append(pipe([[x - reach, y, z], tip], r, 8))
        if not rim:
            solids.append(ball(tip, 1.7 * r, 10))
    if rim:
        solids.append(tube("x", [x - reach - r, y, z], 2 * r, radius + r, radius - r, 28))
    return functools.partial(
        _part, "wheel", Shape().add(tidy(union(solids)), metal), turn(at, (1, 0, 0))
    )

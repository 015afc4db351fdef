"""Soap dispensers for walls and tables, and trigger sprays, in metres."""

from __future__ import annotations

import dataclasses

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday import vessels
from uniart_jax.procedural.everyday.vessel_finishes import (
    clear,
    draw_dispenser_accent,
    draw_dispenser_plastic,
)
from uniart_jax.procedural.everyday.vessel_fittings import bezier, taper
from uniart_jax.procedural.everyday.vessels import frustum, half_width, stack
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cylinder,
    extrusion,
    hinge,
    hull,
    pipe,
    rounded,
    slide,
    tidy,
    tube,
    turn,
    union,
)


def _case(rng, depth: float, half: float, low: float, high: float) -> Manifold:
    """A case from x = -``depth`` to 0: rounded as seen from above, the front or a
    side, or tapered."""
    manner = rng.choice(4)
    corner = float(rng.uniform(0.05, 0.45)) * min(depth, half)
    x, z = -depth / 2, (low + high) / 2
    if manner == 0:
        return extrusion(rounded(depth, 2 * half, corner), "z", [x, 0, low], high - low)
    if manner == 1:
        return extrusion(rounded(2 * half, high - low, corner), "x", [-depth, 0, z], depth)
    if manner == 2:
        side = rounded(high - low, depth, corner)
        return extrusion(side, "y", [x, -half, z], 2 * half)
    above, below = float(rng.uniform(0.6, 1.0)), float(rng.uniform(0.6, 1.0))
    below = 1.0 if rng.random() < 0.5 else below
    above = 1.0 if below < 1 else above
    points = []
    for share, zz in ((below, low), (above, high)):
        points += [[-share * depth, y, zz] for y in (-half, half)]
        points += [[0.0, y, zz] for y in (-half, half)]
    return hull(np.array(points))


def wall_soap(rng: np.random.Generator) -> ArticulatedObject:
    """A soap dispenser on a wall or a stand (metres): a cover hinged at the top or a side, a push
    bar or a lever below it."""
    height = float(rng.uniform(0.18, 0.32))
    half, depth = height * float(rng.uniform(0.2, 0.38)), height * float(rng.uniform(0.3, 0.6))
    unit = height / 100
    air, wall = 0.5 * unit, 2.4 * unit
    face, accent = draw_dispenser_plastic(rng), draw_dispenser_accent(rng)
    inner = materials.white_plastic(rng) if rng.random() < 0.6 else materials.dark(rng)
    split = height * float(rng.uniform(0.22, 0.34))  # the key is below it
    case = _case(rng, depth, half, 0.0, height)
    plate = float(rng.uniform(0.1, 0.22)) * depth

    asm, body = Assembly(), Shape()
    rear = case ^ box([-plate, -9, -9], [9, 9, 9])
    core_lo = [-0.55 * depth, -0.6 * half, split + 2 * wall]
    core = box(core_lo, [-plate, 0.6 * half, height - 3 * wall])
    floor = case ^ box([-0.62 * depth, -9, split - 1.6 * wall], [-plate, 9, split - air])
    body.add(tidy(rear + floor), inner if rng.random() < 0.5 else dataclasses.replace(face))
    if rng.random() < 0.8:
        body.add(core, clear(rng))
    snout = cylinder("z", [-0.42 * depth, 0, split - 12 * unit], 9 * unit, 3 * unit, 3 * unit)
    body.add(tidy(snout - rear - floor), accent)
    if rng.random() < 0.3:  # a stand on the floor or a table
        tall = float(rng.uniform(0.8, 2.4)) * height
        post = box([-0.9 * plate, -0.25 * half, -tall], [0, 0.25 * half, 0.001])
        foot = box([-1.1 * depth, -1.2 * half, -tall - 3 * unit], [0.3 * depth, 1.2 * half, -tall])
        body.add(union([post - rear, foot]), materials.metal(rng))
    root = asm.add("body", body)
    front = case ^ box([-9, -9, split], [-plate - air, 9, 9])
    lo, hi = np.array(front.bounding_box()).reshape(2, 3)
    room = box(lo + [wall, wall, -1], hi - [-1, wall, wall])
    cover = Shape().add(tidy(front - room), face)
    if rng.random() < 0.6:  # a window of the level, proud of the front
        w, z = 0.25 * half, split + 0.3 * (height - split)
        pane = box([lo[0] - 0.8 * unit, -w, z], [-0.5 * depth, w, z + 0.4 * (height - split)])
        cover.add(tidy(pane - front - room), materials.dark_glass(rng))
    x = -plate - air
    angle = float(rng.uniform(0.9, 1.6))
    joint = hinge((x, 0, hi[2]), (0, 1, 0), angle)
    if rng.random() < 0.35:
        joint = hinge((x, hi[1], 0), (0, 0, -1), angle)
    asm.add("cover", cover, root, joint)
    bar_front = min(lo[0], -depth * 0.8) - 4 * unit
    bar_half = min(0.75 * half, 0.9 * hi[1])
    top, low = split - 1.6 * wall - air, float(rng.uniform(0.0, 0.3)) * split
    if rng.random() < 0.65:  # a bar that is pushed in at its lower end
        bar = box([bar_front, -bar_half, low], [bar_front + 3 * unit, bar_half, top])
        bar += box([bar_front, -bar_half, top - 3 * unit], [-0.58 * depth, bar_half, top])
        way = -0.42 * depth - 8 * unit - bar_front
        angle = float(np.clip(way / (top - low), 0.08, 0.3))
        push = hinge((-0.58 * depth, 0, top), (0, -1, 0), angle)
        asm.add("push_bar", Shape().add(tidy(bar), accent), root, push)
    else:  # a long lever for the elbow
        r = 1.6 * unit
        reach = bar_front - float(rng.uniform(0.3, 0.8)) * depth
        line = [[-0.58 * depth, -0.5 * half, top - r], [reach, -0.5 * half, 0.5 * top]]
        arm = pipe([*line, *(np.array(line[::-1]) * [1, -1, 1])], r)
        joint = hinge((-0.58 * depth, 0, top - r), (0, -1, 0), float(rng.uniform(0.2, 0.4)))
        asm.add("lever", Shape().add(tidy(arm), accent), root, joint)
    return asm.object()


def pump(rng: np.random.Generator) -> ArticulatedObject:
    """A low, broad soap pot in metres with a pump head that is pressed down; some have a tray for a
    sponge."""
    width = float(rng.uniform(0.07, 0.12))
    height = width * float(rng.uniform(0.5, 1.05))
    unit = width / 60
    face, metal = draw_dispenser_plastic(rng), materials.hardware(rng)
    if rng.random() < 0.3:
        face = clear(rng) if rng.random() < 0.6 else materials.stone(rng)
    outline = vessels.ring(32, float(rng.uniform(0.8, 1.6)), float(rng.choice([2, 4, 8])))
    top = width / 2 * float(rng.uniform(0.6, 1.0))
    profile = vessels.silhouette(0.96 * width / 2, width / 2, top, 0.4, 0, height, 0.06 * width)
    asm, body = Assembly(), Shape()
    body.add(stack(profile, outline), face)
    if rng.random() < 0.4:  # a tray beside it
        y = half_width(outline) * width / 2
        lo = np.array([-width / 2, 0, 0])
        hi = np.array([width / 2, y + width * float(rng.uniform(0.6, 1.2)), 0.35 * height])
        dish = box(lo, hi) - box(lo + [3 * unit, 0, 3 * unit], hi + [-3 * unit, -3 * unit, 1])
        body.add(tidy(dish - stack(profile, outline)), dataclasses.replace(face))
    collar, r = float(rng.uniform(7, 12)) * unit, 0.22 * width
    neck = height + collar
    ring_ = tube("z", [0, 0, height], collar, r, 2.6 * unit)
    body.add(ring_, metal)
    root = asm.add("body", body)
    travel = float(rng.uniform(6, 10)) * unit
    z = neck + travel + unit
    stem = cylinder("z", [0, 0, height + 0.3 * unit + travel], z - height - travel, 2.1 * unit)
    size = float(rng.uniform(5, 8)) * unit
    reach, thick = float(rng.uniform(0.35, 0.75)) * width, float(rng.uniform(2.2, 3.2)) * unit
    head = cylinder("z", [0, 0, z], 2.2 * size, size, 0.85 * size, 20)
    beak = z + 1.4 * size
    end = [-reach - 4 * unit, 0, beak - 5 * unit]
    bar = pipe([[0, 0, beak], [-reach, 0, beak + 2 * unit], end], thick, 10)
    if rng.random() < 0.4:  # flat, as on sanitizers
        bar = box([-reach, -1.4 * thick, beak - thick], [0, 1.4 * thick, beak + thick])
        head = cylinder("z", [0, 0, z], 2.2 * size, 0.7 * size, 1.1 * size, 20)
    solid = tidy(union([stem, head, bar]))
    press = slide((0, 0, -1), travel)
    tone = metal if rng.random() < 0.7 else draw_dispenser_accent(rng)
    asm.add("pump_head", Shape().add(solid, dataclasses.replace(tone)), root, press)
    return vessels.turned(asm.object(), float(rng.choice([0, 45, -45, 90, -90])))


def spray(rng: np.random.Generator) -> ArticulatedObject:
    """A trigger spray in metres: a flat or tapered tank, a head with a trigger in front, and a
    nozzle that turns."""
    height = float(rng.uniform(0.12, 0.2))
    unit = height / 70
    half = height * float(rng.uniform(0.25, 0.4))
    face, trim, accent = (
        draw_dispenser_plastic(rng),
        draw_dispenser_plastic(rng),
        draw_dispenser_accent(rng),
    )
    power = float(rng.choice([2, 3, 5]))
    outline = vessels.ring(28, float(rng.uniform(0.5, 0.8)), power)
    shoulder = height * float(rng.uniform(0.55, 0.8))
    t = np.linspace(0, 1, 7)
    bent = 9 * unit + (half - 9 * unit) * (1 + np.cos(np.pi * t)) / 2
    upper = np.column_stack([bent, shoulder + (height - shoulder) * t])
    lower = np.array([[half * float(rng.uniform(0.85, 1.1)), 0.0]])
    tank = stack(np.vstack([lower, upper]), outline)
    asm, body = Assembly(), Shape()
    body.add(tank, face if rng.random() < 0.7 else clear(rng))
    body.add(cylinder("z", [0, 0, height], 9 * unit, 8 * unit, segments=18), trim)
    low, wide = height + 9 * unit, float(rng.uniform(5.5, 7.5)) * unit
    front, rear = -float(rng.uniform(29, 37)) * unit, float(rng.uniform(12, 20)) * unit
    tall = float(rng.uniform(14, 18)) * unit
    side = [
        [low, -8 * unit],
        [low, 8 * unit],
        [low + 0.5 * tall, rear],
        [low + tall, rear],
        [low + tall, front],
        [low + 0.4 * tall, front],
        [low + 0.4 * tall, -10 * unit],
    ]
    head = extrusion(np.array(side), "y", [0, -wide, 0], 2 * wide)
    body.add(head, dataclasses.replace(trim))
    root = asm.add("body", body)
    x, z = front + 7 * unit, low + 0.4 * tall - 3.2 * unit
    long = float(rng.uniform(15, 21)) * unit
    line = bezier([[x, 0, z], [x - 2 * unit, 0, z - 0.6 * long],
                           [x - 6 * unit, 0, z - long]], 6)  # fmt: skip
    lever = taper(line, 2.6 * unit, 2.2 * unit, float(rng.uniform(1.4, 2.2)))
    room = -x - 9 * unit
    angle = float(np.clip(room / (1.2 * long), 0.15, 0.5))
    asm.add("trigger", Shape().add(lever, accent), root, hinge((x, 0, z), (0, -1, 0), angle))
    size = float(rng.uniform(4.5, 6)) * unit
    at = [front - 0.4 * unit, 0, low + 0.7 * tall]
    if rng.random() < 0.5:
        nozzle = box([at[0] - 7 * unit, -size, at[2] - size], [at[0], size, at[2] + size])
    else:
        nozzle = frustum(vessels.ring(6), size, 0.8 * size, 0, 8 * unit)
        nozzle = nozzle.rotate((0, -90, 0)).translate(tuple(at))
    asm.add("nozzle", Shape().add(nozzle, accent), root, turn(at, (1, 0, 0)))
    return vessels.turned(asm.object(), float(rng.choice([0, 90, -90, rng.uniform(-90, 90)])))

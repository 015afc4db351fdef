"""Dispensers: of soap on walls and tables, of water with taps, of cereals, sweets, napkins, paper
and tape, and trigger sprays."""

from __future__ import annotations

import dataclasses

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials, vessels
from uniart_jax.procedural.fronts import add_knob
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cylinder,
    extrusion,
    hinge,
    hull,
    pipe,
    revolution,
    rounded,
    slide,
    tidy,
    tube,
    turn,
    union,
)
from uniart_jax.procedural.vessels import stack


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A dispenser, metres, closed."""
    kinds = (_wall_soap, _pump, _spray, _water, _cereal, _roll, _napkins, _tape)
    chosen = int(rng.choice(8, p=[0.16, 0.14, 0.11, 0.19, 0.13, 0.1, 0.07, 0.1]))
    return kinds[chosen](rng)


def _plastic(rng: np.random.Generator) -> Material:
    """White, grey, steel, dark or of any colour."""
    kind = rng.choice(5, p=[0.28, 0.2, 0.18, 0.24, 0.1])
    if kind == 3:
        return plain(materials.hsv(rng, (0, 1), (0.35, 0.95), (0.4, 0.95)))
    makers = {0: materials.white_plastic, 1: materials.metal, 2: materials.dark}
    return makers.get(int(kind), materials.paint)(rng)


def _accent(rng: np.random.Generator) -> Material:
    """Of levers and keys: vivid, dark or of metal."""
    if rng.random() < 0.45:
        return plain(materials.hsv(rng, (0, 1), (0.6, 1), (0.4, 0.95)))
    return materials.dark(rng) if rng.random() < 0.5 else materials.hardware(rng)


def _clear(rng: np.random.Generator) -> Material:
    """Glass or clear plastic, tinted as its content is."""
    if rng.random() < 0.5:
        return materials.glass(rng)
    return plain(materials.hsv(rng, (0, 1), (0.15, 0.5), (0.75, 0.95)))


def _cased(rng, depth: float, half: float, low: float, high: float, back: float = 0.0) -> Manifold:
    """A case from x = ``back`` - ``depth`` to ``back``: rounded as seen from above, the front or a
    side, or narrower above or below."""
    manner = rng.choice(4)
    corner = float(rng.uniform(0.05, 0.45)) * min(depth, half)
    x, z = back - depth / 2, (low + high) / 2
    if manner == 0:
        return extrusion(rounded(depth, 2 * half, corner), "z", [x, 0, low], high - low)
    if manner == 1:
        return extrusion(rounded(2 * half, high - low, corner), "x", [back - depth, 0, z], depth)
    if manner == 2:
        side = rounded(high - low, depth, corner)
        return extrusion(side, "y", [x, -half, z], 2 * half)
    above, below = float(rng.uniform(0.6, 1.0)), float(rng.uniform(0.6, 1.0))
    below = 1.0 if rng.random() < 0.5 else below
    above = 1.0 if below < 1 else above
    points = []
    for share, zz in ((below, low), (above, high)):
        points += [[back - share * depth, y, zz] for y in (-half, half)]
        points += [[back, y, zz] for y in (-half, half)]
    return hull(np.array(points))


def _wall_soap(rng: np.random.Generator) -> ArticulatedObject:
    """A case on a wall or a stand: a cover hinged above or at a side, a push bar or a lever
    below it."""
    height = float(rng.uniform(0.18, 0.32))
    half, depth = height * float(rng.uniform(0.2, 0.38)), height * float(rng.uniform(0.3, 0.6))
    unit = height / 100
    air, wall = 0.5 * unit, 2.4 * unit
    face, accent = _plastic(rng), _accent(rng)
    inner = materials.white_plastic(rng) if rng.random() < 0.6 else materials.dark(rng)
    split = height * float(rng.uniform(0.22, 0.34))  # the key is below it
    case = _cased(rng, depth, half, 0.0, height)
    plate = float(rng.uniform(0.1, 0.22)) * depth

    asm, body = Assembly(), Shape()
    rear = case ^ box([-plate, -9, -9], [9, 9, 9])
    core_lo = [-0.55 * depth, -0.6 * half, split + 2 * wall]
    core = box(core_lo, [-plate, 0.6 * half, height - 3 * wall])
    floor = case ^ box([-0.62 * depth, -9, split - 1.6 * wall], [-plate, 9, split - air])
    body.add(tidy(rear + floor), inner if rng.random() < 0.5 else dataclasses.replace(face))
    if rng.random() < 0.8:
        body.add(core, _clear(rng))
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


def _pump(rng: np.random.Generator) -> ArticulatedObject:
    """A low, broad pot of soap, its pump head pressed down; some with a caddy for a sponge."""
    width = float(rng.uniform(0.07, 0.12))
    height = width * float(rng.uniform(0.5, 1.05))
    unit = width / 60
    face, metal = _plastic(rng), materials.hardware(rng)
    if rng.random() < 0.3:
        face = _clear(rng) if rng.random() < 0.6 else materials.stone(rng)
    outline = vessels.ring(32, float(rng.uniform(0.8, 1.6)), float(rng.choice([2, 4, 8])))
    top = width / 2 * float(rng.uniform(0.6, 1.0))
    profile = vessels.silhouette(0.96 * width / 2, width / 2, top, 0.4, 0, height, 0.06 * width)
    asm, body = Assembly(), Shape()
    body.add(stack(profile, outline), face)
    if rng.random() < 0.4:  # a tray beside it
        y = float(np.abs(outline[:, 1]).max()) * width / 2
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
    tone = metal if rng.random() < 0.7 else _accent(rng)
    asm.add("pump_head", Shape().add(solid, dataclasses.replace(tone)), root, press)
    return vessels.turned(asm.object(), float(rng.choice([0, 45, -45, 90, -90])))


def _spray(rng: np.random.Generator) -> ArticulatedObject:
    """A trigger spray: a flat or tapered tank, a head with a trigger in front, a nozzle that
    turns."""
    height = float(rng.uniform(0.12, 0.2))
    unit = height / 70
    half = height * float(rng.uniform(0.25, 0.4))
    face, trim, accent = _plastic(rng), _plastic(rng), _accent(rng)
    power = float(rng.choice([2, 3, 5]))
    outline = vessels.ring(28, float(rng.uniform(0.5, 0.8)), power)
    shoulder = height * float(rng.uniform(0.55, 0.8))
    t = np.linspace(0, 1, 7)
    bent = 9 * unit + (half - 9 * unit) * (1 + np.cos(np.pi * t)) / 2
    upper = np.column_stack([bent, shoulder + (height - shoulder) * t])
    lower = np.array([[half * float(rng.uniform(0.85, 1.1)), 0.0]])
    tank = stack(np.vstack([lower, upper]), outline)
    asm, body = Assembly(), Shape()
    body.add(tank, face if rng.random() < 0.7 else _clear(rng))
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
    line = vessels.bezier([[x, 0, z], [x - 2 * unit, 0, z - 0.6 * long],
                           [x - 6 * unit, 0, z - long]], 6)  # fmt: skip
    lever = vessels.taper(line, 2.6 * unit, 2.2 * unit, float(rng.uniform(1.4, 2.2)))
    room = -x - 9 * unit
    angle = float(np.clip(room / (1.2 * long), 0.15, 0.5))
    asm.add("trigger", Shape().add(lever, accent), root, hinge((x, 0, z), (0, -1, 0), angle))
    size = float(rng.uniform(4.5, 6)) * unit
    at = [front - 0.4 * unit, 0, low + 0.7 * tall]
    if rng.random() < 0.5:
        nozzle = box([at[0] - 7 * unit, -size, at[2] - size], [at[0], size, at[2] + size])
    else:
        nozzle = stack(np.array([[size, 0], [0.8 * size, 8 * unit]]), vessels.ring(6))
        nozzle = nozzle.rotate((0, -90, 0)).translate(tuple(at))
    asm.add("nozzle", Shape().add(nozzle, accent), root, turn(at, (1, 0, 0)))
    return vessels.turned(asm.object(), float(rng.choice([0, 90, -90, rng.uniform(-90, 90)])))


def _tap(
    rng, asm: Assembly, body: Shape, ground: Manifold, at, unit: float, tone, metal, one: bool
):
    """A tap on the plane x = at[0]: its spigot goes to ``body``; returns what adds its lever."""
    x, y, z = at
    r, reach = 2.4 * unit, float(rng.uniform(7, 10)) * unit
    spigot = cylinder("x", [x - reach, y, z], reach + 3 * unit, r, segments=16)
    spigot += cylinder("z", [x - reach, y, z - 6 * unit], 6 * unit + r, 1.2 * r, segments=16)
    body.add(tidy(spigot - ground), metal)
    top = z + r + 0.4 * unit
    if not one or rng.random() < 0.6:  # pressed down or pulled
        long, wide = float(rng.uniform(8, 12)) * unit, float(rng.uniform(2.3, 3.2)) * unit
        pivot = [x - reach + r, y, top + 1.6 * unit]
        key = box([pivot[0] - long, y - wide, top + 0.9 * unit],
                  [pivot[0], y + wide, top + 2.6 * unit])  # fmt: skip
        key += cylinder("y", [pivot[0], y - wide, pivot[2]], 2 * wide, 1.5 * unit, segments=12)
        up = float(rng.uniform(0.35, 0.75))
        joint = hinge(pivot, (0, 1, 0), up)
    else:  # turned by a quarter about its stem
        key = cylinder("z", [x - reach, y, top], 4 * unit, 0.9 * r, segments=14)
        key += box([x - reach - 8 * unit, y - 1.2 * unit, top + 2 * unit],
                   [x - reach + 4 * unit, y + 1.2 * unit, top + 5 * unit])  # fmt: skip
        joint = hinge((x - reach, y, 0), (0, 0, 1), float(rng.choice([-1.5, 1.5])))
    shape = Shape().add(tidy(key), tone)
    return lambda root: asm.add("tap_lever", shape, root, joint)


def _water(rng: np.random.Generator) -> ArticulatedObject:
    """Water on a table, in a barrel or a box with taps, or from a cooler that stands on the
    floor."""
    if rng.random() < 0.45:
        return _cooler(rng)
    height = float(rng.uniform(0.25, 0.45))
    unit = height / 100
    radius = height * float(rng.uniform(0.28, 0.45))
    round_ = rng.random() < 0.6
    power = 2.0 if round_ else float(rng.uniform(4, 8))
    outline = vessels.ring(36, 1.0 if round_ else float(rng.uniform(0.8, 1.4)), power)
    face, metal, tone = _plastic(rng), materials.hardware(rng), _accent(rng)
    face = _clear(rng) if rng.random() < 0.4 else face
    legs = float(rng.uniform(12, 45)) * unit
    belly = radius * float(rng.choice([1.0, rng.uniform(1.0, 1.2)]))
    profile = vessels.silhouette(radius, belly, radius * float(rng.uniform(0.8, 1.0)), 0.45,
                                 legs, legs + height)  # fmt: skip
    solid = stack(profile, outline)
    asm, body = Assembly(), Shape()
    body.add(tidy(solid - vessels.room(profile, outline, 2.5 * unit)), face)
    if rng.random() < 0.5:  # on legs or a plinth
        r = 2.4 * unit
        across = 0.7 * radius * float(np.abs(outline[:, 1]).max())
        posts = [cylinder("z", [x, y, 0], legs, r, segments=12)
                 for x in (-0.65 * radius, 0.65 * radius) for y in (-across, across)]  # fmt: skip
    else:
        posts = [stack(np.array([[0.95 * radius, 0], [0.8 * radius, legs]]), outline)]
    body.add(union(posts), metal if rng.random() < 0.5 else materials.wood(rng, textured=False))
    z = legs + float(rng.uniform(0.1, 0.2)) * height
    x = -vessels.radius_at(profile, z)
    ys = [0.0] if round_ or rng.random() < 0.5 else [-0.4 * radius, 0.4 * radius]
    taps = [_tap(rng, asm, body, solid, (x, y, z), 1.25 * unit, tone, metal, round_) for y in ys]
    root = asm.add("body", body)
    for tap in taps:
        tap(root)
    top, low = profile[-1, 0], legs + height + 0.5 * unit
    rise = float(rng.uniform(0.06, 0.25)) * radius
    lid = vessels.dome(outline, 1.02 * top, low, rise, 0.5 * rise)
    plug = 0.92 * (top - 2.5 * unit)
    lid += stack(np.array([[0.97 * plug, low - 3 * unit], [plug, low + 0.5 * unit]]), outline)
    bud = vessels.knob(rng, [0, 0, low + 0.95 * rise], float(rng.uniform(0.1, 0.16)) * radius)
    shape = Shape().add(tidy(lid), tone if rng.random() < 0.4 else dataclasses.replace(metal))
    shape.add(tidy(bud - lid), materials.dark(rng))
    joint = slide((0, 0, 1), float(rng.uniform(0.2, 0.6)) * height)
    if rng.random() < 0.3:
        joint = hinge((1.02 * top, 0, low), (0, 1, 0), float(rng.uniform(0.8, 1.5)))
    asm.add("lid", shape, root, joint)
    return asm.object()


def _cooler(rng: np.random.Generator) -> ArticulatedObject:
    """A cooler on the floor: taps in a niche, a door below, a drip tray, a tank that lifts off."""
    height = float(rng.uniform(0.8, 1.1))
    half, depth = float(rng.uniform(0.13, 0.18)), float(rng.uniform(0.28, 0.36))
    unit = height / 100
    face, tone, metal = _plastic(rng), _accent(rng), materials.hardware(rng)
    low, high = height * float(rng.uniform(0.5, 0.6)), height * float(rng.uniform(0.84, 0.92))
    niche = depth * float(rng.uniform(0.3, 0.45))
    wall = 2 * unit
    case = extrusion(rounded(2 * half, height, float(rng.uniform(0.2, 4)) * unit), "x",
                     [0, 0, height / 2], depth)  # fmt: skip
    case -= box([-1, -half + wall, low], [niche, half - wall, high])
    door_lo = np.array([0, -half + wall, 4 * unit])
    door_hi = np.array([2 * unit, half - wall, low - 4 * unit])
    case -= box(
        door_lo - [1, 0.4 * unit, 0.4 * unit], door_hi + [depth * 0.6, 0.4 * unit, 0.4 * unit]
    )
    asm, body = Assembly(), Shape()
    body.add(tidy(case), face)
    count = int(rng.choice([1, 2, 3], p=[0.2, 0.5, 0.3]))
    ys = (np.arange(count) - (count - 1) / 2) * 0.5 * half
    taps = [_tap(rng, asm, body, case, (niche, y, high - 15 * unit), 1.0 * unit,
                 _accent(rng), metal, count == 1) for y in ys]  # fmt: skip
    root = asm.add("body", body)
    for tap in taps:
        tap(root)
    door = box(door_lo, door_hi) + box([-1.2 * unit, 0.5 * half, door_hi[2] - 12 * unit],
                                       [0.001, 0.6 * half, door_hi[2] - 3 * unit])  # fmt: skip
    joint = hinge((0, door_lo[1], 0), (0, 0, 1), float(rng.uniform(1.0, 1.8)))
    finish = dataclasses.replace(face) if rng.random() < 0.6 else tone
    asm.add("door", Shape().add(tidy(door), finish), root, joint)
    if rng.random() < 0.7:
        lo = [-2 * unit, -0.75 * half, low + 0.3 * unit]
        hi = [niche - unit, 0.75 * half, low + 3 * unit]
        tray = box(lo, hi) - box(np.array(lo) + 0.8 * unit, np.array(hi) + [-unit, -unit, 1])
        shape = Shape().add(tidy(tray), materials.dark(rng))
        asm.add("drip_tray", shape, root, slide((-1, 0, 0), 0.8 * niche))
    if rng.random() < 0.65:
        r, tall = 0.85 * half, float(rng.uniform(0.25, 0.4))
        z = height + 0.4 * unit
        rim = [[0, z], [0.45 * r, z], [0.5 * r, z + 0.1 * tall], [r, z + 0.28 * tall],
               [r, z + 0.6 * tall], [0.94 * r, z + 0.64 * tall], [r, z + 0.68 * tall],
               [r, z + 0.97 * tall], [0.9 * r, z + tall], [0, z + tall]]  # fmt: skip
        tank = revolution(np.array(rim), "z", [depth / 2, 0, 0], 28)
        asm.add("tank", Shape().add(tank, _clear(rng)), root, slide((0, 0, 1), 0.6 * tall))
    return asm.object()


def _cereal(rng: np.random.Generator) -> ArticulatedObject:
    """Clear hoppers on a stand, each with a knob that turns its wheel, a lid, sometimes a flap; one
    ball of sweets."""
    count = int(rng.choice([1, 2, 3], p=[0.5, 0.35, 0.15]))
    sweets = count == 1 and rng.random() < 0.4
    height = float(rng.uniform(0.18, 0.3))
    unit = height / 60
    half = height * float(rng.uniform(0.24, 0.34))
    face, tone = _plastic(rng), _accent(rng)
    legs = float(rng.uniform(10, 22)) * unit
    neck, block = half * 0.75, float(rng.uniform(15, 20)) * unit
    power = 2.0 if sweets or rng.random() < 0.5 else 6.0
    outline = vessels.ring(32, 1.0, power)
    pitch = 2 * half + 2 * unit
    ys = (np.arange(count) - (count - 1) / 2) * pitch
    asm, body = Assembly(), Shape()
    foot = [box([-1.1 * half, ys[0] - half, 0], [1.2 * half, ys[-1] + half, 3 * unit])]
    foot.append(box([0.55 * half, ys[0] - 0.5 * half, 0],
                    [half, ys[-1] + 0.5 * half, legs + block]))  # fmt: skip
    boxes = [box([-0.9 * half, y - neck, legs], [0.9 * half, y + neck, legs + block]) for y in ys]
    chute = [box([-0.5 * half, y - 0.5 * neck, legs - 4 * unit], [0.3 * half, y + 0.5 * neck, legs])
             for y in ys]  # fmt: skip
    body.add(tidy(union([*foot, *boxes, *chute])), face)
    base = legs + block
    full = half * 0.96
    t = np.linspace(-0.85, 0.9, 9)
    if sweets:
        profile = np.column_stack([full * np.sqrt(1 - t**2), base + full * (t + 0.85)])
    else:
        profile = np.array([[neck, base], [full, base + 8 * unit], [full, base + height]])
    top, wall = profile[-1, 0], 1.6 * unit
    glass = _clear(rng)
    for y in ys:
        jar = stack(profile, outline) - vessels.room(profile, outline, wall)
        body.add(tidy(jar).translate((0, y, 0)), glass)
        if rng.random() < 0.7:
            fill = profile[-1, 1] - base
            heap = vessels.room(profile, outline, 1.1 * wall)
            heap = heap ^ box([-1, -1, 0], [1, 1, base + fill * float(rng.uniform(0.3, 0.8))])
            food = plain(materials.hsv(rng, (0, 1), (0.4, 0.9), (0.5, 0.9)))
            body.add(heap.translate((0, y, 0)), food)
    root = asm.add("body", body)
    z, r = legs + 0.5 * block, float(rng.uniform(0.3, 0.42)) * block
    low = profile[-1, 1] + 0.4 * unit
    hinged = rng.random() < 0.4
    flap = count < 3 and rng.random() < 0.4
    for y in ys:
        mark = plain((0.95, 0.95, 0.95) if tone.color[1] < 0.5 else (0.1, 0.1, 0.1))
        add_knob(asm, root, (-0.9 * half, y, z), r, 0.8 * r, tone, mark, None)
        rise = float(rng.uniform(3, 7)) * unit
        lid = vessels.dome(outline, top, low, rise, 0.6 * rise)
        plug = 0.93 * (top - wall)
        lid += stack(np.array([[0.97 * plug, low - 2 * unit], [plug, low + unit]]), outline)
        shape = Shape().add(tidy(lid.translate((0, y, 0))), dataclasses.replace(face))
        joint = slide((0, 0, 1), 0.4 * height)
        if hinged:
            joint = hinge((top, 0, low), (0, 1, 0), float(rng.uniform(0.8, 1.5)))
        asm.add("lid", shape, root, joint)
        if flap:
            x = -0.5 * half - 1.2 * unit
            leaf = box([x - unit, y - 0.5 * neck, legs - 7 * unit],
                       [x, y + 0.5 * neck, legs - 0.6 * unit])  # fmt: skip
            joint = hinge((x - unit, y, legs - 0.6 * unit), (0, 1, 0), float(rng.uniform(0.5, 1.2)))
            asm.add("flap", Shape().add(leaf, tone), root, joint)
    return asm.object()


def _roll(rng: np.random.Generator) -> ArticulatedObject:
    """Paper on a roll that turns, on a wall or a stand, under a cover hinged behind or in the
    open."""
    radius, wide = float(rng.uniform(0.05, 0.11)), float(rng.uniform(0.1, 0.26))
    unit = max(2.4 * radius, wide) / 100
    half, air = wide / 2, 0.8 * unit
    face, paper = _plastic(rng), materials.white_plastic(rng)
    cheek, core = 2.5 * unit, 0.3 * radius
    plate = 3 * unit
    x, z = -radius - 2.5 * unit - plate, 1.25 * radius
    asm, body = Assembly(), Shape()
    wall = box([-plate, -half - cheek - air, 0], [0, half + cheek + air, 2.4 * radius])
    solids = [wall]
    for y in (-half - cheek - air, half + air):
        disc = cylinder("y", [x, y, z], cheek, 0.5 * radius, segments=20)
        arm = box([x, y, z - 0.3 * radius], [-0.5 * plate, y + cheek, z + 0.3 * radius])
        solids += [disc, arm]
    rod = cylinder("y", [x, -half - air - 0.5 * cheek, z], 2 * half + 2 * air + cheek, 0.6 * core)
    body.add(tidy(union([*solids, rod])), face)
    root = asm.add("body", body)
    shape = Shape().add(tube("y", [x, -half, z], wide, radius, core + 2 * unit, 32), paper)
    card = plain(materials.hsv(rng, (0.06, 0.1), (0.3, 0.6), (0.4, 0.7)))
    inner = tube("y", [x, -half - 0.4 * air, z], wide + 0.8 * air, core + 2 * unit, core, 32)
    shape.add(inner, card)
    asm.add("roll", shape, root, turn((x, 0, z), (0, 1, 0)))
    if rng.random() < 0.75:  # a cover: an arched or angular hood
        r0, t = radius + 1.8 * unit, 2 * unit
        angle = np.linspace(np.pi / 2, np.pi + float(rng.uniform(0.1, 0.6)), 9)
        outer = np.column_stack([z + (r0 + t) * np.sin(angle), x + (r0 + t) * np.cos(angle)])
        inner = np.column_stack([z + r0 * np.sin(angle), x + r0 * np.cos(angle)])
        back = -plate - air
        profile = np.vstack([[[z + r0 + t, back]], outer, inner[::-1], [[z + r0, back]]])
        hood = extrusion(profile, "y", [0, -half - cheek, 0], wide + 2 * cheek)
        angle = float(rng.uniform(0.7, 1.5))
        finish = dataclasses.replace(face) if rng.random() < 0.5 else _clear(rng)
        joint = hinge((back, 0, z + r0 + t), (0, 1, 0), angle)
        asm.add("cover", Shape().add(tidy(hood), finish), root, joint)
    return asm.object()


def _napkins(rng: np.random.Generator) -> ArticulatedObject:
    """A box of napkins or gloves with a flap in front and a lid above."""
    half, depth = float(rng.uniform(0.05, 0.12)), float(rng.uniform(0.08, 0.2))
    height = float(rng.uniform(0.08, 0.24))
    unit = max(2 * half, depth, height) / 100
    wall, air = 2.2 * unit, 0.5 * unit
    face, tone = _plastic(rng), _accent(rng)
    face = materials.wood(rng, textured=False) if rng.random() < 0.2 else face
    case = box([0, -half, 0], [depth, half, height])
    case -= box([wall, -half + wall, wall], [depth - wall, half - wall, 1])
    z0, z1 = float(rng.uniform(0.1, 0.2)) * height, float(rng.uniform(0.55, 0.8)) * height
    w = float(rng.uniform(0.6, 0.8)) * half
    case -= box([-1, -w, z0], [2 * wall, w, z1])
    asm, body = Assembly(), Shape()
    body.add(tidy(case), face)
    pile = box([2 * wall, -half + 1.5 * wall, wall], [depth - 1.5 * wall, half - 1.5 * wall, z1])
    body.add(pile, materials.white_plastic(rng))
    root = asm.add("body", body)
    flap = box([0, -w + air, z0 + air], [wall, w - air, z1 - air])
    flap += box([-2 * unit, -0.4 * w, z1 - 6 * unit], [0.001, 0.4 * w, z1 - 3 * unit])
    joint = hinge((0, 0, z0 + air), (0, -1, 0), float(rng.uniform(0.7, 1.6)))
    shape = Shape().add(tidy(flap), tone if rng.random() < 0.6 else dataclasses.replace(face))
    asm.add("flap", shape, root, joint)
    lid = box([-unit, -half - unit, height + air], [depth + unit, half + unit, height + 3 * unit])
    joint = slide((0, 0, 1), float(rng.uniform(0.3, 0.7)) * height)
    if rng.random() < 0.7:
        joint = hinge((depth + unit, 0, height + air), (0, 1, 0), float(rng.uniform(0.9, 1.7)))
    asm.add("lid", Shape().add(lid, dataclasses.replace(face)), root, joint)
    return asm.object()


def _tape(rng: np.random.Generator) -> ArticulatedObject:
    """A heavy foot with two cheeks, a reel of tape between them, a blade in front."""
    radius = float(rng.uniform(0.03, 0.055))
    wide = radius * float(rng.uniform(0.45, 1.0))
    unit = radius / 30
    half, air, cheek = wide / 2, 0.6 * unit, 4 * unit
    face, tone = _plastic(rng), _accent(rng)
    long = radius * float(rng.uniform(3.2, 4.2))
    x, z = long - 1.3 * radius, radius * float(rng.uniform(1.15, 1.5))
    tip = radius * float(rng.uniform(0.7, 1.2))
    outside = half + cheek + air
    side = [[0, 0], [0, long], [0.8 * z, long], [z + 0.4 * radius, x + 0.4 * radius],
            [z + 0.4 * radius, x - 0.4 * radius], [0.5 * tip, 0.35 * long], [tip, 0.1 * long],
            [tip, 0]]  # fmt: skip
    solid = extrusion(np.array(side), "y", [0, -outside, 0], 2 * outside)
    well = cylinder("y", [x, -half - air, z], wide + 2 * air, radius + 2 * unit, segments=32)
    solid -= well
    core = float(rng.uniform(0.4, 0.62)) * radius
    axle = cylinder("y", [x, -half - 2 * air, z], wide + 4 * air, 0.3 * core, segments=16)
    asm, body = Assembly(), Shape()
    body.add(tidy(solid + axle), face)
    blade = box([-2 * unit, -half, tip - 3 * unit], [0, half, tip + 2 * unit])
    body.add(blade, materials.metal(rng, brushed=False))
    root = asm.add("body", body)
    ring_ = tube("y", [x, -half, z], wide, radius, core, 32)
    hub = tube("y", [x, -half, z], wide, core, 0.3 * core + air, 24)
    bars = [box([x - 0.2 * core, -half - 0.5 * air, z + 0.5 * core],
                [x + 0.2 * core, half + 0.5 * air, z + 0.9 * core])]  # fmt: skip
    tape = plain(materials.hsv(rng, (0.05, 0.2), (0.2, 0.6), (0.6, 0.95)))
    shape = Shape().add(ring_, tape if rng.random() < 0.6 else _clear(rng))
    shape.add(tidy(hub + bars[0] - ring_), tone)
    asm.add("reel", shape, root, turn((x, 0, z), (0, 1, 0)))
    return vessels.turned(asm.object(), float(rng.choice([0.0, 90.0, -90.0, 45.0, -45.0])))

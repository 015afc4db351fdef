"""Boxes: cartons with one, two or four flaps, and chests with a lid and a hasp."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    extrusion,
    hinge,
    pipe,
    tray,
    union,
)

# side -> axis about which a positive angle opens a flap that is hinged there
_OUTWARD = {"-x": (0, -1, 0), "+x": (0, 1, 0), "-y": (1, 0, 0), "+y": (-1, 0, 0)}


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A box, metres, closed."""
    return _chest(rng) if rng.random() < 0.35 else _carton(rng)


def _cardboard(rng: np.random.Generator) -> Material:
    if rng.random() < 0.65:
        return plain(np.array([0.72, 0.55, 0.36]) * rng.uniform(0.75, 1.15))
    return materials.paint(rng)


def _carton(rng: np.random.Generator) -> ArticulatedObject:
    size = np.array([rng.uniform(0.18, 0.5), rng.uniform(0.2, 0.6), rng.uniform(0.08, 0.45)])
    unit = float(size.max()) / 100
    count = int(rng.choice([1, 2, 4, 3], p=[0.3, 0.27, 0.33, 0.1]))
    wall = max(0.004, float(rng.uniform(1.8, 2.4)) * unit)
    air = 0.5 * unit
    (dx, dy, dz), face = size / 2 * [1, 1, 2], _cardboard(rng)
    inner = face.darker(0.85) if rng.random() < 0.5 else face
    low_sides, top_sides = ("-x", "+x"), ("-y", "+y")
    swapped = rng.random() < 0.5
    if swapped:
        low_sides, top_sides = top_sides, low_sides
    layered = count > 2  # flaps under flaps: their sides of the wall stand lower

    asm, body = Assembly(), Shape()
    shell = tray([-dx, -dy, 0], [dx, dy, dz], wall)
    step = wall + 2 * air
    if layered:
        half = np.array([dx, dy]) - (wall if swapped else 0, 0 if swapped else wall)
        gate = [1.0, half[1]] if not swapped else [half[0], 1.0]
        shell -= box([-gate[0], -gate[1], dz - step], [*gate, 1])
    body.add(shell, face)
    strip = float(rng.uniform(0.12, 0.3))
    if rng.random() < 0.7:  # a printed band, label or address field
        y, z = float(rng.uniform(0.3, 0.8)) * dy, float(rng.uniform(0.15, 0.3)) * dz
        at = float(rng.uniform(0.3, 0.6)) * dz
        body.add(box([-dx - 0.9 * unit, -y, at - z], [-dx, y, at + z * 0.6]), materials.paint(rng))
    root = asm.add("body", body)

    plans = []  # (side, layer, reach of the flap as a share of the way across)
    share = 0.5
    if count == 1:
        plans = [(str(rng.choice([*top_sides, "+x", "+x"])), 0, 1.0)]
    elif count == 2:
        share = float(rng.uniform(0.35, 0.65))
        plans = [(top_sides[0], 0, share), (top_sides[1], 0, 1 - share)]
    else:
        short = float(rng.uniform(0.25, 0.5))
        plans = [(s, 0, short) for s in low_sides[: count - 2]] + [(s, 1, 0.5) for s in top_sides]
    swing = float(np.deg2rad(rng.uniform(100, 178)))
    tape = count in (2, 4) and rng.random() < 0.4
    for side, layer, part in plans:
        axis, way = "xy".index(side[1]), 1 if side[0] == "+" else -1
        low = dz + air + (layer - (1 if layered else 0)) * step
        lo, hi = np.array([-dx, -dy, low]), np.array([dx, dy, low + wall])
        across = 2 * size[axis] / 2
        if way > 0:
            lo[axis] = hi[axis] - part * across + (0 if part == 1.0 else air)
        else:
            hi[axis] = lo[axis] + part * across - (0 if part == 1.0 else air)
        if layered and layer == 0:
            other = 1 - axis
            lo[other] += wall + air
            hi[other] -= wall + air
        hinge_at = (lo + hi) / 2
        hinge_at[axis], hinge_at[2] = (hi if way > 0 else lo)[axis], low
        flap = Shape()
        if (
            count == 1 and rng.random() < 0.6
        ):  # a tongue that tucks in, seen as a lip over the far edge
            lip_lo, lip_hi = lo.copy(), hi.copy()
            if way > 0:
                lip_lo[axis], lip_hi[axis] = lo[axis] - wall, lo[axis]
            else:
                lip_lo[axis], lip_hi[axis] = hi[axis], hi[axis] + wall
            lip_lo[2] = dz * float(rng.uniform(0.6, 0.85))
            gap = 0.6 * unit
            shift = np.zeros(3)
            shift[axis] = -way * gap
            bridge_lo, bridge_hi = np.minimum(lo, lip_lo + shift), np.maximum(hi, lip_hi + shift)
            bridge_lo[2] = low
            flap.add(union([box(bridge_lo, bridge_hi), box(lip_lo + shift, lip_hi + shift)]), face)
        else:
            flap.add(box(lo, hi), face if layer == 0 or rng.random() < 0.6 else inner)
        if tape and (layer == 1 or not layered):
            mid, band = 1 - axis, strip * size[1 - axis] / 2
            t_lo, t_hi = lo.copy(), hi.copy()
            t_lo[mid], t_hi[mid] = -band, band
            t_lo[2], t_hi[2] = hi[2], hi[2] + 0.7 * unit
            flap.add(box(t_lo, t_hi), plain((0.8, 0.68, 0.42)))
        angle = swing if layer else min(swing, float(np.deg2rad(rng.uniform(95, 178))))
        if layered and layer == 0:  # its hinge lies below the taller walls' top but clear of them
            angle = min(angle, float(np.deg2rad(170)))
        asm.add("flap", flap, root, hinge(hinge_at, _OUTWARD[side], angle))
    return asm.object()


def _chest(rng: np.random.Generator) -> ArticulatedObject:
    width, deep = float(rng.uniform(0.25, 0.9)), float(rng.uniform(0.2, 0.5))
    deep = min(deep, 0.8 * width)
    tall, cover = float(rng.uniform(0.4, 0.9)) * deep, float(rng.uniform(0.14, 0.4)) * deep
    unit = max(width, tall + cover, deep) / 100
    wall = float(rng.uniform(2.2, 3.4)) * unit
    face = materials.wood(rng, grain="y") if rng.random() < 0.7 else materials.paint(rng)
    iron = materials.hardware(rng)
    half = width / 2
    arched = rng.random() < 0.5

    asm, body = Assembly(), Shape()
    strap_y = (
        [s * half * float(rng.uniform(0.55, 0.75)) for s in (-1, 1)] if rng.random() < 0.6 else []
    )
    strap, proud = 2.2 * unit, 0.9 * unit
    body.add(tray([0, -half, 0], [deep, half, tall], wall), face)
    for y in strap_y:
        body.add(box([-proud, y - strap, 0], [0, y + strap, tall]), iron)
    if rng.random() < 0.6:  # carrying handles
        for s in (-1, 1):
            y, x, z, r = s * half, deep / 2, 0.6 * tall, 1.0 * unit
            ring = [
                [x - 0.18 * deep, y, z],
                [x - 0.16 * deep, y + s * 3.5 * unit, z - 2 * unit],
                [x + 0.16 * deep, y + s * 3.5 * unit, z - 2 * unit],
                [x + 0.18 * deep, y, z],
            ]
            body.add(cut(pipe(ring, r), (box([-1, -half, -1], [2, half, 2]),)), iron)
    if rng.random() < 0.5:
        body.add(
            box([-proud, -half - proud, 0], [deep, half + proud, 3 * unit])
            - box([0, -half, -1], [deep + 1, half, 1])
            - union(
                [box([-1, y - strap, 0], [0, y + strap, tall]) for y in strap_y]
                or [box([5, 5, 5], [6, 6, 6])]
            ),
            iron,
        )
    root = asm.add("body", body)

    low = tall + 0.6 * unit
    if arched:
        t = np.linspace(0, np.pi, 13)
        flat = 0.35 * cover
        arch = np.column_stack([flat + (cover - flat) * np.sin(t), deep / 2 - deep / 2 * np.cos(t)])
        profile = np.vstack([[[0, 0]], arch, [[0, deep]]])  # (z, x)
        shrink = (np.array([cover, deep]) - 2 * wall) / (cover, deep)
        room = (profile - [0, deep / 2]) * [max(shrink[0], 0.3), shrink[1]] + [-1e-4, deep / 2]
        room[0, 0] = room[-1, 0] = -0.01
        shell = extrusion(profile, "y", [0, -half, low], width)
        shell -= extrusion(room, "y", [0, -half + wall, low], width - 2 * wall)
    else:
        shell = box([0, -half, low], [deep, half, low + cover])
        shell -= box([wall, -half + wall, low - 1], [deep - wall, half - wall, low + cover - wall])
    lid = Shape().add(shell, face)
    for y in strap_y:
        lid.add(
            box([-proud, y - strap, low], [0, y + strap, low + (0.3 if arched else 1.0) * cover]),
            iron,
        )
    swing = float(np.deg2rad(rng.uniform(75, 115)))
    top = asm.add("lid", lid, root, hinge((deep, 0, low), (0, 1, 0), swing))
    if rng.random() < 0.75:  # a hasp that hangs from the lid over the seam
        y, hang = max(3.0 * unit, 0.04 * width), float(rng.uniform(0.25, 0.45)) * tall
        z = low + 0.22 * cover
        thick, gap = 1.9 * unit, 0.5 * unit
        plate = box([-gap - thick, -y, z - hang], [-gap, y, z])
        if rng.random() < 0.5:
            plate -= box([-1, -0.4 * y, z - 0.8 * hang], [1, 0.4 * y, z - 0.55 * hang])
        hasp = Shape().add(plate, iron)
        joint = hinge((-gap - thick, 0, z), (0, 1, 0), float(np.deg2rad(rng.uniform(80, 150))))
        asm.add("hasp", hasp, top, joint)
    return asm.object()

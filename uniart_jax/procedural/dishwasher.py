"""Dishwashers: a door hinged at the bottom, racks that pull out, controls on the door or above
it."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import appliances, finishes, materials
from uniart_jax.procedural.fronts import add_door, add_drawer, add_knob
from uniart_jax.procedural.shapes import Assembly, Shape, box, cut, hinge, slide


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A dishwasher, metres, closed: with a door, or one or two drawers that hold the tubs."""
    return _drawers(rng) if rng.random() < 0.12 else _with_door(rng)


def _drawers(rng: np.random.Generator) -> ArticulatedObject:
    """Drawers over the whole front."""
    width, height = float(rng.uniform(0.45, 0.75)), float(rng.uniform(0.4, 0.92))
    depth = float(rng.uniform(0.5, 0.68))
    unit = max(width, height, depth) / 100
    face = finishes.appliance(rng)
    look = appliances.style(
        rng, unit, face, panels=("slab", "slab", "border"),
        handles=("bar", "round_bar", "arch", "recess", "lip"),
    )  # fmt: skip
    look = dataclasses.replace(look, thickness=max(0.02, float(rng.uniform(2.0, 5.0)) * unit))
    legs, half = float(rng.uniform(0.0, 0.12)), width / 2
    wall = max(0.018, float(rng.uniform(1.7, 2.6)) * unit)
    count = 2 if height > 0.7 and rng.random() < 0.6 else 1
    cells = np.linspace(legs, height, count + 1)
    asm, body = Assembly(), Shape()
    if legs > 0.02:
        appliances.feet(body, rng, width, depth, legs, unit)
    bays = []
    for k, (a, b) in enumerate(itertools.pairwise(cells)):
        under, over = wall / (1 if k == 0 else 2), wall / (1 if k == count - 1 else 2)
        lo = np.array([0.0, wall - half, a + under])
        bays.append((lo, np.array([depth - wall, half - wall, b - over])))
    case = face if rng.random() < 0.5 else face.darker(float(rng.uniform(0.3, 0.9)))
    shell = box([0, -half, legs], [depth, half, height])
    body.add(cut(shell, [box([-0.1, *lo[1:]], hi) for lo, hi in bays]), case)
    root, seam = asm.add("body", body), max(0.002, float(rng.uniform(0.2, 0.7)) * unit)
    pull = float(rng.uniform(0.5, 0.95))
    for (a, b), (lo, hi) in zip(itertools.pairwise(cells), bays, strict=True):
        front_lo = np.array([-look.thickness - 0.002, 0.001 - half, a + seam / 2])
        front_hi = np.array([-0.002, half - 0.001, b - seam / 2])
        fill, deep = float(rng.uniform(0.6, 0.95)), float(rng.uniform(0.8, 0.99))
        add_drawer(
            asm, root, front_lo, front_hi, lo, hi, pull, look, center=False, fill=fill, depth=deep
        )
    return asm.object()


def _with_door(rng: np.random.Generator) -> ArticulatedObject:
    slim = rng.random() < 0.25
    width = float(rng.uniform(0.44, 0.48) if slim else rng.uniform(0.55, 0.7))
    height = float(rng.uniform(0.45, 0.62) if rng.random() < 0.25 else rng.uniform(0.72, 0.92))
    depth = float(rng.uniform(0.5, 0.65))
    unit = max(width, height, depth) / 100
    face = finishes.appliance(rng)
    look = appliances.style(
        rng, unit, face, panels=("slab", "slab", "slab", "shaker", "border"),
        handles=("bar", "bar", "round_bar", "arch", "recess", "lip"),
    )  # fmt: skip
    deep = 6.0 if rng.random() < 0.6 else 12.0
    thick = max(0.02, float(rng.uniform(2.2, deep)) * unit)
    look = dataclasses.replace(look, thickness=thick)
    wall = max(0.02, float(rng.uniform(1.8, 3.0)) * unit)
    legs = float(rng.uniform(0.02, 0.13))
    if rng.random() < 0.12:  # a fixed panel below the door
        legs = float(rng.uniform(0.2, 0.42)) * height
    case = face if rng.random() < 0.6 else face.darker(float(rng.uniform(0.3, 0.9)))
    half = width / 2

    asm, body = Assembly(), Shape()
    if legs > 0.15:
        body.add(box([float(rng.uniform(0, 0.05)), -half, 0], [depth, half, legs]), case)
    else:
        appliances.feet(body, rng, width, depth, legs, unit)
    controls = str(rng.choice(["strip", "door", "hidden"], p=[0.35, 0.35, 0.3]))
    strip = float(rng.uniform(0.09, 0.15)) * height if controls == "strip" else 0.0
    top = 0.0 if rng.random() < 0.6 else max(0.02, 1.8 * unit)
    ceiling = height - top - strip
    tub_lo, tub_hi = (
        np.array([0.0, -half + wall, legs + wall]),
        np.array([depth - wall, half - wall, ceiling - wall]),
    )
    body.add(
        cut(
            box([0, -half, legs], [depth, half, height - top]), (box([-0.1, *tub_lo[1:]], tub_hi),)
        ),
        case,
    )
    panel = finishes.dark(rng) if rng.random() < 0.5 else face
    front = -thick - 0.002
    if strip:
        seam = 0.5 * unit
        body.add(box([front, -half, ceiling + seam], [0, half, height - top]), panel)
        _controls(rng, body, front, half, (ceiling + seam, height - top), unit)
    if top:
        over = thick if rng.random() < 0.7 else 0.0
        slab = finishes.wood(rng) if rng.random() < 0.3 else materials.stone(rng)
        body.add(box([-over, -half, height - top], [depth, half, height]), slab.along("y"))
    root = asm.add("body", body)

    lo = np.array([front, -half + 0.002, legs - (0.6 * legs if rng.random() < 0.3 else 0)])
    hi = np.array([-0.002, half - 0.002, ceiling - 0.004])
    extra = Shape()
    if controls == "door":
        z = (hi[2] - 0.12 * height, hi[2] - 0.02 * height)
        _controls(rng, extra, front, half, z, unit)
        look = dataclasses.replace(
            look, handle=str(rng.choice(["bar", "arch", "recess"])), panel="slab"
        )
    angle = np.pi / 2 if rng.random() < 0.6 else float(np.deg2rad(rng.uniform(70, 95)))
    if controls == "door":  # the handle below the controls
        door = _door_below(asm, root, lo, hi, angle, look, extra, 0.15 * height, rng)
        if rng.random() < 0.4:
            r = max(0.018, 2.2 * unit)
            at = (front, (half - 1.6 * r) * rng.choice([-1, 1]), hi[2] - 0.07 * height)
            finish = materials.hardware(rng)
            add_knob(asm, door, at, r, max(0.022, 2.2 * unit), finish, finish.darker(0.4), None)
    else:
        door = add_door(asm, root, lo, hi, "-z", angle, look)

    count = int(rng.choice([0, 1, 2, 3], p=[0.38, 0.14, 0.36, 0.12]))
    wire = max(0.014, 1.6 * unit)
    steel = (
        finishes.metal(rng, brushed=False)
        if rng.random() < 0.5
        else materials.plain(rng.uniform(0.3, 0.9, 3) * [0.5, 0.7, 1])
    )
    floor = tub_lo[2]
    if count:  # racks roll out over the door: it opens flat, and they stand above it
        opened = hinge(
            (lo + hi) / 2 * [0, 1, 0] + [lo[0], 0, lo[2]], (0, -1, 0), max(angle, np.pi / 2)
        )
        asm.parts[door] = dataclasses.replace(asm.parts[door], joint=opened)
        floor = max(floor, lo[2] + asm.parts[door].mesh.bounds[1, 0] - lo[0])
    zs = np.linspace(floor, tub_hi[2], count + 1)
    pull = float(rng.uniform(0.5, 0.9))
    for k in range(count):
        tall = (zs[k + 1] - zs[k]) * float(rng.uniform(0.4, 0.6))
        r_lo = [0.02, tub_lo[1] + 0.012, zs[k] + 0.015]
        r_hi = [tub_hi[0] - 0.02, tub_hi[1] - 0.012, zs[k] + 0.015 + max(tall, 3 * wire)]
        solid = appliances.rack(r_lo, r_hi, wire, int(rng.integers(3, 6)))
        asm.add(
            "rack", Shape().add(solid, steel), root, slide((-1, 0, 0), pull * (r_hi[0] - r_lo[0]))
        )
    return asm.object()


def _controls(
    rng, shape: Shape, front: float, half: float, z: tuple[float, float], unit: float
) -> None:
    """A display and some buttons on the plane x = ``front``."""
    side, tall = float(rng.choice([-1, 1])), z[1] - z[0]
    lo, hi = z[0] + 0.25 * tall, z[1] - 0.25 * tall
    a, b = sorted((side * 0.15 * half, side * 0.6 * half))
    proud = max(0.003, 0.5 * unit)
    if rng.random() < 0.6:
        appliances.display(
            shape, front, (-0.14 * half, 0.12 * half), (lo, hi), proud, materials.dark_glass(rng)
        )
        a, b = sorted((side * 0.25 * half, side * 0.7 * half))
    if rng.random() < 0.8:
        appliances.buttons(shape, rng, front, (a, b), (lo, hi), unit, materials.hardware(rng))


def _door_below(
    asm: Assembly, root: int, lo, hi, angle: float, look, extra: Shape, band: float, rng
) -> int:
    """A door whose top band carries the controls; its handle sits right below."""
    split = hi[2] - band
    shape = Shape().add(
        box([lo[0], lo[1], split], hi), look.face.darker(0.8) if rng.random() < 0.5 else look.face
    )
    return add_door(
        asm, root, lo, [hi[0], hi[1], split], "-z", angle, look, extra=shape.join(extra)
    )

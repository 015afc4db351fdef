"""Telescopes, cameras and lamps on tripods."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.globe_stands import draw_finish
from uniart_jax.procedural.materials import plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cylinder,
    hinge,
    pipe,
    slide,
    tidy,
    turn,
    union,
)


def tripod(rng: np.random.Generator) -> ArticulatedObject:
    """A telescope, a camera or a lamp in metres that pans and tilts on three legs. At times the
    column slides or the legs fold."""
    low_one = rng.random() < 0.3
    apex = float(rng.uniform(0.12, 0.25)) if low_one else float(rng.uniform(0.4, 0.9))
    size = float(rng.uniform(0.07, 0.12)) if low_one else float(rng.uniform(0.14, 0.26))
    unit = (apex + 2 * size) / 100
    r, air = float(rng.uniform(1.1, 2.0)) * unit, 0.4 * unit
    finish, metal, dark = draw_finish(rng), materials.metal(rng, brushed=False), materials.dark(rng)
    hub, spread = 4 * unit, float(rng.uniform(0.32, 0.55))
    asm, body = Assembly(), Shape()
    column = cylinder("z", [0, 0, 0.5 * apex], apex - 0.5 * apex, 2 * unit, segments=16)
    core = cylinder("z", [0, 0, apex - 6 * unit], 6 * unit, hub, segments=24)
    folds = rng.random() < 0.3
    rise = not folds and rng.random() < 0.4
    hollow = cylinder("z", [0, 0, -1], 9, 1.9 * unit + air, segments=16)
    turned = float(rng.uniform(0, 2))
    legs = []
    for k in range(3):
        a = turned + 2 * np.pi * k / 3
        way = np.array([np.cos(a), np.sin(a), 0])
        start = way * (hub + (r + air if folds else 0)) + [0, 0, apex - 3.5 * unit]
        end = start + way * np.tan(spread) * (start[2] - r) - [0, 0, start[2] - r]
        middle = start + 0.55 * (end - start)
        leg = Shape().add(
            union([pipe([start, middle], r, 10), pipe([middle, end], 0.75 * r, 10)]), finish
        )
        legs.append((leg, start, np.cross([0, 0, 1], way)))
    solid = core + column
    if rise:
        sleeve = cylinder("z", [0, 0, 0.5 * apex], 0.5 * apex, 3.0 * unit, segments=18)
        solid = tidy((core + sleeve) - hollow)
    body.add(solid, dark)
    if not folds:
        together = union([leg.solid() for leg, *_ in legs])
        together = together - solid - hollow if rise else together - solid
        body.add(tidy(together), finish)
    root = asm.add("tripod", body)
    for leg, start, way in legs if folds else ():
        asm.add("leg", leg, root, hinge(start, way, 0.8 * spread))
    top = apex
    if rise:
        rod = cylinder(
            "z", [0, 0, 0.52 * apex], apex + 8 * unit - 0.52 * apex, 1.9 * unit, segments=16
        )
        top = apex + 8 * unit
        root = asm.add("column", Shape().add(rod, metal), root, slide((0, 0, 1), 0.35 * apex))
    pivot = np.array([0, 0, top + air + 7.5 * unit])
    s, half = 2.4 * unit, 2.0 * unit
    plate = cylinder("z", [0, 0, top + air], 3 * unit, 3.6 * unit, segments=22)
    pan = [plate]
    for y in (-half - air - 1.4 * unit, half + air):
        pan += [
            cylinder("y", [0, y, pivot[2]], 1.4 * unit, s, segments=16),
            box([-s, y, top + air + unit], [s, y + 1.4 * unit, pivot[2]]),
        ]
    grip = []
    if rng.random() < 0.5:  # a bar to steer with
        far = float(rng.uniform(12, 20)) * unit
        z = top + air + 1.5 * unit
        low = z - (0.5 if folds else 1.0) * far  # above legs that fold
        grip = [pipe([[3 * unit, 0, z], [far, 0, low]], 0.9 * unit, 10)]
    head = asm.add(
        "pan_head",
        Shape().add(tidy(union([*pan, *grip])), dark),
        root,
        turn((0, 0, top), (0, 0, 1)),
    )
    shape, lens = _draw_device(rng, size, pivot[2] + 3.2 * unit, unit, finish, metal, dark)
    lug = union(
        [
            cylinder("y", [0, -half, pivot[2]], 2 * half, s, segments=16),
            box([-s, -half, pivot[2]], [s, half, pivot[2] + 3.2 * unit + 0.2 * size]),
        ]
    )
    shape.add(tidy(lug - shape.solid()), dark)
    up = float(rng.uniform(0.35, 0.7)) * float(rng.choice([-1, 1], p=[0.25, 0.75]))
    device = asm.add("device", shape, head, hinge(pivot, (0, 1, 0), up))
    if lens is not None:
        name, part, joint = lens
        asm.add(name, part, device, joint)
    return asm.object()


def _draw_device(rng, size, z, unit, finish, metal, dark) -> tuple[Shape, tuple | None]:
    """A device above the plane ``z`` that looks along -x, and its moving part if it has one: (name,
    shape, joint)."""
    shape = Shape()
    air = 0.4 * unit
    kind = str(rng.choice(["telescope", "camera", "lamp"], p=[0.42, 0.33, 0.25]))
    tone = finish if rng.random() < 0.4 else plain(rng.uniform(0.1, 0.95, 3))
    if kind == "telescope":
        r, long = size * float(rng.uniform(0.22, 0.5)), size * float(rng.uniform(1.6, 3.4))
        mid = z + r
        share = float(rng.uniform(0.45, 0.6))
        barrel = cylinder(
            "x", [-share * long, 0, mid], long, r, float(rng.uniform(0.7, 1.0)) * r, 26
        )
        shape.add(barrel, tone)
        hood = cylinder("x", [-(share + 0.16) * long, 0, mid], 0.16 * long, 1.15 * r, segments=26)
        hood -= cylinder("x", [-(share + 0.2) * long, 0, mid], 0.16 * long, 0.95 * r, segments=26)
        shape.add(hood, metal)
        end = (1 - share) * long
        eye = cylinder("x", [end, 0, mid], 0.12 * long, 0.4 * r, segments=18)
        shape.add(eye, dark)
        if rng.random() < 0.6:  # a finder
            finder = cylinder("x", [0, 0, mid + 1.5 * r], 0.4 * long, 0.25 * r, segments=14)
            posts = [
                box([x, -0.1 * r, mid + 0.9 * r], [x + 0.2 * r, 0.1 * r, mid + 1.5 * r])
                for x in (0.08 * long, 0.3 * long)
            ]
            shape.add(tidy(union([finder, *posts]) - barrel), dark)
        cap = cylinder(
            "x",
            [end + 0.12 * long + air, 0, mid],
            0.12 * long,
            max(0.55 * r, 2 * unit),
            segments=18,
        )
        return shape, ("eyepiece", Shape().add(cap, dark), turn((0, 0, mid), (1, 0, 0)))
    if kind == "camera":
        wide, tall, deep = (
            size * float(rng.uniform(0.5, 0.8)),
            size * float(rng.uniform(0.6, 1.0)),
            size * float(rng.uniform(0.35, 1.0)),
        )
        shape.add(box([-deep / 2, -wide, z], [deep / 2, wide, z + tall]), tone)
        r = float(rng.uniform(0.5, 0.8)) * min(wide, tall / 2)
        bump = box([-0.3 * deep, -0.4 * wide, z + tall], [0.3 * deep, 0.4 * wide, z + 1.2 * tall])
        shape.add(bump, dark)
        mid = z + tall / 2
        mount = cylinder("x", [-deep / 2 - 0.3 * r, 0, mid], 0.3 * r, r, segments=24)
        shape.add(mount, metal)
        if rng.random() < 0.5:  # a screen that folds out behind, hinged at its side
            thick = 2 * unit
            screen = box(
                [deep / 2 + air, -0.85 * wide, z + 0.15 * tall],
                [deep / 2 + air + thick, 0.85 * wide, z + 0.85 * tall],
            )
            joint = hinge(
                (deep / 2 + air + thick, 0.85 * wide, mid), (0, 0, 1), float(rng.uniform(1.5, 2.6))
            )
            lens = cylinder("x", [-deep / 2 - 1.4 * r, 0, mid], 1.1 * r, 0.9 * r, segments=24)
            shape.add(lens, dark)
            return shape, ("screen", Shape().add(screen, dark), joint)
        long = r * float(rng.uniform(0.8, 2.5))
        x = -deep / 2 - 0.3 * r - air
        lens = cylinder("x", [x - long, 0, mid], long, 0.95 * r, 0.9 * r, 24)
        lens -= cylinder("x", [x - long - 1, 0, mid], 1 + 0.3 * long, 0.75 * r, segments=20)
        ridge = box(
            [x - 0.7 * long, -1.2 * unit, mid + 0.8 * r],
            [x - 0.3 * long, 1.2 * unit, mid + 1.15 * r],
        )
        return shape, ("lens", Shape().add(tidy(lens + ridge), dark), turn((x, 0, mid), (1, 0, 0)))
    r, deep = 0.6 * size, size * float(rng.uniform(0.5, 1.0))
    mid = z + r
    square = rng.random() < 0.5
    can = (
        box([-deep / 2, -r, z], [deep / 2, r, mid + r])
        if square
        else cylinder("x", [-deep / 2, 0, mid], deep, r, float(rng.uniform(0.5, 1)) * r, 26)
    )
    shape.add(can, tone)
    glow = (
        box([-deep / 2 - unit, -0.85 * r, mid - 0.85 * r], [-deep / 2, 0.85 * r, mid + 0.85 * r])
        if square
        else (cylinder("x", [-deep / 2 - unit, 0, mid], unit, 0.9 * r, segments=24))
    )
    shape.add(glow, plain((1.0, 0.96, 0.8)))
    if not square:
        return shape, None
    x = -deep / 2 - unit - air
    flap = box([x - 2 * unit, -0.95 * r, mid - 0.95 * r], [x, 0.95 * r, mid + 0.95 * r])
    return shape, (
        "flap",
        Shape().add(flap, dark),
        hinge((x - 2 * unit, 0, mid + 0.95 * r), (0, 1, 0), 2.0),
    )

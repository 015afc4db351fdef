"""Parts that grills share: finishes, wheels, folding side shelves, handles and slotted grates.
Lengths are in metres; ``unit`` is a hundredth of the object's size."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.shapes import (
    Shape,
    box,
    cut,
    cylinder,
    extrusion,
    hinge,
    pipe,
    rounded,
    turn,
)


def draw_finish(rng: np.random.Generator) -> Material:
    """Draw the finish of a grill's body: black, a strong colour, steel or paint."""
    kind = rng.choice(4, p=[0.4, 0.3, 0.2, 0.1])
    if kind == 0:
        return materials.dark(rng)
    if kind == 1:
        return plain(rng.uniform([0.05] * 3, [0.85, 0.65, 0.7]))
    return materials.metal(rng) if kind == 2 else materials.paint(rng)


def draw_board(rng: np.random.Generator) -> Material:
    """Draw the finish of side shelves: wood, dark plastic or steel."""
    if rng.random() < 0.5:
        return materials.wood(rng, grain="y")
    return materials.dark(rng) if rng.random() < 0.5 else materials.metal(rng)


def add_wheel(asm, root, at, r, wide, side, steel: Material) -> None:
    """Add a wheel of radius ``r`` that turns about y, ``wide`` metres wide, beside the plane y =
    ``at[1]``. Its hub is ``steel``."""
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


def add_side_shelf(rng, asm, root, y, side, x, z, long, deep, unit, board: Material) -> None:
    """Add a side shelf that folds about x at the plane ``y``, level or hanging down at rest.

    ``side``: 1 towards +y, -1 towards -y. ``x``: its middle. ``z``: its upper edge. ``long``:
    how far it reaches out. ``deep``: its extent along x. All are in metres.
    """
    thick, air = 2.2 * unit, 0.4 * unit
    a, b = y + side * air, y + side * (air + long)
    lo, hi = sorted((a, b))
    if rng.random() < 0.65:
        outline = rounded(deep, long, float(rng.uniform(0.02, 0.3)) * min(deep, long))
        plate = extrusion(outline, "z", [x, (lo + hi) / 2, z - thick], thick)
        joint = hinge((x, a, z - thick), (-side, 0, 0), float(rng.uniform(1.3, 1.57)))
        slots = []
        if rng.random() < 0.4:
            a0, a1, w = lo + 0.15 * long, hi - 0.15 * long, 0.06 * deep
            middles = [x + k * deep for k in (-0.3, -0.1, 0.1, 0.3)]
            slots = [box([m - w, a0, -1], [m + w, a1, 9]) for m in middles]
        plate = cut(plate, slots)
    else:  # hangs down
        t = sorted((a, a + side * thick))
        plate = box([x - deep / 2, t[0], z - long], [x + deep / 2, t[1], z])
        joint = hinge((x, a + side * thick, z), (side, 0, 0), float(np.pi / 2))
    asm.add("side_shelf", Shape().add(plate, board), root, joint)


def handle(start, end, out, r) -> Manifold:
    """A bar of radius ``r`` (metres) that stands off a face by ``out`` (x, z), on feet at ``start``
    and ``end``."""
    away = [out[0], 0, out[1]]
    return pipe([start, np.add(start, away), np.add(end, away), end], r, 10)


def handle_across(half, x, z, out, r) -> Manifold:
    """A handle along y through the point (x, z), ``half`` metres to each side."""
    return handle([x, -half, z], [x, half, z], out, r)


def grate_slots(x0, x1, half, count, spare=0, share=0.7, top=3.0) -> list[Manifold]:
    """Slots along x, from ``x0`` to ``x1`` (metres), to cut through a grate that reaches ``half``
    to each side. There are ``count`` places, of which ``spare`` at each end stay uncut. Each slot
    spans 0.2 to ``share`` of its pitch and z = 0 to ``top``."""
    pitch = 2 * half / count
    return [
        box([x0, -half + (k + 0.2) * pitch, 0], [x1, -half + (k + share) * pitch, top])
        for k in range(spare, count - spare)
    ]

"""Parts that coffee machines share: finishes, columns, lids, drip trays, buttons, knobs and jugs.
Lengths are in metres; ``unit`` is a hundredth of the object's size."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.procedural import materials
from uniart_jax.procedural.fronts import add_knob
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.shapes import (
    Shape,
    box,
    cut,
    cylinder,
    extrusion,
    hinge,
    pipe,
    revolution,
    rounded,
    slide,
    tidy,
    union,
)


def draw_finish(rng: np.random.Generator) -> Material:
    """Draw the finish of a body: steel, white, black or any colour."""
    return materials.appliance(rng) if rng.random() < 0.7 else plain(rng.uniform(0.1, 0.9, 3))


def draw_trim(rng: np.random.Generator, face: Material) -> Material:
    """Draw the finish of handles and trays, mostly unlike that of the body, ``face``."""
    if sum(face.color) > 1.0 and rng.random() < 0.6:
        return materials.dark(rng)
    return materials.hardware(rng) if rng.random() < 0.75 else materials.wood(rng, textured=False)


def column(depth, half, low, high, corner, start=0.0) -> Manifold:
    """An upright body in metres from x = ``start`` to ``depth`` with rounded vertical edges."""
    outline = rounded(depth - start, 2 * half, corner)
    return extrusion(outline, "z", [(start + depth) / 2, 0, low], high - low)


def add_lid(rng, asm, root, lo, hi, top, unit, finish) -> None:
    """Add a flat lid on the plane z = ``top``, from ``lo`` to ``hi`` (x, y, metres). It is hinged
    at the rear or a side, or lifts off."""
    thick, air = float(rng.uniform(1.8, 4)) * unit, 0.3 * unit
    size = np.subtract(hi, lo)
    center = np.add(lo, hi) / 2
    outline = rounded(size[0], size[1], float(rng.uniform(0.02, 0.3)) * size.min())
    plate = extrusion(outline, "z", [*center, top + air], thick)
    tab = box(
        [lo[0] - 1.5 * unit, center[1] - 4 * unit, top + air + 0.3 * thick],
        [lo[0] + 2 * unit, center[1] + 4 * unit, top + air + 0.8 * thick],
    )
    manner = str(rng.choice(["rear", "side", "lift"], p=[0.65, 0.2, 0.15]))
    swing = float(np.deg2rad(rng.uniform(60, 91)))
    z = top + air
    if manner == "rear":
        joint = hinge((hi[0], 0, z), (0, 1, 0), swing)
        plate += tab
    elif manner == "side":
        joint = hinge((0, hi[1], z), (-1, 0, 0), swing)
    else:
        r = min(0.22 * size.min(), 4 * unit)
        plate += cylinder("z", [*center, z + 0.5 * thick], 0.5 * thick + 3 * unit, 0.8 * r, r)
        joint = slide((0, 0, 1), float(rng.uniform(15, 30)) * unit)
    asm.add("lid", Shape().add(tidy(plate), finish), root, joint)


def add_drip_tray(rng, asm, root, lo, hi, unit, trim: Material) -> None:
    """Add a drip tray with a slotted top from ``lo`` to ``hi`` (metres), in a recess of the base.
    It slides out to the front."""
    lo, hi = np.array(lo), np.array(hi)
    slots = []
    count = int(rng.integers(4, 9))
    across = rng.random() < 0.5
    for k in range(count):
        a, b = lo + 2 * unit, hi - 2 * unit
        axis = 1 if across else 0
        pitch = (b[axis] - a[axis]) / count
        a[axis], b[axis] = a[axis] + (k + 0.25) * pitch, a[axis] + (k + 0.75) * pitch
        slots.append(box([*a[:2], hi[2] - 1.2 * unit], [*b[:2], hi[2] + 1]))
    solid = cut(box(lo, hi), slots)
    proud = float(rng.uniform(0.8, 3)) * unit
    if rng.random() < 0.5:
        middle = (lo + hi) / 2
        outline = rounded(2 * proud, hi[1] - lo[1], proud)
        solid += extrusion(outline, "z", [lo[0], middle[1], lo[2]], hi[2] - lo[2])
    travel = float(rng.uniform(0.5, 0.9)) * (hi[0] - lo[0])
    asm.add("drip_tray", Shape().add(tidy(solid), trim), root, slide((-1, 0, 0), travel))


def add_buttons(rng, asm, root, x, ys, z, r, finish: Material) -> None:
    """Add push buttons of radius ``r`` (metres) on the plane ``x``."""
    square = rng.random() < 0.4
    deep = 1.2 * r
    for y in ys:
        button = cylinder("x", [x - deep, y, z], 1.9 * deep, r, segments=16)
        if square:
            button = box([x - deep, y - r, z - 0.8 * r], [x + 0.9 * deep, y + r, z + 0.8 * r])
        asm.add("button", Shape().add(button, finish), root, slide((1, 0, 0), 0.6 * deep))


def button_wells(x, ys, z, r) -> list[Manifold]:
    """The holes (metres) to cut for ``add_buttons``."""
    return [
        box([x - 1, y - 1.1 * r, z - 1.1 * r], [x + 2 * r, y + 1.1 * r, z + 1.1 * r]) for y in ys
    ]


def add_knobs(rng, asm, root, x, half, z, room, unit, trim) -> None:
    """Add one to three knobs on the plane ``x`` at the height ``z`` (metres), within ``room`` above
    and below. None are added where they do not fit."""
    r = min(float(rng.uniform(2.6, 4.5)) * unit, 0.8 * room)
    count = int(rng.integers(1, 4))
    ys = np.linspace(-0.6, 0.6, count) * half
    if count == 1:
        ys = [float(rng.uniform(-0.5, 0.5)) * half]
    if count * 2.6 * r > 2 * half:
        return
    mark = plain(np.ones(3) * (0.1 if sum(trim.color) > 1.5 else 0.93))
    for y in ys:
        limited = rng.random() < 0.6
        sweep = float(np.deg2rad(rng.choice([90, 180, 270]))) if limited else None
        look = {"pointer": limited, "skirt": rng.random() < 0.4}
        add_knob(asm, root, (x, y, z), r, 1.1 * r, trim, mark, sweep, **look)


def draw_jug(rng, x, low, high, radius, unit, trim) -> Shape:
    """A glass or steel jug in metres with a handle towards the front."""
    tall = high - low
    neck = radius * float(rng.uniform(0.55, 0.95))
    belly = float(rng.uniform(0.2, 0.5))
    steel = rng.random() < 0.25
    glass = materials.metal(rng) if steel else materials.glass(rng)
    t = np.linspace(0, 1, 7)[1:]
    z = low + 0.86 * tall * (belly + (1 - belly) * t)
    r = neck + (radius - neck) * np.cos(t * np.pi / 2) ** 0.8
    profile = [
        [0, low],
        [0.88 * radius, low],
        [radius, low + 0.86 * tall * belly * 0.4],
        [radius, low + 0.86 * tall * belly],
        *np.column_stack([r, z]),
        [0, z[-1]],
    ]
    solid = revolution(np.array(profile), "z", [x, 0, 0], 28)
    cap = cylinder("z", [x, 0, low + 0.86 * tall], 0.14 * tall, 1.03 * neck, 0.9 * neck, 24)
    out, bar = radius * float(rng.uniform(1.35, 1.6)), 1.4 * unit
    line = [
        [x - 0.9 * neck, 0, low + 0.88 * tall],
        [x - out, 0, low + 0.88 * tall],
        [x - 0.97 * out, 0, low + 0.3 * tall],
        [x - 0.95 * radius, 0, low + 0.25 * tall],
    ]
    shape = Shape()
    if not steel:
        fill = low + tall * float(rng.uniform(0.15, 0.6))
        coffee = box([x - 1, -1, low - 1], [x + 1, 1, fill])
        shape.add(tidy(solid ^ coffee), plain((0.16, 0.08, 0.04)))
        shape.add(tidy(solid - coffee), glass)
    else:
        shape.add(solid, glass)
    return shape.add(tidy(cut(union([cap, pipe(line, bar, 10)]), [solid])), trim)

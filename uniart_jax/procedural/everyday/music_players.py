"""Music boxes with a crank, a drum or a dancer; cassette radios and tape machines with flaps, keys,
knobs and reels. Lengths are in metres."""

from __future__ import annotations

import numpy as np

from uniart_jax.procedural import materials
from uniart_jax.procedural.fronts import add_knob
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.pieces import layered, merged
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    ball,
    box,
    cylinder,
    extrusion,
    hinge,
    inset,
    pipe,
    rounded,
    slide,
    tidy,
    turn,
    union,
)

UP, ACROSS = (0, 0, 1), (0, 1, 0)


def draw_finish(rng: np.random.Generator, wooden: float) -> Material:
    """Draw a finish: wood with the probability ``wooden``, else plastic of any colour, steel, black
    or white."""
    if rng.random() < wooden:
        return materials.wood(rng)
    return materials.casing(rng, (0.2, 0.2, 0.25, 0.35))


def add_crank(
    rng, asm: Assembly, parent: int, at, side: float, size: float, trim: Material
) -> None:
    """Add a crank in the side wall y = ``at[1]`` (metres): a shaft, an arm and a grip that points
    outwards."""
    x, y, z = at
    r, out = 0.17 * size, 0.65 * size
    angle = float(rng.uniform(0, 2 * np.pi))
    tip = [x + size * np.cos(angle), y + side * out, z + size * np.sin(angle)]
    line = [[x, y + side * (r + 0.05 * size), z], [x, y + side * out, z], tip]
    grip = [tip, [tip[0], tip[1] + side * 0.6 * size, tip[2]]]
    arm = pipe(line, r, 8)
    knob = pipe(grip, 1.6 * r, 8) if rng.random() < 0.6 else ball(grip[1], 2.2 * r)
    rod = union([arm, pipe(grip, r, 8)])
    tone = materials.wood(rng, textured=False) if rng.random() < 0.5 else materials.dark(rng)
    pieces = layered([(knob, tone), (rod, trim)])
    asm.add("crank", pieces, parent, turn([x, 0, z], ACROSS))


def musical_box(rng: np.random.Generator) -> Assembly:
    """A music box in metres with a crank; a drum or a dancer turns under its lid or on its open
    top."""
    wide = float(rng.uniform(0.08, 0.24))
    depth = wide * float(rng.uniform(0.6, 1.05))
    unit, half = wide / 100, wide / 2
    high, wall = float(rng.uniform(28, 60)) * unit, 4 * unit
    tone, trim = draw_finish(rng, 0.65), materials.hardware(rng)
    plan = rounded(depth, wide, float(rng.uniform(0.3, 14)) * unit, 5)
    inner = inset(plan, wall)
    deep = float(rng.uniform(12, 20)) * unit
    body = extrusion(plan, "z", [depth / 2, 0, 0], high)
    body -= extrusion(inner, "z", [depth / 2, 0, high - deep], 9)
    drum = rng.random() < 0.5
    floor, mid = high - deep, depth / 2
    r = 0.42 * deep
    pieces = [(body, tone)]
    if drum:
        for s in (-1, 1):
            y = s * 0.62 * half
            cheek = box(
                [mid - r, y - 1.5 * unit, floor - 1e-4], [mid + r, y + 1.5 * unit, floor + 1.7 * r]
            )
            pieces.append((cheek - cylinder("y", [mid, -1, floor + 1.2 * r], 2, 0.4 * r), trim))
    else:
        pieces[0] = (body + extrusion(inner, "z", [mid, 0, floor - unit], deep - unit), tone)
    asm = Assembly()
    root = asm.add("body", layered(pieces))
    if drum:
        z, w = floor + 1.2 * r, 0.62 * half - 2.2 * unit
        barrel = cylinder("y", [mid, -w, z], 2 * w, r - 0.5 * unit, segments=22)
        pins = [
            ball([mid, y, z + r - 0.5 * unit], 0.9 * unit, 6)
            .translate((-mid, 0, -z))
            .rotate((0, a, 0))
            .translate((mid, 0, z))
            for y in np.linspace(-0.85, 0.85, 5) * w
            for a in rng.uniform(0, 360, 2)
        ]
        axle = cylinder("y", [mid, -0.62 * half - unit, z], 1.24 * half + 2 * unit, 0.33 * r)
        shape = Shape().add(tidy(union([barrel, axle, *pins])), materials.hardware(rng))
        asm.add("drum", shape, root, turn([mid, 0, z], ACROSS))
        top = floor + 2.3 * r
    else:
        top = high + float(rng.uniform(18, 40)) * unit
        _dancer(rng, asm, root, mid, high - 2 * unit, top, min(0.36 * depth, 0.36 * wide), unit)
    side = float(rng.choice([-1, 1]))
    size = float(rng.uniform(10, 16)) * unit
    if not drum or rng.random() < 0.7:
        add_crank(rng, asm, root, [mid, side * half, 0.45 * high], side, size, trim)
    if drum or rng.random() < 0.5:
        low = high + 0.8 * unit
        tall = max(float(rng.uniform(5, 12)) * unit, top + 2 * unit - low + wall)
        lid = extrusion(plan, "z", [mid, 0, low], tall)
        lid -= extrusion(inner, "z", [mid, 0, low - 1], 1 + tall - wall)
        emblem = extrusion(0.6 * plan, "z", [mid, 0, low + tall - 1e-4], 0.8 * unit)
        shape = layered([(lid, tone), (emblem, draw_finish(rng, 0.2))])
        swing = np.deg2rad(float(rng.uniform(70, 110)))
        asm.add("lid", shape, root, hinge([depth, 0, low], ACROSS, swing))
    return asm


def _dancer(rng, asm: Assembly, root: int, mid, low, top, radius: float, unit: float) -> None:
    """Add a disc that turns, with a figure off its middle."""
    disc = cylinder("z", [mid, 0, low + 0.3 * unit], 1.6 * unit, radius, segments=28)
    tall, off = top - low - 1.9 * unit, 0.3 * radius
    z = low + 1.8 * unit
    kind = rng.choice(3)
    if kind == 0:  # a skirt, a body, a head
        figure = cylinder("z", [mid, off, z], 0.5 * tall, 0.45 * radius, 0.15 * radius)
        figure += cylinder(
            "z", [mid, off, z + 0.5 * tall - 1e-4], 0.3 * tall, 0.14 * radius, segments=12
        )
        figure += ball([mid, off, z + 0.87 * tall], 0.13 * tall)
        arms = [[mid, off - 0.6 * radius, z + 0.85 * tall], [mid, off, z + 0.7 * tall]]
        figure += pipe([*arms, [mid, off + 0.6 * radius, z + 0.85 * tall]], 0.06 * tall, 8)
    elif kind == 1:  # trees and houses
        figure = cylinder("z", [mid, off, z], tall, 0.4 * radius, 0.02 * radius, 12)
        figure += cylinder("z", [mid, -1.6 * off, z], 0.6 * tall, 0.3 * radius, 0.02 * radius, 8)
    else:  # a horse on a pole, much simplified
        figure = cylinder("z", [mid, off, z], 0.95 * tall, 0.08 * radius, segments=10)
        figure += box(
            [mid - 0.5 * radius, off - 0.15 * radius, z + 0.3 * tall],
            [mid + 0.5 * radius, off + 0.15 * radius, z + 0.6 * tall],
        )
    pieces = [(disc, draw_finish(rng, 0.2)), (figure, draw_finish(rng, 0.2))]
    asm.add("dancer", layered(pieces), root, turn([mid, 0, 0], UP))


def radio(rng: np.random.Generator) -> Assembly:
    """A cassette radio or tape machine in metres: speakers, a flap or reels in front, keys on top,
    knobs, a handle and an aerial."""
    wide = float(rng.uniform(0.2, 0.6))
    high = wide * float(rng.uniform(0.42, 0.75))
    depth = wide * float(rng.uniform(0.16, 0.36))
    unit, half, air = wide / 100, wide / 2, 0.35 * wide / 100
    tone, dark, trim = draw_finish(rng, 0.15), materials.dark(rng), materials.hardware(rng)
    legs = 1.5 * unit
    outline = rounded(wide, high, float(rng.uniform(0.3, 8)) * unit, 5)
    body = extrusion(outline, "x", [0, 0, legs + high / 2], depth)
    feet = box([0.15 * depth, -0.8 * half, 0], [0.85 * depth, 0.8 * half, legs + unit]) - body
    asm, parts, extra = Assembly(), [], []
    low, top = legs + 3 * unit, legs + high
    band = top - float(rng.uniform(0.24, 0.34)) * high  # above it: the scale and knobs
    single = rng.random() < 0.35
    r = min(0.4 * (band - low), 17 * unit)
    speakers = [-half + r + 4 * unit] if single else [-half + r + 4 * unit, half - r - 4 * unit]
    for y in speakers:
        spot = [-0.8 * unit, y, (low + band) / 2]
        ring = cylinder("x", spot, 0.8 * unit, r, segments=28)
        cone = cylinder("x", [spot[0] - 0.4 * unit, *spot[1:]], 0.4 * unit, 0.8 * r, segments=24)
        extra += [(ring, trim if rng.random() < 0.5 else dark), (cone, dark)]
    a = speakers[0] + r + 3 * unit
    b = half - 4 * unit if single else speakers[1] - r - 3 * unit
    reels = rng.random() < 0.2 and b - a > 30 * unit
    count = 2 if b - a > 46 * unit and rng.random() < 0.5 else 1
    room = (b - a) / count
    for k in range(count if not reels else 0):
        lo = np.array([0.0, a + k * room + unit, low])
        hi = np.array([3.2 * unit, a + (k + 1) * room - unit, band - 2 * unit])
        hi[1] = min(hi[1], lo[1] + 40 * unit)
        thick = hi[0]
        body -= box([-1, *(lo[1:] - air)], [thick + 3 * unit, *(hi[1:] + air)])
        flap = box(lo + [-0.3 * unit, 0, 0], hi)
        p, q = lo[1:] + 0.18 * (hi - lo)[1:], hi[1:] - 0.25 * (hi - lo)[1:]
        pane = box([-0.8 * unit, *p], [-0.3 * unit, *q])
        shape = layered(
            [(flap, tone if rng.random() < 0.4 else dark), (pane, materials.glass(rng))]
        )
        joint = hinge([0, 0, lo[2]], (0, -1, 0), np.deg2rad(float(rng.uniform(25, 60))))
        parts.append(("flap", shape, joint))
    for y in (0.5 * (a + b) - 0.24 * (b - a), 0.5 * (a + b) + 0.24 * (b - a)) if reels else ():
        size = min(0.22 * (b - a), 0.46 * (band - low))
        z = (low + band) / 2
        disc = cylinder("x", [-2.4 * unit, y, z], 2.1 * unit, size, segments=28)
        cuts = [
            cylinder("x", [-1, 0, 0.6 * size], 2, 0.24 * size, segments=14).rotate((120 * k, 0, 0))
            for k in range(3)
        ]
        disc -= union(cuts).translate((0, y, z))
        parts.append(("reel", Shape().add(disc, trim), turn([0, y, z], (1, 0, 0))))
    keys = int(rng.choice([0, 3, 4, 5], p=[0.35, 0.25, 0.2, 0.2]))
    first, pitch = float(rng.uniform(-0.55, 0.05)) * half, 7 * unit
    for k in range(keys):
        y, w, x = first + k * pitch, 2.7 * unit, 0.3 * depth
        d = 0.2 * depth + unit
        if y + w > half - 9 * unit:
            break
        body -= box([x - d - air, y - w - air, top - 3.4 * unit], [x + d + air, y + w + air, 9])
        key = box([x - d, y - w, top - 1.2 * unit], [x + d, y + w, top + 1.6 * unit])
        press = slide((0, 0, -1), 1.5 * unit)
        parts.append(("button", merged([(key, trim if k else draw_finish(rng, 0))]), press))
    scale = box([-0.5 * unit, -0.3 * half, band + 3 * unit], [0, 0.9 * half, top - 3 * unit])
    handle = rng.random() < 0.55
    aerial = not handle and rng.random() < 0.7
    if aerial:  # a block behind on the top, to which the rod is hinged
        y = -half + 12 * unit
        block = box(
            [0.8 * depth - 2 * unit, y - 3 * unit, top - unit],
            [0.8 * depth + 2 * unit, y, top + 4 * unit],
        )
        extra.append((block, trim))
    root_pieces = [(tidy(body), tone), (feet, dark), *extra, (scale, draw_finish(rng, 0))]
    root = asm.add("body", layered(root_pieces))
    for name, shape, joint in parts:
        asm.add(name, shape, root, joint)
    size = min(0.36 * (top - band), 5 * unit)
    for k in range(int(rng.integers(1, 4))):
        y = -0.36 * half - (1.2 + 2.5 * k) * size
        if y - size < -half + unit:
            break
        sweep = None if rng.random() < 0.5 else float(np.deg2rad(270))
        at = (-0.3 * unit, y, (top + band) / 2)
        add_knob(asm, root, at, size, size, trim, materials.dark(rng), sweep)
    if handle:  # beside the case, folded back or upright
        y, thick, z = half + 1.8 * unit, 1.5 * unit, top - 0.28 * high
        rise = top + float(rng.uniform(7, 13)) * unit
        x = 0.62 * depth
        bar = pipe([[x, -y, z], [x, -y, rise], [x, y, rise], [x, y, z]], thick, 8)
        joint = hinge([x, 0, z], ACROSS, np.deg2rad(float(rng.uniform(60, 100))))
        asm.add("handle", Shape().add(tidy(bar), dark if rng.random() < 0.5 else trim), root, joint)
    if aerial:
        start = np.array([0.8 * depth, -half + 12 * unit + 1.7 * unit, top + 2.4 * unit])
        end = start + [0, 0, float(rng.uniform(0.15, 0.6)) * wide]
        rod = pipe([start, end], 1.5 * unit, 8)
        joint = hinge(start, (-1, 0, 0), np.pi / 2)
        asm.add("aerial", Shape().add(rod, trim), root, joint)
    return asm

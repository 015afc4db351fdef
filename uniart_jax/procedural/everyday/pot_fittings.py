"""Fittings of pots and pans: handles that are fixed, fold or hang; lids that lift, turn or are
hinged. Lengths are in metres; ``unit`` is a hundredth of the object's size."""

from __future__ import annotations

import dataclasses

import numpy as np

from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday import vessel_fittings
from uniart_jax.procedural.everyday.vessel_finishes import draw_pot_finish
from uniart_jax.procedural.everyday.vessel_fittings import bar_hinge, bezier, dome, taper
from uniart_jax.procedural.everyday.vessels import frustum, radius_at, widest
from uniart_jax.procedural.shapes import (
    Shape,
    box,
    cylinder,
    extrusion,
    hinge,
    rounded,
    slide,
    tidy,
    turn,
    union,
)


def add_long_handle(rng, body, solid, reach, z, radius, unit, trim) -> None:
    """Add one long handle behind (metres), round or flat, that rises a little; some pots get a
    small handle in front too."""
    long, up = float(rng.uniform(0.9, 1.9)) * radius, float(rng.uniform(-0.05, 0.25)) * radius
    thick = float(rng.uniform(0.07, 0.12)) * radius + 0.5 * unit
    start = reach - 3 * unit
    line = bezier([[start, 0, z], [start + 0.3 * long, 0, z + 0.2 * up], [start + long, 0, z + up]])
    first = thick * float(rng.uniform(0.5, 1.0))
    bar = taper(line[::2], first, thick, float(rng.uniform(0.9, 2.0)))
    bar -= cylinder("z", [line[-1][0] - 0.5 * thick, 0, z - radius], 3 * radius, 0.5 * thick)
    body.add(tidy(bar - solid), trim)
    if rng.random() < 0.3:
        loop = vessel_fittings.bow(0.35 * radius, 0.3 * radius, 0.6)[::2]
        line = np.column_stack([-start - loop[:, 2], loop[:, 0], 0 * loop[:, 0] + z])
        body.add(tidy(taper(line, 0.6 * thick, 0.6 * thick) - solid), trim)


def add_pair(rng, body, solid, reach, z, unit, trim) -> None:
    """Add two short handles at the sides (metres): loops or solid ears."""
    wide, long = float(rng.uniform(0.25, 0.45)) * reach, float(rng.uniform(0.2, 0.4)) * reach
    r = float(rng.uniform(1.5, 3)) * unit
    if rng.random() < 0.7:
        loop = vessel_fittings.bow(wide, long, float(rng.uniform(0.4, 1.0)))[::2]
        up = float(rng.uniform(-0.2, 0.4))
        start = 0.94 * reach - 2 * unit
        line = np.column_stack([loop[:, 0], start + loop[:, 2], z + up * loop[:, 2]])
        ear = taper(line, r, r)
    else:
        slab = rounded(2 * wide, 2.4 * long, 0.7 * long)
        ear = extrusion(slab, "z", [0, 0.9 * reach, z - 0.7 * r], 1.6 * r)
    for piece in (ear, ear.mirror((0, 1, 0))):
        body.add(tidy(piece - solid), trim)


def add_folding_pair(rng, body, solid, profile, widen, z, unit, trim) -> list[tuple]:
    """Two wire loops (metres) that hang at the sides and swing up and out; returns their names,
    shapes and joints. Their lugs are added to ``body``."""
    r = float(rng.uniform(1.4, 2.2)) * unit
    wide = float(rng.uniform(0.3, 0.5)) * radius_at(profile, z)
    drop = min(0.75 * z, float(rng.uniform(0.35, 0.6)) * wide * 2)
    reach = widest(profile, np.linspace(z - drop, z + r, 9)) * widen
    y = reach + r + 0.8 * unit
    loop = vessel_fittings.bow(wide, -drop, 0.5)[::2]
    line = np.column_stack([loop[:, 0], 0 * loop[:, 0] + y, z + loop[:, 2]])
    line = np.vstack([line, line[:1]])
    found = []
    angle = float(rng.uniform(1.2, 1.9))
    for side in (1, -1):
        wire = Shape().add(tidy(taper(line * [1, side, 1], r, r)), dataclasses.replace(trim))
        lugs = []
        for x in (-wide - 1.4 * r - 1.5 * unit, wide + 1.4 * r):
            lo, hi = sorted((side * 0.3 * y, side * (y + r)))
            lugs.append(box([x, lo, z - 1.3 * r], [x + 1.5 * unit, hi, z + 1.3 * r]))
        body.add(tidy(union(lugs) - solid), trim)
        found.append(("handle", wire, hinge((0, side * y, z), (side, 0, 0), angle)))
    return found


def add_folding_long(rng, body, solid, profile, z, radius, unit, trim) -> tuple:
    """A long handle behind (metres) that folds up about its hinge; returns its name, shape and
    joint. Its lugs are added to ``body``."""
    r = float(rng.uniform(1.8, 2.6)) * unit
    x = widest(profile, (z - 1.6 * r, z, z + 1.6 * r)) + 1.7 * r + unit
    half, air = 1.5 * r, 0.6 * unit
    long = float(rng.uniform(1.0, 1.7)) * radius
    bar = box([x, -half, z - 0.6 * r], [x + long, half, z + 0.6 * r])
    if rng.random() < 0.5:
        bar -= box([x + 0.35 * long, -0.5 * half, z - r], [x + 0.9 * long, 0.5 * half, z + r])
    else:
        bar += taper(np.array([[x + 0.4 * long, 0, z], [x + long, 0, z]]), r, 1.2 * r, 1.6)
    bar += cylinder("y", [x, -half, z], 2 * half, r, segments=16)
    lugs = [box([0.3 * x, y, z - 1.4 * r], [x + r, y + 1.4 * unit, z + 1.4 * r])
            for y in (half + air, -half - air - 1.4 * unit)]  # fmt: skip
    body.add(tidy(union(lugs) - solid), trim)
    shape = Shape().add(tidy(bar), dataclasses.replace(trim))
    return "handle", shape, hinge((x, 0, z), (0, -1, 0), float(rng.uniform(1.0, 1.5)))


def add_pins(body: Shape, solid, across, profile, unit, trim) -> np.ndarray:
    """Add pins at both sides for a bail; returns the pivot of its right end (metres)."""
    r = 1.6 * unit
    z = 0.84 * profile[-1, 1]
    widen = across / profile[-1, 0]
    y = widest(profile, np.linspace(z - r, profile[-1, 1], 7)) * widen + 2 * unit
    for side in (-1, 1):
        pin = cylinder("y", [0, min(side * y, 0), z], y, 1.3 * r, segments=14)
        body.add(tidy(pin - solid), trim)
    return np.array([0, y + 0.5 * unit + r, z])


def add_bail(rng, asm, root, pivot, radius, crown, unit, trim) -> None:
    """Add a bail (metres) that lies towards the rear and is raised over the lid."""
    _, y, z = pivot
    r = 1.6 * unit
    peak = max(crown - z + 5 * unit + r, 1.3 * max(radius, y))
    line = vessel_fittings.bow(y, peak, float(rng.uniform(0.5, 0.8)))[:, [1, 0, 2]]
    bar = taper(line, r, r) + taper(line[5:10], 1.7 * r, 1.7 * r)
    fold = float(rng.uniform(0.8, 1.35))
    bar = tidy(bar).rotate((0, np.rad2deg(fold), 0)).translate((0, 0, z))
    shape = Shape().add(bar, dataclasses.replace(trim))
    asm.add("handle", shape, root, hinge((0, 0, z), (0, 1, 0), -fold))


def add_lid(rng, asm, parent, outline, radius, wall, low, unit, way, steep, face, trim) -> float:
    """Add a flat or raised lid (metres) of steel, enamel or glass, its knob fixed or turning;
    returns the height of its top."""
    glass = rng.random() < 0.25
    tone = materials.glass(rng) if glass else face
    if not glass and rng.random() < 0.2:
        tone = draw_pot_finish(rng)
    rise = radius * float(rng.uniform(0.06, 0.35))
    wide = radius * float(rng.uniform(0.97, 1.05))
    rim = min(float(rng.uniform(1.5, 4)) * unit, 0.5 * rise)
    cover = dome(outline, wide, low, rise, rim)
    inner = 0.95 * (radius - wall)
    cover += frustum(outline, 0.97 * inner, inner, low - 2 * unit, low + 0.5 * rim)
    shape = Shape()
    if glass:  # a ring of steel round it
        hoop = frustum(outline, wide + 1e-3, wide + 1e-3, low, low + rim)
        hoop -= frustum(outline, 0.93 * wide, 0.93 * wide, low - 1, 1)
        shape.add(hoop, materials.metal(rng, brushed=False))
        cover -= hoop
    cover = tidy(cover)
    shape.add(cover, tone)
    at = [0, 0, low + 0.97 * rise]
    size = radius * float(rng.uniform(0.09, 0.16))
    grip = dataclasses.replace(trim)
    kind = str(rng.choice(["knob", "turning knob", "loop"], p=[0.4, 0.3, 0.3]))
    if kind == "turning knob":
        at[2] = low + rise + 0.3 * unit
        knob = vessel_fittings.knob(rng, at, size, turning=True)
    elif kind == "knob":
        knob = vessel_fittings.knob(rng, at, size) - cover
    else:
        long, tall = float(rng.uniform(0.2, 0.42)) * radius, float(rng.uniform(0.2, 0.3)) * radius
        foot = low + 0.6 * rise
        line = vessel_fittings.bow(long, low + rise + tall - foot, float(rng.uniform(0.35, 0.8)))
        across = line[:, [1, 0, 2]] if rng.random() < 0.6 else line
        knob = taper(across + [0, 0, foot], 0.4 * size, 0.4 * size) - cover
    crown = float(knob.bounding_box()[5])
    if kind != "turning knob":
        shape.add(tidy(knob), grip)
    if way == "hinge":
        x = radius + 2.4 * unit
        barrel = bar_hinge((x, 0, low), 0.9 * radius, 8 * unit, unit)
        shape.add(tidy(barrel - shape.solid()), dataclasses.replace(trim))
        swing = float(rng.uniform(0.8, 1.2) if steep else rng.uniform(1.0, 1.75))
        lid = asm.add("lid", shape, parent, hinge((x, 0, low), (0, 1, 0), swing))
    elif way == "turn":
        lid = asm.add("lid", shape, parent, turn((0, 0, low), (0, 0, 1)))
    else:
        travel = float(rng.uniform(0.35, 1.0)) * radius
        lid = asm.add("lid", shape, parent, slide((0, 0, 1), travel))
    if kind == "turning knob":
        asm.add("knob", Shape().add(knob, grip), lid, turn(at, (0, 0, 1)))
    return crown


def add_electric_lid(rng, asm, root, outline, top, wall, low, unit, hinged, face, trim) -> None:
    """Add a lid (metres) with a button or a bow, hinged at the rear if ``hinged``, else lifted
    off."""
    if not hinged:
        add_lid(rng, asm, root, outline, top, wall, low, unit, "lift", False, face, trim)
        return
    rise = top * float(rng.uniform(0.12, 0.4))
    cover = dome(outline, top, low, rise, 0.4 * rise)
    inner = 0.93 * (top - wall)
    cover += frustum(outline, 0.96 * inner, inner, low - 2 * unit, low + unit)
    shape = Shape().add(tidy(cover), face if rng.random() < 0.6 else trim)
    x = top + 2.4 * unit
    barrel = bar_hinge((x, 0, low), 0.9 * top, 12 * unit, unit)
    shape.add(tidy(barrel - cover), dataclasses.replace(trim))
    latch = box([-top - 2.5 * unit, -6 * unit, low + 0.3 * unit], [0, 6 * unit, low + 0.35 * rise])
    shape.add(tidy(latch - cover), dataclasses.replace(trim))
    asm.add("lid", shape, root, hinge((x, 0, low), (0, 1, 0), float(rng.uniform(1.0, 1.7))))

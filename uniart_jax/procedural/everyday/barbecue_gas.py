"""Gas grills: a box with burners under a hinged hood, on a cart or a table."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.barbecue_fittings import (
    add_side_shelf,
    add_wheel,
    draw_board,
    draw_finish,
    grate_slots,
    handle,
    handle_across,
)
from uniart_jax.procedural.fronts import add_knob
from uniart_jax.procedural.materials import plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    extrusion,
    hinge,
    tidy,
    union,
)


def gas_grill(rng: np.random.Generator) -> ArticulatedObject:
    """A gas grill in metres: a box with burners under a hinged hood, knobs in front, on a cart with
    doors, shelves and wheels, or on a table."""
    half, depth = float(rng.uniform(0.26, 0.45)), float(rng.uniform(0.42, 0.58))
    seam = float(rng.uniform(0.8, 0.95))
    table = rng.random() < 0.18
    if table:
        half, depth, seam = 0.8 * half, 0.75 * depth, float(rng.uniform(0.16, 0.24))
    fire = float(rng.uniform(0.16, 0.24)) if not table else seam - 0.03
    hood_high = depth * float(rng.uniform(0.35, 0.65))
    unit = (seam + hood_high) / 100
    air, wall = 0.4 * unit, 1.6 * unit
    face, steel = draw_finish(rng), materials.metal(rng)
    hood_face = face if rng.random() < 0.5 else draw_finish(rng)
    dark, board = materials.dark(rng), draw_board(rng)
    asm, body = Assembly(), Shape()
    floor = seam - fire
    solid = box([0, -half, floor], [depth, half, seam])
    solid -= box([wall, -half + wall, floor + 0.3 * fire], [depth - wall, half - wall, seam + 1])
    panel_deep = float(rng.uniform(4, 8)) * unit
    panel_low = seam - fire * float(rng.uniform(0.55, 0.95))
    lean = float(rng.choice([0.0, rng.uniform(0.0, 0.4)])) * panel_deep
    panel_top = seam - 0.02
    z = [panel_low, panel_low, panel_top, panel_top]
    outline = np.column_stack([z, [0, -panel_deep, -panel_deep + lean, 0]])
    lean = 0.0 if lean == 0 else float(np.arctan2(lean, panel_top - panel_low))
    body.add(solid, face)
    body.add(
        extrusion(outline, "y", [0, -half, 0], 2 * half), steel if rng.random() < 0.5 else face
    )
    grate = box(
        [wall, -half + wall, seam - 0.2 * fire],
        [depth - wall, half - wall, seam - 0.2 * fire + unit],
    )
    body.add(cut(grate, grate_slots(2 * wall, depth - 2 * wall, half, 12, 1)), dark)
    kind = "feet" if table else str(rng.choice(["doors", "open"], p=[0.55, 0.45]))
    wheel = float(rng.uniform(5, 9)) * unit
    rolling = not table and rng.random() < 0.7
    doors = _add_cart(rng, body, kind, half, depth, floor, wheel, unit, face, dark)
    side_kind = (
        str(rng.choice(["fold", "fixed", "none"], p=[0.5, 0.3, 0.2])) if not table else "none"
    )
    long = float(rng.uniform(0.22, 0.36))
    deep, z = depth * float(rng.uniform(0.7, 0.95)), seam - 2 * unit
    burner = None
    if side_kind == "fixed":
        for s in (-1, 1):
            lo, hi = sorted((s * half, s * (half + long)))
            body.add(
                box([0.5 * (depth - deep), lo, z - 3 * unit], [0.5 * (depth + deep), hi, z]), board
            )
        burner = float(rng.choice([-1, 1])) if rng.random() < 0.6 else None
    root = asm.add("cart", body)
    hood = _draw_hood(rng, half, depth, seam + air, hood_high, wall, unit, hood_face, steel)
    swing = float(np.deg2rad(rng.uniform(60, 90)))
    asm.add("hood", hood, root, hinge((depth, 0, seam + air), (0, 1, 0), swing))
    count = int(rng.integers(1, 6))
    r = min(0.26 * (seam - panel_low), 4 * unit, 0.7 * half / count)
    middle = (panel_low + seam - 0.02) / 2
    x = -panel_deep + np.tan(lean) * (middle - panel_low) - 5e-4
    knob = dark if rng.random() < 0.5 else materials.hardware(rng)
    mark = plain(np.ones(3) * (0.95 if sum(knob.color) < 1.5 else 0.1))
    for k in range(count):
        y = ((k + 0.5) / count * 2 - 1) * 0.85 * half
        add_knob(
            asm,
            root,
            (x, y, middle),
            max(r, 2 * unit),
            1.1 * r,
            knob,
            mark,
            float(np.deg2rad(rng.choice([90, 135, 270]))),
            skirt=rng.random() < 0.5,
            tilt=lean,
        )
    door_face, level = (hood_face if rng.random() < 0.5 else face), bool(rng.random() < 0.4)
    for lo, hi, side in doors:
        _add_door(rng, asm, root, lo, hi, side, unit, door_face, steel, level)
    if side_kind == "fold":
        for s in (-1, 1) if rng.random() < 0.7 else (float(rng.choice([-1, 1])),):
            reach = min(long, 0.8 * (z - 2 * wheel))
            add_side_shelf(rng, asm, root, s * half, s, depth / 2, z, reach, deep, unit, board)
    if burner is not None:
        y = burner * (half + long / 2)
        w = 0.4 * long
        plate = box([0.5 * depth - w, y - w, z + air], [0.5 * depth + w, y + w, z + 3 * unit])
        joint = hinge((0.5 * depth + w, y, z + air), (0, 1, 0), float(rng.uniform(1.2, 1.57)))
        asm.add("burner_lid", Shape().add(plate, hood_face), root, joint)
    if rolling:
        for s in (-1, 1):
            at = (0.85 * depth, s * half, wheel)
            add_wheel(asm, root, at, wheel, 3.5 * unit, s, steel)
    return asm.object()


def _add_cart(rng, body, kind, half, depth, floor, wheel, unit, face, dark) -> list[tuple]:
    """Add what carries the box: feet, four legs with a shelf, or a cabinet. Returns the cabinet's
    doors: (lo, hi, hinge side)."""
    w = float(rng.uniform(2, 3.5)) * unit
    xs, ys = (0.0, depth - w), (-half, half - w)
    low = wheel * 1.4
    if kind != "doors":
        legs = [box([x, y, 0], [x + w, y + w, floor]) for x in xs for y in ys]
        if kind == "open":
            legs.append(box([0, -half, low], [depth, half, low + 2 * unit]))
            if rng.random() < 0.4:
                legs.append(box([depth - w, -half, low], [depth, half, floor]))
        body.add(tidy(union(legs)), face if rng.random() < 0.5 else dark)
        return []
    wall = 1.6 * unit
    bottom = low if rng.random() < 0.7 else 0.4 * wheel
    solid = box([0, -half, bottom], [depth, half, floor]) - box(
        [-1, -half + wall, bottom + wall], [depth - wall, half - wall, floor - wall]
    )
    legs = [
        box([x, y, 0], [x + w, y + w, bottom + 0.5 * wall])
        for x in (0.1 * depth, depth - w)
        for y in ys
    ]
    body.add(tidy(union([solid, *legs])), face)
    air, thick = 0.35 * unit, 2.2 * unit
    count = int(rng.choice([1, 2], p=[0.25, 0.75]))
    a = np.array([-thick - air, -half + air, bottom + air])
    b = np.array([-air, half - air, floor - 4 * unit])
    if count == 1:
        return [(a, b, float(rng.choice([-1, 1])))]
    left, right = b.copy(), a.copy()
    left[1], right[1] = -air, air
    return [(a, left, -1.0), (right, b, 1.0)]


def _add_door(rng, asm, root, lo, hi, side, unit, face, steel, level: bool) -> None:
    """Add a flat front door, hinged at the ``side`` of y, with a bar handle that is upright or
    ``level``."""
    plate = box(lo, hi)
    y = lo[1] + 6 * unit if side > 0 else hi[1] - 6 * unit
    z = hi[2] - 0.3 * (hi[2] - lo[2])
    x, r = lo[0] + 0.5 * unit, 1.3 * unit
    long = float(rng.uniform(0.12, 0.3)) * (hi[2] - lo[2])
    ends = [x, y, z + long], [x, y, z - long]
    if level:
        z, quarter = hi[2] - 6 * unit, 0.25 * (hi[1] - lo[1])
        ends = [x, lo[1] + quarter, z], [x, hi[1] - quarter, z]
    bar = handle(*ends, (-4 * unit, 0), r)
    shape = Shape().add(plate, face).add(tidy(bar - plate), steel)
    at = (lo[0], hi[1] if side > 0 else lo[1], 0)
    asm.add("door", shape, root, hinge(at, (0, 0, -side), float(np.deg2rad(rng.uniform(80, 130)))))


def _draw_hood(rng, half, depth, low, high, wall, unit, face, steel) -> Shape:
    """A hollow hood with a handle: an arch, a slope, or a box with a rounded edge. Some have cheeks
    of another colour."""
    kind = str(rng.choice(["arch", "slope", "edge"], p=[0.35, 0.4, 0.25]))
    if kind == "arch":
        t = np.linspace(0, np.pi, 15)
        p = float(rng.uniform(0.5, 1.0))
        outline = np.column_stack([high * np.sin(t) ** p, depth / 2 * (1 - np.cos(t))])
    elif kind == "slope":
        a, b = float(rng.uniform(0.1, 0.5)), float(rng.uniform(0.0, 0.25))
        knee = float(rng.uniform(0.2, 0.6))
        z = np.array([0, knee, 1, 1, 0]) * high
        outline = np.column_stack([z, np.array([0, 0.3 * a, a, 1 - b, 1]) * depth])
    else:
        t = np.linspace(0, np.pi / 2, 8)
        r = float(rng.uniform(0.5, 0.98)) * min(high, 0.9 * depth)
        edge = np.column_stack([high - r + r * np.sin(t), r - r * np.cos(t)])
        outline = np.vstack([[[0, 0]], edge, [[high, depth], [0, depth]]])
    solid = extrusion(outline + [low, 0], "y", [0, -half, 0], 2 * half)
    middle = depth / 2
    inner = (outline - [0, middle]) * [1 - wall / high, 1 - 2 * wall / depth] + [
        low - 0.001,
        middle,
    ]
    cheek = float(rng.uniform(2, 6)) * unit
    hollow = solid - extrusion(inner, "y", [0, -half + wall, 0], 2 * half - 2 * wall)
    hood = Shape()
    if rng.random() < 0.35:  # its ends of another colour
        core = box([-1, -half + cheek, 0], [3, half - cheek, 9])
        hood.add(hollow ^ core, face).add(hollow - core, materials.dark(rng))
    else:
        hood.add(hollow, face)
    z = low + float(rng.uniform(0.12, 0.35)) * high
    reach = float(rng.uniform(4, 7)) * unit
    bow = handle_across(
        float(rng.uniform(0.45, 0.85)) * half, 0.3 * depth, z, (-0.3 * depth - reach, 0), 1.4 * unit
    )
    hood.add(tidy(bow - solid), steel)
    return hood

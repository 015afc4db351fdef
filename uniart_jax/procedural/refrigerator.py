"""Refrigerators: one or two doors over each other, side by side, French doors over freezer
drawers."""

from __future__ import annotations

import dataclasses

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import appliances, finishes
from uniart_jax.procedural.cabinet import room_behind
from uniart_jax.procedural.fronts import add_door, add_drawer
from uniart_jax.procedural.hinges import opening
from uniart_jax.procedural.shapes import Assembly, Shape, box, cut


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A refrigerator, metres, closed."""
    plan = str(
        rng.choice(
            ["single", "top", "bottom", "bottom_drawer", "side", "french", "mini"],
            p=[0.12, 0.18, 0.14, 0.09, 0.15, 0.13, 0.19],
        )
    )
    wide = plan in ("side", "french")
    width = float(rng.uniform(0.75, 1.25) if wide else rng.uniform(0.45, 0.8))
    height = float(rng.uniform(0.5, 0.95) if plan == "mini" else rng.uniform(1.3, 2.0))
    depth = float(rng.uniform(0.4, 0.75))
    unit = max(width, height, depth) / 100
    face = finishes.appliance(rng)
    look = appliances.style(
        rng, unit, face, panels=("slab", "slab", "slab", "border", "raised"),
        handles=("bar", "bar", "round_bar", "arch", "recess", "lip"),
        own_handle=0.4,
    )  # fmt: skip
    if look.panel == "border":
        look = dataclasses.replace(look, accent=face.darker(0.93))
    thick = float(rng.uniform(0.016, 0.09))
    look = dataclasses.replace(look, thickness=thick, handle_length=float(rng.uniform(0.25, 0.6)))
    legs = float(rng.uniform(0.01, 0.08) if rng.random() < 0.75 else rng.uniform(0.06, 0.16))
    crown = 0.0 if rng.random() < 0.7 else float(rng.uniform(0.03, 0.1)) * height  # above the doors
    ceiling, height = height, height - crown
    wall = max(float(rng.uniform(0.035, 0.055)), 1.8 * unit)
    lining = finishes.white_plastic(rng)

    half, low = width / 2, legs
    middle = low + (height - low) * {
        "top": rng.uniform(0.62, 0.75), "bottom": rng.uniform(0.3, 0.45), "bottom_drawer": rng.uniform(0.3, 0.42),  # noqa: E501
        "french": rng.uniform(0.32, 0.45),
    }.get(plan, 0.5)  # fmt: skip
    share = float(rng.choice([0.0, rng.uniform(-0.12, 0.12)])) * width
    full = (-half, half)
    # rectangles of the front with what closes them: hinge edge, or 'drawer'
    single = "+y" if rng.random() < 0.5 else "-y"
    if plan in ("single", "mini"):
        cells = [(full, (low, height), single)]
    elif plan in ("top", "bottom"):
        cells = [(full, (low, middle), single), (full, (middle, height), single)]
    elif plan == "bottom_drawer":
        count = int(rng.integers(1, 4))
        edges = np.linspace(low, middle, count + 1)
        cells = [(full, (edges[i], edges[i + 1]), "drawer") for i in range(count)]
        cells.append((full, (middle, height), single))
    elif plan == "side":
        cells = [((share, half), (low, height), "+y"), ((-half, share), (low, height), "-y")]
        if rng.random() < 0.08:  # three in a row
            ys, edges = np.linspace(half, -half, 4), rng.choice(["+y", "-y"], 3)
            cells = [((ys[i + 1], ys[i]), (low, height), str(edges[i])) for i in range(3)]
        if rng.random() < 0.25:
            cut_at = low + (height - low) * float(rng.uniform(0.35, 0.5))
            cells = [(y, z, e) for y, _, e in cells for z in ((low, cut_at), (cut_at, height))]
    else:
        count = int(rng.integers(1, 3))
        edges = np.linspace(low, middle, count + 1)
        cells = [(full, (edges[i], edges[i + 1]), "drawer") for i in range(count)]
        cells += [((0.0, half), (middle, height), "+y"), ((-half, 0.0), (middle, height), "-y")]

    asm, body = Assembly(), Shape()
    case = face if rng.random() < 0.55 else face.darker(float(rng.uniform(0.3, 0.9)))
    appliances.feet(body, rng, width, depth, legs, unit)
    x = (0.0, depth - wall)
    bays = [room_behind(y, z, full, (low, height), x, wall) for y, z, _ in cells]
    shelves, holes = Shape(), []
    together = plan == "french"  # the two doors share one room
    for (y, _, edge), (lo, hi) in zip(cells, bays, strict=True):
        lo, hi = lo.copy(), hi.copy()
        if together and edge in ("+y", "-y"):
            lo[1], hi[1] = -half + wall, half - wall
            if y[0] < 0:  # cut once
                continue
        holes.append(box([-0.1, lo[1], lo[2]], hi))
        if edge != "drawer":
            _shelves(
                rng, shelves, lo, hi, unit, depth, look.glass if rng.random() < 0.5 else lining
            )
    body.add(cut(box([0, -half, low], [depth, half, height]), holes), case)
    if crown:
        lo = -thick - 0.002 if rng.random() < 0.6 else 0.0
        body.add(box([lo, -half, height], [depth, half, ceiling]), case)
    body.join(shelves)
    root = asm.add("body", body)

    seam = max(0.002, float(rng.uniform(0.1, 0.8)) * unit)
    swing = opening(rng, 0.65)
    bins = rng.random() < 0.55
    for (y, z, edge), (lo, hi) in zip(cells, bays, strict=True):
        front_lo = np.array([-thick - 0.002, y[0] + seam / 2, z[0] + seam / 2])
        front_hi = np.array([-0.002, y[1] - seam / 2, z[1] - seam / 2])
        if edge == "drawer":
            add_drawer(
                asm, root, front_lo, front_hi, lo, hi, float(rng.uniform(0.5, 0.85)),
                dataclasses.replace(look, inside=lining), depth=0.9, fill=0.8, center=False,
            )  # fmt: skip
        else:
            extra = None
            if bins:
                reach, wall = float(rng.uniform(0.08, 0.13)), max(0.014, 1.55 * unit)
                sizes, places = (reach, wall, max(0.09, 7 * unit)), (front_lo, front_hi, lo, hi)
                extra = appliances.bins_behind(places, sizes, unit, lining)
            outer = y[1] > half - 1e-6 if edge == "+y" else y[0] < 1e-6 - half
            beyond = seam / 2 if outer else 1.0
            add_door(
                asm, root, front_lo, front_hi, edge, swing, look, extra=extra, beyond=beyond
            )  # fmt: skip
    return asm.object()


def _shelves(rng, shape: Shape, lo, hi, unit: float, depth: float, material) -> None:
    """Shelves across a room, behind the room that the doors' bins need."""
    count = int(np.clip((hi[2] - lo[2]) / rng.uniform(0.22, 0.4), 0, 4))
    board = max(0.015, 1.6 * unit)
    front = depth * float(rng.uniform(0.3, 0.4))
    for k in range(count):
        z = lo[2] + (k + 1) * (hi[2] - lo[2]) / (count + 1)
        shape.add(box([front, lo[1], z - board / 2], [hi[0], hi[1], z + board / 2]), material)

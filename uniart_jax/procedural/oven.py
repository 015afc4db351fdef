"""Ovens and ranges: a door hinged at the bottom, turning knobs, burners on the cooktop, a drawer below."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import appliances, materials
from uniart_jax.procedural.fronts import add_door, add_drawer
from uniart_jax.procedural.shapes import Assembly, Shape, box, cut, cylinder, slide, tube


def build(rng: np.random.Generator) -> ArticulatedObject:
    """An oven, metres, closed."""
    plan = str(rng.choice(["range", "double", "wall"], p=[0.68, 0.12, 0.2]))
    width, depth = float(rng.uniform(0.5, 0.92)), float(rng.uniform(0.52, 0.68))
    height = float(rng.uniform(0.45, 0.62) if plan == "wall" else rng.uniform(0.82, 0.95))
    unit = max(width, height, depth) / 100
    face = materials.appliance(rng)
    look = appliances.style(
        rng,
        unit,
        face,
        panels=("glass", "glass", "glass", "border", "slab"),
        handles=("bar", "bar", "round_bar", "arch"),
    )
    look = dataclasses.replace(
        look,
        thickness=max(0.028, float(rng.uniform(2.5, 5.0)) * unit),
        accent=materials.dark_glass(rng) if rng.random() < 0.7 else look.accent,
        handle_length=float(rng.uniform(0.5, 0.85)),
        face=face if rng.random() < 0.7 else materials.dark(rng),
    )
    thick, half = look.thickness, width / 2
    wall = max(0.025, float(rng.uniform(2.2, 4.5)) * unit)
    legs = 0.0 if plan == "wall" else float(rng.uniform(0.02, 0.09))
    low = legs
    drawer = float(rng.uniform(0.14, 0.22)) if plan == "range" and rng.random() < 0.55 else 0.0
    band = float(rng.uniform(0.09, 0.14))
    guard = plan != "wall" and rng.random() < 0.35  # controls on a guard at the back
    panel_at = "guard" if guard and rng.random() < 0.7 else "front"
    top = height - (band if panel_at == "front" else 0.0)
    seam = max(0.004, 0.5 * unit)

    asm, body = Assembly(), Shape()
    if legs:
        appliances.feet(body, rng, width, depth, legs, unit)
    rooms = [(low, low + drawer, "drawer")] if drawer else []
    if plan == "double":
        middle = low + (top - low) * float(rng.uniform(0.4, 0.65))
        rooms += [(low, middle, "door"), (middle, top, "door")]
    else:
        rooms.append((low + drawer, top, "door"))
    holes = []
    for a, b, _ in rooms:
        holes.append(
            box([-0.1, -half + wall, a + wall / 2], [depth - wall, half - wall, b - wall / 2])
        )
    enamel = materials.dark(rng) if rng.random() < 0.3 else face
    body.add(cut(box([0, -half, low], [depth, half, height]), holes), enamel)
    front = -thick - 0.002
    panel = look.face if rng.random() < 0.6 else materials.dark(rng)
    if panel_at == "front":
        body.add(box([front, -half, top + seam / 2], [0, half, height]), panel)
    if plan != "wall":
        _cooktop(rng, body, front, depth, half, height, unit, guard)
    guard_x, guard_z = depth - max(0.04, 3 * unit), float(rng.uniform(0.08, 0.2))
    if guard:
        body.add(
            box([guard_x, -half, height], [depth, half, height + guard_z]),
            face if panel_at == "front" else panel,
        )
    shelves = str(rng.choice(["none", "fixed", "slide"], p=[0.4, 0.35, 0.25]))
    wire = max(0.014, 1.8 * unit)
    steel = materials.metal(rng, brushed=False)
    racks = []
    for a, b, kind in rooms:
        if kind == "door" and shelves != "none" and b - a > 0.2:
            z = a + (b - a) * float(rng.uniform(0.35, 0.55))
            air = 0.006 if shelves == "slide" else 0.0
            racks.append(
                (
                    [0.02, -half + wall + air, z],
                    [depth - wall - 0.01, half - wall - air, z + wire],
                    wire,
                )
            )
    if shelves == "fixed":
        for lo, hi, _ in racks:
            body.add(_grate(lo, hi, wire, 5), steel)
    face_x, z = (
        (front, (top + seam / 2 + height) / 2)
        if panel_at == "front"
        else (guard_x, height + guard_z / 2)
    )
    ys, screen = _panel_plan(rng, half, unit)
    if screen is not None:
        tall = 0.3 * (band if panel_at == "front" else guard_z)
        glass = (
            materials.dark_glass(rng)
            if panel.color[1] > 0.3
            else materials.plain((0.3, 0.45, 0.45))
        )
        appliances.display(
            body, face_x, screen, (z - tall, z + tall), max(0.003, 0.5 * unit), glass
        )
    root = asm.add("body", body)

    angle = float(np.deg2rad(rng.uniform(75, 95)))
    for a, b, kind in rooms:
        lo = np.array([front, -half + 0.002, a + seam / 2])
        hi = np.array([-0.002, half - 0.002, b - seam / 2])
        if kind == "door":
            add_door(asm, root, lo, hi, "-z", angle, look)
        else:
            bay = [0.0, -half + wall, a + wall / 2], [depth - wall, half - wall, b - wall / 2]
            plainer = dataclasses.replace(
                look, handle=str(rng.choice([look.handle, "recess", "none"]))
            )
            add_drawer(
                asm,
                root,
                lo,
                hi,
                *bay,
                float(rng.uniform(0.5, 0.8)),
                plainer,
                kind="slab",
                depth=0.85,
            )
    if shelves == "slide":
        for lo, hi, _ in racks:
            grate = Shape().add(_grate(lo, hi, wire, int(rng.integers(4, 7))), steel)
            asm.add(
                "rack",
                grate,
                root,
                slide((-1, 0, 0), float(rng.uniform(0.5, 0.85)) * (hi[0] - lo[0])),
            )
    if ys:
        finish = materials.hardware(rng)
        appliances.knob_row(
            asm, rng, root, face_x, ys, z, unit, finish, largest=min(0.032, 0.3 * band)
        )
    return asm.object()


def _panel_plan(rng, half: float, unit: float) -> tuple[list[float], tuple[float, float] | None]:
    """Where knobs sit on the control panel, and the span of a display or None."""
    count = int(rng.choice([0, 1, 2, 3, 4, 5, 6], p=[0.08, 0.07, 0.22, 0.1, 0.28, 0.15, 0.1]))
    pitch = max(0.075, 8 * unit)
    count = min(count, int(1.7 * half / pitch))
    display = None if count > 5 or rng.random() < 0.3 else (-0.22 * half, 0.22 * half)
    if count == 0:
        return [], (-0.4 * half, 0.4 * half)
    if display is None:
        reach = min(0.8 * half, pitch * (count - 1) / 2 * float(rng.uniform(1.0, 1.6)))
        ys = (
            np.linspace(-reach, reach, count)
            if count > 1
            else np.array([0.6 * half * rng.choice([-1, 1])])
        )
        return [float(y) for y in ys], None
    left = (count + 1) // 2
    ys = [0.85 * half - i * pitch for i in range(left)] + [
        -0.85 * half + i * pitch for i in range(count - left)
    ]
    inner = min(abs(y) for y in ys)
    if inner < display[1] + pitch / 2:
        display = None if inner < pitch / 2 + 0.05 else (-inner + pitch / 2, inner - pitch / 2)
    return ys, display


def _cooktop(
    rng,
    body: Shape,
    front: float,
    depth: float,
    half: float,
    height: float,
    unit: float,
    guard: bool,
) -> None:
    """A glass or steel top with burners; grates on some."""
    back = depth - (max(0.05, 4 * unit) if guard else 0.01)
    plate = max(0.004, 0.7 * unit)
    glass = materials.dark_glass(rng) if rng.random() < 0.6 else materials.metal(rng, brushed=False)
    body.add(box([0.01, -half + 0.01, height], [back, half - 0.01, height + plate]), glass)
    mark = materials.plain((0.35, 0.33, 0.33)) if glass.color[1] < 0.3 else materials.dark(rng)
    style, top = rng.integers(3), height + plate
    spots = [(x, y) for x in (0.28, 0.72) for y in (-0.5, 0.5)]
    if half > 0.4 and rng.random() < 0.5:
        spots.append((0.5, 0.0))
    for x, y in spots:
        r = float(rng.uniform(0.07, 0.1)) if len(spots) == 4 else 0.075
        r = min(r, 0.2 * (back - front))
        at = [x * back, y * half * 0.95, top]
        if style == 0:
            body.add(cylinder("z", at, max(0.003, 0.5 * unit), r, segments=20), mark)
        elif style == 1:
            body.add(tube("z", at, max(0.008, 1.2 * unit), r, 0.6 * r, 18), mark)
            body.add(cylinder("z", at, max(0.006, 0.8 * unit), 0.4 * r, segments=12), mark)
        else:
            w, h = max(0.008, 0.8 * unit), max(0.02, 2.4 * unit)
            body.add(
                box([at[0] - 1.2 * r, at[1] - w, top], [at[0] + 1.2 * r, at[1] + w, top + h]), mark
            )
            body.add(
                box([at[0] - w, at[1] - 1.1 * r, top], [at[0] + w, at[1] + 1.1 * r, top + h]), mark
            )


def _grate(lo, hi, wire: float, bars: int):
    """A flat rack: a frame with bars across."""
    borders = np.linspace(lo[1] + wire / 2, hi[1] - wire / 2, bars + 1)
    holes = [
        box([lo[0] + wire, a + wire / 2, lo[2] - wire], [hi[0] - wire, b - wire / 2, hi[2] + wire])
        for a, b in itertools.pairwise(borders)
    ]
    return cut(box(lo, hi), holes)

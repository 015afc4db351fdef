"""Ovens and ranges: a door hinged at the bottom, turning knobs, burners on the cooktop, a drawer
below."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import appliances, finishes, materials
from uniart_jax.procedural.fronts import add_door, add_drawer
from uniart_jax.procedural.hinges import opening
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    extrusion,
    slide,
    tube,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """An oven, metres, closed."""
    plan = str(
        rng.choice(["range", "double", "twin", "wall", "cooktop"], p=[0.54, 0.12, 0.1, 0.16, 0.08])
    )
    if plan == "cooktop":
        return _built_in_cooktop(rng)
    width, depth = float(rng.uniform(0.45, 0.95)), float(rng.uniform(0.5, 0.68))
    if plan == "twin":
        width = float(rng.uniform(0.9, 1.35))
    height = float(rng.uniform(0.4, 0.65) if plan == "wall" else rng.uniform(0.82, 0.98))
    if plan == "double" and rng.random() < 0.4:  # built in, one over the other
        height = float(rng.uniform(0.95, 1.35))
    unit = max(width, height, depth) / 100
    face = finishes.appliance(rng)
    look = appliances.style(
        rng,
        unit,
        face,
        panels=("glass", "glass", "glass", "border", "slab"),
        handles=("bar", "bar", "round_bar", "arch"),
    )
    look = dataclasses.replace(
        look,
        thickness=max(0.02, float(rng.uniform(2.0, 5.5)) * unit),
        accent=materials.dark_glass(rng) if rng.random() < 0.7 else look.accent,
        handle_length=float(rng.uniform(0.5, 0.85)),
        face=face if rng.random() < 0.75 else finishes.dark(rng),
    )
    thick, half = look.thickness, width / 2
    wall = max(0.025, float(rng.uniform(2.2, 4.5)) * unit)
    legs = 0.0 if plan == "wall" else float(rng.uniform(0.0, 0.14))
    low = legs
    wants = plan in ("range", "twin") and rng.random() < 0.6
    drawer = float(rng.uniform(0.12, 0.24)) if wants else 0.0
    band = float(rng.uniform(0.08, 0.14) if rng.random() < 0.6 else rng.uniform(0.14, 0.22))
    guard = plan != "wall" and height < 1 and rng.random() < 0.35  # controls on a guard at the back
    panel_at = "guard" if guard and rng.random() < 0.7 else "front"
    top = height - (band if panel_at == "front" else 0.0)
    seam = max(0.004, 0.5 * unit)
    across = (-half, half)

    asm, body = Assembly(), Shape()
    if legs > 0.005:
        appliances.feet(body, rng, width, depth, legs, unit)
    under = "drawer" if rng.random() < 0.6 else "panel"
    rooms = [(across, low, low + drawer, under)] if drawer else []
    if plan == "double":
        middle = low + (top - low) * float(rng.uniform(0.4, 0.65))
        rooms += [(across, low, middle, "door"), (across, middle, top, "door")]
    elif plan == "twin":
        middle = float(rng.choice([0.0, rng.uniform(-0.4, 0.4)])) * half
        kinds = ["door", "side"] if rng.random() < 0.3 else ["door", "door"]
        kinds = kinds[:: int(rng.choice([-1, 1]))]
        rooms += [((-half, middle), low + drawer, top, kinds[0])]
        rooms += [((middle, half), low + drawer, top, kinds[1])]
    else:
        rooms.append((across, low + drawer, top, "door"))
    bays = []
    for y, a, b, _ in rooms:
        sides = [wall if abs(abs(v) - half) < 1e-6 else wall / 2 for v in y]
        lo = np.array([0.0, y[0] + sides[0], a + wall / 2])
        bays.append((lo, np.array([depth - wall, y[1] - sides[1], b - wall / 2])))
    holes = [
        box([-0.1, *lo[1:]], hi)
        for (lo, hi), room in zip(bays, rooms, strict=True)
        if room[3] != "panel"
    ]
    enamel = finishes.dark(rng) if rng.random() < 0.25 else face
    body.add(cut(box([0, -half, low], [depth, half, height]), holes), enamel)
    front = -thick - 0.002
    panel = look.face if rng.random() < 0.6 else finishes.dark(rng)
    tilt = float(np.deg2rad(rng.uniform(12, 48))) if rng.random() < 0.18 else 0.0
    if panel_at == "front":
        foot = top + seam / 2
        if tilt:  # it leans back, as far as it stands out
            tilt = min(tilt, float(np.arctan(-front / (height - foot))))
            crest = front + (height - foot) * np.tan(tilt)
            outline = [[foot, front], [foot, 0.0], [height, 0.0], [height, min(crest, -1e-4)]]
            body.add(extrusion(np.array(outline), "y", [0, -half, 0], width), panel)
        else:
            body.add(box([front, -half, foot], [0, half, height]), panel)
    else:
        tilt = 0.0
    for _, a, b, kind in rooms:
        if kind == "panel":  # a board below the doors that does not open
            lo, hi = [front, 0.002 - half, a + seam / 2], [0, half - 0.002, b - seam / 2]
            body.add(box(lo, hi), panel)
    if plan != "wall" and height < 1:
        _cooktop(rng, body, front, depth, half, height, unit, guard)
    guard_x, guard_z = depth - max(0.04, 3 * unit), float(rng.uniform(0.08, 0.24))
    if guard:
        body.add(
            box([guard_x, -half, height], [depth, half, height + guard_z]),
            face if panel_at == "front" else panel,
        )
    shelves = str(rng.choice(["none", "fixed", "slide"], p=[0.4, 0.3, 0.3]))
    wire = max(0.014, 1.8 * unit)
    steel = finishes.metal(rng, brushed=False)
    racks = []
    number = int(rng.choice([1, 2, 3], p=[0.6, 0.25, 0.15]))
    for (_, a, b, kind), (lo, hi) in zip(rooms, bays, strict=True):
        if kind not in ("door", "side") or shelves == "none" or b - a <= 0.2:
            continue
        air = 0.006 if shelves == "slide" else 0.0
        start = a + (b - a) * float(rng.uniform(0.2, 0.5))
        for z in np.linspace(start, hi[2] - 3 * wire, number + 1)[:-1]:
            far = (depth - wall) * float(rng.uniform(0.75, 1.0)) - 0.01
            racks.append(([0.02, lo[1] + air, z], [far, hi[1] - air, z + wire]))
    if shelves == "fixed":
        for lo, hi in racks:
            body.add(_grate(lo, [depth - wall, *hi[1:]], wire, 5), steel)
    face_x, z = (
        (front, (top + seam / 2 + height) / 2)
        if panel_at == "front"
        else (guard_x, height + guard_z / 2)
    )
    ys, screen, pitch = _panel_plan(rng, half, unit)
    tall = band if panel_at == "front" else guard_z
    if screen is not None and not tilt:
        glass = (
            materials.dark_glass(rng)
            if panel.color[1] > 0.3
            else materials.plain((0.3, 0.45, 0.45))
        )
        span = (z - 0.3 * tall, z + 0.3 * tall)
        appliances.display(body, face_x, screen, span, max(0.003, 0.5 * unit), glass)
    root = asm.add("body", body)

    angle = np.pi / 2 if rng.random() < 0.6 else float(np.deg2rad(rng.uniform(75, 95)))
    for (y, a, b, kind), (bay_lo, bay_hi) in zip(rooms, bays, strict=True):
        air = [0.002 if abs(abs(v) - half) < 1e-6 else seam / 2 for v in y]
        lo = np.array([front, y[0] + air[0], a + seam / 2])
        hi = np.array([-0.002, y[1] - air[1], b - seam / 2])
        if kind == "door":
            fixed = drawer > 0 and under == "panel"  # nothing of the door may go below its edge
            add_door(asm, root, lo, hi, "-z", angle, look, beyond=1.0, inset=fixed)
        elif kind == "side":
            edge = "+y" if y[1] > half - 1e-6 else "-y"
            add_door(asm, root, lo, hi, edge, opening(rng, 0.2), look, beyond=0.002)
        elif kind == "drawer":
            plainer = dataclasses.replace(
                look, handle=str(rng.choice([look.handle, "recess", "none"]))
            )
            pull, deep = float(rng.uniform(0.5, 0.95)), float(rng.uniform(0.65, 0.95))
            add_drawer(asm, root, lo, hi, bay_lo, bay_hi, pull, plainer, kind="slab", depth=deep)
    if shelves == "slide":
        bars, pull = int(rng.integers(4, 7)), float(rng.uniform(0.5, 0.95))
        for lo, hi in racks:
            grate = Shape().add(_grate(lo, hi, wire, bars), steel)
            asm.add("rack", grate, root, slide((-1, 0, 0), pull * (hi[0] - lo[0])))
    if ys:
        finish = materials.hardware(rng)
        largest = min(0.042, 0.34 * tall, 0.4 * pitch)
        middle = face_x + ((height - top - seam / 2) / 2 * np.tan(tilt) if tilt else 0.0)
        places = [(middle, y, z) for y in ys]
        appliances.knobs(asm, rng, root, places, unit, finish, largest=largest, tilt=tilt)
    return asm.object()


def _built_in_cooktop(rng: np.random.Generator) -> ArticulatedObject:
    """A flat cooktop for a worktop: nothing moves but its knobs, at the front or on the top."""
    width, depth = float(rng.uniform(0.5, 1.2)), float(rng.uniform(0.42, 0.62))
    height = float(rng.uniform(0.06, 0.2))
    unit, half = max(width, depth) / 100, width / 2
    face = finishes.appliance(rng)
    asm, body = Assembly(), Shape()
    lip = float(rng.uniform(0.0, 0.05))
    body.add(box([lip, lip - half, 0], [depth - lip, half - lip, 0.6 * height]), face.darker(0.8))
    body.add(box([0, -half, 0.6 * height], [depth, half, height]), face)
    count = int(rng.integers(2, 9))
    finish = materials.hardware(rng)
    strip = max(0.07, 7 * unit)
    where = str(rng.choice(["front", "near", "side"]))
    if where == "front":
        face_x, tilt = -max(0.01, unit), 0.0
        body.add(box([face_x, -half, 0.25 * height], [0, half, height]), face)
        most, clear = 0.3 * height, 0.0
    else:
        tilt, most, clear = np.pi / 2, 0.34 * strip, strip
    reach = (0.85 * half) if where != "side" else (0.42 * depth)
    count = min(count, int(2 * reach / max(0.06, 5.5 * unit)))
    along = np.linspace(-reach, reach, count) if count > 1 else np.zeros(1)
    if where == "front":
        places = [(face_x, float(y), 0.62 * height) for y in along]
    elif where == "near":
        places = [(0.5 * strip, float(y), height) for y in along]
    else:
        places = [(depth / 2 + float(x), -half + 0.5 * strip, height) for x in along]
    x0 = clear if where == "near" else 0.0
    y0 = clear if where == "side" else 0.0
    burners = Shape()
    _cooktop(rng, burners, 0.0, depth - x0, half - y0 / 2, height, unit, False)
    shift = np.eye(4)
    shift[:2, 3] = x0, y0 / 2
    body.join(burners.moved(shift))
    root = asm.add("body", body)
    pitch = 2 * reach / max(count - 1, 1)
    appliances.knobs(
        asm, rng, root, places, unit, finish, largest=min(0.035, most, 0.4 * pitch), tilt=tilt
    )  # fmt: skip
    return asm.object()


def _panel_plan(
    rng, half: float, unit: float
) -> tuple[list[float], tuple[float, float] | None, float]:
    """Where knobs sit on the control panel, the span of a display or None, and the least distance
    of two knobs."""
    count = int(rng.choice(10, p=[0.08, 0.06, 0.14, 0.08, 0.2, 0.14, 0.12, 0.08, 0.06, 0.04]))
    pitch = max(0.055, float(rng.uniform(5.5, 8.5)) * unit)
    count = min(count, int(1.7 * half / pitch))
    display = None if count > 6 or rng.random() < 0.3 else (-0.22 * half, 0.22 * half)
    if count == 0:
        return [], (-0.4 * half, 0.4 * half), pitch
    if display is None:
        reach = min(0.8 * half, pitch * (count - 1) / 2 * float(rng.uniform(1.0, 1.6)))
        ys = (
            np.linspace(-reach, reach, count)
            if count > 1
            else np.array([0.6 * half * rng.choice([-1, 1])])
        )
        return [float(y) for y in ys], None, pitch
    left = (count + 1) // 2
    ys = [0.85 * half - i * pitch for i in range(left)] + [
        -0.85 * half + i * pitch for i in range(count - left)
    ]
    inner = min(abs(y) for y in ys)
    if inner < display[1] + pitch / 2:
        display = None if inner < pitch / 2 + 0.05 else (-inner + pitch / 2, inner - pitch / 2)
    return ys, display, pitch


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
    glass = materials.dark_glass(rng) if rng.random() < 0.6 else finishes.metal(rng, brushed=False)
    body.add(box([0.01, -half + 0.01, height], [back, half - 0.01, height + plate]), glass)
    mark = materials.plain((0.35, 0.33, 0.33)) if glass.color[1] < 0.3 else finishes.dark(rng)
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

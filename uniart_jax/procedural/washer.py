"""Washing machines and dryers: front loaders with a round door, top loaders with a lid; drum,
detergent drawer, dial."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import appliances, finishes, hinges, materials
from uniart_jax.procedural.fronts import add_drawer
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    hinge,
    revolution,
    turn,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A washing machine, metres, closed."""
    return _front_loader(rng) if rng.random() < 0.7 else _top_loader(rng)


def _front_loader(rng: np.random.Generator) -> ArticulatedObject:
    width, height, depth = (
        float(rng.uniform(0.55, 0.72)),
        float(rng.uniform(0.8, 1.0)),
        float(rng.uniform(0.45, 0.75)),
    )
    unit = max(width, height, depth) / 100
    face = finishes.appliance(rng)
    look = appliances.style(rng, unit, face, handles=("recess", "lip", "none"))
    half, legs = width / 2, float(rng.uniform(0.015, 0.06))
    band = float(rng.uniform(0.11, 0.17))  # control panel at the top
    radius = float(rng.uniform(0.3, 0.4)) * width
    radius = min(radius, (height - band - legs) / 2 - 0.03)
    center = (
        float(rng.choice([0.0, 0.0, rng.uniform(-0.03, 0.03)])),
        legs + (height - band - legs) * float(rng.uniform(0.5, 0.58)),
    )
    center = (center[0], min(center[1], height - band - radius - 0.015))
    wall = max(0.025, 2.2 * unit)
    opening = radius * float(rng.uniform(0.7, 0.85))
    chamber = min(
        half - wall, center[1] - legs - wall, height - band - center[1] - wall / 2, 1.25 * radius
    )
    opening = min(opening, chamber)

    asm, body = Assembly(), Shape()
    appliances.feet(body, rng, width, depth, legs, unit)
    holes = [
        cylinder("x", [-0.1, *center], 0.1 + wall + 0.001, opening, segments=28),
        cylinder("x", [wall, *center], depth - 2 * wall, chamber, segments=28),
    ]
    side = float(rng.choice([-1, 1]))
    drawer = rng.random() < 0.6
    panel_z = (height - band + 0.005, height - 0.012)
    bay = None
    if drawer:
        wide = float(rng.uniform(0.22, 0.34)) * width
        y = sorted((side * (half - 0.012), side * (half - 0.012 - wide)))
        bay = (
            np.array([0.0, y[0] + 0.012, panel_z[0] + 0.01]),
            np.array([depth * 0.6, y[1] - 0.012, panel_z[1] - 0.012]),
        )
        holes.append(box([-0.1, *bay[0][1:]], bay[1]))
    body.add(cut(box([0, -half, legs], [depth, half, height]), holes), face)
    proud = max(0.006, 1.0 * unit)
    strip_y = [-half, half]
    if drawer:
        strip_y = [-half, y[0] - 0.004] if side > 0 else [y[1] + 0.004, half]
    dark = finishes.dark(rng) if rng.random() < 0.4 else face.darker(float(rng.uniform(0.6, 0.97)))
    body.add(box([-proud, strip_y[0], panel_z[0]], [0, strip_y[1], height]), dark)
    span, z = strip_y[1] - strip_y[0], (panel_z[0] + height) / 2
    knob_y = strip_y[0] + span * float(rng.choice([0.5, 0.25, 0.75], p=[0.5, 0.25, 0.25]))
    knob = rng.random() < 0.8
    if rng.random() < 0.7:
        a = strip_y[0] + span * (0.68 if knob_y < strip_y[0] + 0.6 * span else 0.12)
        appliances.display(
            body,
            -proud,
            (a, a + 0.22 * span),
            (z - 0.18 * band, z + 0.2 * band),
            max(0.003, 0.5 * unit),
            materials.dark_glass(rng),
        )
    if rng.random() < 0.5 and knob_y > strip_y[0] + 0.35 * span:
        a = strip_y[0] + 0.05 * span
        appliances.buttons(
            body,
            rng,
            -proud,
            (a, a + 0.2 * span),
            (z - 0.15 * band, z + 0.15 * band),
            unit,
            look.hardware,
        )
    if rng.random() < 0.4 and center[1] - radius - legs > 0.1:  # filter flap, part of the body
        a = half * 0.9 * -side
        y2 = sorted((a, a + 0.3 * half * side))
        body.add(box([-0.5 * unit, y2[0], legs + 0.02], [0, y2[1], legs + 0.09]), face.darker(0.85))
    root = asm.add("body", body)

    edge = "+y" if rng.random() < 0.65 else "-y"
    _round_door(rng, asm, root, center, radius, unit, edge, look, square=rng.random() < 0.2)
    if rng.random() < 0.75:
        _drum(
            rng,
            asm,
            root,
            "x",
            [wall + 0.01, *center],
            depth - 2 * wall - 0.03,
            chamber - 0.012,
            opening,
            unit,
        )
    if drawer and bay is not None:
        lo, hi = (
            np.array([-max(0.018, 1.8 * unit), y[0], panel_z[0]]),
            np.array([-0.002, y[1], panel_z[1]]),
        )
        add_drawer(
            asm,
            root,
            lo,
            hi,
            *bay,
            float(rng.uniform(0.5, 0.85)),
            look,
            name="detergent_drawer",
            fill=0.85,
        )
    if knob:
        finish = look.hardware if rng.random() < 0.6 else face.darker(0.9)
        appliances.knob_row(asm, rng, root, -proud, [knob_y], z, unit, finish, largest=0.36 * band)
    return asm.object()


def _round_door(
    rng,
    asm: Assembly,
    root: int,
    center,
    radius: float,
    unit: float,
    edge: str,
    look,
    *,
    square: bool,
) -> int:
    """A porthole: ring and bulging glass, or a square door with a round window; hinged at its outer
    front edge."""
    y, z = center
    thick = max(0.03, float(rng.uniform(2.6, 5.0)) * unit)
    back, front = -0.002, -0.002 - thick
    ring = finishes.metal(rng, brushed=False) if rng.random() < 0.5 else finishes.dark(rng)
    if rng.random() < 0.3:
        ring = look.face.darker(0.95)
    glass = look.glass
    inner = radius * float(rng.uniform(0.6, 0.78))
    shape, sign = Shape(), 1 if edge == "+y" else -1
    window = cylinder("x", [front - 1, y, z], 2 + thick, inner, segments=24)
    if square:
        lo, hi = [front, y - radius, z - radius], [back, y + radius, z + radius]
        plate = box(lo, hi)
    else:
        profile = np.array(
            [[0, 0], [radius, 0], [radius, -0.7 * thick], [0.93 * radius, -thick], [0, -thick]]
        )
        plate = revolution(profile, "x", [back, y, z], 28)
        h = 0.22 * radius  # a hinge block, so that the hinged side shows
        b0, b1 = sorted((y + sign * 0.9 * radius, y + sign * 1.02 * radius))
        plate = union([plate, box([front, b0, z - h], [back, b1, z + h])])
    shape.add(cut(plate, (window,)), ring)
    bulge = thick * float(rng.uniform(0.0, 0.5)) + 0.001
    dome = np.array(
        [
            [0, -0.15 * thick],
            [inner, -0.15 * thick],
            [inner, -0.8 * thick],
            [0.7 * inner, -thick - 0.7 * bulge],
            [0, -thick - bulge],
        ]
    )
    shape.add(revolution(dome, "x", [back, y, z], 24), glass)
    r = 0.85 * radius  # the handle, opposite to the hinge
    w, reach = max(0.014, 1.5 * unit), max(0.018, 2.0 * unit)
    tall = radius * float(rng.uniform(0.2, 0.4))
    grip = look.hardware if look.hardware is not ring else ring.darker(0.6)
    shape.add(
        box(
            [front - reach, y - sign * r - w / 2, z - tall], [front, y - sign * r + w / 2, z + tall]
        ),
        grip,
    )
    behind, _ = hinges.place(thick, 2 * radius, look.axis_depth, 0.0)
    axis = [front + behind, y + sign * (radius * (1.0 if square else 1.02)), z]
    angle = hinges.opening(rng, 0.4)
    if behind > 0:
        angle = min(angle, hinges.clear_angle(thick, behind, 0.0, 1.0))
    return asm.add("door", shape, root, hinge(axis, (0, 0, -sign), angle))


def _drum(
    rng,
    asm: Assembly,
    root: int,
    axis: str,
    at,
    length: float,
    radius: float,
    opening: float,
    unit: float,
) -> int:
    """A steel drum, open at one end, with three lifters; turns without end. ``at``: the end that is
    open for 'x', shut for 'z'."""
    wall = max(0.014, 1.7 * unit)
    steel = finishes.metal(rng, brushed=False)
    mouth = min(opening, radius - wall) if axis == "x" else radius - wall
    # profile of (radius, height): a cup whose mouth is narrower than its body
    cup = np.array([
        [0, length], [radius, length], [radius, 0], [mouth, 0], [mouth, wall], [radius - wall, wall],  # noqa: E501
        [radius - wall, length - wall], [0, length - wall],
    ])  # fmt: skip
    if axis == "z":
        cup = np.array(
            [
                [0, 0],
                [radius, 0],
                [radius, length],
                [radius - wall, length],
                [radius - wall, wall],
                [0, wall],
            ]
        )
    solids = [revolution(cup, axis, at, 24)]
    start = rng.uniform(0, 2 * np.pi)
    for k in range(3):
        angle = np.rad2deg(start) + 120.0 * k
        lifter = box(
            [0.62 * radius, -wall, 0.5 * wall], [radius - wall / 2, wall, length - 0.5 * wall]
        )
        frame = {"x": (0, 90, 0), "z": (0, 0, 0)}[axis]
        lifter = lifter.rotate((0, 0, float(angle)))
        if axis == "x":
            lifter = lifter.rotate(frame)
        solids.append(lifter.translate(tuple(at)))
    direction = (1, 0, 0) if axis == "x" else (0, 0, 1)
    return asm.add("drum", Shape().add(union(solids), steel), root, turn(at, direction))


def _top_loader(rng: np.random.Generator) -> ArticulatedObject:
    width, height, depth = (
        float(rng.uniform(0.5, 0.7)),
        float(rng.uniform(0.82, 1.0)),
        float(rng.uniform(0.5, 0.7)),
    )
    unit = max(width, height, depth) / 100
    face = finishes.appliance(rng)
    look = appliances.style(rng, unit, face, handles=("lip", "recess"))
    half, legs = width / 2, float(rng.uniform(0.015, 0.05))
    wall = max(0.025, 2.2 * unit)
    console = float(rng.uniform(0.12, 0.18))
    guard = float(rng.uniform(0.08, 0.18))
    start = float(rng.uniform(0.02, 0.08))
    back = depth - console - 0.01
    lid_y = half - float(rng.uniform(0.005, 0.06))
    thick = max(0.018, 1.8 * unit)
    middle = (start + back) / 2
    radius = min((back - start) / 2 - 0.03, lid_y - 0.03)
    chamber = min(half, middle, depth - middle) - wall

    asm, body = Assembly(), Shape()
    appliances.feet(body, rng, width, depth, legs, unit)
    floor = legs + max(0.1, 0.12 * height)
    holes = [
        cylinder("z", [middle, 0, height - wall - 0.001], wall + 0.1, radius, segments=28),
        cylinder("z", [middle, 0, floor], height - wall - floor, chamber, segments=28),
    ]
    body.add(cut(box([0, -half, legs], [depth, half, height]), holes), face)
    dark = finishes.dark(rng) if rng.random() < 0.4 else face.darker(0.9)
    body.add(box([depth - console, -half, height], [depth, half, height + guard]), dark)
    face_x, z = depth - console, height + guard / 2 + thick / 2
    count = int(rng.integers(0, 4))
    ys = (
        [float(v) for v in np.linspace(-0.65, 0.65, count) * half]
        if count > 1
        else [0.55 * half * float(rng.choice([-1, 1]))] * count
    )
    if count < 3:
        a = -0.2 * half
        appliances.display(
            body,
            face_x,
            (a, a + 0.4 * half),
            (z - 0.2 * guard, z + 0.2 * guard),
            max(0.003, 0.5 * unit),
            materials.dark_glass(rng),
        )
    root = asm.add("body", body)

    lid = Shape()
    lo, hi = (
        np.array([start, -lid_y, height + 0.002]),
        np.array([back - (0.028 if ys else 0), lid_y, height + 0.002 + thick]),
    )  # opened, it stands before the knobs
    frame = 0.16 * (back - start)
    if rng.random() < 0.4:  # a window in the lid
        hole = box(
            [lo[0] + frame, lo[1] + frame, lo[2] - 1], [hi[0] - frame, hi[1] - frame, hi[2] + 1]
        )
        lid.add(cut(box(lo, hi), (hole,)), look.face)
        lid.add(
            box(
                [lo[0] + frame, lo[1] + frame, lo[2]],
                [hi[0] - frame, hi[1] - frame, hi[2] - 0.15 * thick],
            ),
            look.glass,
        )
    else:
        lid.add(box(lo, hi), look.face.darker(float(rng.uniform(0.88, 1.0))))
    w = max(0.02, 1.8 * unit)
    grip = float(rng.uniform(0.15, 0.5)) * lid_y
    lid.add(box([lo[0] - w, -grip, lo[2] + 0.2 * thick], [lo[0], grip, hi[2]]), look.hardware)
    angle = np.pi / 2 if rng.random() < 0.4 else float(np.deg2rad(rng.uniform(65, 90)))
    asm.add("lid", lid, root, hinge([hi[0], 0, hi[2]], (0, 1, 0), angle))
    if rng.random() < 0.75:
        _drum(
            rng,
            asm,
            root,
            "z",
            [middle, 0, floor + 0.01],
            height - wall - floor - 0.03,
            chamber - 0.012,
            radius,
            unit,
        )
    if ys:
        appliances.knob_row(asm, rng, root, face_x, ys, z, unit, look.hardware, largest=0.3 * guard)
    return asm.object()

"""Microwave and toaster ovens: a door at the side or a flap, a control panel with knobs or buttons,
a turntable."""

from __future__ import annotations

import dataclasses

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import appliances, finishes, materials
from uniart_jax.procedural.fronts import add_door
from uniart_jax.procedural.hinges import opening
from uniart_jax.procedural.shapes import Assembly, Shape, box, cut, cylinder, revolution, turn


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A microwave, metres, closed."""
    width, height, depth = (
        float(rng.uniform(0.4, 0.78)),
        float(rng.uniform(0.24, 0.46)),
        float(rng.uniform(0.28, 0.5)),
    )
    unit = max(width, height, depth) / 100
    face = finishes.appliance(rng)
    flap = rng.random() < 0.2
    look = appliances.style(
        rng, unit, face, panels=("glass", "glass", "glass", "border", "slab"),
        handles=("bar", "bar", "round_bar", "arch", "recess", "lip"),
    )  # fmt: skip
    look = dataclasses.replace(
        look,
        thickness=max(0.01, float(rng.uniform(1.7, 5.0)) * unit),
        accent=materials.dark_glass(rng),
        face=face if rng.random() < 0.6 else finishes.dark(rng),
        handle_length=float(rng.uniform(0.45, 0.8)),
        reach=0.5 * height,
    )
    thick, half = look.thickness, width / 2
    legs = float(rng.choice([0.0, rng.uniform(0.008, 0.02)], p=[0.3, 0.7]))
    wall = max(0.012, float(rng.uniform(1.8, 3.2)) * unit)
    share = float(rng.uniform(0.11, 0.31)) * width
    side = -1 if rng.random() < 0.85 else 1  # controls on the right as seen from the front, mostly
    # controls in a band over or under the door instead of at the side
    banded = rng.random() < (0.5 if flap else 0.1)
    bottom = banded and rng.random() < 0.45
    band = float(rng.uniform(0.15, 0.3)) * height if banded else 0.0
    low = legs
    # strips of the front above and below the door that stay
    above, under = (
        float(rng.choice([0.0, rng.uniform(0.03, 0.2)], p=[0.6, 0.4])) * height for _ in range(2)
    )
    above = 0.0 if banded else above
    under = band if bottom else 0.6 * under
    sill, lintel = low + under, height - above - (0.0 if bottom else band)

    if banded:
        bay_y, door_y = (-half + wall, half - wall), (-half, half)
    elif side < 0:
        bay_y, door_y = (-half + share, half - wall), (-half + share, half)
    else:
        bay_y, door_y = (-half + wall, half - share), (-half, half - share)
    bay_lo = np.array([0.0, bay_y[0], sill + wall])
    bay_hi = np.array([depth - wall, bay_y[1], lintel - wall])

    asm, body = Assembly(), Shape()
    if legs:
        r = 2.2 * unit
        rubber = finishes.dark(rng)
        for x in (2 * r, depth - 2 * r):
            for y in (-half + 2 * r, half - 2 * r):
                body.add(cylinder("z", [x, y, 0], legs, r, segments=10), rubber)
    lining = (
        finishes.white_plastic(rng) if rng.random() < 0.6 else finishes.metal(rng, brushed=False)
    )
    case = box([0, -half, low], [depth, half, height])
    liner = box([0.002, bay_lo[1] - 0.4 * wall, bay_lo[2] - 0.4 * wall], bay_hi + 0.4 * wall)
    room = box([-0.1, *bay_lo[1:]], bay_hi)
    body.add(cut(case, (liner, room)), face)
    body.add(cut(liner, (room,)), lining)
    front, seam = -thick - 0.002, max(0.003, 0.5 * unit)
    if banded:
        edge = (low, sill - seam / 2) if bottom else (lintel + seam / 2, height)
        area_y, area_z = (-half, half), edge
    elif side < 0:
        area_y, area_z = (-half, -half + share - seam / 2), (low, height)
    else:
        area_y, area_z = (half - share + seam / 2, half), (low, height)
    board = look.face if rng.random() < 0.5 else finishes.dark(rng)
    body.add(box([front, area_y[0], area_z[0]], [0, area_y[1], area_z[1]]), board)
    strips = [] if bottom else [(low, sill - seam / 2)]
    strips += [] if banded else [(lintel + seam / 2, height)]
    for a, b in strips:
        if b - a > 0.005:
            body.add(box([front, door_y[0] + 0.001, a], [0, door_y[1] - 0.001, b]), board)
    knobs = _panel(rng, body, front, area_y, area_z, unit, banded, look)
    root = asm.add("body", body)

    lo = np.array([front, door_y[0] + (0.001 if door_y[0] == -half else seam / 2), sill + 0.002])
    hi = np.array(
        [
            -0.002,
            door_y[1] - (0.001 if door_y[1] == half else seam / 2),
            lintel - (seam / 2 if banded and not bottom else 0.002),
        ]
    )
    if flap:
        angle = np.pi / 2 if rng.random() < 0.6 else float(np.deg2rad(rng.uniform(75, 100)))
        add_door(asm, root, lo, hi, "-z", angle, look, inset=under > 0, beyond=1.0)
    else:
        # the handle stands by the controls, the hinge away from them
        add_door(
            asm,
            root,
            lo,
            hi,
            "+y" if side < 0 else "-y",
            opening(rng, 0.25),
            look,
            beyond=0.001,
        )

    if rng.random() < 0.5:
        _turntable(rng, asm, root, bay_lo, bay_hi, unit, look.glass)
    finish = look.hardware if rng.random() < 0.7 else finishes.white_plastic(rng)
    for y, z, largest in knobs:
        appliances.knob_row(asm, rng, root, front, [y], z, unit, finish, largest=largest)
    return asm.object()


def _panel(
    rng, body: Shape, front: float, y, z, unit: float, banded: bool, look
) -> list[tuple[float, float, float]]:
    """Display and buttons on the control panel; returns (y, z, largest radius) of the knobs to
    add."""
    proud = max(0.002, 0.5 * unit)
    width, tall = y[1] - y[0], z[1] - z[0]
    middle = (y[0] + y[1]) / 2
    screen = materials.plain((0.25, 0.5, 0.45)) if rng.random() < 0.4 else materials.dark_glass(rng)
    count = int(rng.choice([0, 1, 2, 3], p=[0.42, 0.22, 0.3, 0.06]))
    if banded:
        ys = np.linspace(-0.6, 0.6, max(count, 2))[:count] * width / 2
        if count < 3:
            appliances.display(
                body,
                front,
                (-0.14 * width, 0.14 * width),
                (z[0] + 0.25 * tall, z[1] - 0.25 * tall),
                proud,
                screen,
            )
        return [(float(v), (z[0] + z[1]) / 2, 0.3 * tall) for v in ys]
    inner = (y[0] + 0.15 * width, y[1] - 0.15 * width)
    if rng.random() < 0.8:
        appliances.display(
            body, front, inner, (z[1] - 0.2 * tall, z[1] - 0.07 * tall), proud, screen
        )
    if count == 0:
        appliances.buttons(
            body,
            rng,
            front,
            inner,
            (z[0] + 0.12 * tall, z[1] - 0.27 * tall),
            1.3 * unit,
            look.hardware,
        )
        return []
    zs = (
        np.linspace(z[0] + 0.22 * tall, z[0] + 0.64 * tall, count)
        if count > 1
        else [z[0] + tall * float(rng.uniform(0.25, 0.55))]
    )
    return [
        (middle, float(v), min(0.36 * width, 0.14 * tall if count < 3 else 0.085 * tall))
        for v in zs
    ]


def _turntable(rng, asm: Assembly, root: int, lo, hi, unit: float, glass) -> int:
    """A plate with a rim on the floor of the room; a handle bar across it shows how it is
    turned."""
    center = [(lo[0] + hi[0]) / 2, (lo[1] + hi[1]) / 2, lo[2] + 0.003]
    radius = float(rng.uniform(0.36, 0.48)) * min(hi[0] - lo[0], hi[1] - lo[1])
    t = max(0.004, float(rng.uniform(0.7, 2.4)) * unit)
    profile = np.array(
        [
            [0, 0],
            [0.9 * radius, 0],
            [radius, 1.6 * t],
            [0.9 * radius, 1.6 * t],
            [0.82 * radius, t],
            [0, t],
        ]
    )
    shape = Shape().add(
        revolution(profile, "z", center, 24), materials.glass(rng) if rng.random() < 0.6 else glass
    )
    return asm.add("turntable", shape, root, turn(center, (0, 0, 1)))

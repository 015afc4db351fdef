"""What kitchen and laundry appliances have in common: their fronts' look, hollow bodies, racks and
control panels."""

from __future__ import annotations

import itertools

import numpy as np
from manifold3d import Manifold

from uniart_jax.procedural import finishes, materials
from uniart_jax.procedural.fronts import FrontStyle, add_knob
from uniart_jax.procedural.hinges import hang
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import Assembly, Shape, box, cut, cylinder, tray


def style(
    rng: np.random.Generator,
    unit: float,
    face: Material,
    *,
    panels=("slab",),
    handles=("bar",),
    own_handle: float = 0.06,
) -> FrontStyle:
    """Fronts of one appliance; ``panels`` and ``handles``: what its kind uses; ``own_handle``: the
    share whose handles are parts."""
    return FrontStyle(
        panel=str(rng.choice(panels)),
        handle=str(rng.choice(handles)),
        face=face,
        accent=face.darker(0.85),
        glass=materials.dark_glass(rng) if rng.random() < 0.75 else materials.glass(rng),
        hardware=materials.hardware(rng) if rng.random() < 0.7 else face.darker(0.8),
        inside=finishes.white_plastic(rng)
        if rng.random() < 0.6
        else finishes.metal(rng, brushed=False),
        thickness=max(0.03, 2.4 * unit),
        unit=unit,
        handle_length=float(rng.uniform(0.35, 0.8)),
        reach=float(rng.uniform(0.9, 1.2)),
        own_handle=bool(rng.random() < own_handle),
        **hang(rng, unit),
    )


def rack(lo, hi, wall: float, openings: int) -> Manifold:
    """An open tray whose sides and floor are cut into bars of about ``wall``: dish racks, oven
    racks."""
    lo, hi = np.asarray(lo, dtype=np.float64), np.asarray(hi, dtype=np.float64)
    solid = tray(lo, hi, wall)
    holes = []
    for axis in (0, 1):
        count = max(2, openings)
        borders = np.linspace(lo[axis] + wall, hi[axis] - wall, count + 1)
        for a, b in itertools.pairwise(borders):
            if b - a < 2.2 * wall:
                continue
            hole_lo, hole_hi = lo - wall, hi + wall
            hole_lo[axis], hole_hi[axis] = a + wall / 2, b - wall / 2
            hole_lo[2], hole_hi[2] = lo[2] + wall, hi[2] - wall
            if hole_hi[2] - hole_lo[2] > wall:
                holes.append(box(hole_lo, hole_hi))
    borders = np.linspace(lo[1] + wall, hi[1] - wall, max(2, openings) + 1)
    for a, b in itertools.pairwise(borders):
        if b - a > 2.2 * wall:
            floor_lo = [lo[0] + wall, a + wall / 2, lo[2] - wall]
            holes.append(box(floor_lo, [hi[0] - wall, b - wall / 2, lo[2] + 2 * wall]))
    return cut(solid, holes)


def feet(
    body: Shape, rng: np.random.Generator, width: float, depth: float, legs: float, unit: float
) -> None:
    """Four round or square feet from the floor to z = ``legs``, or a dark kick plate set back from
    the front."""
    material = finishes.dark(rng)
    if rng.random() < 0.5:
        back = float(rng.uniform(0.03, 0.07))
        body.add(
            box([back, -width / 2 + 0.01, 0], [depth - 0.01, width / 2 - 0.01, legs]), material
        )
        return
    r = max(0.02, 1.5 * unit)
    for x in (2 * r, depth - 2 * r):
        for y in (-width / 2 + 2 * r, width / 2 - 2 * r):
            body.add(cylinder("z", [x, y, 0], legs, 0.8 * r, r, segments=12), material)


def bins_behind(places, sizes, unit: float, material: Material) -> Shape | None:
    """Open bins on the rear of a door, far enough from its edges to swing past the walls; None
    where there is no room.

    Args:
      places: corners of the door, and of the room behind it. sizes: how far bins reach from the
        door, the thickness of their walls, their height.
    """
    (lo, hi, bay_lo, bay_hi), (reach, wall, tall) = places, sizes
    shape = Shape()
    air = 0.03 + (reach + hi[0] - lo[0]) ** 2 / (2 * (hi[1] - lo[1]))
    y = (max(lo[1], bay_lo[1]) + air, min(hi[1], bay_hi[1]) - air)
    count = int(np.clip((bay_hi[2] - bay_lo[2]) / 0.35, 0, 4))
    if y[1] - y[0] < 8 * unit or count == 0:
        return None
    for z in np.linspace(bay_lo[2] + 0.02, bay_hi[2] - tall - 0.06, count):
        shape.add(tray([hi[0], y[0], z], [hi[0] + reach, y[1], z + tall], wall), material)
    return shape


def display(
    body: Shape, face: float, y: tuple[float, float], z: tuple[float, float], proud: float, material
) -> None:
    """A dark screen or button field that stands ``proud`` of the plane x = ``face``."""
    body.add(box([face - proud, y[0], z[0]], [face, y[1], z[1]]), material)


def buttons(
    body: Shape,
    rng,
    face: float,
    y: tuple[float, float],
    z: tuple[float, float],
    unit: float,
    material,
) -> None:
    """A field of small buttons on the plane x = ``face``."""
    size = max(0.012, 1.8 * unit)
    columns = int(np.clip((y[1] - y[0]) / (1.7 * size), 1, 4))
    rows = int(np.clip((z[1] - z[0]) / (1.7 * size), 1, 5))
    round_ones, proud = rng.random() < 0.3, max(0.003, 0.5 * unit)
    for i in range(columns):
        for j in range(rows):
            cy = y[0] + (i + 0.5) * (y[1] - y[0]) / columns
            cz = z[0] + (j + 0.5) * (z[1] - z[0]) / rows
            if round_ones:
                solid = cylinder("x", [face - proud, cy, cz], proud, size / 2, segments=10)
            else:
                solid = box(
                    [face - proud, cy - size / 2, cz - 0.35 * size],
                    [face, cy + size / 2, cz + 0.35 * size],
                )
            body.add(solid, material)


def knob_row(
    asm: Assembly,
    rng,
    parent: int,
    face: float,
    ys,
    z: float,
    unit: float,
    material: Material,
    *,
    largest: float = 0.03,
) -> list[int]:
    """Turning knobs of one kind on the plane x = ``face`` at every y of ``ys``; see ``knobs``."""
    places = [(face, float(y), z) for y in ys]
    return knobs(asm, rng, parent, places, unit, material, largest=largest)


def knobs(
    asm: Assembly,
    rng,
    parent: int,
    places,
    unit: float,
    material: Material,
    *,
    largest: float = 0.03,
    tilt: float = 0.0,
) -> list[int]:
    """Turning knobs of one kind at ``places`` (x, y, z), on a panel that leans back by ``tilt``
    radians (a right angle: that lies flat).

    What a picture shows decides how they turn: knobs with end stops have a pointer on a skirt of
    the mark's colour, knobs that turn without end are plain.
    """
    radius = max(float(rng.uniform(0.45, 1.2)) * largest, 1.7 * unit)
    reach = max(float(rng.uniform(0.012, 0.04)), float(rng.uniform(1.0, 2.4)) * unit)
    sweep = None if rng.random() < 0.5 else float(np.deg2rad(rng.choice([180, 240, 270, 300])))
    light = material.color[1] >= 0.5
    mark = materials.plain((0.1, 0.1, 0.1) if light else (0.95, 0.95, 0.95))
    look, stops = (material, mark, sweep), sweep is not None
    return [
        add_knob(asm, parent, at, radius, reach, *look, pointer=stops, skirt=stops, tilt=tilt)
        for at in places
    ]

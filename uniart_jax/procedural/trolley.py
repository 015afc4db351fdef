"""Trolleys: drawers, a door or open trays on four castors that swivel and roll; office pedestals,
tool and kitchen trolleys."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.cabinet import Case, Cell, Fit
from uniart_jax.procedural.fronts import FrontStyle
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    hull,
    pipe,
    tidy,
    tube,
    turn,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A trolley, metres, closed."""
    office = rng.random() < 0.4
    width = float(rng.uniform(0.36, 0.48) if office else rng.uniform(0.45, 0.9))
    depth = float(rng.uniform(0.42, 0.62) if office else rng.uniform(0.36, 0.55))
    height = float(rng.uniform(0.48, 0.66) if office else rng.uniform(0.65, 1.0))
    unit = max(width, height, depth) / 100
    radius = max(float(rng.uniform(0.02, 0.035) if office else rng.uniform(0.03, 0.06)), 3 * unit)
    rolling = str(rng.choice(["swivel", "castor", "wheel", "still"], p=[0.3, 0.3, 0.25, 0.15]))
    most = {"swivel": 6, "castor": 9, "wheel": 9, "still": 12}[rolling]
    plate = 0.8 * unit
    floor = 2 * radius + max(0.022, 2.2 * unit) + plate
    look = _style(rng, unit, office)
    wall = max(float(rng.uniform(0.012, 0.022)), 1.5 * unit)
    top = max(float(rng.uniform(0.015, 0.03)), 1.5 * unit) if rng.random() < 0.7 else 0.0
    z = (floor, height - top)
    shelf = not office and rng.random() < 0.25  # an open bay below, drawers above
    borders = _borders(rng, z, most, 6.5 * unit, shelf)
    cells = [Cell((-width / 2, width / 2), pair, "drawer") for pair in itertools.pairwise(borders)]
    if shelf:
        cells[0] = Cell(cells[0].y, cells[0].z, str(rng.choice(["open", "door", "double"])))
    if not shelf and width > 0.6 and len(cells) * 2 <= most and rng.random() < 0.25:
        middle = float(rng.uniform(-0.2, 0.2)) * width
        sides = [(-width / 2, middle), (middle, width / 2)]
        cells = [Cell(side, cell.z, cell.kind) for cell in cells for side in sides]
    case = Case((-width / 2, width / 2), z, 0.0, depth, wall, tuple(cells))

    finish = look.face if rng.random() < 0.6 else _finish(rng, office)
    rubber = materials.dark(rng) if rng.random() < 0.75 else materials.paint(rng)
    steel = materials.metal(rng, brushed=False) if rng.random() < 0.7 else materials.dark(rng)
    asm, body = Assembly(), Shape()
    body.add(case.solid(rng), finish)
    if top:
        _top(rng, body, width, depth, z[1], height, unit, look, finish)
    if not office and rng.random() < 0.6:
        _push_bar(rng, body, width, depth, height - top, unit, steel)
    places = _places(rng, width, depth, radius)
    pairs = [_castor(radius, floor, plate, unit, *place) for place in places]
    if rolling in ("wheel", "still"):
        body.add(union([fork for fork, *_ in pairs]), steel)
    if rolling == "still":
        body.add(union([wheel for _, wheel, *_ in pairs]), rubber)
    root = asm.add("body", body)
    fit = Fit.draw(rng, unit, wall)
    if np.diff(borders).min() < 3 * look.thickness + wall:  # too low for fronts inside their bays
        fit = dataclasses.replace(fit, inset=False)
    case.add_fronts(rng, asm, root, look, fit)
    if rolling == "still":
        return asm.object()
    for (x, y, _), (fork, wheel, center, axle) in zip(places, pairs, strict=True):
        parent = root
        if rolling != "wheel":
            shape = Shape().add(fork, steel)
            if rolling == "castor":
                shape.add(wheel, rubber)
            parent = asm.add("castor", shape, root, turn((x, y, 0), (0, 0, 1)))
        if rolling != "castor":
            asm.add("wheel", Shape().add(wheel, rubber), parent, turn(center, axle))
    return asm.object()


def _finish(rng: np.random.Generator, office: bool) -> Material:
    kind = rng.random()
    if kind < (0.35 if office else 0.15):
        return materials.wood(rng)
    return materials.metal(rng) if kind > 0.8 else materials.paint(rng)


def _style(rng: np.random.Generator, unit: float, office: bool) -> FrontStyle:
    face = _finish(rng, office)
    grips = ["bar", "round_bar", "arch", "knob", "lip", "recess", "none"]
    return FrontStyle(
        panel=str(rng.choice(["slab", "border", "shaker"], p=[0.85, 0.1, 0.05])),
        handle=str(rng.choice(grips, p=[0.25, 0.12, 0.12, 0.08, 0.22, 0.14, 0.07])),
        face=face,
        accent=face.darker(0.85),
        glass=materials.glass(rng),
        hardware=materials.hardware(rng),
        inside=face.darker(0.85),
        thickness=max(float(rng.uniform(0.014, 0.024)), 1.5 * unit),
        unit=0.85 * unit,
        handle_length=float(rng.uniform(0.25, 0.85)),
    )


def _borders(rng, z, most: int, least: float, shelf: bool) -> list[float]:
    """Heights between drawers, from below: equal, or shallower towards the top; ``shelf``: one tall
    bay below."""
    low = z[0] + (float(rng.uniform(0.3, 0.55)) * (z[1] - z[0]) if shelf else 0)
    count = int(rng.integers(3, 13))
    count = max(1, min(count, most - 2 * shelf, int((z[1] - low) / least)))
    weights = np.ones(count)
    if rng.random() < 0.55:
        weights = np.linspace(float(rng.uniform(1.3, 2.2)), 1, count)
    sizes = weights / weights.sum() * (z[1] - low)
    if sizes.min() < least:
        sizes = np.full(count, (z[1] - low) / count)
    edges = low + np.concatenate([[0], np.cumsum(sizes)])
    return [z[0], *map(float, edges)] if shelf else [float(e) for e in edges]


def _top(rng, body: Shape, width, depth, low, high, unit, look: FrontStyle, finish) -> None:
    """A slab, or a slab with a rim that keeps tools from falling off."""
    over = look.thickness + float(rng.choice([0.0, 1.0])) * unit
    lo, hi = np.array([-over, -width / 2, low]), np.array([depth, width / 2, high])
    slab = finish if rng.random() < 0.5 else materials.furniture(rng)
    if rng.random() < 0.35:
        slab = materials.dark(rng)
    solid = box(lo, hi)
    if rng.random() < 0.45:
        rim, rise = 1.2 * unit, float(rng.uniform(1.5, 5)) * unit
        solid = box(lo, hi + [0, 0, rise]) - box(lo + [rim, rim, high - low], hi + [-rim, -rim, 1])
    body.add(solid, slab.along("y"))


def _push_bar(rng, body: Shape, width, depth, z, unit, steel: Material) -> None:
    """A bar to push it by, at one side."""
    way = float(rng.choice([-1, 1]))
    x, reach, r = float(rng.uniform(0.12, 0.3)) * depth, float(rng.uniform(4, 9)) * unit, 1.0 * unit
    y, low = way * width / 2, z - float(rng.uniform(4, 8)) * unit
    line = [[x, y, low], [x, y + way * reach, low], [depth - x, y + way * reach, low]]
    bar = pipe([*line, [depth - x, y, low]], r)
    keep = box([-1, width / 2, 0], [2, 2, 2]) if way > 0 else box([-1, -2, 0], [2, -width / 2, 2])
    body.add(bar ^ keep, steel)


def _places(rng, width, depth, radius) -> list[tuple[float, float, float]]:
    """(x, y, heading) of the castors' pins."""
    edge = 2.1 * radius
    places = [(x, y) for x in (edge, depth - edge) for y in (edge - width / 2, width / 2 - edge)]
    heading = float(rng.uniform(0, 2 * np.pi))
    same = rng.random() < 0.5
    return [(x, y, heading if same else float(rng.uniform(0, 2 * np.pi))) for x, y in places]


def _castor(
    radius: float, floor: float, plate: float, unit: float, x: float, y: float, heading: float
) -> tuple[Manifold, Manifold, np.ndarray, np.ndarray]:
    """A fork under z = ``floor`` and its wheel, trailing behind the pin at (x, y); with the wheel's
    centre and axle."""
    trail, half, air = 0.7 * radius, 0.45 * radius, 0.25 * unit
    wall = 0.7 * unit
    outer, axle_r = half + air + wall, 0.28 * radius
    wheel = cylinder("y", [trail, -half, radius], 2 * half, radius, segments=22)
    groove = tube("y", [trail, -0.25 * half, radius], 0.5 * half, 2 * radius, 0.93 * radius)
    bore = cylinder("y", [trail, -1, radius], 2, axle_r + air, segments=12)
    wheel = cut(wheel, (groove, bore))
    bridge = 2 * radius + air
    cheek = []
    for side in (-outer, half + air):
        points = [
            [trail + dx, side + dy, z]
            for dx, z in (
                (-1.4 * axle_r, radius - 1.4 * axle_r),
                (1.4 * axle_r, radius - 1.4 * axle_r),
                (trail * 0.3, bridge),
                (-trail - 0.5 * radius, bridge),
            )
            for dy in (0, wall)
        ]
        cheek.append(hull(np.array(points)))
    lid = box([-0.5 * radius, -outer, bridge], [trail + 0.3 * trail, outer, bridge + wall])
    pin = cylinder("z", [0, 0, bridge], floor - plate - bridge, 0.55 * radius, segments=14)
    head = cylinder("z", [0, 0, floor - plate], plate - 0.0008, 0.8 * radius, segments=14)
    axle = cylinder("y", [trail, -outer, radius], 2 * outer, axle_r, segments=12)
    fork = tidy(union([*cheek, lid, pin, head, axle]))
    degrees = float(np.rad2deg(heading))
    way = np.array([np.cos(heading), np.sin(heading), 0])
    center = np.array([x, y, radius]) + trail * way
    move = (x, y, 0)
    turned = [solid.rotate((0, 0, degrees)).translate(move) for solid in (fork, wheel)]
    return (*turned, center, np.array([-way[1], way[0], 0]))

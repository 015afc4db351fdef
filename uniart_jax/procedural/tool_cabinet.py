"""Chests of many small drawers: apothecary chests, card catalogues, plan chests, tool cabinets,
desktop organisers."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.cabinet import Case, Cell, Fit
from uniart_jax.procedural.fronts import FrontStyle
from uniart_jax.procedural.shapes import Assembly, Shape, box, cylinder, pipe

MOST = 15  # drawers; with the body no more than procedural.MAX_PARTS

# width, height, depth (metres), columns, rows, whether of metal, weight
_KINDS = {
    "apothecary": ((0.5, 1.2), (0.6, 1.2), (0.25, 0.45), (2, 4), (3, 7), False, 0.26),
    "catalogue": ((0.4, 0.9), (0.35, 1.1), (0.35, 0.5), (2, 3), (3, 7), False, 0.16),
    "plan": ((0.8, 1.4), (0.4, 1.0), (0.55, 0.9), (1, 1), (6, 12), False, 0.14),
    "tools": ((0.6, 1.4), (0.6, 1.1), (0.4, 0.6), (1, 3), (4, 8), True, 0.26),
    "organiser": ((0.2, 0.5), (0.2, 0.5), (0.13, 0.28), (1, 4), (3, 7), True, 0.18),
}


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A chest of 6 to 15 drawers, metres, closed."""
    names = list(_KINDS)
    kind = names[rng.choice(len(names), p=[k[-1] for k in _KINDS.values()])]
    widths, heights, depths, columns, rows, steel, _ = _KINDS[kind]
    width, height, depth = (float(rng.uniform(*r)) for r in (widths, heights, depths))
    unit = max(width, height, depth) / 100
    look = _style(rng, unit, steel)
    wall = max(float(rng.uniform(0.012, 0.024)) * height, 1.2 * unit)
    base = str(rng.choice(["none", "plinth", "legs", "feet"], p=[0.3, 0.3, 0.2, 0.2]))
    share = {"none": (0, 0), "plinth": (0.04, 0.1), "legs": (0.12, 0.35), "feet": (0.02, 0.06)}
    legs = float(rng.uniform(*share[base])) * height
    top = max(float(rng.uniform(0.015, 0.03)), 1.5 * unit) if rng.random() < 0.55 else 0.0
    z = (legs, height - top)
    cells = _cells(rng, width, z, columns, rows, 5.2 * unit)
    case = Case((-width / 2, width / 2), z, 0.0, depth, wall, tuple(cells))
    fit = Fit.draw(rng, unit, wall)
    least = min(cell.z[1] - cell.z[0] for cell in cells)
    inset = fit.inset and least > 3 * look.thickness + wall
    fit = dataclasses.replace(fit, fill=float(rng.uniform(0.6, 0.9)), inset=inset)

    finish = look.face if rng.random() < 0.55 else _finish(rng, steel)
    asm, body = Assembly(), Shape()
    _stand(rng, body, base, legs, width, depth, unit, finish)
    if top:
        over = look.thickness + float(rng.choice([0.0, rng.uniform(0.5, 2.0)])) * unit
        side = float(rng.choice([0.0, rng.uniform(0.5, 2.0)])) * unit
        slab = finish if rng.random() < 0.5 else _finish(rng, steel and rng.random() < 0.5)
        lo, hi = [-over, -width / 2 - side, z[1]], [depth, width / 2 + side, height]
        body.add(box(lo, hi), slab.along("y"))
    if kind == "organiser" and rng.random() < 0.5:  # a carrying handle
        y, rise = float(rng.uniform(0.15, 0.3)) * width, float(rng.uniform(5, 9)) * unit
        line = [[depth / 2, -y, height], [depth / 2, -y, height + rise]]
        line += [[depth / 2, y, height + rise], [depth / 2, y, height]]
        bar = pipe(line, 1.1 * unit) - box([-1, -1, height - 1], [2, 1, height])
        body.add(bar, look.hardware)
    body.add(case.solid(rng), finish)
    root = asm.add("body", body)
    case.add_fronts(rng, asm, root, look, fit)
    return asm.object()


def _finish(rng: np.random.Generator, steel: bool) -> materials.Material:
    if not steel:
        return materials.furniture(rng)
    return materials.metal(rng) if rng.random() < 0.3 else materials.paint(rng)


def _style(rng: np.random.Generator, unit: float, steel: bool) -> FrontStyle:
    """Fronts of one chest: knobs and cups on wood, bars and grips along the edge on steel."""
    face = _finish(rng, steel)
    grips = ["bar", "round_bar", "arch", "knob", "lip", "recess"]
    shares = [0.2, 0.1, 0.1, 0.1, 0.35, 0.15] if steel else [0.1, 0.1, 0.15, 0.5, 0.05, 0.1]
    kinds = ["slab", "border", "shaker"]
    return FrontStyle(
        panel=str(rng.choice(kinds, p=[0.9, 0.1, 0] if steel else [0.6, 0.2, 0.2])),
        handle=str(rng.choice(grips, p=shares)),
        face=face,
        accent=(face, face.darker(0.82), _finish(rng, steel))[rng.integers(3)],
        glass=materials.glass(rng),
        hardware=materials.hardware(rng),
        inside=materials.wood(rng, textured=False) if not steel else face.darker(0.8),
        thickness=float(rng.uniform(1.3, 2.4)) * unit,
        unit=0.62 * unit,  # small fronts, small hardware
        handle_length=float(rng.uniform(0.25, 0.85)),
    )


def _cells(rng, width: float, z, columns, rows, least: float) -> list[Cell]:
    """A grid of drawers: equal, with larger ones below, or with a band of wide ones."""
    for _ in range(200):
        count, tall = (
            int(rng.integers(columns[0], columns[1] + 1)),
            int(rng.integers(rows[0], rows[1] + 1)),
        )
        weights = np.ones(tall)
        manner = rng.random()
        if manner < 0.3:
            weights = np.linspace(rng.uniform(1.3, 2.2), 1, tall)
        elif manner < 0.5:
            weights = rng.choice([1.0, 1.0, 1.7], tall)
        edges = z[0] + np.concatenate([[0], np.cumsum(weights / weights.sum())]) * (z[1] - z[0])
        sides = np.linspace(-width / 2, width / 2, count + 1)
        if count > 1 and rng.random() < 0.2:  # one column wider than the others
            share = np.ones(count)
            share[rng.integers(count)] = rng.uniform(1.4, 2.2)
            sides = -width / 2 + width * np.concatenate([[0], np.cumsum(share / share.sum())])
        wide = rng.random() < 0.25 and count > 1
        band = int(rng.integers(1, 3)) if wide else 0
        low = bool(rng.random() < 0.6)
        cells = []
        for i, (a, b) in enumerate(itertools.pairwise(edges)):
            whole = i < band if low else i >= tall - band
            row = [(-width / 2, width / 2)] if whole else list(itertools.pairwise(sides))
            cells += [Cell((float(c), float(d)), (float(a), float(b)), "drawer") for c, d in row]
        if (
            6 <= len(cells) <= MOST
            and np.diff(edges).min() > least
            and np.diff(sides).min() > least
        ):
            return cells
    edges = np.linspace(z[0], z[1], 7)
    return [
        Cell((-width / 2, width / 2), (float(a), float(b)), "drawer")
        for a, b in itertools.pairwise(edges)
    ]


def _stand(rng, body: Shape, base: str, legs: float, width, depth, unit, finish) -> None:
    """What carries the case, from the floor to z = ``legs``."""
    half = width / 2
    if base == "plinth":
        back = float(rng.uniform(0, 4)) * unit
        lo, hi = [back, -half + back, 0], [depth, half - back, legs]
        body.add(box(lo, hi), finish.darker(0.6))
    elif base != "none":
        r, square = float(rng.uniform(1.4, 2.4)) * unit, rng.random() < 0.5
        edge, material = r + 0.5 * unit, finish if rng.random() < 0.6 else materials.hardware(rng)
        for x in (edge, depth - edge):
            for y in (-half + edge, half - edge):
                if square:
                    body.add(box([x - r, y - r, 0], [x + r, y + r, legs]), material)
                else:
                    foot = cylinder("z", [x, y, 0], legs, 0.7 * r, r, segments=12)
                    body.add(foot, material)
        if base == "legs" and rng.random() < 0.5 and legs > 8 * unit:  # stretchers between them
            w = 0.6 * r
            for y in (-half + edge, half - edge):
                bar = box([edge, y - w, 0.3 * legs], [depth - edge, y + w, 0.3 * legs + 2 * w])
                body.add(bar, material)

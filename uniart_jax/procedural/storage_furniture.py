"""Cabinets, dressers, wardrobes, sideboards, nightstands: grids of doors, drawers and open bays."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import finishes, materials
from uniart_jax.procedural.cabinet import Case, Cell, Fit
from uniart_jax.procedural.fronts import FrontStyle
from uniart_jax.procedural.hinges import hang
from uniart_jax.procedural.shapes import Assembly, Shape, box, cut, cylinder, hull

MAX_MOVING = 9

# width, height, depth (metres), most columns, weight
_KINDS = {
    "base": ((0.5, 1.8), (0.7, 0.95), (0.4, 0.65), 4, 0.14),
    "cube": ((0.4, 0.9), (0.4, 0.8), (0.4, 0.75), 2, 0.08),
    "narrow": ((0.25, 0.6), (0.65, 0.95), (0.5, 0.75), 1, 0.09),
    "dresser": ((0.7, 1.6), (0.7, 1.25), (0.4, 0.55), 3, 0.13),
    "sideboard": ((1.1, 2.0), (0.45, 0.85), (0.35, 0.5), 4, 0.11),
    "wardrobe": ((0.6, 1.6), (1.5, 2.2), (0.45, 0.65), 3, 0.12),
    "pantry": ((0.25, 0.8), (1.5, 2.3), (0.3, 0.65), 1, 0.08),
    "nightstand": ((0.38, 0.65), (0.4, 0.75), (0.35, 0.5), 1, 0.1),
    "wall": ((0.3, 1.4), (0.4, 0.95), (0.25, 0.4), 3, 0.09),
    "bridge": ((0.5, 1.2), (0.28, 0.5), (0.25, 0.65), 2, 0.06),
}
_HUNG = ("wall", "bridge")


def style(rng: np.random.Generator, unit: float, floor: float = 0.0) -> FrontStyle:
    """Fronts of one piece of furniture; ``floor``: height of the piece's z = 0 above the floor,
    metres."""
    face = finishes.furniture(rng)
    accents = (face, face.darker(0.82), finishes.furniture(rng))
    return FrontStyle(
        panel=str(
            rng.choice(
                ["slab", "shaker", "raised", "glass", "slats", "border"],
                p=[0.42, 0.22, 0.1, 0.1, 0.06, 0.1],
            )
        ),
        handle=str(
            rng.choice(
                ["bar", "round_bar", "arch", "knob", "lip", "recess", "latch", "none"],
                p=[0.22, 0.14, 0.12, 0.24, 0.09, 0.08, 0.05, 0.06],
            )
        ),
        face=face,
        accent=accents[rng.integers(3)],
        glass=materials.glass(rng),
        hardware=materials.hardware(rng),
        inside=finishes.wood(rng, textured=False) if rng.random() < 0.45 else face.darker(0.9),
        thickness=max(rng.uniform(0.018, 0.03), 1.7 * unit),
        unit=unit,
        handle_length=float(rng.uniform(0.18, 0.7)),
        reach=float(rng.uniform(0.6, 1.15)) - floor,
        own_handle=bool(rng.random() < 0.06),
        **hang(rng, unit),
    )


def split(rng: np.random.Generator, lo: float, hi: float, count: int, least: float) -> np.ndarray:
    """[count + 1] borders of ``count`` cells between lo and hi: equal, graded, or irregular, none
    below ``least``."""
    manner = rng.random()
    if manner < 0.45 or count == 1:
        weights = np.ones(count)
    elif manner < 0.65:
        weights = np.linspace(1, rng.uniform(1.3, 1.9), count)[:: rng.choice([-1, 1])]
    elif manner < 0.85:
        weights = rng.choice([1.0, 1.6, 2.2], count)
    else:
        weights = rng.uniform(0.7, 1.6, count)
    sizes = weights / weights.sum() * (hi - lo)
    if sizes.min() < least:
        sizes = np.full(count, (hi - lo) / count)
    return lo + np.concatenate([[0.0], np.cumsum(sizes)])


def _column(
    rng: np.random.Generator, y: tuple[float, float], z: tuple[float, float], least: float
) -> list[Cell]:
    """Cells of one column by a random plan."""
    height, width = z[1] - z[0], y[1] - y[0]
    door = "double" if width > rng.uniform(0.55, 0.85) else "door"
    plans = [
        ("drawers", 0.3 if height < 1.4 else 0.1),
        ("door", 0.2),
        ("drawer_door", 0.2 if height < 1.4 else 0.06),
        ("door_drawers", 0.08),
        ("open_door", 0.07),
        ("door_open", 0.04),
        ("doors", 0.06 if height > 1.0 else 0.02),
        ("flap", 0.06 if width > height * 0.9 else 0.0),
        ("open", 0.06),
    ]
    weights = np.array([w for _, w in plans])
    plan = plans[rng.choice(len(plans), p=weights / weights.sum())][0]
    top = float(z[1] - max(least, rng.uniform(0.16, 0.3) * height))
    middle = float(z[0] + rng.uniform(0.35, 0.65) * height)
    low = float(z[0] + max(2 * least, rng.uniform(0.25, 0.45) * height))
    if plan == "drawers":
        most = max(1, min(5, int(height / max(least, 0.12))))
        borders = split(rng, *z, int(rng.integers(min(2, most), most + 1)), least)
        return [Cell(y, (a, b), "drawer") for a, b in itertools.pairwise(borders)]
    if plan == "drawer_door" and top - z[0] > least:
        return [Cell(y, (z[0], top), door), Cell(y, (top, z[1]), "drawer")]
    if plan == "door_drawers" and z[1] - low > least:
        borders = split(rng, z[0], low, int(rng.integers(1, 3)), least)
        drawers = [Cell(y, (a, b), "drawer") for a, b in itertools.pairwise(borders)]
        return [*drawers, Cell(y, (low, z[1]), door)]
    if plan == "open_door":
        return [Cell(y, (z[0], middle), door), Cell(y, (middle, z[1]), "open")]
    if plan == "door_open":
        return [Cell(y, (z[0], middle), "open"), Cell(y, (middle, z[1]), door)]
    if plan == "doors" and min(middle - z[0], z[1] - middle) > 1.5 * least:
        return [Cell(y, (z[0], middle), door), Cell(y, (middle, z[1]), door)]
    if plan == "flap":
        count = 2 if height > 0.6 else 1
        borders = split(rng, *z, count, least)
        return [Cell(y, (a, b), "flap") for a, b in itertools.pairwise(borders)]
    return [Cell(y, z, "open" if plan == "open" else door)]


def _plain(
    rng: np.random.Generator, width: float, z: tuple[float, float], unit: float
) -> list[Cell]:
    """A front of one kind: doors over the whole height, flaps, or drawers, with at most one row on
    top."""
    half, height = width / 2, z[1] - z[0]
    door = "double" if width > rng.uniform(0.5, 0.8) and rng.random() < 0.8 else "door"
    kinds = ["door", "flap", "drawers", "top_row", "two_doors", "beside"]
    weights = np.array([0.34, 0.15, 0.15, 0.2, 0.1, 0.06])
    if width < 0.8 * height:
        weights[1] = 0.0
    plan = str(rng.choice(kinds, p=weights / weights.sum()))
    trays = int(rng.integers(1, 4)) if rng.random() < 0.24 and height > 0.45 else 0
    trays *= 2 if door == "double" and trays < 3 and rng.random() < 0.5 else 1  # two side by side
    full, least = (-half, half), max(0.08, 7 * unit)
    if plan == "flap":
        columns = 2 if width > 0.8 * height and rng.random() < 0.5 else 1
        rows = 2 if height > 0.5 and rng.random() < 0.5 else 1
        ys, zs = np.linspace(-half, half, columns + 1), np.linspace(*z, rows + 1)
        pairs = itertools.product(itertools.pairwise(ys), itertools.pairwise(zs))
        return [
            Cell((float(a), float(b)), (float(c), float(d)), "flap") for (a, b), (c, d) in pairs
        ]
    if plan == "drawers":
        most = int(np.clip(height / max(least, 0.1), 1, 7))
        borders = split(rng, *z, int(rng.integers(1, most + 1)), least)
        return [Cell(full, (float(a), float(b)), "drawer") for a, b in itertools.pairwise(borders)]
    if plan == "top_row" and height > 3 * least:
        top = z[1] - max(least, float(rng.uniform(0.1, 0.24)) * height)
        kind = str(rng.choice(["drawer", "blank", "open"], p=[0.7, 0.2, 0.1]))
        ys = np.linspace(-half, half, 3 if width > 0.6 and rng.random() < 0.4 else 2)
        row = [Cell((float(a), float(b)), (top, z[1]), kind) for a, b in itertools.pairwise(ys)]
        return [Cell(full, (z[0], top), door, trays), *row]
    if plan == "two_doors" and height > 0.6:
        middle = float(z[0] + rng.uniform(0.2, 0.75) * height)
        kinds = rng.choice([door, "open", door], 2)
        if "open" in kinds[0] and "open" in kinds[1]:
            kinds = [door, "open"]
        return [
            Cell(full, (z[0], middle), str(kinds[0])),
            Cell(full, (middle, z[1]), str(kinds[1])),
        ]
    if plan == "beside":  # a door, and open shelves next to it
        y = half * float(rng.uniform(-0.5, 0.5))
        kinds = ["door", "open"] if rng.random() < 0.5 else ["open", "door"]
        return [Cell((-half, y), z, kinds[0]), Cell((y, half), z, kinds[1])]
    return [Cell(full, z, door, trays)]


def _layout(
    rng: np.random.Generator, width: float, z: tuple[float, float], most: int, unit: float
) -> list[Cell]:
    """Cells of the whole front: columns of rows, columns that mirror each other, or a top row over
    the rest."""
    if rng.random() < 0.38:
        return _plain(rng, width, z, unit)
    least_y, least_z = max(0.22, 12 * unit), max(0.1, 9 * unit)
    most = max(1, min(most, int(width / least_y)))
    count = int(rng.integers(1, most + 1))
    half = width / 2
    cells: list[Cell] = []
    top = z[1]
    if count > 1 and rng.random() < 0.22:  # a row of its own across the top
        top = z[1] - max(least_z, rng.uniform(0.16, 0.28) * (z[1] - z[0]))
        borders = split(rng, -half, half, int(rng.integers(1, count + 1)), least_y)
        kind = "open" if rng.random() < 0.2 else "drawer"
        pairs = itertools.pairwise(borders)
        cells += [Cell((float(a), float(b)), (top, z[1]), kind) for a, b in pairs]
    borders = split(rng, -half, half, count, least_y)
    if rng.random() < 0.4:
        borders = (borders - borders[::-1]) / 2  # symmetric
    columns = [(float(a), float(b)) for a, b in itertools.pairwise(borders)]
    same = rng.random() < 0.4
    first = _column(rng, columns[0], (z[0], top), least_z)
    for i, y in enumerate(columns):
        column = first if i == 0 or same else _column(rng, y, (z[0], top), least_z)
        cells += [dataclasses.replace(c, y=y) for c in column]
    return cells


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A piece of storage furniture, metres, closed."""
    names = list(_KINDS)
    widths, heights, depths, most, _ = _KINDS[
        names[rng.choice(len(names), p=[k[-1] for k in _KINDS.values()])]
    ]
    hung = any(widths == _KINDS[name][0] for name in _HUNG)
    width, height, depth = (float(rng.uniform(*r)) for r in (widths, heights, depths))
    unit = max(width, height, depth) / 100
    look = style(rng, unit, floor=1.3 if hung else 0.0)
    wall = max(rng.uniform(0.018, 0.03), 1.7 * unit)
    base = (
        "none"
        if hung
        else str(
            rng.choice(["none", "plinth", "feet", "legs", "runners"], p=[0.2, 0.3, 0.2, 0.2, 0.1])
        )
    )
    legs = {
        "none": 0.0,
        "plinth": rng.uniform(0.05, 0.12),
        "feet": rng.uniform(0.03, 0.08),
        "legs": rng.uniform(0.1, 0.25),
        "runners": rng.uniform(0.05, 0.15),
    }[base]
    legs = min(legs, 0.3 * height)
    top = 0.0 if hung or rng.random() < 0.35 else max(rng.uniform(0.018, 0.045), 1.6 * unit)
    roofless = top == 0 and not hung and rng.random() < 0.25  # made to go under a worktop
    side, z = (-width / 2, width / 2), (legs, height - top)
    for _ in range(100):
        cells = tuple(_layout(rng, width, z, most, unit))
        case = Case(side, z, 0.0, depth, wall, cells, covered=top > 0)
        if 1 <= case.moving <= (6 if look.own_handle or look.handle == "latch" else MAX_MOVING):
            break
    else:
        case = Case(side, z, 0.0, depth, wall, (Cell(side, z, "door"),))

    finish = look.face if rng.random() < 0.5 else finishes.furniture(rng)
    fit = Fit.draw(rng, unit, wall)
    asm, body = Assembly(), Shape()
    _stand(body, rng, base, legs, width, depth, unit, finish, look)
    if top > 0:
        slab = finish if rng.random() < 0.5 else finishes.wood(rng)
        slab = materials.stone(rng) if rng.random() < 0.2 else slab
        over = float(rng.choice([0.0, rng.uniform(0.01, 0.035)])) + look.thickness
        beside = float(rng.choice([0.0, rng.uniform(0.01, 0.03)]))
        lo, hi = [-over, -width / 2 - beside, z[1]], [depth, width / 2 + beside, height]
        body.add(box(lo, hi), slab.along("y"))
    shell = case.solid(rng)
    if roofless and not any(c.kind == "blank" for c in cells):
        rail = min(0.1, 0.2 * depth)
        lo, hi = (
            [rail, side[0] + wall, height - 1.5 * wall],
            [depth - rail, side[1] - wall, height + 1],
        )
        shell = cut(shell, (box(lo, hi),))
    body.add(shell, finish)
    root = asm.add("body", body)
    case.add_fronts(rng, asm, root, look, fit)
    return asm.object()


def _stand(
    body: Shape, rng, base: str, legs: float, width: float, depth: float, unit: float, finish, look
) -> None:
    """Plinth, feet, legs or runners under the case, from the floor z = 0 to z = ``legs``."""
    half, material = width / 2, finish if rng.random() < 0.5 else look.hardware
    if base == "plinth":
        back = float(rng.uniform(0.0, 0.06))
        sides = back
        if rng.random() < 0.4:  # a toe kick: the sides go down to the floor
            back, sides = float(rng.uniform(0.05, 0.12)), 0.0
        body.add(
            box([back, -half + sides, 0], [depth - sides / 2, half - sides, legs]),
            finish.darker(0.6) if rng.random() < 0.6 else finish,
        )
    elif base == "runners":
        w = max(0.03, 2 * unit)
        for y in (-half + 0.02, half - 0.02 - w):
            body.add(box([0.02, y, 0], [depth - 0.02, y + w, legs]), material)
    elif base in ("feet", "legs"):
        r = max(rng.uniform(0.015, 0.03), 1.3 * unit)
        edge, shape, splay = (
            r + float(rng.uniform(0.01, 0.04)),
            rng.integers(3),
            float(rng.uniform(0, 0.25)) * legs,
        )
        for x in (edge, depth - edge):
            for y in (-half + edge, half - edge):
                if shape == 0:
                    body.add(box([x - r, y - r, 0], [x + r, y + r, legs]), material)
                elif shape == 1:
                    body.add(cylinder("z", [x, y, 0], legs, 0.65 * r, r, segments=14), material)
                else:
                    out = np.sign([x - depth / 2, y]) * splay * (base == "legs")
                    ring = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
                    low = np.column_stack([ring * 0.7 * r + [x, y] + out, np.zeros(4)])
                    high = np.column_stack([ring * r + [x, y], np.full(4, legs)])
                    body.add(hull(np.vstack([low, high])), material)

"""Desks, writing tables, consoles and coffee tables with drawers under the top or in pedestals."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.cabinet import Case, Cell, Fit
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    hull,
    revolution,
    union,
)
from uniart_jax.procedural.storage_furniture import split, style

MAX_MOVING = 8

# width, height, depth (metres), weight
_KINDS = {
    "desk": ((1.0, 1.8), (0.7, 0.8), (0.5, 0.8), 0.5),
    "console": ((0.8, 1.4), (0.7, 0.9), (0.3, 0.45), 0.15),
    "coffee": ((0.8, 1.3), (0.35, 0.52), (0.5, 0.75), 0.2),
    "side": ((0.4, 0.65), (0.45, 0.72), (0.38, 0.55), 0.15),
}


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A table with drawers, metres, closed."""
    if rng.random() < 0.1:
        return _adjustable(rng)
    names = list(_KINDS)
    kind = names[rng.choice(len(names), p=[k[-1] for k in _KINDS.values()])]
    width, height, depth = (float(rng.uniform(*r)) for r in _KINDS[kind][:3])
    unit = max(width, height, depth) / 100
    look = style(rng, unit)
    wall = max(float(rng.uniform(0.016, 0.028)), 1.65 * unit)
    top = max(float(rng.uniform(0.018, 0.05)), 1.65 * unit)
    under = height - top
    left, right = _supports(rng, kind)
    for _ in range(100):
        cases = _cases(rng, kind, (left, right), width, depth, under, wall)
        if 1 <= sum(c.moving for c in cases) <= (6 if look.own_handle else MAX_MOVING):
            break
    else:
        left = right = "legs"
        span, row = (-width / 2, width / 2), (under - max(0.12, 9 * unit), under)
        cases = [Case(span, row, 0.0, depth, wall, (Cell(span, row, "drawer"),))]

    finish = look.face if rng.random() < 0.5 else materials.furniture(rng)
    board = finish if rng.random() < 0.5 else materials.furniture(rng)
    asm, body = Assembly(), Shape()
    over = float(rng.choice([0.0, rng.uniform(0.01, 0.06)]))
    front = look.thickness + 0.002 + float(rng.uniform(0.0, 0.03))
    _top(rng, body, board, (-front, depth + over), width / 2 + over, under, height)
    for case in cases:
        body.add(case.solid(rng), finish)
        if case.z[0] > 0 and case.y[1] - case.y[0] < 0.9 * width and case.z[0] < 0.4 * under:
            _feet(body, case, unit, finish)
    low = min([c.z[0] for c in cases if c.y[1] - c.y[0] > 0.9 * width], default=under)
    _sides(rng, body, (left, right), cases, width, depth, under, unit, finish, look.hardware)
    inner = [c for c in cases if c.z[0] <= 0.4 * under]
    if kind == "desk" and rng.random() < 0.45:  # a modesty panel at the back
        a = max([c.y[1] for c in inner if c.y[1] < 0], default=-width / 2 + 4.5 * unit)
        b = min([c.y[0] for c in inner if c.y[0] > 0], default=width / 2 - 4.5 * unit)
        bottom = under * float(rng.uniform(0.1, 0.6))
        body.add(box([depth - wall, a, bottom], [depth, b, min(low, under)]), finish)
    if kind == "desk" and rng.random() < 0.15:
        _hutch(rng, body, width, depth, height, wall, finish)
    root = asm.add("body", body)
    fit = Fit.draw(rng, unit, wall)
    for case in cases:
        case.add_fronts(rng, asm, root, look, fit)
    return asm.object()


def _adjustable(rng: np.random.Generator) -> ArticulatedObject:
    """A small table whose top turns up and down on a threaded column, with or without drawers under the top."""
    width, height = float(rng.uniform(0.45, 0.8)), float(rng.uniform(0.42, 0.7))
    depth = width * float(rng.uniform(0.7, 1.0))
    unit = max(width, height) / 100
    look = dataclasses.replace(style(rng, unit), own_handle=False)
    thick, wall = max(0.022, 1.8 * unit), max(0.016, 1.7 * unit)
    drawers = int(rng.choice([0, 1, 2], p=[0.35, 0.4, 0.25]))
    row = max(0.09, 10 * unit) if drawers else 0.0
    tall = height - thick - row  # of the column
    radius = max(0.03, float(rng.uniform(3.5, 6.0)) * unit)
    center = (depth / 2, 0.0)
    finish, steel = materials.furniture(rng), materials.hardware(rng)

    asm, base, top = Assembly(), Shape(), Shape()
    column = cylinder("z", [*center, 0], tall - 0.004, radius, segments=20)
    bore = cylinder("z", [*center, max(0.03, 2 * unit)], height, 0.6 * radius + 0.003, segments=20)
    foot, spread = max(0.02, 1.8 * unit), float(rng.uniform(0.3, 0.48)) * depth
    count, start = int(rng.choice([0, 3, 4, 5])), float(rng.uniform(0, 360))
    plates = [cylinder("z", [*center, 0], foot, spread, 0.9 * spread, 24)]
    if count:
        arm = box([0, -0.5 * radius, 0], [1.2 * spread, 0.5 * radius, 1.5 * foot])
        turns = [start + 360 / count * k for k in range(count)]
        plates = [arm.rotate((0, 0, t)).translate((*center, 0)) for t in turns]
    base.add(cut(union([column, *plates]), (bore,)), steel if rng.random() < 0.6 else finish)
    root = asm.add("base", base)

    if rng.random() < 0.5 and not drawers:
        top.add(cylinder("z", [*center, height - thick], thick, width / 2, segments=36), finish)
    else:
        _top(rng, top, finish, (-look.thickness - 0.01, depth), width / 2, height - thick, height)
    travel = float(rng.uniform(0.25, 0.6)) * tall
    shaft = min(travel + 0.3 * tall, 0.9 * tall - 2 * foot)
    top.add(cylinder("z", [*center, tall - shaft], shaft, 0.6 * radius, segments=18), steel)
    case = None
    if drawers:
        edges = np.linspace(-0.44, 0.44, drawers + 1) * width
        z = (tall, tall + row)
        cells = tuple(Cell((float(a), float(b)), z, "drawer") for a, b in itertools.pairwise(edges))
        case = Case((cells[0].y[0], cells[-1].y[1]), z, 0.0, depth * 0.96, wall, cells)
        top.add(case.solid(rng), finish)
    angle = 2 * np.pi * float(rng.uniform(0.6, 2.0))
    if rng.random() < 0.5:  # a left-handed thread
        screw = Joint(
            np.array([*center, 0.0]), np.array([0, 0, -1.0]), (0.0, angle), (0.0, -travel)
        )
    else:
        screw = Joint(np.array([*center, 0.0]), np.array([0, 0, 1.0]), (0.0, angle), (0.0, travel))
    part = asm.add("top", top, root, screw)
    if case is not None:
        case.add_fronts(rng, asm, part, look, Fit.draw(rng, unit, wall))
    return asm.object()


def _supports(rng: np.random.Generator, kind: str) -> tuple[str, str]:
    """What stands under the left and the right end: 'legs', 'panel' or 'pedestal'."""
    if kind != "desk":
        plain = "panel" if rng.random() < 0.25 else "legs"
        return plain, plain
    plans = [("pedestal", "legs"), ("legs", "pedestal"), ("pedestal", "pedestal"), ("legs", "legs"), ("panel", "panel"),
             ("pedestal", "panel"), ("panel", "pedestal")]  # fmt: skip
    return plans[rng.choice(len(plans), p=[0.15, 0.15, 0.2, 0.2, 0.1, 0.1, 0.1])]


def _cases(
    rng, kind: str, supports, width: float, depth: float, under: float, wall: float
) -> list[Case]:
    """Pedestals and the row of drawers below the top."""
    half, unit = width / 2, max(width, under, depth) / 100
    row = float(np.clip(rng.uniform(0.1, 0.2), 9 * unit, 0.4 * under))
    cases: list[Case] = []
    a, b = -half, half
    floating = float(rng.choice([0.0, rng.uniform(0.03, 0.1), 0.45 * under], p=[0.4, 0.45, 0.15]))
    wide = float(rng.uniform(0.24, 0.32)) * width
    full = (
        rng.random() < 0.25 and "pedestal" in supports
    )  # a row over the whole width, pedestals below it
    top = under - row if full else under
    same = None
    for side, support in zip((1, -1), supports, strict=True):
        if support != "pedestal":
            continue
        y = (half - wide, half) if side > 0 else (-half, -half + wide)
        plan = (
            same
            if same is not None and rng.random() < 0.7
            else _pedestal(rng, floating, top, 9 * unit)
        )
        same = plan
        cells = tuple(Cell(y, z, cell) for z, cell in plan)
        cases.append(Case(y, (floating, top), 0.0, depth, wall, cells))
        if not full:
            a, b = (a, y[0]) if side > 0 else (y[1], b)
    wanted = 0.4 if "pedestal" in supports else 1.0
    if full or (b - a > 0.3 and rng.random() < wanted):
        count = int(rng.integers(1, max(2, min(4, int((b - a) / max(0.2, 13 * unit)) + 1))))
        borders = split(rng, a, b, count, max(0.2, 13 * unit))
        cells = []
        for c, d in itertools.pairwise(borders):
            kind_of = "open" if count > 1 and rng.random() < 0.12 else "drawer"
            cells.append(Cell((float(c), float(d)), (under - row, under), kind_of))
        if kind in ("side", "coffee", "console") and rng.random() < 0.3:  # two rows
            lower = under - 2 * row
            if lower > 0.15 * under:
                cells += [Cell(c.y, (lower, under - row), "drawer") for c in cells]
                row *= 2
        cases.append(Case((a, b), (under - row, under), 0.0, depth, wall, tuple(cells)))
    return cases


def _pedestal(
    rng: np.random.Generator, lo: float, hi: float, least: float
) -> list[tuple[tuple[float, float], str]]:
    """Rows of one pedestal from bottom to top: drawers, or a door with or without a drawer above."""
    manner = rng.random()
    if manner < 0.65 or hi - lo < 3.2 * least:
        most = int(min(4, (hi - lo) // least))
        borders = split(
            rng, lo, hi, int(rng.integers(1 if most < 2 else 2, max(1, most) + 1)), least
        )
        return [((float(a), float(b)), "drawer") for a, b in itertools.pairwise(borders)]
    if manner < 0.85:
        middle = hi - max(least, (hi - lo) * float(rng.uniform(0.2, 0.3)))
        return [((lo, middle), "door"), ((middle, hi), "drawer")]
    if manner < 0.93:
        return [((lo, hi), "door")]
    middle = lo + (hi - lo) * float(rng.uniform(0.4, 0.6))
    return [((lo, middle), "drawer"), ((middle, hi), "open")]


def _top(
    rng, body: Shape, board, x: tuple[float, float], half: float, low: float, high: float
) -> None:
    """The table top: square, rounded or cut corners."""
    manner, board = rng.random(), board.along("y")
    if manner < 0.65:
        body.add(box([x[0], -half, low], [x[1], half, high]), board)
        return
    r, steps = float(rng.uniform(0.03, 0.1)) * (x[1] - x[0]) * 2, 1 if manner < 0.8 else 5
    angles = np.linspace(0, np.pi / 2, steps + 1)
    points = []
    for sx, sy, start in ((1, 1, 0.0), (-1, 1, np.pi / 2), (-1, -1, np.pi), (1, -1, 1.5 * np.pi)):
        cx, cy = (x[1] - r if sx > 0 else x[0] + r), sy * (half - r)
        points += [[cx + r * np.cos(start + t), cy + r * np.sin(start + t)] for t in angles]
    ring = np.array(points)
    body.add(
        hull(np.vstack([np.column_stack([ring, np.full(len(ring), h)]) for h in (low, high)])),
        board,
    )


def _sides(
    rng,
    body: Shape,
    supports,
    cases: list[Case],
    width: float,
    depth: float,
    under: float,
    unit: float,
    finish,
    hardware,
) -> None:
    """Legs or side panels from the floor to the underside."""
    half, material = width / 2, finish if rng.random() < 0.6 else hardware
    r = max(float(rng.uniform(0.018, 0.035)), 1.4 * unit)
    inset, manner, splay = (
        r + float(rng.uniform(0.0, 0.04)),
        rng.integers(4),
        float(rng.uniform(0.3, 1.0)),
    )
    stretcher = rng.random() < 0.25
    for side, support in zip((1, -1), supports, strict=True):
        y = side * (half - inset)
        # up to the row of drawers where there is one above, else to the top
        high = min([c.z[0] for c in cases if c.y[0] - r < y < c.y[1] + r], default=under)
        if support == "panel":
            w = max(0.025, 1.8 * unit)
            lo, hi = sorted((side * half, side * (half - w)))
            body.add(box([0.0, lo, 0], [depth, hi, high]), finish)
        elif support == "legs":
            for x in (inset, depth - inset):
                if manner == 0:
                    body.add(box([x - r, y - r, 0], [x + r, y + r, high]), material)
                elif manner == 1:
                    body.add(cylinder("z", [x, y, 0], high, 0.6 * r, r, segments=14), material)
                elif manner == 2:
                    ring = r * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
                    out = np.array([np.sign(x - depth / 2), side]) * min(0.06, inset) * splay
                    low = np.column_stack([0.7 * ring + [x, y] + out, np.zeros(4)])
                    top = np.column_stack([ring + np.array([x, y]), np.full(4, high)])
                    body.add(hull(np.vstack([low, top])), material)
                else:  # turned
                    t = np.array([0, 0.08, 0.3, 0.55, 0.7, 0.72, 1.0]) * high
                    s = np.array([0.6, 0.9, 0.6, 1.0, 0.7, 1.0, 1.0]) * r
                    profile = np.vstack([[0, 0], np.column_stack([s, t]), [0, high]])
                    body.add(revolution(profile, "z", [x, y, 0], 14), material)
            if stretcher and manner in (0, 1):
                z, w = high * 0.15, 0.55 * r
                body.add(box([inset, y - w, z - w], [depth - inset, y + w, z + w]), material)


def _feet(body: Shape, case: Case, unit: float, finish) -> None:
    """Small feet under a pedestal that does not reach the floor."""
    r = max(0.02, 1.4 * unit)
    for x in (2 * r, case.depth - 2 * r):
        for y in (case.y[0] + 2 * r, case.y[1] - 2 * r):
            body.add(box([x - r, y - r, 0], [x + r, y + r, case.z[0]]), finish)


def _hutch(
    rng, body: Shape, width: float, depth: float, height: float, wall: float, finish
) -> None:
    """An open shelf that stands on the back of the top."""
    tall, half = float(rng.uniform(0.15, 0.4)), width / 2
    front = depth * (1 - float(rng.uniform(0.3, 0.45)))
    count = int(rng.integers(1, 4))
    borders = np.linspace(-half, half, count + 1)
    case = Case(
        (-half, half), (height, height + tall), front, depth - front, wall,
        tuple(Cell((float(a), float(b)), (height, height + tall), "open") for a, b in itertools.pairwise(borders)),
    )  # fmt: skip
    body.add(case.solid(rng), finish)

"""Desks, writing tables, consoles and coffee tables with drawers under the top or in pedestals."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import finishes, materials
from uniart_jax.procedural.cabinet import Case, Cell, Fit
from uniart_jax.procedural.casters import Caster
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
    "desk": ((1.0, 1.8), (0.65, 0.8), (0.5, 0.8), 0.38),
    "console": ((0.8, 1.7), (0.65, 0.9), (0.28, 0.55), 0.18),
    "coffee": ((0.8, 1.6), (0.3, 0.52), (0.45, 0.8), 0.17),
    "side": ((0.35, 0.7), (0.42, 0.78), (0.33, 0.6), 0.27),
}


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A table with drawers, metres, closed."""
    if rng.random() < 0.06:
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
    # the case stands back under its top, and need not reach the rear
    back = float(
        rng.choice([0.0, rng.uniform(0.02, 0.1), rng.uniform(0.1, 0.4)], p=[0.5, 0.38, 0.12])
    )
    back = min(back * depth, depth - 0.2)
    deep = (depth - back) * float(1.0 if rng.random() < 0.5 else rng.uniform(0.6, 1.0))
    deep = max(deep, 0.2)
    rolls = left == right == "legs" and rng.random() < 0.12
    most = 4 if rolls else 6 if look.own_handle or look.handle == "latch" else MAX_MOVING
    for _ in range(100):
        cases = _cases(rng, kind, (left, right), width, depth, under, wall)
        cases = [dataclasses.replace(c, front=back, depth=deep) for c in cases]
        if (0 if rolls else 1) <= sum(c.moving for c in cases) <= most:
            break
    else:
        left = right = "legs"
        span, row = (-width / 2, width / 2), (under - max(0.12, 9 * unit), under)
        cases = [Case(span, row, back, deep, wall, (Cell(span, row, "drawer"),))]

    rolls = rolls and min([c.z[0] for c in cases], default=under) > 0.2 * under
    finish = look.face if rng.random() < 0.65 else finishes.furniture(rng)
    board = finish if rng.random() < 0.6 else finishes.furniture(rng)
    asm, body = Assembly(), Shape()
    over = float(rng.choice([0.0, rng.uniform(0.01, 0.12)]))
    front = look.thickness + 0.002 + float(rng.uniform(0.0, 0.03))
    _top(rng, body, board, (-front, depth + over), width / 2 + over, under, height)
    for case in cases:
        body.add(case.solid(rng), finish)
        if case.z[0] > 0 and case.y[1] - case.y[0] < 0.9 * width and case.z[0] < 0.4 * under:
            _feet(body, case, unit, finish)
    low = min([c.z[0] for c in cases if c.y[1] - c.y[0] > 0.9 * width], default=under)
    wheel = max(0.045, float(rng.uniform(0.05, 0.15)) * under) if rolls else 0.0
    feet = _sides(
        rng, body, (left, right), cases, width, depth, under, unit, finish, look.hardware, wheel
    )  # fmt: skip
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
    if rolls:
        _caster(rng, wheel).add(asm, root, feet)
    return asm.object()


def _caster(rng: np.random.Generator, height: float) -> Caster:
    forks, metal, rubber = rng.random() < 0.5, materials.hardware(rng), finishes.dark(rng)
    radius = 0.5 * height if not forks else 0.42 * height
    wide = radius * float(rng.uniform(0.5, 0.9))
    along = "y" if rng.random() < 0.7 else "x"
    return Caster(height, radius, wide, along, bool(forks), metal, rubber)


def _adjustable(rng: np.random.Generator) -> ArticulatedObject:
    """A small table whose top turns up and down on a threaded column, with or without drawers under
    the top."""
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
    finish, steel = finishes.furniture(rng), materials.hardware(rng)

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
    plans = [("pedestal", "legs"), ("legs", "pedestal"), ("pedestal", "pedestal"), ("legs", "legs"), ("panel", "panel"),  # noqa: E501
             ("pedestal", "panel"), ("panel", "pedestal")]  # fmt: skip
    return plans[rng.choice(len(plans), p=[0.15, 0.15, 0.2, 0.2, 0.1, 0.1, 0.1])]


def _cases(
    rng, kind: str, supports, width: float, depth: float, under: float, wall: float
) -> list[Case]:
    """Pedestals and the row of drawers below the top."""
    half, unit = width / 2, max(width, under, depth) / 100
    tall = rng.uniform(0.07, 0.2) if rng.random() < 0.75 else rng.uniform(0.2, 0.32)
    row = float(np.clip(tall, max(7 * unit, 3 * wall + 0.02), 0.45 * under))
    cases: list[Case] = []
    if kind in ("side", "coffee") and rng.random() < 0.25:  # a chest under a top
        y, low = (-half, half), float(rng.choice([0.0, rng.uniform(0.03, 0.4)])) * under
        cells = tuple(Cell(y, z, cell) for z, cell in _pedestal(rng, low, under, 9 * unit))
        return [Case(y, (low, under), 0.0, depth, wall, cells)]
    a, b = -half, half
    if supports == ("legs", "legs") and rng.random() < 0.45:  # between the legs
        a, b = np.array([-1, 1]) * (half - float(rng.uniform(0.03, 0.16)) * width)
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
        blank = 0.25 if rng.random() < 0.3 else 0.0
        if rng.random() < 0.22:  # one drawer in an apron
            c = (b - a) * float(rng.uniform(0.25, 0.8))
            start = (a + b - c) / 2 + float(rng.choice([0.0, rng.uniform(-0.5, 0.5)])) * (b - a - c)
            borders = np.array([a, start, start + c, b])
            blank = 1.0
        for i, (c, d) in enumerate(itertools.pairwise(borders)):
            if d - c < 0.02:
                continue
            kind_of = "open" if count > 1 and blank < 1 and rng.random() < 0.12 else "drawer"
            if (blank == 1.0 and i != 1) or (blank < 1 and rng.random() < blank):
                kind_of = "blank"
            if kind_of == "drawer" and row > 0.22 and rng.random() < 0.25:
                kind_of = "door"
            cells.append(Cell((float(c), float(d)), (under - row, under), kind_of))
        if kind in ("side", "coffee", "console") and rng.random() < 0.3:  # two rows
            lower = under - 2 * row
            if lower > 0.15 * under:
                cells += [Cell(c.y, (lower, under - row), c.kind) for c in cells]
                row *= 2
        cases.append(
            Case(
                (cells[0].y[0], cells[-1].y[1]),
                (under - row, under),
                0.0,
                depth,
                wall,
                tuple(cells),
            )
        )
    return cases


def _pedestal(
    rng: np.random.Generator, lo: float, hi: float, least: float
) -> list[tuple[tuple[float, float], str]]:
    """Rows of one pedestal from bottom to top: drawers, or a door with or without a drawer
    above."""
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
    raised: float = 0.0,
) -> list[tuple[float, float]]:
    """Legs or side panels from the floor (legs: from ``raised``) to the underside, a shelf between
    legs; the places (x, y) of legs."""
    half, material = width / 2, finish if rng.random() < 0.6 else hardware
    r = max(float(rng.uniform(0.018, 0.035)), 1.4 * unit)
    inset, manner, splay = (
        r + float(rng.uniform(0.0, 0.04)),
        rng.integers(4),
        float(rng.uniform(0.3, 1.0)),
    )
    stretcher = rng.random() < 0.25
    feet: list[tuple[float, float]] = []
    shelf = (
        float(rng.uniform(0.1, 0.45))
        if rng.random() < 0.3 and supports == ("legs", "legs")
        else 0.0
    )
    if shelf and shelf * under + 0.1 < min([c.z[0] for c in cases], default=under):
        low = max(raised + 0.02, shelf * under)
        thick, r0 = max(0.018, 1.5 * unit), inset
        lo, hi = [r0, r0 - half, low], [depth - r0, half - r0, low + thick]
        body.add(box(lo, hi), material)
    for side, support in zip((1, -1), supports, strict=True):
        y = side * (half - inset)
        # up to the row of drawers where there is one above, else to the top
        high = min([c.z[0] for c in cases if c.y[0] - r < y < c.y[1] + r], default=under)
        if support == "panel" and high > 0.02:
            w = max(0.025, 1.8 * unit)
            lo, hi = sorted((side * half, side * (half - w)))
            body.add(box([0.0, lo, 0], [depth, hi, high]), finish)
        elif support == "legs":
            for x in (inset, depth - inset):
                if high < raised + 0.02:  # a chest stands there
                    continue
                feet.append((x, y))
                if manner == 0 or raised:
                    body.add(box([x - r, y - r, raised], [x + r, y + r, high]), material)
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
                z, w = raised + high * 0.15, 0.55 * r
                body.add(box([inset, y - w, z - w], [depth - inset, y + w, z + w]), material)
    return feet


def _feet(body: Shape, case: Case, unit: float, finish) -> None:
    """Small feet under a pedestal that does not reach the floor."""
    r = max(0.02, 1.4 * unit)
    for x in (case.front + 2 * r, case.front + case.depth - 2 * r):
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
        tuple(Cell((float(a), float(b)), (height, height + tall), "open") for a, b in itertools.pairwise(borders)),  # noqa: E501
    )  # fmt: skip
    body.add(case.solid(rng), finish)

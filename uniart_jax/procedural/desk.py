"""Desks, nightstands, consoles, coffee tables and benches as real ones are: thin drawers in aprons
between shaped legs, in front and at the rear, pedestals, cabinets, leaves, lids and trays."""

from __future__ import annotations

import itertools

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import (
    desk_bodies,
    desk_cases,
    finishes,
    materials,
    real_finishes,
    table_parts,
    table_tops,
)
from uniart_jax.procedural.desk_cases import Opening, apron
from uniart_jax.procedural.fronts import FrontStyle
from uniart_jax.procedural.hinges import hang
from uniart_jax.procedural.pulls import DrawerStyle
from uniart_jax.procedural.shapes import box
from uniart_jax.procedural.table_parts import Piece

# width, height, depth (metres), weight
_KINDS = {
    "writing": ((0.9, 1.8), (0.7, 0.8), (0.45, 0.85), 0.2),
    "pedestal": ((1.1, 1.9), (0.7, 0.8), (0.5, 0.9), 0.17),
    "nightstand": ((0.35, 0.65), (0.42, 0.8), (0.33, 0.6), 0.2),
    "console": ((0.9, 1.8), (0.68, 0.95), (0.26, 0.5), 0.11),
    "coffee": ((0.75, 1.6), (0.28, 0.52), (0.4, 0.9), 0.1),
    "chest": ((0.35, 0.7), (0.4, 0.85), (0.33, 0.6), 0.08),
    "media": ((0.9, 1.8), (0.28, 0.62), (0.33, 0.6), 0.05),
    "bench": ((1.1, 2.0), (0.75, 1.0), (0.45, 0.8), 0.06),
    "bow": ((0.45, 0.95), (0.6, 0.9), (0.3, 0.5), 0.03),
}


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A table, metres, closed."""
    names = list(_KINDS)
    kind = names[rng.choice(len(names), p=[k[-1] for k in _KINDS.values()])]
    width, height, depth = (float(rng.uniform(*r)) for r in _KINDS[kind][:3])
    p = _piece(rng, width, height, depth)
    inside = p.frame if rng.random() < 0.58 else _pale(rng)
    style = DrawerStyle.draw(rng, p.unit, p.look, inside)
    if kind == "pedestal":
        desk_bodies.pedestals(p, style)
    elif kind in ("chest", "media"):
        desk_bodies.chest(p, style, flat=kind == "media")
    elif kind == "bow":
        desk_bodies.bowed(p, style)
    else:
        _legged(p, style, kind)
    return p.object()


def _board(rng: np.random.Generator) -> materials.Material:
    """Wood mostly, strongly grained; white, grey, black and colours."""
    for _ in range(3):
        finish = _any_board(rng)
        if max(finish.color) > 0.25 or rng.random() < 0.3:
            break
    return finish


def _any_board(rng: np.random.Generator) -> materials.Material:
    """A finish of boards; more of them are black than real ones."""
    kind = rng.choice(4, p=[0.6, 0.1, 0.24, 0.06])
    if kind == 0:
        return real_finishes.strong_wood(rng)
    if kind == 1:
        return finishes.wood(rng)
    return finishes.furniture(rng) if kind == 2 else finishes.dark(rng)


def _pale(rng: np.random.Generator) -> materials.Material:
    """Of drawers' boxes: birch, pine or white."""
    if rng.random() < 0.3:
        return finishes.white_plastic(rng)
    rgb = np.array([0.9, 0.78, 0.58]) * rng.uniform(0.78, 1.06) + rng.uniform(-0.05, 0.05, 3)
    return materials.plain(rgb)


def _top_finish(rng: np.random.Generator, frame: materials.Material) -> materials.Material:
    """The frame's finish mostly; glass, stone, leather, or another board."""
    kind = rng.choice(5, p=[0.66, 0.12, 0.07, 0.09, 0.06])
    if kind == 0:
        return frame
    if kind == 1:
        return _board(rng)
    makers = (real_finishes.tinted_glass, real_finishes.speckled, finishes.dark)
    return makers[kind - 2](rng)


def _piece(rng: np.random.Generator, width: float, height: float, depth: float) -> Piece:
    """An empty piece with its finishes."""
    unit = max(width, height, depth) / 100
    frame = _board(rng)
    face = frame if rng.random() < 0.86 else _board(rng)
    metal = finishes.metal(rng) if rng.random() < 0.6 else materials.hardware(rng)
    leg = (frame, _board(rng), metal)[rng.choice(3, p=[0.82, 0.08, 0.1])]
    accents = (face, face.darker(0.8), _board(rng))
    hardware = (materials.hardware(rng), finishes.metal(rng), face, face.darker(0.6))
    look = FrontStyle(
        panel=str(rng.choice(["slab", "shaker", "raised", "border", "glass", "slats"],
                             p=[0.4, 0.22, 0.15, 0.1, 0.08, 0.05])),
        handle=str(rng.choice(["knob", "bar", "arch", "recess", "none"],
                              p=[0.5, 0.15, 0.15, 0.05, 0.15])),
        face=face,
        accent=accents[rng.integers(3)],
        glass=real_finishes.tinted_glass(rng) if rng.random() < 0.6 else materials.glass(rng),
        hardware=hardware[rng.choice(4, p=[0.42, 0.18, 0.28, 0.12])],
        inside=frame,
        thickness=max(float(rng.uniform(0.014, 0.024)), 1.2 * unit),
        unit=unit,
        handle_length=float(rng.uniform(0.12, 0.4)),
        reach=0.45 * height,
        **hang(rng, unit),  # pyright: ignore[reportArgumentType]
    )  # fmt: skip
    wall = max(float(rng.uniform(0.014, 0.026)), 1.2 * unit)
    board = _top_finish(rng, frame)
    return Piece(rng, width, height, depth, unit, wall, frame, board, leg, look)


def _legged(p: Piece, style: DrawerStyle, kind: str) -> None:
    """A table on legs: an apron with drawers, a cabinet, a lid or nothing between them."""
    rng, half, depth = p.rng, p.width / 2, p.depth
    thick = max(p.between(0.012, 0.045 if kind != "bench" else 0.08), 1.1 * p.unit)
    under = p.height - thick
    small = kind == "nightstand"
    wheel = 0.0
    if (kind == "coffee" and p.share(0.45)) or p.share(0.06):
        wheel = max(0.04, 3 * p.unit, p.between(0.06, 0.16) * under)
    shares = [0.26, 0.24, 0.07, 0.14, 0.02, 0.06, 0.06, 0.06, 0.06, 0.03]
    legs = str(rng.choice(table_parts.LEGS, p=shares))
    if wheel and legs not in ("square", "post", "round"):
        legs = "square"
    stout = 0.05 if legs == "post" or kind == "bench" else 0.034
    r = max(p.between(0.013, stout), (1.0 if legs != "post" else 1.6) * p.unit)
    lowest = 3.9 * p.unit
    tall = (0.1, 0.23) if small or kind == "bench" else (0.05, 0.15)
    row = float(np.clip(p.between(*tall), lowest, 0.4 * under))
    plan = str(
        rng.choice(
            ["drawers", "cabinet", "hung", "lid", "leaves", "none"],
            p=[0.75, 0.08, 0.08, 0.03, 0.06, 0.0] if not wheel else [0.4, 0.05, 0, 0.05, 0, 0.5],
        )
    )
    if plan == "cabinet":
        row = p.between(0.3, 0.62) * (under - wheel)
    drop = p.between(0.01, 0.06) if p.share(0.45) else 0.0
    drop = min(drop, 0.2 * under, 0.5 * row) if plan in ("drawers", "none", "leaves") else 0.0
    block = row + drop + p.between(0.0, 0.03)
    places = [(x, y) for x in (r, depth - r) for y in (r - half, half - r)]
    amount, profile = p.between(0.2, 1.0), table_parts.leg_profile(rng, legs)
    above = p.between(0.003, 0.02) if legs == "post" and p.share(0.6) else 0.0
    support = str(rng.choice(["legs", "ends", "column"], p=[0.8, 0.15, 0.05]))
    if support == "column" and plan == "drawers" and p.width < 1.1 and not wheel:
        table_parts.column(p, under - row, thick)
        drop = 0.0
    elif support == "ends" and not wheel and kind != "bench":
        desk_cases.ends(p, under, thick=2 * r * 0.7)
        r = 0.7 * r
    else:
        through = legs == "post" and plan != "lid" and (above > 0 or p.share(0.3))
        high = p.height + above if through else under
        for x, y in places:
            out = np.sign([x - depth / 2, y])
            solid = table_parts.leg(legs, (x, y), r, high - wheel, block, out, amount, profile)
            p.add(solid.translate((0, 0, wheel)), p.leg)
    if wheel:
        table_parts.casters(p, places, wheel)

    inside = (2 * r - half + 0.001, half - 2 * r - 0.001)  # between the legs
    back = p.between(0.0, 0.3) * r
    x = (back, depth - back)
    if plan in ("drawers", "leaves", "none"):
        openings = [] if plan == "none" else _openings(p, inside, (under - row, under), kind)
        rear = []
        if plan == "drawers" and depth > 0.4 and p.share(0.3 if kind == "coffee" else 0.07):
            rear = openings if p.share(0.7) else _openings(p, inside, (under - row, under), kind)
        manner = str(
            rng.choice(["straight", "arch", "scallops", "brackets"], p=[0.3, 0.35, 0.15, 0.2])
        )
        apron(p, style, (r - half, half - r), (under - row, under), x, openings, rear, drop, manner)
    elif plan == "hung":
        desk_cases.hung(p, style, (inside[0] - 0.001, inside[1] + 0.001), under, x)
    elif plan == "cabinet":
        z = (under - row, under)
        cells = desk_cases.columns(p, (inside[0] - 0.001, inside[1] + 0.001), z)
        desk_cases.case(p, style, (inside[0] - 0.001, inside[1] + 0.001), z, x, cells)
    else:
        table_tops.lid(p, (r, depth - r), half - r, (under - row, under), thick)
    free = under - row - drop
    shelf = p.share(0.5 if small or kind in ("console", "coffee", "bench") else 0.2)
    if shelf and free > 0.12 and support != "column":
        low = max(wheel + 0.01, p.between(0.08, 0.5) * free)
        shares = [0.55, 0.1, 0.1, 0.15, 0.1]
        manner = str(rng.choice(["shelf", "slats", "box", "h", "sides"], p=shares))
        table_parts.lower(p, (r, depth - r), (r - half, half - r), low, manner, r)
        if manner == "shelf" and free - low > 0.25 and p.share(0.25):  # and another one
            second = low + p.between(0.35, 0.65) * (free - low)
            table_parts.lower(p, (r, depth - r), (r - half, half - r), second, manner, r)
        if p.share(0.3 if small else 0.08) and not wheel:  # an open compartment, closed around
            t = 0.5 * p.wall
            for y in (r - half, half - r):
                p.add(box([r, y - t, low], [depth - r, y + t, under - row]), p.frame)
            p.add(box([depth - r - t, r - half, low], [depth - r, half - r, under - row]), p.frame)
    over = (0.0, p.between(0.005, 0.04), p.between(0.04, 0.12))[rng.choice(3, p=[0.2, 0.55, 0.25])]
    front = over + (style.thick if style.mount == "over" and p.share(0.7) else 0.0)
    side = over if p.share(0.7) else p.between(0.0, 0.2) * p.width
    if plan == "leaves":
        side = 0.012
        table_tops.leaves(p, (-front, depth + over), half + side, under, thick)
    if plan != "lid":
        kinds = ["square", "rounded", "cut", "beveled", "framed", "glass", "oval", "slats"]
        shares = [0.5, 0.14, 0.05, 0.14, 0.07, 0.05, 0.03, 0.02]
        if plan == "leaves":
            kinds, shares = ["square"], [1.0]
        round_by = p.between(0.01, 0.12) * depth
        y = (-half - side, half + side)
        shape = str(rng.choice(kinds, p=shares))
        table_tops.top(p, (-front, depth + over), y, (under, p.height), shape, round_by)
        if p.share(0.35 if kind == "bench" else 0.07):
            desk_cases.upper(p, (0.0, depth + over), half + side)


def _openings(p: Piece, y: tuple[float, float], z: tuple[float, float], kind: str) -> list[Opening]:
    """One to five drawers in a row between the legs: side by side, apart, or one amid the apron."""
    rng, wide = p.rng, y[1] - y[0]
    least = max(0.14, 10 * p.unit)
    most = max(1, int(wide / least))
    shares = [1.0] if kind == "nightstand" else [0.38, 0.3, 0.2, 0.07, 0.05]
    count = min(most, 1 + int(rng.choice(len(shares), p=shares)))
    share = p.between(0.9, 0.99) if p.share(0.5) else p.between(0.4, 0.9)
    weights = np.ones(count)
    if count > 2 and p.share(0.5):
        weights[1:-1] = p.between(1.2, 2.2)
    used = max(share * wide, min(0.97 * wide, count * least))
    borders = used * (np.concatenate([[0], np.cumsum(weights)]) / weights.sum() - 0.5)
    divide = min(max(0.003, p.between(0.2, 2.5) * p.unit), 0.1 * used / count)
    if count > 1 and p.share(0.3):  # far apart
        divide = p.between(0.1, 0.4) * used / count
    shift = (y[0] + y[1]) / 2
    if count == 1 and p.share(0.08):
        shift += p.between(-0.5, 0.5) * (wide - used)
    tall, rail = z[1] - z[0], np.array([0.0, 0.0])
    if p.share(0.75):
        rail = rng.uniform(0.04, 0.24, 2) * tall * (rng.random(2) < 0.75)
    if tall - rail.sum() < 2.6 * p.unit:
        rail *= 0
    span = (z[0] + float(rail[0]), z[1] - float(rail[1]))
    skirt = 0.0
    if count == 1 and rail[0] == 0 and p.share(0.35):
        skirt = p.between(0.15, 0.4) * tall
    cells, two = [], kind in ("nightstand", "bench") and tall > 0.16 and p.share(0.3)
    rows = (
        [span] if not two else [(span[0], sum(span) / 2 - 0.003), (sum(span) / 2 + 0.003, span[1])]
    )
    for (a, b), row in itertools.product(itertools.pairwise(borders), rows):
        blank = p.share(0.05) and len(cells) > 0
        ends = (float(a + shift + divide / 2), float(b + shift - divide / 2))
        cells.append(Opening(ends, row, "blank" if blank else "drawer", skirt))
    return cells

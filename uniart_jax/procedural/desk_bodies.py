"""Desks on pedestals, chests on feet or casters, and chests with a bowed front."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
from manifold3d import Manifold

from uniart_jax.procedural import shapes, table_parts, table_tops
from uniart_jax.procedural.cabinet import Cell
from uniart_jax.procedural.desk_cases import Opening, apron, case, columns, stack, upper
from uniart_jax.procedural.pulls import DrawerStyle, add_drawer
from uniart_jax.procedural.shapes import Shape, box, slide, union
from uniart_jax.procedural.table_parts import Piece, about


def pedestals(p: Piece, style: DrawerStyle) -> None:
    """A desk: pedestals under one end or both, an apron with drawers or a tray for a keyboard
    between them, legs or a board under the other end."""
    rng, half, depth = p.rng, p.width / 2, p.depth
    thick = max(p.between(0.016, 0.05), 1.1 * p.unit)
    under = p.height - thick
    wide = p.between(0.2, 0.34) * p.width
    plan = rng.choice(3, p=[0.38, 0.32, 0.3])  # both, left (+y), right
    low = (0.0, p.between(0.03, 0.12), p.between(0.3, 0.55) * under)[
        rng.choice(3, p=[0.4, 0.4, 0.2])
    ]
    over = 0.0 if p.share(0.35) else p.between(0.005, 0.08)
    wider = p.between(0.03, 0.14) * p.width if p.share(0.2) else over  # the top's ends
    front = 0.0 if p.share(0.6) else p.between(0.0, 0.1) * depth
    sides = {0: (1, -1), 1: (1,), 2: (-1,)}[int(plan)]
    if len(sides) == 1 and p.share(0.15):  # a narrow column of one tall door
        wide, low = max(0.1, 9 * p.unit), 0.0
    y = {s: ((half - wide, half) if s > 0 else (-half, wide - half)) for s in sides}
    cells = stack(p, y[sides[0]], (low, under))
    if wide < 0.15:
        cells = [Cell(y[sides[0]], (low, under), "door")]
    turned = p.share(0.06) and len(sides) == 1 and depth > 0.45
    for side in sides:
        own = cells if side == sides[0] or p.share(0.7) else stack(p, y[side], (low, under))
        if side != sides[0] and p.share(0.12):
            own = [Cell(y[side], (low, under), "open")]
        own = tuple(dataclasses.replace(c, y=y[side]) for c in own)
        x = (front, depth - p.between(0.0, 0.2) * depth * p.share(0.4))
        if turned:  # opens to the side
            length = p.between(0.5, 1.0) * depth
            face = (-length / 2, length / 2)
            own = tuple(
                dataclasses.replace(c, y=face, kind=c.kind.replace("double", "door")) for c in cells
            )
            matrix = about((0, 0), -90.0 * side)  # -x goes to the outer side
            matrix[:3, 3] = [depth / 2, side * half, 0]
            x = ((depth - length) / 2, (depth + length) / 2)
            case(p, style, face, (low, under), (0.0, wide), own, matrix)
        else:
            case(p, style, y[side], (low, under), x, own)
        feet = [
            (a, b)
            for a in (x[0] + 0.03, x[1] - 0.03)
            for b in (y[side][0] + 0.03, y[side][1] - 0.03)
        ]
        if 0 < low < 0.2 * under and p.share(0.4):  # a plinth
            t = p.between(0.0, 0.03)
            foot = box([x[0] + t, y[side][0] + t, 0], [x[1] - t, y[side][1] - t, low])
            p.add(foot, p.frame if p.share(0.6) else p.frame.darker(0.5))
        elif 0 < low < 0.2 * under:
            r = max(0.014, p.unit)
            for a, b in feet:
                p.add(box([a - r, b - r, 0], [a + r, b + r, low]), p.leg)
        elif low > 0:
            _stand(p, x, y[side], low)
    a = y[-1][1] if -1 in y else -half
    b = y[1][0] if 1 in y else half
    other = 0 if plan == 0 else (-1 if plan == 1 else 1)
    inset = p.wall
    if other:
        inset = _stand(p, (0.0, depth), (a, b), under, only=other)
    if other > 0:
        b -= inset
    elif other < 0:
        a += inset
    if p.share(0.5):  # a board at the back
        bottom = p.between(0.05, 0.7) * under
        p.add(box([depth - p.wall, a - 0.001, bottom], [depth, b + 0.001, under]), p.frame)
    manner, gap = rng.choice(4, p=[0.5, 0.12, 0.2, 0.18]), b - a
    row = float(np.clip(p.between(0.05, 0.14), 3.8 * p.unit, 0.3 * under))
    z = (under - row, under)
    end = depth - 2 * p.wall
    if manner == 0 and gap > 0.25:
        count = 1 if p.share(0.7) else 2
        share = p.between(0.85, 0.99) if p.share(0.5) else p.between(0.4, 0.9)
        middle, span = (a + b) / 2, share * gap
        borders = np.linspace(middle - span / 2, middle + span / 2, count + 1)
        rail = p.between(0.0, 0.2) * row
        openings = [
            Opening((float(c) + 0.004, float(d) - 0.004), (z[0] + rail, z[1] - rail), "drawer")
            for c, d in itertools.pairwise(borders)
        ]
        apron(p, style, (a, b), z, (front, end), openings, [], 0.0, "straight")
    elif manner == 1 and gap > 0.25:
        _tray(p, (a + 0.01, b - 0.01), under - 0.03, end)
    elif manner == 2:
        p.add(box([front, a, z[0]], [front + p.wall, b, z[1]]), p.frame.along("y"))
    kinds = ["square", "rounded", "cut", "beveled", "framed"]
    shape = str(rng.choice(kinds, p=[0.55, 0.15, 0.05, 0.15, 0.1]))
    ahead = over + (style.thick + 0.002 if style.mount == "over" and p.share(0.7) else 0.0)
    spans = (-ahead, depth + over), (-half - wider, half + wider), (under, p.height)
    table_tops.top(p, *spans, shape, p.between(0.02, 0.1))
    if p.share(0.1) and not turned:
        _return(p, half + wider, under)
    if p.share(0.12):
        upper(p, (0.0, depth), half)


def _stand(
    p: Piece, x: tuple[float, float], y: tuple[float, float], high: float, only: int = 0
) -> float:
    """Legs under a pedestal that hangs (``only`` 0: at its outer side), or under the end ``only``
    of a desk, or a board there; its width. ``x``, ``y``: what it carries."""
    side = only or (1 if y[1] > 0 else -1)
    r = max(p.between(0.014, 0.03), p.unit)
    edge, kind = side * p.width / 2, p.rng.integers(4)
    if kind == 0 and only:
        a, b = sorted((edge, edge - side * 1.4 * r))
        p.add(box([x[0], a, 0], [x[1], b, high]), p.frame)
        return 1.4 * r
    kinds = ("square", "tapered", "round", "turned")
    name, profile = kinds[p.rng.integers(4)], table_parts.leg_profile(p.rng, "turned")
    spots = (edge - side * r,) if only or p.share(0.5) else (y[0] + r, y[1] - r)
    for ahead, at in itertools.product((x[0] + r, x[1] - r), spots):
        out = np.sign([ahead - p.depth / 2, at])
        p.add(table_parts.leg(name, (ahead, at), r, high, 0.15, out, 0.7, profile), p.leg)
    return 2 * r


def _tray(p: Piece, y: tuple[float, float], z: float, end: float) -> None:
    """A tray for a keyboard that slides out under the top, on two rails."""
    t, start = max(0.014, p.unit), p.between(0.0, 0.03)
    length = min(p.between(0.28, 0.42), end - start - 0.02)
    w = max(0.012, 0.8 * p.unit)
    for a, b in ((y[0], y[0] + w), (y[1] - w, y[1])):
        p.add(box([start, a, z - 0.5 * t], [end, b, z + 0.031]), p.look.hardware)
    board = box([start, y[0] + w + 0.002, z - t], [start + length, y[1] - w - 0.002, z])
    if p.share(0.4):
        lip = [start, y[0] + w + 0.002, z - t], [start + t, y[1] - w - 0.002, z + 0.02]
        board = union([board, box(*lip)])
    face = p.look.face if p.share(0.7) else p.board
    travel = p.between(0.6, 0.95) * length
    p.moving.append(
        lambda asm, root: asm.add(
            "tray", Shape().add(board, face), root, slide((-1, 0, 0), travel), label="drawer"
        )
    )


def _return(p: Piece, end: float, under: float) -> None:
    """A second top that joins the first at one ``end`` and reaches to the front, as corner desks
    have, on legs that leave room for the pedestals' doors."""
    side = 1 if p.share(0.5) else -1
    wide, long = p.between(0.3, 0.45) * p.width, p.between(0.3, 0.7)
    a, b = sorted((side * end, side * (end + wide)))
    p.add(box([-long, a, under], [p.depth, b, p.height]), p.board)
    r = max(0.016, p.unit)
    for x in (r - long, p.depth - r):
        for y in (side * (end + 0.1 + r), side * (end + wide - r)):
            p.add(box([x - r, y - r, 0], [x + r, y + r, under]), p.leg)


def chest(p: Piece, style: DrawerStyle, flat: bool) -> None:
    """A case on the floor, on feet, a plinth or casters, under a top: doors, drawers, open bays."""
    rng, half, depth = p.rng, p.width / 2, p.depth
    thick = max(p.between(0.014, 0.04), 1.1 * p.unit)
    base = str(
        rng.choice(["none", "feet", "plinth", "legs", "casters"], p=[0.22, 0.25, 0.2, 0.2, 0.13])
    )
    heights = {"none": 0.0, "feet": 0.05, "plinth": 0.07, "legs": 0.16, "casters": 0.06}
    low = max(heights[base] * p.between(0.7, 1.3), 3 * p.unit if base == "casters" else 0.0)
    under = p.height - thick
    cells = list(columns(p, (-half, half), (low, under)))
    if flat and p.share(0.4):  # an open row over drawers
        split = under - p.between(0.25, 0.45) * (under - low)
        borders = np.linspace(-half, half, int(rng.integers(2, 5)))
        kind = "drawer" if p.share(0.75) or base != "casters" else "blank"
        spans = [(float(a), float(b)) for a, b in itertools.pairwise(borders)]
        cells = [Cell(s, (low, split), kind) for s in spans]
        cells += [Cell(s, (split, under), "open") for s in spans]
    case(p, style, (-half, half), (low, under), (0.0, depth), tuple(cells))
    r = max(p.between(0.014, 0.03), p.unit)
    spots = [(x, y) for x in (1.3 * r, depth - 1.3 * r) for y in (1.3 * r - half, half - 1.3 * r)]
    if base == "casters":
        table_parts.casters(p, spots, low)
    elif base == "plinth":
        back = p.between(0.0, 0.05)
        lo, hi = [back, back - half, 0], [depth, half - back, low]
        p.add(box(lo, hi), p.frame if p.share(0.6) else p.frame.darker(0.5))
    elif base in ("feet", "legs"):
        name = str(rng.choice(["square", "tapered", "round", "splayed", "turned", "saber"]))
        profile = table_parts.leg_profile(rng, "turned")
        for x, y in spots:
            out = np.sign([x - depth / 2, y])
            p.add(table_parts.leg(name, (x, y), r, low, 0.02, out, 0.8, profile), p.leg)
        if p.share(0.4):
            board = table_parts.shaped(
                (-half, half), (low, low + 0.004), (0.002, p.wall), 0.6 * low, "arch"
            )
            p.add(board, p.frame)
    over = 0.0 if p.share(0.3) else p.between(0.005, 0.05)
    ahead = over + (style.thick + 0.002 if style.mount == "over" and p.share(0.7) else 0.0)
    kinds = ["square", "rounded", "beveled", "framed", "glass"]
    shape = str(rng.choice(kinds, p=[0.55, 0.12, 0.15, 0.1, 0.08]))
    spans = (-ahead, depth + over), (-half - over, half + over), (under, p.height)
    table_tops.top(p, *spans, shape, p.between(0.01, 0.06))


def bowed(p: Piece, style: DrawerStyle) -> None:
    """A half-round or bow-fronted chest on legs: drawers whose fronts follow its outline."""
    half, depth = p.width / 2, p.depth
    thick = max(0.018, 1.2 * p.unit)
    under, low = p.height - thick, p.between(0.15, 0.5) * p.height
    power = p.between(1.6, 3.2)
    angle = np.linspace(-np.pi / 2, np.pi / 2, 25)

    def outline(grow: float) -> np.ndarray:
        """[n, 2] of (x, y): the front's curve, closed by a straight rear."""
        c, s = np.abs(np.cos(angle)) ** (2 / power), np.sin(angle)
        s = np.sign(s) * np.abs(s) ** (2 / power)
        curve = np.column_stack([depth - (depth + grow) * c, (half + grow) * s])
        return curve[
            np.concatenate([[True], np.linalg.norm(np.diff(curve, axis=0), axis=1) > 1e-6])
        ]

    def body(grow: float, a: float, b: float) -> Manifold:
        return shapes.extrusion(outline(grow), "z", [0, 0, a], b - a)

    wide = p.between(0.5, 0.75) * half
    tall, count = under - low, int(p.rng.integers(1, 4))
    count = min(count, max(1, int(tall / max(0.08, 7 * p.unit))))
    edges = low + p.wall / 2 + (tall - p.wall) * np.linspace(0, 1, count + 1)
    solid = body(0.0, low, under)
    front = dataclasses.replace(style, panel="slab", pairs=False, mount="flush")
    t = front.thick
    deepest = depth - depth * (1 - (wide / half) ** power) ** (1 / power)
    for a, b in itertools.pairwise(edges):
        a, b = float(a) + 0.4 * p.wall, float(b) - 0.4 * p.wall
        hole = box([-1, -wide, a], [depth - p.wall, wide, b])
        solid = solid - hole
        g = front.gap
        slab = body(-0.0005, a + g, b - g) ^ box([-1, g - wide, a], [depth, wide - g, b])
        start = deepest + t
        slab = slab - (body(-t, a - 1, b + 1) ^ box([-1, -9, -9], [start, 9, 9]))
        slab = slab - box([start, -9, -9], [9, 9, 9])
        lo, hi = [0.0, g - wide, a + g], [start, wide - g, b - g]
        room = (
            [start, g + 0.002 - wide, a + g + 0.001],
            [depth - p.wall - 0.003, wide - g - 0.002, b - g - 0.001],
        )

        def add(asm, root: int, lo=lo, hi=hi, room=room, slab=slab) -> None:
            add_drawer(asm, root, lo, hi, room[0], room[1], p.look, front, front=slab)

        p.moving.append(add)
    p.add(solid, p.frame)
    p.add(body(p.between(0.004, 0.03), under, p.height), p.board)
    r = max(0.014, p.unit)
    name = str(p.rng.choice(["square", "tapered", "saber", "cabriole", "turned"]))
    profile = table_parts.leg_profile(p.rng, "turned")
    y = 0.8 * half
    forward = depth - depth * (1 - 0.8**power) ** (1 / power) + 1.5 * r
    for x, at in ((forward, y), (forward, -y), (depth - r, y), (depth - r, -y)):
        if depth - r - x < 2 * r and x != depth - r:
            continue
        out = np.sign([x - depth / 2, at])
        p.add(table_parts.leg(name, (x, at), r, low + 0.001, 0.02, out, 0.6, profile), p.leg)

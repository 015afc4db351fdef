"""What tables hold: aprons with drawers and cases with doors, drawers and open bays; what stands
under their ends and on their tops."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
from manifold3d import Manifold

from uniart_jax.procedural import shapes, table_parts
from uniart_jax.procedural.cabinet import Case, Cell, Fit
from uniart_jax.procedural.pulls import GRIPS, DrawerStyle, add_drawer, pull_solid
from uniart_jax.procedural.shapes import box, cut, cylinder, exact
from uniart_jax.procedural.table_parts import Piece, Turned, about


@dataclasses.dataclass(frozen=True)
class Opening:
    """A rectangle of an apron and what fills it: 'drawer', or 'blank' (its outline is grooved).

    ``skirt``: by how much the lower edge of a drawer's front is higher in its middle, or at its
    ends, metres.
    """

    y: tuple[float, float]
    z: tuple[float, float]
    kind: str
    skirt: float = 0.0


def _drawer_in(
    p: Piece, style: DrawerStyle, cell: Opening, x: tuple[float, float], matrix: np.ndarray
) -> Manifold:
    """Register the drawer of an opening in a board at x = ``x[0]``, free until ``x[1]``; what it
    cuts out of the board."""
    lo, hi = np.array([x[0], cell.y[0], cell.z[0]]), np.array([x[0], cell.y[1], cell.z[1]])
    size = (hi - lo)[1:].min()
    lip = min(max(0.004, 0.4 * p.unit), 0.12 * size) if style.mount == "over" else 0.0
    hole_lo, hole_hi = lo + lip, hi - lip
    gap = min(style.gap, 0.06 * size)
    start = {"flush": 0.0, "back": 0.5 * style.thick, "over": -style.thick - 0.001}[style.mount]
    front_lo, front_hi = lo + gap, hi - gap
    front_lo[0], front_hi[0] = x[0] + start, x[0] + start + style.thick
    room_lo, room_hi = hole_lo + 0.0015 + gap * (lip == 0), hole_hi - 0.0015 - gap * (lip == 0)
    room_hi[0] = x[1] - 0.003

    front = None
    if cell.skirt > 0:
        room_lo[2] += cell.skirt
        front = _skirted(p, front_lo, front_hi, cell.skirt, p.share(0.5))

    def add(asm, root: int) -> None:
        to = Turned(asm, matrix)
        add_drawer(to, root, front_lo, front_hi, room_lo, room_hi, p.look, style, front)

    p.moving.append(add)
    return box([x[0] - 0.1, *hole_lo[1:]], [x[0] + 0.1, *hole_hi[1:]])


def _skirted(p: Piece, lo: np.ndarray, hi: np.ndarray, rise: float, arched: bool) -> Manifold:
    """A drawer's front whose lower corners are cut off, or whose lower edge is an arch."""
    (_, a, low), (_, b, high) = lo, hi
    wide = b - a
    if arched:
        t = np.linspace(0.06, 0.94, 13)
        edge = np.column_stack([a + wide * t, low + rise * np.sin(np.pi * (t - 0.06) / 0.88)])
        ring = np.vstack([[[a, low]], edge, [[b, low], [b, high], [a, high]]])
    else:
        c = min(p.between(0.6, 2.0) * rise, 0.3 * wide)
        ring = np.array(
            [[a, low + rise], [a + c, low], [b - c, low], [b, low + rise], [b, high], [a, high]]
        )
    return shapes.extrusion(ring, "x", [float(lo[0]), 0, 0], float(hi[0] - lo[0]))


def apron(
    p: Piece,
    style: DrawerStyle,
    y: tuple[float, float],
    z: tuple[float, float],
    x: tuple[float, float],
    front: list[Opening],
    rear: list[Opening],
    drop: float,
    manner: str,
) -> None:
    """Four boards under the top, the front and the rear one with drawers; the boards' ends lie
    within the legs. ``drop``, ``manner``: of their lower edge (``table_parts.shaped``)."""
    start, end = float(exact(x[0])), float(exact(x[1]))
    z = float(exact(z[0])), float(exact(z[1]))
    thick, middle = float(exact(min(p.wall, 0.15 * (end - start)))), (start + end) / 2
    both = bool(front) and bool(rear)
    for openings, turned in ((front, 0.0), (rear, 180.0)):
        matrix = about((middle, (y[0] + y[1]) / 2), turned)
        board = table_parts.shaped(y, z, (start, start + thick), drop, manner)
        free = middle if both else end - thick
        for cell in openings:
            if cell.kind == "drawer":
                hole = _drawer_in(p, style, cell, (start, free), matrix)
            else:
                w = max(0.0015, 0.2 * p.unit)
                lo, hi = (
                    [start - 1, cell.y[0], cell.z[0]],
                    [start + 0.4 * thick, cell.y[1], cell.z[1]],
                )
                inner = box([-9, lo[1] + w, lo[2] + w], [9, hi[1] - w, hi[2] - w])
                hole = box(lo, hi) - inner
                if p.share(0.5) and style.pull in GRIPS:
                    at = (cell.y[0] + cell.y[1]) / 2, (cell.z[0] + cell.z[1]) / 2
                    room = cell.y[1] - cell.y[0], cell.z[1] - cell.z[0]
                    grip = pull_solid(style, start, *at, room, p.unit)
                    p.add(grip.transform(matrix[:3]), style.hardware)
            board = board - hole
        p.add(board.transform(matrix[:3]), p.frame.along("y"))
    for side in y:
        low = z[0] if manner != "straight" else z[0] - drop
        p.add(box([start, side - 0.4 * thick, low], [end, side + 0.4 * thick, z[1]]), p.frame)


def case(
    p: Piece,
    style: DrawerStyle,
    y: tuple[float, float],
    z: tuple[float, float],
    x: tuple[float, float],
    cells: tuple[Cell, ...],
    matrix: np.ndarray | None = None,
) -> None:
    """A case with doors, drawers and open bays; its front looks to -x before ``matrix`` moves
    it."""
    free = matrix is None and y[0] == -y[1]  # nothing beside it: its doors may open wide
    matrix = np.eye(4) if matrix is None else matrix
    whole = Case(y, z, x[0], x[1] - x[0], p.wall, cells, covered=True)
    p.add(whole.solid(p.rng).transform(matrix[:3]), p.frame)
    fit = Fit.draw(p.rng, p.unit, p.wall)
    over = style.mount == "over"
    reveal = p.between(0.1, 0.5) * p.wall if p.share(0.5) else 0.0
    swing = fit.swing if free else min(fit.swing, float(np.deg2rad(95)))
    seam = 2 * style.gap
    fit = dataclasses.replace(fit, inset=not over, seam=seam, reveal=reveal, swing=swing)
    doors = tuple(c for c in cells if c.kind != "drawer")
    rest = dataclasses.replace(whole, cells=doors)

    def add(asm, root: int) -> None:
        rest.add_fronts(p.rng, Turned(asm, matrix), root, p.look, fit)
        for cell in cells:
            if cell.kind == "drawer":
                lo, hi = whole.bay(cell)
                room_lo, room_hi = lo + style.gap + 0.001, hi - style.gap - 0.001
                start = x[0] + (0.0 if style.mount == "flush" else 0.5 * style.thick)
                front_lo, front_hi = lo + style.gap, hi - style.gap
                if over:
                    air = style.gap + reveal
                    front_lo = np.array([0, cell.y[0] + air, cell.z[0] + air])
                    front_hi = np.array([0, cell.y[1] - air, cell.z[1] - air])
                    start = x[0] - style.thick - 0.001
                front_lo[0], front_hi[0] = start, start + style.thick
                add_drawer(
                    Turned(asm, matrix), root, front_lo, front_hi, room_lo, room_hi, p.look, style
                )

    p.moving.append(add)


def stack(p: Piece, y: tuple[float, float], z: tuple[float, float]) -> list[Cell]:
    """Cells of a pedestal or of a chest's column: drawers, a door under or over a drawer, an open
    bay, or one door."""
    tall, least = z[1] - z[0], max(0.07, 6 * p.unit)
    door = "double" if y[1] - y[0] > 0.55 else "door"
    plan = p.rng.choice(6, p=[0.5, 0.14, 0.16, 0.08, 0.06, 0.06])
    if plan == 0 or tall < 3 * least:
        most = max(1, min(4, int(tall / least)))
        count = int(p.rng.integers(1 if most < 3 else 2, most + 1))
        weights = np.ones(count) if p.share(0.6) else np.linspace(1.6, 1.0, count)
        borders = z[0] + tall * np.concatenate([[0], np.cumsum(weights)]) / weights.sum()
        return [Cell(y, (float(a), float(b)), "drawer") for a, b in itertools.pairwise(borders)]
    upper = z[1] - max(least, p.between(0.16, 0.32) * tall)
    if plan == 1:
        wide = y[1] - y[0] > 0.8 * tall
        return [Cell(y, z, "flap" if wide and p.share(0.35) else door)]
    if plan == 5:
        return [Cell(y, (z[0], upper), "drawer"), Cell(y, (upper, z[1]), "open")]
    kind = (door, "open", "blank")[plan - 2]
    first = "open" if plan == 2 and p.share(0.15) else "drawer"
    return [Cell(y, (z[0], upper), kind), Cell(y, (upper, z[1]), first)]


def columns(p: Piece, y: tuple[float, float], z: tuple[float, float]) -> tuple[Cell, ...]:
    """Cells of a cabinet: one to three columns, alike at both ends; at most nine that move."""
    least = max(0.2, 14 * p.unit)
    for _ in range(20):
        count = int(np.clip(p.rng.integers(1, 4), 1, max(1, int((y[1] - y[0]) / least))))
        weights = np.array([1.0, p.between(0.7, 1.6), 1.0][:count] if count != 2 else [1.0, 1.0])
        borders = np.concatenate([[0], np.cumsum(weights)]) / weights.sum() * (y[1] - y[0]) + y[0]
        spans = [(float(a), float(b)) for a, b in itertools.pairwise(borders)]
        plans = [stack(p, span, z) for span in spans]
        if count > 1 and p.share(0.7):
            plans[-1] = [dataclasses.replace(c, y=spans[-1]) for c in plans[0]]
        cells = tuple(itertools.chain(*plans))
        if 1 <= sum({"open": 0, "blank": 0, "double": 2}.get(c.kind, 1) for c in cells) <= 9:
            return cells
    return (Cell(y, z, "drawer"),)


def ends(p: Piece, under: float, thick: float) -> None:
    """What stands under both ends instead of legs: boards, boards with an arch, or frames."""
    kind, half, depth = p.rng.integers(5), p.width / 2, p.depth
    for side in (-1, 1):
        if kind > 2:
            _trestle(p, side, thick, under, crossed=kind == 3)
            continue
        a, b = sorted((side * half, side * (half - thick)))
        solid = box([0, a, 0], [depth, b, under])
        if kind == 1:
            wide = p.between(0.2, 0.4) * depth
            hole = cylinder("y", [0, a - 0.01, 0], thick + 0.02, 1.0, segments=24)
            hole = hole.scale((wide, 1, p.between(0.06, 0.2) * under)).translate((depth / 2, 0, 0))
            solid = cut(solid, (hole,))
        elif kind == 2 and depth > 4 * thick:
            low = thick if p.share(0.7) else -0.01
            solid = cut(solid, (box([thick, a - 1, low], [depth - thick, b + 1, under - thick]),))
        p.add(solid, p.leg)


def _trestle(p: Piece, side: int, thick: float, under: float, crossed: bool) -> None:
    """A foot, a post that may lean and a head at one end; or two bars that cross."""
    a, b = sorted((side * p.width / 2, side * (p.width / 2 - thick)))
    depth, w = p.depth, max(0.7 * thick, 0.9 * p.unit)
    if crossed:
        for x0, x1 in ((w, depth - w), (depth - w, w)):
            ring = np.array([[0.0, x0 - w], [0.0, x0 + w], [under, x1 + w], [under, x1 - w]])
            p.add(shapes.extrusion(ring, "y", [0, a, 0], b - a), p.leg)
    else:
        middle, wide = depth / 2, p.between(0.06, 0.2) * depth + w
        wide = wide if p.share(0.6) else w
        lean = p.between(-0.3, 0.3) * depth if p.share(0.4) else 0.0  # of metal frames, and easels
        low, high = middle - 0.5 * lean, middle + 0.5 * lean
        ring = [
            [0.001, low - wide],
            [0.001, low + wide],
            [under, high + wide],
            [under, high - wide],
        ]
        p.add(shapes.extrusion(np.array(ring), "y", [0, a, 0], b - a), p.leg)
        p.add(box([0.02, a, 0], [depth - 0.02, b, 1.6 * w]), p.leg)
    p.add(box([0.0, a, under - 1.6 * w], [depth, b, under]), p.leg)


def hung(
    p: Piece, style: DrawerStyle, y: tuple[float, float], under: float, x: tuple[float, float]
) -> None:
    """Small cases of one to three drawers that hang under the top: at an end, at both, or amid."""
    wide = y[1] - y[0]
    size = max(p.between(0.14, 0.4) * wide, 10 * p.unit)
    plan = p.rng.integers(4)
    starts = (
        [y[0]],
        [y[1] - size],
        [y[0], y[1] - size],
        [y[0] + (wide - size) * p.between(0.1, 0.9)],
    )[plan]
    if len(starts) == 2 and 2 * size > 0.95 * wide:
        starts = starts[:1]
    shift = p.between(0.0, 0.08) * wide if p.share(0.5) and plan < 2 else 0.0
    rows = int(p.rng.integers(1, 4))
    tall = min(max(p.between(0.06, 0.13), 5.5 * p.unit) * rows, 0.7 * under)
    front = p.between(0.0, 0.2) * (x[1] - x[0])
    spans = []
    for start in starts:
        a = start + (shift if start == y[0] else -shift if plan == 1 else 0.0)
        span = (a, a + size)
        spans.append(span)
        edges = np.linspace(under - tall, under, rows + 1)
        cells = [Cell(span, (float(c), float(d)), "drawer") for c, d in itertools.pairwise(edges)]
        if rows > 1 and p.share(0.2):
            cells[int(p.rng.integers(rows))] = dataclasses.replace(cells[0], kind="open")
            cells = [
                dataclasses.replace(c, z=(float(e), float(f)))
                for c, (e, f) in zip(cells, itertools.pairwise(edges), strict=True)
            ]
        end = x[1] - p.between(0.0, 0.3) * (x[1] - x[0])
        case(p, style, span, (under - tall, under), (x[0] + front, end), tuple(cells))
    if p.share(0.6):
        row = p.between(0.03, 0.09)
        back = p.between(0.3, 0.9) * (x[1] - x[0])
        walls = box([back, y[0] - 0.002, under - row], [back + p.wall, y[1] + 0.002, under])
        taken = [box([-1, a, 0], [2, b, 2]) for a, b in spans]
        p.add(cut(walls, taken), p.frame)


def upper(p: Piece, x: tuple[float, float], half: float) -> None:
    """On a top: a rail along its rear, open shelves, or a rack on posts."""
    kind, high, t = p.rng.integers(3), p.height, p.wall
    if kind == 0:
        p.add(box([x[1] - t, -half, high], [x[1], half, high + p.between(0.03, 0.14)]), p.frame)
        if p.share(0.4):
            for a, b in ((-half, t - half), (half - t, half)):
                start = x[0] + p.between(0.2, 0.7) * (x[1] - x[0])
                p.add(box([start, a, high], [x[1] - t, b, high + 0.03]), p.frame)
        return
    front, tall = x[1] - p.between(0.25, 0.5) * (x[1] - x[0]), p.between(0.15, 0.5)
    if kind == 1:
        borders = np.linspace(-half, half, int(p.rng.integers(2, 5)))
        rows = np.linspace(high, high + tall, 2 if tall < 0.3 or p.share(0.5) else 3)
        pairs = itertools.product(itertools.pairwise(borders), itertools.pairwise(rows))
        cells = [
            Cell((float(a), float(b)), (float(c), float(d)), "open") for (a, b), (c, d) in pairs
        ]
        shelf = Case((-half, half), (high, high + tall), front, x[1] - front, t, tuple(cells))
        p.add(shelf.solid(p.rng), p.frame)
        return
    r = max(0.01, 0.7 * p.unit)
    for y in (r - half, half - r):
        p.add(box([x[1] - 2 * r, y - r, high], [x[1], y + r, high + tall]), p.leg)
    for z in (tall - 1.4 * t, *((0.5 * tall,) if p.share(0.5) else ())):
        p.add(box([front, -half, high + z], [x[1], half, high + z + t]), p.frame.along("y"))

"""Cookers as they stand in real kitchens: ranges with grates and a backguard, range cookers with
doors side by side, ovens in a wall or in a kitchen island, hobs alone; knobs in uneven rows."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import appliance_fronts, appliances, controls, finishes, materials
from uniart_jax.procedural import real_finishes as finish
from uniart_jax.procedural.cooker_panels import (
    Case,
    add_column,
    add_hob_with_column,
    add_panel,
)
from uniart_jax.procedural.fronts import FrontStyle, add_door, add_drawer
from uniart_jax.procedural.hinges import opening
from uniart_jax.procedural.shapes import Assembly, Shape, box, cut, slide, union

PLANS = ("range", "wide", "wall", "hob", "island", "small")
MOST = 15  # parts beside the body


@dataclasses.dataclass(frozen=True)
class Cell:
    """A rectangle of the front: what it holds is one of flap, side, drawer, blank, plinth."""

    y0: float
    y1: float
    z0: float
    z1: float
    kind: str

    @property
    def size(self) -> float:
        """Of what turns, from its hinged edge to its free one."""
        return self.y1 - self.y0 if self.kind == "side" else self.z1 - self.z0


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A cooker, metres, closed."""
    plan = str(rng.choice(PLANS, p=[0.43, 0.17, 0.15, 0.1, 0.09, 0.06]))
    return _hob_alone(rng) if plan == "hob" else _cooker(rng, plan)


def _cooker(rng: np.random.Generator, plan: str) -> ArticulatedObject:
    wide = {"range": (0.5, 1.0), "wide": (0.9, 1.6), "small": (0.4, 0.7)}.get(plan, (0.55, 0.9))
    tall = {"small": (0.26, 0.45), "wall": (0.42, 1.35)}.get(plan, (0.8, 1.0))
    width, height = float(rng.uniform(*wide)), float(rng.uniform(*tall))
    depth = float(rng.uniform(0.3, 0.5) if plan == "small" else rng.uniform(0.45, 0.78))
    total = width + (float(rng.uniform(0.4, 1.3)) if plan == "island" else 0.0)
    unit = max(total, height, depth) / 100
    face = appliance_fronts.outside(rng)
    thick = max(0.015, float(rng.uniform(1.5, 6.0)) * unit)
    look = appliance_fronts.appliance_style(rng, unit, face, thick)
    hob = plan in ("range", "wide", "island") and rng.random() < 0.94
    where = _controls_at(rng, plan, hob)
    legs = 0.0 if plan == "wall" or rng.random() < 0.4 else float(rng.uniform(0.01, 0.13))
    legs *= 0.3 if plan == "small" else 1.0
    band = float(rng.uniform(0.08, 0.17)) * min(height, 1.0) if where == "front" else 0.0
    band += float(rng.uniform(0.0, 0.06)) * height
    case = appliance_fronts.case_of(rng, face)
    panel = look.face if rng.random() < 0.55 else appliance_fronts.case_of(rng, face)
    if rng.random() < 0.13:
        panel = finishes.dark(rng)
    c = Case(
        Shape(), -width / 2, width / 2, legs, height - band, height, depth, -thick - 0.002, unit,
        look, panel,
    )  # fmt: skip
    if plan == "small" and rng.random() < 0.5:
        where = "column"
        c.y0 += float(rng.uniform(0.18, 0.3)) * width
    cells = _cells(rng, plan, c)
    if all(cell.kind in ("blank", "plinth") for cell in cells):
        cells[-1] = dataclasses.replace(cells[-1], kind="flap")  # a cooker has an oven
    turning = [cell.size for cell in cells if cell.kind in ("flap", "side")]
    c.front = -min(thick, 0.15 * min(turning, default=thick / 0.15)) - 0.002
    asm = Assembly()
    if legs > 0.006:
        appliances.feet(c.body, rng, width, depth, legs, unit)
    wall = max(0.015, float(rng.uniform(1.8, 4.0)) * unit)
    bays = [_bay(cell, c, wall) for cell in cells]
    hollow = [
        box([-0.1, *lo[1:]], hi)
        for (lo, hi), cell in zip(bays, cells, strict=True)
        if cell.kind not in ("blank", "plinth")
    ]
    shell = box([0, -width / 2, legs], [depth, width / 2, height])
    lined = rng.random() < 0.4
    c.body.add(cut(shell, hollow), case)
    if lined:
        _lining(rng, c, bays, cells, unit)
    extra = _kitchen(rng, c, total) if plan == "island" else []
    racks = _racks(rng, c, bays, cells)
    doors = sum(cell.kind not in ("blank", "plinth") for cell in cells) + len(extra)
    if where == "column":
        c.y0 = -width / 2
        column = (-width / 2, cells[0].y0)
        dials, buttons = add_column(rng, c, column)
    else:
        dials, buttons = add_panel(rng, c, where, hob, MOST - doors - len(racks))
    for cell in cells:
        if cell.kind == "blank":
            gap = 0.0015
            lo = [c.front, cell.y0 + gap, cell.z0 + gap]
            appliance_fronts.false_front(
                c.body, rng, lo, [0, cell.y1 - gap, cell.z1 - gap], look
            )  # fmt: skip
    root = asm.add("body", c.body)
    _fronts(rng, asm, root, c, cells, bays)
    for cell, style in extra:
        _cupboard(rng, asm, root, c, cell, style)
    for shape, travel in racks:
        asm.add("rack", shape, root, slide((-1, 0, 0), travel))
    for places, dial, tilt in dials:
        controls.add_dials(asm, root, places, dial, tilt=tilt)
    for face_x, group, stand, travel, material in buttons:
        controls.add_buttons(asm, root, face_x, group, stand, travel, material)
    return asm.object()


def _controls_at(rng: np.random.Generator, plan: str, hob: bool) -> str:
    """Where the knobs are."""
    if plan in ("wall", "small") or not hob:
        return str(rng.choice(["front", "none"], p=[0.85, 0.15]))
    return str(rng.choice(["front", "guard", "near", "none"], p=[0.7, 0.17, 0.08, 0.05]))


def _cells(rng: np.random.Generator, plan: str, c: Case) -> list[Cell]:
    """How the front is shared out."""
    low, top, tall = c.low, c.top, c.top - c.low
    if plan == "small":
        return [Cell(c.y0, c.y1, low, top, "flap" if rng.random() < 0.75 else "side")]
    if plan == "wall":
        if c.height < 0.75 or rng.random() < 0.15:
            return [Cell(c.y0, c.y1, low, top, "flap" if rng.random() < 0.85 else "side")]
        middle = low + tall * float(rng.uniform(0.35, 0.68))
        gap = tall * float(rng.choice([0.0, rng.uniform(0.02, 0.12)]))
        kinds = ["flap", "flap" if rng.random() < 0.85 else "side"]
        cells = [Cell(c.y0, c.y1, low, middle, kinds[0])]
        if gap > 0.02:
            cells.append(Cell(c.y0, c.y1, middle, middle + gap, "plinth"))
        cells.append(Cell(c.y0, c.y1, middle + (gap if gap > 0.02 else 0), top, kinds[1]))
        return cells
    foot, cells = low, []
    below = str(rng.choice(["drawer", "blank", "plinth", "none"], p=[0.24, 0.24, 0.17, 0.35]))
    if below != "none":
        foot = low + tall * float(rng.uniform(0.1, 0.28))
        cells.append(Cell(c.y0, c.y1, low, foot, below))
    if plan != "wide":
        if rng.random() < 0.2:  # a grill or a second oven above
            middle = foot + (top - foot) * float(rng.uniform(0.45, 0.72))
            upper = str(rng.choice(["flap", "drawer", "blank"], p=[0.7, 0.15, 0.15]))
            return [
                *cells,
                Cell(c.y0, c.y1, foot, middle, "flap"),
                Cell(c.y0, c.y1, middle, top, upper),
            ]
        kind = "flap" if rng.random() < 0.88 else "side"
        return [*cells, Cell(c.y0, c.y1, foot, top, kind)]
    if rng.random() < 0.5:
        cells, foot = cells if rng.random() < 0.5 else [], foot if cells else low
        foot = foot if cells else low
    count = int(rng.choice([1, 2, 3], p=[0.1, 0.72, 0.18]))
    ys = np.linspace(c.y0, c.y1, count + 1)
    shift = (c.y1 - c.y0) / count * float(rng.choice([0.0, rng.uniform(-0.28, 0.28)]))
    if count > 1:
        ys[1] += shift
    for a, b in itertools.pairwise(ys):
        a, b = float(a), float(b)
        kind = str(rng.choice(["flap", "side", "blank", "drawer"], p=[0.72, 0.14, 0.07, 0.07]))
        if kind == "flap" and rng.random() < 0.3:
            middle = foot + (top - foot) * float(rng.uniform(0.25, 0.7))
            lower = str(rng.choice(["flap", "drawer", "blank", "side"], p=[0.35, 0.25, 0.3, 0.1]))
            cells += [Cell(a, b, foot, middle, lower), Cell(a, b, middle, top, "flap")]
        else:
            cells.append(Cell(a, b, foot, top, kind))
    return cells


def _bay(cell: Cell, c: Case, wall: float) -> tuple[np.ndarray, np.ndarray]:
    """The room behind a front."""
    sides = [wall if abs(v - edge) < 1e-6 else wall / 2
             for v, edge in ((cell.y0, c.y0), (cell.y1, c.y1))]  # fmt: skip
    lo = np.array([0.0, cell.y0 + sides[0], cell.z0 + wall / 2])
    return lo, np.array([c.depth - wall, cell.y1 - sides[1], cell.z1 - wall / 2])


def _lining(rng, c: Case, bays, cells, unit: float) -> None:
    """A dark or pale back in each oven."""
    inner = finishes.dark(rng) if rng.random() < 0.6 else materials.plain((0.6, 0.6, 0.62))
    for (lo, hi), cell in zip(bays, cells, strict=True):
        if cell.kind in ("flap", "side") and hi[2] - lo[2] > 0.1:
            back = [hi[0] - 0.4 * unit, lo[1] + 1e-3, lo[2] + 1e-3]
            c.body.add(box(back, [hi[0], hi[1] - 1e-3, hi[2] - 1e-3]), inner)


def _racks(rng, c: Case, bays, cells) -> list[tuple[Shape, float]]:
    """Shelves of wire in the ovens: fixed ones join the body, those that slide are returned with
    their travel."""
    kind = str(
        rng.choice(
            ["none", "fixed", "slide"], p=[0.35, 0.15, 0.5] if c.height > 1 else [0.5, 0.22, 0.28]
        )
    )
    wire = max(0.012, float(rng.uniform(1.5, 3.0)) * c.unit)
    steel = finishes.metal(rng, brushed=False)
    moving: list[tuple[Shape, float]] = []
    number, pull = int(rng.choice([1, 2, 3], p=[0.5, 0.3, 0.2])), float(rng.uniform(0.55, 0.95))
    bars, start = int(rng.integers(5, 14)), 0.012
    if rng.random() < 0.6:  # shorter than the oven, at its rear
        start = float(rng.uniform(0.03, 0.38)) * c.depth
    for (lo, hi), cell in zip(bays, cells, strict=True):
        if kind == "none" or cell.kind not in ("flap", "side") or hi[2] - lo[2] < 0.18:
            continue
        far = hi[0] * float(rng.uniform(0.75, 0.98)) - 0.5 * c.unit - 0.002
        several = number if rng.random() < 0.6 else int(rng.integers(1, 4))
        levels = min(several, int((hi[2] - lo[2]) / (4 * wire)) - 1)
        for z in np.linspace(lo[2] + 0.03, hi[2] - 2 * wire, levels + 2)[1:-1]:
            air = 0.003 if kind == "slide" else 0.0
            near = np.array([start, lo[1] + air, z])
            end = np.array([far, hi[1] - air, z + wire])
            if kind == "fixed":
                c.body.add(_wires(near, end, wire, bars), steel)
            elif len(moving) < 4:
                moving.append(
                    (Shape().add(_wires(near, end, wire, bars), steel), pull * (far - start))
                )
    return moving


def _wires(lo, hi, wire: float, bars: int):
    """A flat shelf: a frame with thin bars across."""
    low, thin = lo[2] + 0.35 * wire, 0.3 * wire
    rim = box(lo, hi) - box(
        [lo[0] + 0.6 * wire, lo[1] + 0.6 * wire, lo[2] - 1],
        [hi[0] - 0.6 * wire, hi[1] - 0.6 * wire, hi[2] + 1],
    )
    rods = [
        box([lo[0] + 0.1 * wire, y - thin / 2, low], [hi[0] - 0.1 * wire, y + thin / 2, low + thin])
        for y in np.linspace(lo[1] + wire, hi[1] - wire, bars)
    ]
    return union([rim, *rods])


def _fronts(rng, asm: Assembly, root: int, c: Case, cells, bays) -> None:
    """Doors, flaps and drawers of the appliance."""
    seam = float(rng.uniform(0.0015, 0.006))
    angle = np.pi / 2 if rng.random() < 0.75 else float(np.deg2rad(rng.uniform(70, 95)))
    pane_kind = appliance_fronts.window_kind(rng) if rng.random() < 0.7 else None
    for cell, bay in zip(cells, bays, strict=True):
        if cell.kind in ("blank", "plinth"):
            continue
        lo = np.array([c.front, cell.y0 + seam / 2, cell.z0 + seam / 2])
        hi = np.array([-0.002, cell.y1 - seam / 2, cell.z1 - seam / 2])
        below = any(
            o.kind != "plinth" and abs(o.z1 - cell.z0) < 1e-6 and o.y0 < cell.y1 and o.y1 > cell.y0
            for o in cells
        )  # nothing of a flap may go below its edge
        # about its face, the rear corner of a free edge swings past it: air for that
        size = cell.size - seam
        swept = max(0.0, size - float(np.sqrt((size + 0.8 * seam) ** 2 - (hi[0] - lo[0]) ** 2)))
        if cell.kind == "flap":
            hi[2] -= swept if below else 0.0
            look, extra = appliance_fronts.dressed(rng, lo, hi, "+z", c.look, pane_kind=pane_kind)
            if lo[0] < -0.1 * (hi[2] - lo[2]):  # thick: about its face, its top would go up
                look = dataclasses.replace(look, axis_depth=max(0.6, look.axis_depth))
            options = {"inset": below, "beyond": 1.0, "extra": extra}
            add_door(asm, root, lo, hi, "-z", angle, look, **options)
        elif cell.kind == "side":
            left = cell.y1 > c.y1 - 1e-6 and (cell.y0 > c.y0 + 1e-6 or rng.random() < 0.6)
            free = "-y" if left else "+y"
            if left:
                lo[1] += swept if len(cells) > 1 else 0.0
            else:
                hi[1] -= swept if len(cells) > 1 else 0.0
            look, extra = appliance_fronts.dressed(rng, lo, hi, free, c.look, pane_kind=pane_kind)
            look = dataclasses.replace(look, reach=float((lo[2] + hi[2]) / 2))
            add_door(
                asm, root, lo, hi, "+y" if left else "-y", opening(rng, 0.15), look,
                beyond=1.0, extra=extra, inset=len(cells) > 1,
            )  # fmt: skip
        else:
            style = str(rng.choice([c.look.handle, "recess", "none"], p=[0.6, 0.15, 0.25]))
            look = dataclasses.replace(c.look, handle="bar" if style == "bow" else style)
            pull, deep = float(rng.uniform(0.6, 0.98)), float(rng.uniform(0.65, 0.97))
            add_drawer(asm, root, lo, hi, bay[0], bay[1], pull, look, kind="slab", depth=deep)


def _kitchen(rng, c: Case, total: float) -> list[tuple[Cell, FrontStyle]]:
    """The units of a kitchen beside the oven, under one worktop; their doors and drawers."""
    rest = total - (c.y1 - c.y0)
    share = float(rng.choice([0.0, 1.0, rng.uniform(0.2, 0.8)]))
    wood = finish.strong_wood(rng) if rng.random() < 0.6 else finishes.furniture(rng)
    top = finish.speckled(rng) if rng.random() < 0.6 else finishes.wood(rng)
    style = dataclasses.replace(
        c.look, face=wood, panel=str(rng.choice(["slab", "shaker", "raised"])),
        handle=str(rng.choice(["bar", "knob", "round_bar", "none"])), thickness=0.02,
    )  # fmt: skip
    slab, over = float(rng.uniform(0.02, 0.05)), float(rng.uniform(0.0, 0.03))
    moving = []
    for a, b in ((c.y0 - share * rest, c.y0), (c.y1, c.y1 + (1 - share) * rest)):
        if b - a < 0.05:
            continue
        high = c.height - slab
        shell = box([0, a, 0], [c.depth, b, high])
        outer = [a - over, b] if a < c.y0 else [a, b + over]
        c.body.add(box([-over, outer[0], high], [c.depth, outer[1], c.height]), top)
        pick = str(rng.choice(["plain", "side", "drawer", "open"], p=[0.5, 0.28, 0.12, 0.1]))
        if b - a < 0.25:
            pick = "plain"
        if pick != "plain":
            shell = cut(
                shell, [box([-0.1, a + 0.02, 0.1], [c.depth - 0.02, b - 0.02, high - 0.02])]
            )
        c.body.add(shell, wood)
        if pick in ("side", "drawer"):
            low = float(rng.uniform(0.06, 0.1))
            middle = float(rng.uniform(0.3, 0.7)) * high if pick == "drawer" else low
            if pick == "drawer":
                moving.append((Cell(a, b, low, middle, "side"), style))
            moving.append((Cell(a, b, middle, high, pick), style))
    return moving


def _cupboard(rng, asm: Assembly, root: int, c: Case, cell: Cell, style: FrontStyle) -> None:
    """A door or a drawer of the kitchen."""
    lo = np.array([-style.thickness - 0.002, cell.y0 + 0.003, cell.z0 + 0.0015])
    hi = np.array([-0.002, cell.y1 - 0.003, cell.z1 - 0.0015])
    if cell.kind == "drawer":
        bay = ([0.0, cell.y0 + 0.022, max(cell.z0, 0.1) + 0.002],
               [c.depth - 0.022, cell.y1 - 0.022, cell.z1 - 0.022])  # fmt: skip
        add_drawer(asm, root, lo, hi, *bay, float(rng.uniform(0.6, 0.95)), style)
        return
    edge = "+y" if cell.y0 > c.y0 else "-y"
    add_door(asm, root, lo, hi, edge, opening(rng, 0.2), style, beyond=1.0, inset=True)


def _hob_alone(rng: np.random.Generator) -> ArticulatedObject:
    """A cooktop for a worktop, or a rangetop with its own front: only knobs move."""
    width, depth = float(rng.uniform(0.45, 1.25)), float(rng.uniform(0.4, 0.75))
    rangetop = rng.random() < 0.5
    height = float(rng.uniform(0.12, 0.3) if rangetop else rng.uniform(0.03, 0.14))
    unit = max(width, depth) / 100
    face = appliance_fronts.outside(rng)
    look = appliance_fronts.appliance_style(rng, unit, face, 0.02)
    c = Case(Shape(), -width / 2, width / 2, 0.0, 0.0, height, depth, -0.002, unit, look, face,
             least=1)  # fmt: skip
    asm = Assembly()
    if rangetop:
        c.body.add(box([0, c.y0, 0], [depth, c.y1, height]), appliance_fronts.case_of(rng, face))
        c.front = -float(rng.uniform(1.0, 6.0)) * unit
        dials, _ = add_panel(rng, c, "front", True, 9)
    else:
        lip = float(rng.uniform(0.0, 0.05))
        low = 0.6 * height
        c.body.add(box([lip, lip - width / 2, 0], [depth - lip, width / 2 - lip, low]), face)
        c.body.add(box([0, c.y0, low], [depth, c.y1, height]), face)
        c.top = height
        if rng.random() < 0.55:
            dials, _ = add_panel(rng, c, "near", True, 9)
        else:
            dials = add_hob_with_column(rng, c)
    root = asm.add("body", c.body)
    for places, dial, tilt in dials:
        controls.add_dials(asm, root, places, dial, tilt=tilt)
    return asm.object()

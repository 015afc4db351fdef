"""Casement windows: a frame with one to four sashes hinged at the side, the top or the bottom,
handles that turn; shutters."""

from __future__ import annotations

import itertools

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import hinges, materials
from uniart_jax.procedural.fronts import FrontStyle, panel
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import Assembly, Shape, box, cut, cylinder, hinge, turn, union


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A casement window, metres, closed."""
    columns = int(rng.choice([1, 2, 3], p=[0.32, 0.45, 0.23]))
    height = float(rng.uniform(0.6, 1.7))
    width = columns * height * float(rng.uniform(0.4, 0.9))
    scale = min(1.0, 2.2 / max(width, height))
    width, height = width * scale, height * scale
    unit = max(width, height) / 100
    jamb, depth = float(rng.uniform(3.0, 6.5)) * unit, float(rng.uniform(3.5, 9)) * unit
    post = float(rng.uniform(0.5, 1.0)) * jamb
    face = _finish(rng)
    sash_face = face if rng.random() < 0.65 else _finish(rng)
    half = width / 2

    sides = np.linspace(-half + jamb, half - jamb, columns + 1)
    sides[1:-1] += (sides[1] - sides[0]) * float(rng.choice([0, rng.uniform(-0.2, 0.2)]))
    levels = [jamb, height - jamb]
    light = rng.random() < 0.25 and height > 0.8  # a row of small ones above the others, or below
    if light:
        share = float(rng.uniform(0.22, 0.35))
        levels.insert(
            1, levels[0] + (share if rng.random() < 0.2 else 1 - share) * (levels[1] - levels[0])
        )
    bays = []  # lo (y, z), hi (y, z)
    for low, high in itertools.pairwise(levels):
        whole = light and high - low < 0.5 * height and rng.random() < 0.5
        edges = [sides[0], sides[-1]] if whole else list(sides)
        for a, b in itertools.pairwise(edges):
            lo = [a if a == edges[0] else a + post / 2, low if low == levels[0] else low + post / 2]
            hi = [
                b if b == edges[-1] else b - post / 2,
                high if high == levels[-1] else high - post / 2,
            ]
            bays.append((np.array(lo), np.array(hi)))

    asm, frame = Assembly(), Shape()
    holes = [box([-1, *lo], [1 + depth, *hi]) for lo, hi in bays]
    frame.add(cut(box([0, -half, 0], [depth, half, height]), holes), face)
    if rng.random() < 0.5:  # a sill
        out, side, thick = (float(rng.uniform(*r)) * unit for r in ((2, 9), (0, 5), (1.5, 3)))
        board = box([-out, -half - side, -thick], [depth, half + side, 0])
        frame.add(board, face if rng.random() < 0.6 else materials.stone(rng))
    plan = [_how(rng, hi - lo, len(bays)) for lo, hi in bays]
    if "fixed" in plan and all(p == "fixed" for p in plan):
        plan[0] = "+y"
    look = _Look(rng, unit, sash_face, depth, post)
    for (lo, hi), edge in zip(bays, plan, strict=True):
        if edge == "fixed":
            _fixed_pane(frame, lo, hi, depth, look, unit)
    root = asm.add("frame", frame)
    moving = [(lo, hi, edge) for (lo, hi), edge in zip(bays, plan, strict=True) if edge != "fixed"]
    handles = look.handle if len(moving) <= 7 else "none"
    for lo, hi, edge in moving:
        if edge == "pair":
            middle, seam = (lo[0] + hi[0]) / 2, 0 if look.inset else look.lap + 0.2 * unit
            _sash(asm, root, np.array([middle + seam, lo[1]]), hi, "+y", look, unit, handles)
            _sash(asm, root, lo, np.array([middle - seam, hi[1]]), "-y", look, unit, "none")
        else:
            _sash(asm, root, lo, hi, edge, look, unit, handles)
    return asm.object()


def _finish(rng: np.random.Generator) -> Material:
    """White plastic, wood, aluminium or paint."""
    kind = rng.choice(4, p=[0.4, 0.27, 0.13, 0.2])
    if kind == 0:
        return materials.white_plastic(rng)
    if kind == 1:
        return materials.wood(rng)
    return materials.metal(rng, brushed=False) if kind == 2 else materials.paint(rng)


def _how(rng: np.random.Generator, size: np.ndarray, count: int) -> str:
    """Hinge edge of a sash, 'pair' for two that meet, or 'fixed'."""
    wide = size[0] / size[1]
    if count > 1 and rng.random() < 0.18:
        return "fixed"
    if wide > 1.5:
        return str(rng.choice(["+z", "-z"], p=[0.65, 0.35]))
    if wide > 0.85 and rng.random() < 0.5:
        return "pair"
    return str(rng.choice(["+y", "-y", "+z", "-z"], p=[0.42, 0.42, 0.1, 0.06]))


class _Look:
    """What the sashes of one window have in common (metres, radians)."""

    def __init__(
        self, rng: np.random.Generator, unit: float, face: Material, depth: float, post: float
    ):
        self.face, self.glass = face, materials.glass(rng)
        self.metal = materials.hardware(rng)
        self.thick = min(float(rng.uniform(2.2, 4.2)) * unit, 0.9 * depth)
        self.rail = float(rng.uniform(2.6, 5.5)) * unit
        self.bars = (int(rng.choice([0, 0, 0, 1, 2])), int(rng.choice([0, 0, 0, 1, 2, 3])))
        self.bar = float(rng.uniform(0.8, 1.6)) * unit
        self.kind = str(rng.choice(["glass", "slats", "shaker"], p=[0.84, 0.11, 0.05]))
        self.handle = str(rng.choice(["lever", "ring", "knob", "none"], p=[0.6, 0.12, 0.13, 0.15]))
        self.inset = bool(rng.random() < 0.6)
        self.lap = min(float(rng.uniform(0.6, 1.6)) * unit, 0.5 * post - 0.2 * unit)
        self.knuckles = bool(rng.random() < 0.6) and post - 2 * self.lap > 2 * unit
        self.swing = float(np.deg2rad(rng.uniform(50, 100 if self.inset else 150)))
        self.tilt = float(np.deg2rad(rng.uniform(20, 70)))


def _pane(shape: Shape, lo, hi, look: _Look, rail: float, unit: float) -> None:
    """Rails round a pane of glass with glazing bars, between two corners [3]; or louvres, or a
    board."""
    if look.kind != "glass":
        style = FrontStyle(
            look.kind, "none", look.face, look.face.darker(0.9), look.glass, look.metal, look.face,
            hi[0] - lo[0], 1.0 * unit,
        )  # fmt: skip
        shape.join(panel(lo, hi, style))
        return
    deep = hi[0] - lo[0]
    a, b = lo[1:] + rail, hi[1:] - rail
    if (b - a).min() < 2 * unit:
        rail = 0.25 * (hi - lo)[1:].min()
        a, b = lo[1:] + rail, hi[1:] - rail
    opening = box([lo[0] - 1, *a], [hi[0] + 1, *b])
    solid = box(lo, hi) - opening
    front, back = lo[0] + 0.25 * deep, lo[0] + 0.7 * deep
    bars = []
    for axis, count in enumerate(look.bars):
        for k in range(count):
            middle = a[axis] + (b[axis] - a[axis]) * (k + 1) / (count + 1)
            low, high = a.copy(), b.copy()
            low[axis], high[axis] = middle - look.bar / 2, middle + look.bar / 2
            if (b[axis] - a[axis]) / (count + 1) > 3 * look.bar:
                bars.append(box([front, *low], [back, *high]))
    glass = box([lo[0] + 0.4 * deep, *a], [lo[0] + 0.55 * deep, *b])
    shape.add(union([solid, *bars]) if bars else solid, look.face)
    shape.add(cut(glass, bars), look.glass)


def _fixed_pane(frame: Shape, lo, hi, depth: float, look: _Look, unit: float) -> None:
    _pane(
        frame,
        np.array([0.3 * depth, *lo]),
        np.array([0.8 * depth, *hi]),
        look,
        0.6 * look.rail,
        unit,
    )


def _sash(
    asm: Assembly, root: int, lo, hi, edge: str, look: _Look, unit: float, handle: str
) -> None:
    """A hinged sash over the bay between (y, z) corners; its handle at the free edge."""
    size = (hi - lo).min()
    if look.inset:  # a thick sash needs more air to swing, and a small bay has none
        thick = min(look.thick, 0.4 * size)
        air = 0.25 * unit + thick**2 / size
        lo, hi = np.array([0.0, *(lo + air)]), np.array([thick, *(hi - air)])
    else:
        lap = np.full(2, look.lap)
        lo = np.array([-look.thick - 0.0015, *(lo - lap)])
        hi = np.array([-0.0015, *(hi + lap)])
    axis, way = "xyz".index(edge[1]), 1 if edge[0] == "+" else -1
    at = (lo + hi) / 2
    at[0], at[axis] = lo[0], (hi if way > 0 else lo)[axis]
    shape = Shape()
    _pane(shape, lo, hi, look, look.rail, unit)
    if look.knuckles and not look.inset:
        along = "z" if axis == 1 else "y"
        other = "xyz".index(along)
        tall, r, slab = 5 * unit, min(0.9 * unit, 0.45 * look.thick), box(lo, hi)
        for share in (0.15, 0.85):
            start = at.copy()
            start[other] = lo[other] + share * (hi - lo)[other] - tall / 2
            shape.add(cylinder(along, start, tall, r, segments=12) - slab, look.metal)
    swing = look.swing if axis == 1 else min(look.swing, look.tilt)
    if handle == "knob":
        y, z = _grip(lo, hi, edge, look, unit)
        knob = cylinder("x", [lo[0] - 2.6 * unit, y, z], 1.4 * unit, 1.2 * unit, 1.5 * unit, 14)
        stem = cylinder("x", [lo[0] - 1.3 * unit, y, z], 1.3 * unit, 0.6 * unit, segments=10)
        shape.add(union([knob, stem]), look.metal)
    if handle == "lever":  # its plate
        y, z = _grip(lo, hi, edge, look, unit)
        a, b = (0.9, 2.6) if axis == 1 else (2.6, 0.9)
        plate = box(
            [lo[0] - 0.5 * unit, y - a * unit, z - b * unit], [lo[0], y + a * unit, z + b * unit]
        )
        shape.add(plate, look.metal)
    sash = asm.add("sash", shape, root, hinge(at, hinges.OPENING[edge], swing))
    if handle == "lever":
        _lever(asm, sash, (lo[0] - 0.5 * unit, *_grip(lo, hi, edge, look, unit)), edge, look, unit)
    elif handle == "ring":
        _thumb_turn(asm, sash, (lo[0], *_grip(lo, hi, edge, look, unit)), look, unit)


def _grip(lo, hi, edge: str, look: _Look, unit: float) -> tuple[float, float]:
    """(y, z) of the handle: on the rail opposite the hinges."""
    place = (lo[1:] + hi[1:]) / 2
    axis, way = "yz".index(edge[1]), 1 if edge[0] == "+" else -1
    rail = look.rail / 2 if look.kind == "glass" else 2 * unit
    rail = min(rail, 0.2 * (hi - lo)[1 + axis])
    place[axis] = lo[1 + axis] + rail if way > 0 else hi[1 + axis] - rail
    return float(place[0]), float(place[1])


def _lever(asm: Assembly, sash: int, at, edge: str, look: _Look, unit: float) -> None:
    """A lever along the rail that turns by a quarter, away from the free edge."""
    x, y, z = at
    reach, w, long = 2.2 * unit, 0.75 * unit, 8.5 * unit
    boss = cylinder("x", [x - reach, y, z], reach - 0.0006, 0.85 * unit, segments=12)
    way = 1 if edge[0] == "+" else -1
    if edge[1] == "y":  # hangs, turns towards the hinges
        bar = box([x - reach, y - w, z - long], [x - reach + 1.2 * unit, y + w, z + w])
        joint = hinge(at, (-way, 0, 0), np.pi / 2)
    else:  # lies level, turns up or down towards the hinges
        bar = box([x - reach, y - w, z - w], [x - reach + 1.2 * unit, y + long, z + w])
        joint = hinge(at, (way, 0, 0), np.pi / 2)
    asm.add("handle", Shape().add(union([boss, bar]), look.metal), sash, joint)


def _thumb_turn(asm: Assembly, sash: int, at, look: _Look, unit: float) -> None:
    """A round knob that turns without end."""
    x, y, z = at
    knob = cylinder("x", [x - 2.4 * unit, y, z], 2.4 * unit - 0.0006, 1.2 * unit, 1.6 * unit, 16)
    asm.add("handle", Shape().add(knob, look.metal), sash, turn(at, (1, 0, 0)))

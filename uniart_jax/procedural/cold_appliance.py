"""Refrigerators, coolers and freezers of all makes: thick doors that swing right round, handles and
shelves that are fixed parts of their own, glass doors, rounded retro bodies, chests with lids."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import appliances, finishes, materials, real_finishes
from uniart_jax.procedural.cabinet import room_behind
from uniart_jax.procedural.cold_fronts import Look, add_door, add_front, add_plate
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    extrusion,
    hinge,
    rounded,
    slide,
    tray,
)

# width, height, depth (metres), share
_PLANS = {
    "mini": ((0.4, 0.65), (0.45, 0.95), (0.4, 0.65), 0.2),
    "single": ((0.5, 0.75), (1.2, 2.05), (0.5, 0.75), 0.11),
    "top": ((0.5, 0.8), (1.2, 1.9), (0.5, 0.8), 0.17),
    "bottom": ((0.5, 0.8), (1.5, 2.05), (0.5, 0.75), 0.13),
    "drawers": ((0.5, 0.95), (1.5, 2.0), (0.55, 0.75), 0.06),
    "side": ((0.7, 1.2), (0.8, 2.0), (0.5, 0.75), 0.14),
    "french": ((0.75, 1.05), (1.6, 1.95), (0.6, 0.8), 0.07),
    "cooler": ((0.9, 2.0), (0.85, 2.1), (0.45, 0.75), 0.07),
    "chest": ((0.6, 1.6), (0.75, 0.95), (0.5, 0.75), 0.05),
}


def _finish(rng: np.random.Generator) -> Material:
    """A door's outside: white and steel mostly, grey, black, pastel, wood or marbled."""
    kind = rng.choice(8, p=[0.34, 0.18, 0.09, 0.14, 0.07, 0.08, 0.06, 0.04])
    if kind == 3:
        return materials.plain(np.full(3, rng.uniform(0.35, 0.9)))
    makers = (finishes.white_plastic, real_finishes.banded_steel, finishes.metal, finishes.metal,
              finishes.dark, materials.appliance, real_finishes.strong_wood,
              real_finishes.speckled)  # fmt: skip
    return makers[kind](rng)


def _style(rng: np.random.Generator, plan: str, unit: float) -> Look:
    """The look of one appliance."""
    face = _finish(rng)
    others = (face, materials.plain(face.color), face.darker(float(rng.uniform(0.4, 0.9))),
              finishes.dark(rng), _finish(rng))  # fmt: skip
    panels, shares = ["slab", "border", "raised", "glass", "clear"], [0.7, 0.08, 0.06, 0.1, 0.06]
    if plan == "cooler":
        shares = [0.05, 0.0, 0.0, 0.65, 0.3]
    handles = ["bar", "bow", "block", "strip", "groove", "none"]
    turn = (180 if rng.random() < 0.65 else rng.uniform(90, 175)) if rng.random() < 0.82 else 90
    return Look(
        face=face,
        body=others[rng.choice(5, p=[0.3, 0.25, 0.15, 0.15, 0.15])],
        lining=finishes.white_plastic(rng) if rng.random() < 0.7 else face.darker(0.8),
        glass=real_finishes.tinted_glass(rng) if rng.random() < 0.7 else materials.glass(rng),
        trim=(finishes.dark, finishes.white_plastic, finishes.metal)[rng.integers(3)](rng),
        grip=materials.hardware(rng) if rng.random() < 0.75 else materials.plain(face.color),
        panel=str(rng.choice(panels, p=shares)),
        form=str(rng.choice(["flat", "bulged", "soft"], p=[0.6, 0.18, 0.22])),
        thick=max(float(rng.uniform(0.02, 0.09)), 1.6 * unit),
        unit=unit,
        seam=float(rng.uniform(0.002, 0.006) if rng.random() < 0.6 else rng.uniform(0.006, 0.02)),
        handle=str(rng.choice(handles, p=[0.35, 0.17, 0.17, 0.15, 0.08, 0.08])),
        own=bool(rng.random() < 0.75),
        length=float(rng.uniform(0.12, 0.35) if rng.random() < 0.5 else rng.uniform(0.35, 0.8)),
        wide=max(0.014, float(rng.uniform(1.1, 2.6)) * unit),
        reach=max(0.025, float(rng.uniform(1.8, 6.5)) * unit),
        axis=float(rng.choice([0.0, 1.0, rng.uniform(0.3, 0.6)], p=[0.15, 0.2, 0.65])),
        inset=float(rng.uniform(0.0, 0.97)),
        gap=float(rng.uniform(0.002, 0.012)),
        swing=float(np.deg2rad(turn)),
    )


def _cells(rng: np.random.Generator, plan: str, half: float, low: float, high: float) -> list:
    """Rectangles (y, z) of the front, their hinged edge or 'drawer', and how high handles sit."""
    full, edge = (-half, half), str(rng.choice(["+y", "-y"]))
    tall = high - low
    mid = float(rng.choice([0.5, rng.uniform(0.3, 0.7)]))
    if plan in ("mini", "single"):
        return [(full, (low, high), edge, float(rng.choice([mid, rng.uniform(0.7, 0.95)])))]
    if plan in ("top", "bottom"):
        share = rng.uniform(0.58, 0.76) if plan == "top" else rng.uniform(0.28, 0.5)
        at = low + tall * float(share)
        return [(full, (low, at), edge, 1.0), (full, (at, high), edge, 0.0)]
    if plan == "drawers":
        count = int(rng.integers(1, 4))
        at = low + tall * float(rng.uniform(0.3, 0.5))
        rows = itertools.pairwise(np.linspace(low, at, count + 1))
        cells = [(full, (float(a), float(b)), "drawer", 0.5) for a, b in rows]
        return [*cells, (full, (at, high), edge, mid)]
    if plan == "side":
        y = float(rng.choice([0.0, rng.uniform(-0.3, 0.3)])) * half
        columns = [((y, half), "+y"), ((-half, y), "-y")]
        if rng.random() < 0.2:
            at = low + tall * float(rng.uniform(0.3, 0.55))
            return [
                (c, z, e, h) for c, e in columns for z, h in (((low, at), 1.0), ((at, high), 0.0))
            ]
        return [(c, (low, high), e, mid) for c, e in columns]
    if plan == "french":
        count = int(rng.integers(1, 3))
        at = low + tall * float(rng.uniform(0.3, 0.45))
        rows = itertools.pairwise(np.linspace(low, at, count + 1))
        cells = [(full, (float(a), float(b)), "drawer", 0.5) for a, b in rows]
        return [*cells, ((0.0, half), (at, high), "+y", mid), ((-half, 0.0), (at, high), "-y", mid)]
    count = int(rng.integers(2, 5))  # a cooler
    borders = np.linspace(half, -half, count + 1)
    edges = [edge] * count
    if rng.random() < 0.4:
        edges = ["+y" if k % 2 == 0 else "-y" for k in range(count)]
    pairs = itertools.pairwise(float(b) for b in borders)
    return [((b, a), (low, high), e, mid) for (a, b), e in zip(pairs, edges, strict=True)]


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A refrigerator, cooler or freezer, metres, closed."""
    names = list(_PLANS)
    plan = names[rng.choice(len(names), p=[p[-1] for p in _PLANS.values()])]
    width, height, depth = (float(rng.uniform(*r)) for r in _PLANS[plan][:3])
    unit = max(width, height, depth) / 100
    look = _style(rng, plan, unit)
    if plan == "chest":
        return _chest(rng, width, height, depth, look)
    half, wall = width / 2, max(float(rng.uniform(0.03, 0.055)), 1.8 * unit)
    legs = float(rng.uniform(0.008, 0.05) if rng.random() < 0.75 else rng.uniform(0.05, 0.13))
    crown = float(rng.uniform(0.04, 0.16)) * height if rng.random() < 0.22 else 0.0
    grille = float(rng.uniform(0.05, 0.14)) * height if rng.random() < 0.2 else 0.0
    low, high, stand = legs + grille, height - crown, 0.92 * width
    if rng.random() < 0.16 and plan not in ("cooler", "french"):
        radius = float(rng.uniform(0.06, 0.22)) * width
        stand = min(stand, width - 2 * radius)  # on what is flat between rounded corners
        ring = rounded(width, height - legs, radius, 7) + [0, (height + legs) / 2]
        look = dataclasses.replace(look, outline=extrusion(ring, "x", [-1, 0, 0], 3.0))
        if look.handle == "strip":  # it would stand out of the rounded corners
            look = dataclasses.replace(look, handle="block")
    cells = _cells(rng, plan, half, low, high)
    asm, body, shelves = Assembly(), Shape(), []
    bays, holes = [], []
    for y, z, edge, _ in cells:
        lo, hi = room_behind(y, z, (-half, half), (low, high), (0.0, depth - wall), wall)
        bays.append((lo, hi))
        holes.append(box([0.001, *lo[1:]], hi))
        if edge != "drawer":
            shelves += _shelves(rng, lo, hi, depth, unit)
    mouth = [box([-1, *(lo[1:])], [1, *hi[1:]]) for lo, hi in bays]
    shell, lining = box([0.006, -half, legs], [depth, half, height]), box(
        [0.0, -half, legs], [0.006, half, height]
    )  # fmt: skip
    if look.outline is not None:
        shell, lining = shell ^ look.outline, lining ^ look.outline
    body.add(cut(shell, holes), look.body)
    body.add(cut(lining, mouth), look.trim if rng.random() < 0.6 else look.body)
    appliances.feet(body, rng, stand, depth, legs, unit)
    front = -look.thick - look.gap
    _decorate(rng, body, half, (legs, low), (high, height), front, look)
    own_shelves = rng.random() < 0.18 and len(shelves) <= 5
    pane = (look.glass, look.lining, look.trim)[rng.integers(3)]
    if not own_shelves:
        for solid, _ in shelves:
            body.add(solid, pane)
    goods = look.panel == "clear" or rng.random() < 0.1
    if goods:
        _goods(rng, body, shelves, bays, cells)
    root = asm.add("body", body)
    bins = look.panel not in ("clear", "glass") and rng.random() < 0.4
    drawer = {"travel": float(rng.uniform(0.5, 0.9)), "wall": max(0.012, 1.5 * unit)}
    for (y, z, edge, at), (bay_lo, bay_hi) in zip(cells, bays, strict=True):
        lo = np.array([front, y[0] + look.seam / 2, z[0] + look.seam / 2])
        hi = np.array([-look.gap, y[1] - look.seam / 2, z[1] - look.seam / 2])
        if edge == "drawer":
            a, b = bay_lo + [hi[0], 0.004, 0.004], bay_hi - [0.02, 0.004, 0.004]
            b[2] = a[2] + 0.8 * (b[2] - a[2])
            basket = Shape().add(tray(a, b, drawer["wall"], open_front=True), look.lining)
            joint = slide((-1, 0, 0), drawer["travel"] * (b[0] - a[0]))
            add_front(asm, root, lo, hi, "+z", joint, look, "drawer", 0.5, basket)
            continue
        outer = y[1] > half - 1e-6 if edge == "+y" else y[0] < 1e-6 - half
        extra = None
        if bins:
            reach, deep = float(rng.uniform(0.06, 0.12)), max(0.07, 5 * unit)
            sizes, places = (reach, max(0.012, 1.3 * unit), deep), (lo, hi, bay_lo, bay_hi)
            extra = appliances.bins_behind(places, sizes, unit, look.lining)
        beyond = look.seam / 2 if outer else 1.0
        part = add_door(asm, root, lo, hi, edge, look, beyond, at, extra)
        if len(cells) < 4 and rng.random() < 0.12:
            add_plate(rng, asm, part, lo, hi, look)
    if own_shelves:
        for solid, label in shelves:
            asm.add(label, Shape().add(solid, pane), root, Joint.fixed(), label)
    elif not goods and rng.random() < 0.08:
        _crisper(asm, root, bays[-1], look)
    return asm.object()


def _shelves(rng, lo, hi, depth: float, unit: float) -> list[tuple[Manifold, str]]:
    """Shelves across a room, behind what its door carries."""
    count = int(np.clip((hi[2] - lo[2]) / rng.uniform(0.2, 0.4), 0, 5))
    thick, front = max(0.01, 1.5 * unit), depth * float(rng.uniform(0.25, 0.4))
    out = []
    for z in np.linspace(lo[2], hi[2], count + 2)[1:-1]:
        a, b = [front, lo[1] + 5e-4, z - thick / 2], [hi[0] - 5e-4, hi[1] - 5e-4, z + thick / 2]
        out.append((box(a, b), "shelf"))
    return out


def _goods(rng, body: Shape, shelves, bays, cells) -> None:
    """Bottles and boxes on the floors of the rooms and on shelves."""
    tops = [np.array(s.bounding_box()) for s, _ in shelves]
    places = [(t[0], t[1], t[4], t[5]) for t in tops]
    places += [(0.15, lo[1], hi[1], lo[2]) for (lo, hi), c in zip(bays, cells, strict=True)
               if c[2] != "drawer"]  # fmt: skip
    colors = [materials.plain(rng.uniform(0.05, 0.95, 3)) for _ in range(4)]
    for x, a, b, z in places[:8]:
        count = int(np.clip((b - a) / 0.1, 1, 6))
        for y in np.linspace(a, b, count + 2)[1:-1]:
            r, tall = min(0.035, 0.3 * (b - a) / count), float(rng.uniform(0.06, 0.14))
            can = cylinder(
                "z", [x + 0.05, y, z + 4e-4], tall, r, float(rng.uniform(0.4, 1)) * r, 10
            )
            body.add(can, colors[rng.integers(4)])


def _decorate(rng, body: Shape, half: float, foot, head, front: float, look: Look) -> None:
    """A grille below and a panel above the doors, with what looks like knobs and buttons on it."""
    if foot[1] - foot[0] > 0.03:
        x = float(rng.uniform(0.0, 0.9)) * front
        solid = box([x - 0.004, -half, foot[0]], [0, half, foot[1]])
        body.add(solid if look.outline is None else solid ^ look.outline, look.body)
        count = int(rng.integers(2, 6))
        edges = np.linspace(foot[0], foot[1], count + 1)
        dark, side = finishes.dark(rng), half * float(rng.uniform(0.4, 0.9))
        for a, b in itertools.pairwise(edges):
            lo = [x - 0.007, -side, a + 0.3 * (b - a)]
            slot = box(lo, [x - 0.004, side, b - 0.2 * (b - a)])
            body.add(slot if look.outline is None else slot ^ look.outline, dark)
    if head[1] - head[0] > 0.03:
        x = float(rng.choice([0.0, front, 0.6 * front]))
        solid = box([x - 0.004, -half, head[0] + 0.003], [0, half, head[1]])
        if look.outline is not None:
            solid = solid ^ look.outline
        body.add(solid, look.face if rng.random() < 0.5 else look.body)
        middle, size = (head[0] + head[1]) / 2, 0.3 * (head[1] - head[0])
        tint = (finishes.dark(rng), look.trim, materials.plain(rng.uniform(0.1, 0.9, 3)))
        for y in rng.uniform(-0.75, 0.75, int(rng.integers(0, 5))) * half:
            flat = 0.004 + float(rng.uniform(0.001, 0.02))
            at, r = [x - flat, float(y), middle], size * float(rng.uniform(0.4, 1))
            body.add(cylinder("x", at, flat - 0.004, r, segments=14), tint[rng.integers(3)])


def _crisper(asm: Assembly, root: int, bay, look: Look) -> None:
    """A drawer on the floor of a room, behind its door."""
    lo, hi = bay
    wall, tall = max(0.012, 1.4 * look.unit), max(0.12, 8 * look.unit)
    if hi[2] - lo[2] < 5 * tall:
        return
    a = [0.15, lo[1] + 0.006, lo[2] + 0.004]
    b = [hi[0] - 0.01, hi[1] - 0.006, lo[2] + 0.6 * tall]
    joint = slide((-1, 0, 0), 0.7 * (b[0] - a[0]))
    asm.add("crisper", Shape().add(tray(a, b, wall), look.lining), root, joint, "drawer")


def _chest(rng, width: float, height: float, depth: float, look: Look) -> ArticulatedObject:
    """A chest with one or two lids that turn about their rear edge, or panes that slide."""
    half, wall, legs = width / 2, max(0.05, 2.5 * look.unit), float(rng.uniform(0.02, 0.06))
    thick = max(look.thick, 2 * look.unit)
    asm, body = Assembly(), Shape()
    top = height - thick
    room = box([wall, wall - half, legs + wall], [depth - wall, half - wall, top + 1])
    body.add(cut(box([0, -half, legs], [depth, half, top]), [room]), look.body)
    appliances.feet(body, rng, width * 0.94, depth, legs, look.unit)
    if rng.random() < 0.5:
        dark, y = finishes.dark(rng), half * float(rng.uniform(0.2, 0.8))
        z = legs + 0.15 * height
        for k in range(4):
            lo = [-0.003, y - 0.15 * half, z + 0.03 * k]
            body.add(box(lo, [0, y + 0.15 * half, z + 0.03 * k + 0.012]), dark)
    sliding = rng.random() < 0.3
    if sliding:
        slim, rim = max(0.014, 1.3 * look.unit), wall * 0.6
        high = top + 2 * slim + 0.008
        frame = box([0, -half, top], [depth, half, high + 0.004])
        hole = box([rim, rim - half, top - 1], [depth - rim, half - rim, high + 1])
        body.add(cut(frame, [hole]), look.trim)
        root = asm.add("body", body)
        a, b = rim + 0.002, depth - rim - 0.002
        for k, (left, right) in enumerate(
            ((-half + rim + 0.002, 0.03), (-0.03, half - rim - 0.002))
        ):
            z = top + 0.002 + k * (slim + 0.003)
            shape = Shape().add(box([a, left, z], [b, right, z + slim]), look.glass)
            y = right - 0.04 if k == 0 else left + 0.02
            grip = box(
                [a + 0.3 * depth, y, z + slim],
                [b - 0.3 * depth, y + 0.02, z + slim + 0.002 + 1e-3 * k],
            )
            shape.add(grip, look.grip)
            travel = (2 * half - 2 * rim) - (right - left) - 0.006
            asm.add("lid", shape, root, slide((0, 1 - 2 * k, 0), travel))
        return asm.object()
    root = asm.add("body", body)
    count = 2 if width > 1.1 and rng.random() < 0.5 else 1
    angle = float(np.deg2rad(rng.choice([70.0, 90.0, rng.uniform(60, 100)])))
    for left, right in itertools.pairwise(np.linspace(-half, half, count + 1)):
        lo = np.array([-0.01 * (rng.random() < 0.5), left + 0.002, top + 0.002])
        hi = np.array([depth, right - 0.002, height])
        lid = box(lo, hi)
        reach = max(0.02, 1.6 * look.unit)
        y, wide = (left + right) / 2, (right - left) * float(rng.uniform(0.1, 0.45))
        grip = box(
            [lo[0] - reach, y - wide / 2, lo[2] + 0.2 * thick],
            [lo[0], y + wide / 2, hi[2] - 0.2 * thick],
        )
        shape = Shape().add(lid, look.face)
        if rng.random() < 0.5 and not look.own:
            shape.add(grip, look.grip)
        joint = hinge((depth, 0, top + 0.002), (0, 1, 0), angle)
        part = asm.add("lid", shape, root, joint)
        if look.own:
            asm.add("lid_handle", Shape().add(grip, look.grip), part, label="handle")
    return asm.object()

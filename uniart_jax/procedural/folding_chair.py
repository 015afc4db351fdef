"""Furniture that folds: chairs, loungers, theatre seats, stools and trays on crossed legs, ironing
boards, folding tables, step ladders, drying racks."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    extrusion,
    hinge,
    hull,
    pipe,
    rounded,
    tidy,
    turn,
    union,
)

AIR = 0.004


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A piece of folding furniture, metres, as it stands in use; turned about z on some."""
    kinds = (_chair, _crossed, _table, _ladder, _rack, _lounger, _theatre)
    make = kinds[rng.choice(len(kinds), p=[0.27, 0.2, 0.16, 0.12, 0.08, 0.08, 0.09])]
    free = 0.2 if make in (_chair, _theatre) else 0.6
    yaw = float(rng.choice([0, 90, 180, rng.uniform(-180, 180)])) if rng.random() < free else 0.0
    c, s = np.cos(np.deg2rad(yaw)), np.sin(np.deg2rad(yaw))
    turned, asm = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]]), Assembly()
    for name, shape, parent, joint in make(rng):
        if joint is not None:
            at, axis = turned[:3, :3] @ joint.origin, turned[:3, :3] @ joint.direction
            joint = dataclasses.replace(joint, origin=at, direction=axis)
        asm.add(name, shape.moved(turned), parent, joint)
    return asm.object()


def _finish(rng: np.random.Generator) -> tuple[Material, bool]:
    """Of a frame, and whether its bars are square: wood, bare or enamelled metal, plastic."""
    if rng.random() < 0.4:
        return materials.wood(rng), True
    kind = rng.integers(4)
    bright = plain(materials.hsv(rng, (0, 1), (0.4, 0.95), (0.35, 0.95)))
    tones = (materials.metal(rng, brushed=False), materials.dark(rng), materials.paint(rng), bright)
    return tones[kind], bool(rng.random() < 0.3)


def _cover(rng: np.random.Generator, frame: Material) -> Material:
    """Of a seat or a top: as the frame, wood, cloth or plastic of any colour."""
    kind = rng.choice(4, p=[0.2, 0.25, 0.4, 0.15])
    if kind == 2:
        return plain(materials.hsv(rng, (0, 1), (0.2, 0.9), (0.25, 0.95)))
    return (frame, materials.wood(rng, grain="y"), None, materials.white_plastic(rng))[kind]


def _bar(points, y: float, r: float, square: bool) -> Manifold:
    """A bar along points (x, z) in the plane y, round or square."""
    points = np.asarray(points, dtype=np.float64)
    if not square:
        return pipe(np.column_stack([points[:, 0], np.full(len(points), y), points[:, 1]]), r, 10)
    solids = []
    for a, b in itertools.pairwise(points):
        way = (b - a) / np.linalg.norm(b - a)
        side = np.array([-way[1], way[0]]) * r
        ends = [p + q for p in (a - 0.5 * r * way, b + 0.5 * r * way) for q in (side, -side)]
        solids.append(hull(np.array([[x, y + d, z] for x, z in ends for d in (-r, r)])))
    return union(solids)


def _rung(at, half: float, r: float, square: bool) -> Manifold:
    """A bar across, through (x, z); a little off it, so that no two vertices of a joint meet."""
    x, z = np.asarray(at) + [0.017 * r, 0.031 * r]
    half -= 0.4 * r
    if square:
        return box([x - r, -half, z - r], [x + r, half, z + r])
    return cylinder("y", [x, -half, z], 2 * half, r, segments=11)


def _frame(points, half: float, r: float, square: bool, rungs=()) -> Manifold:
    """Two bars at y = +-``half`` and rungs between them through points (x, z)."""
    bars = [_bar(points, s * half, r, square) for s in (-1, 1)]
    return union(bars + [_rung(p, half, 0.75 * r, square) for p in rungs])


def _panel(rng, x0, x1, half, low, thick, across: bool | None = None) -> Manifold:
    """A flat slab, plain, rounded or of slats, that lies between two x."""
    deep = x1 - x0
    slats = rng.random() < 0.35 if across is None else across
    if slats:
        count = max(3, int(deep / float(rng.uniform(0.055, 0.1))))
        step = deep / count
        wide = step * float(rng.uniform(0.6, 0.85))
        solids = [
            box([x0 + k * step, -half, low], [x0 + k * step + wide, half, low + thick])
            for k in range(count)
        ]
        for y in (-0.75 * half, 0.75 * half - 0.03):
            solids.append(box([x0, y, low], [x1 - step + wide, y + 0.03, low + 0.6 * thick]))
        return union(solids)
    corner = float(rng.choice([0.004, rng.uniform(0.02, 0.3) * min(deep, 2 * half)]))
    return extrusion(rounded(deep, 2 * half, corner), "z", [(x0 + x1) / 2, 0, low], thick)


def _angle(a, b) -> float:
    """Between two directions (x, z)."""
    a, b = np.asarray(a), np.asarray(b)
    return float(np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1, 1)))


def _shape(*pieces: tuple[Manifold, Material]) -> Shape:
    """Solids, one a material, each without those of the materials before it."""
    groups: dict[Material, list[Manifold]] = {}
    for solid, material in pieces:
        groups.setdefault(material, []).append(solid)
    shape, done = Shape(), []
    for material, solids in groups.items():
        solid = tidy(cut(union(solids), done), 1e-4)
        shape.add(solid, material)
        done.append(solid)
    return shape


def _chair(rng: np.random.Generator) -> list[tuple]:
    """Front legs and back in one frame, rear legs about a bolt, a seat that tips up."""
    tone, square = _finish(rng)
    cover = _cover(rng, tone)
    tall = float(rng.choice([1.0, rng.uniform(1.3, 1.6)], p=[0.85, 0.15]))  # bar chairs
    seat, r = float(rng.uniform(0.4, 0.48)) * tall, float(rng.uniform(0.012, 0.021))
    half, back = float(rng.uniform(0.18, 0.26)), float(rng.uniform(0.32, 0.5))
    lean, slope = (
        np.tan(np.deg2rad(rng.uniform(17, 28) / tall)),
        np.tan(np.deg2rad(rng.uniform(5, 20))),
    )
    knee = np.array([seat * lean, seat + 0.03])
    top = knee + [back * slope, back]
    foot = np.array([0.0, r])
    rung = foot + float(rng.uniform(0.25, 0.5)) * (knee - foot)
    frame = _frame([foot, knee, top], half, r, square, [rung])
    low = float(rng.uniform(0.3, 0.7)) * back
    pad = float(rng.uniform(0.012, 0.04))
    kind = rng.choice(["panel", "slats", "sticks"], p=[0.55, 0.25, 0.2])
    spans = (
        [(low, back)] if kind == "panel" else [(b, b + 0.05) for b in np.arange(low, back, 0.09)]
    )
    if kind == "sticks":
        spans = [(low, low + 0.05), (back - 0.05, back)]
    rests = []
    for a, b in spans:
        ends = [knee + [slope * z, z] for z in (a, min(b, back))]
        corners = [
            [p[0] + d, y, p[1]] for p in ends for d in (-pad / 2, pad / 2) for y in (-half, half)
        ]
        rests.append(hull(np.array(corners)))
    if kind == "sticks":
        for y in np.linspace(-0.7, 0.7, int(rng.integers(3, 7))) * half:
            ends = [knee + [slope * z, z] for z in (low + 0.02, back - 0.02)]
            rests.append(_bar(ends, y, 0.4 * r, True))
    main = _shape((frame, tone), (union(rests), cover if kind == "panel" else tone))
    parts = [("frame", main, -1, None)]
    share = float(rng.uniform(0.75, 0.93))
    bolt = foot + share * (knee - foot)
    heel = np.array([bolt[0] + bolt[1] * float(rng.uniform(0.35, 0.6)), r])
    outer = half + 2 * r + AIR
    reach = float(rng.uniform(0.5, 0.85))
    legs = _frame([bolt, heel], outer, r, square, [bolt + reach * (heel - bolt)])
    caps = [
        cylinder("y", [bolt[0], s * outer - 1.5 * r, bolt[1]], 3 * r, 0.8 * r, segments=12)
        for s in (-1, 1)
    ]
    legs_tone = tone if rng.random() < 0.8 else materials.paint(rng)
    most = _angle(heel - bolt, foot - bolt)
    most -= np.arcsin(min(0.9, 3 * r / (reach * np.linalg.norm(heel - bolt)))) + 0.03
    joint = hinge((bolt[0], 0, bolt[1]), (0, 1, 0), max(most, 0.3))
    inside = [box([-9, -half - r - AIR / 2, -9], [9, half + r + AIR / 2, bolt[1] + 2 * r])]
    caps = [cut(c, inside) for c in caps]
    parts.append(
        ("legs", _shape((legs, legs_tone), (union(caps), materials.hardware(rng))), 0, joint)
    )
    thick, deep = float(rng.uniform(0.018, 0.05)), float(rng.uniform(0.34, 0.44))
    behind = float(rng.uniform(0.1, 0.28)) * deep
    axis = np.array([seat * lean, seat])
    inner = half - r - AIR
    slab = _panel(rng, axis[0] + behind - deep, axis[0] + behind, inner, seat - thick / 2, thick)
    pin = cylinder("y", [axis[0], -inner, axis[1]], 2 * inner, 0.4 * thick, segments=10)
    up = float(np.deg2rad(rng.uniform(60, 80)))
    shape = _shape((slab + pin, cover))
    parts.append(("seat", shape, 0, hinge((axis[0], 0, axis[1]), (0, 1, 0), up)))
    return parts


def _crossed(rng: np.random.Generator) -> list[tuple]:
    """Two frames that cross at a bolt and a top hinged to one of them: trays, stools, ironing
    boards."""
    kind = rng.choice(["tray", "stool", "board"], p=[0.4, 0.25, 0.35])
    tone, square = _finish(rng)
    cover = _cover(rng, tone)
    if kind == "board":
        high, spread, half = rng.uniform(0.7, 0.95), rng.uniform(0.32, 0.5), rng.uniform(0.1, 0.19)
        r, long, wide = rng.uniform(0.011, 0.018), rng.uniform(1.1, 1.45), rng.uniform(0.3, 0.44)
    elif kind == "tray":
        high, spread, half = rng.uniform(0.5, 0.8), rng.uniform(0.17, 0.3), rng.uniform(0.17, 0.32)
        r, long, wide = rng.uniform(0.009, 0.016), 0, 2 * half * rng.uniform(1.0, 1.35)
    else:
        high, spread, half = (
            rng.uniform(0.34, 0.5),
            rng.uniform(0.15, 0.24),
            rng.uniform(0.15, 0.26),
        )
        r, long, wide = rng.uniform(0.011, 0.02), 0, 2 * half * rng.uniform(1.0, 1.2)
    inner = half - 2 * r - AIR
    middle = np.array([0.0, high / 2])
    way = np.array([spread, -high / 2 + r])  # to the foot of the first frame
    d1, d2 = float(rng.uniform(0.7, 0.95)), float(rng.uniform(0.6, 0.9))
    first = _frame(
        [middle - way, middle + way], half, r, square, [middle + d1 * way, middle - d1 * way]
    )
    bolts = [
        cylinder("y", [0, s * half - 1.4 * r, high / 2], 2.8 * r, 0.7 * r, segments=12)
        for s in (-1, 1)
    ]
    bolts = [b - box([-9, -half + r, -9], [9, half - r, 9]) for b in bolts]
    parts = [("frame", _shape((first, tone), (union(bolts), materials.hardware(rng))), -1, None)]
    other = way * [-1, 1]
    second = _frame(
        [middle - other, middle + other],
        inner,
        r,
        square,
        [middle + d2 * other, middle - d2 * other],
    )
    down = kind == "board" or rng.random() < 0.3
    most = _angle(-other, way) if down else _angle(-other, -way)
    most -= np.arcsin(min(0.9, 2.6 * r / (d1 * np.linalg.norm(way)))) + 0.05
    sign = 1 if down else -1
    legs = tone if rng.random() < 0.8 else materials.paint(rng)
    parts.append(("legs", _shape((second, legs)), 0, hinge((0, 0, high / 2), (0, sign, 0), most)))
    z, thick = high + 0.6 * AIR, float(rng.uniform(0.014, 0.04))
    z = z + 0.5 * r if square else z  # square bars end a little beyond
    if kind == "board":
        x0 = -spread - float(rng.uniform(0.12, 0.3))
        angle = np.linspace(-np.pi / 2, np.pi / 2, 13)
        nose = float(rng.uniform(0.5, 0.9)) * long
        bulge = np.abs(np.sin(angle)) ** float(rng.uniform(0.9, 1.6)) * np.sign(angle)
        tip = np.column_stack([long - nose + nose * np.cos(angle), wide / 2 * bulge])
        plan = np.vstack(
            [tip, [[0.02, wide / 2], [0, wide / 2.4], [0, -wide / 2.4], [0.02, -wide / 2]]]
        )
        pieces = [(extrusion(plan + [x0, 0], "z", [0, 0, z], thick), cover)]
        if rng.random() < 0.5:  # a rest for the iron
            deep = float(rng.uniform(0.15, 0.28))
            rest = union(
                [
                    box([x0 - deep, y, z], [x0 + 0.05, y + 0.012, z + 0.012])
                    for y in np.linspace(-0.4, 0.4, 5) * wide
                ]
                + [box([x0 - deep, -0.45 * wide, z], [x0 - deep + 0.012, 0.45 * wide, z + 0.012])]
            )
            pieces.append((rest, materials.metal(rng, brushed=False)))
        joint = hinge((-spread, 0, z), (0, 1, 0), 0.8 * _angle((1, 0), way))
    else:
        far = spread + float(rng.uniform(0.01, 0.06))
        x0 = -spread if not down else -far
        slab = _panel(rng, x0, far, wide / 2, z, thick)
        pieces = [(slab, cover)]
        if kind == "tray" and rng.random() < 0.4:
            rim = box([x0, -wide / 2, z + thick], [far, wide / 2, z + thick + 0.03])
            rim -= box([x0 + 0.012, -wide / 2 + 0.012, z], [far - 0.012, wide / 2 - 0.012, z + 1])
            pieces = [
                (
                    _panel(rng, x0, far, wide / 2, z, thick, False) ^ box([x0, -1, 0], [far, 1, 9]),
                    cover,
                ),
                (rim, tone),
            ]
        angle = 0.8 * _angle((1, 0), way) if down else float(np.deg2rad(rng.uniform(75, 92)))
        joint = hinge((-spread, 0, z), (0, sign, 0), angle)
    parts.append(("top", _shape(*pieces), 0, joint))
    return parts


def _table(rng: np.random.Generator) -> list[tuple]:
    """A long top, a pair of legs at each end that folds under it, leaves that hang at its edges;
    benches too."""
    bench = rng.random() < 0.25
    tone, square = _finish(rng)
    cover = _cover(rng, tone)
    high = float(rng.uniform(0.38, 0.48) if bench else rng.uniform(0.55, 0.76))
    long = float(rng.uniform(0.8, 1.7))
    deep = float(rng.uniform(0.25, 0.36) if bench else rng.uniform(0.4, 0.8))
    thick, r = float(rng.uniform(0.02, 0.045)), float(rng.uniform(0.012, 0.024))
    low, edge = high - thick, float(rng.uniform(0.06, 0.16)) * long / 2
    plan = rounded(deep, long, float(rng.choice([0.004, rng.uniform(0.02, 0.1)])))
    top = extrusion(plan, "z", [0, 0, low], thick)
    leaves = 0 if bench else int(rng.choice([0, 1, 2], p=[0.55, 0.15, 0.3]))
    if leaves:
        top = box([-deep / 2, -long / 2, low], [deep / 2, long / 2, high])
    inset = deep / 2 - float(rng.uniform(0.06, 0.22)) * deep
    inset = min(inset, deep / 2 - 3 * r - 3 * AIR)
    need = 2 * (low - r) > long - 2 * edge
    blocks, legs = [], []
    for k, s in enumerate((-1, 1)):
        y = s * (long / 2 - edge)
        drop = r + AIR + (2.6 * r if need and k else 0.0)
        half = inset - (2.6 * r if k and need else 0.0)
        z = low - drop
        posts = [
            pipe([[x, y, z], [x, y, r]], r, 10)
            if not square
            else box([x - r, y - r, 0], [x + r, y + r, z + r])
            for x in (-half, half)
        ]
        rungs = [float(rng.uniform(0.15, 0.6)) * z, z] if rng.random() < 0.7 else [r, z]
        bars = [
            box([-half, y - 0.7 * r, q - 0.7 * r], [half, y + 0.7 * r, q + 0.7 * r]) for q in rungs
        ]
        legs.append((union(posts + bars), hinge((0, y, z), (-s, 0, 0), np.pi / 2 * 0.97)))
        for x in (-half - 2 * r - AIR, half + r + AIR):  # lugs beside the posts
            blocks.append(box([x, y - r, z - r], [x + r, y + r, low]))
    parts = [("top", _shape((top, cover), (union(blocks), materials.hardware(rng))), -1, None)]
    parts += [("legs", _shape((solid, tone)), 0, joint) for solid, joint in legs]
    wide = float(rng.uniform(0.3, 0.8)) * deep
    wide = min(wide, 0.75 * high)
    for s in (-1, 1)[:leaves]:
        x = s * (deep / 2 + AIR)
        ends = sorted((x, x + s * thick))
        leaf = box([ends[0], -long / 2, low - wide], [ends[1], long / 2, low])
        parts.append(("leaf", _shape((leaf, cover)), 0, hinge((x, 0, low), (0, -s, 0), np.pi / 2)))
    return parts


def _ladder(rng: np.random.Generator) -> list[tuple]:
    """A step ladder: treads in a frame, a rear frame about the top, a platform that tips up."""
    tone, square = _finish(rng)
    high = float(rng.uniform(0.45, 1.7))
    r, half = float(rng.uniform(0.013, 0.024)), float(rng.uniform(0.17, 0.27))
    count = max(2, round(high / float(rng.uniform(0.22, 0.3))))
    lean = np.tan(np.deg2rad(rng.uniform(12, 22)))
    rise = high + float(rng.choice([0.0, rng.uniform(0.25, 0.55)], p=[0.5, 0.5]))
    foot, top = np.array([0.0, r]), np.array([rise * lean, rise])
    rails = _frame([foot, top], half, r, square, [top] if rise > high else [])
    tread, thick = float(rng.uniform(0.07, 0.14)), float(rng.uniform(0.018, 0.035))
    steps = []
    for k in range(1, count):
        z = high * k / count
        x = z * lean
        steps.append(box([x - 0.65 * tread, -half, z], [x + 0.35 * tread, half, z + thick]))
    cover = _cover(rng, tone)
    parts = [("frame", _shape((rails, tone), (union(steps), cover)), -1, None)]
    side = np.array([np.cos(np.arctan(lean)), -np.sin(np.arctan(lean))])
    bolt = np.array([high * lean, high - 2.5 * r]) + side * (2.1 * r + AIR)
    heel = np.array([bolt[0] + bolt[1] * float(rng.uniform(0.25, 0.5)), r])
    rungs = [
        bolt + q * (heel - bolt)
        for q in (np.array([0.35, 0.85]) if high < 0.9 else np.array([0.25, 0.55, 0.9]))
    ]
    rear = _frame([bolt, heel], half, r, square, rungs)
    rear_tone = tone if rng.random() < 0.7 else materials.paint(rng)
    most = 0.72 * (_angle(heel - bolt, foot - top))
    joint = hinge((bolt[0], 0, bolt[1]), (0, 1, 0), most)
    parts.append(("legs", _shape((rear, rear_tone)), 0, joint))
    inner = half - r - AIR if rise > high else half + r
    deep = float(rng.uniform(0.2, 0.32))
    x = high * lean + (0 if rise > high else -0.03)
    z = high + (1.5 * r + AIR if rise <= high else AIR)
    plate = _panel(rng, x - 0.25 * deep, x + 0.75 * deep, inner, z, thick, False)
    at = x if rise > high else x - 0.25 * deep
    up = float(np.deg2rad(rng.uniform(60, 88)))
    if rise > high:  # it turns in the rails, its rear up
        plate = _panel(rng, x - 0.05, x + 0.75 * deep, inner, z, thick, False)
        up = float(np.deg2rad(rng.uniform(55, 68)))
    parts.append(("platform", _shape((plate, cover)), 0, hinge((at, 0, z), (0, -1, 0), up)))
    return parts


def _rack(rng: np.random.Generator) -> list[tuple]:
    """A drying rack: rods in a frame on crossed legs and two wings that swing up."""
    tone, _ = _finish(rng)
    rods = tone if rng.random() < 0.5 else materials.white_plastic(rng)
    high, deep = float(rng.uniform(0.75, 1.05)), float(rng.uniform(0.45, 0.7))
    half, r = float(rng.uniform(0.24, 0.36)), float(rng.uniform(0.009, 0.015))
    x = deep / 2
    top = _frame([[-x, high], [x, high]], half, r, False, [[-x, high], [x, high]])
    legs = [
        _frame(
            [[s * 0.8 * x, r], [-s * 0.8 * x, high]],
            half - (2 * r if s > 0 else 0),
            r,
            False,
            [[s * 0.7 * x, 0.1]],
        )
        for s in (-1, 1)
    ]
    body = union([top, *legs])
    lines = [
        cylinder("y", [q, -half, high], 2 * half, 0.55 * r, segments=9)
        for q in np.linspace(-x, x, int(rng.integers(5, 9)))[1:-1]
    ]
    parts = [("stand", _shape((body, tone), (union(lines), rods)), -1, None)]
    long, count = float(rng.uniform(0.4, 0.7)) * high, int(rng.integers(3, 6))
    wide = half * float(rng.uniform(0.7, 1.0))
    swing = float(np.deg2rad(rng.uniform(85, 125)))
    for s in (-1, 1):
        at = s * (x + 2 * r + AIR)
        levels = high - long * np.linspace(0, 1, count + 1)
        wing = _frame(
            [[at, high], [at, high - long]], wide, r, False, [[at, high], [at, levels[-1]]]
        )
        lines = [
            cylinder("y", [at, -wide, z], 2 * wide, 0.55 * r, segments=9) for z in levels[1:-1]
        ]
        joint = hinge((at, 0, high), (0, -s, 0), swing)
        parts.append(("wing", _shape((wing, tone), (union(lines), rods)), 0, joint))
    return parts


def _lounger(rng: np.random.Generator) -> list[tuple]:
    """A long chair: a back that rises from flat, a knee part, wheels under the head."""
    tone, square = _finish(rng)
    cover = _cover(rng, tone)
    long, half = float(rng.uniform(1.6, 2.0)), float(rng.uniform(0.27, 0.36))
    high, r = float(rng.uniform(0.26, 0.42)), float(rng.uniform(0.014, 0.026))
    rails = _frame([[0, high], [long, high]], half, r, square, [[0.02, high], [long - 0.02, high]])
    wheels = rng.random() < 0.4
    feet = [0.12 * long] if wheels else [0.12 * long, 0.88 * long]
    legs = [_frame([[x, r], [x, high]], half, r, square, [[x, 0.4 * high]]) for x in feet]
    radius = 0.5 * high if wheels else 0.0
    hub = np.array([0.86 * long, radius])
    if wheels:
        legs.append(_frame([[hub[0], radius], [hub[0], high]], half, r, square, [hub]))
    low, thick = high + r + AIR, float(rng.uniform(0.025, 0.07))
    a, b = float(rng.uniform(0.25, 0.35)) * long, float(rng.uniform(0.52, 0.62)) * long
    slats, inner = bool(rng.random() < 0.4), half + r
    knees = rng.random() < 0.6
    seat = _panel(rng, (a if knees else 0.0) + AIR, b - AIR, inner, low - AIR, thick, slats)
    frame = union([rails, *legs])
    parts = [("base", _shape((frame, tone), (seat, cover)), -1, None)]
    back = _panel(rng, b + thick, long, inner, low, thick, slats)
    up = float(np.deg2rad(rng.uniform(50, 80)))
    parts.append(("back", _shape((back, cover)), 0, hinge((b + thick, 0, low), (0, -1, 0), up)))
    if knees:
        rest = _panel(rng, 0.0, a - AIR - thick, inner, low, thick, slats)
        joint = hinge((a - AIR - thick, 0, low), (0, 1, 0), float(np.deg2rad(rng.uniform(25, 60))))
        parts.append(("rest", _shape((rest, cover)), 0, joint))
    for s in (-1, 1) if wheels else ():
        y = s * (half + r + AIR) - (0.05 if s < 0 else 0.0)
        wheel = cylinder("y", [hub[0], y, radius], 0.05, radius, segments=22)
        joint = turn((hub[0], 0, radius), (0, 1, 0))
        parts.append(("wheel", _shape((wheel, materials.dark(rng))), 0, joint))
    return parts


def _theatre(rng: np.random.Generator) -> list[tuple]:
    """Seats in a row between arms, or one on a wall plate, tipped up until someone sits down."""
    wall = rng.random() < 0.3
    count = 1 if wall else int(rng.choice([1, 2, 3, 4], p=[0.3, 0.35, 0.2, 0.15]))
    tone, _ = _finish(rng)
    cover = _cover(rng, tone)
    wide, side = float(rng.uniform(0.36, 0.5)), float(rng.uniform(0.04, 0.08))
    high, deep, thick = (
        float(rng.uniform(0.38, 0.46)),
        float(rng.uniform(0.34, 0.44)),
        float(rng.uniform(0.04, 0.11)),
    )
    tall, lean = float(rng.uniform(0.8, 1.05)), float(rng.uniform(0.02, 0.12))
    total = count * wide + (count + 1) * side
    solids, backs, seats = [], [], []
    if wall:
        tall = high + float(rng.uniform(0.3, 0.6))
        low = high - 0.12
        solids.append(
            box(
                [0, -total / 2, low],
                [0.03, total / 2, high + (tall - high) * float(rng.uniform(0.2, 1))],
            )
        )
        for y in (-total / 2, total / 2 - side):
            solids.append(box([-0.06, y, low], [0, y + side, high + 0.06]))
    for k in range(count + 1 if not wall else 0):
        y = -total / 2 + k * (wide + side)
        arm = float(rng.uniform(0.16, 0.24)) + high
        solids.append(box([-0.6 * deep, y, 0], [0.12, y + side, 0.03]))
        solids.append(box([-0.12, y, 0], [0.1, y + side, arm - 0.03]))
        solids.append(box([-0.8 * deep, y, arm - 0.05], [0.12, y + side, arm]))
    seat_round = float(rng.choice([0.01, rng.uniform(0.03, 0.12)]))
    pad = thick * float(rng.uniform(0.6, 1.1))
    for k in range(count):
        y = -total / 2 + side + k * (wide + side)
        if not wall:
            corners = [
                [x + d, q, z]
                for x, z in ((0.01, high - 0.1), (0.01 + lean, tall))
                for d in (0, pad)
                for q in (y, y + wide)
            ]
            backs.append(hull(np.array(corners)))
        plan = rounded(wide - 2 * AIR, deep, seat_round)
        at = [-thick, y + wide / 2, high + deep / 2]
        solid = extrusion(plan, "x", at, thick - 0.5 * AIR)
        seats.append(
            (solid, hinge((-thick / 2, 0, high), (0, -1, 0), np.deg2rad(rng.uniform(78, 90))))
        )
    pieces = [(union(solids), tone)] + ([(union(backs), cover)] if backs else [])
    parts = [("stand", _shape(*pieces), -1, None)]
    return parts + [("seat", _shape((solid, cover)), 0, joint) for solid, joint in seats]

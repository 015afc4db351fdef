"""Stools without a back whose seat turns, screws up or lifts off a box, step stools whose treads
fold, and low stands that turn: lazy susans, turntables, cake stands with a dome."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    ball,
    box,
    cut,
    cylinder,
    extrusion,
    hinge,
    hull,
    pipe,
    revolution,
    rounded,
    screw,
    slide,
    tidy,
    tube,
    turn,
    union,
)

X, Y, Z = np.eye(3)
EXTRAS = ("none", "tier", "dome", "jars", "grip")
Pieces = list[tuple[Manifold, Material]]


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A stool or a stand that turns, metres, low and shut."""
    kind = rng.choice(["swivel", "steps", "chest", "stand"], p=[0.52, 0.18, 0.1, 0.2])
    make = {"swivel": _swivel, "steps": _steps, "chest": _chest, "stand": _stand}
    return make[str(kind)](rng)


def _shape(pieces: Pieces) -> Shape:
    """Pieces by material; what comes later gives way."""
    groups: dict[Material, list[Manifold]] = {}
    for solid, material in pieces:
        groups.setdefault(material, []).append(solid)
    shape, before = Shape(), []
    for material, solids in groups.items():
        solid = tidy(cut(union(solids), before))
        if not solid.is_empty():
            shape.add(solid, material)
            before.append(solid)
    return shape


def _frame_finish(rng: np.random.Generator) -> Material:
    """Wood, steel, black, or painted metal."""
    kind = rng.choice(4, p=[0.4, 0.26, 0.16, 0.18])
    if kind == 0:
        return materials.wood(rng)
    if kind == 1:
        return materials.metal(rng, brushed=False)
    return materials.dark(rng) if kind == 2 else plain(rng.uniform(0.1, 0.9, 3))


def _seat_finish(rng: np.random.Generator) -> Material:
    """Wood, leather, cloth or plastic of any colour."""
    kind = rng.choice(4, p=[0.4, 0.2, 0.28, 0.12])
    if kind == 0:
        return materials.wood(rng)
    if kind == 1:
        return plain(np.array([0.42, 0.26, 0.15]) * rng.uniform(0.4, 1.6))
    return plain(rng.uniform(0.08, 0.92, 3)) if kind == 2 else materials.dark(rng)


def _seat(rng, plan: str, half: float, z: float, thick: float, main, trim) -> Pieces:
    """A seat about z with its foot at ``z``: round, square, a saddle or a tractor's."""
    if plan == "round":
        kind = str(rng.choice(["flat", "cushion", "dish"], p=[0.35, 0.45, 0.2]))
        board = 0.3 * thick
        if kind == "cushion":
            angle = np.linspace(-np.pi / 2, np.pi / 2, 7)
            r = 0.5 * (thick - board)
            rim = np.column_stack([half - r + r * np.cos(angle), board + r + r * np.sin(angle)])
            top = revolution(np.vstack([[[0, board]], rim, [[0, thick]]]), "z", [0, 0, z], 30)
            return [(top, main), (cylinder("z", [0, 0, z], board, 0.93 * half, segments=30), trim)]
        disc = cylinder("z", [0, 0, z], thick, 0.93 * half, half, 30)
        if kind == "dish":
            disc -= cylinder("z", [0, 0, z + 0.65 * thick], thick, 0.55 * half, 1.15 * half, 30)
        return [(disc, main)]
    wide = float(rng.uniform(0.85, 1.35)) if plan == "square" else 1.45
    corner = half * float(rng.uniform(0.1, 0.5))
    outline = rounded(1.8 * half, 1.8 * half * wide, corner)
    if plan == "square":
        board = extrusion(0.94 * outline, "z", [0, 0, z], 0.35 * thick)
        return [
            (extrusion(outline, "z", [0, 0, z + 0.35 * thick], 0.65 * thick), main),
            (board, trim),
        ]
    solid = extrusion(outline, "z", [0, 0, z], 1.5 * thick)  # hollow between its two high sides
    radius = 2.0 * half * wide
    return [
        (solid - cylinder("x", [-1, 0, z + 0.7 * thick + radius], 2, radius, segments=64), main)
    ]


def _legs(rng, high: float, top: float, spread: float, r: float, finish, ring) -> Pieces:
    """Three or four legs from the floor to ``high``, ``top`` and ``spread`` off the middle, with a
    ring or rails between them."""
    count = int(rng.choice([3, 4], p=[0.35, 0.65]))
    start = np.pi / count if rng.random() < 0.5 else 0.0
    angles = start + 2 * np.pi * np.arange(count) / count
    way = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(count)])
    square = rng.random() < 0.3
    pieces: Pieces = []
    for k in range(count):
        low, up = spread * way[k] + [0, 0, 0.0], top * way[k] + [0, 0, high]
        if square:
            ends = [[*(p + [dx, dy, 0])] for p in (low, up) for dx in (-r, r) for dy in (-r, r)]
            pieces.append((hull(np.array(ends)), finish))
        else:
            ends = [cylinder("z", low, 0.004, 0.8 * r, segments=12)]
            ends.append(cylinder("z", up - [0, 0, 0.004], 0.004, r, segments=12))
            pieces.append((Manifold.batch_hull(ends), finish))
    share = float(rng.uniform(0.22, 0.5))
    kind = str(rng.choice(["ring", "rails", "none"], p=[0.45, 0.4, 0.15]))
    at = spread + (top - spread) * share
    if kind == "ring":
        wire = 0.6 * r
        angle = np.linspace(0, 2 * np.pi, 8, endpoint=False)
        profile = np.column_stack([at + wire * np.cos(angle), wire * np.sin(angle)])
        pieces.append((revolution(profile, "z", [0, 0, share * high], 36), ring))
    elif kind == "rails":
        for k in range(count):
            lift = 0.06 * high * (k % 2) if count == 4 else 0.0
            a, b = (at * way[j] + [0, 0, share * high + lift] for j in (k, (k + 1) % count))
            pieces.append((pipe([a, b], 0.6 * r, 8), finish))
    return pieces


def _pedestal(rng, high: float, size: float, r: float, finish, ring) -> Pieces:
    """A column on a disc, a dome, a trumpet, a square plate or a cross, often with a foot ring."""
    kind = str(rng.choice(["disc", "dome", "trumpet", "plate", "cross"]))
    pieces: Pieces = [(cylinder("z", [0, 0, 0.005], high - 0.005, r, segments=22), finish)]
    if kind == "disc":
        pieces.append((cylinder("z", [0, 0, 0], 0.02, size, 0.97 * size, 32), finish))
    elif kind == "plate":
        outline = rounded(1.8 * size, 1.8 * size, 0.2 * size)
        pieces.append((extrusion(outline, "z", [0, 0, 0], 0.018), finish))
    elif kind == "cross":
        for k in range(4):
            end = [size, 0, 0.9 * r]
            bar = pipe([[0, 0, 1.3 * r + 0.04], end], 0.8 * r, 10)
            foot = cylinder("z", [size, 0, 0], r, 0.7 * r, segments=12)
            pieces.append((union([bar, foot]).rotate((0, 0, 90 * k + 45)), finish))
    else:
        power = 1.0 if kind == "dome" else 3.0
        u = np.linspace(0, 1, 9)
        rise = 0.06 if kind == "dome" else 0.45 * high
        rim = np.column_stack([size + (1.04 * r - size) * u, 0.012 + rise * u**power])
        profile = np.vstack([[[0, 0], [size, 0]], rim, [[0, 0.012 + rise]]])
        pieces.append((revolution(profile, "z", [0, 0, 0], 32), finish))
    if rng.random() < 0.65 and high > 0.3:
        z, wire = high * float(rng.uniform(0.4, 0.65)), 0.011
        wide = size * float(rng.uniform(0.7, 1.0))
        angle = np.linspace(0, 2 * np.pi, 8, endpoint=False)
        profile = np.column_stack([wide + wire * np.cos(angle), wire * np.sin(angle)])
        pieces.append((revolution(profile, "z", [0, 0, z], 32), ring))
        count = int(rng.choice([1, 2, 3, 4]))
        bar = pipe([[0, 0, z], [wide, 0, z]], 0.9 * wire, 8)
        start = float(rng.uniform(0, 360))
        pieces += [(bar.rotate((0, 0, start + 360 * k / count)), ring) for k in range(count)]
        pieces.append((cylinder("z", [0, 0, z - 0.025], 0.05, 1.25 * r, segments=20), ring))
    return pieces


def _swivel(rng: np.random.Generator) -> ArticulatedObject:
    """A seat on legs or a pedestal that turns, winds up on a spindle, or turns and lifts."""
    seat_z = float(rng.choice([rng.uniform(0.38, 0.52), rng.uniform(0.56, 0.82)]))
    half = float(rng.uniform(0.14, 0.2))
    thick = float(rng.uniform(0.025, 0.09))
    plan = str(rng.choice(["round", "square", "saddle"], p=[0.6, 0.25, 0.15]))
    frame, main = _frame_finish(rng), _seat_finish(rng)
    trim = materials.dark(rng) if rng.random() < 0.5 else frame
    ring = materials.metal(rng, brushed=False) if rng.random() < 0.6 else frame
    motion = str(rng.choice(["turn", "screw", "lift"], p=[0.36, 0.42, 0.22]))
    low = seat_z - thick
    legs = rng.random() < 0.55
    rod = float(rng.uniform(0.014, 0.022)) if legs else float(rng.uniform(0.017, 0.028))
    gap = float(rng.uniform(0.03, 0.12)) if motion != "turn" else float(rng.uniform(0.004, 0.03))
    sleeve = rod * float(rng.uniform(1.4, 1.9))
    deck = low - gap  # where the seat's rod leaves the frame
    reach = min(float(rng.uniform(0.12, 0.22)), 0.55 * deck) if motion != "turn" else 0.05
    air = 0.0012
    pieces: Pieces
    if legs:
        r, top = float(rng.uniform(0.012, 0.022)), half * float(rng.uniform(0.35, 0.75))
        spread = max(half * float(rng.uniform(0.9, 1.35)), top)
        plate = max(0.014, 0.9 * r)
        pieces = _legs(rng, deck - 0.5 * plate, top, spread, r, frame, ring)
        wide = top + 1.1 * r
        if rng.random() < 0.6:
            pieces.append((cylinder("z", [0, 0, deck - plate], plate, wide, segments=26), frame))
        else:
            for k in range(4):
                bar = box([0, -0.8 * r, deck - plate], [wide, 0.8 * r, deck])
                pieces.append((bar.rotate((0, 0, 90 * k)), frame))
            pieces.append((cylinder("z", [0, 0, deck - plate], plate, 2 * sleeve), frame))
            around = cylinder("z", [0, 0, deck - plate], plate, wide, segments=26)
            pieces.append(
                (around - cylinder("z", [0, 0, 0], 2, wide - 2.0 * r, segments=26), frame)
            )
        nut = cylinder("z", [0, 0, deck - reach - 0.02], reach + 0.02, sleeve, segments=18)
        pieces.append((nut, ring))
    else:
        size = half * float(rng.uniform(1.0, 1.35))
        pieces = _pedestal(rng, deck, size, sleeve, frame, ring)
    hole = cylinder("z", [0, 0, deck - reach - 0.012], 2, rod + air, segments=18)
    body = Shape()
    for solid, material in [(s - hole, m) for s, m in _merged(pieces)]:
        body.add(tidy(solid), material)
    asm = Assembly()
    root = asm.add("frame", body)
    stem = cylinder("z", [0, 0, deck - reach - 0.01], low - deck + reach + 0.012, rod, segments=18)
    seat = _seat(rng, plan, half, low, thick, main, trim)
    under = cylinder("z", [0, 0, low - min(0.6 * gap, 0.02)], min(0.6 * gap, 0.02), 2.4 * rod)
    steel = materials.metal(rng, brushed=False)
    parts: Pieces = [*seat]
    if motion == "screw":  # a thread of rings where the spindle shows
        pitch = max(0.006, gap / 8)
        ring = cylinder("z", [0, 0, deck + 0.002], 0.4 * pitch, rod + air, segments=18)
        rings = [ring.translate((0, 0, k * pitch)) for k in range(int((gap - 0.022) / pitch))]
        parts += [(union([stem, under, *rings]), steel)]
        joint = screw((0, 0, 0), Z, float(rng.choice([3, 4, 5, 6, 8])), 0.75 * reach)
        asm.add("seat", _shape(parts), root, joint)
    elif motion == "turn":
        parts += [(union([stem, under]), steel)]
        asm.add("seat", _shape(parts), root, turn((0, 0, 0), Z))
    else:  # a rod that slides up, and the seat that turns on it
        foot = under.translate((0, 0, -0.001))
        if rng.random() < 0.5:  # a lever on the rod, under the seat
            foot += pipe([[0, 0, low - 0.01], [0, -0.75 * half, low - 0.012]], 0.006, 8)
        short = stem ^ box([-1, -1, 0], [1, 1, low - 0.001])
        under_seat = box([-2, -2, 0], [2, 2, low - 0.001])
        column = tidy(union([short, foot]) ^ under_seat)
        mid = asm.add("column", _shape([(column, steel)]), root, slide(Z, 0.75 * reach))
        asm.add("seat", _shape(seat), mid, turn((0, 0, 0), Z))
    return asm.object()


def _merged(pieces: Pieces) -> Pieces:
    """One solid a material; what comes later gives way."""
    groups: dict[Material, list[Manifold]] = {}
    for solid, material in pieces:
        groups.setdefault(material, []).append(solid)
    out: Pieces = []
    for material, solids in groups.items():
        out.append((cut(union(solids), [s for s, _ in out]), material))
    return out


def _steps(rng: np.random.Generator) -> ArticulatedObject:
    """A step stool: a top that is hinged and lifts, and treads that fold up between side frames."""
    width, high = float(rng.uniform(0.32, 0.46)), float(rng.uniform(0.4, 0.75))
    count = 1 if high < 0.55 else int(rng.choice([1, 2]))
    deep, board = float(rng.uniform(0.2, 0.28)), float(rng.uniform(0.018, 0.03))
    run = float(rng.uniform(0.6, 0.9)) * deep  # of a tread in front of the one above
    side = float(rng.uniform(0.018, 0.03))
    frame, tread = _frame_finish(rng), _seat_finish(rng)
    half, air = width / 2, 0.003
    total = deep + count * run
    step = high / (count + 1)
    asm, pieces = Assembly(), []
    solid_sides = rng.random() < 0.4
    for y in (-half, half - side):
        if solid_sides:
            line = [[0.0, total], [high - board - air, total], [high - board - air, total - deep]]
            for k in range(count, 0, -1):
                z = k * step - board - air
                line += [[z, total - deep - (count - k) * run], [z, (k - 1) * run]]
            line += [[0.0, 0.0]]
            pieces.append((extrusion(np.array(line), "y", [0, y, 0], side), frame))
            continue
        w = 0.6 * side
        m, top = y + side / 2, high - board - air - w
        feet = [[w, m, w], [total - deep + w, m, top], [total - w, m, top], [total - w, m, w]]
        pieces.append((pipe(feet, w, 8), frame))
        for k in range(1, count + 1):
            z = k * step - board - air - w
            pieces.append((pipe([[(k - 1) * run + w, m, z], [total - w, m, z]], w, 8), frame))
            front = [(k - 1) * run + w, m, w]
            pieces.append((pipe([front, [(k - 1) * run + w, m, z]], w, 8), frame))
    rear = box(
        [total - 1.1 * side, -half, 0.3 * step], [total - 0.1 * side, half, 0.3 * step + 2 * side]
    )
    pieces.append((rear, frame))
    pieces.append((rear.translate((0, 0, high - step)), frame))
    for y in (-0.55 * half, 0.55 * half):  # what the seat is hinged on
        low, w = high - 0.68 * step, 0.05 * half
        foot = [total + 0.012, y + w, high - board - 0.006]
        pieces.append((box([total - 0.2 * side, y - w, low], foot), frame))
        pieces.append((box([total + 0.003, y - w, low], [total + 0.012, y + w, high]), frame))
    root = asm.add("frame", _shape(pieces))
    plate = box([0, -half - 0.01, 0], [deep, half + 0.01, board])
    if rng.random() < 0.5:
        plate = extrusion(rounded(deep, width + 0.02, 0.03), "z", [deep / 2, 0, 0], board)
    pad = box([0.15 * deep, -0.8 * half, board], [0.85 * deep, 0.8 * half, board + 0.004])
    mat = materials.dark(rng)
    lined = rng.random() < 0.5
    for k in range(count + 1):
        x, z = k * run, (k + 1) * step - board
        solid, name = plate, "tread" if k < count else "seat"
        if k < count:  # its rear edge before the tread above, between whose legs it folds up
            inside = 1.0 if solid_sides else half - side - 0.003  # between the legs' tubes
            solid = plate ^ box([0, -inside, -1], [run - 0.012, inside, 1])
        own: Pieces = [(solid.translate((x, 0, z)), tread)]
        if lined:
            mark = pad ^ box([0, -1, -1], [run - 0.03 if k < count else deep, 0.8 * half - side, 1])
            own.append((mark.translate((x, 0, z)), mat))
        back = x + (run - 0.012 if k < count else deep)
        most = float(np.deg2rad(rng.uniform(70, 88) if k < count else rng.uniform(75, 95)))
        asm.add(name, _shape(own), root, hinge((back, 0, z + board), Y, most))
    return asm.object()


def _chest(rng: np.random.Generator) -> ArticulatedObject:
    """A box to sit on whose cushion opens, an ottoman or a kick stool with a drum that sinks."""
    if rng.random() < 0.35:  # a kick step: a drum on a base in which it sinks when stood on
        r, high = float(rng.uniform(0.16, 0.2)), float(rng.uniform(0.33, 0.44))
        tone, rubber = plain(rng.uniform(0.1, 0.85, 3)), materials.dark(rng)
        waist = high * float(rng.uniform(0.4, 0.55))
        base = cylinder("z", [0, 0, 0.02], waist, 1.3 * r, 1.08 * r, 34)
        base -= cylinder("z", [0, 0, 0.035], 1, 1.01 * r + 0.002, segments=34)
        skirt = tube("z", [0, 0, 0], 0.03, 1.36 * r, 1.2 * r, 34)
        asm = Assembly()
        root = asm.add("base", _shape([(base, tone), (skirt, rubber)]))
        drum = cylinder("z", [0, 0, 0.09], high - 0.1, r, 0.96 * r, 34)
        mat = cylinder("z", [0, 0, high - 0.01], 0.015, 0.99 * r, 0.94 * r, 34)
        top = [(drum, tone if rng.random() < 0.6 else tone.darker(0.8)), (mat, rubber)]
        asm.add("drum", _shape(top), root, slide(-Z, float(rng.uniform(0.03, 0.05))))
        return asm.object()
    deep, high = float(rng.uniform(0.34, 0.5)), float(rng.uniform(0.36, 0.5))
    width = deep * float(rng.choice([1.0, rng.uniform(1.1, 2.2)]))
    wall, pad = 0.016, float(rng.uniform(0.04, 0.1))
    main = _seat_finish(rng)
    cushion = main if rng.random() < 0.5 else _seat_finish(rng)
    legs = float(rng.uniform(0.03, 0.12)) if rng.random() < 0.6 else 0.0
    corner = float(rng.uniform(0.005, 0.06))
    outline = rounded(deep, width, corner)
    inner = rounded(deep - 2 * wall, width - 2 * wall, max(corner - wall, 0.004))
    top = high - pad
    case = extrusion(outline, "z", [0, 0, legs], top - legs)
    case -= extrusion(inner, "z", [0, 0, legs + wall], 1)
    pieces = [(case, main)]
    if legs:
        frame = _frame_finish(rng)
        for x in (-0.42 * deep, 0.42 * deep):
            for y in (-0.5 * width + 0.08 * deep, 0.5 * width - 0.08 * deep):
                pieces.append((cylinder("z", [x, y, 0], legs, 0.012, 0.02, 12), frame))
    asm = Assembly()
    root = asm.add("box", _shape(pieces))
    base = extrusion(outline, "z", [0, 0, top + 0.003], 0.3 * pad)
    soft = extrusion(0.97 * outline, "z", [0, 0, top + 0.003 + 0.3 * pad], 0.7 * pad)
    lid = [(base, main), (soft, cushion)]
    joint = hinge((deep / 2, 0, top + 0.003), Y, float(np.deg2rad(rng.uniform(70, 105))))
    if rng.random() < 0.25:
        joint = slide(Z, 0.5 * high)  # lifts off
    asm.add("lid", _shape(lid), root, joint)
    return asm.object()


def _stand(rng: np.random.Generator) -> ArticulatedObject:
    """A plate that turns on a foot: one or two tiers, a rim, a knob or a handle, a dome to lift."""
    r = float(rng.uniform(0.12, 0.24))
    steel, tone = materials.metal(rng, brushed=False), plain(rng.uniform(0.15, 0.95, 3))
    white = materials.white_plastic(rng)
    finish = (materials.wood(rng), white, steel, materials.stone(rng), tone)[rng.integers(5)]
    foot = finish if rng.random() < 0.5 else _frame_finish(rng)
    tall = rng.random() < 0.55
    neck = r * float(rng.uniform(0.35, 0.9)) if tall else r * float(rng.uniform(0.06, 0.15))
    size = r * float(rng.uniform(0.5, 0.8))
    asm = Assembly()
    if tall:
        u = np.linspace(0, 1, 10)
        waist = size * float(rng.uniform(0.15, 0.4))
        curve = waist + (size - waist) * (1 - u) ** float(rng.uniform(2, 4))
        curve += 0.3 * size * np.clip(u - 0.7, 0, 1)
        line = np.column_stack([curve, 0.08 * neck + 0.92 * neck * u])
        stem = revolution(np.vstack([[[0, 0], [size, 0]], line, [[0, neck]]]), "z", [0, 0, 0], 30)
    elif rng.random() < 0.3:
        stem = extrusion(rounded(1.7 * size, 1.7 * size, 0.2 * size), "z", [0, 0, 0], neck)
    else:
        stem = cylinder("z", [0, 0, 0], neck, size, 0.9 * size, 32)
    root = asm.add("foot", _shape([(stem, foot)]))
    z, thick = neck + 0.0015 * (1 + 4 * r), r * float(rng.uniform(0.05, 0.1))
    plan = str(rng.choice(["round", "square"], p=[0.8, 0.2]))
    plate = cylinder("z", [0, 0, z], thick, 0.97 * r, r, 40)
    if plan == "square":
        plate = extrusion(rounded(1.75 * r, 1.75 * r, 0.25 * r), "z", [0, 0, z], thick)
    pieces, rim = [(plate, finish)], rng.random() < 0.5 and plan == "round"
    top, high = z + thick, r * float(rng.uniform(0.06, 0.25))
    if rim:
        band = tube("z", [0, 0, top - 0.001], high, 0.98 * r, 0.93 * r, 40)
        pieces.append((band, finish if rng.random() < 0.6 else _frame_finish(rng)))
    extra = str(rng.choice(EXTRAS, p=[0.12, 0.24, 0.36, 0.14, 0.14]))
    if extra == "tier":
        rise, small = r * float(rng.uniform(0.5, 0.9)), r * float(rng.uniform(0.55, 1.0))
        post = cylinder("z", [0, 0, top - 0.001], rise + 0.002, 0.07 * r)
        upper = cylinder("z", [0, 0, top + rise], thick, 0.97 * small, small, 36)
        knob = ball([0, 0, top + rise + thick + 0.08 * r], 0.12 * r, 16)
        pieces += [(upper, finish), (post, foot), (knob, foot)]
    elif extra == "grip":  # dividers and a ring to carry it by
        for k in range(int(rng.integers(3, 7))):
            fin = box([0, -0.02 * r, top - 0.001], [0.93 * r, 0.02 * r, top + 0.2 * r])
            pieces.append((fin.rotate((0, 0, 60 * k)), finish))
        pieces.append((cylinder("z", [0, 0, top - 0.001], 0.6 * r, 0.06 * r), foot))
        pieces.append(
            (tube("x", [-0.04 * r, 0, top + 0.72 * r], 0.08 * r, 0.18 * r, 0.1 * r), foot)
        )
    elif extra == "jars":
        for k in range(int(rng.integers(2, 5))):
            tone = plain(rng.uniform(0.1, 0.9, 3))
            jar = cylinder(
                "z", [0.55 * r, 0, top - 0.001], r * float(rng.uniform(0.25, 0.7)), 0.22 * r
            )
            pieces.append((jar.rotate((0, 0, 85 * k + float(rng.uniform(0, 12)))), tone))
    table = asm.add("plate", _shape(pieces), root, turn((0, 0, 0), Z))
    if extra == "dome":
        wide, tone = r * float(rng.uniform(0.78, 0.9)), materials.glass(rng)
        if rng.random() < 0.3:
            tone = materials.metal(rng, brushed=False)
        rise = r * float(rng.uniform(0.5, 1.0))
        straight = float(rng.uniform(0, 0.5)) * rise
        angle = np.linspace(0, np.pi / 2, 8)
        line = np.column_stack([np.cos(angle), np.sin(angle)])
        outer = [0, straight] + line * [wide, rise - straight]
        inner = [0, straight] + line * [wide - 0.03 * r, rise - straight - 0.03 * r]
        profile = np.vstack([[[wide, 0]], outer, inner[::-1], [[wide - 0.03 * r, 0]]])
        shell = revolution(profile, "z", [0, 0, top + 0.002], 34)
        shell += cylinder("z", [0, 0, top + 0.98 * rise], 0.1 * r, 0.05 * r, segments=14)
        knob = ball([0, 0, top + rise + 0.14 * r], 0.1 * r, 14)
        asm.add("dome", _shape([(shell, tone), (knob, foot)]), table, slide(Z, 1.2 * rise))
    return asm.object()

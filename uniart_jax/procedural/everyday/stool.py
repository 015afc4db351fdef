"""Stools whose seat turns, screws up or opens; step stools whose treads fold. Low stands that turn
are in ``turning_stand``."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.stool_parts import (
    Pieces,
    draw_frame_finish,
    draw_seat_finish,
    legs_under,
    pedestal,
    seat_on,
)
from uniart_jax.procedural.everyday.turning_stand import turning_stand
from uniart_jax.procedural.materials import plain
from uniart_jax.procedural.pieces import disjoint, trimmed
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cylinder,
    extrusion,
    hinge,
    pipe,
    rounded,
    screw,
    slide,
    tidy,
    tube,
    turn,
    union,
)

X, Y, Z = np.eye(3)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A stool or a turning stand in metres, lowered and closed."""
    kind = rng.choice(["swivel", "steps", "chest", "stand"], p=[0.52, 0.18, 0.1, 0.2])
    make = {"swivel": _swivel, "steps": _steps, "chest": _chest, "stand": turning_stand}
    return make[str(kind)](rng)


def _swivel(rng: np.random.Generator) -> ArticulatedObject:
    """A seat on legs or a pedestal that turns, screws up on a spindle, or turns and lifts."""
    seat_z = float(rng.choice([rng.uniform(0.38, 0.52), rng.uniform(0.56, 0.82)]))
    half = float(rng.uniform(0.14, 0.2))
    thick = float(rng.uniform(0.025, 0.09))
    plan = str(rng.choice(["round", "square", "saddle"], p=[0.6, 0.25, 0.15]))
    frame, main = draw_frame_finish(rng), draw_seat_finish(rng)
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
        pieces = legs_under(rng, deck - 0.5 * plate, top, spread, r, frame, ring)
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
        pieces = pedestal(rng, deck, size, sleeve, frame, ring)
    hole = cylinder("z", [0, 0, deck - reach - 0.012], 2, rod + air, segments=18)
    body = Shape()
    for solid, material in [(s - hole, m) for s, m in disjoint(pieces)]:
        body.add(tidy(solid), material)
    asm = Assembly()
    root = asm.add("frame", body)
    stem = cylinder("z", [0, 0, deck - reach - 0.01], low - deck + reach + 0.012, rod, segments=18)
    seat = seat_on(rng, plan, half, low, thick, main, trim)
    under = cylinder("z", [0, 0, low - min(0.6 * gap, 0.02)], min(0.6 * gap, 0.02), 2.4 * rod)
    steel = materials.metal(rng, brushed=False)
    parts: Pieces = [*seat]
    if motion == "screw":  # a thread of rings where the spindle shows
        pitch = max(0.006, gap / 8)
        ring = cylinder("z", [0, 0, deck + 0.002], 0.4 * pitch, rod + air, segments=18)
        rings = [ring.translate((0, 0, k * pitch)) for k in range(int((gap - 0.022) / pitch))]
        parts += [(union([stem, under, *rings]), steel)]
        joint = screw((0, 0, 0), Z, float(rng.choice([3, 4, 5, 6, 8])), 0.75 * reach)
        asm.add("seat", trimmed(*parts), root, joint)
    elif motion == "turn":
        parts += [(union([stem, under]), steel)]
        asm.add("seat", trimmed(*parts), root, turn((0, 0, 0), Z))
    else:  # a rod that slides up, and the seat that turns on it
        foot = under.translate((0, 0, -0.001))
        if rng.random() < 0.5:  # a lever on the rod, under the seat
            foot += pipe([[0, 0, low - 0.01], [0, -0.75 * half, low - 0.012]], 0.006, 8)
        short = stem ^ box([-1, -1, 0], [1, 1, low - 0.001])
        under_seat = box([-2, -2, 0], [2, 2, low - 0.001])
        column = tidy(union([short, foot]) ^ under_seat)
        mid = asm.add("column", trimmed((column, steel)), root, slide(Z, 0.75 * reach))
        asm.add("seat", trimmed(*seat), mid, turn((0, 0, 0), Z))
    return asm.object()


def _steps(rng: np.random.Generator) -> ArticulatedObject:
    """A step stool: a hinged top that lifts, and treads that fold up between the side frames."""
    width, high = float(rng.uniform(0.32, 0.46)), float(rng.uniform(0.4, 0.75))
    count = 1 if high < 0.55 else int(rng.choice([1, 2]))
    deep, board = float(rng.uniform(0.2, 0.28)), float(rng.uniform(0.018, 0.03))
    run = float(rng.uniform(0.6, 0.9)) * deep  # of a tread in front of the one above
    side = float(rng.uniform(0.018, 0.03))
    frame, tread = draw_frame_finish(rng), draw_seat_finish(rng)
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
    root = asm.add("frame", trimmed(*pieces))
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
        asm.add(name, trimmed(*own), root, hinge((back, 0, z + board), Y, most))
    return asm.object()


def _chest(rng: np.random.Generator) -> ArticulatedObject:
    """A box seat: an ottoman whose cushion opens, or a kick stool with a drum that sinks."""
    if rng.random() < 0.35:  # a kick step: a drum on a base in which it sinks when stood on
        r, high = float(rng.uniform(0.16, 0.2)), float(rng.uniform(0.33, 0.44))
        tone, rubber = plain(rng.uniform(0.1, 0.85, 3)), materials.dark(rng)
        waist = high * float(rng.uniform(0.4, 0.55))
        base = cylinder("z", [0, 0, 0.02], waist, 1.3 * r, 1.08 * r, 34)
        base -= cylinder("z", [0, 0, 0.035], 1, 1.01 * r + 0.002, segments=34)
        skirt = tube("z", [0, 0, 0], 0.03, 1.36 * r, 1.2 * r, 34)
        asm = Assembly()
        root = asm.add("base", trimmed((base, tone), (skirt, rubber)))
        drum = cylinder("z", [0, 0, 0.09], high - 0.1, r, 0.96 * r, 34)
        mat = cylinder("z", [0, 0, high - 0.01], 0.015, 0.99 * r, 0.94 * r, 34)
        top = [(drum, tone if rng.random() < 0.6 else tone.darker(0.8)), (mat, rubber)]
        asm.add("drum", trimmed(*top), root, slide(-Z, float(rng.uniform(0.03, 0.05))))
        return asm.object()
    deep, high = float(rng.uniform(0.34, 0.5)), float(rng.uniform(0.36, 0.5))
    width = deep * float(rng.choice([1.0, rng.uniform(1.1, 2.2)]))
    wall, pad = 0.016, float(rng.uniform(0.04, 0.1))
    main = draw_seat_finish(rng)
    cushion = main if rng.random() < 0.5 else draw_seat_finish(rng)
    legs = float(rng.uniform(0.03, 0.12)) if rng.random() < 0.6 else 0.0
    corner = float(rng.uniform(0.005, 0.06))
    outline = rounded(deep, width, corner)
    inner = rounded(deep - 2 * wall, width - 2 * wall, max(corner - wall, 0.004))
    top = high - pad
    case = extrusion(outline, "z", [0, 0, legs], top - legs)
    case -= extrusion(inner, "z", [0, 0, legs + wall], 1)
    pieces = [(case, main)]
    if legs:
        frame = draw_frame_finish(rng)
        for x in (-0.42 * deep, 0.42 * deep):
            for y in (-0.5 * width + 0.08 * deep, 0.5 * width - 0.08 * deep):
                pieces.append((cylinder("z", [x, y, 0], legs, 0.012, 0.02, 12), frame))
    asm = Assembly()
    root = asm.add("box", trimmed(*pieces))
    base = extrusion(outline, "z", [0, 0, top + 0.003], 0.3 * pad)
    soft = extrusion(0.97 * outline, "z", [0, 0, top + 0.003 + 0.3 * pad], 0.7 * pad)
    lid = [(base, main), (soft, cushion)]
    joint = hinge((deep / 2, 0, top + 0.003), Y, float(np.deg2rad(rng.uniform(70, 105))))
    if rng.random() < 0.25:
        joint = slide(Z, 0.5 * high)  # lifts off
    asm.add("lid", trimmed(*lid), root, joint)
    return asm.object()

"""Microwaves, dishwashers and washing machines as they are built in: over the range, within a trim
frame or under a worktop, with push buttons, sealed keys and dials."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import appliance_fronts, appliances, controls, finishes, materials
from uniart_jax.procedural import real_finishes as finish
from uniart_jax.procedural.appliance_fronts import appliance_style, dressed
from uniart_jax.procedural.control_boards import Board, column_board, row_board
from uniart_jax.procedural.fronts import FrontStyle, add_door
from uniart_jax.procedural.hinges import opening
from uniart_jax.procedural.laundry import build_washer
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    hinge,
    revolution,
    slide,
    turn,
)

MOST = 15  # parts beside the body


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A microwave, a dishwasher or a washing machine, metres, closed."""
    kinds = (_microwave, _dishwasher, build_washer)
    return kinds[rng.choice(3, p=[0.46, 0.32, 0.22])](rng)


def _microwave(rng: np.random.Generator) -> ArticulatedObject:
    width, height = float(rng.uniform(0.42, 0.82)), float(rng.uniform(0.24, 0.5))
    depth = float(rng.uniform(0.28, 0.52)) if rng.random() < 0.9 else float(rng.uniform(0.5, 0.7))
    kind = str(rng.choice(["counter", "over", "built"], p=[0.48, 0.22, 0.3]))
    unit = max(width, height, depth) / 100
    face = appliance_fronts.outside(rng)
    thick = max(0.008, float(rng.uniform(1.5, 5.5)) * unit)
    look = appliance_style(rng, unit, face, thick)
    look = dataclasses.replace(
        look, reach=0.5 * height, handle_length=float(rng.uniform(0.4, 0.95))
    )
    case = appliance_fronts.case_of(rng, face)
    half = width / 2
    legs = float(rng.uniform(0.006, 0.02)) if kind == "counter" and rng.random() < 0.6 else 0.0
    banded = rng.random() < (0.55 if kind == "built" else 0.12)
    below = rng.random() < 0.5
    band = height * float(rng.uniform(0.12, 0.26)) if banded else 0.0
    share = 0.0 if banded else width * float(rng.uniform(0.12, 0.3))
    side = 1 if rng.random() < 0.9 else -1  # controls on the right, as seen from the front
    strips = [
        height * float(rng.choice([0.0, rng.uniform(0.02, 0.16)], p=[0.5, 0.5])) for _ in "ab"
    ]
    if kind == "over":
        strips[1] = height * float(rng.uniform(0.06, 0.18))
    cheek = 0.0
    if banded and kind == "built" and rng.random() < 0.35:
        cheek = width * float(rng.uniform(0.04, 0.2))
    y0, y1 = -half, half
    door_y = (y0 + share + cheek, y1 - cheek) if side > 0 else (y0 + cheek, y1 - share - cheek)
    sill = legs + (band if banded and below else strips[0])
    lintel = height - (band if banded and not below else strips[1])
    flap = rng.random() < (0.5 if banded else 0.08)
    if flap:  # about its face, the top of a thick one would go up
        thick = min(thick, 0.1 * (lintel - sill))
    front = -thick - 0.002
    wall = max(0.01, float(rng.uniform(1.8, 4.0)) * unit)
    bay_lo = np.array([0.0, door_y[0] + wall, sill + wall])
    bay_hi = np.array([depth - wall, door_y[1] - wall, lintel - wall])

    asm, body = Assembly(), Shape()
    if legs:
        appliances.feet(body, rng, width, depth, legs, unit)
    lining = finishes.white_plastic(rng) if rng.random() < 0.6 else finishes.dark(rng)
    room, inner = box([-0.1, *bay_lo[1:]], bay_hi), 0.3 * wall
    liner = box([0.002, *(bay_lo[1:] - inner)], bay_hi + inner)
    flange = float(rng.uniform(0.012, 0.07)) if kind == "built" and rng.random() < 0.6 else 0.0
    outer = box([0, y0, legs], [depth, y1, height])
    body.add(cut(outer, (liner, room)), case)
    body.add(cut(liner, (room,)), lining)
    if flange:  # a trim frame before the furniture
        drop = float(rng.uniform(0.2, 1.0)) * flange
        hole = box([front - 1, y0, legs], [1, y1, height])
        trim = box([front * 0.6, y0 - flange, legs - drop], [0.004, y1 + flange, height + drop])
        body.add(cut(trim, (hole,)), look.face)
    board_finish = face if rng.random() < 0.45 else finishes.dark(rng)
    seam = float(rng.uniform(0.0015, 0.005))
    if banded:
        area = (legs, sill - seam) if below else (lintel + seam, height)
        board = Board(front, -front, (y0, y1), area, unit, board_finish)
        row_board(rng, board, body, face, MOST - 2)
    else:
        y = (y0, door_y[0] - seam) if side > 0 else (door_y[1] + seam, y1)
        board = Board(front, -front, y, (legs, height), unit, board_finish)
        column_board(rng, board, body, face, MOST - 2)
    board.build(body)
    bands = [] if banded and below else [(legs, sill - seam)]
    bands += [] if banded and not below else [(lintel + seam, height)]
    for a, b in bands:
        if b - a > 0.004:
            ys = (door_y[0] + (0.001 if share and side > 0 else 0.0),
                  door_y[1] - (0.001 if share and side < 0 else 0.0))  # fmt: skip
            body.add(box([front, ys[0], a], [0, ys[1], b]), face)
            if a > sill and rng.random() < (0.7 if kind == "over" else 0.2):
                slots = (
                    (ys[0] + 2 * unit, ys[1] - 2 * unit),
                    (a + 0.15 * (b - a), b - 0.15 * (b - a)),
                )
                appliance_fronts.vents(body, rng, front, *slots, finishes.dark(rng))
    for ys in ((y0, door_y[0]), (door_y[1], y1)):
        if cheek:  # boards beside the door
            body.add(box([front, ys[0], sill], [0, ys[1], lintel]), face)
    root = asm.add("body", body)
    lo = np.array([front, door_y[0] + seam / 2, sill + seam / 2])
    hi = np.array([-0.002, door_y[1] - seam / 2, lintel - seam / 2])
    tight = sill > legs + 0.004 or flange > 0
    if flap:
        style, extra = dressed(rng, lo, hi, "+z", look)
        add_door(asm, root, lo, hi, "-z", np.pi / 2, style, inset=tight, beyond=1.0, extra=extra)
    else:
        free = "-y" if side > 0 else "+y"
        style, extra = dressed(rng, lo, hi, free, look)
        edge = "+y" if side > 0 else "-y"
        angle = np.pi / 2 if rng.random() < 0.6 else opening(rng, 0.2)
        angle = min(angle, 1.9) if cheek else angle
        add_door(
            asm, root, lo, hi, edge, angle, style, inset=flange + cheek > 0,
            beyond=max(flange, 0.001), extra=extra,
        )  # fmt: skip
    if rng.random() < 0.42:
        _turntable(rng, asm, root, bay_lo, bay_hi, unit)
    board.parts(asm, root)
    return asm.object()


def _turntable(rng, asm: Assembly, root: int, lo, hi, unit: float) -> None:
    """A glass plate on the floor of the room."""
    at = [(lo[0] + hi[0]) / 2, (lo[1] + hi[1]) / 2, lo[2] + 0.002]
    radius = float(rng.uniform(0.32, 0.49)) * min(hi[0] - lo[0], hi[1] - lo[1])
    t = max(0.003, float(rng.uniform(0.5, 2.6)) * unit)
    rim = t * float(rng.uniform(1.0, 2.2))
    hub = 0.0
    if rng.random() < 0.35:  # on a hub
        hub = float(rng.uniform(0.02, 0.12)) * (hi[2] - lo[2])
        at[2] += hub
    profile = np.array(
        [[0, 0], [0.85 * radius, 0], [radius, rim], [0.94 * radius, rim], [0.8 * radius, t], [0, t]]
    )
    pick = rng.random()
    glass = finish.tinted_glass(rng) if pick < 0.5 else finishes.white_plastic(rng)
    plate = Shape().add(revolution(profile, "z", at, 28), glass)
    if hub > 0.004:
        foot = [*at[:2], lo[2] + 0.002]
        plate.add(cylinder("z", foot, hub, 0.3 * radius, segments=16), finishes.dark(rng))
    asm.add("turntable", plate, root, turn(at, (0, 0, 1)))


def _dishwasher(rng: np.random.Generator) -> ArticulatedObject:
    plan = str(rng.choice(["flap", "drawer", "twin", "lid"], p=[0.64, 0.2, 0.07, 0.09]))
    width, depth = float(rng.uniform(0.42, 0.85)), float(rng.uniform(0.48, 0.75))
    height = float(rng.uniform(0.45, 0.95) if plan != "flap" else rng.uniform(0.7, 0.95))
    if plan == "flap" and rng.random() < 0.12:
        height = float(rng.uniform(0.42, 0.6))  # for a table
    unit = max(width, height, depth) / 100
    face = finish.banded_steel(rng) if rng.random() < 0.4 else appliance_fronts.outside(rng)
    thick = max(0.015, float(rng.uniform(1.8, 11.0)) * unit)
    look = appliance_style(rng, unit, face, thick)
    case = appliance_fronts.case_of(rng, face)
    if plan == "lid":
        return _with_lid(rng, width, depth, height, unit, look, case)
    half, front = width / 2, -thick - 0.002
    kick = float(rng.choice([0.0, rng.uniform(0.04, 0.14)], p=[0.2, 0.8])) * height
    top = float(rng.choice([0.0, rng.uniform(0.015, 0.04)], p=[0.6, 0.4]))
    strip = float(rng.choice([0.0, rng.uniform(0.06, 0.16)], p=[0.45, 0.55])) * height
    asm, body = Assembly(), Shape()
    base = finishes.dark(rng) if rng.random() < 0.6 else face.darker(float(rng.uniform(0.4, 1.1)))
    back = float(rng.uniform(0.0, 0.07))
    if kick:
        body.add(box([back, -half + 0.002, 0], [depth, half - 0.002, kick]), base)
    roof = height - top
    wall = max(0.012, float(rng.uniform(1.6, 3.0)) * unit)
    lintel, seam = roof - strip, float(rng.uniform(0.0015, 0.006))
    rooms = [(kick, lintel)]
    if plan == "twin":
        middle = kick + (lintel - kick) * float(rng.uniform(0.4, 0.6))
        rooms = [(kick, middle), (middle, lintel)]
    bays = [
        ([0.0, wall - half, a + wall], [depth - wall, half - wall, b - wall / 2]) for a, b in rooms
    ]
    holes = [box([-0.1, *lo[1:]], hi) for lo, hi in bays]
    body.add(cut(box([0, -half, kick], [depth, half, roof]), holes), case)
    if top:
        over = float(rng.uniform(0.0, 0.03))
        slab = finish.speckled(rng) if rng.random() < 0.4 else face
        body.add(box([front - over, -half - over, roof], [depth, half + over, height]), slab)
        if rng.random() < 0.2:
            splash = [depth - 0.015, -half, height], [depth, half, height + rng.uniform(0.03, 0.1)]
            body.add(box(*splash), slab)
    board = None
    if strip:
        tone = face if rng.random() < 0.5 else finishes.dark(rng)
        if rng.random() < 0.1:
            tone = materials.plain((rng.uniform(0.5, 0.9), 0.1, 0.1))
        panel_front = min(front * float(rng.choice([1.0, rng.uniform(0.3, 1.0)])), -unit)
        board = Board(panel_front, -panel_front, (-half, half), (lintel + seam, roof), unit, tone)
        row_board(rng, board, body, face, 6)
        board.build(body)
    racks = _dish_racks(rng, body, bays, unit) if plan == "flap" else []
    root = asm.add("body", body)
    for (a, b), (bay_lo, bay_hi) in zip(rooms, bays, strict=True):
        lo = np.array([front, 0.001 - half, a + seam / 2])
        hi = np.array([-0.002, half - 0.001, b - seam / 2])
        style, extra = _front_of(rng, lo, hi, look, strip > 0)
        if plan == "flap":
            if thick > 0.08 * (b - a):
                style = dataclasses.replace(style, axis_depth=1.0)
            angle = np.pi / 2 if rng.random() < 0.75 else float(np.deg2rad(rng.uniform(75, 100)))
            add_door(asm, root, lo, hi, "-z", angle, style, beyond=1.0, extra=extra)
            continue
        _tub(rng, asm, root, lo, hi, bay_lo, bay_hi, style, extra, unit)
    for tray, travel in racks:
        asm.add("rack", tray, root, slide((-1, 0, 0), travel))
    if board is not None:
        board.parts(asm, root)
    return asm.object()


def _front_of(rng, lo, hi, look: FrontStyle, stripped: bool) -> tuple[FrontStyle, Shape]:
    """A dishwasher's front: plain mostly, on some a printed strip of keys, a badge or a window."""
    pane_kind = "none" if rng.random() < 0.8 else "rect"
    style, extra = dressed(rng, lo, hi, "+z", look, pane_kind=pane_kind)
    face, unit = float(lo[0]), look.unit
    wide, tall = hi[1] - lo[1], hi[2] - lo[2]
    middle = (lo[1] + hi[1]) / 2
    if not stripped and pane_kind == "none" and look.handle != "lip" and rng.random() < 0.55:
        high = hi[2] - max(0.004, float(rng.uniform(0.003, 0.02)) * tall)
        zone = min(max(0.04, 2.6 * unit), 0.3 * min(wide, tall)) - max(0.012, 1.7 * unit)
        h = min(0.07 * tall, 0.7 * zone)
        half = wide * float(rng.uniform(0.06, 0.48))
        if h > 0.3 * unit:
            plate = [controls.Button(middle, high - h / 2, 2 * half, h)]
            dark = finishes.dark(rng)
            controls.print_buttons(extra, face, plate, 0.0008, dark)
            light = materials.plain(rng.choice([[0.9, 0.9, 0.9], [0.2, 0.55, 0.95]]))
            span = (middle - 0.9 * half, middle + 0.9 * half), (high - 0.8 * h, high - 0.2 * h)
            keys = controls.button_grid(*span, int(rng.integers(3, 12)), 1, rng)
            controls.print_buttons(extra, face - 0.0008, keys, 0.0005, light)
    if pane_kind == "none" and rng.random() < 0.35:
        at = middle + wide * float(rng.choice([0.0, 0.3, -0.3])), lo[2] + 0.15 * tall
        appliance_fronts.badge(extra, rng, face, *at, unit, finishes.dark(rng))
    return style, extra


def _tub(rng, asm: Assembly, root: int, lo, hi, bay_lo, bay_hi, style, extra, unit: float) -> None:
    """A front with a whole tub behind it, that slides out."""
    wall, air = max(0.008, 1.2 * unit), 0.003
    far = bay_lo[0] + (bay_hi[0] - air) * float(rng.uniform(0.75, 1.0))
    tub_lo = np.array([hi[0], bay_lo[1] + air, bay_lo[2] + air])
    tub_hi = np.array([far, bay_hi[1] - air, bay_hi[2] - air])
    tub_hi[2] -= (tub_hi[2] - tub_lo[2]) * float(rng.uniform(0.0, 0.4))
    room = box(tub_lo + wall, [far - wall, tub_hi[1] - wall, tub_hi[2] + 1])
    inside = finishes.metal(rng, brushed=False) if rng.random() < 0.7 else finishes.dark(rng)
    extra.add(cut(box(tub_lo, tub_hi), (room,)), inside)
    pull = float(rng.uniform(0.6, 0.95)) * (far - hi[0])
    carrier = Assembly()  # a flap as its front, hung on nothing
    style = dataclasses.replace(style, own_handle=False)
    add_door(carrier, -1, lo, hi, "-z", np.pi / 2, style, extra=extra)
    name = "drawer" if len(asm.parts) == root + 1 else "drawer_2"
    slides = slide((-1, 0, 0), pull)
    part = dataclasses.replace(
        carrier.parts[0], name=name, parent=root, joint=slides, label="drawer"
    )
    asm.parts.append(part)


def _dish_racks(rng, body: Shape, bays, unit: float) -> list[tuple[Shape, float]]:
    """Baskets of wire that slide out, or that are fixed to the body."""
    kind = str(rng.choice(["none", "slide", "fixed"], p=[0.55, 0.33, 0.12]))
    lo, hi = (np.asarray(v, dtype=np.float64) for v in bays[0])
    if kind == "none" or hi[2] - lo[2] < 0.25:
        return []
    wire = max(0.006, float(rng.uniform(0.8, 1.4)) * unit)
    color = (
        finishes.white_plastic(rng) if rng.random() < 0.4 else finishes.metal(rng, brushed=False)
    )
    count, racks = int(rng.choice([1, 2, 3], p=[0.15, 0.7, 0.15])), []
    pull, openings = float(rng.uniform(0.5, 0.85)), int(rng.integers(3, 7))
    levels = np.linspace(lo[2] + 0.02, hi[2] - 0.02, count + 1)
    for a, b in itertools.pairwise(levels):
        high = a + (b - a) * float(rng.uniform(0.3, 0.75))
        near = np.array([0.012, lo[1] + 0.006, a])
        far = np.array([hi[0] * float(rng.uniform(0.85, 0.98)), hi[1] - 0.006, high])
        if kind == "fixed":
            near[1], far[1] = lo[1], hi[1]
            body.add(appliances.rack(near, far, wire, openings), color)
        else:
            tray = Shape().add(appliances.rack(near, far, wire, openings), color)
            racks.append((tray, pull * far[0]))
    return racks


def _with_lid(rng, width, depth, height, unit, look: FrontStyle, case: Material):
    """A dishwasher that is loaded from above: its lid or hood turns about the rear edge."""
    half = width / 2
    foot = float(rng.uniform(0.02, 0.1)) * height
    hood = height * float(rng.uniform(0.06, 0.3))
    low, wall = height - hood, max(0.012, 2.0 * unit)
    asm, body = Assembly(), Shape()
    body.add(box([0.03, 0.01 - half, 0], [depth - 0.01, half - 0.01, foot]), finishes.dark(rng))
    room = box([wall, wall - half, foot + 0.2 * height], [depth - wall, half - wall, height])
    body.add(cut(box([0, -half, foot], [depth, half, low]), (room,)), look.face)
    root = asm.add("body", body)
    lid, gap = Shape(), low + 0.002
    solid = box([0, -half, gap], [depth, half, height])
    if hood > 3 * wall:
        solid -= box([wall, wall - half, gap - 1], [depth - wall, half - wall, height - wall])
    lid.add(solid, case)
    strip = (gap + 0.15 * hood, height - 0.15 * hood)
    if hood > 6 * unit:
        keys = controls.button_grid(
            (-0.7 * half, 0.7 * half), strip, int(rng.integers(4, 12)), int(rng.integers(1, 3)), rng
        )
        ink = finishes.white_plastic(rng) if case.color[1] < 0.5 else finishes.dark(rng)
        controls.print_buttons(lid, 0.0, keys, 0.001, ink)
    elif rng.random() < 0.7:
        grip = 0.3 * half
        lid.add(box([-2.2 * unit, -grip, gap], [0, grip, gap + 0.6 * hood]), look.hardware)
    angle = np.pi / 2 if rng.random() < 0.6 else float(np.deg2rad(rng.uniform(60, 95)))
    asm.add("lid", lid, root, hinge([depth, 0, gap], (0, 1, 0), angle))
    return asm.object()

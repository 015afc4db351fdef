"""Wall plates of one to four gangs with rockers, toggles, dials, sliders, push buttons and sockets
under flaps; breaker boxes with a door and levers; isolators with a big handle."""

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
    rounded,
    slide,
    tidy,
    tube,
    turn,
    union,
)

KINDS = ("rocker", "pair", "toggle", "dial", "slider", "button", "socket", "flap")
Y_AXIS, Z_AXIS = (0, 1, 0), (0, 0, 1)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A switch on a wall at x = 0, metres, off and shut."""
    kind = rng.choice(["plate", "fuse_box", "isolator"], p=[0.68, 0.18, 0.14])
    return {"plate": _plate, "fuse_box": _fuse_box, "isolator": _isolator}[str(kind)](rng)


def _finish(rng: np.random.Generator) -> Material:
    """White, cream, dark, steel, brass, wood, or a colour."""
    kind = rng.choice(6, p=[0.36, 0.14, 0.14, 0.14, 0.08, 0.14])
    if kind == 0:
        return materials.white_plastic(rng)
    if kind == 1:
        return plain(np.array([0.93, 0.87, 0.72]) * rng.uniform(0.8, 1.05))
    if kind == 2:
        return materials.dark(rng)
    if kind == 3:
        return materials.metal(rng)
    return materials.wood(rng) if kind == 4 else plain(rng.uniform(0.15, 0.9, 3))


def _prism(width: float, height: float, corner: float, x0: float, x1: float, y, z) -> Manifold:
    """A block with rounded corners between two planes x = const, about (y, z)."""
    return extrusion(rounded(width, height, corner), "x", [x0, y, z], x1 - x0)


def _plate(rng: np.random.Generator) -> ArticulatedObject:
    """A plate with gangs in a row or a column, flush or on a box that stands on the wall."""
    count = int(rng.choice([1, 2, 3, 4], p=[0.42, 0.3, 0.16, 0.12]))
    column = rng.random() < 0.4
    size = float(rng.uniform(0.055, 0.075))  # of a gang's insert
    tall = size * float(rng.choice([1.0, rng.uniform(1.2, 1.7)]))
    if column:
        tall = size
    pitch = (tall if column else size) * float(rng.uniform(1.06, 1.25))
    rim = size * float(rng.uniform(0.12, 0.35))
    width, height = size + 2 * rim, tall + 2 * rim
    if column:
        height += (count - 1) * pitch
    else:
        width += (count - 1) * pitch
    thick = size * float(rng.uniform(0.12, 0.2) if rng.random() < 0.6 else rng.uniform(0.35, 0.8))
    corner = size * float(rng.uniform(0.02, 0.25))
    face = _finish(rng)
    insert = face if rng.random() < 0.6 else _finish(rng)
    accent = face.darker(0.75) if rng.random() < 0.5 else _finish(rng)
    if accent.color == insert.color:
        accent = insert.darker(0.8)
    body, asm = Shape(), Assembly()
    deep = max(thick, 0.45 * size)  # the box in the wall behind it
    solid = _prism(width, height, corner, -thick, 0, 0, 0)
    if rng.random() < 0.5:  # a bevelled edge
        raised = _prism(
            width - 0.5 * rim, height - 0.5 * rim, corner, -thick - 0.08 * size, 0, 0, 0
        )
        solid += raised
        front = -thick - 0.08 * size
    else:
        front = -thick
    back = front + deep
    solid += _prism(width - 1.2 * rim, height - 1.2 * rim, corner, front, back + 0.12 * size, 0, 0)
    weights = np.array([0.24, 0.1, 0.14, 0.13, 0.09, 0.1, 0.06, 0.14])
    kinds = [KINDS[rng.choice(8, p=weights)] for _ in range(count)]
    if rng.random() < 0.45:
        kinds = [kinds[0]] * count
    if set(kinds) == {"socket"}:
        kinds[0] = "rocker"
    seed, holes, later = int(rng.integers(2**31)), [], []
    same = rng.random() < 0.7
    tone = {kind: (insert if rng.random() < 0.7 else accent) for kind in KINDS}
    for k, kind in enumerate(kinds):
        off = (k - (count - 1) / 2) * pitch
        at = np.array([front, 0.0, -off]) if column else np.array([front, off, 0.0])
        own = np.random.default_rng(seed if same else seed + k)
        make = globals()[f"_{kind}"]
        cuts, fixed, parts = make(own, at, size, tall, deep, tone[kind], accent)
        holes += cuts
        later.append((fixed, parts))
    body.add(tidy(cut(solid, holes)), face)
    for fixed, _ in later:
        for one, material in fixed:
            body.add(one, material if material is not face else face.darker(0.97))
    if rng.random() < 0.3 and rim > 0.2 * size and not column:  # screws
        for z in (-1, 1):
            at = [-thick - 0.03 * size, 0, z * (height / 2 - 0.4 * rim)]
            screw = cylinder("x", at, 0.12 * size, 0.045 * size, segments=12)
            body.add(screw - solid, materials.metal(rng, brushed=False))
    root = asm.add("plate", body)
    for _, parts in later:
        for name, pieces, joint in parts:
            shape = Shape()
            for one, material in pieces:
                shape.add(one, material)
            asm.add(name, shape, root, joint)
    return asm.object()


def _wedge(w: float, h: float, x, stand: float, back: float, way: int, at) -> Manifold:
    """A rocker's key, w wide and h high, thicker at its top (``way`` 1) or at its foot."""
    y, z = at[1:]
    low, high = (0.25 * stand, stand)
    points = [[z - way * h / 2, x - low], [z, x - 0.3 * stand], [z + way * h / 2, x - high]]
    points += [[z + way * h / 2, x + 0.2 * back], [z, x + back], [z - way * h / 2, x + 0.2 * back]]
    return extrusion(np.array(points), "y", [0, y - w / 2, 0], w)


def _key(rng, at, w: float, h: float, size: float, deep: float, tone, accent, way: int):
    """A rocker about a level axis through its middle: its hole, and the part."""
    x, y, z = at
    stand = min(size * float(rng.uniform(0.1, 0.16)), 0.3 * h)
    back, air = 0.25 * deep, 0.012 * size
    key = _wedge(w, h, x, stand, back, way, at)
    pieces = [(key, tone)]
    if rng.random() < 0.35:  # a light or a mark near one end
        mark = box(
            [x - 2 * size, y - 0.1 * w, z + 0.2 * h], [x + 2 * size, y + 0.1 * w, z + 0.3 * h]
        )
        stripe = mark ^ key.translate((-0.012 * size, 0, 0)) - key
        if stripe.volume() > 1e-12:
            pieces.append((tidy(stripe), accent))
    angle = 2 * np.arctan(0.72 * stand / (h / 2)) * 0.8
    reach = 0.5 * h * angle + 0.05 * size
    air += float(np.hypot(h / 2, stand + 0.1 * back)) - h / 2  # its corners swing past its ends
    low = [x - size, y - w / 2 - 0.012 * size, z - h / 2 - air]
    room = box(low, [x + max(back, reach) + air, y + w / 2 + 0.012 * size, z + h / 2 + air])
    joint = hinge((x + 0.1 * back, y, z), Y_AXIS, way * float(angle))
    return room, ("rocker", pieces, joint)


def _rocker(rng, at, size, tall, deep, tone, accent):
    """One key that fills the gang or most of it."""
    w = size * float(rng.choice([0.94, rng.uniform(0.4, 0.85)]))
    h = tall * float(rng.choice([0.94, rng.uniform(0.5, 0.85)]))
    room, part = _key(rng, at, w, h, size, deep, tone, accent, int(rng.choice([-1, 1])))
    return [room], [], [part]


def _pair(rng, at, size, tall, deep, tone, accent):
    """Two keys side by side."""
    h = tall * float(rng.uniform(0.6, 0.94))
    rooms, parts = [], []
    for side in (-1, 1):
        spot = at + [0, 0.245 * size * side, 0]
        way = int(rng.choice([-1, 1]))
        room, part = _key(rng, spot, 0.44 * size, h, size, deep, tone, accent, way)
        rooms.append(room)
        parts.append(part)
    return rooms, [], parts


def _toggle(rng, at, size, tall, deep, tone, accent):
    """A stub that is flicked up, from pointing down."""
    x, y, z = at
    long, r = size * float(rng.uniform(0.28, 0.5)), size * float(rng.uniform(0.08, 0.13))
    tilt = float(np.deg2rad(rng.uniform(18, 32)))
    pivot = np.array([x + 0.1 * deep, y, z])
    tip = pivot + (long + 0.1 * deep) * np.array([-np.cos(tilt), 0, -np.sin(tilt)])
    if rng.random() < 0.5:  # a bat
        stub = pipe([pivot, tip], 0.7 * r, 10) + ball(tip, r, 12)
    else:
        block = box([-long, -1.2 * r, -0.7 * r], [0, 1.2 * r, 0.7 * r])
        stub = block.rotate((0, -float(np.rad2deg(tilt)), 0)).translate(tuple(pivot))
    way = int(rng.choice([-1, 1]))
    if way < 0:
        stub = stub.mirror((0, 0, 1)).translate((0, 0, 2 * z))
    slot_h = 2 * (0.3 * deep * np.tan(tilt) + 1.8 * r)
    barrel = slot_h / 2 - 0.02 * size
    stub += cylinder("y", pivot - [0, 1.3 * r, 0], 2.6 * r, barrel)
    room = [x - 1, y - 1.4 * r, z - slot_h / 2], [pivot[0] + barrel, y + 1.4 * r, z + slot_h / 2]
    room = box(room[0], np.add(room[1], [0.02 * size, 0, 0]))
    frame_w, frame_h = 4.2 * r, slot_h + 2 * r
    collar = box(
        [x - 0.05 * size, y - frame_w / 2, z - frame_h / 2], [x, y + frame_w / 2, z + frame_h / 2]
    )
    joint = hinge(pivot, Y_AXIS, way * 2 * tilt)
    return [room], [(collar - room, accent)], [("toggle", [(stub, tone)], joint)]


def _dial(rng, at, size, tall, deep, tone, accent):
    """A dimmer's knob or a turn switch, with a mark or a grip across it."""
    x, y, z = at
    r, reach = size * float(rng.uniform(0.22, 0.42)), size * float(rng.uniform(0.14, 0.32))
    foot = x - 0.015 * size
    knob = cylinder("x", [foot - reach, y, z], reach, 0.88 * r, r, 24)
    if rng.random() < 0.5:
        w = 0.2 * r
        bar = box([foot - 1.6 * reach, y - w, z - 0.95 * r], [foot - reach, y + w, z + 0.95 * r])
        pieces = [(knob + bar, tone)]
        tip = box(
            [foot - 1.66 * reach, y - 0.5 * w, z + 0.3 * r],
            [foot - 1.6 * reach, y + 0.5 * w, z + 0.9 * r],
        )
        pieces.append((tip, accent))
    else:
        w = 0.13 * r
        mark = box([foot - 1.08 * reach, y - w, z], [foot - reach, y + w, z + 0.85 * r])
        pieces = [(knob, tone), (mark, accent)]
    ring = tube("x", [x - 0.02 * size, y, z], 0.02 * size, 1.2 * r, 1.06 * r)
    sweep = rng.choice([60, 90, 180, 270, 300, 0])
    at = (x, y, z)
    joint = turn(at, (1, 0, 0)) if sweep == 0 else hinge(at, (1, 0, 0), float(np.deg2rad(sweep)))
    return [], [(ring, accent)], [("dial", pieces, joint)]


def _slider(rng, at, size, tall, deep, tone, accent):
    """A dimmer's slider in an upright slot, low at rest."""
    x, y, z = at
    long, w = 0.86 * tall, 0.05 * size
    h, half = size * float(rng.uniform(0.1, 0.2)), size * float(rng.uniform(0.14, 0.3))
    reach = size * float(rng.uniform(0.1, 0.2))
    slot = box([x - 1, y - w, z - long / 2], [x + 0.4 * deep, y + w, z + long / 2])
    low = z - long / 2 + 0.04 * size
    grip = box([x - reach, y - half, low], [x - 0.012 * size, y + half, low + h])
    stem = box(
        [x - 0.02 * size, y - 0.7 * w, low + 0.2 * h], [x + 0.3 * deep, y + 0.7 * w, low + 0.8 * h]
    )
    line = box(
        [x - reach - 0.012 * size, y - half, low + 0.4 * h], [x - reach, y + half, low + 0.6 * h]
    )
    edge = box([x - 0.015 * size, y - 2.4 * w, z - 0.53 * long], [x, y + 2.4 * w, z + 0.53 * long])
    hollow = box([x - 1, y - 1.4 * w, z - 0.51 * long], [x + 1, y + 1.4 * w, z + 0.51 * long])
    parts = [
        ("slider", [(grip + stem, tone), (line, accent)], slide(Z_AXIS, long - h - 0.09 * size))
    ]
    clear = box([x - 0.011 * size, y - 9 * w, z - long], [x, y + 9 * w, z + long])
    return [slot], [((edge - hollow) ^ clear, accent)], parts


def _button(rng, at, size, tall, deep, tone, accent):
    """A push button, round, square or a red mushroom, in a ring."""
    x, y, z = at
    r, stand = size * float(rng.uniform(0.16, 0.42)), size * float(rng.uniform(0.08, 0.25))
    go = min(0.7 * stand, 0.5 * deep)
    air = 0.015 * size
    kind = rng.choice(["round", "square", "mushroom"], p=[0.45, 0.3, 0.25])
    if kind == "square":
        stud = box([x - stand, y - r, z - r], [x + 0.2 * deep, y + r, z + r])
        room = box(
            [x - 1, y - r - air, z - r - air], [x + 0.25 * deep + go, y + r + air, z + r + air]
        )
        outer = _prism(2.6 * r, 2.6 * r, 0.2 * r, x - 0.25 * stand, x, y, z)
    else:
        neck = r if kind == "round" else 0.55 * r
        stud = cylinder("x", [x - stand, y, z], stand + 0.2 * deep, neck, segments=22)
        room = cylinder("x", [x - 1, y, z], 1 + 0.25 * deep + go, neck + air, segments=22)
        outer = cylinder("x", [x - 0.2 * stand, y, z], 0.2 * stand, neck + 0.2 * r, segments=22)
        if kind == "mushroom":
            outer = cylinder("x", [x - 0.1 * stand, y, z], 0.1 * stand, 0.9 * r, segments=22)
            head = cylinder("x", [x - 1.3 * stand - 0.3 * r, y, z], 0.3 * r, 0.8 * r, 1.05 * r, 22)
            head += cylinder("x", [x - 1.3 * stand, y, z], 0.3 * stand, 1.05 * r, segments=22)
            stud += head
            go = min(0.7 * stand, 0.5 * deep)
            tone = plain((0.8, 0.08, 0.06)) if rng.random() < 0.8 else tone
    joint = slide((1, 0, 0), go)
    return [room], [(outer - room, accent)], [("button", [(stud, tone)], joint)]


def _socket(rng, at, size, tall, deep, tone, accent):
    """A socket: a round well with holes, or slots. Nothing moves."""
    x, y, z = at
    dark = accent.darker(0.25)
    if rng.random() < 0.5:
        r = 0.36 * size
        well = cylinder("x", [x - 1, y, z], 1 + 0.35 * deep, r, segments=26)
        pins = [
            cylinder(
                "x",
                [x + 0.34 * deep, y + s * 0.18 * size, z],
                0.02 * size,
                0.05 * size,
                segments=10,
            )
            for s in (-1, 1)
        ]
        return [well], [(p.translate((-0.02 * size, 0, 0)), dark) for p in pins], []
    slots = [
        box([x - 0.008 * size, y + a - b, z + c - d], [x, y + a + b, z + c + d])
        for a, b, c, d in ((-0.16 * size, 0.03 * size, 0.05 * size, 0.11 * size),
                           (0.16 * size, 0.03 * size, 0.05 * size, 0.11 * size),
                           (0.0, 0.05 * size, -0.2 * size, 0.05 * size))
    ]  # fmt: skip
    return [], [(union(slots), dark)], []


def _flap(rng, at, size, tall, deep, tone, accent):
    """A socket under a flap hinged at its top."""
    x, y, z = at
    cuts, fixed, _ = _socket(rng, at, size, tall, deep, tone, accent)
    w, h = size * float(rng.uniform(0.86, 0.97)), min(tall, 1.2 * size) * 0.94
    thick, air = size * float(rng.uniform(0.05, 0.13)), 0.012 * size
    lid = _prism(w, h, size * float(rng.uniform(0.02, 0.2)), x - air - thick, x - air, y, z)
    lip = box(
        [x - air - 1.7 * thick, y - 0.25 * w, z - h / 2],
        [x - air - 0.5 * thick, y + 0.25 * w, z - h / 2 + 0.1 * h],
    )
    knuckle = cylinder("y", [x - air - thick, y - 0.4 * w, z + h / 2], 0.8 * w, 0.6 * thick)
    solid = tidy(union([lid, lip, knuckle]) ^ box([-1, -2, -2], [x - air, 2, 2]))
    angle = float(np.deg2rad(rng.uniform(80, 150)))
    joint = hinge((x - air - thick, y, z + h / 2), Y_AXIS, angle)
    return cuts, fixed, [("flap", [(solid, tone)], joint)]


def _fuse_box(rng: np.random.Generator) -> ArticulatedObject:
    """Breakers in one or two rows whose levers flick up, behind a door or open."""
    rows = int(rng.choice([1, 2], p=[0.7, 0.3]))
    width = float(rng.uniform(0.16, 0.4))
    row_h = float(rng.uniform(0.11, 0.17))
    height, deep = rows * row_h + 0.05, float(rng.uniform(0.06, 0.1))
    unit = max(width, height) / 100
    wall = 1.6 * unit + 0.002
    face = _finish(rng) if rng.random() < 0.5 else materials.white_plastic(rng)
    inner = materials.white_plastic(rng) if rng.random() < 0.6 else face.darker(0.8)
    door = rng.random() < 0.75
    case = _prism(width, height, float(rng.uniform(0.5, 4)) * unit, -deep, 0, 0, 0)
    plane = -0.45 * deep  # of the breakers' fronts
    well = box(
        [-1, wall - width / 2, wall - height / 2], [plane, width / 2 - wall, height / 2 - wall]
    )
    asm, body = Assembly(), Shape()
    body.add(tidy(case - well), face)
    count = int(rng.integers(2, 6)) if rows == 1 else int(rng.integers(1, 4))
    room = width - 2 * wall - 2 * unit
    pitch = min(room / count, 12 * unit if rng.random() < 0.5 else 18 * unit)
    tone = materials.dark(rng) if rng.random() < 0.6 else plain(rng.uniform(0.1, 0.8, 3))
    block = float(rng.uniform(0.1, 0.2)) * deep
    levers = []
    for row in range(rows):
        z = (row - (rows - 1) / 2) * row_h
        half = 0.4 * row_h
        shift = float(rng.uniform(-0.5, 0.5)) * (room - count * pitch)
        for k in range(count):
            y = shift + (k - (count - 1) / 2) * pitch
            w = 0.47 * pitch
            back = plane - block
            solid = box([back, y - w, z - half], [plane + 1e-4, y + w, z + half])
            lw, lh = min(0.6 * w, 2.6 * unit), max(0.1 * half, 1.3 * unit)
            pivot = np.array([back + 0.2 * block, y, z])
            reach = 0.28 * deep
            tilt = float(np.deg2rad(rng.uniform(22, 35)))
            bar = box([-reach, -lw, -lh / 2], [0, lw, lh / 2])
            bar = bar.rotate((0, -float(np.rad2deg(tilt)), 0)).translate(tuple(pivot))
            swept = lh / 2 + 0.3 * unit + 0.3 * block * np.tan(tilt) + 0.6 * lh
            slot = box(
                [-1, y - lw - 0.3 * unit, z - swept],
                [back + 0.9 * block, y + lw + 0.3 * unit, z + swept],
            )
            body.add(solid - slot, inner)
            levers.append((bar, hinge(pivot, Y_AXIS, 2 * tilt)))
    root = asm.add("case", body)
    for bar, joint in levers:
        asm.add("lever", Shape().add(bar, tone), root, joint)
    if door:
        _door(rng, asm, root, width, height, deep, unit, face)
    return asm.object()


def _door(rng, asm: Assembly, root: int, width, height, deep, unit, face: Material) -> None:
    """A flap or a side door over a case's front, clear or opaque."""
    air, thick = 0.4 * unit, float(rng.uniform(1.5, 3.0)) * unit
    edge = str(rng.choice(["left", "right", "top"], p=[0.4, 0.3, 0.3]))
    less = 0.0 if rng.random() < 0.6 else 1.2 * unit  # a frame about it
    w, h = width - less, height - less
    look = materials.glass(rng) if rng.random() < 0.35 else face
    look = _finish(rng) if rng.random() < 0.2 else look
    x1 = -deep - air
    leaf = _prism(w, h, 2 * unit, x1 - thick, x1, 0, 0)
    shape = Shape().add(leaf, look)
    x = x1 - thick
    free = {"left": (0.42 * w, 0), "right": (-0.42 * w, 0), "top": (0, -0.42 * h)}[edge]
    pull = (1.2 * unit, 5 * unit) if edge != "top" else (5 * unit, 1.2 * unit)
    grip = box(
        [x - 2 * unit, free[0] - pull[0], free[1] - pull[1]],
        [x, free[0] + pull[0], free[1] + pull[1]],
    )
    shape.add(grip, materials.hardware(rng))
    swing = float(np.deg2rad(rng.uniform(85, 150)))
    at = {"left": (x, -w / 2, 0), "right": (x, w / 2, 0), "top": (x, 0, h / 2)}[edge]
    axis = {"left": Z_AXIS, "right": (0, 0, -1), "top": Y_AXIS}[edge]
    asm.add("door", shape, root, hinge(at, axis, swing))


def _isolator(rng: np.random.Generator) -> ArticulatedObject:
    """A box with a big switch: a handle on its side, a turning handle in front, or push buttons."""
    width, height = float(rng.uniform(0.08, 0.22)), float(rng.uniform(0.1, 0.32))
    deep = float(rng.uniform(0.4, 0.8)) * min(width, height)
    unit = max(width, height, deep) / 100
    face = _finish(rng)
    strong = [(0.8, 0.08, 0.06), (0.9, 0.75, 0.1), (0.1, 0.5, 0.2), (0.1, 0.1, 0.1)]
    tone = plain(strong[rng.integers(4)])
    yellow = (
        plain((0.92, 0.76, 0.12)) if rng.random() < 0.5 else materials.metal(rng, brushed=False)
    )
    case = _prism(width, height, float(rng.uniform(0.5, 6)) * unit, -deep, 0, 0, 0)
    asm, body, parts = Assembly(), Shape(), []
    kind = str(rng.choice(["side", "front", "buttons"], p=[0.4, 0.35, 0.25]))
    if kind == "buttons":
        count = int(rng.choice([1, 2, 3], p=[0.25, 0.5, 0.25]))
        pitch = height / count
        size = min(width, pitch) * 0.9
        tones = [plain((0.1, 0.5, 0.2)), plain((0.8, 0.08, 0.06)), materials.dark(rng)]
        holes, fixed = [], []
        for k in range(count):
            at = np.array([-deep, 0, ((count - 1) / 2 - k) * pitch])
            cuts, rings, made = _button(rng, at, size, size, 0.8 * deep, tones[k], yellow)
            holes, fixed, parts = holes + cuts, fixed + rings, parts + made
        case = tidy(cut(case, holes))
        body.add(union([one for one, _ in fixed]), yellow)
    elif kind == "front":
        r = min(width, height) * float(rng.uniform(0.22, 0.4))
        z = float(rng.uniform(-0.1, 0.15)) * height
        disc = cylinder("x", [-deep - unit, 0, z], unit, 1.2 * r, segments=28)
        body.add(disc, yellow)
        x, long = -deep - 1.4 * unit, r * float(rng.uniform(0.9, 1.3))
        hub = cylinder("x", [x - 0.4 * r, 0, z], 0.4 * r, 0.75 * r, segments=22)
        w = 0.22 * r
        bar = hull(np.array([[x - a, y, z + b] for a, s in ((0.3 * r, 1.0), (0.9 * r, 0.7))
                             for y in (-w * s, w * s) for b in (-0.5 * r, long)]))  # fmt: skip
        sweep = float(np.deg2rad(rng.choice([90, 90, 60, 180])))
        parts.append(
            (
                "handle",
                [(tidy(hub + bar), tone)],
                hinge((x, 0, z), (rng.choice([-1, 1]), 0, 0), sweep),
            )
        )
    else:
        side = int(rng.choice([-1, 1]))
        z, r = float(rng.uniform(-0.15, 0.15)) * height, 0.24 * min(deep, height)
        y = side * (width / 2 + 0.4 * unit)
        long = height * float(rng.uniform(0.35, 0.6))
        t = max(2.2 * unit, 0.25 * r)
        x = -deep * float(rng.uniform(0.4, 0.6))
        lean = float(np.deg2rad(rng.uniform(15, 35)))
        lo, hi = sorted((y, y + side * 2 * t))
        tip = np.array([x - long * np.cos(lean), 0, z - long * np.sin(lean)])
        hub = cylinder("y", [x, lo, z], hi - lo, r, segments=20)
        end = cylinder("y", [tip[0], lo, tip[2]], hi - lo, 0.4 * r, segments=14)
        root_end = cylinder("y", [x, lo, z], hi - lo, 0.55 * r, segments=14)
        arm = Manifold.batch_hull([root_end, end])
        reach = y + side * float(rng.uniform(2.5, 5)) * t
        knob = pipe([[tip[0], y + side * t, tip[2]], [tip[0], reach, tip[2]]], 0.42 * r, 12)
        knob = cut(
            knob,
            [box([-2, min(-9.0, 0), -2], [2, lo, 2]) if side > 0 else box([-2, hi, -2], [2, 9, 2])],
        )
        handle = [(tidy(union([hub, arm])), materials.hardware(rng)), (tidy(knob - arm), tone)]
        parts.append(("handle", handle, hinge((x, 0, z), Y_AXIS, 2 * lean)))
    body.add(case, face)
    if kind == "side":  # a lid's frame and a sign
        w, h = 0.9 * width, 0.9 * height
        lid = _prism(w, h, 2 * unit, -deep - 0.8 * unit, -deep, 0, 0)
        sign = _prism(0.5 * w, 0.25 * h, unit, -deep - 1.2 * unit, -deep - 0.8 * unit, 0, 0.2 * h)
        body.add(lid, _finish(rng) if rng.random() < 0.4 else face.darker(0.93))
        body.add(sign, yellow)
    if rng.random() < 0.6:  # cable glands
        for y in (-0.25 * width, 0.25 * width) if rng.random() < 0.5 else (0.0,):
            gland = cylinder(
                "z",
                [-0.5 * deep, y, -height / 2 - 0.12 * width],
                0.12 * width,
                0.12 * width,
                segments=6,
            )
            body.add(gland, materials.dark(rng))
    root = asm.add("case", body)
    for name, pieces, joint in parts:
        shape = Shape()
        for one, material in pieces:
            shape.add(one, material)
        asm.add(name, shape, root, joint)
    return asm.object()

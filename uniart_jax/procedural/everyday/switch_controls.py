"""Controls of wall switches: rockers, toggles, dials, sliders, push buttons, sockets and flaps; and
finishes of switches.

Each control sits at a point of a face x = const, in a gang ``size`` wide and ``tall`` high, over a
box ``deep`` metres deep. Its function returns the holes to cut, the fixed pieces and the moving
parts (name, pieces, joint), in metres. All take the same arguments, for they are chosen by name;
not all need every one.
"""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.shapes import (
    ball,
    box,
    cylinder,
    extrusion,
    hinge,
    pipe,
    rounded,
    slide,
    tidy,
    tube,
    turn,
    union,
)

Y_AXIS, Z_AXIS = (0, 1, 0), (0, 0, 1)


def draw_finish(rng: np.random.Generator) -> Material:
    """Draw a finish: white, cream, dark, steel, brass, wood or a colour."""
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


def rounded_block(
    width: float, height: float, corner: float, x0: float, x1: float, y, z
) -> Manifold:
    """A block (metres) with rounded corners between the planes ``x0`` and ``x1``, about (y, z)."""
    return extrusion(rounded(width, height, corner), "x", [x0, y, z], x1 - x0)


def _wedge(w: float, h: float, x, stand: float, back: float, way: int, at) -> Manifold:
    """A rocker's key, w wide and h high, thicker at its top (``way`` 1) or at its foot."""
    y, z = at[1:]
    low, high = (0.25 * stand, stand)
    points = [[z - way * h / 2, x - low], [z, x - 0.3 * stand], [z + way * h / 2, x - high]]
    points += [[z + way * h / 2, x + 0.2 * back], [z, x + back], [z - way * h / 2, x + 0.2 * back]]
    return extrusion(np.array(points), "y", [0, y - w / 2, 0], w)


def _key(rng, at, w: float, h: float, size: float, deep: float, tone, accent, way: int):
    """A rocker about a horizontal axis through its middle: its hole, and the part."""
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


def push_button(rng, at, size, tall, deep, tone, accent):
    """A push button in a ring (metres), round, square or a red mushroom: holes, fixed pieces,
    moving parts."""
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
        outer = rounded_block(2.6 * r, 2.6 * r, 0.2 * r, x - 0.25 * stand, x, y, z)
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
    lid = rounded_block(w, h, size * float(rng.uniform(0.02, 0.2)), x - air - thick, x - air, y, z)
    lip = box(
        [x - air - 1.7 * thick, y - 0.25 * w, z - h / 2],
        [x - air - 0.5 * thick, y + 0.25 * w, z - h / 2 + 0.1 * h],
    )
    knuckle = cylinder("y", [x - air - thick, y - 0.4 * w, z + h / 2], 0.8 * w, 0.6 * thick)
    solid = tidy(union([lid, lip, knuckle]) ^ box([-1, -2, -2], [x - air, 2, 2]))
    angle = float(np.deg2rad(rng.uniform(80, 150)))
    joint = hinge((x - air - thick, y, z + h / 2), Y_AXIS, angle)
    return cuts, fixed, [("flap", [(solid, tone)], joint)]


CONTROLS = {
    "rocker": _rocker,
    "pair": _pair,
    "toggle": _toggle,
    "dial": _dial,
    "slider": _slider,
    "button": push_button,
    "socket": _socket,
    "flap": _flap,
}

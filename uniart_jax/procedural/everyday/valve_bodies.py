"""Valves on a pipe: bodies with bonnets, stems, yokes and gear boxes; hand wheels and levers.
Lengths are in metres."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.procedural.everyday.pipe_fittings import Look, Pieces, Works, placement
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import (
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
    turn,
    union,
)

X, Y, Z = np.eye(3)


def hand_wheel(rng, look: Look, grip: Material, radius: float, z: float) -> Pieces:
    """A hand wheel of ``radius`` metres about the z axis, the underside of its hub at ``z``."""
    wire, hub = radius * float(rng.uniform(0.09, 0.14)), 0.24 * radius
    high = z + wire + (0.28 * radius if look.wheel == "dished" else 0.05 * radius)
    boss = cylinder("z", [0, 0, z], 0.3 * radius, hub, 0.85 * hub)
    nut = cylinder("z", [0, 0, z + 0.3 * radius], 0.1 * radius, 0.45 * hub, segments=6)
    pieces = [boss]
    if look.wheel in ("flat", "dished"):
        angle = np.linspace(0, 2 * np.pi, 6, endpoint=False)
        ring = np.column_stack([radius - wire + wire * np.cos(angle), high + wire * np.sin(angle)])
        pieces.append(revolution(ring, "z", [0, 0, 0], 22))
        count = int(rng.integers(3, 7))
        rod = pipe([[0, 0, z + 0.14 * radius], [radius - wire, 0, high]], 0.75 * wire, 6)
        pieces += [rod.rotate((0, 0, 360 * k / count)) for k in range(count)]
        if rng.random() < 0.2:  # a crank's knob on the rim
            pieces.append(cylinder("z", [radius - wire, 0, high], 0.35 * radius, 1.1 * wire))
    elif look.wheel == "disc":
        plate = cylinder("z", [0, 0, z + 0.06 * radius], 0.16 * radius, radius, segments=32)
        count = int(rng.integers(3, 6))
        hole = cylinder("z", [0.62 * radius, 0, z - radius], 3 * radius, 0.2 * radius, segments=14)
        pieces.append(cut(plate, [hole.rotate((0, 0, 360 * k / count)) for k in range(count)]))
    elif look.wheel == "star":
        count = int(rng.integers(4, 9))
        lump = cylinder("z", [0, 0, z + 0.05 * radius], 0.5 * radius, radius, 0.94 * radius, 32)
        gap = 1.3 * radius / count
        bite = cylinder("z", [radius + 0.3 * gap, 0, z - radius], 3 * radius, gap, segments=14)
        pieces.append(cut(lump, [bite.rotate((0, 0, 360 * k / count)) for k in range(count)]))
        return [(union(pieces), grip)]
    else:
        ends = [[-radius, 0, z + 0.2 * radius], [radius, 0, z + 0.2 * radius]]
        pieces += [pipe(ends, 0.11 * radius), *(ball(p, 0.17 * radius) for p in ends)]
    return [(union(pieces), grip), (nut, look.metal)]


def lever_handle(rng, look: Look, grip: Material, r: float, long: float, z: float) -> Pieces:
    """A lever (metres) from the z axis towards +y, the underside of its hub at ``z``."""
    thick, half = 0.2 * r, 0.38 * r
    hub = cylinder("z", [0, 0, z], 0.5 * r, 0.6 * r)
    nut = cylinder("z", [0, 0, z + 0.5 * r], 0.25 * r, 0.36 * r, segments=6)
    if look.lever == "rod":
        end = [0, long, z + 0.25 * r + long * float(rng.uniform(0.0, 0.35))]
        rod = pipe([[0, 0, z + 0.25 * r], end], 0.2 * r, 10)
        return [(ball(end, 0.42 * r, 14), grip), (union([hub, rod]), look.metal)]
    if look.lever == "wings":
        high = float(rng.uniform(0.5, 0.9)) * r
        points = [[x, s * y, z + a] for s in (-1, 1) for y, x, a in (
            (0.3 * r, 0.3 * r, 0.05 * r), (0.3 * r, -0.3 * r, 0.05 * r),
            (1.5 * r, 0.25 * r, high), (1.5 * r, -0.25 * r, high))]  # fmt: skip
        lift = [[0.25 * r * s, 1.5 * r * t, z + high + 0.5 * r] for s in (-1, 1) for t in (-1, 1)]
        low = [[0.3 * r * s, 0.3 * r * t, z + 0.5 * r] for s in (-1, 1) for t in (-1, 1)]
        corners = np.array([*points, *lift, *low])
        wings = [hull(corners[s * corners[:, 1] > 0]) for s in (-1, 1)]
        return [(union([hub, *wings]), grip), (nut, look.metal)]
    rise = float(rng.uniform(0, 0.9)) * r
    line = np.array([[-0.5 * r, z], [0.8 * r, z], [0.8 * r + rise, z + rise], [long, z + rise]])
    bar = extrusion(np.vstack([line, line[::-1] + [0, thick]]), "x", [-half, 0, 0], 2 * half)
    bar = union([bar, cylinder("z", [0, 0, z + 0.01 * r], 1.1 * thick, 0.75 * r)])
    nut = nut.translate((0, 0, 1.08 * thick - 0.5 * r))
    start = 0.8 * r + rise + float(rng.uniform(0.1, 0.3)) * (long - r)
    sleeve = extrusion(
        rounded(2.6 * thick, 2.7 * half, thick),
        "y",
        [0, start, z + rise + thick / 2],
        long * 1.02 - start,
    )
    pieces = [(sleeve, grip), (bar, look.metal), (nut, look.metal)]
    return pieces if rng.random() < 0.7 else [(union([bar, sleeve]), grip), (nut, look.metal)]


def valve_on_pipe(rng, look: Look, r: float, grip: Material, kind: str, room: float):
    """A valve (metres) on a pipe along y, its stem along +z. Returns its works, half its length,
    and its reach along +y and -y.

    ``kind``: 'gate', 'globe' or 'needle' with a wheel, 'ball' or 'wafer' with a lever, 'gear' with
    a wheel beside it. ``room``: how far wheels and levers may reach at most.
    """
    half = r * float(rng.uniform(2.0, 3.0))
    clear = 2.0 * r if look.joint == "flange" else 1.6 * r
    if kind in ("gate", "globe", "needle"):
        return _wheel_valve(rng, look, r, grip, kind, room, half, clear)
    return _quarter_turn_valve(rng, look, r, grip, kind, room, clear)


def _wheel_valve(rng, look: Look, r: float, grip: Material, kind: str, room: float, half, clear):
    """A gate, globe or needle valve. Its wheel turns, screws its stem out, or turns in a yoke
    beside a rising stem."""
    works = Works()
    neck = r * float(rng.uniform(2.2, 3.2))
    if kind == "gate":
        lump = cylinder("z", [0, 0, -1.25 * r], 1.25 * r + 0.8 * neck, 1.15 * r, 0.95 * r)
        lump += _hull_of_discs([("y", -half, 1.1 * r), ("y", half, 1.1 * r)])
    elif kind == "globe":
        lump = ball([0, 0, 0], 1.6 * r, 20) + cylinder("z", [0, 0, 0], 0.8 * neck, 0.9 * r)
    else:
        half = 1.5 * r
        lump = box([-1.3 * r, -half, -1.3 * r], [1.3 * r, half, 1.3 * r])
    plate = cylinder(
        "z", [0, 0, 0.75 * neck], 0.4 * r, 1.4 * r, segments=6 if look.joint == "nut" else 24
    )
    bonnet = cylinder("z", [0, 0, 0], neck + 0.5 * r, 0.8 * r, 0.6 * r)
    top = max(neck + 0.5 * r, clear)
    bonnet += cylinder("z", [0, 0, neck], top - neck + 0.3 * r, 0.57 * r)
    top += 0.3 * r
    size = min(r * float(rng.uniform(1.6, 3.4)), room)
    stem, rise = 0.28 * r, r * float(rng.uniform(0.9, 1.7))
    gap = r * float(rng.uniform(0.15, 0.9))
    solid = union([lump, bonnet, plate])
    manner = str(rng.choice(["turn", "screw", "yoke"], p=[0.4, 0.4, 0.2]))
    wheel = hand_wheel(rng, look, grip, size, top + gap)
    if manner == "yoke" and look.wheel in ("flat", "dished", "disc"):
        solid -= _yoke(rng, works, look, r, top, size, wheel, gap)
    elif manner == "turn":
        post = cylinder("z", [0, 0, top - 0.1 * r], gap + 0.06 * r, stem)
        works.body.append((post, look.metal))
        works.moving.append(("wheel", wheel, turn((0, 0, 0), Z)))
    else:  # the stem winds out of the bonnet
        bore = cylinder("z", [0, 0, top - rise - 0.4 * r], 9 * r, stem + 0.06 * r)
        rod = cylinder("z", [0, 0, top - rise - 0.3 * r], rise + 0.4 * r + gap, stem)
        rings = [
            cylinder("z", [0, 0, top + gap * k / 4], gap / 8, stem + 0.05 * r) for k in range(1, 4)
        ]
        solid -= bore
        works.moving.append(
            ("wheel", [*wheel, (union([rod, *rings]), look.metal)],
             screw((0, 0, 0), Z, float(rng.choice([2, 3, 4, 6])), rise,
                   left_handed=rng.random() < 0.1))
        )  # fmt: skip
    works.body.insert(0, (tidy(solid), look.body))
    return works, half, 1.18 * size, 1.18 * size


def _quarter_turn_valve(rng, look: Look, r: float, grip: Material, kind: str, room: float, clear):
    """A ball or butterfly valve with a lever, or a gear box with a wheel on its side."""
    works = Works()
    if kind == "ball":
        half = r * float(rng.uniform(1.4, 2.0))
        sides = int(rng.choice([6, 8, 24]))
        lump = cylinder("y", [0, -half, 0], 2 * half, 1.35 * r, segments=sides)
        if rng.random() < 0.5:
            lump += ball([0, 0, 0], 1.53 * r, 18)
        top = max(1.9 * r, clear)
    else:
        half = r * float(rng.uniform(0.5, 0.7))
        lump = cylinder("y", [0, -half, 0], 2 * half, 1.85 * r, segments=28)
        top = r * float(rng.uniform(2.6, 3.3))
    neck = cylinder("z", [0, 0, 0], top, 0.5 * r)
    if kind == "gear":
        case = box([-0.9 * r, -1.1 * r, top - 0.2 * r], [0.9 * r, 1.1 * r, top + 1.4 * r])
        works.body.append((tidy(union([lump, neck, case])), look.body))
        size = min(r * float(rng.uniform(1.3, 2.2)), room)
        wheel = hand_wheel(rng, look, grip, size, 0.7 * r)
        shaft = cylinder("z", [0, 0, -0.1 * r], 0.76 * r, 0.28 * r)
        place = placement(Z, -X, [-0.9 * r, 0, top + 0.6 * r])
        works.take(Works([(shaft, look.metal)], [("wheel", wheel, turn((0, 0, 0), Z))]), place)
        return works, half, 1.18 * size, 1.18 * size
    if kind == "wafer":  # a plate under the lever
        plate = cylinder("z", [0, 0, top - 0.2 * r], 0.2 * r, 1.1 * r, segments=20)
        neck += plate
    works.body.append((tidy(union([lump, neck])), look.body))
    long = min(r * float(rng.uniform(3.2, 6.0)), room)
    pieces = lever_handle(rng, look, grip, r, long, top + 0.04 * r)
    sign = int(rng.choice([-1, 1]))
    joint = hinge((0, 0, 0), Z, sign * np.pi / 2)
    if rng.random() < 0.35:  # shut: across the pipe
        pieces = [(s.rotate((0, 0, 90 * sign)), m) for s, m in pieces]
        joint = hinge((0, 0, 0), Z, -sign * np.pi / 2)
    works.moving.append(("lever", pieces, joint))
    return works, half, (1.8 * r if look.lever == "wings" else long), 1.8 * r


def _hull_of_discs(discs) -> Manifold:
    """The convex hull of thin discs (axis, place on the y axis, radius)."""
    return union([cylinder(a, at * Y, 1e-3, r) for a, at, r in discs]).hull()


def _yoke(rng, works: Works, look: Look, r: float, top: float, size: float, wheel, gap) -> Manifold:
    """Add two columns, a bridge with a wheel on it, and a stem that rises through the wheel;
    returns the stem's bore."""
    high, stem = 1.3 * r + gap, 0.3 * min(r, 0.5 * size)
    for s in (-0.75, 0.75):
        column = box([s * r - 0.2 * r, -0.3 * r, top - r], [s * r + 0.2 * r, 0.3 * r, top + high])
        works.body.append((column, look.body))
    bridge = box([-r, -0.35 * r, top + high - 0.3 * r], [r, 0.35 * r, top + 1.01 * high])
    base = cylinder("z", [0, 0, top - 0.5 * r], 0.3 * r, 1.1 * r)
    bore = cylinder("z", [0, 0, top - 0.1 * r], 9 * size, stem + 0.04 * r)
    works.body += [(bridge - bore, look.body), (base, look.body)]
    lift = 1.01 * high + 0.03 * r - gap
    turned = [(s.translate((0, 0, lift)) - bore, m) for s, m in wheel]
    works.moving.append(("wheel", turned, turn((0, 0, 0), Z)))
    tip = top + high + 0.45 * size + r * float(rng.uniform(0.1, 0.8))
    rod = cylinder("z", [0, 0, top - 0.05 * r], tip - top + 0.05 * r, stem)
    rise = high * float(rng.uniform(0.5, 0.9))
    works.moving.append(("stem", [(rod, look.metal)], slide(Z, rise)))
    return bore

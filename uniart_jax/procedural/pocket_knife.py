"""Small tools about one pivot or more: folding knives and razors, cutters with a sliding blade,
nail clippers, folding rulers, hole punches, pliers, tongs, nutcrackers and clothes pegs."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
from manifold3d import CrossSection, Manifold, OpType

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
    rounded,
    slide,
    tidy,
    turn,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A small tool, metres, closed.

    Made in a frame (u along it, v across, w through its layers), then turned into the room.
    """
    kinds = (_folding, _cutter, _clippers, _ruler, _punch, _pliers, _tongs, _peg)
    share = [0.3, 0.13, 0.08, 0.08, 0.1, 0.12, 0.12, 0.07]
    make = kinds[rng.choice(len(kinds), p=share)]
    turned, asm = _pose(rng, lying=make in (_punch, _clippers)), Assembly()
    for name, shape, parent, joint in make(rng):
        if joint is not None:
            at, axis = turned[:3, :3] @ joint.origin, turned[:3, :3] @ joint.direction
            joint = dataclasses.replace(joint, origin=at, direction=axis)
        asm.add(name, shape.moved(turned), parent, joint)
    return asm.object()


def _pose(rng: np.random.Generator, lying: bool) -> np.ndarray:
    """A rotation [4, 4]: flat on a table, or with the flat side to the front; any way round."""
    angle = np.pi / 2 * int(rng.integers(4)) + float(rng.choice([0.0, rng.uniform(-0.7, 0.7)]))
    c, s = np.cos(angle), np.sin(angle)
    matrix = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1]])
    if lying or rng.random() < 0.4:
        return matrix
    stand = np.array([[0.0, 0, -1, 0], [0, -1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]])
    return stand @ matrix


def _tone(rng: np.random.Generator) -> Material:
    """Bright plastic, wood, dark plastic, horn or metal."""
    kind = rng.choice(5, p=[0.42, 0.16, 0.18, 0.1, 0.14])
    if kind == 0:
        return plain(materials.hsv(rng, (0, 1), (0.45, 0.95), (0.4, 0.95)))
    if kind == 1:
        return materials.wood(rng, grain="x")
    if kind == 2:
        return materials.dark(rng)
    return plain(rng.uniform(0.7, 0.95, 3)) if kind == 3 else materials.metal(rng, brushed=False)


def _scale(rng: np.random.Generator, length: float, high: float) -> np.ndarray:
    """A handle's side view (u, v): blunt or round ends, some tapered or waved for the fingers."""
    u = np.linspace(-1, 1, 31)
    power, taper = float(rng.uniform(3, 9)), float(rng.uniform(-0.12, 0.12))
    wave = float(rng.choice([0.0, rng.uniform(0.03, 0.1)]))
    end = np.maximum(1 - np.abs(u) ** power, 0) ** (2 / power)
    top = 0.5 * high * end * 0.94
    low = -0.5 * high * end * (1 + taper * u + wave * np.sin(float(rng.uniform(5, 10)) * u))
    return np.vstack([np.column_stack([u, top]), np.column_stack([u, low])[-2:0:-1]]) * [
        length / 2,
        1,
    ]


def _blade(rng: np.random.Generator, long: float, edge: float, back: float) -> CrossSection:
    """A blade's side view from its pivot at 0 towards -u, its edge down: knives of several points,
    saws, drivers, bottle openers."""
    kind = rng.choice(
        ["drop", "spear", "sheep", "saw", "driver", "opener"], p=[0.3, 0.2, 0.2, 0.1, 0.1, 0.1]
    )
    tips = {
        "drop": [[0.72, -edge], [0.9, -0.5 * edge], [1, 0.5 * back], [0.7, back]],
        "spear": [[0.7, -edge], [1, 0.2 * back], [0.72, back]],
        "sheep": [[0.97, -edge], [1, -0.5 * edge], [0.84, back]],
        "driver": [[0.8, -0.6 * edge], [1, -0.1 * edge], [1, 0.8 * back], [0.8, back]],
        "opener": [[0.75, -edge], [0.95, -0.6 * edge], [0.95, 0.9 * back], [0.75, back]],
        "saw": [[s, -edge * (1 - 0.5 * (k % 2))] for k, s in enumerate(np.linspace(0.2, 0.95, 16))]
        + [[0.95, back]],
    }[str(kind)]
    points = np.array([[0.03, -0.7 * edge], [0.15, -edge], *tips, [0.03, back]])
    flat = CrossSection([points * [-long, 1]])
    flat = flat if flat.area() > 0 else CrossSection([points[::-1] * [-long, 1]])
    if kind == "opener":
        flat -= CrossSection.circle(0.6 * edge, 14).translate((-0.72 * long, -0.9 * edge))
    return flat


def _folding(rng: np.random.Generator) -> list[tuple]:
    """Scales with one to four blades in layers between them, pivoted at either end; razors have a
    tail."""
    length = float(rng.uniform(0.07, 0.15))
    unit, count = length / 100, int(rng.choice([1, 2, 3, 4], p=[0.42, 0.23, 0.2, 0.15]))
    razor = count == 1 and rng.random() < 0.25
    high = float(rng.uniform(13, 17) if razor else rng.uniform(17, 29)) * unit
    air, layer = 0.35 * unit, float(rng.uniform(2.6, 4.2)) * unit
    thick, tang = float(rng.uniform(2.8, 6)) * unit, float(rng.uniform(0.28, 0.34)) * high
    pivot = length / 2 - float(rng.uniform(0.42, 0.6)) * high
    inner = count * (layer + air) + air
    tone, steel = _tone(rng), materials.metal(rng, brushed=False)
    flat = _scale(rng, length, high)
    scales = union([extrusion(flat, "z", [0, 0, w], thick) for w in (-thick, inner)])
    ends = [1 if k % 2 == 0 else -1 for k in range(count)]
    limits = [
        pivot - air if 1 in ends else length,
        pivot - air if -1 in ends else length,
    ]
    spine = extrusion(flat, "z", [0, 0, 0], inner)
    far = -0.55 * pivot if razor else limits[0]
    spine ^= box([-limits[1], -high, -1], [far, -tang - air, 1])
    handle = Shape()
    if rng.random() < 0.4 and not razor:  # bolsters of metal at the ends
        x = float(rng.uniform(0.28, 0.42)) * length
        ends_only = union(
            [box([s * x - (s < 0), -1, -1], [s * x + (s > 0), 1, 1]) for s in (-1, 1)]
        )
        handle.add(tidy(scales ^ ends_only), steel).add(tidy(scales - ends_only), tone)
        handle.add(spine, steel if rng.random() < 0.5 else tone.darker(0.7))
    else:
        handle.add(tidy(scales), tone).add(spine, steel)
    rivet = float(rng.uniform(0.1, 0.2)) * high
    spots = [-pivot, pivot] + ([0.0] if rng.random() < 0.4 else [])
    caps = [
        cylinder("z", [x, 0, w], 0.8 * unit, rivet, segments=14)
        for x in spots
        for w in (-thick - 0.8 * unit, inner + thick)
    ]
    handle.add(union(caps), materials.hardware(rng))
    parts = [("handle", handle, -1, None)]
    for k, end in enumerate(ends):
        long = (pivot + length / 2) * float(
            rng.uniform(0.86, 0.97) if k < 1 else rng.uniform(0.6, 0.95)
        )
        back = 0.47 * high + float(rng.uniform(1.2, 5)) * unit
        outline = _blade(rng, long, 0.9 * tang, back) + CrossSection.circle(tang, 20)
        if razor:
            tail = np.array(
                [
                    [0, -0.5 * tang],
                    [0.22 * length, 0.2 * tang],
                    [0.24 * length, 0.9 * tang],
                    [0, 0.8 * tang],
                ]
            )
            outline += CrossSection([tail])
        outline = outline if end > 0 else outline.mirror((1, 0))
        low = air + k * (layer + air)
        solid = Manifold.extrude(outline, layer).translate((end * pivot, 0, low))
        joint = hinge((end * pivot, 0, 0), (0, 0, -end), np.pi * float(rng.uniform(0.9, 1)))
        parts.append(("blade", Shape().add(tidy(solid), steel), 0, joint))
    return parts


def _cutter(rng: np.random.Generator) -> list[tuple]:
    """A hollow grip, a blade with a thumb piece that slides in its slot; a wheel that clamps it."""
    length = float(rng.uniform(0.11, 0.19))
    unit, air = length / 100, 0.35 * length / 100
    high, thick = float(rng.uniform(11, 21)) * unit, float(rng.uniform(8, 13)) * unit
    blade, wide = float(rng.uniform(2.2, 3)) * unit, float(rng.uniform(0.5, 0.7)) * high / 2
    outline = rounded(length, high, float(rng.uniform(0.1, 0.5)) * high)
    lean = float(rng.uniform(0, 0.3))
    front = np.clip(2 * outline[:, 0] / length, 0, 1)
    outline = outline * np.column_stack([np.ones(len(outline)), 1 - lean * front])
    wide = min(wide, 0.85 * (1 - lean) * high / 2)
    a, b = float(rng.uniform(-0.34, -0.2)) * length, float(rng.uniform(0.25, 0.38)) * length
    slot, mid = 2.2 * unit, 0.15 * thick
    body = extrusion(outline, "z", [0, 0, -thick / 2], thick)
    body -= box([-0.44 * length, -wide - air, mid - air], [length, wide + air, mid + blade + air])
    body -= box([a, -slot - air, mid], [b, slot + air, 1])
    tone, other, dark = _tone(rng), _tone(rng), materials.dark(rng)
    share = float(rng.uniform(-0.2, 0.35)) * length
    mouth = box([share, -1, -1], [1, 1, 1])
    shape = Shape().add(tidy(body ^ mouth), other).add(tidy(body - mouth), tone)
    tip, proud = length / 2 + float(rng.uniform(0.5, 5)) * unit, float(rng.uniform(0, 1.6)) * wide
    steel = box([-0.42 * length, -wide, mid], [tip, wide, mid + blade]) ^ extrusion(
        np.array(
            [[-1, -1], [tip, -1], [tip, -wide], [tip - proud, wide], [tip - proud, 1], [-1, 1]]
        ),
        "z",
        [0, 0, -1],
        2,
    )
    stem = float(rng.uniform(9, 15)) * unit
    roof = thick / 2 + air
    thumb = box([a + air, -slot, mid + blade], [a + stem, slot, roof + unit])
    pad = float(rng.uniform(0.5, 0.85)) * high / 2
    thumb += box([a - unit, -pad, roof], [a + stem + unit, pad, roof + 2.5 * unit])
    for x in np.linspace(a, a + stem - 2 * unit, int(rng.integers(2, 5))):
        thumb += box([x, -pad, roof + unit], [x + 1.6 * unit, pad, roof + 4.5 * unit])
    moving = Shape().add(steel, materials.metal(rng, brushed=False)).add(tidy(thumb), dark)
    parts = [("grip", shape, -1, None)]
    parts.append(("blade", moving, 0, slide((1, 0, 0), b - a - stem - 2 * air)))
    if rng.random() < 0.35 and a > -0.28 * length:
        r = min(0.42 * high, 5.5 * unit)
        wheel = cylinder(
            "z", [-0.41 * length, 0, thick / 2 + 0.3 * unit], 4.5 * unit, r, segments=10
        )
        joint = turn((-0.41 * length, 0, 0), (0, 0, 1))
        parts.append(("wheel", Shape().add(wheel, dark), 0, joint))
    return parts


def _clippers(rng: np.random.Generator) -> list[tuple]:
    """Two sprung arms, a lever on a pin that turns about, a file about the rivet between them."""
    length = float(rng.uniform(0.055, 0.09))
    unit = length / 100
    wide, spread = float(rng.uniform(17, 27)) * unit, float(rng.uniform(6, 10))
    low = np.array(
        [
            [0.0, -50],
            [3, -50],
            [3, -38],
            [3 - spread, 22],
            [3 - spread, 34],
            [2.2, 47],
            [2.2, 50],
            [-1, 50],
            [-spread - 1, 36],
            [-spread - 1, 22],
            [-1, -38],
        ]
    )
    high = (low * [-1, 1] + [6, 0])[::-1]
    arms = [extrusion(p * unit, "y", [0, -wide / 2, 0], wide) for p in (low, high)]
    plan = rounded(length, wide, float(rng.uniform(0.1, 0.5)) * wide)
    plan = plan * np.column_stack([np.ones(len(plan)), 0.86 + 0.28 * plan[:, 0] / length])
    file = rng.random() < 0.65
    slot = box([-0.6 * length, -1, 1.2 * unit], [0.2 * length, 1, 4.8 * unit])
    rivet = cylinder("z", [-44 * unit, 0, 0.5 * unit], 5 * unit, 2.2 * unit, segments=12)
    body = union(arms) ^ extrusion(plan, "z", [0, 0, -1], 2)
    body = (body - slot if file else body) + rivet
    top = (7 + spread) * unit
    body += cylinder(
        "z", [29 * unit, 0, -spread * unit], top + spread * unit, 3 * unit, segments=14
    )
    steel = materials.metal(rng, brushed=False)
    parts = [("arms", Shape().add(tidy(body), steel), -1, None)]
    rise, start = float(rng.uniform(2, 12)), float(rng.uniform(-48, -34))
    side = np.array([[0, 36], [0, 20], [rise, start], [rise + 3.5, start], [4, 20], [5, 36]]) * unit
    lever = extrusion(side, "y", [0, -wide / 2, 0], wide).translate((0, 0, top + 0.4 * unit))
    slim = float(rng.uniform(0.65, 0.95))
    lever ^= extrusion(plan * [1.1, slim], "z", [0, 0, 0], 1)
    knob = cylinder("z", [29 * unit, 0, top + 2 * unit], 5 * unit, 4 * unit, segments=14)
    finish = steel if rng.random() < 0.5 else _tone(rng)
    joint = hinge((29 * unit, 0, 0), (0, 0, float(rng.choice([-1, 1]))), np.pi)
    parts.append(("lever", Shape().add(tidy(lever + knob), finish), 0, joint))
    if file:
        long = float(rng.uniform(52, 66)) * unit
        flat = rounded(long, 0.4 * wide, 0.15 * wide) + [long / 2 - 48 * unit, 0]
        plate = extrusion(flat, "z", [0, 0, 1.7 * unit], 2.6 * unit)
        plate -= cylinder("z", [-44 * unit, 0, -1], 2, 2.6 * unit, segments=12)
        way = (0, 0, float(rng.choice([-1, 1])))
        tone = steel.darker(0.7)
        parts.append(("file", Shape().add(plate, tone), 0, hinge((-44 * unit, 0, 0), way, 3.0)))
    return parts


def _ruler(rng: np.random.Generator) -> list[tuple]:
    """A folding ruler: three to seven limbs in a zigzag, stacked."""
    length, count = float(rng.uniform(0.12, 0.26)), int(rng.integers(3, 8))
    unit = length / 100
    wide, thick, air = float(rng.uniform(8, 15)) * unit, float(rng.uniform(3, 5)) * unit, 0.4 * unit
    tones = [_tone(rng)] * 2 if rng.random() < 0.6 else [_tone(rng), _tone(rng)]
    metal, ink = materials.hardware(rng), materials.dark(rng)
    outline = rounded(length, wide, float(rng.uniform(0.1, 0.5)) * wide)
    pivot, parts = length / 2 - 0.55 * wide, []
    way = int(rng.choice([-1, 1]))
    for k in range(count):
        low, end = k * (thick + air), way * (1 if k % 2 else -1)
        shape = Shape().add(extrusion(outline, "z", [0, 0, low], thick), tones[k % 2])
        if k == count - 1:  # marks and the last rivet are seen on the uppermost
            steps = np.linspace(-0.32, 0.32, 17) * length
            marks = [
                box(
                    [x, -0.45 * wide, low + thick],
                    [x + unit, -(0.05 + 0.2 * (i % 2)) * wide, low + thick + 0.3 * unit],
                )
                for i, x in enumerate(steps)
            ]
            shape.add(union(marks), ink)
            spot = [end * pivot, 0, low + thick]
            shape.add(cylinder("z", spot, 0.7 * unit, 0.3 * wide, segments=16), metal)
        joint = hinge((end * pivot, 0, 0), (0, 0, end), np.pi) if k else None
        parts.append(("limb", shape, k - 1, joint))
    return parts


def _punch(rng: np.random.Generator) -> list[tuple]:
    """A hole punch: a lever about a pin at the rear over two punches, a guide that slides out."""
    depth = float(rng.uniform(0.08, 0.13))
    unit, wide = depth / 100, depth * float(rng.uniform(0.5, 1.25))
    base, air, wall = float(rng.uniform(5, 12)) * unit, 0.5 * unit, float(rng.uniform(3, 5)) * unit
    angle, half = np.deg2rad(float(rng.uniform(16, 32))), wide / 2
    z, x = base + float(rng.uniform(24, 36)) * unit, 0.3 * depth
    tone, steel, other = _tone(rng), materials.metal(rng, brushed=False), _tone(rng)
    foot = extrusion(rounded(depth, wide, float(rng.uniform(1, 9)) * unit), "z", [0, 0, 0], base)
    cheeks, arm = [], half - wall - air
    for y in (-half, half - wall):
        ends = [
            [-0.05 * depth, base],
            [0.47 * depth, base],
            [x + 6 * unit, z + 5 * unit],
            [x - 6 * unit, z + 5 * unit],
        ]
        cheeks.append(hull(np.array([[a, q, b - 1e-4] for a, b in ends for q in (y, y + wall)])))
    body = union([foot, *cheeks])
    guide = rng.random() < 0.6
    r = float(rng.uniform(4, 6)) * unit
    posts = [
        cylinder("z", [-0.12 * depth, s * 0.6 * arm, base], z - base - 8 * unit, r, segments=14)
        for s in (-1, 1)
    ]
    shape = Shape()
    if guide:
        g = float(rng.uniform(6, 9)) * unit
        u, low = -0.32 * depth, base - 3.2 * unit
        body -= box([u - air, -1, low - air], [u + g + air, 1, 1])
    shape.add(tidy(body), tone).add(union(posts), steel)
    parts = [("base", shape, -1, None)]
    near, t = float(rng.uniform(0.42, 0.62)) * depth, float(rng.uniform(3, 6)) * unit
    knuckle = cylinder("y", [x, -arm, z], 2 * arm, 4.5 * unit, segments=18)
    slab = box([-near, -arm, z - 0.3 * unit], [x, arm, z + t])
    if rng.random() < 0.5:  # a round end
        plan = rounded(2 * (near + x), 2 * arm, float(rng.uniform(0.3, 1)) * arm)
        slab ^= extrusion(plan + [x, 0], "z", [0, 0, 0], 1)
    lever = (slab + knuckle).translate((-x, 0, -z)).rotate((0, np.rad2deg(angle), 0))
    lever = lever.translate((x, 0, z))
    swing = hinge((x, 0, z), (0, -1, 0), angle * 0.95)
    parts.append(("lever", Shape().add(tidy(lever), other), 0, swing))
    if guide:
        proud = float(rng.uniform(3, 10)) * unit
        bar = box([u, -half + unit, low], [u + g, half + proud, low + 4 * unit])
        bar += box([u, half + proud - 3 * unit, low], [u + g, half + proud, low + 9 * unit])
        joint = slide((0, 1, 0), wide * float(rng.uniform(0.4, 0.7)))
        parts.append(("guide", Shape().add(bar, materials.dark(rng)), 0, joint))
    return parts


def _strip(points: np.ndarray, radii) -> CrossSection:
    """A bar along points [n, 2] with half widths ``radii`` there, its ends round."""
    discs = [
        CrossSection.circle(r, 16).translate(tuple(p)) for p, r in zip(points, radii, strict=True)
    ]
    both = [CrossSection.batch_hull([a, b]) for a, b in itertools.pairwise(discs)]
    return CrossSection.batch_boolean(both, OpType.Add)


def _side(sign: int, gap: float) -> CrossSection:
    """The half plane beyond v = ``gap`` on a side."""
    return CrossSection.square((4, 2)).translate((-2, gap if sign > 0 else -2 - gap))


def _halves(flats, radius, grips, layer, angle, tones) -> list[tuple]:
    """Two halves, full thickness but at their pivot, where their discs lie one on the other."""
    gap, full = 0.12 * layer, 2.12 * layer
    parts, pin = [], 0.45 * radius
    for k, (flat, grip) in enumerate(zip(flats, grips, strict=True)):
        low = k * (layer + gap)
        start = layer if k == 0 else -1.0
        room = cylinder("z", [0, 0, start], 1 + layer + gap, radius + gap, segments=24)
        solid = Manifold.extrude(flat, full) - room
        disc = cylinder("z", [0, 0, low], layer, radius, segments=24)
        axle = cylinder("z", [0, 0, 0], full + 0.25 * layer, pin, segments=14)
        bore = cylinder("z", [0, 0, -1], 2, pin + gap, segments=14)
        solid = union([solid, disc, axle]) if k == 0 else union([solid, disc]) - bore
        shape, tone = Shape(), tones[1]
        if grip is not None:
            sleeve = Manifold.extrude(grip, 1.24 * full).translate((0, 0, -0.12 * full)) - room
            solid -= sleeve
            shape.add(tidy(sleeve), tone)
        shape.add(tidy(solid), tones[0])
        joint = hinge((0, 0, 0), (0, 0, 1), angle) if k else None
        parts.append(("half", shape, k - 1, joint))
    return parts


def _pliers(rng: np.random.Generator) -> list[tuple]:
    """Crossed halves: jaws before the pivot, handles behind it."""
    length = float(rng.uniform(0.12, 0.26))
    unit = length / 100
    radius, gap = float(rng.uniform(6, 10)) * unit, 0.5 * unit
    jaw, tip = float(rng.uniform(16, 42)) * unit, float(rng.uniform(0.25, 0.9)) * radius
    hand, bow = length - jaw, float(rng.uniform(0.08, 0.17)) * length
    wide = float(rng.uniform(2.8, 4.8)) * unit
    belly = float(rng.uniform(0.8, 1.1)) * radius
    points = np.array(
        [
            [0, 0.3 * radius],
            [-0.35 * hand, bow],
            [-0.95 * hand, bow * float(rng.uniform(0.75, 1.3))],
        ]
    )
    head = np.array(
        [[0, -gap], [0.5 * radius, -0.8 * radius], [0.45 * jaw, -belly], [jaw, -tip], [jaw, -gap]]
    )
    jaws = CrossSection([head]) ^ _side(-1, gap / 2)
    if rng.random() < 0.5:  # a hollow for pipes or nuts
        size = min(0.5 * belly, 0.2 * jaw)
        jaws -= CrossSection.circle(size, 16).translate((radius + size, -gap))
    bar = _strip(points, [0.5 * radius, wide, 0.9 * wide]) ^ _side(1, gap / 2)
    start = points[0] + 0.75 * (points[1] - points[0])
    sleeve = _strip(np.array([start, points[1], points[2]]), [1.25 * wide] * 3) ^ _side(1, gap)
    sleeve = sleeve if rng.random() < 0.8 else None
    flat = jaws + bar
    flats = [flat, flat.mirror((0, 1))]
    grips = [sleeve, None if sleeve is None else sleeve.mirror((0, 1))]
    tones = (materials.metal(rng, brushed=False), _tone(rng))
    slope = np.arctan2(bow - 0.3 * radius, 0.35 * hand)
    angle = min(float(np.deg2rad(rng.uniform(25, 55))), float(np.deg2rad(68) - slope))
    return _halves(flats, radius, grips, float(rng.uniform(3, 5)) * unit, angle, tones)


def _tongs(rng: np.random.Generator) -> list[tuple]:
    """Tongs and nutcrackers: two arms about a pivot at one end."""
    nuts = rng.random() < 0.45
    length = float(rng.uniform(0.13, 0.2) if nuts else rng.uniform(0.18, 0.4))
    unit, gap = length / 100, 0.4 * length / 100
    radius, wide = float(rng.uniform(4.5, 7.5)) * unit, float(rng.uniform(2.6, 4.5)) * unit
    bow = float(rng.uniform(7, 13)) * unit
    if nuts:
        at = float(rng.uniform(0.18, 0.32)) * length
        points = [
            [0, -0.4 * radius],
            [at, -bow],
            [at + 0.25 * length, -0.55 * bow],
            [0.95 * length, -bow],
        ]
        widths = [0.5 * radius, 1.3 * wide, wide, 0.9 * wide]
    else:
        points = [
            [0, -0.4 * radius],
            [0.35 * length, -bow],
            [0.86 * length, -wide],
            [0.95 * length, -1.1 * wide],
        ]
        widths = [0.5 * radius, wide, wide, float(rng.uniform(1, 2.4)) * wide]
    points = np.array(points)
    flat = _strip(points, widths) ^ _side(-1, gap)
    part = points[2:] if rng.random() < 0.6 else points[1:3]
    sleeve = _strip(part, [1.25 * wide] * 2) ^ _side(-1, gap)
    sleeve = sleeve if rng.random() < 0.6 else None
    flats = [flat, flat.mirror((0, 1))]
    grips = [sleeve, None if sleeve is None else sleeve.mirror((0, 1))]
    steel = materials.metal(rng, brushed=False) if rng.random() < 0.6 else _tone(rng)
    angle = float(np.deg2rad(rng.uniform(25, 70)))
    layer = float(rng.uniform(2.6, 6)) * unit
    return _halves(flats, radius, grips, layer, angle, (steel, _tone(rng)))


def _peg(rng: np.random.Generator) -> list[tuple]:
    """A clothes peg: two wedges about a spring, held shut before it."""
    length = float(rng.uniform(0.06, 0.1))
    unit, lean = length / 100, float(rng.uniform(0.1, 0.24))
    front, gap, thick = (
        float(rng.uniform(35, 55)) * unit,
        0.5 * unit,
        float(rng.uniform(12, 20)) * unit,
    )
    rear, deep, r = (
        length - front,
        float(rng.uniform(9, 14)) * unit,
        float(rng.uniform(4, 6)) * unit,
    )
    slim = float(rng.uniform(0.3, 0.7)) * deep
    points = np.array(
        [
            [front, gap],
            [front, slim],
            [0.5 * front, deep],
            [-0.2 * rear, deep + 0.2 * rear * lean],
            [-rear, rear * lean + slim + gap],
            [-rear, gap + rear * lean],
            [0, gap],
        ]
    )
    flat = CrossSection([points]) - CrossSection.circle(r + 0.6 * unit, 20)
    if rng.random() < 0.7:  # a hollow for the line
        flat -= CrossSection.circle(0.4 * deep, 14).translate((0.5 * front, 0))
    coil = cylinder("z", [0, 0, -0.12 * thick], 1.24 * thick, r, segments=18)
    loops = [box([-r, 0, w], [r, deep + unit, w + 0.12 * thick]) for w in (-0.12 * thick, thick)]
    spring = union([coil, *loops])
    tone = _tone(rng)
    other = tone if rng.random() < 0.8 else _tone(rng)
    upper = cut(Manifold.extrude(flat, thick), [spring])
    lower = Manifold.extrude(flat.mirror((0, 1)), thick)
    metal = materials.metal(rng, brushed=False)
    first = Shape().add(tidy(upper), tone).add(spring, metal)
    joint = hinge((0, 0, 0), (0, 0, -1), 2 * float(np.arctan(lean)) * 0.85)
    return [("half", first, -1, None), ("half", Shape().add(tidy(lower), other), 0, joint)]

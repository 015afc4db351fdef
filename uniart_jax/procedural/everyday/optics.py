"""Lenses of cameras; binoculars, projectors and microscopes. Lengths are in metres."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.pieces import merged
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cylinder,
    extrusion,
    hinge,
    rounded,
    screw,
    slide,
    tidy,
    tube,
    turn,
    union,
)


def draw_finish(rng: np.random.Generator) -> Material:
    """Draw a finish: black, silver, white or bright plastic."""
    kind = rng.choice(4, p=[0.38, 0.2, 0.12, 0.3])
    if kind == 0:
        return materials.dark(rng)
    if kind == 1:
        return materials.metal(rng, brushed=False)
    return materials.white_plastic(rng) if kind == 2 else plain(rng.uniform([0.05] * 3, [0.95] * 3))


def knurled(axis: str, at, length: float, radius: float, teeth: int, hole: float = 0) -> Manifold:
    """A toothed disc along ``axis`` (metres), or a ring if ``hole`` is its inner radius."""
    angle = np.linspace(0, 2 * np.pi, 4 * teeth, endpoint=False)
    r = radius * np.where(np.arange(4 * teeth) // 2 % 2, 0.93, 1.0)
    outline = np.column_stack([r * np.cos(angle), r * np.sin(angle)])
    ring = extrusion(outline, axis, at, length)
    if not hole:
        return ring
    far = np.array(at, dtype=float)
    far["xyz".index(axis)] -= 1
    return ring - cylinder(axis, far, 3, hole, segments=36)


def _tip(shape: Shape, x: float, y: float, z: float, radius: float, unit: float, tone, glass):
    """Add a rim and the glass within it, in front of the plane ``x``."""
    shape.add(tube("x", [x - 2 * unit, y, z], 2 * unit, radius, 0.75 * radius, 32), tone)
    shape.add(cylinder("x", [x - 0.8 * unit, y, z], 0.8 * unit, 0.73 * radius, segments=32), glass)


def lens(rng, asm: Assembly, root: int, at, radius: float, unit: float, tone, kind: str) -> None:
    """Add a lens in front of ``at`` (metres): a barrel that slides out in one or two stages, or
    rings that turn on a tube, and at times a hinged lid."""
    x, y, z = (float(a) for a in at)
    glass, air = materials.dark_glass(rng), 0.5 * unit
    if kind == "compact" or (kind == "instant" and rng.random() < 0.6):
        stages, parent = int(rng.integers(1, 3)), root
        depth = float(rng.uniform(4, 9)) * unit
        for k in range(stages):
            r = radius * (1 - 0.2 * k)
            last = k == stages - 1
            lo = x - air - (depth if k == 0 else 3 * unit)
            barrel = Shape().add(cylinder("x", [lo, y, z], x - air - lo, r, segments=36), tone)
            if last:
                _tip(barrel, lo, y, z, 0.9 * r, unit, materials.dark(rng), glass)
            travel = float(rng.uniform(10, 24)) * unit
            parent = asm.add("barrel", barrel, parent, slide((-1, 0, 0), travel))
            x = lo
            tone = tone.darker(0.8)
        return
    length = float(rng.uniform(12, 50)) * unit * (1 if kind == "system" else 0.5)
    core, ring_from = 0.82 * radius, 3 * unit
    pieces = [(cylinder("x", [x - length, y, z], length, core, segments=36), materials.dark(rng))]
    pieces.append((tube("x", [x - ring_from, y, z], ring_from, radius, core, 36), tone))
    mount = merged(pieces)
    front = Shape()
    zoom = rng.random() < 0.4 and kind == "system"
    tube_part = asm.add("mount", mount, root)
    room = length - ring_from - air
    count = 2 if room > 22 * unit and rng.random() < 0.6 else 1
    for k in range(count):
        a = x - ring_from - air - room * k / count
        b = a - room * float(rng.uniform(0.6, 0.9)) / count
        ring = knurled("x", [b, y, z], a - b, radius * 1.02, int(rng.integers(14, 26)), 1.02 * core)
        look = tone if rng.random() < 0.4 else materials.dark(rng)
        shape = Shape().add(ring, look)
        if rng.random() < 0.5:  # a lever or dot that shows where it stands
            nub = box(
                [b, y - 1.5 * unit, z + 0.95 * radius], [a, y + 1.5 * unit, z + radius + 2 * unit]
            )
            shape.add(tidy(nub - ring), plain(rng.uniform(0.3, 1.0, 3)))
        limit = float(np.deg2rad(rng.uniform(60, 270)))
        joint = (
            turn((x, y, z), (1, 0, 0)) if rng.random() < 0.4 else hinge((x, y, z), (1, 0, 0), limit)
        )
        asm.add("ring", shape, tube_part, joint)
    end = x - length - air
    size = core if not zoom else 0.95 * radius
    if zoom:
        front.add(cylinder("x", [end - 6 * unit, y, z], 6 * unit, size, segments=36), tone)
        _tip(front, end - 6 * unit, y, z, size, unit, tone, glass)
        asm.add("zoom", front, tube_part, slide((-1, 0, 0), float(rng.uniform(10, 22)) * unit))
    elif rng.random() < 0.3:  # a lid hinged above
        lid = cylinder("x", [end - 2.5 * unit, y, z], 2.5 * unit, radius, segments=36)
        joint = hinge(
            (end - 2.5 * unit, y, z + radius), (0, 1, 0), float(np.deg2rad(rng.uniform(90, 150)))
        )
        asm.add("lens_lid", Shape().add(lid, draw_finish(rng)), tube_part, joint)
    else:
        _tip(front, end, y, z, size, unit, tone, glass)
        asm.add("front_ring", front, tube_part, screw((x, y, z), (-1, 0, 0), 0.75, 4 * unit))


def binoculars(rng: np.random.Generator) -> ArticulatedObject:
    """Binoculars in metres, lying or standing: two barrels that fold about a bridge, a wheel on it,
    and eyecups that turn out."""
    long = float(rng.uniform(0.09, 0.2))
    unit = long / 100
    wide, slim = float(rng.uniform(15, 26)) * unit, float(rng.uniform(9, 14)) * unit
    prism = rng.random() < 0.5  # its barrels are wider apart in front
    apart = float(rng.uniform(1.15, 1.4)) * wide + 5 * unit
    near = apart * (0.72 if prism else 1.0)
    face, trim, air = draw_finish(rng), draw_finish(rng), 0.5 * unit
    glass, rubber = materials.glass(rng), materials.dark(rng)
    edge = rubber if rng.random() < 0.6 else trim
    standing = rng.random() < 0.4
    asm = Assembly()
    matrix = np.eye(4)
    if standing:  # glasses below, eyes above: x goes to z
        matrix[:3, :3] = [[0, 0, -1], [0, 1, 0], [1, 0, 0]]
    else:
        matrix[2, 3] = wide + 3 * unit

    def put(name, pieces, parent=-1, joint=None):
        """Add a part where the binoculars stand or lie."""
        return asm.add(name, merged(pieces).moved(matrix), parent, joint)

    def vec(v):
        """A direction, turned with the binoculars."""
        return matrix[:3, :3] @ np.asarray(v, dtype=float)

    def spot(p):
        """A point, moved with the binoculars."""
        return vec(p) + matrix[:3, 3]

    hub, split = float(rng.uniform(4, 6)) * unit, float(rng.uniform(0.5, 0.62)) * long
    mid = (0.3 * long, 0.75 * long)
    thick = float(rng.uniform(4, 6)) * unit
    for side in (1, -1):
        first = side > 0
        front = cylinder("x", [2 * unit, side * apart, 0], 0.45 * long, wide, 0.8 * wide, 28)
        if prism:
            block = extrusion(rounded(2.6 * slim, 2.6 * slim, slim), "x", [0, 0, 0], 1)
            lo, hi = sorted((side * (near - slim), side * (apart + 0.8 * wide)))
            block = extrusion(
                rounded(hi - lo, 1.7 * wide, 0.6 * wide),
                "x",
                [0.42 * long, (lo + hi) / 2, 0],
                0.3 * long,
            )
        else:
            block = cylinder(
                "x", [0.4 * long, side * near, 0], 0.35 * long, 0.85 * wide, 1.2 * slim, 28
            )
        rear = cylinder("x", [0.7 * long, side * near, 0], 0.16 * long, slim, segments=24)
        spans = [(mid[0], mid[0] + 0.1 * long), (split + 0.06 * long, mid[1])]
        if not first:
            spans = [(spans[0][1] + air, spans[0][1] + air + 0.08 * long)]
            spans.append((spans[0][1] + 0.01 * long, split + 0.06 * long - air))
            spans = [spans[0], (split - 0.02 * long, split + 0.06 * long - air)]
        knuckles = []
        for a, b in spans:
            knuckles.append(tube("x", [a, 0, 0], b - a, hub, 0.55 * hub, 24))
            lo, hi = sorted((side * 0.75 * hub, side * near))
            knuckles.append(box([a, lo, -thick / 2], [b, hi, thick / 2]))
        solid = union([front, block, rear, *knuckles])
        solid = solid - cylinder("x", [-1, 0, 0], 2, 0.55 * hub, segments=24)
        if first:
            pin = cylinder("x", [mid[0], 0, 0], mid[1] - mid[0], 0.45 * hub, segments=24)
            post = cylinder("x", [mid[1], 0, 0], unit, hub, segments=24)
            solid = union(
                [
                    solid,
                    pin,
                    post,
                    box([mid[0], 0, -0.2 * hub], [mid[0] + 0.09 * long, 0.7 * hub, 0.2 * hub]),
                ]
            )
        ends = tube("x", [0, side * apart, 0], 4 * unit, 1.05 * wide, 0.8 * wide, 28)
        pane = cylinder("x", [unit, side * apart, 0], unit, 0.82 * wide, segments=28)
        pieces = [
            (solid, face),
            (ends - solid, edge),
            (pane - solid - ends, glass),
        ]
        fold = float(np.deg2rad(rng.uniform(15, 35)))
        joint = None if first else hinge(spot([0, 0, 0]), vec([1, 0, 0]), fold)
        index = put("barrel", pieces, -1 if first else 0, joint)
        x = 0.86 * long + air
        cup = tube("x", [x, side * near, 0], 0.14 * long, 1.15 * slim, 0.7 * slim, 24)
        lens_ = cylinder("x", [x, side * near, 0], 0.05 * long, 0.72 * slim, segments=24)
        joint = screw(spot([0, side * near, 0]), vec([1, 0, 0]), 0.5, 0.07 * long)
        put("eyecup", [(cup, rubber), (lens_ - cup, glass)], index, joint)
    x0 = mid[1] + unit + air
    r = float(rng.uniform(1.3, 1.7)) * hub
    r = min(r, near - 1.2 * slim - unit)
    wheel = knurled("x", [x0, 0, 0], 0.14 * long, r, int(rng.integers(10, 20)))
    put("wheel", [(wheel, trim)], 0, turn(spot([0, 0, 0]), vec([1, 0, 0])))
    return asm.object()


def projector(rng: np.random.Generator) -> ArticulatedObject:
    """A projector in metres: a box with a lens, a slide drum, two reels, or a flap and a foot."""
    kind = str(rng.choice(["drum", "reels", "flat"], p=[0.3, 0.3, 0.4]))
    width = float(rng.uniform(0.22, 0.38))
    unit, air = width / 100, width / 200
    face, trim, metal = draw_finish(rng), draw_finish(rng), materials.metal(rng, brushed=False)
    deep = width * float(rng.uniform(0.65, 1.1))
    high = width * float(rng.uniform(0.25, 0.45) if kind != "reels" else rng.uniform(0.5, 0.8))
    width = width * (0.5 if kind == "reels" else 1)
    half, asm, body = width / 2, Assembly(), Shape()
    legs = float(rng.uniform(3, 7)) * unit
    plan = rounded(deep, width, float(rng.uniform(1, 10)) * unit)
    body.add(extrusion(plan, "z", [deep / 2, 0, legs], high), face)
    top = legs + high
    for x in (0.15 * deep, 0.85 * deep):
        for s in (-0.7 * half, 0.7 * half):
            if kind != "flat" or x > 0.5 * deep:
                body.add(cylinder("z", [x, s, 0], legs, 4 * unit, segments=16), materials.dark(rng))
    root = asm.add("body", body)
    radius = min(0.36 * high, 0.3 * width)
    y = 0.0 if kind != "flat" else float(rng.uniform(-0.5, 0.5)) * half
    z = legs + high * float(rng.uniform(0.45, 0.55))
    lens(rng, asm, root, np.array([0.0, y, z]), radius, unit, trim, "system")
    if kind == "drum":  # slides stand in it like the hours
        r = min(0.46 * width, 0.46 * deep)
        tall, at = float(rng.uniform(9, 16)) * unit, [deep / 2, 0, top + air]
        drum = knurled("z", at, tall, r, int(rng.integers(20, 36)), 0.35 * r)
        rim = tube("z", at, 0.35 * tall, 1.03 * r, 0.9 * r, 40)
        hub = tube("z", at, 0.5 * tall, 0.4 * r, 0.2 * r, 32)
        pieces = [(union([drum, rim, hub]), materials.dark(rng) if rng.random() < 0.6 else trim)]
        asm.add("drum", merged(pieces), root, turn(at, (0, 0, 1)))
    elif kind == "reels":
        r = min(float(rng.uniform(20, 27)) * unit, 0.33 * deep)
        t, s = 4 * unit, float(rng.choice([-1, 1]))
        tone = metal if rng.random() < 0.5 else trim
        for x, way in ((0.15 * deep, -1), (0.85 * deep, 1)):
            at = np.array([x + way * 6 * unit, s * (half + air), top + 1.05 * r + unit])
            foot = np.array([x, 0, top - 8 * unit])
            arm = Shape().add(
                box([x - 4 * unit, -3 * unit, top], [x + 4 * unit, 3 * unit, at[2] + 4 * unit]),
                face,
            )
            holder = asm.add("arm", arm, root)
            y0 = 3 * unit + air if s > 0 else -3 * unit - air - 3 * t
            at[0] = x
            disc = [
                cylinder("y", [x, y0 + d, at[2]], 0.7 * t, r, segments=36) for d in (0, 2.3 * t)
            ]
            core = cylinder("y", [x, y0, at[2]], 3 * t, 0.35 * r, segments=24)
            film = tube(
                "y",
                [x, y0 + 0.7 * t, at[2]],
                1.6 * t,
                r * float(rng.uniform(0.5, 0.9)),
                0.35 * r,
                32,
            )
            holes = [
                cylinder(
                    "y",
                    [x + 0.64 * r * np.cos(a), y0 - 1, at[2] + 0.64 * r * np.sin(a)],
                    2,
                    0.22 * r,
                )
                for a in np.arange(3) * 2 * np.pi / 3 + foot[2]
            ]
            spool = tidy(union(disc) - union(holes) + core)
            asm.add(
                "reel",
                Shape().add(spool, tone).add(tidy(film - core), materials.dark(rng)),
                holder,
                turn((x, 0, at[2]), (0, 1, 0)),
            )
    else:
        foot = union(
            [
                cylinder("z", [0.14 * deep, 0, 0], 2 * unit, 6 * unit, segments=24),
                cylinder("z", [0.14 * deep, 0, 0], legs - air, 3 * unit),
            ]
        )
        asm.add(
            "foot",
            Shape().add(foot, materials.dark(rng)),
            root,
            screw((0.14 * deep, 0, 0), (0, 0, -1), 3.0, 8 * unit),
        )
        if rng.random() < 0.7:
            w, d = float(rng.uniform(0.3, 0.7)) * half, float(rng.uniform(0.15, 0.25)) * deep
            y = float(rng.uniform(-0.2, 0.2)) * half
            flap = box(
                [0.6 * deep - d, y - w, top + air], [0.6 * deep + d, y + w, top + air + 3 * unit]
            )
            at = (0.6 * deep + d, 0, top + air + 3 * unit)
            joint = hinge(at, (0, 1, 0), float(np.deg2rad(rng.uniform(60, 110))))
            asm.add("flap", Shape().add(flap, trim), root, joint)
        if rng.random() < 0.6:
            at = [0.18 * deep, -0.6 * half, top + air]
            dial = knurled("z", at, 3.5 * unit, 6 * unit, 16)
            asm.add(
                "dial",
                Shape().add(dial, metal),
                root,
                hinge(at, (0, 0, 1), float(np.deg2rad(rng.uniform(90, 270)))),
            )
    return asm.object()


def microscope(rng: np.random.Generator) -> ArticulatedObject:
    """A microscope in metres: a foot, an arm, a stage that rises, a turning nosepiece, knobs."""
    high = float(rng.uniform(0.2, 0.4))
    unit, air = high / 100, high / 250
    face, trim, metal = draw_finish(rng), draw_finish(rng), materials.metal(rng, brushed=False)
    asm, body = Assembly(), Shape()
    half, thick = float(rng.uniform(18, 25)) * unit, float(rng.uniform(6, 11)) * unit
    w = float(rng.uniform(6, 10)) * unit
    foot = extrusion(rounded(2.7 * half, 2 * half, 0.3 * half), "z", [0, 0, 0], thick)
    rear = 1.35 * half - 2 * unit
    arm = box([rear - 11 * unit, -w, thick - unit], [rear, w, 78 * unit])
    head = box([-9 * unit, -0.9 * w, 66 * unit], [rear, 0.9 * w, 78 * unit])
    lamp = cylinder("z", [0, 0, thick - unit], 6 * unit, 7 * unit, segments=24)
    body.add(tidy(union([foot, arm, head])), face).add(lamp - foot, trim)
    root = asm.add("body", body)
    spot = [0.0, 0, 66 * unit - air]
    r = min(float(rng.uniform(9, 12)) * unit, rear - 12 * unit)
    pieces = [(cylinder("z", [0, 0, spot[2] - 4 * unit], 4 * unit, 0.8 * r, r, 32), metal)]
    count = int(rng.choice([3, 4]))
    for k in range(count):
        a = np.pi + 2 * np.pi * k / count
        at = [0.55 * r * np.cos(a), 0.55 * r * np.sin(a)]
        drop = (14 if k == 0 else float(rng.uniform(7, 12))) * unit
        barrel = cylinder("z", [*at, spot[2] - 4 * unit - drop], drop, 2.1 * unit, 3.2 * unit, 16)
        pieces.append((barrel, plain(rng.uniform(0.3, 0.9, 3)) if rng.random() < 0.5 else metal))
    asm.add("nosepiece", merged(pieces), root, turn(spot, (0, 0, 1)))
    z, t = float(rng.uniform(34, 38)) * unit, 3.5 * unit
    size = float(rng.uniform(13, 17)) * unit
    back = rear - 11 * unit - air
    stage = box([-size, -1.15 * size, z], [back, 1.15 * size, z + t]) - cylinder(
        "z", [0, 0, 0], 1, 4 * unit
    )
    clips = [
        box([-size, s - unit, z + t], [4 * unit, s + unit, z + t + unit])
        for s in (-7 * unit, 7 * unit)
    ]
    condenser = tube("z", [0, 0, z - 7 * unit], 7 * unit, 6 * unit, 4 * unit)
    low = thick + 5 * unit
    down = min(float(rng.uniform(6, 14)) * unit, z - 7 * unit - low)
    shape = Shape().add(stage, materials.dark(rng)).add(union(clips), metal).add(condenser, trim)
    asm.add("stage", shape, root, slide((0, 0, -1), max(down, 2 * unit)))
    x, zk = rear - 5.5 * unit, thick + 11 * unit
    r = float(rng.uniform(5, 7.5)) * unit
    r = min(r, 5.4 * unit) if z - down < zk + r else r  # the stage goes down in front of them
    for s in (-1, 1):
        y0, y1 = sorted((s * (w + air), s * (w + air + 6 * unit)))
        knob = knurled("y", [x, y0, zk], y1 - y0, r, 14)
        y2, y3 = sorted((s * (w + air + 6 * unit), s * (w + air + 10 * unit)))
        fine = cylinder("y", [x, y2, zk], y3 - y2, 0.5 * r)
        asm.add("knob", Shape().add(knob, trim).add(fine, metal), root, turn((x, 0, zk), (0, 1, 0)))
    # the eyepiece, leaning forward or back, that turns about the upright
    two = rng.random() < 0.4
    lean = float(rng.choice([-1, 1])) * float(rng.uniform(20, 40))
    top = 78 * unit + air
    collar = cylinder("z", [0, 0, top], 5 * unit, 8 * unit, segments=32)
    tubes = []
    for s in (-6 * unit, 6 * unit) if two else (0.0,):
        solid = cylinder("z", [0, s, 0], 20 * unit, 3.8 * unit, segments=24)
        cup = cylinder("z", [0, s, 19 * unit], 5 * unit, 4.8 * unit, segments=24)
        tubes.append(union([solid, cup]).rotate((0, lean, 0)).translate((0, 0, top + 3 * unit)))
    block = [box([-6 * unit, -10 * unit, top + 4 * unit], [6 * unit, 10 * unit, top + 10 * unit])]
    solid = union([collar, *tubes, *(block if two else [])])
    solid = solid - box([-1, -1, 0], [1, 1, top])
    asm.add(
        "eyepiece",
        Shape().add(tidy(solid), face if rng.random() < 0.5 else trim),
        root,
        turn(spot, (0, 0, 1)),
    )
    return asm.object()

"""Things that turn in a stand: globes on a tilted axis, mirrors, boards and hour glasses in a
frame, gimbals, devices on a tripod, display racks."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold
from trimesh.transformations import rotation_matrix

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import TEXTURE_SIZE, Material, plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    ball,
    box,
    cylinder,
    extrusion,
    hinge,
    merged,
    pipe,
    revolution,
    rounded,
    slide,
    tidy,
    tube,
    turn,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """Something that turns in a stand, metres, at rest."""
    kinds = (_globe, _globe_bar, _framed, _gimbal, _tripod, _rack)
    return kinds[rng.choice(6, p=[0.3, 0.06, 0.22, 0.08, 0.18, 0.16])](rng)


def _map(rng: np.random.Generator, radius: float) -> Material:
    """Land and sea, a moon, or a plain ball."""
    if rng.random() < 0.12:
        return plain(rng.uniform(0.2, 0.9, 3))
    field = materials.noise(rng, 6, 6) + 0.4 * materials.noise(rng, 14, 14)
    seas = (
        [0.25, 0.5, 0.8],
        [0.1, 0.2, 0.45],
        [0.75, 0.65, 0.45],
        [0.1, 0.1, 0.12],
        [0.6, 0.8, 0.9],
    )
    sea = np.array(seas[rng.integers(5)]) * rng.uniform(0.8, 1.15)
    land = np.stack([rng.uniform(0.2, 0.95, 3), rng.uniform(0.2, 0.95, 3)])
    pick = (materials.noise(rng, 7, 7) > 0)[..., None]
    colors = np.where(field[..., None] > 0.1, np.where(pick, land[0], land[1]), sea)
    image = (np.clip(colors, 0, 1) * 255).astype(np.uint8).reshape(TEXTURE_SIZE, TEXTURE_SIZE, 3)
    return Material(tuple(np.clip(sea, 0, 1).tolist()), image, "z", 2.5 * radius)


def _finish(rng: np.random.Generator) -> Material:
    """Of stands: wood, metal, brass, plastic."""
    kind = rng.choice(3, p=[0.35, 0.4, 0.25])
    if kind == 0:
        return materials.wood(rng)
    return materials.hardware(rng) if kind == 1 else plain(rng.uniform(0.08, 0.92, 3))


def _ring(outer: float, inner: float, wide: float, start=0.0, end=2 * np.pi) -> Manifold:
    """A flat ring or arc about 0 in the plane (y, z), ``wide`` along x; angles from +z to +y."""
    if end - start > 6.28:
        return tube("x", [-wide / 2, 0, 0], wide, outer, inner, 48)
    t = np.linspace(start, end, 30)
    way = np.column_stack([np.sin(t), np.cos(t)])
    return extrusion(np.vstack([outer * way, inner * way[::-1]]), "x", [-wide / 2, 0, 0], wide)


def _foot(rng, size: float, high: float, top: float, thick: float) -> Manifold:
    """A foot about the z axis and its post, which ends at ``top``."""
    kind = str(
        rng.choice(
            ["disc", "dome", "turned", "slab", "cross", "legs"], p=[0.25, 0.2, 0.2, 0.1, 0.12, 0.13]
        )
    )
    post = [cylinder("z", [0, 0, 0.3 * high], top - 0.3 * high, thick, segments=18)]
    if kind == "disc":
        post.append(cylinder("z", [0, 0, 0], high, size, float(rng.uniform(0.85, 1)) * size, 32))
    elif kind == "dome":
        t = np.linspace(0, np.pi / 2, 7)
        rim = np.column_stack([size * np.cos(t), 0.3 * high + 1.1 * high * np.sin(t)])
        post.append(revolution(np.vstack([[[0, 0], [size, 0]], rim]), "z", [0, 0, 0], 32))
    elif kind == "turned":
        z = np.linspace(0, 1, 14)
        r = thick * (1.1 + 0.9 * np.abs(np.sin(float(rng.uniform(3, 8)) * z)))
        r = np.where(z < 0.22, size * (1 - 0.8 * (z / 0.22) ** 1.5), np.minimum(r, 0.5 * size))
        post = [
            revolution(
                np.vstack([[[0, 0]], np.column_stack([r, z * top]), [[0, top]]]), "z", [0, 0, 0], 26
            )
        ]
    elif kind == "slab":
        outline = rounded(1.7 * size, 1.7 * size, float(rng.uniform(0.05, 0.6)) * size)
        post.append(extrusion(outline, "z", [0, 0, 0], high))
    else:
        count = 4 if kind == "cross" else int(rng.integers(3, 6))
        rise = high if kind == "cross" else min(float(rng.uniform(1.5, 4)) * high, 0.7 * top)
        r = 0.5 * high
        post = [cylinder("z", [0, 0, rise - r], top - rise + r, thick, segments=18)]
        turned = float(rng.uniform(0, np.pi))
        for k in range(count):
            a = turned + 2 * np.pi * k / count
            tip = [1.1 * size * np.cos(a), 1.1 * size * np.sin(a), r]
            post.append(pipe([[0, 0, max(rise - r, r)], tip], r, 10))
    return union(post)


def _globe(rng: np.random.Generator) -> ArticulatedObject:
    """A ball in an arc on a foot, or in rings on legs; the arc itself turns at times."""
    radius = float(rng.uniform(0.08, 0.2))
    unit = radius / 30
    tilt = float(rng.uniform(0.25, 0.6)) if rng.random() < 0.8 else 0.0
    gap, wide = float(rng.uniform(2, 5)) * unit, float(rng.uniform(2, 6)) * unit
    band = float(rng.uniform(1.5, 3)) * unit
    inner = radius + gap
    outer = inner + band
    kind = str(rng.choice(["arc", "moving", "horizon"], p=[0.6, 0.15, 0.25]))
    finish, metal = _finish(rng), materials.hardware(rng)
    yaw = float(rng.choice([0.0, np.pi, rng.uniform(-np.pi, np.pi)], p=[0.3, 0.3, 0.4]))
    spin = rotation_matrix(yaw, (0, 0, 1))
    foot = float(rng.uniform(2.5, 6)) * unit
    stem = float(rng.uniform(1.5, 30)) * unit
    low = foot + stem + 3 * unit + (3 * unit if kind == "moving" else 0)
    if kind == "horizon":
        low = radius * (
            float(rng.uniform(0.2, 0.6)) if rng.random() < 0.6 else float(rng.uniform(0.8, 2))
        )
    center = np.array([0, 0, low + outer])
    axis = np.array([0, np.sin(tilt), np.cos(tilt)])
    lean = rotation_matrix(-tilt, (1, 0, 0))
    pins = [
        cylinder("z", [0, 0, z], gap + 0.5 * band, 1.5 * unit, segments=12)
        for z in (radius + 0.5 * unit, -radius - 0.5 * unit - gap - 0.5 * band)
    ]
    pins = [p.transform(lean[:3]) for p in pins]
    around = kind != "arc" or rng.random() < 0.2
    arc = (
        _ring(outer, inner, wide)
        if around
        else _ring(outer, inner, wide, tilt - 0.12, tilt + np.pi + 0.12)
    )
    arc = tidy(union([arc, *pins])).translate(tuple(center))
    asm, stand = Assembly(), Shape()
    size = radius * float(rng.uniform(0.55, 0.95))
    top = center[2] - outer + 0.3 * band
    if kind == "horizon":
        _horizon(rng, stand, center, outer, wide, unit, finish)
        stand.add(tidy(arc - stand.solid()), metal)
    elif kind == "arc":
        base = _foot(rng, size, foot, top, float(rng.uniform(1.5, 3.5)) * unit)
        if rng.random() < 0.4:
            stand.add(tidy(base + arc), finish)
        else:
            stand.add(tidy(base - arc), finish).add(arc, metal)
    else:  # a saddle in which the ring turns
        air = 0.5 * unit
        saddle = box(
            [-wide / 2 - 2 * unit, -5 * unit, center[2] - outer - 3.5 * unit],
            [wide / 2 + 2 * unit, 5 * unit, center[2] - inner - 0.5 * gap],
        )
        slot = _ring(outer + air, inner - gap, wide + 2 * air).translate(tuple(center))
        base = _foot(
            rng, size, foot, center[2] - outer - 2 * unit, float(rng.uniform(1.5, 3.5)) * unit
        )
        stand.add(tidy(base + (saddle - slot)), finish)
    root = asm.add("stand", stand.moved(spin))
    if kind == "moving":
        way = spin[:3, :3] @ np.array([1.0, 0, 0])
        root = asm.add(
            "meridian",
            Shape().add(arc, metal).moved(spin),
            root,
            hinge(center, way, float(rng.uniform(0.6, 1.5)) * float(rng.choice([-1, 1]))),
        )
    sphere = Shape().add(ball([0, 0, 0], radius, 40), _map(rng, radius))
    if rng.random() < 0.25:  # a band round the equator
        sphere = Shape()
        whole = ball([0, 0, 0], radius, 40)
        belt = tube("z", [0, 0, -unit], 2 * unit, radius + 0.6 * unit, 0.97 * radius, 40)
        sphere.add(tidy(whole - belt), _map(rng, radius)).add(belt, metal)
    move = np.eye(4)
    move[:3, 3] = center
    asm.add("ball", sphere.moved(spin @ move @ lean), root, turn(center, spin[:3, :3] @ axis))
    return asm.object()


def _horizon(rng, stand: Shape, center, outer, wide, unit, finish: Material) -> None:
    """A level ring round a globe on legs with a stretcher; its upright ring rests on the feet."""
    wall = float(rng.uniform(5, 10)) * unit
    r = float(rng.uniform(1.3, 2.4)) * unit
    z = center[2]
    ring = tube("z", [0, 0, z - unit], 2 * unit, outer + wall, outer - 0.4 * unit, 40)
    count, turned = int(rng.integers(3, 5)), float(rng.uniform(0, 2))
    far, spread = outer + 0.6 * wall, float(rng.uniform(0.9, 1.15))
    legs = [ring]
    low = 0.35 * max(z - outer, 4 * unit)
    for k in range(count):
        a = turned + 2 * np.pi * k / count
        c, s = np.cos(a) * far, np.sin(a) * far
        legs.append(pipe([[c, s, z], [spread * c, spread * s, r]], r, 12))
        legs.append(pipe([[0, 0, low], [spread * c, spread * s, low]], 0.8 * r, 10))
    legs.append(cylinder("z", [0, 0, low - 0.8 * r], z - outer - low + r, 1.2 * r, segments=16))
    stand.add(tidy(union(legs)), finish)


def _globe_bar(rng: np.random.Generator) -> ArticulatedObject:
    """A globe whose upper half opens at a hinge behind, on legs with wheels."""
    radius = float(rng.uniform(0.2, 0.3))
    unit = radius / 40
    rim = radius * float(rng.uniform(1.6, 2.6))
    finish, skin = _finish(rng), _map(rng, radius)
    air, wall = 0.4 * unit, 1.6 * unit
    shell = ball([0, 0, rim], radius, 40) - ball([0, 0, rim], radius - wall, 32)
    asm, body = Assembly(), Shape()
    body.add(tidy(shell ^ box([-1, -1, 0], [1, 1, rim])), skin)
    tray = cylinder("z", [0, 0, rim - 0.35 * radius], 1.5 * unit, 0.93 * radius - wall, segments=30)
    tray = tray - cylinder("z", [0.3 * radius, 0, 0], 9, 0.25 * radius) - (shell)
    body.add(tidy(tray), finish)
    back = radius + 3 * unit
    ring = tube("z", [0, 0, rim - 4 * unit], 4 * unit, back, 0.9 * radius, 40)
    r = float(rng.uniform(1.5, 2.6)) * unit
    wheel = 4 * unit
    legs = [ring]
    count = int(rng.integers(3, 5))
    for k in range(count):
        a = 0.4 + 2 * np.pi * k / count
        c, s = np.cos(a) * (back - r), np.sin(a) * (back - r)
        legs.append(pipe([[c, s, rim - 2 * unit], [c, s, r]], r, 12))
        legs.append(pipe([[0, 0, wheel + r], [c, s, wheel + r]], 0.8 * r, 10))
    whole = ball([0, 0, rim], radius, 40)
    board = cylinder("z", [0, 0, wheel + 2 * r], 2 * unit, 0.7 * radius, segments=30)
    body.add(tidy(union([*legs, board]) - whole), finish)
    root = asm.add("stand", body)
    cap = ball([0, 0, rim], radius, 40) ^ box([-1, -1, rim + air], [1, 1, 9])
    ring = tube("z", [0, 0, rim + air], 2.5 * unit, radius + 2 * unit, 0.9 * radius, 40) - cap
    hollow = ball([0, 0, rim], radius - wall, 32)
    tab = box([0.9 * radius, -5 * unit, rim + air], [back, 5 * unit, rim + air + 2.5 * unit]) - cap
    lid = Shape().add(tidy(cap - hollow), skin).add(tidy(union([ring - hollow, tab])), finish)
    joint = hinge((back, 0, rim + air), (0, 1, 0), float(np.deg2rad(rng.uniform(60, 90))))
    asm.add("lid", lid, root, joint)
    return asm.object()


def _framed(rng: np.random.Generator) -> ArticulatedObject:
    """A mirror, a board, an hour glass or a drum with a crank, which turns about y between two
    posts."""
    kind = str(rng.choice(["mirror", "board", "glass", "drum"], p=[0.42, 0.24, 0.17, 0.17]))
    half, tall = float(rng.uniform(0.1, 0.18)), float(rng.uniform(0.1, 0.2))
    if kind == "mirror" and rng.random() < 0.4:
        half, tall = float(rng.uniform(0.2, 0.32)), float(rng.uniform(0.5, 0.75))
    elif kind == "board":
        half, tall = float(rng.uniform(0.4, 0.8)), float(rng.uniform(0.3, 0.5))
    elif kind == "glass":
        half = tall * float(rng.uniform(0.4, 0.6))
    round_one = kind == "mirror" and tall < 0.4 and rng.random() < 0.6
    tall = half if round_one else tall
    unit = max(half, tall) / 45
    finish, metal = _finish(rng), materials.hardware(rng)
    content, reach, deep = _content(rng, kind, half, tall, round_one, unit, finish, metal)
    foot = float(rng.uniform(2, 5)) * unit
    rise = float(rng.uniform(0.02, 0.6)) * tall
    if kind == "board" or tall > 0.4:
        rise = float(rng.uniform(0.1, 0.4)) * tall
    center = np.array([0, 0, foot + reach + 2 * unit + rise])
    air, wall = 0.7 * unit, float(rng.uniform(2, 4)) * unit
    w = float(rng.uniform(0.8, 1.6)) * 2 * unit
    y = half + air
    asm, stand = Assembly(), Shape()
    spread = max(0.45 * reach, 1.2 * deep) * float(rng.uniform(0.9, 1.4))
    hooped = round_one and rng.random() < 0.65
    if hooped:
        arc = _ring(y + wall, y, 2 * w, np.pi / 2 - 0.1, 1.5 * np.pi + 0.1).translate(tuple(center))
        base = _foot(rng, 0.7 * half, foot, center[2] - y - 0.5 * wall, 2 * unit)
        stand.add(tidy(base + arc), finish)
    else:
        solids = []
        for s in (-1, 1):
            lo, hi = sorted((s * y, s * (y + wall)))
            solids.append(box([-w, lo, 0.5 * foot], [w, hi, center[2] + 2 * w]))
            solids.append(box([-spread, lo, 0], [spread, hi, foot]))
        low = float(rng.choice([0.0, 0.3])) * (center[2] - reach) if kind != "glass" else 0.0
        bar = box([-w, -y, low], [w, y, low + foot])
        if kind in ("glass", "drum") or (tall < 0.4 and kind == "mirror" and rng.random() < 0.6):
            bar = box([-spread, -y, 0], [spread, y, foot])
        shaft = cylinder("y", [0, 0, center[2]], 1, 0.6 * w, segments=14)  # bored for a crank
        frame = tidy(union([*solids, bar]) - (shaft if kind == "drum" else Manifold()))
        stand.add(frame, finish)
    drawer = not hooped and kind == "mirror" and tall < 0.4 and rng.random() < 0.5
    if drawer:  # a chest with a drawer below the mirror
        d = float(rng.uniform(0.4, 0.6)) * half + spread
        h = float(rng.uniform(0.25, 0.4)) * tall + 6 * unit
        chest = box([-d, -y - wall, -h], [d, y + wall, 0])
        near = np.array([-d, -0.9 * y, -0.85 * h])
        far = np.array([0.8 * d, 0.9 * y, -0.15 * h])
        stand.add(chest - box(near - [1, air, air], far + air), finish)
    for s in (-1, 1):
        lo = s * (y + wall) if s > 0 else -y - wall - 1.5 * unit
        if kind != "drum" and not hooped:
            stand.add(cylinder("y", [0, lo, center[2]], 1.5 * unit, 0.8 * w, segments=16), metal)
    root = asm.add("stand", stand)
    gap = [
        cylinder("y", [0, a, 0], 0.4 * unit + air, 0.6 * w, segments=14)
        for a in (-half - 0.8 * air, half - 0.4 * unit)
    ]
    if kind == "drum":
        arm = max(float(rng.uniform(0.3, 0.6)) * reach, 7 * unit)
        end = half + air + wall
        lever = box([-1.3 * unit, end + air, -arm], [1.3 * unit, end + air + 2.4 * unit, 2 * unit])
        grip = cylinder("y", [0, end + air, -arm], 12 * unit, 2 * unit, segments=14)
        gap[1] = cylinder("y", [0, half - unit, 0], wall + 2 * air + 2 * unit, 0.45 * w)
        gap += [lever, grip]
    inside = union([solid for solid, _ in content])
    turned = merged([*content, (union(gap) - inside, metal)])
    move = np.eye(4)
    move[:3, 3] = center
    lean = (
        rotation_matrix(float(rng.uniform(-0.25, 0.25)), (0, 1, 0))
        if kind == "mirror"
        else np.eye(4)
    )
    free = kind != "mirror" or rng.random() < 0.35
    joint = (
        turn(center, (0, 1, 0))
        if free
        else hinge(center, (0, 1, 0), float(rng.choice([-1, 1])) * float(rng.uniform(0.4, 0.9)))
    )
    asm.add(kind, turned.moved(move @ lean), root, joint)
    if drawer:
        front = box(near, far) - box(near + 2 * unit, far + [-2 * unit, -2 * unit, 1])
        pull = ball([-d - 1.5 * unit, 0, -0.5 * h], 2.2 * unit, 14)
        shape = Shape().add(front, finish.darker(0.85)).add(tidy(pull - front), metal)
        asm.add("drawer", shape, root, slide((-1, 0, 0), float(rng.uniform(0.8, 1.5)) * d))
    return asm.object()


def _content(rng, kind, half, tall, round_one, unit, finish, metal) -> tuple[list, float, float]:
    """Solids, with their materials, of what turns about y through 0, ``half`` to each side; how
    far it reaches from the axis, and its half depth."""
    pieces: list[tuple[Manifold, Material]] = []
    if kind in ("mirror", "board"):
        deep, rim = float(rng.uniform(1, 2)) * unit, float(rng.uniform(2, 6)) * unit
        if round_one:
            frame = tube("x", [-deep, 0, 0], 2 * deep, half, half - rim, 40)
            pane = cylinder("x", [-0.5 * deep, 0, 0], deep, half - rim, segments=40)
        else:
            corner = (
                float(rng.choice([0.02, 0.3, 0.98])) * half if kind == "mirror" else 0.02 * half
            )
            outline = rounded(2 * half, 2 * tall, corner, 8)
            inner = outline * (1 - rim / np.array([half, tall]))
            pane = extrusion(inner, "x", [-0.5 * deep, 0, 0], deep)
            frame = extrusion(outline, "x", [-deep, 0, 0], 2 * deep) - extrusion(
                inner, "x", [-1, 0, 0], 2
            )
        face = plain(materials.hsv(rng, (0.5, 0.6), (0.03, 0.2), (0.7, 0.95)))
        if kind == "board":
            boards = ([0.1, 0.25, 0.18], [0.12, 0.12, 0.13], [0.93, 0.93, 0.93], [0.7, 0.52, 0.35])
            face = plain(np.array(boards[rng.integers(4)]) * rng.uniform(0.85, 1.05))
        rim_face = finish if rng.random() < 0.5 else metal
        return [(frame, rim_face), (pane, face)], float(np.hypot(tall, deep)), deep
    if kind == "glass":
        t = np.linspace(-1, 1, 21)
        z, waist = 0.86 * tall * t, 0.12
        r = (
            0.72
            * half
            * (waist + (1 - waist) * np.sin(np.pi / 2 * np.abs(t) ** 0.7) * (1 - 0.3 * t**6))
        )
        glass = revolution(
            np.vstack([[[0, z[0]]], np.column_stack([r, z]), [[0, z[-1]]]]), "z", [0, 0, 0], 24
        )
        sand = glass ^ (
            box([-1, -1, -1], [1, 1, -0.5 * tall])
            if rng.random() < 0.5
            else box([-1, -1, 0.2 * tall], [1, 1, 0.7 * tall])
        )
        square = rng.random() < 0.3
        plate = [
            extrusion(
                rounded(2 * half, 2 * half, 0.1 * half if square else half, 8),
                "z",
                [0, 0, a],
                0.14 * tall,
            )
            for a in (-tall, 0.86 * tall)
        ]
        count = int(rng.integers(3, 5))
        a = np.pi / 4 + 2 * np.pi * np.arange(count) / count
        rods = [
            cylinder(
                "z",
                [0.84 * half * np.cos(b), 0.84 * half * np.sin(b), -0.9 * tall],
                1.8 * tall,
                1.6 * unit,
                segments=12,
            )
            for b in a
        ]
        boss = [
            box([-1.5 * unit, s * 0.6 * half, -1.5 * unit], [1.5 * unit, s * half, 1.5 * unit])
            if s > 0
            else box([-1.5 * unit, -half, -1.5 * unit], [1.5 * unit, -0.6 * half, 1.5 * unit])
            for s in (-1, 1)
        ]
        band = tube("z", [0, 0, -1.5 * unit], 3 * unit, 0.9 * half, 0.78 * half, 28)
        hoop = tidy(union([*plate, *rods, *boss, band]))
        pale = plain(materials.hsv(rng, (0.4, 0.6), (0.03, 0.15), (0.8, 0.95)))
        pieces += [(hoop, finish), (glass - sand - hoop, pale)]
        pieces.append((sand - hoop, plain(rng.uniform([0.4, 0.3, 0.2], [0.95, 0.8, 0.7]))))
        return pieces, float(np.hypot(tall, half)), half
    reach = float(rng.uniform(0.8, 1.3)) * half
    ends = [
        cylinder("y", [0, a, 0], 2 * unit, reach, segments=30) for a in (-half, half - 2 * unit)
    ]
    if rng.random() < 0.5:  # bars
        count = int(rng.integers(10, 18))
        bars = [
            cylinder(
                "y",
                [0.93 * reach * np.cos(a), -half + unit, 0.93 * reach * np.sin(a)],
                2 * half - 2 * unit,
                1.1 * unit,
                segments=8,
            )
            for a in 2 * np.pi * np.arange(count) / count
        ]
        return [(union([*ends, *bars]), metal)], reach, reach
    sides = int(rng.choice([6, 8, 30]))
    drum = cylinder("y", [0, -half + unit, 0], 2 * (half - unit), 0.92 * reach, segments=sides)
    hatch = box([-0.4 * reach, -0.5 * half, 0], [0.4 * reach, 0.5 * half, 0.97 * reach])
    tone = plain(rng.uniform(0.1, 0.9, 3))
    return [(union([*ends, drum, hatch]), tone)], reach, reach


def _gimbal(rng: np.random.Generator) -> ArticulatedObject:
    """Rings that turn within one another, a ball, a disc or a compass within, on a foot."""
    radius = float(rng.uniform(0.08, 0.22))
    unit = radius / 45
    band, wide = float(rng.uniform(2.5, 4.5)) * unit, float(rng.uniform(3, 8)) * unit
    gap = 1.0 * unit + wide**2 / (3 * radius)
    finish, metal = _finish(rng), materials.hardware(rng)
    foot, rise = float(rng.uniform(2.5, 6)) * unit, float(rng.uniform(3, 50)) * unit
    center = np.array([0, 0, foot + rise + radius])
    yaw = float(rng.uniform(-0.8, 0.8))
    asm, frame = Assembly(), rotation_matrix(yaw, (0, 0, 1))
    frame[:3, 3] = center
    full = rng.random() < 0.4
    arc = (
        _ring(radius, radius - band, wide)
        if full
        else _ring(radius, radius - band, wide, np.pi / 2 - 0.15, 1.5 * np.pi + 0.15)
    )
    base = _foot(rng, 0.55 * radius, foot, foot + rise + 0.4 * band, 2.5 * unit)
    spun = arc.transform(frame[:3])
    tone = metal if rng.random() < 0.5 else finish
    root = asm.add("stand", merged([(base - spun, finish), (spun, tone)]))
    inner, parent, axis = radius - band, root, np.array([0.0, 1, 0])
    rings = int(rng.integers(1, 3))
    local = frame @ rotation_matrix(float(rng.uniform(0.4, 1.4)), axis)
    for k in range(rings):
        outer = inner - gap
        inner = outer - band
        ring = _ring(outer, inner, wide)
        pins = [
            cylinder(
                "y",
                [0, s * (outer - 0.4 * band) if s > 0 else -outer - 0.7 * gap, 0],
                0.4 * band + 0.7 * gap,
                1.2 * unit,
                segments=12,
            )
            for s in (-1, 1)
        ]
        pins = pins if k % 2 == 0 else [p.rotate((90, 0, 0)) for p in pins]
        tone = metal if k == 0 else materials.hardware(rng)
        way = local[:3, :3] @ (np.array([0.0, 1, 0]) if k % 2 == 0 else np.array([0.0, 0, 1]))
        shape = Shape().add(tidy(union([ring, *pins])), tone).moved(local)
        parent = asm.add("ring", shape, parent, turn(center, way))
        local = local @ rotation_matrix(
            float(rng.uniform(0.4, 1.4)), (0, 0, 1) if k % 2 == 0 else (0, 1, 0)
        )
    size = inner - gap
    upright = rings % 2 == 1  # its axle is square to the last ring's
    kind = str(rng.choice(["ball", "disc"]))
    if kind == "ball":
        size *= float(rng.uniform(0.6, 0.95))
        core = Shape().add(ball([0, 0, 0], size, 32), _map(rng, size))
    else:
        thick = float(rng.uniform(0.15, 0.4)) * size
        size = np.sqrt(size**2 - (thick / 2) ** 2) if size > thick else 0.7 * size
        disc = cylinder("z", [0, 0, -thick / 2], thick, size, segments=32)
        cap = tube("z", [0, 0, -0.6 * thick], 1.2 * thick, 0.75 * size, 0.6 * size, 28)
        core = Shape().add(tidy(disc - cap), finish).add(tidy(cap), metal)
    axle = cylinder("z", [0, 0, -inner + 0.3 * gap], 2 * inner - 0.6 * gap, 1.2 * unit, segments=12)
    core.add(tidy(axle - core.solid()), metal)
    lean = np.eye(4) if upright else rotation_matrix(np.pi / 2, (1, 0, 0))
    way = (local @ lean)[:3, 2]
    asm.add("core", core.moved(local @ lean), parent, turn(center, way))
    return asm.object()


def _tripod(rng: np.random.Generator) -> ArticulatedObject:
    """A telescope, a camera or a lamp that pans and tilts on three legs; at times the column slides
    or the legs fold."""
    low_one = rng.random() < 0.3
    apex = float(rng.uniform(0.12, 0.25)) if low_one else float(rng.uniform(0.4, 0.9))
    size = float(rng.uniform(0.07, 0.12)) if low_one else float(rng.uniform(0.14, 0.26))
    unit = (apex + 2 * size) / 100
    r, air = float(rng.uniform(1.1, 2.0)) * unit, 0.4 * unit
    finish, metal, dark = _finish(rng), materials.metal(rng, brushed=False), materials.dark(rng)
    hub, spread = 4 * unit, float(rng.uniform(0.32, 0.55))
    asm, body = Assembly(), Shape()
    column = cylinder("z", [0, 0, 0.5 * apex], apex - 0.5 * apex, 2 * unit, segments=16)
    core = cylinder("z", [0, 0, apex - 6 * unit], 6 * unit, hub, segments=24)
    folds = rng.random() < 0.3
    rise = not folds and rng.random() < 0.4
    hollow = cylinder("z", [0, 0, -1], 9, 1.9 * unit + air, segments=16)
    turned = float(rng.uniform(0, 2))
    legs = []
    for k in range(3):
        a = turned + 2 * np.pi * k / 3
        way = np.array([np.cos(a), np.sin(a), 0])
        start = way * (hub + (r + air if folds else 0)) + [0, 0, apex - 3.5 * unit]
        end = start + way * np.tan(spread) * (start[2] - r) - [0, 0, start[2] - r]
        middle = start + 0.55 * (end - start)
        leg = Shape().add(
            union([pipe([start, middle], r, 10), pipe([middle, end], 0.75 * r, 10)]), finish
        )
        legs.append((leg, start, np.cross([0, 0, 1], way)))
    root_solid = core + column
    if rise:
        root_solid = tidy(
            (core + cylinder("z", [0, 0, 0.5 * apex], 0.5 * apex, 3.0 * unit, segments=18)) - hollow
        )
    body.add(root_solid, dark)
    if not folds:
        together = union([leg.solid() for leg, *_ in legs])
        body.add(tidy(together - root_solid - hollow if rise else together - root_solid), finish)
    root = asm.add("tripod", body)
    for leg, start, way in legs if folds else ():
        asm.add("leg", leg, root, hinge(start, way, 0.8 * spread))
    top = apex
    if rise:
        rod = cylinder(
            "z", [0, 0, 0.52 * apex], apex + 8 * unit - 0.52 * apex, 1.9 * unit, segments=16
        )
        top = apex + 8 * unit
        root = asm.add("column", Shape().add(rod, metal), root, slide((0, 0, 1), 0.35 * apex))
    pivot = np.array([0, 0, top + air + 7.5 * unit])
    s, half = 2.4 * unit, 2.0 * unit
    plate = cylinder("z", [0, 0, top + air], 3 * unit, 3.6 * unit, segments=22)
    pan = [plate]
    for y in (-half - air - 1.4 * unit, half + air):
        pan += [
            cylinder("y", [0, y, pivot[2]], 1.4 * unit, s, segments=16),
            box([-s, y, top + air + unit], [s, y + 1.4 * unit, pivot[2]]),
        ]
    grip = []
    if rng.random() < 0.5:  # a bar to steer with
        far = float(rng.uniform(12, 20)) * unit
        z = top + air + 1.5 * unit
        grip = [pipe([[3 * unit, 0, z], [far, 0, z - far]], 0.9 * unit, 10)]
    head = asm.add(
        "pan_head",
        Shape().add(tidy(union([*pan, *grip])), dark),
        root,
        turn((0, 0, top), (0, 0, 1)),
    )
    shape, lens = _device(rng, size, pivot[2] + 3.2 * unit, unit, finish, metal, dark)
    lug = union(
        [
            cylinder("y", [0, -half, pivot[2]], 2 * half, s, segments=16),
            box([-s, -half, pivot[2]], [s, half, pivot[2] + 3.2 * unit + 0.2 * size]),
        ]
    )
    shape.add(tidy(lug - shape.solid()), dark)
    up = float(rng.uniform(0.35, 0.7)) * float(rng.choice([-1, 1], p=[0.25, 0.75]))
    device = asm.add("device", shape, head, hinge(pivot, (0, 1, 0), up))
    if lens is not None:
        name, part, joint = lens
        asm.add(name, part, device, joint)
    return asm.object()


def _device(rng, size, z, unit, finish, metal, dark) -> tuple[Shape, tuple | None]:
    """A device above the plane ``z``, looking along -x, and a part of it that moves: (name, shape,
    joint)."""
    shape = Shape()
    air = 0.4 * unit
    kind = str(rng.choice(["telescope", "camera", "lamp"], p=[0.42, 0.33, 0.25]))
    tone = finish if rng.random() < 0.4 else plain(rng.uniform(0.1, 0.95, 3))
    if kind == "telescope":
        r, long = size * float(rng.uniform(0.22, 0.5)), size * float(rng.uniform(1.6, 3.4))
        mid = z + r
        share = float(rng.uniform(0.45, 0.6))
        barrel = cylinder(
            "x", [-share * long, 0, mid], long, r, float(rng.uniform(0.7, 1.0)) * r, 26
        )
        shape.add(barrel, tone)
        hood = cylinder("x", [-(share + 0.16) * long, 0, mid], 0.16 * long, 1.15 * r, segments=26)
        hood -= cylinder("x", [-(share + 0.2) * long, 0, mid], 0.16 * long, 0.95 * r, segments=26)
        shape.add(hood, metal)
        end = (1 - share) * long
        eye = cylinder("x", [end, 0, mid], 0.12 * long, 0.4 * r, segments=18)
        shape.add(eye, dark)
        if rng.random() < 0.6:  # a finder
            finder = cylinder("x", [0, 0, mid + 1.5 * r], 0.4 * long, 0.25 * r, segments=14)
            posts = [
                box([x, -0.1 * r, mid + 0.9 * r], [x + 0.2 * r, 0.1 * r, mid + 1.5 * r])
                for x in (0.08 * long, 0.3 * long)
            ]
            shape.add(tidy(union([finder, *posts]) - barrel), dark)
        cap = cylinder(
            "x",
            [end + 0.12 * long + air, 0, mid],
            0.12 * long,
            max(0.55 * r, 2 * unit),
            segments=18,
        )
        return shape, ("eyepiece", Shape().add(cap, dark), turn((0, 0, mid), (1, 0, 0)))
    if kind == "camera":
        wide, tall, deep = (
            size * float(rng.uniform(0.5, 0.8)),
            size * float(rng.uniform(0.6, 1.0)),
            size * float(rng.uniform(0.35, 1.0)),
        )
        shape.add(box([-deep / 2, -wide, z], [deep / 2, wide, z + tall]), tone)
        r = float(rng.uniform(0.5, 0.8)) * min(wide, tall / 2)
        bump = box([-0.3 * deep, -0.4 * wide, z + tall], [0.3 * deep, 0.4 * wide, z + 1.2 * tall])
        shape.add(bump, dark)
        mid = z + tall / 2
        mount = cylinder("x", [-deep / 2 - 0.3 * r, 0, mid], 0.3 * r, r, segments=24)
        shape.add(mount, metal)
        if rng.random() < 0.5:  # a screen that folds out behind, hinged at its side
            thick = 2 * unit
            screen = box(
                [deep / 2 + air, -0.85 * wide, z + 0.15 * tall],
                [deep / 2 + air + thick, 0.85 * wide, z + 0.85 * tall],
            )
            joint = hinge(
                (deep / 2 + air + thick, 0.85 * wide, mid), (0, 0, 1), float(rng.uniform(1.5, 2.6))
            )
            lens = cylinder("x", [-deep / 2 - 1.4 * r, 0, mid], 1.1 * r, 0.9 * r, segments=24)
            shape.add(lens, dark)
            return shape, ("screen", Shape().add(screen, dark), joint)
        long = r * float(rng.uniform(0.8, 2.5))
        x = -deep / 2 - 0.3 * r - air
        lens = cylinder("x", [x - long, 0, mid], long, 0.95 * r, 0.9 * r, 24)
        lens -= cylinder("x", [x - long - 1, 0, mid], 1 + 0.3 * long, 0.75 * r, segments=20)
        ridge = box(
            [x - 0.7 * long, -1.2 * unit, mid + 0.8 * r],
            [x - 0.3 * long, 1.2 * unit, mid + 1.15 * r],
        )
        return shape, ("lens", Shape().add(tidy(lens + ridge), dark), turn((x, 0, mid), (1, 0, 0)))
    r, deep = 0.6 * size, size * float(rng.uniform(0.5, 1.0))
    mid = z + r
    square = rng.random() < 0.5
    can = (
        box([-deep / 2, -r, z], [deep / 2, r, mid + r])
        if square
        else cylinder("x", [-deep / 2, 0, mid], deep, r, float(rng.uniform(0.5, 1)) * r, 26)
    )
    shape.add(can, tone)
    glow = (
        box([-deep / 2 - unit, -0.85 * r, mid - 0.85 * r], [-deep / 2, 0.85 * r, mid + 0.85 * r])
        if square
        else (cylinder("x", [-deep / 2 - unit, 0, mid], unit, 0.9 * r, segments=24))
    )
    shape.add(glow, plain((1.0, 0.96, 0.8)))
    if not square:
        return shape, None
    x = -deep / 2 - unit - air
    flap = box([x - 2 * unit, -0.95 * r, mid - 0.95 * r], [x, 0.95 * r, mid + 0.95 * r])
    return shape, (
        "flap",
        Shape().add(flap, dark),
        hinge((x - 2 * unit, 0, mid + 0.95 * r), (0, 1, 0), 2.0),
    )


def _rack(rng: np.random.Generator) -> ArticulatedObject:
    """Tiers that spin round a post: shelves with jars, pockets with cards, hooks, or a case for
    books."""
    tall = rng.random() < 0.5
    high = float(rng.uniform(1.0, 1.7)) if tall else float(rng.uniform(0.15, 0.5))
    radius = high * (float(rng.uniform(0.13, 0.25)) if tall else float(rng.uniform(0.25, 0.7)))
    unit = max(high, 2 * radius) / 100
    finish, metal = _finish(rng), materials.hardware(rng)
    air, post, foot = (
        0.4 * unit,
        float(rng.uniform(1.2, 2.2)) * unit,
        float(rng.uniform(2, 4)) * unit,
    )
    count = int(rng.integers(1, 5)) if tall else int(rng.integers(1, 4))
    kind = str(rng.choice(["shelves", "pockets", "hooks", "case"], p=[0.4, 0.25, 0.15, 0.2]))
    if tall and kind != "shelves":
        count = int(rng.integers(2, 5)) + (kind == "pockets")
    whole = count > 1 and rng.random() < 0.35  # all tiers turn as one
    asm, stand = Assembly(), Shape()
    base = _foot(rng, radius * float(rng.uniform(0.6, 0.9)), foot, high, post)
    low = max(4.2 * foot, 0.12 * high)
    base -= tube("z", [0, 0, low - air], 9, 9, post)  # nothing wider than the post in the tiers
    knob = ball([0, 0, high + unit], 2.5 * unit, 16)
    stand.add(tidy(base - knob), finish).add(knob, metal)
    root = asm.add("stand", stand)
    pitch = (high - low - unit) / count
    sides, turned = int(rng.integers(3, 7)), float(rng.uniform(0, 90))
    tone = finish if rng.random() < 0.6 else metal
    tiers = []
    for k in range(count):
        wide = radius * (1 - 0.12 * k * float(rng.random() < 0.5))
        free = (1.2 if not whole or k == count - 1 else -0.4) * unit  # below the next tier
        start = low + k * pitch
        tiers.append(_tier(rng, kind, wide, start, pitch - free, post + air, sides, unit, tone))
    if whole:
        tiers = [[piece for tier in tiers for piece in tier]]
    for tier in tiers:
        asm.add("tier", merged(tier, turned), root, turn((0, 0, 0), (0, 0, 1)))
    return asm.object()


def _tier(rng, kind, radius, low, high, hole, sides, unit, tone) -> list:
    """One tier round a post in a ``hole``, from ``low`` up, ``high`` in all: solids, materials."""
    sleeve = tube("z", [0, 0, low], high, hole + 1.5 * unit, hole, 20)
    thick = 1.5 * unit
    if kind == "hooks":
        bars = [sleeve]
        for k in range(2 * sides):
            a = np.pi * k / sides
            c, s = np.cos(a), np.sin(a)
            z = low + high * (0.85 if k % 2 else 0.4)
            bars.append(
                pipe(
                    [
                        [(hole + unit) * c, (hole + unit) * s, z],
                        [radius * c, radius * s, z],
                        [1.02 * radius * c, 1.02 * radius * s, z + 4 * unit],
                    ],
                    0.8 * unit,
                    8,
                )
            )
        solid = union(bars) - cylinder("z", [0, 0, 0], 9, hole, segments=20)
        return [(solid, tone)]
    plate = tube("z", [0, 0, low], thick, radius, hole, 36)
    if kind == "case" or (kind == "pockets" and rng.random() < 0.5):
        plate = tube("z", [0, 0, low], thick, radius, hole, 4).rotate((0, 0, 45))
        sides = 4
    solids = [sleeve, plate]
    goods = []
    inside = radius * (0.72 if sides == 4 else 0.8)
    for k in range(sides):
        turned = 360.0 * k / sides
        color = plain(rng.uniform(0.1, 0.95, 3))
        if kind == "case":  # walls that make room for books
            w = 0.68 * radius
            wall = box([hole, -thick / 2, low], [w, thick / 2, low + high])
            solids.append(wall.rotate((0, 0, turned)))
            long, at = 0.8 * (w - hole - 2 * unit), hole + 3 * unit
            for _ in range(3):
                wide = float(rng.uniform(2, 5)) * unit
                if at + wide > w or long < 3 * unit:
                    break
                book = box(
                    [at, thick / 2 + 0.2 * unit, low + thick],
                    [at + wide, long, low + high * rng.uniform(0.6, 0.9)],
                )
                goods.append((book.rotate((0, 0, turned)), plain(rng.uniform(0.1, 0.9, 3))))
                at += wide + 0.3 * unit
        elif kind == "pockets":  # cards that lean outwards
            w = 0.85 * inside * np.tan(np.pi / max(sides, 4))
            card = box(
                [inside - 1.5 * thick, -w, low + thick],
                [inside - 0.5 * thick, w, low + 0.95 * high],
            )
            lip = box(
                [inside - 0.3 * thick, -1.05 * w, low],
                [inside + 0.7 * thick, 1.05 * w, low + 0.3 * high],
            )
            solids.append(lip.rotate((0, 0, turned)))
            goods.append((card.rotate((0, 0, turned)), color))
        elif rng.random() < 0.8:  # jars
            r = min(0.3 * radius, 0.75 * 0.65 * radius * np.sin(np.pi / sides))
            tall = high * float(rng.uniform(0.4, 0.85)) - thick
            jar = cylinder("z", [0.66 * radius, 0, low + thick], tall, r, segments=16)
            goods.append((jar.rotate((0, 0, turned)), color))
    if kind == "shelves" and rng.random() < 0.7:
        solids.append(tube("z", [0, 0, low], 5 * unit, radius, radius - unit, 36))
    solid = union(solids) - cylinder("z", [0, 0, 0], 9, hole, segments=20)
    kept = [(good - solid, color, good.volume()) for good, color in goods]
    return [(solid, tone), *((left, color) for left, color, v in kept if left.volume() > 0.3 * v)]

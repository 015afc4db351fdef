"""Bird houses, bread boxes and key cabinets, which open as letter boxes do. Lengths are in
metres."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.case_fronts import (
    add_panel,
    add_posts,
    doorway,
    draw_finish,
    open_at,
)
from uniart_jax.procedural.fronts import add_knob
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.pieces import merged
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cylinder,
    extrusion,
    hinge,
    pipe,
    slide,
    tidy,
    tube,
    union,
)


def bird_house(rng) -> Assembly:
    """A bird house in metres: a front that swings, or a roof hinged at the rear."""
    wide = float(rng.uniform(0.14, 0.24))
    high, deep = wide * float(rng.uniform(1.2, 1.8)), wide * float(rng.uniform(0.8, 1.15))
    base = high * float(rng.choice([0.0, rng.uniform(0.7, 1.6)], p=[0.6, 0.4]))
    unit, half, wall = (high + base) / 100, wide / 2, 0.07 * wide
    face = materials.wood(rng) if rng.random() < 0.65 else draw_finish(rng)
    cover = draw_finish(rng) if rng.random() < 0.6 else face
    gable = rng.random() < 0.6
    rise = half * float(rng.uniform(0.6, 1.1)) if gable else deep * float(rng.uniform(0.12, 0.35))
    low = high - rise
    asm, body, roof = Assembly(), Shape(), Shape()
    t = 0.08 * wide
    over = float(rng.uniform(0.08, 0.2)) * wide
    if gable:
        poly = np.array([[-half, 0], [half, 0], [half, low], [0, high], [-half, low]])
        solid = extrusion(poly, "x", [0, 0, base], deep)
        slope = np.array([half, -rise]) / np.hypot(half, rise)
        eave = np.array([0, high]) + slope * (np.hypot(half, rise) + over)
        up = np.array([0, t * np.hypot(half, rise) / half])
        mirror = np.array([-1, 1])
        sheet = np.array(
            [[0, high], eave, eave + up, [0, high] + up, (eave + up) * mirror, eave * mirror]
        )
        sheet[:, 1] += 0.3 * unit
        roof.add(extrusion(sheet, "x", [-over, 0, base], deep + over), cover)
        at = (deep, 0, base + low)
    else:
        poly = np.array([[0, 0], [low, 0], [high, deep], [0, deep]])
        solid = extrusion(poly, "y", [0, -half, base], wide)
        slope = np.array([-rise, -deep]) / np.hypot(rise, deep)
        back = np.array([high + 0.3 * unit, deep])
        front = back + slope * (np.hypot(rise, deep) + over)
        sheet = np.array([back, front, front + [t, 0], back + [t, 0]])
        roof.add(extrusion(sheet, "y", [0, -half - 0.6 * over, base], wide + 1.2 * over), cover)
        at = (deep, 0, base + high + 0.3 * unit)
    solid -= box([wall, wall - half, base + wall], [deep - wall, half - wall, base + 0.98 * low])
    r, z = wide * float(rng.uniform(0.12, 0.18)), base + low * float(rng.uniform(0.55, 0.7))
    opens = rng.random() < (0.75 if gable else 0.55)
    span = (-half, half, base + 0.02 * low, base + 0.97 * low)
    perch = cylinder(
        "x", [-0.3 * wide, 0, z - 2 * r], 0.3 * wide + 0.2 * wall, 1.3 * unit, segments=10
    )
    hole = cylinder("x", [-1, 0, z], 1 + 2 * wall, r, segments=20)
    if opens:
        solid -= doorway(span, wall, 2 * wall)
    else:
        solid -= hole
        body.add(perch - solid, cover)
    body.add(tidy(solid), face)
    if base:
        add_posts(rng, body, wide, deep, base, unit)
    lifts = not opens or (not gable and rng.random() < 0.3)
    if not lifts:
        body.join(roof)
    root = asm.add("body", body)
    if opens:
        x = -0.3 * unit
        leaf = box([x - wall, span[0], span[2]], [x, span[1], span[3]])
        side = str(rng.choice(["left", "right", "bottom"]))
        shape = Shape().add(leaf - hole, face if rng.random() < 0.5 else draw_finish(rng))
        shape.add(perch.translate((x - wall, 0, 0)) - leaf, cover)
        asm.add("front", shape, root, open_at(rng, side, x - wall, span, 70, 110))
    if lifts:
        if gable:  # about the rear edge of the eaves
            at = (deep, 0, base + low)
        asm.add("roof", roof, root, hinge(at, (0, 1, 0), float(np.deg2rad(rng.uniform(50, 90)))))
    return asm


def bread_box(rng) -> Assembly:
    """A bread box in metres: a roll top that turns back under the roof, or a flap; a drawer
    below."""
    wide = float(rng.uniform(0.32, 0.5))
    r = wide * float(rng.uniform(0.26, 0.36))
    unit, half = wide / 100, wide / 2
    face = draw_finish(rng)
    cheek = face if rng.random() < 0.4 else materials.wood(rng)
    second = face if rng.random() < 0.5 else draw_finish(rng)
    metal, floor = materials.hardware(rng), 2 * unit
    asm = Assembly()
    body: list[tuple[Manifold, Material]] = []
    end, t, gap = 2.2 * unit, 1.3 * unit, 0.4 * unit
    angle = np.linspace(0, np.pi / 2, 10)
    c, s = np.cos(angle), np.sin(angle)
    straight = rng.random() < 0.4
    if straight:  # slanting front, a flap hinged below or above
        deep, high = 1.5 * r, r * float(rng.uniform(1.0, 1.5))
        lean = high * float(rng.uniform(0.1, 0.6))
        poly = np.array([[0, 0], [high, lean], [high, deep], [0, deep]])
        body.append((extrusion(poly, "y", [0, -half, 0], end), cheek))
        body.append((extrusion(poly, "y", [0, half - end, 0], end), cheek))
        inside = half - end
        body.append(
            (
                union(
                    [
                        box([0.02 * deep, -inside, 0], [deep, inside, floor]),
                        box([deep - floor, -inside, 0], [deep, inside, high]),
                        box([lean + 2.5 * unit, -inside, high - floor], [deep, inside, high]),
                    ]
                ),
                face,
            )
        )
        root = asm.add("body", merged(body))
        n = np.array([lean, -high]) / np.hypot(lean, high)  # outwards (z, x)
        a, b = np.array([0.0, 0]) + 0.3 * unit * n, np.array([high, lean]) + 0.3 * unit * n
        sheet = np.array([a, b, b + 1.6 * unit * n, a + 1.6 * unit * n])
        w = half
        shape = Shape().add(extrusion(sheet, "y", [0, -w, 0], 2 * w), second)
        below = rng.random() < 0.5
        grip = (a * 0.14 + b * 0.86 if below else a * 0.86 + b * 0.14) + 3 * unit * n
        shape.add(cylinder("y", [grip[1], -0.2 * half, grip[0]], 0.4 * half, 1.4 * unit), metal)
        at, way = (a + 1.6 * unit * n, -1) if below else (b + 1.6 * unit * n, 1)
        swing = float(np.deg2rad(rng.uniform(60, 85 if below else 100)))
        asm.add("flap", shape, root, hinge((at[1], 0, at[0]), (0, way, 0), swing))
        return asm
    deep = r * float(rng.uniform(1.85, 2.0))
    lift = float(rng.choice([0.0, rng.uniform(0.3, 0.5)])) * r
    rear = (
        r * np.cos(np.linspace(np.pi / 2, np.pi, 10)),
        r * np.sin(np.linspace(np.pi / 2, np.pi, 10)),
    )
    arc = np.column_stack([np.append(s * r, rear[1]), r - np.append(c * r, rear[0])])
    arc[:, 1] = np.minimum(arc[:, 1], deep)
    base = lift + floor
    poly = np.vstack([[[0, 0]], arc + [base, 0], [[0, deep]]])
    for y in (-half, half - end):
        body.append((extrusion(poly, "y", [0, y, 0], end), cheek))
    inside = half - end
    reach, back = inside + (0.5 * end if cheek is face else 0.0), deep - 0.2 * unit
    rear_wall = box([deep - t, -reach, base], [back, reach, base + r])
    rear_wall ^= cylinder("y", [r, -reach, base], 2 * reach, r - 0.6 * t, segments=48)
    rear_wall += box([deep - t, -reach, 0], [back, reach, base + unit])
    ring = tube("y", [r, -reach, base], 2 * reach, r - gap, r - t, 48) ^ box(
        [0, -1, base + 0.5 * unit], [back, 1, 2]
    )
    body.append(
        (
            union(
                [
                    ring ^ box([r, -1, 0], [3, 1, 2]),
                    box([0.2 * unit, -reach, lift], [back, reach, base]),
                    rear_wall,
                ]
            ),
            face,
        )
    )
    if lift:
        body.append((box([0.2 * unit, -reach, 0], [back, reach, 0.6 * unit]), face))
    root = asm.add("body", merged(body))
    span, far = inside - gap, r - t - gap
    most = float(np.arcsin((deep - t - gap - r) / far)) - 0.12
    lid = tube("y", [r, -span, base], 2 * span, far, far - t, 48)
    lid ^= box([-1, -1, base + gap], [r + 2 * unit, 1, 2])
    shape = Shape().add(lid, second)
    x = r - (r - t) * np.cos(0.3)
    bar = [[x, sense * 0.3 * half, base + r * 0.3] for sense in (-1, 1)]
    shape.add(pipe(bar, 1.3 * unit, 8) - lid, metal)
    most = min(float(rng.uniform(0.8, 1.15)), most)
    asm.add("roll_top", shape, root, hinge((r, 0, base), (0, 1, 0), most))
    if lift:
        drawer = box([-1.6 * unit, -half, 0.8 * unit], [-0.3 * unit, half, base - unit])
        tub = box([-0.4 * unit, gap - inside, unit], [0.85 * deep, inside - gap, lift - gap])
        tub -= box(
            [0.6 * unit, gap + unit - inside, 2 * unit], [0.82 * deep, inside - gap - unit, 1]
        )
        front = Shape().add(union([drawer, tub]), second)
        front.add(cylinder("x", [-4.5 * unit, 0, base / 2], 2.9 * unit, 1.8 * unit), metal)
        asm.add("drawer", front, root, slide((-1, 0, 0), float(rng.uniform(0.4, 0.7)) * deep))
    return asm


def key_cabinet(rng) -> Assembly:
    """A shallow cabinet for keys or medicine, in metres: one or two doors, hooks and a shelf
    inside."""
    wide = float(rng.uniform(0.2, 0.4))
    high, deep = wide * float(rng.uniform(0.8, 1.5)), wide * float(rng.uniform(0.2, 0.4))
    unit, half, wall = max(wide, high) / 100, wide / 2, 0.035 * wide
    face, metal = draw_finish(rng), materials.hardware(rng)
    asm, body = Assembly(), Shape()
    solid = box([0, -half, 0], [deep, half, high])
    solid -= doorway((-half, half, 0, high), wall, deep - wall)
    if rng.random() < 0.4:
        shelf = high * float(rng.uniform(0.2, 0.4))
        solid += box([0.1 * deep, -half, shelf], [deep, half, shelf + 0.8 * wall])
    body.add(solid, face)
    for z in (0.55 * high, 0.8 * high):
        hooks = [
            cylinder("x", [0.5 * deep, y, z], 0.52 * deep - wall, 0.8 * unit, segments=8)
            for y in np.linspace(-0.7, 0.7, 5) * half
        ]
        body.add(union(hooks) - solid, metal)
    root = asm.add("body", body)
    second = face if rng.random() < 0.5 else draw_finish(rng)
    if rng.random() < 0.3:
        spans = [("left", (-half, -0.3 * unit, 0, high)), ("right", (0.3 * unit, half, 0, high))]
    else:
        spans = [(str(rng.choice(["left", "right"])), (-half, half, 0.0, high))]
    for side, span in spans:
        door = add_panel(
            rng,
            asm,
            root,
            "door",
            side,
            span,
            unit,
            second,
            metal,
            marked=True,
            swing=(80, 150),
            pull=len(spans) == 2 or rng.random() < 0.5,
            thick=2.2 * unit,
        )
    if len(spans) == 1 and rng.random() < 0.5:
        y = (0.7 if spans[0][0] == "left" else -0.7) * half
        at = (-2.5 * unit, y, (0.3 if rng.random() < 0.5 else 0.62) * high)
        add_knob(asm, door, at, 4 * unit, 4 * unit, metal, materials.dark(rng), float(np.pi / 2))
    return asm

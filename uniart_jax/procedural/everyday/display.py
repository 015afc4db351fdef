"""Monitors and televisions: screens that tilt, swivel, rise and pivot on stands, trolleys and arms;
old television sets with knobs, aerials and handles."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.display_stands import (
    ACROSS,
    UP,
    Link,
    add_clamp,
    add_foot,
    add_head,
    add_trolley,
    both_ways,
    flat_bar,
    swivel,
)
from uniart_jax.procedural.fronts import add_knob
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.pieces import layered, merged
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    extrusion,
    hinge,
    hull,
    loft,
    pipe,
    rounded,
    slide,
    tidy,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A display in metres. A joint that turns both ways rests at one of its limits."""
    kind = rng.choice(3, p=[0.52, 0.24, 0.24])
    obj = (_on_stand, _on_arm, _old_set)[kind](rng).object()
    ends = np.zeros(len(obj.parts))
    for k, joint in enumerate(obj.joints):
        if joint.type == "revolute" and joint.limits[0] < 0 < joint.limits[1]:
            ends[k] = joint.limits[int(rng.integers(2)) if joint.direction[2] else 0]
    return obj.shown_at(ends) if ends.any() else obj


def _draw_finish(rng: np.random.Generator) -> Material:
    """Black, white, silver or coloured plastic."""
    kind = rng.choice(4, p=[0.4, 0.22, 0.18, 0.2])
    if kind == 3:
        return plain(materials.hsv(rng, (0, 1), (0.2, 0.8), (0.3, 0.9)))
    return (materials.dark, materials.white_plastic, materials.metal)[kind](rng)


def _picture(rng: np.random.Generator) -> Material:
    """A screen that is off, or lit in some colour."""
    if rng.random() < 0.55:
        return materials.dark_glass(rng)
    return plain(materials.hsv(rng, (0, 1), (0.1, 0.8), (0.3, 0.95)))


def _screen(rng, at, wide: float, tall: float, unit: float, case) -> tuple[Shape, list[Link]]:
    """A frame around a picture with a hump behind it; the middle of its rear is at ``at``. Also the
    keys in a chin below the picture."""
    thick = float(rng.uniform(1.5, 6)) * unit
    hump = float(rng.uniform(1, 6)) * unit if rng.random() < 0.6 else 0.0
    rim = float(rng.choice([0.8, 1.5, 3.0, 5.0])) * unit
    chin = rim + float(rng.choice([0.0, 2.5, 5.0, 9.0])) * unit
    slab = extrusion(
        rounded(wide, tall, float(rng.uniform(0.2, 4)) * unit), "x", [-hump - thick, 0, 0], thick
    )
    front, shape, holes, keys = -hump - thick, Shape(), [], []
    if hump:
        y, z = wide * float(rng.uniform(0.2, 0.46)), tall * float(rng.uniform(0.2, 0.44))
        s = float(rng.uniform(0.5, 1.0))
        corners = [[-hump, a * y, b * z] for a in (-1, 1) for b in (-1, 1)]
        corners += [[0, s * a * y, s * b * z] for a in (-1, 1) for b in (-1, 1)]
        slab += hull(np.array(corners))
    press = 1.2 * unit
    if chin > 4.5 * unit and thick > 2.2 * unit and rng.random() < 0.7:
        count, h = int(rng.choice([1, 2, 3], p=[0.5, 0.25, 0.25])), 0.36 * chin
        w = max(h, float(rng.uniform(1.7, 4)) * unit)
        h = max(h, 1.6 * unit)
        first = float(rng.choice([0, 0.4 * wide - 2.6 * w * count])) - 1.3 * w * (count - 1)
        tone = _draw_finish(rng)
        for k in range(count):
            y, z = first + 2.6 * w * k, chin / 2 - tall / 2
            key = box([front - press, y - w, z - h], [front + 0.3 * unit, y + w, z + h])
            a = 0.2 * unit
            holes.append(
                box([front - 1, y - w - a, z - h - a], [front + 1.7 * unit, y + w + a, z + h + a])
            )
            keys.append(("button", merged([(key.translate(at), tone)]), slide((1, 0, 0), press)))
    shape.add(tidy(cut(slab, holes)).translate(at), case)
    lo, hi = [-wide / 2 + rim, -tall / 2 + chin], [wide / 2 - rim, tall / 2 - rim]
    glass = box([front - 0.3 * unit, *lo], [front, *hi])
    shape.add(glass.translate(at), _picture(rng))
    for _ in range(int(rng.choice([0, 1, 2, 3], p=[0.5, 0.2, 0.2, 0.1]))):  # windows, or a scene
        a, b = rng.uniform(0.05, 0.5, 2), rng.uniform(0.5, 0.95, 2)
        size = np.array(hi) - lo
        x = front - float(rng.uniform(0.34, 0.8)) * unit
        pane = box([x, *(lo + a * size)], [front - 0.3 * unit, *(lo + b * size)])
        shape.add(pane.translate(at), plain(rng.uniform(0.1, 0.95, 3)))
    return shape, keys


def _joined(links: list[Link], keys: list[Link]) -> Assembly:
    """A chain of parts, with the keys on the last one."""
    asm, parent = Assembly(), -1
    for name, shape, joint in links:
        parent = asm.add(name, _tidied(shape), parent, joint)
    for name, shape, joint in keys:
        asm.add(name, shape, parent, joint)
    return asm


def _tidied(shape: Shape) -> Shape:
    """A shape whose solids no longer overlap; the later ones are cut."""
    return layered(shape.pieces())


def _measures(rng, least: float, most: float) -> tuple[float, float]:
    """Width and height of a picture between ``least`` and ``most``: wide, cinema, office or old
    square formats."""
    wide = float(rng.uniform(least, most))
    return wide, wide / float(rng.choice([16 / 9, 21 / 9, 1.6, 4 / 3, 5 / 4])) + 0.03 * wide


def _on_stand(rng: np.random.Generator) -> Assembly:
    """A screen on a foot or a trolley, whose column may swivel and rise and whose head tilts and
    pivots."""
    cart = rng.random() < 0.18
    wide, tall = _measures(rng, *((0.8, 1.4) if cart else (0.35, 0.9)))
    unit, air = wide / 100, 0.3 * wide / 100
    case = _draw_finish(rng)
    metal = case if rng.random() < 0.4 else _draw_finish(rng)
    odds = {"swivel": 0.0 if cart else 0.5, "lift": 0.45, "tilt": 0.7, "pivot": 0.2}
    moves = {name: bool(rng.random() < share) for name, share in odds.items()}
    if not any(moves.values()):
        moves["tilt"] = True
    high = (9.0 if cart else float(rng.uniform(1.2, 3.5))) * unit
    reach = np.hypot(wide, tall) / 2 if moves["pivot"] else tall / 2
    gap = float(rng.uniform(20, 70) if cart else rng.uniform(3, 22)) * unit
    z = high + gap + reach
    r, half, wall = float(rng.uniform(1.8, 3)) * unit, float(rng.uniform(1.5, 4)) * unit, 1.5 * unit
    hinge_at = np.array([1.2 * unit + r + 0.06 * tall, 0, z])
    screen, keys = _screen(rng, np.array([0, 0, z]), wide, tall, unit, case)
    x, top = hinge_at[0], z - 1.6 * r - air  # the column carries the fork
    post = float(rng.uniform(1.6, 2.6)) * unit
    flat = float(rng.uniform(1, 3)) if rng.random() < 0.6 else 0.0

    def bar(low: float, end: float, grow: float) -> Manifold:
        """The column, round or flat, between two heights, grown by ``grow`` metres."""
        if not flat:
            return cylinder("z", [x, 0, low], end - low, post + grow, segments=20)
        outline = rounded(2 * (post + grow), 2 * (flat * post + grow), 0.5 * post)
        return extrusion(outline, "z", [x, 0, low], end - low)

    base = Shape()
    wheels = add_trolley(rng, base, x, wide, high, unit, metal) if cart else []
    if not cart:
        add_foot(rng, base, x, wide, high, unit, metal)
    links: list[Link] = [("base", base, None)]
    start = high - 0.001
    if moves["swivel"]:
        start = high + air
        disc = cylinder(
            "z", [x, 0, start], 1.4 * unit, float(rng.uniform(4, 7)) * unit, segments=24
        )
        links.append(("column", Shape().add(disc, metal), swivel(rng, [x, 0, 0])))
    if moves["lift"]:
        middle = start + (top - start) * float(rng.uniform(0.5, 0.75))
        deep = 0.8 * (middle - start - 1.4 * unit)
        well = bar(middle - deep - air, middle + 1, air)
        links[-1][1].add(bar(start, middle, 1.2 * unit) - well, metal)
        way = deep * float(rng.uniform(0.5, 0.85))
        inner = metal if rng.random() < 0.4 else materials.metal(rng, brushed=False)
        pole = Shape().add(bar(middle - deep, top + 0.3 * r, 0), inner)
        links.append(("pole", pole, slide(UP, way)))
    else:
        links[-1][1].add(bar(start, top + 0.3 * r, 0), metal)
    add_head(rng, links, hinge_at, screen, unit, (r, half, wall, top), moves, metal)
    asm = _joined(links, keys)
    for shape, joint in wheels:
        asm.add("wheel", shape, 0, joint)
    return asm


def _on_arm(rng: np.random.Generator) -> Assembly:
    """A screen on one or two arms that turn about the vertical, from a wall plate, a foot or a
    clamp."""
    wide, tall = _measures(rng, 0.45, 0.8)
    unit, air = wide / 100, 0.3 * wide / 100
    case, metal = _draw_finish(rng), _draw_finish(rng)
    tone = metal if rng.random() < 0.5 else _draw_finish(rng)
    count = int(rng.choice([1, 2], p=[0.35, 0.65]))
    r, thick = float(rng.uniform(2.2, 3)) * unit, float(rng.uniform(2.5, 4.5)) * unit
    side = float(rng.choice([-1, 1]))
    angles = np.deg2rad([side * rng.uniform(15, 60), -side * rng.uniform(15, 60)])[:count]
    lengths = rng.uniform(0.28, 0.48, count) * wide
    wall = rng.random() < 0.4
    low = tall / 2 + float(rng.uniform(2, 16)) * unit
    r_hinge, half = 2.2 * unit, float(rng.uniform(1.5, 3)) * unit
    points, z = [np.zeros(2)], low + count * (thick + air)
    for length, angle in zip(lengths[::-1], angles[::-1], strict=True):  # from the screen
        points.append(points[-1] + length * np.array([np.cos(angle), np.sin(angle)]))
    x = 1.2 * unit + max(r, r_hinge) + 0.06 * tall
    points = [p + [x, 0] for p in points[::-1]]
    middle = points[-1][1]
    post = points[0]
    root, clamp = Shape(), []
    if wall:
        h, y = float(rng.uniform(0.15, 0.4)) * tall, float(rng.uniform(6, 16)) * unit
        back = post[0] + 1.6 * r
        root.add(box([back, post[1] - y, low - h], [back + 2 * unit, post[1] + y, low + h]), metal)
        root.add(box([post[0], post[1] - r, low - 3 * r], [back, post[1] + r, low]), metal)
        root.add(cylinder("z", [*post, low - 3 * r], 3 * r, r, segments=18), metal)
    else:
        root.add(cylinder("z", [*post, 0], low, 0.8 * r, segments=18), tone)
        root.add(cylinder("z", [*post, low - 2 * r], 2 * r, r, segments=18), tone)
        clamp = add_clamp(rng, root, post, unit, metal)
    links: list[Link] = [("base", root, None)]
    for k in range(count):
        a, b, z0 = points[k], points[k + 1], low + air + k * (thick + air)
        rods = [cylinder("z", [*p, z0], thick, r, segments=18) for p in (a, b)]
        bar = union([*rods, flat_bar(a, b, 0.8 * r, z0 + 0.1 * thick, 0.8 * thick)])
        least = 40 if wall and k == 0 else 50
        swing = abs(angles[k]) + np.deg2rad(rng.uniform(0.3 * least, least))
        joint = hinge([*a, 0], UP, -np.sign(angles[k]) * swing)
        links.append(("arm", Shape().add(bar, tone), joint))
    z0 = z + 1.3 * r_hinge + 3 * air + 2 * unit
    hinge_at = np.array([x, middle, z0])
    foot = cylinder("z", [x, middle, z + air], 1.4 * unit, r, segments=18)
    pan = rng.random() < 0.6
    if pan:
        most = float(rng.uniform(20, 30))
        links.append(("knuckle", Shape(), both_ways(rng, [x, middle, 0], UP, most, most)))
    else:
        foot = cylinder("z", [x, middle, z - 0.001], 2 * unit, r, segments=18)
    links[-1][1].add(foot, tone)
    moves = {"tilt": bool(rng.random() < 0.75), "pivot": bool(rng.random() < 0.2)}
    screen, keys = _screen(rng, np.array([0, middle, z0]), wide, tall, unit, case)
    sizes = (r_hinge, half, 1.4 * unit, z + 1.2 * unit)
    add_head(rng, links, hinge_at, screen, unit, sizes, moves, tone)
    asm = _joined(links, keys)
    for name, shape, joint in clamp:
        asm.add(name, shape, 0, joint)
    return asm


def _old_set(rng: np.random.Generator) -> Assembly:
    """A deep set with a bulging picture, knobs and keys, an aerial, a handle, and legs or a
    foot."""
    wide = float(rng.uniform(0.3, 0.7))
    tall, deep = wide * float(rng.uniform(0.68, 0.95)), wide * float(rng.uniform(0.5, 0.95))
    unit, air = wide / 100, 0.3 * wide / 100
    case = materials.wood(rng) if rng.random() < 0.4 else _draw_finish(rng)
    trim = materials.hardware(rng)
    foot = str(rng.choice(["none", "legs", "swivel", "cradle"], p=[0.2, 0.3, 0.25, 0.25]))
    legs = {"none": 1.5, "legs": float(rng.uniform(8, 60)), "swivel": 3.5, "cradle": 11.5}[foot]
    low = legs * unit
    middle = low + tall / 2
    beside = rng.random() < 0.6
    strip = float(rng.uniform(0.2, 0.28)) * (wide if beside else tall)
    front = 0.35 * deep
    outline = rounded(wide, tall, float(rng.uniform(0.3, 8)) * unit)
    shell = extrusion(outline, "x", [0, 0, middle], front)
    taper = float(rng.uniform(0.55, 1.0))
    rear = loft(0.99 * outline, outline * taper, 0, deep - front + unit).rotate((90, 0, 90))
    rear = rear.translate((front - unit, 0, middle))
    body = shell + (rear if taper < 0.95 else extrusion(outline, "x", [0, 0, middle], deep))
    rim = 4 * unit
    lo, hi = np.array([-wide / 2 + rim, low + rim]), np.array([wide / 2 - rim, low + tall - rim])
    panel_lo, panel_hi = lo.copy(), hi.copy()
    if beside:
        lo[0], panel_hi[0] = lo[0] + strip, panel_lo[0] + strip - 2 * unit
    else:
        lo[1], panel_hi[1] = lo[1] + strip, panel_lo[1] + strip - 2 * unit
    centre = (lo + hi) / 2
    glass = rounded(hi[0] - lo[0], hi[1] - lo[1], 0.18 * (hi - lo).min())[:, [1, 0]]
    bulge = loft(0.85 * glass[:, ::-1], glass[:, ::-1], 0, 2.5 * unit).rotate((90, 0, 90))
    bulge = bulge.translate((-2.5 * unit, *centre))
    plate = box([-0.4 * unit, *panel_lo], [0, *panel_hi])
    solids = [(body, case), (plate, _draw_finish(rng)), (bulge, _picture(rng))]
    asm, stand = Assembly(), Shape()
    joint, root = None, -1
    mid_x = deep * 0.45
    if foot == "legs":
        splay = float(rng.uniform(0, 0.25)) * low
        for sx in (-1, 1):
            for sy in (-1, 1):
                a = np.array([deep / 2 + sx * 0.32 * deep * taper, sy * 0.36 * wide * taper])
                ends = [[*a, low + 0.2 * tall], [a[0] + sx * splay, a[1] + sy * splay, unit]]
                solids.append((pipe(ends, 1.4 * unit, 8) - body, trim))
    elif foot == "none":
        solids.append((box([0, -0.3 * wide, 0], [front, 0.3 * wide, low + unit]) - body, trim))
    else:
        disc = float(rng.uniform(0.24, 0.34)) * wide
        if foot == "swivel":
            stand.add(cylinder("z", [mid_x, 0, 0], low - air, disc, 0.85 * disc), trim)
            joint = swivel(rng, [mid_x, 0, 0])
        else:
            pad = cylinder("z", [mid_x, 0, 0], 6 * unit, disc, 0.9 * disc)
            barrel = cylinder("y", [mid_x, -0.5 * disc, low], disc, 8 * unit)
            room = cylinder("y", [mid_x, -2 * disc, low], 4 * disc, 8 * unit + air, segments=32)
            stand.add(tidy(pad - room), trim)
            solids.append((barrel - body, trim))
            joint = hinge([mid_x, 0, low], ACROSS, np.arcsin(5 * unit / disc))  # 8 to 12 degrees
        root = asm.add("base", stand)
    on_top = str(rng.choice(["none", "aerial", "handle"], p=[0.4, 0.35, 0.25]))
    top, links = low + tall, []
    if on_top == "aerial":
        at = np.array([0.2 * deep, 0, top + 3 * unit])
        puck = cylinder("z", [at[0], 0, top - 0.001], 1.5 * unit, 6 * unit, 5 * unit)
        solids.append((puck - body, trim))
        links = _aerial(rng, at, wide, unit, trim)
    elif on_top == "handle":
        x, y, r = 0.15 * deep, 0.3 * wide, 1.6 * unit
        line = [[x, s * y, top + z] for s, z in ((-1, r), (-1, 9 * unit), (1, 9 * unit), (1, r))]
        bar = pipe(np.array(line) + [0, 0, 0.3 * unit], r, 8)
        grip = Shape().add(tidy(bar), trim)
        links = [("handle", grip, hinge([x, 0, top + r], ACROSS, np.deg2rad(rng.uniform(60, 85))))]
    body_part = asm.add("set", _tidied(merged(solids)), root, joint)
    for name, shape, link in links:
        asm.add(name, shape, body_part, link)
    size = panel_hi - panel_lo
    axis = 1 if beside else 0
    count = int(np.clip(size[axis] // (1.6 * size[1 - axis]), 1, 3))
    radius = min(0.38 * size.min(), 6 * unit)
    for k in range(count):
        spot = (panel_lo + panel_hi) / 2
        spot[axis] = panel_hi[axis] - (1.4 + 2.6 * k) * radius
        sweep = None if rng.random() < 0.5 else float(np.deg2rad(rng.choice([180, 270])))
        tone = trim if rng.random() < 0.6 else case
        at = (-0.4 * unit, *spot)
        add_knob(asm, body_part, at, radius, radius, tone, plain((0.9, 0.9, 0.9)), sweep)
    return asm


def _aerial(rng, at: np.ndarray, wide: float, unit: float, trim: Material) -> list[Link]:
    """Two rods in a V that swing down to the sides."""
    links: list[Link] = []
    for side in (-1, 1):
        start = at + [0, side * 3 * unit, 0]
        lean = float(np.deg2rad(rng.uniform(10, 45)))
        long = wide * float(rng.uniform(0.4, 0.8))
        end = start + long * np.array([0, side * np.sin(lean), np.cos(lean)])
        rod = pipe([start, end], 1.4 * unit, 8)
        joint = hinge(start, (-side, 0, 0), np.deg2rad(85) - lean)
        links.append(("aerial", Shape().add(rod, trim), joint))
    return links

"""Cameras, camcorders and security cameras with lenses that turn or slide out, dials, buttons,
flashes and screens that swing. Binoculars, projectors and microscopes are in ``optics``."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.optics import (
    binoculars,
    draw_finish,
    knurled,
    lens,
    microscope,
    projector,
)
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cylinder,
    extrusion,
    hinge,
    pipe,
    rounded,
    slide,
    tidy,
    turn,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A camera or another optical device in metres, closed; it looks towards -x."""
    makers = (_still, _camcorder, _security, binoculars, projector, microscope)
    return makers[rng.choice(6, p=[0.42, 0.14, 0.1, 0.11, 0.12, 0.11])](rng)


def _still(rng: np.random.Generator) -> ArticulatedObject:
    """A compact, system, rangefinder or instant camera."""
    kind = str(rng.choice(["compact", "system", "instant"], p=[0.3, 0.5, 0.2]))
    width = float(rng.uniform(0.09, 0.15))
    ratio = {"compact": (0.5, 0.68), "system": (0.55, 0.8), "instant": (0.7, 1.05)}[kind]
    high = width * float(rng.uniform(*ratio))
    deep = width * float(rng.uniform(0.2, 0.32) if kind == "compact" else rng.uniform(0.28, 0.5))
    unit, half = width / 100, width / 2
    air = 0.4 * unit
    face, metal, trim = draw_finish(rng), materials.metal(rng, brushed=False), draw_finish(rng)
    body = Shape()
    outline = rounded(width, high, float(rng.uniform(2, 14)) * unit)
    case = extrusion(outline, "x", [0, 0, high / 2], deep)
    holes, side = [], float(rng.choice([1, -1], p=[0.85, 0.15]))  # of the hand
    door = None
    if rng.random() < 0.3:  # a flap for battery or film in front, below, beside the lens
        y0, y1 = sorted((side * 0.28 * width, side * 0.45 * width))
        door = ([0, y0, 0.12 * high], [3 * unit, y1, float(rng.uniform(0.42, 0.7)) * high])
        if kind == "instant" and rng.random() < 0.7:
            door = ([0, -0.38 * width, 0.1 * high], [3 * unit, 0.38 * width, 0.3 * high])
        holes.append(box(np.array(door[0]) - [1, air, air], np.array(door[1]) + air))
    skin = rng.random() < 0.5
    zone = box([-1, -1, 0.22 * high], [1, 1, 0.74 * high])
    case = case - union(holes) if holes else case
    leather = materials.dark(rng) if rng.random() < 0.6 else draw_finish(rng)
    for part, tone in ((tidy(case - zone), face), (tidy(case ^ zone), leather if skin else face)):
        body.add(part, tone)
    solid = case
    # lens: where it sits and how big
    up = 0.62 if kind == "instant" else 0.47
    big = float(rng.uniform(0.2, 0.3)) * width if kind == "system" else 0.2 * width
    radius = min(big, 0.42 * high) * (1 if door is None else 0.85)
    y = 0.0 if kind != "system" else -side * float(rng.uniform(0.0, 0.1)) * width
    if door is not None and kind != "instant":
        y = -side * 0.12 * width
    at = np.array([0.0, y, up * high])
    if kind == "instant" and door is not None:
        at[2] = max(at[2], 0.36 * high + radius)
        radius = min(radius, 0.95 * high - at[2])
    if kind == "system" and door is None and rng.random() < 0.7:  # a grip
        w = float(rng.uniform(0.07, 0.1)) * width
        post = extrusion(
            rounded(2.4 * w, 2 * w, w), "z", [0, side * (half - 1.2 * w), 0], 0.9 * high
        )
        post = tidy(post - box([0, -1, -1], [1, 1, 1]) - solid)
        body.add(post, leather)
        solid = solid + post
        at[1] = min(abs(at[1]), 0.05 * width) * -side
        radius = min(radius, abs(half - 2.5 * w - abs(at[1])))
    top = high
    flash = rng.random() < 0.45
    if kind == "system" and rng.random() < 0.65:  # the hump of the prism
        w, tall = float(rng.uniform(0.13, 0.2)) * width, float(rng.uniform(0.1, 0.2)) * width
        slope = np.array([[-w, 0], [w, 0], [0.6 * w, tall], [-0.6 * w, tall]]) + [at[1], high]
        hump = extrusion(slope, "x", [0, 0, 0], 0.85 * deep)
        body.add(hump, face)
        top, wide = high + tall, 0.6 * w
        flash_y, flash = at[1], rng.random() < 0.6
    else:
        flash_y, wide = -side * 0.27 * width, 0.14 * width
        if rng.random() < 0.6:  # a window of the finder
            a, b = sorted((flash_y - 0.07 * width, flash_y + 0.07 * width))
            pane = box([-unit, a, 0.78 * high], [0, b, 0.92 * high])
            if at[2] + radius < 0.77 * high or abs(flash_y - at[1]) > radius + 0.08 * width:
                body.add(tidy(pane - solid), materials.dark_glass(rng))
    tops = _tops(rng, body, high, deep, half, side, unit, metal, trim, flash_y, wide)
    asm_root = Assembly()
    root = asm_root.add("body", body)
    lens(rng, asm_root, root, at, radius, unit, trim if rng.random() < 0.5 else metal, kind)
    if door is not None:
        lo, hi = (np.array(p) for p in door)
        panel = Shape().add(box(lo, hi), face if rng.random() < 0.4 else trim)
        nail = box(
            [-unit, (lo + hi)[1] / 2 - 3 * unit, hi[2] - 4 * unit],
            [0, (lo + hi)[1] / 2 + 3 * unit, hi[2] - 2 * unit],
        )
        panel.add(nail, metal)
        joint = hinge((0, 0, lo[2]), (0, -1, 0), float(np.deg2rad(rng.uniform(70, 110))))
        asm_root.add("flap", panel, root, joint)
    if flash:  # flips up about its rear
        tall, reach = float(rng.uniform(4, 9)) * unit, 0.7 * deep
        lo, hi = (
            [0.05 * deep, flash_y - wide, top + air],
            [0.05 * deep + reach, flash_y + wide, top + air + tall],
        )
        head = Shape().add(box(lo, hi), face if rng.random() < 0.5 else trim)
        lamp = box([lo[0] - unit, lo[1] + unit, lo[2] + unit], [lo[0], hi[1] - unit, hi[2] - unit])
        head.add(lamp, plain((0.93, 0.93, 0.88)))
        joint = hinge((hi[0], 0, lo[2]), (0, 1, 0), float(np.deg2rad(rng.uniform(35, 80))))
        asm_root.add("flash", head, root, joint)
    for name, shape, joint in tops:
        asm_root.add(name, shape, root, joint)
    if rng.random() < 0.2:  # a screen at the back that swings out
        h = 0.4 * high
        x = deep + air
        panel = box([x, -0.34 * width, high / 2 - h], [x + 4 * unit, 0.34 * width, high / 2 + h])
        glass = box(
            [x + 4 * unit, -0.3 * width, high / 2 - 0.85 * h],
            [x + 4.5 * unit, 0.3 * width, high / 2 + 0.85 * h],
        )
        shape = Shape().add(panel, materials.dark(rng)).add(glass, materials.dark_glass(rng))
        joint = hinge(
            (x + 4 * unit, -side * 0.34 * width, 0), (0, 0, -side), float(np.deg2rad(170))
        )
        if rng.random() < 0.5:
            joint = hinge((x + 4 * unit, 0, high / 2 + h), (0, -1, 0), float(np.deg2rad(100)))
        asm_root.add("screen", shape, root, joint)
    return asm_root.object()


def _tops(rng, body, high, deep, half, side, unit, metal, trim, taken, wide) -> list[tuple]:
    """A button and dials on top, clear of what stands there already. A button's post is added to
    the body."""
    found = []
    x, air = 0.5 * deep, 0.4 * unit
    r = min(float(rng.uniform(5, 9)) * unit, 0.42 * deep)
    spots = [side * (half - 9 * unit), side * (half - 28 * unit), -side * (half - 10 * unit)]
    spots = [y for y in spots if abs(y - taken) > wide + r + unit]
    for k, y in enumerate(spots):
        kind = ("button" if k == 0 else "dial") if rng.random() < 0.7 else "none"
        if kind == "button":
            s, tall = 0.8 * r, float(rng.uniform(4, 7)) * unit
            body.add(cylinder("z", [x, y, high], 0.5 * tall, 0.7 * s), metal)
            cap = cylinder("z", [x, y, high + 0.45 * tall], 0.55 * tall, s, 0.9 * s)
            cap -= cylinder("z", [x, y, high], 0.85 * tall, 0.7 * s + 0.5 * air)
            knob = Shape().add(cap, metal if rng.random() < 0.5 else _bright(rng))
            found.append(("button", knob, slide((0, 0, -1), 0.3 * tall)))
        elif kind == "dial":
            tall = float(rng.uniform(3, 7)) * unit
            knob = knurled("z", [x, y, high + air], tall, r, int(rng.integers(12, 24)))
            shape = Shape().add(knob, trim if rng.random() < 0.5 else metal)
            mark = box(
                [x, y - 0.6 * unit, high + air + tall],
                [x + 0.8 * r, y + 0.6 * unit, high + air + tall + 0.6 * unit],
            )
            shape.add(mark, plain((0.95, 0.95, 0.95) if trim.color[0] < 0.5 else (0.1, 0.1, 0.1)))
            found.append(("dial", shape, turn((x, y, high), (0, 0, 1))))
    return found


def _bright(rng) -> Material:
    """Draw a bright plastic finish."""
    return plain(materials.hsv(rng, (0, 1), (0.6, 0.95), (0.6, 0.95)))


def _camcorder(rng: np.random.Generator) -> ArticulatedObject:
    """A camcorder: a screen that swings out of its side and a viewfinder that tilts at the rear."""
    long = float(rng.uniform(0.1, 0.3))
    unit = long / 100
    half, high = float(rng.uniform(14, 24)) * unit, float(rng.uniform(38, 60)) * unit
    face, metal, trim = draw_finish(rng), materials.metal(rng, brushed=False), draw_finish(rng)
    air, asm, body = 0.5 * unit, Assembly(), Shape()
    side = float(rng.choice([1, -1]))
    case = extrusion(
        rounded(2 * half, high, float(rng.uniform(2, 12)) * unit), "x", [0, 0, high / 2], long
    )
    body.add(case, face)
    up = high * float(rng.uniform(0.5, 0.62))
    radius = min(half, high - up) * float(rng.uniform(0.7, 0.95))
    if rng.random() < 0.5:  # a handle on top
        r, rise = float(rng.uniform(2, 3.2)) * unit, float(rng.uniform(12, 20)) * unit
        line = [
            [a * long, 0, z]
            for a, z in ((0.12, high), (0.2, high + rise), (0.75, high + rise), (0.82, high))
        ]
        line[0][2] = line[-1][2] = high - unit
        body.add(tidy(pipe(line, r, 10) - case), trim)
    elif rng.random() < 0.5:
        body.add(box([0.1 * long, -2 * unit, high], [0.3 * long, 2 * unit, high + 4 * unit]), trim)
    strap = [
        [0.15 * long, -side * half * 0.9, high * 0.6],
        [0.3 * long, -side * (half + 7 * unit), high * 0.55],
        [0.6 * long, -side * (half + 7 * unit), high * 0.55],
        [0.8 * long, -side * half * 0.9, high * 0.6],
    ]
    body.add(tidy(pipe(strap, 2.2 * unit, 8) - case), materials.dark(rng))
    root = asm.add("body", body)
    lens(rng, asm, root, np.array([0.0, 0, up]), radius, unit, trim, "system")
    x0, x1 = float(rng.uniform(0.04, 0.15)) * long, float(rng.uniform(0.6, 0.8)) * long
    thick, h = float(rng.uniform(3, 6)) * unit, float(rng.uniform(0.26, 0.36)) * high
    a, b = sorted((side * (half + air), side * (half + air + thick)))
    screen = Shape().add(
        box([x0, a, up - h], [x1, b, up + h]), trim if rng.random() < 0.5 else face
    )
    inner = side * (half + air)
    joint = hinge(
        (x0, side * (half + air + 0.9 * thick), 0),
        (0, 0, side),
        float(np.deg2rad(rng.uniform(80, 115))),
    )
    if inner and rng.random() < 0.5:
        c, d = sorted((side * (half + air + thick), side * (half + air + thick + unit)))
        screen.add(box([x0 + 6 * unit, c, up - 0.6 * h], [x1 - 6 * unit, d, up + 0.6 * h]), metal)
    asm.add("screen", screen, root, joint)
    if rng.random() < 0.6:
        r, reach = 0.5 * half, float(rng.uniform(12, 24)) * unit
        z = high - r - unit
        eye = cylinder("x", [long + air, 0, z], reach, r, 0.9 * r, 24)
        cup = cylinder("x", [long + air + reach, 0, z], 4 * unit, 1.1 * r, 1.25 * r, 24)
        shape = Shape().add(eye, face).add(cup, materials.dark(rng))
        asm.add(
            "finder",
            shape,
            root,
            hinge((long + air, 0, z + r), (0, -1, 0), float(np.deg2rad(rng.uniform(40, 90)))),
        )
    return asm.object()


def _security(rng: np.random.Generator) -> ArticulatedObject:
    """A security camera or webcam that pans on a foot and tilts in a fork."""
    s = float(rng.uniform(0.05, 0.12))
    unit, air = s / 50, s / 150
    face, trim = draw_finish(rng), draw_finish(rng)
    r, long = float(rng.uniform(0.3, 0.5)) * s, float(rng.uniform(0.7, 2.0)) * s
    asm, foot, fork, head = Assembly(), Shape(), Shape(), Shape()
    wide = float(rng.uniform(0.9, 1.5)) * r
    tall = float(rng.uniform(0.12, 0.6)) * s
    base = cylinder("z", [0, 0, 0], tall, wide, float(rng.uniform(0.75, 1.0)) * wide, 32)
    if rng.random() < 0.35:
        base = extrusion(rounded(2 * wide, 2 * wide, 0.3 * wide), "z", [0, 0, 0], tall)
    foot.add(base, face)
    root = asm.add("foot", foot)
    ball_head = rng.random() < 0.35
    long = 2 * r if ball_head else long
    reach = 1.06 * r if ball_head else float(np.hypot(r, 0.55 * long))
    z, t = tall + air, float(rng.uniform(2.5, 4)) * unit
    pivot = z + t + (reach if ball_head or rng.random() < 0.5 else r + 0.4 * long + 2 * unit) + air
    arms = [box([-0.3 * r, 0, z], [0.3 * r, t, pivot]) + cylinder("y", [0, 0, pivot], t, 0.42 * r)]
    arms = [arms[0].translate((0, y, 0)) for y in (r + air, -r - air - t)]
    if rng.random() < 0.3:
        arms = arms[:1]
    plate = cylinder("z", [0, 0, z], t, max(0.7 * wide, 0.4 * r), segments=32)
    bar = box(
        [-0.3 * r, -r - air - t if len(arms) == 2 else -0.3 * r, z], [0.3 * r, r + air + t, z + t]
    )
    fork.add(tidy(union([plate, bar, *arms])), trim)
    neck = asm.add("fork", fork, root, turn((0, 0, 0), (0, 0, 1)))
    if ball_head:
        shell = cylinder("y", [0, -r, pivot], 2 * r, r, segments=32) if rng.random() < 0.4 else None
        solid = shell or extrusion(
            rounded(2 * r, 2 * r, 0.9 * r, 8), "y", [0, -0.95 * r, pivot], 1.9 * r
        )
        solid = union([solid, cylinder("y", [0, -r, pivot], 2 * r, 0.4 * r)])
    else:
        solid = cylinder("x", [-0.5 * long, 0, pivot], long, r, segments=28)
        if rng.random() < 0.45:
            solid = extrusion(rounded(2 * r, 1.7 * r, 0.3 * r), "x", [-0.5 * long, 0, pivot], long)
    head.add(solid, face)
    eye = cylinder(
        "x", [-0.5 * long - 2 * unit, 0, pivot], 2 * unit + 0.3 * r, 0.55 * r, segments=24
    )
    head.add(tidy(eye - solid), materials.dark_glass(rng))
    if not ball_head and rng.random() < 0.5:  # a roof against rain
        roof = box(
            [-0.5 * long - 5 * unit, -0.8 * r, pivot + 0.8 * r],
            [0.4 * long, 0.8 * r, pivot + r + 2 * unit],
        )
        head.add(tidy(roof - solid), trim)
    nod = hinge(
        (0, 0, pivot),
        (0, 1, 0),
        float(np.deg2rad(rng.uniform(20, 40))) * float(rng.choice([-1, 1])),
    )
    asm.add("head", head, neck, nod)
    return asm.object()

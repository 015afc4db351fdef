"""Eyeglasses, lorgnettes, face shields, folding magnifying glasses and headphones."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    ball,
    box,
    cylinder,
    extrusion,
    hinge,
    hull,
    pipe,
    rounded,
    slide,
    tidy,
    tube,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """Something worn in front of the eyes or on the ears, in metres; it looks towards -x."""
    makers = (_glasses, _lorgnette, _shield, _magnifier, _headphones)
    return makers[rng.choice(5, p=[0.48, 0.07, 0.12, 0.1, 0.23])](rng)


def _draw_frame_finish(rng: np.random.Generator) -> Material:
    """Black, horn, metal, gold or bright plastic."""
    kind = rng.choice(4, p=[0.25, 0.2, 0.25, 0.3])
    if kind == 0:
        return materials.dark(rng)
    if kind == 1:
        return plain(materials.hsv(rng, (0.03, 0.1), (0.5, 0.85), (0.2, 0.6)))
    return materials.hardware(rng) if kind == 2 else plain(rng.uniform([0.05] * 3, [0.95] * 3))


def _draw_lens_finish(rng: np.random.Generator) -> Material:
    """Clear, dark or tinted glass."""
    if rng.random() < 0.6:
        return materials.glass(rng)
    return plain(materials.hsv(rng, (0, 1), (0.2, 0.8), (0.15, 0.8)))


def _lens_outline(rng: np.random.Generator, wide: float) -> np.ndarray:
    """The outline [40, 2] of (y, z) of one lens: round, square, drop or cat's eye. Its outer side
    is at +y."""
    angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    c, s = np.cos(angle), np.sin(angle)
    kind = str(rng.choice(["round", "square", "drop", "cat"], p=[0.25, 0.4, 0.2, 0.15]))
    power = 2.0 if kind == "round" else float(rng.uniform(2.3, 5))
    ratio = float(rng.uniform(0.9, 1.0) if kind == "round" else rng.uniform(0.55, 0.9))
    y = np.sign(c) * np.abs(c) ** (2 / power)
    z = np.sign(s) * np.abs(s) ** (2 / power) * ratio
    if kind == "drop":
        z = z + 0.12 * y * (z < 0)
        y = y * (1 + 0.12 * z)
    elif kind == "cat":
        z = z + np.where(y > 0, 0.22 * y**2 * (z > 0), 0)
    return np.column_stack([y, z]) * wide / 2


def _grown(outline: np.ndarray, by: float) -> np.ndarray:
    """An outline grown by about ``by``."""
    return outline * (1 + by / np.linalg.norm(outline, axis=1, keepdims=True))


def _pair(rng, shape: Shape, wide: float, gap: float, rim: float, thick: float, glass):
    """Add two lenses from x = -``thick`` to 0. Returns a lens's outline, the rims with their
    bridge, and the solid that the frame must leave free."""
    outline = _lens_outline(rng, wide)
    ring, middle = _grown(outline, rim), (wide + gap) / 2
    solids, panes = [], []
    for side in (1, -1):
        for k, line in enumerate((ring, outline)):
            flat = line * [side, 1] + [side * middle, 0]
            body = extrusion(
                flat, "x", [-thick if k == 0 else -0.7 * thick, 0, 0], thick * (1 - 0.4 * k)
            )
            (panes if k else solids).append(body)
    holes = union(panes)
    z = float(rng.uniform(0.05, 0.6)) * ring[:, 1].max()
    reach, r = gap / 2 + 0.1 * wide, min(max(0.5 * rim, 0.3 * thick), 0.6 * thick)
    rise = float(rng.uniform(0, 0.8)) * gap / 2
    line = [
        [-thick / 2, y, z + h]
        for y, h in ((-reach, 0), (-0.2 * gap, rise), (0.2 * gap, rise), (reach, 0))
    ]
    solids.append(pipe(line, r, 10))
    wells = union([p.scale((3, 1, 1)).translate((thick, 0, 0)) for p in panes])
    shape.add(holes, glass)
    return outline, union(solids) - wells, wells


def _glasses(rng: np.random.Generator) -> ArticulatedObject:
    """Glasses or goggles with two temples, straight out or folded; some have shades that flip
    up."""
    width = float(rng.uniform(0.125, 0.155))
    unit, air = width / 100, width / 250
    tone, glass = _draw_frame_finish(rng), _draw_lens_finish(rng)
    arm_tone = tone if rng.random() < 0.65 else _draw_frame_finish(rng)
    thick, rim = float(rng.uniform(2.2, 4)) * unit, float(rng.uniform(1.2, 4)) * unit
    gap = float(rng.uniform(11, 17)) * unit
    asm, frame = Assembly(), Shape()
    bar, tall = float(rng.uniform(2.4, 4)) * unit, float(rng.uniform(4, 10)) * unit
    goggles = rng.random() < 0.25
    if goggles:  # one pane before both eyes, with sides
        high = float(rng.uniform(32, 52)) * unit
        outline = rounded(width - 2 * bar, high, float(rng.uniform(6, 16)) * unit)
        depth = float(rng.uniform(4, 28)) * unit
        shell = extrusion(outline, "x", [-depth, 0, 0], depth)
        inner = outline * (1 - 5 * unit / np.abs(outline).max(0))
        shell -= extrusion(inner, "x", [-depth - 1, 0, 0], 2)
        shell -= box([-1, -8 * unit, -high], [1, 8 * unit, -0.32 * high])
        pane = extrusion(inner, "x", [-depth + 0.4 * unit, 0, 0], 2 * unit)
        pane -= box([-1, -8 * unit, -high], [1, 8 * unit, -0.32 * high])
        frame.add(pane, glass)
        rims, wells = shell, pane
        level, near = 0.0, width / 2 - bar - 2 * unit
    else:
        wide = (width - 2 * bar - gap - 2 * rim) / 2 * float(rng.uniform(0.88, 1.0))
        outline, rims, wells = _pair(rng, frame, wide, gap, rim, thick, glass)
        level = float(rng.uniform(0.1, 0.6)) * outline[:, 1].max()
        high = 2 * outline[:, 1].max()
        ring = _grown(outline, 0.5 * rim)
        above = ring[np.abs(ring[:, 1] - level).argsort()[:6]]
        near = above[:, 0].max() + (wide + gap) / 2 - 0.2 * rim
    tall = min(tall, 0.4 * high)
    start = 2.5 * unit
    ends, hinges = [], []
    for side in (1, -1):
        x1 = start + (0 if side > 0 else bar + air)  # so that one folds behind the other
        y0, y1 = sorted((side * near, side * width / 2))
        ends.append(box([-thick, y0, level - tall / 2], [0, y1, level + tall / 2]))
        y0, y1 = sorted((side * (width / 2 - bar), side * width / 2))
        ends.append(box([-0.5 * thick, y0, level - tall / 2], [x1 - air, y1, level + tall / 2]))
        hinges.append((side, x1))
    frame.add(tidy(union([rims, union(ends) - wells])), tone)
    root = asm.add("frame", frame)
    long = (width - 2 * bar - unit) * float(rng.uniform(0.88, 1.0))
    hook, drop = float(rng.uniform(0.6, 0.85)) * long, float(rng.uniform(0.0, 0.22)) * long
    slim = float(rng.uniform(0.6, 1.0)) * tall
    folded = rng.random() < 0.3
    tip_tone = materials.dark(rng) if rng.random() < 0.3 else arm_tone
    for side, x1 in hinges:
        top = [(level + tall / 2, 0), (level + slim / 2, hook), (level + slim / 2 - drop, long)]
        low = [
            (level - slim / 2 - drop, long),
            (level - slim / 2, hook - 0.3 * drop),
            (level - tall / 2, 0),
        ]
        y0 = min(side * (width / 2 - bar), side * width / 2)
        solid = extrusion(np.array([*top, *low]), "y", [x1 * 0, y0, 0], bar).translate((x1, 0, 0))
        tip = box([x1 + hook, -1, -1], [9, 1, 1])
        shape = Shape().add(tidy(solid - tip), arm_tone).add(tidy(solid ^ tip), tip_tone)
        joint = hinge((x1, side * (width / 2 - bar), 0), (0, 0, -side), np.pi / 2)
        if folded:
            shape = shape.moved(joint.motion(np.pi / 2))
            joint = hinge(joint.origin, (0, 0, side), np.pi / 2)
        asm.add("temple", shape, root, joint)
    if not goggles and rng.random() < 0.25:  # shades that flip up
        middle, z = (wide + gap) / 2, _grown(outline, rim)[:, 1].max()
        x, t = -1.15 * thick - 0.5 * unit, 2 * unit
        panes = [
            extrusion(_grown(outline, 0.6 * rim) * [s, 1] + [s * middle, 0], "x", [x - t, 0, 0], t)
            for s in (1, -1)
        ]
        bridge = box([x - t, -middle, z - 4 * unit], [x, middle, z - unit])
        both = union([*panes, bridge])
        joint = hinge((x, 0, z), (0, 1, 0), float(np.deg2rad(rng.uniform(70, 110))))
        asm.add("shades", Shape().add(tidy(both), _draw_lens_finish(rng)), root, joint)
    return asm.object()


def _lorgnette(rng: np.random.Generator) -> ArticulatedObject:
    """Two lenses and a handle at one side that swings behind them."""
    wide = float(rng.uniform(0.035, 0.05))
    unit, tone, frame, asm = wide / 40, _draw_frame_finish(rng), Shape(), Assembly()
    gap, rim = float(rng.uniform(8, 16)) * unit, float(rng.uniform(2, 3.5)) * unit
    _, rims, wells = _pair(rng, frame, wide, gap, rim, 3 * unit, _draw_lens_finish(rng))
    side = float(rng.choice([-1, 1]))
    edge = side * (gap / 2 + wide + 0.5 * rim)
    hub = cylinder("x", [-3 * unit, edge, 0], 3 * unit, 4 * unit)
    frame.add(tidy(union([rims, hub - wells])), tone)
    root = asm.add("frame", frame)
    long, w = float(rng.uniform(80, 130)) * unit, float(rng.uniform(3, 5.5)) * unit
    angle = float(rng.uniform(0, 90))
    bar = union(
        [
            extrusion(rounded(long, 2 * w, w), "x", [0, long / 2, 0], 3 * unit),
            cylinder("x", [0, 0, 0], 3 * unit, 1.25 * w, segments=24),
        ]
    )
    way = bar.rotate((-angle, 0, 0))
    solid = way if side > 0 else way.mirror((0, 1, 0))
    solid = solid.translate((0.4 * unit, edge, 0))
    handle = Shape().add(tidy(solid), tone if rng.random() < 0.5 else _draw_frame_finish(rng))
    swing = float(np.deg2rad(180 - angle))
    asm.add("handle", handle, root, hinge((0, edge, 0), (-side, 0, 0), swing))
    return asm.object()


def _shield(rng: np.random.Generator) -> ArticulatedObject:
    """A band around the head and a visor or mask that swings up about its ends."""
    r = float(rng.uniform(0.085, 0.1))
    unit, tone = r / 50, _draw_frame_finish(rng)
    w, t, air = float(rng.uniform(5, 10)) * unit, 2.2 * unit, 0.6 * unit
    asm, band = Assembly(), Shape()
    hoop = tube("z", [0, 0, -w], 2 * w, r, r - t, 48)
    if rng.random() < 0.5:  # a strap over the head
        arch = tube("x", [-w, 0, 0], 2 * w, r, r - t, 48) ^ box([-1, -1, 0.5 * w], [1, 1, 1])
        hoop = union([hoop, arch])
    band.add(tidy(hoop), tone)
    big = float(np.hypot(r, w)) + 2 * unit
    knob_tone = _draw_frame_finish(rng)
    hubs = [
        cylinder(
            "y",
            [0, s * r - (0 if s > 0 else big - r - 0.2 * unit) - 0.3 * s * unit, 0],
            big - r,
            0.8 * w,
        )
        for s in (1, -1)
    ]
    band.add(tidy(union(hubs) - hoop), knob_tone)
    root = asm.add("band", band)
    up, down = float(rng.uniform(0.2, 0.7)) * r, float(rng.uniform(0.8, 2.3)) * r
    shell = tube("z", [0, 0, -down], up + down, big + t, big + air, 64)
    shell = shell ^ box([-1, -1, -1], [-0.05 * r, 1, 1])
    mask = rng.random() < 0.4
    ears = []
    for s in (1, -1):
        y0, y1 = sorted((s * (big + air), s * (big + t)))
        ears.append(cylinder("y", [0, y0, 0], y1 - y0, 1.1 * w))
        ears.append(box([-0.35 * r, y0, -0.8 * w], [0, y1, 0.8 * w]))
    shape = Shape()
    visor = union([shell, *ears])
    glass = _draw_lens_finish(rng)
    window = box([-1, -0.6 * r, -0.5 * r], [-0.3 * r, 0.6 * r, 0.1 * r])
    if mask:
        shape.add(tidy(visor - window), _draw_frame_finish(rng)).add(tidy(shell ^ window), glass)
    else:
        rim = box([-1, -1, up - 0.2 * r], [1, 1, 1])
        shape.add(tidy(visor - rim), glass).add(tidy(visor ^ rim), tone)
    asm.add(
        "visor", shape, root, hinge((0, 0, 0), (0, 1, 0), float(np.deg2rad(rng.uniform(40, 85))))
    )
    return asm.object()


def _magnifier(rng: np.random.Generator) -> ArticulatedObject:
    """One to three lenses that swing out from between the plates of a case."""
    r = float(rng.uniform(0.015, 0.035))
    unit, tone, asm, case = r / 25, _draw_frame_finish(rng), Assembly(), Shape()
    count = int(rng.choice([1, 2, 3], p=[0.5, 0.3, 0.2]))
    t, leaf, air = 4 * unit, float(rng.uniform(5, 8)) * unit, 0.8 * unit
    big, far = r + 3 * unit, 1.45 * r
    upright = rng.random() < 0.6
    round_case = rng.random() < 0.4
    plan = rounded(2 * big, 2 * (big + 0.5 * far), 0.98 * big if not round_case else 0.5 * big, 8)
    depth = count * (leaf + air) + air
    plates = [extrusion(plan, "x", [x, 0, 0], t) for x in (-t, depth)]
    pivot = 0.5 * far + 0.25 * r
    pin = 2.2 * unit
    case.add(
        tidy(union([*plates, cylinder("x", [-t, 0, pivot], depth + 2 * t, pin, segments=16)])), tone
    )
    stud = [
        cylinder("x", [x, 0, pivot], 1.5 * unit, 4 * unit) for x in (-t - 1.5 * unit, depth + t)
    ]
    case.add(union(stud), materials.hardware(rng))
    turned = np.eye(4)
    if not upright:
        turned[:3, :3] = [[0, 0, -1], [0, 1, 0], [1, 0, 0]]
    root = asm.add("case", case.moved(turned))
    glass, rim = _draw_lens_finish(rng), _draw_frame_finish(rng)
    side, opened = float(rng.choice([-1, 1])), rng.random() < 0.7
    for k in range(count):
        x, radius = air + k * (leaf + air), r * (1 - 0.1 * k)
        z = pivot - (radius + 6 * unit)
        ring = tube("x", [x, 0, z], leaf, radius, 0.84 * radius, 36)
        ear = hull(
            np.array(
                [
                    [x + a, y, h]
                    for a in (0, leaf)
                    for y, h in (
                        (-5 * unit, pivot + 4 * unit),
                        (5 * unit, pivot + 4 * unit),
                        (-8 * unit, z + 0.9 * radius),
                        (8 * unit, z + 0.9 * radius),
                    )
                ]
            )
        )
        solid = union([ring, ear]) - cylinder("x", [-1, 0, pivot], 2, pin + 0.4 * unit, segments=24)
        pane = cylinder("x", [x + 0.3 * leaf, 0, z], 0.4 * leaf, 0.84 * radius, segments=36)
        solid = solid - cylinder("x", [-1, 0, z], 2, 0.84 * radius, segments=36)
        shape = Shape().add(tidy(solid), rim).add(pane, glass).moved(turned)
        at, axis = turned[:3, :3] @ [0, 0, pivot], turned[:3, :3] @ [side, 0, 0]
        swing = float(np.deg2rad(rng.uniform(110, 180)))
        joint = hinge(at, axis, swing)
        if opened:  # at rest it stands out, and folds in
            shape, joint = shape.moved(joint.motion(swing)), hinge(at, -axis, swing)
        asm.add("lens", shape, root, joint)
    return asm.object()


def _headphones(rng: np.random.Generator) -> ArticulatedObject:
    """A band over the head with arms that slide out, cups that turn on them, and a microphone."""
    r = float(rng.uniform(0.07, 0.085))
    unit, tone, air = r / 50, _draw_frame_finish(rng), r / 120
    pad = materials.dark(rng) if rng.random() < 0.7 else _draw_frame_finish(rng)
    w, t = float(rng.uniform(5, 11)) * unit, float(rng.uniform(2.5, 4.5)) * unit
    asm, band = Assembly(), Shape()
    squash = float(rng.uniform(0.85, 1.15))
    arch = (tube("x", [-w, 0, 0], 2 * w, r, r - t, 48) ^ box([-1, -1, 0], [1, 1, 1])).scale(
        (1, 1, squash)
    )
    legs = [
        box([-w, s * (r - t / 2) - t / 2, -12 * unit], [w, s * (r - t / 2) + t / 2, 0.2 * unit])
        for s in (1, -1)
    ]
    band.add(tidy(union([arch, *legs])), tone)
    if rng.random() < 0.6:  # a cushion below the band
        soft = tube("x", [-0.9 * w, 0, 0], 1.8 * w, r - t, r - 2.2 * t, 48) ^ box(
            [-1, -0.7 * r, 0], [1, 0.7 * r, 1]
        )
        band.add(soft.scale((1, 1, squash)), pad)
    root = asm.add("band", band)
    big, deep = float(rng.uniform(20, 30)) * unit, float(rng.uniform(9, 15)) * unit
    oval = float(rng.uniform(1.0, 1.3))
    cup_tone = tone if rng.random() < 0.5 else _draw_frame_finish(rng)
    metal = materials.hardware(rng) if rng.random() < 0.5 else cup_tone
    slides, mic = rng.random() < 0.7, rng.random() < 0.3
    swivel, pull = float(np.deg2rad(rng.choice([45, 90]))), float(rng.uniform(8, 16)) * unit
    low = -12 * unit - float(rng.uniform(3, 10)) * unit
    for s in (1, -1):
        y0, y1 = sorted((s * (r + air), s * (r + air + 3 * unit)))  # an arm outside of the band
        bar = box([-0.6 * w, y0, low], [0.6 * w, y1, -1 * unit])
        a, b = sorted((s * (r - t), s * (r + air + 3 * unit)))
        foot = box([-0.6 * w, a, low], [0.6 * w, b, min(low + 3 * unit, -12 * unit - air)])
        arm = Shape().add(union([bar, foot]), metal)
        joint = slide((0, 0, -1), pull) if slides else None
        index = asm.add("slider", arm, root, joint)
        z = low - 2.5 * unit - oval * big
        middle = s * (r - t / 2)
        disc = cylinder("y", [0, 0, 0], 0.45 * deep, big, 0.85 * big, 36).scale((1, 1, oval))
        back = disc if s > 0 else disc.mirror((0, 1, 0))
        back = back.translate((0, middle, z))
        soft = tube("y", [0, 0, 0], 0.55 * deep, 0.97 * big, 0.55 * big, 36).scale((1, 1, oval))
        soft = soft.translate((0, middle - (0.55 * deep if s > 0 else 0), z))
        neck = cylinder(
            "z", [0, middle, z + 0.8 * oval * big], low - air - z - 0.8 * oval * big, 0.4 * w
        )
        shape = (
            Shape()
            .add(tidy(union([back, tidy(neck - soft)])), cup_tone)
            .add(tidy(soft - neck), pad)
        )
        logo = cylinder(
            "y", [0, middle + (0.45 * deep if s > 0 else -0.45 * deep - unit), z], unit, 0.5 * big
        )
        shape.add(logo, metal)
        cup = asm.add("cup", shape, index, hinge((0, middle, 0), (0, 0, s), swivel))
        if mic and s > 0:
            x, y = 0.0, middle + 0.45 * deep + unit + air + 2 * unit
            tip = [x - 1.2 * r, y, z - 0.35 * r]
            boom = union(
                [
                    pipe([[x, y, z], tip], 1.6 * unit, 10),
                    ball(tip, 3.6 * unit, 14),
                    cylinder("y", [x, y - 2 * unit, z], 4 * unit, 6 * unit),
                ]
            )
            shape = Shape().add(tidy(boom), materials.dark(rng))
            asm.add(
                "boom",
                shape,
                cup,
                hinge((x, y, z), (0, 1, 0), float(np.deg2rad(rng.uniform(60, 100)))),
            )
    return asm.object()

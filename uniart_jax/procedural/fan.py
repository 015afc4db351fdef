"""Fans: blades that turn without end in a guard, a head that tilts, on a desk, on a pole that
lifts, or in a box on the floor."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import appliances, materials
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
    revolution,
    rounded,
    slide,
    tidy,
    tube,
    turn,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A fan, metres, level."""
    return _box_fan(rng) if rng.random() < 0.25 else _guarded(rng)


def _blades(
    rng, radius: float, hub: float, deep: float, unit: float, shaft: float
) -> list[Manifold]:
    """Blades and hub about x through 0, within |x| < ``deep`` / 2: [hub, blades]; ``shaft``: how
    far it goes on behind."""
    count = int(rng.choice([3, 4, 5, 6], p=[0.4, 0.25, 0.25, 0.1]))
    pitch = float(rng.choice([-1, 1])) * float(rng.uniform(18, 35))
    wide = radius * float(rng.uniform(0.35, 0.75)) * 3 / count**0.8
    wide = min(wide, 0.85 * deep / np.sin(np.deg2rad(abs(pitch))))
    thick = max(0.7 * unit, 0.0025)
    paddle = rng.random() < 0.4
    u = np.linspace(0, 1, 7)
    long = radius - 0.7 * hub
    half = (
        wide
        / 2
        * (
            np.clip(0.55 + 1.2 * u, 0, 1) * np.sqrt(np.clip(1 - u**6, 0, 1))
            if not paddle
            else 0.5 + 0.5 * u
        )
    )
    z = 0.7 * hub + long * u
    half = np.minimum(half, 0.85 * z * np.tan(np.pi / count))  # clear of the next blade
    lean = float(rng.uniform(-0.25, 0.4)) * wide * u
    outline = np.vstack(
        [np.column_stack([lean + half, z]), np.column_stack([lean - half, z])[::-1]]
    )  # (y, z)
    blade = extrusion(outline, "x", [-thick / 2, 0, 0], thick).rotate((0, 0, pitch))
    room = cylinder("x", [-deep / 2, 0, 0], deep, radius, segments=32)
    blades = [blade.rotate((360 * k / count, 0, 0)) for k in range(count)]
    nose = cylinder("x", [-deep / 2, 0, 0], 0.34 * deep, 0.6 * hub, 0.97 * hub, segments=20)
    core = cylinder("x", [-0.2 * deep, 0, 0], 0.7 * deep, hub, segments=20)
    axle = cylinder("x", [0, 0, 0], 0.5 * deep + shaft, 0.35 * hub, segments=12)
    middle = tidy(union([nose, core, axle]))
    return [middle, tidy(cut(union(blades) ^ room, [middle]))]


def _cage(rng, radius: float, front: float, back: float, hub: float, wire: float) -> Manifold:
    """A guard of ring and ribs about x from ``front`` to ``back``: a basket round the blades, with
    a badge in front."""
    solids = [tube("x", [-wire, 0, 0], 2 * wire, radius + wire, radius - wire, 26)]
    rings = int(rng.integers(0, 3))
    for x, bulge in ((front, 1), (back, 1)):
        inner = 0.85 * radius
        plane = x * bulge
        solids.append(
            tube("x", [plane - wire / 2, 0, 0], wire, inner + wire / 2, inner - wire / 2, 22)
        )
        for k in range(rings):
            r = inner * (k + 1) / (rings + 1)
            if r > hub + 2 * wire:
                solids.append(
                    tube("x", [plane - wire / 2, 0, 0], wire, r + wire / 2, r - wire / 2, 18)
                )
        solids.append(cylinder("x", [plane - wire / 2, 0, 0], wire, hub, segments=20))
    count = int(min(rng.choice([8, 12, 16, 20]), 2 * hub // wire))
    for k in range(count):
        turned = 360 * (k + 0.5) / count
        for x, share in ((front, 0.46), (back, 0.39)):  # unlike, so that no two edges coincide
            w = share * wire
            spoke = box([x - w, -w, 0.8 * hub], [x + w, w, 0.85 * radius + w])
            a, b = np.array([x, 0, 0.85 * radius]), np.array([0, 0, radius])
            corner = [p + [dx, dy, 0] for p in (a, b) for dx in (-w, w) for dy in (-w, w)]
            low = [p - [0, 0, wire] for p in corner]
            solids.append((spoke + hull(np.array([*corner, *low]))).rotate((turned, 0, 0)))
    return union(solids)


def _colors(rng: np.random.Generator) -> tuple[Material, Material, Material]:
    """Of the body, the guard and the blades."""
    body = materials.white_plastic(rng) if rng.random() < 0.4 else materials.dark(rng)
    if rng.random() < 0.4:
        body = materials.paint(rng) if rng.random() < 0.6 else materials.metal(rng, brushed=False)
    guard = body if rng.random() < 0.5 else materials.hardware(rng)
    blade = (
        body,
        materials.paint(rng),
        materials.metal(rng, brushed=False),
        plain(rng.uniform(0.2, 0.9, 3)),
    )[rng.integers(4)]
    return body, guard, blade


def _guarded(rng: np.random.Generator) -> ArticulatedObject:
    """A round head on a foot."""
    tall = rng.random() < 0.4
    radius = float(rng.uniform(0.17, 0.26) if tall else rng.uniform(0.09, 0.2))
    axle = float(rng.uniform(0.55, 1.05) if tall else radius * rng.uniform(1.45, 2.1))
    unit = (axle + radius) / 100
    body, guard, tone = _colors(rng)
    wire = max(0.9 * unit if not tall else 0.55 * unit, 0.003)
    deep = radius * float(rng.uniform(0.28, 0.45))  # room of the blades
    front, back = -0.5 * deep - 2.2 * wire, 0.5 * deep + 2.2 * wire
    hub = radius * float(rng.uniform(0.16, 0.28))
    motor = radius * float(rng.uniform(0.5, 0.9))  # length behind the guard
    stem = max(radius * float(rng.uniform(0.1, 0.16)), 1.4 * unit)
    fixed_pose = float(rng.uniform(0.35, 0.7))
    pivot = np.array([back + fixed_pose * motor, 0, axle - 1.35 * hub - 1.4 * stem])
    high = radius * float(rng.uniform(0.1, 0.25))
    size = radius * float(rng.uniform(0.75, 1.1)) + (0.03 if tall else 0)
    lift = tall and rng.random() < 0.6
    air = 0.35 * unit

    asm, foot = Assembly(), Shape()
    at = [pivot[0] * float(rng.uniform(0.3, 1.0)), 0, 0]
    at[0] = min(at[0], pivot[0])
    plan = str(rng.choice(["disc", "dome", "slab", "cross"], p=[0.4, 0.25, 0.2, 0.15]))
    if plan == "cross" and not tall:
        plan = "disc"
    base = _foot(rng, plan, at, pivot[0], size, high, unit)
    foot.add(base, body)
    top = pivot[2] - 1.7 * stem  # where the fork's bridge lies
    post = 0.8 * stem
    middle = high + (top - high) * float(rng.uniform(0.4, 0.65))
    foot_x = pivot[0]
    pole_finish = body if rng.random() < 0.5 else materials.metal(rng, brushed=False)
    lower_top = middle if lift else top
    sleeve = cylinder(
        "z",
        [foot_x, 0, 0.5 * high],
        lower_top - 0.5 * high,
        post * (1.3 if lift else 1),
        segments=18,
    )
    reach = 0.8 * (middle - high)
    if lift:
        sleeve -= cylinder("z", [foot_x, 0, middle - reach - air], 3, 0.9 * post + air, segments=18)
    fork = _fork(pivot, stem, air, top)
    root_solids = [sleeve] if lift else [sleeve, fork]
    foot.add(tidy(union(root_solids) - base), pole_finish)
    knobs = rng.random() < 0.45 and plan in ("disc", "slab") and not tall
    root = asm.add("foot", foot)
    carrier = root
    if lift:
        rod = cylinder(
            "z", [foot_x, 0, middle - reach], top - middle + reach, 0.9 * post, segments=18
        )
        pole = asm.add(
            "pole",
            Shape().add(tidy(union([rod, fork])), pole_finish),
            root,
            slide((0, 0, 1), reach * float(rng.uniform(0.5, 0.85))),
        )
        carrier = pole
    center = np.array([0, 0, axle])
    head = Shape()
    cage = _cage(rng, radius, front, back, hub, wire).translate(tuple(center))
    shell = _motor(rng, back, motor, hub, wire).translate(tuple(center))
    tab = _tab(pivot, stem, axle - 0.5 * hub)
    head.add(tidy(cut(cage, [shell])), guard)
    head.add(tidy(union([shell, tab]) - box([-1, -2, 0], [back + wire / 2, 2, 3])), body)
    tilt = float(np.deg2rad(rng.uniform(15, 45)))
    if rng.random() < 0.3:
        tilt = float(np.deg2rad(rng.uniform(45, 80)))
    neck = asm.add("head", head, carrier, hinge(pivot, (0, 1, 0), tilt))
    core, blades = (
        s.translate(tuple(center))
        for s in _blades(rng, 0.85 * radius - 2 * wire, 0.7 * hub, deep, unit, 1.3 * wire)
    )
    finish = tone.darker(0.7) if rng.random() < 0.5 else tone
    rotor = Shape().add(core, finish).add(blades, tone)
    if finish is tone:
        rotor = Shape().add(tidy(core + blades), tone)
    asm.add("blades", rotor, neck, turn(center, (1, 0, 0)))
    if knobs:
        _dial(rng, asm, root, at[0] - size, high, unit)
    return asm.object()


def _dial(rng, asm: Assembly, root: int, front: float, high: float, unit: float) -> None:
    """A round speed knob on the foot's top, that turns without end."""
    r = float(rng.uniform(2.2, 3.6)) * unit
    x = front + 1.8 * r
    knob = cylinder("z", [x, 0, high + 0.0006], 2.2 * unit, r, 0.8 * r, segments=16)
    asm.add("knob", Shape().add(knob, materials.hardware(rng)), root, turn((x, 0, high), (0, 0, 1)))


def _foot(rng, plan: str, at, pole: float, size: float, high: float, unit: float) -> Manifold:
    """What stands on the floor, its top at ``high`` under the pole."""
    if plan == "disc":
        return cylinder("z", at, high, size, 0.97 * size, segments=30)
    if plan == "slab":
        outline = rounded(1.8 * size, 1.5 * size, float(rng.uniform(0.1, 0.6)) * size)
        return extrusion(outline, "z", at, high)
    if plan == "dome":
        angle = np.linspace(0, np.pi / 2, 6)
        rim = np.column_stack([size * np.cos(angle), 0.3 * high + 0.9 * high * np.sin(angle)])
        return revolution(np.vstack([[[0, 0], [size, 0]], rim]), "z", at, 30)
    w = 2.2 * unit
    turned = 45 if rng.random() < 0.5 else 0
    bars = [
        box([-1.2 * size, -w, 0], [1.2 * size, w, high]),
        box([-w, -1.2 * size, 0], [w, 1.2 * size, high]),
    ]
    return union(bars).rotate((0, 0, turned)).translate((pole, 0, 0))


def _fork(pivot, stem: float, air: float, top: float) -> Manifold:
    """Two cheeks beside the head's tab and the bridge below it."""
    x, _, z = pivot
    half, wall = 0.5 * stem + air, 0.45 * stem
    solids = [box([x - stem, -half - wall, top - 0.5 * stem], [x + stem, half + wall, top])]
    for y in (-half - wall, half):
        disc = cylinder("y", [x, y, z], wall, stem, segments=18)
        solids += [disc, box([x - stem, y, top - 0.1 * stem], [x + stem, y + wall, z])]
    return union(solids)


def _tab(pivot, stem: float, high: float) -> Manifold:
    """The head's tab between the cheeks, up to its motor."""
    x, _, z = pivot
    disc = cylinder("y", [x, -stem / 2, z], stem, 0.9 * stem, segments=18)
    return union([disc, box([x - 0.9 * stem, -stem / 2, z], [x + 0.9 * stem, stem / 2, high])])


def _motor(rng, back: float, long: float, hub: float, wire: float) -> Manifold:
    """The housing behind the guard."""
    r = 1.35 * hub
    taper = float(rng.uniform(0.6, 0.95))
    start = back + wire / 2
    front = cylinder("x", [start, 0, 0], 0.45 * long, r, segments=24)
    return union(
        [front, cylinder("x", [start + 0.45 * long, 0, 0], 0.55 * long, 0.97 * r, taper * r, 24)]
    )


def _box_fan(rng: np.random.Generator) -> ArticulatedObject:
    """A square or round frame on the floor, a grille in front, a knob above or beside it; some tilt
    in a stand."""
    radius = float(rng.uniform(0.16, 0.3))
    deep = radius * float(rng.uniform(0.35, 0.6))
    unit = 2.2 * radius / 100
    body, guard, tone = _colors(rng)
    rim, wire = float(rng.uniform(3, 8)) * unit, 1.1 * unit
    half = radius + rim
    stand = rng.random() < 0.45
    low = float(rng.uniform(4, 12)) * unit if stand else float(rng.uniform(1, 3)) * unit
    center = np.array([0, 0, low + half])
    round_frame = rng.random() < 0.35
    asm, frame = Assembly(), Shape()
    hub = radius * float(rng.uniform(0.14, 0.24))
    hole = cylinder("x", [-deep, 0, 0], 2 * deep, radius, segments=36)
    if round_frame:
        shell = cylinder("x", [-deep / 2, 0, 0], deep, half, segments=36)
    else:
        corner = float(rng.uniform(0.02, 0.35)) * half
        shell = extrusion(rounded(2 * half, 2 * half, corner), "x", [-deep / 2, 0, 0], deep)
    frame.add((shell - hole).translate(tuple(center)), body)
    bars = []
    manner = str(rng.choice(["spokes", "bars", "rings"]))
    for x in (-deep / 2, deep / 2 - wire):
        disc = cylinder("x", [x, 0, 0], wire, hub, segments=20)
        lines = []
        if manner == "bars":
            for k in range(9):
                y = radius * (-0.9 + 0.225 * k)
                lines.append(box([x, y - wire / 2, -radius], [x + wire, y + wire / 2, radius]))
            lines.append(box([x, -radius, -wire], [x + wire, radius, wire]))
        else:
            spokes = 6 if manner == "rings" else int(rng.choice([12, 16, 20]))
            lines += [
                box([x, -wire / 2, 0], [x + wire, wire / 2, 1.02 * radius]).rotate(
                    (360 * k / spokes, 0, 0)
                )
                for k in range(spokes)
            ]
            for k in range(4 if manner == "rings" else 1):
                r = radius * (0.35 + 0.16 * k)
                lines.append(tube("x", [x, 0, 0], wire, r + wire / 2, r - wire / 2, 28))
        bars.append(
            union([disc, *lines])
            ^ cylinder(
                "x", [-deep, 0, 0], 2 * deep, radius + (3e-4 if guard is body else 0), segments=36
            )
        )
    frame.add(tidy(union(bars)).translate(tuple(center)), guard)
    steel = materials.hardware(rng)
    if stand:
        root = _stand(asm, center, half, deep, unit, steel)
        tilt = float(np.deg2rad(rng.uniform(25, 80)))
        parent = asm.add("frame", frame, root, hinge(center, (0, 1, 0), tilt))
    else:
        for y in (-0.7 * half, 0.7 * half):  # feet
            foot = box(
                [-0.8 * deep, y - 1.5 * unit, 0], [0.8 * deep, y + 1.5 * unit, low + 0.02 * unit]
            )
            rest = shell.translate(tuple(center))
            lift = box(
                [-0.5 * deep, y - 1.5 * unit, low - 0.1 * unit],
                [0.5 * deep, y + 1.5 * unit, low + (half if round_frame else 0.3 * unit)],
            )
            frame.add(cut(union([foot, lift]), [rest, hole.translate(tuple(center))]), steel)
        parent = asm.add("frame", frame)
    room = deep - 2 * wire - 2.0 * unit
    core, blades = (
        s.translate(tuple(center)) for s in _blades(rng, 0.95 * radius, hub, room, unit, 0.6 * unit)
    )
    rotor = Shape().add(tidy(core + blades), tone)
    asm.add("blades", rotor, parent, turn(center, (1, 0, 0)))
    if not round_frame and rim > 4 * unit and rng.random() < 0.6:  # a knob in a corner of the frame
        s = float(rng.choice([-1, 1]))
        off = 0.84 * half
        finish = materials.hardware(rng)
        y, z = s * off, center[2] + float(rng.choice([-1, 1])) * off
        appliances.knob_row(asm, rng, parent, -deep / 2, [y], z, 0.8 * unit, finish, largest=0.035)
    return asm.object()


def _stand(asm: Assembly, center, half: float, deep: float, unit, steel) -> int:
    """Two feet with cheeks beside the frame and a bar between them; the root."""
    air, wall = 0.4 * unit, 1.8 * unit
    y = half + air
    solids = [box([-0.9 * deep, -y - wall, 0], [-0.9 * deep + 3 * unit, y + wall, 2.2 * unit])]
    solids.append(box([0.9 * deep - 3 * unit, -y - wall, 0], [0.9 * deep, y + wall, 2.2 * unit]))
    for side in (-y - wall, y):
        a, b = [side, side + wall], [0.0, float(center[2])]
        corners = [
            [x, yy, z]
            for x, z in (
                (-0.9 * deep, b[0]),
                (0.9 * deep, b[0]),
                (0.15 * deep, b[1]),
                (-0.15 * deep, b[1]),
            )
            for yy in a
        ]
        solids.append(hull(np.array(corners)))
        out = side - 0.9 * wall if side < 0 else side + wall
        solids.append(cylinder("y", [0, out, center[2]], 0.9 * wall, 2.6 * unit, segments=16))
        solids.append(cylinder("y", [0, side, center[2]], wall, 3.2 * unit, segments=16))
    return asm.add("stand", Shape().add(tidy(union(solids)), steel))

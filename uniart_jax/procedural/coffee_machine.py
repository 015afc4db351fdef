"""Coffee machines and grinders: filter machines with a jug, espresso and capsule machines, mills
with a crank."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.fronts import add_knob
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    ball,
    box,
    cut,
    cylinder,
    extrusion,
    hinge,
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
    """A coffee machine or grinder, metres, closed, its controls at -x."""
    kinds = (_filter, _espresso, _automatic, _capsule, _mill, _grinder)
    return kinds[rng.choice(6, p=[0.24, 0.29, 0.15, 0.14, 0.09, 0.09])](rng)


def _finish(rng: np.random.Generator) -> Material:
    """Steel, white, black or any colour."""
    return materials.appliance(rng) if rng.random() < 0.7 else plain(rng.uniform(0.1, 0.9, 3))


def _trim(rng: np.random.Generator, face: Material) -> Material:
    """What handles and trays are made of: unlike the body."""
    if sum(face.color) > 1.0 and rng.random() < 0.6:
        return materials.dark(rng)
    return materials.hardware(rng) if rng.random() < 0.75 else materials.wood(rng, textured=False)


def _column(rng, depth, half, low, high, corner, start=0.0) -> Manifold:
    """An upright body from x = ``start`` to ``depth`` with rounded vertical edges."""
    outline = rounded(depth - start, 2 * half, corner)
    return extrusion(outline, "z", [(start + depth) / 2, 0, low], high - low)


def _lid(rng, asm, root, lo, hi, top, unit, finish) -> None:
    """A flat lid on the plane z = ``top``, from ``lo`` to ``hi`` (x, y); hinged behind or beside,
    or lifted off."""
    thick, air = float(rng.uniform(1.8, 4)) * unit, 0.3 * unit
    size = np.subtract(hi, lo)
    center = np.add(lo, hi) / 2
    outline = rounded(*size, float(rng.uniform(0.02, 0.3)) * size.min())
    plate = extrusion(outline, "z", [*center, top + air], thick)
    tab = box(
        [lo[0] - 1.5 * unit, center[1] - 4 * unit, top + air + 0.3 * thick],
        [lo[0] + 2 * unit, center[1] + 4 * unit, top + air + 0.8 * thick],
    )
    manner = str(rng.choice(["rear", "side", "lift"], p=[0.65, 0.2, 0.15]))
    swing = float(np.deg2rad(rng.uniform(60, 91)))
    z = top + air
    if manner == "rear":
        joint = hinge((hi[0], 0, z), (0, 1, 0), swing)
        plate += tab
    elif manner == "side":
        joint = hinge((0, hi[1], z), (-1, 0, 0), swing)
    else:
        r = min(0.22 * size.min(), 4 * unit)
        plate += cylinder("z", [*center, z + 0.5 * thick], 0.5 * thick + 3 * unit, 0.8 * r, r)
        joint = slide((0, 0, 1), float(rng.uniform(15, 30)) * unit)
    asm.add("lid", Shape().add(tidy(plate), finish), root, joint)


def _tray(rng, asm, root, lo, hi, unit, trim: Material) -> None:
    """A drip tray with a slotted top, drawn out in front; lies in a recess of the base."""
    lo, hi = np.array(lo), np.array(hi)
    slots = []
    count = int(rng.integers(4, 9))
    across = rng.random() < 0.5
    for k in range(count):
        a, b = lo + 2 * unit, hi - 2 * unit
        axis = 1 if across else 0
        pitch = (b[axis] - a[axis]) / count
        a[axis], b[axis] = a[axis] + (k + 0.25) * pitch, a[axis] + (k + 0.75) * pitch
        slots.append(box([*a[:2], hi[2] - 1.2 * unit], [*b[:2], hi[2] + 1]))
    solid = cut(box(lo, hi), slots)
    proud = float(rng.uniform(0.8, 3)) * unit
    if rng.random() < 0.5:
        middle = (lo + hi) / 2
        outline = rounded(2 * proud, hi[1] - lo[1], proud)
        solid += extrusion(outline, "z", [lo[0], middle[1], lo[2]], hi[2] - lo[2])
    travel = float(rng.uniform(0.5, 0.9)) * (hi[0] - lo[0])
    asm.add("drip_tray", Shape().add(tidy(solid), trim), root, slide((-1, 0, 0), travel))


def _buttons(rng, asm, root, x, ys, z, r, finish: Material) -> None:
    """Push buttons on the plane ``x``."""
    square = rng.random() < 0.4
    deep = 1.2 * r
    for y in ys:
        button = cylinder("x", [x - deep, y, z], 1.9 * deep, r, segments=16)
        if square:
            button = box([x - deep, y - r, z - 0.8 * r], [x + 0.9 * deep, y + r, z + 0.8 * r])
        asm.add("button", Shape().add(button, finish), root, slide((1, 0, 0), 0.6 * deep))


def _wells(x, ys, z, r) -> list[Manifold]:
    """Holes for ``_buttons``."""
    return [
        box([x - 1, y - 1.1 * r, z - 1.1 * r], [x + 2 * r, y + 1.1 * r, z + 1.1 * r]) for y in ys
    ]


def _controls(rng, asm, root, x, half, z, room, unit, trim, ys=None) -> None:
    """One to three knobs on the plane ``x``, about the height ``z``, within ``room`` above and
    below."""
    r = min(float(rng.uniform(2.6, 4.5)) * unit, 0.8 * room)
    count = int(rng.integers(1, 4))
    ys = (
        np.linspace(-0.6, 0.6, count) * half
        if count > 1
        else [float(rng.uniform(-0.5, 0.5)) * half]
    )
    mark = plain(np.ones(3) * (0.1 if sum(trim.color) > 1.5 else 0.93))
    for y in ys:
        if count * 2.6 * r > 2 * half:
            continue
        limited = rng.random() < 0.6
        sweep = float(np.deg2rad(rng.choice([90, 180, 270]))) if limited else None
        add_knob(
            asm,
            root,
            (x, y, z),
            r,
            1.1 * r,
            trim,
            mark,
            sweep,
            pointer=limited,
            skirt=rng.random() < 0.4,
        )


def _jug(rng, x, low, high, radius, unit, trim) -> Shape:
    """A glass or steel jug with a handle towards the front."""
    tall = high - low
    neck = radius * float(rng.uniform(0.55, 0.95))
    belly = float(rng.uniform(0.2, 0.5))
    steel = rng.random() < 0.25
    glass = materials.metal(rng) if steel else materials.glass(rng)
    t = np.linspace(0, 1, 7)[1:]
    z = low + 0.86 * tall * (belly + (1 - belly) * t)
    r = neck + (radius - neck) * np.cos(t * np.pi / 2) ** 0.8
    profile = [
        [0, low],
        [0.88 * radius, low],
        [radius, low + 0.86 * tall * belly * 0.4],
        [radius, low + 0.86 * tall * belly],
        *np.column_stack([r, z]),
        [0, z[-1]],
    ]
    solid = revolution(np.array(profile), "z", [x, 0, 0], 28)
    cap = cylinder("z", [x, 0, low + 0.86 * tall], 0.14 * tall, 1.03 * neck, 0.9 * neck, 24)
    out, bar = radius * float(rng.uniform(1.35, 1.6)), 1.4 * unit
    line = [
        [x - 0.9 * neck, 0, low + 0.88 * tall],
        [x - out, 0, low + 0.88 * tall],
        [x - 0.97 * out, 0, low + 0.3 * tall],
        [x - 0.95 * radius, 0, low + 0.25 * tall],
    ]
    shape = Shape()
    if not steel:
        fill = low + tall * float(rng.uniform(0.15, 0.6))
        coffee = box([x - 1, -1, low - 1], [x + 1, 1, fill])
        shape.add(tidy(solid ^ coffee), plain((0.16, 0.08, 0.04)))
        shape.add(tidy(solid - coffee), glass)
    else:
        shape.add(solid, glass)
    return shape.add(tidy(cut(union([cap, pipe(line, bar, 10)]), [solid])), trim)


def _filter(rng: np.random.Generator) -> ArticulatedObject:
    """A column with tank and head over a hot plate: a jug, a lid, and a filter that swings
    or slides out."""
    high, half = float(rng.uniform(0.28, 0.4)), float(rng.uniform(0.08, 0.12))
    depth = float(rng.uniform(0.2, 0.28))
    unit = high / 100
    air = 0.35 * unit
    face = _finish(rng)
    trim = _trim(rng, face)
    base, head = float(rng.uniform(0.08, 0.14)) * high, float(rng.uniform(0.58, 0.7)) * high
    back = float(rng.uniform(0.56, 0.66)) * depth
    corner = float(rng.uniform(0.05, 0.6)) * half
    roof = head + float(rng.uniform(0.5, 0.75)) * (high - head)
    asm, body = Assembly(), Shape()
    whole = _column(rng, depth, half, 0, high, corner)
    room = box([-1, -1, base], [back, 1, head])
    radius = min(0.44 * back, 0.8 * half)
    x = 0.5 * back + 0.02 * depth
    filter_kind = str(rng.choice(["swing", "slide", "none"], p=[0.5, 0.2, 0.3]))
    holder = _column(rng, depth, half, head, roof, corner) ^ box([-1, -1, 0], [back - air, 1, 1])
    solid = whole - room
    if filter_kind != "none":
        solid -= box([-1, -1, head - 1e-3], [back, 1, roof + air])
        holder += cylinder("z", [x, 0, head - 3 * unit], 3.5 * unit, 0.45 * radius, 0.8 * radius)
        grip = box(
            [-3 * unit, -5 * unit, (head + roof) / 2 - 1.5 * unit],
            [1.5 * unit + 0.3 * corner, 5 * unit, (head + roof) / 2 + 1.5 * unit],
        )
    else:
        solid += cylinder("z", [x, 0, head - 3 * unit], 3.5 * unit, 0.45 * radius, 0.8 * radius)
    r = 2.2 * unit
    ys = [-0.5 * half, -0.5 * half + 3.4 * r][: int(rng.integers(0, 3))]
    ys = ys if base > 2.8 * r and corner < 0.3 * half else []
    body.add(tidy(cut(solid, _wells(0, ys, base / 2, r))), face)
    plate = cylinder("z", [x, 0, base], 0.8 * unit, 1.02 * radius, segments=28)
    body.add(plate, materials.dark(rng))
    if rng.random() < 0.4:  # a gauge of the water's height
        y = half
        gauge = box(
            [back + 0.3 * (depth - back), y, 0.2 * high],
            [back + 0.6 * (depth - back), y + 0.8 * unit, 0.6 * high],
        )
        body.add(gauge, materials.glass(rng))
    root = asm.add("body", body)
    if filter_kind == "swing":
        side = float(rng.choice([-1, 1]))
        joint = hinge(
            (back - air, side * half, 0), (0, 0, -side), float(np.deg2rad(rng.uniform(60, 95)))
        )
        holder += cylinder("z", [x, 0, head - 3 * unit], 3.5 * unit, 0.45 * radius, 0.8 * radius)
        part = Shape().add(tidy(holder), face if rng.random() < 0.5 else trim)
        asm.add("filter", part.add(tidy(grip - holder), trim), root, joint)
    elif filter_kind == "slide":
        part = Shape().add(tidy(holder), face if rng.random() < 0.5 else trim)
        part.add(tidy(grip - holder), trim)
        asm.add("filter", part, root, slide((-1, 0, 0), float(rng.uniform(0.4, 0.8)) * back))
    lid_from = 0.06 * depth if rng.random() < 0.5 else back
    inset = 0.3 * corner + unit
    _lid(
        rng,
        asm,
        root,
        [lid_from + inset, -half + inset],
        [depth - inset, half - inset],
        high,
        unit,
        face if rng.random() < 0.4 else trim,
    )
    if rng.random() < 0.85:
        jug = _jug(rng, x, base + 1.1 * unit, head - 3.6 * unit, radius, unit, trim)
        asm.add("jug", jug, root, slide((-1, 0, 0), float(rng.uniform(0.5, 0.9)) * depth))
    _buttons(rng, asm, root, 0, ys, base / 2, r, trim)
    return asm.object()


def _espresso(rng: np.random.Generator) -> ArticulatedObject:
    """One or two groups under a head, filter handles that turn, a tray, steam wands, knobs, at
    times levers."""
    groups = int(rng.choice([1, 2], p=[0.75, 0.25]))
    high = float(rng.uniform(0.3, 0.42))
    half = float(rng.uniform(0.1, 0.16)) + (groups - 1) * float(rng.uniform(0.08, 0.14))
    depth = float(rng.uniform(0.24, 0.4))
    unit = max(high, 2 * half, depth) / 100
    air = 0.35 * unit
    face = _finish(rng)
    trim, steel = _trim(rng, face), materials.metal(rng, brushed=False)
    base, head = float(rng.uniform(0.1, 0.18)) * high, float(rng.uniform(0.6, 0.72)) * high
    back = float(rng.uniform(0.42, 0.55)) * depth
    brow = float(rng.uniform(0.02, 0.3)) * back  # where the head's front is
    if rng.random() < 0.6:
        brow = 0.02 * back
    asm, body = Assembly(), Shape()
    corner = float(rng.uniform(0, 0.12)) * depth
    solid = (
        extrusion(rounded(high, depth, corner), "y", [depth / 2, -half, high / 2], 2 * half)
        if (rng.random() < 0.4)
        else box([0, -half, 0], [depth, half, high])
    )
    if rng.random() < 0.6:
        solid -= box([-1, -1, -1], [brow, 1, 2]) ^ box([-1, -1, base], [1, 1, 2])
    else:
        brow = 0.0
    solid -= box([-1, -1, base], [back, 1, head])
    face_x = brow
    tray_lo = np.array([0.0, -0.88 * half, 0.25 * base])
    tray_hi = np.array([0.92 * back, 0.88 * half, base - 0.5 * unit])
    solid -= box(tray_lo - [1, air, air], [tray_hi[0] + air, tray_hi[1] + air, 1]) ^ box(
        [-1, -1, 0], [1, 1, base + 1e-3]
    )
    middle = (head + high) / 2 + 0.5 * unit
    panel_room = (high - head) / 2 - max(corner, 0) * 0.5
    gx = face_x + (back - face_x) * float(rng.uniform(0.4, 0.55))
    r = min(float(rng.uniform(0.026, 0.034)), 0.8 * (back - gx))
    drop = float(rng.uniform(2.5, 6)) * unit
    gys = [0.0] if groups == 1 else [-0.45 * half, 0.45 * half]
    if groups == 1 and rng.random() < 0.4:
        gys = [float(rng.uniform(-0.3, 0.3)) * half]
    lever = rng.random() < 0.3
    body.add(tidy(solid), face)
    rings = [cylinder("z", [gx, y, head - drop], drop, r, segments=24) for y in gys]
    pivots = []
    if lever:  # a cylinder with two cheeks, in front of the head
        for y in gys:
            top = high + float(rng.uniform(0, 8)) * unit if groups == 1 else high + 3 * unit
            front = min(face_x, 0) - 0.9 * r
            tower = cylinder(
                "z", [front, y, middle - 1.0 * r], top - middle + r, 0.8 * r, segments=20
            )
            arm = box(
                [front, y - 0.4 * r, middle - 0.9 * r], [face_x, y + 0.4 * r, middle + 0.4 * r]
            )
            rings.append(cut(tower + arm, [solid]))
            pivots.append((front, y, top))
    body.add(tidy(union(rings)), steel)
    if corner < 2 * unit:
        _dress(rng, body, depth, half, high, back, unit, steel, trim)
    root = asm.add("body", body)
    if rng.random() < 0.85:
        _tray(rng, asm, root, tray_lo, tray_hi, unit, steel if rng.random() < 0.5 else trim)
    for y in gys:
        cup = cylinder("z", [gx, y, head - drop - air - 5 * unit], 5 * unit, 0.85 * r, 1.06 * r, 24)
        spout = cylinder(
            "z", [gx, y, head - drop - air - 8.5 * unit], 4 * unit, 0.35 * r, 0.5 * r, 14
        )
        long = gx + float(rng.uniform(0.06, 0.12))
        z = head - drop - air - 2.5 * unit
        grip = cylinder("x", [gx - 0.9 * r - long, y, z], long, 2.3 * unit, 1.5 * unit, 14)
        bowl = union([cup, spout])
        shape = Shape().add(bowl, steel).add(tidy(grip - bowl), trim)
        swing = -float(np.deg2rad(rng.uniform(35, 75)))
        asm.add("filter_handle", shape, root, hinge((gx, y, 0), (0, 0, 1), swing))
    for x, y, z in pivots:
        tip = [x - 3 * unit, y, z + float(rng.uniform(20, 38)) * unit]
        bar = pipe([[x, y, z + 1.6 * unit + air], [x, y, z + 6 * unit], tip], 1.4 * unit, 10)
        knob = pipe([tip, np.add(tip, [-0.6 * unit, 0, 7 * unit])], 2.2 * unit, 12)
        shape = Shape().add(tidy(bar - knob), steel).add(knob, trim)
        down = -float(np.deg2rad(rng.uniform(60, 85)))
        asm.add("lever", shape, root, hinge((x, y, z + 1.6 * unit + air), (0, 1, 0), down))
    sides = [-1.0, 1.0] if groups == 2 or rng.random() < 0.15 else [float(rng.choice([-1, 1]))]
    for side in sides if rng.random() < 0.75 else []:
        _wand(rng, asm, root, side, half, 0.5 * gx + 0.5 * face_x, head, base, unit, steel)
    if not lever and rng.random() < 0.85:
        _controls(rng, asm, root, face_x - 5e-4, half, middle, panel_room, unit, trim)
    if rng.random() < 0.45:
        inset = 0.06 * depth + corner
        _lid(
            rng,
            asm,
            root,
            [0.55 * depth, -0.85 * half],
            [depth - inset, 0.85 * half],
            high,
            unit,
            trim,
        )
    elif rng.random() < 0.5 and corner < 3 * unit:  # a tank behind, lifted out
        water = materials.glass(rng)
        t = float(rng.uniform(0.06, 0.1))
        tank = extrusion(
            rounded(t, 1.5 * half, 0.3 * t), "z", [depth + t / 2 + air, 0, 0], 0.97 * high
        )
        bar = box(
            [depth + 0.3 * t, -0.3 * half, 0.97 * high],
            [depth + 0.7 * t, 0.3 * half, high + 4 * unit],
        )
        shape = Shape().add(tank, water).add(bar, trim)
        asm.add("tank", shape, root, slide((0, 0, 1), float(rng.uniform(0.3, 0.8)) * high))
    return asm.object()


def _dress(rng, body: Shape, depth, half, high, back, unit, steel, trim) -> None:
    """Cheeks at the sides and a rail for cups, as some have."""
    if rng.random() < 0.5:
        t = float(rng.uniform(1, 3)) * unit
        cheek = trim if rng.random() < 0.5 else _finish(rng)
        for y in (-half - t, half):
            low, top = (back, back) if rng.random() < 0.5 else (1.05 * back, 1.4 * back)
            outline = np.array([[0, low], [0, depth], [high, depth], [high, top]])
            body.add(extrusion(outline, "y", [0, y, 0], t), cheek)
    if rng.random() < 0.4:
        x, y, z, r = 0.2 * depth, 0.9 * half, high + 4 * unit, 0.8 * unit
        ring = [[0.95 * depth, y, z], [x, y, z], [x, -y, z], [0.95 * depth, -y, z]]
        posts = [pipe([p, [*p[:2], high]], r, 8) for p in ring]
        body.add(tidy(union([pipe(ring, r, 8), *posts]) - box([-1, -1, 0], [1, 1, high])), steel)


def _automatic(rng: np.random.Generator) -> ArticulatedObject:
    """A bean-to-cup machine: a spout that slides up and down, a tray, a tank drawn out, a lid for
    the beans, a panel of buttons."""
    high, half = float(rng.uniform(0.3, 0.4)), float(rng.uniform(0.11, 0.15))
    depth = float(rng.uniform(0.3, 0.44))
    unit = max(high, depth) / 100
    air = 0.35 * unit
    face = _finish(rng)
    trim = _trim(rng, face)
    base, head = float(rng.uniform(0.1, 0.16)) * high, float(rng.uniform(0.6, 0.72)) * high
    back = float(rng.uniform(0.3, 0.42)) * depth
    side = float(rng.choice([-1, 1]))
    tank = rng.random() < 0.6
    inner = half - (float(rng.uniform(0.3, 0.5)) * half if tank else 0.12 * half)
    span = sorted((side * inner, -side * 0.88 * half))  # of the recess
    asm, body = Assembly(), Shape()
    solid = box([0, -half, 0], [depth, half, high])
    if rng.random() < 0.5:
        solid = extrusion(
            rounded(2 * half, high, float(rng.uniform(0.02, 0.25)) * half, 6),
            "x",
            [0, 0, high / 2],
            depth,
        )
    solid -= box([-1, span[0], base], [back, span[1], head])
    tray_lo = np.array([0, span[0] + air, 0.25 * base])
    tray_hi = np.array([back - air, span[1] - air, base - air])
    solid -= box(tray_lo - [1, air, air], [back, span[1], base + 1e-3])
    lo, hi = (
        [0, side * (inner + 2 * unit), 0.12 * high],
        [0.7 * depth, side * half * 0.94, 0.9 * high],
    )
    lo[1], hi[1] = sorted((lo[1], hi[1]))
    if tank:
        solid -= box(np.subtract(lo, [1, air, air]), np.add(hi, air))
    r, count = 2.2 * unit, int(rng.integers(0, 4))
    middle, center = (head + high) / 2, (span[0] + span[1]) / 2
    dial = rng.random() < 0.5
    far = span[1] - span[0]
    ys = [center + (k / max(count, 1) - 0.42) * far * 0.95 for k in range(count)]
    ys = ys if high - head > 8 * unit and not dial else []
    body.add(tidy(cut(solid, _wells(0, ys, middle, r))), face)
    root = asm.add("body", body)
    _tray(rng, asm, root, tray_lo, tray_hi, unit, trim)
    _buttons(rng, asm, root, 0, ys, middle, r, trim)
    if dial:
        r = min(0.36 * (high - head), 7 * unit)
        add_knob(
            asm, root, (-5e-4, center, middle), r, 0.7 * r, trim, face.darker(0.6), pointer=True
        )
    low = head - float(rng.uniform(0.25, 0.45)) * (head - base)
    w = float(rng.uniform(0.18, 0.3)) * far
    spout = box([0.1 * back, center - w, low], [back - air, center + w, head - air])
    nozzles = [
        cylinder("z", [0.4 * back, center + s * 0.5 * w, low - 3 * unit], 3.2 * unit, 1.6 * unit)
        for s in (-1, 1)
    ]
    drop = float(rng.uniform(0.4, 0.8)) * (low - 3 * unit - base)
    asm.add(
        "spout", Shape().add(tidy(union([spout, *nozzles])), trim), root, slide((0, 0, -1), drop)
    )
    if tank:
        water = materials.glass(rng) if rng.random() < 0.7 else trim
        grip = box(
            [-2.5 * unit, lo[1] + 1.5 * unit, hi[2] - 8 * unit],
            [0, hi[1] - 1.5 * unit, hi[2] - 4 * unit],
        )
        shape = Shape().add(box(lo, hi), water).add(grip, trim)
        asm.add("tank", shape, root, slide((-1, 0, 0), float(rng.uniform(0.4, 0.9)) * hi[0]))
    if rng.random() < 0.8:
        start = float(rng.uniform(0.3, 0.6)) * depth
        y = 0.8 * half
        _lid(rng, asm, root, [start, -y], [0.96 * depth, y], high, unit, trim)
    return asm.object()


def _wand(rng, asm, root, side, half, x, head, base, unit, steel: Material) -> None:
    """A steam pipe that hangs from a ball under the head and swings out to its side."""
    y, r = side * 0.86 * half, 1.5 * unit
    top = [x, y, head - 2.6 * unit]
    low = base + (head - base) * float(rng.uniform(0.1, 0.35))
    line = [
        top,
        [x - 3 * unit, y + side * 2 * unit, top[2] - 5 * unit],
        [x - 6 * unit, y + side * 3 * unit, low],
    ]
    shape = Shape().add(union([pipe(line, r, 10), ball(top, 2.4 * unit, 14)]), steel)
    swing = side * float(np.deg2rad(rng.uniform(50, 100)))
    asm.add("steam_wand", shape, root, hinge(top, (0, 0, -1), -swing))


def _capsule(rng: np.random.Generator) -> ArticulatedObject:
    """A narrow machine: a head on a column, a bow or lever on top, a tray below, a tank behind."""
    high, half = float(rng.uniform(0.23, 0.33)), float(rng.uniform(0.05, 0.085))
    depth, unit = float(rng.uniform(0.24, 0.34)), high / 100
    air = 0.4 * unit
    face = _finish(rng)
    trim = _trim(rng, face)
    base, head = float(rng.uniform(0.1, 0.16)) * high, float(rng.uniform(0.62, 0.72)) * high
    back = float(rng.uniform(0.4, 0.5)) * depth
    nose = float(rng.uniform(0.1, 0.35)) * back
    asm, body = Assembly(), Shape()
    end = 0.72 * depth
    profile = rounded(high - head, end - nose, float(rng.uniform(0.1, 0.5)) * (high - head), 6)
    top = extrusion(profile, "y", [(nose + end) / 2, -half, (head + high) / 2], 2 * half)
    stem = box([back, -0.85 * half, 0.5 * base], [end, 0.85 * half, (head + high) / 2])
    tray_lo, tray_hi = (
        np.array([0.0, -0.8 * half, 0.2 * base]),
        np.array([back - air, 0.8 * half, base]),
    )
    foot = _column(rng, end, half, 0, base, 0.2 * half) - box(
        tray_lo - [1, air, air], [back, tray_hi[1] + air, 1]
    )
    if rng.random() < 0.4:  # the base only behind, the tray stands in front
        foot = _column(rng, end, half, 0, base, 0.1 * half, back)
        tray_lo = np.array([0.0, -0.95 * half, 0.0])
        tray_hi[1] = 0.95 * half
    spout_x = (nose + back) / 2
    spout = cylinder("z", [spout_x, 0, head - 5 * unit], 5.5 * unit, 2.2 * unit, 4 * unit, 18)
    body.add(tidy(union([foot, stem, top])), face)
    body.add(tidy(spout - top), trim)
    root = asm.add("body", body)
    _tray(rng, asm, root, tray_lo, tray_hi, unit, trim)
    pivot = np.array([end - (high - head) * 0.4 - 0.05 * depth, 0, (head + high) / 2])
    corner = [nose, (head + high) / 2 + 0.5 * (high - head)]
    reach = np.hypot(pivot[0] - corner[0], pivot[2] - corner[1]) + 4 * unit
    steel = trim if rng.random() < 0.5 else materials.metal(rng, brushed=False)
    thick, tall = 2.4 * unit, float(rng.uniform(2, 3.5)) * unit
    rise = float(np.deg2rad(rng.uniform(0, 30)))
    arms = []
    for y in (-half - air - thick, half + air):
        arms += [
            box([-reach, y, -tall], [0, y + thick, tall]),
            cylinder("y", [0, y, 0], thick, 1.7 * tall, segments=18),
        ]
    grip = box(
        [-reach, -half - air - thick, -tall], [-reach + 2.6 * unit, half + air + thick, tall]
    )
    bow = union([*arms, grip]).rotate((0, np.rad2deg(rise), 0)).translate(tuple(pivot))
    up = float(np.deg2rad(rng.uniform(60, 95))) - 0.5 * rise
    asm.add("lever", Shape().add(tidy(bow), steel), root, hinge(pivot, (0, 1, 0), up))
    t = depth - end - air
    water = materials.glass(rng)
    tank = extrusion(rounded(t, 1.9 * half, 0.45 * t), "z", [end + air + t / 2, 0, 0], 0.96 * high)
    lifted = rng.random() < 0.5
    travel = slide((0, 0, 1), float(rng.uniform(0.3, 0.7)) * high)
    owner = asm.add("tank", Shape().add(tank, water), root, travel if lifted else None)
    if rng.random() < 0.6:
        lid = extrusion(
            rounded(t, 1.9 * half, 0.45 * t),
            "z",
            [end + air + t / 2, 0, 0.96 * high + air],
            3 * unit,
        )
        swing = float(np.deg2rad(rng.uniform(60, 100)))
        asm.add(
            "lid",
            Shape().add(lid, face),
            owner,
            hinge((depth, 0, 0.96 * high + air), (0, 1, 0), swing),
        )
    return asm.object()


def _mill(rng: np.random.Generator) -> ArticulatedObject:
    """A hand mill: a box with a drawer or a tube, a bowl, and a crank that turns on top."""
    half = float(rng.uniform(0.05, 0.08))
    high = half * float(rng.uniform(1.6, 3.0))
    unit = 2 * half / 60
    wood, steel = materials.wood(rng), materials.hardware(rng)
    wood = wood if rng.random() < 0.7 else _finish(rng)
    boxy = rng.random() < 0.65
    asm, body = Assembly(), Shape()
    middle = [half, 0, 0]
    if boxy:
        solid = box([0, -half, 3 * unit], [2 * half, half, high])
        lo, hi = (
            [0, -0.7 * half, 0.15 * high],
            [1.7 * half, 0.7 * half, float(rng.uniform(0.45, 0.7)) * high],
        )
        solid -= box(np.add(lo, [-1, -0.4 * unit, -0.4 * unit]), np.add(hi, 0.4 * unit))
        over = float(rng.uniform(0, 5)) * unit
        for z in (0.0, high):
            solid += extrusion(
                rounded(2 * (half + over), 2 * (half + over), 2 * unit),
                "z",
                [half, 0, z],
                3.2 * unit,
            )
        high += 3.2 * unit
    else:
        waist = float(rng.uniform(0.7, 1.0)) * half
        high *= 1.5
        solid = revolution(
            np.array(
                [
                    [0, 0],
                    [half, 0],
                    [half, 0.12 * high],
                    [waist, 0.5 * high],
                    [0.9 * half, high],
                    [0, high],
                ]
            ),
            "z",
            middle,
            28,
        )
    body.add(tidy(solid), wood)
    dome = float(rng.uniform(0.5, 0.85)) * half
    rise = dome * float(rng.uniform(0.4, 0.9))
    a = np.linspace(0, np.pi / 2, 7)
    shape = np.column_stack([dome * np.cos(a), rise * np.sin(a)])
    if rng.random() < 0.4:  # an open bowl
        shape = np.array(
            [
                [0.5 * dome, 0],
                [dome, rise],
                [0.85 * dome, rise],
                [0.4 * dome, 0.3 * rise],
                [0.15 * dome, 0.3 * rise],
                [0.15 * dome, rise],
            ]
        )
    profile = np.vstack([[[0, 0]], shape, [[0, rise]]])
    body.add(revolution(profile, "z", [half, 0, high], 28), steel)
    root = asm.add("body", body)
    z = high + rise + 0.4 * unit
    yaw = float(rng.uniform(-np.pi, np.pi))
    way = np.array([np.cos(yaw), np.sin(yaw), 0])
    long = half * float(rng.uniform(1.1, 1.8))
    r = 1.9 * unit
    a, b = np.array([half, 0, z + 5 * unit]), np.array([half, 0, z + 5 * unit]) + way * long
    b[2] += float(rng.uniform(0, 6)) * unit
    rod = union([pipe([a, b], r, 10), cylinder("z", [half, 0, z], 7 * unit, 1.6 * r, segments=14)])
    grip = cylinder(
        "z", b + [0, 0, 0.3 * r], float(rng.uniform(9, 14)) * unit, 2.2 * r, 2.8 * r, 16
    )
    knob = union([grip, ball(b + [0, 0, 11 * unit], 3 * r, 16)]) if rng.random() < 0.5 else grip
    crank = Shape().add(tidy(rod - knob), steel).add(knob, wood.darker(0.7))
    asm.add("crank", crank, root, turn((half, 0, z), (0, 0, 1)))
    if boxy:
        front = box(np.add(lo, [0, 0.1 * unit, 0.1 * unit]), hi) - box(
            np.add(lo, [3 * unit, 2 * unit, 2 * unit]), np.add(hi, [-2 * unit, -2 * unit, 1])
        )
        pull = ball([-3 * unit, 0, (lo[2] + hi[2]) / 2], 3 * unit, 14)
        shape = Shape().add(front, wood.darker(0.85)).add(tidy(pull - front), steel)
        asm.add("drawer", shape, root, slide((-1, 0, 0), float(rng.uniform(0.6, 1.0)) * half))
    return asm.object()


def _grinder(rng: np.random.Generator) -> ArticulatedObject:
    """An electric grinder: a hopper that turns, its lid, dials, a bin below."""
    half, depth = float(rng.uniform(0.06, 0.09)), float(rng.uniform(0.14, 0.22))
    high = float(rng.uniform(0.22, 0.34))
    unit = high / 80
    air = 0.35 * unit
    face = _finish(rng)
    trim = _trim(rng, face)
    base, head = float(rng.uniform(0.06, 0.12)) * high, float(rng.uniform(0.5, 0.62)) * high
    back = float(rng.uniform(0.4, 0.5)) * depth
    asm, body = Assembly(), Shape()
    corner = float(rng.uniform(0.02, 0.35)) * half
    solid = _column(rng, depth, half, 0, high, corner) - box([-1, -1, base], [back, 1, head])
    spout = cylinder("z", [0.5 * back, 0, head - 6 * unit], 6 * unit, 3 * unit, 5 * unit, 16)
    body.add(tidy(solid), face).add(spout, trim)
    root = asm.add("body", body)
    top, wide = high, min(0.85 * half, 0.42 * depth)
    x, tall = 0.5 * depth, float(rng.uniform(0.25, 0.5)) * high
    flare = wide * float(rng.uniform(1.0, 1.35))
    glass = materials.glass(rng)
    hopper = cylinder("z", [x, 0, top + air], tall, 0.75 * wide, flare, 28)
    collar = tube("z", [x, 0, top + air], 3.5 * unit, 0.95 * wide, 0.7 * wide)
    tab = box([x - 1.3 * wide, -2 * unit, top + air], [x - 0.9 * wide, 2 * unit, top + 3 * unit])
    ring = collar + tab
    shape = Shape().add(tidy(hopper - ring), glass).add(tidy(ring), trim)
    bin_ = asm.add(
        "hopper", shape, root, hinge((x, 0, 0), (0, 0, 1), float(np.deg2rad(rng.uniform(60, 180))))
    )
    lid = cylinder("z", [x, 0, top + tall + 2 * air], 3 * unit, 1.02 * flare, 0.95 * flare, 28)
    knob = cylinder("z", [x, 0, top + tall + 2 * unit], 5 * unit, 0.25 * flare, 0.3 * flare, 16)
    joint = slide((0, 0, 1), float(rng.uniform(0.15, 0.35)) * high)
    if rng.random() < 0.5:
        joint = hinge((x + flare, 0, top + tall + 2 * air), (0, 1, 0), float(rng.uniform(1.2, 1.9)))
    asm.add("lid", Shape().add(union([lid, knob]), trim), bin_, joint)
    if rng.random() < 0.7 and corner < 0.2 * half:
        middle = (head + high) / 2
        _controls(rng, asm, root, -5e-4, 0.8 * half, middle, (high - head) / 2, unit, trim)
    if rng.random() < 0.7:  # a bin under the spout
        r = min(0.45 * back, 0.7 * half)
        pot = cylinder("z", [0.5 * back, 0, base + air], head - 7 * unit - base, r, 0.95 * r, 24)
        asm.add(
            "bin",
            Shape().add(pot, glass if rng.random() < 0.6 else trim),
            root,
            slide((-1, 0, 0), float(rng.uniform(0.6, 1.0)) * back),
        )
    return asm.object()

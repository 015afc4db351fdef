"""Jars, canisters, tins and sugar pots with a wide lid that screws, lifts or swings open. Pepper
and coffee mills are in ``mills``."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.mills import coffee_mill, pepper_mill
from uniart_jax.procedural.everyday.turned import (
    ANGLES,
    ROUND,
    Rows,
    draw_finish,
    grip,
    hollow,
    plan_of,
    profile,
    radii_at,
    stack,
)
from uniart_jax.procedural.materials import plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    extrusion,
    hinge,
    pipe,
    rounded,
    screw,
    slide,
    tidy,
    tube,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A jar or mill in metres, closed; its clasp at -x."""
    makers = (_screwed, _hinged, _lifted, pepper_mill, coffee_mill)
    return makers[rng.choice(5, p=[0.3, 0.28, 0.2, 0.11, 0.11])](rng)


def _filled(rng, rows: Rows, wall: float, glassy: bool, bare: float = 0.0) -> Shape:
    """A body, clear with its contents inside if ``glassy``, else plain or with a band. A label may
    be on it, but not within ``bare`` of its top."""
    low, top = rows[0][1], rows[-1][1]
    body, face = Shape(), draw_finish(rng)
    fill = low + (top - low) * float(rng.uniform(0.2, 0.75))
    inside = hollow(rows, wall, fill)
    whole = cut(stack(rows), [inside])
    if glassy:
        clear = materials.glass(rng) if rng.random() < 0.7 else plain(rng.uniform(0.6, 0.95, 3))
        pulp = plain(materials.hsv(rng, (-0.1, 0.4), (0.3, 0.9), (0.2, 0.9)))
        below = box([-1, -1, low + wall], [1, 1, fill + 0.2 * wall])
        body.add(tidy(whole - below), clear).add(tidy(whole ^ below), pulp)
    elif rng.random() < 0.3:
        a = low + (top - low) * float(rng.uniform(0.1, 0.5))
        b = a + (top - low) * float(rng.uniform(0.05, 0.4))
        band = box([-1, -1, a], [1, 1, b])
        body.add(tidy(whole - band), face).add(tidy(whole ^ band), draw_finish(rng))
    else:
        body.add(whole, face)
    if rng.random() < 0.4 and bare < 0.6 * (top - low):  # a label
        a, b = low + (top - bare - low) * np.sort(rng.uniform(0.12, 0.7, 2) + [-0.08, 0.08])
        y = float(rng.uniform(0.4, 0.85)) * rows[3][0].min()
        grown = stack([(r + 0.1 * wall, z) for r, z in rows]) ^ box([-1, -y, a], [0, y, b])
        patch = tidy(grown - stack(rows))
        body.add(patch, plain(rng.uniform(0.3, 1.0, 3)))
    return body


def _neck(rng, rows: Rows, mouth: np.ndarray, tall: float, rise: float) -> Rows:
    """A body's outlines drawn in to a mouth that is ``rise`` higher, with an upright neck above."""
    r, z = rows[-1]
    steps = np.linspace(0, np.pi / 2, 5)[1:] if rng.random() < 0.6 else [np.pi / 2]
    soft = [(r + (mouth - r) * (1 - np.cos(a)), z + rise * np.sin(a)) for a in steps]
    return [*rows, *soft, (mouth, z + rise + tall)]


def _screwed(rng: np.random.Generator) -> ArticulatedObject:
    """A jar or canister with a round screw lid, at times with flaps in it."""
    plan = plan_of(rng, 0.6) * float(rng.uniform(0.03, 0.08))
    size = plan.min()
    high = size * float(rng.uniform(0.8, 4.0))
    unit = max(high, 2 * size) / 100
    mouth = ROUND * size * float(rng.uniform(0.75, 0.95))
    rows = profile(rng, plan, 0.0, high)
    mouth = np.minimum(mouth, 0.95 * rows[-1][0].min())
    m, tall = mouth[0], float(rng.uniform(6, 16)) * unit
    rows = _neck(rng, rows, mouth, tall, float(rng.uniform(0.02, 0.3)) * size)
    top, wall, air = rows[-1][1], 0.07 * m, 0.5 * unit
    thread = [
        tube("z", [0, 0, top - s * tall], 0.07 * tall, 1.03 * m, 0.9 * m, 48) for s in (0.25, 0.6)
    ]
    tone = draw_finish(rng)
    glassy = bool(rng.random() < 0.6)
    body = _filled(rng, rows, wall, glassy)
    body.add(tidy(cut(union(thread), [stack(rows)])), plain(rng.uniform(0.4, 0.9, 3)))

    lid, thick = Shape(), float(rng.uniform(1.5, 5)) * unit
    inner = 1.03 * m + 0.015 * m + air
    outer = inner + float(rng.uniform(1.2, 3)) * unit
    wave = ROUND.copy()
    if rng.random() < 0.5:
        wave[::2] = 0.955
        inner, outer = inner, outer / 0.955
    elif rng.random() < 0.3:
        wave = np.cos(np.pi / 8) / np.cos(ANGLES % (np.pi / 4) - np.pi / 8) / np.cos(np.pi / 8)
    z0, z1 = top - tall + air, top + air + thick
    crown = float(rng.choice([0.0, rng.uniform(2, 10)])) * unit
    outside = [(wave * outer, z0), (wave * outer, z1), (ROUND * 0.93 * outer, z1 + 0.3 * thick)]
    if crown:
        outside.append((ROUND * 0.6 * outer, z1 + 0.3 * thick + crown))
    lid.add(stack(outside) - cylinder("z", [0, 0, -1], 1 + top + air, inner, segments=48), tone)
    peak = outside[-1][1]
    flaps = not crown and rng.random() < 0.3
    if not flaps and rng.random() < 0.4:
        knob, _ = grip(rng, peak, outer)
        lid.add(tidy(knob - stack(outside)), tone if rng.random() < 0.5 else draw_finish(rng))
    elif not flaps and rng.random() < 0.4:  # a disc of another colour, with the maker's mark
        disc = cylinder("z", [0, 0, peak], 0.6 * unit, 0.5 * outer, segments=32)
        bar = box([-0.4 * outer, -unit, peak + 0.6 * unit], [0, unit, peak + 1.4 * unit])
        lid.add(disc, draw_finish(rng)).add(bar, draw_finish(rng))
    asm = Assembly()
    root = asm.add("body", body)
    turns = float(rng.choice([0.25, 0.5, 1.0, 1.5, 2.0]))
    cap = asm.add("lid", lid, root, screw((0, 0, 0), (0, 0, 1), turns, tall + 2 * unit))
    if flaps:
        both, hue = rng.random() < 0.6, draw_finish(rng)
        for side in (-1, 1) if both else (-1,):
            disc = cylinder("z", [0, 0, peak + air], 2 * unit, 0.9 * outer, segments=40)
            lo, hi = sorted((side * 0.06 * outer, side * 2 * outer))
            flap = disc ^ box([lo, -1, 0], [hi, 1, 9])
            tip = cylinder("z", [side * 0.86 * outer, 0, peak + air], 2.5 * unit, 0.12 * outer)
            shape = Shape().add(tidy(union([flap, tip])), hue)
            joint = hinge(
                (side * 0.06 * outer, 0, peak + air + 2 * unit),
                (0, -side, 0) if side > 0 else (0, 1, 0),
                float(np.deg2rad(rng.uniform(60, 85))),
            )
            asm.add("flap", shape, cap, joint)
    return asm.object()


def _barrels(body: Shape, lid: Shape, near: float, edge: float, z: float, unit: float, metal):
    """Add the barrels of a hinge behind a lid's rear ``edge``; returns the pivot."""
    r, w = 1.5 * unit, 5 * unit
    x = edge + r + 0.8 * unit
    lid.add(
        tidy(
            union(
                [
                    cylinder("y", [x, -w, z], 2 * w, r, segments=16),
                    box([edge - 0.1 * unit, -w, z + 0.3 * unit], [x, w, z + 1.3 * unit]),
                ]
            )
        ),
        metal,
    )
    for a in (w + 0.5 * unit, -2 * w - 0.5 * unit):
        arm = box([near, a, z - 2.4 * r], [x + 0.3 * r, a + w, z - 0.3 * r])
        body.add(tidy(union([arm, cylinder("y", [x, a, z], w, r, segments=16)])), metal)
    return (x, 0, z)


def _hinged(rng: np.random.Generator) -> ArticulatedObject:
    """A clip-top jar, tin or casket: a lid hinged at the rear, a wire or a clasp in front."""
    jar = rng.random() < 0.5
    plan = plan_of(rng, 0.6 if jar else 0.3) * float(rng.uniform(0.035, 0.09))
    size = plan.min()
    high = size * float(rng.uniform(1.0, 3.6) if jar else rng.uniform(0.5, 2.0))
    unit = max(high, 2 * size) / 100
    rows = profile(rng, plan, 0.0, high)
    if jar:
        mouth = rows[-1][0] * float(rng.uniform(0.75, 0.97))
        rows = _neck(rng, rows, mouth, 4 * unit, float(rng.uniform(0.03, 0.2)) * size)
    plan, top = rows[-1]
    metal, air, wall = materials.hardware(rng), 0.4 * unit, 0.07 * size
    tone = materials.glass(rng) if jar and rng.random() < 0.6 else draw_finish(rng)
    body, lid = _filled(rng, rows, wall, jar and rng.random() < 0.75), Shape()
    z, tall = top + air, float(rng.uniform(4, 12) if jar else rng.uniform(4, 30)) * unit
    bulge = float(rng.choice([0.0, rng.uniform(0.02, 0.3)])) * size
    rim = plan + (0 if not jar else unit)
    crown = [(rim, z), (rim, z + tall)]
    crown += [(rim * np.cos(a), z + tall + 0.5 * unit + bulge * np.sin(a)) for a in (0.5, 0.9, 1.2)]
    hood = stack(crown)
    if tall > 9 * unit:
        hood = cut(hood, [stack([(plan - wall, z - 1), (plan - wall, z + 0.6 * tall)])])
    lid.add(hood, tone)
    if jar:  # the ring of rubber
        seal = stack([(plan, top - 1.5 * unit), (plan + unit, top - unit), (plan + unit, top)])
        body.add(
            tidy(cut(seal, [stack([(r + 0.15 * unit, h) for r, h in rows])])),
            plain(materials.hsv(rng, (0.0, 0.1), (0.5, 0.9), (0.6, 0.95))),
        )
    elif rng.random() < 0.4:
        knob, _ = grip(rng, crown[-1][1], size)
        lid.add(tidy(knob - hood), metal)
    edge = rim[0]
    if jar or rng.random() < 0.7:
        at = _barrels(body, lid, plan[0] - 0.75 * wall, edge, z, unit, metal)
    else:
        at = (edge, 0, z)
    asm = Assembly()
    front = -max(rim[24], radii_at(rows, 0.8 * top)[24])
    clip = jar or rng.random() < 0.6
    if clip:
        below = float(rng.uniform(10, 28)) * unit
        z0 = max(top - below, 0.3 * top)
        front = -max(rim[24], *(radii_at(rows, h)[24] for h in np.linspace(z0 - unit, top, 5)))
        lug = box(
            [front - 2.4 * unit, -2 * unit, z0 - 1.4 * unit],
            [-radii_at(rows, z0)[24] + 0.3 * wall, 2 * unit, z0 + 1.4 * unit],
        )
        body.add(tidy(lug - stack(rows)), metal)
    root = asm.add("body", body)
    cover = asm.add("lid", lid, root, hinge(at, (0, 1, 0), float(np.deg2rad(rng.uniform(70, 110)))))
    if clip:
        x, r = front - 1.8 * unit, 1.2 * unit
        hook = z + tall + 0.7 * unit + r
        w = float(rng.uniform(4, 9)) * unit
        if jar or rng.random() < 0.5:  # a wire that is drawn over the lid's rim
            in_ = -0.88 * rim[24]
            hook += 0.48 * bulge
            lines = [[[x, s, z0], [x, s, hook], [in_, s, hook]] for s in (-w, w)]
            wire = [pipe(line, r, 8) for line in lines]
            wire += [pipe([[in_, -w, hook], [in_, w, hook]], r, 8)]
            wire += [pipe([[x, s * w, z0], [x, s * (2.6 * unit + r), z0]], r, 8) for s in (-1, 1)]
            if rng.random() < 0.6:
                tab = float(rng.uniform(6, 12)) * unit
                mid = 0.5 * (z0 + hook)
                plate = box([x - r, -w, mid], [x, w, mid + tab])
                wire.append(plate)
            shape = Shape().add(tidy(union(wire)), metal)
            angle = float(np.deg2rad(rng.uniform(70, 130)))
            asm.add("wire", shape, root, hinge((x, 0, z0), (0, -1, 0), angle))
        else:  # a clasp that hangs from the lid
            z2 = z + 0.7 * tall
            x = front - 2.8 * unit
            plate = extrusion(rounded(2 * w, z2 - z0, 0.6 * w), "x", [x - 2 * unit, 0, 0], 2 * unit)
            pin = box([x - 0.5 * unit, -0.5 * w, z2 - 3 * unit], [-rim[24] - air, 0.5 * w, z2])
            shape = Shape().add(union([plate.translate((0, 0, (z0 + z2) / 2)), pin]), metal)
            joint = hinge(
                (-rim[24] - air, 0, z2), (0, 1, 0), float(np.deg2rad(rng.uniform(60, 90)))
            )
            asm.add("clasp", shape, cover, joint)
    return asm.object()


def _lifted(rng: np.random.Generator) -> ArticulatedObject:
    """A sugar pot, biscuit barrel or tin whose lid lifts off, with ears or a swinging handle."""
    plan = plan_of(rng, 0.6) * float(rng.uniform(0.04, 0.09))
    size = plan.min()
    high = size * float(rng.uniform(0.9, 3.0))
    unit = max(high, 2 * size) / 100
    low = float(rng.choice([0.0, rng.uniform(2, 8)])) * unit
    rows = profile(rng, plan, low, high)
    plan, top = rows[-1]
    over = rng.random() < 0.4
    skirt = float(rng.uniform(6, 0.4 * high / unit)) * unit if over else 0.0
    reach = max(
        np.max(r - plan)
        for r, h in [*rows, (radii_at(rows, top - skirt), top)]
        if h > top - skirt - 1e-9
    )
    over = over and reach < 0.02 * size
    body = _filled(rng, rows, 0.08 * size, rng.random() < 0.15, skirt)
    tone, metal = draw_finish(rng), draw_finish(rng)
    if low:
        foot = stack([(rows[0][0] * 0.85, 0), (rows[0][0] * 0.7, low)])
        body.add(foot, metal)
    air = 0.5 * unit
    lid = Shape()
    rim = plan + (air + reach + 1.5 * unit if over else 0.8 * unit)
    z0, z1 = (top - skirt if over else top + air), top + air + float(rng.uniform(1.5, 4)) * unit
    bulge = float(rng.choice([0.02, rng.uniform(0.1, 0.55)])) * size
    crown = [(rim, z0), (rim, z1)]
    crown += [(rim * np.cos(a), z1 + bulge * np.sin(a)) for a in (0.3, 0.6, 0.9, 1.2)]
    hood = stack(crown)
    if over:
        hood -= stack([(plan + air + reach, z0 - 1), (plan + air + reach, top + air)])
    lid.add(hood, tone)
    peak, tip = crown[-1][1], 0.0
    if not over or rng.random() < 0.5:
        knob, tip = grip(rng, peak, size)
        lid.add(tidy(knob - hood), metal)
    asm = Assembly()
    pivot = top - 6 * unit
    reach = float(np.hypot(rim.max(), z1 - pivot)) + 2.5 * unit
    bail = np.ptp(plan) < 1e-9 and peak + tip - pivot < 1.5 * reach and rng.random() < 0.75
    if bail:
        reach = max(reach, peak + tip - pivot + 3 * unit, radii_at(rows, pivot).max() + 4 * unit)
        at = radii_at(rows, pivot)[12]
        for s in (-1, 1):
            y0, y1 = sorted((s * (at - 0.04 * size), s * (reach - 1.9 * unit)))
            lug = cylinder("y", [0, y0, pivot], y1 - y0, 1.8 * unit, segments=16)
            body.add(tidy(lug - stack(rows)), metal)
    elif rng.random() < 0.55:
        _ears(rng, body, rows, unit, size)
    root = asm.add("body", body)
    asm.add("lid", lid, root, slide((0, 0, 1), skirt + float(rng.uniform(15, 45)) * unit))
    if bail:
        a = np.linspace(0, np.pi, 17)
        # it lies in front: upright, it would be in the way of the lid
        line = np.column_stack([-reach * np.sin(a), reach * np.cos(a), 0 * a + pivot])
        shape = Shape().add(pipe(line, 1.5 * unit, 10), metal)
        asm.add("handle", shape, root, hinge((0, 0, pivot), (0, 1, 0), float(np.deg2rad(90))))
    return asm.object()


def _ears(rng, body: Shape, rows: Rows, unit: float, size: float) -> None:
    """Two handles at the sides."""
    low, top = rows[0][1], rows[-1][1]
    z, r = low + float(rng.uniform(0.5, 0.75)) * (top - low), float(rng.uniform(1.4, 2.6)) * unit
    half = float(rng.uniform(0.12, 0.24)) * (top - low)
    a = np.linspace(-np.pi / 2, np.pi / 2, 9)
    y, out = radii_at(rows, z)[12] - 0.04 * size, float(rng.uniform(0.25, 0.5)) * size
    line = np.column_stack([0 * a, y + out * np.cos(a), z + half * np.sin(a)])
    inner = [[0, y - 0.1 * size, line[0, 2]], *line, [0, y - 0.1 * size, line[-1, 2]]]
    ear = tidy(pipe(inner, r, 10) - stack(rows))
    piece = max(ear.decompose(), key=lambda s: s.bounding_box()[4])
    face = draw_finish(rng)
    body.add(piece, face).add(piece.mirror((0, 1, 0)), face)

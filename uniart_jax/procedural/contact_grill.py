"""Clamshells that open at their rear edge: sandwich presses and waffle irons with handles and
knobs; caskets, compacts, scanners with a lid; books and binders with covers."""

from __future__ import annotations

import dataclasses

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.fronts import add_knob
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    extrusion,
    hinge,
    loft,
    merged,
    pipe,
    rounded,
    slide,
    tidy,
    turn,
    union,
)

ACROSS = (0, 1, 0)
Link = tuple[str, Shape, Joint]


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A clamshell, metres, closed."""
    kind = rng.choice(5, p=[0.38, 0.17, 0.15, 0.15, 0.15])
    return (_press, _casket, _compact, _scanner, _book)[kind](rng).object()


def _finish(rng: np.random.Generator) -> Material:
    """Plastic of any colour, steel, white, black."""
    kind = rng.choice(4, p=[0.25, 0.2, 0.25, 0.3])
    if kind == 3:
        return plain(materials.hsv(rng, (0, 1), (0.3, 0.9), (0.3, 0.95)))
    return (materials.metal, materials.white_plastic, materials.dark)[kind](rng)


def _outline(rng, depth: float, wide: float, round_share: float) -> np.ndarray:
    """A plan about 0: a rectangle with rounded corners, or an ellipse."""
    if rng.random() < round_share:
        angle = np.linspace(0, 2 * np.pi, 36, endpoint=False)
        return np.column_stack([depth / 2 * np.cos(angle), wide / 2 * np.sin(angle)])
    return rounded(depth, wide, float(rng.uniform(0.01, 0.3)) * min(depth, wide), 6)


def _inset(outline: np.ndarray, by: float) -> np.ndarray:
    """An outline drawn in by about ``by`` on all sides."""
    return outline * (1 - by / np.abs(outline).max(0))


def _press(rng: np.random.Generator) -> Assembly:
    """A sandwich press or waffle iron; some turn over in a stand."""
    wide = float(rng.uniform(0.2, 0.4))
    depth = wide * float(rng.uniform(0.65, 1.15))
    outline = _outline(rng, depth, wide, 0.3)
    flips = rng.random() < 0.15
    unit, half = max(wide, depth) / 100, wide / 2
    low, lid_high = (float(rng.uniform(*span)) * unit for span in ((7, 17), (6, 18)))
    legs = float(rng.uniform(1, 4)) * unit
    if flips:
        low, lid_high, legs = 7 * unit, 7 * unit, half + 6 * unit
    body_tone, trim = _finish(rng), materials.hardware(rng)
    lid_tone = body_tone if rng.random() < 0.6 else _finish(rng)
    iron = materials.dark(rng)
    seam, gap, mid = legs + low, 0.9 * unit, depth / 2
    top = seam + gap + lid_high
    shrink = 1 - float(rng.choice([0.0, 0.06, 0.16]))
    plate = 1.6 * unit
    under = loft(outline * float(rng.uniform(0.8, 1)), outline, legs, seam - plate)
    over = loft(outline, outline * shrink, seam + gap + plate, top)
    under, over = (s.translate((mid, 0, 0)) for s in (under, over))
    irons = []
    for z, way in ((seam - plate, 1), (seam + gap, 1)):
        body = extrusion(_inset(outline, 2.5 * unit), "z", [mid, 0, z], way * plate)
        irons.append(body)
    irons[0] = _ribs(rng, irons[0], mid, depth, half, seam, unit)
    r, wall = float(rng.uniform(1.8, 2.8)) * unit, 1.6 * unit
    at = np.array([depth + 1.25 * r, 0, seam + gap + min(0.5 * lid_high, 4 * unit)])
    hold, lugs = _hinges(rng, at, r, wall, mid, half, seam, legs, unit, flips)
    reach = float(rng.uniform(7, 16)) * unit
    grip_z = seam + gap + 0.5 * min(lid_high, 9 * unit)
    tone = iron if rng.random() < 0.6 else trim
    grip = _grip(rng, mid, half, grip_z, reach, unit, top, over)
    body = [(union([under, hold]), body_tone), (irons[0], iron)]
    if not flips:
        size = float(rng.uniform(2, 3.5)) * unit
        feet = [
            cylinder("z", [mid + a * 0.6 * mid, b * 0.6 * half, 0], legs + unit, size, segments=12)
            for a in (-1, 1)
            for b in (-1, 1)
        ]
        body.append((union(feet) - under, iron))
    asm, root, joint, links = Assembly(), -1, None, []
    if flips:
        root, spindle, joint = _stand(rng, asm, at, seam, mid, half, legs, unit, trim)
        body.append((spindle - under - hold, trim))
    elif rng.random() < 0.4 and np.ptp(outline[:, 1][outline[:, 0] < -0.49 * depth]) > 0.5 * wide:
        body[0], links = _tray(rng, body[0], wide, depth, legs, low, unit, trim)
    if flips or (not links and rng.random() < 0.55):
        z, w = seam - 3.4 * unit, float(rng.uniform(5, 12)) * unit
        ledge = box([-0.8 * reach, -w, z - 1.6 * unit], [0.4 * mid, w, z + 1.6 * unit])
        body.append((ledge, tone))
    lower = asm.add("body", _layered(body), root, joint)
    lid = [(union([over, lugs]), lid_tone), (irons[1], iron), (grip - over - lugs, tone)]
    if rng.random() < 0.4:  # a band or badge on the lid
        size = shrink * float(rng.uniform(0.3, 0.75))
        badge = extrusion(size * outline, "z", [mid, 0, top - 1e-4], 0.5 * unit)
        lid.append((badge - over - grip, _finish(rng)))
    most = 92 if flips else float(rng.choice([75, 95, 110, 170], p=[0.25, 0.35, 0.3, 0.1]))
    if most > 120 and 2 * at[2] - top < 0.1 * unit:
        most = 105.0
    cover = asm.add("lid", _layered(lid), lower, hinge(at, ACROSS, np.deg2rad(most)))
    for name, shape, link in links:
        asm.add(name, shape, lower, link)
    if rng.random() < 0.4:
        z = grip_z - 1.2 * unit
        x, w = -reach - 0.4 * unit, float(rng.uniform(2.5, 5)) * unit
        clip = box([x - 1.4 * unit, -w, z - 7 * unit], [x, w, z])
        clip += cylinder("y", [x - 0.5 * unit, -w, z], 2 * w, 1.1 * unit, segments=12)
        clip = clip.translate((-0.7 * unit, 0, 0))
        joint = hinge([x - 1.2 * unit, 0, z], ACROSS, np.deg2rad(float(rng.uniform(60, 100))))
        asm.add("latch", Shape().add(tidy(clip), trim), cover, joint)
    if rng.random() < 0.45 and not flips and lid_high > 7 * unit:
        size = float(rng.uniform(3.2, 5.5)) * unit
        sweep = None if rng.random() < 0.4 else float(np.deg2rad(rng.choice([180, 270])))
        spot = (mid * 0.9, float(rng.choice([-0.45, 0, 0.45])) * half, top + 0.5 * unit)
        if shrink * half > 4 * size:
            add_knob(asm, cover, spot, size, 0.9 * size, trim, iron, sweep, tilt=np.pi / 2)
    return asm


def _layered(pieces: list[tuple[Manifold, Material]]) -> Shape:
    """Solids of which a later one gives way to the earlier ones."""
    out, before = [], None
    for solid, material in pieces:
        out.append((solid if before is None else solid - before, material))
        before = solid if before is None else before + solid
    return merged(out)


def _ribs(rng, plate: Manifold, mid, depth, half, seam, unit) -> Manifold:
    """A plate with grooves across it, along it or both."""
    kind, deep, w = str(rng.choice(["plain", "bars", "grid"])), 0.9 * unit, 1.3 * unit
    cuts = []
    if kind != "plain":
        for y in np.arange(-0.8, 0.81, 0.2) * half:
            cuts.append(box([0.1 * depth, y - w, seam - deep], [0.9 * depth, y + w, seam + 1]))
    if kind == "grid":
        for x in mid + np.arange(-0.8, 0.81, 0.2) * mid:
            cuts.append(box([x - w, -0.9 * half, seam - deep], [x + w, 0.9 * half, seam + 1]))
    keep = plate.scale((0.9, 0.9, 1)).translate((0.1 * mid, 0, 0))
    return cut(plate, [union(cuts) ^ keep]) if cuts else plate


def _hinges(rng, at, r, wall, mid, half, seam, legs, unit, single: bool):
    """Cheeks behind the body, and the lid's lugs between them."""
    spots = [0.0] if single or rng.random() < 0.35 else [-0.62 * half, 0.62 * half]
    tab = (0.35 * half if len(spots) == 1 else float(rng.uniform(1.5, 4)) * unit) * 0.9
    air, x, z = 0.3 * unit, at[0], at[2]
    low = max(legs, seam - 7 * unit)
    hold, lugs = [], []
    for y in spots:
        lugs.append(cylinder("y", [x, y - tab, z], 2 * tab, r, segments=18))
        lugs.append(box([1.3 * mid, y - tab, z - 0.7 * r], [x, y + tab, z + 0.7 * r]))
        for s in (y - tab - air - wall, y + tab + air):
            hold.append(cylinder("y", [x, s, z], wall, r, segments=18))
            hold.append(box([x - r, s, low], [x + r, s + wall, z]))
            hold.append(box([1.3 * mid, s, low], [x + r, s + wall, seam - 2 * unit]))
    return union(hold), union(lugs)


def _grip(rng, mid, half, z, reach, unit, top, over: Manifold) -> Manifold:
    """A handle on the lid: a tongue or a bar in front, a loop on its top."""
    kind, w = str(rng.choice(["tongue", "bar", "loop"], p=[0.4, 0.4, 0.2])), 1.5 * unit
    if kind == "tongue":
        outline = rounded(reach + 0.5 * mid, float(rng.uniform(8, 26)) * unit, 4 * unit)
        return extrusion(outline, "z", [0.25 * mid - reach / 2, 0, z - w], 2 * w)
    y = float(rng.uniform(0.25, 0.7)) * half
    if kind == "bar":
        ends = [[0.7 * mid, -y, z], [-reach + w, -y, z], [-reach + w, y, z], [0.7 * mid, y, z]]
    else:
        rise = float(rng.uniform(4, 9)) * unit
        ends = [[0.5 * mid, -y, top - unit], [-0.2 * reach, -y, top + rise]]
        ends += [[-0.2 * reach, y, top + rise], [0.5 * mid, y, top - unit]]
        tongue = box([-reach, -3 * unit, z - w], [0.4 * mid, 3 * unit, z + w])
        return union([pipe(ends, w, 8), tongue])
    return pipe(ends, w, 8)


def _stand(rng, asm: Assembly, at, seam, mid, half, legs, unit, trim: Material):
    """A foot with a post behind, in which the iron turns over about x; its spindle."""
    z, r, x = seam - 2.5 * unit, 2 * unit, at[0] + 5 * unit
    foot = extrusion(
        rounded(1.2 * (x + 4 * unit), 1.3 * half, 6 * unit), "z", [mid + 4 * unit, 0, 0], 3 * unit
    )
    post = box([x, -5 * unit, 2 * unit], [x + 6 * unit, 5 * unit, z])
    post += cylinder("x", [x, 0, z], 6 * unit, 5 * unit, segments=24)
    post -= cylinder("x", [x - 1, 0, z], 3, r + 0.3 * unit)
    root = asm.add("stand", Shape().add(tidy(foot + post), trim))
    spindle = cylinder("x", [1.5 * mid, 0, z], x + 7.5 * unit - 1.5 * mid, r)
    spindle += cylinder("x", [x + 6.5 * unit, 0, z], 1.5 * unit, 3.5 * unit)
    way = float(rng.choice([-1, 1]))
    return root, spindle, hinge([mid, 0, z], (way, 0, 0), np.pi)


def _tray(rng, body, wide, depth, legs, low, unit, trim: Material):
    """A knob in front, or a drip tray that draws out there."""
    solid, tone = body
    solid = solid + box([0, -0.34 * wide, legs], [0.4 * depth, 0.34 * wide, legs + low - 2 * unit])
    if rng.random() < 0.6 or low < 9 * unit:
        r = min(0.36 * low, 4.5 * unit)
        y = float(rng.choice([-0.24, 0, 0.24])) * wide
        at = [-0.3 * unit, y, legs + 0.45 * low]
        knob = cylinder("x", [at[0] - 1.1 * r, y, at[2]], 1.1 * r, 0.8 * r, r, segments=18)
        mark = box([at[0] - 1.5 * r, y - 0.2 * r, at[2]], [at[0] - 1.1 * r, y + 0.2 * r, at[2] + r])
        joint = hinge(at, (1, 0, 0), np.deg2rad(270)) if rng.random() < 0.6 else turn(at, (1, 0, 0))
        shape = Shape().add(knob, trim).add(mark, _finish(rng))
        return (solid, tone), [("knob", shape, joint)]
    air, w = 0.3 * unit, float(rng.uniform(0.18, 0.3)) * wide
    lo, hi = [0, -w, legs + 0.8 * unit], [0.7 * depth, w, legs + 4.6 * unit]
    room = box([-1, -w - air, lo[2] - air], [hi[0] + air, w + air, hi[2] + air])
    tray = box(lo, hi) - box([unit, -w + unit, lo[2] + unit], [hi[0] - unit, w - unit, 9])
    tray += box([-2.5 * unit, -w, lo[2]], [0.001, w, hi[2]])
    shape = Shape().add(tidy(tray), trim)
    return (solid - room, tone), [("drip_tray", shape, slide((-1, 0, 0), 0.5 * depth))]


@dataclasses.dataclass
class _Shell:
    """Two halves with walls: what the lower and the upper one are, their plan, seam and top."""

    body: Manifold
    lid: Manifold
    plan: np.ndarray
    middle: float
    seam: float
    top: float


def _shell(rng, plan, depth, z0, seam, top, wall, air, crown: float) -> _Shell:
    """A tray and a hollow lid over it, ``crown`` of the plan at its top."""
    mid, low = depth / 2, seam + air
    inner = _inset(plan, wall)
    body = extrusion(plan, "z", [mid, 0, z0], seam - z0)
    body -= extrusion(inner, "z", [mid, 0, z0 + wall], 9)
    lid = loft(plan, plan * crown, low, top).translate((mid, 0, 0))
    if top - low > 2.2 * wall:
        lid -= loft(inner, inner * crown, low - 1e-3, top - wall).translate((mid, 0, 0))
    return _Shell(body, lid, plan, mid, seam, top)


def _casket(rng: np.random.Generator) -> Assembly:
    """A jewellery box or chest: hollow lid, drawers below, a clasp, a lining."""
    wide = float(rng.uniform(0.14, 0.4))
    depth = wide * float(rng.uniform(0.5, 1.0))
    high = wide * float(rng.uniform(0.25, 0.85))
    unit, half = wide / 100, wide / 2
    count = int(np.clip(high / unit // 16 - 1, 0, 3)) if rng.random() < 0.65 else 0
    tone = materials.wood(rng) if rng.random() < 0.55 else _finish(rng)
    trim, wall, air = materials.hardware(rng), 2.4 * unit, 0.5 * unit
    legs = float(rng.choice([0.0, 2.0, 4.0])) * unit
    rows = count * 13 * unit + (2 * unit if count else 0)
    floor = legs + rows
    seam = floor + (high - rows) * float(rng.uniform(0.4, 0.7))
    top = floor + high - rows
    plan = rounded(depth, wide, float(rng.uniform(0.2, 12 if not count else 3)) * unit, 5)
    crown = float(rng.choice([1.0, 1.0, 0.85, 0.7]))
    shell = _shell(rng, plan, depth, floor, seam, top, wall, air, crown)
    body, lining = [], plain(materials.hsv(rng, (0, 1), (0.3, 0.9), (0.2, 0.7)))
    if count:
        body.append(extrusion(plan, "z", [depth / 2, 0, legs], rows + wall))
    drawers = []
    for k in range(count):
        lo = np.array([0.0, -half + wall + air, legs + (2 + 13 * k) * unit])
        hi = np.array([depth - 2 * wall, half - wall - air, lo[2] + 11.4 * unit])
        body[0] -= box([-1, *(lo[1:] - air)], hi + air)
        solid = box(lo, hi) - box([wall, lo[1] + wall, lo[2] + wall], [*(hi[:2] - wall), 9])
        pull = cylinder("x", [-2.4 * unit, 0, lo[2] + 5.7 * unit], 2.4 * unit + 1e-4, 2.2 * unit)
        shape = _layered([(solid, tone), (pull, trim)])
        drawers.append(("drawer", shape, slide((-1, 0, 0), float(rng.uniform(0.4, 0.75)) * depth)))
    pad = extrusion(_inset(plan, 1.4 * wall), "z", [depth / 2, 0, floor + wall], 2 * unit)
    pieces = [(union([shell.body, *body]), tone), (pad, lining)]
    if legs:
        feet = [
            box([x, s * 0.8 * half - 4 * unit, 0], [x + 8 * unit, s * 0.8 * half + 4 * unit, legs])
            for x in (0.06 * depth, 0.94 * depth - 8 * unit)
            for s in (-1, 1)
        ]
        pieces.append((union(feet), trim))
    asm = Assembly()
    root = asm.add("body", _layered(pieces))
    lid = [(shell.lid, tone)]
    if top - seam > 3 * wall and rng.random() < 0.4:
        glass = crown * _inset(plan, 2.5 * wall)
        lid.append((extrusion(glass, "z", [depth / 2, 0, top - 1e-4], 0.8 * unit), trim))
    swing = np.deg2rad(float(rng.uniform(75, 125)))
    cover = asm.add("lid", _layered(lid), root, hinge([depth, 0, seam + air], ACROSS, swing))
    for name, shape, joint in drawers:
        asm.add(name, shape, root, joint)
    if rng.random() < 0.5 and top - seam > 5 * unit and crown > 0.8:
        w, z = float(rng.uniform(3, 6)) * unit, seam + air + 2.6 * unit
        hasp = box([-2 * unit, -w, z - 7 * unit], [-0.5 * unit, w, z])
        hasp += cylinder("y", [-1.25 * unit, -w, z], 2 * w, 0.75 * unit, segments=10)
        joint = hinge([-1.25 * unit, 0, z], ACROSS, np.deg2rad(float(rng.uniform(70, 120))))
        asm.add("clasp", Shape().add(tidy(hasp), trim), cover, joint)
    return asm


def _compact(rng: np.random.Generator) -> Assembly:
    """A flat case: a mirror, a palette, a tin, a pizza box; its lid hinged, or pinned at a side."""
    wide = float(rng.uniform(0.06, 0.3))
    depth = wide * float(rng.uniform(0.55, 1.05))
    unit = wide / 100
    plan = _outline(rng, depth, wide, 0.45)
    thick, air, wall = float(rng.uniform(5, 14)) * unit, 0.5 * unit, 2.4 * unit
    seam = thick * float(rng.uniform(0.4, 0.65))
    if seam - wall < 1.5 * unit:
        seam = wall + 1.5 * unit
    top = max(thick, seam + air + 3 * unit)
    mid = depth / 2
    body = extrusion(plan, "z", [mid, 0, 0], seam)
    well = extrusion(_inset(plan, 2 * wall), "z", [mid, 0, wall], 9)
    tone, trim = _finish(rng), materials.hardware(rng)
    pieces, slots = [(body - well, tone)], int(rng.choice([1, 2, 3, 4]))
    room = extrusion(_inset(plan, 2.6 * wall), "z", [mid, 0, wall], max(seam - 1.4 * wall, unit))
    for k in range(slots):
        y = [(-1 + 2 * (k + s) / slots) * 0.92 * wide / 2 for s in (0.06, 0.94)]
        part = room ^ box([-1, y[0], 0], [2, y[1], 1])
        pieces.append((part, plain(materials.hsv(rng, (0, 1), (0.1, 0.8), (0.4, 0.95)))))
    lid = loft(plan, plan * float(rng.uniform(0.86, 1)), seam + air, top).translate((mid, 0, 0))
    pinned = rng.random() < 0.25
    glass = extrusion(_inset(plan, 2 * wall), "z", [mid, 0, seam + air - 1], 1 + unit)
    mirror = extrusion(_inset(plan, 2.2 * wall), "z", [mid, 0, seam + air + 0.3 * unit], 0.7 * unit)
    cover = [(lid - glass, tone if rng.random() < 0.7 else _finish(rng))]
    cover.append((mirror, materials.glass(rng)))
    if rng.random() < 0.6:
        emblem = plan * float(rng.uniform(0.25, 0.75))
        cover.append((extrusion(emblem, "z", [mid, 0, top - 1e-4], 0.6 * unit), _finish(rng)))
    asm = Assembly()
    asm.add("body", _layered(pieces))
    if pinned:
        side = float(rng.choice([-1, 1]))
        axis = hinge([mid, side * 0.44 * wide, 0], (0, 0, -side), np.deg2rad(rng.uniform(90, 175)))
    else:
        r, w = 1.4 * unit, 0.2 * wide
        tab = cylinder("y", [depth + 0.4 * unit, -w, seam + air + r], 2 * w, r, segments=12)
        cover.append((tab - lid, trim))
        axis = hinge([depth + 0.4 * unit, 0, seam + air], ACROSS, np.deg2rad(rng.uniform(90, 175)))
        tongue = box([-2 * unit, -0.1 * wide, seam + air], [mid, 0.1 * wide, seam + air + 2 * unit])
        cover.append((tongue - lid - glass, trim))
    asm.add("lid", _layered(cover), 0, axis)
    return asm


def _scanner(rng: np.random.Generator) -> Assembly:
    """A scanner or copier: a lid over glass, a panel with keys in front or beside, drawers."""
    wide = float(rng.uniform(0.35, 0.6))
    depth = wide * float(rng.uniform(0.65, 1.2))
    unit, half, air = max(wide, depth) / 100, wide / 2, 0.4 * max(wide, depth) / 100
    copier = rng.random() < 0.5
    high = float(rng.uniform(25, 80) if copier else rng.uniform(7, 16)) * unit
    tone = materials.white_plastic(rng) if rng.random() < 0.5 else _finish(rng)
    dark = materials.dark(rng)
    rim = float(rng.uniform(12, 22)) * unit  # of the panel
    beside = not copier and rng.random() < 0.4
    plan = rounded(depth, wide, float(rng.uniform(0.5, 5)) * unit, 5)
    body = extrusion(plan, "z", [depth / 2, 0, 0], high)
    lo, hi = np.array([rim, -half]), np.array([depth - 0.5 * unit, half])
    if beside:
        lo = np.array([0.0, -half + rim])
    pane = box([*(lo + 4 * unit), high - 1e-4], [*(hi - 4 * unit), high + 0.3 * unit])
    links, drop = [], 0.0
    if not beside:
        drop = float(rng.uniform(0, 0.35)) * rim
        body -= extrusion(
            np.array(
                [
                    [high - drop, -0.01],
                    [high - drop, 0],
                    [high, rim - unit],
                    [high + 1, rim - unit],
                    [high + 1, -0.01],
                ]
            ),
            "y",
            [0, -half - 1, 0],
            wide + 2,
        )
    trays = int(rng.integers(1, 4)) if copier and high > 30 * unit else 0
    step = (high - drop - 8 * unit) / max(trays, 3)
    for k in range(trays):
        z, w = 2 * unit + k * step, 0.86 * half
        body -= box([-1, -w - air, z - air], [0.8 * depth + air, w + air, z + step - unit])
        tray = box([0, -w, z], [0.8 * depth, w, z + step - 2 * unit])
        tray -= box([2 * unit, 2 * unit - w, z + 2 * unit], [0.78 * depth, w - 2 * unit, 9])
        grip = box([-1.5 * unit, -0.3 * w, z + 0.55 * step], [1e-4, 0.3 * w, z + 0.75 * step])
        shape = _layered([(tray, tone), (grip, dark)])
        links.append(("drawer", shape, slide((-1, 0, 0), float(rng.uniform(0.35, 0.65)) * depth)))
    if not trays:
        pass
    elif rng.random() < 0.5:
        z = 2 * unit + trays * step
        body -= box(
            [-1, -0.6 * half, z],
            [0.3 * depth, 0.6 * half, min(z + 5 * unit, high - drop - 3 * unit)],
        )
    pieces = [(tidy(body), tone), (pane, materials.glass(rng))]
    size = float(rng.uniform(2.2, 3.2)) * unit
    count = int(rng.choice([1, 2, 3]))
    lean = float(np.arctan2(drop, rim - unit))
    for k in range(count):  # keys on the panel, pressed down
        at = np.array([0.5 * rim, (-0.8 + 0.2 * k) * half, high - 0.5 * drop])
        if beside:
            at = np.array([(0.2 + 0.2 * k) * depth, -half + 0.5 * rim, high])
        key = box([-size, -size, -0.3 * unit], [size, size, 1.4 * unit])
        hole = box([-size - air, -size - air, -2 * unit], [size + air, size + air, 1]).rotate(
            (0, -np.rad2deg(lean), 0)
        )
        pieces[0] = (pieces[0][0] - hole.translate(at), tone)
        key = key.rotate((0, -np.rad2deg(lean), 0)).translate(at)
        down = (np.sin(lean), 0, -np.cos(lean))
        links.append(("button", merged([(key, _finish(rng))]), slide(down, 1.1 * unit)))
    asm = Assembly()
    root = asm.add("body", _layered(pieces))
    low, thick = high + 0.8 * unit, float(rng.uniform(3, 6)) * unit
    outline = rounded(*(hi - lo), float(rng.uniform(0.3, 4)) * unit)
    mid = (lo + hi) / 2
    cover = [(extrusion(outline, "z", [*mid, low], thick), tone if rng.random() < 0.6 else dark)]
    feeder = rng.random() < 0.35
    if feeder:
        a, b = lo + [3 * unit, 4 * unit], hi - [6 * unit, 0.45 * wide]
        hump = rounded(*(b - a), 4 * unit)
        tall = float(rng.uniform(6, 12)) * unit
        hump = loft(hump, 0.85 * hump, 0, tall).translate((*((a + b) / 2), low + thick - 1e-4))
        cover.append((hump, tone))
    grip = box([lo[0] - 1.5 * unit, -8 * unit, low], [mid[0], 8 * unit, low + 2 * unit])
    cover.append((grip, dark))
    most = np.deg2rad(float(rng.uniform(60, 95)))
    asm.add("lid", _layered(cover), root, hinge([hi[0], 0, low], ACROSS, most))
    for name, shape, joint in links:
        asm.add(name, shape, root, joint)
    return asm


def _book(rng: np.random.Generator) -> Assembly:
    """A book, album or binder, lying or upright: a cover that opens about the spine, a strap."""
    wide = float(rng.uniform(0.14, 0.32))
    depth = wide * float(rng.uniform(0.75, 1.5))
    unit = max(wide, depth) / 100
    thick = float(rng.uniform(7, 26)) * unit
    board, air = float(rng.uniform(1.6, 2.4)) * unit, 0.4 * unit
    tone = plain(materials.hsv(rng, (0, 1), (0.2, 0.9), (0.15, 0.8)))
    paper = plain(materials.hsv(rng, (0.08, 0.16), (0.0, 0.25), (0.8, 0.98)))
    side = float(rng.choice([-1, 1]))  # of the spine
    half, over = wide / 2, float(rng.uniform(0.3, 2.5)) * unit
    binder = thick > 12 * unit and rng.random() < 0.5
    base = box([0, -half, 0], [depth, half, board])
    edge = half - board
    lo, hi = sorted((side * edge, side * half))
    spine = box([0, lo, 0], [depth, hi, thick - board - air])
    a, b = sorted((side * (edge - (6 * unit if binder else 0)), -side * (half - over)))
    block = box([over, a, board], [depth - over, b, thick - board - 2 * air])
    if binder:
        block = block.scale((1, 1, 0.6)).translate((0, 0, 0.4 * board))
        at = [0.3 * depth, side * (edge - 3.5 * unit), 0.4 * thick]
        ring = cylinder("x", at, 0.4 * depth, 3.6 * unit)
        block += ring ^ box([0, -half, board], [depth, half, 9])
    pieces = [(base + spine, tone), (block, paper)]
    cover = [(box([0, -half, thick - board], [depth, half, thick]), tone)]
    for _ in range(int(rng.integers(0, 3))):  # a title, a picture
        p, q = rng.uniform(0.08, 0.5, 2), rng.uniform(0.55, 0.92, 2)
        z = thick + float(rng.uniform(0.3, 0.5)) * unit
        label = box(
            [p[0] * depth, (p[1] - 0.5) * wide, thick - 1e-4],
            [q[0] * depth, (q[1] - 0.5) * wide, z],
        )
        cover.append((label, plain(rng.uniform(0.1, 0.95, 3))))
    asm = Assembly()
    root = asm.add("body", _layered(pieces))
    axis = hinge([0, side * half, thick - board], (side, 0, 0), -np.deg2rad(rng.uniform(95, 178)))
    asm.add("cover", _layered(cover), root, axis)
    if rng.random() < 0.35:  # a strap over the free edge, held by the lower cover
        w, y = float(rng.uniform(4, 9)) * unit, -side * (half + 0.5 * unit)
        c, d = sorted((y, y - side * 1.6 * unit))
        strap = box([depth / 2 - w, c, 0], [depth / 2 + w, d, thick + 2.2 * unit])
        c, d = sorted((y, -side * (half - 9 * unit)))
        strap += box([depth / 2 - w, c, thick + 0.7 * unit], [depth / 2 + w, d, thick + 2.2 * unit])
        joint = hinge([0, -side * half, 0], (side, 0, 0), np.deg2rad(rng.uniform(70, 120)))
        asm.add("strap", Shape().add(tidy(strap), materials.dark(rng)), root, joint)
    if rng.random() < 0.3:  # upright, its spine in front, behind or at a side
        yaw = np.deg2rad(float(rng.choice([0, 90, 180, 270])))
        c, s = np.cos(yaw), np.sin(yaw)
        lift = np.array([[0.0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]])
        turned = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]) @ lift
        asm.parts = list(asm.object().transformed(turned).parts)
    return asm

"""Things that open like a clamshell: sandwich presses and waffle irons here, the other kinds in
``clamshells``."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.clamshells import (
    ACROSS,
    book,
    casket,
    compact,
    draw_finish,
    outline_of,
    scanner,
)
from uniart_jax.procedural.fronts import add_knob
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.pieces import layered
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cut,
    cylinder,
    extrusion,
    hinge,
    inset,
    loft,
    pipe,
    rounded,
    slide,
    tidy,
    turn,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A clamshell in metres, closed."""
    kind = rng.choice(5, p=[0.38, 0.17, 0.15, 0.15, 0.15])
    return (_press, casket, compact, scanner, book)[kind](rng).object()


def _press(rng: np.random.Generator) -> Assembly:
    """A sandwich press or waffle iron. Some turn over in a stand."""
    wide = float(rng.uniform(0.2, 0.4))
    depth = wide * float(rng.uniform(0.65, 1.15))
    outline = outline_of(rng, depth, wide, 0.3)
    flips = rng.random() < 0.15
    unit, half = max(wide, depth) / 100, wide / 2
    low, lid_high = (float(rng.uniform(*span)) * unit for span in ((7, 17), (6, 18)))
    legs = float(rng.uniform(1, 4)) * unit
    if flips:
        low, lid_high, legs = 7 * unit, 7 * unit, half + 6 * unit
    body_tone, trim = draw_finish(rng), materials.hardware(rng)
    lid_tone = body_tone if rng.random() < 0.6 else draw_finish(rng)
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
        body = extrusion(inset(outline, 2.5 * unit), "z", [mid, 0, z], way * plate)
        irons.append(body)
    irons[0] = _ribs(rng, irons[0], mid, depth, half, seam, unit)
    r, wall = float(rng.uniform(1.8, 2.8)) * unit, 1.6 * unit
    at = np.array([depth + 1.25 * r, 0, seam + gap + min(0.5 * lid_high, 4 * unit)])
    hold, lugs = _hinges(rng, at, r, wall, mid, half, seam, legs, unit, flips)
    reach = float(rng.uniform(7, 16)) * unit
    grip_z = seam + gap + 0.5 * min(lid_high, 9 * unit)
    tone = iron if rng.random() < 0.6 else trim
    grip = _grip(rng, mid, half, grip_z, reach, unit, top)
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
        root, spindle, joint = _stand(rng, asm, at, seam, mid, half, unit, trim)
        body.append((spindle - under - hold, trim))
    elif rng.random() < 0.4 and np.ptp(outline[:, 1][outline[:, 0] < -0.49 * depth]) > 0.5 * wide:
        body[0], links = _tray(rng, body[0], wide, depth, legs, low, unit, trim)
    if flips or (not links and rng.random() < 0.55):
        z, w = seam - 3.4 * unit, float(rng.uniform(5, 12)) * unit
        ledge = box([-0.8 * reach, -w, z - 1.6 * unit], [0.4 * mid, w, z + 1.6 * unit])
        body.append((ledge, tone))
    lower = asm.add("body", layered(body), root, joint)
    lid = [(union([over, lugs]), lid_tone), (irons[1], iron), (grip - over - lugs, tone)]
    if rng.random() < 0.4:  # a band or badge on the lid
        size = shrink * float(rng.uniform(0.3, 0.75))
        badge = extrusion(size * outline, "z", [mid, 0, top - 1e-4], 0.5 * unit)
        lid.append((badge - over - grip, draw_finish(rng)))
    most = 92 if flips else float(rng.choice([75, 95, 110, 170], p=[0.25, 0.35, 0.3, 0.1]))
    if most > 120 and 2 * at[2] - top < 0.1 * unit:
        most = 105.0
    cover = asm.add("lid", layered(lid), lower, hinge(at, ACROSS, np.deg2rad(most)))
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


def _ribs(rng, plate: Manifold, mid, depth, half, seam, unit) -> Manifold:
    """A plate with grooves across it, along it or both ways."""
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


def _grip(rng, mid, half, z, reach, unit, top) -> Manifold:
    """A handle on the lid: a tongue or a bar in front, or a loop on top."""
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


def _stand(rng, asm: Assembly, at, seam, mid, half, unit, trim: Material):
    """Add a foot with a post behind, in which the iron turns over about x; returns its spindle."""
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
    """Add a knob in front, or a drip tray that slides out there."""
    solid, tone = body
    solid = solid + box([0, -0.34 * wide, legs], [0.4 * depth, 0.34 * wide, legs + low - 2 * unit])
    if rng.random() < 0.6 or low < 9 * unit:
        r = min(0.36 * low, 4.5 * unit)
        y = float(rng.choice([-0.24, 0, 0.24])) * wide
        at = [-0.3 * unit, y, legs + 0.45 * low]
        knob = cylinder("x", [at[0] - 1.1 * r, y, at[2]], 1.1 * r, 0.8 * r, r, segments=18)
        mark = box([at[0] - 1.5 * r, y - 0.2 * r, at[2]], [at[0] - 1.1 * r, y + 0.2 * r, at[2] + r])
        joint = hinge(at, (1, 0, 0), np.deg2rad(270)) if rng.random() < 0.6 else turn(at, (1, 0, 0))
        shape = Shape().add(knob, trim).add(mark, draw_finish(rng))
        return (solid, tone), [("knob", shape, joint)]
    air, w = 0.3 * unit, float(rng.uniform(0.18, 0.3)) * wide
    lo, hi = [0, -w, legs + 0.8 * unit], [0.7 * depth, w, legs + 4.6 * unit]
    room = box([-1, -w - air, lo[2] - air], [hi[0] + air, w + air, hi[2] + air])
    tray = box(lo, hi) - box([unit, -w + unit, lo[2] + unit], [hi[0] - unit, w - unit, 9])
    tray += box([-2.5 * unit, -w, lo[2]], [0.001, w, hi[2]])
    shape = Shape().add(tidy(tray), trim)
    return (solid - room, tone), [("drip_tray", shape, slide((-1, 0, 0), 0.5 * depth))]

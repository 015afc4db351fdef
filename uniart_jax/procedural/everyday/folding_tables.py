"""Trays, stools and ironing boards on crossed legs; folding tables and benches, in metres."""

from __future__ import annotations

import numpy as np

from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.folding_frames import (
    AIR,
    angle_between,
    bar_frame,
    draw_cover_finish,
    draw_frame_finish,
    frame_shape,
    panel,
)
from uniart_jax.procedural.shapes import (
    PartSpec,
    box,
    cylinder,
    extrusion,
    hinge,
    pipe,
    rounded,
    union,
)


def crossed(rng: np.random.Generator) -> list[PartSpec]:
    """The parts of a tray, stool or ironing board (metres): two frames that cross at a bolt, and a
    top hinged to one."""
    kind = rng.choice(["tray", "stool", "board"], p=[0.4, 0.25, 0.35])
    tone, square = draw_frame_finish(rng)
    cover = draw_cover_finish(rng, tone)
    if kind == "board":
        high, spread, half = rng.uniform(0.7, 0.95), rng.uniform(0.32, 0.5), rng.uniform(0.1, 0.19)
        r, long, wide = rng.uniform(0.011, 0.018), rng.uniform(1.1, 1.45), rng.uniform(0.3, 0.44)
    elif kind == "tray":
        high, spread, half = rng.uniform(0.5, 0.8), rng.uniform(0.17, 0.3), rng.uniform(0.17, 0.32)
        r, long, wide = rng.uniform(0.009, 0.016), 0, 2 * half * rng.uniform(1.0, 1.35)
    else:
        high, spread, half = (
            rng.uniform(0.34, 0.5),
            rng.uniform(0.15, 0.24),
            rng.uniform(0.15, 0.26),
        )
        r, long, wide = rng.uniform(0.011, 0.02), 0, 2 * half * rng.uniform(1.0, 1.2)
    inner = half - 2 * r - AIR
    middle = np.array([0.0, high / 2])
    way = np.array([spread, -high / 2 + r])  # to the foot of the first frame
    d1, d2 = float(rng.uniform(0.7, 0.95)), float(rng.uniform(0.6, 0.9))
    first = bar_frame(
        [middle - way, middle + way], half, r, square, [middle + d1 * way, middle - d1 * way]
    )
    bolts = [
        cylinder("y", [0, s * half - 1.4 * r, high / 2], 2.8 * r, 0.7 * r, segments=12)
        for s in (-1, 1)
    ]
    bolts = [b - box([-9, -half + r, -9], [9, half - r, 9]) for b in bolts]
    parts: list[PartSpec] = [
        ("frame", frame_shape((first, tone), (union(bolts), materials.hardware(rng))), -1, None)
    ]
    other = way * [-1, 1]
    second = bar_frame(
        [middle - other, middle + other],
        inner,
        r,
        square,
        [middle + d2 * other, middle - d2 * other],
    )
    most = angle_between(-other, way)  # down at the side, clear of the top
    most -= np.arcsin(min(0.9, 2.6 * r / (d1 * np.linalg.norm(way)))) + 0.05
    legs = tone if rng.random() < 0.8 else materials.paint(rng)
    parts.append(("legs", frame_shape((second, legs)), 0, hinge((0, 0, high / 2), (0, 1, 0), most)))
    z, thick = high + 0.6 * AIR, float(rng.uniform(0.014, 0.04))
    z = z + 0.5 * r if square else z  # square bars end a little beyond
    if kind == "board":
        x0 = -spread - float(rng.uniform(0.12, 0.3))
        angle = np.linspace(-np.pi / 2, np.pi / 2, 13)
        nose = float(rng.uniform(0.5, 0.9)) * long
        bulge = np.abs(np.sin(angle)) ** float(rng.uniform(0.9, 1.6)) * np.sign(angle)
        tip = np.column_stack([long - nose + nose * np.cos(angle), wide / 2 * bulge])
        plan = np.vstack(
            [tip, [[0.02, wide / 2], [0, wide / 2.4], [0, -wide / 2.4], [0.02, -wide / 2]]]
        )
        pieces = [(extrusion(plan + [x0, 0], "z", [0, 0, z], thick), cover)]
        if rng.random() < 0.5:  # a rest for the iron
            deep = float(rng.uniform(0.15, 0.28))
            rest = union(
                [
                    box([x0 - deep, y, z], [x0 + 0.05, y + 0.012, z + 0.012])
                    for y in np.linspace(-0.4, 0.4, 5) * wide
                ]
                + [box([x0 - deep, -0.45 * wide, z], [x0 - deep + 0.012, 0.45 * wide, z + 0.012])]
            )
            pieces.append((rest, materials.metal(rng, brushed=False)))
        # beyond the bars, so that the end that goes down passes them
        at, angle = -spread - 1.6 * r - AIR, rng.uniform(40, 75)
    else:
        far = spread + float(rng.uniform(0.01, 0.06))
        at = x0 = -spread
        slab = panel(rng, x0, far, wide / 2, z, thick)
        pieces = [(slab, cover)]
        if kind == "tray" and rng.random() < 0.4:
            rim = box([x0, -wide / 2, z + thick], [far, wide / 2, z + thick + 0.03])
            rim -= box([x0 + 0.012, -wide / 2 + 0.012, z], [far - 0.012, wide / 2 - 0.012, z + 1])
            pieces = [
                (
                    panel(rng, x0, far, wide / 2, z, thick, False) ^ box([x0, -1, 0], [far, 1, 9]),
                    cover,
                ),
                (rim, tone),
            ]
        angle = rng.uniform(75, 92)
    joint = hinge((at, 0, z), (0, -1, 0), float(np.deg2rad(angle)))  # up, off the legs
    parts.append(("top", frame_shape(*pieces), 0, joint))
    return parts


def table(rng: np.random.Generator) -> list[PartSpec]:
    """The parts of a folding table or bench (metres): a long top, legs at each end that fold under
    it, and drop leaves."""
    bench = rng.random() < 0.25
    tone, square = draw_frame_finish(rng)
    cover = draw_cover_finish(rng, tone)
    high = float(rng.uniform(0.38, 0.48) if bench else rng.uniform(0.55, 0.76))
    long = float(rng.uniform(0.8, 1.7))
    deep = float(rng.uniform(0.25, 0.36) if bench else rng.uniform(0.4, 0.8))
    thick, r = float(rng.uniform(0.02, 0.045)), float(rng.uniform(0.012, 0.024))
    low, edge = high - thick, float(rng.uniform(0.06, 0.16)) * long / 2
    plan = rounded(deep, long, float(rng.choice([0.004, rng.uniform(0.02, 0.1)])))
    top = extrusion(plan, "z", [0, 0, low], thick)
    leaves = 0 if bench else int(rng.choice([0, 1, 2], p=[0.55, 0.15, 0.3]))
    if leaves:
        top = box([-deep / 2, -long / 2, low], [deep / 2, long / 2, high])
    inset = deep / 2 - float(rng.uniform(0.06, 0.22)) * deep
    inset = min(inset, deep / 2 - 3 * r - 3 * AIR)
    need = 2 * (low - r) > long - 2 * edge
    blocks, legs = [], []
    for k, s in enumerate((-1, 1)):
        y = s * (long / 2 - edge)
        drop = r + AIR + (2.6 * r if need and k else 0.0)
        half = inset - (2.6 * r if k and need else 0.0)
        z = low - drop
        posts = [
            pipe([[x, y, z], [x, y, r]], r, 10)
            if not square
            else box([x - r, y - r, 0], [x + r, y + r, z + r])
            for x in (-half, half)
        ]
        rungs = [float(rng.uniform(0.15, 0.6)) * z, z] if rng.random() < 0.7 else [r, z]
        bars = [
            box([-half, y - 0.7 * r, q - 0.7 * r], [half, y + 0.7 * r, q + 0.7 * r]) for q in rungs
        ]
        legs.append((union(posts + bars), hinge((0, y, z), (-s, 0, 0), np.pi / 2 * 0.97)))
        for x in (-half - 2 * r - AIR, half + r + AIR):  # lugs beside the posts
            blocks.append(box([x, y - r, z - r], [x + r, y + r, low]))
    parts: list[PartSpec] = [
        ("top", frame_shape((top, cover), (union(blocks), materials.hardware(rng))), -1, None)
    ]
    parts += [("legs", frame_shape((solid, tone)), 0, joint) for solid, joint in legs]
    wide = float(rng.uniform(0.3, 0.8)) * deep
    wide = min(wide, 0.75 * high)
    for s in (-1, 1)[:leaves]:
        x = s * (deep / 2 + AIR)
        ends = sorted((x, x + s * thick))
        leaf = box([ends[0], -long / 2, low - wide], [ends[1], long / 2, low])
        parts.append(
            ("leaf", frame_shape((leaf, cover)), 0, hinge((x, 0, low), (0, -s, 0), np.pi / 2))
        )
    return parts

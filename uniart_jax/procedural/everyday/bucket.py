"""Buckets, tubs, baskets, crates, watering cans and cooler boxes, with bail handles that swing,
drop handles at the sides, and lids that lift off or are hinged."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday.bucket_bodies import (
    Pieces,
    Spec,
    add_bail,
    add_drop_handles,
    add_trim,
    all_move,
    assembled,
    bail_options,
    draw_finish,
    draw_lid,
    draw_vessel,
    filled,
    openings,
    with_rim,
)
from uniart_jax.procedural.materials import hsv, plain
from uniart_jax.procedural.shapes import (
    ball,
    box,
    cut,
    cylinder,
    hinge,
    pipe,
    tidy,
    tube,
    turn,
    union,
)

KINDS = ("pail", "tub", "basket", "crate", "can", "cooler")


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A bucket or similar container in metres, its lid on and its handles down or up."""
    kind = str(rng.choice(KINDS, p=[0.26, 0.14, 0.18, 0.12, 0.14, 0.16]))
    make = {"pail": _pail, "tub": _tub, "basket": _basket, "crate": _crate}
    make |= {"can": _can, "cooler": _cooler}
    parts = make[kind](rng)
    while not all_move(parts):
        parts = make[kind](rng)
    free = kind in ("pail", "can", "tub")
    yaw = float(rng.uniform(-90, 90)) if free and rng.random() < 0.6 else 0.0
    if not free and rng.random() < 0.3:
        yaw = float(rng.uniform(-30, 30))
    return assembled(parts, np.deg2rad(yaw))


def _pail(rng) -> list[Spec]:
    """A pail, round, oval or square: a bail, a spout at times, and a lid."""
    height = float(rng.uniform(0.18, 0.42))
    wide = height * float(rng.uniform(0.75, 1.35))
    oval = float(rng.uniform(0.6, 0.85)) if rng.random() < 0.2 else 1.0
    unit = max(height, wide) / 100
    square = rng.random() < 0.2
    flare = float(rng.uniform(0.62, 0.97)) if rng.random() < 0.8 else 1.0
    v = draw_vessel(rng, (wide * oval, wide), height, flare, square, 2 * unit)
    face = draw_finish(rng)
    accent = face if rng.random() < 0.4 else draw_finish(rng)
    body: Pieces = []
    proud = add_trim(rng, body, v, unit, face, accent)
    others = with_rim(v, proud)
    parts: list[Spec] = [("body", body, -1, None)]
    lip = rng.random()
    if lip < 0.45:
        cover = draw_lid(rng, v, unit, face if rng.random() < 0.5 else accent, hinged=lip < 0.08)
        parts.append(cover)
        others = union([others, filled(cover[1])])
    elif lip < 0.6 and not square:  # a spout
        z, r = height, 0.16 * wide
        x = -v.half(0, z)
        beak = Manifold.hull_points(
            [[x - r, 0, z], [0.8 * x, -r, z], [0.8 * x, r, z], [0.9 * x, 0, z - 2 * r]]
        )
        body.append((beak - v.skin - beak.translate((0.3 * r, 0, 0.5 * r)), face))
    body.append((v.hollow(), face))
    z = height - float(rng.uniform(2, 12)) * unit
    length = float(np.hypot(v.half(0, height) + proud, height - z)) + 5 * unit
    length *= float(rng.uniform(1.0, 1.3))
    if lip < 0.6:
        length = max(length, others.bounding_box()[5] - z + 3 * unit)
    standing = 0.25 if len(parts) == 1 else 0.0  # upright, a bail is in the way of the lid
    parts.append(
        add_bail(
            rng,
            body,
            v,
            others,
            (0, z),
            length,
            unit,
            accent,
            upright=standing,
            **bail_options(v, parts),
        )
    )
    return parts


def _tub(rng) -> list[Spec]:
    """A wide tub with drop handles and at times a lid."""
    height = float(rng.uniform(0.2, 0.4))
    wide, deep = height * rng.uniform(1.3, 2.2), height * rng.uniform(1.2, 1.7)
    deep = min(deep, wide)
    unit = wide / 100
    square = rng.random() < 0.35
    v = draw_vessel(rng, (deep, wide), height, float(rng.uniform(0.7, 0.97)), square, 2 * unit)
    face = materials.wood(rng) if rng.random() < 0.3 else draw_finish(rng)
    accent = materials.hardware(rng) if rng.random() < 0.6 else face
    body = [(v.hollow(), face)]
    add_trim(rng, body, v, unit, face, accent)
    parts: list[Spec] = [("body", body, -1, None)]
    z = height * float(rng.uniform(0.7, 0.88))
    parts += add_drop_handles(rng, body, v, z, unit, accent)
    if rng.random() < 0.55:
        cover = face if rng.random() < 0.5 else draw_finish(rng)
        parts.append(draw_lid(rng, v, unit, cover, hinged=square and rng.random() < 0.5))
    return parts


def _basket(rng) -> list[Spec]:
    """A rectangular basket: open, or with a lid or two flaps; one bail or two."""
    wide = float(rng.uniform(0.3, 0.5))
    deep, height = wide * float(rng.uniform(0.55, 0.8)), wide * float(rng.uniform(0.38, 0.62))
    unit = wide / 100
    v = draw_vessel(rng, (deep, wide), height, float(rng.uniform(0.72, 0.96)), True, 2 * unit)
    wicker = plain(np.array([0.62, 0.45, 0.26]) * rng.uniform(0.5, 1.4))
    face = wicker if rng.random() < 0.5 else draw_finish(rng)
    accent = face.darker(0.75) if rng.random() < 0.5 else draw_finish(rng)
    body: Pieces = []
    solid = v.hollow()
    body.append((cut(solid, openings(rng, v)) if rng.random() < 0.75 else solid, face))
    proud = add_trim(rng, body, v, unit, face, accent)
    parts: list[Spec] = [("body", body, -1, None)]
    others = with_rim(v, proud)
    style = rng.choice(["two", "flaps", "lid", "open"], p=[0.3, 0.3, 0.2, 0.2])
    if style == "flaps":
        bar, base = 3.2 * unit, height + 0.3 * unit
        body.append(
            (
                box(
                    [-bar, -v.half(1, height), height - 1e-4],
                    [bar, v.half(1, height), height + 2 * unit],
                )
                ^ v.band(height - 1e-4, height + 2 * unit, 0),
                accent,
            )
        )
        swing = float(np.deg2rad(rng.uniform(60, 88)))
        for side in (-1, 1):
            flap = v.band(base, base + 2 * unit, 0)
            start = side * (bar + 0.3 * unit)
            lo, hi = sorted((start, side * 2.0))
            flap ^= box([lo, -2, 0], [hi, 2, 2])
            joint = hinge((start, 0, base + 2 * unit), (0, -side, 0), swing)
            parts.append(("flap", [(flap, face)], 0, joint))
        others += v.band(height, base + 2 * unit, 0)
    elif style == "lid":
        parts.append(draw_lid(rng, v, unit, face, hinged=rng.random() < 0.8))
        others += filled(parts[-1][1])
    z, across = height - 4 * unit, v.half(0, height) + proud
    length = max(float(np.hypot(across, 4 * unit)) * float(rng.uniform(1.1, 1.5)), 12 * unit)
    length = max(length, others.bounding_box()[5] - z + 3 * unit)
    if style == "two":
        for sense in (-1, 1):
            at = (sense * 4.5 * unit, z)
            parts.append(
                add_bail(
                    rng,
                    body,
                    v,
                    others,
                    at,
                    0.95 * length,
                    unit,
                    accent,
                    power=9.0,
                    sense=sense,
                    both=False,
                    upright=0.0,
                )
            )
    else:
        parts.append(
            add_bail(
                rng,
                body,
                v,
                others,
                (0, z),
                length,
                unit,
                accent,
                upright=0.3 if style == "open" else 0.0,
                **bail_options(v, parts),
            )
        )
    return parts


def _crate(rng) -> list[Spec]:
    """A rectangular crate with drop handles; its walls may have openings, and it may have a lid."""
    wide = float(rng.uniform(0.35, 0.7))
    deep, height = wide * float(rng.uniform(0.5, 0.85)), wide * float(rng.uniform(0.35, 0.65))
    unit = wide / 100
    v = draw_vessel(rng, (deep, wide), height, float(rng.uniform(0.9, 1.0)), True, 2.4 * unit)
    face = materials.wood(rng, grain="y") if rng.random() < 0.5 else draw_finish(rng)
    metal = materials.hardware(rng)
    solid = v.hollow()
    body = [(cut(solid, openings(rng, v)) if rng.random() < 0.7 else solid, face)]
    add_trim(rng, body, v, unit, face, face if rng.random() < 0.5 else metal)
    parts: list[Spec] = [("body", body, -1, None)]
    parts += add_drop_handles(rng, body, v, 0.86 * height, unit, metal)
    if rng.random() < 0.7:
        parts.append(draw_lid(rng, v, unit, face, hinged=rng.random() < 0.8))
    return parts


def _can(rng) -> list[Spec]:
    """A watering can: a spout with a rose that turns, a loop handle behind, and a bail or a lid on
    top."""
    height = float(rng.uniform(0.18, 0.3))
    wide = height * float(rng.uniform(0.7, 1.1))
    unit = height / 70
    long = wide * float(rng.choice([1.0, rng.uniform(1.1, 1.4)]))
    flare = float(rng.uniform(0.75, 1.25))
    v = draw_vessel(rng, (long, wide), height, flare, rng.random() < 0.2, 1.8 * unit)
    face, accent = draw_finish(rng), draw_finish(rng)
    accent = face if rng.random() < 0.4 else accent
    mouth = box([-2, -2, height - 3 * unit], [0.05 * long, 2, 2])
    solid = v.full - v.band(v.wall, height - v.wall, -v.wall)
    opening = v.band(height - 3 * unit, height + 0.01, -2.2 * v.wall) ^ mouth
    r = float(rng.uniform(2.6, 4)) * unit
    start = np.array([-v.half(0, 0.25 * height), 0, float(rng.uniform(0.15, 0.35)) * height])
    reach = np.array([-float(rng.uniform(0.45, 0.9)) * height, 0, 0])
    tip = start + reach + [0, 0, height * float(rng.uniform(0.82, 1.05)) - start[2]]
    spout = pipe([start + [0.2 * long, 0, -0.01], start, tip], r, 12)
    body = [(tidy(solid - opening), face)]
    body.append((tidy(spout - v.skin), face))
    x, z = v.half(0, 0.5 * height), height
    loop = rng.random() < 0.7
    if loop:
        w, g = float(rng.uniform(0.3, 0.55)) * height, float(rng.uniform(1.2, 2)) * unit
        line = [
            [0.8 * x, 0, 0.88 * z],
            [x + 0.8 * w, 0, 0.98 * z],
            [x + w, 0, 0.7 * z],
            [x + 0.7 * w, 0, 0.4 * z],
            [0.8 * x, 0, 0.2 * z],
        ]
        body.append((tidy(pipe(line, g, 8) - v.skin), accent))
    parts: list[Spec] = [("body", body, -1, None)]
    if loop or rng.random() < 0.6:  # the rose
        axis = (tip - start) / np.linalg.norm(tip - start)
        wide_end, deep = float(rng.uniform(1.6, 2.4)) * r, float(rng.uniform(2.2, 3.5)) * r
        rose = cylinder("z", [0, 0, r + 0.4 * unit], deep, 0.9 * r, wide_end, 18)
        tilt = float(np.rad2deg(np.arctan2(-axis[0], axis[2])))
        rose = rose.rotate((0, -tilt, 0)).translate(tuple(tip))
        marks = plain((0.2, 0.2, 0.2)) if rng.random() < 0.5 else accent
        parts.append(("rose", [(rose, marks)], 0, turn(tip, axis)))
    lid = rng.random() < 0.5
    if loop and not lid:  # something besides the rose moves
        lid = rng.random() < 0.5
        bail = not lid
    else:
        bail = not loop
    if lid:
        base = height + 0.3 * unit
        flap = v.band(base, base + 1.6 * unit, -1.2 * v.wall) ^ box(
            [-2, -2, 0], [0.08 * long, 2, 2]
        )
        flap += ball([-0.75 * v.half(0, height), 0, base + 2.2 * unit], 1.8 * unit)
        joint = hinge((0.08 * long, 0, base + 1.6 * unit), (0, 1, 0), 1.3)
        parts.append(("lid", [(flap, accent)], 0, joint))
    if bail:
        others = union([filled(part[1]) for part in parts])
        z = height - 4 * unit
        length = (v.half(0, height)) * float(rng.uniform(1.2, 1.5)) + 4 * unit
        parts.append(
            add_bail(
                rng,
                body,
                v,
                v.full + others,
                (0, z),
                length,
                unit,
                accent,
                sense=1,
                both=False,
                upright=0.6 if len(parts) == 1 or parts[-1][0] == "rose" else 0.0,
            )
        )
    return parts


def _cooler(rng) -> list[Spec]:
    """A cooler box with a hinged lid, and at times a drain plug, a bail and wheels."""
    wide = float(rng.uniform(0.3, 0.62))
    deep, height = wide * float(rng.uniform(0.5, 0.8)), wide * float(rng.uniform(0.5, 0.95))
    unit = max(wide, height) / 100
    v = draw_vessel(rng, (deep, wide), height, float(rng.uniform(0.86, 1.0)), True, 6 * unit)
    face = (
        plain(hsv(rng, (0, 1), (0.3, 0.95), (0.3, 0.9))) if rng.random() < 0.7 else draw_finish(rng)
    )
    cover = materials.white_plastic(rng) if rng.random() < 0.6 else draw_finish(rng)
    body = [(v.hollow(), face)]
    if rng.random() < 0.4:
        z = height * float(rng.uniform(0.3, 0.6))
        body.append((v.band(z, z + 0.15 * height, 0.5 * unit) - v.skin, cover))
    parts: list[Spec] = [("body", body, -1, None)]
    grow = float(rng.uniform(0, 1.5)) * unit
    parts.append(draw_lid(rng, v, unit, cover, hinged=True, grow=grow))
    if rng.random() < 0.3:
        x = -v.half(0, 0.12 * height)
        plug = cylinder(
            "x", [x - 3 * unit, 0.5 * v.half(1, 0), 0.12 * height], 2.6 * unit, 3 * unit
        )
        parts.append(
            (
                "plug",
                [(plug, cover)],
                0,
                turn((x, 0.5 * v.half(1, 0), 0.12 * height), (-1, 0, 0)),
            )
        )
    others = v.full + filled(parts[1][1])
    if rng.random() < 0.75:
        z = height * float(rng.uniform(0.72, 0.92))
        top = others.bounding_box()[5] - z
        length = float(np.hypot(v.half(0, height) + grow + 3 * unit, top)) + 3 * unit
        parts.append(
            add_bail(
                rng,
                body,
                v,
                others,
                (0, z),
                length,
                unit,
                cover,
                both=False,
                upright=0.0,
                **bail_options(v, parts),
            )
        )
    else:
        parts += add_drop_handles(rng, body, v, 0.8 * height, unit, cover)
    if rng.random() < 0.3 and wide > 0.45:  # wheels at the right
        r = 5 * unit
        wheels = [
            tube("y", [x, v.half(1, 0) + 0.3 * unit, r], 3 * unit, r, 1.2 * unit)
            for x in (-0.6 * v.half(0, 0), 0.6 * v.half(0, 0))
        ]
        axles = [
            cylinder("y", [x, 0.8 * v.half(1, 0), r], 0.2 * v.half(1, 0) + 3 * unit, 1.1 * unit)
            - v.skin
            for x in (-0.6 * v.half(0, 0), 0.6 * v.half(0, 0))
        ]
        if v.half(1, 2 * r) - v.half(1, 0) < 0.25 * unit:
            body.append((union(axles), materials.metal(rng, brushed=False)))
            for w, x in zip(wheels, (-0.6 * v.half(0, 0), 0.6 * v.half(0, 0)), strict=True):
                joint = turn((x, 0, r), (0, 1, 0))
                parts.append(("wheel", [(w, materials.dark(rng))], 0, joint))
    return parts

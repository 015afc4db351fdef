"""Kettles and teapots: a body with a spout and a handle, and a lid that is hinged, lifts or turns.
Electric ones have a switch and a base plate, others a bail or a whistle."""

from __future__ import annotations

import dataclasses

import numpy as np
import trimesh
from manifold3d import Manifold

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.everyday import vessel_fittings, vessels
from uniart_jax.procedural.everyday.vessel_finishes import contrast, draw_kettle_finish
from uniart_jax.procedural.everyday.vessel_fittings import bar_hinge, bezier, dome, spout, taper
from uniart_jax.procedural.everyday.vessels import (
    frustum,
    half_width,
    radius_at,
    silhouette,
    stack,
    widest,
)
from uniart_jax.procedural.fronts import add_knob
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
    slide,
    tidy,
    turn,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A kettle in metres, closed; its spout towards -x or turned away from it."""
    obj = _electric(rng) if rng.random() < 0.5 else _stovetop(rng)
    yaw = float(rng.choice([0.0, 90.0, -90.0, rng.uniform(-180, 180)], p=[0.4, 0.2, 0.2, 0.2]))
    return vessels.turned(obj, yaw)


def _outline(rng: np.random.Generator) -> np.ndarray:
    """An outline: mostly round, else with six to twelve flats, or squared."""
    kind = rng.choice(3, p=[0.7, 0.2, 0.1])
    if kind == 1:
        return vessels.ring(int(rng.choice([6, 8, 10, 12])))
    power = 2.0 if kind == 0 else float(rng.uniform(3, 5))
    return vessels.ring(32, 1.0 if kind == 0 else float(rng.uniform(0.8, 1.0)), power)


def _electric(rng: np.random.Generator) -> ArticulatedObject:
    """A jug with a handle behind, a lid hinged above it, a switch and mostly a base plate."""
    height = float(rng.uniform(0.16, 0.27))
    bottom = height * float(rng.uniform(0.3, 0.5))
    unit = height / 100
    air, wall = 0.5 * unit, 2.2 * unit
    face, trim = draw_kettle_finish(rng), materials.dark(rng)
    if rng.random() < 0.45:
        trim = materials.white_plastic(rng) if rng.random() < 0.4 else draw_kettle_finish(rng)
    outline = _outline(rng)
    stands = rng.random() < 0.75
    base = float(rng.uniform(5, 12)) * unit if stands else 0.0
    low = base + air if stands else 0.0
    high = low + height
    top = bottom * float(rng.uniform(0.6, 1.0))
    belly = bottom * float(rng.choice([1.0, rng.uniform(1.0, 1.2)]))
    curved, fillet = rng.random() < 0.6, float(rng.choice([0.0, rng.uniform(2, 12)])) * unit
    middle = float(rng.uniform(0.1, 0.6))
    profile = silhouette(bottom, belly, top, middle, low, high, fillet, curved)
    solid = stack(profile, outline)

    asm, body = Assembly(), Shape()
    long_nose = rng.random() < 0.3
    nose = _swan_neck(rng, profile, height) if long_nose else _beak(rng, profile, height, wall)
    body.add(tidy((solid + nose) - vessels.room(profile, outline, wall)), face)
    grip = _ear(rng, profile, 0.88 if long_nose else float(rng.uniform(0.78, 0.93)), height)
    key, pivot = 0.0, np.array([top + 2.5 * unit, 0, high + air])
    if rng.random() < 0.5:  # the handle begins as a block with a key that opens the lid
        key = top + 5.5 * unit
        crest, back = high - 0.5 * unit, top + 21 * unit
        side = [[crest, 0], [crest, back], [high - 8 * unit, back], [high - 14 * unit, 0]]
        block = extrusion(np.array(side), "y", [0, -6.5 * unit, 0], 13 * unit)
        well = [key, -5 * unit, high - 4.5 * unit], [key + 12 * unit, 5 * unit, 2 * high]
        grip = (grip + block) - box(*well)
    grip -= cylinder("y", pivot - [0, 1, 0], 2, 2.2 * unit)
    body.add(tidy(grip - solid - nose), trim)
    if rng.random() < 0.4:  # a window of the water's level or a band round the body
        body.add(_patch(rng, profile, outline, unit) - solid - grip - nose, materials.glass(rng))
    carrier, joint = -1, None
    if stands:
        manner = str(rng.choice(["one", "turns", "lifts"], p=[0.3, 0.3, 0.4]))
        foot = frustum(outline, 1.12 * bottom, 1.06 * bottom, 0, base)
        if manner == "one":
            body.add(frustum(outline, 0.98 * bottom, 0.98 * bottom, 0, low), trim)
        else:
            carrier = _base(rng, asm, foot, bottom, base, unit, trim)
            joint = slide((0, 0, 1), float(rng.uniform(0.3, 0.7)) * height)
            joint = turn((0, 0, base), (0, 0, 1)) if manner == "turns" else joint
    root = asm.add("body", body, carrier, joint)

    lid = _flat_lid(rng, outline, top, wall, high + air, unit, face, trim, key > 0)
    if key or rng.random() < 0.75:
        swing = float(np.deg2rad(rng.uniform(55, 88)))
        barrel = bar_hinge(pivot, pivot[0] - 6 * unit, 5 * unit, unit)
        lid.add(tidy(barrel - lid.solid()), dataclasses.replace(trim))
        asm.add("lid", lid, root, hinge(pivot, (0, 1, 0), swing))
    else:
        asm.add("lid", lid, root, slide((0, 0, 1), float(rng.uniform(0.25, 0.6)) * height))
    if key:
        lo = [key + 0.4 * unit, -4.6 * unit, high - 2.2 * unit]
        hi = [key + 11.6 * unit, 4.6 * unit, high + float(rng.uniform(1.5, 3.5)) * unit]
        tone = face if rng.random() < 0.5 else plain(materials.hsv(rng, (0, 1), (0, 1), (0.3, 0.9)))
        asm.add("button", Shape().add(box(lo, hi), tone), root, slide((0, 0, -1), 2 * unit))
    if rng.random() < 0.85:
        _switch(rng, asm, root, profile, unit, face if rng.random() < 0.4 else trim)
    return asm.object()


def _beak(rng, profile, height: float, wall: float) -> Manifold:
    """A lip at the upper front: a wedge, open above."""
    high, top = profile[-1, 1], profile[-1, 0]
    reach, wide = float(rng.uniform(0.12, 0.27)) * height, float(rng.uniform(0.45, 0.9)) * top
    z = high - float(rng.uniform(0.15, 0.5)) * height
    tip = -top - reach
    corners = [[-0.6 * top, -wide, high], [-0.6 * top, wide, high], [tip, 0, high - 0.02 * height],
               [tip, -0.15 * wide, high], [tip, 0.15 * wide, high],
               [-radius_at(profile, z) + wall / 2, 0, z], [0, 0, z], [0, 0, high]]  # fmt: skip
    wedge = hull(np.array(corners))
    return wedge - wedge.translate((2.2 * wall, 0, 1.2 * wall)).scale((1, 0.8, 1))


def _swan_neck(rng, profile, height: float) -> Manifold:
    """A thin spout that leaves the body low and bends twice."""
    low = profile[0, 1]
    z = low + float(rng.uniform(0.12, 0.3)) * height
    start = radius_at(profile, z) - 0.07 * height
    reach, up = float(rng.uniform(0.45, 0.7)) * height, float(rng.uniform(0.8, 1.05)) * height
    x = -radius_at(profile, z) - reach
    line = [[-start, 0, z], [x + 0.1 * height, 0, z], [x + 0.42 * height, 0, low + up],
            [x + 0.1 * height, 0, low + up], [x, 0, low + up - 0.03 * height]]  # fmt: skip
    tube = spout(bezier(line, 11), 0.06 * height, float(rng.uniform(0.028, 0.04)) * height)
    return tube[0]


def _ear(rng, profile, share: float, height: float) -> Manifold:
    """A handle behind the body: a loop, a corner or a hook that hangs from its upper end."""
    low = profile[0, 1]
    upper = low + share * height
    a, b = upper, low + height * float(rng.uniform(0.26, 0.42))
    xa, xb = radius_at(profile, a) - 0.05 * height, radius_at(profile, b) - 0.05 * height
    out = max(xa, xb) + height * float(rng.uniform(0.28, 0.45))
    kind = str(rng.choice(["loop", "corner", "hook"], p=[0.45, 0.3, 0.25]))
    if kind == "loop":
        line = bezier(
            [[xa, 0, a], [out * 1.25, 0, a + 0.1 * height], [out * 1.2, 0, b], [xb, 0, b]]
        )
    elif kind == "corner":
        line = np.array([[xa, 0, a], [out, 0, a], [out - 0.05 * height, 0, b], [xb, 0, b]])
    else:
        line = bezier([[xa, 0, a], [out * 1.3, 0, a + 0.05 * height], [out, 0, b]])
    first, last = np.sort(rng.uniform(0.035, 0.065, 2))[::-1] * height
    return taper(line, first, last, float(rng.uniform(0.9, 1.5)))


def _patch(rng, profile, outline, unit: float) -> Manifold:
    """A shell a little proud of the body: a strip at one side, or a band all round."""
    z0, z1 = profile[0, 1], profile[-1, 1]
    skin = stack(profile * [1 + 0.9 * unit / profile[:, 0].min(), 1], outline)
    if rng.random() < 0.55:
        side, wide = float(rng.choice([-1, 1])), float(rng.uniform(4, 9)) * unit
        lo, hi = sorted((0.0, side * 2.0))
        low, high = z0 + (z1 - z0) * rng.uniform(0.15, 0.3), z1 - (z1 - z0) * rng.uniform(0.1, 0.35)
        return skin ^ box([-wide, lo, low], [wide, hi, high])
    at = z0 + (z1 - z0) * float(rng.uniform(0.25, 0.8))
    return skin ^ box([-1, -1, at], [1, 1, at + float(rng.uniform(5, 18)) * unit])


def _base(rng, asm: Assembly, foot: Manifold, radius, base, unit, trim: Material) -> int:
    """Add the base plate; some have a panel in front with a dial on it."""
    shape = Shape()
    if rng.random() < 0.6 or base < 8 * unit:
        return asm.add("base", shape.add(foot, trim))
    reach, half = radius * float(rng.uniform(1.25, 1.6)), radius * float(rng.uniform(0.6, 1.05))
    shape.add(foot + box([-reach, -half, 0], [0, half, base]), trim)
    root = asm.add("base", shape)
    r = 0.46 * base
    mark = contrast(trim)
    sweep = None if rng.random() < 0.5 else float(np.deg2rad(rng.choice([180, 270])))
    tone = materials.hardware(rng)
    add_knob(asm, root, (-reach, 0, base / 2), r, 0.9 * r, tone, mark, sweep)
    return root


def _flat_lid(rng, outline, top, wall, low, unit, face, trim, latched: bool) -> Shape:
    """A low lid with a plug below. Unless a key opens it (``latched``), it has a tab or a knob."""
    tone = face if rng.random() < 0.5 else trim
    rise = float(rng.uniform(3, 14)) * unit
    lid = dome(outline, top, low, rise, min(2 * unit, 0.6 * rise))
    if rng.random() < 0.3:
        lid = frustum(outline, top, 0.93 * top, low, low + 0.6 * rise)
        rise *= 0.6
    inner = 0.95 * (top - wall)
    lid += frustum(outline, 0.95 * inner, inner, low - 3 * unit, low + unit)
    shape = Shape().add(tidy(lid), tone)
    if latched and rng.random() < 0.6:
        return shape
    at = [0, 0, low + 0.97 * rise]
    if rng.random() < 0.5:
        grip = vessel_fittings.knob(rng, [0, 0, low + 0.9 * rise], float(rng.uniform(4, 7)) * unit)
    else:
        w = float(rng.uniform(3, 6)) * unit
        grip = hull(np.array([[x * w, y * w, at[2] + z * unit] for x, y, z in (
            (-2, -1, -4), (2, -1, -4), (-2, 1, -4), (2, 1, -4), (-1.6, -0.6, 7), (1, -0.6, 5),
            (-1.6, 0.6, 7), (1, 0.6, 5))]))  # fmt: skip
    return shape.add(tidy(grip - lid), trim if tone is face else face)


def _switch(rng, asm: Assembly, root: int, profile, unit: float, tone: Material) -> None:
    """Add a paddle, low at the back or at a side, that is pressed down about its hinge."""
    z = profile[0, 1] + float(rng.uniform(6, 9)) * unit
    thick, half = float(rng.uniform(3.2, 4.2)) * unit, float(rng.uniform(3, 6)) * unit
    long = float(rng.uniform(9, 15)) * unit
    x = widest(profile, (z - thick / 2, z + thick / 2))
    at = [x + 0.35 * thick + 0.4 * unit, 0, z]
    paddle = box([at[0], -half, z - 0.35 * thick], [at[0] + long, half, z + 0.35 * thick])
    paddle += cylinder("y", [at[0], -half, z], 2 * half, 0.35 * thick, segments=12)
    end = at[0] + 0.85 * long
    paddle += cylinder("y", [end, -half, z + 0.2 * thick], 2 * half, 0.6 * thick, segments=12)
    tone = tone if rng.random() < 0.5 else plain(materials.hsv(rng, (0, 1), (0.6, 1), (0.4, 0.9)))
    angle = float(np.deg2rad(rng.uniform(14, 26)))
    low_enough = profile[0, 1] > 0 or long * np.sin(angle) < z - thick
    if low_enough:
        asm.add("switch", Shape().add(tidy(paddle), tone), root, hinge(at, (0, 1, 0), angle))


def _stovetop(rng: np.random.Generator) -> ArticulatedObject:
    """A stovetop kettle or teapot: a squat body, a short spout, a handle over or behind it, a lid
    that lifts, turns or is hinged, and a whistle at times."""
    height = float(rng.uniform(0.09, 0.17))
    bottom = height * float(rng.uniform(0.45, 0.8))
    unit = height / 70
    air, wall = 0.5 * unit, 2.0 * unit
    face, trim = draw_kettle_finish(rng), materials.hardware(rng)
    if rng.random() < 0.4:
        trim = (
            dataclasses.replace(face) if rng.random() < 0.6 else materials.wood(rng, textured=False)
        )
    outline = _outline(rng)
    belly = bottom * float(rng.uniform(1.0, 1.35))
    top = belly * float(rng.uniform(0.42, 0.75))
    middle = float(rng.uniform(0.08, 0.5))
    fillet = float(rng.choice([0.0, rng.uniform(3, 12)])) * unit
    straight = rng.random() < 0.25
    profile = silhouette(bottom, belly, top, middle, 0.0, height, fillet, not straight)
    solid = stack(profile, outline)

    asm, body = Assembly(), Shape()
    z = float(rng.uniform(0.25, 0.6)) * height
    x, reach = radius_at(profile, z), float(rng.uniform(0.35, 0.75)) * height + 6 * unit
    rise = height * float(rng.uniform(0.8, 1.15))
    x_end = -x - reach
    line = [[-x + 0.09 * height, 0, z], [-x - 0.6 * reach, 0, z + 0.1 * height],
            [-x - 0.6 * reach, 0, rise - 0.1 * height], [x_end, 0, rise]]  # fmt: skip
    thick, thin = float(rng.uniform(0.1, 0.17)) * height, float(rng.uniform(0.055, 0.085)) * height
    nose, way = spout(bezier(line, 8), thick, thin)
    body.add(tidy((solid + nose) - vessels.room(profile, outline, wall)), face)
    manner = str(rng.choice(["ear", "arch", "bail", "crane"], p=[0.3, 0.25, 0.27, 0.18]))
    head = height * float(rng.uniform(1.8, 2.15))  # the handle's highest
    lifts = 0.55 * height
    r = float(rng.uniform(0.035, 0.06)) * height + unit
    if manner == "ear":
        grip = _ear(rng, profile, 0.8, height)
    elif manner == "arch":  # from front to back over the lid
        z0 = 0.75 * height
        foot = max(radius_at(profile, z0) - 2 * unit, 1.06 * top + r + unit)
        arc = vessel_fittings.bow(foot, head - z0, float(rng.uniform(0.5, 0.8)))
        arc = arc + [0, 0, z0]
        grip = taper(arc, r, r, float(rng.uniform(1, 1.7)))
        grip += cylinder("x", [-foot, 0, z0], 2 * foot, 1.13 * r, segments=14)
        inside = (np.abs(arc[:, 0]) < 1.05 * top + r) & (arc[:, 2] > z0)
        lifts = float(arc[inside, 2].min()) - height - r - 4 * unit
    elif manner == "crane":  # from the back only, reaching forward
        foot = radius_at(profile, 0.7 * height) - 3 * unit
        arc = bezier([[foot, 0, 0.7 * height], [foot * 1.9, 0, head * 1.15], [0.2 * foot, 0, head],
                      [-0.7 * foot, 0, head * 0.97]])  # fmt: skip
        grip = taper(arc, r, 1.3 * r, float(rng.uniform(1, 1.6)))
        lifts = 0.0
    else:
        grip = None
    if grip is not None:
        body.add(tidy(grip - solid - nose), trim)
    pivot = None
    if manner == "bail":
        pivot = _lugs(body, profile, outline, middle * height, r, unit, air, solid, trim)
    root = asm.add("body", body)
    size = float(rng.uniform(0.05, 0.09)) * height
    tone = face if rng.random() < 0.75 else trim
    rim, vault = 1.5 * unit, float(rng.uniform(0.06, 0.25)) * height
    low = height + air
    cover = dome(outline, top * float(rng.uniform(0.95, 1.04)), low, vault, rim)
    inner = 0.93 * (top - wall)
    cover += frustum(outline, inner * 0.97, inner, low - 2.5 * unit, low + unit)
    bud = vessel_fittings.knob(rng, [0, 0, low + 0.93 * vault], size)
    crown = float(bud.bounding_box()[5])
    lid = Shape().add(tidy(cover), tone).add(tidy(bud - cover), face if tone is trim else trim)
    open_way = str(rng.choice(["lift", "hinge", "turn"], p=[0.5, 0.3, 0.2]))
    if manner in ("arch", "crane"):  # the room below the handle
        roof = head - (2.4 * r if manner == "crane" else r + unit) - crown
        lifts = min(roof, lifts if manner == "arch" else roof) - unit
        open_way = "lift" if lifts > 6 * unit else "turn"
    folded = pivot is not None and open_way != "turn"
    if outline.shape != vessels.ring(32).shape or np.ptp(outline.max(0)) > 0.01:
        open_way = "lift" if open_way == "turn" else open_way  # only round ones turn
    if open_way == "lift":
        lifts = min(lifts, float(rng.uniform(0.4, 0.9)) * height)
        asm.add("lid", lid, root, slide((0, 0, 1), lifts))
    elif open_way == "hinge":
        asm.add("lid", lid, root, hinge((top, 0, low), (0, 1, 0), float(rng.uniform(0.9, 1.5))))
    else:
        asm.add("lid", lid, root, turn((0, 0, low), (0, 0, 1)))
    if pivot is not None:
        _bail(rng, asm, root, pivot, folded, crown, r, unit, trim)
    if rng.random() < 0.35:
        _whistle(rng, asm, root, line[-1], way, thin, unit, trim)
    return asm.object()


def _lugs(body: Shape, profile, outline, z: float, r, unit, air, solid, trim) -> np.ndarray:
    """Add ears at both sides that carry a bail; returns the pivot of its right end."""
    z = max(z, 0.55 * profile[-1, 1])
    across = radius_at(profile, z) * half_width(outline)
    y = across + 1.5 * unit
    for side in (-1, 1):
        ear = cylinder("y", [0, min(side * y, 0), z], y, 1.5 * r, segments=16)
        body.add(ear - solid, trim)
    return np.array([0, y + air + 1.5 * r, z])


def _bail(rng, asm, root, pivot, folded: bool, crown, r, unit, trim) -> None:
    """Add a bail over the lid that folds to the back."""
    _, y, z = pivot
    peak = max(crown + 4 * unit - z + 2 * r, 1.6 * y)
    line = vessel_fittings.bow(y, peak, float(rng.uniform(0.55, 1.0)))[:, [1, 0, 2]] + [0, 0, z]
    bow = taper(line, r, r)
    pads = [ball(line[k], 1.5 * r, 14) for k in (0, -1)]
    shape = Shape()
    if rng.random() < 0.5:  # a thicker part in the hand
        hold = tidy(taper(line[5:10], 1.6 * r, 1.6 * r))
        same = dataclasses.replace(trim)
        shape.add(hold, materials.wood(rng, textured=False) if rng.random() < 0.5 else same)
        bow -= hold
    shape.add(tidy(union([bow, *[p ^ box([-1, -9, 0], [1, 9, 9]) for p in pads]])), trim)
    way, most = 1, float(rng.uniform(0.7, 1.25))
    if folded:  # it lies behind at rest and is raised
        lean = trimesh.transformations.rotation_matrix(most, (0, 1, 0), (0, 0, z))
        shape, way = shape.moved(lean), -1
    asm.add("handle", shape, root, hinge((0, 0, z), (0, 1, 0), way * most))


def _whistle(rng, asm, root, tip, way, thin: float, unit: float, trim: Material) -> None:
    """Add a cap on the spout's mouth, hinged above it."""
    wide, long = 1.25 * thin, float(rng.uniform(0.9, 1.8)) * thin
    lean = float(np.rad2deg(np.arctan2(way[0], way[2])))
    up = np.array([way[2], 0, -way[0]])
    cap = cylinder("z", [0, 0, 0.5 * unit], long, wide, 0.85 * wide, 16)
    cap += ball([0, 0, 0.5 * unit + long], 0.6 * wide, 12)
    cap = cap.rotate((0, lean, 0)).translate(tuple(tip))
    at = np.asarray(tip) + up * 1.2 * wide + way * 0.2 * wide
    knuckle = cylinder("y", at - [0, 0.6 * wide, 0], 1.2 * wide, 0.35 * wide, segments=12)
    rim = tip + way * (0.6 * unit + 0.2 * wide) + up * 0.7 * wide
    knuckle = hull(np.vstack([knuckle.to_mesh().vert_properties[:, :3], rim]))
    shape = Shape().add(tidy(cap + knuckle.trim_by_plane(tuple(way), way @ tip + 0.5 * unit)), trim)
    asm.add("whistle", shape, root, hinge(at, (0, 1, 0), rng.uniform(1.0, 1.7)))

"""Office chairs and stools: a star base, a column that lifts (gas spring) or winds (spindle), a
seat that turns."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cylinder,
    extrusion,
    hinge,
    hull,
    loft,
    pipe,
    rounded,
    screw,
    slide,
    tube,
    turn,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A swivel chair, metres, lowered."""
    stool = rng.random() < 0.3
    spindle = rng.random() < (0.7 if stool else 0.1)  # a threaded column instead of a gas spring
    seat_z = float(rng.uniform(0.4, 0.5)) + (0.08 if stool else 0.0)
    width, depth = float(rng.uniform(0.44, 0.54)), float(rng.uniform(0.42, 0.5))
    if stool:
        width = depth = float(rng.uniform(0.34, 0.42))
    frame = materials.metal(rng, brushed=False) if rng.random() < 0.45 else materials.dark(rng)
    legs_wood = stool and rng.random() < 0.5
    if legs_wood:
        frame = materials.wood(rng)
    fabric = _fabric(rng)
    steel = materials.metal(rng, brushed=False)

    thick = float(rng.uniform(0.05, 0.09))
    seat_z = max(seat_z, thick + 0.36)
    plate = seat_z - thick - 0.06  # underside of the mechanism

    asm = Assembly()
    sleeve_z, sleeve = _base(rng, asm, frame, plate - 0.04, legs_wood)
    root = 0
    travel = float(rng.uniform(0.08, 0.13))
    rod = sleeve - 0.009
    column = Shape()
    low = max(0.09, sleeve_z - 0.15)
    column.add(cylinder("z", [0, 0, low], plate - low - 0.002, rod, segments=18), steel)
    if spindle:
        turns = float(rng.uniform(2, 5))
        joint = screw((0, 0, low), (0, 0, 1), turns, travel, left_handed=bool(rng.random() < 0.4))
        cross = box([-0.09, -0.022, plate - 0.028], [0.09, 0.022, plate - 0.002])
        cross += box([-0.022, -0.09, plate - 0.028], [0.022, 0.09, plate - 0.002])
        ring = cylinder("z", [0, 0, low], plate - low - 0.002, rod, segments=18)
        column.add(cross - ring, frame.darker(0.8))
    else:
        joint = slide((0, 0, 1), travel)
    post = asm.add("column", column, root, joint)

    seat = Shape()
    mount = box([-0.12, -0.1, plate], [0.13, 0.1, seat_z - thick])
    seat.add(mount, frame.darker(0.7))
    _cushion(rng, seat, depth, width, seat_z - thick, thick, fabric, stool)
    arms = not stool and rng.random() < 0.6
    if arms:
        _arms(rng, seat, width, depth, seat_z, thick, frame)
    turning = turn((0, 0, plate), (0, 0, 1))
    top = asm.add("seat", seat, post, None if spindle else turning)
    if not stool or rng.random() < 0.25:
        _back(rng, asm, top, depth, width, seat_z, thick, frame, fabric, stool)
    return asm.object()


def _fabric(rng: np.random.Generator) -> Material:
    """Cloth or leather."""
    kind = rng.choice(3, p=[0.4, 0.35, 0.25])
    if kind == 0:
        return materials.dark(rng)
    return materials.paint(rng) if kind == 1 else plain(rng.uniform([0.1] * 3, [0.8, 0.5, 0.6]))


def _base(rng, asm: Assembly, frame: Material, top: float, wooden: bool) -> tuple[float, float]:
    """The star of legs with its sleeve, and its castors; returns the sleeve's top and its inner
    radius; it ends below ``top``."""
    legs = 4 if rng.random() < 0.2 else 5
    reach = float(rng.uniform(0.27, 0.34))
    inner, outer = 0.03, 0.043
    sleeve_z = min(float(rng.uniform(0.24, 0.28)), top)
    casters = not wooden and rng.random() < 0.75
    own = casters and rng.random() < 0.45  # castors that swivel by themselves
    floor = 0.07 if casters else 0.0
    hub_z = floor + (0.02 if casters else 0.05)
    solids = [tube("z", [0, 0, hub_z], sleeve_z - hub_z, outer, inner)]
    phase = float(rng.uniform(0, 2 * np.pi / legs))
    bore = cylinder("z", [0, 0, -1], 3, inner, segments=24)
    ends = []
    for k in range(legs):
        a = phase + 2 * np.pi * k / legs
        way, side = np.array([np.cos(a), np.sin(a), 0]), np.array([-np.sin(a), np.cos(a), 0])
        inner_z = (hub_z + 0.01, sleeve_z - 0.02) if wooden else (hub_z + 0.005, hub_z + 0.055)
        outer_z = (0.0, 0.05) if not casters else (floor + 0.004, floor + 0.032)
        corners = [
            d * way + s * w * side + [0, 0, z]
            for d, w, zs in ((0.03, 0.03, inner_z), (reach, 0.019, outer_z))
            for s in (-1, 1)
            for z in zs
        ]
        if wooden:  # splayed: the leg leaves the hub high and stands on the floor
            corners = [
                d * way + s * 0.02 * side + [0, 0, z]
                for d, zs in ((0.03, (sleeve_z - 0.07, sleeve_z - 0.01)), (reach, (0.05, 0.0)), (reach - 0.045, (0.05, 0.0)))  # noqa: E501
                for s in (-1, 1)
                for z in zs
            ]  # fmt: skip
        solids.append(hull(np.array(corners)) - bore)
        ends.append((reach - 0.02) * way)
    shape = Shape().add(union(solids), frame)
    rubber = materials.dark(rng)
    twist = rng.uniform(0, 2 * np.pi, legs)
    pairs = [_castor(at, float(t)) for at, t in zip(ends, twist, strict=True)] if casters else []
    if pairs and not own:
        for at in ends:
            shape.add(cylinder("z", [at[0], at[1], 0.055], floor - 0.051, 0.01, segments=10), frame)
        cutters = [cylinder("z", [at[0], at[1], 0.055], 0.05, 0.01, segments=10) for at in ends]
        for castor, peg in zip(pairs, cutters, strict=True):
            shape.add(castor - peg, rubber)
    root = asm.add("base", shape)
    if own:
        for at, castor in zip(ends, pairs, strict=True):
            head = cylinder("z", [at[0], at[1], 0.045], floor + 0.0025 - 0.045, 0.012, segments=12)
            joint = turn((at[0], at[1], 0), (0, 0, 1))
            asm.add("castor", Shape().add(union([castor, head]), rubber), root, joint)
    return sleeve_z, inner


def _castor(at: np.ndarray, twist: float):
    """Two small wheels side by side under a hood, trailing behind the pin at ``at``."""
    wheels = [cylinder("y", [0.018, y, 0.028], 0.019, 0.028, segments=18) for y in (-0.024, 0.005)]
    hood = box([-0.012, -0.01, 0.02], [0.02, 0.01, 0.058])
    return union([*wheels, hood]).rotate((0, 0, np.rad2deg(twist))).translate((at[0], at[1], 0))


def _cushion(rng, seat: Shape, depth, width, z, thick, fabric: Material, stool: bool) -> None:
    corner = 0.499 * width if stool and rng.random() < 0.8 else float(rng.uniform(0.05, 0.14))
    outline = rounded(depth, width, corner, 8)
    if not stool and rng.random() < 0.5:  # a shell under the cushion
        seat.add(loft(outline * 0.85, outline, z, z + 0.25 * thick), materials.dark(rng))
        z, thick = z + 0.25 * thick, 0.75 * thick
    solid = loft(outline * 0.97, outline, z, z + 0.35 * thick)
    solid += loft(outline, outline, z + 0.34 * thick, z + 0.66 * thick)
    solid += loft(outline, outline * 0.93, z + 0.65 * thick, z + thick)
    seat.add(solid, fabric)


def _arms(rng, seat: Shape, width, depth, seat_z, thick, frame: Material) -> None:
    """Armrests on posts from under the seat, or loops of a bar."""
    rise = float(rng.uniform(0.17, 0.24))
    loop = rng.random() < 0.5
    pad = materials.dark(rng)
    y, z, r = width / 2 + 0.035, seat_z + rise, 0.015
    front, rear = -0.32 * depth, 0.22 * depth
    for s in (-1, 1):
        root = [0.0, s * 0.105, seat_z - thick - 0.03]
        out = [0.0, s * y, seat_z - thick - 0.03]
        if loop:
            bar = pipe(
                [
                    root,
                    out,
                    [front, s * y, seat_z - 0.02],
                    [front, s * y, z],
                    [rear, s * y, z],
                    [rear, s * y, seat_z - 0.02],
                    out,
                ],
                r,
            )
        else:
            bar = pipe([root, out, [0.0, s * y, z - 0.004]], r + 0.004)
        keep = box([-1, 0.1, 0], [1, 1, 2]) if s > 0 else box([-1, -1, 0], [1, -0.1, 2])
        top = extrusion(
            rounded(rear - front + 0.06, 0.07, 0.03),
            "z",
            [(front + rear) / 2, s * y, z + 0.005],
            0.028,
        )
        seat.add((bar ^ keep) - top, frame)
        seat.add(top, pad)


def _back(rng, asm: Assembly, seat: int, depth, width, seat_z, thick, frame, fabric, stool) -> None:
    """The backrest on its bracket: a part that reclines, or one that is fixed."""
    tall = float(rng.uniform(0.18, 0.26)) if stool else float(rng.uniform(0.36, 0.62))
    gap = 0.06 if stool else float(rng.uniform(0.06, 0.14))
    wide, deep = width * float(rng.uniform(0.72, 0.95)), float(rng.uniform(0.05, 0.08))
    x, lean = depth / 2 + 0.02, float(rng.uniform(0.02, 0.09))
    shape = Shape()
    low = seat_z + gap
    outline = rounded(tall, wide, float(rng.uniform(0.04, 0.12)), 7)  # (z, y)
    share = (outline[:, 0] / tall + 0.5)[:, None]
    corners = np.column_stack([x + lean * share, outline[:, 1], low + tall * share])
    # a bowed slab: thicker behind, its front face narrower
    rings = [corners * [1, 0.94, 1], corners, corners * [1, 0.9, 1]]
    pillow = hull(
        np.vstack(
            [r + np.array([x, 0, 0]) for r, x in zip(rings, (0, 0.4 * deep, deep), strict=True)]
        )
    )
    if rng.random() < 0.3:  # a net in a frame
        share = 0.5 + 0.84 * (share[:, 0] - 0.5)
        small = np.column_stack([0 * share, 0.84 * outline[:, 1], low + tall * share])
        hole = hull(np.vstack([small, small + np.array([1.0, 0, 0])]))
        shape.add(pillow - hole, frame)
        sheet = np.vstack([corners + np.array([d * deep, 0, 0]) for d in (0.35, 0.7)])
        shape.add(hull(sheet) ^ hole ^ pillow, fabric)
    else:
        shape.add(pillow, fabric)
    pivot_z = seat_z - thick - 0.035
    bar = pipe(
        [[0.16, 0, pivot_z], [x + deep + 0.01, 0, pivot_z], [x + lean * 0.4 + deep + 0.005, 0, low + 0.45 * tall]], 0.018, 14  # noqa: E501
    )  # fmt: skip
    bar += pipe([[0.16, -0.05, pivot_z], [0.16, 0.05, pivot_z]], 0.018, 14)
    shape.add(bar - pillow, frame)
    recline = rng.random() < 0.5
    joint = hinge((0.16, 0, pivot_z), (0, 1, 0), float(rng.uniform(0.2, 0.4))) if recline else None
    asm.add("backrest", shape, seat, joint)

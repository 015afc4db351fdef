"""Room doors: a frame, one leaf or two, lever handles on both faces, a bolt, a flap for the letters
or the cat."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.fronts import FrontStyle, panel
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    ball,
    box,
    cylinder,
    hinge,
    tidy,
    turn,
    union,
)


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A door in its frame, metres, closed."""
    double = rng.random() < 0.22
    leaf, height = float(rng.uniform(0.7, 0.95)), float(rng.uniform(1.95, 2.2))
    unit = (height + 0.06) / 100
    jamb, depth = float(rng.uniform(0.05, 0.1)), float(rng.uniform(0.09, 0.16))
    thick, air = float(rng.uniform(0.038, 0.052)), 0.007
    width = leaf * (2 if double else 1)
    face = materials.furniture(rng)
    frame_face = face if rng.random() < 0.5 else materials.paint(rng)
    hardware = materials.hardware(rng)
    half, top = width / 2 + 2 * air, height + 2 * air
    threshold = 0.02 if rng.random() < 0.4 else 0.0
    look = FrontStyle(
        panel=str(rng.choice(["slab", "shaker", "raised", "glass", "slats", "border"], p=[0.27, 0.2, 0.2, 0.15, 0.1, 0.08])),  # noqa: E501
        handle="none", face=face, accent=face.darker(0.9), glass=materials.glass(rng), hardware=hardware, inside=face,  # noqa: E501
        thickness=thick, unit=unit,
    )  # fmt: skip

    asm, frame = Assembly(), Shape()
    solid = box([0, -half - jamb, 0], [depth, half + jamb, top + jamb])
    solid -= box([-1, -half, threshold], [2, half, top])
    stop = thick + 2 * air
    if depth - stop > 0.03:  # the rebate that the leaf closes against
        ring = box([stop, -half, threshold], [min(depth, stop + 0.04), half, top])
        ring -= box([-1, -half + 0.014, -1], [2, half - 0.014, top - 0.014])
        solid = solid + ring
    if rng.random() < 0.5:  # an architrave around it
        lap, out = float(rng.uniform(0.05, 0.09)), 0.022
        trim = box([-out, -half - lap, 0], [0, half + lap, top + lap]) - box(
            [-1, -half - 0.02, -1], [1, half + 0.02, top + 0.02]
        )
        frame.add(trim, frame_face)
    frame.add(solid, frame_face)
    root = asm.add("frame", frame)

    swing = float(np.deg2rad(rng.uniform(80, 150)))
    low = threshold + air
    style = str(rng.choice(["lever", "knob", "pull"], p=[0.65, 0.22, 0.13]))
    mark = rng.random() < 0.35
    edges = ("+y", "-y") if double else (("+y",) if rng.random() < 0.5 else ("-y",))
    for edge in edges:
        a, b = (-width / 2, width / 2)
        if double:
            a, b = (air / 2, width / 2) if edge == "+y" else (-width / 2, -air / 2)
        lo, hi = (
            np.array([0.004, a, low]),
            np.array([0.004 + thick, b, low + height - air - threshold]),
        )
        _leaf(
            rng,
            asm,
            root,
            lo,
            hi,
            edge,
            swing,
            look,
            style,
            unit,
            mark,
            second=double and edge == "-y",
        )
    return asm.object()


def _leaf(
    rng, asm: Assembly, root, lo, hi, edge, swing, look, style, unit, mark, *, second
) -> None:
    """One leaf on its hinges; its handle, bolt and flap."""
    way = 1 if edge == "+y" else -1  # where the hinges are
    hinge_y = hi[1] if way > 0 else lo[1]
    free_y = lo[1] if way > 0 else hi[1]
    wide, handle_z = hi[1] - lo[1], lo[2] + float(rng.uniform(0.95, 1.1))
    stile = min(max(0.06, 3.2 * unit), 0.24 * wide)
    handle_y = free_y + way * max(0.07, 0.55 * stile)
    bore = cylinder("x", [lo[0] - 1, handle_y, handle_z], 3, 0.019, segments=18)
    cat = style != "pull" and look.panel in ("slab", "border") and rng.random() < 0.4
    holes = [bore] if style != "pull" else []
    axis_x = lo[0] - 0.016
    shape = Shape()
    flap_box = None
    if cat:
        y, w, tall = (lo[1] + hi[1]) / 2, 0.13, 0.28
        flap_box = (
            np.array([lo[0], y - w, lo[2] + 0.08]),
            np.array([hi[0], y + w, lo[2] + 0.08 + tall]),
        )
        holes.append(box([lo[0] - 1, *flap_box[0][1:]], [hi[0] + 1, *flap_box[1][1:]]))
    plain_kind = "slab" if cat else None
    shape.join(panel(lo, hi, look, plain_kind, tuple(holes)))
    knuckles = []
    for share in (0.1, 0.5, 0.9):
        z = lo[2] + share * (hi[2] - lo[2])
        a, b = sorted((hinge_y, hinge_y - way * 0.04))
        knuckles.append(cylinder("z", [axis_x, hinge_y, z - 0.055], 0.11, 0.014, segments=14))
        knuckles.append(box([axis_x, a, z - 0.05], [lo[0], b, z + 0.05]))
    beyond = box([lo[0] - 0.003, -3, 0], [1, 3, 3])
    shape.add(union(knuckles) - beyond, look.hardware)
    plate_proud = 0.008
    if style == "pull":
        for s, x in ((-1, lo[0]), (1, hi[0])):
            a, b = sorted((x, x + s * 0.05))
            grip = [
                box([a, handle_y - 0.014, z - 0.014], [b, handle_y + 0.014, z + 0.014])
                for z in (handle_z - 0.15, handle_z + 0.15)
            ]
            c, d = sorted((x + s * 0.03, x + s * 0.062))
            grip.append(
                box([c, handle_y - 0.017, handle_z - 0.2], [d, handle_y + 0.017, handle_z + 0.2])
            )
            shape.add(union(grip), look.hardware)
    elif mark:  # long plates behind the handles
        for x in (lo[0] - plate_proud, hi[0]):
            plate = box(
                [x, handle_y - 0.026, handle_z - 0.13],
                [x + plate_proud, handle_y + 0.026, handle_z + 0.08],
            )
            shape.add(plate - bore, look.hardware)
    joint = hinge((axis_x, hinge_y, 0), (0, 0, -way), swing)
    leaf = asm.add("leaf", shape, root, joint)

    if style != "pull" and not (second and rng.random() < 0.4):
        spindle = cylinder(
            "x", [lo[0] - 0.05, handle_y, handle_z], hi[0] - lo[0] + 0.1, 0.0145, segments=16
        )
        solids = [spindle]
        for s, x in ((-1, lo[0]), (1, hi[0])):
            end = x + s * 0.055
            if style == "lever":
                arm = 0.13 * way
                a, b = sorted((end, end + s * 0.03))
                c, d = sorted((handle_y - way * 0.017, handle_y + arm))
                solids.append(box([a, c, handle_z - 0.017], [b, d, handle_z + 0.017]))
                g, h = sorted((x + s * 0.03, end + s * 0.03))
                solids.append(cylinder("x", [g, handle_y, handle_z], h - g, 0.019, segments=16))
            else:
                solids.append(ball([end, handle_y, handle_z], 0.036, 18))
        joint = hinge((0, handle_y, handle_z), (-way, 0, 0), float(np.deg2rad(rng.uniform(35, 60))))
        if style == "knob":
            joint = turn((0, handle_y, handle_z), (1, 0, 0))
            w = 0.007
            solids.append(
                box(
                    [lo[0] - 0.1, handle_y - w, handle_z - 0.026],
                    [lo[0] - 0.06, handle_y + w, handle_z + 0.026],
                )
            )
        asm.add("handle", Shape().add(tidy(union(solids)), look.hardware), leaf, joint)
        if rng.random() < 0.4 and not second:  # the knob of a bolt above
            z = handle_z + 0.2
            knob = cylinder("x", [lo[0] - 0.03, handle_y, z], 0.0285, 0.026, segments=18)
            ridge = box(
                [lo[0] - 0.05, handle_y - 0.009, z - 0.024],
                [lo[0] - 0.03, handle_y + 0.009, z + 0.024],
            )
            joint = hinge((0, handle_y, z), (1, 0, 0), np.pi / 2)
            asm.add("bolt", Shape().add(union([knob, ridge]), look.hardware), leaf, joint)
    if flap_box is not None:
        a, b = flap_box[0] + [0, 0.006, 0.006], flap_box[1] - [0, 0.006, 0.006]
        middle = (a[0] + b[0]) / 2
        a[0], b[0] = middle - 0.0165, middle + 0.0165
        shade = materials.dark(rng) if rng.random() < 0.5 else look.accent.darker(0.8)
        joint = hinge((a[0], 0, b[2]), (0, 1, 0), float(np.deg2rad(rng.uniform(50, 80))))
        asm.add("cat_flap", Shape().add(box(a, b), shade), leaf, joint)

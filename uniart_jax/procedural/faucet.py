"""Taps: a turning spout, levers or cross handles, now and then a spray head that pulls out."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material, plain
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    ball,
    box,
    cylinder,
    extrusion,
    hinge,
    pipe,
    revolution,
    rounded,
    slide,
    tidy,
    turn,
    union,
)

_AIR = 0.0015  # metres between parts that turn on one another


def build(rng: np.random.Generator) -> ArticulatedObject:
    """A tap, metres, shut."""
    finish = materials.hardware(rng)
    if rng.random() < 0.2:
        finish = materials.white_plastic(rng)
    kind = rng.choice(3, p=[0.4, 0.33, 0.27])
    return (_side_lever, _two_handles, _top_lever)[int(kind)](rng, finish)


def _foot(rng, body: Shape, radius: float, finish: Material, wide: float = 0.0) -> float:
    """The flange on the worktop; returns its top."""
    t = float(rng.uniform(0.008, 0.014))
    if wide:
        outline = rounded(2.6 * radius, wide, 1.2 * radius)
        body.add(extrusion(outline, "z", [0, 0, 0], t), finish)
    else:
        body.add(cylinder("z", [0, 0, 0], t, 1.35 * radius, 1.2 * radius, segments=24), finish)
    return t


def _spout(
    rng, asm: Assembly, parent: int, z: float, radius: float, finish: Material, pull: bool
) -> int:
    """A spout that turns on a neck at height ``z``: goose neck, square neck or a straight arm; with
    a spray head if ``pull``."""
    style = str(rng.choice(["goose", "square", "arm"], p=[0.5, 0.25, 0.25]))
    if pull:
        style = "goose"
    r = max(0.0115, 0.62 * radius)
    reach = float(rng.uniform(0.14, 0.24))
    shape = Shape()
    collar = cylinder("z", [0, 0, z + _AIR], 0.02, 1.1 * radius, radius, segments=20)
    if style == "goose":
        rise, bow = float(rng.uniform(0.1, 0.24)), reach / 2
        angle = np.linspace(0, np.pi, 11)
        path = [
            [0, 0, z + 0.015],
            *np.column_stack(
                [-bow + bow * np.cos(angle), 0 * angle, z + rise + bow * np.sin(angle)]
            ),
        ]
        tip = [-reach, 0, z + rise * float(rng.uniform(0.45, 0.85))]
        path.append(tip)
    elif style == "square":
        rise = float(rng.uniform(0.14, 0.28))
        tip = [-reach, 0, z + rise - 0.03]
        path = [[0, 0, z + 0.015], [0, 0, z + rise], [-reach, 0, z + rise], tip]
    else:
        rise = float(rng.uniform(0.02, 0.09))
        tip = [-reach, 0, z + 0.01 + rise * 0.6]
        path = [
            [0, 0, z + 0.02],
            [-0.85 * reach, 0, z + 0.02 + rise],
            [-reach, 0, z + 0.015 + rise],
            tip,
        ]
    bar = pipe(path, r)
    # the ends are flat: cut the neck's rounding below, and the mouth
    bar -= box([-0.1, -0.1, z - 1], [0.1, 0.1, z + _AIR])
    mouth = tip[2]
    bar -= box([tip[0] - 2 * r, -0.1, mouth - 2 * r], [tip[0] + 2 * r, 0.1, mouth])
    shape.add(tidy(union([collar, bar])), finish)
    if not pull:
        nozzle = cylinder("z", [tip[0], 0, mouth - 0.012], 0.012, 1.05 * r, segments=18)
        shape.add(nozzle, finish.darker(0.6))
    at = (0.0, 0.0, z)
    if rng.random() < 0.55:
        joint = turn(at, (0, 0, 1))
    else:
        side = float(rng.choice([-1, 1]))
        joint = hinge(at, (0, 0, side), float(np.deg2rad(rng.uniform(70, 170))))
    spout = asm.add("spout", shape, parent, joint)
    if pull:
        head = float(rng.uniform(0.07, 0.1))
        low = max(mouth - head, 0.03)
        wand = revolution(
            np.array([[0, low], [1.5 * r, low], [1.5 * r, low + 0.35 * head], [1.05 * r, mouth - _AIR], [0, mouth - _AIR]]),  # noqa: E501
            "z", [tip[0], 0, 0], 20,
        )  # fmt: skip
        spray = Shape().add(wand, finish)
        spray.add(
            cylinder("z", [tip[0], 0, low - 0.004], 0.004, 1.3 * r, segments=18),
            materials.dark(rng),
        )
        asm.add("spray_head", spray, spout, slide((0, 0, -1), float(rng.uniform(0.06, 0.15))))
    return spout


def _side_lever(rng: np.random.Generator, finish: Material) -> ArticulatedObject:
    """A post with the spout on top and the lever at its side."""
    radius = float(rng.uniform(0.021, 0.028))
    high = float(rng.uniform(0.09, 0.16))
    asm, body = Assembly(), Shape()
    foot = _foot(rng, body, radius, finish)
    side = float(rng.choice([-1, 1]))
    z = high * float(rng.uniform(0.5, 0.62))
    stub, r = 0.022, 0.75 * radius
    at_y = side * (radius + stub)
    socket = cylinder("y", [0, min(0, at_y), z], abs(at_y), r, segments=20)
    post = cylinder("z", [0, 0, foot], high - foot, radius, segments=24)
    body.add(union([post, socket]), finish)
    root = asm.add("body", body)
    _spout(rng, asm, root, high, radius, finish, bool(rng.random() < 0.4))

    grip = finish if rng.random() < 0.75 else materials.dark(rng)
    a, b = sorted((at_y + side * _AIR, at_y + side * 0.022))
    boss = cylinder("y", [0, a, z], b - a, r, segments=20)
    y = at_y + side * 0.012
    arm = float(rng.uniform(0.06, 0.11))
    end = [[0.0, y, z], [0.3 * arm, y + side * 0.012, z + arm]]
    if rng.random() < 0.5:
        end = [[0.0, y, z], [0, y + side * 0.015, z + 0.02], [0, y + side * 0.03, z + arm]]
    near = at_y + side * _AIR
    inside = box([-1, -1, 0], [1, near, 1]) if side > 0 else box([-1, near, 0], [1, 1, 1])
    lever = union([boss, pipe(end, 0.0075)]) - inside
    joint = hinge((0, 0, z), (0, -1, 0), float(np.deg2rad(rng.uniform(35, 75))))
    lever_part = asm.add("lever", Shape().add(lever, grip), root, joint)
    if rng.random() < 0.5:  # a red or blue cap on the pivot
        red = plain((0.75, 0.12, 0.1)) if rng.random() < 0.5 else plain((0.1, 0.25, 0.75))
        c0 = b if side > 0 else a - 0.006
        cap = cylinder("y", [0, c0, z], 0.006, 0.7 * r, segments=16)
        cap -= lever
        asm.add("mark", Shape().add(cap, red), lever_part)
    return asm.object()


def _two_handles(rng: np.random.Generator, finish: Material) -> ArticulatedObject:
    """A bridge with the spout in the middle and a handle on each side."""
    radius = float(rng.uniform(0.02, 0.026))
    span = float(rng.uniform(0.075, 0.11))
    asm, body = Assembly(), Shape()
    foot = _foot(rng, body, radius, finish, 2 * span + 2.6 * radius)
    high, neck = foot + float(rng.uniform(0.025, 0.05)), foot + float(rng.uniform(0.035, 0.08))
    solids = [cylinder("z", [0, 0, foot], neck - foot, radius, segments=24)]
    for s in (-1, 1):
        solids.append(
            cylinder("z", [0, s * span, foot], high - foot, radius, 0.8 * radius, segments=20)
        )
    body.add(union(solids), finish)
    root = asm.add("body", body)
    _spout(rng, asm, root, neck, radius, finish, False)
    style = str(rng.choice(["cross", "lever", "knob"]))
    endless = style != "lever" and rng.random() < 0.4
    sweep = float(np.deg2rad(rng.uniform(80, 120)))
    marks = [plain((0.75, 0.12, 0.1)), plain((0.1, 0.25, 0.75))]
    for s, color in zip((1, -1), marks, strict=True):
        y, z = s * span, high + _AIR
        stem = cylinder("z", [0, y, z], 0.03, 0.75 * radius, 0.6 * radius, segments=16)
        top = z + 0.03
        if style == "cross":
            arm = 0.036
            head = pipe([[-arm, y, top], [arm, y, top]], 0.0065) + pipe(
                [[0, y - arm, top], [0, y + arm, top]], 0.0065
            )
        elif style == "lever":
            arm = float(rng.uniform(0.06, 0.075))
            head = pipe([[0, y, top], [0.0, y + s * arm, top + 0.012]], 0.0075)
        else:
            turns = np.linspace(0, 2 * np.pi, 60, endpoint=False)
            r = 0.026 + 0.003 * np.cos(6 * turns)
            head = extrusion(
                np.column_stack([r * np.cos(turns), r * np.sin(turns)]),
                "z",
                [0, y, top - 0.012],
                0.024,
            )
        solid = union([stem, head, ball([0, y, top], 0.0125)])
        cut_z = top + 0.009
        solid -= box([-0.011, y - 0.011, cut_z], [0.011, y + 0.011, cut_z + 1])
        button = cylinder("z", [0, y, cut_z], 0.007, 0.0095, segments=16) - solid
        shape = Shape().add(solid, finish).add(button, color)
        joint = turn((0, y, z), (0, 0, 1)) if endless else hinge((0, y, z), (0, 0, s), sweep)
        asm.add("handle", shape, root, joint)
    return asm.object()


def _top_lever(rng: np.random.Generator, finish: Material) -> ArticulatedObject:
    """A basin mixer: a fixed spout, a cap that turns on top, and on it a lever that lifts."""
    radius = float(rng.uniform(0.022, 0.03))
    high = float(rng.uniform(0.08, 0.2))
    asm, body = Assembly(), Shape()
    foot = _foot(rng, body, radius, finish)
    post = cylinder("z", [0, 0, foot], high - foot, radius, segments=24)
    reach, r = float(rng.uniform(0.1, 0.15)), 0.6 * radius
    z = foot + (high - foot) * float(rng.uniform(0.55, 0.75))
    drop = float(rng.uniform(-0.02, 0.03))
    arm = pipe([[0, 0, z], [-reach, 0, z + drop], [-reach - 0.008, 0, z + drop - 0.018]], r)
    arm -= box([-1, -1, high], [1, 1, 2])
    body.add(union([post, arm]), finish)
    root = asm.add("body", body)

    thick = float(rng.uniform(0.018, 0.03))
    low = high + _AIR
    slot = 0.0085  # half width of the fork that holds the lever
    cap = cylinder("z", [0, 0, low], thick, radius, segments=24)
    fork = low + thick
    ears = [
        box(
            [-0.011, s * (slot + 0.0035) - 0.0035, fork - 0.001],
            [0.011, s * (slot + 0.0035) + 0.0035, fork + 0.021],
        )
        for s in (-1, 1)
    ]
    sides = float(np.deg2rad(rng.uniform(40, 90)))
    way = float(rng.choice([-1, 1]))
    middle = asm.add(
        "cartridge",
        Shape().add(union([cap, *ears]), finish),
        root,
        hinge((0, 0, low), (0, 0, way), sides),
    )

    y = slot - 0.0012
    pivot = fork + 0.0125
    length = float(rng.uniform(0.07, 0.12))
    eye = cylinder("y", [0, -y, pivot], 2 * y, 0.0095, segments=16)
    blade = box([-length, -y, pivot - 0.005], [0, y, pivot + 0.0055])
    if rng.random() < 0.5:
        blade = pipe([[-0.015, 0, pivot], [-length, 0, pivot + 0.012]], 0.0068) + box(
            [-0.018, -y, pivot - 0.005], [0, y, pivot + 0.005]
        )
    grip = finish if rng.random() < 0.7 else materials.dark(rng)
    joint = hinge((0, 0, pivot), (0, 1, 0), float(np.deg2rad(rng.uniform(20, 40))))
    asm.add("lever", Shape().add(union([eye, blade]), grip), middle, joint)
    return asm.object()

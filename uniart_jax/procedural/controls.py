"""Control panels as real appliances have them: dials of many shapes, push buttons, printed fields,
and rows of dials that are not even."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import trimesh
from manifold3d import Manifold

from uniart_jax.procedural import finishes, materials
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import (
    Assembly,
    Shape,
    box,
    cylinder,
    extrusion,
    hinge,
    revolution,
    rounded,
    slide,
    tube,
    turn,
    union,
)

DIALS = ("drum", "cone", "dome", "fin", "ring", "cap", "lobes")
AIR = 0.001  # metres behind a dial and around a button


@dataclasses.dataclass(frozen=True)
class Dial:
    """The dials of one appliance.

    Attributes:
      kind: one of ``DIALS``. radius, reach: metres.
      body, accent: materials of the grip, and of its skirt or mark.
      sweep: how far it turns clockwise, radians; None: without end.
      marked: with a mark from the axis to the rim.
      turned: by how much fins and marks are turned from upright, radians.
    """

    kind: str
    radius: float
    reach: float
    body: Material
    accent: Material
    sweep: float | None = None
    marked: bool = False
    turned: float = 0.0


def dial_style(
    rng: np.random.Generator, radius: float, reach: float, face: Material, endless: float = 0.8
) -> Dial:
    """Dials of any kind; ``endless``: the share that turns without end. The others are marked, and
    few of the endless ones are."""
    sweep = None
    if rng.random() >= endless:
        sweep = float(np.deg2rad(rng.choice([180, 240, 270, 300, 330])))
    pick = rng.choice(5, p=[0.28, 0.32, 0.2, 0.14, 0.06])
    body = (
        finishes.dark(rng),
        finishes.metal(rng, brushed=False),
        finishes.white_plastic(rng),
        face.darker(float(rng.uniform(0.75, 1.1))),
        materials.hardware(rng),
    )[pick]
    light = body.color[1] >= 0.5
    accent = finishes.dark(rng) if light else finishes.white_plastic(rng)
    if rng.random() < 0.3:
        accent = finishes.metal(rng, brushed=False)
    return Dial(
        kind=str(rng.choice(DIALS, p=[0.2, 0.14, 0.1, 0.26, 0.14, 0.1, 0.06])),
        radius=radius,
        reach=reach,
        body=body,
        accent=accent,
        sweep=sweep,
        marked=sweep is not None or rng.random() < 0.12,
        turned=0.0 if rng.random() < 0.7 else float(rng.uniform(-np.pi, np.pi)),
    )


def _dial_shape(dial: Dial) -> Shape:
    """A dial about the -x axis, on the plane x = 0."""
    r, reach, kind = dial.radius, dial.reach, dial.kind
    low, shape = -AIR, Shape()
    wide, foot = r, low  # of the grip: its radius and where it starts
    if kind in ("ring", "fin", "cap"):
        foot = low - (0.35 if kind == "fin" else 0.2) * reach
        wide = {"ring": 0.68, "fin": 1.0, "cap": 0.8}[kind] * r
        skirt = cylinder("x", [foot, 0, 0], low - foot, r, r, segments=20)
        shape.add(skirt, dial.body if kind == "fin" else dial.accent)
    tall = reach + foot
    if kind == "fin":
        outline = rounded(0.4 * r, 1.9 * r, 0.2 * r, 3)
        grip = extrusion(outline, "x", [-reach, 0, 0], tall)
    elif kind == "dome":
        bend = np.linspace(0, np.pi / 2, 5)
        curve = np.column_stack([wide * np.cos(bend), -tall * (0.4 + 0.6 * np.sin(bend))])
        grip = revolution(np.vstack([[0, 0], [wide, 0], curve]), "x", [foot, 0, 0], 20)
    elif kind == "lobes":
        angle = np.linspace(0, 2 * np.pi, 36, endpoint=False)
        far = wide * (0.9 + 0.1 * np.cos(6 * angle))
        outline = np.column_stack([far * np.cos(angle), far * np.sin(angle)])
        grip = extrusion(outline, "x", [-reach, 0, 0], tall)
    else:
        taper = {"drum": 0.94, "cone": 0.62, "ring": 0.85, "cap": 0.97}[kind]
        grip = cylinder("x", [-reach, 0, 0], tall, taper * wide, wide, segments=20)
    shape.add(grip, dial.body)
    if dial.marked:
        w, rim = 0.14 * r, (0.9 if kind == "fin" else 0.6) * wide
        low_z = 0.15 * r
        shape.add(box([-1.12 * reach, -w, low_z], [-reach, w, max(rim, 2 * low_z)]), dial.accent)
    return shape


def add_dials(
    asm: Assembly, parent: int, places, dial: Dial, *, tilt: float = 0.0, name: str = "knob"
) -> list[int]:
    """Dials at ``places`` (x, y, z and the share of the usual radius) on a panel that leans back
    by ``tilt`` radians; those that have stops turn clockwise as seen from the front."""
    axis = np.array([np.cos(tilt), 0.0, -np.sin(tilt)])
    made = []
    for x, y, z, share in places:
        one = dataclasses.replace(dial, radius=share * dial.radius)
        frame = trimesh.transformations.rotation_matrix(dial.turned, (1, 0, 0))
        frame = trimesh.transformations.rotation_matrix(tilt, (0, 1, 0)) @ frame
        frame[:3, 3] = x, y, z
        shape = _dial_shape(one).moved(frame)
        joint = turn((x, y, z), axis) if dial.sweep is None else hinge((x, y, z), axis, dial.sweep)
        made.append(asm.add(name, shape, parent, joint))
    return made


@dataclasses.dataclass(frozen=True)
class Button:
    """A push button on a plane x = const: centre (y, z), sides, metres."""

    y: float
    z: float
    width: float
    height: float
    round: bool = False


def push_depth(rng: np.random.Generator, unit: float, panel: float) -> float:
    """How far buttons go into a panel ``panel`` metres thick; ``unit``: a percent of the object's
    longest side, of which less than .5 would be no motion."""
    return min(float(rng.uniform(0.7, 2.0)) * unit, 0.85 * panel)


def pockets(face: float, buttons: Sequence[Button], depth: float) -> list[Manifold]:
    """What must be cut out of a panel whose front is x = ``face``, for buttons that go in by
    ``depth``."""
    return [_block(b, face - 1.0, face + depth + AIR, AIR) for b in buttons]


def add_buttons(
    asm: Assembly,
    parent: int,
    face: float,
    buttons: Sequence[Button],
    stand: float,
    travel: float,
    material: Material,
) -> list[int]:
    """Buttons that stand ``stand`` out of the plane x = ``face`` and are pushed in by ``travel``;
    the panel has ``pockets`` at least as deep."""
    made = []
    for b in buttons:
        shape = Shape().add(_block(b, face - stand, face, 0.0), material)
        made.append(asm.add("button", shape, parent, slide((1, 0, 0), travel)))
    return made


def _block(b: Button, x0: float, x1: float, air: float) -> Manifold:
    """The prism of a button between two planes x = const, wider by ``air`` all around."""
    if b.round:
        return cylinder("x", [x0, b.y, b.z], x1 - x0, b.width / 2 + air, segments=16)
    w, h = b.width / 2 + air, b.height / 2 + air
    return box([x0, b.y - w, b.z - h], [x1, b.y + w, b.z + h])


def button_grid(y: tuple[float, float], z: tuple[float, float], columns: int, rows: int, rng):
    """Buttons that fill a rectangle evenly, of one size; few where they are large."""
    pitch = (y[1] - y[0]) / columns, (z[1] - z[0]) / rows
    round_ones = rng.random() < 0.4
    width, height = (p * float(rng.uniform(0.5, 0.78)) for p in pitch)
    if round_ones:
        width = height = min(width, height)
    return [
        Button(y[0] + (i + 0.5) * pitch[0], z[0] + (j + 0.5) * pitch[1], width, height, round_ones)
        for j in range(rows)
        for i in range(columns)
    ]


def print_buttons(
    body: Shape, face: float, buttons: Sequence[Button], proud: float, material: Material
) -> None:
    """Printed fields and sealed keys: they look as buttons do and do not move."""
    if buttons:
        solids = [_block(b, face - proud, face, 0.0) for b in buttons]
        body.add(union(solids), material)


def print_labels(
    body: Shape, rng: np.random.Generator, face: float, places, radius: float, material: Material
) -> None:
    """Small words, dots or scales around dials at ``places`` (y, z)."""
    kind, proud = rng.integers(3), 0.0006
    for y, z in places:
        if kind == 0:  # a word above
            a, h = 0.8 * radius, 0.14 * radius
            low = z + 1.25 * radius
            body.add(box([face - proud, y - a, low], [face, y + a, low + 2 * h]), material)
        elif kind == 1:  # a ring
            body.add(
                tube("x", [face - proud, y, z], proud, 1.28 * radius, 1.12 * radius, 20), material
            )
        else:  # dots on an arc
            for angle in np.linspace(-0.7, 0.7, 5) * np.pi:
                cy, cz = y + 1.32 * radius * np.sin(angle), z + 1.32 * radius * np.cos(angle)
                w = 0.09 * radius
                body.add(box([face - proud, cy - w, cz - w], [face, cy + w, cz + w]), material)


def uneven_row(
    rng: np.random.Generator, count: int, half: float, pitch: float
) -> tuple[list[float], tuple[float, float] | None]:
    """``count`` or fewer places within +-``half``, at least ``pitch`` apart: even, in groups, with
    a wide gap, at one end or as it comes; and the widest span that they leave free, or None."""
    count = min(count, int(2 * half / pitch) + 1)
    slack = 2 * half - pitch * (count - 1)
    if count == 0:
        return [], (-0.8 * half, 0.8 * half)
    if count == 1:
        at = float(rng.choice([0.0, rng.uniform(-0.9, 0.9)])) * half
        spans = [(-half, at - 0.6 * pitch), (at + 0.6 * pitch, half)]
        return [at], max(spans, key=lambda s: s[1] - s[0])
    modes = ("even", "ends", "gap", "pairs", "side", "any")
    mode = str(rng.choice(modes, p=[0.2, 0.26, 0.2, 0.1, 0.1, 0.14]))
    extra = np.zeros(count + 1)  # how the slack is shared: before the first, between, after
    if mode == "even":
        loose = float(rng.uniform(0.0, 1.0))
        extra[1:-1] = loose / (count - 1)
        extra[[0, -1]] = (1 - loose) / 2
    elif mode in ("ends", "gap"):
        cut = count // 2 if mode == "ends" else int(rng.integers(1, count))
        wide = float(rng.uniform(0.45, 1.0))
        extra[cut] = wide
        extra[[0, -1]] = (1 - wide) / 2
    elif mode == "pairs":
        extra[2:-1:2] = 1.0
        extra[[0, -1]] = float(rng.uniform(0, 1))
    elif mode == "side":
        extra[-1 if rng.random() < 0.5 else 0] = float(rng.uniform(0.7, 1.0))
        extra[[0, -1]] += 0.05
    else:
        extra = rng.uniform(0, 1, count + 1) ** 2
    extra = slack * extra / extra.sum()
    ys = -half + np.cumsum(extra[:-1] + pitch * (np.arange(count) > 0))
    borders = np.concatenate([[-half - 0.5 * pitch], ys, [half + 0.5 * pitch]])
    k = int(np.argmax(np.diff(borders)))
    span = float(borders[k] + 0.62 * pitch), float(borders[k + 1] - 0.62 * pitch)
    return [float(y) for y in ys], span if span[1] - span[0] > 0.8 * pitch else None

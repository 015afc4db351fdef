"""What controls a cooker: panels that stand upright or lean, backguards, knobs on the worktop, and
the hob between them."""

from __future__ import annotations

import dataclasses

import numpy as np

from uniart_jax.procedural import appliance_fronts, appliances, controls, finishes, materials
from uniart_jax.procedural import real_finishes as finish
from uniart_jax.procedural.fronts import FrontStyle
from uniart_jax.procedural.hobs import add_hob
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import Shape, box, cut


@dataclasses.dataclass
class Case:
    """The body while it grows: its room (y0, y1, low, high, depth), the front plane and finishes.

    Attributes:
      top: the lower edge of the control panel. front: x of the doors' faces, below 0.
      least: how many dials there are at least, where a panel has any.
    """

    body: Shape
    y0: float
    y1: float
    low: float
    top: float
    height: float
    depth: float
    front: float
    unit: float
    look: FrontStyle
    panel: Material
    least: int = 0


def add_panel(rng: np.random.Generator, c: Case, where: str, hob: bool, most: int):
    """The control panel, the backguard and the hob; the groups of dials and of buttons to add."""
    over = float(rng.choice([0.0, rng.uniform(0.0, 4.0)])) * c.unit
    face, tilt, foot = c.front - over, 0.0, c.top + 0.0015
    tall = c.height - foot
    middle = (face, (foot + c.height) / 2)
    pushes: list = []
    plan = _dial_plan(rng, c, where, tall, most)
    if tall > 0.004:
        shape = rng.random()
        if shape < 0.27 and where == "front":  # leans back, all of it or above a straight part
            straight = foot + tall * float(rng.choice([0.0, rng.uniform(0.15, 0.5)]))
            depth = min(-face - 1e-3, (c.height - straight) * float(rng.uniform(0.15, 1.4)))
            tilt = float(np.arctan2(depth, c.height - straight))
            ends = [[foot, face], [foot, 0.0], [c.height, 0.0], [c.height, face + depth]]
            ends += [[straight, face]] if straight > foot + 1e-3 else []
            c.body.add(appliance_fronts.across(ends, c.y0, c.y1), c.panel)
            middle = (face + depth / 2, (straight + c.height) / 2)
            tall = float(np.hypot(depth, c.height - straight))
            plan = _dial_plan(rng, c, where, tall, most)
        else:
            board = box([face, c.y0, foot], [0, c.y1, c.height])
            pushed = _pushed(rng, c, where, plan, face, middle[1], tall, most)
            if pushed is not None:
                pushes, plan = [pushed], (*plan[:2], None)
                board = cut(board, controls.pockets(face, pushed[1], pushed[3]))
            c.body.add(board, c.panel)
    guard_x, guard_z = c.depth, 0.0
    if hob and (where == "guard" or rng.random() < 0.35):
        low = where != "guard" and rng.random() < 0.5
        guard_z = float(rng.uniform(0.02, 0.07) if low else rng.uniform(0.08, 0.28))
        guard_x = c.depth - max(0.015, float(rng.uniform(1.5, 9)) * c.unit)
        lean = float(rng.uniform(0.05, 0.35)) if rng.random() < 0.4 and not low else 0.0
        lean = min(lean, float(np.arctan(0.8 * (c.depth - guard_x) / guard_z)))
        top = guard_x + guard_z * np.tan(lean)
        z1 = c.height + guard_z
        ends = [[c.height, guard_x], [z1, top], [z1, c.depth], [c.height, c.depth]]
        back = c.panel if where == "guard" else c.look.face
        c.body.add(appliance_fronts.across(ends, c.y0, c.y1), back)
        if where == "guard":
            tilt, tall = lean, guard_z
            middle = (guard_x + guard_z / 2 * np.tan(lean), c.height + guard_z / 2)
            plan = _dial_plan(rng, c, where, tall, most)
    near = 0.0
    if where == "near":  # dials on the worktop, before the burners or beside them
        near = float(rng.uniform(5.5, 9.0)) * c.unit
        tilt, tall = np.pi / 2, near
        middle = (0.5 * near, c.height)
        plan = _dial_plan(rng, c, where, near, most)
    if hob:
        ends = [0.01, 0.004, 0.02][int(rng.integers(3))]
        lo = [near + ends, c.y0 + ends, c.height]
        far = guard_x - ends - (1.2 * plan[1].reach if where == "guard" else 0.0)
        add_hob(c.body, rng, lo, [far, c.y1 - ends, c.height], c.unit)
    places, dial, screen = plan
    at = [(middle[0] + up * np.sin(tilt), y, middle[1] + up * np.cos(tilt), share)
          for y, up, share in places]  # fmt: skip
    if abs(tilt) < 1e-6 and tall > 0.02:
        _prints(rng, c, middle, tall, screen, at, dial)
    groups = [(at, dial, tilt)] if at else []
    return groups, pushes


def _dial_plan(rng, c: Case, where: str, tall: float, most: int):
    """Places (y, up, share of the radius) on a panel ``tall`` high, the dials, and a free span."""
    counts = [0.1, 0.03, 0.05, 0.08, 0.16, 0.14, 0.17, 0.14, 0.08, 0.05]
    count = min(max(int(rng.choice(10, p=counts)), c.least), most) if where != "none" else 0
    half = (c.y1 - c.y0) / 2
    radius = min(float(rng.uniform(1.6, 3.8)), float(rng.uniform(1.6, 5.0))) * c.unit
    radius = max(1.4 * c.unit, min(radius, 0.4 * tall))
    reach = float(rng.uniform(0.9, 4.5)) * c.unit
    reach = max(reach, 0.008)
    dial = controls.dial_style(rng, radius, reach, c.look.face)
    pitch = radius * float(rng.uniform(2.3, 3.4))
    ys, screen = controls.uneven_row(rng, count, half - 1.6 * radius, pitch)
    middle, places = (c.y0 + c.y1) / 2, []
    odd = int(rng.integers(count + 1)) if rng.random() < 0.35 and count > 2 else -1
    for k, y in enumerate(ys):
        up, share = 0.0, 1.0
        if k == odd:
            share = float(rng.uniform(0.75, 1.3))
            up = float(rng.uniform(-0.5, 0.5)) * max(0.0, tall - 2.2 * share * radius)
        places.append((y + middle, up, share))
    return places, dial, None if screen is None else (screen[0] + middle, screen[1] + middle)


def _pushed(rng, c: Case, where: str, plan, face: float, z: float, tall: float, most: int):
    """Now and then, push buttons in the free span of the panel; None: there are none."""
    places, _, screen = plan
    room = most - len(places)
    if where != "front" or rng.random() > 0.11 or screen is None or room < 2:
        return None
    size = float(rng.uniform(1.6, 3.0)) * c.unit
    pitch = size * float(rng.uniform(1.3, 2.0))
    count = min(room, int((screen[1] - screen[0]) / pitch), int(rng.integers(2, 7)))
    if count < 1 or size > 0.8 * tall:
        return None
    start = (screen[0] + screen[1]) / 2 - pitch * (count - 1) / 2
    round_ones = bool(rng.random() < 0.5)
    group = [
        controls.Button(start + k * pitch, z, size, size * 0.8, round_ones) for k in range(count)
    ]
    stand = float(rng.uniform(0.6, 1.6)) * c.unit
    ink = finishes.dark(rng) if rng.random() < 0.5 else finishes.metal(rng, brushed=False)
    return face, group, stand, controls.push_depth(rng, c.unit, -face), ink


def _prints(rng, c: Case, middle, tall: float, screen, at, dial) -> None:
    """What is printed on an upright panel: a display with sealed keys in the free span, labels
    around the dials."""
    face, z = middle
    dark = c.panel.color[1] < 0.4
    ink = materials.plain((0.85, 0.85, 0.85)) if dark else materials.plain((0.1, 0.1, 0.12))
    if at and rng.random() < 0.5:
        marks = [(y, z_) for _, y, z_, share in at if share == 1.0]
        controls.print_labels(c.body, rng, face, marks, dial.radius, ink)
    if screen is None or rng.random() < 0.35:
        return
    y = sorted(rng.uniform(0.05, 0.95, 2)) if rng.random() < 0.4 else (0.12, 0.88)
    a, b = (screen[0] + v * (screen[1] - screen[0]) for v in y)
    if b - a < 3 * c.unit:
        return
    up = tall * float(rng.uniform(0.2, 0.4))
    pick = rng.choice(3, p=[0.6, 0.2, 0.2])
    glass = (
        materials.dark_glass(rng) if not dark else materials.plain((0.3, 0.45, 0.45)),
        finish.tinted_glass(rng),
        materials.plain(np.full(3, rng.uniform(0.6, 0.95))),
    )[pick]
    proud = float(rng.uniform(0.0008, 0.005))
    appliances.display(c.body, face, (a, b), (z - up, z + up), proud, glass)
    if rng.random() < 0.6 and b - a > 6 * c.unit:
        keys = controls.button_grid(
            (a + 0.1 * (b - a), b - 0.1 * (b - a)), (z - 0.7 * up, z + 0.7 * up),
            int(rng.integers(3, 9)), int(rng.integers(1, 3)), rng,
        )  # fmt: skip
        lit = materials.plain(rng.choice([[0.9, 0.9, 0.9], [0.9, 0.15, 0.1], [0.2, 0.9, 0.4]]))
        controls.print_buttons(c.body, face - proud, keys, 0.0006, lit)


def add_column(rng, c: Case, y: tuple[float, float]):
    """A panel beside the door with dials one over the other."""
    c.body.add(box([c.front, y[0], c.low], [0, y[1] - 0.0015, c.height]), c.panel)
    count, tall = int(rng.integers(1, 5)), c.height - c.low
    radius = min(0.36 * (y[1] - y[0]), 0.38 * tall / count) * float(rng.uniform(0.6, 1.0))
    reach = float(rng.uniform(1.5, 4.5)) * c.unit
    dial = controls.dial_style(rng, radius, reach, c.look.face, endless=0.7)
    zs = c.low + (np.arange(count) + 0.5) * tall / count * float(rng.uniform(0.8, 1.0))
    at = [(c.front, (y[0] + y[1]) / 2, float(z), 1.0) for z in zs]
    return [(at, dial, 0.0)], []


def add_hob_with_column(rng, c: Case):
    """A hob with its dials in a column at one side."""
    side = float(rng.choice([-1, 1]))
    radius = float(rng.uniform(1.8, 3.6)) * c.unit
    strip = radius * float(rng.uniform(2.6, 4.0))
    half = (c.y1 - c.y0) / 2
    count = int(rng.integers(2, 7))
    xs, _ = controls.uneven_row(rng, count, 0.46 * c.depth - radius, 2.3 * radius)
    reach = float(rng.uniform(1.2, 4.5)) * c.unit
    dial = controls.dial_style(rng, radius, reach, c.look.face)
    lo = [0.01, (c.y0 if side > 0 else c.y0 + strip) + 0.01, c.height]
    hi = [c.depth - 0.01, (c.y1 if side < 0 else c.y1 - strip) - 0.01, c.height]
    add_hob(c.body, rng, lo, hi, c.unit)
    at = [(c.depth / 2 + x, side * (half - strip / 2), c.height, 1.0) for x in xs]
    return [(at, dial, np.pi / 2)]

"""Control panels of microwaves and dishwashers: a tall one beside the door, a flat one above or
below it."""

from __future__ import annotations

import dataclasses

import numpy as np

from uniart_jax.procedural import controls, finishes, materials
from uniart_jax.procedural import real_finishes as finish
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import Assembly, Shape, box, cut


@dataclasses.dataclass
class Board:
    """A control panel on the plane x = ``face``, ``deep`` metres thick: its rectangle, what is
    pushed in it (``stand`` metres out of it, by ``travel``) and what turns on it."""

    face: float
    deep: float
    y: tuple[float, float]
    z: tuple[float, float]
    unit: float
    finish: Material
    buttons: list[controls.Button] = dataclasses.field(default_factory=list)
    dials: list[tuple[float, float, float, float]] = dataclasses.field(default_factory=list)
    dial: controls.Dial | None = None
    ink: Material | None = None
    stand: float = 0.0
    travel: float = 0.0

    def build(self, body: Shape) -> None:
        """The panel with the pockets of its buttons joins the body."""
        lo = [self.face, self.y[0], self.z[0]]
        solid = box(lo, [self.face + self.deep, self.y[1], self.z[1]])
        body.add(cut(solid, controls.pockets(self.face, self.buttons, self.travel)), self.finish)

    def parts(self, asm: Assembly, root: int) -> None:
        """Its buttons and dials join the assembly."""
        if self.dial is not None:
            controls.add_dials(asm, root, self.dials, self.dial)
        if self.buttons and self.ink is not None:
            controls.add_buttons(
                asm, root, self.face, self.buttons, self.stand, self.travel, self.ink
            )


def column_board(rng, board: Board, body: Shape, face: Material, most: int) -> None:
    """Controls of a tall panel: a display above, keys, buttons or dials below."""
    y, z, unit = board.y, board.z, board.unit
    wide, tall = y[1] - y[0], z[1] - z[0]
    dark = board.finish.color[1] < 0.4
    ink = (
        finishes.white_plastic(rng)
        if dark or rng.random() < 0.2
        else (finishes.dark(rng) if rng.random() < 0.5 else face.darker(0.75))
    )
    a, b = y[0] + 0.12 * wide, y[1] - 0.12 * wide
    high = z[1] - tall * float(rng.uniform(0.05, 0.16))
    prints = []
    if rng.random() < 0.75:
        low = high - tall * float(rng.uniform(0.07, 0.16))
        pick = rng.choice(3, p=[0.5, 0.3, 0.2])
        glass = (
            materials.dark_glass(rng) if not dark else materials.plain((0.35, 0.5, 0.45)),
            finish.tinted_glass(rng),
            materials.plain((0.1, rng.uniform(0.6, 0.9), 0.35)),
        )[pick]
        prints.append(([(a + b) / 2, (low + high) / 2, b - a, high - low], glass))
        high = low - 0.04 * tall
    foot = z[0] + 0.06 * tall
    board.stand = max(0.0025, float(rng.uniform(0.3, 1.4)) * unit)
    board.travel = controls.push_depth(rng, unit, board.deep)
    board.ink = ink if rng.random() < 0.75 else board.finish
    if rng.random() < 0.2 and most > 1:  # what opens the door
        size = min(float(rng.uniform(0.06, 0.13)) * tall, 0.06)
        size = max(size, 1.6 * unit)
        if rng.random() < 0.65:
            button = controls.Button((a + b) / 2, foot + size / 2, b - a, size)
            board.buttons.append(button)
            most -= 1
        else:
            prints.append(([(a + b) / 2, foot + size / 2, b - a, size], ink))
        foot += size + 0.05 * tall
    kind = str(
        rng.choice(["keys", "push", "dials", "both", "bare"], p=[0.45, 0.13, 0.26, 0.07, 0.09])
    )
    if kind in ("dials", "both"):
        count = 1 if kind == "both" else int(rng.choice([1, 2, 3], p=[0.4, 0.5, 0.1]))
        room = (high - foot) * (0.45 if kind == "both" else 1.0)
        radius = float(rng.uniform(0.55, 1.0)) * min(0.44 * wide, 0.42 * room / count)
        reach = max(0.006, float(rng.uniform(0.8, 4.5)) * unit)
        board.dial = controls.dial_style(rng, radius, reach, face, endless=0.85)
        zs = foot + (np.arange(count) + 0.5) * room / count
        middle = (y[0] + y[1]) / 2
        board.dials = [(board.face, middle, float(v), 1.0) for v in zs]
        most -= count
        if count == 1 and rng.random() < 0.18:
            marks = [(middle, float(zs[0]))]
            controls.print_labels(body, rng, board.face, marks, 0.75 * radius, ink)
        foot += room + 0.02 * tall
    least = 2.2 * unit
    if kind in ("keys", "push", "both") and high - foot > least and b - a > least:
        columns = int(np.clip(rng.integers(1, 5), 1, (b - a) / least))
        rows = int(np.clip(rng.integers(2, 8), 1, max(1, (high - foot) / least)))
        if kind == "push" or (kind == "both" and rng.random() < 0.5):
            columns = min(columns, max(most, 1))
            rows = max(1, min(rows, most // columns, int(rng.integers(1, 5))))
            used = foot + (high - foot) * min(1.0, rows * columns / 8 + 0.3)
            grid = controls.button_grid((a, b), (foot, used), columns, rows, rng)
            board.buttons += [k for k in grid if max(k.width, k.height) > 1.7 * unit]
        else:
            grid = controls.button_grid((a, b), (foot, high), columns, rows, rng)
            controls.print_buttons(body, board.face, grid, float(rng.uniform(0.0005, 0.002)), ink)
    for (cy, cz, w, h), material in prints:
        controls.print_buttons(body, board.face, [controls.Button(cy, cz, w, h)], 0.001, material)


def row_board(rng, board: Board, body: Shape, face: Material, most: int) -> None:
    """Controls of a flat panel: a display and keys, buttons or dials in an uneven row."""
    y, z, unit = board.y, board.z, board.unit
    half, tall = (y[1] - y[0]) / 2, z[1] - z[0]
    dark = board.finish.color[1] < 0.4
    ink = finishes.white_plastic(rng) if dark else finishes.dark(rng)
    middle, up = (y[0] + y[1]) / 2, (z[0] + z[1]) / 2
    kinds = ("dials", "push", "both", "keys", "bare")
    kind = str(rng.choice(kinds, p=[0.26, 0.16, 0.12, 0.36, 0.1]))
    screen: tuple[float, float] | None = (-0.8 * half, 0.8 * half)
    board.ink = (ink, face.darker(0.8), board.finish)[rng.choice(3, p=[0.55, 0.2, 0.25])]
    board.stand = max(0.003, float(rng.uniform(0.4, 2.0)) * unit)
    board.travel = controls.push_depth(rng, unit, board.deep)
    if kind in ("dials", "both"):
        radius = min(float(rng.uniform(1.7, 5.0)) * unit, 0.4 * tall)
        board.dial = controls.dial_style(
            rng, radius, max(0.006, float(rng.uniform(1.0, 4.0)) * unit), face, endless=0.85
        )
        count = min(most, int(rng.choice([1, 2, 3, 4], p=[0.4, 0.35, 0.15, 0.1])))
        ys, screen = controls.uneven_row(rng, count, half - 1.3 * radius, 2.6 * radius)
        board.dials = [(board.face, middle + v, up, 1.0) for v in ys]
    if kind == "both" and screen is not None:
        size = min(float(rng.uniform(1.7, 4.5)) * unit, 0.7 * tall)
        count = min(most - len(board.dials), int(rng.integers(1, 5)))
        count = min(count, int((screen[1] - screen[0]) / (1.3 * size)))
        a, b = sorted(rng.uniform(screen[0] + 0.5 * size, screen[1] - 0.5 * size, 2))
        pitch = 1.3 * size if count < 2 else max(1.3 * size, (b - a) / (count - 1))
        a = min(a, screen[1] - 0.5 * size - pitch * (count - 1))
        round_ones = bool(rng.random() < 0.6)
        board.buttons += [
            controls.Button(middle + a + k * pitch, up, size, size, round_ones)
            for k in range(count)
        ]
        return
    if kind == "push":
        size = min(float(rng.uniform(1.7, 4.5)) * unit, 0.7 * tall)
        round_ones = bool(rng.random() < 0.5)
        wide = size * (1.0 if round_ones else float(rng.uniform(0.8, 2.0)))
        count = min(most, int(rng.integers(1, 7)))
        ys, screen = controls.uneven_row(rng, count, half - wide, 1.3 * wide)
        board.buttons += [controls.Button(middle + v, up, wide, size, round_ones) for v in ys]
    if screen is None or rng.random() < 0.3:
        return
    a, b = middle + screen[0], middle + screen[1]
    cut_a, cut_b = sorted(rng.uniform(0.02, 0.98, 2))
    if cut_b - cut_a > 0.25:
        a, b = a + cut_a * (b - a), a + cut_b * (b - a)
    if b - a < 2 * unit:
        return
    h = tall * float(rng.uniform(0.3, 0.75))
    glass = materials.dark_glass(rng) if rng.random() < 0.7 else finish.tinted_glass(rng)
    plate = [controls.Button((a + b) / 2, up, b - a, h)]
    controls.print_buttons(body, board.face, plate, 0.001, glass)
    if kind == "keys" or rng.random() < 0.4:
        light = materials.plain(np.full(3, rng.uniform(0.6, 1.0)))
        grid = controls.button_grid(
            (a + 0.06 * (b - a), b - 0.06 * (b - a)), (up - 0.4 * h, up + 0.4 * h),
            int(rng.integers(3, 10)), int(rng.integers(1, 3)), rng,
        )  # fmt: skip
        controls.print_buttons(body, board.face - 0.001, grid, 0.0006, light)

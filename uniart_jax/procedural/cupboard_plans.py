"""What cupboards are divided into: sizes of each kind, and the fronts of its cells."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from uniart_jax.procedural.cabinet import Cell

# width, height, depth (metres), share
KINDS = {
    "base": ((0.3, 1.25), (0.72, 0.95), (0.5, 0.66), 0.26),
    "wall": ((0.28, 1.25), (0.35, 1.05), (0.27, 0.42), 0.18),
    "bridge": ((0.55, 1.25), (0.28, 0.48), (0.28, 0.6), 0.11),
    "tall": ((0.35, 0.75), (1.7, 2.35), (0.35, 0.65), 0.11),
    "wardrobe": ((0.7, 1.9), (1.6, 2.3), (0.45, 0.65), 0.08),
    "hutch": ((0.6, 1.4), (0.9, 1.9), (0.3, 0.5), 0.07),
    "low": ((0.8, 2.0), (0.4, 0.8), (0.35, 0.55), 0.07),
    "corner": ((0.3, 0.5), (0.6, 0.95), (0.5, 0.7), 0.05),
    "frame": ((0.5, 1.1), (1.2, 2.1), (0.28, 0.45), 0.04),
    "bench": ((0.9, 1.6), (0.45, 1.0), (0.35, 0.6), 0.03),
}
HUNG = ("wall", "bridge")


def _split(rng: np.random.Generator, lo: float, hi: float, count: int) -> np.ndarray:
    """[count + 1] borders: even ones, or a larger last one at either end."""
    weights = np.ones(count)
    if rng.random() < 0.4:
        weights[rng.choice([0, -1])] = rng.uniform(1.2, 2.2)
    return lo + (hi - lo) * np.concatenate([[0], np.cumsum(weights)]) / weights.sum()


def _rows(y, borders, kinds) -> list[Cell]:
    pairs = itertools.pairwise(float(b) for b in borders)
    return [Cell(y, z, str(kind)) for z, kind in zip(pairs, kinds, strict=True)]


def _columns(borders, z, kinds) -> list[Cell]:
    pairs = itertools.pairwise(float(b) for b in borders)
    return [Cell(y, z, str(kind)) for y, kind in zip(pairs, kinds, strict=True)]


def plan(rng: np.random.Generator, kind: str, half: float, z, unit: float) -> list[Cell]:
    """What fills the front of a cabinet: cells over its whole width 2 ``half`` and height ``z``."""
    full, (low, high) = (-half, half), z
    width, height = 2 * half, high - low
    door = "double" if width > rng.uniform(0.5, 0.8) else "door"
    row = max(0.11, 9 * unit)
    if kind == "bridge":
        count = 2 if width > 0.75 and rng.random() < 0.4 else 1
        fill = rng.choice(["flap", "door", "double"], p=[0.62, 0.13, 0.25])
        if fill == "double":
            return [Cell(full, z, "double")]
        return _columns(np.linspace(-half, half, count + 1), z, [fill] * count)
    if kind == "wall":
        pick = rng.choice(7, p=[0.42, 0.12, 0.1, 0.1, 0.1, 0.08, 0.08])
        if pick == 1 and height > 0.5:  # an open shelf below or above
            at = low + height * float(rng.choice([rng.uniform(0.2, 0.4), rng.uniform(0.7, 0.8)]))
            order = [door, "open"] if at > low + 0.5 * height else ["open", door]
            return _rows(full, [low, at, high], order)
        if pick == 2:
            return [Cell(full, z, "half")]
        if pick == 3 and width > 0.6:
            return [Cell(full, z, "sliding")]
        if pick == 4 and width > 0.7:  # three columns or two
            count = int(rng.integers(2, 4))
            fills = rng.choice(["door", "open"], count, p=[0.75, 0.25])
            return _columns(_split(rng, -half, half, count), z, fills)
        if pick == 5 and height > 0.5:
            return _rows(full, np.linspace(low, high, 3), ["flap", "flap"])
        if pick == 6 and height > 0.6:  # two rows of doors
            return _rows(full, [low, low + height * float(rng.uniform(0.4, 0.6)), high], [door] * 2)
        return [Cell(full, z, door)]
    if kind == "tall":
        pick = rng.choice(6, p=[0.25, 0.25, 0.2, 0.1, 0.1, 0.1])
        one = low + height * float(rng.uniform(0.2, 0.7))
        two = one + (high - one) * float(rng.uniform(0.3, 0.7))
        if pick == 0:
            return [Cell(full, z, door)]
        if pick == 1:
            return _rows(full, [low, one, high], [door, door])
        if pick == 2:  # open compartments below, amid or above doors
            fills = [[door, "open", door], ["open", "open", door], [door, "open", "open"]]
            return _rows(full, [low, one, two, high], fills[rng.integers(3)])
        if pick == 3:
            at = low + row * float(rng.uniform(1, 2.5))
            return _rows(full, [low, at, one if one > at + 0.3 else at + 0.3, high],
                         ["drawer", "open", door])  # fmt: skip
        if pick == 4:
            return _rows(full, [low, one, high], ["open", door])
        count = int(rng.integers(2, 5))
        borders = [*np.linspace(low, low + row * 1.6 * count, count + 1), high]
        return _rows(full, borders, ["drawer"] * count + [door])
    if kind == "wardrobe":
        count = max(1, round(width / rng.uniform(0.4, 0.6)))
        if width > 1.0 and rng.random() < 0.2:
            return [Cell(full, z, "sliding")]
        top = high
        cells = []
        if rng.random() < 0.25:
            top = high - height * float(rng.uniform(0.15, 0.25))
            cells = _columns(np.linspace(-half, half, count + 1), (top, high), ["door"] * count)
        bottom = low
        if rng.random() < 0.25:
            bottom = low + row * float(rng.uniform(1.2, 2))
            fill = str(rng.choice(["drawer", "false"], p=[0.75, 0.25]))
            n = int(rng.integers(1, 3))
            cells += _columns(np.linspace(-half, half, n + 1), (low, bottom), [fill] * n)
        fills = ["double"] if count < 3 else ["door"] * count
        if count >= 3 and rng.random() < 0.4:
            fills[int(rng.integers(count))] = "open"
        borders = np.linspace(-half, half, len(fills) + 1)
        return cells + _columns(borders, (bottom, top), fills)
    if kind == "hutch":
        at = low + height * float(rng.uniform(0.3, 0.5))
        if rng.random() < 0.35:
            return [Cell(full, z, door)]
        below = rng.choice(["double", "drawers", "open"], p=[0.5, 0.3, 0.2])
        cells = _rows(full, [at, high], ["double" if width > 0.6 else "door"])
        if below == "drawers":
            n = int(np.clip((at - low) / row, 1, 3))
            return cells + _rows(full, np.linspace(low, at, n + 1), ["drawer"] * n)
        return cells + _rows(full, [low, at], [below])
    if kind == "low":
        count = int(rng.integers(2, 5))
        fills = rng.choice(["door", "open", "drawer", "blank"], count, p=[0.5, 0.2, 0.22, 0.08])
        if rng.random() < 0.15:
            return [Cell(full, z, "sliding")]
        cells = []
        for cell in _columns(_split(rng, -half, half, count), z, fills):
            if cell.kind == "drawer" and height > 2.2 * row:
                n = int(rng.integers(2, min(4, int(height / row)) + 1))
                cells += _rows(cell.y, np.linspace(low, high, n + 1), ["drawer"] * n)
            else:
                cells.append(cell)
        return cells
    # base
    pick = rng.choice(7, p=[0.28, 0.3, 0.12, 0.1, 0.08, 0.06, 0.06])
    top = high - max(row, height * float(rng.uniform(0.16, 0.26)))
    if pick == 1:  # a drawer or a false front over the doors
        count = 2 if width > 0.6 and rng.random() < 0.35 else 1
        fill = str(rng.choice(["drawer", "false", "blank", "open"], p=[0.6, 0.27, 0.06, 0.07]))
        cells = _columns(np.linspace(-half, half, count + 1), (top, high), [fill] * count)
        return [Cell(full, (low, top), door), *cells]
    if pick == 2:
        n = int(rng.integers(2, 6))
        return _rows(full, _split(rng, low, high, n), ["drawer"] * n)
    if pick == 3:
        return [Cell(full, z, "half")]
    if pick == 4 and width > 0.6:
        y = half * float(rng.uniform(-0.4, 0.4))
        n = int(rng.integers(2, 5))
        left = _rows((y, half), _split(rng, low, high, n), ["drawer"] * n)
        right = Cell((-half, y), z, "door")
        return [*left, right] if rng.random() < 0.5 else _mirrored([*left, right])
    if pick == 5:
        fills = [[door, "open"], ["open", door], ["drawer", "open"]][rng.integers(3)]
        return _rows(full, [low, low + height * float(rng.uniform(0.35, 0.65)), high], fills)
    if pick == 6 and width > 0.7:
        count = int(rng.integers(2, 4))
        fills = rng.choice(["door", "open", "false"], count, p=[0.7, 0.15, 0.15])
        return _columns(_split(rng, -half, half, count), z, fills)
    return [Cell(full, z, door)]


def _mirrored(cells: list[Cell]) -> list[Cell]:
    return [dataclasses.replace(c, y=(-c.y[1], -c.y[0])) for c in cells]

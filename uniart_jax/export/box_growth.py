"""Boxes of lattice cells that grow, layer by layer, as far as cells allow."""

from __future__ import annotations

import numpy as np

FILLED = 0.5  # of the cells of a layer by which a box grows, that must be filled


class Layers:
    """Which layers of cells a box may grow by, by sums of every layer up to every corner (Crow,
    "Summed-area tables for texture mapping", SIGGRAPH 1984).

    Args:
      filled: [a, b, c] bool, cells that a layer should have.
      allowed: [a, b, c] bool, cells that it may have.
    """

    def __init__(self, filled: np.ndarray, allowed: np.ndarray):
        # one cell that is not allowed outweighs all others of its layer
        worth = np.where(allowed, filled, np.int64(-filled.size))
        self._sums = []
        for axis in range(3):
            layers = np.pad(np.moveaxis(worth, axis, 2), ((1, 0), (1, 0), (0, 0)))
            self._sums.append(layers.cumsum(0).cumsum(1))

    def run(self, axis: int, low: list[int], high: list[int]) -> tuple[int, int]:
        """How far [low, high) can grow along an axis: layers in which every cell is allowed and
        ``FILLED`` of them are filled, one after the other."""
        (a, c), (b, d) = (low[:axis] + low[axis + 1 :]), (high[:axis] + high[axis + 1 :])
        sums = self._sums[axis]
        worth = sums[b, d] - sums[a, d] - sums[b, c] + sums[a, c]
        shut = np.flatnonzero(worth < FILLED * (b - a) * (d - c))
        below, above = shut.searchsorted([low[axis], high[axis]])
        return (
            int(shut[below - 1]) + 1 if below else 0,
            int(shut[above]) if above < len(shut) else len(worth),
        )


def grow(layers: Layers, seed: np.ndarray, order: tuple[int, ...]) -> tuple[slice, ...]:
    """The box around a cell [3], grown along one axis after the other until none has room."""
    low, high = [int(s) for s in seed], [int(s) + 1 for s in seed]
    growing = True
    while growing:
        growing = False
        for axis in order:
            found = layers.run(axis, low, high)
            growing |= found != (low[axis], high[axis])
            low[axis], high[axis] = found
    return tuple(slice(a, b) for a, b in zip(low, high, strict=True))

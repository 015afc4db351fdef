"""Boxes of lattice cells grow as far as a search of every layer finds."""

from __future__ import annotations

import itertools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from uniart_jax.export.box_growth import FILLED, Layers, grow


def may_grow(full: np.ndarray, allowed: np.ndarray, box: list[list[int]]) -> bool:
    """Whether a layer [a, b) x ... of cells is one that a box may take."""
    if any(low < 0 or high > n for (low, high), n in zip(box, full.shape, strict=True)):
        return False
    cells = tuple(slice(*ends) for ends in box)
    return bool(allowed[cells].all() and full[cells].mean() >= FILLED)


def searched(full: np.ndarray, allowed: np.ndarray, seed, order) -> list[list[int]]:
    """The same box by one layer after the other."""
    box, before = [[s, s + 1] for s in seed], None
    while box != before:
        before = [list(ends) for ends in box]
        for axis, side in itertools.product(order, (-1, 1)):
            while True:
                low, high = box[axis]
                layer = [list(ends) for ends in box]
                layer[axis] = [low - 1, low] if side < 0 else [high, high + 1]
                if not may_grow(full, allowed, layer):
                    break
                box[axis] = [low - 1, high] if side < 0 else [low, high + 1]
    return box


@given(st.integers(0, 10_000))
@settings(max_examples=60, deadline=None)
def test_a_box_grows_as_far_as_every_layer_allows(seed):
    rng = np.random.default_rng(seed)
    shape = rng.integers(1, 9, 3)
    allowed = rng.random(shape) < rng.choice([0.8, 0.95, 1.0])
    full = allowed & (rng.random(shape) < rng.choice([0.5, 0.8, 1.0]))
    for cell in np.argwhere(full)[:4]:
        for order in itertools.permutations(range(3)):
            found = grow(Layers(full, allowed), cell, order)
            expected = searched(full, allowed, [int(i) for i in cell], order)
            assert [[s.start, s.stop] for s in found] == expected


def test_one_cell_that_is_not_allowed_stops_a_layer():
    full = np.ones((3, 40, 40), bool)
    allowed = full.copy()
    full[2, 7, 9] = allowed[2, 7, 9] = False
    found = grow(Layers(full, allowed), np.array([0, 0, 0]), (1, 2, 0))
    assert found == (slice(0, 2), slice(0, 40), slice(0, 40))

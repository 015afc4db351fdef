"""Finishes of kettles, pots and dispensers."""

from __future__ import annotations

import dataclasses

import numpy as np

from uniart_jax.procedural import materials
from uniart_jax.procedural.materials import Material, plain


def _copper(rng: np.random.Generator) -> Material:
    """Draw a copper finish, from red to pale."""
    return plain(materials.hsv(rng, (0.02, 0.12), (0.45, 0.7), (0.5, 0.8)))


def draw_kettle_finish(rng: np.random.Generator) -> Material:
    """Draw the finish of a kettle: steel, enamel or plastic of any colour, white, black, copper or
    glass."""
    kind = rng.choice(6, p=[0.28, 0.28, 0.14, 0.14, 0.08, 0.08])
    if kind == 1:
        return plain(materials.hsv(rng, (0, 1), (0.3, 0.9), (0.35, 0.9)))
    if kind == 4:
        return _copper(rng)
    makers = {0: materials.metal, 2: materials.white_plastic, 3: materials.dark}
    return makers.get(int(kind), materials.glass)(rng)


def draw_pot_finish(rng: np.random.Generator) -> Material:
    """Draw the finish of a pot: steel, enamel, cast iron, copper, aluminium or earthenware."""
    kind = rng.choice(5, p=[0.36, 0.3, 0.18, 0.09, 0.07])
    if kind == 1:
        return plain(materials.hsv(rng, (0, 1), (0.3, 0.95), (0.35, 0.95)))
    if kind == 3:
        return _copper(rng)
    if kind == 4:
        return materials.white_plastic(rng)
    return materials.metal(rng) if kind == 0 else materials.dark(rng)


def draw_pot_trim(rng: np.random.Generator, face: Material) -> Material:
    """Draw the finish of handles and knobs: dark, steel, wood, the pot's own or any colour."""
    kind = rng.choice(5, p=[0.34, 0.24, 0.14, 0.18, 0.1])
    if kind == 2:
        return materials.wood(rng, textured=False)
    if kind == 3:
        return dataclasses.replace(face)
    if kind == 4:
        return plain(materials.hsv(rng, (0, 1), (0.4, 0.9), (0.4, 0.9)))
    return materials.dark(rng) if kind == 0 else materials.hardware(rng)


def draw_dispenser_plastic(rng: np.random.Generator) -> Material:
    """Draw the finish of a dispenser: white, grey, steel, dark or any colour."""
    kind = rng.choice(5, p=[0.28, 0.2, 0.18, 0.24, 0.1])
    if kind == 3:
        return plain(materials.hsv(rng, (0, 1), (0.35, 0.95), (0.4, 0.95)))
    makers = {0: materials.white_plastic, 1: materials.metal, 2: materials.dark}
    return makers.get(int(kind), materials.paint)(rng)


def draw_dispenser_accent(rng: np.random.Generator) -> Material:
    """Draw the finish of levers and keys: a vivid colour, dark or metal."""
    if rng.random() < 0.45:
        return plain(materials.hsv(rng, (0, 1), (0.6, 1), (0.4, 0.95)))
    return materials.dark(rng) if rng.random() < 0.5 else materials.hardware(rng)


def clear(rng: np.random.Generator) -> Material:
    """Draw glass or clear plastic, tinted by its contents."""
    if rng.random() < 0.5:
        return materials.glass(rng)
    return plain(materials.hsv(rng, (0, 1), (0.15, 0.5), (0.75, 0.95)))


def contrast(tone: Material) -> Material:
    """The finish of marks on knobs: white on a dark ``tone``, black on a bright one."""
    return plain((0.95, 0.95, 0.95) if tone.color[1] < 0.5 else (0.1, 0.1, 0.1))

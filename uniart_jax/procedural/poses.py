"""How small things lie or stand: a rotation of the whole object."""

from __future__ import annotations

import numpy as np

from uniart_jax.procedural.shapes import about_z


def pose(rng: np.random.Generator, lying: bool = False, tilt: float = 0.7) -> np.ndarray:
    """A rotation [4, 4]: flat on a table, or with the flat side to the front; any way round
    in steps of a quarter turn, or up to ``tilt`` radians off one."""
    angle = np.pi / 2 * int(rng.integers(4)) + float(rng.choice([0.0, rng.uniform(-tilt, tilt)]))
    matrix = about_z(angle)
    if lying or rng.random() < 0.4:
        return matrix
    stand = np.array([[0.0, 0, -1, 0], [0, -1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]])
    return stand @ matrix

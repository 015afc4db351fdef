"""Which way an object faces: others' assets turned so that their front is at -x, as ours."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.object import ArticulatedObject

FRONTS = ("-x", "+y", "+x", "-y")  # a quarter turn about z takes each to the one before it
_QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def check_front(front: str, where: str) -> None:
    """Raises ValueError unless ``front`` is one of ``FRONTS``; ``where`` begins the line."""
    if front not in FRONTS:
        raise ValueError(f"{where} must be one of {', '.join(FRONTS)}, got '{front}'")


def faced(obj: ArticulatedObject, front: str) -> ArticulatedObject:
    """The object turned about z so that what faces ``front`` (one of ``FRONTS``) in its own frame
    faces -x."""
    if front == FRONTS[0]:
        return obj
    turn = np.eye(4)
    turn[:3, :3] = np.linalg.matrix_power(_QUARTER, FRONTS.index(front))
    return obj.transformed(turn)

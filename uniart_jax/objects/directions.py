"""Directions spread over the sphere, the same every time."""

from __future__ import annotations

import functools

import numpy as np


@functools.lru_cache(4)
def directions(count: int) -> np.ndarray:
    """[count, 3] unit vectors, evenly over the sphere (a Fibonacci spiral); treat them as
    read-only."""
    index = np.arange(count) + 0.5
    height, angle = 1 - 2 * index / count, np.pi * (1 + 5**0.5) * index
    radius = np.sqrt(1 - height**2)
    found = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], -1)
    found.setflags(write=False)
    return found

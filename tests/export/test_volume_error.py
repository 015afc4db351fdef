"""The error of convex shapes is measured right."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from uniart_jax.export.physics import Box
from uniart_jax.export.volume_error import volume_error


def slab(lo, hi) -> Box:
    lo, hi = np.asarray(lo, float), np.asarray(hi, float)
    return Box((lo + hi) / 2, hi - lo, np.eye(3))


def test_the_error_is_what_is_too_much_and_too_little():
    block = trimesh.creation.box(bounds=[[0, 0, 0], [1, 1, 1]])
    assert volume_error(block, [slab([0, 0, 0], [1, 1, 1])]) == 0
    half = volume_error(block, [slab([0, 0, 0], [1, 1, 0.5])])
    double = volume_error(block, [slab([0, 0, 0], [1, 1, 2])])
    assert half == pytest.approx(0.5, abs=0.01)
    assert double == pytest.approx(1.0, abs=0.01)

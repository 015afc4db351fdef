"""The error of convex shapes is measured right."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from uniart_jax.export.physics import Box
from uniart_jax.export.volume_error import is_open, volume_error


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


def test_of_a_surface_with_a_rim_finer_shapes_tell_what_is_full():
    block = trimesh.creation.box(bounds=[[0, 0, 0], [1, 1, 1]])
    cup = trimesh.Trimesh(block.vertices, block.faces[block.face_normals[:, 2] < 0.5])
    assert is_open(cup) and not is_open(block)
    apart = trimesh.Trimesh(block.triangles.reshape(-1, 3), np.arange(36).reshape(-1, 3))
    assert not is_open(apart)  # each face has corners of its own
    whole, floor = [slab([0, 0, 0], [1, 1, 1])], [slab([0, 0, 0], [1, 1, 0.1])]
    assert volume_error(cup, whole) == 0
    assert volume_error(cup, floor, floor) == 0
    assert volume_error(cup, whole, floor) == pytest.approx(0.9, abs=0.01)

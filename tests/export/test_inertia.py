"""Masses and tensors: exact on boxes, possible on everything."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from uniart_jax.export.inertia import DENSITY, MASS_FLOOR, inertial, physical


def is_physical(tensor: np.ndarray) -> bool:
    moments = np.linalg.eigvalsh(tensor)
    return bool(moments[0] > 0 and moments[0] + moments[1] >= moments[2])


def test_box_is_exact():
    size = np.array([0.4, 0.6, 0.2])
    box = trimesh.creation.box(size)
    box.apply_translation([1, 2, 3])
    body = inertial(box)
    mass = DENSITY * size.prod()
    assert body.mass == pytest.approx(mass)
    np.testing.assert_allclose(body.center, [1, 2, 3], atol=1e-9)
    np.testing.assert_allclose(
        body.inertia, np.diag(mass / 12 * ((size**2).sum() - size**2)), rtol=1e-6, atol=1e-9
    )


def test_inside_out_mesh_weighs_the_same():
    box = trimesh.creation.box([0.4, 0.6, 0.2])
    expected = inertial(box)
    box.invert()
    body = inertial(box)
    assert body.mass == pytest.approx(expected.mass)
    np.testing.assert_allclose(body.inertia, expected.inertia, atol=1e-12)


def test_flat_and_tiny_meshes_get_floors():
    sheet = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    line = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], process=False)
    for mesh in (sheet, line, trimesh.creation.box([1e-6] * 3)):
        body = inertial(mesh)
        assert body.mass >= MASS_FLOOR
        assert np.isfinite(body.center).all()
        assert is_physical(body.inertia)


def test_open_mesh_is_taken_as_its_hull():
    box = trimesh.creation.box([1, 1, 1])
    box.update_faces(np.arange(len(box.faces)) > 1)
    assert inertial(box).mass == pytest.approx(DENSITY)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(-10, 10), min_size=6, max_size=6), st.floats(1e-8, 1))
def test_any_tensor_becomes_physical(values, floor):
    a, b, c, d, e, f = values
    tensor = physical(np.array([[a, d, e], [d, b, f], [e, f, c]]), floor)
    assert is_physical(tensor)
    assert np.linalg.eigvalsh(tensor)[0] >= floor * (1 - 1e-6)
    np.testing.assert_array_equal(tensor, tensor.T)


def test_physical_leaves_sound_tensors_alone():
    sound = np.diag([2.0, 3.0, 4.0])
    np.testing.assert_allclose(physical(sound, 1e-8), sound)

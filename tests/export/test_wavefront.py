"""OBJ files: corners sharp where the surface is, smooth where it is round."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from uniart_jax.export.atlas import Surface
from uniart_jax.export.wavefront import corner_normals, write_textured


def surface(mesh: trimesh.Trimesh) -> Surface:
    faces = np.asarray(mesh.faces)
    return Surface(np.asarray(mesh.vertices), faces, np.zeros((1, 2)), np.zeros_like(faces))


def test_a_box_keeps_its_edges_and_a_ball_is_smooth():
    box = trimesh.creation.box([1, 2, 3])
    normals, index = corner_normals(surface(box))
    assert len(normals) == 6
    np.testing.assert_allclose(
        normals[index], np.repeat(box.face_normals[:, None], 3, 1), atol=1e-4
    )
    ball = trimesh.creation.icosphere(3)
    normals, index = corner_normals(surface(ball))
    np.testing.assert_allclose(normals[index], ball.vertices[ball.faces], atol=0.03)


def test_flat_and_degenerate_faces_have_finite_normals():
    mesh = trimesh.Trimesh(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]], [[0, 1, 2], [0, 1, 3]], process=False
    )
    normals, index = corner_normals(surface(mesh))
    assert np.isfinite(normals).all() and index.shape == (2, 3)
    np.testing.assert_allclose(normals[index[0]], [[0, 0, 1]] * 3, atol=1e-4)


def test_the_file_holds_them_and_stays_closed(tmp_path):
    box = trimesh.creation.box([1, 2, 3])
    write_textured(surface(box), tmp_path / "box.obj", 0.5)
    text = (tmp_path / "box.obj").read_text()
    assert text.count("\nvn ") == 6 and text.count("\nv ") == 8
    read = trimesh.load_mesh(tmp_path / "box.obj", process=False)
    read.merge_vertices(merge_tex=True, merge_norm=True)
    assert read.is_watertight and read.volume == pytest.approx(6 / 8)

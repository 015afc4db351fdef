import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from uniart_jax.voxels import nearest
from uniart_jax.voxels.grid import subcell_centers
from uniart_jax.voxels.nearest import Triangles, nearest_faces, tree_query
from uniart_jax.voxels.overlap import touched_cells


def ask(vertices, faces, resolution, subdivisions):
    _, cells = touched_cells((vertices[faces] + 0.5) * resolution, resolution)
    coords = np.unique(cells, axis=0)
    triangles = Triangles(vertices, faces)
    result = nearest_faces(vertices, faces, triangles, coords, resolution, subdivisions)
    return subcell_centers(coords, resolution, subdivisions), *result, triangles


@pytest.mark.parametrize("subdivisions", [1, 2, 3, 4, 6])
def test_distance_is_that_of_a_box_tree(subdivisions):
    rng = np.random.default_rng(subdivisions)
    vertices, faces = rng.uniform(-0.5, 0.5, (30, 3)), rng.integers(0, 30, (14, 3))
    points, distance, face, triangles = ask(vertices, faces, 6, subdivisions)
    squared, _, _ = tree_query(vertices, faces, points.reshape(-1, 3))
    np.testing.assert_allclose(distance.ravel(), np.sqrt(squared), atol=2e-6, rtol=1e-5)
    # and the face that it names is that far away
    weight = triangles.barycentric(face.ravel(), points.reshape(-1, 3).astype(np.float32))
    on = np.einsum("nk,nkc->nc", weight, vertices[faces[face.ravel()]])
    reached = np.linalg.norm(on - points.reshape(-1, 3), axis=1)
    np.testing.assert_allclose(reached, np.sqrt(squared), atol=2e-6, rtol=1e-5)


def test_fine_meshes_go_to_the_tree_and_agree(monkeypatch):
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.45)
    vertices, faces = np.array(ball.vertices), np.array(ball.faces)
    _, blocks, _, _ = ask(vertices, faces, 8, 4)
    monkeypatch.setattr(nearest, "MAX_LISTED", 0)
    _, tree, _, _ = ask(vertices, faces, 8, 4)
    np.testing.assert_allclose(blocks, tree, atol=2e-6)


def test_ties_go_to_the_lowest_face():
    vertices = np.array([[0, -0.4, -0.4], [0, 0.4, -0.4], [0, 0, 0.4]])
    faces = np.array([[0, 1, 2], [0, 2, 1], [1, 2, 0]])
    _, _, face, _ = ask(vertices, faces, 8, 4)
    assert (face == 0).all()


coordinate = st.floats(-0.5, 0.5, width=16)
point = st.tuples(coordinate, coordinate, coordinate)


@settings(max_examples=100, deadline=None)
@given(st.tuples(point, point, point), point)
def test_any_triangle_flat_ones_too(corners, query):
    vertices, faces = np.array(corners), np.array([[0, 1, 2]])
    query = np.array([query])
    triangles = Triangles(vertices, faces)
    squared = triangles.squared_distance(
        np.zeros(1, int), query.astype(np.float32), np.zeros((1, 3), np.float32)
    )
    expected, _, _ = tree_query(vertices, faces, query)
    assert np.sqrt(squared[0, 0]) == pytest.approx(np.sqrt(expected[0]), abs=1e-5)
    weight = triangles.barycentric(np.zeros(1, int), query.astype(np.float32))[0]
    assert weight.sum() == pytest.approx(1, abs=1e-4)
    assert np.linalg.norm(weight @ vertices - query[0]) == pytest.approx(
        np.sqrt(expected[0]), abs=2e-4
    )

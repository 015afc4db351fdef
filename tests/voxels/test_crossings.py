import igl
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from uniart_jax.voxels.crossings import NUDGE, lattice_windings, lid, windings

HERE = 1e-8 * NUDGE


def corners(mesh):
    return np.array(mesh.vertices)[np.array(mesh.faces)]


def closing(vertices, faces):
    _, names = trimesh.grouping.unique_rows(vertices, digits=9)
    return lid(vertices, faces, names)


def exact(triangles, points):
    faces = np.arange(3 * len(triangles)).reshape(-1, 3)
    return igl.winding_number(triangles.reshape(-1, 3), faces, points)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**31), st.integers(1, 30), st.booleans())
def test_any_triangles_with_their_lid_bound_a_volume(seed, count, welded):
    """Soups, fans, edges of three faces, repeated and turned faces: with the lid every winding
    number is an integer, the counted one."""
    rng = np.random.default_rng(seed)
    vertices = rng.uniform(-0.5, 0.5, (12 if welded else 3 * count, 3))
    faces = rng.integers(0, len(vertices), (count, 3))
    closed = np.concatenate([vertices[faces], closing(vertices, faces)])
    points = rng.uniform(-0.4, 0.4, (50, 3))
    expected = exact(closed, points)
    np.testing.assert_allclose(expected, np.rint(expected), atol=1e-6)
    np.testing.assert_array_equal(windings(closed, points, HERE), np.rint(expected))


def test_a_volume_has_no_lid_and_a_border_one_of_its_edges():
    ball = trimesh.creation.icosphere(2, 0.4)
    assert not len(closing(np.array(ball.vertices), np.array(ball.faces)))
    apart = corners(ball).reshape(-1, 3)  # no vertex is shared, but for its place
    assert not len(closing(apart, np.arange(len(apart)).reshape(-1, 3)))
    ball.update_faces(ball.triangles_center[:, 2] < 0.1)
    edges = trimesh.grouping.group_rows(ball.edges_sorted, require_count=1)
    assert len(closing(np.array(ball.vertices), np.array(ball.faces))) == len(edges) - 2


def test_triangles_of_a_lid_are_as_small_as_the_border_allows():
    """Half of them span two edges, a quarter four, ...: a hierarchy tells them apart from afar."""
    angle = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    rim = np.c_[np.cos(angle), np.sin(angle), 0 * angle] * 0.4
    k = np.arange(64)
    wall = np.concatenate([np.c_[k, (k + 1) % 64, np.full(64, 64)]])
    found = closing(np.concatenate([rim, [[0, 0, 0.5]]]), wall)
    longest = np.linalg.norm(np.roll(found, -1, 1) - found, axis=2).max(1)
    assert len(found) == 62 and (longest < 0.08).sum() == 32


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_lattice_and_points_count_alike(turn):
    """Boxes flush with each other and with the lattice, one turned inside out."""
    pieces = [
        trimesh.creation.box(bounds=b) for b in ([[-0.25] * 3, [0.25] * 3], [[0] * 3, [0.375] * 3])
    ]
    pieces.append(trimesh.creation.icosphere(2, 0.3))
    pieces[-1].invert()
    mesh = trimesh.util.concatenate(pieces)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(turn, [1, 2, 3]))
    low, shape = np.array([1, 2, 3]), np.array([14, 12, 11])
    found = lattice_windings(corners(mesh), low, shape, 16)
    cells = np.indices(shape).reshape(3, -1).T + low
    points = (cells + 0.5) / 16 - 0.5
    np.testing.assert_array_equal(found.ravel(), windings(corners(mesh), points, NUDGE / 16))
    expected = exact(corners(mesh), points + NUDGE / 16)
    np.testing.assert_array_equal(found.ravel(), np.rint(expected))
    assert {-1, 0, 1} <= set(found.ravel().tolist())


def test_no_points_no_numbers():
    assert windings(corners(trimesh.creation.box()), np.zeros((0, 3)), HERE).shape == (0,)

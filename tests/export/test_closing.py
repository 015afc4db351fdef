"""Sheets with a thickness: every edge has two faces, what is seen stays where it was, what was
closed is untouched."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from uniart_jax.export.closing import APART, THICKNESS, closed
from uniart_jax.simulation.soundness import surface

BOX = trimesh.creation.box()


def close(vertices, faces) -> trimesh.Trimesh:
    vertices = np.asarray(vertices, np.float64)
    side = float(np.ptp(vertices, axis=0).max())
    return trimesh.Trimesh(*closed(vertices, np.asarray(faces), side), process=False)


def tube(radius: float) -> trimesh.Trimesh:
    mesh = trimesh.creation.cylinder(radius, 1, sections=16)
    mesh.update_faces(np.abs(mesh.face_normals[:, 2]) < 0.5)
    mesh.remove_unreferenced_vertices()
    return mesh


SHEETS = {
    "square": ([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]]),
    "faces that disagree": ([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 3, 2]]),
    "three on an edge": ([[0, 0, 0], [0, 0, 1], [1, 0, 0], [-1, 0.2, 0], [0.1, 1, 0]], [[0, 1, 2], [0, 1, 3], [0, 1, 4]]),  # noqa: E501
    "two that meet in a point": ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], [[0, 1, 2], [0, 3, 4]]),  # noqa: E501
    "back to back": ([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]]),  # noqa: E501
    "box without a face": (BOX.vertices, BOX.faces[2:]),
    "tube": (tube(0.05).vertices, tube(0.05).faces),
    "narrow tube": (tube(0.002).vertices, tube(0.002).faces),
}  # fmt: skip


@pytest.mark.parametrize("name", SHEETS)
def test_sheets_become_solids(name):
    vertices, faces = SHEETS[name]
    solid = close(vertices, faces)
    found = surface(solid)
    assert (found.open, found.turned) == (0, 0)
    if name != "back to back":  # already bounds nothing: every edge has two faces
        assert found.volume > 0 and solid.is_volume
        assert trimesh.Trimesh(solid.vertices, solid.faces).is_watertight  # as a reader merges it
    distance = np.abs(np.asarray(solid.vertices)[:, None] - np.asarray(vertices, float)).max(-1)
    assert distance.min(1).max() <= THICKNESS * 2 * np.ptp(vertices, axis=0).max()


def test_what_is_seen_stays_and_the_layer_lies_behind():
    vertices, faces = SHEETS["square"]
    solid = close(vertices, faces)
    np.testing.assert_allclose(solid.vertices[:4], vertices, atol=3 * APART)
    assert solid.bounds[1, 2] <= 0 and solid.bounds[0, 2] == pytest.approx(-THICKNESS, rel=0.01)
    assert solid.volume == pytest.approx(THICKNESS, rel=0.01)


def test_what_is_closed_is_untouched():
    vertices, faces = closed(BOX.vertices, BOX.faces, 1.0)
    assert vertices is BOX.vertices and np.array_equal(faces, BOX.faces)
    moved = np.concatenate([BOX.vertices, np.asarray(BOX.vertices) + [3, 0, 0]])
    both = np.concatenate([BOX.faces, np.asarray(BOX.faces)[2:] + 8])
    solid = close(moved, both)
    assert len(solid.faces) == 12 + 10 * 2 + 4 * 2
    whole, sheet = sorted(solid.split(), key=lambda m: m.bounds[0, 0])
    assert whole.volume == pytest.approx(1.0, abs=1e-12) and len(whole.faces) == 12
    assert 0 < sheet.volume < 0.1


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.02, 0.98), st.floats(0, 0.5))
def test_any_faces_of_any_surface(seed, kept, flipped):
    """A sphere and a box that share no vertex, faces left out and turned at random."""
    rng = np.random.default_rng(seed)
    ball = trimesh.creation.icosphere(2)
    mesh = trimesh.util.concatenate([ball, BOX.copy().apply_translation([2.5, 0, 0])])
    faces = np.asarray(mesh.faces)[rng.random(len(mesh.faces)) < kept]
    if not len(faces):
        return
    turned = rng.random(len(faces)) < flipped
    faces[turned] = faces[turned][:, ::-1]
    found = surface(close(mesh.vertices, faces))
    assert (found.open, found.turned) == (0, 0)
    assert found.volume > 0
    solid = close(mesh.vertices, faces)
    assert solid.is_watertight and trimesh.Trimesh(solid.vertices, solid.faces).is_watertight


@pytest.mark.parametrize("shift", [(1, 0, 0), (1, 1, 0), (1, 1, 1)], ids=["face", "edge", "corner"])
@pytest.mark.parametrize("flipped", [False, True])
def test_solids_that_touch_stay_solid(shift, flipped):
    both = trimesh.util.concatenate([BOX, BOX.copy().apply_translation(shift)])
    both.merge_vertices()
    faces = np.asarray(both.faces).copy()
    if flipped:
        faces[3] = faces[3][::-1]
    vertices, out = closed(np.asarray(both.vertices), faces, 2.0)
    assert len(out) == 24
    assert surface(trimesh.Trimesh(vertices, out, process=False)).volume == pytest.approx(2.0)


def test_a_sheet_that_touches_a_solid_leaves_it_whole():
    flap = trimesh.Trimesh([[0.5, 0.5, -0.5], [0.5, 0.5, 0.5], [1.5, 1, 0.5]], [[0, 1, 2]])
    both = trimesh.util.concatenate([BOX, flap])
    both.merge_vertices()
    solid = close(both.vertices, both.faces)
    assert len(solid.faces) == 12 + 8 and solid.is_watertight
    assert solid.volume == pytest.approx(1 + flap.area * 2 * THICKNESS, abs=1e-3)


@pytest.mark.parametrize("turn", [0.0, 1e-6, 1e-5, 0.3, 3.1416])
def test_a_flat_sheet_is_as_thick_however_it_lies(turn):
    vertices, faces = SHEETS["square"]
    matrix = trimesh.transformations.rotation_matrix(turn, [1, 0.3, 0.2])
    moved = trimesh.transform_points(np.asarray(vertices, float), matrix)
    solid = trimesh.Trimesh(*closed(moved, np.asarray(faces), 1.0), process=False)
    assert solid.volume == pytest.approx(THICKNESS, rel=0.01)


def test_a_narrow_tube_has_a_thin_wall():
    mesh = tube(0.0012)  # its wall would come out on the other side at the usual thickness
    solid = close(mesh.vertices, mesh.faces)
    radius = np.linalg.norm(solid.vertices[:, :2], axis=1)
    assert radius.min() > 0.0005 and radius.max() < 0.0012 + 1e-9
    assert 0 < solid.volume < np.pi * 0.0012**2

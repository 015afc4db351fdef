"""Surfaces and files judged without an engine."""

from __future__ import annotations

import os

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from lxml import etree

from uniart_jax.objects.asset_files import AssetFiles
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.objects.robot import Geometry, Link, Robot
from uniart_jax.simulation.measure import impossible, number
from uniart_jax.simulation.soundness import finite_check, gaps, mesh_checks, surface

SHAPES = st.one_of(
    st.builds(lambda s: trimesh.creation.box(s), st.lists(st.floats(0.01, 100), min_size=3, max_size=3)),  # noqa: E501
    st.builds(lambda r, n: trimesh.creation.icosphere(n, r), st.floats(0.01, 10), st.integers(0, 2)),  # noqa: E501
    st.builds(lambda r: trimesh.creation.annulus(r, 2 * r, r), st.floats(0.01, 10)),
)  # fmt: skip


@settings(max_examples=40, deadline=None)
@given(SHAPES, st.integers(0, 10_000))
def test_a_closed_surface_is_told_from_one_with_a_hole_or_a_turned_face(mesh, pick):
    seams = trimesh.Trimesh(
        mesh.vertices[mesh.faces].reshape(-1, 3),
        np.arange(3 * len(mesh.faces)).reshape(-1, 3),
        process=False,
    )
    for closed in (mesh, seams):
        found = surface(closed)
        assert (found.open, found.turned) == (0, 0)
        assert found.volume == pytest.approx(mesh.volume, rel=1e-6)
    face = pick % len(mesh.faces)
    holed = trimesh.Trimesh(mesh.vertices, np.delete(mesh.faces, face, 0), process=False)
    assert surface(holed).open == 3
    faces = mesh.faces.copy()
    faces[face] = faces[face][::-1]
    turned = surface(trimesh.Trimesh(mesh.vertices, faces, process=False))
    assert (turned.open, turned.turned) == (0, 3)
    assert surface(trimesh.Trimesh(mesh.vertices, mesh.faces[:, ::-1], process=False)).volume < 0


def test_two_blocks_that_share_an_edge_are_closed():
    blocks = [trimesh.creation.box(bounds=[[x, x, 0], [x + 1, x + 1, 1]]) for x in (0, 1)]
    both = surface(trimesh.util.concatenate(blocks))
    assert (both.open, both.turned) == (0, 0) and both.volume == pytest.approx(2)


def test_a_wall_inside_leaves_a_surface_open():
    """Two tetrahedra on either side of one triangle: three faces at each of its edges, two at all
    others."""
    vertices = [[1, 0, 0], [-1, 1, 0], [-1, -1, 0], [0, 0, 1], [0, 0, -1]]
    upper = [[i, (i + 1) % 3, 3] for i in range(3)]
    lower = [[(i + 1) % 3, i, 4] for i in range(3)]
    assert surface(trimesh.Trimesh(vertices, [*upper, *lower], process=False)).open == 0
    assert surface(trimesh.Trimesh(vertices, [*upper, *lower, [0, 1, 2]], process=False)).open == 3


def test_a_mesh_that_was_repaired_is_judged_anew(tmp_path):
    path = tmp_path / "m.obj"
    good = "v 0.0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    shape = Geometry("mesh", np.ones(3), np.eye(4), "m.obj")
    robot = Robot("r", {"a": Link("a", [shape], [])}, [], [])
    for text, passed in ((good, True), (good.replace("0.0", "nan", 1), False), (good, True)):
        path.write_text(text)
        os.utime(path, (1, 1))  # the same size and the same time
        checks = mesh_checks(robot, AssetFiles(tmp_path, False))
        assert checks["finite_meshes"]["passed"] == passed


@given(st.floats(0, 0.05), st.booleans())
@settings(max_examples=20, deadline=None)
def test_a_gap_is_the_distance_of_a_part_with_all_that_hangs_on_it(distance, carried):
    body = trimesh.creation.box(bounds=[[0, 0, 0], [1, 1, 1]])
    door = trimesh.creation.box(bounds=[[-0.1 - distance, 0, 0], [-distance, 1, 1]])
    knob = trimesh.creation.box(bounds=[[-0.2 - distance, 0.4, 0.4], [-0.1 - distance, 0.6, 0.6]])
    parts = [Part("body", body), Part("door", door, 0, Joint([-distance, 0, 0], [0, 0, 1], (0, 1)))]
    parts += [Part("knob", knob, 1)] if carried else []
    found = gaps(ArticulatedObject(tuple(parts)))
    size = max(1.0, (1.2 if carried else 1.1) + distance)
    assert found["value"] == pytest.approx(distance / size, abs=2e-5)
    assert found["passed"] == (found["value"] <= 0.02)
    assert found["passed"] or "part 'door'" in found["reason"]


@pytest.mark.parametrize(("mass", "moments", "words"), [
    (1.0, (1, 1, 1), ""),
    (1.0, (1, 1, 1.9), ""),
    (0.0, (1, 1, 1), "mass 0"),
    (-1.0, (1, 1, 1), "mass -1"),
    (1.0, (0, 1, 1), "positive definite"),
    (1.0, (1, 1, 2.1), "triangle inequality"),
    (float("nan"), (1, 1, 1), "finite"),
])  # fmt: skip
def test_inertia_that_no_solid_has(mass, moments, words):
    found = impossible(mass, np.array(moments))
    assert (found == "") == (words == "") and words in found


def test_numbers_are_json():
    assert [number(x) for x in (np.nan, np.inf, -np.inf, 1 / 3)] == [1e9, 1e9, -1e9, 0.33333]


@pytest.mark.parametrize(("text", "words"), [
    ('<joint name="j"><origin xyz="0 NaN 0"/></joint>', "joint 'j'"),
    ('<link name="l"><inertial><mass value="inf"/></inertial></link>', "link 'l'"),
    ('<joint name="nan"><limit effort="inf" velocity="inf" lower="0" upper="1"/></joint>', ""),
    ('<link name="l"><visual><geometry><mesh filename="nan.obj"/></geometry></visual></link>', ""),
])  # fmt: skip
def test_numbers_that_are_none_are_found_where_they_stand(text, words):
    found = finite_check(etree.fromstring(f"<robot>{text}</robot>"))
    assert found["passed"] == (not words) and words in found.get("reason", "")

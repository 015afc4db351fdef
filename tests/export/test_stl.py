"""The STL files: closed, in millimetres, at rest, on the ground; what is not closed is named."""

from __future__ import annotations

import struct

import numpy as np
import pytest
import trimesh
from asset_objects import make_cabinet
from hand_bodies import make_surface
from hypothesis import given, settings
from hypothesis import strategies as st

from uniart_jax.export.stl import write_stl
from uniart_jax.objects.object import ArticulatedObject, Part


def stems(obj: ArticulatedObject) -> list[str]:
    return [f"part{k}" for k in range(len(obj.parts))]


def written(obj: ArticulatedObject, folder) -> tuple[str, ...]:
    return write_stl(obj, folder, [make_surface(p.mesh) for p in obj.parts], stems(obj))


@pytest.fixture(scope="module")
def cabinet():
    return make_cabinet()


@pytest.fixture(scope="module")
def folder(cabinet, tmp_path_factory):
    where = tmp_path_factory.mktemp("stl") / "new" / "stl"
    assert written(cabinet, where) == ()
    return where


def test_every_part_is_a_closed_file_in_millimetres(cabinet, folder):
    assert {p.name for p in folder.iterdir()} == {f"{s}.stl" for s in stems(cabinet)}
    at_rest = cabinet.forward_kinematics(cabinet.rest())
    for part, stem, matrix in zip(cabinet.parts, stems(cabinet), at_rest, strict=True):
        mesh = trimesh.load_mesh(folder / f"{stem}.stl")  # merges equal places, as slicers do
        assert mesh.is_watertight and mesh.is_winding_consistent
        solid = trimesh.Trimesh(part.mesh.vertices, part.mesh.faces)
        assert mesh.volume == pytest.approx(solid.volume * (1000 * cabinet.scale) ** 3, rel=1e-4)
        points = trimesh.transform_points(part.mesh.vertices, matrix) * 1000 * cabinet.scale
        meant = np.stack([points.min(0), points.max(0)])
        meant[:, 2] -= meant[0, 2]
        np.testing.assert_allclose(mesh.bounds, meant, atol=1e-3)
        assert mesh.bounds[0, 2] == 0


def test_files_are_binary_and_say_their_unit(cabinet, folder):
    for part, stem in zip(cabinet.parts, stems(cabinet), strict=True):
        data = (folder / f"{stem}.stl").read_bytes()
        header = data[:80].decode("ascii")
        assert not header.startswith("solid") and "millimetre" in header and part.name in header
        (count,) = struct.unpack("<I", data[80:84])
        assert len(data) == 84 + 50 * count and count == len(part.mesh.faces)


def test_what_is_not_closed_is_named_and_left_out(tmp_path):
    box = trimesh.creation.box()
    opened = box.copy()
    opened.update_faces(np.arange(10))
    sheet = trimesh.Trimesh(
        [[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 1, 2], [0, 2, 1]], process=False
    )
    turned = box.copy()
    turned.faces[0] = turned.faces[0][::-1]
    obj = ArticulatedObject(
        (
            Part("good", box),
            Part("opened", opened, 0),
            Part("sheet", sheet, 0),
            Part("turned", turned, 0),
        )
    )
    assert written(obj, tmp_path) == tuple(
        f"STL: part '{name}' is not closed and was left out" for name in obj_names(obj)[1:]
    )
    assert [p.name for p in tmp_path.iterdir()] == ["part0.stl"]


def obj_names(obj: ArticulatedObject) -> list[str]:
    return [p.name for p in obj.parts]


def test_an_inside_out_part_is_turned(tmp_path):
    box = trimesh.creation.box()
    box.invert()
    assert written(ArticulatedObject((Part("box", box),)), tmp_path) == ()
    assert trimesh.load_mesh(tmp_path / "part0.stl").volume == pytest.approx(1e9)


def test_an_edge_shorter_than_rounding_is_closed(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=1)
    points = ball.vertices + [5.0, 0, 0]
    first, second = ball.edges_unique[0]
    points[first] = points[second] + [1e-9, 0, 0]
    short = trimesh.Trimesh(points, ball.faces, process=False)
    assert written(ArticulatedObject((Part("ball", short),)), tmp_path) == ()
    assert len(trimesh.load_mesh(tmp_path / "part0.stl").faces) == len(ball.faces) - 2


@settings(max_examples=25)
@given(
    scale=st.sampled_from([1e-3, 0.2, 3.0]),
    away=st.floats(-50, 50),
    name=st.text(max_size=100),
    sections=st.integers(8, 60),
)
def test_rounding_to_floats_leaves_no_hole(tmp_path_factory, scale, away, name, sections):
    """Far from the origin short edges fall together: the file is closed nevertheless, or the part
    is named."""
    mesh = trimesh.creation.torus(0.4, 0.1, major_sections=sections, minor_sections=8)
    mesh.apply_translation([away, away / 3, 0])
    folder = tmp_path_factory.mktemp("far")
    notes = written(ArticulatedObject((Part(name, mesh),), scale=scale), folder)
    assert len(notes) + len(list(folder.iterdir())) == 1
    for path in folder.iterdir():
        assert trimesh.load_mesh(path).is_watertight


def test_lists_that_do_not_fit_are_refused(cabinet, tmp_path):
    with pytest.raises(ValueError, match="surfaces has 0 entries for 6 parts"):
        write_stl(cabinet, tmp_path / "a", [], stems(cabinet))
    with pytest.raises(ValueError, match="stems has 1 entries for 6 parts"):
        write_stl(cabinet, tmp_path / "a", [make_surface(p.mesh) for p in cabinet.parts], ["a"])
    assert not (tmp_path / "a").exists()

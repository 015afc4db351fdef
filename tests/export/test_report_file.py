"""``report.json`` agrees with the files beside it."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh

from uniart_jax.export.asset import save_asset
from uniart_jax.export.closing import is_bounded
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.load import load_object
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.simulation.soundness import surface

pytestmark = pytest.mark.usefixtures("small_pictures")


def edge_counts(path) -> np.ndarray:
    """How many faces each edge of an OBJ has, as its indices of positions say, and then as the
    positions themselves do."""
    rows = [line.split() for line in path.read_text().splitlines()]
    points = np.array([row[1:4] for row in rows if row[:1] == ["v"]], float)
    faces = np.array([[c.split("/")[0] for c in r[1:4]] for r in rows if r[:1] == ["f"]], int) - 1
    same = np.unique(points, axis=0, return_inverse=True)[1].reshape(-1)
    found = []
    for corners in (faces, same[faces]):
        edges = np.sort(corners[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        found.append(np.unique(edges, axis=0, return_counts=True)[1])
    return np.concatenate(found)


def shapes() -> dict[str, trimesh.Trimesh]:
    """Closed; two closed boxes that share an edge; a surface with a hole; faces without shared
    vertices; of 2 cm, far away."""
    box = trimesh.creation.box
    beside = box().apply_translation([1, 1, 0])
    bowl = box(extents=[1, 1, 1])
    bowl.update_faces(bowl.triangles_center[:, 2] < 0.49)
    soup = trimesh.Trimesh(
        box().triangles.reshape(-1, 3), np.arange(36).reshape(-1, 3), process=False
    )
    small = trimesh.creation.icosphere(2, 1e-2).apply_translation([9, 9, 9])
    return {
        "box": box(),
        "joined": trimesh.util.concatenate([box(), beside]),
        "bowl": bowl,
        "soup": soup,
        "small": small,
    }


@pytest.mark.parametrize("scale", [1.0, 1e-3])
def test_watertight_is_what_the_edges_of_the_written_file_say(tmp_path, scale):
    parts = [
        Part(name, mesh.apply_translation([3 * k, 0, 0]), min(k, 1) - 1)
        for k, (name, mesh) in enumerate(shapes().items())
    ]
    out = save_asset(
        ArticulatedObject(tuple(parts), scale), tmp_path / "a", formats=(), motion=False
    )
    told = {
        p["name"]: p["watertight"] for p in json.loads((out / "report.json").read_text())["parts"]
    }
    files = {name: out / f"meshes/{name}.obj" for name in told}
    counted = {name: bool((edge_counts(path) % 2 == 0).all()) for name, path in files.items()}
    assert told == counted
    judged = {name: surface(trimesh.load(path, process=False)) for name, path in files.items()}
    assert told == {name: found.open == 0 for name, found in judged.items()}
    assert all(told.values()) and not is_bounded(shapes()["bowl"].faces)


def test_a_surface_that_stays_open_is_told_so(tmp_path, monkeypatch):
    monkeypatch.setattr("uniart_jax.export.asset.is_bounded", lambda faces: len(faces) > 12)
    parts = (
        Part("ball", trimesh.creation.icosphere(1)),
        Part("box", trimesh.creation.box().apply_translation([3, 0, 0]), 0),
    )
    out = save_asset(ArticulatedObject(parts), tmp_path / "a", formats=(), motion=False)
    told = json.loads((out / "report.json").read_text())["parts"]
    assert [part["watertight"] for part in told] == [True, False]


@pytest.mark.slow
def test_surfaces_found_on_voxels_are_known_again(tmp_path):
    """So what is made of them next is made of cells too; a report that is broken says nothing."""
    for made in (True, False):
        obj = ArticulatedObject((Part("box", trimesh.creation.box()),), from_voxels=made)
        out = save_asset(obj, tmp_path / str(made), formats=("mjcf",), motion=False)
        assert json.loads((out / "report.json").read_text())["from_voxels"] == made
        assert load_object(out).from_voxels == made
        assert load_object(out / "object.xml").from_voxels == made
    out = tmp_path / "True"
    for text in ("[" * 100_000, "[]", '{"from_voxels": "yes"}'):
        (out / "report.json").write_text(text)
        assert not load_object(out).from_voxels
    (out / "report.json").unlink()
    assert not load_object(out).from_voxels


def test_a_part_whose_name_is_a_blank_is_written_and_read(tmp_path):
    box = trimesh.creation.box()
    hinge = Joint(np.array([0.5, 0.5, 0]), np.array([0, 0, 1.0]), (0, 1))
    door = Part(" ", box.copy().apply_translation([2, 0, 0]), 0, hinge)
    out = save_asset(
        ArticulatedObject((Part("body of it", box), door)),
        tmp_path / "a",
        formats=("mjcf",),
        motion=False,
    )
    rows = json.loads((out / "report.json").read_text())["parts"]
    assert [row["as_read"]["name"] for row in rows] == ["body of it", " "]
    for file in ("object.urdf", "object.xml"):
        read = load_object(out / file)
        assert [p.name for p in read.parts] == ["body of it", "hinge_1"]
        assert read.parts[1].joint.type == "revolute"

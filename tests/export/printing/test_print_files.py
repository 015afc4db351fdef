"""The folder of a print: closed STL files in millimetres, flat on z = 0, and what its texts say."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
import trimesh
from hand_bodies import make_surface
from print_objects import box, door_box, knob_box, print_of, shell

from uniart_jax.export.placement import place
from uniart_jax.export.printing import write
from uniart_jax.export.printing.check import Held
from uniart_jax.export.printing.settings import PrintSettings
from uniart_jax.export.printing.write import write_print
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part


def written(obj: ArticulatedObject, folder, **settings):
    stood = place(obj).obj
    stems = [p.name for p in stood.parts]
    surfaces = [make_surface(p.mesh) for p in stood.parts]
    notes = write_print(stood, folder, surfaces, stems, PrintSettings(**settings))
    return notes, json.loads((folder / "print.json").read_text("utf-8"))


@pytest.fixture(scope="module")
def door(tmp_path_factory):
    folder = tmp_path_factory.mktemp("print") / "print"
    notes, report = written(door_box(), folder, size=120.0)
    return folder, notes, report


def meshes(folder, report) -> list[trimesh.Trimesh]:
    return [trimesh.load_mesh(folder / piece["file"]) for piece in report["pieces"]]


def test_every_piece_is_closed_and_lies_on_the_plate(door):
    folder, _, report = door
    names = {piece["file"] for piece in report["pieces"]}
    assert names == {"body.stl", "door.stl", "door_pin_1.stl", "door_pin_2.stl"}
    assert {p.name for p in folder.iterdir()} == names | {"print.json", "README.txt"}
    for piece, mesh in zip(report["pieces"], meshes(folder, report), strict=True):
        assert mesh.is_watertight and mesh.is_winding_consistent, piece["file"]
        assert mesh.volume == pytest.approx(piece["volume"], rel=1e-3)
        assert mesh.bounds[0, 2] == 0.0
        np.testing.assert_allclose(np.ptp(mesh.bounds, axis=0), piece["size"], atol=0.01)
        on_plate = mesh.triangles[:, :, 2].max(1) < 0.06
        assert mesh.area_faces[on_plate].sum() == pytest.approx(piece["on_plate"], rel=0.05)
        assert piece["on_plate"] > 5.0


def test_loaded_together_no_two_pieces_overlap(door):
    folder, _, report = door
    boxes = [mesh.bounds[:, :2] for mesh in meshes(folder, report)]
    for n, one in enumerate(boxes):
        for two in boxes[n + 1 :]:
            assert (np.maximum(one[0], two[0]) - np.minimum(one[1], two[1])).max() >= 4.9


def test_pieces_go_back_to_where_they_are_assembled_in_the_size_asked_for(door):
    folder, _, report = door
    body = report["pieces"][0]
    mesh = meshes(folder, report)[0]
    back = np.linalg.inv(np.array(body["assembled_to_plate"]))
    mesh.apply_transform(back)
    assert mesh.bounds[0, 2] == pytest.approx(0, abs=0.01)
    assert mesh.bounds[1, 2] == pytest.approx(120, abs=0.01)
    assert report["size"] == 120 and report["unit"] == "millimetre"


def test_the_order_of_assembly_is_the_trees(door):
    folder, _, report = door
    assert report["assembly"][0] == "Begin with body.stl."
    assert report["assembly"][1].startswith("Put door.stl to body.stl")
    assert "door_pin_1.stl, door_pin_2.stl" in report["assembly"][1]
    text = (folder / "README.txt").read_text("utf-8")
    for line in [*report["assembly"], *report["notes"]]:
        assert line in text
    (joint,) = report["joints"]
    assert joint["kind"] == "pin hinge" and joint["held_along"] and joint["pins_held"]
    assert joint["runs_into_parent_at"] == [] and joint["gap"] >= 0.27


def test_a_part_called_like_a_pin_keeps_its_file_and_its_step(tmp_path):
    base = door_box()
    turn = Joint([-0.335, -0.4, 1.25], [0, 0, 1], (0.0, 1.7))
    more = (
        Part("top", box([-0.3, -0.4, 1.0], [0.3, 0.4, 1.5]), 0),
        Part("door_pin_1", box([-0.335, -0.4, 1.02], [-0.303, 0.4, 1.48]), 0, turn),
    )
    _, report = written(ArticulatedObject((*base.parts, *more)), tmp_path / "names", size=150.0)
    files = [piece["file"] for piece in report["pieces"]]
    assert len(set(files)) == len(files)
    (own,) = [p for p in report["pieces"] if p["parts"] == ["door_pin_1"]]
    assert own["file"] == "door_pin_1.stl"
    mesh = trimesh.load_mesh(tmp_path / "names" / own["file"])
    assert mesh.volume == pytest.approx(own["volume"], rel=1e-3)
    (step,) = [s for s in report["assembly"] if s.startswith("Put door.stl")]
    assert "door_pin_2.stl" in step and "door_pin_1.stl" not in step


def test_thin_walls_are_told_in_plain_words(tmp_path):
    thin = ArticulatedObject((Part("case", shell([-0.3, -0.4, 0], [0.3, 0.4, 1.0], 0.006)),))
    notes, report = written(thin, tmp_path / "thin", size=100.0)
    (piece,) = report["pieces"]
    assert piece["thinnest_wall"] == pytest.approx(0.6, abs=0.02)
    assert piece["thin_area"] > 1000
    (note,) = notes
    assert "'case' has walls of 0.60 mm, thinner than 1.2 mm" in note
    assert "--print-size 20" in note  # 200, or 205 as the wall is measured
    notes, report = written(thin, tmp_path / "thick", size=210.0)
    assert notes == () and report["pieces"][0]["thin_area"] == 0
    assert "nothing" in (tmp_path / "thick" / "README.txt").read_text("utf-8")


def test_solids_that_touch_along_an_edge_are_written_closed(tmp_path):
    """Places alone tell an STL's corners apart: such an edge would have four faces."""
    one, two = box([0.0, 0.0, 0.0], [0.3, 0.3, 0.3]), box([0.3, 0.3, 0.0], [0.6, 0.6, 0.3])
    tied = box([0.0, 0.0, -0.2], [0.6, 0.6, 0.0])
    mesh = trimesh.boolean.union([one, two, tied], engine="manifold")
    _, report = written(ArticulatedObject((Part("body", mesh),)), tmp_path / "edge", size=60.0)
    (piece,) = report["pieces"]
    file = trimesh.load_mesh(tmp_path / "edge" / piece["file"])
    assert file.is_watertight and file.volume == pytest.approx(piece["volume"], rel=1e-3)
    assert report["notes"] == []


def test_a_plate_lies_on_its_broad_side(tmp_path):
    plate = ArticulatedObject((Part("plate", box([-0.02, -0.5, 0.0], [0.02, 0.5, 0.8])),))
    _, report = written(plate, tmp_path / "plate", size=100.0)
    assert sorted(report["pieces"][0]["size"]) == [4, 80, 100]
    assert report["pieces"][0]["size"][2] == 4


def test_what_cannot_be_printed_is_told(tmp_path):
    notes, report = written(knob_box(radius=0.01), tmp_path / "small")
    assert any("'knob' cannot be printed as a joint and is fixed" in note for note in notes)
    assert [p["parts"] for p in report["pieces"]] == [["body", "knob"]] and not report["joints"]


@pytest.mark.parametrize(
    ("name", "value", "flag"),
    [
        ("size", 5.0, "--print-size 5"),
        ("clearance", 0.0, "--clearance 0"),
        ("wall", float("nan"), "--print-wall nan"),
    ],
)
def test_measures_that_cannot_be_are_refused(name, value, flag):
    with pytest.raises(ValueError, match=f"{flag}: it must be between"):
        PrintSettings(**{name: value})


def test_a_moving_part_without_a_volume_is_named_and_a_fixed_one_left_out(tmp_path):
    body = Part("body", box([-0.3, -0.4, 0.0], [0.3, 0.4, 1.0]))
    crumb = Part("crumb", box([0.4, 0.0, 0.9], [0.401, 0.001, 0.901]), 0)
    notes, report = written(ArticulatedObject((body, crumb)), tmp_path / "fixed")
    assert any("'crumb' has" in n and n.endswith("is left out") for n in notes)
    assert [p["file"] for p in report["pieces"]] == ["body.stl"]
    turn = Joint([0.4, 0, 0.9], [0, 0, 1], (0.0, 1.0))
    moving = ArticulatedObject((body, dataclasses.replace(crumb, joint=turn)))
    with pytest.raises(ValueError, match=r"'crumb' has .* choose a larger --print-size"):
        written(moving, tmp_path / "none")


def test_a_piece_that_was_not_written_has_no_file_and_no_step(tmp_path, monkeypatch):
    whole = write._write_piece
    monkeypatch.setattr(
        write, "_write_piece", lambda p, *rest: p.name != "door_pin_1" and whole(p, *rest)
    )
    _, report = written(door_box(), tmp_path / "left", size=120.0)
    files = [piece["file"] for piece in report["pieces"]]
    assert files.count(None) == 1 and "door_pin_1.stl" not in files
    assert not any("door_pin_1" in step for step in report["assembly"])
    assert "door_pin_2.stl" in report["assembly"][1]
    assert "not written (a pin)" in (tmp_path / "left" / "README.txt").read_text("utf-8")


def test_no_size_is_recommended_that_cannot_be_chosen():
    assert "--print-size 1600" in write._larger(0.9, PrintSettings(size=1200.0))
    assert write._larger(0.5, PrintSettings(size=1200.0)) == ""


def test_where_a_part_runs_into_its_parent_is_told_with_its_unit():
    (joint,) = print_of("door").joints
    found = Held(0.3, (0.5, 0.6, 1.0), True, True, True)
    assert write._weak("door", joint, found) == [
        "'door' runs into its parent at 28.6 to 57.3 degrees"
    ]

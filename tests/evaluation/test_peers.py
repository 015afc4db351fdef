"""What peers write, read and compared as it lies: files made here in the formats of their code."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from uniart_jax import cli
from uniart_jax.evaluation import compare as frame
from uniart_jax.evaluation.compare import _reading, compare
from uniart_jax.evaluation.pairs import Missing, find_pairs, find_references, shared_files
from uniart_jax.objects.facing import faced
from uniart_jax.objects.load import load_object
from uniart_jax.objects.object import ArticulatedObject, Part

ONLY = ("articulation", "pose_error")


@pytest.fixture(autouse=True)
def no_pictures(monkeypatch):
    monkeypatch.setattr(frame, "write_report", lambda *given: None)


# SINGAPO and DIPO: y up, front +z, one frame

BODY, DOOR = ((0, 0, 0), (0.8, 1.0, 0.6)), ((0, 0.1, 0.32), (0.8, 0.6, 0.04))


def tree(angle: float = 90.0) -> dict:
    """``parse_tree`` of SINGAPO's ``data/utils.py``: ranges from 0, no meshes yet."""
    nodes = []
    for k, (name, (center, size)) in enumerate((("base", BODY), ("door", DOOR))):
        fixed = k == 0
        axis = {
            "direction": [0.0, 0.0 if fixed else 1.0, 0.0],
            "origin": [0.0, 0.0, 0.0] if fixed else [-0.4, 0.1, 0.3],
        }
        joint = {
            "type": "fixed" if fixed else "revolute",
            "range": [0.0, 0.0 if fixed else -angle],
            "axis": axis,
        }
        box = {"center": list(center), "size": list(size)}
        nodes.append(
            {
                "id": k,
                "name": name,
                "parent": k - 1,
                "children": [1][k:],
                "aabb": box,
                "joint": joint,
            }
        )
    return {"meta": {"obj_cat": "StorageFurniture"}, "diffuse_tree": nodes}


def write_retrieved(folder: Path, document: dict, kinds=("plys",)) -> Path:
    """``scripts/mesh_retrieval``: a mesh a part, where the part lies, and ``object.ply`` of all."""
    for kind in kinds:
        (folder / kind).mkdir(parents=True)
        for k, node in enumerate(document["diffuse_tree"]):
            file = f"{kind}/part_{k}.{kind[:3]}"
            mesh = trimesh.creation.box(node["aabb"]["size"])
            mesh.apply_translation(node["aabb"]["center"])
            mesh.export(folder / file)
            node[kind] = [file]
    (folder / "object.ply").write_bytes(b"")
    (folder / "object.json").write_text(json.dumps(document))
    return folder


@pytest.fixture
def singapo(tmp_path) -> tuple[Path, Path]:
    """Its test run and data: two views of one object with two samples each, one of another."""
    data, run = tmp_path / "data", tmp_path / "exps" / "singapo" / "output"
    write_retrieved(data / "StorageFurniture" / "46440", tree(), ("objs", "plys"))
    write_retrieved(data / "Table" / "2084", tree(), ("objs", "plys"))
    (data / "StorageFurniture" / "46440" / "imgs").mkdir()
    for folder, angles in (
        ("0@StorageFurniture@46440", (90, 90)),
        ("10@StorageFurniture@46440", (-90, 90)),
        ("2@Table@2084", (90,)),
    ):
        for k, angle in enumerate(angles):
            write_retrieved(run / folder / str(k), tree(angle))
        (run / folder / "output.png").write_bytes(b"")
    return run, data


def test_a_test_run_of_singapo(singapo, tmp_path):
    run, data = singapo
    pairs, surplus = find_pairs(run, find_references(data))
    names = {p.name: [s.relative_to(run).as_posix() for s in p.samples] for p in pairs}
    first, second = "0@StorageFurniture@46440", "10@StorageFurniture@46440"
    assert names == {
        "2084": ["2@Table@2084/0"],
        "46440": [f"{first}/0", f"{first}/1", f"{second}/0", f"{second}/1"],
    }
    assert not surplus
    found = compare({"singapo": run}, data, tmp_path / "out", only=ONLY)["methods"]["singapo"]
    assert found["objects"]["46440"]["wrong_way"] == pytest.approx(1 / 4)  # one of four samples
    assert found["objects"]["2084"]["pose_error"] < 1e-6 < found["objects"]["46440"]["pose_error"]
    assert not found["failures"] and list(found["categories"]) == ["StorageFurniture"]


def test_a_view_without_a_sample_is_a_failure(singapo):
    run, data = singapo
    (run / "11@Table@2084").mkdir()
    (run / "2@Table@2084" / "1").mkdir()
    pairs, _ = find_pairs(run, find_references(data))
    good, *bad = next(p for p in pairs if p.name == "2084").samples
    assert isinstance(good, Path)
    assert [b.why for b in bad if isinstance(b, Missing)] == [
        "1: no asset in it",
        "its folder holds no asset",
    ]


def test_folders_of_categories(singapo, tmp_path):
    _, data = singapo
    write_retrieved(tmp_path / "pred" / "Table" / "2084", tree())
    pairs, surplus = find_pairs(tmp_path / "pred", find_references(data))
    assert {p.name: isinstance(p.samples[0], Path) for p in pairs} == {"2084": True, "46440": False}
    assert not surplus
    write_retrieved(data / "Oven" / "2084", tree())
    with pytest.raises(ValueError, match="two references are called '2084'"):
        find_references(data)
    # beside assets a folder of others is none of a category
    write_retrieved(data / "7179", tree())
    assert list(find_references(data)) == ["7179"]


def test_dipos_demo_and_its_spelling_mistake(singapo, tmp_path):
    """``demo_img.py`` numbers its samples; its retrieval script names a category where none is."""
    _, data = singapo
    for k in range(3):
        document = tree() | {"meta": {"obj_cat": "StroageFurniture"}}
        folder = write_retrieved(tmp_path / "results" / str(k), document, ("plys", "objs"))
        obj = load_object(folder)
        assert obj.category == "StorageFurniture"
        assert "category 'StroageFurniture': read as 'StorageFurniture'" in obj.provenance
    truth = find_references(data / "StorageFurniture" / "46440")
    pairs, _ = find_pairs(tmp_path / "results", truth)
    assert [s.name for s in pairs[0].samples] == ["0", "1", "2"]
    # a folder of objects with numbers for names is not taken for samples
    (tmp_path / "results" / "46440").mkdir()
    write_retrieved(tmp_path / "results" / "46440" / "0", tree())
    pairs, surplus = find_pairs(tmp_path / "results", truth)
    assert [s.parent.name for s in pairs[0].samples] == ["46440"] and surplus == ["0", "1", "2"]


# URDFormer: z up, front +x, meshes of all objects beside the folder of URDFs


def urdformer(meshes: str) -> str:
    """A cabinet and a door hinged on one side of its front, as URDFormer's ``output/*.urdf``."""
    links = [("base_link", "cabinet", "1 1 1"), ("doorL0", "parts/doorL", "1 0.8 0.9")]
    shapes = "".join(
        f'<link name="{name}"><visual><origin xyz="0 0 0" rpy="0 0 0" /><geometry>'
        f'<mesh filename="{meshes}/{mesh}.obj" scale="{scale}" /></geometry></visual></link>'
        for name, mesh, scale in links
    )
    return (
        f'<?xml version="1.0" encoding="utf-8"?>\n<robot name="my_urdf">{shapes}'
        '<joint name="doorL0_to_base_link" type="revolute"><axis xyz="0 0 1" />'
        '<limit effort="5" lower="-1.57" upper="0" velocity="2.283" />'
        '<origin xyz="0 0.1 0.05" rpy="0 0 0" /><parent link="base_link" /><child link="doorL0" />'
        "</joint></robot>"
    )


def write_meshes(folder: Path, depth: float = 0.6) -> None:
    (folder / "parts").mkdir(parents=True, exist_ok=True)
    trimesh.creation.box(bounds=[[-depth, 0, 0], [0, 1, 1]]).export(folder / "cabinet.obj")
    trimesh.creation.box(bounds=[[0, 0, 0], [0.04, 1, 1]]).export(folder / "parts" / "doorL.obj")


def write_truth(folder: Path) -> None:
    """The same cabinet as ours: front at -x, boxes."""
    folder.mkdir(parents=True)
    shape = (
        '<link name="{}"><visual><origin xyz="{}"/><geometry><box size="{}"/></geometry></visual>'
        "</link>"
    )
    body = shape.format("body", "0.3 -0.5 0.5", "0.6 1 1")
    door = shape.format("door", "-0.02 -0.4 0.45", "0.04 0.8 0.9")
    hinge = (
        '<joint name="hinge" type="revolute"><axis xyz="0 0 1"/>'
        '<limit lower="-1.57" upper="0" effort="1" velocity="1"/>'
        '<origin xyz="0 -0.1 0.05"/><parent link="body"/><child link="door"/></joint>'
    )
    (folder / "object.urdf").write_text(f'<robot name="cabinet">{body}{door}{hinge}</robot>')


@pytest.fixture
def cabinet(tmp_path) -> tuple[Path, Path]:
    """URDFormer's folder (``meshes`` and ``output``) and a reference, ``ref/label3``."""
    theirs, ref = tmp_path / "urdformer", tmp_path / "ref"
    write_meshes(theirs / "meshes")
    (theirs / "output").mkdir()
    (theirs / "output" / "label3.urdf").write_text(urdformer("../meshes"))
    for name in ("label3", "other"):
        write_truth(ref / name)
    return theirs, ref


def run(monkeypatch, capfd, *arguments) -> tuple[int, str]:
    monkeypatch.setattr(
        sys,
        "argv",
        ["uniart", "evaluate", *map(str, arguments), "--only", *ONLY, "--processes", "1"],
    )
    with pytest.raises(SystemExit) as done:
        cli.main()
    return int(done.value.code or 0), capfd.readouterr().err


def figures(out: Path) -> dict:
    return next(iter(json.loads((out / "metrics.json").read_text())["methods"].values()))


def test_urdformers_folder_as_it_is(cabinet, tmp_path, monkeypatch, capfd):
    theirs, ref = cabinet
    pred = theirs / "output"
    code, said = run(monkeypatch, capfd, pred, ref, "--out", tmp_path / "refused", "--front=+x")
    assert (
        code == 0 and "'../meshes/cabinet.obj' lies outside" in said and "--allow-outside" in said
    )
    assert "output: no prediction could be read, the first because: " in said
    out = tmp_path / "out"
    code, _ = run(monkeypatch, capfd, pred, ref, "--out", out, "--front=+x", "--allow-outside")
    found = figures(out)
    assert code == 0 and list(found["failures"]) == ["other"]
    assert found["objects"]["label3"]["pose_error"] < 1e-6
    assert found["objects"]["label3"]["wrong_way"] == 0
    assert json.loads((out / "metrics.json").read_text())["settings"]["front"] == "+x"
    code, said = run(monkeypatch, capfd, pred, ref, "--out", out, "--allow-outside")
    assert code == 2 and "other predictions, references or figures" in said
    # without it the object stands with its back to the front
    run(monkeypatch, capfd, pred, ref, "--out", tmp_path / "turned", "--allow-outside")
    assert figures(tmp_path / "turned")["objects"]["label3"]["pose_error"] > 0.05
    # and the other way round: references that face +x
    other = tmp_path / "other-way"
    run(monkeypatch, capfd, ref, pred, "--out", other, "--ref-front=+x", "--allow-outside")
    assert figures(other)["objects"]["label3"]["pose_error"] < 1e-6


def test_predictions_share_what_lies_in_their_folder(cabinet, tmp_path):
    """``../meshes`` within PRED is read without --allow-outside, what lies beside PRED is not."""
    _, ref = cabinet
    pred = tmp_path / "pred"
    write_meshes(pred / "meshes")
    for name, meshes in (("label3", "../meshes"), ("other", "../../urdformer/meshes")):
        (pred / name).mkdir()
        (pred / name / f"{name}.urdf").write_text(urdformer(meshes))
    out = tmp_path / "out"
    found = compare({"m": pred}, ref, out, only=ONLY, front="+x")["methods"]["m"]
    assert found["objects"]["label3"]["pose_error"] < 1e-6
    assert list(found["failures"]) == ["other"] and "lies outside" in found["failures"]["other"]
    # and it counts for what is kept: another mesh, another result
    write_meshes(pred / "meshes", depth=0.3)
    found = compare({"m": pred}, ref, out, only=ONLY, front="+x")["methods"]["m"]
    assert found["objects"]["label3"]["pose_error"] > 0.01
    with pytest.raises(ValueError, match="lies outside the asset's folder"):
        load_object(pred / "label3")


def test_what_is_shared_changes_with_meshes_alone(cabinet, tmp_path):
    _, ref = cabinet
    pred = tmp_path / "pred"
    for name in ("label3", "other", "surplus"):
        write_truth(pred / name)
    pairs, _ = find_pairs(pred, find_references(ref))
    assert shared_files(pred, pairs, tmp_path / "out") == ""
    write_meshes(pred / "meshes")
    before = shared_files(pred, pairs, tmp_path / "out")
    (pred / "meshes" / "readme.txt").write_text("text")
    write_meshes(pred / "kept" / "results")
    (pred / "kept" / "settings.json").write_text("{}")
    write_meshes(pred / "out")
    assert shared_files(pred, pairs, pred / "out") == before != ""
    write_meshes(pred / "meshes", depth=0.25)
    assert shared_files(pred, pairs, pred / "out") != before


@pytest.mark.parametrize("place", ["", "category/meshes", "a/b"])
def test_what_is_shared_is_seen_at_any_depth(cabinet, tmp_path, place):
    _, ref = cabinet
    pred = tmp_path / "pred"
    write_truth(pred / "label3")
    pairs, _ = find_pairs(pred, find_references(ref))
    found = [shared_files(pred, pairs, tmp_path / "out")]
    for depth in (0.2, 0.25):
        write_meshes(pred / place, depth=depth)
        found.append(shared_files(pred, pairs, tmp_path / "out"))
    assert len(set(found)) == 3


def test_a_prediction_cannot_name_its_references_meshes(cabinet, tmp_path):
    """Where the references lie in the predictions' folder, nothing is shared there."""
    pred = tmp_path / "pred"
    pred.mkdir()
    outside = _reading(pred, tmp_path / "ref", False, "-x")
    inside = _reading(pred, pred / "ref", False, "-x")
    assert outside.within == pred and inside.within is None


@pytest.mark.parametrize(
    ("front", "turned"), [("-x", (-1, 0)), ("+x", (1, 0)), ("-y", (0, -1)), ("+y", (0, 1))]
)
def test_every_front_comes_to_minus_x(front, turned):
    nose = trimesh.creation.box(bounds=[[-0.1, -0.1, 0], [0.1, 0.1, 0.3]])
    nose.apply_translation([*turned, 0])
    center = faced(ArticulatedObject((Part("nose", nose),)), front).parts[0].box[:3]
    np.testing.assert_allclose(center, [-1, 0, 0.15], atol=1e-9)


def test_a_front_that_is_none_is_said(tmp_path):
    with pytest.raises(ValueError, match="evaluate: front must be one of -x, "):
        compare({"m": tmp_path}, tmp_path, tmp_path / "out", front="x")

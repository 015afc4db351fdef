"""``uniart export | validate | view``: what a user types, reads and gets as exit code."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
import trimesh

pytest.importorskip("mujoco")

from uniart_jax.objects.load import load_object
from uniart_jax.objects.object import Part

pytestmark = pytest.mark.usefixtures("small_pictures", "mujoco_here")


@pytest.fixture(scope="module")
def assets(tmp_path_factory, chest):
    """A sound chest and one whose lid goes into it; tests only read them."""
    root = tmp_path_factory.mktemp("assets")
    for name, angle in (("sound", 1.4), ("inward", -1.0)):
        chest(angle).save(root / name, formats=("mjcf",), motion=False)
    return root


def test_validate_tells_sound_from_not(run, assets, tmp_path):
    code, out, _ = run("validate", assets / "sound", "--out", tmp_path / "a", "--engines", "mujoco")
    assert code == 0 and "mujoco" in out and "sweep" not in out
    assert out.splitlines()[-1] == "loads and stands: yes; plausible: yes"
    assert {p.name for p in (tmp_path / "a").iterdir()} == {"validation.json", "validation.png"}
    code, out, _ = run(
        "validate", assets / "inward", "--out", tmp_path / "b", "--engines", "mujoco"
    )
    assert code == 1 and "sweep" in out and "lid_joint" in out
    assert "loads and stands: no (" in out and "plausible: no (plausible)" in out
    found = json.loads((tmp_path / "b" / "validation.json").read_text())
    assert not found["engines"]["mujoco"]["sweep"]["passed"]


def test_export_writes_pieces_that_print(run, assets, tmp_path):
    """With --print: the lid has pin hinges; a mistake is one line, code 2 and no folder."""
    out = tmp_path / "out"
    wanted = ("--out", out, "--no-check", "--print", "--print-size", "90", "--clearance", "0.25")
    code, _, err = run("export", assets / "sound", *wanted)
    assert code == 2 and err == "error: --print needs STL files: add --formats stl\n"
    code, _, err = run("export", assets / "sound", "--out", out, "--clearance", "0.25")
    assert code == 2 and "belong to --print: add it" in err and not out.exists()
    code, _, err = run("export", assets / "sound", *wanted, "--formats", "stl")
    assert code == 0, err
    found = json.loads((out / "print" / "print.json").read_text("utf-8"))
    assert found["size"] == 90 and found["clearance"] == 0.25
    assert [j["kind"] for j in found["joints"]] == ["pin hinge"]
    for piece in found["pieces"]:
        mesh = trimesh.load_mesh(out / "print" / piece["file"])
        assert mesh.is_watertight and mesh.volume > 0 and mesh.bounds[0, 2] == 0
    assert max(found["pieces"][0]["size"]) <= 90 + 1
    assert "Assembly" in (out / "print" / "README.txt").read_text("utf-8")


def test_an_object_that_stands_and_is_wrong_is_not_praised(run, tmp_path, chest):
    """Two blocks float beside the chest, touching each other: no engine minds."""
    block = trimesh.creation.box([0.1] * 3).apply_translation([0, 0.7, 0])
    above = block.copy().apply_translation([0, 0, 0.1])
    parts = (*chest().parts, Part("one", block, 0), Part("two", above, 0))
    dataclasses.replace(chest(), parts=parts).save(tmp_path / "a", formats=("mjcf",), motion=False)
    code, out, err = run("validate", tmp_path / "a", "--out", tmp_path / "v", "--engines", "mujoco")
    assert code == 1 and "loads and stands: yes; plausible: no (free)" in out
    assert "sound" not in out + err
    found = json.loads((tmp_path / "v" / "validation.json").read_text())
    assert not found["plausibility"]["free"]["passed"]


def test_the_gate_has_a_verdict_and_an_exit_code_of_its_own(run, assets, tmp_path):
    gate = ("--gate", "affordcraft")
    code, out, _ = run("validate", assets / "sound", "--out", tmp_path / "a", *gate)
    assert code == 0
    assert out.splitlines()[-1] == "gate affordcraft: passed (moving parts)"
    assert {p.name for p in (tmp_path / "a").iterdir()} == {"validation.json"}
    found = json.loads((tmp_path / "a" / "validation.json").read_text())
    assert found["gate"]["passed"] and "engines" not in found
    held = tmp_path / "held.xml"
    text = '<mujoco><worldbody><body><joint name="j"/><geom size=".1"/></body></worldbody></mujoco>'
    held.write_text(text)
    code, out, _ = run("validate", held, "--out", tmp_path / "b", *gate)
    assert code == 1 and "anchor: joint 'j' holds" in out
    assert out.splitlines()[-1] == "gate affordcraft: failed (moving parts)"
    for more in (("--refine",), ("--engines", "pybullet")):
        code, _, err = run("validate", held, "--out", tmp_path / "c", *gate, *more)
        assert code == 2 and "leave out --refine and --engines" in err
        assert len(err.strip().splitlines()) == 1 and not (tmp_path / "c").exists()
    held.write_text("no XML")
    code, _, err = run("validate", held, "--out", tmp_path / "c", *gate)
    assert code == 2 and len(err.strip().splitlines()) == 1 and "held.xml" in err


def test_the_gate_of_a_folder_counts_by_rule(run, assets, tmp_path):
    """Files and folders together; what cannot be read is counted, alone it is still an error."""
    root = tmp_path / "root"
    root.mkdir()
    (root / "good").symlink_to(assets / "sound")
    (root / "inner").mkdir()
    held = '<mujoco><worldbody><body><joint name="j"/><geom size=".1"/></body></worldbody></mujoco>'
    (root / "inner" / "held.xml").write_text(held)
    gate = ("--gate", "affordcraft", "--out", tmp_path / "out", "--overwrite", "--allow-outside")
    code, out, _ = run("validate", root, *gate)
    found = json.loads((tmp_path / "out" / "validation.json").read_text())
    assert code == 1 and found["passed"] == 1 and found["articulated"] == 2
    assert found["rules"]["anchor"] == [1, 2] and found["rules"]["loads"] == [2, 2]
    assert found["assets"]["good"]["passed"] and not found["assets"]["inner/held.xml"]["passed"]
    lines = out.splitlines()
    assert lines[0].startswith("inner/held.xml: anchor") and "joint 'j' holds" in lines[0]
    assert lines[-1] == "gate affordcraft: 1 of 2 assets passed (50.0%); 2 have moving parts"
    (root / "inner" / "held.xml").unlink()
    code, out, _ = run("validate", root, *gate)
    assert code == 0 and out.splitlines()[-1].startswith("gate affordcraft: 1 of 1 assets")
    (root / "broken.urdf").write_text("<robot")
    code, out, _ = run("validate", root, *gate)
    found = json.loads((tmp_path / "out" / "validation.json").read_text())
    assert code == 1 and found["rules"]["loads"] == [1, 2] and found["rules"]["anchor"] == [1, 1]
    assert "broken.urdf" in found["assets"]["broken.urdf"]["checks"]["loads"]["reason"]
    code, _, err = run("validate", root / "broken.urdf", *gate)
    assert code == 2 and err.count("\n") == 1
    code, _, err = run("validate", root, "--out", tmp_path / "other")
    assert code == 2 and err.count("\n") == 1 and not (tmp_path / "other").exists()


def test_validate_of_what_is_no_asset_is_one_line(run, assets, tmp_path):
    (tmp_path / "no.urdf").write_text("<robot")
    for bad in (tmp_path / "absent", tmp_path / "no.urdf"):
        code, out, err = run("validate", bad, "--out", tmp_path / "out", "--engines", "mujoco")
        assert code == 2 and err.startswith("error: ") and err.count("\n") == 1 and not out
    assert not (tmp_path / "out").exists()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.doc").write_text("")
    code, _, err = run("validate", assets / "sound", "--out", tmp_path / "mine", "--overwrite")
    assert code == 2 and "not replaced" in err


@pytest.mark.slow
def test_validate_refines_on_request(run, tmp_path, chest):
    chest(-1.0).save(tmp_path / "inward", formats=("mjcf",), motion=False)
    wide = chest(
        2.6
    )  # the lid's range ends far behind the block: nothing is there, so nothing changes
    wide.save(tmp_path / "wide", formats=("mjcf",), motion=False)
    code, out, _ = run(
        *("validate", tmp_path / "wide", "--out", tmp_path / "w", "--refine"),
        *("--engines", "mujoco"),
    )
    assert code == 0 and "refined:" in out
    limits = load_object(tmp_path / "w" / "refined").parts[1].joint.limits
    assert limits == pytest.approx((0, 2.6))
    code, out, _ = run(
        *("validate", tmp_path / "inward", "--out", tmp_path / "i", "--refine"),
        *("--engines", "mujoco"),
    )
    assert code == 1 and "left as it is" in out  # no nearby axis helps a lid that goes in


def test_export_sizes_weighs_and_checks(run, assets, tmp_path):
    out = tmp_path / "out"
    options = ("--size", "oven", "--mass", "20", "--formats", "mjcf", "stl")
    code, _, err = run("export", assets / "sound", "--out", out, *options)
    assert code == 0 and "2 parts" in err
    obj, report = load_object(out), json.loads((out / "report.json").read_text())
    assert np.ptp(obj.bounds, axis=0).max() == pytest.approx(0.9)
    assert sum(p["mass"] for p in report["parts"]) == pytest.approx(20)
    assert report["validation"]["mujoco"]["loads"]["passed"]
    assert (out / "object.xml").is_file() and (out / "print").is_dir()
    assert not (out / "object.glb").exists()


def test_export_takes_friction_damping_and_kinds_of_shapes(run, assets, tmp_path):
    out = tmp_path / "out"
    options = ("--friction", "lid_joint=1.5", "--damping", "2", "--formats", "mjcf", "--no-check")
    code, _, _ = run("export", assets / "sound", "--out", out, "--collision", "hull", *options)
    report = json.loads((out / "report.json").read_text())
    usual = json.loads((assets / "sound" / "report.json").read_text())["parts"][1]["handle"]
    assert code == 0 and report["collision"] == "hull"
    assert report["parts"][1]["handle"]["friction"] == 1.5
    assert report["parts"][1]["handle"]["damping"] == pytest.approx(2 * usual["damping"], rel=1e-3)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--size", "house"), "give metres, or a category"),
        (("--size", "-1"), "between 0.001 and 1000"),
        (("--mass", "1", "--density", "1"), "not both"),
        (("--mass", "nan"), "positive"),
        (("--friction", "much"), "'much' is no number"),
        (("--friction", "lid_joint=-1"), "0 or more"),
        (("--friction", "door=1"), "there are: lid_joint"),
        (("--damping", "1", "2"), "one factor for all joints"),
        (("--collision-budget", "0"), "give 1 or more"),
    ],
)
def test_export_refuses_what_cannot_be(run, assets, tmp_path, options, said):
    code, _, err = run("export", assets / "sound", "--out", tmp_path / "out", *options)
    assert code == 2 and said in err and err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_normalised_data_set_gets_usual_sizes(tmp_path, chest):
    from uniart_jax.cli.assets import is_metric

    chest().save(tmp_path / "ours", formats=(), motion=False)
    assert is_metric(tmp_path / "ours", False)
    folder = tmp_path / "partnet"
    folder.mkdir()
    (folder / "mobility.urdf").write_text("<robot name='x'/>")
    (folder / "mobility_v2.json").write_text("[]")
    assert not is_metric(folder, False)

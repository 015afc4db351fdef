"""``uniart evaluate physics``: every object counts, what was done stays done, what cannot be tried
is a failure."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh

pytest.importorskip("mujoco")

from uniart_jax.evaluation.physics import evaluate_physics, summarize_checks, table_of
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part

ENGINES = ("mujoco",)
pytestmark = pytest.mark.usefixtures("small_pictures", "mujoco_here")


def test_a_folder_of_assets_with_a_bad_one(tmp_path):
    drawer = Joint(np.zeros(3), [-1, 0, 0], (0, 0), (0, 0.3))
    parts = (
        Part("shelf", trimesh.creation.box(bounds=[[0, -0.3, 0], [0.4, 0.3, 0.1]])),
        Part("tray", trimesh.creation.box(bounds=[[0, -0.3, 0.102], [0.4, 0.3, 0.2]]), 0, drawer),
    )
    ArticulatedObject(parts).save(tmp_path / "in" / "good", formats=(), motion=False)
    (tmp_path / "in" / "bad").mkdir()
    (tmp_path / "in" / "bad" / "object.urdf").write_text("<robot name='bad'></robot>")
    out = tmp_path / "out"
    found = evaluate_physics(out, root=tmp_path / "in", engines=ENGINES)
    row = found["rows"]["assets"]
    assert row["objects"] == 2 and row["sound"] == 0.5 and row["loads mujoco"] == 0.5
    assert row["joints mujoco"] == 1 and row["70 % mujoco"] == 1.0
    assert row["loads and stands"] == row["plausible"] == 0.5
    bad = next(r for r in found["objects"]["assets"] if "bad" in r["name"])
    assert not bad["sound"] and bad["failed"]
    assert json.loads((out / "metrics.json").read_text())["rows"] == found["rows"]
    assert "| assets |" in (out / "table.md").read_text()

    kept = next((out / "results" / "assets").glob("*good*.json"))
    known = json.loads(kept.read_text()) | {"sound": False}
    kept.write_text(json.dumps(known))
    again = evaluate_physics(out, root=tmp_path / "in", engines=ENGINES)
    assert again["rows"]["assets"]["sound"] == 0.0  # taken from the file, not done anew
    with pytest.raises(ValueError, match="other objects or engines; choose another --out"):
        evaluate_physics(out, root=tmp_path / "other", engines=ENGINES)


@pytest.mark.slow
def test_every_joint_of_a_part_is_tried(tmp_path):
    """A lever that turns and lifts: codes hold one joint a part, files and checks both."""
    turn, lift = (
        Joint([0, 0, 0], [0, 0, 1], (0, 1.0)),
        Joint([0, 0, 0], [0, 0, 1], (0, 0), (0, 0.1)),
    )
    block = trimesh.creation.box(bounds=[[-0.2, -0.2, 0], [0.2, 0.2, 0.4]])
    lever = trimesh.creation.box(bounds=[[-0.2, -0.2, 0.401], [0.2, 0.2, 0.45]])
    parts = (Part("tap", block), Part("lever", lever, 0, turn, outer=(lift,)))
    ArticulatedObject(parts).save(tmp_path / "in" / "tap", formats=("mjcf",), motion=False)
    found = evaluate_physics(tmp_path / "out", root=tmp_path / "in", engines=ENGINES)
    (tried,) = found["objects"]["assets"]
    assert set(tried["joints"]["mujoco"]) == {"lever_joint", "lever_joint_2"}


def test_both_sources_at_once_are_refused(tmp_path):
    with pytest.raises(ValueError, match="not both"):
        evaluate_physics(tmp_path / "out", root=tmp_path, checkpoint="nano")
    assert not (tmp_path / "out").exists()


def test_figures_of_a_row():
    good = {
        "name": "a", "moving": ["x", "y"], "sound": True, "failed": [], "yourdfpy": True, "watertight": True,  # noqa: E501
        "engines": {"mujoco": {"loads": True, "stands": True}}, "joints": {"mujoco": {"x": True, "y": False}},  # noqa: E501
        "seconds": {"export": 2.0, "validate": 3.0},
    }  # fmt: skip
    bad = good | {
        "name": "b",
        "sound": False,
        "engines": {},
        "joints": {},
        "seconds": {},
        "yourdfpy": False,
    }
    row = summarize_checks([good, bad])
    assert row["loads mujoco"] == 0.5 and row["stands mujoco"] == 0.5 and row["sound"] == 0.5
    assert row["joints mujoco"] == 4 and row["70 % mujoco"] == 0.25 and row["export s"] == 2.0
    assert table_of({"truth": row}).count("\n") == 2
    assert "plausible" not in row  # figures kept from before do not know
    known = [good | {"stands": True, "plausible": s} for s in (True, False)]
    assert summarize_checks(known)["plausible"] == 0.5

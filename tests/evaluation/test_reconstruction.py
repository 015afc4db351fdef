"""Through the voxels and back: what codes cannot hold is told, not lost in silence."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh

from uniart_jax.data import object_records
from uniart_jax.data.folder import Settings
from uniart_jax.data.sources import Entry
from uniart_jax.evaluation.reconstruction import reconstruct_asset
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.load import load_object
from uniart_jax.objects.object import ArticulatedObject, Part

pytestmark = pytest.mark.usefixtures("small_pictures")


def panel() -> ArticulatedObject:
    """A metre high: a box, a button on it that travels 2 mm and a door that opens."""
    box = trimesh.creation.box(bounds=[[-0.2, -0.3, -0.5], [0.2, 0.3, 0.5]])
    button = trimesh.creation.box(bounds=[[-0.3, -0.1, 0.2], [-0.2, 0.1, 0.4]])
    door = trimesh.creation.box(bounds=[[-0.3, -0.3, -0.5], [-0.2, 0.3, 0.0]])
    press = Joint([0, 0, 0], [1, 0, 0], (0, 0), (0, 0.002))
    turn = Joint([-0.2, 0.3, 0], [0, 0, 1], (0, 1.5))
    return ArticulatedObject(
        (Part("body", box), Part("button", button, 0, press), Part("door", door, 0, turn))
    )


@pytest.mark.slow
def test_a_small_motion_is_told_by_the_copy(tmp_path, capsys):
    folder = panel().save(tmp_path / "a", formats=(), motion=False)
    assert [p.joint.type for p in load_object(folder).parts] == ["fixed", "prismatic", "revolute"]
    reconstruct_asset(folder, tmp_path / "b", 16, 2)
    told = "joint of 'button': a motion of less than 1 degree"
    notes = json.loads((tmp_path / "b" / "report.json").read_text())["notes"]
    assert any(line.startswith(told) for line in notes)
    said = capsys.readouterr()
    assert "joint of 'button'" in " ".join((said.out + said.err).split())
    copy = load_object(tmp_path / "b")
    assert sorted(p.joint.type for p in copy.parts) == ["fixed", "fixed", "revolute"]
    np.testing.assert_allclose(np.ptp(copy.bounds, axis=0), [0.5, 0.6, 1.0], atol=0.05)


def test_a_prepared_object_s_row_tells_of_it(tmp_path, monkeypatch):
    panel().save(tmp_path / "a", formats=(), motion=False)
    monkeypatch.setattr(object_records, "_make_record", lambda *_: (b"record", b"", {}))
    ((data, _, row),) = object_records.make_records(
        Settings("urdf", root=str(tmp_path), states=1), Entry("a", "", path="a")
    )
    assert data == b"record" and row["error"] == ""
    assert row["repairs"].startswith("joint of 'button': a motion of less than 1 degree")

"""Buttons that travel two millimetres and levers that turn half a degree come through files; only
codes, which cannot tell them from nothing, hold them."""

from __future__ import annotations

import json

import mujoco
import numpy as np
import pytest
import trimesh

from uniart_jax.export.asset import save_asset
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.load import load_object
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.simulation.summary import is_sound
from uniart_jax.simulation.validate import validate
from uniart_jax.voxels.joint_code import encode_object

pytestmark = pytest.mark.usefixtures("small_pictures")

TRAVEL, TURN = 0.002, np.deg2rad(0.5)


def panel(travel: float = TRAVEL, turns: float = TURN) -> ArticulatedObject:
    """A metre high: a box with a recess for a button, and a lever beside it."""
    box = trimesh.creation.box(bounds=[[-0.2, -0.3, -0.5], [0.2, 0.3, 0.5]])
    hole = trimesh.creation.box(bounds=[[-0.3, 0.05, 0.3], [-0.18, 0.12, 0.37]])
    body = trimesh.boolean.difference([box, hole], engine="manifold")
    button = trimesh.creation.box(bounds=[[-0.21, 0.055, 0.305], [-0.183, 0.115, 0.365]])
    lever = trimesh.creation.box(bounds=[[-0.23, -0.15, 0.3], [-0.202, -0.05, 0.34]])
    press = Joint([0, 0, 0], [1, 0, 0], (0, 0), (0, travel))
    turn = Joint([-0.2, -0.1, 0.32], [1, 0, 0], (0, turns))
    return ArticulatedObject(
        (Part("body", body), Part("button", button, 0, press), Part("lever", lever, 0, turn))
    )


@pytest.mark.parametrize(("travel", "turn"), [(TRAVEL, TURN), (1e-4, np.deg2rad(0.1))])
def test_they_come_through_files(tmp_path, travel, turn):
    obj = panel(travel, turn)
    obj = obj.shown_at([0, 0.5 * travel, 0.5 * turn])
    assert obj.parts[1].joint.travel == pytest.approx((-travel / 2, travel / 2))
    folder = save_asset(obj, tmp_path / "out", formats=("mjcf",), motion=False)
    for read in (load_object(folder), load_object(folder / "object.xml")):
        joints = {p.name: p.joint for p in read.parts}
        assert joints["button"].travel == pytest.approx((0, travel))
        assert joints["lever"].angle == pytest.approx((0, turn))
        assert not any("held" in line or "less than" in line for line in read.provenance)
    model = mujoco.MjModel.from_xml_path(str(folder / "object.xml"))
    assert model.joint("button_joint").range == pytest.approx([0, travel])
    report = json.loads((folder / "report.json").read_text())
    assert report["shown"]["button_joint"] == pytest.approx(travel / 2)
    result = validate(folder, engines=["mujoco"])
    assert set(result["joints"]["mujoco"]) == {"button_joint", "lever_joint"}
    assert is_sound(result), result


def test_codes_hold_them_and_say_so():
    unit = panel().normalized()
    assert [p.joint.type for p in unit.parts] == ["fixed"] * 3
    assert [line.split(":")[0] for line in unit.provenance] == [
        "joint of 'button'",
        "joint of 'lever'",
    ]
    assert unit.normalized().provenance == unit.provenance
    _, codes, _ = encode_object(panel())
    np.testing.assert_array_equal(codes, 0)

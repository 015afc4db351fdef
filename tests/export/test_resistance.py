"""Friction and damping that somebody asks for: the same in every file, and told in the report."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree

import mujoco
import numpy as np
import pytest
import trimesh

from uniart_jax.export.asset import save_asset
from uniart_jax.export.bodies import make_bodies
from uniart_jax.export.handles import handles
from uniart_jax.export.resistance import check_resistance, parse_resistance, resisting
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part

pytestmark = pytest.mark.usefixtures("small_pictures")

TURNS, SLIDES = "door_joint", "drawer_joint"


def cabinet() -> ArticulatedObject:
    """A block with a door before it, which turns, and a drawer above that, which slides."""
    block = trimesh.creation.box(bounds=[[0, -0.3, 0], [0.5, 0.3, 0.8]])
    door = trimesh.creation.box(bounds=[[-0.03, -0.3, 0], [-0.005, 0.3, 0.5]])
    drawer = trimesh.creation.box(bounds=[[-0.03, -0.3, 0.52], [-0.005, 0.3, 0.7]])
    parts = (
        Part("base", block),
        Part("door", door, 0, Joint([-0.01, -0.3, 0], [0, 0, 1], (0, 1.5))),
        Part("drawer", drawer, 0, Joint([0, 0, 0], [-1, 0, 0], travel=(0, 0.3))),
    )
    return ArticulatedObject(parts)


def lid(scale: float = 1.0) -> ArticulatedObject:
    """A lid of 25 kg (at scale 1) on a block: a spring carries it, friction alone cannot."""
    block = trimesh.creation.box(bounds=[[0, -0.5, -0.5], [1, 0.5, -0.06]])
    cover = trimesh.creation.box(bounds=[[0, -0.5, -0.05], [1, 0.5, 0.05]])
    hinge = Joint([1, 0, 0], [0, 1, 0], (0, 1.5))
    return ArticulatedObject((Part("base", block), Part("lid", cover, 0, hinge)), scale)


def numbers(folder) -> dict[str, dict[str, tuple[float, float]]]:
    """{format: {joint: (friction, damping)}} of a written asset, N m and N m s / rad or N and N s /
    m."""
    found: dict[str, dict[str, tuple[float, float]]] = {"urdf": {}, "mjcf": {}, "report": {}}
    for joint in ElementTree.parse(folder / "object.urdf").getroot().iter("joint"):
        said = joint.find("dynamics")
        if said is not None:
            both = float(said.get("friction", "nan")), float(said.get("damping", "nan"))
            found["urdf"][joint.get("name", "")] = both
    model = mujoco.MjModel.from_xml_path(str(folder / "object.xml"))
    for j in range(model.njnt):
        dof = model.jnt_dofadr[j]
        both = float(model.dof_frictionloss[dof]), float(model.dof_damping[dof])
        found["mjcf"][model.joint(j).name] = both
    for part in json.loads((folder / "report.json").read_text())["parts"]:
        if part["handle"] is not None:
            both = part["handle"]["friction"], part["handle"]["damping"]
            found["report"][f"{part['name']}_joint"] = both
    if (folder / "object.usda").exists():
        from pxr import Usd

        found["usd"] = {}
        stage = Usd.Stage.Open(str(folder / "object.usda"))
        for prim in stage.Traverse():
            for kind, unit in (("angular", np.rad2deg(1.0)), ("linear", 1.0)):
                rubs = prim.GetAttribute(f"physxJointAxis:{kind}:staticFrictionEffort").Get()
                if rubs is not None:
                    slows = prim.GetAttribute(f"drive:{kind}:physics:damping").Get()
                    found["usd"][prim.GetName()] = rubs, slows * unit
    return found


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """By default, with factors, and with numbers by joint."""
    pytest.importorskip("pxr", reason="pip install usd-core")
    root, options = tmp_path_factory.mktemp("made"), {"formats": ("mjcf", "usd"), "motion": False}
    save_asset(cabinet(), root / "usual", **options)
    save_asset(cabinet(), root / "factor", friction=0.5, damping=3, **options)
    given = {"friction": {TURNS: 1.25}, "damping": {SLIDES: 40.0}}
    save_asset(cabinet(), root / "named", **given, **options)
    return root


@pytest.mark.parametrize("file", ["urdf", "mjcf", "usd", "report"])
def test_a_factor_holds_for_every_joint_in_every_file(made, file):
    before, after = numbers(made / "usual")[file], numbers(made / "factor")[file]
    assert set(before) == {TURNS, SLIDES}
    for name, (friction, damping) in before.items():
        assert after[name] == pytest.approx((friction / 2, 3 * damping), rel=1e-5)


@pytest.mark.parametrize("file", ["urdf", "mjcf", "usd", "report"])
def test_a_number_is_the_same_in_every_file_and_others_stay(made, file):
    before, after = numbers(made / "usual")[file], numbers(made / "named")[file]
    assert after[TURNS] == pytest.approx((1.25, before[TURNS][1]), rel=1e-5)
    assert after[SLIDES] == pytest.approx((before[SLIDES][0], 40.0), rel=1e-5)


def test_the_report_says_what_now_starts_the_joint(made):
    """A force at the handle a little above moves the door in MuJoCo, a little below does not."""
    report = json.loads((made / "named" / "report.json").read_text())
    handle = next(p["handle"] for p in report["parts"] if p["name"] == "door")
    moved = []
    for share in (0.8, 1.2):
        model = mujoco.MjModel.from_xml_path(str(made / "named" / "object.xml"))
        data = mujoco.MjData(model)
        force = share * handle["start_force"] * np.array(handle["opening"])
        for _ in range(100):
            mujoco.mj_forward(model, data)
            data.qfrc_applied[:] = 0
            body = model.body("door").id
            point = np.array(handle["point"])
            mujoco.mj_applyFT(model, data, force, np.zeros(3), point, body, data.qfrc_applied)
            mujoco.mj_step(model, data)
        moved.append(abs(float(data.joint(TURNS).qpos[0])))
    assert moved[0] < 1e-3 < 3e-3 < moved[1]


def test_friction_that_holds_a_heavy_lid_holds_it_without_a_spring():
    obj = lid()
    bodies = make_bodies(obj, [part.mesh for part in obj.parts])
    usual = bodies[1].dynamics
    assert usual.stiffness > 0 and usual.falls
    held = resisting(obj, bodies, friction={"lid_joint": 1.01 * usual.load})[1].dynamics
    assert not held.falls and held.alone == held.friction == 1.01 * usual.load
    assert held.effort >= usual.effort + 5 * (held.alone - usual.alone) - 1e-9
    lever = handles(obj)[1].lever
    more = (held.friction - usual.friction) / lever
    assert held.start == pytest.approx(usual.start + more)
    dropped = resisting(obj, bodies, friction={"lid_joint": 0.99 * usual.load})[1].dynamics
    assert dropped.falls


def test_a_light_lid_without_friction_falls_and_the_report_says_so(tmp_path):
    save_asset(lid(0.3), tmp_path / "a", formats=("mjcf",), motion=False)
    save_asset(lid(0.3), tmp_path / "b", formats=("mjcf",), motion=False, friction=0.0)
    held = [
        json.loads((tmp_path / name / "report.json").read_text())["parts"][1]["handle"]["held_by"]
        for name in "ab"
    ]
    assert held == ["friction", "nothing: it falls"]


def test_each_joint_of_a_part_with_several_has_its_own_number(tmp_path):
    parts = list(cabinet().parts)
    tip = Joint([-0.01, 0, 0], [0, 1, 0], (-0.5, 0))
    parts[1] = Part("door", parts[1].mesh, 0, parts[1].joint, inner=(tip,))
    given = {"door_joint": 1.5, "door_joint_2": 2.5}
    obj = ArticulatedObject(tuple(parts))
    save_asset(obj, tmp_path / "a", formats=("mjcf",), motion=False, friction=given)
    found = numbers(tmp_path / "a")
    for file in ("urdf", "mjcf"):
        assert {name: found[file][name][0] for name in given} == pytest.approx(given)
    report = json.loads((tmp_path / "a" / "report.json").read_text())
    assert report["parts"][1]["further_joints"][0]["friction"] == 2.5


def test_words_of_the_command_line():
    assert parse_resistance("friction", ()) is None
    assert parse_resistance("friction", ("0.5",)) == 0.5
    assert parse_resistance("friction", ("a_joint=2", "b=c=0")) == {"a_joint": 2.0, "b=c": 0.0}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("much",), "'much' is no number"),
        (("a=much",), "'much' is no number"),
        (("a=",), "is no number"),
        (("=1",), "one factor"),
        (("1", "2"), "one factor"),
        (("1", "a=2"), "one factor"),
        (("a=1", "a=2"), "given twice"),
        (("-1",), "0 or more, got -1"),
        (("a=-1",), "of joint 'a'"),
        (("nan",), "finite"),
        (("a=inf",), "finite"),
    ],
)
def test_words_that_say_nothing_are_refused(words, said):
    with pytest.raises(ValueError, match="--damping") as error:
        parse_resistance("damping", words)
    assert said in str(error.value) and "\n" not in str(error.value)


def test_a_joint_that_is_not_there_is_refused_before_any_work(tmp_path):
    with pytest.raises(ValueError, match="'door'; there are: door_joint, drawer_joint"):
        save_asset(cabinet(), tmp_path / "a", friction={"door": 1.0})
    assert not list(tmp_path.iterdir())
    alone = ArticulatedObject(cabinet().parts[:1])
    with pytest.raises(ValueError, match="there are: none"):
        check_resistance("friction", {"door_joint": 1.0}, alone)

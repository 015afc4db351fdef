"""A body with several joints: none is lost between an MJCF by others and the files that we
write."""

from __future__ import annotations

import json

import mujoco
import numpy as np
import pytest

from uniart_jax.export.asset import save_asset
from uniart_jax.export.bodies import make_bodies
from uniart_jax.export.placement import place
from uniart_jax.export.urdf import write_urdf
from uniart_jax.objects.load import load_object
from uniart_jax.simulation.planning import plan_asset
from uniart_jax.simulation.reading import Description

pytestmark = pytest.mark.usefixtures("small_pictures")

# A tap: its lever is lifted and swung by two hinges on one body, its sieve is pulled out and
# turned.
TAP = """<mujoco model="tap"><compiler angle="radian"/><worldbody><body name="spout">
  <geom type="box" size=".03 .03 .1" pos="0 0 .1"/>
  <body name="lever" pos="0 0 .22" euler=".1 0 .3">
    <joint name="swing" axis="0 0 1" range="-.7 .6"/>
    <joint name="lift" axis="0 1 0" pos=".02 0 -.01" range="0 .5"/>
    <geom type="box" size=".08 .02 .01" pos=".06 0 0"/>
    <body name="button" pos=".13 0 .011"><joint name="press" type="slide" range="0 .002"
      axis="0 0 -1"/><geom type="box" size=".01 .01 .002"/></body>
  </body>
  <body name="sieve" pos="-.05 0 .05">
    <joint name="pull" type="slide" axis="0 0 -1" range="0 .03"/>
    <joint name="turn" axis="0 0 1" range="-.5 .5"/>
    <joint name="tip" axis="1 0 0" pos="0 .01 0" range="-.2 .3"/>
    <geom type="box" size=".015 .01 .02"/>
  </body></body></worldbody></mujoco>"""
JOINTS = {
    "lever_joint": "swing",
    "lever_joint_2": "lift",
    "button_joint": "press",
    "sieve_joint": "pull",
    "sieve_joint_2": "turn",
    "sieve_joint_3": "tip",
}  # in our files, in theirs


@pytest.fixture(scope="module")
def tap(tmp_path_factory):
    """(object as read, folder as written, the file by others)."""
    path = tmp_path_factory.mktemp("tap") / "tap.xml"
    path.write_text(TAP)
    obj = load_object(path)
    folder = save_asset(obj, path.parent / "out", formats=("mjcf",), origin=None, motion=False)
    return obj, folder, path


def model_of(path) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(path))


def placed(model, coordinates: dict[str, float], body: str) -> np.ndarray:
    """[4, 4] where a body stands with joints at these coordinates, all others at 0."""
    data = mujoco.MjData(model)
    data.qpos[:] = 0
    for name, value in coordinates.items():
        data.qpos[model.jnt_qposadr[model.joint(name).id]] = value
    mujoco.mj_kinematics(model, data)
    frame = np.eye(4)
    frame[:3, :3] = data.body(body).xmat.reshape(3, 3)
    frame[:3, 3] = data.body(body).xpos
    return frame


@pytest.mark.parametrize("file", ["object.xml", "object.urdf"])
def test_mujoco_has_every_joint_with_its_range(tap, file):
    _, folder, path = tap
    ours, theirs = model_of(folder / file), model_of(path)
    assert ours.njnt == theirs.njnt == len(JOINTS)
    for name, source in JOINTS.items():
        here, there = ours.joint(name), theirs.joint(source)
        assert here.type == there.type
        if name == "lever_joint":  # from rest, its nearer end
            np.testing.assert_allclose(here.range, (0, np.ptp(there.range)))
        else:
            np.testing.assert_allclose(here.range, there.range)


@pytest.mark.parametrize("file", ["object.xml", "object.urdf"])
def test_every_joint_moves_its_part_as_it_did(tap, file):
    """At random states of all joints together, every body has moved as in the file by others."""
    _, folder, path = tap
    ours, theirs = model_of(folder / file), model_of(path)
    report = json.loads((folder / "report.json").read_text())
    shown = report["shown"]
    rng = np.random.default_rng(0)
    for _ in range(10):
        here, there = {}, {}
        for name, source in JOINTS.items():
            there[source] = rng.uniform(*theirs.joint(source).range)
            same = np.sign(axis(ours, name, shown) @ axis(theirs, source, {}))
            here[name] = shown.get(name, 0.0) + same * there[source]
        for body in ("lever", "button", "sieve"):
            now, before = placed(ours, here, body), placed(ours, shown, body)
            true, first = placed(theirs, there, body), placed(theirs, {}, body)
            np.testing.assert_allclose(
                now @ np.linalg.inv(before), true @ np.linalg.inv(first), atol=1e-6
            )


def axis(model, name: str, state: dict[str, float]) -> np.ndarray:
    """[3] a joint's direction in the world at a state."""
    data = mujoco.MjData(model)
    data.qpos[:] = 0
    for joint, value in state.items():
        data.qpos[model.jnt_qposadr[model.joint(joint).id]] = value
    mujoco.mj_kinematics(model, data)
    return data.xaxis[model.joint(name).id]


def test_links_between_joints_weigh_next_to_nothing_and_are_possible(tap):
    model = model_of(tap[1] / "object.urdf")
    carriers = [b for b in range(model.nbody) if "carrier" in model.body(b).name]
    assert len(carriers) == 3
    assert 0 < model.body_mass[carriers].sum() < 0.02 * model.body_mass.sum()
    assert (model.body_inertia[carriers] > 0).all()


@pytest.mark.pybullet
def test_pybullet_has_every_joint(tap):
    import pybullet

    client = pybullet.connect(pybullet.DIRECT)
    body = pybullet.loadURDF(str(tap[1] / "object.urdf"), physicsClientId=client)
    count = pybullet.getNumJoints(body, physicsClientId=client)
    info = [pybullet.getJointInfo(body, j, physicsClientId=client) for j in range(count)]
    pybullet.disconnect(client)
    moving = {i[1].decode(): i[9] - i[8] for i in info if i[2] != pybullet.JOINT_FIXED}
    theirs = model_of(tap[2])
    assert moving.keys() == JOINTS.keys()
    for name, span in moving.items():
        assert span == pytest.approx(float(np.ptp(theirs.joint(JOINTS[name]).range)))


def test_what_was_written_reads_back_with_every_joint_and_in_its_place(tap):
    obj, folder, _ = tap
    for file in ("object.urdf", "object.xml"):
        back = load_object(folder / file)
        for part in place(obj, None).obj.parts:
            again = back.parts[back.index(part.name)]
            np.testing.assert_allclose(again.box, part.box, atol=1e-6)
            assert [j.type for j in again.chain] == [j.type for j in part.chain]
            for one, other in zip(again.chain, part.chain, strict=True):
                assert np.ptp(one.limits) == pytest.approx(np.ptp(other.limits))


def test_validation_moves_every_joint_about_its_own_axis(tap):
    """Also those beside a part's first: each is swept over its own range, from where it is
    shown."""
    for file in ("object.urdf", "object.xml"):
        description = Description(tap[1] / file, False)
        description.read()
        plan = plan_asset(description.robot, description.obj)
        joints = {joint.name: joint for joint in plan.joints}
        assert joints.keys() == JOINTS.keys() and not plan.idle
        assert joints["sieve_joint_3"].rest == 0 and joints["sieve_joint_3"].lo < 0
        kinds = [joints[f"sieve_joint{n}"].kind for n in ("", "_2", "_3")]
        assert kinds == ["prismatic", "revolute", "revolute"]
        # what turns about z is held where x and y are far from it, what tips about x where z is
        turn, tip = joints["sieve_joint_2"].point, joints["sieve_joint_3"].point
        assert np.hypot(turn[0] + 0.05, turn[1]) == pytest.approx(np.hypot(0.015, 0.01))
        assert np.hypot(tip[1] - 0.01, tip[2] - 0.05) == pytest.approx(np.hypot(0.02, 0.02))


def test_the_report_and_codes_tell_of_them(tap):
    obj, folder, _ = tap
    parts = {p["name"]: p for p in json.loads((folder / "report.json").read_text())["parts"]}
    assert [j["name"] for j in parts["lever"]["further_joints"]] == ["lever_joint_2"]
    assert parts["lever"]["further_joints"][0]["angle"] == pytest.approx([0, 0.5])
    assert parts["button"]["further_joints"] == []
    coded = obj.normalized()
    assert all(len(p.chain) == 1 for p in coded.parts)
    for name, count in (("lever", 2), ("sieve", 3)):
        said = f"joints of '{name}': of its {count} joints the one with the largest motion was left"
        assert said in coded.provenance


def test_a_body_without_the_dynamics_of_a_further_joint_is_refused(tap, tmp_path):
    obj = tap[0]
    bodies = list(make_bodies(obj, [p.mesh for p in obj.parts]))
    k = obj.index("lever")
    object.__setattr__(bodies[k], "further", ())
    with pytest.raises(ValueError, match="part 'lever' has the dynamics of 0 further joints"):
        write_urdf(obj, tmp_path, [[]] * len(bodies), bodies, [[]] * len(bodies))


def test_usd_has_every_joint(tap, tmp_path):
    pytest.importorskip("pxr", reason="pip install usd-core")
    from pxr import Usd, UsdPhysics

    folder = save_asset(tap[0], tmp_path / "usd", formats=("usd",), motion=False)
    stage = Usd.Stage.Open(str(folder / "object.usda"))
    kinds = (UsdPhysics.RevoluteJoint, UsdPhysics.PrismaticJoint)
    joints = [p for p in stage.Traverse() if any(p.IsA(k) for k in kinds)]
    assert {p.GetName() for p in joints} == set(JOINTS)
    tip = next(p for p in joints if p.GetName() == "sieve_joint_3")
    lo, hi = (tip.GetAttribute(f"physics:{end}Limit").Get() for end in ("lower", "upper"))
    assert hi - lo == pytest.approx(np.rad2deg(0.5), abs=1e-4)

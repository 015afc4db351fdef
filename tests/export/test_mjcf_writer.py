"""The MJCF: MuJoCo compiles it without a word, moves it as we do, and it reads back as the object
that was written."""

from __future__ import annotations

import dataclasses
import shutil

import mujoco
import numpy as np
import pytest
from asset_objects import make_cabinet
from hand_bodies import write_files
from written_mjcf import assert_same_object, compiled, largest_error, written

from uniart_jax import procedural
from uniart_jax.export.dynamics import joint_dynamics
from uniart_jax.export.handles import handles, opening
from uniart_jax.export.mass import part_inertials
from uniart_jax.export.mjcf import write_mjcf
from uniart_jax.export.placement import place
from uniart_jax.objects.load import load_object


@pytest.fixture(scope="module")
def cabinet_files(tmp_path_factory):
    obj = make_cabinet()
    given, notes = written(obj, tmp_path_factory.mktemp("mjcf") / "cabinet")
    return obj, given, notes


@pytest.fixture(scope="module")
def model(cabinet_files):
    return compiled(cabinet_files[1].folder / "object.xml")


def test_bodies_stand_where_the_object_has_them(cabinet_files, model):
    assert largest_error(cabinet_files[0], model, seed=0) <= 1e-6


def test_it_reads_back_as_the_same_object(cabinet_files):
    obj, given, _ = cabinet_files
    loaded = load_object(given.folder)
    assert_same_object(loaded, obj)
    assert all(part.mesh.visual.kind == "texture" for part in loaded.parts)


def test_masses_and_inertia(cabinet_files, model):
    """About the centre of mass, in the object's axes: MuJoCo's main axes and moments give the
    tensor back."""
    obj, given, _ = cabinet_files
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for part, body in zip(obj.parts, given.bodies, strict=True):
        found = data.body(part.name)
        index = model.body(part.name).id
        assert model.body_mass[index] == pytest.approx(body.mass)
        np.testing.assert_allclose(found.xipos, body.center, atol=1e-9)
        axes = found.ximat.reshape(3, 3)
        tensor = axes @ np.diag(model.body_inertia[index]) @ axes.T
        np.testing.assert_allclose(tensor, body.inertia, atol=1e-9 * np.trace(body.inertia))


def test_joints_resist_and_end_as_said(cabinet_files, model):
    obj, given, notes = cabinet_files
    for part, body in zip(obj.parts, given.bodies, strict=True):
        if body.dynamics is None:
            continue
        joint = model.joint(f"{part.name}_joint")
        assert joint.damping[0] == body.dynamics.damping
        assert joint.frictionloss[0] == body.dynamics.friction
        assert joint.stiffness[0] == body.dynamics.stiffness
        assert model.qpos_spring[joint.qposadr[0]] == body.dynamics.reference
        assert model.jnt_actfrcrange[joint.id, 1] == body.dynamics.effort
        limited = part.joint.type != "continuous"
        assert bool(joint.limited[0]) == limited
        if limited:
            unit = 1.0 if part.joint.rotates else obj.scale
            np.testing.assert_allclose(joint.range, np.array(part.joint.limits) * unit)
    assert any("velocity" in note for note in notes)


def test_collision_shapes_are_those_given(cabinet_files, model):
    """Boxes and hulls, of group 3, with the right corners; visual geoms touch nothing."""
    obj, given, _ = cabinet_files
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for part, body in zip(obj.parts, given.bodies, strict=True):
        seen = model.geom(f"{part.name}_visual")
        assert seen.group[0] == 2 and not seen.contype[0] and not seen.conaffinity[0]
        box, shape = data.geom(f"{part.name}_collision0"), body.shapes[0]
        np.testing.assert_allclose(box.xpos, shape.center, atol=1e-9)
        np.testing.assert_allclose(box.xmat.reshape(3, 3), shape.rotation, atol=1e-9)
        np.testing.assert_allclose(model.geom(box.name).size * 2, shape.size)
        hull = model.geom(f"{part.name}_collision1")
        assert hull.group[0] == 3 and hull.contype[0]
        at = data.geom(hull.name)
        mesh = model.mesh(int(hull.dataid[0]))
        start, count = int(mesh.vertadr[0]), int(mesh.vertnum[0])
        points = model.mesh_vert[start : start + count] @ at.xmat.reshape(3, 3).T + at.xpos
        np.testing.assert_allclose(points.min(0), body.shapes[1].mesh.bounds[0], atol=1e-6)
        np.testing.assert_allclose(points.max(0), body.shapes[1].mesh.bounds[1], atol=1e-6)


def test_only_groups_that_a_joint_links_never_touch(cabinet_files, model):
    names = [model.body(i).name for i in range(model.nbody)]
    signatures = {(int(s) >> 16, int(s) & 0xFFFF) for s in model.exclude_signature}
    left_out = {frozenset((names[a], names[b])) for a, b in signatures}
    assert left_out == {
        frozenset(pair)
        for pair in [
            ("body", "door"),
            ("body", "drawer"),
            ("body", "wheel 1/2"),
            ("foot", "door"),
            ("foot", "drawer"),
            ("foot", "wheel 1/2"),
            ("door", "knob"),
        ]
    }


def test_the_screw_travels_as_it_turns(cabinet_files, model):
    """Turned by a motor for a second: what the equality leaves is less than 1 % of the travel."""
    obj, _, _ = cabinet_files
    data = mujoco.MjData(model)
    knob = obj.parts[obj.index("knob")]
    for _ in range(500):
        data.qfrc_applied[:] = 0
        data.joint("knob_joint").qfrc_applied[0] = 20
        mujoco.mj_step(model, data)
    turned = float(data.joint("knob_joint").qpos[0])
    travelled = float(data.joint("knob_travel").qpos[0])
    assert turned > 1
    assert travelled == pytest.approx(turned * knob.joint.pitch * obj.scale, abs=2e-4)


@pytest.mark.parametrize("name", ["closed", "open"])
def test_keyframes_are_rest_and_open(tmp_path, name):
    """Of an object that is shown half open: no coordinate is 0 at rest."""
    obj = make_cabinet()
    obj = obj.shown_at(obj.open(0.5))
    state = obj.rest() if name == "closed" else obj.open()
    written(obj, tmp_path / "open")
    model = compiled(tmp_path / "open" / "object.xml")
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(name).id)
    for part, q in zip(obj.parts, state, strict=True):
        joint = part.joint
        if part.parent < 0 or joint.type == "fixed":
            continue
        unit = 1.0 if joint.rotates else obj.scale
        assert q or joint.type == "continuous"
        assert data.joint(f"{part.name}_joint").qpos[0] == pytest.approx(q * unit)
        if joint.type == "screw":
            travel = data.joint(f"{part.name}_travel").qpos[0]
            assert travel == pytest.approx(q * joint.pitch * obj.scale)


def test_it_works_moved_included_and_attached(cabinet_files, tmp_path):
    """Mesh paths hold where the folder goes, in a scene beside it or above it, and through
    MjSpec."""
    home = tmp_path / "elsewhere" / "cabinet"
    shutil.copytree(cabinet_files[1].folder, home)
    alone = compiled(home / "object.xml")
    scene = '<mujoco><include file="{}"/><worldbody><geom type="plane" size="2 2 1" pos="0 0 -1"/></worldbody></mujoco>'  # noqa: E501
    for folder, name in ((home, "object.xml"), (home.parent, "cabinet/object.xml")):
        (folder / "scene.xml").write_text(scene.format(name))
        included = compiled(folder / "scene.xml")
        assert included.nq == alone.nq and included.nmesh == alone.nmesh
        np.testing.assert_array_equal(
            included.joint("door_joint").range, alone.joint("door_joint").range
        )
    spec = mujoco.MjSpec()
    child = mujoco.MjSpec.from_file(str(home / "object.xml"))
    spec.attach(child, prefix="a_", frame=spec.worldbody.add_frame())
    ball = spec.worldbody.add_body(pos=[0, 0, 2])
    ball.add_freejoint()
    ball.add_geom(size=[0.1, 0, 0])
    both = spec.compile()
    assert both.nq == alone.nq + 7 and both.key(0).name == "a_closed"
    np.testing.assert_array_equal(both.joint("a_door_joint").range, [-0.4, 1.6])


def test_a_site_stands_at_every_handle(cabinet_files, model):
    obj, _, _ = cabinet_files
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    held = [(part, h) for part, h in zip(obj.parts, handles(obj), strict=True) if h is not None]
    assert model.nsite == len(held) == 4
    for part, handle in held:
        site = model.site(f"{part.name}_handle")
        assert model.body(int(site.bodyid[0])).name == obj.parts[handle.part].name
        np.testing.assert_allclose(
            data.site(f"{part.name}_handle").xpos, handle.point * obj.scale, atol=1e-9
        )


def test_actuators_open_and_close(tmp_path):
    """Told to go to ``open``, then to ``closed``, every joint comes within 5 % of its range, and
    stays there."""
    obj = place(procedural.generate("oven", 900_001)).obj
    given = write_files(obj, tmp_path / "oven")
    inertials = part_inertials([p.mesh for p in obj.parts], obj.scale, None, None)
    bodies = [
        dataclasses.replace(b, mass=i[0], center=i[1], inertia=i[2], dynamics=d, shapes=())
        for b, i, d in zip(given.bodies, inertials, joint_dynamics(obj, inertials), strict=True)
    ]
    files = given.visual_files, bodies, [[] for _ in bodies], given.texture
    path = given.folder / "object.xml"
    write_mjcf(obj, path, *files)
    assert compiled(path).nu == 0
    write_mjcf(obj, path, *files, actuators=True)
    model = compiled(path)
    moving = [p for p in obj.parts if p.parent >= 0 and p.joint.type != "fixed"]
    assert model.nu == len(moving) > 2
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("closed").id)
    for name in ("open", "closed"):
        key = model.key(name)
        data.ctrl[:] = key.ctrl
        for _ in range(1500):
            mujoco.mj_step(model, data)
        for part in moving:
            joint = model.joint(f"{part.name}_joint")
            goal = key.qpos[joint.qposadr[0]]
            span = part.joint.limits[1] - part.joint.limits[0]
            span *= 1.0 if part.joint.rotates else obj.scale
            assert data.joint(joint.name).qpos[0] == pytest.approx(goal, abs=0.05 * span), part.name
            if name == "open":
                assert goal > 0
    for k, handle in enumerate(handles(obj)):  # told to stay, they do under a hand's 25 N
        if handle is None:
            continue
        mujoco.mj_resetDataKeyframe(model, data, model.key("closed").id)
        data.ctrl[:] = 0
        name, body = obj.parts[k].name, model.body(obj.parts[handle.part].name).id
        force = 25.0 * opening(obj, k, handle)
        for _ in range(500):
            data.qfrc_applied[:] = 0
            at = data.site(f"{name}_handle").xpos
            mujoco.mj_applyFT(model, data, force, np.zeros(3), at, body, data.qfrc_applied)
            mujoco.mj_step(model, data)
        joint = model.joint(f"{name}_joint")
        most = 0.05 * np.ptp(joint.range) if joint.limited[0] else 0.2 * np.pi  # .1 of a turn
        assert data.joint(joint.name).qpos[0] < most, name

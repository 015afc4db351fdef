"""URDF: what we write reads back, here, in MuJoCo and in yourdfpy."""

from __future__ import annotations

from pathlib import Path

import hand_bodies
import mujoco
import numpy as np
import pytest
import trimesh
import yourdfpy
from asset_objects import make_cabinet
from hypothesis import given
from hypothesis import strategies as st

from uniart_jax.export.bodies import make_bodies
from uniart_jax.export.frames import joint_name
from uniart_jax.export.physics import Box, Hull
from uniart_jax.export.urdf import write_urdf
from uniart_jax.objects.kinematics import Joint, line_distance
from uniart_jax.objects.load import load_object
from uniart_jax.objects.object import ArticulatedObject, Part


def random_object(rng: np.random.Generator) -> ArticulatedObject:
    parts = []
    for k in range(rng.integers(1, 8)):
        low = rng.uniform(-1, 0.5, 3)
        body = trimesh.creation.box(bounds=[low, low + rng.uniform(0.2, 0.6, 3)])
        lo, hi = -rng.uniform(0, 1) * (rng.random() < 0.5), rng.uniform(0.1, 1)
        kind = rng.integers(5)
        turns = {1: 3.0, 2: 3.2, 4: rng.choice([1, 5, 14])}.get(kind, 0.0)
        rate = {3: 0.5, 4: rng.choice([-0.2, 0.2])}.get(kind, 0.0)
        if kind == 2:
            lo, hi = -1, 1
        joint = Joint(
            rng.uniform(-1, 1, 3),
            rng.normal(size=3),
            (lo * turns, hi * turns),
            (lo * rate, hi * rate),
        )
        name = f"part {k} <&>" if k else "base"
        parts.append(
            Part(name, body, int(rng.integers(k)) if k else -1, joint if k else Joint.fixed())
        )
    return ArticulatedObject(tuple(parts), scale=float(rng.uniform(0.05, 3)), name="thing")


def save(obj: ArticulatedObject, folder: Path, bodies=None) -> Path:
    """Meshes in metres beside the URDF, as the exporter does."""
    bodies = bodies or hand_bodies.make_bodies(obj)
    files, hull_files = [], []
    for k, part in enumerate(obj.parts):
        surface = part.mesh.copy()
        surface.apply_scale(obj.scale)
        surface.export(folder / f"{k}.obj")
        files.append([f"{k}.obj"])
        hulls = [shape for shape in bodies[k].shapes if isinstance(shape, Hull)]
        hull_files.append([f"{k}_hull{i}.obj" for i in range(len(hulls))])
        for file, hull in zip(hull_files[-1], hulls, strict=True):
            hull.mesh.export(folder / file)
    return write_urdf(obj, folder, files, bodies, hull_files)


def same_objects(a: ArticulatedObject, b: ArticulatedObject) -> None:
    """Names, tree, meshes and joints, with ``a.scale`` metres a unit against metres."""
    assert [p.name for p in a.parts] == [p.name for p in b.parts]
    assert a.parents == b.parents
    for ours, theirs in zip(a.parts, b.parts, strict=True):
        np.testing.assert_allclose(ours.mesh.bounds * a.scale, theirs.mesh.bounds, atol=2e-6)
        x, y = ours.joint, theirs.joint
        assert x.type == y.type
        if x.type != "fixed":
            np.testing.assert_allclose(x.direction, y.direction, atol=1e-9)
            np.testing.assert_allclose(x.angle, y.angle, atol=1e-9)
            np.testing.assert_allclose(np.multiply(x.travel, a.scale), y.travel, atol=1e-9)
            if x.rotates:
                here = Joint(x.origin * a.scale, x.direction, angle=(0, 1))
                assert line_distance(here, y) < 1e-9


@given(st.integers(0, 2**32 - 1))
def test_written_objects_read_back_the_same(tmp_path_factory, seed):
    obj = random_object(np.random.default_rng(seed)).normalized()
    read = load_object(save(obj, tmp_path_factory.mktemp("trip")))
    same_objects(obj, read)
    assert read.scale == 1 and read.name == "thing"
    assert all("one screw" in n or "collapsed" in n for n in read.provenance)
    same_objects(read, load_object(save(read, tmp_path_factory.mktemp("again"))))
    unit = read.normalized()
    assert unit.scale == pytest.approx(obj.scale)
    assert [j.type for j in unit.joints] == [j.type for j in obj.joints]


@pytest.mark.parametrize("seed", range(6))
def test_mujoco_moves_what_we_write_as_we_do(tmp_path, seed):
    rng = np.random.default_rng(seed)
    obj = random_object(rng).normalized()
    path = save(obj, tmp_path)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    q = np.array([rng.uniform(*j.limits) for j in obj.joints])
    mujoco.mj_kinematics(model, data)
    rest = {p.name: data.body(p.name).xpos.copy() for p in obj.parts[1:]}
    for part, value in zip(obj.parts, q, strict=True):
        if part.joint.type == "fixed":
            continue
        value = value if part.joint.rotates else value * obj.scale
        data.joint(joint_name(part)).qpos[0] = value
        if (
            part.joint.type == "screw"
        ):  # mimic: MuJoCo makes it an equality, which kinematics alone do not hold
            data.joint(f"{part.name}_travel").qpos[0] = value * part.joint.pitch * obj.scale
    mujoco.mj_kinematics(model, data)
    moved = obj.forward_kinematics(q)
    for part, matrix in list(zip(obj.parts, moved, strict=True))[1:]:
        np.testing.assert_allclose(
            data.body(part.name).xmat.reshape(3, 3), matrix[:3, :3], atol=1e-7
        )
        expected = matrix[:3, :3] @ rest[part.name] + matrix[:3, 3] * obj.scale
        np.testing.assert_allclose(data.body(part.name).xpos, expected, atol=1e-7)
    assert model.body_mass[1:].min() > 0


def test_strict_parsers_read_what_we_write(tmp_path):
    obj = random_object(np.random.default_rng(4)).normalized()
    bodies = make_bodies(obj, [part.mesh for part in obj.parts])
    model = yourdfpy.URDF.load(str(save(obj, tmp_path, bodies)))
    for part in obj.parts:
        inertial = model.link_map[part.name].inertial
        principal = np.linalg.eigvalsh(inertial.inertia)
        assert (
            inertial.mass > 0 and principal[0] > 0 and principal[0] + principal[1] >= principal[2]
        )
    assert all(
        j.limit.effort > 0 and j.limit.velocity > 0 for j in model.robot.joints if j.type != "fixed"
    )


def corners(shape: Box | Hull) -> np.ndarray:
    if isinstance(shape, Hull):
        return np.asarray(shape.mesh.vertices)
    grid = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, -1).T
    return grid * shape.size @ shape.rotation.T + shape.center


@pytest.mark.parametrize("seed", range(3))
def test_turned_boxes_and_hulls_stand_where_they_shall(tmp_path, seed):
    """In MuJoCo at a state that is not the shown one, against our own forward kinematics."""
    rng = np.random.default_rng(seed)
    obj = random_object(rng).normalized()
    bodies = hand_bodies.make_bodies(obj)
    model = mujoco.MjModel.from_xml_path(str(save(obj, tmp_path, bodies)))
    data = mujoco.MjData(model)
    q = np.array([rng.uniform(*j.limits) for j in obj.joints])
    for part, value in zip(obj.parts, q, strict=True):
        if part.joint.type != "fixed":
            metric = value if part.joint.rotates else value * obj.scale
            data.joint(joint_name(part)).qpos[0] = metric
        if part.joint.type == "screw":
            data.joint(f"{part.name}_travel").qpos[0] = value * part.joint.pitch * obj.scale
    mujoco.mj_kinematics(model, data)
    for part, body, matrix in zip(obj.parts, bodies, obj.forward_kinematics(q), strict=True):
        link = 0 if part.parent < 0 and part.name not in names(model) else model.body(part.name).id
        geoms = np.flatnonzero(model.geom_bodyid == link)
        assert len(geoms) == len(body.shapes)
        matrix = matrix.copy()
        matrix[:3, 3] *= obj.scale
        for geom, shape in zip(geoms, body.shapes, strict=True):
            meant = trimesh.transform_points(corners(shape), matrix)
            if isinstance(shape, Box):
                assert model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX
                local = corners(Box(np.zeros(3), 2 * model.geom_size[geom], np.eye(3)))
            else:
                mesh = model.geom_dataid[geom]
                start = model.mesh_vertadr[mesh]
                local = model.mesh_vert[start : start + model.mesh_vertnum[mesh]]
            seen = local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
            away = np.linalg.norm(seen[:, None] - meant[None], axis=-1)
            assert max(away.min(0).max(), away.min(1).max()) < 1e-5


def names(model) -> set[str]:
    return {model.body(b).name for b in range(model.nbody)}


def test_mass_and_resistance_arrive(tmp_path):
    obj = make_cabinet()
    bodies = hand_bodies.make_bodies(obj)
    model = mujoco.MjModel.from_xml_path(str(save(obj, tmp_path, bodies)))
    for part, body in list(zip(obj.parts, bodies, strict=True))[1:]:
        link = model.body(part.name)
        assert link.mass[0] == pytest.approx(body.mass)
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, link.iquat)
        turn = turn.reshape(3, 3)
        np.testing.assert_allclose(
            turn @ np.diag(link.inertia) @ turn.T,
            body.inertia,
            atol=1e-6 * np.abs(body.inertia).max(),
        )
        if body.dynamics is None:
            continue
        joint = model.joint(joint_name(part))
        assert joint.damping[0] == pytest.approx(body.dynamics.damping)
        assert joint.frictionloss[0] == pytest.approx(body.dynamics.alone)
    assert model.body("knob_turn").mass[0] < 0.05 * bodies[3].mass
    joints = yourdfpy.URDF.load(str(tmp_path / "object.urdf")).joint_map
    for part, body in zip(obj.parts, bodies, strict=True):
        if body.dynamics is not None:
            limit = joints[joint_name(part)].limit
            assert limit.effort == pytest.approx(body.dynamics.effort)
            assert limit.velocity == pytest.approx(body.dynamics.velocity)


@pytest.mark.pybullet
def test_pybullet_reads_what_we_write(tmp_path):
    import pybullet

    obj = make_cabinet()
    bodies = make_bodies(obj, [p.mesh for p in obj.parts])
    path = save(obj, tmp_path, bodies)
    client = pybullet.connect(pybullet.DIRECT)
    try:
        # Else inertia is guessed from the shapes. Base first, then every link.
        flags = pybullet.URDF_USE_INERTIA_FROM_FILE
        robot = pybullet.loadURDF(str(path), useFixedBase=True, flags=flags, physicsClientId=client)
        found = {}
        for i in range(-1, pybullet.getNumJoints(robot, physicsClientId=client)):
            info = pybullet.getJointInfo(robot, i, physicsClientId=client) if i >= 0 else None
            name = info[12].decode() if info else obj.parts[0].name
            shapes = pybullet.getCollisionShapeData(robot, i, physicsClientId=client)
            mass = pybullet.getDynamicsInfo(robot, i, physicsClientId=client)[0]
            found[name] = (len(shapes), mass, info)
        for part, body in zip(obj.parts, bodies, strict=True):
            count, mass, info = found[part.name]
            assert count == len(body.shapes)
            assert part.parent < 0 or mass == pytest.approx(body.mass)  # the base is held
            if body.dynamics and part.joint.type != "screw":
                assert info[6:8] == pytest.approx((body.dynamics.damping, body.dynamics.alone))
                assert info[10:12] == pytest.approx((body.dynamics.effort, body.dynamics.velocity))
    finally:
        pybullet.disconnect(client)


def test_the_writer_names_what_does_not_fit(tmp_path):
    obj = random_object(np.random.default_rng(0))
    bodies = hand_bodies.make_bodies(obj)
    files = [["a.obj"]] * len(obj.parts)
    with pytest.raises(ValueError, match="entries for"):
        write_urdf(obj, tmp_path, [], bodies, files)
    with pytest.raises(ValueError, match="entries for"):
        write_urdf(obj, tmp_path, files, bodies[1:], files)
    with pytest.raises(ValueError, match="list of files"):
        write_urdf(obj, tmp_path, ["a.obj"] * len(obj.parts), bodies, files)
    with pytest.raises(ValueError, match=r"0 files for the 1 hulls of part"):
        write_urdf(obj, tmp_path, files, bodies, [[]] * len(obj.parts))
    odd = ArticulatedObject((Part("a\x01", trimesh.creation.box()),))
    bodies = make_bodies(odd, [odd.parts[0].mesh])
    with pytest.raises(ValueError, match="XML"):
        write_urdf(odd, tmp_path, [[]], bodies, [[]])
    assert not list(tmp_path.iterdir())

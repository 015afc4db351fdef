"""URDF: what we write reads back, here, in MuJoCo and in yourdfpy."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
import yourdfpy
from hypothesis import given
from hypothesis import strategies as st

from uniart_jax.objects.kinematics import Joint, line_distance
from uniart_jax.objects.load import load_object
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.objects.urdf import joint_name, mesh_inertial, write_urdf


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


def save(obj: ArticulatedObject, folder: Path) -> Path:
    """Meshes in metres beside the URDF, as the exporter does."""
    files = []
    for k, part in enumerate(obj.parts):
        body = part.mesh.copy()
        body.apply_scale(obj.scale)
        body.export(folder / f"{k}.ply")
        files.append([f"{k}.ply"])
    return write_urdf(obj, folder, files)


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
    model = yourdfpy.URDF.load(str(save(obj, tmp_path)))
    for part in obj.parts:
        inertial = model.link_map[part.name].inertial
        principal = np.linalg.eigvalsh(inertial.inertia)
        assert (
            inertial.mass > 0 and principal[0] > 0 and principal[0] + principal[1] >= principal[2]
        )
    assert all(
        j.limit.effort > 0 and j.limit.velocity > 0 for j in model.robot.joints if j.type != "fixed"
    )


def test_the_writer_names_what_does_not_fit(tmp_path):
    obj = random_object(np.random.default_rng(0))
    with pytest.raises(ValueError, match="entries for"):
        write_urdf(obj, tmp_path, [])
    with pytest.raises(ValueError, match="list of files"):
        write_urdf(obj, tmp_path, ["a.obj"] * len(obj.parts))
    odd = ArticulatedObject((Part("a\x01", trimesh.creation.box()),))
    with pytest.raises(ValueError, match="XML"):
        write_urdf(odd, tmp_path, [[]])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "body",
    [
        trimesh.creation.box([1, 2, 3]),
        trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]),
        trimesh.creation.box([1e-6, 1, 1]),
        trimesh.Trimesh(trimesh.creation.box().vertices, trimesh.creation.box().faces[:7]),
        trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], process=False),
    ],
)
def test_inertia_is_possible_whatever_the_mesh(body):
    mass, center, inertia = mesh_inertial(body, scale=0.3)
    principal = np.linalg.eigvalsh(inertia)
    assert mass >= 1e-3 and principal[0] > 0 and principal[0] + principal[1] > principal[2]
    assert np.all(center >= body.bounds[0] * 0.3 - 1e-3) and np.all(
        center <= body.bounds[1] * 0.3 + 1e-3
    )


def test_inertia_of_a_block():
    mass, center, inertia = mesh_inertial(
        trimesh.creation.box(bounds=[[0, 0, 0], [1, 2, 3]]), scale=0.5
    )
    assert mass == pytest.approx(6 / 8 * 500)
    np.testing.assert_allclose(center, [0.25, 0.5, 0.75])
    expected = mass / 12 * np.diag([1 + 2.25, 0.25 + 2.25, 0.25 + 1])
    np.testing.assert_allclose(inertia, expected, rtol=1e-4)

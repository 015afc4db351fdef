"""The asset folder: complete or absent, and what other people's loaders read from it is what we
meant."""

from __future__ import annotations

import dataclasses
import json
import os

import mujoco
import numpy as np
import pytest
import trimesh
import yourdfpy
from asset_objects import FILES
from PIL import Image

import uniart_jax
from uniart_jax.export import asset as asset_module
from uniart_jax.export.asset import save_asset
from uniart_jax.export.frames import joint_name
from uniart_jax.objects.load import load_object
from uniart_jax.objects.object import ArticulatedObject, Part

Q_SEEDS = range(4)


def random_q(obj: ArticulatedObject, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.array([rng.uniform(*joint.limits) for joint in obj.joints])


def metric_states(obj: ArticulatedObject, q: np.ndarray) -> dict[str, float]:
    """URDF joint -> coordinate in metres and radians, the travel of screws included."""
    states = {}
    for part, value in zip(obj.parts[1:], q[1:], strict=True):
        joint = part.joint
        states[joint_name(part)] = value if joint.rotates else value * obj.scale
        if joint.type == "screw":
            states[f"{part.name}_travel"] = value * joint.pitch * obj.scale
    return states


def moved_points(obj: ArticulatedObject, q: np.ndarray) -> dict[str, np.ndarray]:
    """Part -> its vertices at state q, metres."""
    return {
        part.name: trimesh.transform_points(part.mesh.vertices, matrix) * obj.scale
        for part, matrix in zip(obj.parts, obj.forward_kinematics(q), strict=True)
    }


def test_folder_is_complete(asset):
    assert {p.name for p in asset.iterdir()} == FILES
    assert os.stat(asset).st_mode & 0o555 == 0o555  # others can read it
    assert [p for p in asset.parent.iterdir() if p != asset] == []


def test_meshes_are_watertight_on_disk(stood, asset):
    for stem, part in zip(asset_module.file_stems(stood), stood.parts, strict=True):
        mesh = trimesh.load_mesh(asset / "meshes" / f"{stem}.obj", process=False)
        mesh.merge_vertices(merge_tex=True, merge_norm=True)
        assert mesh.is_watertight
        np.testing.assert_allclose(mesh.bounds, part.mesh.bounds * stood.scale, atol=1e-6)


def test_load_object_reads_the_same_object(stood, asset):
    loaded = load_object(asset)
    assert all("knob" in line for line in loaded.provenance)  # the screw's two joints are one again
    assert {p.name for p in loaded.parts} == {p.name for p in stood.parts}
    for part in stood.parts:
        twin = loaded.parts[loaded.index(part.name)]
        assert twin.joint.type == part.joint.type
        assert twin.mesh.visual.kind == "texture"
        np.testing.assert_allclose(twin.mesh.bounds, part.mesh.bounds * stood.scale, atol=1e-6)
    for seed in Q_SEEDS:
        q = random_q(stood, seed)
        meant = moved_points(stood, q)
        units = [1 if j.rotates else stood.scale for j in stood.joints]
        state = {p.name: v * u for p, v, u in zip(stood.parts, q, units, strict=True)}
        for part, matrix in zip(loaded.parts, loaded.forward_kinematics(state), strict=True):
            seen = trimesh.transform_points(part.mesh.vertices, matrix)
            expected = meant[part.name]
            np.testing.assert_allclose(
                [seen.min(0), seen.max(0)], [expected.min(0), expected.max(0)], atol=1e-6
            )


@pytest.mark.parametrize("seed", Q_SEEDS)
def test_yourdfpy_moves_the_parts_as_we_do(stood, asset, seed):
    robot = yourdfpy.URDF.load(
        str(asset / "object.urdf"), build_collision_scene_graph=True, load_collision_meshes=True
    )
    assert set(robot.actuated_joint_names) == {
        joint_name(p) for p in stood.parts if p.joint.type != "fixed"
    }
    q = random_q(stood, seed)
    states = metric_states(stood, q)
    robot.update_cfg({name: states[name] for name in robot.actuated_joint_names})
    meant = moved_points(stood, q)
    seen = {}
    for node in robot.scene.graph.nodes_geometry:
        matrix, geometry = robot.scene.graph[node]
        link = robot.scene.graph.transforms.parents[node]
        seen[link] = trimesh.transform_points(robot.scene.geometry[geometry].vertices, matrix)
    for name, expected in meant.items():
        np.testing.assert_allclose(seen[name].min(0), expected.min(0), atol=1e-6)
        np.testing.assert_allclose(seen[name].max(0), expected.max(0), atol=1e-6)


@pytest.mark.parametrize("seed", Q_SEEDS)
def test_mujoco_moves_the_parts_as_we_do(stood, asset, seed):
    model = mujoco.MjModel.from_xml_path(str(asset / "object.urdf"))
    q = random_q(stood, seed)
    states = metric_states(stood, q)
    names = {model.joint(j).name for j in range(model.njnt)}
    assert names == {n for n in states if n != "foot_joint"}  # the fixed one is no joint
    data = mujoco.MjData(model)
    for name in names:
        data.qpos[model.joint(name).qposadr[0]] = states[name]
    mujoco.mj_kinematics(model, data)
    for part, matrix in zip(stood.parts, stood.forward_kinematics(q), strict=True):
        body = data.body(part.name)
        frame = body.xmat.reshape(3, 3)
        np.testing.assert_allclose(frame, matrix[:3, :3], atol=1e-6)
        if part.joint.type != "fixed":  # a fixed part's frame is its parent's
            origin = trimesh.transform_points([part.joint.origin], matrix)[0] * stood.scale
            np.testing.assert_allclose(body.xpos, origin, atol=1e-6)


def test_mujoco_reads_masses_limits_and_collision(stood, asset):
    model = mujoco.MjModel.from_xml_path(str(asset / "object.urdf"))
    report = json.loads((asset / "report.json").read_text())
    for entry in report["parts"]:
        assert model.body(entry["name"]).mass[0] == pytest.approx(entry["mass"], rel=1e-6)
    assert model.joint("drawer_joint").range == pytest.approx([0, 0.4 * stood.scale])
    assert model.joint("door_joint").range == pytest.approx([0, 2.0])
    assert model.ngeom == 10  # five walls of the body, one hull for each other part


def test_a_cabinet_can_be_simulated(stood, asset):
    """Gravity for half a second moves nothing far: no contact throws the parts apart."""
    model = mujoco.MjModel.from_xml_path(str(asset / "object.urdf"))
    data = mujoco.MjData(model)
    for _ in range(250):
        mujoco.mj_step(model, data)
    assert np.isfinite(data.qpos).all()
    assert np.abs(data.qvel).max() < 10


def test_report(cabinet, stood, asset):
    report = json.loads((asset / "report.json").read_text())
    assert set(report) == {
        *("category", "from_voxels", "parts", "rest", "shown", "notes", "scale", "seed"),
        "checkpoint",
        *("version", "origin", "collision"),
    }
    assert report["origin"] == "floor"
    assert report["category"] == cabinet.category
    assert report["seed"] == 7 and report["checkpoint"] == "x"
    assert report["version"] == uniart_jax.__version__
    assert report["scale"] == cabinet.scale and report["from_voxels"] is False
    parts = {p["name"]: p for p in report["parts"]}
    keys = {
        "name",
        "parent",
        "type",
        "origin",
        "direction",
        "angle",
        "travel",
        "further_joints",
        "as_read",
        "mass",
        "watertight",
        "shapes",
        "volume_error",
        "handle",
    }
    assert all(set(p) == keys for p in parts.values())
    assert all(p["watertight"] and p["mass"] > 0 for p in parts.values())
    motion = ("parent", "type", "origin", "direction", "angle", "travel")
    assert [parts["body"][key] for key in motion] == [None] * 6
    assert all(1 <= p["shapes"] <= 16 and 0 <= p["volume_error"] < 0.1 for p in parts.values())
    assert parts["knob"]["parent"] == "door" and parts["knob"]["type"] == "screw"
    assert parts["drawer"]["travel"] == pytest.approx([0, 0.4 * cabinet.scale])
    assert parts["door"]["angle"] == pytest.approx([0, 2.0])
    assert parts["door"]["origin"] == pytest.approx(stood.parts[1].joint.origin * stood.scale)
    assert parts["door"]["as_read"]["angle"] == pytest.approx([-0.4, 1.6])
    for part in cabinet.parts[1:]:
        read = parts[part.name]["as_read"]
        assert read["name"] == part.name
        assert read["origin"] == pytest.approx(part.joint.origin * cabinet.scale)
        assert read["direction"] == pytest.approx(part.joint.direction)
        assert read["travel"] == pytest.approx(np.array(part.joint.travel) * cabinet.scale)
    moving = {joint_name(p) for p in cabinet.parts if p.joint.type != "fixed"}
    assert report["rest"] == dict.fromkeys(moving, 0.0)
    assert report["shown"] == dict.fromkeys(moving, 0.0) | {"door_joint": pytest.approx(0.4)}


def test_what_was_read_is_found_again(stood, cabinet, asset):
    """The written object at ``shown`` is the one that was given, but for where it stands."""
    report, loaded = json.loads((asset / "report.json").read_text()), load_object(asset)
    state = {p["name"]: report["shown"].get(f"{p['name']}_joint", 0.0) for p in report["parts"]}
    shift = (cabinet.parts[0].mesh.bounds - stood.parts[0].mesh.bounds)[0] * cabinet.scale
    for part, matrix in zip(loaded.parts, loaded.forward_kinematics(state), strict=True):
        seen = trimesh.transform_points(part.mesh.vertices, matrix) + shift
        meant = cabinet.parts[cabinet.index(part.name)].mesh.bounds * cabinet.scale
        np.testing.assert_allclose([seen.min(0), seen.max(0)], meant, atol=1e-6)


def test_handles_tell_which_way_they_open(stood, asset):
    """Each point, a little later, lies where ``opening`` points."""
    report = json.loads((asset / "report.json").read_text())
    for k, entry in enumerate(report["parts"]):
        held = entry["handle"]
        if held is None:
            continue
        assert held["opens"] == 1
        q = np.zeros(len(stood.parts))
        q[k] = 1e-5
        carrier = stood.index(held["part"])
        point = np.array(held["point"]) / stood.scale
        there = trimesh.transform_points([point], stood.forward_kinematics(q)[carrier])[0]
        way = (there - point) / np.linalg.norm(there - point)
        np.testing.assert_allclose(way, held["opening"], atol=1e-3)


def test_the_texture_is_the_only_one(asset):
    with Image.open(asset / "meshes" / "texture.png") as texture:
        assert texture.mode == "RGB" and 512 <= max(texture.size) <= 2048
    assert len(list((asset / "meshes").glob("*.mtl"))) == 1


def test_strange_names_make_plain_files(block, tmp_path):
    names = ["../../etc/passwd", "a b/c", "A_B_C", "Tür & Angel", "", "x" * 300]
    base = block.parts[0]
    parts = [
        Part(name, base.mesh.copy().apply_translation([2 * k, 0, 0]), 0 if k else -1)
        for k, name in enumerate(names)
    ]
    folder = save_asset(ArticulatedObject(tuple(parts)), tmp_path / "out", motion=False)
    assert {p.parent for p in folder.rglob("*.obj")} <= {
        folder / "meshes",
        folder / "meshes/collision",
    }
    assert len(list(folder.rglob("*.obj"))) == len(names)  # boxes need no files


def test_flat_open_and_tiny_parts_load_in_mujoco(block, tmp_path):
    sheet = trimesh.Trimesh([[0, 0, 2], [1, 0, 2], [1, 1, 2], [0, 1, 2]], [[0, 1, 2], [0, 2, 3]])
    lid = block.parts[1]
    for name, mesh in (
        ("sheet", sheet),
        ("triangle", trimesh.Trimesh(sheet.vertices[:3], [[0, 1, 2]])),
        ("speck", trimesh.creation.box([1e-4] * 3)),
    ):
        obj = dataclasses.replace(
            block, parts=(block.parts[0], dataclasses.replace(lid, mesh=mesh))
        )
        folder = save_asset(obj, tmp_path / name, motion=False)
        model = mujoco.MjModel.from_xml_path(str(folder / "object.urdf"))
        assert model.njnt == 1
        report = json.loads((folder / "report.json").read_text())
        assert report["parts"][1]["watertight"]
        told = f"open surfaces were given a thickness: '{lid.name}'" in report["notes"]
        assert told == (name != "speck")


def test_save_method_and_image(block, tmp_path):
    image = np.zeros((40, 60, 4), np.uint8)
    image[10:30, 10:50] = 255
    folder = block.save(tmp_path / "out", image=image, motion=False)
    with_image = Image.open(folder / "preview.png").width
    block.save(folder, overwrite=True, motion=False)
    assert Image.open(folder / "preview.png").width < with_image


def test_formats_are_chosen(block, tmp_path):
    folder = save_asset(block, tmp_path / "out", formats=("stl", "page"), motion=False)
    always = {"object.urdf", "meshes", "preview.png", "report.json"}
    assert {p.name for p in folder.iterdir()} == always | {"view.html", "print"}
    assert len(list((folder / "print").glob("*.stl"))) == len(block.parts)
    with pytest.raises(ValueError, match="unknown format 'fbx'; there are urdf, mjcf") as error:
        save_asset(block, tmp_path / "other", formats=("fbx",))
    assert "\n" not in str(error.value) and not (tmp_path / "other").exists()


def test_size_density_and_mass(block, tmp_path):
    def masses(**options):
        folder = save_asset(
            block, tmp_path / "out", formats=(), motion=False, overwrite=True, **options
        )
        report = json.loads((folder / "report.json").read_text())
        return np.array([p["mass"] for p in report["parts"]]), load_object(folder)

    light, obj = masses(size=2.0, density=100.0)
    assert (obj.bounds[1] - obj.bounds[0]).max() == pytest.approx(2.0)
    heavy, _ = masses(size=2.0, density=300.0)
    np.testing.assert_allclose(heavy, 3 * light, rtol=1e-6)
    given, _ = masses(mass=12.5)
    assert given.sum() == pytest.approx(12.5)
    for options in ({"density": 100.0, "mass": 1.0}, {"density": -1.0}, {"mass": np.nan}):
        with pytest.raises(ValueError, match="mass"):
            masses(**options)
    assert (tmp_path / "out" / "report.json").is_file()


def test_a_check_sees_the_complete_folder_and_its_verdict_is_reported(block, tmp_path):
    seen = []

    def check(folder):
        seen.extend(p.name for p in folder.iterdir())
        assert json.loads((folder / "report.json").read_text())["parts"]
        return {"engine": {"loads": {"passed": True, "value": 0.0, "limit": 0}}}

    folder = save_asset(block, tmp_path / "out", formats=("mjcf",), motion=False, check=check)
    assert {"object.urdf", "object.xml", "report.json"} <= set(seen)
    assert json.loads((folder / "report.json").read_text())["validation"]["engine"]["loads"][
        "passed"
    ]

    def fail(folder):
        raise ValueError("no engine")

    with pytest.raises(ValueError, match="no engine"):
        save_asset(block, tmp_path / "out", formats=(), check=fail, overwrite=True)
    assert (folder / "object.xml").is_file()

"""The GLB: kinematic tree as nodes, y up, one texture, joints as extras and as animations."""

from __future__ import annotations

import json
import os
import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hand_bodies import make_surface
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from uniart_jax.export.atlas import make_atlas
from uniart_jax.export.glb import CLIP_SECONDS, Y_UP, write_glb
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part

VALIDATOR = "gltf-validator"  # Khronos's own, from npm
CHECK = """
const validator = require(process.argv[1]);
const data = new Uint8Array(require("fs").readFileSync(process.argv[2]));
validator.validateBytes(data).then((report) => console.log(JSON.stringify(report)));
"""


def contents(path: Path) -> tuple[dict, bytes]:
    """(JSON, buffer)."""
    data = path.read_bytes()
    length = struct.unpack("<I", data[12:16])[0]
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def floats(tree: dict, buffer: bytes, index: int) -> np.ndarray:
    """An accessor's values [count, width]; its view must fit and its least and largest values be
    true."""
    accessor = tree["accessors"][index]
    view = tree["bufferViews"][accessor["bufferView"]]
    width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
    assert accessor["componentType"] == 5126 and accessor.get("byteOffset", 0) == 0
    assert view["byteLength"] == 4 * width * accessor["count"]
    data = buffer[view["byteOffset"] :][: view["byteLength"]]
    values = np.frombuffer(data, "<f4").reshape(-1, width)
    np.testing.assert_array_equal(values.min(0), np.array(accessor["min"], np.float32))
    np.testing.assert_array_equal(values.max(0), np.array(accessor["max"], np.float32))
    return values.astype(np.float64)


def local_matrix(node: dict) -> np.ndarray:
    if "matrix" in node:
        assert not {"translation", "rotation"} & set(node)
        return np.array(node["matrix"]).reshape(4, 4).T
    x, y, z, w = node.get("rotation", [0, 0, 0, 1])
    matrix = trimesh.transformations.quaternion_matrix([w, x, y, z])
    matrix[:3, 3] = node.get("translation", [0, 0, 0])
    return matrix


def world_matrices(tree: dict, changed: dict[int, dict]) -> dict[str, np.ndarray]:
    """Node name -> [4, 4], with some nodes' properties changed by an animation."""
    found = {}
    waiting = [(i, np.eye(4)) for i in tree["scenes"][0]["nodes"]]
    while waiting:
        index, above = waiting.pop()
        node = tree["nodes"][index]
        matrix = above @ local_matrix(node | changed.get(index, {}))
        found[node["name"]] = matrix
        waiting += [(child, matrix) for child in node.get("children", [])]
    return found


def played(tree: dict, buffer: bytes, clip: dict, time: float) -> dict[int, dict]:
    """Node -> properties at a time, interpolated as the poorest player does: component by
    component, then normalised."""
    changed: dict[int, dict] = {}
    for channel in clip["channels"]:
        sampler = clip["samplers"][channel["sampler"]]
        assert sampler.get("interpolation", "LINEAR") == "LINEAR"
        times = floats(tree, buffer, sampler["input"])[:, 0]
        values = floats(tree, buffer, sampler["output"])
        value = np.array([np.interp(time, times, column) for column in values.T])
        target = channel["target"]
        if target["path"] == "rotation":
            value /= np.linalg.norm(value)
        changed.setdefault(target["node"], {})[target["path"]] = value
    return changed


def clip_error(obj: ArticulatedObject, path: Path) -> float:
    """Largest distance, in sizes of the object, of any part's box corners from where the object has
    them, over all clips and many times."""
    tree, buffer = contents(path)
    moving = [k for k, p in enumerate(obj.parts) if p.parent >= 0 and p.joint.type != "fixed"]
    clips = {clip["name"]: clip for clip in tree.get("animations", [])}
    assert set(clips) == {f"{obj.parts[k].name}_joint" for k in moving}
    shown, rest, opened = world_matrices(tree, {}), obj.rest(), obj.open()
    worst = 0.0
    for k in moving:
        clip = clips[f"{obj.parts[k].name}_joint"]
        end = 2 * np.pi if obj.joints[k].type == "continuous" else opened[k]
        for share in (0, 0.013, 0.25, 0.4321, 0.5, 0.777, 1):
            q = np.zeros(len(obj.parts))
            q[k] = rest[k] + (1 - abs(1 - 2 * share)) * (end - rest[k])
            there = world_matrices(tree, played(tree, buffer, clip, share * CLIP_SECONDS))
            for part, matrix in zip(obj.parts, obj.forward_kinematics(q), strict=True):
                corners = trimesh.bounds.corners(part.mesh.bounds)
                meant = trimesh.transform_points(corners, matrix) * obj.scale
                local = np.linalg.inv(shown[part.name]) @ Y_UP
                seen = trimesh.transform_points(corners * obj.scale, there[part.name] @ local)
                meant = trimesh.transform_points(meant, Y_UP)
                worst = max(worst, float(np.abs(seen - meant).max()))
    return worst / float(np.ptp(obj.bounds, axis=0).max() * obj.scale)


def written(obj: ArticulatedObject, path: Path) -> Path:
    texture = Image.new("RGB", (8, 8), (200, 90, 40))
    return write_glb(obj, [make_surface(p.mesh).textured(texture) for p in obj.parts], path)


@pytest.fixture(scope="module")
def glb(cabinet, tmp_path_factory):
    atlas = make_atlas(cabinet, 256)
    path = tmp_path_factory.mktemp("glb") / "object.glb"
    return write_glb(cabinet, [s.textured(atlas.texture) for s in atlas.surfaces], path)


@pytest.fixture(scope="module")
def tree(glb):
    return contents(glb)[0]


def test_parts_are_where_they_were(cabinet, glb):
    scene = trimesh.load_scene(glb)
    assert set(scene.geometry) == {p.name for p in cabinet.parts}
    for part in cabinet.parts:
        matrix, geometry = scene.graph[part.name]
        seen = scene.geometry[geometry].copy().apply_transform(matrix)
        meant = part.mesh.copy().apply_scale(cabinet.scale).apply_transform(Y_UP)
        np.testing.assert_allclose(seen.bounds, meant.bounds, atol=1e-5)


def test_up_is_y_and_the_front_faces_z(cabinet, glb):
    scene = trimesh.load_scene(glb)
    ours, theirs = cabinet.bounds * cabinet.scale, scene.bounds
    np.testing.assert_allclose(theirs[:, 1], ours[:, 2], atol=1e-5)
    np.testing.assert_allclose(theirs[:, 2], -ours[::-1, 0], atol=1e-5)
    assert np.linalg.det(scene.graph["body"][0][:3, :3]) == pytest.approx(1)


def test_nodes_are_the_kinematic_tree(cabinet, tree):
    nodes = {node["name"]: node for node in tree["nodes"]}
    for part in cabinet.parts:
        children = {tree["nodes"][c]["name"] for c in nodes[part.name].get("children", [])}
        k = cabinet.index(part.name)
        assert children == {p.name for p in cabinet.parts if p.parent == k}


def test_turning_a_node_is_what_its_joint_does(cabinet, glb):
    scene = trimesh.load_scene(glb)
    q = cabinet.open(0.7)
    expected = cabinet.forward_kinematics(q)
    to_metres = np.diag([cabinet.scale] * 3 + [1.0])
    for k, part in enumerate(cabinet.parts[1:], 1):
        local = part.joint.transformed(to_metres)
        motion = (
            type(local)(np.zeros(3), local.direction, local.angle, local.travel).motion(
                q[k] if local.rotates else q[k] * cabinet.scale
            )
            if local.type != "fixed"
            else np.eye(4)
        )
        parent = scene.graph.transforms.parents[part.name]
        resting = scene.graph.transforms.edge_data[(parent, part.name)].get("matrix", np.eye(4))
        scene.graph.update(frame_to=part.name, frame_from=parent, matrix=resting @ motion)
    for k, part in enumerate(cabinet.parts):
        matrix, geometry = scene.graph[part.name]
        seen = trimesh.transform_points(scene.geometry[geometry].vertices, matrix)
        meant = trimesh.transform_points(part.mesh.vertices, expected[k]) * cabinet.scale
        meant = trimesh.transform_points(meant, Y_UP)
        np.testing.assert_allclose(
            [seen.min(0), seen.max(0)], [meant.min(0), meant.max(0)], atol=1e-5
        )


def test_extras_hold_the_joints(cabinet, tree):
    nodes = {node["name"]: node for node in tree["nodes"]}
    assert nodes["body"].get("extras") is None and nodes["foot"].get("extras") is None
    assert nodes["door"]["extras"]["type"] == "revolute"
    assert nodes["drawer"]["extras"]["limits"] == pytest.approx([0, 0.4 * cabinet.scale])
    assert nodes["knob"]["extras"]["pitch"] == pytest.approx(0.04 / 5 * cabinet.scale)
    assert nodes["wheel 1/2"]["extras"]["type"] == "continuous"


def test_one_texture_is_stored_once(tree):
    assert len(tree["images"]) == 1 and len(tree["materials"]) == 1


def test_every_moving_joint_has_a_clip(cabinet, glb):
    """From rest to open and back, every other joint as shown, however the player interpolates."""
    assert clip_error(cabinet, glb) <= 2e-5


def test_clips_go_over_the_whole_range_finely(cabinet, glb):
    tree, buffer = contents(glb)
    nodes = {node["name"]: i for i, node in enumerate(tree["nodes"])}
    paths = {"door": {"rotation"}, "drawer": {"translation"}, "wheel 1/2": {"rotation"}}
    paths["knob"] = {"rotation", "translation"}
    for clip in tree["animations"]:
        name = clip["name"].removesuffix("_joint")
        assert {c["target"]["node"] for c in clip["channels"]} == {nodes[name]}
        assert {c["target"]["path"] for c in clip["channels"]} == paths[name]
        for channel in clip["channels"]:
            sampler = clip["samplers"][channel["sampler"]]
            times = floats(tree, buffer, sampler["input"])[:, 0]
            assert times[0] == 0 and times[-1] == CLIP_SECONDS and (np.diff(times) > 0).all()
            values = floats(tree, buffer, sampler["output"])
            np.testing.assert_allclose(values, values[::-1], atol=1e-6)  # there and back
            if channel["target"]["path"] == "rotation":
                np.testing.assert_allclose(np.linalg.norm(values, axis=1), 1, atol=1e-6)
                steps = 2 * np.arccos(np.clip((values[1:] * values[:-1]).sum(1), -1, 1))
                assert np.rad2deg(steps.max()) < 5.1
                joint = cabinet.joints[cabinet.index(name)]
                span = 2 * np.pi if joint.type == "continuous" else np.ptp(joint.angle)
                assert steps.sum() == pytest.approx(2 * span, rel=1e-3)


BOX = trimesh.creation.box(bounds=[[0, 0, 0], [1, 2, 3]])
SPANS = {
    "revolute": ((-2, 1), (0, 0)),
    "prismatic": ((0, 0), (-0.5, 1)),
    "screw": ((0, 20), (0, 0.4)),
    "left": ((-1, 4), (0.1, -0.4)),
    "continuous": ((-4, 4), (0, 0)),
    "fixed": ((0, 0), (0, 0)),
}


@settings(max_examples=20)
@given(
    direction=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1),
    kinds=st.lists(st.sampled_from(list(SPANS)), min_size=3, max_size=3),
    names=st.lists(
        st.text(st.characters(exclude_categories=["Cs"]), max_size=5)
        | st.sampled_from(["world", "z_up", ""]),
        min_size=4,
        max_size=4,
        unique=True,
    ),
    parents=st.tuples(st.just(0), st.integers(0, 1), st.integers(0, 2)),
)
def test_any_tree_is_animated(tmp_path_factory, direction, kinds, names, parents):
    parts = [Part(names[0], BOX)]
    for k, (kind, parent) in enumerate(zip(kinds, parents, strict=True), 1):
        joint = Joint([k, 0.3, 2], np.roll(direction, k), *SPANS[kind])
        parts.append(Part(names[k], BOX, parent, joint))
    obj = ArticulatedObject(tuple(parts), scale=0.3)
    assert clip_error(obj, written(obj, tmp_path_factory.mktemp("any") / "object.glb")) <= 2e-5


def test_a_joint_of_the_root_means_nothing(tmp_path):
    root = Part("root", BOX, -1, Joint([1, 2, 3], [0, 0, 1], (-1, 1)))
    obj = ArticulatedObject((root, Part("arm", BOX, 0, Joint([0, 1, 0], [0, 1, 0], (0, 2)))))
    path = written(obj, tmp_path / "object.glb")
    assert clip_error(obj, path) <= 2e-5
    nodes = {node["name"]: node for node in contents(path)[0]["nodes"]}
    assert "extras" not in nodes["root"] and "extras" in nodes["arm"]


def test_what_does_not_move_has_no_clip(tmp_path):
    obj = ArticulatedObject((Part("alone", BOX),))
    assert "animations" not in contents(written(obj, tmp_path / "object.glb"))[0]


def test_a_mesh_for_every_part(tmp_path):
    with pytest.raises(ValueError, match="meshes has 0 entries for 1 parts"):
        write_glb(ArticulatedObject((Part("alone", BOX),)), [], tmp_path / "object.glb")


def validator() -> str:
    """Where Khronos's validator lies: GLTF_VALIDATOR names its folder, or npm has it globally; else
    the test is skipped."""
    install = f"npm install -g {VALIDATOR} (or GLTF_VALIDATOR=<its folder>)"
    if shutil.which("node") is None:
        pytest.skip(f"needs Node.js, then: {install}")
    folder = os.environ.get("GLTF_VALIDATOR", "")
    if not folder and (npm := shutil.which("npm")):
        root = subprocess.run([npm, "root", "-g"], capture_output=True, text=True).stdout.strip()
        folder = str(Path(root) / VALIDATOR)
    if not (Path(folder) / "package.json").is_file():
        pytest.skip(install)
    return folder


@pytest.mark.node
@pytest.mark.parametrize("case", ["cabinet", "odd", "still"])
def test_khronos_finds_no_fault(cabinet, glb, tmp_path, case):
    """No error and no warning, also of triangles without area, of names that need escapes and of
    what does not move."""
    folder = validator()
    if case == "cabinet":
        path = glb
    else:
        points = np.vstack([BOX.vertices, [[2, 0, 0], [3, 0, 0], [4, 0, 0]]])
        flat = trimesh.Trimesh(points, np.vstack([BOX.faces, [[8, 9, 10]]]), process=False)
        screw = Joint([1, 0, 0], [1, 1, 0], (0, 30), (0, 0.1))
        parts = (Part("", flat), Part('ü"\n門', BOX, 0, screw), Part("z_up", BOX, 1))
        obj = ArticulatedObject(parts[: 3 if case == "odd" else 1], scale=0.01)
        path = written(obj, tmp_path / "object.glb")
    run = subprocess.run(
        ["node", "-e", CHECK, folder, str(path)], capture_output=True, text=True, check=True
    )
    issues = json.loads(run.stdout)["issues"]
    assert issues["numErrors"] == issues["numWarnings"] == 0, issues["messages"]

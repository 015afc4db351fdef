"""The GLB: kinematic tree as nodes, y up, one texture, joints as extras."""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest
import trimesh

from uniart_jax.export.atlas import make_atlas
from uniart_jax.export.glb import Y_UP, write_glb


@pytest.fixture(scope="module")
def glb(cabinet, tmp_path_factory):
    atlas = make_atlas(cabinet, 256)
    path = tmp_path_factory.mktemp("glb") / "object.glb"
    return write_glb(cabinet, [s.textured(atlas.texture) for s in atlas.surfaces], path)


@pytest.fixture(scope="module")
def tree(glb):
    data = glb.read_bytes()
    length = struct.unpack("<I", data[12:16])[0]
    return json.loads(data[20 : 20 + length])


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

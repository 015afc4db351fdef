"""Reading SINGAPO's object.json and CAGE's train.json: frame, joints, meshes, and what is
refused."""

from __future__ import annotations

import copy
import json
import time

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from trimesh.transformations import rotation_matrix
from urdf_texts import notes

from uniart_jax.objects import singapo
from uniart_jax.objects.appearance import sample_color
from uniart_jax.objects.load import load_object

# y up, front +z -> z up, front -x (PartNet-Mobility's base joint)
TURN = np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]])


def node(number, parent, name, center, size, kind="fixed", axis=(), span=(0, 0), **more) -> dict:
    joint = {"type": kind, "range": list(span)}
    if axis:
        joint["axis"] = {"origin": list(axis[0]), "direction": list(axis[1])}
    box = {"center": list(center), "size": list(size)}
    return {
        "id": number,
        "parent": parent,
        "name": name,
        "children": [],
        "joint": joint,
        "aabb": box,
        **more,
    }


def cabinet() -> dict:
    """A body, a door hinged on its right front edge, a handle on it, a drawer and a knob."""
    tree = [
        node(0, -1, "base", (0, 0, 0), (1, 1, 1)),
        node(1, 0, "door", (0, 0.2, 0.6), (1, 0.6, 0.1), "revolute", ((0.5, 0, 0.6), (0, 1, 0)), (0, 90)),  # noqa: E501
        node(2, 1, "handle", (-0.4, 0.2, 0.7), (0.1, 0.1, 0.1)),
        node(3, 0, "door", (0, -0.3, 0.6), (1, 0.3, 0.1), "prismatic", ((9, 9, 9), (0, 0, 2)), (0, 0.4)),  # noqa: E501
        node(4, 1, "knob", (0.3, 0.2, 0.7), (0.1, 0.1, 0.1), "continuous", ((0.3, 0.2, 0), (0, 0, 1))),  # noqa: E501
    ]  # fmt: skip
    for child, parent in ((1, 0), (2, 1), (3, 0), (4, 1)):
        tree[parent]["children"].append(child)
    return {"meta": {"obj_cat": "StorageFurniture", "tree_hash": "x"}, "diffuse_tree": tree}


@pytest.fixture
def load(tmp_path):
    def read(document, **options):
        text = document if isinstance(document, str) else json.dumps(document)
        (tmp_path / "object.json").write_text(text)
        return load_object(tmp_path, **options)

    return read


def test_frame_tree_and_joints(load):
    obj = load(cabinet())
    assert [p.name for p in obj.parts] == ["base", "door", "door_2", "handle", "knob"]
    assert obj.parents == [-1, 0, 0, 1, 1] and obj.category == "StorageFurniture"
    assert [j.type for j in obj.joints] == ["fixed", "revolute", "prismatic", "fixed", "continuous"]
    np.testing.assert_allclose(obj.parts[1].box, [-0.6, 0, 0.2, 0.1, 1, 0.6], atol=1e-9)
    door, drawer = obj.joints[1], obj.joints[2]
    np.testing.assert_allclose(door.origin, [-0.6, -0.5, 0], atol=1e-9)
    np.testing.assert_allclose(door.direction, [0, 0, 1], atol=1e-9)
    np.testing.assert_allclose(door.angle, (0, np.pi / 2), atol=1e-9)
    np.testing.assert_allclose(drawer.direction, [-1, 0, 0], atol=1e-9)  # to the front
    np.testing.assert_allclose(drawer.travel, (0, 0.4), atol=1e-9)
    assert len(notes(obj, "it names no mesh; shown by its box")) == 5


@given(fractions=st.lists(st.floats(0, 1), min_size=3, max_size=3))
def test_forward_kinematics_is_that_of_the_rest_frame(tmp_path_factory, fractions):
    """Moved in SINGAPO's own frame with trimesh's rotations, then turned: the same vertices."""
    path = tmp_path_factory.mktemp("c") / "object.json"
    path.write_text(json.dumps(cabinet()))
    obj = load_object(path)
    door, drawer, knob = fractions
    q = {"door": door * np.pi / 2, "door_2": drawer * 0.4, "knob": knob * 3}
    here = obj.forward_kinematics(q)
    swing = rotation_matrix(door * np.pi / 2, (0, 1, 0), (0.5, 0, 0.6))
    slide = np.eye(4)
    slide[2, 3] = drawer * 0.4
    spin = swing @ rotation_matrix(knob * 3, (0, 0, 1), (0.3, 0.2, 0))
    for part, matrix, theirs in zip(
        obj.parts, here, (np.eye(4), swing, slide, swing, spin), strict=True
    ):
        raw = part.mesh.vertices @ TURN
        ours = trimesh.transform_points(part.mesh.vertices, matrix)
        np.testing.assert_allclose(ours, trimesh.transform_points(raw, theirs) @ TURN.T, atol=1e-9)


def test_ranges_that_open_backwards_and_a_screw(load):
    document = cabinet()
    document["diffuse_tree"][1]["joint"]["range"] = [0, -90]
    document["diffuse_tree"][3]["joint"]["type"] = "screw"
    obj = load(document)
    np.testing.assert_allclose(obj.joints[1].angle, (-np.pi / 2, 0), atol=1e-9)
    assert obj.joints[2].type == "prismatic" and notes(obj, "a screw whose turn is not in the file")
    assert not notes(obj, "swapped") and not notes(obj, "degrees")
    document["diffuse_tree"][1]["joint"]["range"] = [0, 720]
    assert load(document).joints[1].type == "continuous"
    document["diffuse_tree"][1]["joint"]["axis"]["direction"] = [None, None, None]
    assert notes(load(document), "its axis is zero; held fixed")


def test_meshes_with_textures_first(load, tmp_path):
    for folder in ("objs", "plys"):
        (tmp_path / folder).mkdir()
    Image.new("RGB", (2, 2), (250, 0, 0)).save(tmp_path / "objs" / "t.png")
    (tmp_path / "objs" / "m.mtl").write_text("newmtl m\nmap_Kd t.png\n")
    (tmp_path / "objs" / "m.obj").write_text(
        "mtllib m.mtl\nusemtl m\nv 1 2 3\nv 2 2 3\nv 1 3 3\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
    )
    trimesh.creation.box(bounds=[[0, 0, 0], [2, 4, 6]]).export(tmp_path / "plys" / "m.ply")
    document = cabinet()
    door = document["diffuse_tree"][1]
    door |= {"objs": ["objs/m.obj"], "plys": ["plys/m.ply"]}
    mesh = load(document).parts[1].mesh
    corners = np.array([[1, 2, 3], [2, 2, 3], [1, 3, 3]]) @ TURN.T
    assert {tuple(np.round(v, 6)) for v in mesh.vertices} == {
        tuple(np.round(v, 6)) for v in corners
    }
    np.testing.assert_allclose(
        sample_color(mesh, np.array([0]), np.full((1, 3), 1 / 3))[0, 1:], 0, atol=1e-6
    )
    (tmp_path / "objs" / "m.obj").unlink()
    obj = load(document)
    np.testing.assert_allclose(obj.parts[1].box, [-3, -1, 2, 6, 2, 4], atol=1e-6)
    assert notes(obj, "its plys are shown, without textures")
    door |= {"objs": ["plys/m.ply"], "plys": None, "attach_objs": ["plys/m.ply", "plys/gone.ply"]}
    assert notes(load(document), "'plys/gone.ply' is missing; left out")
    door |= {"objs": ["gone.obj"], "attach_objs": []}
    with pytest.raises(ValueError, match=r"link 'door': nothing is left of it: mesh 'gone.obj'"):
        load(document)
    for outside in ("../m.ply", "/etc/hostname"):
        door["objs"] = [outside]
        with pytest.raises(ValueError, match="outside the asset's folder"):
            load(document)


def changed(*keys, value):
    """The cabinet with one value replaced."""
    document = copy.deepcopy(cabinet())
    inner = document
    for key in keys[:-1]:
        inner = inner[key]
    inner[keys[-1]] = value
    return document


@pytest.mark.parametrize(
    ("document", "words"),
    [
        ("", "not JSON"),
        ("{", "not JSON"),
        ("[" * 10**5, "JSON"),
        ("[]", "'diffuse_tree'"),
        ('{"diffuse_tree": {}}', "'diffuse_tree'"),
        ('{"diffuse_tree": [1]}', "'diffuse_tree'"),
        (changed("diffuse_tree", 1, "id", value="1"), "id '1'"),
        (changed("diffuse_tree", 1, "id", value=0), "two nodes of the tree have id 0"),
        (changed("diffuse_tree", 1, "parent", value=77), "node 'door': there is no parent 77"),
        (changed("diffuse_tree", 1, "parent", value=2), "cycle through link"),
        (changed("diffuse_tree", 1, "parent", value=-1), "two roots"),
        (changed("diffuse_tree", 1, "joint", value=None), "node 'door': it has no joint"),
        (changed("diffuse_tree", 1, "joint", "type", value="hinge"), "unknown joint type 'hinge'"),
        (changed("diffuse_tree", 1, "joint", "axis", value=None), "its joint has no axis"),
        (changed("diffuse_tree", 1, "joint", "range", value=[0]), "the joint's range should be 2 numbers"),  # noqa: E501
        (changed("diffuse_tree", 1, "joint", "range", value=[0, float("nan")]), "NaN is no number"),
        (changed("diffuse_tree", 1, "joint", "range", value=[0, 10**400]), "should be 2 finite numbers"),  # noqa: E501
        (changed("diffuse_tree", 1, "joint", "axis", "origin", value=["a", 0, 0]), "the axis' origin should be 3"),  # noqa: E501
        (changed("diffuse_tree", 1, "objs", value="m.obj"), "'objs' should be a list"),
        (changed("diffuse_tree", 1, "aabb", "size", value=[1, 2]), "the size of its aabb should be 3"),  # noqa: E501
    ],
)  # fmt: skip
def test_what_is_refused(load, document, words):
    with pytest.raises(ValueError) as caught:
        load(document)
    line = str(caught.value)
    assert "\n" not in line and "object.json" in line
    assert words in line


def test_many_nodes_of_one_name(load):
    tree = [node(i, i - 1, "door", (i, 0, 0), (1, 1, 1)) for i in range(5000)]
    with pytest.raises(ValueError, match="5,000 nodes, more than 4,096"):
        load({"diffuse_tree": tree})
    start = time.process_time()
    names = singapo._names([*tree, *(n | {"id": 5000 + n["id"]} for n in tree)])
    assert time.process_time() - start < 2 and len(set(names.values())) == len(names)


def test_names_are_fit_for_files(load):
    document = changed("diffuse_tree", 1, "name", value="do\ud800or\x1b[31m" + "r" * 100)
    document["meta"]["obj_cat"] = "Cup\ud801" + "p" * 100
    obj = load(document)
    assert obj.parts[1].name == ("do_or_[31m" + "r" * 100)[:80]
    assert obj.category == ("Cup_" + "p" * 100)[:80]
    assert len(notes(obj, "were changed")) == 1
    "".join([*obj.provenance, *(p.name for p in obj.parts)]).encode()


def test_children_that_disagree_are_noted(load):
    assert notes(load(changed("diffuse_tree", 0, "children", value=[1])), "the parents were used")


def test_a_box_without_thickness_is_a_thin_one(load):
    obj = load(changed("diffuse_tree", 1, "aabb", "size", value=[1, 0.5, 0]))
    assert obj.parts[1].mesh.is_volume
    obj = load(changed("diffuse_tree", 1, "aabb", value=None))
    assert [p.name for p in obj.parts] == ["base", "handle", "door_2", "knob"]

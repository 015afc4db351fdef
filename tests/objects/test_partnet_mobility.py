"""Reading PartNet-Mobility folders: made-up ones with every known defect."""

from __future__ import annotations

import json
import math
import os
import shutil

import numpy as np
import pytest
from partnet_folders import DEFECTS, ENDLESS, WORLD, Cabinet, Piece, cabinet, write, write_cabinet
from PIL import Image
from urdf_texts import has_picture, notes

from uniart_jax.objects import partnet_mobility
from uniart_jax.objects.load import load_object
from uniart_jax.objects.object import ArticulatedObject

# The notes that a defect leaves behind, as (words, how many); none if there is nothing to repair.
NOTED = {
    "backwards": [("a smaller b were put in order: 'door' (id 1)", 1)],
    "held fixed": [
        ("joint 'joint_0': fixed in the URDF, a slider from 0 to 0.5 in mobility_v2.json", 1),
        ("joint 'joint_1': fixed in the URDF, a hinge from 0 to 90 degrees in mobility_v2.json", 1),
    ],
    "not unit": [("joint 'joint_1': its axis has length 0.93; normalised", 1)],
    "null direction": [
        ("joint 'joint_0': the direction of its axis is null in mobility_v2.json; the URDF's", 1),
        ("joint 'joint_0': its axis is zero; held fixed", 1),
    ],
    "null in json": [("joint 'joint_0': the direction of its axis is null", 1)],
    "zero direction": [("joint 'joint_1': the direction of its axis is zero", 1)],
    "no limits": [("joint 'joint_2': its limits are absent in mobility_v2.json; the URDF's", 1)],
    "open at zero": [("joint 'joint_1': its limits (0.3491, 1.571) exclude 0; shown at 0.3491", 1)],
    "whole turns": [("a smaller b", 0)],
    "junk": [],
    "pushed in": [("link 'link_0': the URDF shows it at -0.2 of mobility_v2.json's joint", 1)],
    "axis at origin": [("joint 'joint_1': its axis in the URDF is 0 degrees and 0.64 off", 1)],
    "narrower": [("a hinge from 0 to 57.296 degrees in the URDF, a hinge from 0 to 90 degrees", 1)],
    "tilted": [("joint 'joint_1': its axis in the URDF is 11.3 degrees and", 1)],
    "movable": [("joint 'joint_5': a slider without limits in the URDF, a root in mobility_v2", 1)],
    "free part": [("'flap' (id 3) is free of its parent; held fixed", 1)],
    "other parent": [("link 'link_3': on 'link_5' in the URDF, on 'link_1' in mobility_v2.json", 1)],  # noqa: E501
    "renamed": [("'drawer' (id 0, slider) has no link in the URDF", 1),
                ("joint 'joint_0': mobility_v2.json does not know link 'my_drawer'; the URDF's", 1)],  # noqa: E501
    "stale names": [],
    "flat sheet": [],
    "missing mesh": [("link 'link_5': mesh 'textured_objs/original-77.obj' is missing; left out", 1)],  # noqa: E501
    "extra obj": [],
    "missing texture": [("its file '../images/texture_0.jpg' is missing", 6)],
    "escaping texture": [("lies outside the asset's folder and was not read", 6)],
    "no meta": [("meta.json is missing or names no model_cat; the category is unknown", 1)],
    "scaled": [],
    "endless cap": [("link 'link_4' move it independently; all are kept", 1)],
}  # fmt: skip
# said of every cabinet: its root without a mesh, the cap's two motions and the URDF's endless one
ALWAYS = (
    "links without a mesh were collapsed: 'base', 'link_4_helper'",
    "'joint_4_helper' and 'joint_4' of link 'link_4' move it independently; all are kept",
    "joint 'joint_4': a slider from 0 to 0.2 and a hinge without limits in the URDF, a slider from",
)


@pytest.mark.parametrize("defect", ["", *DEFECTS])
def test_a_cabinet_with_a_defect_is_the_cabinet(tmp_path, defect):
    """Shape, forward kinematics at random states and limits are the truth's, and the repair is
    recorded."""
    assert set(NOTED) == set(DEFECTS)
    made = write_cabinet(tmp_path / "4711", *[defect] * bool(defect))
    obj = load_object(made.folder)
    _check_kinematics(obj.single_jointed(), made)
    assert obj.name == "4711"
    assert obj.category == ("" if defect == "no meta" else "StorageFurniture")
    for words, count in NOTED.get(defect, []):
        assert len(notes(obj, words)) == count, obj.provenance
    if defect != "endless cap":
        assert len(obj.provenance) == len(ALWAYS) + sum(n for _, n in NOTED.get(defect, []))
    if defect not in ("endless cap", "junk", "scaled"):
        for words in ALWAYS:
            assert len(notes(obj, words)) == 1, obj.provenance
        assert ALWAYS[0] in obj.provenance  # the URDF's own helper is gone
    for part in obj.parts:
        assert has_picture(part) == ("texture" not in defect)
    labels = {p.name: p.label for p in obj.parts}
    known = {made.link(n): n for n in made.linked}
    if defect == "renamed":  # the door is found by its line; nothing tells the drawer
        known["my_drawer"] = ""
    assert labels == known


def test_defects_come_together(tmp_path):
    """Whole folders are never wrong in one way only."""
    for defects in (
        ("junk", "backwards", "held fixed", "pushed in"),
        ("scaled", "pushed in", "axis at origin", "narrower"),
        ("scaled", "open at zero", "held fixed"),
        ("scaled", "held fixed", "movable", "other parent", "junk"),
    ):
        made = write_cabinet(tmp_path / "-".join(defects), *defects)
        _check_kinematics(load_object(made.folder).single_jointed(), made)


def test_the_front_is_minus_x_and_doors_open_outwards(tmp_path):
    obj = load_object(write_cabinet(tmp_path).folder)
    opened = obj.shown_at(obj.open())
    for link in ("link_0", "link_1", "link_3"):
        moved = opened.parts[opened.index(link)].box[0] - obj.parts[obj.index(link)].box[0]
        assert moved < -0.05
    assert opened.parts[opened.index("link_4")].box[2] > obj.parts[obj.index("link_4")].box[2]


def test_without_the_json_the_urdf_tells_the_joints(tmp_path):
    made = write_cabinet(tmp_path, "held fixed")
    (tmp_path / "mobility_v2.json").unlink()
    obj = load_object(tmp_path)
    assert obj.parts[obj.index("link_1")].joint.type == "fixed" and obj.category == ""
    write(made)
    (tmp_path / "mobility.urdf").rename(tmp_path / "mine.urdf")
    assert load_object(tmp_path).parts[obj.index("link_1")].joint.type == "fixed"


def test_links_that_the_json_does_not_know_keep_the_urdfs_joint(tmp_path):
    """A host's own part on the door: it goes where the door goes, and turns as the URDF says."""
    made = write_cabinet(tmp_path)
    box = '<visual><geometry><box size=".1 .1 .1"/></geometry></visual>'
    ends = '<parent link="link_1"/><child link="mine"/><origin xyz=".2 0 .1"/>'
    added = (
        f'<link name="mine">{box}</link><joint name="own" type="revolute">{ends}'
        '<axis xyz="0 0 1"/><limit lower="0" upper="1"/></joint></robot>'
    )
    text = (tmp_path / "mobility.urdf").read_text().replace("</robot>", added)
    (tmp_path / "mobility.urdf").write_text(text)
    obj = load_object(tmp_path)
    mine = obj.parts[obj.index("mine")]
    assert obj.parts[mine.parent].name == "link_1" and mine.label == ""
    place = WORLD @ [*np.add(made.pieces["door"].origin, (0.2, 0, 0.1)), 1]
    np.testing.assert_allclose(mine.box[:3], place[:3], atol=1e-9)
    np.testing.assert_allclose(mine.joint.limits, (0, 1))
    assert len(notes(obj, "joint 'own': mobility_v2.json does not know link 'mine'")) == 1


def test_a_tree_that_the_urdf_hangs_upside_down(tmp_path):
    """The door as the URDF's root with the body on it: the JSON's root is the root, and the hinge
    turns the door."""
    box = '<visual><origin xyz="{}"/><geometry><box size=".5 .5 .5"/></geometry></visual>'
    (tmp_path / "mobility.urdf").write_text(
        f'<robot name="r"><link name="base"/><link name="link_0">{box.format("1 0 0")}</link>'
        f'<link name="link_1">{box.format("0 0 0")}</link>'
        '<joint name="a" type="fixed"><parent link="base"/><child link="link_0"/></joint>'
        '<joint name="b" type="revolute"><parent link="link_0"/><child link="link_1"/>'
        '<axis xyz="0 0 1"/><limit lower="0" upper="1"/></joint></robot>'
    )
    axis = {"origin": [0.5, 0, 0], "direction": [0, 1, 0]}
    door = _entry(jointData={"axis": axis, "limit": {"a": 0, "b": 90, "noLimit": False}})
    (tmp_path / "mobility_v2.json").write_text(json.dumps([door, ROOT]))
    obj = load_object(tmp_path)
    assert [p.name for p in obj.parts] == ["link_1", "link_0"] and obj.parents == [-1, 0]
    np.testing.assert_allclose(obj.parts[1].joint.origin, (0.5, 0, 0))
    np.testing.assert_allclose(obj.boxes[:, :3], [[0, 0, 0], [1, 0, 0]], atol=1e-9)
    assert notes(obj, "link 'link_0': on the root in the URDF, on 'link_1' in mobility_v2.json")


def test_textures_behind_links_and_dots_are_not_read(tmp_path):
    outside = tmp_path / "texture_0.jpg"
    Image.new("RGB", (4, 4), (0, 0, 255)).save(outside)
    folder = tmp_path / "asset"
    write_cabinet(folder, "escaping texture")
    assert notes(load_object(folder), "lies outside the asset's folder")
    image = load_object(folder, allow_outside=True).parts[0].mesh.visual.material.image
    assert image.getpixel((0, 0))[2] > 200
    shutil.rmtree(folder)
    write_cabinet(folder)
    (folder / "images" / "texture_0.jpg").unlink()
    (folder / "images" / "texture_0.jpg").symlink_to(outside)
    obj = load_object(folder)
    assert notes(obj, "lies outside the asset's folder")
    assert not any(has_picture(p) for p in obj.parts)


def _entry(**changed) -> dict:
    axis = {"origin": [0, 0, 0], "direction": [0, 1, 0]}
    data = {"axis": axis, "limit": {"a": 0, "b": 90, "noLimit": False}}
    entry = {"id": 0, "parent": 1, "joint": "hinge", "name": "door", "parts": [], "jointData": data}
    return entry | changed


ROOT = {"id": 1, "parent": -1, "joint": "heavy", "name": "body", "parts": [], "jointData": {}}
BAD_AXIS = {"axis": {"origin": [0, 0, 0], "direction": [0, "x", 0]}, "limit": {"noLimit": True}}
SHORT_AXIS = {"axis": {"origin": [0, 0], "direction": [0, 1, 0]}, "limit": {"noLimit": True}}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is not JSON"),
        (b"{", "is not JSON"),
        (b"\xff\xfe\x00", "is not JSON"),
        (b"[" * 200_000, "is not JSON"),
        ({}, "not a list of parts"),
        ([], "not a list of parts"),
        ([1, 2], "not a list of parts"),
        ([{}] * 5000, "lists 5,000 parts, more than 4,096"),
        ([{"id": 0}], "part 0 should have an integer id"),
        ([_entry(id=True), ROOT], "part 0 should have an integer id"),
        ([_entry(parent="body"), ROOT], "part 0 should have an integer id and parent"),
        ([_entry(joint=None), ROOT], "and a joint"),
        ([_entry(id=1), ROOT], "two parts have id 1"),
        ([_entry(parent=7), ROOT], "hangs on part 7, which is absent"),
        ([_entry(), ROOT | {"parent": 0}], "cycle through part"),
        ([_entry(jointData=[1]), ROOT], "part 0: jointData should hold"),
        ([_entry(jointData={"axis": 3}), ROOT], "part 0: jointData should hold"),
        ([_entry(jointData=BAD_AXIS), ROOT], "part 0: 'x' is not a finite number"),
        ([_entry(jointData=SHORT_AXIS), ROOT], "an axis needs three numbers"),
        (b'[{"id": 0, "parent": 1, "joint": "hinge", "jointData": {"axis": {"origin": [0, 0, 1e400]}}}, '  # noqa: E501
         b'{"id": 1, "parent": -1, "joint": "heavy"}]', "not a finite number"),
    ],
)  # fmt: skip
def test_a_broken_json_is_one_line(tmp_path, content, words):
    write_cabinet(tmp_path)
    data = content if isinstance(content, bytes) else json.dumps(content).encode()
    (tmp_path / "mobility_v2.json").write_bytes(data)
    with pytest.raises(ValueError) as caught:
        load_object(tmp_path)
    line = str(caught.value)
    assert words in line and "\n" not in line
    assert "mobility_v2.json" in line and len(line) < 1000


def test_json_files_are_fenced_and_of_a_sane_size(tmp_path, monkeypatch):
    folder = tmp_path / "asset"
    write_cabinet(folder)
    for name in ("mobility_v2.json", "meta.json"):
        (folder / name).rename(tmp_path / name)
        (folder / name).symlink_to(tmp_path / name)
    with pytest.raises(ValueError, match=r"mobility_v2\.json lies outside the asset's folder"):
        load_object(folder)
    assert load_object(folder, allow_outside=True).category == "StorageFurniture"
    (folder / "mobility_v2.json").unlink()
    (tmp_path / "mobility_v2.json").rename(folder / "mobility_v2.json")
    obj = load_object(folder)
    assert obj.category == "" and notes(obj, "meta.json lies outside the asset's folder")
    (folder / "meta.json").unlink()
    for content in ("[]", "{", '{"model_cat": 3}', "[" * 100_000):
        (folder / "meta.json").write_text(content)
        obj = load_object(folder)
        assert obj.category == "" and len(notes(obj, "category is unknown")) == 1
    monkeypatch.setattr(partnet_mobility, "MAX_JSON_BYTES", 100)
    with pytest.raises(ValueError, match=r"mobility_v2.json has more than"):
        load_object(folder)


def _limit_of(tmp_path, name: str, **changed) -> ArticulatedObject:
    """The cabinet with entries of a part's limit replaced; those given as None are taken out."""
    write_cabinet(tmp_path)
    path = tmp_path / "mobility_v2.json"
    nodes = json.loads(path.read_text())
    limit = next(n for n in nodes if n["name"] == name)["jointData"]["limit"]
    limit |= changed
    for key in [k for k, v in changed.items() if v is None]:
        del limit[key]
    path.write_text(json.dumps(nodes))
    return load_object(tmp_path)


def test_flags_are_true_and_one(tmp_path):
    obj = _limit_of(tmp_path, "door", noLimit=1)
    assert obj.parts[obj.index("link_1")].joint.type == "continuous"
    obj = _limit_of(tmp_path, "door", noLimit=0)
    assert obj.parts[obj.index("link_1")].joint.type == "revolute"
    assert not notes(obj, "neither")
    for odd in ("yes", 2, 0.5, [True]):
        obj = _limit_of(tmp_path, "door", noLimit=odd)
        assert notes(obj, "joint 'joint_1': its noLimit is neither true nor false in mobility_v2")
    for flag in ("rotates", "noRotationLimit"):
        assert notes(_limit_of(tmp_path, "cap", **{flag: "x"}), f"its {flag} is neither")
    obj = _limit_of(tmp_path, "cap", rotates=1)
    cap = obj.parts[obj.index("link_4")]
    assert sorted(joint.type for joint in cap.chain) == ["prismatic", "revolute"]


def test_a_rotation_limit_that_is_absent_is_not_zero(tmp_path):
    """The URDF's joint is used: a travel and an endless turn."""
    obj = _limit_of(tmp_path, "cap", rotationLimit=None)
    assert notes(obj, "its rotation limit is absent in mobility_v2.json; the URDF's joint is used")
    obj = _limit_of(tmp_path, "cap", rotationLimit=0)
    assert obj.parts[obj.index("link_4")].joint.type == "prismatic"
    assert not notes(obj, "proportional screw") and notes(obj, "leave no room to move")


def test_pipes_are_not_waited_for(tmp_path):
    write_cabinet(tmp_path)
    (tmp_path / "meta.json").unlink()
    os.mkfifo(tmp_path / "meta.json")
    assert notes(load_object(tmp_path), "meta.json is missing")


def test_unknown_kinds_and_urdfs_that_are_no_tree(tmp_path):
    made = Cabinet(cabinet(), tmp_path)
    made.pieces["door"].kind = "screwdriver"
    made.pieces["door"].urdf |= {"type": "fixed", "origin": made.pieces["door"].origin}
    write(made)
    obj = load_object(tmp_path)
    assert notes(obj, "joint 'joint_1': the kind 'screwdriver' is unknown in mobility_v2.json")
    text = (tmp_path / "mobility.urdf").read_text()
    for old, new, words in (
        ('<child link="link_2"/>', '<child link="link_3"/>', "two parents"),
        ('<parent link="base"/>', '<parent link="link_0"/>', "cycle"),
        ('<child link="link_2"/>', '<child link="gone"/>', "no link 'gone'"),
    ):
        (tmp_path / "mobility.urdf").write_text(text.replace(old, new))
        with pytest.raises(ValueError, match=words):
            load_object(tmp_path)


def _check_kinematics(obj: ArticulatedObject, made: Cabinet) -> None:
    """All parts of the truth, placed, moving and limited as it says, to 1e-6 of the object's
    size."""
    side = float(np.ptp(obj.bounds, axis=0).max())
    names = {obj.index(made.link(n)): n for n in made.linked}
    assert sorted(names) == list(range(len(obj.parts)))
    start = {n: _shown(p) for n, p in made.pieces.items()}
    for k, name in names.items():
        parent = made.pieces[name].parent
        assert obj.parents[k] == (-1 if parent is None else obj.index(made.link(parent)))
        box = obj.parts[k].mesh.bounds
        np.testing.assert_allclose(box, made.corners(name, start), atol=1e-6 * side)
    rng = np.random.default_rng(0)
    for _ in range(8):
        state, q = {}, np.zeros(len(obj.parts))
        for k, name in names.items():
            piece, joint = made.pieces[name], obj.parts[k].joint
            if piece.kind not in ("hinge", "slider") or piece.limits == (0, 0):
                assert joint.type == "fixed"
                continue
            if math.isinf(piece.turn):  # of an endless turn and a travel the larger motion is kept
                assert joint.type == "continuous"
                continue
            lo, hi = piece.limits if piece.limits != ENDLESS else (-180, 180)
            sign = np.sign(joint.direction @ (WORLD[:3, :3] @ piece.direction))
            unit = _unit(piece, made)
            ends = np.sort(sign * unit * (np.array([lo, hi]) - start[name]))
            np.testing.assert_allclose(joint.limits, ends, atol=1e-6)
            state[name] = rng.uniform(lo, hi)
            q[k] = sign * unit * (state[name] - start[name])
        moved = obj.forward_kinematics(q)
        for k, name in names.items():
            true = made.pose(name, state) @ np.linalg.inv(made.pose(name, start))
            np.testing.assert_allclose(moved[k], made.world(true), atol=1e-6 * side)


def _shown(piece: Piece) -> float:
    """Where a piece is shown: at 0, or where its URDF shows it, else the nearest limit."""
    if piece.kind not in ("hinge", "slider"):
        return 0.0
    return float(np.clip(piece.shown, *piece.limits))


def _unit(piece: Piece, made: Cabinet) -> float:
    """The joint's coordinate per unit of the truth's."""
    if piece.kind == "hinge":
        return math.radians(1)
    return math.radians(piece.turn) / float(np.ptp(piece.limits)) if piece.turn else made.scale

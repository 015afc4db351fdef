"""Reading SINGAPO's and DIPO's ``object.json`` and CAGE's ``train.json``: PartNet-Mobility's
objects as these projects distribute them, and what they generate.

    {"meta": {"obj_cat"}, "diffuse_tree": [{"id", "parent" (-1: root), "name", "joint": {"type",
    "range": [0, r], "axis": {"origin", "direction"}},
                                            "aabb": {"center", "size"}, "objs": [files], "plys":
                                              [files]}]}

Everything stands in one frame at rest, y up and front +z; it is turned by PartNet-Mobility's base
joint, rpy (pi/2, 0, -pi/2), to z up and front -x. Ranges are degrees (revolute) or lengths; a
negative r opens the other way. A ``screw`` is PartNet-Mobility's slider that also rotates: its
range is the travel, and how far it turns is not in the file (CAGE's preprocess.py drops it, both
projects draw 45 degrees), so it is read as prismatic, noted. DIPO writes the same format, and the
category "StroageFurniture" where it knows none. Meshes: ``objs`` have textures; where none of them
is there, ``plys``, and CAGE's ``attach_objs``; a node that names none is its ``aabb``.
"""

from __future__ import annotations

import numpy as np
from trimesh.transformations import euler_matrix

from uniart_jax.objects.asset_files import AssetFiles
from uniart_jax.objects.json_text import is_whole, parse_json
from uniart_jax.objects.kinematics import JOINT_TYPES
from uniart_jax.objects.names import Numbered
from uniart_jax.objects.robot import MAX_NUMBER, MAX_PARTS, Geometry, Link, RawJoint, Robot
from uniart_jax.objects.xml_text import MAX_BYTES

TYPING_ERRORS = {"StroageFurniture": "StorageFurniture"}
BASE = euler_matrix(np.pi / 2, 0, -np.pi / 2, axes="sxyz")


def read_singapo(data: bytes, files: AssetFiles) -> Robot:
    """Links and joints of an ``object.json``, z up, front -x.

    Args:
      data: the file.
      files: where its meshes lie.

    Raises:
      ValueError: not JSON, not this format, or a node that lacks what cannot be guessed; one line,
        without the file's name.
    """
    document = parse_json(data, "the file", MAX_BYTES)
    nodes = document.get("diffuse_tree") if isinstance(document, dict) else None
    if not isinstance(nodes, list) or not nodes or not all(isinstance(n, dict) for n in nodes):
        raise ValueError("not an object of SINGAPO or CAGE: it has no list of nodes 'diffuse_tree'")
    if len(nodes) > MAX_PARTS:
        raise ValueError(f"it lists {len(nodes):,} nodes, more than {MAX_PARTS:,}")
    meta = document.get("meta")
    category = meta.get("obj_cat") if isinstance(meta, dict) else None
    category = category if isinstance(category, str) else ""
    robot = Robot("", {}, [], [], radians=True, category=TYPING_ERRORS.get(category, category))
    if category in TYPING_ERRORS:
        robot.notes.append(f"category '{category}': read as '{robot.category}'")
    names = _names(nodes)
    places = {i: _axis(node, names[i])[0] for i, node in zip(names, nodes, strict=True)}
    parents = {i: _parent(node, names, names[i]) for i, node in zip(names, nodes, strict=True)}
    _check_children(nodes, parents, robot.notes)
    for i, node in zip(names, nodes, strict=True):
        frame = np.eye(4)
        parent = parents[i]
        if parent != -1:
            frame[:3, 3] = places[i] - places[parent]
            robot.joints.append(_joint(node, names[i], names[parent], frame, robot.notes))
        own = np.eye(4)
        own[:3, 3] = -places[i]
        robot.links[names[i]] = Link(
            names[i], _visuals(node, names[i], own @ BASE, files, robot.notes), []
        )
    return robot


def _names(nodes: list[dict]) -> dict[int, str]:
    """id -> name; names that repeat are numbered, as every second object has several 'door's."""
    names: dict[int, str] = {}
    fresh = Numbered()
    for node in nodes:
        number = node.get("id")
        if not isinstance(number, int) or isinstance(number, bool) or number < 0:
            raise ValueError(
                f"a node of the tree has id {number!r:.40}, which should be a number from 0"
            )
        if number in names:
            raise ValueError(f"two nodes of the tree have id {number}")
        given = node.get("name")
        names[number] = fresh(given.strip() if isinstance(given, str) and given.strip() else "part")
    return names


def _parent(node: dict, names: dict[int, str], name: str) -> int:
    parent = node.get("parent")
    if not is_whole(parent) or (parent != -1 and parent not in names):
        raise ValueError(f"node '{name}': there is no parent {parent!r:.40}")
    return parent


def _check_children(nodes: list[dict], parents: dict[int, int], notes: list[str]) -> None:
    stated = {
        (child, node["id"])
        for node in nodes
        if isinstance(node.get("children"), list)
        for child in node["children"]
        if is_whole(child)
    }
    if stated and stated != {(c, p) for c, p in parents.items() if p != -1}:
        notes.append("the lists of children disagree with the parents; the parents were used")


def _numbers(value, count: int, where: str, unknown: bool = False) -> np.ndarray:
    """``count`` finite numbers; zeros for nulls if ``unknown`` is allowed."""
    good = isinstance(value, list) and len(value) == count
    if good and unknown and any(v is None for v in value):
        return np.zeros(count)
    if not good or any(isinstance(v, bool) or not isinstance(v, int | float) for v in value):
        raise ValueError(f"{where} should be {count} numbers, got {value!r:.60}")
    if not all(abs(v) <= MAX_NUMBER for v in value):
        raise ValueError(f"{where} should be {count} finite numbers, got {value!r:.60}")
    return np.array(value, dtype=np.float64)


def _joint_of(node: dict, name: str) -> tuple[dict, str]:
    joint = node.get("joint")
    if not isinstance(joint, dict):
        raise ValueError(f"node '{name}': it has no joint")
    kind = joint.get("type")
    if kind not in JOINT_TYPES:
        raise ValueError(f"node '{name}': unknown joint type {kind!r:.40}")
    return joint, kind


def _axis(node: dict, name: str) -> tuple[np.ndarray, np.ndarray]:
    """(origin, direction) [3] of a node's axis, z up; the origin of a node that does not move is
    0."""
    if node.get("parent") == -1:
        return np.zeros(3), np.zeros(3)
    joint, kind = _joint_of(node, name)
    if kind == "fixed":
        return np.zeros(3), np.zeros(3)
    axis = joint.get("axis")
    if not isinstance(axis, dict):
        raise ValueError(f"node '{name}': its joint has no axis")
    origin = _numbers(axis.get("origin"), 3, f"node '{name}': the axis' origin", unknown=True)
    direction = _numbers(
        axis.get("direction"), 3, f"node '{name}': the axis' direction", unknown=True
    )
    return BASE[:3, :3] @ origin, BASE[:3, :3] @ direction


def _joint(node: dict, name: str, parent: str, frame: np.ndarray, notes: list[str]) -> RawJoint:
    joint, kind = _joint_of(node, name)
    axis = _axis(node, name)[1]
    limits = None
    if kind in ("revolute", "prismatic", "screw") and joint.get("range") is not None:
        lo, hi = sorted(_numbers(joint["range"], 2, f"node '{name}': the joint's range").tolist())
        limits = (np.deg2rad(lo), np.deg2rad(hi)) if kind == "revolute" else (lo, hi)
    if kind == "screw":
        notes.append(f"joint '{name}': a screw whose turn is not in the file; read as prismatic")
        kind = "prismatic"
    return RawJoint(name, kind, parent, name, frame, axis, limits, None)


def _visuals(
    node: dict, name: str, origin: np.ndarray, files: AssetFiles, notes: list[str]
) -> list[Geometry]:
    """The node's meshes, in its link's frame."""
    objs, plys, attached = (_listed(node, key, name) for key in ("objs", "plys", "attach_objs"))
    meshes = objs + attached
    if meshes and plys and not any(_there(m, files) for m in meshes):
        notes.append(
            f"link '{name}': none of its objs is there; its plys are shown, without textures"
        )
        meshes = plys
    meshes = meshes or plys
    if meshes:
        return [Geometry("mesh", np.ones(3), origin, filename) for filename in meshes]
    box = node.get("aabb")
    if not isinstance(box, dict):
        return []
    center = _numbers(box.get("center"), 3, f"node '{name}': the center of its aabb")
    size = _numbers(box.get("size"), 3, f"node '{name}': the size of its aabb")
    if np.any(size < 0) or not size.any():
        return []
    notes.append(f"link '{name}': it names no mesh; shown by its box")
    place = np.eye(4)
    place[:3, 3] = center
    return [Geometry("box", np.maximum(size, 1e-3 * size.max()), origin @ place)]


def _listed(node: dict, key: str, name: str) -> list[str]:
    value = node.get(key)
    if value is None:
        return []
    if not isinstance(value, list) or not all(isinstance(v, str) and v.strip() for v in value):
        raise ValueError(f"node '{name}': '{key}' should be a list of file names")
    return list(dict.fromkeys(v.strip() for v in value))


def _there(filename: str, files: AssetFiles) -> bool:
    """Whether a mesh can be read; one outside the asset's folder is found later, and refused by
    name."""
    try:
        files.find(filename)
    except FileNotFoundError:
        return False
    except ValueError:
        return True
    return True

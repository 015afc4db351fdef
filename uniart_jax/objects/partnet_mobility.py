"""A PartNet-Mobility folder: ``mobility.urdf`` for the shapes, ``mobility_v2.json`` for the joints,
``meta.json`` for the category.

    from which file              what
    mobility.urdf                links, their meshes, where these stand with every joint at 0; parents that the JSON cannot tell
    mobility_v2.json             of every joint: its kind, axis, limits and parent (``partnet_joints``); ``Part.label``
    meta.json                    ``ArticulatedObject.category`` (``model_cat``)
    the folder's name            ``ArticulatedObject.name``; the URDF's is a hash
    semantics.txt, result*.json, bounding_box.json       not read: no label reaches a network, and the meshes tell the box

``mobility_v2.json`` is a list of ``{id, parent, joint, name, parts, jointData}``; the annotators
wrote it, and the URDF was made from it. Hosts other than SAPIEN edit the URDF (joints made fixed,
narrower limits, an axis left at the origin) and leave the JSON alone.

    joint                                jointData.limit                                  is read as
    hinge                                a, b: degrees, either order                      a turn between them
    hinge                                noLimit                                          an endless turn
    slider                               a, b: lengths, either order                      a travel between them
    slider                               noLimit                                          a travel without limits
    slider                               rotates, rotationLimit: degrees                  also a turn from 0 to there about the same axis
    slider                               rotates, noRotationLimit                         also an endless turn
    static, free, heavy, fixed, junk     (ignored)                                        the root; held fixed to its parent if it has one
    (any other)                          (ignored)                                        the URDF's joint, noted

A joint comes whole from one file, since a and b belong to the JSON's direction and the URDF flips
the axis where a > b: with a null or zero direction, or limits that are absent or no limits, the
URDF's joint is used as it stands, and that is noted.
"""  # noqa: E501

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from uniart_jax.objects.asset_files import AssetFiles
from uniart_jax.objects.json_text import is_whole, parse_json
from uniart_jax.objects.partnet_freedom import Freedom
from uniart_jax.objects.partnet_joints import Node, arbitrate
from uniart_jax.objects.robot import MAX_NUMBER, MAX_PARTS, Robot
from uniart_jax.objects.urdf_read import read_robot

JOINTS, META = "mobility_v2.json", "meta.json"
MAX_JSON_BYTES = 64 * 2**20
STILL = ("static", "free", "heavy", "fixed", "junk")


def is_partnet(urdf: Path) -> bool:
    """Whether a URDF is the one of a PartNet-Mobility folder."""
    return urdf.name == "mobility.urdf" and (urdf.parent / JOINTS).is_file()


def read_partnet(data: bytes, path: Path, files: AssetFiles) -> Robot:
    """The robot of a PartNet-Mobility folder, z up and front -x, as the URDF's base joint turns it.

    Args:
      data: its ``mobility.urdf``.
      files: of its folder.

    Raises:
      ValueError: the URDF cannot be read, or ``mobility_v2.json`` is malformed or lies outside the
        folder; one line.
    """
    robot = read_robot(data)
    nodes = _nodes(_json(files, JOINTS))
    backwards = [f"'{n.name}' (id {n.id})" for n in nodes if n.backwards]
    if backwards:
        robot.notes.append(
            f"{JOINTS}: limits that run from a to a smaller b were put in order: "
            f"{', '.join(backwards)}"
        )
    arbitrate(robot, nodes)
    robot.name, robot.radians = files.root.name, True
    robot.category = _category(files, robot.notes)
    return robot


def _json(files: AssetFiles, name: str):
    path = files.root / name
    if not files.allowed(path):
        raise ValueError(
            f"{name} lies outside the asset's folder; allow_outside=True (--allow-outside) reads it"
        )
    with path.open("rb") as file:
        data = file.read(MAX_JSON_BYTES + 1)
    return parse_json(data, name, MAX_JSON_BYTES, nan=True)


def _category(files: AssetFiles, notes: list[str]) -> str:
    """``meta.json``'s ``model_cat``; an object can do without it."""
    fault = f"{META} is missing or names no model_cat"
    try:
        meta = _json(files, META) if (files.root / META).is_file() else None
        category = meta.get("model_cat") if isinstance(meta, dict) else None
    except (ValueError, OSError) as error:
        category, fault = None, str(error)
    if isinstance(category, str):
        return category
    notes.append(f"{fault}; the category is unknown")
    return ""


def _nodes(data) -> list[Node]:
    """The parts that ``mobility_v2.json`` lists, in its order.

    Raises:
      ValueError: not a list of parts that form trees.
    """
    if not isinstance(data, list) or not data or not all(isinstance(d, dict) for d in data):
        raise ValueError(f"{JOINTS} is not a list of parts")
    if len(data) > MAX_PARTS:
        raise ValueError(f"{JOINTS} lists {len(data):,} parts, more than {MAX_PARTS:,}")
    nodes: dict[int, Node] = {}
    for index, entry in enumerate(data):
        number, parent = entry.get("id"), entry.get("parent", -1)
        if not is_whole(number) or not is_whole(parent) or not isinstance(entry.get("joint"), str):
            raise ValueError(
                f"{JOINTS}: part {index} should have an integer id and parent, and a joint"
            )
        if number in nodes:
            raise ValueError(f"{JOINTS}: two parts have id {number}")
        name = entry.get("name")
        nodes[number] = _node(
            entry, number, parent, name if isinstance(name, str) else f"part {number}"
        )
    for node in nodes.values():
        visited, above = {node.id}, node.parent
        while above != -1:
            if above not in nodes:
                raise ValueError(f"{JOINTS}: part {node.id} hangs on part {above}, which is absent")
            if above in visited:
                raise ValueError(f"{JOINTS}: the parts form a cycle through part {above}")
            visited.add(above)
            above = nodes[above].parent
    return list(nodes.values())


def _node(entry: dict, number: int, parent: int, name: str) -> Node:
    kind = entry["joint"].strip().lower()
    node = Node(number, parent, kind, name)
    if kind in STILL or parent == -1:
        return node
    if kind not in ("hinge", "slider"):
        return dataclasses.replace(node, fault=f"the kind '{kind[:40]}' is unknown")
    where = f"{JOINTS}: part {number}"
    data = _dict(entry.get("jointData"), where)
    axis, limit = _dict(data.get("axis"), where), _dict(data.get("limit"), where)
    origin, direction = (_vector(axis.get(k), where) for k in ("origin", "direction"))
    if origin is None or direction is None:
        missing = "direction" if direction is None else "origin"
        return dataclasses.replace(node, fault=f"the {missing} of its axis is null")
    if np.linalg.norm(direction) < 1e-9:
        return dataclasses.replace(node, fault="the direction of its axis is zero")
    flags = {k: _flag(limit.get(k)) for k in ("noLimit", "rotates", "noRotationLimit")}
    if odd := [k for k, flag in flags.items() if flag is None]:
        return dataclasses.replace(node, fault=f"its {odd[0]} is neither true nor false")
    a, b = _number(limit.get("a"), where), _number(limit.get("b"), where)
    if flags["noLimit"]:
        a, b = -np.inf, np.inf
    if a is None or b is None:
        return dataclasses.replace(node, fault="its limits are absent")
    lo, hi = min(a, b), max(a, b)
    turns = kind == "hinge"
    if turns:
        lo, hi = np.deg2rad(lo), np.deg2rad(hi)
    freedoms = [Freedom(turns, origin, direction, float(lo), float(hi))]
    if kind == "slider" and flags["rotates"]:
        ends = (-np.inf, np.inf)
        if not flags["noRotationLimit"]:
            turn = _number(limit.get("rotationLimit"), where)
            if turn is None:
                return dataclasses.replace(node, fault="its rotation limit is absent")
            turn = float(np.deg2rad(turn))
            ends = (min(turn, 0.0), max(turn, 0.0))
        freedoms.append(Freedom(True, origin, direction, float(ends[0]), float(ends[1])))
    return dataclasses.replace(node, freedoms=tuple(freedoms), backwards=a > b)


def _dict(value, where: str) -> dict:
    if value is None:
        return {}
    if not isinstance(value, dict):
        raise ValueError(f"{where}: jointData should hold an axis and a limit")
    return value


def _flag(value) -> bool | None:
    """Whether something is set, written as true or 1; None if it is neither that nor false, 0, null
    or absent."""
    if value is None or (isinstance(value, int) and value in (0, 1)):
        return bool(value)
    return None


def _number(value, where: str) -> float | None:
    """A number; None for null and NaN."""
    if value is None or value != value:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or abs(value) > MAX_NUMBER:
        raise ValueError(f"{where}: {str(value)[:40]!r} is not a finite number")
    return float(value)


def _vector(value, where: str) -> np.ndarray | None:
    """[3] numbers; None if there are none, or one is null."""
    if value is None:
        return None
    if not isinstance(value, list) or len(value) != 3:
        raise ValueError(f"{where}: an axis needs three numbers, got {str(value)[:40]!r}")
    numbers = [_number(v, where) for v in value]
    return None if any(n is None for n in numbers) else np.array(numbers, dtype=np.float64)

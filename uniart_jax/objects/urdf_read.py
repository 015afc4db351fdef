"""The text of a URDF as plain records: what it says, with what its numbers mean, before any of it
is trusted.

Parsed with lxml, not with yourdfpy: real files lack ``effort``, hold zero axes or an XML version of
0.0, and yourdfpy raises ``TypeError`` there, reads DTDs, and opens meshes while it parses.
Entities, DTDs and the network are refused.
"""

from __future__ import annotations

import dataclasses
import re

import numpy as np
from lxml import etree
from trimesh.transformations import euler_matrix

from uniart_jax.objects.names import Numbered
from uniart_jax.objects.robot import (
    MAX_NUMBER,
    MAX_PARTS,
    MOVING,
    REFUSED,
    Geometry,
    Link,
    RawJoint,
    Robot,
)
from uniart_jax.objects.xml_text import parse_xml

THINNEST = 1e-4  # metres, of shapes that a file gives no thickness


def read_robot(data: bytes) -> Robot:
    """Links and joints of a URDF.

    Raises:
      ValueError: not XML, not a URDF, a DTD, or an element that lacks what cannot be guessed; one
        line, without the file's name.
    """
    notes: list[str] = []
    root = _robot_element(data, notes)
    for tag in ("link", "joint"):
        if (count := len(root.findall(tag))) > MAX_PARTS:
            raise ValueError(f"it holds {count:,} {tag}s, more than {MAX_PARTS:,}")
    materials = _materials(root)
    robot = Robot((root.get("name") or "").strip(), {}, [], notes)
    repeated: dict[str, list[Link]] = {}
    for element in root.findall("link"):
        name = _name(element, "link")
        link = Link(
            name,
            _geometries(element, "visual", name, materials, notes),
            _geometries(element, "collision", name, materials, notes),
        )
        repeated.setdefault(name, []).append(link)
        robot.links.setdefault(name, link)
    robot.joints = [_joint(e, notes) for e in root.findall("joint")]
    fresh = Numbered()
    for joint in robot.joints:
        name, joint.name = joint.name, fresh(joint.name)
        if joint.name != name:
            notes.append(f"joint '{name}': the name is taken; renamed '{joint.name}'")
    if not robot.links:
        raise ValueError("it holds no <link>")
    _add_world(robot)
    for name, links in repeated.items():
        if len(links) > 1:
            _rename(robot, name, links)
    return robot


def _robot_element(data: bytes, notes: list[str]) -> etree._Element:
    root = parse_xml(data, notes)
    if etree.QName(root).localname != "robot":
        hint = " (MuJoCo's format: name the file .xml)" if root.tag == "mujoco" else ""
        raise ValueError(f"not a URDF: its root element is <{root.tag}>{hint}, not <robot>")
    if any(e.prefix == "xacro" or "xacro" in str(e.tag) for e in root.iter()):
        raise ValueError(
            "it is a xacro macro file: expand it with `xacro FILE > object.urdf` first"
        )
    return root


def _name(element: etree._Element, kind: str) -> str:
    name = _given(element, "name")
    if not name:
        raise ValueError(f"a <{kind}> in line {element.sourceline} has no name")
    return name


def _given(element, attribute: str) -> str:
    """A name without blanks around it; one of blanks alone is a name too. "" if there is none."""
    text = element.get(attribute) or ""
    return text.strip() or text


def _add_world(robot: Robot) -> None:
    """The link ``world``, which some programs take for given where joints name it as a parent."""
    if "world" not in robot.links and any(j.parent == "world" for j in robot.joints):
        robot.links["world"] = Link("world", [], [])
        robot.notes.append("link 'world': joints name it as a parent and it is absent; added")


def _numbers(
    element, attribute: str, count: int, default, where: str, most: float = MAX_NUMBER
) -> np.ndarray:
    """``count`` numbers of an attribute, none above ``most``; ``default`` if the element or the
    attribute is absent."""
    text = None if element is None else element.get(attribute)
    if text is None or not text.strip():
        return np.array(default, dtype=np.float64)
    try:
        values = np.array([float(t) for t in re.split(r"[\s,]+", text.strip())])
    except ValueError:
        values = np.zeros(0)
    if len(values) != count or not np.all(np.abs(values) <= most):
        raise ValueError(
            f"{where}: {attribute}='{text.strip()[:60]}' should be {count} finite "
            f"number{'s' * (count > 1)}"
        )
    return values


def _vector(element, attribute: str, default, where: str, notes: list[str]) -> np.ndarray:
    """[3] of an attribute. Of four numbers the first three count, as in Bullet."""
    text = "" if element is None else (element.get(attribute) or "").strip()
    four = len(re.split(r"[\s,]+", text)) == 4
    values = _numbers(element, attribute, 4 if four else 3, default, where)
    if four:
        notes.append(f"{where}: {attribute}='{text[:60]}' has four numbers; the first three count")
    return values[:3]


def _pose(element, where: str, notes: list[str]) -> np.ndarray:
    """[4, 4] of an ``<origin xyz rpy>``; the identity if it is absent."""
    rpy = _vector(element, "rpy", (0, 0, 0), where, notes)
    matrix = euler_matrix(*rpy, axes="sxyz") if rpy.any() else np.eye(4)
    matrix[:3, 3] = _vector(element, "xyz", (0, 0, 0), where, notes)
    return matrix


def _materials(root) -> dict[str, tuple[np.ndarray | None, str]]:
    """Named materials wherever they are defined: at the top, or inside a visual and named again by
    another."""
    found: dict[str, tuple[np.ndarray | None, str]] = {}
    for element in root.iter("material"):
        color, texture = _material(element)
        name = element.get("name") or ""
        if name and name not in found and (color is not None or texture):
            found[name] = (color, texture)
    return found


def _material(element) -> tuple[np.ndarray | None, str]:
    color, texture = element.find("color"), element.find("texture")
    where = f"material '{element.get('name') or ''}'"
    rgba = None
    if color is not None and color.get("rgba"):
        count = 3 if len(color.get("rgba").replace(",", " ").split()) == 3 else 4
        rgba = np.clip(np.append(_numbers(color, "rgba", count, (), where), 1.0)[:4], 0, 1)
    return rgba, "" if texture is None else (texture.get("filename") or "")


def _geometries(element, tag: str, link: str, materials, notes: list[str]) -> list[Geometry]:
    found = []
    for child in element.findall(tag):
        shape = next(iter(child.findall("geometry/*")), None)
        if shape is None:
            notes.append(f"link '{link}': a <{tag}> without geometry was left out")
            continue
        if shape.tag == "plane":  # Bullet's
            notes.append(f"link '{link}': a <plane> in a <{tag}> was ignored: it has no end")
            continue
        made = _visible(_geometry(child, shape, link, materials, notes), link, notes)
        found += [] if made is None else [made]
    return found


def _visible(shape: Geometry, link: str, notes: list[str]) -> Geometry | None:
    """A shape with an extent: what is flat is made ``THINNEST`` thick; None for a line or a
    point, of which nothing can be seen."""
    kind, zero = shape.kind, shape.size == 0
    if not zero.any():
        return shape
    if kind == "capsule" and not zero[0]:  # two half balls
        notes.append(f"link '{link}': a capsule without length; read as a sphere")
        return dataclasses.replace(shape, kind="sphere", size=shape.size[:1])
    if (kind == "box" and zero.sum() == 1) or (kind == "cylinder" and not zero[0]):
        notes.append(f"link '{link}': a {kind} without thickness; made {THINNEST:g} m thick")
        return dataclasses.replace(shape, size=np.where(zero, THINNEST, shape.size))
    notes.append(f"link '{link}': a {kind} of size or scale 0 was ignored")
    return None


def _geometry(element, shape, link: str, materials, notes: list[str]) -> Geometry:
    where = f"link '{link}'"
    origin = _pose(element.find("origin"), where, notes)
    color, texture = None, ""
    material = element.find("material")
    if material is not None:
        color, texture = _material(material)
        if color is None and not texture:
            color, texture = materials.get(material.get("name") or "", (None, ""))
    filename = ""
    if shape.tag == "mesh":
        filename = (shape.get("filename") or "").strip()
        if not filename:
            raise ValueError(f"{where}: a <mesh> names no file")
        if len((shape.get("scale") or "").split()) == 1:
            size = np.broadcast_to(_numbers(shape, "scale", 1, (1,), where), 3)
        else:
            size = _vector(shape, "scale", (1, 1, 1), where, notes)
    elif shape.tag == "box":
        size = _numbers(shape, "size", 3, (0, 0, 0), where)
    elif shape.tag == "sphere":
        size = _numbers(shape, "radius", 1, (0,), where)
    elif shape.tag in ("cylinder", "capsule"):
        size = np.append(
            _numbers(shape, "radius", 1, (0,), where), _numbers(shape, "length", 1, (0,), where)
        )
    else:
        raise ValueError(f"{where}: unknown geometry <{shape.tag}>")
    if shape.tag != "mesh" and np.any(size < 0):
        raise ValueError(
            f"{where}: the sizes of its {shape.tag} must be positive, got {size.tolist()}"
        )
    return Geometry(shape.tag, size, origin, filename, color, texture)


def _joint(element, notes: list[str]) -> RawJoint:
    name = _name(element, "joint")
    where = f"joint '{name}'"
    ends = {}
    for tag in ("parent", "child"):
        end = element.find(tag)
        link = "" if end is None else _given(end, "link")
        if not link:
            raise ValueError(f"{where}: it names no {tag} link")
        ends[tag] = link
    kind = (element.get("type") or "").strip().lower()
    if kind not in ("fixed", *MOVING, *REFUSED):
        raise ValueError(f"{where}: unknown type '{kind}'")
    limits = None
    limit = element.find("limit")
    if limit is not None and (limit.get("lower") or limit.get("upper")):
        lower, upper = (
            float(_numbers(limit, a, 1, (0,), where, most=np.inf)[0]) for a in ("lower", "upper")
        )
        limits = (lower, upper)
    mimic = None
    source = element.find("mimic")
    if source is not None and source.get("joint"):
        multiplier = float(_numbers(source, "multiplier", 1, (1,), where)[0])
        offset = float(_numbers(source, "offset", 1, (0,), where)[0])
        mimic = (_given(source, "joint"), multiplier, offset)
    axis = np.array([1.0, 0.0, 0.0])  # URDF's default
    if element.find("axis") is not None and kind in MOVING:
        axis = _axis(element.find("axis"), where, notes)
    return RawJoint(
        name,
        kind,
        ends["parent"],
        ends["child"],
        _pose(element.find("origin"), where, notes),
        axis,
        limits,
        mimic,
    )


def _axis(element, where: str, notes: list[str]) -> np.ndarray:
    """[3] as written; one that cannot be read (PartNet-Mobility has 'None None None') is zero, as
    if none was known."""
    try:
        return _vector(element, "xyz", (1, 0, 0), where, notes)
    except ValueError:
        if set((element.get("xyz") or "").lower().replace(",", " ").split()) <= {
            "none",
            "null",
            "nan",
        }:
            return np.zeros(3)
        raise


def _rename(robot: Robot, name: str, links: list[Link]) -> None:
    """Give links of the same name names of their own, where the joints tell which is meant: leaves,
    one joint each."""
    joints = [j for j in robot.joints if j.child == name]
    if len(joints) != len(links) or any(j.parent == name for j in robot.joints):
        raise ValueError(
            f"{len(links)} links are named '{name}', and its joints do not tell them apart"
        )
    for number, (joint, link) in enumerate(zip(joints[1:], links[1:], strict=True), start=2):
        fresh = f"{name}_{number}"
        while fresh in robot.links:
            fresh += "_"
        joint.child = link.name = fresh
        robot.links[fresh] = link
    robot.notes.append(f"link '{name}': {len(links)} links had this name; numbered")

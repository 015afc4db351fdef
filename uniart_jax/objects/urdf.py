"""Writing URDF. Reading is ``load.load_object``.

Every link's frame stands at its joint's origin with the object frame's axes. A screw, which URDF cannot say, becomes a
revolute joint, a link without a mesh, and a prismatic joint that mimics the first; ``load_object`` reads it back as one.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh
from lxml import etree

from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.objects.robot_object import one_line

DENSITY = 500.0  # kg / m^3, light wood; used where no inertia is given
EFFORT = 100.0  # N or N m
VELOCITY = 2.0  # m / s or rad / s
MIN_MASS = 1e-3  # kg
MIN_GYRATION = 1e-3  # m: no part's mass is closer together than this, whatever its mesh says

Inertial = tuple[float, np.ndarray, np.ndarray]


def write_urdf(
    obj: ArticulatedObject,
    path: str | Path,
    mesh_files: Sequence[Sequence[str]],
    *,
    collision_files: Sequence[Sequence[str]] | None = None,
    inertials: Sequence[Inertial] | None = None,
) -> Path:
    """Write ``obj`` as a URDF in metres and radians at its shown state.

    Args:
      obj: any object; ``scale`` turns it into metres.
      path: the file to write, or a folder for ``object.urdf``. The mesh files are not written here.
      mesh_files: per part, the visual meshes relative to the URDF; their vertices are **metres in the object frame** at the shown
        state (URDF's visual origin brings them into the link's frame).
      collision_files: the same for collision; default none (a link that has none collides with nothing).
      inertials: per part (mass [kg], centre of mass [3], inertia tensor about it [3, 3]), metres, object frame; default from the
        closed mesh's volume at 500 kg / m^3 (its convex hull's where it is open).

    Returns:
      The file written (atomically).

    Raises:
      ValueError: lists of another length than the parts, or a name that XML cannot hold.
    """
    count = len(obj.parts)
    for what, given in (
        ("mesh_files", mesh_files),
        ("collision_files", collision_files),
        ("inertials", inertials),
    ):
        if given is not None and len(given) != count:
            raise ValueError(f"write_urdf: {what} has {len(given)} entries for {count} parts")
    if any(isinstance(f, str) for f in [*mesh_files, *(collision_files or ())]):
        raise ValueError(
            "write_urdf: mesh_files holds a list of files for every part, not one file"
        )
    inertials = inertials or [mesh_inertial(p.mesh, obj.scale) for p in obj.parts]
    try:
        robot = etree.Element("robot", name=obj.name or "object")
        # MuJoCo before 4.0 strips the folders from mesh files, and any MuJoCo merges fixed links unless told not to. It shows
        # the collision shapes: visuals stay discarded, its default, since it refuses flat ones.
        compiler = {"strippath": "false", "fusestatic": "false"}
        etree.SubElement(etree.SubElement(robot, "mujoco"), "compiler", compiler)
        frames = _frames(obj)
        taken = {p.name for p in obj.parts}
        for k, part in enumerate(obj.parts):
            link = etree.SubElement(robot, "link", name=part.name)
            mass, center, inertia = inertials[k]
            _inertial(link, mass, np.asarray(center) - frames[k], np.asarray(inertia))
            for tag, files in (("visual", mesh_files), ("collision", collision_files)):
                for i, file in enumerate(files[k] if files is not None else ()):
                    shape = etree.SubElement(link, tag, name=f"{part.name}_{tag}{i}")
                    _origin(shape, -frames[k])
                    etree.SubElement(etree.SubElement(shape, "geometry"), "mesh", filename=file)
        for k, part in enumerate(obj.parts):
            if part.parent >= 0:
                parent = obj.parts[part.parent].name
                _joint(robot, part, parent, frames[k] - frames[part.parent], obj.scale, taken)
    except ValueError as error:
        raise ValueError(
            one_line(f"write_urdf: a name or file name cannot stand in XML: {error}")
        ) from None
    path = Path(path)
    if path.suffix.lower() != ".urdf":
        path = path / "object.urdf"
    path.parent.mkdir(parents=True, exist_ok=True)
    data = etree.tostring(robot, pretty_print=True, xml_declaration=True, encoding="utf-8")
    handle, partial = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    with os.fdopen(handle, "wb") as file:
        file.write(data)
    os.chmod(partial, 0o644)
    os.replace(partial, path)
    return path


def joint_name(part: Part) -> str:
    """The name of the URDF joint that carries ``part``'s coordinate q (for screws the revolute one)."""
    return f"{part.name}_joint"


def _frames(obj: ArticulatedObject) -> list[np.ndarray]:
    """[3] origin of every link's frame, metres, object frame: a point of its axis; a fixed part shares its parent's frame."""
    frames: list[np.ndarray] = []
    for part in obj.parts:
        if part.parent < 0:
            frames.append(np.zeros(3))
        elif part.joint.type == "fixed":
            frames.append(frames[part.parent])
        else:
            frames.append(part.joint.origin * obj.scale)
    return frames


def _joint(
    robot, part: Part, parent: str, origin: np.ndarray, scale: float, taken: set[str]
) -> None:
    joint, name = part.joint, joint_name(part)
    travel = (joint.travel[0] * scale, joint.travel[1] * scale)
    if joint.type == "screw":
        carrier = f"{part.name}_turn"
        while carrier in taken:
            carrier += "_"
        taken.add(carrier)
        link = etree.SubElement(robot, "link", name=carrier)
        _inertial(link, 10 * MIN_MASS, np.zeros(3), 10 * MIN_MASS * np.eye(3) * 1e-4)
        _element(robot, name, "revolute", parent, carrier, origin, joint, joint.angle)
        slide = f"{part.name}_travel"
        element = _element(
            robot, slide, "prismatic", carrier, part.name, np.zeros(3), joint, tuple(sorted(travel))
        )
        pitch = (travel[1] - travel[0]) / (joint.angle[1] - joint.angle[0])
        etree.SubElement(element, "mimic", joint=name, multiplier=_number(pitch), offset="0")
        return
    limits = {"revolute": joint.angle, "prismatic": travel}.get(joint.type)
    _element(robot, name, joint.type, parent, part.name, origin, joint, limits)


def _element(
    robot, name: str, kind: str, parent: str, child: str, origin: np.ndarray, joint: Joint, limits
):
    element = etree.SubElement(robot, "joint", name=name, type=kind)
    _origin(element, origin)
    etree.SubElement(element, "parent", link=parent)
    etree.SubElement(element, "child", link=child)
    if kind == "fixed":
        return element
    etree.SubElement(element, "axis", xyz=_vector(joint.direction))
    limit = etree.SubElement(element, "limit", effort=_number(EFFORT), velocity=_number(VELOCITY))
    if limits is not None:
        limit.set("lower", _number(limits[0]))
        limit.set("upper", _number(limits[1]))
    etree.SubElement(element, "dynamics", damping="0.1", friction="0.01")
    return element


def _origin(element, xyz: np.ndarray) -> None:
    etree.SubElement(element, "origin", xyz=_vector(xyz), rpy="0 0 0")


def _inertial(link, mass: float, center: np.ndarray, inertia: np.ndarray) -> None:
    element = etree.SubElement(link, "inertial")
    _origin(element, center)
    etree.SubElement(element, "mass", value=_number(mass))
    entries = {f"i{a}{b}": _number(inertia[i, j]) for a, i, b, j in _UPPER}
    etree.SubElement(element, "inertia", entries)


_UPPER = [(a, i, b, j) for i, a in enumerate("xyz") for j, b in enumerate("xyz") if i <= j]


def _number(value: float) -> str:
    """Short where it can be, and exact: limits and axes survive the round trip bit for bit."""
    return repr(float(value) + 0.0)


def _vector(values: np.ndarray) -> str:
    return " ".join(_number(v) for v in values)


def mesh_inertial(mesh: trimesh.Trimesh, scale: float = 1.0, density: float = DENSITY) -> Inertial:
    """Mass, centre of mass and inertia tensor about it, of a solid of even density.

    Args:
      mesh: in object units; its volume counts if it is closed, else its convex hull's, else its box's.
      scale: metres per unit.

    Returns:
      (kg, [3] m, [3, 3] kg m^2), object frame; positive definite with a + b > c for the principal moments, at least 1 g.
    """
    solid = trimesh.Trimesh(mesh.vertices * scale, mesh.faces)  # merges the seams of a texture
    if not _is_solid(solid):
        extents, center = np.maximum(solid.extents, MIN_GYRATION), solid.bounds.mean(0)
        try:
            solid = solid.convex_hull
        except Exception:  # qhull on a flat or tiny mesh; the check below sees it
            solid = trimesh.Trimesh()
        if not _is_solid(solid):
            solid = trimesh.creation.box(extents).apply_translation(center)
    properties = solid.mass_properties
    mass = max(float(properties.mass) * density, MIN_MASS)
    inertia = np.asarray(properties.inertia) * (mass / float(properties.mass))
    # I = tr(S) 1 - S with S the second moments: any positive S gives a possible body, so it is S that is held from below.
    second = np.trace(inertia) / 2 * np.eye(3) - inertia
    values, vectors = np.linalg.eigh((second + second.T) / 2)
    second = (vectors * np.maximum(values, mass * MIN_GYRATION**2)) @ vectors.T
    return mass, np.asarray(properties.center_mass), np.trace(second) * np.eye(3) - second


def _is_solid(mesh: trimesh.Trimesh) -> bool:
    with np.errstate(all="ignore"):  # a flat mesh has no centre of mass
        return bool(len(mesh.faces)) and bool(mesh.is_volume) and mesh.volume > MIN_GYRATION**3

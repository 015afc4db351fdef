"""URDF: reading any sane one, repairing what real ones get wrong, and writing ours.

Reading goes in steps, a file each: ``urdf_read`` (XML to records), ``urdf_mesh`` (the files they name, without leaving the
asset's folder), ``urdf_tree`` with ``urdf_motion`` (one tree, one screw an edge) and ``load_object`` here. Every repair is one line of
``ArticulatedObject.provenance``. The URDF's world frame at the shown state becomes the object frame, metres.

Writing puts every link's frame at its joint's origin with the object frame's axes. A screw, which URDF cannot say, becomes a
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

from uniart_jax.objects.kinematics import TRAVEL_DEAD_ZONE, Joint
from uniart_jax.objects.object import ArticulatedObject, Part, moved_mesh
from uniart_jax.objects.urdf_mesh import AssetFiles, link_mesh
from uniart_jax.objects.urdf_motion import lowered
from uniart_jax.objects.urdf_read import MAX_BYTES, read_robot
from uniart_jax.objects.urdf_tree import Tree

DENSITY = 500.0  # kg / m^3, light wood; used where no inertia is given
EFFORT = 100.0  # N or N m
VELOCITY = 2.0  # m / s or rad / s
MIN_MASS = 1e-3  # kg
MIN_GYRATION = 1e-3  # m: no part's mass is closer together than this, whatever its mesh says

Inertial = tuple[float, np.ndarray, np.ndarray]


def find_urdf(path: str | Path) -> Path:
    """The URDF that ``path`` means: itself, or in a folder object.urdf, mobility.urdf or the only ``*.urdf``.

    Raises:
      FileNotFoundError: nothing there. ValueError: a folder with several URDFs.
    """
    path = Path(path)
    if path.is_file():
        return path
    if not path.is_dir():
        raise FileNotFoundError(f"{path}: no such file or folder")
    for name in ("object.urdf", "mobility.urdf"):
        if (path / name).is_file():
            return path / name
    found = sorted(path.glob("*.urdf"))
    if len(found) > 1:
        names = ", ".join(f.name for f in found[:4])
        raise ValueError(
            f"{path}: the folder holds {len(found)} URDFs ({names} ...): name one of them"
        )
    if not found:
        raise FileNotFoundError(
            f"{path}: the folder holds no URDF (object.urdf, mobility.urdf or one *.urdf)"
        )
    return found[0]


def load_object(path: str | Path, *, allow_outside: bool = False) -> ArticulatedObject:
    """An articulated object from a URDF file or a folder that holds one.

    Args:
      path: the file or folder; its folder is the asset's root.
      allow_outside: also read meshes and textures outside that root (``../meshes``, absolute paths, links).

    Returns:
      The object in metres (``scale`` 1, not normalised) in the URDF's world frame, shown at joint coordinate 0 where the limits
      allow. Parts are the links that have a mesh. ``provenance`` holds one line for each repair.

    Raises:
      FileNotFoundError: no such file. ValueError: it cannot be read as one tree of parts; one line that names the file, the link
        or joint, and what to do.
    """
    path = find_urdf(path)
    try:
        with path.open("rb") as file:
            robot = read_robot(file.read(MAX_BYTES + 1))
        files = AssetFiles(path.parent, allow_outside)
        meshes = {}
        for link in robot.links.values():
            mesh = link_mesh(link, files, robot.notes)
            if mesh is not None:
                meshes[link.name] = mesh
        tree = Tree(robot, {n: float(np.linalg.norm(m.extents)) for n, m in meshes.items()})
        moved = {n: moved_mesh(meshes[n], tree.placed[n]) for n in tree.names}
        corners = np.stack([m.bounds for m in moved.values()])
        side = float((corners[:, 1].max(0) - corners[:, 0].min(0)).max())
        if not side > 0:
            raise ValueError("the object has no extent")
        parts = []
        for name in tree.names:
            parent = tree.parents[name]
            joint = lowered(
                name, tree.chains[name], moved[name], TRAVEL_DEAD_ZONE * side, robot.notes
            )
            parts.append(
                Part(name, moved[name], -1 if parent is None else tree.names.index(parent), joint)
            )
        notes = tuple(_one_line(n) for n in dict.fromkeys([*robot.notes, *files.notes]))
        return ArticulatedObject(tuple(parts), name=robot.name or path.stem, provenance=notes)
    except (ValueError, OSError, RuntimeError, OverflowError) as error:
        raise ValueError(_one_line(f"{path}: {error}")) from None


def _one_line(text: str) -> str:
    text = " ".join(str(text).split())
    return text if len(text) <= 500 else text[:497] + "..."


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
            _one_line(f"write_urdf: a name or file name cannot stand in XML: {error}")
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

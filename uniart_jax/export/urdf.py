"""Writing URDF. Reading is ``objects.load.load_object``.

Every link's frame stands at its joint's origin with the object frame's axes. Of several joints of
one part each but the last moves a link without a mesh, ``<part>_carrier``, that weighs a hundredth
of the part. A screw, which URDF cannot say, becomes a revolute joint, a link without a mesh, and a
prismatic joint that mimics the first; ``load_object`` reads it back as one.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from lxml import etree
from scipy.spatial.transform import Rotation

from uniart_jax.export.dynamics import HOLD
from uniart_jax.export.frames import (
    body_frames,
    check_bodies,
    check_lengths,
    hulls,
    joint_chain,
    joint_name,
    metric_travel,
    moves,
    number_text,
    travel_name,
    vector_text,
)
from uniart_jax.export.physics import GRAVITY, Body, Box, Dynamics
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.names import one_line
from uniart_jax.objects.object import ArticulatedObject, Part

CARRIER_SHARE = 0.01  # of a part's mass: what a link between two of its joints weighs


def write_urdf(
    obj: ArticulatedObject,
    path: str | Path,
    mesh_files: Sequence[Sequence[str]],
    bodies: Sequence[Body],
    hull_files: Sequence[Sequence[str]],
) -> Path:
    """Write ``obj`` as a URDF in metres and radians at its shown state.

    Args:
      obj: any object; ``scale`` turns it into metres.
      path: the file to write, or a folder for ``object.urdf``. The mesh files are not written here.
      mesh_files: per part, the visual meshes relative to the URDF; their vertices are **metres in
        the object frame** at the shown state (URDF's visual origin brings them into the link's
        frame).
      bodies: [K] mass, collision shapes and joint dynamics of the parts.
      hull_files: per part, a file for every ``Hull`` among the shapes of its body, in their order,
        relative to the URDF; metres, object frame. Boxes need none.

    Returns:
      The file written (atomically).

    Raises:
      ValueError: lists of another length than the parts, files that do not fit the hulls, a moving
        part without dynamics, or a name that XML cannot hold.
    """
    check_lengths("write_urdf", obj, mesh_files=mesh_files, hull_files=hull_files)
    check_bodies("write_urdf", obj, bodies)
    if any(isinstance(files, str) for files in [*mesh_files, *hull_files]):
        raise ValueError(
            "write_urdf: mesh_files and hull_files hold a list of files for every part, not one "
            "file"
        )
    for part, body, files in zip(obj.parts, bodies, hull_files, strict=True):
        if len(files) != len(hulls(body)):
            raise ValueError(
                one_line(
                    f"write_urdf: hull_files has {len(files)} files for the {len(hulls(body))} "
                    f"hulls of part '{part.name}'"
                )
            )
    try:
        robot = etree.Element("robot", name=obj.name or "object")
        # MuJoCo before 4.0 strips the folders from mesh files, and any MuJoCo merges fixed links
        # unless told not to. It shows
        # the collision shapes: visuals stay discarded, its default, since it refuses flat ones.
        compiler = {"strippath": "false", "fusestatic": "false"}
        etree.SubElement(etree.SubElement(robot, "mujoco"), "compiler", compiler)
        frames = body_frames(obj)
        taken = {p.name for p in obj.parts}
        for k, (part, body) in enumerate(zip(obj.parts, bodies, strict=True)):
            link = etree.SubElement(robot, "link", name=part.name)
            _inertial(
                link, body.mass, np.asarray(body.center) - frames[k], np.asarray(body.inertia)
            )
            for i, file in enumerate(mesh_files[k]):
                geometry = _geometry(link, "visual", f"{part.name}_visual{i}", -frames[k])
                etree.SubElement(geometry, "mesh", filename=file)
            _collisions(link, part, body, frames[k], hull_files[k])
        for k, part in enumerate(obj.parts):
            if part.parent >= 0:
                below = [i for i in range(len(obj.parts)) if k in _upwards(obj, i)]
                weight = GRAVITY * sum(float(bodies[i].mass) for i in below)
                _joints(robot, obj, part, bodies[k], frames[part.parent], taken, weight)
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


def _upwards(obj: ArticulatedObject, k: int) -> list[int]:
    """A part and all that it hangs on."""
    chain = []
    while k >= 0:
        chain.append(k)
        k = obj.parts[k].parent
    return chain


def _collisions(link, part: Part, body: Body, frame: np.ndarray, files: Sequence[str]) -> None:
    left = list(files)
    for i, shape in enumerate(body.shapes):
        name = f"{part.name}_collision{i}"
        if isinstance(shape, Box):
            turn = Rotation.from_matrix(shape.rotation).as_euler("xyz")
            geometry = _geometry(link, "collision", name, shape.center - frame, turn)
            etree.SubElement(geometry, "box", size=vector_text(shape.size))
        else:
            geometry = _geometry(link, "collision", name, -frame)
            etree.SubElement(geometry, "mesh", filename=left.pop(0))


def _geometry(link, tag: str, name: str, xyz: np.ndarray, rpy: np.ndarray | None = None):
    shape = etree.SubElement(link, tag, name=name)
    _origin(shape, xyz, rpy)
    return etree.SubElement(shape, "geometry")


def _joints(
    robot,
    obj: ArticulatedObject,
    part: Part,
    body: Body,
    above: np.ndarray,
    taken: set[str],
    weight: float,
) -> None:
    """The joints between a part and its parent, whose frame is ``above``; ``weight``: of all that
    they carry, newtons."""
    parent, scale = obj.parts[part.parent].name, obj.scale
    if not moves(part):
        _element(
            robot, joint_name(part), "fixed", parent, part.name, np.zeros(3), part.joint, None, None
        )
        return
    links = joint_chain(part, body)
    for number, link in enumerate(links, start=1):
        joint, dynamics = link.part.joint, link.dynamics
        here, child = joint.origin * scale, part.name
        if number < len(links):
            child = _carrier(robot, f"{part.name}_carrier", here, body, taken)
        travel = metric_travel(link.part, scale)
        origin = here - above
        if joint.type != "screw":
            limits = {"revolute": joint.angle, "prismatic": travel}.get(joint.type)
            _element(robot, link.name, joint.type, parent, child, origin, joint, limits, dynamics)
        else:
            turned = _carrier(robot, f"{part.name}_turn", here, body, taken)
            _element(
                robot, link.name, "revolute", parent, turned, origin, joint, joint.angle, dynamics
            )
            # Where mimic is not obeyed the part would slide down by itself: what slides holds its
            # own weight.
            pitch, held = joint.pitch * scale, HOLD * weight
            slide = Dynamics(0.0, held, 5 * held + dynamics.effort, dynamics.velocity * abs(pitch))
            name = travel_name(part) if link.first else f"{link.name}_travel"
            element = _element(
                robot, name, "prismatic", turned, child, np.zeros(3), joint, travel, slide
            )
            etree.SubElement(
                element, "mimic", joint=link.name, multiplier=number_text(pitch), offset="0"
            )
        parent, above = child, here


def _carrier(robot, name: str, frame: np.ndarray, body: Body, taken: set[str]) -> str:
    """A new link without a mesh between two joints of a part; its name."""
    while name in taken:
        name += "_"
    taken.add(name)
    link = etree.SubElement(robot, "link", name=name)
    inertia = CARRIER_SHARE * np.asarray(body.inertia)
    _inertial(link, CARRIER_SHARE * body.mass, np.asarray(body.center) - frame, inertia)
    return name


def _element(
    robot,
    name: str,
    kind: str,
    parent: str,
    child: str,
    origin: np.ndarray,
    joint: Joint,
    limits: tuple[float, float] | None,
    dynamics: Dynamics | None,
):
    element = etree.SubElement(robot, "joint", name=name, type=kind)
    _origin(element, origin)
    etree.SubElement(element, "parent", link=parent)
    etree.SubElement(element, "child", link=child)
    if kind == "fixed" or dynamics is None:
        return element
    etree.SubElement(element, "axis", xyz=vector_text(joint.direction))
    limit = etree.SubElement(
        element,
        "limit",
        effort=number_text(dynamics.effort),
        velocity=number_text(dynamics.velocity),
    )
    if limits is not None:
        limit.set("lower", number_text(limits[0]))
        limit.set("upper", number_text(limits[1]))
    resistance = {
        "damping": number_text(dynamics.damping),
        "friction": number_text(dynamics.alone),
    }
    etree.SubElement(element, "dynamics", resistance)
    return element


def _origin(element, xyz: np.ndarray, rpy: np.ndarray | None = None) -> None:
    turn = "0 0 0" if rpy is None else vector_text(rpy)
    etree.SubElement(element, "origin", xyz=vector_text(xyz), rpy=turn)


def _inertial(link, mass: float, center: np.ndarray, inertia: np.ndarray) -> None:
    element = etree.SubElement(link, "inertial")
    _origin(element, center)
    etree.SubElement(element, "mass", value=number_text(mass))
    entries = {f"i{a}{b}": number_text(inertia[i, j]) for a, i, b, j in _UPPER}
    etree.SubElement(element, "inertia", entries)


_UPPER = [(a, i, b, j) for i, a in enumerate("xyz") for j, b in enumerate("xyz") if i <= j]

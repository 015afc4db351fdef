"""Writing MJCF, MuJoCo's own format. Reading is ``load.load_object``.

Bodies are nested as the parts are; every body's frame stands at its joint's origin with the object
frame's axes, as in the URDF. A screw is a hinge and a slide of one body, held together by
``<equality>``; several joints of a part are joints of one body. Geoms of group 2 are seen, those of
group 3 collide. A site stands at every handle; keyframes ``closed`` and ``open`` are the rest state
and that with all joints open. (MuJoCo's XML reference:
mujoco.readthedocs.io/en/stable/XMLreference.html.)
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from lxml import etree
from trimesh.transformations import quaternion_from_matrix

from uniart_jax.export.formats import Parts
from uniart_jax.export.frames import (
    ChainJoint,
    body_frames,
    check_bodies,
    check_lengths,
    hulls,
    joint_chain,
    joint_name,
    linked_pairs,
    metric,
    metric_limits,
    metric_travel,
    moves,
    number_text,
    travel_name,
    vector_text,
)
from uniart_jax.export.handles import handles
from uniart_jax.export.physics import Body, Box
from uniart_jax.objects.names import Numbered, one_line
from uniart_jax.objects.object import ArticulatedObject, Part

WORLD = "world"  # MuJoCo's own body
MIN_AREA = 1e-12  # m^2: a mesh of less, MuJoCo refuses
MATERIAL = "material"
HELD = {
    "solreffriction": "0.004 1",
    "solimpfriction": "0.999 0.9999 0.001 0.5 2",
}  # dry friction that does not creep
SITE_SIZE = 0.01  # of the object's longest side: radius of a handle's site
OFF = 0.02  # of the range: how far off a motor may stop for what resists it
LAG = 0.05  # s that a motor needs to come near, at the least
STIFF = {"solref": "0.008 1", "solimp": "0.999 0.9999 0.001"}  # of the constraint in a screw


def write_asset(parts: Parts) -> tuple[str, ...]:
    """``object.xml`` of an asset (``formats.SIMULATORS``)."""
    files = (parts.visual_files, parts.bodies, parts.hull_files, parts.texture)
    path = parts.folder / "object.xml"
    return write_mjcf(parts.obj, path, *files, actuators=parts.actuators)


def write_mjcf(
    obj: ArticulatedObject,
    path: Path,
    visual_files: Sequence[str],
    bodies: Sequence[Body],
    hull_files: Sequence[Sequence[str]],
    texture: str,
    *,
    actuators: bool = False,
) -> tuple[str, ...]:
    """Write ``obj`` as MJCF in metres and radians at its shown state, its root fixed to the world.

    Args:
      obj: any object; ``scale`` turns it into metres.
      path: the file to write. The files below lie relative to its folder and are not written here.
      visual_files: [K] OBJ of every part, metres, object frame.
      bodies: [K] mass, collision shapes and dynamics.
      hull_files: [K] OBJ of each part's hulls in the order of its shapes (boxes need none), metres,
        object frame.
      texture: image of all visual meshes.
      actuators: add a position actuator a part that moves, called as its joint.

    Returns:
      What MJCF cannot say, a line each.

    Raises:
      ValueError: lists that do not fit the parts, or a name that XML cannot hold.
    """
    check_bodies("write_mjcf", obj, bodies)
    check_lengths("write_mjcf", obj, visual_files=visual_files, hull_files=hull_files)
    for part, body, files in zip(obj.parts, bodies, hull_files, strict=True):
        if len(hulls(body)) != len(files):
            raise ValueError(
                f"write_mjcf: part '{part.name}' has {len(hulls(body))} hulls and {len(files)} "
                "hull_files"
            )
    try:
        writer = _Writer(obj, bodies)
        root = writer.document(visual_files, hull_files, texture, actuators)
    except ValueError as error:
        raise ValueError(
            one_line(f"write_mjcf: a name or file name cannot stand in XML: {error}")
        ) from None
    path.write_bytes(etree.tostring(root, pretty_print=True, encoding="utf-8"))
    return tuple(writer.notes)


class _Writer:
    """One pass over the tree, depth first, as MuJoCo numbers bodies and joints."""

    def __init__(self, obj: ArticulatedObject, bodies: Sequence[Body]):
        self.obj, self.bodies = obj, bodies
        self.frames = body_frames(obj)
        self.notes: list[str] = []
        self.states = {"closed": metric(obj, obj.rest()), "open": metric(obj, obj.open())}
        self.joined: list[int] = []  # moving parts in MuJoCo's order
        self.screws: list[tuple[str, str, ChainJoint]] = []  # (name, name of the slide, joint)
        self.sites: dict[int, list[int]] = {}  # part -> moving parts whose handles lie on it
        self.handles = handles(obj)
        for k, handle in enumerate(self.handles):
            if handle is not None:
                self.sites.setdefault(handle.part, []).append(k)
        self.names = self._names()
        self.mesh_names = Numbered()
        self.children: list[list[int]] = [[] for _ in obj.parts]
        for k, part in enumerate(obj.parts):
            if part.parent >= 0:
                self.children[part.parent].append(k)

    def _names(self) -> list[str]:
        """[K] of the bodies: the parts', but not MuJoCo's own and none empty."""
        given = [p.name for p in self.obj.parts]
        fresh = Numbered([*given, WORLD])
        names = [fresh(n or "part") if n in ("", WORLD) else n for n in given]
        self.notes += [
            f"MJCF: part '{old}' is called '{new}': MuJoCo keeps the name for itself"
            for old, new in zip(given, names, strict=True)
            if old != new
        ]
        return names

    def document(
        self,
        visual_files: Sequence[str],
        hull_files: Sequence[Sequence[str]],
        texture: str,
        actuators: bool,
    ) -> etree._Element:
        root = etree.Element("mujoco", model=self.obj.name or "object")
        etree.SubElement(root, "compiler", angle="radian")
        driven = actuators and any(moves(p) for p in self.obj.parts)
        if driven:  # the motors' own damping is stiff
            etree.SubElement(root, "option", integrator="implicitfast")
        self.asset = etree.SubElement(root, "asset")
        etree.SubElement(self.asset, "texture", name="texture", type="2d", file=texture)
        etree.SubElement(
            self.asset, "material", name=MATERIAL, texture="texture", specular="0", shininess="0"
        )
        world = etree.SubElement(root, "worldbody")
        elements: dict[int, etree._Element] = {}
        waiting = [0]
        while waiting:  # a tree may be deeper than Python's stack
            k = waiting.pop()
            parent = self.obj.parts[k].parent
            above = world if parent < 0 else elements[parent]
            elements[k] = self._body(above, k, visual_files[k], hull_files[k])
            waiting += self.children[k][::-1]
        self._couplings(root)
        if driven:
            self._actuators(root)
        keyframe = etree.SubElement(root, "keyframe")
        for name, state in self.states.items():
            key = etree.SubElement(keyframe, "key", name=name, qpos=vector_text(self._qpos(state)))
            if driven:
                key.set("ctrl", vector_text([state[k] for k in self.joined]))
        if any(moves(p) for p in self.obj.parts):
            self.notes.append("MJCF: it has no velocity limits of joints; they were left out")
        return root

    def _body(
        self, above: etree._Element, k: int, visual: str, hull_files: Sequence[str]
    ) -> etree._Element:
        part, body, frame = self.obj.parts[k], self.bodies[k], self.frames[k]
        origin = self.frames[part.parent] if part.parent >= 0 else np.zeros(3)
        element = etree.SubElement(
            above, "body", name=self.names[k], pos=vector_text(frame - origin)
        )
        tensor = np.asarray(body.inertia)
        etree.SubElement(
            element,
            "inertial",
            pos=vector_text(body.center - frame),
            mass=number_text(body.mass),
            fullinertia=vector_text(tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]),
        )
        if moves(part) and body.dynamics is not None:
            for link in joint_chain(part, body):
                at = link.part.joint.origin * self.obj.scale - frame
                place = {"pos": vector_text(at)} if np.any(np.abs(at) > 0) else {}
                travel = travel_name(part) if link.first else f"{link.name}_travel"
                self._joints(element, link, travel, place)
                if link.part.joint.type == "screw":
                    self.screws.append(
                        (f"{part.name}_screw" if link.first else f"{link.name}_screw", travel, link)
                    )
            self.joined.append(k)
        at = vector_text(-frame)
        if _drawable(part, self.obj.scale):
            seen = {"contype": "0", "conaffinity": "0", "group": "2", "material": MATERIAL}
            self._mesh_geom(element, visual, at, f"{part.name}_visual", seen)
        else:
            self.notes.append(
                f"MJCF: part '{part.name}' has no visual geom: MuJoCo takes no mesh of one "
                "triangle or without area"
            )
        files = iter(hull_files)
        for i, shape in enumerate(body.shapes):
            name, group = f"{part.name}_collision{i}", {"group": "3"}
            if isinstance(shape, Box):
                turn = np.eye(4)
                turn[:3, :3] = shape.rotation
                etree.SubElement(
                    element,
                    "geom",
                    name=name,
                    type="box",
                    pos=vector_text(shape.center - frame),
                    quat=vector_text(quaternion_from_matrix(turn)),
                    size=vector_text(np.asarray(shape.size) / 2),
                    **group,
                )
            else:
                self._mesh_geom(element, next(files), at, name, group)
        for moving in self.sites.get(k, ()):
            self._site(element, moving, frame)
        return element

    def _site(self, element: etree._Element, k: int, frame: np.ndarray) -> None:
        """Where a hand holds moving part k."""
        handle = self.handles[k]
        assert handle is not None  # it moves
        radius = SITE_SIZE * float(np.ptp(self.obj.bounds, axis=0).max()) * self.obj.scale
        etree.SubElement(
            element,
            "site",
            name=f"{self.obj.parts[k].name}_handle",
            pos=vector_text(handle.point * self.obj.scale - frame),
            size=number_text(radius),
            group="4",  # not shown unless asked for
        )

    def _qpos(self, state: np.ndarray) -> list[float]:
        """A state [K], metres and radians, in MuJoCo's order; a screw has two coordinates, and a
        part's further joints are at 0."""
        found = []
        for k in self.joined:
            for link in joint_chain(self.obj.parts[k], self.bodies[k]):
                value, joint = state[k] * link.first, link.part.joint
                found.append(value)
                if joint.type == "screw":
                    found.append(value * joint.pitch * self.obj.scale)
        return found

    def _actuators(self, root: etree._Element) -> None:
        """A position actuator a joint, strong enough to stop within 2 % of the range in spite of
        friction and gravity, and damped so that it comes there without swinging."""
        actuator = etree.SubElement(root, "actuator")
        for k in self.joined:
            part, dynamics = self.obj.parts[k], self.bodies[k].dynamics
            assert dynamics is not None  # checked: it moves
            ends = metric_limits(part, self.obj.scale)
            stiffness = dynamics.effort / 5 / (OFF * (ends[1] - ends[0]))
            etree.SubElement(
                actuator,
                "position",
                name=joint_name(part),
                joint=joint_name(part),
                kp=number_text(stiffness),
                kv=number_text(stiffness * LAG),
                ctrlrange=vector_text(ends),
                forcerange=vector_text([-dynamics.effort, dynamics.effort]),
            )

    def _mesh_geom(
        self, element: etree._Element, file: str, at: str, name: str, options: dict[str, str]
    ) -> None:
        mesh = self.mesh_names(Path(file).stem)
        # MuJoCo weighs every mesh, though <inertial> makes it needless, and refuses flat ones
        # unless they are shells.
        etree.SubElement(self.asset, "mesh", name=mesh, file=file, inertia="shell")
        etree.SubElement(element, "geom", name=name, type="mesh", mesh=mesh, pos=at, **options)

    def _joints(
        self, element: etree._Element, link: ChainJoint, travel_joint: str, place: dict[str, str]
    ) -> None:
        """One joint of a body, at ``place`` (``pos``); of a screw its slide too,
        ``travel_joint``."""
        joint, dynamics, axis = (
            link.part.joint,
            link.dynamics,
            vector_text(link.part.joint.direction),
        )
        resistance = place | {
            "damping": number_text(dynamics.damping),
            "frictionloss": number_text(dynamics.friction),
            **HELD,
        }
        if dynamics.stiffness > 0:
            resistance["stiffness"] = number_text(dynamics.stiffness)
            resistance["springref"] = number_text(dynamics.reference)
        if dynamics.effort > 0:
            limit = vector_text([-dynamics.effort, dynamics.effort])
            resistance["actuatorfrcrange"] = limit
        travel = metric_travel(link.part, self.obj.scale)
        if joint.rotates:
            hinge = etree.SubElement(
                element, "joint", name=link.name, type="hinge", axis=axis, **resistance
            )
            if joint.type != "continuous":
                hinge.set("range", vector_text(joint.angle))
            if joint.type == "screw":
                self._slide(element, travel_joint, axis, travel, place)
        else:
            self._slide(element, link.name, axis, travel, resistance)

    def _slide(
        self,
        element: etree._Element,
        name: str,
        axis: str,
        travel: tuple[float, float],
        resistance: dict[str, str],
    ) -> None:
        etree.SubElement(
            element,
            "joint",
            name=name,
            type="slide",
            axis=axis,
            range=vector_text(travel),
            **resistance,
        )

    def _couplings(self, root: etree._Element) -> None:
        """Contacts that are left out, and screws held together."""
        pairs = linked_pairs(self.obj)
        if pairs:
            contact = etree.SubElement(root, "contact")
            for a, b in pairs:
                etree.SubElement(contact, "exclude", body1=self.names[a], body2=self.names[b])
        if not self.screws:
            return
        tendons = etree.SubElement(root, "tendon")
        equality = etree.SubElement(root, "equality")
        for name, slide, link in self.screws:
            pitch, hinge = link.part.joint.pitch * self.obj.scale, link.name
            polynomial = vector_text([0, pitch, 0, 0, 0])
            etree.SubElement(
                equality, "joint", name=name, joint1=slide, joint2=hinge, polycoef=polynomial
            )
            # That is what other programs read. MuJoCo makes it as soft as if metres and radians
            # weighed alike (dof_invweight0),
            # and the slide of a knob stands still; a tendon of constant length, slide - pitch *
            # hinge = 0, has the right weight.
            tendon = etree.SubElement(tendons, "fixed", name=name)
            etree.SubElement(tendon, "joint", joint=slide, coef="1")
            etree.SubElement(tendon, "joint", joint=hinge, coef=number_text(-pitch))
            etree.SubElement(equality, "tendon", name=f"{name}_tendon", tendon1=name, **STIFF)


def _drawable(part: Part, scale: float) -> bool:
    """Whether MuJoCo takes the part's mesh: four places at least, and an area."""
    places = np.unique(np.asarray(part.mesh.vertices), axis=0)
    return len(places) > 3 and float(part.mesh.area) * scale**2 > MIN_AREA

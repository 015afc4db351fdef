"""Reading MJCF, through MuJoCo's own parser: what the compiled model says, as a ``Robot``.

The text is made self-contained first (``mjcf_text``), so MuJoCo opens no file. Bodies are links,
the world body the root; a body with several joints is a chain of links without a mesh; joint
coordinates are MuJoCo's, so an object is shown where they are 0, not at ``ref``.

**What is seen of a body**: of its geoms in groups 0 to 2 (which MuJoCo's viewer shows) that are not
fully transparent, those that collide with nothing (contype and conaffinity 0, how visual geoms are
told from collision shapes); if there are none, all of them; if there are none either, its other
geoms, as collision shapes. ``<equality><joint>`` with a linear polynomial is a mimic.
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from trimesh.transformations import quaternion_matrix

from uniart_jax.objects.asset_files import AssetFiles
from uniart_jax.objects.kinematics import rotation
from uniart_jax.objects.mjcf_geoms import PLANE, geometry, has_shape, rgba
from uniart_jax.objects.mjcf_text import self_contained
from uniart_jax.objects.robot import Geometry, Link, RawJoint, Robot

FREE, BALL, SLIDE, HINGE = range(4)  # mjtJoint
SHOWN_GROUPS = (0, 1, 2)


def read_mjcf(data: bytes, path: Path, files: AssetFiles) -> Robot:
    """Links and joints of an MJCF, its meshes loaded and painted.

    Args:
      data: the file.
      path: where it lies.
      files: which other files may be read.

    Raises:
      ValueError: MuJoCo is not installed or refuses the model; a file outside the asset's folder,
        missing or too large; a plugin; one line, without the file's name.
    """
    notes: list[str] = []
    text, assets = self_contained(data, path, files, notes)
    model = compiled(text, assets, notes)
    return _Reader(model, notes).robot


def compiled(text: str, assets: dict[str, bytes], notes: list[str]):
    """The ``mujoco.MjModel`` of a self-contained text; warnings become notes, nothing is printed or
    logged.

    Raises:
      ValueError: MuJoCo is not installed, or its compiler's error.
    """
    try:
        import mujoco
    except ImportError:
        raise ValueError("reading MJCF needs MuJoCo: pip install mujoco") from None
    said: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda line: said.append(_text(line)))
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            model = mujoco.MjModel.from_xml_string(text, assets)
    except Exception as error:  # FatalError, ValueError, TypeError: MuJoCo's ways to say no
        raise ValueError(f"MuJoCo cannot compile it: {_text(error)}") from None
    finally:
        mujoco.set_mju_user_warning(before)
    notes += [
        f"MuJoCo: {line}" for line in dict.fromkeys(said + [_text(w.message) for w in caught])
    ]
    return model


def _text(message) -> str:
    return " ".join((message.decode() if isinstance(message, bytes) else str(message)).split())


class _Reader:
    """One pass over a compiled model, parents before children as MuJoCo numbers its bodies."""

    def __init__(self, model, notes: list[str]):
        self.model = model
        self.robot = Robot(_model_name(model), {}, [], notes, radians=True)
        self.bodies = _names(model, "body")
        self.joints = _names(model, "joint")
        self.geoms = [np.flatnonzero(model.geom_bodyid == b).tolist() for b in range(model.nbody)]
        self.frames = [np.eye(4)] * model.nbody  # of each body in its link
        self.left_out: dict[str, list[str]] = {}
        for body in range(model.nbody):
            if body:
                self._attach(body)
            self.robot.links[self.bodies[body]] = self._link(body)
        for what, names in self.left_out.items():
            listed = ", ".join(f"'{n}'" for n in dict.fromkeys(names))
            notes.append(f"geoms not shown: {what} (body {listed})")
        self._couple()

    def _link(self, body: int) -> Link:
        """The body's link: what is seen of it, or if nothing is what it collides with."""
        model, name = self.model, self.bodies[body]
        solid = []
        for geom in self.geoms[body]:
            if int(model.geom_type[geom]) == PLANE:
                self._leave("planes", name)
            elif not has_shape(model, geom):
                self.robot.notes.append(
                    f"link '{name}': a height or distance field was left out: it has no mesh"
                )
            elif rgba(model, geom)[3] == 0:
                self._leave("fully transparent", name)
            else:
                solid.append(geom)
        shown = [g for g in solid if int(model.geom_group[g]) in SHOWN_GROUPS]
        seen = [g for g in shown if not model.geom_contype[g] | model.geom_conaffinity[g]] or shown
        return Link(name, self._shapes(body, seen), [] if seen else self._shapes(body, solid))

    def _leave(self, what: str, name: str) -> None:
        self.left_out.setdefault(what, []).append(name)

    def _shapes(self, body: int, geoms: list[int]) -> list[Geometry]:
        return [geometry(self.model, g, self.frames[body]) for g in geoms]

    def _attach(self, body: int) -> None:
        """Joints between a body and its parent, in MuJoCo's order (mj_kinematics): each turns or
        travels in the frame that those before it leave."""
        model, name = self.model, self.bodies[body]
        above = int(model.body_parentid[body])
        parent = self.bodies[above]
        frame = self.frames[above] @ _pose(model.body_pos[body], model.body_quat[body])
        start = int(model.body_jntadr[body])
        joints = range(start, start + int(model.body_jntnum[body]))
        if not len(joints):
            self._join(self._fresh(f"{name}_fixed", self.joints), "fixed", parent, name, frame)
        for joint in joints:
            child = name
            if joint != joints[-1]:
                child = self._fresh(f"{name}_{self.joints[joint]}", self.bodies)
                self.robot.links[child] = Link(child, [], [])
            frame = self._moving(joint, parent, child, frame, above)
            parent = child
        self.frames[body] = frame if len(joints) else np.eye(4)

    def _moving(
        self, joint: int, parent: str, child: str, frame: np.ndarray, above: int
    ) -> np.ndarray:
        """Add a joint whose body stands at ``frame`` in the parent link at ``ref``; returns the
        body in the new link."""
        model, name, kind = self.model, self.joints[joint], int(self.model.jnt_type[joint])
        if kind in (FREE, BALL):
            type_ = "spherical" if kind == BALL else "floating"
            if kind == FREE and self._alone():
                type_ = "fixed"
                self.robot.notes.append(
                    f"joint '{name}': the object floats freely; held where it is"
                )
            self._join(name, type_, parent, child, frame)
            return np.eye(4)
        axis = np.array(model.jnt_axis[joint], dtype=np.float64)
        anchor, ref = np.eye(4), float(model.qpos0[model.jnt_qposadr[joint]])
        anchor[:3, 3] = model.jnt_pos[joint]
        limits = (
            tuple(float(x) for x in model.jnt_range[joint]) if model.jnt_limited[joint] else None
        )
        zero = np.eye(4)  # from ref to coordinate 0
        if kind == SLIDE:
            zero[:3, 3] = -ref * axis
        else:
            zero[:3, :3] = rotation(axis, -ref)
        type_ = "prismatic" if kind == SLIDE else "continuous" if limits is None else "revolute"
        self._join(name, type_, parent, child, frame @ anchor @ zero, axis, limits)
        return np.linalg.inv(anchor)

    def _join(self, name, type_, parent, child, origin, axis=(0.0, 0.0, 1.0), limits=None) -> None:
        self.robot.joints.append(
            RawJoint(name, type_, parent, child, origin, np.array(axis), limits, None)
        )

    def _alone(self) -> bool:
        """Whether all that has a geom hangs on one child of the world."""
        seen = [
            b
            for b in range(self.model.nbody)
            if any(has_shape(self.model, g) for g in self.geoms[b])
        ]
        return len({int(self.model.body_rootid[b]) for b in seen}) == 1

    def _fresh(self, name: str, taken: list[str]) -> str:
        while name in taken:
            name += "_"
        taken.append(name)
        return name

    def _couple(self) -> None:
        """``<equality><joint>``: q1 - ref1 = polynomial(q2 - ref2), linear ones as mimics."""
        import mujoco

        model = self.model
        by_name = {j.name: j for j in self.robot.joints}
        for equality in range(model.neq):
            if (
                int(model.eq_type[equality]) != mujoco.mjtEq.mjEQ_JOINT
                or not model.eq_active0[equality]
            ):
                continue
            first, second = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
            joint = by_name[self.joints[first]]
            ref = float(model.qpos0[model.jnt_qposadr[first]])
            a0, a1, *higher = (float(a) for a in model.eq_data[equality, :5])
            if second < 0 or not (a1 or any(higher)):
                joint.limits = (ref + a0, ref + a0)
                joint.type = "revolute" if joint.type == "continuous" else joint.type
                self.robot.notes.append(f"joint '{joint.name}': held by an equality")
            elif any(higher) or joint.mimic:
                why = "bent" if any(higher) else "second"
                self.robot.notes.append(
                    f"joint '{joint.name}': a {why} equality is not represented"
                )
            else:
                other = float(model.qpos0[model.jnt_qposadr[second]])
                joint.mimic = (self.joints[second], a1, ref + a0 - a1 * other)


def _pose(position: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    matrix = quaternion_matrix(quaternion)
    matrix[:3, 3] = position
    return matrix


def _model_name(model) -> str:
    name = bytes(model.names).split(b"\0", 1)[0].decode(errors="replace")
    return "" if name == "MuJoCo Model" else name.strip()


def _names(model, kind: str) -> list[str]:
    """Names of all bodies or joints; those without one are numbered, joints after their body."""
    count = model.nbody if kind == "body" else model.njnt
    names = [getattr(model, kind)(i).name for i in range(count)]
    for i, name in enumerate(names):
        if name:
            continue
        fresh = f"body_{i}"
        if kind == "joint":
            fresh = f"{model.body(int(model.jnt_bodyid[i])).name or 'body'}_joint_{i}"
        while fresh in names:
            fresh += "_"
        names[i] = fresh
    return names

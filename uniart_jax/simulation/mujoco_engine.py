"""An asset in MuJoCo.

A second compilation of the same file with every collision filter off (types, parent and child,
exclusions) measures depths: the contacts that MuJoCo itself finds then are its true collision
geometry.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import mujoco
import numpy as np

from uniart_jax.export.physics import GRAVITY
from uniart_jax.simulation.engine import TIMESTEP, LinkInertia, Pair, Plan, cross

_MOVING = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
_SOLID = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)


class MujocoEngine:
    """``engine.Engine`` by MuJoCo.

    Args:
      path: a self-contained description (``staging``): the files that it names lie beside it.
      plan: None to load only.

    Raises:
      ValueError: MuJoCo refuses it.
    """

    def __init__(self, path: Path, plan: Plan | None):
        assets = {p.name: p.read_bytes() for p in path.parent.iterdir() if p != path}
        spec = mujoco.MjSpec.from_string(path.read_text("utf-8"), assets=assets)
        spec.compiler.fusestatic = False
        self.model = spec.compile()
        name_joints(spec, self.model)
        for joint in list(spec.joints):
            if joint.type == mujoco.mjtJoint.mjJNT_FREE:  # the object is held where it is
                spec.delete(joint)
        option = spec.option
        option.timestep = min(option.timestep, TIMESTEP)
        option.gravity = [0, 0, -GRAVITY]
        if option.integrator == mujoco.mjtIntegrator.mjINT_RK4:
            option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        if plan is None:
            return
        self.plan = plan
        self.damping_share: dict[str, float] = {}  # implicit: it bears any
        self.timestep = float(option.timestep)
        self.bodies = [self.model.body(b).name for b in range(self.model.nbody)]
        self.index = {name: b for b, name in enumerate(self.bodies)}
        self.joints = {
            self.model.joint(j).name: int(self.model.jnt_qposadr[j])
            for j in range(self.model.njnt)
            if int(self.model.jnt_type[j]) in [int(t) for t in _MOVING]
        }
        self.dofs = {
            self.model.joint(j).name: int(self.model.jnt_dofadr[j]) for j in range(self.model.njnt)
        }
        missing = [j.name for j in plan.joints if j.name not in self.joints]
        if missing:
            raise ValueError(f"MuJoCo has no joint '{missing[0]}'")
        self.scratch = mujoco.MjData(self.model)
        self.solid = _unfiltered(spec)
        self.posed = mujoco.MjData(self.solid)

    def inertias(self) -> list[LinkInertia]:
        moving = self.model.body_weldid != 0
        return [
            LinkInertia(name, float(self.model.body_mass[b]), np.array(self.model.body_inertia[b]))
            for b, name in enumerate(self.bodies)
            if moving[b]
        ]

    def _pose(self, data: mujoco.MjData, q: Mapping[str, float]) -> None:
        data.qpos[:] = self.model.qpos0
        for name, value in self.plan.state(q).items():
            if name in self.joints:
                data.qpos[self.joints[name]] = value

    def depths(self, q: Mapping[str, float]) -> dict[Pair, float]:
        self._pose(self.posed, q)
        mujoco.mj_kinematics(self.solid, self.posed)
        mujoco.mj_comPos(self.solid, self.posed)
        mujoco.mj_collision(self.solid, self.posed)
        found: dict[Pair, float] = {}
        for contact in self.posed.contact:
            bodies = self.solid.geom_bodyid[contact.geom]
            first, second = sorted(self.bodies[b] for b in bodies)
            if contact.dist < 0 and not self.plan.rigid_pair(first, second):
                found[first, second] = max(found.get((first, second), 0.0), -float(contact.dist))
        return found

    def reset(self, q: Mapping[str, float]) -> None:
        mujoco.mj_resetData(self.model, self.data)
        self._pose(self.data, q)
        mujoco.mj_forward(self.model, self.data)

    def step(self) -> None:
        mujoco.mj_step2(self.model, self.data)
        self.data.xfrc_applied[:] = 0
        mujoco.mj_step1(self.model, self.data)  # positions and velocities of the new state

    def push(self, link: str, point: np.ndarray, force: np.ndarray) -> None:
        body = self.index[link]
        wrench = self.data.xfrc_applied[body]
        wrench[:3] += force
        wrench[3:] += cross(point - self.data.xipos[body], force)

    def local(self, link: str, point: Sequence[float]) -> np.ndarray:
        body = self.index[link]
        return self.data.xmat[body].reshape(3, 3).T @ (np.asarray(point) - self.data.xpos[body])

    def point(self, link: str, local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        body = self.index[link]
        at = _place(self.data, body, local)
        jacobian = np.zeros((3, self.model.nv))
        mujoco.mj_jac(self.model, self.data, jacobian, None, at, body)
        return at, jacobian @ self.data.qvel

    def path(self, joint: str, values: np.ndarray, link: str, local: np.ndarray) -> np.ndarray:
        self.scratch.qpos[:] = self.data.qpos
        rates = self.plan.rates(joint)
        followers = {f.name: f.offset for f in self.plan.followers}
        points = []
        for value in values:
            for name, rate in rates.items():
                self.scratch.qpos[self.joints[name]] = rate * value + followers.get(name, 0.0)
            mujoco.mj_kinematics(self.model, self.scratch)
            points.append(_place(self.scratch, self.index[link], local))
        return np.stack(points)

    def inertia(self, joint: str) -> float:
        rates = np.zeros(self.model.nv)
        for name, rate in self.plan.rates(joint).items():
            rates[self.dofs[name]] = rate
        momenta = np.zeros(self.model.nv)
        mujoco.mj_mulM(self.model, self.data, momenta, rates)
        return float(rates @ momenta)

    def damping(self, joint: str) -> float:
        rates = self.plan.rates(joint)
        return float(sum(r**2 * self.model.dof_damping[self.dofs[n]] for n, r in rates.items()))

    def friction(self, joint: str) -> float:
        loss, rates = self.model.dof_frictionloss, self.plan.rates(joint)
        return float(sum(abs(r) * loss[self.dofs[n]] for n, r in rates.items()))

    def coordinates(self) -> dict[str, float]:
        return {j.name: float(self.data.qpos[self.joints[j.name]]) for j in self.plan.joints}

    def speed(self) -> float:
        if self.data.warning.number.any():
            return float("inf")
        velocity = np.zeros(6)
        fastest = 0.0
        for body in range(1, self.model.nbody):
            kind = mujoco.mjtObj.mjOBJ_BODY  # at the centre of mass
            mujoco.mj_objectVelocity(self.model, self.data, kind, body, velocity, 0)
            fastest = max(fastest, float(np.linalg.norm(velocity[3:])))
        return fastest

    def energy(self) -> float:
        mujoco.mj_energyPos(self.model, self.data)
        mujoco.mj_energyVel(self.model, self.data)
        return float(self.data.energy.sum())


def _place(data: mujoco.MjData, body: int, local: np.ndarray) -> np.ndarray:
    return data.xpos[body] + data.xmat[body].reshape(3, 3) @ local


def name_joints(spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
    """Give joints without a name the one that ``objects.mjcf`` gives them, and bodies too."""
    bodies = list(spec.bodies)
    taken = {b.name for b in bodies}
    for i, body in enumerate(bodies):
        if not body.name:
            body.name = _fresh(f"body_{i}", taken)
    taken = {j.name for j in spec.joints}
    number = 0
    for i, body in enumerate(bodies):
        for joint in body.joints:
            if not joint.name:
                joint.name = _fresh(f"{model.body(i).name or 'body'}_joint_{number}", taken)
            number += 1


def _fresh(name: str, taken: set[str]) -> str:
    while name in taken:
        name += "_"
    taken.add(name)
    return name


def _unfiltered(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """The same file where all shapes that can touch anything touch everything; planes and height
    fields are the world, not the asset."""
    spec = spec.copy()
    paired = {name for pair in spec.pairs for name in (pair.geomname1, pair.geomname2)}
    for geom in spec.geoms:
        collides = bool(geom.contype or geom.conaffinity or (geom.name and geom.name in paired))
        geom.contype = geom.conaffinity = int(collides and geom.type not in _SOLID)
        geom.margin = geom.gap = 0.0
    for element in [*spec.excludes, *spec.pairs]:
        spec.delete(element)
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT)
    spec.option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    spec.option.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_OVERRIDE)
    return spec.compile()

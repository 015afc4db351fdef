"""An asset in PyBullet.

What it gets wrong unless told: joints have motors that brake (turned into the file's dry friction),
the inertia is guessed from the shapes, ``<mimic>`` is not read (a gear constraint stands for it),
and a joint's damping is applied explicitly, so that more than about I / dt makes light parts
explode: beyond what PyBullet bears by itself it is held back here (the part then moves too easily),
and told (``damping_share``). Meshes are taken as convex hulls.

A second copy of the asset, a hundred metres large, is only posed: Bullet's collision margin, a
millimetre whatever the size, vanishes there.
"""

from __future__ import annotations

import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pybullet
from trimesh.transformations import quaternion_matrix

from uniart_jax.export.physics import GRAVITY
from uniart_jax.simulation.engine import TIMESTEP, LinkInertia, Pair, Plan, cross

POSED_SIZE = 100.0  # m
NEAR = 1.0  # m, at that size; at 0 Bullet looks for nothing between links of several shapes
GEAR_FORCE = 1e5  # N or N m: followers follow
GEAR_SHARE = 0.2  # of a follower's error that is mended in a time step
SOLVER_STEPS = 100
USUAL_TIMESTEP = 1 / 240  # s, PyBullet's own
_MOVES = (pybullet.JOINT_REVOLUTE, pybullet.JOINT_PRISMATIC)


class BulletEngine:
    """``engine.Engine`` by PyBullet.

    Args:
      path: a self-contained URDF (``staging``).
      plan: None to load only.

    Raises:
      ValueError: PyBullet refuses it.
    """

    def __init__(self, path: Path, plan: Plan | None):
        self.timestep = TIMESTEP
        self.sim = _Copy(path, 1.0)
        if plan is None:
            return
        self.plan = plan
        self.scale = POSED_SIZE / plan.size
        self.posed = _Copy(path, self.scale)
        missing = [j.name for j in plan.joints if j.name not in self.sim.joints]
        if missing:
            raise ValueError(f"PyBullet has no joint '{missing[0]}'")
        self.pairs = self.posed.solid_pairs(plan)
        self._mechanics()

    def _mechanics(self) -> None:
        sim, client = self.sim, self.sim.client
        # first of all: a motor's force becomes an impulse of the time step that is set when it is
        # made
        pybullet.setGravity(0, 0, -GRAVITY, physicsClientId=client)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=TIMESTEP, numSolverIterations=SOLVER_STEPS, physicsClientId=client
        )
        for link in range(-1, len(sim.links) - 1):
            pybullet.changeDynamics(
                sim.body, link, linearDamping=0, angularDamping=0, physicsClientId=client
            )
        sim.pose(self.plan.state({}))
        own = np.diag(sim.mass_matrix()).clip(1e-12)  # as if all other joints were held
        self.damping_share: dict[str, float] = {}
        for (index, info), inertia in zip(sim.moving.items(), own, strict=True):
            share = info[6] * USUAL_TIMESTEP / float(inertia)
            damping = info[6] if share <= 1 else info[6] / (1 + info[6] * TIMESTEP / inertia)
            pybullet.changeDynamics(sim.body, index, jointDamping=damping, physicsClientId=client)
            self.damping_share[info[1].decode()] = share
            pybullet.setJointMotorControl2(
                sim.body,
                index,
                pybullet.VELOCITY_CONTROL,
                targetVelocity=0,
                force=info[7],
                physicsClientId=client,
            )
        for follower in self.plan.followers:
            gear = pybullet.createConstraint(
                sim.body,
                sim.joints[follower.name],
                sim.body,
                sim.joints[follower.driver],
                pybullet.JOINT_GEAR,
                [0, 0, 1],
                [0, 0, 0],
                [0, 0, 0],
                physicsClientId=client,
            )
            pybullet.changeConstraint(  # q_follower + ratio q_driver = target
                gear,
                gearRatio=-follower.rate,
                relativePositionTarget=follower.offset,
                erp=GEAR_SHARE,
                maxForce=GEAR_FORCE,
                physicsClientId=client,
            )
        for a, b in sim.carried():
            pybullet.setCollisionFilterPair(sim.body, sim.body, a, b, 0, physicsClientId=client)

    def inertias(self) -> list[LinkInertia]:
        return [
            LinkInertia(name, mass, moments)
            for name, (mass, moments) in self.sim.inertias.items()
            if any(name in j.moved for j in self.plan.joints)
        ]

    def depths(self, q: Mapping[str, float]) -> dict[Pair, float]:
        posed = self.posed
        posed.pose(self.plan.state(q))
        found: dict[Pair, float] = {}
        for a, b in self.pairs:
            if not posed.near(a, b):
                continue
            points = pybullet.getClosestPoints(
                posed.body, posed.body, NEAR, posed.index[a], posed.index[b], physicsClientId=posed.client  # noqa: E501
            )  # fmt: skip
            depth = max((-point[8] for point in points), default=0.0) / self.scale
            if depth > 0:
                first, second = sorted((a, b))
                found[first, second] = depth
        return found

    def reset(self, q: Mapping[str, float]) -> None:
        self.sim.pose(self.plan.state(q))

    def step(self) -> None:
        pybullet.stepSimulation(physicsClientId=self.sim.client)

    def push(self, link: str, point: np.ndarray, force: np.ndarray) -> None:
        sim = self.sim
        pybullet.applyExternalForce(
            sim.body, sim.index[link], force.tolist(), point.tolist(), pybullet.WORLD_FRAME, physicsClientId=sim.client  # noqa: E501
        )  # fmt: skip

    def local(self, link: str, point: Sequence[float]) -> np.ndarray:
        frame = self.sim.frame(link)
        return frame[:3, :3].T @ (np.asarray(point) - frame[:3, 3])

    def point(self, link: str, local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        state = self.sim.state(link)
        frame = _matrix(state[4], state[5])
        at = frame[:3, :3] @ local + frame[:3, 3]
        return at, np.array(state[6]) + cross(state[7], at - np.array(state[0]))

    def path(self, joint: str, values: np.ndarray, link: str, local: np.ndarray) -> np.ndarray:
        now = self.sim.coordinates()
        points = []
        for value in values:
            rates = self.plan.rates(joint)
            offsets = {f.name: f.offset for f in self.plan.followers}
            now |= {n: rate * value + offsets.get(n, 0.0) for n, rate in rates.items()}
            self.posed.pose(now)
            frame = self.posed.frame(link)
            points.append(frame[:3, :3] @ local + frame[:3, 3] / self.scale)
        return np.stack(points)

    def inertia(self, joint: str) -> float:
        sim = self.sim
        rates = self.plan.rates(joint)
        vector = np.array([rates.get(n, 0.0) for n in sim.joints])
        return float(vector @ sim.mass_matrix() @ vector)

    def damping(self, joint: str) -> float:
        moving, joints = self.sim.moving, self.sim.joints
        return sum(rate**2 * moving[joints[n]][6] for n, rate in self.plan.rates(joint).items())

    def friction(self, joint: str) -> float:
        moving, joints = self.sim.moving, self.sim.joints
        return sum(abs(rate) * moving[joints[n]][7] for n, rate in self.plan.rates(joint).items())

    def coordinates(self) -> dict[str, float]:
        now = self.sim.coordinates()
        return {j.name: now[j.name] for j in self.plan.joints}

    def speed(self) -> float:
        speeds = [np.linalg.norm(self.sim.state(n)[6]) for n in self.sim.links[1:]]
        return float(max(speeds, default=0.0))

    def energy(self) -> float:
        total = 0.0
        for link in self.sim.links[1:]:
            mass, moments = self.sim.inertias[link]
            state = self.sim.state(link)
            spin = _matrix(state[0], state[1])[:3, :3].T @ np.array(state[7])
            total += mass * (float(np.dot(state[6], state[6])) / 2 + GRAVITY * state[0][2])
            total += float(spin @ (moments * spin)) / 2
        return total


class _Copy:
    """The asset once in a world of its own.

    Attributes:
      links: names, the root first.
      index: link -> PyBullet's number, -1 for the root.
      joints: joint that moves -> number (its child link's), in PyBullet's order.
      moving: number -> ``getJointInfo``.
    """

    def __init__(self, path: Path, scale: float):
        self.scale = scale
        self.client = client = pybullet.connect(pybullet.DIRECT)
        # else each keeps 60 MB until the process ends
        weakref.finalize(self, pybullet.disconnect, client).atexit = False
        flags = (
            pybullet.URDF_USE_INERTIA_FROM_FILE
            | pybullet.URDF_USE_SELF_COLLISION
            | pybullet.URDF_USE_SELF_COLLISION_EXCLUDE_PARENT
        )
        try:
            self.body = pybullet.loadURDF(
                str(path), useFixedBase=True, flags=flags, globalScaling=scale, physicsClientId=client  # noqa: E501
            )  # fmt: skip
        except pybullet.error as error:
            raise ValueError(f"PyBullet: {error}") from None
        count = pybullet.getNumJoints(self.body, physicsClientId=client)
        infos = [pybullet.getJointInfo(self.body, i, physicsClientId=client) for i in range(count)]
        root = pybullet.getBodyInfo(self.body, physicsClientId=client)[0].decode()
        self.links = [root, *(info[12].decode() for info in infos)]
        self.index = {name: i - 1 for i, name in enumerate(self.links)}
        self.parents = [info[16] for info in infos]
        self.moving = {i: info for i, info in enumerate(infos) if info[2] in _MOVES}
        self.joints = {info[1].decode(): i for i, info in self.moving.items()}
        self.travels = {i: info[2] == pybullet.JOINT_PRISMATIC for i, info in self.moving.items()}
        self.inertias: dict[str, tuple[float, np.ndarray]] = {}
        for name, i in self.index.items():
            told = pybullet.getDynamicsInfo(self.body, i, physicsClientId=client)
            self.inertias[name] = float(told[0]), np.array(told[2])
        told = pybullet.getDynamicsInfo(self.body, -1, physicsClientId=client)
        self.base_inertial = _matrix(told[3], told[4])

    def pose(self, state: Mapping[str, float]) -> None:
        """Set coordinates, metres as the file has them, standing still."""
        for name, i in self.joints.items():
            value = state.get(name, 0.0) * (self.scale if self.travels[i] else 1.0)
            pybullet.resetJointState(self.body, i, value, 0.0, physicsClientId=self.client)

    def coordinates(self) -> dict[str, float]:
        if not self.joints:
            return {}
        numbers = list(self.joints.values())
        states = pybullet.getJointStates(self.body, numbers, physicsClientId=self.client)
        return {name: s[0] for name, s in zip(self.joints, states, strict=True)}

    def mass_matrix(self) -> np.ndarray:
        """[J, J] in the present state, from how every link moves with each joint.

        PyBullet's own ``calculateMassMatrix`` refuses sound robots whose tensors, once turned, are
        symmetric to 7e-15 only.
        """
        numbers, client = list(self.joints.values()), self.client
        if not numbers:
            return np.zeros((0, 0))
        states = [pybullet.getJointState(self.body, i, physicsClientId=client)[:2] for i in numbers]
        moved = []
        for k in range(len(numbers)):
            for i, number in enumerate(numbers):
                pybullet.resetJointState(
                    self.body, number, states[i][0], float(i == k), physicsClientId=client
                )
            rows = []
            for link in self.links[1:]:
                mass, moments = self.inertias[link]
                state = self.state(link)
                spin = _matrix(state[0], state[1])[:3, :3].T @ np.array(state[7])
                rows += [np.sqrt(mass) * np.array(state[6]), np.sqrt(moments) * spin]
            moved.append(np.concatenate(rows))
        for number, (position, velocity) in zip(numbers, states, strict=True):
            pybullet.resetJointState(self.body, number, position, velocity, physicsClientId=client)
        rows = np.reshape(moved, (len(numbers), -1))
        return rows @ rows.T

    def state(self, link: str) -> tuple:
        """``getLinkState`` as of now; for the root, which never moves, the same eight entries."""
        i = self.index[link]
        if i >= 0:
            return pybullet.getLinkState(self.body, i, 1, 1, physicsClientId=self.client)
        at, turned = pybullet.getBasePositionAndOrientation(self.body, physicsClientId=self.client)
        frame = _matrix(at, turned) @ np.linalg.inv(self.base_inertial)
        still = (0.0, 0.0, 0.0)
        return at, turned, still, (0.0, 0.0, 0.0, 1.0), tuple(frame[:3, 3]), turned, still, still

    def frame(self, link: str) -> np.ndarray:
        """[4, 4] of a link's own frame, not that of its mass."""
        state = self.state(link)
        return _matrix(state[4], state[5])

    def solid(self) -> list[str]:
        """Links that have collision shapes."""
        return [
            name
            for name, i in self.index.items()
            if pybullet.getCollisionShapeData(self.body, i, physicsClientId=self.client)
        ]

    def carried(self) -> list[tuple[int, int]]:
        """(link, what carries it) where a link without shapes stands between: a screw's, which
        hides the parent from PyBullet."""
        solid = {self.index[name] for name in self.solid()}
        pairs = []
        for i in solid - {-1}:
            above = self.parents[i]
            while above >= 0 and above not in solid:
                above = self.parents[above]
            if above != self.parents[i]:
                pairs.append((i, above))
        return pairs

    def solid_pairs(self, plan: Plan) -> list[Pair]:
        """Links that have collision shapes and may move against each other."""
        solid = self.solid()
        return [
            (a, b) for k, a in enumerate(solid) for b in solid[k + 1 :] if not plan.rigid_pair(a, b)
        ]

    def near(self, a: str, b: str) -> bool:
        """Whether two links' boxes meet."""
        boxes = [
            pybullet.getAABB(self.body, self.index[n], physicsClientId=self.client) for n in (a, b)
        ]
        (lo, hi), (low, high) = boxes
        return all(lo[i] <= high[i] and low[i] <= hi[i] for i in range(3))


def _matrix(position: Sequence[float], quaternion: Sequence[float]) -> np.ndarray:
    """[4, 4] of PyBullet's position and (x, y, z, w)."""
    matrix = quaternion_matrix([quaternion[3], *quaternion[:3]])
    matrix[:3, 3] = position
    return matrix

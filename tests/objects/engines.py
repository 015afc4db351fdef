"""What other programs say about a description: link frames at any joint state, from yourdfpy and
MuJoCo, to compare ours with."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from uniart_jax.objects.kinematics import LEAST_ANGLE
from uniart_jax.objects.object import ArticulatedObject, Part


@dataclasses.dataclass
class Engine:
    """A tree of links in another program."""

    above: dict[
        str, tuple[str | None, list[str]]
    ]  # link -> (parent, joints between them that move)
    shown: dict[str, float]  # joint -> its coordinate at the shown state
    frames: Callable[
        [dict[str, float]], dict[str, np.ndarray]
    ]  # joint state -> link -> [4, 4] world
    axes: dict[str, np.ndarray]  # joint -> [3] world axis at the shown state
    limits: dict[str, tuple[float, float]]  # joint -> its ends as the program counts them
    turns: dict[str, bool]  # joint -> whether it turns, else it travels


def mujoco_engine(path: Path) -> Engine:
    """MuJoCo's view of an MJCF; a file that it cannot compile raises ValueError."""
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    bodies = [model.body(i).name or f"body_{i}" for i in range(model.nbody)]
    joints = [
        model.joint(i).name or f"{model.body(int(model.jnt_bodyid[i])).name}_joint_{i}"
        for i in range(model.njnt)
    ]
    above: dict[str, tuple[str | None, list[str]]] = {bodies[0]: (None, [])}
    for i in range(1, model.nbody):
        first = int(model.body_jntadr[i])
        mine = joints[first : first + int(model.body_jntnum[i])] if first >= 0 else []
        above[bodies[i]] = (bodies[int(model.body_parentid[i])], mine)

    def frames(state: dict[str, float]) -> dict[str, np.ndarray]:
        data.qpos[:] = model.qpos0
        for name, q in state.items():
            data.qpos[model.jnt_qposadr[joints.index(name)]] = q
        mujoco.mj_kinematics(model, data)
        found = {}
        for i, name in enumerate(bodies):
            found[name] = np.eye(4)
            found[name][:3, :3] = data.xmat[i].reshape(3, 3)
            found[name][:3, 3] = data.xpos[i]
        return found

    limits, turns = {}, {}
    for i, name in enumerate(joints):
        if int(model.jnt_type[i]) >= 2:  # slide, hinge
            lo, hi = model.jnt_range[i] if model.jnt_limited[i] else (-np.inf, np.inf)
            limits[name], turns[name] = (float(lo), float(hi)), int(model.jnt_type[i]) == 3
    shown = {name: float(np.clip(0.0, *ends)) for name, ends in limits.items()}
    frames(shown)
    axes = {name: data.xaxis[joints.index(name)].copy() for name in shown}
    return Engine(above, shown, frames, axes, limits, turns)


def mujoco_points(path: Path, state: dict[str, float]) -> dict[str, np.ndarray]:
    """Body -> [n, 3] world points that lie on the surface of its visible geoms that collide with
    nothing, at a joint state."""
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    for name, q in state.items():
        data.qpos[model.joint(name).qposadr[0]] = q
    mujoco.mj_kinematics(model, data)
    found: dict[str, list[np.ndarray]] = {}
    for g in range(model.ngeom):
        if model.geom_contype[g] or model.geom_conaffinity[g] or model.geom_group[g] > 2:
            continue
        size, kind = model.geom_size[g], int(model.geom_type[g])
        along = np.array([[0, 0, -1.0], [0, 0, 1.0]])
        if kind == 7:
            start, mesh = model.mesh_vertadr[model.geom_dataid[g]], model.geom_dataid[g]
            points = model.mesh_vert[start : start + model.mesh_vertnum[mesh]]
        elif kind == 6:
            points = size * (np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T)
        elif kind in (3, 4, 5):  # capsule, ellipsoid, cylinder: the poles
            points = along * {3: size[0] + size[1], 4: size[2], 5: size[1]}[kind]
        else:
            continue
        world = points @ data.geom_xmat[g].reshape(3, 3).T + data.geom_xpos[g]
        name = model.body(int(model.geom_bodyid[g])).name
        found.setdefault(name, []).append(world)
    return {name: np.concatenate(points) for name, points in found.items()}


def mujoco_misplaced(obj: ArticulatedObject, path: Path, state: dict[str, float]) -> float:
    """The largest distance from those points to the part of that name in the object, which is shown
    at that state."""
    by_name = {p.name: p.mesh.vertices for p in obj.parts}
    points = mujoco_points(path, state)
    return max(float(cKDTree(by_name[n]).query(p)[0].max()) for n, p in points.items())


def urdf_engine(path: Path) -> Engine:
    """yourdfpy's view of a URDF, every joint independent; a file that it cannot read raises
    whatever yourdfpy raises."""
    import yourdfpy

    options = {"load_meshes": False, "build_scene_graph": True, "load_collision_meshes": False}
    robot = copy.deepcopy(yourdfpy.URDF.load(str(path), **options).robot)
    mimics = {j.name: j.mimic for j in robot.joints if j.mimic is not None}
    for joint in robot.joints:
        joint.mimic = None
    urdf = yourdfpy.URDF(robot=robot, **options)
    above: dict[str, tuple[str | None, list[str]]] = {n.name: (None, []) for n in robot.links}
    moving = ("revolute", "continuous", "prismatic")
    shown, limits, turns = {}, {}, {}
    for joint in robot.joints:
        above[joint.child] = (joint.parent, [joint.name] if joint.type in moving else [])
        if joint.type in moving:
            lo, hi = -np.inf, np.inf
            limit = joint.limit if joint.type != "continuous" else None
            if limit is not None and not (limit.lower is None and limit.upper is None):
                lo, hi = sorted((limit.lower or 0.0, limit.upper or 0.0))
            limits[joint.name], turns[joint.name] = (lo, hi), joint.type != "prismatic"
            shown[joint.name] = float(np.clip(0.0, lo, hi))
            mimic = mimics.get(joint.name)
            if mimic is not None:
                wanted = (mimic.multiplier or 1.0) * shown.get(mimic.joint, 0.0)
                shown[joint.name] = float(np.clip(wanted + (mimic.offset or 0.0), lo, hi))

    def frames(state: dict[str, float]) -> dict[str, np.ndarray]:
        urdf.update_cfg({name: q for name, q in state.items() if name in urdf.actuated_joint_names})
        return {name: urdf.get_transform(name) for name in above}

    placed = frames(shown)
    axes = {j.name: placed[j.child][:3, :3] @ j.axis for j in robot.joints if j.name in shown}
    return Engine(above, shown, frames, axes, limits, turns)


def joints_between(engine: Engine, link: str, other: str) -> list[str]:
    """The joints that move on the way from one link to another."""
    ways = []
    for name in (link, other):
        way, node = {name: []}, name
        while engine.above[node][0] is not None:
            parent, joints = engine.above[node]
            way[parent] = way[node] + joints
            node = parent
        ways.append(way)
    meeting = next(n for n in ways[0] if n in ways[1])
    return ways[0][meeting] + ways[1][meeting]


@dataclasses.dataclass
class Comparison:
    """How far the vertices of all parts stand from where the other program has them."""

    error: float  # largest distance, of the object's size
    compared: int  # joints drawn
    excepted: list[str]  # joints of edges that hold several, lowered to one
    held: list[str]  # joints that the object does not move
    unexplained: list[
        str
    ]  # those of them, and of the excepted, that neither the provenance nor a dead zone explains
    wrong: list[str]  # joints whose axis is reversed or whose ends are others


def compared(obj: ArticulatedObject, engine: Engine, seed: int, states: int = 20) -> Comparison:
    """Forward kinematics of an object against an engine's at random joint states, every compared
    joint within its limits."""
    moved, excepted = {}, []
    for k, part in enumerate(obj.parts):
        if part.parent < 0:
            continue
        joints = joints_between(engine, part.name, obj.parts[part.parent].name)
        if len(joints) > 1:
            excepted += joints
        elif joints and part.joint.type != "fixed":
            moved[k] = joints[0]
    rng = np.random.default_rng(seed)
    start = engine.frames(engine.shown)
    worst = 0.0
    for _ in range(states):
        q, state = np.zeros(len(obj.parts)), dict(engine.shown)
        for k, name in moved.items():
            q[k] = rng.uniform(*obj.joints[k].limits)
            same = np.sign(obj.joints[k].direction @ engine.axes[name])
            state[name] = engine.shown[name] + same * q[k]
        there = engine.frames(state)
        for part, here in zip(obj.parts, obj.forward_kinematics(q), strict=True):
            matrix = there[part.name] @ np.linalg.inv(start[part.name])
            ours = trimesh.transform_points(part.mesh.vertices, here)
            theirs = trimesh.transform_points(part.mesh.vertices, matrix)
            worst = max(worst, float(np.abs(ours - theirs).max()))
    size = float((obj.bounds[1] - obj.bounds[0]).max())
    held = [n for n in engine.shown if n not in moved.values() and n not in excepted]
    unexplained = [n for n in held if not _held_rightly(obj, engine, n)]
    unexplained += [n for n in excepted if not any(f"'{n}'" in line for line in obj.provenance)]
    wrong = [n for k, n in moved.items() if not _moves_alike(obj, obj.parts[k], engine, n, size)]
    return Comparison(worst / size, len(moved), excepted, held, unexplained, wrong)


def _said(obj: ArticulatedObject, joint: str, *words: str) -> bool:
    """Whether a repair of this joint says one of these."""
    return any(f"'{joint}'" in line and any(w in line for w in words) for line in obj.provenance)


def _moves_alike(
    obj: ArticulatedObject, part: Part, engine: Engine, name: str, size: float
) -> bool:
    """Whether a part's joint has the engine's direction, and its ends counted from the shown
    state."""
    joint, turns = part.joint, engine.turns[name]
    lo, hi = engine.limits[name]
    if turns and _said(obj, name, "can only be degrees"):
        lo, hi = np.deg2rad(lo), np.deg2rad(hi)
    expected = np.array([lo, hi]) - engine.shown[name]
    if turns and not hi - lo < 2 * np.pi - 1e-9:
        expected = np.array([-np.pi, np.pi])
    elif not np.isfinite(hi - lo):
        if not _said(obj, name, "prismatic without limits"):
            return False
        half = np.ptp(part.mesh.vertices @ joint.direction) / 2
        expected = np.array([-half, half])
    ours, others = (joint.angle, joint.travel) if turns else (joint.travel, joint.angle)
    same = np.allclose(ours, expected, rtol=0, atol=1e-6 * (1.0 if turns else size))
    direction = engine.axes[name] / np.linalg.norm(engine.axes[name])
    return bool(same and others == (0, 0) and np.allclose(joint.direction, direction, atol=1e-6))


def _held_rightly(obj: ArticulatedObject, engine: Engine, name: str) -> bool:
    """Whether a joint that no part has moves none, or all of them as one, or too little to count,
    or a repair tells why not."""
    below = next(link for link, (_, joints) in engine.above.items() if name in joints)
    carried = [p for p in obj.parts if _hangs_on(engine, p.name, below)]
    if not carried or len(carried) == len(obj.parts):
        return True
    if _said(obj, name, "held", "its axis is zero"):
        return True
    part = next(p for p in obj.parts if p in carried)
    dead = LEAST_ANGLE if engine.turns[name] else part.joint.dead_zone
    return bool(np.diff(engine.limits[name])[0] <= dead)


def _hangs_on(engine: Engine, link: str | None, above: str) -> bool:
    while link is not None and link != above:
        link = engine.above[link][0]
    return link is not None

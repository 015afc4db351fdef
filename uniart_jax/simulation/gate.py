"""A published pass or fail for assets made from pictures: AffordCraft's.

An asset is put on a floor with nothing that holds it, left alone for 360 steps of 1/120 s, and
looked at: does it come to rest on the floor, without parts in one another, able to move as it says?
The rule is AffordCraft's (github.com/AffordCraft/AffordCraft, MIT: ``affordcraft/physics.py``,
``affordcraft/contracts.py``, ``scripts/physics_worker.py``), which runs it in Isaac Sim; here it
runs in MuJoCo. docs/simulation.md tells what differs.

Metres, kilograms, seconds.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from uniart_jax.export.physics import GRAVITY
from uniart_jax.simulation.engine import Plan
from uniart_jax.simulation.measure import check
from uniart_jax.simulation.mujoco_engine import name_joints

STEPS, TIMESTEP, TAIL = 360, 1 / 120, 60  # simulated, s, of them judged
PENETRATION = 1e-3  # that shapes may share at the start, and parts at any time
CONTACT = 1e-4  # gap across which the floor counts as touched
SHIFT, TURN = 0.05, 5.0  # m and degrees that a part may move while it is judged
FLOOR = 0.012  # below the floor, that the asset may end
START = 2e-3  # above the floor, where it begins
SLACK = 1e-9  # of the triangle inequality, kg m^2
RANGE = 1e-6  # that the ends of a range may differ
_FLOOR = "uniart_gate_floor"
_UNSHAPED = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)
_BROKEN = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)
_TIES = (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD)


def judge(path: Path, plan: Plan | None) -> dict:
    """What the gate says of an asset.

    Args:
      path: a self-contained description (``staging``): the files that it names lie beside it.
      plan: which joints move by the description, and how far; None where our reader does not take
        it.

    Returns:
      JSON values: ``checks`` {rule: verdict (``measure.check``)}, ``articulated``: whether a part
      of it can move.

    Raises:
      ValueError: MuJoCo refuses it.
    """
    spec, anchors = _freed(path)
    model = spec.compile()
    lowest = _lowest(model, _at_start(model))
    height = (lowest if np.isfinite(lowest) else 0.0) - START
    spec.worldbody.add_geom(
        name=_FLOOR,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        pos=[0.0, 0.0, height],
        size=[0.0, 0.0, 1.0],
        margin=CONTACT,
        gap=CONTACT,
        contype=0x7FFFFFFF,
        conaffinity=0x7FFFFFFF,
    )
    model = spec.compile()
    data = _at_start(model)
    floor = model.geom(_FLOOR).id
    checks = {
        "shapes": _shapes(model),
        "inertia": _inertia(model),
        "anchor": check(len(anchors), 0, not anchors, "; ".join(anchors)),
        "gravity": _gravity(model),
        "mobility": _mobility(model, plan),
    }
    free = [j for j in range(model.njnt) if int(model.jnt_type[j]) != mujoco.mjtJoint.mjJNT_FREE]
    return {"checks": checks | _left_alone(model, data, floor), "articulated": bool(free)}


def _freed(path: Path) -> tuple[mujoco.MjSpec, list[str]]:
    """(the asset free to go where it likes; what holds it to the world nevertheless)."""
    assets = {p.name: p.read_bytes() for p in path.parent.iterdir() if p != path}
    spec = mujoco.MjSpec.from_string(path.read_text("utf-8"), assets=assets)
    spec.compiler.fusestatic = False
    # nothing is mended: an impossible inertia stays what it is, or is refused
    spec.compiler.balanceinertia = False
    spec.compiler.boundmass = spec.compiler.boundinertia = 0.0
    name_joints(spec, spec.compile())
    anchors = []
    for geom in list(spec.worldbody.geoms):
        if geom.type in _UNSHAPED:  # their floor
            spec.delete(geom)
        else:
            anchors.append("a shape belongs to the world itself")
    tops = [b for b in spec.worldbody.bodies if _has_shapes(b)]
    if len(tops) > 1:
        names = ", ".join(f"'{b.name}'" for b in tops)
        anchors.append(f"bodies {names} are held by nothing but the world")
    for top in spec.worldbody.bodies:
        if not top.joints:
            top.add_freejoint()
        elif top.joints[0].type != mujoco.mjtJoint.mjJNT_FREE:
            anchors.append(f"joint '{top.joints[0].name}' holds body '{top.name}' to the world")
    bodies = {b.name for b in spec.bodies} - {"world"}
    for tie in spec.equalities:
        if tie.type in _TIES and not {tie.name1, tie.name2} <= bodies:
            anchors.append(f"an equality holds '{tie.name1 or tie.name2}' to the world")
    anchors += [f"body '{b.name}' is moved by hand (mocap)" for b in spec.bodies if b.mocap]
    for element in [*spec.excludes, *spec.keys]:
        spec.delete(element)
    option = spec.option
    option.timestep, option.gravity = TIMESTEP, [0.0, 0.0, -GRAVITY]
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.disableflags, option.enableflags = 0, 0
    return spec, anchors


def _has_shapes(body: mujoco.MjsBody) -> bool:
    return bool(body.geoms) or any(_has_shapes(b) for b in body.bodies)


def _at_start(model: mujoco.MjModel) -> mujoco.MjData:
    """As the file has it; coordinates that a limit excludes are at its nearest end."""
    data = mujoco.MjData(model)
    for j in range(model.njnt):
        if model.jnt_limited[j] and int(model.jnt_type[j]) in (2, 3):  # slide, hinge
            at = int(model.jnt_qposadr[j])
            data.qpos[at] = np.clip(data.qpos[at], *model.jnt_range[j])
    mujoco.mj_kinematics(model, data)
    return data


def _solid(model: mujoco.MjModel) -> list[int]:
    """Shapes of the asset that collide."""
    touches = model.geom_contype | model.geom_conaffinity
    return [g for g in range(model.ngeom) if touches[g] and model.geom_bodyid[g]]


def _lowest(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """The lowest point of all colliding shapes, m; infinite if there are none."""
    kinds = mujoco.mjtGeom
    found = np.inf
    for g in _solid(model):
        up, size = data.geom_xmat[g].reshape(3, 3)[2], model.geom_size[g]
        kind = int(model.geom_type[g])
        if kind == kinds.mjGEOM_MESH:
            mesh = int(model.geom_dataid[g])
            start = int(model.mesh_vertadr[mesh])
            reach = -float((model.mesh_vert[start:][: model.mesh_vertnum[mesh]] @ up).min())
        elif kind == kinds.mjGEOM_BOX:
            reach = float(np.abs(up) @ size)
        elif kind in (kinds.mjGEOM_SPHERE, kinds.mjGEOM_CAPSULE):
            reach = float(size[0] + (kind == kinds.mjGEOM_CAPSULE) * abs(up[2]) * size[1])
        elif kind == kinds.mjGEOM_CYLINDER:
            reach = float(abs(up[2]) * size[1] + np.hypot(up[0], up[1]) * size[0])
        else:  # an ellipsoid
            reach = float(np.linalg.norm(up * size))
        found = min(found, float(data.geom_xpos[g][2]) - reach)
    return found


def _shapes(model: mujoco.MjModel) -> dict:
    """Every body has a shape, and something collides."""
    bare = [model.body(b).name for b in range(1, model.nbody) if not model.body_geomnum[b]]
    if bare:
        return check(len(bare), 0, False, f"body '{bare[0]}' has no shape")
    solid = bool(_solid(model))
    return check(int(not solid), 0, solid, "nothing of it collides")


def _inertia(model: mujoco.MjModel) -> dict:
    """Every body has a mass and an inertia that a solid can have: moments above 0, none above the
    sum of the others."""
    bad = []
    for b in range(1, model.nbody):
        moments, mass = model.body_inertia[b], float(model.body_mass[b])
        known = np.isfinite([*moments, mass, *model.body_ipos[b]]).all()
        possible = moments.min() > 0 and 2 * moments.max() <= moments.sum() + SLACK
        if not (known and mass > 0 and possible):
            said = ", ".join(f"{m:.3g}" for m in moments)
            bad.append(f"body '{model.body(b).name}': {mass:.3g} kg, moments {said} kg m^2")
    return check(len(bad), 0, not bad, bad[0] if bad else "")


def _gravity(model: mujoco.MjModel) -> dict:
    """Nothing floats by decree."""
    held = [model.body(b).name for b in range(1, model.nbody) if model.body_gravcomp[b]]
    return check(len(held), 0, not held, f"gravity is off for body '{held[0]}'" if held else "")


def _mobility(model: mujoco.MjModel, plan: Plan | None) -> dict:
    """Every joint of the description is there, with the range that it has there, and finite."""
    if plan is None:
        return check(1, 0, False, "its joints cannot be read")
    there = {model.joint(j).name: j for j in range(model.njnt)}
    lost = []
    for joint in plan.joints:
        if joint.name not in there:
            lost.append(f"joint '{joint.name}' is not there")
            continue
        j = there[joint.name]
        if not model.jnt_limited[j]:
            if joint.kind == "prismatic":
                lost.append(f"joint '{joint.name}' slides without an end")
            continue
        lo, hi = model.jnt_range[j]
        if not lo < hi or np.abs([lo - joint.lo, hi - joint.hi]).max() > RANGE:
            lost.append(f"joint '{joint.name}' goes from {lo:.4g} to {hi:.4g}")
    return check(len(lost), 0, not lost, lost[0] if lost else "")


def _left_alone(model: mujoco.MjModel, data: mujoco.MjData, floor: int) -> dict[str, dict]:
    """The rules that need the simulation."""
    mujoco.mj_forward(model, data)
    start, within, nearest = (0.0, ""), (0.0, ""), np.inf
    standing, poses = [], []
    for step in range(STEPS + 1):
        if step:
            mujoco.mj_step2(model, data)
            mujoco.mj_step1(model, data)
        distances, shapes = np.array(data.contact.dist), np.array(data.contact.geom).reshape(-1, 2)
        below = (shapes == floor).any(1)
        gap = float(distances[below].min(initial=np.inf))
        nearest = min(nearest, gap)
        if step <= 1:
            start = max(start, _deepest(model, distances, shapes))
        within = max(within, _deepest(model, distances[~below], shapes[~below]))
        standing.append(gap <= CONTACT)
        poses.append((data.xpos[1:].copy(), data.xquat[1:].copy()))
        if not np.isfinite(data.qpos).all() or any(data.warning[w].number for w in _BROKEN):
            broke = check(step, STEPS, False, f"the simulation breaks down after {step} steps")
            return {"finite": broke}
    shift, turn = _moved(poses[-TAIL:])
    sunk = float(data.geom_xpos[floor][2]) - _lowest(model, data)
    standing = standing[-TAIL:]
    off = f"it does not stand on the floor in {standing.count(False)} of the last {TAIL} steps"
    return {
        "finite": check(STEPS, STEPS, True),
        "initial_penetration": check(start[0], PENETRATION, start[0] <= PENETRATION, _deep(start)),
        "self_penetration": check(within[0], PENETRATION, within[0] <= PENETRATION, _deep(within)),
        "support": check(nearest, CONTACT, all(standing), off),
        "settle_shift": check(shift, SHIFT, shift <= SHIFT),
        "settle_turn": check(turn, TURN, turn <= TURN),
        "floor": check(sunk, FLOOR, sunk <= FLOOR),
    }


def _deepest(model: mujoco.MjModel, distances: np.ndarray, shapes: np.ndarray) -> tuple[float, str]:
    """(depth, m, of which two bodies) of the deepest of contacts [n] between shapes [n, 2]."""
    if not (distances < 0).any():
        return 0.0, ""
    at = int(distances.argmin())
    names = [model.body(model.geom_bodyid[g]).name for g in shapes[at]]
    told = " and ".join("the floor" if n == "world" else f"'{n}'" for n in names)
    return -float(distances[at]), told


def _deep(found: tuple[float, str]) -> str:
    return f"{found[1]} share {1000 * found[0]:.2g} mm"


def _moved(poses: list[tuple[np.ndarray, np.ndarray]]) -> tuple[float, float]:
    """(m, degrees) that any body is farthest from where it ends."""
    places, turns = (np.stack(values) for values in zip(*poses, strict=True))
    shift = float(np.linalg.norm(places - places[-1], axis=-1).max())
    same = np.clip(np.abs((turns * turns[-1]).sum(-1)), 0.0, 1.0)
    return shift, float(np.rad2deg(2 * np.arccos(same)).max())

"""All that is measured in one engine: an ``Engine`` in, plain JSON values out.

Every check is {"passed", "value", "limit"} with a "reason" that names joints and links where it
failed. Joints' own numbers and curves stand apart, under "joints" and "motions".
"""

from __future__ import annotations

import functools
from collections.abc import Iterable

import numpy as np

from uniart_jax.objects.kinematics import ANGLE_DEAD_ZONE, TRAVEL_DEAD_ZONE
from uniart_jax.simulation.engine import Engine, Pair, PlannedJoint
from uniart_jax.simulation.primitives import REACH, Motion, compound, drive
from uniart_jax.simulation.stand import BEYOND, GROWTH, MOVED, leave_alone, speed_limit
from uniart_jax.simulation.sweep import DEPTH, JointSweep, opens_beside, sweep

OVERLAP = 0.02  # of the object's size, that parts may dig into each other at rest
DIGITS = 5  # of what is told
HUGE = 1e9  # what is told of what is not finite


def check(value: float, limit: float, passed: bool, reason: str = "") -> dict:
    """One verdict as JSON values."""
    found = {"passed": bool(passed), "value": number(value), "limit": limit}
    return found | ({"reason": reason} if reason and not passed else {})


def number(value: float) -> float:
    """A number that JSON holds."""
    return float(f"{float(np.nan_to_num(value, nan=HUGE, posinf=HUGE, neginf=-HUGE)):.{DIGITS}g}")


def measure(engine: Engine) -> dict:
    """{"checks": {check: verdict}, "joints": {joint: numbers}, "motions": [curves]} of a loaded
    asset.

    A check that has nothing to look at (no slider, no two joints) is left out.
    """
    plan = engine.plan
    checks: dict[str, dict] = {"inertia": _inertia(engine)}
    at_rest = engine.depths({})
    checks["overlap"] = _overlap(at_rest, plan.size)
    if engine.damping_share:
        checks["damping"] = _damped(engine.damping_share)
    alone = leave_alone(engine, {})
    fell = [n for n, m in alone.moved.items() if not m <= MOVED]
    most = max(alone.moved.values(), default=0.0)
    checks["stands"] = check(most, MOVED, not fell, f"moved by gravity: {_listed(fell)}")
    joints: dict[str, dict] = {}
    if plan.joints:
        sweeps = [sweep(engine, joint, at_rest) for joint in plan.joints]
        checks["sweep"] = _swept(sweeps)
        by_name = {j.name: j for j in plan.joints}
        large = [j for j in plan.joints if _drivable(j, plan.size)]
        motions = {
            s.joint: drive(engine, [by_name[n] for n in (*s.after, s.joint)], at_rest)
            for s in sweeps
            if by_name[s.joint] in large
        }
        sliders = [j.name for j in large if j.kind == "prismatic"]
        hinges = [j.name for j in large if j.kind != "prismatic"]
        groups = {"hinge_opening": hinges, "slider_pulling": sliders}
        for name, members in groups.items():
            if members:
                checks[name] = _driven([motions[m] for m in members])
        pair = compound(
            large,
            {s.joint: s.after for s in sweeps},
            functools.partial(opens_beside, engine, at_rest=at_rest),
        )
        every = list(motions.values())
        if pair:
            both = drive(engine, pair, at_rest)
            checks["flip_and_rotate"] = _driven([both])
            every.append(both)
        calm = {"at rest": alone} | {f"after {_joined(m)}": m.after for m in every}
        checks["drift"] = _drift(calm)
        checks["energy"] = check(
            max(r.growth for r in calm.values()), GROWTH, all(r.growth <= GROWTH for r in calm.values()),  # noqa: E501
            "energy appears from nowhere " + _listed(n for n, r in calm.items() if not r.growth <= GROWTH),  # noqa: E501
        )  # fmt: skip
        speeds = {n: r.speed for n, r in calm.items()} | {_joined(m): m.speed for m in every}
        limit = speed_limit(plan)
        wild = [n for n, s in speeds.items() if not s <= limit]
        checks["explosion"] = check(
            max(speeds.values()), number(limit), not wild, f"too fast (m/s): {_listed(wild)}"
        )
        for joint, way in zip(plan.joints, sweeps, strict=True):
            moved = alone.moved[joint.name]
            joints[joint.name] = _numbers(joint, way, motions.get(joint.name), moved)
        curves = [_curves(m) for m in every]
    else:
        curves = []
    return {"checks": checks, "joints": joints, "motions": curves}


def _overlap(at_rest: dict[Pair, float], size: float) -> dict:
    shares = {pair: depth / size for pair, depth in at_rest.items()}
    bad = _listed(f"{_pair(p)} by {d:.3f}" for p, d in shares.items() if d > OVERLAP)
    why = f"collision shapes dig into each other at rest: {bad}"
    return check(max(shares.values(), default=0.0), OVERLAP, not bad, why)


def _damped(shares: dict[str, float]) -> dict:
    wild = _listed(f"'{n}'" for n, share in shares.items() if share > 1)
    why = f"explodes by itself, its damping is too large for its inertia: {wild}"
    return check(max(shares.values()), 1, not wild, why)


def _drivable(joint: PlannedJoint, size: float) -> bool:
    """Whether a joint's way is long enough to be told from the softness of engines' limits when a
    hand pushes; others are posed only. Of what turns and travels one way is long."""
    if joint.kind == "screw":
        return True
    least = TRAVEL_DEAD_ZONE * size if joint.kind == "prismatic" else ANGLE_DEAD_ZONE
    return joint.span >= least * (1 - 1e-9)


def _numbers(joint: PlannedJoint, way: JointSweep, motion: Motion | None, moved: float) -> dict:
    """What is told of one joint; of one that no hand moved, how far it is free."""
    return {
        "kind": joint.kind,
        "part": joint.part,
        "range": [number(joint.lo), number(joint.hi)],
        "rest": number(joint.rest),
        "goal": number(joint.goal),
        "stands": number(moved),
        "sweep": number(way.depth.max()),
        "free": number(way.free),
        "after": list(way.after),
        "driven": motion is not None,
        "reached": number(way.free if motion is None else motion.reached[-1]),
        "collision": number(way.depth.max() if motion is None else motion.depth),
        "values": [number(v) for v in way.values],
        "depth": [number(d) for d in way.depth],
    }


def _inertia(engine: Engine) -> dict:
    bad = []
    for link in engine.inertias():
        why = impossible(link.mass, link.moments)
        if why and any(link.link in j.moved for j in engine.plan.joints):
            bad.append((link.link, why))
    groups = engine.plan.rigid
    heavy = {
        groups[i.link]
        for i in engine.inertias()
        if i.link in groups and not impossible(i.mass, i.moments)
    }
    bad = [(n, w) for n, w in bad if w != "mass 0" or groups.get(n) not in heavy]
    return check(len(bad), 0, not bad, _listed(f"link '{n}': {w}" for n, w in bad))


def impossible(mass: float, moments: np.ndarray) -> str:
    """Why no solid has this mass and these principal moments of inertia; empty if one may."""
    moments = np.sort(np.asarray(moments, np.float64))
    if not np.isfinite([mass, *moments]).all():
        return "not finite"
    if mass == 0:
        return "mass 0"
    if mass < 0:
        return f"mass {mass:.3g}"
    if moments[0] <= 0:
        return f"inertia not positive definite ({moments[0]:.3g})"
    if moments[0] + moments[1] < moments[2] * (1 - 1e-3):
        return (
            f"inertia against the triangle inequality ({moments[0]:.3g} + {moments[1]:.3g} < "
            f"{moments[2]:.3g})"
        )
    return ""


def _swept(sweeps: list[JointSweep]) -> dict:
    bad = [s for s in sweeps if s.depth.max() > DEPTH]
    told = _listed(
        f"joint '{s.joint}' at {s.values[s.worst]:.3g}: {_pair(s.pairs[s.worst])}{_after(s)}, free "
        f"{100 * s.free:.0f} % of its range"
        for s in bad
    )
    return check(max(s.depth.max() for s in sweeps), DEPTH, not bad, told)


def _after(way: JointSweep) -> str:
    return f" (with {', '.join(map(repr, way.after))} open)" if way.after else ""


def _driven(motions: list[Motion]) -> dict:
    """The rule for a kind of primitive: the least share of the way, of a motion without
    collision."""
    told = []
    for motion in motions:
        who = _joined(motion)
        if min(motion.reached) < REACH:
            shares = ", ".join(f"{100 * r:.0f} %" for r in motion.reached)
            told.append(f"{who} reached {shares}")
        if motion.depth > DEPTH:
            told.append(f"{who}: {_pair(motion.pair)} run into each other by {motion.depth:.3f}")
        elif not motion.passed and motion.pair:
            told[-1] += f" ({_pair(motion.pair)} touch)"
    reached = min(min(m.reached) for m in motions)
    return check(reached, REACH, all(m.passed for m in motions), _listed(told))


def _drift(calm: dict) -> dict:
    worst = {name: max(r.beyond[name] for r in calm.values()) for name in calm["at rest"].beyond}
    bad = [n for n, b in worst.items() if not b <= BEYOND]
    return check(max(worst.values()), BEYOND, not bad, f"beyond its limits: {_listed(bad)}")


def _joined(motion: Motion) -> str:
    return " then ".join(f"'{n}'" for n in motion.joints)


def _pair(pair: Pair | None) -> str:
    return "nothing" if pair is None else f"'{pair[0]}' and '{pair[1]}'"


def _listed(names: Iterable[str], most: int = 4) -> str:
    found = list(names)
    return "; ".join(found[:most]) + (
        f"; and {len(found) - most} more" if len(found) > most else ""
    )


def _curves(motion: Motion) -> dict:

    def rounded(values: list[float]) -> list[float]:
        return [number(v) for v in values]

    return {
        "joints": list(motion.joints),
        "time": rounded(motion.time),
        "position": [rounded(p) for p in motion.position],
        "force": rounded(motion.force),
    }

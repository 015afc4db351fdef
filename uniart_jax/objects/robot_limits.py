"""The coordinates of a robot's joints: which joint drives which, sane limits, and the state that is
shown."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.robot import MOVING, RawJoint, Robot

DEGREES_FROM = 2 * np.pi * 1.05
UNLIMITED_FROM = 1e6  # radians, metres: files write 1e16 or the largest float for "no limit"


def drivers(robot: Robot) -> dict[str, tuple[str, float]]:
    """Joint -> (joint that drives it, multiplier), through chains of mimics; itself and 1 for all
    others."""
    by_name = {j.name: j for j in reversed(robot.joints)}
    found = {}
    for joint in robot.joints:
        current, rate, visited = joint, 1.0, set()
        while (
            current.mimic
            and current.name not in visited
            and current.mimic[0] in by_name
            and current.mimic[1]
        ):
            visited.add(current.name)
            rate *= current.mimic[1]
            current = by_name[current.mimic[0]]
        found[joint.name] = (joint.name, 1.0) if current.name in visited else (current.name, rate)
    return found


def coordinates(robot: Robot) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
    """(coordinate at the shown state, sane limits) of every moving joint; repairs are noted."""
    by_name = {j.name: j for j in reversed(robot.joints)}
    limits: dict[str, tuple[float, float]] = {}
    for joint in robot.joints:
        if joint.type in MOVING:
            limits[joint.name] = _limits(joint, by_name, robot)
    shown: dict[str, float] = {}
    driven = drivers(robot)

    def show(joint: RawJoint) -> float:
        if joint.name in shown or joint.name not in limits:
            return shown.get(joint.name, 0.0)
        lo, hi = limits[joint.name]
        wanted = 0.0
        if joint.mimic:
            source, multiplier, offset = joint.mimic
            if driven[joint.name][0] == joint.name:
                robot.notes.append(
                    f"joint '{joint.name}': it mimics '{source}', which cannot drive it; read as "
                    "independent"
                )
            else:
                wanted = multiplier * show(by_name[source]) + offset
        shown[joint.name] = float(np.clip(wanted, lo, hi))
        if abs(shown[joint.name] - wanted) > 1e-9:
            robot.notes.append(
                f"joint '{joint.name}': its limits ({lo:.4g}, {hi:.4g}) exclude {wanted:.4g}; "
                f"shown at {shown[joint.name]:.4g}"
            )
        return shown[joint.name]

    for joint in robot.joints:
        show(joint)
    return shown, limits


def _limits(joint: RawJoint, by_name: dict[str, RawJoint], robot: Robot) -> tuple[float, float]:
    if joint.type == "continuous":
        return -np.inf, np.inf
    if joint.limits is None:
        if joint.type == "revolute":
            robot.notes.append(f"joint '{joint.name}': revolute without limits; read as continuous")
        return -np.inf, np.inf
    lo, hi = joint.limits
    if lo > hi:
        robot.notes.append(
            f"joint '{joint.name}': lower limit {lo:.4g} is above upper {hi:.4g}; swapped"
        )
        lo, hi = hi, lo
    if max(abs(lo), abs(hi)) >= UNLIMITED_FROM:
        return _unlimited(joint, lo, hi, robot.notes)
    if (
        joint.type == "revolute"
        and not robot.radians
        and max(abs(lo), abs(hi)) > DEGREES_FROM
        and not _turns_a_screw(joint, by_name)
    ):
        robot.notes.append(
            f"joint '{joint.name}': limits ({lo:.4g}, {hi:.4g}) can only be degrees; converted"
        )
        lo, hi = np.deg2rad(lo), np.deg2rad(hi)
    return lo, hi


def _unlimited(joint: RawJoint, lo: float, hi: float, notes: list[str]) -> tuple[float, float]:
    """Limits of which one or both are so far away that they mean none: infinite there."""
    turns = joint.type == "revolute"
    far = [f"{end:.4g}" for end in (lo, hi) if abs(end) >= UNLIMITED_FROM]
    read = "continuous" if turns else "unlimited" if len(far) == 2 else "unlimited on that side"
    notes.append(
        f"joint '{joint.name}': limits ({lo:.4g}, {hi:.4g}): {', '.join(far)} means none; "
        f"read as {read}"
    )
    if turns:
        return -np.inf, np.inf
    return (
        -np.inf if abs(lo) >= UNLIMITED_FROM else lo,
        np.inf if abs(hi) >= UNLIMITED_FROM else hi,
    )


def _turns_a_screw(joint: RawJoint, by_name: dict[str, RawJoint]) -> bool:
    """Whether a prismatic joint mimics this revolute one, or is mimicked by it: a cap may well turn
    many times."""
    if joint.mimic and joint.mimic[0] in by_name and by_name[joint.mimic[0]].type == "prismatic":
        return True
    return any(
        j.type == "prismatic" and j.mimic and j.mimic[0] == joint.name for j in by_name.values()
    )

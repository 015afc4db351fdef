"""How joints resist: no part falls open or shut, a hand moves every part, and no time step of 2 ms makes one explode."""

from __future__ import annotations

import numpy as np

from uniart_jax.export.mass import Inertial
from uniart_jax.export.physics import GRAVITY, Dynamics
from uniart_jax.objects.kinematics import subtrees
from uniart_jax.objects.object import ArticulatedObject

HOLD = 1.3  # dry friction over the largest gravity load
FLOOR = 0.03  # likewise, over the weight below the joint times its radius of gyration (1 for a joint that travels)
TIME = 0.2  # seconds in which damping stops a part that was pushed
STATES = 64  # drawn within the limits, beside the sweeps of each joint
SWEEP = 11  # states of each joint's own sweep
CLIMB = 2200  # states of all climbs at the most: whole chains of ten joints, less of longer ones
TURN_SPEED = 6.0  # rad / s
TRAVEL_SPEED = 2.0  # m / s
ACCELERATION = 20.0  # effort brings a part to its top speed in 1 / 20 s


def joint_dynamics(
    obj: ArticulatedObject, inertials: list[Inertial]
) -> tuple[Dynamics | None, ...]:
    """Resistance and drive limits of every joint; None for the root and fixed parts.

    Args:
      obj: any object.
      inertials: per part (kg, centre of mass [3] m, tensor about it [3, 3]), object frame at the shown state.

    Gravity's load on a joint, of everything that hangs on it, is the largest found over its own sweep, 64 states drawn within all limits
    and a climb from the worst of them (objects of more than ten joints: over the nearest joints of a chain only, and over none past fifty;
    the load of a long chain's joint is then taken for too small). Dry friction is 1.3 times that load, so a part stays where it is left; a hand at the far edge of a part then needs at most 2.3 times what
    carrying it there takes (a 2 kg lid, 40 cm deep, centre of mass in its middle: 23 N at its rim against 10 N), and for a door on a
    vertical hinge or a drawer on level rails, where there is no load, 3 % of its weight. Damping is inertia / .2 s. Effort is five times
    friction and load together plus what brings the part to its top speed in 1 / 20 s.
    """
    below = [sorted(own) for own in subtrees(obj.parents)]
    largest = _largest_loads(obj, inertials, below)
    found: list[Dynamics | None] = []
    for k, part in enumerate(obj.parts):
        if part.parent < 0 or part.joint.type == "fixed":
            found.append(None)
            continue
        joint, own = part.joint, below[k]
        weight, inertia = sum(inertials[i][0] for i in own), 0.0
        pitch = joint.pitch * (obj.scale if joint.rotates else 1.0)
        for i in own:
            mass, center, tensor = inertials[i]
            if joint.rotates:
                arm = np.cross(joint.direction, center - joint.origin * obj.scale)
                inertia += float(joint.direction @ tensor @ joint.direction + mass * arm @ arm)
            inertia += mass * pitch**2
        radius = (inertia / weight) ** 0.5  # 1 for travel
        friction = max(HOLD * largest[k], FLOOR * GRAVITY * weight * radius)
        velocity = TURN_SPEED if joint.rotates else TRAVEL_SPEED
        effort = 5 * (friction + largest[k]) + inertia * velocity * (ACCELERATION + 1 / TIME)
        found.append(Dynamics(inertia / TIME, float(friction), float(effort), velocity))
    return tuple(found)


def _largest_loads(
    obj: ArticulatedObject, inertials: list[Inertial], below: list[list[int]]
) -> np.ndarray:
    """[K] the largest load of gravity on every joint, N m or N, over the states that are tried."""
    limits = np.array([(0.0, 0.0) if p.parent < 0 else p.joint.limits for p in obj.parts])
    moving = [k for k, (lo, hi) in enumerate(limits) if lo != hi]
    largest = np.zeros(len(obj.parts))
    worst = np.zeros((len(obj.parts), len(obj.parts)))  # the state of each joint's largest load

    def attempt(q: np.ndarray) -> None:
        loads = _loads(obj, inertials, below, q)
        more = loads > largest
        worst[more], largest[more] = q, loads[more]

    def sweep(q: np.ndarray, k: int) -> None:
        for value in np.linspace(limits[k, 0], limits[k, 1], SWEEP):
            attempt(np.where(np.arange(len(q)) == k, value, q))

    attempt(np.zeros(len(obj.parts)))
    for k in moving:
        sweep(np.zeros(len(obj.parts)), k)
    rng = np.random.default_rng(0)
    for _ in range(STATES):
        drawn = rng.random(len(limits))
        drawn = np.where(rng.random(len(limits)) < 1 / 3, np.round(drawn), drawn)  # an end
        attempt(limits[:, 0] + drawn * (limits[:, 1] - limits[:, 0]))
    most = CLIMB // (2 * SWEEP * max(1, len(moving)))
    for k in moving:  # climb from the worst, one coordinate after the other
        chain = [j for j in moving if k in below[j] or j in below[k]]
        chain = sorted(sorted(chain, key=lambda j: abs(j - k))[:most])
        for _ in range(2 if len(chain) > 1 else 0):
            for j in chain:
                sweep(worst[k].copy(), j)
    return largest


def _loads(
    obj: ArticulatedObject, inertials: list[Inertial], below: list[list[int]], q: np.ndarray
) -> np.ndarray:
    """[K] gravity's load on every joint at state ``q``."""
    masses = np.array([m for m, _, _ in inertials])
    centers = np.array([c for _, c, _ in inertials]) / obj.scale
    moved = obj.forward_kinematics(q)
    at = np.einsum("kij,kj->ki", moved[:, :3, :3], centers) + moved[:, :3, 3]
    loads = np.zeros(len(obj.parts))
    for k, part in enumerate(obj.parts):
        joint, own = part.joint, below[k]
        if part.parent < 0 or joint.type == "fixed":
            continue
        above = moved[part.parent]
        axis = above[:3, :3] @ joint.direction
        load = GRAVITY * masses[own].sum() * axis[2] * joint.pitch
        if joint.rotates:
            origin = above[:3, :3] @ joint.origin + above[:3, 3]
            moment = ((at[own] - origin) * masses[own, None]).sum(0)
            load = (load + GRAVITY * (moment[1] * axis[0] - moment[0] * axis[1])) * obj.scale
        loads[k] = abs(load)
    return loads

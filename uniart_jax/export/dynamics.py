"""How joints resist: a hand opens every part whatever it weighs, none falls open or shut, and no
time step of 2 ms makes one explode.

Doors that everybody must be able to open take 22 N at the most (2010 ADA Standards, 404.2.9: 5 lbf
= 22.2 N; docs/simulation.md).
"""

from __future__ import annotations

import dataclasses

import numpy as np

from uniart_jax.export.handles import Handle, handles
from uniart_jax.export.mass import Inertial
from uniart_jax.export.physics import GRAVITY, Dynamics
from uniart_jax.objects.kinematics import subtrees
from uniart_jax.objects.object import ArticulatedObject

LIGHTEST, USUAL, HEAVIEST = (
    5.0,
    12.0,
    22.0,
)  # N at the handle: of any joint, without a load, at the most
SHORT = 0.01  # m: what travels less, as a key or a button, takes so much less than LIGHTEST
HELD = 40.0  # N at the handle, that friction may have where it alone holds a part
HOLD = 1.3  # dry friction over the largest gravity load
STEADY = 1.15  # likewise, over what a spring leaves of it
# likewise, over the weight below the joint times its radius of gyration (1 for a joint that
# travels)
FLOOR = 0.03
TIME = 0.2  # seconds in which damping stops a part that was pushed
DRAG = 25.0  # N s / m at the handle, that damping has at most: 10 N move any part at .4 m / s
STATES = 64  # drawn within the limits, beside the sweeps of each joint
SWEEP = 11  # states of each joint's own sweep
CLIMB = 2200  # states of all climbs at the most: whole chains of ten joints, less of longer ones
SLOPES = 61  # stiffnesses of a spring that are tried
# rad and m: how far off a spring's rest may lie, whose force is nearly the same everywhere. PhysX
# turns no target beyond 2 pi.
FAR_TURN, FAR_TRAVEL = 6.0, 1000.0
TURN_SPEED = 6.0  # rad / s
TRAVEL_SPEED = 2.0  # m / s
ACCELERATION = 20.0  # effort brings a part to its top speed in 1 / 20 s ...
STRONGEST = 150.0  # ... with so many N at the handle at most


def joint_dynamics(
    obj: ArticulatedObject, inertials: list[Inertial]
) -> tuple[Dynamics | None, ...]:
    """Resistance and drive limits of every joint; None for the root and fixed parts.

    Args:
      obj: any object.
      inertials: per part (kg, centre of mass [3] m, tensor about it [3, 3]), object frame at the
        shown state.

    Gravity's load on a joint, of everything that hangs on it, is looked up over its own sweep, 64
    states drawn within all limits and a climb from the worst of them (objects of more than ten
    joints: over the nearest joints of a chain only, and over none past fifty; the load of a long
    chain's joint is then taken for too small).

    Without a load, dry friction is 3 % of the weight, but 5 to 12 N at the handle
    (``export.handles``); of what travels less than 1 cm, as a key, in proportion less. Where 1.3
    times the largest load would still let 22 N at the handle start the joint, friction is that, and
    the part stays where it is left. Else a spring carries what a spring can carry, and friction
    1.15 times what is left, as far as 22 N allow; formats without springs (``Dynamics.unsprung``)
    get friction that holds the part within 40 N at the handle, or, where 1.15 times the load is
    more than that, 22 N and a part that falls (``Dynamics.falls``), but never from rest. Damping is
    inertia / .2 s, at most 25 N s / m at the handle. Effort is five times friction and load
    together plus what brings the part to its top speed in 1 / 20 s, at most 150 N at the handle.
    """
    below = [sorted(own) for own in subtrees(obj.parents)]
    states, loads = _loads_tried(obj, inertials, below)
    largest = np.abs(loads).max(0)
    rest = obj.rest()
    at_rest = _loads(obj, inertials, below, rest)
    found: list[Dynamics | None] = []
    for k, handle in enumerate(handles(obj)):
        if handle is None:
            found.append(None)
            continue
        joint, own = obj.parts[k].joint, below[k]
        weight, inertia = sum(inertials[i][0] for i in own), 0.0
        pitch = joint.pitch * (obj.scale if joint.rotates else 1.0)
        for i in own:
            mass, center, tensor = inertials[i]
            if joint.rotates:
                arm = np.cross(joint.direction, center - joint.origin * obj.scale)
                inertia += float(joint.direction @ tensor @ joint.direction + mass * arm @ arm)
            inertia += mass * pitch**2
        radius = (inertia / weight) ** 0.5  # 1 for travel
        lever = np.hypot(handle.lever, pitch) if joint.rotates else 1.0
        span = float(np.ptp(joint.limits)) * obj.scale
        lightest = LIGHTEST * (1.0 if joint.rotates else min(span / SHORT, 1.0))
        floor = np.clip(FLOOR * GRAVITY * weight * radius, lightest * lever, USUAL * lever)
        velocity = TURN_SPEED if joint.rotates else TRAVEL_SPEED
        unit = 1.0 if joint.rotates else obj.scale
        far = FAR_TURN if joint.rotates else FAR_TRAVEL
        load = _Load(states[:, k] * unit, loads[:, k], rest[k] * unit, at_rest[k], far)
        endless = joint.type == "continuous"
        ends = None if endless else (joint.limits[0] * unit, joint.limits[1] * unit)
        held = _held(load, float(floor), float(lever), handle, ends, lightest)
        push = min(inertia * velocity * (ACCELERATION + 1 / TIME), STRONGEST * lever)
        effort = 5 * (held.alone + largest[k]) + push
        damping = min(inertia / TIME, DRAG * lever**2)
        found.append(
            dataclasses.replace(
                held,
                damping=damping,
                effort=float(effort),
                velocity=velocity,
                lever=float(lever),
                load=float(largest[k]),
                left=load.left(held),
            )
        )
    return tuple(found)


def further_dynamics(
    obj: ArticulatedObject, inertials: list[Inertial]
) -> tuple[tuple[Dynamics, ...], ...]:
    """[K] of the joints in every part's ``outer`` and ``inner``: each as ``joint_dynamics`` makes
    it where it is the part's only one."""
    found: list[tuple[Dynamics, ...]] = []
    for k, part in enumerate(obj.parts):
        own = []
        for joint in (*part.outer, *part.inner):
            parts = list(obj.parts)
            parts[k] = dataclasses.replace(part, joint=joint, outer=(), inner=())
            alone = joint_dynamics(dataclasses.replace(obj, parts=tuple(parts)), inertials)[k]
            assert alone is not None  # it moves
            own.append(alone)
        found.append(tuple(own))
    return tuple(found)


@dataclasses.dataclass(frozen=True)
class _Load:
    """What gravity does to a joint: ``forces`` [n] (N m or N) push coordinates ``states`` [n] (rad
    or m) down, ``at_rest`` at ``rest``. ``far``: of ``FAR_*``."""

    states: np.ndarray
    forces: np.ndarray
    rest: float
    at_rest: float
    far: float

    def left(self, held: Dynamics) -> float:
        """The most that a joint's spring leaves of it in any state."""
        spring = held.stiffness * (self.states - held.reference)
        return float(np.abs(self.forces + spring).max())


def _held(
    load: _Load,
    floor: float,
    lever: float,
    handle: Handle,
    ends: tuple[float, float] | None,
    lightest: float,
) -> Dynamics:
    """Friction, spring and the force that starts the joint; damping, effort and velocity are still
    to be set.

    ``ends``: None of a joint that turns for ever, which gets no spring. ``lightest``: N at the
    handle that it takes at least.
    """
    largest = float(np.abs(load.forces).max())
    lift = handle.opens * load.at_rest  # what a hand has to lift when it starts; < 0: gravity helps
    hold = max(floor, HOLD * largest, lightest * lever - lift)
    if hold + lift <= HEAVIEST * lever:
        return Dynamics(0.0, hold, 0.0, 0.0, start=(hold + lift) / lever)
    if STEADY * largest <= HELD * lever < hold:  # that holds it too
        hold = HELD * lever
    falls = hold > HELD * lever
    if ends is None:
        friction = max(floor, HEAVIEST * lever - lift) if falls else hold
        return Dynamics(0.0, friction, 0.0, 0.0, start=(friction + lift) / lever, falls=falls)
    for balanced in (False, True):
        stiffness, reference = _spring(load, ends, balanced)
        left = load.forces + stiffness * (load.states - reference)
        at_rest = handle.opens * (load.at_rest + stiffness * (load.rest - reference))
        wanted = max(floor, STEADY * float(np.abs(left).max()))
        # ``at_rest`` < 0: the spring would open it by itself, if friction did not hold
        least, most = (newtons * lever - at_rest for newtons in (lightest, HEAVIEST))
        friction = max(min(max(wanted, least), most), -STEADY * at_rest)
        if friction <= HEAVIEST * lever:
            break
    unsprung = max(friction, min(hold, HEAVIEST * lever)) if falls else hold
    lower, upper = ends
    room = load.rest > lower + 1e-6 if load.at_rest > 0 else load.rest < upper - 1e-6
    if room:  # it must at least stay at rest
        unsprung = max(unsprung, STEADY * abs(load.at_rest))
    start = (friction + at_rest) / lever
    return Dynamics(0.0, friction, 0.0, 0.0, stiffness, reference, unsprung, max(start, 0.0), falls)


def _spring(load: _Load, ends: tuple[float, float], balanced: bool) -> tuple[float, float]:
    """(stiffness, reference) of the spring that leaves the least of a load, at its worst;
    ``balanced``: and nothing of it at rest."""
    span = max(ends[1] - ends[0], 1e-6)
    spread = float(np.ptp(load.forces))
    best, chosen = np.inf, (0.0, 0.0)
    for stiffness in np.linspace(0, 2 * spread / span, SLOPES):
        for _ in range(2):  # a spring without stiffness has no force: its rest lies far off
            rest = load.forces + stiffness * load.states
            middle = float(rest.min() + rest.max()) / 2
            if balanced:
                middle = float(load.at_rest + stiffness * load.rest)
            stiffness = max(float(stiffness), abs(middle) / load.far)
        worst = float(np.abs(rest - middle).max())
        if worst < best - 1e-12 and stiffness > 0:
            best, chosen = worst, (stiffness, middle / stiffness)
    return chosen


def _loads_tried(
    obj: ArticulatedObject, inertials: list[Inertial], below: list[list[int]]
) -> tuple[np.ndarray, np.ndarray]:
    """([n, K] states that are tried, [n, K] gravity's load on every joint there, N m or N, which
    pushes its coordinate down)."""
    limits = np.array([(0.0, 0.0) if p.parent < 0 else p.joint.limits for p in obj.parts])
    moving = [k for k, (lo, hi) in enumerate(limits) if lo != hi]
    states: list[np.ndarray] = []
    found: list[np.ndarray] = []
    largest = np.zeros(len(obj.parts))
    worst = np.zeros((len(obj.parts), len(obj.parts)))  # the state of each joint's largest load

    def attempt(q: np.ndarray) -> None:
        loads = _loads(obj, inertials, below, q)
        states.append(q.copy())
        found.append(loads)
        more = np.abs(loads) > largest
        worst[more], largest[more] = q, np.abs(loads)[more]

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
    return np.array(states), np.array(found)


def _loads(
    obj: ArticulatedObject, inertials: list[Inertial], below: list[list[int]], q: np.ndarray
) -> np.ndarray:
    """[K] gravity's load on every joint at state ``q``: how much its energy grows with the
    coordinate."""
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
        loads[k] = load
    return loads

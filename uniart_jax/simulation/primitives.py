"""Scripted primitives: a hand that holds a part opens it, by force.

An impedance controller (Hogan 1985): F = K (x* - x) + D (x*' - x'), at most ``limit`` newtons,
where x is a point of the part, its handle if it has one, and x* goes along that point's own path
over the joint's range. Nothing is teleported and no joint is driven. Three of them, as the paper
(section 4.4, robot experiments): hinge opening, slider pulling, and flip-and-rotate, where a second
hand moves a second joint while the first holds on.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from uniart_jax.export.physics import GRAVITY
from uniart_jax.simulation.engine import Engine, Pair, PlannedJoint
from uniart_jax.simulation.stand import Rest, watch
from uniart_jax.simulation.sweep import DEPTH, deepest

REACH = 0.7  # of the way from rest to the goal: the paper's rule
SECONDS = 1.5  # from rest to the goal, simulated; for each half turn, where it turns farther
HOLD = 0.5  # at the goal
LET_GO = 0.5  # afterwards, watched
FORCE = 50.0  # N, beside twice the moved weight: what one hand does without effort
LAG = 0.05  # of the path's length, at which the hand pushes with all its force
STIFFEST = 200.0  # rad / s, of the part on the hand's spring: what an explicit time step bears
STIFFEST_RUBBED = 500.0  # the same where dry friction would leave a light part, a knob, far behind
SLOWEST = 0.05  # s, of the hand's spring against a joint's own damping
VISITS = 30  # states of the way that are looked at for collisions
SAMPLES = 129  # of the path
CURVE = 60  # samples of the curves


@dataclasses.dataclass(frozen=True)
class Motion:
    """What one primitive did.

    Attributes:
      joints: the commanded ones, in their order.
      reached: [J] share of the way from rest to the goal.
      depth: largest depth at the visited states beyond that at rest, of the object's size.
      pair: the two links; None if nothing touches.
      speed: the largest, m / s.
      after: what happened once the hands had let go.
      time, position, force: [n] curves: seconds; [J][n] shares of the way; newtons, of the hand
        that moves.
    """

    joints: tuple[str, ...]
    reached: tuple[float, ...]
    depth: float
    pair: Pair | None
    speed: float
    after: Rest
    time: list[float]
    position: list[list[float]]
    force: list[float]

    @property
    def passed(self) -> bool:
        return min(self.reached) >= REACH and self.depth <= DEPTH


@dataclasses.dataclass
class _Hand:
    """A spring-damper between a point of a part and its path."""

    joint: PlannedJoint
    local: np.ndarray
    path: np.ndarray  # [SAMPLES, 3]
    stiffness: float
    damping: float
    limit: float

    def force(self, engine: Engine, share: float, rate: float) -> np.ndarray:
        """[3] at ``share`` of the path, which grows by ``rate`` a second."""
        at, velocity = engine.point(self.joint.hand, self.local)
        where = share * (SAMPLES - 1)
        i = min(int(where), SAMPLES - 2)
        step = self.path[i + 1] - self.path[i]
        wanted = self.path[i] + (where - i) * step
        force = self.stiffness * (wanted - at)
        force += self.damping * (step * (SAMPLES - 1) * rate - velocity)
        norm = float(np.linalg.norm(force))
        force *= min(1.0, self.limit / norm) if norm > 0 else 1.0
        engine.push(self.joint.hand, at, force)
        return force


def _hand(engine: Engine, joint: PlannedJoint, local: np.ndarray) -> _Hand:
    now = engine.coordinates()[joint.name]
    path = engine.path(joint.name, np.linspace(now, joint.goal, SAMPLES), joint.hand, local)
    length = max(float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()), 1e-6)
    # the mass that the hand feels along the path
    gear = ((joint.goal - now) / length) ** 2
    mass = engine.inertia(joint.name) * gear + 1e-6
    damped = engine.damping(joint.name) * gear / SLOWEST
    rubbed = engine.friction(joint.name) * float(np.sqrt(gear)) / (LAG * length)
    held = max(mass * STIFFEST**2, damped, min(rubbed, mass * STIFFEST_RUBBED**2))
    weight = sum(i.mass for i in engine.inertias() if i.link in joint.moved) * GRAVITY
    limit = FORCE + 2 * weight
    stiffness = min(limit / (LAG * length), held)
    return _Hand(joint, local, path, stiffness, 2 * float(np.sqrt(stiffness * mass)), limit)


def drive(engine: Engine, joints: Sequence[PlannedJoint], at_rest: Mapping[Pair, float]) -> Motion:
    """Open ``joints`` one after the other from the rest state; earlier ones are held open. Then let
    go.

    Args:
      at_rest: ``engine.depths`` at the rest state.
    """
    engine.reset({})
    locals_ = [engine.local(j.hand, j.point) for j in joints]
    hands: list[_Hand] = []
    seconds = [_seconds(joint) for joint in joints]
    hold = round(HOLD / engine.timestep)
    steps = round(sum(seconds) / engine.timestep) + hold * len(joints)
    every, looks = max(1, steps // CURVE), max(1, steps // VISITS)
    times, forces = [], []
    positions: list[list[float]] = [[] for _ in joints]
    visited: list[dict[str, float]] = []
    speed, count = 0.0, 0
    for joint, local, duration in zip(joints, locals_, seconds, strict=True):
        hands.append(_hand(engine, joint, local))
        ramp = round(duration / engine.timestep)
        for step in range(ramp + hold):
            share, rate = _ramp(step / ramp)
            for held in hands[:-1]:
                held.force(engine, 1.0, 0.0)
            force = hands[-1].force(engine, share, rate / duration)
            engine.step()
            count += 1
            if count % every == 0:
                q = engine.coordinates()
                times.append(count * engine.timestep)
                forces.append(float(np.linalg.norm(force)))
                speed = max(speed, engine.speed())
                for curve, j in zip(positions, joints, strict=True):
                    curve.append((q[j.name] - j.rest) / (j.goal - j.rest))
            if count % looks == 0:
                visited.append(engine.coordinates())
    last = engine.coordinates()
    reached = tuple((last[j.name] - j.rest) / (j.goal - j.rest) for j in joints)
    names = tuple(j.name for j in joints)
    after = watch(engine, LET_GO)
    if not np.isfinite([*reached, *forces]).all():
        return Motion(names, (0.0,) * len(names), 0.0, None, np.inf, after, [], [], [])
    depth, pair = max((deepest(engine, q, at_rest) for q in visited), key=lambda d: d[0])
    return Motion(names, reached, depth, pair, speed, after, times, positions, forces)


def _seconds(joint: PlannedJoint) -> float:
    angle = 0.0 if joint.kind == "prismatic" else abs(joint.goal - joint.rest)
    return SECONDS * max(1.0, angle / np.pi)


def _ramp(time: float) -> tuple[float, float]:
    """(share of the way, its rate) of a move without jerk at both ends; ``time`` 1 is its end."""
    t = min(time, 1.0)
    return t**3 * (10 - 15 * t + 6 * t**2), 30 * t**2 * (1 - t) ** 2


def compound(
    joints: Sequence[PlannedJoint],
    after: Mapping[str, Sequence[str]],
    together: Callable[[PlannedJoint, PlannedJoint], bool],
) -> tuple[PlannedJoint, PlannedJoint] | None:
    """The two joints of flip-and-rotate: one that carries the other if there is such a chain, else
    the first two, hinges first; None if there are not two.

    Args:
      after: joint -> those that must be open before it.
      together: whether the second has its way with the first open. Where no joint carries another,
        two doors may share a room that only one can open into: the first pair that can be open
        together is taken, or the first of all where none can.
    """
    turning_first = sorted(joints, key=lambda j: j.kind == "prismatic")
    pairs = [(a, b) for a in turning_first for b in turning_first if a is not b]
    able = [(a, b) for a, b in pairs if not after[a.name] and set(after[b.name]) <= {a.name}]
    chains = [(a, b) for a, b in able if b.part in a.moved]
    first = next(iter([*chains, *able]), None)
    return first if chains else next((pair for pair in able if together(*pair)), first)

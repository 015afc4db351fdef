"""An asset left alone: under gravity from its rest state, and after a joint was opened and let
go."""

from __future__ import annotations

import dataclasses

import numpy as np

from uniart_jax.export.physics import GRAVITY
from uniart_jax.simulation.engine import Engine, Plan

SECONDS = 2.0  # simulated
MOVED = 0.05  # of its range, that a joint may move by itself
BEYOND = 0.02  # of its range, that a joint may be outside its limits
# of the energy of the moving parts falling through the object's size, that may appear from nowhere
GROWTH = 0.02
LOOKS = 100


@dataclasses.dataclass(frozen=True)
class Rest:
    """What happened while nothing was done.

    Attributes:
      moved: joint -> farthest from where it began, of its range.
      beyond: joint -> farthest outside its limits, of its range, in the second half of the time:
        soft limits give way when something falls on them.
      speed: the largest of any link, m / s.
      growth: energy gained, of that of the moving parts falling through the object's size.
    """

    moved: dict[str, float]
    beyond: dict[str, float]
    speed: float
    growth: float


def leave_alone(engine: Engine, q: dict[str, float]) -> Rest:
    """Two seconds from state ``q``, joints free."""
    engine.reset(q)
    return watch(engine, SECONDS)


def watch(engine: Engine, seconds: float) -> Rest:
    """What happens from now on while nothing is pushed."""
    plan, first = engine.plan, engine.coordinates()
    moved = dict.fromkeys(first, 0.0)
    beyond, speed, energy = dict(moved), 0.0, engine.energy()
    gained, steps = 0.0, round(seconds / engine.timestep)
    for step in range(1, steps + 1):
        engine.step()
        if step % max(1, steps // LOOKS) and step < steps:
            continue
        now = engine.coordinates()
        speed = max(speed, engine.speed())
        gained = max(gained, engine.energy() - energy)
        if not np.isfinite([*now.values(), speed, gained]).all():
            broken = dict.fromkeys(first, float("inf"))
            return Rest(broken, broken, float("inf"), float("inf"))
        for joint in plan.joints:
            at, endless = now[joint.name], joint.kind == "continuous"
            moved[joint.name] = max(moved[joint.name], abs(at - first[joint.name]) / joint.span)
            out = 0.0 if endless else max(joint.lo - at, at - joint.hi, 0.0) / joint.span
            if 2 * step > steps:
                beyond[joint.name] = max(beyond[joint.name], out)
    mass = sum(i.mass for i in engine.inertias())
    return Rest(moved, beyond, speed, gained / max(mass * GRAVITY * plan.size, 1e-9))


def speed_limit(plan: Plan) -> float:
    """m / s: three times what a fall through twice the object's size gives; faster is an
    explosion."""
    return 3 * float(np.sqrt(2 * GRAVITY * 2 * plan.size))

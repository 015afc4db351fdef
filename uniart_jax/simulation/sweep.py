"""Every joint over its range by hand, and how deep parts run into each other on the way.

The depth that counts at a state is that of a pair of links beyond what the same pair has at rest:
hinges overlap by design. Filters are off, parent and child included: what a simulator would not
even notice is still a door in its frame.

A rack behind a door and a seat under a lid move only once the other is out of the way. So a joint
whose way is barred by a part that another joint moves is swept again with that one open, and keeps
the better of the two ways.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from uniart_jax.simulation.engine import Engine, Pair, PlannedJoint

STEPS = 10  # of a joint's range
FIRST = 3  # joints that may have to be open before another
DEPTH = 0.01  # limit, of the object's size
TOUCH = 0.001  # of the object's size: less is no contact


@dataclasses.dataclass(frozen=True)
class JointSweep:
    """One joint's way.

    Attributes:
      joint: its name.
      values: [n] coordinates, ascending, rest among them.
      depth: [n] largest depth beyond that at rest, of the object's size.
      pairs: [n] the two links; None where nothing touches.
      free: share of the range around rest that can be used.
      after: joints that must be open first.
    """

    joint: str
    values: np.ndarray
    depth: np.ndarray
    pairs: list[Pair | None]
    free: float
    after: tuple[str, ...] = ()

    @property
    def worst(self) -> int:
        return int(np.argmax(self.depth))


def sweep(engine: Engine, joint: PlannedJoint, at_rest: Mapping[Pair, float]) -> JointSweep:
    """Set ``joint`` to every tenth of its range, the others at rest, or open where they bar its
    way.

    Args:
      at_rest: ``engine.depths`` at the rest state.
    """
    best = _way(engine, joint, at_rest, ())
    way = best
    while way.depth.max() > DEPTH and len(way.after) < FIRST:
        bar = _barring(engine, joint, way)
        if bar is None:
            break
        way = _way(engine, joint, at_rest, (*way.after, bar))
        if way.depth.max() < best.depth.max():
            best = way
    return best


def _way(
    engine: Engine, joint: PlannedJoint, at_rest: Mapping[Pair, float], after: tuple[str, ...]
) -> JointSweep:
    values = np.linspace(joint.lo, joint.hi, STEPS + 1)
    near = int(np.argmin(np.abs(values - joint.rest)))
    if abs(values[near] - joint.rest) > 1e-9 * joint.span:
        values = np.sort(np.append(values, joint.rest))
        near = int(np.searchsorted(values, joint.rest))
    opened = {j.name: j.goal for j in engine.plan.joints if j.name in after}
    found = [deepest(engine, opened | {joint.name: float(v)}, at_rest) for v in values]
    depth = np.array([d for d, _ in found])
    good = depth <= DEPTH
    lo = hi = near
    while lo > 0 and good[lo - 1]:
        lo -= 1
    while hi < len(values) - 1 and good[hi + 1]:
        hi += 1
    free = float(values[hi] - values[lo]) / joint.span if good[near] else 0.0
    return JointSweep(joint.name, values, depth, [pair for _, pair in found], free, after)


def opens_beside(
    engine: Engine, first: PlannedJoint, second: PlannedJoint, at_rest: Mapping[Pair, float]
) -> bool:
    """Whether ``second`` goes all its way from rest to its goal while ``first`` is open, and
    brushes against nothing: shapes that touch push back."""
    way = np.linspace(second.rest, second.goal, 4 * STEPS + 1)
    states = ({first.name: first.goal, second.name: float(v)} for v in way)
    return all(deepest(engine, q, at_rest)[0] <= TOUCH for q in states)


def _barring(engine: Engine, joint: PlannedJoint, way: JointSweep) -> str | None:
    """The joint that moves one of the two links that run into each other, but not with ``joint``;
    None if there is none left."""
    pair = way.pairs[way.worst] or ()
    for other in engine.plan.joints:
        apart = joint.part not in other.moved and other.part not in joint.moved
        if apart and other.name not in way.after and any(link in other.moved for link in pair):
            return other.name
    return None


def deepest(
    engine: Engine, q: Mapping[str, float], at_rest: Mapping[Pair, float]
) -> tuple[float, Pair | None]:
    """(largest depth of any pair at a state beyond its depth at rest, of the object's size; that
    pair)."""
    worst: tuple[float, Pair | None] = (0.0, None)
    for pair, depth in engine.depths(q).items():
        more = (depth - at_rest.get(pair, 0.0)) / engine.plan.size
        if more > worst[0]:
            worst = (more, pair)
    return worst

"""What the checks ask of a physics engine, and what they know of an asset before one has loaded it.

Metres, kilograms, seconds, radians. Links and joints go by their names in the description; a
joint's coordinate is the description's own.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Protocol

import numpy as np

Pair = tuple[str, str]  # names of two links, sorted
TIMESTEP = 0.001  # s; small parts on a hand's spring need it


@dataclasses.dataclass(frozen=True)
class PlannedJoint:
    """A joint that has a coordinate of its own.

    Attributes:
      name: in the description.
      kind: revolute, continuous, prismatic or screw (one that others follow so that the part also
        travels).
      part: the link that people see move.
      lo, hi: the range that is swept; one whole turn from rest if it is continuous.
      rest: coordinate at the rest state.
      goal: the coordinate that a primitive is asked to reach: the end farther from rest, a quarter
        turn if it is continuous.
      moved: every link that it moves.
      hand: the link that the hand holds.
      point: [3] where, world frame at the rest state.
    """

    name: str
    kind: str
    part: str
    lo: float
    hi: float
    rest: float
    goal: float
    moved: tuple[str, ...]
    hand: str
    point: tuple[float, ...]

    @property
    def span(self) -> float:
        return self.hi - self.lo


@dataclasses.dataclass(frozen=True)
class Follower:
    """A joint whose coordinate is ``rate * (the driver's) + offset``."""

    name: str
    driver: str
    rate: float
    offset: float


@dataclasses.dataclass(frozen=True)
class Plan:
    """What is to be done with an asset, the same for every engine.

    Attributes:
      size: longest side of the object's box at rest, metres.
      joints: those that are swept and driven.
      idle: coordinates at rest of joints with a coordinate that move nothing or have no range.
      followers: in an order in which each one's driver is known.
      rigid: link -> number of the rigid body that it belongs to (links joined by fixed joints share
        one).
    """

    size: float
    joints: tuple[PlannedJoint, ...]
    idle: dict[str, float]
    followers: tuple[Follower, ...]
    rigid: dict[str, int]

    def rest(self) -> dict[str, float]:
        return {j.name: j.rest for j in self.joints}

    def state(self, q: Mapping[str, float]) -> dict[str, float]:
        """The coordinates of all joints at a state of the planned ones; those not given are at
        rest."""
        full = self.idle | self.rest() | dict(q)
        for follower in self.followers:
            full[follower.name] = follower.rate * full.get(follower.driver, 0.0) + follower.offset
        return full

    def rates(self, joint: str) -> dict[str, float]:
        """d(coordinate) / d(coordinate of ``joint``) of that joint and its followers."""
        rates = {f.name: f.rate for f in self.followers if f.driver == joint}
        return {joint: 1.0} | rates

    def rigid_pair(self, a: str, b: str) -> bool:
        """Whether two links never move against each other."""
        return a == b or (a in self.rigid and self.rigid[a] == self.rigid.get(b))


def make_plan(data: dict) -> Plan:
    """The plan that ``dataclasses.asdict`` turned into JSON values."""
    joints = [
        PlannedJoint(**{**j, "moved": tuple(j["moved"]), "point": tuple(j["point"])})
        for j in data["joints"]
    ]
    followers = tuple(Follower(**f) for f in data["followers"])
    return Plan(data["size"], tuple(joints), data["idle"], followers, data["rigid"])


@dataclasses.dataclass(frozen=True)
class LinkInertia:
    """What an engine takes a link to weigh.

    Attributes:
      link: its name.
      mass: kg.
      moments: [3] principal moments of inertia about the centre of mass, kg m^2.
    """

    link: str
    mass: float
    moments: np.ndarray


def cross(first: Iterable[float], second: Iterable[float]) -> tuple[float, float, float]:
    """``np.cross`` of two vectors [3], which takes twenty times as long: a hand asks at every
    step."""
    (a, b, c), (x, y, z) = map(float, first), map(float, second)
    return b * z - c * y, c * x - a * z, a * y - b * x


class Engine(Protocol):
    """One asset in one engine, its root held where it is, gravity along -z.

    Every state is a state of the plan's joints; the engine's own others stay at rest or follow.
    What is simulated and what is only posed are apart: ``depths`` and ``path`` leave the simulation
    as it is.
    """

    plan: Plan
    timestep: float
    damping_share: dict[str, float]  # joint -> its damping, of what the engine bears by itself

    def inertias(self) -> list[LinkInertia]:
        """Of the links that a joint moves."""
        ...

    def depths(self, q: Mapping[str, float]) -> dict[Pair, float]:
        """How deep collision shapes of two links that are not rigidly joined dig into each other at
        a state, whatever the file's collision filters say."""
        ...

    def reset(self, q: Mapping[str, float]) -> None:
        """Put the simulation into a state, standing still, nothing pushed."""
        ...

    def step(self) -> None:
        """One time step; what was pushed is forgotten."""
        ...

    def push(self, link: str, point: np.ndarray, force: np.ndarray) -> None:
        """Apply a force [3] at a world point [3] of a link during the next step."""
        ...

    def local(self, link: str, point: Sequence[float]) -> np.ndarray:
        """[3] a world point in the link's frame as the simulation has it now."""
        ...

    def point(self, link: str, local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """World position [3] and velocity [3] of a point of a link."""
        ...

    def path(self, joint: str, values: np.ndarray, link: str, local: np.ndarray) -> np.ndarray:
        """[n, 3] where a link's point lies when one joint has these coordinates and the others stay
        as they are."""
        ...

    def inertia(self, joint: str) -> float:
        """Generalised inertia of a joint with its followers, in the present state: kg, or kg m^2 if
        the coordinate is an angle."""
        ...

    def damping(self, joint: str) -> float:
        """Generalised viscous damping of a joint with its followers: N s / m, or N m s."""
        ...

    def friction(self, joint: str) -> float:
        """Generalised dry friction of a joint with its followers: N, or N m."""
        ...

    def coordinates(self) -> dict[str, float]: ...

    def speed(self) -> float:
        """The largest speed of any link's centre of mass, m / s; infinite if the simulation broke
        down."""
        ...

    def energy(self) -> float:
        """Kinetic and potential energy, J."""
        ...

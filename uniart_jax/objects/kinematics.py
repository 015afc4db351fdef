"""Joints as screws, and forward kinematics over a tree of parts.

A joint moves its child part, and all below it, along a screw about a line: it rotates by an angle
and travels along the axis, both driven by one coordinate ``q`` that is 0 in the shown state (see
docs/representation.md, "Joints"). ``fixed``, ``revolute``, ``continuous``, ``prismatic`` and
``screw`` are read off the two spans; nothing stores or classifies them (the paper's open-set
joints).

Units: radians, object units. Frame: the object frame at the shown state.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

LEAST_ANGLE = float(np.deg2rad(0.1))  # what turns by less does not turn
LEAST_TRAVEL = 1e-4  # likewise, metres
ANGLE_DEAD_ZONE = float(np.deg2rad(1.0))  # what codes tell apart from nothing: ``codable``
TRAVEL_DEAD_ZONE = 0.005  # likewise, of the object's longest side
JOINT_TYPES = ("fixed", "revolute", "continuous", "prismatic", "screw")


@dataclasses.dataclass(frozen=True)
class Joint:
    """A screw about a line.

    Attributes:
      origin: [3] a point of the axis, object frame at the shown state.
      direction: [3] axis direction; normalised when the joint is made.
      angle: (a0, a1) rotation at the lower and upper end of q, radians.
      travel: (t0, t1) travel along ``direction`` at the same two ends, object units; proportional
        to ``angle`` if both are non-zero.
      dead_zone: travel below which there is none, object units; it scales with the object.

    Spans below .1 degree and ``dead_zone`` become 0. A rotation span of 2 pi or more without
    travel is continuous and stored as (-pi, pi). A joint without any span is fixed and stored with
    origin 0 and direction z.

    Raises:
      ValueError: zero or non-finite axis, limits that do not bracket 0, spans that are not
        proportional.
    """

    origin: np.ndarray
    direction: np.ndarray
    angle: tuple[float, float] = (0.0, 0.0)
    travel: tuple[float, float] = (0.0, 0.0)
    dead_zone: float = LEAST_TRAVEL

    def __post_init__(self):
        origin = np.array(self.origin, dtype=np.float64).reshape(3)
        direction = np.array(self.direction, dtype=np.float64).reshape(3)
        a0, a1 = (float(a) for a in self.angle)
        t0, t1 = (float(t) for t in self.travel)
        if not np.all(np.isfinite([*origin, *direction, a0, a1, t0, t1])):
            raise ValueError("joint: origin, direction and limits must be finite numbers")
        if abs(a1 - a0) < LEAST_ANGLE * (1 - 1e-9):
            a0 = a1 = 0.0
        if abs(t1 - t0) < self.dead_zone * (1 - 1e-9):
            t0 = t1 = 0.0
        rotates, travels = a0 != a1, t0 != t1
        if not rotates and t0 > t1:  # a left-handed screw whose rotation fell into the dead zone
            t0, t1 = t1, t0
        if not rotates and not travels:
            origin, direction = np.zeros(3), np.array([0.0, 0.0, 1.0])
        lo, hi = (a0, a1) if rotates else (t0, t1)
        if not lo <= 1e-9 or not hi >= -1e-9:
            raise ValueError(
                f"joint: limits must bracket the shown state 0, got ({lo:.6g}, {hi:.6g})"
            )
        if rotates and travels and abs(a0 * t1 - a1 * t0) > 1e-6 * max(1.0, abs(a1 - a0)):
            raise ValueError(f"joint: angle {a0, a1} and travel {t0, t1} are not proportional")
        if rotates and not travels and a1 - a0 >= 2 * np.pi - 1e-9:
            a0, a1 = -np.pi, np.pi
        norm = float(np.linalg.norm(direction))
        if norm < 1e-9:
            raise ValueError("joint: the axis direction is zero")
        if abs(norm - 1) > 1e-12:  # keep unit vectors bit for bit
            direction = direction / norm
        origin.setflags(write=False)
        direction.setflags(write=False)
        object.__setattr__(self, "origin", origin)
        object.__setattr__(self, "direction", direction)
        object.__setattr__(self, "angle", (a0, a1))
        object.__setattr__(self, "travel", (t0, t1))

    @classmethod
    def fixed(cls) -> Joint:
        """The joint that does not move."""
        return cls(np.zeros(3), np.array([0.0, 0.0, 1.0]))

    @property
    def rotates(self) -> bool:
        return self.angle[0] != self.angle[1]

    @property
    def travels(self) -> bool:
        return self.travel[0] != self.travel[1]

    @property
    def type(self) -> str:
        """'fixed', 'revolute', 'continuous', 'prismatic' or 'screw', read off the spans."""
        if self.rotates:
            if self.travels:
                return "screw"
            return "continuous" if self.angle[1] - self.angle[0] >= 2 * np.pi - 1e-6 else "revolute"
        return "prismatic" if self.travels else "fixed"

    @property
    def limits(self) -> tuple[float, float]:
        """(lo, hi) of the coordinate q: radians if the joint rotates, else object units."""
        return self.angle if self.rotates else self.travel

    @property
    def pitch(self) -> float:
        """Travel per unit of q: object units per radian for screws, 1 for prismatic, 0
        otherwise."""
        if self.rotates:
            return (self.travel[1] - self.travel[0]) / (self.angle[1] - self.angle[0])
        return 1.0 if self.travels else 0.0

    def motion(self, q: float) -> np.ndarray:
        """[4, 4] transform of the child at coordinate ``q``, object frame of the shown state."""
        matrix = np.eye(4)
        if self.rotates:
            matrix[:3, :3] = rotation(self.direction, q)
            matrix[:3, 3] = self.origin - matrix[:3, :3] @ self.origin
        matrix[:3, 3] += self.direction * (self.pitch * q)
        return matrix

    def transformed(self, matrix: np.ndarray) -> Joint:
        """The same joint after the object is moved by ``matrix`` [4, 4]: any similarity, mirrors
        included."""
        linear = np.asarray(matrix, dtype=np.float64)[:3, :3]
        det = float(np.linalg.det(linear))
        scale = abs(det) ** (1 / 3)
        direction = linear @ self.direction / scale
        origin = linear @ self.origin + np.asarray(matrix)[:3, 3]
        travel = (self.travel[0] * scale, self.travel[1] * scale)
        if det < 0 and self.rotates:  # a mirror turns a rotation about d into one about -Md
            direction, travel = -direction, (-travel[0], -travel[1])
        return Joint(origin, direction, self.angle, travel, self.dead_zone * scale)

    def reversed(self) -> Joint:
        """The same motions with the coordinate's sign turned: about the opposite direction."""
        angle, travel = ((-ends[1] + 0.0, -ends[0] + 0.0) for ends in (self.angle, self.travel))
        return Joint(self.origin, -self.direction, angle, travel, self.dead_zone)

    def shown_at(self, q: float) -> Joint:
        """The same joint with its coordinate measured from ``q`` (its own axis is not moved by its
        own motion)."""
        lo, hi = self.limits
        if not lo - 1e-9 <= q <= hi + 1e-9:
            raise ValueError(f"joint: q = {q:.6g} is outside the limits ({lo:.6g}, {hi:.6g})")
        if self.type in ("fixed", "continuous"):
            return self
        q = min(max(q, lo), hi)
        a = q if self.rotates else 0.0
        t = q * self.pitch
        angle = (self.angle[0] - a, self.angle[1] - a) if self.rotates else (0.0, 0.0)
        travel = (self.travel[0] - t, self.travel[1] - t) if self.travels else (0.0, 0.0)
        return Joint(self.origin, self.direction, angle, travel, self.dead_zone)


def codable(joint: Joint) -> Joint:
    """A normalised object's joint as codes can tell it: no rotation below 1 degree, and no travel
    below .005."""
    angle, travel = joint.angle, joint.travel
    if angle[1] - angle[0] < ANGLE_DEAD_ZONE * (1 - 1e-9):
        angle = (0.0, 0.0)
    return Joint(joint.origin, joint.direction, angle, travel, TRAVEL_DEAD_ZONE)


def rotation(direction: np.ndarray, angle: float) -> np.ndarray:
    """[3, 3] rotation by ``angle`` radians about the unit vector ``direction`` (Rodrigues'
    formula)."""
    x, y, z = direction
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross)


def topological_order(parents: Sequence[int]) -> list[int]:
    """Indices of a tree's nodes, parents first, roots (-1) before all; stable.

    Raises:
      ValueError: no root, several roots, a parent that does not exist, or a cycle.
    """
    count = len(parents)
    roots = [i for i, p in enumerate(parents) if p == -1]
    if len(roots) != 1:
        raise ValueError(f"kinematic tree: expected one root, found {len(roots)}")
    if any(not -1 <= p < count for p in parents):
        raise ValueError("kinematic tree: a parent index is out of range")
    children: list[list[int]] = [[] for _ in range(count)]
    for i, p in enumerate(parents):
        if p >= 0:
            children[p].append(i)
    order, frontier = [], roots
    while frontier:
        order.extend(frontier)
        frontier = [c for node in frontier for c in children[node]]
    if len(order) != count:
        raise ValueError("kinematic tree: it holds a cycle")
    return order


def subtrees(parents: Sequence[int]) -> list[set[int]]:
    """[K] each node and all that hang on it; parents in any order, -1 for a root's."""
    below = [{k} for k in range(len(parents))]
    for k, up in enumerate(parents):
        while up >= 0:
            below[up].add(k)
            up = parents[up]
    return below


def forward_kinematics(
    parents: Sequence[int], joints: Sequence[Joint], q: np.ndarray
) -> np.ndarray:
    """Where every part stands at joint state ``q``.

    Args:
      parents: [K] parent index of each part, -1 for the root; any order.
      joints: [K] joint of each part to its parent; the root's is ignored.
      q: [K] coordinates; those of the root and of fixed joints are ignored.

    Returns:
      [K, 4, 4] transforms that carry each part from the shown state to state ``q``, object frame.
    """
    q = np.asarray(q, dtype=np.float64)
    if q.shape != (len(parents),):
        raise ValueError(
            f"forward kinematics: expected q of shape ({len(parents)},), got {q.shape}"
        )
    transforms = np.tile(np.eye(4), (len(parents), 1, 1))
    for k in topological_order(parents):
        if parents[k] >= 0:
            transforms[k] = transforms[parents[k]] @ joints[k].motion(q[k])
    return transforms


def line_distance(a: Joint, b: Joint) -> float:
    """Shortest distance between two joint axes as infinite lines, object units."""
    cross = np.cross(a.direction, b.direction)
    between = b.origin - a.origin
    norm = np.linalg.norm(cross)
    if norm < 1e-6:  # parallel
        return float(np.linalg.norm(between - (between @ a.direction) * a.direction))
    return float(abs(between @ cross) / norm)

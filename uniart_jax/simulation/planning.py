"""What to do with an asset: which joints have a coordinate, where rest is, where a hand would hold
each part."""

from __future__ import annotations

import re

import numpy as np
from trimesh import transform_points

from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.names import clean
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.objects.robot import MOVING, RawJoint, Robot
from uniart_jax.objects.robot_limits import drivers
from uniart_jax.simulation.engine import Follower, Plan, PlannedJoint

HANDLE = re.compile(r"handle|knob|grip|pull", re.IGNORECASE)
TURN = 2 * np.pi  # that a joint without limits is swept over
QUARTER = np.pi / 2  # that one is opened by


def plan_asset(robot: Robot, obj: ArticulatedObject) -> Plan:
    """The plan for a description.

    Args:
      robot: as read.
      obj: what ``robot_object.make_object`` made of it, metres.
    """
    return _Planner(robot, obj).plan()


class _Planner:
    def __init__(self, robot: Robot, obj: ArticulatedObject):
        self.robot, self.obj = robot, obj
        self.joints = {j.name: j for j in robot.joints}
        self.above = {j.child: j for j in robot.joints}
        self.rest = obj.rest()
        frames = obj.forward_kinematics(self.rest)
        self.frames = frames
        self.vertices = [
            transform_points(p.mesh.vertices, f) for p, f in zip(obj.parts, frames, strict=True)
        ]
        index = {p.name: k for k, p in enumerate(obj.parts)}
        self.part_of = {n: index[clean(n)] for n in robot.links if clean(n) in index}
        self.link_of = {k: n for n, k in self.part_of.items()}
        self.rigid = self._rigid()

    def plan(self) -> Plan:
        driven = drivers(self.robot)
        followers = self._followers(driven)
        planned, idle = [], {}
        for joint in self.robot.joints:
            if joint.type not in MOVING or driven[joint.name][0] != joint.name:
                continue
            found = self._planned(joint, [f for f in followers if f.driver == joint.name])
            if found is None:
                idle[joint.name] = float(np.clip(0.0, *_limits(joint)))
            else:
                planned.append(found)
        points = np.concatenate(self.vertices)
        size = float(np.ptp(points, axis=0).max())
        return Plan(size, tuple(planned), idle, tuple(followers), self.rigid)

    def _followers(self, driven: dict[str, tuple[str, float]]) -> list[Follower]:
        found = []
        for joint in self.robot.joints:
            driver, rate = driven[joint.name]
            if joint.type in MOVING and driver != joint.name:
                found.append(Follower(joint.name, driver, rate, self._offset(joint, driver)))
        return found

    def _offset(self, joint: RawJoint, driver: str) -> float:
        """q = m1 (m2 (... q_driver + o2) + o1): the constant part."""
        offset, rate = 0.0, 1.0
        while joint.name != driver and joint.mimic:
            source, multiplier, constant = joint.mimic
            offset += rate * constant
            rate *= multiplier
            joint = self.joints[source]
        return offset

    def _rigid(self) -> dict[str, int]:
        numbers = {n: i for i, n in enumerate(self.robot.links)}
        found = {}
        for link in numbers:
            top = link
            while top in self.above and self.above[top].type not in MOVING:
                top = self.above[top].parent
            found[link] = numbers[top]
        return found

    def _planned(self, joint: RawJoint, followers: list[Follower]) -> PlannedJoint | None:
        """A joint that moves a part that people see; None for one that does not, or has no
        range."""
        part = self._part(joint, followers)
        travels = joint.type == "prismatic"
        if part is None:
            return None
        shown = self._shown(joint, part)
        lo, hi = _limits(joint)
        kind = joint.type
        if not np.isfinite(hi - lo):
            if kind == "prismatic":
                lo, hi = shown.limits
            else:
                kind, lo, hi = "continuous", 0.0, TURN
        if not hi - lo > 0 or shown.type == "fixed":
            return None
        rest = 0.0 if kind == "continuous" else self._rest(part, shown, lo, hi)
        if kind == "continuous":
            goal = QUARTER
        else:
            goal = hi if hi - rest >= rest - lo else lo
            if any((self.joints[f.name].type == "prismatic") != travels for f in followers):
                kind = "screw"
        moved = self._below([joint.child, *(self.joints[f.name].child for f in followers)])
        link = self.link_of[part]
        hand, point = self._hand(part, shown, travels, goal > rest)
        reach = self._reach(part, shown, travels, point)
        for follower in (
            followers
        ):  # a hand turns the knob that lifts a burner: the longer way is the easier one
            raw = self.joints[follower.name]
            other = self._part(raw, [])
            if other is not None and self.link_of[other] not in self._below([joint.child]):
                turns = raw.type == "prismatic"
                about = self.obj.parts[other].joint
                held, at = self._hand(other, about, turns, (goal - rest) * follower.rate > 0)
                way = abs(follower.rate) * self._reach(other, about, turns, at)
                if way > reach:
                    reach, hand, point = way, held, at
        return PlannedJoint(
            joint.name,
            kind,
            link,
            float(lo),
            float(hi),
            float(rest),
            float(goal),
            tuple(sorted(moved)),
            hand,
            tuple(float(x) for x in point),
        )

    def _part(self, joint: RawJoint, followers: list[Follower]) -> int | None:
        """The first part between which and its parent part this joint stands."""
        own = {joint.name, *(f.name for f in followers)}
        for link, k in self.part_of.items():
            above = self.above.get(link)
            while above is not None:
                if above.name in own:
                    return k
                if above.parent in self.part_of:
                    break
                above = self.above.get(above.parent)
        return None

    def _shown(self, raw: RawJoint, part: int) -> Joint:
        """What became of a joint: of several that a part has, the one at its place in the chain."""
        chain = self.obj.parts[part].chain
        written, link = [], self.link_of[part]
        while (above := self.above.get(link)) is not None:
            if above.type in MOVING and not above.mimic and np.ptp(_limits(above)) > 0:
                written.append(above.name)
            link = above.parent
            if link in self.part_of:
                break
        if len(written) != len(chain) or raw.name not in written:
            return self.obj.parts[part].joint
        return chain[::-1][written.index(raw.name)]

    def _rest(self, part: int, joint: Joint, lo: float, hi: float) -> float:
        """The part's rest state as a coordinate: the object counts from the shown state, maybe in
        other units, but has the same ends."""
        if joint is not self.obj.parts[part].joint:
            return float(np.clip(0.0, lo, hi))  # as it is shown
        first, last = joint.limits
        share = (self.rest[part] - first) / (last - first)
        return float(np.clip(lo + share * (hi - lo), lo, hi))

    def _below(self, links: list[str]) -> set[str]:
        found = set(links)
        grown = True
        while grown:
            more = {j.child for j in self.robot.joints if j.parent in found} - found
            found |= more
            grown = bool(more)
        return found

    def _hand(
        self, part: int, joint: Joint, travels: bool, forward: bool
    ) -> tuple[str, np.ndarray]:
        """(link, world point at rest) to hold: a handle that is fixed to the part, else its front
        or what is farthest from the axis."""
        link = self.link_of[part]
        handles = [
            k
            for k, n in self.link_of.items()
            if k != part
            and self.rigid[n] == self.rigid[link]
            and HANDLE.search(f"{n} {self.obj.parts[k].label}")
        ]
        if handles:
            points = self.vertices[handles[0]]
            return self.link_of[handles[0]], (points.min(0) + points.max(0)) / 2
        _, direction = self._axis(part, joint)
        points = self.vertices[part]
        if travels:
            direction = direction if forward else -direction
            middle = (points.min(0) + points.max(0)) / 2
            return link, middle + direction * float((points @ direction).max() - middle @ direction)
        return link, points[int(np.argmax(self._radii(part, joint, points)))]

    def _axis(self, part: int, joint: Joint) -> tuple[np.ndarray, np.ndarray]:
        """World (point, direction) of one of a part's joints at rest."""
        inner = any(joint is other for other in self.obj.parts[part].inner)
        frame = self.frames[part if inner else self.obj.parts[part].parent]
        return frame[:3, :3] @ joint.origin + frame[:3, 3], frame[:3, :3] @ joint.direction

    def _radii(self, part: int, joint: Joint, points: np.ndarray) -> np.ndarray:
        origin, direction = self._axis(part, joint)
        across = points - origin
        return np.linalg.norm(across - (across @ direction)[:, None] * direction, axis=-1)

    def _reach(self, part: int, joint: Joint, travels: bool, point: np.ndarray) -> float:
        """How far a point of a part goes for a unit of its joint."""
        return 1.0 if travels else float(self._radii(part, joint, point[None])[0])


def _limits(joint: RawJoint) -> tuple[float, float]:
    """As an engine reads them: radians, whatever they may have been meant as."""
    if joint.type == "continuous" or joint.limits is None:
        return -np.inf, np.inf
    lo, hi = sorted(joint.limits)
    return lo, hi

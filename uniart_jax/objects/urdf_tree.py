"""From the joints of a URDF to ours: sane limits, one tree, no links without a mesh, one screw on every edge.

Everything here happens at the *shown* state: a URDF joint's coordinate is 0 there if its limits allow, else the nearest limit.
Links are placed at that state first, so axes are lines in the URDF's world frame, and collapsing a link that
has no mesh never moves anything: an edge of the tree is then a chain of URDF joints, to be lowered to one ``Joint``.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import trimesh

from uniart_jax.objects.kinematics import Joint, rotation, topological_order
from uniart_jax.objects.urdf_read import MOVING, REFUSED, RawJoint, Robot

DEGREES_FROM = 2 * np.pi * 1.05


@dataclasses.dataclass
class Edge:
    """A moving URDF joint at the shown state. Its coordinate is ``rate`` times that of ``driver`` (mimic), itself otherwise."""

    raw: RawJoint
    origin: np.ndarray  # world
    direction: np.ndarray  # world, unit
    lo: float  # relative to the shown state; infinite if unbounded
    hi: float
    driver: str
    rate: float


@dataclasses.dataclass
class Motion:
    """One degree of freedom of an edge: per unit of its coordinate in [lo, hi], so much angle and travel along one direction."""

    names: list[str]
    origin: np.ndarray
    direction: np.ndarray
    angle: float
    travel: float
    lo: float
    hi: float

    @property
    def bounded(self) -> bool:
        return bool(np.isfinite(self.lo) and np.isfinite(self.hi))

    def spans(self) -> tuple[np.ndarray, np.ndarray]:
        """(angle, travel) at both ends; the rotation is positive along ``direction``, or the travel if it does not rotate."""
        ends = np.array([self.lo, self.hi])
        return ends * self.angle, ends * self.travel


class Tree:
    """The links of a robot as a tree at the shown state.

    Args:
      robot: its notes take up the repairs.
      sizes: link -> size of its mesh (any measure); links without a mesh are absent.

    Attributes:
      names: links, in the file's order.
      parents: name -> parent link or None.
      chains: name -> joints between the link and its parent, from the parent down.
      placed: name -> [4, 4] link frame in the world at the shown state.

    Raises:
      ValueError: links that do not exist, two parents, a cycle, or two roots with geometry.
    """

    def __init__(self, robot: Robot, sizes: dict[str, float]):
        self.notes = robot.notes
        self.sizes = sizes
        self._check(robot)
        joints = {j.child: j for j in robot.joints}
        self.names = [n for n in robot.links if n not in self._unattached(robot, joints)]
        parents = [self.names.index(joints[n].parent) if n in joints else -1 for n in self.names]
        order = topological_order(parents)
        self.parents = {n: joints[n].parent if n in joints else None for n in self.names}
        self.chains: dict[str, list[Edge | RawJoint]] = {n: [] for n in self.names}
        self.placed: dict[str, np.ndarray] = {}
        shown, limits = _coordinates(robot)
        drivers = _drivers(robot)
        for index in order:
            name = self.names[index]
            joint = joints.get(name)
            if joint is None:
                self.placed[name] = np.eye(4)
                continue
            frame = self.placed[joint.parent] @ joint.origin
            self.placed[name] = frame
            norm = float(np.linalg.norm(joint.axis))
            if joint.type in REFUSED:
                self.chains[name] = [joint]
            if joint.type not in MOVING:
                continue
            if norm < 1e-9:
                self.notes.append(f"joint '{joint.name}': its axis is zero; held fixed")
                continue
            if abs(norm - 1) > 1e-3:
                self.notes.append(f"joint '{joint.name}': its axis has length {norm:.4g}; normalised")
            axis = joint.axis / norm
            q0, (lo, hi) = shown[joint.name], limits[joint.name]
            step = np.eye(4)
            if joint.type == "prismatic":
                step[:3, 3] = axis * q0
            else:
                step[:3, :3] = rotation(axis, q0)
            self.placed[name] = frame @ step
            driver, rate = drivers[joint.name]
            self.chains[name] = [
                Edge(joint, frame[:3, 3], frame[:3, :3] @ axis, lo - q0, hi - q0, driver, rate)
            ]
        self._collapse()

    def _check(self, robot: Robot) -> None:
        seen: dict[str, str] = {}
        for joint in robot.joints:
            for link in (joint.parent, joint.child):
                if link not in robot.links:
                    raise ValueError(f"joint '{joint.name}': there is no link '{link}'")
            if joint.child in seen:
                raise ValueError(f"link '{joint.child}' has two parents: joints '{seen[joint.child]}' and '{joint.name}'")
            seen[joint.child] = joint.name

    def _unattached(self, robot: Robot, joints: dict[str, RawJoint]) -> set[str]:
        """Links of trees that hold no mesh beside the one that does; an error if several do or none remains."""
        top: dict[str, str] = {}
        for name in robot.links:
            node, visited = name, set()
            while node in joints and node not in visited:
                visited.add(node)
                node = joints[node].parent
            if node in visited:
                raise ValueError(f"the joints form a cycle through link '{node}'")
            top[name] = node
        roots = list(dict.fromkeys(top.values()))
        seen = [r for r in roots if any(n in self.sizes for n in robot.links if top[n] == r)]
        if not seen:
            raise ValueError("no link has a mesh")
        if len(seen) > 1:
            raise ValueError(f"two roots: links '{seen[0]}' and '{seen[1]}' are not joined; an object is one tree")
        dropped = {n for n in robot.links if top[n] != seen[0]}
        if dropped:
            self.notes.append(f"links without a mesh that no joint attaches were left out: {_listed(dropped, robot)}")
        return dropped

    def _collapse(self) -> None:
        """Take out every link without a mesh.

        A fixed child takes its place and its joint; the other children hang on that child. Without one, its children hang on its
        parent by longer chains; at the root, one child becomes the root.
        """
        gone = []
        for name in self._upward():
            if name in self.sizes:
                continue
            gone.append(name)
            children = [n for n in self.names if self.parents[n] == name]
            parent = self.parents[name]
            fixed = next((c for c in children if not self.chains[c]), None)
            if fixed is None and parent is None and children:
                fixed = max(children, key=lambda c: self.sizes[c])
                held = ", ".join(f"'{_raw(e).name}'" for e in self.chains[fixed])
                if any(not isinstance(e, RawJoint) for e in self.chains[fixed]) or len(children) > 1:
                    self.notes.append(
                        f"link '{name}' is the root and has no mesh: '{fixed}' is the root instead, joint {held} held fixed"
                    )
                self.chains[fixed] = []
            for child in children:
                if child == fixed:
                    self.parents[child] = parent
                    self.chains[child] = self.chains[name]
                elif fixed is not None:
                    self.parents[child] = fixed
                else:
                    self.parents[child] = parent
                    self.chains[child] = self.chains[name] + self.chains[child]
            self.names.remove(name)
        if gone:
            listed = ", ".join(f"'{n}'" for n in self.chains if n in gone)
            self.notes.append(f"links without a mesh were collapsed: {listed}")

    def _upward(self) -> list[str]:
        """Names, children before parents."""
        index = {n: i for i, n in enumerate(self.names)}
        parents = [-1 if self.parents[n] is None else index[self.parents[n]] for n in self.names]
        return [self.names[i] for i in reversed(topological_order(parents))]

    def joint(self, name: str, mesh: trimesh.Trimesh, dead_zone: float) -> Joint:
        """The joint of link ``name``, lowered to one screw.

        Args:
          mesh: the link's own mesh in the world at the shown state; it tells which of two motions is the larger.
          dead_zone: travel below which there is none.

        Raises:
          ValueError: a planar, floating or spherical joint.
        """
        chain = self.chains[name]
        for entry in chain:
            if isinstance(entry, RawJoint):
                raise ValueError(f"joint '{entry.name}' is {entry.type}: one rotation and one travel about a line are all a joint can do")
        edges = [e for e in chain if isinstance(e, Edge)]
        if not edges:
            return Joint.fixed()
        motion = self._lowered(name, edges, mesh)
        if motion is None:
            return Joint.fixed()
        if not motion.bounded:
            if motion.angle and motion.travel:  # a screw without an end turns for ever, and travels for ever
                motion = dataclasses.replace(motion, travel=0.0)
                self.notes.append(f"joint {_quoted(motion.names)}: a screw without limits; its travel was dropped")
            if motion.angle:
                motion = dataclasses.replace(motion, lo=-np.pi, hi=np.pi, angle=1.0)
            else:
                along = np.ptp(mesh.vertices @ motion.direction) / 2
                motion = dataclasses.replace(motion, lo=-along, hi=along, travel=1.0)
                self.notes.append(
                    f"joint {_quoted(motion.names)}: prismatic without limits; half its part's length either way"
                )
        angle, travel = motion.spans()
        direction = motion.direction
        if (angle if motion.angle else travel)[1] < 0 or (angle if motion.angle else travel)[0] > 0:
            direction, angle, travel = -direction, -angle, -travel
        return Joint(motion.origin, direction, tuple(angle), tuple(travel), dead_zone)

    def _lowered(self, name: str, edges: list[Edge], mesh: trimesh.Trimesh) -> Motion | None:
        groups: dict[str, list[Edge]] = {}
        inside = {e.raw.name for e in edges}
        for edge in edges:
            if edge.driver not in inside:  # it mimics a joint of another edge
                if edge.driver != edge.raw.name:
                    self.notes.append(
                        f"joint '{edge.raw.name}': it mimics '{edge.driver}' of another link; read as independent"
                    )
                edge = dataclasses.replace(edge, driver=edge.raw.name, rate=1.0)
            groups.setdefault(edge.driver, []).append(edge)
        motions = [self._coupled(group, mesh) for group in groups.values()]
        motions = _added([m for m in motions if m.angle or m.travel])
        if not motions:  # mimics that undo each other
            return None
        if len(motions) == 1:
            motion = motions[0]
            if len(edges) > 1 and len(motion.names) == len(edges):
                kind = "screw" if motion.angle and motion.travel else "joint"
                self.notes.append(f"joints {_quoted(motion.names)} of link '{name}' are one {kind}")
            return motion
        screw = _screw(motions)
        if screw is not None:
            self.notes.append(
                f"joints {_quoted(screw.names)} of link '{name}' turn and travel independently; lowered to one proportional screw"
            )
            return screw
        return self._largest(motions, mesh)

    def _largest(self, motions: list[Motion], mesh: trimesh.Trimesh) -> Motion:
        kept = max(motions, key=lambda m: _reach(m, mesh))
        lost = [n for m in motions if m is not kept for n in m.names]
        self.notes.append(f"joint {_quoted(lost)}: dropped beside joint {_quoted(kept.names)}, whose motion is larger")
        return kept

    def _coupled(self, edges: list[Edge], mesh: trimesh.Trimesh) -> Motion:
        """Joints driven by one coordinate (mimic) as one motion: a sum of parallel rotations and of travels."""
        lo, hi = -np.inf, np.inf
        driver = [e for e in edges if e.raw.name == e.driver]
        for edge in driver or edges:
            lo, hi = max(lo, min(edge.lo / edge.rate, edge.hi / edge.rate)), min(hi, max(edge.lo / edge.rate, edge.hi / edge.rate))
        if not np.isfinite(lo) or not np.isfinite(hi):  # a continuous driver: the followers' limits hold it
            for edge in edges:
                ends = sorted((edge.lo / edge.rate, edge.hi / edge.rate))
                lo, hi = max(lo, ends[0]), min(hi, ends[1])
        turning = [e for e in edges if e.raw.type != "prismatic"]
        slide = np.sum([e.rate * e.direction for e in edges if e.raw.type == "prismatic"], axis=0) + np.zeros(3)
        axis = turning[0].direction if turning else slide / max(np.linalg.norm(slide), 1e-12)
        angle = float(sum(e.rate * (e.direction @ axis) for e in turning))
        travel = float(slide @ axis)
        names = [e.raw.name for e in edges]
        coaxial = all(_same_line(e.origin, e.direction, turning[0].origin, axis) for e in turning)
        if coaxial and np.linalg.norm(slide - travel * axis) <= 1e-6 * max(1.0, np.linalg.norm(slide)):
            return Motion(names, (turning or edges)[0].origin, axis, angle, travel, lo, hi)
        alone = [
            Motion([e.raw.name], e.origin, e.direction, *_rates(e), lo, hi) for e in edges
        ]
        return self._largest(alone, mesh)


def _rates(edge: Edge) -> tuple[float, float]:
    return (0.0, edge.rate) if edge.raw.type == "prismatic" else (edge.rate, 0.0)


def _raw(entry: Edge | RawJoint) -> RawJoint:
    return entry.raw if isinstance(entry, Edge) else entry


def _quoted(names: list[str]) -> str:
    return " and ".join(f"'{n}'" for n in names)


def _listed(names: set[str], robot: Robot) -> str:
    return ", ".join(f"'{n}'" for n in robot.links if n in names)


def _parallel(a: np.ndarray, b: np.ndarray) -> bool:
    return float(np.linalg.norm(np.cross(a, b))) < 1e-4


def _same_line(p: np.ndarray, d: np.ndarray, origin: np.ndarray, axis: np.ndarray) -> bool:
    between = p - origin
    return _parallel(d, axis) and float(np.linalg.norm(between - (between @ axis) * axis)) < 1e-5


def _added(motions: list[Motion]) -> list[Motion]:
    """Independent travels along one direction, or turns about one line, added up: a drawer on telescopic rails."""
    kept: list[Motion] = []
    for motion in motions:
        for i, other in enumerate(kept):
            pure = bool(motion.angle) == bool(other.angle) and bool(motion.travel) == bool(other.travel)
            if not pure or (motion.angle and motion.travel) or not _parallel(motion.direction, other.direction):
                continue
            if motion.angle and not _same_line(motion.origin, motion.direction, other.origin, other.direction):
                continue
            sign = np.sign(motion.direction @ other.direction)
            rate = (motion.angle or motion.travel) / (other.angle or other.travel) * sign
            ends = sorted((motion.lo * rate, motion.hi * rate))
            kept[i] = dataclasses.replace(
                other, names=other.names + motion.names, lo=other.lo + ends[0], hi=other.hi + ends[1]
            )
            break
        else:
            kept.append(motion)
    return kept


def _screw(motions: list[Motion]) -> Motion | None:
    """One proportional screw from an independent turn and travel, both bounded, along parallel axes; else None.

    The travel keeps its ends; the turn is spread over them in proportion, lower end to lower end.
    """
    if len(motions) != 2 or not all(m.bounded for m in motions):
        return None
    turn, slide = sorted(motions, key=lambda m: m.angle == 0)
    if turn.travel or slide.angle or not turn.angle or not slide.travel or not _parallel(turn.direction, slide.direction):
        return None
    span = float(np.ptp(slide.spans()[1]))
    if span < 1e-9:
        return dataclasses.replace(turn, names=turn.names + slide.names)
    sign = float(np.sign(turn.direction @ slide.direction))
    ends = np.sort(slide.spans()[1] * sign)  # travel along the turn's direction
    pitch = float(np.ptp(turn.spans()[0])) / span
    return Motion(turn.names + slide.names, turn.origin, turn.direction, pitch, 1.0, ends[0], ends[1])


def _reach(motion: Motion, mesh: trimesh.Trimesh) -> float:
    """How far the motion carries the farthest point of the mesh; endless turns count once."""
    between = mesh.vertices - motion.origin
    radius = np.linalg.norm(between - (between @ motion.direction)[:, None] * motion.direction, axis=1).max()
    span = min(motion.hi - motion.lo, 1e9)
    return float(max(min(abs(motion.angle) * span, 2 * np.pi) * radius, abs(motion.travel) * span))


def _drivers(robot: Robot) -> dict[str, tuple[str, float]]:
    """Joint -> (joint that drives it, multiplier), through chains of mimics; itself and 1 for all others."""
    by_name = {j.name: j for j in reversed(robot.joints)}
    found = {}
    for joint in robot.joints:
        current, rate, visited = joint, 1.0, set()
        while current.mimic and current.name not in visited and current.mimic[0] in by_name and current.mimic[1]:
            visited.add(current.name)
            rate *= current.mimic[1]
            current = by_name[current.mimic[0]]
        found[joint.name] = (joint.name, 1.0) if current.name in visited else (current.name, rate)
    return found


def _coordinates(robot: Robot) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
    """(coordinate at the shown state, sane limits) of every moving joint; repairs are noted."""
    by_name = {j.name: j for j in reversed(robot.joints)}
    limits: dict[str, tuple[float, float]] = {}
    for joint in robot.joints:
        if joint.type in MOVING:
            limits[joint.name] = _limits(joint, by_name, robot)
    shown: dict[str, float] = {}
    drivers = _drivers(robot)

    def show(joint: RawJoint) -> float:
        if joint.name in shown or joint.name not in limits:
            return shown.get(joint.name, 0.0)
        lo, hi = limits[joint.name]
        wanted = 0.0
        if joint.mimic:
            source, multiplier, offset = joint.mimic
            if drivers[joint.name][0] == joint.name:
                robot.notes.append(f"joint '{joint.name}': it mimics '{source}', which cannot drive it; read as independent")
            else:
                wanted = multiplier * show(by_name[source]) + offset
        shown[joint.name] = float(np.clip(wanted, lo, hi))
        if abs(shown[joint.name] - wanted) > 1e-9:
            robot.notes.append(
                f"joint '{joint.name}': its limits ({lo:.4g}, {hi:.4g}) exclude {wanted:.4g}; shown at {shown[joint.name]:.4g}"
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
        robot.notes.append(f"joint '{joint.name}': lower limit {lo:.4g} is above upper {hi:.4g}; swapped")
        lo, hi = hi, lo
    if joint.type == "revolute" and max(abs(lo), abs(hi)) > DEGREES_FROM and not _turns_a_screw(joint, by_name):
        robot.notes.append(f"joint '{joint.name}': limits ({lo:.4g}, {hi:.4g}) can only be degrees; converted")
        lo, hi = np.deg2rad(lo), np.deg2rad(hi)
    return lo, hi


def _turns_a_screw(joint: RawJoint, by_name: dict[str, RawJoint]) -> bool:
    """Whether a prismatic joint mimics this revolute one, or is mimicked by it: a cap may well turn many times."""
    if joint.mimic and joint.mimic[0] in by_name and by_name[joint.mimic[0]].type == "prismatic":
        return True
    return any(j.type == "prismatic" and j.mimic and j.mimic[0] == joint.name for j in by_name.values())

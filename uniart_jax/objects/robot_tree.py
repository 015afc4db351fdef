"""From the joints of a robot to one tree of links that have a mesh.

Everything here happens at the *shown* state: a joint's coordinate is 0 there if its limits allow,
else the nearest limit. Links are placed at that state first, so axes are lines in the robot's world
frame, and collapsing a link that has no mesh never moves anything: an edge of the tree is then a
chain of the robot's joints, which ``robot_motion`` lowers to one.
"""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.kinematics import rotation, topological_order
from uniart_jax.objects.robot import MOVING, REFUSED, RawJoint, Robot
from uniart_jax.objects.robot_limits import coordinates, drivers
from uniart_jax.objects.robot_motion import Edge


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
        dropped = self._unattached(robot, joints)
        self.names = [n for n in robot.links if n not in dropped]
        index = {n: i for i, n in enumerate(self.names)}
        parents = [index[joints[n].parent] if n in joints else -1 for n in self.names]
        order = topological_order(parents)
        self.parents = {n: joints[n].parent if n in joints else None for n in self.names}
        self.chains: dict[str, list[Edge | RawJoint]] = {n: [] for n in self.names}
        self.placed: dict[str, np.ndarray] = {}
        shown, limits = coordinates(robot)
        driven = drivers(robot)
        for number in order:
            name = self.names[number]
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
                self.notes.append(
                    f"joint '{joint.name}': its axis has length {norm:.4g}; normalised"
                )
            axis = joint.axis / norm
            q0, (lo, hi) = shown[joint.name], limits[joint.name]
            step = np.eye(4)
            if joint.type == "prismatic":
                step[:3, 3] = axis * q0
            else:
                step[:3, :3] = rotation(axis, q0)
            self.placed[name] = frame @ step
            driver, rate = driven[joint.name]
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
                raise ValueError(
                    f"link '{joint.child}' has two parents: joints '{seen[joint.child]}' and "
                    f"'{joint.name}'"
                )
            seen[joint.child] = joint.name

    def _unattached(self, robot: Robot, joints: dict[str, RawJoint]) -> set[str]:
        """Links of trees that hold no mesh beside the one that does; an error if several do or none
        remains."""
        top: dict[str, str] = {}
        for name in robot.links:
            node, way = name, {}
            while node in joints and node not in top:
                if node in way:
                    raise ValueError(f"the joints form a cycle through link '{node}'")
                way[node] = None
                node = joints[node].parent
            root = top.get(node, node)
            top |= dict.fromkeys((*way, name), root)
        seen = list(dict.fromkeys(top[n] for n in robot.links if n in self.sizes))
        if not seen:
            raise ValueError("no link has a mesh")
        if len(seen) > 1:
            raise ValueError(
                f"two roots: links '{seen[0]}' and '{seen[1]}' are not joined; an object is one "
                "tree"
            )
        dropped = {n for n in robot.links if top[n] != seen[0]}
        if dropped:
            self.notes.append(
                "links without a mesh that no joint attaches were left out: "
                f"{_listed(dropped, robot)}"
            )
        return dropped

    def _collapse(self) -> None:
        """Take out every link without a mesh.

        A fixed child takes its place and its joint; the other children hang on that child. Without
        one, its children hang on its parent by longer chains; at the root, one child becomes the
        root.
        """
        gone: set[str] = set()
        place = {n: i for i, n in enumerate(self.names)}
        below: dict[str | None, set[str]] = {n: set() for n in (*self.names, None)}
        for name, parent in self.parents.items():
            below[parent].add(name)
        for name in self._upward():
            if name in self.sizes:
                continue
            gone.add(name)
            children = sorted(below[name], key=place.__getitem__)
            parent = self.parents[name]
            fixed = next((c for c in children if not self.chains[c]), None)
            if fixed is None and parent is None and children:
                fixed = max(children, key=lambda c: self.sizes[c])
                held = ", ".join(f"'{_raw(e).name}'" for e in self.chains[fixed])
                if (
                    any(not isinstance(e, RawJoint) for e in self.chains[fixed])
                    or len(children) > 1
                ):
                    self.notes.append(
                        f"link '{name}' is the root and has no mesh: '{fixed}' is the root "
                        f"instead, joint {held} held fixed"
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
                below[self.parents[child]].add(child)
            below[parent].discard(name)
        self.names = [n for n in self.names if n not in gone]
        if gone:
            listed = ", ".join(f"'{n}'" for n in self.chains if n in gone)
            self.notes.append(f"links without a mesh were collapsed: {listed}")

    def _upward(self) -> list[str]:
        """Names, children before parents."""
        index = {n: i for i, n in enumerate(self.names)}
        above = [self.parents[n] for n in self.names]
        parents = [-1 if p is None else index[p] for p in above]
        return [self.names[i] for i in reversed(topological_order(parents))]


def _raw(entry: Edge | RawJoint) -> RawJoint:
    return entry.raw if isinstance(entry, Edge) else entry


def _listed(names: set[str], robot: Robot) -> str:
    return ", ".join(f"'{n}'" for n in robot.links if n in names)

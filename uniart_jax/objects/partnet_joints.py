"""PartNet-Mobility's two descriptions of the joints of one object, brought together: the JSON's are
put into the URDF's robot.

**Which part is which link.** ``link_k`` is the k-th part of ``mobility_v2.json`` that is not
``junk``: the URDF leaves junk out and closes the ranks, so ids differ behind it. (Compared by the
meshes that PartNet's ``result.json`` gives each part, in 472 folders of two hosts: 1,615 of 1,619
links with such a part's number hold only its meshes, and where id and rank differ it is always the
rank.) A hinge whose link a host has renamed is found by its line.

**Frames.** The JSON's axes are in the raw frame (y up) of the object's OBJ files. A link's visuals
carry its OBJs into the world by one matrix P, so the part's axis in the world is P times the
JSON's, wherever the URDF puts the part: this is the base joint's turn in an unedited URDF, and
holds where a host has moved, scaled or turned things. No shape is moved. If the host has moved the
part along its own joint (a drawer modelled open, pushed in), the limits are counted from where it
stands:

    lo, hi  <-  lo - s, hi - s        R = P_parent^-1 P = the joint's motion by s

**Whole turns.** Some limits lie a turn or more away from 0 (-516 to -337 degrees). A turn by 2 pi
is none: they are brought back to 0.

**What counts as a disagreement**, noted with both values, the JSON's used: another kind or number
of motions, an axis that differs by more than half a degree or .002, limits by as much, once
(direction, lo, hi) ~ (-direction, -hi, -lo) and whole turns are taken out; another parent.

Links that the JSON does not know keep the URDF's joint, noted if it moves. Helper links without a
shape, by which the URDF writes a slider that rotates, are replaced by our own.
"""

from __future__ import annotations

import collections
import dataclasses

import numpy as np

from uniart_jax.objects.partnet_freedom import (
    LENGTH_TOLERANCE,
    TURN,
    Freedom,
    agree,
    between,
    coordinate_at,
    described,
    moved,
    near_zero,
    same_limits,
    snapped,
)
from uniart_jax.objects.robot import MOVING, Link, RawJoint, Robot

JSON = "mobility_v2.json"


@dataclasses.dataclass(frozen=True)
class Node:
    """A part of ``mobility_v2.json``, raw frame.

    Attributes:
      parent: id, -1 for a root.
      kind: its ``joint``.
      freedoms: none (fixed), one, or a travel and a turn.
      fault: why its joint cannot be used.
      backwards: its limits were written a > b.
    """

    id: int
    parent: int
    kind: str
    name: str
    freedoms: tuple[Freedom, ...] = ()
    fault: str = ""
    backwards: bool = False


def arbitrate(robot: Robot, nodes: list[Node]) -> None:
    """Put the joints of ``mobility_v2.json`` into a robot read from the URDF; shapes stay where
    they are at joint coordinate 0.

    Args:
      robot: changed in place; its links get the parts' names as labels, its notes take up every
        disagreement.
      nodes: all parts, the parents of each among them.
    """
    frames = _frames_at_zero(robot)
    if frames is None:  # not a tree: make_object says what is wrong
        return
    arbiter = _Arbiter(robot, nodes, frames)
    arbiter.rebuild()
    for link, node in arbiter.node_of.items():
        robot.links[link].label = node.name


class _Arbiter:
    """The state of one ``arbitrate``: who is who, where everything stands at joint coordinate 0."""

    def __init__(self, robot: Robot, nodes: list[Node], frames: dict[str, np.ndarray]):
        self.robot, self.notes, self.frames = robot, robot.notes, frames
        self.above = {j.child: j for j in robot.joints}
        tops = [self._climb(n, lambda link: link not in self.above) or n for n in robot.links]
        self.top = collections.Counter(tops).most_common(1)[0][0]
        kept = [n for n in nodes if n.kind != "junk"]
        numbered = {f"link_{k}": n for k, n in enumerate(kept)}
        self.node_of = {link: n for link, n in numbered.items() if link in robot.links}
        self.link_of = {n.id: link for link, n in self.node_of.items()}
        for node in [n for link, n in numbered.items() if link not in robot.links]:
            self._find_by_line(node)

    def _find_by_line(self, node: Node) -> None:
        """A renamed link: the only unknown one that turns about the part's line."""
        root = next((link for link, n in self.node_of.items() if n.parent == -1), None)
        placed = self.placement(root) if root else self.world()
        found = []
        for link, joint in self.above.items():
            if link in self.node_of or joint.type not in ("revolute", "continuous"):
                continue
            theirs = self._urdf_freedom(joint)
            if any(f.turns and agree(moved(f, placed), theirs) for f in node.freedoms):
                found.append(link)
        if len(found) == 1:
            self.node_of[found[0]] = node
            self.link_of[node.id] = found[0]
        elif node.freedoms:
            self.notes.append(
                f"{JSON}: '{node.name}' (id {node.id}, {node.kind}) has no link in the URDF; left "
                "out"
            )

    def world(self) -> np.ndarray:
        """[4, 4] raw frame to world where no mesh tells it: the frame of the links that hang on the
        root."""
        below = [j.child for j in self.robot.joints if j.parent == self.top]
        return self.frames[below[0] if below else self.top]

    def placement(self, link: str) -> np.ndarray:
        """[4, 4] similarity that carries the link's OBJs (raw frame) into the world; that of most
        of them, if they differ."""
        found: dict[tuple, np.ndarray] = {}
        votes: collections.Counter = collections.Counter()
        for shape in self.robot.links[link].visuals:
            matrix = self.frames[link] @ shape.origin @ np.diag([*shape.size[:1].repeat(3), 1.0])
            if shape.kind == "mesh" and np.ptp(shape.size) == 0 and shape.size[0] > 0:
                key = tuple(np.round(matrix, 4).ravel() + 0.0)
                found.setdefault(key, matrix)
                votes[key] += 1
        if votes:
            return found[votes.most_common(1)[0][0]]
        node = self.node_of.get(link)
        parent = self.link_of.get(node.parent) if node else None
        return self.placement(parent) if parent else self.world()

    def rebuild(self) -> None:
        """New joints for every link that a part is known for, in new frames whose origins lie on
        the axes."""
        robot, frames = self.robot, dict(self.frames)
        plan: list[tuple[RawJoint, tuple[Freedom, ...]]] = []
        for link in robot.links:
            joint, node = self.above.get(link), self.node_of.get(link)
            if node is None or node.fault:
                if joint is not None:
                    plan.append((joint, ()))
                    self._note_kept(joint, node)
                continue
            parent = self._parent(link, node)
            if parent is None:
                continue
            freedoms = self._freedoms(link, node)
            self._compare(link, node, freedoms, parent)
            name = joint.name if joint else f"joint_{link}"
            if freedoms:
                frames[link] = self.frames[link].copy()
                frames[link][:3, 3] = freedoms[0].origin
            fresh = RawJoint(name, "fixed", parent, link, np.eye(4), np.zeros(3), None, None)
            plan.append((fresh, freedoms))
        for name, link in robot.links.items():
            if frames[name] is not self.frames[name]:
                back = np.linalg.inv(frames[name]) @ self.frames[name]
                for shape in (*link.visuals, *link.collisions):
                    shape.origin = back @ shape.origin
        self._drop_helpers([joint for joint, _ in plan])
        plan = [entry for entry in plan if entry[0].child in robot.links]
        robot.joints = []
        for joint, freedoms in plan:
            self._append(joint, freedoms, frames)

    def _append(
        self, joint: RawJoint, freedoms: tuple[Freedom, ...], frames: dict[str, np.ndarray]
    ) -> None:
        """A joint with the given freedoms, the first one nearest the parent; as it is if there are
        none."""
        frame = frames[joint.child]
        joint.origin = np.linalg.inv(frames[joint.parent]) @ frame
        for number, freedom in enumerate(freedoms, start=1):
            last = number == len(freedoms)
            link = joint.child if last else self._fresh(f"{joint.child}_helper")
            if not last:
                self.robot.links[link] = Link(link, [], [])
            kind = "revolute" if freedom.turns else "prismatic"
            if freedom.turns and freedom.hi - freedom.lo >= TURN - 1e-9 and len(freedoms) == 1:
                kind = "continuous"
            bounded = bool(np.isfinite(freedom.hi - freedom.lo))
            if freedom.turns and not bounded:
                kind = "continuous"
            self.robot.joints.append(
                dataclasses.replace(
                    joint,
                    name=joint.name if last else f"{joint.name}_helper",
                    type=kind,
                    child=link,
                    axis=frame[:3, :3].T @ freedom.direction,
                    limits=(freedom.lo, freedom.hi) if bounded else None,
                )
            )
            joint = dataclasses.replace(joint, parent=link, origin=np.eye(4))
        if not freedoms:
            self.robot.joints.append(joint)

    def _fresh(self, name: str) -> str:
        while name in self.robot.links:
            name += "_"
        return name

    def _drop_helpers(self, joints: list[RawJoint]) -> None:
        """Links without a shape that the new joints go past."""
        before = {j.parent for j in self.robot.joints}
        parents = {j.parent for j in joints}
        for name in list(self.robot.links):
            bare = not self.robot.links[name].visuals and not self.robot.links[name].collisions
            if bare and name in before - parents and name != self.top and name not in self.node_of:
                del self.robot.links[name]

    def _parent(self, link: str, node: Node) -> str | None:
        """The link that a part hangs on: the JSON's, by way of links with a shape that only the
        URDF knows; None for the root."""
        if node.parent == -1:
            return None if link == self.top or self.top in self.node_of else self.top
        wanted = self.link_of.get(node.parent)
        theirs = self._climb(link, lambda n: n in self.node_of)
        if wanted is not None and wanted != theirs:
            self.notes.append(
                f"link '{link}': on {_quoted(theirs)} in the URDF, on '{wanted}' in {JSON}; the "
                "latter is used"
            )
            return wanted
        links = self.robot.links
        return self._climb(
            link, lambda n: n in self.node_of or bool(links[n].visuals or links[n].collisions)
        ) or (self.top if link != self.top else None)

    def _climb(self, link: str, stop) -> str | None:
        """The nearest link above for which ``stop`` holds."""
        while link in self.above:
            link = self.above[link].parent
            if stop(link):
                return link
        return None

    def _freedoms(self, link: str, node: Node) -> tuple[Freedom, ...]:
        """The part's motions in the world, limits counted from where the URDF shows it."""
        if node.kind == "free" and node.parent != -1:
            self.notes.append(
                f"{JSON}: '{node.name}' (id {node.id}) is free of its parent; held fixed"
            )
        if not node.freedoms:
            return ()
        placed, parent = self.placement(link), self.link_of.get(node.parent)
        if parent is not None:
            relative = np.linalg.inv(self.placement(parent)) @ placed
            if not np.allclose(relative, np.eye(4), atol=LENGTH_TOLERANCE):
                node = self._pushed(link, node, relative)
        return tuple(near_zero(moved(f, placed)) for f in node.freedoms)

    def _pushed(self, link: str, node: Node, relative: np.ndarray) -> Node:
        """The part with limits counted from where the URDF shows it, if that lies on its joint's
        way."""
        freedoms = list(node.freedoms)
        for i, freedom in enumerate(freedoms):
            s = coordinate_at(freedom, relative)
            if s is not None:
                lo, hi = (snapped(end - s, freedom.turns) for end in (freedom.lo, freedom.hi))
                freedoms[i] = dataclasses.replace(freedom, lo=lo, hi=hi)
                shown = f"{np.rad2deg(s):.4g} degrees" if freedom.turns else f"{s:.4g}"
                self.notes.append(
                    f"link '{link}': the URDF shows it at {shown} of {JSON}'s joint; limits are "
                    "counted from there"
                )
                return dataclasses.replace(node, freedoms=tuple(freedoms))
        self.notes.append(
            f"link '{link}': the URDF shows it elsewhere than {JSON}; its axis went along"
        )
        return node

    def _urdf_freedom(self, joint: RawJoint) -> Freedom:
        frame = self.frames[joint.child]
        lo, hi = (-np.inf, np.inf) if joint.limits is None else sorted(joint.limits)
        if joint.type == "continuous":
            lo, hi = -np.inf, np.inf
        turns = joint.type != "prismatic"
        return Freedom(turns, frame[:3, 3], frame[:3, :3] @ joint.axis, lo, hi)

    def _compare(self, link: str, node: Node, ours: tuple[Freedom, ...], parent: str) -> None:
        """Note where the URDF's joint between the two links is another one."""
        theirs = []
        current = link
        while current in self.above and current != parent:
            joint = self.above[current]
            if joint.type in MOVING:
                theirs.append(self._urdf_freedom(joint))
            current = joint.parent
            if current in self.node_of:
                break
        name = self.above[link].name if link in self.above else link
        theirs = sorted(theirs, key=lambda f: f.turns)  # the JSON's travel stands before its turn
        same = [f.turns for f in ours] == [f.turns for f in theirs]
        if same:
            theirs = [
                near_zero(t.flipped() if t.direction @ f.direction < 0 else t)
                for f, t in zip(ours, theirs, strict=True)
            ]
            same = all(same_limits(f, t) for f, t in zip(ours, theirs, strict=True))
        if not same:
            said = "a root" if node.parent == -1 else described(ours)
            self.notes.append(
                f"joint '{name}': {described(theirs)} in the URDF, {said} in {JSON}; the latter is "
                "used"
            )
        elif not all(agree(f, t) for f, t in zip(ours, theirs, strict=True)):
            angle, distance = max(
                (between(f, t) for f, t in zip(ours, theirs, strict=True)), key=max
            )
            self.notes.append(
                f"joint '{name}': its axis in the URDF is {angle:.3g} degrees and {distance:.3g} "
                f"off that in {JSON}; the latter is used"
            )

    def _note_kept(self, joint: RawJoint, node: Node | None) -> None:
        if node is not None:
            self.notes.append(
                f"joint '{joint.name}': {node.fault} in {JSON}; the URDF's joint is used"
            )
            return
        links = self.robot.links
        bare = not links[joint.child].visuals and not links[joint.child].collisions
        if joint.type in MOVING and not bare:
            self.notes.append(
                f"joint '{joint.name}': {JSON} does not know link '{joint.child}'; the URDF's "
                "joint is used"
            )


def _frames_at_zero(robot: Robot) -> dict[str, np.ndarray] | None:
    """[4, 4] world frame of every link with all joints at 0; None if the links are not one tree."""
    above = {j.child: j for j in robot.joints}
    ends = {n for j in robot.joints for n in (j.parent, j.child)}
    if len(above) != len(robot.joints) or not ends <= set(robot.links):
        return None
    frames: dict[str, np.ndarray] = {}
    for name in robot.links:
        chain, visited = [name], {name}
        while chain[-1] in above and chain[-1] not in frames:
            parent = above[chain[-1]].parent
            if parent in visited:
                return None
            visited.add(parent)
            chain.append(parent)
        frames.setdefault(chain[-1], np.eye(4))
        for child in reversed(chain[:-1]):
            frames[child] = frames[above[child].parent] @ above[child].origin
    return frames


def _quoted(name: str | None) -> str:
    return "the root" if name is None else f"'{name}'"

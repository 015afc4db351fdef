"""Mending joints that run into the object: limits are tightened and axes shifted a little, by a
collision sweep.

A generated hinge often lies a few millimetres inside the frame beside it, or its range ends in a
wall. Of every moving joint the sweep finds the states around the shown one, which the image vouches
for, in which its sub-tree digs no deeper into the rest of the object than it does there; if these
are not the whole range, nearby axes are tried, and then the limits are drawn in to what is free.
All of it is bounded and told. The other joints are as shown at first, then, in a second round, at
rest. The idea is MotionAnymesh's (limits refined by collisions lifted what their assets could do
from 65 to 87 %).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import trimesh

from uniart_jax.export.bodies import with_joints
from uniart_jax.export.budget import within_budget
from uniart_jax.export.formats import Collision
from uniart_jax.export.physics import Body
from uniart_jax.export.voxel_boxes import as_cells, is_rough
from uniart_jax.objects.kinematics import Joint, forward_kinematics, subtrees
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.simulation.carving import carve
from uniart_jax.simulation.clearing import clear
from uniart_jax.simulation.collider import Collider

DEPTH_LIMIT = 0.01  # of the object's longest side: deeper than as shown by more is a collision
# of the longest side: how far a point of the sub-tree moves, at most, from one state tried to the
# next
STEP = 0.03
STATES = (21, 121)  # of a joint's range that are tried, least and most
SHIFTS = (0.01, 0.02, 0.03)  # of the longest side: how far an axis may be moved
DIRECTIONS = 8  # about the axis, for each of them
MAX_OPENED = 3  # times that parts in the way are opened first
MIN_FREE = 0.2  # of its range that a joint must keep; one that is freer nowhere is left as it is


@dataclasses.dataclass(frozen=True)
class Refinement:
    """What was done to one joint.

    Attributes:
      part: the part that it moves.
      free_before, free_after: share of the joint's first range, 0 to 1, that can be travelled from
        the shown state without a collision.
      shift: metres that the axis was moved.
      limits: (lo, hi) of q, before and after; radians or metres.
    """

    part: str
    free_before: float
    free_after: float
    shift: float
    limits_before: tuple[float, float]
    limits_after: tuple[float, float]

    @property
    def line(self) -> str:
        """The refinement as one readable line of provenance."""
        share = f"{self.free_before:.0%} of its range was free"
        if self.free_after < MIN_FREE:
            return (
                f"refine: joint of '{self.part}': {share}; no nearby axis frees a fifth of it, "
                "left as it is"
            )
        lo, hi = self.limits_after
        moved = f"axis moved by {self.shift:.4g} m, " if self.shift else ""
        return (
            f"refine: joint of '{self.part}': {share}; {moved}limits drawn in to ({lo:.4g}, "
            f"{hi:.4g})"
        )


def mend(
    obj: ArticulatedObject,
    bodies: Sequence[Body],
    meshes: Sequence[trimesh.Trimesh],
    budget: int | None = None,
    collision: Collision = "merged",
) -> tuple[ArticulatedObject, tuple[Body, ...]]:
    """``clear``, or ``carve`` where the object is rough, and ``refine``: shapes that scrape are cut
    back, then limits and axes mended.

    Args:
      bodies, meshes: [K] of its parts, and the surfaces that they were made of, object units
        (``export.bodies.make_bodies``).
      budget: convex shapes of the object at most (``export.budget``), joined before limits are
        looked at; None: as many as there are.
      collision: what the shapes are. Boxes alone are not cut back by planes.

    ``provenance`` tells it all.
    """
    lines: tuple[str, ...] = ()
    if collision in ("merged", "boxes") and is_rough(obj):
        cells = as_cells(obj, meshes)
        cells, lines = carve(obj, cells.boxes_alone() if collision == "boxes" else cells)
        bodies = tuple(
            dataclasses.replace(body, shapes=shapes)
            for body, shapes in zip(bodies, cells.shapes(obj.scale), strict=True)
        )
    elif collision != "boxes":
        bodies, lines = clear(obj, bodies)
    if budget is not None:
        bodies = within_budget(obj, bodies, meshes, budget, boxes=collision == "boxes")
    obj, _ = refine(dataclasses.replace(obj, provenance=obj.provenance + lines), bodies)
    return obj, with_joints(bodies, obj)


def refine(
    obj: ArticulatedObject, bodies: Sequence[Body]
) -> tuple[ArticulatedObject, tuple[Refinement, ...]]:
    """The object with joints that can be moved without running into it.

    Args:
      obj: the object, in any units.
      bodies: [K] of its parts (``export.bodies.make_bodies``).

    Returns:
      The object (``provenance`` tells each change) and what was done to the joints that were not
      free; others are untouched.
    """
    collider = Collider(obj, bodies)
    lo, hi = obj.bounds
    side = float((hi - lo).max())
    limit = DEPTH_LIMIT * side * obj.scale
    given = obj.joints
    before: dict[int, float] = {}  # share that was free, of the parts that were not
    after: dict[int, float] = {}
    shift = np.zeros(len(obj.parts))
    for others in (np.zeros(len(obj.parts)), None):
        for k, part in enumerate(obj.parts):
            if part.parent < 0 or part.joint.type == "fixed" or after.get(k, 1.0) < MIN_FREE:
                continue
            state = obj.rest() if others is None else others
            if others is None and not state.any():
                continue  # what is at rest is as shown: done
            joint = obj.parts[k].joint
            sweep, free = _freest(collider, obj, k, limit, state)
            if free == joint.limits:
                continue
            if others is None and _share(free, given[k]) < MIN_FREE:
                continue  # what the first round did stands
            before.setdefault(k, _share(free, given[k]))
            best, moved = joint, 0.0
            for candidate, distance in _nearby(joint, side) if others is not None else ():
                other = sweep.free_range(candidate)
                if _share(other, joint) > _share(free, joint) + 1e-9:
                    best, free, moved = candidate, other, distance
            limited = _limited(best, free)
            same = (
                limited.type == joint.type or joint.type == "continuous"
            )  # no span fell into a dead zone
            after[k] = _share(free, given[k]) if same else 0.0
            if after[k] >= MIN_FREE:
                shift[k] += moved * obj.scale
                obj = _with_joint(obj, k, limited)
    done = []
    for k in sorted(before):
        unit = 1.0 if given[k].rotates else obj.scale
        first, last = given[k].limits, obj.parts[k].joint.limits
        done.append(
            Refinement(
                part=obj.parts[k].name,
                free_before=before[k],
                free_after=after[k],
                shift=float(shift[k]),
                limits_before=(first[0] * unit, first[1] * unit),
                limits_after=(last[0] * unit, last[1] * unit),
            )
        )
    lines = tuple(r.line for r in done)
    return dataclasses.replace(obj, provenance=obj.provenance + lines), tuple(done)


def _freest(
    collider: Collider, obj: ArticulatedObject, k: int, limit: float, state: np.ndarray
) -> tuple[_Sweep, tuple[float, float]]:
    """The joint's sweep and free range with all others at ``state``, or with those open that bar
    its way: a rack behind a door."""
    joint, opened = obj.parts[k].joint, obj.open()
    sweep = _Sweep(collider, obj, k, limit, state)
    free = sweep.free_range(joint)
    tried, bars = sweep, _barring(sweep)
    for _ in range(MAX_OPENED):
        if _share(free, joint) > 1 - 1e-9 or not bars:
            break
        state = state.copy()
        state[bars] = opened[bars]
        tried = _Sweep(collider, obj, k, limit, state)
        found = tried.free_range(joint)
        if _share(found, joint) > _share(free, joint) + 1e-9:
            sweep, free = tried, found
        bars = _barring(tried)
    return sweep, free


def _barring(sweep: _Sweep) -> list[int]:
    """Joints not open yet that carry a part which the sweep ran into, nearest first in the tree;
    not those that carry the swept part."""
    parts = sweep.obj.parts
    above, i = set(), sweep.k
    while i >= 0:
        above.add(i)
        i = parts[i].parent
    found = set()
    for part in sweep.hit - sweep.below:
        while part >= 0 and (parts[part].joint.type == "fixed" and part not in above):
            part = parts[part].parent
        if part >= 0 and part not in above and sweep.state[part] != sweep.obj.open()[part]:
            found.add(part)
    return sorted(found)


class _Sweep:
    """One joint of an object tried over its range, the other joints at ``state``. ``hit``: the
    parts that were in the way."""

    def __init__(
        self, collider: Collider, obj: ArticulatedObject, k: int, limit: float, state: np.ndarray
    ):
        self.collider, self.obj, self.k, self.limit = collider, obj, k, limit
        self.state, self.hit = state, set()
        self.below = subtrees(obj.parents)[k]
        self.base = collider.depths(np.tile(np.eye(4), (len(obj.parts), 1, 1)))  # as shown
        self.count = self._count(obj.parts[k].joint)

    def _count(self, joint: Joint) -> int:
        """How many states of the range to try, so that nothing thin is jumped over."""
        poses = self.obj.forward_kinematics(self.state)
        lo, hi = self.obj.bounds
        points = np.concatenate(
            [
                trimesh.transform_points(trimesh.bounds.corners(self.obj.parts[i].mesh.bounds), m)
                for i, m in enumerate(poses)
                if i in self.below
            ]
        )
        arm = np.linalg.norm(np.cross(points - joint.origin, joint.direction), axis=1).max()
        path = (joint.limits[1] - joint.limits[0]) * (arm if joint.rotates else 1.0)
        return int(np.clip(np.ceil(path / (STEP * float((hi - lo).max()))) + 1, *STATES))

    def depths(self, joint: Joint, q: float) -> dict[tuple[int, int], float]:
        """Metres between the sub-tree and all else, with ``joint`` at ``q``."""
        state = self.state.copy()
        state[self.k] = q
        joints = list(self.obj.joints)
        joints[self.k] = joint
        found = self.collider.depths(forward_kinematics(self.obj.parents, joints, state))
        return {pair: depth for pair, depth in found.items() if len(self.below & set(pair)) == 1}

    def free(self, joint: Joint, q: float) -> bool:
        """Whether nothing is deeper than as shown by more than the limit."""
        found = self.depths(joint, q).items()
        deep = [pair for pair, d in found if d - self.base.get(pair, 0.0) > self.limit]
        self.hit.update(*deep)
        return not deep

    def free_range(self, joint: Joint) -> tuple[float, float]:
        """The ends of the free states around the shown state 0; (0, 0) if that is not free
        itself."""
        lo, hi = joint.limits
        if not self.free(joint, 0.0):
            return 0.0, 0.0
        states = np.linspace(lo, hi, self.count)
        ends = [0.0, 0.0]
        for q in states[states > 0]:
            if not self.free(joint, q):
                break
            ends[1] = float(q)
        for q in states[states < 0][::-1]:
            if not self.free(joint, q):
                break
            ends[0] = float(q)
        return ends[0], ends[1]


def _share(free: tuple[float, float], joint: Joint) -> float:
    return (free[1] - free[0]) / (joint.limits[1] - joint.limits[0])


def _nearby(joint: Joint, side: float):
    """(joint, how far its axis was moved) of the axes around this one; nothing for joints that only
    travel."""
    if not joint.rotates:
        return
    u = np.cross(joint.direction, np.eye(3)[np.argmin(np.abs(joint.direction))])
    u /= np.linalg.norm(u)
    v = np.cross(joint.direction, u)
    for distance in SHIFTS:
        for angle in np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS:
            offset = distance * side * (np.cos(angle) * u + np.sin(angle) * v)
            yield dataclasses.replace(joint, origin=joint.origin + offset), distance * side


def _limited(joint: Joint, free: tuple[float, float]) -> Joint:
    """The joint with ``free`` as its limits; a screw keeps its pitch."""
    if free == joint.limits:
        return joint
    angle = free if joint.rotates else (0.0, 0.0)
    travel = (free[0] * joint.pitch, free[1] * joint.pitch) if joint.travels else (0.0, 0.0)
    return dataclasses.replace(joint, angle=angle, travel=travel)


def _with_joint(obj: ArticulatedObject, k: int, joint: Joint) -> ArticulatedObject:
    parts = list(obj.parts)
    parts[k] = dataclasses.replace(parts[k], joint=joint)
    return dataclasses.replace(obj, parts=tuple(parts))

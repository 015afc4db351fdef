"""Where a hand takes hold of a moving part, and which way opens it."""

from __future__ import annotations

import dataclasses
import re

import numpy as np

from uniart_jax.export.frames import rigid_groups
from uniart_jax.objects.object import ArticulatedObject

HANDLE = re.compile(r"handle|knob|grip|pull", re.IGNORECASE)
RIM = 0.95  # of the largest distance from the axis: points farther out are the rim
LEAST_LEVER = 1e-3  # metres


@dataclasses.dataclass(frozen=True)
class Handle:
    """Of one moving part.

    Attributes:
      part: index of the part that the point lies on: a handle fixed to the moving part, or that
        part.
      point: [3] object units, object frame at the shown state.
      lever: metres that the point goes for a unit of the joint's coordinate (rad, or m), as it
        turns or slides.
      opens: 1 if the coordinate grows from rest to open, else -1.
    """

    part: int
    point: np.ndarray
    lever: float
    opens: int


def opening(obj: ArticulatedObject, k: int, handle: Handle) -> np.ndarray:
    """[3] the direction (unit, object frame at the shown state) in which the handle of part k sets
    out when it opens; of a point on the axis of a hinge, the axis."""
    joint = obj.parts[k].joint
    way = joint.direction * joint.pitch
    if joint.rotates:
        way = way + np.cross(joint.direction, handle.point - joint.origin)
    length = float(np.linalg.norm(way))
    return handle.opens * (way / length if length > 1e-9 else joint.direction)


def handles(obj: ArticulatedObject) -> tuple[Handle | None, ...]:
    """[K] of every part that moves; None for the root and fixed parts.

    The middle of a part called a handle, knob, grip or pull that is fixed to it; else the middle of
    the rim farthest from a hinge's axis, of the part and what is fixed to it; of a slide the middle
    of the face that goes ahead when it opens.
    """
    rest, opened = obj.rest(), obj.open()
    leaders = rigid_groups(obj)
    return tuple(
        None
        if part.parent < 0 or part.joint.type == "fixed"
        else _handle(
            obj,
            k,
            [i for i, leader in enumerate(leaders) if leader == k],
            1 if opened[k] >= rest[k] else -1,
        )
        for k, part in enumerate(obj.parts)
    )


def _handle(obj: ArticulatedObject, k: int, own: list[int], opens: int) -> Handle:
    """Of part k; ``own``: it and the parts that are fixed to it."""
    joint = obj.parts[k].joint
    named = [
        i for i in own if i != k and HANDLE.search(f"{obj.parts[i].name} {obj.parts[i].label}")
    ]
    if named:
        held = named[0]
        point = obj.parts[held].mesh.bounds.mean(0)
    elif not joint.rotates:
        held, points = k, np.asarray(obj.parts[k].mesh.vertices)
        ahead, middle = opens * joint.direction, obj.parts[k].mesh.bounds.mean(0)
        point = middle + ahead * float((points @ ahead).max() - middle @ ahead)
    else:
        held = max(own, key=lambda i: _radii(obj, k, obj.parts[i].mesh.vertices).max())
        points = np.asarray(obj.parts[held].mesh.vertices)
        far = _radii(obj, k, points)
        point = _rim_middle(points, far, joint)
    lever = float(_radii(obj, k, point[None])[0]) * obj.scale if joint.rotates else 1.0
    return Handle(held, point, max(lever, LEAST_LEVER), opens)


def _rim_middle(points: np.ndarray, far: np.ndarray, joint) -> np.ndarray:
    """The point farthest from the axis, moved along the axis to the middle of the rim about it."""
    first = points[far.argmax()]
    rim = points[far >= RIM * far.max()] @ joint.direction
    return first + joint.direction * float((rim.min() + rim.max()) / 2 - first @ joint.direction)


def _radii(obj: ArticulatedObject, k: int, points) -> np.ndarray:
    """Distances of points [n, 3] from the axis of part k's joint."""
    joint = obj.parts[k].joint
    return np.linalg.norm(np.cross(np.asarray(points) - joint.origin, joint.direction), axis=1)

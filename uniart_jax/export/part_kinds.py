"""What a part is to its user, told by its shape and its joint: a door, a drawer, a knob.

No network knows such words. The rules hold at rest, with the front at -x:

    knob       turns about itself, small and round
    drum       turns without end inside the body, about any axis
    turntable  the same, flat and about an upright axis
    door       a plate that turns about one of its edges
    lid        the same, lying
    rack       slides out from behind a door
    button     small, slides a little way
    drawer     slides out of the front otherwise
    handle     fixed to a part that moves, before it

Anything else is called after its joint: hinge, slider, screw, fixed.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from uniart_jax.export.frames import moves, rigid_groups
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, bounds_at

AFTER_JOINT = {
    "revolute": "hinge",
    "continuous": "hinge",
    "prismatic": "slider",
    "screw": "screw",
    "fixed": "fixed",
}
# as they are listed in words
ORDER = (
    *("door", "lid", "drawer", "rack", "drum", "turntable", "hinge", "knob", "button"),
    *("slider", "screw"),
)
KNOB_SIZE = 0.15  # of the object's longest side, that a knob has at the most
ROUND = 0.7  # of the disc about the axis, that an outline fills at least (a square: .64)
ALONG = 0.9  # cosine to an axis, from which on a joint is along it
PLATE = 0.5  # of its second longest side, that a plate is thick at most
EDGE = 0.3  # of its width, that a hinge lies from the middle of a door at least
HANDLE = 0.3  # of the outline of what it opens, from the front, that a handle takes at most
FLAT = 0.4  # of its width, that a turntable is high at most
COVERED = 0.5  # of a rack's outline from the front, that a door is before at least
BUTTON, PRESS = 0.12, 0.03  # of the object's longest side: a button, and how far it goes, at most
WITHIN = 0.02  # of that side, that what is inside may reach beyond the body


def part_kinds(obj: ArticulatedObject) -> list[str]:
    """[K] words; "base" of the root."""
    rest = obj.rest()
    moved, boxes = obj.forward_kinematics(rest), bounds_at(obj, rest)
    plates = [k for k in range(len(obj.parts)) if _is_plate(obj, k, boxes[k], moved)]
    return [
        "base" if part.parent < 0 else _kind(obj, k, boxes, plates, moved)
        for k, part in enumerate(obj.parts)
    ]


def _kind(
    obj: ArticulatedObject, k: int, boxes: np.ndarray, plates: list[int], moved: np.ndarray
) -> str:
    """Of part k; boxes [K, 2, 3] and poses ``moved`` [K, 4, 4] of all parts at rest."""
    part, box, sides = obj.parts[k], boxes[k], np.ptp(boxes[k], axis=0)
    joint, along = part.joint, np.abs(moved[part.parent][:3, :3] @ part.joint.direction)
    size = float(np.ptp(boxes.reshape(-1, 3), axis=0).max())
    if joint.type == "fixed":
        leader = rigid_groups(obj)[k]
        before = moves(obj.parts[leader]) and box[0, 0] < boxes[leader, 0, 0]
        small = sides[1:].prod() <= HANDLE * np.ptp(boxes[leader], axis=0)[1:].prod()
        return "handle" if before and small else "fixed"
    if joint.type in ("revolute", "continuous") and is_knob(obj, k):
        return "knob"
    if k in plates:
        return "lid" if sides.argmin() == 2 else "door"
    if joint.type == "continuous" and _is_within(box, boxes[0], size):
        lying = sides[2] <= FLAT * sides[:2].max() and along[2] >= ALONG
        return "turntable" if lying else "drum"
    if joint.type == "prismatic" and along[0] >= ALONG:
        travel = abs(joint.travel[1] - joint.travel[0])
        if sides[1:].max() <= BUTTON * size and travel <= PRESS * size:
            return "button"
        return "rack" if any(_before(boxes[j], box) for j in plates) else "drawer"
    return AFTER_JOINT[joint.type]


def _is_plate(obj: ArticulatedObject, k: int, box: np.ndarray, moved: np.ndarray) -> bool:
    """Whether part k, in a box [2, 3] at rest, is a plate that turns about one of its edges."""
    part, sides = obj.parts[k], np.ptp(box, axis=0)
    if part.parent < 0 or part.joint.type != "revolute":
        return False
    pose = moved[part.parent]
    axis, origin = pose[:3, :3] @ part.joint.direction, pose[:3, :3] @ part.joint.origin
    thin, about = int(sides.argmin()), int(np.abs(axis).argmax())
    if abs(axis[about]) < ALONG or thin == about or sides[thin] > PLATE * np.sort(sides)[1]:
        return False
    across = 3 - thin - about
    from_middle = origin[across] + pose[across, 3] - box[:, across].mean()
    return bool(abs(from_middle) >= EDGE * sides[across])


def _is_within(box: np.ndarray, body: np.ndarray, size: float) -> bool:
    """Whether a box [2, 3] lies in the body's."""
    room = WITHIN * size
    return bool((box[0] >= body[0] - room).all() and (box[1] <= body[1] + room).all())


def _before(door: np.ndarray, box: np.ndarray) -> bool:
    """Whether a door [2, 3] closes the way of a box to the front."""
    if door[0, 0] >= box[0, 0]:
        return False
    low, high = np.maximum(door[0, 1:], box[0, 1:]), np.minimum(door[1, 1:], box[1, 1:])
    shared = np.maximum(high - low, 0).prod()
    return bool(shared >= COVERED * np.ptp(box, axis=0)[1:].prod())


def is_knob(obj: ArticulatedObject, k: int) -> bool:
    """Whether part k turns about an axis through itself and is small and round about it."""
    part = obj.parts[k]
    if not moves(part) or part.joint.type not in ("revolute", "continuous"):
        return False
    points = np.asarray(part.mesh.vertices)
    size = float(np.ptp(obj.bounds, axis=0).max())
    if float(np.ptp(points, axis=0).max()) > KNOB_SIZE * size:
        return False
    return is_round(points, part.joint)


def is_round(points: np.ndarray, joint: Joint) -> bool:
    """Whether the outline of points [n, 3] fills most of the disc about a joint's axis."""
    axis = joint.direction
    across = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    across /= np.linalg.norm(across)
    flat = (points - joint.origin) @ np.stack([across, np.cross(axis, across)], 1)
    try:
        outline = ConvexHull(flat).volume  # of a plane's points: the area
    except QhullError:  # a line
        return False
    return bool(outline >= ROUND * np.pi * np.square(flat).sum(1).max())

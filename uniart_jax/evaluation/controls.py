"""The truth with one planted mistake: what a figure says of these tells whether it sees the
mistake.

Every control is a function of an object. It shows the object at rest, in its own units
(``metric.resting``), and leaves the geometry there as it is, except ``missing_part``; so a figure
of the rest state must call all others perfect, and a figure of articulated states must not.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from uniart_jax.evaluation.metric import resting
from uniart_jax.objects.kinematics import Joint, subtrees
from uniart_jax.objects.object import ArticulatedObject, Part

# of the part's width, from its centre: a hinge nearer the middle (a knob's) has no other side
AT_A_SIDE = 0.25


def exact(obj: ArticulatedObject) -> ArticulatedObject:
    """The truth itself, at rest."""
    return resting(obj)


def rest_only(obj: ArticulatedObject) -> ArticulatedObject:
    """Nothing moves."""
    return _with_joints(obj, lambda part: Joint.fixed())


def mirrored(obj: ArticulatedObject) -> ArticulatedObject:
    """Every motion reversed about rest: doors open inwards, drawers go in; what turns for ever has
    no wrong way. Twice: the truth."""
    return _with_joints(obj, _reversed)


def _reversed(part: Part) -> Joint:
    joint = part.joint
    if joint.type == "continuous":
        return joint
    return dataclasses.replace(joint, direction=-joint.direction)


def half_range(obj: ArticulatedObject) -> ArticulatedObject:
    """Every joint goes half as far; a continuous one has no end and stays."""
    return _with_joints(obj, _halved)


def wrong_hinge_side(obj: ArticulatedObject) -> ArticulatedObject:
    """Every hinge at the part's other side, the part still opening the same way; axes through its
    middle (``AT_A_SIDE``) stay."""
    return _with_joints(obj, _other_side)


def missing_part(obj: ArticulatedObject) -> ArticulatedObject:
    """Without the moving part that has the largest box's diagonal, and all that hangs on it; as it
    was where nothing moves."""
    obj = resting(obj)
    moving = [k for k, part in enumerate(obj.parts) if part.joint.type != "fixed"]
    if not moving:
        return obj
    gone = subtrees(obj.parents)[max(moving, key=lambda k: np.linalg.norm(obj.boxes[k, 3:]))]
    kept = [k for k in range(len(obj.parts)) if k not in gone]
    position = {old: new for new, old in enumerate(kept)}
    parts = (
        dataclasses.replace(obj.parts[k], parent=position.get(obj.parts[k].parent, -1))
        for k in kept
    )
    return dataclasses.replace(obj, parts=tuple(parts))


CONTROLS: dict[str, Callable[[ArticulatedObject], ArticulatedObject]] = {
    "exact": exact,
    "rest_only": rest_only,
    "mirrored": mirrored,
    "half_range": half_range,
    "wrong_hinge_side": wrong_hinge_side,
    "missing_part": missing_part,
}


def changed(control: ArticulatedObject, truth: ArticulatedObject) -> bool:
    """Whether the control planted anything: an object without a side hinge has none to move."""
    if len(control.parts) != len(truth.parts):
        return True
    pairs = zip(control.joints, resting(truth).joints, strict=True)
    return not all(np.allclose(_numbers(a), _numbers(b), atol=1e-6) for a, b in pairs)


def _numbers(joint: Joint) -> np.ndarray:
    return np.concatenate([joint.origin, joint.direction, joint.angle, joint.travel])


def _with_joints(obj: ArticulatedObject, change: Callable[[Part], Joint]) -> ArticulatedObject:
    """At rest, with the joint of every part that moves replaced."""
    obj = resting(obj)
    parts = (
        part if part.joint.type == "fixed" else dataclasses.replace(part, joint=change(part))
        for part in obj.parts
    )
    return dataclasses.replace(obj, parts=tuple(parts))


def _halved(part: Part) -> Joint:
    joint = part.joint
    if joint.type == "continuous":
        return joint
    (a0, a1), (t0, t1) = joint.angle, joint.travel
    return dataclasses.replace(joint, angle=(a0 / 2, a1 / 2), travel=(t0 / 2, t1 / 2))


def _other_side(part: Part) -> Joint:
    """Mirrored in the plane through the box's centre from which the axis is farthest: a mirror
    turns the rotation round with it."""
    joint, center, size = part.joint, part.box[:3], part.box[3:]
    if joint.type != "revolute":
        return joint
    away = joint.origin - center
    away -= (away @ joint.direction) * joint.direction
    axis = int(np.argmax(np.abs(away)))
    if abs(away[axis]) < AT_A_SIDE * size[axis]:
        return joint
    matrix = np.eye(4)
    matrix[axis, axis], matrix[axis, 3] = -1.0, 2 * center[axis]
    return joint.transformed(matrix)

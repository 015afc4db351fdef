"""How a part that stands ajar lies closed: the frame in which boards of parts are told.

A part closes at the end of its hinge's range where the box around it and the body is smaller. Shown
less than ``STRAIGHT`` from there it lies as it is shown, as does all that turns on no hinge along
an axis. A part whose parent stands ajar is not turned with it. ``xp``: the array namespace, numpy
or jax.numpy. No jax here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.joint_code import FIXED_AXIS, box_corners, encode_joint

STRAIGHT = float(np.deg2rad(2.5))
TURNS = 0.25  # |tau| of a hinge's code at most
ENDLESS = 1.5  # of pi: a part that turns by more is no door
ALONG = 0.99  # least cosine between the hinge and an axis
ARM = 0.05  # object units that a box's middle goes at least; else it is a knob
PLATE = 0.08  # thickness over width of a door, assumed where its size is read off the box around it
THINNEST = 0.01  # object units


def closing(codes: Any, boxes: Any, body: Any, xp: Any = np) -> tuple[Any, Any]:
    """The motion that closes each part.

    Args:
      codes: [..., 9] joint codes (``voxels.joint_code``), any gauge. boxes: [..., 6] corners of the
        box around each part as it is shown, object units. body: [..., 6] of the body's, or one that
        broadcasts.

    Returns:
      [..., 3, 4] rigid motions about the hinges, object units, the identity of what does not stand
      ajar; and their angles [...], radians.
    """
    codes, boxes = xp.asarray(codes), xp.asarray(boxes)
    line, moment = codes[..., 1:4], codes[..., 4:7]
    length = xp.sqrt((line**2).sum(-1, keepdims=True) + 1e-12)
    axis, moment = line / length, moment / length
    point = xp.cross(axis, moment)
    # limits bracket 0, as ``joint_code.decode_joint`` has them
    ends = xp.stack([xp.minimum(codes[..., 7], 0.0), xp.maximum(codes[..., 8], 0.0)], -1)
    angles = ends * (np.pi * xp.cos(codes[..., :1] * (np.pi / 2)))
    body = xp.broadcast_to(xp.asarray(body), boxes.shape)
    centre = (boxes[..., :3] + boxes[..., 3:]) / 2
    motions = [_rigid(axis, point, angles[..., k], xp) for k in range(2)]
    volumes, places = [], []
    for k, motion in enumerate(motions):
        closed = closed_boxes(motion, angles[..., k], codes, boxes, xp)
        lower = xp.minimum(closed[..., :3], body[..., :3])
        upper = xp.maximum(closed[..., 3:], body[..., 3:])
        volumes.append(xp.maximum(upper - lower, THINNEST).prod(-1))
        places.append(moved(motion, centre))
    angle = xp.where(volumes[1] < volumes[0], angles[..., 1], angles[..., 0])
    hinged = (xp.abs(codes[..., 0]) < TURNS) & (length[..., 0] > FIXED_AXIS)
    hinged &= ((places[1] - places[0]) ** 2).sum(-1) > ARM**2
    hinged &= (xp.abs(ends[..., 1] - ends[..., 0]) < ENDLESS) & (xp.abs(axis).max(-1) > ALONG)
    angle = xp.where(hinged & (xp.abs(angle) > STRAIGHT), angle, 0.0)
    return _rigid(axis, point, angle, xp), angle


def closing_of(joints: Sequence[Joint], boxes: np.ndarray, parents: Sequence[int]) -> np.ndarray:
    """The motions [K, 3, 4] that close parts as a table has them: ``boxes`` [K, 6] centre and size,
    ``parents`` -1 for the root."""
    corners = box_corners(np.asarray(boxes, np.float64))
    codes = [encode_joint(joint, box[:3]) for joint, box in zip(joints, boxes, strict=True)]
    motions, _ = closing(np.stack(codes), corners, corners[list(parents).index(-1)])
    return np.asarray(motions)


def closed_boxes(motions: Any, angles: Any, codes: Any, boxes: Any, xp: Any = np) -> Any:
    """[..., 6] corners of about the box around each part once it is closed.

    The size of a door is read off the box around it ajar, for a plate that is ``PLATE`` of its
    width thick. Exact for what is shown closed.
    """
    codes, boxes = xp.asarray(codes), xp.asarray(boxes)
    centre, size = (boxes[..., :3] + boxes[..., 3:]) / 2, boxes[..., 3:] - boxes[..., :3]
    closed = moved(motions, centre)
    line = xp.abs(codes[..., 1:4])
    hinge = line >= line.max(-1, keepdims=True)
    across = xp.where(hinge, 0.0, size)
    sin, cos = xp.abs(xp.sin(angles))[..., None], xp.abs(xp.cos(angles))[..., None]
    wide = xp.sqrt((across**2).sum(-1, keepdims=True) / (1 + PLATE**2 + 4 * PLATE * sin * cos))
    thick = xp.maximum(across.sum(-1, keepdims=True) / (sin + cos) - wide, THINNEST)
    # it is wide along the arm from its hinge to its middle
    point = xp.cross(codes[..., 1:4], codes[..., 4:7])
    point = point / xp.maximum((codes[..., 1:4] ** 2).sum(-1, keepdims=True), 1e-12)
    arm = xp.where(hinge, 0.0, xp.abs(closed - point))
    along = arm >= arm.max(-1, keepdims=True)
    new = xp.where(hinge, size, xp.where(along, wide, thick))
    new = xp.where((angles == 0)[..., None], size, new)
    return xp.concatenate([closed - new / 2, closed + new / 2], -1)


def moved(motions: Any, points: Any) -> Any:
    """Points [..., 3] after motions [..., 3, 4]."""
    return (motions[..., :3] * points[..., None, :]).sum(-1) + motions[..., 3]


def undone(motions: Any, xp: Any = np) -> Any:
    """The inverse [..., 3, 4] of rigid motions."""
    back = xp.swapaxes(motions[..., :3], -1, -2)
    offset = -(back * motions[..., None, :, 3]).sum(-1)
    return xp.concatenate([back, offset[..., None]], -1)


def _rotated(axis: Any, angle: Any, vector: Any, xp: Any) -> Any:
    """A vector [..., 3] turned about a unit axis [..., 3] by an angle [...] (Rodrigues)."""
    sin, cos = xp.sin(angle)[..., None], xp.cos(angle)[..., None]
    vector = xp.broadcast_to(xp.asarray(vector), axis.shape)
    along = (axis * vector).sum(-1, keepdims=True) * axis
    return cos * vector + sin * xp.cross(axis, vector) + (1 - cos) * along


def _rigid(axis: Any, point: Any, angle: Any, xp: Any) -> Any:
    """[..., 3, 4] turn by an angle [...] about the line through a point [..., 3]."""
    columns = [_rotated(axis, angle, row, xp) for row in np.eye(3, dtype=np.float32)]
    rotation = xp.stack(columns, -1)
    offset = point - (rotation * point[..., None, :]).sum(-1)
    return xp.concatenate([rotation, offset[..., None]], -1)

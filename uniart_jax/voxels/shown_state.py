"""Parts of a layout that are told at rest, put where a picture shows them: each joint may say at
which angle or travel it is ``"shown"``."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import trimesh

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.joint_code import box_corners
from uniart_jax.voxels.opening_direction import round_about
from uniart_jax.voxels.panel_table import FLAT, Panels, is_plate
from uniart_jax.voxels.revolution_table import Revolution

TILTED = 1e-3  # of a direction's cosine: a solid of revolution that is turned by more is none


def at_shown(
    boxes: np.ndarray,
    joints: Sequence[Joint],
    parents: Sequence[int],
    shown: Sequence[float],
    outlines: Sequence[Revolution | None] = (),
) -> tuple[np.ndarray, list[Joint], np.ndarray]:
    """Boxes and joints where the joints stand at ``shown``.

    Args:
      boxes: [K, 6] centre and size, at rest. joints: at rest, in the same frame. parents: rows, -1
        for the root. shown: K coordinates, radians or, of slides, lengths. outlines: of parts that
        are round: those that turn about their own axis, as knobs do, keep their boxes.

    Returns:
      The boxes around the moved boxes, joints whose coordinate 0 is what is shown, and the motions
      [K, 4, 4] of the parts.
    """
    motions: dict[int, np.ndarray] = {-1: np.eye(4)}

    def motion(k: int) -> np.ndarray:
        if k not in motions:
            motions[k] = motion(parents[k]) @ joints[k].motion(shown[k])
        return motions[k]

    moves = np.array([motion(k) for k in range(len(joints))])
    ends = box_corners(np.asarray(boxes, np.float64)).reshape(-1, 2, 3)
    corners = np.array([trimesh.bounds.corners(of_box) for of_box in ends])  # [K, 8, 3]
    for k, (box, joint, parent) in enumerate(zip(boxes, joints, parents, strict=True)):
        if _spins(box, joint, outlines[k] if outlines else None):  # its own turn is undone
            own = moves[k, :3, :3].T @ motions[parent][:3, :3]
            corners[k] = (corners[k] - box[:3]) @ own.T + box[:3]
    corners = np.einsum("kij,kcj->kci", moves[:, :3, :3], corners) + moves[:, None, :3, 3]
    low, high = corners.min(1), corners.max(1)
    moved = [
        _counted_from(joint, q).transformed(motions[parent])
        for joint, q, parent in zip(joints, shown, parents, strict=True)
    ]
    return np.concatenate([(low + high) / 2, high - low], 1), moved, moves


def _spins(box: np.ndarray, joint: Joint, outline: Revolution | None) -> bool:
    """Whether a part is round about the axis that it turns about."""
    if not joint.rotates:
        return False
    if outline is not None:
        return abs(joint.direction[outline.axis]) > 1 - TILTED
    return round_about(box[:3], box[3:], joint) is not None


def moved_revolution(outline: Revolution | None, motion: np.ndarray) -> Revolution | None:
    """The outline of a part after a rigid motion [4, 4]; None where it is tilted then."""
    if outline is None or abs(motion[outline.axis, outline.axis] - 1) > TILTED:
        return None
    across = [i for i in range(3) if i != outline.axis]
    point = np.zeros(3)
    point[across] = outline.center
    center = (motion[:3, :3] @ point + motion[:3, 3])[across]
    return dataclasses.replace(outline, center=center)


def moved_boards(own: Panels | None, motion: np.ndarray) -> Panels | None:
    """The boards of a part after a rigid motion [4, 4]; those of one that turns stay as they are at
    rest, and know the motion."""
    if own is None or np.abs(motion - np.eye(4)).max() < 1e-9:
        return own
    if np.abs(motion[:3, :3] - np.eye(3)).max() > TILTED:
        return dataclasses.replace(own, motion=motion)
    return dataclasses.replace(own, boxes=own.boxes + np.tile(motion[:3, 3], 2))


def usual_plates(
    boxes: np.ndarray, joints: Sequence[Joint], shown: Sequence[float], units: str
) -> list[Panels | None]:
    """The boards of flat parts, as lids and doors, that are told at rest and shown turned: each is
    one plate, which voxels draw ragged; None of other parts. ``boxes`` [K, 6]: at rest."""
    found: list[Panels | None] = []
    for box, joint, q in zip(boxes, joints, shown, strict=True):
        flat = is_plate(box[3:], FLAT if units == "m" else np.inf)
        turned = bool(q) and joint.type == "revolute"
        plate = Panels(box_corners(box)[None], 1.0, estimate=False)
        found.append(plate if flat and turned else None)
    return found


def _counted_from(joint: Joint, q: float) -> Joint:
    """The joint at rest whose coordinate is ``q`` less: its range is counted from there."""
    if not q:
        return joint
    angle = tuple(a - q for a in joint.angle) if joint.rotates else joint.angle
    travel = tuple(t - joint.pitch * q for t in joint.travel)
    return dataclasses.replace(joint, angle=angle, travel=travel)

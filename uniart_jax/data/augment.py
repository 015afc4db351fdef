"""Augmentation on stored types: of boxes and joint codes, so that it can be checked, and of whole
records, so that it is cheap.

Each function here and its twin on objects commute with recording, but for ``redraw_joints``, which
has none: the mesh contradicts what it says.

| on objects | here | exact for |
|---|---|---|
| ``objects.perturb.scale_parts`` | ``scale_codes`` | boxes, codes; voxels have to be made again (``data.live``) |
| ``objects.perturb.recolor_parts`` | ``recolor_record`` | records; where colours vary over a face, to the rounding of textures |
| ``ArticulatedObject.transformed`` (mirror) | ``data.mirror`` | records |
| ``ArticulatedObject.transformed`` (scale and shift), ``normalized`` | ``move_codes`` | boxes, codes |
| ``ArticulatedObject.shown_at`` | ``shown_codes`` | codes, given the boxes' new centres: the box of a turned part does not follow from its box before |

With phi = pi tau / 2, travel stretched by s turns the line of a code's motion in the plane (angle /
pi, KAPPA * travel):

    tau' = 2 / pi * atan2(s sin phi, cos phi),     (lo', hi') = (lo, hi) * sqrt(cos^2 phi + s^2 sin^2 phi)          (1)

Units: object units, radians. No picture follows a record here: for batches that show none.
"""  # noqa: E501

from __future__ import annotations

import dataclasses

import numpy as np

from uniart_jax.data.records import Record
from uniart_jax.objects.appearance import gain_tables
from uniart_jax.objects.kinematics import ANGLE_DEAD_ZONE, TRAVEL_DEAD_ZONE, forward_kinematics
from uniart_jax.objects.perturb import checked_factors, draw_joint, material_maps, touching_point
from uniart_jax.voxels.joint_code import (
    CODE_SIZE,
    FULL_TURN,
    KAPPA,
    box_corners,
    decode_joint,
    encode_joint,
)


def scale_codes(
    boxes: np.ndarray, codes: np.ndarray, parents: np.ndarray, factors: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Boxes and codes of ``scale_parts``'s object, normalised again.

    Args:
      boxes: [K, 6]. codes: [K, 9] true, canonical codes. parents: [K], parents first; the root is
        its own parent.
      factors: [K] or [K, 3]; such that no axis turns, as ``objects.perturb.part_factors`` draws
        them.

    Returns:
      boxes [K, 6], codes [K, 9], float64.
    """
    factors = checked_factors(factors, len(boxes))
    boxes, codes = np.asarray(boxes, np.float64), np.asarray(codes, np.float64)
    direction = codes[:, 1:4]
    anchors = np.stack([touching_point(boxes[k], boxes[p]) for k, p in enumerate(parents)])
    point = np.cross(direction, codes[:, 4:7])
    along = ((boxes[:, :3] - point) * direction).sum(-1, keepdims=True)
    turns = _turns(codes)[:, None]
    anchors = np.where(turns, point + along * direction, anchors)
    stretch, shift = material_maps(anchors, parents, factors)
    scaled = np.concatenate([stretch * boxes[:, :3] + shift, stretch * boxes[:, 3:]], 1)
    place = np.where(turns, stretch * anchors + shift, scaled[:, :3])
    moments = np.cross(place, direction)
    codes = np.concatenate([codes[:, :4], moments, codes[:, 7:]], 1)
    codes = _stretched(codes, (direction**2 * stretch).sum(-1))
    corners = box_corners(scaled)
    lo, hi = corners[:, :3].min(0), corners[:, 3:].max(0)
    side = (hi - lo).max()
    scaled, codes = move_codes(scaled, codes, 1 / side, -(lo + hi) / (2 * side))
    return scaled, snap_codes(codes)


def move_codes(
    boxes: np.ndarray, codes: np.ndarray, factor: float, shift: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Boxes [K, 6] and codes [K, 9], float64, of the object after x -> factor * x + shift."""
    boxes, codes = np.asarray(boxes, np.float64), np.asarray(codes, np.float64)
    boxes = boxes * factor + np.concatenate([shift, np.zeros(3)])
    moments = factor * codes[:, 4:7] + np.cross(shift, codes[:, 1:4])
    codes = np.concatenate([codes[:, :4], moments, codes[:, 7:]], 1)
    return boxes, _stretched(codes, np.full(len(codes), factor))


def snap_codes(codes: np.ndarray) -> np.ndarray:
    """True codes [K, 9] after their object was normalised: travel below the dead zone is none, as
    ``Joint`` has it."""
    codes = codes.copy()
    phi = codes[:, 0] * (np.pi / 2)
    span = codes[:, 8] - codes[:, 7]
    lost = np.abs(span * np.sin(phi)) / KAPPA < TRAVEL_DEAD_ZONE * (1 - 1e-9)
    turns = _turns(codes)
    codes[lost & ~turns] = 0
    was_screw = lost & turns & (codes[:, 0] != 0)
    codes[was_screw, 7:] *= np.cos(phi[was_screw, None])
    codes[was_screw, 0] = 0
    codes[was_screw & (codes[:, 8] - codes[:, 7] >= FULL_TURN - 1e-9), 7:] = (-1, 1)
    return codes


def shown_codes(
    boxes: np.ndarray, codes: np.ndarray, parents: np.ndarray, q: np.ndarray, centers: np.ndarray
) -> np.ndarray:
    """Codes of the object shown at another state.

    Args:
      boxes: [K, 6], codes: [K, 9], parents: [K] as in ``scale_codes``, of the state shown before.
      q: [K] coordinates of ``decode_joint``'s joints: along canonical directions.
      centers: [K, 3] centres of the parts' own boxes at the new state; they anchor the lines of
        pure travel.

    Returns:
      [K, 9] float64.
    """
    joints = [decode_joint(code, box[:3]) for code, box in zip(codes, boxes, strict=True)]
    tree = [-1 if p == k else int(p) for k, p in enumerate(parents)]
    moved = forward_kinematics(tree, joints, q)
    shown = np.zeros((len(joints), CODE_SIZE))
    for k, parent in enumerate(tree):
        if parent >= 0:
            joint = joints[k].shown_at(float(q[k])).transformed(moved[parent])
            shown[k] = encode_joint(joint, centers[k])
    return shown


def recolor_record(record: Record, gains: np.ndarray) -> Record:
    """The record of ``recolor_parts``'s object, without pictures of it: the linear RGB of each
    sub-cell times its part's ``gains`` [K, 3], clipped."""
    tables = gain_tables(gains)
    color = tables[record.owner[..., None], np.arange(3), record.color]
    return dataclasses.replace(record, color=color)


def redraw_joints(record: Record, share: float, rng: np.random.Generator) -> Record:
    """The record with other joints on each of its parts but the root with probability ``share``:
    any joint (``objects.perturb.draw_joint``) to any part before it, whatever its mesh says.
    Voxels, boxes and ``meta`` stay. Of a record as ``records.from_object`` makes it: parents first,
    one root."""
    codes, parents = record.codes.copy(), record.parents.copy()
    for k in range(len(codes)):
        if parents[k] != k and rng.random() < share:
            joint = draw_joint(record.boxes[k], rng)
            codes[k] = encode_joint(joint, record.boxes[k, :3])
            parents[k] = rng.integers(k)
    return dataclasses.replace(record, codes=codes, parents=parents)


def _turns(codes: np.ndarray) -> np.ndarray:
    """[K] bool: true codes of joints that rotate; a true span is 0 or above the dead zone."""
    angle = (codes[:, 8] - codes[:, 7]) * np.cos(codes[:, 0] * (np.pi / 2)) * np.pi
    return np.abs(angle) > ANGLE_DEAD_ZONE / 2


def _stretched(codes: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Equation (1) with s = ``by`` [K]."""
    phi = codes[:, 0] * (np.pi / 2)
    x, y = np.cos(phi), by * np.sin(phi)
    codes = codes.copy()
    codes[:, 0] = 2 / np.pi * np.arctan2(y, x)
    codes[:, 7:] *= np.hypot(x, y)[:, None]
    return codes

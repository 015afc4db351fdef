"""How much several samples of one image agree, joint by joint: a spread, as a hint of what the
image leaves open.

It is the model's own spread. Samples can agree on what is wrong, and a model that was asked for few
solver steps is near its mean and spreads less.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from uniart_jax.evaluation.parts import match_parts
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.objects.thresholds import FOUND

HINGES = ("revolute", "continuous")  # one kind of axis: only limits tell them apart


def joint_spread(samples: Sequence[ArticulatedObject], index: int) -> dict[str, Any]:
    """Agreement of all samples with each joint of sample ``index``; plain JSON values.

    Args:
      samples: N objects of one image, in one frame (the sampled grid's), as sampled.

    Returns:
      {"samples": N, "parts": [N] how many each has, "missing": [N] types of the moving joints of
      each that this sample has no part for,
      "joints": {part: figures}}, the part's name as in its object, the root left out. Figures:
        matched: samples with a part whose box is within ``FOUND`` of this one's (L-infinity of
          corners, one to one), itself counted.
        type_share: of those, the share with a joint of the same type.
        axis_degrees, pivot_object_units, pitch_object_units, lower_std, upper_std: standard
        deviations (n - 1) over the samples that match with the
          same type (axis and pivot of a revolute or continuous joint: either of them); None with
          fewer than two of them, and where a joint has no such thing. The axis is a line without
          sign, as seen from the mean axis; the pivot is the point of the axis nearest to this
          part's box centre; the pitch is a screw's travel a radian; limits belong to this joint's
          direction, so that a part that opens the other way shows there.
        limits_unit: "radians" or "object units".
    """
    own = samples[index]
    matches = [match_parts(other.boxes, own.boxes) for other in samples]
    missing = []
    for other, (match, distance) in zip(samples, matches, strict=True):
        here = set(match[distance < FOUND].tolist())
        rest = [p.joint.type for j, p in enumerate(other.parts) if p.parent >= 0 and j not in here]
        missing.append([kind for kind in rest if kind != "fixed"])
    joints = {}
    for k, part in enumerate(own.parts):
        if part.parent < 0:
            continue
        found = [
            other.parts[match[k]]
            for other, (match, distance) in zip(samples, matches, strict=True)
            if distance[k] < FOUND
        ]
        moved = [p.joint for p in found if p.parent >= 0]
        alike = [joint for joint in moved if joint.type == part.joint.type]
        turning = [j for j in moved if j.type in HINGES] if part.joint.type in HINGES else alike
        joints[part.name] = {
            "matched": len(found),
            "type_share": len(alike) / len(found),
            **_of_lines(part.joint, turning, part.box[:3]),
            **_of_limits(part.joint, alike),
        }
    return {
        "samples": len(samples),
        "parts": [len(sample.parts) for sample in samples],
        "missing": missing,
        "joints": joints,
    }


def _of_lines(own: Joint, joints: Sequence[Joint], center: np.ndarray) -> dict[str, float | None]:
    """Standard deviations of the axes of ``joints``, as lines, about their mean."""
    figures: dict[str, float | None] = {"axis_degrees": None, "pivot_object_units": None}
    if own.type == "fixed" or len(joints) < 2:
        return figures
    directions = np.stack([j.direction for j in joints])
    _, _, axes = np.linalg.svd(directions)  # the first is the line nearest to all of them
    across = np.linalg.norm(np.cross(directions, axes[0]), axis=1)
    figures["axis_degrees"] = _rooted(np.degrees(np.arctan2(across, np.abs(directions @ axes[0]))))
    if own.rotates:
        origins = np.stack([j.origin for j in joints])
        along = ((center - origins) * directions).sum(1, keepdims=True)
        points = origins + along * directions
        figures["pivot_object_units"] = _rooted(np.linalg.norm(points - points.mean(0), axis=1))
    return figures


def _of_limits(own: Joint, joints: Sequence[Joint]) -> dict[str, Any]:
    """Standard deviations of pitch and limits of ``joints``, all of ``own``'s type."""
    bounded = own.type in ("revolute", "prismatic", "screw")
    figures: dict[str, Any] = {
        "pitch_object_units": None,
        "lower_std": None,
        "upper_std": None,
        "limits_unit": ("radians" if own.rotates else "object units") if bounded else None,
    }
    if len(joints) < 2 or not bounded:
        return figures
    if own.type == "screw":  # of either direction's sign the same
        figures["pitch_object_units"] = float(np.std([j.pitch for j in joints], ddof=1))
    same = [j.direction @ own.direction >= 0 for j in joints]
    limits = np.array(
        [j.limits if s else (-j.limits[1], -j.limits[0]) for j, s in zip(joints, same, strict=True)]
    )
    lower, upper = limits.std(0, ddof=1)
    return figures | {"lower_std": float(lower), "upper_std": float(upper)}


def _rooted(deviations: np.ndarray) -> float:
    return float(np.sqrt(np.square(deviations).sum() / (len(deviations) - 1)))

"""How much several samples of one image agree, joint by joint: a spread, as a hint of what the image leaves open.

It is the model's own spread. Samples can agree on what is wrong, and a model that was asked for few solver steps is near its mean and spreads less.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from uniart_jax.evaluation.parts import FOUND, match_parts
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject


def joint_spread(samples: Sequence[ArticulatedObject], index: int) -> dict[str, Any]:
    """Agreement of all samples with each joint of sample ``index``; plain JSON values.

    Args:
      samples: N objects of one image, in one frame (the sampled grid's), as sampled.

    Returns:
      {"samples": N, "joints": {part: figures}}, the part's name as in its object, the root left out. Figures:
        matched: samples with a part whose box is within ``FOUND`` of this one's (L-infinity of corners, one to one), itself counted.
        type_share: of those, the share with a joint of the same type.
        axis_degrees, pivot_object_units, lower, upper: standard deviations (n - 1) over the samples that match with the same type; None
          with fewer than two of them, and where a joint has no such thing. The axis is a line without sign, as seen from the mean axis;
          the pivot is the point of the axis nearest to this part's box centre; limits belong to this joint's direction, so that a part that
          opens the other way shows there.
        limits_unit: "degrees" or "object units".
    """
    own = samples[index]
    matches = [match_parts(other.boxes, own.boxes) for other in samples]
    joints = {}
    for k, part in enumerate(own.parts):
        if part.parent < 0:
            continue
        found = [
            other.parts[match[k]]
            for other, (match, distance) in zip(samples, matches, strict=True)
            if distance[k] < FOUND
        ]
        alike = [p.joint for p in found if p.parent >= 0 and p.joint.type == part.joint.type]
        joints[part.name] = {
            "matched": len(found),
            "type_share": len(alike) / len(found),
            **_deviations(part.joint, alike, part.box[:3]),
        }
    return {"samples": len(samples), "joints": joints}


def _deviations(own: Joint, joints: Sequence[Joint], center: np.ndarray) -> dict[str, Any]:
    """Standard deviations of ``joints``, all of ``own``'s type, about their mean."""
    bounded = own.type in ("revolute", "prismatic", "screw")
    figures: dict[str, Any] = {
        "axis_degrees": None,
        "pivot_object_units": None,
        "lower": None,
        "upper": None,
        "limits_unit": ("degrees" if own.rotates else "object units") if bounded else None,
    }
    if own.type == "fixed" or len(joints) < 2:
        return figures
    directions = np.stack([j.direction for j in joints])
    _, _, axes = np.linalg.svd(directions)  # the first is the line nearest to all of them
    across = np.linalg.norm(np.cross(directions, axes[0]), axis=1)
    angles = np.degrees(np.arctan2(across, np.abs(directions @ axes[0])))
    figures["axis_degrees"] = _rooted(angles)
    if own.rotates:
        origins = np.stack([j.origin for j in joints])
        along = ((center - origins) * directions).sum(1, keepdims=True)
        points = origins + along * directions
        figures["pivot_object_units"] = _rooted(np.linalg.norm(points - points.mean(0), axis=1))
    if bounded:
        limits = np.array(
            [j.limits if j.direction @ own.direction >= 0 else (-j.limits[1], -j.limits[0]) for j in joints]
        )  # fmt: skip
        lower, upper = (np.degrees(limits) if own.rotates else limits).std(0, ddof=1)
        figures |= {"lower": float(lower), "upper": float(upper)}
    return figures


def _rooted(deviations: np.ndarray) -> float:
    return float(np.sqrt(np.square(deviations).sum() / (len(deviations) - 1)))

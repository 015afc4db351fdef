"""Part-level readings of voxel predictions under the true segmentation: what mean losses hide.

A loss can look fine while every door is read as fixed, so every stage that predicts boxes or joints
logs these on held-out objects. Clustering is left out here on purpose: given the true voxels of
each part, are its box and joint right?
"""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.joint_errors import signed_axis_error
from uniart_jax.objects.kinematics import line_distance
from uniart_jax.objects.thresholds import FOUND, RIGHT_AXIS, RIGHT_BOX, RIGHT_PIVOT
from uniart_jax.voxels.joint_code import (
    NETWORK_TOLERANCE,
    box_corners,
    decode_joint,
    decode_part,
)

MIN_VOXELS = 3


def part_readings(
    codes: np.ndarray,
    own_boxes: np.ndarray,
    parts: np.ndarray,
    true_boxes: np.ndarray,
    true_codes: np.ndarray,
    parents: np.ndarray,
) -> list[dict[str, float]]:
    """Compare each moving part's median prediction with the truth.

    Args:
      codes: [n, 9] predicted joint codes of an object's voxels or cells. own_boxes: [n, 6]
        predicted own boxes.
      parts: [n] true part id of each row.
      true_boxes: [K, 6], true_codes: [K, 9], parents: [K] tables of the object (the root is its own
        parent).

    Returns:
      One row a moving part with at least ``MIN_VOXELS`` rows: "box" (L-infinity of corners),
      "found" and "right" (0/1, as in ``evaluation.parts``), "type" (0/1), "axis" (signed, degrees;
      NaN if the type is wrong), "pivot" (NaN without rotation).
    """
    rows = []
    for k in range(len(true_boxes)):
        mine = parts == k
        if parents[k] == k or mine.sum() < MIN_VOXELS:
            continue
        truth = decode_joint(true_codes[k], true_boxes[k, :3])
        if truth.type == "fixed":
            continue
        box = np.median(own_boxes[mine], axis=0)
        joint = decode_part(codes[mine], box[:3], NETWORK_TOLERANCE)
        error = float(np.abs(box_corners(box) - box_corners(true_boxes[k])).max())
        same = joint.type == truth.type
        axis = signed_axis_error(joint, truth) if same else float("nan")
        pivot = line_distance(joint, truth) if same and truth.rotates else float("nan")
        right = same and error < RIGHT_BOX and axis < RIGHT_AXIS and not pivot >= RIGHT_PIVOT
        rows.append(
            {
                "box": error,
                "found": float(same and error < FOUND),
                "right": float(right),
                "type": float(same),
                "axis": axis,
                "pivot": pivot,
            }
        )
    return rows


def summarize_readings(rows: list[dict[str, float]]) -> dict[str, float]:
    """Means of "found", "right", "type", "box" and medians of "axis", "pivot" over rows; empty
    without rows."""
    if not rows:
        return {}
    summary = {
        name: float(np.mean([r[name] for r in rows])) for name in ("found", "right", "type", "box")
    }
    for name in ("axis", "pivot"):
        values = np.array([r[name] for r in rows])
        values = values[~np.isnan(values)]
        if len(values):
            summary[name] = float(np.median(values))
    return {f"parts/{name}": value for name, value in summary.items()}

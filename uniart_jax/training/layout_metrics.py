"""Part-level readings of predicted layouts while the network trains; ``evaluation.layout`` is the
whole judgement."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.special import expit

from uniart_jax.objects.joint_errors import signed_axis_error
from uniart_jax.objects.kinematics import line_distance
from uniart_jax.objects.thresholds import FOUND, RIGHT_AXIS, RIGHT_BOX, RIGHT_PIVOT
from uniart_jax.voxels.joint_code import NETWORK_TOLERANCE, box_corners, decode_joint, decode_part
from uniart_jax.voxels.part_table import THRESHOLD


def layout_readings(
    parts: dict[str, np.ndarray], boxes: np.ndarray, codes: np.ndarray, parents: np.ndarray
) -> tuple[list[dict[str, float]], bool]:
    """Compare one prediction with the true tables of K parts.

    Args:
      parts: corners [Q, 6], codes [Q, 9], exists [Q] logits. boxes [K, 6], codes [K, 9], parents
        [K]: the truth.

    Returns:
      A row a moving part ("found", "right", "type": 0/1, "box": L-infinity of the matched corners,
        inf without a match),
      and whether the number of parts is right.
    """
    chosen = np.flatnonzero(expit(np.asarray(parts["exists"], np.float64)) > THRESHOLD)
    corners, truth = parts["corners"][chosen], box_corners(boxes)
    distance = np.abs(corners[None] - truth[:, None]).max(-1)
    matches = dict(zip(*linear_sum_assignment(distance), strict=True))
    rows = []
    for k in range(len(boxes)):
        joint = decode_joint(codes[k], boxes[k, :3])
        if parents[k] == k or joint.type == "fixed":
            continue
        row = {"found": 0.0, "right": 0.0, "type": 0.0, "box": float("inf")}
        if k in matches:
            j = matches[k]
            centre = (corners[j, :3] + corners[j, 3:]) / 2
            guess = decode_part(parts["codes"][chosen[j]][None], centre, NETWORK_TOLERANCE)
            error, same = float(distance[k, j]), guess.type == joint.type
            right = same and error < RIGHT_BOX and signed_axis_error(guess, joint) < RIGHT_AXIS
            if right and joint.rotates:
                right = line_distance(guess, joint) < RIGHT_PIVOT
            found = float(same and error < FOUND)
            row = {"found": found, "right": float(right), "type": float(same), "box": error}
        rows.append(row)
    return rows, len(chosen) == len(boxes)

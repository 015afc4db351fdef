"""Part-level comparison of a predicted object with the truth: are the parts there, and do they move
the right way?

Both objects stand at one state: at rest for ``uniart evaluate PRED REF``, at the shown state for
procedural, layout and representation. Parts are matched one to one (Hungarian) by how far
their own boxes are apart, L-infinity over the lower and upper corners. A reference part is

* found   if its match is within ``thresholds.FOUND`` of it and has the same joint type,
* right   if its match is within ``RIGHT_BOX``, has the same type, a *signed* axis error below ``RIGHT_AXIS`` degrees and, where the
          axis has a place (rotations and screws), a line-to-line distance below ``RIGHT_PIVOT``.

No published metric of the field reports the sign: a door that opens inwards scores as well as one
that opens outwards.
"""  # noqa: E501

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.optimize import linear_sum_assignment

from uniart_jax.objects.joint_errors import pivot_at_part, range_iou, signed_axis_error
from uniart_jax.objects.kinematics import line_distance
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.objects.thresholds import FOUND, RIGHT_AXIS, RIGHT_BOX, RIGHT_PIVOT, WRONG_WAY
from uniart_jax.voxels.joint_code import box_corners


def match_parts(predicted: np.ndarray, reference: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One-to-one matching of boxes.

    Args:
      predicted: [P, 6], reference: [K, 6] boxes (centre, size).

    Returns:
      (match [K] index into predicted or -1, distance [K] L-infinity between corners, inf where
      unmatched).
    """
    there, wanted = box_corners(predicted), box_corners(reference)
    distance = np.abs(there[None] - wanted[:, None]).max(-1)  # [K, P]
    rows, columns = linear_sum_assignment(distance)
    match = np.full(len(reference), -1)
    match[rows] = columns
    found = np.full(len(reference), np.inf)
    found[rows] = distance[rows, columns]
    return match, found


@dataclasses.dataclass(frozen=True)
class PartScores:
    """Arrays over the reference's parts, K of them; the root is included with ``moving`` false.

    ``match`` is the index of the predicted part or -1, ``matched`` whether it is within ``FOUND``.
    ``axis_error`` (degrees), ``pivot`` and ``pivot_at_part`` (object units) and ``range_iou`` are
    NaN where there is nothing to compare.
    """

    match: np.ndarray
    moving: np.ndarray
    found: np.ndarray
    right: np.ndarray
    type_right: np.ndarray
    matched: np.ndarray
    parent_right: np.ndarray
    box_error: np.ndarray
    axis_error: np.ndarray
    pivot: np.ndarray
    pivot_at_part: np.ndarray
    range_iou: np.ndarray
    count_right: bool
    tree_right: bool


def compare_parts(predicted: ArticulatedObject, reference: ArticulatedObject) -> PartScores:
    """Match the parts of two normalised objects and score each part of the reference."""
    match, distance = match_parts(predicted.boxes, reference.boxes)
    number = len(reference.parts)
    moving = np.array([p.joint.type != "fixed" for p in reference.parts])
    type_right, right = np.zeros(number, bool), np.zeros(number, bool)
    parent_right = np.zeros(number, bool)
    axis, pivot, at_part, ranges = (np.full(number, np.nan) for _ in range(4))
    for k, part in enumerate(reference.parts):
        if match[k] < 0:
            continue
        guess = predicted.parts[match[k]]
        type_right[k] = guess.joint.type == part.joint.type
        parent_right[k] = (guess.parent < 0) == (part.parent < 0) and (
            part.parent < 0 or match[part.parent] == guess.parent
        )
        right[k] = type_right[k] and distance[k] < RIGHT_BOX
        if moving[k] and type_right[k]:
            axis[k] = signed_axis_error(guess.joint, part.joint)
            ranges[k] = range_iou(guess.joint, part.joint)
            right[k] &= axis[k] < RIGHT_AXIS
            if part.joint.rotates:
                pivot[k] = line_distance(guess.joint, part.joint)
                at_part[k] = pivot_at_part(guess.joint, part.joint, part.box[:3])
                right[k] &= pivot[k] < RIGHT_PIVOT
    count_right = len(predicted.parts) == number
    matched = distance < FOUND
    return PartScores(
        match=match,
        moving=moving,
        found=matched & type_right,
        right=right,
        type_right=type_right,
        matched=matched,
        parent_right=parent_right,
        box_error=distance,
        axis_error=axis,
        pivot=pivot,
        pivot_at_part=at_part,
        range_iou=ranges,
        count_right=count_right,
        tree_right=bool(count_right and matched.all() and parent_right.all()),
    )


def summarize(scores: list[PartScores]) -> dict[str, float]:
    """Means over all parts of all objects (parts) and over objects (count, tree).

    ``recall`` (parts found; "moving found" in tables) and ``parts_right`` are over moving parts;
    ``type_accuracy``, ``axis_median``
    (degrees), ``pivot_median`` and ``range_iou`` over moving parts whose match is within ``FOUND``
    (type) and of the right type (the others). NaN where no part qualifies.
    """
    join = lambda name: np.concatenate([getattr(s, name) for s in scores])  # noqa: E731
    moving, found, matched = join("moving"), join("found"), join("matched")
    ok = moving & found

    def over(values: np.ndarray, mask: np.ndarray, reduce=np.mean) -> float:
        values = values[mask]
        values = values[~np.isnan(values)] if values.dtype.kind == "f" else values
        return float(reduce(values)) if len(values) else float("nan")

    return {
        "recall": over(found, moving),
        "parts_right": over(join("right"), moving),
        "all_parts_right": float(np.mean([bool(s.right.all()) and s.count_right for s in scores])),
        "count": float(np.mean([s.count_right for s in scores])),
        "tree": float(np.mean([s.tree_right for s in scores])),
        "type_accuracy": over(join("type_right"), moving & matched),
        "axis_median": over(join("axis_error"), ok, np.median),
        "axis_mean": over(join("axis_error"), ok),
        "opens_wrong_way": over(join("axis_error") > WRONG_WAY, ok & ~np.isnan(join("axis_error"))),
        "pivot_median": over(join("pivot"), ok, np.median),
        "range_iou": over(join("range_iou"), ok),
        "objects": float(len(scores)),
        "moving_parts": float(moving.sum()),
    }

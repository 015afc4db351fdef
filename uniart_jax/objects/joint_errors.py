"""How far two joints are apart, counting the way they open. Both are in one frame, coordinates
measured from one shown state."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.kinematics import Joint

Interval = tuple[float, float]


def signed_axis_error(predicted: Joint, reference: Joint) -> float:
    """Degrees between the two axes in [0, 180], counting the way the joint opens.

    The prediction is first turned so that both directions agree (limits with it). If its range then
    overlaps the reference's range less than it overlaps the reversed range, the part opens the
    wrong way and the error is 180 degrees minus the angle. So it is between two screws of opposite
    handedness: either the turn or the travel goes the wrong way. Joints that turn for ever have no
    wrong way.
    """
    cosine = float(predicted.direction @ reference.direction)
    lo, hi = predicted.limits
    if cosine < 0:
        lo, hi = -hi, -lo
    sine = float(np.linalg.norm(np.cross(predicted.direction, reference.direction)))
    angle = float(np.degrees(np.arctan2(sine, abs(cosine))))  # exact where arccos is not, near 0
    ref_lo, ref_hi = reference.limits
    overlap = max(0.0, min(hi, ref_hi) - max(lo, ref_lo))
    reversed_overlap = max(0.0, min(hi, -ref_lo) - max(lo, -ref_hi))
    screws = predicted.type == reference.type == "screw"
    opposite = screws and predicted.pitch * reference.pitch < 0
    return angle if overlap >= reversed_overlap - 1e-9 and not opposite else 180.0 - angle


def range_iou(predicted: Joint, reference: Joint) -> float:
    """Intersection over union of the two joints' ranges, directions aligned first; 0 if one is
    fixed and the other is not.

    Turns are compared with turns and travel with travel; of a screw, which has both, the smaller
    overlap counts.
    """
    turned = bool(predicted.direction @ reference.direction < 0)
    overlaps = [
        _overlap(_ordered(a, turned), _ordered(b, False))
        for a, b in (
            (predicted.angle, reference.angle),
            (predicted.travel, reference.travel),
        )
        if a[0] != a[1] or b[0] != b[1]
    ]
    return min(overlaps, default=1.0)


def pivot_at_part(predicted: Joint, reference: Joint, center: np.ndarray) -> float:
    """Distance of the predicted axis from the reference's at the part, object units: from the point
    of the reference's axis nearest to ``center`` [3], the part's box centre.

    Beside ``kinematics.line_distance``, which is 0 for all lines that cross, be it far from the
    part: the least tilt can hide any shift.
    """
    d = reference.direction
    point = reference.origin + ((center - reference.origin) @ d) * d
    between = point - predicted.origin
    return float(np.linalg.norm(between - (between @ predicted.direction) * predicted.direction))


def _ordered(ends: Interval, turned: bool) -> Interval:
    lo, hi = min(ends), max(ends)  # a left-handed screw's travel runs downwards
    return (-hi, -lo) if turned else (lo, hi)


def _overlap(a: Interval, b: Interval) -> float:
    return max(0.0, min(a[1], b[1]) - max(a[0], b[0])) / (max(a[1], b[1]) - min(a[0], b[0]))

"""How far two joints are apart, counting the way they open. Both are in one frame, coordinates measured from one shown state."""

from __future__ import annotations

import numpy as np

from uniart_jax.objects.kinematics import Joint


def signed_axis_error(predicted: Joint, reference: Joint) -> float:
    """Degrees between the two axes in [0, 180], counting the way the joint opens.

    The prediction is first turned so that both directions agree (limits with it). If its range then overlaps the reference's range less
    than it overlaps the reversed range, the part opens the wrong way and the error is 180 degrees minus the angle.
    """
    cosine = float(np.clip(predicted.direction @ reference.direction, -1, 1))
    lo, hi = predicted.limits
    if cosine < 0:
        lo, hi = -hi, -lo
    angle = float(np.degrees(np.arccos(abs(cosine))))
    ref_lo, ref_hi = reference.limits
    overlap = max(0.0, min(hi, ref_hi) - max(lo, ref_lo))
    reversed_overlap = max(0.0, min(hi, -ref_lo) - max(lo, -ref_hi))
    return angle if overlap >= reversed_overlap - 1e-9 else 180.0 - angle


def range_iou(predicted: Joint, reference: Joint) -> float:
    """Intersection over union of the two joints' ranges, directions aligned first; 0 if one is fixed and the other is not."""
    lo, hi = predicted.limits
    if predicted.direction @ reference.direction < 0:
        lo, hi = -hi, -lo
    ref_lo, ref_hi = reference.limits
    union = max(hi, ref_hi) - min(lo, ref_lo)
    return 1.0 if union <= 0 else max(0.0, min(hi, ref_hi) - max(lo, ref_lo)) / union

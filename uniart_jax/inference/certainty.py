"""How sure a found layout is, told by how far two looks at one picture differ.

A picture and its mirror image show the same object, so what a layout network says of the two
differs by what it does not know. The probabilities of its rows tell little of that: of objects
unlike those that it was trained on it is as sure as of others (docs/model_card.md#certainty).

    two looks -> ``differences`` [3] -> ``certainty``: how many of the object's moving parts are
    found and right, as a share, as expected of procedural objects

Parts that are found but not there do not count. It is of the rows as a network says them, whatever
threshold a layout is read with (it was fitted at ``voxels.part_table.THRESHOLD``).
"""

from __future__ import annotations

import numpy as np
from scipy.special import expit

FAR = 0.3  # object units, to which distances of boxes are cut off
LEAST = 1e-3  # added before the logarithm
# of a logistic regression on the logarithms of ``differences`` (tools/fit_certainty.py)
INTERCEPT = -5.87
SLOPES = np.array([-1.04, -0.35, -0.84])


def differences(
    one: dict[str, np.ndarray],
    other: dict[str, np.ndarray],
    rows: np.ndarray,
    others: np.ndarray,
) -> np.ndarray:
    """[3] how far two outputs for one picture differ (``inference.layouts``): the largest distance
    of the corners of a row's boxes, object units, ``FAR`` at most, a mean over rows weighted by
    the larger of their probabilities; the sum of the differences of these probabilities over that
    of the weights; and the sum of the differences of the camera codes.

    Args:
      rows, others: [Q] rows ``rows`` of the first are ``others`` of the second.
    """
    sure, also = expit(one["exists"][rows]), expit(other["exists"][others])
    apart = np.abs(one["corners"][rows] - other["corners"][others]).max(-1)
    weights = np.maximum(sure, also)
    total = weights.sum() + 1e-6
    boxes = (np.minimum(apart, FAR) * weights).sum() / total
    return np.array(
        [boxes, np.abs(sure - also).sum() / total, np.abs(one["camera"] - other["camera"]).sum()],
        np.float64,
    )


def certainty(
    differ: np.ndarray, intercept: float = INTERCEPT, slopes: np.ndarray = SLOPES
) -> np.ndarray:
    """[...] expected share of the moving parts that is right, 0..1, of ``differences`` [..., 3]."""
    return expit(intercept + np.log(np.asarray(differ, np.float64) + LEAST) @ slopes)

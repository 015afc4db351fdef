"""Are the parts there, do they move, and the right way: parts, joints and tree of a prediction
against the reference.

Parts are matched one to one by their boxes at rest (Hungarian, ``parts.match_parts``). A part is
**matched** if its match is within ``thresholds.FOUND``, and a **joint pair** is a moving reference
part, matched, whose match has the same joint type. Two rules for all figures:

* A missing part is 0 in every share of the reference's parts (box recall, edges, parts right,
  part IoU). Axis, pivot and range are means over the joint pairs, so they say how good the joints
  are that were found; read them beside box recall and types.
* NaN means that the *reference* has nothing to compare: it has no moving part (types, joints), no
  axis with a place (pivots), no edge. Where it has, and no pair of the prediction qualifies, the
  figure is ``Metric.worst``: nobody gains by failing on a whole object.

Directions carry a sign: the axis angle is between the ways in which the two parts *open*, so a door
that opens inwards is 180 degrees off. A screw that turns or travels the wrong way, opposite
handedness included, is above 90; a joint that turns for ever has no wrong way.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from uniart_jax.evaluation.geometry import mesh_iou
from uniart_jax.evaluation.metric import Figures, Metric
from uniart_jax.evaluation.parts import PartScores, compare_parts
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.objects.thresholds import FOUND, RIGHT_AXIS, RIGHT_BOX, RIGHT_PIVOT, WRONG_WAY

MISSING, SURPLUS = "missing", "surplus"
# Noise over seeds, procedural objects moved and resized by 6 %: .012 a part, .008 an object
# (median; at most .026, .016). 40 ms a part.
OVERLAP_POINTS = 3_000

METRICS: dict[str, Metric] = {
    "part_count": Metric("count", "higher", 0.0, "1 if there are as many parts as in the reference"),  # noqa: E501
    "part_recall": Metric(
        "box recall", "higher", 0.0, f"share of the reference's parts, fixed ones too, with a predicted part whose box is "  # noqa: E501
            f"within {FOUND} at rest, whatever its joint"
    ),
    "part_precision": Metric(
        "box precision", "higher", 0.0, f"share of the predicted parts with a reference part whose box is within {FOUND} at "  # noqa: E501
            "rest, whatever its joint"
    ),
    "type_accuracy": Metric(
        "type", "higher", 0.0, "share of right joint types over matched parts of which one or both move (fixed, "  # noqa: E501
            "revolute, continuous, prismatic, screw)"
    ),
    "axis_median": Metric(
        "axis (deg)", "lower", 180.0, "signed axis angle, degrees, median over the joint pairs; above 90 the part opens the "  # noqa: E501
            "wrong way"
    ),
    "axis_mean": Metric(
        "axis mean", "lower", 180.0, "signed axis angle, degrees, mean over the joint pairs; above 90 the part opens the "  # noqa: E501
            "wrong way"
    ),
    "wrong_way": Metric("wrong way", "lower", 1.0, "share of the joint pairs that open the wrong way"),  # noqa: E501
    "pivot": Metric(
        "pivot", "lower", 1.0, "distance between the axes as infinite lines, share of the longest side, mean over "  # noqa: E501
            "joint pairs that turn; at most 1, and 0 for lines that cross anywhere"
    ),
    "pivot_at_part": Metric(
        "pivot at part", "lower", 1.0, "distance of the predicted axis from the point of the true axis nearest to the part's "  # noqa: E501
            "centre, share of the longest side, mean over joint pairs that turn; at most 1"
    ),
    "range_iou": Metric(
        "range IoU", "higher", 0.0, "overlap of the ranges of motion, mean over the joint pairs; of a screw the lesser of "  # noqa: E501
            "its turn's and its travel's"
    ),
    "tree_edges": Metric(
        "edges", "higher", 0.0, "share of the reference's edges child -> parent, both ends matched and the joint type "  # noqa: E501
            "right"
    ),
    "tree_exact": Metric(
        "tree", "higher", 0.0, "1 if the labelled tree is the reference's: same count, every part matched, every "  # noqa: E501
            "edge and type right"
    ),
    "parts_right": Metric(
        "parts right", "higher", 0.0, f"share of the moving parts with box ({RIGHT_BOX}), type, signed axis ({RIGHT_AXIS:g} degrees) "  # noqa: E501
            f"and place of the axis ({RIGHT_PIVOT}) right"
    ),
    "all_right": Metric("all right", "higher", 0.0, "1 if every part is right, fixed ones too, and none is surplus"),  # noqa: E501
    "part_iou": Metric(
        "part IoU", "higher", 0.0, "volumetric overlap of each reference part with its match at rest, mean over parts; "  # noqa: E501
            f"{OVERLAP_POINTS:,} points, noise .008"
    ),
}  # fmt: skip


def measure(pred: ArticulatedObject, ref: ArticulatedObject) -> Figures:
    """All of ``METRICS`` for two objects from ``metric.at_rest``."""
    scores = compare_parts(pred, ref)
    moves = bool(scores.moving.any())
    turns = any(p.joint.rotates for p in ref.parts)
    pairs = scores.moving & scores.found
    turning = pairs & ~np.isnan(scores.pivot)
    types = _types_right(pred, scores)
    edges = _edges_right(pred, ref, scores)
    overlaps = _overlaps(pred, ref, scores.match)
    matched = int(scores.matched.sum())

    def over(name: str, values: np.ndarray, comparable: bool, reduce=np.mean) -> float:
        if len(values):
            return float(reduce(values))
        return METRICS[name].worst if comparable else float("nan")

    axis = scores.axis_error[pairs]
    return {
        "part_count": float(scores.count_right),
        "part_recall": matched / len(ref.parts),
        "part_precision": matched / len(pred.parts),
        "type_accuracy": over("type_accuracy", types, moves),
        "axis_median": over("axis_median", axis, moves, np.median),
        "axis_mean": over("axis_mean", axis, moves),
        "wrong_way": over("wrong_way", axis > WRONG_WAY, moves),
        "pivot": over("pivot", np.minimum(scores.pivot[turning], 1), turns),
        "pivot_at_part": over("pivot_at_part", np.minimum(scores.pivot_at_part[turning], 1), turns),
        "range_iou": over("range_iou", scores.range_iou[pairs], moves),
        "tree_edges": over("tree_edges", edges, len(ref.parts) > 1),
        "tree_exact": float(scores.tree_right and scores.type_right.all()),
        "parts_right": over("parts_right", scores.right[scores.moving], moves),
        "all_right": float(scores.count_right and scores.right.all()),
        "part_iou": over("part_iou", overlaps, False),
    }


def confusion(pred: ArticulatedObject, ref: ArticulatedObject) -> dict[tuple[str, str], int]:
    """How often which joint type was taken for which: (reference's, prediction's) -> parts.

    All parts count, the root as "fixed". A reference part without a match is (type, "missing"), a
    predicted part that is nobody's match ("surplus", type); so a row sums to the reference's parts
    of that type and a column to the prediction's.
    """
    scores = compare_parts(pred, ref)
    table: Counter[tuple[str, str]] = Counter()
    surplus = set(range(len(pred.parts)))
    for k, part in enumerate(ref.parts):
        if scores.matched[k]:
            surplus.discard(int(scores.match[k]))
            table[part.joint.type, pred.parts[scores.match[k]].joint.type] += 1
        else:
            table[part.joint.type, MISSING] += 1
    for m in surplus:
        table[SURPLUS, pred.parts[m].joint.type] += 1
    return dict(table)


def _types_right(pred: ArticulatedObject, scores: PartScores) -> np.ndarray:
    """[n] whether the type is right, of the matched parts of which one or both move: motion that is
    made up counts as wrong."""
    moves = np.array([p.joint.type != "fixed" for p in pred.parts])
    return scores.type_right[scores.matched & (scores.moving | moves[scores.match])]


def _edges_right(pred: ArticulatedObject, ref: ArticulatedObject, scores: PartScores) -> np.ndarray:
    """[K - 1] whether the prediction has the reference's edge child -> parent, its joint type
    included."""
    parents = np.array(ref.parents)
    right = scores.found & scores.parent_right & scores.matched[parents]
    return right[parents >= 0]


def _overlaps(pred: ArticulatedObject, ref: ArticulatedObject, match: np.ndarray) -> np.ndarray:
    """[n] IoU of the reference's parts that have an inside with their matches, 0 without; open
    sheets have none and are left out."""
    overlaps = []
    for part, m in zip(ref.parts, match, strict=True):
        iou = mesh_iou(pred.parts[m].mesh, part.mesh, OVERLAP_POINTS) if m >= 0 else 0.0
        if iou > 0 or mesh_iou(part.mesh, part.mesh, OVERLAP_POINTS) > 0:
            overlaps.append(iou)
    return np.array(overlaps)

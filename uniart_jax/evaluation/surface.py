"""How far two objects' surfaces are apart, at rest (RS) and over the states to open (AS): Chamfer
distance and F-score.

With A and B points on the two surfaces, and d(p, B) the distance of p from the nearest point of B,

    chamfer = (mean_A d(p, B) + mean_B d(p, A)) / 2                          not squared                                         (1)
    f_score = harmonic mean of share_A [d(p, B) <= t] and share_B [d(p, A) <= t]                          t = F_SCORE            (2)

**Points.** ``POINTS`` on either object, uniform on the whole surface: what is hidden inside counts
as much as what is seen. They are drawn once, at rest, and carried by their part's motion, so AS
sees the same points. The two objects draw with different seeds: a copy is as far from its source as
two samples of one surface are, about .5 / sqrt(POINTS / area), .005 for an area of 8. That floor
decides the threshold: within .01 lie .92 of the points of a perfect copy, within .02 all of them.

**Frame.** Each object by its own box at rest (``metric.at_rest``). A prediction that is missing
counts as the distance of opposite corners of the unit cube: nothing inside it is farther from
anything, so failing never pays.

**What they do not see.** Nearest is not corresponding: a door near the body is near *something*.
For the cabinet of tests/evaluation/test_surface.py AS Chamfer is .008 for a copy, .057 for a door
that opens by .3 of its range, .051 for one that stays shut, .063 inwards: it tells right from
wrong, but large errors of motion it does not rank. ``pose_error`` does.

``part_f_score`` is (2) between matched parts at rest, points of other parts not being seen,
averaged over the parts of both objects; a part without a match counts 0. There is no Chamfer
distance of parts: what a missing part should cost in it is anybody's choice.
"""  # noqa: E501

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from uniart_jax.evaluation.geometry import surface_points
from uniart_jax.evaluation.metric import STATES, Figures, Metric
from uniart_jax.evaluation.nearest import chamfer_of, f_score_of, mutual_distances, posed_points
from uniart_jax.evaluation.parts import match_parts
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.objects.thresholds import F_SCORE

POINTS = 65_536
FARTHEST = 3**0.5
_APART = 3.0  # more than FARTHEST between cubes of side 1

METRICS: dict[str, Metric] = {
    "rs_chamfer": Metric(
        "RS CD", "lower", FARTHEST, "Chamfer distance of the surfaces at rest, not squared, share of the longest side; "  # noqa: E501
            f"{POINTS:,} points, about .005 for a perfect copy"
    ),
    "as_chamfer": Metric(
        "AS CD", "lower", FARTHEST, "Chamfer distance, mean over five states from rest to open"
    ),
    "rs_f_score": Metric(
        "RS F", "higher", 0.0, f"F-score of the surfaces at rest: points with a neighbour within {F_SCORE} of the "  # noqa: E501
            "longest side"
    ),
    "as_f_score": Metric(
        "AS F", "higher", 0.0, f"F-score within {F_SCORE}, mean over five states from rest to open"
    ),
    "part_f_score": Metric(
        "part F", "higher", 0.0, f"F-score within {F_SCORE} between matched parts at rest, mean over the parts of "  # noqa: E501
            "both objects, 0 without a match"
    ),
}  # fmt: skip


def measure(pred: ArticulatedObject, ref: ArticulatedObject, points: int = POINTS) -> Figures:
    """All of ``METRICS`` for two objects from ``metric.at_rest``, by ``points`` points on
    either."""
    a, part_a = object_points(pred, points, seed=0)
    b, part_b = object_points(ref, points, seed=1)
    distances = mutual_distances(
        *(
            posed_points(p, part, motions(obj))
            for p, part, obj in ((a, part_a, pred), (b, part_b, ref))
        )
    )
    apart, f_scores = chamfer_of(*distances), f_score_of(*distances, F_SCORE)
    apart = np.minimum(apart, FARTHEST)  # a drawer that flies away must not swamp a mean
    return {
        "rs_chamfer": float(apart[0]),
        "as_chamfer": float(apart.mean()),
        "rs_f_score": float(f_scores[0]),
        "as_f_score": float(f_scores.mean()),
        "part_f_score": _part_f_score(pred, ref, (a, part_a), (b, part_b)),
    }


def object_points(obj: ArticulatedObject, number: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Points uniform on the surface of all parts, one or more on each: ([number, 3], [number] part
    of each).

    Raises:
      ValueError: fewer points than parts.
    """
    parts = len(obj.parts)
    if number < parts:
        raise ValueError(f"surface: {number} points cannot stand on {parts} parts; ask for more")
    area = np.array([part.mesh.area for part in obj.parts])
    share = area / area.sum() if area.sum() > 0 else np.full(parts, 1 / parts)
    counts = 1 + (share * (number - parts)).astype(int)
    counts[np.argmax(share)] += number - counts.sum()  # what rounding left over
    points = [
        surface_points(part.mesh, count, seed=seed * 10_000 + k)
        for k, (part, count) in enumerate(zip(obj.parts, counts, strict=True))
    ]
    return np.concatenate(points), np.repeat(np.arange(parts), counts)


def motions(obj: ArticulatedObject, states: Sequence[float] | np.ndarray = STATES) -> np.ndarray:
    """[S, K, 4, 4] of every part from rest to each of ``states``; ``obj`` stands at rest."""
    return np.stack([obj.forward_kinematics(obj.open(state)) for state in states])


def _part_f_score(pred, ref, pred_points, ref_points) -> float:
    match, _ = match_parts(pred.boxes, ref.boxes)
    # Each pair stands in a cube of its own, far from all others: one search finds the nearest
    # points within every pair.
    cube_of_ref = np.arange(len(ref.parts))
    cube_of_pred = len(ref.parts) + np.arange(len(pred.parts))
    matched = match >= 0
    cube_of_pred[match[matched]] = cube_of_ref[matched]
    moved, cubes = [], len(ref.parts) + len(pred.parts)
    side = int(np.ceil(cubes ** (1 / 3)))
    for (points, part), cube in ((pred_points, cube_of_pred), (ref_points, cube_of_ref)):
        place = np.stack(np.unravel_index(cube[part], (side,) * 3), -1) - (side - 1) / 2
        moved.append(points + _APART * place)
    there, back = mutual_distances(*moved)
    total = sum(
        float(f_score_of(there[pred_points[1] == match[k]], back[ref_points[1] == k], F_SCORE))
        for k in cube_of_ref[matched]
    )
    return 2 * total / cubes

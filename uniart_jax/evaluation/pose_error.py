"""Pose error: the one number that sees every mistake. How far are the points of one object off
their place on the other while both open?

Parts are matched one to one by their boxes at rest. For a point p on the surface of reference part
k, p' is the nearest point on the surface of its match at rest (of the whole prediction where it has
none), on part m. With T(s) the motion of a part from rest to the state s,

    d(p, s) = |T_m(s) p' - T_k(s) p|                          how far off at s                                        (1)
    e(p, s) = max over u <= s of d(p, u)                      the farthest so far, on the way to s                    (2)

``pose_error`` is the mean of (2) over ``STATES``, over the points of a part, over the parts (each
counts the same), and over both directions: reference to prediction, which sees missing parts, and
back, which sees surplus ones. At state 0 it is |p' - p|, ``pose_rest``: geometry alone; what lies
between the two is motion. For the same shape with the same joint both are 0.

**Why the farthest so far.** The distance at a state folds back: a door of 180 degrees that opens
inwards ends where it should, so the mean of (1) is .97 of its mean radius, and 1.21 for a door that
never moves; a cap is forgiven a whole turn. With (2) it is 1.48 and 1.21: wrong way is worst. The
two are the same for a joint about the right axis that is off by less than half a turn. (Adding up
the path instead would count every wobble of a cap on its thread.)

**Why parts count alike.** A knob is a thousandth of a surface, and how much of it a body hides
inside is a modeller's whim: over area alone, a knob on the wrong axis goes unseen.

What it cannot see or gets wrong:

* Joints that turn for ever are opened by 90 degrees (``ArticulatedObject.open``), towards the side
  to which their counterpart opens, for they turn either way. One that is bounded at 90 degrees is
  no different then; the type accuracy tells.
* Boxes alone decide who is whose. Two parts of an object whose boxes are the same to within the
  prediction's error (the closed halves of scissors, shells one in the other) may be swapped, and
  the figure is then that of the swapped parts, too large; where they move alike it makes no
  difference.
* A surplus part that lies on, and moves with, one that is there too (a double) changes no pose;
  count and precision tell.
* A part that turns more than half a turn too far cannot be farther off than across its circle: the
  figure grows on, but slowly.
"""  # noqa: E501

from __future__ import annotations

import igl
import numpy as np
import trimesh
from scipy.stats import qmc

from uniart_jax.evaluation.metric import STATES, Figures, Metric
from uniart_jax.evaluation.parts import match_parts
from uniart_jax.objects.object import ArticulatedObject

POINTS = (
    512  # on a part, a power of two, as Sobol points are even then: within 1 % of what 32,768 say
)
STEPS = 8  # from one state to the next, on the way that (2) looks along
_WAY = np.interp(np.arange((len(STATES) - 1) * STEPS + 1) / STEPS, np.arange(len(STATES)), STATES)

METRICS: dict[str, Metric] = {
    "pose_error": Metric(
        "pose error", "lower", 1.0, "how far points are off their place while both objects open (the farthest so far), "  # noqa: E501
            "share of the longest side; mean over states and parts, both directions, at most 1"
    ),
    "pose_rest": Metric(
        "pose at rest", "lower", 1.0, "the pose error at rest: geometry and parts alone, without motion"  # noqa: E501
    ),
}  # fmt: skip


def measure(pred: ArticulatedObject, ref: ArticulatedObject, points: int = POINTS) -> Figures:
    """All of ``METRICS`` for two objects from ``metric.at_rest``.

    Args:
      points: on each part, a power of two.
    """
    match, _ = match_parts(pred.boxes, ref.boxes)
    back = np.full(len(pred.parts), -1)
    back[match[match >= 0]] = np.flatnonzero(match >= 0)
    pred_motion, ref_motion = _motions(pred, ref, match)
    errors = [
        _errors(pred, ref, match, pred_motion, ref_motion, points),
        _errors(ref, pred, back, ref_motion, pred_motion, points),
    ]
    error, rest = np.minimum(np.mean(errors, 0), 1)
    return {"pose_error": float(error), "pose_rest": float(rest)}


def surface_samples(mesh: trimesh.Trimesh, number: int) -> np.ndarray:
    """[number, 3] points uniform on the surface, the same for the same mesh wherever it stands.

    A Sobol sequence over area and barycentric coordinates: evener than random points, so fewer do.
    ``number`` is a power of two.
    """
    sample = qmc.Sobol(3, scramble=False).random(number) + 0.5 / number
    area = np.asarray(mesh.area_faces, np.float64)
    ends = np.cumsum(area if area.sum() > 0 else np.ones_like(area))
    face = np.searchsorted(ends, sample[:, 0] * ends[-1]).clip(max=len(area) - 1)
    root, v = np.sqrt(sample[:, 1]), sample[:, 2]
    weights = np.stack([1 - root, root * (1 - v), root * v], 1)  # uniform in a triangle
    return np.einsum("pc,pcx->px", weights, np.asarray(mesh.triangles, np.float64)[face])


def _motions(
    pred: ArticulatedObject, ref: ArticulatedObject, match: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """[way, P, 4, 4] and [way, K, 4, 4] of the parts from rest to open; what turns for ever goes to
    the side to which its counterpart opens."""
    pred_end, ref_end = pred.open(1.0), ref.open(1.0)
    for k in np.flatnonzero(match >= 0):
        m = match[k]
        a, b = pred.parts[m].joint, ref.parts[k].joint
        if a.rotates and b.rotates and (a.direction @ b.direction) * pred_end[m] * ref_end[k] < 0:
            if b.type == "continuous":
                ref_end[k] *= -1
            elif a.type == "continuous":
                pred_end[m] *= -1
    return _on_the_way(pred, pred_end), _on_the_way(ref, ref_end)


def _on_the_way(obj: ArticulatedObject, end: np.ndarray) -> np.ndarray:
    rest = obj.rest()
    return np.stack([obj.forward_kinematics(rest + s * (end - rest)) for s in _WAY])


def _errors(
    other: ArticulatedObject,
    own: ArticulatedObject,
    match: np.ndarray,
    other_motion: np.ndarray,
    own_motion: np.ndarray,
    points: int,
) -> np.ndarray:
    """[2] mean of (2) over states, points and parts of ``own``, and the same at rest. ``match``
    [K]: the part of ``other`` or -1."""
    whole: trimesh.Trimesh | None = None
    means = []
    for k, part in enumerate(own.parts):
        p = surface_samples(part.mesh, points)
        if match[k] >= 0:
            near = _nearest(other.parts[match[k]].mesh, p)[1]
            there = _moved(other_motion[:, match[k]], near)
        else:
            whole = whole or other.mesh(other.rest())
            faces = [len(q.mesh.faces) for q in other.parts]
            face, near = _nearest(whole, p)
            carrier = np.repeat(np.arange(len(faces)), faces)[face]
            there = np.empty((len(_WAY), points, 3))
            for m in np.unique(carrier):
                there[:, carrier == m] = _moved(other_motion[:, m], near[carrier == m])
        distance = np.linalg.norm(there - _moved(own_motion[:, k], p), axis=-1)
        farthest = np.maximum.accumulate(distance, axis=0)[::STEPS].mean(1)
        means.append((farthest.mean(), farthest[0]))
    return np.mean(means, 0)


def _nearest(mesh: trimesh.Trimesh, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """([n] face, [n, 3] point) of the surface nearest to points [n, 3]."""
    vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
    _, face, point = igl.point_mesh_squared_distance(np.ascontiguousarray(points), vertices, faces)
    return face, point


def _moved(transforms: np.ndarray, points: np.ndarray) -> np.ndarray:
    """[s, n, 3] of points [n, 3] under transforms [s, 4, 4]."""
    return points @ transforms[:, :3, :3].transpose(0, 2, 1) + transforms[:, None, :3, 3]

"""Perturbed objects: parts of other sizes, with joints that still fit (the paper's "random
perturbations in part geometry"); random colours and joints.

**Sizes.** A factor a part and axis, F_k = diag(f_x, f_y, f_z), stretches part k *and all that it
carries* about the part's anchor a_k. So a material point x of part k goes to

    A_k(x) = A_parent(a_k) + S_k (x - a_k),     S_k = S_parent F_k;     the root: A(x) = a + F (x - a)          (1)

Where a part turns, a_k is the point of its axis nearest to the centre of its own box: both sides of
the hinge agree there, and so all along the axis. Elsewhere (fixed, pure travel, whose line is
arbitrary) a_k is the point of the parent's own box nearest to that centre, about where the two
touch. Axes keep their directions, angles stay, travel grows by S_k along the axis. Hence the factor
of the root alone stretches the whole object, and one of a door its handle as well.

An axis keeps its direction only if all its components are stretched alike: |S d - (d . S d) d| = 0.
``part_factors`` draws only such factors, uniform for a part with a crooked joint anywhere below it,
and keeps what turns more than half a turn round: wheels, knobs, caps. Meant for the rest state,
where what a joint turns stands along the object's axes; elsewhere uneven factors shear it.

**Colours.** A gain a part and channel, by which linear RGB is multiplied.

**Joints.** ``draw_joint``: any screw that a part of that box could have, whatever its mesh says.
For a network that has to pass joints on, not to find them.

Colours and joints of records: ``data.augment``.
"""  # noqa: E501

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from uniart_jax.objects.kinematics import JOINT_TYPES, Joint
from uniart_jax.objects.object import ArticulatedObject, moved_mesh

CROOKED = 1e-4  # components of a unit direction below this do not count
ROUND = np.pi + 1e-6  # radians; what turns farther stays round


def scale_parts(obj: ArticulatedObject, factors: np.ndarray) -> ArticulatedObject:
    """The object with parts of other sizes, equation (1), normalised again.

    Args:
      obj: best at its rest state.
      factors: [K] or, along the object's axes, [K, 3]; each counts for all that its part carries.
        All above 0.

    Raises:
      ValueError: wrong shape, a factor that is not above 0, or an axis that factors would turn.
    """
    factors = _checked_factors(factors, len(obj.parts))
    boxes, parents = obj.boxes, obj.parents
    anchors = np.stack([_anchor(k, p.joint, boxes, p.parent) for k, p in enumerate(obj.parts)])
    stretch, shift = _material_maps(anchors, parents, factors)
    parts = []
    for k, part in enumerate(obj.parts):
        matrix = np.eye(4)
        matrix[range(3), range(3)], matrix[:3, 3] = stretch[k], shift[k]
        joint = part.joint
        if part.parent >= 0 and joint.type != "fixed":
            for by in (stretch[k], stretch[part.parent]):
                _check_axis(part.name, joint.direction, by)
            along = float(joint.direction**2 @ stretch[k])
            joint = Joint(
                stretch[part.parent] * joint.origin + shift[part.parent],
                joint.direction,
                joint.angle,
                (joint.travel[0] * along, joint.travel[1] * along),
                joint.dead_zone * along,
            )
        parts.append(dataclasses.replace(part, mesh=moved_mesh(part.mesh, matrix), joint=joint))
    return dataclasses.replace(obj, parts=tuple(parts)).normalized()


def part_factors(obj: ArticulatedObject, rng: np.random.Generator, strength: float) -> np.ndarray:
    """[K, 3] random factors for ``scale_parts``, log-uniform from 1 / (1 + strength) to 1 +
    strength, equal where axes are tied (module docstring)."""
    count = len(obj.parts)
    tied = np.zeros((count, 3), bool)  # pairs of axes yz, xz, xy: pair i leaves out axis i
    for k in reversed(range(count)):
        joint, parent = obj.parts[k].joint, obj.parts[k].parent
        if parent >= 0 and joint.type != "fixed":
            along = np.abs(joint.direction) > CROOKED
            if along.sum() > 1:
                tied[k] |= ~along if along.sum() == 2 else True
            if joint.angle[1] - joint.angle[0] > ROUND:
                tied[k] |= along
        if tied[k].sum() > 1:
            tied[k] = True
        if parent >= 0:
            tied[parent] |= tied[k]
    logs = np.log1p(strength) * rng.uniform(-1, 1, (count, 3))
    for k in range(count):
        axes = [0, 1, 2] if tied[k].all() else np.flatnonzero(~tied[k])
        if tied[k].any():
            logs[k, axes] = logs[k, axes].mean()
    return np.exp(logs)


def color_gains(count: int, rng: np.random.Generator, strength: float) -> np.ndarray:
    """[count, 3] random gains of linear RGB (``data.augment.recolor_record``): a part's brightness
    times a factor a channel, each log-uniform from 1 / (1 + strength) to 1 + strength."""
    logs = rng.uniform(-1, 1, (count, 1)) + rng.uniform(-1, 1, (count, 3))
    return np.exp(np.log1p(strength) * logs)


def draw_joint(box: np.ndarray, rng: np.random.Generator) -> Joint:
    """A random joint of a part with that own box [6] (centre and size): each type equally likely,
    one axis in two along x, y or z, else uniform over directions, through a point of the box
    enlarged by a fifth; where it has limits, the shown state is at one of them four times in five.

    Spans are log-uniform: revolute 10 to 350 degrees, travel .03 to .8 object units; a screw turns
    a fourth of a turn to three turns and travels .02 to .5, either way.
    """
    kind = JOINT_TYPES[rng.integers(len(JOINT_TYPES))]
    if kind == "fixed":
        return Joint.fixed()
    along = rng.random() < 0.5
    direction = np.eye(3)[rng.integers(3)] if along else rng.normal(size=3)
    origin = box[:3] + 0.6 * rng.uniform(-1, 1, 3) * box[3:]
    at = rng.choice([0.0, 1.0, rng.random()], p=[0.4, 0.4, 0.2])
    limits = np.array([-at, 1 - at])

    def span(least: float, most: float) -> np.ndarray:
        return limits * np.exp(rng.uniform(np.log(least), np.log(most)))

    angle, travel = np.zeros(2), np.zeros(2)
    if kind == "revolute":
        angle = span(np.deg2rad(10), np.deg2rad(350))
    elif kind == "continuous":
        angle = np.array([-np.pi, np.pi])
    elif kind == "prismatic":
        travel = span(0.03, 0.8)
    else:
        angle, travel = span(np.pi / 2, 6 * np.pi), span(0.02, 0.5) * rng.choice([-1.0, 1.0])
    return Joint(origin, direction, (angle[0], angle[1]), (travel[0], travel[1]))


def _material_maps(
    anchors: np.ndarray, parents: Sequence[int] | np.ndarray, factors: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Equation (1) as A_k(x) = stretch_k * x + shift_k.

    Args:
      anchors: [K, 3] a_k. parents: [K], parents first; the root is its own parent or has -1.
        factors: [K, 3].

    Returns:
      stretch [K, 3], shift [K, 3].
    """
    stretch, shift = np.array(factors, np.float64), np.zeros((len(anchors), 3))
    for k, parent in enumerate(parents):
        place = anchors[k]
        if 0 <= parent != k:
            stretch[k] *= stretch[parent]
            place = stretch[parent] * place + shift[parent]
        shift[k] = place - stretch[k] * anchors[k]
    return stretch, shift


def _touching_point(box: np.ndarray, parent_box: np.ndarray) -> np.ndarray:
    """[3] the point of the parent's box that is nearest to the centre of a part's box; both [6]
    centre and size."""
    half = parent_box[3:] / 2
    return np.clip(box[:3], parent_box[:3] - half, parent_box[:3] + half)


def _checked_factors(factors: np.ndarray, count: int) -> np.ndarray:
    """[K, 3] float64 of factors [K] or [K, 3].

    Raises:
      ValueError: another shape, or a factor that is not a finite number above 0.
    """
    factors = np.asarray(factors, np.float64)
    if factors.shape not in ((count,), (count, 3)):
        raise ValueError(
            f"perturb: expected factors of shape ({count},) or ({count}, 3), got {factors.shape}"
        )
    if not np.all(np.isfinite(factors) & (factors > 0)):
        raise ValueError("perturb: factors must be finite numbers above 0")
    return np.tile(factors[:, None], (1, 3)) if factors.ndim == 1 else factors


def _anchor(k: int, joint: Joint, boxes: np.ndarray, parent: int) -> np.ndarray:
    if joint.rotates and parent >= 0:
        offset = boxes[k, :3] - joint.origin
        return joint.origin + (offset @ joint.direction) * joint.direction
    return _touching_point(boxes[k], boxes[max(parent, 0)])


def _check_axis(name: str, direction: np.ndarray, stretch: np.ndarray) -> None:
    turned = stretch * direction
    turned = turned - (turned @ direction) * direction
    if np.linalg.norm(turned) > CROOKED * stretch.max():
        raise ValueError(
            f"perturb: part '{name}': its axis {np.round(direction, 4).tolist()} would be turned "
            "by uneven factors; use equal ones"
        )

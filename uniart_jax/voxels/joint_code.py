"""The reversible joint-to-voxel embedding: Joint <-> c in R^9, and a tree <-> pairs of boxes.

The paper splits the code into type, axis and limits (section "Reversible joint-to-voxel
embedding"); it leaves out how. Here, in the plane (rho, sigma) = (angle / pi, KAPPA * travel), a
joint's motion is a segment of a line through the origin:

    c = (tau, d, m, lo, hi)                                                                          (1)
    tau     = 2 / pi * atan2(sigma, rho) of that line, in (-1, 1]: 0 pure rotation, 1 pure travel    (2)
    d, m    = axis direction and moment p x d (Pluecker line); p = own box centre for pure travel    (3)
    lo, hi  = rho cos(pi tau / 2) + sigma sin(pi tau / 2) at the lower and upper end                 (4)

Fixed: all zero. Continuous: lo, hi = -1, 1. Two gauges leave the motion as it is:

    (d, m, lo, hi) ~ (-d, -m, -hi, -lo)     and     (tau, lo, hi) ~ (tau +- 2, -hi, -lo)             (5)

Canonical: tau in (-1, 1] and the largest component of d positive (ties: z, then y, then x), so that
which way a part opens lives in the limits alone. Losses and averages work modulo both gauges:
``gauge_variants``, ``align``.

``canonical``, ``gauge_variants``, ``align`` and ``box_corners`` take the array namespace ``xp``
(numpy or jax.numpy), so that training and assembling share one definition; this file never imports
jax.

Units: boxes and moments in object units, frame of the shown state. A box is [6]: centre and size.
"""  # noqa: E501

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import networkx as nx
import numpy as np

from uniart_jax.objects.kinematics import ANGLE_DEAD_ZONE, TRAVEL_DEAD_ZONE, Joint, codable
from uniart_jax.objects.several_joints import one_joint

if TYPE_CHECKING:  # training reads codes on machines without trimesh
    from uniart_jax.objects.object import ArticulatedObject

KAPPA = 4.0  # weight of travel against angle / pi; part of the file format
TIE = 1e-6  # components of d this close count as equal when the sign is chosen
SAME_BOX = 0.01  # own boxes closer than this cannot be told apart
LARGEST = 1e3  # no sane code has a component above it
FIXED_AXIS = 0.5  # a predicted |d| below this is a fixed joint; true |d| is 0 or 1
NETWORK_TOLERANCE = 0.1  # of ``decode_part`` for predicted codes
FULL_TURN = 2.0  # in units of a limit, pi radians
CODE_SIZE = 9
BOX_SIZE = 6  # centre and size
# the channels of what a voxel says of its part: joint code, own box, parent's box
JOINT_CODE = slice(0, CODE_SIZE)
OWN_BOX = slice(JOINT_CODE.stop, JOINT_CODE.stop + BOX_SIZE)
PARENT_BOX = slice(OWN_BOX.stop, OWN_BOX.stop + BOX_SIZE)
CODE_CHANNELS = PARENT_BOX.stop
SPREADS = 3.0  # median absolute deviations; how far noisy codes are drawn to the pure motions


def canonical(code: Any, xp: Any = np) -> Any:
    """The canonical representative of each code.

    Args:
      code: [..., 9], any gauge.
      xp: array namespace of ``code``.

    Returns:
      [..., 9] with tau in (-1, 1] and the largest component of d positive.
    """
    code = xp.asarray(code)
    tau, line, lo, hi = code[..., 0:1], code[..., 1:7], code[..., 7:8], code[..., 8:9]
    turns = xp.ceil((tau - 1) / 2)
    tau = tau - 2 * turns
    odd = xp.abs(turns % 2) > 0.5
    lo, hi = xp.where(odd, -hi, lo), xp.where(odd, -lo, hi)
    size = xp.abs(line[..., 0:3])
    top = xp.max(size, axis=-1, keepdims=True) - TIE
    x, y, z = line[..., 0:1], line[..., 1:2], line[..., 2:3]
    leading = xp.where(size[..., 2:3] >= top, z, xp.where(size[..., 1:2] >= top, y, x))
    flip = leading < 0
    line = xp.where(flip, -line, line)
    lo, hi = xp.where(flip, -hi, lo), xp.where(flip, -lo, hi)
    return xp.concatenate([tau, line, lo, hi], axis=-1)


def gauge_variants(code: Any, xp: Any = np) -> Any:
    """All equivalent representations of each code within one step of both gauges.

    Args:
      code: [..., 9].
      xp: array namespace of ``code``.

    Returns:
      [..., 6, 9]; the first is ``code`` itself. A loss takes the minimum over the second last axis.
    """
    code = xp.asarray(code)
    tau, line, lo, hi = code[..., 0:1], code[..., 1:7], code[..., 7:8], code[..., 8:9]
    variants = []
    for step in (0.0, 2.0, -2.0):
        for sign in (1, -1):
            ends = (lo, hi) if (step == 0) == (sign == 1) else (-hi, -lo)
            variants.append(xp.concatenate([tau + step, sign * line, *ends], axis=-1))
    return xp.stack(variants, axis=-2)


def align(code: Any, reference: Any, xp: Any = np) -> Any:
    """The representation of each code that is nearest (L2) to a reference.

    Args:
      code: [..., 9].
      reference: broadcastable to ``code``.
      xp: array namespace.

    Returns:
      [..., 9].
    """
    variants = gauge_variants(code, xp)
    reference = xp.broadcast_to(xp.asarray(reference), (*variants.shape[:-2], CODE_SIZE))
    distance = xp.sum((variants - reference[..., None, :]) ** 2, axis=-1)
    best = xp.argmin(distance, axis=-1)
    return xp.take_along_axis(variants, best[..., None, None], axis=-2)[..., 0, :]


def encode_joint(joint: Joint, box_center: np.ndarray) -> np.ndarray:
    """[9] float64 canonical code of a joint, equations (1) to (4).

    Args:
      joint: in the object frame at the shown state; motions below the dead zones (``codable``)
        are none.
      box_center: [3] centre of the child part's own box; anchors the axis of pure travel, whose
        place is arbitrary.
    """
    joint = codable(joint)
    if joint.type == "fixed":
        return np.zeros(CODE_SIZE)
    rho = np.array(joint.angle) / np.pi
    sigma = KAPPA * np.array(joint.travel)
    phi = np.arctan2(sigma[1] - sigma[0], rho[1] - rho[0])
    point = joint.origin if joint.rotates else np.asarray(box_center, dtype=np.float64)
    moment = np.cross(point, joint.direction)
    limits = rho * np.cos(phi) + sigma * np.sin(phi)
    return canonical(np.concatenate([[2 / np.pi * phi], joint.direction, moment, limits]))


def decode_joint(code: np.ndarray, part_center: np.ndarray) -> Joint:
    """The joint that a code stands for; inverse of ``encode_joint`` and safe on anything a network
    may emit.

    tau is not clamped, and the codes' dead zones (1 degree, .005) apply to the decoded spans.
    Limits that do not bracket 0 are widened to
    it; an axis shorter than .5 and a code that is not finite give the fixed joint.

    Args:
      code: [9], any gauge.
      part_center: [3] centre of the part's own box; the origin returned is the point of the axis
        nearest to it.
    """
    code = np.asarray(code, dtype=np.float64).reshape(CODE_SIZE)
    finite = bool(np.isfinite(code).all())
    code = np.clip(code, -LARGEST, LARGEST)
    length = float(np.linalg.norm(code[1:4]))
    if not finite or length < FIXED_AXIS:
        return Joint.fixed()
    phi = code[0] * np.pi / 2
    direction = code[1:4] / length
    moment = code[4:7] / length
    moment = moment - (moment @ direction) * direction
    point = np.cross(direction, moment)
    center = np.asarray(part_center, dtype=np.float64)
    origin = point + ((center - point) @ direction) * direction
    limits = np.array([min(code[7], 0.0), max(code[8], 0.0)])
    angle = limits * (np.cos(phi) * np.pi)
    travel = limits * (np.sin(phi) / KAPPA)
    if abs(angle[1] - angle[0]) < ANGLE_DEAD_ZONE * (1 - 1e-6):  # what ``codable`` keeps, rounded
        angle = np.zeros(2)
    if abs(travel[1] - travel[0]) < TRAVEL_DEAD_ZONE * (1 - 1e-6):
        travel = np.zeros(2)
    q = angle if angle.any() else travel
    if q[0] > q[1]:  # tau outside (-1, 1], or a screw whose rotation fell into the dead zone
        angle, travel = angle[::-1], travel[::-1]
    return Joint(origin, direction, (angle[0], angle[1]), (travel[0], travel[1]))


def decode_part(codes: np.ndarray, part_center: np.ndarray, tolerance: float = 0.0) -> Joint:
    """The joint of a part from the codes of its voxels: their median once all are in one gauge.

    Noisy codes are drawn to the pure motions, because 1 degree of rotation over a drawer's travel
    is a tau of only .003: within 3 spreads (median absolute deviations over the part) tau snaps to
    0 or +-1, and the ends of a pure rotation to -1 and 1. True codes have no spread and decode
    exactly. The price is paid by screws of tau near 0 or +-1 (docs/joint_code_noise.md).

    Args:
      codes: [n, 9], any gauge each; rows that are not finite are left out.
      part_center: [3] centre of the part's own box.
      tolerance: the error that all voxels of a part may share, which their spread cannot show: 0
        for true codes, ``NETWORK_TOLERANCE`` for predicted ones. Within it tau snaps as well,
        unless the joint makes more than a full turn.
    """
    codes = np.asarray(codes, dtype=np.float64).reshape(-1, CODE_SIZE)
    codes = canonical(codes[np.isfinite(codes).all(1)])
    if not len(codes):
        return Joint.fixed()
    # the medoid is a good first reference even where half of the codes lie in another gauge
    sample = codes[np.linspace(0, len(codes) - 1, min(len(codes), 48)).astype(int)]
    between = gauge_variants(sample)[:, None] - sample[None, :, None]
    medoid = sample[np.sqrt((between**2).sum(-1)).min(-1).sum(0).argmin()]
    aligned = align(codes, np.median(align(codes, medoid), axis=0))
    middle = np.median(aligned, axis=0)
    spread = np.median(np.abs(aligned - middle), axis=0)
    middle, reach = canonical(middle), SPREADS * np.maximum(spread, 1e-9)
    turn = (middle[8] - middle[7]) * np.cos(middle[0] * np.pi / 2)
    turns_once = turn <= FULL_TURN + tolerance
    near = max(reach[0], tolerance if turns_once else 0.0)
    if abs(middle[0] - np.round(middle[0])) <= near:
        middle[0] = np.round(middle[0])
    travel = 2 / KAPPA * abs(np.sin(middle[0] * np.pi / 2))  # over a full turn
    ends = max(reach[7:9].max(), tolerance)
    if travel < TRAVEL_DEAD_ZONE and np.abs(middle[7:9] - [-1, 1]).max() <= ends:
        middle[[0, 7, 8]] = 0, -1, 1
    return decode_joint(middle, part_center)


def box_corners(boxes: Any, xp: Any = np) -> Any:
    """[..., 6] lower and upper corner of boxes [..., 6] given as centre and size, in their units;
    distances between boxes are L-infinity of these. ``xp``: array namespace of ``boxes``."""
    boxes = xp.asarray(boxes)
    center, half = boxes[..., :3], boxes[..., 3:] / 2
    return xp.concatenate([center - half, center + half], axis=-1)


def encode_object(obj: ArticulatedObject) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Own boxes, joint codes and parents of all parts; a code holds one joint a part
    (``several_joints.one_joint``).

    Returns:
      boxes [K, 6] float64, codes [K, 9] float64 (root: 0), parents [K] int32 (the root is its own
      parent, so that ``boxes[parents]`` are the parent boxes).

    Raises:
      ValueError: two own boxes differ by less than .01 in every corner coordinate, so voxels could
        not tell the parts apart.
    """
    boxes = obj.boxes
    corners = box_corners(boxes)
    distance = np.abs(corners[:, None] - corners[None]).max(-1)
    rows, columns = np.nonzero(np.triu(distance < SAME_BOX, 1))
    if len(rows):
        first, second = obj.parts[rows[0]].name, obj.parts[columns[0]].name
        raise ValueError(
            f"object: parts '{first}' and '{second}' have the same box (within {SAME_BOX}) in the "
            "shown state; show another state or merge them"
        )
    codes = np.zeros((len(boxes), CODE_SIZE))
    for k, part in enumerate(obj.parts):
        if part.parent >= 0:
            codes[k] = encode_joint(one_joint(part.outer, part.joint, part.inner), boxes[k, :3])
    parents = np.array([k if p < 0 else p for k, p in enumerate(obj.parents)], np.int32)
    return boxes, codes, parents


def decode_tree(boxes: np.ndarray, parent_boxes: np.ndarray) -> list[int]:
    """The kinematic tree that agrees best with the parts' parent boxes.

    Minimum spanning arborescence over the distance from each part's parent box to the own box of
    every other part. A virtual root reaches part k at M + |parent_box_k - own_box_k|, M above the
    sum of all other costs: exactly one root comes out.

    Args:
      boxes: [K, 6] own boxes.
      parent_boxes: [K, 6] what each part says of its parent; the root says its own box.

    Returns:
      [K] parent of each part, -1 for the root.
    """
    count = len(boxes)
    if count == 1:
        return [-1]
    own = box_corners(np.clip(np.nan_to_num(boxes), -LARGEST, LARGEST))
    parent = box_corners(np.clip(np.nan_to_num(parent_boxes), -LARGEST, LARGEST))
    cost = np.abs(own[:, None] - parent[None]).max(-1)  # [parent, child]
    bound = float(cost.sum()) + 1.0
    graph = nx.DiGraph()
    for child in range(count):
        graph.add_edge(count, child, weight=bound + cost[child, child])
        for node in range(count):
            if node != child:
                graph.add_edge(node, child, weight=float(cost[node, child]))
    tree = nx.minimum_spanning_arborescence(graph)
    parents = [-1] * count
    for node, child in tree.edges:
        parents[child] = -1 if node == count else int(node)
    return parents

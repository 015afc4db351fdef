"""How much two boxes share, wherever they stand, and their generalized IoU.

    IoU = |A & B| / |A | B|,    gIoU = IoU - (|C| - |A | B|) / |C|                                    (1)

with C a box around both (Rezatofighi et al., "Generalized Intersection over Union", CVPR 2019). A
box is [6], centre and size, in its own part's frame; ``a_to_b`` [4, 4] carries a's frame to b's.
All leading shapes broadcast. The sampled share is what SINGAPO's code computes; the exact one is a
boolean of two convex solids (manifold3d).
"""  # noqa: E501

from __future__ import annotations

import manifold3d
import numpy as np

CHUNK = 16  # pairs that are sampled at once, so that the points stay in the cache


def volumes(boxes: np.ndarray) -> np.ndarray:
    """[..., 6] to [...]."""
    return np.prod(boxes[..., 3:], -1)


def box_around(boxes: np.ndarray, matrices: np.ndarray) -> np.ndarray:
    """[..., 6] the axis-aligned box around each box [..., 6] after it is moved by [..., 4, 4]."""
    center = np.einsum("...ij,...j->...i", matrices[..., :3, :3], boxes[..., :3])
    size = np.einsum("...ij,...j->...i", np.abs(matrices[..., :3, :3]), boxes[..., 3:])
    return np.concatenate([center + matrices[..., :3, 3], size], -1)


def aligned_intersection(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """[...] volume that axis-aligned boxes [..., 6] of one frame share."""
    lo = np.maximum(a[..., :3] - a[..., 3:] / 2, b[..., :3] - b[..., 3:] / 2)
    hi = np.minimum(a[..., :3] + a[..., 3:] / 2, b[..., :3] + b[..., 3:] / 2)
    return np.prod(np.clip(hi - lo, 0, None), -1)


def aligned_enclosure(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """[...] volume of the smallest axis-aligned box around axis-aligned boxes [..., 6] of one
    frame."""
    lo = np.minimum(a[..., :3] - a[..., 3:] / 2, b[..., :3] - b[..., 3:] / 2)
    hi = np.maximum(a[..., :3] + a[..., 3:] / 2, b[..., :3] + b[..., 3:] / 2)
    return np.prod(hi - lo, -1)


def moving_enclosure(a: np.ndarray, b: np.ndarray, a_to_b: np.ndarray) -> np.ndarray:
    """[...] volume of a box around both as they stand: aligned with a or with b, the smaller.

    It is the box itself where a and b are the same, however they are turned; a box aligned with the
    world would not be.
    """
    in_b = aligned_enclosure(box_around(a, a_to_b), b)
    in_a = aligned_enclosure(a, box_around(b, np.linalg.inv(a_to_b)))
    return np.minimum(in_a, in_b)


def iou(shared: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """[...] IoU of boxes [..., 6] that share the volume [...]; NaN where neither has a volume."""
    union = volumes(a) + volumes(b) - shared
    return np.divide(shared, union, out=np.full(np.shape(union), np.nan), where=union > 0)


def generalized_iou(
    shared: np.ndarray, a: np.ndarray, b: np.ndarray, enclosure: np.ndarray
) -> np.ndarray:
    """[...] equation (1) for boxes [..., 6] that share the volume [...]; a union without volume
    counts as IoU 0."""
    union = volumes(a) + volumes(b) - shared
    gap = np.divide(
        enclosure - union, enclosure, out=np.zeros(np.shape(union)), where=enclosure > 0
    )
    return np.nan_to_num(iou(shared, a, b)) - gap


def exact_intersection(a: np.ndarray, b: np.ndarray, a_to_b: np.ndarray) -> np.ndarray:
    """[...] volume that boxes [..., 6] share, a moved by [..., 4, 4] into b's frame."""
    a, b, a_to_b = _broadcast(a, b, a_to_b)
    around = box_around(a, a_to_b)
    shared = np.minimum(
        aligned_intersection(around, b),
        aligned_intersection(a, box_around(b, np.linalg.inv(a_to_b))),
    )
    # A turn by quarters keeps boxes aligned: what the two share is what the boxes around them
    # share.
    turned = np.abs(a_to_b[..., :3, :3])
    oblique = np.any((turned > 1e-9) & (turned < 1 - 1e-9), (-1, -2)) & (shared > 0)
    for index in np.argwhere(oblique):
        k = tuple(index)
        moved = _solid(a[k]).transform(a_to_b[k][:3])
        shared[k] = (moved ^ _solid(b[k])).volume()
    return shared


def _solid(box: np.ndarray) -> manifold3d.Manifold:
    return manifold3d.Manifold.cube(box[3:], True).translate(box[:3])


def sampled_intersection(
    a: np.ndarray, b: np.ndarray, a_to_b: np.ndarray, number: int, rng: np.random.Generator
) -> np.ndarray:
    """[...] volume that boxes [..., 6] share, estimated as SINGAPO does: ``number`` points in each,
    counted in the other, averaged.

    Pairs that stand clear of each other are not sampled: their count is 0 for certain.
    """
    a, b, a_to_b = _broadcast(a, b, a_to_b)
    b_to_a = np.linalg.inv(a_to_b)
    shared = np.zeros(a.shape[:-1])
    near = np.minimum(
        aligned_intersection(box_around(a, a_to_b), b),
        aligned_intersection(a, box_around(b, b_to_a)),
    )
    pairs = np.flatnonzero(near.ravel() > 0)
    flat_a, flat_b = a.reshape(-1, 6), b.reshape(-1, 6)
    there, back = a_to_b.reshape(-1, 4, 4), b_to_a.reshape(-1, 4, 4)
    for start in range(0, len(pairs), CHUNK):
        k = pairs[start : start + CHUNK]
        inside_b = _share_inside(flat_a[k], flat_b[k], there[k], number, rng)
        inside_a = _share_inside(flat_b[k], flat_a[k], back[k], number, rng)
        estimate = (volumes(flat_a[k]) * inside_b + volumes(flat_b[k]) * inside_a) / 2
        shared.reshape(-1)[k] = estimate
    return shared


def _share_inside(
    a: np.ndarray, b: np.ndarray, a_to_b: np.ndarray, number: int, rng: np.random.Generator
) -> np.ndarray:
    """[P] share of ``number`` points uniform in a [P, 6] that lie in b [P, 6]."""
    # One map carries the unit cube of a to that of b, so that a point is inside where no coordinate
    # is beyond a half.
    linear = a_to_b[:, :3, :3] * a[:, None, 3:] / b[:, 3:, None]
    shift = (box_around(a, a_to_b)[:, :3] - b[:, :3]) / b[:, 3:]
    points = rng.random((len(a), 3, number), dtype=np.float32) - np.float32(0.5)
    points = linear.astype(np.float32) @ points + shift[:, :, None].astype(np.float32)
    return (np.abs(points, out=points).max(1) <= 0.5).mean(1)


def _broadcast(a: np.ndarray, b: np.ndarray, a_to_b: np.ndarray):
    shape = np.broadcast_shapes(a.shape[:-1], b.shape[:-1], a_to_b.shape[:-2])
    return (
        np.broadcast_to(a, (*shape, 6)),
        np.broadcast_to(b, (*shape, 6)),
        np.broadcast_to(a_to_b, (*shape, 4, 4)),
    )

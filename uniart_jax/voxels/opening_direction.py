"""The way that a part goes: which end of its range is closed, to which side it opens, and whether
it turns about its middle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from uniart_jax.objects.kinematics import Joint, subtrees
from uniart_jax.voxels.isosurface import to_points

OPENS = 0.05  # object units that a part's middle goes at least, where it opens to a side
FIRST = 0.1  # of its range, which says to which
ALONG_LATTICE = 0.998  # least cosine between a joint's axis and the axis of the lattice along it
AXIS = 0.95  # least cosine between a disc's axis and a side of its box
ROUND = 0.4  # least ratio of a disc's other two sides
MIDDLE = 0.25  # of these, that a disc's axis passes beside its middle at most


def opens_to(
    joint: Joint, cells: np.ndarray, body: np.ndarray, size: int
) -> tuple[int, int] | None:
    """(axis, side) to which a part of ``cells`` [n, 3] begins to open, from the end of its range
    that is nearer the middle of ``body`` [m, 3]; None where it hardly moves, or turns all round."""
    place = np.append(to_points(cells, size).mean(0), 1)
    ends = [(joint.motion(q) @ place)[:3] for q in joint.limits]
    if joint.type == "continuous" or np.abs(ends[1] - ends[0]).max() <= OPENS:
        return None
    closed = closed_end(joint, cells, center_of(body, size), size)
    opened = joint.limits[int(closed == joint.limits[0])]
    start, then = (joint.motion(q) @ place for q in (closed, closed + FIRST * (opened - closed)))
    way = (then - start)[:3]
    axis = int(np.abs(way).argmax())
    return axis, int(np.sign(way[axis]))


def closed_end(joint: Joint, cells: np.ndarray, center: np.ndarray, size: int) -> float:
    """The end of a joint's range at which the middle of its part's cells is nearer ``center`` [3];
    0 for what turns all round."""
    if joint.type == "continuous":
        return 0.0
    place = np.append(to_points(cells, size).mean(0), 1)
    far = [np.linalg.norm((joint.motion(q) @ place)[:3] - center) for q in joint.limits]
    return joint.limits[int(far[1] < far[0])]


def center_of(cells: np.ndarray, size: int) -> np.ndarray:
    """[3] middle of the box around cells [n, 3]."""
    return (to_points(cells.min(0), size) + to_points(cells.max(0), size)) / 2


def still_parts(parents: Sequence[int], joints: Sequence[Joint]) -> list[int]:
    """Parts that no joint moves."""
    below = subtrees(parents)
    movers = [k for k, up in enumerate(parents) if up >= 0 and joints[k].type != "fixed"]
    return [k for k in range(len(parents)) if not any(k in below[m] for m in movers)]


def round_about(centre: np.ndarray, size: np.ndarray, joint: Joint) -> int | None:
    """The side of a box that a part's axis runs along through its middle; None where it is no
    disc."""
    if not joint.rotates:
        return None
    axis = int(np.abs(joint.direction).argmax())
    others = np.delete(size, axis)
    beside = np.delete(centre - on_axis(centre, joint), axis)
    straight = abs(joint.direction[axis]) >= AXIS
    central = np.abs(beside).max() <= MIDDLE * others.max()
    return axis if straight and central and others.min() >= ROUND * others.max() else None


def on_axis(point: np.ndarray, joint: Joint) -> np.ndarray:
    """The place on a joint's axis that is nearest to a point."""
    return joint.origin + ((point - joint.origin) @ joint.direction) * joint.direction

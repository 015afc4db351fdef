"""Doors and drawers side by side get common edges.

A network says every edge apart, so that what is one line across a piece of furniture comes out as
several, and gaps between fronts are as uneven as its errors. Of 128 validation objects of the seven
families the true edges of fronts that lie within .03 of each other are the same to .001 in 19 of 20
pairs; gaps that a network gives between -.03 and .04 are .002 to .026 wide (docs/model_card.md).
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.panel_table import Panels

# lengths in object units
ALONG = 0.95  # least cosine between a joint's axis and an axis of the lattice
AJAR = 0.12  # radians from an end of its range at which a door is shown at most
DEEP = 0.1  # a slider that is less deep is no drawer: a button
THIN = 0.35  # largest thickness of a door over its width
FLUSH = 0.06  # between outer faces of one front
SAME = 0.03  # between edges that are one line
NEIGHBOURS = (-0.03, 0.04)  # gaps of fronts that are side by side ...
GAP = (0.005, 0.018)  # ... and what they become
FACING = 0.5  # share of the shorter of two edges that lies beside the other
LEAST = 0.02  # side of a front


def with_common_edges(layout: Layout) -> Layout:
    """A layout whose fronts have common edges, even gaps, and hinges and boards that go with them.

    Fronts are drawers and closed doors of one parent whose outer faces are flush when they are
    closed (``fronts_of``). All else, and a front alone, stays as it is.
    """
    lower = layout.boxes[:, :3] - layout.boxes[:, 3:] / 2
    upper = layout.boxes[:, :3] + layout.boxes[:, 3:] / 2
    for axis, parts in fronts_of(layout):
        first, second = np.delete(np.arange(3), axis)
        before = lower[parts], upper[parts]
        for along, across in ((first, second), (second, first)):
            spans = before[0][:, across], before[1][:, across]
            low, high = _common(before[0][:, along], before[1][:, along], *spans)
            wide = high - low > LEAST
            lower[parts, along] = np.where(wide, low, before[0][:, along])
            upper[parts, along] = np.where(wide, high, before[1][:, along])
    boxes = np.concatenate([(lower + upper) / 2, upper - lower], 1)
    moved = np.flatnonzero(np.abs(boxes - layout.boxes).max(1) > 1e-12)
    if not len(moved):
        return layout
    joints, boards = list(layout.joints), list(layout.boards)
    for k in moved:
        joints[k] = _joint_of(joints[k], layout.boxes[k], boxes[k])
        if boards:
            boards[k] = _boards_of(boards[k], layout.boxes[k], boxes[k])
    return dataclasses.replace(layout, boxes=boxes, joints=tuple(joints), boards=tuple(boards))


def fronts_of(layout: Layout) -> list[tuple[int, np.ndarray]]:
    """(axis across it, rows) of each front of two parts and more."""
    sides: dict[tuple[int, int, int], list[int]] = {}
    for k, parent in enumerate(layout.parents):
        if parent >= 0 and (facing := _facing(layout, k)) is not None:
            sides.setdefault((parent, *facing), []).append(k)
    found = []
    for (_, axis, side), parts in sides.items():
        drawn_out = np.array([layout.joints[k].travel[0] for k in parts])
        face = layout.boxes[parts, axis] + side * (layout.boxes[parts, 3 + axis] / 2 + drawn_out)
        found += [(axis, np.array(parts)[rows]) for rows in _apart(face, FLUSH)]
    return [(axis, parts) for axis, parts in found if len(parts) > 1]


def _facing(layout: Layout, k: int) -> tuple[int, int] | None:
    """(axis, side) that a drawer or a closed door faces; None for all else."""
    joint, box = layout.joints[k], layout.boxes[k]
    axis = int(np.abs(joint.direction).argmax())
    if abs(joint.direction[axis]) < ALONG:
        return None
    if joint.type == "prismatic":
        return (axis, int(np.sign(joint.direction[axis]))) if box[3 + axis] > DEEP else None
    if joint.type != "revolute" or min(np.abs(joint.angle)) > AJAR:
        return None
    thick, wide = sorted(np.delete(np.arange(3), axis), key=lambda side: box[3 + side])
    if box[3 + thick] > THIN * box[3 + wide]:
        return None
    parent = layout.boxes[layout.parents[k]]
    return int(thick), 1 if box[thick] > parent[thick] else -1


def _common(
    low: np.ndarray, high: np.ndarray, start: np.ndarray, end: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Edges [n] of fronts along an axis, those that are one line at their mean, with even gaps;
    ``start``, ``end`` [n]: their edges along the other."""
    low, high = low.copy(), high.copy()
    lows, highs = _alike(low, SAME), _alike(high, SAME)
    for edges, lines in ((low, lows), (high, highs)):
        for rows in lines:
            edges[rows] = edges[rows].mean()
    beside = np.minimum(end[:, None], end) - np.maximum(start[:, None], start)
    faces = beside > FACING * np.minimum((end - start)[:, None], end - start)
    np.fill_diagonal(faces, False)
    for one, other in itertools.product(highs, lows):
        gap = low[other[0]] - high[one[0]]
        if NEIGHBOURS[0] < gap < NEIGHBOURS[1] and faces[np.ix_(one, other)].any():
            middle = (low[other[0]] + high[one[0]]) / 2
            half = np.clip(gap, *GAP) / 2
            high[one], low[other] = middle - half, middle + half
    return low, high


def _alike(values: np.ndarray, width: float) -> list[np.ndarray]:
    """Indices of values in groups no wider than ``width``, from the smallest value on."""
    groups: list[list[int]] = []
    for k in np.argsort(values, kind="stable").tolist():
        if groups and values[k] - values[groups[-1][0]] <= width:
            groups[-1].append(k)
        else:
            groups.append([k])
    return [np.array(group) for group in groups]


def _apart(values: np.ndarray, step: float) -> Sequence[np.ndarray]:
    """Indices of values in groups whose neighbours are no more than ``step`` apart."""
    order = np.argsort(values, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(values[order]) > step) + 1)


def _moved(points: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Points [..., 3] that go with a box [6] which is shifted and stretched."""
    return after[:3] + (points - before[:3]) * after[3:] / before[3:]


def _joint_of(joint: Joint, before: np.ndarray, after: np.ndarray) -> Joint:
    if joint.type != "revolute":
        return joint
    return dataclasses.replace(joint, origin=_moved(joint.origin, before, after))


def _boards_of(boards: Panels | None, before: np.ndarray, after: np.ndarray) -> Panels | None:
    if boards is None:
        return None
    corners = _moved(boards.boxes.reshape(-1, 2, 3), before, after)
    return dataclasses.replace(boards, boxes=corners.reshape(-1, 6))

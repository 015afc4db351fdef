"""Parts that voxels are too coarse for: a knob that turns about its middle, a turntable, or a small
one that a layout holds and voxels hardly show, is made of its row alone, a disc or a block of its
box in the row's colour."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import trimesh

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.isosurface import DenseField, srgb_bytes, to_cells, to_points
from uniart_jax.voxels.joint_code import box_corners
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.opening_direction import on_axis, round_about

SMALL = 0.15  # object units; larger parts have voxels, or are not there
LOW, EVEN = 0.25, 0.85  # of its width that a turntable is high at most, and deep at least
FILLED = 0.5  # of its box that solid sub-cells fill at least, where voxels show a turntable
SHOWN = 0.1  # share of its box that a part's solid sub-cells fill at least where voxels show it
SURE = 0.5  # least confidence of a row that is believed without voxels
NEAR = 0.05  # object units, from its parent's box
BURIED = 0.5  # share of a disc's slice within other parts, from which on it is cut off
GAP = 0.003  # object units between a disc and the surface that it stands on, so that it turns
THINNEST = 2  # sub-cells that a disc then stands out at least
ROOM = 0.9  # share of the way between two discs that they fill
SMALLER = 0.4  # share of its size that a disc keeps at least where others are near
SECTIONS = 32  # of a disc's rim


def needed(layout: Layout, solid: np.ndarray, cells: int) -> list[int]:
    """Rows of a layout that stand-ins are made of.

    Args:
      solid: [K] solid sub-cells of each row. cells: sub-cells along the grid's side.
    """
    corners = box_corners(layout.boxes)
    gaps = np.maximum(corners[:, None, :3] - corners[:, 3:], corners[:, :3] - corners[:, None, 3:])
    size = layout.boxes[:, 3:]
    volume = np.prod(np.maximum(size * cells, 1), -1)
    return [
        k
        for k, parent in enumerate(layout.parents)
        if parent >= 0
        and (
            size[k].max() <= SMALL
            or (_is_turntable(layout, k) and not SHOWN <= solid[k] / volume[k] < FILLED)
        )
        and layout.confidence[k] >= SURE
        and gaps[k, parent].max() <= NEAR
        and (
            solid[k] < SHOWN * volume[k]
            or round_about(layout.boxes[k, :3], size[k], layout.joints[k]) is not None
        )
    ]


def _is_turntable(layout: Layout, row: int) -> bool:
    """Whether a row is a low disc that turns about an upright axis, without end, within its parent,
    and carries nothing."""
    joint, box = layout.joints[row], layout.boxes[row]
    inner, outer = box_corners(layout.boxes[[row, layout.parents[row]]])
    within = (inner[:3] >= outer[:3]).all() and (inner[3:] <= outer[3:]).all()
    upright = joint.type == "continuous" and round_about(box[:3], box[3:], joint) == 2
    low = box[5] <= LOW * box[3:5].min() and box[3:5].min() >= EVEN * box[3:5].max()
    return bool(upright and low and within and row not in layout.parents)


def primitive_part(
    box: np.ndarray, joint: Joint, color: np.ndarray, thinnest: float
) -> trimesh.Trimesh:
    """A closed mesh that fills a box: a disc where the part turns about its middle, else a block.

    Args:
      box: [6] centre and size, object units. color: [3] linear RGB. thinnest: least side.
    """
    centre, size = np.array(box[:3], np.float64), np.maximum(box[3:], thinnest)
    axis = round_about(centre, size, joint)
    if axis is None:
        mesh = trimesh.creation.box(size)
    else:
        others = np.delete(np.arange(3), axis)
        size[others] = size[others].mean()
        centre = on_axis(centre, joint)
        mesh = trimesh.creation.cylinder(0.5, 1.0, sections=SECTIONS)  # along z
        turned = np.eye(4)[[(axis + 1) % 3, (axis + 2) % 3, axis, 3]].T  # z goes to the axis
        mesh.apply_transform(np.diag([*size, 1.0]) @ turned)
        # along its own axis, or it would wobble about it
        straight = joint.direction * np.sign(joint.direction[axis])
        mesh.apply_transform(trimesh.geometry.align_vectors(np.eye(3)[axis], straight))
    mesh.apply_translation(centre)
    rgb = srgb_bytes(np.clip(np.asarray(color, np.float32), 0, 1))
    colors = np.tile(np.append(rgb, 255).astype(np.uint8), (len(mesh.vertices), 1))
    return trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_colors=colors, process=False)


def doubles(layout: Layout, rows: Sequence[int]) -> list[int]:
    """Of rows of stand-ins, discs that are found twice: so near to a surer one that both cannot be
    made smaller (``side_by_side``)."""
    rows = sorted(rows, key=lambda k: -layout.confidence[k])
    kept: list[int] = []
    for k in rows:
        pairs = (_pair(layout.boxes[[i, k]], [layout.joints[i], layout.joints[k]]) for i in kept)
        if not any(pair and pair.apart < SMALLER * pair.radii for pair in pairs):
            kept.append(k)
    return sorted(set(rows) - set(kept))


def side_by_side(boxes: np.ndarray, joints: Sequence[Joint]) -> np.ndarray:
    """[n, 6] boxes of stand-ins, of which discs that would touch are made smaller, down to
    ``SMALLER``, so that each can turn."""
    made = np.array(boxes, np.float64)
    for i in range(len(made)):
        for k in range(i):
            pair = _pair(boxes[[i, k]], [joints[i], joints[k]])
            if pair is None:
                continue
            sides = np.ix_(np.array([i, k]), 3 + pair.others)
            radii = float(made[sides].mean(1).sum()) / 2  # by now
            if SMALLER * pair.radii <= pair.apart < radii:
                made[sides] *= pair.apart / radii
    return made


class _Pair(NamedTuple):
    """Two discs beside each other."""

    others: np.ndarray  # [2] the axes across theirs
    apart: float  # ``ROOM`` of the way between their axes
    radii: float  # sum of both


def _pair(boxes: np.ndarray, joints: Sequence[Joint]) -> _Pair | None:
    """Two boxes [2, 6] as discs beside each other, about axes in one direction; None if they are
    not."""
    axes = {round_about(b[:3], b[3:], j) for b, j in zip(boxes, joints, strict=True)}
    axis = axes.pop()
    if axes or axis is None:
        return None
    first, second = (on_axis(b[:3], j) for b, j in zip(boxes, joints, strict=True))
    between, others = np.abs(first - second), np.delete(np.arange(3), axis)
    if between[axis] >= boxes[:, 3 + axis].sum() / 2:
        return None
    radii = float(boxes[:, 3 + others].mean(1).sum()) / 2
    return _Pair(others, ROOM * float(np.hypot(*between[others])), radii)


def in_front(mesh: trimesh.Trimesh, joint: Joint, field: DenseField) -> trimesh.Trimesh:
    """A disc without the end that lies within other parts, so that it stands on their surface;
    what is no disc, or hardly comes out of them, as it is.

    Args:
      mesh: of ``primitive_part``.
    """
    low, high = np.asarray(mesh.bounds)
    axis = round_about((low + high) / 2, high - low, joint)
    if axis is None:
        return mesh
    size = field.sdf.shape[0] - 2
    first, last = (to_cells(end, size) for end in (low, high))
    first = np.clip(np.rint(first).astype(int), 1, size)
    last = np.maximum(np.clip(np.rint(last).astype(int), 1, size), first + 1)
    window = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
    solid = np.moveaxis(field.sdf[window] < 0, axis, 0)
    share = solid.reshape(len(solid), -1).mean(1)
    inner_first = share[: len(share) // 2].sum() >= share[(len(share) + 1) // 2 :].sum()
    buried = np.flatnonzero((share if inner_first else share[::-1]) >= BURIED)
    if not len(buried) or len(share) - 1 - buried[-1] < THINNEST:
        return mesh
    vertices = np.array(mesh.vertices)
    if inner_first:
        surface = to_points(first[axis] + buried[-1] + 1, size) + GAP
        vertices[:, axis] = np.maximum(vertices[:, axis], surface)
    else:
        surface = to_points(last[axis] - 1 - buried[-1], size) - GAP
        vertices[:, axis] = np.minimum(vertices[:, axis], surface)
    made = mesh.copy()
    made.vertices = vertices
    return made

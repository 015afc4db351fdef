"""The boards that drawers and doors usually have, for layouts that tell of boxes alone."""

from __future__ import annotations

import dataclasses

import numpy as np

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.closed_pose import closing_of
from uniart_jax.voxels.joint_code import box_corners
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.opening_direction import ALONG_LATTICE
from uniart_jax.voxels.panel_table import Panels

# object units
FRONT, WALL = 0.02, 0.014  # thickness of a drawer's front, of its walls and its floor
DEEP = 0.1  # what slides is a drawer from this depth on
FLAT = 0.06  # what turns is a door up to this thickness
PLATE = 0.25  # and up to this share of its next longer side
HEIGHT = 0.75  # of a drawer's walls, as a share of its front's


def with_usual_boards(layout: Layout) -> Layout:
    """The layout with boards of moving parts of which it has none: what slides and is deep has a
    front, walls and a floor; a flat part that is drawn closed is one plate."""
    if layout.boards or len(layout) < 2:
        return layout
    closed = (closing_of(layout.joints, layout.boxes, layout.parents) == np.eye(3, 4)).all((1, 2))
    corners = box_corners(np.asarray(layout.boxes, np.float64))
    found: list[Panels | None] = []
    for k, joint in enumerate(layout.joints):
        boards = None
        if layout.parents[k] >= 0 and joint.type == "prismatic":
            boards = _drawer(corners[k], joint)
        elif layout.parents[k] >= 0 and joint.type == "revolute" and closed[k]:
            short, middle = np.sort(layout.boxes[k, 3:])[:2]
            boards = corners[k][None] if short < min(FLAT, PLATE * middle) else None
        found.append(None if boards is None else Panels(boards, 1.0, estimate=False))
    return dataclasses.replace(layout, boards=tuple(found))


def _drawer(corners: np.ndarray, joint: Joint) -> np.ndarray | None:
    """[5, 6] corners of the boards of a drawer in a box [6]: front, floor, sides and back; None of
    what slides up, askew, or is flat."""
    axis = int(np.abs(joint.direction).argmax())
    low, high = corners[:3], corners[3:]
    if axis == 2 or abs(joint.direction[axis]) < ALONG_LATTICE or (high - low)[axis] < DEEP:
        return None
    ends = np.array(joint.travel) * joint.direction[axis]
    opens = 1 if ends[np.abs(ends).argmax()] > 0 else -1
    across = 1 - axis
    boards = np.tile(corners, (5, 1))
    front, floor, left, right, back = boards
    if opens > 0:
        front[axis], back[3 + axis] = high[axis] - FRONT, low[axis] + WALL
    else:
        front[3 + axis], back[axis] = low[axis] + FRONT, high[axis] - WALL
    floor[5] = low[2] + WALL
    left[3 + across], right[across] = low[across] + WALL, high[across] - WALL
    for wall in (left, right, back):
        wall[5] = low[2] + HEIGHT * (high - low)[2]
    return boards

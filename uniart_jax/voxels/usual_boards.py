"""The boards that drawers and doors usually have, for layouts that tell of boxes alone."""

from __future__ import annotations

import dataclasses

import numpy as np

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.closed_pose import closing_of
from uniart_jax.voxels.joint_code import box_corners
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.opening_direction import ALONG_LATTICE, round_about
from uniart_jax.voxels.panel_table import FLAT, Panels, is_plate

# metres
FRONT, WALL = 0.018, 0.012  # thickness of a drawer's front, of its walls and its floor
DEEP = 0.1  # what slides is a drawer from this depth on
THINNEST = 0.012  # object units: about as thick as sub-cells can show
HEIGHT = 0.75  # of a drawer's walls, as a share of its front's


def with_usual_boards(layout: Layout, side: float = 1.0) -> Layout:
    """The layout with boards of moving parts of which it has none, nor an outline: what slides
    along the ground and is deep has a front, walls and a floor; a flat part that is drawn closed is
    one plate.

    Args:
      layout: in object units (``Layout.normalized``). side: metres of its longest side.
    """
    if len(layout) < 2:
        return layout
    closed = (closing_of(layout.joints, layout.boxes, layout.parents) == np.eye(3, 4)).all((1, 2))
    corners = box_corners(np.asarray(layout.boxes, np.float64))
    body = layout.boxes[layout.parents.index(-1)]
    found = list(layout.boards or [None] * len(layout))
    outlines = layout.revolutions or [None] * len(layout)
    for k, joint in enumerate(layout.joints):
        moves = layout.parents[k] >= 0 and joint.type in ("prismatic", "revolute")
        if found[k] is not None or outlines[k] is not None or not moves or not closed[k]:
            continue
        if round_about(layout.boxes[k, :3], layout.boxes[k, 3:], joint) is not None:
            continue  # knobs and turntables are made of their boxes
        boards = None
        if is_plate(layout.boxes[k, 3:], FLAT / side):
            boards = corners[k][None]
        elif joint.type == "prismatic":
            boards = _drawer(corners[k], joint, body, side)
        found[k] = None if boards is None else Panels(boards, 1.0, estimate=False)
    return dataclasses.replace(layout, boards=tuple(found))


def _drawer(corners: np.ndarray, joint: Joint, body: np.ndarray, side: float) -> np.ndarray | None:
    """[5, 6] corners of the boards of a drawer in a box [6]: front, floor, sides and back; None of
    what slides up, askew, or is too small. ``body``: [6] centre and size of what it opens from."""
    axis = int(np.abs(joint.direction).argmax())
    across = 1 - axis
    low, high = corners[:3], corners[3:]
    front_wall, wall = (max(metres / side, THINNEST) for metres in (FRONT, WALL))
    size = high - low
    if axis == 2 or abs(joint.direction[axis]) < ALONG_LATTICE or size[axis] < DEEP / side:
        return None
    if size[across] < 4 * wall or size[2] < 2 * wall:
        return None
    ends = (low + high)[axis] / 2 + np.array(joint.travel) * joint.direction[axis]
    away = np.abs(ends - body[axis])  # it is open where it is farther from the body's middle
    opens = ends[away.argmax()] - ends[away.argmin()]
    boards = np.tile(corners, (5, 1))
    front, floor, left, right, back = boards
    if opens > 0:
        front[axis], back[3 + axis] = high[axis] - front_wall, low[axis] + wall
    else:
        front[3 + axis], back[axis] = low[axis] + front_wall, high[axis] - wall
    floor[5] = low[2] + wall
    left[3 + across], right[across] = low[across] + wall, high[across] - wall
    for own in (left, right, back):
        own[5] = low[2] + HEIGHT * size[2]
    return boards

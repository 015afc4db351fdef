"""Racks behind doors, as those of dishwashers and ovens, as trays.

Their wires are thinner than voxels, and a closed door hides them, so a structure network draws
fragments. A rack becomes a tray that fills its box: a floor, and walls around it where the box is
high.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.closed_pose import moved
from uniart_jax.voxels.isosurface import DenseField, to_cells, to_points
from uniart_jax.voxels.joint_code import box_corners
from uniart_jax.voxels.opening_direction import center_of, closed_end, opens_to

THICK = 2.2  # sub-cells, of a tray's floor and walls
FLAT = 2.0  # times that thickness, up to which a box is a floor alone
LEVEL = 0.95  # of its direction that a slider runs along x or y at least
COVERED = 0.5  # of its cross-section that doors cover at least
PLATE = 0.35  # of its smaller side that a door is thick at most
WIRES = 0.5  # of its box that what is drawn of a rack fills at most
FRONT, OPEN = 4, 0.9  # sub-cells at a rack's front, and share of it that may be drawn there


def trays(
    field: DenseField,
    boxes: np.ndarray,
    joints: Sequence[Joint],
    parents: Sequence[int],
    body: Sequence[int],
    closed: np.ndarray,
    rows: Collection[int],
) -> dict[int, np.ndarray]:
    """Boards [1 or 5, 6] of those of some parts that are racks: lower and upper corners as shown,
    object units. A rack slides level out of what does not move, from behind doors that cover it
    when all are closed, and what is drawn of it is neither solid nor has a front.

    Args:
      field: as it is drawn. boxes: [K, 6] centre and size of the first K parts, object units.
      joints, parents: theirs. body: owners that do not move. closed: [K, 3, 4] motions that close
        doors (``closed_pose.closing_of``). rows: the parts that may be racks.
    """
    rows = [k for k in rows if joints[k].type == "prismatic" and parents[k] in body]
    if not rows:
        return {}
    size, solid = field.sdf.shape[0] - 2, field.sdf < 0
    cells = [np.argwhere(solid & (field.owner == k)) for k in range(len(boxes))]
    held = np.argwhere(solid & np.isin(field.owner, list(body)))
    doors = [
        moved(closed[k], to_points(cells[k], size))
        for k in range(len(boxes))
        if joints[k].type == "revolute" and k not in body and len(cells[k])
    ]
    found = {}
    for k in rows:
        joint, box = joints[k], box_corners(np.asarray(boxes[k], np.float64))
        there = len(cells[k]) and len(held)
        way = opens_to(joint, cells[k], held, size) if there else None
        if way is None or way[0] == 2 or abs(joint.direction[way[0]]) < LEVEL:
            continue
        at_rest = closed_end(joint, cells[k], center_of(held, size), size)
        shift = np.tile(joint.motion(at_rest)[:3, 3], 2)
        if _is_wire(cells[k], to_cells(box, size), *way) and _behind(box + shift, doors, *way):
            found[k] = _tray(box, THICK / size)
    return found


def _is_wire(cells: np.ndarray, box: np.ndarray, axis: int, side: int) -> bool:
    """Whether cells [n, 3] leave most of their box [6] free, and its front to a side of an axis."""
    sizes = np.maximum(box[3:] - box[:3], 1)
    across = [a for a in range(3) if a != axis]
    end = cells[:, axis].max() if side > 0 else cells[:, axis].min()
    front = cells[np.abs(cells[:, axis] - end) < FRONT][:, across]
    drawn = len(np.unique(front, axis=0)) / sizes[across].prod()
    return bool(len(cells) <= WIRES * sizes.prod() and drawn <= OPEN)


def _behind(box: np.ndarray, doors: Sequence[np.ndarray], axis: int, side: int) -> bool:
    """Whether doors, points [n, 3] each, cover a closed box [6] that opens to a side of an axis."""
    front = box[axis + 3] if side > 0 else box[axis]
    across = [a for a in range(3) if a != axis]
    low, high = box[:3][across], box[3:][across]
    covered = 0.0
    for door in doors:
        first, last = np.quantile(door, (0.02, 0.98), axis=0)
        plate = last[axis] - first[axis] <= PLATE * (last - first)[across].min()
        if plate and side * (np.median(door[:, axis]) - front) > 0:
            common = np.minimum(last[across], high) - np.maximum(first[across], low)
            covered += np.maximum(common, 0).prod()
    return bool(covered >= COVERED * np.maximum(high - low, 1e-6).prod())


def _tray(box: np.ndarray, thick: float) -> np.ndarray:
    """[1 or 5, 6] floor and walls of a tray that fills a box [6]."""
    if box[5] - box[2] <= FLAT * thick:
        return box[None].copy()
    thick = min(thick, float((box[3:] - box[:3]).min()))
    floor, walls = box.copy(), np.tile(box, (4, 1))
    floor[5] = box[2] + thick
    for k, (axis, upper) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
        walls[k, axis + 3 * (1 - upper)] = box[axis + 3 * upper] + (thick, -thick)[upper]
    return np.concatenate([floor[None], walls])

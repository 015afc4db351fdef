"""Racks behind doors, as those of dishwashers and ovens, as trays.

Their wires are thinner than voxels, and a closed door hides them, so a structure network draws
fragments. A rack becomes a tray that fills its box: a floor, and walls around it where the box is
high.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.closing import moved
from uniart_jax.voxels.isosurface import DenseField
from uniart_jax.voxels.joint_code import box_corners
from uniart_jax.voxels.ways import center_of, closed_end, opens_to, places

THICK = 2.2  # sub-cells, of a tray's floor and walls
FLAT = 4.0  # times that thickness, up to which a box is a floor alone
COVERED = 0.5  # of its cross-section that a door covers at least


def trays(
    field: DenseField,
    boxes: np.ndarray,
    joints: Sequence[Joint],
    body: Sequence[int],
    closed: np.ndarray,
    rows: Collection[int],
) -> dict[int, np.ndarray]:
    """Boards [1 or 5, 6] of those of some parts that are racks: lower and upper corners as shown,
    object units. A rack slides out level from behind a door, which covers it when both are closed.

    Args:
      field: as it is drawn. boxes: [K, 6] centre and size of the first K parts, object units.
      joints: theirs. body: owners that do not move. closed: [K, 3, 4] motions that close doors
        (``closing.closing_of``). rows: the parts that may be racks.
    """
    size, solid = field.sdf.shape[0] - 2, field.sdf < 0
    cells = [np.argwhere(solid & (field.owner == k)) for k in range(len(boxes))]
    held = np.argwhere(solid & np.isin(field.owner, list(body)))
    doors = [
        moved(closed[k], places(cells[k], size))
        for k in range(len(boxes))
        if joints[k].type == "revolute" and k not in body and len(cells[k])
    ]
    found = {}
    for k in rows:
        if joints[k].type != "prismatic" or k in body or not len(cells[k]) or not len(held):
            continue
        way = opens_to(joints[k], cells[k], held, size)
        if way is None or way[0] == 2:
            continue
        at_rest = closed_end(joints[k], cells[k], center_of(held, size), size)
        shift = np.tile(joints[k].motion(at_rest)[:3, 3], 2)
        box = box_corners(np.asarray(boxes[k], np.float64))
        if _behind(box + shift, doors, *way):
            found[k] = _tray(box, THICK / size)
    return found


def _behind(box: np.ndarray, doors: Sequence[np.ndarray], axis: int, side: int) -> bool:
    """Whether one of the doors, points [n, 3] each, covers a closed box [6] that opens to a side of
    an axis."""
    front = box[axis + 3] if side > 0 else box[axis]
    across = [a for a in range(3) if a != axis]
    low, high = box[:3][across], box[3:][across]
    for door in doors:
        first, last = np.quantile(door[:, across], (0.02, 0.98), axis=0)
        common = np.maximum(np.minimum(last, high) - np.maximum(first, low), 0).prod()
        before = side * (np.median(door[:, axis]) - front) > 0
        if before and common >= COVERED * np.maximum(high - low, 1e-6).prod():
            return True
    return False


def _tray(box: np.ndarray, thick: float) -> np.ndarray:
    """[1 or 5, 6] floor and walls of a tray that fills a box [6]."""
    thick = min(thick, float((box[3:] - box[:3]).min()))
    floor = box.copy()
    floor[5] = box[2] + thick
    if box[5] - box[2] <= FLAT * thick:
        return floor[None]
    walls = np.tile(box, (4, 1))
    for k, (axis, upper) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
        walls[k, axis + 3 * (1 - upper)] = box[axis + 3 * upper] + (thick, -thick)[upper]
    return np.concatenate([floor[None], walls])

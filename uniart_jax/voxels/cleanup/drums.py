"""Drums, as those of washing machines, and the round openings before them.

A network that sees a closed door draws what is behind it as the mean of all that could be there:
a drum with torn edges, a hole with lumps. That it is a drum is known: it turns without end about an
axis that runs through its middle. So it becomes a shell of its radius with a back, and what does
not move before it a plate with a round hole, as wide as most of it is.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.cleanup.fronts import closed_door
from uniart_jax.voxels.isosurface import ZERO, DenseField, to_cells

ALONG = 0.99  # least cosine between a drum's axis and one of the lattice
WIDE = 0.15  # object units, that a drum is wide and high at least
DEEP = 0.08  # and deep
SQUARE = 1.25  # ratio of its other two sides at most
CENTRAL = 0.1  # of its width, that its axis passes beside its middle at most
HOLLOW = 0.5  # share of a drum's inside that is solid at most
OPEN = 0.5  # share of what lies before its middle that is solid at most
INNER = 0.85  # of its radius, that lies within what does not move
SECTORS, AROUND = 24, 0.6  # of directions from its axis, and share of them that show its shell
SHELL = 3  # sub-cells, least thickness of its shell and of its back
THICK = 0.35  # of its radius, most
LOW = 25.0  # percent of its layers, and of its back's columns, that are drawn thinner
TRIM = 2.0  # percent of its cells that are not looked at, at either end
MET = 0.5  # share of a ring that is solid, from which on it is no longer the hole
RING = 3.0  # sub-cells, width of such rings
NARROW, FULL = 0.4, 0.95  # radius of the hole, least and most, over the drum's
PLATE = 3  # sub-cells, thickness of the plate around the hole where it is torn
PANEL = 6  # sub-cells beyond the drum's radius that the plate is whole
APART = 2  # sub-cells between the plate and moving parts
NEAR = 2.0  # sub-cells from a surface within which its distance is written


class Drum(NamedTuple):
    """A drum in cells.

    Attributes:
      part: its owner. axis, side: of the lattice, and to which side of it it is open.
      middle: [2] of its axis across. radius: its outer one. low, high: its first layer along the
        axis, and the one after the last.
      shell, bottom: thickness of its shell and of its back.
      door: the layer that the door before it ends at when it is closed; None without one.
    """

    part: int
    axis: int
    side: int
    middle: np.ndarray
    radius: float
    low: int
    high: int
    shell: float = SHELL
    bottom: float = SHELL
    door: int | None = None


def drums(
    field: DenseField, boxes: np.ndarray, joints: Sequence[Joint], body: Sequence[int]
) -> list[Drum]:
    """Parts that are drums, open to one side.

    Args:
      field: of the shown state. boxes: [K, 6] centre and size of the first K parts, object units.
        joints: theirs. body: owners that do not move.
    """
    found = []
    for part, (box, joint) in enumerate(zip(boxes, joints, strict=True)):
        if part in body or joint.type != "continuous":
            continue
        drum = _drum(field, part, box, joint, body)
        if drum is not None:
            doors = [k for k in range(len(boxes)) if k not in body and joints[k].type == "revolute"]
            found.append(drum._replace(door=_door(field, drum, boxes, joints, doors, body)))
    return found


def _door(
    field: DenseField,
    drum: Drum,
    boxes: np.ndarray,
    joints: Sequence[Joint],
    doors: Sequence[int],
    body: Sequence[int],
) -> int | None:
    """The layer at the back of the closed door before a drum, of several the innermost."""
    solid, across = field.sdf < 0, np.delete(np.arange(3), drum.axis)
    still, ends = solid & np.isin(field.owner, body), []
    for k in doors:
        cells = np.argwhere(solid & (field.owner == k))
        door = closed_door(cells, boxes[k], joints[k], still) if len(cells) else None
        if door is None or (door.axis, door.side) != (drum.axis, drum.side):
            continue
        if (door.low[across] < drum.middle).all() and (door.high[across] > drum.middle).all():
            ends.append(int((door.low if drum.side > 0 else door.high)[drum.axis]))
    return (min(ends) if drum.side > 0 else max(ends)) if ends else None


def _drum(
    field: DenseField, part: int, box: np.ndarray, joint: Joint, body: Sequence[int]
) -> Drum | None:
    axis = int(np.abs(joint.direction).argmax())
    across = np.delete(np.arange(3), axis)
    wide = box[3 + across]
    beside = np.abs(box[across] - joint.origin[across]).max()
    if abs(joint.direction[axis]) < ALONG or wide.min() < WIDE or box[3 + axis] < DEEP:
        return None
    if wide.max() > SQUARE * wide.min() or beside > CENTRAL * wide.max():
        return None
    size = field.sdf.shape[0] - 2
    solid = field.sdf < 0
    cells = np.argwhere(solid & (field.owner == part))
    if not len(cells):
        return None
    middle = to_cells(joint.origin[across], size)
    radius = float(wide.mean()) / 2 * size
    low, high = np.percentile(cells[:, axis], [TRIM, 100 - TRIM])
    low, high = int(np.floor(low)), int(np.ceil(high)) + 1
    columns = _radius(field.sdf.shape, axis, middle)
    layers = np.moveaxis(solid & np.isin(field.owner, [part, *body]), axis, 0)
    if (
        high - low < 2 * SHELL
        or not (columns < radius / 2).any()
        or layers[low:high][:, columns < radius / 2].mean() > HOLLOW
    ):
        return None
    still = np.moveaxis(solid & np.isin(field.owner, body), axis, 0)
    if not _encloses(still, middle, radius, low, high):
        return None
    if _around(cells[:, across] - middle, radius) < AROUND:
        return None
    there = np.flatnonzero(still.any((1, 2)))
    before = {1: still[high : there[-1] + 1], -1: still[there[0] : low]}
    closed = {side: _share(cells[:, columns < radius / 2]) for side, cells in before.items()}
    side = min(closed, key=lambda s: closed[s])
    if closed[side] > OPEN:
        return None
    drum = layers[low:high] & np.moveaxis(field.owner == part, axis, 0)[low:high]
    area = drum[:, columns >= radius / 2].sum(1)  # of a ring: pi (R^2 - (R - thickness)^2)
    ring = radius - np.sqrt(np.maximum(radius**2 - area / np.pi, 0))
    behind = drum[: len(drum) // 2] if side > 0 else drum[len(drum) // 2 :]
    depths = behind[:, columns < radius / 2].sum(0)
    thick = float(np.percentile(ring, LOW)), float(np.percentile(depths, LOW))
    shell, bottom = (float(np.clip(t, SHELL, THICK * radius)) for t in thick)
    return Drum(part, axis, side, middle, radius, low, high, shell, bottom)


def _encloses(still: np.ndarray, middle: np.ndarray, radius: float, low: int, high: int) -> bool:
    """Whether cells [D, U, V] of what does not move lie around a drum, at every side of it."""
    spans = [np.flatnonzero(still.any(tuple({0, 1, 2} - {k}))) for k in range(3)]
    if not len(spans[0]):
        return False
    inner = INNER * radius
    drum = [(low + SHELL, high - SHELL), *((m - inner, m + inner) for m in middle)]
    return all(s[0] <= a and b <= s[-1] + 1 for s, (a, b) in zip(spans, drum, strict=True))


def _around(cells: np.ndarray, radius: float) -> float:
    """Share of the directions from a drum's axis in which some of its cells [n, 2] are its
    shell's."""
    shell = np.abs(np.hypot(*cells.T) - radius) < 2 * SHELL
    sectors = np.floor((np.arctan2(*cells[shell].T) / np.pi + 1) / 2 * SECTORS).astype(int)
    return len(np.unique(sectors % SECTORS)) / SECTORS


def _share(solid: np.ndarray) -> float:
    """The largest share of a layer [D, n] that is solid; 0 of none."""
    return float(solid.mean(1).max()) if solid.size else 0.0


def _radius(shape: tuple[int, ...], axis: int, middle: np.ndarray) -> np.ndarray:
    """[U, V] distance of the cells of a layer from the axis."""
    u, v = (np.arange(n) for n in np.delete(shape, axis))
    return np.hypot(u[:, None] - middle[0], v[None] - middle[1])


def with_drums(field: DenseField, body: Sequence[int], found: Sequence[Drum]) -> DenseField:
    """A field whose drums are hollow and round, and open through a round hole.

    Args:
      body: owners that do not move. found: of the same field (``drums``).

    Returns:
      A new field; cells of moving parts but the drums are as they were.
    """
    field = dataclasses.replace(field, sdf=field.sdf.copy(), owner=field.owner.copy())
    for drum in found:
        sdf, owner = (np.moveaxis(v, drum.axis, 0)[:: -drum.side] for v in (field.sdf, field.owner))
        ends = (drum.low, drum.high, drum.door)
        if drum.side > 0:  # as seen from where it is open
            ends = (
                len(sdf) - drum.high,
                len(sdf) - drum.low,
                None if drum.door is None else len(sdf) - drum.door,
            )
        front, back, door = ends
        radius = _radius(field.sdf.shape, drum.axis, drum.middle)
        front = _open(sdf, owner, drum, radius, front, door, body)
        _shell(sdf, owner, drum, radius, (min(front, back - 2 * SHELL), back), body)
    return field


def _shell(
    sdf: np.ndarray,
    owner: np.ndarray,
    drum: Drum,
    radius: np.ndarray,
    layers: tuple[int, int],
    body: Sequence[int],
) -> None:
    """In place: a drum in cells [D, U, V], seen from where it is open, as a shell with a back."""
    front, back = layers
    depth = np.arange(len(sdf), dtype=np.float32)[:, None, None]
    outside = np.maximum(radius - drum.radius, np.maximum(front - 0.5 - depth, depth - back + 0.5))
    inside = np.maximum(radius - (drum.radius - drum.shell), depth - (back - drum.bottom - 0.5))
    wall = np.maximum(outside, -inside).astype(np.float32)
    ours = np.isin(owner, [drum.part, -1, *body]) | (sdf > 0)
    near = ours & (outside < NEAR)
    near[[0, -1]] = near[:, [0, -1]] = near[:, :, [0, -1]] = False  # the layer of outside
    sdf[near] = np.clip(wall[near], -NEAR, NEAR)
    sdf[near & (np.abs(sdf) < ZERO)] = -ZERO
    owner[near & (sdf < 0)] = drum.part
    free = near & (sdf > 0) & (wall < 1)
    owner[free] = drum.part
    stray = (owner == drum.part) & ~near & (sdf < 0)
    sdf[stray] = 0.5


def _open(
    sdf: np.ndarray,
    owner: np.ndarray,
    drum: Drum,
    radius: np.ndarray,
    front: int,
    door: int | None,
    body: Sequence[int],
) -> int:
    """In place: what does not move before a drum, in cells [D, U, V] seen from where it is open, as
    a plate with a round hole.

    Args:
      front: the drum's first layer. door: the one after the closed door's last.

    Returns:
      The first layer of the drum that is clear of the plate; ``front`` where there is none.
    """
    still = (sdf < 0) & np.isin(owner, body)
    ring = (radius > drum.radius * FULL) & (radius < drum.radius + PANEL)
    first = np.where(still.any(0), still.argmax(0), front)[ring]
    plane = int(np.median(first[first < front])) if (first < front).any() else front
    if plane >= front:
        return front
    plane = plane if door is None else max(plane, door + 1)
    end = plane + PLATE
    hole = _hole(still[min(plane, front - 1) : front], radius, drum.radius)
    moving = (sdf < 0) & ~np.isin(owner, [drum.part, *body])
    apart = ~np.asarray(ndimage.binary_dilation(moving, iterations=APART), bool)
    mine = np.bincount(owner[still]).argmax()
    ours = (sdf > 0) | np.isin(owner, [drum.part, *body])
    depth = np.arange(len(sdf))[:, None, None]
    before = (depth < max(front, end)) & (radius < hole) & ours & ~moving
    plate = (depth >= plane) & (depth < end) & (radius >= hole)
    plate &= (radius < drum.radius + PANEL) & _extent(still) & apart & ours
    edge = np.asarray(hole - radius, np.float32)[None] * np.ones((len(sdf), 1, 1), np.float32)
    rim = (depth >= plane) & (depth < end) & (np.abs(edge) < NEAR)
    sdf[before & (sdf < 0)] = 0.5
    new = plate & ((sdf > 0) | (owner == drum.part))
    sdf[new], owner[new] = -0.5, mine
    at = (rim & still & ~before) | (rim & plate)
    sdf[at] = np.minimum(-ZERO, np.maximum(edge[at], -NEAR))
    owner[at] = mine
    at = rim & before
    sdf[at], owner[at] = np.clip(edge[at], ZERO, NEAR), mine
    return max(front, end + APART)


def _extent(still: np.ndarray) -> np.ndarray:
    """[U, V] bool, the rectangle that cells [D, U, V] lie in, without the layer of outside."""
    inside = np.zeros(still.shape[1:], bool)
    (u, v) = (np.flatnonzero(still.any(axes)) for axes in ((0, 2), (0, 1)))
    inside[max(u[0], 1) : min(u[-1] + 1, len(inside) - 1), v[0] : v[-1] + 1] = True
    inside[:, [0, -1]] = False
    return inside


def _hole(still: np.ndarray, radius: np.ndarray, drum: float) -> float:
    """Radius of the hole in cells [D, U, V] of what does not move: that of the middle of the
    narrowest ring, ``RING`` wide, of which most is solid in some layer."""
    for middle in np.arange(NARROW * drum, FULL * drum, 0.5):
        ring = np.abs(radius - middle) < RING / 2
        if still[:, ring].mean(1).max() > MET:
            return float(middle)
    return FULL * drum

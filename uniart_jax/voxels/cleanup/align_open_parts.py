"""Parts that a picture shows turned, as an open door: their cells as they lie straight, and back.

A plate that stands open lies aslant on the lattice. No face of it can be told from a ripple there,
and a network that draws it guesses where its edges are. Turned about its own hinge until it lies
straight, its faces can be made flat (``flat_faces``), and what its box and its hinge say of it can
be filled (``panel``). Distances are interpolated linearly, so flat faces stay flat on the way back.
A closed door is not turned, and is filled where most of it is drawn.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy import ndimage
from scipy.spatial.transform import Rotation

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.grid import connected
from uniart_jax.voxels.isosurface import ZERO, to_cells, to_points
from uniart_jax.voxels.opening_direction import ALONG_LATTICE, closed_end

STRAIGHT = np.deg2rad(2.5)  # what is turned by less lies straight
OPEN = np.deg2rad(8.0)  # what is turned by more is drawn badly: ``panel``
AGREES = np.deg2rad(10.0)  # between voxels and joint; else voxels are not believed
AIMS = np.deg2rad(20.0)  # between an end of the joint's range and where the part lies straight
PLATE = 3.0  # times as long as thick, across the hinge: its direction can be told
THICK = (3.0, 14.0)  # sub-cells, of a panel, least and most
THIN = 0.35  # of its width, that a panel is thick at most
WIDE = 0.1  # object units, that a panel is wide and high at least
HANDLES = 0.12  # share of a panel's face that what stands out from it covers at most
HANDLE = 0.12  # object units, that a handle may stand out from a panel
LEAST_OUT, LEAST_LONG = 3, 9  # sub-cells: what stands out less and is shorter is noise
RIM = 3  # sub-cells: what stands out mostly so near the edge of a panel is noise, no handle
LUMP = 1.5  # times a panel's thickness: columns that are thicker hold a handle
ROOM = 4  # cells around a part


@dataclasses.dataclass(frozen=True)
class Turn:
    """How a part is turned, in cells of a field.

    Attributes:
      straight, back: [4, 4], to where it lies along the lattice, and to how it is shown.
      axis, along: of the lattice: the hinge, and across it the one that the part then lies along.
      span, ends: (low, high) of the part along each.
      opened: whether it is turned by more than ``OPEN``. still: whether it lies straight as shown.
      outside: across both, where it lies straight, the way that it opens: 1, -1, or 0 if unknown.
    """

    straight: np.ndarray
    back: np.ndarray
    axis: int
    along: int
    span: tuple[float, float]
    ends: tuple[float, float]
    opened: bool
    still: bool = False
    outside: int = 0

    def box(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """[3], [3]: where it lies straight, of a part whose cells go from ``low`` to ``high``."""
        low, high = low.copy(), high.copy()
        low[self.axis], high[self.axis] = self.span
        low[self.along], high[self.along] = self.ends
        return low, high


def turn_of(
    cells: np.ndarray,
    box: np.ndarray,
    joint: Joint,
    size: int,
    corrected: bool,
    center: np.ndarray | None = None,
) -> Turn | None:
    """How a part is turned about its hinge; None where it has none along the lattice, or voxels and
    joint do not agree.

    Args:
      cells: [n, 3] solid cells. box: [6] of its row. size: of the grid, cells. corrected: it is
        turned back by what its joint says, so that it is straight at rest, not by what voxels say.
      center: [3] of what it is closed against, object units; None: its outside is unknown.
    """
    axis = int(np.abs(joint.direction).argmax())
    if joint.type != "revolute" or abs(joint.direction[axis]) < ALONG_LATTICE or len(cells) < 3:
        return None
    across = [(axis + 1) % 3, (axis + 2) % 3]
    origin = joint.origin + ((box[:3] - joint.origin) @ joint.direction) * joint.direction
    shown = (box[:3] - origin)[across]  # from the hinge to the part
    spread, directions = np.linalg.eigh(np.cov(cells[:, across].T))
    said = -_wrapped(np.arctan2(shown[1], shown[0]))
    drawn = -_wrapped(np.arctan2(directions[1, 1], directions[0, 1]))
    plain = spread[1] > PLATE**2 * spread[0]
    # at both ends of its range a part lies straight, or at one of them
    ends = [_wrapped(q * np.sign(joint.direction[axis])) for q in joint.limits]
    angle = min(ends, key=lambda end: abs(_wrapped(drawn - end)))
    believed = plain and abs(_wrapped(drawn - angle)) <= AGREES
    if not believed:
        angle = min(ends, key=lambda end: abs(_wrapped(said - end)))
        if abs(_wrapped(said - angle)) > AIMS:
            return None
    straight = drawn if believed else angle
    back = -angle if corrected else -straight
    still = max(abs(straight), abs(back)) < STRAIGHT
    if still:
        straight = back = 0.0
    to_straight = Rotation.from_euler("z", straight).as_matrix()[:2, :2]
    turned = to_straight @ shown
    long = to_straight @ directions[:, 1] if believed else turned
    side = int(np.abs(long).argmax())
    place = to_cells(origin, size)
    thick = np.sqrt(12 * max(spread[0], 0)) if believed else 0
    wide = np.hypot(*box[3:][across]) * size  # of the box, thicker by what stands across
    width = np.sqrt(max(wide**2 - (thick * np.cos(2 * straight)) ** 2, 0))
    width = max(float(width - thick * abs(np.sin(2 * straight))), 0.0)
    if still:
        width = float(box[3 + across[side]]) * size
    middle = float(place[across[side]] + turned[side] * size)
    low, high = (to_cells(box[axis] + sign * box[3 + axis] / 2, size) for sign in (-1, 1))
    return Turn(
        _about(axis, straight, place),
        _about(axis, back, place),
        axis,
        across[side],
        (low, high),
        (middle - width / 2, middle + width / 2),
        max(abs(angle), abs(straight)) > OPEN and not still,
        still,
        0
        if center is None
        else _outside(joint, axis, across[1 - side], cells, straight, center, size),
    )


def _outside(
    joint: Joint,
    axis: int,
    across: int,
    cells: np.ndarray,
    straight: float,
    center: np.ndarray,
    size: int,
) -> int:
    """The way along ``across`` that a part sets out to open, turned by ``straight`` about
    ``axis``."""
    closed = closed_end(joint, cells, center, size)
    opens = sum(joint.limits) / 2 - closed  # towards the other end
    arm = to_points(cells, size).mean(0) - joint.origin
    way = np.sign(opens) * np.cross(joint.direction, arm)
    turned = Rotation.from_rotvec(straight * np.eye(3)[axis]).apply(way)
    return int(np.sign(turned[across]))


def panel(phi: np.ndarray, low: np.ndarray, turn: Turn, size: int) -> np.ndarray:
    """Distances [A, B, C] of a part that lies straight, filled to the plate that its box says, and
    without what is neither that nor a handle on its outside; as they are if it is no plate.

    Args:
      low: [3] place of the window's first cell.
    """
    across = 3 - turn.axis - turn.along
    solid = phi < 0
    thick = solid.sum(across)
    usual = float(np.median(thick[thick > 0]))
    depth = float(np.clip(usual, *THICK))
    sides = turn.ends[1] - turn.ends[0], turn.span[1] - turn.span[0]
    if depth > THIN * sides[0] or min(sides) < WIDE * size:
        return phi
    # of columns without a handle
    plain = np.expand_dims((thick > 0) & (thick <= LUMP * usual), across)
    middle = float(np.median(np.argwhere(solid & plain)[:, across])) + low[across]
    handle = [HANDLE * size if turn.outside in (0, side) else 0.0 for side in (-1, 1)]

    def beyond(depth: float, more: Sequence[float] = (0.0, 0.0)) -> np.ndarray:
        """How far cells lie outside of a plate so thick, or so much ``more`` to either side."""
        ends = {turn.axis: turn.span, turn.along: turn.ends}
        ends[across] = middle - depth / 2 - more[0], middle + depth / 2 + more[1]
        found = np.full(phi.shape, -np.inf)
        for axis, (first, last) in ends.items():
            at = np.arange(phi.shape[axis]) + low[axis]
            at = at.reshape([-1 if k == axis else 1 for k in range(3)])
            found = np.maximum(found, np.maximum(first - at, at - last))
        return found

    plate, drawn = beyond(depth), beyond(max(depth, usual))
    room = beyond(max(depth, usual), handle)
    standing = solid & (drawn > 1) & (room <= 0)
    rim = beyond(np.inf) > -RIM
    room = np.where(_no_handle(standing, rim, across, sides[0] * sides[1]), drawn, room)
    filled = np.clip(np.minimum(np.maximum(phi, room), plate), -1, 1)
    return np.where(np.abs(filled) < ZERO, -ZERO, filled).astype(np.float32)


def _no_handle(solid: np.ndarray, rim: np.ndarray, across: int, face: float) -> np.ndarray:
    """[A, B, C] bool: cells of the pieces that are too wide for a handle of a face of so many
    columns along ``across``, too small, or mostly at its rim [A, B, C]."""
    pieces = np.moveaxis(connected(solid), across, 0)
    first = np.where(pieces[1:] != pieces[:-1], pieces[1:], 0)  # once a run of a column
    covered = np.bincount(np.concatenate([pieces[0].ravel(), first.ravel()]))
    cells = np.bincount(pieces.ravel())
    at_rim = np.bincount(pieces.ravel(), np.moveaxis(rim, across, 0).ravel())
    other = (covered > HANDLES * face) | (at_rim > cells / 2)
    for piece, place in enumerate(ndimage.find_objects(pieces), 1):
        out, *spans = (s.stop - s.start for s in place)
        other[piece] |= out < LEAST_OUT and max(spans) < LEAST_LONG
    other[0] = False
    return np.moveaxis(other[pieces], 0, across)


def _wrapped(angle: float) -> float:
    """An angle less whole quarter turns, at most an eighth."""
    return float(angle - np.round(angle / (np.pi / 2)) * np.pi / 2)


def _about(axis: int, angle: float, origin: np.ndarray) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(angle * np.eye(3)[axis]).as_matrix()
    matrix[:3, 3] = origin - matrix[:3, :3] @ origin
    return matrix


def resampled(
    phi: np.ndarray,
    source: np.ndarray,
    low: np.ndarray,
    motion: np.ndarray,
    room: int = ROOM,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A part after a motion, in a window that holds it with ``room`` cells around.

    Args:
      phi: [A, B, C] distances of the part alone. source: of its cells, -1 for none. low: [3] place
        of the window's first cell. motion: [4, 4], in cells.

    Returns:
      phi and source in the new window, and [3] its first cell.
    """
    cells = np.argwhere(phi < 0) + low
    there = cells @ motion[:3, :3].T + motion[:3, 3]
    first = np.floor(there.min(0)).astype(int) - room
    shape = np.ceil(there.max(0)).astype(int) + room + 1 - first
    if (motion == np.eye(4)).all():
        return *_reframed(phi, source, low - first, shape), first
    back = np.linalg.inv(motion)
    places = np.indices(shape).reshape(3, -1).T + first
    at = (places @ back[:3, :3].T + back[:3, 3] - low).T
    moved = ndimage.map_coordinates(phi, at, order=1, mode="constant", cval=1.0).reshape(shape)
    moved[np.abs(moved) < ZERO] = -ZERO
    found = np.clip(np.rint(at).astype(int), 0, np.array(phi.shape)[:, None] - 1)
    colored = source[tuple(found)].reshape(shape)
    return moved.astype(np.float32), np.where(moved < 1, colored, -1), first


def _reframed(
    phi: np.ndarray, source: np.ndarray, start: np.ndarray, shape: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Distances and sources in a window of another shape, in which the old one begins at
    ``start``; 1 and -1 beyond it."""
    first, last = np.maximum(start, 0), np.minimum(start + phi.shape, shape)
    into = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
    of = tuple(slice(a, b) for a, b in zip(first - start, last - start, strict=True))
    moved, colored = np.ones(shape, np.float32), np.full(shape, -1, source.dtype)
    moved[into] = np.where(np.abs(phi[of]) < ZERO, -ZERO, phi[of])
    colored[into] = np.where(phi[of] < 1, source[of], -1)
    return moved, colored

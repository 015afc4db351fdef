"""Room to move: parts are given the way that their joints say they go.

A network draws a body and its door apart, but each a little off: the frame reaches into the door's
way, and the opening of a drawer is narrower than the drawer. The joint says where the part goes, so
cells on its way cannot be the body's. They are taken off the body, but for its outer walls: only
the side to which a part opens is cut through. What these walls still bar is taken off the moving
part, as a drum's corners are. Where either is too much of a part, the joint is more likely wrong,
and the part stays as it is (``simulation.refine`` then draws limits in). What stands in the way and
moves on a joint of its own is left: it can be opened first.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import trimesh
from scipy import ndimage

from uniart_jax.objects.kinematics import Joint, subtrees
from uniart_jax.voxels.grid import connected, dilated
from uniart_jax.voxels.isosurface import ZERO, DenseField, to_points
from uniart_jax.voxels.opening_direction import ALONG_LATTICE, center_of, closed_end, opens_to

STEP = 1.0  # sub-cells that the farthest cell of a part goes between two states, unless these
STATES = (9, 193)  # are more, or fewer
MARGIN = 0.25  # sub-cells around a moving part that stay free
LOST = (0.3, 0.5)  # share of its cells that what stands still, and what moves, may lose
LINE = 0.1  # of a line along it, from which on all of the line is cut
WALL = 2  # sub-cells, thickness of what counts as an outer wall
KNOB = 0.15  # object units; what is smaller, and its dish, may lie in any wall
PIECE = 0.1  # share of a part's cells: what is cut off and smaller is left out


def with_room_to_move(
    field: DenseField, joints: Sequence[Joint], parents: Sequence[int]
) -> DenseField:
    """A field in which moving parts pass those that carry them.

    Args:
      field: of the shown state, owners are parts. joints, parents: of each part (-1: the root).

    Returns:
      A new field with fewer solid cells.
    """
    sdf, owner = field.sdf.copy(), field.owner
    below, size = subtrees(parents), sdf.shape[0] - 2
    movers = [k for k, parent in enumerate(parents) if parent >= 0 and joints[k].type != "fixed"]
    for k in movers:
        # what moves on other joints can be opened first
        others = {i for m in movers if k not in below[m] for i in below[m]}
        still = [i for i in range(len(parents)) if i not in below[k] and i not in others]
        moving = np.isin(owner, sorted(below[k]))
        resting = np.isin(owner, still)
        if not ((sdf < 0) & moving).any():
            continue
        cells = np.argwhere((sdf < 0) & moving)
        motions = _motions(joints[k], cells, size)
        back = [np.linalg.inv(motion) for motion in motions]
        barring = np.argwhere((sdf < 0) & resting & _passed(cells, motions, sdf.shape))
        depth = _depth(sdf, barring, moving, back)
        if np.ptp(cells, axis=0).max() > KNOB * size:
            body = (sdf < 0) & resting
            to = opens_to(joints[k], cells, np.argwhere(body), size) if body.any() else None
            walls = _walls(body, to)
            depth[walls[tuple(barring.T)]] = 0
            straight = _straight(barring, depth, joints[k], cells, body & ~walls)
            if not _too_much(sdf, owner, *straight, LOST[0]):
                barring, depth = straight
        _take(sdf, owner, barring, depth, LOST[0])
        _take(sdf, owner, cells, _depth(sdf, cells, resting, motions), LOST[1])
    _apart_at_rest(sdf, owner, joints, movers, below)
    return dataclasses.replace(field, sdf=sdf)


def _apart_at_rest(
    sdf: np.ndarray,
    owner: np.ndarray,
    joints: Sequence[Joint],
    movers: Sequence[int],
    below: Sequence[set[int]],
) -> None:
    """In place: of two moving parts that hang on what stands still, the larger without what lies in
    the other where both are closed, as drawers that are shown open and do not fit side by side."""
    size = sdf.shape[0] - 2
    still = ~np.isin(owner, sorted({i for k in movers for i in below[k]})) & (sdf < 0)
    first = [k for k in movers if not any(k in below[m] for m in movers if m != k)]
    cells = {k: np.argwhere((owner == k) & (sdf < 0)) for k in first}
    first = sorted((k for k in first if len(cells[k])), key=lambda k: -len(cells[k]))
    if len(first) < 2 or not still.any():
        return
    center = center_of(np.argwhere(still), size)
    closed = {k: joints[k].motion(closed_end(joints[k], cells[k], center, size)) for k in first}
    for place, k in enumerate(first):
        for other in first[place + 1 :]:
            motion = np.linalg.inv(closed[other]) @ closed[k]
            depth = _depth(sdf, cells[k], owner == other, [motion])
            _take(sdf, owner, cells[k], depth, LOST[0])


def with_meshes(field: DenseField, meshes: Sequence[trimesh.Trimesh], first: int) -> DenseField:
    """A field in which small convex parts hold the cells that they fill: owners from ``first`` on.

    Cells of other parts that lie within them are theirs, at least one each where that is not all of
    another part.
    """
    sdf, owner = field.sdf.copy(), field.owner.copy()
    size = sdf.shape[0] - 2
    for part, mesh in enumerate(meshes, first):
        low, high = np.array(mesh.bounds) * size + size / 2 + 0.5
        low = np.clip(np.floor(low).astype(int), 1, size)
        high = np.clip(np.ceil(high).astype(int), 1, size)
        window = tuple(slice(a, b + 1) for a, b in zip(low, high, strict=True))
        cells = np.indices(high - low + 1).reshape(3, -1).T + low
        depth = _within(mesh, to_points(cells, size)) * size
        depth[depth.argmax()] = max(depth.max(), 0.5)
        depth = depth.reshape(high - low + 1)
        whose = np.where(sdf[window] < 0, owner[window], -1)
        for other in np.unique(whose[(whose >= 0) & (depth > 0)]):
            lost = (whose == other) & (depth > 0)
            if lost.sum() == ((sdf < 0) & (owner == other)).sum():
                depth[lost] = 0
        inside = depth > 0
        sdf[window][inside] = -np.minimum(depth[inside], 1)
        owner[window][inside] = part
    return dataclasses.replace(field, sdf=sdf, owner=owner)


def _within(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """[n] how deep points lie in a convex mesh; negative outside."""
    planes = (mesh.face_normals * mesh.triangles[:, 0]).sum(-1)
    return (planes - points @ mesh.face_normals.T).min(1)


def _motions(joint: Joint, cells: np.ndarray, size: int) -> list[np.ndarray]:
    """[4, 4] over the joint's range: ``STEP`` apart, at most ``STATES``."""
    lo, hi = joint.limits
    path = hi - lo
    if joint.rotates:
        away = np.cross(to_points(cells, size) - joint.origin, joint.direction)
        path *= float(np.hypot(np.linalg.norm(away, axis=1).max(), joint.pitch))
    count = int(np.clip(np.ceil(path * size / STEP), *STATES))
    return [joint.motion(q) for q in np.linspace(lo, hi, count)]


def _passed(cells: np.ndarray, motions: Sequence[np.ndarray], shape: tuple[int, ...]) -> np.ndarray:
    """[n, n, n] bool, all that ``cells`` [m, 3] may touch at any of the motions."""
    passed, size = np.zeros(shape, bool), shape[0] - 2
    points = to_points(cells, size)
    for motion in motions:
        at = _cells(points, motion, size)
        at = np.rint(at[((at > 0) & (at < size + 1)).all(1)]).astype(np.int32)
        passed[tuple(at.T)] = True
    return dilated(passed)


def _cells(places: np.ndarray, motion: np.ndarray, size: int) -> np.ndarray:
    """Where places lie after a motion, in cells of a field."""
    return (places @ motion[:3, :3].T + (motion[:3, 3] + 0.5)) * size + 0.5


def _depth(
    sdf: np.ndarray, cells: np.ndarray, theirs: np.ndarray, motions: Sequence[np.ndarray]
) -> np.ndarray:
    """[n] how deep ``cells`` [n, 3] get, sub-cells, into the solid of the cells ``theirs`` at any
    of the motions; 0 where they do not."""
    size, solid = sdf.shape[0] - 2, theirs & (sdf < 0)
    depth, points = np.zeros(len(cells)), to_points(cells, size)
    if not solid.any():
        return depth
    window = ndimage.find_objects(solid.astype(np.int8))[0]
    window = tuple(slice(s.start - 1, s.stop + 1) for s in window)  # the layer around is free
    low = np.array([s.start for s in window])
    inside = np.where(theirs, sdf, np.maximum(np.abs(sdf), 0.5))[window]
    near = dilated(solid[window])
    for motion in motions:
        at = _cells(points, motion, size) - low
        cell = np.rint(at).astype(np.int32)
        x, y, z = cell.T
        a, b, c = near.shape
        some = (x >= 0) & (x < a) & (y >= 0) & (y < b) & (z >= 0) & (z < c)
        some = np.flatnonzero(some)
        some = some[near[tuple(cell[some].T)]]
        found = ndimage.map_coordinates(inside, at[some].T, order=1, mode="nearest")
        depth[some] = np.maximum(depth[some], MARGIN - found)
    return depth


def _straight(
    barring: np.ndarray, depth: np.ndarray, joint: Joint, cells: np.ndarray, others: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Cells to cut for a part that turns on a hinge along the lattice, so that the cut is straight:
    a line of cells along the hinge is cut over the whole length of the part where more than
    ``LINE`` of it bars its way.

    Args:
      barring: [n, 3] cells that may bar it. depth: [n], above 0 where they do. cells: [m, 3] of the
        part. others: [X, Y, Z] bool, cells that may be cut.

    Returns:
      ``barring`` and ``depth`` with the rest of these lines, or as they are for other joints.
    """
    axis = int(np.abs(joint.direction).argmax())
    if (
        joint.type != "revolute"
        or abs(joint.direction[axis]) < ALONG_LATTICE
        or not (depth > 0).any()
    ):
        return barring, depth
    span = slice(int(cells[:, axis].min()), int(cells[:, axis].max()) + 1)
    within = (depth > 0) & (barring[:, axis] >= span.start) & (barring[:, axis] < span.stop)
    cut = np.zeros(others.shape, np.float32)
    cut[tuple(barring[within].T)] = depth[within]
    lines = np.moveaxis(cut, axis, 0)[span]
    much = (lines > 0).sum(0) > LINE * len(lines)
    whole = np.zeros_like(others)
    np.moveaxis(whole, axis, 0)[span] = much
    whole &= others
    deep = np.broadcast_to(np.expand_dims(lines.max(0), axis), cut.shape)
    left = ~whole[tuple(barring.T)]
    added = np.argwhere(whole)
    return (
        np.concatenate([barring[left], added]),
        np.concatenate([depth[left], deep[tuple(added.T)]]),
    )


def _walls(solid: np.ndarray, but: tuple[int, int] | None) -> np.ndarray:
    """Cells less than ``WALL`` behind where ``solid`` is first met from outside, along each axis
    from each side; those that are met from the side ``but`` are none."""
    found, front = np.zeros_like(solid), np.zeros_like(solid)
    for axis in range(3):
        for side in (1, -1):
            seen = np.moveaxis(solid, axis, 0)[::-side]
            first = seen.argmax(0)
            index = np.arange(len(seen))[:, None, None]
            wall = seen & (index < first + WALL)
            into = front if but == (axis, side) else found
            np.moveaxis(into, axis, 0)[::-side][wall] = True
    return found & ~front


def _too_much(
    sdf: np.ndarray, owner: np.ndarray, cells: np.ndarray, depth: np.ndarray, most: float
) -> bool:
    """Whether ``_take`` would leave a part as it is, since it would lose too much."""
    whose = owner[tuple(cells[depth > 0].T)]
    return any(
        (whose == part).sum() > most * ((sdf < 0) & (owner == part)).sum()
        for part in np.unique(whose)
    )


def _take(
    sdf: np.ndarray, owner: np.ndarray, cells: np.ndarray, depth: np.ndarray, most: float
) -> None:
    """In place: parts without those of ``cells`` [n, 3] that are above 0 deep in others [n]; not
    where a part would lose more than a share of ``most``."""
    cells, depth = cells[depth > 0], depth[depth > 0]
    whose = owner[tuple(cells.T)]
    for part in np.unique(whose):
        own = owner == part
        if (whose == part).sum() <= most * ((sdf < 0) & own).sum():
            at = tuple(cells[whose == part].T)
            before = connected(own & (sdf < 0))
            sdf[at] = np.maximum(depth[whose == part], 2 * ZERO)
            _drop_pieces(sdf, own, before)


def _drop_pieces(sdf: np.ndarray, own: np.ndarray, before: np.ndarray) -> None:
    """In place: a part without small pieces that hung on others of it, as labelled ``before``."""
    after: Any = connected(own & (sdf < 0))
    count, whole = np.bincount(after.ravel()), np.bincount(before.ravel())
    of = np.zeros(len(count), np.int64)  # the piece that each was of
    of[after.ravel()] = before.ravel()
    largest = np.zeros(len(whole), np.int64)
    np.maximum.at(largest, of, count)
    loose = (count < largest[of]) & (count < PIECE * whole[1:].sum())
    loose[0] = False
    gone = loose[after]
    sdf[gone] = np.maximum(-sdf[gone], 0.5)

"""Room to move: what a part sweeps on its joint's way is taken from the parts that stand still.

A network draws a body and its door apart, but each a little off: the frame reaches into the door's
way, and the opening of a drawer is narrower than the drawer. The joint says where the part goes, so
the cells that it passes cannot be the body's. Only what bars its way is taken; where that is too
much of a part, the joint is more likely wrong, and both stay as they are (limits are then drawn in
by ``simulation.refine``).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import trimesh
from scipy import ndimage

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.grid import connected
from uniart_jax.voxels.isosurface import DenseField

STEP = 1.0  # sub-cells that the farthest cell of a part goes between two states
STATES = (9, 97)  # of a joint's way, least and most
MARGIN = 0.25  # sub-cells around a moving part that stay free
BODY_LOSES = 0.3  # share of its cells that a part which stands still may lose to one that moves
OTHER_LOSES = 0.1  # likewise, where it moves on a joint of its own: it could be opened first
PIECE = 0.1  # share of a part's cells: what is cut off and smaller is left out
ROOM = 2  # cells around a part in its window


def with_room_to_move(
    field: DenseField, joints: Sequence[Joint], parents: Sequence[int]
) -> DenseField:
    """A field in which moving parts pass the others.

    Args:
      field: of the shown state, owners are parts. joints, parents: of each part (-1: the root).

    Returns:
      A new field with fewer solid cells; moving parts lose none to what stands still.
    """
    sdf, owner, source = field.sdf.copy(), field.owner, field.source.copy()
    below = _subtrees(parents)
    movers = [k for k, parent in enumerate(parents) if parent >= 0 and joints[k].type != "fixed"]
    for k in movers:
        solid = sdf < 0
        mine = np.isin(owner, sorted(below[k]))
        if not (solid & mine).any():
            continue
        barred = _swept(sdf, owner, mine, joints[k])
        for part in np.unique(owner[tuple(barred.cells.T)]):
            which = owner[tuple(barred.cells.T)] == part
            most = OTHER_LOSES if _moves(part, movers, below) else BODY_LOSES
            total = int((solid & (owner == part)).sum())
            if which.sum() <= most * total:
                _take(sdf, owner, source, int(part), barred.cells[which], barred.depth[which])
    return dataclasses.replace(field, sdf=sdf, source=source)


def with_meshes(field: DenseField, meshes: Sequence[trimesh.Trimesh], first: int) -> DenseField:
    """A field in which small convex parts hold the cells that they fill: owners from ``first`` on.

    Cells of other parts that lie within them are theirs, at least one each.
    """
    sdf, owner = field.sdf.copy(), field.owner.copy()
    size = sdf.shape[0] - 2
    for part, mesh in enumerate(meshes, first):
        low, high = np.array(mesh.bounds) * size + size / 2 + 0.5
        low = np.clip(np.floor(low).astype(int), 1, size)
        high = np.clip(np.ceil(high).astype(int), 1, size)
        window = tuple(slice(a, b + 1) for a, b in zip(low, high, strict=True))
        cells = np.indices(high - low + 1).reshape(3, -1).T + low
        places = (cells - 0.5) / size - 0.5
        depth = _within(mesh, places) * size
        depth[depth.argmax()] = max(depth.max(), 0.5)
        inside = (depth > 0).reshape(high - low + 1)
        sdf[window][inside] = -np.minimum(depth[depth > 0], 1)
        owner[window][inside] = part
    return dataclasses.replace(field, sdf=sdf, owner=owner)


def _within(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """[n] how deep points lie in a convex mesh; negative outside."""
    planes = (mesh.face_normals * mesh.triangles[:, 0]).sum(-1)
    return (planes - points @ mesh.face_normals.T).min(1)


def _subtrees(parents: Sequence[int]) -> list[set[int]]:
    """[K] each part and all that hang on it; parents in any order."""
    below = [{k} for k in range(len(parents))]
    for k in range(len(parents)):
        up = parents[k]
        while up >= 0:
            below[up].add(k)
            up = parents[up]
    return below


@dataclasses.dataclass(frozen=True)
class _Barred:
    """Solid cells [n, 3] of other parts that a moving part passes, and how deep they get into it
    [n], sub-cells."""

    cells: np.ndarray
    depth: np.ndarray


def _moves(part: int, movers: list[int], below: list[set[int]]) -> bool:
    return any(part in below[k] for k in movers)


def _swept(sdf: np.ndarray, owner: np.ndarray, mine: np.ndarray, joint: Joint) -> _Barred:
    """What stands in the way of the cells ``mine`` of moving parts."""
    solid = sdf < 0
    window = ndimage.find_objects((mine & solid).astype(np.int8))[0]
    low = np.array([s.start - ROOM for s in window])
    window = tuple(slice(max(s.start - ROOM, 0), s.stop + ROOM) for s in window)
    low = np.maximum(low, 0)
    inside = np.where(mine, sdf, np.maximum(np.abs(sdf), 0.5))[window]
    cells = np.argwhere(solid & ~mine & (owner >= 0))
    size = sdf.shape[0] - 2
    places = (cells - 0.5) / size - 0.5  # centres; the layer around is one cell wide
    high = low + np.array(inside.shape) - 1
    corners = np.array([[(a, b)[i >> j & 1] for j, (a, b) in enumerate(zip(low, high, strict=True))]
                        for i in range(8)])  # fmt: skip
    corners = (corners - 0.5) / size - 0.5
    depth = np.full(len(cells), -np.inf)
    for q in _states(joint, corners, size):
        motion = joint.motion(q)
        there = corners @ motion[:3, :3].T + motion[:3, 3]
        near = np.flatnonzero(((places >= there.min(0)) & (places <= there.max(0))).all(1))
        back = (places[near] - motion[:3, 3]) @ motion[:3, :3]
        at = (back + 0.5) * size + 0.5 - low
        found = ndimage.map_coordinates(inside, at.T, order=1, mode="constant", cval=1.0)
        depth[near] = np.maximum(depth[near], MARGIN - found)
    hit = depth > 0
    return _Barred(cells[hit], depth[hit])


def _states(joint: Joint, corners: np.ndarray, size: int) -> np.ndarray:
    """Coordinates over the joint's range, dense enough that no cell is passed over."""
    lo, hi = joint.limits
    path = abs(hi - lo)
    if joint.rotates:
        arm = np.linalg.norm(np.cross(corners - joint.origin, joint.direction), axis=1).max()
        path *= float(np.hypot(arm, joint.pitch))
    count = int(np.clip(np.ceil(path * size / STEP), *STATES))
    return np.linspace(lo, hi, count)


def _take(
    sdf: np.ndarray,
    owner: np.ndarray,
    source: np.ndarray,
    part: int,
    cells: np.ndarray,
    depth: np.ndarray,
) -> None:
    """In place: a part without some cells, and without small pieces that hung on them."""
    own = owner == part
    before: Any = connected(own & (sdf < 0))
    at = tuple(cells.T)
    sdf[at] = depth
    after: Any = connected(own & (sdf < 0))
    count = np.bincount(after.ravel())
    whole = np.bincount(before.ravel())
    # what a piece was part of: the label of any of its cells
    first = np.zeros(len(count), np.int64)
    first[after.ravel()] = before.ravel()
    cut_off = (count < whole[first]) & (count < PIECE * whole[1:].sum())
    largest = np.zeros(len(whole), np.int64)
    np.maximum.at(largest, first, count)
    cut_off &= count < largest[first]
    cut_off[0] = False
    loose = cut_off[after]
    sdf[loose] = np.maximum(-sdf[loose], 0.5)
    unknown = np.zeros(sdf.shape, bool)
    unknown[at] = source[at] < 0
    known = own & (source >= 0)
    if unknown.any() and known.any():
        nearest: Any = ndimage.distance_transform_edt(
            ~known, return_distances=False, return_indices=True
        )
        source[unknown] = source[tuple(nearest)][unknown]

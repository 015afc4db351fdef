"""Parts that a network's output leaves hanging in the air: specks are left out, what is near the
others is moved until it touches them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from uniart_jax.objects.kinematics import subtrees
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.voxels.grid import connected, dilated
from uniart_jax.voxels.isosurface import DenseField, signed_volume

# of the longest side: a part of next to no volume that is farther from all others is a speck
DISTANCE = 0.02
NEAR = (
    0.015,
    0.1,
)  # of the longest side: a part that is this far from all others is moved until it touches
TOUCHING = 0.005  # of the longest side, that lie between two parts once they were moved together
VOLUME = 0.01  # of the object's
SPACING = 0.01  # of the longest side, between places on a part's surface
PIECE = 0.1  # share of the body's cells: a larger piece of it stays
# of a part's vertices: a piece of it that has fewer holds nothing, and may be gone when surfaces
# are simplified
CRUMB = 0.1


def without_debris(obj: ArticulatedObject) -> ArticulatedObject:
    """The object without parts that carry nothing, hang in the air as shown, and hold less than a
    hundredth of its volume.

    Args:
      obj: parts are closed, and their vertices lie dense: a cell of the lattice they were found on
        apart.
    """
    size = float(np.ptp(obj.bounds, axis=0).max())
    volume = np.array([abs(signed_volume(part.mesh)) for part in obj.parts])
    kept = list(range(len(obj.parts)))
    for k in reversed(range(1, len(obj.parts))):  # children stand behind their parents
        carries = any(obj.parts[i].parent == k for i in kept)
        if carries or volume[k] > VOLUME * volume.sum():
            continue
        others = np.concatenate([obj.parts[i].mesh.vertices for i in kept if i != k])
        if cKDTree(others).query(obj.parts[k].mesh.vertices)[0].min() > DISTANCE * size:
            kept.remove(k)
    if len(kept) == len(obj.parts):
        return obj
    position = {old: new for new, old in enumerate(kept)} | {-1: -1}
    parts = []
    for k in kept:
        part = obj.parts[k]
        name = f"link_{position[k]}" if part.parent >= 0 else part.name
        parts.append(dataclasses.replace(part, name=name, parent=position[part.parent]))
    return dataclasses.replace(obj, parts=tuple(parts))


def without_floating_pieces(field: DenseField, body: Sequence[int], parts: int) -> DenseField:
    """A field without pieces that touch nothing, but for the largest piece of each part.

    Pieces touch where no more than two cells lie between them.

    Args:
      body: owners that do not move. What touches only parts that move away hangs in the air too;
        so small pieces of these have to touch others of these. parts: how many owners there are.
    """
    solid = field.sdf < 0
    together, main = _together(solid)
    sdf = field.sdf.copy()
    still = solid & np.isin(field.owner, body)
    if still.any():
        labels, largest = _together(still)
        small = np.bincount(labels[still]) < PIECE * still.sum()
        loose = still & (labels != largest) & small[labels]
        for part in np.unique(field.owner[loose]):  # each keeps its largest piece
            pieces = connected(still & (field.owner == part))
            loose &= pieces != np.bincount(pieces[pieces > 0]).argmax()
        sdf[loose] = np.maximum(-sdf[loose], 0.5)
    for part in range(parts):
        mine = solid & (field.owner == part)
        pieces = connected(mine)
        if pieces.max() < 2:
            continue
        largest = np.bincount(pieces[mine]).argmax()
        loose = mine & (together != main) & (pieces != largest)
        sdf[loose] = np.maximum(-sdf[loose], 0.5)
    return dataclasses.replace(field, sdf=sdf)


def with_lost_parts(field: DenseField, before: DenseField) -> DenseField:
    """A field in which each part that has no solid cell has those again that it had before."""
    lost = np.setdiff1d(before.owner[before.sdf < 0], field.owner[field.sdf < 0])
    again = (before.sdf < 0) & np.isin(before.owner, lost)
    return dataclasses.replace(
        field,
        sdf=np.where(again, before.sdf, field.sdf),
        owner=np.where(again, before.owner, field.owner),
    )


def _together(solid: np.ndarray) -> tuple[np.ndarray, int]:
    """[n, n, n] label of cells that touch, and the one of most cells."""
    wide = dilated(solid)
    labels = connected(wide) * solid
    return labels, int(np.bincount(labels[solid]).argmax()) if solid.any() else 0


def with_parts_joined(obj: ArticulatedObject) -> ArticulatedObject:
    """The object with parts that hang in the air at rest, less than .1 of it away, moved until they
    touch.

    A part goes with all that hangs on it, its joint too, along the shortest way. ``provenance``
    tells each.
    """
    size = float(np.ptp(obj.bounds, axis=0).max())
    own = [_points(part.mesh, SPACING * size) for part in obj.parts]
    for k in range(1, len(obj.parts)):
        poses = obj.forward_kinematics(obj.rest())
        points = [p @ pose[:3, :3].T + pose[:3, 3] for p, pose in zip(own, poses, strict=True)]
        below = subtrees(obj.parents)[k]
        others = np.concatenate([v for i, v in enumerate(points) if i not in below])
        mine = np.concatenate([points[i] for i in sorted(below)])
        distances, nearest = cKDTree(others).query(mine, distance_upper_bound=NEAR[1] * size)
        first = int(distances.argmin())
        gap = float(distances[first])
        if not NEAR[0] * size < gap < np.inf:
            continue
        way = (others[nearest[first]] - mine[first]) * (1 - TOUCHING * size / gap)
        way = poses[obj.parts[k].parent][:3, :3].T @ way  # as it is when the object is as shown
        own = [p + way if i in below else p for i, p in enumerate(own)]
        line = (
            f"'{obj.parts[k].name}' hung in the air, {gap / size:.3f} of the object's size from "
            "all else: moved until it touches"
        )
        obj = dataclasses.replace(
            obj,
            parts=tuple(_moved(p, way) if i in below else p for i, p in enumerate(obj.parts)),
            provenance=(*obj.provenance, line),
        )
    return obj


def _points(mesh: trimesh.Trimesh, spacing: float) -> np.ndarray:
    """[n, 3] vertices of the mesh's larger pieces, and places on these about ``spacing`` apart: the
    triangles of flat faces are large."""
    piece = trimesh.graph.connected_component_labels(mesh.edges, node_count=len(mesh.vertices))
    size = np.bincount(piece)
    large = size[piece] >= min(CRUMB * len(mesh.vertices), size.max())
    weight = mesh.area_faces * large[mesh.faces[:, 0]]
    count = int(weight.sum() / spacing**2) + 1
    places, _ = trimesh.sample.sample_surface(mesh, count, face_weight=weight, seed=0)
    return np.concatenate([mesh.vertices[large], places])


def _moved(part: Part, way: np.ndarray) -> Part:
    mesh = part.mesh.copy()
    mesh.apply_translation(way)
    joint = part.joint
    if joint.type != "fixed":
        joint = dataclasses.replace(joint, origin=joint.origin + way)
    return dataclasses.replace(part, mesh=mesh, joint=joint)

"""Convex collision shapes.

A part that nearly fills its convex hull gets the hull. A hollow part built of axis-aligned walls (cabinets, drawers) gets a box for each
wall, so that a cabinet stays open for its drawers. Every other hollow part (bowls, round drums, slanted walls, open meshes) gets
its hull too, which fills the hollow: what moves inside it then starts in contact.
"""

from __future__ import annotations

import itertools

import igl
import numpy as np
import trimesh

CONVEX_SHARE = 0.85  # of its hull that a part must fill to be taken as convex
BOX_BUDGET = 24  # boxes a part; if more are needed the hull is used
MAX_PLANES = 24  # along an axis; more means that the part is not built of boxes
FLAT_COSINE = 0.97  # a face is axis-aligned above this
FLAT_SHARE = 0.7  # of the area of a part built of boxes that is axis-aligned
PLANE_AREA = 0.004  # share of the part's area that makes a wall
PLANE_GAP = 0.006  # of the longest side; walls nearer than this are one
VOLUME_TOLERANCE = 0.2  # relative, of the boxes against the mesh


def collision_pieces(mesh: trimesh.Trimesh) -> list[trimesh.Trimesh]:
    """Convex meshes, in the mesh's frame and units, that together stand for it; at least one."""
    hull = _hull(mesh)
    if not mesh.is_watertight or mesh.volume >= CONVEX_SHARE * hull.volume:
        return [hull]
    boxes = _boxes(mesh)
    return boxes if 0 < len(boxes) <= BOX_BUDGET else [hull]


def _hull(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The convex hull, or the box of a flat mesh, thickened to a thousandth of its size."""
    lo, hi = mesh.bounds
    thin = 1e-3 * float((hi - lo).max())
    if (hi - lo).min() > thin:
        try:
            return mesh.convex_hull
        except Exception:  # qhull's error class for flat input is private
            pass
    return _box(lo, np.maximum(hi, lo + thin))


def _boxes(mesh: trimesh.Trimesh) -> list[trimesh.Trimesh]:
    """Greedy cover of a box-built solid with boxes, largest seed first; [] if it is not built of boxes.

    The grid's planes are the mesh's own: coordinates at which much of its axis-aligned area lies, so flat walls are met exactly.
    """
    flat = float(mesh.area_faces[np.abs(mesh.face_normals).max(1) > FLAT_COSINE].sum())
    if flat < FLAT_SHARE * float(mesh.area):
        return []
    edges = [_planes(mesh, axis) for axis in range(3)]
    if max(len(e) for e in edges) > MAX_PLANES:
        return []
    centers = [(e[1:] + e[:-1]) / 2 for e in edges]
    points = np.stack(np.meshgrid(*centers, indexing="ij"), -1).reshape(-1, 3)
    winding = igl.winding_number(
        np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64), points
    )
    shape = [len(c) for c in centers]
    solid = (np.abs(np.asarray(winding)) > 0.5).reshape(shape)
    sizes = [np.diff(e) for e in edges]
    volume = sizes[0][:, None, None] * sizes[1][None, :, None] * sizes[2][None, None, :]
    if abs((solid * volume).sum() / mesh.volume - 1) > VOLUME_TOLERANCE:
        return []
    boxes = []
    while solid.any() and len(boxes) <= BOX_BUDGET:
        seed = np.unravel_index(np.argmax(np.where(solid, volume, 0)), shape)
        grown = [_grow(solid, seed, order) for order in itertools.permutations(range(3))]
        cells = max(grown, key=lambda g: float(volume[g].sum()))
        solid[cells] = False
        lo = np.array([edges[a][cells[a].start] for a in range(3)])
        hi = np.array([edges[a][cells[a].stop] for a in range(3)])
        boxes.append(_box(lo, hi))
    return boxes


def _planes(mesh: trimesh.Trimesh, axis: int) -> np.ndarray:
    """[n] coordinates along ``axis`` of the mesh's flat walls, ascending, both ends of its box included."""
    lo, hi = mesh.bounds[:, axis]
    facing = np.abs(mesh.face_normals[:, axis]) > FLAT_COSINE
    where = mesh.triangles_center[facing, axis]
    area = mesh.area_faces[facing]
    order = np.argsort(where)
    where, area = where[order], area[order]
    gap = PLANE_GAP * float(mesh.extents.max())
    groups = np.split(np.arange(len(where)), np.flatnonzero(np.diff(where) > gap) + 1)
    least = PLANE_AREA * float(mesh.area)
    inner = [float(np.average(where[g], weights=area[g])) for g in groups if area[g].sum() > least]
    return np.array([lo, *(x for x in inner if lo + gap < x < hi - gap), hi])


def _grow(solid: np.ndarray, seed: tuple, order: tuple[int, ...]) -> tuple[slice, ...]:
    """The box of solid cells grown from ``seed`` as far as it goes, one axis after the other."""
    lo, hi = list(seed), [s + 1 for s in seed]

    def filled(axis: int, index: int) -> bool:
        if not 0 <= index < solid.shape[axis]:
            return False
        cells = [slice(a, b) for a, b in zip(lo, hi, strict=True)]
        cells[axis] = slice(index, index + 1)
        return bool(solid[tuple(cells)].all())

    for axis in order:
        while filled(axis, lo[axis] - 1):
            lo[axis] -= 1
        while filled(axis, hi[axis]):
            hi[axis] += 1
    return tuple(slice(a, b) for a, b in zip(lo, hi, strict=True))


def _box(lo: np.ndarray, hi: np.ndarray) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=np.stack([lo, hi]))

"""Articulated object -> part grid: active voxels, truncated signed distance, colour, owner.

Active voxels are those that the surface touches, by exact triangle-box overlap. Signs come from
each part's winding number w_k, magnitudes from an unsigned query d_k >= 0 (docs/representation.md,
"Sign and owner"), lengths in sub-cells:

    s_k = -d_k where |w_k| > 1/2, else d_k                                              (1)
    s_k <- min(s_k, d_k - sqrt(3)/2) where part k is thinner than sqrt(3)               (2)
    sdf = min_k s_k,  owner = argmin_k s_k (ties: nearest surface)                      (3)

One query over the whole surface finds the nearest part a everywhere. Another part can only win (3)
where it contains the sub-cell, or where (2) applies to it and not to a; only there it is asked, so
the result is exact and most parts cost nothing.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import scipy.ndimage

from uniart_jax.objects.appearance import sample_color
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.voxels.grid import SDF_CLIP, PartGrid, subcell_offsets
from uniart_jax.voxels.joint_code import encode_object
from uniart_jax.voxels.nearest import Triangles, nearest_faces, tree_query
from uniart_jax.voxels.overlap import clipped_areas, touched_cells
from uniart_jax.voxels.solid import Solid

THIN = 3**0.5  # sub-cells: thinner shells leak between the samples
HALF_THIN = THIN / 2
# sub-cells that a thickness probe keeps off its triangle's border, so that it does not graze the
# next face
INSET = 0.05
MAX_PARTS = 256  # ids are uint8


@dataclasses.dataclass(frozen=True)
class _Surface:
    """All triangles of an object; faces of part k are first[k] .. first[k + 1]."""

    vertices: np.ndarray
    faces: np.ndarray
    face_part: np.ndarray
    first: np.ndarray
    triangles: Triangles
    varied: np.ndarray  # [K] bool: colours vary over a face
    corners: np.ndarray  # [F, 3, 3] float32
    proper: np.ndarray  # [F] bool: the triangle has an area


def voxelize(obj: ArticulatedObject, resolution: int = 32, subdivisions: int = 4) -> PartGrid:
    """The unified voxel representation of an object (paper, section on the unified 3D
    representation).

    Args:
      obj: normalised (inside [-1/2, 1/2]^3).
      resolution: R, at most 1024.
      subdivisions: r.

    Returns:
      PartGrid. ``voxel_part`` is the part with the largest area of triangles clipped to the voxel;
      ``color`` is that of the nearest surface point of the owner; sub-cells farther than SDF_CLIP
      are clipped, their owner and colour still exact.

    Raises:
      ValueError: the object is not normalised, has more than 256 parts, two parts with the same
        box, or parts too small to own a voxel.
    """
    if np.abs(obj.bounds).max() > 0.5 + 1e-4:
        raise ValueError(
            f"object '{obj.name}': it leaves [-1/2, 1/2]^3; call .normalized() before voxelising"
        )
    if len(obj.parts) > MAX_PARTS:
        raise ValueError(
            f"object '{obj.name}': {len(obj.parts)} parts; at most {MAX_PARTS} fit a grid"
        )
    boxes, codes, parents = encode_object(obj)
    surface = _join(obj)
    face, cell = touched_cells((surface.vertices[surface.faces] + 0.5) * resolution, resolution)
    key = np.ravel_multi_index(tuple(cell.T), (resolution,) * 3)
    keys, voxel = np.unique(key, return_inverse=True)
    coords = np.stack(np.unravel_index(keys, (resolution,) * 3), -1).astype(np.int32)
    voxel_part = _largest_parts(obj, surface, resolution, face, cell, voxel, len(keys))
    solids = [Solid(part.mesh.vertices, part.mesh.faces) for part in obj.parts]
    thin = _thin_voxels(surface, solids, resolution, subdivisions, face, cell)
    sdf, owner, nearest, weight = _distances(
        surface, solids, thin, coords, resolution, subdivisions
    )
    color = _colors(obj, surface, owner, nearest, weight)
    shape = (len(coords), subdivisions**3)
    return PartGrid(
        resolution,
        subdivisions,
        coords,
        np.clip(sdf, -SDF_CLIP, SDF_CLIP).astype(np.float32).reshape(shape),
        color.reshape(*shape, 3),
        owner.astype(np.uint8).reshape(shape),
        voxel_part.astype(np.uint8),
        boxes.astype(np.float32),
        codes.astype(np.float32),
        parents.astype(np.int32),
    )


def _join(obj: ArticulatedObject) -> _Surface:
    counts = [len(p.mesh.faces) for p in obj.parts]
    starts = np.cumsum([0] + [len(p.mesh.vertices) for p in obj.parts])
    vertices = np.concatenate([p.mesh.vertices for p in obj.parts]).astype(np.float64)
    faces = np.concatenate([p.mesh.faces + s for p, s in zip(obj.parts, starts[:-1], strict=True)])
    corner = vertices[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    return _Surface(
        vertices,
        faces.astype(np.int64),
        np.repeat(np.arange(len(counts), dtype=np.uint8), counts),
        np.cumsum([0, *counts]),
        Triangles(vertices, faces),
        np.array([p.mesh.visual.kind in ("texture", "vertex") for p in obj.parts]),
        corner.astype(np.float32),
        np.linalg.norm(normal, axis=1) > 1e-14,
    )


def _largest_parts(obj, surface, resolution, face, cell, voxel, count) -> np.ndarray:
    """[V] part with the largest clipped area in each voxel; a part that wins none takes its best
    voxel."""
    part = surface.face_part[face]
    parts = len(obj.parts)
    present = np.unique(voxel * parts + part)
    several = np.bincount(present // parts, minlength=count) > 1
    winner = np.zeros(count, np.int64)
    winner[voxel] = part
    mixed = np.flatnonzero(several[voxel])
    triangles = (surface.vertices[surface.faces[face[mixed]]] + 0.5) * resolution
    area = clipped_areas(triangles, cell[mixed])
    rows, row = np.unique(voxel[mixed], return_inverse=True)
    table = np.bincount(row * parts + part[mixed], area, len(rows) * parts).reshape(
        len(rows), parts
    )
    share = table / np.maximum(table.sum(1, keepdims=True), 1e-12)
    winner[rows] = np.argmax(np.round(share, 9), axis=1)
    taken: set[int] = set()
    for k in np.flatnonzero(np.bincount(winner, minlength=parts) == 0):
        best = int(np.argmax(share[:, k]))
        place = int(rows[best])
        alone = np.count_nonzero(winner == winner[place]) == 1
        if place in taken or alone:
            raise ValueError(
                f"object '{obj.name}': part '{obj.parts[k].name}' is too small to own a voxel at "
                f"resolution {resolution}; merge it with its parent or raise the resolution"
            )
        winner[place] = k
        taken.add(place)
    return winner


def _thin_voxels(surface, solids, resolution, subdivisions, face, cell) -> np.ndarray:
    """[K, R^3] bool: the part is thinner than ``THIN`` somewhere in the voxel. One probe for each
    triangle in each voxel."""
    thin = np.zeros((len(solids), resolution**3), bool)
    length = 1 / (resolution * subdivisions)
    corner = surface.vertices[surface.faces[face]]
    center = (cell + 0.5) / resolution - 0.5
    weight = surface.triangles.barycentric(face, center.astype(np.float32))
    point = np.einsum("nk,nkc->nc", weight, corner)
    inwards = corner.mean(1) - point
    reach = np.linalg.norm(inwards, axis=1, keepdims=True)
    point = point + inwards * np.minimum(1, INSET * length / np.maximum(reach, 1e-12))
    key = cell @ np.array([resolution**2, resolution, 1])
    part = surface.face_part[face]
    for k, solid in enumerate(solids):
        left = np.flatnonzero((part == k) & surface.proper[face])
        # a voxel that one probe finds thin needs no other: where parts are sheets, the first ones
        # settle nearly all
        for probes in (1, 3, len(left)):
            mine, left = _first_of_each(key, left, probes)
            thick = solid.thicker(face[mine] - surface.first[k], point[mine], THIN * length)
            thin[k, key[mine[~thick]]] = True
            left = left[~thin[k, key[left]]]
    return thin


def _first_of_each(key: np.ndarray, rows: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """``rows`` in two: the first ``count`` of each key, and the others."""
    order = np.argsort(key[rows], kind="stable")
    start = np.flatnonzero(np.r_[True, np.diff(key[rows][order]) > 0][: len(order)])
    rank = np.arange(len(order)) - np.repeat(start, np.diff(np.r_[start, len(order)]))
    return rows[order[rank < count]], rows[order[rank >= count]]


def _distances(surface, solids, thin, coords, resolution, subdivisions):
    """(sdf, owner, nearest face of the owner, weights of its corners at the nearest point) [n ..]
    of all sub-cells; sdf in sub-cells.

    The weights are there only where they matter: a part with thin places, or with colours that vary
    over a face.
    """
    cells = resolution * subdivisions
    distance, face = nearest_faces(
        surface.vertices, surface.faces, surface.triangles, coords, resolution, subdivisions
    )
    distance, face = distance.reshape(-1) * np.float32(cells), face.reshape(-1)
    owner = surface.face_part[face]
    offsets = subcell_offsets(subdivisions)

    def centers(index):
        voxel, subcell = np.divmod(index, len(offsets))
        return (coords[voxel] + offsets[subcell]) / resolution - 0.5

    has_thin = thin.any(1)
    may_be_thin = np.zeros(len(owner), bool)
    for k in np.flatnonzero(has_thin):
        around = _within(
            thin[k], coords, resolution, 2
        )  # voxels: the nearest point is within sqrt(3)
        may_be_thin |= np.repeat(around, subdivisions**3) & (owner == k)
    weight = np.zeros((len(owner), 3), np.float32)
    need = np.flatnonzero(may_be_thin | surface.varied[owner])
    weight[need] = surface.triangles.barycentric(face[need], centers(need).astype(np.float32))
    is_thin = np.zeros(len(owner), bool)
    need = np.flatnonzero(may_be_thin)
    is_thin[need] = _is_thin(surface, thin, owner[need], face[need], weight[need], resolution)

    value = distance.copy()
    rivals: list[tuple[int, np.ndarray, bool]] = []
    free = np.ones(len(owner), bool)  # outside every part
    for k, solid in enumerate(solids):
        voxels, inside = solid.contains_subcells(coords, resolution, subdivisions)
        row, subcell = np.nonzero(inside)
        where = voxels[row] * subdivisions**3 + subcell
        free[where] = False
        own = owner[where] == k
        value[where[own]] *= -1
        rivals.append((k, where[~own], True))
    value[is_thin] = np.minimum(value, distance - HALF_THIN)[is_thin]
    if has_thin.any():
        reach = int(np.ceil((SDF_CLIP + HALF_THIN) / subdivisions))
        open_to_thin = ~is_thin & (free | (distance < HALF_THIN / 2))
        for k in np.flatnonzero(has_thin):
            around = np.repeat(_within(thin[k], coords, resolution, reach), subdivisions**3)
            where = np.flatnonzero(open_to_thin & (owner != k) & around)
            rivals.append((int(k), where, False))
    for k, where, inside in rivals:
        if not len(where):
            continue
        begin, end = surface.first[k], surface.first[k + 1]
        points = centers(where)
        squared, its_face, _ = tree_query(surface.vertices, surface.faces[begin:end], points)
        its_face += begin
        its_distance = (np.sqrt(squared) * cells).astype(np.float32)
        its_value = -its_distance if inside else its_distance.copy()
        its_weight = surface.triangles.barycentric(its_face, points.astype(np.float32))
        its_thin = _is_thin(surface, thin, k, its_face, its_weight, resolution)
        its_value[its_thin] = np.minimum(its_value, its_distance - HALF_THIN)[its_thin]
        wins = its_value < value[where]
        where = where[wins]
        value[where], owner[where] = its_value[wins], k
        face[where], weight[where] = its_face[wins], its_weight[wins]
    return value, owner, face, weight


def _is_thin(surface, thin, part, face, weight, resolution) -> np.ndarray:
    """[n] bool: the voxel of the surface point is one of the part's thin ones."""
    corner = surface.corners[face]
    point = (
        corner[:, 0] * weight[:, :1] + corner[:, 1] * weight[:, 1:2] + corner[:, 2] * weight[:, 2:]
    )
    index = np.clip(((point + 0.5) * resolution).astype(np.int32), 0, resolution - 1)
    return thin[part, (index[:, 0] * resolution + index[:, 1]) * resolution + index[:, 2]]


def _within(voxels, coords, resolution, reach) -> np.ndarray:
    """[V] bool: one of ``voxels`` [R^3] bool is at most ``reach`` away along every axis."""
    mask = voxels.reshape((resolution,) * 3)
    return scipy.ndimage.maximum_filter(mask, size=2 * reach + 1, mode="constant")[tuple(coords.T)]


def _colors(obj, surface, owner, face, weight) -> np.ndarray:
    """[n, 3] float32 linear RGB of surface points."""
    color = np.empty((len(owner), 3), np.float32)
    for k, part in enumerate(obj.parts):
        mine = np.flatnonzero(owner == k)
        color[mine] = sample_color(part.mesh, face[mine] - surface.first[k], weight[mine])
    return color

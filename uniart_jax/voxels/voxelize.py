"""Articulated object -> part grid: active voxels, truncated signed distance, colour, owner.

Active voxels are those that the surface touches, by exact triangle-box overlap. Signs come from each part's winding number w_k,
magnitudes from an unsigned query d_k >= 0 (docs/architecture.md, "Sign and owner"), lengths in sub-cells:

    s_k = -d_k where |w_k| > 1/2, else d_k                                              (1)
    s_k <- min(s_k, d_k - sqrt(3)/2) where part k is thinner than sqrt(3)               (2)
    sdf = min_k s_k,  owner = argmin_k s_k (ties: nearest surface)                      (3)

One query over the whole surface finds the nearest part a everywhere. Another part can only win (3) where it contains the sub-cell, or
where (2) applies to it and not to a; only there it is asked, so the result is exact and most parts cost nothing.
"""

from __future__ import annotations

import dataclasses

import igl
import numpy as np
import trimesh

from uniart_jax.objects.appearance import sample_color
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.voxels.grid import SDF_CLIP, PartGrid, subcell_offsets
from uniart_jax.voxels.joint_code import encode_object
from uniart_jax.voxels.overlap import clipped_areas, touched_cells
from uniart_jax.voxels.solid import Solid

THIN = 3**0.5  # sub-cells: thinner shells leak between the samples
HALF_THIN = THIN / 2
INSET = 0.05  # sub-cells that a thickness probe keeps off its triangle's border, so that it does not graze the next face
MAX_PARTS = 256  # ids are uint8


@dataclasses.dataclass(frozen=True)
class _Surface:
    """All triangles of an object; faces of part k are first[k] .. first[k + 1]."""

    vertices: np.ndarray
    faces: np.ndarray
    face_part: np.ndarray
    first: np.ndarray


def voxelize(obj: ArticulatedObject, resolution: int = 32, subdivisions: int = 4) -> PartGrid:
    """The unified voxel representation of an object (paper, section on the unified 3D representation).

    Args:
      obj: normalised (inside [-1/2, 1/2]^3).
      resolution: R, at most 1024.
      subdivisions: r.

    Returns:
      PartGrid. ``voxel_part`` is the part with the largest area of triangles clipped to the voxel; ``color`` is that of the nearest
      surface point of the owner; sub-cells farther than SDF_CLIP are clipped, their owner and colour still exact.

    Raises:
      ValueError: the object is not normalised, has more than 256 parts, two parts with the same box, or parts too small to own a voxel.
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
    sdf, owner, nearest, point = _distances(surface, solids, thin, coords, resolution, subdivisions)
    color = _colors(obj, surface, owner, nearest, point)
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
    return _Surface(
        np.ascontiguousarray(
            np.concatenate([p.mesh.vertices for p in obj.parts]), dtype=np.float64
        ),
        np.concatenate(
            [p.mesh.faces + s for p, s in zip(obj.parts, starts[:-1], strict=True)]
        ).astype(np.int64),
        np.repeat(np.arange(len(counts)), counts),
        np.cumsum([0, *counts]),
    )


def _largest_parts(obj, surface, resolution, face, cell, voxel, count) -> np.ndarray:
    """[V] part with the largest clipped area in each voxel; a part that wins none takes its best voxel."""
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
                f"object '{obj.name}': part '{obj.parts[k].name}' is too small to own a voxel at resolution {resolution}; "
                "merge it with its parent or raise the resolution"
            )
        winner[place] = k
        taken.add(place)
    return winner


def _thin_voxels(surface, solids, resolution, subdivisions, face, cell) -> np.ndarray:
    """[K, R^3] bool: the part is thinner than ``THIN`` somewhere in the voxel.

    One probe for each triangle in each voxel: going in along the normal, the part must still be there after half of ``THIN`` and after
    all of it. Where a part is no outward-oriented volume, either side may be the inner one.
    """
    thin = np.zeros((len(solids), resolution**3), bool)
    length = 1 / (resolution * subdivisions)
    corner = surface.vertices[surface.faces[face]]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    size = np.linalg.norm(normal, axis=1)
    use = np.flatnonzero(size > 1e-14)
    corner, normal = corner[use], normal[use] / size[use, None]
    center = (cell[use] + 0.5) / resolution - 0.5
    point = trimesh.triangles.closest_point(corner, center)
    inwards = corner.mean(1) - point
    reach = np.linalg.norm(inwards, axis=1, keepdims=True)
    point = point + inwards * np.minimum(1, INSET * length / np.maximum(reach, 1e-12))
    key = np.ravel_multi_index(tuple(cell[use].T), (resolution,) * 3)
    part = surface.face_part[face[use]]
    for k, solid in enumerate(solids):
        mine = np.flatnonzero(part == k)
        thick = _reaches(solid, point[mine], -normal[mine] * length)
        if not solid.outward:
            left = np.flatnonzero(~thick)
            thick[left] = _reaches(solid, point[mine[left]], normal[mine[left]] * length)
        thin[k, key[mine[~thick]]] = True
    return thin


def _reaches(solid: Solid, point: np.ndarray, step: np.ndarray) -> np.ndarray:
    inside = solid.contains(point + THIN * step)
    there = np.flatnonzero(inside)
    inside[there] = solid.contains(point[there] + HALF_THIN * step[there])
    return inside


def _distances(surface, solids, thin, coords, resolution, subdivisions):
    """(sdf, owner, nearest face of the owner, nearest point on it) of all sub-cells, in one long row; sdf in sub-cells."""
    cells = resolution * subdivisions
    offsets = (subcell_offsets(subdivisions) * subdivisions - 0.5).round().astype(np.int64)
    lattice = (coords[:, None].astype(np.int64) * subdivisions + offsets).reshape(-1, 3)
    center = (lattice + 0.5) / cells - 0.5
    squared, face, point = _query(surface.vertices, surface.faces, center)
    distance = np.sqrt(squared) * cells
    owner = surface.face_part[face]
    thin_here = thin[owner, _voxel_key(point, resolution)]
    value = distance.copy()
    rivals: list[tuple[int, np.ndarray, np.ndarray]] = []
    free = np.ones(len(lattice), bool)  # outside every part
    for k, solid in enumerate(solids):
        inside = np.flatnonzero(solid.contains_lattice(lattice, cells))
        free[inside] = False
        own = owner[inside] == k
        value[inside[own]] *= -1
        rivals.append((k, inside[~own], np.ones(np.count_nonzero(~own), bool)))
    value = np.where(thin_here, np.minimum(value, distance - HALF_THIN), value)
    open_to_thin = ~thin_here & (free | (distance < HALF_THIN / 2))
    for k in np.flatnonzero(thin.any(1)):
        near = np.flatnonzero(open_to_thin & (owner != k))
        places = np.stack(np.unravel_index(np.flatnonzero(thin[k]), (resolution,) * 3), -1)
        low, high = places.min(0) * subdivisions, (places.max(0) + 1) * subdivisions
        reach = int(np.ceil(SDF_CLIP + HALF_THIN))
        close = ((lattice[near] >= low - reach) & (lattice[near] < high + reach)).all(1)
        rivals.append((int(k), near[close], np.zeros(np.count_nonzero(close), bool)))
    for k, where, inside in rivals:
        if not len(where):
            continue
        begin, end = surface.first[k], surface.first[k + 1]
        squared, its_face, its_point = _query(
            surface.vertices, surface.faces[begin:end], center[where]
        )
        its_distance = np.sqrt(squared) * cells
        its_value = np.where(inside, -its_distance, its_distance)
        its_thin = thin[k, _voxel_key(its_point, resolution)]
        its_value = np.where(its_thin, np.minimum(its_value, its_distance - HALF_THIN), its_value)
        wins = its_value < value[where]
        where = where[wins]
        value[where], owner[where] = its_value[wins], k
        face[where], point[where] = its_face[wins] + begin, its_point[wins]
    return value, owner, face, point


def _query(vertices, faces, points):
    """(squared distance, face, nearest point) by igl's box tree."""
    tree = igl.AABB()
    tree.init(vertices, faces)
    return tree.squared_distance(vertices, faces, np.ascontiguousarray(points))


def _voxel_key(point: np.ndarray, resolution: int) -> np.ndarray:
    index = np.clip(((point + 0.5) * resolution).astype(np.int64), 0, resolution - 1)
    return (index[:, 0] * resolution + index[:, 1]) * resolution + index[:, 2]


def _colors(obj, surface, owner, face, point) -> np.ndarray:
    """[n, 3] float32 linear RGB of surface points."""
    color = np.empty((len(owner), 3), np.float32)
    for k, part in enumerate(obj.parts):
        mine = np.flatnonzero(owner == k)
        corner = surface.vertices[surface.faces[face[mine]]]
        barycentric = trimesh.triangles.points_to_barycentric(corner, point[mine])
        color[mine] = sample_color(
            part.mesh, face[mine] - surface.first[k], np.clip(barycentric, 0, 1)
        )
    return color

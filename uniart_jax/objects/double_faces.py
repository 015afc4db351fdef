"""Faces that exist twice, back to back: one of each pair is kept, the one that looks outwards.

Models made for display (PartNet-Mobility throughout) hold every triangle a second time with the opposite orientation, often in another colour. Such a
mesh has no inside: its winding number is 0 everywhere, so solids would be read as hollow shells, and which of the two colours is seen is left to chance.

Patches that hang together are oriented as a whole (libigl), by how freely each side looks out of the mesh: rays from points of the patch, as Takayama et al.
propose ("A simple method for correcting facet orientations in polygon meshes based on ray casting", 2014), with fixed directions: equal files give equal meshes.
"""

from __future__ import annotations

import igl
import numpy as np
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

DOUBLED = 0.5  # share of a mesh's faces that exist twice, from which on it was made so on purpose
SAME = 1e-6  # of the mesh's size: vertices closer than that are one
DIRECTIONS = 48  # of rays, over the whole sphere
RAYS_AT_ONCE = 1 << 20
POINTS = 64  # faces of a patch that are asked


def single_sided(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, int]:
    """The mesh without the inner of each two back-to-back faces and without repeated faces, and how many were taken out.

    Faces that exist once are left as they are. The mesh itself is returned where fewer than half of its faces are such pairs: two boxes that stand against
    each other share a face that is none.
    """
    ids, points = _merged(mesh)
    corners = ids[mesh.faces]
    order = np.argsort(corners, 1)
    even = _same_orientation(order, np.array([[0, 1, 2]]))
    ascending = np.take_along_axis(corners, order, 1)
    proper = (np.diff(ascending, axis=1) > 0).all(1)
    unique, first, group = np.unique(ascending, axis=0, return_index=True, return_inverse=True)
    group = group.reshape(-1)
    number = len(unique)
    # the first face of each group and orientation, or -1
    face = np.full((2, number), -1)
    for parity in (0, 1):
        mine = np.flatnonzero(even == bool(parity))[::-1]
        face[parity, group[mine]] = mine
    both = (face >= 0).all(0) & proper[first]
    if not both.any() or both[group].mean() < DOUBLED:
        return mesh, 0
    kept = np.maximum(face[0], face[1])
    kept[~both] = first[~both]
    outward = _outward(points, unique, proper[first])  # whether the even orientation looks out
    kept[both] = np.where(outward[both], face[1, both], face[0, both])
    mask = np.zeros(len(mesh.faces), bool)
    mask[kept] = True
    mask |= ~proper  # faces without area are somebody else's business
    single = mesh.copy()
    single.update_faces(mask)
    return single, int(len(mask) - mask.sum())


def _merged(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    """[V] which place each vertex is at, and [P, 3] the places."""
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    step = SAME * max(float(np.ptp(vertices, axis=0).max()), 1e-12)
    cells = np.round((vertices - vertices.min(0)) / step).astype(np.int64)
    _, first, ids = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    return ids.reshape(-1), vertices[first]


def _outward(points: np.ndarray, faces: np.ndarray, proper: np.ndarray) -> np.ndarray:
    """[F] whether each face, as oriented, looks out of the mesh."""
    outward = np.ones(len(faces), bool)
    if not proper.any():
        return outward
    faces = np.ascontiguousarray(faces[proper], dtype=np.int64)
    turned, patch = igl.bfs_orient(faces)
    patch = np.asarray(patch).reshape(-1)
    flipped = ~_same_orientation(faces, turned)
    asked = _spread(points, turned, patch)
    freedom = _freedom(points, turned, asked)
    votes = np.bincount(patch[asked], freedom, minlength=patch.max() + 1)
    corner = points[turned]
    volume = np.einsum("fc,fc->f", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])) / 6
    signed = np.bincount(patch, volume, minlength=len(votes))
    looks_out = np.where(np.abs(votes) > 1e-9, votes, signed) >= 0  # nobody sees an enclosed patch
    outward[proper] = looks_out[patch] ^ flipped
    return outward


def _same_orientation(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """[F] whether two triangles of the same corners go round the same way."""
    return np.any([(a == np.roll(b, k, 1)).all(1) for k in range(3)], 0)


def _spread(points: np.ndarray, faces: np.ndarray, patch: np.ndarray) -> np.ndarray:
    """Faces that are asked: of each patch the largest and others at even distances, at most POINTS."""
    area = np.linalg.norm(np.cross(*(points[faces[:, k]] - points[faces[:, 0]] for k in (1, 2))), axis=1)  # fmt: skip
    order = np.lexsort((-area, patch))
    start = np.flatnonzero(np.r_[True, np.diff(patch[order]) > 0])
    rank = np.arange(len(order)) - np.repeat(start, np.diff(np.r_[start, len(order)]))
    size = np.bincount(patch)[patch[order]]
    stride = np.maximum(size // POINTS, 1)
    return order[rank % stride == 0]


def _freedom(points: np.ndarray, faces: np.ndarray, asked: np.ndarray) -> np.ndarray:
    """[n] area-weighted share of free rays from the front of the asked faces minus that from their backs."""
    scene = EmbreeScene(robust=True)
    TriangleMesh(scene, points[faces].astype(np.float32))
    corner = points[faces[asked]]
    middle = corner.mean(1)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    area = np.linalg.norm(normal, axis=1)
    normal = normal / np.maximum(area, 1e-300)[:, None]
    offset = 1e-4 * float(np.ptp(points, axis=0).max())
    score = np.zeros(len(asked))
    per_chunk = max(1, RAYS_AT_ONCE // DIRECTIONS)
    for begin in range(0, len(asked), per_chunk):
        here = slice(begin, begin + per_chunk)
        for direction in _directions():
            cosine = normal[here] @ direction
            side = np.sign(cosine)
            start = (middle[here] + side[:, None] * offset * normal[here]).astype(np.float32)
            rays = np.broadcast_to(direction.astype(np.float32), start.shape).copy()
            free = scene.run(start, rays, query="OCCLUDED") != 0
            score[here] += free * cosine
    return score * area


def _directions() -> np.ndarray:
    """[DIRECTIONS, 3] unit vectors, evenly over the sphere."""
    index = np.arange(DIRECTIONS) + 0.5
    height, angle = 1 - 2 * index / DIRECTIONS, np.pi * (1 + 5**0.5) * index
    radius = np.sqrt(1 - height**2)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), height], -1)

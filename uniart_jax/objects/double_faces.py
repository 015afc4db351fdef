"""Faces that exist twice, back to back: one of each pair is kept, the one that looks outwards.

Models made for display (PartNet-Mobility throughout) hold every triangle a second time with the
opposite orientation, often in another colour. Such a mesh has no inside: its winding number is 0
everywhere, so solids would be read as hollow shells, and which of the two colours is seen is left
to chance.

Patches that hang together are oriented as a whole (libigl), by how freely each side looks out of
the mesh: rays from points of the patch, as Takayama et al. propose ("A simple method for correcting
facet orientations in polygon meshes based on ray casting", 2014), with fixed directions: equal
files give equal meshes.
"""

from __future__ import annotations

import igl
import numpy as np
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from uniart_jax.objects.directions import directions
from uniart_jax.objects.object import moved_mesh

# share of a connected piece's faces that exist twice, from which on it was made so on purpose
DOUBLED = 0.5
SAME = 1e-6  # of the mesh's size: vertices closer than that are one
DIRECTIONS = 48  # of rays, over the whole sphere
RAYS_AT_ONCE = 1 << 20
POINTS = 64  # faces of a patch that are asked


def single_sided(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, int]:
    """The mesh without the inner of each two back-to-back faces and without repeated faces, and how
    many were taken out.

    Each connected piece is judged by itself: it is left as it is where fewer than half of its faces
    are such pairs, since two boxes that stand against each other share a face that is none. Which
    side looks out is asked of the whole mesh. Faces that exist once and faces without area are left
    as they are; the mesh itself is returned where nothing is taken out. A mesh that is made shares
    its material with the original.
    """
    ids, points = _merged(mesh)
    corners = ids[mesh.faces]
    order = np.argsort(corners, 1)
    even = _same_orientation(order, np.array([[0, 1, 2]]))
    ascending = np.take_along_axis(corners, order, 1)
    proper: np.ndarray = np.all(np.diff(ascending, axis=1) > 0, axis=1)
    unique, first, group = np.unique(ascending, axis=0, return_index=True, return_inverse=True)
    group = group.reshape(-1)
    number = len(unique)
    # the first face of each group and orientation, or -1
    face = np.full((2, number), -1)
    for parity in (0, 1):
        mine = np.flatnonzero(even == bool(parity))[::-1]
        face[parity, group[mine]] = mine
    both = (face >= 0).all(0) & proper[first]
    mended = proper[first] & _mended(points, corners, both[group], proper)[first]
    if not (both & mended).any():
        return mesh, 0
    kept = np.maximum(face[0], face[1])
    kept[~both] = first[~both]
    # whether the even orientation looks out
    outward = _outward(points, unique, proper[first], mended)
    kept[both] = np.where(outward[both], face[1, both], face[0, both])
    mask = ~mended[group]
    mask[kept[mended]] = True
    single = moved_mesh(mesh, np.eye(4))
    single.update_faces(mask)
    return single, int(len(mask) - mask.sum())


def _mended(
    points: np.ndarray, corners: np.ndarray, paired: np.ndarray, proper: np.ndarray
) -> np.ndarray:
    """[F] whether a face lies in a connected piece most of whose faces, of those that have an area,
    stand back to back."""
    ends = corners[proper]
    links = coo_array(
        (np.ones(2 * len(ends)), (np.repeat(ends[:, 0], 2), ends[:, 1:].ravel())),
        shape=(len(points), len(points)),
    )
    count, piece = connected_components(links, directed=False)
    piece = piece[corners[:, 0]]
    size = float(np.ptp(points, axis=0).max())
    seen = proper & (trimesh.triangles.area(points[corners]) > (SAME * size) ** 2)
    faces = np.bincount(piece[seen], minlength=count)
    pairs = np.bincount(piece[seen & paired], minlength=count)
    return (pairs > 0)[piece] & (pairs >= DOUBLED * faces)[piece]


def _merged(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    """[V] which place each vertex is at, and [P, 3] the places."""
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    step = SAME * max(float(np.ptp(vertices, axis=0).max()), 1e-12)
    cells = np.round((vertices - vertices.min(0)) / step).astype(np.int64)
    _, first, ids = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    return ids.reshape(-1), vertices[first]


def _outward(
    points: np.ndarray, faces: np.ndarray, proper: np.ndarray, wanted: np.ndarray
) -> np.ndarray:
    """[F] whether each face, as oriented, looks out of the mesh; told of the wanted ones, though
    all stand in the way of rays."""
    outward = np.ones(len(faces), bool)
    if not proper.any():
        return outward
    faces = np.ascontiguousarray(faces[proper], dtype=np.int64)
    turned, patch = igl.bfs_orient(faces)
    patch = np.asarray(patch).reshape(-1)
    flipped = ~_same_orientation(faces, turned)
    asked = _spread(points, turned, patch)
    asked = asked[np.isin(patch[asked], patch[wanted[proper]])]
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
    """Faces that are asked: of each patch the largest and others at even distances, at most
    POINTS."""
    area = trimesh.triangles.area(points[faces])
    order = np.lexsort((-area, patch))
    start = np.flatnonzero(np.r_[True, np.diff(patch[order]) > 0])
    rank = np.arange(len(order)) - np.repeat(start, np.diff(np.r_[start, len(order)]))
    size = np.bincount(patch)[patch[order]]
    stride = -(-size // POINTS)
    return order[rank % stride == 0]


def _freedom(points: np.ndarray, faces: np.ndarray, asked: np.ndarray) -> np.ndarray:
    """[n] area-weighted share of free rays from the front of the asked faces minus that from their
    backs."""
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
        for direction in directions(DIRECTIONS):
            cosine = normal[here] @ direction
            side = np.sign(cosine)
            start = (middle[here] + side[:, None] * offset * normal[here]).astype(np.float32)
            rays = np.broadcast_to(direction.astype(np.float32), start.shape).copy()
            free = scene.run(start, rays, query="OCCLUDED") != 0
            score[here] += free * cosine
    return score * area

"""Open surfaces given a thickness, so that every part that is written bounds a solid.

Files of others hold sheets: doors without a back, tubes without ends. Each connected sheet gets a second layer behind the one that is seen, and a rim
along its border. What was closed stays as it is.
"""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

THICKNESS = 0.003  # of the object's longest side
THINNEST = (
    0.25  # of a sheet's own least extent, if that is less: a narrow tube must not turn inside out
)
APART = 3e-6  # of the longest side: sheets that share a border do not touch, so that every edge has two faces


def closed(vertices: np.ndarray, faces: np.ndarray, side: float) -> tuple[np.ndarray, np.ndarray]:
    """(vertices, faces) of the surface with a thickness where it was open: every edge has two faces that agree on which side is out.

    Args:
      vertices, faces: [v, 3], [f, 3]; no two vertices in the same place, no face without an area.
      side: longest side of the object, in their units.
    """
    faces = np.asarray(faces, np.int64)
    across = _across(faces)
    inner = np.flatnonzero(across >= 0)
    sheet = _groups(inner // 3, across[inner] // 3, len(faces))
    border = across.reshape(-1, 3) < 0
    is_open = np.isin(sheet, sheet[border.any(1)])
    if not is_open.any():
        return vertices, faces
    # a corner of a face is the vertex of its fan: where two sheets, or two ends of one, meet in a point they do not hang together
    after = np.arange(faces.size) // 3 * 3 + (np.arange(faces.size) + 1) % 3
    fan = _groups(
        np.r_[inner, after[inner]], np.r_[after[across[inner]], across[inner]], faces.size
    )
    thin = fan.reshape(-1, 3)[is_open]
    fans, thin = np.unique(thin, return_inverse=True)
    thin = thin.reshape(-1, 3)
    first = np.unique(fan, return_index=True)[1][fans]
    points, own = vertices[faces.ravel()[first]], sheet[first // 3]
    mesh = trimesh.Trimesh(points, thin, process=False)
    normals = np.asarray(mesh.vertex_normals)
    normals = np.where(np.linalg.norm(normals, axis=1, keepdims=True) > 0.5, normals, [0, 0, 1.0])
    low, high = np.full((2, len(faces), 3), np.inf) * [[[1]], [[-1]]]
    np.minimum.at(low, own, points)
    np.maximum.at(high, own, points)
    least = (high - low).min(1)[own]
    thickness = np.where(least > APART * side, np.minimum(THICKNESS * side, THINNEST * least), THICKNESS * side)  # fmt: skip
    front = points - normals * (APART * side * (1 + _copy(faces.ravel()[first])))[:, None]
    back = points - normals * thickness[:, None]
    n = len(points)
    a, b = thin[border[is_open]], np.roll(thin, -1, axis=1)[border[is_open]]
    rim = [np.stack([b, a, a + n], 1), np.stack([b, a + n, b + n], 1)]
    kept, solid = np.unique(faces[~is_open], return_inverse=True)
    layers = np.concatenate([thin, thin[:, ::-1] + n, *rim]) + len(kept)
    return (
        np.concatenate([vertices[kept], front, back]),
        np.concatenate([solid.reshape(-1, 3), layers]),
    )


def _across(faces: np.ndarray) -> np.ndarray:
    """[3 f] the same edge of the face on its other side, for edge 3 f + i from corner i to the next; -1 at a border, where more than two faces
    meet, or where two disagree on which side is out."""
    first, second = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    key = np.minimum(first, second) * (faces.max(initial=0) + 1) + np.maximum(first, second)
    order = np.argsort(key, kind="stable")
    begin = np.flatnonzero(np.r_[True, np.diff(key[order]) != 0])
    begin = begin[np.diff(np.r_[begin, len(key)]) == 2]
    a, b = order[begin], order[begin + 1]
    agree = (first[a] == second[b]) & (first[a] != first[b])
    across = np.full(faces.size, -1, np.int64)
    across[a[agree]], across[b[agree]] = b[agree], a[agree]
    return across


def _groups(a: np.ndarray, b: np.ndarray, count: int) -> np.ndarray:
    """[count] the connected group of each number, by links between a and b."""
    return connected_components(coo_array((np.ones(len(a)), (a, b)), (count, count)), False)[1]


def _copy(values: np.ndarray) -> np.ndarray:
    """[n] how many equal values stand before each."""
    order = np.argsort(values, kind="stable")
    start = np.flatnonzero(np.r_[True, np.diff(values[order]) != 0])
    out = np.empty(len(values), np.int64)
    out[order] = np.arange(len(values)) - np.repeat(start, np.diff(np.r_[start, len(values)]))
    return out

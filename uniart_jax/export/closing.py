"""Open surfaces given a thickness, so that every part that is written bounds a solid.

Files of others hold sheets: doors without a back, tubes without ends. Each connected sheet gets a
second layer behind the one that is seen, and a rim along its border. What was closed stays as it
is, solids that touch along an edge or a face included.
"""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

THICKNESS = 0.003  # of the object's longest side
# of a bent sheet's own least extent, if that is less: a narrow tube must not turn inside out
NARROW = 0.25
FLAT = 0.95  # length of a sheet's mean normal, from which on it is not bent
# of the longest side: layers of sheets that share a border do not touch, so that every edge has two
# faces
APART = 3e-6


def closed(vertices: np.ndarray, faces: np.ndarray, side: float) -> tuple[np.ndarray, np.ndarray]:
    """(vertices, faces) of the surface with a thickness where it was open.

    Of what is new every edge has two faces that agree on which side is out. Faces of a sheet that
    disagree are turned first.

    Args:
      vertices, faces: [v, 3], [f, 3]; no two vertices in the same place, no face without an area.
      side: longest side of the object, in their units.
    """
    faces = np.asarray(faces, np.int64)
    rest = ~_is_solid(faces)
    if not rest.any():
        return vertices, faces
    loose = _turned_alike(vertices, faces[rest])
    across = _across(loose, np.zeros(len(loose), np.int64))
    sheet = _sheets(across, len(loose))
    is_open = np.isin(sheet, sheet[(across.reshape(-1, 3) < 0).any(1)])
    if not is_open.any():  # solids that share a face, or whose faces disagreed
        faces = faces.copy()
        faces[rest] = loose
        return vertices, faces
    solid, loose = np.concatenate([faces[~rest], loose[~is_open]]), loose[is_open]
    across = _across(loose, np.zeros(len(loose), np.int64))
    # two borders between the same two vertices would share their rim: one of the faces is cut out
    while True:
        fan = _fans(across, len(loose))
        border = across < 0
        ends = np.sort(np.stack([fan[border], fan[_after(len(loose))[border]]], 1), axis=1)
        _, first = np.unique(ends, axis=0, return_index=True)
        again = np.setdiff1d(np.arange(len(ends)), first)
        if not len(again):
            break
        cut = np.unique(np.flatnonzero(border)[again] // 3)
        edges = (3 * cut[:, None] + np.arange(3)).ravel()
        others = across[edges]
        across[others[others >= 0]] = -1
        across[edges] = -1
    layers, thin = _layers(vertices, loose, fan, _sheets(across, len(loose)), border, side)
    kept, solid = np.unique(solid, return_inverse=True)
    joined = np.concatenate([solid.reshape(-1, 3), thin + len(kept)])
    return np.concatenate([vertices[kept], layers]), joined


def is_bounded(faces: np.ndarray) -> bool:
    """Whether every edge has an even number of faces, as where solids touch: what
    ``simulation.soundness`` calls watertight too.

    Args:
      faces: [f, 3]; no two vertices in the same place.
    """
    return bool((faces_an_edge(faces) % 2 == 0).all())


def faces_an_edge(faces: np.ndarray) -> np.ndarray:
    """[e] how many faces each edge has."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return np.unique(edges, axis=0, return_counts=True)[1]


def _layers(
    vertices: np.ndarray,
    faces: np.ndarray,
    fan: np.ndarray,
    sheet: np.ndarray,
    border: np.ndarray,
    side: float,
) -> tuple[np.ndarray, np.ndarray]:
    """(vertices, faces) of sheets with a thickness; ``fan`` [3 f], ``border`` [3 f] of the corners
    and edges of ``faces``, ``sheet`` [f]."""
    first = np.unique(fan, return_index=True)[1]
    original, own, thin = faces.ravel()[first], sheet[first // 3], fan.reshape(-1, 3)
    points = vertices[original]
    mesh = trimesh.Trimesh(points, thin, process=False)
    normals = np.asarray(mesh.vertex_normals)
    normals = np.where(np.linalg.norm(normals, axis=1, keepdims=True) > 0.5, normals, [0, 0, 1.0])
    gap = APART * side * (1 + _copy(original))
    thickness = np.maximum(_thickness(mesh, points, own, sheet, side), 4 * gap) + gap
    n = len(points)
    a, b = thin.ravel()[border], thin.ravel()[_after(len(faces))[border]]
    rim = [np.stack([b, a, a + n], 1), np.stack([b, a + n, b + n], 1)]
    front, back = points - normals * gap[:, None], points - normals * thickness[:, None]
    return np.concatenate([front, back]), np.concatenate([thin, thin[:, ::-1] + n, *rim])


def _thickness(
    mesh: trimesh.Trimesh, points: np.ndarray, own: np.ndarray, sheet: np.ndarray, side: float
) -> np.ndarray:
    """[n] of the sheet that each point is of; ``sheet`` [f] of the faces."""
    count = int(sheet.max()) + 1
    area = np.maximum(np.bincount(sheet, mesh.area_faces, count), 1e-300)
    normals = np.nan_to_num(np.asarray(mesh.face_normals)) * np.asarray(mesh.area_faces)[:, None]
    mean = np.stack([np.bincount(sheet, normals[:, i], count) for i in range(3)], 1)
    bent = np.linalg.norm(mean, axis=1) < FLAT * area
    number = np.maximum(np.bincount(own, minlength=count), 1)
    centre = (
        np.stack([np.bincount(own, points[:, i], count) for i in range(3)], 1) / number[:, None]
    )
    away = points - centre[own]
    spread = np.zeros((count, 3, 3))
    np.add.at(spread, own, away[:, :, None] * away[:, None])
    along = np.einsum("ni,ni->n", away, np.linalg.eigh(spread)[1][own, :, 0])
    low, high = np.zeros(count), np.zeros(count)
    np.minimum.at(low, own, along)
    np.maximum.at(high, own, along)
    narrow = np.where(bent, NARROW * (high - low), np.inf)
    return np.minimum(THICKNESS * side, narrow)[own]


def _turned_alike(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The faces with neighbours on the same side, as far as that can be; most of a sheet's area
    stays as it was."""
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    trimesh.repair.fix_winding(mesh)
    fixed = np.asarray(mesh.faces)
    turned = (fixed != faces).any(1)
    if not turned.any():
        return faces
    first, second = np.asarray(mesh.face_adjacency).T
    sheet = _groups(first, second, len(faces))
    area = np.asarray(mesh.area_faces)
    most = np.bincount(sheet, area * turned) > 0.5 * np.bincount(sheet, area)
    return np.where(most[sheet][:, None], fixed[:, ::-1], fixed)


def _is_solid(faces: np.ndarray) -> np.ndarray:
    """[f] whether a face is of a body that is closed by itself, whatever touches it."""
    first, second = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    edge = np.unique(np.sort(np.stack([first, second], 1), axis=1), axis=0, return_inverse=True)[1]
    alone = np.bincount(edge.ravel())[edge.ravel()] == 2
    across = _across(faces, np.zeros(len(faces), np.int64))
    body = _sheets(np.where(alone, across, -1), len(faces))
    border = _across(faces, body).reshape(-1, 3) < 0
    return ~np.isin(body, body[border.any(1)])


def _across(faces: np.ndarray, body: np.ndarray) -> np.ndarray:
    """[3 f] the same edge of a face on its other side, for edge 3 f + i from corner i to the next;
    -1 at a border.

    Only faces of one ``body`` [f] are paired. Where more than two meet they are paired as far as
    they run in both directions: solids that touch have no border.
    """
    first, second = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    ends = np.sort(np.stack([first, second], 1), axis=1)
    edge = np.unique(np.column_stack([ends, np.repeat(body, 3)]), axis=0, return_inverse=True)[1]
    forward = first < second
    rank = _copy(2 * edge.ravel() + forward)
    key = edge.ravel() * (rank.max(initial=0) + 1) + rank
    ahead, behind = np.flatnonzero(forward), np.flatnonzero(~forward)
    _, i, j = np.intersect1d(key[ahead], key[behind], return_indices=True)
    across = np.full(faces.size, -1, np.int64)
    across[ahead[i]], across[behind[j]] = behind[j], ahead[i]
    return across


def _after(count: int) -> np.ndarray:
    """[3 f] the next corner of the same face."""
    corner = np.arange(3 * count)
    return corner // 3 * 3 + (corner + 1) % 3


def _sheets(across: np.ndarray, count: int) -> np.ndarray:
    """[f] the connected sheet of each face."""
    inner = np.flatnonzero(across >= 0)
    return _groups(inner // 3, across[inner] // 3, count)


def _fans(across: np.ndarray, count: int) -> np.ndarray:
    """[3 f] the vertex of each corner: where two sheets, or two ends of one, meet in a point they
    do not hang together."""
    inner, after = np.flatnonzero(across >= 0), _after(count)
    return _groups(
        np.r_[inner, after[inner]], np.r_[after[across[inner]], across[inner]], 3 * count
    )


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

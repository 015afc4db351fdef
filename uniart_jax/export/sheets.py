"""Open surfaces as thin solids: flat plates, each with the outline of a region of faces that lie
near one plane.

PartNet-Mobility's parts are mostly such surfaces: walls without a back, boxes without a lid. A
plate says where a wall is to within a small share of the object, however large its part is.
"""

from __future__ import annotations

import numpy as np
from manifold3d import CrossSection, FillRule, Manifold
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

REGIONS = 96  # at most; of more, the distance to the planes is doubled until there are not


def plates(
    vertices: np.ndarray, faces: np.ndarray, tolerance: float, thickness: float
) -> list[Manifold]:
    """Solids that stand for an open surface, no place of which is farther off than the tolerance.

    Args:
      vertices, faces: [v, 3], [f, 3]; any surface, places made one.
      tolerance: how far faces of a plate may lie from its middle plane; more where the surface
        would need more than ``REGIONS`` plates. Of more shells than that, those whose largest face
        is the smallest are left out.
      thickness: of a plate.
    """
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1) / 2
    kept = areas > 1e-12 * areas.max(initial=0.0)
    faces, areas, normals = faces[kept], areas[kept], normals[kept] / (2 * areas[kept, None])
    if not len(faces):
        return []
    longest = float(np.ptp(vertices[faces].reshape(-1, 3), axis=0).max())
    edges = _edges(faces)
    regions, whole = _regions(vertices, faces, normals, areas, edges, tolerance)
    while not whole and tolerance < longest:
        tolerance *= 2
        regions, whole = _regions(vertices, faces, normals, areas, edges, tolerance)
    found = (_plate(vertices, faces[own], normal, thickness) for own, normal in regions)
    return [plate for plate in found if not plate.is_empty()]


def _regions(
    vertices: np.ndarray,
    faces: np.ndarray,
    normals: np.ndarray,
    areas: np.ndarray,
    edges: tuple[np.ndarray, np.ndarray],
    tolerance: float,
) -> tuple[list[tuple[np.ndarray, np.ndarray]], bool]:
    """(faces, normal [3]) of connected regions that keep within ``tolerance`` of a plane, grown
    from the largest face that is left, ``REGIONS`` at most; and whether they are all."""
    edge, owner = edges
    left = np.ones(len(faces), bool)
    found: list[tuple[np.ndarray, np.ndarray]] = []
    while left.any() and len(found) < REGIONS:
        seed = int(np.argmax(np.where(left, areas, -1)))
        height = np.abs((vertices - vertices[faces[seed, 0]]) @ normals[seed])
        near = left & (height[faces].max(1) <= tolerance)
        near[seed] = True
        inside = near[owner]
        ends, same = owner[inside], np.diff(edge[inside]) == 0
        graph = coo_matrix(
            (np.ones(same.sum()), (ends[:-1][same], ends[1:][same])), shape=(len(faces),) * 2
        )
        label = connected_components(graph, directed=False)[1]
        own = np.flatnonzero(label == label[seed])
        left[own] = False
        found.append((own, normals[seed]))
    return found, not left.any()


def _edges(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """([n] which edge, [n] of which face) of all faces' edges, in the edges' order."""
    ends = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edge = np.unique(ends, axis=0, return_inverse=True)[1].reshape(-1)
    order = np.argsort(edge, kind="stable")
    return edge[order], order // 3


def _plate(
    vertices: np.ndarray, faces: np.ndarray, normal: np.ndarray, thickness: float
) -> Manifold:
    """The outline of faces, seen along ``normal``, as a solid around their middle height."""
    first = np.eye(3)[np.abs(normal).argmin()]
    first = first - (first @ normal) * normal
    first /= np.linalg.norm(first)
    frame = np.column_stack([first, np.cross(normal, first), normal])
    local = vertices[faces] @ frame
    flat = local[..., :2].reshape(-1, 2)
    low, side = flat.min(0), float(np.ptp(flat, axis=0).max())  # clipper rounds: to a unit square
    outline = (local[..., :2] - low) / side
    edge, other = outline[:, 1] - outline[:, 0], outline[:, 2] - outline[:, 0]
    turned = edge[:, 0] * other[:, 1] < edge[:, 1] * other[:, 0]
    outline[turned] = outline[turned, ::-1]
    middle = (local[..., 2].min() + local[..., 2].max()) / 2
    section = CrossSection(list(outline), FillRule.NonZero).simplify(thickness / (8 * side))
    solid = section.extrude(1.0)
    scale = np.array([side, side, thickness])
    return solid.transform(np.column_stack([frame * scale, frame @ [*low, middle - thickness / 2]]))

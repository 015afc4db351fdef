"""How a piece lies on the plate, and where: deterministic, on z = 0, no two over each other."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from manifold3d import Manifold
from scipy.spatial import ConvexHull, QhullError

from uniart_jax.export.convex_split import triangles
from uniart_jax.export.printing.solids import box_of, turned

FLAT = 0.05  # mm: what is nearer to the plate lies on it
SPACE = 5.0  # between pieces
TRIED = 24  # faces of the hull that are compared, the largest first
STEEP = np.cos(np.deg2rad(45.0))  # faces that look down more than this hang over


@dataclasses.dataclass(frozen=True)
class Lying:
    """A piece on the plate.

    Attributes:
      matrix: [4, 4] from where it stands assembled to where it lies.
      contact: mm^2 that touch the plate.
      overhang: mm^2 that look down by more than 45 degrees and hang in the air.
    """

    matrix: np.ndarray
    contact: float
    overhang: float


def laid(solid: Manifold) -> Lying:
    """The piece on the face that touches the plate with most of its surface, among those that it
    stands on; of nearly equals the one with the least overhang, then the lowest. Only the largest
    faces of its hull are compared; if it stands on none of them, the next on which it does is
    taken, and if there is none, the way down that has the centre of mass lowest."""
    vertices, faces = triangles(solid)
    centre = _centre(vertices, faces)
    corners = vertices[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(across, axis=1) / 2
    normals = across / np.maximum(2 * area, 1e-12)[:, None]
    best: tuple | None = None
    ways = _ways_down(vertices)
    for tried, down in enumerate(ways):
        if tried >= TRIED and best is not None:
            break
        heights = vertices @ -down
        low = float(heights.min())
        ground = heights[faces].max(1) < low + FLAT
        if not _stands(vertices[heights < low + FLAT], down, centre):
            continue
        contact, overhang = _shares(area, ground, normals, down)
        rank = (-round(contact, -1), round(overhang, 0), round(float(np.ptp(heights)), 1))
        if best is None or rank < best[0]:
            best = (rank, down, contact, overhang)
    if best is None:
        down = min(ways, key=lambda way: float(centre @ -way - (vertices @ -way).min()))
        heights = vertices @ -down
        ground = heights[faces].max(1) < float(heights.min()) + FLAT
        contact, overhang = _shares(area, ground, normals, down)
    else:
        _, down, contact, overhang = best
    turn = np.eye(4)
    turn[:3, :3] = _to_ground(down)
    corner = box_of(turned(solid, turn))[0]
    turn[:3, 3] = -corner
    return Lying(turn, contact, overhang)


def _shares(
    area: np.ndarray, ground: np.ndarray, normals: np.ndarray, down: np.ndarray
) -> tuple[float, float]:
    """mm^2 on the ground, and mm^2 that hang over."""
    hanging = ~ground & (normals @ down > STEEP)
    return float(area[ground].sum()), float(area[hanging].sum())


def _ways_down(vertices: np.ndarray) -> list[np.ndarray]:
    """Normals of the hull's faces, the largest faces first, the ground's own among equals."""
    hull = ConvexHull(vertices)
    corners = vertices[hull.simplices]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(across, axis=1) / 2
    keys = np.round(hull.equations[:, :3], 3) + 0.0
    ways, inverse = np.unique(keys, axis=0, return_inverse=True)
    sums = np.bincount(inverse.ravel(), area)
    order = sorted(range(len(ways)), key=lambda k: (-round(sums[k]), ways[k][2], tuple(ways[k])))
    return [ways[k] / np.linalg.norm(ways[k]) for k in order]


def _stands(feet: np.ndarray, down: np.ndarray, centre: np.ndarray) -> bool:
    """Whether the centre of mass lies above the hull of the points on the ground."""
    frame = _to_ground(down)[:2]
    try:
        hull = ConvexHull(feet @ frame.T)
    except QhullError:  # a line or a point
        return False
    return bool((hull.equations[:, :2] @ (frame @ centre) + hull.equations[:, 2] <= -1e-6).all())


def _to_ground(down: np.ndarray) -> np.ndarray:
    """[3, 3] turn that takes ``down`` to -z, about as little as it can."""
    x = np.eye(3)[0] if abs(down[0]) < 0.9 else np.eye(3)[1]
    x = x - (x @ down) * down
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(-down, x), -down])


def _centre(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Centre of mass."""
    corners = vertices[faces]
    volumes = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    return (corners.sum(1) / 4 * volumes[:, None]).sum(0) / volumes.sum()


def on_plate(sizes: Sequence[np.ndarray]) -> list[np.ndarray]:
    """[2] corners for rectangles [2], in rows that fill about a square, ``SPACE`` apart."""
    order = sorted(range(len(sizes)), key=lambda k: (-sizes[k][1], -sizes[k][0], k))
    total = sum(float((s[0] + SPACE) * (s[1] + SPACE)) for s in sizes)
    width = max(1.2 * np.sqrt(total), max(float(s[0]) for s in sizes))
    places: list[np.ndarray] = [np.zeros(2)] * len(sizes)
    x = y = row = 0.0
    for k in order:
        if x > 0 and x + sizes[k][0] > width:
            x, y, row = 0.0, y + row + SPACE, 0.0
        places[k] = np.array([x, y])
        x += float(sizes[k][0]) + SPACE
        row = max(row, float(sizes[k][1]))
    return places

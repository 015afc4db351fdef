"""How well convex shapes stand for a solid: what they hold too much and too little."""

from __future__ import annotations

from collections.abc import Sequence

import igl
import numpy as np
import trimesh
from manifold3d import Manifold

from uniart_jax.export.box_cover import own_frame
from uniart_jax.export.convex_split import faces_of, triangles
from uniart_jax.export.physics import Shape
from uniart_jax.export.separation import as_solid

POINTS = 8192  # at which an error is measured


def volume_error(
    mesh: trimesh.Trimesh, shapes: Sequence[Shape], finer: Sequence[Shape] | None = None
) -> float:
    """What shapes hold too much and too little of a solid, as a share of the volume of the solid's
    convex hull.

    Measured at 8,192 points of a Halton sequence in the box of both. 0 for a solid without a
    volume.

    Args:
      finer: shapes that tell where the solid is, instead of its surface: an open one counts as
        full up to its rim, so a cupboard without a front would be best kept by one block. The hull
        is of both, since the surface may be flat, and the box along its own axes.
    """
    solids = [as_solid(shape) for shape in shapes]
    vertices = np.ascontiguousarray(mesh.vertices, np.float64)
    faces = np.ascontiguousarray(mesh.faces, np.int64)
    given = [as_solid(shape) for shape in finer or ()]
    hull = Manifold.hull_points(np.concatenate([vertices, *(triangles(s)[0] for s in given)]))
    if hull.volume() <= 0:
        return 0.0
    # few points would meet a plate that lies askew in its box
    frame = own_frame(*triangles(hull)) if given else np.eye(3)
    corners = [triangles(solid)[0] for solid in [*solids, *given]]
    local = np.concatenate([*corners, *([] if given else [mesh.bounds])]) @ frame
    lo, hi = local.min(0), local.max(0)
    points = (lo + _halton(POINTS) * (hi - lo)) @ frame.T
    if given:
        full = _within([half_spaces(solid) for solid in given], points)
    else:
        winding = igl.fast_winding_number(vertices, faces, np.ascontiguousarray(points))
        full = np.abs(np.asarray(winding).ravel()) > 0.5
    wrong = full != _within([half_spaces(solid) for solid in solids], points)
    return float(wrong.mean() * np.prod(hi - lo) / hull.volume())


def is_open(mesh: trimesh.Trimesh) -> bool:
    """Whether a surface has a rim, an edge of an odd number of faces, or holds no room; places made
    one. Repeated faces count once, and two back to back, as between two blocks, for none."""
    places, same = np.unique(np.asarray(mesh.vertices), axis=0, return_inverse=True)
    faces = same.reshape(-1)[np.asarray(mesh.faces)]
    turned = 2 * (faces < np.roll(faces, -1, axis=1)).sum(1) - 3  # 1 or -1
    faces, group = np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True)
    faces = faces[np.bincount(group.reshape(-1), turned) != 0]
    if not len(faces):
        return True
    ends = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    ends = ends[ends[:, 0] != ends[:, 1]]
    _, counts = np.unique(ends[:, 0] * len(places) + ends[:, 1], return_counts=True)
    return bool((counts % 2).any())


def _within(solids: Sequence[tuple[np.ndarray, np.ndarray]], points: np.ndarray) -> np.ndarray:
    """[n] whether points lie in any of the ``half_spaces``."""
    held = np.zeros(len(points), bool)
    for normals, offsets in solids:
        held |= (points @ normals.T <= offsets).all(1)
    return held


def _halton(count: int) -> np.ndarray:
    """[count, 3] in [0, 1)."""
    index = np.arange(1, count + 1)
    columns = []
    for base in (2, 3, 5):
        left, share, value = index.copy(), 1.0 / base, np.zeros(count)
        while left.any():
            value += share * (left % base)
            left //= base
            share /= base
        columns.append(value)
    return np.stack(columns, 1)


def half_spaces(solid: Manifold) -> tuple[np.ndarray, np.ndarray]:
    """([n, 3] unit normals, [n] offsets) of a convex solid: a point p is inside where normals @ p
    <= offsets."""
    corners, normals = faces_of(*triangles(solid))
    length = np.linalg.norm(normals, axis=1)
    kept = length > 1e-12 * max(length.max(initial=0.0), 1e-300)
    normals = normals[kept] / length[kept, None]
    return normals, (normals * corners[kept, 0]).sum(1)


def corners_of(solid: Manifold) -> np.ndarray:
    """[2, 3] of the box of a solid."""
    return np.reshape(solid.bounding_box(), (2, 3))

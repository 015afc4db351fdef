"""Boxes: the frame that a solid is built in, the box that it is, and the boxes that walls are."""

from __future__ import annotations

import itertools

import igl
import numpy as np
from manifold3d import Manifold

from uniart_jax.export.box_growth import Layers, grow
from uniart_jax.export.convex_split import Surface, triangles

BOX_BUDGET = 64  # boxes a solid; more means that it is not built of boxes
MAX_PLANES = 32  # along an axis; likewise
RECTANGLE = 1.15  # times a flat outline's area, up to which its box stands for it
FLAT_COSINE = 0.999  # a face lies in the frame above this
FLAT_SHARE = 0.95  # of the area of a solid built of boxes
NEAR_COSINE = 0.98  # normals that are averaged into an axis
SNAP_COSINE = 1 - 6e-6  # .2 degrees: an axis of the object
PLANE_AREA = 0.0005  # share of the area that makes a wall
CORNERS = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))


def own_frame(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """[3, 3] whose columns are the axes that most of a surface's area faces: a right-handed frame,
    the object's own where it fits."""
    normals, areas = _normals(vertices, faces)
    first = _common(normals, areas)
    side = np.abs(normals @ first) < 0.02
    if side.any() and areas[side].sum() > 1e-6 * areas.sum():
        second = _common(normals[side], areas[side])
    else:  # nothing but the two ends is flat
        second = np.eye(3)[np.abs(first).argmin()]
    second = second - (second @ first) * first
    second /= np.linalg.norm(second)
    axes = np.stack([first, second, np.cross(first, second)])
    order = [
        int(np.abs(axes[:, 0]).argmax())
    ]  # in the order of the object's axes they lie nearest to
    rest = [i for i in range(3) if i != order[0]]
    order += rest if abs(axes[rest[0], 1]) >= abs(axes[rest[1], 1]) else rest[::-1]
    frame = axes[order].T
    frame = frame * np.where(np.diag(frame) < 0, -1.0, 1.0)
    if np.linalg.det(frame) < 0:
        frame[:, 2] = -frame[:, 2]
    return frame


def fitted_box(points: np.ndarray, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(center [3], size [3]) of the points' box along the axes of ``frame``."""
    local = points @ frame
    lo, hi = local.min(0), local.max(0)
    return frame @ ((lo + hi) / 2), hi - lo


def box_solid(center: np.ndarray, size: np.ndarray, frame: np.ndarray) -> Manifold:
    matrix = np.column_stack([frame, center])
    return Manifold.cube(tuple(size), True).transform(matrix)


def as_box(solid: Manifold, slack: float) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """(center, size, frame) of the box that a convex solid is, to within ``slack``; None if it is
    not one."""
    vertices, faces = triangles(solid)
    frame = own_frame(vertices, faces)
    center, size = fitted_box(vertices, frame)
    corners = np.ascontiguousarray(CORNERS * size @ frame.T + center)
    squared = igl.point_mesh_squared_distance(corners, vertices, faces)[0]
    return (center, size, frame) if np.max(squared) <= slack**2 else None


def box_cover(surface: Surface) -> list[Manifold]:
    """Boxes that together are a surface's solid, to within its tolerance; [] if it is not built of
    boxes.

    The grid's planes are the solid's own, at the heights where its area lies; boxes grow in it from
    the largest cell that is not covered yet, over what others cover too, so that crossing bars are
    a box each.
    """
    vertices, faces, tolerance = surface.vertices, surface.faces, surface.tolerance
    frame = own_frame(vertices, faces)
    normals, areas = _normals(vertices @ frame, faces)
    flat = np.abs(normals).max(1) > FLAT_COSINE
    if areas[flat].sum() < FLAT_SHARE * areas.sum():
        return []
    local = vertices @ frame
    edges = [_planes(local, faces, normals, areas, axis, tolerance) for axis in range(3)]
    if max(len(e) for e in edges) > MAX_PLANES:
        return []
    centers = [(e[1:] + e[:-1]) / 2 for e in edges]
    points = np.stack(np.meshgrid(*centers, indexing="ij"), -1).reshape(-1, 3)
    winding = igl.fast_winding_number(local, faces, np.ascontiguousarray(points))
    shape = [len(c) for c in centers]
    full = (np.abs(np.asarray(winding)) > 0.5).reshape(shape)
    sizes = [np.diff(e) for e in edges]
    volume = sizes[0][:, None, None] * sizes[1][None, :, None] * sizes[2][None, None, :]
    layers, left = Layers(full, full), full.copy()
    boxes: list[tuple[np.ndarray, np.ndarray]] = []
    while left.any():
        if len(boxes) == BOX_BUDGET:
            return []
        seed = np.argwhere(left)[volume[left].argmax()]
        grown = [grow(layers, seed, order) for order in itertools.permutations(range(3))]
        cells = max(grown, key=lambda g: float((volume[g] * left[g]).sum()))
        left[cells] = False
        lo = np.array([edges[a][cells[a].start] for a in range(3)])
        hi = np.array([edges[a][cells[a].stop] for a in range(3)])
        boxes.append((lo, hi))
    solids = [box_solid(frame @ ((lo + hi) / 2), hi - lo, frame) for lo, hi in boxes]
    seen = np.concatenate([local, local[faces].mean(1)])
    away = [np.maximum(lo - seen, seen - hi).max(1) for lo, hi in boxes]
    if not boxes or np.min(away, axis=0).max() > tolerance:
        return []
    return [] if any(surface.exceeded(s) for s in solids) else solids


def flat_box(points: np.ndarray, faces: np.ndarray, thin: float) -> Manifold:
    """The box of a flat surface, or of less than that, made at least ``thin`` thick."""
    _, areas = _normals(points, faces)
    frame = own_frame(points, faces) if areas.sum() > 1e-3 * thin**2 else _line_frame(points)
    center, size = fitted_box(points, frame)
    return box_solid(center, np.maximum(size, thin), frame)


def flat_plate(hull: Manifold, thin: float) -> Manifold:
    """A convex solid thinner than ``thin`` made so thick: a box where it is about a rectangle, else
    of its own outline (a disc stays round)."""
    points, faces = triangles(hull)
    box = flat_box(points, faces, thin)
    normals, areas = _normals(points, faces)
    if not (areas > 0).any():
        return box
    normals = normals[areas > 0]
    spans = np.ptp(normals @ points.T, axis=1)
    normal = normals[int(spans.argmin())]
    along = points @ normal
    flat = points - (along - (along.min() + along.max()) / 2)[:, None] * normal
    plate = Manifold.hull_points(np.concatenate([flat + s * thin / 2 * normal for s in (-1, 1)]))
    return box if plate.is_empty() or box.volume() <= RECTANGLE * plate.volume() else plate


def _line_frame(points: np.ndarray) -> np.ndarray:
    """A frame whose first axis lies along points on a line."""
    frame = np.linalg.svd(points - points.mean(0))[2].T
    return frame if np.linalg.det(frame) > 0 else -frame


def _normals(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1)
    return normals / np.maximum(area, 1e-300)[:, None], area / 2


def _common(normals: np.ndarray, areas: np.ndarray) -> np.ndarray:
    """The direction, either sign, that most area faces."""
    largest = np.argsort(-areas, kind="stable")[:64]
    tried = np.concatenate([np.eye(3), normals[largest]])
    met = (np.abs(tried @ normals.T) > FLAT_COSINE) @ areas
    axis = tried[int(np.argmax(np.round(met / areas.sum(), 6)))]
    for _ in range(2):
        along = normals @ axis
        near = np.abs(along) > NEAR_COSINE
        if near.any():
            axis = (normals[near] * (areas[near] * np.sign(along[near]))[:, None]).sum(0)
            axis /= np.linalg.norm(axis)
    nearest = int(np.abs(axis).argmax())
    return np.eye(3)[nearest] if abs(axis[nearest]) > SNAP_COSINE else axis


def _planes(
    vertices: np.ndarray,
    faces: np.ndarray,
    normals: np.ndarray,
    areas: np.ndarray,
    axis: int,
    gap: float,
) -> np.ndarray:
    """[n] heights along ``axis`` at which the surface has walls, ascending, both ends of its box
    included."""
    lo, hi = float(vertices[:, axis].min()), float(vertices[:, axis].max())
    gap = min(gap, (hi - lo) / 8)
    facing = np.abs(normals[:, axis]) > FLAT_COSINE
    where, area = vertices[faces[facing]].mean(1)[:, axis], areas[facing]
    order = np.argsort(where, kind="stable")
    where, area = where[order], area[order]
    groups = np.split(np.arange(len(where)), np.flatnonzero(np.diff(where) > gap / 4) + 1)
    least = PLANE_AREA * float(areas.sum())
    inner = [float(np.average(where[g], weights=area[g])) for g in groups if area[g].sum() > least]
    return np.array([lo, *(x for x in inner if lo + gap / 4 < x < hi - gap / 4), hi])

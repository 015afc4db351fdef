"""Which grid cells triangles touch, and how much of a triangle lies in a cell. Vectorised over
(triangle, cell) pairs.

Lengths are in cells: cell (i, j, k) spans [i, i + 1] along x, and so on.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

# cells: cells are closed, and float noise must not decide whether a face on a cell's side touches
# it
TOLERANCE = 1e-6
PAIRS_AT_ONCE = 1 << 19  # bounds the memory


def cells_in_ranges(
    low: np.ndarray, high: np.ndarray, limit: int = PAIRS_AT_ONCE
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """All cells of many index ranges, a bounded number at a time.

    Args:
      low, high: [n, d] int, first and last cell of each range (an empty range has high < low).
      limit: pairs a chunk; a single range larger than that is a chunk of its own.

    Yields:
      (items [m], cells [m, d]): the range each cell belongs to, in order.
    """
    shape = np.maximum(high - low + 1, 0)
    counts = shape.prod(1)
    ends = np.cumsum(counts)
    first = 0
    while first < len(counts):
        begin = ends[first] - counts[first]
        last = max(int(np.searchsorted(ends, begin + limit, "right")), first + 1)
        mine = counts[first:last]
        items = np.repeat(np.arange(first, last), mine)
        rest = np.arange(len(items)) - np.repeat(np.cumsum(mine) - mine, mine)
        cells = np.empty((len(items), low.shape[1]), np.int64)
        for axis in range(low.shape[1] - 1, 0, -1):
            size = shape[items, axis]
            quotient = rest // size
            cells[:, axis] = low[items, axis] + rest - quotient * size
            rest = quotient
        cells[:, 0] = low[items, 0] + rest
        if len(items):
            yield items, cells
        first = last


def touched_cells(triangles: np.ndarray, resolution: int) -> tuple[np.ndarray, np.ndarray]:
    """Every (triangle, cell) pair that overlaps, exactly: triangles and cells are closed sets
    (within ``TOLERANCE``).

    Separating axes: the 3 of the cell (by the ranges), the triangle's normal, and the 9 crosses as
    edge functions of the three projections (Schwarz and Seidel 2010, section 3.1). Degenerate
    triangles are segments or points.

    Args:
      triangles: [F, 3, 3] corners.
      resolution: cells a side.

    Returns:
      (faces [P], cells [P, 3] int64) sorted by face.
    """
    low = np.clip(np.floor(triangles.min(1) - TOLERANCE).astype(np.int64), 0, resolution - 1)
    high = np.clip(np.floor(triangles.max(1) + TOLERANCE).astype(np.int64), 0, resolution - 1)
    edges = np.roll(triangles, -1, axis=1) - triangles
    normal = np.cross(edges[:, 0], edges[:, 1])
    slack = TOLERANCE * np.abs(normal).sum(1)
    base = np.einsum("fc,fc->f", normal, triangles[:, 0])
    upper = (
        np.maximum(normal, 0).sum(1) - base + slack
    )  # of normal . corner over the cell's corners
    lower = np.minimum(normal, 0).sum(1) - base - slack
    sides = [_edge_functions(triangles, edges, normal, a) for a in range(3)]
    found = []
    for face, cell in cells_in_ranges(low, high):
        height = np.einsum("pc,pc->p", normal[face], cell)
        keep = (height + upper[face] >= 0) & (height + lower[face] <= 0)
        face, cell = face[keep], cell[keep]
        for axis in range(3):
            x, y = cell[:, (axis + 1) % 3, None], cell[:, (axis + 2) % 3, None]
            nx, ny, offset = (s[face] for s in sides[axis])
            keep = (nx * x + ny * y + offset >= 0).all(1)
            face, cell = face[keep], cell[keep]
        found.append((face, cell))
    return np.concatenate([f for f, _ in found]), np.concatenate([c for _, c in found])


def _edge_functions(triangles, edges, normal, axis: int):
    """(nx, ny, offset), [F, 3] each: a cell is on the inner side of edge e, seen along ``axis``,
    iff nx x + ny y + offset >= 0."""
    a, b = (axis + 1) % 3, (axis + 2) % 3
    sign = np.where(normal[:, axis, None] >= 0, 1.0, -1.0)
    nx, ny = -edges[:, :, b] * sign, edges[:, :, a] * sign
    offset = np.maximum(nx, 0) + np.maximum(ny, 0) + TOLERANCE * (np.abs(nx) + np.abs(ny))
    return nx, ny, offset - nx * triangles[:, :, a] - ny * triangles[:, :, b]


def clipped_areas(triangles: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """[P] area of each triangle [P, 3, 3] inside its own cell [P, 3]: Sutherland-Hodgman on all
    pairs at once."""
    polygon = triangles - cells[:, None]
    for axis in range(3):
        polygon = _cut(polygon, polygon[..., axis])
        polygon = _cut(polygon, 1 - polygon[..., axis])
    spokes = polygon[:, 1:] - polygon[:, :1]
    return np.linalg.norm(np.cross(spokes[:, :-1], spokes[:, 1:]).sum(1), axis=-1) / 2


def _cut(polygon: np.ndarray, height: np.ndarray) -> np.ndarray:
    """[P, n + 1, 3] convex polygons [P, n, 3] cut to where ``height`` [P, n] >= 0; short ones
    repeat a corner, empty ones are 0."""
    inside = height >= 0
    if inside.all():
        return polygon
    inside_next = np.roll(inside, -1, 1)
    # Each edge yields its crossing, if it has one, and then its end, if that is inside.
    row, edge = np.nonzero(inside | inside_next)
    end = (edge + 1) % polygon.shape[1]
    start_height, end_height = height[row, edge], height[row, end]
    crosses, keeps = inside[row, edge] != inside[row, end], inside[row, end]
    gap = np.where(crosses, start_height - end_height, 1)
    begin, stop = polygon[row, edge], polygon[row, end]
    cut = begin + (start_height / gap)[:, None] * (stop - begin)
    emitted = np.stack([crosses, keeps], 1)
    owner = np.repeat(row, 2)[emitted.ravel()]
    points = np.stack([cut, stop], 1)[emitted]
    count = np.bincount(owner, minlength=len(polygon))
    first = np.cumsum(count) - count
    slot = np.arange(len(owner)) - first[owner]
    out = np.zeros((len(polygon), polygon.shape[1] + 1, 3))
    filled = np.flatnonzero(count)
    out[filled] = points[first[filled], None]
    out[owner, slot] = points
    return out

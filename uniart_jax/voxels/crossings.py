"""Winding numbers by counting: how often a line from below crosses a surface before it reaches a
point, each crossing by its sign.

For triangles that bound an oriented volume (every directed edge is met by its opposite) this is the
winding number, an integer, exactly. A surface that is open is closed by a ``lid`` on each of its
borders. The two winding numbers add up, so that of the surface is

    w(surface) = w(surface and lid) - w(lid)                                                      (1)

of which the first is counted and the second a sum over a few triangles, fewer than the surface has
border edges (Jacobson et al. 2013, section 4.2, close the boxes of a hierarchy in the same way).

Lines are moved by ``NUDGE``, so that they miss the edges and corners of axis-aligned models;
whoever adds (1) must ask both at the moved point.
"""  # noqa: E501

from __future__ import annotations

import numpy as np

from uniart_jax.voxels.overlap import cells_in_ranges

NUDGE = np.array([1.3e-6, 0.7e-6, 1.1e-6])  # of a cell of the lattice
BINS = 512  # a side, at most, of the square that points are sorted into


def lid(vertices: np.ndarray, faces: np.ndarray, names: np.ndarray) -> np.ndarray:
    """[L, 3, 3] triangles that close a surface, two fewer than each border has edges; none if the
    surface bounds a volume.

    Args:
      vertices: [n, 3] and faces: [F, 3], the surface.
      names: [n], equal where two vertices are one.
    """
    edges = names[faces][:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    edges = edges[edges[:, 0] != edges[:, 1]]
    forward = edges[:, 0] < edges[:, 1]
    count = int(names.max()) + 1
    key = edges.min(1).astype(np.int64) * count + edges.max(1)
    unique, index = np.unique(key, return_inverse=True)
    surplus = np.rint(np.bincount(index, np.where(forward, 1.0, -1.0))).astype(np.int64)
    low, high = np.divmod(np.repeat(unique, np.abs(surplus)), count)
    along = np.repeat(surplus > 0, np.abs(surplus))
    # the lid goes against the surface's direction along each edge
    borders = _loops(np.where(along, high, low), np.where(along, low, high))
    place = np.zeros((count, 3))
    place[names] = vertices
    pieces = [np.zeros((0, 3, 3))]
    for border in borders:
        ring = place[border]
        while (
            len(ring) > 2
        ):  # every other corner is cut off: most triangles are as small as the border's edges
            cut = np.arange(0, len(ring) - 1, 2)
            pieces.append(np.stack([ring[cut], ring[cut + 1], ring[(cut + 2) % len(ring)]], 1))
            ring = ring[::2]
    return np.concatenate(pieces)


def _loops(begin: np.ndarray, end: np.ndarray) -> list[list[int]]:
    """Directed edges as simple loops; as many must leave each vertex as arrive."""
    leaving: dict[int, list[int]] = {}
    for u, v in zip(begin.tolist(), end.tolist(), strict=True):
        leaving.setdefault(u, []).append(v)
    loops = []
    for start in leaving:
        path, position = [start], {start: 0}
        while leaving[path[-1]]:
            vertex = leaving[path[-1]].pop()
            if vertex not in position:
                position[vertex] = len(path)
                path.append(vertex)
                continue
            back = position[vertex]
            loops.append(path[back:])
            for passed in path[back + 1 :]:
                del position[passed]
            del path[back + 1 :]
    return loops


def lattice_windings(
    triangles: np.ndarray, low: np.ndarray, shape: np.ndarray, cells: int
) -> np.ndarray:
    """[shape] int16 on a block of the lattice of cell centres: crossings below each point of a
    column, summed up.

    Args:
      triangles: [F, 3, 3] in the cube [-1/2, 1/2]^3, that bound an oriented volume.
      low, shape: [3] the block's first cell and size.
      cells: a side of the cube.
    """
    corner = (triangles + 0.5) * cells - 0.5 - low  # lattice points are integers
    first = np.ceil(corner.min(1) - 1e-4).astype(np.int64).clip(0)
    last = np.minimum(np.floor(corner.max(1) + 1e-4).astype(np.int64), shape - 1)
    up, a, b = _axes(first, last)
    planes = _Planes((corner - NUDGE)[:, :, [a, b, up]])
    steps = np.zeros((shape[a], shape[b], shape[up] + 1), np.int16)
    flat = steps.reshape(-1)
    first, last = first[planes.faces][:, [a, b]], last[planes.faces][:, [a, b]]
    for face, column in cells_in_ranges(first, last):
        x, y = column[:, 0], column[:, 1]
        hit, height = planes.heights(face, x, y)
        level = np.ceil(height[hit]).astype(np.int64).clip(0, shape[up])
        index = (x[hit] * shape[b] + y[hit]) * (shape[up] + 1) + level
        np.add.at(flat, index, planes.sign[face[hit]])
    winding = np.cumsum(steps[..., :-1], axis=-1, dtype=np.int16)
    return np.moveaxis(winding, (0, 1, 2), (a, b, up))


def windings(triangles: np.ndarray, points: np.ndarray, nudge: np.ndarray) -> np.ndarray:
    """[n] int winding numbers of triangles [F, 3, 3] that bound an oriented volume, at any points
    [n, 3], moved by ``nudge`` [3]."""
    count = np.zeros(len(points), np.int64)
    if not len(points):
        return count
    points = points + nudge
    low, high = points.min(0), points.max(0)
    bins = int(np.clip(len(points) ** 0.5, 1, BINS))
    size = np.maximum(high - low, 1e-9) / bins * (1 + 1e-9)
    first = np.floor((triangles.min(1) - low) / size - 1e-6).clip(0, bins).astype(np.int64)
    last = np.floor((triangles.max(1) - low) / size + 1e-6).clip(-1, bins - 1).astype(np.int64)
    up, a, b = _axes(first, last)
    planes = _Planes(triangles[:, :, [a, b, up]])
    bin_of = np.floor((points[:, [a, b]] - low[[a, b]]) / size[[a, b]]).astype(np.int64)
    bin_of = bin_of[:, 0] * bins + bin_of[:, 1]
    order = np.argsort(bin_of, kind="stable")
    x, y, z = points[order][:, [a, b, up]].T
    start = np.searchsorted(bin_of[order], np.arange(bins**2 + 1))
    first, last = first[planes.faces][:, [a, b]], last[planes.faces][:, [a, b]]
    for faces, column in cells_in_ranges(first, last):
        square = column[:, 0] * bins + column[:, 1]
        begin, end = start[square, None], start[square + 1, None] - 1
        for item, row in cells_in_ranges(begin, end):
            face, row = faces[item], row[:, 0]
            hit, height = planes.heights(face, x[row], y[row])
            hit &= height < z[row]
            np.add.at(count, order[row[hit]], planes.sign[face[hit]])
    return count


def _axes(first: np.ndarray, last: np.ndarray) -> tuple[int, int, int]:
    """(up, a, b): the axis along which the triangles cover the fewest columns, and the two
    others."""
    extent = np.maximum(last - first + 1, 0).astype(np.float64)
    work = [(extent[:, (k + 1) % 3] * extent[:, (k + 2) % 3]).sum() for k in range(3)]
    up = int(np.argmin(work))
    return up, (up + 1) % 3, (up + 2) % 3


class _Planes:
    """Triangles over (x, y) that are not upright.

    Attributes:
      faces: which ones of all they are; what is asked and told below counts in them.
      sign: -1 where a line from below leaves, 1 where it enters.
    """

    def __init__(self, corner: np.ndarray):
        side = np.roll(corner, -1, 1) - corner  # edge e from corner e to e + 1
        double_area = side[:, 0, 0] * side[:, 1, 1] - side[:, 0, 1] * side[:, 1, 0]
        self.faces = np.flatnonzero(double_area)
        corner, area = corner[self.faces], double_area[self.faces]
        side = side[self.faces] / area[:, None, None]
        self.sign = np.where(area > 0, -1, 1).astype(np.int16)
        # Edge e's weight belongs to the corner opposite to it; heights are linear in the weights,
        # hence in the column.
        self.across, self.along = side[..., 1], side[..., 0]
        self.constant = self.across * corner[..., 0] - self.along * corner[..., 1]
        self.height = np.roll(corner[..., 2], -2, 1)

    def heights(self, face: np.ndarray, x: np.ndarray, y: np.ndarray):
        """(whether the line at (x, y) meets the face, at which height) [m]."""
        height, hit = np.zeros(len(face)), np.ones(len(face), bool)
        for e in range(3):
            weight = self.along[face, e] * y - self.across[face, e] * x + self.constant[face, e]
            hit &= weight > 0
            height += weight * self.height[face, e]
        return hit, height

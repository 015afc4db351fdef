"""Nearest triangle of every sub-cell of the active voxels: branch and bound over blocks of
sub-cells, in numpy.

A triangle can be the nearest of some point within rho of a block's centre m only if its own
distance from m is within 2 rho of the smallest one. So candidates are kept per voxel, then per half
voxel (..), and only those few are measured at the sub-cells: 1 to 4 for objects of flat parts,
several times faster than asking a box tree half a million times. Meshes so fine that listing
candidates costs more than the tree go to ``igl.AABB``.

Distances are float32 with ties won by the lowest face, so that noise does not speckle shared
borders.
"""

from __future__ import annotations

import igl
import numpy as np

from uniart_jax.voxels.overlap import cells_in_ranges

# (triangle, cell) pairs to list per voxel; beyond, they are too many to hold (at 373 still faster
# than the box tree)
MAX_LISTED = 512
VALUES_AT_ONCE = 1 << 14  # distances measured in one go: what stays in the first-level cache
TIE = 1e-5  # squared distances this close, relative or absolute, are ties
TIE_FLOOR = 1e-13


class Triangles:
    """Triangles in frames of their own: A = (0, 0), B = (b, 0) along the longest side, C = (cx,
    cy)."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray):
        corner = vertices[faces]
        side = np.linalg.norm(np.roll(corner, -1, 1) - corner, axis=2)
        self.roll = np.argmax(side, axis=1)
        order = (self.roll[:, None] + np.arange(3)) % 3
        corner = np.take_along_axis(corner, order[..., None], 1)
        base, rest = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
        b = np.linalg.norm(base, axis=1)
        x = np.where(b[:, None] > 0, base / np.maximum(b, 1e-30)[:, None], [1.0, 0, 0])
        cx = (rest * x).sum(1)
        up = rest - cx[:, None] * x
        cy = np.linalg.norm(up, axis=1)
        needle = cy <= 1e-8 * b  # a segment or a point: any frame about it
        cy[needle] = 0
        least = np.eye(3)[np.argmin(np.abs(x), axis=1)]
        up = np.where(needle[:, None], least - (least * x).sum(1, keepdims=True) * x, up)
        y = up / np.linalg.norm(up, axis=1, keepdims=True)
        frame = np.stack([x, y, np.cross(x, y)], 1)
        origin = np.einsum("fac,fc->fa", frame, corner[:, 0])
        squares = np.stack([(b - cx) ** 2 + cy**2, cx**2 + cy**2], 1)
        inverse = np.where(squares > 0, 1 / np.maximum(squares, 1e-30), 0)
        self.frame = frame.astype(np.float32)
        self.origin = origin.astype(np.float32)
        self.shape = np.ascontiguousarray(
            np.stack([b, cx, cy, inverse[:, 0], inverse[:, 1]]).astype(np.float32)
        )

    def __len__(self) -> int:
        return len(self.frame)

    def squared_distance(self, faces: np.ndarray, centers: np.ndarray, offsets: np.ndarray):
        """[P, C] float32 squared distances of triangle p from the points centers[p] +
        offsets[c]."""
        out = np.empty((len(faces), len(offsets)), np.float32)
        step = max(1, VALUES_AT_ONCE // len(offsets))
        for begin in range(0, len(faces), step):
            part = slice(begin, begin + step)
            x, y, z = self._local(faces[part], centers[part], offsets)
            out[part] = self._planar(faces[part], x, y) + z * z
        return out

    def barycentric(self, faces: np.ndarray, points: np.ndarray) -> np.ndarray:
        """[n, 3] float32 weights of each face's corners at its point nearest to ``points`` [n,
        3]."""
        out = np.empty((len(faces), 3), np.float32)
        for begin in range(0, len(faces), VALUES_AT_ONCE):
            part = slice(begin, begin + VALUES_AT_ONCE)
            face = faces[part]
            x, y, _ = self._local(face, points[part], np.zeros((1, 3), np.float32))
            x, y = self._nearest(face, x, y)
            b, cx, cy = (s[face] for s in self.shape[:3])
            third = np.where(cy > 0, y[:, 0] / np.maximum(cy, 1e-30), 0)
            second = np.where(b > 0, (x[:, 0] - third * cx) / np.maximum(b, 1e-30), 0)
            weight = np.clip(np.stack([1 - second - third, second, third], -1), 0, 1)
            order = (np.arange(3) - self.roll[face, None]) % 3
            out[part] = np.take_along_axis(weight, order, 1)
        return out

    def _local(self, faces, centers, offsets):
        frame = self.frame[faces]
        x, y, z = centers.T[:, :, None]
        middle = frame[:, :, 0] * x + frame[:, :, 1] * y + frame[:, :, 2] * z - self.origin[faces]
        if len(offsets) == 1:
            middle += frame @ offsets[0]
            return middle[:, 0:1], middle[:, 1:2], middle[:, 2:3]
        local = (frame.reshape(-1, 3) @ offsets.T).reshape(len(faces), 3, -1)
        local += middle[..., None]
        return local[:, 0], local[:, 1], local[:, 2]

    def _planar(self, faces, x, y):
        """Squared distance from the triangle within its plane."""
        inside, (ab, bc, ac), _, _ = self._sides(faces, x, y)
        squared = np.minimum(np.minimum(ab, bc), ac)
        squared[inside] = 0
        return squared

    def _nearest(self, faces, x, y):
        """The triangle's nearest point within its plane."""
        b, cx, cy = (s[faces][:, None] for s in self.shape[:3])
        inside, (ab, bc, ac), s, t = self._sides(faces, x, y)
        choice = [inside, (ab <= bc) & (ab <= ac), bc <= ac]
        qx = np.select(choice, [x, np.clip(x, 0, b), b + s * (cx - b)], t * cx)
        qy = np.select(choice, [y, np.zeros_like(y), s * cy], t * cy)
        return qx, qy

    def _sides(self, faces, x, y):
        """(inside, squared distances from the sides AB, BC, AC, share of the way along BC, along
        AC) of points in the plane."""
        b, cx, cy, inverse_bc, inverse_ac = (s[faces][:, None] for s in self.shape)
        zero, one = np.float32(0), np.float32(1)
        dx = x - np.minimum(np.maximum(x, zero), b)
        ab = dx * dx + y * y
        ux, px = cx - b, x - b
        s = np.minimum(np.maximum((px * ux + y * cy) * inverse_bc, zero), one)
        dx, dy = px - s * ux, y - s * cy
        bc = dx * dx + dy * dy
        t = np.minimum(np.maximum((x * cx + y * cy) * inverse_ac, zero), one)
        dx, dy = x - t * cx, y - t * cy
        ac = dx * dx + dy * dy
        inside = (y > zero) & (ux * y > cy * px) & (x * cy > y * cx)
        return inside, (ab, bc, ac), s, t


def nearest_faces(
    vertices: np.ndarray,
    faces: np.ndarray,
    triangles: Triangles,
    coords: np.ndarray,
    resolution: int,
    subdivisions: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Nearest triangle of every sub-cell centre of voxels that some triangle touches.

    Args:
      vertices, faces: the surface, object units.
      triangles: the same faces.
      coords: [V, 3] active voxels; each must be touched.

    Returns:
      (distance [V, r^3] float32 in object units, face [V, r^3] int32).
    """
    sides = _factors(subdivisions)
    # Everything below in object units; rho: from a voxel's centre to its farthest sub-cell centre.
    voxel = 1 / resolution
    rho = 3**0.5 / 2 * voxel * (subdivisions - 1) / subdivisions
    center = ((coords + 0.5) * voxel - 0.5).astype(np.float32)
    pairs = _voxel_candidates(vertices, faces, triangles, coords, center, resolution, rho)
    if pairs is None:
        return _by_tree(vertices, faces, coords, resolution, subdivisions)
    block, face = pairs
    size = voxel
    for level, side in enumerate(sides):
        size /= side
        axis = ((np.arange(side) + 0.5) - side / 2) * size
        offsets = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
        offsets = offsets.astype(np.float32)
        squared = triangles.squared_distance(face, center[block], offsets)
        starts = np.flatnonzero(np.diff(block, prepend=-1))
        if level + 1 == len(sides):
            break
        rest = int(np.prod(sides[level + 1 :]))
        rho = 3**0.5 / 2 * size * (rest - 1) / rest
        bound = (np.sqrt(np.minimum.reduceat(squared, starts)) + 2 * rho + 1e-6) ** 2
        pair, child = np.nonzero(squared <= bound[block])
        block, face = block[pair] * len(offsets) + child, face[pair]
        order = np.argsort(block, kind="stable")
        block, face = block[order], face[order]
        center = (center[:, None] + offsets).reshape(-1, 3)
    best = np.minimum.reduceat(squared, starts)
    tied = squared <= best[block] * (1 + TIE) + TIE_FLOOR  # every block has candidates
    names = np.where(tied, face[:, None].astype(np.int32), np.iinfo(np.int32).max)
    chosen = np.minimum.reduceat(names, starts)
    shape = (len(coords), *(s for s in sides for _ in "xyz"))
    levels = len(sides)
    axes = [0] + [1 + 3 * i + a for a in range(3) for i in range(levels)]
    best, chosen = (
        a.reshape(shape).transpose(axes).reshape(len(coords), -1) for a in (best, chosen)
    )
    return np.sqrt(best), chosen


def _voxel_candidates(vertices, faces, triangles, coords, center, resolution, rho):
    """(voxel [P] ascending, face [P]): all triangles that may be nearest somewhere in a voxel; None
    if there are too many to list."""
    reach = 3**0.5 / 2 / resolution + 2 * rho  # the touching triangle is within half a diagonal
    corner = vertices[faces]
    low = np.ceil((corner.min(1) - reach + 0.5) * resolution - 0.5).astype(np.int64)
    high = np.floor((corner.max(1) + reach + 0.5) * resolution - 0.5).astype(np.int64)
    low, high = low.clip(0, resolution - 1), high.clip(0, resolution - 1)
    if (high - low + 1).prod(1).sum() > MAX_LISTED * len(coords):
        return None
    index = np.full((resolution,) * 3, -1, np.int64)
    index[tuple(coords.T)] = np.arange(len(coords))
    blocks, items = [], []
    for face, cell in cells_in_ranges(low, high):
        block = index[cell[:, 0], cell[:, 1], cell[:, 2]]
        keep = block >= 0
        blocks.append(block[keep].astype(np.int32))
        items.append(face[keep].astype(np.int32))
    block, face = np.concatenate(blocks), np.concatenate(items)
    squared = triangles.squared_distance(face, center[block], np.zeros((1, 3), np.float32))[:, 0]
    smallest = np.full(len(coords), np.inf, np.float32)
    np.minimum.at(smallest, block, squared)
    keep = squared <= (np.sqrt(smallest[block]) + 2 * rho + 1e-6) ** 2
    block, face = block[keep], face[keep]
    order = np.argsort(block, kind="stable")
    return block[order], face[order]


def _by_tree(vertices, faces, coords, resolution, subdivisions):
    axis = (np.arange(subdivisions) + 0.5) / subdivisions
    offsets = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    points = ((coords[:, None] + offsets) / resolution - 0.5).reshape(-1, 3)
    squared, face, _ = tree_query(vertices, faces, points)
    shape = (len(coords), subdivisions**3)
    return np.sqrt(squared).astype(np.float32).reshape(shape), face.astype(np.int32).reshape(shape)


def tree_query(vertices: np.ndarray, faces: np.ndarray, points: np.ndarray):
    """(squared distance [n], face [n], nearest point [n, 3]) of any points, by igl's box tree."""
    tree = igl.AABB()
    tree.init(vertices, faces)
    return tree.squared_distance(vertices, faces, np.ascontiguousarray(points))


def _factors(number: int) -> list[int]:
    factors = []
    while number % 2 == 0:
        factors.append(2)
        number //= 2
    return [*factors, number] if number > 1 or not factors else factors

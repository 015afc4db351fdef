"""Inside or outside of one part, by winding number, on the sub-cell lattice and at single points.

A part whose triangles bound an oriented volume (every directed edge is met by its opposite) has integer winding numbers: on the
lattice they are counted exactly, as signed crossings along columns, however its pieces overlap or touch. Any other part (real data is
open, flat and self-crossing) asks ``igl.fast_winding_number``, once for all sub-cells of a basin (``basins``): no surface lies between them, so the number does not
jump, and it drifts little. Nothing outside a part's box is inside.
"""

from __future__ import annotations

import itertools

import igl
import numpy as np
import scipy.sparse
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from uniart_jax.voxels.grid import subcell_centers
from uniart_jax.voxels.overlap import cells_in_ranges

VOXELS_AT_ONCE = 4096  # bounds the memory
BRUTE_FORCE_FACES = 256  # below this many faces the exact sum beats the hierarchy
UNCLEAR = 0.1  # a winding number this close to 1/2 may pass it between a basin's root and its other sub-cells
ROUGH, FINE = (
    1.0,
    2.0,
)  # of libigl's hierarchy: how far off a cluster must be to count as one, in its radii; 2 is its default
ROUGH_ERROR = 0.25  # what 1 may err by, nearly always (measured against 2: a third of the time)
RAY_OFFSET = 1e-5  # of rays from the face they leave
# Columns are shifted by this much of a sub-cell off the lattice, so that they miss edges and corners of axis-aligned models.
NUDGE = (1.3e-6, 0.7e-6)


class Solid:
    """Winding numbers of one mesh, object units.

    Attributes:
      closed: its triangles bound an oriented volume.
      outward: closed, and the volume is positive.
      doubled: [F] another face has the same three corners.
      bounds: [2, 3] of the faces.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray):
        _, welded = trimesh.grouping.unique_rows(vertices, digits=9)
        self.vertices = np.ascontiguousarray(vertices, dtype=np.float64)
        self.faces = np.ascontiguousarray(faces, dtype=np.int64)
        self.bounds = np.stack([self.vertices[faces].min((0, 1)), self.vertices[faces].max((0, 1))])
        welded_faces = welded[faces]
        self.closed = _bounds_volume(welded_faces)
        corner = self.vertices[self.faces]
        volume = np.einsum("fc,fc->f", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])).sum()
        self.outward = self.closed and volume > 0
        _, shared, uses = np.unique(
            np.sort(welded_faces, axis=1), axis=0, return_inverse=True, return_counts=True
        )
        self.doubled = uses[shared.reshape(-1)] > 1
        self._trees: dict[int, igl.FastWindingNumberBVH] = {}  # of pieces that were asked
        self._pieces = self._split(welded_faces) if self.closed else [(self.faces, self.bounds)]

    def _split(self, welded_faces: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """(faces, box) of every connected piece; windings of closed pieces add up and vanish outside their boxes."""
        size = welded_faces.max() + 1
        edges = welded_faces[:, [0, 1, 1, 2]].reshape(-1, 2)
        graph = scipy.sparse.coo_matrix((np.ones(len(edges), bool), edges.T), (size, size))
        piece = scipy.sparse.csgraph.connected_components(graph, directed=False)[1][
            welded_faces[:, 0]
        ]
        order = np.argsort(piece, kind="stable")
        pieces = []
        for faces in np.split(self.faces[order], np.flatnonzero(np.diff(piece[order])) + 1):
            corner = self.vertices[faces].reshape(-1, 3)
            pieces.append((faces, np.stack([corner.min(0), corner.max(0)])))
        return pieces

    def contains(self, points: np.ndarray) -> np.ndarray:
        """[n] bool, |winding number| > 1/2 at points [n, 3]."""
        return np.abs(self.winding(points)) > 0.5

    def winding(self, points: np.ndarray) -> np.ndarray:
        """[n] winding numbers at points [n, 3]; 0 outside the box."""
        winding = np.zeros(len(points))
        for faces, (low, high) in self._pieces:
            near = np.flatnonzero(((points >= low) & (points <= high)).all(1))
            if len(near):
                winding[near] += self._count(faces, np.ascontiguousarray(points[near]))
        return winding

    def _count(self, faces: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Winding numbers of some faces: exact where they are few, else by a hierarchy, roughly first and well where that is near 1/2."""
        if len(faces) <= BRUTE_FORCE_FACES:
            return igl.winding_number(self.vertices, faces, points)
        if id(faces) not in self._trees:
            self._trees[id(faces)] = igl.FastWindingNumberBVH()
            self._trees[id(faces)].init(self.vertices, faces, 2)
        tree = self._trees[id(faces)]
        winding = tree.winding_number(points, ROUGH)
        near = np.flatnonzero(np.abs(np.abs(winding) - 0.5) < ROUGH_ERROR)
        if len(near):
            winding[near] = tree.winding_number(np.ascontiguousarray(points[near]), FINE)
        return winding

    def thicker(self, faces: np.ndarray, points: np.ndarray, length: float) -> np.ndarray:
        """[n] bool: going in from points on faces, along the normal, the part goes on for ``length``.

        It must still be there after half of the length and after all of it. Where the part is no outward-oriented volume, either side
        may be the inner one. Rays answer first: beneath a face of an outward volume that meets nothing for ``length`` all is inside.
        """
        corner = self.vertices[self.faces[faces]]
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
        thick = np.zeros(len(faces), bool)
        left = np.arange(len(faces))
        if self.outward:
            scene = EmbreeScene(robust=True)
            TriangleMesh(scene, self.vertices[self.faces].astype(np.float32))
            start = (points - RAY_OFFSET * normal).astype(np.float32)
            free = scene.run(start, -normal.astype(np.float32), query="DISTANCE") > length
            thick = free & ~self.doubled[faces]
            left = np.flatnonzero(~thick)
        for side in (-1,) if self.outward else (-1, 1):
            step = side * length * normal[left]
            there = np.flatnonzero(self.contains(points[left] + step))
            there = there[self.contains(points[left[there]] + step[there] / 2)]
            thick[left[there]] = True
            left = np.flatnonzero(~thick)
        return thick

    def contains_subcells(
        self, coords: np.ndarray, resolution: int, subdivisions: int, basin: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Inside or not at all sub-cell centres of the voxels that meet this part's box.

        Args:
          coords: [V, 3] int voxels of the grid over [-1/2, 1/2]^3.
          basin: [V, r^3] of ``basins``.

        Returns:
          (voxels [n] that meet the box, inside [n, r^3] bool).
        """
        low, high = np.floor((self.bounds + 0.5) * resolution).astype(np.int64)
        voxels = np.flatnonzero(((coords >= low) & (coords <= high)).all(1))
        if not len(voxels):
            return voxels, np.zeros((0, subdivisions**3), bool)
        near = coords[voxels].astype(np.int64)
        if not self.closed:
            inside = [
                self._by_basins(subcell_centers(some, resolution, subdivisions), basin[rows])
                for some, rows in zip(_chunks(near), _chunks(voxels), strict=True)
            ]
            return voxels, np.concatenate(inside)
        low = near.min(0)
        shape = near.max(0) - low + 1
        inside = self._crossings(
            low * subdivisions, shape * subdivisions, resolution * subdivisions
        )
        inside = inside.reshape([n for s in shape for n in (s, subdivisions)])
        inside = inside.transpose(0, 2, 4, 1, 3, 5)
        return voxels, inside[tuple((near - low).T)].reshape(len(voxels), -1)

    def _by_basins(self, centers: np.ndarray, basin: np.ndarray) -> np.ndarray:
        """[n, r^3] bool at points [n, r^3, 3]: asked at the root of each basin, and everywhere in one where the answer is not clear."""
        cells = basin.shape[1]
        own = basin == np.arange(cells)
        at = centers[own]
        winding = np.zeros(basin.shape)
        winding[own] = self.winding(at)
        unclear = np.zeros(basin.shape, bool)
        outside = ((at < self.bounds[0]) | (at > self.bounds[1])).any(1)
        unclear[own] = outside | (np.abs(np.abs(winding[own]) - 0.5) < UNCLEAR)
        winding = np.take_along_axis(winding, basin, 1)
        again = np.take_along_axis(unclear, basin, 1) & ~own
        winding[again] = self.winding(centers[again])
        return np.abs(winding) > 0.5

    def _crossings(self, low: np.ndarray, shape: np.ndarray, cells: int) -> np.ndarray:
        """[shape] bool, winding number != 0 on a block of the lattice: signed crossings below each point of a column, summed up."""
        corner = (
            (self.vertices[self.faces] + 0.5) * cells - 0.5 - low
        )  # lattice points are integers
        first = np.ceil(corner.min(1) - 1e-4).astype(np.int64).clip(0)
        last = np.minimum(np.floor(corner.max(1) + 1e-4).astype(np.int64), shape - 1)
        extent = np.maximum(last - first + 1, 0).astype(np.float64)
        work = [(extent[:, (a + 1) % 3] * extent[:, (a + 2) % 3]).sum() for a in range(3)]
        up = int(np.argmin(work))
        a, b = (up + 1) % 3, (up + 2) % 3
        corner = corner[:, :, [a, b, up]]
        corner[..., 0] -= NUDGE[0]
        corner[..., 1] -= NUDGE[1]
        side = np.roll(corner, -1, 1) - corner  # edge e from corner e to e + 1
        double_area = side[:, 0, 0] * side[:, 1, 1] - side[:, 0, 1] * side[:, 1, 0]
        use = np.flatnonzero(double_area)
        corner, side = corner[use], side[use] / double_area[use, None, None]
        sign = np.where(double_area[use] > 0, -1, 1).astype(np.int32)
        constant = side[..., 1] * corner[..., 0] - side[..., 0] * corner[..., 1]
        # Edge e's weight belongs to the corner opposite to it; heights are linear in the weights, hence in the column.
        steps = np.zeros((shape[a], shape[b], shape[up] + 1), np.int32)
        flat = steps.reshape(-1)
        for face, column in cells_in_ranges(first[use][:, [a, b]], last[use][:, [a, b]]):
            x, y = column[:, 0], column[:, 1]
            height = np.zeros(len(face))
            hit = np.ones(len(face), bool)
            for e in range(3):
                weight = side[face, e, 0] * y - side[face, e, 1] * x + constant[face, e]
                hit &= weight > 0
                height += weight * corner[face, (e + 2) % 3, 2]
            level = np.ceil(height[hit]).astype(np.int64).clip(0, shape[up])
            index = (x[hit] * shape[b] + y[hit]) * (shape[up] + 1) + level
            np.add.at(flat, index, sign[face[hit]])
        winding = np.cumsum(steps[..., :-1], axis=-1, dtype=np.int16)
        return np.moveaxis(winding != 0, (0, 1, 2), (a, b, up))


def _bounds_volume(faces: np.ndarray) -> bool:
    """Whether every directed edge of faces [F, 3] (welded) is met by its opposite, counted with multiplicity."""
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    edges = edges[edges[:, 0] != edges[:, 1]]
    forward = edges[:, 0] < edges[:, 1]
    key = edges.min(1).astype(np.int64) * (faces.max() + 1) + edges.max(1)
    _, index = np.unique(key, return_inverse=True)
    return not np.bincount(index, np.where(forward, 1.0, -1.0)).any()


def _chunks(rows: np.ndarray) -> list[np.ndarray]:
    return [rows[k : k + VOXELS_AT_ONCE] for k in range(0, len(rows), VOXELS_AT_ONCE)]


def basins(distance: np.ndarray, subdivisions: int) -> np.ndarray:
    """Sub-cells of a voxel that no surface parts, as trees: each points to the neighbour farthest from the surface whose free ball it lies in.

    Args:
      distance: [V, r^3] of each centre from the nearest surface, sub-cells.

    Returns:
      [V, r^3] int: the sub-cell of the same voxel at each one's root, itself for roots.
    """
    r = subdivisions
    cells = np.asarray(distance, np.float32).reshape(-1, r, r, r)
    index = np.arange(r**3, dtype=np.int16).reshape(1, r, r, r)
    root = np.broadcast_to(index, cells.shape).copy()
    best = cells.copy()
    for shift in itertools.product((-1, 0, 1), repeat=3):
        if not any(shift):
            continue
        here = tuple(slice(max(0, -s), r - max(0, s)) for s in shift)
        there = tuple(slice(max(0, s), r - max(0, -s)) for s in shift)
        length = np.float32(np.linalg.norm(shift) + 1e-3)
        other = cells[:, *there]
        better = (other >= length) & (other > best[:, *here])
        np.copyto(best[:, *here], other, where=better)
        np.copyto(root[:, *here], np.broadcast_to(index[:, *there], other.shape), where=better)
    root = root.reshape(len(cells), -1)
    while True:
        further = np.take_along_axis(root, root.astype(np.intp), 1)
        if (further == root).all():
            return root.astype(np.intp)
        root = further

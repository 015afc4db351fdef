"""Inside or outside of one part, by winding number, on the sub-cell lattice and at single points.

A part whose triangles bound an oriented volume (every directed edge is met by its opposite) has integer winding numbers: on the
lattice they are counted exactly, as signed crossings along columns, however its pieces overlap or touch. Any other part (real data is
open, flat and self-crossing) asks ``igl.fast_winding_number``. Nothing outside a part's box is inside.
"""

from __future__ import annotations

import igl
import numpy as np
import scipy.sparse
import trimesh

from uniart_jax.voxels.overlap import cells_in_ranges

BRUTE_FORCE_FACES = 256  # below this many faces the exact sum beats the hierarchy
# Columns are shifted by this much of a sub-cell off the lattice, so that they miss edges and corners of axis-aligned models.
NUDGE = (1.3e-6, 0.7e-6)


class Solid:
    """Winding numbers of one mesh [vertices, faces], object units."""

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
        winding = np.zeros(len(points))
        for faces, (low, high) in self._pieces:
            near = np.flatnonzero(((points >= low) & (points <= high)).all(1))
            if len(near):
                query = np.ascontiguousarray(points[near])
                count = (
                    igl.winding_number
                    if len(faces) <= BRUTE_FORCE_FACES
                    else igl.fast_winding_number
                )
                winding[near] += count(self.vertices, faces, query)
        return np.abs(winding) > 0.5

    def contains_lattice(self, coords: np.ndarray, cells: int) -> np.ndarray:
        """[n] bool at the centres of sub-cells ``coords`` [n, 3] int of the lattice with ``cells`` a side over [-1/2, 1/2]^3."""
        inside = np.zeros(len(coords), bool)
        low = np.floor((self.bounds[0] + 0.5) * cells).astype(np.int64)
        high = np.floor((self.bounds[1] + 0.5) * cells).astype(np.int64)
        near = np.flatnonzero(((coords >= low) & (coords <= high)).all(1))
        if not len(near):
            return inside
        if self.closed:
            low, high = coords[near].min(0), coords[near].max(0)
            block = self._crossings(low, high, cells)
            inside[near] = block[tuple((coords[near] - low).T)] != 0
        else:
            inside[near] = self.contains((coords[near] + 0.5) / cells - 0.5)
        return inside

    def _crossings(self, low: np.ndarray, high: np.ndarray, cells: int) -> np.ndarray:
        """Winding numbers on the lattice block low..high: signed crossings below each point of a column, summed up."""
        shape = high - low + 1
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
        steps = np.zeros((shape[a], shape[b], shape[up] + 1), np.int32)
        use = np.flatnonzero(double_area)
        for item, column in cells_in_ranges(first[use][:, [a, b]], last[use][:, [a, b]]):
            face = use[item]
            weight = []
            for e in range(3):
                x = column[:, 0] - corner[face, e, 0]
                y = column[:, 1] - corner[face, e, 1]
                weight.append((side[face, e, 0] * y - side[face, e, 1] * x) / double_area[face])
            hit = (weight[0] > 0) & (weight[1] > 0) & (weight[2] > 0)
            face, column = face[hit], column[hit]
            heights = corner[face, :, 2]
            # edge e's weight belongs to the corner opposite to it
            height = sum(weight[e][hit] * heights[:, (e + 2) % 3] for e in range(3))
            level = np.ceil(height).astype(np.int64).clip(0, shape[up])
            sign = -np.sign(double_area[face]).astype(np.int32)
            np.add.at(steps, (column[:, 0], column[:, 1], level), sign)
        winding = np.cumsum(steps[..., :-1], axis=-1, dtype=np.int32)
        return np.moveaxis(winding, (0, 1, 2), (a, b, up))


def _bounds_volume(faces: np.ndarray) -> bool:
    """Whether every directed edge of faces [F, 3] (welded) is met by its opposite, counted with multiplicity."""
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    edges = edges[edges[:, 0] != edges[:, 1]]
    forward = edges[:, 0] < edges[:, 1]
    key = edges.min(1).astype(np.int64) * (faces.max() + 1) + edges.max(1)
    _, index = np.unique(key, return_inverse=True)
    return not np.bincount(index, np.where(forward, 1.0, -1.0)).any()

"""Inside or outside of one part, by winding number, on the sub-cell lattice and at single points.

A part is closed by a lid (``crossings``). Winding numbers of both together are integers, counted
exactly as signed crossings along columns, however pieces overlap or touch; those of the lid alone
are taken off. A part whose triangles bound an oriented volume (every directed edge is met by its
opposite) has no lid. Real data is open, flat and self-crossing, but its borders are short: tens of
edges where there are thousands of faces. Away from a lid its winding number hardly changes, so it
is asked once a voxel where that is enough. Nothing outside a part's box is inside.
"""

from __future__ import annotations

import igl
import numpy as np
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from uniart_jax.voxels.crossings import NUDGE, lattice_windings, lid, windings
from uniart_jax.voxels.grid import subcell_centers
from uniart_jax.voxels.nearest import tree_query

VOXELS_AT_ONCE = 4096  # bounds the memory
BRUTE_FORCE_FACES = 100  # from this many faces on the hierarchy beats the exact sum
# of the lid's winding number over a distance, per that distance from the lid: three times that of a
# straight border, 1 / 2 pi
DRIFT = 0.5
FLAT = 1e-9  # object units: how high a triangle is that has no area
RAY_OFFSET = 1e-5  # of rays from the face they leave
POINT_NUDGE = 1e-8 * NUDGE / NUDGE.max()  # object units


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
        corner = self.vertices[self.faces]
        self.bounds = np.stack([corner.min((0, 1)), corner.max((0, 1))])
        lid_corner = lid(self.vertices, self.faces, welded)
        self.closed = not len(lid_corner)
        self._whole = np.concatenate([corner, lid_corner])
        longest = np.linalg.norm(np.roll(lid_corner, -1, 1) - lid_corner, axis=2).max(1)
        # seams, along which corners of one side lie on edges of the other, have lids without area
        lid_corner = lid_corner[2 * trimesh.triangles.area(lid_corner) > FLAT * longest]
        self._lid_vertices = lid_corner.reshape(-1, 3)
        self._lid_faces = np.arange(3 * len(lid_corner)).reshape(-1, 3)
        self._tree = None
        if len(lid_corner) > BRUTE_FORCE_FACES:
            self._tree = tree = igl.FastWindingNumberBVH()
            tree.init(self._lid_vertices, self._lid_faces, 2)
        volume = np.einsum("fc,fc->f", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])).sum()
        self.outward = self.closed and volume > 0
        _, shared, uses = np.unique(
            np.sort(welded[faces], axis=1), axis=0, return_inverse=True, return_counts=True
        )
        self.doubled = uses[shared.reshape(-1)] > 1

    def contains(self, points: np.ndarray, block: float) -> np.ndarray:
        """[n] bool, |winding number| > 1/2 at points [n, 3]; the lid is asked of cubes of side
        ``block`` where that settles it."""
        whole = windings(self._whole, points, POINT_NUDGE)
        if not len(self._lid_faces):
            return whole != 0
        low = self.bounds[0] - block / 2
        shape = ((self.bounds[1] - low) / block).astype(np.int64) + 1
        cell = np.clip(((points - low) / block).astype(np.int64), 0, shape - 1)
        key, member = np.unique(np.ravel_multi_index(tuple(cell.T), shape), return_inverse=True)
        middle = low + (np.stack(np.unravel_index(key, shape), -1) + 0.5) * block
        return self._more_than_half(points, POINT_NUDGE, whole, member, middle, block)

    def _more_than_half(
        self,
        points: np.ndarray,
        nudge: np.ndarray,
        whole: np.ndarray,
        member: np.ndarray,
        middle: np.ndarray,
        block: float,
    ) -> np.ndarray:
        """[n] bool, |winding number| > 1/2 at points where that of the part with its lid is
        ``whole`` [n].

        Away from the lid its winding number is smooth: by a straight border it changes by 1 in 2 pi
        distances. So it is asked in the middle [m, 3] of the cubes that the points are ``member``
        [n] of, and at the points only where a cube may hold both answers.
        """
        winding = self._lid_winding(middle)
        radius = 3**0.5 / 2 * block
        squared, _, _ = tree_query(self._lid_vertices, self._lid_faces, middle)
        free = np.sqrt(squared) - radius
        margin = np.abs(np.mod(winding, 1) - 0.5)  # either answer, whatever ``whole`` is
        settled = (free > 0) & (margin * free > DRIFT * radius)
        inside = np.abs(whole - winding[member]) > 0.5
        ask = np.flatnonzero(~settled[member])
        inside[ask] = np.abs(whole[ask] - self._lid_winding(points[ask] + nudge)) > 0.5
        return inside & ((points >= self.bounds[0]) & (points <= self.bounds[1])).all(1)

    def _lid_winding(self, points: np.ndarray) -> np.ndarray:
        """[n] winding numbers of the lid: exact where it has few faces, else by a hierarchy."""
        points = np.ascontiguousarray(points)
        if self._tree is None:
            return igl.winding_number(self._lid_vertices, self._lid_faces, points)
        return self._tree.winding_number(points)

    def thicker(self, faces: np.ndarray, points: np.ndarray, length: float) -> np.ndarray:
        """[n] bool: going in from points on faces, along the normal, the part goes on for
        ``length``.

        It must still be there after half of the length and after all of it. Where the part is no
        outward-oriented volume, either side may be the inner one. Rays answer first: beneath a face
        of an outward volume that meets nothing for ``length`` all is inside.
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
            there = np.flatnonzero(self.contains(points[left] + step, 2 * length))
            halfway = points[left[there]] + step[there] / 2
            there = there[self.contains(halfway, 2 * length)]
            thick[left[there]] = True
            left = np.flatnonzero(~thick)
        return thick

    def contains_subcells(
        self, coords: np.ndarray, resolution: int, subdivisions: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Inside or not at all sub-cell centres of the voxels that meet this part's box.

        Args:
          coords: [V, 3] int voxels of the grid over [-1/2, 1/2]^3.

        Returns:
          (voxels [n] that meet the box, inside [n, r^3] bool).
        """
        low, high = np.floor((self.bounds + 0.5) * resolution).astype(np.int64)
        voxels = np.flatnonzero(((coords >= low) & (coords <= high)).all(1))
        if not len(voxels):
            return voxels, np.zeros((0, subdivisions**3), bool)
        near = coords[voxels].astype(np.int64)
        low = near.min(0)
        shape = near.max(0) - low + 1
        cells = resolution * subdivisions
        whole = lattice_windings(self._whole, low * subdivisions, shape * subdivisions, cells)
        whole = whole.reshape([n for s in shape for n in (s, subdivisions)])
        whole = whole.transpose(0, 2, 4, 1, 3, 5)[tuple((near - low).T)]
        whole = whole.reshape(len(voxels), -1)
        if not len(self._lid_faces):
            return voxels, whole != 0
        inside = np.zeros(whole.shape, bool)
        for begin in range(0, len(near), VOXELS_AT_ONCE):
            some = slice(begin, begin + VOXELS_AT_ONCE)
            points = subcell_centers(near[some], resolution, subdivisions)
            middle = (near[some] + 0.5) / resolution - 0.5
            member = np.repeat(np.arange(len(points)), points.shape[1])
            inside[some] = self._more_than_half(
                points.reshape(-1, 3),
                NUDGE / cells,
                whole[some].ravel(),
                member,
                middle,
                1 / resolution,
            ).reshape(len(points), -1)
        return voxels, inside

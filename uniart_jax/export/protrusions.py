"""What stands out from the boxes of a rough part: legs and feet of the body, handles of doors and
drawers.

They are a small share of a part, so boxes that hold most of it (``voxel_boxes.cover``) miss them,
though an object stands on its legs and a gripper holds its handles. They are found on a lattice
twice as fine and get shapes of their own, which ``export.budget`` joins with no others.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
import trimesh
from scipy import ndimage
from scipy.spatial import ConvexHull

from uniart_jax.export.handles import FROM_HINGE
from uniart_jax.voxels.crossings import lattice_windings

FINE = 2  # cells along one of the coarse lattice
# cells from the boxes, from which on something stands out of a moving part or is a foot, and of the
# rest of the body; nearer is a rough skin
OUT, OUT_OF_BODY = 2, 4
LEAST = 8  # cells of it at least
MOST = 6  # protrusions of a part, the largest
BOXES, HELD = 3, 0.9  # of one protrusion at most, where they hold so much of it; else a hull ...
FULL = 0.5  # ... of which so much is the protrusion's
OPEN = 0.5  # of its cells that see the outside at least

Place = tuple[np.ndarray, np.ndarray]  # lower and upper corner, cells of a lattice


@dataclasses.dataclass(frozen=True)
class Fine:
    """A part at rest on the fine lattice.

    Attributes:
      first: [3] of its window, cells.
      inside: [a, b, c] bool: cells of the part, and of no other.
      visible: [a, b, c] bool: cells that see the outside past all other parts.
      root: whether it is the body.
    """

    first: np.ndarray
    inside: np.ndarray
    visible: np.ndarray
    root: bool

    def without(self, taken: np.ndarray) -> Fine:
        """The same without some cells [n, n, n] of the coarse lattice."""
        here = taken[_coarse(self.first, self.inside.shape, len(taken))]
        return dataclasses.replace(self, inside=self.inside & ~here)

    def away_from(self, origin: np.ndarray, axis: np.ndarray) -> Fine:
        """The same, of which nothing near a hinge is visible. ``origin``, ``axis``: a point of the
        hinge's axis [3] in cells of the coarse lattice, and its direction [3]."""
        cells = np.indices(self.inside.shape).reshape(3, -1).T + self.first + 0.5
        far = np.linalg.norm(np.cross(cells - np.asarray(origin) * FINE, axis), axis=1)
        far = far.reshape(self.inside.shape)
        reach = FROM_HINGE * float(far[self.inside].max(initial=0.0))
        return dataclasses.replace(self, visible=self.visible & (far >= reach))


def _coarse(first: np.ndarray, shape: tuple[int, ...], n: int) -> tuple[np.ndarray, ...]:
    """Index of a window's fine cells into the coarse lattice, n along each side."""
    at = zip(first, shape, strict=True)
    return np.ix_(*(np.clip((f + np.arange(s)) // FINE, 0, n - 1) for f, s in at))


def fine_cells(
    vertices: np.ndarray,
    faces: np.ndarray,
    n: int,
    others: np.ndarray,
    directions: Sequence[tuple[int, int]],
    root: bool,
) -> Fine:
    """A closed part on the fine lattice.

    Args:
      vertices: [m, 3] in cells of the coarse lattice; it has n along each side. faces: [F, 3].
      others: [n, n, n] bool: coarse cells of other parts.
      directions: (axis, side) along which a cell may see the outside. root: whether it is the body.
    """
    vertices = np.asarray(vertices) * FINE
    first = np.floor(vertices.min(0)).astype(np.int64)
    shape = np.floor(vertices.max(0)).astype(np.int64) + 1 - first
    triangles = vertices[faces] / (n * FINE) - 0.5
    inside = lattice_windings(triangles, first, shape, n * FINE) != 0
    clear = np.zeros_like(others)
    for axis, side in directions:
        ahead = np.moveaxis(others, axis, 0)[::-side]
        np.moveaxis(clear, axis, 0)[::-side] |= ~np.maximum.accumulate(ahead, 0)
    window = _coarse(first, inside.shape, n)
    return Fine(first, inside & ~others[window], clear[window], root)


def protrusions(fine: Fine, boxes: Sequence[Place]) -> list[np.ndarray]:
    """Of each piece of a part that stands out from its boxes the cells [m, 3] of the fine lattice,
    the largest first, with those of its root within the boxes.

    Args:
      boxes: of the part, in cells of the coarse lattice.
    """
    held = np.zeros_like(fine.inside)
    for low, high in boxes:
        a, b = (np.maximum(c * FINE - fine.first, 0) for c in (low, high))
        held[tuple(slice(i, j) for i, j in zip(a, b, strict=True))] = True
    left = fine.inside & ~held
    if not held.any() or not left.any():
        return []
    if not fine.root:
        found = _pieces(fine, left, held, OUT)
    else:
        found = _pieces(fine, left, held, OUT_OF_BODY)
        for cells in found:  # short feet, beside these
            left[tuple((cells - fine.first).T)] = False
        low = int(fine.inside.any((0, 1)).argmax()) + fine.first[2]
        found += [piece for piece in _pieces(fine, left, held, OUT) if piece[:, 2].min() <= low + 1]
    return sorted(found, key=len, reverse=True)[:MOST]


def _pieces(fine: Fine, left: np.ndarray, held: np.ndarray, out: int) -> list[np.ndarray]:
    """Cells [m, 3] of each piece of ``left`` [a, b, c] with cells ``out`` and more from what the
    boxes hold, straight on into the boxes."""
    block = np.ones((3, 3, 3), bool)
    near = np.asarray(ndimage.binary_dilation(held, block, out - 1), bool)
    labels = np.zeros(left.shape, np.int32)
    ndimage.label(left & ~near, block, output=labels)
    found = []
    for k, window in enumerate(ndimage.find_objects(labels), start=1):
        window = tuple(slice(max(s.start - out, 0), s.stop + out) for s in window)
        own = labels[window] == k
        if own.sum() < LEAST or fine.visible[window][own].mean() < OPEN:
            continue
        rooted = own.copy()
        for line in np.eye(3, dtype=int):
            ray = np.ones(1 + 2 * line * out, bool)
            rooted |= np.asarray(ndimage.binary_dilation(own, ray), bool)
        cells = np.argwhere(rooted & fine.inside[window])
        found.append(cells + [s.start for s in window] + fine.first)
    return found


def as_shapes(
    cells: np.ndarray,
    cover: Callable[..., list[Place]],
    hulls: bool = True,
    foot: bool = False,
) -> list[Place] | trimesh.Trimesh:
    """A protrusion's cells [m, 3] as a few boxes, or as their hull (in cells) where boxes do not
    hold it, as of a slanted leg.

    Args:
      cover: boxes that hold cells [a, b, c] and some others, best first (``voxel_boxes.cover``).
      hulls: whether it may be a hull. foot: whether boxes have to reach its lowest cells.
    """
    first = cells.min(0) - 1
    full = np.zeros(cells.max(0) - first + 2, bool)
    full[tuple((cells - first).T)] = True
    boxes = cover(full, np.zeros_like(full), ((BOXES, 0.0),))
    missed = full.copy()
    for low, high in boxes:
        missed[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = False
    found = [(low + first, high + first) for low, high in boxes]
    if foot and min(low[2] for low, _ in found) > cells[:, 2].min():
        found = _slabs(cells)  # they miss the end of a slanted leg
    if not hulls or missed.sum() <= (1 - HELD) * full.sum():
        return found
    corners = (cells[:, None] + np.indices((2, 2, 2)).reshape(3, -1).T).reshape(-1, 3)
    hull = ConvexHull(corners)  # of cells, so it has a volume
    if full.sum() < FULL * hull.volume:
        return found
    return trimesh.convex.convex_hull(corners[hull.vertices])


def _slabs(cells: np.ndarray) -> list[Place]:
    """The boxes around ``BOXES`` layers of cells [m, 3], one above the other."""
    layers = np.array_split(np.unique(cells[:, 2]), BOXES)
    pieces = [cells[np.isin(cells[:, 2], layer)] for layer in layers if len(layer)]
    return [(piece.min(0), piece.max(0) + 1) for piece in pieces]

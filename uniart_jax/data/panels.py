"""The panels that an object's body is built of, read off its meshes: what the layout network's
panels train on. No jax.

A panel is a box of the body: two opposite faces that an axis is normal to, with solid between, and
as wide as the body is solid there, through boards that it meets. Where boards meet, the face of one
is in pieces; pieces of one board are one panel. Of boxes that lie in one another the largest are
kept, in order of the volume that they add.
"""

from __future__ import annotations

import itertools
from typing import Any

import manifold3d
import numpy as np

from uniart_jax.data.bodies import body_solids
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.voxels.leg_table import Legs
from uniart_jax.voxels.panel_table import Panels
from uniart_jax.voxels.part_table import MOST_PANELS

THICKEST = 0.3  # object units between the faces of a panel at most
THINNEST = 0.004  # and at least
AREA = 0.0015  # square object units that its faces share at least
SOLID = 0.9  # share of its rectangle that is solid between its faces
THICK = 0.05  # object units
CUTS = (0.5, 0.07, 0.93, 0.29, 0.68)  # shares of a panel's thickness at which that is looked at
FLAT = 0.9995  # cosine of a face's angle to an axis
SAME = 1e-3  # object units by which faces of one plane differ
NEW = 0.15  # share of a panel that no other has, at least
CANDIDATES = 256  # boxes at most that are chosen from
SMALLEST = 2e-5  # cubic object units that it adds at least


def panels_of(obj: ArticulatedObject, legs: Legs | None = None) -> Panels | None:
    """The panels of what does not move.

    Args:
      obj: normalised, at any state. legs: what it stands on, if that is known.

    Returns:
      Panels, ``MOST_PANELS`` at most, in order of the volume that they add. None where a mesh is
      not closed.
    """
    solids = body_solids(obj)
    if solids is None:
        return None
    body = manifold3d.Manifold.batch_boolean(solids, manifold3d.OpType.Add)
    found = [box for axis in range(3) for box in _boxes_along(body, axis)]
    boxes = _chosen(np.array([box for box in found if _is_solid(box, body)]))
    return Panels(boxes, _share(body, [*map(_cuboid, boxes), *_leg_solids(legs)]))


def _boxes_along(body: manifold3d.Manifold, axis: int) -> list[np.ndarray]:
    """[6] corners each of boxes between opposite faces that an axis is normal to."""
    order = [(axis + 1) % 3, (axis + 2) % 3, axis]
    turned = body.transform(np.eye(4)[order, :])
    faces = _faces(turned)
    found = []
    for (low, below), (high, above) in itertools.product(faces[-1], faces[1]):
        if not THINNEST < high - low < THICKEST:
            continue
        shared = below ^ above
        if shared.area() < AREA:
            continue
        cut = turned.slice(low + CUTS[0] * (high - low))
        for share in CUTS[1:]:
            cut = cut ^ turned.slice(low + share * (high - low))
        for rectangle in _rectangles(shared, cut):
            ends = np.array([[*rectangle[:2], low], [*rectangle[2:], high]])
            corners = np.empty((2, 3))
            corners[:, order] = ends
            found.append(corners.ravel())
    return found


def _faces(solid: manifold3d.Manifold) -> dict[int, list[tuple[float, manifold3d.CrossSection]]]:
    """Level faces by the sign of their normals, each plane's height and outline."""
    mesh = solid.to_mesh()
    triangles = np.asarray(mesh.vert_properties)[:, :3][np.asarray(mesh.tri_verts)]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(normals, axis=1)
    found: dict[int, list[tuple[float, manifold3d.CrossSection]]] = {}
    for sign in (-1, 1):
        level = triangles[sign * normals[:, 2] > FLAT * length]
        heights = level[:, :, 2].mean(1)
        rank = np.argsort(heights)
        groups = np.split(rank, np.flatnonzero(np.diff(heights[rank]) > SAME) + 1)
        found[sign] = []
        for group in groups:
            flat = level[group][:, ::sign, :2].astype(np.float64)
            if not len(flat):
                continue
            outline = manifold3d.CrossSection(list(flat), manifold3d.FillRule.NonZero)
            found[sign].append((float(heights[group].mean()), outline))
    return found


def _rectangles(shared: manifold3d.CrossSection, cut: manifold3d.CrossSection) -> list[Any]:
    """Rectangles [4] that faces share and that are solid between them, made as wide as it is."""
    found = []
    for board in cut.decompose():
        here = shared ^ board
        if here.area() < AREA:
            continue
        pieces = [here]
        if not _is_full(board, here.bounds()):
            pieces = [p for p in here.decompose() if p.area() >= AREA]
        found += [_grown(p.bounds(), board) for p in pieces if _is_full(board, p.bounds())]
    return found


def _grown(rectangle: Any, board: manifold3d.CrossSection) -> np.ndarray:
    """A rectangle [4] with each side in turn moved outwards as far as the board is solid."""
    rectangle = np.array(rectangle)
    corners = np.concatenate(board.to_polygons())
    for side in (0, 2, 1, 3):
        outwards = 1 if side > 1 else -1
        places = np.unique(corners[:, side % 2])[::outwards]
        for place in places[(places - rectangle[side]) * outwards > SAME]:
            strip = rectangle.copy()
            strip[[side, (side + 2) % 4]] = place, rectangle[side]
            if not _is_full(board, strip):
                break
            rectangle[side] = place
    return rectangle


def _is_full(outline: manifold3d.CrossSection, rectangle: Any) -> bool:
    sides = np.array(rectangle[2:]) - rectangle[:2]
    whole = manifold3d.CrossSection.square(tuple(sides)).translate(tuple(rectangle[:2]))
    return (outline ^ whole).area() >= SOLID * float(sides.prod())


def _chosen(boxes: np.ndarray) -> np.ndarray:
    """[N, 6] of candidates those that add most volume, one after the other."""
    if not len(boxes):
        return np.zeros((0, 6))
    boxes = np.unique(np.round(boxes, 4), axis=0)  # a body has some tens of them
    largest = np.argsort(-(boxes[:, 3:] - boxes[:, :3]).prod(1), kind="stable")[:CANDIDATES]
    boxes = _not_inside(boxes[largest])
    edges = [np.unique(boxes[:, [axis, axis + 3]]) for axis in range(3)]
    sizes = [np.diff(e) for e in edges]
    volume = sizes[0][:, None, None] * sizes[1][:, None] * sizes[2]
    first = [np.searchsorted(e, boxes[:, axis]) for axis, e in enumerate(edges)]
    last = [np.searchsorted(e, boxes[:, axis + 3]) for axis, e in enumerate(edges)]
    windows = [
        tuple(slice(first[axis][k], last[axis][k]) for axis in range(3)) for k in range(len(boxes))
    ]
    own = (boxes[:, 3:] - boxes[:, :3]).prod(1)
    chosen: list[int] = []
    while len(chosen) < MOST_PANELS:
        added = np.array([volume[w].sum() for w in windows])
        added[added < np.maximum(NEW * own, SMALLEST)] = 0
        best = int(added.argmax())
        if not added[best]:
            break
        chosen.append(best)
        volume[windows[best]] = 0
    return boxes[chosen]


def _not_inside(boxes: np.ndarray) -> np.ndarray:
    """Boxes [N, 6] that lie in no other."""
    inside = (boxes[:, None, :3] >= boxes[:, :3] - SAME) & (
        boxes[:, None, 3:] <= boxes[:, 3:] + SAME
    )
    inside = np.asarray(inside.all(2))
    size = (boxes[:, 3:] - boxes[:, :3]).prod(1)
    larger = (size[:, None] < size) | ((size[:, None] == size) & ~np.tri(len(boxes), dtype=bool).T)
    np.fill_diagonal(inside, False)
    return boxes[~(inside & larger).any(1)]


def _is_solid(box: np.ndarray, body: manifold3d.Manifold) -> bool:
    """Whether the body fills a box; a thick one it need not between the slices that were looked
    at."""
    if (box[3:] - box[:3]).min() < THICK:
        return True
    return (_cuboid(box) ^ body).volume() > SOLID**2 * float((box[3:] - box[:3]).prod())


def _cuboid(box: np.ndarray) -> manifold3d.Manifold:
    return manifold3d.Manifold.cube(tuple(box[3:] - box[:3])).translate(tuple(box[:3]))


def _leg_solids(legs: Legs | None) -> list[manifold3d.Manifold]:
    found: list[manifold3d.Manifold] = []
    if legs is None:
        return found
    for k in range(len(legs)):
        ends = zip((legs.lower[k], legs.upper[k]), legs.heights[k], strict=True)
        corners = [
            (x, y, z)
            for (x0, y0, x1, y1), z in ends
            for x, y in itertools.product((x0, x1), (y0, y1))
        ]
        found.append(manifold3d.Manifold.hull_points(np.array(corners)))
    return found


def _share(body: manifold3d.Manifold, solids: list[manifold3d.Manifold]) -> float:
    """Of the body's volume: what other solids have of it, less what they have beyond it; 0 or
    more."""
    whole = body.volume()
    if not solids or whole <= 0:
        return 0.0
    union = manifold3d.Manifold.batch_boolean(solids, manifold3d.OpType.Add)
    shared = (union ^ body).volume()
    return max(2 * shared - union.volume(), 0.0) / whole

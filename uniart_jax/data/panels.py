"""The panels that an object's body is built of, and the boards of parts that move, read off meshes:
what the layout network's panels and boards train on. No jax.

A panel is a box of the body: two opposite faces that an axis is normal to, with solid between, and
as wide as the body is solid there, through boards that it meets. Where boards meet, the face of one
is in pieces; pieces of one board are one panel. Of boxes that lie in one another the largest are
kept, in order of the volume that they add. A board is the same of a part, and may be smaller: a
straight bar of a handle, or a round knob as the box around it, where they have level faces of 2e-4
and more and are no longer than .3.
"""

from __future__ import annotations

import itertools
from typing import Any, NamedTuple

import manifold3d
import numpy as np

from uniart_jax.data.bodies import as_manifold, body_rows, body_solids
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.voxels.closed_pose import closing_of
from uniart_jax.voxels.leg_table import Legs
from uniart_jax.voxels.panel_table import Panels
from uniart_jax.voxels.part_table import MOST_BOARDS, MOST_PANELS

THICKEST = 0.3  # object units between the faces of a panel at most
THINNEST = 0.004  # and at least
SOLID = 0.9  # share of its rectangle that is solid between its faces ...
ROUND = 0.72  # ... that of a small board: a disc has .785
THICK = 0.05  # object units
CUTS = (0.5, 0.07, 0.93, 0.29, 0.68)  # shares of a panel's thickness at which that is looked at
FLAT = 0.9995  # cosine of a face's angle to an axis
SAME = 1e-3  # object units by which faces of one plane differ
NEW = 0.15  # share of a panel that no other has, at least
CANDIDATES = 256  # boxes at most that are chosen from
NARROW = 0.06  # object units; a part whose two longest sides are not both longer has no boards


class Limits(NamedTuple):
    """Of what counts as a panel.

    Attributes:
      most: rows. area: square object units that its faces share at least. smallest: cubic object
        units that it adds at least. small: square object units below which a rectangle is small.
    """

    most: int
    area: float
    smallest: float
    small: float


OF_BODY = Limits(MOST_PANELS, 1.5e-3, 2e-5, 0.0)
OF_PART = Limits(MOST_BOARDS, 2e-4, 2e-6, 4e-3)


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
    boxes = _boxes_of(body, OF_BODY)
    return Panels(boxes, _share(body, [*map(_cuboid, boxes), *_leg_solids(legs)]))


def boards_of(obj: ArticulatedObject) -> list[Panels | None]:
    """The boards of each part, of a door as it lies closed (``voxels.closed_pose``), else as it is
    shown; ``MOST_BOARDS`` at most. None of the body, of what is narrow (``NARROW``), and of a mesh
    that is not closed."""
    joints, parents = [part.joint for part in obj.parts], [part.parent for part in obj.parts]
    motions = closing_of(joints, obj.boxes, parents)
    found: list[Panels | None] = []
    still = body_rows(obj)
    for k, part in enumerate(obj.parts):
        found.append(None)
        solid = as_manifold(part.mesh).transform(motions[k])
        if k in still or solid.status() != manifold3d.Error.NoError:
            continue
        ends = np.array(solid.bounding_box()).reshape(2, 3)
        if np.sort(ends[1] - ends[0])[1] >= NARROW:
            boxes = _boxes_of(solid, OF_PART)
            found[k] = Panels(boxes, _share(solid, [*map(_cuboid, boxes)]))
    return found


def _boxes_of(solid: manifold3d.Manifold, limits: Limits) -> np.ndarray:
    """[N, 6] boxes that a solid is built of."""
    found = [box for axis in range(3) for box in _boxes_along(solid, axis, limits)]
    return _chosen(np.array([box for box in found if _is_solid(box, solid)]), limits)


def _boxes_along(body: manifold3d.Manifold, axis: int, limits: Limits) -> list[np.ndarray]:
    """[6] corners each of boxes between opposite faces that an axis is normal to."""
    order = [(axis + 1) % 3, (axis + 2) % 3, axis]
    turned = body.transform(np.eye(4)[order, :])
    faces = _faces(turned)
    found = []
    for (low, below), (high, above) in itertools.product(faces[-1], faces[1]):
        if not THINNEST < high - low < THICKEST:
            continue
        shared = below ^ above
        if shared.area() < limits.area:
            continue
        cut = turned.slice(low + CUTS[0] * (high - low))
        for share in CUTS[1:]:
            cut = cut ^ turned.slice(low + share * (high - low))
        for rectangle in _rectangles(shared, cut, limits):
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


def _rectangles(
    shared: manifold3d.CrossSection, cut: manifold3d.CrossSection, limits: Limits
) -> list[Any]:
    """Rectangles [4] that faces share and that are solid between them, made as wide as it is."""
    found = []
    for board in cut.decompose():
        here = shared ^ board
        if here.area() < limits.area:
            continue
        pieces = [here]
        if not _is_full(board, here.bounds(), limits.small):
            pieces = [p for p in here.decompose() if p.area() >= limits.area]
        full = [p.bounds() for p in pieces if _is_full(board, p.bounds(), limits.small)]
        found += [_grown(rectangle, board, limits.small) for rectangle in full]
    return found


def _grown(rectangle: Any, board: manifold3d.CrossSection, small: float) -> np.ndarray:
    """A rectangle [4] with each side in turn moved outwards as far as the board is solid."""
    rectangle = np.array(rectangle)
    if (rectangle[2:] - rectangle[:2]).prod() >= small:
        small = 0.0  # a strip of what is large is not small
    corners = np.concatenate(board.to_polygons())
    for side in (0, 2, 1, 3):
        outwards = 1 if side > 1 else -1
        places = np.unique(corners[:, side % 2])[::outwards]
        for place in places[(places - rectangle[side]) * outwards > SAME]:
            strip = rectangle.copy()
            strip[[side, (side + 2) % 4]] = place, rectangle[side]
            if not _is_full(board, strip, small):
                break
            rectangle[side] = place
    return rectangle


def _is_full(outline: manifold3d.CrossSection, rectangle: Any, small: float) -> bool:
    sides = np.array(rectangle[2:]) - rectangle[:2]
    area = float(sides.prod())
    whole = manifold3d.CrossSection.square(tuple(sides)).translate(tuple(rectangle[:2]))
    return (outline ^ whole).area() >= (ROUND if area < small else SOLID) * area


def _chosen(boxes: np.ndarray, limits: Limits) -> np.ndarray:
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
    while len(chosen) < limits.most:
        added = np.array([volume[w].sum() for w in windows])
        added[added < np.maximum(NEW * own, limits.smallest)] = 0
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

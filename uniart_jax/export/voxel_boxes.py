"""Boxes for rough surfaces: parts as cells of one lattice, each cell one part's, and the cells
covered by few boxes.

What a network makes has bumps of a hundredth of the object everywhere. Convex hulls of that fill
cavities and cross the neighbours; cells of one lattice cannot. The lattice lies along the object's
axes at rest, where doors and drawers are closed, so that flat parts are few boxes. Knobs are hulls,
because a box's corners would catch as it turns; the cells that one touches are its own. Legs and
handles, which such boxes miss, have shapes of their own (``export.protrusions``).
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
import trimesh
from scipy import ndimage

from uniart_jax.export.box_growth import Layers, grow
from uniart_jax.export.part_kinds import is_knob
from uniart_jax.export.physics import Box, Hull, Shape
from uniart_jax.export.protrusions import FINE, Fine, Place, as_shapes, fine_cells, protrusions
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.voxels.crossings import lattice_windings
from uniart_jax.voxels.grid import dilated

ROUGH_FACES = 2500  # fewer are no rough object
# (radians, share of edges that are bent by more). Marching cubes of a network's output have .8 and
# .5; a smooth surface of many faces has
# .95 and .05, furniture .6 and .45.
BENT = ((0.05, 0.7), (0.2, 0.4))
CELLS = 64  # along the object's longest side
# (boxes a part, share of its cells that no box need hold): the second where the first do not
# suffice, as for bowls and slanted plates
ENOUGH = ((64, 0.02), (256, 0.08))
SEEDS = 24  # cells that boxes are grown from, for each that is kept
LEAST_CELLS = 3  # a part with fewer gets all cells that its corners are in
GAP = 0.0015  # of the longest side, between the boxes of neighbours
REACH = 0.7  # cells from a knob's rim, within which a cell's middle lies that it touches
FREE = -1  # owner of a cell that is nobody's
FOOT = 0.35  # of the shorter side of the body's outline from above, that a foot is wide at most
# (axis, side) to which what stands out is looked for: the body stands on it, or it lies on top; a
# hand comes from the front (-x), from a side or from above
BODY, MOVING = ((2, -1), (2, 1)), ((0, -1), (1, -1), (1, 1), (2, 1))


def is_rough(obj: ArticulatedObject) -> bool:
    """Whether an object's surface was found on voxels, or is bumpy all over, so that no hull would
    follow it."""
    if obj.from_voxels:
        return True
    if sum(len(part.mesh.faces) for part in obj.parts) <= ROUGH_FACES:
        return False
    welded = [trimesh.Trimesh(p.mesh.vertices, p.mesh.faces) for p in obj.parts]
    angles = np.concatenate([mesh.face_adjacency_angles for mesh in welded])
    return all(float((angles > bend).mean()) > share for bend, share in BENT)


@dataclasses.dataclass(frozen=True)
class Cells:
    """An object at rest on a lattice.

    Attributes:
      corner: [3] of cell (0, 0, 0), and ``side`` of a cell; object units, object frame.
      rest: [K, 4, 4] of each part from the shown state to rest.
      full: [K, n, n, n] bool: the part's own cells; no cell is two parts'.
      spare: [K, n, n, n] bool: cells beside them that its boxes may hold too, because no other part
        ever gets there.
      knobs: parts that are hulls instead, object units, at the shown state.
      fine: parts of which what stands out from their boxes is looked for.
      ground: z of the lowest point of the root, object frame at rest.
      hulls: whether shapes may be hulls.
    """

    corner: np.ndarray
    side: float
    rest: np.ndarray
    full: np.ndarray
    spare: np.ndarray
    knobs: dict[int, trimesh.Trimesh] = dataclasses.field(default_factory=dict)
    fine: dict[int, Fine] = dataclasses.field(default_factory=dict)
    ground: float = -np.inf
    hulls: bool = True

    def centers(self, cells: np.ndarray) -> np.ndarray:
        """[n, 3] centres of cells [n, 3]."""
        return self.corner + (cells + 0.5) * self.side

    def holding(self, points: np.ndarray) -> np.ndarray:
        """[n, 3] int cells that hold points [n, 3]."""
        return np.floor((points - self.corner) / self.side).astype(np.int64)

    def boxes_alone(self) -> Cells:
        """The same, with boxes in place of hulls."""
        return dataclasses.replace(self, knobs={}, hulls=False)

    def shapes(self, scale: float) -> list[tuple[Shape, ...]]:
        """[K] boxes for every part, or a knob's hull, in metres by ``scale``, in the frame of the
        shown state."""
        out: list[tuple[Shape, ...]] = []
        for k, pose in enumerate(np.linalg.inv(self.rest)):
            if k in self.knobs:
                hull = self.knobs[k]
                metric = trimesh.Trimesh(hull.vertices * scale, hull.faces, process=False)
                out.append((Hull(metric),))
                continue
            covering = cover(self.full[k], self.spare[k])
            root = k in self.fine and self.fine[k].root
            shapes: list[Shape] = [self._box(*box, pose, scale, root) for box in covering]
            if root:
                shapes = self._with_feet(shapes, covering)
            if k in self.fine:
                shapes += self._standing_out(k, covering, pose, scale)
            out.append(tuple(shapes))
        return out

    def _standing_out(
        self, k: int, boxes: list[Place], pose: np.ndarray, scale: float
    ) -> list[Shape]:
        """Shapes of what stands out from a part's boxes; what is no foot is optional."""
        found: list[Shape] = []
        for cells in protrusions(self.fine[k], boxes):
            bottom = self.corner[2] + cells[:, 2].min() / FINE * self.side
            root = self.fine[k].root
            optional = not (root and bottom <= self.ground + self.side)
            held = as_shapes(cells, cover, self.hulls, foot=not optional)
            if isinstance(held, trimesh.Trimesh):
                points = self.corner + held.vertices / FINE * self.side
                if not optional:  # it stands on the ground
                    points[points[:, 2] <= points[:, 2].min() + GAP * self.side, 2] = self.ground
                points = points @ pose[:3, :3].T + pose[:3, 3]
                metric = trimesh.convex.convex_hull(points * scale)
                found.append(Hull(metric, stands_out=True, optional=optional))
                continue
            for low, high in held:
                box = self._box(low / FINE, high / FINE, pose, scale, root)
                found.append(dataclasses.replace(box, stands_out=True, optional=optional))
        return found

    def _with_feet(self, shapes: list[Shape], boxes: list[Place]) -> list[Shape]:
        """The root's boxes, with those that stand on the ground and are narrow marked."""
        low, high = (np.array([box[i] for box in boxes]) for i in (0, 1))
        narrow = FOOT * float((high.max(0) - low.min(0))[:2].min())
        feet = ((high - low)[:, :2].max(1) <= narrow) & (
            self.corner[2] + low[:, 2] * self.side < self.ground + self.side
        )
        return [
            dataclasses.replace(shape, stands_out=True) if foot else shape
            for shape, foot in zip(shapes, feet, strict=True)
        ]

    def _box(
        self, low: np.ndarray, high: np.ndarray, pose: np.ndarray, scale: float, root: bool
    ) -> Box:
        """The box between two corners in cells, less a gap; of the root its bottom is the ground
        where that is within a cell."""
        gap = GAP * CELLS * self.side
        lower, upper = self.corner + low * self.side + gap, self.corner + high * self.side - gap
        if root and abs(lower[2] - gap - self.ground) < self.side < upper[2] - self.ground:
            lower[2] = self.ground
        moved = pose[:3, :3] @ ((lower + upper) / 2) + pose[:3, 3]
        return Box(moved * scale, (upper - lower) * scale, pose[:3, :3].copy())


def as_cells(obj: ArticulatedObject, meshes: Sequence[trimesh.Trimesh]) -> Cells:
    """The parts on one lattice. Where parts cross, a cell goes to the part that it lies deepest in.

    Args:
      obj: any object. meshes: [K] its parts' surfaces, object units, object frame; one that is open
        counts by its corners alone.
    """
    rest = obj.forward_kinematics(obj.rest())
    corners = [trimesh.transform_points(m.vertices, t) for m, t in zip(meshes, rest, strict=True)]
    low = np.min([c.min(0) for c in corners], 0)
    high = np.max([c.max(0) for c in corners], 0)
    side = max(float(np.ptp(obj.bounds, axis=0).max()), float((high - low).max())) / CELLS
    n = int(np.ceil((high - low).max() / side)) + 4  # room for spare cells
    corner = (low + high) / 2 - n * side / 2
    owner = np.full((n, n, n), FREE, np.int16)
    depth = np.zeros((n, n, n), np.float32)
    for k, mesh in enumerate(meshes):
        vertices = (corners[k] - corner) / side
        first = np.floor(vertices.min(0)).astype(np.int64)
        shape = np.floor(vertices.max(0)).astype(np.int64) + 1 - first
        inside = np.zeros(shape, bool)
        if mesh.is_watertight:
            triangles = vertices[np.asarray(mesh.faces)] / n - 0.5
            inside = lattice_windings(triangles, first, shape, n) != 0  # inside out, too
        if inside.sum() < LEAST_CELLS:
            inside[tuple((np.floor(vertices).astype(np.int64) - first).T)] = True
        deep = np.asarray(ndimage.distance_transform_edt(np.pad(inside, 1)))[1:-1, 1:-1, 1:-1]
        place = tuple(slice(a, a + s) for a, s in zip(first, shape, strict=True))
        take = inside & (deep > depth[place])
        owner[place][take] = k
        depth[place][take] = deep[take]
    for k, place in enumerate(corners):
        if (owner == k).any():
            continue
        # it lies inside others: the nearest cell that is nobody's, or one of several that somebody
        # has
        count = np.bincount(owner[owner != FREE], minlength=len(meshes))
        open_to_all = np.argwhere((owner == FREE) | (count[owner] > 1))
        away = np.abs(corner + (open_to_all + 0.5) * side - place.mean(0)).sum(1)
        owner[tuple(open_to_all[away.argmin()])] = k
    knobs = [k for k in range(len(meshes)) if is_knob(obj, k)]
    for k in knobs:
        touched = _touched(obj, k, corners[k], rest, corner, side, n)
        others = np.bincount(owner[owner != FREE], minlength=len(meshes))
        lost = np.bincount(owner[touched & (owner != FREE)], minlength=len(meshes))
        give = 2 * lost <= others
        give[knobs] = False
        owner[touched & ((owner == FREE) | give[owner])] = k
    full = owner == np.arange(len(meshes), dtype=np.int16)[:, None, None, None]
    near = np.stack([dilated(f) for f in full])
    alone = near & (near.sum(0) == 1) & (owner == FREE)
    hulls = {k: meshes[k].convex_hull for k in knobs}
    fine = {}
    for k, mesh in enumerate(meshes):
        if k not in knobs and mesh.is_watertight and full[k].sum() >= LEAST_CELLS:
            others = (owner != k) & (owner != FREE)
            root = obj.parts[k].parent < 0
            vertices = (corners[k] - corner) / side
            ways = BODY if root else MOVING
            found = fine_cells(vertices, np.asarray(mesh.faces), n, others, ways, root)
            if obj.parts[k].joint.rotates:
                origin, axis = _axis(obj, k, rest)
                found = found.away_from((origin - corner) / side, axis)
            fine[k] = found
    ground = float(corners[0][:, 2].min())
    return Cells(corner, side, rest, full, alone, hulls, fine, ground)


def _axis(obj: ArticulatedObject, k: int, rest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A point of part k's joint axis and its direction, at rest."""
    joint, pose = obj.parts[k].joint, rest[obj.parts[k].parent]
    return pose[:3, :3] @ joint.origin + pose[:3, 3], pose[:3, :3] @ joint.direction


def _touched(
    obj: ArticulatedObject,
    k: int,
    vertices: np.ndarray,
    rest: np.ndarray,
    corner: np.ndarray,
    side: float,
    n: int,
) -> np.ndarray:
    """[n, n, n] bool: cells that a knob with ``vertices`` [m, 3] at rest touches as it turns."""
    origin, axis = _axis(obj, k, rest)
    arm = vertices - origin
    radius = float(np.linalg.norm(np.cross(arm, axis), axis=1).max())
    low, high = float((arm @ axis).min()), float((arm @ axis).max())
    first = np.clip(np.floor((vertices.min(0) - corner) / side).astype(int) - 2, 0, n)
    last = np.clip(np.floor((vertices.max(0) - corner) / side).astype(int) + 3, 0, n)
    cells = np.indices(last - first).reshape(3, -1).T + first
    away = corner + (cells + 0.5) * side - origin
    beside = np.linalg.norm(np.cross(away, axis), axis=1) < radius + REACH * side
    along = away @ axis
    beside &= (along > low - side / 2) & (along < high + side / 2)
    found = np.zeros((n, n, n), bool)
    found[tuple(cells[beside].T)] = True
    return found


def cover(
    full: np.ndarray, spare: np.ndarray, enough: Sequence[tuple[int, float]] = ENOUGH
) -> list[tuple[np.ndarray, np.ndarray]]:
    """(low [3], high [3]) of boxes that hold ``full`` but for a small share, and nothing but
    ``full`` and some of ``spare`` [n, n, n].

    Greedy: of the boxes grown from some cells that none holds yet the one that holds the most of
    them. Deterministic.
    """
    cells = np.argwhere(full)
    if not len(cells):
        return []
    low, high = np.maximum(cells.min(0) - 1, 0), cells.max(0) + 2
    place = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
    full, allowed = full[place], (full | spare)[place]
    rng, orders = np.random.default_rng(0), list(itertools.permutations(range(3)))
    left = full.copy()
    layers = Layers(full, allowed)
    boxes, grown = [], []
    while any(len(boxes) < most and left.sum() > share * len(cells) for most, share in enough):
        seeds = rng.permutation(np.argwhere(left))[:SEEDS]
        for seed in seeds:
            grown += [grow(layers, seed, orders[i]) for i in rng.permutation(6)[:2]]
        gain = [int(left[box].sum()) for box in grown]
        order = np.argsort(gain, kind="stable")[::-1]
        best = grown[order[0]]
        left[best] = False
        boxes.append((low + [s.start for s in best], low + [s.stop for s in best]))
        grown = [grown[i] for i in order[1 : 2 * SEEDS]]  # good ones are tried again
    return boxes

"""Fewer convex shapes: neighbours joined by least volume error (``export.shape_merging``) until an
object keeps within a budget.

Simulators with thousands of copies pay for every shape. Two shapes of a part are joined to a box or
a hull; first those whose union changes least, and those last that would stand where another part is
on any joint's way. So walls of a drawer, which five boxes say, stay walls, and what is cut into
dozens of wedges becomes as coarse as the budget asks for. Legs and handles stay as they are while
the budget allows it (``_kept_apart``).
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
import trimesh
from manifold3d import Manifold

from uniart_jax.export.box_cover import fitted_box
from uniart_jax.export.collision import OVERLAP, rebuilt
from uniart_jax.export.convex_split import triangles
from uniart_jax.export.formats import COLLISION_BUDGET
from uniart_jax.export.frames import rigid_groups
from uniart_jax.export.physics import Body, Box, Shape
from uniart_jax.export.separation import as_solid, separated
from uniart_jax.export.shape_merging import Merger
from uniart_jax.export.volume_error import corners_of, half_spaces, is_open, volume_error
from uniart_jax.objects.object import ArticulatedObject

Shapes = tuple[Shape, ...]  # of a part
PART_MOST = 16  # convex shapes a part
STATES = 7  # of a joint's range, at which other parts are looked up ...
FINE_STATES = 17  # ... and at which legs and handles are tried
CELL = 1 / 64  # of the object's longest side: how closely other parts' places are told apart
INSET = 0.006  # of the longest side: how deep in another part a place must lie to be its own
SAMPLES = 3000  # places a part
BARRED = 10.0  # volumes of the object that a place of another part costs
FREE = 0.004  # of the hull of the part: joined although the budget does not ask for it
AS_GOOD = 0.004  # likewise: by how much a single box or hull may be worse than what it replaces


def within_budget(
    obj: ArticulatedObject,
    bodies: Sequence[Body],
    meshes: Sequence[trimesh.Trimesh],
    budget: int = COLLISION_BUDGET,
    *,
    boxes: bool = False,
) -> tuple[Body, ...]:
    """The bodies with at most ``budget`` shapes together and 16 each, but one a part at least.

    Args:
      obj: any object. bodies, meshes: [K] of its parts (``export.bodies.make_bodies``); meshes in
        object units.
      boxes: shapes are boxes, and are joined to boxes alone.

    Raises:
      ValueError: a budget below 1.
    """
    check_budget(budget)
    size = float(np.ptp(obj.bounds, axis=0).max()) * obj.scale
    places = [_places(body.shapes, size) for body in bodies]
    joined, standing = zip(*(_split(body.shapes) for body in bodies), strict=True)
    barred = [_barred(obj, k, places, b.shapes, joined[k], size) for k, b in enumerate(bodies)]
    free = _free(obj, [body.shapes for body in bodies], standing, OVERLAP * size)
    standing, pooled = _kept_apart(standing, free, budget)
    parts = []
    for own, more, points in zip(joined, pooled, barred, strict=True):
        parts.append(Merger((*own, *more), _outside(points, more), BARRED * size**3, boxes))
    budget -= sum(len(own) for own in standing)
    for part, own in zip(parts, standing, strict=True):
        part.coarsen(min(PART_MOST - len(own), budget))
    while sum(part.count for part in parts) > max(budget, len(parts)):
        open_to = [part for part in parts if part.count > 1 and np.isfinite(part.next_cost())]
        if not open_to:
            break
        min(open_to, key=lambda p: p.next_cost() / p.extent**0.5).step()
    out = []
    for body, part, mesh in zip(bodies, parts, meshes, strict=True):
        while part.count > 1 and part.next_cost() <= FREE * part.extent:
            part.step()
        shapes, error = _simplest(part, _metric(mesh, obj.scale), size)
        out.append(dataclasses.replace(body, shapes=shapes, volume_error=error))
    whole = [(*body.shapes, *own) for body, own in zip(out, standing, strict=True)]
    apart = separated(whole, OVERLAP * size, lambda s: rebuilt(s, size))
    for k, shapes in enumerate(apart):
        if any(a is not b for a, b in itertools.zip_longest(shapes, out[k].shapes)):
            mesh = _metric(meshes[k], obj.scale)
            error = volume_error(mesh, shapes, parts[k].given if is_open(mesh) else None)
            out[k] = dataclasses.replace(out[k], shapes=shapes, volume_error=error)
    return tuple(out)


def _split(shapes: Shapes) -> tuple[Shapes, Shapes]:
    """The shapes of a part that may be joined, and those that stand out; if all do, all may be
    joined."""
    joined = tuple(s for s in shapes if not s.stands_out)
    return (joined, tuple(s for s in shapes if s.stands_out)) if joined else (shapes, ())


def _kept_apart(
    standing: Sequence[Shapes], free: Sequence[Sequence[bool]], budget: int
) -> tuple[list[Shapes], list[Shapes]]:
    """[K] of the legs and handles of every part those that stay as they are, and those that may be
    joined with others.

    At most half of the budget stays as it is, ``PART_MOST`` / 2 a part, and so much that a shape
    is left for each part; the largest first. What is not ``free`` may be joined; if it is
    ``optional``, it goes.
    """
    most = max(min(budget // 2, budget - len(standing)), 0)
    pooled: list[list[Shape]] = [[] for _ in standing]
    offered = []
    for k, shapes in enumerate(standing):
        for shape, moves_freely in zip(shapes, free[k], strict=True):
            if moves_freely:
                offered.append((as_solid(shape).volume(), k, shape))
            elif not shape.optional:
                pooled[k].append(shape)
    kept: list[list[Shape]] = [[] for _ in standing]
    for _, k, shape in sorted(offered, key=lambda one: -one[0]):
        room = sum(map(len, kept)) < most and len(kept[k]) < PART_MOST // 2
        (kept if room else pooled)[k].append(shape)
    return [tuple(own) for own in kept], [tuple(own) for own in pooled]


def _free(
    obj: ArticulatedObject,
    shapes: Sequence[Shapes],
    standing: Sequence[Shapes],
    least: float,
) -> list[list[bool]]:
    """[K] of the legs and handles of every part, whether no shape of another part stands in them by
    more than ``least`` metres as shown, at rest or on any joint's way.

    Args:
      shapes: [K] all shapes, metres; ``standing`` are among them.
    """
    free = [[True] * len(own) for own in standing]
    solids = [as_solid(shape) for own in shapes for shape in own]
    owner = np.repeat(np.arange(len(shapes)), [len(own) for own in shapes])
    if not any(standing):
        return free
    boxes = np.array([trimesh.bounds.corners(corners_of(solid)) for solid in solids])  # [N, 8, 3]
    tried = [[(as_solid(shape), corners_of(as_solid(shape))) for shape in own] for own in standing]
    groups = np.array(rigid_groups(obj))
    for state in _states(obj, FINE_STATES):
        poses = obj.forward_kinematics(state)
        poses[:, :3, 3] *= obj.scale
        for k, own in enumerate(tried):
            if not any(free[k]):
                continue
            matrix = (np.linalg.inv(poses[k]) @ poses)[owner]
            moved = np.einsum("nij,nkj->nki", matrix[:, :3, :3], boxes) + matrix[:, None, :3, 3]
            low, high = moved.min(1), moved.max(1)
            others = groups[owner] != groups[k]
            for i, (solid, (lo, hi)) in enumerate(own):
                near = others & (np.minimum(high, hi) - np.maximum(low, lo) > least).all(1)
                for n in np.flatnonzero(near) if free[k][i] else ():
                    both = solid ^ solids[n].transform(matrix[n, :3])
                    sides = np.ptp(corners_of(both), axis=0) if not both.is_empty() else 0.0
                    free[k][i] &= not np.min(sides) > least
    return free


def check_budget(budget: int) -> None:
    """Refuse (ValueError) what is no budget."""
    if budget < 1:
        raise ValueError(f"--collision-budget {budget}: give 1 or more convex shapes an object")


def _simplest(part: Merger, mesh: trimesh.Trimesh, size: float) -> tuple[tuple[Shape, ...], float]:
    """The shapes of a part, or one box or hull where that is as good by its measured error; and the
    error: of an open surface, against the shapes before any were joined."""
    shapes = part.shapes(size)
    finer = part.given if is_open(mesh) else None
    error = volume_error(mesh, shapes, finer)
    if len(shapes) < 2:
        return shapes, error
    hull = Manifold.batch_hull(part.solids())
    for one in (part.box(hull), hull)[: 1 if part.boxes else 2]:
        if part.inside(one):
            continue
        shape = rebuilt(one, size)
        if shape is None:
            continue
        alone = volume_error(mesh, (shape,), finer)
        if alone <= error + AS_GOOD:
            return (shape,), alone
    return shapes, error


_NOWHERE = np.zeros((0, 3))


def _barred(
    obj: ArticulatedObject,
    k: int,
    places: Sequence[np.ndarray],
    shapes: Sequence[Shape],
    own: Sequence[Shape],
    size: float,
) -> np.ndarray:
    """[n, 3] places in the box around a part's shapes, in its frame, that other parts hold at rest,
    as shown or on any joint's way, and those of its shapes that are ``own`` do not."""
    if len(shapes) < 2:
        return _NOWHERE
    lo, hi = np.array([corners_of(as_solid(s)) for s in shapes]).transpose(1, 0, 2)
    lo, hi = lo.min(0), hi.max(0)
    found = []
    for state in _states(obj):
        poses = obj.forward_kinematics(state)
        back = np.linalg.inv(poses[k])
        for j, points in enumerate(places):
            if j == k or not len(points):
                continue
            relative = back @ poses[j]
            moved = points @ relative[:3, :3].T + relative[:3, 3] * obj.scale
            found.append(moved[((moved > lo) & (moved < hi)).all(1)])
    points = np.concatenate(found) if found else _NOWHERE
    _, first = np.unique(
        np.floor(points / (CELL * size)).astype(np.int64), axis=0, return_index=True
    )
    points = points[np.sort(first)]
    return _outside(points, own)


def _outside(points: np.ndarray, shapes: Sequence[Shape]) -> np.ndarray:
    """Those of points [n, 3] that no shape holds."""
    for shape in shapes:
        normals, offsets = half_spaces(as_solid(shape))
        points = points[~(points @ normals.T <= offsets).all(1)]
    return points


def _states(obj: ArticulatedObject, number: int = STATES) -> list[np.ndarray]:
    """As shown, at rest, and every joint over its range with the others at rest."""
    rest = obj.rest()
    states = [np.zeros(len(obj.parts)), rest]
    for k, (lo, hi) in enumerate(obj.limits):
        if obj.parts[k].parent >= 0 and hi > lo:
            for q in np.linspace(lo, hi, number):
                states.append(np.where(np.arange(len(rest)) == k, q, rest))
    return states


def _places(shapes: Sequence[Shape], size: float) -> np.ndarray:
    """[n, 3] points in the shapes of a part, no nearer to their faces than the inset, as far as
    they are thick enough."""
    found = []
    for shape in shapes:
        solid = as_solid(shape)
        frame = shape.rotation if isinstance(shape, Box) else np.eye(3)
        vertices, _ = triangles(solid)
        center, extent = fitted_box(vertices, frame)
        half = np.maximum(extent / 2 - INSET * size, 0)
        axes = [
            np.linspace(-h, h, max(1, int(2 * h / (CELL * size)) + 2) if h else 1) for h in half
        ]
        points = np.array(list(itertools.product(*axes))) @ frame.T + center
        if not isinstance(shape, Box):
            normals, offsets = half_spaces(solid)
            points = points[(points @ normals.T <= offsets - INSET * size).all(1)]
            points = points if len(points) else vertices.mean(0)[None]
        found.append(points)
    points = np.concatenate(found)
    return points[:: max(1, len(points) // SAMPLES)]


def _metric(mesh: trimesh.Trimesh, scale: float) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices * scale, mesh.faces, process=False)

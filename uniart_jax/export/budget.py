"""Fewer convex shapes: neighbours joined by least volume error (``export.shape_merging``) until an
object keeps within a budget.

Simulators with thousands of copies pay for every shape. Two shapes of a part are joined to a box or
a hull; first those whose union changes least, and those last that would stand where another part is
on any joint's way. So walls of a drawer, which five boxes say, stay walls, and what is cut into
dozens of wedges becomes as coarse as the budget asks for. Legs and handles stay as
they are, unless they are in another part's way.
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
from uniart_jax.export.physics import Body, Box, Shape
from uniart_jax.export.separation import as_solid, separated
from uniart_jax.export.shape_merging import Merger
from uniart_jax.export.volume_error import corners_of, half_spaces, is_open, volume_error
from uniart_jax.objects.object import ArticulatedObject

PART_MOST = 16  # convex shapes a part
STATES = 7  # of a joint's range, at which other parts are looked up
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
    parts, standing = [], []
    for k, body in enumerate(bodies):
        rest = tuple(s for s in body.shapes if not s.stands_out) or body.shapes
        own = [s for s in body.shapes if s.stands_out] if rest is not body.shapes else []
        barred = _barred(obj, k, places, body.shapes, rest, size)
        parts.append(Merger(rest, barred, BARRED * size**3, boxes))
        standing.append([s for s in own if not parts[k].inside(as_solid(s))])
    standing = _largest(standing, budget)
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


def _largest(standing: Sequence[Sequence[Shape]], budget: int) -> list[tuple[Shape, ...]]:
    """[K] of the legs and handles of every part those that stay: the largest, half of the budget
    at most, and what leaves a shape for each part."""
    found = [(k, shape) for k, own in enumerate(standing) for shape in own]
    found.sort(key=lambda one: -as_solid(one[1]).volume())
    found = found[: max(min(budget // 2, budget - len(standing)), 0)]
    own = [[s for j, s in found if j == k][: PART_MOST // 2] for k in range(len(standing))]
    return [tuple(shapes) for shapes in own]


def check_budget(budget: int) -> None:
    """Refuse (ValueError) what is no budget."""
    if budget < 1:
        raise ValueError(f"--collision-budget {budget}: give 1 or more convex shapes an object")


def shape_count(bodies: Sequence[Body]) -> int:
    """Of all bodies together."""
    return sum(len(body.shapes) for body in bodies)


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
    for shape in own:
        normals, offsets = half_spaces(as_solid(shape))
        points = points[~(points @ normals.T <= offsets).all(1)]
    return points


def _states(obj: ArticulatedObject) -> list[np.ndarray]:
    """As shown, at rest, and every joint over its range with the others at rest."""
    rest = obj.rest()
    states = [np.zeros(len(obj.parts)), rest]
    for k, (lo, hi) in enumerate(obj.limits):
        if obj.parts[k].parent >= 0 and hi > lo:
            for q in np.linspace(lo, hi, STATES):
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

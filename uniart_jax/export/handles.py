"""Where a hand takes hold of a moving part, and which way opens it."""

from __future__ import annotations

import dataclasses
import re

import igl
import numpy as np
import trimesh

from uniart_jax.export.frames import rigid_groups
from uniart_jax.objects.object import ArticulatedObject

HANDLE = re.compile(r"handle|knob|grip|pull", re.IGNORECASE)
RIM = 0.95  # of the largest distance from the axis: points farther out are the rim
LEAST_LEVER = 1e-3  # metres
FACING = 0.7  # cosine to the way out, from which on a face looks there
STANDS = 0.007  # of the object's longest side, that a handle stands out from its plate
SPAN = 0.02  # of that side, that a handle is long at least
LEVEL = 0.004  # of that side, within which faces are one plate's
PLATE = 0.2  # of all that looks there, that a plate is at least; the foremost counts
FROM_HINGE = 0.3  # of the largest distance from the axis, at which a handle is at least
BESIDE = 0.2  # of that distance, that the middle of what a handle turns is from the axis at least


@dataclasses.dataclass(frozen=True)
class Handle:
    """Of one moving part.

    Attributes:
      part: index of the part that the point lies on: a handle fixed to the moving part, or that
        part.
      point: [3] object units, object frame at the shown state.
      lever: metres that the point goes for a unit of the joint's coordinate (rad, or m), as it
        turns or slides.
      opens: 1 if the coordinate grows from rest to open, else -1.
    """

    part: int
    point: np.ndarray
    lever: float
    opens: int


def opening(obj: ArticulatedObject, k: int, handle: Handle) -> np.ndarray:
    """[3] the direction (unit, object frame at the shown state) in which the handle of part k sets
    out when it opens; of a point on the axis of a hinge, the axis."""
    joint = obj.parts[k].joint
    way = joint.direction * joint.pitch
    if joint.rotates:
        way = way + np.cross(joint.direction, handle.point - joint.origin)
    length = float(np.linalg.norm(way))
    return handle.opens * (way / length if length > 1e-9 else joint.direction)


def handles(obj: ArticulatedObject) -> tuple[Handle | None, ...]:
    """[K] of every part that moves; None for the root and fixed parts.

    The middle of a part called a handle, knob, grip or pull that is fixed to it; else the middle of
    what stands out from the part's plate on the side to which it opens; else the middle of
    the rim farthest from a hinge's axis, of the part and what is fixed to it, or of the face of a
    slide that goes ahead. A point of the surface, but for that of a named part.
    """
    rest, opened = obj.rest(), obj.open()
    leaders = rigid_groups(obj)
    return tuple(
        None
        if part.parent < 0 or part.joint.type == "fixed"
        else _handle(
            obj,
            k,
            [i for i, leader in enumerate(leaders) if leader == k],
            1 if opened[k] >= rest[k] else -1,
        )
        for k, part in enumerate(obj.parts)
    )


def _handle(obj: ArticulatedObject, k: int, own: list[int], opens: int) -> Handle:
    """Of part k; ``own``: it and the parts that are fixed to it."""
    joint = obj.parts[k].joint
    named = [
        i for i in own if i != k and HANDLE.search(f"{obj.parts[i].name} {obj.parts[i].label}")
    ]
    if named:
        held = named[0]
        point = obj.parts[held].mesh.bounds.mean(0)
    else:
        held, point = _grip(obj, k, own, opens)
        if point is None and not joint.rotates:
            points = np.asarray(obj.parts[k].mesh.vertices)
            ahead, middle = opens * joint.direction, obj.parts[k].mesh.bounds.mean(0)
            point = middle + ahead * float((points @ ahead).max() - middle @ ahead)
        elif point is None:
            held = max(own, key=lambda i: _radii(obj, k, obj.parts[i].mesh.vertices).max())
            points = np.asarray(obj.parts[held].mesh.vertices)
            point = _rim_middle(points, _radii(obj, k, points), joint)
        point = _on_surface(obj.parts[held].mesh, point)
    lever = float(_radii(obj, k, point[None])[0]) * obj.scale if joint.rotates else 1.0
    return Handle(held, point, max(lever, LEAST_LEVER), opens)


def _grip(
    obj: ArticulatedObject, k: int, own: list[int], opens: int
) -> tuple[int, np.ndarray | None]:
    """The middle [3] of what stands out from the plate of part k, and of what is fixed to it
    (``own``), to where it opens, and the part of ``own`` that it is of; k and None without."""
    joint, meshes = obj.parts[k].joint, [obj.parts[i].mesh for i in own]
    faces = np.repeat(own, [len(m.faces) for m in meshes])
    mesh = trimesh.util.concatenate([trimesh.Trimesh(m.vertices, m.faces) for m in meshes])
    way = opens * joint.direction
    if joint.rotates:
        arm = np.cross(joint.direction, obj.parts[k].mesh.bounds.mean(0) - joint.origin)
        if np.linalg.norm(arm) < BESIDE * _radii(obj, k, mesh.vertices).max():
            return k, None  # it turns about itself
        way = way * joint.pitch + opens * arm
    if not np.linalg.norm(way) > 1e-6:
        return k, None
    facing = mesh.face_normals @ (way / np.linalg.norm(way)) >= FACING
    if not facing.any():
        return k, None
    centers, areas = mesh.triangles_center[facing], mesh.area_faces[facing]
    normal = areas @ mesh.face_normals[facing]  # of the plate
    height = centers @ (normal / np.linalg.norm(normal))
    size = float(np.ptp(obj.bounds, axis=0).max())
    order = np.argsort(height)
    upto = np.append(0, areas[order].cumsum())
    ends = [np.searchsorted(height[order], height[order] + sign * LEVEL * size) for sign in (-1, 1)]
    level = upto[ends[1]] - upto[ends[0]] >= PLATE * areas.sum()
    if not level.any():
        return k, None
    out = height > height[order][level].max() + STANDS * size
    if joint.rotates:
        far = _radii(obj, k, mesh.vertices).max()
        out &= _radii(obj, k, centers) >= FROM_HINGE * far
    ahead, pairs = np.flatnonzero(facing)[out], np.asarray(mesh.face_adjacency)
    pairs = pairs[np.isin(pairs, ahead).all(1)]
    pieces = trimesh.graph.connected_components(pairs, nodes=ahead, min_len=1)
    corners = [mesh.vertices[mesh.faces[piece]].reshape(-1, 3) for piece in pieces]
    long = [np.ptp(points, axis=0).max() >= SPAN * size for points in corners]
    pieces = [piece for piece, enough in zip(pieces, long, strict=True) if enough]
    if not pieces:
        return k, None
    best = max(pieces, key=lambda piece: mesh.area_faces[piece].sum())
    middle = np.average(mesh.triangles_center[best], axis=0, weights=mesh.area_faces[best])
    return int(faces[best[0]]), middle


def _on_surface(mesh: trimesh.Trimesh, point: np.ndarray) -> np.ndarray:
    """The point [3] of a surface that is nearest to ``point``."""
    vertices = np.ascontiguousarray(mesh.vertices, np.float64)
    faces = np.ascontiguousarray(mesh.faces, np.int64)
    return np.ravel(igl.point_mesh_squared_distance(point[None], vertices, faces)[2])


def _rim_middle(points: np.ndarray, far: np.ndarray, joint) -> np.ndarray:
    """The point farthest from the axis, moved along the axis to the middle of the rim about it."""
    first = points[far.argmax()]
    rim = points[far >= RIM * far.max()] @ joint.direction
    return first + joint.direction * float((rim.min() + rim.max()) / 2 - first @ joint.direction)


def _radii(obj: ArticulatedObject, k: int, points) -> np.ndarray:
    """Distances of points [n, 3] from the axis of part k's joint."""
    joint = obj.parts[k].joint
    return np.linalg.norm(np.cross(np.asarray(points) - joint.origin, joint.direction), axis=1)

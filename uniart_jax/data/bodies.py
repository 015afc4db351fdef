"""What of an object does not move, its body, as solids: what labels are read off (``data.legs``,
``data.panels``). No jax."""

from __future__ import annotations

from typing import Any

import manifold3d
import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.voxels.opening_direction import still_parts


def body_rows(obj: ArticulatedObject) -> list[int]:
    """The parts that no joint moves."""
    return still_parts([p.parent for p in obj.parts], [p.joint for p in obj.parts])


def body_solids(obj: ArticulatedObject) -> list[manifold3d.Manifold] | None:
    """The parts that no joint moves as Manifold has them, vertices at one place joined; None where
    a mesh is not closed."""
    solids = [as_manifold(obj.parts[k].mesh) for k in body_rows(obj)]
    return None if any(s.status() != manifold3d.Error.NoError for s in solids) else solids


def body_bounds(obj: ArticulatedObject) -> np.ndarray:
    """[2, 3] lower and upper corner of the box around the parts that no joint moves."""
    bounds = np.stack([obj.parts[k].mesh.bounds for k in body_rows(obj)])
    return np.stack([bounds[:, 0].min(0), bounds[:, 1].max(0)])


def frame_change(one: ArticulatedObject, other: ArticulatedObject) -> tuple[np.ndarray, np.ndarray]:
    """Scale and offset [3] that take places of one state's body to another state's."""
    (lower, upper), (to_lower, to_upper) = body_bounds(one), body_bounds(other)
    scale = (to_upper - to_lower) / (upper - lower)
    return scale, to_lower - lower * scale


def as_manifold(mesh: Any) -> manifold3d.Manifold:
    """A mesh as Manifold has it, vertices at one place joined; its status tells of faults."""
    vertices, row = np.unique(np.round(mesh.vertices, 6), axis=0, return_inverse=True)
    faces = row.ravel()[np.asarray(mesh.faces)]
    distinct = (faces != np.roll(faces, 1, axis=1)).all(1)
    return manifold3d.Manifold(
        manifold3d.Mesh(vertices.astype(np.float32), faces[distinct].astype(np.uint32))
    )

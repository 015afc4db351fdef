"""Other ways to convex shapes than ``export.collision``: boxes alone, one hull a part, or
coacd's."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence

import numpy as np
import trimesh
from manifold3d import Manifold

from uniart_jax.export.box_cover import fitted_box, own_frame
from uniart_jax.export.budget import PART_MOST
from uniart_jax.export.collision import HULL_VERTICES, collision_shapes, rebuilt
from uniart_jax.export.convex_split import triangles
from uniart_jax.export.formats import COLLISIONS, Collision
from uniart_jax.export.physics import Box, Shape
from uniart_jax.export.separation import as_solid

THRESHOLD = 0.05  # of coacd's concavity; its own default


def check_collision(kind: Collision) -> None:
    """Refuse (ValueError) an unknown kind of collision shapes, and coacd where it is not there."""
    if kind not in COLLISIONS:
        raise ValueError(f"--collision '{kind}': there are {', '.join(COLLISIONS)}")
    if kind == "coacd" and importlib.util.find_spec("coacd") is None:
        raise ValueError(
            "--collision coacd: coacd is not installed: pip install 'uniart_jax[coacd]'"
        )


def boxes_alone(shapes: Sequence[tuple[Shape, ...]]) -> list[tuple[Shape, ...]]:
    """Convex shapes of [K] parts as boxes that hold them, along each shape's own axes."""
    return [tuple(_as_box(shape) for shape in own) for own in shapes]


def hulls_alone(meshes: Sequence[trimesh.Trimesh], size: float) -> list[tuple[Shape, ...]]:
    """One convex shape a part: the hull of its mesh, of at most 64 points; flat parts are given a
    thickness.

    Args:
      meshes: [K] parts of one object, metres. size: longest side of the object, metres.
    """
    found = []
    for mesh in meshes:
        hull = Manifold.hull_points(np.asarray(mesh.vertices, np.float64))
        shape = None if hull.is_empty() else rebuilt(hull, size)
        if shape is None:
            (thick,) = collision_shapes([mesh], size)
            shape = rebuilt(Manifold.batch_hull([as_solid(s) for s in thick]), size) or thick[0]
        found.append((shape,))
    return found


def coacd_shapes(meshes: Sequence[trimesh.Trimesh], size: float) -> list[tuple[Shape, ...]]:
    """The pieces that coacd (Wei et al. 2022, github.com/SarahWeiii/CoACD) cuts each part into, at
    most 16 of at most 64 points each.

    Args:
      meshes: [K] parts of one object, metres. size: longest side of the object, metres.

    Raises:
      ValueError: coacd is not installed.
    """
    check_collision("coacd")
    import coacd  # type: ignore[reportMissingImports]

    coacd.set_log_level("error")
    found = []
    for k, mesh in enumerate(meshes):
        given = coacd.Mesh(np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int32))
        options = {"threshold": THRESHOLD, "max_convex_hull": PART_MOST, "seed": 0}
        options |= {"decimate": True, "max_ch_vertex": HULL_VERTICES}
        pieces = [
            Manifold.hull_points(np.asarray(v, np.float64))
            for v, _ in coacd.run_coacd(given, **options)
        ]
        own = [rebuilt(piece, size) for piece in pieces if not piece.is_empty()]
        solid = tuple(shape for shape in own if shape is not None)
        found.append(solid or hulls_alone([meshes[k]], size)[0])
    return found


def _as_box(shape: Shape) -> Box:
    if isinstance(shape, Box):
        return shape
    vertices, faces = triangles(as_solid(shape))
    frame = own_frame(vertices, faces)
    center, size = fitted_box(vertices, frame)
    return Box(center, size, frame)

"""The parts of an object as a physics engine needs them: mass, inertia, collision shapes, joint
dynamics."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import trimesh

from uniart_jax.export.collision import collision_shapes
from uniart_jax.export.collision_kinds import boxes_alone, coacd_shapes, hulls_alone
from uniart_jax.export.dynamics import further_dynamics, joint_dynamics
from uniart_jax.export.formats import Collision
from uniart_jax.export.mass import part_inertials
from uniart_jax.export.physics import Body
from uniart_jax.export.voxel_boxes import as_cells, is_rough
from uniart_jax.objects.object import ArticulatedObject


def make_bodies(
    obj: ArticulatedObject,
    meshes: Sequence[trimesh.Trimesh],
    *,
    density: float | None = None,
    mass: float | None = None,
    collision: Collision = "merged",
) -> tuple[Body, ...]:
    """Every part as a physics engine needs it, in metres (by ``obj.scale``), object frame at the
    shown state.

    Args:
      obj: any object.
      meshes: [K] the parts' surfaces as they are exported, object units, object frame; closed where
        they can be.
      density: kg / m^3 of all parts, default 500.
      mass: kg of the whole object, shared by the parts' volumes; instead of a density. No part is
        lighter than a thousandth of all (by density: or a gram).
      collision: shapes as close to the surface as can be ("merged", ``export.collision``, since
        they are joined later: ``export.budget``), boxes alone, coacd's pieces, or a hull a part.

    Raises:
      ValueError: another number of meshes than parts; both density and mass, or one that is not a
        positive number; coacd is asked for and not installed.
    """
    if len(meshes) != len(obj.parts):
        raise ValueError(f"make_bodies: {len(meshes)} meshes for {len(obj.parts)} parts")
    inertials = part_inertials(list(meshes), obj.scale, density, mass)
    lo, hi = obj.bounds
    size = float((hi - lo).max()) * obj.scale
    metric = [trimesh.Trimesh(m.vertices * obj.scale, m.faces, process=False) for m in meshes]
    if collision == "hull":
        shapes = hulls_alone(metric, size)
    elif collision == "coacd":
        shapes = coacd_shapes(metric, size)
    elif is_rough(obj):
        cells = as_cells(obj, meshes)
        shapes = (cells.boxes_alone() if collision == "boxes" else cells).shapes(obj.scale)
    else:
        shapes = collision_shapes(metric, size)
        shapes = boxes_alone(shapes) if collision == "boxes" else shapes
    bodies = [Body(*i, s, None) for i, s in zip(inertials, shapes, strict=True)]
    return with_joints(bodies, obj)


def with_joints(bodies: Sequence[Body], obj: ArticulatedObject) -> tuple[Body, ...]:
    """The bodies of an object whose joints were changed."""
    inertials = [(b.mass, b.center, b.inertia) for b in bodies]
    found = zip(
        bodies, joint_dynamics(obj, inertials), further_dynamics(obj, inertials), strict=True
    )
    return tuple(dataclasses.replace(b, dynamics=d, further=more) for b, d, more in found)

"""How an object stands in its files: on the floor, closed, and every coordinate grows as it opens.

An object is given at the state that its image shows, anywhere; people who put hundreds of assets
into a scene want all of them alike. So files have the origin below the middle, joint zero at rest,
and axes whose positive sense opens. What is rest is told by the limits alone
(``ArticulatedObject.rest``): a joint shown at one of its limits counts as closed there.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import trimesh
from scipy.optimize import linear_sum_assignment

from uniart_jax.export.atlas import Surface
from uniart_jax.export.formats import ORIGINS, Origin
from uniart_jax.export.physics import Body, Box, Shape
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject


@dataclasses.dataclass(frozen=True)
class Placement:
    """An object as it is written, and how it came to be there.

    Attributes:
      obj: at rest, object units; limits are (0, span), of continuous joints (-pi, pi). Further
        joints of a part (``Part.outer``, ``inner``) stand as they were shown.
      moved: [K, 4, 4] from every part's place as given to its place as written, object units.
      shown: [K] the state that was shown, in the coordinates that are written.
    """

    obj: ArticulatedObject
    moved: np.ndarray
    shown: np.ndarray


def place(obj: ArticulatedObject, origin: Origin | None = "floor") -> Placement:
    """The object closed (``rest``), its joints opening in their positive sense.

    Args:
      origin: where 0 lies: "floor" below the middle of the box of the object at rest, at the
        height of its lowest point; "centre": in the middle; None: where the object has it.

    Raises:
      ValueError: no such origin.
    """
    check_origin(origin)
    rest = obj.rest()
    closed = obj.shown_at(rest)
    turned = [p.parent >= 0 and _opens_down(p.joint) for p in closed.parts]
    parts = [part.with_joints(_opening) for part in closed.parts]
    shift = np.eye(4)
    shift[:3, 3] = _shift(closed.bounds, origin)
    placed = dataclasses.replace(closed, parts=tuple(parts)).transformed(shift)
    shown = np.where(turned, rest, -rest) + 0.0
    return Placement(placed, shift @ obj.forward_kinematics(rest), shown)


def check_origin(origin: str | None) -> None:
    """Refuse (ValueError) what is no origin."""
    if origin is not None and origin not in ORIGINS:
        raise ValueError(f"origin '{origin}': choose of {', '.join(ORIGINS)}")


def _opening(joint: Joint) -> Joint:
    """A joint at rest whose coordinate grows as it opens."""
    return joint.reversed() if _opens_down(joint) else joint


def _opens_down(joint: Joint) -> bool:
    """Whether a joint at rest can only go to negative coordinates."""
    return joint.type not in ("fixed", "continuous") and joint.limits[1] <= 0


def _shift(bounds: np.ndarray, origin: Origin | None) -> np.ndarray:
    """[3] what the object is moved by."""
    if origin is None:
        return np.zeros(3)
    middle = bounds.mean(0)
    return -np.array([middle[0], middle[1], bounds[0, 2] if origin == "floor" else middle[2]])


def moved_surfaces(surfaces: Sequence[Surface], moved: np.ndarray) -> tuple[Surface, ...]:
    """Surfaces moved by [K, 4, 4], object units."""
    return tuple(
        dataclasses.replace(s, vertices=trimesh.transform_points(s.vertices, matrix))
        for s, matrix in zip(surfaces, moved, strict=True)
    )


def moved_bodies(bodies: Sequence[Body], moved: np.ndarray, scale: float) -> tuple[Body, ...]:
    """Bodies (metres) moved by [K, 4, 4] (object units of ``scale`` metres); the dynamics of their
    joints are as they were."""
    found = []
    for body, given in zip(bodies, moved, strict=True):
        matrix = np.array(given)
        matrix[:3, 3] *= scale
        turn = matrix[:3, :3]
        found.append(
            dataclasses.replace(
                body,
                center=turn @ body.center + matrix[:3, 3],
                inertia=turn @ body.inertia @ turn.T,
                shapes=tuple(_moved(shape, matrix) for shape in body.shapes),
            )
        )
    return tuple(found)


def _moved(shape: Shape, matrix: np.ndarray) -> Shape:
    turn = matrix[:3, :3]
    if isinstance(shape, Box):
        rotation = turn @ shape.rotation
        # The same box with its axes in the order and sense in which they are turned least; no
        # mirror, since its trace is above 1.
        _, order = linear_sum_assignment(-np.abs(rotation))
        rotation = rotation[:, order] * np.where(np.diag(rotation[:, order]) < 0, -1.0, 1.0)
        center, size = turn @ shape.center + matrix[:3, 3], np.asarray(shape.size)[order]
        return dataclasses.replace(shape, center=center, size=size, rotation=rotation)
    vertices = trimesh.transform_points(shape.mesh.vertices, matrix)
    mesh = trimesh.Trimesh(vertices, shape.mesh.faces, process=False)
    return dataclasses.replace(shape, mesh=mesh)

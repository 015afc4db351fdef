"""Mass, centre of mass and inertia of closed meshes, made safe for physics engines.

Engines refuse or explode on zero masses, indefinite tensors and tensors that no distribution of mass can have, so what thin
and degenerate parts give is lifted to floors. Units: kilograms, metres.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import trimesh

DENSITY = 500.0  # kg/m^3: between solid wood (700) and hollow furniture (300)
MASS_FLOOR = 1e-3  # kg
GYRATION_FLOOR = 1e-3  # m; a principal moment is at least mass * GYRATION_FLOOR^2
MOMENT_FLOOR = 1e-8  # kg m^2


@dataclasses.dataclass(frozen=True)
class Inertial:
    """What a rigid body weighs and how it resists turning.

    Attributes:
      mass: kg.
      center: [3] centre of mass, metres, the mesh's frame.
      inertia: [3, 3] about the centre of mass, axes of the mesh's frame, kg m^2.
    """

    mass: float
    center: np.ndarray
    inertia: np.ndarray


def inertial(mesh: trimesh.Trimesh, density: float = DENSITY) -> Inertial:
    """The inertial of a mesh in metres, filled with ``density`` kg/m^3.

    A mesh that is not closed, or encloses next to nothing, is replaced by its convex hull, and a flat one by its box. The mass
    is at least ``MASS_FLOOR``; the tensor is positive definite and obeys the triangle inequality.
    """
    mass, center, tensor = _solid(mesh, density)
    if mass < MASS_FLOOR:
        tensor = tensor * (MASS_FLOOR / mass) if mass > 0 else tensor
        mass = MASS_FLOOR
    return Inertial(mass, center, physical(tensor, max(MOMENT_FLOOR, mass * GYRATION_FLOOR**2)))


def physical(inertia: np.ndarray, floor: float) -> np.ndarray:
    """The [3, 3] tensor nearest in kind that a body can have: principal moments >= ``floor``, none above the sum of the others."""
    moments, axes = np.linalg.eigh((inertia + inertia.T) / 2)  # ascending
    moments = np.maximum(moments, floor)
    lack = moments[2] - moments[0] - moments[1]
    slack = 1e-6 * moments[2]  # survives being rounded to text
    if lack > -slack:
        moments[:2] += (lack + slack) / 2
    tensor = (axes * moments) @ axes.T
    return (tensor + tensor.T) / 2


def _solid(mesh: trimesh.Trimesh, density: float) -> tuple[float, np.ndarray, np.ndarray]:
    """(mass, centre, tensor) of the mesh, of its hull, or of its box: the first that is sound."""
    box = mesh.bounds
    box_volume = float(np.prod(box[1] - box[0]))
    candidates = [lambda: mesh] if mesh.is_watertight else []
    candidates.append(lambda: mesh.convex_hull)
    for candidate in candidates:
        try:
            solid = candidate()
        except Exception:  # qhull's error class for flat input is private
            continue
        with np.errstate(divide="ignore", invalid="ignore"):  # no volume: refused below
            found = trimesh.triangles.mass_properties(np.asarray(solid.triangles), density=density)
        volume, center = abs(float(found["volume"])), np.asarray(found["center_mass"])
        tensor = np.asarray(found["inertia"]) * (1 if found["volume"] > 0 else -1)
        inside = np.all(center >= box[0] - 1e-9) and np.all(center <= box[1] + 1e-9)
        if volume > 1e-3 * box_volume and np.isfinite(tensor).all() and inside:
            return volume * density, center, tensor
    size = np.maximum(box[1] - box[0], GYRATION_FLOOR)
    mass = float(np.prod(size)) * density
    squares = size**2
    return mass, box.mean(0), np.diag(mass / 12 * (squares.sum() - squares))

"""Mass, centre of mass and inertia of solids of even density, possible for every mesh."""

from __future__ import annotations

import numpy as np
import trimesh

DENSITY = 500.0  # kg / m^3, light wood
MIN_MASS = 1e-3  # kg
MIN_SHARE = 1e-3  # of the object's mass: a lighter part makes its solver stiff
MIN_GYRATION = 1e-3  # m: no part's mass is closer together than this, whatever its mesh says

Inertial = tuple[float, np.ndarray, np.ndarray]


def check_weights(density: float | None, mass: float | None) -> None:
    """Refuse both at once (ValueError), and what is not a positive number."""
    if density is not None and mass is not None:
        raise ValueError("mass: give a density or a mass, not both")
    for name, value in (("density", density), ("mass", mass)):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise ValueError(f"mass: the {name} must be a positive number, got {value:g}")


def part_inertials(
    meshes: list[trimesh.Trimesh], scale: float, density: float | None, mass: float | None
) -> list[Inertial]:
    """Mass, centre of mass and inertia tensor about it of every part, as solids of even density.

    Args:
      meshes: [K], object units; the volume counts of what is closed, else its convex hull's, else
        its box's.
      scale: metres per unit.
      density: kg / m^3 of all parts, default 500. No part is lighter than a thousandth of all, or 1
        g.
      mass: kg of the whole object, shared by the volumes; instead of a density. The masses add up
        to it; no part is lighter than a
        thousandth of it (of more than 500 parts: than half the mean).

    Returns:
      [K] (kg, [3] m, [3, 3] kg m^2), object frame; positive definite with a + b > c for the
      principal moments.

    Raises:
      ValueError: both are given, or one is not positive and finite.
    """
    check_weights(density, mass)
    properties = [_solid(mesh, scale).mass_properties for mesh in meshes]
    volumes = np.array([float(p.mass) for p in properties])
    total = float(mass if mass is not None else volumes.sum() * (density or DENSITY))
    masses = volumes / volumes.sum() * total
    if mass is None:
        masses = np.maximum(masses, max(MIN_MASS, MIN_SHARE * total))
    else:
        masses = _lifted(masses, min(MIN_SHARE, 0.5 / len(masses)) * total)
    return [
        _possible(float(m), float(p.mass), np.asarray(p.center_mass), np.asarray(p.inertia))
        for m, p in zip(masses, properties, strict=True)
    ]


def _lifted(masses: np.ndarray, least: float) -> np.ndarray:
    """Masses of the same sum, none less than ``least``: the light ones take from the others."""
    total, light = masses.sum(), masses < least
    while True:  # what gives can become light itself
        left = masses / masses[~light].sum() * (total - least * light.sum())
        lighter = light | (left < least)
        if (lighter == light).all():
            return np.where(light, least, left)
        light = lighter


def _possible(mass: float, volume: float, center: np.ndarray, inertia: np.ndarray) -> Inertial:
    """The inertial of a body of this mass and of a solid's shape (volume, and inertia at density
    1), held from below."""
    inertia = inertia * (mass / volume)
    # I = tr(S) 1 - S with S the second moments: any positive S gives a possible body, so it is S
    # that is held from below.
    second = np.trace(inertia) / 2 * np.eye(3) - inertia
    values, vectors = np.linalg.eigh((second + second.T) / 2)
    second = (vectors * np.maximum(values, mass * MIN_GYRATION**2)) @ vectors.T
    return mass, center, np.trace(second) * np.eye(3) - second


def _solid(mesh: trimesh.Trimesh, scale: float) -> trimesh.Trimesh:
    """The mesh in metres if it is closed, else its hull, else its box."""
    solid = trimesh.Trimesh(mesh.vertices * scale, mesh.faces)  # merges the seams of a texture
    if _is_solid(solid):
        return solid
    extents, center = np.maximum(solid.extents, MIN_GYRATION), solid.bounds.mean(0)
    try:
        with np.errstate(all="ignore"):
            solid = solid.convex_hull
    except Exception:  # qhull on a flat or tiny mesh; the check below sees it
        solid = trimesh.Trimesh()
    if not _is_solid(solid):
        solid = trimesh.creation.box(extents).apply_translation(center)
    return solid


def _is_solid(mesh: trimesh.Trimesh) -> bool:
    with np.errstate(all="ignore"):  # a flat mesh has no centre of mass
        return bool(len(mesh.faces)) and bool(mesh.is_volume) and mesh.volume > MIN_GYRATION**3

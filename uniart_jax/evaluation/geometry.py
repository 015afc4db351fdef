"""Distances between shapes: Chamfer distance of surfaces and volumetric overlap of parts. Object
units, longest side 1."""

from __future__ import annotations

import igl
import numpy as np
import trimesh

from uniart_jax.evaluation.nearest import chamfer
from uniart_jax.evaluation.parts import match_parts
from uniart_jax.objects.object import ArticulatedObject

SURFACE_POINTS = 20_000
VOLUME_POINTS = 20_000


def surface_points(
    mesh: trimesh.Trimesh, number: int = SURFACE_POINTS, seed: int = 0
) -> np.ndarray:
    """[number, 3] points uniform on the surface, deterministic by seed; of a mesh without area,
    uniform over its faces."""
    weight = mesh.area_faces if mesh.area > 0 else np.ones(len(mesh.faces))
    points, _ = trimesh.sample.sample_surface(mesh, number, face_weight=weight, seed=seed)
    return np.asarray(points)


def object_chamfer(
    predicted: ArticulatedObject,
    reference: ArticulatedObject,
    predicted_q: np.ndarray | None = None,
    reference_q: np.ndarray | None = None,
) -> float:
    """Chamfer distance of two objects' whole surfaces, each at its own joint state (default:
    shown)."""
    points = (
        surface_points(predicted.mesh(predicted_q), seed=0),
        surface_points(reference.mesh(reference_q), seed=1),
    )
    return float(chamfer(*points))


def mesh_iou(
    a: trimesh.Trimesh, b: trimesh.Trimesh, number: int = VOLUME_POINTS, seed: int = 0
) -> float:
    """Volumetric overlap by winding number at ``number`` points uniform in the union of the two
    boxes."""
    lo, hi = np.minimum(a.bounds[0], b.bounds[0]), np.maximum(a.bounds[1], b.bounds[1])
    points = np.random.default_rng(seed).uniform(lo, hi, (number, 3))
    inside = [
        igl.fast_winding_number(
            np.asarray(m.vertices, float), np.asarray(m.faces, np.int64), points
        )
        > 0.5
        for m in (a, b)
    ]
    union = (inside[0] | inside[1]).sum()
    return float((inside[0] & inside[1]).sum() / union) if union else 0.0


def part_iou(predicted: ArticulatedObject, reference: ArticulatedObject) -> np.ndarray:
    """[K] volumetric overlap of each reference part with its match (by box); 0 where unmatched."""
    match, _ = match_parts(predicted.boxes, reference.boxes)
    return np.array(
        [
            mesh_iou(predicted.parts[match[k]].mesh, part.mesh) if match[k] >= 0 else 0.0
            for k, part in enumerate(reference.parts)
        ]
    )

"""Voxels that surfaces touch at 64^3, from procedural objects: what the benchmarks attend over."""

from __future__ import annotations

import numpy as np

from uniart_jax.procedural import SEEN_FAMILIES, generate
from uniart_jax.voxels.overlap import touched_cells


def surface(family: str, seed: int, resolution: int = 64) -> np.ndarray:
    """[V, 3] int32 voxel indices, sorted."""
    obj = generate(family, seed)
    triangles = np.concatenate([part.mesh.triangles for part in obj.parts])
    _, cells = touched_cells((triangles + 0.5) * resolution, resolution)
    return np.unique(cells, axis=0).astype(np.int32)


def surface_of(voxels: int, resolution: int = 64) -> np.ndarray:
    """[V, 3] of the object, of the first seeds of each family, whose number of voxels is nearest to
    ``voxels``."""
    found = [surface(family, seed, resolution) for family in SEEN_FAMILIES for seed in range(4)]
    return min(found, key=lambda coords: abs(len(coords) - voxels))

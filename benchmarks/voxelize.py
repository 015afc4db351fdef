"""Time of the prepare step of one object, and what exactness costs: our voxeliser beside a box tree
and trimesh's voxels, same run.

    OMP_NUM_THREADS=1 taskset -c 0 python benchmarks/voxelize.py [--count 14] [--resolution 32]

Prints CPU milliseconds per object (median; on one idle core: wall milliseconds) of

* ``voxelize``: everything, and two pictures of 128^2 at 4 samples a pixel, which records hold
  beside it;
* ``box tree``: only distances and signs of the same sub-cells from ``igl`` (squared distance and
  fast winding number of every part), the direct way, without thin parts, owners' shares or colours,
  and the largest difference of the distances from ours;
* ``trimesh``: only the active voxels, by ``Trimesh.voxelized`` (subdivision), and the share of the
  exact ones that it misses.
"""

from __future__ import annotations

import argparse
import time

import igl
import numpy as np

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.objects.states import sample_state
from uniart_jax.procedural import HELD_OUT_SEED, SEEN_FAMILIES, generate
from uniart_jax.visual.render import render, sample_camera
from uniart_jax.voxels.grid import SDF_CLIP, PartGrid, subcell_centers
from uniart_jax.voxels.voxelize import voxelize


def timed(function, *arguments):
    """(CPU milliseconds, result)."""
    begin = time.process_time()
    result = function(*arguments)
    return 1e3 * (time.process_time() - begin), result


def two_views(obj: ArticulatedObject, seed: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(2):
        render(obj, sample_camera(rng, obj.bounds), 128)


def by_tree(obj: ArticulatedObject, grid: PartGrid) -> np.ndarray:
    """[V, r^3] signed distance in sub-cells, every part asked everywhere."""
    centers = subcell_centers(grid.coords, grid.resolution, grid.subdivisions)
    points = np.ascontiguousarray(centers.reshape(-1, 3))
    smallest = np.full(len(points), np.inf)
    for part in obj.parts:
        vertices = np.ascontiguousarray(part.mesh.vertices, dtype=np.float64)
        faces = np.ascontiguousarray(part.mesh.faces, dtype=np.int64)
        squared, _, _ = igl.point_mesh_squared_distance(points, vertices, faces)
        inside = np.abs(igl.fast_winding_number(vertices, faces, points)) > 0.5
        smallest = np.minimum(smallest, np.where(inside, -1, 1) * np.sqrt(squared))
    sdf = smallest * grid.resolution * grid.subdivisions
    return np.clip(sdf, -SDF_CLIP, SDF_CLIP).reshape(grid.sdf.shape)


def by_trimesh(obj: ArticulatedObject, resolution: int) -> set[tuple[int, ...]]:
    """Voxels by trimesh, whose voxel (i, j, k) is centred at (i, j, k) pitches: the mesh is moved
    so that the two grids agree."""
    found = set()
    for part in obj.parts:
        mesh = part.mesh.copy()
        mesh.apply_translation([0.5 - 0.5 / resolution] * 3)
        index = np.round(mesh.voxelized(1 / resolution).points * resolution).astype(int)
        found |= set(map(tuple, index.clip(0, resolution - 1)))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=14)
    parser.add_argument("--resolution", type=int, default=32)
    options = parser.parse_args()
    rows = []
    for i in range(options.count):
        family = SEEN_FAMILIES[i % len(SEEN_FAMILIES)]
        obj = generate(family, HELD_OUT_SEED + i)
        obj = sample_state(obj, np.random.default_rng(i))
        if i == 0:
            two_views(obj, 0), voxelize(obj, options.resolution)  # imports, allocator
        ours, grid = timed(voxelize, obj, options.resolution)
        views, _ = timed(two_views, obj, i)
        tree, sdf = timed(by_tree, obj, grid)
        peer, active = timed(by_trimesh, obj, options.resolution)
        exact = set(map(tuple, grid.coords.tolist()))
        # Where no part is thin both must agree; thin parts are thicker in ours by the rule.
        same = float((np.abs(sdf - grid.sdf) < 1e-3).mean())
        larger = float((grid.sdf - sdf).max())
        missed = len(exact - active) / len(exact)
        rows.append((len(grid.coords), ours, views, tree, peer, missed, same, larger))
        print(
            f"{family:18s} {len(obj.parts):2d} parts {len(grid.coords):6d} voxels: voxelize "
            f"{ours:5.0f} ms, 2 views {views:4.0f} ms, box tree {tree:6.0f} ms, trimesh "
            f"{peer:5.0f} ms (misses {missed:.1%}), equal {same:.1%}, above by at most "
            f"{larger:.1e}"
        )
    voxels, ours, views, tree, peer, missed, _, _ = np.median(np.array(rows), axis=0)
    print(
        f"median: {voxels:.0f} voxels, voxelize {ours:.0f} ms + 2 views {views:.0f} ms = "
        f"{1e3 / (ours + views):.2f} objects/s a core; box tree / voxelize {tree / ours:.1f}x; "
        f"trimesh {peer:.0f} ms, misses {missed:.1%} of the exact voxels"
    )


if __name__ == "__main__":
    main()

"""What making records costs, and what reading them back gives: the steps of ``uniart prepare`` and
of the input pipeline, beside others' voxels in one run.

    OMP_NUM_THREADS=1 python benchmarks/prepare.py [--assets FOLDER] [--front=-x] [--count 12]
    [--repeats 3] [--out out/bench]

* ``objects``: reading, repairing, normalising and voxelising one object at R = 64, r = 4 in one
  process, without pictures. Gate: 0.5 objects/s a core. With ``--assets``, a folder of URDF, MJCF
    or PartNet-Mobility objects; otherwise the procedural ones (which cost no reading). Peak memory
    is the worker's. Gate: 1 GiB. ``objects_per_cpu_second`` is the rate on a core that nothing else
      uses.
* peers, for their active voxels alone: ``open3d``
  (``VoxelGrid.create_from_triangle_mesh_within_bounds``, if installed) and ``trimesh``
  (``voxelized``), and the share of the exact voxels that each misses.
* ``views``: pictures of 256^2 with 2 x 2 samples a pixel, two processes. Gate: 10 a second.
* ``batches``: of 16 records at R = 32, r = 4 from ArrayRecord shards through Grain, padded, with
  attention plans. Gate: 20 a second.
"""

from __future__ import annotations

import argparse
import itertools
import resource
import tempfile
import time
from pathlib import Path

import numpy as np
from results import report
from voxelize import by_trimesh

from uniart_jax.config import DataConfig, GridConfig, ModelConfig, UniArtVAEConfig
from uniart_jax.data.batches import voxel_batches
from uniart_jax.data.folder import Settings
from uniart_jax.data.memory import release
from uniart_jax.data.prepare import prepare_procedural
from uniart_jax.data.sources import Entry, ProceduralEntries, find_entries, load_entry
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import HELD_OUT_SEED, SEEN_FAMILIES
from uniart_jax.runtime.processes import map_ordered, process_pool
from uniart_jax.visual.render import render, sample_camera
from uniart_jax.voxels.voxelize import voxelize


def one_object(settings: Settings, entry: Entry) -> dict | str:
    """Seconds of reading and of voxelising; what is wrong where it cannot be made."""
    begin, cpu = time.perf_counter(), time.process_time()
    try:
        obj = load_entry(entry, settings).normalized()
        if settings.source != "procedural":
            release()  # as the workers of ``prepare`` do
        read = time.perf_counter()
        grid = voxelize(obj, settings.resolution, settings.subdivisions)
    except ValueError as error:
        return f"{entry.key}: {error}"
    done = time.perf_counter()
    return {
        "object": entry.key,
        "faces": sum(len(p.mesh.faces) for p in obj.parts),
        "voxels": len(grid.coords),
        "read s": read - begin,
        "voxels s": done - read,
        "cpu s": time.process_time() - cpu,
        "peak GiB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
    }


def peers(settings: Settings, entry: Entry) -> dict:
    """Others' active voxels, in a process of its own: their libraries and memory are theirs."""
    obj = load_entry(entry, settings).normalized()
    exact = set(map(tuple, voxelize(obj, settings.resolution, 1).coords.tolist()))
    row = {}
    for name, voxels in (("open3d", by_open3d), ("trimesh", by_trimesh)):
        begin = time.perf_counter()
        found = voxels(obj, settings.resolution)
        row[f"{name} s"] = time.perf_counter() - begin if found is not None else np.nan
        row[f"{name} misses"] = len(exact - found) / len(exact) if found is not None else np.nan
    return row


def by_open3d(obj: ArticulatedObject, resolution: int) -> set[tuple[int, ...]] | None:
    try:
        import open3d
    except (ImportError, OSError):
        return None
    found = set()
    for part in obj.parts:
        mesh = open3d.geometry.TriangleMesh(
            open3d.utility.Vector3dVector(part.mesh.vertices),
            open3d.utility.Vector3iVector(part.mesh.faces),
        )
        grid = open3d.geometry.VoxelGrid.create_from_triangle_mesh_within_bounds(
            mesh, 1 / resolution, min_bound=(-0.5,) * 3, max_bound=(0.5,) * 3
        )
        found |= {tuple(v.grid_index) for v in grid.get_voxels()}
    return found


def some_views(settings: Settings, entry: Entry, count: int) -> int:
    obj = load_entry(entry, settings).normalized()
    rng = np.random.default_rng(0)
    for _ in range(count):
        render(obj, sample_camera(rng), size=256, samples=4)
    return count


def views_per_second(settings: Settings, entries, count: int) -> float:
    """Two processes; reading the objects is not counted: it is measured with no views and taken
    off."""
    with process_pool(2) as submit:
        seconds = []
        for views in (1, 0, count):  # the first time imports are counted too
            begin = time.perf_counter()
            work = lambda f, e, v=views: submit(f, settings, e, v)  # noqa: E731
            list(map_ordered(work, some_views, entries, 4))
            seconds.append(time.perf_counter() - begin)
    return count * len(entries) / (seconds[2] - seconds[1])


def batches_per_second(folder: Path, repeats: int) -> list[float]:
    grid = GridConfig(32, 4)
    vae = UniArtVAEConfig(attention="serial", window=256, visual_channels=0, part_segment=256)
    model = ModelConfig(grid=grid, uniart_vae=vae)
    records = prepare_procedural(folder, 64, grid=grid, views=1, image_size=16, progress=False)
    data = DataConfig(records=str(records), voxel_buckets=(8192, 12288), workers=0)
    batches = iter(voxel_batches(records, data, model, 16))
    next(batches)
    rates = []
    for _ in range(repeats):
        begin = time.perf_counter()
        for _ in itertools.islice(batches, 40):
            pass
        rates.append(40 / (time.perf_counter() - begin))
    return rates


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--assets", type=Path)
    parser.add_argument("--front", default="-x")
    parser.add_argument("--count", type=int, default=12)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--out", type=Path, default=Path("out/bench"))
    options = parser.parse_args()
    if options.assets is None:
        settings = Settings(families=SEEN_FAMILIES, start_seed=HELD_OUT_SEED, resolution=64)
        entries = list(ProceduralEntries(SEEN_FAMILIES, HELD_OUT_SEED, options.count))
    else:
        settings = Settings(
            "urdf", root=str(options.assets), front=options.front, resolution=64, allow_outside=True
        )
        found = find_entries(options.assets, "urdf")
        step = max(1, len(found) // options.count)
        entries = found[::step][: options.count]
    rows = []
    with process_pool(2) as submit:  # one at a time, in a worker that lives through all of them
        submit(one_object, settings, entries[0]).result()
        for entry in entries:
            row = submit(one_object, settings, entry).result()
            print(row) if isinstance(row, str) else rows.append(row)
    by_key = {entry.key: entry for entry in entries}
    with process_pool(2) as submit:
        for row in rows:
            row |= submit(peers, settings, by_key[row["object"]]).result()
    total = sum(row["read s"] + row["voxels s"] for row in rows)
    good = [row["object"] for row in rows]
    views = views_per_second(settings, [e for e in entries if e.key in good][:8], 6)
    with tempfile.TemporaryDirectory() as folder:
        rates = batches_per_second(Path(folder) / "records", options.repeats)
    report(
        "prepare",
        rows,
        options.out,
        objects_per_second_a_core=len(rows) / total,
        objects_per_cpu_second=len(rows) / sum(row["cpu s"] for row in rows),
        peak_gib=max(row["peak GiB"] for row in rows),
        views_per_second_two_cores=views,
        batches_of_16_per_second=float(np.median(rates)),
    )


if __name__ == "__main__":
    main()

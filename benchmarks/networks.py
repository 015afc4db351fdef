"""Time of one training step (value and gradient) of every network at nano size, on this machine,
with synthetic data.

    OMP_NUM_THREADS=1 XLA_FLAGS=--xla_cpu_multi_thread_eigen=false taskset -c 0 python
    benchmarks/networks.py [network ...]

Prints compile seconds, CPU ms a step (on one core of an idle machine: wall ms), samples a second,
and the rate by XLA's flop count.
"""

from __future__ import annotations

import argparse
import time

import jax
import jax.numpy as jnp
import numpy as np

from uniart_jax.config import NETWORKS, ModelConfig, load_config
from uniart_jax.models.image_encoder import pixel_width
from uniart_jax.models.network import build
from uniart_jax.nn.grids import flow_plan
from uniart_jax.nn.voxel_plans import voxel_plans
from uniart_jax.voxels.camera_code import MEAN_CAMERA_CODE
from uniart_jax.voxels.part_table import PartTable, part_table
from uniart_jax.voxels.typed_batches import VoxelBatch

VOXELS = 6700  # usual active voxels of an object at 32^3


def voxel_batch(
    model: ModelConfig, items: int, width: int, count: int, seed: int = 0
) -> VoxelBatch:
    """A batch of ``items`` solid-ish objects of ``count`` voxels padded to ``width``, parts cut by
    x."""
    rng = np.random.default_rng(seed)
    side, cells = model.grid.resolution, model.grid.subdivisions**3
    coords = np.zeros((items, width, 3), np.int32)
    for b in range(items):
        # whole random cubes of 4^3, as real surfaces are clustered
        cubes = rng.permutation((side // 4) ** 3)[: -(-count // 48)]
        base = np.stack(np.unravel_index(cubes, (side // 4,) * 3), -1) * 4
        inner = np.stack(np.meshgrid(*[np.arange(4)] * 3, indexing="ij"), -1).reshape(-1, 3)
        voxels = (base[:, None] + inner).reshape(-1, 3)
        chosen = voxels[rng.permutation(len(voxels))[:count]]
        coords[b, : len(chosen)] = chosen[np.lexsort(chosen.T[::-1])]
    k = model.grid.max_parts
    part = np.minimum(coords[..., 0] // 4, k - 1).astype(np.int32)
    f = lambda *s: rng.normal(size=s).astype(np.float32)  # noqa: E731
    batch = VoxelBatch(
        coords=coords,
        counts=np.full(items, count, np.int32),
        sdf=f(items, width, cells),
        color=rng.random((items, width, cells, 3), np.float32),
        owner=np.repeat(part[..., None], cells, -1),
        voxel_part=part,
        boxes=f(items, k, 6),
        codes=f(items, k, 9),
        parents=np.zeros((items, k), np.int32),
        part_counts=np.full(items, min(k, side // 4), np.int32),
    )
    if model.uniart_vae.visual_channels:
        batch = batch._replace(visual=f(items, width, model.uniart_vae.visual_channels))
    voxels, vae = (batch.coords, batch.counts), model.uniart_vae
    plans = voxel_plans(*voxels, vae, model.grid, voxel_part=batch.voxel_part)
    if model.uniart_vae.layout_channels:
        batch = batch._replace(layout=layouts(model, items))
    return batch._replace(plans=plans)


def case(name: str, model: ModelConfig, items: int):
    """(loss of parameters and inputs, inputs)."""
    network = build(name, model)
    key = jax.random.key(0)
    normal = lambda *s: jax.random.normal(key, s)  # noqa: E731
    mean_square = lambda tree: sum(jnp.square(x).mean() for x in jax.tree.leaves(tree))  # noqa: E731
    e = model.image_encoder
    if name == "image_encoder":
        image = jnp.zeros((items, e.image_size, e.image_size, 3))
        return network, lambda p, image: mean_square(network.apply(p, image)), (image,)
    if name == "structure_vae":
        occupancy = (normal(items, *[model.grid.resolution] * 3) > 0).astype(jnp.float32)
        return network, lambda p, x: mean_square(network.apply(p, x, key)), (occupancy,)
    width, count = 8192, VOXELS
    if name == "uniart_vae":
        batch = jax.tree.map(jnp.asarray, voxel_batch(model, items, width, count))
        voxels = jax.random.randint(key, (items, 1024), 0, count)
        return network, lambda p, b: mean_square(network.apply(p, b, key, voxels)), (batch,)
    draws = 2
    side = e.image_size // (e.stem_stride * 2 ** (len(e.stem_channels) - 1))
    tokens = normal(items, side**2, e.width)
    volume = normal(items, *[e.volume_resolution] * 3, e.volume_channels + 3)
    t = jax.random.uniform(key, (items * draws,))
    side = e.image_size // e.stem_stride
    cameras = jnp.broadcast_to(jnp.asarray(MEAN_CAMERA_CODE), (items, 1, len(MEAN_CAMERA_CODE)))
    views, layout = (normal(items, 1, side, side, pixel_width(e)), cameras), layouts(model, items)
    if name == "structure_flow":
        s = model.structure_vae
        side = model.grid.resolution // s.patch_size // 2 ** (len(s.channels) - 1)
        x = normal(items * draws, side, side, side, s.latent_channels)

        def structure_loss(p, x, t, tokens, volume, views, layout):
            return mean_square(network.apply(p, x, t, tokens, volume, views=views, layout=layout))

        return network, structure_loss, (x, t, tokens, volume, views, layout)
    batch = voxel_batch(model, items, width, count)
    plan = jax.tree.map(
        jnp.asarray, flow_plan(batch.coords, batch.counts, model.latent_flow, model.grid)
    )
    x = normal(items * draws, width, model.uniart_vae.latent_channels)
    coords, counts = jnp.asarray(batch.coords), jnp.asarray(batch.counts)

    def loss(p, x, t, tokens, volume, views, layout, coords, counts, plan):
        given = {"views": views, "layout": layout, "coords": coords, "counts": counts, "plan": plan}
        return mean_square(network.apply(p, x, t, tokens, volume, **given))

    return network, loss, (x, t, tokens, volume, views, layout, coords, counts, plan)


def layouts(model: ModelConfig, items: int) -> PartTable:
    """Part tables of six parts an item."""
    rng = np.random.default_rng(0)
    table = {
        "boxes": np.concatenate([rng.uniform(-0.3, 0.3, (6, 3)), rng.uniform(0.1, 0.5, (6, 3))], 1),
        "codes": rng.normal(size=(6, 9)),
        "parents": np.zeros(6, np.int32),
        "colors": rng.random((6, 3)),
    }
    return jax.tree.map(jnp.asarray, part_table([table] * items, model.grid.max_parts))


def measure(name: str, model: ModelConfig, items: int, repeats: int = 3) -> None:
    network, loss, inputs = case(name, model, items)
    params = jax.jit(network.init)(jax.random.key(0))
    start = time.perf_counter()
    step = jax.jit(jax.value_and_grad(loss)).lower(params, *inputs).compile()
    compiled = time.perf_counter() - start
    jax.block_until_ready(step(params, *inputs))
    times = []
    for _ in range(repeats):
        start = time.process_time()  # others may share the core
        jax.block_until_ready(step(params, *inputs))
        times.append(time.process_time() - start)
    samples = inputs[0].shape[0] if name != "uniart_vae" else items
    size = sum(x.size for x in jax.tree.leaves(params)) / 1e6
    flops = (step.cost_analysis() or {}).get("flops", 0.0)
    best = min(times)
    print(
        f"{name:15s} {size:6.2f} M parameters   compile {compiled:5.1f} s   {1e3 * best:8.1f} "
        f"ms/step   {samples / best:7.1f} samples/s   {flops / samples / 1e9:6.2f} GFLOP/sample   "
        f"{flops / best / 1e9:6.1f} GF/s",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("networks", nargs="*", default=NETWORKS)
    arguments = parser.parse_args()
    items = dict(image_encoder=16, structure_vae=16, uniart_vae=2, structure_flow=16, latent_flow=4)
    for name in arguments.networks or NETWORKS:
        measure(name, load_config("nano").model, items[name])


if __name__ == "__main__":
    main()

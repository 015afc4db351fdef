"""A model of every network at toy size, and random parameters and batches for it."""

import dataclasses
import functools

import jax
import numpy as np

from uniart_jax.config import (
    FlowConfig,
    GridConfig,
    ImageEncoderConfig,
    ModelConfig,
    StructureVAEConfig,
    UniArtVAEConfig,
)
from uniart_jax.models import network
from uniart_jax.models.image_encoder import pixel_width
from uniart_jax.nn.grids import flow_plan
from uniart_jax.nn.voxel_plans import voxel_plans
from uniart_jax.voxels.camera_code import MEAN_CAMERA_CODE
from uniart_jax.voxels.part_table import PartTable
from uniart_jax.voxels.typed_batches import VoxelBatch

# the same network for the same model: what ``jax.jit`` has compiled of it is used again
build = functools.cache(network.build)
FLOW = FlowConfig(
    model_channels=24,
    num_blocks=2,
    num_heads=2,
    cond_channels=16,
    volume_channels=5,
    volume_resolution=4,
    patch_size=2,
    prediction="data",
)
MODEL = ModelConfig(
    grid=GridConfig(resolution=8, subdivisions=2, max_parts=4),
    image_encoder=ImageEncoderConfig(
        image_size=32,
        stem_stride=4,
        stem_channels=(4, 8),
        width=16,
        num_blocks=1,
        num_heads=2,
        volume_tokens=2,
        volume_blocks=1,
        volume_resolution=4,
        volume_channels=5,
        target_resolution=8,
        sketch_width=12,
    ),
    structure_vae=StructureVAEConfig(
        patch_size=2, channels=(6, 8), latent_channels=3, num_res_blocks=1, num_res_blocks_middle=1
    ),
    uniart_vae=UniArtVAEConfig(
        width=24,
        num_blocks=2,
        num_heads=2,
        latent_channels=4,
        attention="serial",
        window=16,
        visual_channels=0,
        geometry_channels=12,
        articulation_channels=8,
        part_segment=16,
    ),
    structure_flow=dataclasses.replace(FLOW, patch_size=1),
    latent_flow=dataclasses.replace(FLOW, stem="patch"),
)


def vae_config(**changes):
    return dataclasses.replace(MODEL, uniart_vae=dataclasses.replace(MODEL.uniart_vae, **changes))


def latent_config(**changes):
    return dataclasses.replace(MODEL, latent_flow=dataclasses.replace(MODEL.latent_flow, **changes))


one_block = functools.partial(latent_config, num_blocks=1)


def put(values, dtype=np.float32):
    """An array of JAX's. ``jnp.asarray`` would compile a program a shape to convert it."""
    return jax.device_put(np.asarray(values, dtype))


def init(network, seed=0):
    """Parameters without zeros (zero-initialised layers would hide what flows through them)."""
    shapes = network.abstract()
    rng = np.random.default_rng(seed)
    return jax.tree.map(lambda s: put(rng.normal(0, 0.2, s.shape)), shapes)


def voxel_batch(model, width=70, seed=0, garbage=None):
    rng = np.random.default_rng(seed)
    side, cells, k = model.grid.resolution, model.grid.subdivisions**3, model.grid.max_parts
    counts = np.array([61, 37], np.int32)
    shape = (2, 70)
    coords = np.zeros((*shape, 3), np.int32)
    for b, n in enumerate(counts):
        chosen = np.sort(rng.choice(side**3, n, replace=False))
        coords[b, :n] = np.stack(np.unravel_index(chosen, (side,) * 3), -1)
    f = lambda *s: rng.normal(size=s).astype(np.float32)  # noqa: E731
    batch = dict(
        coords=coords,
        sdf=f(*shape, cells),
        color=f(*shape, cells, 3),
        owner=rng.integers(0, k, (*shape, cells)).astype(np.int32),
        voxel_part=rng.integers(0, k, shape).astype(np.int32),
        visual=f(*shape, 3),
        part_feature=f(*shape, 5),
        latent=f(*shape, 4),
    )
    valid = np.arange(70) < counts[:, None]
    for name, value in batch.items():
        filled = np.full((2, width, *value.shape[2:]), 0, value.dtype)
        filled[:, :70] = np.where(valid.reshape(*shape, *[1] * (value.ndim - 2)), value, 0)
        if garbage is not None and value.dtype == np.float32:
            filled[np.arange(width) >= counts[:, None]] = garbage
        batch[name] = filled
    batch |= dict(counts=counts, boxes=f(2, k, 6), codes=f(2, k, 9))
    batch["parents"] = rng.integers(0, k, (2, k)).astype(np.int32)
    voxels, part = (batch["coords"], counts), batch["voxel_part"]
    batch["plans"] = voxel_plans(*voxels, model.uniart_vae, model.grid, voxel_part=part)
    return VoxelBatch(**batch)


def finite(tree):
    return all(np.isfinite(np.asarray(x)).all() for x in jax.tree.leaves(tree))


def flow_arguments(draws=1, seed=0):
    rng = np.random.default_rng(seed)
    f = lambda *s: put(rng.normal(size=s))  # noqa: E731
    return f(2, 9, 16), f(2, 4, 4, 4, 5), put(rng.random(2 * draws))


def flow_views(views=2, seed=0):
    """Maps and cameras that flows read (``pixel_channels``) of two items."""
    rng = np.random.default_rng(seed)
    maps = rng.normal(size=(2, views, 8, 8, pixel_width(MODEL.image_encoder)))
    cameras = np.array(MEAN_CAMERA_CODE) + rng.normal(0, 0.1, (2, views, 7))
    return put(maps), put(cameras)


def flow_table(seed=0):
    """Part tables of two items (``layout_channels``): four parts and three of five rows."""
    rng = np.random.default_rng(seed)
    boxes = np.concatenate(
        [rng.uniform(-0.3, 0.3, (2, 5, 3)), rng.uniform(0.05, 0.5, (2, 5, 3))], -1
    )
    floats = (boxes, rng.normal(size=(2, 5, 9)), rng.random((2, 5, 3)))
    boxes, codes, colors = (put(a) for a in floats)
    parents = put(rng.integers(0, 3, (2, 5)), np.int32)
    return PartTable(boxes, codes, parents, colors, put([4, 3], np.int32))


def flow_voxels(model, batch):
    """Arguments of a latent flow that say which voxels are active."""
    plan = flow_plan(batch.coords, batch.counts, model.latent_flow, model.grid)
    return {"coords": batch.coords, "counts": batch.counts, "plan": plan}

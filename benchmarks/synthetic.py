"""Batches of the right shapes for every network, by numpy alone: what the benchmarks use where the
procedural objects' packages are absent.

An object is a union of boxes' and balls' shells, each shell a part, so that windows, parts and
cells are filled about as a real surface fills them. Objects differ in their number of voxels; what
networks only read (features, latents, colours) is random.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from uniart_jax.config import LATENT_OF, Config, ModelConfig
from uniart_jax.models.network import Network
from uniart_jax.nn.grids import CELL_STEP, flow_plan
from uniart_jax.nn.segments import Segments, fitted_sizes, pack_segments, row_choices, whole_rows
from uniart_jax.nn.voxel_plans import voxel_plans, window_ids
from uniart_jax.training.encoder_loss import make_image_encoder_loss
from uniart_jax.training.flow_losses import make_latent_flow_loss, make_structure_flow_loss
from uniart_jax.training.vae_losses import make_structure_vae_loss, make_uniart_vae_loss
from uniart_jax.voxels.typed_batches import (
    Condition,
    PictureBatch,
    StructureBatch,
    VoxelBatch,
)

DISTINCT = 4  # objects of a batch; more items repeat them
LOSSES = {
    "image_encoder": make_image_encoder_loss,
    "structure_vae": make_structure_vae_loss,
    "uniart_vae": make_uniart_vae_loss,
    "structure_flow": make_structure_flow_loss,
    "latent_flow": make_latent_flow_loss,
}
CONTEXT = 1374  # tokens of an image: DINOv2 at 518^2


def make_loss(name: str, network: Network, config: Config) -> Any:
    """The loss of a network, a flow's of latents as they are."""
    units = (0.0, 1.0) if name in LATENT_OF else ()
    return LOSSES[name](network, config, *units)


def shells(voxels: int, resolution: int = 64, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Voxel indices [V, 3] int32, sorted, and the shell that each is first on [V] int32; V is
    ``voxels`` unless the grid is too small for that."""
    rng = np.random.default_rng(seed)
    part = np.full((resolution,) * 3, -1, np.int32)
    grid = np.stack(np.meshgrid(*[np.arange(resolution)] * 3, indexing="ij"), -1)
    for i in range(64):
        room = voxels - int((part >= 0).sum())
        if room <= 0:
            break
        # a body, then smaller things in and on it
        half = rng.uniform(*((0.24, 0.36) if i == 0 else (0.06, 0.25)), 3) * resolution
        centre = resolution / 2 + (rng.uniform(-0.2, 0.2, 3) * resolution if i else 0)
        if i and rng.random() < 0.3:
            distance = np.linalg.norm(grid - centre, axis=-1) - half[0]
        else:
            distance = (np.abs(grid - centre) - half).max(-1)
        new = np.argwhere((np.abs(distance) < 0.5) & (part < 0))[:room]
        part[tuple(new.T)] = i
    coords = np.argwhere(part >= 0).astype(np.int32)
    return coords, part[tuple(coords.T)]


def objects(
    items: int, width: int, resolution: int = 64, parts: int = 64
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """coords [B, V, 3], counts [B] from about 60 % of ``width`` to all of it, voxel_part [B, V];
    padding zero."""
    coords = np.zeros((items, width, 3), np.int32)
    voxel_part = np.zeros((items, width), np.int32)
    counts = np.zeros(items, np.int32)
    made = [
        shells(int(width * share), resolution, seed)
        for seed, share in enumerate(np.linspace(1, 0.6, min(items, DISTINCT)))
    ]
    for b, (where, part) in zip(range(items), itertools.cycle(made)):
        counts[b] = len(where)
        coords[b, : counts[b]], voxel_part[b, : counts[b]] = where, part % parts
    return coords, counts, voxel_part


def row_lengths(rows: int, longest: int) -> np.ndarray:
    """[rows] int32 tokens of each, ``longest`` down to 40 % of it, odd ones among them."""
    return np.linspace(longest, 0.4 * longest, rows).astype(np.int32)


def normal(*shape: int) -> np.ndarray:
    """Standard normal float32; items beyond ``DISTINCT`` repeat, as drawing a large batch takes
    minutes."""
    rng = np.random.default_rng(len(shape))
    drawn = rng.standard_normal((min(shape[0], DISTINCT), *shape[1:]), np.float32)
    return np.resize(drawn, shape)


def segment_ids(
    kind: str, items: int, width: int, resolution: int = 64
) -> tuple[np.ndarray, np.ndarray]:
    """Ids [B, V] of 'windows' (8^3, shifted by 4) or 'parts', and counts [B]."""
    coords, counts, voxel_part = objects(items, width, resolution)
    return (window_ids(coords, 8, 4) if kind == "windows" else voxel_part), counts


def segment_plan(kind: str, fitted: bool, ids: np.ndarray, counts: np.ndarray) -> Segments:
    """Their plan as ``voxel_plans`` makes it: for training (windows in rows of 512, an item's parts
    in one row) or fitted to these segments."""
    items, width = ids.shape
    longest = 512 if kind == "windows" else width
    if fitted:
        return pack_segments(ids, counts, fitted_sizes(ids, counts, longest))
    if kind == "parts":
        return whole_rows(ids, counts)
    size = min(width, longest)
    return pack_segments(ids, counts, (size,), rows=row_choices(items, width, size))


def voxel_batch(model: ModelConfig, items: int, width: int, shares: int = 1) -> VoxelBatch:
    """What the UniArt VAE trains on, with its plans, in so many shares."""
    parts, cells = model.grid.max_parts, model.grid.subdivisions**3
    coords, counts, voxel_part = objects(items, width, model.grid.resolution, parts)
    valid = (np.arange(width) < counts[:, None])[..., None]
    vae = model.uniart_vae
    features: dict[str, Any] = {
        name: normal(items, width, channels) * valid
        for name, channels in vae.feature_channels.items()
    }
    plans = voxel_plans(coords, counts, vae, model.grid, voxel_part=voxel_part, shares=shares)
    return VoxelBatch(
        coords=coords,
        counts=counts,
        sdf=np.clip(normal(items, width, cells), -3, 3) * valid,
        color=(np.abs(normal(items, width, cells, 3)) % 1) * valid[..., None],
        owner=np.repeat(voxel_part[..., None], cells, -1),
        voxel_part=voxel_part,
        boxes=normal(items, parts, 6) * 0.2,
        codes=normal(items, parts, 9) * 0.3,
        parents=np.zeros((items, parts), np.int32),
        part_counts=voxel_part.max(1) + 1,
        plans=plans,
        **features,
    )


def dense(items: int, width: int, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Occupancy [B, R, R, R] bool of ``objects``, and the part of each voxel, -1 where there is
    none."""
    part = np.full((items, side, side, side), -1, np.int32)
    coords, counts, voxel_part = objects(items, width, side)
    for filled, where, own, count in zip(part, coords, voxel_part, counts, strict=True):
        filled[tuple(where[:count].T)] = own[:count]
    return part >= 0, part


def image_batch(model: ModelConfig, items: int, width: int) -> PictureBatch:
    """What the 'volume' image encoder trains on; of DINOv2, which is not trained, the images."""
    size, parts = model.image_encoder.image_size, model.grid.max_parts
    image = np.abs(normal(items, size, size, 3)) % 1
    if model.image_encoder.architecture != "volume":
        return PictureBatch(image=image)
    coarse = dense(items, width, model.image_encoder.target_resolution)[1]
    return PictureBatch(
        image=image,
        camera=normal(items, 7) * 0.3,
        occupancy=dense(items, width, model.grid.resolution)[0],
        cell_part=np.where(coarse >= 0, coarse % parts, -1),
        boxes=normal(items, parts, 6) * 0.2,
        codes=normal(items, parts, 9) * 0.3,
        parents=np.zeros((items, parts), np.int32),
    )


def training_batch(name: str, model: ModelConfig, items: int, width: int, shares: int = 1) -> Any:
    """A batch of a network's loss (``make_loss``); ``width``: voxels of an item where they are a
    list; ``shares``: the devices that share it."""
    if name == "image_encoder":
        return image_batch(model, items, width)
    if name == "uniart_vae":
        return voxel_batch(model, items, width, shares)
    side, s = model.grid.resolution, model.structure_vae
    if name == "structure_vae":
        return PictureBatch(occupancy=dense(items, width, side)[0])
    seen = Condition(
        tokens=normal(items, CONTEXT, getattr(model, name).cond_channels),
        volume=np.zeros((items, 1, 1, 1, 1), np.float32),  # these networks read none
    )
    if name == "structure_flow":
        small = side // s.patch_size // 2 ** (len(s.channels) - 1)
        structure = normal(items, small, small, small, s.latent_channels)
        return StructureBatch(structure, seen=seen)
    coords, counts, voxel_part = objects(items, width, side, model.grid.max_parts)
    plan = flow_plan(coords, counts, model.latent_flow, model.grid, round_to=CELL_STEP)
    return VoxelBatch(
        coords,
        counts,
        voxel_part,
        latent=normal(items, width, model.uniart_vae.latent_channels),
        plans={"flow": plan},
        seen=seen,
    )

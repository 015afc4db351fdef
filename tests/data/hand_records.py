"""Hand-made records: no generator, voxeliser or renderer is needed to test what moves records
around."""

from __future__ import annotations

import itertools
import threading

import numpy as np

from uniart_jax.config import (
    FlowConfig,
    GridConfig,
    ImageEncoderConfig,
    ModelConfig,
    UniArtVAEConfig,
)
from uniart_jax.data import latents, records
from uniart_jax.voxels.joint_code import canonical

MODEL = ModelConfig(
    grid=GridConfig(8, 2, 8),
    image_encoder=ImageEncoderConfig(image_size=16, target_resolution=4),
    uniart_vae=UniArtVAEConfig(attention="serial", window=16, visual_channels=0),
    latent_flow=FlowConfig(stem="patch", patch_size=4),
)


def make_record(
    seed: int = 0, voxels: int = 40, parts: int = 3, resolution=8, subdivisions=2, size=16, views=2
) -> records.Record:
    """A record of random but well-formed content."""
    rng = np.random.default_rng(seed)
    flat = np.sort(rng.choice(resolution**3, voxels, replace=False))
    coords = np.stack(np.unravel_index(flat, (resolution,) * 3), 1).astype(np.uint8)
    cells = subdivisions**3
    codes = rng.normal(size=(parts, 9))
    codes[:, 0] = np.tanh(codes[:, 0])
    codes = canonical(codes)
    codes[0] = 0
    voxel_part = rng.integers(0, parts, voxels).astype(np.uint8)
    voxel_part[: min(parts, voxels)] = np.arange(parts)[:voxels]
    types = ["fixed"] + ["screw"] * (parts - 1)
    return records.Record(
        coords,
        rng.integers(-127, 128, (voxels, cells)).astype(np.int8),
        rng.integers(0, 256, (voxels, cells, 3)).astype(np.uint8),
        rng.integers(0, parts, (voxels, cells)).astype(np.uint8),
        voxel_part,
        rng.uniform(0.05, 0.5, (parts, 6)).astype(np.float32),
        codes.astype(np.float32),
        np.zeros(parts, np.int32),
        rng.integers(0, 256, (views, size, size, 4)).astype(np.uint8),
        rng.normal(size=(views, 4)).astype(np.float32),
        {
            "schema_version": records.SCHEMA_VERSION,
            "resolution": resolution,
            "subdivisions": subdivisions,
            "joint_types": types,
            "id": f"hand-{seed}",
            "category": "hand",
            "seed": seed,
            "state": 0,
            "scale": 1.0,
        },
    )


def write_folder(path, made, splits=None, shard_size: int = 4, rows: str = "manifest") -> None:
    """A prepared folder of these records, with their splits in a manifest ("manifest"), beside
    their shards ("rows") or nowhere ("")."""
    lines = []
    for shard, start in enumerate(range(0, len(made), shard_size)):
        chunk = made[start : start + shard_size]
        records.write_shard(
            path / f"records-{shard:05d}.arrayrecord", [records.to_bytes(r) for r in chunk]
        )
        split = (splits or ["train"] * len(made))[start : start + shard_size]
        own = [
            f"{r.meta['id']},{s},{len(r.coords)},{len(r.boxes)},\n"
            for r, s in zip(chunk, split, strict=True)
        ]
        own.append(f"failed-{shard},{split[0]},,,broken\n")
        lines += own
        if rows == "rows":
            (path / "rows").mkdir(exist_ok=True)
            (path / "rows" / f"{shard:05d}.csv").write_text(_HEADER + "".join(own))
    if rows == "manifest":
        (path / "manifest.csv").write_text(_HEADER + "".join(lines))


_HEADER = "id,split,voxels,parts,error\n"


def write_items(path, name: str, items, shard_size: int = 4) -> None:
    """A column of (record id, arrays) items."""
    for shard, start in enumerate(range(0, len(items), shard_size)):
        packed = [
            records.pack_arrays(arrays, {"id": i})
            for i, arrays in items[start : start + shard_size]
        ]
        records.write_shard(path / f"{name}-{shard:05d}.arrayrecord", packed)


def first_of(batches, count: int = 1, state=None) -> list:
    """The first batches, or those from a state on. What is made ahead has ended: it would go on
    beneath the tests that follow, with blocks of full size once theirs are no longer small."""
    before, iterator = set(threading.enumerate()), iter(batches)
    if state is not None:
        iterator.set_state(state)
    found = list(itertools.islice(iterator, count))
    iterator.close()
    for thread in set(threading.enumerate()) - before:
        thread.join()
    return found


def features_of(record: records.Record, channels: int) -> np.ndarray:
    """[V, channels] float16 that say which record and voxel they belong to."""
    place = record.coords.astype(np.float32) @ [0.01, 0.1, 1.0] + record.meta["seed"]
    return (place[:, None] + np.arange(channels)).astype(np.float16)


def write_latents(out, items, key: str):
    """Items as a complete folder of latents, in the place of another."""
    items = list(items)
    latents.begin_latents(out, key)
    for shard, start in enumerate(range(0, len(items), latents.SHARD_ITEMS)):
        chunk = items[start : start + latents.SHARD_ITEMS]
        latents.write_latent_shard(out, f"{shard:05d}", chunk)
    return latents.finish_latents(out, key, len(items))

"""Hand-made records: no generator, voxeliser or renderer is needed to test what moves records around."""

from __future__ import annotations

import numpy as np

from uniart_jax.config import (
    FlowConfig,
    GridConfig,
    ImageEncoderConfig,
    ModelConfig,
    UniArtVAEConfig,
)
from uniart_jax.data import records
from uniart_jax.voxels.joint_code import canonical

MODEL = ModelConfig(
    grid=GridConfig(8, 2, 8),
    image_encoder=ImageEncoderConfig(image_size=16, target_resolution=4),
    uniart_vae=UniArtVAEConfig(attention="serial", window=16),
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

"""Folders of hand-made records with pictures from all around, and weights to read them with."""

from __future__ import annotations

import jax
import numpy as np
from hand_records import make_record, write_folder

from uniart_jax.config import ImageEncoderConfig, ModelConfig
from uniart_jax.data.columns import column_path, pack_orbit
from uniart_jax.data.records import shard_paths
from uniart_jax.data.shards import open_shards, write_shard
from uniart_jax.models.checkpoint_files import write_network
from uniart_jax.models.network import build
from uniart_jax.visual.render import orbit_cameras

ENCODER = ImageEncoderConfig(
    architecture="dinov2", image_size=16, patch_size=4, registers=2, width=12, num_blocks=1, num_heads=1, mlp_ratio=2.0,  # noqa: E501
)  # fmt: skip
NETWORK = build("image_encoder", ModelConfig(image_encoder=ENCODER))
VIEWS, COUNT = 7, 6


def weights(folder, seed=0, network=NETWORK):
    rng = np.random.default_rng(seed)
    drawn = jax.tree.map(
        lambda s: rng.normal(0, 0.3, s.shape).astype(np.float32), network.abstract()
    )
    return write_network(folder, network.name, drawn, "stored")


def orbit(record, size=16, views=VIEWS):
    rng = np.random.default_rng(record.meta["seed"])
    cameras = [(c.azimuth, c.elevation, c.fov_degrees, c.distance) for c in orbit_cameras(views)]
    images = rng.integers(0, 256, (views, size, size, 4)).astype(np.uint8)
    return {"images": images, "cameras": np.array(cameras, np.float32)}


def prepared(folder, size=16, splits=None):
    folder.mkdir()
    made = [make_record(k, voxels=20 + 9 * k) for k in range(COUNT)]
    write_folder(folder, made, splits)
    write_orbits(folder, [(r.meta["id"], orbit(r, size)) for r in made])
    return folder


def write_orbits(folder, made):
    """``made``: (record's id, its orbit), in the records' order."""
    at = 0
    for shard in shard_paths(folder):
        count = len(open_shards([shard]))
        items = [pack_orbit(o["images"], o["cameras"], name) for name, o in made[at : at + count]]
        write_shard(column_path(shard, "orbit"), items)
        at += count

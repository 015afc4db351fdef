"""The mean over pictures of what DINOv2 says where each voxel's centre is seen
(``models.multiview``)."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple, TypeVar

import jax
import numpy as np
from PIL import Image
from safetensors import SafetensorError, safe_open

from uniart_jax.config import ImageEncoderConfig, ModelConfig
from uniart_jax.data.columns import column_path, half, read_orbit
from uniart_jax.data.records import Record, from_bytes
from uniart_jax.data.shards import open_shards
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.checkpoint_files import read_network
from uniart_jax.models.multiview import intrinsic_matrices, multiview_features
from uniart_jax.models.network import Network, Params, build
from uniart_jax.precompute.fill_columns import Columns
from uniart_jax.visual.render import Camera
from uniart_jax.weights.dinov2 import converted_config

VOXEL_STEP = 4096  # positions are padded to a multiple, so that few shapes are compiled
Item = TypeVar("Item")
Made = TypeVar("Made")


class Encoder(NamedTuple):
    """A frozen DINOv2: its network, its parameters on the device, and the digest of its file."""

    network: Network
    params: Params
    digest: str

    @property
    def config(self) -> ImageEncoderConfig:
        return self.network.config.image_encoder


def visual_of_shard(shard: Path, encoder: Encoder, views: int, batch: int) -> Columns:
    """Each record of a shard with the mean over ``views`` of its orbit pictures of what its voxels
    read in them: [V, F] float16.

    Raises:
      ValueError: a record's orbit is another's, damaged or smaller than ``views``.
    """
    records, orbits = open_shards([shard]), open_shards([column_path(shard, "orbit")])

    def load(row: int) -> tuple[Record, list[np.ndarray], np.ndarray]:
        record = from_bytes(records[row])
        images, cameras = read_orbit(orbits[row], record.meta.get("id"))
        if len(images) < views:
            raise ValueError(
                f"column 'orbit' of '{record.meta.get('id')}': {len(images)} pictures, not "
                f"{views}; prepare again"
            )
        return record, images, cameras

    for record, images, cameras in _ahead(load, range(len(records))):
        chosen = spread_views(cameras, views)
        yield record, visual(record, (images[i] for i in chosen), cameras[chosen], encoder, batch)


def visual(
    record: Record, images: Iterable[np.ndarray], cameras: np.ndarray, encoder: Encoder, batch: int
) -> np.ndarray:
    """[V, F] float16: mean over views of the patch features that each voxel's centre reads; no
    visibility test (``models.multiview``).

    Args:
      images: M pictures [S, S, 4] uint8, straight alpha, sRGB; resized to what the encoder was
        trained on. cameras: [M, 4].
    """
    size, count = encoder.config.image_size, len(record.coords)
    positions = np.zeros((-(-count // VOXEL_STEP) * VOXEL_STEP, 3), np.float32)
    positions[:count] = (record.coords + 0.5) / record.resolution - 0.5
    pictures = (resized(image, size) for image in images)
    values = multiview_features(
        encoder.network,
        encoder.params,
        pictures,
        *view_matrices(cameras),
        jax.device_put(positions),
        count,
        chunk=batch,
    )
    return half(np.asarray(values)[:count], str(record.meta.get("id")), "visual")


def view_matrices(cameras: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cameras [M, 4] of records as ``models.multiview`` takes them: extrinsics [M, 4, 4] (object to
    camera), intrinsics [M, 3, 3]."""
    extrinsics = np.stack([Camera(*row).matrix() for row in np.asarray(cameras, np.float64)])
    return extrinsics.astype(np.float32), intrinsic_matrices(np.deg2rad(cameras[:, 2]))


def resized(image: np.ndarray, size: int) -> np.ndarray:
    """[size, size, 4] uint8: Lanczos, as TRELLIS (colours weighted by alpha)."""
    if image.shape[:2] == (size, size):
        return image
    return np.asarray(Image.fromarray(image).resize((size, size), Image.Resampling.LANCZOS))


def spread_views(cameras: np.ndarray, number: int) -> np.ndarray:
    """Sorted indices of ``number`` cameras [M, 4] that look from directions far from each other:
    the first, then always the farthest from those chosen.

    Every k-th of an even spread need not be even: of a Fibonacci sphere it is a few arms of a
    spiral.
    """
    if number >= len(cameras):
        return np.arange(len(cameras))
    azimuth, elevation = np.asarray(cameras[:, :2], np.float64).T
    flat = np.cos(elevation)
    seen = np.stack([np.cos(azimuth) * flat, np.sin(azimuth) * flat, np.sin(elevation)], -1)
    chosen, nearest = [0], seen @ seen[0]
    while len(chosen) < number:
        chosen.append(int(np.argmin(nearest)))
        nearest = np.maximum(nearest, seen @ seen[chosen[-1]])
        nearest[chosen] = np.inf
    return np.sort(chosen)


def load_encoder(path: Path) -> Encoder:
    """A converted DINOv2 on the default device. Sizes are those of its tensors; heads are 64 wide
    unless a ``config.json`` beside it says otherwise.

    Raises:
      FileNotFoundError: no such file. ValueError: it is truncated, not finite, or no DINOv2.
    """
    path = Checkpoint.find(path).path("image_encoder.safetensors") if path.is_dir() else path
    if not path.is_file():
        raise FileNotFoundError(
            f"weights '{path}': no such file; make it with: uniart convert dinov2 FILE --out "
            "image_encoder.safetensors"
        )
    try:
        with safe_open(path, "numpy") as file:
            shapes = {name: tuple(file.get_slice(name).get_shape()) for name in file.keys()}  # noqa: SIM118  not a dict
        config = converted_config(shapes)
    except (SafetensorError, ValueError) as error:
        raise ValueError(f"weights '{path}': {error}") from None
    if (path.parent / "config.json").is_file():
        beside = Checkpoint(path.parent).config.model.image_encoder
        config = config if beside.kind.trained else beside
    network = _network(config)
    params = jax.device_put(read_network(path, network.abstract()))
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return Encoder(network, params, digest)


@functools.lru_cache(maxsize=1)  # one object, one compiled program
def _network(config: ImageEncoderConfig) -> Network:
    return build("image_encoder", ModelConfig(image_encoder=config))


def _ahead(load: Callable[[Item], Made], items: Iterable[Item]) -> Iterator[Made]:
    """``load`` of each, the next one while this one is in use."""
    with ThreadPoolExecutor(1) as pool:
        waiting = None
        for item in items:
            following = pool.submit(load, item)
            if waiting is not None:
                yield waiting.result()
            waiting = following
        if waiting is not None:
            yield waiting.result()

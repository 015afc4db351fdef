"""Pictures and coarse structure of all records in memory: what the image encoder and the structure
VAE train on, at thousands a second.

One record takes about 10 KB and 50 KB a view (128 pixels; packed occupancy at 32^3, part ids at
16^3), so 10,000 with two views fit in 1.1 GB.
"""

from __future__ import annotations

import dataclasses
import functools
import logging
from pathlib import Path

import numpy as np

from uniart_jax.config import DataConfig, ModelConfig
from uniart_jax.data.batches import open_records, seen_images
from uniart_jax.data.cameras import camera_codes, mirror_camera_codes
from uniart_jax.data.mirror import mirror_boxes, mirror_codes, mirror_dense, mirror_images
from uniart_jax.data.order import Draw, OnePass, ShuffledOrder, local_rows, spread
from uniart_jax.data.records import Record
from uniart_jax.data.stream import Batches
from uniart_jax.voxels.grid import SDF_CLIP, occupancy
from uniart_jax.voxels.joint_code import BOX_SIZE, CODE_SIZE
from uniart_jax.voxels.typed_batches import PictureBatch

logger = logging.getLogger(__name__)
NO_PART = 255
SURFACE = 0.87  # sub-cells: half the diagonal, so that a cell nearer than this may hold surface


@dataclasses.dataclass(frozen=True)
class ImageTable:
    """All records of a folder, or of a split of it, small. Row i is record i of
    ``RecordSource(folder, split)``, whatever is left out.

    Attributes:
      usable: [m] indices of the records that have at most ``max_parts`` parts; the others' tables
        of parts are empty.
      resolution: R; target_resolution: T, a divisor of it.
      images: [n, N, H, W, 3] uint8 sRGB over black.
      cameras: [n, N, 7] float32 codes of the views (``voxels.camera_code``).
      occupied: [n, R^3 / 8] uint8 packed bits.
      cell_parts: [n, T, T, T] uint8 part of each cell, ``NO_PART`` where no voxel is active.
      boxes, codes, parents: [n, K, 6], [n, K, 9] float32 and [n, K] int32 tables of parts, zero
        beyond each record's own.
    """

    usable: np.ndarray
    resolution: int
    target_resolution: int
    images: np.ndarray
    cameras: np.ndarray
    occupied: np.ndarray
    cell_parts: np.ndarray
    boxes: np.ndarray
    codes: np.ndarray
    parents: np.ndarray

    def __len__(self) -> int:
        return len(self.images)

    def __repr__(self) -> str:
        return f"ImageTable({len(self)} records)"

    def take(self, records: np.ndarray, views: np.ndarray, mirrored: np.ndarray) -> PictureBatch:
        """A batch of these records: ``views`` [B] in [0, 1) choose among the images, ``mirrored``
        [B] bool."""
        view = (np.asarray(views) * self.images.shape[1]).astype(int)
        image, camera = self.images[records, view], self.cameras[records, view]
        count = self.resolution**3
        occupied = np.unpackbits(self.occupied[records], axis=1, count=count).astype(bool)
        occupied = occupied.reshape(-1, *(self.resolution,) * 3)
        parts = self.cell_parts[records]
        boxes, codes = self.boxes[records], self.codes[records]
        for b in np.flatnonzero(mirrored):
            image[b], camera[b] = mirror_images(image[b]), mirror_camera_codes(camera[b])
            occupied[b], parts[b] = mirror_dense(occupied[b]), mirror_dense(parts[b])
            boxes[b], codes[b] = mirror_boxes(boxes[b]), mirror_codes(codes[b])
        return PictureBatch(
            image=image.astype(np.float32) / np.float32(255),
            camera=camera,
            occupancy=occupied,
            cell_part=np.where(parts == NO_PART, -1, parts.astype(np.int32)),
            boxes=boxes,
            codes=codes,
            parents=self.parents[records],
        )


def cell_parts(record: Record, target_resolution: int) -> np.ndarray:
    """[T, T, T] uint8 part that owns most sub-cells on the surface of each cell; ``NO_PART`` where
    no voxel is active.

    A voxel whose sub-cells all miss the surface counts once for its own part.
    """
    factor = record.resolution // target_resolution
    cell = (record.coords // factor).astype(np.int64)
    flat = (cell[:, 0] * target_resolution + cell[:, 1]) * target_resolution + cell[:, 2]
    known = len(record.boxes)
    voxel, sub = np.nonzero(np.abs(record.sdf) <= int(SURFACE / SDF_CLIP * 127))
    size = target_resolution**3 * known
    votes = np.bincount(flat[voxel] * known + record.owner[voxel, sub], minlength=size)
    votes = votes * 1000 + np.bincount(flat * known + record.voxel_part, minlength=size)
    votes = votes.reshape(-1, known)
    parts = np.where(votes.any(1), votes.argmax(1), NO_PART).astype(np.uint8)
    return parts.reshape((target_resolution,) * 3)


def reads_pictures(model: ModelConfig) -> bool:
    """Whether a network is trained on the table's pictures: with a frozen encoder only the
    structure VAE reads the table, and pictures of 518 pixels would fill the memory."""
    return model.image_encoder.kind.trained


@functools.lru_cache(maxsize=2)  # two stages of one run read the same table
def load_image_table(
    folder: str | Path, model: ModelConfig, split: str = "", pictures: bool = True
) -> ImageTable:
    """Read every record of a folder, or of a split of it, once (about 8 ms each); says how many
    have more than ``max_parts`` parts.

    Args:
      pictures: False = none in the table (one of no pixels), whatever their size in the records.

    Raises:
      FileNotFoundError, ValueError: no records, another grid or image size than the model's, or no
        record with so few parts.
    """
    source, sizes = open_records(folder, model.grid, split)
    resolution, target = model.grid.resolution, model.image_encoder.target_resolution
    if resolution % target:
        raise ValueError(f"config: target_resolution {target} must divide the grid's {resolution}")
    parts = model.grid.max_parts
    usable = np.flatnonzero(sizes[:, 1] <= parts)
    if not len(usable):
        raise ValueError(f"{folder}: every record has more than max_parts = {parts} parts")
    if len(usable) < len(sizes):
        left = len(sizes) - len(usable)
        logger.warning(
            "data: %d of %d records left out: more than %d parts", left, len(sizes), parts
        )
    n, views = len(source), source[0].images.shape[:-1] if pictures else (1, 0, 0)
    if pictures and views[1:] != (model.image_encoder.image_size,) * 2:
        raise ValueError(
            f"{folder}: images of {views[1]} pixels, but the config asks for "
            f"{model.image_encoder.image_size}; prepare with that size"
        )
    table = ImageTable(
        usable,
        resolution,
        target,
        np.zeros((n, *views, 3), np.uint8),
        np.zeros((n, views[0], 7), np.float32),
        np.zeros((n, -(-(resolution**3) // 8)), np.uint8),
        np.zeros((n, target, target, target), np.uint8),
        np.zeros((n, parts, BOX_SIZE), np.float32),
        np.zeros((n, parts, CODE_SIZE), np.float32),
        np.zeros((n, parts), np.int32),
    )
    for i in range(n):
        record = source[i]
        if pictures:
            table.images[i] = seen_images(record.images)
            table.cameras[i] = camera_codes(record.cameras, record.images)
        table.occupied[i] = np.packbits(occupancy(record.coords, resolution).reshape(-1))
        table.cell_parts[i] = cell_parts(record, target)
        known = len(record.boxes)
        if known <= parts:
            table.boxes[i, :known] = record.boxes
            table.codes[i, :known] = record.codes
            table.parents[i, :known] = record.parents
    return table


def image_batches(
    records: str | Path,
    data: DataConfig,
    model: ModelConfig,
    batch_size: int,
    *,
    split: str = "",
    seed: int | None = None,
    process_index: int = 0,
    process_count: int = 1,
    accumulate: int = 1,
) -> Batches[PictureBatch]:
    """Endless shuffled batches of ``ImageTable.take``, a random view each, mirrored with
    probability 1/2.

    Args and errors: as ``batches.voxel_batches``. ``data.workers`` is not used: the table is in
    this process.
    """
    table = load_image_table(records, model, split, reads_pictures(model))
    seed = data.seed if seed is None else seed
    widths = np.zeros(len(table.usable), np.int64)
    order = ShuffledOrder(table.usable, widths, batch_size, seed)
    rows = local_rows(batch_size, process_index, process_count, accumulate)
    load = functools.partial(_load, table=table, mirror=data.mirror, seed=seed, rows=rows)
    return Batches(order, load)


def _load(
    draw: Draw, *, table: ImageTable, mirror: bool, seed: int, rows: np.ndarray
) -> PictureBatch:
    rng = draw.generator(seed)
    views, mirrors = rng.random(len(draw.records)), rng.random(len(draw.records)) < 0.5
    return table.take(draw.records[rows], views[rows], (mirrors & mirror)[rows])


def image_pass(
    records: str | Path,
    model: ModelConfig,
    batch_size: int,
    split: str = "",
    most: int | None = None,
) -> Batches[PictureBatch]:
    """Every usable record once, its first view, unmirrored, with ``record`` [B] i4, its index in
    ``RecordSource(records, split)``.

    -1 marks items that fill up the last batch.

    Args:
      most: take so many records, at even distances.
    """
    table = load_image_table(records, model, split, reads_pictures(model))
    shown = table.usable[spread(len(table.usable), most)]
    order = OnePass(shown, np.zeros(len(shown), np.int64), batch_size)
    return Batches(order, functools.partial(_load_pass, table=table))


def _load_pass(draw: Draw, *, table: ImageTable) -> PictureBatch:
    zeros = np.zeros(len(draw.records))
    batch = table.take(np.maximum(draw.records, 0), zeros, zeros.astype(bool))
    return batch._replace(record=draw.records.astype(np.int32))

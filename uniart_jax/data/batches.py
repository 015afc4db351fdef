"""Grain pipelines from records to batches of numpy arrays (``voxels.typed_batches.VoxelBatch``),
padded to a few static widths. No jax.

V, the width, is one of ``DataConfig.voxel_buckets``, the same for all items of a batch. What is
said of sub-cells is as records store it. Batches come as ``data.stream.Batches``: ``iter(...)``
gives an iterator with exact ``get_state`` and ``set_state``.
"""

from __future__ import annotations

import functools
import logging
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from uniart_jax.config import DataConfig, GridConfig, ModelConfig
from uniart_jax.data.augment import recolor_record, redraw_joints
from uniart_jax.data.columns import maker
from uniart_jax.data.images import crop
from uniart_jax.data.layout_errors import with_errors
from uniart_jax.data.live import LiveRecords
from uniart_jax.data.mirror import mirror_record
from uniart_jax.data.order import (
    Draw,
    OnePass,
    ShuffledOrder,
    fitting_width,
    local_rows,
    spread,
)
from uniart_jax.data.records import (
    Record,
    RecordSource,
    decode_color,
    decode_sdf,
    record_rows,
)
from uniart_jax.data.stream import Batches
from uniart_jax.data.windows import choose_windows
from uniart_jax.nn.grids import flow_plan
from uniart_jax.nn.segments import Segments
from uniart_jax.nn.voxel_plans import voxel_plans
from uniart_jax.objects.perturb import color_gains
from uniart_jax.voxels.joint_code import BOX_SIZE, CODE_SIZE
from uniart_jax.voxels.part_table import part_table, surface_colors
from uniart_jax.voxels.typed_batches import VoxelBatch

logger = logging.getLogger(__name__)


def voxel_batches(
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
    shares: int = 1,
    shown: bool = False,
) -> Batches[VoxelBatch]:
    """Endless shuffled batches for the UniArt VAE, mirrored with probability 1/2 (not where it
    reads features), with its attention plans; of each object some windows where ``data.voxel_crop``
    says so (``data.windows``), some objects made again, recoloured and with other joints where
    ``data.live``, ``data.part_color`` and ``data.new_joints`` say so.

    Args:
      records: a prepared folder. split: of its records (``RecordSource``).
      data: voxel buckets, mirror, live and its strengths, seed (unless ``seed`` is given) and
        workers (0: threads of this process).
      batch_size: over all processes; each gets ``batch_size / process_count`` items, all of the
        same width.
      accumulate: micro-batches that each process will cut its items into.
      shares: parts of a process's items whose attention is planned apart, one for each of its
        devices (``nn.voxel_plans.voxel_plans``).
      shown: with a random view ``image`` [B, H, W, 3] and ``plans["flow"]``, for ``loss.sampled``.

    A decoder that sees layouts gets ``layout``, a ``voxels.part_table.PartTable`` with
    ``data.layout_errors`` in it, and ``layout_rows`` [B, K], the layout's row of each true part, -1
    where it is lost.

    Raises:
      FileNotFoundError, ValueError: no records, another grid than the model's, no features that the
        model reads, fewer records than a batch, a share out of range, or a batch that the processes
        cannot share equally.
    """
    if (data.live or data.part_color) and model.uniart_vae.feature_channels:
        raise ValueError(
            "data: live and part_color need visual_channels and part_feature_channels 0: features "
            "from files do not follow what is changed"
        )
    if not 0 <= data.new_joints <= 1:
        raise ValueError(f"data: new_joints must be in 0..1, got {data.new_joints}")
    if shown and data.voxel_crop:
        raise ValueError(
            "data: a latent flow sees whole objects; with loss.sampled set data.voxel_crop 0"
        )
    source, sizes = open_records(records, model.grid, split, model.uniart_vae.feature_channels)
    seed = data.seed if seed is None else seed
    known, widths = usable(sizes, data, model.grid)
    live = LiveRecords(records, data, model.grid) if data.live else None
    if data.voxel_crop:
        widths = np.full_like(widths, data.voxel_crop)
    order = ShuffledOrder(known, widths, batch_size, seed)
    load = functools.partial(
        _load_voxels,
        source=source,
        live=live,
        data=data,
        model=model,
        seed=seed,
        rows=local_rows(batch_size, process_index, process_count, accumulate),
        shares=shares,
        shown=shown,
    )
    return Batches(order, load, data.workers)


def record_batches(
    records: str | Path,
    data: DataConfig,
    model: ModelConfig,
    batch_size: int,
    *,
    split: str = "",
    mirrored: bool = False,
    most: int | None = None,
    mine: Callable[[int], bool] = lambda number: True,
) -> Batches[VoxelBatch]:
    """Every record once, ordered by width: for encoding and for evaluation.

    Batches hold, beside the voxels and their plans, ``images`` [B, N, H, W, 3] of all views and
    ``record`` [B] i4, the index of each record in ``RecordSource(records, split)``; -1 marks items
    that only fill up a batch (their counts are 0).

    Args:
      mirrored: mirror every record. most: take so many records, at even distances.
      mine: which batches of the pass to make, by their number.
    """
    source, sizes = open_records(records, model.grid, split, model.uniart_vae.feature_channels)
    known, widths = usable(sizes, data, model.grid)
    shown = spread(len(known), most)
    order = OnePass(known[shown], widths[shown], batch_size, mine)
    load = functools.partial(_load_records, source=source, model=model, mirrored=mirrored)
    return Batches(order, load, data.workers)


def _load_voxels(
    draw: Draw,
    *,
    source: RecordSource,
    live: LiveRecords | None,
    data: DataConfig,
    model: ModelConfig,
    seed: int,
    rows: np.ndarray,
    shares: int,
    shown: bool,
) -> VoxelBatch:
    rng = draw.generator(seed)
    mirrors = rng.random(len(draw.records)) < 0.5
    seeds = rng.integers(2**31, size=len(draw.records))
    mirror, items = data.mirror and may_mirror(model), []
    for index, mirrored, own in zip(draw.records[rows], mirrors[rows], seeds[rows], strict=True):
        record = None
        if live is not None and (chance := np.random.default_rng([own, 1])).random() < data.live:
            room = max(data.voxel_buckets) if data.voxel_crop else draw.width
            record = live.record(int(source.places[index]), room, chance)
        record = source[int(index)] if record is None else record
        if data.part_color:
            gains = color_gains(len(record.boxes), np.random.default_rng([own, 2]), data.part_color)
            record = recolor_record(record, gains)
        if data.new_joints:
            chance = np.random.default_rng([own, 3])
            record = redraw_joints(record, data.new_joints, chance)
        if data.voxel_crop:
            window = model.uniart_vae.window
            record = choose_windows(record, data.voxel_crop, window, np.random.default_rng(own))
        items.append(mirror_record(record) if mirrored and mirror else record)
    batch = collate(items, draw.width, model.grid, features=model.uniart_vae.feature_channels)
    plans: dict[str, Any] = {**_all_plans(batch, model, shares)}
    chances = [np.random.default_rng([own, 4]) for own in seeds[rows]]
    if model.uniart_vae.layout_channels:
        batch = layouts_with_errors(batch, model.grid.max_parts, data.layout_errors, chances)
    if shown:
        views = [g.choice(item.images)[None] for item, g in zip(items, chances, strict=True)]
        seen = np.concatenate([seen_images(view) for view in views])
        batch = batch._replace(image=seen.astype(np.float32) / np.float32(255))
        plans["flow"] = flow_plan(batch.coords, batch.counts, model.latent_flow, model.grid)
    return batch._replace(plans=plans)


def _all_plans(batch: VoxelBatch, model: ModelConfig, shares: int = 1) -> dict[str, Segments]:
    """Those of encoder and decoder."""
    voxels, vae = (batch.coords, batch.counts), model.uniart_vae
    return voxel_plans(*voxels, vae, model.grid, voxel_part=batch.voxel_part, shares=shares)


def layouts_with_errors(
    batch: VoxelBatch, most: int, errors: float, rngs: Sequence[np.random.Generator]
) -> VoxelBatch:
    """A collated batch with ``layout`` and ``layout_rows`` (``voxel_batches``)."""
    tables = [with_errors(true_layout(batch, b), errors, rng) for b, rng in enumerate(rngs)]
    rows = np.full((len(tables), most), -1, np.int32)
    for row, table in zip(rows, tables, strict=True):
        row[table["part"]] = np.arange(len(table["part"]))
    return batch._replace(layout=part_table(tables, most), layout_rows=rows)


def true_layout(batch: VoxelBatch, b: int) -> dict[str, np.ndarray]:
    """The parts of item ``b`` of a collated batch: fields of ``voxels.part_table.ROWS``."""
    known, count = batch.part_counts[b], batch.counts[b]
    sdf, color = decode_sdf(batch.sdf[b, :count]), decode_color(batch.color[b, :count])
    return {
        "boxes": batch.boxes[b, :known],
        "codes": batch.codes[b, :known],
        "parents": batch.parents[b, :known],
        "colors": surface_colors(sdf, color, batch.owner[b, :count], known),
    }


def _load_records(
    draw: Draw, *, source: RecordSource, model: ModelConfig, mirrored: bool
) -> VoxelBatch:
    items: list[Record] = [source[int(index)] for index in draw.records if index >= 0]
    if mirrored:
        items = [mirror_record(record) for record in items]
    features = model.uniart_vae.feature_channels
    batch = collate(items, draw.width, model.grid, len(draw.records), features)
    images = np.zeros((len(draw.records), *items[0].images.shape[:-1], 3), np.float32)
    images[: len(items)] = np.stack([seen_images(record.images) for record in items]) / np.float32(
        255
    )
    layout = None
    if model.uniart_vae.layout_channels:
        tables = [true_layout(batch, b) for b in range(len(draw.records))]
        layout = part_table(tables, model.grid.max_parts)
    return batch._replace(
        images=images,
        record=draw.records.astype(np.int32),
        plans=_all_plans(batch, model),
        layout=layout,
    )


def may_mirror(model: ModelConfig) -> bool:
    """Whether the mirror image of a record is all known: features of a mirrored object are not the
    mirrored features."""
    return not model.uniart_vae.feature_channels


def collate(
    records: Sequence[Record],
    width: int,
    grid: GridConfig,
    size: int | None = None,
    features: Mapping[str, int] | None = None,
) -> VoxelBatch:
    """Records as one padded batch of voxels and parts, without images and plans.

    What is said of every sub-cell stays in its stored type, a quarter of the bytes to copy and to
    send; ``models.voxel_batch.cell_sdf`` and ``cell_color`` decode it on the device.

    Args:
      width: V, at least the largest count. size: B, at least ``len(records)``; missing items are
        all padding.
      features: ``UniArtVAEConfig.feature_channels``; the records must hold these.

    Raises:
      ValueError: a record has more voxels than ``width``, more parts than ``grid.max_parts``, or
        lies on another grid.
    """
    size = len(records) if size is None else size
    cells, parts = grid.subdivisions**3, grid.max_parts
    arrays = {
        "coords": np.zeros((size, width, 3), np.int32),
        "counts": np.zeros(size, np.int32),
        "sdf": np.zeros((size, width, cells), np.int8),
        "color": np.zeros((size, width, cells, 3), np.uint8),
        "owner": np.zeros((size, width, cells), np.uint8),
        "voxel_part": np.zeros((size, width), np.int32),
        "boxes": np.zeros((size, parts, BOX_SIZE), np.float32),
        "codes": np.zeros((size, parts, CODE_SIZE), np.float32),
        "parents": np.zeros((size, parts), np.int32),
        "part_counts": np.zeros(size, np.int32),
    }
    features = features or {}
    arrays |= {k: np.zeros((size, width, channels), np.float32) for k, channels in features.items()}
    for b, record in enumerate(records):
        count, known = len(record.coords), len(record.boxes)
        if (record.resolution, record.subdivisions) != (grid.resolution, grid.subdivisions):
            raise ValueError(_other_grid(record, grid))
        if count > width or known > parts:
            raise ValueError(
                f"data: a record has {count} voxels and {known} parts; the batch holds {width} and "
                f"{parts}"
            )
        arrays["counts"][b], arrays["part_counts"][b] = count, known
        for key in ("coords", "sdf", "color", "owner", "voxel_part", *features):
            arrays[key][b, :count] = getattr(record, key)
        for key in ("boxes", "codes", "parents"):
            arrays[key][b, :known] = getattr(record, key)
    return VoxelBatch(**arrays)


def seen_images(images: np.ndarray) -> np.ndarray:
    """[N, S, S, 3] uint8: rendered views [N, S, S, 4] as networks see them, cropped to the object
    over black (``images.crop``)."""
    return np.stack([crop(image, image.shape[0]) for image in images])


def open_records(
    folder: str | Path,
    grid: GridConfig,
    split: str = "",
    features: Mapping[str, int] | None = None,
) -> tuple[RecordSource, np.ndarray]:
    """The records of a folder, or of a split of it, and their sizes [N, 2] (voxels, parts), checked
    against the model's grid and ``UniArtVAEConfig.feature_channels``.

    Sizes come from the manifest; without one (a run of ``prepare`` still under way) every record is
    read once.
    """
    features = features or {}
    source = RecordSource(folder, split, tuple(features))
    if not len(source):
        raise ValueError(f"{folder}: its shards are empty; see the errors in its manifest.csv")
    first = source[0]
    if (first.resolution, first.subdivisions) != (grid.resolution, grid.subdivisions):
        raise ValueError(f"{folder}: {_other_grid(first, grid)}")
    for name, channels in features.items():
        if (held := getattr(first, name).shape[1]) != channels:
            raise ValueError(
                f"{folder}: its column '{name}' has {held} channels, but "
                f"model.uniart_vae.{name}_channels is {channels}; set that, or make the column "
                f"again ({maker(name, folder)})"
            )
    rows = record_rows(folder)
    if len(rows) > source.places.max():
        chosen = (rows[place] for place in source.places)
        sizes = [(int(row["voxels"]), int(row["parts"])) for row in chosen]
    else:
        made = (source[i] for i in range(len(source)))
        sizes = [(len(record.coords), len(record.boxes)) for record in made]
    return source, np.array(sizes)


def _other_grid(record: Record, grid: GridConfig) -> str:
    return (
        f"records of {record.resolution} voxels a side with {record.subdivisions} sub-cells, but "
        f"the config asks for {grid.resolution} with {grid.subdivisions}; prepare records of that "
        "grid"
    )


def usable(sizes: np.ndarray, data: DataConfig, grid: GridConfig) -> tuple[np.ndarray, np.ndarray]:
    """Indices [n] and padded widths [n] of the records that fit the largest bucket and
    ``max_parts``; says how many do not."""
    largest = max(data.voxel_buckets)
    records = np.flatnonzero(fitting(sizes, data, grid))
    if len(records) < len(sizes):
        logger.warning(
            "data: %d of %d records left out: more than %d voxels or %d parts",
            len(sizes) - len(records),
            len(sizes),
            largest,
            grid.max_parts,
        )
    return records, fitting_width(sizes[records, 0], data.voxel_buckets)


def fitting(sizes: np.ndarray, data: DataConfig, grid: GridConfig) -> np.ndarray:
    """[N] whether records of ``sizes`` [N, 2] fit the largest bucket and ``max_parts``."""
    return (sizes[:, 0] <= max(data.voxel_buckets)) & (sizes[:, 1] <= grid.max_parts)

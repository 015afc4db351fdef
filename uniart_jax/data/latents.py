"""Records through both VAEs, cached with their pictures, and the batches of both flow stages made
of them.

    OUT/latents-00000.arrayrecord   one item a (record, mirrored) pair, zip of .npy as records are
    OUT/metadata.json               key, number of items, mean and std of both latents

An item: ``structure`` [s, s, s, C] f2 latent mean of the structure VAE; ``coords`` [V, 3] u1,
``voxel_part`` [V] u1 and ``latent`` [V, C'] f2 latent mean of the UniArt VAE; ``boxes`` [K, 6],
``codes`` [K, 9], ``colors`` [K, 3] f4 and ``parents`` [K] i4, the layout; ``images`` [N, H, W, 3]
u1 the N views as networks see them, which the image encoder reads in a flow's step: that costs a
few percent of it, and a better encoder needs no new latents. A folder is complete or absent; one
that is being made lies beside it under another name, and a pass that was cut off goes on at its
next shard.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import shutil
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from uniart_jax.config import DataConfig, FlowConfig, ModelConfig
from uniart_jax.data.batches import usable
from uniart_jax.data.folder import read_metadata
from uniart_jax.data.layout_errors import bend, with_errors
from uniart_jax.data.order import Draw, ShuffledOrder, local_rows
from uniart_jax.data.shards import open_shards, pack_arrays, unpack_arrays, write_shard
from uniart_jax.data.stream import Batches
from uniart_jax.nn.grids import flow_plan
from uniart_jax.runtime.files import write_text
from uniart_jax.voxels.part_table import ROWS, part_table
from uniart_jax.voxels.typed_batches import StructureBatch, VoxelBatch

FIELDS = ("structure", "coords", "voxel_part", "latent", "images", *ROWS)
SHARD_ITEMS = 256


@dataclasses.dataclass(frozen=True)
class LatentStatistics:
    """Mean and standard deviation of each channel over all items (and voxels): what flows normalise
    by.

    Attributes:
      structure_mean, structure_std: [C]. latent_mean, latent_std: [C'].
    """

    structure_mean: np.ndarray
    structure_std: np.ndarray
    latent_mean: np.ndarray
    latent_std: np.ndarray


class _Moments:
    def __init__(self):
        self.count, self.sum, self.squares = 0, np.zeros(()), np.zeros(())

    def add(self, values: np.ndarray) -> None:
        values = np.asarray(values, np.float64).reshape(-1, values.shape[-1])
        self.join(len(values), values.sum(0), (values**2).sum(0))

    def join(self, count: int, total: Any, squares: Any) -> None:
        self.count += count
        self.sum = self.sum + np.asarray(total)
        self.squares = self.squares + np.asarray(squares)

    def listed(self) -> tuple[int, list[float], list[float]]:
        return self.count, np.asarray(self.sum).tolist(), np.asarray(self.squares).tolist()

    def mean_std(self) -> tuple[list[float], list[float]]:
        mean = np.asarray(self.sum) / self.count
        variance = np.asarray(self.squares) / self.count - mean**2
        return mean.tolist(), np.sqrt(np.maximum(variance, 1e-12)).tolist()


def _unfinished(out: str | Path) -> Path:
    return Path(out).with_name(f".{Path(out).name}.tmp")


def begin_latents(out: str | Path, key: str) -> None:
    """Start a new folder of latents beside ``out``, or go on with one of the same key that was not
    finished; then ``write_latent_shard``, by any number of processes, and ``finish_latents`` or
    ``drop_latents``."""
    note = _unfinished(out) / "key"
    if note.is_file() and note.read_text() == key:
        return
    drop_latents(out)
    note.parent.mkdir(parents=True)
    write_text(note, key)


def written_shards(out: str | Path) -> dict[str, int]:
    """Of a folder that is not finished: the items of each complete shard, by its name."""
    notes = sorted(_unfinished(out).glob("latents-*.json"))
    return {
        p.stem.removeprefix("latents-"): len(json.loads(p.read_text())["voxels"]) for p in notes
    }


def drop_latents(out: str | Path) -> None:
    """Remove what ``begin_latents`` started."""
    shutil.rmtree(_unfinished(out), ignore_errors=True)


def write_latent_shard(out: str | Path, name: str, items: Sequence[Mapping[str, Any]]) -> None:
    """One file of items, each a (record, mirrored) pair, and one with their sizes and moments, so
    that the statistics are the same whoever wrote which.

    Args:
      name: of the shard; items are ordered by it.
      items: mappings with ``FIELDS`` (latents of any float type) and ``record`` (index),
        ``mirrored`` (bool).

    Raises:
      ValueError: a value is not finite in half precision.
    """
    moments = {"structure": _Moments(), "latent": _Moments()}
    sizes, packed = [], []
    for item in items:
        arrays = {field: np.asarray(item[field]) for field in FIELDS}
        for field in ("coords", "voxel_part", "images"):
            arrays[field] = arrays[field].astype(np.uint8)
        for field in ROWS:
            arrays[field] = arrays[field].astype(np.int32 if field == "parents" else np.float32)
        for field, moment in moments.items():
            with np.errstate(over="ignore"):
                arrays[field] = arrays[field].astype(np.float16)
            if not np.isfinite(arrays[field]).all():
                raise ValueError(
                    f"latents: {field} of record {item['record']} is not finite in half precision; "
                    "train its network longer"
                )
            moment.add(arrays[field])
        sizes.append(len(arrays["coords"]))
        meta = {"record": int(item["record"]), "mirrored": bool(item["mirrored"])}
        packed.append(pack_arrays(arrays, meta))
    path = _unfinished(out) / f"latents-{name}.arrayrecord"
    write_shard(path, packed)
    found = {"voxels": sizes, **{field: moment.listed() for field, moment in moments.items()}}
    write_text(path.with_suffix(".json"), json.dumps(found))


def finish_latents(out: str | Path, key: str, number: int) -> LatentStatistics:
    """All shards as the complete folder ``out``, in the place of what an earlier pass left there.

    Args:
      number: of items that there must be.

    Raises:
      ValueError: there are no items, or others than ``number``.
    """
    temporary = _unfinished(out)
    structure, latent = _Moments(), _Moments()
    sizes: list[int] = []
    notes = sorted(temporary.glob("latents-*.json"))
    for path in notes:
        found = json.loads(path.read_text())
        structure.join(*found["structure"])
        latent.join(*found["latent"])
        sizes += found["voxels"]
    if not sizes:
        raise ValueError("latents: no items to write; are there records?")
    if len(sizes) != number:
        drop_latents(out)  # all was said to be there: going on would find the same
        raise ValueError(
            f"{out}: {len(sizes)} of {number} latents were there; is it on a file system that all "
            "processes share? The same command encodes anew"
        )
    structure_mean, structure_std = structure.mean_std()
    latent_mean, latent_std = latent.mean_std()
    metadata = {
        "key": key,
        "voxels": sizes,
        "structure_mean": structure_mean,
        "structure_std": structure_std,
        "latent_mean": latent_mean,
        "latent_std": latent_std,
    }
    write_text(temporary / "metadata.json", json.dumps(metadata))
    before = temporary.with_suffix(".old")
    shutil.rmtree(before, ignore_errors=True)
    if Path(out).is_dir():
        Path(out).rename(before)
    temporary.rename(out)
    shutil.rmtree(before, ignore_errors=True)
    for path in (*(Path(out) / note.name for note in notes), Path(out) / "key"):
        path.unlink()
    return read_statistics(out)


def latents_key(folder: str | Path) -> str | None:
    """The key that a complete folder was written with; None where there is none."""
    return read_metadata(folder).get("key") if (Path(folder) / "metadata.json").is_file() else None


def read_statistics(folder: str | Path) -> LatentStatistics:
    """The statistics of a folder of latents."""
    metadata = read_metadata(folder)
    names = [field.name for field in dataclasses.fields(LatentStatistics)]
    missing = [name for name in names if name not in metadata]
    if missing:
        raise ValueError(
            f"{folder}: metadata.json lacks {', '.join(missing)}; encode the records again"
        )
    return LatentStatistics(**{name: np.array(metadata[name], np.float32) for name in names})


class LatentSource:
    """Random access to the items of a folder of latents: ``source[i] -> {field: array}`` in stored
    types. Picklable.

    Args:
      without: fields to pass over.
    """

    def __init__(self, folder: str | Path, without: Collection[str] = ()):
        self._without = tuple(without)
        self.voxels = np.array(read_metadata(folder)["voxels"])
        self._shards = open_shards(sorted(Path(folder).glob("latents-*.arrayrecord")))
        if len(self.voxels) != len(self._shards):
            raise ValueError(
                f"{folder}: {len(self._shards)} items, {len(self.voxels)} expected; encode the "
                "records again"
            )

    def __len__(self) -> int:
        return len(self._shards)

    def __getitem__(self, index: int) -> dict[str, Any]:
        arrays, meta = unpack_arrays(self._shards[index], "latents", self._without)
        return {**arrays, **meta}

    def __repr__(self) -> str:
        return f"LatentSource({len(self)} items)"


def latent_batches(
    latents: str | Path,
    data: DataConfig,
    model: ModelConfig,
    batch_size: int,
    *,
    stage: Literal["structure_flow", "latent_flow"],
    decoded: bool = False,
    seed: int | None = None,
    process_index: int = 0,
    process_count: int = 1,
    accumulate: int = 1,
) -> Batches[StructureBatch | VoxelBatch]:
    """Endless shuffled batches for a flow stage, a random view of each item.

    Both stages: ``image``, with ``data.condition_views`` above 1 so many, the first at random.
    Structure flow: a ``StructureBatch`` with ``structure`` and, ``decoded``, ``occupancy``.
    Latent flow: a ``VoxelBatch`` with ``coords``, ``counts``, ``voxel_part`` and ``latent``, all
    padded to one voxel bucket, and ``plans["flow"]``. A flow that sees layouts: ``layout``, with
    ``data.layout_errors`` in it, and pictures bent by ``data.image_warp`` (not of a structure flow
    that reads pixels). Latents are as encoded; normalise them by ``read_statistics``. Mirrored
    items were encoded as such, so that ``data.mirror_latents`` is decided by what the shards were
    given.

    Args and errors: as ``batches.voxel_batches``; ``decoded``: with what the structure flow's loss
    holds a decoder's output against.
    """
    unread = ["structure"] if stage == "latent_flow" else ["voxel_part", "latent"]
    if stage == "structure_flow" and not decoded:
        unread.append("coords")
    source = LatentSource(latents, without=unread)
    held = len(source[0]["images"]) if len(source) else 1
    check_views(data, held)
    seed = data.seed if seed is None else seed
    if stage == "latent_flow":
        sizes = np.stack([source.voxels, np.zeros_like(source.voxels)], 1)
        records, widths = usable(sizes, data, model.grid)
    else:
        records, widths = np.arange(len(source)), np.zeros(len(source), np.int64)
    one: Callable[..., StructureBatch | VoxelBatch] = _load_latents
    if stage == "structure_flow":
        one = functools.partial(_load_structure, decoded=decoded)
    load = functools.partial(
        one,
        source=source,
        model=model,
        seed=seed,
        rows=local_rows(batch_size, process_index, process_count, accumulate),
        data=data,
    )
    return Batches(ShuffledOrder(records, widths, batch_size, seed), load, data.workers)


def _draw_items(
    draw: Draw,
    source: LatentSource,
    seed: int,
    rows: np.ndarray,
    data: DataConfig,
    flow: FlowConfig,
    most: int,
) -> tuple[list[dict[str, Any]], np.ndarray, Any]:
    """Stored items, their pictures, and the ``PartTable`` that is shown with them or None."""
    views = draw.generator(seed).random(len(draw.records))[rows]
    items = [source[int(index)] for index in draw.records[rows]]
    chosen = [
        item["images"][_views(v, len(item["images"]), data.condition_views)]
        for v, item in zip(views, items, strict=True)
    ]
    image, layout = np.stack(chosen).astype(np.float32) / np.float32(255), None
    if data.condition_views == 1:
        image = image[:, 0]
    if flow.layout_channels:
        seeds = draw.generator(seed + 1).integers(2**31, size=len(draw.records))[rows]
        rngs = [np.random.default_rng([own, 4]) for own in seeds]
        tables = [{name: item[name] for name in ROWS} for item in items]
        tables = [with_errors(t, data.layout_errors, g) for t, g in zip(tables, rngs, strict=True)]
        layout = part_table(tables, most)
        if data.image_warp:
            flat = image.reshape(-1, *image.shape[-3:])
            each = [g for g in rngs for _ in range(data.condition_views)]
            bent = [bend(i, data.image_warp, g) for i, g in zip(flat, each, strict=True)]
            image = np.stack(bent).reshape(image.shape)
    return items, image, layout


def check_views(data: DataConfig, held: int) -> None:
    """ValueError where a flow's step cannot be shown ``data.condition_views`` of ``held`` views."""
    if not 1 <= data.condition_views <= held:
        raise ValueError(
            f"config: data.condition_views is {data.condition_views}, records have {held} views; "
            "give 1 to as many, or prepare records with more --views"
        )


def _views(place: float, held: int, shown: int) -> list[int]:
    """Which of ``held`` views a draw in [0, 1) shows: ``shown`` of them in turn, the first at
    random."""
    first = int(place * held)
    return [(first + k) % held for k in range(shown)]


def _load_structure(
    draw: Draw, *, source: LatentSource, model: ModelConfig, seed: int, rows: np.ndarray, data: DataConfig, decoded: bool  # noqa: E501
) -> StructureBatch:  # fmt: skip
    flow, most = model.structure_flow, model.grid.max_parts
    if flow.pixel_channels:  # it is to trust what it reads at a voxel's place in the picture
        data = dataclasses.replace(data, image_warp=0.0)
    items, image, layout = _draw_items(draw, source, seed, rows, data, flow, most)
    structure, occupancy = np.stack([item["structure"] for item in items]), None
    if decoded:
        occupancy = np.zeros((len(items), *(model.grid.resolution,) * 3), bool)
        for row, item in zip(occupancy, items, strict=True):
            row[tuple(item["coords"].astype(int).T)] = True
    return StructureBatch(structure.astype(np.float32), occupancy, image, layout)


def _load_latents(
    draw: Draw,
    *,
    source: LatentSource,
    model: ModelConfig,
    seed: int,
    rows: np.ndarray,
    data: DataConfig,
) -> VoxelBatch:
    flow, most = model.latent_flow, model.grid.max_parts
    items, image, layout = _draw_items(draw, source, seed, rows, data, flow, most)
    channels = items[0]["latent"].shape[-1]
    coords = np.zeros((len(items), draw.width, 3), np.int32)
    counts = np.array([len(item["coords"]) for item in items], np.int32)
    voxel_part = np.zeros((len(items), draw.width), np.int32)
    latent = np.zeros((len(items), draw.width, channels), np.float32)
    for b, (item, count) in enumerate(zip(items, counts, strict=True)):
        coords[b, :count] = item["coords"]
        voxel_part[b, :count] = item["voxel_part"]
        latent[b, :count] = item["latent"]
    plans = {"flow": flow_plan(coords, counts, model.latent_flow, model.grid)}
    return VoxelBatch(
        coords, counts, voxel_part, latent=latent, plans=plans, layout=layout, image=image
    )

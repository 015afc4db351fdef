"""All records through both VAEs, once: the latents that the flows are trained on."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from uniart_jax.config import Config, ModelConfig
from uniart_jax.data import latents as latent_store
from uniart_jax.data.batches import (
    fitting,
    may_mirror,
    open_records,
    record_batches,
    true_layout,
)
from uniart_jax.data.columns import column_note, column_path
from uniart_jax.data.records import RecordSource, decode_color, decode_sdf, shard_paths
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.network import build
from uniart_jax.runtime.progress import advancing, messages
from uniart_jax.training import distributed
from uniart_jax.training.latent_metric import WEIGHTS, fit_metric
from uniart_jax.voxels.typed_batches import VoxelBatch

ENCODED = ("structure_vae", "uniart_vae")  # what latents depend on
ENCODE_BATCH = 4
SHARD_BATCHES = latent_store.SHARD_ITEMS // ENCODE_BATCH
METRIC_ITEMS, METRIC_VOXELS = 200, 500

console = messages()


def encode_all(config: Config, workdir: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """All records, and their mirror images if asked for and known (``DataConfig``), through both
    VAEs; again only if weights or records changed.

    Several processes share the work; all return when it is done.
    """
    exported = Checkpoint.of_workdir(workdir)
    parameters = {name: exported.load(name, config.model) for name in ENCODED}
    data = config.data
    both = (False, True) if data.mirror_latents and may_mirror(config.model) else (False,)
    jobs = [(data.records, data.split, workdir / "latents", both)]
    if data.validation:
        jobs.append(
            (data.validation, data.validation_split, workdir / "latents-validation", (False,))
        )
    for records, split, out, mirrors in jobs:
        key = digest(config, workdir, Path(records), split)
        if distributed.broadcast_from_first(latent_store.latents_key(out) != key):
            encode_records(config, parameters, records, mirrors, split, out, key)
    found = latent_store.read_statistics(workdir / "latents")
    return {
        "structure": (found.structure_mean, found.structure_std),
        "latent": (found.latent_mean, found.latent_std),
    }


def latent_metric(latents: Path, records: str | Path, share: float, split: str = "") -> np.ndarray:
    """[C, C] of ``training.latent_metric.fit_metric``, from voxels of some items at even distances.

    Args:
      split: of the records, that which was encoded.
    """
    source, tables = latent_store.LatentSource(latents), RecordSource(records, split)
    rng = np.random.default_rng(0)
    found: dict[str, list[np.ndarray]] = {name: [] for name in ("latent", *WEIGHTS)}
    chosen = np.linspace(0, len(source) - 1, min(METRIC_ITEMS, len(source))).astype(int)
    for item in (source[i] for i in np.unique(chosen).tolist()):
        if item["mirrored"]:
            continue
        record = tables[int(item["record"])]
        number = len(record.coords)
        rows = rng.choice(number, min(METRIC_VOXELS, number), replace=False)
        part = record.voxel_part[rows].astype(int)
        found["latent"].append(item["latent"][rows].astype(np.float64))
        found["own_box"].append(record.boxes[part])
        found["joint_code"].append(record.codes[part])
        found["parent_box"].append(record.boxes[record.parents[part]])
        found["color"].append(decode_color(record.color[rows]).mean(1))
        found["sdf"].append(decode_sdf(record.sdf[rows]))
    rows = {name: np.concatenate(values) for name, values in found.items()}
    return fit_metric(rows.pop("latent"), rows, share)


def digest(config: Config, workdir: Path, records: Path, split: str = "") -> str:
    """What latents depend on: both VAEs' sizes and exported weights, the records, their split and
    columns, which of them fit, and mirroring."""
    model = config.model
    sizes = (model.grid, model.structure_vae, model.uniart_vae)
    which = (config.data.mirror_latents, max(config.data.voxel_buckets))
    total = hashlib.sha256(repr((sizes, which, latent_store.FIELDS)).encode())
    for path in [Checkpoint.of_workdir(workdir).folder / f"{name}.safetensors" for name in ENCODED]:
        total.update(path.read_bytes())
    for path in (records / "metadata.json", records / "manifest.csv"):
        total.update(path.read_bytes() if path.is_file() else b"")
    shards = shard_paths(records)
    columns = [
        column_path(path, name) for name in model.uniart_vae.feature_channels for path in shards
    ]
    for path in (*shards, *columns):
        total.update(f"{path.name} {path.stat().st_size}".encode())
    for path in (column_note(records, name) for name in model.uniart_vae.feature_channels):
        total.update(path.read_bytes() if path.is_file() else b"")
    if split:
        total.update(f"split {split}".encode())
    return total.hexdigest()


def encode_records(
    config: Config,
    parameters: dict[str, Any],
    records: str | Path,
    mirrors: Sequence[bool],
    split: str,
    out: Path,
    key: str,
) -> None:
    """Latent means and pictures of every record to the folder ``out``, complete or absent; a pass
    that was cut off goes on at the next shard of 256 items.

    A process encodes each n-th shard on its first device; the folder is the same whatever their
    number.

    Args:
      mirrors: which passes to make, of the records as they are and of their mirror images.
      key: of ``digest``.
    """
    if distributed.is_first():
        console.print(f"encoding {records}")
    # what lies in which shard depends on all widths, what is encoded on the largest alone
    order = f"{key} {sorted(config.data.voxel_buckets)}"
    distributed.on_first_process(lambda: latent_store.begin_latents(out, order))
    _encode_shards(config, parameters, records, mirrors, split, out)
    distributed.wait()
    features = config.model.uniart_vae.feature_channels
    _, sizes = open_records(records, config.model.grid, split, features)
    number = int(fitting(sizes, config.data, config.model.grid).sum()) * len(mirrors)
    distributed.on_first_process(lambda: latent_store.finish_latents(out, key, number))


def _encode_shards(
    config: Config,
    parameters: dict[str, Any],
    records: str | Path,
    mirrors: Sequence[bool],
    split: str,
    out: Path,
) -> None:
    """This process's shards, but for those that are there."""
    index, count = jax.process_index(), jax.process_count()
    parameters = jax.device_put(parameters, jax.local_devices()[0])
    total = len(RecordSource(records, split)) * len(mirrors) // count
    written = latent_store.written_shards(out)
    done = sum(written[name] for name in written if int(name.split("-")[1]) % count == index)
    total = max(total - done, 0)
    shown = advancing("encoding", total) if index == 0 else contextlib.nullcontext(lambda: None)
    with shown as advance:
        for mirrored in mirrors:

            def mine(shard: int, mirrored: bool = mirrored) -> bool:
                return shard % count == index and _shard_name(mirrored, shard) not in written

            batches = record_batches(
                records,
                config.data,
                config.model,
                ENCODE_BATCH,
                split=split,
                mirrored=mirrored,
                mine=lambda number, mine=mine: mine(number // SHARD_BATCHES),
            )
            left = (n for n in itertools.count(index, count) if mine(n))
            numbered = zip((n for n in left for _ in range(SHARD_BATCHES)), batches, strict=False)
            for shard, group in itertools.groupby(numbered, key=lambda pair: pair[0]):
                items = []
                for _, batch in group:
                    items += encode_batch(config.model, parameters, batch, mirrored)
                    for _ in range((batch.record >= 0).sum()):
                        advance()
                latent_store.write_latent_shard(out, _shard_name(mirrored, shard), items)


def _shard_name(mirrored: bool, shard: int) -> str:
    return f"{mirrored:d}-{shard:05d}"


def encode_batch(
    model: ModelConfig, parameters: dict[str, Any], batch: VoxelBatch, mirrored: bool
) -> list[dict[str, Any]]:
    """Items for ``latents.write_latent_shard`` of a batch of ``record_batches``."""
    read = batch._replace(images=None, record=None, part_counts=None, layout=None)
    out = jax.device_get(make_encoder(model)(parameters, read))
    items = []
    for b in np.nonzero(batch.record >= 0)[0]:
        count = batch.counts[b]
        items.append(
            {
                "record": int(batch.record[b]),
                "mirrored": mirrored,
                "structure": out["structure"][b],
                "coords": batch.coords[b, :count],
                "voxel_part": batch.voxel_part[b, :count],
                "latent": out["latent"][b, :count],
                "images": np.round(batch.images[b] * 255),
                **true_layout(batch, int(b)),
            }
        )
    return items


def dense_occupancy(coords: jax.Array, counts: jax.Array, resolution: int) -> jax.Array:
    """[B, R, R, R] float32, 1 at the active voxels of padded coords [B, V, 3]."""
    valid = (jnp.arange(coords.shape[1]) < counts[:, None]).astype(jnp.float32)

    def one(coords, valid):
        return jnp.zeros((resolution,) * 3).at[coords[:, 0], coords[:, 1], coords[:, 2]].max(valid)

    return jax.vmap(one)(coords, valid)


@functools.lru_cache(maxsize=2)  # records and validation share one program
def make_encoder(model: ModelConfig) -> Callable[..., dict[str, jax.Array]]:
    """Jitted (parameters of both VAEs, voxel batch) -> structure, latent."""
    structure_vae, uniart_vae = (build(n, model) for n in ENCODED)

    @functools.partial(jax.jit)
    def encode(parameters, voxels):
        occupancy = dense_occupancy(voxels.coords, voxels.counts, model.grid.resolution)
        structure, _ = structure_vae.apply(parameters["structure_vae"], occupancy, method="encode")
        latent = uniart_vae.apply(parameters["uniart_vae"], voxels, method="encode")["mean"]
        return {"structure": structure, "latent": latent}

    return encode

"""All records through both VAEs, once: the latents that the flows are trained on."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console

from uniart_jax.config import Config, ModelConfig
from uniart_jax.data import latents as latent_store
from uniart_jax.data.batches import may_mirror, record_batches
from uniart_jax.data.columns import column_note, column_path
from uniart_jax.data.records import RecordSource, decode_color, decode_sdf, shard_paths
from uniart_jax.models.network import build
from uniart_jax.progress import advancing
from uniart_jax.training.export import load_network
from uniart_jax.training.readout import WEIGHTS, fit_metric

ENCODED = ("structure_vae", "uniart_vae")  # what latents depend on
ENCODE_KEYS = (
    "coords",
    "counts",
    "sdf",
    "color",
    "owner",
    "voxel_part",
    "boxes",
    "codes",
    "parents",
    "plans",
)
ENCODE_BATCH = 4
METRIC_ITEMS, METRIC_VOXELS = 200, 500

console = Console(stderr=True, highlight=False)


def encode_all(config: Config, workdir: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """All records, and their mirror images if asked for and known (``DataConfig``), through both VAEs; again only if weights or records changed."""
    parameters = {
        name: load_network(workdir, name, build(name, config.model).abstract()) for name in ENCODED
    }
    data = config.data
    both = (False, True) if data.mirror_latents and may_mirror(config.model) else (False,)
    jobs = [(data.records, data.split, workdir / "latents", both)]
    if data.validation:
        jobs.append((data.validation, data.validation_split, workdir / "latents-validation", (False,)))  # fmt: skip
    for records, split, out, mirrors in jobs:
        key = digest(config, workdir, Path(records), split)
        if latent_store.latents_key(out) != key:
            console.print(f"encoding {records}")
            items = encode_records(config, parameters, records, mirrors, split)
            latent_store.write_latents(out, items, key=key)
    found = latent_store.read_statistics(workdir / "latents")
    return {
        "structure": (found.structure_mean, found.structure_std),
        "latent": (found.latent_mean, found.latent_std),
    }


def latent_metric(latents: Path, records: str | Path, share: float, split: str = "") -> np.ndarray:
    """[C, C] of ``training.readout.fit_metric``, from voxels of some items at even distances.

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
    """What latents depend on: both VAEs' sizes and exported weights, the records, their split and columns, and mirroring."""
    model = config.model
    sizes = (model.grid, model.structure_vae, model.uniart_vae)
    total = hashlib.sha256(repr((sizes, config.data.mirror_latents, latent_store.FIELDS)).encode())
    for path in [workdir / "export" / f"{name}.safetensors" for name in ENCODED]:
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
    split: str = "",
) -> Iterator[dict[str, Any]]:
    """Items for ``latents.write_latents``: latent means and pictures of every record."""
    encode = make_encoder(config.model)
    keys = (*ENCODE_KEYS, *config.model.uniart_vae.feature_channels)
    with advancing("encoding", len(RecordSource(records, split)) * len(mirrors)) as advance:
        for mirrored in mirrors:
            for batch in record_batches(
                records, config.data, config.model, ENCODE_BATCH, split=split, mirrored=mirrored
            ):
                out = jax.device_get(encode(parameters, {key: batch[key] for key in keys}))
                for b in np.nonzero(batch["record"] >= 0)[0]:
                    count = batch["counts"][b]
                    yield {
                        "record": int(batch["record"][b]),
                        "mirrored": mirrored,
                        "structure": out["structure"][b],
                        "coords": batch["coords"][b, :count],
                        "voxel_part": batch["voxel_part"][b, :count],
                        "latent": out["latent"][b, :count],
                        "images": np.round(batch["images"][b] * 255),
                    }
                    advance()


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
        occupancy = dense_occupancy(voxels["coords"], voxels["counts"], model.grid.resolution)
        structure, _ = structure_vae.apply(parameters["structure_vae"], occupancy, method="encode")
        latent = uniart_vae.apply(parameters["uniart_vae"], voxels, method="encode")["mean"]
        return {"structure": structure, "latent": latent}

    return encode

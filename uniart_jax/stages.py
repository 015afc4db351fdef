"""Training from records to an exported checkpoint: what each stage reads, minimises and is judged by.

    image_encoder   images -> coarse occupancy, boxes, joints            (then frozen)
    structure_vae   occupancy <-> dense latent
    uniart_vae      voxels with everything on them <-> latent per voxel
    (encode)        all records through both VAEs, once
    structure_flow  noise -> structure latent, given the image
    latent_flow     noise on the active voxels -> UniArt latent, given the image

WORKDIR holds ``config.json``, ``checkpoints/<stage>``, ``metrics``, ``tensorboard``, ``latents`` and ``export``, the checkpoint that sampling
loads. Every stage resumes by itself; a finished one is skipped.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console

from uniart_jax.config import NETWORKS, Config, GridConfig, ModelConfig
from uniart_jax.data import latents as latent_store
from uniart_jax.data.batches import record_batches, voxel_batches
from uniart_jax.data.folder import read_manifest, read_metadata
from uniart_jax.data.image_table import image_batches, load_image_table
from uniart_jax.data.prepare import prepare_procedural
from uniart_jax.data.records import RecordSource, decode_color, decode_sdf, shard_paths
from uniart_jax.models.network import build
from uniart_jax.pipeline import checkpoint_folder
from uniart_jax.progress import advancing
from uniart_jax.training import objectives
from uniart_jax.training.checkpoints import Checkpoints
from uniart_jax.training.export import (
    copy_export,
    export_network,
    find_export,
    load_network,
    read_config,
    read_statistics,
    write_config,
    write_statistics,
)
from uniart_jax.training.loop import run_stage
from uniart_jax.training.readout import WEIGHTS, fit_metric
from uniart_jax.training.sharding import make_mesh, put_batch
from uniart_jax.training.state import begin_with, create_state, make_optimizer
from uniart_jax.training.step import make_train_step
from uniart_jax.validation import load_conditioner, make_evaluation

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


def run(
    config: Config, stages: Sequence[str], workdir: Path, init: str | Path | None = None
) -> None:
    """Train ``stages`` in their order; prepares the config's own procedural records first if they are not there.

    Args:
      init: a checkpoint (``pipeline.checkpoint_folder``) to go on from, see ``adopt``. A stage that has a checkpoint of its own resumes from that.

    Raises:
      ValueError: WORKDIR belongs to another model, a flow's checkpoint to other inputs, or ``init`` does not fit the config.
      FileNotFoundError: records or an earlier stage's weights are missing.
      FloatingPointError: loss or gradients are not finite.
    """
    workdir = Path(workdir)
    if not config.data.records:
        raise ValueError(
            "config: data.records is empty; give the folder of 'uniart prepare … --out FOLDER'"
        )
    source = None if init is None else checkpoint_folder(init)
    taken: list[str] = []
    if source is not None:  # before anything is written
        for name in stages:
            load_network(source, name, build(name, config.model).abstract())
        taken = adoptable(config, source, stages, workdir)
    claim(config, workdir)
    alone = [n for n in stages if n not in ("image_encoder", "structure_vae")]
    if jax.process_count() > 1 and alone:
        # segment plans index one process's own tokens, and latents are written by one process
        raise ValueError(
            f"stage {alone[0]}: trains on one process (all its devices); start it without jax.distributed"
        )
    if source is not None:
        adopt(source, taken, workdir)
    ensure_records(config)
    for name in (n for n in NETWORKS if n in stages):
        train_network(name, config, workdir, source)


def adoptable(config: Config, source: Path, stages: Sequence[str], workdir: Path) -> list[str]:
    """The networks that checkpoint ``source`` has, WORKDIR lacks and that are not trained now.

    A flow is taken only if it will stand in WORKDIR on the encoder and the VAEs that it was trained on: elsewhere it would speak of other latents.

    Raises:
      ValueError: one of them does not fit the config.
    """
    found = []
    for name in NETWORKS:
        if name in stages or exported(workdir, name) or not in_export(source, name):
            continue
        if name.endswith("_flow") and not same_ground(source, stages, workdir):
            continue
        load_network(source, name, build(name, config.model).abstract())
        found.append(name)
    return found


def adopt(source: Path, names: Sequence[str], workdir: Path) -> None:
    """Copy networks of checkpoint ``source`` into WORKDIR, a flow with the statistics of its latent."""
    for name in names:
        copy_export(source, workdir / "export", f"{name}.safetensors")
        if (latent := name.removesuffix("_flow")) != name:
            mean, std = read_statistics(source, latent)
            write_statistics(workdir / "export", latent, mean, std)


def in_export(folder: Path, name: str) -> bool:
    """Whether a checkpoint (export folder or WORKDIR) holds a network."""
    try:
        find_export(folder, f"{name}.safetensors")
    except FileNotFoundError:
        return False
    return True


def same_ground(source: Path, stages: Sequence[str], workdir: Path) -> bool:
    """Whether flows of ``source`` fit WORKDIR: none of image encoder and VAEs is trained now, and WORKDIR has the source's, or will take them."""
    return all(
        name not in stages
        and in_export(source, name)
        and (
            not exported(workdir, name)
            or find_export(source, f"{name}.safetensors").read_bytes()
            == find_export(workdir / "export", f"{name}.safetensors").read_bytes()
        )
        for name in ("image_encoder", *ENCODED)
    )


def claim(config: Config, workdir: Path) -> None:
    """Make WORKDIR this config's, or check that it is: one folder holds one model."""
    if (workdir / "config.json").is_file():
        found = read_config(workdir)
        runtime = {"kernel": config.model.kernel, "compute_dtype": config.model.compute_dtype}
        other = dataclasses.replace(found.model, **runtime)
        parts = [f.name for f in dataclasses.fields(other)]
        differ = [n for n in parts if getattr(other, n) != getattr(config.model, n)]
        if differ:
            raise ValueError(
                f"workdir '{workdir}' holds another model (different: {', '.join(f'model.{n}' for n in differ)}); "
                "choose another --workdir"
            )
    workdir.mkdir(parents=True, exist_ok=True)
    write_config(workdir, config)
    write_config(workdir / "export", config)


def ensure_records(config: Config) -> None:
    """Prepare the training and validation records that the config describes, where they are not there yet.

    Raises:
      ValueError: a folder holds records of other settings; all that differ are named.
    """
    data, grid = config.data, config.model.grid
    if not data.procedural:
        return
    options: dict[str, Any] = {
        "grid": GridConfig(grid.resolution, grid.subdivisions),
        "image_size": config.model.image_encoder.image_size,
        "views": data.views,
        "processes": os.cpu_count() or 1,
    }
    for folder, count, seed in (
        (data.records, data.procedural, 0),
        (data.validation, data.validation_count, data.validation_seed),
    ):
        if not folder:
            continue
        if prepared_objects(Path(folder)) >= count:
            asked = {
                "start_seed": seed,
                "resolution": grid.resolution,
                "subdivisions": grid.subdivisions,
                "image_size": options["image_size"],
                "views": data.views,
            }
            found = read_metadata(folder)
            if differ := [key for key in asked if found.get(key) != asked[key]]:
                listed = ", ".join(f"{k} {found.get(k)} instead of {asked[k]}" for k in differ)
                raise ValueError(
                    f"{folder}: holds records of other settings ({listed}); "
                    "give another --data.records or --data.validation, or the config these settings"
                )
        else:
            console.print(f"preparing {count} procedural objects in {folder}")
            prepare_procedural(Path(folder), count, start_seed=seed, **options)


def prepared_objects(folder: Path) -> int:
    """How many objects the manifest of a complete prepared folder names; 0 without one."""
    if not (folder / "manifest.csv").is_file():
        return 0
    return len({(row["family"], row["seed"]) for row in read_manifest(folder)})


def train_network(name: str, config: Config, workdir: Path, source: Path | None = None) -> None:
    """One stage, from its checkpoint, the weights of checkpoint ``source`` or from scratch, to ``WORKDIR/export/<name>.safetensors``."""
    stage = getattr(config, name)
    network = build(name, config.model)
    mesh = make_mesh(config.mesh)
    folder = workdir / "checkpoints" / name
    statistics: dict[str, Any] | None = None
    units = None
    if name.endswith("_flow"):
        if source is not None and same_ground(source, (), workdir):
            units = source  # flows of the same encoder and VAEs go on in the units that they know
        claim_inputs(folder, config, workdir, units)
    with Checkpoints(folder, stage.keep_checkpoints) as checkpoints:
        trained = max(checkpoints.steps, default=0)
        if trained >= stage.steps and exported(workdir, name):
            console.print(f"{name}: already trained ({stage.steps} steps); skipped")
            return
    if name.endswith("_flow"):
        statistics = encode_all(config, workdir)
        latent = name.removesuffix("_flow")
        if units is not None:
            statistics[latent] = read_statistics(units, latent)
        write_statistics(workdir / "export", latent, *statistics[latent])
    make_loss: Callable[..., Any] = getattr(objectives, f"make_{name}_loss")
    extra = list((statistics or {}).get(name.removesuffix("_flow"), ()))
    if name == "latent_flow" and config.loss.readout_share:
        extra.append(latent_metric(workdir / "latents", config.data.records, config.loss.readout_share))  # fmt: skip
    loss_fn = make_loss(network, config, *extra)
    key = jax.random.fold_in(jax.random.key(config.seed), NETWORKS.index(name))
    optimizer = make_optimizer(stage)
    start = create_state(network.init, optimizer, key, mesh)
    if source is not None and not trained:
        start = begin_with(start, load_network(source, name, network.abstract()))
    with Checkpoints(folder, stage.keep_checkpoints) as checkpoints:
        state = run_stage(
            name,
            state=start,
            train_step=make_train_step(loss_fn, optimizer, stage.ema_decay),
            batches=iter(stage_batches(name, config, workdir)),
            put=make_put(name, config, workdir, mesh),
            key=jax.random.fold_in(key, 1),
            checkpoints=checkpoints,
            stage=stage,
            workdir=workdir,
            evaluate=make_evaluation(name, config, workdir, statistics),
        )
    export_network(workdir / "export", name, state.ema)  # on every process; the first one writes


def stage_batches(name: str, config: Config, workdir: Path) -> Any:
    """The endless Grain pipeline of a stage; ``batch_size`` is over all processes."""
    batch_size = getattr(config, name).batch_size
    if name not in ("image_encoder", "structure_vae"):
        load_image_table.cache_clear()  # a gigabyte that nobody reads any more
    share = {"process_index": jax.process_index(), "process_count": jax.process_count()}
    if name in ("image_encoder", "structure_vae"):
        return image_batches(config.data.records, config.data, config.model, batch_size, **share)
    if name == "uniart_vae":
        return voxel_batches(config.data.records, config.data, config.model, batch_size, **share)
    flow: Any = name
    return latent_store.latent_batches(
        workdir / "latents", config.data, config.model, batch_size, stage=flow, **share
    )


def exported(workdir: Path, name: str) -> bool:
    """Whether the stage has left its weights."""
    return (workdir / "export" / f"{name}.safetensors").is_file()


def claim_inputs(folder: Path, config: Config, workdir: Path, units: Path | None = None) -> None:
    """Tie a flow's checkpoints to the latents, their units (of checkpoint ``units``, or the records' own) and the image encoder that it trains on.

    Raises:
      FileNotFoundError: a network that it needs has not been trained.
      ValueError: the checkpoints belong to others; a flow finished on these would not fit the networks exported beside it.
    """
    for name in ("image_encoder", *ENCODED):
        if not exported(workdir, name):
            raise FileNotFoundError(
                f"{workdir}/export/{name}.safetensors: not there; train it first: --stage {name}"
            )
    encoder = (workdir / "export" / "image_encoder.safetensors").read_bytes()
    latents = digest(config, workdir, Path(config.data.records))
    key = f"{latents} {hashlib.sha256(encoder).hexdigest()}"
    if units is not None:
        both = read_statistics(units, folder.name.removesuffix("_flow"))
        key += f" {hashlib.sha256(b''.join(v.tobytes() for v in both)).hexdigest()}"
    note = folder.with_name(f"{folder.name}.inputs")
    trained = folder.is_dir() and any(p.name.isdigit() for p in folder.iterdir())
    if trained and note.is_file() and note.read_text() != key:
        raise ValueError(
            f"{folder} was trained on other inputs (records, an earlier network or --init changed since); "
            "remove that folder to train this flow on the new ones"
        )
    note.parent.mkdir(parents=True, exist_ok=True)
    note.write_text(key)


def make_put(
    name: str, config: Config, workdir: Path, mesh: jax.sharding.Mesh
) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Host batch -> what the stage's loss reads, on the devices; for a flow, images through the frozen image encoder."""
    wanted = {"structure_vae": ("occupancy",)}.get(name)
    if not name.endswith("_flow"):
        return lambda batch: put_batch({k: batch[k] for k in wanted or batch}, mesh)
    condition = load_conditioner(config, workdir, mesh)

    def put(batch: dict[str, Any]) -> dict[str, Any]:
        rest = put_batch(batch, mesh)
        return {**condition(rest.pop("image"))._asdict(), **rest}

    return put


def encode_all(config: Config, workdir: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """All records, and their mirror images if asked for, through both VAEs; again only if weights or records changed."""
    parameters = {
        name: load_network(workdir, name, build(name, config.model).abstract()) for name in ENCODED
    }
    jobs = [
        (
            config.data.records,
            workdir / "latents",
            (False, True) if config.data.mirror_latents else (False,),
        )
    ]
    if config.data.validation:
        jobs.append((config.data.validation, workdir / "latents-validation", (False,)))
    for records, out, mirrors in jobs:
        key = digest(config, workdir, Path(records))
        if latent_store.latents_key(out) != key:
            console.print(f"encoding {records}")
            latent_store.write_latents(
                out, encode_records(config, parameters, records, mirrors), key=key
            )
    found = latent_store.read_statistics(workdir / "latents")
    return {
        "structure": (found.structure_mean, found.structure_std),
        "latent": (found.latent_mean, found.latent_std),
    }


def latent_metric(latents: Path, records: str | Path, share: float) -> np.ndarray:
    """[C, C] of ``training.readout.fit_metric``, from voxels of some items at even distances."""
    source, tables = latent_store.LatentSource(latents), RecordSource(records)
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


def digest(config: Config, workdir: Path, records: Path) -> str:
    """What latents depend on: both VAEs' sizes and exported weights, the records, and mirroring."""
    model = config.model
    sizes = (model.grid, model.structure_vae, model.uniart_vae)
    total = hashlib.sha256(repr((sizes, config.data.mirror_latents, latent_store.FIELDS)).encode())
    for path in [workdir / "export" / f"{name}.safetensors" for name in ENCODED]:
        total.update(path.read_bytes())
    for path in (records / "metadata.json", records / "manifest.csv"):
        total.update(path.read_bytes() if path.is_file() else b"")
    for path in shard_paths(records):
        total.update(f"{path.name} {path.stat().st_size}".encode())
    return total.hexdigest()


def encode_records(
    config: Config, parameters: dict[str, Any], records: str | Path, mirrors: Sequence[bool]
) -> Iterator[dict[str, Any]]:
    """Items for ``latents.write_latents``: latent means and pictures of every record."""
    encode = make_encoder(config.model)
    with advancing("encoding", len(RecordSource(records)) * len(mirrors)) as advance:
        for mirrored in mirrors:
            for batch in record_batches(
                records, config.data, config.model, ENCODE_BATCH, mirrored=mirrored
            ):
                out = jax.device_get(encode(parameters, {key: batch[key] for key in ENCODE_KEYS}))
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

"""Training from records to an exported checkpoint: what each stage reads, minimises and is judged by.

    image_encoder   images -> coarse occupancy, boxes, joints            (then frozen)
    structure_vae   occupancy <-> dense latent
    uniart_vae      voxels with everything on them <-> latent per voxel
    (encode)        all records through both VAEs, once
    structure_flow  noise -> structure latent, given the image
    latent_flow     noise on the active voxels -> UniArt latent, given the image
    layout          images -> the object's parts as a set (where the config has ``layout.queries``)

WORKDIR holds ``config.json``, ``checkpoints/<stage>``, ``metrics``, ``tensorboard``, ``latents`` and ``export``, the checkpoint that sampling
loads. Every stage resumes by itself; a finished one is skipped.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import optax

from uniart_jax.adoption import (
    adopt,
    adoptable,
    exported,
    first_weights,
    mark,
    same_ground,
    untrained,
)
from uniart_jax.config import STAGES, Config
from uniart_jax.data import latents as latent_store
from uniart_jax.data.batches import voxel_batches
from uniart_jax.data.folder import write_text
from uniart_jax.data.image_table import image_batches, load_image_table
from uniart_jax.data.layouts import layout_batches
from uniart_jax.encoding import ENCODED, digest, encode_all, latent_metric
from uniart_jax.layouts import first_layout_weights
from uniart_jax.locks import alone
from uniart_jax.models.network import Network, build
from uniart_jax.progress import messages
from uniart_jax.samplers import make_conditioner, make_layout_finder
from uniart_jax.stage_checks import (
    check_features,
    check_found,
    check_freeze,
    check_settings,
    ensure_records,
    overlapping,
)
from uniart_jax.training import distributed, objectives
from uniart_jax.training.checkpoints import Checkpoints
from uniart_jax.training.export import (
    checkpoint_folder,
    export_network,
    has_export,
    load_network,
    read_config,
    read_statistics,
    write_config,
    write_statistics,
)
from uniart_jax.training.loop import run_stage
from uniart_jax.training.microbatches import in_parts
from uniart_jax.training.programs import Programs
from uniart_jax.training.sharding import make_mesh, put_batch, replicated
from uniart_jax.training.state import (
    abstract_state,
    begin_with,
    create_state,
    make_optimizer,
)
from uniart_jax.training.step import make_train_step
from uniart_jax.validation import make_evaluation

RUNTIME = ("kernel", "compute_dtype", "scan_blocks", "remat")  # how a model is run, not what it is
console = messages()


def run(
    config: Config, stages: Sequence[str], workdir: Path, init: str | Path | None = None
) -> None:
    """Train ``stages`` in their order; prepares the config's own procedural records first if they are not there.

    Args:
      init: a checkpoint (``training.export.checkpoint_folder``) to go on from, see ``adopt``; default: the config's own. A stage that has a checkpoint of
        its own resumes from that.

    Raises:
      ValueError: WORKDIR belongs to another model or another process works in it, a setting is out of range, a flow's checkpoint to other inputs, ``init`` does not fit the config, or a stage's ``freeze`` its network.
      FileNotFoundError: records or an earlier stage's weights are missing.
      FloatingPointError: loss or gradients are not finite (``StageConfig.skip_not_finite``).
    """
    workdir = Path(workdir)
    if not config.data.records:
        raise ValueError(
            "config: data.records is empty; give the folder of 'uniart prepare … --out FOLDER'"
        )
    stages = trainable(config, stages)
    check_settings(config, stages)
    check_features(config, stages)
    if overlapping(config.data) and distributed.is_first():
        warnings.warn("data.validation holds records that are trained on: its figures say nothing about new objects; give another folder or split", stacklevel=2)  # fmt: skip
    init = init or config.init
    source = checkpoint_folder(init) if init else None
    taken: list[str] = []
    check_freeze(config, stages)
    if source is not None:  # before anything is written
        for name in stages:
            first_weights(source, name, config.model)
        taken = adoptable(config, source, stages, workdir)
    check_found(config, stages, workdir, taken)
    with alone(workdir) if distributed.is_first() else contextlib.nullcontext():
        _run(config, stages, workdir, source, taken)


def _run(
    config: Config, stages: Sequence[str], workdir: Path, source: Path | None, taken: Sequence[str]
) -> None:
    """``run``, once all is looked at that can be before anything is written."""
    distributed.first_does(lambda: claim(config, workdir))
    if not (workdir / "config.json").is_file():
        raise ValueError(
            f"workdir '{workdir}': not the first process's folder; give all processes one on a shared file system"
        )
    if source is not None:
        adopt(source, taken, workdir)
    if set(stages) != {"layout"}:  # which makes its own
        distributed.first_does(lambda: ensure_records(config))
    for name in (n for n in STAGES if n in stages):
        train_network(name, config, workdir, source)


def trainable(config: Config, stages: Sequence[str]) -> list[str]:
    """The stages without the image encoder where that is DINOv2, which is frozen, and without the layout where there is none.

    Raises:
      ValueError: nothing else was asked for.
    """
    left = list(stages)
    if not config.model.layout.queries and "layout" in left:
        left.remove("layout")
        if not left:
            raise ValueError("stage layout: the config has none; give --model.layout.queries 16")
    if config.model.image_encoder.architecture == "dinov2" and "image_encoder" in left:
        left.remove("image_encoder")
        if not left:
            raise ValueError(
                "stage image_encoder: DINOv2 is taken as it is, not trained; "
                "convert its weights (uniart convert dinov2 FILE --out CHECKPOINT) and give CHECKPOINT as --init"
            )
    return left


def claim(config: Config, workdir: Path) -> None:
    """Make WORKDIR this config's, or check that it is: one folder holds one model."""
    if (workdir / "config.json").is_file():
        found = read_config(workdir)
        runtime = {name: getattr(config.model, name) for name in RUNTIME}
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
    write_config(
        workdir / "export", dataclasses.replace(config, untrained=untrained(workdir / "export"))
    )


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
        distributed.first_does(lambda: claim_inputs(folder, config, workdir, units))
    with Checkpoints(folder, stage.keep_checkpoints) as checkpoints:
        trained = distributed.told(max(checkpoints.steps, default=0))
    if distributed.told(trained >= stage.steps and exported(workdir, name)):
        if distributed.is_first():
            console.print(f"{name}: already trained ({stage.steps} steps); skipped")
        return
    items = stage.batch_size // stage.accumulate
    if items % mesh.size and jax.process_count() == 1:  # of several, sending the batch is an error
        console.print(f"{name}: {items} items at once do not divide over {mesh.size} devices, so each computes all of them; give a batch_size that does", style="yellow")  # fmt: skip
    if name.endswith("_flow"):
        statistics = encode_all(config, workdir)
        latent = name.removesuffix("_flow")
        if units is not None:
            statistics[latent] = read_statistics(units, latent)
        ours = statistics[latent]
        distributed.first_does(lambda: write_statistics(workdir / "export", latent, *ours))
    key = jax.random.fold_in(jax.random.key(config.seed), STAGES.index(name))
    optimizer = make_optimizer(stage)
    step = make_step(name, network, optimizer, config, workdir, mesh, statistics, source)
    if trained:  # nothing that the checkpoint would replace
        start = abstract_state(network.init, optimizer, mesh)
    else:
        start = create_state(network.init, optimizer, key, mesh)
        if source is not None:
            start = begin_with(start, first_weights(source, name, config.model))
        elif name == "layout":
            start = begin_with(start, first_layout_weights(config))
    batches = stage_batches(name, config, workdir)
    with (
        Checkpoints(folder, stage.keep_checkpoints) as checkpoints,
        contextlib.closing(iter(batches)) as iterator,
    ):
        state = run_stage(
            name,
            state=start,
            train_step=step,
            batches=iterator,
            put=in_parts(make_put(name, mesh), stage.accumulate, config.model),
            key=jax.random.fold_in(key, 1),
            checkpoints=checkpoints,
            stage=stage,
            workdir=workdir,
            evaluate=distributed.by_the_first(make_evaluation(name, config, workdir, statistics)),
        )
    export_network(workdir / "export", name, state.ema)  # on every process; the first one writes
    distributed.first_does(lambda: mark(workdir, [name], ()))


def stage_batches(name: str, config: Config, workdir: Path) -> Any:
    """The endless batches of a stage; ``batch_size`` is over all processes."""
    batch_size = getattr(config, name).batch_size
    if name not in ("image_encoder", "structure_vae"):
        load_image_table.cache_clear()  # a gigabyte that nobody reads any more
    share: dict[str, Any] = {
        "process_index": jax.process_index(),
        "process_count": jax.process_count(),
        "accumulate": getattr(config, name).accumulate,
    }
    if name == "layout":
        return layout_batches(config.data, config.model, batch_size, **share)
    records = (config.data.records, config.data, config.model, batch_size)
    of_records = {"split": config.data.split, **share}
    if name in ("image_encoder", "structure_vae"):
        return image_batches(*records, **of_records)
    if name == "uniart_vae":
        items = batch_size // (share["process_count"] * share["accumulate"])
        devices = jax.local_device_count()
        shares = devices if items and items % devices == 0 else 1
        shown = config.loss.sampled > 0
        return voxel_batches(*records, **of_records, shares=shares, shown=shown)
    flow: Any = name
    decoded = name == "latent_flow" and config.loss.decoded > 0
    folder = workdir / "latents"
    return latent_store.latent_batches(
        folder, config.data, config.model, batch_size, stage=flow, decoded=decoded, **share
    )


def claim_inputs(folder: Path, config: Config, workdir: Path, units: Path | None = None) -> None:
    """Tie a flow's checkpoints to the latents, their units (of checkpoint ``units``, or the records' own) and the image encoder that it trains on.

    Raises:
      FileNotFoundError: a network that it needs has not been trained.
      ValueError: the checkpoints belong to others; a flow finished on these would not fit the networks exported beside it.
    """
    for name in ("image_encoder", *ENCODED):
        if not exported(workdir, name):
            frozen = name == "image_encoder" and config.model.image_encoder.architecture == "dinov2"
            how = "give a checkpoint that has it as --init" if frozen else f"train it first: --stage {name}"  # fmt: skip
            raise FileNotFoundError(f"{workdir}/export/{name}.safetensors: not there; {how}")
        if left := [m for m in untrained(workdir / "export") if m.split(".")[0] == name]:
            raise ValueError(f"{name}: not trained yet ({', '.join(left)}); train it first: --stage {name}")  # fmt: skip
    encoder = (workdir / "export" / "image_encoder.safetensors").read_bytes()
    latents = digest(config, workdir, Path(config.data.records), config.data.split)
    key = f"{latents} {hashlib.sha256(encoder).hexdigest()}"
    if config.loss.found:
        layout = (workdir / "export" / "layout.safetensors").read_bytes()
        key += f" {hashlib.sha256(layout).hexdigest()}"
    if units is not None:
        both = read_statistics(units, folder.name.removesuffix("_flow"))
        key += f" {hashlib.sha256(b''.join(v.tobytes() for v in both)).hexdigest()}"
    note = folder.with_name(f"{folder.name}.inputs")
    trained = folder.is_dir() and any(p.name.isdigit() for p in folder.iterdir())
    if trained and note.is_file() and note.read_text() != key:
        raise ValueError(
            f"{folder} was trained on other inputs (records, voxel_buckets, an earlier network, the "
            "layout network where loss.found shows its layouts, --init or the version changed since); "
            "remove that folder to train this flow on the new ones"
        )
    note.parent.mkdir(parents=True, exist_ok=True)
    if not note.is_file() or note.read_text() != key:
        write_text(note, key)


def latent_sampler_of(config: Config, workdir: Path, source: Path | None) -> tuple[Any, Any]:
    """Parameters of (image encoder, latent flow) of WORKDIR, or else of checkpoint ``source``, and
    (mean, std) of the flow's latents.

    Raises:
      FileNotFoundError: neither has them. ValueError: the encoder would be trained, and its latents
        so be others than the flow's.
    """
    if not {"front", "encoder"} <= set(config.uniart_vae.freeze):
        raise ValueError(
            "loss.sampled: the flow's latents are those of the encoder as it is; "
            "give --uniart_vae.freeze front encoder"
        )
    names = ("image_encoder", "latent_flow")
    for folder in (workdir / "export", source):
        if folder is not None and all(has_export(folder, f"{n}.safetensors") for n in names):
            parameters = tuple(
                load_network(folder, n, build(n, config.model).abstract()) for n in names
            )
            return parameters, read_statistics(folder, "latent")
    raise FileNotFoundError(
        "loss.sampled: needs a trained image encoder and latent flow; "
        "give a checkpoint that has them as --init"
    )


def make_put(name: str, mesh: jax.sharding.Mesh) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Host batch -> what the stage's loss reads, on the devices."""
    wanted = {"structure_vae": ("occupancy",)}.get(name)
    return lambda batch: put_batch({k: batch[k] for k in wanted or batch}, mesh)


def make_step(
    name: str,
    network: Network,
    optimizer: optax.GradientTransformation,
    config: Config,
    workdir: Path,
    mesh: jax.sharding.Mesh,
    statistics: Any = None,
    source: Path | None = None,
) -> Programs:
    """The train step of a stage; a flow's begins with the frozen image encoder's reading of the pictures, by WORKDIR's export.

    Args:
      network, optimizer: those that the state is made by.
      statistics: of the latents (``encode_all``), for a flow.
      source: the checkpoint that WORKDIR goes on from, whose latent flow a UniArt VAE is shown
        samples of (``loss.sampled``).
    """
    stage, given = getattr(config, name), None
    extra = list((statistics or {}).get(name.removesuffix("_flow"), ()))
    if name == "latent_flow" and config.loss.readout_share:
        extra.append(latent_metric(workdir / "latents", config.data.records, config.loss.readout_share, config.data.split))  # fmt: skip
    if name == "uniart_vae" and config.loss.sampled > 0:
        frozen, extra = latent_sampler_of(config, workdir, source)
        if config.loss.found > 0:
            abstract = build("layout", config.model).abstract()
            frozen = (*frozen, load_network(workdir, "layout", abstract))
        given = jax.device_put(frozen, replicated(mesh))
    loss_fn = getattr(objectives, f"make_{name}_loss")(network, config, *extra)
    if name.endswith("_flow"):
        find = make_layout_finder(config.model) if config.loss.found > 0 else None
        condition = make_conditioner(config.model)
        loss_fn = objectives.of_pictures(loss_fn, condition, find, config.loss.found)
        frozen = ["image_encoder"]
        if name == "latent_flow" and config.loss.decoded > 0:
            frozen.append("uniart_vae")
        if name == "structure_flow" and config.loss.refined > 0:
            frozen.append("structure_vae")
        if find is not None:
            frozen.append("layout")
        given = tuple(load_network(workdir, n, build(n, config.model).abstract()) for n in frozen)
        given = jax.device_put(given, replicated(mesh))
    return make_train_step(
        loss_fn,
        optimizer,
        stage.ema_decay,
        freeze=stage.freeze,
        accumulate=stage.accumulate,
        skip=stage.skip_not_finite > 0,
        given=given,
    )

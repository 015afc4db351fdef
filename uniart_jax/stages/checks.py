"""What is checked and made ready before a training's first step: settings, records, frozen names,
layouts."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax

from uniart_jax.config import Config, DataConfig, GridConfig
from uniart_jax.data.batches import open_records
from uniart_jax.data.folder import read_manifest, read_metadata
from uniart_jax.data.prepare import prepare_procedural
from uniart_jax.inference.samplers import reads_layout_cameras
from uniart_jax.models.checkpoint import WIDENABLE, Checkpoint
from uniart_jax.models.network import build
from uniart_jax.procedural import WORLDS
from uniart_jax.runtime.files import check_local
from uniart_jax.runtime.progress import messages
from uniart_jax.stages.stage import Stage
from uniart_jax.training import distributed
from uniart_jax.training.sharding import make_mesh
from uniart_jax.training.state import frozen_mask

OBJECTS_A_WORKER = 8  # at least: starting one takes as long as a few objects
FOLDERS = ("records", "validation", "layouts", "backgrounds")  # of ``DataConfig``
COUNTS = ("steps", "batch_size", "accumulate", "log_every", "evaluate_every", "save_every")
console = messages()


def overlapping(data: DataConfig) -> bool:
    """Whether validation records are among the training records: one folder, and splits that
    meet."""
    if not data.validation or Path(data.records).resolve() != Path(data.validation).resolve():
        return False
    trained, shown = ({*filter(None, s.split(","))} for s in (data.split, data.validation_split))
    return not (trained and shown) or bool(trained & shown)


def check_settings(config: Config, stages: Sequence[Stage]) -> None:
    """ValueError where a number of a stage or the voxel buckets cannot be, or a folder of the data
    is an address."""
    for field in FOLDERS:
        check_local(getattr(config.data, field), f"data.{field}")
    for stage in stages:
        stage.check(config)
        name, settings = stage.name, stage.settings(config)
        for field in COUNTS:
            if (value := getattr(settings, field)) < 1:
                raise ValueError(f"config: {name}.{field} is {value}; give 1 or more")
        if (value := settings.skip_not_finite) < 0:
            raise ValueError(f"config: {name}.skip_not_finite is {value}; give 0 or more")
    if min(config.data.voxel_buckets, default=0) < 1:
        raise ValueError(
            f"config: data.voxel_buckets is {config.data.voxel_buckets}; give one number of voxels "
            "or more, each above 0"
        )


def check_devices(config: Config, stages: Sequence[Stage]) -> None:
    """Whether the mesh can be made, and each stage's batch divides over its devices. One process
    that has more devices than divide is told so.

    Raises:
      ValueError: ``make_mesh``, or several processes could not share a batch.
    """
    devices, processes = make_mesh(config.mesh).size, jax.process_count()
    for stage in stages:
        name, settings = stage.name, stage.settings(config)
        each = settings.accumulate
        if settings.batch_size % (each * devices) == 0:
            continue
        if processes > 1:
            raise ValueError(
                f"config: {name}.batch_size is {settings.batch_size}, which does not divide over "
                f"{devices} devices of {processes} processes with accumulate {each}; give a "
                f"multiple of {each * devices}"
            )
        if devices > 1:
            console.print(
                f"{name}: {settings.batch_size // each} items at once do not divide over {devices} "
                "devices, so each computes all of them; give a batch_size that does",
                style="yellow",
            )


def check_features(config: Config, stages: Sequence[Stage]) -> None:
    """Whether the records have the columns that the UniArt VAE reads.

    Raises:
      ValueError, FileNotFoundError: they have not, or there are no records; what to run is said.
    """
    data, features = config.data, config.model.uniart_vae.feature_channels
    if not features or not any(stage.reads_features for stage in stages):
        return
    for folder, split in ((data.records, data.split), (data.validation, data.validation_split)):
        if folder:
            open_records(folder, config.model.grid, split, features)


def networks_to_copy(
    config: Config, source: Checkpoint, trained: Sequence[str], target: Checkpoint
) -> list[str]:
    """The networks of checkpoint ``source`` that a training copies (``Checkpoint.copyable``), each
    looked at. Those that lack layers are named on the console.

    Raises:
      ValueError: one of them does not fit the config. FileNotFoundError: it holds no network.
    """
    if not source.networks():
        raise FileNotFoundError(
            f"checkpoint {source.folder}: there is no network in it to go on from; give a folder "
            "that holds NETWORK.safetensors, such as a WORKDIR"
        )
    names = source.copyable(config, trained, target)
    for name in names:
        source.load(name, config.model)
    for name in WIDENABLE:
        if name in trained or target.has(name) or not distributed.is_first():
            continue
        for option in source.missing_layers(name, config.model):
            console.print(
                f"{source.folder}: its {name} has no {option}, the config's has, so it is not "
                f"copied; train it: --stage {name}",
                style="yellow",
                markup=False,
            )
    return names


def tell_from_scratch(source: Checkpoint, name: str) -> None:
    """Say that a network is trained from its beginning, as checkpoint ``source`` has none."""
    if distributed.is_first():
        console.print(
            f"{name}: not in {source.folder}, so it begins from scratch",
            style="yellow",
            markup=False,
        )


def check_found(
    config: Config, stages: Sequence[Stage], exported: Checkpoint, copied: Sequence[str]
) -> None:
    """Whether layouts can be found for the networks that are to be shown them (``loss.found``);
    without that, those are told of that sampling sees through layouts' cameras.

    Args:
      exported: of the training. copied: networks that it will get from another checkpoint.

    Raises:
      ValueError: one of them sees no layouts. FileNotFoundError: no layout network is there.
    """
    share, model = config.loss.found, config.model
    if not 0 <= share <= 1:
        raise ValueError(f"config: loss.found is {share}; give 0 to 1")
    shown = [stage.name for stage in stages if stage.shows_found_layouts(config)]
    for name in shown if share else ():
        if not (model.layout.queries and getattr(model, name).layout_channels):
            raise ValueError(
                f"config: loss.found shows the {name} layouts that are found; give "
                f"model.layout.queries and model.{name}.layout_channels above 0, or loss.found 0"
            )
    if shown and share and not exported.has("layout") and "layout" not in copied:
        raise FileNotFoundError(
            f"{exported.folder}/layout.safetensors: loss.found needs it and it is not there; "
            "train it first: --stage layout, or give a checkpoint that has it as --init"
        )
    through = model.layout.queries and reads_layout_cameras(model)
    if shown and through and not share and distributed.is_first():
        console.print(
            f"{', '.join(shown)}: trained through the image encoder's cameras, but flows are "
            "sampled through the layout's; give loss.found above 0 once there is a layout network",
            style="yellow",
            markup=False,
        )


def check_freeze(config: Config, stages: Sequence[Stage]) -> None:
    """Whether every stage's ``freeze`` names parameters of its network; ValueError if not."""
    for stage in stages:
        parameters = build(stage.name, config.model).abstract()
        try:
            frozen_mask(parameters, stage.settings(config).freeze)
        except ValueError as error:
            raise ValueError(f"{stage.name}.{error}") from None


def ensure_records(config: Config, training: bool = True) -> None:
    """Prepare the validation records that the config describes and, for ``training`` on them, those
    to train on, where they are not there yet.

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
    }
    families = WORLDS[data.world]
    for folder, count, seed in (
        (data.records, data.procedural, 0),
        (data.validation, data.validation_count, data.validation_seed),
    ):
        if not folder or (folder == data.records and not training):
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
            names = {tuple(drawn): world for world, drawn in WORLDS.items()}
            found["world"] = names.get(tuple(found.get("families", ())), "other families")
            asked["world"] = data.world
            if differ := [key for key in asked if found.get(key) != asked[key]]:
                listed = ", ".join(f"{k} {found.get(k)} instead of {asked[k]}" for k in differ)
                raise ValueError(
                    f"{folder}: holds records of other settings ({listed}); "
                    "give another --data.records or --data.validation, or the config these settings"
                )
        else:
            console.print(f"preparing {count} procedural objects in {folder}")
            drawn = {"start_seed": seed, "families": families}
            processes = min(os.cpu_count() or 1, -(-count // OBJECTS_A_WORKER))
            prepare_procedural(Path(folder), count, **drawn, processes=processes, **options)


def prepared_objects(folder: Path) -> int:
    """How many objects the manifest of a complete prepared folder names; 0 without one."""
    if not (folder / "manifest.csv").is_file():
        return 0
    return len({row["object"] for row in read_manifest(folder)})

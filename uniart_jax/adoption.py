"""Networks of another checkpoint that a WORKDIR goes on from: first weights, which fit, their
copies, and what of them is untrained yet."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from uniart_jax.config import LATENT_OF, NETWORKS, STAGES, Config, ModelConfig
from uniart_jax.encoding import ENCODED
from uniart_jax.models.network import build
from uniart_jax.progress import messages
from uniart_jax.training import distributed
from uniart_jax.training.export import (
    copy_export,
    find_export,
    has_export,
    load_network,
    read_config,
    read_statistics,
    write_config,
    write_statistics,
)

WIDENED = ("structure_flow", "latent_flow", "uniart_vae")  # networks that can be given, later,
ADDED = (
    "pixel_channels",
    "layout_channels",
    "refine_channels",
    "part_feature_channels",
)  # these layers
console = messages()


def adoptable(config: Config, source: Path, stages: Sequence[str], workdir: Path) -> list[str]:
    """The networks of checkpoint ``source`` that WORKDIR takes (``taken``), looked at. A flow that
    is left for want of layers is named on the console.

    Raises:
      ValueError: one of them does not fit the config.
    """
    found = taken(config, source, stages, workdir)
    for name in found:
        load_network(source, name, build(name, config.model).abstract())
    for name in WIDENED:
        if name in stages or exported(workdir, name) or not distributed.is_first():
            continue
        for option in lacking(source, name, config.model):
            console.print(
                f"{source}: its {name} has no {option}, the config's has, so it is not taken; "
                f"train it: --stage {name}",
                style="yellow",
                markup=False,
            )
    return found


def taken(config: Config, source: Path, stages: Sequence[str], workdir: Path) -> list[str]:
    """The networks that checkpoint ``source`` has, WORKDIR lacks and that are not trained now.

    A flow is taken only if it will stand in WORKDIR on the encoder and the VAEs that it was trained
    on: elsewhere it would speak of other latents. A flow that lacks layers to read pixels or a
    layout with is only something to train on from (``first_weights``), not to take.
    """
    return [
        name
        for name in (STAGES if config.model.layout.queries else NETWORKS)
        if name not in stages
        and not exported(workdir, name)
        and has_export(source, f"{name}.safetensors")
        and (name not in LATENT_OF or same_ground(source, stages, workdir))
        and not (name in WIDENED and lacking(source, name, config.model))
    ]


def first_weights(source: Path, name: str, model: ModelConfig) -> Any:
    """Weights of checkpoint ``source`` that a training of network ``name`` begins with (nested
    dict, float32).

    A flow that had no ``pixel_channels``, ``layout_channels`` or ``refine_channels``, or a UniArt
    VAE that had no ``layout_channels`` or ``part_feature_channels``, may get them: what is returned
    lacks their layers, which stay as drawn and begin by adding nothing, so that the network begins
    with the function that it was.

    Raises:
      FileNotFoundError, ValueError: as ``load_network``.
    """
    if name in WIDENED and (options := lacking(source, name, model)):
        blind = dataclasses.replace(getattr(model, name), **dict.fromkeys(options, 0))
        model = dataclasses.replace(model, **{name: blind})
    return load_network(source, name, build(name, model).abstract())


def lacking(source: Path, name: str, model: ModelConfig) -> list[str]:
    """Which of ``ADDED`` the config's network ``name`` has and that of checkpoint ``source`` has
    not."""
    if not all(has_export(source, file) for file in (f"{name}.safetensors", "config.json")):
        return []
    ours = getattr(model, name)
    wanted = [option for option in ADDED if getattr(ours, option, 0)]
    theirs = getattr(read_config(source).model, name) if wanted else None
    return [option for option in wanted if not getattr(theirs, option)]


def adopt(source: Path, names: Sequence[str], workdir: Path) -> None:
    """Copy networks of checkpoint ``source`` into WORKDIR, a flow with the statistics of its
    latent."""
    for name in names:
        copy_export(source, workdir / "export", f"{name}.safetensors")
        if name in LATENT_OF and distributed.is_first():
            mean, std = read_statistics(source, LATENT_OF[name])
            write_statistics(workdir / "export", LATENT_OF[name], mean, std)
    if (marks := untrained(source)) and distributed.is_first():
        mark(workdir, names, marks)
    distributed.wait()


def same_ground(source: Path, stages: Sequence[str], workdir: Path) -> bool:
    """Whether flows of ``source`` fit WORKDIR: none of image encoder and VAEs is trained now, and
    WORKDIR has the source's, or will take them."""
    return all(
        name not in stages
        and has_export(source, f"{name}.safetensors")
        and (
            not exported(workdir, name)
            or find_export(source, f"{name}.safetensors").read_bytes()
            == find_export(workdir / "export", f"{name}.safetensors").read_bytes()
        )
        for name in ("image_encoder", *ENCODED)
    )


def untrained(folder: Path) -> tuple[str, ...]:
    """What the exported networks of a WORKDIR, or of a checkpoint, still hold as it was drawn
    (``Config.untrained``)."""
    return read_config(folder).untrained if has_export(folder, "config.json") else ()


def mark(workdir: Path, names: Sequence[str], marks: Sequence[str]) -> None:
    """Let the export's config say that of networks ``names`` just ``marks`` are untrained."""
    kept = [m for m in untrained(workdir / "export") if m.split(".")[0] not in names]
    new = [m for m in marks if m.split(".")[0] in names]
    config = read_config(workdir / "export")
    write_config(workdir / "export", dataclasses.replace(config, untrained=(*kept, *new)))


def exported(workdir: Path, name: str) -> bool:
    """Whether the stage has left its weights."""
    return (workdir / "export" / f"{name}.safetensors").is_file()

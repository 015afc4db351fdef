"""``uniart convert``: published checkpoints of TRELLIS and DINOv2 -> a checkpoint folder of ours
(``models.checkpoint``); OpenShape's encoders.

    CKPT_DIR/[ckpts/]<name>.json, <name>.safetensors, pipeline.json  ->  DIR/config.json, <network>.safetensors, latent_stats.safetensors
    dinov2_vit?14_reg….pth                                           ->  image_encoder.safetensors
    OPENSHAPE_DIR/model.pt, open_clip_*.safetensors                  ->  DIR/openshape.json, … (``weights.openshape``)

What the files are is read off their content (``weights``); here they are found, written and
reported.
"""  # noqa: E501

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from rich.table import Table

from uniart_jax.config import Config, ModelConfig, to_json
from uniart_jax.export.folder import check_target, complete_folder
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.checkpoint_files import write_config, write_network, write_statistics
from uniart_jax.runtime.progress import messages
from uniart_jax.weights.compose import Filled, compose
from uniart_jax.weights.dinov2 import convert_dinov2
from uniart_jax.weights.openclip import convert_image_tower
from uniart_jax.weights.openshape import CARD, OpenShapeConfig, convert_point_encoder, files_of
from uniart_jax.weights.read import read_tensors
from uniart_jax.weights.sampling import Sampling, read_sampling
from uniart_jax.weights.trellis import PLACES, convert_trellis
from uniart_jax.weights.trellis_options import OUT_OF_SCOPE, class_name, out_of_scope

MARKS = ("config.json",)  # what a folder must hold to be replaced
# Names of the published files, and where they are; the first that is there is taken.
POINT_ENCODER = (
    ("model.pt", "model.safetensors"),
    "model.pt of huggingface.co/OpenShape/openshape-pointbert-vitg14-rgb",
)
IMAGE_TOWER = (
    ("open_clip_*.safetensors", "open_clip_*.bin"),
    "open_clip_model.safetensors of huggingface.co/laion/CLIP-ViT-bigG-14-laion2B-39B-b160k",
)
console = messages()


class Source(NamedTuple):
    """One network of a checkpoint folder of TRELLIS: its weights, and what its JSON says."""

    weights: Path
    name: str
    args: Mapping[str, Any]


def convert_trellis_folder(source: Path, out: Path, overwrite: bool = False) -> Path:
    """TRELLIS's checkpoints as a checkpoint folder of ours; ``out`` appears complete or not at all.

    Raises:
      FileNotFoundError: no such folder.
      ValueError: ``out`` is not empty, no network of TRELLIS that has a place here, files that do
        not fit each other or their config.
    """
    check_target(out, overwrite, [source], marks=MARKS)
    sources = find_networks(source)
    skipped = [
        (s, reason) for s in sources if (reason := out_of_scope(s.name, s.args, s.weights.stem))
    ]
    chosen = [s for s in sources if s not in [s for s, _ in skipped]]
    if not chosen:
        raise ValueError(
            f"'{source}': none of its networks has a place here; there must be one of "
            f"{', '.join(PLACES)}"
        )
    by_class: dict[str, Source] = {}
    for s in chosen:
        other = by_class.setdefault(class_name(s.name), s)
        if other is not s:
            raise ValueError(
                f"'{source}': {other.weights.name} and {s.weights.name} are both a "
                f"{class_name(s.name)}; leave one of them out"
            )
    sampling = find_sampling(source)
    pieces = []
    for s in chosen:
        try:
            pieces.append(convert_trellis(s.name, s.args, read_tensors(s.weights)))
        except ValueError as error:
            where = "" if str(s.weights) in str(error) else f"'{s.weights}': "
            raise ValueError(f"{where}{error}") from None
    model, networks = compose(pieces)
    check_latents(model, networks, sampling)
    config = Config(
        name="trellis",
        untrained=untrained(networks),
        model=model,
        sample_structure=sampling.structure,
        sample_latent=sampling.latent,
    )
    with complete_folder(out, overwrite, marks=MARKS) as folder:
        for name, filled in networks.items():
            write_network(folder, name, filled.params, "stored")
        if "structure_flow" in networks:  # TRELLIS does not normalise these
            channels = model.structure_vae.latent_channels
            write_statistics(folder, "structure", np.zeros(channels), np.ones(channels))
        if "latent_flow" in networks:
            write_statistics(folder, "latent", sampling.mean, sampling.std)
        write_config(folder, config)
    report(out, networks, skipped, [name for name in PLACES if name not in by_class])
    return out


def convert_dinov2_file(source: Path, out: Path, overwrite: bool = False) -> Path:
    """A state dict of DINOv2 with registers as ``image_encoder.safetensors``.

    Args:
      out: the file to write, or a folder that gets ``image_encoder.safetensors``. If a
        ``config.json`` is beside it, its image encoder is set.

    Raises:
      FileNotFoundError: no such file.
      ValueError: ``out`` exists, the file is no DINOv2 with registers, or the folder's flows are
        conditioned on another width.
    """
    out = out / "image_encoder.safetensors" if out.is_dir() else out
    if out.name != "image_encoder.safetensors":
        raise ValueError(
            f"output '{out}': a checkpoint's file is called image_encoder.safetensors; give that, "
            "or a folder"
        )
    if out.exists() and not overwrite:
        raise ValueError(f"output '{out}' exists; choose another --out, or --overwrite")
    try:
        encoder, params = convert_dinov2(read_tensors(source))
    except ValueError as error:
        where = "" if str(source) in str(error) else f"'{source}': "
        raise ValueError(f"{where}{error}") from None
    there = Checkpoint(out.parent)
    config = there.config if (there.folder / "config.json").is_file() else None
    if config is not None:
        for flow in ("structure_flow", "latent_flow"):
            width = getattr(config.model, flow).cond_channels
            if there.has(flow) and width != encoder.width:
                raise ValueError(
                    f"'{source}': its width {encoder.width} is not the {width} that {flow} in "
                    f"'{out.parent}' is conditioned on; take another size of DINOv2"
                )
    before = out.read_bytes() if config is not None and out.is_file() else None
    write_network(out.parent, "image_encoder", params, "stored")
    if config is not None:
        margin = config.model.image_encoder.crop_margin  # belongs to the flows
        encoder = dataclasses.replace(encoder, crop_margin=margin)
        model = dataclasses.replace(config.model, image_encoder=encoder)
        try:
            write_config(out.parent, dataclasses.replace(config, model=model))
        except BaseException:  # an encoder that its config does not know would be of no use
            out.unlink() if before is None else out.write_bytes(before)
            raise
    count = len(jax.tree.leaves(params))
    report(out.parent, {"image_encoder": Filled(params, ("DINOv2",), count)}, [], [])
    size = (
        f"{encoder.image_size} pixels, patches of {encoder.patch_size}, {encoder.registers} "
        f"registers, width {encoder.width}, {encoder.num_blocks} blocks"
    )
    console.print(f"image encoder: {size}{'' if config is None else '; config.json says so now'}")
    return out


def convert_openshape_folder(
    source: Path, out: Path, overwrite: bool = False, config: OpenShapeConfig | None = None
) -> Path:
    """OpenShape's point encoder and OpenCLIP's image tower for evaluation; ``out`` appears complete
    or not at all.

    Args:
      source: a folder with both published files.
      config: None = ``openshape-pointbert-vitg14-rgb`` and ViT-bigG-14.

    Raises:
      FileNotFoundError: no such folder, or one of the files is not in it.
      ValueError: ``out`` is not empty, or a file is of another network.
    """
    check_target(out, overwrite, [source], marks=(CARD,))
    config = config or OpenShapeConfig()
    files = [_published(source, *kind) for kind in (POINT_ENCODER, IMAGE_TOWER)]
    converters = (
        lambda tensors: convert_point_encoder(tensors, config.point_encoder),
        lambda tensors: convert_image_tower(tensors, config.image_tower),
    )
    params = []
    for path, converted in zip(files, converters, strict=True):
        try:
            params.append(converted(read_tensors(path)))
        except ValueError as error:
            where = "" if str(path) in str(error) else f"'{path}': "
            raise ValueError(f"{where}{error}") from None
    with complete_folder(out, overwrite, marks=(CARD,)) as folder:
        for stem, tree in files_of(*params).items():
            write_network(folder, stem, tree, "stored")
        (folder / CARD).write_text(to_json(config) + "\n", encoding="utf-8")
    names = {"point_encoder": "OpenShape", "image_tower": "OpenCLIP"}
    filled = {
        name: Filled(tree, (names[name],), len(jax.tree.leaves(tree)))
        for name, tree in zip(names, params, strict=True)
    }
    report(out, filled, [], [])
    return out


def find_networks(folder: Path) -> list[Source]:
    """The networks in a folder, or in its ``ckpts``: every ``<name>.safetensors`` with a
    ``<name>.json`` beside it.

    Raises:
      FileNotFoundError: no such folder.
      ValueError: there are none, a JSON is missing or malformed, or a class is unknown.
    """
    if not folder.is_dir():
        raise FileNotFoundError(f"'{folder}': no such folder; give TRELLIS's checkpoint folder")
    found = []
    for path in sorted([*folder.glob("*.safetensors"), *folder.glob("ckpts/*.safetensors")]):
        card = path.with_suffix(".json")
        if not card.is_file():
            raise ValueError(
                f"'{path}': {card.name} is not beside it; it says which network this is, download "
                "it too"
            )
        content = _json(card)
        name, args = (
            (content.get(k) for k in ("name", "args"))
            if isinstance(content, Mapping)
            else (None, None)
        )
        if not isinstance(name, str) or not isinstance(args, Mapping):
            raise ValueError(f"'{card}': it must hold a name and args, as TRELLIS's do")
        if class_name(name) not in (*PLACES, *OUT_OF_SCOPE):
            raise ValueError(f"'{card}': {name} is not a network of TRELLIS; leave it out")
        found.append(Source(path, name, args))
    if not found:
        raise ValueError(
            f"'{folder}': no .safetensors in it or in its ckpts; give TRELLIS's checkpoint folder"
        )
    return found


def find_sampling(folder: Path) -> Sampling:
    """Of ``pipeline.json`` in the folder, or in its parent if this is ``ckpts``, else TRELLIS's
    defaults.

    Raises:
      ValueError: it is malformed.
    """
    whole = folder.resolve()
    for place in (folder, *([whole.parent] if whole.name == "ckpts" else [])):
        path = place / "pipeline.json"
        if path.is_file():
            try:
                return read_sampling(_json(path))
            except ValueError as error:
                raise ValueError(f"'{place}': {error}") from None
    return read_sampling()


def check_latents(model: ModelConfig, networks: Mapping[str, Filled], sampling: Sampling) -> None:
    """Whether the flow's latents have as many channels as their normalisation.

    Raises:
      ValueError: they have not.
    """
    channels = model.uniart_vae.latent_channels
    if "latent_flow" in networks and len(sampling.mean) != channels:
        raise ValueError(
            f"the latent flow has {channels} channels, its normalisation {len(sampling.mean)}; put "
            "the pipeline.json that belongs to it beside it"
        )


def untrained(networks: Mapping[str, Filled]) -> tuple[str, ...]:
    """Names or prefixes of what was drawn, with the network's name before them."""
    return tuple(f"{name}.{new}" for name, filled in networks.items() for new in filled.new)


def report(
    out: Path,
    networks: Mapping[str, Filled],
    skipped: Sequence[tuple[Source, str]],
    missing: Sequence[str],
) -> None:
    """What was written, what of it is new, and what was left out or not there."""
    table = Table(box=None, pad_edge=False)
    for title in ("network", "from", "tensors filled", "parameters / M", "new"):
        table.add_column(title, justify="right" if title[0] in "tp" else "left", overflow="fold")
    for name, filled in networks.items():
        size = sum(leaf.size for leaf in jax.tree.leaves(filled.params)) / 1e6
        row = (name, ", ".join(filled.sources), str(filled.filled), f"{size:.3f}")
        table.add_row(*row, ", ".join(filled.new) or "-")
    console.print(table)
    for name, filled in networks.items():
        for note in filled.notes:
            console.print(f"{name}: {note}")
    for source, reason in skipped:
        console.print(f"out of scope: {source.weights.name} ({class_name(source.name)}): {reason}")
    if missing:
        console.print(f"not there: {', '.join(missing)}")
    console.print(f"-> {out}")


def _published(folder: Path, names: Sequence[str], origin: str) -> Path:
    if not folder.is_dir():
        raise FileNotFoundError(
            f"'{folder}': no such folder; give one with OpenShape's and OpenCLIP's files"
        )
    found = [path for name in names for path in sorted(folder.glob(name))]
    if not found:
        raise FileNotFoundError(f"'{folder}': no {' or '.join(names)} in it; put {origin} there")
    return found[0]


def _json(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"'{path}': not valid JSON ({error})") from None

"""What both flows share: latents that are encoded first, frozen networks that see the picture, and
what their evaluations show them."""

from __future__ import annotations

import abc
import functools
import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from uniart_jax.config import LATENT_OF, Config, ModelConfig
from uniart_jax.data.folder import read_metadata
from uniart_jax.data.latents import check_views, latent_batches
from uniart_jax.inference.samplers import (
    FoundLayouts,
    join_views,
    make_conditioner,
    make_layout_finder,
    reads_layout_cameras,
)
from uniart_jax.models.checkpoint import FLOW_INPUTS, Checkpoint
from uniart_jax.models.checkpoint_files import write_statistics
from uniart_jax.models.network import Network
from uniart_jax.precompute.encoding import digest, encode_all
from uniart_jax.runtime.files import write_text
from uniart_jax.stages.stage import Stage, Statistics, check_picture_size, load
from uniart_jax.training import distributed
from uniart_jax.training.flow_losses import with_image_condition
from uniart_jax.voxels.part_table import ROWS, PartTable, part_table
from uniart_jax.voxels.typed_batches import Condition


class FlowStage(Stage):
    """A rectified flow of a latent, given the picture."""

    reads_features = True

    def shows_found_layouts(self, config: Config) -> bool:
        return True

    def check(self, config: Config) -> None:
        data, held = config.data, config.data.views
        if (Path(data.records) / "metadata.json").is_file():
            held = int(read_metadata(data.records).get("views", held))
        check_views(data, held)
        check_picture_size(config)

    def decodes(self, config: Config) -> str:
        """The network whose output on the flow's samples the loss reads; "" for none."""
        return ""

    def check_inputs(self, config: Config, workdir: Path, source: Checkpoint | None) -> None:
        folder = workdir / "checkpoints" / self.name
        fixed = fixed_statistics(source, workdir, self.name)
        distributed.on_first_process(lambda: check_flow_inputs(folder, config, workdir, fixed))

    def batches(self, config: Config, workdir: Path, share: dict[str, int]) -> Any:
        return latent_batches(
            workdir / "latents",
            config.data,
            config.model,
            self.settings(config).batch_size,
            stage=self.name,  # type: ignore[arg-type]
            decoded=bool(self.decodes(config)),
            **share,
        )

    def statistics(
        self, config: Config, workdir: Path, source: Checkpoint | None
    ) -> dict[str, Statistics]:
        """Encodes the records where that is not done yet."""
        found = encode_all(config, workdir)
        ours = fixed_statistics(source, workdir, self.name) or found[self.latent]
        found[self.latent] = ours
        distributed.on_first_process(
            lambda: write_statistics(Checkpoint.of_workdir(workdir).folder, self.latent, *ours)
        )
        return found

    @abc.abstractmethod
    def flow_loss(
        self, network: Network, config: Config, workdir: Path, mean: Any, std: Any
    ) -> Any:
        """The loss of batches that hold what an image encoder sees, of latents in units of ``mean``
        and ``std``."""

    def loss(
        self, network: Network, config: Config, workdir: Path, statistics: dict[str, Statistics]
    ) -> Any:
        find = make_layout_finder(config.model) if config.loss.found > 0 else None
        loss_fn = self.flow_loss(network, config, workdir, *statistics[self.latent])
        condition = make_conditioner(config.model)
        through = reads_layout_cameras(config.model)
        return with_image_condition(loss_fn, condition, find, config.loss.found, through)

    def frozen_params(
        self, config: Config, workdir: Path, source: Checkpoint | None
    ) -> tuple[Any, ...]:
        frozen = ["image_encoder", *filter(None, [self.decodes(config)])]
        frozen += ["layout"] if config.loss.found > 0 else []
        return tuple(load(workdir, name, config) for name in frozen)


def fixed_statistics(source: Checkpoint | None, workdir: Path, flow: str) -> Statistics | None:
    """Mean and standard deviation of the latent by which a flow that goes on from checkpoint
    ``source`` was normalised; None where that has no such flow, or its latent space differs: those
    of the records count."""
    if source is None or not source.has(flow):
        return None
    if not source.same_latent_space(Checkpoint.of_workdir(workdir)):
        return None
    return source.statistics(LATENT_OF[flow])


def check_flow_inputs(
    folder: Path, config: Config, workdir: Path, statistics: Statistics | None = None
) -> None:
    """Tie a flow's checkpoints to the latents, the statistics that normalise them (None: those of
    the records) and the image encoder that it trains on.

    Raises:
      FileNotFoundError: a network that it needs has not been trained.
      ValueError: the checkpoints belong to others; a flow finished on these would not fit the
        networks exported beside it.
    """
    exported = Checkpoint.of_workdir(workdir)
    for name in FLOW_INPUTS:
        if not exported.has(name):
            frozen = name == "image_encoder" and not config.model.image_encoder.kind.trained
            how = (
                "give a checkpoint that has it as --init"
                if frozen
                else f"train it first: --stage {name}"
            )
            raise FileNotFoundError(f"{exported.folder}/{name}.safetensors: not there; {how}")
        if left := exported.untrained([name]):
            raise ValueError(
                f"{name}: not trained yet ({', '.join(left)}); train it first: --stage {name}"
            )
    encoder = exported.path("image_encoder.safetensors").read_bytes()
    latents = digest(config, workdir, Path(config.data.records), config.data.split)
    key = f"{latents} {hashlib.sha256(encoder).hexdigest()}"
    if config.loss.found:
        layout = exported.path("layout.safetensors").read_bytes()
        key += f" {hashlib.sha256(layout).hexdigest()}"
    if statistics is not None:
        key += f" {hashlib.sha256(b''.join(v.tobytes() for v in statistics)).hexdigest()}"
    note = folder.with_name(f"{folder.name}.inputs")
    trained = folder.is_dir() and any(p.name.isdigit() for p in folder.iterdir())
    if trained and note.is_file() and note.read_text() != key:
        raise ValueError(
            f"{folder} was trained on other inputs (records, voxel_buckets, an earlier network, "
            "the layout network where loss.found shows its layouts, --init or the version changed "
            "since); remove that folder to train this flow on the new ones"
        )
    note.parent.mkdir(parents=True, exist_ok=True)
    if not note.is_file() or note.read_text() != key:
        write_text(note, key)


def load_conditioner(config: Config, workdir: Path) -> Callable[[jax.Array], Condition]:
    """``inference.samplers.make_conditioner`` with the trained image encoder of WORKDIR, on one
    device as long as the function is kept."""
    parameters = jax.device_put(load(workdir, "image_encoder", config))
    return functools.partial(make_conditioner(config.model), parameters)


def load_layout_finder(config: Config, workdir: Path) -> Callable[[jax.Array], FoundLayouts]:
    """``inference.samplers.make_layout_finder`` with the layout network of WORKDIR."""
    parameters = jax.device_put(load(workdir, "layout", config))
    return functools.partial(make_layout_finder(config.model), parameters)


def first_pictures(items: list[dict[str, Any]]) -> jax.Array:
    """[B, S, S, 3] in [0, 1] of items of ``data.latents``."""
    return _pictures(items, 1)[:, 0]


def _pictures(items: list[dict[str, Any]], views: int) -> jax.Array:
    """[B, N, S, S, 3] in [0, 1], the first N views of items."""
    return jnp.asarray(np.stack([i["images"][:views] for i in items]).astype(np.float32) / 255)


def condition_of_items(
    items: list[dict[str, Any]], condition_of: Callable[..., Condition], config: Config
) -> Condition:
    """What flows see of the first pictures of each item (``data.condition_views``), and of its true
    layout."""
    model, pictures = config.model, _pictures(items, config.data.condition_views)
    condition = condition_of(pictures.reshape(-1, *pictures.shape[2:]))
    if config.data.condition_views > 1:
        condition = join_views(condition, len(items))
    if not (model.structure_flow.layout_channels or model.latent_flow.layout_channels):
        return condition
    return condition._replace(layout=item_tables(items, model))


def item_tables(items: list[dict[str, Any]], model: ModelConfig) -> PartTable:
    """The true layouts of items of ``data.latents``."""
    tables = [{name: item[name] for name in ROWS} for item in items]
    return part_table(tables, model.grid.max_parts)

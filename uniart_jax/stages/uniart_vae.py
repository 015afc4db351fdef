"""The UniArt VAE: voxels with everything on them <-> latent per voxel."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jax
import numpy as np

from uniart_jax.config import Config
from uniart_jax.data.batches import record_batches, voxel_batches
from uniart_jax.data.records import decode_color
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.network import Network, build
from uniart_jax.stages.pictures import PICTURES, RECORDS, beside, solid, sub_cells
from uniart_jax.stages.stage import Evaluation, Stage, Statistics, check_picture_size, load
from uniart_jax.training.metrics import part_readings, summarize_readings
from uniart_jax.training.vae_losses import make_uniart_vae_loss
from uniart_jax.voxels.typed_batches import VoxelBatch

VOXEL_BATCH = 2
SAMPLER = ("image_encoder", "latent_flow")


class UniArtVAEStage(Stage):
    """The sparse VAE on voxels of records and, with ``loss.sampled``, on what a trained latent flow
    samples for their pictures."""

    name = "uniart_vae"
    batch = VoxelBatch
    reads_features = True
    needed = ("sdf", "color", "owner", "voxel_part", "boxes", "codes", "parents", "plans")

    def check(self, config: Config) -> None:
        if config.loss.sampled > 0:
            check_picture_size(config)

    def shows_found_layouts(self, config: Config) -> bool:
        return config.loss.sampled > 0

    def batches(self, config: Config, workdir: Path, share: dict[str, int]) -> Any:
        data, size = config.data, self.settings(config).batch_size
        items = size // (share["process_count"] * share["accumulate"])
        devices = jax.local_device_count()
        shares = devices if items and items % devices == 0 else 1
        shown = config.loss.sampled > 0
        return voxel_batches(
            data.records,
            data,
            config.model,
            size,
            split=data.split,
            shares=shares,
            shown=shown,
            **share,
        )

    def statistics(
        self, config: Config, workdir: Path, source: Checkpoint | None
    ) -> dict[str, Statistics]:
        if config.loss.sampled <= 0:
            return {}
        return {"latent": sampler_checkpoint(config, workdir, source).statistics("latent")}

    def loss(
        self, network: Network, config: Config, workdir: Path, statistics: dict[str, Statistics]
    ) -> Any:
        return make_uniart_vae_loss(network, config, *statistics.get("latent", ()))

    def frozen_params(
        self, config: Config, workdir: Path, source: Checkpoint | None
    ) -> tuple[Any, ...]:
        if config.loss.sampled <= 0:
            return ()
        checkpoint = sampler_checkpoint(config, workdir, source)
        frozen = tuple(checkpoint.load(name, config.model) for name in SAMPLER)
        return (*frozen, load(workdir, "layout", config)) if config.loss.found > 0 else frozen

    def evaluation(self, config: Config, workdir: Path, statistics: Any) -> Evaluation | None:
        return _evaluation(config) if config.data.validation else None


def sampler_checkpoint(config: Config, workdir: Path, source: Checkpoint | None) -> Checkpoint:
    """The checkpoint with the image encoder and the latent flow whose samples are shown: WORKDIR's
    export, or else checkpoint ``source``.

    Raises:
      FileNotFoundError: neither has them. ValueError: the encoder would be trained, and its latents
        so be others than the flow's.
    """
    if not {"front", "encoder"} <= set(config.uniart_vae.freeze):
        raise ValueError(
            "loss.sampled: the flow's latents are those of the encoder as it is; "
            "give --uniart_vae.freeze front encoder"
        )
    for checkpoint in (Checkpoint.of_workdir(workdir), source):
        if checkpoint is not None and checkpoint.has(*SAMPLER):
            return checkpoint
    raise FileNotFoundError(
        "loss.sampled: needs a trained image encoder and latent flow; "
        "give a checkpoint that has them as --init"
    )


def _evaluation(config: Config) -> Evaluation:
    data, network = config.data, build("uniart_vae", config.model)

    @jax.jit
    def apply(params, batch):
        latent = network.apply(params, batch, method="encode")["mean"]
        return network.apply(params, latent, batch, method="decode")

    def evaluate(state, step):
        rows, inside, colors, pictures = [], [], [], []
        for batch in record_batches(
            data.validation,
            data,
            config.model,
            VOXEL_BATCH,
            split=data.validation_split,
            most=RECORDS,
        ):
            out = jax.device_get(apply(state.ema, batch._replace(images=None, record=None)))
            for b, index in enumerate(batch.record):
                if index < 0:
                    continue
                count = batch.counts[b]
                part, known = batch.voxel_part[b, :count], batch.part_counts[b]
                rows += part_readings(
                    out["joint_code"][b, :count],
                    out["part_boxes"][b, :count, 0],
                    part,
                    batch.boxes[b, :known],
                    batch.codes[b, :known],
                    batch.parents[b, :known],
                )
                truth, guess = batch.sdf[b, :count] < 0, out["sdf"][b, :count] < 0
                inside.append((truth & guess).sum() / max((truth | guess).sum(), 1))
                color = decode_color(batch.color[b, :count])
                colors.append(np.abs(out["color"][b, :count] - color).mean())
                if len(pictures) < PICTURES:
                    coords = batch.coords[b, :count]
                    found = solid(coords, out["sdf"][b, :count], out["color"][b, :count])
                    true = solid(coords, batch.sdf[b, :count], color)
                    pictures.append(beside(true, found, sub_cells(config)))
        figures = {"inside_iou": float(np.mean(inside)), "color_error": float(np.mean(colors))}
        return {**figures, **summarize_readings(rows)}, {"surface": np.concatenate(pictures)}

    return evaluate

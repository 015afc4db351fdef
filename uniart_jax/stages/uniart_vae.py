"""The UniArt VAE: voxels with everything on them <-> latent per voxel."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jax
import numpy as np

from uniart_jax.config import Config
from uniart_jax.data.batches import record_batches, voxel_batches
from uniart_jax.data.records import decode_color
from uniart_jax.models.network import Network, build
from uniart_jax.stages.pictures import PICTURES, RECORDS, beside, solid, sub_cells
from uniart_jax.stages.stage import Evaluation, Stage, Statistics
from uniart_jax.training.metrics import part_readings, summarize_readings
from uniart_jax.training.vae_losses import make_uniart_vae_loss
from uniart_jax.voxels.typed_batches import VoxelBatch

VOXEL_BATCH = 2


class UniArtVAEStage(Stage):
    """The sparse VAE on voxels of records."""

    name = "uniart_vae"
    batch = VoxelBatch
    reads_features = True
    needed = ("sdf", "color", "owner", "voxel_part", "boxes", "codes", "parents", "plans")

    def batches(self, config: Config, workdir: Path, share: dict[str, int]) -> Any:
        data, size = config.data, self.settings(config).batch_size
        items = size // (share["process_count"] * share["accumulate"])
        devices = jax.local_device_count()
        shares = devices if items and items % devices == 0 else 1
        return voxel_batches(
            data.records,
            data,
            config.model,
            size,
            split=data.split,
            shares=shares,
            **share,
        )

    def loss(
        self, network: Network, config: Config, workdir: Path, statistics: dict[str, Statistics]
    ) -> Any:
        return make_uniart_vae_loss(network, config)

    def evaluation(self, config: Config, workdir: Path, statistics: Any) -> Evaluation | None:
        return _evaluation(config) if config.data.validation else None


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

"""The structure VAE: occupancy <-> dense latent."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jax
import numpy as np

from uniart_jax.config import Config
from uniart_jax.models.network import Network, build
from uniart_jax.stages.pictures import (
    PICTURES,
    PictureStage,
    beside,
    filled,
    iou,
    validation_pictures,
)
from uniart_jax.stages.stage import Evaluation
from uniart_jax.training.vae_losses import make_structure_vae_loss


class StructureVAEStage(PictureStage):
    """The dense VAE on the occupancy of records."""

    name = "structure_vae"
    wanted = ("occupancy",)

    def loss(self, network: Network, config: Config, workdir: Path, statistics: Any) -> Any:
        return make_structure_vae_loss(network, config)

    def evaluation(self, config: Config, workdir: Path, statistics: Any) -> Evaluation | None:
        return _evaluation(config) if config.data.validation else None


def _evaluation(config: Config) -> Evaluation:
    network = build("structure_vae", config.model)
    apply = jax.jit(lambda params, occupancy: network.apply(params, occupancy)["logits"])

    def evaluate(state, step):
        overlaps, pictures = [], []
        for batch in validation_pictures(config):
            truth = np.asarray(batch.occupancy, bool)
            logits = np.asarray(apply(state.ema, batch.occupancy.astype(np.float32)))
            known = batch.record >= 0
            overlaps += list(iou(logits > 0, truth)[known])
            for b in np.flatnonzero(known)[: PICTURES - len(pictures)]:
                both = filled(truth[b]), filled(logits[b] > 0)
                pictures.append(beside(*both, truth.shape[1]))
        return {"iou": float(np.mean(overlaps))}, {"occupancy": np.concatenate(pictures)}

    return evaluate

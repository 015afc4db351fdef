"""The mask network: pictures with their backgrounds -> what of them is the object (where the config
has ``mask.channels``)."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import jax
import numpy as np

from uniart_jax.config import Config, ModelConfig
from uniart_jax.data.scene_batches import scene_batches, validation_scenes
from uniart_jax.inference.layouts import published_backbone
from uniart_jax.models.network import Network, build
from uniart_jax.stages.pictures import IMAGE_BATCH, PICTURES, RECORDS
from uniart_jax.stages.stage import Evaluation, Stage
from uniart_jax.training.mask_loss import make_mask_loss, overlap
from uniart_jax.voxels.typed_batches import MaskBatch
from uniart_jax.weights.efficientnet_lite import find_published


class MaskStage(Stage):
    """Masks of procedural objects in front of random backgrounds."""

    name = "mask"
    batch = MaskBatch
    makes_data = True

    def left_out(self, model: ModelConfig) -> str:
        return "" if model.mask.channels else "the config has none; give --model.mask.channels 64"

    def check_first_weights(self, config: Config) -> None:
        find_published()

    def batches(self, config: Config, workdir: Path, share: dict[str, int]) -> Any:
        return scene_batches(config.data, config.model, self.settings(config).batch_size, **share)

    def loss(self, network: Network, config: Config, workdir: Path, statistics: Any) -> Any:
        return make_mask_loss(network)

    def first_weights(self, config: Config) -> dict[str, Any]:
        return {"backbone": published_backbone()}

    def evaluation(self, config: Config, workdir: Path, statistics: Any) -> Evaluation | None:
        return _evaluation(config)


def _evaluation(config: Config) -> Evaluation:
    apply = jax.jit(build("mask", config.model).apply)
    scenes = functools.cache(lambda: validation_scenes(config.data, config.model, RECORDS))

    def evaluate(state, step):
        truth, found = scenes(), []
        for first in range(0, len(truth.image), IMAGE_BATCH):
            found.append(jax.device_get(apply(state.ema, truth.image[first : first + IMAGE_BATCH])))
        logits = np.concatenate(found)
        scores = np.asarray(overlap(logits, truth.mask))
        figures = {"iou": float(scores.mean()), "worst tenth": float(np.quantile(scores, 0.1))}
        rows = [
            np.concatenate([image, *(np.repeat(m[..., None], 3, -1) for m in (true, seen > 0))], 1)
            for image, true, seen in zip(
                truth.image[:PICTURES], truth.mask[:PICTURES], logits, strict=False
            )
        ]
        return figures, {"mask": np.concatenate(rows)}

    return evaluate

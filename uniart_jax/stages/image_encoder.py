"""The image encoder: images -> coarse occupancy, boxes, joints; frozen afterwards."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jax
import numpy as np

from uniart_jax.config import Config, ModelConfig
from uniart_jax.data.records import RecordSource
from uniart_jax.models.network import Network, build
from uniart_jax.stages.pictures import (
    PICTURES,
    PictureStage,
    beside,
    filled,
    iou,
    validation_pictures,
)
from uniart_jax.stages.stage import Evaluation, check_picture_size
from uniart_jax.training.encoder_loss import make_image_encoder_loss
from uniart_jax.training.metrics import part_readings, summarize_readings
from uniart_jax.voxels.joint_code import JOINT_CODE, OWN_BOX


class ImageEncoderStage(PictureStage):
    """Regression of coarse structure from pictures of records."""

    name = "image_encoder"
    wanted = ("image", "camera", "occupancy", "cell_part", "boxes", "codes", "parents")

    def left_out(self, model: ModelConfig) -> str:
        if model.image_encoder.kind.trained:
            return ""
        return (
            f"{model.image_encoder.architecture} is taken as it is, not trained; convert its "
            "weights (uniart convert dinov2 FILE --out CHECKPOINT) and give CHECKPOINT as --init"
        )

    def check(self, config: Config) -> None:
        check_picture_size(config)

    def loss(self, network: Network, config: Config, workdir: Path, statistics: Any) -> Any:
        return make_image_encoder_loss(network, config)

    def evaluation(self, config: Config, workdir: Path, statistics: Any) -> Evaluation | None:
        return _evaluation(config) if config.data.validation else None


def _evaluation(config: Config) -> Evaluation:
    apply = jax.jit(build("image_encoder", config.model).apply)
    tables = RecordSource(config.data.validation, config.data.validation_split)

    def evaluate(state, step):
        overlaps, cameras, rows, pictures = [], [], [], []
        for batch in validation_pictures(config):
            out = jax.device_get(apply(state.ema, batch.image))
            truth = np.asarray(batch.occupancy, bool)
            for b, index in enumerate(batch.record):
                if index < 0:
                    continue
                overlaps.append(iou(out["occupancy"][b : b + 1] > 0, truth[b : b + 1])[0])
                cameras.append(np.abs(out["camera"][b] - batch.camera[b]).mean())
                part = batch.cell_part[b]
                mask = part >= 0
                codes, record = out["codes"][b][mask], tables[int(index)]
                rows += part_readings(
                    codes[:, JOINT_CODE],
                    codes[:, OWN_BOX],
                    part[mask],
                    record.boxes,
                    record.codes,
                    record.parents,
                )
                if len(pictures) < PICTURES:
                    both = filled(truth[b]), filled(out["occupancy"][b] > 0)
                    pictures.append(beside(*both, truth.shape[1], batch.image[b]))
        figures = {"iou": float(np.mean(overlaps)), "camera": float(np.mean(cameras))}
        return {**figures, **summarize_readings(rows)}, {"occupancy": np.concatenate(pictures)}

    return evaluate

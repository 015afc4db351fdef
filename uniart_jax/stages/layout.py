"""The layout network: images -> the object's parts as a set (where the config has
``layout.queries``)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jax
import numpy as np

from uniart_jax.config import Config, ModelConfig
from uniart_jax.data.layout_batches import layout_batches, validation_layouts
from uniart_jax.inference.layouts import check_backbone, first_layout_weights
from uniart_jax.models.layout import SETS
from uniart_jax.models.network import Network, build
from uniart_jax.stages.pictures import IMAGE_BATCH, RECORDS
from uniart_jax.stages.stage import Evaluation, Stage
from uniart_jax.training.layout_loss import make_layout_loss
from uniart_jax.training.layout_metrics import layout_readings
from uniart_jax.voxels.typed_batches import LayoutBatch, has_parts_alone


class LayoutStage(Stage):
    """Parts as a set, from pictures of objects that are made as training goes."""

    name = "layout"
    batch = LayoutBatch
    makes_data = True

    def left_out(self, model: ModelConfig) -> str:
        return "" if model.layout.queries else "the config has none; give --model.layout.queries 16"

    def check_first_weights(self, config: Config) -> None:
        check_backbone(config.model)

    def batches(self, config: Config, workdir: Path, share: dict[str, int]) -> Any:
        return layout_batches(config.data, config.model, self.settings(config).batch_size, **share)

    def loss(self, network: Network, config: Config, workdir: Path, statistics: Any) -> Any:
        return make_layout_loss(network, config)

    def idle(self, config: Config, batch: LayoutBatch) -> tuple[str, ...]:
        layout = config.model.layout
        names = tuple(n for n in SETS if getattr(layout, n))
        return names if has_parts_alone(batch) else ()

    def first_weights(self, config: Config) -> dict[str, Any]:
        return first_layout_weights(config)

    def evaluation(self, config: Config, workdir: Path, statistics: Any) -> Evaluation | None:
        return _evaluation(config)


def _evaluation(config: Config) -> Evaluation:
    apply = jax.jit(build("layout", config.model).apply)

    def evaluate(state, step):
        truth = validation_layouts(config.data, config.model, RECORDS)
        rows, counts, cameras = [], [], []
        for first in range(0, len(truth.image), IMAGE_BATCH):
            items = slice(first, first + IMAGE_BATCH)
            out = jax.device_get(apply(state.ema, truth.image[items]))
            cameras.append(np.abs(out["camera"] - truth.camera[items]).mean())
            for b, known in enumerate(truth.part_counts[items]):
                tables = (
                    table[first + b, :known] for table in (truth.boxes, truth.codes, truth.parents)
                )
                parts = {name: values[b] for name, values in out["parts"][-1].items()}
                found, count = layout_readings(parts, *tables)
                rows, counts = rows + found, counts + [count]
        figures = {
            f"parts/{n}": float(np.mean([r[n] for r in rows])) for n in ("right", "found", "type")
        }
        figures["parts/box"] = float(np.median([r["box"] for r in rows]))
        return {**figures, "count": float(np.mean(counts)), "camera": float(np.mean(cameras))}, {}

    return evaluate

"""The structure flow: noise -> structure latent, given the image."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jax
import numpy as np

from uniart_jax.config import LATENT_OF, Config
from uniart_jax.data.latents import LatentSource
from uniart_jax.data.order import spread
from uniart_jax.inference.samplers import (
    make_structure_decoder,
    make_structure_sampler,
    reads_layout_cameras,
    with_layout_cameras,
)
from uniart_jax.models.network import Network
from uniart_jax.stages.flows import (
    FlowStage,
    condition_of_items,
    first_pictures,
    load_conditioner,
    load_layout_finder,
)
from uniart_jax.stages.pictures import IMAGE_BATCH, OBJECTS, PICTURES, beside, filled, iou
from uniart_jax.stages.stage import Evaluation, load
from uniart_jax.training.flow_losses import make_structure_flow_loss
from uniart_jax.voxels.typed_batches import StructureBatch


class StructureFlowStage(FlowStage):
    """The dense flow and, with ``loss.refined``, its refiner."""

    name = "structure_flow"
    batch = StructureBatch
    latent = LATENT_OF["structure_flow"]
    needed = ("image",)

    def decodes(self, config: Config) -> str:
        weights = config.loss
        return "structure_vae" if weights.refined > 0 or weights.decoded_structure > 0 else ""

    def flow_loss(
        self, network: Network, config: Config, workdir: Path, mean: Any, std: Any
    ) -> Any:
        return make_structure_flow_loss(network, config, mean, std)

    def evaluation(self, config: Config, workdir: Path, statistics: Any) -> Evaluation | None:
        return _evaluation(config, workdir, statistics) if config.data.validation else None


def _evaluation(config: Config, workdir: Path, statistics: dict[str, Any]) -> Evaluation:
    source = LatentSource(workdir / "latents-validation")
    sampler = make_structure_sampler(config.model, config.sample_structure)
    parameters = load(workdir, "structure_vae", config)
    decode = make_structure_decoder(config.model)
    threshold = config.sample_structure.threshold
    finder = load_layout_finder(config, workdir) if config.loss.found else None
    through = reads_layout_cameras(config.model)

    def evaluate(state, step):
        condition_of = load_conditioner(config, workdir)  # beside the step's own for now alone

        def occupied(condition, key):
            latent = sampler(state.ema, statistics["structure"], condition, key).x
            return np.asarray(decode(parameters, state.ema, latent, condition)) > threshold

        overlaps, by_found, pictures = [], [], []
        number = min(OBJECTS, len(source)) // IMAGE_BATCH * IMAGE_BATCH or len(source)
        chosen = spread(len(source), number)
        for start in range(0, number, IMAGE_BATCH):
            items = [source[i] for i in chosen[start : start + IMAGE_BATCH]]
            condition = condition_of_items(items, condition_of, config)
            key = jax.random.key(start)
            found = finder(first_pictures(items)) if finder is not None else None
            if found is not None and through:
                condition = with_layout_cameras(condition, found.cameras)
            truth = np.zeros((len(items), *(config.model.grid.resolution,) * 3), bool)
            for row, item in zip(truth, items, strict=True):
                row[tuple(item["coords"].astype(int).T)] = True
            drawn = occupied(condition, key)
            overlaps += list(iou(drawn, truth))
            if found is not None:
                condition = condition._replace(layout=found.table)
                by_found += list(iou(occupied(condition, key), truth))
            for b, item in enumerate(items[: PICTURES - len(pictures)]):
                both, image = (filled(truth[b]), filled(drawn[b])), item["images"][0] / 255
                pictures.append(beside(*both, truth.shape[1], image))
        figures = {"iou": float(np.mean(overlaps))}
        if by_found:  # what sampling has: layouts that the network finds
            figures["iou_found"] = float(np.mean(by_found))
        return figures, {"occupancy": np.concatenate(pictures)}

    return evaluate

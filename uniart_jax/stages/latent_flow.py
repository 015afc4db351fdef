"""The latent flow: noise on the active voxels -> UniArt latent, given the image."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import jax
import numpy as np

from uniart_jax.config import LATENT_OF, Config
from uniart_jax.data.latents import LatentSource
from uniart_jax.data.order import spread
from uniart_jax.data.records import Record, RecordSource, decode_color
from uniart_jax.inference.networks import voxel_grid
from uniart_jax.inference.samplers import (
    flow_inputs,
    make_latent_sampler,
    pad_coords,
    reads_layout_cameras,
    with_layout_cameras,
)
from uniart_jax.models.network import Network, build
from uniart_jax.nn.voxel_plans import voxel_plans
from uniart_jax.precompute.encoding import latent_metric
from uniart_jax.stages.flows import (
    FlowStage,
    condition_of_items,
    first_pictures,
    item_tables,
    load_conditioner,
    load_layout_finder,
)
from uniart_jax.stages.pictures import OBJECTS, PICTURES, beside, solid, sub_cells
from uniart_jax.stages.stage import Evaluation, load
from uniart_jax.training.flow_losses import make_latent_flow_loss
from uniart_jax.training.metrics import part_readings, summarize_readings
from uniart_jax.voxels.grid import smoothed
from uniart_jax.voxels.typed_batches import VoxelBatch


class LatentFlowStage(FlowStage):
    """The sparse flow."""

    name = "latent_flow"
    batch = VoxelBatch
    latent = LATENT_OF["latent_flow"]
    needed = ("image", "latent", "plans")

    def flow_loss(
        self, network: Network, config: Config, workdir: Path, mean: Any, std: Any
    ) -> Any:
        data, share = config.data, config.loss.readout_share
        metric = None
        if share:
            metric = latent_metric(workdir / "latents", data.records, share, data.split)
        return make_latent_flow_loss(network, config, mean, std, metric)

    def evaluation(self, config: Config, workdir: Path, statistics: Any) -> Evaluation | None:
        return _evaluation(config, workdir, statistics) if config.data.validation else None


def _evaluation(config: Config, workdir: Path, statistics: dict[str, Any]) -> Evaluation:
    source = LatentSource(workdir / "latents-validation")
    records = RecordSource(config.data.validation, config.data.validation_split)
    options = config.sample_latent
    sampler = make_latent_sampler(config.model, options)
    vae = build("uniart_vae", config.model)
    parameters = load(workdir, "uniart_vae", config)
    through = config.loss.found and reads_layout_cameras(config.model)
    finder = load_layout_finder(config, workdir) if through else None
    decode = jax.jit(functools.partial(vae.apply, method="decode"))

    def evaluate(state, step):
        condition_of = load_conditioner(config, workdir)  # beside the step's own for now alone
        rows, inside, pictures = [], [], []
        for index in spread(len(source), OBJECTS):
            item = source[index]
            record: Record = records[int(item["record"])]
            coords, counts = pad_coords(
                [item["coords"].astype(np.int32)], config.data.voxel_buckets
            )
            voxels = flow_inputs(coords, counts, config.model)
            key = jax.random.key(index)
            condition = condition_of_items([item], condition_of, config)
            if finder is not None:
                condition = with_layout_cameras(condition, finder(first_pictures([item])).cameras)
            latent = sampler(state.ema, statistics["latent"], condition, key, voxels).x
            model = config.model
            plans = voxel_plans(coords, counts, model.uniart_vae, model.grid)
            batch = VoxelBatch(coords, counts, plans=plans)
            if model.uniart_vae.layout_channels:
                batch = batch._replace(layout=item_tables([item], model))
            out, count = jax.device_get(decode(parameters, latent, batch)), counts[0]
            rows += part_readings(
                out["joint_code"][0, :count],
                out["part_boxes"][0, :count, 0],
                record.voxel_part,
                record.boxes,
                record.codes,
                record.parents,
            )
            grid = voxel_grid(out, 0, coords[0, :count], config.model.grid)
            smooth = smoothed(grid, options.sdf_offset, options.sdf_blur, options.sdf_blur_along)
            truth, guess = record.sdf < 0, smooth.sdf < 0
            inside.append((truth & guess).sum() / max((truth | guess).sum(), 1))
            if len(pictures) < PICTURES:
                true = solid(record.coords, record.sdf, decode_color(record.color))
                found = solid(smooth.coords, smooth.sdf, smooth.color)
                pictures.append(beside(true, found, sub_cells(config), item["images"][0] / 255))
        figures = {"inside_iou": float(np.mean(inside)), **summarize_readings(rows)}
        return figures, {"surface": np.concatenate(pictures)}

    return evaluate

"""How each stage is judged while it trains, on records that it never sees: part-level readings beside the losses.

Validation seeds are neither training seeds nor the held-out seeds of the evaluation, so that nothing is tuned on the latter.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from uniart_jax.config import Config, ModelConfig
from uniart_jax.data.batches import record_batches
from uniart_jax.data.image_table import image_pass
from uniart_jax.data.latents import LatentSource
from uniart_jax.data.layouts import validation_layouts
from uniart_jax.data.order import spread
from uniart_jax.data.records import Record, RecordSource, decode_color
from uniart_jax.models.network import build
from uniart_jax.nn.voxel_plans import voxel_plans
from uniart_jax.pipeline import (
    Condition,
    flow_inputs,
    make_conditioner,
    make_latent_sampler,
    make_structure_decoder,
    make_structure_sampler,
    pad_coords,
    voxel_grid,
)
from uniart_jax.samplers import make_layout_finder
from uniart_jax.training.export import load_network
from uniart_jax.training.layout_metrics import layout_readings
from uniart_jax.training.metrics import part_readings, summarize_readings
from uniart_jax.training.state import TrainState
from uniart_jax.voxels.grid import smoothed
from uniart_jax.voxels.part_table import ROWS, PartTable, part_table

Evaluation = Callable[[TrainState, int], tuple[dict[str, float], dict[str, np.ndarray]]]
IMAGE_BATCH = 16
VOXEL_BATCH = 2
RECORDS = 128  # of the validation records at most; enough to see a trend, few enough to look often
OBJECTS = 48  # for flows, which sample them
PICTURES, PICTURE = 4, 128  # objects that are shown, and pixels a side of each view
Cells = tuple[np.ndarray, np.ndarray | None]  # [N, 3] indices, [N, 3] linear colours


def make_evaluation(
    name: str,
    config: Config,
    workdir: Path,
    statistics: dict[str, tuple[np.ndarray, np.ndarray]] | None,
) -> Evaluation | None:
    """The evaluation hook of a stage (``training.loop``), judging the averaged weights; None without validation records."""
    if name == "layout":
        return _layout(config)
    if not config.data.validation:
        return None
    if name.endswith("_flow"):
        return {"structure_flow": _structure_flow, "latent_flow": _latent_flow}[name](
            config, workdir, statistics or {}
        )
    return {
        "image_encoder": _image_encoder,
        "structure_vae": _structure_vae,
        "uniart_vae": _uniart_vae,
    }[name](config)


def iou(predicted: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """[B] overlap of dense occupancies [B, R, R, R]."""
    axes = (1, 2, 3)
    return (predicted & truth).sum(axes) / np.maximum((predicted | truth).sum(axes), 1)


def _pictures(config: Config):
    return image_pass(
        config.data.validation, config.model, IMAGE_BATCH, config.data.validation_split, RECORDS
    )


def _image_encoder(config: Config) -> Evaluation:
    apply = jax.jit(build("image_encoder", config.model).apply)
    tables = RecordSource(config.data.validation, config.data.validation_split)

    def evaluate(state, step):
        overlaps, cameras, rows, pictures = [], [], [], []
        for batch in _pictures(config):
            out = jax.device_get(apply(state.ema, batch["image"]))
            truth = np.asarray(batch["occupancy"], bool)
            for b, index in enumerate(batch["record"]):
                if index < 0:
                    continue
                overlaps.append(iou(out["occupancy"][b : b + 1] > 0, truth[b : b + 1])[0])
                cameras.append(np.abs(out["camera"][b] - batch["camera"][b]).mean())
                part = batch["cell_part"][b]
                mask = part >= 0
                codes, record = out["codes"][b][mask], tables[int(index)]
                rows += part_readings(
                    codes[:, :9],
                    codes[:, 9:15],
                    part[mask],
                    record.boxes,
                    record.codes,
                    record.parents,
                )
                if len(pictures) < PICTURES:
                    both = filled(truth[b]), filled(out["occupancy"][b] > 0)
                    pictures.append(beside(*both, truth.shape[1], batch["image"][b]))
        figures = {"iou": float(np.mean(overlaps)), "camera": float(np.mean(cameras))}
        return {**figures, **summarize_readings(rows)}, {"occupancy": np.concatenate(pictures)}

    return evaluate


def _layout(config: Config) -> Evaluation:
    apply = jax.jit(build("layout", config.model).apply)

    def evaluate(state, step):
        truth = validation_layouts(config.data, config.model, RECORDS)
        rows, counts, cameras = [], [], []
        for first in range(0, len(truth["image"]), IMAGE_BATCH):
            items = slice(first, first + IMAGE_BATCH)
            out = jax.device_get(apply(state.ema, truth["image"][items]))
            cameras.append(np.abs(out["camera"] - truth["camera"][items]).mean())
            for b, known in enumerate(truth["part_counts"][items]):
                tables = (truth[n][first + b, :known] for n in ("boxes", "codes", "parents"))
                parts = {name: values[b] for name, values in out["parts"][-1].items()}
                found, count = layout_readings(parts, *tables)
                rows, counts = rows + found, counts + [count]
        figures = {f"parts/{n}": float(np.mean([r[n] for r in rows])) for n in ("right", "found", "type")}  # fmt: skip
        figures["parts/box"] = float(np.median([r["box"] for r in rows]))
        return {**figures, "count": float(np.mean(counts)), "camera": float(np.mean(cameras))}, {}

    return evaluate


def _structure_vae(config: Config) -> Evaluation:
    network = build("structure_vae", config.model)
    apply = jax.jit(lambda params, occupancy: network.apply(params, occupancy)["logits"])

    def evaluate(state, step):
        overlaps, pictures = [], []
        for batch in _pictures(config):
            truth = np.asarray(batch["occupancy"], bool)
            logits = np.asarray(apply(state.ema, batch["occupancy"].astype(np.float32)))
            known = batch["record"] >= 0
            overlaps += list(iou(logits > 0, truth)[known])
            for b in np.flatnonzero(known)[: PICTURES - len(pictures)]:
                both = filled(truth[b]), filled(logits[b] > 0)
                pictures.append(beside(*both, truth.shape[1]))
        return {"iou": float(np.mean(overlaps))}, {"occupancy": np.concatenate(pictures)}

    return evaluate


def _uniart_vae(config: Config) -> Evaluation:
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
            out = jax.device_get(
                apply(state.ema, {k: v for k, v in batch.items() if k not in ("images", "record")})
            )
            for b, index in enumerate(batch["record"]):
                if index < 0:
                    continue
                count = batch["counts"][b]
                part, known = batch["voxel_part"][b, :count], batch["part_counts"][b]
                rows += part_readings(
                    out["joint_code"][b, :count],
                    out["box_pair"][b, :count, 0],
                    part,
                    batch["boxes"][b, :known],
                    batch["codes"][b, :known],
                    batch["parents"][b, :known],
                )
                truth, guess = batch["sdf"][b, :count] < 0, out["sdf"][b, :count] < 0
                inside.append((truth & guess).sum() / max((truth | guess).sum(), 1))
                color = decode_color(batch["color"][b, :count])
                colors.append(np.abs(out["color"][b, :count] - color).mean())
                if len(pictures) < PICTURES:
                    coords = batch["coords"][b, :count]
                    found = solid(coords, out["sdf"][b, :count], out["color"][b, :count])
                    true = solid(coords, batch["sdf"][b, :count], color)
                    pictures.append(beside(true, found, _sub_cells(config)))
        figures = {"inside_iou": float(np.mean(inside)), "color_error": float(np.mean(colors))}
        return {**figures, **summarize_readings(rows)}, {"surface": np.concatenate(pictures)}

    return evaluate


def _structure_flow(config: Config, workdir: Path, statistics: dict[str, Any]) -> Evaluation:
    source = LatentSource(workdir / "latents-validation")
    sampler = make_structure_sampler(config.model, config.sample_structure)
    abstract = build("structure_vae", config.model).abstract()
    parameters = load_network(workdir, "structure_vae", abstract)
    decode = make_structure_decoder(config.model)
    threshold = config.sample_structure.threshold
    finder = load_layout_finder(config, workdir) if config.loss.found else None

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
            condition = _condition(items, condition_of, config)
            key = jax.random.key(start)
            truth = np.zeros((len(items), *(config.model.grid.resolution,) * 3), bool)
            for row, item in zip(truth, items, strict=True):
                row[tuple(item["coords"].astype(int).T)] = True
            found = occupied(condition, key)
            overlaps += list(iou(found, truth))
            if finder is not None:
                condition = condition._replace(layout=finder(_first_pictures(items)))
                by_found += list(iou(occupied(condition, key), truth))
            for b, item in enumerate(items[: PICTURES - len(pictures)]):
                both, image = (filled(truth[b]), filled(found[b])), item["images"][0] / 255
                pictures.append(beside(*both, truth.shape[1], image))
        figures = {"iou": float(np.mean(overlaps))}
        if by_found:  # what sampling has: layouts that the network finds
            figures["iou_found"] = float(np.mean(by_found))
        return figures, {"occupancy": np.concatenate(pictures)}

    return evaluate


def _latent_flow(config: Config, workdir: Path, statistics: dict[str, Any]) -> Evaluation:
    source = LatentSource(workdir / "latents-validation")
    records = RecordSource(config.data.validation, config.data.validation_split)
    options = config.sample_latent
    sampler = make_latent_sampler(config.model, options)
    vae = build("uniart_vae", config.model)
    parameters = load_network(workdir, "uniart_vae", vae.abstract())
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
            condition = _condition([item], condition_of, config)
            latent = sampler(state.ema, statistics["latent"], condition, key, voxels).x
            batch: dict[str, Any] = {"coords": coords, "counts": counts}
            batch["plans"] = voxel_plans(
                batch, config.model.uniart_vae, config.model.grid, parts=False
            )
            if config.model.uniart_vae.layout_channels:
                batch["layout"] = item_tables([item], config.model)
            out, count = jax.device_get(decode(parameters, latent, batch)), counts[0]
            rows += part_readings(
                out["joint_code"][0, :count],
                out["box_pair"][0, :count, 0],
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
                pictures.append(beside(true, found, _sub_cells(config), item["images"][0] / 255))
        figures = {"inside_iou": float(np.mean(inside)), **summarize_readings(rows)}
        return figures, {"surface": np.concatenate(pictures)}

    return evaluate


def load_conditioner(config: Config, workdir: Path) -> Callable[[jax.Array], Condition]:
    """``samplers.make_conditioner`` with the trained image encoder of WORKDIR, on one device as long as the function is kept."""
    abstract = build("image_encoder", config.model).abstract()
    parameters = jax.device_put(load_network(workdir, "image_encoder", abstract))
    return functools.partial(make_conditioner(config.model), parameters)


def load_layout_finder(config: Config, workdir: Path) -> Callable[[jax.Array], PartTable]:
    """``samplers.make_layout_finder`` with the layout network of WORKDIR."""
    abstract = build("layout", config.model).abstract()
    parameters = jax.device_put(load_network(workdir, "layout", abstract))
    return functools.partial(make_layout_finder(config.model), parameters)


def _first_pictures(items: list[dict[str, Any]]) -> jax.Array:
    """[B, S, S, 3] in [0, 1] of items of ``data.latents``."""
    return jnp.asarray(np.stack([item["images"][0] for item in items]).astype(np.float32) / 255)


def _condition(
    items: list[dict[str, Any]], condition_of: Callable[..., Condition], config: Config
) -> Condition:
    """What flows see of the first picture of each item, and of its true layout."""
    condition, model = condition_of(_first_pictures(items)), config.model
    if not (model.structure_flow.layout_channels or model.latent_flow.layout_channels):
        return condition
    return condition._replace(layout=item_tables(items, model))


def item_tables(items: list[dict[str, Any]], model: ModelConfig) -> PartTable:
    """The true layouts of items of ``data.latents``."""
    tables = [{name: item[name] for name in ROWS} for item in items]
    return part_table(tables, model.grid.max_parts)


def filled(occupancy: np.ndarray) -> Cells:
    """The occupied cells of a dense grid [R, R, R], without colours."""
    return np.argwhere(occupancy), None


def solid(coords: np.ndarray, sdf: np.ndarray, color: np.ndarray) -> Cells:
    """The sub-cells [V, r^3] of voxels [V, 3] that lie inside the object, with their colours."""
    r = round(sdf.shape[1] ** (1 / 3))
    within = np.indices((r, r, r)).reshape(3, -1).T
    inside = sdf < 0
    return (coords.astype(int)[:, None] * r + within)[inside], color[inside]


def beside(
    true: Cells, found: Cells, resolution: int, image: np.ndarray | None = None
) -> np.ndarray:
    """[S, 4 S, 3] in [0, 1]: front and side of the true cells, then of those found; [S, 5 S, 3] with the image [S, S, 3] before them.

    The front is seen from -x, the side from -y, z up. What is nearer is brighter. ``resolution``: cells a side of the grid.
    """
    size = PICTURE if image is None else image.shape[0]
    pixels = np.arange(size) * resolution // size
    tiles = [] if image is None else [np.asarray(image)]
    for cells, colors in (true, found):
        tint = 1.0 if colors is None else np.clip(colors, 0, 1) ** (1 / 2.2)
        for axis, across in ((0, resolution - 1 - cells[:, 1]), (1, cells[:, 0])):
            depth = cells[:, axis].astype(np.int16)
            order = np.argsort(-depth, kind="stable")  # the nearest is drawn last
            picture = np.zeros((resolution, resolution, 3), np.float32)
            light = (1 - 0.7 * depth / resolution)[:, None] * tint
            picture[resolution - 1 - cells[order, 2], across[order]] = light[order]
            tiles.append(picture[pixels][:, pixels])
    return np.concatenate(tiles, 1)


def _sub_cells(config: Config) -> int:
    return config.model.grid.resolution * config.model.grid.subdivisions

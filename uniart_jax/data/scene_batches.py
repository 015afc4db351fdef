"""Pictures with backgrounds and their masks, what the mask network trains on: the blocks of
``data.layouts``, put in front of random backgrounds (``data.scenes``). No jax."""

from __future__ import annotations

import functools

import numpy as np

from uniart_jax.config import DataConfig, ModelConfig
from uniart_jax.data.backdrop_pictures import picture_paths
from uniart_jax.data.backdrops import training_backdrop
from uniart_jax.data.layout_batches import (
    LayoutOrder,
    claimed_settings,
    drawn_item,
    neighbours,
    validation_items,
)
from uniart_jax.data.layouts import LayoutSettings
from uniart_jax.data.order import Draw, local_rows
from uniart_jax.data.scenes import GRAIN, scene
from uniart_jax.data.stream import Batches
from uniart_jax.voxels.typed_batches import MaskBatch


def scene_batches(
    data: DataConfig,
    model: ModelConfig,
    batch_size: int,
    *,
    process_index: int = 0,
    process_count: int = 1,
    accumulate: int = 1,
) -> Batches[MaskBatch]:
    """Endless batches in the order of ``data.layouts``; each picture's background is drawn anew
    whenever it is shown.

    Raises:
      ValueError: as ``data.layout_batches.layout_batches``.
    """
    settings = claimed_settings(data, model)
    rows = local_rows(batch_size, process_index, process_count, accumulate)
    load = functools.partial(
        _load, data=data, settings=settings, rows=rows, size=model.mask.image_size
    )
    return Batches(LayoutOrder(batch_size, data.reuse), load, data.workers)


def _load(
    draw: Draw, *, data: DataConfig, settings: LayoutSettings, rows: np.ndarray, size: int
) -> MaskBatch:
    items = []
    for row in rows:
        place = int(draw.records[row])
        table, item = drawn_item(place, data, settings, masks=True)
        rng = np.random.default_rng([data.seed, 4, place])
        back = training_backdrop(rng, size, picture_paths(data.backgrounds))
        items.append(_scene(rng, table, item, size, back))
    return _stacked(items)


def _scene(
    rng: np.random.Generator,
    table: dict[str, np.ndarray],
    item: int,
    size: int,
    back: np.ndarray | None = None,
) -> MaskBatch:
    """One item, its arrays without the axis B."""
    crop, others = neighbours(rng, table, item)
    image, mask = scene(rng, crop, others, size, back=back, grain=GRAIN)
    return MaskBatch(image.astype(np.float32) / 255, mask.astype(np.float32) / 255)


def validation_scenes(data: DataConfig, model: ModelConfig, count: int) -> MaskBatch:
    """The first ``count`` validation objects, each in front of a background of its own, as one
    batch."""
    return _stacked(
        [
            _scene(np.random.default_rng([5, number, i]), table, i, model.mask.image_size)
            for number, table, i in validation_items(data, model, count)
        ]
    )


def _stacked(items: list[MaskBatch]) -> MaskBatch:
    return MaskBatch(*(np.stack(field) for field in zip(*items, strict=True)))

"""Batches of ``data.layouts``, what the layout network trains on. No jax.

They go through windows of ``WINDOW`` blocks, from ``DataConfig.first_block`` on; in a window each
object is shown ``DataConfig.reuse`` times, in random order, in one of its views, mirrored with
probability 1/2 (``voxels.typed_batches.LayoutBatch``). A share ``DataConfig.photographs`` of the
pictures are as they would be cut out of a photograph (``data.photographs``), others each time. One
batch in ``DataConfig.box_sets_every`` has legs, panels and boards; in the others they are None.
"""

from __future__ import annotations

import dataclasses
import functools
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from uniart_jax.config import DataConfig, ModelConfig
from uniart_jax.data.backdrop_pictures import picture_paths
from uniart_jax.data.backdrops import training_backdrop
from uniart_jax.data.cameras import mirror_camera_codes
from uniart_jax.data.layouts import (
    BLOCK,
    COLUMNS,
    LayoutSettings,
    check_settings,
    load_block,
    settings_of,
)
from uniart_jax.data.mirror import (
    mirror_boxes,
    mirror_codes,
    mirror_corners,
    mirror_images,
    mirror_legs,
    mirror_revolutions,
)
from uniart_jax.data.order import ENDLESS, Draw, local_rows
from uniart_jax.data.photographs import photographed
from uniart_jax.data.scenes import OTHERS, Crop
from uniart_jax.data.stream import Batches
from uniart_jax.voxels.typed_batches import LayoutBatch, parts_of

WINDOW = 4  # blocks that batches are drawn from at a time
_LOCK = threading.Lock()


def claimed_settings(data: DataConfig, model: ModelConfig) -> LayoutSettings:
    """``settings_of`` a training, whose folder is made, or checked, to be of them.

    Raises:
      ValueError: the folder holds other settings, the first block is below 0,
        ``data.box_sets_every`` below 1, ``data.photographs`` is not a share, or
        ``data.backgrounds`` holds no pictures.
    """
    if data.first_block < 0:
        raise ValueError(f"config: data.first_block is {data.first_block}; give 0 or more")
    if data.box_sets_every < 1:
        raise ValueError(f"config: data.box_sets_every is {data.box_sets_every}; give 1 or more")
    if not 0 <= data.photographs <= 1:
        raise ValueError(f"config: data.photographs is {data.photographs:g}; give 0 to 1")
    picture_paths(data.backgrounds)
    settings = settings_of(data, model)
    check_settings(data.layouts, settings)
    return settings


def layout_batches(
    data: DataConfig,
    model: ModelConfig,
    batch_size: int,
    *,
    process_index: int = 0,
    process_count: int = 1,
    accumulate: int = 1,
) -> Batches[LayoutBatch]:
    """Endless batches (see the module's docstring) from ``data.layouts``; missing blocks are made
    on the way.

    Raises:
      ValueError: as ``claimed_settings``, or the batch cannot be shared or does not divide into
        windows.
    """
    settings = claimed_settings(data, model)
    order = LayoutOrder(batch_size, data.reuse)
    rows = local_rows(batch_size, process_index, process_count, accumulate)
    load = functools.partial(_load, data=data, settings=settings, rows=rows)
    return Batches(order, load, data.workers)


@dataclasses.dataclass(frozen=True)
class LayoutOrder:
    """Batch n takes items n B to (n + 1) B of the endless sequence of windows; ``records`` are
    places in it."""

    batch_size: int
    reuse: int

    def __len__(self) -> int:
        return ENDLESS

    def __getitem__(self, number: int) -> Draw:
        places = np.arange(number * self.batch_size, (number + 1) * self.batch_size)
        return Draw(number, places, 0)


def load_window(
    folder: str, first: int, settings: LayoutSettings, masks: bool = False
) -> dict[str, np.ndarray]:
    """The blocks of a window, from block ``first`` on, joined, with or without masks; kept, and
    read by one thread at a time."""
    with _LOCK:
        return _window(folder, first, settings, masks)


@functools.lru_cache(maxsize=3)
def _window(
    folder: str, first: int, settings: LayoutSettings, masks: bool
) -> dict[str, np.ndarray]:
    blocks = [load_block(folder, number, settings) for number in range(first, first + WINDOW)]
    names = [name for name in COLUMNS if masks or name != "masks"]
    return {name: np.concatenate([block[name] for block in blocks]) for name in names}


@functools.lru_cache(maxsize=3)
def _shuffled(window: int, length: int, seed: int) -> np.ndarray:
    return np.random.default_rng([seed, 3, window]).permutation(length)


def _load(
    draw: Draw, *, data: DataConfig, settings: LayoutSettings, rows: np.ndarray
) -> LayoutBatch:
    rng = draw.generator(data.seed)
    views, flips = rng.random(len(draw.records)), rng.random(len(draw.records)) < 0.5
    taken = rng.random(len(draw.records)) < data.photographs
    pictures, items = picture_paths(data.backgrounds), []
    for row in rows:
        place = int(draw.records[row])
        table, item = drawn_item(place, data, settings, masks=data.photographs > 0)
        photographer = np.random.default_rng([data.seed, 6, place]) if taken[row] else None
        mirrored = bool(flips[row] and data.mirror)
        items.append(_item(table, item, float(views[row]), mirrored, photographer, pictures))
    batch = _stacked(items)
    return parts_of(batch) if draw.number % data.box_sets_every else batch


def drawn_item(
    place: int, data: DataConfig, settings: LayoutSettings, masks: bool = False
) -> tuple[dict[str, np.ndarray], int]:
    """The window of a place in the endless sequence, and the row of it that is shown there."""
    length = WINDOW * BLOCK * data.reuse
    window, within = divmod(place, length)
    table = load_window(data.layouts, data.first_block + window * WINDOW, settings, masks)
    return table, int(_shuffled(window, length, data.seed)[within] % len(table["images"]))


def _stacked(items: list[LayoutBatch]) -> LayoutBatch:
    return LayoutBatch(*(np.stack(field) for field in zip(*items, strict=True)))


def neighbours(
    rng: np.random.Generator, table: dict[str, np.ndarray], item: int
) -> tuple[Crop, list[Crop]]:
    """The crop of an item in one of its views, and of others of the window."""

    def crop(index: int) -> Crop:
        view = int(rng.integers(table["images"].shape[1]))
        return table["images"][index, view], table["masks"][index, view]

    count = len(table["images"])
    behind = (item + 1 + rng.integers(count - 1, size=OTHERS)) % count
    others = [crop(int(other)) for other in behind]
    return crop(item), others


def _item(
    table: dict[str, np.ndarray],
    item: int,
    view: float,
    mirrored: bool,
    photographer: np.random.Generator | None = None,
    pictures: tuple[Path, ...] = (),
) -> LayoutBatch:
    """One item, its arrays without the axis B; ``photographer`` draws its photograph, perhaps
    before one of ``pictures``."""
    index = int(view * table["images"].shape[1])
    image, camera = table["images"][item, index], table["cameras"][item, index]
    if photographer is not None:
        crop, size = (image, table["masks"][item, index]), len(image)
        others = neighbours(photographer, table, item)[1]
        back = training_backdrop(photographer, size, pictures)
        image, camera = photographed(photographer, crop, camera, others, size, back)
    columns = (table[name][item] for name in ("boxes", "codes", "legs", "panels", "boards"))
    boxes, codes, legs, panels, boards = columns
    revolutions = table["revolutions"][item]
    if mirrored:
        image, camera = mirror_images(image), mirror_camera_codes(camera)
        boxes, codes, legs = mirror_boxes(boxes), mirror_codes(codes), mirror_legs(legs)
        panels, boards = mirror_corners(panels), mirror_corners(boards)
    return LayoutBatch(
        image=image.astype(np.float32) / np.float32(255),
        camera=camera,
        boxes=boxes,
        codes=codes,
        parents=table["parents"][item],
        colors=table["colors"][item],
        part_counts=table["part_counts"][item],
        legs=legs,
        leg_counts=table["leg_counts"][item],
        legs_alone=table["legs_alone"][item],
        panels=panels,
        panel_counts=table["panel_counts"][item],
        panel_share=table["panel_share"][item],
        boards=boards,
        board_counts=table["board_counts"][item],
        board_share=table["board_share"][item],
        revolutions=mirror_revolutions(revolutions) if mirrored else revolutions,
    )


def validation_layouts(data: DataConfig, model: ModelConfig, count: int) -> LayoutBatch:
    """The first ``count`` validation objects, first view, unmirrored, as one batch."""
    items = validation_items(data, model, count)
    return _stacked([_item(table, i, 0.0, False) for _, table, i in items])


def validation_items(
    data: DataConfig, model: ModelConfig, count: int
) -> Iterator[tuple[int, dict[str, np.ndarray], int]]:
    """The first ``count`` validation objects: number of the block, its table, row in it."""
    settings = settings_of(data, model, validation=True)
    folder = f"{data.layouts}-validation"
    check_settings(folder, settings)
    number = 0
    while count > 0:
        table = load_block(folder, number, settings)
        for i in range(min(count, len(table["images"]))):
            yield number, table, i
        count -= len(table["images"])
        number += 1

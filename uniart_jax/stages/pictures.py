"""What stages on pictures of records share; and evaluations: how many validation records they look
at, overlaps, drawings.

Validation seeds are neither training seeds nor the held-out seeds of the evaluation, so that
nothing is tuned on the latter.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from uniart_jax.config import Config
from uniart_jax.data.image_table import image_batches, image_pass
from uniart_jax.stages.stage import Stage
from uniart_jax.voxels.typed_batches import PictureBatch

IMAGE_BATCH = 16
RECORDS = 128  # of the validation records at most; enough to see a trend, few enough to look often
OBJECTS = 48  # for flows, which sample them
PICTURES, PICTURE = 4, 128  # objects that are shown, and pixels a side of each view
Cells = tuple[np.ndarray, np.ndarray | None]  # [N, 3] indices, [N, 3] linear colours


class PictureStage(Stage):
    """A stage on pictures and dense tables of records (``data.image_table``)."""

    batch = PictureBatch
    reads_pictures_only = True

    def batches(self, config: Config, workdir: Path, share: dict[str, int]) -> Any:
        data, items = config.data, self.settings(config).batch_size
        return image_batches(data.records, data, config.model, items, split=data.split, **share)


def iou(predicted: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """[B] overlap of dense occupancies [B, R, R, R]."""
    axes = (1, 2, 3)
    return (predicted & truth).sum(axes) / np.maximum((predicted | truth).sum(axes), 1)


def validation_pictures(config: Config):
    """Batches of ``data.image_table`` of the validation records, each once."""
    return image_pass(
        config.data.validation, config.model, IMAGE_BATCH, config.data.validation_split, RECORDS
    )


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
    """[S, 4 S, 3] in [0, 1]: front and side of the true cells, then of those found; [S, 5 S, 3]
    with the image [S, S, 3] before them.

    The front is seen from -x, the side from -y, z up. What is nearer is brighter. ``resolution``:
    cells a side of the grid.
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


def sub_cells(config: Config) -> int:
    """Of the model's grid, a side."""
    return config.model.grid.resolution * config.model.grid.subdivisions

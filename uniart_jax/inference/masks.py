"""The mask network in use: a picture -> what of it is the object.

A picture is looked at twice: as a whole, squeezed to a square, and then around what was found, so
that an object far away is seen as sharply as one that fills the picture.
"""

from __future__ import annotations

from typing import Any

import jax
import numpy as np
import scipy.ndimage
from PIL import Image

from uniart_jax.config import ModelConfig
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.network import build

AROUND = 1.25  # side of the second look over what the first found
LOOSE = 0.02  # a region of less than this share of the largest is no part of the object
LEAST, MOST = 0.01, 0.98  # share of the picture that an object can be


class MaskPredictor:
    """Pictures -> masks of their objects; call it with one.

    Attributes:
      image_size: pixels a side at which a picture is looked at.
    """

    def __init__(self, model: ModelConfig, params: Any):
        self.image_size = model.mask.image_size
        self._params = jax.device_put(params)
        self._run = jax.jit(build("mask", model).apply)

    def __call__(self, rgba: np.ndarray) -> np.ndarray | None:
        """[H, W, 4] uint8 (alpha is not looked at) -> [H, W] uint8 mask, soft at its edges; None if
        hardly anything or nearly all would be the object."""
        picture = Image.fromarray(np.ascontiguousarray(rgba[..., :3]))
        whole = (0.0, 0.0, float(picture.width), float(picture.height))
        first = np.asarray(self._look(picture, whole))
        box = _around(first, picture.size)
        if box is None:
            return None
        mask = np.zeros((picture.height, picture.width), np.uint8)
        left, top, right, bottom = box
        mask[top:bottom, left:right] = self._look(picture, box)
        mask = np.where(_object(mask > 127), mask, 0).astype(np.uint8)
        return mask if LEAST < (mask > 127).mean() < MOST else None

    def _look(self, picture: Image.Image, box: Any) -> Image.Image:
        """The mask of a box (left, upper, right, lower) of the picture, as large as the box."""
        size = (self.image_size, self.image_size)
        seen = picture.resize(size, Image.Resampling.LANCZOS, box=box, reducing_gap=3.0)
        image = np.asarray(seen, np.float32)[None] / 255
        logits = np.asarray(self._run(self._params, image))[0]
        mask = Image.fromarray(np.round(255 / (1 + np.exp(-logits))).astype(np.uint8))
        extent = (round(box[2] - box[0]), round(box[3] - box[1]))
        return mask.resize(extent, Image.Resampling.BILINEAR)


def _around(mask: np.ndarray, size: tuple[int, int]) -> tuple[int, int, int, int] | None:
    """The box around a mask [H, W] uint8, ``AROUND`` times as long, within the picture; None where
    there is none."""
    found = _object(mask > 127)
    if found.mean() < LEAST / 4:
        return None
    box = []
    for axis, side in ((0, size[0]), (1, size[1])):
        places = np.flatnonzero(found.any(axis))
        middle = (places[0] + places[-1] + 1) / 2
        half = (places[-1] + 1 - places[0]) / 2 * AROUND + 1
        box.append((max(int(middle - half), 0), min(int(np.ceil(middle + half)), side)))
    (left, right), (top, bottom) = box
    return left, top, right, bottom


def _object(found: np.ndarray) -> np.ndarray:
    """[H, W] bool without the regions that are small beside the largest."""
    regions = np.zeros(found.shape, np.int32)
    scipy.ndimage.label(found, np.ones((3, 3)), output=regions)
    areas = np.bincount(regions.ravel())
    if len(areas) < 2:
        return found
    areas[0] = 0
    return (areas >= LOOSE * areas.max())[regions] & found


def load_mask_predictor(checkpoint: Checkpoint | None) -> MaskPredictor | None:
    """The mask network of a checkpoint; None where it has none.

    Raises:
      ValueError: its file is not the network's.
    """
    if checkpoint is None or not checkpoint.has("mask"):
        return None
    return MaskPredictor(checkpoint.config.model, checkpoint.load("mask"))

"""The mask network in use: a picture -> what of it is the object.

A picture is looked at twice: as a whole, squeezed to a square, and then around what was found, so
that an object far away is seen as sharply as one that fills the picture. Each time its mirror image
is looked at too.
"""

from __future__ import annotations

from typing import Any

import jax
import numpy as np
import scipy.ndimage
import scipy.special
from PIL import Image

from uniart_jax.config import ModelConfig
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.network import build, kept_of_model

AROUND = 1.25  # side of the second look over what the first found
LOOSE = 0.02  # a region of less than this share of the largest is no part of the object
EDGE = 2  # cells to either side of the object's edge in which a mask may be soft
HOLE = 0.03  # a hole of less than this share of the object is a mistake, and is closed
LEAST = 0.01  # share of the picture that an object has at least


class MaskPredictor:
    """Pictures -> masks of their objects; call it with one.

    Attributes:
      image_size: pixels a side at which a picture is looked at.
    """

    def __init__(self, model: ModelConfig, params: Any):
        self.image_size = model.mask.image_size
        self._params = jax.device_put(params)
        self._run = kept_of_model(jax.jit(build("mask", model).apply), "mask", model)

    def __call__(self, rgba: np.ndarray) -> np.ndarray | None:
        """[H, W, 4] uint8 (alpha is not looked at) -> [H, W] uint8 mask, soft at its edges; None if
        hardly anything would be the object."""
        picture = Image.fromarray(np.ascontiguousarray(rgba[..., :3]))
        whole = (0.0, 0.0, float(picture.width), float(picture.height))
        box = _around(self._look(picture, whole), picture.size)
        if box is None:
            return None
        seen = Image.fromarray(_object(self._look(picture, box)))
        left, top, right, bottom = box
        mask = np.zeros((picture.height, picture.width), np.uint8)
        mask[top:bottom, left:right] = seen.resize(
            (right - left, bottom - top), Image.Resampling.BILINEAR
        )
        return mask if (mask > 127).mean() > LEAST else None

    def _look(self, picture: Image.Image, box: Any) -> np.ndarray:
        """[S, S] uint8 mask of a box (left, upper, right, lower) of the picture, squeezed to a
        square: the mean of the logits of both looks."""
        size = (self.image_size, self.image_size)
        seen = picture.resize(size, Image.Resampling.LANCZOS, box=box, reducing_gap=3.0)
        image = np.asarray(seen, np.float32) / 255
        plain, mirrored = np.asarray(self._run(self._params, np.stack([image, image[:, ::-1]])))
        logits = (plain + mirrored[:, ::-1]) / 2
        return np.round(255 * scipy.special.expit(logits)).astype(np.uint8)


def _around(mask: np.ndarray, size: tuple[int, int]) -> tuple[int, int, int, int] | None:
    """The box around a mask [S, S] uint8 of a whole picture of ``size`` (width, height), ``AROUND``
    times as long, within the picture, in its pixels; None where there is hardly any."""
    found = _object(mask) > 127
    if found.mean() < LEAST / 4:
        return None
    box = []
    for axis, side in ((0, size[0]), (1, size[1])):
        places = np.flatnonzero(found.any(axis))
        first, last = (v * side / len(mask) for v in (places[0], places[-1] + 1))
        middle, half = (first + last) / 2, (last - first) / 2 * AROUND + 1
        box.append((max(int(middle - half), 0), min(int(np.ceil(middle + half)), side)))
    (left, right), (top, bottom) = box
    return left, top, right, bottom


def _object(mask: np.ndarray) -> np.ndarray:
    """A mask [S, S] uint8 without regions that are small beside the largest, and without small
    holes: 255 inside, soft within ``EDGE`` cells of its edges."""
    found = mask > 127
    regions, areas = _regions(found)
    if len(areas) < 2:
        return mask
    kept = (areas >= LOOSE * areas[1:].max())[regions] & found
    around, areas = _regions(~kept)
    small = areas < HOLE * kept.sum()
    small[np.unique(np.concatenate([*around[[0, -1]], *around[:, [0, -1]].T]))] = False
    kept |= small[around] & ~found
    soft = np.asarray(scipy.ndimage.binary_dilation(kept, iterations=EDGE), bool)
    within = np.asarray(scipy.ndimage.binary_erosion(kept, iterations=EDGE, border_value=1), bool)
    return np.where(within, 255, np.where(kept | (soft & ~found), mask, 0)).astype(np.uint8)


def _regions(inside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The regions of [S, S] bool, numbered from 1, 0 elsewhere, and their areas [N + 1]."""
    regions = np.zeros(inside.shape, np.int32)
    scipy.ndimage.label(inside, np.ones((3, 3)), output=regions)
    return regions, np.bincount(regions.ravel())


def load_mask_predictor(checkpoint: Checkpoint | None) -> MaskPredictor | None:
    """The mask network of a checkpoint; None where it has none.

    Raises:
      ValueError: its file is not the network's.
    """
    if checkpoint is None or not checkpoint.has("mask"):
        return None
    return MaskPredictor(checkpoint.config.model, checkpoint.load("mask"))

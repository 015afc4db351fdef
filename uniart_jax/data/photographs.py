"""An object's crop as it would be cut out of a photograph: what the layout network sees of
pictures as people take them. NumPy, SciPy and Pillow alone.

    crop over black, its mask -> in front of a background, in its light, through a camera
    (``data.scenes``) -> a mask with errors -> cut out, cropped anew

A crop around a mask with errors lies elsewhere than one around the object, so the camera code
changes with it (``reframed``).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.ndimage
from PIL import Image, ImageDraw

from uniart_jax.data.images import crop as square_crop
from uniart_jax.data.images import crop_window
from uniart_jax.data.scenes import FAINT, Crop, scene
from uniart_jax.data.textures import Array

SIDES = (200, 352)  # pixels of a photograph
EXACT = 0.35  # share of the masks without errors
UNSURE = (0.1, 0.45)  # how far edges move to either side, as ``_moved_edges`` says
LEAKS, BITES = 0.25, 0.12  # shares of the masks with a thing too much, and with a piece lost
PATCH = (0.03, 0.12)  # half the size of either, shares of the object's longer side
LEFT = 0.5  # least share of the object that a mask must keep


def photographed(
    rng: np.random.Generator,
    crop: Crop,
    camera: Array,
    others: Sequence[Crop],
    size: int,
    back: Array | None = None,
) -> tuple[Array, Array]:
    """An object cut out of a photograph [S, S, 3] uint8 over black, and its camera code [7].

    Args:
      crop: [s, s, 3] uint8 of the object over black, and its alpha [s, s] uint8.
      camera: [7] code of that crop.
      others: crops of objects that may stand behind it.
      size: S.
      back: [P, P, 3] in [0, 1] that it stands in front of; None: any (``data.backdrops``).
    """
    side = int(rng.integers(*SIDES))
    if back is not None:
        back = _at_side(back, side)
    picture, mask = scene(rng, crop, others, side, whole=True, back=back, grain=FAINT)
    found = mistaken(rng, mask)
    image = square_crop(np.dstack([picture, found]), size)
    return image, reframed(camera, crop_window(mask), crop_window(found))


def mistaken(rng: np.random.Generator, mask: Array) -> Array:
    """A mask [S, S] uint8 as a network finds it: most have edges that wander, some a piece of
    something else, some lack one of the object."""
    object_side = 2 * crop_window(mask)[2]
    if rng.random() < EXACT or not (mask > 127).any():
        return mask
    found = _moved_edges(rng, mask)
    if rng.random() < LEAKS:
        found = np.maximum(found, _patch(rng, mask, object_side))
    if rng.random() < BITES:
        found = np.minimum(found, 255 - _patch(rng, mask, object_side))
    kept = ((found > 127) & (mask > 127)).sum()
    return found if kept > LEFT * (mask > 127).sum() else mask


def reframed(
    camera: Array, before: tuple[float, float, float], after: tuple[float, float, float]
) -> Array:
    """The camera code [7] of another crop of the same picture.

    Args:
      camera: of the crop around window ``before``.
      before, after: centre x, centre y and half side, in the picture's pixels.
    """
    shift = (np.array(after[:2]) - np.array(before[:2])) / before[2]
    ratio = after[2] / before[2]
    code = np.array(camera, np.float32)
    code[3] /= ratio
    code[5:7] = (code[5:7] + shift) / ratio
    return code


def _at_side(picture: Array, side: int) -> Array:
    image = Image.fromarray(np.round(picture * 255).astype(np.uint8))
    return np.asarray(image.resize((side, side), Image.Resampling.BILINEAR), np.float32) / 255


def _moved_edges(rng: np.random.Generator, mask: Array) -> Array:
    """Edges that wander: a blurred mask, against a threshold that changes from place to place."""
    size = len(mask)
    blurred = scipy.ndimage.gaussian_filter(mask.astype(np.float32) / 255, rng.uniform(0.5, 3.0))
    cells = int(rng.integers(3, 14))
    field = rng.normal(size=(cells, cells)).astype(np.float32)
    image = Image.fromarray(field).resize((size, size), Image.Resampling.BICUBIC)
    threshold = 0.5 + rng.uniform(-0.25, 0.15) + rng.uniform(*UNSURE) * np.asarray(image) / 2
    soft = (blurred - np.clip(threshold, 0.03, 0.97)) / rng.uniform(0.05, 0.3)
    return np.round(np.clip(0.5 + soft, 0, 1) * 255).astype(np.uint8)


def _patch(rng: np.random.Generator, mask: Array, object_side: float) -> Array:
    """[S, S] uint8, 255 within an ellipse or a rectangle about a place at the object's edge."""
    inside = mask > 127
    edge = np.argwhere(inside & ~np.asarray(scipy.ndimage.binary_erosion(inside), bool))
    cy, cx = edge[rng.integers(len(edge))]
    w, h = object_side * rng.uniform(*PATCH, 2) * rng.choice((0.5, 1.0, 1.6), 2)
    stencil = Image.new("L", mask.shape[::-1])
    draw = ImageDraw.Draw(stencil)
    shape = draw.ellipse if rng.random() < 0.5 else draw.rectangle
    shape([float(cx - w), float(cy - h), float(cx + w), float(cy + h)], 255)
    return np.asarray(stencil)

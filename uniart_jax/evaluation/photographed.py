"""Renders as photographs: in front of a random background, and cut out of it again as a user's
picture is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from uniart_jax.data.background import FindMask, Way, cut_out
from uniart_jax.data.images import MARGIN, crop, crop_mask
from uniart_jax.data.scenes import OTHERS, scene
from uniart_jax.evaluation.procedural import HeldOut
from uniart_jax.evaluation.real import RealObject

SIDE = 384  # pixels of a photograph
CROP = 320  # of the object's crop before it is put there
FILLING = (0.97 * MARGIN, MARGIN)  # the crop's side over the picture's, of an object that fills it


def photograph(
    tests: Sequence[HeldOut | RealObject],
    index: int,
    back: np.ndarray | None = None,
    *,
    grain: float = 0.0,
    scales: tuple[float, float] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Object ``index`` in front of a background, the same in every run: [S, S, 4] uint8, opaque,
    and its true mask [S, S] uint8.

    Args:
      back: [S, S, 3] in [0, 1]; None: any of ``data.backdrops``. grain, scales: as in
        ``data.scenes.scene``; ``FILLING``: from side to side of the picture.
    """
    others = [k for k in range(min(len(tests), 1 + OTHERS)) if k != index]  # whatever the count
    crops = [_crop(tests[row].image) for row in (index, *others)]
    rng = np.random.default_rng([index, 6])
    how = {"whole": True, "back": back, "grain": grain, "scales": scales}
    picture, mask = scene(rng, crops[0], crops[1:], SIDE, **how)
    return np.dstack([picture, np.full_like(mask, 255)]), mask


def cut_again(
    tests: Sequence[HeldOut | RealObject], index: int, network: FindMask | None
) -> tuple[np.ndarray, float, Way]:
    """``photograph`` cut out as ``pipeline.sample`` would: [S, S, 4], the overlap of its mask with
    the true one, and the way (``data.background``)."""
    picture, mask = photograph(tests, index)
    cut, way = cut_out(picture, network=lambda: network)
    return cut, overlap(cut[..., 3], mask), way


def overlap(found: np.ndarray, true: np.ndarray) -> float:
    """Intersection over union of masks [H, W] uint8."""
    found, true = found > 127, true > 127
    return float((found & true).sum() / max((found | true).sum(), 1))


def _crop(rgba: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return crop(rgba, CROP), crop_mask(rgba, CROP)

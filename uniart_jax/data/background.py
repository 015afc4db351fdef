"""What of a picture is the object: the background is cut away, by the first way that can.

    alpha -> a plain background -> rembg, where installed -> the checkpoint's mask network
    -> GrabCut, where OpenCV is installed

What a plain background leaves is taken where the mask network, if there is one, finds about the
same; else the network's mask is. rembg (a network, downloaded by rembg itself) and OpenCV come with
``pip install 'uniart_jax[photo]'``. The mask network: ``inference.masks``. GrabCut is Rother et
al., "GrabCut", SIGGRAPH 2004.
"""

from __future__ import annotations

import functools
import importlib.util
import warnings
from collections.abc import Callable
from typing import Any, Literal, get_args

import numpy as np
import scipy.ndimage
from PIL import Image

from uniart_jax.config import Background
from uniart_jax.data.images import check_visible, has_alpha, remove_plain_background

Way = Literal["alpha", "plain", "rembg", "network", "grabcut", "none"]
FindMask = Callable[[np.ndarray], np.ndarray | None]  # [H, W, 4] uint8 -> [H, W] uint8, or nothing
REMBG_MODEL = "u2net"  # Apache-2.0, as rembg is MIT; its newest default is not for every use
GRABCUT_SIDE = 384  # pixels; a larger picture is cut at this size
GRABCUT_ROUNDS = 5
AGREED = 0.9  # overlap from which on a plain background's cut stands (``_agree``)
MASK_SIDE = 256  # pixels of a mask that is written down
_MISSING = "needs rembg: pip install 'uniart_jax[photo]'"
_LEAST, _MOST = 0.01, 0.98  # share of the picture that an object can be


def cut_out(
    rgba: np.ndarray,
    background: Background = "auto",
    name: str = "image",
    network: Callable[[], FindMask | None] = lambda: None,
) -> tuple[np.ndarray, Way]:
    """The image with an alpha channel that says what is the object, and how that was found.

    Args:
      rgba: [H, W, 4] uint8 straight alpha.
      background: "auto": the first way that can; where none can, the whole image counts and a
        warning says so. "keep": nothing is cut away. "rembg": by rembg, whatever the picture is.
      name: of the image, for messages.
      network: gives a checkpoint's mask network (``inference.masks``), or None; called where it is
        needed.

    Raises:
      ValueError: the image is transparent throughout, ``background`` is none of these, or rembg is
        asked for and not installed or finds nothing.
    """
    check_background(background, name)
    check_visible(rgba, name)
    if background == "rembg":
        mask = _by_rembg(rgba, name)
        if mask is None:
            raise ValueError(f"{name}: rembg found no object; cut it out, or use --background auto")
        found = with_alpha(rgba, mask)
        check_visible(found, name)
        return found, "rembg"
    if has_alpha(rgba):
        return rgba, "alpha"
    if background == "keep":
        return rgba, "none"
    if (cut := remove_plain_background(rgba)) is not None:
        find = network()
        mask = find(rgba) if find is not None else None
        if mask is None or _agree(cut[..., 3], mask):
            return cut, "plain"
        return with_alpha(rgba, mask), "network"
    if _installed("rembg", "onnxruntime"):
        try:
            mask = _by_rembg(rgba, name)
        except ValueError as error:  # as where its model cannot be downloaded
            warnings.warn(f"{error}; going on without it", stacklevel=2)
            mask = None
        if mask is not None:
            return with_alpha(rgba, mask), "rembg"
    if (find := network()) is not None and (mask := find(rgba)) is not None:
        return with_alpha(rgba, mask), "network"
    if _installed("cv2") and (mask := grabcut(rgba)) is not None:
        return with_alpha(rgba, mask), "grabcut"
    warnings.warn(
        f"{name}: no alpha channel and no plain background, so the whole image is taken as the "
        "object; cut the object out for a better result, or pip install 'uniart_jax[photo]'",
        stacklevel=2,
    )
    return rgba, "none"


def check_background(background: str, name: str) -> None:
    """
    Args:
      name: of the image, for messages.

    Raises:
      ValueError: no way to cut an object out is called ``background``, or it is "rembg", which is
        not installed.
    """
    if background not in get_args(Background):
        ways = ", ".join(get_args(Background))
        raise ValueError(f"{name}: background '{background}' is unknown; choose one of {ways}")
    if background == "rembg" and not _installed("rembg", "onnxruntime"):
        raise ValueError(f"{name}: --background rembg {_MISSING}")


def _agree(plain: np.ndarray, mask: np.ndarray) -> bool:
    """Whether what a plain background leaves [H, W] uint8 is about what the mask network finds:
    shadows are left, and parts of an object that have the background's colour are not."""
    one, other = plain > 127, mask > 127
    return bool((one & other).sum() >= AGREED * (one | other).sum())


def with_alpha(rgba: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """[H, W, 4] with the smaller of its alpha and ``mask`` [H, W] uint8."""
    return np.dstack([rgba[..., :3], np.minimum(rgba[..., 3], mask)])


def run_lengths(rgba: np.ndarray) -> dict[str, Any]:
    """What of an image [H, W, 4] uint8 counts as object, as COCO writes masks: ``size`` [h, w], at
    most ``MASK_SIDE`` pixels a side, and ``counts``, the lengths of background and object in turn,
    column by column, background first."""
    height, width = rgba.shape[:2]
    factor = min(1.0, MASK_SIDE / max(height, width))
    size = max(round(width * factor), 1), max(round(height * factor), 1)
    alpha = Image.fromarray(np.ascontiguousarray(rgba[..., 3]))
    mask = np.asarray(alpha.resize(size, Image.Resampling.BOX)) > 127
    line = np.concatenate([[False], mask.ravel("F")])
    changes = np.flatnonzero(line[1:] != line[:-1])
    counts = np.diff(np.concatenate([[0], changes, [mask.size]]))
    return {"size": list(mask.shape), "counts": counts.tolist()}


def grabcut(rgba: np.ndarray) -> np.ndarray | None:
    """[H, W] uint8 mask of the object by GrabCut; None if hardly anything or nearly all is left.

    A frame along the border is background, a spot in the middle is object, and what lies between
    is decided by colour. What does not hang together with the middle is dropped, holes are kept.
    """
    import cv2

    height, width = rgba.shape[:2]
    factor = min(1.0, GRABCUT_SIDE / max(height, width))
    size = (max(round(width * factor), 8), max(round(height * factor), 8))
    small = np.asarray(Image.fromarray(rgba[..., :3]).resize(size, Image.Resampling.BOX))
    h, w = small.shape[:2]
    labels = seeds(h, w, cv2)
    cv2.setRNGSeed(0)  # its k-means draws from there: same picture, same mask
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(
        np.ascontiguousarray(small[..., ::-1]), labels, None, *models, GRABCUT_ROUNDS,
        cv2.GC_INIT_WITH_MASK,
    )  # fmt: skip
    mask = _middle((labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD))
    if not _LEAST < mask.mean() < _MOST:
        return None
    return np.asarray(
        Image.fromarray(mask.astype(np.uint8) * 255).resize(
            (width, height), Image.Resampling.BILINEAR
        )
    )


def seeds(height: int, width: int, cv2: Any) -> np.ndarray:
    """[H, W] uint8 of OpenCV's labels, before anything is known of the colours."""
    labels = np.full((height, width), cv2.GC_BGD, np.uint8)

    def inner(share: float) -> tuple[slice, slice]:
        y, x = max(round(height * share), 1), max(round(width * share), 1)
        return slice(y, height - y), slice(x, width - x)

    labels[inner(0.03)] = cv2.GC_PR_BGD
    labels[inner(0.1)] = cv2.GC_PR_FGD
    labels[inner(0.45)] = cv2.GC_FGD
    return labels


def _middle(mask: np.ndarray) -> np.ndarray:
    """The region of [H, W] that holds most of the middle."""
    regions = np.zeros(mask.shape, np.int32)
    scipy.ndimage.label(mask, output=regions)
    h, w = mask.shape
    inside = regions[h // 3 : h - h // 3, w // 3 : w - w // 3]
    counts = np.bincount(inside[inside > 0]) if inside.any() else np.zeros(0, int)
    return regions == counts.argmax() if len(counts) else np.zeros_like(mask)


def _by_rembg(rgba: np.ndarray, name: str) -> np.ndarray | None:
    """[H, W] uint8 mask by rembg; None if hardly anything or all is left.

    Raises:
      ValueError: rembg fails.
    """
    try:
        from rembg import remove

        picture = Image.fromarray(np.ascontiguousarray(rgba[..., :3]))
        found: Any = remove(picture, session=_rembg_session(), only_mask=True)
        mask = np.asarray(found.convert("L"))
    except (Exception, SystemExit) as error:  # it exits where its runtime is broken
        why = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise ValueError(f"{name}: rembg failed ({why})") from error
    return mask if _LEAST < (mask > 127).mean() < _MOST else None


@functools.cache  # loading takes seconds
def _rembg_session() -> Any:
    from rembg import new_session

    return new_session(REMBG_MODEL)


def _installed(*modules: str) -> bool:
    return all(importlib.util.find_spec(module) is not None for module in modules)

"""From an image file to what a network sees, the same for training, sampling and evaluation.

    file -> RGBA (orientation, palettes, CMYK, 16 bit) -> background.cut_out -> square crop ->
    [size, size, 3] on black

The crop is TRELLIS's (bounding box of the foreground, enlarged, resampled, multiplied by alpha);
the enlargement is ``MARGIN``.
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import scipy.ndimage
from PIL import Image, ImageOps, UnidentifiedImageError

from uniart_jax.objects.image_formats import image_formats

MARGIN = 1.1
PICTURE_SIDE = 256  # pixels, of renderings that stand for a user's picture; networks see fewer
MAX_PIXELS = 100_000_000
MIN_SIDE = 8
MAX_CANVAS = 8  # a crop of more than this many times its result's side is shrunk first
_PLAIN_SPREAD = 12  # 8-bit steps: how far the border may stray from its median to count as plain
_PLAIN_SHARE = 0.9


def read_image(path: str | Path) -> np.ndarray:
    """Read an image file of a common format (``objects.image_formats``).

    Returns:
      [H, W, 4] uint8 straight-alpha sRGB, upright; alpha is 255 everywhere if the file has none.

    Raises:
      FileNotFoundError: there is no such file.
      ValueError: empty, not an image, truncated, more than 100 megapixels, a side below 8 pixels or
        texts beside the picture that fill the memory; one line that names the file.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"image '{path}': no such file")
    if not path.is_file():
        raise ValueError(f"image '{path}': not a file; give the path of an image")
    if path.stat().st_size == 0:
        raise ValueError(f"image '{path}': the file is empty")
    try:
        return _decoded(path)
    except UnidentifiedImageError:
        why = "not an image that can be read (PNG, JPEG, WebP, ...)"
    except Image.DecompressionBombError:
        why = f"too many pixels; scale it below {MAX_PIXELS // 10**6} megapixels"
    except ValueError as error:  # ours, and Pillow's of texts that inflate without end
        why = " ".join(str(error).split())
    except (OSError, SyntaxError, EOFError, MemoryError) as error:
        why = f"truncated or damaged ({error})"
    raise ValueError(f"image '{path}': {why}")


def _decoded(path: Path) -> np.ndarray:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        with Image.open(path, formats=image_formats()) as image:
            width, height = image.size
            if width * height > MAX_PIXELS:
                raise ValueError(
                    f"{width * height / 1e6:.0f} megapixels; scale it below {MAX_PIXELS // 10**6}"
                )
            if min(width, height) < MIN_SIDE:
                raise ValueError(
                    f"{width}x{height} pixels is too small; {MIN_SIDE} a side at least"
                )
            image.load()
            return _to_rgba(ImageOps.exif_transpose(image))


def _to_rgba(image: Image.Image) -> np.ndarray:
    if image.mode in (
        "I;16",
        "I;16B",
        "I;16L",
        "I",
        "F",
    ):  # 16 bit and float gray: scale to 8 bit, do not clip
        values = np.asarray(image, dtype=np.float64)
        peak = values.max() if image.mode == "F" and values.max() <= 1 else 65535.0
        gray = np.clip(values / max(peak, 1e-9) * 255, 0, 255).astype(np.uint8)
        image = Image.fromarray(gray)
    return np.asarray(image.convert("RGBA"))


def has_alpha(rgba: np.ndarray) -> bool:
    """Whether the image already says what is foreground."""
    return bool((rgba[..., 3] < 250).mean() > 0.001)


def check_visible(rgba: np.ndarray, name: str = "image") -> None:
    """Raise ValueError if the image is transparent throughout."""
    if (rgba[..., 3] > 127).mean() < 1e-4:
        raise ValueError(f"{name}: it is transparent throughout; nothing to reconstruct")


def remove_plain_background(rgba: np.ndarray) -> np.ndarray | None:
    """Cut away a background of one colour, seen from the border inwards.

    Returns:
      [H, W, 4] uint8 with alpha 0 on the background, or None if the border is not plain or nothing
      would be left.
    """
    rgb = rgba[..., :3].astype(np.int16)
    border = np.concatenate([rgb[0], rgb[-1], rgb[:, 0], rgb[:, -1]])
    color = np.median(border, axis=0)
    if (np.abs(border - color).max(-1) <= _PLAIN_SPREAD).mean() < _PLAIN_SHARE:
        return None
    similar = np.abs(rgb - color).max(-1) <= 1.5 * _PLAIN_SPREAD
    regions = np.zeros(similar.shape, np.int32)
    scipy.ndimage.label(similar, output=regions)
    at_border = np.unique(np.concatenate([regions[0], regions[-1], regions[:, 0], regions[:, -1]]))
    background = np.isin(regions, at_border[at_border > 0])
    if not 0.01 < (~background).mean() < 0.995:
        return None
    out = rgba.copy()
    out[..., 3] = np.where(background, 0, out[..., 3])
    return out


def crop_window(alpha: np.ndarray) -> tuple[float, float, float]:
    """Centre x, centre y and half side, in pixels, of the square around the foreground of alpha [H,
    W]: ``MARGIN`` times its longer side."""
    top, bottom, left, right = _extent(alpha)
    half = max(bottom - top, right - left) / 2 * MARGIN
    return (left + right) / 2, (top + bottom) / 2, half


def _extent(alpha: np.ndarray) -> tuple[int, int, int, int]:
    """First row, row after the last, first column, column after the last of what is more than half
    opaque; all if nothing is."""
    rows = np.flatnonzero((alpha > 127).any(1))
    columns = np.flatnonzero((alpha > 127).any(0))
    if len(rows) == 0:
        return 0, alpha.shape[0], 0, alpha.shape[1]
    return int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1


def crop(rgba: np.ndarray, size: int, margin: float = MARGIN, background: int = 0) -> np.ndarray:
    """Square crop around the foreground, ``margin`` times its longer side, resampled.

    Args:
      rgba: [H, W, 4] uint8 straight alpha.
      size: side of the result, pixels. background: gray level behind the object; networks see it
        on black (colour times alpha, as TRELLIS).

    Returns:
      [size, size, 3] uint8 sRGB.
    """
    top, bottom, left, right = _extent(rgba[..., 3])
    half = max(bottom - top, right - left) / 2 * margin
    object_only = Image.fromarray(np.ascontiguousarray(rgba[top:bottom, left:right]))
    behind = Image.new("RGB", object_only.size, (background,) * 3)
    image = Image.composite(object_only.convert("RGB"), behind, object_only.getchannel("A"))
    # a long or huge image is shrunk before it is padded to a square
    factor = max(1, int(2 * half / (MAX_CANVAS * size)))
    if factor > 1:
        image, half = image.reduce(factor), half / factor
    cy, cx = image.height / 2, image.width / 2
    pad = int(np.ceil(half)) + 1
    canvas = ImageOps.expand(image, border=pad, fill=(background,) * 3)
    box = (cx - half + pad, cy - half + pad, cx + half + pad, cy + half + pad)
    resampled = canvas.resize((size, size), Image.Resampling.LANCZOS, box=box, reducing_gap=3.0)
    return np.asarray(resampled)


def crop_mask(rgba: np.ndarray, size: int, margin: float = MARGIN) -> np.ndarray:
    """[size, size] uint8 opacity in ``crop``'s square."""
    white = np.dstack([np.full_like(rgba[..., :3], 255), rgba[..., 3]])
    return crop(white, size, margin)[..., 0]

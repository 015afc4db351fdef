"""Pictures of a folder of the user's (``DataConfig.backgrounds``) as backgrounds to train before:
photographs of rooms, say. What is in them is taken for background, so none should show an object
of the kind that is to be found, alone and near. NumPy and Pillow alone."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
from PIL import Image, ImageFilter

from uniart_jax.data.images import MIN_SIDE, read_image

SHARE = 0.6  # of the pictures to train on that are taken before them, where there are any
PART = (0.45, 1.0)  # the side of what is seen of one, over its shorter side
BLURRED = 0.2  # share of them that are out of focus
_ENDINGS = (".jpg", ".jpeg", ".png", ".webp")


@functools.lru_cache(maxsize=4)
def picture_paths(folder: str) -> tuple[Path, ...]:
    """The pictures of a folder (JPEG, PNG, WebP), in the order of their names; none for "".

    Raises:
      ValueError: the folder is missing or holds none.
    """
    if not folder:
        return ()
    seen = sorted(p for p in Path(folder).glob("[!.]*") if p.suffix.lower() in _ENDINGS)
    found = [path for path in seen if path.is_file()]
    if not found:
        raise ValueError(f"config: data.backgrounds '{folder}' holds no pictures (JPEG, PNG, WebP)")
    return tuple(found)


def picture_backdrop(rng: np.random.Generator, paths: tuple[Path, ...], size: int) -> np.ndarray:
    """[S, S, 3] float32 sRGB in [0, 1]: a square of one of the pictures, perhaps mirrored, in
    another light, out of focus. Files are read anew each time: pictures of 300 to 600 pixels take
    .01 s, large photographs longer.

    Raises:
      ValueError: as ``images.read_image``.
    """
    path = paths[int(rng.integers(len(paths)))]
    part, left, top = rng.uniform(*PART), rng.random(), rng.random()
    seen = _square(Image.fromarray(read_image(path)[..., :3]), part, left, top, size)
    if rng.random() < BLURRED:
        seen = seen.filter(ImageFilter.GaussianBlur(rng.uniform(0.5, 4)))
    picture = np.asarray(seen, np.float32) / 255
    if rng.random() < 0.5:
        picture = picture[:, ::-1]
    gain = np.exp(0.2 * rng.normal() + 0.05 * rng.normal(size=3)).astype(np.float32)
    return np.clip(picture ** np.float32(np.exp(0.15 * rng.normal())) * gain, 0, 1)


def _square(image: Image.Image, part: float, left: float, top: float, size: int) -> Image.Image:
    """A square of ``part`` of a picture's shorter side; left and top in [0, 1]."""
    side = max(part * min(image.size), MIN_SIDE)
    x, y = left * max(image.width - side, 0), top * max(image.height - side, 0)
    box = (x, y, min(x + side, image.width), min(y + side, image.height))
    return image.resize((size, size), Image.Resampling.BICUBIC, box)

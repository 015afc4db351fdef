"""Which image files of strangers are read: a list of formats that Pillow decodes itself.

Pillow knows forty formats. Some hand the file to another program (EPS: to Ghostscript, which runs
the PostScript in it), and those left out are ones that pictures and textures rarely come in.
"""

from __future__ import annotations

import contextlib
import functools
import threading
from collections.abc import Iterator

from PIL import EpsImagePlugin, Image

FORMATS = (
    "PNG", "JPEG", "MPO", "WEBP", "AVIF", "JPEG2000", "TIFF", "BMP", "DIB", "GIF", "PPM", "TGA", "ICO",  # noqa: E501
    "DDS",
)  # fmt: skip
_LOCK = threading.RLock()


@functools.cache
def image_formats() -> tuple[str, ...]:
    """Those of ``FORMATS`` that this Pillow has, for ``Image.open(..., formats=...)``."""
    Image.init()
    return tuple(name for name in FORMATS if name in Image.OPEN)


def check_format(image: Image.Image) -> None:
    """Raise ValueError if an image that is not decoded yet is of another format."""
    if image.format and image.format not in FORMATS:
        raise ValueError(f"images of format {image.format} are not read")


@contextlib.contextmanager
def without_ghostscript() -> Iterator[None]:
    """While a library opens images by itself: Pillow finds no Ghostscript. One thread at a time,
    for Pillow keeps its path in a global."""
    with _LOCK:
        before = EpsImagePlugin.gs_binary
        EpsImagePlugin.gs_binary = False
        try:
            yield
        finally:
            EpsImagePlugin.gs_binary = before

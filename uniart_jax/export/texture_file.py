"""A texture as small as it can be stored where JPEG may be: in a GLB and in a USDZ. What MuJoCo
reads stays PNG."""

from __future__ import annotations

import io

from PIL import Image

QUALITY = 90  # of 100, colours at full resolution
WORTH = 0.6  # of the PNG's size: plain colours are small anyway, and sharp


def smaller(png: bytes) -> bytes | None:
    """A PNG's picture as JPEG, if that is worth its loss; else None."""
    with Image.open(io.BytesIO(png), formats=["PNG"]) as image:
        if image.mode != "RGB":
            return None
        packed = io.BytesIO()
        image.save(packed, "JPEG", quality=QUALITY, subsampling=0, optimize=True)
    return packed.getvalue() if packed.tell() < WORTH * len(png) else None

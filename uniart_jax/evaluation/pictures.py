"""Prediction beside truth, shown and opened: why a number is what it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.visual.diagram import picture
from uniart_jax.visual.render import Camera, fit

TILE = 192
CAPTION = 16


def write_comparison(
    path: Path, image: np.ndarray, truth: ArticulatedObject, predicted: dict[str, ArticulatedObject]
) -> None:
    """A picture of columns (truth, then each prediction) and rows (shown, opened, opened by part),
    the input image at the left.

    Args:
      image: [S, S, 4] uint8 straight alpha.
    """
    camera = fit(truth, Camera(np.deg2rad(30), np.deg2rad(25), 35.0, 2.5), margin=1.5)
    columns = {"truth": truth, **predicted}
    sheet = Image.new("RGB", ((len(columns) + 1) * TILE, 3 * TILE + CAPTION), "white")
    draw = ImageDraw.Draw(sheet)
    alpha = image[..., 3:].astype(np.float32) / 255
    seen = (image[..., :3] * alpha + 255 * (1 - alpha)).astype(np.uint8)
    sheet.paste(Image.fromarray(seen).resize((TILE, TILE)), (0, CAPTION))
    draw.text((4, 2), "input", fill="black")
    for c, (name, obj) in enumerate(columns.items(), start=1):
        draw.text((c * TILE + 4, 2), f"{name}: {len(obj.parts)} parts", fill="black")
        for r, (q, colors) in enumerate(
            ((None, False), (obj.open(0.8), False), (obj.open(0.8), True))
        ):
            sheet.paste(picture(obj, camera, TILE, q, parts=colors), (c * TILE, CAPTION + r * TILE))
    path.parent.mkdir(parents=True, exist_ok=True)
    sheet.save(path)

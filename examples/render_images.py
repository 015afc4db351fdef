"""Render the example images: held-out procedural objects, seeds that no model was trained on.

Command: python examples/render_images.py
"""

from pathlib import Path

import numpy as np
from PIL import Image

from uniart_jax.procedural import HELD_OUT_SEED, generate
from uniart_jax.render import Camera, fit, render

FOLDER = Path(__file__).parent / "images"
EXAMPLES = {  # file stem: family, seed offset, azimuth and elevation in degrees
    "cabinet": ("storage_furniture", 500, 32, 22),
    "drawers": ("storage_furniture", 503, -28, 18),
    "table": ("table", 501, 35, 25),
    "refrigerator": ("refrigerator", 502, 30, 15),
    "oven": ("oven", 504, -30, 20),
    "washer": ("washer", 505, 28, 20),
    "microwave": ("microwave", 506, -25, 22),
}


def main() -> None:
    FOLDER.mkdir(exist_ok=True)
    for stem, (family, offset, azimuth, elevation) in EXAMPLES.items():
        obj = generate(family, HELD_OUT_SEED + offset)
        camera = fit(obj, Camera(np.deg2rad(azimuth), np.deg2rad(elevation), 35.0, 2.5))
        pixels = np.round(render(obj, camera, size=384, samples=9) * 255).astype(np.uint8)
        Image.fromarray(pixels).save(FOLDER / f"{stem}.png", optimize=True)


if __name__ == "__main__":
    main()

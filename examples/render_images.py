"""Render the example images: held-out procedural objects, seeds that no model was trained on.

Command: python examples/render_images.py

``photograph.jpg`` is one of them before a photographed wall and ground (brick and gravel, CC0, from
scikit-image), for docs/photograph.md: no plain background, shade, grain.
"""

from pathlib import Path

import numpy as np
import scipy.ndimage
import skimage.data
from PIL import Image

from uniart_jax.procedural import HELD_OUT_SEED, generate
from uniart_jax.visual.render import Camera, fit, render

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

PHOTOGRAPH = ("washer", 508, 26, 18)


def photograph(shown: np.ndarray) -> np.ndarray:
    """[S, S, 3] uint8: an object [S, S, 4] float straight alpha stands on gravel before a brick
    wall, lit from the left."""
    side = len(shown)
    whole = round(1.25 * side)
    textures = (skimage.data.brick(), skimage.data.gravel())
    wall, ground = (np.asarray(Image.fromarray(t).resize((whole, whole))) / 255 for t in textures)
    wall = np.rot90(wall)
    room = wall[..., None] * (0.95, 0.82, 0.7)
    horizon = round(0.68 * whole)
    room[horizon:] = ground[: whole - horizon, :, None] * (0.62, 0.62, 0.66)
    room *= np.linspace(1.1, 0.7, whole)[None, :, None]
    picture = np.zeros((whole, whole, 4))
    edge = (whole - side) // 2
    picture[edge : edge + side, edge : edge + side] = shown
    alpha = picture[..., 3:]
    shadow = scipy.ndimage.gaussian_filter(np.roll(alpha[..., 0], (6, 14), (0, 1)), 9)
    room *= 1 - 0.5 * shadow[..., None]
    mixed = picture[..., :3] * alpha + room * (1 - alpha)
    grain = np.random.default_rng(0).normal(0, 0.012, mixed.shape)
    return np.round(np.clip(mixed + grain, 0, 1) * 255).astype(np.uint8)


def main() -> None:
    FOLDER.mkdir(exist_ok=True)
    for stem, example in EXAMPLES.items():
        pixels = np.round(shown(*example) * 255).astype(np.uint8)
        Image.fromarray(pixels).save(FOLDER / f"{stem}.png", optimize=True)
    picture = Image.fromarray(photograph(shown(*PHOTOGRAPH)))
    picture.save(FOLDER.parent / "photograph.jpg", quality=90, optimize=True)


def shown(family: str, offset: int, azimuth: float, elevation: float) -> np.ndarray:
    """[S, S, 4] of a held-out object."""
    obj = generate(family, HELD_OUT_SEED + offset)
    camera = fit(obj, Camera(np.deg2rad(azimuth), np.deg2rad(elevation), 35.0, 2.5))
    return render(obj, camera, size=384, samples=9)


if __name__ == "__main__":
    main()

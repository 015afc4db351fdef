"""Views out of panoramas, as pictures to stand behind objects (``data.backgrounds``).

    python tools/panorama_views.py FOLDER --out FOLDER [--views 48] [--size 384]

FOLDER holds equirectangular panoramas in Radiance HDR, as Poly Haven gives away (CC0). Each view
looks ahead or a little down, at a random exposure. Needs OpenCV (the extra ``photo``).
"""

from __future__ import annotations

import argparse
import zlib
from pathlib import Path

import numpy as np
from PIL import Image, ImageFilter

FIELDS = (55.0, 105.0)  # degrees, of a view's width
PITCH = (-35.0, 12.0)  # degrees; down is negative, where things stand
MIDDLE = (0.12, 0.35)  # linear light that the median of a view is brought to


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("panoramas", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--views", type=int, default=48, help="of each panorama")
    parser.add_argument("--size", type=int, default=384, help="pixels a side")
    given = parser.parse_args()
    paths = sorted(given.panoramas.glob("*.hdr"))
    if not paths:
        parser.error(f"no .hdr files in {given.panoramas}")
    given.out.mkdir(parents=True, exist_ok=True)
    for path in paths:
        try:
            light = read_hdr(path)
        except ValueError as error:
            parser.error(str(error))
        rng = np.random.default_rng(zlib.crc32(path.stem.encode()))
        for k in range(given.views):
            picture = view(rng, light, given.size)
            Image.fromarray(picture).save(given.out / f"{path.stem}_{k:03d}.jpg", quality=92)
        print(path.stem, flush=True)


def read_hdr(path: Path) -> np.ndarray:
    """[H, 2H, 3] float32 linear RGB."""
    import cv2

    light = cv2.imread(str(path), cv2.IMREAD_ANYDEPTH | cv2.IMREAD_COLOR)
    if light is None or light.shape[1] != 2 * light.shape[0]:
        raise ValueError(f"{path}: not a panorama in Radiance HDR, twice as wide as high")
    return np.ascontiguousarray(light[..., ::-1], np.float32)


def view(rng: np.random.Generator, light: np.ndarray, size: int) -> np.ndarray:
    """[S, S, 3] uint8 sRGB: what a camera in a panorama's middle sees."""
    import cv2

    yaw, pitch = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(*PITCH))
    reach = np.tan(np.radians(rng.uniform(*FIELDS)) / 2)
    across, down = np.meshgrid(*2 * [np.linspace(-reach, reach, size)])
    forward = np.cos(pitch) + down * np.sin(pitch)
    up = np.sin(pitch) - down * np.cos(pitch)
    longitude = yaw + np.arctan2(across, forward)
    latitude = np.arctan2(up, np.hypot(across, forward))
    high, wide = light.shape[:2]
    x = (longitude / (2 * np.pi) % 1 * wide).astype(np.float32)  # half a pixel aside: of no weight
    y = ((0.5 - latitude / np.pi) * high - 0.5).astype(np.float32)
    around = np.concatenate([light, light[:, :2]], 1)  # so that the seam is smooth
    seen = cv2.remap(around, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    seen = seen * rng.uniform(*MIDDLE) / max(float(np.median(seen)), 1e-6)
    seen = np.where(seen < 0.6, seen, 1 - 0.4 * np.exp(-(seen - 0.6) / 0.4))  # highlights roll off
    encoded = np.clip(seen, 0, 1) ** (1 / 2.2)
    image = Image.fromarray(np.round(255 * encoded).astype(np.uint8))
    return np.asarray(image.filter(ImageFilter.UnsharpMask(1.5, int(rng.integers(0, 150)), 0)))


if __name__ == "__main__":
    main()

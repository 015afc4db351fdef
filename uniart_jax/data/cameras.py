"""Camera codes (``voxels.camera_code``) of rendered views and of their mirror images."""

from __future__ import annotations

import numpy as np

from uniart_jax.data.images import crop_window


def camera_codes(cameras: np.ndarray, images: np.ndarray) -> np.ndarray:
    """[N, 7] float32 codes of rendered views once they are cropped (``images.crop``).

    Args:
      cameras: [N, 4] azimuth, elevation (radians), field of view (degrees), distance, as in
        records.
      images: [N, S, S, 4] uint8 as rendered: their alpha says where the crop lies.
    """
    azimuth, elevation, fov, distance = np.asarray(cameras, np.float64).T
    size = images.shape[1]
    windows = np.array([crop_window(image[..., 3]) for image in images])  # pixels
    center, half = 2 * windows[:, :2] / size - 1, 2 * windows[:, 2] / size
    focal = 1 / (distance * np.tan(np.deg2rad(fov) / 2) * half)
    shift = center / half[:, None]
    columns = (np.sin(azimuth), np.cos(azimuth), elevation, focal, 1 / distance, *shift.T)
    return np.stack(columns, -1).astype(np.float32)


def mirror_camera_codes(codes: np.ndarray) -> np.ndarray:
    """Codes [..., 7] of the flipped pictures: the mirrored camera."""
    return codes * np.array([-1, 1, 1, 1, 1, -1, 1], np.float32)

"""Where a cropped picture was taken from, as seven smooth numbers that a network can regress: the *camera code*.

    (sin azimuth, cos azimuth, elevation, focal, perspective, x, y)

A point p with (right, down, forward) coordinates (a, b, c) about the object's origin is seen at

    u = focal (a, b) / (1 + perspective c) - (x, y)        in [-1, 1]^2 across the crop, x right, y down.

``project`` is this equation, ``nn.lifting.project`` the same for networks.
"""

from __future__ import annotations

import numpy as np

from uniart_jax.data.images import crop_window


def camera_codes(cameras: np.ndarray, images: np.ndarray) -> np.ndarray:
    """[N, 7] float32 codes of rendered views once they are cropped (``images.crop``).

    Args:
      cameras: [N, 4] azimuth, elevation (radians), field of view (degrees), distance, as in records.
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


LEAST_PERSPECTIVE = 1e-3  # less is taken as this, a camera 1,000 units away


def project(code: np.ndarray, points: np.ndarray) -> np.ndarray:
    """[P, 2] in [-1, 1]^2 across the crop, x right, y down, where a camera code [7] sees points [P, 3]."""
    right, down, forward = _axes(code)
    scale = code[3] / np.maximum(1 + max(code[4], LEAST_PERSPECTIVE) * (points @ forward), 0.1)
    return np.stack([points @ right, points @ down], -1) * scale[:, None] - code[5:]


def camera_position(code: np.ndarray) -> np.ndarray:
    """[3] where the camera of a code [7] stands, object units."""
    return -_axes(code)[2] / max(code[4], LEAST_PERSPECTIVE)


def _axes(code: np.ndarray) -> np.ndarray:
    """[3, 3] rows: right, down, forward in the object frame."""
    norm = max(np.hypot(code[0], code[1]), 1e-6)
    sa, ca, se, ce = code[0] / norm, code[1] / norm, np.sin(code[2]), np.cos(code[2])
    return np.array([[sa, -ca, 0], [-se * ca, -se * sa, -ce], [ca * ce, sa * ce, -se]])

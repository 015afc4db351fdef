"""Where a cropped picture was taken from, as seven smooth numbers that a network can regress: the
*camera code*.

    (sin azimuth, cos azimuth, elevation, focal, perspective, x, y)

A point p with (right, down, forward) coordinates (a, b, c) about the object's origin is seen at

    u = focal (a, b) / (1 + perspective c) - (x, y)

in [-1, 1]^2 across the crop, x right, y down.
``project`` is this equation, ``nn.lifting.project`` the same for networks; ``data.cameras`` makes
codes of rendered views.
"""

from __future__ import annotations

import numpy as np

CAMERA_CODE_SIZE = 7
# of cropped pictures as ``visual.render.sample_camera`` takes them, about: what networks add their
# estimate to
MEAN_CAMERA_CODE = (0.0, 0.87, 0.4, 1.6, 0.33, 0.0, 0.0)
LEAST_PERSPECTIVE = 1e-3  # less is taken as this, a camera 1,000 units away


def project(code: np.ndarray, points: np.ndarray) -> np.ndarray:
    """[P, 2] in [-1, 1]^2 across the crop, x right, y down, where a camera code [7] sees points
    [P, 3]."""
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

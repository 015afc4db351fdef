"""A metric on the UniArt latent: the size of an error in the boxes, joints, colours and distances
that are read off the latent.

Boxes and joints, on which everything that moves depends, share a latent's variance with colour and
surface detail. The plain squared error gives each of them whatever share it happens to have. Here
the error is measured on linear maps of the latent to these attributes, fitted by least squares on
training records:

    |e|^2_M = e^T M e,     M = (1 - share) / C  +  share sum_g lambda_g W_g^T W_g / var_g

with W_g the linear map to attribute group g and var_g the group's variance. The minimiser is still
the conditional mean, so the flow samples the same distribution. Not in the paper.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

WEIGHTS = {"own_box": 0.3, "joint_code": 0.2, "parent_box": 0.1, "color": 0.15, "sdf": 0.25}


def fit_metric(
    latents: np.ndarray, attributes: Mapping[str, np.ndarray], share: float
) -> np.ndarray:
    """M [C, C] for errors in units of the latents' deviations, from latents [n, C] and attribute
    groups [n, D_g] of ``WEIGHTS``."""
    scaled = (latents - latents.mean(0)) / np.maximum(latents.std(0), 1e-6)
    channels = latents.shape[1]
    metric = (1 - share) * np.eye(channels) / channels
    for name, weight in WEIGHTS.items():
        values = attributes[name] - attributes[name].mean(0)
        linear_map, *_ = np.linalg.lstsq(scaled, values, rcond=None)  # [C, D]
        variance = max(float(values.var(0).sum()), 1e-12)
        metric += share * weight * linear_map @ linear_map.T / variance
    return metric.astype(np.float32)

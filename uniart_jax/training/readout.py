"""How much an error of the UniArt latent matters: its size once the latent is read out as boxes,
joints, colours and distances.

Boxes and joints, on which everything that moves depends, share a latent's variance with colour and
surface detail, and the plain square error gives each whatever share it happens to have. Here the
error is measured on linear readouts of the latent instead, fitted by least squares on training
records:

    |e|^2_M = e^T M e,     M = (1 - share) / C  +  share sum_g lambda_g W_g^T W_g / var_g

with W_g the readout of attribute group g and var_g the group's variance. What minimises it is still
the conditional mean, so the flow stays what it is. Not in the paper.
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
        readout, *_ = np.linalg.lstsq(scaled, values, rcond=None)  # [C, D]
        variance = max(float(values.var(0).sum()), 1e-12)
        metric += share * weight * readout @ readout.T / variance
    return metric.astype(np.float32)

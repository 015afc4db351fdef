"""From a feature map to points in the object's frame: each point reads the map where a camera sees it.

What pixel-aligned networks do (PIFu, pixelNeRF; MVSNet before them), with the camera as one of the network's own estimates.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp


def project(code: jax.Array, points: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Where camera codes [B, 7] (``data.cameras``) see points [P, 3]: [B, P, 2] in [-1, 1]^2 across the picture, and depth [B, P] about the origin's."""
    sine, cosine, elevation, focal, perspective, x, y = (code[:, i, None] for i in range(7))
    norm = jnp.sqrt(jnp.maximum(sine**2 + cosine**2, 1e-6))
    sa, ca = sine / norm, cosine / norm
    se, ce = jnp.sin(elevation), jnp.cos(elevation)
    px, py, pz = points.T
    right = sa * px - ca * py
    ahead = ca * px + sa * py
    forward = ce * ahead - se * pz
    down = -se * ahead - ce * pz
    scale = focal / jnp.maximum(1 + perspective * forward, 0.1)
    return jnp.stack([scale * right - x, scale * down - y], -1), forward


def sample_map(features: jax.Array, places: jax.Array) -> jax.Array:
    """Bilinear samples [B, P, C] of a map [B, S, S, C] (row, column) at places [B, P, 2] (x, y) in [-1, 1]^2; the border's value beyond it.

    As a product with interpolation weights [P, S^2]: the gradient of a gather is a scatter, which is slow on CPU and TPU.
    """
    side = features.shape[1]
    index = jnp.clip((places + 1) * (side / 2) - 0.5, 0, side - 1)
    weights = jnp.maximum(1 - jnp.abs(index[..., None] - jnp.arange(side)), 0)  # [B, P, 2, S]
    rows = weights[:, :, 1, :, None] * weights[:, :, 0, None, :]
    flat = features.reshape(features.shape[0], side * side, -1)
    return jnp.einsum(
        "bpq,bqc->bpc", rows.reshape(*rows.shape[:2], -1).astype(features.dtype), flat
    )

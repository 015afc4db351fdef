"""TRELLIS's own decoder of a latent: 3D Gaussians a voxel. Upstream:
``models/structured_latent_vae/decoder_gs.py``, ``representations/gaussian``.

Of a voxel's 14 numbers a Gaussian (o, dc, s, r, a: position 3, colour 3, scale 3, rotation 4,
opacity 1), in this order and each for all G Gaussians:

    position = (coords + 1/2) / R + voxel_size / (2 R) tanh(lr o + P) - 1/2          P spreads the G Gaussians of a voxel    (1)
    scale    = sqrt(f(lr s + f^-1(scaling_bias))^2 + kernel_size_3d^2)               f softplus or exp                       (2)
    rotation = (lr r + (1, 0, 0, 0)) / |.|                                           quaternion, real part first             (3)
    opacity  = sigmoid(lr a + logit(opacity_bias))                                                                           (4)
"""  # noqa: E501

from __future__ import annotations

import dataclasses
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx

from uniart_jax.config import GaussianConfig, ModelConfig
from uniart_jax.models.uniart_vae import Trunk
from uniart_jax.models.voxel_batch import valid_tokens
from uniart_jax.voxels.typed_batches import VoxelBatch

LAYOUT = {"xyz": (3,), "features_dc": (1, 3), "scaling": (3,), "rotation": (4,), "opacity": (1,)}
VALUES = sum(math.prod(shape) for shape in LAYOUT.values())  # 14 a Gaussian


class GaussianDecoder(Trunk):
    """Latent -> raw values of every voxel's Gaussians; sizes are ``UniArtVAEConfig``'s. A subclass,
    so that names stay TRELLIS's."""

    def __init__(self, config: ModelConfig, rngs: nnx.Rngs):
        # TRELLIS has no path past the trunk, whatever the VAE beside it has
        plain = dataclasses.replace(config.uniart_vae, linear_path=False)
        config = dataclasses.replace(config, uniart_vae=plain)
        outputs = config.gaussians.num_gaussians * VALUES
        super().__init__(plain.latent_channels, outputs, config, rngs)

    def __call__(self, latent: jax.Array, batch: VoxelBatch) -> jax.Array:
        """Latent [B, V, C] -> raw [B, V, G * 14], padding zero; ``batch``: coords, counts, plans
        (window_0, window_1)."""
        valid = valid_tokens(batch.counts, latent.shape[1])
        latent = jnp.where(valid, latent, 0)
        h = super().__call__(latent, batch.coords, batch.plans, batch.counts)
        return jnp.where(valid, h.astype(jnp.float32), 0)


def offset_perturbation(config: GaussianConfig) -> np.ndarray:
    """[G, 3] float32 P of equation (1): where tanh puts the G Gaussians on a Hammersley set within
    the voxel."""
    n = config.num_gaussians
    if not config.perturb_offset:
        return np.zeros((n, 3), np.float32)
    columns = (
        [i / n for i in range(n)],
        *([_mirrored(i, base) for i in range(n)] for base in (2, 3)),
    )
    points = np.stack(columns, -1).astype(np.float32)
    return np.arctanh((points * 2 - 1) / np.float32(config.voxel_size))


def gaussian_parameters(
    raw: Any, coords: Any, config: GaussianConfig, resolution: int
) -> dict[str, jax.Array]:
    """Raw values [..., V, G * 14] on voxels [..., V, 3] -> what TRELLIS stores of its Gaussians, G
    a voxel side by side.

    Returns:
      xyz [..., V G, 3] within [0, 1]; features_dc [..., V G, 1, 3], scaling [..., V G, 3], rotation
      [..., V G, 4], opacity [..., V G, 1], all before their activations (``activated``).
    """
    lead, n = raw.shape[:-1], config.num_gaussians
    values, start = {}, 0
    for name, shape in LAYOUT.items():
        stop = start + n * math.prod(shape)
        values[name] = raw[..., start:stop].reshape(*lead, n, *shape) * getattr(
            config, f"lr_{name}"
        )
        start = stop
    center = ((jnp.asarray(coords).astype(jnp.float32) + 0.5) / resolution)[..., None, :]
    reach = 0.5 * config.voxel_size / resolution
    values["xyz"] = center + jnp.tanh(values["xyz"] + offset_perturbation(config)) * reach
    return {k: v.reshape(*lead[:-1], -1, *LAYOUT[k]) for k, v in values.items()}


def activated(parameters: dict[str, Any], config: GaussianConfig) -> dict[str, jax.Array]:
    """What is drawn: xyz in the object frame [-1/2, 1/2]^3, features_dc as it is, and equations
    (2), (3) and (4)."""
    bias = config.scaling_bias
    if config.scaling_activation == "softplus":
        scale = jax.nn.softplus(parameters["scaling"] + math.log(math.expm1(bias)))
    else:
        scale = jnp.exp(parameters["scaling"] + math.log(bias))
    rotation = parameters["rotation"] + jnp.array([1.0, 0.0, 0.0, 0.0])
    length = jnp.sqrt(jnp.maximum(jnp.square(rotation).sum(-1, keepdims=True), 1e-24))
    logit = math.log(config.opacity_bias / (1 - config.opacity_bias))
    return {
        "xyz": parameters["xyz"] - 0.5,
        "features_dc": parameters["features_dc"],
        "scaling": jnp.sqrt(jnp.square(scale) + config.kernel_size_3d**2),
        "rotation": rotation / length,
        "opacity": jax.nn.sigmoid(parameters["opacity"] + logit),
    }


def _mirrored(number: int, base: int) -> float:
    """The digits of a number mirrored at the point: van der Corput's sequence."""
    value, unit = 0.0, 1.0 / base
    while number:
        number, digit = divmod(number, base)
        value, unit = value + digit * unit, unit / base
    return value

"""Rectified flow: straight paths between data and noise, and their training loss.

    x_t = (1 - t) x_0 + (s + (1 - s) t) eps        (1)   t = 1 is noise; s = sigma_min
    v   = (1 - s) eps - x_0                        (2)   the velocity target
    x_0 = (1 - s) x_t - (s + (1 - s) t) v          (3)

The paper's main text and TRELLIS (``trainers/flow_matching``); the supplement's time runs the other
way, which is a matter of the network alone (``FlowConfig.direction``). s is 0 here, and 1e-5 for
TRELLIS's weights.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp


def interpolate(x0: jax.Array, noise: jax.Array, t: jax.Array, sigma_min: float = 0.0) -> jax.Array:
    """x_t of equation (1); t [B]."""
    t = _over(t, x0)
    return (1 - t) * x0 + (sigma_min + (1 - sigma_min) * t) * noise


def velocity_target(x0: jax.Array, noise: jax.Array, sigma_min: float = 0.0) -> jax.Array:
    """v of equation (2)."""
    return (1 - sigma_min) * noise - x0


def predicted_sample(x: jax.Array, v: jax.Array, t: jax.Array, sigma_min: float = 0.0) -> jax.Array:
    """x_0 of equation (3), from a velocity at x and t [B]."""
    return (1 - sigma_min) * x - (sigma_min + (1 - sigma_min) * _over(t, x)) * v


def flow_loss(
    velocity: jax.Array,
    x0: jax.Array,
    noise: jax.Array,
    weights: jax.Array | None = None,
    sigma_min: float = 0.0,
    metric: jax.Array | None = None,
) -> jax.Array:
    """Weighted mean square error of the velocity per object [B]; the mean over objects is the
    caller's.

    Args:
      velocity, x0, noise: [B, ..., C]. weights: [B, ...] of voxels, 0 = padding; None = all alike.
        An object without any counts as 0.
      metric: [C, C] positive definite M: an error e counts e^T M e; None = |e|^2 / C.
    """
    if weights is not None:  # garbage in padding must not reach the target
        valid = weights[..., None] > 0
        velocity, x0, noise = (jnp.where(valid, a, 0) for a in (velocity, x0, noise))
    miss = velocity - velocity_target(x0, noise, sigma_min)
    error = jnp.square(miss).mean(-1) if metric is None else ((miss @ metric) * miss).sum(-1)
    axes = tuple(range(1, error.ndim))
    if weights is None:
        return error.mean(axes)
    return (error * weights).sum(axes) / jnp.maximum(weights.sum(axes), 1e-6)


def sample_times(
    key: jax.Array,
    shape: tuple[int, ...],
    mean: float = 1.0,
    std: float = 1.0,
    noise_share: float = 0.0,
) -> jax.Array:
    """Training times in (0, 1): sigmoid of a normal, a ``noise_share`` of them uniform in (.9, 1)
    instead."""
    normal_key, share_key, uniform_key = jax.random.split(key, 3)
    t = jax.nn.sigmoid(mean + std * jax.random.normal(normal_key, shape))
    if noise_share:
        late = jax.random.uniform(uniform_key, shape, minval=0.9, maxval=1.0)
        t = jnp.where(jax.random.uniform(share_key, shape) < noise_share, late, t)
    return t


def _over(t: jax.Array, x: jax.Array) -> jax.Array:
    return t.reshape(t.shape + (1,) * (x.ndim - t.ndim))

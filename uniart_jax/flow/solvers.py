"""Fixed-step solvers of dx/dt = v(x, t) from noise (t = 1) to data (t = 0). They know nothing of guidance."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

Velocity = Callable[[jax.Array, jax.Array], jax.Array]  # (x [B, ...], t scalar) -> v


def time_steps(steps: int, rescale_t: float = 1.0) -> np.ndarray:
    """[steps + 1] times from 1 to 0, r t / (1 + (r - 1) t): r > 1 spends more steps near noise (TRELLIS).

    Raises:
      ValueError: fewer than one step.
    """
    if steps < 1:
        raise ValueError(f"sampling needs at least 1 step, not {steps}")
    t = np.linspace(1, 0, steps + 1)
    return rescale_t * t / (1 + (rescale_t - 1) * t)


def euler(velocity: Velocity, x: jax.Array, steps: int, rescale_t: float = 1.0) -> jax.Array:
    """x at t = 0 by ``steps`` Euler steps; first order, exact where the velocity is constant along paths."""

    def step(x, times):
        here, after = times
        return x - (here - after) * velocity(x, here), None

    return jax.lax.scan(step, x, _intervals(steps, rescale_t))[0]


def heun(velocity: Velocity, x: jax.Array, steps: int, rescale_t: float = 1.0) -> jax.Array:
    """x at t = 0 by ``steps`` Heun steps: second order, two velocities a step."""

    def step(x, times):
        here, after = times
        first = velocity(x, here)
        second = velocity(x - (here - after) * first, after)
        return x - (here - after) * (first + second) / 2, None

    return jax.lax.scan(step, x, _intervals(steps, rescale_t))[0]


def _intervals(steps: int, rescale_t: float) -> tuple[jax.Array, jax.Array]:
    t = jnp.asarray(time_steps(steps, rescale_t), jnp.float32)
    return t[:-1], t[1:]

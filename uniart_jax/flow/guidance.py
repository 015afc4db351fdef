"""Classifier-free guidance with an interval, as a wrapper of the velocity function: solver and guidance never meet.

v = v_c + w (v_c - v_u)        w = 0: none        (TRELLIS ``pipelines/samplers/classifier_free_guidance_mixin.py``)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from uniart_jax.flow.solvers import Velocity


def guide(
    velocity: Callable[[jax.Array, jax.Array, Any], jax.Array],
    condition: Any,
    negative: Any,
    weight: float,
    interval: tuple[float, float] = (0.0, 1.0),
) -> Velocity:
    """A velocity (x, t) -> v that is guided while ``interval[0] <= t <= interval[1]``, conditional elsewhere.

    Args:
      velocity: (x [B, ...], t [B], condition) -> v. Where guided it is called once with x and t doubled to [2 B, ...]: every item
        twice in a row, with its condition and with its negative.
      condition, negative: pytrees of arrays [B, ...] of equal shapes.
      weight: w.
    """

    def conditional(x: jax.Array, t: jax.Array) -> jax.Array:
        return velocity(x, jnp.full(x.shape[0], t, jnp.float32), condition)

    if weight == 0:
        return conditional

    def guided(x: jax.Array, t: jax.Array) -> jax.Array:
        both = jax.tree.map(_interleave, condition, negative)
        v = velocity(_interleave(x, x), jnp.full(2 * x.shape[0], t, jnp.float32), both)
        with_condition, without = v[::2], v[1::2]
        return with_condition + weight * (with_condition - without)

    def choose(x: jax.Array, t: jax.Array) -> jax.Array:
        inside = (t >= interval[0]) & (t <= interval[1])
        return jax.lax.cond(inside, guided, conditional, x, t)

    return choose


def _interleave(a: jax.Array, b: jax.Array) -> jax.Array:
    return jnp.stack([a, b], 1).reshape(-1, *a.shape[1:])

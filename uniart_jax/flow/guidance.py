"""Classifier-free guidance with an interval, as a wrapper of the velocity function: solver and
guidance never meet.

v = v_c + w (v_c - v_u)        w = 0: none        (TRELLIS ``pipelines/samplers/classifier_free_guidance_mixin.py``)
"""  # noqa: E501

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
    """A velocity (x, t) -> v that is guided while ``interval[0] <= t <= interval[1]``, conditional
    elsewhere; t a scalar, or [B] a time an item.

    Args:
      velocity: (x [B, ...], t [B], condition) -> v. Where guided it is called once with x and t
        doubled to [2 B, ...]: every item twice in a row, with its condition and with its negative.
      condition, negative: pytrees of arrays [B, ...] of equal shapes.
      weight: w.
    """

    def conditional(x: jax.Array, t: jax.Array) -> jax.Array:
        return velocity(x, _times(t, x.shape[0]), condition)

    if weight == 0:
        return conditional

    def inside(t: jax.Array) -> jax.Array:
        return (t >= interval[0]) & (t <= interval[1])

    def guided(x: jax.Array, t: jax.Array) -> jax.Array:
        both = jax.tree.map(_interleave, condition, negative)
        times = _times(t, x.shape[0])
        v = velocity(_interleave(x, x), jnp.repeat(times, 2), both)
        with_condition, without = v[::2], v[1::2]
        here = inside(times).reshape(-1, *[1] * (x.ndim - 1))
        return with_condition + jnp.where(here, weight * (with_condition - without), 0)

    if interval[0] <= 0 and interval[1] >= 1:
        return guided  # one network to compile, not two

    def choose(x: jax.Array, t: jax.Array) -> jax.Array:
        return jax.lax.cond(inside(t).any(), guided, conditional, x, t)

    return choose


def _times(t: jax.Array, items: int) -> jax.Array:
    return jnp.broadcast_to(jnp.asarray(t, jnp.float32), (items,))


def _interleave(a: jax.Array, b: jax.Array) -> jax.Array:
    return jnp.stack([a, b], 1).reshape(-1, *a.shape[1:])

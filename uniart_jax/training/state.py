"""What a training run carries from step to step, and the optimizer that changes it.

AdamW with global-norm clipping and linear warm-up, then constant (the paper, TRELLIS) or cosine to zero. Everything is one pytree,
so one sharding rule, one checkpoint and one donated buffer serve it all.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax

from uniart_jax.config import StageConfig
from uniart_jax.training.sharding import state_sharding

FROZEN = jax.tree_util.DictKey("pos_emb")  # a structure flow's position table: no gradient either
Params = Any  # nested dict of float32 arrays


class TrainState(NamedTuple):
    """A run between two steps.

    Attributes:
      step: int32 []; number of updates made.
      params: the trained network's nested dict, float32.
      opt_state: of the optax transformation.
      ema: exponential moving average of ``params``; what is exported.
    """

    step: jax.Array
    params: Params
    opt_state: optax.OptState
    ema: Params


def make_schedule(stage: StageConfig) -> optax.Schedule:
    """Learning rate by update number: linear from lr / warm-up (so that update 0 moves), then constant or cosine to zero."""
    rate = stage.learning_rate
    warmup = min(stage.warmup_steps, max(stage.steps - 1, 0))
    start = rate / max(warmup, 1)
    if stage.schedule == "cosine":
        return optax.warmup_cosine_decay_schedule(start, rate, warmup, max(stage.steps, warmup + 1))
    return optax.warmup_constant_schedule(start, rate, warmup)


def make_optimizer(stage: StageConfig) -> optax.GradientTransformation:
    """AdamW as ``stage`` says; gradients clipped by global norm (0 = not), decay only on kernels (two or more axes, no frozen table)."""
    b1, b2 = stage.betas
    adamw = optax.adamw(
        make_schedule(stage),
        b1=b1,
        b2=b2,
        weight_decay=stage.weight_decay,
        mask=lambda params: jax.tree_util.tree_map_with_path(
            lambda path, p: p.ndim >= 2 and path[-1] != FROZEN, params
        ),
    )
    if stage.gradient_clip > 0:
        return optax.chain(optax.clip_by_global_norm(stage.gradient_clip), adamw)
    return adamw


def create_state(
    network_init: Callable[[jax.Array], Params],
    optimizer: optax.GradientTransformation,
    key: jax.Array,
    mesh: jax.sharding.Mesh | None = None,
) -> TrainState:
    """A fresh state whose arrays are born where they will live; no device ever holds all of a sharded network.

    Args:
      network_init: key -> parameters.
      mesh: of ``make_mesh``; None puts everything on the default device.
    """

    def init(key: jax.Array) -> TrainState:
        params = network_init(key)
        # A copy, because the donated step would otherwise be given one buffer twice.
        ema = jax.tree.map(jnp.copy, params)
        return TrainState(jnp.zeros((), jnp.int32), params, optimizer.init(params), ema)

    if mesh is None:
        return jax.jit(init)(key)
    shardings = state_sharding(mesh, jax.eval_shape(init, key))
    return jax.jit(init, out_shardings=shardings)(key)


def begin_with(state: TrainState, params: Params) -> TrainState:
    """A fresh state with other parameters (a nested dict of host arrays of the same structure), placed as the state's own."""
    placed = jax.tree.map(lambda new, old: jax.device_put(new, old.sharding), params, state.params)
    return state._replace(params=placed, ema=jax.tree.map(jnp.copy, placed))

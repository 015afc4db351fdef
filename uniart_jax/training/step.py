"""One update of a training run, the only ``jit`` of a stage.

    g = grad loss(params, batch, fold_in(key, step));   params <- params + update(g);   ema <- d ema + (1 - d) params

with d = min(decay, (1 + step) / (10 + step)), so that the average does not start from the random initial weights. The key is a
function of the step, so a resumed run draws the same noise. Where loss or gradients are not finite the state stays as it was, and
the flag ``finite`` tells the loop.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import optax

from uniart_jax.training.state import Params, TrainState

Metrics = dict[str, jax.Array]
LossFn = Callable[[Params, Any, jax.Array], tuple[jax.Array, Metrics]]
TrainStep = Callable[[TrainState, Any, jax.Array], tuple[TrainState, Metrics]]


def make_train_step(
    loss_fn: LossFn,
    optimizer: optax.GradientTransformation,
    ema_decay: float,
) -> TrainStep:
    """Build ``step(state, batch, key) -> (state, metrics)``; ``state`` is donated, so use only the returned one.

    Args:
      loss_fn: (params, batch, key) -> (scalar loss, dict of scalar metrics).
      ema_decay: of the averaged parameters.

    The metrics are the loss function's, ``loss``, ``grad_norm`` (before clipping) and ``finite`` (1 or 0). ``key`` is the run's
    and the same at every step. The returned state keeps the shardings of the state first given.
    """

    def update(state: TrainState, batch: Any, key: jax.Array):
        key = jax.random.fold_in(key, state.step)

        def loss_of(params: Params):
            return loss_fn(params, batch, key)

        (loss, metrics), grads = jax.value_and_grad(loss_of, has_aux=True)(state.params)
        grad_norm = optax.tree.norm(grads)
        finite = jnp.isfinite(loss) & jnp.isfinite(grad_norm)
        updates, opt_state = optimizer.update(grads, state.opt_state, state.params)
        params = optax.apply_updates(state.params, updates)
        step = state.step + 1
        decay = jnp.minimum(ema_decay, (1.0 + step) / (10.0 + step))
        ema = optax.incremental_update(params, state.ema, 1.0 - decay)
        new = TrainState(step, params, opt_state, ema)
        new = jax.tree.map(lambda after, before: jnp.where(finite, after, before), new, state)
        return new, {**metrics, "loss": loss, "grad_norm": grad_norm, "finite": finite}

    compiled = None

    def train_step(state: TrainState, batch: Any, key: jax.Array) -> tuple[TrainState, Metrics]:
        nonlocal compiled
        if compiled is None:
            # Pinned, because the compiler may otherwise choose others for its outputs and compile the second step anew.
            shardings = jax.tree.map(lambda leaf: leaf.sharding, state)
            compiled = jax.jit(update, donate_argnums=0, out_shardings=(shardings, None))
        return compiled(state, batch, key)

    return train_step

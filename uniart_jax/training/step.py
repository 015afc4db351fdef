"""One update of a training run, the only ``jit`` of a stage.

    g = grad loss(params, batch, fold_in(key, step));   params <- params + update(g);   ema <- d ema + (1 - d) params

with d = min(decay, (1 + step) / (10 + step)), so that the average does not start from the random
initial weights. The key is a function of the step, so a resumed run draws the same noise. Where
loss or gradients are not finite the state stays as it was, but for the step's number where such
steps are passed over, and the flag ``finite`` tells the loop.
"""  # noqa: E501

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import optax

from uniart_jax.training.programs import Programs
from uniart_jax.training.state import Params, TrainState, clip_threshold, frozen_mask

Metrics = dict[str, jax.Array]
LossFn = Callable[..., tuple[jax.Array, Metrics]]  # of (params, batch, key), and what is frozen


def make_train_step(
    loss_fn: LossFn,
    optimizer: optax.GradientTransformation,
    ema_decay: float,
    *,
    freeze: Sequence[str] = (),
    idle: Callable[[Any], Sequence[str]] = lambda batch: (),
    accumulate: int = 1,
    skip: bool = False,
    frozen_params: Any = None,
) -> Programs:
    """Build ``step(state, batch, key) -> (state, metrics)``; ``state`` is donated, so use only the
    returned one.

    Args:
      loss_fn: (params, batch, key) -> (scalar loss, dict of scalar metrics); with
        ``frozen_params``, of (params, batch, key, frozen_params).
      ema_decay: of the averaged parameters.
      freeze: parameters that stay as they are, bit for bit, with their average
        (``state.frozen_mask``); nothing is differentiated by them.
      idle: of a batch, parameters that its loss does not read. They stay as they are in its step,
        where momentum would move them; their moments go on with a gradient of 0.
      accumulate: with n > 1, ``batch`` is a sequence of n micro-batches of equally many items
        (``microbatches.split_batch``), whose gradients are averaged one
        after another: the memory of one, the update of all. Micro-batch i draws by fold_in(key, i).
      skip: a step that is not finite counts as a step.
      frozen_params: a frozen network's parameters, on the devices, which every step reads.

    The metrics are the loss function's, ``loss``, ``grad_norm`` (before clipping),
    ``clip_threshold`` where it adapts, and ``finite`` (1 or 0). A metric of micro-batches is the
    mean of those where it is a number. ``key`` is the run's and the same at every step. The
    returned state keeps the shardings of the state first given.
    """

    def update(state: TrainState, batch: Any, key: jax.Array, frozen_params: Any = None):
        key = jax.random.fold_in(key, state.step)
        micro = batch[0] if accumulate > 1 else batch
        mask = frozen_mask(state.params, (*freeze, *idle(micro)))

        def loss_of(params: Params, batch: Any, key: jax.Array):
            stop = jax.lax.stop_gradient
            fixed = jax.tree.map(lambda p, kept: stop(p) if kept else p, params, mask)
            last = () if frozen_params is None else (frozen_params,)
            return loss_fn(fixed, batch, key, *last)

        gradient = jax.value_and_grad(loss_of, has_aux=True)
        if accumulate > 1:
            (loss, metrics), grads = _average(gradient, state.params, batch, key, accumulate)
        else:
            (loss, metrics), grads = gradient(state.params, batch, key)
        grad_norm = optax.tree.norm(grads)
        finite = jnp.isfinite(loss) & jnp.isfinite(grad_norm)
        updates, opt_state = optimizer.update(grads, state.opt_state, state.params)
        params = optax.apply_updates(state.params, updates)
        step = state.step + 1
        decay = jnp.minimum(ema_decay, (1.0 + step) / (10.0 + step))
        ema = optax.incremental_update(params, state.ema, 1.0 - decay)
        params, ema = (
            jax.tree.map(lambda kept, new, old: old if kept else new, mask, new, old)
            for new, old in ((params, state.params), (ema, state.ema))
        )
        new = TrainState(step, params, opt_state, ema)
        old = state._replace(step=step) if skip else state
        new = jax.tree.map(lambda after, before: jnp.where(finite, after, before), new, old)
        metrics = {**metrics, "loss": loss, "grad_norm": grad_norm, "finite": finite}
        return new, metrics | clip_threshold(opt_state)

    return Programs(update, frozen_params)


def _average(
    gradient: Callable[..., Any], params: Params, batches: Sequence[Any], key: jax.Array, count: int
) -> Any:
    """((loss, metrics), gradients) of ``count`` micro-batches. Where their shapes are equal one
    program loops over them."""
    if len(batches) != count:
        raise ValueError(f"step: {len(batches)} micro-batches given, accumulate is {count}")

    def add(total: Any, numbered: Any) -> tuple[Any, tuple[jax.Array, Metrics]]:
        index, batch = numbered
        values, grads = gradient(params, batch, jax.random.fold_in(key, index))
        return jax.tree.map(jnp.add, total, grads), values

    total = jax.tree.map(jnp.zeros_like, params)
    shapes = [jax.tree.map(jnp.shape, batch) for batch in batches]
    if all(shape == shapes[0] for shape in shapes):
        stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *batches)
        total, values = jax.lax.scan(add, total, (jnp.arange(count), stacked))
    else:
        found = []
        for numbered in enumerate(batches):
            total, of_one = add(total, numbered)
            found.append(of_one)
        values = jax.tree.map(lambda *leaves: jnp.stack(leaves), *found)
    losses, metrics = values
    grads = jax.tree.map(lambda g: g / count, total)
    return (losses.mean(), jax.tree.map(jnp.nanmean, metrics)), grads

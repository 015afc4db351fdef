"""What a training run carries from step to step, and the optimizer that changes it.

AdamW with global-norm clipping and linear warm-up, then constant (the paper, TRELLIS) or cosine to
zero. Everything is one pytree, so one sharding rule, one checkpoint and one donated buffer serve it
all: the recent gradient norms of adaptive clipping too.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
import optax.contrib

from uniart_jax.config import MeshConfig, StageConfig
from uniart_jax.models.network import flat_names
from uniart_jax.training.sharding import state_sharding

FROZEN = jax.tree_util.DictKey("pos_emb")  # a structure flow's position table: no gradient either
Params = Any  # nested dict of float32 arrays


class TrainState(NamedTuple):
    """A run between two steps.

    Attributes:
      step: int32 []; number of steps made, also of those that were passed over.
      params: the trained network's nested dict, float32.
      opt_state: of the optax transformation.
      ema: exponential moving average of ``params``; what is exported.
    """

    step: jax.Array
    params: Params
    opt_state: optax.OptState
    ema: Params


def make_schedule(stage: StageConfig) -> optax.Schedule:
    """Learning rate by update number: linear from lr / warm-up (so that update 0 moves), then
    constant, cosine to zero, or constant and over the last 1 - ``hold`` of the steps linear to
    zero."""
    rate = stage.learning_rate
    warmup = min(stage.warmup_steps, max(stage.steps - 1, 0))
    start = rate / max(warmup, 1)
    if stage.schedule == "cosine":
        return optax.warmup_cosine_decay_schedule(start, rate, warmup, max(stage.steps, warmup + 1))
    constant = optax.warmup_constant_schedule(start, rate, warmup)
    if stage.schedule == "linear":
        first = round(stage.hold * stage.steps)
        fall = optax.linear_schedule(1.0, 0.0, max(stage.steps - first, 1), first)
        return lambda count: constant(count) * fall(count)
    return constant


def make_optimizer(stage: StageConfig) -> optax.GradientTransformation:
    """AdamW as ``stage`` says; gradients clipped by global norm, decay only on kernels (two or more
    axes, no frozen table).

    ``gradient_clip`` is the threshold (0 = none); with ``clip_percentile`` it is the most that
    ``clip_by_recent_norms`` allows. Parameters that ``freeze`` names have no moments; ``init``
    raises a ValueError where it names none.
    """
    frozen = [f"{prefix}." for prefix in stage.freeze]
    slow = [p for p in stage.slow if not any(f"{p}.".startswith(f) for f in frozen)]
    stage = dataclasses.replace(stage, slow=tuple(slow))  # what is frozen is not slow
    optimizer = _adamw(stage)
    if stage.muon > 0 or stage.slow:
        rules = {
            "adamw": optimizer,
            "slow": _adamw(stage, stage.slow_rate),
            "muon": _muon(stage),
        }
        optimizer = optax.partition(rules, lambda params: _rules(params, stage))
    if stage.clip_percentile > 0:
        adaptive = clip_by_recent_norms(
            stage.gradient_clip, stage.clip_percentile, stage.clip_window
        )
        optimizer = optax.chain(adaptive, optimizer)
    elif stage.gradient_clip > 0:
        optimizer = optax.chain(optax.clip_by_global_norm(stage.gradient_clip), optimizer)
    if not stage.freeze:
        return optimizer

    def trained(params: Params) -> Any:
        return jax.tree.map(lambda kept: not kept, frozen_mask(params, stage.freeze))

    return optax.masked(optimizer, trained)


def _adamw(stage: StageConfig, times: float = 1.0) -> optax.GradientTransformation:
    schedule, (b1, b2) = make_schedule(stage), stage.betas
    return optax.adamw(
        lambda count: times * schedule(count),
        b1=b1,
        b2=b2,
        weight_decay=stage.weight_decay,
        mask=lambda params: jax.tree_util.tree_map_with_path(
            lambda path, p: p.ndim >= 2 and path[-1] != FROZEN, params
        ),
    )


def _muon(stage: StageConfig) -> optax.GradientTransformation:
    """Orthogonalised momentum (Jordan 2024), the update's root mean square .2 as AdamW's; of
    kernels [..., in, out]."""
    schedule = make_schedule(stage)

    def dimensions(params: Params) -> Any:
        number = optax.contrib.MuonDimensionNumbers
        return jax.tree.map(lambda p: number(p.ndim - 2, p.ndim - 1), params)

    return optax.contrib.muon(
        lambda count: stage.muon * schedule(count),
        beta=0.95,
        weight_decay=stage.weight_decay,
        nesterov=True,
        consistent_rms=0.2,
        muon_weight_dimension_numbers=dimensions,
    )


def _rules(params: Params, stage: StageConfig) -> Any:
    """Which rule each parameter follows: "slow", "muon" (kernels of at least 32 by 32) or
    "adamw"."""
    slow = frozen_mask(params, stage.slow) if stage.slow else jax.tree.map(lambda p: False, params)

    def rule(path, p, slow):
        if slow:
            return "slow"
        hidden = path[-1] == jax.tree_util.DictKey("kernel") and min(p.shape[-2:]) >= 32
        return "muon" if stage.muon > 0 and hidden else "adamw"

    return jax.tree_util.tree_map_with_path(rule, params, slow)


class RecentNorms(NamedTuple):
    """State of ``clip_by_recent_norms``.

    Attributes:
      norms: [window] float32 global norms of the last gradients before clipping, a ring.
      count: int32 []; norms recorded so far.
      threshold: float32 []; that the last gradients were clipped to; the largest float32 where
        there was none.
    """

    norms: jax.Array
    count: jax.Array
    threshold: jax.Array


def clip_by_recent_norms(
    most: float, percentile: float, window: int
) -> optax.GradientTransformation:
    """Clip the global norm to min(``most``, the ``percentile`` of the last ``window`` norms); to
    ``most`` (0 = not) until that many are known.

    Upstream: TRELLIS ``utils/grad_clip_utils.py``, AdaptiveGradClipper (95, 1000): a rare large
    gradient is cut to what is usual at this stage of the run. A step that is not finite leaves no
    norm, as it leaves the whole state (``step``).

    Raises:
      ValueError: percentile or window out of range.
    """
    if not 0 < percentile <= 100 or window < 1:
        raise ValueError(
            f"optimizer: clip_percentile {percentile} of clip_window {window} norms; give a "
            "percentile in (0, 100] and a window of 1 or more"
        )
    ceiling = most if most > 0 else float(jnp.finfo(jnp.float32).max)

    def init(params: Params) -> RecentNorms:
        del params
        return RecentNorms(jnp.zeros(window), jnp.zeros((), jnp.int32), jnp.float32(ceiling))

    def update(grads: Params, state: RecentNorms, params: Params = None) -> tuple[Any, RecentNorms]:
        del params
        norm = optax.tree.norm(grads)
        usual = jnp.percentile(state.norms, percentile)
        threshold = jnp.where(state.count >= window, jnp.minimum(usual, ceiling), ceiling)
        factor = jnp.where(norm > threshold, threshold / norm, 1.0)
        norms = state.norms.at[state.count % window].set(norm)
        # the count stays small enough for int32 in a run of any length, and the ring in phase
        count = jnp.where(state.count + 1 >= 2 * window, window, state.count + 1)
        clipped = jax.tree.map(lambda g: g * factor, grads)
        return clipped, RecentNorms(norms, count, threshold.astype(jnp.float32))

    return optax.GradientTransformation(init, update)


def clip_threshold(opt_state: optax.OptState) -> dict[str, jax.Array]:
    """``{"clip_threshold": of the last step}`` where clipping adapts, else empty."""
    states = jax.tree.leaves(opt_state, is_leaf=lambda node: isinstance(node, RecentNorms))
    found = [state.threshold for state in states if isinstance(state, RecentNorms)]
    return {"clip_threshold": found[0]} if found else {}


def frozen_mask(params: Params, prefixes: Sequence[str]) -> Any:
    """Whether each parameter is named by one of ``prefixes``: its dotted name, or the beginning of
    it up to a dot ("decoder.blocks").

    Raises:
      ValueError: a prefix names nothing (what there is at its place is listed), or nothing would be
        left to train.
    """
    names = list(flat_names(params))

    def below(prefix: str) -> list[str]:
        return [n for n in names if n == prefix or n.startswith(f"{prefix}.")]

    for prefix in prefixes:
        if below(prefix):
            continue
        parent = prefix
        while parent and not below(parent):
            parent = parent.rpartition(".")[0]
        start = len(parent) + 1 if parent else 0
        inside = (name[start:] for name in (below(parent) if parent else names))
        found = dict.fromkeys(rest.split(".")[0] for rest in inside)
        place = f" below '{parent}'" if parent else ""
        raise ValueError(
            f"freeze: no parameter is named '{prefix}'; there are{place}: {', '.join(found)}"
        )
    kept = {name for prefix in prefixes for name in below(prefix)}
    if len(kept) == len(names):
        raise ValueError(f"freeze: {', '.join(prefixes)} leaves nothing to train; name fewer")
    return jax.tree.unflatten(jax.tree.structure(params), [name in kept for name in names])


def create_state(
    network_init: Callable[[jax.Array], Params],
    optimizer: optax.GradientTransformation,
    key: jax.Array,
    mesh: jax.sharding.Mesh | None = None,
    min_split: int = MeshConfig.min_split,
) -> TrainState:
    """A fresh state whose arrays are born where they will live; no device ever holds all of a
    sharded network.

    Args:
      network_init: key -> parameters.
      mesh: of ``make_mesh``; None puts everything on the default device.
      min_split: numbers of the smallest arrays that are split (``sharding.state_sharding``).
    """
    init = functools.partial(_fresh, network_init, optimizer)
    abstract = jax.eval_shape(init, key)
    shardings = None if mesh is None else state_sharding(mesh, abstract, min_split)
    # LLVM takes 20 seconds to make fast what runs once for a moment
    slow = jax.default_backend() == "cpu" and not jax.config.read("jax_disable_most_optimizations")
    quick = {"xla_backend_optimization_level": 1} if slow else None
    return jax.jit(init, out_shardings=shardings, compiler_options=quick)(key)


def abstract_state(
    network_init: Callable[[jax.Array], Params],
    optimizer: optax.GradientTransformation,
    mesh: jax.sharding.Mesh,
    min_split: int = MeshConfig.min_split,
) -> TrainState:
    """ShapeDtypeStructs of ``create_state``, with its shardings: what a checkpoint is restored
    into, without a second state on the devices."""
    init = functools.partial(_fresh, network_init, optimizer)
    shapes = jax.eval_shape(init, jax.random.key(0))
    return jax.tree.map(
        lambda leaf, place: jax.ShapeDtypeStruct(leaf.shape, leaf.dtype, sharding=place),
        shapes,
        state_sharding(mesh, shapes, min_split),
    )


def _fresh(
    network_init: Callable[[jax.Array], Params],
    optimizer: optax.GradientTransformation,
    key: jax.Array,
) -> TrainState:
    params = network_init(key)
    # A copy, because the donated step would otherwise be given one buffer twice.
    ema = jax.tree.map(jnp.copy, params)
    return TrainState(jnp.zeros((), jnp.int32), params, optimizer.init(params), ema)


def begin_with(state: TrainState, params: Params) -> TrainState:
    """A fresh state with other parameters (a nested dict of host arrays), placed as the state's
    own; layers that are not in it stay as they are drawn."""

    def replaced(new: Any, old: Any) -> Any:
        if not isinstance(old, dict):
            return jax.device_put(new, old.sharding)
        return {key: replaced(new[key], leaf) if key in new else leaf for key, leaf in old.items()}

    placed = replaced(params, state.params)
    return state._replace(params=placed, ema=jax.tree.map(jnp.copy, placed))

"""Stacks of equal blocks: run one after another, or compiled once and looped over, with or without
keeping activations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from flax import nnx

Apply = Callable[[Any, int, jax.Array], jax.Array]


def run_stack(
    blocks: Sequence[nnx.Module],
    apply: Apply,
    h: jax.Array,
    *,
    scan: bool = False,
    remat: bool = False,
    period: int = 1,
) -> jax.Array:
    """h after ``apply(block, i % period, h)`` of every block in turn; the same numbers in every
    mode.

    Args:
      blocks: modules of equal structure and shapes.
      apply: whatever else it reads (a condition, window plans) it closes over.
      scan: stack the blocks' parameters and loop: compile time does not grow with depth; costs a
        copy of the parameters a call.
      remat: keep only each block's input for the gradient and compute the rest again: memory grows
        with depth by that input alone.
      period: how many different ``apply`` s alternate (windows and shifted windows: 2).
    """
    parts = [nnx.split(block) for block in blocks]

    def step(j: int) -> Callable[[Any, jax.Array], jax.Array]:
        def one(state, h):
            return apply(nnx.merge(parts[0][0], state), j, h)

        return jax.checkpoint(one) if remat else one

    looped = len(blocks) // period * period if scan else 0
    if looped > period:
        stacked = [
            jax.tree.map(lambda *leaves: jnp.stack(leaves), *[s for _, s in parts[j:looped:period]])
            for j in range(period)
        ]

        def body(h, states):
            for j, state in enumerate(states):
                h = step(j)(state, h)
            return h, None

        h, _ = jax.lax.scan(body, h, stacked)
    else:
        looped = 0
    for i, (_, state) in enumerate(parts[looped:]):
        h = step(i % period)(state, h)
    return h

"""Matching of predicted to true rows, one to one (DETR, Carion 2020)."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import optax


def match(cost: jax.Array, counts: jax.Array) -> jax.Array:
    """[B, K] the query of each true part, a minimum of the summed cost; of parts beyond ``counts``
    [B] some other query.

    cost: [B, Q, K] with Q >= K.
    """
    queries, parts = cost.shape[1:]
    if queries < parts:
        raise ValueError(f"layout: {queries} queries cannot hold objects of {parts} parts")
    valid = jnp.arange(parts) < counts[:, None]
    cost = jnp.where(valid[:, None], jax.lax.stop_gradient(cost), 0)

    def of_item(cost):
        rows, columns = optax.assignment.hungarian_algorithm(cost.T)  # K rows, Q columns
        return jnp.zeros(parts, jnp.int32).at[rows].set(columns.astype(jnp.int32))

    return jax.vmap(of_item)(cost)

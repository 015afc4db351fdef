"""Attention as one softmax over whole rows, for JAX to differentiate in every mode and order.

The other ways have gradients of their own (``jax.custom_vjp``), through which ``jax.jvp`` and
Hessian-vector products do not go. Here all logits [S, N, Lq, Lk] exist at once, and again for the
gradient: for small models.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp


def attend_rows(
    q: jax.Array, k: jax.Array, v: jax.Array, q_ids: jax.Array, k_ids: jax.Array
) -> jax.Array:
    """softmax(q k^T / sqrt(H)) v; queries see keys of their own id. q [S, Lq, N, H]; k, v [S, Lk,
    N, H]; ids [S, Lq], [S, Lk]."""
    logits = jnp.einsum(
        "slnh,smnh->snlm", q * q.shape[-1] ** -0.5, k, preferred_element_type=jnp.float32
    )
    seen = (q_ids[:, :, None] == k_ids[:, None, :])[:, None]
    weights = jax.nn.softmax(jnp.where(seen, logits, -1e30), -1)
    out = jnp.einsum(
        "snlm,smnh->slnh", weights.astype(v.dtype), v, preferred_element_type=jnp.float32
    )
    return out.astype(v.dtype)

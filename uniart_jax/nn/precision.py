"""What networks compute in."""

from __future__ import annotations

import jax.numpy as jnp

from uniart_jax.config import ModelConfig


def compute_dtype(config: ModelConfig) -> jnp.dtype:
    """The dtype that matrix products run in; parameters and norms stay float32."""
    return jnp.dtype(config.compute_dtype)

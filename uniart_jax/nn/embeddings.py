"""Embeddings of time and position, as TRELLIS has them (``models/sparse_structure_flow.py``,
``modules/transformer/blocks.py``)."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np


def timestep_embedding(t: jax.Array, width: int = 256) -> jax.Array:
    """[B] network times (1000 t) -> [B, width]: [cos, sin] with frequencies 10000^(-i / (width /
    2)), float32."""
    half = width // 2
    frequencies = np.exp(-math.log(10000) * np.arange(half, dtype=np.float32) / half)
    angles = t.astype(jnp.float32)[:, None] * frequencies[None, :]
    return jnp.concatenate([jnp.cos(angles), jnp.sin(angles)], -1)


def position_embedding(coords: jax.Array | np.ndarray, width: int) -> jax.Array:
    """[..., 3] positions -> [..., width]: per axis [sin, cos], axes x | y | z, zero padded to the
    width, float32.

    Frequencies 10000^(-i / F) with F = width // 3 // 2.
    """
    per_axis = width // 3 // 2
    frequencies = 1.0 / 10000 ** (np.arange(per_axis, dtype=np.float32) / per_axis)
    angles = jnp.asarray(coords).astype(jnp.float32)[..., None] * frequencies
    out = jnp.concatenate([jnp.sin(angles), jnp.cos(angles)], -1)
    out = out.reshape(*out.shape[:-2], -1)
    return jnp.pad(out, [(0, 0)] * (out.ndim - 1) + [(0, width - out.shape[-1])])


def grid_coords(side: int) -> np.ndarray:
    """[side^3, 3] cell indices of a dense grid, row-major (x, y, z)."""
    return np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), -1).reshape(-1, 3)


def plane_embedding(side: int, width: int) -> np.ndarray:
    """[side^2, width] two-dimensional sine-cosine embedding of an image's patches, row-major
    (Dosovitskiy's ViT, MAE's form)."""
    quarter = width // 4
    frequencies = 1.0 / 10000 ** (np.arange(quarter) / quarter)
    rows, columns = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
    angles = [x.reshape(-1, 1) * frequencies for x in (rows, columns)]
    parts = [f(a) for a in angles for f in (np.sin, np.cos)]
    return np.concatenate(parts, -1).astype(np.float32)

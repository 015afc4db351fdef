"""Layers of the decoders that find a set of boxes in an image (``models.layout``,
``models.box_sets``)."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx

from uniart_jax.config import ModelConfig
from uniart_jax.nn.attention import attend
from uniart_jax.nn.blocks import MLP, LayerNorm, linear
from uniart_jax.nn.lifting import project, read_map, sample_map
from uniart_jax.voxels.closed_pose import moved

BANDS = 8  # of the sine embedding of a box
# a unit box's centre, corners and centres of faces
BOX_POINTS = np.array(
    [[0.5, 0.5, 0.5]]
    + [[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    + [[0, 0.5, 0.5], [1, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 1, 0.5], [0.5, 0.5, 0], [0.5, 0.5, 1]],
    np.float32,
)


class PartAttention(nnx.Module):
    """Multi-head attention whose queries, keys and values are given apart."""

    def __init__(self, width: int, heads: int, rngs: nnx.Rngs, *, kernel, dtype):
        self.heads, self.kernel = heads, kernel
        self.to_q, self.to_k, self.to_v, self.to_out = (
            linear(width, width, rngs, dtype=dtype) for _ in range(4)
        )

    def __call__(self, q: jax.Array, k: jax.Array, v: jax.Array) -> jax.Array:
        """q [B, Q, D], k and v [B, L, D] -> [B, Q, D]."""
        split = lambda x: x.reshape(*x.shape[:2], self.heads, -1)  # noqa: E731
        h = attend(
            split(self.to_q(q)), split(self.to_k(k)), split(self.to_v(v)), kernel=self.kernel
        )
        return self.to_out(h.reshape(q.shape))


class DecoderLayer(nnx.Module):
    """Attention among parts, to the image's tokens, and what the part's box shows in the map."""

    def __init__(self, config: ModelConfig, rngs: nnx.Rngs, dtype):
        c = config.layout
        options: dict[str, Any] = {"kernel": config.kernel, "dtype": dtype}
        self.self_attn = PartAttention(c.width, c.heads, rngs, **options)
        self.cross_attn = PartAttention(c.width, c.heads, rngs, **options)
        self.norm1, self.norm2, self.norm3 = (LayerNorm(c.width) for _ in range(3))
        points = len(BOX_POINTS)
        self.read_in = linear(points * (c.map_channels + 3), c.width, rngs, dtype=dtype)
        self.read_out = linear(c.width, c.width, rngs, dtype=dtype)
        self.mlp = MLP(c.width, 4, rngs, dtype)

    def __call__(
        self, x, place, tokens, tokens_place, read, others=None, others_place=None, sets=1
    ):
        """x, place [B, Q, D]; tokens, tokens_place [B, L, D]; read [B, Q, 15 (C + 3)]; others,
        others_place [B, P, D], rows that are attended to as x is; sets: Q is of so many, one after
        the other, that do not attend to one another -> [B, Q, D]."""
        y = self.norm1(x)
        apart = lambda z: z.reshape(len(z) * sets, -1, z.shape[-1])  # noqa: E731
        queries, values = apart(y + place), apart(y)
        keys = queries
        if others is not None:
            also = self.norm1(others)
            keys = jnp.concatenate([keys, jnp.repeat(also + others_place, sets, 0)], 1)
            values = jnp.concatenate([values, jnp.repeat(also, sets, 0)], 1)
        x = x + self.self_attn(queries, keys, values).reshape(x.shape)
        x = x + self.cross_attn(self.norm2(x) + place, tokens + tokens_place, tokens)
        x = x + self.read_out(jax.nn.gelu(self.read_in(read)))
        return x + self.mlp(self.norm3(x))


def read_boxes(
    features: jax.Array,
    corners: jax.Array,
    camera: jax.Array,
    motions: jax.Array | None = None,
    gather: bool = False,
) -> jax.Array:
    """[B, Q, 15 (C + 3)]: the map where the camera sees each box's points, after motions
    [B, Q, 3, 4], and that place and depth; ``gather``: by gathers, as ``sample_map`` does on CPUs,
    where no gradient of the map is asked."""
    lower, upper = corners[..., None, :3], corners[..., None, 3:]
    points = lower + (upper - lower) * BOX_POINTS  # [B, Q, 15, 3]
    if motions is not None:
        points = moved(motions[..., None, :, :], points)
    see = jax.vmap(lambda code, p: jax.tree.map(lambda x: x[0], project(code[None], p)))
    places, depth = see(camera, points.reshape(len(points), -1, 3))
    read = jax.vmap(read_map)(features, places) if gather else sample_map(features, places)
    rows = [read, places.astype(read.dtype), depth[..., None].astype(read.dtype)]
    return jnp.concatenate(rows, -1).reshape(*corners.shape[:2], -1)


def sine_embedding(x: jax.Array) -> jax.Array:
    """[..., D] -> [..., 2 BANDS D] sines and cosines of octaves, the slowest of period 4."""
    angles = x[..., None] * (2.0 ** jnp.arange(BANDS) * (jnp.pi / 2))
    return jnp.concatenate([jnp.sin(angles), jnp.cos(angles)], -1).reshape(*x.shape[:-1], -1)

"""Layers and transformer blocks, with TRELLIS's numerics and parameter names
(``modules/transformer``, ``modules/sparse/transformer``).

Every module is a Flax NNX module used as a plain pytree: parameters only, no random state. Norms
and softmax run in float32. Names that are numbers in TRELLIS's ``nn.Sequential`` are numbers here
too (``mlp.mlp.0``, ``adaLN_modulation.1``).
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
from flax import nnx

from uniart_jax.config import Kernel
from uniart_jax.nn.attention import attend, attend_segments
from uniart_jax.nn.segments import Segments

xavier = nnx.initializers.xavier_uniform()
zeros = nnx.initializers.zeros_init()


class Linear(nnx.Linear):
    """``nnx.Linear`` over flattened rows: XLA's CPU backend is twice as slow at the gradient of a
    product with several leading axes."""

    def __call__(self, x: jax.Array) -> jax.Array:
        return super().__call__(x.reshape(-1, x.shape[-1])).reshape(*x.shape[:-1], -1)


def linear(
    inputs: int, outputs: int, rngs: nnx.Rngs, *, init: Callable = xavier, dtype=jnp.float32
) -> Linear:
    """Linear layer, Xavier uniform and zero bias (TRELLIS's init); ``dtype`` is what it computes
    in."""
    return Linear(inputs, outputs, kernel_init=init, dtype=dtype, rngs=rngs)


def layer_norm(x: jax.Array, epsilon: float) -> jax.Array:
    """LayerNorm without parameters over the last axis, in float32, cast back."""
    y = x.astype(jnp.float32)
    y = y - y.mean(-1, keepdims=True)
    return (y * jax.lax.rsqrt(jnp.square(y).mean(-1, keepdims=True) + epsilon)).astype(x.dtype)


class LayerNorm(nnx.Module):
    """LayerNorm with scale and bias, in float32. TRELLIS: 1e-6 in transformers, 1e-5 in the
    structure VAE."""

    def __init__(self, channels: int, *, epsilon: float = 1e-6):
        self.scale = nnx.Param(jnp.ones(channels))
        self.bias = nnx.Param(jnp.zeros(channels))
        self.epsilon = epsilon

    def __call__(self, x: jax.Array) -> jax.Array:
        y = layer_norm(x.astype(jnp.float32), self.epsilon)
        return (y * self.scale[...] + self.bias[...]).astype(x.dtype)


class GroupNorm(nnx.Module):
    """GroupNorm with scale and bias over positions and the channels of a group, in float32; eps
    1e-5, 32 groups as TRELLIS has it."""

    def __init__(self, channels: int, *, groups: int = 32, epsilon: float = 1e-5):
        if channels % groups:
            raise ValueError(f"group norm: {channels} channels do not divide into {groups} groups")
        self.scale = nnx.Param(jnp.ones(channels))
        self.bias = nnx.Param(jnp.zeros(channels))
        self.groups, self.epsilon = groups, epsilon

    def __call__(self, x: jax.Array) -> jax.Array:
        """x [B, ..., C], each item by itself."""
        y = x.astype(jnp.float32).reshape(x.shape[0], -1, self.groups, x.shape[-1] // self.groups)
        y = y - y.mean((1, 3), keepdims=True)
        y = y * jax.lax.rsqrt(jnp.square(y).mean((1, 3), keepdims=True) + self.epsilon)
        return (y.reshape(x.shape) * self.scale[...] + self.bias[...]).astype(x.dtype)


class RMSNorm(nnx.Module):
    """x / max(|x|, 1e-12) * gamma * sqrt(H) per head; gamma [N, H]."""

    def __init__(self, heads: int, size: int):
        self.gamma = nnx.Param(jnp.ones((heads, size)))

    def __call__(self, x: jax.Array) -> jax.Array:
        y = x.astype(jnp.float32)
        # the square is clipped, not the root, so that the gradient at x = 0 is finite
        inverse = jax.lax.rsqrt(jnp.maximum(jnp.square(y).sum(-1, keepdims=True), 1e-24))
        return (y * inverse * self.gamma[...] * x.shape[-1] ** 0.5).astype(x.dtype)


class MLP(nnx.Module):
    """Linear, GELU (tanh), Linear."""

    def __init__(self, width: int, ratio: float, rngs: nnx.Rngs, dtype=jnp.float32):
        hidden = int(width * ratio)
        self.mlp = nnx.Dict(
            {
                "0": linear(width, hidden, rngs, dtype=dtype),
                "2": linear(hidden, width, rngs, dtype=dtype),
            }
        )

    def __call__(self, x: jax.Array) -> jax.Array:
        return self.mlp["2"](jax.nn.gelu(self.mlp["0"](x)))


class SelfAttention(nnx.Module):
    """Multi-head self-attention within rows of given lengths, or within segments of a batch."""

    def __init__(
        self,
        width: int,
        heads: int,
        rngs: nnx.Rngs,
        *,
        qk_rms_norm: bool = False,
        kernel: Kernel = "xla",
        dtype=jnp.float32,
    ):
        self.heads = heads
        self.kernel: Kernel = kernel
        self.to_qkv = linear(width, 3 * width, rngs, dtype=dtype)
        if qk_rms_norm:
            self.q_rms_norm = RMSNorm(heads, width // heads)
            self.k_rms_norm = RMSNorm(heads, width // heads)
        self.qk_rms_norm = qk_rms_norm
        self.to_out = linear(width, width, rngs, dtype=dtype)

    def __call__(self, x: jax.Array, lengths: jax.Array | Segments | None = None) -> jax.Array:
        """x [S, L, D] with ``lengths`` [S], or x [B, V, D] with a ``Segments`` plan of it."""
        qkv = self.to_qkv(x).reshape(*x.shape[:2], 3, self.heads, -1)
        if self.qk_rms_norm:
            q, k = self.q_rms_norm(qkv[:, :, 0]), self.k_rms_norm(qkv[:, :, 1])
            qkv = jnp.stack([q, k, qkv[:, :, 2]], 2)
        if isinstance(lengths, Segments):
            out = attend_segments(
                qkv.reshape(-1, *qkv.shape[2:]), lengths, kernel=self.kernel
            ).reshape(x.shape)
        else:
            q, k, v = (qkv[:, :, i] for i in range(3))
            out = attend(q, k, v, lengths, query_lengths=lengths, kernel=self.kernel)
        return self.to_out(out.reshape(x.shape))


class CrossAttention(nnx.Module):
    """Multi-head attention of tokens to a context; the context's batch may divide the tokens'
    (draws that share an image)."""

    def __init__(
        self,
        width: int,
        context: int,
        heads: int,
        rngs: nnx.Rngs,
        *,
        qk_rms_norm: bool = False,
        kernel: Kernel = "xla",
        dtype=jnp.float32,
    ):
        self.heads = heads
        self.kernel: Kernel = kernel
        self.to_q = linear(width, width, rngs, dtype=dtype)
        self.to_kv = linear(context, 2 * width, rngs, dtype=dtype)
        if qk_rms_norm:
            self.q_rms_norm = RMSNorm(heads, width // heads)
            self.k_rms_norm = RMSNorm(heads, width // heads)
        self.qk_rms_norm = qk_rms_norm
        self.to_out = linear(width, width, rngs, dtype=dtype)

    def __call__(self, x: jax.Array, context: jax.Array) -> jax.Array:
        """x [B n, L, D] (item-major), context [B, M, D']."""
        items, tokens = context.shape[:2]
        k, v = jnp.split(self.to_kv(context).reshape(items, tokens, 2 * self.heads, -1), 2, axis=2)
        q = self.to_q(x).reshape(items, -1, self.heads, x.shape[-1] // self.heads)
        if self.qk_rms_norm:
            q, k = self.q_rms_norm(q), self.k_rms_norm(k)
        return self.to_out(attend(q, k, v, kernel=self.kernel).reshape(x.shape))


class TransformerBlock(nnx.Module):
    """x += attn(LN(x)); x += mlp(LN(x)), norms without parameters: TRELLIS's
    SparseTransformerBlock."""

    def __init__(
        self,
        width: int,
        heads: int,
        ratio: float,
        rngs: nnx.Rngs,
        *,
        qk_rms_norm: bool = False,
        kernel: Kernel = "xla",
        dtype=jnp.float32,
    ):
        self.attn = SelfAttention(
            width, heads, rngs, qk_rms_norm=qk_rms_norm, kernel=kernel, dtype=dtype
        )
        self.mlp = MLP(width, ratio, rngs, dtype)

    def __call__(self, x: jax.Array, lengths: jax.Array | Segments | None = None) -> jax.Array:
        x = x + self.attn(layer_norm(x, 1e-6), lengths)
        return x + self.mlp(layer_norm(x, 1e-6))


class CrossBlock(nnx.Module):
    """x += cross(LN(x), context); x += attn(LN(x)); x += mlp(LN(x)): queries of a volume looking at
    an image."""

    def __init__(
        self,
        width: int,
        heads: int,
        ratio: float,
        rngs: nnx.Rngs,
        *,
        kernel: Kernel = "xla",
        dtype=jnp.float32,
    ):
        self.cross_attn = CrossAttention(width, width, heads, rngs, kernel=kernel, dtype=dtype)
        self.self_attn = SelfAttention(width, heads, rngs, kernel=kernel, dtype=dtype)
        self.mlp = MLP(width, ratio, rngs, dtype)

    def __call__(self, x: jax.Array, context: jax.Array) -> jax.Array:
        x = x + self.cross_attn(layer_norm(x, 1e-6), context)
        x = x + self.self_attn(layer_norm(x, 1e-6))
        return x + self.mlp(layer_norm(x, 1e-6))


class ModulatedBlock(nnx.Module):
    """TRELLIS's ModulatedTransformerCrossBlock: adaLN on self-attention and MLP, plain affine norm
    before cross-attention.

    ``share_mod``: the caller gives the six modulations instead of the time embedding.
    """

    def __init__(
        self,
        width: int,
        context: int,
        heads: int,
        ratio: float,
        rngs: nnx.Rngs,
        *,
        qk_rms_norm: bool,
        qk_rms_norm_cross: bool = False,
        share_mod: bool,
        kernel: Kernel = "xla",
        dtype=jnp.float32,
    ):
        self.norm2 = LayerNorm(width)
        self.self_attn = SelfAttention(
            width, heads, rngs, qk_rms_norm=qk_rms_norm, kernel=kernel, dtype=dtype
        )
        self.cross_attn = CrossAttention(
            width, context, heads, rngs, qk_rms_norm=qk_rms_norm_cross, kernel=kernel, dtype=dtype
        )
        self.mlp = MLP(width, ratio, rngs, dtype)
        self.share_mod = share_mod
        if not share_mod:
            self.adaLN_modulation = modulation(width, 6 * width, rngs, init=zeros, dtype=dtype)

    def __call__(
        self, x: jax.Array, time: jax.Array, context: jax.Array, lengths: jax.Array | None = None
    ) -> jax.Array:
        """x [B, L, D], time [B, D] (or [B, 6 D] with ``share_mod``), context [B / n, M, D']."""
        six = time if self.share_mod else self.adaLN_modulation["1"](jax.nn.silu(time))
        shift_a, scale_a, gate_a, shift_m, scale_m, gate_m = jnp.split(six[:, None, :], 6, -1)
        x = x + gate_a * self.self_attn(layer_norm(x, 1e-6) * (1 + scale_a) + shift_a, lengths)
        x = x + self.cross_attn(self.norm2(x), context)
        return x + gate_m * self.mlp(layer_norm(x, 1e-6) * (1 + scale_m) + shift_m)


def modulation(inputs: int, outputs: int, rngs: nnx.Rngs, *, init: Callable, dtype) -> nnx.Dict:
    """SiLU, Linear as TRELLIS names it: the linear layer is number 1; the SiLU is the caller's."""
    return nnx.Dict({"1": linear(inputs, outputs, rngs, init=init, dtype=dtype)})


class TimestepEmbedder(nnx.Module):
    """Sinusoid of 256, Linear, SiLU, Linear."""

    def __init__(self, width: int, rngs: nnx.Rngs):
        normal = nnx.initializers.normal(0.02)
        self.mlp = nnx.Dict(
            {
                "0": linear(256, width, rngs, init=normal),
                "2": linear(width, width, rngs, init=normal),
            }
        )

    def __call__(self, embedding: jax.Array) -> jax.Array:
        return self.mlp["2"](jax.nn.silu(self.mlp["0"](embedding)))

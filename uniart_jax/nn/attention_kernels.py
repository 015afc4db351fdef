"""Accelerators' own attention kernels over padded rows: JAX's Pallas kernels for TPU and GPU, and
cuDNN.

q [S, Lq, N, H]; k, v [S, Lk, N, H]. Pallas kernels take ids [S, Lq] and [S, Lk]: a token attends to
those of equal id, and where no row of a softmax may be empty the caller lets padding attend to
padding. Both run in interpret mode on a CPU, where the tests compare them.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp

TILE = 128  # lengths are padded to multiples of it
MISSING = "model.kernel '{}': this version of JAX has no such kernel; take auto or xla"


def splash(
    q: jax.Array, k: jax.Array, v: jax.Array, q_ids: jax.Array, k_ids: jax.Array
) -> jax.Array:
    """``splash_attention`` of Pallas for TPU.

    Raises:
      ValueError: this JAX has none.
    """
    try:
        from jax.experimental.pallas.ops.tpu import splash_attention as kernels
    except ImportError:
        raise ValueError(MISSING.format("splash")) from None

    queries, heads, size = q.shape[1:]
    q, k, v = (_lengthen(x) for x in (q * size**-0.5, k, v))
    ids = kernels.SegmentIds(_lengthen(q_ids, -1), _lengthen(k_ids, -1))
    mask = kernels.MultiHeadMask([kernels.FullMask((q.shape[1], k.shape[1]))] * heads)
    kernel = kernels.make_splash_mha(
        mask, head_shards=1, q_seq_shards=1, interpret=jax.default_backend() == "cpu"
    )
    out = jax.vmap(kernel)(*(x.swapaxes(1, 2) for x in (q, k, v)), ids)
    return out.swapaxes(1, 2)[:, :queries].astype(v.dtype)


def triton(q: jax.Array, k: jax.Array, v: jax.Array, ids: jax.Array) -> jax.Array:
    """Flash attention of Pallas for GPU; queries and keys are the same tokens.

    Raises:
      ValueError: this JAX has none (it is deprecated in jax 0.12).
    """
    try:
        from jax.experimental.pallas.ops.gpu.attention import BlockSizes, mha
    except ImportError:
        raise ValueError(MISSING.format("triton")) from None

    length, size = q.shape[1], q.shape[-1]
    blocks = BlockSizes(
        block_q=TILE, block_k=TILE, block_q_dkv=32, block_kv_dkv=32, block_q_dq=32, block_kv_dq=32
    )
    q, k, v = (_lengthen(x) for x in (q, k, v))
    interpret = jax.default_backend() == "cpu"
    out = mha(q, k, v, _lengthen(ids, -1), size**-0.5, block_sizes=blocks, interpret=interpret)
    return out[:, :length].astype(v.dtype)


def cudnn(
    q: jax.Array,
    k: jax.Array,
    v: jax.Array,
    lengths: jax.Array | None,
    query_lengths: jax.Array | None,
    ids: jax.Array | None = None,
) -> jax.Array:
    """cuDNN's flash attention in bfloat16: rows of given lengths, or, with ``ids`` [S, L], rows of
    several segments by a mask [S, L, L].

    Lengths are padded to multiples of 128: odd ones have given NaN.
    """
    rows, queries, keys = q.shape[0], q.shape[1], k.shape[1]
    dtype = v.dtype
    q, k, v = (_lengthen(x).astype(jnp.bfloat16) for x in (q, k, v))
    if ids is not None:
        longer = _lengthen(ids, -1)
        mask = (longer[:, :, None] == longer[:, None, :])[:, None]
        out = jax.nn.dot_product_attention(q, k, v, mask=mask, implementation="cudnn")
        return out[:, :queries].astype(dtype)

    def full(given, length):
        return jnp.full((rows,), length, jnp.int32) if given is None else given.astype(jnp.int32)

    out = jax.nn.dot_product_attention(
        q,
        k,
        v,
        query_seq_lengths=full(query_lengths, queries),
        key_value_seq_lengths=full(lengths, keys),
        implementation="cudnn",
    )
    return out[:, :queries].astype(dtype)


def _lengthen(x: jax.Array, fill: int = 0) -> jax.Array:
    """[S, L, ...] padded to a multiple of ``TILE`` tokens."""
    padding = [(0, 0), (0, -x.shape[1] % TILE)] + [(0, 0)] * (x.ndim - 2)
    return jnp.pad(x, padding, constant_values=fill)

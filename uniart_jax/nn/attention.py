"""Attention over padded segments: the only module that names a kernel.

``attend`` never builds a T x T matrix: short rows take one dense block, long rows run in chunks with a running maximum
(Milakov & Gimelshein 2018; Rabe & Staats 2021). Rows beyond the given lengths come out exactly zero with zero gradients, and their
content, NaN included, never reaches a valid row.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp

from uniart_jax.config import Kernel
from uniart_jax.nn.segments import Segments

DENSE = 512  # keys up to which one dense block is used
CHUNK = 512
_MASKED = -1e30
_CACHED_LOGITS = 1 << 18  # 1 MiB


def attend(
    q: jax.Array,
    k: jax.Array,
    v: jax.Array,
    lengths: jax.Array | None = None,
    *,
    query_lengths: jax.Array | None = None,
    kernel: Kernel = "xla",
) -> jax.Array:
    """softmax(q k^T / sqrt(H)) v within each row of S.

    Args:
      q: [S, Lq, N, H].
      k, v: [S, Lk, N, H].
      lengths: [S] valid keys of each row, None = all.
      query_lengths: [S] valid queries; None = all.
      kernel: 'xla' runs anywhere; 'cudnn' needs an NVIDIA GPU and computes in bfloat16.

    Returns:
      [S, Lq, N, H]; queries beyond ``query_lengths``, and all queries of a row without keys, are zero.
    """
    if lengths is not None:
        valid = (jnp.arange(k.shape[1]) < lengths[:, None])[..., None, None]
        k, v = jnp.where(valid, k, 0), jnp.where(valid, v, 0)
    if query_lengths is not None:
        q_valid = (jnp.arange(q.shape[1]) < query_lengths[:, None])[..., None, None]
        q = jnp.where(q_valid, q, 0)
    if kernel == "cudnn":
        out = _cudnn(q, k, v, lengths, query_lengths)
    elif k.shape[1] <= DENSE:
        out = _dense(q, k, v, lengths)
    else:
        out = _chunked(q, k, v, lengths)
    if query_lengths is not None:
        out = jnp.where(q_valid, out, 0)
    return out


def map_segments(
    function: Callable[[jax.Array, jax.Array], jax.Array], tokens: jax.Array, segments: Segments
) -> jax.Array:
    """Apply ``function(rows [S, L, C], length [S]) -> [S, L, ...]`` to every bucket of tokens [B * V, C] -> [B * V, C']."""
    index = jnp.concatenate([bucket.index.reshape(-1) for bucket in segments.buckets])
    gathered = permute_rows(tokens, index, segments.inverse)
    done, offset = [], 0
    for bucket in segments.buckets:
        size, length = bucket.index.shape
        rows = gathered[offset : offset + size * length].reshape(size, length, -1)
        done.append(function(rows, bucket.length).reshape(size * length, -1))
        offset += size * length
    rows = done[0] if len(done) == 1 else jnp.concatenate(done)
    return permute_rows(rows, segments.inverse, index)


@jax.custom_vjp
def permute_rows(rows: jax.Array, index: jax.Array, inverse: jax.Array) -> jax.Array:
    """rows[index], zero where the index is out of range, for an index that takes no row twice.

    ``inverse`` undoes it (inverse[index[i]] = i), which makes the gradient a gather too: XLA's scatter is slow on CPU.
    """
    return take_rows(rows, index)


def take_rows(rows: jax.Array, index: jax.Array) -> jax.Array:
    """rows [T, C] at index [...] -> [..., C]; zero where the index is out of range."""
    return jnp.take(rows, index, axis=0, mode="fill", fill_value=0)


def _permute_forward(rows, index, inverse):
    return take_rows(rows, index), inverse


def _permute_backward(inverse, gradient):
    return take_rows(gradient, inverse), None, None


permute_rows.defvjp(_permute_forward, _permute_backward)


def _dense(q: jax.Array, k: jax.Array, v: jax.Array, lengths: jax.Array | None) -> jax.Array:
    rows, queries, heads, size = q.shape
    keys = k.shape[1]
    q, k, v = (x.swapaxes(1, 2).reshape(rows * heads, -1, size) for x in (q * size**-0.5, k, v))
    bias = jnp.zeros((rows, 1, keys), jnp.float32)
    if lengths is not None:
        bias = jnp.where(jnp.arange(keys) < lengths[:, None], 0.0, _MASKED)[:, None, :]
    bias = jnp.repeat(bias, heads, axis=0)
    # a CPU works on as many heads at a time as keep the logits in its cache (2 to 4 times faster); accelerators take all at once
    group = rows * heads
    if jax.default_backend() == "cpu":
        fitting = max(1, _CACHED_LOGITS // (queries * keys))
        group = max(g for g in range(1, min(fitting, group) + 1) if group % g == 0)
    if group == rows * heads or queries * keys <= 64 * 64:
        out = _block(q, k, v, bias)
    else:
        parts = [x.reshape(-1, group, *x.shape[1:]) for x in (q, k, v, bias)]
        out = jax.lax.map(lambda part: _block(*part), tuple(parts))
    return out.reshape(rows, heads, queries, size).swapaxes(1, 2)


@jax.custom_vjp
def _block(q: jax.Array, k: jax.Array, v: jax.Array, bias: jax.Array) -> jax.Array:
    """softmax(q k^T + bias) v for [G, L, H] with bias [G, 1, Lk]; the gradient recomputes the weights (flash attention's)."""
    return _block_forward(q, k, v, bias)[0]


def _block_forward(q, k, v, bias):
    logits = jnp.einsum("glh,gmh->glm", q, k, preferred_element_type=jnp.float32) + bias
    peak = logits.max(-1, keepdims=True)
    weights = jnp.exp(logits - peak)
    total = weights.sum(-1, keepdims=True)
    out = jnp.einsum("glm,gmh->glh", weights.astype(v.dtype), v, preferred_element_type=jnp.float32)
    out = (out / total).astype(v.dtype)
    return out, (q, k, v, bias, out, peak + jnp.log(total))


def _block_backward(saved, gradient):
    q, k, v, bias, out, normalizer = saved
    logits = jnp.einsum("glh,gmh->glm", q, k, preferred_element_type=jnp.float32)
    weights = jnp.exp(logits + (bias - normalizer))
    d_value = jnp.einsum("glm,glh->gmh", weights.astype(q.dtype), gradient)
    d_weights = jnp.einsum("glh,gmh->glm", gradient, v, preferred_element_type=jnp.float32)
    inner = (gradient * out).sum(-1, keepdims=True).astype(jnp.float32)
    d_logits = (weights * (d_weights - inner)).astype(q.dtype)
    d_query = jnp.einsum("glm,gmh->glh", d_logits, k)
    return d_query, jnp.einsum("glm,glh->gmh", d_logits, q), d_value, None


_block.defvjp(_block_forward, _block_backward)


def _chunked(q: jax.Array, k: jax.Array, v: jax.Array, lengths: jax.Array | None) -> jax.Array:
    rows, queries, heads, size = q.shape
    keys = k.shape[1]
    limit = jnp.full((rows,), keys, jnp.int32) if lengths is None else lengths

    def chunks(x: jax.Array) -> jax.Array:
        x = jnp.pad(x, ((0, 0), (0, -x.shape[1] % CHUNK), (0, 0), (0, 0)))
        return x.reshape(rows, -1, CHUNK, heads, size).swapaxes(0, 1)

    k_chunks, v_chunks = chunks(k), chunks(v)
    starts = jnp.arange(len(k_chunks)) * CHUNK

    @jax.checkpoint
    def key_step(carry, chunk):
        query, out, peak, total = carry
        key, value, start = chunk
        logits = jnp.einsum("slnh,smnh->snlm", query, key, preferred_element_type=jnp.float32)
        valid = start + jnp.arange(CHUNK) < limit[:, None]
        logits = jnp.where(valid[:, None, None, :], logits, _MASKED)
        new_peak = jax.lax.stop_gradient(jnp.maximum(peak, logits.max(-1)))
        weights = jnp.exp(logits - new_peak[..., None])
        decay = jnp.exp(peak - new_peak)
        out = out * decay[..., None] + jnp.einsum(
            "snlm,smnh->snlh",
            weights.astype(value.dtype),
            value,
            preferred_element_type=jnp.float32,
        )
        return (query, out, new_peak, total * decay + weights.sum(-1)), None

    def query_block(query: jax.Array) -> jax.Array:
        shape = (rows, heads, CHUNK)
        start = (
            query * size**-0.5,
            jnp.zeros((*shape, size), jnp.float32),
            jnp.full(shape, _MASKED, jnp.float32),
            jnp.zeros(shape, jnp.float32),
        )
        (_, out, _, total), _ = jax.lax.scan(key_step, start, (k_chunks, v_chunks, starts))
        return (out / total[..., None]).swapaxes(1, 2).astype(v.dtype)

    out = jax.lax.map(query_block, chunks(q))
    return out.swapaxes(0, 1).reshape(rows, -1, heads, size)[:, :queries]


def _cudnn(q, k, v, lengths, query_lengths):
    rows = q.shape[0]

    def full(x, n):
        return jnp.full((rows,), x.shape[1], jnp.int32) if n is None else n.astype(jnp.int32)

    out = jax.nn.dot_product_attention(
        *(x.astype(jnp.bfloat16) for x in (q, k, v)),
        query_seq_lengths=full(q, query_lengths),
        key_value_seq_lengths=full(k, lengths),
        implementation="cudnn",
    )
    return out.astype(v.dtype)

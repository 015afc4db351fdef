"""Attention in plain XLA, for any machine: rows are worked on a few at a time, so that logits stay
in cache and T x T is never made.

A tile is a group of rows (of one head each) or, where one row's logits are too many, a block of its
queries against all its keys: no running maximum is needed. The gradient computes a tile's weights
again from the logarithm of their sum, as flash attention does (Dao et al. 2022). Over segments, a
tile's tokens are also gathered inside the loop: what is read is a few megabytes at a time, and no
padded copy of a batch exists.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from uniart_jax.nn.gathers import take_rows
from uniart_jax.nn.segments import Bucket, Segments

# logits at a time: 4 MiB, about the best between 1 and 12 (benchmarks/attention.py)
CPU_LOGITS = 1 << 20
ACCELERATOR_LOGITS = 1 << 28  # 1 GiB: few and large steps
_MASKED = -1e30


@jax.custom_vjp
def attend_rows(q: jax.Array, k: jax.Array, v: jax.Array, key_ids: jax.Array | None) -> jax.Array:
    """softmax(q k^T / sqrt(H)) v for q [G, Lq, H], k and v [G, Lk, H]; keys with negative ids [G,
    Lk] are left out."""
    return _forward(q, k, v, None, key_ids)[0]


def _attend_rows_forward(q, k, v, key_ids):
    out, normalizer = _forward(q, k, v, None, key_ids)
    return out, (q, k, v, key_ids, out, normalizer)


def _attend_rows_backward(saved, gradient):
    q, k, v, key_ids, out, normalizer = saved
    return (*_backward(q, k, v, None, key_ids, out, normalizer, gradient), None)


attend_rows.defvjp(_attend_rows_forward, _attend_rows_backward)


@jax.custom_vjp
def attend_segments(qkv: jax.Array, segments: Segments) -> jax.Array:
    """Attention of tokens [T, 3, N, H] within their segments -> [T, N, H]; tokens of no segment are
    zero.

    The plan is of one share, without that axis: index [S, L], length [S], inverse [T].
    """
    return _segments_forward(qkv, segments)[0]


def _segments_forward(qkv: jax.Array, segments: Segments):
    tokens, _, heads, size = qkv.shape
    flat = qkv.reshape(tokens, -1)
    rows, normalizers = [], []
    for bucket in segments.buckets:

        def some(index, ids, equal):
            q, k, v = _heads_first(take_rows(flat, index), 3, heads)
            ids = jnp.repeat(ids, heads, axis=0)
            out, normalizer = _forward(q, k, v, ids if equal else None, ids)
            return _heads_last(out, heads), normalizer.reshape(len(index), heads, -1)

        out, normalizer = _over_rows(some, bucket, heads)
        rows.append(out.reshape(-1, heads * size))
        normalizers.append(normalizer)
    out = take_rows(jnp.concatenate(rows), segments.inverse).reshape(tokens, heads, size)
    return out, (qkv, segments, out, normalizers)


def _segments_backward(saved, gradient):
    qkv, segments, out, normalizers = saved
    tokens, _, heads, size = qkv.shape
    flat, out, gradient = (x.reshape(tokens, -1) for x in (qkv, out, gradient))
    rows = []
    for bucket, normalizer in zip(segments.buckets, normalizers, strict=True):

        def some(index, ids, equal, normalizer):
            q, k, v = _heads_first(take_rows(flat, index), 3, heads)
            (o,) = _heads_first(take_rows(out, index), 1, heads)
            (g,) = _heads_first(take_rows(gradient, index), 1, heads)
            ids = jnp.repeat(ids, heads, axis=0)
            normalizer = normalizer.reshape(-1, normalizer.shape[-1])
            parts = _backward(q, k, v, ids if equal else None, ids, o, normalizer, g)
            return jnp.concatenate([_heads_last(x, heads) for x in parts], -1)

        rows.append(_over_rows(some, bucket, heads, normalizer).reshape(-1, 3 * heads * size))
    return take_rows(jnp.concatenate(rows), segments.inverse).reshape(qkv.shape), None


attend_segments.defvjp(_segments_forward, _segments_backward)


def _over_rows(function: Callable[..., Any], bucket: Bucket, heads: int, *more: jax.Array) -> Any:
    """``function(index [g, L], ids [g, L], ids must be equal, *more)`` over groups of a bucket's
    rows; its results [S, ...]."""
    rows, length = bucket.index.shape
    steps = -(-rows * heads * length * length // _logits())
    group = -(-rows // max(1, min(steps, rows)))
    if bucket.segment is None:
        ids = jnp.where(jnp.arange(length) < jnp.asarray(bucket.length)[:, None], 0, -1)
    else:
        ids = bucket.segment
    inputs = (bucket.index, ids, *more)
    equal = bucket.segment is not None
    if group == rows:
        index, ids, *rest = inputs
        return function(index, ids, equal, *rest)
    padding = -rows % group
    fills = (jnp.iinfo(jnp.int32).max, -1, *[0] * len(more))
    grouped = tuple(
        jnp.pad(x, [(0, padding)] + [(0, 0)] * (jnp.ndim(x) - 1), constant_values=fill).reshape(
            -1, group, *jnp.shape(x)[1:]
        )
        for x, fill in zip(inputs, fills, strict=True)
    )
    done = jax.lax.map(lambda part: function(part[0], part[1], equal, *part[2:]), grouped)
    return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:])[:rows], done)


def _heads_first(rows: jax.Array, parts: int, heads: int) -> tuple[jax.Array, ...]:
    """[g, L, parts N H] -> parts of [g N, L, H]."""
    group, length, _ = rows.shape
    split = rows.reshape(group, length, parts, heads, -1).transpose(2, 0, 3, 1, 4)
    return tuple(split.reshape(parts, group * heads, length, -1))


def _heads_last(rows: jax.Array, heads: int) -> jax.Array:
    """[g N, L, H] -> [g, L, N H]."""
    _, length, size = rows.shape
    split = rows.reshape(-1, heads, length, size).swapaxes(1, 2)
    return split.reshape(-1, length, heads * size)


def _logits() -> int:
    return CPU_LOGITS if jax.default_backend() == "cpu" else ACCELERATOR_LOGITS


def _tiling(rows: int, queries: int, keys: int) -> tuple[int, int]:
    """(rows, queries) of a tile."""
    fitting = min(rows, _logits() // (queries * keys))
    if fitting:
        return -(-rows // -(-rows // fitting)), queries
    return 1, min(queries, max(1, _logits() // keys // 64) * 64)


def _forward(q, k, v, q_ids, k_ids):
    """Output [G, Lq, H] and the logarithm of the weights' sum [G, Lq]."""
    rows, queries, _ = q.shape
    group, block = _tiling(rows, queries, k.shape[1])
    if (group, block) == (rows, queries):
        return _tile(q, k, v, q_ids, k_ids)
    if block == queries:
        done = jax.lax.map(lambda part: _tile(*part), _blocks((q, k, v, q_ids, k_ids), group))
        return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:])[:rows], done)

    def row(part):
        q, k, v, q_ids, k_ids = part

        def some(queries):
            q, q_ids = queries
            return jax.tree.map(
                lambda x: x[0], _tile(q[None], k[None], v[None], _first(q_ids), _first(k_ids))
            )

        done = jax.lax.map(some, _blocks((q, q_ids), block))
        return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:])[:queries], done)

    return jax.lax.map(row, (q, k, v, q_ids, k_ids))


def _backward(q, k, v, q_ids, k_ids, out, normalizer, gradient):
    rows, queries, _ = q.shape
    group, block = _tiling(rows, queries, k.shape[1])
    inputs = (q, k, v, q_ids, k_ids, out, normalizer, gradient)
    if (group, block) == (rows, queries):
        return _tile_backward(*inputs)
    if block == queries:
        done = jax.lax.map(lambda part: _tile_backward(*part), _blocks(inputs, group))
        return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:])[:rows], done)

    def row(part):
        q, k, v, q_ids, k_ids, *rest = part

        def some(sums, queries):
            q, q_ids, *rest = jax.tree.map(lambda x: x[None], queries)
            d_q, d_k, d_v = _tile_backward(q, k[None], v[None], q_ids, _first(k_ids), *rest)
            return (sums[0] + d_k[0], sums[1] + d_v[0]), d_q[0]

        zero = jnp.zeros(k.shape, jnp.float32), jnp.zeros(v.shape, jnp.float32)
        (d_k, d_v), d_q = jax.lax.scan(some, zero, _blocks((q, q_ids, *rest), block))
        return d_q.reshape(-1, q.shape[-1])[:queries], d_k.astype(k.dtype), d_v.astype(v.dtype)

    return jax.lax.map(row, inputs)


def _first(ids: jax.Array | None) -> jax.Array | None:
    return None if ids is None else ids[None]


def _split(inputs: Any, group: int) -> Any:
    return jax.tree.map(lambda x: x.reshape(-1, group, *x.shape[1:]), inputs)


def _blocks(inputs: Any, block: int) -> Any:
    """[n, ...] -> [blocks, block, ...], zero-padded at the end: the gradient of what is padded is
    zero."""

    def cut(x):
        x = jnp.pad(x, [(0, -len(x) % block)] + [(0, 0)] * (x.ndim - 1))
        return x.reshape(-1, block, *x.shape[1:])

    return jax.tree.map(cut, inputs)


def _scaled_logits(q, k, q_ids, k_ids):
    q = q * q.shape[-1] ** -0.5
    logits = jnp.einsum("glh,gmh->glm", q, k, preferred_element_type=jnp.float32)
    if k_ids is None:
        return q, logits
    seen = k_ids[:, None, :] >= 0 if q_ids is None else q_ids[:, :, None] == k_ids[:, None, :]
    return q, jnp.where(seen, logits, _MASKED)


def _tile(q, k, v, q_ids, k_ids):
    _, logits = _scaled_logits(q, k, q_ids, k_ids)
    peak = logits.max(-1, keepdims=True)
    weights = jnp.exp(logits - peak)
    total = weights.sum(-1, keepdims=True)
    out = jnp.einsum("glm,gmh->glh", weights.astype(v.dtype), v, preferred_element_type=jnp.float32)
    return (out / total).astype(v.dtype), (peak + jnp.log(total))[..., 0]


def _tile_backward(q, k, v, q_ids, k_ids, out, normalizer, gradient):
    scaled, logits = _scaled_logits(q, k, q_ids, k_ids)
    weights = jnp.exp(logits - normalizer[..., None])
    # as [H, Lk]: XLA's batched product with both sides transposed is four times slower on a CPU
    d_value = jnp.einsum("glh,glm->ghm", gradient, weights.astype(q.dtype)).swapaxes(1, 2)
    d_weights = jnp.einsum("glh,gmh->glm", gradient, v, preferred_element_type=jnp.float32)
    inner = (gradient.astype(jnp.float32) * out).sum(-1, keepdims=True)
    d_logits = (weights * (d_weights - inner)).astype(q.dtype)
    d_query = jnp.einsum("glm,gmh->glh", d_logits, k) * q.shape[-1] ** -0.5
    d_key = jnp.einsum("glh,glm->ghm", scaled, d_logits).swapaxes(1, 2)
    return d_query.astype(q.dtype), d_key, d_value

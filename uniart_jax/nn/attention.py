"""Attention over padded segments: the only module that names a kernel.

``attend`` works on rows of given lengths, ``attend_segments`` on a batch's tokens within the
segments of a plan (``nn.segments``). No logits of T x T are ever made. Padding comes out exactly
zero with zero gradients, and its content, NaN included, never reaches a valid token.

``model.kernel`` names one:

    xla       anywhere: tiles of a few rows, or blocks of queries against all their keys, with a gradient of its own (``nn.attention_xla``)
    cudnn     NVIDIA, in bfloat16: rows by their lengths; packed rows of up to ``MASKED`` tokens by a mask (longer ones: xla)
    triton    Pallas for NVIDIA: rows with segment ids, queries and keys the same tokens (elsewhere, as cross-attention, xla)
    splash    Pallas for TPU: rows with segment ids
    plain     anywhere: whole rows at once, differentiated by JAX in every mode (``nn.attention_plain``)
    auto      by ``choose``: TPU splash; NVIDIA in bfloat16 cudnn; all else xla

Rows, and the shares of a plan, are computed by the device that holds them (``nn.shard_map``).
"""  # noqa: E501

from __future__ import annotations

import functools
from typing import Literal

import jax
import jax.numpy as jnp

from uniart_jax.config import Kernel
from uniart_jax.nn import attention_kernels, attention_plain, attention_xla
from uniart_jax.nn.gathers import flat_positions, take_rows
from uniart_jax.nn.segments import Bucket, Segments
from uniart_jax.nn.shard_map import on_single_device, shard_map_items

SHORT = 64  # keys below which a row is not worth a kernel's tile of 128
MASKED = 1024  # tokens of a packed row up to which a mask [L, L] may be made


def choose(
    kernel: Kernel,
    dtype: jnp.dtype,
    keys: int,
    backend: str | None = None,
    single: bool | None = None,
) -> Literal["xla", "cudnn", "triton", "splash", "plain"]:
    """The kernel that 'auto' stands for: the accelerator's own where rows have at least ``SHORT``
    keys, xla elsewhere; others unchanged.

    cuDNN computes in bfloat16, so it is taken only where the network does. XLA cannot split Pallas
    kernels for TPU over devices, so splash is taken where one device computes (``single``; default:
    as it is where this is called).
    """
    if kernel != "auto":
        return kernel
    backend = backend or jax.default_backend()
    if backend == "tpu" and keys >= SHORT and (on_single_device() if single is None else single):
        return "splash"
    if backend in ("gpu", "cuda") and keys >= SHORT and dtype == jnp.bfloat16:
        return "cudnn"
    return "xla"


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

    Returns:
      [S, Lq, N, H]; queries beyond ``query_lengths``, and all queries of a row without keys, are
      zero.
    """
    if not q.size or not k.size:
        return jnp.zeros(q.shape, v.dtype)
    given = (q, k, v, lengths, query_lengths)
    if lengths is query_lengths:  # some kernels need to know
        return shard_map_items(lambda q, k, v, n: _attend(q, k, v, n, n, kernel), given[:4])
    return shard_map_items(functools.partial(_attend, kernel=kernel), given)


def _attend(q, k, v, lengths, query_lengths, kernel: Kernel):
    if lengths is not None:
        valid = (jnp.arange(k.shape[1]) < lengths[:, None])[..., None, None]
        k, v = jnp.where(valid, k, 0), jnp.where(valid, v, 0)
    if query_lengths is not None:
        q_valid = (jnp.arange(q.shape[1]) < query_lengths[:, None])[..., None, None]
        q = jnp.where(q_valid, q, 0)
    chosen = choose(kernel, v.dtype, k.shape[1])
    if chosen == "triton" and (q.shape != k.shape or query_lengths is not lengths):
        chosen = "xla"
    if chosen == "cudnn":
        out = attention_kernels.cudnn(q, k, v, lengths, query_lengths)
    elif chosen == "triton":
        out = attention_kernels.triton(q, k, v, _key_ids(k, lengths))
    elif chosen in ("splash", "plain"):
        # all queries look at valid keys, or, where a row has none, at its first, which is zero
        some = None if lengths is None else jnp.maximum(lengths, 1)
        q_ids = jnp.zeros(q.shape[:2], jnp.int32)
        rows = attention_plain.attend_rows if chosen == "plain" else attention_kernels.splash
        out = rows(q, k, v, q_ids, _key_ids(k, some))
    else:
        out = _by_rows(q, k, v, None if lengths is None else _key_ids(k, lengths))
    if query_lengths is not None:
        out = jnp.where(q_valid, out, 0)
    return out


def attend_segments(qkv: jax.Array, segments: Segments, *, kernel: Kernel = "xla") -> jax.Array:
    """Self-attention of a batch's tokens within their segments.

    Args:
      qkv: [B * V, 3, N, H] queries, keys and values, flat.
      segments: their plan, of one or more shares.

    Returns:
      [B * V, N, H]; tokens of no segment (padding) are zero.

    Raises:
      ValueError: the plan is of another number of tokens.
    """
    shares = len(segments.inverse)
    if segments.inverse.size != len(qkv):
        raise ValueError(f"attention: {len(qkv)} tokens, but a plan of {segments.inverse.size}")

    def attend_shares(qkv, segments):
        flat = qkv.reshape(-1, *qkv.shape[2:])
        return _attend_segments(flat, _one_share(segments), kernel).reshape(
            *qkv.shape[:2], *qkv.shape[3:]
        )

    out = shard_map_items(attend_shares, (qkv.reshape(shares, -1, *qkv.shape[1:]), segments))
    return out.reshape(len(qkv), *qkv.shape[2:])


def _attend_segments(qkv: jax.Array, segments: Segments, kernel: Kernel) -> jax.Array:
    """``attend_segments`` by a plan without the axis of shares, as ``_one_share`` gives it."""
    longest = max(bucket.index.shape[1] for bucket in segments.buckets)
    chosen = choose(kernel, qkv.dtype, longest)
    packed = any(bucket.segment is not None for bucket in segments.buckets)
    if chosen == "xla" or (chosen == "cudnn" and packed and longest > MASKED):
        return attention_xla.attend_segments(qkv, segments)
    tokens, _, heads, size = qkv.shape
    flat = qkv.reshape(tokens, -1)
    done = []
    for bucket in segments.buckets:
        rows = take_rows(flat, bucket.index).reshape(*bucket.index.shape, 3, heads, size)
        q, k, v = (rows[:, :, i] for i in range(3))
        ids = _key_ids(k, bucket.length) if bucket.segment is None else bucket.segment
        if chosen == "cudnn":
            out = attention_kernels.cudnn(q, k, v, bucket.length, bucket.length, bucket.segment)
        elif chosen == "triton":
            out = attention_kernels.triton(q, k, v, jnp.asarray(ids))
        elif chosen == "plain":
            out = attention_plain.attend_rows(q, k, v, jnp.asarray(ids), jnp.asarray(ids))
        else:
            out = attention_kernels.splash(q, k, v, jnp.asarray(ids), jnp.asarray(ids))
        done.append(out.reshape(-1, heads * size))
    return take_rows(jnp.concatenate(done), segments.inverse).reshape(tokens, heads, size)


def _one_share(segments: Segments) -> Segments:
    """A plan of E shares -> of all their tokens as one, without the axis of shares: index [E S, L],
    length [E S], inverse [E T]."""
    shares, tokens = segments.inverse.shape
    if shares == 1:
        return jax.tree.map(lambda a: a[0], segments)
    buckets, parts = [], []
    here = there = 0  # where the bucket begins in a share's rows and in all
    for index, length, segment in segments.buckets:
        size = index.shape[1] * index.shape[2]
        within = segments.inverse - here
        start = there + jnp.arange(shares, dtype=within.dtype)[:, None] * size
        parts.append(((within >= 0) & (within < size), within + start))
        buckets.append(
            Bucket(
                flat_positions(index, tokens).reshape(-1, index.shape[2]),
                length.reshape(-1),
                None if segment is None else segment.reshape(-1, index.shape[2]),
            )
        )
        here, there = here + size, there + shares * size
    inverse = jnp.full_like(segments.inverse, there)
    for mine, position in parts:
        inverse = jnp.where(mine, position, inverse)
    return Segments(tuple(buckets), inverse.reshape(-1))


def _key_ids(k: jax.Array, lengths: jax.Array | None) -> jax.Array:
    """[S, Lk]: 0 where a key is valid, else -1."""
    if lengths is None:
        return jnp.zeros(k.shape[:2], jnp.int32)
    return jnp.where(jnp.arange(k.shape[1]) < jnp.asarray(lengths)[:, None], 0, -1)


def _by_rows(q: jax.Array, k: jax.Array, v: jax.Array, key_ids: jax.Array | None) -> jax.Array:
    rows, _, heads, size = q.shape
    q, k, v = (x.swapaxes(1, 2).reshape(rows * heads, -1, size) for x in (q, k, v))
    ids = None if key_ids is None else jnp.repeat(key_ids, heads, axis=0)
    out = attention_xla.attend_rows(q, k, v, ids)
    return out.reshape(rows, heads, -1, size).swapaxes(1, 2)

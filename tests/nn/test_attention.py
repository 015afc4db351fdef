import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from uniart_jax.nn import attention_xla
from uniart_jax.nn.attention import attend, attend_segments, choose
from uniart_jax.nn.blocks import RMSNorm, SelfAttention, layer_norm
from uniart_jax.nn.gathers import permute_rows
from uniart_jax.nn.segments import pack_segments, plan_segments, whole_rows

PALLAS = ["triton", "splash"]  # in interpret mode on a CPU
OTHERS = [*PALLAS, "plain"]
# logits at a time: blocks of queries, some rows of several, all rows
LOGITS = [1 << 6, 1 << 13, 1 << 20]


def arrays(*shape, count=3, seed=0):
    return list(np.random.default_rng(seed).normal(size=(count, *shape)).astype(np.float32))


def reference(q, k, v, lengths):
    out = np.zeros(q.shape)
    for s, n in enumerate(lengths):
        for h in range(q.shape[2]):
            logits = np.asarray(q[s, :, h]) @ np.asarray(k[s, :n, h]).T / np.sqrt(q.shape[-1])
            weights = np.exp(logits - logits.max(-1, keepdims=True))
            out[s, :, h] = weights / weights.sum(-1, keepdims=True) @ np.asarray(v[s, :n, h])
    return out


def plain(q, k, v, seen):
    """Attention by the book; seen [S, Lq, Lk]."""
    logits = jnp.einsum("slnh,smnh->snlm", q, k) / q.shape[-1] ** 0.5
    weights = jax.nn.softmax(jnp.where(seen[:, None], logits, -1e30))
    return jnp.einsum("snlm,smnh->slnh", weights, v)


def with_gradients(function, *x):
    """What a function gives and the gradients of its sines' sum, from one program."""

    def loss(*x):
        out = function(*x)
        return jnp.sin(out).sum(), out

    found, out = jax.jit(jax.grad(loss, tuple(range(len(x))), has_aux=True))(*x)
    return out, found


def gradients(function, *x):
    return with_gradients(function, *x)[1]


@pytest.mark.parametrize("logits", LOGITS)
def test_attend_is_softmax_attention(monkeypatch, logits):
    monkeypatch.setattr(attention_xla, "CPU_LOGITS", logits)
    q, k, v = arrays(3, 70, 2, 8)
    lengths = np.int32([70, 33, 1])
    out = jax.jit(attend)(q, k, v, lengths)
    np.testing.assert_allclose(out, reference(q, k, v, lengths), atol=1e-5)
    np.testing.assert_allclose(jax.jit(attend)(q, k, v), reference(q, k, v, [70] * 3), atol=1e-5)


@pytest.mark.parametrize("logits", LOGITS)
@pytest.mark.parametrize("keys", [40, 77])
def test_gradient_is_plain_attentions(monkeypatch, logits, keys):
    monkeypatch.setattr(attention_xla, "CPU_LOGITS", logits)
    (q,) = arrays(2, 40, 2, 8, count=1)
    k, v = arrays(2, keys, 2, 8, count=2, seed=1)
    lengths = np.int32([keys, 17])
    seen = np.broadcast_to((np.arange(keys) < lengths[:, None])[:, None], (2, 40, keys))
    ours = gradients(lambda q, k, v: attend(q, k, v, lengths), q, k, v)
    for a, b in zip(ours, gradients(lambda *x: plain(*x, seen), q, k, v), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-5)


@pytest.mark.parametrize("kernel", ["xla", *OTHERS])
def test_garbage_in_padding_reaches_nothing(monkeypatch, kernel):
    monkeypatch.setattr(attention_xla, "CPU_LOGITS", 1 << 9)
    q, k, v = arrays(3, 40, 2, 8)
    lengths = np.int32([40, 17, 0])
    padding = (np.arange(40) >= lengths[:, None])[..., None, None]
    clean = [np.where(padding, np.float32(0), x) for x in (q, k, v)]

    @jax.jit
    def run(q, k, v):
        return attend(q, k, v, lengths, query_lengths=lengths, kernel=kernel)

    gradient = jax.jit(jax.grad(lambda *x: jnp.square(run(*x)).sum(), (0, 1, 2)))
    for garbage in np.float32([1e6, np.nan, np.inf]):
        dirty = [np.where(padding, garbage, x) for x in (q, k, v)]
        np.testing.assert_array_equal(run(*dirty), run(*clean))
        assert not np.asarray(run(*dirty))[np.broadcast_to(padding, q.shape)].any()
        for a, b in zip(gradient(*dirty), gradient(*clean), strict=True):
            np.testing.assert_array_equal(a, b)
            assert np.isfinite(a).all()
            assert not np.asarray(a)[np.broadcast_to(padding, q.shape)].any()


@functools.cache
def on_rows(kernel, queries, keys, masked):
    """Attention of rows with all keys, one and none (``masked``), and its gradients."""
    (q,) = arrays(3, queries, 2, 16, count=1)
    k, v = arrays(3, keys, 2, 16, count=2, seed=1)
    lengths = np.int32([keys, 1, 0]) if masked else None

    return with_gradients(lambda *x: attend(*x, lengths, kernel=kernel), q, k, v)


@pytest.mark.parametrize("kernel", OTHERS)
@pytest.mark.parametrize(("queries", "keys"), [(130, 130), (64, 201)])
def test_kernels_agree_on_rows(kernel, queries, keys):
    """Odd lengths, a row of one key and one of none; forward and gradients."""
    for masked in (True, False):
        expected, found = (on_rows(name, queries, keys, masked) for name in ("xla", kernel))
        np.testing.assert_allclose(found[0], expected[0], atol=2e-5)
        for a, b in zip(found[1], expected[1], strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-4, atol=5e-5)


def plans(width=150, kinds=5):
    ids = np.random.default_rng(0).integers(0, kinds, (2, width))
    counts = np.array([width, width - 31])
    return {
        "one a row": plan_segments(ids, counts, ((2 * kinds + 3, 40), (2 * kinds, 70))),
        "packed": pack_segments(ids, counts, (40, 130)),
        "whole": whole_rows(ids, counts),
        "empty rows": pack_segments(ids, counts, (130,), rows=(7,)),
    }, (ids[:, :, None] == ids[:, None, :]) & (
        (np.arange(width) < counts[:, None])[:, None] & (np.arange(width) < counts[:, None])[..., None]  # noqa: E501
    )  # fmt: skip


@functools.cache
def masked_attention():
    """Queries, keys and values of ``plans``' tokens; what they attend to by the book, and its
    gradient."""
    seen = plans()[1]
    valid = seen.any(-1)[..., None, None, None]
    (qkv,) = arrays(2, 150, 3, 2, 16, count=1)

    def expected(x):
        out = plain(*(x.reshape(2, 150, 3, 2, 16)[:, :, i] for i in range(3)), seen)
        return jnp.where(valid[:, :, 0], out, 0).reshape(300, 2, 16)

    spoiled = np.where(valid, qkv, np.float32(np.nan))
    clean, dirty = (a.reshape(300, 3, 2, 16) for a in (qkv, spoiled))
    return dirty, *with_gradients(expected, clean)


WAYS = [*[("xla", n) for n in LOGITS], *[(k, 0) for k in OTHERS]]
BY_DAY = {  # every way with two kinds of plans, every kind with at least two ways
    "one a row": (WAYS[0], WAYS[2], WAYS[4]),
    "packed": (WAYS[0], WAYS[1], WAYS[3]),
    "whole": (WAYS[1], WAYS[5]),
    "empty rows": (WAYS[2], *WAYS[3:]),
}


@pytest.mark.parametrize(
    ("kind", "kernel", "logits"),
    [
        pytest.param(kind, *way, marks=() if way in BY_DAY[kind] else pytest.mark.slow)
        for kind in plans()[0]
        for way in WAYS
    ],
)
def test_segments_are_masked_attention(monkeypatch, kind, kernel, logits):
    """Every plan and kernel, forward and gradient, NaN in the padding; lengths are odd."""
    monkeypatch.setattr(attention_xla, "CPU_LOGITS", logits)
    plan = plans()[0][kind]
    dirty, out, (gradient,) = masked_attention()
    found, (slope,) = with_gradients(lambda x: attend_segments(x, plan, kernel=kernel), dirty)
    np.testing.assert_allclose(found, out, atol=2e-5)
    np.testing.assert_allclose(slope, gradient, atol=5e-5)


def test_long_attention_never_holds_all_logits():
    """2 x 4096 tokens: the logits of one head alone would be 64 MiB."""
    x = jax.ShapeDtypeStruct((2, 4096, 4, 16), jnp.float32)
    step = jax.grad(lambda q, k, v: attend(q, k, v).sum(), (0, 1, 2))
    memory = jax.jit(step).lower(x, x, x).compile().memory_analysis()
    assert memory.temp_size_in_bytes < 40 << 20


def test_auto_is_the_rule_that_is_written():
    f32, bf16 = jnp.dtype("float32"), jnp.dtype("bfloat16")
    assert choose("auto", f32, 4096, "cpu") == choose("auto", bf16, 4096, "cpu") == "xla"
    assert (
        choose("auto", bf16, 4096, "gpu") == "cudnn" and choose("auto", f32, 4096, "gpu") == "xla"
    )
    assert choose("auto", f32, 4096, "tpu", True) == "splash"
    assert choose("auto", f32, 8, "tpu", True) == choose("auto", f32, 4096, "tpu", False) == "xla"
    assert choose("splash", f32, 8, "cpu") == "splash"


def test_segments_attend_within_themselves_only():
    layer = SelfAttention(8, 2, nnx.Rngs(0))
    (x,) = arrays(2, 30, 8, count=1)
    ids = np.random.default_rng(0).integers(0, 4, (2, 30))
    counts = np.array([30, 19])
    plan = plan_segments(ids, counts, ((8, 6), (8, 40)))
    out = np.asarray(jax.jit(lambda x: layer(x, plan))(x))
    q, k, v = np.split(np.asarray(layer.to_qkv(x)).reshape(2, 30, 6, 4), 3, axis=2)
    for b, n in enumerate(counts):
        for i in range(4):
            chosen = np.flatnonzero((ids[b] == i) & (np.arange(30) < n))
            alone = reference(*(a[None, b, chosen] for a in (q, k, v)), [len(chosen)])
            alone = alone.reshape(-1, 8) @ np.asarray(layer.to_out.kernel[...])
            np.testing.assert_allclose(out[b, chosen], alone, atol=1e-5)
        assert not out[b, n:].any()


def test_segments_keep_nan_in_padding():
    (x,) = arrays(2, 30, 8, count=1)
    counts = np.array([30, 19])
    layer = SelfAttention(8, 2, nnx.Rngs(0))
    plan = plan_segments(np.zeros((2, 30), int), counts, ((2, 30),))
    dirty = np.where((np.arange(30) < counts[:, None])[..., None], x, np.float32(np.nan))
    run = jax.jit(lambda x: layer(x, plan))
    np.testing.assert_array_equal(run(dirty), run(x))
    gradient = jax.jit(jax.grad(lambda x: jnp.square(run(x)).sum()))
    np.testing.assert_array_equal(gradient(dirty), gradient(x))


def test_permuted_rows_have_a_gathered_gradient():
    (x,) = arrays(12, 3, count=1)
    plan = plan_segments(np.arange(12).reshape(2, 6) % 3, np.array([6, 4]), ((6, 3),))
    index, inverse = plan.buckets[0].index.reshape(-1), plan.inverse[0]
    expected = np.where((np.arange(12) < 10)[:, None], np.cos(x), 0)
    (found,) = gradients(lambda x: permute_rows(x, index, inverse), x)
    np.testing.assert_allclose(found, expected, atol=1e-6)
    assert "scatter" not in str(
        jax.make_jaxpr(jax.grad(lambda x: permute_rows(x, index, inverse).sum()))(x)
    )


@pytest.mark.parametrize("norm", [RMSNorm(2, 4), lambda x: layer_norm(x, 1e-6)])
def test_norms_have_finite_gradients_at_zero(norm):
    gradient = jax.jit(jax.grad(lambda x: norm(x).sum()))
    assert np.isfinite(gradient(np.zeros((3, 2, 4), np.float32))).all()


@pytest.mark.parametrize(("rows", "queries", "keys"), [(0, 3, 4), (2, 0, 4), (2, 3, 0)])
def test_nothing_to_attend_gives_nothing(rows, queries, keys):
    q, k = jnp.ones((rows, queries, 2, 8)), jnp.ones((rows, keys, 2, 8))
    out = attend(q, k, k)
    assert out.shape == q.shape and not np.asarray(out).any()

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from uniart_jax.nn import attention
from uniart_jax.nn.attention import attend, map_segments
from uniart_jax.nn.blocks import RMSNorm, SelfAttention, layer_norm
from uniart_jax.nn.segments import plan_segments


def arrays(*shape, count=3, seed=0):
    return [jax.random.normal(k, shape) for k in jax.random.split(jax.random.key(seed), count)]


def reference(q, k, v, lengths):
    out = np.zeros(q.shape)
    for s, n in enumerate(lengths):
        for h in range(q.shape[2]):
            logits = np.asarray(q[s, :, h]) @ np.asarray(k[s, :n, h]).T / np.sqrt(q.shape[-1])
            weights = np.exp(logits - logits.max(-1, keepdims=True))
            out[s, :, h] = weights / weights.sum(-1, keepdims=True) @ np.asarray(v[s, :n, h])
    return out


@pytest.mark.parametrize("cached", [1 << 6, 1 << 12, 1 << 18])
@pytest.mark.parametrize("dense", [512, 16])
def test_attend_is_softmax_attention(monkeypatch, cached, dense):
    monkeypatch.setattr(attention, "_CACHED_LOGITS", cached)
    monkeypatch.setattr(attention, "DENSE", dense)
    monkeypatch.setattr(attention, "CHUNK", 16)
    q, k, v = arrays(3, 70, 2, 8)
    lengths = jnp.array([70, 33, 1])
    out = jax.jit(attend)(q, k, v, lengths)
    np.testing.assert_allclose(out, reference(q, k, v, lengths), atol=1e-5)
    np.testing.assert_allclose(jax.jit(attend)(q, k, v), reference(q, k, v, [70] * 3), atol=1e-5)


@pytest.mark.parametrize("dense", [512, 16])
def test_gradient_is_plain_attentions(monkeypatch, dense):
    monkeypatch.setattr(attention, "DENSE", dense)
    monkeypatch.setattr(attention, "CHUNK", 16)
    q, k, v = arrays(2, 40, 2, 8)
    lengths = jnp.array([40, 17])

    def plain(q, k, v):
        logits = jnp.einsum("slnh,smnh->snlm", q, k) / 8**0.5
        logits = jnp.where((jnp.arange(40) < lengths[:, None])[:, None, None], logits, -jnp.inf)
        return jnp.einsum("snlm,smnh->slnh", jax.nn.softmax(logits), v)

    def through(function):
        return jax.jit(jax.grad(lambda *x: jnp.sin(function(*x)).sum(), (0, 1, 2)))(q, k, v)

    ours = through(lambda q, k, v: attend(q, k, v, lengths))
    for a, b in zip(ours, through(plain), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-5)


@pytest.mark.parametrize("dense", [512, 16])
def test_garbage_in_padding_reaches_nothing(monkeypatch, dense):
    monkeypatch.setattr(attention, "DENSE", dense)
    monkeypatch.setattr(attention, "CHUNK", 16)
    q, k, v = arrays(3, 40, 2, 8)
    lengths = jnp.array([40, 17, 0])
    padding = (jnp.arange(40) >= lengths[:, None])[..., None, None]
    clean = [jnp.where(padding, 0, x) for x in (q, k, v)]

    @jax.jit
    def run(q, k, v):
        return attend(q, k, v, lengths, query_lengths=lengths)

    gradient = jax.jit(jax.grad(lambda *x: jnp.square(run(*x)).sum(), (0, 1, 2)))
    for garbage in (1e6, jnp.nan, jnp.inf):
        dirty = [jnp.where(padding, garbage, x) for x in (q, k, v)]
        np.testing.assert_array_equal(run(*dirty), run(*clean))
        assert not np.asarray(run(*dirty))[np.broadcast_to(padding, q.shape)].any()
        for a, b in zip(gradient(*dirty), gradient(*clean), strict=True):
            np.testing.assert_array_equal(a, b)
            assert not np.asarray(a)[np.broadcast_to(padding, q.shape)].any()


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
    dirty = jnp.where((jnp.arange(30) < counts[:, None])[..., None], x, jnp.nan)
    run = jax.jit(lambda x: layer(x, plan))
    np.testing.assert_array_equal(run(dirty), run(x))
    gradient = jax.jit(jax.grad(lambda x: jnp.square(run(x)).sum()))
    np.testing.assert_array_equal(gradient(dirty), gradient(x))


def test_map_segments_gradient_without_scatter():
    (x,) = arrays(12, 3, count=1)
    plan = plan_segments(np.arange(12).reshape(2, 6) % 3, np.array([6, 4]), ((6, 3),))

    def function(x):
        return jnp.sin(map_segments(lambda rows, length: rows * 2, x, plan)).sum()

    expected = jnp.where((jnp.arange(12) < 10)[:, None], 2 * jnp.cos(2 * x), 0)
    np.testing.assert_allclose(jax.grad(function)(x), expected, atol=1e-6)


@pytest.mark.parametrize("norm", [RMSNorm(2, 4), lambda x: layer_norm(x, 1e-6)])
def test_norms_have_finite_gradients_at_zero(norm):
    gradient = jax.jit(jax.grad(lambda x: norm(x).sum()))
    assert np.isfinite(gradient(jnp.zeros((3, 2, 4)))).all()

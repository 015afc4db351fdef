"""Convolutions and pooling against XLA's and against loops (TRELLIS's single operations:
tests/parity)."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from uniart_jax.nn.convolution import (
    Halve,
    SubmanifoldConv,
    conv3,
    depth_to_space,
    space_to_depth,
    submanifold,
)
from uniart_jax.nn.embeddings import position_embedding
from uniart_jax.nn.gathers import flat_positions
from uniart_jax.nn.grids import FlowPlan, plan_neighbors, plan_pool
from uniart_jax.nn.pooling import (
    align_volume,
    at_cells,
    downsample,
    from_cells,
    repeat_plan,
    to_cells,
    upsample,
)

CLOSE = dict(rtol=1e-4, atol=1e-5)
DENSE = ("NDHWC", "DHWIO", "NDHWC")


def normal(*shape, seed=0):
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


def test_conv3_is_xlas():
    x, kernel = normal(2, 5, 4, 6, 3), normal(3, 3, 3, 3, 7, seed=1)

    def xla(x, kernel):
        return jax.lax.conv_general_dilated(x, kernel, (1,) * 3, "SAME", dimension_numbers=DENSE)

    @functools.partial(jax.jit, static_argnums=0)
    def run(convolve, x, kernel):
        def loss(x, kernel):
            out = convolve(x, kernel)
            return jnp.sin(out).sum(), out

        return jax.grad(loss, (0, 1), has_aux=True)(x, kernel)

    (ours, found), (theirs, expected) = (run(f, x, kernel) for f in (conv3, xla))
    np.testing.assert_allclose(found, expected, **CLOSE)
    for a, b in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-4)


def test_halving_is_xlas_stride_two():
    x, layer = normal(2, 4, 6, 8, 3), Halve(3, 5, nnx.Rngs(0))

    @jax.jit
    def xla(x):
        kernel = layer.kernel[...]
        out = jax.lax.conv_general_dilated(x, kernel, (2,) * 3, "VALID", dimension_numbers=DENSE)
        return out + layer.bias[...]

    np.testing.assert_allclose(jax.jit(layer)(x), xla(x), **CLOSE)


def test_space_to_depth_orders():
    x = normal(1, 4, 4, 4, 3)
    folded = np.asarray(space_to_depth(x, 2)).reshape(1, 2, 2, 2, 2, 2, 2, 3)
    np.testing.assert_array_equal(folded[0, 1, 0, 1, 0, 1, 1], x[0, 2, 1, 3])
    again = jax.jit(lambda x: depth_to_space(space_to_depth(x, 2), 2))(x[..., :1])
    np.testing.assert_array_equal(again, x[..., :1])


def sparse(seed=0, items=2, width=60, side=4, channels=5):
    rng = np.random.default_rng(seed)
    counts = np.array([width - 7, width // 2], np.int32)[:items]
    coords = np.zeros((items, width, 3), np.int32)
    for b, n in enumerate(counts):
        chosen = np.sort(rng.choice(side**3, n, replace=False))
        coords[b, :n] = np.stack(np.unravel_index(chosen, (side,) * 3), -1)
    x = rng.normal(size=(items, width, channels)).astype(np.float32)
    x[np.arange(width) >= counts[:, None]] = 0
    return coords, counts, x


@pytest.mark.parametrize("outputs", [6, 3])  # gathered before the product, and after it
def test_submanifold_conv_is_the_dense_one_at_active_voxels(outputs):
    coords, counts, x = sparse()
    layer = SubmanifoldConv(5, outputs, nnx.Rngs(0))
    out = jax.jit(layer)(x, plan_neighbors(coords, counts))
    dense_conv = jax.jit(conv3)
    kernel, bias = np.asarray(layer.kernel[...]), np.asarray(layer.bias[...])
    for b, n in enumerate(counts):
        dense = np.zeros((1, 4, 4, 4, 5), np.float32)
        dense[(0, *coords[b, :n].T)] = x[b, :n]
        expected = np.asarray(dense_conv(dense, kernel.reshape(3, 3, 3, 5, outputs))) + bias
        expected = expected[(0, *coords[b, :n].T)]
        np.testing.assert_allclose(out[b, :n], expected, **CLOSE)


def test_gathers_have_the_gradients_of_plain_indexing():
    coords, counts, x = sparse()
    pool = plan_pool(coords, counts, 2, 8)
    rows = x.reshape(-1, 5)

    def plain(index):
        return lambda r: jnp.take(r, index, axis=0, mode="fill", fill_value=0)

    pairs = [
        (lambda r: to_cells(r.reshape(x.shape), pool), plain(flat_positions(pool.children, 60))),
    ]
    for ours, reference in pairs:
        weights = normal(*jax.eval_shape(reference, rows).shape)
        a, b = (
            jax.jit(jax.grad(lambda r: (f(r) * weights).sum()))(rows)  # noqa: B023
            for f in (ours, reference)
        )
        valid = (np.arange(60) < counts[:, None]).reshape(-1)
        np.testing.assert_allclose(a[valid], b[valid], **CLOSE)


@pytest.mark.parametrize("outputs", [6, 3])
def test_submanifold_gradients_are_those_of_gathered_columns(outputs):
    coords, counts, x = sparse()
    neighbors = flat_positions(plan_neighbors(coords, counts), 60).reshape(-1, 27)
    rows, kernel, weights = x.reshape(-1, 5), normal(27, 5, outputs), normal(x.size // 5, outputs)

    def columns(rows, kernel):
        found = jnp.take(rows, neighbors, axis=0, mode="fill", fill_value=0)
        return (jnp.einsum("tkc,kcd->td", found, kernel) * weights).sum()

    def ours(rows, kernel):
        return (submanifold(rows, kernel, neighbors) * weights).sum()

    valid = (np.arange(60) < counts[:, None]).reshape(-1)
    for a, b, which in zip(
        *(jax.jit(jax.grad(f, (0, 1)))(rows, kernel) for f in (ours, columns)),
        (valid, ...),
        strict=True,
    ):
        np.testing.assert_allclose(a[which], b[which], **CLOSE)


def test_pooling_round_trip_and_its_odd_mean():
    coords, counts, x = sparse()
    pool = plan_pool(coords, counts, 2, 8)
    round_trip = jax.jit(lambda x, pool: from_cells(to_cells(x, pool), pool))
    np.testing.assert_array_equal(round_trip(x, pool), x)
    cells = np.asarray(jax.jit(downsample)(x, pool))
    for b, n in enumerate(counts):
        for i, cell in enumerate(pool.coords[b, : pool.counts[b]]):
            inside = np.asarray(x[b, :n])[(coords[b, :n] // 2 == cell).all(-1)]
            np.testing.assert_allclose(cells[b, i], inside.sum(0) / (len(inside) + 1), **CLOSE)
    back = np.asarray(jax.jit(upsample)(cells, pool))
    assert not back[np.arange(60) >= counts[:, None]].any()
    parent = (coords[0, 0] // 2 == pool.coords[0, : pool.counts[0]]).all(-1).argmax()
    np.testing.assert_array_equal(back[0, 0], cells[0, parent])


def test_repeated_plan_is_the_plan_of_the_repeated_batch():
    coords, counts, _ = sparse()
    plan = FlowPlan((plan_pool(coords, counts, 2, 8),), (plan_neighbors(coords, counts),))
    again = np.repeat(coords, 3, axis=0), np.repeat(counts, 3)
    expected = FlowPlan((plan_pool(*again, 2, 8),), (plan_neighbors(*again),))
    jax.tree.map(np.testing.assert_array_equal, repeat_plan(plan, 3), expected)


def test_volume_is_aligned():
    volume = normal(2, 4, 4, 4, 3)
    align = jax.jit(align_volume, static_argnums=1)
    np.testing.assert_array_equal(align(volume, 4), volume)
    joined = np.asarray(align(volume, 2))
    np.testing.assert_array_equal(joined[0, 1, 0, 1, :3], volume[0, 2, 0, 2])
    finer = np.asarray(align(volume, 8))
    np.testing.assert_array_equal(finer[1, 7, 2, 5], volume[1, 3, 1, 2])
    coords = np.int32([[[3, 1, 2]], [[0, 0, 1]]])
    found = np.asarray(jax.jit(at_cells)(volume, coords))
    np.testing.assert_array_equal(found[1, 0], volume[1, 0, 0, 1])


def test_padding_never_matters_to_convolution_and_pooling():
    coords, counts, x = sparse()
    wide = np.pad(coords, ((0, 0), (0, 9), (0, 0)))
    dirty = np.pad(x, ((0, 0), (0, 9), (0, 0)))
    dirty = np.where((np.arange(69) < counts[:, None])[..., None], dirty, np.float32(np.nan))
    layer, pooled = jax.jit(SubmanifoldConv(5, 6, nnx.Rngs(0))), jax.jit(downsample)
    a = layer(x, plan_neighbors(coords, counts))
    b = layer(dirty, plan_neighbors(wide, counts))
    pools = plan_pool(coords, counts, 2, 8), plan_pool(wide, counts, 2, 20)
    c, d = pooled(x, pools[0]), pooled(dirty, pools[1])
    a, b, c, d = (np.asarray(values) for values in (a, b, c, d))
    for i, n in enumerate(counts):
        np.testing.assert_array_equal(a[i, :n], b[i, :n])
        m = pools[0].counts[i]
        np.testing.assert_array_equal(c[i, :m], d[i, :m])
    assert np.isfinite(d).all()


@pytest.mark.parametrize("width", [5, 7, 96])
def test_position_embedding_pads_with_zeros(width):
    out = np.asarray(position_embedding(np.ones((2, 3)), width))
    used = 6 * (width // 3 // 2)
    assert out.shape == (2, width) and not out[:, used:].any()

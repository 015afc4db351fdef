"""Legs as a set: they leave the parts as they are, and mirror and permute as a set does."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drawn import parameters
from flax import nnx

from uniart_jax.config import LayoutConfig, ModelConfig
from uniart_jax.models.leg_decoder import ROW, RUNS, LegDecoder, Seen, corners_of
from uniart_jax.models.network import build

SMALL = LayoutConfig(
    queries=5, image_size=64, backbone="convolutions", map_channels=8, width=16, layers=2, heads=2,
    sketch_width=12, head_width=12, legs=8,
)  # fmt: skip
NETWORK = build("layout", ModelConfig(layout=SMALL))
IMAGE = jax.random.uniform(jax.random.key(1), (2, 64, 64, 3))


@pytest.fixture(scope="module")
def params():
    return parameters(NETWORK)


def test_legs_come_with_the_parts_and_leave_them_as_they_are(params):
    out = jax.jit(NETWORK.apply)(params, IMAGE)
    legs = out.pop("legs")
    assert [row.shape for row in legs["rows"]] == [(2, 8, ROW)] * (RUNS + 1)
    for name in ("exists", "plinth", "fill"):
        assert [value.shape for value in legs[name]] == [(2, 8)] * (RUNS + 1)
    assert legs["alone"].shape == (2,)
    without = build("layout", ModelConfig(layout=dataclasses.replace(SMALL, legs=0)))
    bare = jax.jit(without.apply)({k: v for k, v in params.items() if k != "legs"}, IMAGE)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-6), out, bare)


def test_they_see_the_parts(params):
    decoder = LegDecoder(NETWORK.config, nnx.Rngs(0), jnp.float32)
    size, width = SMALL.image_size // 4, SMALL.width
    draw = lambda *shape: jax.random.normal(jax.random.key(sum(shape)), shape)  # noqa: E731
    seen = Seen(
        map=draw(1, size, size, SMALL.map_channels),
        tokens=draw(1, 9, width),
        tokens_place=draw(9, width),
        sketch=draw(1, SMALL.sketch_width),
        parts=draw(1, 5, width),
        parts_place=draw(1, 5, width),
        camera=jnp.array([[0.0, 1, 0.3, 1, 0.2, 0, 0]]),
    )
    nnx.update(decoder, jax.tree.map(lambda x: x + 0.1, nnx.state(decoder)))
    rows = decoder(seen)["rows"][-1]
    for name in ("map", "tokens", "sketch", "parts", "parts_place", "camera"):
        other = decoder(seen._replace(**{name: getattr(seen, name) * 0.5}))["rows"][-1]
        assert np.abs(np.asarray(other) - np.asarray(rows)).max() > 1e-4, name


def test_their_loss_trains_nothing_else(params):
    def loss(params):
        legs = NETWORK.apply(params, IMAGE)["legs"]
        return sum(jnp.square(x - 0.3).sum() for x in jax.tree.leaves(legs))

    gradient = jax.jit(jax.grad(loss))(params)
    size = lambda tree: float(sum(jnp.abs(x).sum() for x in jax.tree.leaves(tree)))  # noqa: E731
    assert size(gradient.pop("legs")) > 1 and size(gradient) == 0


def test_queries_are_a_set(params):
    order = np.array([3, 0, 7, 5, 1, 4, 6, 2])
    legs = params["legs"]
    other = {**legs, "queries": legs["queries"][order], "anchors": legs["anchors"][order]}
    run = jax.jit(NETWORK.apply)
    one, two = (run({**params, "legs": p}, IMAGE)["legs"] for p in (legs, other))
    for name in ("rows", "exists", "plinth", "fill"):
        a, b = np.asarray(one[name][-1])[:, order], two[name][-1]
        np.testing.assert_allclose(a, b, atol=2e-4)
    np.testing.assert_allclose(one["alone"], two["alone"], atol=2e-4)


def test_the_box_around_a_leg_that_leans():
    row = jnp.array([0.0, 0.1, 0.2, 0.3, -0.1, 0.15, 0.1, 0.4, -0.5, -0.2])
    np.testing.assert_allclose(corners_of(row), [-0.1, 0.1, -0.5, 0.2, 0.4, -0.2], rtol=1e-6)

"""The layout network: one set of weights for every picture size, and a last layer that is run
again."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drawn import parameters

from uniart_jax.config import LayoutConfig, ModelConfig
from uniart_jax.models.layout import resize
from uniart_jax.models.network import build

SMALL = LayoutConfig(
    queries=5, image_size=64, backbone="convolutions", map_channels=8, width=16, layers=2, heads=2,
    sketch_width=12, head_width=12,
)  # fmt: skip


def make(**changes):
    return build("layout", ModelConfig(layout=dataclasses.replace(SMALL, **changes)))


@pytest.fixture(scope="module")
def params():
    return parameters(make())


def look(params, image, **changes):
    return jax.jit(make(**changes).apply)(params, image)


def test_the_same_weights_see_pictures_of_every_size(params):
    shapes = jax.tree.map(jnp.shape, params)
    for side in (32, 64, 96):
        assert jax.tree.map(jnp.shape, make(image_size=side).abstract()) == shapes
        picture = jax.ShapeDtypeStruct((2, side, side, 3), np.float32)
        out = jax.eval_shape(make(image_size=side).apply, params, picture)
        assert out["map"].shape[1] == side // 4 and out["parts"][-1]["corners"].shape == (2, 5, 6)
    with pytest.raises(ValueError, match="image_size that 32 divides and repeats >= 0, got 5, 48"):
        make(image_size=48).abstract()


def test_a_resized_map_keeps_what_is_constant_and_what_has_the_size():
    x = np.ones((2, 6, 6, 3), np.float32)
    assert resize(x, 6) is x
    run = jax.jit(resize, static_argnums=1)
    same = run(np.full((1, 12, 12, 2), 3, np.float32), 8)
    np.testing.assert_allclose(same, 3.0, rtol=1e-6)
    # columns stay columns, rows rows
    ramp = np.tile(np.arange(12, dtype=np.float32)[None, :, None, None], (1, 1, 12, 1))
    small = np.asarray(run(ramp, 4))[0, :, :, 0]
    assert (np.diff(small, axis=0) > 2).all() and np.abs(np.diff(small, axis=1)).max() < 1e-5


def test_repeats_run_the_last_layer_again_with_the_same_weights(params):
    image = np.random.default_rng(2).random((2, 64, 64, 3), np.float32)
    once, twice = look(params, image), look(params, image, repeats=2)
    assert jax.tree.map(jnp.shape, make(repeats=2).abstract()) == jax.tree.map(jnp.shape, params)
    assert (len(once["parts"]), len(twice["parts"])) == (3, 5)
    for a, b in zip(once["parts"], twice["parts"], strict=False):
        np.testing.assert_allclose(a["corners"], b["corners"], atol=1e-5)
    before, after = (np.asarray(part["corners"]) for part in twice["parts"][2:4])
    moved = np.abs(after - before).max()
    assert moved > 1e-3

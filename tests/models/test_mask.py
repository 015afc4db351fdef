"""The mask network: its shapes, what a pixel's logit may depend on, and cells as pixels again."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from copies import replaced
from drawn import parameters

from uniart_jax.config import MaskConfig, ModelConfig
from uniart_jax.models.mask import CELL, cells_of, pixels_of
from uniart_jax.models.network import build

MODEL = ModelConfig(mask=MaskConfig(channels=8, width=16, image_size=64))


@pytest.fixture(scope="module")
def network():
    return build("mask", MODEL)


@pytest.fixture(scope="module")
def params(network):
    return parameters(network)


@pytest.fixture(scope="module")
def look(network):
    apply = jax.jit(network.apply)
    return lambda *given: jax.device_get(apply(*given))


def pictures():
    return np.random.default_rng(0).random((2, 64, 64, 3), np.float32)


def test_a_logit_a_pixel_and_gradients_everywhere(network, params):
    image = pictures()

    @jax.jit
    def run(params):
        def loss(params):
            logits = network.apply(params, image)
            return jnp.square(logits).mean(), logits

        return jax.grad(loss, has_aux=True)(params)

    gradient, logits = jax.device_get(run(params))
    assert logits.shape == (2, 64, 64) and logits.dtype == jnp.float32
    assert all(np.isfinite(g).all() and g.any() for g in jax.tree.leaves(gradient))


def test_items_of_a_batch_do_not_see_each_other(look, params):
    image = pictures()
    both = look(params, image)
    other = look(params, replaced(image, 0, 0.5))
    np.testing.assert_allclose(both[1], other[1], atol=1e-5)
    assert np.abs(both[0] - other[0]).max() > 1e-3


def test_a_pixel_sees_the_whole_picture(look, params):
    """Which of two things is the object cannot be told nearby."""
    image = pictures()
    far = look(params, replaced(image, np.s_[:, -8:, -8:], 0))
    assert np.abs(look(params, image) - far)[:, :4, :4].min() > 0


def test_cells_hold_their_own_pixels():
    image = np.arange(2 * 8 * 8 * 3, dtype=np.float32).reshape(2, 8, 8, 3)
    cells = np.asarray(cells_of(image, CELL))
    assert cells.shape == (2, 2, 2, 48)
    np.testing.assert_array_equal(cells[1, 0, 1].reshape(4, 4, 3), image[1, :4, 4:])
    np.testing.assert_array_equal(pixels_of(cells, CELL), image)


def test_sizes_that_cannot_be_are_refused():
    for changes in ({"channels": 12}, {"channels": 8, "image_size": 48}):
        model = ModelConfig(mask=MaskConfig(**changes))
        with pytest.raises(ValueError, match="mask: needs channels that 8 divides"):
            build("mask", model).abstract()

"""TRELLIS's Gaussian head at toy size: padding, where Gaussians may lie, activations by hand."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from toy import build, finite, init, vae_config, voxel_batch

from uniart_jax.config import GaussianConfig
from uniart_jax.models.gaussian_decoder import (
    VALUES,
    activated,
    gaussian_parameters,
    offset_perturbation,
)
from uniart_jax.voxels.typed_batches import VoxelBatch

CONFIG = GaussianConfig(num_gaussians=3)


@pytest.mark.parametrize(
    "attention", ["swin", *(pytest.param(a, marks=pytest.mark.slow) for a in ("serial", "full"))]
)
def test_padding_never_matters(attention):
    changes = dict(attention=attention, window=16 if attention == "serial" else 4, linear_path=True)
    model = dataclasses.replace(vae_config(**changes), gaussians=CONFIG)
    network = build("gaussian_decoder", model)
    params = init(network)
    assert set(params) == {"input_layer", "blocks", "out_layer"}  # no linear path in TRELLIS

    @jax.jit
    def step(params, latent, batch):
        def loss(params):
            raw = network.apply(params, latent, batch)
            return jnp.square(raw).sum(), raw

        return jax.grad(loss, has_aux=True)(params)

    def run(**options):
        batch = voxel_batch(model, **options)
        kept = VoxelBatch(batch.coords, batch.counts, plans=batch.plans)
        return step(params, batch.latent, kept)

    clean_gradient, clean = run()
    assert clean.shape == (2, 70, 3 * VALUES) and finite(clean_gradient)
    for width, garbage in ((70, np.nan), (83, 1e5)):
        gradient, raw = run(width=width, garbage=garbage)
        for b, n in enumerate((61, 37)):
            np.testing.assert_allclose(raw[b, :n], clean[b, :n], rtol=1e-4, atol=1e-5)
            assert not np.asarray(raw)[b, n:].any()
        for a, b in zip(*map(jax.tree.leaves, (gradient, clean_gradient)), strict=True):
            np.testing.assert_allclose(a, b, rtol=2e-3, atol=2e-3 * np.abs(b).max())


def test_raw_values_fall_into_their_places():
    raw = np.zeros((1, 2, 3 * VALUES), np.float32)
    raw[0, 1] = np.arange(3 * VALUES)
    coords = np.array([[[0, 0, 0], [4, 5, 6]]])
    config = dataclasses.replace(CONFIG, perturb_offset=False)
    found = jax.device_get(
        jax.jit(lambda *given: gaussian_parameters(*given, config, 8))(raw, coords)
    )
    assert {name: value.shape for name, value in found.items()} == {
        "xyz": (1, 6, 3),
        "features_dc": (1, 6, 1, 3),
        "scaling": (1, 6, 3),
        "rotation": (1, 6, 4),
        "opacity": (1, 6, 1),
    }
    second = {name: value[0, 3:] for name, value in found.items()}  # of the second voxel
    np.testing.assert_array_equal(second["features_dc"].ravel(), np.arange(9, 18))
    np.testing.assert_array_equal(second["scaling"].ravel(), np.arange(18, 27))
    np.testing.assert_allclose(second["rotation"].ravel(), np.arange(27, 39) * 0.1, rtol=1e-6)
    np.testing.assert_array_equal(second["opacity"].ravel(), np.arange(39, 42))
    np.testing.assert_allclose(found["xyz"][0, :3], 0.5 / 8)
    expected = (np.array([4, 5, 6]) + 0.5 + 0.75 * np.tanh(np.arange(9).reshape(3, 3))) / 8
    np.testing.assert_allclose(second["xyz"], expected, rtol=1e-6)


def test_fresh_gaussians_are_spread_within_their_voxel():
    config = GaussianConfig()
    raw, coords = np.zeros((1, 32 * VALUES), np.float32), np.zeros((1, 3), np.int32)
    found = jax.jit(lambda *given: gaussian_parameters(*given, config, 4))(raw, coords)
    spread = np.asarray(found["xyz"]) * 4
    assert spread.shape == (32, 3) and spread.min() >= -1e-6 and spread.max() < 1
    # a Hammersley set: the first axis even, the second base 2
    np.testing.assert_allclose(spread[:, 0], np.arange(32) / 32, atol=1e-6)
    np.testing.assert_allclose(spread[:4, 1], [0, 0.5, 0.25, 0.75], atol=1e-6)
    np.testing.assert_allclose(spread[:4, 2], [0, 1 / 3, 2 / 3, 1 / 9], atol=1e-6)
    assert not offset_perturbation(dataclasses.replace(config, perturb_offset=False)).any()


@pytest.mark.parametrize("activation", ["softplus", "exp"])
def test_raw_zero_is_the_bias(activation):
    config = dataclasses.replace(CONFIG, scaling_activation=activation)
    raw, coords = np.zeros((1, 3 * VALUES), np.float32), np.zeros((1, 3), np.int32)
    make, drawn = (
        jax.jit(lambda *given: gaussian_parameters(*given, config, 4)),
        jax.jit(lambda parameters: activated(parameters, config)),
    )
    parameters = jax.device_get(make(raw, coords))
    seen = jax.device_get(drawn(parameters))
    np.testing.assert_allclose(seen["scaling"], np.hypot(0.004, 0.0009), rtol=1e-4)
    np.testing.assert_allclose(seen["opacity"], 0.1, rtol=1e-5)
    np.testing.assert_allclose(seen["rotation"], np.tile([1.0, 0, 0, 0], (3, 1)))
    np.testing.assert_allclose(seen["xyz"], parameters["xyz"] - 0.5)
    half = {**parameters, "rotation": np.float32([[1, 2, 0, 0]] * 3)}
    expected = [[0.5**0.5, 0.5**0.5, 0, 0]] * 3
    np.testing.assert_allclose(drawn(half)["rotation"], expected, rtol=1e-6)
    gradient = jax.jit(
        jax.grad(lambda r: activated({**parameters, "rotation": r}, config)["rotation"].sum())
    )
    assert finite(gradient(np.float32([[-1, 0, 0, 0]])))  # a quaternion of length 0

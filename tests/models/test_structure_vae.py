"""The structure VAE at toy size."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from toy import MODEL, build, finite, init

from uniart_jax.nn.blocks import GroupNorm


def test_structure_vae():
    network = build("structure_vae", MODEL)
    occupancy = (np.random.default_rng(0).random((2, 8, 8, 8)) > 0.5).astype(np.float32)
    out = jax.jit(network.apply)(init(network), occupancy, jax.random.key(0))
    assert out["mean"].shape == out["latent"].shape == (2, 2, 2, 2, 3)
    assert out["logits"].shape == (2, 8, 8, 8) and finite(out)
    assert np.abs(out["latent"] - out["mean"]).max() > 0


def test_group_norm_is_the_last_norm_only():
    """The same names and shapes; other numbers; an item's are its own."""
    layer = dataclasses.replace(MODEL.structure_vae, patch_size=1, channels=(32, 64))
    group = dataclasses.replace(layer, norm="group")
    plain, grouped = (
        build("structure_vae", dataclasses.replace(MODEL, structure_vae=c)) for c in (layer, group)
    )
    params = init(plain)
    assert jax.tree.map(jnp.shape, params) == jax.tree.map(jnp.shape, grouped.abstract())
    occupancy = (np.random.default_rng(0).random((2, 8, 8, 8)) > 0.5).astype(np.float32)
    apply = jax.jit(grouped.apply)
    out = jax.device_get(apply(params, occupancy))
    assert finite(out) and out["logits"].shape == (2, 8, 8, 8)
    assert np.abs(out["logits"] - jax.jit(plain.apply)(params, occupancy)["logits"]).max() > 1e-2
    other = apply(params, occupancy[[1, 1]])  # beside another item
    np.testing.assert_allclose(out["logits"][1], other["logits"][1], rtol=1e-3, atol=1e-3)


def test_group_norm_by_hand():
    x = np.random.default_rng(0).normal(2, 3, (2, 3, 3, 3, 8)).astype(np.float32)
    norm = GroupNorm(8, groups=4)
    grouped = x.reshape(2, 27, 4, 2)
    mean, variance = (f(grouped, axis=(1, 3), keepdims=True) for f in (np.mean, np.var))
    expected = ((grouped - mean) / np.sqrt(variance + 1e-5)).reshape(x.shape)
    np.testing.assert_allclose(jax.jit(lambda x: norm(x))(x), expected, atol=1e-5)
    norm.scale[...], norm.bias[...] = np.arange(8, dtype=np.float32), np.full(8, -1, np.float32)
    other = jax.jit(lambda x: norm(x))(x)
    np.testing.assert_allclose(other, expected * np.arange(8) - 1, atol=1e-4)
    with pytest.raises(ValueError, match="6 channels do not divide into 32 groups"):
        GroupNorm(6)

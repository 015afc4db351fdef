"""The structure VAE at toy size."""

import jax
import numpy as np
from toy import MODEL, finite, init

from uniart_jax.models.network import build


def test_structure_vae():
    network = build("structure_vae", MODEL)
    occupancy = (np.random.default_rng(0).random((2, 8, 8, 8)) > 0.5).astype(np.float32)
    out = jax.jit(network.apply)(init(network), occupancy, jax.random.key(0))
    assert out["mean"].shape == out["latent"].shape == (2, 2, 2, 2, 3)
    assert out["logits"].shape == (2, 8, 8, 8) and finite(out)
    assert np.abs(out["latent"] - out["mean"]).max() > 0

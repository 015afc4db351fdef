"""Both flows at toy size: padding never matters, draws share their image, what prediction of the sample means."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from toy import MODEL, finite, flow_arguments, init, latent_config, voxel_batch

from uniart_jax.models.network import build
from uniart_jax.nn.grids import flow_plan


def test_structure_flow_draws_share_their_image():
    network = build("structure_flow", MODEL)
    params = init(network)
    tokens, volume, t = flow_arguments(3)
    x = jnp.asarray(np.random.default_rng(1).normal(size=(6, 2, 2, 2, 3)), jnp.float32)
    apply = jax.jit(network.apply)
    shared = apply(params, x, t, tokens, volume)
    alone = apply(params, x, t, jnp.repeat(tokens, 3, 0), jnp.repeat(volume, 3, 0))
    assert shared.shape == x.shape
    np.testing.assert_allclose(shared, alone, rtol=1e-3, atol=1e-4)
    other = apply(params, x, t, tokens, volume.at[0].add(volume[1]))
    assert np.abs(other - shared)[:3].max() > 1e-3 and not np.abs(other - shared)[3:].any()


def test_flow_that_needs_a_volume_says_so():
    network = build("structure_flow", MODEL)
    tokens, _, t = flow_arguments()
    with pytest.raises(ValueError, match="volume"):
        network.apply(init(network), jnp.zeros((2, 2, 2, 2, 3)), t, tokens)


@pytest.mark.parametrize(
    ("stem", "voxel_channels"), [("patch", 0), ("patch", 8), ("conv", 0)], ids=str
)
def test_latent_flow_ignores_padding(stem, voxel_channels):
    model = latent_config(
        stem=stem,
        io_channels=(6,) if stem == "conv" else (),
        share_mod=stem == "patch",
        voxel_channels=voxel_channels,
    )
    network = build("latent_flow", model)
    params = init(network)
    tokens, volume, t = flow_arguments()

    @jax.jit
    def step(params, x, coords, counts, plan):
        def loss(params):
            v = network.apply(params, x, t, tokens, volume, coords=coords, counts=counts, plan=plan)
            return jnp.square(v).sum(), v

        return jax.grad(loss, has_aux=True)(params)

    def run(**kwargs):
        batch = voxel_batch(model, **kwargs)
        plan = flow_plan(batch["coords"], batch["counts"], model.latent_flow, model.grid)
        return step(params, batch["latent"], batch["coords"], batch["counts"], plan)

    clean_gradient, clean = run()
    assert clean.shape == (2, 70, 4) and finite(clean_gradient)
    assert np.abs(clean).max() > 0
    for width, garbage in ((70, np.nan), (83, 1e5)):
        gradient, v = run(width=width, garbage=garbage)
        for b, n in enumerate((61, 37)):
            np.testing.assert_allclose(v[b, :n], clean[b, :n], rtol=1e-3, atol=1e-3)
            assert not np.asarray(v)[b, n:].any()
        for a, b in zip(*map(jax.tree.leaves, (gradient, clean_gradient)), strict=True):
            np.testing.assert_allclose(a, b, rtol=5e-3, atol=5e-3 * np.abs(b).max())


def test_latent_flow_draws_share_voxels():
    network = build("latent_flow", MODEL)
    params = init(network)
    tokens, volume, t = flow_arguments(2)
    batch = voxel_batch(MODEL)
    x = jnp.asarray(np.random.default_rng(1).normal(size=(4, 70, 4)), jnp.float32)
    apply = jax.jit(network.apply)

    def run(coords, counts):
        plan = flow_plan(coords, counts, MODEL.latent_flow, MODEL.grid)
        return apply(params, x, t, tokens, volume, coords=coords, counts=counts, plan=plan)

    shared = run(batch["coords"], batch["counts"])
    alone = run(np.repeat(batch["coords"], 2, 0), np.repeat(batch["counts"], 2))
    np.testing.assert_allclose(shared, alone, rtol=1e-4, atol=1e-4)


def test_conv_stem_levels_must_match_the_patch_size():
    with pytest.raises(ValueError, match="patch_size"):
        build("latent_flow", latent_config(stem="conv", io_channels=(6, 6))).abstract()


def test_data_prediction_is_the_velocity_of_the_predicted_sample():
    network = build("structure_flow", MODEL)
    params = init(network)
    params["out_layer"] = jax.tree.map(jnp.zeros_like, params["out_layer"])
    tokens, volume, _ = flow_arguments()
    x = jnp.ones((2, 2, 2, 2, 3))
    v = jax.jit(network.apply)(params, x, jnp.array([0.5, 0.01]), tokens, volume)
    np.testing.assert_allclose(v[0], 2.0, rtol=1e-6)
    np.testing.assert_allclose(v[1], 20.0, rtol=1e-6)


def test_a_flow_that_predicts_the_sample_is_shown_no_noise_where_there_is_nothing_else():
    network = build("structure_flow", MODEL)
    params = init(network)
    tokens, volume, _ = flow_arguments()
    rng = np.random.default_rng(1)
    first, second = (jnp.asarray(rng.normal(size=(2, 2, 2, 2, 3)), jnp.float32) for _ in range(2))
    apply = jax.jit(network.apply)

    def sample(x, t):
        return x - t * apply(params, x, jnp.full(2, t), tokens, volume)

    np.testing.assert_allclose(sample(first, 1.0), sample(second, 1.0), atol=2e-5)
    assert np.abs(sample(first, 0.5) - sample(second, 0.5)).max() > 1e-3

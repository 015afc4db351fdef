"""Both flows at toy size: padding never matters, draws share their image, what prediction of the
sample means."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from copies import added
from toy import (
    MODEL,
    build,
    finite,
    flow_arguments,
    flow_table,
    flow_views,
    flow_voxels,
    init,
    latent_config,
    one_block,
    voxel_batch,
)

from uniart_jax.models.flow_transformer import _patchify, _unpatchify
from uniart_jax.nn.grids import flow_plan


def test_structure_flow_draws_share_their_image():
    network = build("structure_flow", MODEL)
    params = init(network)
    tokens, volume, t = flow_arguments(3)
    x = np.random.default_rng(1).normal(size=(6, 2, 2, 2, 3)).astype(np.float32)
    apply = jax.jit(network.apply)
    shared = apply(params, x, t, tokens, volume)
    alone = apply(params, x, t, np.repeat(tokens, 3, 0), np.repeat(volume, 3, 0))
    assert shared.shape == x.shape
    np.testing.assert_allclose(shared, alone, rtol=1e-3, atol=1e-4)
    other = apply(params, x, t, tokens, added(volume, 0, np.asarray(volume)[1]))
    assert np.abs(other - shared)[:3].max() > 1e-3 and not np.abs(other - shared)[3:].any()


def test_a_time_may_be_one_of_all_items():
    tokens, volume, _ = flow_arguments()
    x = np.random.default_rng(1).normal(size=(2, 2, 2, 2, 3)).astype(np.float32)
    network = build("structure_flow", MODEL)
    apply, params = jax.jit(network.apply), init(network)
    each = apply(params, x, np.full(2, 0.3, np.float32), tokens, volume)
    np.testing.assert_array_equal(apply(params, x, 0.3, tokens, volume), each)
    model = one_block(stem="patch")
    batch, network = voxel_batch(model), build("latent_flow", model)
    apply, params = jax.jit(network.apply), init(network)
    given = flow_voxels(model, batch)
    each = apply(params, batch.latent, np.full(2, 0.3, np.float32), tokens, volume, **given)
    np.testing.assert_array_equal(apply(params, batch.latent, 0.3, tokens, volume, **given), each)


def test_flow_that_needs_a_volume_says_so():
    network = build("structure_flow", MODEL)
    tokens, _, t = flow_arguments()
    with pytest.raises(ValueError, match="volume"):
        jax.eval_shape(network.apply, init(network), np.zeros((2, 2, 2, 2, 3), "f4"), t, tokens)


LATENT_FLOWS = {
    "patch": dict(stem="patch", share_mod=True),
    "patch-voxel": dict(stem="patch", share_mod=True, voxel_channels=8),
    "patch-pixel": dict(stem="patch", pixel_channels=6),
    "patch-voxel-pixel": dict(stem="patch", voxel_channels=8, pixel_channels=6),
    "patch-voxel-layout": dict(stem="patch", voxel_channels=8, layout_channels=6),
    "conv": dict(stem="conv", io_channels=(6,)),
    "conv-io3-noskip": dict(
        stem="conv", io_channels=(6,), num_io_res_blocks=3, use_skip_connection=False
    ),
    "conv-cross-norm": dict(stem="conv", io_channels=(6,), qk_rms_norm_cross=True),
    "no-io": dict(stem="conv", patch_size=1),
    "no-io-share": dict(stem="conv", patch_size=1, share_mod=True),
}


EVERY_OPTION = {  # at least once; the others nightly
    "patch-voxel-pixel",
    "patch-voxel-layout",
    "conv-io3-noskip",
    "conv-cross-norm",
    "no-io-share",
}


ANY_WIDTH = {"patch-voxel-pixel", "conv-cross-norm"}


@pytest.mark.parametrize(
    "name",
    [
        name if name in EVERY_OPTION else pytest.param(name, marks=pytest.mark.slow)
        for name in LATENT_FLOWS
    ],
)
def test_latent_flow_ignores_padding(name):
    model = one_block(**LATENT_FLOWS[name])
    network = build("latent_flow", model)
    params = init(network)
    tokens, volume, t = flow_arguments()
    views = flow_views()

    @jax.jit
    def step(params, x, coords, counts, plan):
        def loss(params):
            voxels = {"coords": coords, "counts": counts, "plan": plan}
            given = {"views": views, "layout": flow_table(), **voxels}
            v = network.apply(params, x, t, tokens, volume, **given)
            return jnp.square(v).sum(), v

        return jax.grad(loss, has_aux=True)(params)

    def run(**kwargs):
        batch = voxel_batch(model, **kwargs)
        plan = flow_plan(batch.coords, batch.counts, model.latent_flow, model.grid)
        return step(params, batch.latent, batch.coords, batch.counts, plan)

    clean_gradient, clean = jax.device_get(run(width=83))
    assert clean.shape == (2, 83, 4) and finite(clean_gradient)
    assert np.abs(clean).max() > 0
    assert all(np.asarray(g).any() for g in jax.tree.leaves(clean_gradient["blocks"]))
    others = [(83, np.nan), (83, 1e5)]  # of the same width: the same program
    for width, garbage in [*others, (70, None)] if name in ANY_WIDTH else others:
        gradient, v = jax.device_get(run(width=width, garbage=garbage))
        for b, n in enumerate((61, 37)):
            np.testing.assert_allclose(v[b, :n], clean[b, :n], rtol=1e-3, atol=1e-3)
            assert not np.asarray(v)[b, n:].any()
        for a, b in zip(*map(jax.tree.leaves, (gradient, clean_gradient)), strict=True):
            np.testing.assert_allclose(a, b, rtol=5e-3, atol=5e-3 * np.abs(b).max())


@pytest.mark.parametrize("prediction", ["velocity", "data"])
def test_a_latent_flow_of_the_other_direction_is_its_mirror_image(prediction):
    """v'(x, t) = -v(x, 1 - t) where velocities are predicted; a clean sample is the same whichever
    way time runs."""
    model = latent_config(prediction=prediction, num_blocks=1, volume_channels=0)
    flow = dataclasses.replace(model.latent_flow, direction="noise_to_data")
    both = [build("latent_flow", m) for m in (model, dataclasses.replace(model, latent_flow=flow))]
    params, batch, (tokens, _, t) = init(both[0]), voxel_batch(model), flow_arguments()
    voxels = flow_voxels(model, batch)
    half = np.full(2, 0.5, np.float32)  # where a network that predicts x_0 is shown the same of x

    @jax.jit
    def run(params, x):
        at = [lambda t, n=n: n.apply(params, x, t, tokens, **voxels) for n in both]
        return at[0](1 - t), at[1](t), at[0](half), at[1](half)

    mirrored, found, middle, same = run(params, batch.latent)
    if prediction == "velocity":
        np.testing.assert_allclose(found, -mirrored, atol=1e-5)
        assert np.abs(found).max() > 0.01
    else:
        np.testing.assert_allclose(same, middle, atol=1e-5)
        assert np.abs(found - mirrored).max() > 0.01


def test_latent_flow_draws_share_voxels():
    model = one_block(voxel_channels=8, pixel_channels=6, layout_channels=6)
    network = build("latent_flow", model)
    params = init(network)
    tokens, volume, t = flow_arguments(2)
    views = flow_views()
    batch = voxel_batch(model)
    x = np.random.default_rng(1).normal(size=(4, 70, 4)).astype(np.float32)
    apply = jax.jit(network.apply)

    def run(coords, counts):
        plan = flow_plan(coords, counts, model.latent_flow, model.grid)
        voxels = {"coords": coords, "counts": counts, "plan": plan}
        given = {"views": views, "layout": flow_table(), **voxels}
        return apply(params, x, t, tokens, volume, **given)

    shared = run(batch.coords, batch.counts)
    alone = run(np.repeat(batch.coords, 2, 0), np.repeat(batch.counts, 2))
    np.testing.assert_allclose(shared, alone, rtol=1e-4, atol=1e-4)


def test_draws_of_one_picture_may_have_voxels_of_their_own():
    model = one_block(voxel_channels=8, pixel_channels=6)
    network = build("latent_flow", model)
    params = init(network)
    tokens, volume, t = flow_arguments()
    batch = voxel_batch(model)
    voxels = flow_voxels(model, batch)
    seen = [np.asarray(v)[:1] for v in (tokens, volume, *flow_views(3))]
    twice = [np.repeat(a, 2, axis=0) for a in seen]
    apply = jax.jit(network.apply)
    once, each = (
        apply(params, batch.latent, t, a, b, views=tuple(views), **voxels)
        for a, b, *views in (seen, twice)
    )
    np.testing.assert_allclose(once, each, rtol=1e-4, atol=1e-4)


def test_conv_stem_levels_must_match_the_patch_size():
    with pytest.raises(ValueError, match="patch_size"):
        build("latent_flow", latent_config(stem="conv", io_channels=(6, 6))).abstract()


def test_data_prediction_is_the_velocity_of_the_predicted_sample():
    network = build("structure_flow", MODEL)
    params = init(network)
    params["out_layer"] = jax.tree.map(jnp.zeros_like, params["out_layer"])
    tokens, volume, _ = flow_arguments()
    x = np.ones((2, 2, 2, 2, 3), np.float32)
    v = jax.jit(network.apply)(params, x, np.float32([0.5, 0.01]), tokens, volume)
    np.testing.assert_allclose(v[0], 2.0, rtol=1e-6)
    np.testing.assert_allclose(v[1], 20.0, rtol=1e-6)


def test_a_flow_that_predicts_the_sample_is_shown_no_noise_where_there_is_nothing_else():
    network = build("structure_flow", MODEL)
    params = init(network)
    tokens, volume, _ = flow_arguments()
    rng = np.random.default_rng(1)
    first, second = (rng.normal(size=(2, 2, 2, 2, 3)).astype(np.float32) for _ in range(2))
    apply = jax.jit(network.apply)

    def sample(x, t):
        return x - t * np.asarray(apply(params, x, np.full(2, t, np.float32), tokens, volume))

    np.testing.assert_allclose(sample(first, 1.0), sample(second, 1.0), atol=2e-5)
    assert np.abs(sample(first, 0.5) - sample(second, 0.5)).max() > 1e-3


def names(shapes):
    return {
        jax.tree_util.keystr(path, simple=True, separator="."): leaf.shape
        for path, leaf in jax.tree_util.tree_leaves_with_path(shapes)
    }


def test_options_of_the_latent_flow_change_what_trellis_changes():
    base = names(build("latent_flow", latent_config(**LATENT_FLOWS["conv"])).abstract())

    def flow(name):
        return names(build("latent_flow", latent_config(**LATENT_FLOWS[name])).abstract())

    cross = flow("conv-cross-norm")
    assert cross.keys() - base.keys() == {
        f"blocks.{i}.cross_attn.{x}_rms_norm.gamma" for i in range(2) for x in "qk"
    }
    three = flow("conv-io3-noskip")
    assert three["input_blocks.2.conv1.conv.kernel"] == (27, 6, 24)
    assert three["out_blocks.0.conv1.conv.kernel"] == (27, 24, 6)
    assert three["out_blocks.2.conv1.conv.kernel"] == (27, 6, 6)
    none = flow("no-io-share")
    assert none["input_layer.kernel"] == (4, 24) and none["out_layer.kernel"] == (24, 4)
    assert not [n for n in none if n.startswith(("input_blocks", "out_blocks"))]
    assert none["adaLN_modulation.1.kernel"] == (24, 144)
    assert not [n for n in none if "blocks" in n and "adaLN" in n]


def test_patches_hold_channels_before_positions():
    """TRELLIS's order, which its input and output layers are trained with."""
    x = np.random.default_rng(0).normal(size=(2, 4, 4, 4, 3)).astype(np.float32)
    tokens = _patchify(jnp.asarray(x), 2)
    assert tokens.shape == (2, 8, 3 * 8)
    cube = x[1, 0:2, 2:4, 2:4]  # token (0, 1, 1)
    np.testing.assert_array_equal(tokens[1, 3], np.moveaxis(cube, -1, 0).reshape(-1))
    np.testing.assert_array_equal(_unpatchify(tokens, 2, 2), x)


@pytest.mark.parametrize("share_mod", [False, True])
def test_structure_flow_in_patches(share_mod):
    """Each velocity belongs to its own cell: with the output layer alone, moving one cell's input
    moves nothing but its patch."""
    flow = dataclasses.replace(
        MODEL.structure_flow,
        patch_size=2,
        share_mod=share_mod,
        num_blocks=0,
        volume_channels=0,
        prediction="velocity",
    )
    vae = dataclasses.replace(MODEL.structure_vae, patch_size=1, channels=(6, 8))
    model = dataclasses.replace(MODEL, structure_flow=flow, structure_vae=vae)
    network = build("structure_flow", model)
    params = init(network)
    assert ("adaLN_modulation" in params) is share_mod
    tokens, _, t = flow_arguments()
    x = np.random.default_rng(1).normal(size=(2, 4, 4, 4, 3)).astype(np.float32)
    apply = jax.jit(network.apply)
    v = apply(params, x, t, tokens)
    assert v.shape == x.shape and finite(v)
    moved = np.abs(apply(params, added(x, (0, 1, 2, 3, 0), 1), t, tokens) - v)[0].max(-1) > 0
    inside = np.zeros((4, 4, 4), bool)
    inside[:2, 2:, 2:] = True
    np.testing.assert_array_equal(moved, inside)


def test_a_position_table_is_read_and_never_learned():
    flow = dataclasses.replace(MODEL.structure_flow, position_table=True)
    network = build("structure_flow", dataclasses.replace(MODEL, structure_flow=flow))
    params, plain = init(network), build("structure_flow", MODEL)
    assert params["pos_emb"].shape == (8, 24)
    tokens, volume, t = flow_arguments()
    x = np.random.default_rng(1).normal(size=(2, 2, 2, 2, 3)).astype(np.float32)
    # the computed embedding, until weights say otherwise
    fresh = jax.jit(lambda key: network.init(key)["pos_emb"])(jax.random.key(0))
    rest = {name: value for name, value in params.items() if name != "pos_emb"}
    computed = jax.jit(plain.apply)(rest, x, t, tokens, volume)
    apply = jax.jit(network.apply)
    same = apply({**params, "pos_emb": fresh}, x, t, tokens, volume)
    np.testing.assert_allclose(same, computed, rtol=1e-5, atol=1e-5)

    def loss(params):
        return jnp.square(network.apply(params, x, t, tokens, volume)).sum()

    gradient = jax.jit(jax.grad(loss))(params)
    assert not np.asarray(gradient["pos_emb"]).any()
    assert np.asarray(gradient["input_layer"]["kernel"]).any()
    assert np.abs(apply(params, x, t, tokens, volume) - computed).max() > 1e-3

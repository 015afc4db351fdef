"""Every network at a toy size: shapes, finite gradients, and that padding, its width and its content never matter."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from uniart_jax.config import (
    FlowConfig,
    GridConfig,
    ImageEncoderConfig,
    ModelConfig,
    StructureVAEConfig,
    UniArtVAEConfig,
)
from uniart_jax.models.network import build
from uniart_jax.models.uniart_vae import voxel_boxes, voxel_codes
from uniart_jax.nn.grids import flow_plan
from uniart_jax.nn.segments import voxel_plans

FLOW = FlowConfig(
    model_channels=24,
    num_blocks=2,
    num_heads=2,
    cond_channels=16,
    volume_channels=5,
    volume_resolution=4,
    patch_size=2,
    prediction="data",
)
MODEL = ModelConfig(
    grid=GridConfig(resolution=8, subdivisions=2, max_parts=4),
    image_encoder=ImageEncoderConfig(
        image_size=32,
        stem_stride=4,
        stem_channels=(4, 8),
        width=16,
        num_blocks=1,
        num_heads=2,
        volume_tokens=2,
        volume_blocks=1,
        volume_resolution=4,
        volume_channels=5,
        target_resolution=8,
        sketch_width=12,
    ),
    structure_vae=StructureVAEConfig(
        patch_size=2, channels=(6, 8), latent_channels=3, num_res_blocks=1, num_res_blocks_middle=1
    ),
    uniart_vae=UniArtVAEConfig(
        width=24,
        num_blocks=2,
        num_heads=2,
        latent_channels=4,
        attention="serial",
        window=16,
        visual_channels=0,
        geometry_channels=12,
        articulation_channels=8,
        part_segment=16,
    ),
    structure_flow=dataclasses.replace(FLOW, patch_size=1),
    latent_flow=dataclasses.replace(FLOW, stem="patch"),
)


def vae_config(**changes):
    return dataclasses.replace(MODEL, uniart_vae=dataclasses.replace(MODEL.uniart_vae, **changes))


def latent_config(**changes):
    return dataclasses.replace(MODEL, latent_flow=dataclasses.replace(MODEL.latent_flow, **changes))


def init(network, seed=0):
    """Parameters without zeros (zero-initialised layers would hide what flows through them)."""
    shapes = network.abstract()
    rng = np.random.default_rng(seed)
    return jax.tree.map(lambda s: jnp.asarray(rng.normal(0, 0.2, s.shape), jnp.float32), shapes)


def voxel_batch(model, width=70, seed=0, garbage=None):
    rng = np.random.default_rng(seed)
    side, cells, k = model.grid.resolution, model.grid.subdivisions**3, model.grid.max_parts
    counts = np.array([61, 37], np.int32)
    shape = (2, 70)
    coords = np.zeros((*shape, 3), np.int32)
    for b, n in enumerate(counts):
        chosen = np.sort(rng.choice(side**3, n, replace=False))
        coords[b, :n] = np.stack(np.unravel_index(chosen, (side,) * 3), -1)
    f = lambda *s: rng.normal(size=s).astype(np.float32)  # noqa: E731
    batch = dict(
        coords=coords,
        sdf=f(*shape, cells),
        color=f(*shape, cells, 3),
        owner=rng.integers(0, k, (*shape, cells)).astype(np.int32),
        voxel_part=rng.integers(0, k, shape).astype(np.int32),
        visual=f(*shape, 3),
        part_feature=f(*shape, 5),
        latent=f(*shape, 4),
    )
    valid = np.arange(70) < counts[:, None]
    for name, value in batch.items():
        filled = np.full((2, width, *value.shape[2:]), 0, value.dtype)
        filled[:, :70] = np.where(valid.reshape(*shape, *[1] * (value.ndim - 2)), value, 0)
        if garbage is not None and value.dtype == np.float32:
            filled[np.arange(width) >= counts[:, None]] = garbage
        batch[name] = filled
    batch |= dict(counts=counts, boxes=f(2, k, 6), codes=f(2, k, 9))
    batch["parents"] = rng.integers(0, k, (2, k)).astype(np.int32)
    batch["plans"] = voxel_plans(batch, model.uniart_vae, model.grid)
    return batch


def finite(tree):
    return all(np.isfinite(np.asarray(x)).all() for x in jax.tree.leaves(tree))


def test_image_encoder():
    network = build("image_encoder", MODEL)
    image = jnp.asarray(np.random.default_rng(0).random((2, 32, 32, 3), np.float32))
    params = init(network)

    @jax.jit
    def step(params, image):
        def loss(params):
            out = network.apply(params, image)
            return sum(jnp.square(out[k]).mean() for k in ("camera", "occupancy", "codes")), out

        return jax.value_and_grad(loss, has_aux=True)(params)

    (_, out), gradients = step(params, image)
    assert {k: v.shape for k, v in out.items()} == {
        "camera": (2, 7),
        "tokens": (2, 16, 16),
        "volume": (2, 4, 4, 4, 5 + 3),
        "occupancy": (2, 8, 8, 8),
        "codes": (2, 8, 8, 8, 21),
    }
    assert finite(gradients) and all(np.asarray(g).any() for g in jax.tree.leaves(gradients))


def test_image_encoder_looks_through_a_known_camera_only_where_told():
    network = build("image_encoder", MODEL)
    params = init(network)
    image = jnp.asarray(np.random.default_rng(0).random((2, 32, 32, 3), np.float32))
    camera = jnp.tile(jnp.array([0.5, 0.8, 0.2, 1.5, 0.3, 0.1, 0.0]), (2, 1))
    apply = jax.jit(network.apply)
    alone = apply(params, image)
    told = apply(params, image, camera, jnp.array([False, True]))
    np.testing.assert_array_equal(told["camera"], alone["camera"])
    np.testing.assert_array_equal(told["occupancy"][0], alone["occupancy"][0])
    assert np.abs(told["occupancy"][1] - alone["occupancy"][1]).max() > 1e-4
    # straight from the front, a cell's colour is its picture's: the lower left quarter red
    front = jnp.tile(jnp.array([0.0, 1.0, 0.0, 1.6, 1e-3, 0.0, 0.0]), (2, 1))
    red = jnp.zeros((2, 32, 32, 3)).at[:, 16:, :16, 0].set(1.0)
    colors = np.asarray(apply(params, red, front, jnp.array([True, True]))["volume"][0, ..., 5:])
    assert (colors[:, 2:, :2, 0] > 0.9).all() and (colors[:, :2, :, 0] < -0.9).all()
    assert (colors[:, :, 2:, 0] < -0.9).all() and (colors[..., 1:] == -1).all()
    itself = apply(params, image, alone["camera"], jnp.array([True, True]))
    np.testing.assert_array_equal(itself["occupancy"], alone["occupancy"])


def test_image_encoder_reads_each_cell_where_the_camera_sees_it():
    network = build("image_encoder", MODEL)
    params = init(network)
    camera = jnp.array([[0.0, 1.0, 0.0, 1.6, 1e-3, 0.0, 0.0]])  # straight from the front
    fine, coarse = jnp.zeros((1, 8, 8, 4)), jnp.zeros((1, 4, 4, 8))
    places = network.apply(params, camera, method="look")
    plain = network.apply(params, fine, coarse, camera, *places, method="lift")
    marked = network.apply(
        params, fine.at[0, 1, 6].set(1.0), coarse, camera, *places, method="lift"
    )
    changed = np.abs(np.asarray(marked - plain)).max(-1).reshape(4, 4, 4) > 1e-6
    # up and to the right in the picture is z > 0 and, seen along +x, y < 0; every depth alike
    assert changed.any((0,)).nonzero()[0].max() <= 1 and changed.any((0,)).nonzero()[1].min() >= 2
    assert changed.any() and (changed == changed[:1]).all()


def test_image_encoder_heads_lie_where_their_volume_cell_is():
    network = build("image_encoder", MODEL)
    params = init(network)
    image = jnp.zeros((1, 32, 32, 3))
    params["head_token"] = jax.tree.map(jnp.zeros_like, params["head_token"])

    def corner(params):
        return network.apply(params, image)["occupancy"][0, 7, 0, 3]

    kernel = params["to_volume"][
        "kernel"
    ]  # [D, 2^3 cells x C]: cell (3, 0, 1) is cell (1, 0, 1) of token (1, 0, 0)
    gradient = jax.jit(jax.grad(corner))(params)["to_volume"]["kernel"].reshape(
        kernel.shape[0], 8, -1
    )
    touched = np.flatnonzero(np.abs(np.asarray(gradient)).sum((0, 2)))
    assert touched.tolist() == [0b101]


def test_structure_vae():
    network = build("structure_vae", MODEL)
    occupancy = (np.random.default_rng(0).random((2, 8, 8, 8)) > 0.5).astype(np.float32)
    out = jax.jit(network.apply)(init(network), occupancy, jax.random.key(0))
    assert out["mean"].shape == out["latent"].shape == (2, 2, 2, 2, 3)
    assert out["logits"].shape == (2, 8, 8, 8) and finite(out)
    assert np.abs(out["latent"] - out["mean"]).max() > 0


@pytest.mark.parametrize(
    ("attention", "linear_path"), [("serial", True), ("swin", False)], ids=["serial", "swin"]
)
def test_uniart_vae_ignores_padding(attention, linear_path):
    window = 16 if attention == "serial" else 4
    model = vae_config(attention=attention, window=window, linear_path=linear_path)
    network = build("uniart_vae", model)
    params = init(network)
    voxels = jnp.asarray([[0, 5, 60], [36, 2, 2]])

    @jax.jit
    def step(params, batch):
        def loss(params):
            out = network.apply(params, batch, None, voxels)
            return sum(jnp.square(x).sum() for x in jax.tree.leaves(out)), out

        return jax.grad(loss, has_aux=True)(params)

    clean_gradient, clean = step(params, voxel_batch(model))
    assert {k: v.shape for k, v in clean.items() if k not in ("geometry", "articulation")} == {
        "mean": (2, 70, 4),
        "logvar": (2, 70, 4),
        "latent": (2, 70, 4),
        "sdf": (2, 3, 8),
        "color": (2, 3, 8, 3),
        "box_pair": (2, 3, 2, 6),
        "foreign": (2, 3, 8),
        "own_box": (2, 3, 8, 6),
        "joint_code": (2, 3, 9),
        "parent_box": (2, 3, 6),
    }
    assert finite(clean_gradient)
    for width, garbage in ((70, np.nan), (83, 1e5)):
        batch = voxel_batch(model, width, garbage=garbage)
        gradient, out = step(params, batch)
        for name in ("sdf", "color", "own_box", "joint_code", "parent_box"):
            np.testing.assert_allclose(out[name], clean[name], rtol=1e-4, atol=1e-5)
        for b, n in enumerate(batch["counts"]):
            np.testing.assert_allclose(out["mean"][b, :n], clean["mean"][b, :n], atol=1e-5)
            assert not np.asarray(out["mean"])[b, n:].any()
        for a, b in zip(*map(jax.tree.leaves, (gradient, clean_gradient)), strict=True):
            np.testing.assert_allclose(a, b, rtol=2e-3, atol=2e-3 * np.abs(b).max())


def test_the_five_aggregations_run_and_differ():
    seen = []
    for kind in ("uniart", "self_attention", "residual", "pooling", "concat"):
        model = vae_config(aggregation=kind, visual_channels=3, part_feature_channels=5)
        network = build("uniart_vae", model)
        batch = voxel_batch(model)
        mean = jax.jit(lambda p, b, n=network: n.apply(p, b, method="encode")["mean"])(
            init(network), batch
        )
        assert mean.shape == (2, 70, 4) and finite(mean)
        seen.append(np.asarray(mean))
    for i in range(5):
        for j in range(i):
            assert np.abs(seen[i] - seen[j]).max() > 1e-3


def test_part_attention_stays_within_the_part():
    model = vae_config(num_blocks=0, part_segment=0)
    network = build("uniart_vae", model)
    params = init(network)
    batch = voxel_batch(model)
    encode = jax.jit(lambda p, b: network.apply(p, b, method="encode")["mean"])
    before = np.asarray(encode(params, batch))
    changed = {**batch, "sdf": batch["sdf"].copy()}
    changed["sdf"][0, 7] += 1.0
    difference = np.abs(np.asarray(encode(params, changed)) - before).max(-1)
    part = batch["voxel_part"]
    same = (part[0] == part[0, 7]) & (np.arange(70) < 61)
    assert (difference[0][same] > 0).all() and not difference[0][~same].any()
    assert not difference[1].any()


def test_codes_and_boxes_are_gathered_by_part():
    batch = voxel_batch(MODEL)
    codes, found = np.asarray(voxel_codes(batch)), jax.device_get(voxel_boxes(batch))
    part = batch["voxel_part"][1, 5]
    parent = batch["parents"][1, part]
    expected = [batch["codes"][1, part], batch["boxes"][1, part], batch["boxes"][1, parent]]
    np.testing.assert_array_equal(codes[1, 5], np.concatenate(expected))
    foreign = batch["owner"] != batch["voxel_part"][..., None]
    np.testing.assert_array_equal(found["foreign"], foreign)
    np.testing.assert_array_equal(found["shared"], foreign.any(-1))
    b, v = np.argwhere(foreign.any(-1))[0]
    other = batch["owner"][b, v][foreign[b, v]][0]
    np.testing.assert_array_equal(found["own"][b, v], batch["boxes"][b, batch["voxel_part"][b, v]])
    np.testing.assert_array_equal(found["other"][b, v], batch["boxes"][b, other])
    chosen = jax.device_get(voxel_boxes(batch, jnp.asarray([[1], [5]])))
    for name, values in chosen.items():
        np.testing.assert_array_equal(values[1, 0], found[name][1, 5])


def flow_arguments(draws=1, seed=0):
    rng = np.random.default_rng(seed)
    f = lambda *s: jnp.asarray(rng.normal(size=s), jnp.float32)  # noqa: E731
    return f(2, 9, 16), f(2, 4, 4, 4, 5), jnp.asarray(rng.random(2 * draws), jnp.float32)


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


def test_init_has_trelliss_zeros_and_no_state():
    params = jax.jit(build("structure_flow", MODEL).init)(jax.random.key(0))
    assert not np.asarray(params["out_layer"]["kernel"]).any()
    assert not np.asarray(params["blocks"]["0"]["adaLN_modulation"]["1"]["kernel"]).any()
    assert np.asarray(params["blocks"]["1"]["self_attn"]["to_qkv"]["kernel"]).any()
    assert all(isinstance(x, jax.Array) for x in jax.tree.leaves(params))


def test_wrong_parameters_are_listed():
    network = build("structure_vae", MODEL)
    params = init(network)
    occupancy = jnp.zeros((1, 8, 8, 8))
    lacking = {**params, "decoder": {k: v for k, v in params["decoder"].items() if k != "blocks"}}
    with pytest.raises(ValueError, match=r"missing.*decoder\.blocks\.0\.conv1\.kernel"):
        network.apply(lacking, occupancy)
    params["encoder"]["input_layer"]["bias"] = jnp.zeros(5)
    with pytest.raises(ValueError, match=r"encoder\.input_layer\.bias \(5,\) instead of \(6,\)"):
        network.apply(params, occupancy)
    with pytest.raises(ValueError, match="image_encoder, structure_vae"):
        build("decoder", MODEL)


def test_bfloat16_keeps_parameters_and_results_in_float32():
    model = dataclasses.replace(MODEL, compute_dtype="bfloat16")
    for name in ("structure_flow", "uniart_vae"):
        exact, rounded = build(name, MODEL), build(name, model)
        params = init(exact)
        if name == "uniart_vae":
            arguments = (voxel_batch(MODEL),)
        else:
            tokens, volume, t = flow_arguments()
            arguments = (jnp.ones((2, 2, 2, 2, 3)), t, tokens, volume)
        a, b = (jax.jit(n.apply)(params, *arguments) for n in (exact, rounded))
        for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
            assert np.isfinite(np.asarray(y, np.float32)).all()
            scale = np.abs(x).mean()
            assert np.abs(np.asarray(x) - np.asarray(y, np.float32)).mean() < 0.1 * scale
        if name == "structure_flow":
            assert b.dtype == jnp.float32


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

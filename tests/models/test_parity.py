"""Our networks against TRELLIS v1's own outputs: rtol 1e-4, atol 1e-5 (5e-5 for the flows), chosen by the fixtures' makers."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from trellis_fixtures import load, pad, parameters

from uniart_jax.config import (
    FlowConfig,
    GridConfig,
    ModelConfig,
    StructureVAEConfig,
    UniArtVAEConfig,
)
from uniart_jax.models.flow_transformer import StructureFlow
from uniart_jax.models.network import Network, build
from uniart_jax.models.structure_vae import Decoder, Encoder
from uniart_jax.models.uniart_vae import Trunk
from uniart_jax.nn.grids import flow_plan
from uniart_jax.nn.segments import voxel_plans

CLOSE = dict(rtol=1e-4, atol=1e-5)
CLOSE_FLOW = dict(rtol=1e-4, atol=5e-5)


def last(x):
    return np.moveaxis(x, 1, -1)


def structure_vae(config):
    return ModelConfig(
        structure_vae=StructureVAEConfig(
            channels=tuple(sorted(config["channels"])),
            latent_channels=config["latent_channels"],
            num_res_blocks=config["num_res_blocks"],
            num_res_blocks_middle=config["num_res_blocks_middle"],
        )
    )


@pytest.mark.parametrize("name", ["ss_vae_encoder", "ss_vae_smallact_encoder"])
def test_structure_encoder(name):
    config, arrays = load(name)
    model = structure_vae(config)
    network = Network(name, model, lambda rngs: Encoder(model, rngs))
    mean, logvar = jax.jit(network.apply)(parameters(arrays), last(arrays["in/x"])[..., 0])
    np.testing.assert_allclose(mean, last(arrays["out/mean"]), **CLOSE)
    np.testing.assert_allclose(logvar, last(arrays["out/logvar"]), **CLOSE)


def test_structure_decoder():
    config, arrays = load("ss_vae_decoder")
    model = structure_vae(config)
    network = Network("decoder", model, lambda rngs: Decoder(model, rngs))
    logits = jax.jit(network.apply)(parameters(arrays), last(arrays["in/z"]))
    np.testing.assert_allclose(logits, last(arrays["out/logits"])[..., 0], **CLOSE)


def structure_flow(config):
    return ModelConfig(
        grid=GridConfig(resolution=config["resolution"]),
        structure_vae=StructureVAEConfig(channels=(8,), latent_channels=config["in_channels"]),
        structure_flow=FlowConfig(
            model_channels=config["model_channels"],
            num_blocks=config["num_blocks"],
            num_heads=config["num_heads"],
            cond_channels=config["cond_channels"],
            patch_size=config["patch_size"],
            qk_rms_norm=config["qk_rms_norm"],
        ),
    )


def use_stored_positions(monkeypatch, arrays):
    monkeypatch.setattr(
        StructureFlow, "position_embedding", lambda self: jnp.asarray(arrays["sd/pos_emb"])
    )


@pytest.mark.parametrize("name", ["ss_flow", "ss_flow_smallact"])
def test_structure_flow(name, monkeypatch):
    config, arrays = load(name)
    network = build("structure_flow", structure_flow(config))
    params = parameters(arrays)
    if name == "ss_flow_smallact":
        use_stored_positions(monkeypatch, arrays)
    v = jax.jit(network.apply)(
        params, last(arrays["in/x"]), arrays["in/t"] / 1000, arrays["in/cond"]
    )
    np.testing.assert_allclose(v, last(arrays["out/v"]), **CLOSE_FLOW)


def slat(config, inputs):
    return ModelConfig(
        grid=GridConfig(resolution=config["resolution"]),
        uniart_vae=UniArtVAEConfig(
            width=config["model_channels"],
            num_blocks=config["num_blocks"],
            num_heads=config["num_heads"],
            latent_channels=config["latent_channels"],
            attention=config["attn_mode"],
            window=config["window_size"],
            visual_channels=inputs,
        ),
    )


def run_trunk(config, arrays, outputs, params):
    coords, feats, counts, rows = pad(arrays["in/coords"], arrays["in/feats"])
    model = slat(config, feats.shape[-1])
    network = Network("trunk", model, lambda rngs: Trunk(feats.shape[-1], outputs, model, rngs))
    plans = voxel_plans(
        dict(coords=coords, counts=counts), model.uniart_vae, model.grid, parts=False
    )
    return jax.jit(network.apply)(params, feats, coords, plans), rows


def test_slat_encoder():
    config, arrays = load("slat_encoder")
    out, rows = run_trunk(config, arrays, 2 * config["latent_channels"], parameters(arrays))
    mean, logvar = np.split(np.asarray(out)[rows], 2, -1)
    np.testing.assert_allclose(mean, arrays["out/mean"], **CLOSE)
    np.testing.assert_allclose(logvar, arrays["out/logvar"], **CLOSE)


def test_slat_decoder_trunk():
    config, arrays = load("slat_dec_gs")
    out, rows = run_trunk(config, arrays, arrays["out/raw"].shape[1], parameters(arrays))
    np.testing.assert_allclose(np.asarray(out)[rows], arrays["out/raw"], **CLOSE)


def test_slat_flow():
    config, arrays = load("slat_flow")
    coords, feats, counts, rows = pad(arrays["in/coords"], arrays["in/feats"])
    model = ModelConfig(
        grid=GridConfig(resolution=config["resolution"]),
        uniart_vae=UniArtVAEConfig(latent_channels=config["in_channels"]),
        latent_flow=FlowConfig(
            model_channels=config["model_channels"],
            num_blocks=config["num_blocks"],
            num_heads=config["num_heads"],
            cond_channels=config["cond_channels"],
            patch_size=config["patch_size"],
            qk_rms_norm=config["qk_rms_norm"],
            io_channels=tuple(config["io_block_channels"]),
            num_io_res_blocks=config["num_io_res_blocks"],
        ),
    )
    network = build("latent_flow", model)
    plan = flow_plan(coords, counts, model.latent_flow, model.grid)
    v = jax.jit(network.apply)(
        parameters(arrays),
        feats,
        arrays["in/t"] / 1000,
        arrays["in/cond"],
        coords=coords,
        counts=counts,
        plan=plan,
    )
    np.testing.assert_allclose(np.asarray(v)[rows], arrays["out/v"], **CLOSE_FLOW)
    assert not np.asarray(v)[1, counts[1] :].any()


def compare_gradients(gradients, arrays):
    expected = parameters(arrays, "out/grad/")
    found = dict(jax.tree_util.tree_leaves_with_path(gradients))
    for path, value in jax.tree_util.tree_leaves_with_path(expected):
        np.testing.assert_allclose(
            found[path],
            value,
            rtol=1e-4,
            atol=1e-4 * np.abs(value).max(),
            err_msg=jax.tree_util.keystr(path),
        )


def test_structure_flow_gradients(monkeypatch):
    config, arrays = load("grads_ss_flow")
    network = build("structure_flow", structure_flow(config))
    x0, noise, t = last(arrays["in/x0"]), last(arrays["in/eps"]), arrays["in/t"]
    sigma = 1e-5

    def loss(params):
        time = t.reshape(-1, 1, 1, 1, 1)
        x = (1 - time) * x0 + (sigma + (1 - sigma) * time) * noise
        v = network.apply(params, x, t, arrays["in/cond"])
        return jnp.square(v - ((1 - sigma) * noise - x0)).mean()

    value, gradients = jax.jit(jax.value_and_grad(loss))(
        jax.tree.map(jnp.asarray, parameters(arrays))
    )
    np.testing.assert_allclose(value, arrays["out/loss"], rtol=1e-4)
    compare_gradients(gradients, arrays)


def test_names_of_the_real_configs_are_ours():
    """Every parameter of TRELLIS's real networks has its place, of the same size, in the paper-size networks."""
    import json

    from trellis_fixtures import FOLDER

    if not (FOLDER / "names").exists():
        pytest.skip("shared/parity/names is not here")
    for file, name in (
        ("generation_ss_flow_img_dit_L_16l8_fp16_denoiser", "structure_flow"),
        ("generation_slat_flow_img_dit_L_64l8p2_fp16_denoiser", "latent_flow"),
        ("vae_ss_vae_conv3d_16l8_fp16_encoder", "structure_vae.encoder"),
        ("vae_ss_vae_conv3d_16l8_fp16_decoder", "structure_vae.decoder"),
    ):
        stored = json.loads((FOLDER / "names" / f"{file}.json").read_text())
        expected = {
            key: int(np.prod(shape)) for key, shape in stored.items() if not key.endswith("pos_emb")
        }
        network, *inner = name.split(".")
        tree = build(network, ModelConfig()).abstract()
        for part in inner:
            tree = tree[part]
        ours = {}
        for path, leaf in jax.tree_util.tree_leaves_with_path(tree):
            *names, kind = [str(p.key) for p in path]
            ours[".".join([*names, "weight" if kind in ("kernel", "scale") else kind])] = leaf.size
        assert ours == expected, name

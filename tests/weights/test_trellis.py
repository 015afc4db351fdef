"""TRELLIS's classes as ours: sizes and names of the published networks, options, buffers."""

import json
from pathlib import Path

import jax
import numpy as np
import pytest
from official import FLOW, GAUSSIANS, NETWORKS, SLAT, abstract, upstream

from uniart_jax.cli import load_config
from uniart_jax.config import ImageEncoderConfig, ModelConfig
from uniart_jax.models.gaussian_decoder import offset_perturbation
from uniart_jax.models.network import build
from uniart_jax.nn.embeddings import grid_coords, position_embedding
from uniart_jax.weights.compose import compose
from uniart_jax.weights.dinov2 import convert_dinov2
from uniart_jax.weights.mapping import flatten
from uniart_jax.weights.trellis import convert_trellis, slat_encoder
from uniart_jax.weights.trellis_options import out_of_scope, settings_of

# parameter name -> shape of every published network that has a place here
NAMES = Path(__file__).parent / "names"

# the published configs (configs/vae, configs/generation)
LARGE = {
    "num_blocks": 24,
    "num_heads": 16,
    "model_channels": 1024,
    "cond_channels": 1024,
    "in_channels": 8,
    "out_channels": 8,
    "qk_rms_norm": True,
}
BASE = {
    "resolution": 64,
    "num_blocks": 12,
    "num_heads": 12,
    "model_channels": 768,
    "latent_channels": 8,
}
CONVOLUTIONS = {"latent_channels": 8, "num_res_blocks": 2, "num_res_blocks_middle": 2}
PUBLISHED = {
    "SparseStructureEncoder": {"in_channels": 1, "channels": [32, 128, 512], **CONVOLUTIONS},
    "SparseStructureDecoder": {"out_channels": 1, "channels": [512, 128, 32], **CONVOLUTIONS},
    "SparseStructureFlowModel": {"resolution": 16, "patch_size": 1, **LARGE},
    "SLatEncoder": {"in_channels": 1024, **BASE},
    "SLatFlowModel": {"resolution": 64, "patch_size": 2, "io_block_channels": [128], **LARGE},
    "SLatGaussianDecoder": {"representation_config": GAUSSIANS | {"num_gaussians": 32}, **BASE},
}
FILES = {
    "vae_ss_vae_conv3d_16l8_fp16_encoder": "SparseStructureEncoder",
    "vae_ss_vae_conv3d_16l8_fp16_decoder": "SparseStructureDecoder",
    "generation_ss_flow_img_dit_L_16l8_fp16_denoiser": "SparseStructureFlowModel",
    "vae_slat_vae_enc_dec_gs_swin8_B_64l8_fp16_encoder": "SLatEncoder",
    "vae_slat_vae_enc_dec_gs_swin8_B_64l8_fp16_decoder": "SLatGaussianDecoder",
    "generation_slat_flow_img_dit_L_64l8p2_fp16_denoiser": "SLatFlowModel",
}
SCOPED_OUT = {
    "generation_ss_flow_txt_dit_XL_16l8_fp16_denoiser": "SparseStructureFlowModel",
    "generation_slat_flow_txt_dit_XL_64l8p2_fp16_denoiser": "SLatFlowModel",
    "vae_slat_vae_dec_rf_swin8_B_64l8_fp16_decoder": "SLatRadianceFieldDecoder",
    "vae_slat_vae_dec_mesh_swin8_B_64l8_fp16_decoder": "SLatMeshDecoder",
}
DINOV2 = ImageEncoderConfig(
    architecture="dinov2", image_size=518, width=1024, num_blocks=24, num_heads=16
)


def millions(tree):
    return round(sum(int(np.prod(leaf.shape)) for leaf in jax.tree.leaves(tree)) / 1e6, 3)


@pytest.mark.slow
def test_the_paper_size_is_trelliss_size():
    """Parameters of the published networks, buffers apart, from configs/paper.py alone."""
    model = load_config(Path(__file__).parents[2] / "configs" / "paper.py").model
    structure = build("structure_vae", model).abstract()
    assert millions(structure["encoder"]) == 59.298
    assert millions(structure["decoder"]) == 73.671
    assert millions(build("structure_flow", model).abstract()) == 555.544
    assert millions(slat_encoder(model).abstract()) == 85.817
    assert millions(build("latent_flow", model).abstract()) == 600.433
    assert millions(build("image_encoder", model).abstract()) == 304.373
    assert millions(build("gaussian_decoder", model).abstract()) == 85.369


def test_the_published_configs_are_the_default():
    for name, args in PUBLISHED.items():
        for field, value in settings_of(name, args).items():
            part, _, key = field.partition(".")
            if key:
                assert getattr(getattr(ModelConfig(), part), key) == value, field


def stored(file):
    """A published state dict as arrays that hold nothing but their shapes."""
    shapes = json.loads((NAMES / f"{file}.json").read_text())
    return {name: np.broadcast_to(np.float16(0), shape) for name, shape in shapes.items()}


@pytest.mark.slow
@pytest.mark.parametrize("file", FILES)
def test_every_published_name_has_its_place(file):
    tensors = stored(file)
    name = FILES[file]
    if "pos_emb" in tensors:
        tensors["pos_emb"] = np.float16(position_embedding(grid_coords(16), 1024))
    if "offset_perturbation" in tensors:
        tensors["offset_perturbation"] = offset_perturbation(ModelConfig().gaussians)
    buffers = {"pos_emb", "offset_perturbation"} & tensors.keys()
    piece = convert_trellis(name, PUBLISHED[name], tensors)
    found = flatten(piece.params)
    assert len(found) == len(tensors) - len(buffers)
    assert sum(v.size for v in found.values()) == sum(
        v.size for k, v in tensors.items() if k not in buffers
    )
    if piece.network != "uniart_vae":  # of the encoder, TRELLIS's is narrower than ours
        tree = build(piece.network, ModelConfig()).abstract()
        ours = flatten(tree[piece.part] if piece.part else tree)
        assert {k: v.shape for k, v in found.items()} == {k: v.shape for k, v in ours.items()}
    else:
        tree = flatten(build("uniart_vae", ModelConfig()).abstract()[piece.part])
        differing = {k for k in found if k not in tree or tree[k].shape != found[k].shape}
        widened = {
            "encoder": {"input_layer.kernel"},
            "decoder": {"out_layer.kernel", "out_layer.bias"},
        }
        assert differing == widened[piece.part] and tree.keys() <= found.keys()


def test_dinov2s_published_names_have_their_place():
    config, params = convert_dinov2(stored("dinov2_vitl14_reg"))
    assert config == DINOV2
    ours = build("image_encoder", ModelConfig(image_encoder=DINOV2)).abstract()
    assert flatten(params).keys() == flatten(ours).keys()


@pytest.mark.parametrize("file", SCOPED_OUT)
def test_what_has_no_place_says_so(file):
    assert out_of_scope(SCOPED_OUT[file], {"cond_channels": 768}, file)
    assert out_of_scope("Elastic" + SCOPED_OUT[file], {"cond_channels": 768})


def test_text_flows_are_told_from_image_flows():
    assert not out_of_scope("SLatFlowModel", {"cond_channels": 1024}, "mine")
    assert not out_of_scope("SLatFlowModel", {"cond_channels": 768}, "slat_flow_img_dit_B")
    assert out_of_scope("SLatFlowModel", {"cond_channels": 768}, "mine") == "conditioned on text"
    assert out_of_scope("SLatFlowModel", {"cond_channels": 1024}, "slat_flow_txt_dit_B")
    assert not out_of_scope("SLatEncoder", {"in_channels": 768})


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("slat_flow_img", {"pe_mode": "rope"}, r"pe_mode='rope' is not supported, only 'ape'"),
        ("slat_enc", {"attn_mode": "shift_window"}, r"attn_mode='shift_window' is not supported, only 'full' or 'swin'"),  # noqa: E501
        ("ss_flow_img", {"out_channels": 16}, r"out_channels 16 differs from in_channels 8"),
        ("ss_enc", {"in_channels": 3}, r"in_channels=3 is not supported, only 1"),
        ("ss_enc", {"norm_type": "batch"}, r"norm_type='batch' is not supported"),
        ("ss_dec", {"channels": "8,4"}, r"channels='8,4' is malformed"),
        ("ss_dec", {"num_res_blocks": True}, r"num_res_blocks=True is malformed"),
        ("slat_enc", {"num_experts": 4}, r"unknown: num_experts"),
        ("slat_dec_gs", {"representation_config": {"num_gaussians": 4}}, r"missing: voxel_size, perturb_offset"),  # noqa: E501
        ("slat_dec_gs", {"representation_config": 3}, r"representation_config=3 is malformed"),
    ],
)  # fmt: skip
def test_options_that_we_do_not_have(name, change, message):
    kind, args = NETWORKS[name]
    with pytest.raises(ValueError, match=message) as error:
        convert_trellis(kind, args | change, {})
    assert "\n" not in str(error.value)


def test_missing_arguments_and_upstreams_defaults():
    with pytest.raises(ValueError, match="missing: resolution, latent_channels, model_channels"):
        settings_of("SLatEncoder", {"in_channels": 8})
    args = {k: v for k, v in SLAT.items() if k not in ("num_heads", "attn_mode", "window_size")}
    found = settings_of("SLatEncoder", {"in_channels": 8, **args, "model_channels": 192})
    assert found["uniart_vae.num_heads"] == 3 and found["uniart_vae.window"] == 8
    flat = settings_of("SLatFlowModel", {"resolution": 16, **FLOW})
    assert flat["latent_flow.patch_size"] == 1 and flat["latent_flow.io_channels"] == ()


def test_position_tables_are_compared_and_kept_if_they_differ():
    kind, args = NETWORKS["ss_flow_img"]
    state, table = upstream(kind, args), np.asarray(position_embedding(grid_coords(4), 32))
    same = convert_trellis(kind, args, state | {"pos_emb": table.astype(np.float16)})
    assert "pos_emb" not in same.params and "checked" in same.notes[0]
    other = convert_trellis(kind, args, state | {"pos_emb": table * 0.9})
    np.testing.assert_array_equal(other.params["pos_emb"], table * np.float32(0.9))
    assert other.model.structure_flow.position_table and "kept" in other.notes[0]
    with pytest.raises(ValueError, match=r"pos_emb \[3, 32\] becomes \[3, 32\], expected"):
        convert_trellis(kind, args, state | {"pos_emb": table[:3]})


def test_gaussians_of_another_spread_are_refused():
    kind, args = NETWORKS["slat_dec_gs"]
    state = upstream(kind, args)
    for buffers in ({}, {"offset_perturbation": np.zeros((4, 3), np.float32)}):
        with pytest.raises(ValueError, match=r"offset_perturbation is .*; such a decoder"):
            convert_trellis(kind, args, state | buffers)


def test_networks_of_different_models_do_not_mix():
    def piece(name, **change):
        kind, args = NETWORKS[name]
        return convert_trellis(kind, args | change, upstream(kind, args | change))

    with pytest.raises(
        ValueError,
        match=r"grid\.resolution is 16 in SLatEncoder and 32 in SLatF.*; uniart_vae\.latent_channels is 8",  # noqa: E501
    ):
        compose(
            [
                piece("slat_enc"),
                piece("slat_flow_img", resolution=32, in_channels=4, out_channels=4),
            ]
        )
    with pytest.raises(ValueError, match=r"has 8 cells a side, a grid of 16 halved 2 times has 4"):
        compose([piece("slat_enc"), piece("ss_flow_img", resolution=8)])
    with pytest.raises(ValueError, match=r"different widths \[16, 24\]"):
        compose([piece("slat_flow_img", cond_channels=16), piece("ss_flow_img")])
    with pytest.raises(ValueError, match="several networks of class SLatEncoder"):
        compose([piece("slat_enc"), piece("slat_enc")])


@pytest.mark.slow
def test_a_filled_network_is_upstreams_where_it_can_be():
    pieces = []
    for name in ("slat_enc", "slat_dec_gs"):
        kind, args = NETWORKS[name]
        buffers = (
            {"offset_perturbation": offset_perturbation(convert_settings(args))}
            if "gs" in name
            else {}
        )
        pieces.append(convert_trellis(kind, args, upstream(kind, args) | buffers))
    model, networks = compose(pieces, seed=3)
    filled, own = flatten(networks["uniart_vae"].params), flatten(pieces[1].params)
    kernel = pieces[0].params["input_layer"]["kernel"]
    np.testing.assert_array_equal(filled["encoder.input_layer.kernel"][:24], kernel)
    assert not filled["encoder.input_layer.kernel"][24:].any() and len(kernel) == 24
    for key, value in own.items():
        if not key.startswith("out_layer"):
            np.testing.assert_array_equal(filled[f"decoder.{key}"], value)
    assert not any(key.startswith("decoder.out_layer") for key in filled)
    drawn = flatten(jax.jit(build("uniart_vae", model).init)(jax.random.key(3)))
    for key in filled:
        if key.startswith(("front.", "geometry_head.", "segmentation_head.", "articulation_head.")):
            np.testing.assert_allclose(filled[key], drawn[key], rtol=1e-6)
    assert set(networks["uniart_vae"].new) == {
        "front",
        "geometry_head",
        "segmentation_head",
        "articulation_head",
    }
    assert networks["gaussian_decoder"].params is pieces[1].params
    assert filled.keys() == flatten(build("uniart_vae", model).abstract()).keys()
    assert abstract("SLatGaussianDecoder", NETWORKS["slat_dec_gs"][1]).keys() == own.keys()


def convert_settings(args):
    from uniart_jax.weights.trellis_options import model_of

    return model_of(settings_of("SLatGaussianDecoder", args)).gaussians

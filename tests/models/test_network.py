"""What every network has in common: parameters by name, initial zeros, precision."""

import dataclasses
import sys
import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from toy import MODEL, flow_arguments, init, voxel_batch

from uniart_jax.config import IMAGE_ENCODERS as IMAGE_KINDS
from uniart_jax.config import (
    STAGES,
    ImageEncoderConfig,
    ImageEncoderKind,
    ModelConfig,
    from_json,
    to_json,
)
from uniart_jax.models.image_encoder import ImageEncoder
from uniart_jax.models.network import (
    IMAGE_ENCODERS,
    MODULES,
    TOLD,
    build,
    differences,
    is_of_this_package,
    kept_of_model,
    network_class,
)
from uniart_jax.models.structure_vae import StructureVAE


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
    with pytest.raises(ValueError, match=r"encoder\.input_layer\.bias is \[5\], expected \[6\]"):
        network.apply(params, occupancy)
    with pytest.raises(ValueError, match="image_encoder, structure_vae"):
        build("decoder", MODEL)


def test_a_message_holds_some_names_and_says_how_many_more():
    expected = {f"layer.{k:03d}": "float32[4]" for k in range(100)}
    (line,) = differences(expected, {})
    assert line.startswith("missing: layer.000, layer.001")
    assert line.count(",") == TOLD - 1 and line.endswith(f"and {100 - TOLD} more")
    assert differences({"a": 1}, {"a": 2}) == ["mismatched: a is 2, expected 1"]


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


def test_equal_configs_give_one_network_and_lists_in_them_are_no_error():
    vae = dataclasses.replace(MODEL.structure_vae, channels=tuple(MODEL.structure_vae.channels))
    equal = dataclasses.replace(MODEL, structure_vae=vae)
    assert equal is not MODEL
    assert build("structure_vae", equal) is build("structure_vae", MODEL)
    assert build("uniart_vae", MODEL) is not build("structure_vae", MODEL)
    wider = dataclasses.replace(vae, channels=[6, 10])
    other = build("structure_vae", dataclasses.replace(MODEL, structure_vae=wider))
    assert str(other) != str(build("structure_vae", MODEL))


def test_what_cannot_be_chosen_is_told_with_the_choices():
    with pytest.raises(ValueError, match=r"model\.compute_dtype is 'bf16'; .* float32, bfloat16$"):
        dataclasses.replace(MODEL, compute_dtype="bf16")
    with pytest.raises(ValueError, match=r"model\.kernel is 'flash'; .* xla, .* plain$"):
        dataclasses.replace(MODEL, kernel="flash")
    every = ", ".join([*STAGES, "gaussian_decoder"])
    with pytest.raises(ValueError, match=f"network 'x' is unknown; choose one of {every}$"):
        build("x", MODEL)


class Doubled(StructureVAE):
    """A network of one's own in the place of another."""

    def __call__(self, *given, **options):
        return {name: 2 * value for name, value in super().__call__(*given, **options).items()}


@pytest.mark.parametrize("entry", [Doubled, f"{__name__}_own.network:Doubled"])
def test_a_network_may_be_a_class_of_ones_own(monkeypatch, entry):
    before = build("structure_vae", MODEL)
    assert is_of_this_package(MODEL)
    own = types.SimpleNamespace(Doubled=Doubled)
    monkeypatch.setitem(sys.modules, f"{__name__}_own.network", own)
    monkeypatch.setitem(sys.modules, f"{__name__}_own", own)
    monkeypatch.setitem(MODULES, "structure_vae", entry)
    network = build("structure_vae", MODEL)
    params, occupancy = init(before), np.ones((1, 8, 8, 8), np.float32)
    once, twice = (jax.jit(n.apply)(params, occupancy)["logits"] for n in (before, network))
    np.testing.assert_allclose(twice, 2 * once, rtol=1e-5)
    assert not is_of_this_package(MODEL)
    jitted = jax.jit(lambda x: x)
    assert kept_of_model(jitted, "x", MODEL) is jitted  # a kept one could be of another class


def test_an_image_encoder_of_ones_own_has_a_kind_and_a_network(monkeypatch):
    with pytest.raises(ValueError, match=r"architecture is 'mine'; choose one of volume, dinov2, "):
        ImageEncoderConfig(architecture="mine")
    monkeypatch.setitem(IMAGE_KINDS, "mine", ImageEncoderKind(trained=False, spatial=True))
    encoder = dataclasses.replace(MODEL.image_encoder, architecture="mine")
    model = dataclasses.replace(MODEL, image_encoder=encoder)
    with pytest.raises(ValueError, match="'mine' has no network; choose one of volume, dinov2, "):
        build("image_encoder", model)
    monkeypatch.setitem(IMAGE_ENCODERS, "mine", ImageEncoder)
    assert build("image_encoder", model).abstract().keys()
    assert from_json(ModelConfig, to_json(model)) == model


@pytest.mark.parametrize("entry", ["absent.module:A", "structure_vae:Absent", "absent:A"])
def test_an_entry_that_names_no_class_is_one_line(entry):
    with pytest.raises(ValueError, match=f"^network '{entry}': .*give a class, or package.module"):
        network_class(entry)

"""What every network has in common: parameters by name, initial zeros, precision."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from toy import MODEL, flow_arguments, init, voxel_batch

from uniart_jax.config import STAGES
from uniart_jax.models.network import TOLD, build, differences


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

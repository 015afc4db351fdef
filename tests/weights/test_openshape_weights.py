"""OpenShape's and OpenCLIP's published files -> our encoders: names and shapes at full size,
``uniart convert openshape`` at toy size."""

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from official import torch_state
from rich.console import Console
from safetensors.numpy import save_file

from uniart_jax import cli
from uniart_jax.config import from_json
from uniart_jax.models import openclip, openshape
from uniart_jax.weights import conversion
from uniart_jax.weights.mapping import flatten
from uniart_jax.weights.openclip import convert_image_tower
from uniart_jax.weights.openshape import OpenShapeConfig, convert_point_encoder, read_encoders


def published_point_encoder():
    """Names and shapes of ``model.pt``'s state dict, as Colin97/OpenShape_code's ``ppat.make`` with
    scaling 4 builds it."""
    shapes = {"ppat.cls_token": (512,)}
    for i, (inputs, outputs) in enumerate([(9, 64), (64, 64), (64, 256)]):
        shapes[f"ppat.sa.mlp_convs.{i}.weight"] = (outputs, inputs, 1, 1)
        shapes[f"ppat.sa.mlp_convs.{i}.bias"] = (outputs,)
        for name in ("weight", "bias", "running_mean", "running_var"):
            shapes[f"ppat.sa.mlp_bns.{i}.{name}"] = (outputs,)
        shapes[f"ppat.sa.mlp_bns.{i}.num_batches_tracked"] = ()
    shapes |= {"ppat.lift.0.weight": (512, 259, 1), "ppat.lift.0.bias": (512,)}
    shapes |= {"ppat.lift.2.weight": (512,), "ppat.lift.2.bias": (512,)}
    for i in range(12):
        layer = f"ppat.transformer.layers.{i}"
        for j in (0, 1):
            shapes |= {f"{layer}.{j}.norm.weight": (512,), f"{layer}.{j}.norm.bias": (512,)}
        shapes[f"{layer}.0.fn.to_qkv.weight"] = (1536, 512)
        shapes |= {
            f"{layer}.0.fn.to_out.0.weight": (512, 512),
            f"{layer}.0.fn.to_out.0.bias": (512,),
        }
        shapes |= {f"{layer}.1.fn.net.0.weight": (1536, 512), f"{layer}.1.fn.net.0.bias": (1536,)}
        shapes |= {f"{layer}.1.fn.net.3.weight": (512, 1536), f"{layer}.1.fn.net.3.bias": (512,)}
    shapes |= {"proj.weight": (1280, 512), "proj.bias": (1280,)}
    return {f"module.{name}": shape for name, shape in shapes.items()}


def published_image_tower():
    """Names and shapes of open_clip's ViT-bigG-14 (``model_configs``, ``VisionTransformer``), and
    some of its text tower."""
    shapes = {
        "class_embedding": (1664,),
        "positional_embedding": (257, 1664),
        "proj": (1664, 1280),
        "conv1.weight": (1664, 3, 14, 14),
    }
    for norm in ("ln_pre", "ln_post"):
        shapes |= {f"{norm}.weight": (1664,), f"{norm}.bias": (1664,)}
    for i in range(48):
        block = f"transformer.resblocks.{i}"
        for norm in ("ln_1", "ln_2"):
            shapes |= {f"{block}.{norm}.weight": (1664,), f"{block}.{norm}.bias": (1664,)}
        shapes |= {
            f"{block}.attn.in_proj_weight": (4992, 1664),
            f"{block}.attn.in_proj_bias": (4992,),
        }
        shapes |= {
            f"{block}.attn.out_proj.weight": (1664, 1664),
            f"{block}.attn.out_proj.bias": (1664,),
        }
        shapes |= {f"{block}.mlp.c_fc.weight": (8192, 1664), f"{block}.mlp.c_fc.bias": (8192,)}
        shapes |= {f"{block}.mlp.c_proj.weight": (1664, 8192), f"{block}.mlp.c_proj.bias": (1664,)}
    visual = {f"visual.{name}": shape for name, shape in shapes.items()}
    text = {"positional_embedding": (77, 1280), "transformer.resblocks.0.ln_1.weight": (1280,)}
    return visual | text | {"logit_scale": ()}


def weightless(shapes):
    """Arrays of these shapes that take no memory."""
    kinds = {n: np.int64(0) if n.endswith("tracked") else np.float32(0) for n in shapes}
    return {name: np.broadcast_to(kinds[name], shape) for name, shape in shapes.items()}


@pytest.mark.parametrize(
    ("published", "converter", "abstract"),
    [
        (published_point_encoder(), convert_point_encoder, openshape.abstract(openshape.PointEncoderConfig())),  # noqa: E501
        (published_image_tower(), convert_image_tower, openclip.abstract(openclip.ImageTowerConfig())),  # noqa: E501
    ],
    ids=["point encoder", "image tower"],
)  # fmt: skip
def test_the_published_names_and_shapes_fill_everything(published, converter, abstract):
    found = {name: value.shape for name, value in flatten(converter(weightless(published))).items()}
    assert found == {name: leaf.shape for name, leaf in flatten(abstract).items()}


def test_what_does_not_fit_is_listed():
    shapes = published_point_encoder()
    del shapes["module.ppat.lift.0.bias"]
    shapes["module.ppat.extra"] = (3,)
    shapes["module.proj.weight"] = (768, 512)  # the one for CLIP ViT-L/14
    shapes["module.ppat.sa.mlp_convs.0.weight"] = (64, 9, 3, 3)
    with pytest.raises(
        ValueError, match="OpenShape's point encoder: the tensors do not fit"
    ) as error:
        convert_point_encoder(weightless(shapes))
    for part in (
        "missing: ppat.lift.0.bias",
        "extra: ppat.extra",
        "proj.weight [768, 512]",
        "mlp_convs.0.weight [64, 9, 3, 3]",
    ):
        assert part in str(error.value)
    with pytest.raises(ValueError, match="no tensor is called visual"):
        convert_image_tower({"vision_model.embeddings.class_embedding": np.zeros(1664)})


@pytest.fixture(scope="module")
def toy():
    """(config, the two published state dicts at toy size): the parity fixture's."""
    arrays = np.load(Path(__file__).parents[1] / "parity" / "openshape.npz", allow_pickle=False)
    config = from_json(OpenShapeConfig, str(arrays["config"]))
    state = {k[3:]: arrays[k] for k in arrays.files if k.startswith("sd/")}
    points = {k: v for k, v in state.items() if k.startswith("module.")}
    tower = {k: v for k, v in state.items() if k.startswith("visual.")}
    return config, points, tower | {"ln_final.weight": np.ones(8, np.float32)}


@pytest.fixture
def published(toy, tmp_path):
    source = tmp_path / "published"
    source.mkdir()
    torch_state(source / "model.pt", toy[1], "state_dict")
    save_file(toy[2], source / "open_clip_model.safetensors")
    return source


def test_a_folder_of_both_is_converted_and_read(toy, published, tmp_path):
    config, points, tower = toy
    out = conversion.convert_openshape_folder(published, tmp_path / "weights", config=config)
    names = {"openshape.json", "point_encoder.safetensors", "image_tower.safetensors"}
    assert {p.name for p in out.iterdir()} == names | {
        f"image_tower-0{i}.safetensors" for i in (0, 1)
    }
    read = read_encoders(out)
    assert read[0] == config
    for found, expected in zip(
        read[1:],
        (
            convert_point_encoder(points, config.point_encoder),
            convert_image_tower(tower, config.image_tower),
        ),
        strict=True,
    ):
        found, expected = flatten(found), flatten(expected)
        assert found.keys() == expected.keys()
        for name, value in expected.items():
            assert found[name].dtype == value.dtype == np.float16  # as wide as it was
            np.testing.assert_array_equal(found[name], value, err_msg=name)
    with pytest.raises(ValueError, match="not empty"):
        conversion.convert_openshape_folder(published, out, config=config)
    conversion.convert_openshape_folder(published, out, overwrite=True, config=config)


def test_damaged_weights(toy, published, tmp_path):
    out = conversion.convert_openshape_folder(published, tmp_path / "weights", config=toy[0])
    card = json.loads((out / "openshape.json").read_text())
    (out / "openshape.json").write_text(
        json.dumps(card | {"point_encoder": card["point_encoder"] | {"width": 33}})
    )
    with pytest.raises(
        ValueError, match=r"point_encoder\.safetensors': not as openshape\.json says: .*cls_token"
    ):
        read_encoders(out)
    (out / "openshape.json").write_text(json.dumps(card | {"colour": 1}))
    with pytest.raises(ValueError, match=r"openshape\.json': .*colour"):
        read_encoders(out)
    (out / "openshape.json").write_text(json.dumps(card))
    (out / "image_tower-01.safetensors").unlink()
    with pytest.raises(FileNotFoundError, match="image_tower-01"):
        read_encoders(out)
    with pytest.raises(FileNotFoundError, match="uniart convert openshape"):
        read_encoders(tmp_path)


def run(capsys, monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", ["uniart", "convert", "openshape", *map(str, arguments)])
    monkeypatch.setattr(conversion, "console", Console(stderr=True, width=200))
    with pytest.raises(SystemExit) as error:
        cli.main()
    return error.value.code, " ".join(capsys.readouterr().err.split())


def test_the_command_says_what_is_wrong_and_leaves_nothing(
    published, tmp_path, capsys, monkeypatch
):
    out = tmp_path / "weights"
    code, said = run(capsys, monkeypatch, published, "--out", out)
    assert code == 2 and "model.pt" in said and "do not fit" in said  # a toy is not the real one
    (published / "model.pt").unlink()
    code, said = run(capsys, monkeypatch, published, "--out", out)
    assert code == 2 and re.search(
        r"no model\.pt or model\.safetensors in it; put model\.pt of huggingface\.co/OpenShape",
        said,
    )
    code, said = run(capsys, monkeypatch, tmp_path / "nowhere", "--out", out)
    assert code == 2 and "no such folder" in said
    assert not out.exists() and not list(tmp_path.glob(".weights*"))

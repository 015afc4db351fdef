"""``uniart layout`` at the keyboard: what it writes, and what it refuses."""

import inspect
import json

import numpy as np
import pytest
from drawn import parameters
from PIL import Image

from uniart_jax.cli.layout import layout
from uniart_jax.config import Config, LayoutConfig, ModelConfig
from uniart_jax.inference.layouts import joined, load_layout_predictor, mirror_parts
from uniart_jax.models.checkpoint_files import write_config, write_network
from uniart_jax.models.network import build
from uniart_jax.voxels.joint_code import align, canonical
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.part_table import THRESHOLD


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory):
    """A tiny layout network with random weights."""
    small = LayoutConfig(
        queries=6, backbone="convolutions", map_channels=16, width=16, layers=1, heads=2,
        sketch_width=16, head_width=16, image_size=32,
    )  # fmt: skip
    model = ModelConfig(layout=small)
    folder = tmp_path_factory.mktemp("checkpoint")
    write_config(folder, Config(model=model))
    write_network(folder, "layout", parameters(build("layout", model)))
    return folder


@pytest.fixture
def image(tmp_path):
    pixels = np.full((50, 40, 4), 200, np.uint8)
    pixels[:8, :, 3] = 0
    Image.fromarray(pixels).save(tmp_path / "thing.png")
    return tmp_path / "thing.png"


def test_writes_tables_and_pictures(tmp_path, image, checkpoint, capsys):
    out = tmp_path / "out"
    layout((image,), out=out, checkpoint=str(checkpoint))
    found = Layout.from_json((out / "thing.json").read_text())
    said = f"move, certainty {found.certainty:.2f} -> {out / 'thing'}.json"  # on one line
    assert said in capsys.readouterr().err
    assert 1 <= len(found) <= 6 and found.camera.shape == (7,)
    assert Image.open(out / "thing.png").size == (384, 384)
    with pytest.raises(ValueError, match="not empty"):
        layout((image,), out=out, checkpoint=str(checkpoint))
    layout((image,), out=out, checkpoint=str(checkpoint), overwrite=True, threshold=0.0)
    assert len(json.loads((out / "thing.json").read_text())["parts"]) == 6


def test_a_vision_language_model_is_asked(tmp_path, image, checkpoint, capsys):
    answer = {
        "view": {"azimuth": 20, "elevation": 30},
        "parts": [
            {"name": "case", "parent": None, "box": {"center": [0, 0, 0], "size": [0.3, 0.2, 0.4]}},
            {
                "name": "flap",
                "parent": "case",
                "box": {"center": [-0.16, 0, 0], "size": [0.02, 0.2, 0.4]},
                "joint": {"origin": [-0.15, 0.1, 0], "direction": [0, 0, -1], "angle": [0, 1.5]},
            },
        ],
    }
    (tmp_path / "answer.json").write_text(json.dumps(answer))
    out, told = tmp_path / "out", f"cat {tmp_path / 'answer.json'}"
    layout((image,), out=out, checkpoint=str(checkpoint), ask=told)
    found = Layout.from_json((out / "thing.json").read_text())
    assert found.names == ("case", "flap") and found.camera.shape == (7,)
    assert found.size == pytest.approx(0.4)
    said = capsys.readouterr().err
    assert f"thing: asking '{told}'" in said and "thing: 2 parts, 1 of them move" in said
    with pytest.raises(ValueError, match="ask: 'false' ended with 1"):
        layout((image,), out=tmp_path / "no", checkpoint=str(checkpoint), ask="false")
    assert not (tmp_path / "no").exists()


def test_refusals_leave_nothing(tmp_path, image, checkpoint):
    out = tmp_path / "out"
    with pytest.raises(FileNotFoundError, match="no such file"):
        layout((image, tmp_path / "absent.png"), out=out, checkpoint=str(checkpoint))
    with pytest.raises(ValueError, match="two images are called 'thing'"):
        layout((image, image), out=out, checkpoint=str(checkpoint))
    with pytest.raises(ValueError, match="threshold"):
        layout((image,), out=out, checkpoint=str(checkpoint), threshold=1.5)
    without = tmp_path / "without"
    write_config(without, Config())
    with pytest.raises(ValueError, match="it has no layout network"):
        layout((image,), out=out, checkpoint=str(without))
    assert not out.exists()


def test_a_picture_is_read_alike_alone_and_among_others(checkpoint):
    predict = load_layout_predictor(str(checkpoint))
    images = list(np.random.default_rng(0).integers(0, 255, (10, 32, 32, 3)).astype(np.uint8))
    many, alone = predict(images), predict(images[9:])
    for name, values in alone[0].items():
        np.testing.assert_allclose(values, many[9][name], atol=1e-4)


def test_a_mirrored_picture_has_the_mirrored_parts(checkpoint):
    """Both looks are at both pictures, so what is found cannot depend on which was given."""
    predict = load_layout_predictor(str(checkpoint))
    image = np.random.default_rng(1).integers(0, 255, (32, 32, 3)).astype(np.uint8)
    (found,) = predict([image])
    (other,) = predict([np.ascontiguousarray(image[:, ::-1])])
    other = mirror_parts(other)
    order, match = np.argsort(found["exists"]), np.argsort(other["exists"])
    for name in ("exists", "corners", "colors"):
        np.testing.assert_allclose(found[name][order], other[name][match], atol=1e-4)
    codes = align(other["codes"][match], found["codes"][order])
    np.testing.assert_allclose(found["codes"][order], codes, atol=1e-3)
    assert inspect.signature(layout).parameters["threshold"].default == THRESHOLD


def test_rows_of_two_looks_are_matched_and_averaged():
    rng = np.random.default_rng(0)
    one = {
        "corners": np.sort(rng.uniform(-0.5, 0.5, (4, 2, 3)), 1).reshape(4, 6),
        "codes": canonical(rng.normal(size=(4, 9))),
        "colors": rng.random((4, 3)),
        "exists": np.array([3.0, 3.0, 3.0, -3.0]),
        "parents": rng.normal(size=(4, 4)),
        "camera": rng.normal(size=7),
    }
    order = np.array([2, 0, 3, 1])
    other = {name: values[order] if name != "camera" else values for name, values in one.items()}
    other["parents"] = one["parents"][np.ix_(order, order)]
    other["corners"] = other["corners"] + 0.02
    other["corners"][1] += 1.0  # row 0 of the first look is elsewhere, and a little surer
    other["exists"] = other["exists"] - np.array([0, 1.0, 0, 0])
    found = joined(one, other)
    np.testing.assert_allclose(found["corners"][1:], one["corners"][1:] + 0.01, atol=1e-6)
    np.testing.assert_allclose(found["corners"][0], one["corners"][0], atol=1e-6)
    np.testing.assert_allclose(found["exists"], [2.5, 3, 3, -3])
    for name in ("codes", "parents", "colors", "camera"):
        np.testing.assert_allclose(found[name], one[name], atol=1e-9)

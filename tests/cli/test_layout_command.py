"""``uniart layout`` at the keyboard: what it writes, and what it refuses."""

import json

import jax
import numpy as np
import pytest
from PIL import Image

from uniart_jax.cli.layout import layout
from uniart_jax.config import Config, ImageEncoderConfig, LayoutConfig, ModelConfig
from uniart_jax.layouts import load_layout_predictor
from uniart_jax.models.network import build
from uniart_jax.training.export import export_network, write_config
from uniart_jax.voxels.layout import Layout


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory):
    """A tiny layout network with random weights."""
    small = LayoutConfig(
        queries=6, backbone="convolutions", map_channels=16, width=16, layers=1, heads=2,
        sketch_width=16, head_width=16,
    )  # fmt: skip
    model = ModelConfig(image_encoder=ImageEncoderConfig(image_size=32), layout=small)
    folder = tmp_path_factory.mktemp("checkpoint")
    write_config(folder, Config(model=model))
    export_network(folder, "layout", build("layout", model).init(jax.random.key(0)))
    return folder


@pytest.fixture
def image(tmp_path):
    pixels = np.full((50, 40, 4), 200, np.uint8)
    pixels[:8, :, 3] = 0
    Image.fromarray(pixels).save(tmp_path / "thing.png")
    return tmp_path / "thing.png"


def test_writes_tables_and_pictures(tmp_path, image, checkpoint):
    out = tmp_path / "out"
    layout((image,), out=out, checkpoint=str(checkpoint))
    found = Layout.from_json((out / "thing.json").read_text())
    assert 1 <= len(found) <= 6 and found.camera.shape == (7,)
    assert Image.open(out / "thing.png").size == (384, 384)
    with pytest.raises(ValueError, match="not empty"):
        layout((image,), out=out, checkpoint=str(checkpoint))
    layout((image,), out=out, checkpoint=str(checkpoint), overwrite=True, threshold=0.0)
    assert len(json.loads((out / "thing.json").read_text())["parts"]) == 6


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

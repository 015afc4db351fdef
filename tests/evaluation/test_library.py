"""A folder of assets as a library: its parts, and the asset that looks most like an image."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import toy_assets

from uniart_jax.config import Config, GridConfig, ImageEncoderConfig, ModelConfig
from uniart_jax.data.images import PICTURE_SIDE
from uniart_jax.evaluation import library as library_module
from uniart_jax.evaluation.library import VIEWS, find_assets, library_pictures
from uniart_jax.evaluation.metric import at_rest
from uniart_jax.evaluation.retrieval import make_asset_library, make_asset_retrieval, retrieve_parts
from uniart_jax.objects.load import load_object
from uniart_jax.pipeline import Pipeline
from uniart_jax.voxels.typed_batches import Condition

SIZE = 32


@pytest.fixture
def root(tmp_path) -> Path:
    """Three assets that look different, one below a category, and one that cannot be read."""
    for name, height in (("a", 0.2), ("Table/b", 1.0), ("c", 3.0)):
        toy_assets.write(tmp_path / "assets" / name, "body", "lid", height=height)
    (tmp_path / "assets" / "d.urdf").write_text("<robot")
    return tmp_path / "assets"


@pytest.fixture
def messages(monkeypatch) -> list[str]:
    told: list[str] = []
    monkeypatch.setattr(library_module.console, "print", lambda text, **_: told.append(text))
    return told


def test_assets_are_found_below_their_folder(root):
    assets = find_assets(root)
    assert [a.path for a in assets] == ["Table/b", "a", "c", "d.urdf"]
    turned = find_assets(root, front="+x")[1]
    low = [a.load().parts[1].box for a in (assets[1], turned)]
    np.testing.assert_allclose(low[0][:3] * [-1, -1, 1], low[1][:3], atol=1e-9)
    obj = assets[2].at_rest()
    assert obj.scale == 1 and np.ptp(obj.bounds, axis=0).max() == pytest.approx(1)


@pytest.mark.parametrize(
    ("name", "front", "said"),
    [
        ("nowhere", "-x", "library '.*nowhere': no such folder"),
        ("empty", "-x", "library '.*empty': no URDF, MJCF or object.json in it or below it"),
        ("assets", "x", "library: front must be one of -x, "),
    ],
)
def test_what_is_no_library_is_said(root, name, front, said):
    (root.parent / "empty").mkdir()
    with pytest.raises((FileNotFoundError, ValueError), match=said):
        find_assets(root.parent / name, front=front)


def test_parts_of_assets_fill_the_targets_boxes(root, messages):
    assets = find_assets(root)
    library = make_asset_library(assets)
    assert [source.path for source, _ in library.places] == [
        "Table/b",
        "Table/b",
        "a",
        "a",
        "c",
        "c",
    ]
    assert len(messages) == 1 and "1 of 4 assets cannot be used, the first because: " in messages[0]
    target = at_rest(load_object(root / "c"))
    found = retrieve_parts(target, library)
    for k, (part, true) in enumerate(zip(found.parts, target.parts, strict=True)):
        assert library.places[library.nearest(true.box[3:])] == (assets[2], k)
        np.testing.assert_allclose(part.mesh.vertices, true.mesh.vertices, atol=1e-9)
    with pytest.raises(ValueError, match="1 of 1 assets cannot be used"):
        make_asset_library(assets[3:])


def test_pictures_are_kept_and_the_same_every_time(root, tmp_path, messages, monkeypatch):
    assets = find_assets(root)
    made = dict(library_pictures(assets, tmp_path / "pictures", SIZE))
    assert list(made) == assets[:3] and len(messages) == 1
    for views in made.values():
        assert views.shape == (VIEWS, SIZE, SIZE, 4) and views.dtype == np.uint8
        assert all(view[..., 3].any() for view in views)
    np.testing.assert_array_equal(made[assets[0]], assets[0].pictures(SIZE))
    monkeypatch.setattr(library_module, "render", None)  # nothing is drawn again
    again = dict(library_pictures(assets, tmp_path / "pictures", SIZE))
    for asset, views in made.items():
        np.testing.assert_array_equal(again[asset], views)
    with pytest.raises(ValueError, match="1 of 1 assets cannot be used"):
        list(library_pictures(assets[3:], tmp_path / "pictures", SIZE))


def test_the_asset_whose_picture_was_shown_is_found(root, tmp_path, messages):
    """Features are the pictures themselves: tested is the index, and which asset a view is of."""

    class Pictures:
        grid, encoder = GridConfig(16, 2, max_parts=16), ImageEncoderConfig(image_size=SIZE)
        config = Config(model=ModelConfig(grid=grid, image_encoder=encoder))
        prepare, _crop, cut_out = Pipeline.prepare, Pipeline._crop, Pipeline.cut_out
        mask_predictor = None

        def encode_images(self, images):
            tokens = images.reshape(len(images), SIZE, -1) - 0.5
            return Condition(tokens, np.zeros((len(images), 4, 4, 4, 1)))

    pipeline: Any = Pictures()
    assets = find_assets(root)
    retrieve = make_asset_retrieval(pipeline, assets, tmp_path / "pictures")
    for asset in assets[:3]:
        for view in asset.pictures(PICTURE_SIDE):
            assert retrieve(pipeline.prepare(view)) == asset

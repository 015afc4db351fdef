"""A folder of pictures as backgrounds: read in order, shown in part, refused with its name."""

import numpy as np
import pytest
from hand_records import first_of
from PIL import Image

from uniart_jax.config import DataConfig, GridConfig, LayoutConfig, MaskConfig, ModelConfig
from uniart_jax.data.backdrop_pictures import SHARE, picture_backdrop, picture_paths
from uniart_jax.data.backdrops import training_backdrop
from uniart_jax.data.layout_batches import claimed_settings

MODEL = ModelConfig(
    grid=GridConfig(32, 4, 16),
    layout=LayoutConfig(image_size=32),
    mask=MaskConfig(channels=8, image_size=64),
)


@pytest.fixture
def folder(tmp_path):
    """Three pictures of one colour each, and a file that is none; a wide one has a seam."""
    for name, color in (("b.png", (200, 40, 40)), ("a.JPG", (40, 200, 40)), ("c.webp", 3 * (90,))):
        Image.new("RGB", (160, 120), color).save(
            tmp_path / name, "JPEG" if name.endswith("JPG") else None
        )
    (tmp_path / "notes.txt").write_text("where they come from")
    (tmp_path / ".a.jpg").write_bytes(b"what some systems put beside a picture")
    return tmp_path


def test_pictures_are_found_in_order(folder):
    assert [path.name for path in picture_paths(str(folder))] == ["a.JPG", "b.png", "c.webp"]
    assert picture_paths("") == ()


def test_a_folder_without_pictures_is_refused_by_name(tmp_path):
    for given in (tmp_path, tmp_path / "missing"):
        with pytest.raises(ValueError, match=f"data.backgrounds '{given}' holds no pictures"):
            picture_paths(str(given))
    data = DataConfig(layouts=str(tmp_path / "blocks"), backgrounds=str(tmp_path))
    with pytest.raises(ValueError, match="holds no pictures"):
        claimed_settings(data, MODEL)
    assert not (tmp_path / "blocks").exists()


def test_a_damaged_picture_is_refused_by_name(folder):
    (folder / "a.JPG").write_bytes((folder / "a.JPG").read_bytes()[:200])
    with pytest.raises(ValueError, match=r"image '.*a\.JPG': truncated or damaged"):
        picture_backdrop(np.random.default_rng(0), picture_paths(str(folder))[:1], 32)


def test_a_backdrop_is_part_of_a_picture_in_another_light(folder):
    paths = picture_paths(str(folder))
    drawn = [picture_backdrop(np.random.default_rng(i), paths, 48) for i in range(60)]
    again = picture_backdrop(np.random.default_rng(7), paths, 48)
    np.testing.assert_array_equal(drawn[7], again)
    for picture in drawn:
        assert picture.shape == (48, 48, 3) and picture.dtype == np.float32
        assert picture.min() >= 0 and picture.max() <= 1
        assert np.ptp(picture, (0, 1)).max() < 0.05  # each picture is of one colour
    greenest = [int(p.mean((0, 1)).argmax()) for p in drawn]
    assert 10 <= greenest.count(1) <= 45 and 10 <= greenest.count(0) <= 45
    assert len({p.tobytes() for p in drawn}) == 60


def test_places_and_mirroring_differ(tmp_path):
    ramp = np.tile(np.arange(200, dtype=np.uint8), (100, 1))
    Image.fromarray(np.stack(3 * [ramp], -1)).save(tmp_path / "ramp.png")
    paths = picture_paths(str(tmp_path))
    drawn = [picture_backdrop(np.random.default_rng(i), paths, 32)[..., 0] for i in range(40)]
    rising = sum(picture[:, -1].mean() > picture[:, 0].mean() for picture in drawn)
    assert 8 <= rising <= 32
    means = np.array([picture.mean() for picture in drawn])
    assert means.std() > 0.08


def test_trainings_see_pictures_besides_others(folder, monkeypatch):
    monkeypatch.setattr(
        "uniart_jax.data.backdrops.picture_backdrop", lambda rng, paths, size: paths
    )
    paths = picture_paths(str(folder))
    drawn = [training_backdrop(np.random.default_rng(i), 24, paths) for i in range(200)]
    assert abs(sum(d is paths for d in drawn) / 200 - SHARE) < 0.12
    plain = [training_backdrop(np.random.default_rng(i), 24) for i in range(20)]
    assert all(isinstance(d, np.ndarray) for d in plain)


def test_every_network_that_sees_photographs_sees_them(folder, tmp_path, monkeypatch):
    """The batches of masks, and those of layouts whose pictures are cut out of photographs."""
    from uniart_jax.data import layout_batches, layouts, scene_batches

    seen = []

    def backdrop(rng, size, pictures=()):
        seen.append(pictures)
        return np.zeros((size, size, 3), np.float32)

    for module in (layouts, layout_batches):
        monkeypatch.setattr(module, "BLOCK", 3)
    monkeypatch.setattr(layout_batches, "WINDOW", 1)
    layout_batches._window.cache_clear()
    layout_batches._shuffled.cache_clear()
    data = DataConfig(
        layouts=str(tmp_path / "blocks"), backgrounds=str(folder), reuse=1, photographs=1.0
    )
    for module, batches in (
        (layout_batches, layout_batches.layout_batches),
        (scene_batches, scene_batches.scene_batches),
    ):
        monkeypatch.setattr(module, "training_backdrop", backdrop)
        seen.clear()
        first_of(batches(data, MODEL, 2))
        assert set(seen) == {picture_paths(str(folder))}
    layout_batches._window.cache_clear()
    layout_batches._shuffled.cache_clear()

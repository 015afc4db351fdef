"""Pictures with backgrounds: functions of their random numbers, with the mask of what they show."""

import dataclasses

import numpy as np
import pytest
from hand_records import first_of

from uniart_jax.config import DataConfig, GridConfig, LayoutConfig, MaskConfig, ModelConfig
from uniart_jax.data import layout_batches, layouts
from uniart_jax.data.scene_batches import scene_batches, validation_scenes
from uniart_jax.data.scenes import GRAIN, framed, scene

RED = np.array([220, 20, 30], np.uint8)
MODEL = ModelConfig(
    grid=GridConfig(32, 4, 16),
    layout=LayoutConfig(image_size=32),
    mask=MaskConfig(channels=8, image_size=64),
)


def disc(side=64, color=RED):
    """A disc over black, and its mask."""
    y, x = np.mgrid[:side, :side] - (side - 1) / 2
    mask = np.where(np.hypot(x, y) < 0.45 * side, 255, 0).astype(np.uint8)
    return np.where(mask[..., None] > 0, color, 0).astype(np.uint8), mask


def scenes(count=24, **given):
    others = [disc(color=np.array([20, 200, 60], np.uint8))] * 2
    return [scene(np.random.default_rng(i), disc(), others, 96, **given) for i in range(count)]


def test_a_scene_is_a_function_of_its_random_numbers():
    for (image, mask), (again, same) in zip(scenes(4), scenes(4), strict=True):
        assert image.shape == (96, 96, 3) and mask.shape == (96, 96)
        assert image.dtype == mask.dtype == np.uint8
        np.testing.assert_array_equal(image, again)
        np.testing.assert_array_equal(mask, same)
    assert not np.array_equal(scenes(2)[0][0], scenes(2)[1][0])


def test_the_mask_says_where_the_object_is():
    """A red disc is redder than what is around it, wherever it stands and however it is lit."""
    right = 0
    for image, mask in scenes():
        red = image[..., 0].astype(float) - image[..., 1:].mean(-1)
        right += red[mask > 200].mean() > red[mask < 20].mean() + 40
    assert right >= 22  # of 24: some backgrounds are red


def test_a_whole_object_is_neither_cut_off_nor_covered():
    for image, mask in scenes(whole=True):
        inside = mask > 127
        assert not (
            inside[0].any() or inside[-1].any() or inside[:, 0].any() or inside[:, -1].any()
        )
        rows, columns = np.flatnonzero(inside.any(1)), np.flatnonzero(inside.any(0))
        high, wide = rows[-1] - rows[0] + 1, columns[-1] - columns[0] + 1
        assert abs(high - wide) <= 2  # a disc stays a disc
        assert inside.sum() == pytest.approx(np.pi / 4 * high * wide, rel=0.06)
        assert image.shape == (96, 96, 3)
    hidden = [(mask > 127)[[0, -1]].any() or (mask > 127)[:, [0, -1]].any() for _, mask in scenes()]
    assert any(hidden)  # else some are


def test_some_objects_fill_the_picture_and_whole_ones_do_not():
    filled = [(mask > 127).mean() for _, mask in scenes(60)]
    assert 6 <= sum(share > 0.75 for share in filled) <= 24  # a disc is .79 of its square
    assert max((mask > 127).mean() for _, mask in scenes(60, whole=True)) < 0.72


def test_a_margin_is_no_object_and_frames_some_pictures(monkeypatch):
    monkeypatch.setattr("uniart_jax.data.scenes.FRAMED", 1.0)
    monkeypatch.setattr("uniart_jax.data.scenes.CLOSE_UP", 1.0)
    for image, mask in scenes(8):
        assert image.shape == (96, 96, 3) and mask.shape == (96, 96)
        edge = np.concatenate([image[:3].reshape(-1, 3), image[-3:].reshape(-1, 3)])
        assert (edge == edge[0, 0]).all()  # one gray value
        assert not mask[:3].any() and not mask[:, -3:].any() and (mask > 127).mean() > 0.2
    assert framed(np.ones((4, 5), np.uint8), 2, 7).tolist()[0] == [7] * 9


def test_grain_changes_the_object_alone_and_only_where_asked(monkeypatch):
    monkeypatch.setattr("uniart_jax.data.scenes.GRAINED", 1.0)
    monkeypatch.setattr("uniart_jax.data.scenes._taken", lambda rng, picture: picture)
    monkeypatch.setattr("uniart_jax.data.scenes._shadow", lambda rng, alpha: 0 * alpha)
    monkeypatch.setattr("uniart_jax.data.scenes._lit", lambda rng, color: color)
    back = np.full((96, 96, 3), 0.5, np.float32)

    def taken(seed, **given):
        return scene(np.random.default_rng(seed), disc(), (), 96, whole=True, back=back, **given)

    for seed in range(8):
        (plain, mask), (grained, same) = taken(seed), taken(seed, grain=GRAIN)
        np.testing.assert_array_equal(mask, same)
        assert (grained[mask == 0] == 0.5).all() and plain[mask == 255].std(0).max() < 0.01
        assert grained[mask == 255].std(0).max() > 0.01
        assert grained.min() >= 0 and grained.max() <= 1


def test_a_background_can_be_given():
    back = np.full((96, 96, 3), 0.5, np.float32)
    picture, mask = scene(np.random.default_rng(3), disc(), (), 96, whole=True, back=back)
    far = picture[mask == 0].astype(float)
    assert np.abs(far - far.mean()).max() < 90 and (back == 0.5).all()


@pytest.fixture
def data(tmp_path, monkeypatch):
    for module in (layouts, layout_batches):
        monkeypatch.setattr(module, "BLOCK", 3)
    monkeypatch.setattr(layout_batches, "WINDOW", 2)
    layout_batches._window.cache_clear()
    layout_batches._shuffled.cache_clear()
    yield DataConfig(layouts=str(tmp_path / "blocks"), reuse=2)
    layout_batches._window.cache_clear()
    layout_batches._shuffled.cache_clear()


def test_batches_resume_are_shared_and_show_an_object_anew(data):
    whole = first_of(scene_batches(data, MODEL, 4), 4)
    assert whole[0].image.shape == (4, 64, 64, 3) and whole[0].mask.shape == (4, 64, 64)
    assert whole[0].image.min() >= 0 and whole[0].image.max() <= 1 == whole[0].mask.max()
    (later,) = first_of(scene_batches(data, MODEL, 4), state={"batch": 2, "batch_size": 4})
    np.testing.assert_array_equal(later.image, whole[2].image)
    halves = [
        first_of(scene_batches(data, MODEL, 4, process_index=i, process_count=2))[0]
        for i in range(2)
    ]
    np.testing.assert_array_equal(np.concatenate([h.image for h in halves]), whole[0].image)
    flat = np.concatenate([batch.image for batch in whole[:3]])  # twice each of six objects
    assert len({picture.tobytes() for picture in flat}) == 12
    with pytest.raises(ValueError, match=r"data.first_block is -1"):
        scene_batches(dataclasses.replace(data, first_block=-1), MODEL, 4)


def test_validation_scenes_are_always_the_same(data):
    first, again = (validation_scenes(data, MODEL, 4) for _ in range(2))
    np.testing.assert_array_equal(first.image, again.image)
    assert len(first.image) == 4

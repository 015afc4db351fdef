"""The mask network in use: two looks, the second around what the first found."""

import numpy as np
import pytest

from uniart_jax.config import MaskConfig, ModelConfig
from uniart_jax.inference.masks import MaskPredictor, load_mask_predictor
from uniart_jax.models.checkpoint import Checkpoint

MODEL = ModelConfig(mask=MaskConfig(channels=8, width=16, image_size=64))


class Redness:
    """A network that takes what is red for the object; ``seen``: what it looked at."""

    def __init__(self):
        self.seen = []

    def __call__(self, params, image):
        self.seen.append(image[0])
        return 60 * (image[..., 0] - image[..., 1] - 0.5)


@pytest.fixture
def predictor():
    found = MaskPredictor(MODEL, {})
    found._run = Redness()
    return found


def picture(*boxes, height=300, width=400):
    """Red boxes (top, bottom, left, right) on grey, and where they are."""
    rgba = np.full((height, width, 4), 120, np.uint8)
    mask = np.zeros((height, width), bool)
    for top, bottom, left, right in boxes:
        mask[top:bottom, left:right] = True
    rgba[mask, :3] = 230, 20, 20
    return rgba, mask


def overlap(found, mask):
    return ((found > 127) & mask).sum() / ((found > 127) | mask).sum()


def test_a_small_object_is_looked_at_again_from_near(predictor):
    rgba, mask = picture((100, 160, 50, 90))
    found = predictor(rgba)
    assert found.shape == (300, 400) and found.dtype == np.uint8
    assert overlap(found, mask) > 0.97
    first, second = ((seen[..., 0] > seen[..., 1] + 0.3).mean() for seen in predictor._run.seen)
    assert first < 0.03 and second > 0.5


def test_the_mask_of_a_mirror_image_is_the_mirrored_mask(predictor):
    """Of a network that is surer of what lies to the left, and sees nothing at the right."""
    red = predictor._run
    slope = np.linspace(8, -10, 64, dtype=np.float32)
    predictor._run = lambda params, image: np.minimum(red(params, image), 6) + slope
    rgba, mask = picture((60, 240, 120, 330))
    found, turned = predictor(rgba), predictor(np.ascontiguousarray(rgba[:, ::-1]))
    assert np.abs(found[:, ::-1].astype(int) - turned).max() <= 3
    assert overlap(found, mask) > 0.95


def test_an_object_at_the_border_and_of_any_shape(predictor):
    for box in ((0, 300, 0, 120), (250, 300, 10, 390), (0, 60, 360, 400)):
        rgba, mask = picture(box)
        assert overlap(predictor(rgba), mask) > 0.95


def test_what_is_small_beside_it_is_left_out_and_its_parts_stay(predictor):
    rgba, _ = picture((50, 250, 50, 200), (60, 66, 300, 306), (100, 180, 230, 260))
    found = predictor(rgba)
    assert not found[55:70, 295:310].any() and (found[110:170, 235:255] > 200).all()


def test_nothing_is_no_object_and_everything_is_one(predictor):
    assert predictor(picture()[0]) is None
    assert (predictor(picture((0, 300, 0, 400))[0]) == 255).all()


def test_small_holes_are_closed_and_large_ones_stay(predictor):
    """Doors with a bright spot have none; a chair's back has slats."""
    rgba, _ = picture((50, 250, 50, 350))
    for top, bottom, left, right in ((100, 120, 100, 130), (150, 220, 180, 300)):
        rgba[top:bottom, left:right, :3] = 120
    found = predictor(rgba)
    assert (found[100:120, 100:130] == 255).all() and not found[160:210, 190:290].any()


def test_what_is_hardly_seen_within_an_object_is_the_object(predictor):
    red = predictor._run
    rgba, _ = picture((50, 250, 50, 350))
    predictor._run = lambda params, image: np.clip(red(params, image), -6, 0.5)
    found = predictor(rgba)
    assert (found[70:230, 70:330] == 255).all() and not found[:40].any()


def test_a_checkpoint_without_one_has_none(tmp_path):
    assert load_mask_predictor(None) is None and load_mask_predictor(Checkpoint(tmp_path)) is None

"""Crops as if cut out of photographs: the object, a mask with errors, and a camera code that fits
the new crop."""

import numpy as np
import pytest

from uniart_jax.data.cameras import camera_codes
from uniart_jax.data.images import crop, crop_window
from uniart_jax.data.photographs import mistaken, photographed, reframed
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.objects.states import sample_state
from uniart_jax.procedural import generate
from uniart_jax.visual.render import render, sample_camera


def blob(side=96):
    """A rounded square over black, and its mask."""
    y, x = np.abs(np.mgrid[:side, :side] - (side - 1) / 2)
    mask = np.where(np.maximum(x, y * 1.3) < 0.4 * side, 255, 0).astype(np.uint8)
    return np.where(mask[..., None] > 0, [200, 120, 40], 0).astype(np.uint8), mask


CAMERA = np.array([0.6, 0.8, 0.3, 1.7, 0.4, 0.02, -0.05], np.float32)


def test_a_photograph_is_a_function_of_its_random_numbers():
    taken = [photographed(np.random.default_rng(i), blob(), CAMERA, (), 64) for i in (1, 1, 2)]
    for image, camera in taken:
        assert image.shape == (64, 64, 3) and image.dtype == np.uint8 and camera.shape == (7,)
    np.testing.assert_array_equal(taken[0][0], taken[1][0])
    assert not np.array_equal(taken[0][0], taken[2][0])


def test_masks_with_errors_are_near_the_true_ones_and_some_are_exact():
    _, mask = blob()
    found = [mistaken(np.random.default_rng(i), mask) for i in range(60)]
    overlaps = []
    for other in found:
        both, either = ((other > 127) & (mask > 127)).sum(), ((other > 127) | (mask > 127)).sum()
        overlaps.append(both / either)
    assert 10 < sum(o == 1 for o in overlaps) < 40
    assert min(overlaps) > 0.5 and 0.8 < np.mean(overlaps) < 0.99
    more = [(f > 127)[mask < 127].sum() for f in found]
    less = [(f < 127)[mask > 127].sum() for f in found]
    assert max(more) > 100 and max(less) > 100  # something too much, something lost


def test_an_empty_mask_stays_empty():
    assert not mistaken(np.random.default_rng(0), np.zeros((32, 32), np.uint8)).any()


def test_the_camera_code_is_that_of_the_new_crop():
    """Of a rendering whose mask loses its lower third, the code that ``camera_codes`` reads."""
    rng = np.random.default_rng(4)
    obj: ArticulatedObject = sample_state(generate("oven", 5), rng)
    camera = sample_camera(rng)
    picture = np.round(render(obj, camera, size=160) * 255).astype(np.uint8)
    row = np.array([[camera.azimuth, camera.elevation, camera.fov_degrees, camera.distance]])
    whole = camera_codes(row, picture[None])[0]
    less = picture.copy()
    less[110:, :, 3] = 0
    true = camera_codes(row, less[None])[0]
    assert np.abs(true - whole).max() > 0.1
    found = reframed(whole, crop_window(picture[..., 3]), crop_window(less[..., 3]))
    np.testing.assert_allclose(found, true, atol=1e-5)


def test_what_is_cut_out_is_the_object():
    """With the true mask the object lies where the plain crop has it."""
    from uniart_jax.data import photographs

    color, mask = blob()
    plain = crop(np.dstack([color, mask]), 64)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(photographs, "EXACT", 1.1)
        for seed in range(8):
            image, camera = photographed(np.random.default_rng(seed), blob(), CAMERA, (), 64)
            np.testing.assert_allclose(camera, CAMERA, atol=1e-6)
            apart = (image.max(-1) > 12) != (plain.max(-1) > 12)
            assert apart.mean() < 0.06

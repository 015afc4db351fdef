"""Renders as photographs: always the same, with a true mask, and cut out as a user's picture is."""

import numpy as np
import pytest

from uniart_jax.data import background
from uniart_jax.evaluation.photographed import FILLING, SIDE, cut_again, overlap, photograph
from uniart_jax.evaluation.procedural import held_out


@pytest.fixture(scope="module")
def tests():
    return [held_out(index, image_size=96) for index in range(2)]


def test_a_photograph_is_opaque_and_its_mask_is_the_objects(tests):
    (picture, mask), (again, _) = (photograph(tests, 1) for _ in range(2))
    np.testing.assert_array_equal(picture, again)
    assert picture.shape == (SIDE, SIDE, 4) and (picture[..., 3] == 255).all()
    inside = mask > 127
    border = np.concatenate([inside[0], inside[-1], inside[:, 0], inside[:, -1]])
    assert 0.02 < inside.mean() < 0.9 and not border.any()
    gray = np.full((SIDE, SIDE, 3), 0.5, np.float32)
    other, same = photograph(tests, 1, gray)
    far = other[..., :3][same == 0].astype(float)
    assert np.abs(far - far.mean(0)).mean() < 20 < np.abs(other[same > 127] - 127.0).mean()


def test_objects_with_a_grain_and_those_that_fill_the_picture(tests):
    _, mask = photograph(tests, 1, scales=FILLING)
    rows, columns = np.nonzero(mask > 127)
    assert max(np.ptp(rows), np.ptp(columns)) > 0.93 * SIDE
    gray = np.full((SIDE, SIDE, 3), 0.5, np.float32)
    changed = 0
    for index in range(2):  # half of the objects have a grain
        (plain, mask), (grained, same) = (photograph(tests, index, gray, grain=g) for g in (0, 0.9))
        there = (mask > 127) & (same > 127)
        off = np.abs(plain[..., :3].astype(float) - grained[..., :3])[there]
        changed += off.mean() > 5
    assert changed


def test_what_the_network_finds_is_what_is_cut_out(tests, monkeypatch):
    monkeypatch.setattr(background, "_installed", lambda *modules: False)
    picture, mask = photograph(tests, 0)
    cut, score, way = cut_again(tests, 0, lambda rgba: mask)
    assert way == "network" and score > 0.99 and (cut[..., :3] == picture[..., :3]).all()
    half = np.where(np.arange(SIDE)[:, None] < SIDE // 2, mask, 0).astype(np.uint8)
    assert cut_again(tests, 0, lambda rgba: half)[1] < 0.8
    with pytest.warns(UserWarning, match="the whole image"):
        whole, score, way = cut_again(tests, 0, None)
    assert (
        way == "none"
        and score == pytest.approx((mask > 127).mean())
        and (whole[..., 3] == 255).all()
    )


def test_overlap_of_masks():
    a, b = np.zeros((2, 4, 4), np.uint8)
    a[:2], b[1:3] = 255, 255
    assert overlap(a, b) == pytest.approx(4 / 12) and overlap(a, a) == 1

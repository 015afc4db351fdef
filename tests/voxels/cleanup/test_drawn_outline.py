"""The outline of a round part is read off its cells."""

import numpy as np
import pytest

from uniart_jax.voxels.cleanup.drawn_outline import drawn_outline

D, N = 20, 64
MIDDLE = np.array([30.2, 33.7])
U, V = np.meshgrid(np.arange(N), np.arange(N), indexing="ij")
AWAY = np.hypot(U - MIDDLE[0], V - MIDDLE[1])


def layers(inside, first=4, last=16):
    mine = np.zeros((D, N, N), bool)
    mine[first:last] = inside
    return mine


@pytest.mark.parametrize("start", [(0, 0), (2.0, -1.5), (-3.0, 3.0), (5.0, 4.0), (0, 8.0)])
def test_a_disc_that_lies_elsewhere_than_told(start):
    middle, radii = drawn_outline(layers(AWAY < 17), MIDDLE + start)
    np.testing.assert_allclose(middle, MIDDLE, atol=0.35)
    np.testing.assert_allclose(radii[4:16], 17, atol=0.4)
    assert np.isnan(np.delete(radii, np.arange(4, 16))).all()


def test_a_middle_that_is_told_far_off_stays():
    """Beyond half a radius nothing says that the cells are those of the outline."""
    told = MIDDLE + [14.0, 0]
    middle, _ = drawn_outline(layers(AWAY < 17), told)
    np.testing.assert_array_equal(middle, told)


def test_layers_have_their_own_radii():
    mine = layers(AWAY < 17)
    mine[10:] &= AWAY < 9
    _, radii = drawn_outline(mine, MIDDLE)
    np.testing.assert_allclose(radii[4:10], 17, atol=0.5)
    np.testing.assert_allclose(radii[10:16], 9, atol=0.5)


def test_walls_alone_tell_it():
    _, radii = drawn_outline(layers((AWAY < 17) & (AWAY > 14)), MIDDLE)
    np.testing.assert_allclose(radii[4:16], 17, atol=0.4)


def test_corners_and_what_stands_out_do_not_count():
    square = (np.abs(U - 30) <= 15) & (np.abs(V - 34) <= 15)
    middle, radii = drawn_outline(layers(square), np.array([30.0, 34.0]))
    np.testing.assert_allclose(middle, [30, 34], atol=1e-9)
    np.testing.assert_allclose(radii[4:16], 15.5, rtol=0.07)
    u, v = U - MIDDLE[0], V - MIDDLE[1]
    spout = (np.abs(v) < 3) & (u > 0) & (u < 29)
    middle, radii = drawn_outline(layers((AWAY < 17) | spout), MIDDLE)
    np.testing.assert_allclose(middle, MIDDLE, atol=0.35)
    np.testing.assert_allclose(radii[4:16], 17, atol=0.5)


def test_torn_walls_are_as_wide_as_what_is_left_of_them():
    angle = np.arctan2(V - MIDDLE[1], U - MIDDLE[0])
    gone = (angle > 0.3) & (angle < 2.2) & (AWAY > 4)  # three tenths of the circle
    middle, radii = drawn_outline(layers((AWAY < 17) & (AWAY > 13) & ~gone), MIDDLE)
    np.testing.assert_allclose(middle, MIDDLE, atol=0.5)
    np.testing.assert_allclose(radii[4:16], 17, atol=0.6)


def test_too_little_tells_nothing():
    middle, radii = drawn_outline(np.zeros((D, N, N), bool), MIDDLE)
    assert np.isnan(radii).all()
    np.testing.assert_array_equal(middle, MIDDLE)
    _, radii = drawn_outline(layers((AWAY < 17) & (U - MIDDLE[0] > 2)), MIDDLE)
    assert np.isnan(radii).all()

"""Maps of how deep columns begin: what is round, what is tilted, what joins it, and corners."""

import numpy as np
import pytest

from uniart_jax.voxels.cleanup.column_maps import (
    LEAST_BULGE,
    ROUND,
    corners,
    round_pieces,
    tilted,
    with_what_goes_on,
)

U, V = np.meshgrid(np.arange(40.0), np.arange(30.0), indexing="ij")
EDGE = 5
WHOLE = np.ones(U.shape, bool)


def bowl(radius=25.0, middle=19.5):
    """Depth of a cylinder along V."""
    return radius - np.sqrt(radius**2 - (U - middle) ** 2)


def is_round(height, columns=WHOLE):
    found = round_pieces(columns, height, EDGE)
    assert not (found & ~columns).any()
    share = found.sum() / columns.sum()
    assert share in (0, 1)
    return share == 1


def test_cylinders_along_either_side_and_balls_are_round():
    assert is_round(bowl()) and is_round(bowl().T, WHOLE.T)
    assert is_round((U - 19.5) ** 2 / 60 + (V - 14.5) ** 2 / 60)


def test_flat_and_tilted_faces_and_valleys_are_not():
    assert not is_round(np.full(U.shape, 3.0))
    assert not is_round(0.2 * U + 0.1 * V)
    assert not is_round(-bowl())
    half = np.maximum(U - 19.5, 0) ** 2 / 20  # one end alone is deeper
    assert not is_round(half)


@pytest.mark.parametrize("phase", np.arange(8) * np.pi / 4)
@pytest.mark.parametrize(("side", "height"), [(16, 0.5), (16, 1.0), (20, 1.0)])
def test_ripples_are_not_round_whatever_their_phase(phase, side, height):
    ripples = height * np.sin(2 * np.pi * U[:side, :side] / 12 + phase)
    assert not is_round(ripples, WHOLE[:side, :side])


def test_raised_panels_are_not_round():
    raised = np.where((np.abs(U - 19.5) < 13) & (np.abs(V - 14.5) < 9), 0.0, 2.0)
    assert not is_round(raised)


def test_little_bulges_and_what_is_narrow_are_not_round():
    low = bowl() / bowl().max()
    assert not is_round(LEAST_BULGE * low)
    assert is_round(4 * LEAST_BULGE * low)
    narrow = WHOLE & (np.abs(U - 19.5) < ROUND / 2 - 1)
    assert not is_round(10 * bowl(), narrow)
    assert not is_round(bowl(), WHOLE & (V < EDGE))


def test_each_piece_is_judged_for_itself():
    columns = WHOLE & (np.abs(V - 14.5) > 1)
    height = np.where(V < 14, bowl(), 2.0)
    found = round_pieces(columns, height, EDGE)
    np.testing.assert_array_equal(found, columns & (V < 14))


def test_what_goes_on_without_a_step_joins():
    height = np.where(V < 10, 0.5 * V, np.where(V < 20, 20.0, 0.1 * V))
    found = WHOLE & (V < 3)
    joined = with_what_goes_on(found, WHOLE, height, 1.5)
    assert joined[:, :8].all() and not joined[:, 10:].any()
    parted = with_what_goes_on(found, WHOLE & (V != 5), height, 1.5)
    np.testing.assert_array_equal(parted, V < 5)
    assert not with_what_goes_on(~WHOLE, WHOLE, height, 1.5).any()


def test_corners_are_means_of_their_shares():
    mask = np.zeros((20, 10), bool)
    mask[:2, 0] = mask[-1, -1] = True
    np.testing.assert_allclose(corners(mask, 0.1), [1.0, 0.0, 0.0, 0.5])


def test_a_plane_that_rises_is_tilted_and_what_is_flat_is_not():
    columns = np.ones((40, 40), bool)
    columns[:5] = False
    along = np.arange(40.0)[:, None] + np.zeros(40)
    ripples = 0.3 * np.sin(along * (2 * np.pi / 12))
    for height, expected in (
        (3 * along / 40 + ripples, True),
        (ripples, False),
        (1 * along / 40, False),  # hardly rises
        (np.where(along < 22, 0.0, 1.4), False),  # two depths
    ):
        assert tilted(columns, 20 + height) is expected

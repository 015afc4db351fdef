"""Legs become straight where they are torn; what leans, and what is no leg, stays."""

import numpy as np
import pytest
from fields import AT, assert_same, block, copy_of, field_of, solid_of
from scipy import ndimage

from uniart_jax.voxels.cleanup.straight_legs import with_whole_legs

TOP = block((8.3, 8.3, 44.3), (58.3, 58.3, 48.3))


def legs(lean=0.0):
    shift = lean * (44 - AT[2])
    corners = [(x, y) for x in (10.3, 50.3) for y in (10.3, 50.3)]
    return [
        block((x, y, 6.3), (x + 6, y + 6, 45), np.stack([AT[0] + shift, AT[1], AT[2]]))
        for x, y in corners
    ]


def table(torn=None, lean=0.0):
    carried = np.min(legs(lean), 0)
    if torn is not None:
        carried = np.where(torn, 2.0, carried)
    return field_of(np.minimum(TOP, carried), np.full(AT.shape[1:], 3.0))


def torn(seed=0):
    """Each leg has its holes at other heights."""
    rng = np.random.default_rng(seed)
    return ndimage.binary_dilation(rng.random(AT.shape[1:]) < 0.004, np.ones((3, 3, 3)))


def wrong(field, ideal):
    return int(((solid_of(field, 0) != solid_of(ideal, 0)) & (AT[2] < 44)).sum())


def test_torn_legs_become_whole():
    rough, ideal = table(torn()), table()
    before = copy_of(rough)
    after = with_whole_legs(rough, [0])
    assert_same(rough, before)
    assert wrong(rough, ideal) > 500 and wrong(after, ideal) < 0.1 * wrong(rough, ideal)
    high = AT[2] > 45
    np.testing.assert_array_equal(after.sdf[high], rough.sdf[high])


def test_legs_that_lean_and_boards_between_them_stay():
    for lean in (0.2, 0.4):
        board = block((12.3, 12.3, 20.3), (54.3, 54.3, 22.3))
        field = field_of(np.min([TOP, *legs(lean), board], 0), np.full(AT.shape[1:], 3.0))
        after = with_whole_legs(field, [0])
        assert wrong(after, field) < 0.06 * (solid_of(field, 0) & (AT[2] < 44)).sum()
        assert (solid_of(after, 0) >= (board < 0)).all()


def test_legs_that_wobble_become_straight():
    wave = 1.6 * np.sin(AT[2] / 2.5)
    wobbling = [
        block((x, y, 6.3), (x + 7, y + 7, 45), np.stack([AT[0] + wave, AT[1] - wave, AT[2]]))
        for x in (10.3, 48.3) for y in (10.3, 48.3)
    ]  # fmt: skip
    straight = [block((x, y, 6.3), (x + 7, y + 7, 45)) for x in (10.3, 48.3) for y in (10.3, 48.3)]
    around = np.full(AT.shape[1:], 3.0)
    rough = field_of(np.min([TOP, *wobbling], 0), around)
    ideal = field_of(np.min([TOP, *straight], 0), around)
    after = with_whole_legs(rough, [0])
    assert wrong(after, ideal) < 0.65 * wrong(rough, ideal)
    low = solid_of(after, 0)[:, :, 8:43]  # one cross-section from the floor to the board
    assert (low == low[:, :, :1]).mean() > 0.998


@pytest.mark.parametrize(("power", "share"), [(2, np.pi / 4), (np.inf, 1.0)])
def test_round_legs_stay_round_and_square_ones_square(power, share):
    def leg(x, y, radius=5.2):
        middle = np.stack([AT[0] - x, AT[1] - y])
        return np.maximum(np.linalg.norm(middle, power, axis=0) - radius, np.abs(AT[2] - 25) - 20)

    carried = np.min([leg(x, y) for x in (16.3, 50.3) for y in (16.3, 50.3)], 0)
    field = field_of(np.minimum(TOP, carried), np.full(AT.shape[1:], 3.0))
    after = with_whole_legs(field, [0])
    for layers in (slice(6, 20), slice(20, 43)):
        found = solid_of(after, 0)[:30, :30, layers].any(-1)
        rows, columns = np.flatnonzero(found.any(1)), np.flatnonzero(found.any(0))
        area = (np.ptp(rows) + 1) * (np.ptp(columns) + 1)
        assert found.sum() / area == pytest.approx(share, abs=0.1)
        assert found.sum() == pytest.approx(share * 10.4**2, rel=0.15)


def test_a_panel_that_carries_is_no_leg():
    wave = np.sin(AT[2] / 3)
    panels = [
        block((x, 10.3, 6.3), (x + 4, 56.3, 45), np.stack([AT[0] + wave, AT[1], AT[2]]))
        for x in (10.3, 50.3)
    ]
    field = field_of(np.min([TOP, *panels], 0), np.full(AT.shape[1:], 3.0))
    after = with_whole_legs(field, [0])
    assert (solid_of(after, 0) >= solid_of(field, 0)).all()


def test_a_cabinet_stays_as_it_is():
    hollow = np.maximum(
        block((14.3, 8.3, 8.3), (56.3, 56.3, 56.3)), -block((13, 12, 12), (50, 52, 52))
    )
    field = field_of(np.where(torn(1) & (hollow > -1.5), 2.0, hollow))
    assert_same(with_whole_legs(field, [0]), field)
    assert_same(with_whole_legs(field, []), field)


def test_what_moves_between_legs_is_no_bodys():
    hole = (np.abs(AT[2] - 25) < 3) & (AT[0] < 20) & (AT[1] < 20)
    drawer = block((11.3, 11.3, 23.3), (15.3, 40.3, 27.3))  # through a leg's gap
    carried = np.where(hole, 2.0, np.min(legs(), 0))
    field = field_of(np.minimum(TOP, carried), drawer)
    after = with_whole_legs(field, [0])
    np.testing.assert_array_equal(solid_of(after, 1), solid_of(field, 1))
    new = solid_of(after, 0) & ~solid_of(field, 0)
    assert not (new & ndimage.binary_dilation(solid_of(field, 1))).any()
    alone = field_of(np.minimum(TOP, carried))
    assert (solid_of(with_whole_legs(alone, [0]), 0) & hole).any()


def other_legs(shape):
    """A table whose legs have another cross-section: distances [X, Y, Z] of one at (x, y)."""
    carried = np.min([shape(x, y) for x in (10.3, 46.3) for y in (10.3, 46.3)], 0)
    return field_of(np.minimum(TOP, carried), np.full(AT.shape[1:], 3.0))


def test_profiles_and_tubes_stay_what_they_are():
    def profile(x, y):
        return np.minimum(
            block((x, y, 6.3), (x + 12, y + 4, 45)), block((x, y, 6.3), (x + 4, y + 12, 45))
        )

    def tube(x, y):
        return np.maximum(
            block((x, y, 6.3), (x + 12, y + 12, 45)),
            -block((x + 2, y + 2, 0), (x + 10, y + 10, 50)),
        )

    for shape in (profile, tube):
        field = other_legs(shape)
        after = with_whole_legs(field, [0])
        assert wrong(after, field) < 0.02 * (solid_of(field, 0) & (AT[2] < 44)).sum()


def test_feet_brackets_and_short_legs_stay():
    def foot(x, y):
        return np.minimum(
            block((x, y, 6.3), (x + 6, y + 6, 45)), block((x - 4, y - 4, 6.3), (x + 10, y + 10, 9))
        )

    def bracket(x, y):
        return np.minimum(
            block((x, y, 6.3), (x + 6, y + 6, 45)), block((x, y, 26), (x + 14, y + 6, 30))
        )

    for shape in (foot, bracket):
        field = other_legs(shape)
        after = with_whole_legs(field, [0])
        assert (solid_of(after, 0) >= solid_of(field, 0)).mean() > 0.9995
        assert wrong(after, field) < 0.03 * (solid_of(field, 0) & (AT[2] < 44)).sum()
    hanging = block((26.3, 26.3, 18.3), (32.3, 32.3, 45))  # a box under the board, above the floor
    field = field_of(np.min([TOP, *legs(), hanging], 0), np.full(AT.shape[1:], 3.0))
    new = solid_of(with_whole_legs(field, [0]), 0) & ~solid_of(field, 0)
    assert not new[26:33, 26:33, :15].any()


def test_feet_stay_flat_and_the_board_does_not_dent():
    field = table()
    after = with_whole_legs(field, [0])
    assert np.abs(after.sdf).max() <= max(3.0, np.abs(field.sdf).max())
    for x, y in ((11, 11), (13, 13), (15, 12)):  # where the surface crosses, along a leg's axis
        column = after.sdf[x, y]
        low = int(np.argmax(column < 0))
        height = low - 0.5 + column[low - 1] / (column[low - 1] - column[low])
        flat = field.sdf[x, y]
        expected = low - 0.5 + flat[low - 1] / (flat[low - 1] - flat[low])
        assert height == pytest.approx(expected, abs=0.15)
    under = (AT[2] > 43) & (AT[2] < 45)
    outside = under & (np.min(legs(), 0) > 0.5)
    assert np.abs(after.sdf - field.sdf)[outside].max() < 0.3

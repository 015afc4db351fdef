"""Legs become straight where they are torn; what leans, and what is no leg, stays."""

import numpy as np
from fields import AT, assert_same, block, copy_of, field_of, solid_of
from scipy import ndimage

from uniart_jax.voxels.legs import with_whole_legs

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


def test_nothing_is_taken_from_legs_that_lean_nor_boards_between_them():
    for lean in (0.2, 0.4):
        board = block((12.3, 12.3, 20.3), (54.3, 54.3, 22.3))
        field = field_of(np.min([TOP, *legs(lean), board], 0), np.full(AT.shape[1:], 3.0))
        after = with_whole_legs(field, [0])
        assert (solid_of(after, 0) >= solid_of(field, 0)).all()
        assert wrong(after, field) < 0.06 * (solid_of(field, 0) & (AT[2] < 44)).sum()


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

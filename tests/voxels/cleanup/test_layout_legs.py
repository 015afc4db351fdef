"""A field stands on the legs that a layout has; they go through JSON and come from a network."""

import dataclasses
import json

import numpy as np
import pytest
from fields import (
    AT,
    N,
    assert_same,
    block,
    copy_of,
    field_of,
    place_of,
    solid_of,
    surface_has_sources,
)
from scipy import ndimage

from uniart_jax.data.mirror import mirror_legs
from uniart_jax.voxels.cleanup.layout_legs import with_legs
from uniart_jax.voxels.leg_table import Legs, legs_from_json, legs_to_json, read_legs

LOW, HIGH = 6.3, 44.3
TOP = block((8.3, 8.3, HIGH), (58.3, 58.3, 48.3))
NONE = np.full(AT.shape[1:], 3.0)


def legs_at(corners, width=6.0, *, fill=1.0, plinth=False, alone=True, lean=0.0):
    """Legs that stand from ``LOW`` to ``HIGH``, their lower ends ``lean`` cells further along x."""
    lower, upper = [], []
    for x, y in corners:
        upper.append([*place_of((x, y)), *place_of((x + width, y + width))])
        lower.append(np.array(upper[-1]) + np.array([lean, 0, lean, 0]) / N)
    count = len(corners)
    heights = np.tile(place_of((LOW, HIGH)), (count, 1))
    flags = np.full(count, plinth)
    return Legs(np.array(lower), np.array(upper), heights, np.full(count, fill), flags, alone)


CORNERS = [(x, y) for x in (10.3, 50.3) for y in (10.3, 50.3)]
FOUR = legs_at(CORNERS)


def drawn(corners=CORNERS, width=6.0):
    blocks = [block((x, y, LOW), (x + width, y + width, HIGH + 1)) for x, y in corners]
    return np.min([TOP, *blocks], 0)


def below(solid):
    return solid & (AT[2] < HIGH - 3)


def test_torn_legs_become_those_that_were_found():
    holes = ndimage.binary_dilation(
        np.random.default_rng(0).random(AT.shape[1:]) < 0.01, np.ones((3, 3, 3))
    )
    rough, ideal = field_of(np.where(holes & (AT[2] < HIGH), 2.0, drawn())), field_of(drawn())
    before = copy_of(rough)
    after = with_legs(rough, [0], FOUR)
    assert_same(rough, before)
    np.testing.assert_array_equal(below(solid_of(after, 0)), below(solid_of(ideal, 0)))
    upwards = AT[2] > HIGH
    np.testing.assert_array_equal(after.sdf[upwards], rough.sdf[upwards])
    assert surface_has_sources(after)
    # the surface lies where it does, to a fraction of a cell
    near = below(np.abs(ideal.sdf) < 1)
    np.testing.assert_allclose(after.sdf[near], ideal.sdf[near], atol=0.35)


def test_legs_that_no_voxel_shows_are_made_and_crumbs_go():
    crumb = block((30.3, 30.3, 10.3), (33.3, 33.3, 13.3))
    field = field_of(np.minimum(TOP, crumb))
    alone = with_legs(field, [0], FOUR)
    assert not (solid_of(alone, 0) & (crumb < 0)).any()
    beside = with_legs(field, [0], legs_at(CORNERS, alone=False))
    assert (solid_of(beside, 0) >= (crumb < 0)).all()
    for after in (alone, beside):
        labels, pieces = ndimage.label(solid_of(after, 0) & (crumb >= 0))
        assert pieces == 1 and below(labels > 0).sum() > 4 * 25 * 30


@pytest.mark.parametrize("until, stays", [(HIGH + 1, True), (20.3, False)])
def test_plates_that_are_drawn_in_their_stead_stay(until, stays):
    plates = [block((10.3, y, LOW), (56.3, y + 4, until)) for y in (10.3, 52.3)]
    field = field_of(np.min([TOP, *plates], 0))
    after = with_legs(field, [0], legs_at(CORNERS, 3.0))
    middle = solid_of(after, 0)[24:42, 11:14, 10:18]
    assert middle.mean() == stays


def test_thicker_legs_that_are_drawn_elsewhere_go():
    inner = [(x + (8 if x < 30 else -8), y) for x, y in CORNERS]
    after = with_legs(field_of(drawn(inner, 5.0)), [0], legs_at(CORNERS, 3.0))
    assert ndimage.label(solid_of(after, 0)[:, :, 25])[1] == 4


def test_other_parts_stay_as_they_are():
    bin_between = block((25.3, 25.3, 8.3), (40.3, 40.3, 30.3))
    through = block((9.3, 9.3, 20.3), (18.3, 18.3, 24.3))
    field = field_of(drawn(), np.minimum(bin_between, through))
    after = with_legs(field, [0], FOUR)
    np.testing.assert_array_equal(solid_of(after, 1), solid_of(field, 1))


def test_round_and_leaning_legs_and_a_plinth():
    disc = with_legs(field_of(TOP), [0], legs_at(CORNERS, fill=0.78))
    square = with_legs(field_of(TOP), [0], FOUR)
    share = below(solid_of(disc, 0)).sum() / below(solid_of(square, 0)).sum()
    assert 0.7 < share < 0.95
    leaning = with_legs(field_of(TOP), [0], legs_at(CORNERS, lean=8.0))
    middle = [AT[0][:, :, z][solid_of(leaning, 0)[:, :, z]].mean() for z in (8, 25, 42)]
    assert middle[0] - middle[2] == pytest.approx(8 * 34 / 38, abs=0.5)
    assert middle[1] == pytest.approx((middle[0] + middle[2]) / 2, abs=0.5)
    whole = with_legs(field_of(TOP), [0], legs_at([(12.3, 12.3)], 40.0, plinth=True))
    assert solid_of(whole, 0)[14:51, 14:51, 10].all()


def test_their_upper_end_is_where_the_body_begins():
    lower_body = field_of(np.minimum(drawn(), block((8.3, 8.3, 40.3), (58.3, 58.3, 48.3))))
    after = with_legs(lower_body, [0], FOUR)
    np.testing.assert_array_equal(solid_of(after, 0)[:, :, 41:], solid_of(lower_body, 0)[:, :, 41:])


def test_what_flares_below_the_body_goes_where_legs_are_told_at_different_heights():
    """Two are told much too short, so the body begins far above the median of their ends."""
    heights = np.stack([place_of((LOW, top)) for top in (30.3, 31.3, 38.3, 38.8)])
    flares = [block((x - 1, y - 1, 38.3), (x + 7, y + 7, HIGH + 1)) for x, y in CORNERS]
    field = field_of(np.minimum(drawn(), np.min(flares, 0)))
    after = solid_of(with_legs(field, [0], dataclasses.replace(FOUR, heights=heights)), 0)
    ideal = solid_of(field_of(drawn()), 0)
    np.testing.assert_array_equal(below(after), below(ideal))


def test_an_apron_below_a_larger_top_is_where_the_body_begins():
    board = block((9.3, 9.3, 34.3), (57.3, 57.3, 37.3))
    walls = [block((9.3, y, 34.3), (57.3, y + 2, HIGH + 1)) for y in (9.3, 55.3)]
    field = field_of(np.min([drawn(), board, *walls], 0))
    heights = np.tile(place_of((LOW, 41.3)), (4, 1))
    after = with_legs(field, [0], dataclasses.replace(FOUR, heights=heights))
    np.testing.assert_array_equal(solid_of(after, 0)[:, :, 36:], solid_of(field, 0)[:, :, 36:])


@pytest.mark.parametrize("short", [24.0, 19.0, 17.0])
def test_a_leg_that_is_told_short_stays_where_the_others_are_told_too_long(short):
    """The body begins below their median, so those are cut; the short one is not moved down too."""
    body = block((8.3, 8.3, 26.3), (58.3, 58.3, 48.3))
    field = field_of(np.minimum(drawn(), body))
    heights = np.stack([place_of((LOW, top)) for top in (40.3, 40.3, 40.3, short)])
    after = solid_of(with_legs(field, [0], dataclasses.replace(FOUR, heights=heights)), 0)
    np.testing.assert_array_equal(after[:, :, 8:24], solid_of(field, 0)[:, :, 8:24])


def test_ends_at_a_whole_layer_leave_no_gap():
    body = block((8.3, 8.3, 55.3), (58.3, 58.3, 60.3))  # too far to be sought
    heights = np.tile(place_of((LOW, 40.0)), (4, 1))
    field = field_of(body)
    after = solid_of(with_legs(field, [0], dataclasses.replace(FOUR, heights=heights)), 0)
    assert after[12:16, 12:16, 7:56].all()


def test_without_legs_all_stays():
    none = Legs(*(getattr(FOUR, f.name)[:0] for f in dataclasses.fields(FOUR)[:5]), True)
    field = field_of(drawn())
    assert with_legs(field, [0], none) is field


def test_a_board_within_a_body_that_is_drawn_to_the_floor_is_not_where_it_begins():
    walls = [block((8.3, y, LOW), (58.3, y + 7, HIGH)) for y in (8.3, 51.3)]
    board = block((8.3, 8.3, 19.3), (58.3, 58.3, 22.3))
    field = field_of(np.min([TOP, board, *walls], 0))
    legs = legs_at([(x, y) for x in (10.3, 44.3) for y in (10.3, 44.3)], 12.0)
    heights = np.tile(place_of((LOW, 14.3)), (4, 1))
    after = with_legs(field, [0], dataclasses.replace(legs, heights=heights))
    assert (solid_of(after, 0) >= solid_of(field, 0))[:, :, 17:].all()


def test_a_rail_between_legs_stays_where_legs_are_not_alone():
    rail = block((12.3, 12.3, 20.3), (54.3, 14.3, 23.3))
    rubble = block((17.3, 17.3, 30.3), (19.3, 19.3, 33.3))  # beside a leg
    field = field_of(np.min([drawn(), rail, rubble], 0))
    after = with_legs(field, [0], legs_at(CORNERS, alone=False))
    assert (solid_of(after, 0) >= (rail < 0)).all()
    assert not (solid_of(after, 0) & (rubble < 0)).any()
    gone = with_legs(field, [0], FOUR)
    assert not (solid_of(gone, 0) & (rail < 0) & (AT[0] > 18) & (AT[0] < 48)).any()


def test_each_leg_has_its_own_heights_and_nothing_is_below_the_floor():
    heights = np.tile(place_of((LOW, HIGH)), (4, 1))
    heights[0] = place_of((25.3, HIGH))
    below_floor = block((30.3, 30.3, 2.3), (33.3, 33.3, 5.3))
    field = field_of(np.minimum(TOP, below_floor))
    after = solid_of(with_legs(field, [0], dataclasses.replace(FOUR, heights=heights)), 0)
    assert not after[12:16, 12:16, :25].any() and after[12:16, 12:16, 26:44].all()
    assert after[52:56, 52:56, 7:44].all() and not after[:, :, :7].any()
    slightly = heights.copy()
    slightly[0] = place_of((LOW + 1, HIGH - 1))  # as a network's: level all the same
    level = with_legs(field, [0], dataclasses.replace(FOUR, heights=slightly))
    assert_same(level, with_legs(field, [0], FOUR))


def test_a_leg_that_is_told_shorter_reaches_the_body_all_the_same():
    """What was drawn of it above is taken away with the rest, so it goes on to what is left."""
    heights = np.tile(place_of((LOW, HIGH)), (4, 1))
    heights[0, 1] = place_of(36.3)
    told = dataclasses.replace(FOUR, heights=heights)
    after = solid_of(with_legs(field_of(drawn(width=8.0)), [0], told), 0)
    assert ndimage.label(after)[1] == 1
    assert after[12:16, 12:16, 7:48].all()


def test_legs_go_on_to_what_covers_them():
    """Under a drawer the legs' upper ends are told; the board is above."""
    short = dataclasses.replace(FOUR, heights=np.tile(place_of((LOW, 35.3)), (4, 1)))
    after = solid_of(with_legs(field_of(TOP), [0], short), 0)
    assert after[12:16, 12:16, 7:48].all()
    far = dataclasses.replace(FOUR, heights=np.tile(place_of((LOW, 20.3)), (4, 1)))
    assert not solid_of(with_legs(field_of(TOP), [0], far), 0)[12:16, 12:16, 25:40].any()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_legs_beyond_the_grid_stay_in_it(axis):
    """Normalised objects are as long as the grid; a leg at their end may be told beyond it."""
    body = block((0.6, 0.6, 30.3), (64.4, 64.4, 48.3))
    corners = [(x, y) for x in (-2.0, 61.0) for y in (-2.0, 61.0)]
    legs = legs_at(corners)
    if axis == 2:
        legs = dataclasses.replace(legs, heights=np.tile([-0.6, 0.6], (4, 1)))
    after = with_legs(field_of(body), [0], legs)
    for side in (0, -1):
        assert (np.moveaxis(after.sdf, axis, 0)[side] > 0).all()
    pieces = ndimage.label(solid_of(after, 0))[1]
    assert pieces == 1 and below(solid_of(after, 0)).sum() > 1000


def test_a_leg_beside_the_body_is_moved_below_it():
    beside = legs_at([(3.0, 10.3), *CORNERS[1:]])
    after = with_legs(field_of(TOP), [0], beside)
    assert ndimage.label(solid_of(after, 0))[1] == 1
    x = AT[0][:, :, 20][
        solid_of(after, 0)[:, :, 20] & (AT[1][:, :, 20] < 30) & (AT[0][:, :, 20] < 30)
    ]
    assert x.min() == 9 and x.max() == 14


def test_json_brings_them_back_and_names_what_is_wrong():
    text = json.dumps(legs_to_json(legs_at(CORNERS[:2], fill=0.78, lean=2.0)))
    back = legs_from_json(json.loads(text))
    ours = legs_at(CORNERS[:2], fill=0.78, lean=2.0)
    for name in ("lower", "upper", "heights", "fill", "plinth"):
        np.testing.assert_allclose(getattr(back, name), getattr(ours, name), atol=1e-6)
    assert back.alone is True and back.round.all()
    assert legs_from_json(None) is None and legs_from_json({"rows": []}) is None
    for change, said in (
        ({"lower": [0, 0, 1]}, "leg 1: lower must be 4 numbers"),
        ({"lower": [0, 0, -1, 1]}, "leg 1: lower .* must rise"),
        ({"heights": [0.5, 0.2]}, "leg 1: heights .* must rise"),
        ({"fill": "much"}, "leg 1: fill must be a number"),
        ({"fill": 0.3}, "leg 1: fill must be in 0.65..1, got 0.3"),
        ({"upper": [0, 0, 10**400, 1]}, "leg 1: upper must be 4 numbers in -1..1"),
        ({"heights": [-0.5, float("nan")]}, "leg 1: heights must be 2 numbers"),
        ({"plinth": 1}, "leg 1: plinth 1 is neither"),
    ):
        data = json.loads(text)
        data["rows"][1] |= change
        with pytest.raises(ValueError, match=said):
            legs_from_json(data)
    many = {"rows": [{}] * 400}
    for data, said in (
        ([], "null or have a list"),
        ({"rows": [], "alone": 2}, "alone 2"),
        (many, "legs: 400 rows; give at most 64"),
    ):
        with pytest.raises(ValueError, match=said):
            legs_from_json(data)


def outputs(count=4):
    rows = np.concatenate([FOUR.lower, FOUR.upper, FOUR.heights], 1)
    zeros = np.zeros(count)
    return {
        "leg_rows": rows[:count],
        "leg_exists": zeros + 3,
        "leg_plinth": zeros - 3,
        "leg_fill": zeros + 1,
        "leg_alone": np.float32(2.0),
    }


def test_what_a_network_says():
    found = read_legs(outputs())
    assert len(found) == 4 and found.alone and not found.round.any()
    assert read_legs({**outputs(), "leg_exists": np.full(4, -2.0)}) is None
    doubtful = {**outputs(), "leg_exists": np.array([2.0, -0.7, -0.7, -3])}
    assert len(read_legs(doubtful)) == 3  # legs come in sets
    assert read_legs({**outputs(), "leg_exists": np.array([2.0, 2, -3, -3])}) is None
    boards = outputs()
    boards["leg_rows"][:, [2, 6]] += 0.3
    assert len(read_legs({**boards, "leg_exists": np.array([2.0, 2, -3, -3])})) == 2
    # a frame or profile is no prism: it is left as it is drawn, and so is what is beside it
    frame = read_legs({**outputs(), "leg_fill": np.array([1, 1, 1, 0.3])})
    assert len(frame) == 3 and not frame.alone
    # of several plinths the surest alone; one that is less sure than legs is none
    legs = read_legs(
        outputs()
        | {"leg_plinth": np.array([2, -2, -2, -2]), "leg_exists": np.array([1, 4, 2, 3.0])}
    )
    assert len(legs) == 3 and not legs.plinth.any()
    surest = {"leg_plinth": np.full(4, 2.0), "leg_exists": np.array([1, 4, 2, 3.0])}
    plinth = read_legs(outputs() | surest)
    assert len(plinth) == 1 and plinth.plinth.all()
    np.testing.assert_allclose(plinth.lower, FOUR.lower[1:2])
    thin = read_legs({**outputs(), "leg_rows": np.zeros((4, 10))})
    assert (thin.lower[:, 2:] > thin.lower[:, :2]).all()


def test_whatever_a_network_says_goes_through_json():
    rng = np.random.default_rng(0)
    for scale in (0.3, 3.0):
        said = {
            "leg_rows": rng.normal(size=(8, 10)) * scale,
            "leg_exists": np.full(8, 2.0),
            "leg_plinth": np.full(8, -2.0),
            "leg_fill": rng.uniform(0.7, 1.3, 8),
            "leg_alone": np.float32(0.1),
        }
        found = read_legs(said)
        back = legs_from_json(json.loads(json.dumps(legs_to_json(found))))
        np.testing.assert_allclose(back.lower, found.lower, atol=1e-6)
        np.testing.assert_allclose(back.heights, found.heights, atol=1e-6)
    flat = {**outputs(), "leg_rows": np.zeros((4, 10)), "leg_plinth": np.full(4, 2.0)}
    assert legs_from_json(legs_to_json(read_legs({**flat, "leg_fill": np.zeros(4)}))).plinth.all()


def test_mirrored_rows_are_those_of_the_mirrored_object():
    table = legs_at([(10.3, 12.3)], lean=3.0).table(2)
    mirrored = mirror_legs(table)
    np.testing.assert_allclose(mirrored[0, [0, 2, 8, 9, 10]], table[0, [0, 2, 8, 9, 10]])
    np.testing.assert_allclose(mirrored[0, [1, 3]], -table[0, [3, 1]])
    assert (mirrored[0, 1] < mirrored[0, 3]) and not mirrored[1].any()
    np.testing.assert_array_equal(mirror_legs(mirrored), table)
    np.testing.assert_array_equal(mirror_legs(table[:, :10]), mirrored[:, :10])

"""A field is built of a layout's panels; they go through JSON and come from a network."""

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

from uniart_jax import procedural
from uniart_jax.data.mirror import mirror_corners
from uniart_jax.data.panels import panels_of
from uniart_jax.voxels.cleanup.layout_panels import fitted, with_panels
from uniart_jax.voxels.leg_table import Legs
from uniart_jax.voxels.panel_table import (
    THINNEST,
    TRUSTED,
    Panels,
    panels_from_json,
    panels_to_json,
    read_panels,
)

# sides, top, bottom, back and a shelf, in cells
BOARDS = np.array(
    [
        [12.3, 8.3, 10.3, 52.3, 11.3, 56.3],
        [12.3, 54.3, 10.3, 52.3, 57.3, 56.3],
        [12.3, 8.3, 53.3, 52.3, 57.3, 56.3],
        [12.3, 8.3, 10.3, 52.3, 57.3, 13.3],
        [49.3, 8.3, 10.3, 52.3, 57.3, 56.3],
        [12.3, 8.3, 32.3, 52.3, 57.3, 35.3],
    ]
)
CASE = np.min([block(b[:3], b[3:]) for b in BOARDS], 0)
SHELF = block(BOARDS[5, :3], BOARDS[5, 3:])
INSIDE = block((12.3, 13.3, 15.3), (47.3, 52.3, 51.3)) < 0
DOOR = block((8.3, 8.3, 10.3), (11.3, 57.3, 56.3))


def panels_at(boards, share=1.0):
    return Panels(place_of(boards.reshape(-1, 2, 3)).reshape(-1, 6), share)


ALL = panels_at(BOARDS)


def test_a_torn_shelf_and_crumbs_become_a_board():
    holes = np.random.default_rng(0).random(AT.shape[1:]) < 0.02
    holes = ndimage.binary_dilation(holes, np.ones((3, 3, 3))) & (SHELF < 0) & INSIDE
    crumbs = block((20.3, 20.3, 22.3), (24.3, 24.3, 25.3))
    torn = np.minimum(np.where(holes, 2.0, CASE), crumbs)
    rough, ideal = field_of(torn), field_of(CASE)
    before = copy_of(rough)
    after = with_panels(rough, [0], ALL)
    assert_same(rough, before)
    np.testing.assert_array_equal(solid_of(after, 0), solid_of(ideal, 0))
    assert surface_has_sources(after)
    # the surface lies where it does, to a fraction of a cell
    near = np.abs(ideal.sdf) < 1
    np.testing.assert_allclose(after.sdf[near], ideal.sdf[near], atol=0.3)


def test_other_parts_and_what_is_outside_stay():
    burner = block((25.3, 25.3, 57.3), (35.3, 35.3, 62.3))
    tray = block((16.3, 14.3, 16.3), (45.3, 50.3, 18.3))
    field = field_of(np.minimum(CASE, burner), DOOR, tray)
    after = with_panels(field, [0], ALL)
    for part in (1, 2):
        np.testing.assert_array_equal(solid_of(after, part), solid_of(field, part))
        own = field.owner == part
        np.testing.assert_array_equal(
            after.sdf[own & (field.sdf < 0)], field.sdf[own & (field.sdf < 0)]
        )
    high = AT[2] > 61
    np.testing.assert_array_equal(after.sdf[high], field.sdf[high])
    assert solid_of(after, 0)[30, 30, 60]


def test_another_board_that_is_drawn_whole_stays():
    front = block((12.3, 8.3, 10.3), (15.3, 57.3, 56.3))
    boards = BOARDS.copy()
    boards[5, [2, 5]] -= 11
    case = np.min([block(b[:3], b[3:]) for b in boards], 0)
    field, panels = field_of(np.minimum(case, front)), panels_at(boards)
    kept = with_panels(field, [0], panels)
    np.testing.assert_array_equal(solid_of(kept, 0), solid_of(field, 0))
    near = (np.abs(front) < 1) & (np.abs(AT[1] - 33) < 10) & (np.abs(AT[2] - 40) < 6)
    np.testing.assert_array_equal(kept.sdf[near], field.sdf[near])  # and so does its surface
    torn = np.where(np.random.default_rng(0).random(AT.shape[1:]) < 0.6, 2.0, front)
    gone = with_panels(field_of(np.minimum(case, torn)), [0], panels)
    assert not solid_of(gone, 0)[:, 20:46, 31:46][11:17].any()


def test_an_outer_wall_stays_where_it_goes_on_beyond_its_panel():
    """As an oven's back above its hob, where a panel within is as high."""
    above = block((49.3, 8.3, 56.3), (52.3, 57.3, 63.3))
    divider = np.array([30.3, 30.3, 33.3, 50.3, 33.3, 63.3])
    window = block((45.3, 14.3, 58.3), (60.3, 24.3, 63.3))  # a hole in the wall, which stays
    above = np.maximum(above, -window)
    case = np.min([CASE, above, block(divider[:3], divider[3:])], 0)
    field = field_of(case)
    after = with_panels(field, [0], panels_at(np.concatenate([BOARDS, divider[None]])))
    high = np.broadcast_to(AT[2] > 59, case.shape) & (above < 0)
    assert high.sum() > 400 and solid_of(after, 0)[high].all()
    assert not solid_of(after, 0)[window < -1].any()


def test_crumbs_in_the_plane_of_an_outer_wall_go():
    boards = BOARDS.copy()
    boards[4, 5] = 30.3  # the back is low
    crumb = block((49.3, 28.3, 40.3), (52.3, 31.3, 43.3))
    shelf = np.array([12.3, 8.3, 46.3, 40.3, 57.3, 49.3])
    boards = np.concatenate([boards, shelf[None]])
    case = np.min([crumb, *(block(b[:3], b[3:]) for b in boards)], 0)
    after = with_panels(field_of(case), [0], panels_at(boards))
    assert not solid_of(after, 0)[crumb < 0].any()


def test_a_board_in_the_way_of_another_part_ends_there():
    tray = block((16.3, 14.3, 30.3), (45.3, 50.3, 37.3))  # where the shelf is to be
    after = with_panels(field_of(np.where(SHELF < 0, 2.0, CASE), tray), [0], ALL)
    assert solid_of(after, 1)[20, 20, 34] and not solid_of(after, 0)[20, 20, 33]
    assert solid_of(after, 0)[14, 20, 34]


def test_no_body_and_no_panels_give_nothing():
    field = field_of(CASE)
    assert with_panels(field, [1], ALL) is None
    assert with_panels(field, [0], Panels(np.zeros((0, 6)), 0.0)) is None


def test_without_a_panel_within_all_stays():
    crumbs = block((20.3, 20.3, 22.3), (24.3, 24.3, 25.3))
    field = field_of(np.min([crumbs, *(block(b[:3], b[3:]) for b in BOARDS[:5])], 0))
    assert with_panels(field, [0], panels_at(BOARDS[:5])) is field


def test_panels_of_another_body_are_not_taken():
    field = field_of(CASE)
    assert with_panels(field, [0], panels_at(BOARDS[:3])) is None  # much is drawn beside them
    plain = field_of(np.min([block(b[:3], b[3:]) for b in BOARDS[3:4]], 0))
    assert with_panels(plain, [0], ALL) is None  # little of them is drawn
    assert with_panels(field, [0], panels_at(BOARDS + 2.0)) is not None


def test_a_body_does_not_fall_apart():
    """Posts between a top and a shelf are no boards; without them the two are not joined."""
    boards = np.array([[4.3, 4.3, 53.3, 60.3, 60.3, 57.3], [6.3, 6.3, 20.3, 58.3, 58.3, 23.3]])
    posts = [block((x, y, 4.3), (x + 4, y + 4, 54)) for x in (6.3, 54.3) for y in (6.3, 54.3)]
    field = field_of(np.min([block(b[:3], b[3:]) for b in boards] + posts, 0))
    after = with_panels(field, [0], panels_at(boards))
    assert after is not None and ndimage.label(solid_of(after, 0))[1] == 1


def test_legs_explain_what_stands_below():
    posts = [(14.3, 10.3), (14.3, 45.3), (41.3, 10.3), (41.3, 45.3)]
    lifted = BOARDS.copy()  # the case is as high as the upper part of it was
    lifted[:, [2, 5]] = 26.3 + (BOARDS[:, [2, 5]] - 10.3) * 30 / 46
    rows = np.array([[x, y, x + 10, y + 10] for x, y in posts])
    drawn = [block(b[:3], b[3:]) for b in lifted]
    drawn += [block((x, y, 4.3), (u, v, 27)) for x, y, u, v in rows]
    field = field_of(np.min(drawn, 0))
    heights = np.tile(place_of((4.3, 27)), (4, 1))
    legs = Legs(place_of(rows), place_of(rows), heights, np.ones(4), np.zeros(4, bool), True)
    assert with_panels(field, [0], panels_at(lifted)) is None
    after = with_panels(field, [0], panels_at(lifted), legs)
    assert (solid_of(after, 0)[:, :, :20] == solid_of(field, 0)[:, :, :20]).all()


def test_the_layer_around_the_grid_stays_outside():
    large = panels_at(np.array([[-5.0, -5, -5, 80, 80, 80]]))
    after = with_panels(field_of(block((0.3, 0.3, 0.3), (64.7, 64.7, 64.7))), [0], large)
    for axis in range(3):
        for end in (0, -1):
            assert (np.moveaxis(after.sdf, axis, 0)[end] > 0).all()
    assert solid_of(after, 0)[1:-1, 1:-1, 1:-1].all()


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("side", [-1, 1])
def test_boards_and_legs_far_from_the_grid_are_borne(axis, side):
    away = BOARDS[5].copy()
    away[[axis, axis + 3]] += 100 * side
    field = field_of(CASE)
    after = with_panels(field, [0], panels_at(np.concatenate([BOARDS, away[None]])))
    if after is None:  # what is farther than the network's outputs can be is shown nowhere
        assert np.isfinite(field.sdf).all()
    else:
        np.testing.assert_array_equal(solid_of(after, 0), solid_of(field, 0))
    rectangle = place_of(away[[0, 1, 3, 4]])[None]
    heights = place_of(away[[2, 5]])[None]
    legs = Legs(rectangle, rectangle, heights, np.ones(1), np.zeros(1, bool), False)
    assert with_panels(field, [0], ALL, legs) is not None


def test_a_board_is_moved_to_where_it_is_drawn():
    moved = BOARDS.copy()
    moved[5, [2, 5]] += 4.0
    after = with_panels(field_of(CASE), [0], panels_at(moved))
    np.testing.assert_array_equal(solid_of(after, 0), solid_of(field_of(CASE), 0))
    few = np.where((SHELF < 0) & (AT[1] > 22), 2.0, CASE)  # little is drawn: it stays
    after = with_panels(field_of(few), [0], panels_at(moved))
    assert solid_of(after, 0)[30, 30, 38] and not solid_of(after, 0)[30, 30, 34]


@pytest.mark.parametrize("family", ["storage_furniture", "desk", "table", "cupboard", "oven"])
def test_what_is_true_is_not_cut(family):
    """Of the true panels' cells, on a grid of 128, those that fitted ones are not near."""
    places = np.stack(np.meshgrid(*[np.arange(1, 129, 2)] * 3, indexing="ij"), -1)

    def inside(boxes, room=0.0):
        rows = (((places >= b[:3] - room) & (places <= b[3:] + room)).all(-1) for b in boxes)
        return np.any(list(rows), 0)

    for seed in range(900_000, 900_004):
        boxes = (panels_of(procedural.generate(family, seed)).boxes + 0.5) * 128 + 0.5
        true = inside(boxes)
        lost = true & ~inside(fitted(boxes), 1.0)
        assert lost.sum() <= 0.02 * true.sum(), seed


def test_a_top_that_overhangs_and_sides_that_reach_the_floor_stay():
    boards = BOARDS.copy()
    boards[2, [1, 4]] = 2.3, 63.3  # the top
    boards[3, [2, 5]] = 20.3, 23.3  # the bottom
    np.testing.assert_allclose(fitted(boards), boards)
    short = np.array([[10.0, 24, 50, 60, 38, 52.5], [10, 30, 20, 60, 32.5, 80]])
    np.testing.assert_allclose(fitted(short), short)  # it passes through the other


def test_boards_that_follow_one_another_are_not_made_one():
    stack = np.array([[0.0, 0, z, 40, 40, z + 1] for z in (20, 21.1, 22.2, 23.3, 24.4)])
    middle = fitted(stack)[:, [2, 5]].mean(1)
    np.testing.assert_allclose(middle, stack[:, [2, 5]].mean(1), atol=0.3)


def test_boards_are_made_to_meet():
    rough = BOARDS.copy()
    rough[0, 5], rough[1, 5] = 51.3, 58.3  # one side ends below the top, one above it
    rough[4, 3] = 52.9  # faces of one plane
    rough[5, [1, 4]] = 14.3, 57.3  # a shelf that does not reach its side
    np.testing.assert_allclose(fitted(rough), BOARDS, atol=0.7)
    met = fitted(rough)
    assert len(np.unique(met[:, 5].round(3))) == len(np.unique(BOARDS[:, 5]))
    exact = fitted(BOARDS)
    np.testing.assert_allclose(exact, BOARDS)
    np.testing.assert_allclose(fitted(exact), exact)


def test_what_ends_far_from_others_stays_and_thin_boards_can_be_seen():
    half = BOARDS.copy()
    half[5] = [30.3, 8.3, 32.3, 52.3, 40.3, 32.5]  # a shelf that is neither as deep nor as wide
    met = fitted(half)[5]
    np.testing.assert_allclose(met[[0, 1, 3, 4]], half[5][[0, 1, 3, 4]])
    assert met[5] - met[2] > 2 and (met[5] + met[2]) / 2 == pytest.approx(32.4)


def test_fitting_does_not_depend_on_order_or_side():
    rng = np.random.default_rng(2)
    rough = BOARDS + rng.normal(0, 1, BOARDS.shape)
    order = rng.permutation(len(rough))
    np.testing.assert_allclose(fitted(rough[order]), fitted(rough)[order], atol=1e-9)
    cells = lambda boards: np.where(np.arange(6) % 3 == 1, N + 1 - boards, boards)  # noqa: E731
    turned = cells(rough)[:, [0, 4, 2, 3, 1, 5]]
    np.testing.assert_allclose(
        fitted(turned), cells(fitted(rough))[:, [0, 4, 2, 3, 1, 5]], atol=1e-9
    )


def test_mirroring_twice_is_nothing():
    boxes = ALL.boxes
    turned = mirror_corners(boxes)
    np.testing.assert_allclose(turned[:, [1, 4]], -boxes[:, [4, 1]])
    assert (turned[:, 3:] > turned[:, :3]).all()
    np.testing.assert_array_equal(mirror_corners(turned), boxes)


def outputs(count=4, **changes):
    rows = np.tile([-0.3, -0.4, 0.1, 0.2, 0.4, 0.12], (count, 1)) + 0.01 * np.arange(count)[:, None]
    exists = np.full(count, 3.0)
    return {"panel_rows": rows, "panel_exists": exists, "panel_share": np.array(0.95)} | changes


def test_panels_of_a_network():
    found = read_panels(outputs(panel_exists=np.array([3.0, -3, 3, -0.1])))
    np.testing.assert_allclose(found.boxes, outputs()["panel_rows"][[0, 2]])
    assert found.share == pytest.approx(0.95)
    assert read_panels(outputs(panel_exists=np.full(4, -1.0))) is None
    assert read_panels(outputs(panel_share=np.array(TRUSTED - 0.01))) is None


def test_what_a_network_says_can_be_written_and_read():
    rng = np.random.default_rng(0)
    for broken in (np.nan, np.inf):
        rows = outputs()["panel_rows"]
        rows[1, 2] = broken
        assert len(read_panels(outputs(panel_rows=rows))) == 3
    assert read_panels(outputs(panel_share=np.array(np.nan))) is None
    for scale in (0.1, 1, 100):
        rows = rng.normal(size=(24, 6)) * scale
        wild = read_panels(outputs(24, panel_rows=rows, panel_share=np.array(7.0)))
        assert (wild.boxes[:, 3:] - wild.boxes[:, :3] > THINNEST - 1e-9).all() and wild.share == 1
        again = panels_from_json(panels_to_json(wild))
        np.testing.assert_allclose(again.boxes, wild.boxes, atol=2e-6)


GOOD = {"lower": [-0.1, -0.1, -0.1], "upper": [0.1, 0.1, 0.1]}


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ([], 'must be null or have a list "rows"'),
        ({"rows": [3]}, "panel 0 is not an object"),
        ({"rows": [GOOD, GOOD | {"upper": [0.1, 0.1]}]}, "panel 1: upper must be 3 numbers"),
        ({"rows": [GOOD | {"lower": [0.1, 0.1, float("nan")]}]}, "panel 0: lower must be 3"),
        ({"rows": [GOOD | {"lower": [-7, 0, 0]}]}, "panel 0: lower must be 3 numbers in -1..1"),
        ({"rows": [GOOD], "estimate": 1}, "estimate 1 is neither true nor false"),
        ({"rows": [GOOD | {"lower": [0.1, 0, 0]}]}, "panel 0: lower .* must be below upper"),
        ({"rows": [GOOD], "share": 2}, "share 2 is not in 0..1"),
        ({"rows": [GOOD], "share": True}, "share True is not in 0..1"),
        ({"rows": [GOOD] * 300}, "300 rows; give at most 256"),
    ],
)
def test_bad_panels_are_refused_in_one_line(data, words):
    with pytest.raises(ValueError, match=words) as caught:
        panels_from_json(data)
    assert "\n" not in str(caught.value)


def test_panels_given_by_hand_need_no_share():
    found = panels_from_json({"rows": [GOOD]})
    assert found.share == 1 and not found.estimate and panels_from_json({"rows": []}) is None
    assert panels_from_json(None) is None

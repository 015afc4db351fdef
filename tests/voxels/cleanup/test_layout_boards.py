"""Moving parts are built of a layout's boards where voxels show their outline."""

import dataclasses

import numpy as np
import pytest
from fields import AT, N, assert_same, block, copy_of, field_of, moved, place_of, solid_of
from scipy import ndimage

from uniart_jax import procedural
from uniart_jax.data.panels import boards_of
from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.cleanup.layout_boards import with_boards
from uniart_jax.voxels.isosurface import dense_field, with_sources
from uniart_jax.voxels.opening_direction import still_parts
from uniart_jax.voxels.voxelize import voxelize

# sides, top, bottom, back, in cells; the front, at small x, is open
CASE = np.min(
    [
        block((12.3, 8.3, 10.3), (52.3, 11.3, 56.3)),
        block((12.3, 54.3, 10.3), (52.3, 57.3, 56.3)),
        block((12.3, 8.3, 53.3), (52.3, 57.3, 56.3)),
        block((12.3, 8.3, 10.3), (52.3, 57.3, 13.3)),
        block((49.3, 8.3, 10.3), (52.3, 57.3, 56.3)),
    ],
    0,
)
# a drawer: front, sides, back, floor, handle
DRAWER = np.array(
    [
        [8.3, 8.3, 10.3, 11.3, 57.3, 30.3],
        [11.3, 13.3, 15.3, 44.3, 15.5, 27.3],
        [11.3, 50.3, 15.3, 44.3, 52.5, 27.3],
        [42.1, 13.3, 15.3, 44.3, 52.5, 27.3],
        [11.3, 13.3, 15.3, 44.3, 52.5, 17.5],
        [5.3, 28.3, 19.3, 8.3, 38.3, 21.5],
    ]
)
SHAPE = np.min([block(b[:3], b[3:]) for b in DRAWER], 0)
SLIDE = Joint(np.zeros(3), np.array([-1.0, 0, 0]), travel=(0.0, 0.4))
JOINTS = [Joint.fixed(), SLIDE]


def at(boards):
    return place_of(np.asarray(boards).reshape(-1, 2, 3)).reshape(-1, 6)


def build(field, boards=DRAWER, joints=JOINTS):
    return with_boards(field, joints, [0], {1: at(boards)})


def torn(shape, share=0.02, seed=0):
    holes = np.random.default_rng(seed).random(AT.shape[1:]) < share
    return np.where(ndimage.binary_dilation(holes, np.ones((3, 3, 3))), 2.0, shape)


def test_a_torn_drawer_becomes_its_boards():
    rough, ideal = field_of(CASE, torn(SHAPE)), field_of(CASE, SHAPE)
    before = copy_of(rough)
    after, built = build(rough)
    assert_same(rough, before)
    assert built == {1}
    np.testing.assert_array_equal(solid_of(after, 1), solid_of(ideal, 1))
    np.testing.assert_array_equal(solid_of(after, 0), solid_of(ideal, 0))
    near = np.abs(ideal.sdf) < 1
    np.testing.assert_allclose(after.sdf[near], ideal.sdf[near], atol=0.45)
    surface = solid_of(after, 1) & ndimage.binary_dilation(~solid_of(after, 1))
    assert (with_sources(after, 2).source[surface] >= 0).all()


def test_a_handle_that_has_no_board_stays_and_a_ragged_front_does_not():
    rough = np.minimum(SHAPE, block((7.3, 20.3, 14.3), (9.3, 26.3, 17.3)))
    after, built = build(field_of(CASE, rough), DRAWER[:5])
    handle = (slice(6, 8), slice(29, 39), slice(20, 22))
    assert built == {1}
    assert solid_of(after, 1)[handle].all() and not solid_of(after, 1)[:8, 20:27, 14:18].any()
    whole = ndimage.label(solid_of(after, 1))[1]
    assert whole == 1


def test_a_drawer_stays_between_walls_that_are_not_the_bodys_ends():
    """A wide top over a case: its sides are inset; so is a wall within."""
    top, wall = block((8.3, 1.3, 56.3), (56.3, 64, 59.3)), block((12.3, 46.3, 10.3), (52, 48.5, 56))
    field = field_of(np.minimum.reduce([CASE, top, wall]), SHAPE)
    drawer = DRAWER.copy()
    drawer[[2, 3, 4], 4] -= 8
    drawer[2, 1] -= 8
    narrow = np.min([block(b[:3], b[3:]) for b in drawer], 0)
    field = field_of(np.minimum.reduce([CASE, top, wall]), narrow)
    wide = drawer.copy()
    wide[[1, 3, 4], 1], wide[[2, 3, 4], 4] = 8.4, 51.0
    wide[1, 4], wide[2, 1] = 10.6, 48.8
    after, built = build(field, wide)
    assert built == {1}
    one, two = solid_of(field, 0), solid_of(after, 0)
    assert (one & two).sum() > 0.98 * one.sum()
    assert two[20:40, 47, 20:25].all() and two[20:40, 10, 20:25].all()
    own = solid_of(after, 1)
    assert not own[13:, 47:].any() and not own[13:, :11].any()
    assert own[20:40, 12:16, 20:25].any(1).all() and own[20:40, 42:46, 20:25].any(1).all()


def test_a_drawer_that_opens_to_the_other_side_is_the_mirror_image():
    def turned(boards):
        boards = np.asarray(boards).copy()
        boards[:, [0, 3]] = N + 1 - boards[:, [3, 0]]
        return boards

    flip = lambda field: dataclasses.replace(  # noqa: E731
        field, sdf=field.sdf[::-1].copy(), owner=field.owner[::-1].copy()
    )
    lump = block((20.3, 20.3, 18.3), (30.3, 30.3, 25.3))
    field = field_of(np.minimum(CASE, lump), torn(SHAPE))
    other = Joint(np.zeros(3), np.array([1.0, 0, 0]), travel=(0.0, 0.4))
    for boards in (DRAWER, DRAWER[1:]):
        one, built = build(field, boards)
        two, too = build(flip(field), turned(boards), [JOINTS[0], other])
        assert built == too
        for part in (0, 1):
            np.testing.assert_array_equal(solid_of(one, part), solid_of(two, part)[::-1])


def test_what_touches_another_part_or_a_wall_keeps_its_thickness():
    """A lid in contact with the case, and a fixed handle of its own on it."""
    lid, handle = block((12.3, 8.3, 56.3), (52.3, 57.3, 58.5)), block((30, 30, 58.5), (34, 36, 62))
    field = field_of(CASE, lid, handle)
    hinge = Joint(place_of([52, 0, 56]), np.array([0, 1.0, 0]), angle=(0, 1.5))
    plate = np.array([[12.3, 8.3, 56.3, 52.3, 57.3, 58.5]])
    after, built = with_boards(field, [JOINTS[0], hinge, Joint.fixed()], [0], {1: at(plate)})
    assert built == {1}
    np.testing.assert_array_equal(solid_of(after, 1), solid_of(field, 1))
    np.testing.assert_array_equal(solid_of(after, 2), solid_of(field, 2))


def test_what_boards_explain_in_outline_alone_is_left():
    """A deep block behind a plate of the same outline, as a box lid with its rims."""
    deep = block((8.3, 8.3, 10.3), (30.3, 57.3, 30.3))
    hinge = Joint(place_of([11, 8, 0]), np.array([0, 0, 1.0]), angle=(0, 1.5))
    plates = np.array(
        [[8.3, 8.3, 10.3, 10.6, 57.3, 30.3], [28.0, 8.3, 10.3, 30.3, 12.3, 14.3]]
    )  # together as large
    field = field_of(CASE, deep)
    assert not build(field, plates, [JOINTS[0], hinge])[1]


def test_boards_beyond_the_grid_do_no_harm():
    lump = block((36.3, 34.3, 40.3), (44.3, 44.3, 48.3))
    field = field_of(np.minimum(CASE, lump), SHAPE)
    stray = np.concatenate([DRAWER, [[11.3, -30.0, 15.3, 44.3, -24.0, 17.5]]])
    after, _ = build(field, stray)
    np.testing.assert_array_equal(solid_of(after, 0), solid_of(field, 0))


def test_boards_are_moved_to_where_faces_are_drawn():
    off = DRAWER + np.array([1.4, -1.2, 1.1, 1.4, -1.2, 1.1])
    after, built = build(field_of(CASE, SHAPE), off)
    assert built == {1}
    ideal, found = solid_of(field_of(CASE, SHAPE), 1), solid_of(after, 1)
    front = (slice(9, 12), slice(9, 57), slice(12, 29))
    assert found[front].mean() > 0.97
    floor = (slice(14, 40), slice(18, 48), slice(16, 18))
    assert found[floor].all() and (found & ideal).sum() > 0.85 * ideal.sum()


def test_the_body_has_nothing_in_a_drawer_and_keeps_its_outer_walls():
    lump, rail = block((20.3, 20.3, 18.3), (30.3, 30.3, 25.3)), block((44.6, 12, 40), (48, 53, 44))
    field = field_of(np.minimum.reduce([CASE, lump, rail]), SHAPE)
    wide = DRAWER.copy()
    wide[[1, 3, 4], 1], wide[[3, 4, 2], 4] = 7.0, 58.0  # through the sides
    wide[1, 4], wide[2, 1] = 9.2, 55.8
    after, built = build(field, wide)
    plain = field_of(np.minimum(CASE, rail), SHAPE)
    np.testing.assert_array_equal(solid_of(after, 0), solid_of(plain, 0))
    assert built == {1}


def test_other_parts_stay():
    door = block((8.3, 8.3, 32.3), (11.3, 57.3, 56.3))
    thick = DRAWER.copy()
    thick[0, 5] = 33.0  # its front is over the door's lower edge
    field = field_of(CASE, SHAPE, door)
    after, _ = with_boards(field, [*JOINTS, JOINTS[1]], [0], {1: at(thick)})
    np.testing.assert_array_equal(solid_of(after, 2), solid_of(field, 2))
    np.testing.assert_array_equal(after.sdf[solid_of(field, 2)], field.sdf[solid_of(field, 2)])


@pytest.mark.parametrize(
    "boards",
    [
        DRAWER[1:],  # without its front
        DRAWER + np.array([0, 0, 12, 0, 0, 12]),  # above it
        DRAWER * np.array([1, 1, 1, 1, 0.6, 1]),  # half as wide
        np.concatenate([DRAWER, [[8.3, 8.3, 30.3, 11.3, 57.3, 52.3]]]),  # twice as high
        DRAWER[:0],
    ],
)
def test_boards_of_another_shape_are_not_taken(boards):
    field = field_of(CASE, SHAPE)
    after, built = build(field, boards)
    assert not built
    assert_same(after, field)


def test_boards_of_what_is_not_drawn_are_not_taken():
    field = field_of(CASE)
    after, built = build(field)
    assert not built
    assert_same(after, field)


def test_a_plate_that_turns_may_be_seen_through_its_thin_side():
    door = block((8.3, 8.3, 10.3), (11.3, 57.3, 56.3))
    hinge = Joint(place_of([11, 8, 0]), np.array([0, 0, 1.0]), angle=(0, 1.5))
    plate = np.array([[8.3, 8.3, 10.3, 11.3, 57.3, 56.3]])
    after, built = build(field_of(CASE, torn(door)), plate, [JOINTS[0], hinge])
    assert built == {1}
    np.testing.assert_array_equal(solid_of(after, 1), solid_of(field_of(CASE, door), 1))


# a cupboard with room before it; its door, with a handle, as it lies closed
CUPBOARD = np.min(
    [
        block((37.3, 8.3, 10.3), (62.3, 11.3, 56.3)),
        block((37.3, 38.3, 10.3), (62.3, 41.3, 56.3)),
        block((59.3, 8.3, 10.3), (62.3, 41.3, 56.3)),
        block((37.3, 8.3, 10.3), (62.3, 41.3, 13.3)),
    ],
    0,
)
DOOR = np.array([[33.3, 8.3, 10.3, 36.3, 41.3, 56.3], [28.3, 33.3, 19.3, 33.3, 37.3, 41.5]])
AT_LEFT = place_of([34.8, 8.3, 10.3]), np.array([0.0, 0, 1])


def ajar(angle, boards=DOOR):
    """Distances to the boards of the door, opened, and its joint."""
    hinge = Joint(*AT_LEFT, angle=(-angle, 1.5 - angle))
    closed = moved(hinge.motion(-angle))
    return np.min([block(b[:3], b[3:], closed) for b in boards], 0), hinge


def closed_by(joint):
    return {1: joint.motion(joint.limits[0])[:3]}


@pytest.mark.parametrize("angle", [0.2, 0.55])
def test_a_torn_door_that_stands_ajar_becomes_its_boards(angle):
    shape, hinge = ajar(angle)
    rough, ideal = field_of(CUPBOARD, torn(shape, 0.004)), field_of(CUPBOARD, shape)
    before = copy_of(rough)
    after, built = with_boards(rough, [JOINTS[0], hinge], [0], {1: at(DOOR)}, closed_by(hinge))
    assert_same(rough, before)
    assert built == {1}
    want, got, was = (solid_of(field, 1) for field in (ideal, after, rough))
    assert (got & want).sum() > 0.93 * (got | want).sum() > (was & want).sum()
    np.testing.assert_array_equal(solid_of(after, 0), solid_of(rough, 0))


def test_a_door_is_as_wide_as_it_is_drawn():
    """Boards that end a little elsewhere, and so far off that they are of something else."""
    door, hinge = block(*DOOR[0].reshape(2, 3)), Joint(*AT_LEFT, angle=(0.0, 1.5))
    field = field_of(CUPBOARD, torn(door))
    near, far = DOOR[:1].copy(), DOOR[:1].copy()
    near[0, [1, 2, 4, 5]] += [5, -4, 3, -6]
    far[0, [4, 5]] -= 14
    after, built = with_boards(field, [JOINTS[0], hinge], [0], {1: at(near)})
    assert built == {1}
    np.testing.assert_array_equal(solid_of(after, 1), solid_of(field_of(CUPBOARD, door), 1))
    assert with_boards(field, [JOINTS[0], hinge], [0], {1: at(far)})[1] == frozenset()


def test_walls_of_a_drawer_that_is_drawn_narrower_move_as_they_are():
    """Sides as far out as the front; the front is drawn narrower than its boards."""
    boards = DRAWER.copy()
    boards[1, [1, 4]], boards[2, [1, 4]] = [8.3, 10.5], [55.1, 57.3]
    for less in (2, 3, 5):
        narrower = [box.copy() for box in boards[[0, 3, 4, 5]]]
        for box in narrower[:3]:
            box[1], box[4] = max(box[1], 8.3 + less), min(box[4], 57.3 - less)
        field = field_of(CASE, np.min([block(b[:3], b[3:]) for b in narrower], 0))
        after, built = build(field, boards)
        assert built == {1}
        behind = solid_of(after, 1) & (AT[0] > 16) & (AT[0] < 40) & (AT[2] > 20) & (AT[2] < 26)
        low, high = (behind & half for half in (AT[1] < 32, AT[1] > 32))
        assert all(1 <= side.any((0, 2)).sum() <= 3 for side in (low, high))


def test_a_tab_beyond_the_edge_of_a_door_stays():
    tab = np.array([33.3, 20.3, 56.3, 36.3, 26.3, 60.3])
    boards = np.stack([DOOR[0], tab])
    field = field_of(CUPBOARD, np.min([block(b[:3], b[3:]) for b in boards], 0))
    hinge = Joint(*AT_LEFT, angle=(0.0, 1.5))
    after, built = with_boards(field, [JOINTS[0], hinge], [0], {1: at(boards)})
    assert built == {1} and solid_of(after, 1)[block(tab[:3], tab[3:]) < -0.5].all()


def test_boards_that_hang_in_the_air_reach_the_door():
    handle = block((26.3, 30.3, 19.3), (33.5, 34.3, 41.3))
    field = field_of(CUPBOARD, np.minimum(block(*DOOR[0].reshape(2, 3)), handle))
    boards = np.array([DOOR[0], [26.3, 30.3, 19.3, 29.3, 34.3, 41.3]])
    hinge = Joint(*AT_LEFT, angle=(0.0, 1.5))
    after, built = with_boards(field, [JOINTS[0], hinge], [0], {1: at(boards)})
    assert built == {1} and ndimage.label(solid_of(after, 1))[1] == 1


def test_a_handle_of_an_open_door_stays_though_no_board_is_found_of_it():
    shape, hinge = ajar(0.4)
    field, plate = field_of(CUPBOARD, shape), at(DOOR[:1])
    after, built = with_boards(field, [JOINTS[0], hinge], [0], {1: plate}, closed_by(hinge))
    assert built == {1}
    handle = ajar(0.4, DOOR[1:])[0] < -0.5
    assert solid_of(after, 1)[handle].mean() > 0.85


def test_boards_of_an_open_door_of_another_shape_are_not_taken():
    shape, hinge = ajar(0.4)
    field = field_of(CUPBOARD, shape)
    for boards in (DOOR[:1] - [0, 0, 20, 0, 0, 20], DOOR * [1, 1, 1, 1, 0.6, 1]):
        told = [JOINTS[0], hinge], [0], {1: at(boards)}, closed_by(hinge)
        after, built = with_boards(field, *told)
        assert built == frozenset()
        assert_same(after, field)
    elsewhere = {1: np.eye(3, 4)}  # it is not closed by this
    after, built = with_boards(field, [JOINTS[0], hinge], [0], {1: at(DOOR)}, elsewhere)
    assert built == frozenset()


def test_the_layer_around_the_grid_stays_outside():
    at_the_edge = DRAWER - np.array([11, 0, 0, 11, 0, 0])
    shape = np.min([block(b[:3], b[3:]) for b in at_the_edge], 0)
    after, built = build(field_of(CASE, shape), at_the_edge)
    assert built == {1} and not (after.sdf < 0)[[0, N + 1]].any()


def test_what_is_true_is_changed_by_little():
    checked = 0
    for seed in range(900_000, 900_008):
        obj = procedural.generate("storage_furniture", seed)
        grid = voxelize(obj, 32, 4)
        joints = [part.joint for part in obj.parts]
        body = still_parts([part.parent for part in obj.parts], joints)
        boards = {
            k: own.boxes
            for k, own in enumerate(boards_of(obj))
            if own is not None and own.share > 0.9
        }
        if not boards:
            continue
        field = dense_field(grid, grid.owner)
        after, built = with_boards(field, joints, body, boards)
        for k in built:
            one, two = solid_of(field, k), solid_of(after, k)
            ends = [np.array([np.argwhere(x).min(0), np.argwhere(x).max(0)]) for x in (one, two)]
            assert (ends[1][0] <= ends[0][0] + 2).all() and (ends[1][1] >= ends[0][1] - 2).all()
            assert (one & two).sum() > 0.55 * (one | two).sum()
            checked += 1
        for k in set(range(len(joints))) - built:
            one, two = solid_of(field, k), solid_of(after, k)
            assert (one & two).sum() > 0.97 * (one | two).sum()
        assert len(built) >= 0.7 * len(boards)
    assert checked >= 8


def test_a_back_does_not_stand_for_a_front():
    """Seen along its way the drawer's back would close its front."""
    boards = DRAWER.copy()
    boards[3, [1, 2, 4, 5]] = boards[0, [1, 2, 4, 5]]  # a back as large
    field = field_of(CASE, np.minimum(SHAPE, block(boards[3, :3], boards[3, 3:])))
    assert build(field, boards)[1] == {1}
    assert not build(field, boards[1:])[1]

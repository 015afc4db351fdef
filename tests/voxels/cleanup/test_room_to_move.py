"""Moving parts get the way that their joints say, nothing else is taken, and outer walls stay."""

import numpy as np
import pytest
import trimesh
from fields import AT, N, assert_same, block, copy_of, field_of, moved, place_of, solid_of
from scipy import ndimage

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels import opening_direction
from uniart_jax.voxels.cleanup.room_to_move import (
    _straight,
    _too_much,
    with_meshes,
    with_room_to_move,
)
from uniart_jax.voxels.isosurface import ZERO, with_sources

FIXED = Joint.fixed()
EMPTY = np.full((N + 2,) * 3, 3.0)


def hinge(cell, direction, lo, hi):
    return Joint(place_of(cell), direction, angle=(lo, hi))


def slider(direction, cells):
    return Joint(np.zeros(3), direction, travel=(0, cells / N))


def nearest_on_way(joint, lower, upper):
    """[N + 2]^3 least distance of each cell from a block on its way."""
    way = np.linspace(*joint.limits, 49)
    return np.min([block(lower, upper, moved(np.linalg.inv(joint.motion(q)))) for q in way], 0)


def taken(field, after, part):
    return solid_of(field, part) & ~solid_of(after, part)


# a cabinet, open in front (low x), and its door; a lip of the body reaches in front of the door
CASE = ((14.3, 8.3, 8.3), (56.3, 56.3, 56.3))
DOOR = ((10.3, 12.3, 12.3), (13.3, 52.3, 52.3))
LIP = ((8.3, 46.3, 8.3), (14.4, 56.3, 56.3))  # thin: what is thick has outer walls of its own
SWINGS = hinge((10.3, 12.3, 30), (0, 0, 1), 0, 1.2)


def cabinet(lip=LIP, more=EMPTY):
    hollow = np.maximum(block(*CASE), -block((10, 12.3, 12.3), (52.3, 52.3, 52.3)))
    body = np.minimum(np.minimum(hollow, block(*lip)) if lip else hollow, more)
    return field_of(np.maximum(body, 0.6 - block(*DOOR)), block(*DOOR))


@pytest.fixture(scope="module")
def lipped():
    field = cabinet()
    return field, with_room_to_move(field, [FIXED, SWINGS], [-1, 0])


def test_what_bars_a_doors_way_is_taken_and_nothing_else(lipped):
    field, after = lipped
    near = nearest_on_way(SWINGS, *DOOR)
    bars = (near < -0.5) & solid_of(field, 0)
    assert bars.sum() > 150  # the lip did bar it
    assert not (solid_of(after, 0) & (near < -0.05)).any()
    assert (near[taken(field, after, 0)] < 1).all()
    np.testing.assert_array_equal(solid_of(after, 1), solid_of(field, 1))
    assert not ((after.sdf < 0) & (field.sdf > 0)).any()
    np.testing.assert_array_equal(after.owner, field.owner)


def test_the_field_given_is_not_changed_and_the_result_is_always_the_same(lipped):
    field, after = lipped
    before = copy_of(field)
    again = with_room_to_move(field, [FIXED, SWINGS], [-1, 0])
    assert_same(field, before)
    assert_same(again, after)


def test_a_joint_told_the_other_way_round_gives_the_same(lipped):
    field, after = lipped
    reverse = hinge((10.3, 12.3, 50), (0, 0, -1), -1.2, 0)
    other = with_room_to_move(field, [FIXED, reverse], [-1, 0])
    np.testing.assert_array_equal(other.sdf < 0, after.sdf < 0)


def test_a_mirrored_object_gives_the_mirrored_result(lipped):
    field, after = lipped
    flip = np.diag([1.0, -1, 1, 1])
    mirrored = copy_of(field)
    for values in (mirrored.sdf, mirrored.owner, mirrored.source):
        values[...] = values[:, ::-1]
    other = with_room_to_move(mirrored, [FIXED, SWINGS.transformed(flip)], [-1, 0])
    np.testing.assert_array_equal(other.sdf < 0, (after.sdf < 0)[:, ::-1])


def test_rows_may_stand_in_any_order(lipped):
    field, after = lipped
    swapped = copy_of(field)
    swapped.owner[field.owner >= 0] = 1 - field.owner[field.owner >= 0]
    other = with_room_to_move(swapped, [SWINGS, FIXED], [1, -1])
    np.testing.assert_array_equal(other.sdf < 0, after.sdf < 0)


def test_nothing_is_taken_where_nothing_bars_the_way():
    field = cabinet(lip=None)
    outward = with_room_to_move(field, [FIXED, SWINGS], [-1, 0])
    assert_same(outward, field)
    still = with_room_to_move(cabinet(), [FIXED, FIXED], [-1, 0])
    assert_same(still, cabinet())


@pytest.mark.parametrize("seed", range(4))
def test_drawers_with_room_around_take_nothing(seed):
    rng = np.random.default_rng(seed)
    axis, low, high = int(rng.integers(3)), rng.uniform(16, 24, 3), rng.uniform(36, 48, 3)
    gap = rng.uniform(1.8, 3)  # its own surface is half a cell off at most, and so is the slot's
    end = high.copy()
    end[axis] = 70
    body = np.maximum(block((4.3,) * 3, (60.3,) * 3), -block(low - gap, end + gap))
    field = field_of(body, block(low, high))
    joint = slider(np.eye(3)[axis], rng.uniform(4, 30))
    assert_same(with_room_to_move(field, [FIXED, joint], [-1, 0]), field)


def test_a_slot_is_opened_only_on_the_side_to_which_a_drawer_opens():
    """A drawer in a closed box: its front wall is cut through, the others stay; what of the drawer
    was drawn wider than the front lets through is taken off the drawer."""
    body = np.maximum(block((8.3,) * 3, (56.3,) * 3), -block((11.3, 10.3, 10.3), (54.3,) * 3))
    wide = block((34.3, 8.6, 20.3), (44.3, 44.3, 44.3))  # behind, drawn through the side wall
    drawer = np.minimum(block((12.3, 12.3, 20.3), (44.3, 44.3, 44.3)), wide)
    body = np.maximum(body, -(wide - 0.1))
    field = field_of(body, drawer)
    after = with_room_to_move(field, [FIXED, slider((-1, 0, 0), 24)], [-1, 0])
    front = AT[0] < 11
    inside = np.all([(a > 13.2) & (a < 43.2) for a in AT[1:]], 0) & (AT[2] > 21)
    assert (field.sdf[front & inside & (AT[0] > 9)] < 0).all()
    assert (after.sdf[front & inside] > 0).all()
    gone = taken(field, after, 0)
    assert gone.any() and (AT[0][gone] < 12).all()
    # the frame around the opening stays
    assert not gone[:, :, 46:].any() and not gone[:, 46:].any() and not gone[:, :, :19].any()
    lost = taken(field, after, 1)
    assert lost.sum() > 400 and (AT[1][lost] < 11).all() and (AT[0][lost] > 34).all()
    assert not (solid_of(after, 1) & (AT[1] < 10)).any()


def test_a_dish_in_an_outer_wall_is_cut_for_what_is_small():
    """A button that is pushed along a wall, and the same five times as large."""
    for scale, cut in ((1, True), (5, False)):
        far = 30.3 + 4 * scale
        button = block((8.3, 30.3, 30.3), (10.3, far, far))
        field = field_of(np.maximum(block((8.3,) * 3, (56.3,) * 3), -button), button)
        after = with_room_to_move(field, [FIXED, slider((0, 0, -1), 8)], [-1, 0])
        assert taken(field, after, 0).any() == cut, scale


def test_what_moves_on_a_joint_of_its_own_is_left():
    """A drawer behind a door: the door can be opened first; fixed to the body it is in the way."""
    drawer = block((20.3, 20.3, 20.3), (44.3, 44.3, 44.3))
    door = block((12.3, 10.3, 10.3), (15.3, 54.3, 54.3))
    field = field_of(block((50.3, 8.3, 8.3), (56.3, 56.3, 56.3)), door, drawer)
    opens, slides = hinge((12.3, 10.3, 30), (0, 0, 1), 0, 1.2), slider((-1, 0, 0), 20)
    after = with_room_to_move(field, [FIXED, opens, slides], [-1, 0, 0])
    assert_same(after, field)
    barred = with_room_to_move(field, [FIXED, FIXED, slides], [-1, 0, 0])
    assert taken(field, barred, 1).sum() > 500
    # what carries the drawer bars its way though it moves
    carried = with_room_to_move(field, [FIXED, opens, slides], [-1, 0, 1])
    assert taken(field, carried, 1).sum() > 500


def test_what_a_part_carries_goes_its_way_with_it():
    """A handle on a door clears its own way, and bars not the door's."""
    post = ((2.3, 40.3, 54.3), (4.3, 56.3, 61.3))  # joined to the body at its far end
    lip = block((2.3, 53.3, 50.3), (16.3, 56.3, 61.3))
    handle = ((5.3, 46.3, 40.3), (10.3, 49.3, 61.3))  # above the door
    body = np.min([block((14.3, 8.3, 8.3), (56.3, 56.3, 56.3)), block(*post), lip], 0)
    field = field_of(body, block(*DOOR), block(*handle))
    after = with_room_to_move(field, [FIXED, SWINGS, FIXED], [-1, 0, 1])
    near = nearest_on_way(SWINGS, *handle)
    assert ((near < -0.5) & solid_of(field, 0)).sum() > 20
    assert not ((near < -0.05) & solid_of(after, 0)).any()
    for k in (1, 2):
        np.testing.assert_array_equal(solid_of(after, k), solid_of(field, k))
    backwards = copy_of(field)
    backwards.owner[field.owner >= 0] = 2 - field.owner[field.owner >= 0]
    other = with_room_to_move(backwards, [FIXED, SWINGS, FIXED], [1, 2, -1])
    np.testing.assert_array_equal(other.sdf < 0, after.sdf < 0)


def test_a_part_that_would_lose_too_much_stays_as_it_is():
    """A small block all on a drawer's way: neither it nor the drawer is taken off."""
    field = field_of(block((10.3, 22.3, 22.3), (16.3, 42.3, 42.3)), block((18.3,) * 3, (46.3,) * 3))
    assert_same(with_room_to_move(field, [FIXED, slider((-1, 0, 0), 40)], [-1, 0]), field)


def test_a_moving_part_loses_its_corners_where_walls_bar_it():
    """A drum whose corners were drawn square, in a round hole of a body's outer walls."""
    radius = np.hypot(AT[1] - 32.3, AT[2] - 32.3)
    drum = block((20.3, 17.3, 17.3), (44.3, 47.3, 47.3))
    body = np.maximum(block((18.3, 8.3, 8.3), (46.3, 56.3, 56.3)), 18.5 - radius)
    field = field_of(np.maximum(body, -(drum - 0.6)), drum)
    turns = Joint(place_of((30, 32.3, 32.3)), (1, 0, 0), angle=(-np.pi, np.pi))
    after = with_room_to_move(field, [FIXED, turns], [-1, 0])
    gone = taken(field, after, 1) | taken(field, after, 0)
    assert gone.sum() > 100
    assert (radius[gone] > 14).all() and (radius[gone] < 22.3).all()


def test_a_round_disc_takes_nothing():
    """In its dish, which is as wide as it, and though it turns all round."""
    disc = np.maximum(np.hypot(AT[1] - 32.3, AT[2] - 30.4) - 8.2, np.abs(AT[0] - 10.3) - 3.2)
    field = field_of(np.maximum(block((10.3, 8.3, 8.3), (56.3,) * 3), 1.5 - disc), disc)
    turns = Joint(place_of((30, 32.3, 30.4)), (1, 0, 0), angle=(-np.pi, np.pi))
    assert_same(with_room_to_move(field, [FIXED, turns], [-1, 0]), field)


@pytest.mark.parametrize(("length", "stays"), [(2, False), (22, True)])
def test_small_pieces_that_a_way_cuts_off_go(length, stays):
    """An arm reaches across a drawer's way; what is left beyond it is a crumb, or a part's
    share."""
    drawer = ((30.3, 20.3, 20.3), (50.3, 44.3, 44.3))
    top = 44.3 + length
    arm = block((18.3, 28.3, 8.3), (24.3, 36.3, 20))
    arm = np.minimum(arm, block((22.3, 30.3, 8.3), (24.3, 34.3, top)))
    if stays:
        arm = np.minimum(arm, block((14.3, 20.3, 44.6), (30.3, 44.3, min(top, 60.3))))
    foot = block((16.3, 8.3, 8.3), (56.3, 56.3, 14.3))
    field = field_of(np.minimum(arm, foot), block(*drawer))
    after = with_room_to_move(field, [FIXED, slider((-1, 0, 0), 20)], [-1, 0])
    beyond = AT[2] > 45.3
    assert ndimage.label(solid_of(field, 0))[1] == 1 and (solid_of(field, 0) & beyond).any()
    assert not (solid_of(after, 0) & (AT[2] > 21) & (AT[2] < 44)).any()
    np.testing.assert_array_equal(
        solid_of(after, 0) & beyond, solid_of(field, 0) & beyond & bool(stays)
    )
    assert not taken(field, after, 0)[:, :, :20].any()


def test_pieces_that_hung_on_nothing_before_are_left():
    """Only what is cut off goes, though it be no larger."""
    crumb = block((4.3, 4.3, 58.3), (6.3, 6.3, 60.3))
    field = cabinet(more=crumb)
    after = with_room_to_move(field, [FIXED, SWINGS], [-1, 0])
    assert taken(field, after, 0).any() and ndimage.label(solid_of(field, 0))[1] == 2
    assert (after.sdf[crumb < 0] < 0).all()


def test_cells_that_are_laid_bare_have_a_source(lipped):
    """That of the nearest of their own part, where they had none."""
    field = copy_of(lipped[0])
    known = (field.owner == 1) | ((field.owner == 0) & (AT[0] > 16))  # the door's are nearer
    field.source[~known] = -1
    field.source[known] = field.owner[known]
    cut = with_room_to_move(field, [FIXED, SWINGS], [-1, 0])
    after = with_sources(cut, 2)
    solid = solid_of(after, 0)
    bare = solid & ndimage.binary_dilation(~solid, np.ones((3, 3, 3)))
    assert (field.source[bare] < 0).any() and (after.source[bare] == 0).all()
    np.testing.assert_array_equal(after.source[~bare & ~solid_of(after, 1)],
                                  field.source[~bare & ~solid_of(after, 1)])  # fmt: skip


def test_distances_never_lie_next_to_zero():
    """Cells of the mover that lie on its surface, seen from half a cell away."""
    drawer = block((20.0, 20.0, 20.0), (40.0, 40.0, 40.0))
    field = field_of(np.maximum(block((8.3,) * 3, (56.3,) * 3), 0.6 - drawer), drawer)
    after = with_room_to_move(field, [FIXED, slider((0, 0, 1), 4.5)], [-1, 0])
    assert taken(field, after, 0).any()
    assert np.abs(after.sdf).min() >= ZERO


@pytest.mark.slow
def test_empty_parts_and_the_grids_border_are_borne():
    whole = block((0.5,) * 3, (64.5,) * 3)
    joints = [FIXED, hinge((2, 60, 30), (0, 0, 1), -1.0, 2.0)]
    plate = block((0.5, 0.5, 0.5), (20, 64.5, 64.5))
    for solids in ((EMPTY, EMPTY), (EMPTY, whole), (whole, EMPTY)):
        field = field_of(*solids)
        assert_same(with_room_to_move(field, joints, [-1, 0]), field)
    after = with_room_to_move(field_of(np.maximum(whole, 0.5 - plate), plate), joints, [-1, 0])
    for k in range(3):
        assert (np.moveaxis(after.sdf, k, 0)[[0, -1]] > 0).all()
    assert solid_of(after, 0).any() and solid_of(after, 1).any()


def box_mesh(lower, upper):
    mesh = trimesh.creation.box((np.array(upper) - lower) / N)
    return mesh.apply_translation((place_of(lower) + place_of(upper)) / 2)


def test_small_meshes_hold_the_cells_that_they_fill():
    wall = block((8.3,) * 3, (56.3,) * 3)
    field = field_of(wall)
    before = copy_of(field)
    knobs = [((5.2, 20.2, 20.2), (11.2, 26.2, 26.2)), ((4.2, 40.2, 40.2), (9.2, 44.2, 43.2))]
    after = with_meshes(field, [box_mesh(*knob) for knob in knobs], 1)
    assert_same(field, before)
    rest = np.ones(wall.shape, bool)
    for k, knob in enumerate(knobs, 1):
        mine = block(*knob) < 0
        np.testing.assert_array_equal(solid_of(after, k), mine)
        np.testing.assert_allclose(after.sdf[mine], np.clip(block(*knob)[mine], -1, 0), atol=1e-5)
        rest &= ~mine
    np.testing.assert_array_equal(after.sdf[rest], field.sdf[rest])
    np.testing.assert_array_equal(after.owner[rest], field.owner[rest])
    round_one = trimesh.creation.cylinder(6 / N, 4.2 / N).apply_translation(place_of((30, 30, 30)))
    disc = solid_of(with_meshes(field_of(EMPTY), [round_one], 0), 0)
    assert disc.sum() == pytest.approx(np.pi * 36 * 5, rel=0.06)


def test_each_mesh_has_a_cell_and_none_beyond_the_grid():
    tiny = box_mesh((20.4, 20.4, 20.4), (20.6, 20.6, 20.6))
    beyond = box_mesh((90, 90, 90), (95, 95, 95))
    across = box_mesh((60.2, 20.2, 20.2), (80.2, 30.2, 30.2))
    after = with_meshes(field_of(EMPTY), [tiny, beyond, across], 0)
    assert [solid_of(after, k).sum() for k in range(3)] == [1, 1, 4 * 100]
    for k in range(3):
        assert (np.moveaxis(after.sdf, k, 0)[[0, -1]] > 0).all()


def test_a_part_within_a_small_mesh_keeps_its_cells():
    """Or no mesh could be made of it."""
    pin = block((20.3,) * 3, (24.3,) * 3)
    field = field_of(block((30.3,) * 3, (56.3,) * 3), pin)
    after = with_meshes(field, [box_mesh((18.2,) * 3, (26.2,) * 3)], 2)
    np.testing.assert_array_equal(solid_of(after, 1), pin < 0)
    assert solid_of(after, 2).sum() == 8**3 - (pin < 0).sum()


@pytest.mark.parametrize(
    "joint, side",
    [
        (hinge((10.3, 12.3, 30), (0, 0, 1), 0, 1.9), (0, -1)),  # ends sideways of where it began
        (hinge((10.3, 12.3, 30), (0, 0, 1), -0.1, 1.9), (0, -1)),
        (hinge((10.3, 12.3, 30), (0, 0, -1), -1.9, 0), (0, -1)),
        (hinge((10.3, 30, 12.3), (0, -1, 0), 0, 1.6), (0, -1)),  # an oven's
        (hinge((56.3, 30, 56.3), (0, 1, 0), 0, 1.4), None),  # a lid: its own test below
        (Joint(np.zeros(3), (-1, 0, 0), travel=(-0.02, 0.4)), (0, -1)),
        (Joint(np.zeros(3), (1, 0, 0), travel=(-0.4, 0.02)), (0, -1)),
        (slider((-1, 0, 0), 2), None),
        (Joint(np.zeros(3), (1, 0, 0), angle=(-np.pi, np.pi)), None),
    ],
)
def test_a_part_opens_to_the_side_to_which_it_begins_to_go(joint, side):
    body, door = (np.argwhere(block(*corners) < 0) for corners in (CASE, DOOR))
    if joint.direction[1] == 1:
        lid = np.argwhere(block((14.3, 8.3, 56.3), (56.3, 56.3, 60.3)) < 0)
        assert opening_direction.opens_to(joint, lid, body, N) == (2, 1)
    else:
        assert opening_direction.opens_to(joint, door, body, N) == side


def test_a_part_that_is_shown_open_opens_to_the_same_side():
    body = np.argwhere(block(*CASE) < 0)
    joint = hinge((10.3, 12.3, 30), (0, 0, 1), 0, 1.9)
    for share in (0.3, 1.0):
        matrix = joint.motion(share * 1.9)
        opened = np.argwhere(block(*DOOR, moved(np.linalg.inv(matrix))) < 0)
        shown = hinge((10.3, 12.3, 30), (0, 0, 1), -share * 1.9, (1 - share) * 1.9)
        assert opening_direction.opens_to(shown, opened, body, N) == (0, -1)


def test_parts_that_do_not_fit_side_by_side_when_closed_are_made_to():
    """Two drawers, one above the other, of which the picture shows the upper one open."""
    body = block((50.3, 8.3, 8.3), (56.3, 56.3, 56.3))
    lower = block((20.3, 10.3, 10.3), (48.3, 54.3, 34.3))
    upper = np.maximum(block((4.3, 10.3, 32.3), (32.3, 54.3, 50.3)), 0.6 - lower)
    opened = Joint(np.zeros(3), (-1, 0, 0), travel=(-16 / N, 4 / N))
    field = field_of(body, lower, upper)
    joints = [FIXED, slider((-1, 0, 0), 20), opened]

    def shared(some):
        return np.roll(solid_of(some, 2), 16, 0) & solid_of(some, 1)

    after = with_room_to_move(field, joints, [-1, 0, 0])
    assert shared(field).sum() > 500 and not shared(after).any()
    np.testing.assert_array_equal(solid_of(after, 2), solid_of(field, 2))  # the smaller
    assert taken(field, after, 1).sum() == shared(field).sum()


def test_what_is_cut_along_a_hinge_is_straight():
    others = np.zeros((20, 20, 40), bool)
    others[5:9, 5:9, 2:38] = True
    cells = np.argwhere(np.ones((1, 1, 30))) + [12, 5, 5]  # a door's, at heights 5 to 34
    much = np.array([[6, 6, z] for z in range(5, 35, 3)])
    little = np.array([[7, 7, 9], [7, 7, 20], [6, 6, 36]])  # the last one above the door
    barring = np.concatenate([much, little])
    depth = np.linspace(0.1, 1.0, len(barring))
    upright = hinge((12, 5, 20), (0, 0, 1), 0, 1.5)
    cut, deep = _straight(barring, depth, upright, cells, others)
    found = {tuple(cell): d for cell, d in zip(cut.tolist(), deep, strict=True)}
    line = {(6, 6, z): depth[len(much) - 1] for z in range(5, 35)}
    rest = {tuple(c): d for c, d in zip(little.tolist(), depth[len(much) :], strict=True)}
    assert found == pytest.approx(line | rest)
    for other in (hinge((12, 5, 20), (0, 0.2, 0.98), 0, 1.5), slider((0, 0, 1), 9)):
        same, unchanged = _straight(barring, depth, other, cells, others)
        assert same is barring and unchanged is depth
    others[6, 6, 15] = False  # an outer wall, or free
    cut, _ = _straight(barring, depth, upright, cells, others)
    assert [6, 6, 15] not in cut.tolist() and len(cut) == len(line) - 1 + len(rest)


def test_a_straight_cut_that_takes_too_much_is_not_made():
    """A thin strip beside a door, of which every eighth layer bars the door's way."""
    strip = ((8.3, 8.3, 12.3), (12.3, 12.6, 52.3))
    door = ((10.3, 13.3, 12.3), (13.3, 50.3, 52.3))
    teeth = np.maximum(block((8.3, 8.3, 12.3), (16.3, 13.0, 52.3)), 0.7 - (AT[2] % 8 < 1))
    field = field_of(np.minimum(block(*strip), teeth), block(*door))
    turns = hinge((12.3, 13.3, 30), (0, 0, 1), 0, 1.2)
    after = with_room_to_move(field, [FIXED, turns], [-1, 0])
    lost, whole = taken(field, after, 0).sum(), solid_of(field, 0).sum()
    assert 0 < lost <= 0.3 * whole
    cells = np.argwhere(solid_of(field, 0))
    depth = np.ones(len(cells))
    assert _too_much(field.sdf, field.owner, cells, depth, 0.3)
    assert not _too_much(
        field.sdf, field.owner, cells, np.where(np.arange(len(cells)) < 9, 1, 0), 0.3
    )

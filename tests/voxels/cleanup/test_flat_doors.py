"""Doors become flat plates, where they stand open and where they are closed, and come back as their
joints say."""

import numpy as np
import pytest
from fields import (
    AT,
    N,
    assert_same,
    block,
    box_of,
    copy_of,
    field_of,
    moved,
    place_of,
    solid_of,
    surface_has_sources,
)
from scipy import ndimage

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.cleanup.flat_faces import with_flat_faces
from uniart_jax.voxels.isosurface import DenseField

# a door, hinged at low y, that stands open about its hinge
HINGE, CLOSED = (42.4, 14.2, 30.0), ((40.3, 14.3, 12.2), (44.3, 50.3, 52.2))


def opened(degrees, closed=CLOSED, hinge=HINGE, wavy=False, torn=False):
    """Its distance, the row of its box, its joint; also the distance of an even one."""
    joint = Joint(place_of(hinge), (0, 0, 1), angle=tuple(np.deg2rad([-degrees, 90 - degrees])))
    at = moved(np.linalg.inv(joint.motion(np.deg2rad(degrees))))
    even = block(*closed, at)
    rough = even
    if wavy:
        ripples = np.sin(at[2] * (2 * np.pi / 12)) + 0.4 * np.sin(at[1] * 1.7)
        teeth = np.where(at[1] // 4 % 3 == 0, 4.0, 0.0)
        (x, y, z), (x1, y1, z1) = closed
        rough = block((x + 1.2 * ripples, y, z), (x1, y1, z1 - teeth), at)
    if torn:
        rough = np.maximum(rough, -block((0, 0, 32), (64, 64, 64), at))
    solid = np.argwhere(even < 0)
    return rough, box_of(solid.min(0) - 0.5, solid.max(0) + 0.5), joint, even


def share_that_differs(field, part, distance, beyond=0.0):
    """Of a solid's cells: those where a part is not as it, further than ``beyond`` off its
    faces."""
    differ = (solid_of(field, part) != (distance < 0)) & (np.abs(distance) > beyond)
    return differ.sum() / (distance < 0).sum()


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [30, 60])
@pytest.mark.parametrize("parents", [(-1,), (-1, 0)])
def test_a_plate_that_stands_open_becomes_flat_and_its_edges_straight(degrees, parents):
    rough, box, joint, even = opened(degrees, wavy=True)
    field = field_of(rough)
    before = copy_of(field)
    flat = with_flat_faces(field, box[None], [joint], parents)
    assert_same(field, before)
    assert share_that_differs(field, 0, even, 0.8) > 0.02
    assert share_that_differs(flat, 0, even, 0.8) < 0.008
    volume = np.clip(0.5 - flat.sdf[flat.owner == 0], 0, 1).sum()
    assert volume == pytest.approx(4 * 36 * 40, rel=0.06)
    # where a distance is that of its face, it is even
    inside = np.abs(even - moved_front(joint, degrees)) < 1e-6
    near = inside & (np.abs(even) < 0.4)
    assert near.sum() > 500
    assert np.std((flat.sdf - even)[near]) < 0.4 * np.std((field.sdf - even)[near])
    assert surface_has_sources(flat)
    assert_same(with_flat_faces(field, box[None], [joint], parents), flat)


def moved_front(joint, degrees):
    """Distance ahead of the opened door's front."""
    at = moved(np.linalg.inv(joint.motion(np.deg2rad(degrees))))
    return CLOSED[0][0] - at[0]


def test_half_a_door_is_completed_only_where_it_stands_open():
    for degrees, whole in ((30, True), (5, False)):
        rough, box, joint, even = opened(degrees, torn=True)
        flat = with_flat_faces(field_of(rough), box[None], [joint])
        assert ((even < 0) & (rough > 0)).sum() > 0.4 * (even < 0).sum()
        differs = share_that_differs(flat, 0, even, 1.0)
        assert differs < 0.02 if whole else differs > 0.1
        assert surface_has_sources(flat)


@pytest.mark.parametrize("less", [3, 4, 5])
def test_an_opened_door_that_is_drawn_too_small_is_completed(less):
    _, box, joint, even = opened(30)
    small = tuple(np.add(CLOSED[0], (0, less, less))), tuple(np.add(CLOSED[1], (0, -less, -less)))
    at = moved(np.linalg.inv(joint.motion(np.deg2rad(30))))
    flat = with_flat_faces(field_of(block(*small, at)), box[None], [joint])
    assert share_that_differs(flat, 0, even, 1.0) < 0.02


def test_a_closed_lever_stays_a_rod():
    rod = np.maximum(np.hypot(AT[0] - 42.3, AT[1] - 32.3) - 4.2, np.abs(AT[2] - 32.3) - 20)
    field = field_of(rod)
    box = box_of((38.1, 28.1, 12.3), (46.5, 36.5, 52.3))
    joint = Joint(place_of((42.3, 28.1, 32.3)), (0, 0, 1), angle=(0.0, np.pi / 2))
    flat = with_flat_faces(field, box[None], [joint])
    changed = (solid_of(flat, 0) != solid_of(field, 0)).sum()
    assert changed < 0.2 * solid_of(field, 0).sum()  # as a plate .3


@pytest.mark.parametrize(("shape", "most"), [("bail", 0.1), ("round", 0.1), ("hood", 0.2)])
def test_what_stands_open_and_is_no_plate_is_not_completed(shape, most):
    """A hood becomes even, as it lies straight; as a plate .7 of it would change."""
    rough, box, joint, _ = opened(30)
    at = moved(np.linalg.inv(joint.motion(np.deg2rad(30))))
    (_, y, z), (_, y1, z1) = CLOSED
    if shape == "bail":  # three bars
        rough = np.maximum(rough, -block((0, y - 9, z + 3), (64, y1 - 3, z1 - 3), at))
    if shape == "round":
        off = np.hypot(at[1] - (y + y1) / 2, (at[2] - (z + z1) / 2) * 0.9) - 18
        rough = np.maximum(rough, off)
    if shape == "hood":  # a shell of half a cylinder, whose ends are open
        about = np.hypot(at[0] - 44.3, at[1] - (y + y1) / 2)
        rough = np.maximum.reduce([np.abs(about - 16) - 2, at[0] - 44.3, z - at[2], at[2] - z1])
        solid = np.argwhere(rough < 0)
        box = box_of(solid.min(0) - 0.5, solid.max(0) + 0.5)
    field = field_of(rough)
    flat = with_flat_faces(field, box[None], [joint])
    changed = (solid_of(flat, 0) != solid_of(field, 0)) & (np.abs(rough) > 1)
    assert changed.sum() < most * solid_of(field, 0).sum()


def torn_door():
    """A closed door without a corner, its back eaten away, with teeth beyond its box."""
    rough, box, joint, even = opened(0)
    rough = np.maximum(rough, -block((0, 36, 36), (64, 64, 64)))
    rough = np.maximum(rough, -block((43.1, 20, 18), (64, 40, 30)))
    teeth = block((40.3, 20.3, 52.2), (44.3, 26.3, 57.2))
    return np.minimum(rough, teeth), box, joint, even


def test_a_closed_door_that_is_most_of_a_plate_is_all_of_it():
    rough, box, joint, even = torn_door()
    assert ((rough < 0) != (even < 0)).sum() > 0.2 * (even < 0).sum()
    flat = with_flat_faces(field_of(rough), box[None], [joint])
    assert share_that_differs(flat, 0, even, 1.0) < 0.02
    assert surface_has_sources(flat)


def test_a_closed_door_keeps_its_handle_and_takes_nothing_from_others():
    rough, box, joint, even = torn_door()
    handle = block((37.3, 44.3, 20.3), (41.3, 47.3, 30.3))
    box = box_of((37.3, 14.3, 12.2), (44.3, 50.3, 52.2))
    post = block((38.3, 40.3, 40.3), (48.3, 46.3, 48.3))  # where the torn corner was
    field = field_of(np.minimum(rough, handle), post)
    flat = with_flat_faces(field, np.stack([box, box]), [joint, Joint.fixed()])
    assert solid_of(flat, 0)[handle < -0.6].all()
    assert (solid_of(flat, 1) >= solid_of(field, 1)).all()
    assert share_that_differs(flat, 0, np.minimum(even, handle), 1.0) > 0.01  # the post's place
    new = solid_of(flat, 0) & ~solid_of(field, 0)  # a cell stays between
    assert new.any() and not (new & ndimage.binary_dilation(solid_of(field, 1))).any()


def test_the_edges_of_a_closed_door_do_not_reach_to_its_handle():
    _, _, joint, _ = torn_door()
    even = block((40.3, 14.3, 12.2), (48.3, 50.3, 52.2))
    rough = np.maximum(even, -block((0, 36, 36), (64, 64, 64)))
    handle = block((36.3, 30.3, 20.3), (41.3, 34.3, 34.3))
    box = box_of((36.3, 14.3, 12.2), (48.3, 50.3, 52.2))
    flat = with_flat_faces(field_of(np.minimum(rough, handle)), box[None], [joint])
    ahead = solid_of(flat, 0) & (AT[0] < 39)
    assert ahead.any() and (handle[ahead] < 0.6).all()
    assert share_that_differs(flat, 0, np.minimum(even, handle), 1.0) < 0.02


def test_what_of_the_body_is_in_a_closed_doors_plate_is_the_doors():
    rough, box, joint, even = torn_door()
    case = np.maximum(block((45, 8.3, 8.3), (60.3, 56.3, 56.3)), -block((44, 12, 12), (56, 52, 52)))
    teeth = (even < -0.6) & (AT[2] % 9 < 3) & (AT[1] < 24) & (AT[1] > 16)
    # joined to the case
    bridge = block((41.0, 8.3, 12.3), (48.0, 18.0, 52.3))
    body = np.where(teeth | ((bridge < 0) & (AT[2] % 9 < 3)), -1.0, case)
    field = field_of(np.where(teeth, -1.0, body), np.where(teeth, 2.0, rough))
    assert (solid_of(field, 0) & teeth).sum() > 100
    boxes = np.stack([box_of((45, 8.3, 8.3), (60.3, 56.3, 56.3)), box])
    apart = with_flat_faces(field, boxes, [Joint.fixed(), joint], (-1, 0))
    assert (solid_of(apart, 0) & teeth).sum() > 100  # who does not move is not said
    flat = with_flat_faces(field, boxes, [Joint.fixed(), joint], (-1, 0), (0,))
    assert not solid_of(flat, 0)[teeth].any()
    assert solid_of(flat, 1)[teeth & (AT[1] > 19)].mean() > 0.95
    # but not a whole plate
    wall = field_of(np.minimum(case, even), np.where(AT[2] > 30, 2.0, rough))
    kept = with_flat_faces(wall, boxes, [Joint.fixed(), joint], (-1, 0), (0,))
    assert solid_of(kept, 0)[(even < -0.6) & (AT[2] > 34)].mean() > 0.9


def test_two_closed_doors_that_share_a_strip_both_end_before_it():
    first, box, joint, _ = opened(0)
    (x, _, z), (x1, y1, z1) = CLOSED
    other = ((x, y1 - 6, z), (x1, y1 + 10, z1))
    hinge = Joint(place_of((x, y1 + 10, 30)), (0, 0, 1), angle=(-np.pi / 2, 0))
    case = block((x1 + 1, 2.3, 8.3), (62.3, 63.3, 58.3))
    field = field_of(case, first, block(*other))
    boxes = np.stack([box_of((x1 + 1, 2.3, 8.3), (62.3, 63.3, 58.3)), box, box_of(*other)])
    flat = with_flat_faces(field, boxes, [Joint.fixed(), joint, hinge], (-1, 0, 0), (0,))
    ends = [np.argwhere(solid_of(flat, k))[:, 1] for k in (1, 2)]
    assert 1 <= ends[1].min() - ends[0].max() <= 4
    assert ends[0].max() == pytest.approx(y1 - 4, abs=1.5)
    assert ends[1].min() == pytest.approx(y1 - 2, abs=1.5)


def test_round_and_half_closed_doors_are_no_plates():
    rough, box, joint, _ = opened(0)
    half = np.maximum(rough, -block((0, 0, 32), (64, 64, 64)))
    disc = np.maximum(np.hypot(AT[1] - 32.3, AT[2] - 32.2) - 18, np.abs(AT[0] - 42.3) - 2)
    for left in (half, disc):
        flat = with_flat_faces(field_of(left), box[None], [joint])
        assert (solid_of(flat, 0) & (left > 1.5)).sum() < 0.02 * (left < 0).sum()


def test_without_joints_nothing_is_turned():
    rough, box, joint, _ = opened(30, torn=True)
    field = field_of(rough)
    whole = solid_of(with_flat_faces(field, box[None], [joint]), 0).sum()
    for joints in ((), [Joint.fixed()]):
        flat = with_flat_faces(field, box[None], joints)
        assert solid_of(flat, 0).sum() < 0.9 * whole


def test_a_turned_part_takes_nothing_from_others_and_others_are_left():
    rough, box, joint, even = opened(30, torn=True)
    post = block((20.3, 40.3, 36.3), (28.3, 46.3, 42.3))  # where the torn corner was
    lump = np.hypot(*(AT[:2] - np.array([54, 54]).reshape(2, 1, 1, 1))) - 5.3
    lump = np.maximum(lump, np.abs(AT[2] - 30.2) - 8)
    post = np.maximum(post, 0.2 - rough)
    field = field_of(post, rough, np.maximum(lump, 0.2 - rough))
    assert ((post < 0) & (even < 0)).sum() > 50
    boxes = np.stack([box_of((1, 1, 1), (2, 2, 2)), box, box_of((1, 1, 1), (2, 2, 2))])
    flat = with_flat_faces(field, boxes, [Joint.fixed(), joint, Joint.fixed()])
    for k in (0, 2):
        np.testing.assert_array_equal(solid_of(flat, k), solid_of(field, k))
    assert solid_of(flat, 1).sum() > 1.1 * solid_of(field, 1).sum()


def test_a_door_comes_back_as_its_joint_says_and_what_carries_as_it_was():
    """It was drawn 6 degrees off."""
    rough, box, _, even = opened(30)
    said = opened(36)
    for parents, wanted, other in (((-1,), said[3], even), ((-1, 0), even, said[3])):
        flat = with_flat_faces(field_of(rough), box[None], [said[2]], parents)
        assert share_that_differs(flat, 0, wanted, 1.0) < 0.02
        assert share_that_differs(flat, 0, other, 1.0) > 0.1


def test_a_door_that_finds_no_room_stays_where_it_was():
    """Another part is where its joint says that it is."""
    rough, box, _, _ = opened(30)
    said = opened(39)
    other = np.maximum(said[3] - 0.3, 0.27 - rough)
    field = field_of(other, rough)
    boxes = np.stack([box_of((1, 1, 1), (2, 2, 2)), box])
    flat = with_flat_faces(field, boxes, [Joint.fixed(), said[2]])
    np.testing.assert_array_equal(solid_of(flat, 0), solid_of(field, 0))
    assert solid_of(flat, 1).sum() > 0.8 * solid_of(field, 1).sum()


def test_crumbs_and_rows_elsewhere_are_borne():
    """What vanishes as it is turned, or lies nowhere near what its row says, stays as it was."""
    sdf, owner = np.full((N + 2,) * 3, 3.0, np.float32), np.full((N + 2,) * 3, -1, np.int16)
    for cell in ((30, 30, 30), (33, 32, 30), (36, 34, 40)):
        sdf[cell], owner[cell] = -1e-4, 0
    crumbs = DenseField(sdf, owner, np.full(sdf.shape, -1, np.int32))
    hinge = Joint(place_of((27, 28, 30)), (0, 0, 1), angle=(-0.5, 1.0))
    box = box_of((29.5, 29.5, 29.5), (36.5, 34.5, 40.5))
    np.testing.assert_array_equal(with_flat_faces(crumbs, box[None], [hinge]).sdf, crumbs.sdf)
    rough, box, joint, _ = opened(30)
    field = field_of(rough)
    away = box[:3] - joint.origin
    far = Joint(joint.origin - 4 * away * [1, 1, 0], joint.direction, angle=joint.angle)
    above = box + [0, 0, 1.5, 0, 0, 0]
    for row, hinge in ((box, far), (above, joint)):
        flat = with_flat_faces(field, row[None], [hinge])
        assert solid_of(flat, 0).sum() > 0.5 * solid_of(field, 0).sum()
    nothing = field_of(np.full(sdf.shape, 3.0))
    assert_same(with_flat_faces(nothing, box[None], [joint]), nothing)


def test_a_door_that_opens_beyond_the_grid_ends_at_its_border():
    hinge, closed = (20.4, 14.2, 30.0), ((18.3, 14.3, 12.2), (22.3, 50.3, 52.2))
    rough, box, joint, _ = opened(60, closed, hinge, wavy=True)
    field = field_of(np.maximum(rough, 0.6 - np.min(AT, 0)))
    flat = with_flat_faces(field, box[None], [joint])
    for k in range(3):
        assert (np.moveaxis(flat.sdf, k, 0)[[0, -1]] > 0).all()
    assert solid_of(flat, 0).sum() > 0.5 * solid_of(field, 0).sum()

"""Plates that are shown turned are told from others, turned straight, completed, turned back."""

import numpy as np
import pytest
from fields import AT, N, block, box_of, field_of, moved, place_of

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.cleanup.align_open_parts import panel, resampled, turn_of

HINGE = (42.4, 14.2, 30.0)
LOWER, UPPER = (40.3, 14.3, 12.2), (44.3, 50.3, 52.2)  # closed, along y, hinged at its low end


def door(degrees, lower=LOWER, upper=UPPER, shift=0, direction=(0, 0, 1), hinge=HINGE):
    """A block that stands open by an angle about its hinge: distance, box of its row, joint, which
    goes on until it is open by a right angle.

    ``shift``: its axes are shifted by so many, so that the hinge stands along another.
    """
    roll = lambda values: np.roll(values, shift)  # noqa: E731
    lower, upper, hinge, direction = (roll(np.array(v)) for v in (lower, upper, hinge, direction))
    ends = np.deg2rad([-degrees, np.copysign(90, degrees) - degrees])
    joint = Joint(place_of(hinge), direction, angle=tuple(sorted(ends)))
    opened = joint.motion(np.deg2rad(degrees))
    distance = block(lower, upper, moved(np.linalg.inv(opened)))
    solid = np.argwhere(distance < 0)
    return distance, box_of(solid.min(0) - 0.5, solid.max(0) + 0.5), joint


def turn(distance, box, joint, corrected=True):
    return turn_of(np.argwhere(distance < 0), box, joint, N, corrected)


def after(matrix, cells):
    return cells @ matrix[:3, :3].T + matrix[:3, 3]


def straight_field(distance, found):
    field = field_of(distance)
    return resampled(field.sdf, field.source, np.zeros(3, int), found.straight)


@pytest.mark.parametrize("degrees", [10, 30, 44, 60, 80])
@pytest.mark.parametrize("shift", range(3))
def test_a_plate_is_turned_straight_about_its_hinge(degrees, shift):
    distance, box, joint = door(degrees, shift=shift)
    found = turn(distance, box, joint)
    axis, closed = (2 + shift) % 3, (1 + shift) % 3
    assert found.axis == axis and found.opened
    # it is turned by less than half a quarter, so that it lies along either axis
    assert found.along == (closed if degrees < 45 else shift)
    there = after(found.straight, np.argwhere(distance < 0))
    sides = np.ptp(there, axis=0)
    assert sides[3 - axis - found.along] < 5 and sides[found.along] > 34
    pivot = np.roll(HINGE, shift)
    for matrix in (found.straight, found.back):
        np.testing.assert_allclose(after(matrix, pivot), pivot, atol=1e-9)
        np.testing.assert_allclose(matrix[axis], np.eye(4)[axis], atol=1e-9)
        np.testing.assert_allclose(np.linalg.det(matrix), 1)
    np.testing.assert_allclose(found.back @ found.straight, np.eye(4), atol=0.5 * np.pi / 180 * N)


@pytest.mark.parametrize("degrees", [10, 30, 44, 70, -30])
def test_a_turn_says_where_hinge_and_far_edge_lie_then(degrees):
    """As the row's box and the hinge say; with the hinge at either end of the plate."""
    hinge = HINGE if degrees > 0 else (42.4, 50.4, 30)
    found = turn(*door(degrees, hinge=hinge))
    place = hinge[found.along]
    side = -1 if degrees < 0 or found.along == 0 else 1
    near, far = found.ends if side > 0 else found.ends[::-1]
    assert near == pytest.approx(place, abs=0.7)
    assert far == pytest.approx(place + 36 * side, abs=0.7)
    assert found.span == pytest.approx((LOWER[2], UPPER[2]), abs=0.6)


def test_a_joint_told_the_other_way_round_is_the_same_turn():
    distance, box, joint = door(30)
    first = turn(distance, box, joint)
    lo, hi = joint.limits
    second = turn(distance, box, Joint(joint.origin, -joint.direction, angle=(-hi, -lo)))
    np.testing.assert_allclose(second.straight, first.straight, atol=1e-9)
    np.testing.assert_allclose(second.back, first.back, atol=1e-9)
    assert second.along == first.along
    assert second.ends == pytest.approx(first.ends)


def test_either_end_of_the_range_may_be_the_straight_one():
    distance, box, joint = door(30)
    first = turn(distance, box, joint)
    for ends in ((-30, 30), (-50, 60)):
        one = Joint(joint.origin, joint.direction, angle=tuple(np.deg2rad(ends)))
        np.testing.assert_allclose(turn(distance, box, one).back, first.back, atol=1e-9)


@pytest.mark.parametrize("off", [-6, 6])
def test_what_moves_comes_back_as_its_joint_says_and_what_carries_as_it_is_drawn(off):
    """A door drawn some degrees beside what its joint says."""
    distance, box, joint = door(30)
    said = np.deg2rad(30 + off)
    other = Joint(joint.origin, joint.direction, angle=(-said, np.pi / 2 - said))
    corrected, carrier = (turn(distance, box, other, c) for c in (True, False))
    angle = lambda matrix: np.arctan2(matrix[1, 0], matrix[0, 0])  # noqa: E731
    for found in (corrected, carrier):
        assert angle(found.straight) == pytest.approx(-np.deg2rad(30), abs=0.01)
    assert angle(corrected.back) == pytest.approx(said)
    assert angle(carrier.back) == pytest.approx(np.deg2rad(30), abs=0.01)


def test_voxels_that_disagree_with_the_joint_are_not_believed():
    """Its box says that it is open by about as much as the joint does."""
    distance, box, joint = door(30)
    far = Joint(joint.origin, joint.direction, angle=(-np.deg2rad(44), 0))
    found = turn(distance, box, far)
    angle = np.arctan2(found.straight[1, 0], found.straight[0, 0])
    assert angle == pytest.approx(-np.deg2rad(44))
    np.testing.assert_allclose(found.back @ found.straight, np.eye(4), atol=1e-9)


def test_what_lies_straight_is_not_turned():
    for degrees in (0, 1, 90):
        still = turn(*door(degrees))
        assert still.still and not still.opened
        np.testing.assert_array_equal(still.straight, np.eye(4))
        np.testing.assert_array_equal(still.back, np.eye(4))
    assert turn(*door(4)) is not None and not turn(*door(4)).opened
    # drawn aslant, straight by its joint
    distance, box, joint = door(6)
    closed = Joint(joint.origin, joint.direction, angle=(0, 2.0))
    assert turn(distance, box, closed).back == pytest.approx(np.eye(4))


def test_only_hinges_along_the_lattice_turn():
    distance, box, joint = door(30)
    at, up = joint.origin, np.array([0, 0, 1.0])
    for other in (
        Joint.fixed(),
        Joint(at, (1, 0, 0), travel=(-0.2, 0.3)),
        Joint(at, up, angle=(-0.5, 1.0), travel=(-0.05, 0.1)),
        Joint(at, up, angle=(-np.pi, np.pi)),
        Joint(at, (0, 0.5, 1), angle=(-0.5, 1.0)),
    ):
        assert turn(distance, box, other) is None
    few = np.argwhere(distance < 0)
    for count in range(3):
        assert turn_of(few[:count], box, joint, N, True) is None


def test_a_chunky_part_that_lies_aslant_of_its_hinge_is_left():
    """No direction can be told of it, and its middle lies diagonally across from the hinge."""
    lump = (12.4, 14.3, 20.2), (42.4, 44.3, 40.2)
    assert turn(*door(20, *lump)) is None
    # with its middle straight ahead of the hinge, its joint is believed
    ahead = (30.4, 14.3, 20.2), (54.4, 38.3, 40.2)
    found = turn(*door(20, *ahead))
    assert np.arctan2(found.straight[1, 0], found.straight[0, 0]) == pytest.approx(-np.deg2rad(20))
    # and is so though its cells seem to say otherwise
    distance, box, joint = door(20, ahead[0], (54.4, 46.3, 40.2))
    other = Joint(joint.origin, joint.direction, angle=tuple(np.deg2rad([-26, 64])))
    found = turn(distance, box, other)
    assert np.arctan2(found.straight[1, 0], found.straight[0, 0]) == pytest.approx(-np.deg2rad(26))


def test_resampling_there_and_back_keeps_the_part():
    distance, box, joint = door(30)
    found, field = turn(distance, box, joint), field_of(distance)
    phi, source, low = straight_field(distance, found)
    assert phi.dtype == np.float32 and source.shape == phi.shape
    assert (phi < 0).sum() == pytest.approx((distance < 0).sum(), rel=0.03)
    # it lies where the closed door does
    place = np.indices(phi.shape) + low.reshape(3, 1, 1, 1)
    wanted = block(LOWER, UPPER, place)
    assert ((phi < 0) == (wanted < 0))[np.abs(wanted) > 0.6].all()
    back, _, first = resampled(phi, source, low, np.linalg.inv(found.straight))
    there = tuple(slice(a, a + n) for a, n in zip(first, back.shape, strict=True))
    differ = (back < 0) != (distance < 0)[there]
    assert np.abs(distance[there][differ]).max() < 1 and differ.sum() < 0.08 * (distance < 0).sum()
    # around it is nothing
    for k in range(3):
        edge = np.moveaxis(phi, k, 0)
        assert (edge[[0, 1, 2, -3, -2, -1]] > 0).all()
    # what is seen of its source is that of the places that came here
    some = np.argwhere((phi < -0.2) & (source >= 0))[::50]
    came = after(np.linalg.inv(found.straight), some + low)
    given = np.array(np.unravel_index(source[tuple(some.T)], field.sdf.shape)).T
    assert np.abs(given - came).max() < 0.51


def test_resampling_without_a_motion_changes_nothing():
    distance, *_ = door(30)
    field = field_of(distance)
    phi, source, low = resampled(field.sdf, field.source, np.zeros(3, int), np.eye(4), room=2)
    window = tuple(slice(a, a + n) for a, n in zip(low, phi.shape, strict=True))
    np.testing.assert_array_equal(phi, field.sdf[window])
    near = phi < 1
    np.testing.assert_array_equal(source[near], field.source[window][near])
    assert (source[~near] == -1).all()
    solid = np.argwhere(distance < 0)
    np.testing.assert_array_equal(low, solid.min(0) - 2)
    np.testing.assert_array_equal(phi.shape, np.ptp(solid, axis=0) + 5)


def completed(distance, lower=LOWER, upper=UPPER, outside=0):
    """A straight part [N + 2]^3 after ``panel``, its row the block between two corners."""
    found = turn(*door(30))
    wide = dict(ends=(float(lower[1]), float(upper[1])), span=(lower[2], upper[2]))
    found = type(found)(**{**vars(found), **wide, "outside": outside})
    sdf = field_of(distance).sdf
    return panel(sdf, np.zeros(3, int), found, N), sdf


def test_a_plate_with_a_quarter_torn_out_is_completed():
    whole = block(LOWER, UPPER)
    torn = np.maximum(whole, -block((0, 32, 32), (64, 60, 60)))
    filled, before = completed(torn)
    assert (before < 0).sum() < 0.8 * (whole < 0).sum()
    assert (filled < 0).sum() == pytest.approx((whole < 0).sum(), rel=0.02)
    differ = (filled < 0) != (whole < 0)
    assert (np.abs(whole[differ]) < 0.6).all()
    assert np.abs(filled).min() >= 1e-4 and np.abs(filled).max() <= 1


def test_what_is_no_panel_and_no_handle_is_cut_off():
    handle = block((30.3, 44.3, 28.3), (41, 47.3, 36.3))
    flag = block((40.3, 50, 12.2), (44.3, 58.3, 20.2))  # beyond its far edge
    above = block((40.3, 20.3, 52), (44.3, 30.3, 58.3))
    filled, _ = completed(np.min([block(LOWER, UPPER), handle, flag, above], 0))
    assert not (filled < 0)[AT[1] > 51].any() and not (filled < 0)[AT[2] > 53].any()
    stands = (filled < 0) & (AT[0] < 40)
    assert (handle[stands] < 0).all() and 33 <= AT[0][stands].min() <= 34  # .12 of 64 ahead of it
    assert (filled[(handle < 0) & (AT[0] > 38)] < 0).all()
    # a handle that is not too long is whole
    short = block((38.3, 44.3, 28.3), (41, 47.3, 36.3))
    filled, before = completed(np.minimum(block(LOWER, UPPER), short))
    differ = (filled < 0) != (before < 0)
    assert (np.abs(block(LOWER, UPPER)[differ]) < 0.6).all()
    assert (filled[(short < 0) & (AT[0] < 40)] < 0).all()


def test_only_a_panels_outside_has_a_handle_and_none_as_large_as_its_face():
    handle = block((34.3, 44.3, 28.3), (41, 47.3, 36.3))
    behind = block((44, 20.3, 20.3), (48.3, 24.3, 30.3))
    hump = block((37.3, 18.3, 16.3), (41, 40.3, 48.3))
    both = np.min([block(LOWER, UPPER), handle, behind], 0)
    filled, _ = completed(both, outside=-1)
    assert (filled[(handle < 0) & (AT[0] < 40)] < 0).all() and not (filled < 0)[AT[0] > 45].any()
    filled, _ = completed(both, outside=1)
    assert (filled[(behind < 0) & (AT[0] > 45)] < 0).all() and not (filled < 0)[AT[0] < 39].any()
    filled, _ = completed(np.minimum(block(LOWER, UPPER), hump), outside=-1)
    assert not (filled < 0)[AT[0] < 39].any()


def test_what_stands_out_at_a_panels_rim_or_is_small_is_no_handle():
    plate = block(LOWER, UPPER)
    ahead = block((35.3, 14.3, 12.2), (41, 50.3, 52.2))
    ring = np.maximum(ahead, -block((30, 16.3, 14.2), (45, 48.3, 50.2)))
    strip = block((36.3, 47.8, 16.2), (41, 50.3, 48.2))  # along an edge
    crumb = block((37.6, 30.3, 30.3), (41, 34.3, 34.3))
    for noise in (ring, strip, crumb):
        filled, _ = completed(np.minimum(plate, noise), outside=-1)
        assert ((noise < 0) & (AT[0] < 39)).any() and not (filled < 0)[AT[0] < 39].any()
    bar = block((37.6, 44.3, 20.3), (41, 46.3, 36.3))  # as low as the crumb, but long
    far = block((33.3, 40.3, 30.3), (35.3, 42.3, 34.3))
    posts = block((34.3, 40.3, 30.3), (41, 42.3, 31.3))
    for handle in (bar, np.minimum(far, posts)):
        filled, _ = completed(np.minimum(plate, handle), outside=-1)
        assert (filled[(handle < 0) & (AT[0] < 39)] < 0).all()


def test_a_panel_is_neither_too_thin_nor_too_thick():
    for thick, wanted in ((1.2, 3), (5, 5), (12, 12), (13, 12)):
        upper = (LOWER[0] + thick, *UPPER[1:])
        filled, _ = completed(block(LOWER, upper), LOWER, upper)
        count = (filled < 0).sum(0)[30, 30]
        assert abs(count - max(wanted, thick)) <= 1, thick
        assert (filled < 0)[:, 20:45, 20:45].any(0).all()


def test_what_is_no_plate_is_left_as_it_is():
    lump = (30.3, 14.3, 12.2), (50.3, 30.3, 52.2)  # thicker than a third of its width
    strip = (40.3, 14.3, 12.2), (43.3, 50.3, 16.2)  # too low
    narrow = (40.3, 14.3, 12.2), (42.3, 18.3, 52.2)
    for lower, upper in (lump, strip, narrow):
        hole = -block((0, 16, 13), (64, 26, 14.3))
        filled, before = completed(np.maximum(block(lower, upper), hole), lower, upper)
        np.testing.assert_array_equal(filled, before)


def test_the_helper_of_these_tests_opens_doors_outwards():
    distance, box, joint = door(30)
    assert joint.limits[0] == pytest.approx(-np.pi / 6)
    assert 22 < AT[0][distance < 0].min() < 24
    assert (distance < 0).sum() == pytest.approx(4 * 36 * 40, rel=0.05)
    np.testing.assert_allclose(box[3:], [22 / N, 34 / N, 40 / N], atol=0.04)


def test_a_part_that_does_not_turn_is_copied_as_it_would_be_interpolated():
    rng = np.random.default_rng(0)
    phi = rng.uniform(-1, 1, (7, 6, 5)).astype(np.float32)
    source = rng.integers(-1, 50, phi.shape).astype(np.int32)
    phi[:2], source[:2] = 1, -1  # the new window begins within the old one
    phi[3, 3, 3] = 0  # becomes just inside
    phi[4, 2, 2] = 1  # outside: has no source
    moved = np.eye(4)
    moved[:3, 3] = 3, -2, 1  # whole cells: interpolated, to the same values
    for room in (1, 4):
        still = resampled(phi, source, np.array([5, 6, 7]), np.eye(4), room)
        other = resampled(phi, source, np.array([5, 6, 7]), moved, room)
        np.testing.assert_allclose(still[0], other[0], atol=1e-6)
        np.testing.assert_array_equal(still[1], other[1])
        np.testing.assert_array_equal(still[2] + [3, -2, 1], other[2])

"""Nearly flat faces become flat, round things stay round, and no part takes from another."""

import numpy as np
import pytest
from fields import (
    AT,
    N,
    block,
    box_of,
    field_of,
    solid_of,
    surface_has_sources,
)
from scipy import ndimage

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.cleanup import flat_faces
from uniart_jax.voxels.cleanup.column_maps import heights
from uniart_jax.voxels.cleanup.flat_faces import with_flat_faces
from uniart_jax.voxels.isosurface import part_mesh

LOWER, UPPER = (20.3, 8.2, 8.2), (30.3, 56.4, 56.4)
RIPPLES = np.sin(AT[2] * (2 * np.pi / 12)) + 0.4 * np.sin(AT[1] * 1.7)


@pytest.fixture(scope="module")
def door():
    """A plate whose front has ripples and whose upper edge has teeth of a voxel."""
    teeth = np.where(AT[1] // 4 % 3 == 0, 4.0, 0.0)
    front = LOWER[0] + 1.2 * RIPPLES
    return field_of(block((front, *LOWER[1:]), (*UPPER[:2], UPPER[2] - teeth)))


def test_ripples_and_teeth_go(door):
    before = heights(door.sdf, door.sdf < 0)[1][12:50, 12:48]
    flat = with_flat_faces(door, box_of(LOWER, UPPER)[None])
    after = heights(flat.sdf, flat.sdf < 0)[1][12:50, 12:48]
    assert np.ptp(before) > 2 and np.ptp(after) < 1e-3
    assert abs(after.mean() - LOWER[0]) < 0.5
    edge = heights(*(np.moveaxis(x, 2, 0)[::-1] for x in (flat.sdf, flat.sdf < 0)))[1][22:29, 12:50]
    assert np.ptp(edge) < 1e-3
    # the back was flat and stays where it was
    back = N + 1 - heights(flat.sdf[::-1], flat.sdf[::-1] < 0)[1][12:50, 12:48]
    np.testing.assert_allclose(back, UPPER[0], atol=1e-3)
    window = tuple(slice(s.min(), s.max() + 1) for s in np.nonzero(flat.sdf < 0))
    mesh = part_mesh(flat, 0, window, np.zeros((flat.sdf.size, 3), np.uint8))
    assert mesh.is_watertight


def test_a_wall_in_two_depths_becomes_one():
    front = np.where(AT[1] < 37, 20.3, 21.7)  # .58 of the columns, and the others
    wall = field_of(block((front, *LOWER[1:]), UPPER))
    box = box_of((10.3, *LOWER[1:]), UPPER)  # the wall is not at its face
    flat = with_flat_faces(wall, box[None])
    before, after = (heights(f.sdf, f.sdf < 0)[1][14:51, 14:51] for f in (wall, flat))
    assert np.ptp(before) > 1 and np.ptp(after) < 1e-3
    assert abs(after.mean() - 20.3) < 0.1  # where most of it was


@pytest.mark.parametrize("rise", [3, 4])
def test_a_tilted_face_stays_tilted(rise):
    front = 20.3 + rise * (AT[1] - 8.2) / 48
    face = field_of(block((front, *LOWER[1:]), (40.3, *UPPER[1:])))
    flat = with_flat_faces(face, box_of((10.3, *LOWER[1:]), (40.3, *UPPER[1:]))[None])
    before, after = (heights(f.sdf, f.sdf < 0)[1][14:51, 14:51] for f in (face, flat))
    assert np.abs(after - before).max() < 0.1


def test_small_holes_are_closed_and_large_ones_stay():
    hole = lambda y, z, side: np.maximum(np.abs(AT[1] - y), np.abs(AT[2] - z)) - side / 2  # noqa: E731
    plate = block(LOWER, UPPER)
    for side, closed in ((3, True), (14, False)):
        field = field_of(np.maximum(plate, -hole(30.2, 30.2, side)))
        assert field.sdf[25, 30, 30] > 0
        flat = with_flat_faces(field, box_of(LOWER, UPPER)[None])
        assert (flat.sdf[:, 30, 30] < 0).any() == closed
        filled = (flat.sdf < 0) & (field.sdf > 0)
        assert (flat.source[filled] >= 0).all() and (flat.owner[filled] == 0).all()


def test_handles_and_knobs_stay():
    """On a drawer 40 deep, of which a tenth is more than they stand out; on planes as on the
    box."""
    handle = block((17.3, 24, 30), (21.3, 40, 33))
    knob = block((17.8, 14, 14), (21.3, 20, 20))
    drawer = np.min([block((20.3, 8.2, 8.2), (60.3, 56.4, 56.4)), handle, knob], 0)
    field = field_of(drawer)
    flat = with_flat_faces(field, box_of((17.3, 8.2, 8.2), (60.3, 56.4, 56.4))[None])
    standing = (field.sdf < 0) & (AT[0] < 20)
    assert standing.sum() > 150
    np.testing.assert_array_equal(flat.sdf[standing] < 0, True)
    assert ((flat.sdf < 0) & (AT[0] < 20)).sum() == standing.sum()


def test_thin_wavy_panels_stay_closed():
    for thickness, amplitude in ((1.2, 1.5), (2.2, 2.0)):
        front = 30.3 + amplitude * np.sin(AT[2] * (2 * np.pi / 12))
        panel = field_of(block((front, 8.2, 8.2), (front + thickness, 56.4, 56.4)))
        box = box_of((30.3 - amplitude, 8.2, 8.2), (30.3 + amplitude + thickness, 56.4, 56.4))
        flat = with_flat_faces(panel, box[None])
        assert (flat.sdf < 0).any(0)[14:51, 14:51].all()


def test_what_goes_on_beyond_the_box_is_not_cut_in_two():
    front = np.where(AT[1] < 30, 10.3, 22.3)
    field = field_of(block((front, 8.2, 8.2), (50.3, 56.4, 56.4)))
    for begin in (19.3, 22.3):
        flat = with_flat_faces(field, box_of((begin, 8.2, 8.2), (50.3, 56.4, 56.4))[None])
        assert ndimage.label(flat.sdf < 0)[1] == 1


def test_round_things_stay_round():
    centre, radius = 32.3, 22.0
    disc = np.maximum(
        np.hypot(AT[1] - centre, AT[2] - centre) - radius, np.abs(AT[0] - centre) - 4.2
    )
    field = field_of(disc)
    box = box_of((centre - 4.2, *[centre - radius] * 2), (centre + 4.2, *[centre + radius] * 2))
    flat = with_flat_faces(field, box[None])
    changed = (flat.sdf < 0) != (field.sdf < 0)
    assert (
        changed.sum() < 0.03 * (field.sdf < 0).sum() and np.abs(disc[changed]).max(initial=0) < 1.5
    )
    ball = field_of(np.linalg.norm(AT - centre, axis=0) - 12)
    box = box_of([centre - 12] * 3, [centre + 12] * 3)
    round_still = with_flat_faces(ball, box[None])
    changed = ((round_still.sdf < 0) != (ball.sdf < 0)).sum() / (ball.sdf < 0).sum()
    assert changed < 0.01


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_cylinder_gets_no_flat_sides(axis):
    """Its side is nearly as deep everywhere about the line that is nearest."""
    centre, radius = 32.3, 21.0
    across = [k for k in range(3) if k != axis]
    side = np.hypot(*(AT[k] - centre for k in across)) - radius
    field = field_of(np.maximum(side, np.abs(AT[axis] - centre) - 24.2))
    ends = np.full(3, radius)
    ends[axis] = 24.2
    flat = with_flat_faces(field, box_of(centre - ends, centre + ends)[None])
    changed = (flat.sdf < 0) != (field.sdf < 0)
    assert changed.sum() < 0.005 * (field.sdf < 0).sum()


def test_a_ball_on_a_block_stays_round_and_the_block_becomes_flat():
    """One part: the side of the ball that is nearest ends where the block's wavy side does."""
    ball = np.linalg.norm(AT - np.array([20.3, 32.3, 44.3])[:, None, None, None], axis=0) - 12
    rippled = block((8.3 + 1.2 * np.sin(AT[2] * 0.9), 12.3, 8.3), (52.3, 52.3, 32.3))
    field = field_of(np.minimum(ball, rippled))
    flat = with_flat_faces(field, box_of((8.3, 12.3, 8.3), (52.3, 52.3, 56.3))[None])
    upper = AT[2] > 36
    changed = ((flat.sdf < 0) != (field.sdf < 0)) & upper
    assert changed.sum() < 0.01 * ((field.sdf < 0) & upper).sum()
    front = heights(flat.sdf, flat.sdf < 0)[1][16:48, 12:28]
    assert np.ptp(front) < 1e-3


def test_no_part_takes_from_another(door):
    other = block((LOWER[0] - 3, 8, 8), (LOWER[0] + 0.2, 20, 20))
    front = LOWER[0] + 1.2 * RIPPLES
    field = field_of(other, block((front, *LOWER[1:]), UPPER))
    boxes = np.stack([box_of((LOWER[0] - 3, 8, 8), (LOWER[0] + 0.2, 20, 20)), box_of(LOWER, UPPER)])
    flat = with_flat_faces(field, boxes)
    for k in (0, 1):
        others = (field.sdf < 0) & (field.owner == 1 - k)
        assert not (flat.owner[others] == k).any()
    assert (flat.sdf[field.sdf > 2.9] > 0).mean() > 0.99


def test_a_part_that_would_nearly_vanish_is_left_as_it_was(door, monkeypatch):
    def erase(views, part, face=None):
        views[0][:] = 3

    monkeypatch.setattr(flat_faces, "_flatten", erase)
    monkeypatch.setattr(flat_faces, "_straighten", lambda *_: None)
    kept = with_flat_faces(door, box_of(LOWER, UPPER)[None])
    np.testing.assert_array_equal(kept.sdf, door.sdf)
    np.testing.assert_array_equal(kept.owner, door.owner)


def test_the_layer_around_the_grid_stays_outside(monkeypatch):
    """Or meshes would be open there: whatever plane a pass believes in."""

    def to_the_end(views, part, face=None):
        solid = (views[0] < 0) & (views[1] == part)
        flat_faces._end_at(views, part, solid.any(0), 0.0)

    monkeypatch.setattr(flat_faces, "_flatten", to_the_end)
    field = field_of(block((4.3,) * 3, (60.4,) * 3))
    flat = with_flat_faces(field, box_of((0.5,) * 3, (64.5,) * 3)[None])
    for k in range(3):
        assert (np.moveaxis(flat.sdf, k, 0)[[0, -1]] > 0).all()


def test_a_part_elsewhere_than_its_box_is_left_alone(door):
    nowhere = box_of((50, 50, 50), (60, 60, 60))
    np.testing.assert_array_equal(with_flat_faces(door, nowhere[None]).sdf < 0, door.sdf < 0)


@pytest.mark.parametrize(("wide", "closed"), [(8, True), (14, False)])
def test_gaps_between_teeth_are_filled_where_they_are_narrow(wide, closed):
    """A wall whose edge lacks cells, 12 deep."""
    whole = block((10.3, 30.3, 4.3), (60.3, 33.3, 60.3))
    gap = block((0, 20, 30.3), (22.3, 64, 30.3 + wide))
    row = box_of((10.3, 10.3, 4.3), (60.3, 54.3, 60.3))
    flat = with_flat_faces(field_of(np.maximum(whole, -gap)), row[None])
    missing = (whole < -0.6) & (gap < -0.6)
    assert (
        solid_of(flat, 0)[missing].mean() > 0.9 if closed else not solid_of(flat, 0)[missing].any()
    )


SLIDES = Joint(np.zeros(3), (-1, 0, 0), travel=(0, 0.3))
FRONT = (20.3, 4.3, 4.3), (24.3, 60.3, 60.3)
SMALL_FRONT = (20.3, 10.3, 20.3), (24.3, 46.3, 38.3)


@pytest.mark.parametrize(("front", "corner"), [(FRONT, (42, 42)), (SMALL_FRONT, (34, 31))])
def test_a_moving_part_whose_face_is_most_of_a_rectangle_is_all_of_it(front, corner):
    """A corner of a third of its sides is torn out of a drawer's front; a skin fills it."""
    torn = np.maximum(block(*front), -block((0, *corner), (64, 64, 64)))
    flat = with_flat_faces(field_of(torn), box_of(*front)[None], [SLIDES])
    missing = (block(*front) < -0.6) & (torn > 0)
    assert missing.sum() > 150 and solid_of(flat, 0)[missing].mean() > 0.6
    assert surface_has_sources(flat)
    still = with_flat_faces(field_of(torn), box_of(*front)[None], [Joint.fixed()])
    assert not solid_of(still, 0)[missing].any()


def test_round_faces_and_less_than_most_of_one_are_left():
    disc = np.maximum(np.hypot(AT[1] - 32.3, AT[2] - 32.3) - 28, np.abs(AT[0] - 22.3) - 2)
    half = np.maximum(block(*FRONT), -block((0, 4, 32), (64, 64, 64)))
    for left in (disc, half):
        flat = with_flat_faces(field_of(left), box_of(*FRONT)[None], [SLIDES])
        assert (solid_of(flat, 0) & (left > 1.5)).sum() < 0.02 * (left < 0).sum()

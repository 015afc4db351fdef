"""Parts that are round get the outlines that the layout has."""

import dataclasses

import numpy as np
import pytest
from fields import AT, N, assert_same, block, box_of, copy_of, field_of, place_of, solid_of

from uniart_jax.voxels.cleanup.solids_of_revolution import WALL, with_revolutions
from uniart_jax.voxels.isosurface import DenseField, part_mesh
from uniart_jax.voxels.revolution_table import Revolution

LOW, HIGH, MIDDLE = 12.3, 44.3, 32.3  # cells
CORNERS = ((MIDDLE - 16, MIDDLE - 16, LOW), (MIDDLE + 16, MIDDLE + 16, HIGH))
BOX = box_of(*CORNERS)
RHO = np.hypot(AT[0] - MIDDLE, AT[1] - MIDDLE)


def revolution(radii=(16.0,), axis=2):
    return Revolution(axis, place_of([MIDDLE, MIDDLE]), np.array(radii) / N)


def turned(field, drawn=None, box=BOX, outline=None, axis=2):
    one = {0: outline or revolution(axis=axis)}
    return with_revolutions(field, box[None], field if drawn is None else drawn, one)


def about(field: DenseField, axis: int) -> DenseField:
    """The same about another axis, which takes z's place."""
    return DenseField(*(np.moveaxis(v, 2, axis) for v in (field.sdf, field.owner, field.source)))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_block_becomes_a_cylinder(axis):
    field = about(field_of(block(*CORNERS)), axis)
    before = copy_of(field)
    box = np.concatenate([np.insert(h[:2], axis, h[2]) for h in (BOX[:3], BOX[3:])])
    after, built = turned(field, box=box, axis=axis)
    assert built == [0]
    assert_same(field, before)
    solid = np.moveaxis(solid_of(after, 0), axis, 2)
    wanted = (RHO < 16) & (AT[2] > LOW) & (AT[2] < HIGH)
    np.testing.assert_array_equal(solid, wanted)
    mesh = part_mesh(after, 0, (slice(1, N + 1),) * 3, np.zeros((N**3, 3), np.uint8))
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(np.pi * 16**2 * (HIGH - LOW) / N**3, rel=0.02)


def test_radii_go_from_the_lower_end_to_the_upper():
    after, _ = turned(field_of(block(*CORNERS)), outline=revolution((10.0, 16.0)))
    layers = solid_of(after, 0).sum((0, 1))
    assert layers[15] == pytest.approx(np.pi * 10**2, rel=0.05)
    assert layers[42] == pytest.approx(np.pi * 16**2, rel=0.05)


def pot(top=HIGH):
    """A square one with torn walls, open at ``top``."""
    corners = (CORNERS[0], (*CORNERS[1][:2], top))
    room = block((MIDDLE - 13, MIDDLE - 13, LOW + 4), (MIDDLE + 13, MIDDLE + 13, HIGH + 9))
    torn = np.random.default_rng(0).random(AT.shape[1:]) < 0.2
    wall = np.maximum(block(*corners), -room)
    return field_of(np.where(torn & (wall > -2) & (AT[2] > LOW + 5), 0.5, wall))


def test_a_pot_stays_hollow_and_open_and_its_wall_is_whole():
    solid = solid_of(turned(pot())[0], 0)
    high = (AT[2] > LOW + 6) & (AT[2] < HIGH)
    assert solid[high & (RHO < 15.9) & (RHO > 16.1 - WALL)].all()
    assert not solid[high & (RHO < 12)].any()
    assert not solid[RHO > 16].any()


def test_what_stands_out_of_it_stays_where_its_box_is_larger():
    spout = block((MIDDLE + 10, MIDDLE - 2, 24.3), (MIDDLE + 28, MIDDLE + 2, 30.3))
    body = block(*CORNERS)
    field = field_of(np.minimum(body, spout))
    wide = box_of(CORNERS[0], (MIDDLE + 28, *CORNERS[1][1:]))
    solid = solid_of(turned(field, box=wide)[0], 0)
    assert solid[(spout < -0.5) & (RHO > 17)].all()
    assert not solid[(spout > 0.5) & (RHO > 17.5)].any()  # not the block's corners
    assert not solid_of(turned(field)[0], 0)[RHO > 16.5].any()


def test_other_parts_stay_as_they_are():
    lid = block((MIDDLE - 16, MIDDLE - 16, HIGH - 4), (MIDDLE + 16, MIDDLE + 16, HIGH + 3))
    field = field_of(block(*CORNERS), lid)
    after, _ = turned(field)
    np.testing.assert_array_equal(solid_of(after, 1), solid_of(field, 1))


def test_its_outside_is_as_drawn_before_other_passes():
    """A spout that another pass took off is there again."""
    spout = block((MIDDLE + 10, MIDDLE - 2, 24.3), (MIDDLE + 28, MIDDLE + 2, 30.3))
    drawn, field = field_of(np.minimum(block(*CORNERS), spout)), field_of(block(*CORNERS))
    wide = box_of(CORNERS[0], (MIDDLE + 28, *CORNERS[1][1:]))
    solid = solid_of(turned(field, drawn, wide)[0], 0)
    assert solid[(spout < -0.5) & (RHO > 17)].all()


def test_a_cup_with_a_thick_wall_keeps_its_room():
    room = block((MIDDLE - 7, MIDDLE - 7, LOW + 16), (MIDDLE + 7, MIDDLE + 7, HIGH + 9))
    field = field_of(np.maximum(block(*CORNERS), -room))
    solid = solid_of(turned(field)[0], 0)
    assert not solid[room < 0].any()
    assert solid[(RHO < 15.9) & (room > 0.5) & (AT[2] > LOW) & (AT[2] < HIGH)].all()


@pytest.mark.parametrize("height", [5, 7, 12])
def test_a_shallow_dish_stays_one(height):
    top = LOW + height
    room = block((MIDDLE - 14, MIDDLE - 14, LOW + 1.6), (MIDDLE + 14, MIDDLE + 14, top + 9))
    corners = (CORNERS[0], (*CORNERS[1][:2], top))
    field = field_of(np.maximum(block(*corners), -room))
    solid = solid_of(turned(field, box=box_of(*corners))[0], 0)
    assert not solid[(RHO < 12) & (AT[2] > LOW + WALL)].any()
    assert solid[(RHO < 15.5) & (AT[2] > LOW) & (AT[2] < LOW + 1.5)].all()


def test_feet_stay():
    """Layers that are nothing like the outline, here as wide as the body above."""
    feet = np.min(
        [
            block((x, y, LOW), (x + 4, y + 4, LOW + 8))
            for x in (MIDDLE - 16, MIDDLE + 12)
            for y in (MIDDLE - 16, MIDDLE + 12)
        ],
        0,
    )
    body = block((*CORNERS[0][:2], LOW + 8), CORNERS[1])
    field = field_of(np.minimum(body, feet))
    found = dataclasses.replace(revolution((9.0, *[16.0] * 3)), estimate=True)
    solid = solid_of(turned(field, outline=found)[0], 0)
    np.testing.assert_array_equal(solid[..., 14:19], solid_of(field, 0)[..., 14:19])
    assert not solid[..., 23:][RHO[..., 23:] > 20].any()


def cylinder(radius):
    """Distances from it and its box."""
    solid = np.maximum(RHO - radius, np.maximum(LOW - AT[2], AT[2] - HIGH))
    lower, upper = (MIDDLE - radius, MIDDLE - radius, LOW), (MIDDLE + radius, MIDDLE + radius, HIGH)
    return solid, box_of(lower, upper)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_large_radii_and_the_middle_of_an_estimate_are_those_of_the_voxels(axis):
    solid, box = cylinder(20)
    near = about(field_of(solid), axis)
    box = np.concatenate([np.insert(h[:2], axis, h[2]) for h in (box[:3], box[3:])])
    center = place_of([MIDDLE + 2, MIDDLE - 1])
    wrong = Revolution(axis, center, np.array([17.0]) / N, estimate=True)
    drawn = solid_of(near, 0)
    as_drawn = solid_of(turned(near, box=box, outline=wrong)[0], 0)
    assert (as_drawn != drawn).sum() < 0.02 * drawn.sum()
    exact = dataclasses.replace(wrong, estimate=False)
    assert solid_of(turned(near, box=box, outline=exact)[0], 0).sum() < 0.85 * drawn.sum()


def test_torn_layers_are_as_wide_as_those_beside_them():
    solid, box = cylinder(20)
    side = (AT[0] < MIDDLE + 3) | (RHO < 5)
    torn = np.where((AT[2] > 24) & (AT[2] < 32) & ~side, 1.0, solid)
    said = dataclasses.replace(revolution((14.0,)), estimate=True)
    made = solid_of(turned(field_of(torn), box=box, outline=said)[0], 0)
    wanted = (RHO < 19.3) & (RHO > 20 - WALL)
    assert made[..., 25:31][wanted[..., 25:31]].mean() > 0.99


def test_between_the_bounds_both_count():
    solid, box = cylinder(10)
    said = dataclasses.replace(revolution((8.0,)), estimate=True)
    made = solid_of(turned(field_of(solid), box=box, outline=said)[0], 0).sum() / (HIGH - LOW)
    assert 8.4 < np.sqrt(made / np.pi) < 9.6


def test_small_radii_are_those_of_the_estimate():
    """Voxels show a knob larger than it is."""
    field = field_of(np.maximum(RHO - 6, np.maximum(LOW - AT[2], AT[2] - HIGH)))
    box = box_of((MIDDLE - 6, MIDDLE - 6, LOW), (MIDDLE + 6, MIDDLE + 6, HIGH))
    said = dataclasses.replace(revolution((5.0,)), estimate=True)
    solid = solid_of(turned(field, box=box, outline=said)[0], 0)
    assert solid.sum() == pytest.approx(np.pi * 5**2 * (HIGH - LOW), rel=0.08)


def test_no_outline_goes_beyond_the_box():
    solid = solid_of(turned(field_of(block(*CORNERS)), outline=revolution((30.0,)))[0], 0)
    assert not solid[RHO > 17.5].any()


def test_an_estimate_is_left_out_where_voxels_show_another_shape():
    field = field_of(block(*CORNERS))
    beside = Revolution(2, place_of([MIDDLE + 24, MIDDLE]), np.array([12.0]) / N, estimate=True)
    after, built = turned(field, outline=beside)
    assert built == []
    assert_same(field, after)


def test_one_that_is_too_thin_is_left_out():
    field = field_of(block(*CORNERS))
    after, built = turned(field, outline=revolution((3.0,)))
    assert built == []
    assert_same(field, after)


def test_one_that_is_told_is_followed_whatever_voxels_show():
    box = box_of((MIDDLE - 6, MIDDLE - 6, LOW), (MIDDLE + 6, MIDDLE + 6, HIGH))
    after, built = turned(field_of(block(*CORNERS)), box=box, outline=revolution((6.0,)))
    assert built == [0]
    solid = solid_of(after, 0)
    assert solid[(RHO < 6) & (RHO > 6 - WALL) & (AT[2] > LOW) & (AT[2] < HIGH)].all()
    assert not solid[RHO > 6.5].any()


SHARED = (24, 36)  # layers of body and lid
SEAM = 30


def jar(torn=0.0, radius=18.0):
    """A body and a lid about one axis, and their boxes. Of the layers that both are in, most cells
    below ``SEAM`` are the body's, and most above it the lid's: .7 at random. ``torn``: the share of
    their cells that is missing."""
    rng = np.random.default_rng(0)
    among = (AT[2] > SHARED[0]) & (AT[2] < SHARED[1])
    field = field_of(np.where(among & (rng.random(AT.shape[1:]) < torn), 1, cylinder(radius)[0]))
    lid = np.where(among & (rng.random(AT.shape[1:]) < 0.3), AT[2] <= SEAM, AT[2] > SEAM)
    field.owner[(field.owner == 0) & lid] = 1
    across = (MIDDLE - radius, MIDDLE + radius)
    ends = ((LOW, SHARED[1] + 0.5), (SHARED[0] - 0.5, HIGH))
    boxes = [box_of((across[0],) * 2 + (e[0],), (across[1],) * 2 + (e[1],)) for e in ends]
    return field, np.stack(boxes)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_the_wall_where_two_parts_overlap_is_of_one_below_and_of_the_other_above(axis, order):
    field, boxes = jar(torn=0.2)
    field = about(field, axis)
    boxes = np.concatenate(
        [np.insert(b[:, :2], axis, b[:, 2], axis=1) for b in (boxes[:, :3], boxes[:, 3:])], 1
    )
    outlines = {k: revolution((18.0,), axis) for k in order}
    after, built = with_revolutions(field, boxes, field, outlines)
    assert sorted(built) == [0, 1]
    wall = (RHO < 17.5) & (RHO > 18.5 - WALL) & (AT[2] > LOW + 1) & (AT[2] < HIGH - 1)
    for part, mine in ((0, AT[2] <= SEAM), (1, AT[2] > SEAM)):
        solid, drawn = (np.moveaxis(solid_of(f, part), axis, 2) for f in (after, field))
        assert solid[wall & mine].all()
        within = (RHO < 12) & (AT[2] > LOW + 4) & (AT[2] < HIGH - 4)
        np.testing.assert_array_equal(solid[within], drawn[within])


@pytest.mark.parametrize(("part", "low"), [(0, SEAM + 1), (1, SEAM - 6)], ids=["body", "lid"])
def test_a_handle_stays_where_the_wall_is_the_other_part_s(part, low):
    field, boxes = jar()
    handle = block((MIDDLE + 10, MIDDLE - 2, low), (MIDDLE + 28, MIDDLE + 2, low + 5)) < 0
    handle &= RHO > 18
    field.sdf[handle], field.owner[handle] = -1, part
    boxes[part, 0] += 5 / N
    boxes[part, 3] += 10 / N
    after, _ = with_revolutions(field, boxes, field, {k: revolution((18.0,)) for k in (0, 1)})
    assert handle.sum() > 100
    assert solid_of(after, part)[handle].all()


def assert_whole(one, other, corners, middles=(MIDDLE, MIDDLE), radii=(16.0, 16.0), parts=(0, 1)):
    """Torn, ``parts`` of two blocks become solids of revolution with whole walls."""
    torn = np.random.default_rng(0).random(AT.shape[1:]) < 0.1
    field = field_of(*(np.where(torn, np.maximum(solid, 0.5), solid) for solid in (one, other)))
    outlines = {
        k: Revolution(2, place_of([x, MIDDLE]), np.array([radius]) / N)
        for k, (x, radius) in enumerate(zip(middles, radii, strict=True))
    }
    after, built = with_revolutions(field, np.stack([box_of(*c) for c in corners]), field, outlines)
    assert built == [0, 1]
    for part in parts:
        away = np.hypot(AT[0] - middles[part], AT[1] - MIDDLE)
        low, high = (corner[2] for corner in corners[part])
        radius, solid = radii[part], solid_of(after, part)
        wall = (away < radius - 0.5) & (away > radius + 0.5 - WALL)
        assert solid[wall & (AT[2] > low + 0.5) & (AT[2] < high - 0.5)].all()
        assert not solid[away > radius + 0.5].any()


@pytest.mark.parametrize(
    ("radius", "low", "high"),
    [(6, HIGH - 6, HIGH + 5), (9, HIGH - 8, HIGH + 9), (12, LOW + 4, HIGH - 4), (12, 24.7, 29.5)],
    ids=["a knob that reaches into a lid", "a plug", "a tin within a jar", "a ring within a jar"],
)
def test_a_narrow_part_or_one_within_another_is_made_in_all_its_layers(radius, low, high):
    corners = ((MIDDLE - radius,) * 2 + (low,), (MIDDLE + radius,) * 2 + (high,))
    inner = block(*corners)
    outer = np.maximum(block(*CORNERS), -inner)
    assert_whole(outer, inner, (CORNERS, corners), radii=(16.0, radius), parts=(1,))


def test_parts_beside_each_other_are_made_in_all_their_layers():
    """Two square pots, one somewhat higher than the other."""
    corners = [
        ((x - 8, MIDDLE - 8, low), (x + 8, MIDDLE + 8, low + 20))
        for x, low in ((20.3, LOW), (44.3, LOW + 8))
    ]
    assert_whole(*(block(*c) for c in corners), corners, (20.3, 44.3), (8.0, 8.0))

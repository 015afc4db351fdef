"""Nearly flat faces become flat, round things stay round, and no part takes from another."""

import numpy as np
import pytest
from scipy import ndimage

from uniart_jax.voxels import flat_faces
from uniart_jax.voxels.flat_faces import heights, with_flat_faces
from uniart_jax.voxels.isosurface import DenseField, part_mesh

N = 64  # sub-cells a side
AT = np.stack(np.meshgrid(*[np.arange(N + 2) + 0.0] * 3, indexing="ij"))


def field_of(*solids):
    """A field whose part k is where the k-th distance [N + 2]^3 (sub-cells) is negative; earlier parts win."""
    sdf, owner = np.full((N + 2,) * 3, 3.0, np.float32), np.full((N + 2,) * 3, -1, np.int16)
    for k, distance in enumerate(solids):
        mine = (distance < np.abs(sdf)) & (sdf > 0)
        sdf = np.where(mine, np.clip(distance, -3, 3), sdf).astype(np.float32)
        owner = np.where(mine, k, owner).astype(np.int16)
    source = np.where(np.abs(sdf) < 3, np.arange(sdf.size).reshape(sdf.shape), -1).astype(np.int32)
    sdf[sdf == 0] = -1e-4
    return DenseField(sdf, owner, source)


def block(lower, upper):
    """Distance from a block between two corners, cells; corners may be maps of the other places."""
    return np.max([np.maximum(a - x, x - b) for a, x, b in zip(lower, AT, upper, strict=True)], 0)


def box_of(lower, upper):
    lower, upper = ((np.array(c) - 0.5) / N - 0.5 for c in (lower, upper))
    return np.concatenate([(lower + upper) / 2, upper - lower])


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
    """On a drawer 40 deep, of which a tenth is more than they stand out; on planes as on the box."""
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
    assert changed.sum() < 0.03 * (field.sdf < 0).sum() and np.abs(disc[changed]).max() < 1.5
    ball = field_of(np.linalg.norm(AT - centre, axis=0) - 12)
    box = box_of([centre - 12] * 3, [centre + 12] * 3)
    round_still = with_flat_faces(ball, box[None])
    changed = ((round_still.sdf < 0) != (ball.sdf < 0)).sum() / (ball.sdf < 0).sum()
    assert changed < 0.01


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
    def erase(views, part):
        views[0][:] = 3

    monkeypatch.setattr(flat_faces, "_flatten", erase)
    monkeypatch.setattr(flat_faces, "_straighten", lambda *_: None)
    kept = with_flat_faces(door, box_of(LOWER, UPPER)[None])
    np.testing.assert_array_equal(kept.sdf, door.sdf)
    np.testing.assert_array_equal(kept.owner, door.owner)


def test_the_layer_around_the_grid_stays_outside(monkeypatch):
    """Or meshes would be open there: whatever plane a pass believes in."""

    def to_the_end(views, part):
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

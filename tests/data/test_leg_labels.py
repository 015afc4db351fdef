"""Legs read off meshes: of tables made of boxes, whose legs are known, and of others."""

import numpy as np
import pytest
import trimesh

from uniart_jax import procedural
from uniart_jax.data.layouts import encodable_state
from uniart_jax.data.legs import legs_of
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.voxels.part_table import MOST_LEGS

FLOOR, BOARD = -0.3, 0.2


def box(lower, upper):
    lower, upper = np.array(lower, float), np.array(upper, float)
    return trimesh.creation.box(upper - lower).apply_translation((lower + upper) / 2)


def leg(x, y, width=0.08, top=BOARD):
    return box((x, y, FLOOR), (x + width, y + width, top))


def table(*carried, board=True, moving=()):
    meshes = [*carried] + [box((-0.4, -0.4, BOARD), (0.4, 0.4, 0.3))] * board
    body = trimesh.boolean.union(meshes, engine="manifold") if len(meshes) > 1 else meshes[0]
    slide = Joint(np.zeros(3), np.array([-1.0, 0, 0]), travel=(0, 0.2))
    parts = [Part("base", body, -1, Joint.fixed())]
    parts += [Part(f"drawer_{k}", mesh, 0, slide) for k, mesh in enumerate(moving)]
    return ArticulatedObject(tuple(parts))


CORNERS = [(x, y) for x in (-0.38, 0.3) for y in (-0.38, 0.3)]


def test_four_square_legs():
    found = legs_of(table(*(leg(x, y) for x, y in CORNERS)))
    assert len(found) == 4 and found.alone and not found.plinth.any() and not found.round.any()
    expected = sorted([x, y, x + 0.08, y + 0.08] for x, y in CORNERS)
    for rectangles in (found.lower, found.upper):
        np.testing.assert_allclose(sorted(rectangles.tolist()), expected, atol=1e-6)
    np.testing.assert_allclose(found.heights, [[FLOOR, BOARD]] * 4, atol=0.011)
    np.testing.assert_allclose(found.fill, 1, atol=1e-4)


def test_round_legs_that_lean_and_side_boards():
    cylinder = trimesh.creation.cylinder(
        0.04, sections=48, segment=[[0.3, 0.3, FLOOR], [0.2, 0.3, 0.25]]
    )
    flat = trimesh.intersections.slice_mesh_plane(cylinder, [0, 0, 1], [0, 0, FLOOR], cap=True)
    boards = (box((-0.4, y, FLOOR), (0.1, y + 0.05, BOARD)) for y in (-0.4, 0.0))
    found = legs_of(table(flat, *boards))
    (k,) = np.flatnonzero(found.round)
    assert len(found) == 3 and found.alone
    slope = (found.upper[k] - found.lower[k])[[0, 2]] / (found.heights[k, 1] - found.heights[k, 0])
    np.testing.assert_allclose(slope, -0.1 / 0.55, atol=0.02)
    board = found.lower[np.argmin(found.lower[:, 1])]
    np.testing.assert_allclose(board, [-0.4, -0.4, 0.1, -0.35], atol=1e-6)


def test_what_is_beside_legs_is_told():
    shelf = box((-0.36, -0.36, -0.2), (0.36, 0.36, -0.19))
    low = box((-0.15, -0.15, FLOOR), (0.15, 0.15, 0.0))  # as high as half of them
    with_block = legs_of(table(low, *(leg(x, y) for x, y in CORNERS)))
    assert len(with_block) == 4 and not with_block.alone
    few = legs_of(table(shelf, *(leg(x, y) for x, y in CORNERS)))
    np.testing.assert_allclose(few.heights, [[FLOOR, -0.2]] * 4, atol=0.011)  # they end where it is


def test_rails_between_legs_do_not_hide_them():
    rails = [box((-0.38, y, -0.1), (0.38, y + 0.03, -0.05)) for y in (-0.36, 0.33)]
    found = legs_of(table(*rails, *(leg(x, y) for x, y in CORNERS)))
    expected = sorted([x, y, x + 0.08, y + 0.08] for x, y in CORNERS)
    np.testing.assert_allclose(sorted(found.lower.tolist()), expected, atol=1e-6)
    np.testing.assert_allclose(found.heights, [[FLOOR, BOARD]] * 4, atol=0.011)
    assert not found.alone


def test_legs_of_two_lengths():
    """A pedestal on feet beside a board that reaches up to the top."""
    pedestal = box((-0.38, -0.38, -0.26), (0.0, 0.38, BOARD))
    feet = [leg(x, y, 0.05, -0.25) for x in (-0.38, -0.05) for y in (-0.38, 0.33)]
    long = leg(0.3, 0.0, 0.06)
    found = legs_of(table(pedestal, long, *feet))
    order = np.argsort(found.heights[:, 1])
    np.testing.assert_allclose(
        found.heights[order, 1], [-0.26] * 4 + [found.heights.max()], atol=0.011
    )


def test_a_moving_part_ends_them():
    drawer = box((-0.2, -0.2, -0.1), (0.2, 0.2, 0.1))
    found = legs_of(table(*(leg(x, y) for x, y in CORNERS), moving=[drawer]))
    np.testing.assert_allclose(found.heights[:, 1], -0.1, atol=0.011)


def test_a_plinth_and_what_has_nothing():
    inset = legs_of(table(box((-0.35, -0.4, FLOOR), (0.4, 0.4, BOARD))))
    assert not len(inset)  # half of the object is no plinth
    low = table(
        box((-0.35, -0.4, FLOOR), (0.4, 0.4, -0.2)), box((-0.4, -0.4, -0.2), (0.4, 0.4, BOARD))
    )
    found = legs_of(low)
    assert len(found) == 1 and found.plinth.all() and found.alone
    np.testing.assert_allclose(found.lower, [[-0.35, -0.4, 0.4, 0.4]], atol=1e-6)
    np.testing.assert_allclose(found.heights, [[FLOOR, -0.2]], atol=0.011)
    assert len(legs_of(table())) == 0


def test_too_many_legs_and_open_meshes_are_not_known():
    many = [leg(x, y, 0.03) for x in np.linspace(-0.4, 0.3, 3) for y in np.linspace(-0.4, 0.3, 4)]
    assert len(many) > MOST_LEGS and legs_of(table(*many)) is None
    whole = table(*(leg(x, y) for x, y in CORNERS))
    assert len(legs_of(whole)) == 4
    open_mesh = whole.parts[0].mesh.copy()
    open_mesh.update_faces(np.arange(len(open_mesh.faces)) > 0)
    assert legs_of(table(open_mesh, board=False)) is None


@pytest.mark.parametrize("family", ["table", "refrigerator"])
def test_legs_of_a_shown_state_lie_where_its_body_does(family):
    for seed in range(3):
        closed = procedural.generate(family, seed)
        shown, _ = encodable_state(closed, np.random.default_rng(seed))
        there, here = legs_of(closed), legs_of(closed, shown)
        bounds = [obj.parts[0].mesh.bounds for obj in (closed, shown)]
        scale = np.ptp(bounds[1], 0) / np.ptp(bounds[0], 0)
        for name in ("lower", "upper"):
            apart = getattr(there, name)[:, :2] - bounds[0][0, :2]
            expected = bounds[1][0, :2] + apart * scale[:2]
            np.testing.assert_allclose(getattr(here, name)[:, :2], expected, atol=1e-5)
        expected = bounds[1][0, 2] + (there.heights - bounds[0][0, 2]) * scale[2]
        np.testing.assert_allclose(here.heights, expected, atol=1e-5)
        if len(here):
            np.testing.assert_allclose(here.heights[:, 0], bounds[1][0, 2], atol=1e-6)
            assert (here.table(MOST_LEGS)[: len(here), :8] != 0).any() and not here.table(
                MOST_LEGS
            )[len(here) :].any()

"""Parts that do not move are the boards that they are told to have."""

import itertools

import numpy as np
import pytest
from fields import AT, N, assert_same, block, copy_of, field_of, place_of, solid_of
from scipy.spatial import cKDTree

from uniart_jax.objects.kinematics import Joint
from uniart_jax.voxels.cleanup.told_shapes import with_told_shapes
from uniart_jax.voxels.isosurface import part_mesh
from uniart_jax.voxels.panel_table import Panels
from uniart_jax.voxels.tube_table import Tube

BODY = block((10.3, 10.3, 10.3), (30.3, 50.3, 50.3))
HANDLE = ((30.3, 25.3, 20.3), (46.3, 35.3, 40.3))  # as it is drawn: a block
BARS = np.array(
    [
        [30.3, 25.3, 20.3, 46.3, 35.3, 24.3],
        [30.3, 25.3, 36.3, 46.3, 35.3, 40.3],
        [42.3, 25.3, 20.3, 46.3, 35.3, 40.3],
    ]
)
DOOR = block((48.3, 10.3, 10.3), (51.3, 50.3, 50.3))


def at(boards, motion=None):
    return Panels(place_of(np.asarray(boards).reshape(-1, 2, 3)).reshape(-1, 6), 1.0, False, motion)


@pytest.fixture
def field():
    """A body, its handle, and a door that moves."""
    return field_of(BODY, block(*HANDLE), DOOR)


def test_a_handle_is_its_bars_and_all_else_stays(field):
    before = copy_of(field)
    after = with_told_shapes(field, [0, 1], {1: at(BARS)}, {})
    assert_same(field, before)
    bars = np.min([block(b[:3], b[3:]) for b in BARS], 0) < 0
    drawn = solid_of(after, 0) | solid_of(after, 1)
    np.testing.assert_array_equal(drawn, (BODY < 0) | bars)
    np.testing.assert_array_equal(solid_of(after, 2), DOOR < 0)
    assert solid_of(after, 1)[(AT[0] > 33) & bars].all()
    mesh = part_mesh(after, 1, (slice(1, N + 1),) * 3, np.zeros((N**3, 3), np.uint8))
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx((bars & (BODY > 0)).sum() / N**3, rel=0.1)


def test_a_part_that_moves_is_not_written_over(field):
    through = np.array([[30.3, 25.3, 20.3, 60.3, 35.3, 40.3]])
    after = with_told_shapes(field, [0, 1], {1: at(through)}, {})
    np.testing.assert_array_equal(solid_of(after, 2), DOOR < 0)


def test_a_bar_thinner_than_the_cells_is_drawn(field):
    thin = np.array([[30.3, 29.8, 29.9, 46.3, 30.0, 30.1]])
    solid = solid_of(with_told_shapes(field, [0, 1], {1: at(thin)}, {}), 1)
    assert solid[33:45].any((1, 2)).all()


def test_without_boards_the_field_is_the_same(field):
    assert with_told_shapes(field, [0], {}, {}) is field


@pytest.mark.parametrize("owner", [1, 2])
def test_a_tube_is_all_within_its_radius_of_a_path_also_of_a_part_that_moves(field, owner):
    points = np.array([[34.0, 30, 30], [44, 30, 30], [44, 44, 40]])
    tube = Tube(place_of(points), 3.2 / N)
    after = with_told_shapes(field, [0, 1], {}, {owner: tube})
    path = np.concatenate([np.linspace(a, b, 400) for a, b in itertools.pairwise(points)])
    away = np.reshape(cKDTree(path).query(AT.reshape(3, -1).T)[0], AT.shape[1:])
    solid = solid_of(after, owner)
    assert solid[away < 3.15].all() and not solid[away > 3.25].any()
    if owner == 1:
        np.testing.assert_array_equal(solid_of(after, 2), DOOR < 0)


@pytest.mark.parametrize("angle", [-0.4, 0.7])
def test_a_lid_that_is_told_closed_is_drawn_where_it_is_shown(field, angle):
    """Of a part that moves, whatever is drawn of it."""
    lid = np.array([[20.3, 14.3, 54.3, 50.3, 46.3, 58.3]])
    hinge = place_of(np.array([50.3, 0, 54.3]))
    motion = Joint(hinge, (0, 1.0, 0), angle=(-1.0, 1.0)).motion(angle)
    after = with_told_shapes(field, [0, 1], {2: at(lid, motion)}, {})
    back = np.linalg.inv(motion)
    places = place_of(AT.reshape(3, -1).T) @ back[:3, :3].T + back[:3, 3]
    low, high = place_of(lid.reshape(2, 3))
    apart = np.maximum(low - places, places - high).max(1).reshape(AT.shape[1:]) * N
    free = ~(solid_of(field, 0) | solid_of(field, 1))
    inner = np.s_[1:-1, 1:-1, 1:-1]
    solid = solid_of(after, 2)[inner]
    assert (
        solid[(apart < -0.05)[inner] & free[inner]].all() and not solid[(apart > 0.05)[inner]].any()
    )

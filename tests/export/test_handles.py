"""Handles are told where they stand out from a plate; without one, at its rim."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from uniart_jax.export.handles import handles
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part

DOOR = Joint([-0.3, 0.4, 0], [0, 0, 1], (-1.5, 0))
SLIDE = Joint([0, 0, 0], [-1, 0, 0], (0, 0), (0, 0.4))
BAR = ([-0.38, -0.34, -0.1], [-0.355, -0.32, 0.25])


def box(lo, hi) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[lo, hi])


def joined(*blocks) -> trimesh.Trimesh:
    return trimesh.boolean.union([box(*b) for b in blocks], engine="manifold")


PLATE = ([-0.34, -0.4, -0.5], [-0.3, 0.4, 0.4])
POST = ([-0.36, -0.34, 0.05], [-0.33, -0.32, 0.08])


def cupboard(mesh: trimesh.Trimesh, joint: Joint, *more: Part) -> ArticulatedObject:
    body = Part("a", box([-0.3, -0.4, -0.5], [0.3, 0.4, 0.4]))
    return ArticulatedObject((body, Part("b", mesh, 0, joint), *more))


@pytest.mark.parametrize("joint", [DOOR, SLIDE], ids=["door", "drawer"])
def test_the_middle_of_what_stands_out(joint):
    found = handles(cupboard(joined(PLATE, POST, BAR), joint))[1]
    np.testing.assert_allclose(found.point, [-0.38, -0.33, 0.075], atol=0.02)
    assert found.part == 1 and found.opens == (-1 if joint is DOOR else 1)


def test_a_bar_that_is_a_part_of_its_own():
    found = handles(cupboard(box(*PLATE), DOOR, Part("c", joined(POST, BAR), 1)))[1]
    assert found.part == 2
    np.testing.assert_allclose(found.point, [-0.38, -0.33, 0.075], atol=0.02)


def test_without_one_the_rim_and_the_front():
    door, drawer = (handles(cupboard(box(*PLATE), joint))[1] for joint in (DOOR, SLIDE))
    assert door.point[1] == pytest.approx(-0.4) and door.point[2] == pytest.approx(-0.05)
    np.testing.assert_allclose(drawer.point, [-0.34, 0, -0.05], atol=1e-6)


def test_what_stands_out_beside_the_hinge_is_no_handle():
    near = ([-0.38, 0.3, -0.1], [-0.33, 0.35, 0.25])
    assert handles(cupboard(joined(PLATE, near), DOOR))[1].point[1] == pytest.approx(-0.4)


def test_points_lie_on_the_surface():
    obj = cupboard(joined(PLATE, POST, BAR), DOOR)
    point = handles(obj)[1].point
    assert abs(trimesh.proximity.signed_distance(obj.parts[1].mesh, point[None])[0]) < 1e-6

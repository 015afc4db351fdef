"""Frames, names and groups that every format shares."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from uniart_jax.export.frames import (
    body_frames,
    check_lengths,
    joint_name,
    linked_pairs,
    metric,
    metric_travel,
    rigid_groups,
    travel_name,
)
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part

BOX = trimesh.creation.box()


@pytest.fixture
def chain() -> ArticulatedObject:
    """base - door (hinge) - handle (fixed) - key (left-handed screw); shelf fixed to the base. 2 m
    a unit."""
    return ArticulatedObject(
        (
            Part("base", BOX, -1, Joint([9, 9, 9], [0, 0, 1], (-1, 1))),
            Part("door", BOX, 0, Joint([1, 2, 3], [0, 0, 1], (0, 1.5))),
            Part("shelf", BOX, 0),
            Part("handle", BOX, 1),
            Part("key", BOX, 3, Joint([1, 0, 0], [1, 0, 0], (-1, 2), (0.1, -0.2))),
        ),
        scale=2.0,
    )


def test_frames_stand_on_axes_and_fixed_parts_share_their_parents(chain):
    expected = [[0, 0, 0], [2, 4, 6], [0, 0, 0], [2, 4, 6], [2, 0, 0]]
    np.testing.assert_array_equal(body_frames(chain), expected)


def test_names_are_the_urdfs(chain):
    assert joint_name(chain.parts[4]) == "key_joint" and travel_name(chain.parts[4]) == "key_travel"


def test_groups_and_the_pairs_that_a_joint_links(chain):
    assert rigid_groups(chain) == [0, 1, 0, 1, 4]
    names = [p.name for p in chain.parts]
    assert {(names[a], names[b]) for a, b in linked_pairs(chain)} == {
        ("base", "door"),
        ("base", "handle"),
        ("shelf", "door"),
        ("shelf", "handle"),
        ("door", "key"),
        ("handle", "key"),
    }


def test_travel_ascends_in_metres_also_of_a_left_handed_screw(chain):
    assert metric_travel(chain.parts[4], chain.scale) == pytest.approx((-0.4, 0.2))


def test_rest_is_metric(chain):
    slide = Part("slide", BOX, 0, Joint([0, 0, 0], [0, 0, 1], (0, 0), (-0.5, 0)))
    obj = ArticulatedObject((Part("base", BOX), slide), scale=3.0)
    shown = obj.shown_at([0, -0.25])
    np.testing.assert_allclose(metric(shown, shown.rest()), 3.0 * shown.rest())
    assert metric(shown, shown.rest())[1] == pytest.approx(0.75)


def test_a_list_of_another_length_is_refused(chain):
    with pytest.raises(ValueError, match="write_x: files has 1 entries for 5 parts"):
        check_lengths("write_x", chain, files=["a"])

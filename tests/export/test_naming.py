"""Parts that have no name of their own are called what they are, from the top left of the front."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import trimesh

from uniart_jax import procedural
from uniart_jax.export.naming import is_made_up, named, reading_order
from uniart_jax.export.part_kinds import ORDER, is_knob
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part


def block(lo, hi) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[lo, hi])


def dial(y: float, z: float, sections: int = 24) -> trimesh.Trimesh:
    """A cylinder along x in front of the face at -.3."""
    turn = trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0])
    turn[:3, 3] = [-0.32, y, z]
    return trimesh.creation.cylinder(0.04, 0.04, sections=sections, transform=turn)


def cooker(names=None, labels=None) -> ArticulatedObject:
    """Two dials above, a door right of a drawer, a screw, a fixed foot; listed out of order."""
    about = [1, 0, 0]
    slide = Joint([0, 0, 0], [-1, 0, 0], (0, 0), (0, 0.3))
    hinge = Joint([-0.3, -0.38, 0], [0, 0, 1], (-1.5, 0))
    parts = [
        (block([-0.3, -0.4, -0.5], [0.3, 0.4, 0.5]), Joint.fixed()),
        (block([-0.33, 0.02, -0.3], [-0.3, 0.38, 0.2]), slide),
        (block([-0.33, -0.38, -0.3], [-0.3, -0.02, 0.22]), hinge),
        (dial(-0.2, 0.4), Joint([-0.3, -0.2, 0.4], about, (0, 4))),
        (dial(0.2, 0.4), Joint([-0.3, 0.2, 0.4], about, (-np.pi, np.pi))),
        (dial(0.2, -0.4), Joint([-0.3, 0.2, -0.4], about, (0, 4), (0, 0.03))),
        (block([0.2, 0.3, -0.55], [0.25, 0.35, -0.5]), Joint.fixed()),
    ]  # fmt: skip
    names = names or [f"link_{k}" for k in range(len(parts))]
    labels = labels or [""] * len(parts)
    return ArticulatedObject(
        tuple(
            Part(name, mesh, 0 if k else -1, joint, label)
            for k, (name, label, (mesh, joint)) in enumerate(zip(names, labels, parts, strict=True))
        )
    )


def test_parts_are_called_what_they_are():
    obj = named(cooker())
    assert [p.name for p in obj.parts] == [
        *("base", "drawer_1", "door_1", "knob_2", "knob_1", "screw_1", "fixed_1"),
    ]


def test_rows_are_read_from_the_top_left():
    order = [k for k in reading_order(cooker()) if k]
    assert order == [4, 3, 1, 2, 5, 6]  # the front is at -x, so +y is on the left
    two = named(dataclasses.replace(cooker(), parts=cooker().parts[:1] + cooker().parts[3:5]))
    assert [p.name for p in two.parts] == ["base", "knob_2", "knob_1"]


def test_names_and_labels_that_were_given_are_kept():
    names = ["body", "upper drawer", "link_2", "hinge_1", "", "l1", "part 6"]
    labels = ["", "drawer", "door", "", "switch", "switch", ""]
    obj = named(cooker(names, labels))
    assert [p.name for p in obj.parts] == [
        *("body", "upper drawer", "door", "hinge_1", "switch", "switch_2", "fixed_1"),
    ]
    assert [p.label for p in obj.parts] == labels


def test_a_name_that_is_taken_is_not_given_again():
    names = [f"link_{k}" for k in range(7)]
    names[3] = "door_1"
    obj = named(cooker(names))
    assert obj.parts[2].name == "door_2" and obj.parts[3].name == "door_1"


@pytest.mark.parametrize("name", ["", "  ", "link_3", "Link 3", "part", "L2", "body_7", "12"])
def test_made_up_names(name):
    assert is_made_up(name)


@pytest.mark.parametrize("name", ["door", "base", "body", "left_door_link", "drawer_2", "hinge_1"])
def test_names_that_say_something(name):
    assert not is_made_up(name)


def test_knobs_are_small_and_round_and_turn():
    obj = cooker()
    assert [k for k in range(len(obj.parts)) if is_knob(obj, k)] == [3, 4]

    def with_mesh(mesh) -> bool:
        parts = list(obj.parts)
        parts[3] = dataclasses.replace(parts[3], mesh=mesh)
        return is_knob(dataclasses.replace(obj, parts=tuple(parts)), 3)

    assert not with_mesh(dial(-0.2, 0.4).apply_translation([0, 0.06, 0]))  # beside its axis
    assert not with_mesh(block([-0.34, -0.27, 0.38], [-0.3, -0.13, 0.42]))  # a lever
    large = dial(-0.2, 0.4)
    large.vertices = (large.vertices - [-0.3, -0.2, 0.4]) * 3 + [-0.3, -0.2, 0.4]
    assert not with_mesh(large)


def test_names_of_whole_objects_are_told_apart():
    for family in ("oven", "storage_furniture"):
        obj = procedural.generate(family, 900_001)
        bare = [dataclasses.replace(p, name=f"link_{k}", label="") for k, p in enumerate(obj.parts)]
        found = named(dataclasses.replace(obj, parts=tuple(bare)))
        names = [p.name for p in found.parts]
        assert len(set(names)) == len(names) and names[0] == "base"
        assert {n.rsplit("_", 1)[0] for n in names[1:]} <= {*ORDER, "handle", "fixed"}

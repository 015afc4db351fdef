"""Chains of URDF joints through links without a mesh, lowered to one joint each."""

from __future__ import annotations

import numpy as np
import pytest
from urdf_texts import joint, limit, link, notes


def test_links_without_a_mesh_are_collapsed(load):
    obj = load(
        link("world", ""),
        link("base"),
        link("frame", ""),
        link("door"),
        link("sensor", ""),
        joint("floating", "base", parent="world"),
        joint("revolute", "frame", f'<origin xyz="1 0 0"/><axis xyz="0 0 1"/>{limit(0, 1)}'),
        joint("fixed", "door", '<origin xyz="1 0 0"/>', parent="frame"),
        joint("planar", "sensor", parent="door"),
    )
    assert [p.name for p in obj.parts] == ["base", "door"]
    assert obj.parts[1].joint.type == "revolute"
    np.testing.assert_allclose(obj.parts[1].joint.origin, [1, 0, 0])
    np.testing.assert_allclose(obj.parts[1].box[:3], [2, 0, 0])
    assert notes(obj, "'world', 'frame', 'sensor'")


def test_siblings_on_a_moving_link_without_a_mesh_move_together(load):
    obj = load(
        link("base"), link("arm", ""), link("a"), link("b"),
        joint("prismatic", "arm", limit(0, 2)),
        joint("fixed", "a", '<origin xyz="0 3 0"/>', parent="arm"),
        joint("fixed", "b", '<origin xyz="0 6 0"/>', parent="arm"),
    )  # fmt: skip
    assert obj.parents == [-1, 0, 1] and [j.type for j in obj.joints] == [
        "fixed",
        "prismatic",
        "fixed",
    ]


def test_a_root_without_a_mesh_gives_way_to_its_largest_child(load):
    big = '<visual><geometry><box size="3 3 3"/></geometry></visual>'
    obj = load(
        link("base", ""), link("a"), link("b", big),
        joint("revolute", "a", limit(0, 1)), joint("revolute", "b", limit(0, 1)),
    )  # fmt: skip
    assert [p.name for p in obj.parts] == ["b", "a"] and obj.parents == [-1, 0]
    assert notes(obj, "held fixed") and notes(obj, "'b_joint'")


def two_joints(first: str, second: str) -> list[str]:
    return [link("base"), link("mid", ""), link("cap"), first, second]


def test_mimic_through_a_link_without_a_mesh_is_a_screw(load):
    obj = load(
        *two_joints(
            joint("revolute", "mid", f'<axis xyz="0 0 1"/>{limit(0, 20)}'),
            joint(
                "prismatic",
                "cap",
                f'<axis xyz="0 0 -1"/>{limit(-9, 9)}<mimic joint="mid_joint" multiplier="0.02"/>',
                "mid",
            ),
        )
    )
    cap = obj.parts[1].joint
    assert cap.type == "screw"
    np.testing.assert_allclose(cap.angle, (0, 20))
    np.testing.assert_allclose(cap.travel, (0, -0.4))
    assert notes(obj, "one screw") and not notes(obj, "degrees")


def test_a_prismatic_joint_may_drive_the_turn(load):
    obj = load(
        *two_joints(
            joint("prismatic", "mid", f'<axis xyz="0 0 1"/>{limit(0, 0.4)}'),
            joint(
                "continuous",
                "cap",
                '<axis xyz="0 0 1"/><mimic joint="mid_joint" multiplier="-50"/>',
                "mid",
            ),
        )
    )
    cap = obj.parts[1].joint
    np.testing.assert_allclose(cap.angle, (0, 20))
    np.testing.assert_allclose(cap.travel, (0, -0.4))
    np.testing.assert_allclose(cap.motion(20)[:3, 3], [0, 0, 0.4], atol=1e-12)


def test_independent_turn_and_travel_become_one_proportional_screw(load):
    obj = load(
        *two_joints(
            joint("revolute", "mid", f'<axis xyz="0 0 1"/>{limit(-1, 3)}'),
            joint("prismatic", "cap", f'<axis xyz="0 0 1"/>{limit(0, 0.2)}', "mid"),
        )
    )
    cap = obj.parts[1].joint
    np.testing.assert_allclose(cap.angle, (0, 4))
    np.testing.assert_allclose(cap.travel, (0, 0.2))
    assert notes(obj, "proportional screw")


@pytest.mark.parametrize(
    ("first", "second", "kind"),
    [
        (
            '"continuous" <axis xyz="0 0 1"/>',
            f'"prismatic" <axis xyz="0 0 1"/>{limit(0, 0.1)}',
            "continuous",
        ),
        (
            f'"revolute" <axis xyz="0 0 1"/>{limit(0, 0.1)}',
            f'"prismatic" <axis xyz="1 0 0"/>{limit(0, 3)}',
            "prismatic",
        ),
        (
            f'"revolute" <axis xyz="0 0 1"/>{limit(0, 2)}',
            f'"revolute" <axis xyz="1 0 0"/>{limit(0, 0.1)}',
            "revolute",
        ),
    ],
)
def test_what_is_no_screw_is_lowered_to_the_larger_motion(load, first, second, kind):
    (a, inner), (b, more) = (s[1:].split('" ', 1) for s in (first, second))
    obj = load(*two_joints(joint(a, "mid", inner), joint(b, "cap", more, "mid")))
    assert obj.parts[1].joint.type == kind
    assert notes(obj, "dropped beside")


def test_telescopic_rails_add_up(load):
    obj = load(
        *two_joints(
            joint("prismatic", "mid", f'<axis xyz="1 0 0"/>{limit(0, 0.3)}'),
            joint("prismatic", "cap", f'<axis xyz="-1 0 0"/>{limit(-0.4, 0)}', "mid"),
        )
    )
    np.testing.assert_allclose(obj.parts[1].joint.travel, (0, 0.7))
    assert notes(obj, "are one joint")


def test_a_mimic_of_another_link_is_independent_but_shown_where_it_belongs(load):
    obj = load(
        link("base"), link("a"), link("b"),
        joint("prismatic", "a", limit(1, 2)),
        joint("prismatic", "b", f'{limit(-9, 9)}<mimic joint="a_joint" multiplier="2" offset="1"/>'),
    )  # fmt: skip
    np.testing.assert_allclose([p.box[0] for p in obj.parts], [0, 1, 3])
    np.testing.assert_allclose(obj.parts[2].joint.travel, (-12, 6))
    assert notes(obj, "mimics 'a_joint' of another link")


def test_a_joint_without_room_makes_no_screw(load):
    """A turn from 0 to 0 beside a travel is none, whatever order they come in."""
    still, slide = limit(0, 0), limit(0, 0.4)
    for first, second, kind in (
        (("revolute", still), ("prismatic", slide), "prismatic"),
        (("prismatic", slide), ("revolute", still), "prismatic"),
        (("prismatic", still), ("revolute", slide), "revolute"),
    ):
        obj = load(
            link("base"),
            link("mid", ""),
            link("cap"),
            joint(first[0], "mid", '<axis xyz="0 0 1"/>' + first[1]),
            joint(second[0], "cap", '<axis xyz="0 0 1"/>' + second[1], parent="mid"),
        )
        assert obj.joints[1].type == kind and obj.joints[1].limits == (0, 0.4)
        assert not notes(obj, "screw") and len(notes(obj, "leave no room to move")) == 1

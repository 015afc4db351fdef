"""Chains of URDF joints through links without a mesh."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from urdf_texts import joint, limit, link, notes

from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.several_joints import one_joint


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


def test_an_independent_turn_and_travel_are_two_joints_until_they_are_lowered(load):
    obj = load(
        *two_joints(
            joint("revolute", "mid", f'<axis xyz="0 0 1"/>{limit(-1, 3)}'),
            joint("prismatic", "cap", f'<axis xyz="0 0 -1"/>{limit(-0.2, 0)}', "mid"),
        )
    )
    turn, slide = obj.parts[1].chain
    np.testing.assert_allclose([turn.angle, turn.travel], [(-1, 3), (0, 0)])
    np.testing.assert_allclose([slide.angle, slide.travel], [(0, 0), (-0.2, 0)])
    assert notes(obj, "all are kept, and its state is that of 'mid_joint'")
    lowered = obj.single_jointed()
    (cap,) = lowered.parts[1].chain
    np.testing.assert_allclose(cap.angle, (0, 4))
    np.testing.assert_allclose(cap.travel, (0, 0.2))
    assert notes(lowered, "proportional screw") and not notes(obj, "proportional screw")


def test_a_turn_of_more_than_once_beside_a_travel_is_a_screw_when_read(load):
    """A joint that only turns holds no such range."""
    obj = load(
        *two_joints(
            joint("prismatic", "mid", f'<axis xyz="0 0 1"/>{limit(0, 0.2)}'),
            joint("revolute", "cap", f'<axis xyz="0 0 1"/>{limit(0, 6.5)}', "mid"),
        )
    )
    (cap,) = obj.parts[1].chain
    np.testing.assert_allclose([cap.angle, cap.travel], [(0, 6.5), (0, 0.2)])
    assert notes(obj, "turn more than once")


def test_lowering_joins_what_a_code_can_hold_and_nothing_else():
    up, aside = np.array([0.0, 0, 1]), np.array([1.0, 0, 0])
    turn = Joint(aside, up, (0.0, 2.0))
    slide = Joint(np.zeros(3), -up, travel=(0.0, 0.5))
    for outer, main, inner in (((), turn, (slide,)), ((slide,), turn, ()), ((turn,), slide, ())):
        screw = one_joint(outer, main, inner)
        np.testing.assert_allclose([screw.angle, screw.travel], [(0, 2), (0, -0.5)])
        np.testing.assert_allclose(screw.origin, aside)
    across = dataclasses.replace(slide, direction=aside)
    endless = Joint(aside, up, (-np.pi, np.pi))
    for main, other in ((turn, across), (slide, endless), (turn, turn), (slide, slide)):
        assert one_joint((other,), main, ()) is main
    assert one_joint((), turn, (slide, slide)) is turn


RANGES = [
    ((0, 2), (0, 0.5)),
    ((0, 2), (-0.5, 0)),
    ((-2, 0), (0, 0.5)),
    ((-2, 0), (-0.5, 0)),
    ((-0.5, 2), (-0.4, 0.1)),
]


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize(("angle", "travel"), RANGES)
def test_a_lowered_joint_turns_and_travels_the_way_both_open(angle, travel, way):
    """Its far end is where both joints are at their far ends, whichever way their axes point."""
    axis = np.array([0.0, 0, 1])
    turn, slide = Joint(np.zeros(3), axis, angle), Joint(np.zeros(3), way * axis, travel=travel)
    screw = one_joint((turn,), slide, ())
    far = [q for q in screw.limits if abs(q) == max(np.abs(screw.limits))]
    most = [max(ends, key=abs) for ends in (angle, travel)]
    moved = screw.motion(far[0])
    assert moved[2, 3] == pytest.approx(way * most[1])
    turned = screw.direction[2] * far[0]
    assert np.sign(turned) == np.sign(most[0])
    assert np.ptp(screw.angle) == pytest.approx(np.ptp(angle))


@pytest.mark.parametrize(("angle", "travel"), [((0, 6.5), (-0.2, 0)), ((-6.5, 0), (0, 0.2))])
def test_a_screw_that_is_read_of_two_joints_is_of_the_right_hand(load, angle, travel):
    obj = load(
        *two_joints(
            joint("prismatic", "mid", f'<axis xyz="0 0 1"/>{limit(*travel)}'),
            joint("revolute", "cap", f'<axis xyz="0 0 1"/>{limit(*angle)}', "mid"),
        )
    )
    (cap,) = obj.parts[1].chain
    q = max(cap.limits, key=abs)
    moved = cap.motion(q)
    assert moved[2, 3] == pytest.approx(max(travel, key=abs))
    assert cap.direction[2] * q == pytest.approx(max(angle, key=abs))


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
def test_the_larger_of_two_motions_is_the_part_s_and_left_by_lowering(load, first, second, kind):
    (a, inner), (b, more) = (s[1:].split('" ', 1) for s in (first, second))
    obj = load(*two_joints(joint(a, "mid", inner), joint(b, "cap", more, "mid")))
    cap = obj.parts[1]
    assert cap.joint.type == kind and [j.type for j in cap.chain] == [a, b]
    assert len(cap.chain) == 2 and notes(obj, "all are kept")
    lowered = obj.normalized()
    assert [j.type for j in lowered.parts[1].chain] == [kind]
    assert notes(lowered, "of its 2 joints the one with the largest motion was left")


def test_a_joint_beside_another_that_does_not_move_is_read_as_fixed(load):
    obj = load(
        *two_joints(
            joint("revolute", "mid", f'<axis xyz="0 0 1"/>{limit(0, 1)}'),
            joint("prismatic", "cap", f'<axis xyz="1 0 0"/>{limit(0, 1e-5)}', "mid"),
        )
    )
    assert [j.type for j in obj.parts[1].chain] == ["revolute"]
    assert notes(obj, "joint 'cap_joint': it moves by less than")


def test_rails_that_something_turns_between_do_not_add_up(load):
    obj = load(
        link("base"), link("rail", ""), link("swivel", ""), link("tray"),
        joint("prismatic", "rail", f'<axis xyz="1 0 0"/>{limit(0, 0.3)}'),
        joint("revolute", "swivel", f'<axis xyz="0 0 1"/>{limit(0, 1)}', "rail"),
        joint("prismatic", "tray", f'<axis xyz="1 0 0"/>{limit(0, 0.2)}', "swivel"),
    )  # fmt: skip
    assert [j.type for j in obj.parts[1].chain] == ["prismatic", "revolute", "prismatic"]


def test_further_joints_go_where_their_part_goes(load):
    """Shown with its hinge opened, an object's outer joint stays and its inner one has turned."""
    obj = load(
        link("base"), link("a", ""), link("b", ""), link("cap"),
        joint("prismatic", "a", f'<axis xyz="1 0 0"/>{limit(0, 0.1)}'),
        joint("revolute", "b", f'<origin xyz="0 1 0"/><axis xyz="0 0 1"/>{limit(0, 2)}', "a"),
        joint("revolute", "cap", f'<origin xyz="1 0 0"/><axis xyz="1 0 0"/>{limit(0, 0.2)}', "b"),
    )  # fmt: skip
    cap = obj.parts[1]
    assert cap.joint.angle == (0, 2) and len(cap.outer) == len(cap.inner) == 1
    opened = obj.shown_at([0, np.pi / 2]).parts[1]
    np.testing.assert_allclose(opened.outer[0].direction, [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(opened.inner[0].direction, [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(opened.inner[0].origin[0], 0, atol=1e-12)
    moved = obj.transformed(np.diag([2.0, 2, 2, 1])).parts[1]
    np.testing.assert_allclose(moved.outer[0].travel, (0, 0.2))


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
        joint("prismatic", "b", f'{limit(-9, 9)}<mimic joint="a_joint" multiplier="2" offset="1"/>'),  # noqa: E501
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

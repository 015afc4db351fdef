"""Joints that print, by boolean intersection: parts never touch along their range, and are held."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from manifold3d import Manifold, Mesh64
from print_objects import box, door_box, drawer_box, knob_box, print_of, printed

from uniart_jax.export.convex_split import triangles
from uniart_jax.export.printing.build import Print, PrintedJoint
from uniart_jax.export.printing.check import held, touching
from uniart_jax.export.printing.settings import PrintSettings
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part

NAMES = ["door", "drawer", "knob", "microwave:1", "storage_furniture:3"]
KINDS = {"door": "pin hinge", "drawer": "slide", "knob": "snap shaft"}


def moved(solid, matrix):
    """Not the code's own way to move a solid: its vertices."""
    vertices, faces = triangles(solid)
    vertices = vertices @ matrix[:3, :3].T + matrix[:3, 3]
    return Manifold(Mesh64(np.ascontiguousarray(vertices), np.ascontiguousarray(faces, np.uint64)))


def shifted(solid, way):
    return solid.translate(tuple(float(x) for x in way))


def trio(made: Print, joint: PrintedJoint):
    """(parent, child, pins) as pieces of the print."""
    by = {p.leader: p for p in reversed(made.pieces) if p.parts}
    child = by[joint.child]
    pins = [p.solid for p in made.pieces if p.name in joint.pins]
    return by[joint.parent].solid, child.solid, pins


@pytest.mark.parametrize(
    "name",
    [n if n in ("drawer", "knob") else pytest.param(n, marks=pytest.mark.slow) for n in NAMES],
)
def test_parts_do_not_touch_at_any_state(name):
    made = print_of(name)
    assert made.joints
    for joint in made.joints:
        parent, child, pins = trio(made, joint)
        assert len(pins) == len(joint.fit.pins)
        lo, hi = joint.joint.limits
        for q in np.linspace(lo, hi, 13):
            there = moved(child, joint.joint.motion(q))
            assert (there ^ parent).volume() < 1e-3, (name, joint.child, q)
            for pin in pins:
                assert (there ^ pin).volume() < 1e-3, (name, joint.child, q)


@pytest.mark.parametrize("name", NAMES)
def test_pieces_keep_their_clearance_at_rest(name):
    made = print_of(name)
    gap = made.settings.clearance
    for n, one in enumerate(made.pieces):
        for two in made.pieces[n + 1 :]:
            assert one.solid.min_gap(two.solid, 1.0) >= 0.9 * gap, (one.name, two.name)
    assert touching(made) == []


@pytest.mark.parametrize("name", NAMES)
def test_moving_parts_are_held(name):
    """Pulled three clearances along or off a turn's axis or past a slide's end, a part is
    stopped."""
    made = print_of(name)
    pull = 3 * made.settings.clearance
    for joint in made.joints:
        parent, child, pins = trio(made, joint)
        axis = joint.joint.direction
        first = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
        ways = [first, -first, np.cross(axis, first), -np.cross(axis, first)]
        if joint.joint.rotates:
            ways += [axis, -axis]
        lo, hi = joint.joint.limits
        for q in (lo, (lo + hi) / 2, hi):
            there = moved(child, joint.joint.motion(q))
            for way in ways:
                stopped = [(shifted(there, pull * way) ^ s).volume() for s in (parent, *pins)]
                assert max(stopped) > 1e-3, (name, joint.child, q, way)
        if not joint.joint.rotates:
            end = moved(child, joint.joint.motion(hi))
            assert (shifted(end, pull * axis) ^ parent).volume() > 1e-3
        for pin in pins:
            for way in (axis, -axis):
                assert (shifted(pin, pull * way) ^ parent).volume() > 1e-3, (name, joint.child)
        found = held(made, joint)  # and the report says so
        assert found.along and found.across and found.pins and not found.meets


@pytest.mark.parametrize("name", list(KINDS))
def test_each_kind_of_joint_gets_its_hardware(name):
    (joint,) = print_of(name).joints
    assert joint.fit.kind == KINDS[name]


def test_knuckles_alternate_along_the_axis():
    """Seen along the axis at a knuckle's height only one of the two has a ring about the pin."""
    made = print_of("door")
    (joint,) = made.joints
    parent, child, pins = trio(made, joint)
    assert len(pins) == 2
    origin, facts = joint.joint.origin, joint.fit.facts
    radius = (facts["hole_diameter"] + facts["knuckle_diameter"]) / 4
    angles = np.arange(8) * np.pi / 4
    owners = ""
    lo, hi = pins[0].bounding_box()[2::3]
    for z in np.arange(lo, hi, 0.25):
        ring = np.c_[radius * np.cos(angles), radius * np.sin(angles), np.full(8, z)]
        ring += [*origin[:2], 0]
        full = [all(_inside(solid, p) for p in ring) for solid in (parent, child)]
        assert not all(full)
        mark = "P" if full[0] else "C" if full[1] else ""
        owners += mark if not owners.endswith(mark) else ""
    assert owners == "PCP"


def _inside(solid, point) -> bool:
    hits = solid.ray_cast(tuple(point), tuple(point + np.array([1e-4, 2e-4, 500.0])))
    return len(hits) % 2 == 1


@pytest.mark.parametrize("clearance", [0.15, 0.5])
def test_the_clearance_is_the_one_that_was_asked_for(clearance):
    made = printed(knob_box(), PrintSettings(clearance=clearance))
    (joint,) = made.joints
    parent, child, _ = trio(made, joint)
    assert 0.9 * clearance <= child.min_gap(parent, 5.0) <= 1.1 * clearance


def test_a_part_that_would_fall_out_is_stopped_earlier_and_said_to_be():
    drawers = drawer_box()
    slide = dataclasses.replace(drawers.parts[1].joint, travel=(0.0, 0.69))
    far = dataclasses.replace(
        drawers, parts=(drawers.parts[0], dataclasses.replace(drawers.parts[1], joint=slide))
    )
    made = printed(far)
    (joint,) = made.joints
    assert 0.4 * 0.69 < joint.joint.travel[1] / (150 / 0.8) < 0.69
    assert any("'drawer': it opens" in note for note in made.notes)
    assert held(made, joint).along


def test_a_knob_that_is_too_small_is_fixed_and_said_to_be():
    made = printed(knob_box(radius=0.01))
    assert made.joints == () and [p.parts for p in made.pieces] == [("body", "knob")]
    assert len(made.pieces[0].solid.decompose()) == 1
    assert any("'knob' cannot be printed as a joint and is fixed" in note for note in made.notes)


def test_fixed_parts_are_one_piece_with_what_they_are_fixed_to():
    made = print_of("door")
    assert [p.parts for p in made.pieces if p.parts] == [("body",), ("door", "handle")]
    for piece in made.pieces:
        assert len(piece.solid.decompose()) == 1, piece.name


def test_a_handle_in_the_air_gets_a_strut():
    cupboard = door_box()
    mesh = cupboard.parts[2].mesh.copy()
    mesh.apply_translation([-0.02, 0, 0])
    parts = (*cupboard.parts[:2], dataclasses.replace(cupboard.parts[2], mesh=mesh))
    made = printed(dataclasses.replace(cupboard, parts=parts))
    assert any("'door': 1 piece hung in the air; 1 strut of up to 3.0 mm" in n for n in made.notes)
    assert all(len(p.solid.decompose()) == 1 for p in made.pieces)


def test_a_print_is_the_same_every_time():
    one, two = print_of("door"), printed(door_box())
    assert [p.name for p in one.pieces] == [p.name for p in two.pieces]
    for a, b in zip(one.pieces, two.pieces, strict=True):
        np.testing.assert_array_equal(triangles(a.solid)[0], triangles(b.solid)[0])


def test_a_part_that_another_would_take_whole_keeps_it_fixed():
    """Two large blades turn all round where the small hub that bears them is."""
    turn = Joint([0, 0, 0], [0, 0, 1], (-np.pi, np.pi))
    hub = Part("hub", box([-0.03] * 3, [0.03] * 3))
    blades = [
        Part(name, box([-0.5, -0.05, lo], [0.5, 0.05, hi]), 0, turn)
        for name, lo, hi in (("one", -0.04, 0.04), ("two", -0.05, 0.05))
    ]
    made = printed(ArticulatedObject((hub, *blades)))
    assert all(p.solid.volume() > 2 for p in made.pieces)
    assert any("and is fixed: on its way nothing would be left of 'hub'" in n for n in made.notes)


def test_a_part_within_another_is_fixed_and_nothing_is_lost():
    door, slide = door_box(), Joint([0, 0, 0], [-1, 0, 0], (0.0, 0.0), (0.0, 0.1))
    inside = Part("core", box([-0.33, -0.1, 0.4], [-0.31, 0.1, 0.6]), 0, slide)
    made = printed(ArticulatedObject((*door.parts, inside)))
    assert any("'core' cannot be printed as a joint and is fixed" in n for n in made.notes)


def test_what_a_joint_takes_of_a_part_is_told():
    made = printed(door_box(), PrintSettings(size=40.0))
    (note,) = [n for n in made.notes if "of 'door' were cut away" in n]
    assert note.endswith("so that it can move")

"""What a person sees at once: doors in the air, crumbs, loose pieces, drawers that cut through."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import trimesh

from uniart_jax import procedural
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.simulation import pieces
from uniart_jax.simulation.plausibility import plausibility
from uniart_jax.simulation.summary import is_plausible, is_sound, stands, summary

CHECKS = ["attached", "crumb", "free", "plausible"]
HINGE = Joint([-0.3, -0.4, 0], [0, 0, 1], (0, 1.6))  # the door's edge, at the right


def block(lo, hi) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[lo, hi])


def joined(*meshes) -> trimesh.Trimesh:
    return trimesh.util.concatenate(meshes)


def shell() -> trimesh.Trimesh:
    """A cabinet open to -x, walls .04 thick, a shelf at half height."""
    outer = block([-0.3, -0.4, -0.5], [0.3, 0.4, 0.5])
    rooms = [block([-0.4, -0.36, z], [0.26, 0.36, z + 0.44]) for z in (-0.46, 0.02)]
    return trimesh.boolean.difference([outer, *rooms], engine="manifold")


def drawer(half: float = 0.35) -> trimesh.Trimesh:
    outer = block([-0.32, -half, -0.45], [0.2, half, -0.1])
    inner = block([-0.3, 0.03 - half, -0.43], [0.18, half - 0.03, 0])
    return trimesh.boolean.difference([outer, inner], engine="manifold")


def cabinet(door=None, hinge=HINGE, half=0.35, travel=0.35, *more: Part) -> ArticulatedObject:
    door = block([-0.34, -0.4, 0], [-0.301, 0.4, 0.5]) if door is None else door
    slide = Joint([0, 0, 0], [-1, 0, 0], (0, 0), (0, travel))
    return ArticulatedObject(
        (
            Part("body", shell()),
            Part("door", door, 0, hinge),
            Part("drawer", drawer(half), 0, slide),
            *more,
        )
    )


def failed(obj: ArticulatedObject) -> dict[str, str]:
    found = plausibility(obj)
    assert list(found) == CHECKS
    return {name: c.get("reason", "") for name, c in found.items() if not c["passed"]}


def test_a_cabinet_is_plausible_whatever_it_shows():
    obj = cabinet()
    assert failed(obj) == {}
    assert failed(obj.shown_at(obj.open(0.5))) == {}
    metres = obj.transformed(np.diag([3.0, 3, 3, 1]))
    assert failed(metres) == {}


@pytest.mark.parametrize("family", procedural.SEEN_FAMILIES)
def test_true_objects_are_plausible(family):
    assert failed(procedural.generate(family, 900_001)) == {}


def test_a_door_in_the_air():
    door = block([-0.44, -0.4, 0], [-0.401, 0.4, 0.5])
    hinge = dataclasses.replace(HINGE, origin=[-0.4, -0.4, 0])
    found = failed(cabinet(door, hinge))
    assert "'door' hangs in the air at rest, 0.1" in found["attached"]
    assert "a piece of 'door' floats" in found["free"]
    assert set(found) == {"attached", "free"}


def test_a_drawer_that_leaves_its_cabinet():
    found = failed(cabinet(travel=0.7))
    assert set(found) == {"attached"}
    assert "'drawer' hangs in the air at 75% of its way, 0.02" in found["attached"]


@pytest.mark.parametrize(("clear", "held"), [(0.04, True), (0.08, False)])
def test_a_drawer_on_no_rails(clear, held):
    """Its front lies on the frame; behind it, its box keeps clear of the room on all sides."""
    front = block([-0.34, -0.38, -0.48], [-0.301, 0.38, 0.0])
    box = block([-0.301, clear - 0.36, clear - 0.46], [0.2, 0.36 - clear, -0.02 - clear])
    slide = Joint([0, 0, 0], [-1, 0, 0], (0, 0), (0, 0.35))
    body = cabinet().parts[0]
    found = failed(ArticulatedObject((body, Part("drawer", joined(front, box), 0, slide))))
    assert held == (found == {})
    assert held or "'drawer' hangs in the air at 25% of its way, 0.0" in found["attached"]


def test_an_axis_out_of_reach():
    """The door is where it should be and turns about a line beside the cabinet."""
    found = failed(cabinet(hinge=dataclasses.replace(HINGE, origin=[-0.3, -0.65, 0])))
    assert "'door' turns about an axis that is 0.250 off it" in found["attached"]
    near = failed(cabinet(hinge=dataclasses.replace(HINGE, origin=[-0.3, -0.42, 0])))
    assert near == {}


def test_a_lid_turns_about_a_line_that_nothing_touches():
    """The axis of a round lid is inside the jar, far from its wall."""
    jar = trimesh.creation.annulus(0.3, 0.33, 1.0)
    floor = trimesh.creation.cylinder(0.32, 0.03).apply_translation([0, 0, -0.49])
    ring = trimesh.creation.annulus(0.2, 0.33, 0.05).apply_translation([0, 0, 0.527])
    lid = Joint([0, 0, 0], [0, 0, 1], (0, 6.0), (0, 0.2))  # it comes off
    obj = ArticulatedObject((Part("jar", joined(jar, floor)), Part("lid", ring, 0, lid)))
    assert failed(obj) == {}
    aside = dataclasses.replace(lid, origin=[0.6, 0, 0])
    obj = ArticulatedObject((Part("jar", joined(jar, floor)), Part("lid", ring, 0, aside)))
    assert "turns about an axis" in failed(obj)["attached"]


def test_loose_pieces():
    speck = block([-0.5, 0, 0.2], [-0.45, 0.05, 0.25])
    door = joined(block([-0.34, -0.4, 0], [-0.301, 0.4, 0.5]), speck)
    found = failed(cabinet(door))
    assert set(found) == {"free"} and "a piece of 'door' floats, 0.1" in found["free"]


def test_a_piece_within_a_solid_does_not_float():
    box, core = block([-0.3, -0.4, -0.3], [0.3, 0.4, 0.2]), block([-0.1] * 3, [0.0] * 3)
    lid = Part("lid", block([-0.3, -0.4, 0.205], [0.3, 0.4, 0.25]), 0)
    assert failed(ArticulatedObject((Part("box", joined(box, core)), lid))) == {}
    hollow = trimesh.boolean.difference([box, block([-0.2] * 3, [0.1] * 3)], engine="manifold")
    found = failed(ArticulatedObject((Part("box", joined(hollow, core)), lid)))
    assert set(found) == {"free"}


def test_parts_that_float_together():
    """Each touches the other, and nothing else does."""
    one, two = block([-0.6, 0, 0], [-0.5, 0.1, 0.1]), block([-0.6, 0, 0.1], [-0.5, 0.1, 0.2])
    found = failed(cabinet(None, HINGE, 0.35, 0.35, Part("one", one, 0), Part("two", two, 0)))
    assert set(found) == {"free"} and "'one', 'two' floats" in found["free"]


@pytest.mark.parametrize(
    ("size", "passes"),
    [
        ((0.03, 0.03, 0.03), True),  # a button
        ((0.02, 0.3, 0.02), True),  # a bar
        ((0.008, 0.3, 0.2), True),  # a plate
        ((0.01, 0.01, 0.01), False),  # a speck
    ],
)
def test_small_parts(size, passes):
    lo = np.array([-0.34, 0, 0.2]) - [size[0], 0, 0]
    part = Part("small", block(lo, lo + size), 1)
    found = failed(cabinet(None, HINGE, 0.35, 0.35, part))
    assert (found == {}) == passes
    if not passes:
        assert set(found) == {"crumb"} and found["crumb"].startswith("'small' is a crumb, 0.0")


def test_discs_and_flakes():
    """Of the same thickness; a flake is what fills little of its box."""
    turn = trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0])
    turn[:3, 3] = [-0.343, 0, 0.3]
    disc = trimesh.creation.cylinder(0.035, 0.006, transform=turn)
    assert failed(cabinet(None, HINGE, 0.35, 0.35, Part("dial", disc, 1))) == {}
    corners = np.array([[0, 0], [0.07, 0.03], [0.02, 0.02], [0.01, 0.05]])
    flake = trimesh.creation.extrude_polygon(trimesh.path.polygons.Polygon(corners), 0.006)
    flake.apply_transform(turn)
    found = failed(cabinet(None, HINGE, 0.35, 0.35, Part("flake", flake, 1)))
    assert set(found) == {"crumb"}


def test_a_drawer_that_cuts_through_its_cabinet():
    found = failed(cabinet(half=0.385))
    assert set(found) == {"plausible"}
    assert "of 'drawer' is inside other parts at rest" in found["plausible"]


def test_a_lid_that_turns_into_its_box():
    box = block([-0.3, -0.4, -0.3], [0.3, 0.4, 0.2])
    lid = block([-0.3, -0.4, 0.205], [0.3, 0.4, 0.25])
    for sign, names in ((1, set()), (-1, {"plausible"})):
        joint = Joint([0.3, 0, 0.205], [0, sign, 0], (0, 1.4))
        found = failed(ArticulatedObject((Part("box", box), Part("lid", lid, 0, joint))))
        assert set(found) == names


def test_what_is_behind_a_door_may_come_out_once_it_is_open():
    tray = block([-0.28, -0.3, 0.05], [0.2, 0.3, 0.2])
    slide = Joint([0, 0, 0], [-1, 0, 0], (0, 0), (0, 0.3))
    foot = block([-0.28, -0.37, 0.05], [0.2, 0.37, 0.06])  # rests in the cabinet's walls
    pulled = Part("tray", joined(tray, foot), 0, slide)
    assert failed(cabinet(None, HINGE, 0.35, 0.35, pulled)) == {}
    fixed = cabinet(None, Joint.fixed(), 0.35, 0.35, pulled)
    assert set(failed(fixed)) == {"plausible"}


def verdict(**groups: dict[str, bool]) -> dict[str, dict]:
    return {g: {n: {"passed": p} for n, p in checks.items()} for g, checks in groups.items()}


def test_the_summary_says_both_apart():
    good = {"loads": True, "stands": True}
    found = verdict(mujoco=good, geometry={"gaps": True}, plausibility={"attached": True})
    assert summary(found) == "loads and stands: yes; plausible: yes"
    found = verdict(mujoco=good, geometry={"gaps": True}, plausibility={"attached": False})
    assert stands(found) and not is_plausible(found)
    assert summary(found) == "loads and stands: yes; plausible: no (attached)"
    result = {"engines": {"mujoco": found["mujoco"]}, **found}
    assert not is_sound(result)
    bad = {"loads": True, "sweep": False}
    found = verdict(mujoco=bad, geometry={"gaps": True}, plausibility={"attached": True})
    assert summary(found) == "loads and stands: no (mujoco sweep); plausible: yes"


def test_nothing_is_praised_that_was_not_looked_at():
    found = verdict(mujoco={"loads": True}, geometry={"reads": False}, plausibility={})
    assert not is_plausible(found)
    assert summary(found).endswith("plausible: no (it could not be judged)")
    found = verdict(geometry={"gaps": True}, plausibility={"attached": True})
    assert summary(found) == "loads and stands: no (no engine ran); plausible: yes"


def test_heaps_of_pieces(monkeypatch):
    """One of 400 screws lies far off; where there are too many to look at each, it is not seen."""
    rng = np.random.default_rng(0)
    at = rng.uniform([-0.2, -0.2, 0.1], [0.1, 0.2, 0.12], (400, 3))
    at[7] = [0, 0, 0.35]
    one, count = trimesh.creation.box([0.03] * 3), np.arange(len(at))[:, None, None]
    faces = (one.faces + len(one.vertices) * count).reshape(-1, 3)
    heap = trimesh.Trimesh((one.vertices + at[:, None]).reshape(-1, 3), faces, process=False)
    tray = block([-0.28, -0.3, 0.03], [0.2, 0.3, 0.1])
    parts = Part("tray", tray, 0), Part("heap", heap, 0)
    obj = cabinet(None, HINGE, 0.35, 0.35, *parts)
    assert failed(obj)["free"].startswith("a piece of 'heap' floats, 0.09")
    monkeypatch.setattr(pieces, "MANY", 300)
    assert "free" not in failed(obj)

"""What parts are to their users, on procedural objects whose parts are labelled."""

from __future__ import annotations

import collections

import numpy as np
import trimesh

from uniart_jax import procedural
from uniart_jax.export.part_kinds import part_kinds
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part

SAME = {"detergent_drawer": "drawer", "body": "base", "flap": "door"}


def test_kinds_of_labelled_parts():
    found = collections.Counter()
    for family in procedural.SEEN_FAMILIES:
        for seed in (900_011, 900_012, 900_013):
            obj = procedural.generate(family, seed)
            kinds = part_kinds(obj)
            assert kinds[obj.parents.index(-1)] == "base"
            for part, kind in zip(obj.parts, kinds, strict=True):
                if part.parent >= 0 and part.label in ("door", "drawer", "knob", "rack", *SAME):
                    found[SAME.get(part.label, part.label) == kind] += 1
    assert found[True] >= 0.9 * found.total() > 30


def box(lo, hi) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[lo, hi])


def chest(part: Part) -> ArticulatedObject:
    return ArticulatedObject((Part("a", box([-0.3, -0.4, -0.5], [0.3, 0.4, 0.4])), part))


def kind(mesh: trimesh.Trimesh, joint: Joint) -> str:
    return part_kinds(chest(Part("b", mesh, 0, joint)))[1]


def test_rules():
    plate = box([-0.33, -0.4, -0.5], [-0.3, 0.4, 0.4])
    upright, down = (
        Joint([-0.3, 0.4, 0], [0, 0, 1], (-1.5, 0)),
        Joint([-0.3, 0, -0.5], [0, 1, 0], (-1.5, 0)),
    )
    assert kind(plate, upright) == kind(plate, down) == "door"
    assert kind(plate, Joint([-0.3, 0.05, 0], [0, 0, 1], (0, 1.5))) == "hinge"  # about its middle
    cover = box([-0.3, -0.4, 0.4], [0.3, 0.4, 0.43])
    assert kind(cover, Joint([0.3, 0, 0.4], [0, 1, 0], (0, 1.5))) == "lid"
    out = Joint([0, 0, 0], [-1, 0, 0], (0, 0), (0, 0.4))
    assert kind(box([-0.33, -0.3, -0.2], [0.2, 0.3, 0.1]), out) == "drawer"
    press = Joint([0, 0, 0], [1, 0, 0], (0, 0), (0, 0.01))
    assert kind(box([-0.32, 0, 0], [-0.29, 0.05, 0.05]), press) == "button"
    up = Joint([0, 0, 0], [0, 0, 1], (0, 0), (0, 0.4))
    assert kind(box([-0.3, -0.4, 0.4], [0.3, 0.4, 0.45]), up) == "slider"
    endless = (-np.pi, np.pi)
    disc = trimesh.creation.cylinder(0.2, 0.02)
    assert kind(disc, Joint([0, 0, 0], [0, 0, 1], endless)) == "turntable"
    tall = trimesh.creation.cylinder(0.2, 0.5)
    assert kind(tall, Joint([0, 0, 0], [0, 0, 1], endless)) == "drum"
    assert kind(box([0.2, 0.2, -0.6], [0.25, 0.25, -0.5]), Joint.fixed()) == "fixed"


def test_a_rack_is_behind_a_door_and_a_handle_before_one():
    body = Part("a", box([-0.3, -0.4, -0.5], [0.3, 0.4, 0.4]))
    door = Part(
        "b",
        box([-0.33, -0.4, -0.5], [-0.3, 0.4, 0.4]),
        0,
        Joint([-0.3, 0.4, 0], [0, 0, 1], (-1.5, 0)),
    )
    rack = Part(
        "c",
        box([-0.25, -0.3, -0.2], [0.2, 0.3, 0]),
        0,
        Joint([0, 0, 0], [-1, 0, 0], (0, 0), (0, 0.4)),
    )
    bar = Part("d", box([-0.36, -0.35, -0.1], [-0.33, -0.33, 0.1]), 1)
    obj = ArticulatedObject((body, door, rack, bar))
    assert part_kinds(obj) == ["base", "door", "rack", "handle"]

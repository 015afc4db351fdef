"""Microwaves, dishwashers and washing machines: what moves on them, and that it clears what it
stands on."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from overlaps import check_clear, check_closed, loose
from test_cooker import kind

from uniart_jax.procedural import built_in_appliance
from uniart_jax.voxels.joint_code import TRAVEL_DEAD_ZONE

COUNT = 60


@pytest.fixture(scope="module")
def appliances():
    build = built_in_appliance.build
    return [build(np.random.default_rng(seed)).normalized() for seed in range(COUNT)]


def test_appliances_are_closed_and_clear(appliances):
    for seed, obj in enumerate(appliances):
        check_closed(obj, f"built_in_appliance {seed}")
        check_clear(obj, f"built_in_appliance {seed}")


def test_bodies_are_in_one_piece(appliances):
    for seed, obj in enumerate(appliances):
        assert not loose(obj.parts[0].mesh, 6e-4), f"built_in_appliance {seed}"


def test_appliances_have_what_real_ones_have(appliances):
    counts = Counter(kind(part) for obj in appliances for part in obj.parts)
    wanted = ("door revolute", "lid revolute", "turntable continuous", "drawer prismatic",
              "rack prismatic", "button prismatic", "knob continuous")  # fmt: skip
    assert min(counts[k] for k in wanted) > 0


def test_buttons_go_in_by_what_counts_as_motion(appliances):
    travels = [
        part.joint.travel[1]
        for obj in appliances
        for part in obj.parts
        if part.name.startswith("button")
    ]
    assert len(travels) > 20 and min(travels) > TRAVEL_DEAD_ZONE


def test_lids_turn_about_the_rear_or_a_side(appliances):
    lids = [part for obj in appliances for part in obj.parts if part.name == "lid"]
    for lid in lids:
        raised = lid.joint.motion(lid.joint.limits[1])[:3, :3]
        middle = lid.mesh.bounds.mean(0) - lid.joint.origin
        assert (raised @ middle)[2] > middle[2]  # opens upwards

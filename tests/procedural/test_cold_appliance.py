"""Refrigerators, coolers and freezers: what they promise beyond what all families do."""

from __future__ import annotations

import functools
from collections import Counter

import numpy as np
from overlaps import check_clear, check_closed, loose

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.procedural import BOX_SEPARATION, box_separation, cold_appliance


@functools.cache
def build(seed: int) -> ArticulatedObject:
    return cold_appliance.build(np.random.default_rng([seed, 6])).normalized()


def objects(count: int) -> list[ArticulatedObject]:
    made = [build(seed) for seed in range(count)]
    return [obj for obj in made if box_separation(obj) > BOX_SEPARATION]


def test_parts_are_closed_and_clear_of_what_carries_them():
    for number, obj in enumerate(objects(40)):
        check_closed(obj, f"cold_appliance {number}")
        check_clear(obj, f"cold_appliance {number}")


def test_bodies_stand_on_their_feet_rounded_ones_too():
    for number, obj in enumerate(objects(60)):
        if all(part.label != "shelf" for part in obj.parts):  # goods stand on shelves
            assert not loose(obj.parts[0].mesh, 2e-3), f"cold_appliance {number}"


def test_handles_are_fixed_parts_of_the_doors_that_carry_them():
    made = objects(100)
    held = 0
    for obj in made:
        for k, part in enumerate(obj.parts):
            if part.label == "handle":
                held += 1
                assert part.joint.type == "fixed"
                assert obj.parts[part.parent].joint.type != "fixed"
                assert part.mesh.bounds[0, 0] < obj.parts[part.parent].mesh.bounds[0, 0]
            if part.label == "shelf":
                assert part.joint.type == "fixed" and part.parent == 0 and k > 0
    fixed = [sum(p.parent >= 0 and p.joint.type == "fixed" for p in obj.parts) for obj in made]
    assert held > 60
    assert 0.5 < np.mean(np.array(fixed) > 0) < 0.95
    assert max(fixed) >= 4


def test_doors_swing_wide_and_lids_rise():
    made = objects(100)
    labels = Counter(part.label for obj in made for part in obj.parts)
    assert all(labels[name] for name in ("door", "drawer", "lid", "shelf"))
    wide = []
    for obj in made:
        for part in obj.parts:
            if part.label == "door":
                assert abs(part.joint.direction[2]) > 0.99
                wide.append(np.abs(part.joint.limits).max() > np.deg2rad(150))
            if part.label == "lid" and part.joint.type == "revolute":
                far = part.joint.limits[np.abs(part.joint.limits).argmax()]
                centre = [*part.mesh.bounds.mean(0), 1.0]
                assert (part.joint.motion(far) @ centre)[2] > centre[2] + 0.02
    assert 0.2 < np.mean(wide) < 0.8

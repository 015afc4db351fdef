"""Perturbed parts: solid as before, and on their hinges."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from uniart_jax import procedural
from uniart_jax.objects.kinematics import JOINT_TYPES, Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.objects.perturb import (
    draw_joint,
    part_factors,
    scale_parts,
)

FAMILIES = ("storage_furniture", "table", "oven", "washer", "laptop", "bottle", "swivel_chair")


def perturbed(family, seed=0, strength=0.3):
    obj = procedural.generate(family, seed)
    factors = part_factors(obj, np.random.default_rng(seed), strength)
    return obj, factors, scale_parts(obj, factors)


def carried(obj, scaled, k, points):
    """Where material points of part k went, read off its own box: part k was stretched along the
    axes."""
    old, new = obj.boxes[k], scaled.boxes[k]
    return new[:3] + (points - old[:3]) / old[3:] * new[3:]


@pytest.mark.parametrize("family", FAMILIES)
def test_hinges_stay_attached(family):
    obj, _, scaled = perturbed(family)
    for k, (old, new) in enumerate(zip(obj.joints, scaled.joints, strict=True)):
        assert old.type == new.type and old.angle == new.angle
        if not old.rotates:
            continue
        offset = obj.boxes[k, :3] - old.origin
        anchor = old.origin + (offset @ old.direction) * old.direction
        line = anchor + np.array([[0.0], [0.1], [-0.3]]) * old.direction
        both = [carried(obj, scaled, n, line) for n in (k, obj.parents[k])]
        assert np.allclose(both[0][0], both[1][0], atol=1e-9)  # the anchor itself
        for points in both:
            apart = points - new.origin
            apart = apart - (apart @ new.direction)[:, None] * new.direction
            assert np.abs(apart).max() < 1e-9


@pytest.mark.parametrize("family", FAMILIES)
def test_hinges_stay_attached_in_every_state(family):
    _, _, scaled = perturbed(family)
    rng = np.random.default_rng(1)
    q = np.array([rng.uniform(*joint.limits) for joint in scaled.joints])
    moved = scaled.forward_kinematics(q)
    for k, joint in enumerate(scaled.joints):
        if not joint.rotates:
            continue
        child, parent = (
            trimesh.transform_points([joint.origin], moved[n])[0] for n in (k, scaled.parents[k])
        )
        axis = moved[scaled.parents[k]][:3, :3] @ joint.direction
        assert np.allclose(child, parent + axis * joint.pitch * q[k], atol=1e-9)


@pytest.mark.parametrize("family", FAMILIES)
def test_parts_stay_solid(family):
    obj, factors, scaled = perturbed(family)
    side = scaled.scale / obj.scale
    stretch = factors.copy()
    for k, (part, new) in enumerate(zip(obj.parts, scaled.parts, strict=True)):
        if part.parent >= 0:
            stretch[k] *= stretch[part.parent]
        assert new.mesh.is_watertight and new.mesh.is_winding_consistent
        expected = part.mesh.volume * stretch[k].prod() / side**3
        assert new.mesh.volume == pytest.approx(expected, rel=1e-6)
        assert (new.name, new.parent, new.label) == (part.name, part.parent, part.label)
    assert np.abs(scaled.bounds).max() == pytest.approx(0.5)


def two_boxes(joint) -> ArticulatedObject:
    body = trimesh.creation.box([1, 0.6, 0.8])
    lid = trimesh.creation.box(
        [0.2, 0.6, 0.1], trimesh.transformations.translation_matrix([0.1, 0, 0.45])
    )
    knob = trimesh.creation.box(
        [0.1, 0.1, 0.1], trimesh.transformations.translation_matrix([0.1, 0, 0.55])
    )
    parts = Part("body", body), Part("lid", lid, 0, joint), Part("knob", knob, 1)
    return ArticulatedObject(parts).normalized()


def test_a_part_takes_along_what_it_carries():
    drawer = Joint([0, 0, 0], [1, 0, 0], travel=(-0.2, 0.3))
    obj = two_boxes(drawer)
    scaled = scale_parts(obj, [1, 0.5, 1])
    assert scaled.scale == pytest.approx(obj.scale * np.ptp(scaled.bounds[:, 0]) * 1.0)
    grown = 1 / (scaled.scale / obj.scale)
    assert np.allclose(
        scaled.boxes[:, 3:], obj.boxes[:, 3:] * grown * np.array([[1], [0.5], [0.5]])
    )
    assert np.allclose(scaled.joints[1].travel, np.array(obj.joints[1].travel) * 0.5 * grown)
    # the lid still lies on the body, the knob on the lid
    floor = scaled.boxes[:, 2] - scaled.boxes[:, 5] / 2
    top = scaled.boxes[:, 2] + scaled.boxes[:, 5] / 2
    assert floor[1:] == pytest.approx(top[:-1])


def test_the_root_alone_stretches_the_whole():
    obj = two_boxes(Joint([0, 0, 0.4], [0, 1, 0], angle=(0, 1)))
    same = scale_parts(obj, [1.7, 1, 1])
    assert np.allclose(same.boxes, obj.boxes) and same.scale == pytest.approx(1.7 * obj.scale)
    wide = scale_parts(obj, [[1, 2, 1], [1, 1, 1], [1, 1, 1]])
    shape = wide.boxes[:, 3:] / obj.boxes[:, 3:] * wide.scale / obj.scale
    assert np.allclose(shape, [1, 2, 1])


def test_what_would_turn_an_axis_is_refused():
    crooked = two_boxes(Joint([0, 0, 0.4], [0, 1, 1], angle=(0, 1)))
    uneven = np.ones((3, 3))
    for k in (0, 1):
        factors = uneven.copy()
        factors[k, 1] = 1.3
        with pytest.raises(ValueError, match=r"part 'lid': its axis .* would be turned"):
            scale_parts(crooked, factors)
    uneven[0] = 1.3, 1.1, 1.1
    scale_parts(crooked, uneven)
    with pytest.raises(ValueError, match=r"shape \(3,\) or \(3, 3\)"):
        scale_parts(crooked, [1, 1])
    for bad in (0, -1, np.nan):
        with pytest.raises(ValueError, match="above 0"):
            scale_parts(crooked, [1, bad, 1])


@pytest.mark.parametrize(
    ("joint", "equal"),
    [
        (Joint([0, 0, 0], [0, 0, 1], angle=(0, 1)), []),
        (Joint([0, 0, 0], [0, 1, 0], travel=(0, 1)), []),
        (Joint([0, 0, 0], [0, 0, 1], angle=(-np.pi, np.pi)), [(0, 1)]),
        (Joint([0, 0, 0], [1, 0, 0], angle=(0, 12), travel=(0, -0.1)), [(1, 2)]),
        (Joint([0, 0, 0], [1, 0, -1], travel=(0, 1)), [(0, 2)]),
        (Joint([0, 0, 0], [1, 0, -1], angle=(-np.pi, np.pi)), [(0, 1), (1, 2)]),
        (Joint([0, 0, 0], [1, 1, 1], angle=(0, 1)), [(0, 1), (1, 2)]),
        (Joint.fixed(), []),
    ],
)
def test_drawn_factors_fit_the_joints(joint, equal):
    obj = two_boxes(joint)
    factors = part_factors(obj, np.random.default_rng(0), 0.25)
    assert factors.shape == (3, 3) and (factors <= 1.25).all() and (factors >= 1 / 1.25).all()
    for k in (0, 1):  # what carries the joint
        pairs = [(a, b) for a, b in ((0, 1), (0, 2), (1, 2)) if factors[k, a] == factors[k, b]]
        implied = [(0, 1), (0, 2), (1, 2)] if len(equal) == 2 else equal
        assert pairs == implied
    assert len(set(factors[2])) == 3  # the knob carries nothing
    assert np.array_equal(part_factors(obj, np.random.default_rng(0), 0), np.ones((3, 3)))


@pytest.mark.parametrize(
    ("angle", "travel", "before", "after"),
    [
        ((0, 0), (-0.001, 0.005), "prismatic", "fixed"),
        ((-0.5, 1), (0.002, -0.004), "screw", "revolute"),
        ((-4, 8), (-0.002, 0.004), "screw", "continuous"),
    ],
)
def test_travel_that_becomes_too_small_to_be_any(angle, travel, before, after):
    meshes = [trimesh.creation.box([1, 0.5, 0.5]), trimesh.creation.box([0.2, 0.2, 0.7])]
    joint = Joint([0.1, 0.2, 0], [0, 0, 1], angle, travel)
    obj = ArticulatedObject((Part("a", meshes[0]), Part("b", meshes[1], 0, joint)))
    assert obj.joints[1].type == before
    assert scale_parts(obj, [1.0, 0.5]).joints[1].type == after


def test_drawn_joints_are_of_every_type_and_within_reach():
    rng, box = np.random.default_rng(0), np.array([0.1, -0.2, 0.3, 0.2, 0.4, 0.6])
    joints = [draw_joint(box, rng) for _ in range(1000)]
    share = {kind: np.mean([j.type == kind for j in joints]) for kind in JOINT_TYPES}
    assert all(0.15 < value < 0.25 for value in share.values())
    turning = [j for j in joints if j.rotates]
    assert all((np.abs(j.origin - box[:3]) <= 0.6 * box[3:]).all() for j in turning)
    straight = np.mean([np.isclose(np.abs(j.direction).max(), 1) for j in turning])
    assert 0.4 < straight < 0.6
    ends = [0 in j.limits for j in joints if j.type in ("revolute", "prismatic", "screw")]
    assert 0.7 < np.mean(ends) < 0.9
    left = np.mean([j.pitch < 0 for j in joints if j.type == "screw"])
    assert 0.35 < left < 0.65

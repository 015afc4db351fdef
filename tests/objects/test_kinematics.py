"""Joints and forward kinematics, against MuJoCo where it can say the same."""

from __future__ import annotations

import subprocess
import sys

import mujoco
import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from uniart_jax.objects.kinematics import (
    TRAVEL_DEAD_ZONE,
    Joint,
    codable,
    forward_kinematics,
    line_distance,
    rotation,
    topological_order,
)

KINDS = ("fixed", "revolute", "continuous", "prismatic", "screw")
seeds = st.integers(0, 2**32 - 1)


def random_joint(rng: np.random.Generator, kind: str | None = None) -> Joint:
    kind = kind or KINDS[rng.integers(len(KINDS))]
    origin, direction = rng.uniform(-0.5, 0.5, 3), rng.normal(size=3)
    lo, hi = -rng.uniform(0, 1), rng.uniform(0.1, 1)
    if kind == "fixed":
        return Joint.fixed()
    if kind == "revolute":
        return Joint(origin, direction, angle=(2 * lo, 2 * hi))
    if kind == "continuous":
        return Joint(origin, direction, angle=(-np.pi, np.pi))
    if kind == "prismatic":
        return Joint(origin, direction, travel=(lo / 2, hi / 2))
    turns, pitch = rng.uniform(1, 8), rng.uniform(0.02, 0.2) * rng.choice([-1, 1])
    angle = np.array([lo, hi]) * turns
    return Joint(origin, direction, tuple(angle), tuple(angle * pitch))


def random_tree(rng: np.random.Generator, count: int) -> tuple[list[int], list[Joint]]:
    parents = [-1, *[int(rng.integers(0, k)) for k in range(1, count)]]
    return parents, [Joint.fixed(), *[random_joint(rng) for _ in range(count - 1)]]


def random_similarity(rng: np.random.Generator, mirror: bool) -> np.ndarray:
    matrix = np.eye(4)
    direction = rng.normal(size=3)
    linear = rotation(direction / np.linalg.norm(direction), rng.uniform(-3, 3))
    if mirror:
        linear = linear @ np.diag([1.0, -1.0, 1.0])
    matrix[:3, :3] = linear * rng.uniform(0.3, 3)
    matrix[:3, 3] = rng.uniform(-1, 1, 3)
    return matrix


def mujoco_transforms(parents: list[int], joints: list[Joint], q: np.ndarray) -> np.ndarray:
    """The same tree in MuJoCo: every body's frame is the object frame at q = 0, a screw is a slide
    and a hinge."""
    spec = mujoco.MjSpec()
    bodies, names = [], []
    for k, parent in enumerate(parents):
        above = spec.worldbody if parent < 0 else bodies[parent]
        body = above.add_body(name=f"b{k}", mass=1, inertia=[1, 1, 1])
        bodies.append(body)
        joint = joints[k]
        if parent >= 0 and joint.travels:
            body.add_joint(name=f"s{k}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=joint.direction)
            names.append((f"s{k}", k, joint.pitch))
        if parent >= 0 and joint.rotates:
            kind = mujoco.mjtJoint.mjJNT_HINGE
            body.add_joint(name=f"h{k}", type=kind, axis=joint.direction, pos=joint.origin)
            names.append((f"h{k}", k, 1.0))
    model = spec.compile()
    data = mujoco.MjData(model)
    for name, k, rate in names:
        data.joint(name).qpos[0] = q[k] * rate
    mujoco.mj_kinematics(model, data)
    out = np.tile(np.eye(4), (len(parents), 1, 1))
    for k in range(len(parents)):
        out[k, :3, :3] = data.body(f"b{k}").xmat.reshape(3, 3)
        out[k, :3, 3] = data.body(f"b{k}").xpos
    return out


@pytest.mark.parametrize("seed", range(12))
def test_forward_kinematics_equals_mujoco(seed):
    rng = np.random.default_rng(seed)
    parents, joints = random_tree(rng, 8)
    q = np.array([rng.uniform(*j.limits) for j in joints])
    np.testing.assert_allclose(
        forward_kinematics(parents, joints, q), mujoco_transforms(parents, joints, q), atol=1e-9
    )


def test_a_chain_carries_what_hangs_below():
    hinge = Joint([0, 0, 0], [0, 0, 1], angle=(0, np.pi))
    slide = Joint([0, 0, 0], [1, 0, 0], travel=(0, 1))
    moved = forward_kinematics(
        [-1, 0, 1], [Joint.fixed(), hinge, slide], np.array([0, np.pi / 2, 0.5])
    )
    np.testing.assert_allclose(moved[2] @ [1, 0, 0, 1], [0, 1.5, 0, 1], atol=1e-12)


@pytest.mark.parametrize("hand", [1, -1])
def test_screws_have_a_hand(hand):
    joint = Joint([0.1, 0, 0], [0, 0, 2], angle=(0, 2 * np.pi), travel=(0, hand * 0.1))
    assert joint.type == "screw"
    quarter = joint.motion(np.pi / 2)
    np.testing.assert_allclose(quarter @ [1.1, 0, 0, 1], [0.1, 1, hand * 0.025, 1], atol=1e-12)


@given(seeds, st.sampled_from(KINDS[1:]), st.booleans())
def test_a_moved_joint_moves_what_was_moved(seed, kind, mirror):
    """transformed(M) conjugates the motion by M, up to the direction of q, which a mirror keeps
    too."""
    rng = np.random.default_rng(seed)
    joint, matrix = random_joint(rng, kind), random_similarity(rng, mirror)
    moved = joint.transformed(matrix)
    scale = abs(np.linalg.det(matrix[:3, :3])) ** (1 / 3)
    q = rng.uniform(*joint.limits)
    expected = matrix @ joint.motion(q) @ np.linalg.inv(matrix)
    np.testing.assert_allclose(moved.motion(q if joint.rotates else q * scale), expected, atol=1e-8)
    assert moved.type == joint.type
    assert moved.dead_zone == pytest.approx(joint.dead_zone * scale)


@given(seeds, st.sampled_from(KINDS))
def test_shown_at_measures_from_another_state(seed, kind):
    rng = np.random.default_rng(seed)
    joint = random_joint(rng, kind)
    q = rng.uniform(*joint.limits)
    shown = joint.shown_at(q)
    lo, hi = shown.limits
    assert lo <= 1e-9 and hi >= -1e-9
    if kind != "continuous":
        np.testing.assert_allclose(np.add(shown.limits, q), joint.limits, atol=1e-12)
        further = rng.uniform(*shown.limits)
        np.testing.assert_allclose(
            shown.motion(further) @ joint.motion(q), joint.motion(q + further), atol=1e-9
        )


def test_the_type_is_read_off_the_spans():
    def kind(**spans):
        return Joint(np.zeros(3), [1, 0, 0], **spans).type

    assert kind() == "fixed"
    assert kind(angle=(-0.5, 1)) == "revolute"
    assert kind(angle=(0, 6.4)) == "continuous"
    assert kind(travel=(0, 0.3)) == "prismatic"
    assert kind(angle=(0, 12), travel=(0, -0.3)) == "screw"
    assert kind(angle=(0, 0.001), travel=(0, 0.3)) == "prismatic"
    assert kind(angle=(0, 0.001), travel=(0, -0.3)) == "prismatic"
    assert kind(angle=(0, 1), travel=(0, 0.9e-4)) == "revolute"
    assert kind(travel=(0, 0.9e-4)) == "fixed" and kind(travel=(0, 1e-4)) == "prismatic"
    assert kind(angle=(0, np.deg2rad(0.1))) == "revolute"
    assert Joint(np.zeros(3), [1, 0, 0], travel=(0, 0.004), dead_zone=1e-2).type == "fixed"
    assert Joint(np.zeros(3), [1, 0, 0], angle=(-1, 9)).limits == (-np.pi, np.pi)


def test_a_left_handed_screw_whose_turn_is_dropped_keeps_its_motion():
    joint = codable(Joint(np.zeros(3), [1, 0, 0], angle=(0, 0.01), travel=(0, -0.3)))
    assert joint.travel == (-0.3, 0.0)
    np.testing.assert_allclose(joint.motion(-0.3)[:3, 3], [-0.3, 0, 0])


@pytest.mark.parametrize(
    ("spans", "direction", "words"),
    [
        ({"angle": (0.1, 1)}, [1, 0, 0], "bracket"),
        ({"travel": (-1, -0.2)}, [1, 0, 0], "bracket"),
        ({"angle": (0, 1)}, [0, 0, 0], "zero"),
        ({"angle": (0, np.nan)}, [1, 0, 0], "finite"),
        ({"angle": (0, 1)}, [1, 0, np.inf], "finite"),
        ({"angle": (-1, 1), "travel": (0, 1)}, [1, 0, 0], "proportional"),
    ],
)
def test_impossible_joints_are_refused(spans, direction, words):
    with pytest.raises(ValueError, match=words):
        Joint(np.zeros(3), direction, **spans)


def test_shown_at_refuses_what_lies_outside_the_limits():
    with pytest.raises(ValueError, match="outside the limits"):
        Joint(np.zeros(3), [1, 0, 0], angle=(0, 1)).shown_at(1.2)


def test_order_puts_parents_first_and_names_what_is_wrong():
    assert topological_order([2, 0, -1]) == [2, 0, 1]
    for parents, words in (
        ([0, 1], "one root"),
        ([-1, -1], "one root"),
        ([-1, 2, 1], "cycle"),
        ([-1, 7], "range"),
    ):
        with pytest.raises(ValueError, match=words):
            topological_order(parents)


def test_rotation_equals_trimesh():
    rng = np.random.default_rng(0)
    for _ in range(20):
        direction, angle = rng.normal(size=3), rng.uniform(-7, 7)
        direction /= np.linalg.norm(direction)
        expected = trimesh.transformations.rotation_matrix(angle, direction)[:3, :3]
        np.testing.assert_allclose(rotation(direction, angle), expected, atol=1e-12)


def test_axes_are_compared_as_lines():
    a = Joint([0, 0, 0], [0, 0, 1], angle=(0, 1))
    assert line_distance(a, Joint([0, 0, 9], [0, 0, -1], angle=(0, 1))) == pytest.approx(0)
    assert line_distance(a, Joint([3, 4, 9], [0, 0, 1], angle=(0, 1))) == pytest.approx(5)
    assert line_distance(a, Joint([3, 4, 9], [1, 0, 0], angle=(0, 1))) == pytest.approx(4)


def test_objects_import_without_jax():
    modules = ["kinematics", "object", "appearance", "load"]
    lines = [f"import uniart_jax.objects.{m}" for m in modules] + [
        "import sys",
        "assert 'jax' not in sys.modules",
    ]
    subprocess.run([sys.executable, "-c", "\n".join(lines)], check=True)


def test_codes_know_no_motion_below_half_a_percent_or_a_degree():
    assert TRAVEL_DEAD_ZONE == 0.005
    for travel in (0.0049, 0.005, 0.0051):
        small = Joint(np.zeros(3), [1, 0, 0], travel=(0, travel))
        assert small.travels and codable(small).travels == (travel >= TRAVEL_DEAD_ZONE)
    for degrees in (0.9, 1.0, 1.1):
        small = Joint(np.zeros(3), [1, 0, 0], angle=(0, np.deg2rad(degrees)), travel=(0, 0.1))
        assert small.type == "screw" and codable(small).rotates == (degrees >= 1)
        assert codable(small).travel == (0, 0.1)


@pytest.mark.parametrize("scale", [0.1, 10])
def test_the_least_travel_scales_with_the_object(scale):
    given = Joint(np.zeros(3), [1, 0, 0], travel=(0, 1.2e-4))
    joint = given.transformed(np.diag([*[scale] * 3, 1]))
    assert joint.travel == pytest.approx((0, 1.2e-4 * scale))

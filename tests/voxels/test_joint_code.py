"""The joint code's contract: what goes in comes out, exactly, whatever the gauge."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from uniart_jax.objects.kinematics import JOINT_TYPES, Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.voxels.joint_code import (
    CODE_SIZE,
    align,
    canonical,
    decode_joint,
    decode_part,
    decode_tree,
    encode_joint,
    encode_object,
    gauge_variants,
)

# axis-aligned of both signs, diagonals whose components tie, and directions a rounding error away
# from a tie
AWKWARD = [np.array([x, y, z], float) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)]
AWKWARD = [d for d in AWKWARD if d.any()] + [
    np.array([1, -1 - 1e-9, 0.2]),
    np.array([-1, 1, 1 + 1e-7]),
]

vectors = st.tuples(*[st.floats(-1, 1)] * 3).map(np.array).filter(lambda d: np.linalg.norm(d) > 0.1)
directions = st.one_of(st.sampled_from(AWKWARD), vectors)
points = st.tuples(*[st.floats(-0.5, 0.5)] * 3).map(np.array)


def spans(low: float, high: float):
    """(lo, hi) around 0, at least ``low`` wide, and often with an end at 0."""
    side = st.floats(low, high)
    return st.one_of(
        side.map(lambda v: (-v, 0.0)),
        side.map(lambda v: (0.0, v)),
        st.tuples(side.map(lambda v: -v), side),
    )


@st.composite
def joints(draw, kinds=JOINT_TYPES):
    kind = draw(st.sampled_from(kinds))
    origin, direction = draw(points), draw(directions)
    if kind == "fixed":
        return Joint.fixed()
    if kind == "continuous":
        return Joint(origin, direction, (-np.pi, np.pi))
    if kind == "prismatic":
        return Joint(origin, direction, (0, 0), draw(spans(0.006, 1)))
    if kind == "revolute":
        return Joint(origin, direction, draw(spans(0.02, 3.1)))
    angle = np.array(draw(spans(0.1, 4 * np.pi)))  # up to two turns each way
    pitch = draw(st.floats(0.006, 0.5)) / (angle[1] - angle[0]) * draw(st.sampled_from([-1, 1]))
    return Joint(origin, direction, tuple(angle), tuple(angle * pitch))


def assert_same_motion(a: Joint, b: Joint, center: np.ndarray):
    """Equal as motions: every state of one is a state of the other, at the same place in the
    span."""
    assert a.type == b.type
    same_way = a.direction @ b.direction > 0
    for share in (0.0, 0.3, 1.0):
        lo, hi = a.limits
        q = lo + share * (hi - lo)
        expected = a.motion(q)
        got = b.motion(q if same_way else -q)
        assert np.allclose(expected, got, atol=1e-9)
    if a.type != "fixed":
        lo, hi = b.limits if same_way else (-b.limits[1], -b.limits[0])
        assert np.allclose(a.limits, (lo, hi), atol=1e-9)
        assert (
            abs((b.origin - center) @ b.direction) < 1e-9
        )  # the point of the axis nearest to the part


@given(joints(), points)
def test_decode_inverts_encode(joint, center):
    code = encode_joint(joint, center)
    assert code.shape == (CODE_SIZE,) and code.dtype == np.float64
    assert_same_motion(joint, decode_joint(code, center), center)


@given(joints(), points)
def test_every_gauge_decodes_to_the_same_motion(joint, center):
    for variant in gauge_variants(encode_joint(joint, center)):
        assert_same_motion(joint, decode_joint(variant, center), center)


@given(joints(), points)
def test_float32_codes_keep_the_type(joint, center):
    decoded = decode_joint(encode_joint(joint, center).astype(np.float32), center)
    assert decoded.type == joint.type
    assert abs(abs(decoded.direction @ joint.direction) - 1) < 1e-6
    assert np.allclose(sorted(np.abs(decoded.limits)), sorted(np.abs(joint.limits)), atol=1e-5)


@given(joints(), points)
def test_flipping_a_joint_does_not_change_its_code(joint, center):
    if joint.type == "fixed":
        return
    (a0, a1), (t0, t1) = joint.angle, joint.travel
    flipped = Joint(joint.origin, -joint.direction, (-a1, -a0), (-t1, -t0))
    assert np.allclose(encode_joint(joint, center), encode_joint(flipped, center), atol=1e-12)


@given(joints(), points)
def test_canonical_form(joint, center):
    code = encode_joint(joint, center)
    variants = gauge_variants(code)
    assert variants.shape == (6, CODE_SIZE)
    assert np.allclose(canonical(variants), code, atol=1e-6)
    assert np.array_equal(canonical(code), code)
    assert -1 < code[0] <= 1 and code[7] <= 0 <= code[8]
    d = code[1:4]
    if joint.type != "fixed":
        assert (
            d[np.abs(d).argmax()] > 0 or np.isclose(np.abs(d), np.abs(d).max(), atol=2e-6).sum() > 1
        )


@pytest.mark.parametrize(
    "direction, expected",
    [
        ((1, -1, 0), (-1, 1, 0)),
        ((1, 1, -1), (-1, -1, 1)),
        ((-1, 0, 0), (1, 0, 0)),
        ((1, 0.5, -1), (-1, -0.5, 1)),
    ],
)
def test_ties_go_to_z_then_y_then_x(direction, expected):
    code = encode_joint(Joint((0, 0, 0), direction, (0, 1)), np.zeros(3))
    assert np.allclose(code[1:4], np.array(expected) / np.linalg.norm(expected))
    assert np.allclose(code[7:], [-1 / np.pi, 0])


@given(st.lists(st.tuples(joints(), st.integers(0, 5)), min_size=1, max_size=7), joints(), points)
def test_align_finds_the_nearest_gauge(items, reference, center):
    codes = np.stack([gauge_variants(encode_joint(j, center))[g] for j, g in items])
    target = encode_joint(reference, center)
    aligned = align(codes, target)
    best = ((gauge_variants(codes) - target) ** 2).sum(-1).min(-1)
    assert np.allclose(((aligned - target) ** 2).sum(-1), best)


@jax.jit
def in_jax(codes, reference):
    return canonical(codes, jnp), gauge_variants(codes, jnp), align(codes, reference, jnp)


@settings(max_examples=25)
@given(st.lists(joints(), min_size=4, max_size=4), points)
def test_numpy_and_jax_agree(items, center):
    codes = np.stack([encode_joint(j, center) for j in items]).astype(np.float32)
    codes = np.stack([gauge_variants(codes)[:, g] for g in range(6)], axis=1)  # [n, 6, 9]
    reference = codes[:, :1]
    expected = canonical(codes), gauge_variants(codes), align(codes, reference)
    for ours, theirs in zip(expected, in_jax(codes, reference), strict=True):
        assert np.allclose(ours, np.asarray(theirs), atol=1e-6)


@given(joints(), points, st.integers(1, 40), st.integers(0, 10**6))
def test_a_part_of_true_codes_in_any_gauge_decodes_exactly(joint, center, count, seed):
    rng = np.random.default_rng(seed)
    codes = gauge_variants(encode_joint(joint, center))[rng.integers(6, size=count)]
    assert_same_motion(joint, decode_part(codes, center), center)


@given(joints(("revolute", "prismatic", "continuous")), points, st.integers(0, 10**6))
def test_noisy_voxels_of_a_part_still_give_its_joint(joint, center, seed):
    rng = np.random.default_rng(seed)
    if joint.type != "continuous" and np.ptp(joint.limits) < 0.1:
        return  # of the size of the noise
    noisy = encode_joint(joint, center) + rng.normal(0, 0.02, (200, CODE_SIZE))
    noisy = gauge_variants(noisy)[np.arange(200), rng.integers(6, size=200)]
    decoded = decode_part(noisy, center)
    assert decoded.type == joint.type
    assert abs(decoded.direction @ joint.direction) > np.cos(np.deg2rad(1))


@settings(max_examples=300)
@given(st.lists(st.floats(width=32), min_size=9, max_size=9), points)
def test_any_nine_numbers_give_a_joint(code, center):
    assert decode_joint(np.array(code), center).type in JOINT_TYPES
    assert decode_part(np.array([code, code[::-1]]), center).type in JOINT_TYPES


def test_a_short_axis_is_fixed():
    code = encode_joint(Joint((0, 0, 0), (0, 0, 1), (0, 1)), np.zeros(3))
    code[1:7] *= 0.49
    assert decode_joint(code, np.zeros(3)).type == "fixed"
    assert decode_part(np.zeros((0, 9)), np.zeros(3)).type == "fixed"


def test_limits_that_miss_zero_are_widened():
    code = encode_joint(Joint((0, 0, 0), (0, 0, 1), (0, 1)), np.zeros(3))
    code[7:] = 0.1, 0.3
    assert decode_joint(code, np.zeros(3)).angle == pytest.approx((0, 0.3 * np.pi))


def make_object(parents, joint_list, boxes) -> ArticulatedObject:
    parts = []
    for k, (parent, joint, (center, size)) in enumerate(
        zip(parents, joint_list, boxes, strict=True)
    ):
        mesh = trimesh.creation.box(size, trimesh.transformations.translation_matrix(center))
        parts.append(Part(f"part_{k}", mesh, parent, joint if parent >= 0 else Joint.fixed()))
    return ArticulatedObject(tuple(parts))


@st.composite
def objects(draw):
    count = draw(st.integers(1, 12))
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    parents = [-1] + [draw(st.integers(0, k - 1)) for k in range(1, count)]
    boxes = [(rng.uniform(-0.4, 0.4, 3), rng.uniform(0.02, 0.2, 3)) for _ in range(count)]
    return make_object(parents, [draw(joints()) for _ in range(count)], boxes)


@settings(max_examples=60, deadline=None)
@given(objects())
def test_objects_round_trip(obj):
    boxes, codes, parents = encode_object(obj)
    assert decode_tree(boxes, boxes[parents]) == obj.parents
    assert not codes[0].any() and parents[0] == 0
    for k, part in enumerate(obj.parts):
        assert_same_motion(part.joint, decode_joint(codes[k], boxes[k, :3]), boxes[k, :3])


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 12), st.integers(0, 10**6))
def test_any_boxes_give_a_tree(count, seed):
    rng = np.random.default_rng(seed)
    boxes, parent_boxes = rng.normal(size=(2, count, 6))
    parent_boxes[rng.random(count) < 0.2] = rng.choice([np.nan, np.inf])
    parents = decode_tree(boxes, parent_boxes)
    assert parents.count(-1) == 1
    for node in range(count):
        for _ in range(count):
            node = parents[node] if node >= 0 else -1
        assert node == -1


def test_parts_with_one_box_are_refused_by_name():
    boxes = [
        (np.zeros(3), np.ones(3)),
        (np.full(3, 0.1), np.ones(3) * 0.2),
        (np.full(3, 0.104), np.ones(3) * 0.2),
    ]
    obj = make_object([-1, 0, 0], [Joint.fixed()] * 3, boxes)
    with pytest.raises(ValueError, match="'part_1' and 'part_2'"):
        encode_object(obj)


def test_tolerance_reads_predicted_codes_as_pure_motions_and_keeps_caps():
    rng = np.random.default_rng(0)
    center = np.zeros(3)
    drawer = Joint([0, 0, 0], [1, 0, 0], travel=(-0.3, 0))
    deep = Joint([0, 0, 0], [1, 0, 0], travel=(-0.7, 0))  # far, so no little turn is meant
    door = Joint([0, 0.5, 0], [0, 0, 1], angle=(0, 1.6))
    knob = Joint([0, 0, 0], [1, 0, 0], angle=(-np.pi, np.pi))
    cap = Joint([0, 0, 0], [0, 0, 1], angle=(0, 4 * np.pi), travel=(0, 0.1))
    for joint in (drawer, deep, door, knob, cap):
        shared = encode_joint(joint, center) + 0.04 * rng.choice([-1, 1], 9)
        codes = shared + 0.002 * rng.normal(size=(40, 9))
        assert decode_part(codes, center, 0.1).type == joint.type

"""Augmenting and then encoding equals encoding and then augmenting."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import trimesh
from hand_records import make_record
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from uniart_jax import procedural
from uniart_jax.data import records
from uniart_jax.data.augment import (
    move_codes,
    recolor_record,
    redraw_joints,
    scale_codes,
    shown_codes,
)
from uniart_jax.data.mirror import mirror_boxes, mirror_codes
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.objects.perturb import color_gains, part_factors, recolor_parts, scale_parts
from uniart_jax.objects.states import sample_state
from uniart_jax.voxels.joint_code import decode_joint, encode_joint, encode_object, gauge_variants
from uniart_jax.voxels.voxelize import voxelize

TYPES = ("fixed", "revolute", "continuous", "prismatic", "screw")
STRAIGHT = [np.array(d, float) for d in [(1, 0, 0), (0, -1, 0), (0, 0, 1), (-1, 0, 0), (0, 0, -1)]]
CROOKED = [np.array(d, float) for d in [(1, 1, 0), (0, -1, 1), (1, -2, 3)]]
TOLERANCE = 1e-9  # float64, a dozen of operations on numbers near 1


@st.composite
def joints(draw, rng, directions):
    """A joint of any type; spans near the dead zones, which scaling may cross, included."""
    kind = draw(st.sampled_from(TYPES))
    origin, direction = rng.uniform(-0.5, 0.5, 3), directions[rng.integers(len(directions))]
    ends = np.array([-draw(st.floats(0, 1)), draw(st.floats(0, 1))])
    assume(np.ptp(ends) > 0.1)
    if kind == "continuous":
        return Joint(origin, direction, (-np.pi, np.pi))
    size = draw(st.sampled_from([0.01, 0.1, 1.0]))
    hand = draw(st.sampled_from([-1, 1]))
    turn = (
        draw(st.sampled_from([1.0, 3.0, 9.0])) * ends if kind in ("revolute", "screw") else ends * 0
    )
    travel = size * ends * (hand if kind == "screw" else 1)
    return Joint(
        origin,
        direction,
        tuple(turn),
        tuple(travel if kind in ("prismatic", "screw") else ends * 0),
    )


@st.composite
def objects(draw, directions):
    """A normalised tree, often a chain, of boxes."""
    count = draw(st.integers(1, 6))
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    chain = draw(st.booleans())
    parts = []
    for k in range(count):
        place = trimesh.transformations.translation_matrix(rng.uniform(-0.4, 0.4, 3))
        mesh = trimesh.creation.box(rng.uniform(0.02, 0.4, 3), place)
        parent = k - 1 if chain or k == 0 else draw(st.integers(0, k - 1))
        joint = draw(joints(rng, directions)) if k else Joint.fixed()
        parts.append(Part(f"part_{k}", mesh, parent, joint))
    return ArticulatedObject(tuple(parts)).normalized()


def encoded(obj: ArticulatedObject):
    try:
        return encode_object(obj)
    except ValueError:  # two equal boxes
        assume(False)
        raise


def assert_same(found, expected, tolerance=TOLERANCE):
    """Equal, but for which of two components within 1e-6 of each other leads an axis."""
    distance = np.abs(gauge_variants(found) - expected[..., None, :]).max(-1).min(-1)
    assert distance.max() < tolerance


@settings(max_examples=100)
@given(objects(STRAIGHT + CROOKED), st.integers(0, 10**6), st.sampled_from([0.05, 0.3, 2.0]))
def test_scaling(obj, seed, strength):
    factors = part_factors(obj, np.random.default_rng(seed), strength)
    boxes, codes, parents = encoded(obj)
    scaled_boxes, scaled_codes, _ = encoded(scale_parts(obj, factors))
    found_boxes, found_codes = scale_codes(boxes, codes, parents, factors)
    assert np.abs(found_boxes - scaled_boxes).max() < TOLERANCE
    assert np.abs(found_codes - scaled_codes).max() < TOLERANCE
    stored = scale_codes(boxes.astype(np.float32), codes.astype(np.float32), parents, factors)
    assert np.abs(stored[0] - scaled_boxes).max() < 1e-5
    near = np.abs(found_codes[:, 8] - found_codes[:, 7]) * np.sin(np.pi / 2 * found_codes[:, 0]) / 4
    clear = np.abs(np.abs(near) - 0.005) > 1e-5  # float32 decides such travel by itself
    assert np.abs(stored[1] - scaled_codes)[clear].max(initial=0) < 1e-4


@given(objects(STRAIGHT), st.integers(0, 10**6))
def test_scaling_by_any_factors_along_straight_axes(obj, seed):
    factors = np.exp(np.random.default_rng(seed).uniform(-1, 1, (len(obj.parts), 3)))
    boxes, codes, parents = encoded(obj)
    scaled_boxes, scaled_codes, _ = encoded(scale_parts(obj, factors))
    found_boxes, found_codes = scale_codes(boxes, codes, parents, factors)
    assert np.abs(found_boxes - scaled_boxes).max() < TOLERANCE
    assert np.abs(found_codes - scaled_codes).max() < TOLERANCE


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
    scaled = scale_parts(obj, [1.0, 0.5])
    assert (obj.joints[1].type, scaled.joints[1].type) == (before, after)
    boxes, codes, parents = encode_object(obj)
    _, found = scale_codes(boxes, codes, parents, np.array([1.0, 0.5]))
    assert np.abs(found - encode_object(scaled)[1]).max() < TOLERANCE


@given(objects(STRAIGHT + CROOKED), st.floats(0.5, 2), st.integers(0, 10**6))
def test_moving(obj, factor, seed):
    shift = np.random.default_rng(seed).uniform(-1, 1, 3)
    matrix = np.diag([factor, factor, factor, 1.0])
    matrix[:3, 3] = shift
    boxes, codes, _ = encoded(obj)
    moved = obj.transformed(matrix)
    expected_boxes, expected_codes, _ = encoded(moved)
    found_boxes, found_codes = move_codes(boxes, codes, factor, shift)
    assert np.abs(found_boxes - expected_boxes).max() < TOLERANCE
    assert np.abs(found_codes - expected_codes).max() < TOLERANCE


@given(objects(STRAIGHT + CROOKED))
def test_mirroring(obj):
    boxes, codes, _ = encoded(obj)
    mirrored_boxes, mirrored_codes, _ = encoded(obj.transformed(np.diag([1.0, -1.0, 1.0, 1.0])))
    assert np.abs(mirror_boxes(boxes) - mirrored_boxes).max() < TOLERANCE
    assert_same(mirror_codes(codes), mirrored_codes)


@settings(max_examples=100)
@given(objects(STRAIGHT + CROOKED), st.lists(st.floats(0, 1), min_size=6, max_size=6))
def test_showing_another_state(obj, shares):
    boxes, codes, parents = encoded(obj)
    q = np.zeros(len(obj.parts))
    along = np.ones(len(obj.parts))
    for k, part in enumerate(obj.parts):
        lo, hi = part.joint.limits
        q[k] = lo + shares[k] * (hi - lo)
        along[k] = np.sign(decode_joint(codes[k], boxes[k, :3]).direction @ part.joint.direction)
    shown = obj.shown_at(q)
    side = np.ptp(shown.bounds, axis=0).max()
    middle = shown.bounds.mean(0)
    found = shown_codes(boxes, codes, parents, q * along, shown.boxes[:, :3])
    expected_boxes, expected_codes, _ = encoded(shown)
    assert_same(found, expected_codes)
    _, found = move_codes(expected_boxes, found, 1 / side, -middle / side)
    normal = shown.normalized()
    same = [a.type == b.type for a, b in zip(normal.joints, shown.joints, strict=True)]
    assert_same(found[same], encoded(normal)[1][same])


@given(st.integers(0, 99), st.sampled_from([0.05, 0.3, 2.0]))
def test_recolouring_changes_nothing_but_colours(seed, strength):
    record = make_record(seed, voxels=30)
    gains = color_gains(3, np.random.default_rng(seed), strength)
    assert (gains > (1 + strength) ** -2.001).all() and (gains < (1 + strength) ** 2.001).all()
    found = recolor_record(record, gains)
    for field in dataclasses.fields(record):
        a, b = getattr(record, field.name), getattr(found, field.name)
        if field.name == "color":
            linear = records.decode_color(a) * gains.astype(np.float32)[record.owner]
            assert np.array_equal(b, records.encode_color(linear))
            assert b.dtype == a.dtype and not np.array_equal(a, b)
        else:
            assert a is b
    same = recolor_record(record, np.ones((3, 3)))
    assert np.array_equal(same.color, record.color)


@pytest.mark.parametrize("seed", [0, 3])
def test_record_of_the_recoloured_object(seed):
    obj = sample_state(procedural.generate("microwave", seed), np.random.default_rng(seed))
    gains = color_gains(len(obj.parts), np.random.default_rng(seed), 0.2) / 1.44  # nothing clips
    made = []
    for shown in (obj, recolor_parts(obj, gains)):
        views = np.zeros((0, 8, 8, 4), np.uint8)
        made.append(records.from_object(shown, views, np.zeros((0, 4)), {}, voxelize(shown, 16, 2)))
    found = recolor_record(made[0], gains)
    for key in ("coords", "sdf", "owner", "voxel_part", "boxes", "codes", "parents"):
        assert np.array_equal(getattr(made[1], key), getattr(found, key)), key
    # texels, vertices and records are rounded to 8 bits each
    assert np.abs(found.color.astype(int) - made[1].color).max() <= 2
    plain = [k for k, p in enumerate(obj.parts) if p.mesh.visual.kind == "face"]
    rows = np.isin(found.owner, plain)
    assert plain and np.array_equal(found.color[rows], made[1].color[rows])


@given(st.integers(0, 10_000))
def test_joints_drawn_anew_are_joints_of_a_tree(seed):
    record = make_record(seed)
    drawn = redraw_joints(record, 1.0, np.random.default_rng(seed))
    assert (drawn.parents < np.arange(len(drawn.parents)))[1:].all() and drawn.parents[0] == 0
    assert not drawn.codes[0].any()
    for code, box in zip(drawn.codes[1:], drawn.boxes[1:], strict=True):
        joint = decode_joint(code, box[:3])
        np.testing.assert_allclose(encode_joint(joint, box[:3]), code, atol=1e-5)
    unchanged = {f.name for f in dataclasses.fields(record)} - {"codes", "parents"}
    assert all(getattr(drawn, name) is getattr(record, name) for name in unchanged)


def test_every_part_before_it_may_become_a_parts_parent():
    count = 5
    record = make_record(0, parts=count)
    drawn = [redraw_joints(record, 1.0, np.random.default_rng(k)).parents for k in range(200)]
    assert [set(own) for own in np.array(drawn).T[1:]] == [set(range(k)) for k in range(1, count)]


def test_parts_that_keep_their_joint_keep_their_parent():
    record = make_record(0, parts=5)
    chain = dataclasses.replace(record, parents=np.array([0, 0, 1, 2, 3], np.int32))
    kept = 0
    for seed in range(50):
        some = redraw_joints(chain, 0.3, np.random.default_rng(seed))
        stays = (some.codes == chain.codes).all(1)
        np.testing.assert_array_equal(some.parents[stays], chain.parents[stays])
        kept += stays[1:].sum()
    assert 100 < kept < 180  # of 200


def test_a_share_of_joints_is_drawn_anew():
    record, rng = make_record(0), np.random.default_rng(0)
    moving = record.parents != np.arange(len(record.parents))
    assert redraw_joints(record, 0.0, rng).codes.tobytes() == record.codes.tobytes()
    changed = [(redraw_joints(record, 0.25, rng).codes != record.codes).any(1) for _ in range(400)]
    assert not np.any(changed, 0)[~moving].any()
    assert 0.15 < np.mean(changed, 0)[moving].mean() < 0.3  # one fixed joint in five may stay

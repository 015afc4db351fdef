"""Mirroring a record equals recording the mirrored object."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hand_records import make_record
from hypothesis import given, settings
from hypothesis import strategies as st

from uniart_jax import procedural
from uniart_jax.data import records
from uniart_jax.data.mirror import mirror_boxes, mirror_codes, mirror_dense, mirror_record
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.states import sample_state
from uniart_jax.visual.render import render, sample_camera
from uniart_jax.voxels.grid import occupancy
from uniart_jax.voxels.joint_code import encode_joint, gauge_variants
from uniart_jax.voxels.voxelize import voxelize

MIRROR = np.diag([1.0, -1.0, 1.0, 1.0])
finite = st.floats(-1, 1).map(lambda x: round(x, 4))
vector = st.tuples(finite, finite, finite)


@settings(max_examples=200, deadline=None)
@given(
    vector,
    vector.filter(lambda d: np.linalg.norm(d) > 0.1),
    vector,
    st.sampled_from(["fixed", "revolute", "continuous", "prismatic", "screw"]),
    st.sampled_from([1, -1]),
    st.floats(0, 1),
)
def test_codes_follow_the_mirrored_joint(origin, direction, center, kind, hand, share):
    lo, hi = -share, 1.5 - share
    angle = (lo, hi) if kind in ("revolute", "screw") else (0, 0)
    angle = (-np.pi, np.pi) if kind == "continuous" else angle
    travel = (0.2 * lo, 0.2 * hi) if kind == "prismatic" else (0, 0)
    travel = (hand * 0.2 * lo, hand * 0.2 * hi) if kind == "screw" else travel
    joint = Joint(origin, direction, angle, travel)
    assert joint.type == kind
    code = encode_joint(joint, np.array(center))
    mirrored = encode_joint(joint.transformed(MIRROR), np.array(center) * [1, -1, 1])
    found = mirror_codes(code.astype(np.float32))
    # equal, but for which of two components within 1e-6 of each other leads: float32 may see a tie
    # where float64 does not
    distance = np.abs(gauge_variants(found) - mirrored).max(-1).min()
    assert distance < 2e-6
    size = np.sort(np.abs(joint.direction))
    if size[2] - size[1] > 1e-5:
        assert np.abs(found - mirrored).max() < 2e-6
    if kind == "fixed":
        assert np.array_equal(found, np.zeros(9)) and not np.signbit(found).any()


@given(st.integers(0, 99))
def test_twice_is_nothing(seed):
    record = make_record(seed, voxels=30)
    back = mirror_record(mirror_record(record))
    for field in dataclasses.fields(record):
        a, b = getattr(record, field.name), getattr(back, field.name)
        assert np.array_equal(a, b) if field.name != "meta" else a == b, field.name


def test_dense_grids_and_boxes():
    record = make_record()
    mirrored = mirror_record(record)
    dense = mirror_dense(occupancy(record.coords, 8)[None], first_axis=1)[0]
    assert np.array_equal(dense, occupancy(mirrored.coords, 8))
    assert np.array_equal(mirror_boxes(record.boxes)[:, [1, 4]] * [-1, 1], record.boxes[:, [1, 4]])


@pytest.mark.parametrize(("family", "seed"), [("storage_furniture", 8), ("refrigerator", 4)])
def test_record_of_the_mirrored_object(family, seed):
    obj = sample_state(procedural.generate(family, seed), np.random.default_rng(seed + 1))
    camera = sample_camera(np.random.default_rng(seed))
    opposite = dataclasses.replace(camera, azimuth=-camera.azimuth)
    made = []
    for shown, seen_by in ((obj, camera), (obj.transformed(MIRROR), opposite)):
        image = render(shown, seen_by, size=64)[None]
        cameras = np.array([dataclasses.astuple(seen_by)])
        made.append(records.from_object(shown, image, cameras, {}, voxelize(shown, 16, 4)))
    found, expected = mirror_record(made[0]), made[1]
    assert np.array_equal(found.coords, expected.coords)
    np.testing.assert_allclose(found.boxes, expected.boxes, atol=1e-6)
    np.testing.assert_allclose(found.codes, expected.codes, atol=1e-5)
    np.testing.assert_allclose(found.cameras, expected.cameras, atol=1e-6)
    assert np.array_equal(found.parents, expected.parents)
    # equally near surfaces are told apart by rounding: a few sub-cells may differ, never their
    # distance
    assert np.abs(found.sdf.astype(int) - expected.sdf).max() <= 1
    assert ((found.sdf < 0) != (expected.sdf < 0)).mean() < 1e-3
    assert (found.owner != expected.owner).mean() < 0.01
    assert (found.voxel_part != expected.voxel_part).mean() < 0.01
    # colours between two equally near faces of one part are either's
    assert (np.abs(found.color.astype(int) - expected.color).max(-1) > 3).mean() < 0.05
    assert np.abs(found.images.astype(int) - expected.images).mean() < 0.5

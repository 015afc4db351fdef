"""Records in other colours and with other joints: all else stays as it is."""

from __future__ import annotations

import dataclasses

import numpy as np
from hand_records import make_record
from hypothesis import given
from hypothesis import strategies as st

from uniart_jax.data import records
from uniart_jax.data.augment import recolor_record, redraw_joints
from uniart_jax.objects.perturb import color_gains
from uniart_jax.voxels.joint_code import decode_joint, encode_joint


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

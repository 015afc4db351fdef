"""What all figures agree on: the frame, and that a figure goes no farther than failing does."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import trimesh

from uniart_jax.evaluation import articulation, pose_error, singapo, surface
from uniart_jax.evaluation.metric import at_rest, resting
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part


def cart(joint: Joint) -> ArticulatedObject:
    body = trimesh.creation.box([1.0, 0.5, 0.4])
    wheel = trimesh.creation.box([0.3, 0.05, 0.2]).apply_translation([0.2, -0.3, -0.2])
    other = trimesh.creation.box([0.3, 0.05, 0.2]).apply_translation([0.2, 0.3, -0.2])
    return ArticulatedObject(
        (Part("body", body), Part("wheel", wheel, 0, joint), Part("fixed", other, 0))
    )


WHEEL = Joint([0.2, -0.3, -0.2], [0, 1, 0], (-np.pi, np.pi))


def test_every_object_is_centred_at_rest_with_longest_side_one():
    door = Joint([-0.5, -0.25, 0], [0, 0, 1], (-1.0, 0.3))
    obj = at_rest(cart(door).transformed(np.diag([3.0, 3.0, 3.0, 1.0])))
    assert np.allclose(obj.bounds.mean(0), 0) and np.ptp(obj.bounds, axis=0).max() == pytest.approx(
        1
    )
    assert np.allclose(obj.rest(), 0)


def test_own_units_are_metres():
    obj = cart(WHEEL).transformed(np.diag([3.0, 3.0, 3.0, 1.0]))
    for same in (obj, obj.normalized()):
        assert (
            np.ptp(resting(same).bounds, axis=0).max() == pytest.approx(3)
            and resting(same).scale == 1
        )
    shown = at_rest(obj.normalized())
    assert (
        singapo.measure(shown, shown, own=(resting(obj.normalized()), resting(obj)))[
            "compat_rs_dcd"
        ]
        < 0.05
    )


def test_a_wheel_and_the_same_wheel_about_the_reversed_axis_are_one():
    forward, backward = (
        at_rest(cart(WHEEL)),
        at_rest(cart(dataclasses.replace(WHEEL, direction=-WHEEL.direction))),
    )
    assert np.allclose(
        forward.forward_kinematics(forward.open(0.4)),
        backward.forward_kinematics(backward.open(0.4)),
    )
    figures = singapo.measure(backward, forward)
    assert figures["fixed_as_dgiou"] < 1e-6 and figures["fixed_as_dcdist"] < 1e-6
    assert pose_error.measure(backward, forward)["pose_error"] < 1e-9
    # a hinge with an end has a way to open, and keeps it
    ends = dataclasses.replace(WHEEL, angle=(-1.5, 0.0))
    assert at_rest(cart(ends)).joints[1].limits == (-1.5, 0.0)


def test_a_drawer_that_flies_away_counts_no_worse_than_none():
    """Millimetres taken for metres: one object must not swamp a mean."""
    slide = Joint([0, 0, 0], [-1, 0, 0], (0, 0), (0.0, 0.4))
    far = dataclasses.replace(slide, travel=(0.0, 400.0))
    pred, ref = at_rest(cart(far)), at_rest(cart(slide))
    for module, prefix in ((surface, ""), (singapo, "fixed"), (pose_error, "")):
        figures = module.measure(pred, ref)
        for key, metric in module.METRICS.items():
            if key.startswith(prefix) and metric.better == "lower" and np.isfinite(figures[key]):
                assert figures[key] <= metric.worst, key
    # at rest nothing is wrong, in the four other states all that can be
    assert surface.measure(pred, ref, 4096)["as_chamfer"] == pytest.approx(
        0.8 * surface.FARTHEST, rel=0.01
    )


def test_siblings_that_were_not_found_are_the_worst_overlap():
    ref = at_rest(cart(WHEEL))
    blob = at_rest(ArticulatedObject((Part("blob", trimesh.creation.box([1.0, 0.6, 0.5])),)))
    figures = singapo.measure(blob, ref)
    assert figures["fixed_aor"] == singapo.METRICS["fixed_aor"].worst
    assert np.isnan(figures["compat_aor"]) and np.isnan(singapo.measure(ref, blob)["fixed_aor"])
    assert articulation.measure(blob, ref)["part_recall"] < 1

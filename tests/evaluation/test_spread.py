"""Agreement of several samples, on samples whose spread is known."""

import json

import numpy as np
import pytest
import trimesh

from uniart_jax.evaluation.spread import joint_spread
from uniart_jax.objects.kinematics import Joint, rotation
from uniart_jax.objects.object import ArticulatedObject, Part

RIGHT = np.deg2rad(90)


def box(center, size):
    mesh = trimesh.creation.box(size)
    mesh.apply_translation(center)
    return mesh


def cabinet(door: Joint, shift=0.0, extra=()):
    """A body with a door on its front."""
    return ArticulatedObject(
        [
            Part("base", box((0.1, 0, 0), (0.8, 0.8, 1.0)), -1),
            Part("door", box((-0.35, shift, 0), (0.05, 0.7, 0.9)), 0, door),
            *extra,
        ]
    )


def hinge(tilt=0.0, y=-0.35, limits=(0.0, RIGHT), sign=1.0):
    """About z, leaning by ``tilt`` radians in the plane of the front; ``sign`` -1 writes the same
    motion the other way round."""
    lo, hi = limits
    d = rotation(np.array([1.0, 0, 0]), tilt) @ np.array([0, 0, 1.0])
    return Joint((-0.35, y, 0), sign * d, (lo, hi) if sign > 0 else (-hi, -lo))


def door_of(joints, index=0, **more):
    return joint_spread([cabinet(j, **more) for j in joints], index)["joints"]["door"]


def test_samples_alike_have_no_spread_however_they_are_written():
    found = door_of([hinge(), hinge(sign=-1.0), hinge()])
    assert found["matched"] == 3 and found["type_share"] == 1 and found["limits_unit"] == "radians"
    for name in ("axis_degrees", "pivot_object_units", "lower_std", "upper_std"):
        assert found[name] == pytest.approx(0, abs=1e-6), name


def test_deviations_are_standard_deviations():
    tilts, places = np.deg2rad([-3.0, 0.0, 3.0]), [-0.37, -0.35, -0.33]
    assert door_of([hinge(t) for t in tilts])["axis_degrees"] == pytest.approx(3.0)
    # two samples, 4 degrees to one side and to the other of their mean
    two = door_of([hinge(t, sign=s) for t, s in zip(np.deg2rad([-4.0, 4.0]), (1, -1), strict=True)])
    assert two["axis_degrees"] == pytest.approx(4 * np.sqrt(2))
    assert door_of([hinge(y=y) for y in places])["pivot_object_units"] == pytest.approx(0.02)
    limits = door_of([hinge(limits=(0, np.deg2rad(a))) for a in (80, 90, 100)])
    assert limits["upper_std"] == pytest.approx(np.deg2rad(10))
    assert limits["lower_std"] == pytest.approx(0)


def test_a_point_of_the_axis_anywhere_on_it_is_the_same_pivot():
    far = Joint((-0.35, -0.35, 5.0), (0, 0, 1.0), (0.0, RIGHT))
    assert door_of([hinge(), far])["pivot_object_units"] == pytest.approx(0, abs=1e-9)


def test_a_door_that_opens_the_other_way_shows_in_its_limits():
    found = door_of([hinge(), hinge(limits=(-RIGHT, 0.0))])
    assert found["axis_degrees"] == pytest.approx(0, abs=1e-6)
    assert found["lower_std"] == found["upper_std"] == pytest.approx(RIGHT / np.sqrt(2))


def test_other_types_disagree_and_are_not_averaged():
    slide = Joint((0, 0, 0), (-1.0, 0, 0), travel=(0.0, 0.3))
    found = door_of([hinge(), slide, hinge(y=-0.33)])
    assert found["matched"] == 3 and found["type_share"] == pytest.approx(2 / 3)
    assert found["pivot_object_units"] == pytest.approx(0.02 / np.sqrt(2))
    drawer = door_of([slide, hinge(), hinge()])
    assert drawer["type_share"] == pytest.approx(1 / 3) and drawer["limits_unit"] == "object units"
    assert drawer["axis_degrees"] is None and drawer["pivot_object_units"] is None


def test_a_part_elsewhere_does_not_match():
    samples = [cabinet(hinge()), cabinet(hinge(), shift=0.5), cabinet(hinge())]
    door = joint_spread(samples, 0)["joints"]["door"]
    assert door["matched"] == 2
    assert joint_spread(samples, 1)["joints"]["door"]["matched"] == 1


def test_part_numbers_may_differ_and_the_root_has_no_joint():
    knob = Part("knob", box((-0.45, 0.3, 0.4), (0.1, 0.05, 0.05)), 1)
    samples = [cabinet(hinge()), cabinet(hinge(), extra=(knob,))]
    found = [joint_spread(samples, i) for i in range(2)]
    assert [f["samples"] for f in found] == [2, 2]
    assert set(found[0]["joints"]) == {"door"} and set(found[1]["joints"]) == {"door", "knob"}
    assert found[0]["parts"] == [2, 3] and found[0]["missing"] == [[], []]  # it is fixed
    knob_figures = found[1]["joints"]["knob"]
    assert knob_figures["matched"] == 1 and knob_figures["axis_degrees"] is None
    json.dumps(found, allow_nan=False)


def test_wheels_that_turn_for_ever_have_no_limits():
    wheel = Joint((-0.35, 0, 0), (1.0, 0, 0), (-np.pi, np.pi))
    found = door_of([wheel, wheel])
    assert (
        found["lower_std"] is None and found["limits_unit"] is None and found["axis_degrees"] == 0
    )


def test_what_this_sample_lacks_is_said():
    slide = Joint((0, 0, 0), (0, -1.0, 0), travel=(0.0, 0.3))
    drawer = Part("drawer", box((0.1, -0.45, 0), (0.6, 0.1, 0.5)), 0, slide)
    samples = [cabinet(hinge()), cabinet(hinge(), extra=(drawer,))]
    assert joint_spread(samples, 0)["missing"] == [[], ["prismatic"]]
    assert joint_spread(samples, 1)["missing"] == [[], []]


def test_screws_of_other_handedness_differ():
    def screw(travel):
        return Joint((-0.35, 0, 0), (0, 0, 1.0), (0.0, RIGHT), travel)

    found = door_of([screw((0.0, 0.1)), screw((0.0, -0.3))])
    pitches = [screw(t).pitch for t in ((0.0, 0.1), (0.0, -0.3))]
    assert (
        found["pitch_object_units"] == pytest.approx(np.std(pitches, ddof=1))
        and abs(found["pitch_object_units"]) > 0.05
    )
    assert door_of([screw((0.0, 0.1))] * 2)["pitch_object_units"] == pytest.approx(0)


def test_a_hinge_without_limits_has_an_axis_all_the_same():
    free = Joint((-0.35, -0.33, 0), (0, 0, 1.0), (-np.pi, np.pi))
    assert free.type == "continuous"
    found = door_of([hinge(), free])
    assert found["type_share"] == 0.5 and found["lower_std"] is None
    assert found["pivot_object_units"] == pytest.approx(0.02 / np.sqrt(2))

"""Controls plant what they say and nothing else."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from uniart_jax import procedural
from uniart_jax.evaluation.controls import (
    CONTROLS,
    changed,
    exact,
    half_range,
    mirrored,
    missing_part,
    rest_only,
    wrong_hinge_side,
)
from uniart_jax.evaluation.metric import at_rest, resting
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.objects.states import sample_state

FAMILIES = procedural.FAMILIES
objects = st.builds(
    lambda family, seed, state: sample_state(
        procedural.generate(family, seed), np.random.default_rng(state)
    ),
    st.sampled_from(FAMILIES),
    st.integers(0, 50),
    st.integers(0, 5),
)
UP = (0.0, 0.0, 1.0)


def block(size, at) -> trimesh.Trimesh:
    return trimesh.creation.box(size, trimesh.transformations.translation_matrix(at))


@pytest.fixture
def cupboard() -> ArticulatedObject:
    """Longest side 1, centred; a door with its hinge at y = -.5 that opens to -x, a knob on it, a
    drawer, a drum."""
    turn, pull = Joint((-0.4, -0.5, 0), UP, (0, 2)), Joint((0, 0, 0), (-1, 0, 0), travel=(0, 0.6))
    knob, drum = (
        Joint(at, (1, 0, 0), (lo, hi))
        for at, lo, hi in (((0, 0.4, 0.2), 0, 1), ((0, 0, 0.1), -np.pi, np.pi))
    )
    return at_rest(
        ArticulatedObject(
            (
                Part("body", block((0.9, 1, 1), (0.05, 0, 0))),
                Part("door", block((0.05, 1, 0.6), (-0.425, 0, 0.2)), 0, turn),
                Part("knob", block((0.05, 0.04, 0.04), (-0.475, 0.4, 0.2)), 1, knob),
                Part("drawer", block((0.9, 0.9, 0.2), (0.05, 0, -0.3)), 0, pull),
                Part("drum", block((0.3, 0.3, 0.3), (0, 0, 0.1)), 0, drum),
            )
        )
    )


def at(obj: ArticulatedObject, fraction: float = 1.0) -> np.ndarray:
    """Where the door's free edge, at y = +.5 at rest, is."""
    moved = obj.forward_kinematics(obj.open(fraction))[obj.index("door")]
    return trimesh.transform_points([[-0.4, 0.5, 0.2]], moved)[0]


@settings(max_examples=25)
@given(objects, st.sampled_from([n for n in CONTROLS if n != "missing_part"]))
def test_the_rest_state_is_left_as_it_is(obj, name):
    truth, control = at_rest(obj), CONTROLS[name](obj)
    assert np.array_equal(control.rest(), np.zeros(len(control.parts)))
    again = at_rest(control)  # what every figure sees
    for a, b in zip(again.parts, truth.parts, strict=True):
        assert (a.name, a.parent, a.label) == (b.name, b.parent, b.label)
        assert np.allclose(a.mesh.vertices, b.mesh.vertices, atol=1e-9)


@settings(max_examples=15)
@given(objects)
def test_motions_reversed_twice_are_the_truth(obj):
    truth, once = resting(obj), mirrored(obj)
    twice = mirrored(once)
    assert not changed(twice, truth) and not changed(exact(obj), obj)
    for fraction in (0.3, 1.0):
        q = truth.open(fraction)
        assert np.allclose(once.open(fraction), q, atol=1e-9)
        assert np.allclose(twice.forward_kinematics(q), truth.forward_kinematics(q), atol=1e-9)
        for k, part in enumerate(once.parts):
            there = truth.parts[k].joint
            if there.type == "continuous":  # has no wrong way
                assert np.allclose(part.joint.motion(q[k]), there.motion(q[k]), atol=1e-9)
                continue
            assert np.allclose(part.joint.motion(q[k]) @ there.motion(q[k]), np.eye(4), atol=1e-9)


@settings(max_examples=10)
@given(objects)
def test_nothing_moves_in_rest_only(obj):
    control = rest_only(obj)
    assert {part.joint.type for part in control.parts} == {"fixed"}
    assert np.array_equal(
        control.forward_kinematics(control.open()), np.tile(np.eye(4), (len(control.parts), 1, 1))
    )


def test_the_cupboards_door(cupboard):
    cos, sin = np.cos(2.0), np.sin(2.0)
    assert np.allclose(at(cupboard, 0), [-0.4, 0.5, 0.2])
    assert np.allclose(at(cupboard), [-0.4 - sin, -0.5 + cos, 0.2])  # outwards
    assert np.allclose(at(mirrored(cupboard)), [-0.4 + sin, -0.5 + cos, 0.2])  # inwards
    assert np.allclose(at(half_range(cupboard)), [-0.4 - np.sin(1), -0.5 + np.cos(1), 0.2])
    assert np.allclose(at(rest_only(cupboard)), [-0.4, 0.5, 0.2])
    other = wrong_hinge_side(cupboard)
    assert np.allclose(at(other), [-0.4, 0.5, 0.2])  # on the axis now
    k, door = other.index("knob"), other.index("door")
    matrices = other.forward_kinematics(other.open())
    free = trimesh.transform_points([[-0.4, -0.5, 0.2]], matrices[door])[0]
    assert np.allclose(free, [-0.4 - sin, 0.5 - cos, 0.2])  # outwards too
    assert np.allclose(matrices[k], matrices[door] @ cupboard.parts[k].joint.motion(1.0))


def test_half_of_every_range_but_a_continuous_ones(cupboard):
    limits = {part.name: part.joint.limits for part in half_range(cupboard).parts}
    assert np.allclose(limits["door"], (0, 1)) and np.allclose(limits["knob"], (0, 0.5))
    assert np.allclose(limits["drawer"], (0, 0.3))
    assert np.allclose(limits["drum"], (-np.pi, np.pi))


def test_only_side_hinges_have_another_side(cupboard):
    other = wrong_hinge_side(cupboard)
    for name in ("knob", "drawer", "drum"):
        k = other.index(name)
        assert np.allclose(other.parts[k].joint.origin, cupboard.parts[k].joint.origin)
    drum = ArticulatedObject(tuple(p for p in cupboard.parts if p.name in ("body", "drum")))
    assert not changed(wrong_hinge_side(drum), drum)


def test_the_largest_moving_part_goes_with_all_that_hangs_on_it(cupboard):
    less = missing_part(cupboard)
    assert [p.name for p in less.parts] == ["body", "door", "drum", "knob"]
    for part in less.parts:
        true = cupboard.parts[cupboard.index(part.name)]
        assert np.array_equal(part.mesh.vertices, true.mesh.vertices)
        if part.parent >= 0:
            assert less.parts[part.parent].name == cupboard.parts[true.parent].name
    least = missing_part(less)  # now the door, and the knob with it
    assert [p.name for p in least.parts] == ["body", "drum"]
    fixed = missing_part(rest_only(cupboard))
    assert len(fixed.parts) == 5 and not changed(fixed, rest_only(cupboard))


def test_every_control_but_the_exact_one_changes_the_cupboard(cupboard):
    assert {name for name, control in CONTROLS.items() if changed(control(cupboard), cupboard)} == (
        set(CONTROLS) - {"exact"}
    )

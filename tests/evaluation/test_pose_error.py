"""Pose error: closed formulas for a door, and that every planted error is seen, the more the larger
it is."""

import dataclasses
import itertools

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from uniart_jax import procedural
from uniart_jax.evaluation.metric import STATES, at_rest
from uniart_jax.evaluation.pose_error import METRICS, measure, surface_samples
from uniart_jax.objects.kinematics import Joint, rotation
from uniart_jax.objects.object import ArticulatedObject, Part

SAMPLING = 0.01  # relative: 512 points on a part
HINGE = np.array(
    [0.0, -0.5, 0.0]
)  # the door covers y from the hinge on, so its size along y is its reach
REACH, HEIGHT = 0.8, 0.9
GAP = 0.001  # so that no surface belongs to two parts


def box(size, center):
    return trimesh.creation.box(size, trimesh.transformations.translation_matrix(center))


def cabinet(*joints: Joint, number: int = 1) -> ArticulatedObject:
    """A body and, GAP before it, doors without thickness one above the other, each REACH wide with
    its hinge along HINGE + z."""
    high = HEIGHT / number
    doors = [
        Part(
            f"door{i}",
            box((0, REACH, high), (0, REACH / 2 - 0.5, (i + 0.5) * high - HEIGHT / 2)),
            0,
            joint,
        )
        for i, joint in enumerate(joints)
    ]
    return ArticulatedObject((Part("body", box((0.6, 1, 1), (0.3 + GAP, 0, 0))), *doors))


def door(angle=np.pi / 2, tilt=0.0, shift=0.0) -> Joint:
    """A hinge that opens by ``angle``; its axis tilts in the door's plane, about the door's middle
    height, and shifts away from the door."""
    span = (0.0, angle) if angle >= 0 else (angle, 0.0)
    return Joint(HINGE - [0, shift, 0], [0, np.sin(tilt), np.cos(tilt)], span)


def error(pred, ref) -> float:
    return measure(pred, ref)["pose_error"]


def chord(angle: float) -> float:
    """Mean over STATES of the distance between a point at the mean radius and itself turned by
    ``angle`` times the state."""
    return float(np.mean(2 * (REACH / 2) * np.sin(angle * STATES / 2)))


def test_doors_in_closed_form():
    """Every point of the door is at a radius r uniform in [0, REACH], so its mean is REACH / 2; two
    parts, the body right: half of that."""
    ref = cabinet(door(np.pi / 2))
    assert error(cabinet(Joint.fixed()), ref) == pytest.approx(chord(np.pi / 2) / 2, rel=SAMPLING)
    assert error(cabinet(door(-np.pi / 2)), ref) == pytest.approx(chord(np.pi) / 2, rel=SAMPLING)
    assert error(cabinet(door(np.pi / 4)), ref) == pytest.approx(chord(np.pi / 4) / 2, rel=SAMPLING)
    # a hinge beside its place: T_pred T_ref^-1 is a travel of 2 |shift| sin(angle / 2), whatever
    # the point
    shifted = np.mean(2 * 0.1 * np.sin(np.pi / 2 * STATES / 2)) / 2
    assert error(cabinet(door(shift=0.1)), ref) == pytest.approx(shifted, rel=1e-9)
    drawer = cabinet(Joint([0, 0, 0], [-1, 0, 0], travel=(0, 0.4)))
    assert error(cabinet(Joint.fixed()), drawer) == pytest.approx(0.4 * STATES.mean() / 2, rel=1e-9)


def test_the_farthest_so_far_does_not_fold_back():
    """Half a turn: inwards it is across the circle from half way on, while a door that never moves
    gets there at the end."""
    ref = cabinet(door(np.pi))
    inwards = np.mean(REACH * np.sin(np.pi * np.minimum(STATES, 0.5))) / 2
    assert error(cabinet(door(-np.pi)), ref) == pytest.approx(inwards, rel=SAMPLING)
    assert error(cabinet(Joint.fixed()), ref) == pytest.approx(chord(np.pi) / 2, rel=SAMPLING)
    assert inwards > chord(np.pi) / 2


def test_rest_is_geometry_alone():
    """A drawer's front that stands d before its place: d at every state, and the same d at rest."""
    joint = Joint([0, 0, 0], [-1, 0, 0], travel=(0, 0.4))
    ref = cabinet(joint)
    moved = dataclasses.replace(ref.parts[1], mesh=ref.parts[1].mesh.copy())
    moved.mesh.apply_translation((-0.03, 0, 0))
    figures = measure(dataclasses.replace(ref, parts=(ref.parts[0], moved)), ref)
    assert figures["pose_error"] == pytest.approx(0.03 / 2, rel=1e-9)
    assert figures["pose_rest"] == pytest.approx(0.03 / 2, rel=1e-9)
    assert measure(cabinet(Joint.fixed()), ref)["pose_rest"] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize(
    "family",
    [
        *procedural.SEEN_FAMILIES,
        *(pytest.param(f, marks=pytest.mark.slow) for f in procedural.FAMILIES[7:]),
    ],
)
def test_every_family_against_itself_is_perfect(family):
    obj = at_rest(procedural.generate(family, 1))
    assert max(measure(obj, obj).values()) < 1e-12
    still = tuple(dataclasses.replace(p, joint=Joint.fixed()) for p in obj.parts)
    assert error(dataclasses.replace(obj, parts=still), obj) > 0.01


@settings(max_examples=25)
@given(
    angle=st.floats(0.5, np.pi),
    kind=st.sampled_from(["tilt", "shift", "more", "less"]),
    small=st.floats(0.02, 0.5),
    more=st.floats(1.1, 1.5),
)
def test_monotone_in_every_planted_error(angle, kind, small, more):
    ref = cabinet(door(angle))

    def planted(size):
        return {
            "tilt": lambda: door(angle, tilt=1.2 * size),
            "shift": lambda: door(angle, shift=0.5 * size),
            "more": lambda: door(angle * (1 + size)),
            "less": lambda: door(angle * (1 - size)),
        }[kind]()

    sizes = [0.0, small, min(small * more, 0.75)]
    errors = [error(cabinet(planted(s)), ref) for s in sizes]
    assert errors[0] < 1e-12
    assert errors[0] < errors[1] < errors[2]


@settings(max_examples=20)
@given(angle=st.floats(0.3, np.pi), share=st.floats(0.1, 0.9))
def test_the_wrong_way_is_worst(angle, share):
    ref = cabinet(door(angle))
    order = [door(angle), door(share * angle), Joint.fixed(), door(-share * angle), door(-angle)]
    errors = [error(cabinet(joint), ref) for joint in order]
    assert all(a < b - 1e-4 for a, b in itertools.pairwise(errors))


@settings(max_examples=10)
@given(angle=st.floats(0.3, 2.5), height=st.floats(0.05, 0.4))
def test_a_missing_and_a_surplus_part_are_seen(angle, height):
    plain = cabinet(door(angle))
    shelf = Part("shelf", box((0.1, 0.5, height), (-0.05, 0.2, 0)), 0, Joint.fixed())
    more = dataclasses.replace(plain, parts=(*plain.parts, shelf))
    without = dataclasses.replace(plain, parts=plain.parts[:1])
    for a, b in ((more, plain), (without, plain)):
        assert error(a, b) > 1e-3
        assert error(a, b) == pytest.approx(error(b, a), abs=1e-12)
    # where a part is missing the points are held to what is nearest: the body, which stays
    expected = error(cabinet(Joint.fixed()), plain) / 2
    assert error(without, plain) == pytest.approx(expected, abs=SAMPLING * expected + GAP / 4)


def test_a_double_changes_no_pose():
    ref = cabinet(door())
    double = dataclasses.replace(ref.parts[1], name="again")
    assert error(dataclasses.replace(ref, parts=(*ref.parts, double)), ref) < 1e-12


def test_a_joint_that_turns_for_ever_turns_either_way():
    spin, back = Joint(HINGE, [0, 0, 1], (-np.pi, np.pi)), Joint(HINGE, [0, 0, -1], (-np.pi, np.pi))
    assert error(cabinet(back), cabinet(spin)) < 1e-12
    for bounded in (door(np.pi / 2), door(-np.pi / 2)):  # to the side to which the other opens
        assert error(cabinet(bounded), cabinet(spin)) < 1e-12
        assert error(cabinet(spin), cabinet(bounded)) < 1e-12
    leaning = [Joint(HINGE, [0, np.sin(a), np.cos(a)], (-np.pi, np.pi)) for a in (0.1, 0.3)]
    small, large = (error(cabinet(j), cabinet(spin)) for j in leaning)
    assert 0 < small < large


def test_screws():
    def cap(turns, travel):
        return cabinet(Joint(HINGE, [0, 0, 1], (0, 2 * np.pi * turns), (0, travel)))

    ref = cap(2, 0.3)
    errors = [error(cap(*other), ref) for other in ((2, 0.3), (2, 0.25), (2, 0.2), (2, -0.3))]
    assert errors[0] < 1e-12
    assert all(a < b for a, b in itertools.pairwise(errors))
    assert error(cap(1, 0.3), ref) > 0.2  # a whole turn less is not forgiven, though the ends meet
    assert errors[3] == pytest.approx(2 * 0.3 * STATES.mean() / 2, rel=1e-9)


def test_children_ride_on_their_parents():
    """A handle on a door shares the door's error, though its own joint is right."""
    handle = Part("handle", box((0.02, 0.02, 0.2), (-0.02, 0.2, 0)), 1, Joint.fixed())
    ref, pred = (
        dataclasses.replace(o, parts=(*o.parts, handle)) for o in (cabinet(door()), cabinet(door(-1.0)))  # noqa: E501
    )  # fmt: skip
    assert error(pred, ref) > 1.2 * error(cabinet(door(-1.0)), cabinet(door())) * 2 / 3 > 0.1


def test_invariances():
    ref = cabinet(door(1.2), door(0.7), number=2)
    pred = cabinet(door(0.9, tilt=0.1), door(-0.7, shift=0.05), number=2)
    expected = measure(pred, ref)
    turned = np.eye(4)
    turned[:3, :3] = rotation(np.array([0, 0, 1.0]), np.pi / 2)
    turned[:3, 3] = [0.3, -2, 1]
    mirrored = np.diag([1.0, -1, 1, 1])
    for matrix in (turned, mirrored, turned @ turned):
        moved = measure(pred.transformed(matrix), ref.transformed(matrix))
        assert moved == pytest.approx(expected, abs=1e-3)
    swapped = dataclasses.replace(pred, parts=tuple(pred.parts[i] for i in (0, 2, 1)))
    assert measure(swapped, ref) == pytest.approx(expected, abs=1e-12)
    assert measure(ref, pred) == pytest.approx(expected, abs=1e-12)


def test_any_rotation_of_one_part():
    """Where there is nothing to match, the frame does not matter."""
    a = ArticulatedObject((Part("a", box((1, 0.5, 0.2), (0, 0, 0))),))
    b = ArticulatedObject((Part("b", trimesh.creation.icosphere(3, 0.5)),))
    expected = measure(a, b)
    matrix = np.eye(4)
    matrix[:3, :3] = rotation(np.array([1, 2, 3.0]) / 14**0.5, 0.7)
    assert measure(a.transformed(matrix), b.transformed(matrix)) == pytest.approx(expected)
    assert expected["pose_error"] == pytest.approx(expected["pose_rest"])
    assert set(expected) == set(METRICS)


def test_two_parts_with_nearly_one_box_may_be_swapped():
    """As the module says: by boxes alone the nearer one is taken, and the figure is that of swapped
    parts."""
    first, second = door(1.0), door(-1.0)
    ref = cabinet(first, second)
    slab = box((0, REACH, HEIGHT), (0, REACH / 2 - 0.5, 0))
    near, far = slab.copy(), slab.copy()
    far.apply_translation((-0.002, 0, 0))
    ref = dataclasses.replace(
        ref,
        parts=(ref.parts[0], Part("a", near, 0, first), Part("b", far, 0, second)),
    )
    swapped = dataclasses.replace(
        ref, parts=(ref.parts[0], Part("a", far, 0, first), Part("b", near, 0, second))
    )
    assert error(ref, ref) < 1e-12
    assert error(swapped, ref) > 0.2  # two of three parts seem to open the wrong way


def test_samples_are_even_and_do_not_depend_on_the_mesh():
    coarse = box((1, 0.5, 0.2), (0, 0, 0))
    points = surface_samples(coarse, 512)
    assert np.abs(np.abs(points) / [0.5, 0.25, 0.1]).max(1) == pytest.approx(1)
    top = points[:, 2] > 0.1 - 1e-9
    assert top.mean() == pytest.approx(0.5 / coarse.area, abs=0.01)
    assert np.linalg.norm(points.mean(0)) < 0.005
    np.testing.assert_allclose(points[top].std(0)[:2], np.array([1, 0.5]) / 12**0.5, rtol=0.03)
    fine = surface_samples(coarse.subdivide().subdivide(), 512)
    np.testing.assert_allclose(fine.std(0), points.std(0), rtol=0.02)
    flat = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], process=False)
    assert np.isfinite(surface_samples(flat, 8)).all()

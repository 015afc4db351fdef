"""Articulated objects: order, shown states, normalisation, rest and open."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import SimpleMaterial

from uniart_jax.objects.kinematics import TRAVEL_DEAD_ZONE, Joint, rotation
from uniart_jax.objects.object import ArticulatedObject, Part, moved_mesh


def box(low, high) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[low, high])


def cabinet(door: Joint | None = None) -> ArticulatedObject:
    """A body, a door hinged at its left front edge (front is -x), a knob on the door, a drawer."""
    door = door or Joint([-0.5, 0.5, 0], [0, 0, 1], angle=(0, np.pi / 2))
    return ArticulatedObject(
        (
            Part("knob", box([-0.6, -0.4, -0.05], [-0.55, -0.3, 0.05]), 2),
            Part("body", box([-0.5, -0.5, -0.5], [0.5, 0.5, 0.5])),
            Part("door", box([-0.55, -0.5, -0.4], [-0.5, 0.5, 0.4]), 1, door),
            Part(
                "drawer",
                box([-0.5, -0.4, 0.4], [0.4, 0.4, 0.5]),
                1,
                Joint([0, 0, 0], [-1, 0, 0], travel=(0, 0.6)),
            ),
        ),
        name="cabinet",
    )


def random_object(seed: int) -> ArticulatedObject:
    rng = np.random.default_rng(seed)
    parts = [Part("p0", box(-rng.uniform(0.1, 0.5, 3), rng.uniform(0.1, 0.5, 3)))]
    for k in range(1, 6):
        low = rng.uniform(-1, 0.5, 3)
        kind = rng.integers(5)
        angle, travel = (
            ((0, 0), (0, 0)) if kind == 0 else ((-rng.uniform(0, 1), rng.uniform(0.2, 1)), (0, 0))
        )
        if kind == 2:
            angle = (-np.pi, np.pi)
        if kind == 3:
            angle, travel = (0, 0), angle
        if kind == 4:
            travel = tuple(np.array(angle) * rng.choice([-0.3, 0.3]))
        joint = Joint(rng.uniform(-0.5, 0.5, 3), rng.normal(size=3), angle, travel)
        parts.append(
            Part(f"p{k}", box(low, low + rng.uniform(0.1, 0.5, 3)), int(rng.integers(k)), joint)
        )
    return ArticulatedObject(tuple(parts), scale=2.0)


def test_parents_come_first_and_names_are_kept():
    obj = cabinet()
    assert [p.name for p in obj.parts] == ["body", "door", "drawer", "knob"]
    assert obj.parents == [-1, 0, 0, 1]
    assert obj.index("knob") == 3
    with pytest.raises(ValueError, match="no part is named 'lid'"):
        obj.index("lid")


def test_broken_objects_are_refused():
    part = Part("a", box([0, 0, 0], [1, 1, 1]))
    corners = [[0, 0, 0], [1, 0, np.nan], [0, 1, 0]]
    broken = trimesh.Trimesh(corners, [[0, 1, 2]], process=False)
    for parts, words in (
        ((), "no parts"),
        ((part, part), "two parts are named 'a'"),
        ((part, dataclasses.replace(part, name="b")), "one root"),
        ((Part("a", trimesh.Trimesh()),), "no faces"),
        ((Part("a", broken),), "not finite"),
    ):
        with pytest.raises(ValueError, match=words):
            ArticulatedObject(parts)
    unused = trimesh.Trimesh([*part.mesh.vertices, [np.nan] * 3], part.mesh.faces, process=False)
    ArticulatedObject((Part("a", unused),))  # no face has that vertex


def test_a_knob_follows_its_door():
    obj = cabinet()
    moved = obj.forward_kinematics({"door": np.pi / 2})
    knob = trimesh.transform_points(obj.parts[3].mesh.vertices, moved[3]).mean(0)
    np.testing.assert_allclose(knob, [-0.5 + 0.85, 0.5 - 0.075, 0], atol=1e-9)
    with pytest.raises(ValueError, match="shape"):
        obj.forward_kinematics([0.0, 1.0])


@given(st.integers(0, 10**6))
def test_moving_the_shown_state_then_moving_equals_moving_directly(seed):
    obj = random_object(seed)
    rng = np.random.default_rng(seed + 1)
    first = np.array([rng.uniform(*j.limits) for j in obj.joints])
    second = np.array([rng.uniform(*j.limits) for j in obj.joints])
    shown = obj.shown_at(first)
    assert all(lo <= 1e-9 and hi >= -1e-9 for lo, hi in shown.limits)
    again = shown.forward_kinematics(second - first)
    direct = obj.forward_kinematics(second)
    for k, part in enumerate(obj.parts):
        np.testing.assert_allclose(
            trimesh.transform_points(shown.parts[k].mesh.vertices, again[k]),
            trimesh.transform_points(part.mesh.vertices, direct[k]),
            atol=1e-9,
        )


@given(st.integers(0, 10**6))
def test_normalised_and_scaled_back_is_the_same_object(seed):
    obj = random_object(seed)
    unit = obj.normalized()
    np.testing.assert_allclose(unit.bounds.mean(0), 0, atol=1e-12)
    assert np.ptp(unit.bounds, axis=0).max() == pytest.approx(1)
    assert all(p.joint.dead_zone == TRAVEL_DEAD_ZONE for p in unit.parts)
    side = np.ptp(obj.bounds, axis=0).max()
    assert unit.scale == pytest.approx(2.0 * side)
    q = np.array([np.random.default_rng(seed).uniform(*j.limits) for j in obj.joints])
    turns = np.array([1.0 if j.rotates else side for j in obj.joints])
    np.testing.assert_allclose(
        unit.mesh(q / turns).vertices * side + obj.bounds.mean(0), obj.mesh(q).vertices, atol=1e-8
    )


@pytest.mark.parametrize("mirror", [False, True])
def test_a_transformed_object_moves_alike(mirror):
    matrix = np.eye(4)
    matrix[:3, :3] = (
        2 * rotation(np.array([0.6, 0, 0.8]), 0.7) @ np.diag([1, -1 if mirror else 1, 1])
    )
    obj = random_object(3)
    moved = obj.transformed(matrix)
    rng = np.random.default_rng(0)
    q = np.array([rng.uniform(*j.limits) for j in obj.joints])
    scaled = q * [1 if j.rotates else 2 for j in obj.joints]
    expected = trimesh.transform_points(obj.mesh(q).vertices, matrix)
    np.testing.assert_allclose(moved.mesh(scaled).vertices, expected, atol=1e-9)
    assert all(p.mesh.volume > 0 for p in moved.parts)  # a mirror turns the faces round


def test_moved_meshes_keep_their_colours_and_share_their_textures():
    mesh = box([0, 0, 0], [1, 1, 1])
    mesh.visual.face_colors = np.arange(48).reshape(12, 4)
    mirrored = moved_mesh(mesh, np.diag([1, -1, 1, 1]))
    np.testing.assert_array_equal(mirrored.visual.face_colors, mesh.visual.face_colors)
    material = SimpleMaterial(image=Image.new("RGB", (4, 4)))
    mesh.visual = TextureVisuals(uv=np.random.default_rng(0).random((8, 2)), material=material)
    moved = moved_mesh(mesh, np.eye(4))
    assert moved.visual.material is material
    np.testing.assert_array_equal(moved.visual.uv, mesh.visual.uv)


def test_rest_is_the_limit_near_zero_or_the_smaller_end():
    obj = cabinet()
    np.testing.assert_array_equal(obj.rest(), [0, 0, 0, 0])
    shown = obj.shown_at({"door": 1.0, "drawer": 0.3})
    np.testing.assert_allclose(shown.rest(), [0, -1.0, -0.3, 0], atol=1e-12)
    almost = obj.shown_at({"door": np.deg2rad(0.5)})
    assert almost.rest()[1] == pytest.approx(-np.deg2rad(0.5))
    wheel = cabinet(Joint([-0.5, 0, 0], [1, 0, 0], angle=(-np.pi, np.pi)))
    assert wheel.rest()[1] == 0


def test_rest_takes_the_lower_end_on_ties():
    obj = cabinet(Joint([-0.5, 0, 0], [1, 0, 0], angle=(-0.5, 0.5)))
    assert obj.rest()[1] == -0.5


def test_open_is_the_end_away_from_rest():
    obj = cabinet()
    np.testing.assert_allclose(obj.open(), [0, np.pi / 2, 0.6, 0])
    np.testing.assert_allclose(obj.open(0.5), [0, np.pi / 4, 0.3, 0])
    ajar = obj.shown_at(obj.open(0.9))
    np.testing.assert_allclose(ajar.rest() + obj.open(0.9), obj.rest(), atol=1e-9)
    np.testing.assert_allclose(ajar.open() + obj.open(0.9), obj.open(), atol=1e-9)
    wheel = cabinet(Joint([-0.5, 0, 0], [1, 0, 0], angle=(-np.pi, np.pi)))
    assert wheel.open()[1] == pytest.approx(np.pi / 2)


def test_boxes_are_the_parts_own():
    np.testing.assert_allclose(cabinet().boxes[1], [-0.525, 0, 0, 0.05, 1, 0.8])


@pytest.mark.parametrize("size", [1.0, 7.0])
@pytest.mark.parametrize(("back", "at_lower"), [(0.003, True), (0.02, False)])
def test_rest_is_the_limit_that_is_all_but_reached(size, back, at_lower):
    """A bolt that stands out, and would make the object smaller by going in."""
    block = trimesh.creation.box(bounds=[[-0.5, -0.2, -0.2], [0.5, 0.2, 0.2]])
    bolt = trimesh.creation.box(bounds=[[-0.1, -0.1, 0.1], [0.1, 0.1, 0.4]])
    joint = Joint(np.zeros(3), [0, 0, -1], travel=(-back, 0.2))
    obj = ArticulatedObject((Part("block", block), Part("bolt", bolt, 0, joint)))
    obj = obj.transformed(np.diag([size, size, size, 1]))
    assert obj.rest()[1] == pytest.approx(size * (-back if at_lower else 0.2))

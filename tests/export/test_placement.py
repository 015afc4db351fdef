"""Files have an object closed, on the floor, and its coordinates grow as it opens."""

from __future__ import annotations

import itertools
import json

import mujoco
import numpy as np
import pytest
import trimesh
from asset_objects import make_cabinet

from uniart_jax import procedural
from uniart_jax.export.asset import save_asset
from uniart_jax.export.physics import Body, Box, Hull
from uniart_jax.export.placement import moved_bodies, place
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.load import load_object
from uniart_jax.objects.object import ArticulatedObject, Part

pytestmark = pytest.mark.usefixtures("small_pictures")

OBJECTS = [("oven", 900_001), ("refrigerator", 900_002), ("table", 900_003), ("toilet", 900_004)]


def corners(box: Box) -> np.ndarray:
    """[8, 3] in an order that does not depend on what its axes are called."""
    signs = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
    return in_order(signs * box.size @ box.rotation.T + box.center)


def in_order(points: np.ndarray) -> np.ndarray:
    return points[np.lexsort(np.round(points, 6).T)]


@pytest.mark.parametrize("axis", np.vstack([np.eye(3), [1, 2, 3]]))
@pytest.mark.parametrize("angle", [0.4, np.pi / 2, 2.0, np.pi])
def test_a_moved_box_is_the_same_box(axis, angle):
    matrix = trimesh.transformations.rotation_matrix(angle, axis, [0.3, 0.1, 0.2])
    box = Box(np.array([0.1, 0.2, 0.3]), np.array([0.1, 0.2, 0.4]), np.eye(3))
    body = Body(1.0, box.center, np.eye(3), (box,), None)
    (moved,) = moved_bodies([body], matrix[None], 1.0)[0].shapes
    assert np.linalg.det(moved.rotation) == pytest.approx(1)
    expected = in_order(trimesh.transform_points(corners(box), matrix))
    np.testing.assert_allclose(corners(moved), expected, atol=1e-9)


def test_reversing_a_joint_keeps_its_motions():
    for angle, travel in (((-2, 0.5), (0, 0)), ((0, 0), (-0.2, 0.1)), ((-1, 3), (0.1, -0.3))):
        joint = Joint([0.1, 0.2, 0.3], [1, 2, -1], angle, travel)
        back = joint.reversed()
        for q in np.linspace(*joint.limits, 5):
            np.testing.assert_allclose(back.motion(-q), joint.motion(q), atol=1e-12)
        assert back.limits == (-joint.limits[1], -joint.limits[0])


@pytest.mark.parametrize(("family", "seed"), OBJECTS)
@pytest.mark.parametrize("fraction", [0.0, 0.6, 1.0])
def test_closed_on_the_floor_and_opening_upwards(family, seed, fraction):
    """Whatever state is shown, and wherever the object stands."""
    given = procedural.generate(family, seed)
    given = given.shown_at(given.open(fraction)).transformed(
        trimesh.transformations.translation_matrix([3.0, -1.0, 0.7])
    )
    found = place(given).obj
    lo, hi = found.bounds
    assert lo[2] == pytest.approx(0, abs=1e-12)
    np.testing.assert_allclose((lo + hi)[:2], 0, atol=1e-12)
    np.testing.assert_array_equal(found.rest(), 0)
    for part in found.parts[1:]:
        low, high = part.joint.limits
        if part.joint.type == "continuous":
            assert (low, high) == (-np.pi, np.pi)
        else:
            assert low == 0 and high >= 0
    assert place(found).obj.limits == pytest.approx(found.limits)
    if fraction < 1:  # at its other limit a joint counts as closed there
        closed = place(procedural.generate(family, seed)).obj
        for part, other in zip(found.parts, closed.parts, strict=True):
            if part.joint.type == "continuous":  # closed however it is turned
                continue
            np.testing.assert_allclose(part.mesh.bounds, other.mesh.bounds, atol=1e-9)


@pytest.mark.parametrize(("family", "seed"), OBJECTS)
def test_it_is_the_same_object(family, seed):
    """Every state of what was given is a state of what is written: same shape, moved as a whole."""
    given = procedural.generate(family, seed)
    given = given.shown_at(given.open(0.6))
    found = place(given)
    shift = found.obj.bounds[0] - given.shown_at(given.rest()).bounds[0]
    sign = np.where(np.abs(found.shown) > 0, -np.sign(found.shown * given.rest()), 1)
    for fraction in (0.0, 0.3, 1.0):
        q = given.open(fraction)
        ours = found.shown + sign * q
        for part, twin, a, b in zip(
            given.parts,
            found.obj.parts,
            given.forward_kinematics(q),
            found.obj.forward_kinematics(ours),
            strict=True,
        ):
            if part.joint.type == "continuous":
                continue  # of an axis that others do not follow: checked by its own limits
            np.testing.assert_allclose(
                trimesh.transform_points(twin.mesh.vertices, b) - shift,
                trimesh.transform_points(part.mesh.vertices, a),
                atol=1e-9,
            )


def test_centre_and_as_it_is():
    given = make_cabinet()
    centred = place(given, "centre").obj.bounds
    np.testing.assert_allclose(centred.sum(0), 0, atol=1e-12)
    kept = place(given, None).obj
    np.testing.assert_array_equal(kept.parts[0].mesh.vertices, given.parts[0].mesh.vertices)
    with pytest.raises(ValueError, match="origin 'ceiling': choose of floor, centre") as error:
        place(given, "ceiling")
    assert "\n" not in str(error.value)


def test_bodies_go_with_their_parts():
    """Shapes, the centre of mass and the inertia's main axes stay where they are in the part."""
    turn = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3], [0.3, 0.1, 0.2])
    turn[:3, 3] += [0.5, 0, 1]
    hull = trimesh.creation.icosphere(1, 0.1).apply_translation([0.2, 0, 0])
    box = Box(np.array([0.1, 0.2, 0.3]), np.array([0.1, 0.2, 0.4]), np.eye(3))
    tensor = np.diag([1.0, 2.0, 2.5])
    body = Body(1.0, np.array([0.1, 0.2, 0.3]), tensor, (box, Hull(hull)), None)
    scale = 2.0
    (found,) = moved_bodies([body], turn[None], scale)
    metric = turn.copy()
    metric[:3, 3] *= scale
    rotation = metric[:3, :3]
    np.testing.assert_allclose(found.center, rotation @ body.center + metric[:3, 3])
    np.testing.assert_allclose(found.inertia, rotation @ tensor @ rotation.T)
    moved = trimesh.transform_points(hull.vertices, metric)
    np.testing.assert_allclose(found.shapes[1].mesh.vertices, moved)
    np.testing.assert_allclose(found.shapes[0].center, found.center)
    assert np.linalg.det(found.shapes[0].rotation) == pytest.approx(1)
    np.testing.assert_allclose(
        corners(found.shapes[0]),
        in_order(trimesh.transform_points(corners(box), metric)),
        atol=1e-9,
    )


def test_the_files_stand_on_the_floor_and_open_upwards(tmp_path):
    """A lid that is shown open and opens by falling coordinates, in URDF, MJCF and the report."""
    block = trimesh.creation.box(bounds=[[-0.3, -0.4, -0.3], [0.3, 0.4, 0.2]])
    lid = trimesh.creation.box(bounds=[[-0.3, -0.4, 0.205], [0.3, 0.4, 0.25]])
    joint = Joint([0.3, 0, 0.205], [0, -1, 0], (-1.4, 0))
    closed = ArticulatedObject((Part("link_0", block), Part("link_1", lid, 0, joint)))
    given = closed.shown_at([0, -1.0])
    assert given.limits[1] == pytest.approx([-0.4, 1.0])
    folder = save_asset(given, tmp_path / "out", formats=("mjcf",), motion=False)
    read = load_object(folder)
    assert [p.name for p in read.parts] == ["base", "lid_1"]
    assert read.bounds[0][2] == pytest.approx(0, abs=1e-6)
    assert read.parts[1].joint.limits == pytest.approx((0, 1.4))
    np.testing.assert_allclose(read.parts[1].joint.direction, [0, 1, 0])
    model = mujoco.MjModel.from_xml_path(str(folder / "object.xml"))
    assert model.joint("lid_1_joint").range == pytest.approx([0, 1.4])
    report = json.loads((folder / "report.json").read_text())
    assert report["shown"] == {"lid_1_joint": pytest.approx(1.0)}
    told = report["parts"][1]
    assert told["as_read"]["name"] == "link_1"
    assert told["as_read"]["angle"] == pytest.approx([-0.4, 1.0])
    centre = save_asset(given, tmp_path / "centre", formats=(), motion=False, origin="centre")
    np.testing.assert_allclose(load_object(centre).bounds.sum(0), 0, atol=1e-6)

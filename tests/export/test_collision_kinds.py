"""``--collision``: boxes alone, one hull a part, coacd's pieces; all within the budget."""

from __future__ import annotations

import importlib.util
import json
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
import trimesh

from uniart_jax.export.asset import save_asset
from uniart_jax.export.bodies import make_bodies
from uniart_jax.export.budget import within_budget
from uniart_jax.export.collision_kinds import boxes_alone, check_collision, hulls_alone
from uniart_jax.export.physics import Box, Hull
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part

pytestmark = pytest.mark.usefixtures("small_pictures")

HAS_COACD = importlib.util.find_spec("coacd") is not None


def tray() -> trimesh.Trimesh:
    outer = trimesh.creation.box(bounds=[[0, 0, 0], [0.4, 0.3, 0.2]])
    inner = trimesh.creation.box(bounds=[[0.02, 0.02, 0.02], [0.38, 0.28, 0.3]])
    return trimesh.boolean.difference([outer, inner], engine="manifold")


def drawer() -> ArticulatedObject:
    """A tray that slides on a block, with a round knob before it."""
    block = trimesh.creation.box(bounds=[[0, 0, -0.3], [0.4, 0.3, -0.01]])
    knob = trimesh.creation.cylinder(0.03, 0.05).apply_translation([-0.031, 0.15, 0.1])
    parts = (
        Part("base", block),
        Part("tray", tray(), 0, Joint([0, 0, 0], [-1, 0, 0], travel=(0, 0.3))),
        Part("knob", knob, 1),
    )
    return ArticulatedObject(parts)


def contained(points: np.ndarray, shapes) -> np.ndarray:
    """[n] whether points [n, 3] lie in one of the convex shapes, or within a millimetre of it."""
    inside = np.zeros(len(points), bool)
    for shape in shapes:
        if isinstance(shape, Box):
            local = np.abs((points - shape.center) @ shape.rotation)
            inside |= (local <= np.asarray(shape.size) / 2 + 1e-3).all(1)
        else:
            planes, corners = shape.mesh.face_normals, shape.mesh.triangles[:, 0]
            away = points @ planes.T - (planes * corners).sum(1)
            inside |= (away <= 1e-3).all(1)
    return inside


def bodies(collision: str):
    obj = drawer()
    meshes = [part.mesh for part in obj.parts]
    made = make_bodies(obj, meshes, collision=collision)
    return obj, within_budget(obj, made, meshes, boxes=collision == "boxes")


def test_boxes_alone_hold_the_surface_and_keep_the_tray_open():
    obj, made = bodies("boxes")
    assert all(isinstance(shape, Box) for body in made for shape in body.shapes)
    for part, body in zip(obj.parts, made, strict=True):
        assert contained(part.mesh.sample(500, seed=0), body.shapes).mean() > 0.98
    assert not contained(np.array([[0.2, 0.15, 0.1]]), made[1].shapes).any()


def test_few_boxes_stay_boxes():
    """A budget of one shape a part joins the tray's walls to one box, never to a hull."""
    obj = drawer()
    meshes = [part.mesh for part in obj.parts]
    ring = trimesh.creation.annulus(0.1, 0.15, 0.05)
    obj = ArticulatedObject((*obj.parts, Part("ring", ring, 0)))
    made = make_bodies(obj, [*meshes, ring], collision="boxes")
    assert sum(len(body.shapes) for body in made) > 8
    few = within_budget(obj, made, [*meshes, ring], 4, boxes=True)
    assert sum(len(body.shapes) for body in few) == 4
    assert all(isinstance(shape, Box) for body in few for shape in body.shapes)


def test_a_hull_is_one_shape_a_part_and_fills_the_tray():
    obj, made = bodies("hull")
    assert [len(body.shapes) for body in made] == [1, 1, 1]
    for part, body in zip(obj.parts, made, strict=True):
        assert contained(part.mesh.vertices, body.shapes).all()
    assert contained(np.array([[0.2, 0.15, 0.1]]), made[1].shapes).all()
    assert made[1].volume_error > 0.5  # and the report tells


def test_a_hull_of_many_points_has_64_and_a_sheet_gets_a_thickness():
    ball = trimesh.creation.icosphere(4, 0.1)
    sheet = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    (round_,), (flat,) = hulls_alone([ball, sheet], 1.0)
    assert isinstance(round_, Hull) and len(round_.mesh.vertices) <= 64
    assert round_.mesh.volume > 0.85 * ball.volume
    size = np.asarray(flat.size) if isinstance(flat, Box) else np.ptp(flat.mesh.vertices, axis=0)
    assert (size > 1e-6).all() and np.sort(size)[1:] == pytest.approx([1, 1], abs=0.02)


def test_boxes_lie_along_the_axes_of_what_they_hold():
    turned = trimesh.creation.box([0.4, 0.1, 0.02])
    turned.apply_transform(trimesh.transformations.rotation_matrix(0.4, [0, 0, 1]))
    ((box,),) = boxes_alone([(Hull(turned),)])
    assert np.sort(box.size) == pytest.approx([0.02, 0.1, 0.4], abs=1e-6)


@pytest.mark.parametrize("collision", ["boxes", "hull"])
def test_files_and_report_have_what_was_asked_for(tmp_path, collision):
    save_asset(
        drawer(), tmp_path / "a", formats=("mjcf",), motion=False, collision=collision,
        collision_budget=6,
    )  # fmt: skip
    report = json.loads((tmp_path / "a" / "report.json").read_text())
    assert report["collision"] == collision
    shapes = [
        len(link.findall("collision"))
        for link in ElementTree.parse(tmp_path / "a" / "object.urdf").iter("link")
    ]
    assert shapes == [part["shapes"] for part in report["parts"]]
    assert sum(shapes) == (3 if collision == "hull" else 6)
    assert bool(list((tmp_path / "a/meshes/collision").iterdir())) == (collision == "hull")


def test_an_unknown_kind_and_absent_coacd_are_one_line(tmp_path, monkeypatch):
    with pytest.raises(ValueError, match="'balls': there are merged, coacd, boxes, hull"):
        save_asset(drawer(), tmp_path / "a", collision="balls")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match="coacd is not installed"):
        check_collision("coacd")
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not HAS_COACD, reason="pip install coacd")
def test_coacd_keeps_the_tray_open():
    obj, made = bodies("coacd")
    assert all(1 <= len(body.shapes) <= 16 for body in made)
    assert not contained(np.array([[0.2, 0.15, 0.1]]), made[1].shapes).any()
    assert contained(obj.parts[1].mesh.sample(500, seed=0), made[1].shapes).mean() > 0.9

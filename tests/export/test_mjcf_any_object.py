"""The MJCF of any object: every kind of mesh, tree and name; what it cannot hold is said."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import trimesh
from asset_objects import make_cabinet
from hand_bodies import write_files
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree
from written_mjcf import assert_same_object, compiled, largest_error, written

from uniart_jax.export.mjcf import write_mjcf
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.load import load_object
from uniart_jax.objects.names import clean
from uniart_jax.objects.object import ArticulatedObject, Part


def box(lo, hi) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[lo, hi])


@pytest.mark.parametrize("scale", [1e-3, 1.0, 50.0])
def test_any_visual_mesh_loads(tmp_path, scale):
    """A flat sheet, an open shell, an inside-out box, a mesh with an edge of three faces."""
    sheet = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    shell = box([0, 0, 0], [1, 1, 1])
    shell.update_faces(np.arange(10))
    inverted = box([0, 0, 0], [1, 1, 1])
    inverted.invert()
    fin = trimesh.Trimesh(
        [[0, 0, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, -1, 0]],
        [[0, 1, 2], [0, 1, 3], [0, 1, 4]],
    )
    parts = [Part("base", box([0, 0, -1], [1, 1, 0]))]
    for name, mesh in (("sheet", sheet), ("shell", shell), ("inverted", inverted), ("fin", fin)):
        parts.append(Part(name, mesh, 0, Joint([0, 0, 0], [1, 0, 0], (0, 1))))
    obj = ArticulatedObject(tuple(parts), scale=scale)
    _, notes = written(obj, tmp_path / "flat")
    assert not any("visual" in note for note in notes)
    model = compiled(tmp_path / "flat" / "object.xml")
    assert int(np.sum(np.asarray(model.geom_group) == 2)) == len(parts)
    assert_same_object(load_object(tmp_path / "flat"), obj)


def test_what_mujoco_takes_no_mesh_of_is_said(tmp_path):
    triangle = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 1, 2]])
    obj = ArticulatedObject((Part("base", box([0, 0, -1], [1, 1, 0])), Part("leaf", triangle, 0)))
    _, notes = written(obj, tmp_path / "leaf")
    assert any("'leaf' has no visual geom" in note for note in notes)
    compiled(tmp_path / "leaf" / "object.xml")


def test_a_part_alone(tmp_path):
    obj = ArticulatedObject((Part("world", box([0, 0, 0], [1, 1, 1])),))
    _, notes = written(obj, tmp_path / "one")
    assert notes == ("MJCF: part 'world' is called 'world_2': MuJoCo keeps the name for itself",)
    model = compiled(tmp_path / "one" / "object.xml")
    assert model.nq == 0 and model.body(1).name == "world_2"


def test_lists_that_do_not_fit_are_refused(tmp_path):
    obj = make_cabinet()
    given = write_files(obj, tmp_path / "a")
    path = tmp_path / "a" / "object.xml"
    with pytest.raises(ValueError, match="bodies has 1 entries for 6 parts"):
        write_mjcf(obj, path, given.visual_files, given.bodies[:1], given.hull_files, given.texture)
    with pytest.raises(ValueError, match="part 'body' has 1 hulls and 0 hull_files"):
        write_mjcf(obj, path, given.visual_files, given.bodies, [[]] * 6, given.texture)
    still = [dataclasses.replace(b, dynamics=None) for b in given.bodies]
    with pytest.raises(ValueError, match="'door' has no dynamics"):
        write_mjcf(obj, path, given.visual_files, still, given.hull_files, given.texture)
    named = dataclasses.replace(obj.parts[0], name="a\0b")
    bad = dataclasses.replace(obj, parts=(named, *obj.parts[1:]))
    with pytest.raises(ValueError, match="cannot stand in XML") as error:
        write_mjcf(bad, path, given.visual_files, given.bodies, given.hull_files, given.texture)
    assert "\n" not in str(error.value) and not path.exists()


NAMES = st.lists(
    st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"]), max_size=8)
    | st.sampled_from(["world", "world_2", "", 'a"<&', "a/b", " a ", "a_joint", "base_collision0"]),
    min_size=3,
    max_size=3,
    unique=True,
)


@given(names=NAMES, data=st.data())
def test_any_tree_and_names(tmp_path_factory, names, data):
    """Random joints of every kind under random names: compiled, and the same motion by body
    index."""
    folder = tmp_path_factory.mktemp("any")
    number = st.floats(-1, 1)
    parts = [Part(names[0], box([0, 0, 0], [1, 2, 3]))]
    for k in (1, 2):
        vector = st.tuples(number, number, number)
        direction = data.draw(vector.filter(lambda v: np.linalg.norm(v) > 0.1))
        kind = data.draw(st.sampled_from(["revolute", "continuous", "prismatic", "screw", "fixed"]))
        lo, hi = data.draw(st.floats(-3, -0.1)), data.draw(st.floats(0.1, 3))
        pitch = data.draw(st.sampled_from([-0.3, 0.2]))
        angle, travel = {
            "revolute": ((lo, hi), (0, 0)),
            "continuous": ((-4, 4), (0, 0)),
            "prismatic": ((0, 0), (lo, hi)),
            "screw": ((lo, hi), (pitch * lo, pitch * hi)),
            "fixed": ((0, 0), (0, 0)),
        }[kind]
        joint = Joint(data.draw(vector), direction, angle, travel)
        parts.append(
            Part(names[k], box([k, 0, 0], [k + 1, 1, 1]), data.draw(st.integers(0, k - 1)), joint)
        )
    obj = ArticulatedObject(tuple(parts), scale=0.7)
    written(obj, folder / "x")
    model = compiled(folder / "x" / "object.xml")
    endless = sum(p.joint.type == "continuous" for p in obj.parts)
    assert int(np.sum(np.asarray(model.jnt_limited))) == model.njnt - endless
    root = etree.parse(folder / "x" / "object.xml").getroot()
    bodies = [b.get("name") for b in root.iter("body")]
    assert [model.body(i + 1).name for i in range(3)] == bodies
    renamed = [n for n in names if n in ("", "world")]
    if not renamed:
        assert set(bodies) == set(names)
        assert largest_error(obj, model, seed=1) <= 1e-6
    if all(n == clean(n) and n not in ("", "world") for n in names):
        assert_same_object(load_object(folder / "x"), obj)

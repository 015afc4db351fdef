"""Repairs of what real URDFs get wrong, each told once."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from PIL import Image
from urdf_texts import BOX, joint, limit, link, mesh, notes, robot

from uniart_jax.objects.appearance import sample_color
from uniart_jax.objects.asset_files import AssetFiles
from uniart_jax.objects.robot_object import lost_pieces


@pytest.mark.parametrize(
    ("inner", "kind", "limits", "words"),
    [
        (f'<axis xyz="0 0 5"/>{limit(0, 1)}', "revolute", (0, 1), "has length 5"),
        (f'<axis xyz="0 0 0"/>{limit(0, 1)}', "fixed", (0, 0), "axis is zero"),
        (f'<axis xyz="None None None"/>{limit(0, 1)}', "fixed", (0, 0), "axis is zero"),
        (limit(1, -1), "revolute", (-1, 1), "swapped"),
        ("", "continuous", (-np.pi, np.pi), "without limits"),
        ('<limit effort="1" velocity="1"/>', "continuous", (-np.pi, np.pi), "without limits"),
        (
            limit(-1e16, 1e16),
            "continuous",
            (-np.pi, np.pi),
            "-1e+16, 1e+16 means none; read as continuous",
        ),
        (
            limit(0, float("inf")),
            "continuous",
            (-np.pi, np.pi),
            ": inf means none; read as continuous",
        ),
        (limit(3.4e38, -3.4e38), "continuous", (-np.pi, np.pi), "swapped"),
        (limit(0, 90), "revolute", (0, np.pi / 2), "degrees"),
        (limit(0.5, 1), "revolute", (0, 0.5), "shown at 0.5"),
        (limit(-2, -0.5), "revolute", (-1.5, 0), "shown at -0.5"),
        (limit(0, 0.001), "fixed", (0, 0), "less than .1 degree or 0.1 mm"),
        (limit(0, 1) + '<mimic joint="nobody"/>', "revolute", (0, 1), "cannot drive it"),
    ],
)
def test_joints_are_repaired(load, inner, kind, limits, words):
    obj = load(link("base"), link("door"), joint("revolute", "door", inner))
    assert obj.parts[1].joint.type == kind
    np.testing.assert_allclose(obj.parts[1].joint.limits, limits, atol=1e-9)
    found = notes(obj, words)
    assert len(found) == 1 and "'door_joint'" in found[0]
    assert len(obj.provenance) == (2 if "e+38" in found[0] else 1)


def test_a_joint_clamped_to_its_limit_is_shown_there(load):
    obj = load(link("base"), link("drawer"), joint("prismatic", "drawer", limit(2, 3)))
    np.testing.assert_allclose(obj.parts[1].box[:3], [2, 0, 0])
    obj = load(
        link("base"),
        link("door"),
        joint("revolute", "door", '<origin xyz="0 0 1"/><axis xyz="0 0 1"/>' + limit(1, 2)),
    )
    corner = obj.parts[1].mesh.vertices.max(0)[0]
    assert corner == pytest.approx(0.5 * (np.cos(1) + np.sin(1)))


def test_a_prismatic_joint_without_limits_gets_its_parts_length(load):
    obj = load(link("base"), link("drawer"), joint("prismatic", "drawer"))
    np.testing.assert_allclose(obj.parts[1].joint.travel, (-0.5, 0.5))
    assert notes(obj, "prismatic without limits")


@pytest.mark.parametrize(
    ("limits", "travel", "words"),
    [
        ((-1e16, 1e16), (-0.5, 0.5), "half its part's length either way"),
        ((1e16, 1e16), (-0.5, 0.5), "half its part's length either way"),
        ((0, 1e16), (0, 1), "without an upper limit; its part's length"),
        ((-0.25, float("inf")), (-0.25, 0.75), "without an upper limit; its part's length"),
        ((-4, 1e9), (-4, 0), "without an upper limit; its part's length"),
        ((-float("inf"), 0.25), (-0.75, 0.25), "without a lower limit; its part's length"),
    ],
)
def test_a_prismatic_joint_whose_limits_are_none_gets_its_parts_length(load, limits, travel, words):
    obj = load(link("base"), link("drawer"), joint("prismatic", "drawer", limit(*limits)))
    np.testing.assert_allclose(obj.parts[1].joint.travel, travel)
    assert notes(obj, "means none; read as unlimited") and notes(obj, words)


def test_limits_of_an_mjcf_that_are_none(load_mjcf):
    hinge = '<body><joint name="h" range="-1e12 1e12" limited="true"/><geom size=".1"/></body>'
    text = f'<worldbody><geom size="1"/>{hinge}</worldbody>'
    obj = load_mjcf(f'<mujoco><compiler angle="radian"/>{text}</mujoco>')
    assert obj.parts[1].joint.type == "continuous" and notes(obj, "'h': limits (-1e+12, 1e+12)")


SHAPES = "<visual><geometry>{}</geometry></visual>"


@pytest.mark.parametrize(
    ("shape", "size", "words"),
    [
        ('<box size="1 0 2"/>', (1, 1e-4, 2), "'flat': a box without thickness"),
        ('<cylinder radius="1" length="0"/>', (2, 2, 1e-4), "'flat': a cylinder without thickness"),
        ('<capsule radius="1" length="0"/>', (2, 2, 2), "'flat': a capsule without length"),
    ],
)
def test_flat_shapes_get_a_thickness(load, shape, size, words):
    obj = load(link("base"), link("flat", SHAPES.format(shape)), joint("fixed", "flat"))
    np.testing.assert_allclose(obj.parts[1].box[3:], size, atol=2e-2, rtol=0)
    assert obj.parts[1].box[3:].min() > 0 and len(obj.provenance) == 1
    assert notes(obj, words)


def test_planes_are_ignored(load):
    ground = SHAPES.format('<plane normal="0 0 1"/>')
    obj = load(link("base", BOX + ground + ground.replace("visual", "collision")))
    assert len(notes(obj, "'base': a <plane> in a <")) == len(obj.provenance) == 2
    np.testing.assert_allclose(obj.bounds, [[-0.5] * 3, [0.5] * 3])


@pytest.mark.parametrize(
    "shape",
    [
        '<sphere radius="0"/>',
        '<box size="0 0 2"/>',
        "<box/>",
        '<cylinder radius="0" length="1"/>',
        '<mesh filename="gone.obj" scale="0 0 0"/>',
    ],
)
def test_shapes_of_size_0_are_ignored(load, shape):
    obj = load(link("base"), link("dot", BOX + SHAPES.format(shape)), joint("fixed", "dot"))
    assert len(obj.parts) == 2 and notes(obj, "link 'dot': a") and len(obj.provenance) == 1
    assert "size or scale 0 was ignored" in obj.provenance[0] and not lost_pieces(obj.provenance)
    frame = load(link("base"), link("dot", SHAPES.format(shape)), joint("fixed", "dot"))
    assert [p.name for p in frame.parts] == ["base"]


def test_of_four_numbers_the_first_three_count(load, tmp_path):
    trimesh.creation.box().export(tmp_path / "a.stl")
    scaled = mesh("a.stl").replace("a.stl", 'a.stl" scale="1 2 3 9')
    obj = load(
        link("base", scaled),
        link("door"),
        joint(
            "revolute",
            "door",
            f'<origin xyz="4 5 6 9" rpy="0 0 1.5707963 9"/><axis xyz="1 0 0 9"/>{limit(0, 1)}',
        ),
    )
    np.testing.assert_allclose(obj.parts[0].box[3:], (1, 2, 3))
    np.testing.assert_allclose(obj.parts[1].box[:3], (4, 5, 6))
    np.testing.assert_allclose(obj.parts[1].joint.direction, (0, 1, 0), atol=1e-6)
    told = notes(obj, "has four numbers; the first three count")
    assert len(told) == len(obj.provenance) == 4 and "link 'base': scale=" in "".join(told)


def test_the_link_world_need_not_be_written(load):
    obj = load(
        link("base"),
        link("door"),
        joint("fixed", "base", '<origin xyz="0 0 2"/>', parent="world"),
        joint("revolute", "door", limit(0, 1)),
    )
    assert [p.name for p in obj.parts] == ["base", "door"] and obj.parts[0].box[2] == 2
    assert notes(obj, "link 'world': joints name it as a parent and it is absent; added")


def test_cyclic_mimics_are_independent(load):
    obj = load(
        link("base"), link("a"), link("b"),
        joint("revolute", "a", limit(0, 1) + '<mimic joint="b_joint"/>'),
        joint("revolute", "b", limit(0, 1) + '<mimic joint="a_joint"/>'),
    )  # fmt: skip
    assert [j.type for j in obj.joints[1:]] == ["revolute", "revolute"]
    assert len(notes(obj, "cannot drive it")) == 2


def test_names_that_repeat_are_told_apart_where_that_is_possible(load, refuse):
    obj = load(
        link("base"),
        link("knob"),
        link("knob"),
        joint("fixed", "knob"),
        joint("fixed", "knob", '<origin xyz="5 0 0"/>'),
    )
    assert [p.name for p in obj.parts] == ["base", "knob", "knob_2"]
    assert obj.parts[2].box[0] == 5 and notes(obj, "had this name") and notes(obj, "renamed")
    assert "2 links are named 'a'" in refuse(link("a"), link("a"))


def test_harmless_faults_of_the_xml_are_passed_over(load):
    obj = load(f'<?xml version="0.0"?>{robot("<gz:plugin/>", link("a b"), link("unused", ""))}')
    assert obj.parts[0].name == "a b"
    assert notes(obj, "XML") and notes(obj, "'unused'")
    late = load(f'<!-- made by hand -->\n<?xml version="1.0"?>{robot(link("a"))}')
    assert len(late.parts) == 1 and notes(late, "only at the start of the document: ignored")
    short = load(
        f'<?xml version="1" ?>{robot(link("a"), link("b"), joint("fixed", "b", parent="a"))}'
    )
    assert [p.name for p in short.parts] == ["a", "b"] and notes(
        short, "expecting version: ignored"
    )


def test_missing_meshes(load, refuse):
    obj = load(link("base", mesh("gone.glb") + BOX))
    assert notes(obj, "link 'base': mesh 'gone.glb' is missing; left out")
    collision = BOX.replace("visual", "collision")
    assert notes(
        load(link("base", mesh("gone.glb") + collision)), "shown by its collision geometry"
    )
    line = refuse(link("base"), link("door", mesh("gone.obj")), joint("fixed", "door"))
    assert "link 'door'" in line and "'gone.obj' is missing" in line
    assert "package://x/y.dae" in refuse(link("base", mesh("package://x/y.dae")))
    assert "no link has a mesh" in refuse(link("base", ""))


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.obj", b"", "no faces"),
        ("a.obj", b"v 0 0 0\nf 1 2 3\n", "'a.obj'"),
        ("a.stl", b"solid nothing", "'a.stl'"),
        ("a.ply", b"ply\nformat ascii 1.0\n", "'a.ply'"),
        ("a.glb", b"glTF\0\0\0\0", "cannot be read as GLB"),
        ("a.dae", b'<!DOCTYPE a [<!ENTITY b "c">]><COLLADA/>', "document type"),
        ("a.txt", b"hello", "format '.txt'"),
    ],
)
def test_broken_meshes(refuse, load, tmp_path, name, content, words):
    (tmp_path / name).write_bytes(content)
    line = refuse(link("base", mesh(name)))
    assert words in line and "link 'base'" in line
    assert notes(load(link("base", mesh(name) + BOX)), "left out")


@pytest.mark.parametrize(("old", "new"), [("<f4", np.nan), ("<u4", 99)])
def test_faces_at_nowhere_are_left_out(load, tmp_path, old, new):
    body = trimesh.creation.box()
    data = bytearray(body.export(file_type="glb"))
    first = body.vertices[0, 0] if old == "<f4" else body.faces
    place = data.find(np.asarray(first).astype(old).tobytes())
    data[place : place + 4] = np.array(new).astype(old).tobytes()
    (tmp_path / "a.glb").write_bytes(data)
    obj = load(link("base", mesh("a.glb")))
    np.testing.assert_allclose(obj.bounds, body.bounds, atol=1e-6)
    assert notes(obj, "non-finite or absent vertices")


@pytest.mark.parametrize("kind", ["obj", "stl", "ply", "off", "glb"])
def test_nan_vertices_are_told_in_every_format(load, tmp_path, kind):
    body = trimesh.creation.box()
    body.vertices[0] = np.nan
    lost = int((body.faces == 0).any(1).sum())
    body.export(tmp_path / f"a.{kind}")
    obj = load(link("base", mesh(f"a.{kind}")))
    assert len(obj.parts[0].mesh.faces) == 12 - lost
    assert notes(obj, f"'a.{kind}': {lost} faces with non-finite or absent vertices were left out")
    assert lost_pieces(obj.provenance)


def test_a_mesh_of_nan_alone_says_so(refuse, tmp_path):
    body = trimesh.creation.box()
    trimesh.Trimesh(body.vertices * np.nan, body.faces, process=False).export(tmp_path / "a.ply")
    line = refuse(link("base", mesh("a.ply")))
    assert "no faces that have an area (12 faces with non-finite or absent vertices" in line


def test_nan_vertices_that_no_face_has_are_told_and_are_no_loss(load, tmp_path):
    body = trimesh.creation.box()
    points = np.vstack([body.vertices, np.full((2, 3), np.nan)])
    trimesh.Trimesh(points, body.faces, process=False).export(tmp_path / "a.ply")
    obj = load(link("base", mesh("a.ply")))
    assert len(obj.parts[0].mesh.faces) == 12 and not lost_pieces(obj.provenance)
    assert notes(obj, "'a.ply': 2 non-finite vertices that no face has were ignored")


def test_textures_that_are_absent_or_broken_leave_the_urdf_colour(load, tmp_path):
    quad = (
        "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\n"
    )
    (tmp_path / "a.obj").write_text(quad)
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd t.png\n")
    red = mesh("a.obj").replace(
        "</visual>", '<material name="r"><color rgba="1 0 0 1"/></material></visual>'
    )
    for content, words in (
        (None, "'t.png' is missing"),
        (b"not an image", "'t.png' is not an image"),
    ):
        if content is not None:
            (tmp_path / "t.png").write_bytes(content)
        obj = load(link("base", red))
        np.testing.assert_allclose(
            sample_color(obj.parts[0].mesh, [0], np.full((1, 3), 1 / 3)), [[1, 0, 0]], atol=1e-5
        )
        assert notes(obj, words)


def test_images_of_absurd_dimensions_are_left_out(load, tmp_path, monkeypatch):
    """What Pillow takes for a decompression bomb: in a URDF's material, and in a mesh's own."""
    Image.new("RGB", (8, 8)).save(tmp_path / "t.png")
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 10)
    files = AssetFiles(tmp_path, allow_outside=False)
    assert files.texture("t.png") is None
    assert files.notes and files.notes[0].startswith("texture 't.png': ")
    (tmp_path / "a.obj").write_text(
        "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\n"
    )
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd t.png\n")
    assert notes(load(link("base", mesh("a.obj"))), "'t.png' is not an image that can be read")


FLAT = "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"


def test_meshes_that_cannot_be_seen_are_left_out(load, refuse, tmp_path):
    (tmp_path / "line.obj").write_text(FLAT)
    (tmp_path / "point.obj").write_text(FLAT.replace("1 0 0", "0 0 0").replace("2 0 0", "0 0 0"))
    for name in ("line.obj", "point.obj"):
        words = f"mesh '{name}': it holds no faces that have an area"
        assert words in refuse(link("base", mesh(name)))
        assert notes(load(link("base", BOX + mesh(name))), words)


def test_blanks_are_a_name_too(load):
    """Of links and joints; what is shown is a name that can be seen."""
    slide = joint("prismatic", "  ", limit(0, 1) + '<mimic joint=" "/>', parent=" ", name="  ")
    obj = load(
        link("base"), link(" "), link("  "), joint("revolute", " ", limit(0, 1), name=" "), slide
    )
    assert [(p.name, p.parent, p.joint.type) for p in obj.parts] == [
        ("base", -1, "fixed"), ("part", 0, "revolute"), ("part_2", 1, "prismatic")
    ]  # fmt: skip
    assert notes(obj, "names that were too long or held what cannot be printed")


def test_names_are_fit_for_files(load):
    """Of controls, lone surrogates, any length and any number."""
    long = "x" * 200
    obj = load(
        link("a\u200eb"),
        link(long),
        link(long + "y"),
        link("a_b"),
        *(joint("fixed", n, parent="a\u200eb", name=n[-5:]) for n in (long, long + "y", "a_b")),
    )
    assert [p.name for p in obj.parts] == ["a_b_2", "x" * 80, "x" * 78 + "_2", "a_b"]
    assert len(notes(obj, "names that were too long or held what cannot be printed")) == 1
    assert all(line.isprintable() for line in obj.provenance)


def test_what_is_lost_is_told_by_the_words_of_a_repair_not_by_names():
    lost = [
        "link 'a': mesh 'm.obj' is missing; left out",
        "link 'a': mesh 'm.obj': it holds no faces; left out",
        "link 'a': a <visual> without geometry was left out",
        "mesh 'm.obj': its file '../t.png' lies outside the asset's folder and was not read",
        "mesh 'm.obj': 3 faces with non-finite or absent vertices were left out",
        "mesh 'm.obj': its texture cannot be read (truncated)",
        "texture 't.png' is missing",
        "texture 't.png': cannot identify image file",
    ]
    kept = [
        "link 'the lid is missing': it names no mesh; shown by its box",
        "link 'left out': no visual geometry; shown by its collision geometry",
        "link 'a': on 'not read' in the URDF, on 'left out' in mobility_v2.json; the latter is "
        "used",
        "links without a mesh were collapsed: 'link left out'",
        "joint 'is missing': its axis is zero; held fixed",
    ]
    assert lost_pieces([*kept, *lost]) == lost

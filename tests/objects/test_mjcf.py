"""Reading MJCF: joints and frames against MuJoCo, colours, and what is refused before MuJoCo sees
it."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from engines import compared, mujoco_engine, mujoco_misplaced
from hypothesis import given, settings
from hypothesis import strategies as st
from mjcf_texts import BOX, TETRAHEDRON, body, door, mjcf
from PIL import Image
from urdf_texts import notes

from uniart_jax.objects.appearance import sample_color, srgb_to_linear
from uniart_jax.objects.load import load_object

pytest.importorskip("mujoco", reason="pip install mujoco")


def colors(mesh: trimesh.Trimesh) -> np.ndarray:
    return sample_color(mesh, np.arange(len(mesh.faces)), np.full((len(mesh.faces), 3), 1 / 3))


@pytest.mark.parametrize(
    ("joint", "kind", "limits", "words"),
    [
        ("", "fixed", (0, 0), ""),
        ('<joint type="hinge" axis="0 0 1" range="-.2 1.5"/>', "revolute", (-0.2, 1.5), ""),
        ('<joint type="hinge" axis="0 0 1"/>', "continuous", (-np.pi, np.pi), ""),
        ('<joint type="hinge" limited="false" range="0 1"/>', "continuous", (-np.pi, np.pi), ""),
        ('<joint type="hinge" range="4 9"/>', "revolute", (0, 5), "limits (4, 9) exclude 0"),
        ('<joint type="slide" axis="1 0 0" range="0 .4"/>', "prismatic", (0, 0.4), ""),
        ('<joint type="slide" axis="0 0 1"/>', "prismatic", (-0.3, 0.3), "without limits"),
        ('<joint type="hinge" ref=".5" range="0 1"/>', "revolute", (0, 1), ""),
        ('<joint type="slide" ref=".1" range=".1 .3"/>', "prismatic", (0, 0.2), "shown at 0.1"),
    ],
)
def test_every_joint_that_moves_one_way(load_mjcf, joint, kind, limits, words):
    obj = load_mjcf(door(joint))
    assert [p.name for p in obj.parts] == ["base", "door"]
    assert obj.joints[1].type == kind and obj.name == "thing"
    np.testing.assert_allclose(obj.joints[1].limits, limits, atol=1e-9)
    assert not words or notes(obj, words)


def test_coordinate_zero_is_shown_not_ref(load_mjcf):
    """A slide that is written at its coordinate .1 is shown .1 before it."""
    obj = load_mjcf(door('<joint type="slide" axis="1 0 0" ref=".1" range="-1 1"/>'))
    np.testing.assert_allclose(obj.parts[1].box[:3], [0.4, 0, 0], atol=1e-9)


def test_a_free_object_is_held(load_mjcf):
    obj = load_mjcf(
        mjcf('<geom type="plane" size="1 1 1"/>' + body("a", BOX + "<freejoint/>", 'pos="0 0 2"'))
    )
    assert len(obj.parts) == 1 and notes(obj, "floats freely")
    assert notes(obj, "geoms not shown: planes (body 'world')")
    np.testing.assert_allclose(obj.parts[0].box[:3], [0, 0, 2], atol=1e-9)


def test_bodies_side_by_side_are_one_object(load_mjcf):
    slide = '<joint type="slide" axis="1 0 0" range="0 1"/>'
    obj = load_mjcf(mjcf(body("a") + body("b", BOX, 'pos="1 0 0"') + body("c", BOX + slide)))
    assert obj.parents == [-1, 0, 0]
    assert [j.type for j in obj.joints] == ["fixed", "fixed", "prismatic"]


def test_the_world_s_own_geoms_are_the_root(load_mjcf):
    obj = load_mjcf(mjcf(BOX + body("", BOX, 'pos="1 0 0"').replace('name=""', "")))
    assert [p.name for p in obj.parts] == ["world", "body_1"] and obj.parents == [-1, 0]


def test_several_joints_on_a_body_are_one_where_an_equality_couples_them(load_mjcf):
    """A turn and a travel coupled by an equality are a screw; independent ones stay apart."""
    two = (
        '<joint name="turn" axis="0 0 1" range="0 6"/><joint name="go" type="slide" axis="0 0 1" '
        'range="0 1"/>'
    )
    text = door(two)
    couple = (
        '<equality><joint joint1="go" joint2="turn" polycoef="0 .05 0 0 0"/></equality></mujoco>'
    )
    obj = load_mjcf(text.replace("</mujoco>", couple))
    assert obj.joints[1].type == "screw"
    np.testing.assert_allclose(
        [obj.joints[1].angle, obj.joints[1].travel], [(0, 6), (0, 0.3)], atol=1e-9
    )
    turn, slide = load_mjcf(text).parts[1].chain
    np.testing.assert_allclose([turn.angle, slide.travel], [(0, 6), (0, 1)])
    assert notes(
        load_mjcf(text.replace("</mujoco>", couple.replace("0 0 0", "1 0 0"))), "a bent equality"
    )
    held = load_mjcf(
        text.replace(
            "</mujoco>", '<equality><joint joint1="go" polycoef=".2 0 0 0 0"/></equality></mujoco>'
        )
    )
    assert notes(held, "held by an equality")
    np.testing.assert_allclose(held.parts[1].box[:3], [0.5, 0, 0.2], atol=1e-9)
    refs = text.replace('name="turn"', 'name="turn" ref="1"').replace(
        'name="go"', 'name="go" ref=".2"'
    )
    apart = load_mjcf(refs.replace("</mujoco>", couple))
    # go = .2 + .05 (turn - 1): .15 where turn is 0; the body is written at turn 1 and go .2
    np.testing.assert_allclose(apart.parts[1].box[:3], [0.5, 0, -0.05], atol=1e-9)
    weld = '<equality><weld name="w" body1="base" body2="door"/></equality></mujoco>'
    assert notes(load_mjcf(text.replace("</mujoco>", weld)), "<weld> 'w': not represented")


def pose(rng: np.random.Generator) -> str:
    numbers = [" ".join(f"{x:.6f}" for x in v) for v in (rng.normal(size=3), rng.normal(size=4))]
    return f'pos="{numbers[0]}" quat="{numbers[1]}"'


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), count=st.integers(2, 6))
def test_forward_kinematics_is_mujoco_s(tmp_path_factory, seed, count):
    """Chains and trees of bodies with turned frames, off-centre anchors, oblique axes, refs and any
    limits."""
    rng = np.random.default_rng(seed)
    below: dict[int, list[int]] = {}
    for i in range(1, count):
        below.setdefault(int(rng.integers(0, i)), []).append(i)

    def written(i: int) -> str:
        joint = ""
        if i:
            kind = ("hinge", "slide")[int(rng.integers(2))]
            lo, hi = np.sort(rng.uniform(-3, 3, 2)) + [-0.1, 0.1]
            numbers = [" ".join(f"{x:.6f}" for x in rng.normal(size=3)) for _ in range(2)]
            joint = (
                f'<joint name="j{i}" type="{kind}" pos="{numbers[0]}" axis="{numbers[1]}" '
                f'range="{lo:.6f} {hi:.6f}" ref="{rng.normal():.6f}"/>'
            )
        inner = (
            joint + f'<geom type="box" size=".1 .2 .3" contype="0" conaffinity="0" {pose(rng)}/>'
        )
        return body(f"b{i}", inner + "".join(written(k) for k in below.get(i, [])), pose(rng))

    path = tmp_path_factory.mktemp("chain") / "a.xml"
    path.write_text(mjcf(written(0)))
    obj, engine = load_object(path), mujoco_engine(path)
    assert mujoco_misplaced(obj, path, engine.shown) <= 1e-6
    result = compared(obj, engine, seed)
    assert result.error <= 1e-6 and result.compared == count - 1 and not result.excepted
    assert not result.wrong and not result.held


def test_primitives_have_half_sizes(load_mjcf):
    shapes = {
        "box": ("1 2 3", (2, 4, 6)),
        "sphere": ("2", (4, 4, 4)),
        "ellipsoid": ("1 2 3", (2, 4, 6)),
        "capsule": ("1 2", (2, 2, 6)),
        "cylinder": ("1 2", (2, 2, 4)),
    }
    for name, (size, extents) in shapes.items():
        obj = load_mjcf(mjcf(body("a", f'<geom type="{name}" size="{size}" pos="1 0 0"/>')))
        np.testing.assert_allclose(obj.parts[0].box, [1, 0, 0, *extents], atol=0.02)
        assert obj.parts[0].mesh.is_volume


def test_a_mesh_stands_where_it_was_written_with_its_texture(load_mjcf, tmp_path):
    """MuJoCo re-centres and turns meshes; texture coordinates are those of the OBJ read without
    MuJoCo."""
    rng = np.random.default_rng(0)
    image = Image.fromarray(rng.integers(0, 255, (5, 7, 3), dtype=np.uint8))
    (tmp_path / "assets").mkdir()
    image.save(tmp_path / "assets" / "t.png")
    (tmp_path / "assets" / "m.obj").write_text(TETRAHEDRON)
    above = (
        '<compiler assetdir="assets"/><asset><mesh file="m.obj" scale="2 1 1"/><texture name="t" '
        'type="2d" file="t.png"/><material name="m" texture="t"/></asset>'
    )
    obj = load_mjcf(
        mjcf(body("a", '<geom type="mesh" mesh="m" material="m"/>', 'pos="0 0 1"'), above)
    )
    uv = trimesh.visual.TextureVisuals(
        uv=np.array([[0, 0], [0.9, 0], [0.9, 0.6], [0, 1]]),
        material=trimesh.visual.material.SimpleMaterial(image=image),
    )
    corners = np.array([[0, 0, 1], [2, 0, 1], [2, 1, 1], [0, 1, 2.0]])
    faces = np.array([[0, 2, 1], [0, 3, 2], [0, 1, 3], [1, 2, 3]])
    plain = trimesh.Trimesh(corners, faces, visual=uv, process=False)
    mine = obj.parts[0].mesh
    order = [int(np.abs(mine.triangles_center - c).max(1).argmin()) for c in plain.triangles_center]
    assert sorted(order) == [0, 1, 2, 3]
    np.testing.assert_allclose(mine.triangles_center[order], plain.triangles_center, atol=1e-6)
    np.testing.assert_allclose(mine.face_normals[order], plain.face_normals, atol=1e-5)
    np.testing.assert_allclose(colors(mine)[order], colors(plain), atol=1e-4)


def test_colours_of_geom_and_material(load_mjcf, tmp_path):
    Image.new("RGB", (2, 2), (200, 100, 50)).save(tmp_path / "c.png")
    above = (
        '<asset><texture name="c" type="cube" file="c.png"/><material name="wood" texture="c" '
        'rgba="1 .5 1 1"/><material name="red" rgba="1 0 0 1"/></asset>'
    )
    for geom, rgb in (
        ('rgba="0 0 1 1"', (0, 0, 1)),
        ('material="red"', (1, 0, 0)),
        ('material="red" rgba="0 1 0 1"', (0, 1, 0)),
        ("", (0.5, 0.5, 0.5)),
        ('material="wood"', (200 / 255, 50 / 255, 50 / 255)),
    ):
        for shape in ('type="box" size="1 2 3"', 'type="capsule" size="1 2"'):
            obj = load_mjcf(mjcf(body("a", f"<geom {shape} {geom}/>"), above))
            expected = srgb_to_linear(np.array(rgb))
            np.testing.assert_allclose(colors(obj.parts[0].mesh) - expected, 0, atol=0.01)


def test_a_cube_texture_of_six_sides(load_mjcf, tmp_path):
    sides = {"right": "+x", "left": "-x", "up": "+y", "down": "-y", "front": "+z", "back": "-z"}
    for i, name in enumerate(sides):
        Image.new("RGB", (4, 4), (40 * i, 255 - 40 * i, 9)).save(tmp_path / f"{name}.png")
    files = " ".join(f'file{name}="{name}.png"' for name in sides)
    above = (
        f'<asset><texture name="c" type="cube" {files}/><material name="m" texture="c"/></asset>'
    )
    mesh = (
        load_mjcf(mjcf(body("a", '<geom type="box" size="1 1 1" material="m"/>'), above))
        .parts[0]
        .mesh
    )
    for i, side in enumerate(sides.values()):
        normal = (1 if side[0] == "+" else -1) * np.eye(3)["xyz".index(side[1])]
        seen = colors(mesh)[mesh.face_normals @ normal > 0.9]
        expected = srgb_to_linear(np.array([40 * i, 255 - 40 * i, 9]) / 255)
        np.testing.assert_allclose(seen, np.tile(expected, (2, 1)), atol=5e-3)


def test_which_geoms_are_seen(load_mjcf):
    small, large = '<geom type="box" size="1 1 1" {}/>', '<geom type="box" size="2 2 2" {}/>'
    ghost = 'contype="0" conaffinity="0"'
    for inner, side, words in (
        (small.format(ghost) + large.format(""), 2, ""),  # what collides with nothing is the visual
        (small.format('group="1"') + large.format('group="3"'), 2, ""),  # a viewer hides the second
        (small.format('group="1"') + large.format(ghost + ' group="4"'), 2, ""),
        (small.format("") + large.format('rgba="1 1 1 0"'), 2, "fully transparent (body 'a')"),
        (small.format('group="3"'), 2, "shown by its collision geometry"),  # nothing else is there
        (small.format("") + large.format('group="2"'), 4, ""),
    ):
        obj = load_mjcf(mjcf(body("a", inner)))
        np.testing.assert_allclose(obj.parts[0].box[3:], side, atol=1e-6)
        assert len(obj.provenance) == 1 + bool(words)  # the world was collapsed
        assert not words or notes(obj, words)


def test_includes_are_put_in_place(load_mjcf, refuse_mjcf, tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "b.xml").write_text(
        f"<mujocoinclude>{body('b')}<include file='parts/c.xml'/></mujocoinclude>"
    )
    (tmp_path / "parts" / "c.xml").write_text(f"<mujoco>{body('c')}</mujoco>")
    text = mjcf(BOX + '<include file="parts/b.xml"/>')
    assert [p.name for p in load_mjcf(text).parts] == ["world", "b", "c"]
    (tmp_path / "parts" / "c.xml").write_text('<mujoco><include file="parts/b.xml"/></mujoco>')
    assert "<include file='parts/b.xml'>: the file is included twice" in refuse_mjcf(text)
    assert "included twice" in refuse_mjcf(mjcf('<include file="a.xml"/>'))
    (tmp_path / "parts" / "c.xml").write_text("<!DOCTYPE a><mujoco/>")
    assert "<include file='parts/c.xml'>: it declares a document type" in refuse_mjcf(text)
    assert "<include file='nowhere.xml'>: the file is missing" in refuse_mjcf(
        mjcf('<include file="nowhere.xml"/>')
    )


def test_soft_bodies_are_left_out_and_actuators_ignored(load_mjcf):
    flex = '<flexcomp name="f" type="grid" count="3 3 3" spacing=".1 .1 .1"/>'
    text = door('<joint name="j"/>', flex).replace(
        "</mujoco>", '<actuator><motor joint="nothing"/></actuator></mujoco>'
    )
    obj = load_mjcf(text)
    assert len(obj.parts) == 2 and notes(obj, "a soft body (<flexcomp>) was left out")


def test_a_folder_is_asked_for_its_mjcf(tmp_path):
    text = mjcf(body("a"))
    (tmp_path / "part.xml").write_text("<mujocoinclude/>")
    with pytest.raises(FileNotFoundError, match="holds no URDF, MJCF"):
        load_object(tmp_path)
    (tmp_path / "one.xml").write_text(text)
    assert len(load_object(tmp_path).parts) == 1
    (tmp_path / "two.xml").write_text(text)
    with pytest.raises(ValueError, match=r"2 descriptions \(one.xml, two.xml\): name one of them"):
        load_object(tmp_path)
    (tmp_path / "object.xml").write_text(text.replace("thing", "other"))
    assert load_object(tmp_path).name == "other"
    box = '<link name="l"><visual><geometry><box size="1 1 1"/></geometry></visual></link>'
    (tmp_path / "object.urdf").write_text(f'<robot name="urdf">{box}</robot>')
    assert load_object(tmp_path).name == "urdf"
    (tmp_path / "robot.xml").write_text(f'<robot name="in xml">{box}</robot>')
    assert load_object(tmp_path / "robot.xml").name == "in xml"

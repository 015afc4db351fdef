"""Reading URDFs: frames, colours, addresses."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from PIL import Image
from urdf_texts import BOX, joint, limit, link, mesh, robot

from uniart_jax.objects.appearance import sample_color, srgb_to_linear
from uniart_jax.objects.load import find_asset, load_object


def test_origins_scales_and_primitives(load, tmp_path):
    trimesh.creation.box().export(tmp_path / "unit cube.stl")
    shapes = [
        '<visual><origin xyz="0 0 2" rpy="0 1.5707963267948966 0"/><geometry><cylinder radius="1" '
        'length="6"/></geometry></visual>',
        '<visual><origin xyz="0 5 0"/><geometry><sphere radius="0.5"/></geometry></visual>',
        '<visual><origin xyz="0 -5 0"/><geometry><mesh filename="unit%20cube.stl" scale="1 -2 '
        '3"/></geometry></visual>',
    ]
    obj = load(link("base", "".join(shapes)))
    np.testing.assert_allclose(obj.bounds, [[-3, -6, -1.5], [3, 5.5, 3]], atol=1e-6)
    assert obj.parts[0].mesh.is_volume and obj.provenance == ()


def test_joint_frames_are_followed(load):
    obj = load(
        link("base"),
        link("door"),
        link("knob"),
        joint(
            "revolute",
            "door",
            f'<origin xyz="0 2 0" rpy="0 0 1.5707963267948966"/><axis xyz="1 0 0"/>{limit(0, 1)}',
        ),
        joint("fixed", "knob", '<origin xyz="1 0 0"/>', parent="door"),
    )
    np.testing.assert_allclose(obj.parts[1].joint.origin, [0, 2, 0], atol=1e-9)
    np.testing.assert_allclose(obj.parts[1].joint.direction, [0, 1, 0], atol=1e-9)
    np.testing.assert_allclose(obj.parts[2].box[:3], [0, 3, 0], atol=1e-9)
    assert obj.parents == [-1, 0, 1] and obj.provenance == ()


def test_colours_of_urdf_mtl_and_texture_live_together(load, tmp_path):
    (tmp_path / "images").mkdir()
    (tmp_path / "objs").mkdir()
    Image.new("RGB", (4, 4), (10, 200, 30)).save(tmp_path / "images" / "t.png")
    quad = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\n"
    (tmp_path / "objs" / "a.obj").write_text(
        f"mtllib a.mtl\n{quad}usemtl m\nf 1/1 2/2 3/3\nusemtl n\nf 1/1 3/2 4/3\n"
    )
    (tmp_path / "objs" / "a.mtl").write_text(
        "newmtl m\nmap_Kd ../images/t.png\nnewmtl n\nKd 1 0 0.5\n"
    )
    named = '<material name="blue"><color rgba="0 0 1 1"/></material>'
    obj = load(
        named,
        link(
            "base",
            mesh("objs/a.obj") + BOX.replace("</visual>", '<material name="blue"/></visual>'),
        ),
    )
    body = obj.parts[0].mesh
    colors = sample_color(body, np.arange(len(body.faces)), np.full((len(body.faces), 3), 1 / 3))
    expected = srgb_to_linear(np.array([[10, 200, 30], [255, 0, 128]]) / 255)
    found = sorted(map(tuple, colors[:2]))
    np.testing.assert_allclose(found, sorted(map(tuple, expected)), atol=6e-3)
    np.testing.assert_allclose(colors[2:], [[0, 0, 1]] * 12, atol=1e-5)
    assert obj.provenance == ()


def test_factors_of_gltf_are_linear(load, tmp_path):
    body = trimesh.creation.box()
    material = trimesh.visual.material.PBRMaterial(baseColorFactor=[128, 0, 255, 255])
    uv = np.zeros((len(body.vertices), 2))
    body.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    (tmp_path / "a.glb").write_bytes(body.export(file_type="glb"))
    read = load(link("base", mesh("a.glb"))).parts[0].mesh
    color = sample_color(read, np.array([0]), np.full((1, 3), 1 / 3))
    np.testing.assert_allclose(color, [[128 / 255, 0, 1]], atol=5e-3)


def test_package_addresses_are_found_in_the_folder(load, tmp_path):
    (tmp_path / "meshes").mkdir()
    trimesh.creation.box().export(tmp_path / "meshes" / "b.stl")
    for uri in (
        "package://some_robot/meshes/b.stl",
        "file://meshes/b.stl",
        "meshes\\b.stl",
        "./meshes/../meshes/b.stl",
    ):
        assert len(load(link("base", mesh(uri))).parts) == 1


def test_a_folder_is_asked_for_its_urdf(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such file"):
        load_object(tmp_path / "nowhere")
    with pytest.raises(FileNotFoundError, match="holds no URDF, MJCF or object"):
        load_object(tmp_path)
    for name in ("x.urdf", "y.urdf"):
        (tmp_path / name).write_text(robot(link("base")))
        assert find_asset(tmp_path / name).name == name
    with pytest.raises(ValueError, match="name one of them"):
        load_object(tmp_path)
    for name in ("train.json", "object.json", "mobility.urdf", "object.urdf"):
        (tmp_path / name).write_text(robot(link("base")))
        assert find_asset(tmp_path).name == name

"""Textures are decoded by Pillow alone: PostScript in the place of one is not run."""

from __future__ import annotations

import json
import subprocess

import numpy as np
import pytest
import trimesh
from PIL import EpsImagePlugin, Image
from urdf_texts import BOX, has_picture, joint, link, mesh, notes

from uniart_jax.objects.image_formats import FORMATS, image_formats

EPS = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 32 32\n%%EndComments\n%%EOF\n"


@pytest.fixture(autouse=True)
def no_ghostscript(monkeypatch):
    asked = []
    monkeypatch.setattr(EpsImagePlugin, "gs_binary", "gs")
    monkeypatch.setattr(subprocess, "check_call", lambda *command, **_: asked.append(command))
    yield
    assert not asked


def test_every_format_is_one_that_pillow_decodes():
    assert "EPS" not in FORMATS and {"PNG", "JPEG", "WEBP"} <= set(image_formats()) <= set(FORMATS)


def quad(folder, texture: str) -> None:
    (folder / "a.mtl").write_text(f"newmtl m\nmap_Kd {texture}\n")
    (folder / "a.obj").write_text(
        "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\n"
    )


@pytest.mark.parametrize("name", ["t.png", "t.eps"])
def test_a_texture_of_an_obj(load, tmp_path, name):
    quad(tmp_path, name)
    (tmp_path / name).write_bytes(EPS)
    obj = load(link("base", mesh("a.obj")))
    assert not has_picture(obj.parts[0]) and notes(obj, "'a.obj'")


def test_a_texture_of_a_urdf(load, tmp_path):
    quad(tmp_path, "gone.png")
    (tmp_path / "t.png").write_bytes(EPS)
    material = '<material name="m"><texture filename="t.png"/></material></visual>'
    obj = load(link("base", mesh("a.obj").replace("</visual>", material)))
    assert not has_picture(obj.parts[0]) and notes(obj, "texture 't.png': ")


@pytest.mark.parametrize("glossy", [False, True])
def test_a_texture_inside_a_glb(load, tmp_path, glossy):
    """Of a common material, and of one that trimesh converts while it reads."""
    body = trimesh.creation.box()
    picture = Image.new("RGB", (8, 8), (9, 9, 9))
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=picture)
    uv = np.zeros((len(body.vertices), 2))
    body.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    files = body.scene().export(file_type="gltf")
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    tree = json.loads(files["model.gltf"])
    tree["images"][0] = {"uri": "t.png"}
    (tmp_path / "t.png").write_bytes(EPS)
    if glossy:
        texture = tree["materials"][0]["pbrMetallicRoughness"].pop("baseColorTexture")
        name = "KHR_materials_pbrSpecularGlossiness"
        words = {"diffuseTexture": texture, "specularGlossinessTexture": texture}
        tree["materials"][0]["extensions"] = {name: words}
        tree["extensionsUsed"] = [name]
    (tmp_path / "a.gltf").write_text(json.dumps(tree))
    obj = load(link("base"), link("door", BOX + mesh("a.gltf")), joint("fixed", "door"))
    assert not any(has_picture(p) for p in obj.parts) and notes(obj, "'a.gltf'")

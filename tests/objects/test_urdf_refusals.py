"""What is refused, in one line that names link and file; nothing outside the folder is read."""

from __future__ import annotations

import io
import os
import time
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from urdf_texts import BOX, joint, limit, link, mesh, notes, robot

from uniart_jax.objects import asset_files, load
from uniart_jax.objects.load import load_object


def test_nothing_outside_the_folder_is_read(tmp_path, monkeypatch):
    """Meshes by ``..``, absolute paths, links and packages; MTLs and textures of a mesh inside."""
    inside, outside = tmp_path / "asset", tmp_path / "other"
    inside.mkdir()
    outside.mkdir()
    trimesh.creation.box().export(outside / "b.stl")
    Image.new("RGB", (2, 2), (255, 0, 0)).save(outside / "t.png")
    (inside / "link.stl").symlink_to(outside / "b.stl")
    (inside / "a").mkdir()
    (inside / "folder").symlink_to(outside)
    path = inside / "object.urdf"
    opened = []
    read = Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda self: opened.append(str(self)) or read(self))
    for uri in (
        "../other/b.stl",
        str(outside / "b.stl"),
        f"file://{outside}/b.stl",
        "link.stl",
        "folder/b.stl",
        "a/../../other/b.stl",
    ):
        path.write_text(robot(link("base", mesh(uri))))
        with pytest.raises(
            ValueError, match="outside the asset's folder; allow_outside=True"
        ) as caught:
            load_object(inside)
        assert uri in str(caught.value) and "link 'base'" in str(caught.value) and not opened
        assert len(load_object(path, allow_outside=True).parts) == 1
        opened.clear()
    path.write_text(robot(link("base", mesh("package://other/b.stl"))))
    with pytest.raises(ValueError, match=r"is missing \(allow_outside=True"):
        load_object(path)
    assert len(load_object(path, allow_outside=True).parts) == 1

    (inside / "a.obj").write_text(
        "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\n"
    )
    path.write_text(robot(link("base", mesh("a.obj"))))
    for texture in ("../other/t.png", "folder/t.png", str(outside / "t.png")):
        (inside / "a.mtl").write_text(f"newmtl m\nmap_Kd {texture}\n")
        obj = load_object(path)
        material = getattr(obj.parts[0].mesh.visual, "material", None)
        assert getattr(material, "image", None) is None
        assert notes(obj, "outside the asset's folder and was not read")
        image = load_object(path, allow_outside=True).parts[0].mesh.visual.material.image
        assert image.getpixel((0, 0)) == (255, 0, 0)


def test_a_description_that_is_a_link_out_of_its_folder(tmp_path):
    """Only a file that the user names may be one."""
    asset, other = tmp_path / "asset", tmp_path / "other"
    asset.mkdir()
    other.mkdir()
    (other / "x.urdf").write_text(robot(link("base")))
    (other / "x.xml").write_text('<mujoco><worldbody><geom size="1"/></worldbody></mujoco>')
    (other / "x.json").write_text("{}")
    for name, target in {
        "object.urdf": "x.urdf",
        "mobility.urdf": "x.urdf",
        "any.urdf": "x.urdf",
        "any.xml": "x.xml",
        "object.json": "x.json",
        "train.json": "x.json",
    }.items():
        (asset / name).symlink_to(other / target)
        with pytest.raises(ValueError, match=f"{name}: it lies outside the asset's folder; allow_"):
            load_object(asset)
        (asset / name).unlink()
    (asset / "object.urdf").symlink_to(other / "x.urdf")
    assert load_object(asset, allow_outside=True).name == "thing"
    assert load_object(asset / "object.urdf").name == "thing"
    (tmp_path / "linked").symlink_to(other)
    assert load_object(tmp_path / "linked").name == "thing"  # the folder itself may be a link


def test_what_the_system_refuses_is_one_line(tmp_path, monkeypatch):
    for path in (tmp_path / ("x" * 5000), "y" * 300):
        with pytest.raises(ValueError) as caught:
            load_object(path)
        assert "too long" in str(caught.value) and "\n" not in str(caught.value)
    (tmp_path / "a.urdf").write_text(robot(link("base")))

    def full(*_):
        raise MemoryError

    monkeypatch.setitem(load.READERS, "urdf", full)
    with pytest.raises(ValueError, match=r"a\.urdf: MemoryError"):
        load_object(tmp_path)


def test_a_folder_named_as_a_description_is_none(tmp_path):
    (tmp_path / "a.urdf").mkdir()
    with pytest.raises(FileNotFoundError, match="holds no URDF"):
        load_object(tmp_path)


def test_too_many_links_and_deep_chains(tmp_path):
    """A chain of links is read in a time that does not grow with its cube."""
    (tmp_path / "a.urdf").write_text(robot(*(link(f"l{i}", "") for i in range(5000))))
    with pytest.raises(ValueError, match="5,000 links, more than 4,096"):
        load_object(tmp_path)
    count = 2000
    links = [link(f"l{i}", BOX if i in (0, count - 1) else "") for i in range(count)]
    joints = [joint("fixed", f"l{i}", parent=f"l{i - 1}") for i in range(1, count)]
    (tmp_path / "a.urdf").write_text(robot(*links, *joints))
    start = time.process_time()
    assert len(load_object(tmp_path).parts) == 2
    assert time.process_time() - start < 10


def test_pipes_are_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "m.mtl")
    (tmp_path / "m.obj").write_text("mtllib m.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "a.urdf").write_text(robot(link("base", mesh("m.obj"))))
    assert notes(load_object(tmp_path), "its file 'm.mtl' is missing")


def test_networks_are_never_asked(refuse):
    assert "never fetched" in refuse(link("base", mesh("https://example.org/a.stl")))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "the file is empty"),
        ("  \n ", "the file is empty"),
        ("hello", "not XML"),
        ("<robot><link name='a'>", "not XML"),
        ("<mujoco/>", "<mujoco>"),
        ("<sdf version='1.6'/>", "<sdf>"),
        ("<robot name='a'/>", "no <link>"),
        ('<robot xmlns:xacro="x"><xacro:include/></robot>', "xacro"),
        (
            '<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;&a;">]><robot name="&b;"/>',
            "document type",
        ),
        (
            '<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]><robot>&a;</robot>',
            "document type",
        ),
        ('<!DOCTYPE r SYSTEM "http://example.org/r.dtd"><robot/>', "document type"),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_what_is_no_urdf(tmp_path, text, words, encoding):
    path = tmp_path / "a.urdf"
    path.write_bytes(text.encode(encoding) if text else b"")
    if encoding == "utf-16" and words in ("the file is empty",):
        return
    with pytest.raises(ValueError, match=words) as caught:
        load_object(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("elements", "words"),
    [
        (
            [
                link("a"),
                link("b"),
                joint("fixed", "b", parent="a"),
                joint("fixed", "a", parent="b"),
            ],
            "cycle through link",
        ),
        ([link("base"), joint("fixed", "base")], "cycle through link 'base'"),
        ([link("a"), link("b")], "two roots: links 'a' and 'b'"),
        (
            [
                link("a"),
                link("b"),
                link("c"),
                joint("fixed", "c", parent="a"),
                joint("fixed", "c", parent="b"),
            ],
            "two parents",
        ),
        ([link("base"), joint("fixed", "door")], "no link 'door'"),
        (
            [link("base"), "<joint name='j' type='fixed'><parent link='base'/></joint>"],
            "names no child",
        ),
        ([link("base"), link("a"), joint("bendy", "a")], "unknown type 'bendy'"),
        ([link("base"), link("a"), joint("planar", "a")], "'a_joint' is planar"),
        ([link("base"), link("a"), joint("floating", "a")], "'a_joint' is floating"),
        ([link("base"), link("a"), joint("spherical", "a")], "'a_joint' is spherical"),
        (
            [link("base"), link("a"), joint("revolute", "a", limit(0, float("nan")))],
            "'a_joint': upper='nan'",
        ),
        (
            [link("base"), link("a"), joint("revolute", "a", '<axis xyz="0 1"/>')],
            "'a_joint': xyz='0 1'",
        ),
        (
            [link("base"), link("a"), joint("revolute", "a", '<origin xyz="a b c"/>')],
            "3 finite numbers",
        ),
        ([link("base", BOX.replace("1 1 1", "1 -1 1"))], "sizes of its box must be positive"),
        ([link("base", BOX.replace("1 1 1", "1 1"))], "link 'base': size='1 1'"),
        ([link("base", BOX.replace("1 1 1", "0 0 0"))], "no link has a mesh"),
        (
            [link("base"), link("a"), joint("fixed", "a", '<origin rpy="0 0 0 0 0"/>')],
            "'a_joint': rpy='0 0 0 0 0' should be 3",
        ),
        ([link("base"), joint("fixed", "base", parent="map")], "no link 'map'"),
        ([link("base"), joint("fixed", "world")], "no link 'world'"),
        ([link("base", mesh(""))], "names no file"),
        ([link("base", BOX.replace("box", "torus"))], "unknown geometry <torus>"),
        ([link("")], "has no name"),
    ],
)
def test_what_cannot_be_repaired_is_named(refuse, elements, words):
    assert words in refuse(*elements)


def test_what_is_too_large_is_refused(refuse, tmp_path, monkeypatch):
    trimesh.creation.icosphere(subdivisions=3).export(tmp_path / "a.stl")
    monkeypatch.setattr(asset_files, "MAX_FACES", 2000)
    assert "more than 2,000 faces" in refuse(link("base", mesh("a.stl") * 2))
    monkeypatch.setattr(asset_files, "MAX_MESH_BYTES", 1000)
    assert "'a.stl': it has more than" in refuse(link("base", mesh("a.stl")))
    assert "MiB, more than the 16" in refuse(robot(link("base"), "<!--", "x" * (17 * 2**20), "-->"))


def test_huge_images_are_not_decoded(load, tmp_path, monkeypatch):
    monkeypatch.setattr(asset_files, "MAX_PIXELS", 10)
    body = trimesh.creation.box()
    image = Image.new("RGB", (8, 8), (9, 9, 9))
    uv = np.zeros((len(body.vertices), 2))
    body.visual = trimesh.visual.TextureVisuals(
        uv=uv, material=trimesh.visual.material.PBRMaterial(baseColorTexture=image)
    )
    (tmp_path / "a.glb").write_bytes(body.export(file_type="glb"))
    assert notes(load(link("base", mesh("a.glb"))), "too large")


def test_a_png_in_memory_is_not_a_urdf(tmp_path):
    buffer = io.BytesIO()
    Image.new("RGB", (2, 2)).save(buffer, "PNG")
    (tmp_path / "a.urdf").write_bytes(buffer.getvalue())
    with pytest.raises(ValueError, match="not XML"):
        load_object(tmp_path)

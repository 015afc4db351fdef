"""What of an MJCF is refused before MuJoCo sees it: files outside, what is too large, plugins,
models without end."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from mjcf_texts import BOX, TETRAHEDRON, body, door, mjcf
from PIL import Image

from uniart_jax.objects import mjcf_text
from uniart_jax.objects.load import load_object

pytest.importorskip("mujoco", reason="pip install mujoco")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (door('<joint name="j" type="ball"/>'), "'j' is spherical"),
        (
            mjcf(body("a") + body("b", BOX + '<freejoint name="f"/>')),
            "joint 'f' is floating",
        ),
        (mjcf(""), "no link has a mesh"),
        (mjcf('<geom type="plane" size="1 1 1"/>'), "no link has a mesh"),
        (mjcf(body("a", '<geom type="box" size="1 1"/>')), "MuJoCo cannot compile it"),
        (mjcf(body("a") + body("a")), "repeated name 'a'"),
        (mjcf(body("a", BOX + "<nonsense/>")), "'nonsense'"),
        ("<mujoco><worldbody>", "not XML"),
        ('<!DOCTYPE m [<!ENTITY a "b">]><mujoco model="&a;"/>', "document type"),
        ("<mujocoinclude/>", "root element is <mujocoinclude>"),
        (mjcf("", "<extension><plugin plugin='x'/></extension>"), "plugins are never run"),
        (mjcf(body("a", BOX + '<plugin plugin="x"/>')), "plugins are never run"),
        (mjcf(f'<replicate count="1000"><replicate count="1000">{BOX}</replicate></replicate>'), "elements, counted"),  # noqa: E501
        (mjcf("", '<asset><texture name="t" builtin="flat" type="2d" width="90000" '
            'height="90000"/></asset>'), "too large"),
        (mjcf("", '<asset><texture name="t" builtin="flat" type="cube" width="12000" '
            'height="1"/></asset>'), "too large"),
        (mjcf("", '<asset><texture name="t" builtin="flat" type="skybox" width="12000"/></asset>'), "too large"),  # noqa: E501
        (mjcf("", '<asset><texture name="t" builtin="flat" width="12000"/></asset>'), "too large"),
        (mjcf("", '<asset>' + "".join(f'<texture name="t{i}" builtin="flat" type="2d" width="9000" height="9000"/>' for i in range(5)) + '</asset>'), "pixels of textures"),  # noqa: E501
        (mjcf("", '<asset><hfield name="t" nrow="90000" ncol="90000" size="1 1 1 1"/></asset>'), "too large"),  # noqa: E501
        (mjcf("", '<asset><mesh name="t" builtin="supertorus" params="99999 .1 1 1"/></asset>'), "too large"),  # noqa: E501
    ],
)  # fmt: skip
def test_what_is_refused(refuse_mjcf, text, words):
    assert words in refuse_mjcf(text)


def test_attached_models_are_packed_too(load_mjcf, refuse_mjcf, tmp_path):
    (tmp_path / "m.obj").write_text(TETRAHEDRON)
    inner = mjcf(body("b", '<geom type="mesh" mesh="m"/>'), '<asset><mesh file="m.obj"/></asset>')
    (tmp_path / "sub.xml").write_text(inner)
    text = mjcf(
        BOX + '<attach model="s" body="b" prefix="x_"/>',
        '<asset><model name="s" file="sub.xml"/></asset>',
    )
    assert [p.name for p in load_mjcf(text).parts] == ["world", "x_b"]
    (tmp_path / "sub.xml").write_text(inner.replace("m.obj", "../m.obj"))
    assert "<model file='sub.xml'>: <mesh file='../m.obj'>: it lies outside" in refuse_mjcf(text)
    (tmp_path / "sub.xml").write_text(text)
    assert "models within models" in refuse_mjcf(text)


def test_nothing_outside_the_folder_is_read(tmp_path, monkeypatch):
    inside, outside = tmp_path / "asset", tmp_path / "other"
    inside.mkdir()
    outside.mkdir()
    (outside / "m.obj").write_text(TETRAHEDRON)
    (outside / "b.xml").write_text(f"<mujoco>{body('b')}</mujoco>")
    Image.new("RGB", (2, 2)).save(outside / "t.png")
    (inside / "link.obj").symlink_to(outside / "m.obj")
    (inside / "folder").symlink_to(outside)
    opened = []
    read = Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda self: opened.append(self) or read(self))
    mesh, geom = (
        '<asset><mesh name="m" file="{}"/></asset>',
        body("a", '<geom type="mesh" mesh="m"/>'),
    )
    texts = [
        mjcf(geom, mesh.format(n))
        for n in ("../other/m.obj", f"{outside}/m.obj", "link.obj", "folder/m.obj")
    ]
    texts += [
        mjcf(geom, f'<compiler meshdir="{place}"/>' + mesh.format("m.obj"))
        for place in ("../other", str(outside), "folder")
    ]
    texts += [
        mjcf(body("a") + f'<include file="{n}"/>')
        for n in ("../other/b.xml", "folder/b.xml", f"{outside}/b.xml")
    ]
    texts += [
        mjcf(
            body("a"),
            '<compiler texturedir="../other"/><asset><texture name="t" type="cube" '
            f'{kind}="t.png"/></asset>',
        )
        for kind in ("file", "fileback")
    ]
    for text in texts:
        (inside / "object.xml").write_text(text)
        opened.clear()
        with pytest.raises(
            ValueError, match=r"lies outside the asset's folder; allow_outside=True"
        ) as caught:
            load_object(inside)
        assert "file" in str(caught.value) and "\n" not in str(caught.value) and not opened
        assert len(load_object(inside, allow_outside=True).parts) >= 1


def test_a_png_by_any_name_is_measured(refuse_mjcf, tmp_path, monkeypatch):
    Image.new("RGB", (9, 9)).save(tmp_path / "t.png")
    (tmp_path / "t.png").rename(tmp_path / "t.dat")
    monkeypatch.setattr(mjcf_text, "MAX_PIXELS", 50)
    texture = '<asset><texture type="2d" file="t.dat" content_type="image/png"/></asset>'
    assert "9 x 9 pixels are too many" in refuse_mjcf(mjcf(BOX, texture))


def test_pixels_are_counted_as_often_as_they_are_attached(refuse_mjcf, tmp_path, monkeypatch):
    Image.new("RGB", (9, 9)).save(tmp_path / "t.png")
    above = '<asset><texture name="t" type="2d" file="t.png"/></asset>'
    (tmp_path / "sub.xml").write_text(mjcf(body("b"), above))
    monkeypatch.setattr(mjcf_text, "MAX_ALL_PIXELS", 300)
    attached = "".join(f'<attach model="s" body="b" prefix="x{i}_"/>' for i in range(3))
    text = mjcf(BOX + attached, '<asset><model name="s" file="sub.xml"/></asset>')
    assert "324 pixels of textures" in refuse_mjcf(text)


def test_a_model_is_parsed_once_however_often_it_is_named(refuse_mjcf, tmp_path, monkeypatch):
    for level in range(1, 5):
        names = "".join(f'<model name="m{i}" file="{level + 1}.xml"/>' for i in range(12))
        (tmp_path / f"{level}.xml").write_text(
            mjcf(body("b"), f"<asset>{names}</asset>" if level < 4 else "")
        )
    parsed = []
    parse = mjcf_text.parse_xml
    monkeypatch.setattr(
        mjcf_text, "parse_xml", lambda data, notes: parsed.append(1) or parse(data, notes)
    )
    text = (tmp_path / "1.xml").read_text().replace("2.xml", "1.xml")
    assert "elements, counted" in refuse_mjcf(text) and len(parsed) == 5


def test_files_of_text_are_counted_and_meshes_read_once(
    load_mjcf, refuse_mjcf, tmp_path, monkeypatch
):
    (tmp_path / "m.obj").write_text(TETRAHEDRON)
    opened, read = [], Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda self: opened.append(self) or read(self))
    many = "".join(f'<mesh name="m{i}" file="m.obj"/>' for i in range(9))
    load_mjcf(mjcf(BOX, f"<asset>{many}</asset>"))
    assert len(opened) == 1
    for i in range(5):
        (tmp_path / f"{i}.xml").write_text(f"<mujoco>{body(f'b{i}')}</mujoco>")
    text = mjcf(BOX + "".join(f'<include file="{i}.xml"/>' for i in range(5)))
    assert len(load_mjcf(text).parts) == 6
    monkeypatch.setattr(mjcf_text, "MAX_DOCUMENTS", 5)
    assert "more than 5 included and attached files" in refuse_mjcf(text)


def test_models_within_models_are_counted_from_the_top(refuse_mjcf, tmp_path):
    """Known ones too: each chain was packed within the limit, one below the other it is not."""
    named = '<asset><model name="s" file="{}.xml"/></asset>'
    for i in range(6):
        (tmp_path / f"{i}.xml").write_text(mjcf(body("b"), named.format(i - 1) if i else ""))
    models = "".join(f'<model name="n{i}" file="{i}.xml"/>' for i in range(6))
    assert "models within models" in refuse_mjcf(mjcf(BOX, f"<asset>{models}</asset>"))


def test_strippath_names_and_missing_files(load_mjcf, refuse_mjcf, tmp_path):
    (tmp_path / "m.obj").write_text(TETRAHEDRON)
    text = mjcf(
        body("a", '<geom type="mesh" mesh="m"/>'),
        '<compiler strippath="true"/><asset><mesh file="../x/m.obj"/></asset>',
    )
    assert len(load_mjcf(text).parts) == 1
    assert "<mesh file='../x/n.obj'>: the file is missing" in refuse_mjcf(
        text.replace("m.obj", "n.obj")
    )
    (tmp_path / "t.png").write_bytes(b"no image")
    assert "not an image" in refuse_mjcf(
        mjcf(BOX, '<asset><texture type="2d" file="t.png"/></asset>')
    )
    assert "cannot name a file" in refuse_mjcf(mjcf(body("a", '<geom size="1" file="t.png"/>')))


def test_files_that_are_too_large(refuse_mjcf, tmp_path, monkeypatch):
    (tmp_path / "m.obj").write_text(TETRAHEDRON)
    Image.new("RGB", (9, 9)).save(tmp_path / "t.png")
    monkeypatch.setattr(mjcf_text, "MAX_PIXELS", 50)
    assert "pixels are too many" in refuse_mjcf(
        mjcf(BOX, '<asset><texture type="2d" file="t.png"/></asset>')
    )
    monkeypatch.setattr(mjcf_text, "MAX_MESH_BYTES", 20)
    assert "<mesh file='m.obj'>: it has more than" in refuse_mjcf(
        mjcf(BOX, '<asset><mesh file="m.obj"/></asset>')
    )


def test_mujoco_prints_and_logs_nothing(load_mjcf, refuse_mjcf, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    mujoco = pytest.importorskip("mujoco")
    before = mujoco.get_mju_user_warning()
    refuse_mjcf(mjcf(body("a", '<geom type="box" size="1 1"/>')))
    refuse_mjcf(door("<joint/>").replace(BOX, ""))
    load_mjcf(door("<joint/>"))
    assert sorted(os.listdir()) == ["a.xml"] and mujoco.get_mju_user_warning() is before
    assert capfd.readouterr() == ("", "")


def test_without_mujoco_a_line_says_what_to_install(refuse_mjcf, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    assert "pip install mujoco" in refuse_mjcf(mjcf(BOX))

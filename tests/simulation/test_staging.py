"""What is staged names nothing but what is staged beside it, whatever the asset says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from lxml import etree
from planted_assets import link, robot

from uniart_jax.objects.asset_files import AssetFiles, RefusedError
from uniart_jax.simulation.staging import stage_mjcf, stage_urdf
from uniart_jax.simulation.worker import load

TET = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
SOLID = link("a", [([0, 0, 0], [1, 1, 1])])
FOLDERS = ("meshdir", "assetdir", "texturedir")


def meshed(*names: str, extra: str = "", xmlns: str = "") -> bytes:
    shapes = "".join(
        f'<collision><geometry><mesh {xmlns} filename="{n}"/></geometry></collision>' for n in names
    )
    return robot(f"{extra}<link name='a'>{shapes}</link>").encode()


def staged(folder: Path, data: bytes, *, shown: bool = True, outside: bool = False) -> Path:
    target = folder / "staged"
    target.mkdir()
    files = AssetFiles(folder / "asset", outside)
    if b"<mujoco model" in data:
        return stage_mjcf(data, folder / "asset/object.xml", files, target)
    return stage_urdf(data, files, target, shown=shown)


def names_said(path: Path) -> list[str]:
    """Every file that a staged description or its meshes name, and every folder."""
    said = []
    for element in etree.parse(path).iter():
        attributes = {str(k).rpartition("}")[2]: v for k, v in element.attrib.items()}
        said += [v for k, v in attributes.items() if k.startswith("file") or k in FOLDERS]
    for mesh in path.parent.glob("*.obj"):
        said += [m.decode() for m in re.findall(rb"mtllib[^\r\n]*", mesh.read_bytes())]
    return said


def led_out(path: Path) -> list[str]:
    here = {p.name for p in path.parent.iterdir()}
    return [
        n for n in names_said(path) if n not in here and not re.fullmatch(r"missing-\d+\.obj", n)
    ]


@pytest.fixture
def asset(tmp_path) -> Path:
    """A folder with two meshes, and beside it the same out of bounds."""
    for place in ("asset", "asset/parts", "elsewhere"):
        (tmp_path / place).mkdir()
        (tmp_path / place / "m.obj").write_text(TET)
    return tmp_path / "asset"


@pytest.mark.parametrize("xmlns", ["", 'xmlns="urn:x"'])
def test_a_mesh_that_is_not_there_gets_a_name_that_is_nowhere(tmp_path, asset, xmlns):
    names = [
        "m.obj",
        "elsewhere/m.obj",
        "package://elsewhere/n.obj",
        "elsewhere/m.obj",
        "http://x/m.obj",
        "",
    ]
    path = staged(tmp_path, meshed(*names, xmlns=xmlns))
    assert names_said(path) == ["0.obj", *(f"missing-{n}.obj" for n in (0, 1, 0, 2, 3))]
    assert (path.parent / "0.obj").read_text() == TET and not led_out(path)


@pytest.mark.parametrize("shown", [True, False])
@pytest.mark.parametrize("extra", [
    "<material name='t'><texture filename='elsewhere/t.png'/></material>",
    "<material name='t'><texture xmlns='urn:x' filename='elsewhere/t.png'/></material>",
    "<deformable name='d'><visual filename='elsewhere/m.obj'/><collision "
    "filename='m.vtk'/></deformable>",
    "<link name='b'><collision><geometry><cdf "
    "filename='elsewhere/m.cdf'/></geometry></collision></link>",
    "<mujoco><include file='elsewhere/x.xml'/></mujoco>",
])  # fmt: skip
def test_nothing_else_names_a_file(tmp_path, asset, extra, shown):
    assert not led_out(staged(tmp_path, meshed("m.obj", extra=extra), shown=shown))


@pytest.mark.parametrize("name", FOLDERS)
def test_no_folder_is_left_for_mujoco_to_look_into(tmp_path, asset, name):
    def compiler(place: object) -> str:
        return f'<mujoco><compiler angle="radian" {name}="{place}"/></mujoco>'

    (asset / "m.obj").write_text("")  # two of that name
    honest = staged(tmp_path, meshed("m.obj", extra=compiler("parts")))
    assert names_said(honest) == ["0.obj"]
    expected = "" if name == "texturedir" else TET
    assert (honest.parent / "0.obj").read_text() == expected
    (tmp_path / "staged").rename(tmp_path / "second")
    away = meshed("m.obj", extra=compiler(tmp_path / "elsewhere"))
    if name == "texturedir":
        assert names_said(staged(tmp_path, away)) == ["0.obj"]
        return
    with pytest.raises(RefusedError, match="allow_outside=True"):
        staged(tmp_path, away)
    (tmp_path / "staged").rename(tmp_path / "third")
    path = staged(tmp_path, away, outside=True)
    assert names_said(path) == ["0.obj"] and (path.parent / "0.obj").read_text() == TET


@pytest.mark.parametrize("name", FOLDERS)
def test_the_same_of_an_mjcf(tmp_path, asset, name):
    text = '<mujoco model="x"><compiler {}="{}"/><asset><mesh name="m" file="m.obj"/></asset><worldbody><geom type="mesh" mesh="m"/></worldbody></mujoco>'  # noqa: E501
    path = staged(tmp_path, text.format(name, "parts").encode())
    assert names_said(path) == ["0.obj"] and (path.parent / "0.obj").read_text() == TET
    (tmp_path / "staged").rename(tmp_path / "first")
    away = text.format(name, tmp_path / "elsewhere").encode()
    if name == "texturedir":
        assert names_said(staged(tmp_path, away)) == ["0.obj"]
        return
    with pytest.raises(RefusedError, match="allow_outside=True"):
        staged(tmp_path, away)


@pytest.mark.parametrize("line", [
    "v 0 0 0\rmtllib ../../x.mtl\rv 1 0 0",
    "v 0 0 0\r\n \tmtllib ../../x.mtl\r\nv 1 0 0",
    "#" + 5000 * "x" + "mtllib ../../x.mtl\nv 1 0 0",
])  # fmt: skip
@pytest.mark.parametrize("suffix", [".obj", ".OBJ", ".o-bj"])
@pytest.mark.parametrize("kind", ["urdf", "mjcf"])
def test_a_mesh_keeps_its_shape_and_loses_its_materials(tmp_path, asset, line, suffix, kind):
    text = f"{line}\nv 0 1 0\nv 0 0 1\n{TET[TET.index('f') :]}"
    (asset / f"k{suffix}").write_bytes(text.encode())
    data = meshed(f"k{suffix}")
    if kind == "mjcf":
        data = f'<mujoco model="x"><asset><mesh file="k{suffix}"/></asset></mujoco>'.encode()
    path = staged(tmp_path, data)
    assert names_said(path) == ["0.obj"]
    kept = (path.parent / "0.obj").read_bytes().splitlines()
    wanted = [x for x in text.encode().splitlines() if b"mtllib" not in x]
    assert kept == wanted and b"v 1 0 0" in kept


@pytest.mark.parametrize("name", ["mujoco", pytest.param("pybullet", marks=pytest.mark.pybullet)])
def test_an_engine_refuses_a_mesh_that_lies_above(tmp_path, name):
    """PyBullet looks for a relative name beside every folder above the file, up to the first."""
    (tmp_path / "m.obj").write_text(TET)
    (tmp_path / "asset").mkdir()
    path = staged(tmp_path, meshed(str(tmp_path / "m.obj").lstrip("/")))
    with pytest.raises(ValueError):
        load(name, path, None)

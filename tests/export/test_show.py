"""An object in the browser: which page is opened, what a made page shows, and that nothing of it
stays."""

from __future__ import annotations

import base64
import gzip
import io
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from asset_objects import make_cabinet

from uniart_jax.export import show as show_module
from uniart_jax.export.physics import Hull
from uniart_jax.export.show import make_page, page_beside, read_shapes, show
from uniart_jax.objects.load import load_object

DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")
ROBOT = """<robot name="r"><link name="a"><visual><geometry><box size="1 1 1"/></geometry></visual>
  <collision><origin xyz="0 0 .1"/><geometry><box size=".5 .6 .7"/></geometry></collision></link>
  <link name="b"><visual><geometry><box size=".1 .1 .1"/></geometry></visual>
  <collision><origin xyz=".2 0 0"/><geometry><sphere radius=".05"/></geometry></collision></link>
  <link name="c"><visual><geometry><box size=".1 .1 .1"/></geometry></visual></link>
  <joint name="j" type="prismatic"><parent link="a"/><child link="b"/><origin xyz="0 1 0"/>
  <axis xyz="1 0 0"/><limit lower=".3" upper=".6" effort="1" velocity="1"/></joint>
  <joint name="k" type="fixed"><parent link="b"/><child link="c"/></joint></robot>"""


@pytest.fixture
def robot(tmp_path):
    path = tmp_path / "robot" / "x.urdf"
    path.parent.mkdir()
    path.write_text(ROBOT)
    return path


@pytest.fixture
def opened(monkeypatch):
    """Addresses that a browser is asked to open; there is a display."""
    addresses = []
    monkeypatch.setattr(show_module.webbrowser, "open", addresses.append)
    monkeypatch.setattr(show_module, "has_display", lambda: True)
    return addresses


def embedded(page: Path, name: str) -> str:
    (text,) = re.findall(rf'<script [^>]*id="{name}"[^>]*>(.*?)</script>', page.read_text("utf-8"))
    return text


def test_the_page_beside_an_asset_is_opened_and_stays(robot, opened, capsys):
    page = robot.with_name("view.html")
    page.write_text("ours")
    for asset in (robot, robot.parent):
        assert show(asset, wait=True) == page  # nothing to remove: it does not wait
    assert opened == [page.as_uri()] * 2 and page.read_text() == "ours"
    assert capsys.readouterr().out == f"{page}\n" * 2


def test_an_older_page_or_a_link_is_not_the_assets(robot, tmp_path):
    page = robot.with_name("view.html")
    page.write_text("old")
    assert page_beside(robot) == page
    os.utime(page, (1, 1))
    assert page_beside(robot) is None
    page.unlink()
    (tmp_path / "elsewhere.html").write_text("")
    page.symlink_to(tmp_path / "elsewhere.html")
    assert page_beside(robot) is None


def test_an_object_in_memory_gets_a_page_of_its_own(opened, capsys):
    cabinet = make_cabinet()
    page = cabinet.show(wait=False)
    assert opened == [page.as_uri()] and capsys.readouterr().out == f"{page}\n"
    assert [p.name for p in page.parent.iterdir()] == ["view.html"]
    asset = json.loads(embedded(page, "asset"))
    assert [p["name"] for p in asset["parts"]] == [p.name for p in cabinet.parts]
    glb = gzip.decompress(base64.b64decode(embedded(page, "glb")))
    scene = trimesh.load_scene(io.BytesIO(glb), file_type="glb")
    size = np.ptp(cabinet.bounds, axis=0) * cabinet.scale
    np.testing.assert_allclose(np.sort(scene.extents), np.sort(size), atol=0.01)
    for shapes, part in zip(asset["bodies"], cabinet.parts, strict=True):
        corners = [corner for shape in shapes for corner in shape_corners(shape)]
        bounds = [np.min(corners, 0), np.max(corners, 0)]
        np.testing.assert_allclose(bounds, part.mesh.bounds * cabinet.scale, atol=0.01)


def shape_corners(shape: dict) -> np.ndarray:
    if "vertices" in shape:
        return np.reshape(shape["vertices"], (-1, 3))
    signs = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), -1).reshape(-1, 3)
    return signs * shape["size"] @ np.transpose(shape["rotation"]) + shape["center"]


def test_a_made_page_has_the_files_collision_shapes(robot, tmp_path):
    bodies = json.loads(embedded(make_page(robot, tmp_path / "v.html"), "asset"))["bodies"]
    (box,), (ball,), nothing = bodies
    corners = shape_corners(box)
    bounds = [corners.min(0), corners.max(0)]
    np.testing.assert_allclose(bounds, [[-0.25, -0.3, -0.25], [0.25, 0.3, 0.45]], atol=1e-6)
    middle = shape_corners(ball).mean(0)
    np.testing.assert_allclose(middle, [0.5, 1, 0], atol=1e-5)  # .3 of travel, .2 of its own
    assert nothing == []


def test_a_file_without_collision_shapes_has_none(tmp_path):
    path = tmp_path / "x.urdf"
    path.write_text(re.sub("<collision>.*?</collision>", "", ROBOT))
    assert read_shapes(path, load_object(path)) == [[], [], []]


def test_shapes_of_a_file_are_its_own(robot):
    a, b, c = read_shapes(robot, load_object(robot))
    assert isinstance(a[0], Hull) and len(a) == len(b) == 1 and c == []


def test_no_such_asset(tmp_path):
    with pytest.raises(FileNotFoundError, match="nothing"):
        show(tmp_path / "nothing")


def test_no_browser_where_it_is_not_wanted_or_nobody_sees_it(robot, opened, monkeypatch):
    robot.with_name("view.html").touch()
    show(robot, open_browser=False)
    monkeypatch.setattr(show_module, "has_display", lambda: False)
    show(robot)
    assert opened == []


def test_a_display_is_one_of_the_desktops(monkeypatch):
    for name in DISPLAYS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    assert not show_module.has_display()
    monkeypatch.setenv("WAYLAND_DISPLAY", "wayland-0")
    assert show_module.has_display()


def test_ctrl_c_ends_the_command_and_removes_the_page(robot):
    process = run_view(robot)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        page = Path(line.removesuffix("  (Ctrl-C removes it)\n"))
        assert page.name == "view.html" and page.is_file() and page.parent != robot.parent
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=30)
        assert process.returncode == 0 and out == "removed\n" and "Traceback" not in err
        assert not page.parent.exists()
    finally:
        process.kill()


def test_a_script_that_ends_leaves_nothing(robot):
    code = f"from uniart_jax.export.show import show\nshow({str(robot)!r}, wait=False)"
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env={k: v for k, v in os.environ.items() if k not in DISPLAYS},
    )
    assert done.returncode == 0, done.stderr
    assert "uniart-view-" in done.stdout and not Path(done.stdout.strip()).parent.exists()


def run_view(asset: Path) -> subprocess.Popen:
    """``uniart view ASSET --no-browser``; a suite in a shell's background has Ctrl-C ignored."""
    code = (
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        f"sys.argv = ['uniart', 'view', {str(asset)!r}, '--no-browser']\n"
        "from uniart_jax.cli import main; main()"
    )
    command = [sys.executable, "-u", "-c", code]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

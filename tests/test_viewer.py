"""The served viewer: what it shows is the object, its sliders move it, and it ends when it is told
to."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import time
import urllib.request

import numpy as np
import pytest
import trimesh
from chromium import chromium
from trimesh.transformations import quaternion_matrix

from uniart_jax import viewer
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.load import load_object
from uniart_jax.objects.object import ArticulatedObject, Part

needs_viser = pytest.mark.skipif(
    not viewer.has_viser(), reason="needs viser: pip install 'uniart-jax[view]'"
)


def make_chest() -> ArticulatedObject:
    """A red body, a blue drawer, and a screw on the drawer: three deep, .4 m a unit."""

    def box(lo, hi, rgb):
        mesh = trimesh.creation.box(bounds=[lo, hi])
        mesh.visual = trimesh.visual.ColorVisuals(mesh, face_colors=[*rgb, 255])
        return mesh

    body = box([-0.3, -0.5, -0.5], [0.3, 0.5, 0.5], (200, 60, 40))
    drawer = box([-0.34, -0.4, -0.4], [0.2, 0.4, 0.1], (30, 70, 220))
    knob = box([-0.4, -0.05, -0.2], [-0.34, 0.05, -0.1], (230, 210, 40))
    pull = Joint([0, 0, 0], [-1, 0, 0], travel=(-0.05, 0.5))
    turn = Joint([-0.34, 0, -0.15], [-1, 0, 0], (0, 3.0), (0, 0.06))
    parts = (Part("body", body), Part("drawer", drawer, 0, pull), Part("knob 1/2", knob, 1, turn))
    return ArticulatedObject(parts, scale=0.4, name="chest")


@pytest.fixture(scope="module")
def chest():
    return make_chest()


@pytest.fixture
def shown(chest):
    page = viewer.view(chest, port=8391, open_browser=False, block=False)
    yield page
    page.stop()


@needs_viser
def test_frames_stand_where_forward_kinematics_says(shown, chest):
    for q in (chest.rest(), chest.open(), [0, 0.21, 1.3]):
        shown.set_state(q)
        np.testing.assert_array_equal(shown.state, q)
        for k, matrix in enumerate(chest.forward_kinematics(q)):
            frame = shown.server.scene.get_handle_by_name(f"/parts/{k}")
            np.testing.assert_allclose(
                quaternion_matrix(frame.wxyz)[:3, :3], matrix[:3, :3], atol=1e-6
            )
            np.testing.assert_allclose(frame.position, matrix[:3, 3] * 0.4, atol=1e-6)


@needs_viser
def test_states_stay_within_limits(shown):
    shown.set_state([5, 5, -5])
    np.testing.assert_array_equal(shown.state, [0, 0.5, 0])


@needs_viser
def test_served_here_only_and_two_side_by_side(shown, chest, capsys):
    other = viewer.view(chest, port=8391, open_browser=False, block=False)
    try:
        assert other.address != shown.address
        assert capsys.readouterr().out.strip() == f"chest: {other.address}"
        for page in (shown, other):
            assert page.server.get_host() == "localhost"
            with urllib.request.urlopen(page.address, timeout=10) as answer:
                assert answer.status == 200
    finally:
        other.stop()
    port = int(other.address.rpartition(":")[2])
    with pytest.raises(OSError):
        socket.create_connection(("localhost", port), timeout=2).close()


@needs_viser
def test_play_moves_and_pause_holds(shown, chest):
    shown.play()
    end = time.monotonic() + 20
    while np.array_equal(shown.state, np.zeros(3)) or not shown.state[1] > 0:
        assert time.monotonic() < end
        time.sleep(0.02)
    shown.pause()
    held = shown.state
    time.sleep(0.2)
    np.testing.assert_array_equal(shown.state, held)


@needs_viser
def test_ctrl_c_ends_it():
    code = (  # a suite that runs in a shell's background has the signal ignored
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\nfrom "
        "uniart_jax.viewer import view; import trimesh; from uniart_jax.objects.object import *\n"
        "view(ArticulatedObject((Part('a', trimesh.creation.box()),), name='box'), port=8411, "
        "open_browser=False)"
    )
    process = subprocess.Popen(
        [sys.executable, "-u", "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        assert "http://localhost:" in process.stdout.readline()
        time.sleep(0.2)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=20)
        assert process.returncode == 0 and "stopped" in out and "Traceback" not in err
    finally:
        process.kill()


def test_without_viser_one_line_says_what_to_install(chest, monkeypatch):
    monkeypatch.setattr(viewer, "has_viser", lambda: False)
    with pytest.raises(ValueError, match=r"pip install 'uniart-jax\[view\]'"):
        viewer.view(chest)


def test_no_such_asset(tmp_path):
    with pytest.raises(FileNotFoundError, match="nothing"):
        viewer.view(tmp_path / "nothing")


def test_collision_shapes_of_a_file_are_where_its_parts_are(tmp_path):
    """Other shapes than the visuals, on two of three links; all in the object frame at the shown
    state."""
    text = """<robot name="r"><link name="a"><visual><geometry><box size="1 1 1"/></geometry></visual>
      <collision><origin xyz="0 0 .1"/><geometry><box size=".5 .6 .7"/></geometry></collision></link>
      <link name="b"><visual><geometry><box size=".1 .1 .1"/></geometry></visual>
      <collision><origin xyz=".2 0 0"/><geometry><sphere radius=".05"/></geometry></collision></link>
      <link name="c"><visual><geometry><box size=".1 .1 .1"/></geometry></visual></link>
      <joint name="j" type="prismatic"><parent link="a"/><child link="b"/><origin xyz="0 1 0"/><axis xyz="1 0 0"/>
      <limit lower=".3" upper=".6" effort="1" velocity="1"/></joint>
      <joint name="k" type="fixed"><parent link="b"/><child link="c"/></joint></robot>"""  # noqa: E501
    path = tmp_path / "x.urdf"
    path.write_text(text)
    a, b, c = viewer.read_shapes(path, load_object(path))
    np.testing.assert_allclose(a[0].bounds, [[-0.25, -0.3, -0.25], [0.25, 0.3, 0.45]], atol=1e-9)
    np.testing.assert_allclose(
        b[0].bounds.mean(0), [0.5, 1, 0], atol=1e-6
    )  # .3 of travel, .2 of its own
    assert c == []


def test_a_file_without_collision_shapes_has_none(tmp_path):
    path = tmp_path / "x.urdf"
    path.write_text(
        '<robot name="r"><link name="a"><visual><geometry><box size="1 1 '
        '1"/></geometry></visual></link></robot>'
    )
    assert viewer.read_shapes(path, load_object(path)) == [[]]


def test_made_shapes_enclose_the_parts(chest):
    for part, shapes in zip(chest.parts, viewer.made_shapes(chest), strict=True):
        points = np.concatenate([s.vertices for s in shapes])
        bounds = [points.min(0), points.max(0)]
        np.testing.assert_allclose(bounds, part.mesh.bounds * 0.4, atol=0.005)


@pytest.mark.parametrize("joint", [
    Joint([0, 0, 0], [0, 0, 1], (-1, 2)),
    Joint([0, 0, 0], [0, 1, 1], (0, 0), (-0.2, 0.5)),
    Joint([1, 0, 0], [0, 0, 1], (0, 9), (0, 0.3)),
])  # fmt: skip
def test_the_drawn_way_goes_from_limit_to_limit(joint):
    anchor = np.array([0.5, 0.2, 0.1])
    way = viewer.anchor_way(joint, anchor)
    for point, q in ((way[0], joint.limits[0]), (way[-1], joint.limits[1])):
        np.testing.assert_allclose(point, (joint.motion(q) @ [*anchor, 1])[:3], atol=1e-9)


@needs_viser
@pytest.mark.browser
def test_a_slider_moves_a_part_on_the_page(shown, tmp_path):
    with chromium(tmp_path) as page:
        page.open("about:blank")
        page.window(900, 560)
        page.open(shown.address)
        page.wait("document.querySelectorAll('[role=slider]').length === 2")
        blue = 0
        end = time.monotonic() + 40
        while blue < 300:  # the meshes arrive after the panel
            assert time.monotonic() < end, page.errors
            before = page.screenshot()
            blue = _blue(before).sum()
        page.evaluate("document.querySelectorAll('[role=slider]')[0].focus()")
        for kind in ("keyDown", "keyUp"):
            page.call(
                "Input.dispatchKeyEvent", type=kind, key="End", code="End", windowsVirtualKeyCode=35
            )
        while shown.state[1] != 0.5:
            assert time.monotonic() < end
            time.sleep(0.05)
        time.sleep(0.5)
        after = page.screenshot()
    masks = _blue(before), _blue(after)
    assert (
        masks[1].sum() > 1.5 * masks[0].sum()
    )  # the drawer is out: its side is seen too, and it is nearer
    assert (np.abs(after.astype(int) - before).max(-1) > 60).sum() > 1000
    foreign = [
        u for u in page.requests if not u.startswith((shown.address, "data:", "blob:", "about:"))
    ]
    assert [u for u in foreign if "://localhost" not in u] == []


def _blue(picture: np.ndarray) -> np.ndarray:
    """Pixels of the scene, left of the panel, that are blue as the drawer is."""
    r, g, b = np.moveaxis(picture[:, :560].astype(int), -1, 0)
    return (b > r + 40) & (b > 1.4 * g)

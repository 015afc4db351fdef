"""view.html in a browser: joints move as in Python, switches, sliders and dragging work."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
import trimesh
from asset_objects import make_cabinet
from chromium import chromium
from page_objects import HOSTILE, make_solids, renamed, write_all

from uniart_jax.export.page import part_color, write_page

NEAR = 1e-6  # metres, and entries of rotations
SCENE = np.s_[:, :480]  # of a picture, without the panel


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with chromium(tmp_path_factory.mktemp("profile")) as page:
        yield page


@pytest.fixture
def opened(browser, page_file):
    """The cabinet's page, freshly loaded. Nothing may go wrong in it, and nothing may be asked
    for."""
    show(browser, page_file)
    yield browser
    assert browser.errors == []
    addresses = {url.split("?")[0] for url in browser.requests if not url.startswith("blob:")}
    assert addresses == {page_file.as_uri()}


def show(browser, path, width=800, height=500, dark=False):
    browser.open("about:blank")
    browser.errors.clear(), browser.requests.clear()
    browser.window(width, height, dark=dark)
    browser.open(path.as_uri())
    browser.wait("window.viewer !== null")


def click(browser, selector):
    browser.evaluate(f"document.querySelector({json.dumps(selector)}).click()")


def set_joints(browser, obj, q):
    for part, value in zip(obj.parts, q, strict=True):
        if part.parent >= 0 and part.joint.type != "fixed":
            value = float(value if part.joint.rotates else value * obj.scale)
            browser.evaluate(f"viewer.setJoint({json.dumps(part.name)}, {value!r})")


def part_mask(picture, k):
    """Pixels of a picture that have the flat colour of part ``k``, whatever white or gray is mixed
    into it."""
    color = np.array([int(part_color(k)[i : i + 2], 16) for i in (1, 3, 5)], float)
    color, seen = (c - c.mean(-1, keepdims=True) for c in (color, picture.astype(float)))
    strength = np.linalg.norm(seen, axis=-1)
    alike = seen @ color / np.maximum(strength, 1) / np.linalg.norm(color)
    return (alike > 0.93) & (strength > 32)


@pytest.mark.browser
def test_matrices_are_those_of_forward_kinematics(opened, cabinet):
    rng = np.random.default_rng(0)
    lo, hi = cabinet.limits.T
    drawn = [lo + (hi - lo) * rng.random(len(lo)) for _ in range(3)]
    for q in [np.zeros(len(lo)), cabinet.rest(), cabinet.open(), lo, hi, *drawn]:
        set_joints(opened, cabinet, q)
        seen = opened.evaluate("viewer.matrices()")
        for part, matrix in zip(cabinet.parts, cabinet.forward_kinematics(q), strict=True):
            matrix = matrix.copy()
            matrix[:3, 3] *= cabinet.scale
            np.testing.assert_allclose(
                np.reshape(seen[part.name], (4, 4)).T, matrix, atol=NEAR, err_msg=part.name
            )


@pytest.mark.browser
def test_moving_a_joint_moves_the_picture_of_its_part(opened, cabinet):
    click(opened, "#colors")
    before = opened.screenshot()[SCENE]
    set_joints(opened, cabinet, cabinet.coordinates({"drawer": 0.4}))
    after = opened.screenshot()[SCENE]
    k = cabinet.index("drawer")
    masks = part_mask(before, k), part_mask(after, k)
    assert min(m.sum() for m in masks) > 800
    rows, columns = np.nonzero(masks[0] | masks[1])
    changed = np.abs(after.astype(int) - before).max(-1) > 60
    near = changed[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1].sum()
    assert near > 800 and near > 0.8 * changed.sum()
    (y0, _), (y1, _) = (np.argwhere(m).mean(0) for m in masks)
    assert y1 > y0 + 5  # it comes to the front, seen from above: down in the picture
    assert masks[1].sum() > masks[0].sum()


@pytest.mark.browser
def test_every_switch_changes_the_picture(opened):
    seen = [opened.screenshot()]
    for switch in ("#axes", "#collision", "#colors", "#wireframe"):
        click(opened, switch)
        seen.append(opened.screenshot())
        click(opened, switch)
        back = opened.screenshot()
        assert (np.abs(seen[-1].astype(int) - seen[0])[SCENE].max(-1) > 30).sum() > 300
        assert np.abs(back.astype(int) - seen[0])[SCENE].max() <= 2, switch


@pytest.mark.browser
def test_collision_shapes_lie_on_their_parts_and_move_along(browser, tmp_path):
    cabinet = make_cabinet()
    white = [
        dataclasses.replace(p, mesh=trimesh.Trimesh(p.mesh.vertices, p.mesh.faces, process=False))
        for p in cabinet.parts
    ]
    obj = dataclasses.replace(cabinet, parts=tuple(white))
    show(browser, write_all(obj, tmp_path))
    for state in ({}, {"door": 1.2}):
        set_joints(browser, obj, obj.coordinates(state))
        assert part_mask(browser.screenshot()[SCENE], 1).sum() < 20
        seen = []
        for switch in ("#colors", "#collision"):
            click(browser, switch)
            seen.append(part_mask(browser.screenshot()[SCENE], 1))
            click(browser, switch)
        flat, shape = seen
        assert (flat & shape).sum() > 0.7 * flat.sum() > 300, state
        assert (shape & ~flat).sum() < 0.2 * flat.sum(), state
    assert browser.errors == []


@pytest.mark.browser
def test_sliders_buttons_and_play(opened, cabinet):
    state = "viewer.joints()"
    opened.evaluate("document.querySelector('input[name=drawer]').focus()")
    for kind in ("keyDown", "keyUp"):
        opened.call(
            "Input.dispatchKeyEvent", type=kind, key="End", code="End", windowsVirtualKeyCode=35
        )
    assert opened.evaluate(state)["drawer"] == pytest.approx(0.4 * cabinet.scale)
    readings = "[...document.querySelectorAll('.part')].map(r => r.textContent)"
    assert any("drawer" in r and "200 mm" in r for r in opened.evaluate(readings))
    for name, q in (
        ("open", cabinet.open()),
        ("rest", cabinet.rest()),
        ("shown", 0 * cabinet.rest()),
    ):
        click(opened, f"[data-state={name}]")
        opened.wait(f"document.querySelector('[data-state={name}]').ariaCurrent === 'true'")
        meant = float(q[cabinet.index("door")])
        assert opened.evaluate(state)["door"] == pytest.approx(meant, abs=NEAR)
    click(opened, "#play")
    opened.wait("viewer.joints().door > 0.3 && viewer.joints().knob > 0.3")
    click(opened, "#play")
    held = opened.evaluate(state)
    opened.screenshot()
    assert opened.evaluate(state) == held


@pytest.mark.browser
def test_a_part_is_dragged_and_the_rest_turns_the_view(opened, cabinet):
    click(opened, "#colors")
    before = opened.screenshot()
    y, x = np.argwhere(part_mask(before[SCENE], cabinet.index("drawer"))).mean(0)
    drag(opened, (x, y), (x + 40, y + 30))
    moved = opened.evaluate("viewer.joints()")
    assert moved["drawer"] > 0.02 and moved["door"] == moved["knob"] == 0
    after = opened.screenshot()
    door = [
        np.argwhere(part_mask(p[SCENE], cabinet.index("door"))).mean(0) for p in (before, after)
    ]
    np.testing.assert_allclose(door[0], door[1], atol=1)  # the view stood still
    drag(opened, (40, 40), (200, 60))
    assert opened.evaluate("viewer.joints()") == moved
    turned = opened.screenshot()
    assert (np.abs(turned.astype(int) - after).max(-1) > 60).sum() > 10_000


def drag(page, start, end):
    page.mouse("mouseMoved", *start)
    page.mouse("mousePressed", *start, button="left", buttons=1, clickCount=1)
    for share in np.linspace(0, 1, 6):
        at = (1 - share) * np.array(start) + share * np.array(end)
        page.mouse("mouseMoved", *at.tolist(), button="left", buttons=1)
    page.mouse("mouseReleased", *end, button="left", clickCount=1)
    page.mouse("mouseMoved", 3, 3)


@pytest.mark.browser
@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("width", [390, 1100])
def test_both_schemes_at_desk_and_phone_width(opened, page_file, dark, width):
    show(opened, page_file, width, 800, dark)
    picture = opened.screenshot()
    assert (picture[5, 5].mean() < 80) == dark
    assert opened.evaluate("document.documentElement.scrollWidth") == width
    box = opened.evaluate(
        "JSON.stringify(document.querySelector('#panel').getBoundingClientRect())"
    )
    box = json.loads(box)
    assert box["left"] >= 0 and box["right"] <= width and box["bottom"] <= 800
    canvas = opened.evaluate("document.querySelector('#canvas').clientHeight")
    assert canvas >= 400
    colors = picture[:canvas].reshape(-1, 3)
    assert (np.ptp(colors.astype(int), axis=1) > 50).mean() > 0.1  # the object is in the picture


@pytest.mark.browser
def test_hostile_names_are_text(browser, tmp_path):
    obj = renamed(make_cabinet(), HOSTILE)
    show(browser, write_all(obj, tmp_path))
    assert browser.evaluate("window.pwned === undefined")
    titles = browser.evaluate(
        "[...document.querySelectorAll('.title')].map(t => t.firstChild.data)"
    )
    assert sorted(titles) == sorted(p.name for p in obj.parts)
    assert browser.evaluate("document.title") == HOSTILE[0]
    assert browser.errors == []


@pytest.mark.browser
def test_a_broken_glb_is_told(browser, cabinet, tmp_path):
    (tmp_path / "object.glb").write_bytes(b"glTF nothing")
    page = write_page(cabinet, tmp_path / "object.glb", make_solids(cabinet), tmp_path / "v.html")
    browser.open(page.as_uri())
    browser.wait("!document.querySelector('#trouble').hidden")
    assert "cannot be drawn" in browser.evaluate("document.querySelector('#trouble').textContent")

"""view.html: complete in one file, nothing fetched, nobody's name executed, and joints that move as
in Python."""

from __future__ import annotations

import base64
import dataclasses
import gzip
import hashlib
import json
import re
from html.parser import HTMLParser
from importlib import resources

import numpy as np
import pytest
import trimesh
from asset_objects import make_cabinet
from chromium import chromium
from hypothesis import given
from hypothesis import strategies as st

from uniart_jax.export.atlas import make_atlas
from uniart_jax.export.glb import write_glb
from uniart_jax.export.page import joint_symbol, page_data, part_color, write_page
from uniart_jax.export.physics import Box, Hull, Shape
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part

NEAR = 1e-6  # metres, and entries of rotations
SCENE = np.s_[:, :480]  # of a picture, without the panel
HOSTILE = (
    "</script><script>window.pwned = 1</script>",
    "</script x",
    "<!-- <script x",
    "]]> & \"quoted\" 'name' {{glb}} \\1",
    "<img src=x onerror=window.pwned=1>",
    "\u2028line\u2029 name",
)


def make_solids(obj: ArticulatedObject) -> list[tuple[Shape]]:
    """A hull for every other part, a box for the rest."""
    shapes = []
    for k, part in enumerate(obj.parts):
        lo, hi = part.mesh.bounds * obj.scale
        shape = Box((lo + hi) / 2, hi - lo, np.eye(3))
        if k % 2 == 0:
            shape = Hull(part.mesh.convex_hull.copy().apply_scale(obj.scale))
        shapes.append((shape,))
    return shapes


def write_all(obj: ArticulatedObject, folder):
    atlas = make_atlas(obj, 128)
    textured = [s.textured(atlas.texture) for s in atlas.surfaces]
    glb = write_glb(obj, textured, folder / "object.glb")
    return write_page(obj, glb, make_solids(obj), folder / "view.html")


def renamed(obj: ArticulatedObject, names) -> ArticulatedObject:
    parts = list(obj.parts)
    for k, name in enumerate(names):
        parts[k] = dataclasses.replace(parts[k], name=name)
    return dataclasses.replace(obj, parts=tuple(parts), name=names[0])


class Elements(HTMLParser):
    """Every element of a page as (tag, attributes, text)."""

    def __init__(self, text: str):
        super().__init__()
        self.found: list[list] = []
        self.inside = False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append([tag, dict(attrs), ""])
        self.inside = True

    def handle_endtag(self, tag):
        self.inside = False

    def handle_data(self, data):
        if self.inside:
            self.found[-1][2] += data

    def texts(self, tag: str) -> list[str]:
        return [text for t, _, text in self.found if t == tag]

    def embedded(self, name: str) -> str:
        (text,) = (text for _, attrs, text in self.found if attrs.get("id") == name)
        return text


@pytest.fixture(scope="module")
def page_file(tmp_path_factory):
    return write_all(make_cabinet(), tmp_path_factory.mktemp("page"))


@pytest.fixture(scope="module")
def elements(page_file):
    return Elements(page_file.read_text(encoding="utf-8"))


def three(elements: Elements) -> str:
    """The script that the page's own unpacks and runs."""
    return gzip.decompress(base64.b64decode(elements.embedded("three"))).decode("utf-8")


def test_nothing_would_be_fetched(elements):
    for tag, attributes, _ in elements.found:
        assert not {"src", "srcset", "action", "data", "poster"} & set(attributes), tag
        assert attributes.get("href", "data:,") == "data:,"
    (style,) = elements.texts("style")
    assert "url(" not in style and "@import" not in style
    text = " ".join([*elements.texts("script"), three(elements)])
    assert set(re.findall(r"https?://[^\s\"'`)]+", text)) <= {"http://www.w3.org/1999/xhtml"}
    assert not re.search(r"\bimport\s*\(|importScripts|XMLHttpRequest", text)


def test_policy_lets_only_the_pages_own_code_run(elements):
    policies = [a["content"] for t, a, _ in elements.found if "http-equiv" in a]
    rules = dict(rule.strip().split(" ", 1) for rule in policies[0].split(";"))
    assert rules["default-src"] == "'none'" and rules["connect-src"] == "blob:"
    scripts = [text for t, a, text in elements.found if t == "script" and "type" not in a]

    def hashed(texts):
        digests = [hashlib.sha256(t.encode()).digest() for t in texts]
        return {f"'sha256-{base64.b64encode(d).decode()}'" for d in digests}

    assert len(scripts) == 1
    assert set(rules["script-src"].split()) == hashed([*scripts, three(elements)])
    assert set(rules["style-src"].split()) == hashed(elements.texts("style"))


def test_names_cannot_leave_their_place(tmp_path):
    obj = renamed(make_cabinet(), HOSTILE)
    (tmp_path / "object.glb").write_bytes(b"glTF\0\xff")
    page = write_page(obj, tmp_path / "object.glb", make_solids(obj), tmp_path / "view.html")
    elements = Elements(page.read_text(encoding="utf-8"))
    assert len(elements.texts("script")) == 4
    assert not [tag for tag, _, _ in elements.found if tag == "img"]
    asset = json.loads(elements.embedded("asset"))
    assert [p["name"] for p in asset["parts"]] == [p.name for p in obj.parts]
    assert asset["name"] == HOSTILE[0]
    assert gzip.decompress(base64.b64decode(elements.embedded("glb"))) == b"glTF\0\xff"


def test_same_object_same_bytes(page_file, tmp_path):
    assert write_all(make_cabinet(), tmp_path).read_bytes() == page_file.read_bytes()


def test_three_js_is_small_and_brings_its_licence(page_file):
    files = resources.files("uniart_jax.export") / "page_files"
    licence = (files / "THREE_LICENSE.txt").read_text("utf-8")
    assert "The MIT License" in licence and licence.strip() in page_file.read_text("utf-8")
    assert "three.js" in three(Elements(page_file.read_text("utf-8")))
    assert page_file.stat().st_size < 400_000


def test_a_body_for_every_part(cabinet, tmp_path):
    with pytest.raises(ValueError, match="shapes of 5 parts for 6 parts"):
        write_page(cabinet, tmp_path / "object.glb", make_solids(cabinet)[:5], tmp_path / "x.html")
    assert not (tmp_path / "x.html").exists()


def test_collision_shapes_are_those_given(cabinet, elements):
    bodies = json.loads(elements.embedded("asset"))["bodies"]
    for (meant,), (shape,) in zip(make_solids(cabinet), bodies, strict=True):
        if isinstance(meant, Box):
            np.testing.assert_allclose(shape["center"], meant.center, atol=NEAR)
            np.testing.assert_allclose(shape["size"], meant.size, atol=NEAR)
        else:
            vertices = np.reshape(shape["vertices"], (-1, 3))
            mesh = trimesh.Trimesh(vertices, np.reshape(shape["faces"], (-1, 3)), process=False)
            assert mesh.volume == pytest.approx(meant.mesh.volume, rel=1e-4)


unit = st.floats(-1, 1, allow_nan=False)
vector = st.tuples(unit, unit, unit)


@st.composite
def joints(draw):
    direction = draw(vector.filter(lambda v: np.linalg.norm(v) > 0.1))
    lo, hi = draw(st.floats(-3, 0)), draw(st.floats(0.1, 3))
    kind = draw(st.sampled_from(["revolute", "prismatic", "screw", "continuous"]))
    pitch = draw(st.sampled_from([-0.2, 0.05, 0.3]))
    travel = (lo * pitch, hi * pitch) if kind == "screw" else (0.0, 0.0)
    angle = (-4.0, 4.0) if kind == "continuous" else (lo, hi)
    if kind == "prismatic":
        angle, travel = (0.0, 0.0), (lo, hi)
    return Joint(np.array(draw(vector)), np.array(direction), angle, travel)


@given(joints(), st.floats(0.01, 5), st.floats(0, 1))
def test_json_tells_the_whole_motion(joint, scale, share):
    """What the page computes with (origin, direction, pitch, limits) is the joint, in metres."""
    root = Part("root", trimesh.creation.box((1, 1, 1)))
    part = Part("part", trimesh.creation.box((0.2, 0.3, 0.4)), 0, joint)
    obj = ArticulatedObject((root, part), scale=scale)
    told = page_data(obj, make_solids(obj))["parts"][1]["joint"]
    assert told["type"] == joint.type
    q = joint.limits[0] + share * (joint.limits[1] - joint.limits[0])
    unit = 1.0 if joint.rotates else scale
    assert told["limits"] == pytest.approx([limit * unit for limit in joint.limits])
    assert told["limits"][0] - NEAR <= min(told["rest"], told["open"])
    direction, origin = np.array(told["direction"]), np.array(told["origin"])
    turn = np.eye(3)
    if told["type"] != "prismatic":
        turn = trimesh.transformations.rotation_matrix(q, direction)[:3, :3]
    shift = origin - turn @ origin + direction * told["pitch"] * q * unit
    moved = joint.motion(q)
    np.testing.assert_allclose(turn, moved[:3, :3], atol=NEAR)
    np.testing.assert_allclose(shift, moved[:3, 3] * scale, atol=NEAR * scale)


def test_symbols_stand_where_parts_move(cabinet):
    door, drawer, wheel = (cabinet.parts[cabinet.index(n)] for n in ("door", "drawer", "wheel 1/2"))
    assert joint_symbol(drawer, 0.4).anchor == pytest.approx([-0.34, 0, -0.235])  # its front
    assert joint_symbol(drawer, -0.4).anchor[0] == pytest.approx(0.2)
    swing = joint_symbol(door, 1.6)
    assert 0 < swing.anchor[1] < 0.38 and swing.reach == pytest.approx(0.23)
    ring = joint_symbol(wheel, 1.0)
    out = ring.anchor - wheel.joint.origin
    assert out @ wheel.joint.direction == pytest.approx(0, abs=1e-9)
    assert np.linalg.norm(out) == pytest.approx(1.15 * 0.05, rel=0.02)


# In the browser


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

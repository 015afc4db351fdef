"""view.html: complete in one file, nothing fetched, nobody's name executed, and all that it says of
joints."""

from __future__ import annotations

import base64
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
from hypothesis import given
from hypothesis import strategies as st
from page_objects import HOSTILE, make_solids, renamed, write_all

from uniart_jax.export.page import joint_symbol, page_data, write_page
from uniart_jax.export.physics import Box
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part

NEAR = 1e-6  # metres, and entries of rotations


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

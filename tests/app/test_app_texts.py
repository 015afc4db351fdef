"""What the page shows, as HTML: escaped, in plain words, with what failed first."""

import dataclasses
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from toy_pipeline import toy_layout, toy_object

from uniart_jax.app import texts
from uniart_jax.app.check_words import check_groups, verdict_lines
from uniart_jax.app.making import Analysis, Made
from uniart_jax.app.part_words import motion, read_parts, root_first
from uniart_jax.objects.kinematics import Joint
from uniart_jax.simulation.summary import verdicts
from uniart_jax.simulation.validate import validate
from uniart_jax.voxels.kind import kind_of
from uniart_jax.voxels.revolution_table import Revolution

GOOD = {"passed": True, "value": 0.0, "limit": 0}
BAD = {"passed": False, "value": 3.0, "limit": 0, "reason": "'<door>' hangs in the air"}
FOUND = {
    "mujoco": {"loads": GOOD, "sweep": {"passed": False, "value": 0.5, "limit": 0.25}},
    "geometry": {"watertight": GOOD},
    "plausibility": {"attached": BAD, "free": GOOD},
}


class Elements(HTMLParser):
    """Tags with their attributes, all text, and whether every element that is opened is closed."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.text, self.open = [], "", []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in ("img", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def made(seed=0, validation=FOUND, folder="/made/a b/<x>"):
    report = {"parts": [{}, {}]} | ({"validation": validation} if validation else {})
    return Made(Path(folder), seed, "1 slider", report)


def seen(way="plain", background="auto", layout=None, edited=False):
    pixels = np.zeros((8, 8, 4), np.uint8)
    drawn = None if layout is None else Path("/s/parts.png")
    picture, cut = None if way == "table" else Path("/up.png"), Path("/s/cut.png")
    return Analysis(picture, pixels, pixels, background, way, layout, cut, drawn, edited)


def test_sentences_are_text():
    page = Elements(texts.sentence_html("image '<img src=x onerror=alert(1)>': no & no"))
    assert [tag for tag, _ in page.tags] == ["p"] and page.tags[0][1]["role"] == "alert"
    assert page.text == "image '<img src=x onerror=alert(1)>': no & no"


def test_the_cut_out_and_the_parts():
    page = Elements(texts.look_html(seen(layout=toy_layout())))
    pictures = [attributes["src"] for tag, attributes in page.tags if tag == "img"]
    assert pictures == ["gradio_api/file=/s/cut.png", "gradio_api/file=/s/parts.png"]
    said = str(kind_of(toy_layout()))
    title = f"{said[:1].upper()}{said[1:]}: 2 parts, 1 of them moves"
    for words in ("plain background", title, "drawer", "confidence 0.90"):
        assert words in page.text
    assert "slides by 30% of the object's size" in page.text
    page = Elements(texts.look_html(seen("none")))
    assert "reads no parts" in page.text and "pip install" in page.text
    assert "as asked" in Elements(texts.look_html(seen("none", "keep"))).text


def test_parts_of_a_table_have_its_names():
    twice = dataclasses.replace(toy_layout(), boxes=2 * toy_layout().boxes, names=("<tray>", "b"))
    page = Elements(texts.look_html(seen("table", layout=twice, edited=True)))
    assert "Plain picture" in page.text and "Parts of the table" in page.text
    assert "<tray>" in page.text and "confidence" not in page.text
    assert "slides by 15% of the object's size" in page.text
    page = Elements(texts.look_html(seen(layout=toy_layout(), edited=True)))
    assert "Cut-out" in page.text and "Parts of the table" in page.text
    assert "confidence 0.90" in page.text


def test_parts_in_words():
    base, drawer = read_parts(toy_layout())
    assert (base.kind, drawer.kind) == (base.name, drawer.name) == ("base", "drawer")
    assert base.color != drawer.color and not base.moves and drawer.moves
    ordered = root_first(toy_layout())
    assert ordered.parents == (-1, 0) and ordered.joints[1] == toy_layout().joints[0]
    np.testing.assert_array_equal(ordered.boxes[::-1], toy_layout().boxes)
    outline = Revolution(2, np.zeros(2), np.array([0.1]))
    turned = root_first(dataclasses.replace(toy_layout(), revolutions=(outline, None)))
    assert turned.revolutions == (None, outline)
    assert motion(Joint([0, 0, 0], [0, 0, 1], (0, np.pi / 2))) == "turns by 90°"
    assert motion(Joint([0, 0, 0], [0, 0, 1], (-4, 4))) == "turns all round"
    screw = Joint([0, 0, 0], [0, 0, 1], (0, np.pi), (0, -0.05))
    assert motion(screw) == "turns by 180° and slides by 5% of the object's size"


def test_a_small_part_that_turns_about_itself_is_a_knob():
    layout = toy_layout()
    turn = Joint([-0.32, 0.3, 0.3], [-1, 0, 0], (-1, 1))
    for size, at, kind in ((0.1, 0.3, "knob"), (0.1, 0.2, "hinge"), (0.4, 0.3, "hinge")):
        boxes = np.array([[-0.32, at, 0.3, 0.04, size, size], layout.boxes[1]])
        rows = dataclasses.replace(layout, boxes=boxes, joints=(turn, Joint.fixed()))
        assert read_parts(rows)[1].kind == kind


def test_stages_over_going_on_and_to_come():
    plan = {"look": 1, "structure": 2, "zip": 1}
    page = Elements(texts.stages_html(plan, {"look": 1, "structure": 1}, "structure"))
    classes = [attributes["class"] for tag, attributes in page.tags if tag == "li"]
    assert classes == ["done", "now", "ahead"] and "1 of 2" in page.text
    (bar,) = [a for _, a in page.tags if a.get("role") == "progressbar"]
    assert bar["aria-valuenow"] == "25"
    page = Elements(texts.stages_html(plan, {"look": 1, "structure": 2, "zip": 1}, None))
    assert {a["class"] for tag, a in page.tags if tag == "li"} == {"done"}


def test_objects_side_by_side():
    page = Elements(texts.objects_html([made(0), made(1, None)]))
    frames = [attributes for tag, attributes in page.tags if tag == "iframe"]
    assert len(frames) == 2 and frames[0]["src"] == "gradio_api/file=/made/a%20b/%3Cx%3E/view.html"
    assert "seed 1" in page.text and "Does not look like an object" in page.text
    assert "ua-many" in page.tags[0][1]["class"]
    assert "ua-many" not in texts.objects_html([made()])


def test_checks_that_failed_come_first_and_say_why():
    groups = check_groups(FOUND)
    assert list(groups) == ["MuJoCo", "the files", "as a person sees it"]
    first = groups["MuJoCo"][0]
    assert not first.passed and "whole range" in first.asks
    assert first.reason == "0.5, where 0.25 is the limit"
    page = Elements(texts.checks_html([made()], ["seed 8: <none>"]))
    assert "3 of 5 checks passed" in page.text and "'<door>' hangs in the air" in page.text
    assert "Not made: seed 8: <none>" in page.text
    assert "open" in dict(page.tags)["details"]  # some failed
    good = {"mujoco": {"loads": GOOD}}
    page = Elements(texts.checks_html([made(0, good)], []))
    assert "open" not in dict(page.tags)["details"]
    assert texts.checks_html([made(0, None)], []) == ""


def test_the_sum_of_the_checks():
    works, sense = verdict_lines(FOUND)
    assert (works.passed, sense.passed) == (False, False)
    assert works.asks == "Fails checks: MuJoCo"
    floats = FOUND | {"mujoco": {"loads": GOOD}, "geometry": {"gaps": BAD}}
    assert verdict_lines(floats)[0].asks == "Fails checks: the files"
    assert verdict_lines({"geometry": {"gaps": GOOD}})[0].asks == "No engine ran"
    good = {name: dict.fromkeys(checks, GOOD) for name, checks in FOUND.items()}
    works, sense = verdict_lines(good)
    assert (
        works.asks == "Loads, stands and opens in MuJoCo" and sense.asks == "Looks like an object"
    )
    assert verdict_lines(None) == verdict_lines({}) == []


@pytest.mark.slow
def test_every_check_has_words(tmp_path):
    """None of a real asset is told by its name in the code."""
    toy_object().save(tmp_path / "toy")
    found = verdicts(validate(tmp_path / "toy"))
    for name, lines in zip(found, check_groups(found).values(), strict=True):
        told = {line.asks for line in lines}
        assert not told & {key.replace("_", " ") for key in found[name]}, name

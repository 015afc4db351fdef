"""The page's table: an edited one is followed, with a picture or alone, and told when it is bad."""

import json
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from toy_pipeline import ToyPipeline, toy_layout

from uniart_jax.app import serve
from uniart_jax.app.sessions import Sessions
from uniart_jax.app.table import LONGEST, table_text

ROOT = Path(__file__).parents[2]
OVEN = ROOT / "examples" / "images" / "oven.png"
CHEST = ROOT / "examples" / "layouts" / "chest.json"
TROUBLE = 'role="alert"'
pytestmark = pytest.mark.skipif(
    not serve.has_gradio(), reason="needs Gradio: pip install 'uniart-jax[app]'"
)


class Opened:
    """A page without a browser: its fields, and what its functions answer."""

    def __init__(self, root: Path):
        from uniart_jax.app.page import Desk

        self.root, self.pipeline = root, ToyPipeline()
        self.desk = Desk(self.pipeline, Sessions(root), "toy")
        self.request = SimpleNamespace(session_hash="one")
        self.picture, self.table, self.background = None, "", "auto"

    def drop(self, file):
        self.picture = None
        if file is not None:
            (folder := self.root / file.stem).mkdir(exist_ok=True)
            self.picture = {"path": str(shutil.copy(file, folder))}
        button, table = self.desk.came(self.picture, self.request)
        if file is not None:
            assert not button.interactive and table == ""
            self.table = table
        return self.look()

    def look(self):
        """What is seen, and whether the button works."""
        seen, button, *_, table = self.desk.look(
            self.picture, self.background, self.table, self.request
        )
        self.table = table
        return seen, button.interactive

    def show(self):
        seen, button = self.desk.show(self.picture, self.background, self.table, self.request)
        return seen, button.interactive

    def make(self):
        fields = [self.picture, 1, 0, None, None, self.background, False, self.table]
        *_, told = self.desk.make(*fields, self.request)
        assert told[4].interactive
        return told

    @property
    def followed(self):
        return self.pipeline.asked[-1]["layout"]

    def change(self, row, **fields):
        data = json.loads(self.table)
        data["parts"][row].update(fields)
        self.table = json.dumps(data)

    def report(self):
        (path,) = self.root.glob("sessions/*/object-*/asset/report.json")
        return json.loads(path.read_text())


@pytest.fixture
def page(tmp_path, small_pictures):
    return Opened(tmp_path)


def drawn(html):
    """The pictures that are shown."""
    names = [part.split('"')[0] for part in html.split("gradio_api/file=")[1:]]
    return [np.asarray(Image.open(name)) for name in names]


def test_a_picture_fills_the_table_and_untouched_it_is_what_was_read(page, monkeypatch):
    sure = toy_layout().__class__(**{**toy_layout().__dict__, "certainty": 0.8})
    monkeypatch.setattr(ToyPipeline, "layout_or_none", lambda *_: sure)
    seen, works = page.drop(OVEN)
    assert works and page.table == table_text(toy_layout()) and "as they are read" in seen
    assert page.show() == (seen, True)
    assert page.make()[3].visible and page.followed is sure


def test_an_edited_table_is_drawn_and_followed(page):
    before, _ = page.drop(OVEN)
    page.change(1, name="tray", box={"center": [-0.31, 0, 0.2], "size": [0.02, 0.9, 0.3]})
    seen, works = page.show()
    assert works and "Parts of the table" in seen and "<b>tray</b>" in seen
    (same, old), (cut, new) = drawn(before), drawn(seen)
    np.testing.assert_array_equal(same, cut)
    assert (old != new).any()
    assert page.show()[0] == seen  # the same files
    page.make()
    assert page.followed.boxes[1, 2] == 0.2 and page.followed.certainty is None
    assert page.followed.names[1] == "tray" and page.report()["background"] == ["alpha"]
    np.testing.assert_array_equal(page.followed.camera, toy_layout().camera)


def test_the_answer_of_a_vision_language_model_is_followed_beside_the_picture(page):
    page.drop(OVEN)
    chest = json.loads(CHEST.read_text())
    page.table = f"Sure:\n{json.dumps(chest | {'view': {'azimuth': 30, 'elevation': 20}})}"
    seen, works = page.show()
    assert works and "Parts of the table" in seen and "<b>lid</b>" in seen
    page.make()
    assert page.followed.names == ("body", "lid") and page.followed.camera is not None
    assert page.followed.size == pytest.approx(1.02) and not page.followed.metres
    del chest["parts"][1]["box"]
    page.table = json.dumps(chest)
    told, works = page.show()
    assert not works and "part 1: box is missing" in told


def test_a_part_that_was_deleted_is_not_followed(page):
    page.drop(OVEN)
    data = json.loads(page.table)
    del data["parts"][1]
    page.table = json.dumps(data)
    page.make()  # also where it was not shown before
    assert len(page.followed) == 1 and page.followed.parents == (-1,)


def test_a_bad_table_is_one_line_and_the_button_is_off(page):
    seen, _ = page.drop(OVEN)
    read = page.table
    for text, says in (
        (read[:-1], "not valid JSON"),
        (read.replace('"size"', '"sizes"', 1), "part 0: box: no entry"),
        ("x" * (LONGEST + 1), "200,001 characters"),
    ):
        page.table = text
        told, works = page.show()
        assert not works and TROUBLE in told and says in told and "\n" not in told
        assert says in page.make()[0] and page.pipeline.asked == []
    for text in ("", read):
        page.table = text
        assert page.show() == (seen, True)


def test_a_table_alone_becomes_an_object(page):
    assert page.look()[1] is page.show()[1] is False
    (number,) = [k for k, p in enumerate(sorted(CHEST.parent.glob("*.json"))) if p == CHEST]
    page.picture, page.table = page.desk.pick(number, page.request)
    assert page.picture is None and page.table == CHEST.read_text()
    seen, works = page.show()
    assert works and "Plain picture" in seen and "<b>lid</b>" in seen
    plain, boxes = drawn(seen)
    assert (plain != boxes).any() and plain.any()
    assert page.make()[3].visible
    asked = page.pipeline.asked[-1]
    assert asked["layout"].boxes[0, 4] == 1.0 and asked["name"] == "object"
    report = page.report()
    assert "background" not in report and report["checkpoint"] == "toy"
    assert {p.relative_to(page.root).parts[0] for p in page.root.rglob("*")} == {"sessions"}


def test_a_new_picture_replaces_the_table_and_an_edited_one_outlives_it(page):
    page.drop(OVEN)
    read, page.table = page.table, "{}"
    page.drop(ROOT / "examples" / "images" / "table.png")
    assert page.table == read
    assert page.drop(None)[1] is False and page.table == ""  # nobody wrote it
    page.drop(OVEN)
    page.change(1, name="tray")
    edited = page.table
    seen, works = page.drop(None)
    assert works and page.table == edited and "Plain picture" in seen
    page.table = CHEST.read_text()
    bad = page.root / "bad.png"
    bad.write_bytes(b"words")
    told, works = page.drop(bad)
    assert not works and "not an image" in told and page.table == ""

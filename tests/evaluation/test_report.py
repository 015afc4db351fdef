"""report.html: every number it was given, in one file that runs and fetches nothing, whatever an
object is called."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import io
import itertools
import math
import re
from html.parser import HTMLParser

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from uniart_jax.evaluation import report
from uniart_jax.evaluation.metric import at_rest
from uniart_jax.evaluation.report import WORST, worst_objects, write_report
from uniart_jax.evaluation.report_elements import clearly_best, decimals, ends_of, histogram
from uniart_jax.evaluation.report_pictures import draw_pair
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.visual.render import PART_COLORS

HOSTILE = (
    "</style><script>window.pwned = 1</script>",
    "<img src=x onerror=window.pwned=1>",
    "\" onload='x' {{body}} \\1 &amp; <!-- ]]>",
    "javascript:alert(1)",
    "\u2028line\u2029 \x00\x07\ud800 name",
)
VOID = {"meta", "link", "img", "br", "hr", "input"}


def cupboard(angle: float = 1.5, name: str = "door") -> ArticulatedObject:
    body = trimesh.creation.box(bounds=[[-0.3, -0.4, -0.5], [0.3, 0.4, 0.5]])
    door = trimesh.creation.box(bounds=[[-0.34, -0.4, -0.5], [-0.3, 0.4, 0.5]])
    joint = Joint([-0.32, 0.4, 0], [0, 0, 1], (min(angle, 0), max(angle, 0)))
    return at_rest(ArticulatedObject((Part("body", body), Part(name, door, 0, joint))))


def make_content(objects: int = 14, methods=("ours", "other"), seed: int = 0) -> dict:
    """A comparison whose numbers are random: any mix-up of rows or columns shows."""
    rng = np.random.default_rng(seed)
    metrics = {
        "pose_error": {"title": "pose error", "better": "lower", "about": "how far points are off"},
        "as_psnr": {"title": "AS PSNR", "better": "higher", "about": "pictures, dB"},
        "pivot": {"title": "pivot", "better": "lower", "about": "between axes"},
    }

    def rows(count):
        mean = {"pose_error": rng.uniform(0.1, 0.9), "as_psnr": rng.uniform(10, 50)}
        mean["pivot"] = rng.uniform(0.01, 0.09)
        return {
            k: {"mean": m, "low": 0.9 * m, "high": 1.1 * m, "count": count} for k, m in mean.items()
        }

    content: dict = {"methods": {}, "metrics": metrics, "settings": {"reference": "assets/truth"}}
    for method in methods:
        names = [f"object-{i:02d}" for i in range(objects)]
        content["methods"][method] = {
            "rows": rows(objects),
            "objects": {
                n: {
                    "pose_error": rng.uniform(0.1, 0.9),
                    "as_psnr": rng.uniform(10, 50),
                    "pivot": rng.uniform(0.01, 0.09) if i % 3 else None,
                }
                for i, n in enumerate(names)
            },
            "categories": {"table": rows(5), "oven": rows(objects - 5)},
            "sets": {"closed": rows(4), "open": rows(objects - 4)},
            "failures": {},
            "uncolored": names[:2],
            "confusion": {"revolute": {"revolute": 7, "prismatic": 2}, "fixed": {"missing": 3}},
        }
    content["methods"][methods[0]]["failures"]["object-03"] = "meshes/door.obj: no such file"
    return content


class Page(HTMLParser):
    """Elements as (tag, attributes), rows of cells' texts, and whether every element is closed in
    its order."""

    def __init__(self, text: str):
        super().__init__(convert_charrefs=True)
        self.elements: list[tuple[str, dict]] = []
        self.rows: list[list[str]] = []
        self.images: list[str] = []
        self.open: list[str] = []
        self.words: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_endtag(self, tag):
        assert self.open and self.open[-1] == tag, f"</{tag}> closes {self.open[-3:]}"
        self.open.pop()

    def handle_data(self, data):
        self.words.append(data)
        if "td" in self.open or "th" in self.open:
            self.rows[-1][-1] += data + " "

    @property
    def text(self) -> str:
        return " ".join(self.words)


def read(file) -> Page:
    page = Page(file.read_text("utf-8"))
    assert page.open == []
    return page


def numbers(text: str) -> list[float]:
    return [float(n) for n in re.findall(r"-?\d+\.\d+(?:e-?\d+)?|-?\d+", text)]


def near(shown: float, value: float) -> bool:
    """Three digits or more are right."""
    return abs(shown - value) <= 6e-3 * abs(value)


def test_every_number_is_in_the_row_and_column_where_it_belongs(tmp_path):
    content = make_content()
    page = read(write_report(tmp_path, content))
    keys = list(content["metrics"])
    of_objects = {
        (r[0].split()[0], r[1].strip()): r for r in page.rows if r and r[0].startswith("object-")
    }
    for method, found in content["methods"].items():
        for name, figures in found["objects"].items():
            row = of_objects[name, method]
            for key, cell in zip(keys, row[2:], strict=True):
                if figures[key] is None:
                    assert cell.strip() == "–"
                else:
                    assert near(float(cell), figures[key]), (method, name, key)
        places = [found["rows"], *found["categories"].values(), *found["sets"].values()]
        for rows in places:
            given = [rows[key][end] for key in keys for end in ("mean", "low", "high")]
            assert any(
                method in " ".join(r[:2])
                and len(shown := [v for c in r[-len(keys) :] for v in numbers(c)[:3]]) == len(given)
                and all(map(near, shown, given))
                for r in page.rows
            ), (method, given)
        counts = [r for r in page.rows if r and r[0].strip() == "revolute"]
        assert [c.strip() for c in counts[0][1:]] == ["2", "7", "0"]  # missing comes last
    assert "meshes/door.obj: no such file" in page.text and "assets/truth" in page.text
    for metric in content["metrics"].values():
        assert metric["title"] in page.text and metric["about"] in page.text


def test_nan_and_absent_parts_are_no_trouble(tmp_path):
    content = make_content(3)
    for method in content["methods"].values():
        for key in ("categories", "sets", "failures", "uncolored", "confusion"):
            del method[key]
        method["rows"]["pivot"] = {"mean": math.nan, "low": math.nan, "high": math.nan, "count": 0}
        for figures in method["objects"].values():
            figures["pivot"] = math.nan
    del content["settings"]
    page = read(write_report(tmp_path, content))
    assert "nan" not in page.text.lower() and "None." in page.text


def test_it_stands_alone_and_its_policy_fits(tmp_path):
    file = write_report(tmp_path, make_content(2), lambda method, name: (cupboard(1.2), cupboard()))
    page = read(file)
    for tag, attributes in page.elements:
        assert tag not in ("script", "iframe", "object", "embed", "form", "base"), tag
        assert not [a for a in attributes if a.startswith("on") or a == "style"], attributes
        for name in ("src", "href", "srcset", "data", "action"):
            if address := attributes.get(name):
                assert address.startswith(("data:", "#")), (tag, address)
    text = file.read_text("utf-8")
    assert "http:" not in text and "https:" not in text and "url(" not in text
    ids = {a["id"] for _, a in page.elements if "id" in a}
    links = [a["href"][1:] for t, a in page.elements if t == "a"]
    assert links and set(links) <= ids
    style = re.search(r"<style>(.*?)</style>", text, re.S)
    policy = next(
        a["content"] for t, a in page.elements if "policy" in a.get("http-equiv", "").lower()
    )
    assert style is not None
    digest = base64.b64encode(hashlib.sha256(style[1].encode()).digest()).decode()
    rest = "img-src data:; base-uri 'none'; form-action 'none'"
    assert policy == f"default-src 'none'; style-src 'sha256-{digest}'; {rest}"
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("name", HOSTILE)
def test_no_name_becomes_markup(tmp_path, name):
    plain = make_content(3)
    tags = [t for t, _ in read(write_report(tmp_path, plain)).elements]
    content = make_content(3, methods=(name, "other"))
    method = content["methods"][name]
    method["objects"] = {name + n[-1]: f for n, f in method["objects"].items()}
    method["failures"] = {name: name}
    method["categories"] = {name: method["rows"], "x": method["rows"]}
    method["confusion"] = {name: {name: 2, "q": 1, "r": 0}, "u": {"q": 1}}
    content["metrics"]["pivot"] |= {"title": name, "about": name}
    content["settings"] = {name: {name: [name, 1]}}
    page = read(write_report(tmp_path, content))
    allowed = {*tags}
    assert {t for t, _ in page.elements} <= allowed
    assert not [a for _, a in page.elements if set(a) & {"onerror", "onload", "src"}]
    assert "alert" not in "".join(a.get("href", "") for _, a in page.elements)


@settings(max_examples=20)
@given(st.text(max_size=40))
def test_any_text_is_shown_as_text(tmp_path_factory, name):
    content = make_content(2)
    content["methods"]["ours"]["failures"] = {"object-00": name}
    page = read(write_report(tmp_path_factory.mktemp("page"), content))
    cell = next(r for r in page.rows if len(r) == 3 and r[1].strip() == "object-00")[2]
    shown = "".join(c if c.isprintable() else "?" for c in " ".join(name.split()))
    assert cell.strip() == shown.strip()


def test_the_worst_ten_come_in_order_with_pictures(tmp_path, monkeypatch):
    drawn = Image.effect_noise((800, 300), 40)  # compresses worse than any picture
    monkeypatch.setattr(report, "draw_pair", lambda pred, ref: drawn)
    content = make_content(objects=14)
    content["methods"]["ours"]["objects"]["object-03"]["pose_error"] = 1.0  # failed: no picture
    content["methods"]["ours"]["objects"]["object-05"]["pose_error"] = None

    def load_pair(method, name):
        if (method, name) == ("ours", "object-03"):
            raise ValueError("no such file")
        if (method, name) == ("other", "object-01"):
            raise ValueError("cannot be drawn <b>")
        return pair

    pair = cupboard(1.0), cupboard()
    content["methods"]["other"]["objects"]["object-01"]["pose_error"] = 0.95
    file = write_report(tmp_path, content, load_pair)
    heads = re.findall(r"<h4>(\d+)\. (\S+): pose error ([\d.]+)</h4>", file.read_text("utf-8"))
    assert len(heads) == 2 * WORST
    for method, found in zip(("ours", "other"), (heads[:WORST], heads[WORST:]), strict=True):
        errors = [float(e) for _, _, e in found]
        assert [int(i) for i, _, _ in found] == list(range(1, WORST + 1))
        assert errors == sorted(errors, reverse=True)
        expected = worst_objects(content["methods"][method])
        if method == "ours":
            assert expected[0] == "object-03" and "object-05" not in expected
            expected = expected[1:]
        assert [n for _, n, _ in found] == expected[:WORST]
    page = read(file)
    images = [a["src"] for t, a in page.elements if t == "img"]
    assert len(images) == 2 * WORST - 1 and "cannot be drawn <b>" in page.text
    picture = Image.open(io.BytesIO(base64.b64decode(images[0].split(",")[1])))
    assert picture.format == "JPEG" and picture.width == 800
    assert file.stat().st_size < 5e6


def test_without_pose_error_or_objects_nothing_is_drawn(tmp_path):
    content = make_content(3)
    del content["metrics"]["pose_error"]

    def never(method, name):
        raise AssertionError

    page = read(write_report(tmp_path, content, never))
    assert not [t for t, _ in page.elements if t == "img"]


def test_best_is_marked_only_without_overlap():
    figure = lambda mean, half: {"mean": mean, "low": mean - half, "high": mean + half}  # noqa: E731
    apart = {"a": figure(0.2, 0.05), "b": figure(0.4, 0.1), "c": figure(0.5, 0.1)}
    assert clearly_best(apart, "lower") == "a"
    assert clearly_best(apart, "higher") is None  # b and c overlap
    touching = {"a": figure(0.2, 0.1), "b": figure(0.4, 0.1)}
    assert clearly_best(touching, "lower") is None
    assert clearly_best({"a": figure(0.2, 0.0), "b": figure(0.2, 0.0)}, "lower") is None
    assert clearly_best({"a": figure(0.2, 0.0)}, "lower") is None
    assert clearly_best(apart | {"d": {"mean": None, "low": None, "high": None}}, "lower") is None


def test_the_mark_stands_in_the_right_cell(tmp_path):
    content = make_content(3)
    for method, mean in (("ours", 0.2), ("other", 0.7)):
        content["methods"][method]["rows"]["pose_error"] = {"mean": mean, "low": mean, "high": mean}
    text = write_report(tmp_path, content).read_text("utf-8")
    marked = re.findall(r'class="best">([\d.]+)', text)
    assert "0.200" in marked and "0.700" not in marked


@given(st.lists(st.floats(1e-4, 1e4), min_size=1, max_size=5))
def test_the_largest_value_keeps_three_digits(values):
    digits = decimals(values)
    assert near(round(max(values), digits), max(values)) and 0 <= digits <= 6


@given(st.lists(st.floats(-5, 5), min_size=1, max_size=30))
def test_bars_stay_in_the_plot(values):
    ends = ends_of(values)
    assert ends[0] < ends[1] and ends[0] <= min(values) and max(values) <= ends[1]
    svg = histogram(values, {"mean": float(np.mean(values))}, ends, 3)
    bars = svg.find("path").get("d").count("z")
    assert 1 <= bars <= len(values)
    x = float(svg.findall("line")[-1].get("x1"))
    assert 0 <= x <= 240


def colors_of(tile: np.ndarray) -> set[int]:
    """Which part colours a picture shows, by hue."""
    pixels = tile.reshape(-1, 3).astype(float)
    pixels = pixels[np.ptp(pixels, axis=1) > 40]
    unit = pixels / np.linalg.norm(pixels, axis=1, keepdims=True)
    palette = PART_COLORS / np.linalg.norm(PART_COLORS, axis=1, keepdims=True)
    nearest, count = np.unique((unit @ palette.T).argmax(1), return_counts=True)
    return {int(n) for n, c in zip(nearest, count, strict=True) if c > 200}


def test_matched_parts_have_one_colour_in_both_rows():
    ref = cupboard()
    knob = trimesh.creation.box(bounds=[[-0.5, -0.3, -0.1], [-0.34, 0.0, 0.2]])
    extra = Part("knob", knob, 0, Joint([0, 0, 0], [1, 0, 0], travel=(0, 0.2)))
    body, door = ref.parts
    pred = at_rest(dataclasses.replace(ref, parts=(body, extra, door)))
    sheet = np.asarray(draw_pair(pred, ref, 200))
    half, tile = sheet.shape[0] // 2, sheet[:, 400:600]
    assert sheet.shape[1] == 800
    assert colors_of(tile[:half]) == {1}  # the door; the body is gray
    # the door again, though it is the third part, and the surplus one
    assert colors_of(tile[half:]) == {1, 2}


def test_pairs_show_how_they_open():
    sheet = np.asarray(draw_pair(cupboard(0.3), cupboard(), 120)).astype(float)
    half = sheet.shape[0] // 2
    truth, pred = sheet[20:half], sheet[half + 20 :]
    tiles = lambda row: [row[:, i * 120 : (i + 1) * 120] for i in range(4)]  # noqa: E731
    difference = [np.abs(a - b).mean() for a, b in zip(tiles(truth), tiles(pred), strict=True)]
    assert difference[0] == difference[2] == 0 and min(difference[1], difference[3]) > 1
    for a, b in itertools.combinations(tiles(truth), 2):
        assert np.abs(a - b).mean() > 1

"""A picture becomes objects and a zip, stage by stage; what cannot be is said in one line."""

import dataclasses
import inspect
import re
import zipfile
from collections import Counter
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image
from toy_pipeline import ToyPipeline, toy_layout

from uniart_jax.app import examples, making
from uniart_jax.app.examples import example_pictures, example_tables
from uniart_jax.app.making import Options, analyze, make, planned, sentence, stage_of, zip_assets
from uniart_jax.pipeline import Pipeline
from uniart_jax.voxels.kind import kind_of

ROOT = Path(__file__).parents[2]
OVEN = ROOT / "examples" / "images" / "oven.png"


def names_in(folder):
    return sorted(str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file())


@pytest.fixture(scope="module")
def made(tmp_path_factory, small_pictures):
    """Two samples, untried in engines, of three that were asked for; and all that was told."""
    folder, told = tmp_path_factory.mktemp("made"), []
    pipeline = ToyPipeline(bad=(8,))
    seen = analyze(pipeline, OVEN, "auto", folder)
    options = Options(samples=3, seed=7, guidance=2.0, check=False)
    return seen, *make(pipeline, seen, options, folder, told.append, "toy"), told, pipeline


def test_what_is_seen_in_a_picture(made):
    seen = made[0]
    assert seen.way == "alpha" and len(seen.layout) == 2
    plain, drawn = (np.asarray(Image.open(p)).astype(int) for p in (seen.shown, seen.drawn))
    assert plain.shape == drawn.shape == (making.SIDE, making.SIDE, 3)
    assert (np.abs(plain - drawn).max(-1) > 60).sum() > 2000  # boxes and axes


def test_no_parts_are_drawn_where_none_are_read(tmp_path, monkeypatch):
    monkeypatch.setattr(ToyPipeline, "layout_or_none", lambda *_: None)
    seen = analyze(ToyPipeline(), OVEN, "auto", tmp_path)
    assert seen.layout is None and seen.drawn is None and seen.shown.is_file()


def test_several_samples_and_one_that_fails(made):
    _, objects, failed, _, pipeline = made
    assert [one.seed for one in objects] == [7, 9]
    assert failed == ["seed 8: oven: the model found no object in the image"]
    assert [asked["seed"] for asked in pipeline.asked] == [7, 8, 9]
    for asked in pipeline.asked:
        assert asked["steps"] == 4 and asked["guidance"] == 2.0 and asked["adaptive"] is False
        assert len(asked["layout"]) == 2 and asked["background"] == "keep"


def test_reports_say_how_it_was_made(made):
    for one in made[1]:
        assert one.found == f"{kind_of(toy_layout())}: 1 drawer"
        assert one.report["seed"] == one.seed and one.report["checkpoint"] == "toy"
        assert one.report["background"] == ["alpha"] and one.report["spread"]["samples"] == 2
        assert (one.folder / "view.html").is_file()


def test_each_stage_is_told_as_often_as_it_was_planned(made):
    """The page itself tells of the first and the last; seed 8 came no farther than structure."""
    plan, told = planned(Options(samples=3, check=False)), Counter(made[3])
    assert list(plan) == ["look", "structure", "surfaces", "joints", "files", "refine", "zip"]
    assert plan["look"] == plan["zip"] == 1 and "check" in planned(Options())
    assert told == {"structure": 3, "surfaces": 2, "joints": 2, "files": 2, "refine": 2}


def test_samples_that_differ_by_themselves_take_the_models_steps(tmp_path):
    pipeline = ToyPipeline(steps=4, bad=(0, 1))
    seen = analyze(ToyPipeline(), OVEN, "auto", tmp_path)
    with pytest.raises(ValueError):
        make(pipeline, seen, Options(samples=2), tmp_path, lambda stage: None)
    assert [asked["steps"] for asked in pipeline.asked] == [None, None]


def test_the_steps_that_the_pipeline_tells_are_known():
    steps = re.findall(r"progress\((f?\"[^\"]+\")\)", inspect.getsource(Pipeline.sample))
    stages = [stage_of(eval(step, {"coords": [1, 2]})) for step in steps]
    assert stages == [None, None, "structure", "surfaces", "joints"]


def test_whoever_stops_telling_stops_the_work(tmp_path):
    def tell(stage):
        raise KeyError(stage)

    seen = analyze(ToyPipeline(), OVEN, "auto", tmp_path)
    with pytest.raises(KeyError, match="structure"):
        make(ToyPipeline(), seen, Options(), tmp_path, tell)


def test_none_that_could_be_made_is_an_error(tmp_path):
    seen = analyze(ToyPipeline(), OVEN, "auto", tmp_path)
    with pytest.raises(ValueError, match="found no object"):
        make(ToyPipeline(bad=(0, 1)), seen, Options(samples=2), tmp_path, lambda stage: None)


def test_the_zip_holds_what_simulators_load(made, tmp_path):
    objects = made[1]
    whole = zip_assets(objects, "oven", tmp_path / "all.zip")
    again = zip_assets(objects, "oven", tmp_path / "again.zip")
    assert whole.read_bytes() == again.read_bytes()
    with zipfile.ZipFile(whole) as archive:
        archive.extractall(tmp_path / "out")
    for one in objects:
        folder = tmp_path / "out" / "oven" / one.folder.name
        assert names_in(folder) == names_in(one.folder)
        assert mujoco.MjModel.from_xml_path(str(folder / "object.urdf")).njnt == 1
    single = zip_assets(objects[:1], "oven", tmp_path / "one.zip")
    assert "oven/object.urdf" in zipfile.ZipFile(single).namelist()


@pytest.mark.parametrize(
    ("write", "says"),
    [
        (lambda p: p.write_bytes(b""), "image 'up.png': the file is empty"),
        (lambda p: p.write_bytes(b"hello"), "image 'up.png': not an image"),
        (lambda p: Image.new("RGB", (3, 3)).save(p), "image 'up.png': 3x3 pixels is too small"),
        (lambda p: Image.new("RGBA", (64, 64)).save(p), "image 'up.png': it is transparent"),
        (lambda p: p.write_bytes(OVEN.read_bytes()[:4000]), "image 'up.png': truncated"),
        (lambda p: Image.new("1", (20_000, 10_000)).save(p), "image 'up.png': too many pixels"),
    ],
)
def test_bad_pictures_are_one_sentence_without_their_place(tmp_path, write, says):
    picture = tmp_path / "up.png"
    write(picture)
    with pytest.raises(ValueError) as caught:
        analyze(ToyPipeline(), picture, "auto", tmp_path)
    told = sentence(caught.value, picture)
    assert told.startswith(says) and str(tmp_path) not in told and "\n" not in told


def test_fields_are_read_as_they_come():
    assert Options.read(2, 5, None, "", "keep", False) == Options(2, 5, None, None, "keep", False)
    assert Options.read(1.0, "", 4.0, 2, "auto", True) == Options(steps=4, guidance=2.0)
    for field, value, says in (
        ("samples", None, "samples: give 1 to 4"),
        ("samples", 5, "samples: give 1 to 4"),
        ("seed", -1, "seed: give a whole number from 0"),
        ("seed", 2**31, "seed: give a whole number from 0"),
        ("seed", 1.5, "seed: give a whole number, not 1.5"),
        ("seed", "abc", "seed: give a number"),
        ("seed", [1], "seed: give a number"),
        ("steps", 0, "steps: give a whole number from 1 to 50"),
        ("guidance", float("nan"), "guidance: give a finite number"),
        ("guidance", 11, "guidance: give 0 to 10"),
        ("background", "../x", "background: give auto, keep or rembg"),
    ):
        fields = dataclasses.asdict(Options()) | {field: value}
        with pytest.raises(ValueError, match=re.escape(says)):
            Options.read(**fields)


def test_names_for_files():
    assert making.safe_stem(Path("a/../ö ven (1).png")) == "ven_1"
    assert making.safe_stem(Path("..png")) == "object"


def test_examples_are_there_and_a_wheel_takes_them_along():
    import tomllib

    pictures = example_pictures()
    assert OVEN in pictures and pictures[-1] == ROOT / "examples" / "photograph.jpg"
    built = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wheel = built["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert ROOT / "examples" / "layouts" / "chest.json" in example_tables()
    for picture in [*pictures, *example_tables()]:
        place = picture.relative_to(ROOT).as_posix()
        assert any(place.startswith(taken) for taken in wheel["only-include"]), place
    assert wheel["sources"]["examples"] == "uniart_jax/examples"


def test_an_installed_package_has_its_examples_inside(tmp_path, monkeypatch):
    for name in ("images/a.png", "images/a.txt", "photograph.jpg", "layouts/a.json"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    monkeypatch.setattr(examples, "_INSIDE", tmp_path)
    assert example_pictures() == [tmp_path / "images" / "a.png", tmp_path / "photograph.jpg"]
    assert example_tables() == [tmp_path / "layouts" / "a.json"]

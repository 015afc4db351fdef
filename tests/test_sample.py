"""sample.py end to end with the shipped weights, and what it says about bad input."""

import contextlib
import io
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yourdfpy
from PIL import Image

from uniart_jax import cli
from uniart_jax.cli import exit_on_error
from uniart_jax.cli import sample as sample_command
from uniart_jax.cli.asset_options import AssetOptions
from uniart_jax.config import SampleConfig
from uniart_jax.data import background
from uniart_jax.data.images import read_image
from uniart_jax.models.checkpoint import PRETRAINED
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.pipeline import Sample

URDF_ALONE = AssetOptions(formats=("urdf",))

ROOT = Path(__file__).parent.parent
shipped = pytest.mark.skipif(
    not (PRETRAINED / "nano" / "config.json").is_file(),
    reason="no shipped weights here; make them with: python train.py --config configs/nano.py",
)
pytestmark = pytest.mark.usefixtures("small_pictures")
EXAMPLE = ROOT / "examples" / "images" / "cabinet.png"


def sample(*arguments, expect=0):
    command = [sys.executable, str(ROOT / "sample.py"), *map(str, arguments)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert result.returncode == expect, result.stderr[-2000:]
    return result


@pytest.fixture
def refused(monkeypatch, capsys):
    """The same in this process, of what must end with code 2: its stderr."""

    def call(*arguments) -> str:
        monkeypatch.setattr(sys, "argv", ["sample.py", *map(str, arguments)])
        with pytest.raises(SystemExit) as done:
            cli.sample_main()
        assert done.value.code == 2
        return capsys.readouterr().err

    return call


@pytest.fixture(scope="module")
def asset(small_pictures, tmp_path_factory):
    """Made in this process, with small pictures; the program itself: nightly."""
    out = tmp_path_factory.mktemp("sample") / "asset"
    arguments = ["sample.py", str(EXAMPLE), "--out", str(out), "--steps", "4"]
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stderr(io.StringIO()) as said:
        patch.setattr(sys, "argv", arguments)
        with pytest.raises(SystemExit) as done:
            cli.sample_main()
    assert not done.value.code, said.getvalue()[-2000:]
    assert "network evaluations: structure 4, latent 4" in said.getvalue()
    return out


@shipped
def test_everything_is_there(asset):
    for name in ("object.urdf", "object.glb", "meshes", "preview.png", "motion.gif", "report.json"):
        assert (asset / name).exists(), name
    assert Image.open(asset / "preview.png").size[0] > 96
    assert Image.open(asset / "motion.gif").n_frames > 8


@shipped
def test_report_matches_the_urdf(asset):
    report = json.loads((asset / "report.json").read_text())
    robot = yourdfpy.URDF.load(str(asset / "object.urdf"))
    assert {p["name"] for p in report["parts"]} <= set(robot.link_map)
    assert all(p["watertight"] and p["mass"] > 0 for p in report["parts"])
    assert sum(p["parent"] is None for p in report["parts"]) == 1
    assert report["seed"] == 0 and report["checkpoint"] == "nano" and "spread" not in report
    how = {"solver": "euler", "adaptive": False, "steps": 4, "guidance": 1.0, "evaluations": 4}
    assert report["sampling"] == {"structure": how, "latent": how}
    for path in sorted((asset / "meshes").glob("*.obj")):
        mesh = trimesh.load(path, force="mesh", process=True)
        mesh.merge_vertices(merge_tex=True, merge_norm=True)
        assert len(mesh.faces) > 0


@shipped
def test_mujoco_opens_it(asset):
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(asset / "object.urdf"))
    data = mujoco.MjData(model)
    for _ in range(10):
        mujoco.mj_step(model, data)
    assert np.isfinite(data.qpos).all()


@pytest.mark.slow
@shipped
def test_same_seed_same_object(asset, tmp_path):
    said = sample(EXAMPLE, "--out", tmp_path / "again", "--steps", 4).stderr
    assert "network evaluations: structure 4, latent 4" in said
    assert Image.open(tmp_path / "again" / "preview.png").size[0] > 400
    assert (tmp_path / "again" / "object.urdf").read_bytes() == (asset / "object.urdf").read_bytes()


@shipped
def test_a_full_folder_is_left_alone(asset, refused):
    before = sorted(p.name for p in asset.iterdir())
    said = refused(EXAMPLE, "--out", asset)
    assert "not empty" in said and "--overwrite" in said
    assert sorted(p.name for p in asset.iterdir()) == before


@pytest.mark.parametrize(
    ("write", "says"),
    [
        (lambda p: None, "no such file"),
        (lambda p: p.write_bytes(b""), "empty"),
        (lambda p: p.write_bytes(b"hello"), "not an image"),
        (lambda p: Image.new("RGB", (1, 1)).save(p), "too small"),
        (lambda p: Image.new("RGBA", (64, 64)).save(p), "transparent"),
    ],
)
def test_bad_images_are_one_line(tmp_path, refused, write, says):
    image = tmp_path / "image.png"
    write(image)
    said = refused(image, "--out", tmp_path / "out")
    assert says in said
    assert len(said.strip().splitlines()) == 1 and said.startswith("error: ")
    assert not (tmp_path / "out").exists()


def test_a_mistake_is_one_line_of_the_program(tmp_path):
    """The program itself: nothing that it loads says anything more."""
    said = sample(tmp_path / "absent.png", "--out", tmp_path / "out", expect=2).stderr
    assert "no such file" in said and len(said.strip().splitlines()) == 1
    assert said.startswith("error: ") and not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--adaptive", "--steps", 4), "--adaptive chooses its own steps"),
        (("--tolerance", 0.1), "--tolerance belongs to --adaptive"),
        (("--adaptive", "--tolerance", 0), "--tolerance must be in 0.0001..1"),
        (("--adaptive", "--tolerance", "nan"), "--tolerance must be in 0.0001..1"),
        (("--solver", "rk4"), "rk4"),
        (("--num-samples", 0), "--num-samples"),
        (("--friction", "hinge_1_joint=-2"), "give a finite number of 0 or more"),
        (("--damping", "a=1", "a=2"), "joint 'a' is given twice"),
        (("--collision-budget", 0), "give 1 or more convex shapes"),
        (("--layout", "absent.json"), "layout 'absent.json': no such file"),
        (("--layout", "absent.json", "--no-follow"), "goes without --no-follow"),
        (("--layout", str(ROOT / "README.md")), "not valid JSON"),
        (("--ask", "llm", "--no-follow"), "--ask goes without --layout and --no-follow"),
        (("--ask", "llm '"), "is no command"),
    ],
)
def test_nonsense_options(tmp_path, refused, options, says):
    said = refused(EXAMPLE, "--out", tmp_path / "out", *options)
    assert says in said and not (tmp_path / "out").exists()


def test_a_missing_rembg_is_told_of_the_file_before_a_model_is_loaded(
    tmp_path, refused, monkeypatch
):
    monkeypatch.setattr(background, "_installed", lambda *modules: False)
    said = refused(EXAMPLE, "--out", tmp_path / "out", "--background", "rembg")
    expected = f"error: image '{EXAMPLE}': --background rembg needs rembg: pip install"
    assert said.startswith(expected) and len(said.splitlines()) == 1
    assert not (tmp_path / "out").exists()


@shipped
@pytest.mark.slow
def test_several_adaptive_samples_say_how_much_they_agree(tmp_path):
    options = ("--num-samples", 3, "--solver", "heun", "--adaptive", "--tolerance", 0.1)
    sample(EXAMPLE, "--out", tmp_path / "out", *options, "--no-check")
    for i in range(3):
        report = json.loads(
            (tmp_path / "out" / "cabinet" / f"sample-{i}" / "report.json").read_text()
        )
        assert report["seed"] == i and report["spread"]["samples"] == 3
        names = {p["name"] for p in report["parts"] if p["parent"] is not None}
        assert set(report["spread"]["joints"]) == names
        assert all(1 <= j["matched"] <= 3 for j in report["spread"]["joints"].values())
        for flow in ("structure", "latent"):
            how = report["sampling"][flow]
            assert how["solver"] == "heun" and how["adaptive"] and how["tolerance"] == 0.1
            assert how["evaluations"] >= 3 and "steps" not in how


@shipped
@pytest.mark.slow
@pytest.mark.parametrize("views", [2, 3])
def test_views_make_one_object(tmp_path, views):
    sample(*[EXAMPLE] * views, "--out", tmp_path / "out", "--multi-view", "--no-check")
    assert (tmp_path / "out" / "object.urdf").is_file()


class Finder:
    """A pipeline that finds an object for some seeds only."""

    def __init__(self, seeds):
        self.seeds, self.asked = seeds, set()

    def options(self):
        return SampleConfig(steps=1), SampleConfig(steps=1)

    def sample(self, image, *, seed, steps, **_):
        self.asked.add(steps)
        if seed not in self.seeds:
            raise ValueError(f"cabinet: the model found no object ({seed})")
        parts = [Part("body", trimesh.creation.box((0.4, 0.4, 0.4)), -1)]
        flow = SampleConfig(adaptive=True, tolerance=0.02)
        options, evaluations = {"structure": flow, "latent": flow}, {"structure": 4, "latent": 9}
        return Sample(ArticulatedObject(parts), options, evaluations, {"structure": 0, "latent": 2})


@pytest.mark.slow
@pytest.mark.parametrize(("seeds", "code"), [((0, 2), 1), ((1,), 1), ((0, 1, 2), 0), ((), 2)])
def test_a_sample_that_fails_does_not_cost_the_others(tmp_path, monkeypatch, capsys, seeds, code):
    finder = Finder(seeds)
    monkeypatch.setattr("uniart_jax.pipeline.load", lambda checkpoint: finder)
    found = exit_on_error(
        lambda: sample_command(
            (EXAMPLE,), tmp_path, num_samples=3, check=False, refine=False, output=URDF_ALONE
        )
    )
    assert found == code and finder.asked == {4}  # as one step would make them alike
    made = {i for i in range(3) if (tmp_path / f"cabinet/sample-{i}/object.urdf").is_file()}
    assert made == set(seeds)
    for i in seeds:
        report = json.loads((tmp_path / f"cabinet/sample-{i}/report.json").read_text())
        assert report["seed"] == i
        assert [report["sampling"][flow]["forced"] for flow in ("structure", "latent")] == [0, 2]
        assert (report["spread"]["samples"] if len(seeds) > 1 else 1) == len(seeds)
        assert ("spread" in report) == (len(seeds) > 1)
    printed = capsys.readouterr()
    said = (
        "latent: 2 adaptive steps could not keep the tolerance of 0.02; give a larger --tolerance"
    )
    assert (" ".join((printed.out + printed.err).split())).count(said) == len(seeds)
    errors = [line for line in printed.err.splitlines() if line.startswith("error: ")]
    if code == 1:
        assert errors == [
            f"error: cabinet.png, seed {i}: cabinet: the model found no object ({i})"
            for i in range(3)
            if i not in seeds
        ]
    elif code == 2:
        assert errors == ["error: cabinet: the model found no object (0)"]


class Looker(Finder):
    """Remembers the pictures that it is given, by their mean, and fails as a bug would where it is
    told to."""

    def __init__(self, fails=()):
        super().__init__(range(9))
        self.shown, self.fails = [], fails

    def sample(self, image, *, seed, **options):
        self.shown.append(([float(read_image(path).mean()) for path in image or ()], seed))
        if len(self.shown) in self.fails:
            raise IndexError("list index out of range")
        return super().sample(image, seed=seed, **options)


@pytest.fixture
def two_images(tmp_path):
    paths = [tmp_path / f"{name}.png" for name in ("dark", "light")]
    for path, value in zip(paths, (60, 200), strict=True):
        picture = np.zeros((40, 40, 4), np.uint8)
        picture[5:35, 5:35] = value, value, value, 255
        Image.fromarray(picture).save(path)
    return tuple(paths)


@pytest.mark.parametrize("multi_view", [False, True])
def test_each_image_is_an_object_of_its_own_unless_they_are_views(
    tmp_path, monkeypatch, two_images, multi_view
):
    looker, out = Looker(), tmp_path / "out"
    monkeypatch.setattr("uniart_jax.pipeline.load", lambda checkpoint: looker)
    sample_command(
        two_images, out, seed=4, multi_view=multi_view, check=False, refine=False, output=URDF_ALONE
    )
    means = [means for means, _ in looker.shown]
    assert [seed for _, seed in looker.shown] == [4] * len(looker.shown)
    if multi_view:
        assert len(means) == 1 and means[0][0] < means[0][1] and (out / "object.urdf").is_file()
    else:
        assert [len(m) for m in means] == [1, 1] and means[0][0] < means[1][0]
        assert all((out / name / "sample-0/object.urdf").is_file() for name in ("dark", "light"))


def test_layouts_go_without_images(tmp_path, monkeypatch, two_images):
    looker, out = Looker(), tmp_path / "out"
    monkeypatch.setattr("uniart_jax.pipeline.load", lambda checkpoint: looker)
    desk = ROOT / "examples/layouts/desk.json"
    off = {"check": False, "refine": False, "output": URDF_ALONE}
    sample_command((desk, two_images[1]), out, **off)
    assert looker.shown[0] == ([], 0) and len(looker.shown[1][0]) == 1
    assert all((out / name / "sample-0/object.urdf").is_file() for name in ("desk", "light"))


def test_a_model_is_asked_once_an_image_and_its_layouts_are_followed(
    tmp_path, monkeypatch, two_images, capsys
):
    class Asked(Looker):
        def ask_layout(self, image, ask, background, say):
            if image == two_images[0]:
                say("layout: no")
            answers.append(ask("prompt", image).strip())
            return answers[-1]

        def sample(self, image, *, layout, **options):
            followed.append(layout)
            return super().sample(image, **options)

    answers, followed = [], []
    monkeypatch.setattr("uniart_jax.pipeline.load", lambda checkpoint: Asked())
    off = {"check": False, "refine": False, "output": URDF_ALONE}
    sample_command(two_images, tmp_path / "out", ask="echo {image}", num_samples=2, **off)
    assert answers == [str(path) for path in two_images]
    assert followed == [answers[0]] * 2 + [answers[1]] * 2
    said = capsys.readouterr().err
    assert (
        "light.png: asking 'echo {image}'" in said and "dark.png: asking again: layout: no" in said
    )
    with pytest.raises(ValueError, match="ask: 'false' ended with 1"):
        sample_command(two_images, tmp_path / "two", ask="false", **off)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ((), "give at least one image file, or a layout's JSON"),
        (("absent.json",), "layout 'absent.json': no such file"),
        ((ROOT / "examples/layouts/desk.json", "--no-follow"), "goes without --multi-view"),
        ((ROOT / "examples/layouts/desk.json", "--ask", "llm"), "--no-follow and --ask"),
        ((ROOT / "examples/layouts/desk.json", EXAMPLE, "--multi-view"), "goes without"),
    ],
)
def test_layouts_that_cannot_be_are_told(tmp_path, refused, given, says):
    assert says in refused(*given, "--out", tmp_path / "out") and not (tmp_path / "out").exists()


@pytest.mark.parametrize("beside", [True, False])
def test_a_folder_that_holds_the_layout_is_not_replaced(tmp_path, refused, beside):
    own = tmp_path / "own.json"
    own.write_text((ROOT / "examples/layouts/desk.json").read_text().replace('"m"', '"object"'))
    (tmp_path / "report.json").write_text("{}")  # an asset's folder
    given = (EXAMPLE, "--layout", own) if beside else (own,)
    assert "own.json" in refused(*given, "--out", tmp_path, "--overwrite")
    assert own.is_file()


def test_a_bug_in_one_sample_does_not_cost_the_others(tmp_path, monkeypatch, two_images, capsys):
    monkeypatch.setattr("uniart_jax.pipeline.load", lambda checkpoint: Looker(fails=(1,)))
    out = tmp_path / "out"
    assert sample_command(two_images, out, check=False, refine=False, output=URDF_ALONE) == 1
    assert (out / "light/sample-0/object.urdf").is_file() and not (out / "dark").exists()
    assert "error: dark.png, seed 0: IndexError: list index out of range" in capsys.readouterr().err


@shipped
@pytest.mark.slow
def test_an_edited_layout_is_followed(tmp_path):
    """A hinge made a slider, by hand in the file, slides in the asset."""
    import uniart_jax as ua

    data = json.loads(ua.load("nano").layout(EXAMPLE).to_json())
    row = next(p for p in data["parts"] if p["joint"]["type"] == "revolute")
    row["joint"] |= {"angle": [0, 0], "travel": [0, 0.2], "direction": [-1, 0, 0]}
    (tmp_path / "edited.json").write_text(json.dumps(data))
    out = tmp_path / "out"
    sample(EXAMPLE, "--out", out, "--layout", tmp_path / "edited.json", "--no-refine", "--no-check")
    kinds = [p["type"] for p in json.loads((out / "report.json").read_text())["parts"]]
    wanted = [p["joint"]["type"] for p in data["parts"] if p["parent"] is not None]
    assert kinds.count("prismatic") == wanted.count("prismatic") + 1


def test_unknown_checkpoint(tmp_path, refused):
    said = refused(EXAMPLE, "--out", tmp_path / "out", "--checkpoint", "absent")
    assert "neither a folder nor a shipped model" in said and not (tmp_path / "out").exists()


@shipped
def test_truncated_checkpoint(tmp_path, refused):
    import shutil

    folder = tmp_path / "broken"
    shutil.copytree(PRETRAINED / "nano", folder)
    path = folder / "latent_flow.safetensors"
    path.write_bytes(path.read_bytes()[:1000])
    said = refused(EXAMPLE, "--out", tmp_path / "out", "--checkpoint", folder)
    assert "truncated" in said and not (tmp_path / "out").exists()

"""The tools beside the package that write something."""

import importlib
import runpy
import sys
from pathlib import Path
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from PIL import Image
from safetensors.numpy import load_file

from uniart_jax.cli import load_config
from uniart_jax.evaluation.procedural import held_out_for
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.checkpoint_files import write_config, write_network
from uniart_jax.models.network import build

ROOT = Path(__file__).parent.parent


def test_every_mutant_has_its_line_and_its_test():
    mutants = runpy.run_path(str(ROOT / "tools/mutant_table.py"))["MUTANTS"]
    for mutant in mutants:
        assert (ROOT / mutant.file).read_text().count(mutant.text) == 1, mutant
        file, name = mutant.test.split("::")
        assert f"def {name.split('[')[0]}(" in (ROOT / file).read_text(), mutant
    assert len(set(mutants)) == len(mutants) > 0


def test_a_mutant_that_no_test_fails_survives(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "tools")
    tool = runpy.run_path(str(ROOT / "tools/mutants.py"))
    (tmp_path / "half.py").write_text("def half(x):\n    return x / 2\n")
    (tmp_path / "test_half.py").write_text(
        "from half import half\n\n\ndef test_half():\n    assert half(4) == 2\n\n\ndef "
        "test_zero():\n    assert half(0) == 0\n"
    )
    for test, alive in (("test_half", False), ("test_zero", True)):
        mutant = tool["Mutant"]("half.py", "x / 2", "x / 3", f"test_half.py::{test}")
        assert tool["survives"](tmp_path, mutant) == alive
    assert "x / 2" in (tmp_path / "half.py").read_text()
    with pytest.raises(ValueError, match="there 0 times"):
        tool["survives"](tmp_path, mutant._replace(text="x / 4"))
    with pytest.raises(RuntimeError, match="pytest ended with 4"):
        tool["survives"](tmp_path, mutant._replace(test="test_half.py::test_none"))


@pytest.mark.usefixtures("small_pictures")
def test_joints_are_counted_in_files_objects_and_files_written_again(tmp_path, monkeypatch, capsys):
    """A tap whose lever turns and lifts beside a button of 2 mm; a hinge beside a ball."""
    box = '<geom type="box" size=".1 .1 .1"/>'
    turn, lift, press, ball = (
        f'<joint type="{kind}" axis="0 0 1" {limits}/>'
        for kind, limits in (
            ("hinge", 'range="0 1" limited="true"'),
            ("slide", 'range="0 .05" limited="true"'),
            ("slide", 'range="0 .002" limited="true"'),
            ("ball", ""),
        )
    )
    texts = {}
    for name, levers in (("tap", (turn + lift, press)), ("lamp", (turn, ball))):
        bodies = "".join(
            f'<body pos="{i}.3 0 0">{box}{joints}</body>' for i, joints in enumerate(levers)
        )
        texts[name] = (
            '<mujoco><compiler angle="radian"/><worldbody>'
            f'<body name="base">{box}{bodies}</body></worldbody></mujoco>'
        )
    for name, text in texts.items():
        (tmp_path / f"{name}.xml").write_text(text)
    monkeypatch.setattr(sys, "argv", ["x", str(tmp_path)])
    runpy.run_path(str(ROOT / "tools/count_joints.py"), run_name="__main__")
    lamp, tap, told = capsys.readouterr().out.splitlines()
    assert lamp.startswith("lamp.xml: 1 joints, 0 read, 0 written (")
    assert tap == "tap.xml: 3 joints, 3 read, 3 written"
    assert told == (
        "2 files, 2 of them with joints or not read, 1 of these read and written; in 1 no joint is "
        "lost; 4 joints, 3 read, 3 written"
    )


def test_weights_are_averaged_by_the_share_of_the_second(tmp_path, monkeypatch, capsys):
    config = load_config(ROOT / "configs/debug.py")
    abstract = build("structure_vae", config.model).abstract()
    for name, value in (("first", 1.0), ("second", 3.0), ("out", 0.0)):
        write_config(tmp_path / name, config)
        filled = jax.tree.map(lambda a, value=value: np.full(a.shape, value, np.float32), abstract)
        write_network(tmp_path / name, "structure_vae", filled)
    folders = [str(tmp_path / name) for name in ("first", "second")]
    command = ["x", "structure_vae", *folders, "--share", "0.75", "--out", str(tmp_path / "out")]
    monkeypatch.setattr(sys, "argv", command)
    runpy.run_path(str(ROOT / "tools/average_weights.py"), run_name="__main__")
    stored = load_file(tmp_path / "out/structure_vae.safetensors")
    assert {float(v) for values in stored.values() for v in np.unique(values)} == {2.5}
    assert "structure_vae.safetensors" in capsys.readouterr().out
    monkeypatch.setattr(sys, "argv", [*command[:1], "nothing", *command[2:]])
    with pytest.raises(SystemExit, match="2"):
        runpy.run_path(str(ROOT / "tools/average_weights.py"), run_name="__main__")


@pytest.mark.slow
def test_the_gallery_shows_input_rest_and_open_and_counts_failures(tmp_path, monkeypatch, capsys):
    """A pipeline that gives the truth, and finds nothing in every other picture."""
    tool = runpy.run_path(str(ROOT / "tools/gallery.py"), run_name="tool")
    config = load_config(ROOT / "configs/debug.py")
    asked = []

    class Truth:
        def __init__(self):
            self.config = config

        def sample(self, image, *, seed, name, layout):
            asked.append((None if image is None else image.shape, seed, name))
            if seed % 2:
                raise ValueError("the model found no object in the image")
            obj = layout.to_object() if image is None else held_out_for(config.model, seed).obj
            return SimpleNamespace(obj=obj, picture=None, cut=(np.full((9, 9, 4), 255, np.uint8),))

    space = tool["main"].__globals__
    monkeypatch.setitem(space, "load", lambda checkpoint: Truth())
    monkeypatch.setitem(space, "enable_compilation_cache", lambda: None)
    monkeypatch.setattr(sys, "argv", ["x", str(tmp_path), "--count", "2"])
    tool["main"]()
    said = capsys.readouterr().out
    assert "0000-storage_furniture: stands" in said and "no object in the image" in said
    assert "of 2: load and stand 1" in said
    assert asked[0] == ((256, 256, 4), 0, "0000-storage_furniture")
    with Image.open(tmp_path / "gallery.jpg") as sheet:
        assert sheet.width == 3 * 3 * 176
        row = np.asarray(sheet)[:176, : 4 * 176].astype(int)
    for tile in np.split(row, 4, axis=1):  # each shows something, that of the failure its picture
        assert np.ptp(tile[20:-20, 20:-20].mean(-1)) > 60
    tool["main"]()  # what is there is kept
    assert len(asked) == 3
    files = [str(ROOT / f"examples/layouts/{name}.json") for name in ("chest", "desk")]
    monkeypatch.setattr(sys, "argv", ["x", str(tmp_path / "layouts"), "--layouts", *files])
    tool["main"]()
    assert asked[3:] == [(None, 0, "chest"), (None, 1, "desk")]
    assert "chest: stands" in capsys.readouterr().out
    assert (tmp_path / "layouts/chest/object.urdf").is_file()


def test_views_look_into_a_panorama(tmp_path, monkeypatch, capsys):
    """Its floor is red, its sky blue: views show the floor below the sky, and nothing else."""
    cv2 = pytest.importorskip(
        "cv2", reason="panoramas are read with OpenCV: pip install '.[photo]'"
    )
    light = np.zeros((64, 128, 3), np.float32)
    light[:32, :, 0], light[32:, :, 2] = 4.0, 2.0  # OpenCV's order is blue, green, red
    (tmp_path / "in").mkdir()
    cv2.imwrite(str(tmp_path / "in/room.hdr"), light)
    command = ["x", str(tmp_path / "in"), "--out", str(tmp_path / "out"), "--views", "6"]
    runs = []
    for _ in range(2):  # the same views again
        monkeypatch.setattr(sys, "argv", [*command, "--size", "48"])
        runpy.run_path(str(ROOT / "tools/panorama_views.py"), run_name="__main__")
        runs.append([np.asarray(Image.open(p)) for p in sorted((tmp_path / "out").iterdir())])
    first, pictures = runs
    assert len(pictures) == 6 and capsys.readouterr().out == "room\nroom\n"
    both = 0
    for picture, before in zip(pictures, first, strict=True):
        np.testing.assert_array_equal(picture, before)
        red = picture[..., 0].astype(int) > picture[..., 2]
        assert (np.diff(red.mean(1)) > -0.2).all()  # from the sky down to the floor
        assert picture.max() > 100
        both += 0.05 < red.mean() < 0.95
    assert both >= 3
    monkeypatch.setattr(sys, "argv", ["x", str(tmp_path), "--out", str(tmp_path / "none")])
    with pytest.raises(SystemExit, match="2"):
        runpy.run_path(str(ROOT / "tools/panorama_views.py"), run_name="__main__")
    assert "no .hdr files" in capsys.readouterr().err and not (tmp_path / "none").exists()


def test_what_modules_cost_is_told_the_dearest_first(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    import suite_seconds

    cheap, dear = suite_seconds.Cost(3, 0.25), suite_seconds.Cost(1, 12.5, 40, 2, 700.0)
    _, first, second, total = suite_seconds.table({"a.py": cheap, "b.py": dear}).splitlines()
    assert first.split() == ["1", "12.5", "40", "2", "700", "b.py"]
    assert second.split() == ["3", "0.2", "0", "0", "0", "a.py"] and total.startswith("13 CPU")


def test_networks_are_shipped_whole_and_within_the_limit(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "tools")
    tool = importlib.import_module("ship_weights")
    config = load_config(ROOT / "configs/debug.py")
    abstract = build("structure_vae", config.model).abstract()
    source, shipped = Checkpoint(tmp_path / "source"), tmp_path / "shipped"
    for folder, value in ((source.folder, 1.0), (shipped, 3.0)):
        write_config(folder, config)
        filled = jax.tree.map(lambda a, value=value: np.full(a.shape, value, np.float32), abstract)
        write_network(folder, "structure_vae", filled)
    name = next(iter(load_file(shipped / "structure_vae.safetensors")))
    before = (shipped / "structure_vae.safetensors").read_bytes()
    monkeypatch.setattr(tool, "MOST", 100)
    with pytest.raises(ValueError, match="bytes in all; at most 100 are shipped"):
        tool.ship(source, ["structure_vae"], shipped)
    assert (shipped / "structure_vae.safetensors").read_bytes() == before
    monkeypatch.setattr(tool, "MOST", 10**9)
    size = tool.ship(source, ["structure_vae"], shipped)
    assert size == sum(path.stat().st_size for path in shipped.iterdir())
    assert (load_file(shipped / "structure_vae.safetensors")[name] == 1).all()
    with pytest.raises(FileNotFoundError):
        tool.ship(source, ["latent_flow"], shipped)

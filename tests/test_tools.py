"""The tools beside the package that write something."""

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
from uniart_jax.models.network import build
from uniart_jax.training.export import export_network, write_config

ROOT = Path(__file__).parent.parent


def test_every_mutant_has_its_line_and_its_test():
    mutants = runpy.run_path(str(ROOT / "tools/mutants.py"))["MUTANTS"]
    for mutant in mutants:
        assert (ROOT / mutant.file).read_text().count(mutant.text) == 1, mutant
        file, name = mutant.test.split("::")
        assert f"def {name.split('[')[0]}(" in (ROOT / file).read_text(), mutant
    assert len(set(mutants)) == len(mutants) > 0


def test_a_mutant_that_no_test_fails_survives(tmp_path):
    tool = runpy.run_path(str(ROOT / "tools/mutants.py"))
    (tmp_path / "half.py").write_text("def half(x):\n    return x / 2\n")
    (tmp_path / "test_half.py").write_text("from half import half\n\n\ndef test_half():\n    assert half(4) == 2\n\n\ndef test_zero():\n    assert half(0) == 0\n")  # fmt: skip
    for test, alive in (("test_half", False), ("test_zero", True)):
        mutant = tool["Mutant"]("half.py", "x / 2", "x / 3", f"test_half.py::{test}")
        assert tool["survives"](tmp_path, mutant) == alive
    assert "x / 2" in (tmp_path / "half.py").read_text()
    with pytest.raises(ValueError, match="there 0 times"):
        tool["survives"](tmp_path, mutant._replace(text="x / 4"))
    with pytest.raises(RuntimeError, match="pytest ended with 4"):
        tool["survives"](tmp_path, mutant._replace(test="test_half.py::test_none"))


def test_weights_are_averaged_by_the_share_of_the_second(tmp_path, monkeypatch, capsys):
    config = load_config(ROOT / "configs/debug.py")
    abstract = build("structure_vae", config.model).abstract()
    for name, value in (("first", 1.0), ("second", 3.0), ("out", 0.0)):
        write_config(tmp_path / name, config)
        filled = jax.tree.map(lambda a, value=value: np.full(a.shape, value, np.float32), abstract)
        export_network(tmp_path / name, "structure_vae", filled)
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


def test_the_gallery_shows_input_rest_and_open_and_counts_failures(tmp_path, monkeypatch, capsys):
    """A pipeline that gives the truth, and finds nothing in every other picture."""
    tool = runpy.run_path(str(ROOT / "tools/gallery.py"), run_name="tool")
    config = load_config(ROOT / "configs/debug.py")
    asked = []

    class Truth:
        def __init__(self):
            self.config = config

        def sample(self, image, *, seed, name):
            asked.append((image.shape, seed, name))
            if seed % 2:
                raise ValueError("the model found no object in the image")
            obj = held_out_for(config.model, seed).obj
            return SimpleNamespace(obj=obj, picture=None)

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
        row = np.asarray(sheet)[:176, : 3 * 176].astype(int)
    for tile in np.split(row, 3, axis=1):  # each shows something
        assert np.ptp(tile[20:-20, 20:-20].mean(-1)) > 60
    tool["main"]()  # what is there is kept
    assert len(asked) == 3

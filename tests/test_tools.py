"""The tools beside the package that write something."""

import runpy
import sys
from pathlib import Path

import jax
import numpy as np
import pytest
from safetensors.numpy import load_file

from uniart_jax.cli import load_config
from uniart_jax.models.network import build
from uniart_jax.training.export import export_network, write_config

ROOT = Path(__file__).parent.parent


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

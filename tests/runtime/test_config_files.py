"""Configs by name, from any folder; the wheel holds what configs/ holds."""

import importlib
import sys
import tomllib
from pathlib import Path

import pytest

import uniart_jax as ua
from uniart_jax.cli import exit_on_error, load_config
from uniart_jax.cli.train import check_fields, train
from uniart_jax.experiments.design import find_experiment, load_experiment
from uniart_jax.runtime import config_files

ROOT = Path(__file__).parent.parent.parent


def test_a_config_by_its_name_from_any_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    named = ua.config("nano")
    assert named == load_config(ROOT / "configs" / "nano.py") and named.name == "nano"
    assert ua.config("debug") != named


def test_the_module_is_what_is_called(monkeypatch):
    """Before and after its import, which makes it an attribute of the package."""
    monkeypatch.delattr(ua, "config", raising=False)
    assert ua.config is importlib.import_module("uniart_jax.config")
    assert ua.config.Config is type(ua.config("debug"))


def test_a_file_in_the_way_wins_and_mistakes_are_one_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    source = (ROOT / "configs" / "debug.py").read_text()
    (tmp_path / "mine.py").write_text(source.replace('name="debug"', 'name="mine"'))
    assert ua.config("mine.py").name == "mine"
    with pytest.raises(
        FileNotFoundError, match=r"config .mine.: no such file; give a \.py file, or a name of"
    ):
        ua.config("mine")
    with pytest.raises(FileNotFoundError, match="config 'elsewhere/nano'"):
        ua.config("elsewhere/nano")
    (tmp_path / "mine.py").write_text("config = lambda: 3")
    with pytest.raises(ValueError, match=r"config 'mine.py': it must define config\(\)"):
        ua.config("mine.py")


def test_training_takes_a_name(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stopped:
        train(["--config", "nano", "--help"], prog="uniart train")
    said = capsys.readouterr().out
    assert stopped.value.code == 0 and "(default: nano)" in said and "--latent-flow.steps" in said
    assert exit_on_error(lambda: train(["--config", "absent"])) == 2
    assert "a name of these: debug, nano" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("option", "said"),
    [
        ("--structure_vae.lr", "structure_vae has no 'lr'; it has steps, batch_size, "),
        ("--structure-vea.steps=3", "the command has no 'structure_vea'; .* structure_vae, .*seed"),
        ("--workdri", "the command has no 'workdri'; it has config, stage, workdir, "),
        ("--data.no-records", "data has no 'no_records'"),
        ("--seed.x", "seed has no 'x'; it has no fields"),
    ],
)
def test_a_field_that_there_is_not_is_one_line(option, said):
    with pytest.raises(ValueError, match=f"^{option.partition('=')[0]}: {said}"):
        train(["--config", "debug", option, "3"])
    fields = ("--latent-flow.batch_size", "8", "--no-quick-compile", "--data.no-mirror", "--seed=3")
    check_fields(fields)


def test_experiments_from_any_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert find_experiment("main") == ROOT / "configs" / "experiments" / "main.py"
    assert "uniart" in load_experiment("main").arms


def test_an_installed_package_finds_its_own_copy(tmp_path, monkeypatch):
    """As in a wheel: the files are inside the package, nothing is beside it."""
    built = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wheel = built["tool"]["hatch"]["build"]["targets"]["wheel"]
    inside = wheel["sources"]["configs"]
    taken = {"uniart_jax", "configs", "examples/images", "examples/layouts"}
    taken |= {"examples/photograph.jpg"}
    assert set(wheel["only-include"]) == taken
    package = tmp_path / "uniart_jax"
    (tmp_path / inside).mkdir(parents=True)
    (package / "runtime").mkdir()
    (package / "runtime" / "config_files.py").write_text(Path(config_files.__file__).read_text())
    spec = importlib.util.spec_from_file_location(
        "installed", package / "runtime" / "config_files.py"
    )
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "installed", module)
    spec.loader.exec_module(module)
    assert tmp_path / inside == module.CONFIGS
    assert config_files.CONFIGS == ROOT / "configs"

"""``uniart evaluate PRED REF``: what a user types, reads and gets as exit code."""

from __future__ import annotations

import json
from inspect import signature

import numpy as np
import pytest

from uniart_jax.cli.evaluation import USES, evaluate
from uniart_jax.evaluation import compare as frame

pytestmark = pytest.mark.usefixtures("small_pictures")


@pytest.fixture(scope="module")
def folders(tmp_path_factory, chest):
    """Three references; a right prediction, a mirrored one, none; tests only read them."""
    root = tmp_path_factory.mktemp("folders")
    for name in ("a", "b", "c"):
        chest(1.4).save(root / "ref" / name, formats=(), motion=False)
    chest(1.4).save(root / "physics" / "a", formats=(), motion=False)
    chest(-1.4).save(root / "physics" / "b", formats=(), motion=False)
    chest(1.4).save(root / "physics" / "elsewhere", formats=(), motion=False)
    return root


def test_a_folder_of_predictions(run, folders, tmp_path, monkeypatch):
    monkeypatch.chdir(folders)
    monkeypatch.setattr(frame, "write_report", lambda *given: None)  # pictures take seconds
    options = ("--only", "articulation", "pose_error", "--processes", "1")
    code, out, err = run("evaluate", "./physics", "ref", "--out", tmp_path / "out", *options)
    assert code == 0 and "pose error" in out and "1 of 3 objects have failures" in out
    assert "1 without a reference are left out: elsewhere" in err
    content = json.loads((tmp_path / "out" / "metrics.json").read_text())
    objects = content["methods"]["physics"]["objects"]
    assert [objects[name]["wrong_way"] for name in "abc"] == [0, 1, 1]
    assert objects["a"]["pose_error"] < 1e-3 < objects["b"]["pose_error"]
    assert content["methods"]["physics"]["confusion"]["revolute"] == {"missing": 1, "revolute": 2}
    assert content["settings"]["figures"] == ["articulation", "pose_error"]
    assert not np.isnan(content["methods"]["physics"]["rows"]["pose_error"]["low"])
    code, _, err = run("evaluate", "./physics", "ref", "--out", tmp_path / "out", *options)
    assert code == 0 and "3 of 3 were made before" in err


def test_every_option_goes_with_a_use():
    named = {"what", "root", "out", "processes"}.union(*(use.takes for use in USES.values()))
    assert named == set(signature(evaluate).parameters)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("procedurl",), "no such folder, and none of "),
        (("./physics",), "give the references too"),
        (("nowhere", "ref"), "PRED 'nowhere': no such file or folder"),
        (("./physics", "nowhere"), "REF 'nowhere': no such file or folder"),
        (("ref/a", "ref"), "is one asset, but there are 3 references"),
        (("ref/a/meshes", "ref"), "no prediction in it"),
        (("./physics", "ref/a/meshes"), "no reference in it"),
        (("./physics", "ref", "--only", "looks"), "no figures are called 'looks'"),
        (("./physics", "ref", "--only", "surface", "--samples", "best"), "add pose_error"),
        (("./physics", "ref", "--only", "openshape"), "--openshape WEIGHTS"),
        (("./physics", "ref", "--checkpoint", "nano"), "takes no --checkpoint"),
        (("./physics", "ref", "--processes", "0"), "must be at least 1"),
        (("physics", "ref", "--samples", "best"), "evaluate physics: it takes no --samples"),
        (("baselines", "--families", "kettle"), "evaluate baselines: it takes no --families"),
        (("baselines", "--first-seed", "900000"), "evaluate baselines: it takes no --first-seed"),
        (("layout", "--first-seed", "5"), "objects of seeds from 5 on may have been trained on"),
        (("procedural", "--families", "ketle"), "no family 'ketle'"),
        (("layout", "--families", "ketle"), "no family 'ketle'"),
        (("procedural", "--unseen", "--families", "kettle"), "--unseen: it takes no --families"),
        (("layout", "--unseen", "--families", "kettle"), "layout --unseen: it takes no --families"),
        (("procedural", "ref"), "it has no images"),
        (("layout", "ref", "--unseen"), "evaluate layout ROOT: it takes no --unseen"),
        (("physics", "--allow-outside"), "physics without ROOT: it takes no --allow-outside"),
        (("representation", "--checkpoint", "nano"), "which goes with baselines, procedural, "),
    ],
)
def test_mistakes_are_one_line_and_write_nothing(
    run, folders, tmp_path, monkeypatch, arguments, said
):
    monkeypatch.chdir(folders)
    code, out, err = run("evaluate", *arguments, "--out", tmp_path / "out")
    assert code == 2 and said in err and err.count("\n") == 1 and not out
    assert not (tmp_path / "out").exists()

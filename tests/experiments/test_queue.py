"""What goes wrong in a queue: objects and trainings that fail, settings that changed, a test set by
objects; nothing is trained here."""

import csv
import dataclasses
import json
import shutil
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh

from uniart_jax.config import Config
from uniart_jax.data.folder import COLUMNS
from uniart_jax.evaluation.families import posed
from uniart_jax.evaluation.result_store import read_result, write_result
from uniart_jax.experiments import evaluate_arm, run, settings, table
from uniart_jax.experiments.design import Arm, Experiment, ExternalArm, Records
from uniart_jax.experiments.inputs import check_networks
from uniart_jax.experiments.settings import FILE, check_settings, differences, write_settings
from uniart_jax.models.checkpoint import PRETRAINED, Checkpoint
from uniart_jax.models.checkpoint_files import write_config
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part

PIPELINE: Any = None  # nothing is asked of it
ARM = Arm(Config(), ("uniart_vae",), "vae")
ARMS = {"one": ARM, "two": ARM, "again": dataclasses.replace(ARM, stages=(), reuse="two")}
QUEUE = Experiment(ARMS, "one", ("rs_chamfer",), seeds=2, count=1)


@pytest.fixture
def fakes(monkeypatch):
    """A queue whose trainings and figures cost nothing; ``failing`` are those that diverge."""
    failing, trained = set(), []

    def train(arm, seed, workdir):
        trained.append((workdir.parent.name, seed))
        if trained[-1] in failing:
            raise FloatingPointError("uniart_vae: loss is nan at step 7")
        return workdir

    def figures(arm, checkpoint, seed, folder, count):
        (name,) = evaluate_arm.test_names(arm.tests, count)
        write_result(
            folder / f"{name}.json", {"figures": {"rs_chamfer": 0.1 + seed}, "failure": ""}
        )

    monkeypatch.setattr(run, "prepare", lambda *_: None)
    monkeypatch.setattr(run, "train_arm", train)
    monkeypatch.setattr(run, "evaluate_arm", figures)
    monkeypatch.setattr(table, "parameters", lambda *_: 1)
    return failing, trained


def test_a_training_that_diverges_is_a_result_and_tried_again(fakes, tmp_path):
    failing, trained = fakes
    failing.add(("two", 1))
    run.run_experiment(QUEUE, tmp_path)
    content = json.loads((tmp_path / "metrics.json").read_text())
    assert {name: arm["seeds"] for name, arm in content["arms"].items()} == {
        "one": [0, 1],
        "two": [0],
        "again": [0],
    }
    assert set(content["broken"]) == {"two", "again"}
    assert (
        "of two without a result, in no figure above: seed 1: uniart_vae: loss is nan"
        in (tmp_path / "table.md").read_text()
    )
    failing.clear()
    trained.clear()
    run.run_experiment(QUEUE, tmp_path)
    assert ("two", 1) in trained
    assert not json.loads((tmp_path / "metrics.json").read_text())["broken"]


def test_an_arm_of_another_experiment_is_trained_in_its_folder(fakes, monkeypatch, tmp_path):
    failing, trained = fakes
    arms = {name: dataclasses.replace(ARM, stages=(), reuse="main/there") for name in ("a", "b")}
    there = tmp_path.relative_to(tmp_path) / "main-paper/there"
    elsewhere = {"main/there": ExternalArm(ARM, there)}
    experiment = Experiment(arms, "a", ("rs_chamfer",), seeds=1, count=1, others=elsewhere)
    claimed = []
    monkeypatch.setattr(run, "write_settings", lambda e, name, folder: claimed.append(folder))
    run.run_experiment(experiment, tmp_path / "mine")
    assert set(claimed) == {tmp_path / "main-paper/there"}
    assert set(trained) == {("there", 0)}
    failing.add(("there", 0))
    trained.clear()
    run.run_experiment(experiment, tmp_path / "mine")
    assert trained == [("there", 0)]  # it failed for both
    assert read_result(tmp_path / "mine/b/seed-0/failure.json") is not None


def test_settings_that_differ_are_named(monkeypatch, tmp_path):
    monkeypatch.setattr(settings, "records_digest", lambda _: "ab")
    folder = tmp_path / "two"
    write_settings(QUEUE, "two", folder)
    write_settings(QUEUE, "two", folder)
    kept = read_result(folder / FILE)
    assert kept is not None
    del kept["config"]["uniart_vae"]["betas"]  # a setting that is newer than the folder
    write_result(folder / FILE, kept)
    check_settings(QUEUE, "two", folder)
    kept["config"]["uniart_vae"]["learning_rate"] = 7.0
    write_result(folder / FILE, kept)
    with pytest.raises(
        ValueError, match=r"results of arm two .*uniart_vae.learning_rate 7.0 instead"
    ):
        check_settings(QUEUE, "two", folder)
    (folder / "seed-0").mkdir()
    (folder / FILE).unlink()
    with pytest.raises(ValueError, match=r"arm two has results there without settings\.json"):
        check_settings(QUEUE, "two", folder)
    assert settings.settings(QUEUE, "again")["of"] == settings.settings(QUEUE, "two")
    assert differences({"a": {"b": 1}}, {"a": {"b": 1, "c": 2}}, {"a": {"c": 2}}) == []
    assert differences({"a": {"b": 1}}, {"a": {"b": 1, "c": 3}}, {"a": {"c": 2}}) == [
        "a.c 2 instead of 3"
    ]


@pytest.mark.parametrize("field", ["init", "beside", "config.init", "there before"])
def test_a_checkpoint_that_is_missing_is_named_before_anything_is_made(
    field, monkeypatch, tmp_path
):
    monkeypatch.setattr(run, "make_records", lambda *_: pytest.fail("records were made"))
    missing, arm = str(tmp_path / "before"), dataclasses.replace(ARM, init="nano")
    other = {
        "init": dataclasses.replace(ARM, init=missing),
        "beside": dataclasses.replace(ARM, other_networks_from=missing),
        "config.init": dataclasses.replace(ARM, config=Config(init=missing)),
        "there before": dataclasses.replace(ARM, init=missing),
    }[field]
    records = (Records(str(tmp_path / "records"), count=1),)
    experiment = Experiment({"now": arm, "old": other}, "now", ("rs_chamfer",), records=records)
    chosen = ["now", "old"]
    if field == "there before":  # it enters the table
        chosen = ["now"]
        (tmp_path / "out/old").mkdir(parents=True)
    with pytest.raises(FileNotFoundError, match=r"arm old: .*before.*at its head where it comes"):
        run.prepare(experiment, tmp_path / "out", chosen, 1, 1)
    assert not (tmp_path / "out/now").exists()


def test_an_arm_that_lacks_a_network_is_named_before_anything_is_made(monkeypatch, tmp_path):
    monkeypatch.setattr(run, "make_records", lambda *_: pytest.fail("records were made"))
    records = (Records(str(tmp_path / "records"), count=1),)
    blind = tmp_path / "blind"  # a shipped model whose latent flow reads no pixels
    shutil.copytree(PRETRAINED / "nano", blind)
    kept = Checkpoint(blind).config
    flow = dataclasses.replace(kept.model.latent_flow, pixel_channels=0)
    write_config(
        blind, dataclasses.replace(kept, model=dataclasses.replace(kept.model, latent_flow=flow))
    )
    arms = {
        "flows, encoder": Arm(kept, ("structure_flow",), "object"),
        "latent_flow": Arm(kept, ("structure_flow",), "object", init=str(blind)),
        "structure_flow, latent_flow": Arm(kept, ("uniart_vae",), "object", init="nano"),
        "structure_flow": Arm(kept, ("latent_flow",), "object", other_networks_from="nano"),
    }
    lacking = {
        **{name: name for name in arms},
        "flows, encoder": "image_encoder, structure_vae, uniart_vae, latent_flow",
    }
    for name, arm in arms.items():
        experiment = Experiment({name: arm}, name, ("rs_chamfer",), records=records)
        with pytest.raises(ValueError, match=f"is judged by {lacking[name]}, which it neither"):
            run.prepare(experiment, tmp_path / "out", [name], 1, 1)
    for arm in (
        Arm(kept, ("structure_flow",), "object", init="nano"),
        Arm(kept, (), "object", init=str(blind)),
    ):
        check_networks("fine", arm, arm)


def test_of_each_object_one_record_is_tested(tmp_path):
    """Records are object by object, five states each; the test split is some of the objects, and a
    state may have failed."""
    with (tmp_path / "manifest.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        for thing, split in (("a", "train"), ("b", "test"), ("c", "test"), ("d", "test")):
            for state in range(5):
                error = "lost" if (thing, state) == ("c", 0) else ""
                writer.writerow({"object": thing, "state": state, "split": split, "error": error})
    assert evaluate_arm.record_names(str(tmp_path), "test", 200) == ("0000", "0005", "0009")
    assert evaluate_arm.record_names(str(tmp_path), "test", 2) == ("0000", "0005")
    assert evaluate_arm.record_names(str(tmp_path), "", 200) == ("0000", "0005", "0010", "0014")


def test_an_object_without_a_truth_counts_for_nobody(monkeypatch, tmp_path):
    def broken(*_):
        raise ValueError("two boxes are equal")

    monkeypatch.setattr(evaluate_arm, "load_networks", lambda *_: SimpleNamespace(config=Config()))
    monkeypatch.setattr(evaluate_arm, "test_object", broken)
    evaluate_arm.evaluate_arm(ARM, tmp_path, 0, tmp_path / "one/seed-0/figures", 2)
    monkeypatch.setattr(table, "parameters", lambda *_: 1)
    content = table.write_tables(QUEUE, tmp_path, 2)
    arm = content["arms"]["one"]
    assert (arm["faulty"], arm["failures"]) == (2, 0)
    assert arm["rows"]["rs_chamfer"]["mean"] != arm["rows"]["rs_chamfer"]["mean"]  # NaN


@pytest.mark.slow
def test_an_object_that_fails_counts_with_the_worst_values(monkeypatch):
    (name,) = evaluate_arm.test_names(ARM.tests, 1)
    model = dataclasses.replace(
        Config().model,
        grid=dataclasses.replace(Config().model.grid, resolution=8),
        uniart_vae=dataclasses.replace(Config().model.uniart_vae, visual_channels=0),
    )
    test = evaluate_arm.test_object(ARM, name, model)

    def broken(*_):
        raise IndexError("no part\nat all")

    monkeypatch.setattr(evaluate_arm, "make_object", broken)
    figures, failure = evaluate_arm.measure(ARM, PIPELINE, test, 0)
    assert failure == "IndexError: no part at all"
    own = evaluate_arm.worst("articulation", posed(test.truth.obj))
    assert own["axis_median"] == evaluate_arm.METRICS["axis_median"].worst
    assert set(figures) == set(evaluate_arm.figure_names(ARM.pipeline_stage))
    assert figures["rs_chamfer"] == evaluate_arm.METRICS["rs_chamfer"].worst
    assert figures["part_recall"] == 0
    monkeypatch.setattr(evaluate_arm, "make_object", lambda *_: (test.truth.obj, None))
    monkeypatch.setattr("uniart_jax.evaluation.pose_error.measure", broken)
    figures, failure = evaluate_arm.measure(ARM, PIPELINE, test, 0)
    assert failure == "pose_error: IndexError: no part at all"
    assert figures["pose_error"] == evaluate_arm.METRICS["pose_error"].worst
    assert figures["rs_chamfer"] < 0.01  # the others stand

    def full(*_):
        raise MemoryError

    monkeypatch.setattr(evaluate_arm, "make_object", full)
    with pytest.raises(MemoryError):  # the machine's fault, not the network's
        evaluate_arm.measure(ARM, PIPELINE, test, 0)


def test_a_failure_counts_for_nothing_where_the_truth_has_nothing_to_compare():
    slide = Joint((0, 0, 0), (1.0, 0, 0), travel=(0.0, 0.3))
    chest = ArticulatedObject(
        [
            Part("case", trimesh.creation.box((1, 1, 1)), -1),
            Part("drawer", trimesh.creation.box((0.5, 0.5, 0.2)), 0, slide),
        ]
    )
    figures = evaluate_arm.worst("articulation", posed(chest))
    assert np.isnan(figures["pivot"]) and figures["axis_median"] == 180  # nothing turns


def test_an_unfinished_training_is_named_and_copies_beside_it_are_not_read(monkeypatch, tmp_path):
    monkeypatch.setattr(table, "parameters", lambda *_: 1)
    names = evaluate_arm.test_names(ARM.tests, 3)
    for seed, judged in (("0", 3), ("1", 2), ("0.bak", 1)):
        for name in names[:judged]:
            kept = {"figures": {"rs_chamfer": 0.1}, "failure": ""}
            write_result(tmp_path / f"one/seed-{seed}/figures/{name}.json", kept)
    content = table.write_tables(QUEUE, tmp_path, 3)
    assert content["arms"]["one"]["seeds"] == [0]
    assert content["arms"]["one"]["rows"]["rs_chamfer"]["mean"] == pytest.approx(0.1)
    assert "in no figure above: one (seed 1: 2 of 3)." in (tmp_path / "table.md").read_text()
    # of a newer version, which knows more figures
    write_result(
        tmp_path / f"one/seed-0/figures/{names[2]}.json",
        {"figures": {"rs_chamfer": 0.4, "as_chamfer": 1.0}, "failure": ""},
    )
    with pytest.raises(ValueError, match="seed-0: figures of several versions"):
        table.write_tables(QUEUE, tmp_path, 3)

"""The paper's experiments: the arms of every file, their test objects, mistakes in a command."""

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest

from uniart_jax import cli
from uniart_jax.cli import load_config
from uniart_jax.evaluation.procedural import held_out_for
from uniart_jax.experiments import evaluate_arm
from uniart_jax.experiments.design import Objects, load_experiment, with_aggregation
from uniart_jax.models.checkpoint import PRETRAINED
from uniart_jax.models.network import build
from uniart_jax.procedural import HELD_OUT_SEED, generate

ROOT = Path(__file__).parents[2]
FILES = sorted((ROOT / "configs/experiments").glob("*.py"))
NANO_ONLY = ("unseen_joint", "open_set_vae", "shipped")  # they have no paper size


@pytest.mark.parametrize("size", ["nano", "paper"])
@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_every_arm_has_the_networks_that_its_pipeline_stage_needs(path, size):
    if path.stem in NANO_ONLY and size == "paper":
        with pytest.raises(ValueError, match="no paper size"):
            load_experiment(path, size)
        return
    experiment = load_experiment(path, size)
    assert set(experiment.columns) <= set(evaluate_arm.METRICS)
    shipped = {p.stem for p in (PRETRAINED / "nano").glob("*.safetensors")}
    made = {records.folder for records in experiment.records}
    for name, arm in experiment.arms.items():
        has = set(experiment.trained(name).stages)
        if size == "paper":
            has.add("image_encoder")  # DINOv2, beside TRELLIS's weights
        elif any(Path(source).name == "nano" for source in (arm.init, arm.other_networks_from)):
            has |= shipped  # or what an earlier commit shipped
        assert set(evaluate_arm.NEEDS[arm.pipeline_stage]) <= has, name
        if size == "nano" and arm.stages:
            assert arm.config.data.records in made and not arm.config.data.procedural, name
            build("uniart_vae", arm.config.model).abstract()


def test_arms_differ_in_what_they_say_and_nothing_else():
    arms = load_experiment(ROOT / "configs/experiments/aggregation.py").arms
    assert set(arms) == {"uniart", "self_attention", "residual", "pooling", "concat"}
    for kind, arm in arms.items():
        assert arm.config.model.uniart_vae.aggregation == kind
        same = with_aggregation(arm.config, "uniart")
        assert dataclasses.replace(arm, config=same) == arms["uniart"]
        assert not arm.config.model.uniart_vae.part_segment  # whole parts


def test_the_papers_configuration_is_trained_once():
    """Of all experiments but main, the arms that are main's are main's; each network is trained in
    one place."""
    trained = {}
    for path in FILES:
        if path.stem in NANO_ONLY:
            continue
        experiment = load_experiment(path, "paper")
        for name, arm in experiment.arms.items():
            folder = experiment.folder(name, Path("runs") / f"{path.stem}-paper")
            made = experiment.trained(name)
            assert trained.setdefault(folder, made.config) == made.config
            assert arm.config == made.config
    configs = [(c.data.records, c.data.condition_views, c.init, c.model) for c in trained.values()]
    assert all(configs.count(c) == 1 for c in configs)
    assert Path("runs/main-paper/uniart") in trained and len(trained) == 9


def test_procedural_test_objects_have_geometric_part_features():
    model = load_config(ROOT / "configs/debug.py").model
    truth = held_out_for(model, 1)
    reads = dataclasses.replace(model.uniart_vae, visual_channels=0, part_feature_channels=23)
    seen = dataclasses.replace(model, uniart_vae=reads)
    (values,) = evaluate_arm.features_of(truth, seen).values()
    assert values.shape == (len(truth.grid.coords), 23) and values.dtype == np.float32
    assert np.ptp(values, axis=0).max() > 0.5
    blind = dataclasses.replace(reads, part_feature_channels=0)
    assert evaluate_arm.features_of(truth, dataclasses.replace(model, uniart_vae=blind)) == {}
    partfield = dataclasses.replace(reads, part_feature_channels=448)
    with pytest.raises(ValueError, match=r"'part_feature': 448.*name records with its columns"):
        evaluate_arm.features_of(truth, dataclasses.replace(model, uniart_vae=partfield))


def test_test_objects_can_be_asked_for_a_joint_type():
    names = evaluate_arm.test_names(Objects(joint_type="screw", unseen=True), 2)
    for name in names:
        index, family = name.split("-")
        obj = generate(family, HELD_OUT_SEED + int(index))
        assert "screw" in {part.joint.type for part in obj.parts}
    with pytest.raises(ValueError, match="no joint of type 'planar'"):
        evaluate_arm.test_names(Objects(joint_type="planar"), 1)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nothing"], "give a .py file, or a name of these: aggregation, "),
        (["aggregation", "--seeds", "0"], "--seeds must be at least 1"),
        (["solvers", "--seeds", "2"], "nothing is trained in it, so there is one seed"),
        (["unseen_joint", "--size", "paper"], "no paper size"),
        ([str(ROOT / "configs/debug.py")], "must define experiment(size)"),
    ],
)
def test_mistakes_are_one_line(monkeypatch, capsys, arguments, said):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(sys, "argv", ["uniart", "experiment", *arguments])
    with pytest.raises(SystemExit) as done:
        cli.main()
    error = capsys.readouterr().err
    assert done.value.code == 2 and said in error and error.count("\n") == 1

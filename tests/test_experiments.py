"""The paper's experiments: every file's arms, the queue at toy size, what its table says, and what may go wrong."""

import dataclasses
import json
import sys
from pathlib import Path

import jax
import numpy as np
import pytest
from scipy import stats

from uniart_jax import cli, stages
from uniart_jax.cli import load_config
from uniart_jax.data.records import RecordSource
from uniart_jax.evaluation.kept import keep
from uniart_jax.experiments import judge, run
from uniart_jax.experiments.design import Arm, Experiment, Objects, Records, load_experiment
from uniart_jax.experiments.fronts import fitted
from uniart_jax.experiments.table import difference, row, write_tables
from uniart_jax.models.network import build
from uniart_jax.pipeline import PRETRAINED
from uniart_jax.procedural import HELD_OUT_SEED, generate
from uniart_jax.training.export import export_network, flat_names, load_network, write_config

TRAINS = pytest.mark.slow  # two arms: half a minute

ROOT = Path(__file__).parent.parent
FILES = sorted((ROOT / "configs/experiments").glob("*.py"))
COLUMNS = ("as_chamfer", "parts_right")


@pytest.mark.parametrize("size", ["nano", "paper"])
@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_every_arm_has_the_networks_that_its_station_needs(path, size):
    if (path.stem, size) == ("unseen_joint", "paper"):
        with pytest.raises(ValueError, match="no paper size"):
            load_experiment(path, size)
        return
    experiment = load_experiment(path, size)
    assert set(experiment.columns) <= set(judge.METRICS)
    shipped = {p.stem for p in (PRETRAINED / "nano").glob("*.safetensors")}
    for name, arm in experiment.arms.items():
        has = set(experiment.arms[arm.of].stages if arm.of else arm.stages)
        if size == "paper":
            has.add("image_encoder")  # DINOv2, beside TRELLIS's weights
        elif "nano" in (arm.init, arm.beside):
            has |= shipped
        assert set(judge.NEEDS[arm.station]) <= has, name
        if size == "nano" and arm.stages:
            build("uniart_vae", arm.config.model).abstract()


def test_arms_differ_in_what_they_say_and_nothing_else():
    arms = load_experiment(ROOT / "configs/experiments/aggregation.py").arms
    assert set(arms) == {"uniart", "self_attention", "residual", "pooling", "concat"}
    for kind, arm in arms.items():
        model = arm.config.model
        vae = dataclasses.replace(model.uniart_vae, aggregation="uniart")
        same = dataclasses.replace(arm.config, model=dataclasses.replace(model, uniart_vae=vae))
        assert model.uniart_vae.aggregation == kind
        assert dataclasses.replace(arm, config=same) == arms["uniart"]


def toy(folder: Path) -> Experiment:
    """Two aggregations of ``configs/debug.py`` on a coarser grid; "again" judges the first's networks on other objects."""
    debug = load_config(ROOT / "configs/debug.py")
    model = debug.model
    data = dataclasses.replace(
        debug.data,
        records=str(folder / "records"),
        validation="",
        procedural=0,
        voxel_buckets=(4096,),
    )
    base = dataclasses.replace(
        debug,
        model=dataclasses.replace(model, grid=dataclasses.replace(model.grid, resolution=16)),
        data=data,
        uniart_vae=dataclasses.replace(debug.uniart_vae, steps=2, save_every=1),
    )
    concat = dataclasses.replace(model.uniart_vae, aggregation="concat")
    other = dataclasses.replace(base, model=dataclasses.replace(base.model, uniart_vae=concat))
    arms = {
        "uniart": Arm(base, ("uniart_vae",), "vae"),
        "concat": Arm(other, ("uniart_vae",), "vae"),
        "again": Arm(base, (), "vae", Objects(unseen=True), of="uniart"),
    }
    records = Records(str(folder / "records"), families=("bottle", "door"), count=3, views=1)
    return Experiment(arms, "uniart", COLUMNS, seeds=1, count=1, records=(records,))


def test_settings_are_what_figures_depend_on(tmp_path):
    """A default may be added later; another weight of the checkpoint, or another step, is another arm."""
    arm = toy(tmp_path).arms["uniart"]
    found = run.settings(arm)
    assert found["config"]["uniart_vae"]["steps"] == 2 and "loss" in found["config"]
    assert "betas" not in found["config"]["uniart_vae"]  # the default
    for folder, weight in (("a", 0.0), ("b", 1.0)):
        export_network(tmp_path / folder, "uniart_vae", {"w": np.full(3, weight)})
    judged = dataclasses.replace(arm, stages=(), of="", init=str(tmp_path / "a"))
    other = dataclasses.replace(judged, init=str(tmp_path / "b"))
    assert run.settings(judged)["weights"] != run.settings(other)["weights"]
    assert "config" not in run.settings(judged)


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A toy experiment and the folder of its queue, run once."""
    folder = tmp_path_factory.mktemp("experiment")
    experiment = toy(folder)
    run.run_experiment(experiment, folder / "out")
    return experiment, folder / "out"


@TRAINS
def test_the_queue_leaves_a_table_of_all_arms(done):
    experiment, out = done
    content = json.loads((out / "metrics.json").read_text())
    assert list(content["arms"]) == list(experiment.arms)
    assert all(arm["seeds"] == [0] for arm in content["arms"].values())
    assert "differences" in content["arms"]["concat"]
    assert "differences" not in content["arms"]["again"]  # other objects
    families = {p.stem.split("-")[1] for p in (out / "again/seed-0/figures").glob("*.json")}
    assert families == {"toilet"}
    text = (out / "table.md").read_text()
    assert text.count("| concat |") == 2 and "AS CD ↓" in text


@TRAINS
def test_a_queue_goes_on_where_it_was_stopped(done, monkeypatch):
    """What is trained is not trained again, what is judged is not judged again, and what is missing comes out the same."""
    experiment, out = done
    before = {p: p.read_text() for p in out.glob("*/seed-*/figures/*.json")}
    gone = next(p for p in before if "concat" in str(p))
    gone.unlink()
    judged = []
    measure = judge.measure
    monkeypatch.setattr(judge, "measure", lambda *a: judged.append(a) or measure(*a))
    monkeypatch.setattr(stages, "create_state", lambda *_: pytest.fail("trained again"))
    run.run_experiment(experiment, out)
    assert len(judged) == 1
    assert {p: p.read_text() for p in out.glob("*/seed-*/figures/*.json")} == before


@TRAINS
def test_an_arm_of_other_settings_is_refused_before_any_work(done):
    experiment, out = done
    arm = experiment.arms["concat"]
    longer = dataclasses.replace(arm.config.uniart_vae, steps=3)
    arms = {**experiment.arms, "concat": dataclasses.replace(arm, config=dataclasses.replace(arm.config, uniart_vae=longer))}  # fmt: skip
    with pytest.raises(ValueError, match="arm of other settings"):
        run.run_experiment(dataclasses.replace(experiment, arms=arms), out)
    with pytest.raises(ValueError, match="no arm 'sum'; there are uniart, concat, again"):
        run.run_experiment(experiment, out, arms=["sum"])


@TRAINS
def test_two_processes_never_work_in_one_folder(done):
    experiment, out = done
    with run.alone(out), pytest.raises(ValueError, match="another process works on it"):
        run.run_experiment(experiment, out)


@TRAINS
def test_seeds_reach_the_weights_and_the_order_of_data(done, monkeypatch, tmp_path):
    experiment, _ = done
    seen = []
    monkeypatch.setattr(run, "run", lambda config, *_: seen.append((config.seed, config.data.seed)))
    for seed in (0, 1):
        run.train_arm(experiment.arms["uniart"], seed, tmp_path)
    assert seen == [(0, 0), (1, 1)]


@TRAINS
def test_records_without_a_joint_type(done, tmp_path):
    experiment, _ = done
    source = Path(experiment.records[0].folder)
    run.leave_out(source, tmp_path / "rest", "screw")
    for split, families in (("train", ["door"]), ("screw", ["bottle", "bottle"])):
        found = RecordSource(tmp_path / "rest", split)
        assert [r.meta["id"].split("-")[0] for r in found] == families
    with pytest.raises(ValueError, match="0 of 3 records have a joint 'helical'"):
        run.leave_out(source, tmp_path / "none", "helical")


@TRAINS
def test_another_front_keeps_everything_behind_it(done, tmp_path):
    """A VAE with visual features, as TRELLIS's weights make it: the trunk's input keeps their rows and the rest begins at zero."""
    experiment, _ = done
    config = experiment.arms["uniart"].config
    vae = dataclasses.replace(config.model.uniart_vae, visual_channels=8)
    config = dataclasses.replace(config, model=dataclasses.replace(config.model, uniart_vae=vae))
    network = build("uniart_vae", config.model)
    export_network(tmp_path / "old", "uniart_vae", network.init(jax.random.key(0)), "float32")
    write_config(tmp_path / "old", config)
    assert fitted(tmp_path / "old", config, tmp_path / "same") == tmp_path / "old"
    wanted = dataclasses.replace(vae, aggregation="residual")
    model = dataclasses.replace(config.model, uniart_vae=wanted)
    new = fitted(tmp_path / "old", dataclasses.replace(config, model=model), tmp_path / "new")
    before, after = (
        flat_names(load_network(folder, "uniart_vae", build("uniart_vae", m).abstract()))
        for folder, m in ((tmp_path / "old", config.model), (new, model))
    )
    rows = after.pop("encoder.input_layer.kernel")
    assert np.array_equal(rows[:8], before["encoder.input_layer.kernel"][:8])
    assert rows[:8].any() and not rows[8:].any()
    behind = [name for name in after if not name.startswith("front.")]
    assert behind and all(np.array_equal(before[name], after[name]) for name in behind)


@TRAINS
def test_views_begin_with_the_objects_own(done):
    experiment, _ = done
    arm, model = experiment.arms["uniart"], experiment.arms["uniart"].config.model
    (name,) = judge.test_names(arm.tests, 1)
    one, three = (judge.test_object(dataclasses.replace(arm, views=n), name, model) for n in (1, 3))
    assert len(one.images) == 1 and len(three.images) == 3
    assert np.array_equal(one.images[0], three.images[0])
    assert not np.array_equal(three.images[1], three.images[2])


def test_test_objects_can_be_asked_for_a_joint_type():
    names = judge.test_names(Objects(joint_type="screw", unseen=True), 2)
    for name in names:
        index, family = name.split("-")
        obj = generate(family, HELD_OUT_SEED + int(index))
        assert "screw" in {part.joint.type for part in obj.parts}
    with pytest.raises(ValueError, match="no joint of type 'planar'"):
        judge.test_names(Objects(joint_type="planar"), 1)


@TRAINS
def test_records_are_test_objects_too(done):
    experiment, _ = done
    source = experiment.records[0].folder
    arm = dataclasses.replace(experiment.arms["uniart"], tests=Objects(records=source))
    assert judge.test_names(arm.tests, 9) == ("0000", "0001", "0002")
    test = judge.test_object(arm, "0002", arm.config.model)
    assert len(test.truth.obj.parts) == len(RecordSource(source)[2].boxes)
    with pytest.raises(ValueError, match="1 images, 2 are shown"):
        judge.test_object(dataclasses.replace(arm, views=2), "0002", arm.config.model)


def test_intervals_over_objects_and_over_trainings():
    rng = np.random.default_rng(0)
    objects, noise = rng.normal(size=40), rng.normal(size=(3, 1)) * 0.1
    reference = objects + rng.normal(size=(3, 1))
    values = reference + 0.5 + noise
    found = difference(values, reference)  # objects and the seeds' own level cancel
    low, high = stats.t.interval(0.95, 2, 0.5 + noise.mean(), stats.sem(noise[:, 0]))
    assert found == pytest.approx({"mean": 0.5 + noise.mean(), "low": low, "high": high})
    single = difference(objects[None] + 1, objects[None])
    assert single == pytest.approx({"mean": 1, "low": 1, "high": 1})
    mean = row(np.stack([objects, objects + 1]))
    assert mean["mean"] == pytest.approx(objects.mean() + 0.5)
    assert mean["seeds"] == pytest.approx([objects.mean(), objects.mean() + 1])
    width = 2 * 1.96 * objects.std() / 40**0.5
    assert mean["high"] - mean["low"] == pytest.approx(width, rel=0.15)


def test_what_cannot_be_compared_is_left_out_of_means():
    gap = np.array([[1.0, np.nan, 3.0], [3.0, np.nan, np.nan]])
    assert row(gap)["mean"] == pytest.approx(2.5)  # objects: (1 + 3) / 2 and 3
    apart = difference(gap, np.zeros((2, 3)))
    assert apart["mean"] == pytest.approx(2.5)  # seeds: 2 and 3
    assert np.isnan(difference(np.full((1, 2), np.nan), np.zeros((1, 2)))["mean"])


@TRAINS
def test_a_half_judged_seed_is_not_in_the_table(done, tmp_path):
    experiment, _ = done
    names = judge.test_names(Objects(), 2)
    for arm, objects in (("uniart", names), ("concat", names[:1])):
        for name in objects:
            file = tmp_path / arm / "seed-0" / "figures" / f"{name}.json"
            keep(file, {"figures": {"as_chamfer": 0.5}, "failure": "none found"})
    content = write_tables(experiment, tmp_path, 2)
    assert list(content["arms"]) == ["uniart"]
    assert "without a result, counted with the worst values: uniart 2" in (tmp_path / "table.md").read_text()  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nothing"], "give a file, or in the repository's root one of aggregation, "),
        (["aggregation", "--seeds", "0"], "--seeds must be at least 1"),
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


@TRAINS
def test_prepared_records_are_not_made_again(done, monkeypatch):
    experiment, _ = done
    monkeypatch.setattr(run, "prepare_procedural", lambda *_, **__: pytest.fail("made again"))
    run.make_records(experiment.records[0], experiment.arms["uniart"])

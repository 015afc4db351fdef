"""The paper's experiments: the queue at toy size, what its table says, and what may go wrong."""

import contextlib
import dataclasses
import json
from pathlib import Path

import jax
import numpy as np
import pytest

from uniart_jax.cli import load_config
from uniart_jax.config import NETWORKS
from uniart_jax.data import folder as data_folder
from uniart_jax.data.records import RecordSource, record_rows
from uniart_jax.evaluation.result_store import write_result
from uniart_jax.experiments import evaluate_arm, inputs, run
from uniart_jax.experiments.design import (
    Arm,
    Experiment,
    Objects,
    Records,
    load_experiment,
    with_aggregation,
)
from uniart_jax.experiments.reinit_aggregation import reinit_aggregation, shared_init
from uniart_jax.experiments.settings import described
from uniart_jax.experiments.table import write_tables
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.checkpoint_files import write_config, write_network
from uniart_jax.models.network import build, flat_names
from uniart_jax.runtime.locks import exclusive_lock
from uniart_jax.stages import trainer

TRAINS = pytest.mark.slow  # two arms: half a minute

ROOT = Path(__file__).parent.parent
COLUMNS = ("as_chamfer", "parts_right")
COLUMNS_OF_ROWS = data_folder.COLUMNS


@TRAINS
def test_what_arms_share_begins_alike(tmp_path):
    config = load_config(ROOT / "configs/debug.py")
    stages = ("uniart_vae",)
    assert shared_init(config, stages, tmp_path / "none") is None
    found = {}
    for kind in ("concat", "residual"):  # the second without the width of the first
        other = with_aggregation(config, kind)
        folder = shared_init(other, stages, tmp_path / kind)
        found[kind] = flat_names(Checkpoint(folder).load("uniart_vae", other.model))
    key = jax.random.fold_in(
        jax.random.key(config.seed), NETWORKS.index("uniart_vae")
    )  # stages/train_network.py
    base = flat_names(jax.jit(build("uniart_vae", config.model).init)(key))
    for names in found.values():
        shared = [n for n, leaf in names.items() if n in base and base[n].shape == leaf.shape]
        assert {"front.geometry.kernel", "geometry_head.kernel"} <= set(shared)
        for name in shared:
            np.testing.assert_allclose(names[name], base[name], rtol=1e-6)
    assert any(n.startswith("front.fuse") for n in found["concat"])


def toy(folder: Path) -> Experiment:
    """Two aggregations of ``configs/debug.py`` on a coarser grid; "again" judges the first's
    networks on other objects."""
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
    other = with_aggregation(base, "concat")
    arms = {
        "uniart": Arm(base, ("uniart_vae",), "vae"),
        "concat": Arm(other, ("uniart_vae",), "vae"),
        "again": Arm(base, (), "vae", Objects(unseen=True), reuse="uniart"),
    }
    records = Records(str(folder / "records"), families=("bottle", "door"), count=3, views=1)
    return Experiment(arms, "uniart", COLUMNS, seeds=1, count=1, records=(records,))


def test_settings_are_what_figures_depend_on(tmp_path):
    """Another weight of a checkpoint, or another of its options, is another arm; so are other
    records."""
    arm = toy(tmp_path).arms["uniart"]
    with pytest.raises(FileNotFoundError, match=r"no metadata\.json"):
        described(arm)
    (tmp_path / "records").mkdir()
    (tmp_path / "records/metadata.json").write_text("{}")
    rows = tmp_path / "records/manifest.csv"
    rows.write_text(",".join(COLUMNS_OF_ROWS) + "\n")
    found = described(arm)
    assert found["config"]["uniart_vae"]["steps"] == 2
    assert "betas" in found["config"]["uniart_vae"]  # defaults too: they may change
    rows.write_text(rows.read_text() + "a" + "," * (len(COLUMNS_OF_ROWS) - 1) + "\n")
    assert described(arm)["records"] != found["records"]
    for folder, weight in (("a", 0.0), ("b", 1.0)):
        write_network(tmp_path / folder, "uniart_vae", {"w": np.full(3, weight)})
    judged = dataclasses.replace(arm, stages=(), reuse="", init=str(tmp_path / "a"))
    other = dataclasses.replace(judged, init=str(tmp_path / "b"))
    first = described(judged)
    assert "config" not in first
    assert list(first["weights"].values()) != list(described(other)["weights"].values())
    write_config(tmp_path / "a", arm.config)
    assert described(judged)["weights"] != first["weights"]


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
    assert content["arms"]["concat"]["over"] == "objects"  # of one training
    assert content["arms"]["again"]["over"] == "other objects"
    sizes = [arm["parameters"] for arm in content["arms"].values()]
    assert sizes[0] == sizes[2] != sizes[1]
    families = {p.stem.split("-")[1] for p in (out / "again/seed-0/figures").glob("*.json")}
    assert families == {"toilet"}
    text = (out / "table.md").read_text()
    assert text.count("| concat |") == 2 and "AS CD ↓" in text
    assert "| concat | uniart | objects, one training |" in text
    assert "no evidence on what was varied" in text


@TRAINS
def test_a_queue_goes_on_where_it_was_stopped(done, monkeypatch):
    """What is trained is not trained again, what is judged is not judged again, and what is missing
    comes out the same."""
    experiment, out = done

    def kept():
        files = {p: json.loads(p.read_text()) for p in out.glob("*/seed-*/figures/*.json")}
        assert all(file.pop("seconds") > 0 for file in files.values())
        return files

    before = kept()
    gone = next(p for p in before if "concat" in str(p))
    gone.unlink()
    judged = []
    measure = evaluate_arm.measure
    monkeypatch.setattr(evaluate_arm, "measure", lambda *a: judged.append(a) or measure(*a))
    monkeypatch.setattr(trainer, "create_state", lambda *_: pytest.fail("trained again"))
    run.run_experiment(experiment, out)
    assert len(judged) == 1
    assert kept() == before


@TRAINS
def test_an_arm_of_other_settings_is_refused_before_any_work(done):
    experiment, out = done
    arm = experiment.arms["concat"]
    longer = dataclasses.replace(arm.config.uniart_vae, steps=3)
    arms = {
        **experiment.arms,
        "concat": dataclasses.replace(
            arm, config=dataclasses.replace(arm.config, uniart_vae=longer)
        ),
    }
    changed = dataclasses.replace(experiment, arms=arms)
    for chosen in ([], ["uniart"]):  # what lies there enters the table, whatever is asked for
        with pytest.raises(
            ValueError,
            match=r"arm concat there are of other settings .config.uniart_vae.steps 2 instead of 3",
        ):
            run.run_experiment(changed, out, arms=chosen)
    with pytest.raises(ValueError, match="no arm 'sum'; there are uniart, concat, again"):
        run.run_experiment(experiment, out, arms=["sum"])


@TRAINS
def test_two_processes_never_work_in_one_folder(done):
    experiment, out = done
    with exclusive_lock(out), pytest.raises(ValueError, match="another process works on it"):
        run.run_experiment(experiment, out)


def test_an_arm_of_another_experiment_waits_for_who_works_there(tmp_path, monkeypatch):
    here, there = tmp_path / "uni_encoding-paper", tmp_path / "aggregation-paper"
    experiment = load_experiment(ROOT / "configs/experiments/uni_encoding.py", "paper")
    (name,) = (n for n, arm in experiment.arms.items() if arm.reuse.startswith("aggregation/"))
    held = []
    lock = lambda *given: held.append(given) or contextlib.nullcontext()  # noqa: E731
    monkeypatch.setattr(run, "exclusive_lock", lock)
    monkeypatch.setattr(run, "write_settings", lambda *_: None)
    monkeypatch.setattr(run, "train_arm", lambda *_: there)
    monkeypatch.setattr(run, "evaluate_arm", lambda *_: held.append("judged"))
    run.attempt(experiment, here, name, 0, 1, {})
    (folder, wait), judged = held
    assert folder == there and callable(wait) and judged == "judged"
    with pytest.raises(ValueError, match="is the folder of the experiment that arm"):
        run.prepare(experiment, there, [name], 1, 1)


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
    inputs.leave_out(source, tmp_path / "rest", "screw")
    for split, families in (("train", ["door"]), ("screw", ["bottle", "bottle"])):
        found = RecordSource(tmp_path / "rest", split)
        assert [r.meta["id"].split("-")[0] for r in found] == families
    with pytest.raises(ValueError, match="0 of 3 records have a joint 'helical'"):
        inputs.leave_out(source, tmp_path / "none", "helical")
    inputs.leave_out(source, tmp_path / "few", "screw", matched=True)
    both = [
        sorted(row["category"] for row in record_rows(tmp_path / name) if row["split"] == "train")
        for name in ("rest", "few")
    ]
    assert both[0] == both[1] == ["door"]
    before = {p: p.lstat().st_mtime_ns for p in (tmp_path / "rest").iterdir()}
    inputs.leave_out(source, tmp_path / "rest", "screw")  # others may read it
    assert {p: p.lstat().st_mtime_ns for p in (tmp_path / "rest").iterdir()} == before


@TRAINS
def test_another_front_keeps_everything_behind_it(done, tmp_path):
    """A VAE with visual features, as TRELLIS's weights make it: the trunk's input keeps their rows
    and the rest begins at zero."""
    experiment, _ = done
    config = experiment.arms["uniart"].config
    vae = dataclasses.replace(config.model.uniart_vae, visual_channels=8)
    config = dataclasses.replace(config, model=dataclasses.replace(config.model, uniart_vae=vae))
    network = build("uniart_vae", config.model)
    write_network(
        tmp_path / "old", "uniart_vae", jax.jit(network.init)(jax.random.key(0)), "float32"
    )
    write_config(tmp_path / "old", config)
    old = Checkpoint(tmp_path / "old")
    assert reinit_aggregation(old, config, tmp_path / "same") == old.folder
    wanted = dataclasses.replace(vae, aggregation="residual")
    model = dataclasses.replace(config.model, uniart_vae=wanted)
    new = reinit_aggregation(old, dataclasses.replace(config, model=model), tmp_path / "new")
    before, after = (
        flat_names(checkpoint.load("uniart_vae", m))
        for checkpoint, m in ((old, config.model), (Checkpoint(new), model))
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
    (name,) = evaluate_arm.test_names(arm.tests, 1)
    arms = [dataclasses.replace(arm, views=n) for n in (1, 3)]
    one, three = (evaluate_arm.test_object(arm, name, model) for arm in arms)
    assert len(one.images) == 1 and len(three.images) == 3
    assert np.array_equal(one.images[0], three.images[0])
    assert not np.array_equal(three.images[1], three.images[2])


@TRAINS
def test_records_are_test_objects_too(done):
    experiment, _ = done
    source = experiment.records[0].folder
    arm = dataclasses.replace(experiment.arms["uniart"], tests=Objects(records=source))
    assert evaluate_arm.test_names(arm.tests, 9) == ("0000", "0001", "0002")
    test = evaluate_arm.test_object(arm, "0002", arm.config.model)
    assert len(test.truth.obj.parts) == len(RecordSource(source)[2].boxes)
    with pytest.raises(ValueError, match="1 images, 2 are shown"):
        evaluate_arm.test_object(dataclasses.replace(arm, views=2), "0002", arm.config.model)


@TRAINS
def test_a_half_judged_seed_is_not_in_the_table(done, tmp_path):
    experiment, _ = done
    names = evaluate_arm.test_names(Objects(), 2)
    for arm, objects in (("uniart", names), ("concat", names[:1])):
        for name in objects:
            file = tmp_path / arm / "seed-0" / "figures" / f"{name}.json"
            write_result(file, {"figures": {"as_chamfer": 0.5}, "failure": "none found"})
    content = write_tables(experiment, tmp_path, 2)
    assert list(content["arms"]) == ["uniart"]
    assert (
        "something failed, counted with the worst values: uniart 2"
        in (tmp_path / "table.md").read_text()
    )


@TRAINS
def test_records_are_made_once_and_checked(done, monkeypatch):
    experiment, _ = done
    model = experiment.arms["uniart"].config.model
    (records,) = experiment.records
    monkeypatch.setattr(inputs, "prepare_procedural", lambda *_, **__: pytest.fail("made again"))
    inputs.make_records(records, model)
    for change, said in (
        ({"families": ("door",)}, "families .'bottle', 'door'. instead of .'door'."),
        ({"views": 3}, "views 1 instead of 3"),
        ({"count": 2}, "3 objects instead of 2"),
    ):
        with pytest.raises(ValueError, match=said):
            inputs.make_records(dataclasses.replace(records, **change), model)
    rows = inputs.read_manifest(records.folder)
    rows[0] = rows[0] | {"error": "9 parts, more than max_parts = 8"}
    with monkeypatch.context() as patch:
        patch.setattr(inputs, "read_manifest", lambda folder: rows)
        with pytest.raises(ValueError, match="objects left out by max_parts"):
            inputs.make_records(records, model)
    asked = []
    monkeypatch.setattr(inputs, "prepare_procedural", lambda *a, **_: asked.append(a[1]))
    inputs.make_records(dataclasses.replace(records, count=4), model)
    assert asked == [4]


@TRAINS
def test_what_is_missing_is_said_before_any_training(done, monkeypatch, tmp_path):
    experiment, out = done
    monkeypatch.setattr(run, "train_arm", lambda *_: pytest.fail("trained"))
    source = experiment.records[0].folder
    shown = Arm(
        experiment.arms["uniart"].config,
        (),
        "vae",
        Objects(records=source),
        reuse="uniart",
        views=2,
    )
    more = dataclasses.replace(experiment, arms={**experiment.arms, "two": shown})
    with pytest.raises(
        ValueError, match=r"arm two: .*1 images, 2 are shown; prepare it with --views 2"
    ):
        run.run_experiment(more, out)
    with pytest.raises(
        ValueError, match=r"'again' judges the networks of 'uniart', .* --arms uniart again"
    ):
        run.run_experiment(experiment, tmp_path / "out", arms=["again"])
    run.missing_networks(experiment, out, ["again"], 1)  # trained before

"""All stages from a config to a checkpoint that samples, and from which others begin."""

import contextlib
import dataclasses
import json
import shutil

import jax
import numpy as np
import pytest
from safetensors.numpy import load_file

import uniart_jax
from uniart_jax import procedural, stages
from uniart_jax.config import NETWORKS, LayoutConfig
from uniart_jax.data.prepare import prepare_procedural
from uniart_jax.data.records import RecordSource
from uniart_jax.evaluation.procedural import evaluate_checkpoint, make_retrieval
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.checkpoint_files import write_statistics
from uniart_jax.models.network import build
from uniart_jax.objects.kinematics import Joint
from uniart_jax.precompute import encoding
from uniart_jax.stages import STAGES
from uniart_jax.stages.checks import check_found, networks_to_copy
from uniart_jax.stages.flows import load_conditioner
from uniart_jax.stages.train_network import make_put, make_step, stage_batches
from uniart_jax.training.flow_losses import make_structure_flow_loss
from uniart_jax.training.sharding import make_mesh
from uniart_jax.training.state import create_state, make_optimizer
from uniart_jax.voxels.assemble import assemble
from uniart_jax.voxels.layout import Layout


def test_every_stage_leaves_its_weights_and_a_second_run_skips_them(trained, capsys):
    config, workdir = trained
    names = {path.stem for path in (workdir / "export").glob("*.safetensors")}
    assert names == {*NETWORKS, "latent_stats"}
    before = {p.name: p.read_bytes() for p in (workdir / "export").iterdir()}
    stages.run(config, NETWORKS, workdir)
    assert {p.name: p.read_bytes() for p in (workdir / "export").iterdir()} == before
    assert capsys.readouterr().err.count("already trained") == len(NETWORKS)


def test_the_exported_checkpoint_samples(trained):
    config, workdir = trained
    pipeline = uniart_jax.load(workdir)
    image = np.zeros((40, 40, 4), np.uint8)
    image[8:32, 10:30] = 200, 150, 90, 255
    seen = pipeline.encode_images(pipeline.prepare(image)[None])
    condition = pipeline.following(seen, [None])
    assert condition.layout.counts.tolist() == [0]
    found = pipeline.sample_structure(condition, jax.random.key(0))
    assert len(found) == 1 and found[0].ndim == 2  # two steps of training may well find nothing
    coords = RecordSource(config.data.records)[0].coords.astype(np.int32)
    latents = pipeline.sample_latents([coords], condition, jax.random.key(1))
    (grid,) = pipeline.decode([coords], latents)
    assert np.array_equal(grid.coords, coords) and len(assemble(grid).parts) >= 1
    boxes = np.array([[0, 0, 0, 1, 1, 1], [-0.4, 0, 0, 0.1, 0.5, 0.5]])
    layout = Layout(boxes, (Joint.fixed(),) * 2, (-1, 0), np.full((2, 3), 0.5), np.ones(2))
    condition = pipeline.following(seen, [layout])
    followed = pipeline.sample_latents([coords], condition, jax.random.key(1))
    assert np.abs(followed[0] - latents[0]).max() > 0


def test_a_resumed_stage_makes_no_second_state(trained, tmp_path, monkeypatch):
    config, workdir = trained
    work = tmp_path / "work"
    shutil.copytree(workdir, work)
    monkeypatch.setattr(stages.train_network, "create_state", None)
    longer = dataclasses.replace(config.structure_vae, steps=config.structure_vae.steps + 1)
    stages.run(dataclasses.replace(config, structure_vae=longer), ["structure_vae"], work)
    assert str(longer.steps) in {p.name for p in (work / "checkpoints/structure_vae").iterdir()}


def test_a_flow_is_not_finished_on_other_inputs(trained, tmp_path):
    config, workdir = trained
    copy = tmp_path / "work"
    shutil.copytree(workdir, copy)
    longer = dataclasses.replace(
        config, latent_flow=dataclasses.replace(config.latent_flow, steps=3)
    )
    encoder = copy / "export" / "image_encoder.safetensors"
    data = bytearray(encoder.read_bytes())
    data[-1] ^= 1  # another mantissa bit of one weight
    encoder.write_bytes(data)
    with pytest.raises(ValueError, match="trained on other inputs"):
        stages.run(longer, ["latent_flow"], copy)


def test_a_flow_says_which_network_it_lacks(trained, tmp_path):
    config, workdir = trained
    copy = tmp_path / "work"
    shutil.copytree(workdir, copy)
    (copy / "export" / "image_encoder.safetensors").unlink()
    with pytest.raises(FileNotFoundError, match="image_encoder"):
        stages.run(config, ["structure_flow"], copy)


def test_the_metric_of_the_latents_found_is_positive_definite(trained):
    config, workdir = trained
    metric = encoding.latent_metric(workdir / "latents", config.data.records, 0.5)
    assert metric.shape == (4, 4) and np.linalg.eigvalsh(metric).min() >= 0.5 / 4 - 1e-5


def test_training_goes_on_from_another_checkpoint(trained, tmp_path):
    """Learning rate 0: the trained stage ends with the weights that it began with; the others are
    taken as they are, and all of it loads."""
    config, workdir = trained
    still = dataclasses.replace(config.structure_flow, steps=1, learning_rate=0.0, weight_decay=0.0)
    frozen = dataclasses.replace(config, structure_flow=still)
    stages.run(frozen, ["structure_flow"], tmp_path / "work", init=workdir)
    for path in (workdir / "export").glob("*.safetensors"):
        before, after = load_file(path), load_file(tmp_path / "work" / "export" / path.name)
        assert all(np.array_equal(before[name], after[name]) for name in before), path
    assert uniart_jax.load(tmp_path / "work").config.name == "debug"


@pytest.mark.slow
def test_a_flows_step_sees_by_the_exported_encoder(trained):
    config, workdir = trained
    mesh, network = make_mesh(config.mesh), build("structure_flow", config.model)
    statistics = encoding.encode_all(config, workdir)
    optimizer = make_optimizer(config.structure_flow)
    step = make_step(
        STAGES["structure_flow"], network, optimizer, config, workdir, mesh, statistics
    )
    key = jax.random.key(1)

    def init(key):  # a fresh flow hears nothing yet
        leaves, tree = jax.tree.flatten(network.init(key))
        return jax.tree.unflatten(
            tree, [leaf + 0.1 * jax.random.normal(key, leaf.shape) for leaf in leaves]
        )

    state = create_state(init, optimizer, key, mesh)
    with contextlib.closing(iter(stage_batches(STAGES["structure_flow"], config, workdir))) as it:
        batch = make_put(STAGES["structure_flow"], mesh, config.model)(next(it))
    loss_fn = make_structure_flow_loss(network, config, *statistics["structure"])

    @jax.jit
    def loss(seen):
        seen = seen._replace(layout=batch.layout)
        shown = batch._replace(image=None, seen=seen)
        return loss_fn(state.params, shown, jax.random.fold_in(key, 0))[0]

    see = load_conditioner(config, workdir)
    expected, bent = loss(see(batch.image)), loss(see(1 - batch.image))
    assert abs(bent - expected) > 1e-3 * abs(expected)
    found = step(state, batch, key)[1]["loss"]
    np.testing.assert_allclose(found, expected, rtol=1e-5)


@pytest.mark.parametrize("name", ["structure_flow", "uniart_vae"])  # trained, taken over
def test_a_checkpoint_that_does_not_fit_leaves_nothing(trained, tmp_path, name):
    config, workdir = trained
    deeper = dataclasses.replace(getattr(config.model, name), num_blocks=3)
    other = dataclasses.replace(config, model=dataclasses.replace(config.model, **{name: deeper}))
    with pytest.raises(ValueError, match=rf"{name}\.safetensors does not fit"):
        stages.run(other, ["structure_flow"], tmp_path / "work", init=workdir)
    assert not (tmp_path / "work").exists()


def test_flows_are_copied_only_with_their_encoder_and_vaes(trained, tmp_path):
    config, workdir = trained
    source, empty = Checkpoint.find(workdir), Checkpoint.of_workdir(tmp_path / "empty")
    assert networks_to_copy(config, source, ["image_encoder"], empty) == [
        "structure_vae",
        "uniart_vae",
    ]
    rest = networks_to_copy(config, source, ["latent_flow"], empty)
    assert rest == ["image_encoder", "structure_vae", "uniart_vae", "structure_flow"]
    source.copy_networks(rest, empty.folder)
    assert {path.stem for path in (tmp_path / "empty/export").iterdir()} == {*rest, "latent_stats"}
    statistics = load_file(tmp_path / "empty/export/latent_stats.safetensors")
    assert set(statistics) == {"structure.mean", "structure.std"}  # the other flow is not there yet
    shutil.copytree(workdir / "export", tmp_path / "own" / "export")
    vae = tmp_path / "own" / "export" / "uniart_vae.safetensors"
    vae.write_bytes(vae.read_bytes()[:-1] + b"x")
    (tmp_path / "own" / "export" / "structure_flow.safetensors").unlink()
    own = Checkpoint.of_workdir(tmp_path / "own")
    assert networks_to_copy(config, source, ["latent_flow"], own) == []


@pytest.mark.slow
def test_training_goes_on_from_a_checkpoint_with_one_flow(trained, tmp_path):
    config, workdir = trained
    others = [n for n in NETWORKS if n != "latent_flow"]
    Checkpoint.find(workdir).copy_networks(others, tmp_path / "source")
    still = dataclasses.replace(config.structure_flow, steps=1, learning_rate=0.0, weight_decay=0.0)
    frozen = dataclasses.replace(config, structure_flow=still)
    stages.run(frozen, ["structure_flow"], tmp_path / "work", init=tmp_path / "source")
    statistics = load_file(tmp_path / "work/export/latent_stats.safetensors")
    assert set(statistics) == {"structure.mean", "structure.std"}


@pytest.mark.slow
def test_a_flow_leaves_the_other_ones_statistics(trained, tmp_path):
    config, workdir = trained
    shutil.copytree(workdir, tmp_path / "work")
    write_statistics(tmp_path / "work/export", "structure", np.full(8, 7.0), np.ones(8))
    longer = dataclasses.replace(config.latent_flow, steps=3)
    stages.run(dataclasses.replace(config, latent_flow=longer), ["latent_flow"], tmp_path / "work")
    statistics = load_file(tmp_path / "work/export/latent_stats.safetensors")
    assert (statistics["structure.mean"] == 7).all()


def test_a_layout_network_is_copied_where_the_model_has_one(trained, tmp_path):
    config, _ = trained
    (tmp_path / "source").mkdir()
    (tmp_path / "source/layout.safetensors").touch()
    model = dataclasses.replace(config.model, layout=LayoutConfig(queries=4, image_size=32))
    for one, wanted in ((config, []), (dataclasses.replace(config, model=model), ["layout"])):
        assert Checkpoint(tmp_path / "source").copyable(one, ["structure_flow"]) == wanted


@pytest.mark.parametrize(("share", "message"), [(1.5, "give 0 to 1"), (0.5, "layout_channels")])
def test_layouts_are_found_only_for_flows_that_see_them(trained, tmp_path, share, message):
    config, workdir = trained
    loss = dataclasses.replace(config.loss, found=share)
    with pytest.raises(ValueError, match=rf"loss\.found.*{message}"):
        stages.run(
            dataclasses.replace(config, loss=loss), ["latent_flow"], tmp_path / "w", init=workdir
        )
    assert not (tmp_path / "w").exists()


def test_a_layout_network_must_be_there_before_anything_is_written(trained, tmp_path):
    config, workdir = trained
    model = dataclasses.replace(
        config.model,
        layout=LayoutConfig(queries=4, image_size=32),
        latent_flow=dataclasses.replace(config.model.latent_flow, layout_channels=4),
    )
    loss = dataclasses.replace(config.loss, found=0.5)
    changed = dataclasses.replace(config, model=model, loss=loss)
    with pytest.raises(FileNotFoundError, match="--stage layout"):
        stages.run(changed, ["latent_flow"], tmp_path / "w", init=workdir)
    assert not (tmp_path / "w").exists()
    empty = Checkpoint.of_workdir(tmp_path)
    check_found(changed, [STAGES["latent_flow"]], empty, ["layout"])
    check_found(changed, [STAGES["uniart_vae"]], empty, [])  # sees nothing sampled


def test_records_of_other_settings_are_refused(trained, tmp_path):
    config, _ = trained
    data = config.data
    for changes, said in (
        ({"views": 3}, "views 2 instead of 3"),
        ({"world": "wide"}, "world seven instead of wide"),
        ({"records": data.validation, "procedural": 1}, "start_seed 900000 instead of 0"),
    ):
        other = dataclasses.replace(config, data=dataclasses.replace(data, **changes))
        with pytest.raises(ValueError, match=said):
            stages.run(other, ["structure_vae"], tmp_path / "work")


@pytest.mark.slow
def test_evaluation_is_the_same_in_workers(trained, tmp_path):
    """Every row of the table, with pictures and assets; the weights are noise, so only their being
    there is looked at."""
    config, workdir = trained
    for processes in (1, 2):
        evaluate_checkpoint(
            str(workdir),
            tmp_path / str(processes),
            count=3,
            records=config.data.records,
            pictures=1,
            families=("kettle",),
            processes=processes,
        )
    texts = [(tmp_path / name / "metrics.json").read_text() for name in ("1", "2")]
    assert texts[0] == texts[1]
    results = json.loads(texts[0])
    rows = {"representation", "vae", "latent_flow", "image_to_object", "retrieval"}
    assert set(results["rows"]) == rows and len(list((tmp_path / "1" / "pictures").iterdir())) == 1
    assert results["assets"]["yourdfpy"] == 1.0
    assert results["rows"]["representation"]["watertight"] == 1.0
    assert {row["objects"] for row in results["rows"].values()} == {3.0}
    assert results["families"].keys() == {"kettle"}


def test_retrieval_among_held_out_objects_is_refused(trained, tmp_path):
    config, workdir = trained
    prepare_procedural(
        tmp_path / "records", 1, start_seed=procedural.HELD_OUT_SEED, grid=config.model.grid, image_size=32, processes=1  # noqa: E501
    )  # fmt: skip
    last = procedural.HELD_OUT_SEED
    with pytest.raises(ValueError, match="holds held-out objects"):
        make_retrieval(uniart_jax.load(workdir), tmp_path / "records", last + 100)


def test_retrieval_among_validation_objects_under_test_is_refused(trained, tmp_path):
    config, workdir = trained
    prepare_procedural(
        tmp_path, 1, start_seed=900_007, grid=config.model.grid, image_size=32, processes=1
    )  # fmt: skip
    pipeline = uniart_jax.load(workdir)
    with pytest.raises(ValueError, match=r"holds validation objects \(seed 900007\)"):
        make_retrieval(pipeline, tmp_path, first_seed=900_000)
    assert make_retrieval(pipeline, tmp_path) is not None  # held-out objects are others

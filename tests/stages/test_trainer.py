"""The table of stages, and training from Python on batches of one's own."""

import dataclasses
import json
import sys
import typing
from pathlib import Path

import jax
import numpy as np
import pytest
from safetensors.numpy import load_file

import uniart_jax
from uniart_jax import config as names
from uniart_jax.cli.train import Stage as TrainStage
from uniart_jax.models.checkpoint import FLOW_INPUTS, Checkpoint
from uniart_jax.models.checkpoint_files import write_config, write_network, write_statistics
from uniart_jax.models.network import IMAGE_ENCODERS, build
from uniart_jax.stages import STAGES, Stage, Trainer
from uniart_jax.stages.flows import fixed_statistics
from uniart_jax.stages.train_network import CountedBatches
from uniart_jax.stages.trainer import trainable

sys.path += [str(Path(__file__).parents[1] / name) for name in ("training", "data")]
import tiny_run


def test_the_table_holds_every_stage_in_the_order_of_the_config():
    assert tuple(STAGES) == names.STAGES
    config = tiny_run.make_config(Path("nowhere"))
    for name, stage in STAGES.items():
        assert isinstance(stage, Stage) and stage.name == name
        assert stage.settings(config) is getattr(config, name)
        assert set(stage.wanted + stage.needed) <= set(stage.batch._fields)
    assert typing.get_args(TrainStage) == ("all", *STAGES)
    assert {stage.latent for stage in STAGES.values()} == {"", "structure", "latent"}


def test_stages_without_anything_to_train_say_why():
    config = tiny_run.make_config(Path("nowhere"))
    assert trainable(config, ["layout", "uniart_vae"]) == ["uniart_vae"]
    with pytest.raises(
        ValueError, match=r"stage layout: the config has none; give --model\.layout"
    ):
        trainable(config, ["layout"])
    with pytest.raises(ValueError, match="stage vae: unknown; choose one of image_encoder, "):
        trainable(config, ["vae"])


def test_more_views_than_records_have_are_refused_before_any_work(tmp_path):
    config = tiny_run.make_config(tmp_path)  # no records there yet: as many as it would prepare
    for views in (0, config.data.views + 1):
        data = dataclasses.replace(config.data, condition_views=views)
        with pytest.raises(ValueError, match=f"condition_views is {views}, records have 2 views"):
            Trainer(dataclasses.replace(config, data=data), tmp_path / "w").fit("latent_flow")
    assert not (tmp_path / "w").exists()


@pytest.mark.parametrize("stage", ["image_encoder", "structure_flow", "latent_flow"])
def test_pictures_of_another_size_are_refused_before_any_work(tmp_path, stage):
    config = tiny_run.make_config(tmp_path)
    folder = Path(config.data.records)
    folder.mkdir(parents=True)
    size = config.model.image_encoder.image_size
    (folder / "metadata.json").write_text(json.dumps({"image_size": 2 * size, "views": 2}))
    with pytest.raises(ValueError, match=f"{2 * size} pixels a side.*--image-size {size}"):
        Trainer(config, tmp_path / "w").fit(stage)
    assert not (tmp_path / "w").exists()


def test_pictures_of_another_size_are_refused_by_a_vae_that_reads_samples(tmp_path):
    config = tiny_run.make_config(tmp_path)
    folder = Path(config.data.records)
    folder.mkdir(parents=True)
    size = config.model.image_encoder.image_size
    (folder / "metadata.json").write_text(json.dumps({"image_size": 2 * size, "views": 2}))
    STAGES["uniart_vae"].check(config)
    sampled = dataclasses.replace(config.loss, sampled=0.5)
    with pytest.raises(ValueError, match=f"--image-size {size}"):
        STAGES["uniart_vae"].check(dataclasses.replace(config, loss=sampled))


def occupancies(config, count):
    """Batches of boxes of random sizes."""
    rng, side = np.random.default_rng(0), config.model.grid.resolution
    items = config.structure_vae.batch_size
    for _ in range(count):
        low = rng.integers(0, side // 2, (items, 1, 1, 1, 3))
        high = rng.integers(side // 2, side, (items, 1, 1, 1, 3))
        cells = np.stack(np.indices((side,) * 3), -1)[None]
        yield {"occupancy": ((cells >= low) & (cells <= high)).all(-1)}


def quickest(folder):
    """A structure VAE of one level; without records."""
    config = tiny_run.make_config(folder)
    vae = dataclasses.replace(config.model.structure_vae, channels=(8,), num_res_blocks_middle=0)
    return dataclasses.replace(
        config,
        model=dataclasses.replace(config.model, structure_vae=vae),
        data=dataclasses.replace(config.data, records=""),
    )


def trained(config, workdir, steps, batches, init=None):
    stage = dataclasses.replace(config.structure_vae, steps=steps, save_every=2)
    config = dataclasses.replace(config, structure_vae=stage)
    trainer = Trainer(config, workdir, init).fit("structure_vae", batches)
    return load_file(trainer.workdir / "export" / "structure_vae.safetensors")


def test_batches_of_ones_own_need_no_records_and_resume(tmp_path):
    config = quickest(tmp_path)
    batches = list(occupancies(config, 3))
    straight = trained(config, tmp_path / "straight", 3, batches)
    with pytest.raises(ValueError, match="the data ended"):
        trained(config, tmp_path / "parts", 3, batches[:2])
    resumed = trained(config, tmp_path / "parts", 3, batches)
    other = trained(config, tmp_path / "other", 3, batches[::-1])
    for key, value in straight.items():
        np.testing.assert_array_equal(resumed[key], value)
    assert any((other[key] != value).any() for key, value in straight.items())
    with pytest.raises(ValueError, match="batches are of one stage; name it"):
        Trainer(config, tmp_path / "all").fit(batches=batches)
    with pytest.raises(FileNotFoundError):
        Trainer(config, tmp_path / "straight").pipeline()  # other networks are missing


def test_a_network_that_the_checkpoint_lacks_begins_from_scratch(tmp_path, capsys):
    config, source = quickest(tmp_path), tmp_path / "source"
    encoder = build("image_encoder", config.model).init(jax.random.key(3))
    write_network(source, "image_encoder", encoder)
    write_config(source, config)
    batches = list(occupancies(config, 1))
    alone = trained(config, tmp_path / "alone", 1, batches)
    capsys.readouterr()
    beside = trained(config, tmp_path / "beside", 1, batches, source)
    told = " ".join(capsys.readouterr().err.split())
    assert f"structure_vae: not in {source}, so it begins from scratch" in told
    for key, value in alone.items():
        np.testing.assert_array_equal(beside[key], value)
    taken = tmp_path / "beside" / "export" / "image_encoder.safetensors"
    assert taken.read_bytes() == (source / taken.name).read_bytes()
    write_config(tmp_path / "empty", config)
    with pytest.raises(FileNotFoundError, match=r"empty: there is no network in it to go on from"):
        trained(config, tmp_path / "none", 1, batches, tmp_path / "empty")
    assert not (tmp_path / "none").exists()


def test_a_flow_that_is_new_takes_the_records_statistics(tmp_path):
    source = Checkpoint(tmp_path / "source")
    source.folder.mkdir()
    for name in FLOW_INPUTS:
        (source.folder / f"{name}.safetensors").touch()
    write_statistics(source.folder, "structure", np.full(4, 7.0), np.ones(4))
    assert fixed_statistics(source, tmp_path / "w", "structure_flow") is None
    (source.folder / "structure_flow.safetensors").touch()
    mean, _ = fixed_statistics(source, tmp_path / "w", "structure_flow")
    assert (mean == 7).all()


def test_every_image_encoder_has_a_network_and_a_kind():
    assert set(names.IMAGE_ENCODERS) == set(IMAGE_ENCODERS)
    for name in IMAGE_ENCODERS:
        assert names.ImageEncoderConfig(architecture=name).kind is names.IMAGE_ENCODERS[name]


def test_a_stage_without_settings_of_its_name_is_told():
    class Another(type(STAGES["structure_vae"])):
        name = "another"

    with pytest.raises(ValueError, match="stage another: the config has no StageConfig of this"):
        Another().settings(names.Config())
    with pytest.raises(ValueError, match="the config has no StageConfig"):
        type("Data", (Another,), {"name": "data"})().settings(names.Config())


def test_counted_batches_go_back_and_forth():
    counted = CountedBatches(range(5))
    assert [next(counted), next(counted)] == [0, 1]
    counted.set_state({"read": 4})
    assert next(counted) == 4
    counted.set_state({"read": 1})
    assert next(counted) == 1 and counted.get_state() == {"read": 2}


class Placed:
    """An iterator with a place and nothing to close."""

    def __init__(self, batches):
        self.batches, self.at = batches, 0

    def __next__(self):
        self.at += 1
        return self.batches[self.at - 1]

    def __iter__(self):
        return self

    def get_state(self):
        return {"at": self.at}

    def set_state(self, state):
        self.at = state["at"]


@pytest.mark.slow
def test_an_iterator_with_a_place_of_its_own_needs_nothing_to_close(tmp_path):
    config = quickest(tmp_path)
    batches = list(occupancies(config, 3))
    own = trained(config, tmp_path / "own", 3, Placed(batches))
    counted = trained(config, tmp_path / "counted", 3, batches)
    for key, value in counted.items():
        np.testing.assert_array_equal(own[key], value)


def test_batches_that_cannot_be_gone_on_with_are_told(tmp_path):
    generator = CountedBatches(iter(range(5)))
    for _ in range(3):
        next(generator)
    with pytest.raises(ValueError, match=r"batch 3 of an iterator was read, .* from batch 1; give"):
        generator.set_state({"read": 1})
    with pytest.raises(ValueError, match="goes on from batch 7, and there are 5; give as many"):
        CountedBatches(range(5)).set_state({"read": 7})
    config = quickest(tmp_path)
    with pytest.raises(ValueError, match="structure_vae: a batch has no 'occupancy', which the"):
        trained(config, tmp_path / "w", 2, [{"image": np.zeros(2)}] * 2)
    flat = [{"occupancy": np.zeros((2, 8, 8), bool)}] * 2
    with pytest.raises(ValueError, match="structure_vae: batch 'occupancy' has the shape "):
        trained(config, tmp_path / "w", 2, flat)
    with pytest.raises(ValueError, match="no stage was given; choose of image_encoder, "):
        Trainer(config, tmp_path / "w").fit([])


def test_the_trainer_is_public():
    assert uniart_jax.Trainer is Trainer
    assert Trainer(tiny_run.make_config(Path("x"))).workdir.parts[0] == "runs"

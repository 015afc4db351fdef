"""The stage of the mask network: who has it, what it begins with, how it is judged."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from drawn import parameters

from uniart_jax import stages
from uniart_jax.config import Config, MaskConfig, ModelConfig, load_config
from uniart_jax.models.network import build
from uniart_jax.stages import STAGES, trainer
from uniart_jax.stages import mask as stage_file
from uniart_jax.voxels.typed_batches import MaskBatch

STAGE = STAGES["mask"]
MODEL = ModelConfig(mask=MaskConfig(channels=8, width=16, image_size=64))


def test_only_models_that_have_the_network_train_it():
    assert "--model.mask.channels 64" in STAGE.left_out(Config().model)
    assert STAGE.left_out(MODEL) == "" and STAGE.makes_data
    assert MODEL.networks()[-1] == "mask" and "mask" not in Config().model.networks()


def test_without_the_published_weights_nothing_begins(monkeypatch):
    def missing():
        raise FileNotFoundError("efficientnet_lite0: its ImageNet weights are not installed")

    monkeypatch.setattr(stage_file, "find_published", missing)
    with pytest.raises(FileNotFoundError, match="not installed"):
        STAGE.check_first_weights(Config(model=MODEL))


def test_a_training_that_goes_on_needs_no_published_weights(monkeypatch, tmp_path):
    def missing():
        raise FileNotFoundError("efficientnet_lite0: its ImageNet weights are not installed")

    begun = []
    monkeypatch.setattr(stage_file, "find_published", missing)
    monkeypatch.setattr(trainer, "train_network", lambda stage, *rest: begun.append(stage.name))
    config = load_config("configs/nano.py")
    with pytest.raises(FileNotFoundError, match="not installed"):
        stages.run(config, ["mask"], tmp_path / "new")
    assert not (tmp_path / "new").exists() and not begun
    stages.run(config, ["mask"], tmp_path / "on", init="nano")
    assert begun == ["mask"]
    (tmp_path / "resumed/checkpoints/mask").mkdir(parents=True)
    stages.run(config, ["mask"], tmp_path / "resumed")
    assert begun == ["mask", "mask"]


def test_it_begins_with_the_published_backbone(monkeypatch):
    monkeypatch.setattr(stage_file, "published_backbone", lambda: {"stem": 1})
    assert STAGE.first_weights(Config(model=MODEL)) == {"backbone": {"stem": 1}}


def test_the_evaluation_tells_how_much_masks_overlap(monkeypatch):
    rng = np.random.default_rng(0)
    masks = np.zeros((3, 64, 64), np.float32)
    masks[:2] = 1  # two pictures are all object, one has none
    truth = MaskBatch(rng.random((3, 64, 64, 3)).astype(np.float32), masks)
    monkeypatch.setattr(stage_file, "validation_scenes", lambda data, model, count: truth)
    params = parameters(build("mask", MODEL))
    out = params["out"]
    sure = {"kernel": np.zeros_like(out["kernel"]), "bias": np.full_like(out["bias"], 5)}
    config = dataclasses.replace(Config(), model=MODEL)
    evaluate = STAGE.evaluation(config, None, None)
    figures, pictures = evaluate(SimpleNamespace(ema={**params, "out": sure}), 1)
    assert figures["iou"] == pytest.approx(2 / 3)  # all is taken for the object
    assert figures["worst tenth"] == pytest.approx(0.2)
    assert pictures["mask"].shape == (3 * 64, 3 * 64, 3)
    np.testing.assert_array_equal(pictures["mask"][:64, 64:128], 1)

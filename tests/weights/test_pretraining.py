"""From a folder in TRELLIS's layout to networks trained on: convert, read features, train with
parts frozen, load. Random weights, toy size."""

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest
from hand_records import make_record, write_folder
from official import write_folder as write_official
from safetensors.numpy import load_file, save_file
from test_convert import BUFFERS, ENCODER, dinov2_state

import uniart_jax
from uniart_jax import cli, stages
from uniart_jax.config import NETWORKS, DataConfig, StageConfig
from uniart_jax.data.geometric_features import CHANNELS as GEOMETRIC_CHANNELS
from uniart_jax.experiments.reinit_aggregation import reinit_aggregation
from uniart_jax.models.aggregation import AGGREGATIONS
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.network import build, flat_names
from uniart_jax.precompute import features

sys.path.append(str(Path(__file__).parents[1] / "precompute"))
from feature_folders import orbit, write_orbits

FROZEN = {
    "structure_vae": ("encoder",),
    "uniart_vae": ("encoder.blocks",),
    "structure_flow": ("blocks",),
    "latent_flow": ("blocks.0", "input_layer"),
}


def convert(monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", ["uniart", "convert", *map(str, arguments)])
    with pytest.raises(SystemExit) as error:
        cli.main()
    assert error.value.code == 0


@pytest.mark.slow
def test_training_goes_on_from_trelliss_weights_and_leaves_what_is_frozen(tmp_path, monkeypatch):
    checkpoint = tmp_path / "checkpoint"
    write_official(tmp_path / "official", buffers=BUFFERS)
    save_file(dinov2_state(dataclasses.replace(ENCODER, width=24)), tmp_path / "dinov2.safetensors")
    convert(monkeypatch, "trellis", tmp_path / "official", "--out", checkpoint)
    convert(monkeypatch, "dinov2", tmp_path / "dinov2.safetensors", "--out", checkpoint)
    assert Checkpoint(checkpoint).untrained()
    model = Checkpoint(checkpoint).config.model

    grid, size = model.grid, model.image_encoder.image_size
    made = [
        make_record(k, 60 + 9 * k, 3, grid.resolution, grid.subdivisions, size) for k in range(4)
    ]
    folder = tmp_path / "records"
    folder.mkdir()
    write_folder(folder, made)
    write_orbits(folder, [(r.meta["id"], orbit(r, size)) for r in made])
    features.write_visual(folder, checkpoint / "image_encoder.safetensors", progress=False)
    features.write_geometric_features(folder, progress=False)
    # part features, which TRELLIS has none of: configs/paper.py has PartField's 448
    reads = dataclasses.replace(model.uniart_vae, part_feature_channels=GEOMETRIC_CHANNELS)
    model = dataclasses.replace(model, uniart_vae=reads)

    stage = StageConfig(
        steps=2,
        batch_size=2,
        warmup_steps=0,
        learning_rate=1e-3,
        log_every=1,
        evaluate_every=2,
        save_every=2,
    )
    config = dataclasses.replace(
        Checkpoint(checkpoint).config,
        model=model,
        untrained=(),
        data=DataConfig(records=str(folder), voxel_buckets=(128,), mirror_latents=False),
        **{name: dataclasses.replace(stage, freeze=kept) for name, kept in FROZEN.items()},
    )
    work = tmp_path / "work"
    stages.run(config, NETWORKS, work, init=checkpoint)

    for name, kept in FROZEN.items():
        # what is exported is rounded to half precision
        before, after = (
            {key: value.astype(np.float16) for key, value in load_file(file).items()}
            for file in (checkpoint / f"{name}.safetensors", work / "export" / f"{name}.safetensors")  # noqa: E501
        )  # fmt: skip
        assert before.keys() <= after.keys()
        frozen = {key for key in before if key.startswith(tuple(f"{k}." for k in kept))}
        same = {key for key in before if np.array_equal(after[key], before[key])}
        assert frozen and frozen <= same, name
        assert len(same - frozen) < 0.2 * len(before), name  # all else was trained on
    encoder = [
        p.read_bytes()
        for p in (
            checkpoint / "image_encoder.safetensors",
            work / "export" / "image_encoder.safetensors",
        )
    ]
    assert encoder[0] == encoder[1]
    assert not Checkpoint.of_workdir(work).untrained()
    assert uniart_jax.load(work).config.model == model
    heard = Checkpoint.find(work).load("uniart_vae")["front"]["part_feature"]["kernel"]
    assert np.asarray(heard).any()  # it began at zero

    # and so do the arms of Table 3
    for kind in set(AGGREGATIONS) - {"uniart"}:
        other = dataclasses.replace(model, uniart_vae=dataclasses.replace(reads, aggregation=kind))
        arm = dataclasses.replace(config, model=other)
        first = Checkpoint(reinit_aggregation(Checkpoint(checkpoint), arm, tmp_path / kind))
        loaded = first.load("uniart_vae", other, widen=True)
        missing = set(flat_names(build("uniart_vae", other).abstract())) - set(flat_names(loaded))
        assert {name.rpartition(".")[0] for name in missing} == {
            "front.part_feature",
            "part_feature_head",
        }

"""Trainings, encoding and samples that read features of voxels."""

from __future__ import annotations

import dataclasses

import jax
import numpy as np
import pytest
from feature_folders import COUNT, ENCODER, prepared, weights
from hand_records import features_of, make_record, write_items

from uniart_jax import stages
from uniart_jax.config import (
    Config,
    DataConfig,
    GridConfig,
    ModelConfig,
    StageConfig,
    StructureVAEConfig,
    UniArtVAEConfig,
)
from uniart_jax.data.latents import LatentSource
from uniart_jax.data.records import RecordSource
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.checkpoint_files import write_config
from uniart_jax.models.network import build, flat_names
from uniart_jax.pipeline import Pipeline
from uniart_jax.precompute import encoding, features


def toy(folder, **data):
    stage = StageConfig(
        steps=2, batch_size=2, warmup_steps=1, log_every=1, evaluate_every=2, save_every=2
    )
    return Config(
        model=ModelConfig(
            grid=GridConfig(8, 2, 8),
            image_encoder=dataclasses.replace(ENCODER, target_resolution=4),
            structure_vae=StructureVAEConfig(channels=(4, 8), latent_channels=2, num_res_blocks=1, num_res_blocks_middle=1),  # noqa: E501
            uniart_vae=UniArtVAEConfig(width=16, num_blocks=1, num_heads=2, latent_channels=4, attention="serial", window=16, visual_channels=12, part_feature_channels=3, geometry_channels=8, articulation_channels=8),  # noqa: E501
        ),
        data=DataConfig(records=str(folder), validation=str(folder), voxel_buckets=(96,), **data),
        uniart_vae=stage,
    )  # fmt: skip


@pytest.mark.slow
def test_training_and_encoding_read_the_columns_of_their_split(tmp_path):
    splits = ["test", "train", "train", "test", "train", "train"]
    folder = prepared(tmp_path / "records", splits=splits)
    config = toy(folder, split="train", validation_split="test")
    work = tmp_path / "work"
    with pytest.raises(
        ValueError, match=r"no column 'visual' .*make it with: uniart features .* --weights"
    ):
        stages.run(config, ("uniart_vae",), work)
    assert not work.exists()
    features.write_visual(folder, weights(tmp_path), progress=False)
    items = [
        (f"hand-{k}", {"values": features_of(make_record(k, voxels=20 + 9 * k), 3)})
        for k in range(COUNT)
    ]
    write_items(folder, "part_feature", items)
    stages.run(config, ("uniart_vae",), work)
    for name in ("structure_vae", "uniart_vae"):  # two steps from zeros leave little to compare
        weights(work / "export", network=build(name, config.model))
    before = encoding.digest(config, work, folder, "train")
    encoding.encode_all(config, work)
    latents, source = (
        LatentSource(work / "latents"),
        RecordSource(folder, "train", ("visual", "part_feature")),
    )
    assert [latents[i]["mirrored"] for i in range(len(latents))] == [False] * 4
    params = Checkpoint.find(work).load("uniart_vae")
    pipeline = Pipeline(config, {"uniart_vae": params}, {})
    for i in range(4):
        record = source[int(latents[i]["record"])]
        assert np.array_equal(latents[i]["coords"], record.coords)
        grid = record.grid()
        mean = pipeline.encode_voxels(grid, record.visual, record.part_feature)
        np.testing.assert_allclose(latents[i]["latent"], mean, atol=2e-3, rtol=2e-3)
        blind = pipeline.encode_voxels(grid, 0 * record.visual, record.part_feature)
        assert np.abs(blind - mean).max() > 0.1
    with pytest.raises(
        ValueError, match=r"this model reads visual \[\d+, 12\] with them, got none"
    ):
        pipeline.encode_voxels(grid, part_feature=record.part_feature)
    assert encoding.digest(config, work, folder, "test") != before
    (folder / "visual.json").write_text("{}")
    assert encoding.digest(config, work, folder, "train") != before


@pytest.mark.slow
def test_a_vae_that_read_no_part_features_goes_on_with_them(tmp_path):
    """It begins with the function that it was, trains on the features and their loss, and
    decodes."""
    folder = prepared(tmp_path / "records")
    items = [
        (f"hand-{k}", {"values": features_of(make_record(k, voxels=20 + 9 * k), 3)})
        for k in range(COUNT)
    ]
    write_items(folder, "part_feature", items)
    config = toy(folder)
    config = dataclasses.replace(config, data=dataclasses.replace(config.data, validation=""))
    reads = dataclasses.replace(config.model.uniart_vae, visual_channels=0)
    model = dataclasses.replace(config.model, uniart_vae=reads)
    config = dataclasses.replace(config, model=model)
    blind = dataclasses.replace(
        model, uniart_vae=dataclasses.replace(reads, part_feature_channels=0)
    )
    source, work = tmp_path / "source", tmp_path / "work"
    weights(source, network=build("uniart_vae", blind))
    write_config(source, dataclasses.replace(config, model=blind))

    network = build("uniart_vae", model)
    first = Checkpoint(source).load("uniart_vae", model, widen=True)
    record = RecordSource(folder, columns=("part_feature",))[0]
    fresh = jax.jit(network.init)(jax.random.key(1))
    given = {**fresh, **first, "front": {**fresh["front"], **first["front"]}}
    means = [
        Pipeline(dataclasses.replace(config, model=m), {"uniart_vae": p}, {}).encode_voxels(record.grid(), **more)  # noqa: E501
        for m, p, more in ((blind, first, {}), (model, given, {"part_feature": record.part_feature}))  # noqa: E501
    ]  # fmt: skip
    np.testing.assert_allclose(means[1], means[0], atol=1e-5)

    stages.run(config, ("uniart_vae",), work, init=source)
    after = Checkpoint.find(work).load("uniart_vae")
    new = {name for name in flat_names(after) if name not in flat_names(first)}
    assert new == {
        f"{layer}.{leaf}"
        for layer in ("front.part_feature", "part_feature_head")
        for leaf in ("kernel", "bias")
    }
    assert np.asarray(after["front"]["part_feature"]["kernel"]).any()  # it has learnt from them
    assert "part_feature" in (work / "metrics" / "uniart_vae.jsonl").read_text()
    pipeline = Pipeline(config, {"uniart_vae": after}, {})
    coords = record.coords.astype(np.int32)
    (grid,) = pipeline.decode([coords], [np.zeros((len(coords), 4), np.float32)])
    assert np.array_equal(grid.coords, coords) and grid.own_box.shape[-1] == 6

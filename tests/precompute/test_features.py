"""``uniart features``: features of voxels against a plain computation, killed runs, refusals, and
training that reads them."""

from __future__ import annotations

import dataclasses
import json
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest
from hand_records import features_of, make_record, write_folder, write_items
from PIL import Image

from uniart_jax import cli, stages
from uniart_jax.config import (
    Config,
    DataConfig,
    GridConfig,
    ImageEncoderConfig,
    ModelConfig,
    StageConfig,
    StructureVAEConfig,
    UniArtVAEConfig,
)
from uniart_jax.data import records
from uniart_jax.data.columns import column_path, pack_orbit
from uniart_jax.data.geometric_features import geometric_features
from uniart_jax.data.latents import LatentSource
from uniart_jax.data.part_features import CHANNELS, input_name, surface_points
from uniart_jax.data.records import RecordSource, shard_paths
from uniart_jax.data.shards import open_shards, write_shard
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.checkpoint_files import read_network, write_config, write_network
from uniart_jax.models.network import build, flat_names
from uniart_jax.pipeline import Pipeline
from uniart_jax.precompute import encoding, features, fill_columns, visual_features
from uniart_jax.visual.render import Camera, orbit_cameras

ENCODER = ImageEncoderConfig(
    architecture="dinov2", image_size=16, patch_size=4, registers=2, width=12, num_blocks=1, num_heads=1, mlp_ratio=2.0,  # noqa: E501
)  # fmt: skip
NETWORK = build("image_encoder", ModelConfig(image_encoder=ENCODER))
ENCODE = jax.jit(NETWORK.apply)
VIEWS, COUNT = 7, 6


def weights(folder, seed=0, network=NETWORK):
    rng = np.random.default_rng(seed)
    drawn = jax.tree.map(
        lambda s: rng.normal(0, 0.3, s.shape).astype(np.float32), network.abstract()
    )
    return write_network(folder, network.name, drawn, "stored")


def orbit(record, size=16, views=VIEWS):
    rng = np.random.default_rng(record.meta["seed"])
    cameras = [(c.azimuth, c.elevation, c.fov_degrees, c.distance) for c in orbit_cameras(views)]
    images = rng.integers(0, 256, (views, size, size, 4)).astype(np.uint8)
    return {"images": images, "cameras": np.array(cameras, np.float32)}


def prepared(folder, size=16, splits=None):
    folder.mkdir()
    made = [make_record(k, voxels=20 + 9 * k) for k in range(COUNT)]
    write_folder(folder, made, splits)
    write_orbits(folder, [(r.meta["id"], orbit(r, size)) for r in made])
    return folder


def write_orbits(folder, made):
    """``made``: (record's id, its orbit), in the records' order."""
    at = 0
    for shard in shard_paths(folder):
        count = len(open_shards([shard]))
        items = [pack_orbit(o["images"], o["cameras"], name) for name, o in made[at : at + count]]
        write_shard(column_path(shard, "orbit"), items)
        at += count


@pytest.fixture
def folder(tmp_path):
    return prepared(tmp_path / "records")


def column(folder, name="visual"):
    return {p.name: p.read_bytes() for p in sorted(folder.glob(f"{name}[-.]*"))}


def reference(record, images, cameras, params):
    """Pixel by pixel: the renderer's own projection, four corners of the patch map, zeros beyond
    it, the mean over all views."""
    centers = (record.coords + 0.5) / record.resolution - 0.5
    total = np.zeros((len(centers), ENCODER.width))
    for image, camera in zip(images, cameras, strict=True):
        if len(image) != 16:
            image = np.asarray(Image.fromarray(image).resize((16, 16), Image.Resampling.LANCZOS))
        picture = image / np.float32(255)
        patches = np.asarray(
            ENCODE(params, (picture[..., :3] * picture[..., 3:])[None])["patches"][0]
        )
        for v, (x, y) in enumerate(Camera(*camera).project(centers, 16) / 4 - 0.5):
            for column in (int(np.floor(x)), int(np.floor(x)) + 1):
                for row in (int(np.floor(y)), int(np.floor(y)) + 1):
                    if 0 <= column < 4 and 0 <= row < 4:
                        total[v] += (
                            (1 - abs(x - column)) * (1 - abs(y - row)) * patches[row, column]
                        )
    return total / len(images)


@pytest.mark.parametrize("size", [16, 23])
def test_a_voxel_holds_the_mean_of_what_it_reads_in_all_views(tmp_path, size):
    folder = prepared(tmp_path / "records", size)
    file = weights(tmp_path)
    features.write_visual(folder, file, batch=3, progress=False)
    params = read_network(file, NETWORK.abstract())
    source = RecordSource(folder, columns=("visual",))
    for index in (0, 5):  # of both shards
        record, seen = source[index], orbit(source[index], size)
        expected = reference(record, **seen, params=params)
        assert record.visual.dtype == np.float16 and np.abs(expected).max() > 0.1
        np.testing.assert_allclose(record.visual, expected, atol=2e-3, rtol=2e-3)


def test_padding_and_batches_change_nothing(folder, tmp_path, monkeypatch):
    file = weights(tmp_path)
    features.write_visual(folder, file, batch=7, progress=False)
    first = [item.visual for item in RecordSource(folder, columns=("visual",))]
    for path in folder.glob("visual*"):
        path.unlink()
    monkeypatch.setattr(visual_features, "VOXEL_STEP", 70)
    features.write_visual(folder, file, batch=4, progress=False)
    for item, other in zip(RecordSource(folder, columns=("visual",)), first, strict=True):
        np.testing.assert_allclose(item.visual, other, atol=1e-3)


def test_fewer_views_are_spread_over_the_sphere(folder, tmp_path):
    cameras = orbit(make_record())["cameras"]
    assert visual_features.spread_views(cameras, 9).tolist() == list(range(VIEWS))
    many = np.array([(c.azimuth, c.elevation, 40, 2) for c in orbit_cameras(150)], np.float32)
    chosen = visual_features.spread_views(many, 24)
    assert len(set(chosen.tolist())) == 24 and (np.diff(chosen) > 0).all()
    forward = np.stack([Camera(*many[i]).matrix()[2, :3] for i in chosen])
    angles = np.degrees(np.arccos(np.clip(forward @ forward.T, -1, 1))) + 360 * np.eye(24)
    assert angles.min() > 25  # 24 caps that fill the sphere are 47 degrees wide
    file = weights(tmp_path)
    features.write_visual(folder, file, views=3, progress=False)
    record = RecordSource(folder, columns=("visual",))[1]
    seen, params = orbit(record), read_network(file, NETWORK.abstract())
    three = visual_features.spread_views(cameras, 3)
    expected = reference(record, seen["images"][three], cameras[three], params)
    np.testing.assert_allclose(record.visual, expected, atol=2e-3, rtol=2e-3)


KILLED = """
import os, signal, sys
sys.path.insert(0, sys.argv[2])
import numpy as np
from hand_records import features_of
from uniart_jax.precompute.fill_columns import fill_column, records_of

def make(shard):
    for row, record in records_of(shard):
        if record.meta["seed"] == 5:
            os.kill(os.getpid(), signal.SIGKILL)
        yield record, features_of(record, 3)

fill_column(sys.argv[1], "visual", {"weights": "x"}, make, progress=False)
"""


def test_a_killed_run_goes_on_and_ends_with_the_same_bytes(folder, tmp_path):
    def make(shard):
        yield from (
            (record, features_of(record, 3)) for _, record in fill_columns.records_of(shard)
        )

    whole = prepared(tmp_path / "whole")
    fill_columns.fill_column(whole, "visual", {"weights": "x"}, make, progress=False)
    run = subprocess.run(
        [sys.executable, "-c", KILLED, folder, Path(__file__).parent.parent / "data"],
        env={"JAX_PLATFORMS": "cpu", "PYTHONPATH": str(Path(__file__).parents[2])},
    )
    assert run.returncode == -signal.SIGKILL
    assert set(column(folder)) == {"visual-00000.arrayrecord", "visual.json"}
    with pytest.raises(ValueError, match=r"unfinished column 'visual' \(1 of 2"):
        RecordSource(folder, columns=("visual",))
    kept = (folder / "visual-00000.arrayrecord").stat().st_mtime_ns
    fill_columns.fill_column(folder, "visual", {"weights": "x"}, make, progress=False)
    assert (folder / "visual-00000.arrayrecord").stat().st_mtime_ns == kept
    assert column(folder) == column(whole)
    # prepare may have made a last shard longer since: it is made again
    records.write_shard(
        folder / "visual-00001.arrayrecord", [records.pack_arrays({}, {"id": "hand-4"})]
    )
    fill_columns.fill_column(folder, "visual", {"weights": "x"}, make, progress=False)
    assert column(folder) == column(whole)


def test_several_runs_share_a_folder(folder, tmp_path):
    file, whole = weights(tmp_path), prepared(tmp_path / "whole")
    features.write_visual(whole, file, progress=False)
    cli.features(folder, weights=file, shard="1/2")
    assert set(column(folder)) == {"visual-00001.arrayrecord", "visual.json"}
    cli.features(folder, weights=file, shard="0/2")
    assert column(folder) == column(whole)


def test_refusals_are_one_line(folder, tmp_path, capsys):
    def complaint(*arguments, error=ValueError, **options):
        with pytest.raises(error) as found:
            cli.features(*arguments, **options)
        assert "\n" not in str(found.value)
        return str(found.value)

    file = weights(tmp_path)
    other = weights(tmp_path / "other", seed=1)
    assert "give --weights, --part-features or --export-points" in complaint(folder)
    assert "--shard must be i/n" in complaint(folder, weights=file, shard="2/2")
    assert "at least 1" in complaint(folder, weights=file, batch=0)
    assert "7 orbit pictures, --views asks for 8" in complaint(folder, weights=file, views=8)
    missing = complaint(folder, weights=tmp_path / "a.safetensors", error=FileNotFoundError)
    assert "uniart convert dinov2" in missing
    (tmp_path / "bad.safetensors").write_bytes(b"nonsense")
    assert "bad.safetensors" in complaint(folder, weights=tmp_path / "bad.safetensors")
    write_network(tmp_path, "vae", {"x": np.zeros(3)}, "stored")
    assert "not a converted DINOv2: it lacks pos_embed" in complaint(
        folder, weights=tmp_path / "vae.safetensors"
    )
    features.write_visual(folder, file, part=(0, 2), progress=False)
    assert "made from something else: weights" in complaint(folder, weights=other)
    assert "views 7 (now: 5)" in complaint(folder, weights=file, views=5)
    (folder / "visual.json").unlink()
    assert "so its source is unknown" in complaint(folder, weights=file)
    items = [(f"hand-{k}", orbit(make_record(k), views=VIEWS - 2 * (k == 5))) for k in range(COUNT)]
    for path in folder.glob("visual*"):
        path.unlink()
    write_orbits(folder, items)
    assert "column 'orbit' of 'hand-5': 5 pictures, not 7" in complaint(folder, weights=file)
    for path in folder.glob("orbit*"):
        path.unlink()
    assert "make it with: uniart prepare … --orbit-views" in complaint(folder, weights=file)
    nowhere = complaint(folder, part_features=tmp_path / "nowhere", error=FileNotFoundError)
    assert "no such folder" in nowhere
    empty = complaint(folder, part_features=tmp_path, error=FileNotFoundError)
    assert f"part_feat_{input_name(0, 0, 'hand-0')}_0.npy" in empty


def test_part_features_from_partfields_own_files(folder, tmp_path):
    cli.features(folder, export_points=tmp_path / "points")
    names = sorted(p.stem for p in (tmp_path / "points").iterdir())
    assert names == [input_name(k // 4, k % 4, f"hand-{k}") for k in range(COUNT)]
    results = tmp_path / "results"
    results.mkdir()
    source = RecordSource(folder)
    for k, name in enumerate(names):  # what PartField does with a point cloud
        points = surface_points(source[k])
        low, high = points.min(0), points.max(0)
        (results / f"feat_pca_{name}_0.ply").write_bytes(
            (tmp_path / "points" / f"{name}.ply").read_bytes()
        )
        features.write_points(
            results / f"feat_pca_{name}_0.ply",
            (points - (low + high) / 2) * (1.8 / (high - low).max()),
        )
        np.save(results / f"part_feat_{name}_0.npy", np.repeat(points.sum(1)[:, None], CHANNELS, 1))
    cli.features(folder, part_features=results)
    before = column(folder, "part_feature")
    cli.features(folder, part_features=results)
    assert column(folder, "part_feature") == before
    for record in RecordSource(folder, columns=("part_feature",)):
        centers = (record.coords + 0.5) / record.resolution - 0.5
        points = surface_points(record)
        distance = np.linalg.norm(centers[:, None] - points, axis=-1)
        near = distance < distance.min(1, keepdims=True) + 1e-5
        assert record.part_feature.shape == (len(record.coords), CHANNELS)
        for value, mine in zip(record.part_feature[:, 3], near, strict=True):
            assert np.abs(points[mine].sum(1) - value).min() < 1e-3

    other = tmp_path / "other"
    shutil.copytree(results, other)
    np.save(
        other / f"part_feat_{names[0]}_0.npy", np.zeros((len(surface_points(source[0])), CHANNELS))
    )
    with pytest.raises(ValueError, match="made from other files"):
        cli.features(folder, part_features=other)
    assert column(folder, "part_feature") == before


def test_orbits_may_go_when_their_features_are_there(folder, tmp_path):
    file = weights(tmp_path)
    features.write_visual(folder, file, progress=False)
    before = column(folder)
    for path in folder.glob("orbit*"):
        path.unlink()
    features.write_visual(folder, file, progress=False)
    assert column(folder) == before


def test_a_column_that_was_cut_off_is_made_again(folder, tmp_path):
    file = weights(tmp_path)
    features.write_visual(folder, file, progress=False)
    before = column(folder)
    path = next(folder.glob("visual-*.arrayrecord"))
    path.write_bytes(path.read_bytes()[:1000])
    features.write_visual(folder, file, progress=False)
    assert column(folder) == before


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


def test_geometric_part_features_need_no_files(folder):
    """They are a column like PartField's; the two never mix."""
    cli.features(folder, part_features=Path("geometric"))
    source = RecordSource(folder, columns=("part_feature",))
    for k in range(COUNT):
        np.testing.assert_array_equal(source[k].part_feature, geometric_features(source[k]))
    assert json.loads((folder / "part_feature.json").read_text()) == {
        "source": "geometric",
        "channels": 23,
    }
    made = column(folder, "part_feature")
    cli.features(folder, part_features=Path("geometric"))
    assert column(folder, "part_feature") == made
    with pytest.raises(ValueError, match=r"source geometric \(now: PartField\)"):
        cli.features(folder, part_features=folder)


def test_prepare_makes_the_column_too(tmp_path):
    options = {"count": 2, "families": ("table",), "resolution": 16, "image_size": 16}
    out = tmp_path / "records"
    cli.prepare("procedural", out=out, part_features="geometric", processes=2, **options)
    source = RecordSource(out, columns=("part_feature",))
    assert source[1].part_feature.shape == (len(source[1].coords), 23)
    with pytest.raises(ValueError, match="--part-features is of records of objects"):
        cli.prepare("layouts", out=tmp_path / "layouts", part_features="geometric")


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

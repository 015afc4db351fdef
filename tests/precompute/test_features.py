"""``uniart features``: features of voxels against a plain computation, killed runs, refusals."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest
from feature_folders import COUNT, ENCODER, NETWORK, VIEWS, orbit, prepared, weights, write_orbits
from hand_records import features_of, make_record
from PIL import Image

from uniart_jax import cli
from uniart_jax.data import records
from uniart_jax.data.geometric_features import geometric_features
from uniart_jax.data.part_features import CHANNELS, input_name, surface_points
from uniart_jax.data.records import RecordSource
from uniart_jax.models.checkpoint_files import read_network, write_network
from uniart_jax.precompute import features, fill_columns, visual_features
from uniart_jax.visual.render import Camera, orbit_cameras

ENCODE = jax.jit(NETWORK.apply)


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
    with pytest.raises(ValueError, match="no --part-features, which goes with procedural"):
        cli.prepare("layouts", out=tmp_path / "layouts", part_features="geometric")

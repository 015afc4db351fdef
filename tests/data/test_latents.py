"""Cached latents and the batches of the flow stages."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from hand_records import MODEL, write_latents

from uniart_jax.config import DataConfig
from uniart_jax.data import latents
from uniart_jax.models.network import flat_names
from uniart_jax.nn.shapes import check_shapes
from uniart_jax.voxels.part_table import ROWS

DATA = DataConfig(voxel_buckets=(32, 64), seed=2)


def make_layout(parts, rng):
    return {
        "boxes": rng.uniform(0.2, 0.5, (parts, 6)),
        "codes": rng.normal(size=(parts, 9)),
        "parents": np.maximum(np.arange(parts) - 1, 0),
        "colors": rng.random((parts, 3)),
    }


def make_items(count=9, scale=1.0):
    rng = np.random.default_rng(0)
    for k in range(count):
        flat = np.sort(rng.choice(512, 10 + 6 * k, replace=False))
        yield {
            "record": k // 2,
            "mirrored": bool(k % 2),
            "structure": rng.normal(2, 3, (2, 2, 2, 4)) * scale,
            "coords": np.stack(np.unravel_index(flat, (8, 8, 8)), 1),
            "voxel_part": np.arange(len(flat)) % 3,
            "latent": rng.normal(-1, 0.5, (len(flat), 6)),
            "images": rng.integers(0, 100, (2, 4, 4, 3)) + np.array([0, 155]).reshape(2, 1, 1, 1),
            **make_layout(3, rng),
        }


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setattr(latents, "SHARD_ITEMS", 4)
    write_latents(tmp_path / "latents", make_items(), key="abc")
    return tmp_path / "latents"


def test_round_trip_and_statistics(cache):
    source = latents.LatentSource(cache)
    items = list(make_items())
    assert len(source) == 9 and len(list(cache.glob("*.arrayrecord"))) == 3
    for item, stored in zip(items, (source[i] for i in range(9)), strict=True):
        assert stored["record"] == item["record"] and stored["mirrored"] == item["mirrored"]
        for name in latents.FIELDS:
            np.testing.assert_allclose(stored[name], item[name], rtol=1e-3, atol=1e-3)
    some = latents.LatentSource(cache, without=("structure", "images"))[3]
    assert set(some) == {"coords", "voxel_part", "latent", "record", "mirrored", *ROWS}
    np.testing.assert_array_equal(some["latent"], source[3]["latent"])
    found = latents.read_statistics(cache)
    every = np.concatenate([item["latent"] for item in items])
    np.testing.assert_allclose(found.latent_mean, every.mean(0), atol=1e-3)
    np.testing.assert_allclose(found.latent_std, every.std(0), atol=1e-3)
    assert found.structure_mean.shape == (4,) and latents.latents_key(cache) == "abc"


def test_flow_batches(cache):
    items = {len(item["coords"]): item for item in make_items()}
    iterator = iter(latents.latent_batches(cache, DATA, MODEL, 2, stage="latent_flow"))
    views = set()
    for _ in range(8):
        batch = next(iterator)
        check_shapes(batch)
        width = batch.coords.shape[1]
        assert width in DATA.voxel_buckets and set(batch.plans) == {"flow"}
        for b, count in enumerate(batch.counts):
            item = items[int(count)]
            assert np.array_equal(batch.coords[b, :count], item["coords"])
            np.testing.assert_allclose(batch.latent[b, :count], item["latent"], atol=2e-3)
            assert np.array_equal(batch.voxel_part[b, :count], item["voxel_part"])
            assert not batch.latent[b, count:].any() and not batch.coords[b, count:].any()
            view = int(batch.image[b].mean() > 0.5)
            views.add(view)
            np.testing.assert_allclose(batch.image[b] * 255, item["images"][view], atol=1e-4)
    assert views == {0, 1}


def test_structure_batches_resume(cache):
    make = lambda: iter(latents.latent_batches(cache, DATA, MODEL, 4, stage="structure_flow"))  # noqa: E731
    first = make()
    batch = next(first)
    assert set(flat_names(batch)) == {"structure", "image"}
    check_shapes(batch)
    assert batch.structure.shape == (4, 2, 2, 2, 4) and batch.structure.dtype == np.float32
    second = make()
    second.set_state(first.get_state())
    for _ in range(4):
        a, b = next(first), next(second)
        assert all(map(np.array_equal, a, b))


def test_several_views_of_an_item_are_shown_together(cache):
    both = dataclasses.replace(DATA, condition_views=2)
    one, two = (
        iter(latents.latent_batches(cache, data, MODEL, 4, stage="structure_flow"))
        for data in (DATA, both)
    )
    for _ in range(4):
        alone, together = next(one).image, next(two).image
        assert together.shape == (4, 2, *alone.shape[1:])
        np.testing.assert_array_equal(together[:, 0], alone)  # the first is drawn as it was
        assert np.abs(together[:, 0] - together[:, 1]).max() > 0.1
    for views in (0, 3):
        data = dataclasses.replace(DATA, condition_views=views)
        with pytest.raises(ValueError, match=rf"condition_views is {views}, records have 2 views"):
            latents.latent_batches(cache, data, MODEL, 4, stage="structure_flow")


def test_a_refiners_batches_hold_the_occupancy(cache):
    flow = dataclasses.replace(MODEL.structure_flow, refine_channels=4)
    model = dataclasses.replace(MODEL, structure_flow=flow)
    batch = next(
        iter(latents.latent_batches(cache, DATA, model, 4, stage="structure_flow", decoded=True))
    )
    side = MODEL.grid.resolution
    assert batch.occupancy.shape == (4, side, side, side)
    source = latents.LatentSource(cache)
    stored = [source[i] for i in range(len(source))]
    items = {item["structure"].astype(np.float32).tobytes(): item for item in stored}
    for structure, found in zip(batch.structure, batch.occupancy, strict=True):
        coords = items[structure.tobytes()]["coords"]
        assert set(map(tuple, np.argwhere(found))) == set(map(tuple, coords.astype(int)))


def test_pictures_are_bent_for_flows_that_see_layouts_but_read_no_pixels(cache):
    data = dataclasses.replace(DATA, image_warp=0.2)

    def image(**flow):
        flow = dataclasses.replace(MODEL.structure_flow, **flow)
        model = dataclasses.replace(MODEL, structure_flow=flow)
        return next(
            iter(latents.latent_batches(cache, data, model, 4, stage="structure_flow"))
        ).image

    as_it_is = image()
    assert np.abs(image(layout_channels=4) - as_it_is).max() > 0.01
    np.testing.assert_array_equal(image(layout_channels=4, pixel_channels=4), as_it_is)


def test_another_pass_replaces_the_one_before(cache):
    write_latents(cache, make_items(4), key="y")
    assert len(latents.LatentSource(cache)) == 4 and latents.latents_key(cache) == "y"


def test_a_pass_that_was_cut_off_goes_on_with_its_shards(tmp_path):
    out = tmp_path / "latents"
    items = list(make_items(6))
    latents.begin_latents(out, "a")
    latents.write_latent_shard(out, "00000", items[:4])
    assert not out.exists() and latents.written_shards(out) == {"00000": 4}
    latents.begin_latents(out, "a")
    assert latents.written_shards(out) == {"00000": 4}
    latents.write_latent_shard(out, "00001", items[4:])
    found = latents.finish_latents(out, "a", 6)
    expected = write_latents(tmp_path / "straight", items, key="a")
    np.testing.assert_allclose(found.latent_mean, expected.latent_mean)
    assert len(latents.LatentSource(out)) == 6
    latents.begin_latents(out, "a")
    latents.write_latent_shard(out, "00000", items)
    latents.begin_latents(out, "b")  # of other weights: nothing of it is used
    assert latents.written_shards(out) == {}
    latents.write_latent_shard(out, "00000", items[:4])
    with pytest.raises(ValueError, match="4 of 6 latents were there"):
        latents.finish_latents(out, "b", 6)
    assert latents.written_shards(out) == {}  # or it would be met again for ever
    assert latents.latents_key(out) == "a" and {p.suffix for p in out.iterdir()} == {
        ".json",
        ".arrayrecord",
    }


def test_errors(cache, tmp_path):
    with pytest.raises(ValueError, match="structure of record 0 is not finite"):
        write_latents(tmp_path / "new", make_items(scale=1e6), key="x")
    with pytest.raises(ValueError, match="no items"):
        write_latents(tmp_path / "new", [], key="x")
    with pytest.raises(FileNotFoundError, match=r"metadata\.json"):
        latents.LatentSource(tmp_path / "new")
    metadata = json.loads((cache / "metadata.json").read_text())
    metadata["voxels"].pop()
    (cache / "metadata.json").write_text(json.dumps(metadata))
    with pytest.raises(ValueError, match="9 items, 8 expected"):
        latents.LatentSource(cache)

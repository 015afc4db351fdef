"""Columns beside records, splits of a folder, and the batches made of both."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hand_records import MODEL, features_of, make_record, write_folder, write_items

from uniart_jax.config import DataConfig
from uniart_jax.data import batches, image_table, records
from uniart_jax.data.mirror import mirror_record
from uniart_jax.data.records import RecordSource
from uniart_jax.data.windows import choose_windows

SPLITS = ["train", "train", "test", "train", "unseen", "test", "train", "train", "train"]
DATA = DataConfig(voxel_buckets=(64, 128))
F, P = 3, 2
READS = dataclasses.replace(
    MODEL,
    uniart_vae=dataclasses.replace(MODEL.uniart_vae, visual_channels=F, part_feature_channels=P),
)


@pytest.fixture(scope="module")
def made():
    return [make_record(k, voxels=30 + 8 * k) for k in range(9)]


@pytest.fixture
def folder(tmp_path, made):
    write_folder(tmp_path, made, SPLITS)
    for name, channels in (("visual", F), ("part_feature", P)):
        items = [(r.meta["id"], {"values": features_of(r, channels)}) for r in made]
        write_items(tmp_path, name, items)
    return tmp_path


def seeds(source):
    return [source[i].meta["seed"] for i in range(len(source))]


def test_a_split_is_read_in_the_folders_order(folder, made, tmp_path):
    assert seeds(RecordSource(folder)) == list(range(9))
    assert seeds(RecordSource(folder, "train")) == [0, 1, 3, 6, 7, 8]
    assert seeds(RecordSource(folder, "unseen, test")) == [2, 4, 5]
    under_way = tmp_path / "under-way"
    under_way.mkdir()
    write_folder(under_way, made, SPLITS, rows="rows")
    assert seeds(RecordSource(under_way, "test")) == [2, 5]
    with pytest.raises(
        ValueError, match=r"no record of split 'tset'; it has test \(2\), train \(6\), unseen \(1\)"
    ):
        RecordSource(folder, "train,tset")
    bare = tmp_path / "bare"
    bare.mkdir()
    write_folder(bare, made, rows="")
    with pytest.raises(ValueError, match="names 0 records of 9, so their splits are unknown"):
        RecordSource(bare, "train")


def test_columns_join_their_records_and_are_never_part_of_their_bytes(folder, made):
    plain, joined = RecordSource(folder, "test"), RecordSource(folder, "test", ("visual",))
    for i, index in enumerate((2, 5)):
        record = joined[i]
        assert np.array_equal(record.visual, features_of(made[index], F))
        assert record.part_feature is None and plain[i].visual is None
        assert records.to_bytes(record) == records.to_bytes(plain[i])
    both = RecordSource(folder, columns=("part_feature", "visual"))[8]
    assert both.visual.shape == (94, F) and both.part_feature.shape == (94, P)


def test_columns_that_do_not_fit_say_so_in_one_line(folder, made):
    def complaint(index=0, **options):
        with pytest.raises(ValueError) as error:
            RecordSource(folder, columns=("visual",), **options)[index]
        assert "\n" not in str(error.value)
        return str(error.value)

    good = [(r.meta["id"], {"values": features_of(r, F)}) for r in made]
    write_items(folder, "visual", [good[1], *good[1:]])
    assert "its item is of 'hand-1' where the record is 'hand-0'" in complaint()
    write_items(folder, "visual", [(good[0][0], {"values": features_of(made[1], F)}), *good[1:]])
    assert "expected float16 [30, channels], found float16 [38, 3]" in complaint()
    write_items(folder, "visual", [(good[0][0], {"values": np.zeros((30, F))}), *good[1:]])
    assert "found float64 [30, 3]" in complaint()
    write_items(folder, "visual", good)
    (folder / "visual-00002.arrayrecord").unlink()
    found = complaint()
    assert "an unfinished column 'visual' (1 of 3 shards are missing)" in found
    assert f"uniart features {folder} --weights" in found
    write_items(folder, "visual", [*good, good[0]])
    assert "has 10 items for 9 records" in complaint()
    for path in folder.glob("visual-*"):
        path.unlink()
    assert "no column 'visual' (3 of 3 shards are missing)" in complaint()
    with pytest.raises(ValueError, match="no column orbit that can be joined"):
        RecordSource(folder, columns=("orbit",))


def test_batches_hold_the_features_that_the_model_reads_and_mirror_nothing(folder, made):
    by_id = {len(r.coords): r for r in made}
    stream = iter(batches.voxel_batches(folder, DATA, READS, 2, split="train"))
    seen = set()
    for batch in (next(stream) for _ in range(9)):
        width = batch.coords.shape[1]
        assert batch.visual.shape == (2, width, F) and batch.visual.dtype == np.float32
        assert batch.part_feature.shape == (2, width, P)
        for b, count in enumerate(batch.counts):
            record = by_id[int(count)]
            seen.add(record.meta["seed"])
            assert np.array_equal(batch.coords[b, :count], record.coords)  # never mirrored
            for name, channels in (("visual", F), ("part_feature", P)):
                assert np.array_equal(
                    getattr(batch, name)[b, :count], features_of(record, channels)
                )
                assert not getattr(batch, name)[b, count:].any()
    assert seen == {0, 1, 3, 6, 7, 8}
    plain = next(iter(batches.voxel_batches(folder, DATA, MODEL, 2)))
    assert plain.visual is None and plain.part_feature is None
    assert batches.may_mirror(MODEL) and not batches.may_mirror(READS)


def test_other_channels_than_the_models(folder):
    vae = dataclasses.replace(READS.uniart_vae, visual_channels=1024)
    with pytest.raises(
        ValueError,
        match=r"column 'visual' has 3 channels, but model\.uniart_vae\.visual_channels is 1024",
    ):
        batches.voxel_batches(folder, DATA, dataclasses.replace(READS, uniart_vae=vae), 2)


def test_indices_are_of_the_split_wherever_records_are_read(folder):
    source = RecordSource(folder, "test,unseen")
    seen = []
    for batch in batches.record_batches(folder, DATA, READS, 2, split="test,unseen"):
        for b, index in enumerate(batch.record):
            if index >= 0:
                record, count = source[int(index)], batch.counts[b]
                assert np.array_equal(batch.coords[b, :count], record.coords)
                assert np.array_equal(batch.visual[b, :count], features_of(record, F))
                seen.append(int(index))
            else:
                assert not batch.visual[b].any()
    assert sorted(seen) == [0, 1, 2]
    table = image_table.load_image_table(folder, MODEL, "test,unseen")
    assert len(table) == 3
    for i in range(3):
        assert np.array_equal(table.images[i], batches.seen_images(source[i].images))
        assert np.array_equal(table.boxes[i, :3], source[i].boxes)
    (batch,) = image_table.image_pass(folder, MODEL, 4, "test,unseen")
    assert batch.record.tolist() == [0, 1, 2, -1]


def test_live_records_are_of_the_split_too(folder, monkeypatch):
    asked = []

    class Live:
        def __init__(self, *arguments):
            pass

        def record(self, place, room, rng):
            asked.append(place)

    monkeypatch.setattr(batches, "LiveRecords", Live)
    stream = iter(
        batches.voxel_batches(
            folder, dataclasses.replace(DATA, live=1.0), MODEL, 3, split="test,unseen"
        )
    )
    next(stream)
    assert set(asked) == {2, 4, 5}


def test_a_frozen_encoder_needs_no_pictures_in_memory(folder):
    encoder = dataclasses.replace(MODEL.image_encoder, architecture="dinov2", image_size=518)
    frozen = dataclasses.replace(MODEL, image_encoder=encoder)
    batch = next(iter(image_table.image_batches(folder, DATA, frozen, 3, split="train")))
    assert batch.image.shape == (3, 0, 0, 3) and batch.occupancy.any((1, 2, 3)).all()


def test_mirroring_and_windows_keep_features_on_their_voxels(folder):
    record = RecordSource(folder, columns=("visual", "part_feature"))[8]
    mirrored = mirror_record(record)
    at = {tuple(c): i for i, c in enumerate(record.coords.tolist())}
    for row, (x, y, z) in enumerate(mirrored.coords.tolist()):
        assert np.array_equal(mirrored.visual[row], record.visual[at[x, 7 - y, z]])
    part = choose_windows(record, 32, 16, np.random.default_rng(0))
    assert len(part.visual) == len(part.part_feature) == len(part.coords) <= 32
    for row, place in enumerate(part.coords.tolist()):
        assert np.array_equal(part.visual[row], record.visual[at[tuple(place)]])
        assert np.array_equal(part.part_feature[row], record.part_feature[at[tuple(place)]])
    assert mirror_record(RecordSource(folder)[8]).visual is None

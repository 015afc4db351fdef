"""Record bytes: exact round trip, and one line of complaint for anything that is not a record."""

from __future__ import annotations

import dataclasses
import io
import json
import pickle
import zipfile

import numpy as np
import pytest
from hand_records import make_record, write_folder
from hypothesis import given, settings
from hypothesis import strategies as st

from uniart_jax.cli import exit_on_error, inspect
from uniart_jax.data import records, shards
from uniart_jax.data.columns import FEATURES
from uniart_jax.voxels.grid import SDF_CLIP


def same(a: records.Record, b: records.Record) -> bool:
    return a.meta == b.meta and all(
        getattr(a, f.name).dtype == getattr(b, f.name).dtype
        and np.array_equal(getattr(a, f.name), getattr(b, f.name))
        for f in dataclasses.fields(a)
        if f.name not in ("meta", *FEATURES)
    )


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 9999), st.integers(0, 60), st.integers(1, 9), st.sampled_from([1, 2, 4]))
def test_bytes_round_trip(seed, voxels, parts, subdivisions):
    record = make_record(seed, voxels, parts, subdivisions=subdivisions)
    data = records.to_bytes(record)
    assert same(records.from_bytes(data), record)
    assert records.to_bytes(records.from_bytes(data)) == data


def line(data: bytes) -> str:
    with pytest.raises(ValueError) as caught:
        records.from_bytes(data)
    text = str(caught.value)
    assert text.startswith("record: ") and "\n" not in text
    return text


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_damaged_bytes_give_one_line(data):
    good = records.to_bytes(make_record(voxels=5, size=2))
    cut = data.draw(st.integers(0, len(good) - 1))
    line(good[:cut])
    position = data.draw(st.integers(0, len(good) - 1))
    bad = bytearray(good)
    bad[position] ^= 0xFF
    try:  # a flipped byte in a header nobody reads (a date) may pass; anything else is one line
        records.from_bytes(bytes(bad))
    except ValueError as error:
        assert "\n" not in str(error)


@given(st.binary(max_size=200))
def test_foreign_bytes_give_one_line(data):
    line(data)


def repack(record, meta=None, **changes) -> bytes:
    arrays = {
        f.name: getattr(record, f.name) for f in dataclasses.fields(record) if f.name != "meta"
    }
    arrays.update(changes)
    arrays = {k: v for k, v in arrays.items() if v is not None}
    return records.pack_arrays(arrays, {**record.meta, **(meta or {})})


def test_errors_name_what_differs(record):
    assert "schema_version is 99, this version reads 1" in line(
        repack(record, {"schema_version": 99})
    )
    assert "boxes missing" in line(repack(record, boxes=None))
    assert "strange unknown" in line(repack(record, strange=np.zeros(1)))
    assert "sdf is float64, expected int8" in line(repack(record, sdf=record.sdf.astype(float)))
    assert "owner has shape (39, 8)" in line(repack(record, owner=record.owner[1:]))
    assert "owner names a part" in line(repack(record, owner=record.owner + 3))
    assert "codes has shape" in line(repack(record, codes=record.codes[:-1]))
    assert "coords lie outside" in line(repack(record, coords=record.coords + 8))
    assert "parents names a part" in line(repack(record, parents=record.parents - 1))


@pytest.mark.parametrize(
    ("key", "place", "value", "words"),
    [
        ("codes", (1, 3), np.nan, "codes hold numbers that are not finite"),
        ("boxes", (2, 0), np.inf, "boxes hold numbers that are not finite"),
        ("cameras", (0, 3), np.nan, "cameras hold numbers that are not finite"),
        ("parents", slice(1, 3), [2, 1], "parents are no tree (kinematic tree: it holds a cycle)"),
        ("parents", slice(0, 3), [1, 2, 0], "parents are no tree (kinematic tree: expected one"),
        ("parents", slice(0, 3), [0, 1, 0], "expected one root, found 2"),
        ("coords", 7, "first", "coords hold a voxel twice"),
    ],
)
def test_values_that_cannot_be_are_refused_by_name(tmp_path, capsys, key, place, value, words):
    """When they are read, whoever reads them: with the file, the item and the record's id."""
    record = make_record(1)
    array = getattr(record, key).copy()
    array[place] = array[0] if isinstance(value, str) else value
    bad = repack(record, **{key: array})
    assert words in line(bad) and "(id 'hand-1')" in line(bad)
    write_folder(tmp_path, [make_record(0), record])
    path = tmp_path / "records-00000.arrayrecord"
    records.write_shard(path, [records.to_bytes(make_record(0)), bad])
    source = records.RecordSource(tmp_path)
    assert same(source[0], make_record(0))
    with pytest.raises(ValueError) as caught:
        source[1]
    assert str(caught.value).startswith(f"{path}, item 1: record: ") and words in str(caught.value)
    assert exit_on_error(lambda: inspect(tmp_path, index=1, out=tmp_path / "out")) == 2
    told = capsys.readouterr().err
    assert "hand-1" in told and told.count("\n") == 1 and not (tmp_path / "out").exists()


def test_voxels_may_stand_in_any_order(record):
    turned = {
        k: getattr(record, k)[::-1] for k in ("coords", "sdf", "color", "owner", "voxel_part")
    }
    assert np.array_equal(records.from_bytes(repack(record, **turned)).coords, turned["coords"])


def test_pickles_are_refused():
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        buffer = io.BytesIO()
        np.save(buffer, np.array([{"a": 1}], dtype=object), allow_pickle=True)
        archive.writestr("coords.npy", buffer.getvalue())
        archive.writestr("meta.json", json.dumps({"schema_version": 1}))
    assert "damaged or not a record" in line(stream.getvalue())


def test_bombs_are_refused(record, monkeypatch):
    monkeypatch.setattr(shards, "MAX_RECORD_BYTES", 1000)
    assert "larger than" in line(records.to_bytes(record))


@given(st.lists(st.floats(-4, 4), min_size=1, max_size=50))
def test_sdf_error_and_sign(values):
    sdf = np.array(values, np.float32)
    back = records.decode_sdf(records.encode_sdf(sdf))
    assert np.array_equal(back < 0, sdf < 0)
    limit = np.where((sdf < 0) & (sdf > -0.0119), 3 / 127, 1.5 / 127) + 1e-6
    assert np.all(np.abs(back - np.clip(sdf, -SDF_CLIP, SDF_CLIP)) <= limit)


def test_color_error():
    linear = np.linspace(0, 1, 5001, dtype=np.float32)
    stored = records.encode_color(linear)
    assert np.abs(records.decode_color(stored) - linear).max() <= 0.0045
    assert np.array_equal(records.encode_color(records.decode_color(stored)), stored)


def test_shards_random_access(tmp_path):
    made = [make_record(k) for k in range(5)]
    records.write_shard(tmp_path / "records-00000.arrayrecord", map(records.to_bytes, made[:3]))
    records.write_shard(tmp_path / "records-00001.arrayrecord", map(records.to_bytes, made[3:]))
    source = records.RecordSource(tmp_path)
    assert len(source) == 5
    for index in (4, 0, 3, 2):
        assert same(source[index], made[index])


def test_a_damaged_item_is_named_by_its_file(tmp_path):
    paths = [tmp_path / f"{i}.arrayrecord" for i in range(2)]
    for path in paths:
        rng = np.random.default_rng(0)
        shards.write_shard(path, [rng.bytes(50_000) for _ in range(8)])
    content = bytearray(paths[1].read_bytes())
    content[200_000:200_100] = bytes(100)
    paths[1].write_bytes(content)
    source, told = pickle.loads(pickle.dumps(shards.open_shards(paths))), {}
    for i in range(16):
        try:
            assert len(source[i]) == 50_000
        except ValueError as error:
            told[i] = str(error)
    assert told and all(i >= 8 for i in told)  # the rest can still be read
    for i, text in told.items():
        assert text.startswith(f"{paths[1]}, item {i - 8}: damaged") and "\n" not in text
        assert "remove the file and run the command that made it again" in text


def test_failed_shard_leaves_nothing(tmp_path):
    def items():
        yield b"one"
        raise RuntimeError

    with pytest.raises(RuntimeError):
        records.write_shard(tmp_path / "records-00000.arrayrecord", items())
    assert list(tmp_path.iterdir()) == []


def test_no_records_says_how_to_make_them(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no records in it.*uniart prepare"):
        records.RecordSource(tmp_path)
    with pytest.raises(FileNotFoundError, match="no such folder"):
        records.RecordSource(tmp_path / "absent")

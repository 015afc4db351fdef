"""The in-memory table of pictures and coarse structure."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hand_records import MODEL, make_record

from uniart_jax.config import DataConfig, GridConfig
from uniart_jax.data import image_table, records
from uniart_jax.data.image_table import NO_PART
from uniart_jax.data.mirror import mirror_record
from uniart_jax.nn.shapes import check_shapes
from uniart_jax.voxels.grid import occupancy

DATA = DataConfig(seed=5)


def test_contract_and_values(folder):
    source = records.RecordSource(folder)
    table = image_table.load_image_table(folder, MODEL)
    batch = table.take(np.array([4, 9]), np.array([0.0, 0.9]), np.array([False, False]))
    assert batch.image.shape == (2, 16, 16, 3) and batch.image.dtype == np.float32
    assert batch.occupancy.shape == (2, 8, 8, 8) and batch.occupancy.dtype == bool
    assert batch.cell_part.shape == (2, 4, 4, 4) and batch.cell_part.dtype == np.int32
    for b, index in enumerate((4, 9)):
        record = source[index]
        dense = occupancy(record.coords, 8)
        assert np.array_equal(batch.occupancy[b], dense)
        coarse = dense.reshape(4, 2, 4, 2, 4, 2).any((1, 3, 5))
        assert np.array_equal(batch.cell_part[b] >= 0, coarse)
        parts = image_table.cell_parts(record, 4)
        assert np.array_equal(parts != NO_PART, coarse)
        assert np.array_equal(batch.cell_part[b][coarse], parts[coarse])
        known = len(record.boxes)
        assert np.array_equal(batch.boxes[b][:known], record.boxes)
        assert np.array_equal(batch.codes[b][:known], record.codes)
        assert np.array_equal(batch.parents[b][:known], record.parents)


def test_cell_belongs_to_the_part_with_most_surface():
    record = make_record(voxels=0, parts=3)
    record = dataclasses.replace(
        record,
        coords=np.array([[0, 0, 0], [0, 0, 1], [4, 4, 4]], np.uint8),
        sdf=np.where(np.arange(8) < [[3], [4], [0]], 0, 127).astype(np.int8),
        owner=np.repeat([[1], [2], [0]], 8, 1).astype(np.uint8),
        voxel_part=np.array([1, 2, 1], np.uint8),
    )
    parts = image_table.cell_parts(record, 4)
    assert parts[0, 0, 0] == 2  # four sub-cells on the surface against three
    assert parts[2, 2, 2] == 1  # none at all: the voxel's own part
    assert (parts != NO_PART).sum() == 2


def test_mirrored_rows_are_the_mirrored_record(folder, tmp_path):
    source = records.RecordSource(folder)
    made = [records.to_bytes(mirror_record(source[i])) for i in range(len(source))]
    records.write_shard(tmp_path / "records-00000.arrayrecord", made)
    rows, views = np.arange(11), np.linspace(0, 0.99, 11)
    plain = image_table.load_image_table(tmp_path, MODEL).take(rows, views, np.zeros(11, bool))
    flipped = image_table.load_image_table(folder, MODEL).take(rows, views, np.ones(11, bool))
    for key, one, other in zip(plain._fields, plain, flipped, strict=True):
        assert np.array_equal(one, other), key


def test_pipeline_resumes_and_shares(folder):
    make = lambda **k: iter(image_table.image_batches(folder, DATA, MODEL, 4, **k))  # noqa: E731
    straight = make()
    expected = [next(straight) for _ in range(6)]
    first = make()
    for _ in range(3):
        next(first)
    second = make()
    second.set_state(first.get_state())
    half = make(process_index=1, process_count=2)
    for step, batch in enumerate(expected):
        share = next(half)
        check_shapes(batch)
        arrays = [array for array in batch if array is not None]
        assert len(arrays) == 7
        for array, part in zip(arrays, share, strict=False):
            assert np.array_equal(array[2:], part)
        if step >= 3:
            resumed = next(second)
            assert all(map(np.array_equal, arrays, resumed))


def test_pass_sees_each_once(folder):
    seen = [r for b in image_table.image_pass(folder, MODEL, 4) for r in b.record.tolist()]
    assert seen == [*range(11), -1]


def test_records_of_too_many_parts_are_left_out_and_keep_their_index(folder, caplog):
    """Every third record has four parts; nothing else moves to its place."""
    model = dataclasses.replace(MODEL, grid=GridConfig(8, 2, 3))
    source, kept = records.RecordSource(folder), [0, 1, 3, 4, 6, 7, 9, 10]
    seen = []
    for batch in image_table.image_pass(folder, model, 3):
        for b, index in enumerate(batch.record.tolist()):
            if index >= 0:
                seen.append(index)
                assert np.array_equal(batch.occupancy[b], occupancy(source[index].coords, 8))
                known = len(source[index].boxes)
                assert np.array_equal(batch.boxes[b][:known], source[index].boxes)
    assert seen == kept
    assert caplog.text.count("3 of 11 records left out: more than 3 parts") == 1
    batches = iter(image_table.image_batches(folder, DATA, model, 8))
    truth = {occupancy(source[i].coords, 8).sum() for i in kept}  # every record has its own count
    assert {int(o.sum()) for o in next(batches).occupancy} == truth
    with pytest.raises(ValueError, match="8 records are fewer than one batch of 9"):
        image_table.image_batches(folder, DATA, model, 9)


def test_errors(folder):
    with pytest.raises(ValueError, match="every record has more than max_parts = 1 parts"):
        image_table.load_image_table(folder, dataclasses.replace(MODEL, grid=GridConfig(8, 2, 1)))
    encoder = dataclasses.replace(MODEL.image_encoder, image_size=32)
    with pytest.raises(ValueError, match="images of 16 pixels, but the config asks for 32"):
        image_table.load_image_table(folder, dataclasses.replace(MODEL, image_encoder=encoder))

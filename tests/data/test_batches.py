"""Pipelines: order, padding, resuming, sharing among processes."""

from __future__ import annotations

import dataclasses

import jax
import numpy as np
import pytest
from hand_records import MODEL, make_record

from uniart_jax.config import DataConfig, GridConfig
from uniart_jax.data import batches, records
from uniart_jax.data.order import OnePass, ShuffledOrder, fitting_width
from uniart_jax.nn.shapes import check_shapes

DATA = DataConfig(voxel_buckets=(64, 128), seed=3)


def equal(a, b) -> bool:
    """Same structure, types and bits."""
    leaves_a, tree_a = jax.tree.flatten(a)
    leaves_b, tree_b = jax.tree.flatten(b)
    return tree_a == tree_b and all(
        np.asarray(x).dtype == np.asarray(y).dtype and np.array_equal(x, y)
        for x, y in zip(leaves_a, leaves_b, strict=True)
    )


def take(iterator, count):
    return [next(iterator) for _ in range(count)]


def test_contract(folder):
    batch = next(iter(batches.voxel_batches(folder, DATA, MODEL, 2)))
    width = batch.coords.shape[1]
    assert width in DATA.voxel_buckets
    shapes = {
        "coords": ((2, width, 3), np.int32),
        "counts": ((2,), np.int32),
        "sdf": ((2, width, 8), np.int8),
        "color": ((2, width, 8, 3), np.uint8),
        "owner": ((2, width, 8), np.uint8),
        "voxel_part": ((2, width), np.int32),
        "boxes": ((2, 8, 6), np.float32),
        "codes": ((2, 8, 9), np.float32),
        "parents": ((2, 8), np.int32),
        "part_counts": ((2,), np.int32),
    }
    held = {k: v for k, v in batch._asdict().items() if v is not None and k != "plans"}
    assert {k: (v.shape, v.dtype) for k, v in held.items()} == shapes
    check_shapes(batch)
    assert set(batch.plans) == {"parts", "window_0", "window_1"}


def test_values_and_padding(folder):
    data = DataConfig(voxel_buckets=(64, 128), mirror=False)
    source = records.RecordSource(folder)
    by_count = {len(source[i].coords): source[i] for i in range(len(source))}
    for batch in take(iter(batches.voxel_batches(folder, data, MODEL, 3)), 6):
        smallest = min(w for w in data.voxel_buckets if w >= batch.counts.max())
        assert batch.coords.shape[1] >= smallest
        for b, count in enumerate(batch.counts):
            record = by_count[int(count)]
            grid = record.grid()
            parts = batch.part_counts[b]
            assert parts == len(record.boxes)
            for key in ("coords", "sdf", "color", "owner", "voxel_part"):  # as stored
                assert np.array_equal(getattr(batch, key)[b, :count], getattr(record, key)), key
                assert not getattr(batch, key)[b, count:].any(), key
            for key in ("boxes", "codes", "parents"):
                assert np.array_equal(getattr(batch, key)[b, :parts], getattr(grid, key)), key
                assert not getattr(batch, key)[b, parts:].any(), key


def test_layouts_name_the_row_of_each_true_part(folder):
    """At any strength of errors; batches with a picture resume as others do."""
    vae = dataclasses.replace(MODEL.uniart_vae, layout_channels=4)
    flow = dataclasses.replace(MODEL.latent_flow, patch_size=2, stem="patch")
    model = dataclasses.replace(MODEL, uniart_vae=vae, latent_flow=flow)
    for errors in (0.0, 1.0):
        data = dataclasses.replace(DATA, layout_errors=errors)
        stream = batches.voxel_batches(folder, data, model, 3, shown=True)
        found = take(iter(stream), 8)
        assert equal(found, take(iter(stream), 8))
        lost = 0
        for batch in found:
            check_shapes(batch)
            assert batch.image.shape[0] == 3 and batch.image.min() >= 0
            assert batch.image.max() <= 1 and "flow" in batch.plans
            for b, known in enumerate(batch.part_counts):
                rows, table = batch.layout_rows[b], batch.layout
                assert (rows[known:] == -1).all()
                there = np.flatnonzero(rows >= 0)
                assert sorted(rows[there]) == list(range(table.counts[b]))
                lost += known - len(there)
                off = np.abs(table.boxes[b, rows[there]] - batch.boxes[b, there]).max(initial=0)
                assert off < (0.2 if errors else 1e-6)
        assert (lost > 0) == (errors > 0)


def test_a_picture_asks_for_whole_objects(folder):
    data = dataclasses.replace(DATA, voxel_crop=32)
    with pytest.raises(ValueError, match=r"set data\.voxel_crop 0"):
        batches.voxel_batches(folder, data, MODEL, 2, shown=True)


def test_resume_is_exact(folder):
    make = lambda: iter(batches.voxel_batches(folder, DATA, MODEL, 2))  # noqa: E731
    straight = take(make(), 12)
    for stop in (0, 1, 7):  # 5 batches an epoch: across its end too
        first = make()
        take(first, stop)
        state = first.get_state()
        second = make()
        second.set_state(state)
        assert all(
            equal(a, b) for a, b in zip(take(second, 12 - stop), straight[stop:], strict=True)
        )


def test_seed_decides_the_order(folder):
    def counts(seed):
        return [
            b.counts.tolist()
            for b in take(iter(batches.voxel_batches(folder, DATA, MODEL, 2, seed=seed)), 5)
        ]

    assert counts(1) == counts(1) != counts(2)


def test_processes_share_each_batch(folder):
    whole = take(iter(batches.voxel_batches(folder, DATA, MODEL, 4)), 4)
    shares = [
        take(
            iter(batches.voxel_batches(folder, DATA, MODEL, 4, process_index=i, process_count=2)), 4
        )
        for i in range(2)
    ]
    for full, *halves in zip(whole, *shares, strict=True):
        for key, array, *parts in zip(full._fields, full, *halves, strict=True):
            if key != "plans" and array is not None:
                assert np.array_equal(array, np.concatenate(parts)), key
    with pytest.raises(ValueError, match="batch of 3 cannot be shared equally by 2"):
        batches.voxel_batches(folder, DATA, MODEL, 3, process_count=2)


@pytest.mark.slow
def test_worker_processes_give_the_same_batches(folder):
    straight = take(iter(batches.voxel_batches(folder, DATA, MODEL, 2)), 5)
    data = DataConfig(voxel_buckets=(64, 128), seed=3, workers=2)
    worked = iter(batches.voxel_batches(folder, data, MODEL, 2))
    assert all(equal(a, b) for a, b in zip(take(worked, 5), straight, strict=True))
    worked.close()


def test_record_pass_sees_each_once(folder):
    for mirrored in (False, True):
        seen, source = [], records.RecordSource(folder)
        for batch in batches.record_batches(folder, DATA, MODEL, 4, mirrored=mirrored):
            valid = batch.record >= 0
            seen += batch.record[valid].tolist()
            assert not batch.counts[~valid].any() and not batch.images[~valid].any()
            for b in np.flatnonzero(valid):
                record = source[int(batch.record[b])]
                views = batches.seen_images(record.images)[..., :: -1 if mirrored else 1, :]
                assert batch.counts[b] == len(record.coords)
                assert np.allclose(batch.images[b] * 255, views, atol=3)
        assert sorted(seen) == list(range(11))


def test_large_records_are_left_out_and_counted(folder, caplog):
    data = DataConfig(voxel_buckets=(64,))
    seen = [r for b in batches.record_batches(folder, data, MODEL, 4) for r in b.record if r >= 0]
    assert sorted(seen) == [0, 1, 2, 3, 4]  # 20 to 60 voxels
    assert "6 of 11 records left out: more than 64 voxels or 8 parts" in caplog.text


def test_one_line_errors(folder, tmp_path):
    with pytest.raises(ValueError, match="11 records are fewer than one batch of 12"):
        batches.voxel_batches(folder, DATA, MODEL, 12)
    with pytest.raises(
        ValueError, match="8 voxels a side with 2 sub-cells, but the config asks for 16 with 2"
    ):
        batches.voxel_batches(
            folder, DATA, dataclasses.replace(MODEL, grid=GridConfig(16, 2, 8)), 2
        )
    with pytest.raises(FileNotFoundError, match="uniart prepare"):
        batches.voxel_batches(tmp_path, DATA, MODEL, 2)
    with pytest.raises(ValueError, match="40 voxels and 3 parts; the batch holds 32 and 8"):
        batches.collate([make_record()], 32, MODEL.grid)


def test_shuffled_order_covers_each_epoch():
    voxels = np.random.default_rng(0).integers(1, 100, 53)
    order = ShuffledOrder(np.arange(53), fitting_width(voxels, (80, 20, 120)), 5, seed=1)
    epochs = []
    for epoch in range(3):
        drawn = [order[epoch * 10 + i] for i in range(10)]
        seen = np.concatenate([d.records for d in drawn])
        assert len(set(seen.tolist())) == 50
        assert all((voxels[d.records] <= d.width).all() for d in drawn)
        epochs.append(seen.tolist())
    assert epochs[0] != epochs[1] != epochs[2]
    assert np.array_equal(
        order[3].records,
        ShuffledOrder(np.arange(53), fitting_width(voxels, (20, 80, 120)), 5, 1)[3].records,
    )
    # most batches are no wider than their items need
    tight = [
        d.width == fitting_width(voxels[d.records], (20, 80, 120)).min()
        for d in (order[i] for i in range(10))
    ]
    assert np.mean(tight) >= 0.7


def test_one_pass_orders_by_width():
    drawn = list(OnePass(np.arange(7), np.array([2, 1, 1, 2, 1, 1, 1]), 2)[i] for i in range(4))
    assert [d.records.tolist() for d in drawn] == [[1, 2], [4, 5], [6, -1], [0, 3]]
    assert [d.width for d in drawn] == [1, 1, 1, 2]

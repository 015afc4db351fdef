"""Kinds of batches: from dictionaries, as pytrees, through worker processes."""

import jax
import numpy as np
import pytest

from uniart_jax.data.order import OnePass
from uniart_jax.data.stream import Batches
from uniart_jax.models.network import flat_names
from uniart_jax.voxels.typed_batches import LayoutBatch, PictureBatch, VoxelBatch, batch_of

ITEMS = {"image": np.ones((2, 4, 4, 3), np.float32), "occupancy": np.ones((2, 8, 8, 8), bool)}


def test_a_batch_of_a_dictionary_has_what_is_wanted():
    batch = batch_of(PictureBatch, {**ITEMS, "other": np.zeros(3)}, ["occupancy"])
    assert batch == PictureBatch(occupancy=ITEMS["occupancy"])
    assert batch_of(PictureBatch, batch, ["occupancy"]).occupancy is ITEMS["occupancy"]
    assert batch_of(PictureBatch, ITEMS).image is ITEMS["image"]


def test_what_is_missing_is_named():
    for given in (ITEMS, PictureBatch(**ITEMS)):
        with pytest.raises(ValueError, match="a batch has no 'camera', which the stage reads"):
            batch_of(PictureBatch, given, ["image", "camera"])
    with pytest.raises(ValueError, match="a batch has no 'camera'"):
        batch_of(LayoutBatch, ITEMS)


def test_fields_with_a_default_that_a_stage_needs_are_named_too():
    places = {"coords": np.zeros((1, 4, 3), np.int32), "counts": np.array([4])}
    assert batch_of(VoxelBatch, places).sdf is None
    with pytest.raises(ValueError, match="a batch has no 'sdf'"):
        batch_of(VoxelBatch, places, (), ("sdf", "plans"))
    with pytest.raises(ValueError, match="is a VoxelBatch or a dictionary, not list"):
        batch_of(VoxelBatch, [1, 2])


def test_leaves_have_the_names_of_the_fields_and_none_is_no_leaf():
    assert list(flat_names(PictureBatch(**ITEMS))) == ["image", "occupancy"]
    doubled = jax.tree.map(lambda a: 2 * a, PictureBatch(image=ITEMS["image"]))
    assert isinstance(doubled, PictureBatch) and doubled.occupancy is None
    np.testing.assert_array_equal(doubled.image, 2)


def load(draw):
    image = np.full((1, 2, 2, 3), draw.records[0], np.float32)
    return PictureBatch(image=image, record=draw.records)


@pytest.mark.parametrize("workers", [0, 1])
def test_grain_keeps_the_kind(workers):
    batches = Batches(OnePass(np.arange(3), np.zeros(3, np.int64), 1), load, workers)
    seen = list(batches)
    assert all(isinstance(batch, PictureBatch) and batch.camera is None for batch in seen)
    assert [batch.image.max() for batch in seen] == [0, 1, 2]
    assert [batch.record.tolist() for batch in seen] == [[0], [1], [2]]

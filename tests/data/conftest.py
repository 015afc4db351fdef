"""Records for the tests of data."""

from __future__ import annotations

import pytest
from hand_records import make_record

from uniart_jax.data import records


@pytest.fixture(scope="package", autouse=True)
def collected(little_to_collect):
    """``prepare`` collects garbage after each object."""


@pytest.fixture
def record():
    return make_record()


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """A folder with 11 records in three shards; voxel counts 20..120 at R = 8, r = 2, images
    16^2."""
    path = tmp_path_factory.mktemp("records")
    made = [make_record(k, voxels=20 + 10 * k, parts=2 + k % 3) for k in range(11)]
    for shard, start in enumerate(range(0, len(made), 4)):
        items = [records.to_bytes(r) for r in made[start : start + 4]]
        records.write_shard(path / f"records-{shard:05d}.arrayrecord", items)
    return path

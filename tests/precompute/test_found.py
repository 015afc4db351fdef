"""Records on other voxels: what they say of the true ones stays, the others are inside or outside,
at a distance."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from hand_records import make_record, write_folder

from uniart_jax.config import LatentSampleConfig, StructureSampleConfig
from uniart_jax.data.batches import open_records
from uniart_jax.data.records import RecordSource, decode_sdf, from_object, record_rows
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.precompute import found
from uniart_jax.runtime.files import write_text
from uniart_jax.voxels.grid import SDF_CLIP, subcell_centers
from uniart_jax.voxels.voxelize import voxelize

R, SUB, RADIUS = 16, 2, 0.3


@pytest.fixture(scope="module")
def ball():
    mesh = trimesh.creation.icosphere(4, RADIUS)
    mesh.visual.face_colors = [200, 40, 40, 255]
    obj = ArticulatedObject((Part("ball", mesh),))
    image = np.full((2, 16, 16, 4), 255, np.uint8)
    image[1] = 7
    return from_object(obj, image, np.zeros((2, 4)), {"id": "ball"}, voxelize(obj, R, SUB))


def test_on_its_own_voxels_a_record_stays_what_it_is(ball):
    same = found.on_voxels(ball, ball.coords)
    for name in ("coords", "sdf", "color", "owner", "voxel_part"):
        np.testing.assert_array_equal(getattr(same, name), getattr(ball, name), name)
    some = found.on_voxels(ball, ball.coords[::3])
    np.testing.assert_array_equal(some.sdf, ball.sdf[::3])


def test_other_voxels_have_the_true_sign_and_nearly_the_true_distance(ball):
    everywhere = np.argwhere(np.ones((R, R, R), bool))
    whole = found.on_voxels(ball, everywhere)
    centres = subcell_centers(everywhere, R, SUB)
    true = (np.linalg.norm(centres, axis=-1) - RADIUS) * R * SUB  # of a sphere, in sub-cells
    said = decode_sdf(whole.sdf)
    clear = np.abs(true) > 0.5
    np.testing.assert_array_equal(said[clear] < 0, true[clear] < 0)
    assert np.abs(said - np.clip(true, -SDF_CLIP, SDF_CLIP)).max() < 1.3
    assert (whole.owner == 0).all() and (whole.voxel_part == 0).all()
    shown = whole.color.reshape(-1, 3)  # red everywhere
    assert (shown[:, 0] > 150).all() and (shown[:, 1:] < 90).all()


class Pipe:
    """Finds the upper half of the grid in dark pictures, nothing in bright ones."""

    def __init__(self, grid):
        self.config = SimpleNamespace(model=SimpleNamespace(grid=grid))
        self.seen = []

    def prepare(self, image):
        return image

    def layout_or_none(self, image):
        return image.mean()

    def options(self):
        return StructureSampleConfig(steps=1), LatentSampleConfig(steps=1)


def see(pipe, pixels, layout, *options):
    assert layout == pixels[0].mean()
    return pixels


def find(pipe, pixels, key, options):
    half = np.zeros((R, R, R), bool)
    half[:, :, R // 2 :] = pixels.max() < 100
    return np.argwhere(half).astype(np.int32), None


@pytest.fixture(autouse=True)
def looks(monkeypatch):
    monkeypatch.setattr(found, "encode_views", see)
    monkeypatch.setattr(found, "find_voxels", find)


def test_a_folder_holds_each_picture_with_the_voxels_found_in_it(ball, tmp_path, monkeypatch):
    grid = SimpleNamespace(resolution=R, subdivisions=SUB, max_parts=4)
    monkeypatch.setattr(found, "load", lambda checkpoint: Pipe(grid))
    records = [dataclasses.replace(ball, meta={**ball.meta, "id": f"ball-{k}"}) for k in range(3)]
    (tmp_path / "in").mkdir()
    write_folder(tmp_path / "in", records)
    write_text(tmp_path / "in/metadata.json", '{"views": 2}')
    monkeypatch.setattr(found, "SHARD", 2)
    found.prepare_found(tmp_path / "in", tmp_path / "out", "nano", 2)
    source = RecordSource(tmp_path / "out")
    assert [source[i].meta["id"] for i in range(6)] == [
        f"ball-{k}-view{v}" for k in range(3) for v in range(2)
    ]
    bright, dark = source[0], source[1]
    np.testing.assert_array_equal(bright.coords, ball.coords)  # nothing found: its own
    assert len(dark.coords) == R**3 // 2 and (dark.coords[:, 2] >= R // 2).all()
    assert dark.images.shape == (1, 16, 16, 4) and (dark.images == 7).all()
    _, sizes = open_records(tmp_path / "out", grid)
    assert sizes[:, 0].tolist() == [len(source[i].coords) for i in range(6)]
    assert len(record_rows(tmp_path / "out")) == 6
    before = (tmp_path / "out/records-00001.arrayrecord").read_bytes()
    (tmp_path / "out/records-00000.arrayrecord").unlink()
    found.prepare_found(tmp_path / "in", tmp_path / "out", "nano", 2)  # makes what is missing
    assert (tmp_path / "out/records-00001.arrayrecord").read_bytes() == before
    assert len(RecordSource(tmp_path / "out")) == 6
    with pytest.raises(ValueError, match="other settings"):
        found.prepare_found(tmp_path / "in", tmp_path / "out", "nano", 1)
    with pytest.raises(ValueError, match="--views must be at least 1"):
        found.prepare_found(tmp_path / "in", tmp_path / "out", "nano", 0)
    # the folder of records grows: what is finished is left, a shard that was not full is made again
    more = [dataclasses.replace(ball, meta={**ball.meta, "id": f"ball-{k}"}) for k in range(5)]
    write_folder(tmp_path / "in", more)
    made, make = [], found.found_record

    def count(record, view, pipeline):
        made.append(record.meta["id"])
        return make(record, view, pipeline)

    monkeypatch.setattr(found, "found_record", count)
    found.prepare_found(tmp_path / "in", tmp_path / "out", "nano", 2)
    assert made == [f"ball-{k}" for k in (2, 2, 3, 3, 4, 4)]
    assert len(RecordSource(tmp_path / "out")) == len(record_rows(tmp_path / "out")) == 10


def test_records_of_another_grid_are_refused(tmp_path, monkeypatch):
    grid = SimpleNamespace(resolution=R, subdivisions=SUB, max_parts=4)
    monkeypatch.setattr(found, "load", lambda checkpoint: Pipe(grid))
    (tmp_path / "in").mkdir()
    write_folder(tmp_path / "in", [make_record()])
    with pytest.raises(
        ValueError, match="8 voxels of 2 sub-cells a side, checkpoint 'nano' 16 of 2"
    ):
        found.prepare_found(tmp_path / "in", tmp_path / "out", "nano")
    assert not (tmp_path / "out").exists()

"""Records made again while training: what comes, when it comes again, and when it cannot."""

from __future__ import annotations

import dataclasses
import json
import pickle

import jax
import numpy as np
import pytest
from hand_records import MODEL

from uniart_jax import procedural
from uniart_jax.config import DataConfig, GridConfig
from uniart_jax.data import batches, live, prepare, records
from uniart_jax.data.folder import Settings, read_manifest
from uniart_jax.data.live import LiveRecords, read_settings, remake
from uniart_jax.data.sources import find_entries

GRID = GridConfig(16, 2, 16)
PLAIN = dataclasses.replace(
    MODEL, grid=GRID, uniart_vae=dataclasses.replace(MODEL.uniart_vae, visual_channels=0)
)
DATA = DataConfig(voxel_buckets=(2048, 4096), mirror=False, live=1.0, part_scale=0.2)
FAMILIES = ("bottle", "laptop", "scissors", "microwave")


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """Four procedural objects at R = 16, r = 2."""
    out = tmp_path_factory.mktemp("live") / "records"
    options = dict(grid=GRID, views=1, image_size=16, processes=1, progress=False)
    return prepare.prepare_procedural(out, 4, families=FAMILIES, **options)


@pytest.fixture
def uncached():
    live.loaded.cache_clear()
    yield
    live.loaded.cache_clear()


def take(folder, data, count, start=0, model=PLAIN):
    made = iter(batches.voxel_batches(folder, data, model, 2, seed=5))
    if start:
        state = made.get_state()
        assert state["batch"] == 0
        made.set_state({**state, "batch": start})
    try:
        return [next(made) for _ in range(count)]
    finally:
        made.close()


def same(a, b):
    one, other = (jax.tree.leaves(batch._replace(plans=None)) for batch in (a, b))
    return len(one) == len(other) and all(map(np.array_equal, one, other))


def contents(batch):
    """Each item's bytes of shape and place."""
    return [batch.boxes[b].tobytes() + batch.sdf[b].tobytes() for b in range(2)]


def test_a_remade_record_is_whole(prepared):
    source, settings = records.RecordSource(prepared), read_settings(prepared)
    assert settings == Settings(
        **{**json.loads((prepared / "metadata.json").read_text()), "families": FAMILIES}
    )
    maker = LiveRecords(prepared, DATA, GRID)
    for index in range(4):
        stored = source[index]
        made = maker.record(index, 4096, np.random.default_rng(index))
        assert made is not None and (made.images.shape, made.cameras.shape) == (
            (0, 16, 16, 4),
            (0, 4),
        )
        back = records.from_bytes(records.to_bytes(made))  # types, shapes, ids
        assert np.array_equal(back.sdf, made.sdf)
        assert made.meta["joint_types"] == stored.meta["joint_types"]
        assert np.array_equal(made.parents, stored.parents)
        assert not np.array_equal(made.boxes, stored.boxes)
        corners = np.concatenate(
            [made.boxes[:, :3] - made.boxes[:, 3:] / 2, made.boxes[:, :3] + made.boxes[:, 3:] / 2]
        )
        assert np.abs(corners).max() == pytest.approx(0.5, abs=1e-6)
    assert (maker.made, maker.kept) == (4, 0)


def test_only_states_change_without_a_strength(prepared):
    settings = read_settings(prepared)
    obj = procedural.generate("laptop", 1)
    still = [remake(obj, settings, 0.0, np.random.default_rng(s)) for s in range(6)]
    moved = [remake(obj, settings, 0.2, np.random.default_rng(s)) for s in range(6)]
    shapes = {tuple(np.round(r.boxes[0, 3:] / r.boxes[0, 3:].max(), 4)) for r in still}
    assert len(shapes) == 1  # the base, whatever the screen does
    assert len({r.codes.tobytes() for r in still}) > 1
    assert len({tuple(np.round(r.boxes[0, 3:] / r.boxes[0, 3:].max(), 4)) for r in moved}) == 6


def test_batches_are_a_function_of_seed_and_number(prepared):
    first = take(prepared, DATA, 4)
    again = take(prepared, DATA, 4)
    assert all(same(a, b) for a, b in zip(first, again, strict=True))
    resumed = take(prepared, DATA, 2, start=2)
    assert all(same(a, b) for a, b in zip(first[2:], resumed, strict=True))
    # two batches an epoch: every object once, and none as before in the second
    epochs = [{c for batch in first[i : i + 2] for c in contents(batch)} for i in (0, 2)]
    assert len(epochs[0]) == len(epochs[1]) == 4 and not epochs[0] & epochs[1]


def test_a_share_is_remade(prepared):
    stored = {
        c for b in take(prepared, dataclasses.replace(DATA, live=0.0), 2) for c in contents(b)
    }
    half = take(prepared, dataclasses.replace(DATA, live=0.5), 8)
    kept = sum(c in stored for batch in half for c in contents(batch))
    assert 2 <= kept <= 14


def test_colours_change_alone(prepared):
    plain = take(prepared, dataclasses.replace(DATA, live=0.0), 2)
    bright = take(prepared, dataclasses.replace(DATA, live=0.0, part_color=0.2), 2)
    for a, b in zip(plain, bright, strict=True):
        assert not np.array_equal(a.color, b.color)
        assert same(a._replace(color=None), b._replace(color=None))


def test_joints_drawn_anew_change_joints_and_parents_alone(prepared):
    plain = take(prepared, dataclasses.replace(DATA, live=0.0), 2)
    data = dataclasses.replace(DATA, live=0.0, new_joints=1.0)
    drawn = take(prepared, data, 2)
    assert all(same(a, b) for a, b in zip(drawn, take(prepared, data, 2), strict=True))
    for a, b in zip(plain, drawn, strict=True):
        assert not np.array_equal(a.codes, b.codes)
        rest = {"codes": None, "parents": None}
        assert same(a._replace(**rest), b._replace(**rest))


def test_nothing_changes_by_default(prepared):
    data = DataConfig(voxel_buckets=(2048, 4096), mirror=False)
    source = records.RecordSource(prepared)
    stored = {source[i].boxes.tobytes() for i in range(4)}
    for batch in take(prepared, data, 2):
        for b, count in enumerate(batch.part_counts):
            assert batch.boxes[b, :count].tobytes() in stored


def test_what_does_not_fit_is_the_stored_record(prepared, monkeypatch):
    stored = take(prepared, dataclasses.replace(DATA, live=0.0), 2)
    maker = LiveRecords(prepared, DATA, GridConfig(16, 2, 1))
    assert maker.record(0, 4096, np.random.default_rng(0)) is None  # more than one part
    maker = LiveRecords(prepared, DATA, GRID)
    assert maker.record(0, 10, np.random.default_rng(0)) is None  # more than ten voxels
    assert (maker.made, maker.kept) == (0, 1)

    def refuse(obj, resolution, subdivisions):
        raise ValueError("too small")

    monkeypatch.setattr(live, "voxelize", refuse)
    assert all(same(a, b) for a, b in zip(take(prepared, DATA, 2), stored, strict=True))


def test_an_object_that_cannot_be_made_is_named_once(prepared, caplog, uncached):
    maker = LiveRecords(prepared, DATA, GRID)
    maker.entries[1] = dataclasses.replace(maker.entries[1], key="gone-1", category="gone")
    for seed in range(3):
        assert maker.record(1, 4096, np.random.default_rng(seed)) is None
    assert maker.kept == 3
    assert caplog.text.count("'gone-1' cannot be made again, its stored record is used") == 1


def test_another_draw_follows_a_refused_one(prepared, monkeypatch):
    tries = []

    def refuse_once(obj, *settings, really=live.voxelize):
        if obj.name == "only this one":  # threads of other tests' pipelines may still be at work
            tries.append(obj)
            if len(tries) == 1:
                raise ValueError("too small")
        return really(obj, *settings)

    def only_mine(entry, settings, really=live.loaded):
        obj = really(dataclasses.replace(entry, key="laptop-0000001"), settings)
        return dataclasses.replace(obj, name="only this one") if entry.key == "mine" else obj

    monkeypatch.setattr(live, "voxelize", refuse_once)
    monkeypatch.setattr(live, "loaded", only_mine)
    maker = LiveRecords(prepared, DATA, GRID)
    maker.entries[1] = dataclasses.replace(maker.entries[1], key="mine")
    assert maker.record(1, 4096, np.random.default_rng(0)) is not None and len(tries) == 2


def test_a_split_is_remade_from_its_own_objects(tmp_path, monkeypatch):
    start = procedural.HELD_OUT_SEED - 2
    options = dict(grid=GRID, views=1, image_size=16, processes=1, progress=False)
    out = prepare.prepare_procedural(
        tmp_path / "r", 4, families=FAMILIES, start_seed=start, **options
    )
    asked = []

    def record(self, index, voxels, rng):
        if self.settings.start_seed == start:
            asked.append(self.entries[index].seed - start)

    monkeypatch.setattr(LiveRecords, "record", record)
    made = iter(batches.voxel_batches(out, DATA, PLAIN, 2, split="held-out"))
    next(made)
    made.close()
    assert set(asked) == {2, 3}


def test_windows_are_cut_from_remade_records(prepared):
    cropped = take(prepared, dataclasses.replace(DATA, voxel_crop=64), 2)
    assert all(((batch.counts > 0) & (batch.counts <= 64)).all() for batch in cropped)
    assert len({c for batch in cropped for c in contents(batch)}) == 4


def test_a_copy_in_another_process_makes_the_same(prepared):
    maker = LiveRecords(prepared, DATA, GRID)
    copy = pickle.loads(pickle.dumps(maker))
    a, b = (m.record(1, 4096, np.random.default_rng(0)) for m in (maker, copy))
    assert a is not None and b is not None and records.to_bytes(a) == records.to_bytes(b)


URDF = """<robot name="thing">
<link name="body"><visual><geometry><box size="1 .6 .8"/></geometry></visual></link>
<link name="door"><visual><origin xyz="0 .3 0"/><geometry><box size=".1 .6 .8"/></geometry></visual></link>
<joint name="hinge" type="revolute"><parent link="body"/><child link="door"/><origin xyz="-.55 -.3 0"/><axis xyz="0 0 1"/><limit lower="0" upper="{}"/></joint>
</robot>"""  # noqa: E501


def test_assets_are_loaded_where_they_were(tmp_path):
    root, out = tmp_path / "assets", tmp_path / "records"
    for k, upper in enumerate((1.0, 1.5)):
        (root / f"door-{k}").mkdir(parents=True)
        (root / f"door-{k}" / "object.urdf").write_text(URDF.format(upper))
    settings = Settings(
        source="urdf",
        root=str(root),
        resolution=16,
        subdivisions=2,
        views=1,
        image_size=16,
        states=2,
    )
    prepare.prepare(out, find_entries(root, "urdf"), settings, processes=1, progress=False)
    assert len(read_manifest(out)) == 4
    maker = LiveRecords(out, DATA, GRID)
    spans = []
    for index in range(4):
        made = maker.record(index, 4096, np.random.default_rng(index))
        assert made is not None and made.meta["joint_types"] == ["fixed", "revolute"]
        spans.append(float(np.ptp(made.codes[1, 7:]) * np.pi))
    assert spans == pytest.approx([1.0, 1.0, 1.5, 1.5], abs=1e-5)
    assert maker.entries[0] == maker.entries[1] != maker.entries[2]  # so that it is loaded once
    root.rename(tmp_path / "elsewhere")
    with pytest.raises(FileNotFoundError, match="its assets are not at"):
        LiveRecords(out, DATA, GRID)


def test_one_line_errors(prepared):
    for wrong in ({"live": 1.5}, {"live": -0.1}, {"part_scale": -1.0}):
        with pytest.raises(ValueError, match=r"live must be in 0\.\.1 and part_scale at least 0"):
            LiveRecords(prepared, dataclasses.replace(DATA, **wrong), GRID)
    with pytest.raises(ValueError, match=r"new_joints must be in 0\.\.1, got 1\.5"):
        take(prepared, dataclasses.replace(DATA, new_joints=1.5), 1)
    featured = dataclasses.replace(
        PLAIN, uniart_vae=dataclasses.replace(PLAIN.uniart_vae, visual_channels=4)
    )
    with pytest.raises(ValueError, match="live and part_color need visual_channels"):
        take(prepared, DATA, 1, model=featured)


@pytest.mark.slow
def test_worker_processes_make_the_same_batches(prepared):
    straight = take(prepared, DATA, 4)
    worked = iter(
        batches.voxel_batches(prepared, dataclasses.replace(DATA, workers=2), PLAIN, 2, seed=5)
    )
    assert all(same(next(worked), expected) for expected in straight)
    worked.close()

"""Prepared folders: kill and rerun, failures, settings, and the real thing at a small size."""

from __future__ import annotations

import csv
import hashlib
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from hand_records import make_record

from uniart_jax import procedural
from uniart_jax.config import GridConfig
from uniart_jax.data import card, folder, object_records, prepare, records, sources
from uniart_jax.runtime import files

GRID = GridConfig(8, 2, 8)


@pytest.fixture
def fake(monkeypatch):
    """Objects by hand in place of generator, voxeliser and renderer; every seventh fails."""
    made = []

    def make_records(settings, entry):
        index = entry.seed - settings.start_seed
        made.append(index)
        row = {"object": entry.key, "category": entry.category, "seed": entry.seed}
        row |= {"split": entry.split, "repairs": "mesh 'x': its file 'y' is missing" * (index == 3)}
        out = []
        for state in range(settings.states):
            if index % 7 == 6:
                failed = {**row, "id": f"{index}", "refused": 8, "error": f"'{index}' is too close"}
                out.append((b"", b"", failed))
                continue
            data = records.to_bytes(make_record(100 * index + state))
            orbit = (
                records.pack_arrays({"x": np.arange(index)}, {}) if settings.orbit_views else b""
            )
            facts = {"joints": "revolute:2", "parts": 3, "voxels": 40, "refused": 0, "error": ""}
            out.append((data, orbit, {**row, **facts, "id": f"{index}-{state}", "state": state}))
        return out

    monkeypatch.setattr(prepare, "make_records", make_records)
    monkeypatch.setattr(card, "write_contact_sheet", lambda folder, rows, settings: None)
    monkeypatch.setattr(procedural, "SEEN_FAMILIES", ("door", "drawer"), raising=False)
    monkeypatch.setattr(procedural, "FAMILIES", ("door", "drawer"), raising=False)
    return made


def run(out, count=20, **changes):
    options = {"grid": GRID, "processes": 1, "shard_size": 6, "progress": False, **changes}
    return prepare.prepare_procedural(out, count, **options)


def digest(path: Path) -> dict[str, str]:
    return {
        str(p.relative_to(path)): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in sorted(path.rglob("*"))
        if p.is_file()
    }


def test_rerun_after_a_kill_equals_an_unbroken_run(tmp_path, fake):
    whole = digest(run(tmp_path / "a"))
    out = run(tmp_path / "b")
    (out / "records-00001.arrayrecord").unlink()  # killed before the rename of the shard
    temporary = files.temporary_path(out / "records-00001.arrayrecord").name
    (out / temporary.replace(f"-{os.getpid()}.", "-99999999.")).write_bytes(b"half")
    (out / "records-00003.arrayrecord").unlink()
    (out / "rows" / "00003.csv").unlink()
    (out / "manifest.csv").unlink()
    fake.clear()
    run(out)
    assert fake == [*range(6, 12), 18, 19]  # finished shards are kept
    assert digest(out) == whole


def test_growing_equals_one_larger_run(tmp_path, fake):
    run(tmp_path / "a", count=8)
    fake.clear()
    run(tmp_path / "a")
    assert fake == list(range(6, 20))  # the short last shard is made again
    assert digest(tmp_path / "a") == digest(run(tmp_path / "b"))


def test_killed_while_growing(tmp_path, fake, monkeypatch):
    run(tmp_path / "a", count=8)
    write_rows = prepare.write_rows

    def killed(path, rows):
        write_rows(path, rows)
        raise KeyboardInterrupt

    # killed when the rows are there and the longer shard has no name yet
    monkeypatch.setattr(prepare, "write_rows", killed)
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "a")
    monkeypatch.setattr(prepare, "write_rows", write_rows)
    assert digest(run(tmp_path / "a")) == digest(run(tmp_path / "b"))


def test_manifest_follows_records_and_keeps_failures(tmp_path, fake):
    out = run(tmp_path, states=2)
    rows = folder.read_manifest(out)
    assert [row["id"] for row in rows if row["error"]] == ["6", "6", "13", "13"]
    source = records.RecordSource(out)
    good = [row for row in rows if not row["error"]]
    assert len(source) == len(good) == 36
    for index in (0, 12, 35):
        k, state = map(int, good[index]["id"].split("-"))
        assert source[index].meta["id"] == f"hand-{100 * k + state}"
    text = (out / "data-card.md").read_text()
    assert "36 records of 20 objects; 2 objects failed" in text and "| door | 18 |" in text
    assert "| '...' is too close | 4 |" in text
    assert "| mesh '...': its file '...' is missing | 1 |" in text
    assert folder.read_metadata(out)["families"] == ["door", "drawer"]


def test_a_shard_where_everything_fails(tmp_path, fake):
    run(tmp_path, count=8, shard_size=1)
    assert len(records.RecordSource(tmp_path)) == 7


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"count": 0}, "count must be at least 1, got 0"),
        ({"start_seed": -1}, "start seed must be at least 0, got -1"),
        ({"grid": GridConfig(257, 2, 8)}, "resolution must be in 1..256, got 257"),
        ({"grid": GridConfig(0, 2, 8)}, "resolution must be in 1..256, got 0"),
        ({"grid": GridConfig(8, 9, 8)}, "subdivisions must be in 1..8, got 9"),
        ({"image_size": 7}, "image size must be at least 8, got 7"),
        ({"views": 0}, "views must be at least 1"),
        ({"states": 0}, "states must be at least 1"),
        ({"processes": 0}, "processes must be at least 1"),
    ],
)
def test_settings_are_checked_before_anything_is_made(tmp_path, fake, changes, words):
    with pytest.raises(ValueError, match=f"^prepare: {words}"):
        run(tmp_path / "a", **changes)
    assert not (tmp_path / "a").exists() and not fake


def test_failures_are_told_and_all_failing_is_an_error(tmp_path, fake, capsys, monkeypatch):
    run(tmp_path / "a", states=2)
    assert (
        "prepare: 2 of 20 objects failed in some state (2 '...' is too close); see"
        in capsys.readouterr().err
    )
    run(tmp_path / "b", count=6)
    assert capsys.readouterr().err == ""
    entry = sources.Entry("door-0000006", "door", "train", 6)
    ((_, _, row),) = prepare.make_records(folder.Settings(), entry)
    fails = lambda settings, entry: [(b"", b"", {**row, "object": entry.key})]  # noqa: E731
    monkeypatch.setattr(prepare, "make_records", fails)
    for _ in range(2):  # again on the finished folder
        with pytest.raises(
            ValueError, match=r"none of 3 objects succeeded.*because: '6' is too close"
        ) as e:
            run(tmp_path / "c", count=3)
        assert "\n" not in str(e.value)
    assert len(folder.read_manifest(tmp_path / "c")) == 3


def test_other_settings_are_refused(tmp_path, fake):
    run(tmp_path / "a", count=8)
    with pytest.raises(ValueError, match=r"another setting: views 2 \(asked: 3\)") as caught:
        run(tmp_path / "a", views=3)
    assert "\n" not in str(caught.value)
    before = digest(tmp_path / "a")
    for count in (6, 7):  # one shard less, and a shorter last shard
        with pytest.raises(ValueError, match=f"holds 8 objects, more than the {count} asked for"):
            run(tmp_path / "a", count=count)
    assert digest(tmp_path / "a") == before
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "thesis.doc").write_text("")
    with pytest.raises(ValueError, match="holds no records of ours"):
        run(tmp_path / "b")
    with pytest.raises(ValueError, match="unknown families chair; known: door, drawer"):
        run(tmp_path / "c", families=("chair",))
    assert not (tmp_path / "c").exists()


@pytest.mark.parametrize("text", ["", "[]", "[" * 200_000])
def test_damaged_metadata_is_one_line(tmp_path, text):
    (tmp_path / "metadata.json").write_text(text)
    with pytest.raises(
        ValueError, match=r"metadata\.json: damaged \(.*; prepare the records again"
    ):
        folder.read_metadata(tmp_path)


real = pytest.mark.skipif(not hasattr(procedural, "generate"), reason="no generators yet")


@real
def test_real_objects(tmp_path):
    count = len(procedural.SEEN_FAMILIES)
    out = run(tmp_path, count=count, grid=GridConfig(16, 2, 64), image_size=32, states=2)
    rows = folder.read_manifest(out)
    assert {row["category"] for row in rows} == set(procedural.SEEN_FAMILIES)
    assert not [row["error"] for row in rows if row["error"]]
    source = records.RecordSource(out)
    assert len(source) == 2 * count
    record = source[0]
    assert record.meta["joint_types"][0] == "fixed" and record.resolution == 16
    assert record.images.shape == (2, 32, 32, 4)
    assert 0.02 < (record.images[..., 3] > 0).mean() < 0.98
    assert set(np.unique(record.voxel_part)) == set(range(len(record.boxes)))
    assert (out / "contact-sheet.png").stat().st_size > 1000


@real
def test_failures_do_not_stop_a_run(tmp_path, monkeypatch):
    drawn = object_records.sample_state
    calls = []

    def sample_state(obj, rng, clearance):
        calls.append(obj)
        if len(calls) < 3:
            raise ValueError("parts 'a' and 'b' have the same box")
        if len(calls) == 4:
            raise KeyError("broken")
        return drawn(obj, rng, clearance)

    monkeypatch.setattr(object_records, "sample_state", sample_state)
    run(tmp_path, count=3, grid=GridConfig(16, 2, 64), image_size=16, views=1)
    rows = folder.read_manifest(tmp_path)
    assert [row["refused"] for row in rows] == ["2", "0", "0"]
    assert [row["error"] for row in rows] == ["", "KeyError: 'broken'", ""]


SCRIPT = """
import sys
from uniart_jax.config import GridConfig
from uniart_jax.data.prepare import prepare_procedural
if __name__ == "__main__":
    prepare_procedural(sys.argv[1], 24, grid=GridConfig(16, 2, 64), image_size=32, views=1,
                       processes=int(sys.argv[2]), shard_size=4, progress=False)
"""


def alive(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def test_what_others_write_is_left_alone(tmp_path, fake):
    """A run sweeps away what dead processes left, never what a living one is writing."""
    out = run(tmp_path / "a")
    mine = files.temporary_path(out / "visual-00000.arrayrecord")
    dead = mine.with_name(mine.name.replace(f"-{os.getpid()}.", "-99999999."))
    for path in (mine, dead):
        path.write_bytes(b"")
    run(out)
    assert mine.exists() and not dead.exists()


def test_two_runs_may_begin_at_once(tmp_path, fake, monkeypatch):
    """The other one writes its metadata between our look and our writing."""
    begin, out = folder._begin, tmp_path / "a"

    def late(path, metadata):
        (path / "rows").mkdir(parents=True)
        (path / "metadata.json").write_text(metadata)
        begin(path, metadata)

    monkeypatch.setattr(folder, "_begin", late)
    run(out)
    assert len(records.RecordSource(out)) == 18
    monkeypatch.setattr(
        folder, "_begin", lambda path, text: late(path, text.replace('"views": 2', '"views": 5'))
    )
    with pytest.raises(ValueError, match=r"another setting: views 5 \(asked: 2\)"):
        run(tmp_path / "b")


def test_lost_orbits_are_made_again(tmp_path, fake):
    out = run_orbits(tmp_path / "a")
    whole = digest(out)
    (out / "orbit-00001.arrayrecord").unlink()
    fake.clear()
    run_orbits(out)
    assert fake == list(range(6, 12)) and digest(out) == whole
    (out / "orbit-00001.arrayrecord").unlink()
    (out / "visual-00001.arrayrecord").write_bytes(b"")  # its features are there: it may be gone
    fake.clear()
    run_orbits(out)
    assert not fake


def run_orbits(out):
    entries, settings = prepare.procedural_entries(
        folder.Settings(resolution=8, subdivisions=2, orbit_views=1, shard_size=6), 14, None
    )
    return prepare.prepare(out, entries, settings, processes=1, progress=False)


@real
@pytest.mark.slow
def test_kill_minus_nine(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    out = tmp_path / "killed"
    command = [sys.executable, str(script), str(out), "2"]
    process = subprocess.Popen(command, start_new_session=True)
    group = process.pid
    deadline = time.monotonic() + 120
    while not list(out.glob("records-*")) and time.monotonic() < deadline:
        time.sleep(0.05)
    process.kill()  # only the parent: its workers must notice
    process.wait()
    assert not (out / "manifest.csv").exists()
    while alive(group) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not alive(group), "workers outlive their parent"
    subprocess.run(command, check=True)
    whole = tmp_path / "whole"
    subprocess.run([sys.executable, str(script), str(whole), "1"], check=True)
    assert digest(out) == digest(whole)
    with (out / "manifest.csv").open(newline="") as file:
        assert len(list(csv.DictReader(file))) == 24
